"""Guess which columns are positions and torques, each guess with its reason."""

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from jointid.importing.columns.column_words import (
    WORDS,
    NamedColumn,
    described,
    drive_object,
    words_of,
)
from jointid.importing.columns.log_table import LogColumn, LogTable
from jointid.importing.columns.units import POSITION_SCALES, QUANTITIES
from jointid.importing.map.guess_time import guess_time
from jointid.importing.map.mapping import (
    ARM,
    JOINT,
    MAX_JOINTS,
    MOTOR,
    Channel,
    JointMapping,
    Mapping,
)
from jointid.importing.map.reasons import Reason
from jointid.importing.map.unnamed_columns import pairs_by_shape
from jointid.importing.map.unwrap import unwrapped
from jointid.wording import counted

NO_COLUMN = LogColumn("", np.zeros(0))
"""In the place of a column that nothing indicates."""
_OTHER = {"position": "torque", "torque": "position"}
_CLEAR = 1.5  # score of a position whose name or unit says so
_ALIKE = 0.9  # range of one position over that of another from which they move alike
_MAX_LESS_CLEAR = 0.5  # score below the least clear pair, up to which an unpaired column is reported
_Group = dict[str, NamedColumn]
"""The clearest column of each role of one joint."""
_Groups = dict[str, _Group]
_Pair = tuple[LogColumn, LogColumn]
"""Position and torque."""
_Said = tuple[str, bool, str]
"""A guess, whether the file states it, and why."""
_ODRIVE = re.compile(r"(?i)\bpos_(?:rel|abs|estimate)\b|odrive")
"""Names of positions in ODrive's object tree: "pos_vel_mapper.pos_rel"; or its own."""
_NO_RATIO = (
    "Logs do not state it. Give motor turns per joint turn, negative if they turn in opposite "
    "directions; 1 is assumed."
)
_NO_SIGN = "Logs do not state it. Assumed: a positive torque accelerates to positive positions."


@dataclass(frozen=True)
class Guess:
    """A mapping to start from."""

    mapping: Mapping
    reasons: tuple[Reason, ...]


def guess_mapping(table: LogTable) -> Guess:
    """Guess time, positions and torques of a log from names, units and the numbers themselves.

    Every entry has a reason; a role that no column fits has none ("") until the user chooses one. Scales
    and gear ratios are never in a log: they are 1 until the user gives them.
    """
    reasons: list[Reason] = []
    time = guess_time(table, reasons)
    columns = [described(c) for c in table.columns if c.name != time.column]
    pairs = _pairs(columns, reasons)
    if not pairs:
        pairs = pairs_by_shape(table, time, [c.column for c in columns], reasons)
    if not pairs:
        pairs = _first_two(columns, reasons)
    if len(pairs) > MAX_JOINTS:
        reasons.append(Reason("joints", f"{len(pairs)} pairs fit; the first {MAX_JOINTS} are proposed."))
    pairs = pairs[:MAX_JOINTS]
    degrees = any(guess_unit("position", each)[:2] == ("deg", False) for each, _ in pairs)
    groups = {c.column.name: c.group for c in columns}
    arms = {
        entry.group: entry.column
        for entry in reversed(_behind(columns))
        if guess_unit("position", entry.column)[0] not in POSITION_SCALES
    }
    joints = tuple(
        _joint(k, pair, arms.get(groups.get(pair[0].name, "")), degrees, reasons)
        for k, pair in enumerate(pairs, start=1)
    )
    hold = "Logs do not state whether the torque is held between samples; not held is assumed."
    reasons.append(Reason("torque hold", hold))
    unproven = dict.fromkeys(reason.what for reason in reasons if not reason.sure)
    return Guess(Mapping(time, joints, assumed=tuple(unproven)), tuple(reasons))


def _pairs(columns: Sequence[NamedColumn], reasons: list[Reason]) -> list[_Pair]:
    """Position and torque of each joint, joints in the order of their numbers, else of the file."""
    best: _Groups = {}
    behind = {id(entry) for entry in _behind(columns)}
    for entry in columns:
        for role in _OTHER:
            if not _fits(entry, role) or id(entry) in behind:
                continue
            group = best.setdefault(entry.group, {})
            if role not in group or entry.score[role] > group[role].score[role]:
                group[role] = entry
    complete = {key: group for key, group in best.items() if len(group) == 2}
    by_their_number = _join_by_number(best, complete)
    keys = [*complete]
    numbers = {key: complete[key]["position"].number for key in keys}
    if None not in numbers.values():
        keys.sort(key=lambda key: (numbers[key] or 0, key))
    pairs = []
    for number, key in enumerate(keys, start=1):
        group = complete[key]
        for role in _OTHER:
            column = group[role].column
            clear = group[role].score[role] >= 2 and key not in by_their_number
            said = f'"{column.name}"' + (f" [{column.unit}]" if column.unit else "")
            why = f"{said} fits best, but neither name nor unit is clear."
            if key in by_their_number:
                why = f"{said} is paired by its number alone: check that both belong to one joint."
            elif clear:
                why = f"The name or unit of {said} indicates {role}."
            reasons.append(Reason(f"{role} of joint {number}", why, clear))
        pairs.append((group["position"].column, group["torque"].column))
    reasons += _lone_columns(best.values(), complete.values())
    return pairs


def _fits(entry: NamedColumn, role: str) -> bool:
    return entry.score[role] > max(0.0, entry.score[_OTHER[role]])


def _best(columns: Iterable[NamedColumn], role: str) -> LogColumn:
    """Column that fits a role best; ``NO_COLUMN`` where none fits."""
    fit = max(columns, key=lambda column: column.score[role], default=None)
    return NO_COLUMN if fit is None or not _fits(fit, role) else fit.column


def _behind(columns: Sequence[NamedColumn]) -> list[NamedColumn]:
    """Clear positions behind the gear, each beside a position of the same joint at the motor."""
    positions = [c for c in columns if _fits(c, "position") and c.score["position"] >= _CLEAR]
    found = []
    for entry in positions:
        words = set(words_of(entry.column.name))
        beside = [set(words_of(c.column.name)) for c in positions if c.group == entry.group]
        link = words & WORDS["link"] and any(not other & WORDS["link"] for other in beside)
        angle = "q" in words and any("theta" in other for other in beside)
        found += [entry] if (link or angle) and not words & WORDS["motor"] else []
    return found


def _first_two(columns: Sequence[NamedColumn], reasons: list[Reason]) -> list[_Pair]:
    """Return one joint when no two columns belong together: the clearest column of each role, if any."""
    moves = [c for c in columns if np.nanmax(c.column.values) > np.nanmin(c.column.values)]
    varying = moves or [*columns]
    if len(varying) < 2:
        text = f"{counted(len(varying), 'column')} of changing values beside the time: a log needs two."
        reasons.append(Reason("joints", text))
    pair: list[LogColumn] = []
    for role in _OTHER:
        pair.append(_best(varying, role))
        why = f'"{pair[-1].name}" fits best as {role}; no name pairs it with another column.'
        if pair[-1] is NO_COLUMN:
            why = f"No name or unit identifies the {role}: choose its column."
        reasons.append(Reason(f"{role} of joint 1", why))
    return [(pair[0], pair[1])]


def _joint(
    number: int, pair: _Pair, behind: LogColumn | None, degrees: bool, reasons: list[Reason]
) -> JointMapping:
    """Mapping of a joint, with the sensor behind its gear if there is one."""
    sides = {role: _side(role, pair) for role in QUANTITIES}
    if behind is not None and _move_alike(pair[0], behind):
        sides["position"] = JOINT, True, f'It moves like "{behind.name}", which is behind the gear.'
    position, torque = (
        _channel(role, number, column, guess_unit(role, column, degrees), side, reasons)
        for (role, side), column in zip(sides.items(), pair, strict=True)
    )
    arm = None
    if behind is not None:
        arm = Channel(behind.name, guess_unit("position", behind)[0], None, JOINT)
        why = f'The name of "{behind.name}" says that it is behind the gear.'
        reasons.append(Reason(f"{ARM} of joint {number}", why))
    joint = JointMapping(position, torque, arm=arm)
    reasons += _drive_reasons(number, joint)
    turned = unwrapped(pair[0].values[np.isfinite(pair[0].values)], position)
    if turned.jumps.size:
        reasons.append(Reason(f"turns of position of joint {number}", turned.note(position), True))
    return joint


def _drive_reasons(number: int, joint: JointMapping) -> list[Reason]:
    """Reasons for the directions, the gear ratio and the scales that a joint needs."""
    needed = [Reason(f"direction of {role} of joint {number}", _NO_SIGN) for role in QUANTITIES]
    needed += [Reason(f"gear ratio of joint {number}", _NO_RATIO)] if joint.needs_ratio else []
    for role, (_, scales) in QUANTITIES.items():
        unit = getattr(joint, role).unit
        if unit in scales:
            why = f'Give the scale of the unit "{unit}" ({scales[unit]}); 1 is assumed.'
            needed.append(Reason(f"scale of {role} of joint {number}", why))
    return needed


def _channel(
    role: str, number: int, column: LogColumn, unit: _Said, side: _Said, reasons: list[Reason]
) -> Channel:
    """Channel of a column with a guessed unit and side, and a scale of 1 where the unit needs one."""
    end = f"{role} of joint {number}"
    for what, (_, sure, why) in (("unit", unit), ("side", side)):
        reasons.append(Reason(f"{what} of {end}", why, sure))
    return Channel(column.name, unit[0], 1.0 if unit[0] in QUANTITIES[role][1] else None, side[0])


def _move_alike(position: LogColumn, behind: LogColumn) -> bool:
    """Whether two positions in one unit cover the same range: there is no gear between them."""
    low, high = sorted(float(np.nanmax(x.values) - np.nanmin(x.values)) for x in (position, behind))
    return position.unit == behind.unit and low > _ALIKE * high


def guess_unit(role: str, column: LogColumn, degrees: bool = False) -> _Said:
    """Return a unit, whether the file states it, and why; ``degrees`` if another joint suggests them."""
    if column.unit in QUANTITIES[role][0]:
        return column.unit, True, f"Stated in the file: {column.unit}."
    return _torque_unit(column) if role == "torque" else _angle_unit(column, degrees)


def _angle_unit(column: LogColumn, degrees: bool) -> _Said:
    values = column.values[np.isfinite(column.values)]
    if not values.size:
        return "rad", False, "Radians, until a column is chosen."
    if _ODRIVE.search(column.name):
        return "rev", False, "ODrive states positions in turns; the file names no unit."
    whole = bool(np.all(values == np.round(values)))
    span = 2 * (0.5 * float(values.max()) - 0.5 * float(values.min()))
    if whole and span >= 20:
        return "counts", False, f"Whole numbers over a range of {span:g}: encoder counts."
    largest = float(np.abs(values).max())
    if largest > 20:
        return "deg", False, f"Values up to {largest:.4g} suggest degrees."
    if degrees:
        return "deg", False, "The values of another joint suggest degrees."
    return "rad", False, f"Values up to {largest:.4g} suggest radians."


def _torque_unit(column: LogColumn) -> _Said:
    if drive_object(column.name):
        return "‰", False, "Torque and current of CiA 402 are thousandths of the rated value."
    if WORDS["current"] & set(words_of(column.name)):
        return "A", False, "The name indicates current; ampere is assumed."
    return "N·m", False, "The file names no unit; newton metres are assumed."


def _side(role: str, pair: _Pair) -> _Said:
    """Side of the gear on which a position or torque is measured: the first rule that fits."""
    column, is_effort = pair[role == "torque"], "effort" in words_of(pair[1].name)
    unit, words = column.unit, set(words_of(column.name))
    at_motor, degrees = WORDS["motor"] & words, role == "position" and unit == "deg"
    is_current = unit in ("A", "mA", "%", "‰") or WORDS["current"] & words
    torque = (
        (is_current, MOTOR, True, "Currents and shares of the rated torque belong to the motor."),
        (is_effort, JOINT, False, "An effort is given at the joint by convention."),
        (WORDS["behind"] & words, JOINT, False, "The name indicates the joint, link or output."),
    )
    assumed = "Assumed from the column name: positions are at the joint. Confirm."
    of_effort = "Where the torque is an effort, the position is the joint's by convention."
    position = (
        (_ODRIVE.search(column.name), MOTOR, False, "ODrive states the position of the motor."),
        (WORDS["joint"] & words, JOINT, False, assumed),
        (degrees, JOINT, False, "Controllers show joint angles in degrees."),
        (is_effort, JOINT, False, of_effort),
        (unit == "counts", MOTOR, False, "Counts usually come from the motor's encoder."),
    )
    for fits, side, sure, why in (
        (at_motor and degrees, MOTOR, False, "The name indicates the motor, degrees the joint."),
        (at_motor, MOTOR, True, "The name indicates the motor."),
        *(torque if role == "torque" else position),
    ):
        if fits:
            return side, sure, why
    return MOTOR, False, "The name does not state the side; the motor's is assumed."


def _join_by_number(best: _Groups, complete: _Groups) -> set[str]:
    """Pair unpaired positions and torques that share a number, in both; return the new keys."""
    lone: dict[str, dict[int, list[str]]] = {role: {} for role in _OTHER}
    for key, group in best.items():
        number = next(iter(group.values())).number
        if len(group) == 1 and number is not None:
            (role,) = group
            lone[role].setdefault(number, []).append(key)
    if (0 in lone["position"]) != (0 in lone["torque"]):
        if all(lone.values()):
            complete.clear()  # one kind counts from 0, the other from 1
        return set()
    taken = {group["position"].number for group in complete.values()}
    joined = set()
    for number in [k for k in lone["position"] if k in lone["torque"] and k not in taken]:
        pair: _Group = {}
        for role in _OTHER:
            clearest = max(lone[role][number], key=lambda key, r=role: best[key][r].score[r])  # type: ignore[misc]
            pair |= best.pop(clearest)
        best[str(number)] = complete[str(number)] = pair
        joined.add(str(number))
    return joined


def _lone_columns(groups: Iterable[_Group], pairs: Collection[_Group]) -> list[Reason]:
    """Report clear positions without a torque and torques without a position, beside pairs."""
    lone = [
        f'"{entry.column.name}" has no {_OTHER[role]} beside it'
        for group in groups
        for role, entry in group.items()
        if len(group) == 1
        and pairs
        and entry.score[role] >= min(pair[role].score[role] for pair in pairs) - _MAX_LESS_CLEAR
    ]
    text = f"{'; '.join(lone)}: left out. If the log has both, add a joint and choose its columns."
    return [Reason("joints", text)] if lone else []


def propose_joint(
    table: LogTable, number: int, like: tuple[Channel, Channel], used: Collection[str]
) -> tuple[JointMapping, list[Reason]]:
    """Propose unused columns for joint ``number``, with the reasons.

    Sides are those of the first joint, ``like``, and units where the file states none. ``used`` are the
    columns of the time and of other joints. A channel's column is "" when no column is left.
    """
    free = [described(column) for column in table.columns if column.name not in used]
    channels: list[Channel] = []
    reasons: list[Reason] = []
    for role, first in zip(QUANTITIES, like, strict=True):
        column = _best(free, role)
        free = [other for other in free if other.column is not column]
        text = f'"{column.name}" is only a proposal from the unused columns.'
        if column is NO_COLUMN:
            text = "No other column fits: choose one, or reduce the number of joints."
        reasons.append(Reason(f"{role} of joint {number}", text))
        unit: _Said = first.unit, False, f"As for joint 1: {first.unit}."
        if column.unit in QUANTITIES[role][0]:
            unit = guess_unit(role, column)
        side = first.side, False, f"As for joint 1: {first.side} side."
        channels.append(_channel(role, number, column, unit, side, reasons))
    joint = JointMapping(channels[0], channels[1])
    return joint, [*reasons, *_drive_reasons(number, joint)]
