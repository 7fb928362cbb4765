"""What an identification is worth on the path: a study's K and D, carried to a cut, in millimetres.

The paper prints neither the geometry of its robot nor the parameters that it calls non-optimal. So the
cut is always made by the example arm, and this file says which springs that arm gets:

- *direct*: two joints, and the study's inertias are those of the example arm at the cutting pose. Its K
  and D apply as they are.
- *springs*: the inertias are those of the example arm with the other drive. K and D apply as they are,
  but to an arm that is not the study's.
- *relative*: two joints of another robot. Stiffness errors act on a path through their ratio K̂/K: the
  springs deflect by u/K and the servo compensates u/K̂. So the arm gets the paper's stiffnesses, and all
  that belongs to joint j (K, D, nominal values, standard errors) is multiplied by the same factor
  K_paper,j / K_j. The study's ratios K̂/K, D̂/D and D/K, and its relative errors, stay what they are.
- *demonstration*: not two joints, so nothing of the study applies. The arm gets the paper's K and D,
  known within 1 % and 5 %.

The identified values are the best knowledge of the real robot. So the robot before has exactly these
springs, and its servo the nominal ones. The robot after differs from the identified values as far as
their covariance allows, while its servo assumes them. Both have the friction that the fit found, if it
looked for any (in *relative* times the same factor), and the same everyday controller.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np

from jointid.arrays import Floats
from jointid.cut.arm import Drive, PlanarArm
from jointid.cut.rectangle import rectangle
from jointid.cut.servo import MotorFrictionLike, Servo
from jointid.cut.tolerance import PathErrorDistribution, path_error_distribution
from jointid.cut.toolpath import Toolpath
from jointid.cut.tracking import TrackingRun, track
from jointid.errors import JointIdError
from jointid.joints import Elasticity, Inertia
from jointid.rounding import significant, with_error
from jointid.study import Analysis
from jointid.wording import counted

Rule = Literal["direct", "springs", "relative", "demonstration"]
Assumption = Literal["study", "rigid", "soft", "stiff", "custom"]

CUTTING_POINT_M = (1.15, 0.0)
"""Where the example arm cuts, and where its inertias are compared with a study's."""
PAPER = Elasticity(K=(43.0, 7.5), D=(0.10, 0.015))
"""The values that the paper identified, motor side, N·m/rad and N·m·s/rad."""
EVERYDAY_SERVO = Servo(
    sample_rate_hz=2000.0, delay_samples=1, encoder_bits=16, differentiated_velocity=True
)
"""A controller as there are many, this software's own choice; friction is not compensated."""
SOFT, STIFF = 0.4, 3.0
"""K̂ / K of two controllers that do not fit; this software's own choice."""

_DRIVES: tuple[Drive, ...] = get_args(Drive)
_SAME_INERTIA = 0.05
"""Inertias within 5 % of the example arm's count as its own: that is how well inertias are known."""
_DEMONSTRATED = np.array([0.005, 0.005, 0.025, 0.025])
"""Relative standard errors of K1, K2, D1, D2 of the demonstration: half of 1 % and of 5 %."""
_ALIKE = 0.1
"""Path errors within 10 % of each other do not tell robots apart."""
_HARDLY_KNOWN = 1 / 3
"""An error bar above this share of its value leaves nothing to be said of a path."""
_SMALLEST_SHOWN_M = 1e-6
"""The simulated arm is exact to about 1 µm."""


@dataclass(frozen=True)
class CutFriction:
    """Friction at the two motors, motor side."""

    coulomb: tuple[float, ...]
    """N·m."""
    viscous: tuple[float, ...]
    """N·m·s/rad."""


@dataclass(frozen=True, eq=False)
class CutRobot:
    """The arm that cuts, with what a study says of its springs; motor side."""

    rule: Rule
    """How the study's springs came to this arm; see the module's text."""
    arm: PlanarArm
    elasticity: Elasticity
    """Identified K and D."""
    covariance: Floats
    """Their covariance in the order K1, K2, D1, D2, shape (4, 4)."""
    nominal: Elasticity | None
    """What the study's controller assumes today; None when the study does not say."""
    friction: CutFriction | None
    """What the fit found at the motors; None when it did not look for any."""
    scale: tuple[float, float] = (1.0, 1.0)
    """By which factor all that belongs to each joint differs from the study's own values."""

    def on_this_arm(self, elasticity: Elasticity) -> Elasticity:
        """Values in the study's units, as this arm has them."""
        return _scaled(elasticity, np.array(self.scale))

    def of_the_study(self, elasticity: Elasticity) -> Elasticity:
        """Values of this arm in the study's units."""
        return _scaled(elasticity, 1 / np.array(self.scale))


class Promise(NamedTuple):
    """The cut after the identification; the fields are those of ``Outcome``."""

    after: TrackingRun
    edge: Elasticity
    distribution: PathErrorDistribution | None
    problem: str


@dataclass(frozen=True, eq=False)
class Outcome:
    """The same path, cut before and after the identification."""

    robot: CutRobot
    toolpath: Toolpath
    assumed: Elasticity | None
    """What the servo assumed before; None is a rigid controller."""
    before: TrackingRun
    """A robot with the identified springs; its servo has ``assumed``."""
    after: TrackingRun
    """A robot with the springs ``edge``; its servo assumes the identified ones."""
    edge: Elasticity
    """Of the robots that the fit's covariance allows, the one at the 95 % point of the path error."""
    distribution: PathErrorDistribution | None
    """Path errors of the robots drawn; None when the covariance allows no promise."""
    problem: str
    """Why there is no distribution; empty when there is."""

    @property
    def before_m(self) -> float:
        """Largest contour error of the controller before, m."""
        return self.before.max_contour_error_m

    @property
    def after_m(self) -> float:
        """Largest contour error of the robot ``edge``, m; 95 % of the robots drawn stay below it."""
        return self.after.max_contour_error_m

    @property
    def spread_m(self) -> float:
        """How far apart 90 % of the path errors of the robots drawn lie, m; NaN without any."""
        if self.distribution is None:
            return float("nan")
        low, high = np.percentile(self.distribution.max_contour_error_m, (5, 95))
        return float(high - low)

    @property
    def springs_matter(self) -> bool:
        """Whether what remains after the identification depends on how well it knows the springs.

        False where robots with other springs, as far as the fit allows them, cut practically alike:
        then friction and the controller set the error. True where this is not known.
        """
        return not self.spread_m < _ALIKE * self.after_m


def cut_robot(analysis: Analysis, drive: Drive | None = None) -> CutRobot:
    """Give the example arm the springs that a study speaks of.

    Parameters
    ----------
    analysis : Analysis
    drive : {"parallelogram", "serial"}, optional
        Left out: the drive whose inertias are the study's, else the parallelogram.

    Raises
    ------
    JointIdError
        When the identified values are no spring and damper, or cannot be used for millimetres.
    """
    study, fit = analysis.study, analysis.fit
    if fit.n != 2:
        value = np.concatenate([PAPER.K, PAPER.D])
        arm = PlanarArm.example(drive or "parallelogram")
        return CutRobot("demonstration", arm, PAPER, np.diag((_DEMONSTRATED * value) ** 2), None, None)
    if reason := useless(analysis):
        raise JointIdError(reason)
    identified = fit.elasticity
    matching = _matching_drive([study.inertia, *study.poses.values()])
    drive = drive or matching or "parallelogram"
    arm = PlanarArm.example(drive)
    if matching is not None:
        rule: Rule = "direct" if drive == matching else "springs"
        friction = _friction(analysis, np.ones(2))
        return CutRobot(rule, arm, identified, fit.covariance, study.nominal, friction)
    factor = PAPER.K / identified.K
    both = np.concatenate([factor, factor])
    return CutRobot(
        "relative",
        arm,
        _scaled(identified, factor),
        np.asarray(both[:, None] * fit.covariance * both),
        None if study.nominal is None else _scaled(study.nominal, factor),
        _friction(analysis, factor),
        (float(factor[0]), float(factor[1])),
    )


def useless(analysis: Analysis) -> str:
    """Say why no millimetres follow from an identification; empty where they do."""
    for finding in analysis.findings:
        if finding.level == "problem":
            return f"The answer cannot be used for a cut, because of what was found: {finding.title}."
    fit = analysis.fit
    value = np.concatenate([fit.elasticity.K, fit.elasticity.D])
    error = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    wide = np.flatnonzero(~(error <= _HARDLY_KNOWN * np.abs(value)))
    if wide.size == 0:
        return ""
    names = [f"{'K' if k < fit.n else 'D'}{k % fit.n + 1}" for k in wide]
    k = int(wide[0])
    return (
        f"{', '.join(names)} {'is' if wide.size == 1 else 'are'} not known well enough for millimetres: "
        f"{names[0]} = {with_error(float(value[k]), float(error[k]))}, an error bar of more than a "
        "third of the value. Add records near the resonances, or see what was found."
    )


def assumed_elasticity(
    robot: CutRobot, assumption: Assumption, custom: Elasticity | None = None
) -> Elasticity | None:
    """Return what the servo assumes before the identification; None is a rigid controller.

    Parameters
    ----------
    robot : CutRobot
    assumption : {"study", "rigid", "soft", "stiff", "custom"}
        The study's nominal values, rigid, 0.4 or 3 times the identified stiffnesses, or ``custom``.
    custom : Elasticity, optional
        For "custom", motor side, in the study's units: they are scaled like its nominal values.

    Raises
    ------
    JointIdError
        When the study has no nominal values, or the custom ones are missing.
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
        what = "[nominal] of the study" if assumption == "study" else "custom"
        raise JointIdError(f"{what} gives no K and D: add them, or choose another nominal controller.")
    if chosen.n != 2:
        raise JointIdError(
            f"The nominal values have {counted(chosen.n, 'joint')}; the planar arm has 2."
        )
    return robot.on_this_arm(chosen) if assumption == "custom" else chosen


def cut_outcome(
    robot: CutRobot,
    toolpath: Toolpath,
    assumed: Elasticity | None,
    *,
    servo: Servo | None = None,
    friction: MotorFrictionLike | None = None,
    samples: int = 100,
    seed: int = 0,
) -> Outcome:
    """Cut a path before and after the identification.

    Parameters
    ----------
    robot : CutRobot
    toolpath : Toolpath
    assumed : Elasticity or None
        What the servo assumed before, motor side; None is a rigid controller.
    servo, friction
        As in :func:`~jointid.cut.tracking.track`; the same before and after. Left out: the everyday
        controller, and no friction.
    samples : int
        Robots drawn from the fit's covariance.
    seed : int
        The same seed draws the same robots.

    Raises
    ------
    JointIdError
        When a cut cannot be made: the path leaves the workspace, or the loop is unstable.
    """
    servo = servo or EVERYDAY_SERVO
    before = track(robot.arm, toolpath, robot.elasticity, assumed, servo=servo, friction=friction)
    promise = promised(robot, toolpath, servo=servo, friction=friction, samples=samples, seed=seed)
    return with_promise(robot, toolpath, assumed, before, promise)


def promised(
    robot: CutRobot,
    toolpath: Toolpath,
    *,
    servo: Servo | None = None,
    friction: MotorFrictionLike | None = None,
    samples: int = 100,
    seed: int = 0,
) -> Promise:
    """Cut a path after the identification, as far as its uncertainty allows.

    Parameters and errors as in :func:`cut_outcome`.
    """
    identified, servo = robot.elasticity, servo or EVERYDAY_SERVO
    edge, distribution, problem = identified, None, ""
    try:
        distribution = path_error_distribution(
            robot.arm,
            toolpath,
            identified,
            robot.covariance,
            samples=samples,
            seed=seed,
            servo=servo,
            friction=friction,
        )
    except JointIdError as error:  # the cut itself may well be possible
        problem = str(error)
    else:
        largest = distribution.max_contour_error_m
        beyond = np.where(largest >= distribution.p95_m, largest, np.inf)
        at = int(np.argmin(beyond))  # 95 % stay below this robot's error: it is shown and told
        edge = Elasticity(K=distribution.K[at], D=distribution.D[at])
    after = track(robot.arm, toolpath, edge, identified, servo=servo, friction=friction)
    return Promise(after, edge, distribution, problem)


def with_promise(
    robot: CutRobot,
    toolpath: Toolpath,
    assumed: Elasticity | None,
    before: TrackingRun,
    promise: Promise,
) -> Outcome:
    """Put a cut before and a promise for after together; both of the same robot and path."""
    after, edge, distribution, problem = promise
    return Outcome(robot, toolpath, assumed, before, after, edge, distribution, problem)


def study_outcome(analysis: Analysis) -> Outcome | None:
    """Return what the identification changes on the paper's path, or None where no cut applies.

    Before, the servo has the study's nominal values; where there are none it takes the joints as rigid.

    Raises
    ------
    JointIdError
        As in :func:`cut_robot` and :func:`cut_outcome`.
    """
    robot = cut_robot(analysis)
    if robot.rule == "demonstration":
        return None
    path = rectangle(centre_m=CUTTING_POINT_M)
    return cut_outcome(robot, path, robot.nominal, friction=robot.friction)


def whose(robot: CutRobot) -> str:
    """Say which robot cuts: that of the study in its springs, on the example arm's geometry."""
    return {
        "direct": "an arm of this study's inertias and springs",
        "springs": "the example arm with this study's springs",
        "relative": "the example arm with this study's springs, scaled to it",
        "demonstration": "the example arm with the paper's springs",
    }[robot.rule]


def millimetres(length_m: float) -> str:
    """Write a path error for a person, "2.9 mm"; what the simulation does not resolve is not shown."""
    if length_m < _SMALLEST_SHOWN_M:
        return f"under {significant(1e3 * _SMALLEST_SHOWN_M, 1)} mm"
    return f"{significant(1e3 * length_m, 2 if length_m >= 1e-5 else 1)} mm"


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
    """Friction of the fit times a factor; what noise made negative counts as none."""
    found = analysis.fit.friction
    if found is None:
        return None
    coulomb, viscous = (factor * np.maximum(v, 0.0) for v in (found.coulomb, found.viscous))
    return CutFriction(tuple(coulomb.tolist()), tuple(viscous.tolist()))


def _scaled(elasticity: Elasticity, factor: Floats) -> Elasticity:
    return Elasticity(K=factor * elasticity.K, D=factor * elasticity.D)
