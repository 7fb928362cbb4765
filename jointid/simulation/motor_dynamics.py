"""Exact step of the arm and motors under a constant torque, with set-valued Coulomb friction."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from jointid.arrays import Floats
from jointid.joints import Elasticity, Inertia


class Step(NamedTuple):
    """Time steps under a constant motor torque, each x ← [E G] [x; torque], x = θm, θa, θ̇m, θ̇a."""

    EG: Floats  # (4n, 5n), with gears (4n, 6n): their torques beyond K δ follow those of the motors
    resistance: Floats  # (n, 1), torque that changes a motor's velocity by 1 rad/s over the step
    older: bool  # under the torque of one sample earlier, because of the delay
    duration_s: float
    steps: int
    all_EG: Floats  # over all steps: x in the end
    velocities: Floats  # over all steps: the motors' velocities after each, (count n, 5n)


def gear_input(inertia: Inertia) -> Floats:
    """Columns of B for torques of the gears: on the arm, and against the motors, shape (4n, n)."""
    n = inertia.n
    on_arm = np.linalg.inv(inertia.M2)
    return np.vstack([np.zeros((2 * n, n)), -np.diag(1 / inertia.M), on_arm])


def plant(
    inertia: Inertia, elasticity: Elasticity, viscous: Floats, arm_viscous: Floats
) -> tuple[Floats, Floats]:
    """Equation (1) as ẋ = A x + B τ with x = θm, θa, θ̇m, θ̇a, and viscous friction (n,) at both."""
    n, K, D = inertia.n, np.diag(elasticity.K), np.diag(elasticity.D)
    none, one = np.zeros((n, n)), np.eye(n)
    forces = np.block(
        [[-K, K, -D - np.diag(viscous), D], [K, -K - inertia.gravity, D, -D - np.diag(arm_viscous)]]
    )
    mass = np.block([[np.diag(inertia.M), none], [none, inertia.M2]])
    kinematics = np.block([[none, none, one, none], [none, none, none, one]])
    B = np.vstack([none, none, np.diag(1 / inertia.M), none])
    return np.vstack([kinematics, np.linalg.solve(mass, forces)]), B


def constant_torque(A: Floats, B: Floats, duration: float, older: bool, count: int = 1) -> Step:
    """Exact steps under a constant torque, by one matrix exponential."""
    states, inputs = B.shape
    n = states // 4
    extended = np.zeros((states + inputs, states + inputs))
    extended[:states] = np.hstack([A, B])
    step = expm(extended * duration)
    powers = [np.linalg.matrix_power(step, k) for k in range(1, count + 1)]
    EG, all_EG = (np.ascontiguousarray(power[:states]) for power in (step, powers[-1]))
    velocities = np.vstack([power[2 * n : 3 * n] for power in powers])
    resistance = 1 / np.diagonal(EG[2 * n : 3 * n, 4 * n :])[:, None]
    return Step(EG, resistance, older, duration, count, all_EG, velocities)


def slide(Z: Floats, step: Step, coulomb: Floats) -> bool:
    """Advance Z = [x; torque] over all steps if no motor stops in them: friction is then constant.

    Otherwise, x stays and the torque is spoilt.
    """
    n = len(coulomb)
    sign = np.sign(Z[2 * n : 3 * n])
    Z[4 * n :] -= sign * coulomb
    velocities = (step.velocities @ Z).reshape(step.steps, *sign.shape)
    slides = bool((velocities * sign).min() > 0)
    if slides:
        Z[: 4 * n] = step.all_EG @ Z
    return slides


def step_with_friction(Z: Floats, step: Step, coulomb: Floats) -> None:
    """Advance Z = [x; torque] in place over one step with Coulomb friction, set-valued at rest.

    The friction torque of the step is its time average: its full value against the motion of a sliding
    motor; the holding torque of a sticking one, up to the full value; for a motor that reverses, the
    full value in one direction up to the instant of rest and in the other after it. Z has shape (5n, R),
    or (6n, R) with gears; ``coulomb`` is F_c, shape (n, 1), N·m.
    """
    n = len(coulomb)
    EG, resistance = step.EG, step.resistance
    angle, _, velocity, _, torque, *_ = Z.reshape(-1, n, Z.shape[1])  # views
    # The torque of one motor moves another only through springs and arm, within a step by ten orders of
    # magnitude less than its own motor: the motors are independent.
    momentum = resistance * velocity  # per length of the step, so a torque
    needed = resistance * (EG[2 * n : 3 * n] @ Z)  # friction that would stop the motor at the end
    sign = np.sign(velocity)
    friction = sign * coulomb
    stops = sign * (needed - friction) <= 0
    if not stops.any():
        torque -= friction
        Z[: 4 * n] = EG @ Z
        return
    other = needed - momentum  # torque of all but friction, on average
    sticks = stops & (np.abs(other) <= coulomb)
    reverses = stops & ~sticks
    share = np.divide(momentum, friction - other, out=np.zeros_like(friction), where=reverses)
    after = np.sign(other) * coulomb
    friction += reverses * (1 - share) * (after - friction)
    np.copyto(friction, needed, where=sticks)
    stayed = sticks & (velocity == 0)
    before = angle.copy()
    torque -= friction
    Z[: 4 * n] = EG @ Z
    np.copyto(velocity, 0.0, where=sticks)
    np.copyto(angle, before, where=stayed)
