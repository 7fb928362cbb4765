"""Maximum likelihood of K, D, friction and delay: errors in variables, all harmonics, one Gauss-Newton.

With the residual r and its covariance V (``residual``), maximising the likelihood over the unknown true
τ and q as well leaves Σ rᴴV⁻¹r to be minimised over the parameters. Its gradient is 2 Re JᴴV⁻¹r with the
Jacobian J at the smoothed signals z − C EᴴV⁻¹r, which removes the bias of least squares with noise in q
(Pintelon and Schoukens, System Identification, 2nd ed. 2012, chapter 9; Söderström, Errors-in-Variables
Methods in System Identification, 2018).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.friction import FrictionWaveforms
from jointid.estimation.linear_fit import Estimate
from jointid.estimation.noise import Noise
from jointid.estimation.residual import Problem, make_problem
from jointid.estimation.whitened_residual import WhitenedResidual
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.small_matrices import NO_EFFECT, unit_diagonal

_ITERATIONS = 40
"""Upper limit of Levenberg-Marquardt; small friction with a long delay has taken thirty."""
_INSEPARABLE = 1e-10
"""Smallest eigenvalue of the information matrix of unit diagonal; below it, in double precision,
parameters cannot be separated."""
_TOLERANCE = 1e-2
"""Step in standard errors at which the iteration ends: far below what the noise resolves."""
_LEAST_DAMPING = 1e-12
"""Of the normal matrix of unit diagonal: its rounding must not make a step singular."""


@dataclass(frozen=True, eq=False)
class LikelihoodEstimate(Estimate):
    """The estimate, with the friction-compensated phasors."""

    phasors: Phasors
    """Phasors with friction and delay subtracted from the torque: what acts on springs and inertias."""
    inflation: float
    """Factor on the fundamental's variance in ``covariance`` that accounts for the model's misfit."""


def maximum_likelihood(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    start: Floats,
    *,
    friction: FrictionWaveforms | None = None,
    delay: bool = False,
    noise: Noise | None = None,
) -> LikelihoodEstimate:
    """Fit K and D, and optionally friction and delay, to all records and harmonics.

    Parameters
    ----------
    phasors : Phasors
    inertia : Inertia or sequence of Inertia
        One for all records, or one per record.
    start : ndarray, shape (2n,) or (P,)
        Start values: K and D of a linear estimator, or all parameters of a similar fit.
    friction : FrictionWaveforms, optional
        Fit Coulomb and viscous friction with these waveforms.
    delay : bool, default False
        Fit a delay of the torque in addition to that of the records.
    noise : Noise, optional
        Noise of the phasors, where it is already known.

    Returns
    -------
    LikelihoodEstimate
        Its ``layout`` names the parameters. The Coulomb friction of a motor that never reverses is
        zero with variance zero.

    Raises
    ------
    JointIdError
        When some parameters cannot be separated, or no positive stiffness fits.
    """
    n = phasors.n
    problem = make_problem(phasors, inertia, start, friction, delay, noise)
    p = np.concatenate([start, np.zeros(problem.layout.size - start.size)])
    scale = np.ones(problem.s.shape[1])
    _require_rows(problem, p)
    p, _ = _minimise(problem, p, scale)
    rank, scale = harmonic_scale(problem, p)
    p, normal = _minimise(problem, p, scale)
    information = inverse_normal(problem, normal)
    first = problem.z[:, 0]
    lost = WhitenedResidual.of(problem, p, scale).friction_delay_torque()
    clean = replace(phasors, q=first[:, :n], tau=first[:, n:] - lost)
    clean = replace(clean, covariance=phasors.harmonic_covariance[:, 0])
    return LikelihoodEstimate(
        layout=problem.layout,
        p=p,
        covariance=0.5 * information,
        cost=WhitenedResidual.of(problem, p, np.ones_like(scale)).cost,
        expected_cost=max((problem.rows - rank - p.size) / 2, 0.0),
        parameter_count=rank + p.size,
        phasors=clean,
        inflation=float(scale[0]),
    )


def harmonic_scale(problem: Problem, p: Floats) -> tuple[int, Floats]:
    """Effective degrees of freedom of the free friction; factor (H,) on each harmonic's variance.

    The factor is the harmonic's misfit, at least 1: a harmonic that the model does not explain gets less
    weight.
    """
    residual = WhitenedResidual.of(problem, p, np.ones(problem.s.shape[1]))
    rank = residual.projection.rank()
    return rank, np.maximum(1.0, residual.misfit_by_harmonic(rank))


def gain_of_delay(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    estimate: LikelihoodEstimate,
    friction: FrictionWaveforms | None,
    noise: Noise,
) -> float:
    """Decrease of the cost of an estimate without delay when a delay is added, to second order.

    Rao's score test: one evaluation in place of a fit.
    """
    problem = make_problem(phasors, inertia, estimate.p, friction, True, noise)
    scale = np.ones(problem.s.shape[1])
    _, gradient, normal = quadratic(problem, np.append(estimate.p, 0.0), scale)
    size = np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
    others = normal[:-1, :-1] / np.outer(size[:-1], size[:-1]) + 1e-12 * np.eye(size.size - 1)
    coupling = normal[:-1, -1] / size[:-1]
    own = normal[-1, -1] - coupling @ np.linalg.solve(others, coupling)
    return float(gradient[-1] ** 2 / own) if own > 0 else np.inf


def _require_rows(problem: Problem, p: Floats) -> None:
    if problem.rows == 0:
        raise JointIdError(
            "No motor moves visibly in any record, so that friction cannot be told from elasticity: "
            "move the motors more, or log their positions with more digits."
        )
    if problem.rows >= problem.free.shapes + 2 * p.size or not problem.free.groups:
        return
    residual = WhitenedResidual.of(problem, p, np.ones(problem.s.shape[1]))
    if problem.rows < residual.projection.rank() + 2 * p.size:
        raise JointIdError(
            "The phasors hold too few harmonics to tell friction from elasticity: extract them with "
            "harmonics=31, or sample faster."
        )


def _minimise(problem: Problem, p: Floats, scale: Floats) -> tuple[Floats, Floats]:
    """Levenberg-Marquardt; returns the parameters and the normal matrix Σ JᵀJ there.

    It ends when a step is below ``_TOLERANCE`` standard errors, inflated by the misfit.
    """
    n, damping = problem.n, 1e-3
    cost, gradient, normal = quadratic(problem, p, scale)
    for _ in range(_ITERATIONS):
        size = np.sqrt(np.diag(normal))
        size = np.where(size > NO_EFFECT, size, 1.0)
        near = _TOLERANCE * np.sqrt(max(1.0, 2 * cost / problem.rows))
        while True:
            scaled = normal / np.outer(size, size) + damping * np.eye(p.size)
            step = -np.linalg.solve(scaled, gradient / size) / size
            trial = p + step
            if np.all(trial[:n] > 0) and np.all(trial[:n] < problem.stiffest):
                if damping < 1 and np.abs(step * size).max() < near:
                    return trial, normal
                new = quadratic(problem, trial, scale)
                if new[0] <= cost * (1 + 1e-12):
                    break
            if damping > 1e8:
                return p, normal
            damping = max(10 * damping, 1e-6)
        p, (cost, gradient, normal) = trial, new
        damping = max(damping / 10, _LEAST_DAMPING)
    return p, normal


def quadratic(problem: Problem, p: Floats, scale: Floats) -> tuple[float, Floats, Floats]:
    """Cost, half its gradient, and normal matrix."""
    residual = WhitenedResidual.of(problem, p, scale)
    rows, columns = residual.rows.reshape(-1), residual.columns().reshape(-1, p.size)
    return float(rows @ rows), columns.T @ rows, columns.T @ columns


def inverse_normal(problem: Problem, normal: Floats) -> Floats:
    """Inverse of the normal matrix; zero in rows and columns of parameters without any effect."""
    seen, size, scaled = unit_diagonal(normal)
    if not np.all(seen[: 2 * problem.n]):
        name = problem.layout.labels[int(np.argmin(seen))]
        raise JointIdError(f"The records do not determine {name}: move joint {name[1:]} more.")
    values, vectors = np.linalg.eigh(scaled)
    if values[0] < _INSEPARABLE:
        names = np.array(problem.layout.labels)[seen][np.abs(vectors[:, 0]) > 0.3]
        raise JointIdError(
            f"The records cannot tell {' and '.join(names)} apart. Add records at other frequencies, "
            "and with other relative amplitudes and phases of the joints."
        )
    inverse = np.zeros_like(normal)
    inverse[np.ix_(seen, seen)] = np.linalg.inv(scaled) / np.outer(size, size)
    return inverse
