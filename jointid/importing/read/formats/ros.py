"""Bags of ROS 2 (SQLite or MCAP) and ROS 1: joint states, and messages of numbers such as MultiArray."""

import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import (
    LogColumn,
    LogTable,
    most_first,
    numbers,
    require_few_values,
)
from jointid.importing.read.array_tables import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, begins_with, import_optional
from jointid.wording import listed

_JOINT_STATE = "sensor_msgs/msg/JointState"
_NUMBERS = re.compile(
    r"std_msgs/msg/(?:U?Int(?:8|16|32|64)|Float(?:32|64))(?:MultiArray)?"
    r"|geometry_msgs/msg/(?:Wrench|Vector3|Twist)(?:Stamped)?"
)
"""Types whose numbers may be positions or torques."""
_QUANTITIES = (("position", "rad"), ("velocity", "rad/s"), ("effort", "N·m"))
_MOST_JOINTS = 200


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read joint states and other numbers of a ROS bag, a file or a ROS 2 folder; one table per topic.

    Columns are "<joint> position", "<joint> effort" and so on, NaN where a message omits the joint. The
    time is the header's stamp, or the time of recording if no stamp is set. Messages of numbers without
    names, such as Float64MultiArray, have a column for each field; with them, the first table holds all
    topics at their times of recording, unless the joint states have efforts.
    """
    _require_plain_names(file, Path(path))
    version = 1 if path.endswith(".bag") and Path(path).is_file() else 2
    rosbag = import_optional(f"rosbags.rosbag{version}", "rosbags", "ROS bags")
    typesys = import_optional("rosbags.typesys", "rosbags", "ROS bags")
    stores = typesys.Stores
    store = typesys.get_typestore(stores.ROS1_NOETIC if version == 1 else stores.LATEST)
    deserialize = store.deserialize_ros1 if version == 1 else store.deserialize_cdr
    with rosbag.Reader(Path(path)) as bag:
        wanted = [
            c for c in bag.connections if c.msgtype == _JOINT_STATE or _NUMBERS.fullmatch(c.msgtype)
        ]
        if not wanted:
            topics = [f"{c.topic} ({c.msgtype})" for c in bag.connections]
            raise JointIdError(
                f"{file} has no topic of type {_JOINT_STATE}, and none of numbers: record "
                f"the joint states. Topics found: {listed(topics)}."
            )
        logs: dict[str, _TopicLog] = {}
        for connection, recorded_ns, raw in bag.messages(connections=wanted):
            message = deserialize(raw, connection.msgtype)
            of_joints = connection.msgtype == _JOINT_STATE
            logs.setdefault(connection.topic, _TopicLog(file, of_joints)).add(message, recorded_ns)
    if not logs:
        raise JointIdError(f"{file}: {wanted[0].topic} holds no messages: record the bag again.")
    alone = len(logs) == 1
    tables = (log.table(f"{file}: {topic}") for topic, log in logs.items() if log.of_joints or alone)
    states = most_first(file, tables)
    if len(states) == len(logs):
        return states
    start = min(min(log.recorded) for log in logs.values())
    signals = [signal for topic, log in logs.items() for signal in log.signals(topic, start)]
    note = "Topics are merged by their times of recording."
    together = tables_of_signals(file, signals, (note,))
    complete = any(column.where == "effort" for table in states for column in table.columns)
    return (*states, *together) if complete else (*together[:1], *states, *together[1:])


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
    """Messages of one topic: joint states gathered by joint, others with a column for each number."""

    def __init__(self, file: str, of_joints: bool) -> None:
        self.of_joints = of_joints
        self._file = file
        self._stamps: list[int] = []
        self.recorded: list[int] = []
        self._columns: dict[tuple[str, str], int] = {}
        self._rows: list[tuple[np.ndarray, Floats]] = []
        self._layouts: dict[tuple[Any, ...], np.ndarray] = {}
        self._held = 0

    def add(self, message: Any, recorded_ns: int) -> None:
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        self._stamps.append(stamp.sec * 1_000_000_000 + stamp.nanosec if stamp is not None else 0)
        self.recorded.append(recorded_ns)
        if self.of_joints:
            names = tuple(message.name)
            parts = [np.asarray(getattr(message, quantity), float) for quantity, _ in _QUANTITIES]
            values = np.concatenate([part[: len(names)] for part in parts])
            layout: tuple[Any, ...] = (names, *(part.size for part in parts))
        else:
            found = dict(_fields("", message))
            names = layout = tuple(found)
            values = np.array([*found.values()], float)
        if layout not in self._layouts:
            if max(len(names), len(self._layouts)) > _MOST_JOINTS:
                raise JointIdError(
                    f"{self._file}: its messages name more than {_MOST_JOINTS} joints, or different "
                    "sets of joints: record the state of one robot."
                )
            columns = [("", name) for name in names]
            if self.of_joints:
                sizes = zip(_QUANTITIES, layout[1:], strict=True)
                columns = [(name, quantity) for (quantity, _), size in sizes for name in names[:size]]
            places = [self._columns.setdefault(column, len(self._columns)) for column in columns]
            self._layouts[layout] = np.array(places, int)
        self._held += values.size
        require_few_values(self._file, self._held)
        self._rows.append((self._layouts[layout], values))

    def signals(self, topic: str, start_ns: int) -> list[Signal]:
        """Every column with its times of recording since a start, under the name of the topic."""
        time = np.array(self.recorded, dtype=np.int64) - start_ns
        order = np.argsort(time, kind="stable")
        time_s = np.asarray(time[order] * 1e-9, np.float64)
        return [
            Signal(f"{topic} {name}", time_s[known], column[known], unit)
            for name, _, unit, column in self._named(order)
            if (known := np.isfinite(column)).any()
        ]

    def _named(self, order: np.ndarray) -> Iterator[tuple[str, str, str, Floats]]:
        """Name, quantity, unit and values of every column, rows in some order."""
        table, units = np.full((len(self._rows), len(self._columns)), np.nan), dict(_QUANTITIES)
        for row, (places, values) in zip(table, self._rows, strict=True):
            row[places] = values
        for (joint, quantity), column in zip(self._columns, table[order].T, strict=True):
            yield f"{joint} {quantity}".strip(), quantity, units.get(quantity, ""), column

    def table(self, name: str) -> LogTable:
        stamped = len(set(self._stamps)) > len(self._stamps) // 2
        ticks = np.array(self._stamps if stamped else self.recorded, dtype=np.int64)
        order = np.argsort(ticks, kind="stable")
        notes = []
        if not stamped:
            notes.append("The messages carry no time stamps: the time of recording is used.")
        if np.any(np.diff(ticks) < 0):
            notes.append("Some messages were recorded out of order; they were sorted by time.")
        columns = [LogColumn("time", numbers((ticks[order] - ticks[order[0]]) * 1e-9), "s", "stamp")]
        columns += [
            LogColumn(name, numbers(column), unit, quantity)
            for name, quantity, unit, column in self._named(order)
        ]
        return LogTable(name, tuple(columns), tuple(notes), 1, "message")


def _fields(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """Numbers of a message by name: "data 3", "wrench.torque.z"; layouts and headers are left out."""
    if isinstance(value, int | float | np.number):
        yield name, float(value)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        for number, element in enumerate(value[:_MOST_JOINTS], start=1):
            yield f"{name} {number}", float(element)
    elif is_dataclass(value):
        for field in fields(value):
            if not field.name.startswith("_") and field.name not in ("header", "layout"):
                yield from _fields(f"{name}.{field.name}".strip("."), getattr(value, field.name))


READERS = {
    "db3": Reader("a ROS 2 bag", begins_with(b"SQLite format 3\0"), read, ("db3",)),
    "mcap": Reader("MCAP", begins_with(b"\x89MCAP0\r\n"), read, ("mcap",)),
    "bag": Reader("a ROS 1 bag", begins_with(b"#ROSBAG V"), read, ("bag",)),
}
