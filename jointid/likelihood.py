"""Maximum likelihood of K, D, friction and delay: errors in variables, every harmonic, one Gauss-Newton.

With the residual r of the torque balance and its covariance V (``torque_balance``), maximising the
likelihood over the unknown true τ and q as well leaves Σ rᴴV⁻¹r to be minimised over the parameters. Its
gradient is 2 Re JᴴV⁻¹r with the Jacobian J taken at the smoothed signals z − C EᴴV⁻¹r: this is what
removes the bias that noise in q brings to least squares (Pintelon and Schoukens, System Identification,
2nd ed. 2012, chapter 9; Söderström, Errors-in-Variables Methods in System Identification, 2018).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.friction import FrictionWaveforms
from jointid.joints import Inertia
from jointid.linear_fit import Estimate
from jointid.noise import Noise
from jointid.phasors import Phasors
from jointid.torque_balance import Problem, make_problem
from jointid.whitened_balance import WhitenedBalance

_PASSES = 40  # small friction and a long lag together have taken thirty
_LEAST_DAMPING = 1e-12  # of the scaled normal matrix: its rounding cannot make a step singular
_NO_EFFECT = 1e-60  # of a parameter of 1, SI units, in standard errors: the motor stands still
_INSEPARABLE = 1e-10  # smallest eigenvalue of the scaled information matrix that still tells two apart


@dataclass(frozen=True, eq=False)
class LikelihoodEstimate(Estimate):
    """The estimate, with what it takes for friction and delay."""

    phasors: Phasors
    """The phasors whose torque is freed from friction and delay: what the springs and inertias got."""
    inflation: float
    """Factor of the fundamental's variance in ``covariance``, for what the model leaves unexplained."""


def maximum_likelihood(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    start: Floats,
    *,
    friction: FrictionWaveforms | None = None,
    delay: bool = False,
    noise: Noise | None = None,
) -> LikelihoodEstimate:
    """Fit K and D, and on demand friction and delay, to all records and harmonics.

    Parameters
    ----------
    phasors : Phasors
    inertia : Inertia or sequence of Inertia
        One for all records, or one per record.
    start : ndarray, shape (2n,) or (P,)
        K and D to begin with, from a linear estimator, or all parameters from a like fit.
    friction : FrictionWaveforms, optional
        Fit Coulomb and viscous friction with these waveforms.
    delay : bool, default False
        Fit a lag of the torque beyond what the records state.
    noise : Noise, optional
        Of the phasors, where it is known already.

    Returns
    -------
    LikelihoodEstimate
        p = (K, D, then coulomb (n), viscous (n) and the friction curve (n · c), then delay), as far as
        fitted. A Coulomb friction that no record shows, since its motor never reverses, is zero with
        variance zero.

    Raises
    ------
    JointIdError
        When the data cannot tell some parameters apart, or no positive stiffness fits.
    """
    n = phasors.n
    problem = make_problem(phasors, inertia, start, friction, delay, noise)
    p = np.concatenate([start, np.zeros(len(problem.names) - start.size)])
    scale = np.ones(problem.s.shape[1])
    _require_rows(problem, p)
    p, _ = _minimise(problem, p, scale)
    rank, scale = harmonic_scale(problem, p)
    p, normal = _minimise(problem, p, scale)
    information = inverse_normal(problem, normal)
    first = problem.z[:, 0]
    taken = WhitenedBalance.of(problem, p, scale).taken()
    clean = replace(phasors, q=first[:, :n], tau=first[:, n:] - taken)
    clean = replace(clean, covariance=phasors.harmonic_covariance[:, 0])
    return LikelihoodEstimate(
        p=p,
        covariance=0.5 * information,
        cost=WhitenedBalance.of(problem, p, np.ones_like(scale)).cost,
        expected_cost=max((problem.rows - rank - p.size) / 2, 0.0),
        parameters=rank + p.size,
        phasors=clean,
        inflation=float(scale[0]),
    )


def harmonic_scale(problem: Problem, p: Floats) -> tuple[int, Floats]:
    """How many numbers free friction is worth, and the scale (H,) of each harmonic's variance.

    A harmonic that the model leaves unexplained counts as much less as it fits worse, and never more.
    """
    balance = WhitenedBalance.of(problem, p, np.ones(problem.s.shape[1]))
    rank = balance.projection.rank()
    return rank, np.maximum(1.0, balance.misfit_by_harmonic(rank))


def gain_of_delay(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    estimate: LikelihoodEstimate,
    friction: FrictionWaveforms | None,
    noise: Noise,
) -> float:
    """How much a lag of the torque would lower the cost of an estimate without one, to second order.

    This is Rao's score test, at the price of one evaluation instead of a fit.
    """
    problem = make_problem(phasors, inertia, estimate.p, friction, True, noise)
    scale = np.ones(problem.s.shape[1])
    _, gradient, normal = quadratic(problem, np.append(estimate.p, 0.0), scale)
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
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
    balance = WhitenedBalance.of(problem, p, np.ones(problem.s.shape[1]))
    if problem.rows < balance.projection.rank() + 2 * p.size:
        raise JointIdError(
            "The phasors hold too few harmonics to tell friction from elasticity: extract them with "
            "harmonics=31, or sample faster."
        )


def _minimise(problem: Problem, p: Floats, scale: Floats) -> tuple[Floats, Floats]:
    """Levenberg-Marquardt; returns the parameters and the normal matrix Σ JᵀJ there.

    It ends when a step is a hundredth of an error bar, as the misfit widens it.
    """
    n, damping = problem.n, 1e-3
    cost, gradient, normal = quadratic(problem, p, scale)
    for _ in range(_PASSES):
        size = np.sqrt(np.diag(normal))
        size = np.where(size > _NO_EFFECT, size, 1.0)
        near = 1e-2 * np.sqrt(max(1.0, 2 * cost / problem.rows))
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
    balance = WhitenedBalance.of(problem, p, scale)
    rows, columns = balance.rows.reshape(-1), balance.columns().reshape(-1, p.size)
    return float(rows @ rows), columns.T @ rows, columns.T @ columns


def inverse_normal(problem: Problem, normal: Floats) -> Floats:
    """Inverse of the normal matrix; parameters without any effect stay out of it."""
    size = np.sqrt(np.diag(normal))
    seen = size > _NO_EFFECT
    if not np.all(seen[: 2 * problem.n]):
        name = problem.names[int(np.argmin(seen))]
        raise JointIdError(f"The records say nothing of {name}: move joint {name[1:]} more.")
    scaled = normal[np.ix_(seen, seen)] / np.outer(size[seen], size[seen])
    values, vectors = np.linalg.eigh(scaled)
    if values[0] < _INSEPARABLE:
        names = np.array(problem.names)[seen][np.abs(vectors[:, 0]) > 0.3]
        raise JointIdError(
            f"The records cannot tell {' and '.join(names)} apart. Add records at other frequencies, "
            "and with other relative amplitudes and phases of the joints."
        )
    inverse = np.zeros_like(normal)
    inverse[np.ix_(seen, seen)] = np.linalg.inv(scaled) / np.outer(size[seen], size[seen])
    return inverse
