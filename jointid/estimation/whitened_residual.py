"""The balance of torques in units of its noise, without what friction is free to do at the reversals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.free_friction import Projection, real_rows
from jointid.estimation.residual import Balance, Problem, sliding
from jointid.small_matrices import whitener


@dataclass(frozen=True, eq=False)
class WhitenedBalance:
    """Residual at one set of parameters; its Jacobian on demand."""

    at: Balance
    weight: Floats
    """By which the variance is larger than that of the noise alone, shape (r, H)."""
    W: Complexes
    """W V Wᴴ = I for the balances that count, zero for the others, shape (r, H, n, n)."""
    projection: Projection
    whole: Floats
    """Real rows of W r, shape (r, 2Hn, 1)."""
    rows: Floats
    """What of them friction does not explain freely, shape (r, 2Hn)."""

    @classmethod
    def of(cls, problem: Problem, p: Floats, scale: Floats) -> WhitenedBalance:
        """Whiten the balance, each harmonic's variance larger by a scale of shape (H,)."""
        at = Balance.at(problem, p)
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
        # What friction may do freely, and balances that say nothing, tell nothing of the true signals.
        pull = np.zeros_like(self.at.r)
        if smooth:
            half = self.rows.shape[1] // 2
            told = (self.rows[:, :half] + 1j * self.rows[:, half:]).reshape(self.at.r.shape)
            pull = (self.W.conj().swapaxes(2, 3) @ told[..., None])[..., 0] * self.weight[..., None]
        return self.projection.rest(real_rows(self.W @ self.at.jacobian(pull)))

    def misfit_by_harmonic(self, rank: int) -> Floats:
        """Cost over expected cost of each harmonic, shape (H,); rank is that of the free shapes."""
        problem = self.at.problem
        H, n = problem.s.shape[1], problem.n
        squares = (self.rows**2).reshape(-1, 2, H, n).sum(axis=(0, 1, 3))
        measured = problem.counts.sum(axis=1) @ problem.known
        left = 1 - rank / max(problem.rows, 1)
        return np.asarray(squares / np.maximum(measured * left, 1.0))

    def taken(self) -> Complexes:
        """Fundamental of the torque that friction and delay take, shape (r, n)."""
        problem, p = self.at.problem, self.at.p
        n, s, z = problem.n, problem.s[:, :1], problem.z[:, 0]
        lag = p[-1] if problem.names[-1] == "delay" else 0.0
        taken = z[:, n:] * (1 - np.exp(-s * lag))
        if problem.friction is None:
            return np.asarray(taken)
        taken = taken + sliding(problem, p, 1)[:, 0] + p[3 * n : 4 * n] * s * z[:, :n]
        taken = taken + self.projection.fundamental(self.whole)
        # Where a motor stands, all that is left over is friction.
        return np.asarray(np.where(problem.counts, taken, taken + self.at.r[:, 0]))


def _whitener(problem: Problem, V: Complexes) -> Complexes:
    counts = problem.counts[:, None, :, None]
    if not counts.all():
        V = np.where(counts & counts.swapaxes(2, 3), V, np.eye(problem.n))
    return np.asarray(whitener(V) * (problem.known[..., None, None] & counts))
