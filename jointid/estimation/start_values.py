"""Start values for a fit where those of the linear estimator lead nowhere."""

from __future__ import annotations

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.inertia_prior import InertiaPrior
from jointid.estimation.parameters import ParameterLayout, Parameters
from jointid.phasors.extract import Phasors

_LEAST_SHARE = 1e-3
"""Least eigenvalue of M2 with unit diagonal."""
_DAMPED = 0.05
"""D ω over K of a start."""


def at_resonances(phasors: Phasors, prior: InertiaPrior) -> list[Parameters]:
    """K with the arm's resonance at frequencies of the records, and a small D."""
    own = np.diagonal(prior.M2[prior.pose], axis1=1, axis2=2).mean(axis=0)  # M2jj, kg·m²
    layout, starts = ParameterLayout.of(phasors.n), []
    for share in (0.5, 1.0, 0.0):
        omega = float(np.quantile(phasors.excited, share))
        K = own * omega**2
        starts.append(layout.named(layout.pack(K=K, D=_DAMPED * K / omega)))
    return starts


def without_inertias(phasors: Phasors, prior: InertiaPrior) -> Parameters | None:
    """K, D, M and M2 by linear least squares, without the given inertias; None if not physical.

    With c = M2⁻¹ and κ = K + sD, equation (8) of joint j is

        κ_j q_j + Σ_k κ_j c_jk M_k q_k − Σ_k κ_j c_jk τ_k/s² + M_j s² q_j = τ_j,

    linear in M_j and in the products with K_j and D_j. Poses differ in M2, hence only for one.
    """
    n = phasors.n
    if phasors.motion.any():  # (8) has terms of the ends there
        return None
    several = len(prior.M) > 1 or len(prior.M2) > 1
    if several or prior.added.any() or prior.gravity.any() or 2 * phasors.omega.size < 4 * n + 1:
        return None
    s, q = 1j * phasors.omega[:, None], phasors.q
    rigid = np.concatenate([q, -phasors.tau / s**2], axis=1)
    M, K, D, arm = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((n, n))
    for j in range(n):
        columns = np.concatenate([rigid, s * rigid, s**2 * q[:, [j]]], axis=1)
        x = _least_squares(columns, phasors.tau[:, j])
        if x is None:
            return None
        of_K, of_D, M[j] = x[: 2 * n], x[2 * n : 4 * n], x[4 * n]
        K[j], D[j] = of_K[j] - of_K[n + j] * M[j], of_D[j] - of_D[n + j] * M[j]
        arm[j] = of_K[n:] / K[j]
    if not (np.all(K > 0) and np.all(M > 0) and np.all(np.diag(arm) > 0)):
        return None
    arm = (arm + arm.T) / 2
    own = np.sqrt(np.diag(arm))
    if np.linalg.eigvalsh(arm / np.outer(own, own))[0] < _LEAST_SHARE:
        return None
    M2 = np.linalg.inv(arm)
    D = np.clip(D, 0.1 * _DAMPED * K / phasors.omega.max(), K / phasors.omega.min())
    layout = ParameterLayout.of(n, rotors=1, arms=1)
    return layout.named(layout.pack(K=K, D=D, M=M, M2=M2[prior.elements]))


def _least_squares(A: Complexes, b: Complexes) -> Floats | None:
    """Real solution of complex equations, each row of unit length; None where it is undetermined."""
    size = np.linalg.norm(A, axis=0)
    if not np.all(size > 0):
        return None
    rows = np.linalg.norm(np.column_stack([A / size, b / np.linalg.norm(b)]), axis=1)
    if not np.all(rows > 0):
        return None
    A, b = A / size / rows[:, None], b / rows
    x, _, rank, _ = np.linalg.lstsq(
        np.concatenate([A.real, A.imag]), np.concatenate([b.real, b.imag]), rcond=1e-10
    )
    return np.asarray(x / size) if rank == size.size else None
