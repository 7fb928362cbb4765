"""The motors between two events: a constant torque, exactly; Coulomb friction, set-valued at rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from jointid.arrays import Floats
from jointid.joints import Elasticity, Inertia


class Stretch(NamedTuple):
    """A stretch of time under a constant motor torque: x ← [E G] [x; torque], x = θm, θa, θ̇m, θ̇a."""

    EG: Floats  # (4n, 5n)
    resistance: Floats  # (n, 1), torque that changes a motor's velocity by 1 rad/s over the stretch
    older: bool  # the torque that the delay still lets act at the start of a sample


def plant(inertia: Inertia, elasticity: Elasticity, viscous: Floats) -> tuple[Floats, Floats]:
    """Equation (1) as ẋ = A x + B τ with x = θm, θa, θ̇m, θ̇a."""
    n, K, D = inertia.n, np.diag(elasticity.K), np.diag(elasticity.D)
    none, one = np.zeros((n, n)), np.eye(n)
    forces = np.block([[-K, K, -D - np.diag(viscous), D], [K, -K, D, -D]])
    mass = np.block([[np.diag(inertia.M), none], [none, inertia.M2]])
    kinematics = np.block([[none, none, one, none], [none, none, none, one]])
    B = np.vstack([none, none, np.diag(1 / inertia.M), none])
    return np.vstack([kinematics, np.linalg.solve(mass, forces)]), B


def constant_torque(A: Floats, B: Floats, duration: float, older: bool) -> Stretch:
    """The exact step under a constant torque, by one matrix exponential."""
    states, n = B.shape
    extended = np.zeros((states + n, states + n))
    extended[:states] = np.hstack([A, B])
    EG = np.ascontiguousarray(expm(extended * duration)[:states])
    return Stretch(EG, 1 / np.diagonal(EG[2 * n : 3 * n, 4 * n :])[:, None], older)


def step_with_friction(Z: Floats, stretch: Stretch, coulomb: Floats) -> None:
    """Advance Z = [x; torque] in place over one stretch with Coulomb friction, set-valued at rest.

    The friction torque of the stretch is its time average: its full value against the motion while a
    motor moves one way; what keeps the motor standing where that is enough; and where a motor
    reverses, the full value one way up to the instant of rest and the other way after it.

    Parameters
    ----------
    Z : ndarray, shape (5n, R)
    stretch : Stretch
    coulomb : ndarray, shape (n, 1)
        F_c, N·m.
    """
    n = len(coulomb)
    EG, resistance, _ = stretch
    motors = slice(2 * n, 3 * n)
    # One motor's torque moves another only through springs and arm: within a stretch ten orders of
    # magnitude less than itself. So each motor is judged alone.
    velocity = Z[motors]
    momentum = resistance * velocity  # per length of the stretch, so a torque
    needed = resistance * (EG[motors] @ Z)  # friction that would stop the motor at the end
    sign = np.sign(velocity)
    rub = sign * coulomb
    stops = sign * (needed - rub) <= 0
    if not stops.any():
        Z[4 * n :] -= rub
        Z[: 4 * n] = EG @ Z
        return
    other = needed - momentum  # torque of all but friction, on average
    stands = stops & (np.abs(other) <= coulomb)
    reverses = stops & ~stands
    share = np.divide(momentum, rub - other, out=np.zeros_like(rub), where=reverses)
    after = np.sign(other) * coulomb
    rub += reverses * (1 - share) * (after - rub)
    np.copyto(rub, needed, where=stands)
    stayed = stands & (velocity == 0)
    theta = Z[:n].copy()
    Z[4 * n :] -= rub
    Z[: 4 * n] = EG @ Z
    np.copyto(Z[motors], 0.0, where=stands)
    np.copyto(Z[:n], theta, where=stayed)
