"""Bags of ROS 2 (SQLite or MCAP) and ROS 1: topics of type sensor_msgs/msg/JointState."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import (
    MAX_VALUES,
    LogColumn,
    LogTable,
    millions,
    most_first,
    numbers,
)
from jointid.importing.read.optional_imports import import_optional
from jointid.wording import listed

_JOINT_STATE = "sensor_msgs/msg/JointState"
_QUANTITIES = (("position", "rad"), ("velocity", "rad/s"), ("effort", "N·m"))
_MOST_JOINTS = 200


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the joint states of a ROS bag; one table per topic.

    Parameters
    ----------
    file : str
        Its name, for messages.
    path : str
        A .db3 or .mcap file, or the folder of a bag; a .bag file of ROS 1.

    Returns
    -------
    tuple of LogTable
        Columns "<joint> position", "<joint> effort" and so on, NaN where a message omits the joint.
        The time is the header's stamp, or the time of recording if no stamp is set.

    Raises
    ------
    JointIdError
        When rosbags is not installed, a file's name cannot be used, or there is no such topic.
    """
    _require_plain_names(file, Path(path))
    version = 1 if path.endswith(".bag") and Path(path).is_file() else 2
    rosbag = import_optional(f"rosbags.rosbag{version}", "rosbags", "ROS bags")
    typesys = import_optional("rosbags.typesys", "rosbags", "ROS bags")
    stores = typesys.Stores
    store = typesys.get_typestore(stores.ROS1_NOETIC if version == 1 else stores.LATEST)
    deserialize = store.deserialize_ros1 if version == 1 else store.deserialize_cdr
    with rosbag.Reader(Path(path)) as bag:
        wanted = [c for c in bag.connections if c.msgtype == _JOINT_STATE]
        if not wanted:
            topics = [f"{c.topic} ({c.msgtype})" for c in bag.connections]
            raise JointIdError(
                f"{file} has no topic of type {_JOINT_STATE}: record the joint states. "
                f"Topics found: {listed(topics)}."
            )
        logs: dict[str, _TopicLog] = {}
        for connection, recorded_ns, raw in bag.messages(connections=wanted):
            message = deserialize(raw, _JOINT_STATE)
            logs.setdefault(connection.topic, _TopicLog(file)).add(message, recorded_ns)
    if not logs:
        raise JointIdError(f"{file}: {wanted[0].topic} holds no messages: record the bag again.")
    return most_first(file, (log.table(f"{file}: {topic}") for topic, log in logs.items()))


def _require_plain_names(file: str, path: Path) -> None:
    """Refuse names that a URI reads as other names: rosbags opens SQLite databases by URI."""
    single = [path] if path.suffix == ".db3" else []
    for part in path.iterdir() if path.is_dir() else single:
        if set("%?#").intersection(part.name):
            raise JointIdError(
                f"{file}: the file name {part.name!r:.200} has one of the characters %, ? and #, which "
                "lead to another file when a ROS bag is opened: rename it, in metadata.yaml too."
            )


class _TopicLog:
    """Messages of one topic, gathered by joint."""

    def __init__(self, file: str) -> None:
        self._file = file
        self._stamps: list[int] = []
        self._recorded: list[int] = []
        self._columns: dict[tuple[str, str], int] = {}
        self._rows: list[tuple[Any, Floats]] = []
        self._layouts: dict[tuple[Any, ...], np.ndarray] = {}
        self._held = 0

    def add(self, message: Any, recorded_ns: int) -> None:
        stamp = message.header.stamp
        self._stamps.append(stamp.sec * 1_000_000_000 + stamp.nanosec)
        self._recorded.append(recorded_ns)
        parts = [np.asarray(getattr(message, quantity), float) for quantity, _ in _QUANTITIES]
        names = tuple(message.name)
        layout = (names, *(part.size for part in parts))
        if layout not in self._layouts:
            self._layouts[layout] = self._places(names, parts)
        values = np.concatenate([part[: len(names)] for part in parts])
        self._held += values.size
        if self._held > MAX_VALUES:
            raise JointIdError(
                f"{self._file} holds more than {millions(MAX_VALUES)} numbers: record a shorter bag."
            )
        self._rows.append((self._layouts[layout], values))

    def _places(self, names: tuple[str, ...], parts: list[Floats]) -> np.ndarray:
        if len(names) > _MOST_JOINTS:
            raise JointIdError(
                f"{self._file}: a message names {len(names)} joints, more than the limit of "
                f"{_MOST_JOINTS}: record the state of one robot."
            )
        if len(self._layouts) > _MOST_JOINTS:
            raise JointIdError(
                f"{self._file}: its messages name ever other joints, more than {_MOST_JOINTS} sets of "
                "them: record the state of one robot."
            )
        places = [
            self._columns.setdefault((name, quantity), len(self._columns))
            for part, (quantity, _) in zip(parts, _QUANTITIES, strict=True)
            for name in names[: part.size]
        ]
        return np.array(places, int)

    def table(self, name: str) -> LogTable:
        stamped = len(set(self._stamps)) > len(self._stamps) // 2
        ticks = np.array(self._stamps if stamped else self._recorded, dtype=np.int64)
        table = np.full((len(self._rows), len(self._columns)), np.nan)
        for row, (places, values) in zip(table, self._rows, strict=True):
            row[places] = values
        order = np.argsort(ticks, kind="stable")
        notes = []
        if not stamped:
            notes.append("The messages carry no time stamps: the time of recording is used.")
        if np.any(np.diff(ticks) < 0):
            notes.append("Some messages were recorded out of order; they were sorted by time.")
        units = dict(_QUANTITIES)
        columns = [LogColumn("time", numbers((ticks[order] - ticks[order[0]]) * 1e-9), "s", "stamp")]
        columns += [
            LogColumn(f"{joint} {quantity}", numbers(table[order, k]), units[quantity], quantity)
            for (joint, quantity), k in self._columns.items()
        ]
        return LogTable(name, tuple(columns), tuple(notes), 1, "message")
