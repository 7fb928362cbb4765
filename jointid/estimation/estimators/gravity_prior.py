"""Fit of the gravity stiffness within the uncertainty of the inertias."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Floats
from jointid.estimation.estimators.problem import Problem
from jointid.estimation.estimators.whitened_residual import WhitenedResidual
from jointid.small_matrices import determined_covariance, finite_part

_STEPS, _SMALL_GAIN = 4, 0.1
"""Gauss-Newton steps of the gravity stiffness, and decrease of the cost that needs no further one."""
_MOST, _COUPLING = 0.3, 0.1
"""Largest relative standard deviation of a gravity stiffness, also where the inertias are unknown, and
that of a coupling of zero, relative to those of its joints."""


@dataclass(frozen=True, eq=False)
class Gravity:
    """Elements of the gravity stiffness of every pose as further unknowns u, in units of their prior."""

    size: Floats
    """Standard deviation of each lower element by the prior, shape (p, e), N·m/rad."""
    shift: Floats
    """Change of the parameters with u, shape (P, p e)."""
    precision: Floats
    """Information on u, with the parameters free, shape (p e, p e)."""
    gradient: Floats
    """Gradient of half the cost with respect to u, shape (p e,)."""

    @classmethod
    def of(cls, residual: WhitenedResidual, covariance: Floats) -> Gravity | None:
        """At the estimate with a covariance (P, P) by noise and prior; None where gravity is exact.

        It follows from the same masses and gear ratios as the inertias, and is as uncertain.
        """
        prior = residual.at.problem.prior
        std = min(prior.inertia_std, _MOST)
        if not std or not prior.gravity.any():
            return None
        i, j = prior.elements
        own = np.sqrt(np.abs(np.diagonal(prior.gravity, axis1=1, axis2=2)))
        size = std * np.maximum(np.abs(prior.gravity[:, i, j]), _COUPLING * own[:, i] * own[:, j])
        by = residual.projection.rows(residual.at.by_gravity(residual.smoothed()))
        columns = [by * (prior.pose == k)[:, None, None] * each for k, each in enumerate(size)]
        G = np.concatenate(columns, axis=2).reshape(-1, size.size)
        pull = residual.visible_columns.reshape(len(G), -1).T @ G
        shift = -2 * finite_part(covariance) @ pull
        precision = G.T @ G + 0.5 * np.eye(size.size) + pull.T @ shift
        return cls(size, shift, precision, G.T @ residual.rows.ravel())

    def covariance(self) -> Floats:
        """Part of the covariance of the parameters, shape (P, P)."""
        return np.asarray(0.5 * self.shift @ np.linalg.solve(self.precision, self.shift.T))

    def moved(self, problem: Problem, p: Floats, before: Floats) -> tuple[Problem, Floats, Floats]:
        """Problem and parameters after a Gauss-Newton step, and u, which was ``before``, (p e,)."""
        step = -np.linalg.solve(self.precision, self.gradient + 0.5 * before)
        change = problem.prior.symmetric((step * self.size.ravel()).reshape(self.size.shape))
        prior = replace(problem.prior, gravity=problem.prior.gravity + change)
        return replace(problem, prior=prior), p + self.shift @ step, before + step


def with_gravity(
    problem: Problem, p: Floats, residual: WhitenedResidual, normal: Floats
) -> tuple[Problem, Floats, WhitenedResidual]:
    """Problem, parameters and residual with the gravity stiffness fitted within its prior.

    ``normal`` is the normal matrix (P, P) at the estimate with the gravity as given.
    """
    given = 0.5 * problem.prior_residual(p)[1]
    u = np.zeros(len(problem.prior.gravity) * problem.prior.elements[0].size)
    for _ in range(_STEPS):
        found = Gravity.of(residual, 0.5 * determined_covariance(normal, given))
        if found is None:
            break
        moved, near, u = found.moved(problem, p, u)
        if not moved.feasible(near):
            break
        after = WhitenedResidual.of(moved, near)
        if not after.cost < residual.cost:
            break
        gain = residual.cost - after.cost
        problem, p, residual = moved, near, after
        if gain < _SMALL_GAIN:
            break
    return problem, p, residual
