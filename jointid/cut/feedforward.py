"""Flatness-based feedforward of an elastic arm: motor motion and torque for a tool path.

The joint motion q(t) determines all other variables (the elastic arm is flat; De Luca and Book, Robots
with Flexible Elements, Springer Handbook of Robotics). The joint torque is u = M(q) q̈ + c(q, q̇), the
deflection x follows from D̂ ẋ + K̂ x = u, the motor angle is q + x, and the motor torque B (q̈ + ẍ) +
u with B = N² J_m. The controller assumes K̂ and D̂; a rigid controller has x = 0. All values are arm
side.
"""

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats
from jointid.cut.arm import Elbow, PlanarArm
from jointid.cut.servo import Servo, ServoPlan, friction_values
from jointid.cut.toolpath import Toolpath
from jointid.gears.laws import GearLaws
from jointid.small_matrices import decaying

_FILTER_STEP_S = 1.25e-4
"""Step of the integrated deflection; its error is below 0.1 µm at the tool."""
_NEWTON = 4
"""Newton steps for the deflection of a nonlinear gear at each sample."""
_SMOOTHING_RAD_S = 0.2
"""Motor velocity over which the compensation of friction changes its sign (tanh)."""
_SLACK = 1e-2
"""Least slope inside the backlash, over K, where the damping is zero."""


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Joint motion q(t) along a path and its joint torque u(t), joint side."""

    q: Floats
    """Joint angles and their derivatives 1 and 2, shape (3, k, 2)."""
    u: Floats
    """Joint torques and their derivatives 1 and 2, shape (3, k, 2)."""


def joint_motion(arm: PlanarArm, path: Floats, elbow: Elbow = "positive") -> JointMotion:
    """Joint motion and joint torque along a tool path, with analytic derivatives.

    With E_j = e^{iφ_j} the tool is at l1 E1 + l2 E2 in the complex plane. Each derivative of order k is
    linear in φ^(k), the rest is known from lower orders. The joint torques on the absolute angles are
    U1 = a φ̈1 + c Im(Ē1 Ë2), U2 = b φ̈2 + c Im(Ē2 Ë1), whose derivatives follow by the product rule.

    ``path``, shape (5, k, 2), holds tool position, velocity, acceleration, jerk and snap. Raises
    JointIdError when a point is out of reach or singular.
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

    Exact for a piecewise linear torque, shape (..., k), that begins with zero; D = 0 gives x = u / K.
    """
    if D == 0:
        return np.asarray(torque / K)
    r = K * step_s / D
    decay, mean = np.exp(-r), -np.expm1(-r) / r
    before = np.concatenate([np.zeros_like(torque[..., :1]), torque[..., :-1]], axis=-1)
    driven = ((1 - mean) * torque + (mean - decay) * before) / K
    found = decaying(np.array([[decay]]), driven.reshape(-1, driven.shape[-1]))
    return np.asarray(found.reshape(driven.shape))


def plan_servo(
    arm: PlanarArm,
    toolpath: Toolpath,
    servo: Servo,
    assumed_K: Floats | None,
    assumed_D: Floats | None,
    elbow: Elbow = "positive",
    gears: GearLaws | None = None,
) -> ServoPlan:
    """Precompute references and feedforward of a cut.

    The controller assumes K and D, motor side, shape (2, runs), or rigid joints where they are None;
    ``gears`` are laws that it knows in addition, joint side, for a single run. Raises JointIdError when
    the path leaves the workspace.
    """
    T = servo.interval_s
    samples = int(np.ceil(toolpath.end_s / T - 1e-9)) + 1
    # An even number of fine steps per sample, so that mid-interval values are on the grid.
    fine = 2 * max(1, int(np.ceil(T / 2 / _FILTER_STEP_S - 1e-9)))
    time = np.arange(samples * fine + 1) * (T / fine)
    motion = joint_motion(arm, toolpath.derivatives(time), elbow)
    at_sample, held = slice(0, samples * fine, fine), slice(fine // 2, samples * fine, fine)
    if assumed_K is None or assumed_D is None:
        x = np.zeros_like(motion.u)[..., None]
    elif gears is None:
        x = _deflections(arm, motion.u, assumed_K, assumed_D, T / fine)
    else:
        D = arm.gear_ratio**2 * assumed_D[:, 0]
        x = gear_deflections(motion.u[0], gears, D, T / fine)[..., None]
    motor, B = motion.q[..., None] + x, arm.rotor_inertia_arm_kgm2
    angle, rate = motor[0, at_sample], motor[1, at_sample]
    torque = B[:, None] * motor[2, held] + motion.u[0, held][..., None]
    if servo.friction_compensation is not None:
        coulomb, viscous = friction_values(servo.friction_compensation)
        n = arm.gear_ratio[:, None]
        velocity = n * motor[1, held]
        reversal = np.tanh(velocity / _SMOOTHING_RAD_S)
        torque += n * (coulomb[:, None] * reversal + viscous[:, None] * velocity)
    if servo.differentiated_velocity:
        rate = np.diff(angle, axis=0, prepend=angle[:1]) / T
    middle = arm.inverse(0.5 * (toolpath.knot_m.min(axis=0) + toolpath.knot_m.max(axis=0)), elbow)
    J, omega = B + np.diag(arm.mass_matrix(middle)), 2 * np.pi * servo.bandwidth_hz
    ratio = np.abs(arm.gear_ratio)
    limit = np.full(2, np.inf) if servo.torque_limit_Nm is None else servo.torque_limit_Nm
    return ServoPlan(
        servo=servo,
        angle=angle,
        rate=rate,
        torque=torque,
        proportional=J * omega**2,
        derivative=2 * J * omega,
        count=np.zeros(2) if servo.encoder_bits is None else 2 * np.pi / 2**servo.encoder_bits / ratio,
        limit=np.broadcast_to(np.asarray(limit, dtype=np.float64), (2,)) * ratio,
        start_angle=motion.q[0, 0],
    )


def gear_deflections(u: Floats, gears: GearLaws, D: Floats, step_s: float) -> Floats:
    """Deflections x of nonlinear gears under torques u from rest, and two derivatives, (3, k, 2).

    Implicit midpoint rule, with the hysteresis as its state; ``u``, shape (k, 2), and the damping ``D``,
    shape (2,), are joint side.
    """
    K, rate = gears.K[:, 0], D / step_s
    x, loop = np.zeros_like(u), np.zeros(2)
    for k in range(len(u) - 1):
        mean, middle = 0.5 * (u[k] + u[k + 1]), x[k]
        for _ in range(_NEWTON):
            torque, slope = gears.wound(middle[:, None], loop[:, None], (middle - x[k])[:, None])
            left = mean - 2 * rate * (middle - x[k]) - torque[:, 0]
            middle = middle + left / np.maximum(2 * rate + slope[:, 0], _SLACK * K)
        x[k + 1] = 2 * middle - x[k]
        loop = gears.loop(loop[:, None], (x[k + 1] - x[k])[:, None])[:, 0]
    rates = np.gradient(x, step_s, axis=0)
    return np.stack([x, rates, np.gradient(rates, step_s, axis=0)])


def _deflections(arm: PlanarArm, u: Floats, K: Floats, D: Floats, step_s: float) -> Floats:
    """Deflections x and two derivatives, shape (3, k, 2, runs)."""
    n2 = arm.gear_ratio**2
    x = np.empty((*u.shape, K.shape[1]))
    for j in range(2):
        series = np.ascontiguousarray(u[:, :, j])
        pairs, which = np.unique(np.stack([K[j], D[j]], axis=1), axis=0, return_inverse=True)
        distinct = np.stack(
            [deflection(series, n2[j] * k, n2[j] * d, step_s) for k, d in pairs], axis=-1
        )
        x[:, :, j] = distinct[:, :, which]
    return x
