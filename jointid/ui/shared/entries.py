"""Entries of forms, kept in the address, and how their text is read as numbers."""

import math
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import JointIdError
from jointid.study import INERTIA_STD
from jointid.wording import counted, plain

_SPACES = re.compile(r"[\s;]+")
_COMMAS = re.compile(r"[\s;,]+")
_INNER = re.compile(r"\d,\d")
_DECIMAL = re.compile(r"[+-]?\d+,\d+(e[+-]?\d+)?", re.IGNORECASE)
_SURELY = re.compile(r"[+-]?\d+,0\d+(e[+-]?\d+)?", re.IGNORECASE)


def numbers_in(name: str, text: str, *, count: int | None = None) -> tuple[float, ...]:
    """Read "43, 7.5", or "43 7,5" with decimal commas. A typographic minus counts.

    Numbers with decimal points are separated by commas, blanks or semicolons; with decimal commas, by
    blanks or semicolons only. ``name`` is that of the entry in messages. ``count`` numbers are expected;
    a single one then counts for all. Raises JointIdError when something is not a number, their count is
    wrong, or a comma can be read in two ways.
    """
    values = _unambiguous(name, _hyphens(text))
    if count is not None and len(values) == 1:
        values *= count
    if count is not None and len(values) != count:
        raise JointIdError(f"{name}: {len(values)} values for {counted(count, 'joint')}: give {count}.")
    return values


def matrix_in(name: str, text: str) -> list[tuple[float, ...]]:
    """Read "a, b; c, d" as rows; of two readings of the commas the square one is right.

    Raises JointIdError when something is not a number, a comma can be read in two ways, or the rows
    differ in length.
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
        f"{', '.join(said)}, or decimal commas with spaces between the numbers, 43,5 7,5."
    )


def _separated(name: str, text: str) -> tuple[float, ...]:
    return tuple(_number(name, piece) for piece in _COMMAS.split(text.strip()))


def _decimal(name: str, text: str) -> tuple[float, ...]:
    """Read commas within a piece as decimal ones."""
    pieces = (piece.strip(",") for piece in _SPACES.split(text.strip()))
    return tuple(_number(name, piece.replace(",", ".", 1)) for piece in pieces)


def _number(name: str, piece: str) -> float:
    try:
        value = float(piece)
        if math.isinf(value):
            raise ValueError(value)
        return value
    except ValueError:
        raise JointIdError(
            f'{name}: "{piece[:40]}" is not a number. Write decimal points, and commas between '
            "the numbers: 43, 7.5."
        ) from None


def numbers_out(values: Iterable[float]) -> str:
    """Write numbers as a list, "43, 7.5"."""
    return ", ".join(plain(float(value)) for value in values)


T = TypeVar("T")
Number = TypeVar("Number", int, float)

_NEGATIVE = re.compile(r"(?<!\w)-(?=\d)")
_WORDS = {"exact": 0.0, "unknown": math.inf}
_STATED = ("exact", "± 1 %", "± 2 %", "± 3 %", "± 5 %", "± 10 %", "± 30 %", "unknown")
_NOT_STATED = "not stated"
_INERTIA_HELP = (
    "Relative standard deviation of M and M2. The fit corrects M and M2 within it; unknown: start "
    "values only. Choose, or type a percentage."
)
_TORQUE_HELP = (
    "Relative standard deviation of each motor's torque constant. K and D are proportional to this "
    "constant; if not stated, they hold for an exact torque scale. Choose, or type a percentage."
)


def _kept(key: str) -> dict[str, Any]:
    """Arguments of a widget whose value outlives its page; the import keeps its own."""
    bind = None if key.startswith("import ") else "query-params"
    return {"key": key, "persist_state": "session", "bind": bind}


def enter_text(
    place: DeltaGenerator, key: str, label: str, value: str, help_: str = "", example: str = ""
) -> str:
    """Ask for a text."""
    hint = example_hint(example)
    text: str = place.text_input(label, value, help=help_ or None, placeholder=hint, **_kept(key))
    return text


def example_hint(example: str) -> str:
    """Write an example for an empty field so that it does not look entered."""
    return f"e.g. {_NEGATIVE.sub('−', example)}" if example else ""


def enter_number(
    place: DeltaGenerator,
    key: str,
    label: str,
    value: Number,
    limits: tuple[Number, Number],
    help_: str = "",
    *,
    disabled: bool = False,
) -> Number:
    """Ask for a number within limits. Raises JointIdError beyond them.

    The browser would keep the last valid number to itself, and the page would go on with it.
    """
    shown = "%d" if isinstance(value, int) else "%g"
    about: dict[str, Any] = {"format": shown, "help": help_ or None}
    ask: Callable[..., Number] = place.number_input
    entered = ask(label, None, None, value, disabled=disabled, **about, **_kept(key))
    low, high = limits
    if not low <= entered <= high:
        raise JointIdError(
            f"{label}: {plain(float(entered))} is not between {plain(float(low))} and "
            f"{plain(float(high))}."
        )
    return entered


def choose_from(
    place: DeltaGenerator,
    key: str,
    label: str,
    options: Sequence[str],
    format_func: Callable[[str], str] = str,
    help_: str = "",
    *,
    first: str | None = None,
    free: bool = False,
) -> str:
    """Ask for one of several options, at first ``first`` or the first one; ``free``: or any text."""
    index = 0 if first is None else options.index(first)
    about: dict[str, Any] = {"help": help_ or None, "accept_new_options": free}
    return str(place.selectbox(label, options, index, format_func, **about, **_kept(key)))


def applied(label: str, key: str, settings: T, *, at_first: bool = False) -> T | None:
    """Draw a button; return the settings, entered now, as they were when it was last clicked.

    ``at_first`` is whether they apply before the first click; otherwise None is returned until then.
    """
    kept = f"applied {key}"
    if st.button(label, type="primary", key=f"apply {key}") or (
        at_first and kept not in st.session_state
    ):
        st.session_state[kept] = settings
    found: T | None = st.session_state.get(kept)
    return found


def ask_inertia_std(place: DeltaGenerator, key: str) -> float:
    """Ask how well the inertias are known, a relative standard deviation.

    Raises JointIdError when the entry is no percentage.
    """
    label, usual = "How well M and M2 are known", deviation_text(INERTIA_STD)
    text = choose_from(place, key, label, _STATED, help_=_INERTIA_HELP, first=usual, free=True)
    return deviation_in(label, text)


def ask_torque_std(place: DeltaGenerator, key: str) -> float | None:
    """Ask how well the torque constants are known; None when not stated.

    Raises JointIdError when the entry is no percentage.
    """
    label = "How well the torque scale is known"
    text = choose_from(place, key, label, (_NOT_STATED, *_STATED), help_=_TORQUE_HELP, free=True)
    return None if text == _NOT_STATED else deviation_in(label, text)


def deviation_in(name: str, text: str) -> float:
    """Read "exact", "unknown" or a percentage such as "± 7 %" as a relative standard deviation.

    Raises JointIdError when it is none of these.
    """
    if text in _WORDS:
        return _WORDS[text]
    (percent,) = numbers_in(name, text.strip("±% ").replace(",", "."), count=1)
    if not percent >= 0:
        raise JointIdError(f"{name}, {text:.40}: give a percentage such as 5 %, exact or unknown.")
    if 0 < percent < 1 and "%" not in text:
        raise JointIdError(
            f"{name}, {text:.40}: write {plain(100 * percent)} % or {plain(percent)} %, with the sign."
        )
    return percent / 100


def deviation_text(std: float | None) -> str:
    """Write a relative standard deviation as the questions do."""
    words = {value: word for word, value in _WORDS.items()}
    return _NOT_STATED if std is None else words.get(std) or f"± {plain(100 * std)} %"
