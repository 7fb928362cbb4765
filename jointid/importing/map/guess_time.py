"""Guess the time column of a log and its unit; a clear name permits a few steps back."""

import numpy as np

from jointid.arrays import Floats
from jointid.importing.columns.column_words import WORDS, states_quantity, words_of
from jointid.importing.columns.log_table import LogColumn, LogTable
from jointid.importing.columns.units import SAMPLES, TIME_UNITS, unit_of
from jointid.importing.map.mapping import TimeColumn
from jointid.importing.map.reasons import Reason
from jointid.importing.map.sample_times import MAX_REPEATED
from jointid.wording import counted

_MAX_LATE = 0.02  # share of steps back in a column named as time: a buffer written twice, an overflow
_LARGEST = 1e100  # larger values are damage; their differences overflow


def guess_time(table: LogTable, reasons: list[Reason]) -> TimeColumn:
    """Guess the time column of a log and its unit, or that the rows are numbered; add the reasons."""
    best: tuple[float, LogColumn, int] | None = None
    for place, column in enumerate(table.columns):
        if states_quantity(column):
            continue
        values = column.values[np.isfinite(column.values)]
        if np.abs(values).max(initial=0.0) > _LARGEST:
            continue
        late = _late_rows(values[:100_000], named=_says_time(column))
        if late is None or _is_coarse(table, column):
            continue
        words = words_of(column.name)
        score = 3.0 * bool(WORDS["time"] & set(words)) + 2.0 * (_time_unit(column) in TIME_UNITS)
        score += 1.0 * bool(WORDS["sample"] & set(words)) + 1.0 * (column.unit == SAMPLES)
        steps = np.diff(values[:100_000])
        even = np.ptp(steps) <= 0.5 * max(float(np.median(steps)), 1e-300)
        score -= 1.0 * bool(late)
        score += 0.5 * (place == 0) + 0.5 * bool(even) + 0.5 * is_clock_like(values)
        if score >= 0.5 and (best is None or score > best[0]):
            best = (score, column, late)
    if best is None:
        said = [column.name for column in table.columns if _says_time(column)]
        why = (
            f'The name of "{said[0]}" indicates time, but it does not increase from row to row'
            if said
            else "No column increases"
        )
        text = f"{why}: the rows are numbered. Give the sample rate; 1000 Hz is assumed."
        reasons.append(Reason("time", text))
        return TimeColumn("", SAMPLES, 1000.0)
    score, column, late = best
    named = score >= 2
    text = f'"{column.name}" increases' + (" and its name or unit indicates time." if named else ".")
    if late:
        text = (
            f'The name or unit of "{column.name}" indicates time, but it steps back '
            f"{counted(late, 'time')}. "
            "Duplicate rows are left out; rows of unclear order are an error."
        )
    reasons.append(Reason("time", text, named and not late))
    return _with_unit(column, reasons)


def _says_time(column: LogColumn) -> bool:
    return bool(WORDS["time"] & set(words_of(column.name))) or _time_unit(column) in TIME_UNITS


def _time_unit(column: LogColumn) -> str:
    """Unit that the file states, or a name that is just a unit: "ms"."""
    return column.unit or unit_of(column.name)


def _late_rows(values: Floats, *, named: bool) -> int | None:
    """Number of steps back; None if the column is not a time. Only one named as time may have any."""
    if values.size < 2:
        return None
    steps = np.diff(values)
    late, rises = int(np.sum(steps < 0)), int(np.sum(steps > 0))
    if late == 0:
        return 0 if rises else None
    return late if named and late <= _MAX_LATE * rises and 2 * rises >= steps.size else None


def _is_coarse(table: LogTable, column: LogColumn) -> bool:
    """Whether different rows share a time: the clock is too coarse to order them."""
    again = np.flatnonzero(np.diff(column.values) == 0)
    many = again.size > MAX_REPEATED * table.rows
    return many and any(np.diff(np.nan_to_num(c.values))[again].any() for c in table.columns)


def _with_unit(column: LogColumn, reasons: list[Reason]) -> TimeColumn:
    unit = _time_unit(column)
    if unit in TIME_UNITS:
        reasons.append(Reason("unit of time", f"Stated in the file: {unit}.", True))
        return TimeColumn(column.name, unit)
    values = column.values[np.isfinite(column.values)]
    steps = np.diff(values)
    step = float(np.median(steps[steps > 0]))
    counts = step == 1 and bool(np.all(values == np.round(values)))
    if column.unit == SAMPLES or (counts and not WORDS["time"] & set(words_of(column.name))):
        reasons.append(Reason("unit of time", "It counts samples: give the rate. 1000 Hz is assumed."))
        return TimeColumn(column.name, SAMPLES, 1000.0)
    # Controllers sample between about 20 Hz and 50 kHz: the step determines the unit.
    unit = next((u for u, below in (("s", 0.1), ("ms", 60.0), ("µs", 6e4)) if 0 < step <= below), "ns")
    sure = unit == "s" and 2e-5 <= step < 0.02  # above, milliseconds would be a usual rate as well
    rate_hz = 1 / (step * TIME_UNITS[unit])
    why = f'Its steps of {step:.3g} correspond to {rate_hz:.4g} Hz in "{unit}".'
    reasons.append(Reason("unit of time", why, sure))
    return TimeColumn(column.name, unit)


def is_clock_like(values: Floats) -> bool:
    """Whether values rise throughout a long log, or by one step and back, unlike a joint's position."""
    if values.size < 50:
        return False
    with np.errstate(over="ignore", invalid="ignore"):  # damaged values of 1e308
        steps = np.diff(values)
        usual = float(np.median(steps))
        even = np.mean(np.abs(steps - usual) <= 1e-3 * usual)
    return bool((np.all(steps >= 0) and steps.any()) or (usual > 0 and even >= 1 - _MAX_LATE))
