"""Numbers in texts: decimal marks and thousands separators."""

import re
from collections.abc import Iterable
from functools import cache

from jointid.errors import JointIdError

THOUSANDS = {".": ",'’\u00a0\u202f ", ",": ".'’\u00a0\u202f "}
"""Possible thousands separators, by decimal mark."""

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?")
_LONGEST = 64


def is_number(cell: str, decimal: str, thousands: str = "") -> bool:
    """Whether a cell is a number; with "," as decimal mark, a point is not allowed.

    The ``thousands`` separator is allowed before each three digits: "1.234,5".
    """
    if len(cell) > _LONGEST:
        return False
    if thousands and thousands in cell:
        return _grouped(decimal, thousands).fullmatch(cell) is not None
    if decimal == ",":
        if "." in cell:
            return False
        cell = cell.replace(",", ".", 1)
    return cell.isascii() and _NUMBER.fullmatch(cell) is not None


def value_of(cell: str, decimal: str, thousands: str = "") -> float:
    """Return the value of a cell for which ``is_number`` holds."""
    plain = cell.replace(thousands, "") if thousands else cell
    return float(plain.replace(decimal, ".").replace("d", "e").replace("D", "e"))


def number_in(cell: str, decimal: str, thousands: str = "") -> float | None:
    """Return the value of a cell, None if it is no number."""
    return value_of(cell, decimal, thousands) if is_number(cell, decimal, thousands) else None


def number_or(text: str, default: float) -> float:
    """Return the value of a text with a point or a comma as decimal mark, else a default."""
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return default


def thousands_in(text: str, decimal: str, separator: str) -> list[str]:
    """Thousands separators that occur in a text."""
    return [
        mark
        for mark in THOUSANDS[decimal]
        if mark != separator and mark in text and _candidate(mark).search(text)
    ] + ([","] if decimal == "." and separator == "," and _QUOTED.search(text) else [])


def proven_thousands(text: str, decimal: str, separator: str) -> str:
    """Return the thousands separator proven by a number with both marks, else ""."""
    mark = "." if decimal == "," else ","
    if mark == separator or mark not in text:
        return ""
    return mark if re.search(rf"\d{re.escape(mark)}\d{{3}}{re.escape(decimal)}\d", text) else ""


def without_thousands(body: str, thousands: str) -> str | None:
    """Remove the separators from a text; None if one does not separate thousands."""
    mark = re.escape(thousands)
    if re.search(rf"{mark}(?!\d{{3}}(?!\d))|(?<!\d){mark}|\d{{4}}{mark}", body):
        return None
    return body.replace(thousands, "")


def marks_note(file: str, cells: Iterable[str], decimal: str, thousands: str) -> str:
    """Return a note on how marks in numbers of a table, or of a part of it, are read; or "".

    Raises JointIdError when a reading other than with ``decimal`` and ``thousands`` is possible.
    """
    other = "." if decimal == "," else ","
    marked = [cell for cell in cells if "," in cell or "." in cell or (thousands and thousands in cell)]
    grouped = [cell for cell in marked if thousands and thousands in cell]
    if grouped:
        proof = next((c for c in grouped if decimal in c or c.count(thousands) > 1), None)
        if proof is None and thousands == other:
            plain = next((cell for cell in marked if decimal in cell), "")
            raise JointIdError(
                f'{file}: "{grouped[0]}" may be {_both(grouped[0], thousands)}'
                + (f', because "{plain}" occurs as well' if plain else "")
                + ". Export without thousands separators, or with one decimal mark throughout."
            )
        shown, meant = proof or grouped[0], value_of(proof or grouped[0], decimal, thousands)
        name = "blank" if thousands.isspace() else thousands
        return (
            f'Numbers have thousands separators: "{shown}" is read as {meant:.15g} '
            f'(thousands: "{name}", decimals: "{decimal}").'
        )
    if not marked or not all(_candidate(decimal).fullmatch(cell.lstrip("+-")) for cell in marked):
        return ""
    # Every number with a mark has three digits after it, and none begins with 0.
    if decimal == ",":
        raise JointIdError(
            f'{file}: "{marked[0]}" may be {_both(marked[0], ",")}: each comma precedes three '
            "digits. Export with decimal points, or with another number of decimals."
        )
    return f'Points are read as decimal marks: "{marked[0]}" is not {marked[0].replace(".", "")}.'


def _both(cell: str, mark: str) -> str:
    return f"{cell.replace(mark, '.')} or {cell.replace(mark, '')}"


@cache
def _grouped(decimal: str, thousands: str) -> re.Pattern[str]:
    mark, point = re.escape(thousands), re.escape(decimal)
    return re.compile(rf"[-+]?[1-9]\d{{0,2}}(?:{mark}\d{{3}})+(?:{point}\d*)?(?:[eEdD][-+]?\d+)?")


@cache
def _candidate(mark: str) -> re.Pattern[str]:
    m = re.escape(mark)
    return re.compile(rf"(?<![\d.,])[1-9]\d{{0,2}}(?:{m}\d{{3}})+(?!\d)")


_QUOTED = re.compile(r'"[-+]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?"')
