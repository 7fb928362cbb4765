"""Amplitude spectrum of a logged signal, and the frequency of its largest line."""

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError


def amplitude_spectrum(time_s: Floats, signal: Floats) -> tuple[Floats, Floats]:
    """Amplitude of a signal by frequency, through a Hann window.

    Parameters
    ----------
    time_s : ndarray, shape (N,)
        Increasing times, s. Jittered ones are interpolated onto a uniform grid: accurate enough for a
        plot, not for a phasor.
    signal : ndarray, shape (N,)

    Returns
    -------
    frequency_hz, amplitude : ndarray, shape (N // 2,)
        Without the mean. A sine between two lines loses at most 15 % of its amplitude.

    Raises
    ------
    JointIdError
        With fewer than eight samples, or when the times do not advance.
    """
    samples = time_s.size
    span = float(time_s[-1] - time_s[0]) if samples else 0.0
    if samples < 8 or not span > 0:
        raise JointIdError(
            f"A spectrum needs at least 8 samples over some time; there are {samples} over {span:g} s."
        )
    grid = np.linspace(time_s[0], time_s[-1], samples)
    if np.abs(time_s - grid).max() > 1e-3 * span / samples:
        signal = np.interp(grid, time_s, signal)
    slope, level = np.polyfit(grid - grid[0], signal, 1)
    window = np.hanning(samples)
    lines = np.fft.rfft((signal - level - slope * (grid - grid[0])) * window)
    frequency = np.fft.rfftfreq(samples, span / (samples - 1))
    amplitude = 2 * np.abs(lines) / window.sum()
    kept = slice(1, samples // 2 + 1)
    return np.asarray(frequency[kept], float), np.asarray(amplitude[kept], float)


def largest_line_hz(time_s: Floats, signal: Floats) -> float:
    """Frequency of the largest line of the spectrum, interpolated by a parabola, Hz.

    Raises
    ------
    JointIdError
        When the signal is too short or does not move.
    """
    frequency, amplitude = amplitude_spectrum(time_s, signal)
    peak = int(np.argmax(amplitude))
    if not amplitude[peak] > 0:
        raise JointIdError("The signal does not move: it has no frequency.")
    if not 0 < peak < amplitude.size - 1:
        return float(frequency[peak])
    return float(frequency[peak] + vertex(amplitude, peak) * (frequency[1] - frequency[0]))


def vertex(amplitude: Floats, peak: int) -> float:
    """Offset in bins, -0.5 to 0.5, of the vertex of a parabola through the logarithms around a peak."""
    left, centre, right = np.log(np.maximum(amplitude[peak - 1 : peak + 2], 1e-300))
    curvature = left - 2 * centre + right
    return 0.0 if curvature == 0 else float(np.clip(0.5 * (left - right) / curvature, -0.5, 0.5))
