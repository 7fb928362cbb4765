"""Find logs of one joint each that were recorded simultaneously, and join them into one table."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.column_words import words_of
from jointid.importing.columns.log_table import LogTable, log_path, main_tables
from jointid.importing.map.guess import guess_mapping
from jointid.importing.map.mapping import MAX_JOINTS, Mapping
from jointid.wording import listed

_LINES = {
    "joint": "axis axes achse axe asse eje ax joint jnt gelenk motor mot drive antrieb link j a m q",
    "run": "run runs rep repeat repetition trial test take messung versuch lauf pose set freq frequency",
}
_WORDS = {kind: frozenset(line.split()) for kind, line in _LINES.items()}
_SAME_TIME = 0.05  # share of the sample interval within which two times are equal
_REPEATED = 0.1  # difference of two signals over their size, below which they are repetitions of one run
_MIN_OVERLAP = 0.5  # least share of the shorter log that both cover
_MIN_POWER = 1e-3  # least power of a common line over the largest
_ABSOLUTE_START = 3.0  # start of an absolute clock, over the duration of the log, at least


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
    """The joint in the name, as in "axis1"; "" without one."""
    rest: tuple[str, ...]
    """The other words of its name."""


def simultaneous_groups(tables: Sequence[LogTable]) -> tuple[tuple[int, ...], ...]:
    """Find groups of logs that look like joints recorded simultaneously; indices, two or more in each.

    The logs of a group have the same columns, one joint each, and the same times within a twentieth of
    the sample interval; absolute clocks need only overlap. Besides, one of these holds: their names
    count joints ("axis1", "axis2"); their clocks are absolute; or they are all logs with
    these columns, hold the same sines at the same times without being repetitions of one program, and
    their names do not count runs. No two hold the same values. Even times from 0 alone are no evidence:
    every single run has them.
    """
    if len(tables) < 2:
        return ()
    parts = [part for index, table in enumerate(tables) if (part := joint_log(index, table)) is not None]
    groups: list[tuple[int, ...]] = []
    for signature in dict.fromkeys(part.table.signature for part in parts):
        alike = [part for part in parts if part.table.signature == signature]
        left = alike
        while left:
            cluster = [part for part in left if rows_in_common([left[0], part])]
            left = [part for part in left if part not in cluster]
            groups += _groups(cluster, len(cluster) == len(alike))
    return tuple(groups)


def joint_log(index: int, table: LogTable) -> JointLog | None:
    """Return the log if it has a single joint and increasing times."""
    mapping = guess_mapping(table).mapping
    if mapping.n != 1 or mapping.open_roles or table.rows < 2:
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
    """Parts of a name that state the run: "run 3", "5 Hz"."""
    return tuple(
        f"{one} {two}"
        for one, two in pairwise(words)
        if (one in _WORDS["run"] and two.isdigit()) or (one.isdigit() and two == "hz")
    )


def rows_in_common(parts: Sequence[JointLog]) -> list[slice]:
    """Rows of each log at the times common to all; empty if no times agree."""
    near = _SAME_TIME * float(np.median(np.diff(parts[0].time)))
    start, stop = max(p.time[0] for p in parts) - near, min(p.time[-1] for p in parts) + near
    rows = [slice(*np.searchsorted(part.time, [start, stop]).tolist()) for part in parts]
    times = [part.time[used] for part, used in zip(parts, rows, strict=True)]
    shortest = min(part.time.size for part in parts)
    whole = all(part.time.size == times[0].size for part in parts)
    if not whole and (times[0].size < _MIN_OVERLAP * shortest or not all(map(_is_absolute, parts))):
        return []
    same = (t.size == times[0].size > 0 and np.abs(t - times[0]).max() <= near for t in times)
    return rows if all(same) else []


def _is_absolute(part: JointLog) -> bool:
    """Whether the clock started long before the log: two such clocks agree only in simultaneous logs."""
    return bool(part.time_column) and float(part.time[0]) > _ABSOLUTE_START * float(np.ptp(part.time))


def _groups(cluster: Sequence[JointLog], is_all: bool) -> list[tuple[int, ...]]:
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
    sure = all(map(_is_absolute, cluster))
    runs = {_run_in(part.rest) for part in cluster}
    likely = is_all and len(runs) == 1 and all(_same_sines(first, part) for part in cluster[1:])
    if any(_is_repeated(first, part) for part in cluster[1:]):
        return []
    return [tuple(part.index for part in cluster)] if sure or likely else []


def _has_copies(cluster: Sequence[JointLog]) -> bool:
    """Whether two logs hold identical signals: two sensors never have the same noise."""
    return any(
        x.shape == y.shape and np.array_equal(x, y, equal_nan=True) and np.nanmax(x) > np.nanmin(x)
        for k, a in enumerate(cluster)
        for b in cluster[:k]
        for x, y in zip(a.signals, b.signals, strict=True)
    )


def _is_repeated(a: JointLog, b: JointLog) -> bool:
    """Whether both signals agree in size and shape, as when one joint repeats a program.

    For two tables of one file one signal is enough: they may be raw and filtered, or set and actual.
    """
    size = min(a.time.size, b.time.size)
    differences = []
    for x, y in zip(a.signals, b.signals, strict=True):
        one, two = x[:size] - np.nanmean(x[:size]), y[:size] - np.nanmean(y[:size])
        differences.append(float(np.nanstd(one - two)) / max(float(np.nanstd(one)), 1e-300))
    file, _, part = a.table.name.partition(": ")
    of_one_file = bool(part) and b.table.name.startswith(f"{file}: ")
    return (min if of_one_file else max)(differences) < _REPEATED


def _same_sines(a: JointLog, b: JointLog) -> bool:
    """Whether each log contains the strongest line of the other, overall and in most blocks."""
    size = min(a.time.size, b.time.size)
    blocks = max(1, min(64, size // 256))
    for x, y in zip(a.signals, b.signals, strict=True):
        if not _share_line(_power(x[:size]), _power(y[:size])):
            continue
        pairs = zip(*(np.array_split(v[:size], blocks) for v in (x, y)), strict=True)
        if np.mean([_share_line(_power(one), _power(two)) for one, two in pairs]) >= 0.5:
            return True
    return False


def _power(values: Floats) -> Floats:
    """Power spectrum of the differences of a signal, normalised to its largest line."""
    steps = np.diff(np.where(np.isfinite(values), values, np.nanmean(values)))
    power = np.abs(np.fft.rfft((steps - steps.mean()) * np.hanning(steps.size))) ** 2
    return np.asarray(power / max(float(power.max()), 1e-300))


def _share_line(one: Floats, two: Floats) -> bool:
    """Whether the strongest line of each spectrum is in the other as well."""
    return all(
        b[max(int(a.argmax()) - 1, 0) : int(a.argmax()) + 2].max() > _MIN_POWER
        for a, b in ((one, two), (two, one))
    )


def stem(name: str) -> str:
    """Return the short name of a table: the file without its ending, or the part of the file."""
    return name.partition(": ")[2] or log_path(name).stem


def joined_table(tables: Sequence[LogTable]) -> LogTable:
    """Join a group of ``simultaneous_groups``: one time, other columns prefixed by their log's name.

    Rows are those that all logs have in common; a note names the logs. Raises JointIdError when they
    have no times in common.
    """
    parts = [part for index, table in enumerate(tables) if (part := joint_log(index, table)) is not None]
    cuts = rows_in_common(parts)
    if not cuts:
        names = listed(part.table.name for part in parts)
        raise JointIdError(f"{names} have no times in common: do not join them.")
    named = [part.joint for part in parts]
    stems = [stem(part.table.name) for part in parts]
    for labels in (named if all(named) else stems, stems, [f"{k}" for k in range(1, len(parts) + 1)]):
        table = _table(parts, cuts, labels)
        if _is_guessed(table, parts, labels):
            break
    return table


def join_logs(
    files: Sequence[Sequence[LogTable]], mapping: Mapping | None = None, *, separate: bool = False
) -> tuple[tuple[LogTable, ...], tuple[str, ...]]:
    """Return the main table of each file, simultaneous ones joined, and notes on those that are not.

    Each group's joined table is in place of its first log. Logs whose columns ``mapping`` names one by
    one are not joined; with ``separate``, none are.
    """
    main = {id(table) for tables in files for table in main_tables(tables)}
    if separate:
        return tuple(table for tables in files for table in tables if id(table) in main), ()
    tables = [table for each in files for table in proposed_tables(each)]
    result: dict[int, LogTable] = dict(enumerate(tables))
    notes = []
    for group in simultaneous_groups(tables):
        parts = [tables[index] for index in group]
        if mapping is not None and set(mapping.columns) <= set(parts[0].names):
            notes.append(
                f"{listed(part.name for part in parts)} look like joints logged simultaneously, but "
                "the mapping describes a single log: they are treated as runs of one joint. To join "
                "them, write a new mapping with --guess and all these logs."
            )
            for index in group:
                if id(tables[index]) not in main:
                    del result[index]
            continue
        result[group[0]] = joined_table(parts)
        for index in group[1:]:
            del result[index]
    return tuple(result.values()), tuple(notes)


def proposed_tables(tables: Sequence[LogTable]) -> tuple[LogTable, ...]:
    """Return the main table of each file, and tables simultaneous with it."""
    main = {id(table) for table in main_tables(tables)}
    for group in simultaneous_groups(tables):
        if any(id(tables[index]) in main for index in group):
            main |= {id(tables[index]) for index in group}
    return tuple(table for table in tables if id(table) in main)


def _table(parts: Sequence[JointLog], cuts: Sequence[slice], labels: Sequence[str]) -> LogTable:
    first = parts[0]
    columns = []
    if first.time_column:
        time = first.table.column(first.time_column)
        columns.append(replace(time, values=time.values[cuts[0]]))
    for part, cut, label in zip(parts, cuts, labels, strict=True):
        columns += [
            replace(c, name=f"{label} {c.name}", values=c.values[cut])
            for c in part.table.columns
            if c.name != part.time_column
        ]
    names = [part.table.name for part in parts]
    rows = cuts[0].stop - cuts[0].start
    said = f"{listed(names)} have the same times and columns: joined as joints logged simultaneously."
    most = max(part.table.rows for part in parts)
    if rows < most:
        said += f" Of up to {most} rows, the {rows} common ones are used."
    notes = [f"{part.table.name}: {note}" for part in parts for note in part.table.notes]
    return replace(
        first.table,
        name=_joined_name(names),
        columns=tuple(columns),
        notes=(said, *notes),
        first_row=first.table.first_row + cuts[0].start,
    )


def _is_guessed(table: LogTable, parts: Sequence[JointLog], labels: Sequence[str]) -> bool:
    """Whether the guess for the joined table agrees with the guesses for the single logs."""
    joint = guess_mapping(parts[0].table).mapping.joints[0]
    wanted = {(f"{label} {joint.position.column}", f"{label} {joint.torque.column}") for label in labels}
    found = guess_mapping(table).mapping
    return {(j.position.column, j.torque.column) for j in found.joints} == wanted


def _joined_name(names: Sequence[str]) -> str:
    """Name the joined log: "axis1+axis2.csv"."""
    stems = [stem(name) for name in names]
    if len(stems) > 3:
        stems = [*stems[:2], f"{len(stems) - 2} more"]
    return re.sub(re.escape(stem(names[0])) + r"(?=(\.\w+)?$)", lambda _: "+".join(stems), names[0])
