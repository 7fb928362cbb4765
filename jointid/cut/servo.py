"""The servo of each motor: settings, and the sampled control law for one arm or many.

A PD controller of the motor angle around a reference, with a feedforward torque from ``feedforward.py``.
Values are joint side unless a name says motor.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, bounded_number, per_joint, whole_number
from jointid.errors import JointIdError

PROGRESS_CALLS = 50
"""Calls of a progress function per run."""
LOST_RAD = 3.0
"""Tracking error, seen on the joint side, from which the control loop counts as unstable."""

Signal = TypeVar("Signal", float, Floats)


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

    The feedforward accounts for every option, so that with a perfect model the option causes no error:
    it is ahead by the delay, and the reference of a differentiated velocity passes the same difference.

    Parameters
    ----------
    sample_rate_hz : float
        Control rate, Hz. Torque is held from one sample to the next.
    bandwidth_hz : float
        Natural frequency of the PD control on the rigid joint, critically damped, Hz: kp = J ω² and
        kv = 2 J ω with J = B + diag M.
    delay_samples : int
        Whole samples between measurement and the torque computed from it.
    torque_limit_Nm : float or array_like, shape (2,), optional
        Largest motor torque, motor side, N·m.
    encoder_bits : int, optional
        Encoder of 2^bits counts per motor turn; None is an ideal encoder.
    differentiated_velocity : bool
        Velocity from the difference of two encoder positions; otherwise measured exactly.
    friction_compensation : friction, optional
        Assumed friction, added to the torque at the reference velocity of the motor. Any object with
        ``coulomb`` and ``viscous``, for instance the friction of a fit.

    Raises
    ------
    JointIdError
        When a value is out of range.
    """

    sample_rate_hz: float = 4000.0
    bandwidth_hz: float = 10.0
    delay_samples: int = 0
    torque_limit_Nm: ArrayLike | None = None
    encoder_bits: int | None = None
    differentiated_velocity: bool = False
    friction_compensation: MotorFrictionLike | None = None

    def __post_init__(self) -> None:
        for name in ("sample_rate_hz", "bandwidth_hz"):
            object.__setattr__(self, name, bounded_number(name, "Hz", getattr(self, name)))
        if not 50 <= self.sample_rate_hz <= 20_000:
            raise JointIdError(
                f"sample_rate_hz = {self.sample_rate_hz:g} Hz: expected 50 Hz to 20000 Hz."
            )
        whole_number("delay_samples", self.delay_samples, 0, 100)
        if self.encoder_bits is not None:
            whole_number("encoder_bits", self.encoder_bits, 4, 40)
        if self.torque_limit_Nm is not None:
            limit = per_joint("torque_limit_Nm (N·m)", self.torque_limit_Nm, 2)
            if limit.min() <= 0:
                raise JointIdError(f"torque_limit_Nm is {limit.min():g} N·m: it must be positive.")
        friction_values(self.friction_compensation)

    @property
    def interval_s(self) -> float:
        """Time from one control sample to the next, s."""
        return 1 / self.sample_rate_hz


@dataclass(frozen=True, eq=False)
class ServoPlan:
    """Reference and feedforward of a cut at s samples, and the gains; joint side.

    The last axis is that of the assumed elasticities, if there are several.
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
    """Whether the velocity is the difference of two positions."""
    start_angle: Floats
    """Joint angles at the start, shape (2,), rad."""


class Plant(Protocol):
    """One arm with a controller; see `ArmSimulation`."""

    motor1: float
    motor2: float
    motor1_rate: float
    motor2_rate: float

    def step(self, torque1: float, torque2: float) -> None:
        """Advance by one step under motor torques reflected to the joint side."""


class Arithmetic(NamedTuple, Generic[Signal]):
    """Operations in which floats and arrays differ."""

    rounded: Callable[[Signal], Signal]
    clipped: Callable[[Signal, Signal], Signal]
    largest: Callable[[Signal], float]


FLOATS = Arithmetic[float](round, lambda x, limit: min(max(x, -limit), limit), abs)
ARRAYS = Arithmetic[Floats](
    np.rint, lambda x, limit: np.clip(x, -limit, limit), lambda x: float(np.abs(x).max())
)


def run_servo(
    plan: ServoPlan, plant: Plant, substeps: int, progress: Callable[[float], None] | None = None
) -> list[tuple[float, ...]]:
    """Drive one arm along the plan.

    Parameters
    ----------
    plan : ServoPlan
        For one arm.
    plant : Plant
        At its start, with steps of ``interval_s / substeps``.
    substeps : int
    progress : callable, optional
        Called with the fraction done, from 0 to 1; an exception from it ends the run.

    Returns
    -------
    list of (torque1, torque2)
        Torques held from each sample on, joint side, N·m.

    Raises
    ------
    JointIdError
        When a motor runs away from its reference.
    """
    first, second = (
        sampled_law(
            plan,
            [table[:, j].tolist() for table in (plan.angle, plan.rate, plan.torque)],
            [float(x[j]) for x in (plan.proportional, plan.derivative, plan.count, plan.limit)],
            FLOATS,
        )
        for j in (0, 1)
    )

    def torques(k: int) -> tuple[float, ...]:
        return (
            first(k, plant.motor1, plant.motor1_rate),
            second(k, plant.motor2, plant.motor2_rate),
        )

    held = list(driven(len(plan.torque), torques, plant.step, substeps, progress))
    end = np.array([plant.motor1, plant.motor2])
    require_tracking(ARRAYS.largest(end - plan.angle[-1]))
    return held


def sampled_law(
    plan: ServoPlan,
    tables: Sequence[Sequence[Signal]],
    gains: Sequence[Signal],
    arithmetic: Arithmetic[Signal],
) -> Callable[[int, Signal, Signal], Signal]:
    """Control law of one joint in floats, or of both joints of many arms in arrays (2, runs).

    Parameters
    ----------
    plan : ServoPlan
    tables : sequence
        Angle, rate and feedforward torque of each sample.
    gains : sequence
        kp, kv, encoder count and torque limit.
    arithmetic : Arithmetic

    Returns
    -------
    callable
        Torque to hold from a sample on, from sample number, motor angle and motor rate. It keeps the
        last position and the delayed torques, so the samples must be in order.
    """
    (angle, rate, feed), (kp, kv, count, limit) = tables, gains
    rounded, clipped, largest = arithmetic
    quantised, limited = bool(np.any(count)), bool(np.isfinite(limit).any())
    differentiated, T = plan.differentiated, plan.interval_s
    waiting = deque([0.0 * kp] * plan.delay)
    past = 0.0 * kp

    def torque(k: int, y: Signal, speed: Signal) -> Signal:
        nonlocal past
        require_tracking(largest(y - angle[k]))
        if quantised:
            y = count * rounded(y / count)
        if differentiated:
            speed, past = (y - (past if k else y)) / T, y
        waiting.append(kp * (angle[k] - y) + kv * (rate[k] - speed))
        new = feed[k] + waiting.popleft()
        return clipped(new, limit) if limited else new

    return torque


def driven(
    samples: int,
    torques: Callable[[int], tuple[Signal, ...]],
    step: Callable[..., None],
    substeps: int,
    progress: Callable[[float], None] | None = None,
) -> Iterator[tuple[Signal, ...]]:
    """Sample the law and step the plant; yields the torques held from each sample on.

    A held torque that changes at a sample acts on the step around that sample with the mean of old and
    new: the leapfrog scheme's form of a step in the torque.
    """
    report = max(1, samples // PROGRESS_CALLS)
    old: tuple[Signal, ...] | None = None
    for k in range(samples):
        new = torques(k)
        step(*[0.5 * n if old is None else 0.5 * (o + n) for o, n in zip(old or new, new, strict=True)])
        for _ in range(substeps - 1):
            step(*new)
        old = new
        yield new
        if progress is not None and k % report == 0:
            progress(k / samples)
    if progress is not None:
        progress(1.0)


def friction_values(friction: MotorFrictionLike | None) -> tuple[Floats, Floats]:
    """Coulomb friction in N·m and viscous friction in N·m·s/rad, each (2,), checked; None is zero."""
    if friction is None:
        return np.zeros(2), np.zeros(2)
    coulomb = per_joint("coulomb friction (N·m)", friction.coulomb, 2)
    viscous = per_joint("viscous friction (N·m·s/rad)", friction.viscous, 2)
    for name, value, unit in (("coulomb", coulomb, "N·m"), ("viscous", viscous, "N·m·s/rad")):
        if value.min() < 0:
            raise JointIdError(f"{name} friction is {value.min():g} {unit}: it must not be negative.")
    return coulomb, viscous


def require_tracking(error_rad: float) -> None:
    """Refuse a motor that is too far from its reference, as in an unstable loop.

    Raises
    ------
    JointIdError
        When the error, seen on the joint side, reaches ``LOST_RAD`` or is not a number.
    """
    if not error_rad < LOST_RAD:
        raise JointIdError(
            f"The arm diverged: a motor is more than {LOST_RAD:g} rad (joint side) from its reference. "
            "The control loop is unstable: lower bandwidth_hz or delay_samples, or raise sample_rate_hz."
        )
