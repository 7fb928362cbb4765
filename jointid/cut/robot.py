"""The robot that cuts: the example arm with K and D from a study.

The paper states neither the geometry of its robot nor the parameters that it calls non-optimal. The cut
therefore always uses the example arm. Its K and D follow from the study by one of four rules:

- *direct*: two joints, and the study's inertias are those of the example arm at the cutting pose. K
  and D apply unchanged.
- *springs*: the inertias are those of the example arm with the other drive. K and D apply unchanged, to
  an arm that is not the study's.
- *relative*: two joints of another robot. Stiffness errors act on a path through their ratio K̂/K: the
  joints deflect by u/K and the servo compensates u/K̂. The arm has the paper's stiffnesses, and all
  values of joint j (K, D, nominal values, standard errors) are multiplied by the same factor
  K_paper,j / K_j, which preserves the study's ratios K̂/K, D̂/D and D/K and its relative errors.
- *demonstration*: a study without two joints does not apply. The arm has the paper's K and D, known
  within 1 % and 5 %.
"""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from jointid.analysis import Analysis
from jointid.arrays import Floats
from jointid.cut.arm import Drive, PlanarArm, require_two_joints
from jointid.errors import JointIdError
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.gears.gear import Gear
from jointid.joints import Elasticity, Inertia
from jointid.wording import enumerated, with_error

Rule = Literal["direct", "springs", "relative", "demonstration"]
Assumption = Literal["study", "rigid", "soft", "stiff", "custom"]

CUTTING_POINT_M = (1.15, 0.0)
"""Tool position of the cut, where the inertias are compared with the study's."""
PAPER = Elasticity(K=(43.0, 7.5), D=(0.10, 0.015))
"""The values that the paper identified, motor side, N·m/rad and N·m·s/rad."""
SOFT, STIFF = 0.4, 3.0
"""K̂ / K of two wrongly tuned controllers; this software's own choice."""
NOMINAL_NAMES: dict[Assumption, str] = {
    "study": "nominal",
    "rigid": "rigid",
    "soft": f"{SOFT:g} K",
    "stiff": f"{STIFF:g} K",
    "custom": "custom",
}
"""Names of the controller before the identification."""

DEMONSTRATION = (
    "The paper's values (K = 43, 7.5 N·m/rad, D = 0.10, 0.015 N·m·s/rad) on the example arm, as if K "
    "were known to 1 % and D to 5 %."
)
"""Description of the cut without a study."""
RULES: dict[Rule, str] = {
    "direct": "The inertias of this study are those of the example arm at the cutting pose with a "
    "{drive} drive: its K and D apply unchanged.",
    "springs": "K and D of this study apply unchanged, but its inertias are those of the other drive: "
    "the simulated arm is not the study's robot.",
    "relative": "The inertias of this study's robot differ from the example arm's; its geometry is not "
    "known. The cut is that of the example arm with the paper's K = 43, 7.5 N·m/rad; the ratios of "
    "nominal to identified values, D/K and the relative errors are those of this study.",
    "demonstration": "A cut in the plane needs a study of two joints. This is a demonstration, not this "
    f"study's robot. {DEMONSTRATION}",
}
"""Description of each rule for the user; see ``CutRobot.meaning``."""

_DRIVES: tuple[Drive, ...] = get_args(Drive)
_SAME_INERTIA = 0.05
"""Relative difference within which inertias count as equal: their usual accuracy."""
_DEMONSTRATED = np.array([0.005, 0.005, 0.025, 0.025])
"""Relative standard errors of K1, K2, D1, D2 of the demonstration: half of 1 % and of 5 %."""
_HARDLY_KNOWN = 1 / 3
"""Relative standard error above which K and D give no meaningful path error."""


@dataclass(frozen=True)
class CutFriction:
    """Friction at the two motors, motor side."""

    coulomb: tuple[float, ...]
    """N·m."""
    viscous: tuple[float, ...]
    """N·m·s/rad."""


@dataclass(frozen=True, eq=False)
class CutRobot:
    """The arm that cuts, with K, D and friction from a study; motor side."""

    rule: Rule
    """Rule by which the study applies to this arm; see the module docstring."""
    arm: PlanarArm
    elasticity: Elasticity
    """Identified K and D."""
    covariance: Floats
    """Their covariance in the order K1, K2, D1, D2, shape (4, 4)."""
    nominal: Elasticity | None
    """Nominal K and D of the study; None when not stated."""
    friction: CutFriction | None
    """Identified friction; None when it was not fitted."""
    scale: tuple[float, float] = (1.0, 1.0)
    """Factor of each joint on the study's values."""
    gears: tuple[Gear, ...] = ()
    """Identified laws of the gears, where one is not linear."""

    @property
    def laws(self) -> tuple[Gear, ...] | None:
        """Gear laws for ``track``, with K = 0 (the elasticity has K); None if all are linear."""
        return tuple(replace(gear, K=0.0) for gear in self.gears) or None

    @property
    def meaning(self) -> str:
        """Description of the robot that cuts."""
        return RULES[self.rule].format(drive=self.arm.drive)

    def of_the_study(self, elasticity: Elasticity) -> Elasticity:
        """Scale values of this arm to the study."""
        return _scaled(elasticity, 1 / np.array(self.scale))


def cut_robot(analysis: Analysis, drive: Drive | None = None) -> CutRobot:
    """Return the example arm with K and D from a study.

    Its drive is by default that whose inertias are the study's, else the parallelogram. Raises
    JointIdError when the identified values are unphysical, or too uncertain for a path error.
    """
    study, fit = analysis.study, analysis.fit
    if fit.n != 2:
        return demonstration(drive or "parallelogram")
    if reason := reason_unusable(analysis):
        raise JointIdError(reason)
    identified = fit.elasticity
    matching = _matching_drive([study.inertia, *study.poses.values()])
    drive = drive or matching or "parallelogram"
    rule: Rule = "relative"
    factor = PAPER.K / identified.K
    if matching is not None:
        rule, factor = "direct" if drive == matching else "springs", np.ones(2)
    both = np.concatenate([factor, factor])
    return CutRobot(
        rule,
        PlanarArm.example(drive),
        _scaled(identified, factor),
        np.asarray(both[:, None] * fit.covariance * both),
        None if study.nominal is None else _scaled(study.nominal, factor),
        _friction(analysis, factor),
        (float(factor[0]), float(factor[1])),
        tuple(gear.scaled(float(f)) for gear, f in zip(fit.gears, factor, strict=True))
        if any(gear.kind != "linear" for gear in fit.gears)
        else (),
    )


def demonstration(drive: Drive = "parallelogram") -> CutRobot:
    """Return the example arm with the paper's K and D, known to 1 % and 5 %."""
    value = np.concatenate([PAPER.K, PAPER.D])
    covariance = np.diag((_DEMONSTRATED * value) ** 2)
    return CutRobot("demonstration", PlanarArm.example(drive), PAPER, covariance, None, None)


def reason_unusable(analysis: Analysis) -> str:
    """Reason why an identification gives no path error; empty otherwise."""
    for finding in analysis.findings:
        if finding.level == "problem":
            return f"The answer cannot be used for a cut. Resolve this finding first: {finding.title}."
    fit = analysis.fit
    value = np.concatenate([fit.elasticity.K, fit.elasticity.D])
    error = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    wide = np.flatnonzero(~(error <= _HARDLY_KNOWN * np.abs(value)))
    if wide.size == 0:
        return ""
    names = [elasticity_labels(fit.n)[k] for k in wide]
    k = int(wide[0])
    first = with_error(float(fit.estimate[k]), float(error[k]))
    return (
        f"{enumerated(names)} {'is' if wide.size == 1 else 'are'} not known well enough for a path "
        f"error: {names[0]} = {first}, an error bar of more than "
        "a third of the value. Add records near the resonances, or follow the findings."
    )


def assumed_elasticity(
    robot: CutRobot, assumption: Assumption, custom: Elasticity | None = None
) -> Elasticity | None:
    """Return K and D that the servo assumes before the identification; None is a rigid controller.

    They are the study's nominal values, 0.4 ("soft") or 3 times ("stiff") the identified stiffnesses, or
    ``custom``: motor side, in the study's units, scaled like its nominal values. Raises JointIdError
    when the study has no nominal values, or the custom ones are missing.
    """
    if assumption not in get_args(Assumption):
        choices = ", ".join(f'"{name}"' for name in get_args(Assumption))
        raise JointIdError(f'assumption = "{assumption}": expected one of {choices}.')
    if assumption == "rigid":
        return None
    if assumption in ("soft", "stiff"):
        ratio = SOFT if assumption == "soft" else STIFF
        return Elasticity(K=ratio * robot.elasticity.K, D=robot.elasticity.D)
    chosen = robot.nominal if assumption == "study" else custom
    if chosen is None:
        what = "The study's [nominal]" if assumption == "study" else "The custom controller"
        raise JointIdError(f"{what} has no K and D: add them, or choose another nominal controller.")
    require_two_joints(chosen, "nominal controller")
    return _scaled(chosen, np.array(robot.scale)) if assumption == "custom" else chosen


def _matching_drive(inertias: list[Inertia]) -> Drive | None:
    """Drive whose example arm has one of these inertias at the cutting pose."""
    for drive in _DRIVES:
        arm = PlanarArm.example(drive)
        known = arm.inertia(arm.inverse(CUTTING_POINT_M))
        scale = np.sqrt(np.outer(np.diag(known.M2), np.diag(known.M2)))
        for inertia in inertias:
            rotors = np.abs(inertia.M / known.M - 1).max()
            links = (np.abs(inertia.M2 - known.M2) / scale).max()
            if max(rotors, links) <= _SAME_INERTIA:
                return drive
    return None


def _friction(analysis: Analysis, factor: Floats) -> CutFriction | None:
    """Friction of the fit times a factor; values negative by noise become zero."""
    found = analysis.fit.friction
    if found is None:
        return None
    coulomb, viscous = (factor * np.maximum(v, 0.0) for v in (found.coulomb, found.viscous))
    return CutFriction(tuple(coulomb.tolist()), tuple(viscous.tolist()))


def _scaled(elasticity: Elasticity, factor: Floats) -> Elasticity:
    return Elasticity(K=factor * elasticity.K, D=factor * elasticity.D)
