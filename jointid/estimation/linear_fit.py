"""Linear estimators of K and D: the paper's two, and weighted least squares.

Erratum. The pseudo-inverse (13)-(14) gives K = Σ Re(a*b) / Σ|a|² and D = Σ ω Im(a*b) / Σ ω²|a|². The
paper's explicit solution (15) has the same K, but D = Σ Im(a*b) / Σ ω|a|²: equal for one frequency,
weighted differently for several, and exact without noise as well. Both are provided.

Friction spoils them: with half of the torque, K may come out at a tenth. ``friction_start`` compares the
torque of the model, Z(K, D) q, with the measured one at the fundamental, in relative terms and with a
loss that forgives outliers; friction is linear in it and is eliminated (variable projection; Golub and
Pereyra, SIAM Journal on Numerical Analysis 10, 1973).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import least_squares as nonlinear_least_squares

from jointid.arrays import Complexes, Floats
from jointid.estimation.friction import friction_waveforms
from jointid.estimation.inertia_prior import InertiaPrior
from jointid.estimation.joint_equations import SpringEquations, inertia_arrays, spring_equations
from jointid.estimation.noise import Noise
from jointid.estimation.parameters import ParameterLayout, Parameters
from jointid.joints import motor_impedance
from jointid.phasors.extract import Phasors
from jointid.small_matrices import positive_inverse, root, whitener

_WEIGHT_ITERATIONS = 3
"""Updates of the weights, which depend on K and D only weakly."""
_STEP = 1e-4
"""Relative change of an inertia for its derivative; its error is of second order."""


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
    return _estimate(equations, _least_squares_gain(equations), weighted=False)


def explicit(equations: SpringEquations) -> Estimate:
    """Equation (15) as printed."""
    a, omega = equations.a, equations.omega[:, None]
    stiffness = a.conj() / (np.abs(a) ** 2).sum(axis=0)
    damping = -1j * a.conj() / (omega * np.abs(a) ** 2).sum(axis=0)
    return _estimate(equations, _diagonals(stiffness, damping), weighted=False)


def weighted(equations: SpringEquations) -> Estimate:
    """Generalised least squares, started by least squares; weights from the noise of both a and b."""
    gain = _least_squares_gain(equations)
    for _ in range(_WEIGHT_ITERATIONS):
        K, D = np.split(_apply(gain, equations.b), 2)
        gain, _ = _weighted_gain(equations, equations.residual_covariance(K, D))
    return _estimate(equations, gain, weighted=True)


LINEAR = {"weighted": weighted, "least-squares": least_squares, "explicit": explicit}
"""The linear estimators by the name of their method; none of them models friction."""


def prior_slopes(
    method: str, phasors: Phasors, prior: InertiaPrior, noise: Noise
) -> tuple[Floats, Floats]:
    """Derivatives of K and D by each given inertia and torque scale, with its standard deviation.

    Returns
    -------
    slope : ndarray, shape (2n, E)
        By central differences, in the order of ``prior.blocks()``.
    std : ndarray, shape (E,)
    """
    slopes, stds = [np.zeros((0, 2 * prior.n))], [np.zeros(0)]
    for name, (mean, std) in prior.blocks().items():
        step = _STEP * prior.units[name]
        for place in np.ndindex(mean.shape):
            change = np.zeros(mean.shape)
            change[place] = step[place]
            plus, minus = (
                LINEAR[method](_changed(phasors, prior, noise, name, by)).p for by in (change, -change)
            )
            slopes.append((plus - minus)[None] / (2 * step[place]))
        stds.append(std.ravel())
    return np.concatenate(slopes).T, np.concatenate(stds)


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


def _changed(
    phasors: Phasors, prior: InertiaPrior, noise: Noise, name: str, change: Floats
) -> SpringEquations:
    """Joint equations after a change of one block of the prior."""
    M, M2 = prior.M, prior.M2
    if name == "M":
        M = M + change
    elif name == "M2":
        M2 = M2 + prior.symmetric(change)[prior.part]
    else:
        phasors = phasors.scaled(np.concatenate([np.ones(prior.n), 1 + change]))
    return spring_equations(phasors, prior.inertias(M, M2), noise=noise)


def _least_squares_gain(equations: SpringEquations) -> Complexes:
    """Every linear estimator is p = Σ_r Re(G_r b_r) with a gain G of shape (r, 2n, n)."""
    a, omega = equations.a, equations.omega[:, None]
    stiffness = a.conj() / (np.abs(a) ** 2).sum(axis=0)
    damping = -1j * omega * a.conj() / ((omega * np.abs(a)) ** 2).sum(axis=0)
    return _diagonals(stiffness, damping)


def _weighted_gain(equations: SpringEquations, V: Complexes) -> tuple[Complexes, Floats]:
    """Gain (r, 2n, n) and normal matrix (2n, 2n) for the error covariance V (r, n, n)."""
    W = whitener(V)
    R = W @ _regressors(equations)
    rows = R.reshape(-1, R.shape[2])
    normal = (rows.conj().T @ rows).real
    return np.asarray(positive_inverse(normal) @ R.conj().swapaxes(1, 2) @ W), normal


def _regressors(equations: SpringEquations) -> Complexes:
    """R with b = R p, shape (r, n, 2n)."""
    return _diagonals(equations.a, 1j * equations.omega[:, None] * equations.a).swapaxes(1, 2)


def _diagonals(first: Complexes, second: Complexes) -> Complexes:
    """Rows (r, n) and (r, n) as two stacked diagonal matrices, (r, 2n, n)."""
    eye = np.eye(first.shape[1])
    return np.concatenate([first[:, :, None] * eye, second[:, :, None] * eye], axis=1)


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


_UNEXPLAINED = 0.1
"""Relative residual of the linear estimate from which friction is looked for."""
_OUTLIER = 0.1
"""Relative residual from which a record counts less."""
_BETTER = 0.5
"""Residual over that of the linear estimate below which the new start is taken."""
_STARTS = 0.75, 0.5, 1.0
"""Quantiles of the frequencies at which the arm resonates with the motors held."""
_EVALUATIONS = 30
"""Most Jacobians from each of them."""
_RANGE = 30.0
"""Largest factor on a start value: the arm resonates within a factor of 5 of the frequencies."""


_HUGE = 1e50
"""Largest relative residual; its square and sums of squares stay finite."""


@dataclass(frozen=True, eq=False)
class _Fundamentals:
    """Torques at the fundamental, and the friction phasors of each joint."""

    phasors: Phasors
    M: Floats
    arm: Floats
    friction: Complexes
    """Of Coulomb and viscous friction, shape (r, n, 2)."""
    moving: np.ndarray
    """Whether a joint moves in a record, shape (r, n)."""

    def residual(self, p: Floats) -> tuple[Floats, Floats]:
        """Relative residual, shape (rows,), at the logarithms of K and D, and the friction, (2, n)."""
        n, ph = self.phasors.n, self.phasors
        s = np.asarray(1j * ph.omega, np.complex128)
        Z, _ = motor_impedance(s, self.M, self.arm, *np.exp(p.reshape(2, n)))
        rest = ph.tau - (Z @ ph.q[..., None])[..., 0]
        residual, found = [], np.zeros((2, n))
        for j in range(n):
            used = self.moving[:, j] & (np.abs(ph.tau[:, j]) > 0)
            weight = 1 / np.abs(ph.tau[used, j])
            A, b = (_real(x * w) for x, w in (
                (self.friction[used, j], weight[:, None]), (rest[used, j], weight)
            ))  # fmt: skip
            found[:, j] = np.maximum(np.linalg.lstsq(A, b, rcond=None)[0], 0.0)
            residual.append(b - A @ found[:, j])
        return np.concatenate(residual), found

    def relative(self, p: Floats) -> Floats:
        """The residual alone, finite at any K and D."""
        with np.errstate(all="ignore"):
            return np.clip(np.nan_to_num(self.residual(p)[0], nan=_HUGE), -_HUGE, _HUGE)


def friction_start(phasors: Phasors, prior: InertiaPrior, linear: Parameters) -> Parameters | None:
    """Return K, D and the friction of all joints; None where the linear estimate is as good.

    Parameters
    ----------
    phasors : Phasors
        r records of n joints.
    prior : InertiaPrior
    linear : Parameters
        K and D by least squares.
    """
    n = phasors.n
    waveforms = friction_waveforms(phasors, 0.0)
    viscous = 1j * phasors.omega[:, None] * phasors.q
    data = _Fundamentals(
        phasors,
        *inertia_arrays(phasors, prior.inertias(prior.M, prior.M2)),
        np.stack([waveforms.coulomb[:, 0], viscous], axis=2),
        ~waveforms.stationary,
    )
    least = np.inf
    if np.all(linear.K > 0) and np.all(linear.D > 0):
        least = _size(data.residual(np.log(np.concatenate([linear.K, linear.D])))[0])
    if least < _UNEXPLAINED:
        return None
    own = np.diagonal(prior.M2[prior.pose], axis1=1, axis2=2).mean(axis=0)
    best, start = _BETTER * least, None
    for share in _STARTS:
        omega = float(np.quantile(phasors.omega, share))
        first = np.log(np.concatenate([own * omega**2, 0.05 * own * omega]))
        found = nonlinear_least_squares(
            data.relative,
            first,
            bounds=(first - np.log(_RANGE), first + np.log(_RANGE)),
            loss="soft_l1",
            f_scale=_OUTLIER,
            ftol=1e-3,
            max_nfev=_EVALUATIONS,
        )
        residual, friction = data.residual(found.x)
        if _size(residual) < best:
            best, (K, D) = _size(residual), np.exp(found.x.reshape(2, n))
            layout = ParameterLayout.of(n, friction=True)
            values = layout.pack(K=K, D=D, coulomb=friction[0], viscous=friction[1])
            start = layout.named(values)
        if best < _UNEXPLAINED:
            break
    return start


def _size(residual: Floats) -> float:
    """Typical size: outliers do not count."""
    return float(np.median(np.abs(residual))) if residual.size else np.inf


def _real(values: Complexes) -> Floats:
    return np.concatenate([values.real, values.imag])
