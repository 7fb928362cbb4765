"""Torques through the gears, and their deflections, as linear functions of the logged signals."""

from collections.abc import Iterable

import numpy as np

from jointid.arrays import Complexes, Floats


def balance(own: Complexes, gain: Complexes) -> Complexes:
    """Torque through the gears by angles and torques of the motors, shape (r, H, n, 2n)."""
    eye = np.eye(own.shape[2])
    return np.concatenate([-own[..., None] * eye, gain[..., None] * eye], axis=3)


def wind_up(of_torque: Complexes, arm: Complexes) -> Complexes:
    """Deflection of the gears by angles and torques of the motors, shape (r, H, n, 2n)."""
    found = -arm @ of_torque
    for j in range(arm.shape[2]):
        found[..., j, j] += 1
    return np.asarray(found)


def noise_of(rows: Iterable[Complexes], covariance: Complexes) -> Floats:
    """Variances, each (r, H, n), of rows (r, H, n, 2n) times signals of a covariance (r, H, 2n, 2n)."""
    return np.stack([((E @ covariance) * E.conj()).sum(axis=3).real for E in rows])


def gear_torque(
    X: Complexes, arm: Complexes, q: Complexes, law: tuple[Complexes, Complexes]
) -> Complexes:
    """Torque through the gears, X (q − w + A⁻¹P), shape (r, H, n)."""
    w, P = law
    return np.asarray((X @ (q - w + (arm @ P[..., None])[..., 0])[..., None])[..., 0])
