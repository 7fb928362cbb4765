"""Path error before and after an identification: the same cut with nominal and with identified values.

Before: the simulated robot has the identified K and D, and its servo assumes the nominal ones. After:
its servo assumes the identified values, and the robot's K and D are drawn from their covariance. Both
simulations include the identified friction and gear laws, and the same default controller. ``robot.py``
defines the arm and its stiffness.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from jointid.analysis import Analysis
from jointid.cut.arm_simulation import fastest_mode
from jointid.cut.path_errors import PathErrorDistribution, path_error_distribution
from jointid.cut.rectangle import rectangle
from jointid.cut.robot import CUTTING_POINT_M, CutRobot, cut_robot
from jointid.cut.servo import MotorFrictionLike, Servo
from jointid.cut.toolpath import Toolpath
from jointid.cut.tracking import TrackingRun, track
from jointid.errors import JointIdError
from jointid.joints import Elasticity
from jointid.wording import enumerated, significant

TYPICAL_SERVO = Servo(
    sample_rate_hz=2000.0, delay_samples=1, encoder_bits=16, differentiated_velocity=True
)
"""A typical controller, this software's own choice; friction is not compensated."""
ZONES_M = (0.001, 0.005, 0.010)
"""Corner zones of the three shapes of Figure 7; the paper does not state their values."""
_STEPS_S = 5e-4, 2.5e-4
"""Step of the simulation, and that for arms with fast modes, s. A tenth of it changes the largest path
error by less than 1 µm."""
_LONG_STEP_PHASE = 0.25
"""Largest ω dt with the first of the steps."""
_ALIKE = 0.1
"""Path errors within 10 % of each other count as equal."""
_SMALLEST_SHOWN_M = 1e-6
"""Accuracy of the simulated arm, about 1 µm."""


class Prediction(NamedTuple):
    """The cut after the identification; the fields are those of ``Outcome``."""

    after: TrackingRun
    distribution: PathErrorDistribution | None
    problem: str


@dataclass(frozen=True, eq=False)
class Outcome:
    """The same path, cut before and after the identification."""

    robot: CutRobot
    toolpath: Toolpath
    assumed: Elasticity | None
    """K and D that the servo assumes before; None is a rigid controller."""
    before: TrackingRun
    """Cut of the robot with the identified K and D; its servo assumes ``assumed``."""
    after: TrackingRun
    """Cut of the robot drawn at the 95th percentile of the path error; its servo assumes the identified
    values."""
    distribution: PathErrorDistribution | None
    """Path errors of the robots drawn; None when the covariance is too large."""
    problem: str
    """Reason why there is no distribution; empty otherwise."""

    @property
    def before_m(self) -> float:
        """Largest contour error of the controller before, m."""
        return self.before.max_contour_error_m

    @property
    def after_m(self) -> float:
        """Largest contour error after, m: the 95th percentile of the robots drawn."""
        return self.after.max_contour_error_m

    @property
    def which(self) -> str:
        """Which of the simulated cuts ``after_m`` states, in two or three words."""
        return "95th percentile" if self.distribution is not None else "one simulation"

    @property
    def not_better(self) -> str:
        """Sentence where the servo before may cut as well as with the identified values; else empty."""
        if self.distribution is None or self.before_m > self.after_m:
            return ""
        return "Within the error bars, the path error is not smaller after identification than before."

    @property
    def spread_m(self) -> float:
        """Central 90 % range of the path errors of the robots drawn, m; NaN without any."""
        if self.distribution is None:
            return float("nan")
        low, high = np.percentile(self.distribution.max_contour_error_m, (5, 95))
        return float(high - low)

    @property
    def depends_on_elasticity(self) -> bool:
        """Whether the path error after the identification depends on the uncertainty of K and D.

        False if the robots drawn have practically equal errors, which then come from friction and the
        controller. True without a distribution.
        """
        return self.distribution is None or self.spread_m >= _ALIKE * self.after_m


def cut_outcome(
    robot: CutRobot,
    toolpath: Toolpath,
    assumed: Elasticity | None,
    *,
    servo: Servo = TYPICAL_SERVO,
    friction: MotorFrictionLike | None = None,
    samples: int = 100,
) -> Outcome:
    """Cut a path before and after the identification.

    Before, the servo assumes ``assumed``, motor side, or rigid joints; ``servo`` and ``friction`` are
    the same before and after, as in :func:`~jointid.cut.tracking.track`; ``samples`` robots are drawn
    from the fit's covariance. Raises JointIdError when the path leaves the workspace, or the loop is
    unstable.
    """
    before = cut_before(robot, toolpath, assumed, servo=servo, friction=friction)
    prediction = predicted_cut(robot, toolpath, servo=servo, friction=friction, samples=samples)
    return Outcome(robot, toolpath, assumed, before, *prediction)


def cut_before(
    robot: CutRobot,
    toolpath: Toolpath,
    assumed: Elasticity | None,
    *,
    servo: Servo = TYPICAL_SERVO,
    friction: MotorFrictionLike | None = None,
) -> TrackingRun:
    """Cut of the identified robot by a servo that assumes other K and D, or rigid joints.

    Parameters and errors as in :func:`cut_outcome`.
    """
    return _cut_by(robot, toolpath, servo, friction)(robot.elasticity, assumed)


def predicted_cut(
    robot: CutRobot,
    toolpath: Toolpath,
    *,
    servo: Servo = TYPICAL_SERVO,
    friction: MotorFrictionLike | None = None,
    samples: int = 100,
) -> Prediction:
    """Predict the path error after the identification, with its uncertainty.

    Parameters and errors as in :func:`cut_outcome`.
    """
    identified = robot.elasticity
    drawn, distribution, problem = identified, None, ""
    try:
        distribution = path_error_distribution(
            robot.arm,
            toolpath,
            identified,
            robot.covariance,
            samples=samples,
            servo=servo,
            friction=friction,
            gears=robot.laws,
            dt=_step_s(robot, toolpath),
        )
    except JointIdError as error:  # a single cut may still be possible
        problem = str(error)
    else:
        largest = distribution.max_contour_error_m
        beyond = np.where(largest >= distribution.p95_m, largest, np.inf)
        at = int(np.argmin(beyond))
        drawn = Elasticity(K=distribution.K[at], D=distribution.D[at])
    after = _cut_by(robot, toolpath, servo, friction)(drawn, identified)
    return Prediction(after, distribution, problem)


def cut_with_laws(
    robot: CutRobot,
    toolpath: Toolpath,
    *,
    servo: Servo = TYPICAL_SERVO,
    friction: MotorFrictionLike | None = None,
) -> TrackingRun:
    """Cut of a robot with nonlinear gears whose servo assumes their identified laws.

    Parameters and errors as in :func:`cut_outcome`.
    """
    cut = _cut_by(robot, toolpath, servo, friction)
    return cut(robot.elasticity, robot.elasticity, assumed_gears=robot.laws)


def _cut_by(
    robot: CutRobot, toolpath: Toolpath, servo: Servo, friction: MotorFrictionLike | None
) -> Callable[..., TrackingRun]:
    """Return the simulated cut as a function of the robot's K and D and those of the servo."""
    step = _step_s(robot, toolpath)
    return partial(track, robot.arm, toolpath, servo=servo, friction=friction, gears=robot.laws, dt=step)


def _step_s(robot: CutRobot, toolpath: Toolpath) -> float:
    long, short = _STEPS_S
    K, D = robot.elasticity.K, robot.elasticity.D
    fastest = fastest_mode(robot.arm, K, D, robot.arm.inverse(toolpath.start_m))
    return long if long * fastest <= _LONG_STEP_PHASE else short


def with_laws_text(run: TrackingRun) -> str:
    """State the path error of a servo that assumes the gear laws as well."""
    return (
        "If the servo assumes these laws as well, the path error is "
        f"{millimetres(run.max_contour_error_m)}."
    )


def study_outcome(analysis: Analysis) -> Outcome | None:
    """Return the cut before and after on the paper's path, or None for studies without a cut.

    Before, the servo assumes the study's nominal values, or rigid joints without such values. Raises
    JointIdError as :func:`cut_robot` and :func:`cut_outcome`.
    """
    robot = cut_robot(analysis)
    if robot.rule == "demonstration":
        return None
    path = rectangle(centre_m=CUTTING_POINT_M)
    return cut_outcome(robot, path, robot.nominal, friction=robot.friction)


def robot_text(robot: CutRobot) -> str:
    """Describe the robot that cuts: geometry, and origin of its stiffness."""
    return {
        "direct": "an arm with this study's inertias, K and D",
        "springs": "the example arm with this study's K and D",
        "relative": "the example arm with this study's K and D, scaled to it",
        "demonstration": "the example arm with the paper's K and D",
    }[robot.rule]


def millimetres(length_m: float) -> str:
    """Format a path error, "2.9 mm"; below the resolution of the simulation as "under 0.001 mm"."""
    if length_m < _SMALLEST_SHOWN_M:
        return f"under {significant(1e3 * _SMALLEST_SHOWN_M, 1)} mm"
    return f"{significant(1e3 * length_m, 2 if length_m >= 1e-5 else 1)} mm"


def at_most(length_m: float) -> str:
    """Format a limit of the path error, "below 2.9 mm"."""
    text = millimetres(length_m)
    return text if text.startswith("under") else f"below {text}"


def other_causes(robot: CutRobot, servo: Servo, friction: MotorFrictionLike | None) -> str:
    """Name the causes of path errors other than errors of K and D."""
    causes = {
        "the nonlinearity of the gears": bool(robot.gears),
        "friction": friction is not None and servo.friction_compensation is None,
        "delay": servo.delay_samples > 0,
        "encoder": servo.encoder_bits is not None,
    }
    return enumerated([name for name, acts in causes.items() if acts] or ["the controller's rate"])


def remaining_error_text(
    outcome: Outcome, servo: Servo = TYPICAL_SERVO, friction: MotorFrictionLike | None = None
) -> str:
    """Describe the remaining error of an outcome whose error does not depend on that of K and D."""
    left = millimetres(outcome.after_m)
    if left.startswith("under"):
        return f"The remaining error, {left}, is below the resolution of the simulation."
    named = other_causes(outcome.robot, servo, friction)
    text = (
        f"The remaining error, {left}, includes the effects of {named}; within the error bars of K and "
        f"D it changes by {millimetres(outcome.spread_m)} (95th percentile shown)."
    )
    if outcome.before_m < outcome.after_m and outcome.robot.gears:
        text += " It exceeds the error before identification: K and D alone do not describe these gears."
    elif outcome.before_m < outcome.after_m:
        wrong = (
            "the missing compensation cancels" if outcome.assumed is None else "the error of K cancels"
        )
        text += (
            f" The smaller error before identification is a coincidence: {wrong} part of the remaining "
            "error."
        )
    return text
