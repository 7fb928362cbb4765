"""Linear estimators of K and D: the paper's two, weighted, and one without the given inertias.

Erratum. The pseudo-inverse (13)-(14) gives K = Σ Re(a*b) / Σ|a|² and D = Σ ω Im(a*b) / Σ ω²|a|². The
paper's explicit solution (15) has the same K, but D = Σ Im(a*b) / Σ ω|a|²: equal for one frequency,
weighted differently for several, and exact without noise as well. Both are provided.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import (
    SpringEquations,
    inertia_arrays,
    pseudo_inverse,
    spring_equations,
)
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import ParameterLayout, Parameters
from jointid.phasors.extract import Phasors
from jointid.small_matrices import positive_inverse, root, whitener

_WEIGHT_ITERATIONS = 3
"""Updates of the weights, which depend on K and D only weakly."""
_STEP = 1e-4
"""Relative change of an inertia for its derivative; its error is of second order."""
_LEAST_SHARE, _LEAST_DAMPED = 1e-3, 5e-3
"""Least eigenvalue of an estimated M2 with unit diagonal, and least D ω over K."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters (K1 ... Kn, D1 ... Dn, further ones) with their covariance and the cost of the fit."""

    layout: ParameterLayout
    p: Floats
    """Shape (P,)."""
    covariance: Floats
    """Shape (P, P), from the noise alone."""
    cost: float
    """Sum of squares of the residual in units of its noise."""
    expected_cost: float
    """Its expected value for a correct model and the stated noise; 0 without redundancy."""
    parameter_count: int
    """Number of fitted real numbers, those of free friction included."""

    @property
    def named(self) -> Parameters:
        """The parameters by name."""
        return self.layout.named(self.p)

    @property
    def elasticity(self) -> Floats:
        """K1 ... Kn, D1 ... Dn, shape (2n,)."""
        return self.p[self.layout.span("K", "D")]

    @property
    def elasticity_covariance(self) -> Floats:
        """Their covariance from the noise alone, shape (2n, 2n)."""
        part = self.layout.span("K", "D")
        return self.covariance[part, part]

    @property
    def misfit(self) -> float:
        """Cost over its expected value; 1 without redundancy."""
        return self.cost / self.expected_cost if self.expected_cost > 0 else 1.0


def least_squares(equations: SpringEquations) -> Estimate:
    """Equations (13)-(14)."""
    return _estimate(equations, _pseudo_inverse_gain(equations), weighted=False)


def explicit(equations: SpringEquations) -> Estimate:
    """Equation (15) as printed."""
    return _estimate(equations, _pseudo_inverse_gain(equations, 0), weighted=False)


def weighted(equations: SpringEquations) -> Estimate:
    """Generalised least squares, started by least squares; weights from the noise of both a and b."""
    gain = _pseudo_inverse_gain(equations)
    for _ in range(_WEIGHT_ITERATIONS):
        K, D = np.split(_apply(gain, equations.b), 2)
        gain, _ = _weighted_gain(equations, equations.residual_covariance(K, D))
    return _estimate(equations, gain, weighted=True)


def without_inertias(phasors: Phasors, prior: InertiaPrior) -> Parameters | None:
    """K, D, M and M2 by linear least squares, without the given inertias; None if not physical.

    With c = M2⁻¹ and κ = K + sD, equation (8) of joint j is

        κ_j q_j + Σ_k κ_j c_jk M_k q_k − Σ_k κ_j c_jk τ_k/s² + M_j s² q_j = τ_j,

    linear in M_j and in the products with K_j and D_j. It holds for one pose: poses differ in M2.
    """
    n = phasors.n
    if phasors.motion.any():  # where (8) has end terms
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
    D = np.clip(D, _LEAST_DAMPED * K / phasors.omega.max(), K / phasors.omega.min())
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


LINEAR = {"weighted": weighted, "least-squares": least_squares, "explicit": explicit}
"""The linear estimators by the name of their method; none of them models friction."""


def prior_slopes(
    method: str, phasors: Phasors, prior: InertiaPrior, noise: Noise
) -> tuple[Floats, Floats]:
    """Derivatives of K and D by each given inertia and torque scale, with its standard deviation.

    Shapes (2n, E), by central differences, and (E,), both in the order of ``prior.blocks()``.
    """
    equations = spring_equations(phasors, prior.inertias(prior.M, prior.M2), noise=noise)
    changes, slopes, stds = _by_given(phasors, prior), [np.zeros((0, 2 * prior.n))], [np.zeros(0)]
    for name, (_, std) in prior.blocks().items():
        step = _STEP * prior.units[name].reshape(-1, 1)
        of_a, of_b = (step[..., None, None] * change for change in changes[name])
        plus, minus = (
            _solution(method, equations.changed(phasors.z, sign * of_a, sign * of_b)) for sign in (1, -1)
        )
        slopes.append((plus - minus) / (2 * step))
        stds.append(std.ravel())
    return np.concatenate(slopes).T, np.concatenate(stds)


def _by_given(phasors: Phasors, prior: InertiaPrior) -> dict[str, tuple[Floats, Floats]]:
    """Derivatives of ``of_a`` and ``of_b`` by the values of each block, each (E, r, n, 2n)."""
    M, arm = inertia_arrays(phasors, prior.inertias(prior.M, prior.M2))
    s2, n = -(phasors.omega[:, None, None] ** 2), prior.n
    own = np.eye(n)[:, None, :, None] * np.eye(n)[:, None, None, :]  # (n, 1, n, n), 1 at (k, :, k, k)
    column = (
        arm.transpose(2, 0, 1)[..., None] * np.eye(n)[:, None, None]
    )  # (n, r, n, n), column k of arm
    by_M2 = -prior.by_elements(arm[:, None], arm).transpose(3, 0, 2, 1)
    none = np.zeros_like(column)
    found = {
        "M": (column * s2, none, -own * s2**2, none, prior.rotor, len(prior.M)),
        "M2": (by_M2 * M[:, None] * s2, -by_M2, *[np.zeros_like(by_M2)] * 2, prior.part[prior.pose],
               len(prior.rest)),
        "torque_scale": (none, -column, none, own * s2, np.zeros_like(prior.pose), 1),
    }  # fmt: skip
    return {
        name: (_of_each([a_q, a_tau], *of), _of_each([b_q, b_tau], *of))
        for name, (a_q, a_tau, b_q, b_tau, *of) in found.items()
    }


def _of_each(halves: Sequence[Floats], of: np.ndarray, count: int) -> Floats:
    """Matrices (count e, r, n, 2n) from halves (e, r, n, n): zero in records ``of`` another value."""
    whole = np.concatenate(halves, axis=3)
    own = (of == np.arange(count)[:, None])[:, None, :, None, None]
    return np.asarray(np.where(own, whole, 0).reshape(-1, *whole.shape[1:]))


def _solution(method: str, equations: SpringEquations) -> Floats:
    """K and D of an estimator, shape (E, 2n), for equations of shape (E, r, n)."""
    a, b, omega = equations.a, equations.b, equations.omega
    p = np.concatenate(pseudo_inverse(omega, a, b, explicit=method == "explicit"), axis=-1)
    for _ in range(_WEIGHT_ITERATIONS if method == "weighted" else 0):
        W = whitener(equations.residual_covariance(*np.split(p, 2, axis=-1)))
        R = (W @ _regressors(equations)).reshape(len(a), -1, p.shape[-1])
        right = (W @ b[..., None]).reshape(len(a), -1, 1)
        adjoint = R.conj().swapaxes(1, 2)
        normal, moment = (adjoint @ R).real, (adjoint @ right).real
        try:
            p = np.asarray(np.linalg.solve(normal, moment)[..., 0], float)
        except np.linalg.LinAlgError:  # a changed inertia may make it singular
            p = np.asarray((np.linalg.pinv(normal, hermitian=True) @ moment)[..., 0], float)
    return p


def prior_covariance(method: str, phasors: Phasors, prior: InertiaPrior, noise: Noise) -> Floats:
    """Covariance of K and D, shape (2n, 2n), from the uncertain inertias and torque scales.

    A linear estimator takes them as given.
    """
    slope, std = prior_slopes(method, phasors, prior, noise)
    if not prior.shared.any() or not np.isfinite(std).all():
        return carried_covariance(slope, std)
    return np.asarray(slope @ block_diag(*map(prior.covariance, prior.blocks())) @ slope.T)


def carried_covariance(slope: Floats, std: Floats) -> Floats:
    """Covariance (m, m) of quantities with slopes (m, E) by values of independent errors std (E,)."""
    known = np.isfinite(std)
    shift = slope[:, known] * std[known]
    covariance = np.asarray(shift @ shift.T)
    moved = np.any(slope[:, ~known] != 0, axis=1)
    covariance[moved, moved] = np.inf
    return covariance


def _pseudo_inverse_gain(equations: SpringEquations, power: int = 1) -> Complexes:
    """Every linear estimator is p = Σ_r Re(G_r b_r) with a gain G of shape (r, 2n, n).

    The damping of a record has the weight ω to the given power: 1 in (14), 0 in (15).
    """
    a, weight = equations.a, equations.omega[:, None] ** power
    stiffness = a.conj() / (np.abs(a) ** 2).sum(axis=0)
    damping = -1j * weight * a.conj() / (weight * equations.omega[:, None] * np.abs(a) ** 2).sum(axis=0)
    return _diagonals(stiffness, damping)


def _weighted_gain(equations: SpringEquations, V: Complexes) -> tuple[Complexes, Floats]:
    """Gain (r, 2n, n) and normal matrix (2n, 2n) for the error covariance V (r, n, n)."""
    W = whitener(V)
    R = W @ _regressors(equations)
    rows = R.reshape(-1, R.shape[2])
    normal = (rows.conj().T @ rows).real
    return np.asarray(positive_inverse(normal) @ R.conj().swapaxes(1, 2) @ W), normal


def _regressors(equations: SpringEquations) -> Complexes:
    """R with b = R p, shape (..., r, n, 2n)."""
    return _diagonals(equations.a, 1j * equations.omega[:, None] * equations.a).swapaxes(-2, -1)


def _diagonals(first: Complexes, second: Complexes) -> Complexes:
    """Rows (..., n) and (..., n) as two stacked diagonal matrices, (..., 2n, n)."""
    eye = np.eye(first.shape[-1])
    return np.concatenate([first[..., None] * eye, second[..., None] * eye], axis=-2)


def _apply(gain: Complexes, b: Complexes) -> Floats:
    return np.asarray(np.einsum("rpj,rj->p", gain, b).real)


def _estimate(equations: SpringEquations, gain: Complexes, *, weighted: bool) -> Estimate:
    """Covariance and expected cost of p = Σ Re(G b), with V possibly estimated from few periods.

    With e = b − R p and leverages h_r = Re tr(G_r R_r), E[Σ eᴴV⁻¹e] = Σ (n − h_r) + tr(N Cov p), where
    N is the normal matrix of the weights V⁻¹.
    """
    r, n = equations.a.shape
    p = _apply(gain, equations.b)
    K, D = np.split(p, 2)
    V, e = equations.residual_covariance(K, D), equations.residual(K, D)
    noise = equations.noise
    leverage = np.einsum("rpj,rjp->r", gain, _regressors(equations)).real
    penalty = np.ones(r)
    if weighted:
        penalty += np.maximum(1 - leverage / (2 * n), 0) * (noise.weight_penalty - 1)
    # Re(G e) of a circular complex e has half the covariance of the complex number.
    error = np.sqrt(0.5 * penalty)[:, None, None] * (gain @ root(V))
    covariance = np.einsum("rpi,rqi->pq", error, error.conj()).real
    V = V * noise.inverse_bias[:, None, None]
    cost = float((np.abs(whitener(V) @ e[..., None]) ** 2).sum())
    _, normal = _weighted_gain(equations, V)
    expected = float((n - leverage).sum() + np.trace(normal @ covariance)) if r > 1 else 0.0
    return Estimate(ParameterLayout.of(n), p, covariance, cost, expected, parameter_count=2 * n)
