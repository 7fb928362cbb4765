"""Mapping to JSON and back."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from jointid.errors import JointIdError
from jointid.importing.map.mapping import Channel, JointMapping, Mapping, TimeColumn
from jointid.wording import listed, nearest, shown

_MAX_LENGTH = 1 << 20


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
    """Read a mapping written by ``mapping_to_json``.

    Raises
    ------
    JointIdError
        When the text is not a mapping; the message names key and value.
    """
    if len(text) > _MAX_LENGTH:
        raise JointIdError(
            f"The mapping has {len(text)} characters, more than the limit of {_MAX_LENGTH}: choose one "
            "that was saved here."
        )
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise JointIdError(
            f"The mapping is not JSON ({error!s:.120}): choose one that was saved here."
        ) from error
    top = _keys("mapping", values, ("format", "time", "joints", "torque_hold", "torque_delay_s"))
    if top.get("format") != 1:
        raise JointIdError(
            f"mapping: format = {shown(top.get('format'))}; this version reads format 1. Save the "
            "mapping anew."
        )
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
