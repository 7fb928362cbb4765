"""Which logs of one joint each were recorded at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import PurePosixPath

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.column_words import words_of
from jointid.importing.columns.log_table import LogTable
from jointid.importing.map.guess import guess_mapping
from jointid.importing.map.mapping import MAX_JOINTS

_LINES = {
    "joint": "axis axes achse axe asse eje ax joint jnt gelenk motor mot drive antrieb link j a m q",
    "run": "run runs rep repeat repetition trial test take messung versuch lauf pose set freq frequency",
}
_WORDS = {kind: frozenset(line.split()) for kind, line in _LINES.items()}
_SAME = 0.05
"""Times are the same when they differ by less than this share of the sample interval."""
_LENGTHS = 20
"""Times with more lengths of step than this, to a thousandth, jitter; those merely rounded have few."""
_ALIKE = 0.1
"""Share of a signal's size; what differs by less is the same run again."""
_OVERLAP = 0.5
"""Least share of the shorter log that both cover."""
_FAINT = 1e-3
"""Share of the largest power; a line with less is none."""


@dataclass(frozen=True, eq=False)
class JointLog:
    """A log of one joint."""

    index: int
    table: LogTable
    time_column: str
    time: Floats
    signals: tuple[Floats, Floats]
    """Position and torque."""
    joint: str
    """What the name says of the joint, as in "axis1"; "" when it says nothing."""
    rest: tuple[str, ...]
    """The other words of its name."""

    @property
    def interval(self) -> float:
        """Usual distance between samples, in the clock's unit."""
        return float(np.median(np.diff(self.time)))


def recorded_at_once(tables: Sequence[LogTable]) -> tuple[tuple[int, ...], ...]:
    """Find logs that look like joints recorded at once.

    Parameters
    ----------
    tables : sequence of LogTable

    Returns
    -------
    tuple of tuple of int
        Indices into ``tables``, two or more in each group. Those of a group have the same columns, a
        joint each, and the same times within a twentieth of the sample interval, where an absolute
        clock's need only overlap. Besides, one of these holds: their names count joints ("axis1",
        "axis2"); their clock is absolute or jitters alike; or they are all logs with these columns and
        hold the same sines at the same times, not one program run twice, and their names do not count
        runs. No two hold one signal value for value. Even times from 0
        alone say nothing: each of many single runs has them.
    """
    if len(tables) < 2:
        return ()
    parts = [part for index, table in enumerate(tables) if (part := joint_log(index, table)) is not None]
    groups: list[tuple[int, ...]] = []
    for signature in dict.fromkeys(part.table.signature for part in parts):
        alike = [part for part in parts if part.table.signature == signature]
        left, clusters = list(alike), []
        while left:
            first = left[0]
            clusters.append([p for p in left if p is first or rows_in_common(first, p) is not None])
            left = [part for part in left if not any(part is p for p in clusters[-1])]
        for cluster in clusters:
            groups += _at_once(cluster, len(cluster) == len(alike))
    return tuple(groups)


def joint_log(index: int, table: LogTable) -> JointLog | None:
    """Return the log, if it is one of a single joint on a clock that runs on."""
    try:
        mapping = guess_mapping(table).mapping
    except JointIdError:
        return None
    if mapping.n != 1 or table.rows < 2:
        return None
    column = mapping.time.column
    time = table.column(column).values if column else np.arange(table.rows, dtype=float)
    if not np.isfinite(time).all() or np.diff(time).min() <= 0:
        return None
    joint = mapping.joints[0]
    signals = (table.column(joint.position.column).values, table.column(joint.torque.column).values)
    name, rest = _joint_in(words_of(stem(table.name)))
    return JointLog(index, table, column, time, signals, name, rest)


def _joint_in(words: tuple[str, ...]) -> tuple[str, tuple[str, ...]]:
    for k, (word, number) in enumerate(pairwise(words)):
        if word in _WORDS["joint"] and number.isdigit() and words[k + 2 : k + 3] != ("hz",):
            return f"{word}{int(number)}", words[:k] + words[k + 2 :]
    return "", words


def _run_in(words: tuple[str, ...]) -> tuple[str, ...]:
    """What a name says of the run: "run 3", "5 Hz"."""
    return tuple(
        f"{one} {two}"
        for one, two in pairwise(words)
        if (one in _WORDS["run"] and two.isdigit()) or (one.isdigit() and two == "hz")
    )


def rows_in_common(a: JointLog, b: JointLog) -> tuple[slice, slice] | None:
    """Rows of two logs that have the same times, or None."""
    interval = a.interval
    near = _SAME * interval
    if a.time.size == b.time.size and np.abs(a.time - b.time).max() <= near:
        return slice(0, a.time.size), slice(0, b.time.size)
    if not (_is_absolute(a) and _is_absolute(b)):
        return None
    start, stop = max(a.time[0], b.time[0]) - near, min(a.time[-1], b.time[-1]) + near
    rows = [
        slice(int(np.searchsorted(p.time, start)), int(np.searchsorted(p.time, stop, side="right")))
        for p in (a, b)
    ]
    one, two = a.time[rows[0]], b.time[rows[1]]
    if one.size != two.size or one.size < _OVERLAP * min(a.time.size, b.time.size):
        return None
    return (rows[0], rows[1]) if one.size and np.abs(one - two).max() <= near else None


def _is_absolute(part: JointLog) -> bool:
    """Whether the clock ran long before the log: two of those agree only when recorded at once."""
    return bool(part.time_column) and float(part.time[0]) > 3 * float(np.ptp(part.time))


def _jitter_alike(a: JointLog, b: JointLog) -> bool:
    """Whether times stray from an even grid, the same way in both: no second recording repeats that."""
    steps = np.diff(a.time)
    apart = np.abs(a.time - b.time).max() if a.time.size == b.time.size else np.inf
    lengths = np.unique(np.round(steps / a.interval, 3))
    return bool(lengths.size > _LENGTHS and apart < 0.1 * np.std(steps))


def _at_once(cluster: Sequence[JointLog], is_all: bool) -> list[tuple[int, ...]]:
    """Groups of joints among logs with the same times."""
    if len(cluster) < 2 or _has_copies(cluster):
        return []
    if all(part.joint for part in cluster):
        groups = []
        for rest in dict.fromkeys(part.rest for part in cluster):
            group = [part for part in cluster if part.rest == rest]
            if 2 <= len(group) <= MAX_JOINTS and len({part.joint for part in group}) == len(group):
                groups.append(tuple(part.index for part in group))
        if groups or len({part.joint for part in cluster}) < len(cluster):
            return groups
    if len(cluster) > MAX_JOINTS:
        return []
    first = cluster[0]
    sure = all(_is_absolute(part) or _jitter_alike(first, part) for part in cluster)
    runs = {_run_in(part.rest) for part in cluster}
    likely = is_all and len(runs) == 1 and all(_same_sines(first, part) for part in cluster[1:])
    if any(_is_repeated(first, part) for part in cluster[1:]):
        return []
    return [tuple(part.index for part in cluster)] if sure or likely else []


def _has_copies(cluster: Sequence[JointLog]) -> bool:
    """Whether two logs hold one signal, value for value: two sensors never agree in their noise."""
    return any(
        x.shape == y.shape and np.array_equal(x, y, equal_nan=True) and np.nanmax(x) > np.nanmin(x)
        for k, a in enumerate(cluster)
        for b in cluster[:k]
        for x, y in zip(a.signals, b.signals, strict=True)
    )


def _is_repeated(a: JointLog, b: JointLog) -> bool:
    """Whether both signals run alike in size and course, as in one joint's program run twice.

    Of two tables of one file either is enough: they may be raw and filtered, or wanted and measured.
    """
    size = min(a.time.size, b.time.size)
    apart = []
    for x, y in zip(a.signals, b.signals, strict=True):
        one, two = x[:size] - np.nanmean(x[:size]), y[:size] - np.nanmean(y[:size])
        apart.append(float(np.nanstd(one - two)) / max(float(np.nanstd(one)), 1e-300))
    file, _, part = a.table.name.partition(": ")
    of_one_file = bool(part) and b.table.name.startswith(f"{file}: ")
    return (min if of_one_file else max)(apart) < _ALIKE


def _same_sines(a: JointLog, b: JointLog) -> bool:
    """Whether each log's strongest line is in the other, over all and in most parts of the log."""
    size = min(a.time.size, b.time.size)
    blocks = max(1, min(64, size // 256))
    for x, y in zip(a.signals, b.signals, strict=True):
        if not _share_line(_power(x[:size]), _power(y[:size])):
            continue
        shared = [
            _share_line(_power(one), _power(two))
            for one, two in zip(
                np.array_split(x[:size], blocks), np.array_split(y[:size], blocks), strict=True
            )
        ]
        if np.mean(shared) >= 0.5:
            return True
    return False


def _power(values: Floats) -> Floats:
    """Spectrum of the steps of a signal, over its largest."""
    steps = np.diff(np.where(np.isfinite(values), values, np.nanmean(values)))
    power = np.abs(np.fft.rfft((steps - steps.mean()) * np.hanning(steps.size))) ** 2
    return np.asarray(power / max(float(power.max()), 1e-300))


def _share_line(one: Floats, two: Floats) -> bool:
    at, other = int(one.argmax()), int(two.argmax())
    return bool(
        one[max(other - 1, 0) : other + 2].max() > _FAINT and two[max(at - 1, 0) : at + 2].max() > _FAINT
    )


def stem(name: str) -> str:
    """What tells a table from others: the file without its ending, or the part of the file."""
    file, _, part = name.partition(": ")
    return part or PurePosixPath(file.replace("\\", "/")).stem
