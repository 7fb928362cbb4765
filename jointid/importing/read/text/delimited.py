"""Numbers of delimited rows whose layout the format states."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.csv as pa_csv  # type: ignore[import-untyped]

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.files.csv_tables import ARROW_FAULTS
from jointid.importing.columns.log_table import MAX_COLUMNS, require_few_values
from jointid.importing.read.text.layout import NO_NUMBER

NULLS = [form for word in sorted(NO_NUMBER) for form in (word, word.upper(), word.title())] + [
    "NaN",
    " ",
]
"""Cells that denote a missing value, as pyarrow takes them."""


def columns_of(
    file: str,
    lines: Sequence[str],
    separator: str,
    decimal: str,
    width: int,
    integers: Collection[int] = (),
) -> list[Floats]:
    """Return the columns of rows of numbers; cells that a row lacks at its end are NaN.

    Parameters
    ----------
    file : str
        Its name, for messages.
    lines : sequence of str
    separator, decimal : str
    width : int
        Number of columns; further cells of a row are dropped.
    integers : collection of int, optional
        Columns of large integers, returned as int64 (FILETIME ticks lose digits as float64).

    Raises
    ------
    JointIdError
        When a cell is no number, or there are too many.
    """
    require_few_values(file, len(lines) * width)
    if width > MAX_COLUMNS or not lines:
        raise JointIdError(
            f"{file} has {width} columns and {len(lines)} rows; a log has rows, and at most "
            f"{MAX_COLUMNS} columns. Export the log again."
        )
    padded = []
    for line in lines:
        lacks = width - 1 - line.count(separator)
        if lacks < 0:
            line = separator.join(line.split(separator)[:width])
        padded.append(line + separator * max(lacks, 0))
    names = [str(k) for k in range(width)]
    try:
        table = pa_csv.read_csv(
            pa.BufferReader("\n".join(padded).encode("utf-8", "replace")),
            read_options=pa_csv.ReadOptions(column_names=names),
            parse_options=pa_csv.ParseOptions(delimiter=separator, ignore_empty_lines=width > 1),
            convert_options=pa_csv.ConvertOptions(
                column_types={n: pa.int64() if int(n) in integers else pa.float64() for n in names},
                null_values=NULLS,
                decimal_point=decimal,
            ),
        )
        return [
            np.asarray(column.fill_null(0) if int(name) in integers else column.to_numpy())
            for name, column in zip(names, table.columns, strict=True)
        ]
    except ARROW_FAULTS as error:
        reason = " ".join(str(error).split())
        raise JointIdError(
            f"{file} has a cell without a number below its header ({reason:.150}): export the log again."
        ) from error
