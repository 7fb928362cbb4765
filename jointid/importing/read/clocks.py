"""Signals with times of their own, put into tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats
from jointid.importing.columns.log_table import (
    MAX_COLUMNS,
    MAX_VALUES,
    LogColumn,
    LogTable,
    most_first,
    numbers,
    require_few_values,
)
from jointid.importing.columns.units import split_unit, unit_of
from jointid.wording import counted

_SAME_S = 1e-9
"""Times that differ by less are equal."""


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
) -> tuple[LogTable, ...]:
    """Put signals into a table of all, and one for each clock if there are several.

    Parameters
    ----------
    file : str
        Name of the file, for messages.
    signals : sequence of Signal
        Those without a finite value are left out.
    notes : sequence of str, optional
        Notes for every table.
    time : tuple of str, optional
        Name and unit of the times; an empty unit where the file states none.

    Returns
    -------
    tuple of LogTable
        Time in seconds from the first sample of all. In a table of several clocks a signal is NaN at the
        times of the others; ``apply_mapping`` interpolates. May be empty.

    Raises
    ------
    JointIdError
        When there are too many values.
    """
    used = [s for s in signals if np.isfinite(s.time_s).any() and np.isfinite(s.values).any()]
    require_few_values(file, sum(s.values.size for s in used))
    if not used:
        return ()
    start = min(float(np.nanmin(s.time_s)) for s in used)
    clocks: dict[bytes, list[Signal]] = {}
    for signal in used:
        clocks.setdefault(np.round((signal.time_s - start) / _SAME_S).tobytes(), []).append(signal)
    groups = [group for group in clocks.values() if len(group) < MAX_COLUMNS]
    tables = []
    for number, group in enumerate(groups, start=1):
        name = file if len(groups) == 1 else f"{file}: clock {number}"
        tables.append(
            _table(name, group[0].time_s - start, group, [s.values for s in group], notes, time)
        )
    if len(groups) < 2:
        return tuple(tables)
    times = np.unique(np.concatenate([np.round((g[0].time_s - start) / _SAME_S) for g in groups]))
    times = times[np.isfinite(times)]
    count = sum(len(group) for group in groups)
    held = sum(table.rows * len(table.columns) for table in tables)
    if times.size * (count + 1) + held > MAX_VALUES or count >= MAX_COLUMNS:
        return most_first(file, tables)
    note = f"Its signals have {counted(len(groups), 'clock')}: each keeps its own times."
    columns, together = [], []
    for group in groups:
        ticks = np.round((group[0].time_s - start) / _SAME_S)
        known = np.isfinite(ticks)
        place = np.searchsorted(times, ticks[known])
        for signal in group:
            column = np.full(times.size, np.nan)
            column[place] = signal.values[known]
            columns.append(column)
            together.append(signal)
    return (
        _table(file, times * _SAME_S, together, columns, (*notes, note), time),
        *most_first(file, tables),
    )


def _table(
    name: str,
    time_s: Floats,
    signals: Sequence[Signal],
    values: Sequence[Floats],
    notes: Sequence[str],
    time: tuple[str, str],
) -> LogTable:
    columns = [LogColumn(time[0], numbers(time_s), time[1], time[0])]
    for signal, column in zip(signals, values, strict=True):
        bare, unit = split_unit(signal.name)
        columns.append(LogColumn(bare, numbers(column), unit_of(signal.unit) or unit, signal.name))
    return LogTable(name, tuple(columns), tuple(notes))
