"""Sentences of findings on wrong data."""

from collections.abc import Callable, Iterable

import numpy as np

from jointid.arrays import Floats
from jointid.verdict.causes import (
    ACTIONS,
    ALIKE,
    CAUSES,
    CLOSE,
    GOOD,
    INACCURATE,
    LARGEST_GEAR_RATIO,
    NEAR,
    OTHER_CAUSES,
    ROUGH,
    SUBTLE,
    VELOCITY_UNITS,
    Cause,
    known_cause,
)
from jointid.verdict.evidence import Action, Change, Finding, number, problem, times_noise
from jointid.verdict.scorer import VELOCITY, Hypothesis
from jointid.wording import capitalised, enumerated, joints_text, listed


def finding_of(
    hypothesis: Hypothesis,
    before: float,
    after: float,
    side: Callable[[], str],
    duration_s: float,
    K: Floats,
) -> Finding:
    """Finding that names the fault.

    ``before`` and ``after`` are the misfits of the records as logged and as the hypothesis corrects
    them; ``side`` finds the scaled signal by the coupling of the joints ("torque", "angle", "both", or
    empty if undecided), ``duration_s`` the length of the longest record as logged, and ``K``,
    shape (n,), the stiffness of the corrected records.
    """
    proof = _proof(before, after)
    if hypothesis.kind in _WHOLE:
        title, detail, remedy, action = _WHOLE[hypothesis.kind]
        fields = {
            "gears": enumerated([number(value) for value in hypothesis.gear]),
            "unit": VELOCITY_UNITS.get(float(1 / hypothesis.scale[0]), ""),
            "K": f"{enumerated([number(k) for k in K])} N·m/rad",
            "q": listed(f"theta_m{j + 1}_rad" for j in range(K.size)),
            "tau": listed(f"tau_m{j + 1}_Nm" for j in range(K.size)),
        }
        return problem(title, f"{detail.format(**fields)} {proof}", remedy.format(**fields), 2.0, action)
    if hypothesis.kind in ("exchanged", "reversed axis"):
        return axes_look_wrong(hypothesis, proof)
    factor, good = hypothesis.factor, after <= GOOD
    wrong = np.flatnonzero(~np.isclose(factor, 1) | ~np.isclose(np.split(hypothesis.scale, 2)[0], 1))
    effect = float(np.abs(np.log10(np.abs(factor))).max()) + 1
    if np.all(np.isclose(np.abs(factor[wrong]), 1)):
        what = "position" if hypothesis.kind == "angle" else "torque"
        whose, columns = _joints(wrong, factor.size), _columns(what, wrong)
        return problem(
            f"The sign of the {what} of {whose} looks reversed",
            f"At low frequency the torque is opposite in sign to the value from M and M2. {proof}",
            f"Set the direction of the {what} of {whose} to reversed on import, or reverse the sign of "
            "the gear ratio if motor and joint turn in opposite directions. In a study, reverse the "
            f"sign of {columns} in its tables. A positive torque then accelerates the motor towards "
            "positive positions.",
            1.0,
            "edit mapping",
            *_changes(hypothesis),
        )
    common = next((c for c in CAUSES if c.is_common and _is_common(factor, c.factor)), None)
    if common is not None:
        return _common_cause(common, factor, proof, duration_s, effect)
    groups: dict[Cause | None, list[int]] = {}
    for j in wrong.tolist():
        groups.setdefault(known_cause(float(factor[j]), CLOSE if good else ROUGH), []).append(j)
    if None in groups and not good:  # with wrong inertias, a factor may match by chance
        groups = {None: wrong.tolist()}
    if list(groups) == [None]:
        return _unknown_cause(factor, wrong, proof, effect, side())
    titles, details, remedies = [], [], []
    changes = _changes(hypothesis) if good else []
    for cause, joints in groups.items():
        whose = _joints(joints, factor.size)
        values = f"{_values(factor[joints])} times {_EXPECTED}"
        is_ = f"{capitalised(whose)}: torque over acceleration is {values}."
        if cause is None:
            titles.append(f"the scale of the position or torque of {whose} looks wrong")
            details.append(is_)
            remedies.append(_unknown_remedy(factor, joints))
            continue
        reversed_too = bool(factor[joints[0]] < 0)
        title = f"the {cause.signal} of {whose} {cause.title}" + ", its sign reversed" * reversed_too
        other = (
            OTHER_CAUSES.get(cause.factor, "") if len(joints) == factor.size and not reversed_too else ""
        )
        titles.append(f"{other}, or {title}" if other else title)
        details.append(f"{is_} This is roughly the effect of {cause.why}.")
        if other or cause.factor in SUBTLE:
            changes = []  # the person decides
        if other:
            details.append(
                "M and M2 in g·m² read as kg·m² have the same effect; the records cannot distinguish "
                "the two."
            )
            remedies.append(
                "Check the unit of M and M2. If it is g·m², set this unit where they are entered, or "
                "divide them by 1000 in study.toml."
            )
        columns = _columns(cause.signal, joints)
        minus = " Reverse its sign as well." if reversed_too else ""
        remedy = cause.remedy.format(whose)
        if other:
            remedy = f"If M and M2 are right, {remedy[0].lower()}{remedy[1:]}"
        remedies.append(f"{remedy} ({columns} in the study's tables).{minus}")
    remedies.append(  # a factor may match a unit by chance
        "If the units are right, check the gear ratio and the rated torque or torque constant."
    )
    title = capitalised("; ".join(titles))
    return problem(
        title, f"{' '.join(details)} {proof}", " ".join(remedies), effect, "edit mapping", *changes
    )


_EXPECTED = "the value from M and M2"
_MOST_OF_INERTIAS = 10.0
"""Factor from which M and M2 are an unlikely cause."""
_WHOLE: dict[str, tuple[str, str, str, Action]] = {
    "inertia": (
        "M2 seems to be given on the joint side",
        "Converted with gear ratios of about {gears}, M2 fits the torques at low frequency.",
        "Enter M2 as a joint-side value, or divide element ij of M2 in study.toml by N_i·N_j, the gear "
        "ratios of joints i and j.",
        "edit inertias",
    ),
    "arm angle": (
        "The positions seem to be measured at the arm, not at the motors",
        "Read as positions behind the gears, they give K of about {K}.",
        "Choose the columns of the motors' encoders as positions ({q} in the study's tables). An "
        "encoder behind the gear does not show the motion of the motor, whatever the gear ratio.",
        "edit mapping",
    ),
    VELOCITY: (
        "The positions seem to be velocities",
        "Read as velocities in {unit}, they give K of about {K}.",
        "Choose the columns of the motors' positions ({q} in the study's tables), or integrate the "
        "velocities before the import.",
        "edit mapping",
    ),
    "gear torque": (
        "The torques seem to be measured behind the gears, not at the motors",
        "Read as torques behind the gears, which exclude the rotors, they give K of about {K}.",
        "Choose the columns of the motors' torques ({tau} in the study's tables), or add M times the "
        "motor's acceleration to them.",
        "edit mapping",
    ),
}
"""Title, detail, remedy and action of hypotheses on all joints."""
_SEEN = {
    "torque": "the torque, which seems to be measured on the other side of the gear or in another unit; "
    "the position looks right.",
    "angle": "the position, which seems to be measured on the other side of the gear; the torque looks "
    "right.",
    "both": "both: position and torque seem to be measured on the other side of the gear.",
}


def _changes(hypothesis: Hypothesis) -> list[Change]:
    """The corrections of a hypothesis, where all of its factors are known ones."""
    size = hypothesis.scale.size
    known = np.array([1.0, *(cause.factor for cause in CAUSES)])
    exact = np.isclose(np.abs(hypothesis.scale)[:, None], known, rtol=1e-9).any(axis=1).all()
    found = []
    if np.any(hypothesis.order != np.arange(size)):
        found.append(Change("order", (), tuple(hypothesis.order.astype(float).tolist())))
    if exact and np.any(hypothesis.scale != 1):
        found.append(Change("scale", (), tuple(hypothesis.scale.tolist())))
    return found


def axes_look_wrong(hypothesis: Hypothesis, proof: str) -> Finding:
    """Finding that names exchanged joints, a reversed one, or both."""
    n, what = hypothesis.gear.size, "inertias"
    found, remedies = [], []
    moved = np.flatnonzero(hypothesis.order != np.arange(2 * n))
    if moved.size:
        what = "torques" if moved[0] >= n else "inertias" if moved.size > 2 else "positions"
        joints = np.unique(moved % n).tolist()
        found.append(f"the {what} of joints {enumerated([f'{j + 1}' for j in joints])} look swapped")
        remedy = "Check that M, M2 and the columns have the same order of joints."
        if what != "inertias":
            columns = _columns(what[:-1], joints)
            remedy = f"Swap the columns of these {what} on import ({columns} in the study's tables)."
        remedies.append(remedy)
    for j in np.flatnonzero(hypothesis.scale[:n] < 0).tolist():
        which, others = ("1 or joint 2", "other") if n == 2 else (f"{j + 1}", "others")
        found.append(f"joint {which} looks reversed relative to the {others}")
    if np.any(hypothesis.scale[:n] < 0):
        remedies.append(
            "Check the sign of the coupling inertias. If it is right, reverse both position and torque "
            "of the reversed joint."
        )
    return problem(
        capitalised(", and ".join(found)),
        proof,
        " ".join(remedies),
        1.0,
        "edit inertias" if what == "inertias" else "edit columns",
        *_changes(hypothesis),
    )


def _proof(before: float, after: float) -> str:
    """Residual before and after the correction, with a hint at a second fault."""
    logged = times_noise(before) if np.isfinite(before) else "no fit with positive stiffness"
    proof = f"Residual as logged: {logged}; corrected: {times_noise(after)} (1 is ideal)."
    if after <= GOOD:
        return proof
    return (
        f"{proof} The cause of the remainder is friction, which this check omits, or a second fault. "
        "Correct this one first."
    )


def _common_cause(cause: Cause, factor: Floats, proof: str, duration_s: float, effect: float) -> Finding:
    rest = factor / cause.factor
    left = np.flatnonzero(np.abs(np.log(np.abs(rest))) > np.log(1.1))
    lasts = ""
    if cause.signal == "time":
        lasts = f" The longest record then lasts {number(duration_s / np.sqrt(cause.factor))} s."
    also = ""
    if left.size:
        also = (
            f" Remaining factor in {_joints(left, factor.size)}: {_values(rest[left])}. "
            f"{_unknown_remedy(rest, left)}"
        )
    other = OTHER_CAUSES.get(cause.factor, "")
    return problem(
        f"{other}, or {cause.title[0].lower()}{cause.title[1:]}" if other else cause.title,
        f"Torque over acceleration is {_values(factor)} times {_EXPECTED}: {cause.why}.{lasts} {proof}",
        f"{cause.remedy}.{also}",
        effect,
        ACTIONS[cause.signal],
    )


def _unknown_cause(factor: Floats, wrong: np.ndarray, proof: str, effect: float, side: str) -> Finding:
    whose, size = _joints(wrong, factor.size), np.abs(factor[wrong])
    ratios, turned = np.maximum(size, 1 / size), np.flatnonzero(factor < 0)
    title, sign, remedy = "A gear ratio, or the unit of the torque, looks wrong for", "", ""
    if turned.size:
        of = {"torque": "torque", "angle": "position"}.get(side, "position or torque")
        of = f"the {of} of {_joints(turned, factor.size)}"
        sign = f" The sign of {of} is reversed, as with a gear that reverses the direction."
        remedy = (
            f"Set the direction of {of} to reversed on import, or reverse the sign of the gear ratio. "
        )
        title = "The sign, and a gear ratio or the unit of the torque, look wrong for"
    gears = []
    for ratio, where in ((ratios, "position or torque"), (np.sqrt(ratios), "both")):
        if ratio.max() <= LARGEST_GEAR_RATIO and ratios.min() > INACCURATE:
            gears.append(f"{_values(ratio)} in {where}")
    causes = f"a torque in multiples of {_values(1 / size)} N·m."
    if gears:
        how = "applied once too often" if size.max() < 1 else "left out"
        causes = f"a gear ratio {how}: {', or '.join(gears)}; or {causes}"
        if side:
            causes += f" The coupling between the joints points to {_SEEN[side]}"
    of_size = " of the size of the factor" if sign else ""
    causes = f"{sign} The cause{of_size} may be {causes}"
    if ratios.max() < _MOST_OF_INERTIAS:
        title = title if sign else "A gear ratio, the unit of the torque, or M and M2 look wrong for"
        causes += " Wrong M and M2 have the same effect: check them as well."
    if sign and ratios.max() < INACCURATE:
        title, causes = (
            f"The sign of {of} looks reversed, and M and M2 look inaccurate for",
            (f"{sign} Inaccurate M and M2 are the likely cause of the size of the factor."),
        )
    if wrong.size == factor.size > 1 and np.all(factor > 0) and np.ptp(np.log(factor)) < ALIKE:
        # Accelerations go with the square of time, in all joints alike.
        right = number(np.sqrt(factor.mean()))
        causes += f" All joints give the same factor: a sample rate of {right} times the given one "
        causes += "has the same effect."
    return problem(
        f"{title} {whose}",
        f"Torque over acceleration is {_values(factor[wrong])} times {_EXPECTED}.{causes} {proof}",
        f"{remedy}{_unknown_remedy(factor, wrong)}",
        effect,
        "edit mapping",
    )


def _unknown_remedy(factor: Floats, joints: Iterable[int]) -> str:
    indices = [int(j) for j in joints]
    each = enumerated([f"{number(1 / abs(float(factor[j])))} for joint {j + 1}" for j in indices])
    near = dict.fromkeys(c.why for j in indices if (c := known_cause(float(factor[j]), NEAR)))
    return (
        "On import, check the side of the gear, the gear ratio and the unit of position and torque: a "
        "torque in % needs the rated torque, one in amperes the torque constant. "
        f"The data would fit with the torque multiplied by {each} ({_columns('torque', indices)} in "
        "the study's tables)." + (f" Similar factors: {'; '.join(near)}." if near else "")
    )


def _is_common(factor: Floats, of_cause: float) -> bool:
    """Whether a common cause explains the factors of all joints, alone or with a scale per joint."""
    if np.any(factor <= 0):
        return False
    rest = factor / of_cause
    if of_cause == 1e-4:  # only the unit itself separates M and M2 from a gear ratio
        return bool(np.ptp(np.log(factor)) < ALIKE and abs(np.log(rest[0])) < np.log(CLOSE))
    return bool(np.all((rest > 1 / 30) & (rest < 30)))


def _joints(joints: Iterable[int], n: int) -> str:
    numbers = [int(j) + 1 for j in joints]
    return "all joints" if len(numbers) == n > 1 else joints_text(numbers)


def _columns(signal: str, joints: Iterable[int]) -> str:
    name = {"position": "theta_m{}_rad", "torque": "tau_m{}_Nm"}[signal]
    return ", ".join(name.format(int(j) + 1) for j in joints)


def _values(values: Floats) -> str:
    texts = [number(float(value), 3) for value in values]
    return enumerated(texts if len(set(texts)) > 1 else texts[:1])
