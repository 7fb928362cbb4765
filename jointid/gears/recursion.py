"""Linear equations over time, each with the unknowns of its own step and of the two before."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.linalg.lapack import dtbtrs

from jointid.arrays import Floats
from jointid.gears.dahl import DahlSteps


@dataclass(frozen=True, eq=False)
class Recursion:
    """Equations of n torques and n hysteresis loops in N steps, solved for the unknowns of a step."""

    band: Floats
    """Their triangular matrix in bands, without the ones on its diagonal."""
    inverse: Floats
    """Inverse of the derivative of the torques by the deflections of their step, (n, n, N)."""
    by_loop: Floats | None
    """Derivative of the torques by the loops of their step, (n, n, N)."""

    @classmethod
    def of(cls, torques: Floats, loops: DahlSteps | None) -> Recursion:
        """From the derivatives of the torques and the steps of the loops.

        ``torques``, shape (n, 3, m, N), are derivatives by the m unknowns of the step, of the one before
        and of that before it: n deflections and, with hysteresis, n loops. Those by the deflections of
        their step must be near positive definite. The array is overwritten.
        """
        n, _, size, N = torques.shape
        band, by_loop = np.zeros((N, size, 3 * size)), None
        if loops is not None:
            by_loop, before = torques[:, 0, n:].copy(), np.zeros((n, 1))
            by_move, by_earlier, by_z = (np.concatenate([before, each], axis=1) for each in loops[1:])
            by_last = by_move - by_earlier
            torques[:, 0, :n] += by_loop * by_move
            torques[:, 1, :n] -= by_loop * by_last
            torques[:, 2, :n] -= by_loop * by_earlier
            torques[:, 1, n:] += by_loop * by_z
            band[:, :n, n] = -by_move.T
            band[:-1, :n, n + size] = by_last[:, 1:].T
            band[:-2, :n, n + 2 * size] = by_earlier[:, 2:].T
            band[:-1, n:, size] = -by_z[:, 1:].T
        inverse = _inverse(torques[:, 0, :n])
        for late in (1, 2):
            solved = np.einsum("ijt,jkt->ikt", inverse, torques[:, late])
            for i, k in product(range(n), range(size)):
                band[: N - late, k, late * size + i - k] = solved[i, k, late:]
        return cls(band.reshape(N * size, -1).T, inverse, by_loop)

    def solve(self, right: Floats) -> Floats:
        """Unknowns for right sides of the same shape (..., m, N)."""
        n, (size, N) = len(self.inverse), right.shape[-2:]
        rows = right.reshape(-1, size, N)
        torques = rows[:, :n]
        if self.by_loop is not None:
            torques = torques - np.einsum("ijt,cjt->cit", self.by_loop, rows[:, n:])
        ordered = np.empty((len(rows), N, size))
        ordered[..., :n] = np.einsum("ijt,cjt->cit", self.inverse, torques).swapaxes(1, 2)
        ordered[..., n:] = rows[:, n:].swapaxes(1, 2)
        found, _ = dtbtrs(
            self.band, ordered.reshape(-1, N * size).T, uplo="L", diag="U", overwrite_b=True
        )
        return np.asarray(found.T.reshape(-1, N, size).swapaxes(1, 2).reshape(right.shape))


def _inverse(A: Floats) -> Floats:
    """Inverse of N matrices that are near positive definite, (n, n, N): no pivots are needed."""
    left, found = A.copy(), np.zeros(A.shape)
    for i in range(len(A)):
        found[i, i] = 1.0
    for i in range(len(A)):
        pivot = left[i, i].copy()
        left[i] /= pivot
        found[i] /= pivot
        for k in range(len(A)):
            if k != i:
                factor = left[k, i].copy()
                left[k] -= factor * left[i]
                found[k] -= factor * found[i]
    return found
