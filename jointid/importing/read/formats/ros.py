"""Bags of ROS 2 (SQLite or MCAP) and ROS 1: joint states, and messages of numbers such as MultiArray."""

import re
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError, import_optional
from jointid.importing.columns.log_table import LogTable, most_first, require_few_values
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader, begins_with
from jointid.wording import listed

_JOINT_STATE = "sensor_msgs/msg/JointState"
_NUMBERS = re.compile(
    r"std_msgs/msg/(?:U?Int(?:8|16|32|64)|Float(?:32|64))(?:MultiArray)?"
    r"|geometry_msgs/msg/(?:Wrench|Vector3|Twist)(?:Stamped)?"
)
"""Types whose numbers may be positions or torques."""
_UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N·m"}
_MOST_NUMBERS = 600


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read joint states and other numbers of a ROS bag, a file or a ROS 2 folder; one table per topic.

    Columns are "<joint> position", "<joint> effort" and so on, NaN where a message omits the joint. The
    time is the header's stamp, or the time of recording if no stamp is set. Messages of numbers without
    names, such as Float64MultiArray, have a column for each field; in a bag with such messages the first
    table holds all topics at their times of recording, unless the joint states have efforts.
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
            seen = [f"{c.topic} ({c.msgtype})" for c in bag.connections]
            raise JointIdError(
                f"{file} has no topic of type {_JOINT_STATE}, and none of numbers: record "
                f"the joint states. Topics found: {listed(seen)}."
            )
        others = (c for c in bag.connections if c not in wanted)
        left_out = dict.fromkeys(f"{c.topic} ({c.msgtype})" for c in others)
        topics: dict[str, _Topic] = {}
        for connection, recorded_ns, raw in bag.messages(connections=wanted):
            message = deserialize(raw, connection.msgtype)
            of_joints = connection.msgtype == _JOINT_STATE
            topics.setdefault(connection.topic, _Topic(file, of_joints)).add(message, recorded_ns)
    alone = len(topics) == 1
    own = {name: topic for name, topic in topics.items() if topic.of_joints or alone}
    tables = (table for name, topic in own.items() for table in topic.tables(f"{file}: {name}"))
    states = together = most_first(file, tables)
    complete = any(name.endswith(" effort") for table in states for name in table.names)
    if len(own) < len(topics):
        start = min(min(topic.recorded) for topic in topics.values())
        signals = [
            s for name, topic in topics.items() for s in topic.signals(topic.recorded, start, name)
        ]
        note = "Topics are merged by their recording times."
        together = tables_of_signals(file, signals, (note,))
        first = () if complete else together[:1]
        together = (*first, *states, *together[len(first) :])
    if not together:
        raise JointIdError(f"{file}: {wanted[0].topic} holds no numbers: record the bag again.")
    if left_out and not complete:
        note = f"Topics of other types, left out: {listed(left_out, at_most=5)}."
        together = (replace(together[0], notes=(*together[0].notes, note)), *together[1:])
    return together


def _require_plain_names(file: str, path: Path) -> None:
    """Refuse names that a URI reads as other names: rosbags opens SQLite databases by URI."""
    single = [path] if path.suffix == ".db3" else []
    for part in path.iterdir() if path.is_dir() else single:
        if set("%?#").intersection(part.name):
            raise JointIdError(
                f"{file}: the file name {part.name!r:.200} contains %, ? or #, which "
                "ROS bags do not allow: rename it, also in metadata.yaml."
            )


class _Topic:
    """Messages of one topic: every number by name, with the messages that hold it."""

    def __init__(self, file: str, of_joints: bool) -> None:
        self.of_joints, self._file = of_joints, file
        self._stamps, self.recorded = array("q"), array("q")
        self._numbers: dict[str, tuple[array[int], array[float]]] = {}
        self._held = 0

    def add(self, message: Any, recorded_ns: int) -> None:
        for name, value in _joint_fields(message) if self.of_joints else _fields("", message):
            places, values = self._numbers.setdefault(name, (array("q"), array("d")))
            places.append(len(self.recorded))
            values.append(value)
            self._held += 1
            if len(self._numbers) > _MOST_NUMBERS:
                raise JointIdError(
                    f"{self._file}: its messages contain more than {_MOST_NUMBERS} numbers: record the "
                    "state of one robot."
                )
        require_few_values(self._file, self._held)
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        self._stamps.append(stamp.sec * 1_000_000_000 + stamp.nanosec if stamp is not None else 0)
        self.recorded.append(recorded_ns)

    def signals(self, ticks: Sequence[int], start_ns: int, topic: str = "") -> list[Signal]:
        """Every number at the times of its messages since a start, under the name of the topic."""
        time_s: Floats = np.asarray((np.array(ticks, dtype=np.int64) - start_ns) * 1e-9, np.float64)
        signals = []
        for name, (places, values) in self._numbers.items():
            order = np.argsort(own := time_s[places], kind="stable")
            unit = _UNITS[name.rpartition(" ")[2]] if self.of_joints else ""
            signals.append(Signal(f"{topic} {name}".strip(), own[order], np.array(values)[order], unit))
        return signals

    def tables(self, name: str) -> tuple[LogTable, ...]:
        stamped = len(set(self._stamps)) > len(self._stamps) // 2
        ticks = self._stamps if stamped else self.recorded
        notes = []
        if not stamped:
            notes.append("The messages carry no time stamps: the time of recording is used.")
        if any(b < a for a, b in pairwise(ticks)):
            notes.append("Some messages were recorded out of order; they were sorted by time.")
        return tables_of_signals(name, self.signals(ticks, min(ticks)), notes)


def _joint_fields(state: Any) -> Iterator[tuple[str, float]]:
    """Numbers of a joint state by joint and quantity: "elbow effort"."""
    for quantity in _UNITS:
        for joint, value in zip(state.name, getattr(state, quantity), strict=False):
            yield f"{joint} {quantity}", float(value)


def _fields(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """Numbers of a message by name: "data 3", "wrench.torque.z"; layouts and headers are left out."""
    if isinstance(value, int | float | np.number):
        yield name, float(value)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        for number, element in enumerate(value[:_MOST_NUMBERS], start=1):
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
