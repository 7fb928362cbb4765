"""Pair the columns of a log: position and torque of each joint."""

import re
from collections.abc import Collection, Iterable, Sequence

import numpy as np

from jointid.importing.columns.column_words import WORDS, NamedColumn, words_of
from jointid.importing.columns.log_table import LogColumn
from jointid.importing.map.reasons import Reason
from jointid.wording import counted

NO_COLUMN = LogColumn("", np.zeros(0))
"""Placeholder for a column that neither name nor unit indicates."""
_OTHER = {"position": "torque", "torque": "position"}
_CLEAR = 1.5  # score of a position whose name or unit says so
_MAX_LESS_CLEAR = 0.5  # score below the least clear pair, up to which an unpaired column is reported
_STEM = re.compile(r"[^a-z]*[0-9]")
"""End of the words before the first number of a name."""
_ADD_JOINT = "Add a joint and choose its columns."
_Group = dict[str, NamedColumn]
"""The clearest column of each role of one joint."""
_Groups = dict[str, _Group]
Pair = tuple[LogColumn, LogColumn]
"""Position and torque."""


def pairs_by_name(columns: Sequence[NamedColumn], reasons: list[Reason]) -> list[Pair]:
    """Position and torque of each joint, in the order of the joints' numbers, else of the file."""
    best: _Groups = {}
    behind = {id(entry) for entry in behind_gear(columns)}
    for entry in columns:
        for role in _OTHER:
            if not _fits(entry, role) or id(entry) in behind:
                continue
            group = best.setdefault(entry.group, {})
            if role not in group or entry.score[role] > group[role].score[role]:
                group[role] = entry
    complete = {key: group for key, group in best.items() if len(group) == 2}
    by_their_number, paired = _join_by_order(best, complete), "the order of the numbers"
    if not by_their_number:
        by_their_number, paired = _join_by_number(best, complete), "its number alone"
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
                why = f"{said} is paired by {paired}: check that both belong to one joint."
            elif clear:
                why = f"The name or unit of {said} indicates {role}."
            reasons.append(Reason(f"{role} of joint {number}", why, clear))
        pairs.append((group["position"].column, group["torque"].column))
    reasons += _lone_columns(best.values(), complete.values())
    return pairs


def _fits(entry: NamedColumn, role: str) -> bool:
    return entry.score[role] > max(0.0, entry.score[_OTHER[role]])


def best_column(columns: Iterable[NamedColumn], role: str) -> LogColumn:
    """Column that fits a role best; ``NO_COLUMN`` where none fits."""
    fit = max(columns, key=lambda column: column.score[role], default=None)
    return NO_COLUMN if fit is None or not _fits(fit, role) else fit.column


def behind_gear(columns: Sequence[NamedColumn]) -> list[NamedColumn]:
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


def clearest_pair(columns: Sequence[NamedColumn], reasons: list[Reason]) -> list[Pair]:
    """Return one joint when no two columns belong together: the clearest column of each role, if any."""
    moves = [c for c in columns if np.nanmax(c.column.values) > np.nanmin(c.column.values)]
    varying = moves or [*columns]
    if len(varying) < 2:
        found = f"{counted(len(varying), 'column')} with changing values besides time"
        reasons.append(Reason("joints", f"{found}: a log needs at least two."))
    pair: list[LogColumn] = []
    for role in _OTHER:
        pair.append(best_column(varying, role))
        why = f'"{pair[-1].name}" fits best as {role}; no name pairs it with another column.'
        if pair[-1] is NO_COLUMN:
            why = f"No name or unit identifies the {role}: choose its column."
        reasons.append(Reason(f"{role} of joint 1", why))
    left = [
        f'"{entry.column.name}"'
        for entry in varying
        for role, column in zip(_OTHER, pair, strict=True)
        if entry.column is not column
        and column is not NO_COLUMN
        and _fits(entry, role)
        and entry.score[role] >= _CLEAR
    ]
    if left:
        text = f"{'; '.join(left)}: left out, because their names do not show a pair. {_ADD_JOINT}"
        reasons.append(Reason("joints", text))
    return [(pair[0], pair[1])]


def _join_by_order(best: _Groups, complete: _Groups) -> set[str]:
    """Pair positions and torques of other numbers, "Axis 2, 3" with "Drive 4, 5"; return the new keys.

    Both kinds have names of their own, and count without a gap from their own first number.
    """
    entries = [
        sorted((g[role] for g in best.values() if role in g), key=lambda entry: entry.number or 0)
        for role in _OTHER
    ]
    position, torque = ([entry.number or 0 for entry in each] for each in entries)
    stems = [{_STEM.split(entry.column.name.casefold())[0] for entry in each} for each in entries]
    if complete or len(position) < 2 or len(position) != len(torque):
        return set()
    if stems[0] & stems[1] or set(position) & set(torque):
        return set()
    for found in (position, torque):
        if found[0] == 0 or found != [*range(found[0], found[0] + len(found))]:
            return set()
    best.clear()
    for pair in zip(*entries, strict=True):
        best[str(pair[0].number)] = dict(zip(_OTHER, pair, strict=True))
    complete |= best
    return set(best)


def _join_by_number(best: _Groups, complete: _Groups) -> set[str]:
    """Pair single positions and torques of one number, in both arguments; return the new keys."""
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
    """Report clear positions without a torque and torques without a position, where pairs exist."""
    lone = [
        f'"{entry.column.name}" has no matching {_OTHER[role]}'
        for group in groups
        for role, entry in group.items()
        if len(group) == 1
        and pairs
        and entry.score[role] >= min(pair[role].score[role] for pair in pairs) - _MAX_LESS_CLEAR
    ]
    text = f"{'; '.join(lone)}: left out. If the log has both, {_ADD_JOINT.lower()}"
    return [Reason("joints", text)] if lone else []
