"""Unnamed columns: positions and torques by their roughness and order."""

import re
from collections.abc import Sequence

import numpy as np

from jointid.arrays import Floats
from jointid.importing.columns.column_words import states_quantity
from jointid.importing.columns.log_table import LogColumn, LogTable
from jointid.importing.columns.units import TIME_UNITS
from jointid.importing.map.guess_time import is_clock_like
from jointid.importing.map.mapping import MAX_JOINTS, TimeColumn
from jointid.importing.map.reasons import Reason

_NO_NAME = re.compile(
    r"(?:column|signal|unnamed|var|ch|channel|data)[ _:]*\d*(?: \(\d+\))?|\d+", re.IGNORECASE
)
_NUMBER = re.compile(r"[ _\[(]*\d+[\])]?$")
_CLEAR = 0.05  # difference in log-roughness per joint above which a layout is clear
_MAX_SAMPLES = 200_000  # of which the roughness is taken
_DERIVATIVE = 0.1
"""Relative difference below which a column is the derivative of another, in its own unit per second."""


def pairs_by_shape(
    table: LogTable, time: TimeColumn, columns: Sequence[LogColumn], reasons: list[Reason]
) -> list[tuple[LogColumn, LogColumn]]:
    """Pair 2n unnamed columns as n positions and n torques; add the reasons, none of which is certain.

    A position is a torque integrated twice, hence the smoother signal. Usual orders are all positions,
    then all torques, or joint by joint; either quantity may be first. Clocks, and columns that are the
    derivative of another, are left out. Three columns give one joint; other odd numbers, columns of
    another kind, and several joints with a torque as smooth as a position give none.
    """
    columns = [
        c for c in columns if np.nanmax(c.values) > np.nanmin(c.values) and not is_clock_like(c.values)
    ]
    columns = _without_velocities(table, time, columns)
    n = len(columns) // 2
    if not 0 < n <= MAX_JOINTS or any(c.unit for c in columns) or not _unnamed(columns):
        return []
    rough = np.log([_roughness(c.values) for c in columns])
    if len(columns) == 3:  # one joint, of the smoothest column and the roughest
        columns, rough = [columns[k] for k in np.argsort(rough)[[0, 2]]], np.sort(rough)[[0, 2]]
    elif len(columns) % 2:
        return []
    blocks = [(k, n + k) for k in range(n)]
    interleaved = [(2 * k, 2 * k + 1) for k in range(n)]
    layouts = [blocks, [(t, q) for q, t in blocks], interleaved, [(t, q) for q, t in interleaved]]
    gains = [float(sum(rough[t] - rough[q] for q, t in layout)) / n for layout in layouts]
    best = int(np.argmax(gains))
    if gains[best] < gains[0] + _CLEAR:
        best = 0  # the usual order
    at_q, at_t = np.array(layouts[best]).T
    if n > 1 and rough[at_q].max() > rough[at_t].min():
        return []  # further quantities, such as currents, are among them
    for number, (q, t) in enumerate(layouts[best], start=1):
        for role, k, how in (("position", q, "smoother"), ("torque", t, "rougher")):
            why = f"it is the {how} one" if gains[best] >= _CLEAR else "of its place"
            text = f'No column has a name; "{columns[k].name}" is only a proposal, because {why}. '
            reasons.append(Reason(f"{role} of joint {number}", text + "Check it in the figure."))
    return [(columns[q], columns[t]) for q, t in layouts[best]]


def _unnamed(columns: Sequence[LogColumn]) -> bool:
    """Whether names say nothing, or are those of one array: "log 1", "log 2" of a variable log."""
    stems = {_NUMBER.sub("", column.name) for column in columns}
    one = len(stems) == 1 and not states_quantity(columns[0])
    return one or all(_NO_NAME.fullmatch(column.name) for column in columns)


def _without_velocities(
    table: LogTable, time: TimeColumn, columns: Sequence[LogColumn]
) -> list[LogColumn]:
    if not time.column or time.unit not in TIME_UNITS or not 0 < len(columns) <= 3 * MAX_JOINTS:
        return [*columns]
    seconds = table.column(time.column).values[:_MAX_SAMPLES] * TIME_UNITS[time.unit]
    values = np.column_stack([column.values[: seconds.size] for column in columns])
    if seconds.size < 50 or np.any(np.diff(seconds) <= 0) or not np.isfinite(values).all():
        return [*columns]
    sizes = np.abs(values).max(axis=0)
    values = values / sizes  # squares of damage overflow
    slopes = np.gradient(values, seconds, axis=0)
    with np.errstate(all="ignore"):  # a slope of 0 or of infinite power explains nothing
        factors = slopes.T @ values / (slopes**2).sum(axis=0)[:, None]
        left = 1 - factors * (slopes.T @ values) / (values**2).sum(axis=0)
        of_slope = np.abs(factors * sizes / sizes[:, None] - 1) < _DERIVATIVE
        is_slope = (of_slope & (left < _DERIVATIVE**2) & ~np.eye(len(columns), dtype=bool)).any(axis=0)
    return [column for column, slope in zip(columns, is_slope, strict=True) if not slope]


def _roughness(values: Floats) -> float:
    """Standard deviation of the second differences over that of the values: large for noise."""
    finite = values[np.isfinite(values)][:_MAX_SAMPLES]
    if finite.size < 3 or not np.any(finite):
        return 1.0
    finite = finite / np.abs(finite).max()  # the squares of damaged numbers overflow
    size = float(np.std(finite))
    if size == 0:
        return 1.0
    return max(float(np.std(np.diff(finite, 2))) / size, 1e-300)
