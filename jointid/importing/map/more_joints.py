"""Joints whose columns are not found in pairs: unpaired columns, and proposals for further joints."""

from __future__ import annotations

from collections.abc import Collection, Mapping, MutableMapping, Sequence

from jointid.importing.columns.column_words import NamedColumn, described, number_in
from jointid.importing.columns.log_table import LogTable
from jointid.importing.columns.units import QUANTITIES
from jointid.importing.map.mapping import JOINT, Channel
from jointid.importing.map.reasons import Reason, scale_reason

_OTHER = {"position": "torque", "torque": "position"}
_MAX_LESS_CLEAR = 0.5
"""Score below the least clear pair, up to which an unpaired column is reported."""


def join_by_number(
    best: MutableMapping[str, dict[str, NamedColumn]],
    complete: MutableMapping[str, dict[str, NamedColumn]],
) -> set[str]:
    """Pair unpaired positions and torques that share a number.

    Parameters
    ----------
    best, complete : mapping of str to mapping of str to NamedColumn
        All groups, and the complete ones; new pairs are added to both.

    Returns
    -------
    set of str
        The new keys of ``complete``.
    """
    lone: dict[str, dict[int, list[str]]] = {"position": {}, "torque": {}}
    for key, group in best.items():
        number = number_in(key)
        if len(group) == 1 and number is not None:
            (role,) = group
            lone[role].setdefault(number, []).append(key)
    if (0 in lone["position"]) != (0 in lone["torque"]):
        return set()  # one kind counts from 0, the other from 1
    taken = {number_in(key) for key in complete}
    joined = set()
    for number, keys in lone["position"].items():
        others = lone["torque"].get(number, [])
        if others and number not in taken:
            clearest = [
                max(each, key=lambda key, r=role: best[key][r].score[r])  # type: ignore[misc]
                for role, each in (("position", keys), ("torque", others))
            ]
            pair = best.pop(clearest[0]) | best.pop(clearest[1])
            key = str(number)
            best[key] = complete[key] = pair
            joined.add(key)
    return joined


def lone_columns(
    best: Mapping[str, Mapping[str, NamedColumn]], pairs: Sequence[Mapping[str, NamedColumn]]
) -> list[Reason]:
    """Report positions without a torque and torques without a position.

    Parameters
    ----------
    best : mapping of str to mapping of str to NamedColumn
        The clearest column of each role, by joint.
    pairs : sequence of mapping of str to NamedColumn
        Complete groups.
    """
    if not pairs:
        return []
    lone = []
    for group in best.values():
        for role, entry in group.items():
            least = min(pair[role].score[role] for pair in pairs) - _MAX_LESS_CLEAR
            if len(group) == 1 and entry.score[role] >= least:
                lone.append((entry.column.name, _OTHER[role]))
    if not lone:
        return []
    said = "; ".join(f'"{name}" has no {missing} beside it' for name, missing in lone)
    text = f"{said}: left out. If the log has both, give more joints and choose the columns."
    return [Reason("joints", text)]


def propose_joint(
    table: LogTable, number: int, like: tuple[Channel, Channel], used: Collection[str]
) -> tuple[Channel, Channel, list[Reason]]:
    """Propose unused columns for one more joint.

    Parameters
    ----------
    table : LogTable
    number : int
        Number of the new joint, from 1.
    like : tuple of Channel
        Position and torque of the first joint: their sides are used, and their units where the file
        states none.
    used : collection of str
        Columns of the time and of other joints.

    Returns
    -------
    tuple
        Position, torque and the reasons; a channel's column is "" when no column is left.
    """
    free = [described(column) for column in table.columns if column.name not in used]
    channels, reasons = [], []
    for (role, (units, scales)), first in zip(QUANTITIES.items(), like, strict=True):
        end = f"{role} of joint {number}"
        fit = max(free, key=lambda c, r=role: c.score[r], default=None)  # type: ignore[misc]
        if fit is not None and fit.score[role] <= max(0.0, fit.score[_OTHER[role]]):
            fit = None
        text, said = "No column is left that fits: choose one, or a joint less.", ""
        if fit is not None:
            free.remove(fit)
            text = f'"{fit.column.name}" is a mere proposal, of the columns not yet used.'
            said = fit.column.unit
        reasons.append(Reason(end, text))
        unit = said if said in units else first.unit
        why = f'The file says "{said}".' if unit == said else f"As joint 1's, {unit}."
        reasons.append(Reason(f"unit of {end}", why, unit == said))
        reasons.append(Reason(f"side of {end}", f"As joint 1's, the {first.side}'s."))
        if meaning := scales.get(unit):
            reasons.append(scale_reason(end, unit, meaning))
        scale = 1.0 if unit in scales else None
        channels.append(Channel(fit.column.name if fit else "", unit, scale, first.side))
    if JOINT in (channels[0].side, channels[1].side):
        text = "A log does not say it. Give motor turns over joint turns; 1 is assumed."
        reasons.append(Reason(f"gear ratio of joint {number}", text))
    return channels[0], channels[1], reasons
