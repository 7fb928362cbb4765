"""Hypothesis that the arm's angles were logged instead of the motors', tested by its own equation.

With the arm's angles θ_a logged and the joint torques f = M2 θ̈_a, the motors turn by
f_j / (K_j + iω D_j) more than the arms, and the motor torques are

    τ = (M + M2) θ̈_a − ω² M f / (K + iω D).

This is how a second encoder behind the gear, times the gear ratio, looks: below the resonances like the
motor's, and with stiffnesses that are negative when it is taken for the motor's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import identify_elasticity
from jointid.joints import Elasticity, Inertia, dynamic_arm_inertia, motor_response
from jointid.phasors.extract import Phasors
from jointid.verdict.evidence import Finding, number, percent, problem
from jointid.wording import listed

_CLOSE = 0.05
"""Largest residual of the arm's equation, over the torque."""
_BETTER = 0.2
"""Largest ratio of this residual to those of the motor's equation and of rigid joints."""
_ITERATIONS = 8
"""Updates of the weights."""
_NO_SPRING = 1e-100
"""Dynamic stiffness of an arm at rest, N·m/rad."""


@dataclass(frozen=True, eq=False)
class LinkSide:
    """The arm's equation, fitted."""

    K: Floats
    D: Floats
    left: float
    """Residual over the torque, rms, of the worst joint."""
    left_rigid: float
    """The same for rigid joints, of the best joint."""


def link_side_finding(phasors: Phasors, inertias: Sequence[Inertia]) -> tuple[Finding, ...]:
    """Finding that positions look logged at the arm, if only that explains the torques.

    Parameters
    ----------
    phasors : Phasors
    inertias : sequence of Inertia
        One per record.
    """
    arm = fit_link_side(phasors, inertias)
    possible = np.all(arm.K > 0) and np.all(arm.K + 100 * phasors.omega.max() * arm.D > 0)
    if not possible or arm.left > _CLOSE or arm.left > _BETTER * arm.left_rigid:
        return ()
    motor = _left_by_the_motors_equation(phasors, inertias)
    if arm.left > _BETTER * motor:
        return ()
    said = "allow no positive stiffness" if np.isinf(motor) else f"leave {percent(motor)} of the torque"
    columns = listed(f"theta_m{j + 1}_rad" for j in range(phasors.n))
    return (
        problem(
            "The positions look like the arm's, not the motors'",
            f"Taken for motor angles, the records {said}. Taken for angles behind the springs, "
            f"they leave {percent(arm.left)}, with K of about "
            f"{', '.join(number(k) for k in arm.K)} N·m/rad.",
            "Choose the columns of the motors' encoders as positions "
            f"({columns} in a study's tables). An encoder behind the gear does not show "
            "what the motor does, whatever its gear ratio.",
            2.0,
            "edit mapping",
        ),
    )


def fit_link_side(phasors: Phasors, inertias: Sequence[Inertia]) -> LinkSide:
    """Fit K and D to records whose positions are the arm's.

    Parameters
    ----------
    phasors : Phasors
        With the arm's angles as ``q``.
    inertias : sequence of Inertia
        One per record.
    """
    omega, q, tau = phasors.omega[:, None], phasors.q, phasors.tau
    M = np.array([i.M for i in inertias])
    f = -(omega**2) * np.einsum("rij,rj->ri", dynamic_arm_inertia(phasors.omega, inertias), q)
    rest = tau - f + omega**2 * M * q  # residual of rigid joints
    g = -(omega**2) * M * f  # rest = g / (K + iω D)
    size = np.sqrt(np.mean(np.abs(tau) ** 2, axis=0))
    n = phasors.n
    none = LinkSide(np.full(n, np.nan), np.full(n, np.nan), np.inf, np.inf)
    if not np.all(size > 0):
        return none
    K, D = np.ones(n), np.zeros(n)
    for _ in range(_ITERATIONS):
        # Linear in K and D; the weights turn the equation error into the error of the torque.
        spring = K + 1j * omega * D
        if not np.all(np.abs(spring) > _NO_SPRING):
            return none
        weight = 1 / np.abs(spring)
        for j in range(n):
            A = np.column_stack([rest[:, j], 1j * omega[:, 0] * rest[:, j]]) * weight[:, j : j + 1]
            b = g[:, j] * weight[:, j]
            real = np.concatenate([A.real, A.imag])
            scale = np.linalg.norm(real, axis=0)
            if not np.all(scale > 0):
                return none
            K[j], D[j] = (
                np.linalg.lstsq(real / scale, np.concatenate([b.real, b.imag]), rcond=None)[0] / scale
            )
    spring = K + 1j * omega * D
    if not np.all(np.abs(spring) > _NO_SPRING):
        return none
    left = rest - g / spring
    share = np.sqrt(np.mean(np.abs(left) ** 2, axis=0)) / size
    rigid = np.sqrt(np.mean(np.abs(rest) ** 2, axis=0)) / size
    return LinkSide(K, D, float(share.max()), float(rigid.min()))


def _left_by_the_motors_equation(phasors: Phasors, inertias: Sequence[Inertia]) -> float:
    """Residual over the torque for angles of the motors; inf for unphysical K."""
    try:
        fit = identify_elasticity(phasors, inertias, method="weighted")
        if np.any(fit.K <= 0):
            return np.inf
        springs = Elasticity(K=fit.K, D=np.maximum(fit.D, 0.0))
        modelled = np.array(
            [
                np.linalg.solve(motor_response(w, inertia, springs).reshape(q.size, q.size), -(w**2) * q)
                for w, q, inertia in zip(phasors.omega, phasors.q, inertias, strict=True)
            ]
        )
    except (JointIdError, np.linalg.LinAlgError):
        return np.inf
    size = np.sqrt(np.mean(np.abs(phasors.tau) ** 2, axis=0))
    return float((np.sqrt(np.mean(np.abs(phasors.tau - modelled) ** 2, axis=0)) / size).max())
