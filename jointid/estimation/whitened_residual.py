"""Residual torque in units of its noise, with the free friction at the reversals projected out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.free_friction import Projection, real_rows
from jointid.estimation.residual import Problem, Residual
from jointid.small_matrices import whitener

_CLEAR = 4.0
"""Standard deviations from which a harmonic counts as a signal."""


@dataclass(frozen=True, eq=False)
class WhitenedResidual:
    """Whitened residual at one set of parameters; its Jacobian on demand."""

    at: Residual
    weight: Floats
    """Factor on the variance of the noise alone, shape (r, H)."""
    W: Complexes
    """W V Wᴴ = I for the residuals in use, zero for the others, shape (r, H, n, n)."""
    projection: Projection
    whole: Floats
    """Real rows of W r, shape (r, 2Hn, 1)."""
    rows: Floats
    """The same after the projection, shape (r, 2Hn)."""

    @classmethod
    def of(cls, problem: Problem, vector: Floats, scale: Floats) -> WhitenedResidual:
        """Whiten the residual, with a factor on each harmonic's variance, ``scale`` of shape (H,)."""
        at = Residual.at(problem, vector)
        weight = problem.noise.inverse_bias[:, None] * scale
        W = _whitener(problem, at.V * weight[..., None, None])
        projection = problem.free.projection(W)
        whole = real_rows(W @ at.r[..., None])
        return cls(at, weight, W, projection, whole, projection.rest(whole)[..., 0])

    @property
    def cost(self) -> float:
        """Σ rᴴV⁻¹r."""
        return float((self.rows**2).sum())

    def columns(self, signals: Complexes | None = None) -> Floats:
        """Jacobian of the rows, shape (r, 2Hn, P), at the smoothed signals or at others (r, H, 2n)."""
        J = self.at.jacobian(self.smoothed() if signals is None else signals)
        return self.projection.rest(real_rows(self.W @ J))

    def smoothed(self) -> Complexes:
        """Signals nearest to those measured, in units of noise, without residual: z − C Eᴴ V⁻¹r.

        Rows that free friction explains, or that are not in use, carry no information on the signals.
        """
        half = self.rows.shape[1] // 2
        left = (self.rows[:, :half] + 1j * self.rows[:, half:]).reshape(self.at.r.shape)
        weighted = (self.W.conj().swapaxes(2, 3) @ left[..., None])[..., 0] * self.weight[..., None]
        return np.asarray(self.at.problem.z - (self.at.CE @ weighted[..., None])[..., 0])

    def information(self) -> Floats:
        """Normal matrix Σ JᵀJ without harmonics that are within their noise, shape (P, P).

        The noise of a harmonic that does not exist would add as much to it as a small signal, and make
        finite what no signal determines.
        """
        problem, signals = self.at.problem, self.smoothed()
        variance = np.einsum("rhjj->rhj", problem.noise.covariance).real * self.weight[..., None]
        within = np.abs(problem.z) ** 2 <= _CLEAR**2 * variance
        within[:, 0] = False
        rows = self.columns(np.where(within, 0.0, signals)).reshape(-1, problem.layout.size)
        return np.asarray(rows.T @ rows)

    def misfit_by_harmonic(self, rank: int) -> Floats:
        """Cost over expected cost of each harmonic, shape (H,); rank is that of the free friction."""
        problem = self.at.problem
        H, n = problem.s.shape[1], problem.n
        squares = (self.rows**2).reshape(-1, 2, H, n).sum(axis=(0, 1, 3))
        measured = problem.used.sum(axis=1) @ problem.known
        left = 1 - rank / max(problem.rows, 1)
        return np.asarray(squares / np.maximum(measured * left, 1.0))

    def compensated(self) -> tuple[Complexes, Complexes]:
        """Fundamentals of motor angle and torque without friction, delay and effects, both shape (r, n).

        The torque is that of equation (1) at the fitted parameters, plus the residual.
        """
        left = self.at.r[:, 0] - self.projection.fundamental(self.whole)
        # At a stationary motor the whole residual is friction.
        left = np.where(self.at.problem.used, left, 0.0)
        return self.at.position, np.asarray(self.at.ideal_torque() + left)


def _whitener(problem: Problem, V: Complexes) -> Complexes:
    used = problem.used[:, None, :, None]
    if not used.all():
        V = np.where(used & used.swapaxes(2, 3), V, np.eye(problem.n))
    return np.asarray(whitener(V) * (problem.known[..., None, None] & used))
