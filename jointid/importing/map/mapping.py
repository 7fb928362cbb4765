"""Mapping of columns to time, positions and torques, with units and sides of the gear, and its JSON."""

import json
from collections.abc import Sequence
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from typing import Any

from jointid.arrays import bounded_number, finite_array, set_fields
from jointid.errors import JointIdError
from jointid.importing.columns.units import ANGLE_UNITS, QUANTITIES, SAMPLES, TIME_UNITS, TORQUE_UNITS
from jointid.wording import listed, nearest, shown

MOTOR, JOINT = "motor", "joint"
"""The sides of a gear."""
ARM = "arm-side position"
"""Name of the role of a sensor behind the gear."""
MAX_JOINTS = 20


@dataclass(frozen=True)
class TimeColumn:
    """Source of the sample times.

    Raises JointIdError when the unit is unknown, or a rate is missing or not positive.
    """

    column: str = ""
    """Name of the column; empty when the rows themselves are the samples (``unit`` "samples")."""
    unit: str = "s"
    """"s", "ms", "µs", "ns", or "samples": numbers that count samples, at ``rate_hz``."""
    rate_hz: float | None = None
    """Samples per second, for "samples" only."""

    def __post_init__(self) -> None:
        _require_text("time", self.column)
        _require_one_of("time", "unit", self.unit, (*TIME_UNITS, SAMPLES))
        if self.unit == SAMPLES:
            if self.rate_hz is None:
                raise JointIdError(
                    "time: sample numbers need a rate. Give rate_hz, such as 1000 samples per second."
                )
            set_fields(self, rate_hz=bounded_number("time: rate_hz", "Hz", self.rate_hz))
        elif self.rate_hz is not None:
            raise JointIdError(f'time: rate_hz goes with the unit "samples", not with "{self.unit}".')
        elif not self.column:
            raise JointIdError(
                'time: no column. Choose one, or number the rows with the unit "samples" and rate_hz.'
            )


@dataclass(frozen=True)
class Channel:
    """One column with its unit, scale, side and sign."""

    column: str
    """Its name; empty before the choice."""
    unit: str
    """Angle: a key of ``ANGLE_UNITS``; torque: one of ``TORQUE_UNITS``."""
    scale: float | None = None
    """Counts per turn, degrees per volt, torque constant, rated torque, N·m per volt, see
    ``POSITION_SCALES`` and ``TORQUE_SCALES``. None for units that need none."""
    side: str = MOTOR
    """Side of the gear on which it was measured, and for which its scale holds."""
    sign: int = 1
    """-1 reverses a channel that counts in the other direction."""

    @property
    def rad_per_unit(self) -> float:
        """Angle at its own side of the gear, rad, for one unit of a position."""
        scale = 1.0 if self.scale is None else self.scale
        factor = 1 / scale if self.unit == "counts" else scale
        return self.sign * ANGLE_UNITS[self.unit] * factor


@dataclass(frozen=True)
class JointMapping:
    """Position and torque of one joint.

    Raises JointIdError when a unit, scale, side, sign or the ratio is invalid.
    """

    position: Channel
    torque: Channel
    gear_ratio: float = 1.0
    """Motor turns over joint turns; negative if they turn in opposite directions. Used for channels on
    the joint side only."""
    arm: Channel | None = None
    """Position of a second sensor, behind the gear."""

    def __post_init__(self) -> None:
        for what in QUANTITIES:
            set_fields(self, **{what: _checked_channel(what, getattr(self, what))})
        if self.arm is not None:
            arm = _checked_channel("position", self.arm)
            set_fields(self, arm=replace(arm, side=JOINT) if arm.column else None)
        ratio = float(finite_array("gear_ratio", self.gear_ratio, ndim=0))
        if ratio == 0:
            raise JointIdError("gear_ratio = 0: give motor turns per joint turn, such as 100.")
        set_fields(self, gear_ratio=ratio)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Position and torque, and the arm-side position if there is one."""
        return (self.position, self.torque, *([self.arm] if self.arm else []))

    @property
    def needs_ratio(self) -> bool:
        """Whether a channel is behind the gear."""
        return any(channel.side == JOINT for channel in self.channels)

    @property
    def rad_per_unit(self) -> float:
        """Motor angle, rad, for one unit of the position column."""
        of_gear = self.gear_ratio if self.position.side == JOINT else 1.0
        return self.position.rad_per_unit * of_gear

    @property
    def Nm_per_unit(self) -> float:
        """Motor torque, N·m, for one unit of the torque column."""
        channel = self.torque
        factor = TORQUE_UNITS[channel.unit] * (1.0 if channel.scale is None else channel.scale)
        return channel.sign * factor / (self.gear_ratio if channel.side == JOINT else 1.0)


@dataclass(frozen=True)
class Mapping:
    """Meaning of the columns of a log.

    Raises JointIdError when there is no joint, or a column is used twice.
    """

    time: TimeColumn
    joints: tuple[JointMapping, ...]
    """In the order of the study's joints."""
    torque_hold: bool = False
    """The torque is held from one sample to the next (zero-order hold)."""
    torque_delay_s: float = 0.0
    """The torque acts this much after its sample, s."""
    assumed: tuple[str, ...] = field(default=(), compare=False)
    """Unconfirmed entries that logs do not state: "gear ratio of joint 1", "torque hold", "direction of
    torque of joint 2"; see ``jointid.importing.map.reasons``."""

    def __post_init__(self) -> None:
        if not self.joints:
            raise JointIdError("The mapping has no joints: choose position and torque of at least one.")
        if len(self.joints) > MAX_JOINTS:
            raise JointIdError(f"{len(self.joints)} joints; the limit is {MAX_JOINTS}: leave some out.")
        if not isinstance(self.torque_hold, bool):
            raise JointIdError(f"torque_hold = {shown(self.torque_hold)}: expected true or false.")
        delay = float(finite_array("torque_delay_s (s)", self.torque_delay_s, ndim=0))
        seen: dict[str, str] = {self.time.column: "time"} if self.time.column else {}
        for role, channel in self.roles:
            if channel.column and channel.column in seen:
                raise JointIdError(
                    f'The column "{channel.column:.60}" is both {seen[channel.column]} and {role}: '
                    "choose another for one of them."
                )
            seen[channel.column] = role
        listed = isinstance(self.assumed, list | tuple)
        if not listed or not all(isinstance(what, str) for what in self.assumed):
            raise JointIdError(f"assumed = {shown(self.assumed)}: expected names of entries.")
        assumed, joints = tuple(self.assumed), tuple(self.joints)
        set_fields(self, assumed=assumed, joints=joints, torque_delay_s=delay)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def roles(self) -> tuple[tuple[str, Channel], ...]:
        """All channels by role, "torque of joint 1", joint by joint."""
        return tuple(
            (f"{what} of joint {number}", channel)
            for number, joint in enumerate(self.joints, start=1)
            for what, channel in zip((*QUANTITIES, ARM), joint.channels, strict=False)
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns that are used: time (if any), positions, torques, arm-side positions."""
        kinds = [*QUANTITIES, ARM]
        roles = sorted(self.roles, key=lambda role: kinds.index(role[0].partition(" of ")[0]))
        return tuple(filter(None, (self.time.column, *(channel.column for _, channel in roles))))

    @property
    def open_roles(self) -> tuple[str, ...]:
        """Roles without a column."""
        return tuple(role for role, channel in self.roles if not channel.column)


def _checked_channel(what: str, channel: Channel) -> Channel:
    units, scales = QUANTITIES[what]
    _require_text(what, channel.column)
    where = f"{what} ({channel.column:.60})"
    _require_one_of(where, "unit", channel.unit, tuple(units))
    _require_one_of(where, "side", channel.side, (MOTOR, JOINT))
    if not isinstance(channel.sign, int) or isinstance(channel.sign, bool) or abs(channel.sign) != 1:
        raise JointIdError(f"{where}: sign = {shown(channel.sign)}; expected 1 or -1.")
    meaning = scales.get(channel.unit)
    if meaning is None:
        if channel.scale is not None:
            raise JointIdError(f'{where}: the unit "{channel.unit}" takes no scale; leave it out.')
        return channel
    if channel.scale is None:
        raise JointIdError(f'{where}: the unit "{channel.unit}" needs a scale: {meaning}.')
    scale = float(finite_array(f"{where}: {meaning}", channel.scale, ndim=0))
    if scale == 0:
        raise JointIdError(f"{where}: {meaning} is 0: give another number.")
    return replace(channel, scale=scale)


def _require_text(where: str, column: object) -> None:
    if not isinstance(column, str):
        raise JointIdError(f"{where}: column = {shown(column)}; expected text.")


def _require_one_of(where: str, key: str, value: object, known: Sequence[str]) -> None:
    if value not in known:
        raise JointIdError(f"{where}: {key} = {shown(value)}; expected one of {listed(known)}.")


_MAX_LENGTH = 1 << 22
"""Most characters of a mapping or of a list of runs."""


def json_values(what: str, text: str | bytes, remedy: str) -> Any:
    """Parse a JSON file that jointid writes. Raises JointIdError when it is too long or not JSON."""
    if len(text) > _MAX_LENGTH:
        raise JointIdError(
            f"{what} has {len(text)} characters, more than the limit of {_MAX_LENGTH}: {remedy}"
        )
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise JointIdError(f"{what} is not JSON ({error!s:.120}): {remedy}") from error


def mapping_to_json(mapping: Mapping) -> str:
    """Write a mapping as JSON; ``mapping_from_json`` reads it back exactly."""
    return json.dumps({"format": 1} | asdict(mapping), ensure_ascii=False, indent=1)


def mapping_from_json(text: str | bytes) -> Mapping:
    """Read a mapping written by ``mapping_to_json``.

    Raises JointIdError when the text is not a mapping; the message names key and value.
    """
    values = json_values("The mapping", text, "choose one that jointid saved.")
    top = _keys("mapping", values, Mapping, "format")
    version = top.pop("format", None)
    if version != 1:
        raise JointIdError(
            f"mapping: format = {shown(version)}; this version reads format 1. Save the mapping again."
        )
    joints = top["joints"]
    if not isinstance(joints, list):
        raise JointIdError(f"mapping: joints = {shown(joints)}; expected a list.")
    top["time"] = TimeColumn(**_keys("time", top["time"], TimeColumn))
    top["joints"] = tuple(_joint_from(number, joint) for number, joint in enumerate(joints, start=1))
    return Mapping(**top)


def _joint_from(number: int, values: object) -> JointMapping:
    joint = _keys(f"joint {number}", values, JointMapping)
    for what in ("position", "torque", "arm"):
        if joint.get(what) is not None:
            joint[what] = Channel(**_keys(f"{what} of joint {number}", joint[what], Channel))
    try:
        return JointMapping(**joint)
    except JointIdError as error:
        raise JointIdError(f"joint {number}: {error}") from error


def _keys(where: str, values: object, kind: type[Any], *more: str) -> dict[str, Any]:
    """Return the values of an object for the fields of a dataclass; refuse other keys."""
    known = [*more, *(field.name for field in fields(kind))]
    if not isinstance(values, dict):
        raise JointIdError(f"{where}: expected keys {listed(known)}, got {shown(values)}.")
    for key in values:
        if key not in known:
            raise JointIdError(f'{where}: unknown key "{key:.60}".{nearest(key, known)}')
    for each in fields(kind):
        if each.default is MISSING and values.get(each.name) is None:
            raise JointIdError(f"{where}: {each.name} is missing in the mapping.")
    return dict(values)
