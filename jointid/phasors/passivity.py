"""Passivity check of the records: springs, inertias and friction supply no energy.

Over a period of a steady motion the motors supply the mean power Re Σ τ_j (sq_j)* / 2, which damping and
friction dissipate. If they absorb power instead, the torques are those of other records or axes, or have
the wrong sign.
"""

import numpy as np

from jointid.arrays import Complexes, Floats

_ALLOWED = 0.2
"""Power over the apparent power that may be absorbed: the phase of lags and filters beyond a delay."""
_DELAYS = np.linspace(-4.0, 4.0, 81)
"""Common delays of the torques that are tried, times the highest frequency in rad/s."""


def taken_power(omega: Floats, z: Complexes, covariance: Complexes) -> Floats:
    """Power that the motors absorb beyond the allowance, in standard errors, shape (r,).

    With the common delay of the torques that minimises it. ``omega`` has shape (r,); ``z``, shape
    (r, 2n), holds phasors of angles, then torques, ``covariance`` that of their noise, (r, 2n, 2n).
    """
    n, s = z.shape[1] // 2, 1j * omega[:, None]
    velocity, torque = s * z[:, :n], z[:, n:]
    turn = np.exp(-1j * _DELAYS[:, None] * omega / omega.max())
    power = ((velocity.conj() * torque).sum(axis=1) * turn).real
    allowed = _ALLOWED * np.abs(velocity * torque).sum(axis=1)
    # To first order a delay turns the torque alone: its part of the slope keeps its size.
    slope = np.concatenate([s.conj() * torque, velocity], axis=1)
    variance = 0.5 * np.einsum("ri,rii,ri->r", slope.conj(), covariance, slope).real
    excess = np.maximum(-power - allowed, 0.0)
    taken = np.divide(excess, np.sqrt(variance), out=np.zeros_like(excess), where=variance > 0)
    return np.asarray(taken[np.argmin((taken**2).sum(axis=1))])


def least_misfit(omega: Floats, z: Complexes, covariance: Complexes) -> float:
    """Smallest misfit of the fundamentals that any passive model leaves.

    Parameters as of ``taken_power``.
    """
    return float((taken_power(omega, z, covariance) ** 2).sum() / z.size)
