"""What an identification is worth on the path: a cut before and one after, in millimetres.

The identified values are the best knowledge of the real robot. So the robot before has exactly these
springs, and its servo the nominal ones. The robot after differs from the identified values as far as
their covariance allows, while its servo assumes them. Both have the friction that the fit found, if it
looked for any, and the same everyday controller. Which arm it is and which springs it has: ``robot.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jointid.cut.rectangle import rectangle
from jointid.cut.robot import CUTTING_POINT_M, CutRobot, cut_robot
from jointid.cut.servo import MotorFrictionLike, Servo
from jointid.cut.tolerance import PathErrorDistribution, path_error_distribution
from jointid.cut.toolpath import Toolpath
from jointid.cut.tracking import TrackingRun, track
from jointid.errors import JointIdError
from jointid.joints import Elasticity
from jointid.rounding import significant
from jointid.study import Analysis

EVERYDAY_SERVO = Servo(
    sample_rate_hz=2000.0, delay_samples=1, encoder_bits=16, differentiated_velocity=True
)
"""A controller as there are many, this software's own choice; friction is not compensated."""
ZONES_M = (0.001, 0.005, 0.010)
"""Corner zones of Figure 7's three shapes; the paper prints no figures for them."""
_ALIKE = 0.1
"""Path errors within 10 % of each other do not tell robots apart."""
_SMALLEST_SHOWN_M = 1e-6
"""The simulated arm is exact to about 1 µm."""


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
