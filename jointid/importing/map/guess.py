"""Guess which columns are positions and torques, each guess with its reason.

Columns without names are distinguished by their roughness and order.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats
from jointid.importing.columns.column_words import (
    RATED_SHARE,
    WORDS,
    all_described,
    drive_object,
    in_thousandths,
    states_quantity,
    words_of,
)
from jointid.importing.columns.log_table import LogColumn, LogTable
from jointid.importing.columns.units import POSITION_SCALES, QUANTITIES, TIME_UNITS
from jointid.importing.map.column_pairs import (
    NO_COLUMN,
    Pair,
    behind_gear,
    best_column,
    clearest_pair,
    pairs_by_name,
)
from jointid.importing.map.guess_time import guess_time, is_clock_like
from jointid.importing.map.mapping import (
    ARM,
    JOINT,
    MAX_JOINTS,
    MOTOR,
    Channel,
    JointMapping,
    Mapping,
    TimeColumn,
)
from jointid.importing.map.reasons import Reason
from jointid.importing.map.unwrap import unwrapped

_ALIKE = 0.9  # ratio of the ranges of two positions from which they move alike
_RAW = 20.0  # range of whole numbers from which they may be raw values of a drive
_Said = tuple[str, bool, str]
"""A guess, whether the file states it, and why."""
_ODRIVE = re.compile(r"(?i)\bpos_(?:rel|abs|estimate)\b|odrive")
"""Names of positions in ODrive's object tree: "pos_vel_mapper.pos_rel"; or its own."""
_NO_RATIO = (
    "Logs do not state it. Give motor turns per joint turn, negative if they turn in opposite "
    "directions; 1 is assumed."
)
_NO_SIGN = "Logs do not state it. Assumed: a positive torque accelerates towards positive positions."


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
    columns = all_described([c for c in table.columns if c.name != time.column])
    pairs = pairs_by_name(columns, reasons)
    if not pairs:
        pairs = pairs_by_shape(table, time, [c.column for c in columns], reasons)
    if not pairs:
        pairs = clearest_pair(columns, reasons)
    if len(pairs) > MAX_JOINTS:
        reasons.append(Reason("joints", f"{len(pairs)} pairs fit; the first {MAX_JOINTS} are proposed."))
    pairs = pairs[:MAX_JOINTS]
    degrees = any(guess_unit("position", each)[:2] == ("deg", False) for each, _ in pairs)
    groups = {c.column.name: c.group for c in columns}
    arms = {
        entry.group: entry.column
        for entry in reversed(behind_gear(columns))
        if guess_unit("position", entry.column)[0] not in POSITION_SCALES
    }
    behind = [arms.get(groups.get(position.name, "")) for position, _ in pairs]
    alike = [
        arm is not None and _move_alike(pair[0], arm) for pair, arm in zip(pairs, behind, strict=True)
    ]
    like = alike.index(True) + 1 if True in alike else 0
    joints = tuple(
        _joint(k, pair, arm, like, degrees, reasons)
        for k, (pair, arm) in enumerate(zip(pairs, behind, strict=True), start=1)
    )
    hold = "Logs do not state whether the torque is held between samples; not held is assumed."
    reasons.append(Reason("torque hold", hold))
    unproven = dict.fromkeys(reason.what for reason in reasons if not reason.sure)
    return Guess(Mapping(time, joints, assumed=tuple(unproven)), tuple(reasons))


def _joint(
    number: int, pair: Pair, behind: LogColumn | None, like: int, degrees: bool, reasons: list[Reason]
) -> JointMapping:
    """Mapping of a joint, with the sensor behind its gear if there is one.

    The position of joint ``like``, if any, moves like the sensor behind its gear.
    """
    sides = {role: _side(role, pair) for role in QUANTITIES}
    if behind is not None and _move_alike(pair[0], behind):
        sides["position"] = JOINT, True, f'It moves like "{behind.name}", which is behind the gear.'
    elif behind is None and like and not sides["position"][1]:
        sides["position"] = JOINT, False, f"As for joint {like}, which is logged behind its gear."
    position, torque = (
        _channel(role, number, column, guess_unit(role, column, degrees), side, reasons)
        for (role, side), column in zip(sides.items(), pair, strict=True)
    )
    arm = None
    if behind is not None:
        arm = Channel(behind.name, guess_unit("position", behind)[0], None, JOINT)
        why = f'The name of "{behind.name}" indicates a sensor behind the gear.'
        reasons.append(Reason(f"{ARM} of joint {number}", why))
    joint = JointMapping(position, torque, arm=arm)
    reasons += _drive_reasons(number, joint)
    turned = unwrapped(pair[0].values[np.isfinite(pair[0].values)], position)
    if turned.jumps.size:
        reasons.append(Reason(f"wrap-around of position of joint {number}", turned.note(position), True))
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
    named = RATED_SHARE.search(column.name)
    if named and in_thousandths(column.name, column.values):
        why = f'Whole numbers under CiA 402\'s name "{named[0]}": thousandths of the rated value.'
        return "‰", False, why
    if WORDS["current"] & set(words_of(column.name)):
        return "A", False, "The name indicates current; amperes are assumed."
    if named:
        why = f'"{named[0]}" is in thousandths in CiA 402, but these are not whole numbers'
        return "N·m", False, f"{why}; newton metres are assumed."
    why = "The file names no unit; newton metres are assumed."
    values = column.values[np.isfinite(column.values)]
    if values.size and np.ptp(values) >= _RAW and np.all(values == np.round(values)):
        why += " Whole numbers may be raw values, such as ‰ of the rated torque."
    return "N·m", False, why


def _side(role: str, pair: Pair) -> _Said:
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
        (degrees, JOINT, False, "Assumed from the unit: degrees indicate joint angles. Confirm."),
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
    return MOTOR, False, "The name does not state the side; the motor side is assumed."


def propose_joint(
    table: LogTable, number: int, like: tuple[Channel, Channel], used: Collection[str]
) -> tuple[JointMapping, list[Reason]]:
    """Propose unused columns for joint ``number``, with the reasons.

    Sides are those of the first joint, ``like``, and units where the file states none. ``used`` are the
    columns of the time and of other joints. A channel's column is "" when no column is left.
    """
    free = all_described([column for column in table.columns if column.name not in used])
    channels: list[Channel] = []
    reasons: list[Reason] = []
    for role, first in zip(QUANTITIES, like, strict=True):
        column = best_column(free, role)
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


_NO_NAME = re.compile(
    r"(?:column|signal|unnamed|var|ch|channel|data)[ _:]*\d*(?: \(\d+\))?|\d+", re.IGNORECASE
)
_NUMBER = re.compile(r"[ _\[(]*\d+[\])]?$")
_CLEAR = 0.05  # difference in log-roughness per joint above which a layout is clear
_MAX_SAMPLES = 200_000  # for the roughness
_DERIVATIVE = 0.1
"""Relative difference below which a column is the derivative of another, in that one's unit per s."""


def pairs_by_shape(
    table: LogTable, time: TimeColumn, columns: Sequence[LogColumn], reasons: list[Reason]
) -> list[tuple[LogColumn, LogColumn]]:
    """Pair 2n unnamed columns as n positions and n torques; add the reasons, none of which is certain.

    A position is a torque integrated twice, hence the smoother signal. Usual orders are all positions,
    then all torques, or joint by joint; either quantity may be first. Clocks, and columns that are the
    derivative of another, are left out. Three columns give one joint; other odd numbers, columns of
    another kind, and several joints with a torque as smooth as a position give none.
    """
    columns = [
        c for c in columns if np.nanmax(c.values) > np.nanmin(c.values) and not is_clock_like(c.values)
    ]
    columns = _without_velocities(table, time, columns)
    n = len(columns) // 2
    if not 0 < n <= MAX_JOINTS or any(c.unit for c in columns) or not _unnamed(columns):
        return []
    rough = np.log([_roughness(c.values) for c in columns])
    if len(columns) == 3:  # one joint, of the smoothest column and the roughest
        columns, rough = [columns[k] for k in np.argsort(rough)[[0, 2]]], np.sort(rough)[[0, 2]]
    elif len(columns) % 2:
        return []
    blocks = [(k, n + k) for k in range(n)]
    interleaved = [(2 * k, 2 * k + 1) for k in range(n)]
    layouts = [blocks, [(t, q) for q, t in blocks], interleaved, [(t, q) for q, t in interleaved]]
    gains = [float(sum(rough[t] - rough[q] for q, t in layout)) / n for layout in layouts]
    best = int(np.argmax(gains))
    if gains[best] < gains[0] + _CLEAR:
        best = 0  # the usual order
    at_q, at_t = np.array(layouts[best]).T
    if n > 1 and rough[at_q].max() > rough[at_t].min():
        return []  # the columns include further quantities, such as currents
    for number, (q, t) in enumerate(layouts[best], start=1):
        for role, k, how in (("position", q, "smoother"), ("torque", t, "rougher")):
            why = f"it is the {how} one" if gains[best] >= _CLEAR else "of its place"
            text = f'No column has a name; "{columns[k].name}" is only a proposal, because {why}. '
            reasons.append(Reason(f"{role} of joint {number}", text + "Check it in the figure."))
    return [(columns[q], columns[t]) for q, t in layouts[best]]


def _unnamed(columns: Sequence[LogColumn]) -> bool:
    """Whether names have no meaning, or are those of one array: "log 1", "log 2" of a variable log."""
    stems = {_NUMBER.sub("", column.name) for column in columns}
    one = len(stems) == 1 and not states_quantity(columns[0])
    return one or all(_NO_NAME.fullmatch(column.name) for column in columns)


def _without_velocities(
    table: LogTable, time: TimeColumn, columns: Sequence[LogColumn]
) -> list[LogColumn]:
    if not time.column or time.unit not in TIME_UNITS or not 0 < len(columns) <= 3 * MAX_JOINTS:
        return [*columns]
    seconds = table.column(time.column).values[:_MAX_SAMPLES] * TIME_UNITS[time.unit]
    values = np.column_stack([column.values[: seconds.size] for column in columns])
    if seconds.size < 50 or np.any(np.diff(seconds) <= 0) or not np.isfinite(values).all():
        return [*columns]
    sizes = np.abs(values).max(axis=0)
    values = values / sizes  # squares of damaged values overflow
    slopes = np.gradient(values, seconds, axis=0)
    with np.errstate(all="ignore"):  # a constant or overflowing slope explains nothing
        factors = slopes.T @ values / (slopes**2).sum(axis=0)[:, None]
        left = 1 - factors * (slopes.T @ values) / (values**2).sum(axis=0)
        of_slope = np.abs(factors * sizes / sizes[:, None] - 1) < _DERIVATIVE
        is_slope = (of_slope & (left < _DERIVATIVE**2) & ~np.eye(len(columns), dtype=bool)).any(axis=0)
    return [column for column, slope in zip(columns, is_slope, strict=True) if not slope]


def _roughness(values: Floats) -> float:
    """Standard deviation of the second differences over that of the values: large for noise."""
    finite = values[np.isfinite(values)][:_MAX_SAMPLES]
    if finite.size < 3 or not np.any(finite):
        return 1.0
    finite = finite / np.abs(finite).max()  # the squares of damaged numbers overflow
    size = float(np.std(finite))
    if size == 0:
        return 1.0
    return max(float(np.std(np.diff(finite, 2))) / size, 1e-300)
