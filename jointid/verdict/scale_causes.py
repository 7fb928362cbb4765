"""What makes a factor between torque and acceleration: the likely causes by its size, joint by joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jointid.arrays import Floats
from jointid.verdict.evidence import Action, Finding, number, problem
from jointid.wording import capitalised

_DEGREES = np.pi / 180
_CLOSE = 1.03
"""A factor this close to a known one is named by it: a fit found it, with inertias somewhat off."""
_ROUGH = 1.1
"""The same where friction or something else that is wrong draws the factor off."""
_NEAR = 1.35
"""A factor this close to a known one is worth a hint, but a gear ratio is as likely."""
LARGEST_GEAR_RATIO = 1000.0
"""What a gear of a robot can have; a larger ratio, or less than one over it, explains nothing."""
_GRAMS = 1e-3
"""A factor that inertias in g·m² make in all joints, as positions in mrad do."""
_SAME_FOR_ALL = 0.02
"""Time is common to the joints: factors that differ by no more than this may come from it."""


class _Cause(NamedTuple):
    factor: float
    """Torque over acceleration, measured over expected."""
    title: str
    """After "The position of joint 1" or the like."""
    signal: str
    """"position" or "torque"; "inertia" and "time" are common to all joints."""
    why: str
    remedy: str
    """With {} for the joints."""


_KNOWN = (
    _Cause(
        _DEGREES,
        "looks given in degrees",
        "position",
        "a position in degrees that was taken for radians (180/π = 57.3)",
        "Set the unit of the position of {} to deg on import, or multiply it by π/180",
    ),
    _Cause(
        1 / _DEGREES,
        "looks converted from degrees though it is in radians",
        "position",
        "a position in radians that was taken for degrees (180/π = 57.3)",
        "Set the unit of the position of {} to rad on import, or multiply it by 180/π",
    ),
    _Cause(
        _DEGREES**2,
        "looks given in degrees, and its gear ratio 57.3 times too large",
        "position",
        "degrees for radians twice, in the position and in the gear ratio ((180/π)² = 3283)",
        "Check the unit of the position of {}, degrees or radians, and the gear ratio",
    ),
    _Cause(
        _DEGREES**-2,
        "looks converted from degrees twice",
        "position",
        "radians for degrees twice, in the position and in the gear ratio ((180/π)² = 3283)",
        "Check the unit of the position of {}, degrees or radians, and the gear ratio",
    ),
    _Cause(
        2 * np.pi,
        "looks given in revolutions",
        "position",
        "a position in revolutions that was taken for radians (2π)",
        "Set the unit of the position of {} to rev on import, or multiply it by 2π",
    ),
    _Cause(
        1 / (2 * np.pi),
        "looks converted from revolutions though it is in radians",
        "position",
        "a position in radians that was taken for revolutions (2π)",
        "Set the unit of the position of {} to rad on import, or divide it by 2π",
    ),
    _Cause(
        1e3,
        "looks given in mN·m",
        "torque",
        "a torque in mN·m that was taken for N·m",
        "Set the unit of the torque of {} to mN·m on import, or divide it by 1000",
    ),
    _Cause(
        1e-3,
        "looks given in mrad",
        "position",
        "a position in mrad that was taken for rad",
        "Set the unit of the position of {} to mrad on import, or divide it by 1000",
    ),
)
_COMMON = (
    _Cause(
        1e6,
        "Time is probably in milliseconds, but was taken for seconds",
        "time",
        "accelerations go with the square of time, 1000² = 10⁶",
        "Set the unit of time to ms on import, or divide the time by 1000; the frequencies then "
        "are 1000 times higher",
    ),
    _Cause(
        1e-6,
        "Time is probably in seconds, but was taken for milliseconds",
        "time",
        "accelerations go with the square of time, 1000² = 10⁶",
        "Set the unit of time to s on import, or multiply the time by 1000; the frequencies then "
        "are 1000 times lower",
    ),
    _Cause(
        1e12,
        "Time is probably in microseconds, but was taken for seconds",
        "time",
        "accelerations go with the square of time, (10⁶)² = 10¹²",
        "Set the unit of time to µs on import, or divide the time by 10⁶; the frequencies then "
        "are 10⁶ times higher",
    ),
    _Cause(
        1e-12,
        "Time is probably in seconds, but was taken for microseconds",
        "time",
        "accelerations go with the square of time, (10⁶)² = 10¹²",
        "Set the unit of time to s on import, or multiply the time by 10⁶; the frequencies then "
        "are 10⁶ times lower",
    ),
    _Cause(
        1e-4,
        "M and M2 are probably in kg·cm²",
        "inertia",
        "1 kg·cm² is 10⁻⁴ kg·m²",
        "Set the unit of the entered M and M2 to kg·cm², or divide them by 10⁴ in study.toml",
    ),
)
_ACTIONS: dict[str, Action] = {"time": "edit mapping", "inertia": "edit inertias"}
COMMON_FACTORS = tuple(cause.factor for cause in _COMMON)
"""Factors that a wrong unit of time, or of M and M2, makes in all joints."""
POSITION_OR_TORQUE_FACTORS = tuple(cause.factor for cause in _KNOWN)
"""Factors that a wrong unit of position or torque makes in a joint."""


def diagnose_factor(
    factor: Floats, *, proof: str, duration_s: float, good: bool, side: str = ""
) -> Finding:
    """Finding that names the unit or gear ratio behind these factors.

    Parameters
    ----------
    factor : ndarray, shape (n,)
        Torque over acceleration of each joint, measured over expected.
    proof : str
        What the data say with and without these factors.
    duration_s : float
        Of the longest record, as it stands.
    good : bool
        Whether nothing else is wrong, once these factors are mended.
    side : {"", "torque", "angle", "both"}
        What alone explains the coupling of the joints, if scaled; empty when that is not seen.
    """
    n = factor.size
    effect = float(np.abs(np.log10(np.abs(factor))).max()) + 1
    common = next((cause for cause in _COMMON if _is_common(factor, cause.factor)), None)
    if common is not None:
        return _common_cause(common, factor, proof, duration_s, effect)
    wrong = np.flatnonzero(~np.isclose(factor, 1))
    groups: dict[_Cause | None, list[int]] = {}
    for j in wrong:
        groups.setdefault(_known(float(factor[j]), _CLOSE if good else _ROUGH), []).append(int(j))
    if list(groups) == [None]:
        return _unknown_cause(factor, wrong, proof, effect, side)
    titles, details, remedies = [], [], []
    for cause, joints in groups.items():
        whose = _joints(joints, n)
        values = _values(factor, joints)
        if cause is None:
            titles.append(f"the scale of {whose} looks wrong")
            details.append(f"{capitalised(whose)}: torque over acceleration is {values} times {_SAYS}.")
            remedies.append(_unknown_remedy(factor, joints))
            continue
        sign = " and the sign reversed" if factor[joints[0]] < 0 else ""
        grams = cause.factor == _GRAMS and len(joints) == n and not sign
        title = f"the {cause.signal} of {whose} {cause.title}{sign}"
        titles.append(f"M and M2 look given in g·m², or {title}" if grams else title)
        details.append(
            f"{capitalised(whose)}: torque over acceleration is {values} times {_SAYS}. That is "
            f"about what {cause.why} makes."
            + (
                " M and M2 in g·m² taken for kg·m² make the same: the records cannot tell."
                if grams
                else ""
            )
        )
        minus = " Reverse its sign as well." if sign else ""
        if grams:
            remedies.append(
                "Look up the unit of M and M2: if it is g·m², set it where they are entered, or divide "
                "them by 1000 in study.toml. If they are right:"
            )
        remedies.append(f"{cause.remedy.format(whose)}{_column(cause.signal, joints)}.{minus}")
    # A gear ratio may have the same size by chance.
    remedies.append("If the units are right, check the gear ratio.")
    return problem(
        capitalised("; ".join(titles)),
        f"{' '.join(details)} {proof}",
        " ".join(remedies),
        effect,
        "edit mapping",
    )


_SAYS = "what M and M2 say"


def _common_cause(
    cause: _Cause, factor: Floats, proof: str, duration_s: float, effect: float
) -> Finding:
    rest = factor / cause.factor
    left = np.flatnonzero(np.abs(np.log(np.abs(rest))) > np.log(1.1))
    lasts = f" The longest record then lasts {number(duration_s)} s." if cause.signal == "time" else ""
    detail = (
        f"Torque over acceleration is {_values(factor, range(factor.size))} times {_SAYS}: {cause.why}."
        f"{lasts} {proof}"
    )
    also = ""
    if left.size:
        also = (
            f" What then remains is {_values(rest, left)} in {_joints(left, factor.size)}: "
            f"{_unknown_remedy(rest, left)}"
        )
    return problem(cause.title, detail, f"{cause.remedy}.{also}", effect, _ACTIONS[cause.signal])


def _unknown_cause(factor: Floats, wrong: np.ndarray, proof: str, effect: float, side: str) -> Finding:
    whose = _joints(wrong, factor.size)
    size = np.abs(factor[wrong])
    ratios = np.maximum(size, 1 / size)
    square = np.sqrt(ratios)
    how = "applied once too often" if size.max() < 1 else "left out"
    gears = []
    if ratios.max() <= LARGEST_GEAR_RATIO:
        gears.append(f"A gear ratio of {_list(ratios)} would explain it, {how} in position or torque")
    if square.max() <= LARGEST_GEAR_RATIO:
        both = f"{_list(square)} in both"
        gears.append(
            both if gears else f"A gear ratio of {_list(square)} would explain it, {how} in both"
        )
    unit = f"a torque that is not in N·m, {_list(1 / size)} N·m to its unit"
    causes = f"{', or '.join(gears)}; so would {unit}." if gears else f"It may be {unit}."
    seen = f" {_SEEN[side]}" if side and gears else ""
    reversed_too = (
        " The sign is reversed as well, as where motor and joint turn against each other."
        if np.any(factor[wrong] < 0)
        else ""
    )
    rate = ""
    if wrong.size == factor.size > 1 and np.all(factor > 0) and np.ptp(np.log(factor)) < _SAME_FOR_ALL:
        # Accelerations go with the square of time, in all joints alike.
        right = np.sqrt(factor.mean())
        rate = (
            f" All joints agree, so a sampling rate of {number(right)} times what is given would, too."
        )
    return problem(
        f"A gear ratio, or the unit of the torque, looks wrong in {whose}",
        f"Torque over acceleration is {_values(factor, wrong)} times {_SAYS}. {causes}{seen}"
        f"{reversed_too}{rate} {proof}",
        _unknown_remedy(factor, wrong),
        effect,
        "edit mapping",
    )


_SEEN = {
    "torque": "The coupling between the joints says that it is the torque: it is on the other side of "
    "the gear than was taken, while the position is right; or its unit is another.",
    "angle": "The coupling between the joints says that it is the position: it is on the other side of "
    "the gear than was taken, while the torque is right.",
    "both": "The coupling between the joints says that it is both: position and torque are on the "
    "other side of the gear than was taken.",
}


def _unknown_remedy(factor: Floats, joints: Sequence[int] | np.ndarray) -> str:
    indices = [int(j) for j in joints]
    each = [f"{number(1 / abs(float(factor[j])))} for joint {j + 1}" for j in indices]
    return (
        "Check on import whether position and torque are of the motor or behind the gear, with "
        "which ratio; and the torque's unit: per cent of the rated torque, or amperes, need the rated "
        f"torque or the torque constant: the torque times {', '.join(each)} fits"
        f"{_column('torque', indices)}." + _hint([float(factor[j]) for j in indices])
    )


def _hint(factors: Sequence[float]) -> str:
    """Name the unit that makes a factor near these."""
    near = dict.fromkeys(cause.why for f in factors if (cause := _known(f, _NEAR)) is not None)
    return f" Not far from it: {'; '.join(near)}." if near else ""


def _known(factor: float, close: float) -> _Cause | None:
    for cause in _KNOWN:
        if abs(np.log(abs(factor) / cause.factor)) < np.log(close):
            return cause
    return None


def _is_common(factor: Floats, of_cause: float) -> bool:
    """Whether a common cause is behind the factors of all joints, alone or with a scale of each."""
    rest = np.abs(factor) / of_cause
    if np.any(factor <= 0) or factor.size == 0:
        return False
    alike = np.ptp(np.log(np.abs(factor))) < _SAME_FOR_ALL
    if of_cause == 1e-4:  # nothing but the unit itself tells M and M2 from a gear ratio
        return bool(alike and abs(np.log(rest[0])) < np.log(_CLOSE))
    return bool(np.all((rest > 1 / 30) & (rest < 30)))


def _joints(joints: Sequence[int] | np.ndarray, n: int) -> str:
    names = [str(int(j) + 1) for j in joints]
    if len(names) == n and n > 1:
        return "all joints"
    if len(names) == 1:
        return f"joint {names[0]}"
    return f"joints {', '.join(names[:-1])} and {names[-1]}"


def _column(signal: str, joints: Sequence[int] | np.ndarray) -> str:
    name = {"position": "theta_m{}_rad", "torque": "tau_m{}_Nm"}[signal]
    return f" ({', '.join(name.format(int(j) + 1) for j in joints)} in a study's tables)"


def _values(factor: Floats, joints: Sequence[int] | range | np.ndarray) -> str:
    return _list(np.array([factor[int(j)] for j in joints]))


def _list(values: Floats) -> str:
    return ", ".join(number(float(value), 3) for value in values)
