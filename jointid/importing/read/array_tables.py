"""Named arrays of scientific files, grouped into tables of equal length."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from jointid.errors import JointIdError
from jointid.importing.columns.column_words import WORDS, words_of
from jointid.importing.columns.log_table import (
    MAX_COLUMNS,
    LogColumn,
    LogTable,
    most_first,
    named_column,
    require_few_values,
)
from jointid.importing.columns.units import TIME_UNITS
from jointid.importing.read.clocks import Signal, tables_of_signals

_JOINTS = WORDS["joint"] | WORDS["motor"]
_Grouped: TypeAlias = Mapping[tuple[str, int], Sequence[LogColumn]]
"""Columns by group and number of rows."""
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


def tables_of(file: str, arrays: Iterable[NamedArray], otherwise: str) -> tuple[LogTable, ...]:
    """Put arrays of equal length and group together; tables have two columns or more, the largest first.

    Pairs "q.Time" and "q.Data" of several lengths are signals with clocks of their own. Arrays that are
    not numeric, too short or three-dimensional are left out. Without a table, raises JointIdError with
    the message ``otherwise``.
    """
    given = [*arrays]
    signals = _timed_signals(given)
    if len({signal.values.size for signal in signals}) > 1:
        return tables_of_signals(file, signals, time=("time", ""))
    grouped: dict[tuple[str, int], list[LogColumn]] = {}
    held = 0
    for array in given:
        table = _as_columns(np.asarray(array.values))
        if table is None:
            continue
        held += table.size
        require_few_values(file, held)
        columns = grouped.setdefault((array.group, len(table)), [])
        for k in range(min(table.shape[1], MAX_COLUMNS)):
            label = array.labels[k] if k < len(array.labels) else ""
            number = 0 if label or table.shape[1] == 1 else k + 1
            columns.append(named_column(label or array.name, table[:, k], array.unit, number=number))
    found = []
    for (group, rows), own in _with_joints_joined(grouped).items():
        timed = [*_time_above(grouped, group, rows), *own]
        if 2 <= len(timed) <= MAX_COLUMNS:
            found.append(LogTable(f"{file}: {group}" if group else file, tuple(timed)))
    if not found:
        raise JointIdError(otherwise)
    return most_first(file, found)


def _timed_signals(arrays: Iterable[NamedArray]) -> list[Signal]:
    """Signals of structs with a field of times and one of values, such as MATLAB timeseries."""
    parts: dict[str, dict[str, NamedArray]] = {}
    for array in arrays:
        *path, field = re.split(r"[./]", f"{array.group}/{array.name}".removeprefix("/"))
        parts.setdefault(".".join(path), {})[field.lower()] = array
    found = []
    for stem, fields in parts.items():
        time, values = fields.get("time"), fields.get("data", fields.get("values"))
        if time is None or values is None:
            continue
        clock, table = (_as_columns(np.asarray(part.values)) for part in (time, values))
        if clock is None or table is None or clock.shape != (len(table), 1):
            continue
        for k, column in enumerate(table.T[:MAX_COLUMNS]):
            name = stem if table.shape[1] == 1 else f"{stem} {k + 1}"
            found.append(Signal(name, clock[:, 0].astype(float), column.astype(float), values.unit))
    return found


def _with_joints_joined(grouped: _Grouped) -> _Grouped:
    """Columns by group and rows, with the groups of several joints beside each other as one."""
    joined: dict[tuple[str, int], list[LogColumn]] = {}
    for (group, rows), columns in grouped.items():
        parent, _, own = group.rpartition("/")
        words = words_of(own)  # "joint_1"
        is_joint = _JOINTS & set(words) and any(map(str.isdigit, words))
        of_joint = is_joint and _time_above(grouped, group, rows)
        prefix, place = (f"{own} ", parent) if of_joint else ("", group)
        named = [replace(column, name=prefix + column.name) for column in columns]
        joined.setdefault((place, rows), []).extend(named)
    return joined


def _time_above(grouped: _Grouped, group: str, rows: int) -> list[LogColumn]:
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
