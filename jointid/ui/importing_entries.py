"""Every entry of a mapping as a widget, with the reasons for what was guessed."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Mapping as MappingType
from typing import TypeVar

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import JointIdError
from jointid.importing import Channel, Guess, JointMapping, LogTable, Mapping, TimeColumn
from jointid.importing.mapping import JOINT, MAX_JOINTS, MOTOR
from jointid.importing.more_joints import propose_joint
from jointid.importing.units import (
    ANGLE_UNITS,
    POSITION_SCALES,
    SAMPLES,
    TIME_UNITS,
    TORQUE_SCALES,
    TORQUE_UNITS,
)

T = TypeVar("T")

_NO_COLUMN = "no column: number the rows"
_SIDES = {MOTOR: "motor", JOINT: "joint"}
_SIGNS = {1: "as logged", -1: "reversed"}


class Entries:
    """The widgets of one mapping; their keys carry the columns' signature."""

    def __init__(self, table: LogTable, guess: Guess, base: Mapping, key: str) -> None:
        self.table, self.guess, self.base, self.key = table, guess, base, key
        self.reasons = {reason.what: reason for reason in guess.reasons}
        self.sure: list[str] = []
        self.assumed: list[str] = []
        """Ratios and scales that are 1 because nobody gave them."""
        self.unsure: list[str] = []
        """What else is marked "To check"."""
        self.asked: list[tuple[Channel, Channel, float]] = []
        self.used: set[str] = set()

    def ask(self) -> Mapping:
        with st.container(border=True):
            time, joints = self._time()
        self.used = {time[0], *(c for c in self.base.columns if c != self.base.time.column)}
        for j in range(joints):
            self.asked.append(self._joint(j))
        with st.container(border=True):
            left, right = st.columns(2, vertical_alignment="bottom")
            held = left.checkbox(
                "Torque held from sample to sample",
                self.base.torque_hold,
                help="A digital controller's torque stays constant until its next sample.",
                key=self._id("held"),
                persist_state="session",
            )
            delay = right.number_input(
                "Torque acts after its sample by (ms)",
                value=1e3 * self.base.torque_delay_s,
                format="%g",
                key=self._id("delay"),
                persist_state="session",
            )
            self._why(("torque hold", not held))
        if self.sure:
            with st.expander("Why the other entries were guessed as they are"):
                for text in self.sure:
                    st.caption(text)
        for number, (position, torque, _) in enumerate(self.asked, start=1):
            for role, channel in (("position", position), ("torque", torque)):
                if not channel.column:
                    raise JointIdError(
                        f"No column is left for the {role} of joint {number}: choose one that another "
                        "joint does without, or give fewer joints."
                    )
        return Mapping(
            TimeColumn(*time), tuple(JointMapping(*a) for a in self.asked), held, float(delay) / 1e3
        )

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
        self._why(
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
            self.reasons |= {reason.what: reason for reason in why}
        with st.container(border=True):
            left, right = st.columns([3, 2], vertical_alignment="center")
            left.markdown(f"**Joint {j + 1}**")
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
            position = self._channel(
                "position", j, first[0], tuple(ANGLE_UNITS), POSITION_SCALES,
            )  # fmt: skip
            torque = self._channel(
                "torque", j, first[1], tuple(TORQUE_UNITS), TORQUE_SCALES,
            )  # fmt: skip
            if known is None:
                self._why_joint(j, position, torque, float(ratio), first)
            elif j < self.guess.mapping.n:
                guess = self.guess.mapping.joints[j]
                self._why_joint(j, position, torque, float(ratio), (guess.position, guess.torque))
        self.used |= {position.column, torque.column}
        self._note_assumed(j, position, torque, float(ratio))
        return position, torque, float(ratio)

    def _note_assumed(self, j: int, position: Channel, torque: Channel, ratio: float) -> None:
        end = f" of joint {j + 1}"
        if ratio == 1.0 and JOINT in (position.side, torque.side):
            self.assumed.append(f"gear ratio 1{end}")
        for channel, scales in ((position, POSITION_SCALES), (torque, TORQUE_SCALES)):
            if channel.scale == 1.0:
                what, _, unit = scales[channel.unit].partition(", ")
                self.assumed.append(f"{what} 1{f' {unit}' if unit else ''}{end}")

    def _why_joint(
        self, j: int, position: Channel, torque: Channel, ratio: float, then: tuple[Channel, Channel]
    ) -> None:
        end = f" of joint {j + 1}"
        stands = []
        for role, now, was in (("position", position, then[0]), ("torque", torque, then[1])):
            same = now.column == was.column
            stands += [
                (f"{role}{end}", same),
                (f"unit of {role}{end}", same and now.unit == was.unit),
                (f"scale of {role}{end}", same and (now.unit, now.scale) == (was.unit, was.scale)),
                (f"side of {role}{end}", same and now.side == was.side),
            ]
        geared = JOINT in (position.side, torque.side)
        self._why(*stands, (f"gear ratio{end}", geared and ratio == 1.0), part_of=end)

    def _channel(
        self, role: str, j: int, base: Channel, units: tuple[str, ...], scales: MappingType[str, str]
    ) -> Channel:
        one, two, three, four, five = st.columns([3, 1.5, 2.5, 1.5, 2])
        name = f"{role} {j}"
        column = self._select(
            one, f"{role.capitalize()} of joint {j + 1}", self.table.names, base.column, name
        )
        unit = self._select(two, f"Unit of {role} {j + 1}", units, base.unit, f"{name} unit")
        scale = None
        if meaning := scales.get(unit):
            scale = three.number_input(
                _upper(meaning),
                value=base.scale if base.unit == unit and base.scale else 1.0,
                format="%g",
                key=self._id(f"{name} scale {meaning}"),
                persist_state="session",
            )
        side = self._select(four, "Measured at the", _SIDES, base.side, f"{name} side", _SIDES)
        sign = self._select(five, "Direction", _SIGNS, base.sign, f"{name} sign", _SIGNS)
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

    def _why(self, *stands: tuple[str, bool], part_of: str = "") -> None:
        """Say what was guessed without being sure, and remember the other reasons; not once changed."""
        found = [
            self.reasons[what] for what, stands_yet in stands if stands_yet and what in self.reasons
        ]
        self.unsure += [
            r.what for r in found if not r.sure and not r.what.startswith(("gear ratio", "scale"))
        ]
        check = [
            f"**{_upper(reason.what.removesuffix(part_of))}:** {reason.text}"
            for reason in found
            if not reason.sure
        ]
        if check:
            st.caption(f":orange-badge[To check] {' '.join(check)}")
        self.sure += [f"**{_upper(r.what)}:** {r.text}" for r in found if r.sure]

    def _id(self, name: str) -> str:
        return f"import {name} {self.key}"


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]
