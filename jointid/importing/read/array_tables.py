"""Arrays of files put into tables: named arrays of equal length, or signals with times of their own."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.column_words import WORDS, words_of
from jointid.importing.columns.log_table import (
    MAX_COLUMNS,
    MAX_VALUES,
    LogColumn,
    LogTable,
    most_first,
    named_column,
    numbers,
    require_few_values,
)
from jointid.importing.columns.units import TIME_UNITS
from jointid.wording import counted

FEWEST_ROWS = 8
"""Shorter arrays are settings, not signals."""


@dataclass(frozen=True, eq=False)
class NamedArray:
    """One array of a file."""

    name: str
    """Name, with fields where nested: "log.axis1.position"."""
    values: Any
    """Numbers, shape (N,), (1, N), (N, m) or (1, m, N)."""
    unit: str = ""
    labels: tuple[str, ...] = ()
    """Names of the m columns, if the file has them."""
    group: str = ""
    """Arrays of different groups form different tables; only a time may come from a parent group."""


def tables_of(file: str, arrays: Iterable[NamedArray], otherwise: str = "") -> tuple[LogTable, ...]:
    """Put arrays of equal length and group together; tables have two columns or more, the largest first.

    Arrays that are not numeric, too short or three-dimensional are left out. Without a table, raises
    JointIdError with the message ``otherwise``, if it is given.
    """
    grouped: dict[tuple[str, int], list[LogColumn]] = {}
    held = 0
    for array in arrays:
        table = _as_columns(np.asarray(array.values))
        if table is None:
            continue
        held += table.size
        require_few_values(file, held)
        columns = grouped.setdefault((array.group, len(table)), [])
        for k in range(min(table.shape[1], MAX_COLUMNS)):
            label = array.labels[k] if k < len(array.labels) else ""
            number = 0 if label or table.shape[1] == 1 else k + 1
            column = named_column(label or array.name, table[:, k], array.unit, number=number)
            columns.append(replace(column, where=array.name))
    found = []
    for (group, rows), columns in grouped.items():
        columns = [*_time_above(grouped, group, rows), *columns]
        if 2 <= len(columns) <= MAX_COLUMNS:
            found.append(LogTable(f"{file}: {group}" if group else file, tuple(columns)))
    if otherwise and not found:
        raise JointIdError(otherwise)
    return most_first(file, found)


def _time_above(
    grouped: Mapping[tuple[str, int], Sequence[LogColumn]], group: str, rows: int
) -> list[LogColumn]:
    """Time column for a group without one, from the nearest parent group."""
    place = group
    while True:
        times = [
            c
            for c in grouped.get((place, rows), ())
            if (WORDS["time"] & set(words_of(c.name)) or c.unit in TIME_UNITS)
            and c.values[-1] > c.values[0]
        ]
        if times or not place:
            return [] if place == group else times[:1]
        place = place.rpartition("/")[0]


def _as_columns(values: np.ndarray) -> np.ndarray | None:
    """Array with one row per sample; None if it is not a signal."""
    if values.dtype.kind not in "biuf" or values.size < FEWEST_ROWS:
        return None
    if values.ndim == 3 and 1 in values.shape[:2]:
        values = values.reshape(-1, values.shape[2]).T  # Simulink's frames: (m, 1, N)
    elif values.ndim > 2 and max(values.shape) == values.size:
        values = values.reshape(-1)
    if values.ndim == 1:
        values = values[:, None]
    if values.ndim != 2:
        return None
    if values.shape[0] < FEWEST_ROWS or (values.shape[1] > MAX_COLUMNS >= values.shape[0]):
        values = values.T  # a row per signal
    return values if values.shape[0] >= FEWEST_ROWS else None


_SAME_S = 1e-9  # times that differ by less are equal


@dataclass(frozen=True, eq=False)
class Signal:
    """One signal of a file, with its times."""

    name: str
    time_s: Floats
    """Shape (N,), on a clock that all signals of the file share."""
    values: Floats
    """Shape (N,)."""
    unit: str = ""


def tables_of_signals(
    file: str,
    signals: Sequence[Signal],
    notes: Sequence[str] = (),
    time: tuple[str, str] = ("time", "s"),
    otherwise: str = "",
) -> tuple[LogTable, ...]:
    """Put signals into a table of all, and one for each clock if there are several.

    Signals without a finite value are left out. Time is in seconds from the first sample of all. In a
    table of several clocks a signal is NaN at the times of the others; ``apply_mapping`` interpolates.
    ``notes`` go to every table; ``time`` is the name and unit of the times, the unit "" where the file
    states none. Without a table, raises JointIdError with the message ``otherwise``, if it is given.
    """
    used = [s for s in signals if np.isfinite(s.time_s).any() and np.isfinite(s.values).any()]
    require_few_values(file, sum(s.values.size for s in used))
    if not used:
        if otherwise:
            raise JointIdError(otherwise)
        return ()
    start = min(float(np.nanmin(s.time_s)) for s in used)
    clocks: dict[bytes, list[Signal]] = {}
    for signal in (replace(s, time_s=s.time_s - start) for s in used):
        clocks.setdefault(_ticks(signal).tobytes(), []).append(signal)
    groups = [group for group in clocks.values() if len(group) < MAX_COLUMNS]
    if len(groups) < 2:
        return tuple(_table(file, group, notes, time) for group in groups)
    named = [(f"{file}: clock {k}", group) for k, group in enumerate(groups, start=1)]
    tables = [_table(name, group, notes, time) for name, group in named]
    times = np.unique(np.concatenate([_ticks(group[0]) for group in groups]))
    times = times[np.isfinite(times)]
    count = sum(len(group) for group in groups)
    held = sum(table.rows * len(table.columns) for table in tables)
    if times.size * (count + 1) + held > MAX_VALUES or count >= MAX_COLUMNS:
        return most_first(file, tables)
    together = []
    for signal in (signal for group in groups for signal in group):
        ticks, column = _ticks(signal), np.full(times.size, np.nan)
        known = np.isfinite(ticks)
        column[np.searchsorted(times, ticks[known])] = signal.values[known]
        together.append(replace(signal, time_s=times * _SAME_S, values=column))
    note = f"Its signals have {counted(len(groups), 'clock')}: each keeps its own times."
    return _table(file, together, (*notes, note), time), *most_first(file, tables)


def _ticks(signal: Signal) -> Floats:
    return np.asarray(np.round(signal.time_s / _SAME_S))


def _table(
    name: str, signals: Sequence[Signal], notes: Sequence[str], time: tuple[str, str]
) -> LogTable:
    """Table of signals with the same times."""
    columns = [LogColumn(time[0], numbers(signals[0].time_s), time[1], time[0])]
    columns += [named_column(s.name, s.values, s.unit) for s in signals]
    return LogTable(name, tuple(columns), tuple(notes))
