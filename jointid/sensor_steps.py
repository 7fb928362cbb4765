"""What the steps of a sensor do to phasors: an error that may come back with every period.

Rounding to steps of Δ has the variance Δ²/12. Where the frequency divides the sample rate, or nearly so,
it repeats with the motion: it does not scatter, and does not average out beyond the samples that differ.
Nor does it beyond the steps that a slow signal goes through, for between two of them it does not change.
Other noise of σ per sample dithers it, by exp(−4π²σ²/Δ²) (Widrow and Kollár, Quantization Noise, 2008).
"""

from __future__ import annotations

import math

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.fitted_sine import SineFit
from jointid.records import SineRecord

_LOOKED_AT = 256  # samples in which the step is looked for
_GLANCE = 512
_FEW = 12
_LEAST_STEP = 1e-150  # whose square is still a number
_LIKE = 1e-2  # share of a step within which decimals leave it


def may_have_steps(record: SineRecord) -> bool:
    """Whether two samples on end are equal near the record's start: a quick look."""
    part = slice(record.start, record.start + _GLANCE)
    signals = (record.theta_rad[part], record.tau_Nm[part])
    return any(bool((signal[1:] == signal[:-1]).any()) for signal in signals)


def step_variance(record: SineRecord, fit: SineFit) -> Complexes:
    """Variance that the steps of the sensors add to a phasor beyond its scatter, diagonal (2n, 2n)."""
    period = 1 / (record.frequency_hz * record.interval_s)
    cycles = period * np.arange(1, int(record.periods) + 1)
    repeats = np.abs(cycles - np.round(cycles)) < 0.02
    different = round(cycles[np.argmax(repeats)]) if repeats.any() else record.samples
    scatter = np.abs(np.diag(fit.covariance[0])) * record.samples / 4
    variance = np.zeros(scatter.size)
    for channel, signal in enumerate((*record.theta_rad.T, *record.tau_Nm.T)):
        used = signal[record.start :]
        step = quantum(used[:_LOOKED_AT])
        if step > _LEAST_STEP:
            taken = 4 * np.abs(fit.fundamental[channel]) / step * different / period
            seen = float(scatter[channel]) / step**2
            # Rounding that does not come back exactly scatters itself: what is seen need not be added.
            undithered = _undithered(seen) if repeats.any() else max(0.0, 1 - 12 * seen)
            variance[channel] = step**2 / 3 / max(min(different, taken), 1.0) * undithered
    return np.diag(variance).astype(complex)


def _undithered(scatter: float) -> float:
    """Share of the rounding's variance that comes back, from the scatter of the log in steps squared.

    The scatter is that of the noise and of the rounding as far as it is dithered, σ² + (1 − u)/12 with
    u = exp(−4π²σ²): rising in σ², so that halving finds it.
    """
    low, high = 0.0, scatter
    for _ in range(20):
        noise = 0.5 * (low + high)
        if noise + (1 - math.exp(-4 * math.pi**2 * noise)) / 12 > scatter:
            high = noise
        else:
            low = noise
    return math.exp(-4 * math.pi**2 * low)


def quantum(signal: Floats) -> float:
    """Step of which all differences between samples are multiples; 0 if there is none.

    No two samples need be a single step apart: it is the common divisor of all differences, found as
    Euclid does, within what decimals leave of it.

    Parameters
    ----------
    signal : ndarray, shape (N,)
    """
    if signal.size < 2:
        return 0.0
    size, largest = float(signal.max() - signal.min()), float(np.abs(signal).max())
    blur = max(1e-9 * size, 1e-14 * largest)
    steps = np.abs(signal[1:] - signal[:-1])
    steps = steps[steps > blur]
    if steps.size == 0:
        return 0.0
    step = 0.0
    for other in steps[:_FEW].tolist():  # most signals without steps are told by these
        step = _common(step, other, blur)
        if step <= 1e-6 * size:
            return 0.0
    while step > 1e-6 * size:
        rest = np.abs(steps - step * np.round(steps / step))
        rest = rest[rest > max(blur, _LIKE * step)]
        if rest.size == 0:
            return step
        step = _common(step, float(rest.min()), blur)
    return 0.0  # the differences have nothing in common


def _common(a: float, b: float, blur: float) -> float:
    """Greatest common divisor of two lengths, as Euclid finds it, within what blurs them."""
    a, b = max(a, b), min(a, b)
    while b > max(blur, _LIKE * a):
        a, b = b, abs(a - b * round(a / b))
    return a
