"""Signals with separate clocks, put into tables."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.column_words import WORDS, states_quantity, words_of
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

_SAME_S = 1e-9  # times that differ by less are equal
_ALIKE = 0.95  # ratio of the rows, and of the lengths, of two clocks that are alike

_SECOND = re.compile(r"[._ /]?s(?:ec(?:ond)?s?)?$", re.IGNORECASE)
_FRACTION = re.compile(rf"(.*?)[._ /]?(n|nano|u|micro)_?{_SECOND.pattern[6:]}", re.IGNORECASE)
"""Names of the whole and the fraction of a time: "stamp.sec" and "stamp.nanosec"."""


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
    """Put signals into one table, and one more for each clock if there are several.

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
    note = f"The signals have {counted(len(groups), 'clock')}; each keeps its own times."
    return _table(file, together, (*notes, note), time), *most_first(file, tables)


def with_whole_clock(table: LogTable) -> LogTable:
    """Join two columns of one clock, seconds and the fraction of a second: stamp.sec, stamp.nanosec."""
    for whole, part in pairwise(table.columns):
        found = _FRACTION.fullmatch(part.name)
        if found is None or _SECOND.sub("", whole.name) != found[1]:
            continue
        ticks = part.values * (1e-6 if found[2].lower() in ("u", "micro") else 1e-9)
        time_s = whole.values - whole.values[0] + ticks
        if np.all(ticks >= 0) and np.all(ticks < 1) and np.all(np.diff(time_s) >= 0):
            clock = named_column("time", time_s, "s")
            columns = (clock, *(c for c in table.columns if c not in (whole, part)))
            note = f'"{whole.name}" and "{part.name}" are one clock: joined as time.'
            return replace(table, columns=columns, notes=(*table.notes, note))
    return table


def with_own_clocks(table: LogTable) -> tuple[LogTable, ...]:
    """Give each signal the clock to its left, where a table holds several rates side by side."""
    clocks = [k for k, column in enumerate(table.columns) if _is_clock(column)]
    starts = [0, *(k for k, before in zip(clocks[1:], clocks, strict=False) if k > before + 1)]
    units = {table.columns[k].unit for k in starts}
    if clocks[:1] != [0] or len(starts) < 2 or starts[-1] + 1 == len(table.columns):
        return (table,)
    if len(units) > 1 and not units <= set(TIME_UNITS):
        return (table,)
    times = [table.columns[k].values * TIME_UNITS.get(table.columns[k].unit, 1.0) for k in starts]
    known = [time[np.isfinite(time)] for time in times]
    rows, lengths = zip(*((time.size, float(time[-1] - time[0])) for time in known), strict=True)
    if min(rows) > _ALIKE * max(rows) or min(lengths) < _ALIKE * max(lengths):
        return (table,)  # not several rates over one time: clocks of the same rows, or other units
    signals = [
        Signal(column.name, time[: clock.size], column.values[: clock.size], column.unit)
        for time, clock, (start, stop) in zip(
            times, known, pairwise([*starts, len(table.columns)]), strict=True
        )
        for column in table.columns[start + 1 : stop]
    ]
    unit = "s" if units <= set(TIME_UNITS) else units.pop()
    found = tables_of_signals(table.name, signals, table.notes, ("time", unit))
    return tuple(replace(part, source=table.source, read_as=table.read_as) for part in found) or (table,)


def _is_clock(column: LogColumn) -> bool:
    """Whether a column is named as a time and increases up to its last number."""
    if not WORDS["time"] & set(words_of(column.name)) or states_quantity(column):
        return False
    count = int(np.isfinite(column.values).sum())
    return count > 1 and bool(np.all(np.diff(column.values[:count]) > 0))


def _ticks(signal: Signal) -> Floats:
    return np.asarray(np.round(signal.time_s / _SAME_S))


def _table(
    name: str, signals: Sequence[Signal], notes: Sequence[str], time: tuple[str, str]
) -> LogTable:
    columns = [LogColumn(time[0], numbers(signals[0].time_s), time[1])]
    columns += [named_column(s.name, s.values, s.unit) for s in signals]
    return LogTable(name, tuple(columns), tuple(notes))
