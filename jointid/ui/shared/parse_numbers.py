"""Parsing of typed lists and tables of numbers."""

import re
from collections.abc import Iterable

from jointid import JointIdError
from jointid.wording import counted, plain

_SPACES = re.compile(r"[\s;]+")
_COMMAS = re.compile(r"[\s;,]+")
_INNER = re.compile(r"\d,\d")
_DECIMAL = re.compile(r"[+-]?\d+,\d+(e[+-]?\d+)?", re.IGNORECASE)
_SURELY = re.compile(r"[+-]?\d+,0\d+(e[+-]?\d+)?", re.IGNORECASE)


def numbers_in(name: str, text: str, *, count: int | None = None) -> tuple[float, ...]:
    """Read "43, 7.5", or "43 7,5" with decimal commas. A typographic minus counts.

    Parameters
    ----------
    name : str
        Name of the entry, for messages.
    text : str
        Numbers with decimal points, separated by commas, blanks or semicolons; or with decimal commas,
        separated by blanks or semicolons only.
    count : int, optional
        How many are expected; a single number then counts for all.

    Raises
    ------
    JointIdError
        When something is not a number, their count is wrong, or a comma can be read in two ways.
    """
    values = _unambiguous(name, _hyphens(text))
    if count is not None and len(values) == 1:
        values *= count
    if count is not None and len(values) != count:
        raise JointIdError(
            f"{name}: {len(values)} values for {counted(count, 'joint')}. Give one per joint."
        )
    return values


def matrix_in(name: str, text: str) -> list[tuple[float, ...]]:
    """Read "a, b; c, d" as rows; of two readings of the commas the square one is right.

    Raises
    ------
    JointIdError
        When something is not a number, a comma can be read in two ways, or the rows differ in length.
    """
    parts = _hyphens(text).strip().strip(";").split(";")
    for read in (_separated, _decimal):
        try:
            rows = [read(name, part) for part in parts]
        except JointIdError:
            continue
        if all(len(row) == len(parts) for row in rows):
            return rows
    try:
        rows = [_unambiguous(name, part) for part in parts]
    except JointIdError as error:
        raise JointIdError(f"{error} A semicolon separates the rows: 4.1, 0.4; 0.4, 1.9.") from None
    if len({len(row) for row in rows}) > 1:
        lengths = ", ".join(str(len(row)) for row in rows)
        raise JointIdError(
            f"{name}: its rows have {lengths} values. Give as many in every row as there are joints."
        )
    return rows


def _hyphens(text: str) -> str:
    """Return the text with typographic minus signs as ``float`` reads them."""
    return text.replace("\N{MINUS SIGN}", "-")


def _unambiguous(name: str, text: str) -> tuple[float, ...]:
    """Read a list whose commas have one meaning only."""
    pieces = _SPACES.split(text.strip())
    inner = [piece.strip(",") for piece in pieces if _INNER.search(piece)]
    decimal = [piece for piece in inner if _DECIMAL.fullmatch(piece)]
    if not decimal:
        return _separated(name, text)
    parted = any(piece.startswith(",") or piece.endswith(",") for piece in pieces)
    points = any("." in piece for piece in pieces)
    alone = len(pieces) == 1 and not _SURELY.fullmatch(pieces[0])
    if len(decimal) == len(inner) and not (parted or points or alone):
        return _decimal(name, text)
    readings = [_separated(name, text)]
    if len(decimal) == len(inner):
        readings.append(_decimal(name, text))
    said = [f"{value:g}" for value in readings[-1]]
    shown = " or ".join(
        f"{', '.join(f'{value:g}' for value in r)} ({counted(len(r), 'number')})" for r in readings
    )
    raise JointIdError(
        f'{name}: "{text.strip()[:60]}" can be read as {shown}. Write decimal points, '
        f"{', '.join(said)}, or decimal commas with blanks only between the numbers, 43,5 7,5."
    )


def _separated(name: str, text: str) -> tuple[float, ...]:
    """Read commas as separators."""
    return tuple(_number(name, piece) for piece in _COMMAS.split(text.strip()))


def _decimal(name: str, text: str) -> tuple[float, ...]:
    """Read commas within a piece as decimal ones."""
    pieces = (piece.strip(",") for piece in _SPACES.split(text.strip()))
    return tuple(_number(name, piece.replace(",", ".", 1)) for piece in pieces)


def _number(name: str, piece: str) -> float:
    try:
        return float(piece)
    except ValueError:
        raise JointIdError(
            f'{name}: "{piece[:40]}" is not a number. Write decimal points, and commas between '
            "the numbers: 43, 7.5."
        ) from None


def numbers_out(values: Iterable[float]) -> str:
    """Write numbers as a list, "43, 7.5"."""
    return ", ".join(plain(float(value)) for value in values)
