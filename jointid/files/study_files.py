"""A study on disk: study.toml and its records, in a folder or the same folder zipped.

format = 1
name = "Waterjet cell, axes 1 and 2"
[inertia]
M  = [0.0025, 0.0010]
M2 = [[0.004104, 0.000395], [0.000395, 0.001889]]
[[records]]
file = "records/01.csv"
frequency_hz = 3.0

"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import pandas as pd

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.files.checked_toml import MAX_TOML_BYTES, CheckedTable, parse_toml
from jointid.files.container_limits import Container, missing, safe_name
from jointid.files.containers import Source, open_container
from jointid.files.record_tables import read_record_table
from jointid.files.study_keys import (
    INERTIA_KEYS,
    RECORD_KEYS,
    STUDY_KEYS,
    TIMING_KEYS,
    in_place,
    read_inertia,
    read_nominal,
    read_poses,
)
from jointid.files.study_parts import is_long, read_long_record
from jointid.files.study_saving import STUDY_FILE, pack_study, save_study
from jointid.files.table_preview import peek_table
from jointid.records import SineRecord
from jointid.study import Study
from jointid.wording import listed, nearest, shown

__all__ = ["PEEK_ROWS", "PeekedTable", "load_study", "pack_study", "peek_study", "save_study"]

PEEK_ROWS = 500
_PEEK_BYTES = 1 << 20


@dataclass(frozen=True, eq=False)
class PeekedTable:
    """The beginning of one table of a study, for the eye."""

    name: str
    """File name inside the study."""
    frame: pd.DataFrame
    """The first rows as they stand, or those around the one that is refused; the index is the line in
    the file, or the row. Empty when nothing could be read."""
    error: str = ""
    """Why nothing could be read, else empty."""
    refused: bool = False
    """Whether this is the file for which the study is refused."""
    refused_at: int | None = None
    """Line, or row, for which it is refused, when it is a single one."""


def load_study(path_or_file: Source) -> Study:
    """Read a study from a folder, or from the same folder zipped.

    Parameters
    ----------
    path_or_file : path, bytes or binary file
        The folder, the study.toml in it or a .zip by its path, or the zip as bytes or as an open
        binary file. In a zip, study.toml stands at the root or in the one folder that holds
        everything. Nothing is unpacked to disk. A Parquet record of more than 256 MiB in a folder
        is read in parts (``LongRecord``), whatever its size.

    Returns
    -------
    Study
        A record without a label carries its file's name.

    Raises
    ------
    JointIdError
        When anything in it cannot be used; the message names file, key or row, value and remedy.
    """
    with open_container(path_or_file, marker=STUDY_FILE) as container:
        top = parse_toml(STUDY_FILE, container.read(STUDY_FILE, at_most=MAX_TOML_BYTES + 1), STUDY_KEYS)
        _require_format_1(top)
        name, origin, description, robot = (
            top.text(key, "") for key in ("name", "origin", "description", "robot")
        )
        date = top.date("date") if "date" in top else None
        inertia = read_inertia(top.table("inertia", INERTIA_KEYS))
        poses, nominal = read_poses(top, inertia), read_nominal(top)
        timing = top.table("timing", TIMING_KEYS) if "timing" in top else None
        tables = top.tables("records", RECORD_KEYS)
        _require_different_files(tables)
        _require_files(tables, container)
        records = [_record(table, timing, container, inertia.n, tuple(poses)) for table in tables]
    with in_place(STUDY_FILE):
        return Study(tuple(records), inertia, nominal, name, origin, description, poses, robot, date)


def peek_study(path_or_file: Source) -> tuple[PeekedTable, ...]:
    """Return the beginning of every table in a study, also of one that ``load_study`` refuses.

    Parameters
    ----------
    path_or_file : path, bytes or binary file
        As for ``load_study``; study.toml may be missing or wrong.

    Returns
    -------
    tuple of PeekedTable
        One for each .csv or .parquet file, by name, with at most PEEK_ROWS rows.

    Raises
    ------
    JointIdError
        When the folder or archive itself cannot be read.
    """
    tables = []
    culprit, place = _refused_for(path_or_file)
    with open_container(path_or_file, marker=STUDY_FILE) as container:
        for name in container.names():
            at = place if name == culprit else None
            is_csv = name.lower().endswith(".csv")
            if not (is_csv or name.lower().endswith(".parquet")):
                continue
            try:
                data = container.read(name, at_most=_PEEK_BYTES if is_csv and at is None else None)
                if is_csv and len(data) == _PEEK_BYTES:
                    data = data[: data.rfind(b"\n") + 1] or data  # the last line may be cut
                frame, error = peek_table(name, data, PEEK_ROWS, around=at or 0), ""
            except JointIdError as fault:
                frame, error = pd.DataFrame(), str(fault)
            tables.append(PeekedTable(name, frame, error, name == culprit, at))
    return tuple(tables)


def _refused_for(source: Source) -> tuple[str, int | None]:
    """Name of the table for which a study is refused, and the line or row; "" when it is none."""
    try:
        load_study(source)
    except JointIdError as error:
        message = re.split(r" Files found:| Did you mean", str(error))[0]
        with open_container(source, marker=STUDY_FILE) as container:
            named = [name for name in container.names() if name in message and name != STUDY_FILE]
        if not named:
            return "", None
        first = min(named, key=lambda name: (message.index(name), -len(name)))
        place = re.match(r", (?:line|row) (\d{1,9})\b", message[message.index(first) + len(first) :])
        return first, int(place[1]) if place else None
    return "", None


def _require_format_1(top: CheckedTable) -> None:
    with suppress(JointIdError):  # what it is instead is said below
        if top.number("format") == 1:
            return
    version = top.integer("format")
    if version != 1:
        raise JointIdError(
            f"{STUDY_FILE}: format = {shown(version)}, but this version reads format 1. "
            "Update jointid, or write format = 1 if the file follows it."
        )


def _require_different_files(tables: Sequence[CheckedTable]) -> None:
    seen: dict[str, str] = {}
    for table in tables:
        file = _record_file(table)
        if file in seen:
            raise JointIdError(
                f"{table.where}: {file} is also the file of {seen[file]}. Give each record its own file."
            )
        seen[file] = table.where


def _require_files(tables: Sequence[CheckedTable], container: Container) -> None:
    """Refuse a file that is not there, with the most similar that no record has."""
    files = [_record_file(table) for table in tables]
    there = set(container.names())
    for file in files:
        if file not in there:
            try:
                container.read(file, at_most=1)  # its spelling may be another of a name that is there
            except JointIdError as error:
                if "is missing in" not in str(error):
                    raise
                raise missing(file, container, taken=[STUDY_FILE, *files]) from None


def _record_file(table: CheckedTable) -> str:
    file = table.text("file")
    with in_place(table.where):
        return safe_name(file)


def _record(
    table: CheckedTable,
    timing: CheckedTable | None,
    container: Container,
    joints: int,
    poses: tuple[str, ...],
) -> SineRecord:
    file = _record_file(table)
    frequency = table.number("frequency_hz")
    start = table.number("start_s") if "start_s" in table else None
    pose = table.text("pose") if "pose" in table else None
    label = table.text("label", PurePosixPath(file).name)
    hold = timing.flag("torque_hold", False) if timing else False
    delay = timing.number("torque_delay_s", 0.0) if timing else 0.0
    hold, delay = table.flag("torque_hold", hold), table.number("torque_delay_s", delay)
    if pose is not None and pose not in poses:
        raise JointIdError(
            f'{table.where} ({file}): pose "{pose:.60}" is not defined.{nearest(pose, poses)} '
            f"Known poses: {listed(poses)}."
        )
    known: dict[str, Any] = {
        "frequency_hz": frequency,
        "torque_hold": hold,
        "torque_delay_s": delay,
        "start_s": start,
        "pose": pose,
        "label": label,
    }
    path = container.path(file)
    if path is not None and is_long(file, path, joints):
        with in_place(file):
            return read_long_record(file, path, joints, **known)
    columns = read_record_table(file, container.read(file), joints)
    try:
        return SineRecord(
            time_s=columns.time_s, theta_rad=columns.theta_rad, tau_Nm=columns.tau_Nm, **known
        )
    except JointIdError as error:
        raise JointIdError(f"{file}: {error}{_other_time_unit(frequency, columns.time_s)}") from error


def _other_time_unit(frequency_hz: float, time: Floats) -> str:
    """Suggest the unit in which the times would fit, when in seconds they cannot."""
    span = float(time[-1] - time[0])
    if time.size < 2 or frequency_hz * span < 0.5 * (time.size - 1):
        return ""
    for unit, per_second in (("milliseconds", 1e3), ("microseconds", 1e6)):
        rate, periods = (time.size - 1) / span * per_second, frequency_hz * span / per_second
        if frequency_hz < 0.5 * rate and periods >= 1:
            return (
                f" If time_s is in {unit}, the record has {rate:.4g} samples per second and "
                f"{periods:.4g} periods of {frequency_hz:g} Hz: divide time_s by {per_second:.0f}."
            )
    return ""
