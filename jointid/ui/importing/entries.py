"""Every entry of a mapping as a widget: columns and units first, then what no log states."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b
from typing import Any

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import JointIdError, importing
from jointid.importing.columns.units import QUANTITIES, SAMPLES, TIME_UNITS
from jointid.importing.map.guess import guess_unit, propose_joint
from jointid.importing.map.mapping import ARM, JOINT, MAX_JOINTS, MOTOR
from jointid.importing.map.reasons import Reason, grouped, of_joints, unchanged, value_of
from jointid.ui.importing.steps import go_on
from jointid.ui.shared.entries import enter_number, enter_text, numbers_in
from jointid.ui.shared.messages import markdown_escape, show_error
from jointid.wording import capitalised, plain

_NO_COLUMN = "no column: number the rows"
_NO_SENSOR = "none"
_HELD = {True: "held until the next sample", False: "not held"}
_OF_DRIVES = ("direction", "side", "scale", "gear ratio", "torque hold")
"""First parts of the names of entries from the drive's data sheet, not the file."""
_SIDE_HELP = "Robot controllers often log values at the joint, drives at the motor."
_SIGN_HELP = (
    "If a positive torque accelerates a joint towards smaller logged positions, select the joint for "
    "either position or torque, not both."
)
_SWITCHES = {
    ("position", "side"): (JOINT, "Position is measured at the joint, behind the gear", _SIDE_HELP),
    ("torque", "side"): (JOINT, "Torque is measured at the joint, behind the gear", _SIDE_HELP),
    ("position", "sign"): (-1, "Position has the opposite sign", _SIGN_HELP),
    ("torque", "sign"): (-1, "Torque has the opposite sign", _SIGN_HELP),
}
"""Value of a channel's field, its question, answered by the joints that have it, and its help."""


@dataclass(frozen=True)
class Asked:
    """The answers of a step."""

    mapping: importing.Mapping
    missing: tuple[str, ...]
    """Entries without a value; the mapping has a placeholder there."""
    to_confirm: bool
    """Whether guesses of this step are unconfirmed."""
    gear_ratio: tuple[float, ...] | None = None
    """Gear ratios, if all are given."""
    problems: tuple[str, ...] = ()
    """Entries that cannot be used, each named and shown where it is entered."""


class Entries:
    """The widgets of one mapping; their keys carry the columns' signature."""

    def __init__(
        self, table: importing.LogTable, guess: importing.Guess, base: importing.Mapping, key: str
    ) -> None:
        self.table, self.guess, self.base, self.key = table, guess, base, key
        self._reasons = {reason.what: reason for reason in guess.reasons}
        self._follows: dict[str, str] = {}  # guessed units of columns that the user chose
        self._problems: list[str] = []  # entries that are no numbers, with their errors shown

    def ask_columns(self) -> Asked:
        """Ask for time, columns and units."""
        missing: list[str] = []
        time, n = self._time()
        used = {time.column, *(c for c in self.base.columns if c != self.base.time.column)}
        joints: list[importing.JointMapping] = []
        for j in range(n):
            if j < self.base.n:
                first = self.base.joints[j]
            else:  # one joint more than the guess has
                like = (self.base.joints[0].position, self.base.joints[0].torque)
                first, why = propose_joint(self.table, j + 1, like, used)
                self._reasons |= {reason.what: reason for reason in why}
            joints.append(self._columns_of(j, first, missing))
            used |= {channel.column for channel in joints[j].channels}
        joints = self._with_sensors(joints)
        found = importing.Mapping(time, tuple(joints), assumed=self._assumed(n))
        as_guessed = {*unchanged(found, self.guess.mapping)} - {*self._follows}
        as_guessed |= {w for w, unit in self._follows.items() if value_of(found, w).endswith(f" {unit}")}
        guesses = [w for w in found.assumed if w in as_guessed and not w.startswith(_OF_DRIVES)]
        return self._confirmed("columns", found, missing, [w for w in guesses if w not in missing])

    def ask_drives(self, columns: importing.Mapping) -> Asked:
        """Ask for gear ratios, scales, directions and timing of the torque."""
        missing: list[str] = []
        st.caption(
            "Not in the log: see the data sheet and settings of the drive. Entries left empty or not "
            "confirmed are marked as assumed in the study, its report and its files."
        )
        left, right = st.columns(2)
        joints = list(columns.joints)
        # No log states a ratio: 1 is the mapping's placeholder where the method does not need it.
        of_base = [
            joint.gear_ratio if joint.needs_ratio or joint.gear_ratio != 1 else None
            for joint in self.base.joints
        ]
        ratios = self._numbers(left, "Gear ratios", "gear ratio", range(len(joints)), of_base, _RATIO)
        scales = self._scales(joints, right)
        hold, delay = self._torque_timing(left, right)
        places = [place for _ in range(2) for place in st.columns(2)]
        switched = {
            switch: self._joints_with(place, *switch, joints)
            for place, switch in zip(places, _SWITCHES, strict=True)
        }
        for j, of in enumerate(joints):
            channels = {}
            for role in QUANTITIES:
                scale = scales.get((role, j))
                side = JOINT if j in switched[role, "side"] else MOTOR
                sign = -1 if j in switched[role, "sign"] else 1
                channels[role] = replace(getattr(of, role), scale=scale, side=side, sign=sign)
                if scale is not None and math.isnan(scale):
                    channels[role] = replace(channels[role], scale=1.0)
                    missing.append(f"scale of {role} of joint {j + 1}")
            known = not math.isnan(ratios[j])
            joints[j] = replace(of, **channels, gear_ratio=ratios[j] if known else 1.0)
            if joints[j].needs_ratio and not known:
                missing.append(f"gear ratio of joint {j + 1}")
        missing += ["torque hold"] if hold is None else []
        assumed = tuple(what for what in self._assumed(len(joints)) if what.startswith(_OF_DRIVES))
        found = importing.Mapping(columns.time, tuple(joints), bool(hold), delay, assumed)
        asked_for = ("gear ratio", "scale", "torque hold")
        guesses = [w for w in unchanged(found, self.guess.mapping) if not w.startswith(asked_for)]
        asked = self._confirmed("drive data", found, missing, guesses)
        given = tuple(ratios.values())
        return replace(asked, gear_ratio=None if np.isnan(given).any() else given)

    def _confirmed(
        self, step: str, found: importing.Mapping, missing: Sequence[str], guesses: Sequence[str]
    ) -> Asked:
        """Show guesses with a button that confirms them; a changed entry needs another confirmation."""
        text = importing.mapping_to_json(replace(found, assumed=()))
        digest = blake2b(text.encode(), digest_size=8).hexdigest()
        key = f"import confirmed {step} {self.key}"
        # Clicked, with entries typed just before it; a wrong one is never confirmed as unknown.
        if st.session_state.get(f"go_on {step}") and not self._problems:
            st.session_state[key] = digest
        open_ = () if st.session_state.get(key) == digest else (*guesses, *missing)
        self._show_reasons([what for what in guesses if what in open_])
        if open_ and not (missing and step == "columns"):
            st.button(f"Confirm the {step}", type="primary", key=f"go_on {step}", on_click=go_on)
        assumed = tuple(dict.fromkeys((*missing, *open_)))
        to_confirm, problems = bool(open_ or self._problems), tuple(self._problems)
        return Asked(replace(found, assumed=assumed), tuple(missing), to_confirm, problems=problems)

    def _time(self) -> tuple[importing.TimeColumn, int]:
        one, two, three, four = st.columns([3, 2, 2, 2])
        base = self.base.time
        options = [*self.table.names, _NO_COLUMN]
        column = self._select(one, "Time", options, base.column or _NO_COLUMN, "time")
        units = [SAMPLES] if column == _NO_COLUMN else [*TIME_UNITS, SAMPLES]
        first = base.unit if base.unit in units else units[0]
        unit = self._select(two, "Unit of time", units, first, f"time unit {column == _NO_COLUMN}")
        rate = None
        if unit == SAMPLES:
            label, first_rate = "Samples per second (Hz)", base.rate_hz or 1000.0
            rate = enter_number(three, f"import rate {self.key}", label, first_rate, (0.0, math.inf))
        joints = enter_number(four, f"import joints {self.key}", "Joints", self.base.n, (1, MAX_JOINTS))
        return importing.TimeColumn("" if column == _NO_COLUMN else column, unit, rate), joints

    def _columns_of(
        self, j: int, first: importing.JointMapping, missing: list[str]
    ) -> importing.JointMapping:
        places = st.columns([3, 1.5, 3, 1.5])
        channels = []
        for k, (role, (units, scales)) in enumerate(QUANTITIES.items()):
            base, name = getattr(first, role), f"{role} {j}"
            label = f"{role.capitalize()} of joint {j + 1}"
            column = self._select(places[2 * k], label, self.table.names, base.column, name)
            first_unit = base.unit if base.column or j >= self.guess.mapping.n else ""
            what = f"unit of {role} of joint {j + 1}"
            if column not in ("", base.column):  # another column, another unit
                of_column, sure, why = guess_unit(role, self.table.column(column))
                if sure or not first_unit or j < self.guess.mapping.n:
                    first_unit, name = of_column, f"{name} {column}"
                    self._reasons[what], self._follows[what] = Reason(what, why, sure), of_column
            label = f"Unit of {role} {j + 1}"
            unit = self._select(places[2 * k + 1], label, tuple(units), first_unit, f"{name} unit")
            if not (column and unit):
                missing.append(f"{'unit of ' * bool(column)}{role} of joint {j + 1}")
            unit = unit or next(iter(units))
            scale = (base.scale or 1.0) if unit in scales else None
            channels.append(importing.Channel(column, unit, scale, base.side, base.sign))
        return importing.JointMapping(channels[0], channels[1], first.gear_ratio)

    def _with_sensors(self, joints: Sequence[importing.JointMapping]) -> list[importing.JointMapping]:
        """Ask for the columns of second sensors, behind the gears."""
        given = [j < self.base.n and self.base.joints[j].arm for j in range(len(joints))]
        if len(self.table.columns) <= 2 * len(joints) + 1:
            return [*joints]
        units = [unit for unit in QUANTITIES["position"][0] if unit not in QUANTITIES["position"][1]]
        found = []
        with st.popover(f"Sensors behind the gears: {sum(map(bool, given)) or _NO_SENSOR}"):
            for j, joint in enumerate(joints):
                left, right = st.columns([3, 1.5])
                base = given[j] or importing.Channel("", "rad", side=JOINT)
                options, label = [_NO_SENSOR, *self.table.names], f"{capitalised(ARM)} of joint {j + 1}"
                name = self._select(left, label, options, base.column or _NO_SENSOR, f"arm {j}")
                unit = self._select(right, f"Unit of {ARM} {j + 1}", units, base.unit, f"arm {j} unit")
                name = "" if name == _NO_SENSOR else name
                found.append(replace(joint, arm=replace(base, column=name, unit=unit or "rad")))
        return found

    def _scales(
        self, joints: Sequence[importing.JointMapping], place: DeltaGenerator
    ) -> dict[tuple[str, int], float]:
        """Ask for scales, joints of one unit together; NaN for an empty entry."""
        found: dict[tuple[str, int], float] = {}
        for role, (_, scales) in QUANTITIES.items():
            meanings = {j: scales.get(getattr(of, role).unit, "") for j, of in enumerate(joints)}
            for meaning in dict.fromkeys(text for text in meanings.values() if text):
                which = [j for j, text in meanings.items() if text == meaning]
                what, _, unit = meaning.partition(", ")
                label = capitalised(what) + (f" ({unit})" if unit else "")
                if len(which) < len(joints):
                    label += of_joints([str(j + 1) for j in which])
                of_base = [getattr(of, role).scale for of in self.base.joints]
                name = f"scale of {role}"
                values = self._numbers(place, label, name, which, of_base, _SCALE, meaning)
                found |= {(role, j): value for j, value in values.items()}
        return found

    def _torque_timing(self, left: DeltaGenerator, right: DeltaGenerator) -> tuple[bool | None, float]:
        """Whether the torque is held, None if not stated; and its delay in seconds."""
        known = None if "torque hold" in self.base.assumed else self.base.torque_hold
        held = left.pills(
            "Torque between samples",
            list(_HELD.values()),
            default=None if known is None else _HELD[known],
            help="Held: a logged command or set point of a digital controller. Not held: a logged "
            "actual torque or current, measured or interpolated. A torque lag of half a sample in the "
            "verdict means that this entry is wrong.",
            **self._kept("held"),
        )
        delay = right.number_input(
            "Delay from a torque sample to its effect (ms)",
            value=1e3 * self.base.torque_delay_s,
            format="%g",
            help="0 for a measured torque or current; the delay of the drive for a logged command.",
            **self._kept("delay"),
        )
        return (None if held is None else held == _HELD[True]), float(delay) / 1e3

    def _joints_with(
        self, place: DeltaGenerator, role: str, field: str, joints: Sequence[importing.JointMapping]
    ) -> set[int]:
        """Ask which joints have the value of ``_SWITCHES``."""
        value, question, about = _SWITCHES[role, field]
        of = {str(j): getattr(joint, role) for j, joint in enumerate(joints, start=1)}
        chosen = place.pills(
            question,
            [*of],
            selection_mode="multi",
            default=[name for name, channel in of.items() if getattr(channel, field) == value],
            format_func=lambda name: f"joint {name}",
            help=about,
            **self._kept(f"{role} {field} of {len(joints)}"),
        )
        return {int(name) - 1 for name in chosen}

    def _numbers(
        self,
        place: DeltaGenerator,
        label: str,
        what: str,
        joints: Iterable[int],
        base: Sequence[float | None],
        example_and_help: tuple[Sequence[str], str],
        meaning: str = "",
    ) -> dict[int, float]:
        """Ask for a number per joint; NaN for an empty entry."""
        example, help_ = example_and_help
        joints = list(joints)
        known = [
            "?" if j >= len(base) or base[j] is None or f"{what} of joint {j + 1}" in self.base.assumed
            else plain(float(base[j] or 0)).replace("−", "-")
            for j in joints
        ]  # fmt: skip
        key, first = f"import {what} {meaning} {len(joints)} {self.key}", ", ".join(known)
        first = "" if set(known) == {"?"} else first
        asked = label + ", one per joint" * (len(joints) > 1)
        text = enter_text(place, key, asked, first, help_, ", ".join(example[: len(joints)]))
        try:
            given = text.replace("?", "nan")
            values = numbers_in(label, given, count=len(joints)) if text.strip() else ()
            if any(value == 0 or math.isinf(value) for value in values):
                raise JointIdError(f"{label}: {text[:60]}. Give finite values other than 0.")
        except JointIdError as error:
            show_error(error)
            values, self._problems = (), [*self._problems, str(error)]
        return dict.fromkeys(joints, math.nan) | dict(zip(joints, values, strict=False))

    def _assumed(self, n: int) -> tuple[str, ...]:
        """Entries of n joints that the file does not state."""
        ends = [f" of joint {j + 1}" for j in range(n)]
        names = [reason.what for reason in self._reasons.values() if not reason.sure]
        names += [f"direction of {role}{end}" for end in ends for role in QUANTITIES]
        return tuple(w for w in dict.fromkeys(names) if " of joint " not in w or w.endswith(tuple(ends)))

    def _show_reasons(self, open_: Sequence[str]) -> None:
        """Show the reasons of unconfirmed guesses, those of one entry for many joints in one line."""
        entries: dict[str, dict[str, list[str]]] = {}
        known = (self._reasons[what] for what in open_ if what in self._reasons)
        for (entry, text, _), joints in grouped(known).items():
            entries.setdefault(entry, {})[markdown_escape(text)] = joints
        position, torque = (f"direction of {role}" for role in QUANTITIES)
        if entries.get(position) == entries.get(torque) and position in entries:
            del entries[torque]
            entries[f"{position} and torque"] = entries.pop(position)
        for entry, texts in entries.items():
            every = "\n".join(f"- {text}" for text in texts) if len(texts) > 2 else None
            if every:
                joints = sorted(set().union(*texts.values()), key=int)
                texts = {f"{len(texts)} guesses, the first: {next(iter(texts))}": joints}
            for text, of in texts.items():
                name = markdown_escape(capitalised(entry + of_joints(of)))
                # No caption: its pale ink leaves the mark too little contrast.
                st.markdown(f":orange-badge[To check] :small[**{name}:** {text}]", help=every)

    def _select(
        self, place: DeltaGenerator, label: str, options: Sequence[str], value: str, name: str
    ) -> str:
        kept = self._kept(name)
        if st.session_state.get(kept["key"], options[0]) not in options:
            del st.session_state[kept["key"]]  # of an earlier version
        index = options.index(value) if value in options else None
        return place.selectbox(label, options, index, placeholder="choose", **kept) or ""

    def _kept(self, name: str) -> dict[str, Any]:
        """Arguments of a widget whose value outlives its page."""
        return {"key": f"import {name} {self.key}", "persist_state": "session"}


_RATIO = (
    ("80", "-120", "100"),
    "Motor turns per joint turn, negative if they turn in opposite directions. Needed for positions and "
    "torques at the joint, and to show K and D there. Enter ? if unknown.",
)
_SCALE = (
    ("5", "4", "3"),
    "From the drive's data sheet or settings; logs do not state it. Enter ? if unknown.",
)
"""Example and explanation of the numbers of joints."""
