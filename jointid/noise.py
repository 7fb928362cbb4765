"""The noise of the phasors as the estimators use it: each record's own, moderated by all records'.

A few periods tell a covariance badly, and bad covariances make bad weights. But the sensors are the same
in all records. In the torque balance r = τ − Z q the noise of the sensors remains, while everything
that the motors and torques really do, loop noise included, cancels; so the covariances V = E C Eᴴ with
E = [−Z, I] of all records follow from 2n sensor variances. As far as they do, within what their degrees
of freedom let expect, each record's own covariance is shrunk towards that model (empirical Bayes; Smyth,
Statistical Applications in Genetics and Molecular Biology 3, 2004).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, nnls
from scipy.special import polygamma

from jointid.arrays import Complexes, Floats
from jointid.joints import motor_impedance
from jointid.phasors import Phasors

_FLOOR = 1e-9  # of the largest phasor of a signal: nothing is measured better than that
_MOST_LENT = 1e3  # degrees of freedom that the records together can lend to one
_LEAST_LENT = 0.5
_NEGLIGIBLE = 1e-40  # of the largest variance: that of a record in which nothing moves


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


def moderated_noise(phasors: Phasors, M: Floats, arm: Floats, K: Floats, D: Floats) -> Noise:
    """Noise of the records, each shrunk towards what the sensors' noise makes of it.

    Parameters
    ----------
    phasors : Phasors
    M, arm : ndarray, shapes (r, n) and (r, n, n)
        Rotor inertias and M2⁻¹ of every record.
    K, D : ndarray, shape (n,)
        A first estimate; the impedance Z hangs on it.
    """
    _, H, channels = phasors.harmonics.shape
    n = phasors.n
    known = np.any(phasors.harmonics != 0, axis=2)
    s = np.asarray(1j * phasors.omega[:, None] * np.arange(1, H + 1))
    Z, _ = motor_impedance(s, M[:, None], arm[:, None], K, D)
    E = np.concatenate([-Z, np.broadcast_to(np.eye(n), Z.shape)], axis=3)
    density = phasors.harmonic_covariance * phasors.duration_s[:, None, None, None]
    own = np.einsum("rhja,rhab,rhjb->rhj", E, density, E.conj()).real
    sensors = _sensor_variances(np.abs(E) ** 2, np.where(known[..., None], own, 0.0))
    modelled = np.einsum("rhja,ha->rhj", np.abs(E) ** 2, sensors)
    lent, scale = _lent_freedom(
        own[known], modelled[known], np.repeat(phasors.freedom, known.sum(axis=1))
    )
    sensors = scale * sensors
    share = (phasors.freedom / (phasors.freedom + lent))[:, None, None, None]
    density = share * density + (1 - share) * sensors[:, :, None] * np.eye(channels)
    freedom = phasors.freedom + lent
    if freedom.min() <= n + 2:  # cannot be inverted, or hardly
        density = density * np.eye(channels)
        freedom = np.maximum(freedom, n + 3.0)
    covariance = density / phasors.duration_s[:, None, None, None]
    largest = np.abs(phasors.z).max(axis=0).reshape(2, n)
    # A signal that shows nothing is no better known than those of the same kind.
    largest = np.where(largest > 0, largest, largest.max(axis=1, keepdims=True)).ravel()
    return Noise(covariance + np.diag((_FLOOR * largest) ** 2), freedom)


def _sensor_variances(gains: Floats, variances: Floats) -> Floats:
    """Non-negative sensor variances (H, 2n) from gains (r, H, n, 2n) and what they make, (r, H, n)."""
    H, channels = gains.shape[1], gains.shape[3]
    rows = gains.swapaxes(0, 1).reshape(H, -1, channels)
    values = variances.swapaxes(0, 1).reshape(H, -1)
    use = values > _NEGLIGIBLE * values.max(axis=1, keepdims=True)
    weight = np.where(use, 1 / np.where(use, values, 1.0), 0.0)
    solution = np.zeros((H, channels))
    for _ in range(8):  # relative errors count, and relative to the model they are unbiased
        weighted = rows * weight[..., None]
        scale = 1 / np.maximum(np.linalg.norm(weighted, axis=1), 1e-300)
        weighted *= scale[:, None]
        solution = scale * _non_negative(weighted, values * weight)
        model = np.maximum(np.einsum("hmc,hc->hm", rows, solution), 1e-3 * values)
        weight = np.where(use, 1 / np.where(use, model, 1.0), 0.0)
    return solution


def _non_negative(A: Floats, b: Floats) -> Floats:
    """Least squares A x = b with x ≥ 0, for matrices (H, m, c) with columns of unit length."""
    normal = A.swapaxes(1, 2) @ A
    # Where the plain solution is not negative it is the answer; the ridge is for columns of zeros.
    x = np.linalg.solve(normal + 1e-14 * np.eye(A.shape[2]), np.einsum("hmc,hm->hc", A, b)[..., None])
    solution = np.asarray(x[..., 0])
    for h in np.flatnonzero(np.any(solution < 0, axis=1)):
        solution[h] = nnls(A[h], b[h])[0]
    return solution


def _lent_freedom(own: Floats, modelled: Floats, freedom: Floats) -> tuple[float, float]:
    """Degrees of freedom d that the model is worth, and the factor that makes it typical.

    The log variances scatter around the model's as trigamma(d), beyond their own degrees of freedom.
    """
    rows = np.all((own > 0) & (modelled > 0), axis=1)
    if rows.sum() < 3:
        return 0.0, 1.0
    ratio = (
        np.log(own[rows] / modelled[rows])
        - (polygamma(0, freedom[rows]) - np.log(freedom[rows]))[:, None]
    )
    excess = (ratio**2 - polygamma(1, freedom[rows])[:, None]).mean()
    if excess <= polygamma(1, _MOST_LENT):
        return _MOST_LENT, 1.0
    if excess >= polygamma(1, _LEAST_LENT):
        return 0.0, 1.0
    lent = float(brentq(lambda d: polygamma(1, d) - excess, _LEAST_LENT, _MOST_LENT))
    return lent, float(np.exp(ratio.mean() + polygamma(0, lent) - np.log(lent)))
