"""Residual torque in units of its noise, with the free friction at the reversals projected out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.free_friction import Projection, real_rows
from jointid.estimation.residual import Problem, Residual
from jointid.small_matrices import whitener


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

    def columns(self, *, smooth: bool = True) -> Floats:
        """Jacobian of the rows, shape (r, 2Hn, P), at the smoothed signals or at those measured."""
        weighted = self._weighted_residual() if smooth else np.zeros_like(self.at.r)
        return self.projection.rest(real_rows(self.W @ self.at.jacobian(weighted)))

    def smoothed(self) -> Complexes:
        """Signals nearest to those measured, in units of noise, without residual, (r, H, 2n)."""
        return self.at.smoothed(self._weighted_residual())

    def _weighted_residual(self) -> Complexes:
        """V⁻¹r, shape (r, H, n).

        Rows that free friction explains, or that are not in use, carry no information on the signals.
        """
        half = self.rows.shape[1] // 2
        left = (self.rows[:, :half] + 1j * self.rows[:, half:]).reshape(self.at.r.shape)
        return np.asarray(
            (self.W.conj().swapaxes(2, 3) @ left[..., None])[..., 0] * self.weight[..., None]
        )

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
