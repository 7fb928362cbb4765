"""Layout of a text table: encoding, separator, decimal mark, header, units, first numbers."""

import codecs
import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from jointid.errors import JointIdError
from jointid.importing.columns.column_words import in_other_script
from jointid.importing.columns.units import split_unit, unit_of
from jointid.importing.read.text.clock_times import is_clock
from jointid.importing.read.text.numbers import is_number, marks_note, proven_thousands, thousands_in
from jointid.wording import listed

BLANKS = " "
"""Separator of columns with any number of blanks between them."""
NO_NUMBER = frozenset(
    {"nan", "inf", "-inf", "+inf", "-nan", "na", "n/a", "null", "none", "-", "--", "1.#qnan", "#n/a", ""}
)
"""Cells that denote a missing value, in lower case."""

_SAMPLED = 1 << 18  # characters examined at the beginning
_SAMPLED_LINES = 1000
_PROBED = 1 << 14  # characters examined in the middle and at the end
_SEPARATORS = (";", "\t", ",", "|", BLANKS)
_COMMENT = re.compile(r"^\s*(?:#+|%+|//+|;+(?=\s*[A-Za-z#])|\*+|!+|\"?#)\s*")

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


@dataclass(frozen=True)
class TextLayout:
    """Layout of a text table."""

    separator: str
    decimal: str
    names: tuple[str, ...]
    """Names of all columns without units; empty where the header has none."""
    units: tuple[str, ...]
    numeric: tuple[bool, ...]
    """Whether a column holds numbers."""
    clock: tuple[bool, ...]
    """Whether a column holds times of day or dates."""
    body: int
    """Offset of the first line of numbers in the text."""
    first_line: int
    """Number of that line; the first of the file is 1."""
    has_header: bool
    thousands: str = ""
    """Thousands separator, if any."""
    notes: tuple[str, ...] = ()


def decoded(file: str, data: bytes) -> str:
    """Decode a file: UTF-8, UTF-16 or UTF-32 by byte order mark or zero bytes, else Latin-1.

    Raises JointIdError when it is not text.
    """
    head = data[:4096]
    encoding = stated = stated_encoding(data)
    if not encoding and b"\0" in head:
        zeros = [head[k::2].count(0) / max(1, len(head[k::2])) for k in (0, 1)]
        encoding = "utf-16-le" if zeros[1] > 0.3 > zeros[0] else ""
        encoding = "utf-16-be" if zeros[0] > 0.3 > zeros[1] else encoding
        start = head[: len(head) // 2 * 2].decode(encoding, "replace") if encoding else ""
        if sum(c.isprintable() or c in "\r\n\t" for c in start) < 0.9 * max(1, len(start)):
            raise _no_text(file)
    try:
        text = data.decode(encoding or "utf-8")
    except UnicodeDecodeError as error:
        if encoding and not encoding.startswith("utf-8"):
            if not stated:
                raise _no_text(file) from error
            raise JointIdError(
                f"{file} begins as {encoding.upper()} text, but byte {error.start} is not: the file "
                "is damaged. Export it again."
            ) from error
        for other in ("cp932", "gb18030", "cp949", "cp1251"):
            head_of = data[:4096].decode(other, "ignore")
            if in_other_script(head_of):
                return unix_lines(data.decode(other, "replace"))
        # The usual encoding of Windows in western Europe; Latin-1 never fails.
        # Control characters of Latin-1 are printable in Windows' encoding.
        is_windows = any(byte in data for byte in (0x80, 0x85, 0x91, 0x92, 0x93, 0x94, 0x96, 0x97))
        text = data.decode("cp1252", errors="ignore") if is_windows else data.decode("latin-1")
    text = unix_lines(text.removeprefix("\ufeff"))
    if not text.strip():
        raise JointIdError(f"{file} holds only blank lines: export the log again.")
    return text


def stated_encoding(data: bytes) -> str:
    """Return the encoding that a byte order mark states, or ""."""
    return next((encoding for mark, encoding in _MARKS if data.startswith(mark)), "")


def unix_lines(text: str) -> str:
    r"""Return a text with ``\n`` at the end of every line, and hyphens for minus signs (U+2212).

    .NET writes the sign before negative numbers in Swedish, Norwegian and Finnish.
    """
    return text.replace("\r\n", "\n").replace("\r", "\n").replace("\N{MINUS SIGN}", "-")


def _no_text(file: str) -> JointIdError:
    return JointIdError(
        f"{file} is neither text nor a file of a known kind: CSV and other text "
        "tables, TwinCAT, CODESYS, LabVIEW, halscope, dSPACE, MDF, MATLAB, HDF5, Parquet, Arrow, NumPy, "
        "JSON, Excel, ROS bags, and a .zip of them. Export it as CSV."
    )


def find_layout(file: str, text: str) -> TextLayout:
    """Find the layout with which most cells of a text are numbers.

    Raises JointIdError when no separator gives at least two columns of numbers.
    """
    lines = _head_lines(file, text)
    probes: list[str] = []
    if len(text) >= 2 * _SAMPLED:
        for part in (text[len(text) // 2 :][:_PROBED], text[-_PROBED:]):
            probes += part.split("\n")[1:-1]
    best: tuple[float, float] = (0.0, 0.0)
    found: tuple[str, str, str, int, int] | None = None
    head = "\n".join(lines)
    for separator in _SEPARATORS:
        if separator != BLANKS and not any(separator in line for line in lines):
            continue
        cells = [split_line(line, separator) for line in (*lines, *probes)]
        has_comma = any("," in cell for row in cells for cell in row)
        for decimal, thousands in [
            (mark, group)
            for mark in (".", ",")
            for group in ("", *thousands_in(head, mark, separator))
            if has_comma or group or mark == "."
        ]:
            counts = [sum(is_number(cell, decimal, thousands) for cell in row) for row in cells]
            body = _body(cells[: len(lines)], counts[: len(lines)])
            if body is None:
                continue
            first, width = body
            told = [(row, n) for row, n in zip(cells[first:], counts[first:], strict=True) if row]
            table = [(row, n) for row, n in told if len(row) == width]
            numbers = sum(n for _, n in table)
            written = sum(bool(cell) for row, _ in table for cell in row)
            score = (round(len(table) / len(told) * numbers / max(written, 1), 3), numbers / len(table))
            if separator == BLANKS and found is not None and found[2].isspace():
                score = (score[0], 0.0)  # the blank separates thousands, not columns
            if score > best:
                best, found = score, (separator, decimal, thousands, first, width)
    if found is None:
        first_line = next((line for line in lines if line.strip()), "")
        raise JointIdError(
            f"{file} is not a table of numbers: expected columns separated by commas, semicolons, tabs "
            f"or spaces, at least two of them numbers. First line: {first_line[:80]!r}."
        )
    separator, decimal, thousands, first, width = found
    first += any(lines[first + 1 :]) and _is_numbering(split_line(lines[first], separator), width)
    thousands = thousands or proven_thousands(text, decimal, separator)
    layout = _described(lines, separator, decimal, thousands, first, width)
    rows = [row for row in (split_line(line, separator) for line in (*lines[first:], *probes)) if row]
    said = [
        cell
        for row in rows
        for cell, numeric in zip(row, layout.numeric, strict=False)
        if numeric and is_number(cell, decimal, thousands)
    ]
    note = marks_note(file, said, decimal, thousands)
    return replace(layout, notes=(*layout.notes, note) if note else layout.notes)


def split_line(line: str, separator: str) -> list[str]:
    """Cells of one line, without surrounding blanks and quotes; none for a blank line."""
    if not line.strip():
        return []
    if separator == BLANKS:
        return line.split()
    if '"' in line:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
        except csv.Error:
            pass
    return [cell.strip() for cell in line.split(separator)]


def is_missing(cell: str) -> bool:
    """Whether a cell denotes a missing value; Excel's errors begin with "#" in every language."""
    return cell.lower() in NO_NUMBER or cell.startswith("#")


def _head_lines(file: str, text: str) -> list[str]:
    head = text[:_SAMPLED]
    lines = head.split("\n")
    if len(text) > _SAMPLED:
        if len(lines) == 1:
            raise JointIdError(
                f"{file}: the first line is longer than {_SAMPLED} characters. Export one row per "
                "sample, each on a line of its own."
            )
        lines.pop()  # it may be cut
    return lines[:_SAMPLED_LINES]


def _body(cells: Sequence[list[str]], counts: Sequence[int]) -> tuple[int, int] | None:
    """First line of numbers, and the number of cells per line; ``counts`` are the numbers in each."""
    widths = Counter(len(row) for row, count in zip(cells, counts, strict=True) if count >= 2)
    if not widths:
        return None
    width = max(widths, key=lambda w: (widths[w], w))
    fits = [len(row) == width and count >= 2 for row, count in zip(cells, counts, strict=True)]
    written = [bool(row) for row in cells]
    for first, fit in enumerate(fits):
        if fit:
            following = [f for f, w in zip(fits[first : first + 6], written[first:], strict=False) if w]
            if sum(following) >= min(len(following), 5):
                return first, width
    return fits.index(True), width


def _is_numbering(cells: Sequence[str], width: int) -> bool:
    """Whether a line only numbers the columns from 0 or 1, as some programs do in place of names."""
    counts = [cell for cell in cells if cell]
    of_columns = [[str(k) for k in range(first, first + len(counts))] for first in (0, 1)]
    return counts in of_columns and len(counts) > max(2, width - 2)


def _described(
    lines: Sequence[str], separator: str, decimal: str, thousands: str, first: int, width: int
) -> TextLayout:
    rows = [row for row in (split_line(line, separator) for line in lines[first:]) if len(row) == width]
    numeric, clock = [], []
    for column in zip(*rows, strict=True):
        said = [cell for cell in column if not is_missing(cell)]
        right = sum(is_number(cell, decimal, thousands) for cell in said)
        numeric.append(2 * right > len(said))
        clock.append(bool(said) and all(is_clock(cell) for cell in said[:20]))
    header, units, unread = _header(lines[:first], separator, decimal, width)
    said = [line.strip() for line in unread if re.search(r"\w", line)]
    note = f"Lines above the table, not used: {listed(map(repr, said), at_most=3)}."
    split = [split_unit(name) for name in header] if header else [("", "")] * width
    said_units = [own or unit_of(below) for (_, own), below in zip(split, units, strict=True)]
    return TextLayout(
        separator=separator,
        decimal=decimal,
        names=tuple(bare for bare, _ in split),
        units=tuple(said_units),
        numeric=tuple(numeric),
        clock=tuple(clock),
        body=sum(len(line) + 1 for line in lines[:first]),
        first_line=first + 1,
        has_header=header is not None,
        thousands=thousands,
        notes=(note,) if said else (),
    )


def _header(
    above: Sequence[str], separator: str, decimal: str, width: int
) -> tuple[list[str] | None, list[str], list[str]]:
    """Names, units if they have a separate row, and other texts, from the lines above the numbers."""
    units = [""] * width
    written = [line for line in above if line.strip()]
    for place in reversed(range(max(0, len(written) - 4), len(written))):
        line, unread = written[place], written[:place]
        cells = _header_cells(line, separator, width)
        if cells is None or sum(is_number(cell, decimal) for cell in cells) > width / 2:
            return None, units, written[: place + 1]
        said = [cell for cell in cells if cell]
        if said and all(unit_of(cell) or cell in ("-", "[-]", "[]", "1") for cell in said):
            if unread:
                units = cells
                continue
            return cells, units, unread
        if len(said) > 2 and len(set(said)) == 1:  # a row of types: float;float;float
            continue
        return cells, units, unread
    return None, units, written


def _header_cells(line: str, separator: str, width: int) -> list[str] | None:
    """Cells of a header line, with empty cells added or removed to the width; None if that fails."""
    for candidate in (line, _COMMENT.sub("", line)):
        if separator == BLANKS:
            choices = [
                re.split(r"\t+|\s{2,}", candidate.strip()),
                re.sub(r" (?=[\[(])", "", " ".join(candidate.split())).split(),
                [cell.strip() for cell in re.split(r"[,;|]", candidate)],
            ]
        else:
            choices = [split_line(candidate, separator)]
        for cells in choices:
            while len(cells) > width and not cells[-1]:
                cells = cells[:-1]
            if len(cells) == width - 1 and width > 2:
                cells = [*cells, ""]  # every line of numbers ends with a separator
            if len(cells) == width:
                cells[0] = _COMMENT.sub("", cells[0])
                return cells
    return None
