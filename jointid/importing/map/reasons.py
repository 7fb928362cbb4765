"""Reasons for the entries of a guessed mapping, and its assumptions in words."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from jointid.importing.columns.units import QUANTITIES
from jointid.importing.map.mapping import ARM, Mapping
from jointid.wording import counted, enumerated


@dataclass(frozen=True)
class Reason:
    """Reason for one entry of a guessed mapping."""

    what: str
    """The entry: "time", "joints", "position of joint 1", "gear ratio of joint 1" ..."""
    text: str
    """The reason as a sentence, or the value that the user should give."""
    sure: bool = False
    """False where the file does not state it and the user should check."""


def grouped(reasons: Iterable[Reason]) -> dict[tuple[str, str, bool], list[str]]:
    """Return the joints of equal reasons, by entry, text and whether it is sure."""
    joints: dict[tuple[str, str, bool], list[str]] = {}
    for reason in reasons:
        entry, _, joint = reason.what.rpartition(" of joint ")
        key = entry or reason.what, reason.text, reason.sure
        joints.setdefault(key, []).extend([joint] if entry else [])
    return joints


def of_joints(joints: Sequence[str]) -> str:
    """Return " of joints 1 and 2", nothing without joints."""
    return f" of joint{'s' * (len(joints) > 1)} {enumerated(joints)}" if joints else ""


def assumptions(mapping: Mapping) -> tuple[str, ...]:
    """Return the assumed entries of a mapping with their values: "gear ratio 1 (joints 1 and 2)"."""
    joints: dict[str, list[str]] = {}
    for what in mapping.assumed:
        _, _, joint = what.rpartition(" of joint ")
        joints.setdefault(value_of(mapping, what), []).extend([joint] if joint != what else [])
    return tuple(
        f"{text} ({of_joints(each).removeprefix(' of ')})" if each else text
        for text, each in joints.items()
        if text
    )


def unchanged(mapping: Mapping, guessed: Mapping) -> tuple[str, ...]:
    """Assumed entries of a mapping, without those whose guessed values were corrected."""
    now = {what: value_of(mapping, what) for what in mapping.assumed}
    return tuple(what for what, value in now.items() if value_of(guessed, what) in ("", value))


def value_of(mapping: Mapping, what: str) -> str:
    """Return the value of an entry in words; empty where the mapping has no such entry."""
    entry, _, joint = what.rpartition(" of joint ")
    if not entry:
        time = mapping.time
        rate = "" if time.rate_hz is None else f" at {time.rate_hz:g} Hz"
        texts = {
            "time": f'time in "{time.column}"' if time.column else "rows numbered as time",
            "unit of time": f"time in {time.unit}{rate}",
            "joints": counted(mapping.n, "joint"),
            "torque hold": f"torque {'' if mapping.torque_hold else 'not '}held between samples",
        }
        return texts.get(what, "")
    if not joint.isdecimal() or not 1 <= int(joint) <= mapping.n:
        return ""
    of = mapping.joints[int(joint) - 1]
    if entry == "gear ratio":
        return f"gear ratio {of.gear_ratio:g}"
    if entry == ARM:
        return f'{ARM} in "{of.arm.column}"' if of.arm else ""
    kind, _, role = entry.rpartition(" of ")
    if role not in QUANTITIES:
        return ""
    channel = getattr(of, role)
    meaning, _, unit = QUANTITIES[role][1].get(channel.unit, "").partition(", ")
    texts = {
        "": f'{role} in "{channel.column}"',
        "unit": f"{role} in {channel.unit}",
        "scale": f"{meaning} {channel.scale:g} {unit}".strip() if meaning else "",
        "side": f"{role} measured at the {channel.side}",
        "direction": f"direction of {role} {'as logged' if channel.sign > 0 else 'reversed'}",
    }
    return texts.get(kind, "")
