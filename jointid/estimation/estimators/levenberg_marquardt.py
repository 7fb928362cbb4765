"""Levenberg-Marquardt for the likelihood: its cost, gradient and normal matrix, and the iteration."""

import numpy as np

from jointid.arrays import Floats
from jointid.estimation.estimators.parameters import GEAR_LAWS
from jointid.estimation.estimators.problem import Problem
from jointid.estimation.estimators.whitened_residual import POOR, WhitenedResidual
from jointid.small_matrices import NO_EFFECT

_ITERATIONS = 40
"""Upper limit of iterations; small friction with a long delay took thirty."""
_EVALUATIONS, _LAW_EVALUATIONS = 150, 24
"""Upper limits of evaluations; those of a gear law are slow, and the right law takes ten."""
_LEAST_DAMPING = 1e-12
"""Added to the diagonal of the normalised normal matrix, so that rounding does not make it singular."""
_IDLE, _MOST_IDLE = 0.02, 3
"""Negligible decrease of the cost over the misfit, and consecutive such steps that end the fit."""
_MOTION_IDLE = 0.1
"""Negligible decrease for motions with a gear law."""
_STUCK = 3e-3
"""Relative decrease of the cost that ends the fit of a model that does not explain the data."""
_LAW_STUCK = 2e-2
"""The same for a model with a gear law, whose evaluations are slow."""
LOST, _LOST_STUCK = 100.0, 0.1
"""Misfit of a model far from the data, and the relative decrease that ends its fit to motions."""
_ROUGH_IDLE, _ROUGH_TOLERANCE = 1.0, 0.1
"""The same as ``_IDLE`` and ``_TOLERANCE`` for a rough fit."""
_TOLERANCE = 1e-2
"""Step in standard errors at which the iteration ends, far below the resolution of the noise."""


def minimised(
    problem: Problem, p: Floats, scale: Floats, *, damping: float, roughly: bool = False
) -> tuple[Floats, Floats]:
    """Levenberg-Marquardt; returns the parameters and the normal matrix Σ JᵀJ there.

    It ends when a step is below ``_TOLERANCE`` standard errors, inflated by the misfit; ``roughly``,
    for a model that does not explain the data, when the cost hardly falls.
    """
    idle = 0
    least = _ROUGH_IDLE if roughly else _IDLE
    cost, gradient, normal = quadratic(WhitenedResidual.of(problem, p, scale), p)
    slow = any(name in problem.layout for name in GEAR_LAWS)
    left, stuck = (_LAW_EVALUATIONS, _LAW_STUCK) if slow else (_EVALUATIONS, _STUCK)
    harder = 10
    if slow and problem.motion is not None:  # these evaluations are the slowest
        harder, least = 100, max(least, _MOTION_IDLE)
    for _ in range(_ITERATIONS):
        # Hold parameters at their bounds (Bertsekas, SIAM Journal on Control and Optimization 20, 1982).
        free = (p > problem.layout.lowest) | (gradient < 0)
        size = np.sqrt(np.diag(normal))
        size = np.where(size > NO_EFFECT, size, 1.0)
        misfit = max(1.0, 2 * cost / problem.rows)
        near = (_ROUGH_TOLERANCE if roughly else _TOLERANCE) * np.sqrt(misfit)
        least_share = _LOST_STUCK if misfit > LOST and problem.ends is not None else stuck
        while True:
            scaled = normal / np.outer(size, size) + damping * np.eye(p.size)
            step = np.zeros(p.size)
            step[free] = -np.linalg.solve(scaled[np.ix_(free, free)], (gradient / size)[free])
            trial = np.maximum(p + step / size, problem.layout.lowest)
            step = trial - p
            if problem.feasible(trial):
                if damping < 1 and np.abs(step * size).max() < near:
                    return trial, normal
                new, left = _attempt(problem, trial, scale, cost * (1 + 1e-12)), left - 1
                if new is not None:
                    break
            expected = float(step @ (2 * gradient + normal @ step))  # of the cost, negative
            hopeless = (roughly or slow) and -expected < least * misfit
            hopeless |= misfit > POOR and -expected < stuck * cost
            if damping > 1e8 or left <= 0 or hopeless:
                return p, normal
            damping = max(harder * damping, 1e-6)
        fall = cost - new[0]
        idle = idle + 1 if fall < least * misfit or (misfit > POOR and fall < least_share * cost) else 0
        p, (cost, gradient, normal) = trial, new
        if idle == _MOST_IDLE:
            break
        damping = max(damping / 10, _LEAST_DAMPING)
    return p, normal


def one_step(problem: Problem, p: Floats) -> tuple[Floats, float]:
    """Parameters after a step towards the optimum, and the misfit there to second order."""
    residual = WhitenedResidual.of(problem, p)
    cost, gradient, normal = quadratic(residual, p)
    size = np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
    unit = normal / np.outer(size, size) + _LEAST_DAMPING * np.eye(p.size)
    step = -np.linalg.solve(unit, gradient / size) / size
    expected = max((problem.rows - residual.projection.rank() - p.size) / 2, 1.0)
    return np.maximum(p + step, problem.layout.lowest), float(cost + gradient @ step) / expected


def _attempt(
    problem: Problem, p: Floats, scale: Floats, most: float
) -> tuple[float, Floats, Floats] | None:
    """The same as ``quadratic``; None where the cost is above ``most`` or overflows."""
    with np.errstate(all="ignore"):
        try:
            residual = WhitenedResidual.of(problem, p, scale)
            if not residual.cost + penalty(problem, p) <= most:
                return None
            cost, gradient, normal = quadratic(residual, p)
        except np.linalg.LinAlgError:
            return None
    return (cost, gradient, normal) if np.isfinite(cost) and np.isfinite(normal).all() else None


def quadratic(residual: WhitenedResidual, p: Floats) -> tuple[float, Floats, Floats]:
    """Cost, half its gradient, and normal matrix, the prior's part included."""
    problem = residual.at.problem
    rows, columns = residual.rows.reshape(-1), residual.columns().reshape(-1, p.size)
    deviation, weight = problem.prior_residual(p)
    cost = float(rows @ rows) + penalty(problem, p)
    gradient = columns.T @ rows + 0.5 * weight @ deviation
    return cost, gradient, columns.T @ columns + 0.5 * weight


def penalty(problem: Problem, p: Floats) -> float:
    """Cost of the prior: a negative log likelihood like the data's."""
    deviation, weight = problem.prior_residual(p)
    return float(0.5 * deviation @ weight @ deviation)
