"""Fit of the gravity stiffness within the uncertainty of the inertias."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Floats
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.levenberg_marquardt import quadratic
from jointid.estimation.estimators.problem import Problem
from jointid.estimation.estimators.whitened_residual import WhitenedResidual
from jointid.small_matrices import determined_covariance, finite_part

_STEPS, _SMALL_GAIN = 10, 0.01
"""Gauss-Newton steps of all parameters, and decrease of the cost over the misfit that needs no more."""
_MOST, _COUPLING = 0.3, 0.1
"""Largest relative standard deviation of a gravity stiffness, also where the inertias are unknown, and
that of a coupling of zero, relative to those of its joints."""


def gravity_std(prior: InertiaPrior) -> Floats | None:
    """Standard deviation of each lower element of every pose, (p, e), N·m/rad; None if they are exact.

    Gravity follows from the same masses and gear ratios as the inertias, and is as uncertain.
    """
    std = min(prior.inertia_std, _MOST)
    if not std or not prior.gravity.any():
        return None
    i, j = prior.elements
    own = np.sqrt(np.abs(np.diagonal(prior.gravity, axis1=1, axis2=2)))
    return std * np.maximum(np.abs(prior.gravity[:, i, j]), _COUPLING * own[:, i] * own[:, j])


@dataclass(frozen=True, eq=False)
class Gravity:
    """Elements of the gravity stiffness of every pose as further unknowns u, in units of their prior."""

    shift: Floats
    """Change of the parameters with u, shape (P, p e)."""
    precision: Floats
    """Information on u, with the parameters free, shape (p e, p e)."""
    gradient: Floats
    """Gradient of half the cost with respect to u, at fixed parameters, shape (p e,)."""

    @classmethod
    def of(cls, residual: WhitenedResidual, columns: Floats, covariance: Floats, std: Floats) -> Gravity:
        """At parameters with Jacobian (r, m, P) and covariance (P, P) by noise and prior.

        ``std`` is that of the prior.
        """
        pose = residual.at.problem.prior.pose
        by = residual.projection.rows(residual.at.by_gravity(residual.smoothed()))
        of_poses = [by * (pose == k)[:, None, None] * each for k, each in enumerate(std)]
        G = np.concatenate(of_poses, axis=2).reshape(-1, std.size)
        pull = columns.reshape(len(G), -1).T @ G
        shift = -2 * finite_part(covariance) @ pull
        precision = G.T @ G + 0.5 * np.eye(std.size) + pull.T @ shift
        return cls(shift, precision, G.T @ residual.rows.ravel())

    def covariance(self) -> Floats:
        """Part of the covariance of the parameters, shape (P, P)."""
        return np.asarray(0.5 * self.shift @ np.linalg.solve(self.precision, self.shift.T))


def with_gravity(
    problem: Problem, p: Floats, scale: Floats, given: InertiaPrior, std: Floats
) -> tuple[Problem, Floats]:
    """Problem and parameters, from near the optimum, with the gravity stiffness fitted within its prior.

    Every step changes all parameters, because with a wrong gravity all of them were far off.
    """
    i, j = given.elements
    off = (problem.prior.gravity - given.gravity)[:, i, j]
    u = np.divide(off, std, out=np.zeros_like(off), where=std > 0).ravel()
    residual = WhitenedResidual.of(problem, p, scale)
    cost, gradient, normal = quadratic(residual, p)
    for _ in range(_STEPS):
        held = (p <= problem.layout.lowest) & (gradient > 0)
        normal[held], normal[:, held] = 0, 0
        covariance = 0.5 * determined_covariance(normal, 0.5 * problem.prior_residual(p)[1])
        covariance[held, held] = 0
        found = Gravity.of(residual, residual.columns(), covariance, std)
        step = -np.linalg.solve(found.precision, found.gradient + 0.5 * u + found.shift.T @ gradient)
        new = p + found.shift @ step - 2 * finite_part(covariance) @ gradient
        new = np.maximum(new, problem.layout.lowest)
        change = given.symmetric(((u + step) * std.ravel()).reshape(std.shape))
        moved = replace(problem, prior=replace(given, gravity=given.gravity + change))
        if not moved.feasible(new):
            break
        residual = WhitenedResidual.of(moved, new, scale)
        data, gradient, normal = quadratic(residual, new)
        gain = cost - data - 0.5 * float((u + step) @ (u + step) - u @ u)
        if not gain > 0:
            break
        problem, p, u, cost = moved, new, u + step, data
        if gain < _SMALL_GAIN * max(1.0, 2 * cost / problem.rows):
            break
    return problem, p
