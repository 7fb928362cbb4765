"""Spectral lines of a motion within a narrow band, for a response by local polynomials."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from jointid.arrays import Complexes, Floats
from jointid.motion.noise import BEYOND, repeated_variances
from jointid.motion.sampling import UniformPart, windowed_spectrum
from jointid.motion.velocity import smooth_velocity
from jointid.phasors.sensor_steps import quantum
from jointid.records import MotionRecord

_QUIET = 0.35, 0.48
"""Frequencies over the sample rate at which the angles have noise only."""
_BANDS, _LEAST_LINES = 24, 16
"""Bands above the motion in each of which a controller has one gain, and lines of such a band."""
_MOVED = 2.0
"""Power over that of noise from which there is a motion, or rounding that follows it."""
_ROUNDING = 1e-6
"""Distance from an end of the band, in spectral lines, that is rounding."""


@dataclass(frozen=True, eq=False)
class RecordSpectrum:
    """Spectral lines of a record, or of a part between its gaps, within its band: k of n joints."""

    part: UniformPart
    band_hz: tuple[float, float]
    frequency_hz: Floats
    """Shape (k,)."""
    acceleration: Complexes
    """Shape (k, n)."""
    torque: Complexes
    """As they act, shape (k, n)."""
    timing: Complexes
    """Torque as it acts over that of the samples, shape (k,)."""
    noise: Floats
    """Variances of ``noise_variances`` in the lines, shape (2, k, n)."""

    @classmethod
    def of(cls, part: UniformPart, record: MotionRecord, band_hz: tuple[float, float]) -> RecordSpectrum:
        """Transform a part of a record."""
        (n, N), T = part.theta.shape, part.interval_s
        first, last = np.array(band_hz) * part.duration_s + [-_ROUNDING, _ROUNDING]
        inside = slice(max(math.ceil(first), 1), int(last) + 1)
        f = np.asarray(np.fft.rfftfreq(N, T)[inside], float)
        s = 2j * np.pi * f
        timing = np.exp(-s * record.torque_delay_s)
        if part.held:
            timing *= -np.expm1(-s * T) / (s * T)
        q, torque = (np.fft.rfft(x, axis=1).T[inside] / N for x in (part.theta, part.tau))
        # A short part between two gaps may have no line in the band.
        noise = noise_variances(part, f) / N if f.size else np.zeros((2, 0, n))
        noise[0] *= np.abs(s[:, None]) ** 4
        return cls(part, band_hz, f, s[:, None] ** 2 * q, timing[:, None] * torque, timing, noise)

    def without(self, coulomb: Floats | float, viscous: Floats | float, delay: float) -> RecordSpectrum:
        """Without friction of the motors, N·m and N·m·s/rad, and with a further delay of the torque."""
        torque, part = self.torque, self.part
        if np.any(np.asarray(coulomb)) or np.any(np.asarray(viscous)):
            floor = np.array([quantum(angle) ** 2 / 12 for angle in part.theta])
            velocity, *_ = smooth_velocity(part.theta, part.interval_s, floor)
            loss = np.reshape(coulomb, (-1, 1)) * np.sign(velocity)
            loss += np.reshape(viscous, (-1, 1)) * velocity
            lines = np.rint(self.frequency_hz * part.duration_s).astype(int)
            lost = np.fft.rfft(loss, axis=1).T[lines] / loss.shape[1]
            torque = torque - self.timing[:, None] * lost
        late = np.exp(-2j * np.pi * self.frequency_hz * delay)
        return replace(self, torque=late[:, None] * torque)


def noise_variances(part: UniformPart, f: Floats) -> Floats:
    """Variance of the noise of the angles, and of the torques by which controllers answer it, (2, k, n).

    N times that of the spectral lines at the motion's frequencies f, shape (k,), Hz. The noise of the
    angles is that of the highest frequencies, at which the motors hardly move; at least that of the
    encoder's steps, with the rounding that the periods of a motion share.
    """
    T = part.interval_s
    lines, torque = windowed_spectrum(part.tau[:, 1:-1], T)
    angle = part.rotor_spectra[2][:, 1:] / -((2 * np.sin(np.pi * lines[1:] * T) / T) ** 2)
    lines, torque = lines[1:], torque[:, 1:]
    top, end = np.searchsorted(lines, np.array(_QUIET) / T)
    least = np.mean(np.abs(angle[:, top:end]) ** 2, axis=1)
    begin = min(BEYOND * f[-1], _QUIET[0] / T)
    edges = np.searchsorted(lines, np.geomspace(begin, _QUIET[1] / T, _BANDS + 1))
    bands = [slice(*ab) for ab in pairwise(edges) if ab[1] - ab[0] >= _LEAST_LINES]
    bands = bands or [slice(int(top), int(end))]
    gains = [_gain(angle[:, each], torque[:, each]) for each in bands]
    gain, error, power = (np.array(part) for part in zip(*gains, strict=True))
    latest = np.array([each.stop > top for each in bands])
    quiet = (power < _MOVED * least) | latest[:, None]
    middle = np.array([lines[each].mean() for each in bands])
    rounding = np.stack([_rounding(each, f, T) for each in part.theta], axis=1)
    angles = np.maximum(least, rounding) + repeated_variances([part])
    answers = [
        _continued(middle[used] * T, gain[used, j], error[used, j], f * T)
        for j, used in enumerate(quiet.T)
    ]
    return np.stack([angles, angles * np.transpose(answers)])


def _rounding(theta: Floats, f: Floats, T: float) -> Floats:
    """Variance of an angle's rounding at frequencies f, at least as if it were white, shape (k,).

    That of a slow motion follows it, and the errors of neighbouring lines add up instead of their
    squares. To see this, the angle without its higher frequencies is rounded again.
    """
    step = quantum(theta)
    if step == 0:
        return np.zeros(f.size)
    line = np.linspace(theta[0], theta[-1], theta.size)
    lines = np.fft.rfftfreq(theta.size, T)
    smooth = line + np.fft.irfft(np.fft.rfft(theta - line) * (lines < BEYOND * f[-1]), theta.size)
    power = np.abs(np.fft.rfft(np.rint(smooth / step) * step - smooth)) ** 2 / theta.size
    near = np.convolve(power, np.ones(_LEAST_LINES) / _LEAST_LINES, mode="same")
    first, white = round(f[0] * theta.size * T), step**2 / 12
    near = near[first : first + f.size]
    return np.where(near > _MOVED * white, _LEAST_LINES * near, white)


def _gain(angle: Complexes, torque: Complexes) -> tuple[Floats, Floats, Floats]:
    """Square of the gain from angles to torques, its uncertainty, and power of the angles, each (n,)."""
    tiny = np.finfo(float).tiny
    both = np.stack([angle, torque])
    size = np.sqrt(np.mean(np.abs(both) ** 2, axis=2))
    unit = both / np.maximum(size, tiny)[..., None]
    coherence = np.abs(np.mean(unit[0].conj() * unit[1], axis=1)) ** 2
    chance = 2 / angle.shape[1]  # through a window, two neighbouring lines are one
    square = np.divide(size[1], size[0], out=np.zeros(len(angle)), where=size[0] > tiny) ** 2
    gain = square * np.maximum(coherence - chance, 0.0)
    return np.asarray(gain), np.asarray(square * (coherence + chance)), np.asarray(size[0] ** 2)


def _continued(measured_at: Floats, gain: Floats, error: Floats, wanted_at: Floats) -> Floats:
    """Square of a controller's gain at other frequencies, over the sample rate.

    That of a PD controller, whose square is linear in |1 − z|²: filters let it rise less.
    """
    if not error.any():
        return np.zeros(wanted_at.size)
    rows, wanted = (
        np.stack([np.ones(x.size), np.sin(np.pi * x) ** 2], axis=1) for x in (measured_at, wanted_at)
    )
    weight = 1 / np.maximum(error, np.finfo(float).eps * error.max())
    return np.asarray(wanted @ nnls(rows * weight[:, None], gain * weight)[0])


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
