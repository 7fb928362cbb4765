"""Which column is what, in which unit, on which side of the gear: from a table to motor-side SI signals."""

from __future__ import annotations

import json
from collections.abc import Mapping as MappingType
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jointid.arrays import Floats, finite_array
from jointid.errors import JointIdError
from jointid.importing.tables import LogTable
from jointid.importing.units import (
    ANGLE_UNITS,
    POSITION_SCALES,
    SAMPLES,
    TIME_UNITS,
    TORQUE_SCALES,
    TORQUE_UNITS,
)
from jointid.wording import listed, nearest, shown

MOTOR, JOINT = "motor", "joint"
"""The sides of a gear."""
MAX_JOINTS = 20


@dataclass(frozen=True)
class TimeColumn:
    """Where the sample times come from.

    Parameters
    ----------
    column : str
        Name of the column; empty when the rows themselves are the samples (``unit`` "samples").
    unit : str
        "s", "ms", "µs", "ns", or "samples": numbers that count samples, at ``rate_hz``.
    rate_hz : float, optional
        Samples per second, for "samples" only.

    Raises
    ------
    JointIdError
        When the unit is unknown, or a rate is missing or not positive.
    """

    column: str = ""
    unit: str = "s"
    rate_hz: float | None = None

    def __post_init__(self) -> None:
        _require_text("time", "column", self.column)
        _require_one_of("time", "unit", self.unit, (*TIME_UNITS, SAMPLES))
        if self.unit == SAMPLES:
            if self.rate_hz is None:
                raise JointIdError(
                    "time: sample numbers need a rate. Give rate_hz, samples per second, for instance 1000."
                )
            object.__setattr__(self, "rate_hz", _positive("time: rate_hz (Hz)", self.rate_hz))
        elif self.rate_hz is not None:
            raise JointIdError(f'time: rate_hz goes with the unit "samples", not with "{self.unit}".')
        elif not self.column:
            raise JointIdError(
                'time: no column. Choose one, or the unit "samples" with a rate to number the rows.'
            )


@dataclass(frozen=True)
class Channel:
    """One column with what makes it an angle or a torque.

    Parameters
    ----------
    column : str
    unit : str
        Angle: a key of ``ANGLE_UNITS``; torque: one of ``TORQUE_UNITS``.
    scale : float, optional
        What the unit needs, see ``POSITION_SCALES`` and ``TORQUE_SCALES``: counts per turn, degrees per
        volt, torque constant, rated torque, N·m per volt. None for units that need none.
    side : {"motor", "joint"}
        Side of the gear on which it was measured; its scale is meant on the same side.
    sign : {1, -1}
        -1 turns a channel round that counts the other way.
    """

    column: str
    unit: str
    scale: float | None = None
    side: str = MOTOR
    sign: int = 1


@dataclass(frozen=True)
class JointMapping:
    """Position and torque of one joint.

    Parameters
    ----------
    position, torque : Channel
    gear_ratio : float, default 1.0
        Motor turns over joint turns; negative when they turn against each other. Used for
        channels on the joint side only.

    Raises
    ------
    JointIdError
        When a unit, scale, side, sign or the ratio cannot be.
    """

    position: Channel
    torque: Channel
    gear_ratio: float = 1.0

    def __post_init__(self) -> None:
        position = _checked_channel("position", self.position, tuple(ANGLE_UNITS), POSITION_SCALES)
        torque = _checked_channel("torque", self.torque, tuple(TORQUE_UNITS), TORQUE_SCALES)
        ratio = float(finite_array("gear_ratio", self.gear_ratio, ndim=0))
        if ratio == 0:
            raise JointIdError("gear_ratio = 0: give motor turns over joint turns, for instance 100.")
        for name, value in (("position", position), ("torque", torque), ("gear_ratio", ratio)):
            object.__setattr__(self, name, value)

    @property
    def rad_per_unit(self) -> float:
        """Motor angle, rad, for one unit of the position column."""
        channel = self.position
        factor = ANGLE_UNITS[channel.unit]
        if channel.unit == "counts":
            factor /= channel.scale or 1.0
        elif channel.scale is not None:
            factor *= channel.scale
        return channel.sign * factor * (self.gear_ratio if channel.side == JOINT else 1.0)

    @property
    def Nm_per_unit(self) -> float:
        """Motor torque, N·m, for one unit of the torque column."""
        channel = self.torque
        factor = TORQUE_UNITS[channel.unit] * (1.0 if channel.scale is None else channel.scale)
        return channel.sign * factor / (self.gear_ratio if channel.side == JOINT else 1.0)


@dataclass(frozen=True)
class Mapping:
    """What every column of a log means.

    Parameters
    ----------
    time : TimeColumn
    joints : sequence of JointMapping
        In the order of the study's joints.
    torque_hold : bool, default False
        The torque is held from one sample to the next (zero-order hold).
    torque_delay_s : float, default 0.0
        The torque acts this much after its sample, s.

    Raises
    ------
    JointIdError
        When there is no joint, or a column is used twice.
    """

    time: TimeColumn
    joints: tuple[JointMapping, ...]
    torque_hold: bool = False
    torque_delay_s: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.time, TimeColumn):
            raise JointIdError(f"time: expected a TimeColumn, got {shown(self.time)}.")
        if not isinstance(self.joints, Sequence) or not self.joints:
            raise JointIdError("The mapping has no joints: choose position and torque of at least one.")
        if not all(isinstance(joint, JointMapping) for joint in self.joints):
            raise JointIdError("joints: expected JointMapping values only.")
        if len(self.joints) > MAX_JOINTS:
            raise JointIdError(f"{len(self.joints)} joints, more than the limit of {MAX_JOINTS}.")
        if not isinstance(self.torque_hold, bool):
            raise JointIdError(f"torque_hold = {shown(self.torque_hold)}: expected true or false.")
        delay = float(finite_array("torque_delay_s (s)", self.torque_delay_s, ndim=0))
        seen: dict[str, str] = {self.time.column: "time"} if self.time.column else {}
        for number, joint in enumerate(self.joints, start=1):
            for what, channel in (("position", joint.position), ("torque", joint.torque)):
                role = f"{what} of joint {number}"
                if channel.column in seen:
                    raise JointIdError(
                        f'The column "{channel.column:.60}" is both {seen[channel.column]} and {role}: '
                        "choose another for one of them."
                    )
                seen[channel.column] = role
        object.__setattr__(self, "joints", tuple(self.joints))
        object.__setattr__(self, "torque_delay_s", delay)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns that are used: time (if any), positions, torques."""
        time = (self.time.column,) if self.time.column else ()
        positions = (joint.position.column for joint in self.joints)
        return (*time, *positions, *(joint.torque.column for joint in self.joints))


@dataclass(frozen=True, eq=False)
class MappedLog:
    """A log in SI units, motor side: what segments are cut from."""

    time_s: Floats
    """Strictly increasing, shape (N,), s; the first is 0 unless the log says otherwise."""
    theta_rad: Floats
    """Motor angles, shape (N, n), rad."""
    tau_Nm: Floats
    """Motor torques, shape (N, n), N·m."""
    torque_hold: bool = False
    torque_delay_s: float = 0.0
    name: str = ""
    notes: tuple[str, ...] = ()
    """What was left out, as sentences for the user."""

    def __post_init__(self) -> None:
        time = finite_array("time_s", self.time_s, ndim=1)
        theta = finite_array("theta_rad", self.theta_rad, ndim=2, order="F")
        tau = finite_array("tau_Nm", self.tau_Nm, ndim=2, order="F")
        if theta.shape != tau.shape or len(theta) != time.size or theta.shape[1] == 0:
            raise JointIdError(
                f"time_s, theta_rad and tau_Nm have shapes {time.shape}, {theta.shape} and {tau.shape}: "
                "expected (N,), (N, n) and (N, n)."
            )
        if time.size < 2 or np.diff(time).min() <= 0:
            raise JointIdError("time_s: at least two times, each above the one before.")
        for name, value in (("time_s", time), ("theta_rad", theta), ("tau_Nm", tau)):
            object.__setattr__(self, name, value)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.theta_rad.shape[1])

    @property
    def interval_s(self) -> float:
        """Usual distance between samples (the median), s."""
        return float(np.median(np.diff(self.time_s)))


def apply_mapping(table: LogTable, mapping: Mapping) -> MappedLog:
    """Turn the columns of a log into motor angles and torques in SI units.

    Parameters
    ----------
    table : LogTable
    mapping : Mapping

    Returns
    -------
    MappedLog
        θ_motor = sign · ratio · θ_joint and τ_motor = sign · τ_joint / ratio for channels on the
        joint side. Rows that miss a value are left out, and a note says how many.

    Raises
    ------
    JointIdError
        When a column is missing, too few rows are complete, or the times do not increase.
    """
    names = mapping.columns
    raw = [table.column(name).values for name in names]
    time = raw.pop(0) if mapping.time.column else np.arange(table.rows, dtype=float)
    complete = np.isfinite(time)
    for column in raw:
        complete &= np.isfinite(column)
    kept = int(complete.sum())
    if kept < 2:
        empty = [n for n in names if not np.isfinite(table.column(n).values).any()]
        which = f" Empty columns: {listed(empty)}." if empty else ""
        raise JointIdError(
            f"{table.name}: {kept} row(s) have all of {listed(names)}.{which} Choose other columns."
        )
    notes = list(table.notes)
    if kept < table.rows:
        first = int(np.argmin(complete))
        notes.append(
            f"{table.rows - kept} of {table.rows} rows miss a value and were left out; the first is "
            f"{table.place(first)}."
        )
    unit = mapping.time
    seconds = 1 / unit.rate_hz if unit.rate_hz else TIME_UNITS[unit.unit]
    rows = np.flatnonzero(complete)
    time = time[complete]
    steps = np.diff(time)
    if steps.min() <= 0:
        at = int(np.argmax(steps <= 0)) + 1
        _refuse_time(table, unit, int(rows[at]), float(time[at]), float(time[at - 1]), steps)
    n = mapping.n
    theta, tau = np.empty((kept, n), order="F"), np.empty((kept, n), order="F")
    for j, joint in enumerate(mapping.joints):
        theta[:, j] = raw[j][complete] * joint.rad_per_unit
        tau[:, j] = raw[n + j][complete] * joint.Nm_per_unit
    return MappedLog(
        time_s=(time - time[0]) * seconds,
        theta_rad=theta,
        tau_Nm=tau,
        torque_hold=mapping.torque_hold,
        torque_delay_s=mapping.torque_delay_s,
        name=table.name,
        notes=tuple(notes),
    )


def mapping_to_json(mapping: Mapping) -> str:
    """Write a mapping as JSON; ``mapping_from_json`` reads it back exactly."""
    time = {"column": mapping.time.column, "unit": mapping.time.unit, "rate_hz": mapping.time.rate_hz}
    joints = [
        {
            "position": _channel_values(joint.position),
            "torque": _channel_values(joint.torque),
            "gear_ratio": joint.gear_ratio,
        }
        for joint in mapping.joints
    ]
    values = {
        "format": 1,
        "time": time,
        "joints": joints,
        "torque_hold": mapping.torque_hold,
        "torque_delay_s": mapping.torque_delay_s,
    }
    return json.dumps(values, ensure_ascii=False, indent=1)


def mapping_from_json(text: str | bytes) -> Mapping:
    """Read what ``mapping_to_json`` wrote.

    Raises
    ------
    JointIdError
        When it is no mapping; the message names the key and the value.
    """
    if len(text) > 1 << 20:
        raise JointIdError(f"The mapping has {len(text)} characters: not a mapping of columns.")
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise JointIdError(f"The mapping is not JSON ({error!s:.120}).") from error
    top = _keys("mapping", values, ("format", "time", "joints", "torque_hold", "torque_delay_s"))
    if top.get("format") != 1:
        raise JointIdError(f"mapping: format = {shown(top.get('format'))}; this version reads format 1.")
    joints = top.get("joints")
    if not isinstance(joints, list):
        raise JointIdError(f"mapping: joints = {shown(joints)}; expected a list.")
    return Mapping(
        time=TimeColumn(**_keys("time", top.get("time"), ("column", "unit", "rate_hz"))),
        joints=tuple(_joint_from(number, joint) for number, joint in enumerate(joints, start=1)),
        torque_hold=top.get("torque_hold", False),
        torque_delay_s=top.get("torque_delay_s", 0.0),
    )


def _joint_from(number: int, values: object) -> JointMapping:
    joint = _keys(f"joint {number}", values, ("position", "torque", "gear_ratio"))
    channels = {}
    for what in ("position", "torque"):
        where = f"{what} of joint {number}"
        given = _keys(where, joint.get(what), ("column", "unit", "scale", "side", "sign"))
        for key in ("column", "unit"):
            if key not in given:
                raise JointIdError(f"{where}: {key} is missing in the mapping.")
        channels[what] = Channel(**given)
    try:
        return JointMapping(**channels, gear_ratio=joint.get("gear_ratio", 1.0))
    except JointIdError as error:
        raise JointIdError(f"joint {number}: {error}") from error


def _channel_values(channel: Channel) -> dict[str, Any]:
    return {
        "column": channel.column,
        "unit": channel.unit,
        "scale": channel.scale,
        "side": channel.side,
        "sign": channel.sign,
    }


def _keys(where: str, values: object, known: Sequence[str]) -> dict[str, Any]:
    if not isinstance(values, dict):
        raise JointIdError(f"{where}: expected keys {listed(known)}, got {shown(values)}.")
    for key in values:
        if key not in known:
            raise JointIdError(f'{where}: unknown key "{key:.60}".{nearest(key, known)}')
    return dict(values)


def _checked_channel(
    what: str, channel: object, units: Sequence[str], scales: MappingType[str, str]
) -> Channel:
    if not isinstance(channel, Channel):
        raise JointIdError(f"{what}: expected a Channel, got {shown(channel)}.")
    _require_text(what, "column", channel.column)
    if not channel.column:
        raise JointIdError(f"{what}: no column is chosen.")
    where = f"{what} ({channel.column:.60})"
    _require_one_of(where, "unit", channel.unit, units)
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
        raise JointIdError(f"{where}: {meaning} is 0: it must not be.")
    return Channel(channel.column, channel.unit, scale, channel.side, channel.sign)


def _require_text(where: str, key: str, value: object) -> None:
    if not isinstance(value, str):
        raise JointIdError(f"{where}: {key} = {shown(value)}; expected text.")


def _require_one_of(where: str, key: str, value: object, known: Sequence[str]) -> None:
    if value not in known:
        raise JointIdError(f"{where}: {key} = {shown(value)}; expected one of {listed(known)}.")


def _positive(name: str, value: float) -> float:
    number = float(finite_array(name, value, ndim=0))
    if number <= 0:
        raise JointIdError(f"{name} = {number:g}: must be positive.")
    return number


def _refuse_time(
    table: LogTable, unit: TimeColumn, row: int, time: float, before: float, steps: Floats
) -> None:
    fault = "repeats" if time == before else "goes back from"
    word = "" if unit.unit == SAMPLES else f" {unit.unit}"
    if time == before and np.mean(steps == 0) > 0.2:
        remedy = (
            "The clock is coarser than the samples: number the rows instead (no time column, unit "
            '"samples", with the sample rate).'
        )
    else:
        remedy = "Times must increase: choose another time column, or cut the log there."
    raise JointIdError(
        f'{table.place(row)}, column "{unit.column}": {time:.12g}{word} {fault} {before:.12g}{word}. {remedy}'
    )
