"""Numbers of a text table: fast if it is regular, else line by line with exact places in errors."""

from __future__ import annotations

import io
import re

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.csv as pa_csv  # type: ignore[import-untyped]

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.files.csv_tables import ARROW_FAULTS
from jointid.importing.columns.column_words import WORDS, words_of
from jointid.importing.columns.log_table import LogColumn, LogTable, numbers, require_few_values
from jointid.importing.read.text.clock_times import ClockCells
from jointid.importing.read.text.delimited import NULLS
from jointid.importing.read.text.layout import (
    BLANKS,
    MAX_LINE,
    TextLayout,
    decoded,
    find_layout,
    is_missing,
    split_line,
)
from jointid.importing.read.text.numbers import is_number, value_of, without_thousands
from jointid.wording import counted, listed


def read_text_table(file: str, data: bytes) -> LogTable:
    """Read a text table; its layout is detected.

    Parameters
    ----------
    file : str
        Its name, for messages.
    data : bytes

    Returns
    -------
    LogTable
        Without columns of text. Cells that are not numbers are NaN; a note counts them.

    Raises
    ------
    JointIdError
        When it is not a table, or a line in its middle has another number of cells.
    """
    text = decoded(file, data)
    layout = find_layout(file, text)
    wanted = [k for k, used in enumerate(layout.numeric) if used or layout.clock[k]]
    require_few_values(file, (text.count("\n", layout.body) + 1) * len(wanted))
    notes = list(layout.notes)
    body = text[layout.body :]
    del text
    fast = _read_fast(layout, body, wanted)
    values = fast if fast is not None else _read_slowly(file, layout, body, wanted, notes)
    columns = []
    for k, column in zip(wanted, values, strict=True):
        if np.isnan(column).all() and not layout.names[k]:
            continue  # an effect of a separator at the end of every line
        unit = "s" if layout.clock[k] else layout.units[k]
        columns.append(LogColumn(layout.names[k], numbers(column), unit, f"column {k + 1}"))
    left_out = [
        layout.names[k] or f"column {k + 1}" for k in range(len(layout.numeric)) if k not in wanted
    ]
    if left_out:
        notes.append(f"Columns without numbers, left out: {listed(left_out)}.")
        notes += [
            f'"{name}" is named as time, but is neither a number nor a time that is read here. Export '
            "it in seconds, or as 2026-05-07 09:00:00.123."
            for name in left_out
            if WORDS["time"] & set(words_of(name))
        ]
    if not layout.has_header:
        notes.append("There is no line with names above the numbers: the columns are numbered.")
    return LogTable(file, tuple(columns), tuple(notes), layout.first_line, "line")


def _read_fast(layout: TextLayout, body: str, wanted: list[int]) -> list[Floats] | None:
    """Read a body of regular lines; None if one is irregular."""
    separator, quotes = layout.separator, '"' in body
    if separator == BLANKS:
        body = re.sub(r"[ \t]+", "\t", re.sub(r"(?m)^[ \t]+|[ \t]+$", "", body))
        separator = "\t"
    if any(layout.clock[k] for k in wanted):
        return None
    if layout.thousands:
        if layout.thousands == separator:
            return None  # in quotes
        plain = without_thousands(body, layout.thousands)
        if plain is None:
            return None
        body = plain
    try:
        table = pa_csv.read_csv(
            pa.BufferReader(body.encode()),
            read_options=pa_csv.ReadOptions(column_names=[str(k) for k in range(len(layout.numeric))]),
            parse_options=pa_csv.ParseOptions(delimiter=separator),
            convert_options=pa_csv.ConvertOptions(
                include_columns=[str(k) for k in wanted],
                column_types={str(k): pa.float64() for k in wanted},
                null_values=NULLS,
                decimal_point=layout.decimal,
            ),
        )
        if quotes and table.num_rows != sum(bool(line.strip()) for line in body.split("\n")):
            return None  # a quote that is not closed swallows the lines up to the next one
        return [np.asarray(column.to_numpy(), float) for column in table.columns]
    except ARROW_FAULTS:
        return None


def _read_slowly(
    file: str, layout: TextLayout, body: str, wanted: list[int], notes: list[str]
) -> list[Floats]:
    """Read line by line: note cells that are not numbers, refuse lines that are not rows."""
    width = len(layout.numeric)
    rows: list[list[float]] = []
    clocks = {
        k: ClockCells(f"{file}, column {layout.names[k] or k + 1}") for k in wanted if layout.clock[k]
    }
    wrong: tuple[int, int] | None = None  # line and number of cells of a line that does not fit
    strange: dict[int, tuple[int, int, str]] = {}  # column: how many cells, line and text of the first
    for number, raw in enumerate(io.StringIO(body), start=layout.first_line):
        if len(raw) > MAX_LINE:
            raise JointIdError(
                f"{file}, line {number}: longer than {MAX_LINE} characters. Export one row per sample, "
                "each on a line of its own."
            )
        cells = split_line(raw.rstrip("\n"), layout.separator)
        if not cells:
            continue
        if wrong is not None:
            raise JointIdError(
                f"{file}, line {wrong[0]}: {counted(wrong[1], 'cell')}, but the table has {width} "
                "columns. Repair or remove the line; one log must be one table."
            )
        if len(cells) != width:
            wrong = (number, len(cells))
            continue
        row = []
        for k in wanted:
            value = clocks[k].read(cells[k]) if k in clocks else _value(cells[k], layout)
            if value is None:
                count, line, text = strange.get(k, (0, number, cells[k]))
                strange[k] = (count + 1, line, text)
                value = np.nan
            row.append(value)
        rows.append(row)
    if wrong is not None:
        notes.append(f"The last line ({wrong[0]}) is cut short and was left out.")
    for k, (count, line, text) in strange.items():
        notes.append(
            f"Column {layout.names[k] or k + 1}: {counted(count, 'cell')} without a number, "
            f'taken as missing; the first is "{text:.40}" in line {line}.'
        )
    if not rows:
        raise JointIdError(f"{file} has a header but no rows: export the log again.")
    table = np.array(rows)
    for place, k in enumerate(wanted):
        if k in clocks:
            table[:, place], note = clocks[k].seconds(table[:, place])
            notes += [note] if note else []
    return list(table.T)


def _value(cell: str, layout: TextLayout) -> float | None:
    if is_missing(cell):
        return np.nan
    if not is_number(cell, layout.decimal, layout.thousands):
        return None
    return value_of(cell, layout.decimal, layout.thousands)
