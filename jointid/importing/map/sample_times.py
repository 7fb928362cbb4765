"""Increasing times from logged ones: duplicate rows, counter overflows, gaps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogTable
from jointid.importing.columns.units import SAMPLES, TIME_UNITS
from jointid.importing.map.mapping import TimeColumn
from jointid.wording import counted

Bools = NDArray[np.bool_]
GAP = 10.5
"""Pause in sample intervals above which a log is split."""
_MAX_REPEATED = 0.01  # share of rows that may repeat a time with other values
_DAY_S = 86400.0


def sample_times(
    table: LogTable, unit: TimeColumn, rows: np.ndarray, time: Floats, signals: Sequence[Floats]
) -> tuple[Floats, Bools, list[str]]:
    """Return strictly increasing times; notes name repairs and their rows.

    Parameters
    ----------
    table : LogTable
        For messages.
    unit : TimeColumn
    rows : ndarray of int, shape (N,)
        Index in the table of each value.
    time : ndarray, shape (N,)
        As in the file.
    signals : sequence of ndarray, shape (N,)
        All other columns in use: a copy agrees in all of them.

    Returns
    -------
    time_s : ndarray
    kept : ndarray of bool, shape (N,)
        Mask of the rows that the times belong to.
    notes : list of str

    Raises
    ------
    JointIdError
        When times decrease or repeat, and the order of the rows is ambiguous.
    """
    seconds = 1 / unit.rate_hz if unit.rate_hz else TIME_UNITS[unit.unit]
    notes: list[str] = []
    if unit.rate_hz:
        what = f'"{unit.column}" counts samples, taken' if unit.column else "The rows are numbered"
        notes.append(
            f"{what} at {unit.rate_hz:g} Hz; nothing in the log says this rate. If it is assumed, "
            "find it out: another rate scales the frequencies with it, and K with its square."
        )
    kept = np.ones(time.size, dtype=bool)
    if time.size > 1 and np.diff(time).min() <= 0:
        kept, time, said = _increasing(table, unit, rows, time, signals, seconds)
        notes.append(said)
    time = time[kept]
    notes += _gaps(table, unit, rows[kept], time, seconds)
    return (time - time[0]) * seconds, kept, notes


def _increasing(
    table: LogTable,
    unit: TimeColumn,
    rows: np.ndarray,
    time: Floats,
    signals: Sequence[Floats],
    seconds: float,
) -> tuple[Bools, Floats, str]:
    late = _late(time)
    copies = _copies(time, signals, late)
    if np.array_equal(copies, late):
        return ~late, time, _dropped_note(table, rows, late, f'written twice (column "{unit.column}")')
    unwrapped = _unwrapped(time, unit, seconds)
    if unwrapped is not None:
        return np.ones(time.size, dtype=bool), *_overflow_note(table, unit, rows, time, unwrapped)
    again = np.concatenate([[False], np.diff(time) == 0])
    if np.all(copies | again | ~late) and np.mean(late & ~copies) <= _MAX_REPEATED:
        said = f'that repeat the time of the row before (column "{unit.column}")'
        return ~late, time, _dropped_note(table, rows, late, said)
    raise _error(table, unit, rows, time, late & ~copies)


def _late(time: Floats) -> Bools:
    """Rows whose time is not after that of all earlier rows."""
    before = np.maximum.accumulate(time)
    return np.concatenate([[False], time[1:] <= before[:-1]])


def _copies(time: Floats, signals: Sequence[Floats], late: Bools) -> Bools:
    """Late rows that hold the same numbers as an earlier row of the same time."""
    first, again = np.flatnonzero(~late), np.flatnonzero(late)
    place = np.minimum(np.searchsorted(time[first], time[again]), first.size - 1)
    same = time[first[place]] == time[again]
    for signal in signals:
        same &= signal[first[place]] == signal[again]
    copies = np.zeros(time.size, dtype=bool)
    copies[again[same]] = True
    return copies


def _unwrapped(time: Floats, unit: TimeColumn, seconds: float) -> Floats | None:
    """Times of a counter or clock that overflows, continued; None for other steps back."""
    steps = np.diff(time)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    back = np.flatnonzero(steps <= 0)
    span = float(np.ptp(time))
    turns = [_DAY_S / seconds, 3600 / seconds, 60 / seconds] if unit.unit != SAMPLES else []
    if np.all(time == np.round(time)):
        turns = [2.0**8, 2.0**16, 2.0**32, *turns]
    for turn in turns:
        # Each step back is a usual step plus an overflow; the span stays below the overflow.
        if span < turn + 0.5 * usual and np.all(np.abs(steps[back] + turn - usual) <= 0.5 * usual):
            turned = np.zeros(time.size)
            turned[back + 1] = turn
            return np.asarray(time + np.cumsum(turned))
    return None


def _overflow_note(
    table: LogTable, unit: TimeColumn, rows: np.ndarray, time: Floats, unwrapped: Floats
) -> tuple[Floats, str]:
    back = np.flatnonzero(np.diff(time) <= 0) + 1
    turn = float(unwrapped[back[0]] - time[back[0]])
    return unwrapped, (
        f'"{unit.column}" begins anew {counted(back.size, "time")}, after each {_in_unit(turn, unit)}, '
        f"first at {table.row_word} {table.first_row + int(rows[back[0]])}: the times go on there."
    )


def _dropped_note(table: LogTable, rows: np.ndarray, late: Bools, why: str) -> str:
    at = rows[late] + table.first_row
    runs = np.split(at, np.flatnonzero(np.diff(at) != 1) + 1)
    said = [f"{run[0]} to {run[-1]}" if run.size > 1 else f"{run[0]}" for run in runs[:5]]
    more = f" and {len(runs) - 5} more places" if len(runs) > 5 else ""
    which = f"{table.row_word} {', '.join(said)}{more}"
    return f"{counted(at.size, 'row')} {why} left out: {which}."


def _gaps(
    table: LogTable, unit: TimeColumn, rows: np.ndarray, time: Floats, seconds: float
) -> list[str]:
    steps = np.diff(time)
    found = np.flatnonzero(steps > GAP * np.median(steps)) if steps.size else steps
    if not found.size:
        return []
    first = int(found[0])
    many = "A gap" if found.size == 1 else f"{found.size} gaps, the first"
    lasts = float(steps[first]) * seconds
    before = f"{table.row_word} {table.first_row + int(rows[first + 1])}"
    return [
        f"{many} of {lasts:.4g} s, before {before}: the time goes from "
        f"{time[first]:.12g} to {_in_unit(time[first + 1], unit)}. The log is split there; no run is "
        "taken across."
    ]


def _error(
    table: LogTable, unit: TimeColumn, rows: np.ndarray, time: Floats, wrong: Bools
) -> JointIdError:
    steps = np.diff(time)
    # The row at which a step back begins; the rows after it are late as well.
    at = int(np.flatnonzero(wrong)[0])
    value, before = float(time[at]), float(time[at - 1])
    fault = "repeats" if value == before else "goes back from"
    if value == before and np.mean(steps == 0) > 0.2:
        remedy = (
            "The clock is coarser than the samples: number the rows instead (no time column, unit "
            '"samples", with the sample rate).'
        )
    else:
        remedy = "Times must increase: choose another time column, or cut the log there."
    return JointIdError(
        f'{table.place(int(rows[at]))}, column "{unit.column}": {_in_unit(value, unit)} {fault} '
        f"{_in_unit(before, unit)}. {remedy}"
    )


def _in_unit(time: float, unit: TimeColumn) -> str:
    return f"{time:.12g}" if unit.unit == SAMPLES else f"{time:.12g} {unit.unit}"
