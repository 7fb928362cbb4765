"""Lists and tables of numbers as a person types them."""

from __future__ import annotations

import re
from collections.abc import Iterable

from jointid import JointIdError
from jointid.rounding import plain
from jointid.wording import counted


def numbers_in(name: str, text: str, *, count: int | None = None) -> tuple[float, ...]:
    """Read "43, 7.5".

    Parameters
    ----------
    name : str
        What it is, for messages.
    text : str
        Numbers separated by commas or blanks, with decimal points.
    count : int, optional
        How many are expected; a single number then counts for all.

    Raises
    ------
    JointIdError
        When something is not a number, or their count is wrong.
    """
    values = []
    for piece in re.split(r"[\s,]+", text.strip()):
        try:
            values.append(float(piece))
        except ValueError:
            raise JointIdError(
                f'{name}: "{piece[:40]}" is not a number. Write decimal points, and commas between '
                "the numbers: 43, 7.5."
            ) from None
    if count is not None and len(values) == 1:
        values *= count
    if count is not None and len(values) != count:
        raise JointIdError(
            f"{name}: {len(values)} values for {counted(count, 'joint')}. Give one per joint."
        )
    return tuple(values)


def matrix_in(name: str, text: str) -> list[tuple[float, ...]]:
    """Read "a, b; c, d" as rows.

    Raises
    ------
    JointIdError
        When something is not a number, or the rows differ in length.
    """
    rows = [numbers_in(name, row) for row in text.strip().strip(";").split(";")]
    if len({len(row) for row in rows}) > 1:
        lengths = ", ".join(str(len(row)) for row in rows)
        raise JointIdError(
            f"{name}: its rows have {lengths} values. Give as many in every row as there are joints."
        )
    return rows


def numbers_out(values: Iterable[float]) -> str:
    """Write numbers as a list, "43, 7.5"."""
    return ", ".join(plain(float(value)) for value in values)
