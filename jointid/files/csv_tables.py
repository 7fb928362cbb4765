"""Columns of numbers from a CSV file: a fast reader, and the exact place of the first fault."""

import csv
import io
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Literal, TypeAlias

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.csv as pa_csv  # type: ignore[import-untyped]

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.wording import counted

MAX_LINE = 1 << 16
"""Longest line of a text table, bytes."""
_DELIMITERS = {";": "semicolons", "\t": "tabs", "|": "bars"}
"""Other separators of columns, with their names."""
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
COMMENT = b"#"
"""First character of the lines that may precede the column names."""
_BLOCK = 1 << 20
"""Bytes that are read at once in the search for a fault."""
_SOMETHING = re.compile(rb"[^\r\n]")
ARROW_FAULTS = (
    pa.ArrowException,
    OSError,
    ValueError,
    LookupError,
    TypeError,
    MemoryError,
    OverflowError,
)
"""Exceptions of Arrow for a file it cannot read."""


@contextmanager
def parquet_faults(file: str) -> Iterator[None]:
    """Report Arrow's exceptions for a Parquet file as its error."""
    try:
        yield
    except JointIdError:
        raise
    except ARROW_FAULTS as error:
        raise unreadable(file, "Parquet", error) from error


def read_header(file: str, data: bytes) -> tuple[list[str], int]:
    """Read the column names of a file that is not empty, and the offset of the line after them.

    They are the cells of the first line that is not blank nor a comment (#), without blanks around them.
    Raises JointIdError when it is not UTF-8 text, has no rows, or is not separated by commas.
    """
    begin = len(_BYTE_ORDER_MARK) if data.startswith(_BYTE_ORDER_MARK) else 0
    while True:
        names, line, body, text = _names(file, data, begin)
        if not line.startswith(COMMENT):
            break
        names = [name.lstrip("# ") for name in names]
        if "time_s" in names:  # the header itself as a comment, as NumPy writes it
            break
        begin = body
        if begin > MAX_LINE:
            raise JointIdError(f"{file}: no column names in {begin} bytes: remove the comments.")
    if _SOMETHING.search(data, body) is None:
        raise JointIdError(f"{file} has a header but no rows: export the record again.")
    for delimiter, what in _DELIMITERS.items():
        if "time_s" not in names and text.count(delimiter) > text.count(","):
            raise JointIdError(
                f"{file} has {what} between its columns: expected commas. Save it with commas between "
                "columns and points as decimal marks (0.25, not 0,25), or import it as a log, which "
                "accepts it unchanged."
            )
    return names, body


def _names(file: str, data: bytes, begin: int) -> tuple[list[str], bytes, int, str]:
    """Cells, bytes, end and text of the first line from ``begin`` that is not blank."""
    start = _SOMETHING.search(data, begin)
    if start is None:
        what = "comments and blank lines" if COMMENT in data[:begin] else "blank lines"
        raise JointIdError(f"{file} holds only {what}: export the record again.")
    line = data[start.start() : start.start() + MAX_LINE]
    end = re.search(rb"[\r\n]", line)
    if end is None and len(line) == MAX_LINE:
        raise JointIdError(f"{file}: the first line exceeds {MAX_LINE} bytes: write one row per line.")
    line = line[: end.start()] if end else line
    if line.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in line:
        raise JointIdError(
            f"{file} is not UTF-8 text but binary or UTF-16.",
            hint="Export it as CSV with the encoding UTF-8.",
        )
    try:
        text = line.decode(errors="replace" if line.startswith(COMMENT) else "strict")
        names = [name.strip() for name in next(csv.reader([text]))]
    except UnicodeDecodeError as error:
        raise JointIdError(
            f"{file} is not UTF-8 text: its first line has the byte 0x{line[error.start]:02X}.",
            hint="Save it with the encoding UTF-8.",
        ) from None
    return names, line, start.start() + len(line), text


def read_columns(
    file: str,
    data: bytes,
    header: Sequence[str],
    body: int,
    positions: Sequence[int],
    may_be_empty: Collection[int] = (),
) -> list[Floats]:
    """Read the columns at some positions: finite numbers, the first column strictly increasing.

    ``header`` and ``body`` are from ``read_header``; other columns are ignored, whatever they hold.
    Columns at ``may_be_empty`` that have no value at all are NaN.
    Raises JointIdError for the first row that does not fit, with line (the file's first line is 1),
    column, value and remedy.
    """
    try:
        # By position, not by name: the header was read above, with its blanks and quotes.
        nulls = [""] if may_be_empty else []
        columns = parsed_columns(memoryview(data)[body:], len(header), positions, nulls=nulls)
        if b'"' in data[body:]:
            _require_closed_quotes(file, data, body, columns[0].size)
    except JointIdError:
        raise
    except ARROW_FAULTS as error:
        _explain_fault(file, data, header, body, positions)
        raise unreadable(file, "CSV", error) from error
    pairs = zip(positions, columns, strict=True)
    given = {k: c for k, c in pairs if k not in may_be_empty or not np.isnan(c).all()}
    if not are_usable([*given.values()]):
        _explain_fault(file, data, header, body, [*given])
        raise unreadable(file, "CSV", "a value is not finite, or the times do not increase")
    return columns


def parsed_columns(
    data: bytes | memoryview,
    width: int,
    positions: Iterable[int],
    separator: str = ",",
    decimal: str = ".",
    nulls: Sequence[str] = (),
    integers: Collection[int] = (),
    texts: Sequence[int] = (),
) -> list[Floats]:
    """Return the columns at some positions of regular rows, which have ``width`` cells.

    Cells of ``nulls`` are NaN; in columns of ``integers``, which are int64, 0. Columns of ``texts``
    follow, as numbers that are equal for equal texts. Raises one of ``ARROW_FAULTS`` when a row is
    irregular.
    """
    kinds = {str(k): pa.int64() if k in integers else pa.float64() for k in positions}
    kinds |= {str(k): pa.dictionary(pa.int32(), pa.utf8()) for k in texts}
    table = pa_csv.read_csv(
        pa.BufferReader(data),
        read_options=pa_csv.ReadOptions(column_names=[str(k) for k in range(width)]),
        parse_options=pa_csv.ParseOptions(delimiter=separator, ignore_empty_lines=width > 1),
        convert_options=pa_csv.ConvertOptions(
            include_columns=[*kinds], column_types=kinds, null_values=[*nulls], decimal_point=decimal
        ),
    )
    single = [table.column(name).combine_chunks() for name in kinds]
    single = [c.indices if pa.types.is_dictionary(c.type) else c for c in single]
    filled = (c.fill_null(0 if pa.types.is_integer(c.type) else np.nan) for c in single)
    # Arrow's own to_numpy imports pandas.
    return [np.asarray(np.from_dlpack(column)) for column in filled]


def _require_closed_quotes(file: str, data: bytes, body: int, rows: int) -> None:
    """Refuse a table whose quotes hide lines: an open one swallows all lines up to the next."""
    lines = re.split(rb"\r\n|\r|\n", data[body:])
    if rows == sum(bool(line.strip()) for line in lines):
        return
    above = _lines_above(data, body)
    number = next(
        (k for k, line in enumerate(lines, start=above + 1) if line.count(b'"') % 2), above + 1
    )
    raise row_error(
        (file, "line", number),
        "a quote is not closed on its line.",
        hint="Close or remove it.",
    )


def _text_lines(file: str, data: bytes, begin: int) -> Iterator[str]:
    """Yield lines from an offset, with only one line in memory."""
    stream = io.BytesIO(data)
    stream.seek(begin)
    text = io.TextIOWrapper(stream, encoding="utf-8-sig", errors="backslashreplace", newline="")
    for number, line in enumerate(iter(partial(text.readline, MAX_LINE), ""), start=1):
        if len(line) == MAX_LINE:
            raise row_error(
                (file, "line", _lines_above(data, begin) + number),
                f"longer than {MAX_LINE} characters: write one row per line.",
            )
        yield line


def _lines_above(data: bytes, offset: int) -> int:
    """Count the line ends before an offset."""
    both, one, other = (data.count(end, 0, offset) for end in (b"\r\n", b"\r", b"\n"))
    return one + other - both


def are_usable(columns: Sequence[Floats]) -> bool:
    """Whether every value is finite and the first column increases."""
    finite = all(np.isfinite(column).all() for column in columns)
    return finite and bool(np.all(columns[0][1:] > columns[0][:-1]))


Place: TypeAlias = tuple[str, Literal["line", "row"], int]
"""File, and number of a line of text or of a row of a Parquet table, from 1."""


def row_error(
    place: Place, fault: str, *, column: str | None = None, hint: str | None = None
) -> JointIdError:
    """Return the error for one row of a table."""
    file, unit, number = place
    where = f"{file}, {unit} {number}" + (f", column {column}" if column is not None else "")
    return JointIdError(f"{where}: {fault}", file=file, line=number, column=column, hint=hint)


def time_error(place: Place, time: float, previous: float, previous_number: int) -> JointIdError:
    """Return the error for a time that does not increase."""
    fault = "repeats" if time == previous else "goes back from"
    return row_error(
        place,
        f"{time:.12g} s {fault} {previous:.12g} s of {place[1]} {previous_number}.",
        column="time_s",
        hint="Times must increase: sort the rows, remove duplicates, and keep one experiment per file.",
    )


def unreadable(file: str, kind: str, error: object, *, line: int | None = None) -> JointIdError:
    """Return the error for a file that its reader refuses."""
    where = file if line is None else f"{file}, line {line}"
    message = " ".join(str(error).split())
    return JointIdError(
        f"{where} cannot be read as {kind} ({message:.200}): export the record again.", line=line
    )


def _explain_fault(
    file: str, data: bytes, header: Sequence[str], body: int, positions: Sequence[int]
) -> None:
    """Raise for the first row that a record cannot hold, in the order of the file."""
    body = _after_sound_rows(data, len(header), body, positions)
    above = _lines_above(data, body)
    rows = csv.reader(_text_lines(file, data, body))
    previous, previous_line, ended = -np.inf, 0, 0
    try:
        for row in rows:
            line, ended = above + ended + 1, rows.line_num  # a quote may stretch a row over many lines
            if not row:
                continue
            place: Place = (file, "line", line)
            if len(row) != len(header):
                semicolons = " It has semicolons: expected commas." if ";" in "".join(row) else ""
                raise row_error(
                    place,
                    f"{counted(len(row), 'value')}, but the header names "
                    f"{counted(len(header), 'column')}.{semicolons}",
                    hint="Repair or remove the line.",
                )
            values = [_number(place, header[k], row[k]) for k in positions]
            if values[0] <= previous:
                raise time_error(place, values[0], previous, previous_line)
            previous, previous_line = values[0], line
    except csv.Error as error:
        raise unreadable(file, "CSV", error, line=above + rows.line_num) from error


def _after_sound_rows(data: bytes, width: int, body: int, positions: Sequence[int]) -> int:
    """Return the offset of a row up to which all are sound; rows with quotes are not skipped."""
    while True:
        block = data[body : body + _BLOCK]
        block = block[: block.rfind(b"\n") + 1].rstrip()
        last = block.rfind(b"\n")
        if last < 0 or b'"' in block:
            return body
        try:
            sound = are_usable(parsed_columns(block, width, positions))
        except ARROW_FAULTS:
            return body
        if not sound:
            return body
        body += last + 1  # the last row is read again, for its time


def _number(place: Place, column: str, cell: str) -> float:
    text = cell.strip()
    if not text:
        raise row_error(
            place, "the value is missing.", column=column, hint="Fill it in or remove the line."
        )
    try:
        value = float(text) if text.isascii() and "_" not in text else None
    except ValueError:
        value = None
    if value is not None and np.isfinite(value):
        return value
    kind = "number" if value is None else "finite number"
    comma = " Write decimals with a point." if re.fullmatch(r"[-+]?\d*,\d+", text) else ""
    raise row_error(
        place,
        f'"{text:.60}" is not a {kind}.{comma}',
        column=column,
        hint="Repair the value or remove the line.",
    )
