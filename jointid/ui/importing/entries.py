"""Every entry of a mapping as a widget, with the reasons of the guess."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Mapping as MappingType
from typing import TypeVar

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import JointIdError
from jointid.importing import Channel, Guess, JointMapping, LogTable, Mapping, TimeColumn
from jointid.importing.columns.units import (
    ANGLE_UNITS,
    POSITION_SCALES,
    SAMPLES,
    TIME_UNITS,
    TORQUE_SCALES,
    TORQUE_UNITS,
)
from jointid.importing.map.guess import propose_joint
from jointid.importing.map.mapping import JOINT, MAX_JOINTS, MOTOR
from jointid.ui.importing.checks import Checks
from jointid.ui.shared.markdown_escape import markdown_escape
from jointid.wording import capitalised, counted

T = TypeVar("T")

_NO_COLUMN = "no column: number the rows"
_SIDES = {MOTOR: "motor", JOINT: "joint"}
_SIGNS = {1: "as logged", -1: "reversed"}


class Entries:
    """The widgets of one mapping; their keys carry the columns' signature."""

    def __init__(self, table: LogTable, guess: Guess, base: Mapping, key: str) -> None:
        self.table, self.guess, self.base, self.key = table, guess, base, key
        self.checks = Checks(guess, key)
        self.folded = base != guess.mapping or not self.checks.columns_are_open
        """Whether it was clear from the start which column is what."""
        self.asked: list[tuple[Channel, Channel, float]] = []
        self.used: set[str] = set()

    def ask(self) -> Mapping:
        """Draw the summary with its checks, and below, folded, all entries."""
        self._summary = st.container(border=True)
        with st.expander(
            "All entries: columns, units, sides, directions, and why they are so",
            expanded=not self.folded,
        ):
            time, joints = self._time()
            self.used = {time[0], *(c for c in self.base.columns if c != self.base.time.column)}
            for j in range(joints):
                self.asked.append(self._joint(j))
            held, delay = self._timing()
            st.caption("  \n".join(self.checks.sure))
        with self._summary:
            self.checks.show_instructions()
        for number, (position, torque, _) in enumerate(self.asked, start=1):
            for role, channel in (("position", position), ("torque", torque)):
                if not channel.column:
                    raise JointIdError(
                        f"No column is left for the {role} of joint {number}: choose one that another "
                        "joint does without, or give fewer joints."
                        if number > self.guess.mapping.n
                        else f"No column is chosen for the {role} of joint {number}: no name or unit "
                        "says which it is. Choose it under All entries."
                    )
        return Mapping(TimeColumn(*time), tuple(JointMapping(*a) for a in self.asked), held, delay)

    def _timing(self) -> tuple[bool, float]:
        """Whether the torque is held, and its delay in seconds."""
        delay = st.number_input(
            "Torque acts after its sample by (ms)",
            value=1e3 * self.base.torque_delay_s,
            format="%g",
            key=self._id("delay"),
            persist_state="session",
        )
        with self._summary:
            held = st.checkbox(
                "Torque held from sample to sample",
                self.base.torque_hold,
                help="A digital controller's torque stays constant until its next sample.",
                key=self._id("held"),
                persist_state="session",
            )
            if delay:
                st.markdown(f"**Torque** acts {delay:g} ms after its sample")
            self.checks.ask("not held", ("torque hold", not held))
        return held, float(delay) / 1e3

    def _time(self) -> tuple[tuple[str, str, float | None], int]:
        one, two, three, four = st.columns([3, 2, 2, 2])
        base = self.base.time
        column = self._select(
            one, "Time", [*self.table.names, _NO_COLUMN], base.column or _NO_COLUMN, "time"
        )
        units = [SAMPLES] if column == _NO_COLUMN else [*TIME_UNITS, SAMPLES]
        unit = self._select(
            two, "Unit of time", units, base.unit if base.unit in units else units[0],
            f"time unit {column == _NO_COLUMN}",
        )  # fmt: skip
        rate = None
        if unit == SAMPLES:
            rate = three.number_input(
                "Samples per second (Hz)",
                min_value=0.0,
                value=base.rate_hz or 1000.0,
                format="%g",
                key=self._id("rate"),
                persist_state="session",
            )
        joints = four.number_input(
            "Joints", 1, MAX_JOINTS, self.base.n, key=self._id("joints"), persist_state="session"
        )
        time = "" if column == _NO_COLUMN else column
        guess = self.guess.mapping.time
        still = time == guess.column
        with self._summary:
            st.markdown(time_line(time, unit, rate, int(joints)))
            self.checks.ask(
                "time",
                ("joints", int(joints) == self.guess.mapping.n),
                ("time", still),
                ("unit of time", still and (unit, rate) == (guess.unit, guess.rate_hz)),
            )
        return (time, unit, rate), int(joints)

    def _joint(self, j: int) -> tuple[Channel, Channel, float]:
        known = self.base.joints[j] if j < self.base.n else None
        if known is not None:
            first = known.position, known.torque
        else:
            like = self.asked[0][0], self.asked[0][1]
            *first_two, why = propose_joint(self.table, j + 1, like, self.used)
            first = first_two[0], first_two[1]
            self.checks.add(why)
        with self._summary:
            left, right = st.columns([3, 2], vertical_alignment="center")
            ratio = right.number_input(
                f"Gear ratio of joint {j + 1}",
                value=known.gear_ratio if known else 1.0,
                step=1.0,
                format="%g",
                key=self._id(f"ratio {j}"),
                persist_state="session",
                help="Motor turns over joint turns; negative when they turn against each other. "
                "It counts for channels measured on the joint's side.",
            )
        with st.container(border=True):
            st.markdown(f"**Joint {j + 1}**")
            position = self._channel(
                "position", j, first[0], tuple(ANGLE_UNITS), POSITION_SCALES, right,
            )  # fmt: skip
            torque = self._channel(
                "torque", j, first[1], tuple(TORQUE_UNITS), TORQUE_SCALES, right,
            )  # fmt: skip
        left.markdown(joint_line(j + 1, position, torque))
        then = self.guess.mapping.joints[j] if known is not None and j < self.guess.mapping.n else None
        if known is None:
            self._check_joint(j, position, torque, float(ratio), first)
        elif then is not None:
            self._check_joint(j, position, torque, float(ratio), (then.position, then.torque))
        else:
            self.checks.assumed += _assumed(j, position, torque, float(ratio))
        self.used |= {position.column, torque.column}
        return position, torque, float(ratio)

    def _check_joint(
        self, j: int, position: Channel, torque: Channel, ratio: float, then: tuple[Channel, Channel]
    ) -> None:
        end = f" of joint {j + 1}"
        entries = []
        for role, now, was in (("position", position, then[0]), ("torque", torque, then[1])):
            same = now.column == was.column
            entries += [
                (f"{role}{end}", same),
                (f"unit of {role}{end}", same and now.unit == was.unit),
                (f"scale of {role}{end}", same and (now.unit, now.scale) == (was.unit, was.scale)),
                (f"side of {role}{end}", same and now.side == was.side),
            ]
        entries.append((f"gear ratio{end}", JOINT in (position.side, torque.side) and ratio == 1.0))
        assumed = _assumed(j, position, torque, ratio)
        with self._summary:
            self.checks.ask(f"joint {j + 1}", *entries, part_of=end, assumed=assumed)

    def _channel(
        self,
        role: str,
        j: int,
        base: Channel,
        units: tuple[str, ...],
        scales: MappingType[str, str],
        place: DeltaGenerator,
    ) -> Channel:
        """Ask for a column, and at ``place`` for the scale of its unit, which no log states."""
        one, two, three, four = st.columns([3, 1.5, 1.5, 2])
        name = f"{role} {j}"
        column = self._select(
            one, f"{role.capitalize()} of joint {j + 1}", self.table.names, base.column, name
        )
        unit = self._select(two, f"Unit of {role} {j + 1}", units, base.unit, f"{name} unit")
        scale = None
        if meaning := scales.get(unit):
            scale = place.number_input(
                capitalised(meaning),
                value=base.scale if base.unit == unit and base.scale else 1.0,
                format="%g",
                key=self._id(f"{name} scale {meaning}"),
                persist_state="session",
            )
        side = self._select(three, "Measured at the", _SIDES, base.side, f"{name} side", _SIDES)
        sign = self._select(four, "Direction", _SIGNS, base.sign, f"{name} sign", _SIGNS)
        return Channel(column, unit, scale, side, sign)

    def _select(
        self,
        place: DeltaGenerator,
        label: str,
        options: Iterable[T],
        value: T,
        name: str,
        words: MappingType[T, str] | None = None,
    ) -> T:
        choices = list(options)
        if st.session_state.get(self._id(name), choices[0]) not in choices:
            del st.session_state[self._id(name)]  # of an earlier version
        index = choices.index(value) if value in choices else None if value == "" else 0
        chosen = place.selectbox(
            label,
            choices,
            index=index,
            format_func=words.__getitem__ if words else str,
            key=self._id(name),
            placeholder="choose",
            persist_state="session",
        )
        return value if chosen is None else chosen

    def _id(self, name: str) -> str:
        return f"import {name} {self.key}"


def _assumed(j: int, position: Channel, torque: Channel, ratio: float) -> list[str]:
    """Ratio and scales that are 1 where they count."""
    end, found = f" of joint {j + 1}", []
    if ratio == 1.0 and JOINT in (position.side, torque.side):
        found.append(f"gear ratio 1{end}")
    for channel, scales in ((position, POSITION_SCALES), (torque, TORQUE_SCALES)):
        if channel.scale == 1.0:
            what, _, unit = scales[channel.unit].partition(", ")
            found.append(f"{what} 1{f' {unit}' if unit else ''}{end}")
    return found


def time_line(column: str, unit: str, rate_hz: float | None, joints: int) -> str:
    """Describe the time column and the number of joints in one line."""
    where = "row number" if not column else f'"{column}"'
    at = f"{where}, {rate_hz:g} Hz" if rate_hz is not None else f"{where} in {unit}"
    return f"**Time** {markdown_escape(at)} · {counted(joints, 'joint')}"


def joint_line(number: int, position: Channel, torque: Channel) -> str:
    """Describe the columns of a joint in one line."""
    parts = []
    for role, channel, scales in (
        ("position", position, POSITION_SCALES),
        ("torque", torque, TORQUE_SCALES),
    ):
        if not channel.column:
            parts.append(f"{role}: no column")
            continue
        scale = ""
        if meaning := scales.get(channel.unit):
            what, _, unit = meaning.partition(", ")
            scale = f" ({what} {channel.scale:g}{f' {unit}' if unit else ''})"
        turned = ", reversed" if channel.sign < 0 else ""
        name = markdown_escape(f'"{channel.column}" in {channel.unit}')
        parts.append(f"{role} {name}{scale} at the {_SIDES[channel.side]}{turned}")
    return f"**Joint {number}** {'; '.join(parts)}"
