"""Long ("tidy") text tables: a row per signal or per joint, with its time and the name of either."""

import csv
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import TypeAlias

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.column_words import WORDS, words_of
from jointid.importing.columns.log_table import MAX_COLUMNS, LogTable, require_few_values
from jointid.importing.columns.units import split_unit, unit_of
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, file_text, text_of
from jointid.importing.read.text.clock_times import ClockCells, is_clock
from jointid.importing.read.text.layout import is_missing
from jointid.importing.read.text.numbers import is_number, number_in
from jointid.importing.read.text.tables import regular_columns
from jointid.wording import counted, listed

_LINES = {
    "name": "signal variable name channel topic key tag series measurement metric symbol kanal field id",
    "value": "value values wert val valeur valor valore data reading messwert",
    "unit": "unit units einheit",
}
_WORDS = {kind: frozenset(line.split()) for kind, line in _LINES.items()}
_JOINT = WORDS["joint"] | WORDS["motor"] | {"axes", "servo"}
_OF_JOINT = _JOINT | {"id", "no", "nr", "number", "index", "idx", "name"}


_MOST_KINDS = 1 << 22
"""Products of the numbers of different names of devices, joints and signals that are read fast."""


@dataclass(frozen=True)
class _Layout:
    first: int
    """Line of the first row."""
    separator: str
    decimal: str
    header: tuple[str, ...]
    time: int
    names: tuple[int, ...]
    """Columns that name the signal: device and joint, then signal."""
    values: tuple[int, ...]
    unit: int
    """Column of the unit; -1 without one."""
    clocked: bool
    """Whether the times are times of day or durations with their unit."""


_Found: TypeAlias = dict[str, tuple[Sequence[float] | Floats, Sequence[int] | np.ndarray, str]]
"""By name of a signal, its values, the rows of its times, and its unit."""
_Rows: TypeAlias = tuple[_Found, Floats, list[int]]
"""Signals, the times of all rows, and the lines of those that hold no numbers."""


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read a long table; every signal keeps its own times."""
    tables = long_tables(file, file_text(path))
    assert tables is not None  # recognised by it
    return tables


def long_tables(file: str, text: str) -> tuple[LogTable, ...] | None:
    """Tables of a text if it is a long table; else None."""
    lines = text.split("\n")
    layout = _layout("\n".join(lines[:40]))
    if layout is None:
        return None
    require_few_values(file, (1 + len(layout.values)) * len(lines))
    found, time_s, strange = _read_fast(layout, lines) or _read_slowly(file, layout, lines)
    notes = []
    if strange:
        notes.append(
            f"{counted(len(strange), 'row')} without a time or number left out; "
            f"the first is line {strange[0]}."
        )
    bare, unit = split_unit(layout.header[layout.time])
    signals = [
        Signal(name, time_s[np.asarray(places)], np.asarray(values), unit_of(unit))
        for name, (values, places, unit) in found.items()
    ]
    otherwise = f"{file} holds no rows with a time, a name and a number. Signals: {listed(found)}."
    times_as = bare or "time", "s" if layout.clocked else unit
    return tables_of_signals(file, signals, notes, times_as, otherwise)


def _read_fast(layout: _Layout, lines: list[str]) -> _Rows | None:
    """Read rows that are regular, of numbers and names; None if one is not."""
    body, numeric = lines[layout.first :], (layout.time, *layout.values)
    body = body[: len(body) - (body[-1:] == [""])]
    texts = [*layout.names, *[layout.unit] * (layout.unit >= 0)]
    data, width = "\n".join(body).encode("utf-8", "replace"), len(layout.header)
    if layout.clocked or not body:
        return None
    columns = regular_columns(data, width, numeric, layout.separator, layout.decimal, texts)
    if columns is None:
        return None
    time_s, *values = columns[: len(numeric)]
    if time_s.size != len(body) or not np.isfinite(time_s).all():
        return None
    values = [np.where(np.isfinite(each), each, np.nan) for each in values]
    used = np.flatnonzero(~np.isnan(values).all(axis=0))
    codes, kinds = np.zeros(time_s.size, np.int64), 1
    for each in columns[len(numeric) :][: len(layout.names)]:
        codes += kinds * each.astype(np.int64)
        kinds *= 1 + int(each.max())
        if kinds > _MOST_KINDS:
            return None
    counts = np.bincount(codes[used], minlength=kinds)
    if np.count_nonzero(counts) * len(values) >= MAX_COLUMNS:
        return None
    short = np.cumsum(counts > 0).astype(np.uint16) - 1  # numpy sorts short integers by their digits
    order = used[np.argsort(short[codes[used]], kind="stable")]
    of_group = np.split(order, np.cumsum(counts[counts > 0])[:-1])
    found: _Found = {}
    for rows in sorted(filter(len, of_group), key=lambda rows: int(rows[0])):
        row = next(csv.reader([body[rows[0]]], delimiter=layout.separator))
        cells = [cell.strip() for cell in row]
        for name, value in zip(_names(layout, cells), values, strict=True):
            if name[:200] in found:
                return None  # blanks around names, or very long ones
            unit = cells[layout.unit] if layout.unit >= 0 else ""
            found[name[:200]] = (value[rows], rows, unit)
    strange = np.flatnonzero(np.isnan(values).all(axis=0)) + layout.first + 1
    return found, time_s, strange.tolist()


def _read_slowly(file: str, layout: _Layout, lines: list[str]) -> _Rows:
    """Read row by row; rows without a time or number are left out."""
    found: dict[str, tuple[array[float], array[int], str]] = {}
    strange: list[int] = []
    clock = ClockCells()
    times: array[float] = array("d")
    rows = csv.reader(lines[layout.first :], delimiter=layout.separator)
    for number, row in enumerate(rows, start=layout.first + 1):
        if not any(row):
            continue
        cells = [cell.strip() for cell in row]
        if len(cells) <= max(layout.time, *layout.names, *layout.values):
            strange.append(number)
            continue
        time = cells[layout.time]
        stamp = clock.read(time) if layout.clocked else number_in(time, layout.decimal)
        times.append(np.nan if stamp is None else stamp)
        values = [number_in(cells[k], layout.decimal) for k in layout.values]
        if stamp is None or not any(value is not None for value in values):
            strange.append(number)
            continue
        unit = cells[layout.unit] if 0 <= layout.unit < len(cells) else ""
        for name, value in zip(_names(layout, cells), values, strict=True):
            kept, places, _ = found.setdefault(name[:200], (array("d"), array("q"), unit))
            places.append(len(times) - 1)
            kept.append(value if value is not None else np.nan)
        if len(found) >= MAX_COLUMNS:
            raise JointIdError(f"{file} names more than {MAX_COLUMNS} signals: log fewer of them.")
    time_s = np.array(times)
    return {**found}, clock.seconds(time_s) if layout.clocked else time_s, strange


def _names(layout: _Layout, cells: list[str]) -> list[str]:
    """Name of the signal in each column of values: "joint 1 position"."""
    parts = [f"{layout.header[k]} {cells[k]}" if cells[k].isdigit() else cells[k] for k in layout.names]
    several = [layout.header[k] for k in layout.values] if len(layout.values) > 1 else [""]
    return [" ".join([*parts, one]).strip() for one in several]


def _layout(head: str) -> _Layout | None:
    lines = head.split("\n")
    for separator in (";", "\t", ",", "|"):
        for at, line in enumerate(lines[:10]):
            header = tuple(cell.strip().strip('"') for cell in line.split(separator))
            if not 3 <= len(header) <= 24:
                continue
            try:
                rows = [
                    [cell.strip() for cell in row]
                    for row in islice(csv.reader(lines[at + 1 : -1], delimiter=separator), 30)
                    if len(row) == len(header)
                ]
            except csv.Error:
                continue
            for decimal in (".", ",") if separator != "," else (".",):
                layout = _described(at + 1, separator, decimal, header, rows)
                if layout is not None:
                    return layout
    return None


def _described(
    first: int, separator: str, decimal: str, header: tuple[str, ...], rows: list[list[str]]
) -> _Layout | None:
    """Layout of a long table, with a time, names and numbers; None for other rows."""
    words = [set(words_of(split_unit(cell)[0])) for cell in header]
    time, name, value, unit = (
        next((k for k, w in enumerate(words) if w & wanted and len(w) <= 2), -1)
        for wanted in (WORDS["time"], *_WORDS.values())
    )
    joints = [k for k, w in enumerate(words) if w & _JOINT and w <= _OF_JOINT and k != value]
    if time < 0 or not rows:
        return None
    if len({time, name, value}) == 3 and min(name, value) >= 0:
        names, values = [*(k for k in joints if k != name), name], [value]
        for k in range(len(header)):  # such as a device, whose signals have equal names
            once = len({(row[time], *(row[j] for j in names)) for row in rows}) == len(rows)
            if not once and k not in (time, value, unit, *names) and not is_number(rows[0][k], decimal):
                names.insert(0, k)
    else:
        name, names = -1, joints[:1]
        of_joint = {(row[time], *(row[k] for k in names)) for row in rows}
        if len({row[time] for row in rows}) == len(rows) or len(of_joint) < len(rows):
            return None  # a row per time, or several for a joint
        values = [k for k in range(len(header)) if k not in (time, *names)]
        values = [k for k in values if all(_is_value(row[k], decimal) for row in rows)]
    good = [
        (is_number(row[time], decimal) or is_clock(row[time]))
        and all(_is_value(row[k], decimal) for k in values)
        and (name < 0 or not is_number(row[name], decimal))
        for row in rows
    ]
    if not values or sum(good) < 0.8 * len(good):
        return None
    clocked = any(is_clock(row[time]) for row in rows)
    return _Layout(first, separator, decimal, header, time, tuple(names), tuple(values), unit, clocked)


def _is_value(cell: str, decimal: str) -> bool:
    return is_number(cell, decimal) or is_missing(cell)


def _recognises(head: bytes) -> bool:
    return b"\0" not in head[2:200:2] + head[3:200:2] and _layout(text_of(head)) is not None


READERS = {"tidy": Reader("a long table", _recognises, read)}
