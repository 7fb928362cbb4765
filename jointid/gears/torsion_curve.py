"""The measured torsion curve of a gear: the torque through it over its deflection."""

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.gears.gear import Gear
from jointid.phasors.periods import phasors_of, samples_of

_POINTS = 256
"""Least samples of a period."""
_CLEAR = 5.0
"""Standard deviations from which a harmonic is part of a curve; the others are noise, or rounding that
repeats."""
_NOISY = 0.05
"""Noise of a harmonic over the largest one above which it is no part of a curve either: rounding
that repeats would fold the curve."""
_PER_HARMONIC = 8
"""Samples of a period for each harmonic."""
_NOTHING = 1e-9
"""Fundamental of a waveform without one, over its amplitude."""


@dataclass(frozen=True, eq=False)
class TorsionCurve:
    """Measured torque of one gear over its deflection, one period of each record.

    A motion has a row for each segment with motion above the locked resonance, made of the spectral
    lines above it; there may be none.
    """

    deflection_rad: Floats
    """Shape (records, points), rad. Each record's mean is not observable and set to 0."""
    torque_Nm: Floats
    """Torque through the gear, damping and hysteresis included, shape (records, points), N·m."""
    deflection_noise_rad: Floats
    """Standard deviation from noise of each record's points, shape (records,), rad."""
    torque_noise_Nm: Floats
    """The same of the torque, shape (records,), N·m."""
    frequency_hz: Floats
    """Frequency of the sine, or of the strongest line of a motion, shape (records,), Hz."""
    largest_Nm: float = 0.0
    """Largest amplitude of the torque in any record, also in motions without a curve, N·m."""

    @property
    def amplitude_rad(self) -> Floats:
        """Half the peak-to-peak deflection of each record, shape (records,), rad."""
        return np.asarray(0.5 * np.ptp(self.deflection_rad, axis=1))

    @property
    def amplitude_Nm(self) -> Floats:
        """Half the peak-to-peak torque of each record, shape (records,), N·m."""
        return np.asarray(0.5 * np.ptp(self.torque_Nm, axis=1))

    def noise_beside(self, gear: Gear) -> Floats:
        """Standard deviation from noise of the torque minus a gear's law, (records, points), N·m.

        The deflection is noisy as well: at low frequency it is the small difference of two motions.
        """
        step = self.deflection_noise_rad[:, None]
        ends = gear.torque(self.deflection_rad + step), gear.torque(self.deflection_rad - step)
        return np.hypot(self.torque_noise_Nm[:, None], 0.5 * (ends[0] - ends[1]))

    @property
    def stiffness(self) -> tuple[Floats, Floats, Floats]:
        """Real part of torque over deflection at the fundamental, its noise, and the torque amplitude.

        Each shape (records,); N·m/rad, N·m/rad and N·m; NaN for a motion whose band lacks it.
        """
        delta, torque = (phasors_of(v, 1)[:, 0] for v in (self.deflection_rad, self.torque_Nm))
        delta = np.where(np.abs(delta) > _NOTHING * self.amplitude_rad, delta, np.nan)
        with np.errstate(invalid="ignore"):
            K, size = (torque / delta).real, np.abs(delta)
        noise = np.hypot(self.torque_noise_Nm, np.abs(K) * self.deflection_noise_rad) / size
        return np.asarray(K), np.asarray(noise), np.abs(torque)


def torsion_curves(
    s: Complexes,
    deflection: Complexes,
    torque: Complexes,
    variance: Floats,
    fitted: Complexes,
    resolved: np.ndarray,
) -> tuple[TorsionCurve, ...]:
    """Torsion curves of n gears from H harmonics of r records.

    ``s``, shape (r, H), is the Laplace variable of every harmonic; ``deflection`` and ``torque`` have
    shape (r, H, n), their ``variance`` from noise and those ``fitted`` by the law (2, r, H, n).
    ``resolved``, shape (r, H, n), are the harmonics that a curve may have.
    """
    clear = np.abs(torque) ** 2 > _CLEAR**2 * variance[1]
    clear &= variance[1] < (_NOISY * np.abs(torque).max(axis=1, keepdims=True)) ** 2
    clear[:, 0] = True
    points = max(_POINTS, _PER_HARMONIC * s.shape[1])
    whole = samples_of(np.where(clear, torque, 0).swapaxes(1, 2), points)  # (r, n, t)
    largest = 0.5 * np.ptp(whole, axis=2).max(axis=0, initial=0.0)
    unclear = ~clear & resolved
    clear &= resolved
    signals = np.stack([deflection, torque])
    # Harmonics that a curve omits are an error of it. The fitted law gives their size.
    left_out = np.where(unclear, np.abs(fitted) ** 2, 0).sum(axis=2)
    signals = np.where(clear, signals, 0)
    waves = samples_of(signals.swapaxes(2, 3), points)  # (2, r, n, t)
    main = (np.abs(signals[1]) ** 2).sum(axis=2).argmax(axis=1)
    sigma = np.sqrt(0.5 * (np.where(clear, variance, 0).sum(axis=2) + left_out))
    return tuple(
        TorsionCurve(
            deflection_rad=waves[0, rows, j],
            torque_Nm=waves[1, rows, j],
            deflection_noise_rad=sigma[0, rows, j],
            torque_noise_Nm=sigma[1, rows, j],
            frequency_hz=np.abs(s[rows, main[rows]]) / (2 * np.pi),
            largest_Nm=float(largest[j]),
        )
        for j, rows in enumerate(np.flatnonzero(each) for each in clear.any(axis=1).T)
    )
