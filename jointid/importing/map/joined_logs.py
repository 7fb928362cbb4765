"""Join simultaneous logs of one joint each into one table."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogTable, main_tables
from jointid.importing.map.guess import guess_mapping
from jointid.importing.map.mapping import Mapping
from jointid.importing.map.simultaneous_logs import (
    JointLog,
    joint_log,
    rows_in_common,
    simultaneous_groups,
    stem,
)
from jointid.wording import listed


def joined_table(tables: Sequence[LogTable]) -> LogTable:
    """Join simultaneous logs: one time, and the other columns prefixed by the name of their log.

    Parameters
    ----------
    tables : sequence of LogTable
        A group of ``simultaneous_groups``.

    Returns
    -------
    LogTable
        Rows that all logs have in common. A note names the joined logs.

    Raises
    ------
    JointIdError
        When they have no times in common.
    """
    parts = [part for index, table in enumerate(tables) if (part := joint_log(index, table)) is not None]
    if len(parts) < len(tables) or len(parts) < 2:
        raise JointIdError("Only logs of one joint each, two or more, can be joined.")
    first = parts[0]
    common = []
    for part in parts:
        rows = rows_in_common(first, part)
        if rows is None:
            raise JointIdError(f"{first.table.name} and {part.table.name} have no times in common.")
        common.append(rows)
    start, stop = max(mine.start for mine, _ in common), min(mine.stop for mine, _ in common)
    offsets = [other.start - mine.start for mine, other in common]
    cuts = [slice(start + offset, stop + offset) for offset in offsets]
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
    """Return the logs of some files, with simultaneous ones joined.

    Parameters
    ----------
    files : sequence of sequence of LogTable
        The tables of each.
    mapping : Mapping, optional
        Mapping to be applied. If it names the columns of single logs, these are not joined.
    separate : bool, optional
        Join nothing.

    Returns
    -------
    tables : tuple of LogTable
        The main table of each file; each group's joined table in place of its first log.
    notes : tuple of str
        Simultaneous logs that were not joined because of the mapping.
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
                f"{listed(part.name for part in parts)} look like joints recorded at once, but the "
                "mapping names the columns of a single log: taken as runs of one joint. To join them, "
                "write the mapping anew with --guess from all of them."
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
    said = f"{listed(names)} have the same times and columns: joined as joints recorded at once."
    most = max(part.table.rows for part in parts)
    if rows < most:
        said += f" The {rows} rows that all have are used, of up to {most}."
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
    try:
        found = guess_mapping(table).mapping
    except JointIdError:
        return False
    return {(j.position.column, j.torque.column) for j in found.joints} == wanted


def _joined_name(names: Sequence[str]) -> str:
    """Name the joined log: "axis1+axis2.csv"."""
    stems = [stem(name) for name in names]
    if len(stems) > 3:
        stems = [*stems[:2], f"{len(stems) - 2} more"]
    return re.sub(re.escape(stem(names[0])) + r"(?=(\.\w+)?$)", lambda _: "+".join(stems), names[0])
