"""The servo of each motor: settings, and the sampled control loop that drives an arm along a plan.

Feedback is a PD controller of the motor angle around a reference; the feedforward torque is planned
beforehand (``feedforward.py``). Arm side inside; a name says motor where a value is the motor's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array
from jointid.errors import JointIdError

PROGRESS_CALLS = 50
LOST_RAD = 3.0
"""A motor this far from its reference, seen on the arm side, no longer follows anything."""


class MotorFrictionLike(Protocol):
    """Friction at the motors, τ = coulomb · sign(θ̇) + viscous · θ̇, for instance that of a fit."""

    @property
    def coulomb(self) -> ArrayLike:
        """One value or one per joint, N·m."""

    @property
    def viscous(self) -> ArrayLike:
        """One value or one per joint, N·m·s/rad."""


@dataclass(frozen=True, eq=False)
class Servo:
    """Settings of the joint controllers.

    Every option has its counterpart in the feedforward, so that a perfect model leaves no error that
    the option itself would cause: the feedforward runs ahead by the delay, and the reference of a
    differentiated velocity goes through the same difference and filter.

    Parameters
    ----------
    sample_rate_hz : float
        Control rate, Hz. Torque is held from one sample to the next.
    bandwidth_hz : float
        Natural frequency of the PD control on the rigid joint, Hz: kp = J ω² with J = B + diag M.
    damping_ratio : float
        Its damping ratio ζ: kv = 2 ζ J ω.
    delay_samples : int
        Whole samples between measurement and the torque computed from it.
    torque_limit_Nm : float or array_like, shape (2,), optional
        Largest motor torque, motor side, N·m.
    encoder_bits : int, optional
        The encoder divides a motor turn into 2^bits counts; None is an ideal encoder.
    differentiated_velocity : bool
        Velocity is the difference of two encoder positions over a sample; else it is measured exactly.
    velocity_filter_hz : float, optional
        First-order low-pass on that difference, Hz.
    friction_compensation : friction, optional
        What the controller assumes and adds to the torque, computed from the wanted motor velocity.
        Anything with ``coulomb`` and ``viscous``, for instance the friction of a fit.
    compensation_smoothing_rad_s : float
        Motor velocity over which the compensation's sign turns over (tanh), rad/s.

    Raises
    ------
    JointIdError
        When a value is out of range.
    """

    sample_rate_hz: float = 4000.0
    bandwidth_hz: float = 10.0
    damping_ratio: float = 1.0
    delay_samples: int = 0
    torque_limit_Nm: ArrayLike | None = None
    encoder_bits: int | None = None
    differentiated_velocity: bool = False
    velocity_filter_hz: float | None = None
    friction_compensation: MotorFrictionLike | None = None
    compensation_smoothing_rad_s: float = 0.2

    def __post_init__(self) -> None:
        for name, unit in [
            ("sample_rate_hz", "Hz"),
            ("bandwidth_hz", "Hz"),
            ("damping_ratio", ""),
            ("compensation_smoothing_rad_s", "rad/s"),
            ("velocity_filter_hz", "Hz"),
        ]:
            value = getattr(self, name)
            if value is None:
                continue
            number = float(finite_array(f"{name} ({unit})", value, ndim=0))
            if number <= 0:
                raise JointIdError(f"{name} = {number:g} {unit}: it must be positive.")
            object.__setattr__(self, name, number)
        if not 50 <= self.sample_rate_hz <= 20_000:
            raise JointIdError(
                f"sample_rate_hz = {self.sample_rate_hz:g} Hz: expected 50 Hz to 20000 Hz."
            )
        if not _whole(self.delay_samples) or not 0 <= self.delay_samples <= 100:
            raise JointIdError(
                f"delay_samples = {self.delay_samples!r}: expected a whole number of samples, 0 to 100."
            )
        if self.encoder_bits is not None and not (
            _whole(self.encoder_bits) and 4 <= self.encoder_bits <= 40
        ):
            raise JointIdError(
                f"encoder_bits = {self.encoder_bits!r}: expected a whole number of bits, 4 to 40."
            )
        if self.velocity_filter_hz is not None and not self.differentiated_velocity:
            raise JointIdError(
                "velocity_filter_hz filters a differentiated velocity: set differentiated_velocity too."
            )
        if self.torque_limit_Nm is not None:
            limit = per_joint("torque_limit_Nm (N·m)", self.torque_limit_Nm)
            if limit.min() <= 0:
                raise JointIdError(f"torque_limit_Nm is {limit.min():g} N·m: it must be positive.")
        if self.friction_compensation is not None:
            friction_values(self.friction_compensation)

    @property
    def interval_s(self) -> float:
        """Time from one control sample to the next, s."""
        return 1 / self.sample_rate_hz


@dataclass(frozen=True, eq=False)
class ServoPlan:
    """What the controllers know before the cut, at each of s samples; arm side.

    With several assumed elasticities the last axis holds one entry for each.
    """

    interval_s: float
    angle: Floats
    """Reference of the motor angle, shape (s, 2) or (s, 2, runs), rad."""
    rate: Floats
    """Reference of the measured motor velocity, rad/s."""
    torque: Floats
    """Feedforward torque held from each sample to the next, N·m."""
    proportional: Floats
    """kp, shape (2,), N·m/rad."""
    derivative: Floats
    """kv, shape (2,), N·m·s/rad."""
    count: Floats
    """Size of an encoder count, shape (2,), rad; zero for an ideal encoder."""
    limit: Floats
    """Largest torque, shape (2,), N·m; infinite without a limit."""
    delay: int
    """Samples from measurement to torque."""
    differentiated: bool
    smoothing: float
    """Share of the new difference in the filtered velocity; 1 without a filter."""
    start_angle: Floats
    """Joint angles at the start, shape (2,), rad."""


class Plant(Protocol):
    """One arm that a controller drives; see `ArmSimulation`."""

    motor1: float
    motor2: float
    motor1_rate: float
    motor2_rate: float

    def step(self, torque1: float, torque2: float) -> None:
        """Advance by one step under motor torques reflected to the arm side."""


def run_servo(
    plan: ServoPlan, plant: Plant, substeps: int, progress: Callable[[float], None] | None = None
) -> list[tuple[float, float]]:
    """Drive one arm along the plan; the same law for many arms is in ``many_arms.py``.

    A held torque that changes at a sample acts on the step around that sample with the mean of old
    and new, which is what leapfrog makes of a step in the torque.

    Parameters
    ----------
    plant : Plant
        One that steps ``interval_s / substeps``, at its start.
    progress : callable, optional
        Called with the fraction done, from 0 to 1. What it raises ends the run.

    Returns
    -------
    list of (torque1, torque2)
        Torques held from each sample on, arm side, N·m.

    Raises
    ------
    JointIdError
        When a motor runs away from its reference.
    """
    angle1, angle2, rate1, rate2, feed1, feed2 = (
        table[:, j].tolist() for table in (plan.angle, plan.rate, plan.torque) for j in (0, 1)
    )
    (kp1, kp2), (kv1, kv2) = plan.proportional.tolist(), plan.derivative.tolist()
    (count1, count2), (limit1, limit2) = plan.count.tolist(), plan.limit.tolist()
    share, T = plan.smoothing, plan.interval_s
    samples = len(feed1)
    report = max(1, samples // PROGRESS_CALLS)
    waiting: deque[tuple[float, float]] = deque([(0.0, 0.0)] * plan.delay)
    torques: list[tuple[float, float]] = []
    old1 = old2 = 0.0
    speed1 = speed2 = 0.0
    past1, past2 = angle1[0], angle2[0]
    for k in range(samples):
        y1, y2 = plant.motor1, plant.motor2
        if not (abs(y1 - angle1[k]) < LOST_RAD and abs(y2 - angle2[k]) < LOST_RAD):
            raise ran_away()
        if count1:
            y1, y2 = count1 * round(y1 / count1), count2 * round(y2 / count2)
        if plan.differentiated:
            if k == 0:
                past1, past2 = y1, y2
            speed1 = speed1 + share * ((y1 - past1) / T - speed1)
            speed2 = speed2 + share * ((y2 - past2) / T - speed2)
            past1, past2 = y1, y2
        else:
            speed1, speed2 = plant.motor1_rate, plant.motor2_rate
        back = (
            kp1 * (angle1[k] - y1) + kv1 * (rate1[k] - speed1),
            kp2 * (angle2[k] - y2) + kv2 * (rate2[k] - speed2),
        )
        if plan.delay:
            waiting.append(back)
            back = waiting.popleft()
        new1 = min(max(feed1[k] + back[0], -limit1), limit1)
        new2 = min(max(feed2[k] + back[1], -limit2), limit2)
        torques.append((new1, new2))
        plant.step(0.5 * (old1 + new1), 0.5 * (old2 + new2))
        for _ in range(substeps - 1):
            plant.step(new1, new2)
        old1, old2 = new1, new2
        if progress is not None and k % report == 0:
            progress(k / samples)
    if not (abs(plant.motor1 - angle1[-1]) < LOST_RAD and abs(plant.motor2 - angle2[-1]) < LOST_RAD):
        raise ran_away()
    if progress is not None:
        progress(1.0)
    return torques


def per_joint(name: str, value: ArrayLike) -> Floats:
    """A setting as (2,), one number counting for both joints.

    Raises
    ------
    JointIdError
        When it is neither.
    """
    array = finite_array(name, np.atleast_1d(np.asarray(value)), ndim=1)
    if array.size not in (1, 2):
        raise JointIdError(f"{name} has {array.size} values: give one, or one for each of the 2 joints.")
    return np.array(np.broadcast_to(array, (2,)))


def friction_values(friction: MotorFrictionLike) -> tuple[Floats, Floats]:
    """Coulomb friction in N·m and viscous friction in N·m·s/rad, each (2,), checked."""
    coulomb = per_joint("coulomb friction (N·m)", friction.coulomb)
    viscous = per_joint("viscous friction (N·m·s/rad)", friction.viscous)
    for name, value, unit in (("coulomb", coulomb, "N·m"), ("viscous", viscous, "N·m·s/rad")):
        if value.min() < 0:
            raise JointIdError(f"{name} friction is {value.min():g} {unit}: it must not be negative.")
    return coulomb, viscous


def ran_away() -> JointIdError:
    """Return what is raised when a motor no longer follows."""
    return JointIdError(
        f"The arm ran away: a motor is more than {LOST_RAD:g} rad (arm side) from its reference. The "
        "control loop is unstable: lower bandwidth_hz or delay_samples, or raise sample_rate_hz."
    )


def _whole(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)
