"""Numbers of a text table: fast if it is regular, else line by line with exact places in errors."""

import io
import re
from collections.abc import Collection, Sequence

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.files.csv_tables import ARROW_FAULTS, MAX_LINE, parsed_columns
from jointid.importing.columns.column_words import WORDS, words_of
from jointid.importing.columns.log_table import (
    MAX_COLUMNS,
    LogColumn,
    LogTable,
    numbers,
    require_few_columns,
    require_few_values,
)
from jointid.importing.read.text.clock_times import ClockCells
from jointid.importing.read.text.layout import (
    BLANKS,
    NO_NUMBER,
    TextLayout,
    decoded,
    find_layout,
    is_missing,
    split_line,
)
from jointid.importing.read.text.numbers import is_number, number_in, without_thousands
from jointid.wording import counted, listed


def read_text_table(file: str, data: bytes) -> LogTable:
    """Read a text table; its layout is detected.

    Columns of text are left out. Cells that are not numbers are NaN; a note counts them. Raises
    JointIdError when it is not a table, or a line in its middle has another number of cells.
    """
    text = decoded(file, data)
    layout = find_layout(file, text)
    require_few_columns(file, len(layout.numeric))
    names = [name or f"column {k}" for k, name in enumerate(layout.names, start=1)]
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
            continue  # from a separator at the end of every line
        unit = "s" if layout.clock[k] else layout.units[k]
        columns.append(LogColumn(names[k], numbers(column), unit))
    left_out = [name for k, name in enumerate(names) if k not in wanted]
    if left_out:
        notes.append(f"Columns without numbers, left out: {listed(left_out)}.")
        notes += [
            f'The name of "{name}" indicates time, but it holds neither numbers nor times in a known '
            "format. Export it in seconds, or as 2026-05-07 09:00:00.123."
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
        body = re.sub(r"(?m)^\t|\t$", "", re.sub(r"[ \t]+", "\t", body))
        separator = "\t"
    clocks = [k for k in wanted if layout.clock[k]]
    if clocks and quotes:
        return None
    if layout.thousands:
        if clocks or layout.thousands == separator:
            return None  # in quotes
        plain = without_thousands(body, layout.thousands)
        if plain is None:
            return None
        body = plain
    try:
        data, width = body.encode("utf-8", "replace"), len(layout.numeric)
        numeric = [k for k in wanted if k not in clocks]
        columns = parsed_columns(data, width, numeric, separator, layout.decimal, _NULLS)
        lines = [line for line in body.split("\n") if line.strip()] if clocks else []
        for k in clocks:
            clock = ClockCells()
            times = [clock.read(line.split(separator, k + 1)[k].strip()) for line in lines]
            if None in times:
                return None
            columns.insert(wanted.index(k), clock.seconds(np.array(times)))
    except ARROW_FAULTS:
        return None
    if quotes and columns[0].size != sum(bool(line.strip()) for line in body.split("\n")):
        return None  # a quote that is not closed swallows the lines up to the next one
    return columns if columns[0].size > 1 else None


def regular_columns(
    data: bytes,
    width: int,
    numeric: Sequence[int],
    separator: str,
    decimal: str,
    texts: Sequence[int],
) -> list[Floats] | None:
    """Columns of numbers, then those of ``texts``, as ``parsed_columns``; None if a row is irregular."""
    try:
        return parsed_columns(data, width, numeric, separator, decimal, _NULLS, texts=texts)
    except ARROW_FAULTS:
        return None


def _read_slowly(
    file: str, layout: TextLayout, body: str, wanted: list[int], notes: list[str]
) -> list[Floats]:
    """Read line by line: note cells that are not numbers, refuse lines that are not rows."""
    width = len(layout.numeric)
    rows: list[list[float]] = []
    clocks = {k: ClockCells() for k in wanted if layout.clock[k]}
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
        notes.append(_cut_short(wrong[0]))
    for k, (count, line, text) in strange.items():
        notes.append(
            f"Column {layout.names[k] or k + 1}: {counted(count, 'cell')} without a number, "
            f'treated as missing; the first is "{text:.40}" in line {line}.'
        )
    if len(rows) < 2:
        raise JointIdError(
            f"{file} has {counted(len(rows), 'row')} of numbers: export the log again, with one row per "
            "sample."
        )
    table = np.array(rows)
    for place, k in enumerate(wanted):
        if k in clocks:
            table[:, place] = clocks[k].seconds(table[:, place])
    return list(table.T)


def _cut_short(line: int) -> str:
    return f"The last line ({line}) is cut short and was left out."


def _value(cell: str, layout: TextLayout) -> float | None:
    return np.nan if is_missing(cell) else number_in(cell, layout.decimal, layout.thousands)


_NULLS = ["NaN", " ", *(f for word in sorted(NO_NUMBER) for f in (word, word.upper(), word.title()))]
"""Cells that denote a missing value, in pyarrow's form."""


def columns_of(
    file: str,
    lines: Sequence[str],
    names: Sequence[str],
    *,
    separator: str = ";",
    decimal: str = "",
    first_line: int = 1,
    integers: Collection[int] = (),
    notes: list[str] | None = None,
) -> list[Floats]:
    """Return a column for each of ``names`` from lines of numbers; blank lines are skipped.

    Missing cells at the end of a line are NaN; cells beyond ``names`` are dropped. The ``decimal``
    mark is by default a comma where the first lines have commas that separate no columns. Columns of
    large ``integers`` are int64: FILETIME ticks lose digits as float64. ``first_line`` is the number of
    the first of the lines in the file. With ``notes``, a last line with fewer cells than the one before
    is cut short, left out and noted, as in ``read_text_table``; without, columns may differ in length.
    Raises JointIdError, with line and column, when a cell is not a number; also when there are too many.
    """
    width = len(names)
    decimal = decimal or ("," if separator != "," and any("," in x for x in lines[:2000]) else ".")
    require_few_values(file, len(lines) * width)
    kept = [(number, line) for number, line in enumerate(lines, start=first_line) if line.strip()]
    if notes is not None and len(kept) > 1:
        before, last = (line.count(separator) for _, line in kept[-2:])
        if last < before:
            notes.append(_cut_short(kept.pop()[0]))
    rows = [_row(line, separator, width) for _, line in kept]
    if width > MAX_COLUMNS or not rows:
        raise JointIdError(
            f"{file} has {width} columns and {len(rows)} rows: export the log again, with one row "
            f"per sample and at most {MAX_COLUMNS} columns."
        )
    try:
        text = "\n".join(rows).encode("utf-8", "replace")
        return parsed_columns(text, width, range(width), separator, decimal, _NULLS, integers)
    except ARROW_FAULTS as error:
        for number, line in kept:
            cells = _row(line, separator, width).split(separator)
            for name, cell in zip(names, map(str.strip, cells), strict=True):
                if not (is_missing(cell) or is_number(cell, decimal)):
                    raise JointIdError(
                        f'{file}, line {number}, column {name:.60}: "{cell:.40}" is not a number. '
                        "Repair or remove the line, or export the log again."
                    ) from error
        reason = " ".join(str(error).split())
        raise JointIdError(
            f"{file} has a line that is not numbers ({reason:.150}): export the log again."
        ) from error


def _row(line: str, separator: str, width: int) -> str:
    """Return a line with as many cells as the table has columns."""
    lacks = width - 1 - line.count(separator)
    return line + separator * lacks if lacks >= 0 else separator.join(line.split(separator)[:width])
