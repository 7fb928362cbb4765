"""Increasing times from logged ones, and one clock for signals with separate clocks."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogTable
from jointid.importing.columns.units import SAMPLES, TIME_UNITS
from jointid.importing.map.mapping import Mapping, TimeColumn
from jointid.importing.map.unwrap import unwrapped
from jointid.wording import counted, listed

Bools = NDArray[np.bool_]
GAP = 10.5
"""Pause in sample intervals above which a log is split."""
MAX_REPEATED = 0.01
"""Share of rows that may repeat a time with other values."""
_CLOCKS_S = (86400.0, 3600.0, 60.0)  # periods after which clocks restart


def sample_times(
    table: LogTable, unit: TimeColumn, rows: np.ndarray, time: Floats, signals: Sequence[Floats]
) -> tuple[Floats, Bools, list[str]]:
    """Return strictly increasing times in seconds, the mask of their rows, and notes on repairs.

    ``time`` is as in the file and ``rows`` the index of each value in the table; ``signals`` are all
    other columns in use, all of shape (N,): a copy of a row agrees in all of them. Raises JointIdError
    when times decrease or repeat, and the order of the rows is ambiguous.
    """
    notes: list[str] = []
    if unit.rate_hz:
        what = f'"{unit.column}" counts samples,' if unit.column else "The rows are numbered"
        notes.append(
            f"{what} at {unit.rate_hz:g} Hz; the log does not state this rate. Check it: frequencies "
            "scale with the rate, and K with its square."
        )
    kept = np.ones(time.size, dtype=bool)
    log = _LoggedTimes(table, unit, rows, time)
    if time.size > 1 and np.diff(time).min() <= 0:
        kept, time, said = log.increasing(signals)
        notes.append(said)
    time = time[kept]
    notes += replace(log, rows=rows[kept], time=time).gaps()
    return (time - time[0]) * log.seconds, kept, notes


@dataclass(frozen=True, eq=False)
class _LoggedTimes:
    """Times as in the file, with their place in it for messages."""

    table: LogTable
    unit: TimeColumn
    rows: np.ndarray
    time: Floats

    @property
    def seconds(self) -> float:
        """One unit of the times, s."""
        return 1 / self.unit.rate_hz if self.unit.rate_hz else TIME_UNITS[self.unit.unit]

    def increasing(self, signals: Sequence[Floats]) -> tuple[Bools, Floats, str]:
        """Rows to keep, times and a note; for copies, overflows and few repeated times."""
        time, column = self.time, self.unit.column
        # Rows whose time is not after that of all earlier rows.
        late = np.concatenate([[False], time[1:] <= np.maximum.accumulate(time)[:-1]])
        copies = _copies(time, signals, late)
        if np.array_equal(copies, late):
            return ~late, time, self._dropped(late, f'written twice (column "{column}")')
        unwrapped = self._unwrapped()
        if unwrapped is not None:
            back = np.flatnonzero(np.diff(time) <= 0) + 1
            turn = self._in_unit(float(unwrapped[back[0]] - time[back[0]]))
            return (
                np.ones(time.size, dtype=bool),
                unwrapped,
                (
                    f'"{column}" restarts {counted(back.size, "time")}, every {turn}, first at '
                    f"{self._row(back[0])}: the time continues there."
                ),
            )
        again = np.concatenate([[False], np.diff(time) == 0])
        if np.all(copies | again | ~late) and np.mean(late & ~copies) <= MAX_REPEATED:
            said = f'that repeat the time of the row before (column "{column}")'
            return ~late, time, self._dropped(late, said)
        raise self._error(int(np.flatnonzero(late & ~copies)[0]))

    def gaps(self) -> list[str]:
        """Note on the pauses at which the log is split, if there are any."""
        time, steps = self.time, np.diff(self.time)
        found = np.flatnonzero(steps > GAP * np.median(steps)) if steps.size else steps
        if not found.size:
            return []
        first = int(found[0])
        many = "A gap" if found.size == 1 else f"{found.size} gaps, the first"
        return [
            f"{many} of {float(steps[first]) * self.seconds:.4g} s, before {self._row(first + 1)}: the "
            f"time goes from {time[first]:.12g} to {self._in_unit(time[first + 1])}. The log is split "
            "there; no run crosses a gap."
        ]

    def _unwrapped(self) -> Floats | None:
        """Times of a counter or clock that overflows, continued; None for other steps back."""
        time, steps = self.time, np.diff(self.time)
        usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
        back = np.flatnonzero(steps <= 0)
        turns = [period / self.seconds for period in _CLOCKS_S] if self.unit.unit != SAMPLES else []
        if np.all(time == np.round(time)):
            turns = [2.0**8, 2.0**16, 2.0**32, *turns]
        for turn in turns:
            # Each step back is a usual step plus an overflow; the span stays below the overflow.
            near = np.abs(steps[back] + turn - usual) <= 0.5 * usual
            if float(np.ptp(time)) < turn + 0.5 * usual and np.all(near):
                turned = np.zeros(time.size)
                turned[back + 1] = turn
                return np.asarray(time + np.cumsum(turned))
        return None

    def _dropped(self, late: Bools, why: str) -> str:
        at = self.rows[late] + self.table.first_row
        runs = np.split(at, np.flatnonzero(np.diff(at) != 1) + 1)
        said = [f"{run[0]} to {run[-1]}" if run.size > 1 else f"{run[0]}" for run in runs[:5]]
        more = f" and {len(runs) - 5} more places" if len(runs) > 5 else ""
        which = f"{self.table.row_word} {', '.join(said)}{more}"
        return f"{counted(at.size, 'row')} {why} left out: {which}."

    def _error(self, at: int) -> JointIdError:
        """Error for the row at which a step back begins; later rows may also be late."""
        value, before = float(self.time[at]), float(self.time[at - 1])
        fault = "repeats" if value == before else "goes back from"
        remedy = "Times must increase: choose another time column, or cut the log there."
        if value == before and np.mean(np.diff(self.time) == 0) > 0.2:
            remedy = (
                "The clock is coarser than the samples: number the rows instead (no time column, unit "
                '"samples", with the sample rate).'
            )
        return JointIdError(
            f'{self.table.place(int(self.rows[at]))}, column "{self.unit.column}": '
            f"{self._in_unit(value)} {fault} {self._in_unit(before)}. {remedy}"
        )

    def _row(self, index: int) -> str:
        return f"{self.table.row_word} {self.table.first_row + int(self.rows[index])}"

    def _in_unit(self, time: float) -> str:
        unit = "" if self.unit.unit == SAMPLES else f" {self.unit.unit}"
        return f"{time:.12g}{unit}"


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


_FEWEST = 8
_TOGETHER = 0.5
"""Share of the slowest signal's samples with values of all signals, above which these share a clock."""
_LONGEST_STEP = 2.5  # step in usual steps of a signal, above which it is not interpolated


def on_one_clock(mapping: Mapping, time: Floats, signals: Sequence[Floats]) -> tuple[list[Floats], str]:
    """Interpolate signals (N,) at the times of the one with the fewest samples.

    More samples than the slowest signal has would repeat its noise and make errors look small. Signals
    are in the order of the mapping's columns, and NaN where they were not sampled. A held torque keeps
    its last value; all others follow a cubic spline, positions of single-turn encoders after
    unwrapping. Returns the signals, finite at the times of the slowest, or the given ones if they share
    a clock; and a sentence on the interpolation, "" without one.
    """
    known = [np.isfinite(time) & np.isfinite(signal) for signal in signals]
    if min(int(k.sum()) for k in known) < _FEWEST:
        return [*signals], ""
    start, stop = max(time[k].min() for k in known), min(time[k].max() for k in known)
    within = np.isfinite(time) & (time >= start) & (time <= stop)
    counts = [int((k & within).sum()) for k in known]
    slowest = int(np.argmin(counts))
    if np.all(known, axis=0).sum() >= _TOGETHER * counts[slowest] or counts[slowest] < _FEWEST:
        return [*signals], ""
    if any(np.any(np.diff(time[k]) <= 0) for k in known):
        return [*signals], ""
    at = time[known[slowest] & within]
    found, notes = [], []
    angles = [joint.position for joint in mapping.joints], [joint.arm for joint in mapping.joints]
    channels = [*angles[0], *[None] * mapping.n, *filter(None, angles[1])]
    for j, (channel, signal, rows) in enumerate(zip(channels, signals, known, strict=True)):
        values, held = signal[rows], channel is None and mapping.torque_hold
        if channel is not None:
            turned = unwrapped(values, channel)
            values = turned.values
            notes += [" " + turned.note(channel)] if turned.jumps.size else []
        full = np.full(time.size, np.nan)
        full[known[slowest] & within] = (
            values[within[rows]] if j == slowest else _values_at(at, time[rows], values, held)
        )
        found.append(full)
    names = [name for name in mapping.columns if name != mapping.time.column]
    others = [
        f'"{n}"' for n, k in zip(names, known, strict=True) if not np.array_equal(k, known[slowest])
    ]
    how = " (cubic; a held torque by its last value)" if mapping.torque_hold else " (cubic)"
    return found, (
        f"Signals have separate clocks. Interpolated{how} at the {at.size} times of the slowest, "
        f'"{names[slowest]}": {listed(others)}.{"".join(notes)}'
    )


def _values_at(at: Floats, time: Floats, values: Floats, held: bool) -> Floats:
    """Values of a signal at other times; NaN within a pause."""
    found = np.full(at.size, np.nan)
    steps = np.diff(time)
    pauses = np.flatnonzero(steps > _LONGEST_STEP * np.median(steps)) + 1
    for run in np.split(np.arange(time.size), pauses):
        own, values_own = time[run], values[run]
        target = slice(np.searchsorted(at, own[0]), np.searchsorted(at, own[-1], side="right"))
        if held:
            found[target] = values_own[np.searchsorted(own, at[target], side="right") - 1]
        elif run.size >= 4:
            # Damaged values of 1e300 have no slopes.
            with np.errstate(over="ignore", invalid="ignore"), suppress(ValueError):
                found[target] = CubicSpline(own, values_own)(at[target])
    found[~np.isfinite(found)] = np.nan
    return found
