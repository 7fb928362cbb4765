"""The noise of a record's phasors, as the estimators use it: pooled over records of one frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.phasors import Phasors

_FLOOR = 1e-9  # of the largest phasor of its kind: nothing is measured better than that


@dataclass(frozen=True, eq=False)
class Noise:
    """Covariance of z = [q; τ] at every harmonic, and how well it is known."""

    covariance: Complexes
    """Shape (r, H, 2n, 2n)."""
    freedom: Floats
    """Degrees of freedom of each record's covariance, shape (r,)."""

    @property
    def inverse_bias(self) -> Floats:
        """Factor by which the inverse of an estimated n × n covariance is too large on average, (r,).

        ν/(ν − n) for a complex Wishart matrix of ν degrees of freedom.
        """
        n = self.covariance.shape[-1] / 2
        return np.asarray(self.freedom / (self.freedom - n))

    @property
    def weight_penalty(self) -> Floats:
        """Factor by which weights from an estimated covariance raise the variance of a fit, (r,).

        ν²/((ν − n)² − 1) for a complex Wishart matrix of ν degrees of freedom.
        """
        n = self.covariance.shape[-1] / 2
        return np.asarray(self.freedom**2 / ((self.freedom - n) ** 2 - 1))


def pooled_noise(phasors: Phasors) -> Noise:
    """Average the covariances of records of the same frequency, each weighted by its freedom.

    A few periods tell a covariance badly, and a bad one makes bad weights; the noise of the sensors and
    of the control loop is the same in the records of one frequency, per unit of time. Where even the
    pooled covariance has too few degrees of freedom to be inverted, its off-diagonal part is dropped.
    """
    n = phasors.n
    covariance = np.array(phasors.harmonic_covariance)
    freedom = np.array(phasors.freedom)
    for _, group in phasors.by_frequency():
        share = phasors.freedom[group] * phasors.duration_s[group]
        density = np.einsum("r,rhab->hab", share, covariance[group]) / phasors.freedom[group].sum()
        covariance[group] = density / phasors.duration_s[group][:, None, None, None]
        freedom[group] = phasors.freedom[group].sum()
        if freedom[group[0]] <= n + 2:
            covariance[group] *= np.eye(2 * n)
            freedom[group] = n + 3
    largest = np.array([np.abs(phasors.q).max()] * n + [np.abs(phasors.tau).max()] * n)
    return Noise(covariance + np.diag((_FLOOR * largest) ** 2), freedom)
