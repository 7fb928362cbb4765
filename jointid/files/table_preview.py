"""Preview of a record's table, also of one that is refused."""

import csv
from collections.abc import Sequence
from itertools import islice

import numpy as np
import pandas as pd
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pa_parquet  # type: ignore[import-untyped]

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.files.csv_tables import (
    DELIMITERS,
    lines_above,
    parquet_faults,
    read_header,
    text_lines,
    unreadable,
)


def peek_table(file: str, data: bytes, rows: int, *, around: int = 0) -> pd.DataFrame:
    """Return at most ``rows`` rows of a .csv or .parquet table, valid or not; a CSV may be cut.

    They include the line or row ``around``, by default the first ones. Columns that hold only numbers
    are numbers, also with decimal commas; others are text. The index is the "Line" of a CSV file or the
    "Row" of a Parquet file, from 1. Raises JointIdError when no preview is possible.
    """
    if not data:
        raise JointIdError(f"{file} is empty (0 bytes).")
    first = max(around - rows // 2, 0)
    if file.lower().endswith(".parquet"):
        return _peek_parquet(file, data, first, rows)
    try:
        body = read_header(file, data)[1]
    except JointIdError:
        body = 0  # the preview begins with the first line
    above = lines_above(data, body)
    begin = max(data.rfind(b"\n", 0, body), data.rfind(b"\r", 0, body)) + 1
    below = text_lines(file, data, errors="replace", begin=begin)
    head = next(below, "")
    skipped = max(first - above - 2, 0)
    cells = list(islice(below, skipped, skipped + rows))
    if "\0" in head or "\0" in "".join(cells):
        raise JointIdError(f"{file} is not text.")
    delimiter = _delimiter([head, *cells])
    try:
        names = next(csv.reader([head.lstrip("# ")], delimiter=delimiter), [])
        reader = csv.reader(cells, delimiter=delimiter)
        table = [(above + 1 + skipped + reader.line_num, row) for row in reader if row]
    except csv.Error as error:
        raise unreadable(file, "CSV", error) from error
    width = max([len(names), *(len(row) for _, row in table)], default=0)
    header = [name.strip() for name in [*names, *[""] * (width - len(names))]]
    if len(set(header)) < width or "" in header:  # a frame needs distinct names
        header = [f"{k}: {name}" for k, name in enumerate(header, start=1)]
    padded = [row + [""] * (width - len(row)) for _, row in table]
    index = pd.Index([line for line, _ in table], name="Line")
    frame = pd.DataFrame(padded, index, header, dtype=str)
    for name in header:
        text = frame[name] if delimiter == "," else _with_points(frame[name])
        numbers = pd.to_numeric(text, errors="coerce")
        if len(text) and numbers.notna().all():
            frame[name] = numbers
    return frame


def plottable(frame: pd.DataFrame) -> dict[str, Floats]:
    """Return the mostly numeric columns of a preview, shape (N,); other cells are NaN."""
    found = {}
    for name in frame.columns:
        numbers = pd.to_numeric(_with_points(frame[name]), errors="coerce")
        if 2 * int(numbers.notna().sum()) > len(numbers):
            found[str(name)] = np.where(np.isfinite(numbers), numbers, np.nan).astype(float)
    return found


def _peek_parquet(file: str, data: bytes, first: int, rows: int) -> pd.DataFrame:
    with parquet_faults(file):
        source = pa_parquet.ParquetFile(pa.BufferReader(data))
        passed, parts = 0, []
        for batch in source.iter_batches(batch_size=rows, use_threads=False):
            part = batch.slice(max(first - passed, 0))[: max(first + rows - max(passed, first), 0)]
            passed += batch.num_rows
            if passed > first:
                parts.append(part)
            if passed >= first + rows:
                break
        if parts:
            frame: pd.DataFrame = pa.Table.from_batches(parts).to_pandas(ignore_metadata=True)
            frame.index = pd.RangeIndex(first + 1, first + 1 + len(frame), name="Row")
            return frame
    return pd.DataFrame()


def _delimiter(lines: Sequence[str]) -> str:
    """Separator of the columns; only the comma can also be a decimal mark."""
    written = [line for line in lines if line.strip()]
    for delimiter in DELIMITERS:
        if 2 * sum(delimiter in line for line in written) > len(written):
            return delimiter
    return ","


def _with_points(column: pd.Series) -> pd.Series:
    """Cells like 0,25 as 0.25; other cells and numeric columns unchanged."""
    if pd.api.types.is_numeric_dtype(column):
        return column
    return column.astype(str).str.replace(
        r"^\s*([-+]?\d*),(\d+(?:[eE][-+]?\d+)?)\s*$", r"\1.\2", regex=True
    )
