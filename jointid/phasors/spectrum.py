"""Amplitude spectrum of a logged signal, and the frequency that a record has."""

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.phasors.fitted_sine import SineFit
from jointid.records import SineRecord

_JITTER = 1e-3
"""Part of a sample interval, below which times count as evenly spaced."""


def evenly_sampled(time_s: Floats, signals: Floats) -> tuple[Floats, Floats]:
    """Return an even grid and the signals on it, interpolated if the times are uneven.

    Accurate enough for a plot or to find a line, not for a phasor. Shapes: ``time_s`` (N,), ``signals``
    (N, c).
    """
    grid = np.linspace(time_s[0], time_s[-1], time_s.size)
    if np.abs(grid - time_s).max() > _JITTER * (grid[1] - grid[0]):
        signals = np.column_stack([np.interp(grid, time_s, signal) for signal in signals.T])
    return grid, signals


def amplitude_spectrum(time_s: Floats, signal: Floats) -> tuple[Floats, Floats]:
    """Frequency, Hz, and amplitude of a signal through a Hann window, each (N // 2,), without the mean.

    Times, see ``evenly_sampled``, and signal have shape (N,). A sine between two lines loses at most
    15 % of its amplitude. Raises JointIdError with fewer than eight samples, or when the times do not
    advance.
    """
    samples = time_s.size
    span = float(time_s[-1] - time_s[0]) if samples else 0.0
    if samples < 8 or not span > 0:
        raise JointIdError(
            f"A spectrum needs at least 8 samples over some time; there are {samples} over {span:g} s."
        )
    grid, even = evenly_sampled(time_s, signal[:, None])
    slope, level = np.polyfit(grid - grid[0], even[:, 0], 1)
    window = np.hanning(samples)
    lines = np.fft.rfft((even[:, 0] - level - slope * (grid - grid[0])) * window)
    frequency = np.fft.rfftfreq(samples, span / (samples - 1))
    amplitude = 2 * np.abs(lines) / window.sum()
    kept = slice(1, samples // 2 + 1)
    return np.asarray(frequency[kept], float), np.asarray(amplitude[kept], float)


def largest_line_hz(time_s: Floats, signal: Floats) -> float:
    """Frequency of the largest line of the spectrum, interpolated by a parabola, Hz.

    Raises JointIdError when the signal is too short or does not move.
    """
    frequency, amplitude = amplitude_spectrum(time_s, signal)
    peak = int(np.argmax(amplitude))
    if not amplitude[peak] > 0:
        raise JointIdError("The signal is constant: it has no frequency.")
    if not 0 < peak < amplitude.size - 1:
        return float(frequency[peak])
    return float(frequency[peak] + vertex(amplitude, peak) * (frequency[1] - frequency[0]))


def vertex(amplitude: Floats, peak: int) -> float:
    """Offset in bins, -0.5 to 0.5, of the vertex of a parabola through the logarithms around a peak."""
    left, centre, right = np.log(np.maximum(amplitude[peak - 1 : peak + 2], 1e-300))
    curvature = left - 2 * centre + right
    return 0.0 if curvature == 0 else float(np.clip(0.5 * (left - right) / curvature, -0.5, 0.5))


def frequency_found(record: SineRecord, fit: SineFit) -> float:
    """Stated frequency, corrected by the phase drift of the largest motion over the record, Hz."""
    stated = record.frequency_hz
    strength = np.abs(fit.harmonics[:, : record.n])
    order, joint = divmod(int(strength.argmax()), record.n)
    if not strength.max() > 1e-12 * np.abs(fit.offset[joint]):
        return stated
    phasor, local = fit.fundamental[joint], fit.local[:, joint]
    count = len(local)
    suspicious = order > 0 or np.sqrt(np.mean(np.abs(local) ** 2)) > 0.5 * np.abs(phasor)
    if suspicious or (count < 3 and _unlike(record, fit, joint)):
        used = slice(record.start, None)
        return largest_line_hz(record.time_s[used], record.theta_rad[used, joint])
    if count < 3:
        return stated
    place = (np.arange(count) - (count - 1) / 2) / count
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turns = ((local / phasor).imag * place).sum() / (place**2).sum()
    return float(stated + turns / (2 * np.pi * record.periods / stated))


def _unlike(record: SineRecord, fit: SineFit, joint: int) -> bool:
    """Whether a motor angle of few periods differs much from its fitted sine."""
    left = record.theta_rad[record.start :, joint]
    left = left - fit.at(record.time_s[record.start :], record.omega)[:, joint]
    return bool(left.std() > 0.3 * abs(fit.fundamental[joint]))
