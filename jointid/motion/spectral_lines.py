"""Spectral lines of a motion within a narrow band, for a response by local polynomials."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.motion.noise import repeated_variances
from jointid.motion.sampling import UniformPart, windowed_spectrum
from jointid.phasors.sensor_steps import quantum

_QUIET = 0.35, 0.48
"""Frequencies over the sample rate at which the angles have noise only."""
_BANDS = 24
"""Bands of these frequencies in each of which a controller has one gain."""


def noise_variances(part: UniformPart) -> Floats:
    """Variance of the noise of the angles, and of the torques by which controllers answer it, (2, n, 1).

    N times that of a spectral line. From the highest frequencies, at which the motors hardly move and
    the torques' own noise does not follow that of the angles, and where a controller answers most; the
    noise of the angles is at least that of the encoder's steps, with the rounding that the periods of a
    motion share.
    """
    T = part.interval_s
    f, torque = windowed_spectrum(part.tau[:, 1:-1], T)
    above = (f > _QUIET[0] / T) & (f < _QUIET[1] / T)
    angle = part.rotor_spectra[2][:, above] / -((2 * np.sin(np.pi * f[above] * T) / T) ** 2)
    torque = torque[:, above]
    angles, power = (np.mean(np.abs(each) ** 2, axis=1) for each in (angle, torque))
    bands = np.array_split(angle.conj() * torque, min(_BANDS, angle.shape[1]), axis=1)
    both = np.mean([np.abs(each.mean(axis=1)) ** 2 for each in bands], axis=0)
    # Through a window, two neighbouring lines are one: so much correlation has noise of its own.
    both = np.maximum(both - 2 * angles * power * len(bands) / angle.shape[1], 0.0)
    steps = np.array([quantum(each) for each in part.theta])
    angles = np.maximum(angles, steps**2 / 12) + repeated_variances([part])
    answers = np.divide(both, angles, out=np.zeros_like(both), where=angles > 0)
    return np.stack([angles, answers])[..., None]


class SpectralLines(NamedTuple):
    """Spectral lines of a record around a frequency."""

    powers: Floats
    """Powers of the frequency, shape (k, order + 1); also the end terms of the record."""
    left: Floats
    """Rows orthogonal to them, shape (k − order − 1, k)."""
    acceleration: Complexes
    """Shape (k, n)."""
    torque: Complexes
    """Shape (k, n)."""
    noise: Floats
    """Variance of accelerations by noise, and of the torques that answer it, shape (2, k, n)."""

    @classmethod
    def of(
        cls, x: Floats, order: int, acceleration: Complexes, torque: Complexes, noise: Floats
    ) -> SpectralLines:
        """Lines at frequencies x, from -1 to 1."""
        powers = np.vander(x, order + 1, increasing=True)
        left = np.linalg.qr(powers, mode="complete")[0][:, order + 1 :].T
        return cls(powers, left, acceleration, torque, noise)

    def regressors(self, u: Complexes) -> Complexes:
        """Columns of the coefficients C_k of Σ x^k C_k u, without end terms."""
        columns = u[..., None] * self.powers[:, None]
        return np.asarray(self.left @ columns.reshape(len(u), -1))

    @property
    def expected_noise(self) -> Floats:
        """Expected squares of both, sums over the rows, shape (2, n)."""
        return np.asarray(np.square(self.left).sum(axis=0) @ self.noise)

    @property
    def noise_power(self) -> Floats:
        """Expected normal matrix of the regressors of white noise of unit variance."""
        squares = np.square(self.left).sum(axis=0)
        return np.asarray(self.powers.T @ (squares[:, None] * self.powers))
