"""The servo of each motor: settings, and the sampled control law for one arm or many.

A PD controller of the motor angle around a reference, with a feedforward torque from ``feedforward.py``.
Values are joint side unless a name says motor.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, bounded_number, per_joint, whole_number
from jointid.errors import JointIdError

PROGRESS_CALLS = 50
"""Calls of a progress function per run, and checks that it is stable."""
LOST_RAD = 3.0
"""Tracking error, seen on the joint side, from which the control loop counts as unstable."""


class MotorFrictionLike(Protocol):
    """Friction at the motors, τ = coulomb · sign(θ̇) + viscous · θ̇, for instance that of a fit."""

    @property
    def coulomb(self) -> ArrayLike:
        """One value or one per joint, N·m."""

    @property
    def viscous(self) -> ArrayLike:
        """One value or one per joint, N·m·s/rad."""


@dataclass(frozen=True)
class Servo:
    """Settings of the joint controllers.

    The feedforward accounts for every option, so that with a perfect model the option causes no error:
    it is ahead by the delay, and the reference of a differentiated velocity passes the same difference.
    Raises JointIdError when a value is out of range.
    """

    sample_rate_hz: float = 4000.0
    """Control rate, Hz. Torque is held from one sample to the next."""
    bandwidth_hz: float = 10.0
    """Natural frequency of the PD control on the rigid joint, critically damped, Hz: kp = J ω² and
    kv = 2 J ω with J = B + diag M."""
    delay_samples: int = 0
    """Whole samples between measurement and the torque computed from it."""
    torque_limit_Nm: ArrayLike | None = None
    """Largest motor torque, one value or one per motor, motor side, N·m; None is no limit."""
    encoder_bits: int | None = None
    """Encoder of 2^bits counts per motor turn; None is an ideal encoder."""
    differentiated_velocity: bool = False
    """Velocity from the difference of two encoder positions; otherwise measured exactly."""
    friction_compensation: MotorFrictionLike | None = None
    """Assumed friction, added to the torque at the reference velocity of the motor."""

    def __post_init__(self) -> None:
        for name in ("sample_rate_hz", "bandwidth_hz"):
            object.__setattr__(self, name, bounded_number(name, "Hz", getattr(self, name)))
        if not 50 <= self.sample_rate_hz <= 20_000:
            raise JointIdError(f"sample_rate_hz = {self.sample_rate_hz:g} Hz: expected 50 to 20000 Hz.")
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

    The last axis is that of the assumed elasticities, one or one per run.
    """

    servo: Servo
    angle: Floats
    """Reference of the motor angle, shape (s, 2, runs), rad."""
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
    start_angle: Floats
    """Joint angles at the start, shape (2,), rad."""


class Plant(Protocol):
    """One arm or many with their controllers; see ``ArmSimulation`` and ``ManyArms``."""

    @property
    def motor(self) -> Floats:
        """Reflected motor angles at the present instant, shape (2, runs), rad."""

    @property
    def motor_rate(self) -> Floats:
        """Reflected motor rates, shape (2, runs), rad/s."""

    def step(self, torque: Floats) -> None:
        """Advance by one step under motor torques reflected to the joint side, (2, runs), N·m."""


def run_servo(
    plan: ServoPlan, plant: Plant, substeps: int, progress: Callable[[float], None] | None = None
) -> list[Floats]:
    """Drive one arm or many along a plan, or each along its own.

    The plant is at its start, with steps of ``interval_s / substeps``. ``progress`` is called with the
    fraction done, from 0 to 1; an exception from it ends the run. Returns the torques held from each
    sample on, each shape (2, runs), joint side, N·m. Raises JointIdError when a motor runs away from its
    reference.
    """
    each = np.ones(np.shape(plant.motor))  # numpy multiplies arrays of equal shape faster
    gains = (plan.proportional, plan.derivative, plan.count, plan.limit)
    kp, kv, count, limit = (x[:, None] * each for x in gains)
    quantised, limited = bool(count.any()), bool(np.isfinite(limit).any())
    differentiated, delay = plan.servo.differentiated_velocity, plan.servo.delay_samples
    unit = count if quantised else each  # the encoder's, rad
    per_unit, before = 1 / unit, kv * unit / plan.servo.interval_s  # torque by the previous sample
    now = kp * unit + before if differentiated else kp * unit
    # All of the control law that does not depend on the measured motion.
    references = plan.proportional[:, None] * plan.angle + plan.derivative[:, None] * plan.rate
    known = plan.torque * np.ones_like(references)
    delayed = known[delay:]
    delayed += references[: len(delayed)]
    waiting = deque([np.zeros_like(kp)] * delay)
    past = np.rint(plant.motor * per_unit) if quantised else plant.motor
    old = np.zeros_like(kp)
    held: list[Floats] = []
    report = max(1, len(known) // PROGRESS_CALLS)
    for k, ahead in enumerate(known):
        y = plant.motor
        if k % report == 0:
            require_tracking(y - plan.angle[k])
            if progress is not None:
                progress(k / len(known))
        if quantised:
            y = np.rint(y * per_unit)
        control = now * y
        if differentiated:
            control -= before * past
            past = y
        else:
            control += kv * plant.motor_rate
        waiting.append(control)
        new = ahead - waiting.popleft()
        if limited:
            new = np.clip(new, -limit, limit)
        # The leapfrog scheme's form of a torque that changes at a sample: the mean of old and new.
        plant.step(0.5 * (old + new))
        for _ in range(substeps - 1):
            plant.step(new)
        held.append(new)
        old = new
    require_tracking(plant.motor - plan.angle[-1])
    if progress is not None:
        progress(1.0)
    return held


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


def require_tracking(error_rad: Floats) -> None:
    """Raise JointIdError when a motor's error reaches ``LOST_RAD`` or is not a number: unstable loop."""
    if not np.abs(error_rad).max() < LOST_RAD:
        raise JointIdError(
            f"The arm diverged: a motor is more than {LOST_RAD:g} rad (joint side) from its reference. "
            "The control loop is unstable: lower its bandwidth or delay, or raise its sample rate."
        )
