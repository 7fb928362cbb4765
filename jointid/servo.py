"""The servo: elastic feedforward by flatness, motor PD, and what a real controller adds.

The wanted joint motion q(t) determines everything else (the elastic arm is flat; De Luca and Book,
Springer Handbook of Robotics, chapter on flexible elements). The springs must deliver
u = M(q) q̈ + c(q, q̇), so they deflect by x with D̂ ẋ + K̂ x = u, the motors must be at q + x, and that
needs the torque B (q̈ + ẍ) + u with B = N² J_m. K̂ and D̂ are what the controller assumes; a rigid
controller has x = 0. Feedback is a PD controller of each motor angle.

Arm side inside; a name says motor where a value is the motor's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import lfilter

from jointid.arm import Elbow, PlanarArm
from jointid.arrays import Floats, finite_array
from jointid.errors import JointIdError
from jointid.toolpath import Toolpath

Number: TypeAlias = Any
"""A float, or an array of floats with one value per simultaneous run."""
_FILTER_STEP_S = 1.25e-4
"""Step in which the spring deflection is integrated; its error stays below 0.1 µm at the tool."""
_PROGRESS_CALLS = 50


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
    compensation_smoothing_rad_s: float = 1.0

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
class JointMotion:
    """Joint motion q(t) along a path and the spring torque u(t) that it takes, arm side."""

    q: Floats
    """Joint angles and their derivatives 1 and 2, shape (3, k, 2)."""
    u: Floats
    """Spring torques and their derivatives 1 and 2, shape (3, k, 2)."""


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
    """One or many arms that a controller drives; see `ArmSimulation`."""

    motor1: Number
    motor2: Number
    motor1_rate: Number
    motor2_rate: Number

    def step(self, torque1: Number, torque2: Number) -> None:
        """Advance by one step under motor torques reflected to the arm side."""


def joint_motion(arm: PlanarArm, path: Floats, elbow: Elbow = "positive") -> JointMotion:
    """Joint motion and spring torque along a tool path, all derivatives analytic.

    With E_j = e^{iφ_j} the tool is at l1 E1 + l2 E2 in the complex plane. Each derivative of order k is
    linear in φ^(k), the rest is known from lower orders. The spring torques on the absolute angles are
    U1 = a φ̈1 + c Im(Ē1 Ë2), U2 = b φ̈2 + c Im(Ē2 Ë1), whose derivatives follow by the product rule.

    Parameters
    ----------
    path : ndarray, shape (5, k, 2)
        Tool position, velocity, acceleration, jerk and snap.

    Raises
    ------
    JointIdError
        When a point is out of reach or singular.
    """
    l1, l2 = arm.length_m
    phi = np.empty((5, path.shape[1], 2))
    phi[0] = np.unwrap(arm.link_angles(arm.inverse(path[0], elbow)), axis=0)
    E1, E2 = (np.empty((5, path.shape[1]), complex) for _ in range(2))
    E1[0], E2[0] = np.exp(1j * phi[0]).T
    sine = np.imag(E1[0].conj() * E2[0])
    for k in range(1, 5):
        # E^(k) = i φ^(k) E + rest, by Leibniz' rule on Ė = i φ̇ E.
        rest1, rest2 = (
            sum((_BINOMIAL[k - 1][m] * 1j * phi[k - m, :, j] * E[m] for m in range(1, k)), np.zeros(1))
            for j, E in enumerate((E1, E2))
        )
        known = path[k, :, 0] + 1j * path[k, :, 1] - l1 * rest1 - l2 * rest2
        phi[k, :, 0] = np.real(known * E2[0].conj()) / (l1 * sine)
        phi[k, :, 1] = -np.real(known * E1[0].conj()) / (l2 * sine)
        E1[k] = 1j * phi[k, :, 0] * E1[0] + rest1
        E2[k] = 1j * phi[k, :, 1] * E2[0] + rest2
    a, b, c = arm.moments
    U = np.empty((3, path.shape[1], 2))
    for k in range(3):
        coupling1 = sum(_BINOMIAL[k][m] * np.imag(E1[m].conj() * E2[2 + k - m]) for m in range(k + 1))
        coupling2 = sum(_BINOMIAL[k][m] * np.imag(E2[m].conj() * E1[2 + k - m]) for m in range(k + 1))
        U[k, :, 0] = a * phi[2 + k, :, 0] + c * coupling1
        U[k, :, 1] = b * phi[2 + k, :, 1] + c * coupling2
    # Virtual work: u = Lᵀ U.
    return JointMotion(q=arm.joint_angles(phi[:3]), u=U @ arm.links_from_joints)


_BINOMIAL = ((1,), (1, 1), (1, 2, 1), (1, 3, 3, 1))


def deflection(torque: Floats, K: float, D: float, step_s: float) -> Floats:
    """Solution x of D ẋ + K x = u from rest, for u and any of its derivatives given by samples.

    Exact for a torque that runs straight from sample to sample; D = 0 is x = u / K.

    Parameters
    ----------
    torque : ndarray, shape (..., k)
        Samples of u, the first one zero.
    K, D : float
        Stiffness and damping, D ≥ 0.
    step_s : float
        Interval of the samples, s.
    """
    if D == 0:
        return np.asarray(torque / K)
    r = K * step_s / D
    decay, mean = np.exp(-r), -np.expm1(-r) / r
    return np.asarray(lfilter([(1 - mean) / K, (mean - decay) / K], [1.0, -decay], torque, axis=-1))


def plan_servo(
    arm: PlanarArm,
    toolpath: Toolpath,
    servo: Servo,
    assumed_K: Floats | None,
    assumed_D: Floats | None,
    elbow: Elbow = "positive",
) -> ServoPlan:
    """Precompute references and feedforward of a cut.

    Parameters
    ----------
    assumed_K, assumed_D : ndarray, shape (2,) or (2, runs), optional
        What the controller assumes, motor side. None is a rigid controller.

    Raises
    ------
    JointIdError
        When the path leaves the workspace.
    """
    T = servo.interval_s
    samples = int(np.ceil(toolpath.end_s / T - 1e-9)) + 1
    # An even number of fine steps per sample, so that mid-interval values are on the grid.
    fine = 2 * max(1, int(np.ceil(T / 2 / _FILTER_STEP_S - 1e-9)))
    time = np.arange(samples * fine + 1) * (T / fine)
    motion = joint_motion(arm, toolpath.derivatives(time), elbow)
    at_sample, held = slice(0, samples * fine, fine), slice(fine // 2, samples * fine, fine)
    angle, rate = (motion.q[k, at_sample] for k in (0, 1))
    rate_held, acceleration = (motion.q[k, held] for k in (1, 2))
    B = arm.rotor_inertia_arm_kgm2
    if assumed_K is None or assumed_D is None:
        torque = B * acceleration + motion.u[0, held]
    else:
        x = _deflections(arm, motion.u, assumed_K, assumed_D, T / fine)
        runs = (...,) + (None,) * (assumed_K.ndim - 1)
        angle = angle[runs] + x[0, at_sample]
        rate = rate[runs] + x[1, at_sample]
        rate_held = rate_held[runs] + x[1, held]
        weight = B[(slice(None), *runs[1:])]
        torque = weight * (acceleration[runs] + x[2, held]) + motion.u[0, held][runs]
    if servo.friction_compensation is not None:
        torque = torque + _compensation(arm, servo, rate_held)
    smoothing = 1.0
    if servo.differentiated_velocity:
        if servo.velocity_filter_hz is not None:
            smoothing = -float(np.expm1(-2 * np.pi * servo.velocity_filter_hz * T))
        difference = np.diff(angle, axis=0, prepend=angle[:1]) / T
        rate = lfilter([smoothing], [1.0, smoothing - 1.0], difference, axis=0)
    middle = arm.inverse(0.5 * (toolpath.knot_m.min(axis=0) + toolpath.knot_m.max(axis=0)), elbow)
    J, omega = B + np.diag(arm.mass_matrix(middle)), 2 * np.pi * servo.bandwidth_hz
    ratio = np.abs(arm.gear_ratio)
    limit = np.full(2, np.inf) if servo.torque_limit_Nm is None else servo.torque_limit_Nm
    return ServoPlan(
        interval_s=T,
        angle=angle,
        rate=rate,
        torque=torque,
        proportional=J * omega**2,
        derivative=2 * servo.damping_ratio * J * omega,
        count=np.zeros(2) if servo.encoder_bits is None else 2 * np.pi / 2**servo.encoder_bits / ratio,
        limit=np.broadcast_to(np.asarray(limit, dtype=np.float64), (2,)) * ratio,
        delay=int(servo.delay_samples),
        differentiated=servo.differentiated_velocity,
        smoothing=smoothing,
        start_angle=motion.q[0, 0],
    )


def run_servo(
    plan: ServoPlan, plant: Plant, substeps: int, progress: Callable[[float], None] | None = None
) -> list[tuple[Number, Number]]:
    """Drive a plant along the plan; every number may be a float or an array over runs.

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
    """
    scalar = plan.angle.ndim == 2 and isinstance(plant.motor1, float)
    rows: Callable[[Floats], Sequence[Number]] = (lambda x: x.tolist()) if scalar else list
    angle1, angle2, rate1, rate2, feed1, feed2 = (
        rows(table[:, j]) for table in (plan.angle, plan.rate, plan.torque) for j in (0, 1)
    )
    (kp1, kp2), (kv1, kv2) = plan.proportional.tolist(), plan.derivative.tolist()
    (count1, count2), (limit1, limit2) = plan.count.tolist(), plan.limit.tolist()
    limited, rint = bool(np.isfinite(plan.limit).any()), round if scalar else np.rint
    share, T = plan.smoothing, plan.interval_s
    samples = len(feed1)
    report = max(1, samples // _PROGRESS_CALLS)
    waiting: deque[tuple[Number, Number]] = deque([(0.0, 0.0)] * plan.delay)
    torques: list[tuple[Number, Number]] = []
    old1 = old2 = 0.0
    speed1 = speed2 = 0.0
    past1, past2 = angle1[0], angle2[0]
    for k in range(samples):
        y1, y2 = plant.motor1, plant.motor2
        if count1:
            y1, y2 = count1 * rint(y1 / count1), count2 * rint(y2 / count2)
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
        new1, new2 = feed1[k] + back[0], feed2[k] + back[1]
        if limited:
            if scalar:
                new1, new2 = min(max(new1, -limit1), limit1), min(max(new2, -limit2), limit2)
            else:
                new1, new2 = np.clip(new1, -limit1, limit1), np.clip(new2, -limit2, limit2)
        torques.append((new1, new2))
        plant.step(0.5 * (old1 + new1), 0.5 * (old2 + new2))
        for _ in range(substeps - 1):
            plant.step(new1, new2)
        old1, old2 = new1, new2
        if progress is not None and k % report == 0:
            progress(k / samples)
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


def _deflections(arm: PlanarArm, u: Floats, K: Floats, D: Floats, step_s: float) -> Floats:
    """Deflections x and two derivatives, shape (3, k, 2) or (3, k, 2, runs)."""
    n2 = arm.gear_ratio**2
    x = np.empty(u.shape + K.shape[1:])
    for j in range(2):
        series = np.ascontiguousarray(u[:, :, j])
        if K.ndim == 1:
            x[:, :, j] = deflection(series, n2[j] * K[j], n2[j] * D[j], step_s)
            continue
        pairs, which = np.unique(np.stack([K[j], D[j]], axis=1), axis=0, return_inverse=True)
        distinct = np.stack(
            [deflection(series, n2[j] * k, n2[j] * d, step_s) for k, d in pairs], axis=-1
        )
        x[:, :, j] = distinct[:, :, which]
    return x


def _compensation(arm: PlanarArm, servo: Servo, rate: Floats) -> Floats:
    """Friction torque at the wanted motor velocity, arm side, like ``rate``."""
    assert servo.friction_compensation is not None
    runs = (slice(None),) + (None,) * (rate.ndim - 2)
    coulomb, viscous = (value[runs] for value in friction_values(servo.friction_compensation))
    n = arm.gear_ratio[runs]
    motor_rate = n * rate
    return np.asarray(
        n * (coulomb * np.tanh(motor_rate / servo.compensation_smoothing_rad_s) + viscous * motor_rate)
    )


def _whole(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)
