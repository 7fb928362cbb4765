"""Mapping to JSON and back."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from typing import Any

from jointid.errors import JointIdError
from jointid.importing.map.mapping import Channel, JointMapping, Mapping, TimeColumn
from jointid.wording import listed, nearest, shown

_MAX_LENGTH = 1 << 20


def mapping_to_json(mapping: Mapping) -> str:
    """Write a mapping as JSON; ``mapping_from_json`` reads it back exactly."""
    return json.dumps({"format": 1} | asdict(mapping), ensure_ascii=False, indent=1)


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
    top = _keys("mapping", values, Mapping, "format")
    version = top.pop("format", None)
    if version != 1:
        raise JointIdError(
            f"mapping: format = {shown(version)}; this version reads format 1. Save the mapping anew."
        )
    joints = top.get("joints")
    if not isinstance(joints, list):
        raise JointIdError(f"mapping: joints = {shown(joints)}; expected a list.")
    top["time"] = TimeColumn(**_keys("time", top.get("time"), TimeColumn))
    top["joints"] = tuple(_joint_from(number, joint) for number, joint in enumerate(joints, start=1))
    return Mapping(**top)


def _joint_from(number: int, values: object) -> JointMapping:
    joint = _keys(f"joint {number}", values, JointMapping)
    for what in ("position", "torque"):
        where = f"{what} of joint {number}"
        given = _keys(where, joint.get(what), Channel)
        for key in ("column", "unit"):
            if key not in given:
                raise JointIdError(f"{where}: {key} is missing in the mapping.")
        joint[what] = Channel(**given)
    try:
        return JointMapping(**joint)
    except JointIdError as error:
        raise JointIdError(f"joint {number}: {error}") from error


def _keys(where: str, values: object, kind: type[Any], *more: str) -> dict[str, Any]:
    """Return the keys of an object for the fields of a dataclass; refuse other keys."""
    known = [*more, *(field.name for field in fields(kind))]
    if not isinstance(values, dict):
        raise JointIdError(f"{where}: expected keys {listed(known)}, got {shown(values)}.")
    for key in values:
        if key not in known:
            raise JointIdError(f'{where}: unknown key "{key:.60}".{nearest(key, known)}')
    return dict(values)
