"""Detection of quantisation, and the error that it adds to phasors.

Rounding to steps of Δ has the variance Δ²/12. If the frequency divides the sample rate, or nearly so,
the error repeats with the motion: it does not scatter, and averages only over the samples that differ.
That of a slow signal always repeats, and averages over the steps that it passes in one period; in a fast
one, the error at the turning points repeats. Other noise of σ per sample dithers it, by exp(−4π²σ²/Δ²)
(Widrow and Kollár, Quantization Noise, 2008).
"""

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import spherical_jn

from jointid.arrays import Floats
from jointid.phasors.fitted_sine import SineFit
from jointid.records import SineRecord

_EXAMINED = 256
"""Samples in which the step of a record's signals is searched."""
_GLANCE = 512
"""Samples of the quick look for equal neighbours."""
_FIRST = 12
"""Differences that rule out steps in most signals."""
_ROUNDED = 1e-2
"""Deviation from a multiple, over the step, that decimals in a file leave."""
_FINEST = 1e-6
"""Smallest step, over the range of the signal, that is distinguished from rounding."""
_REPEATS = 0.02
"""Deviation of the period from whole samples, in samples, with which the error repeats."""
_LASTING = 2.0
"""Equal samples in a row from which the error is that of the position, whenever it is sampled."""
_TURNING, _TURNED = 4.83, 1 / 3
"""Samples of the step in which a parabola turns over those of its neighbours, at most 2/(√2 − 1), and
mean square of the error's sum over them, relative to a constant error: 1/72 in place of 1/24."""
_LEAST_REST, _AT_REST = 0.5, 1.5
"""Length of a rest in a motion, in periods of its highest harmonic: shorter ones are turning points; and
mean square of the error there over Δ²/12: a controller that moves a motor towards its reference
leaves it near the edge of a step more often than in its middle (3 at the edge)."""
_ZETA = 1.2020569
"""ζ(3), the sum of 1/k³: rounding has the Fourier series of a sawtooth."""
_TURNS = _ZETA / np.pi**4
"""Variance of a harmonic of a rounded sine of any offset, times its amplitude, in steps: ζ(3)/π⁴, from
the Fourier series of rounding, a sine's Bessel functions and their mean squares for large arguments."""
_EXTREME = 4.0
"""Most steps from its extremes in which a motion is compared with a sine."""
_DWELL = math.pi * math.sqrt(8 / 3 / _ZETA)
"""Error of a rest as long as a sine is within one step of its extreme, over the sine's own there: a rest
of time t adds t/√12, in steps, to that of a turning point of curvature κ, (ζ(3)/2)^½/(π κ^½). Times √2:
all of it is in phase with the motion, so that one of two quadratures has the variance of both."""
_ALIKE = 0.15
"""Difference of two sines' amplitudes and means, in steps, below which both are rounded alike."""
_SHARED = 0.5
"""Amplitude of a rounded sine, in steps, from which its records share their error."""
_FLICKERS, _TWO_LEVELS = 0.5, 1.5
"""Amplitude and range, in steps, of a signal of two levels: any sine that just reaches the next step
makes it."""
_LEAST_STEP = 1e-150
"""Smallest step whose square does not underflow."""


def may_have_steps(record: SineRecord) -> bool:
    """Whether neighbouring samples near the record's start are equal: a quick look."""
    part = slice(record.start, record.start + _GLANCE)
    signals = (record.theta_rad[part], record.tau_Nm[part])
    return any(bool((signal[1:] == signal[:-1]).any()) for signal in signals)


def step_variance(record: SineRecord, fit: SineFit) -> Floats:
    """Variance of each harmonic from quantisation in addition to the scatter, shape (2, H, 2n).

    The first part is like other noise; the second, beyond it, belongs to this record alone.
    """
    period = 1 / (record.frequency_hz * record.interval_s)
    cycles = period * np.arange(1, int(record.periods) + 1)
    repeats = np.abs(cycles - np.round(cycles)) < _REPEATS
    different = round(cycles[np.argmax(repeats)]) if repeats.any() else record.samples
    each = np.abs(np.einsum("hjj->hj", fit.covariance)) * record.samples / 4
    drift = np.abs(fit.drift) * record.samples * record.interval_s
    variance = np.zeros((2, *each.shape))
    for channel, signal in enumerate((*record.theta_rad.T, *record.tau_Nm.T)):
        used = signal[record.start :]
        step = quantum(_moving(used))
        if step > _LEAST_STEP:
            length, share = _runs(used, period, len(each))
            seen = float(each[0, channel]) / step**2
            # Samples within a step share its error, which then repeats with the motion in every period.
            lasting = length > _LASTING
            # An error that does not repeat exactly is in the scatter already.
            undithered = _undithered(seen) if repeats.any() or lasting else max(0.0, 1 - 12 * seen)
            count = (period if lasting else different) / share
            whole = step**2 / 3 / count * undithered
            variance[0, :, channel] = np.minimum(whole, step**2 / 3 / record.samples)
            variance[1, :, channel] = whole - variance[0, :, channel]
            if drift[channel] < step:
                noise = max(0.0, float(np.median(each[:, channel])) / step**2 - 1 / 12)
                size = max(1.0, abs(fit.harmonics[0, channel]) / step)
                turns = _TURNS * step**2 / size * math.exp(-4 * math.pi**2 * noise)
                turns = turns * _dwelling(used / step, len(each)) ** 2
                # Odd about a step or its edge, even about a quarter: the mean level is known.
                place = (fit.offset[channel] - used[0]) / step + np.arange(len(each)) / 4
                left = 2 * np.cos(2 * np.pi * place) ** 2 * turns - variance[0, :, channel]
                variance[1, :, channel] = np.maximum(left, variance[1, :, channel])
            moved = abs(fit.harmonics[0, channel]) / step
            if moved < _FLICKERS and np.ptp(used) < _TWO_LEVELS * step:
                variance[1, 0, channel] = max(variance[1, 0, channel], step**2 / 16)
    return variance


def rounded_variance(signal: Floats, step: float, variance: float, harmonics: int) -> Floats:
    """Variance of each harmonic, times N/4, of a signal (N,) in steps, shape (H,).

    ``variance`` is that of each sample. While the signal rests, the error by rounding stays the
    same, unless other noise dithers it.
    """
    white = step**2 / 12
    if not 0 < white <= variance:
        return np.full(harmonics, variance)
    undithered = math.exp(-4 * math.pi**2 * (variance - white) / step**2)
    lengths = _run_lengths(signal)
    rests = lengths[lengths * harmonics > _LEAST_REST * signal.size]
    orders = np.arange(1, harmonics + 1)[:, None]
    gain = _AT_REST * (rests**2 * np.sinc(orders * rests / signal.size) ** 2).sum(axis=1) / signal.size
    return np.asarray(variance + undithered * white * gain)


def _moving(signal: Floats) -> Floats:
    """Some samples from the first change of a signal on."""
    first = int(np.argmax(signal != signal[0]))
    return signal[max(first - 1, 0) :][:_EXAMINED]


def sharing(records: Sequence[SineRecord], fits: Sequence[SineFit]) -> Floats:
    """Count the records that share the rounding error of each signal, shape (r, 2n).

    Sines of equal amplitude about an equal mean, in steps, are rounded alike at every frequency: the
    errors of such records do not average.
    """
    shared = np.ones((len(records), fits[0].offset.size))
    parts = [slice(r.start, r.start + _EXAMINED) for r in records]
    signals = [
        np.column_stack([r.theta_rad[part], r.tau_Nm[part]])
        for r, part in zip(records, parts, strict=True)
    ]
    for channel in range(shared.shape[1]):
        steps = np.array([quantum(signal[:, channel]) for signal in signals])
        moved = np.array([abs(fit.harmonics[0, channel]) for fit in fits])
        stepped = np.flatnonzero((steps > _LEAST_STEP) & (moved > _SHARED * steps))
        size = moved[stepped] / steps[stepped]
        mean = np.array([fit.offset[channel] for fit in fits])[stepped] / steps[stepped]
        apart = np.subtract.outer(mean, mean)
        alike = np.abs(np.subtract.outer(size, size)) < _ALIKE
        alike &= np.abs(apart - np.round(apart)) < _ALIKE
        shared[stepped, channel] = alike.sum(axis=1)
    return shared


def unresolved_variance(records: Sequence[SineRecord]) -> Floats:
    """Variance of angles that stand still in a record, because their motion is below a step; (r, n).

    Such a log is constant, without scatter. The step follows from the joint's other records. The motion
    may have any amplitude up to half a step, and any phase: evenly over that disc, Δ²/8.
    """
    still = np.array([np.ptp(record.theta_rad[record.start :], axis=0) == 0 for record in records])
    variance = np.zeros(still.shape)
    for joint in np.flatnonzero(still.any(axis=0) & ~still.all(axis=0)):
        moving = (records[k] for k in np.flatnonzero(~still[:, joint]).tolist())
        steps = [quantum(record.theta_rad[record.start :, joint][:_EXAMINED]) for record in moving]
        variance[still[:, joint], joint] = min(filter(None, steps), default=0.0) ** 2 / 8
    return variance


def _run_lengths(signal: Floats) -> np.ndarray:
    """Numbers of equal samples in a row."""
    ends = np.flatnonzero(signal[1:] != signal[:-1])
    return np.diff(ends, prepend=-1, append=signal.size - 1)


def _runs(signal: Floats, period: float, harmonics: int) -> tuple[float, Floats]:
    """Mean number of equal samples in a row, by sample, and what counts of it at each harmonic (H,).

    The error is a ramp through zero in a step that the signal crosses, constant where it rests, and
    smaller where it turns.
    """
    lengths = _run_lengths(signal)
    ends = np.cumsum(lengths[:-1]) - 1
    rises = np.sign(signal[ends + 1] - signal[ends])
    crosses = np.zeros(lengths.size, bool)
    crosses[1:-1] = rises[1:] == rises[:-1]
    long = lengths > _LASTING
    turns = np.zeros(lengths.size, bool)
    turns[1:-1] = lengths[1:-1] < 0.5 * _TURNING * (lengths[2:] + lengths[:-2])
    weight = np.where(~crosses & long & turns, _TURNED, 1.0)
    orders, found = np.arange(1, harmonics + 1)[:, None], np.zeros(harmonics)
    for ramp in (True, False):
        own = (crosses & long) == ramp
        sizes, place = np.unique(lengths[own], return_inverse=True)
        phase = np.pi * orders * sizes / period
        shape = 3 * spherical_jn(1, phase) ** 2 if ramp else np.sinc(phase / np.pi) ** 2
        found += (ramp + sizes**2 * shape) @ np.bincount(place, weight[own], sizes.size)
    return float((lengths**2).sum() / signal.size), found / signal.size


def _dwelling(levels: Floats, harmonics: int) -> Floats:
    """Error at the ends of a motion, in steps, over that of a sine's; at least 1, shape (H,).

    A motor that friction holds there keeps its error for longer.
    """
    low, high = float(levels.min()), float(levels.max())
    amplitude = 0.5 * (high - low)
    outer = min(_EXTREME, 0.5 * amplitude)
    inner = amplitude - outer - 0.5
    if inner <= 0:
        return np.ones(harmonics)
    of_sine = 2 / np.pi * math.acos(inner / amplitude)
    rest = max(0.0, float(np.mean(np.abs(levels - 0.5 * (low + high)) > inner)) - of_sine)
    longer = rest / of_sine * np.abs(np.sinc(np.arange(1, harmonics + 1) * rest / 2))
    return np.asarray(1 + _DWELL * math.sqrt(outer) * longer)


def _undithered(scatter: float) -> float:
    """Share u of the rounding's variance that repeats, from the scatter of the log in steps squared.

    The scatter is that of noise and dithered rounding, σ² + (1 − u)/12 with u = exp(−4π²σ²): monotonic
    in σ², hence found by bisection.
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
    """Quantisation step: greatest common divisor of all differences between samples; 0 without steps.

    Found by Euclid's algorithm, tolerant of rounding to decimals. Neighbouring samples need not differ
    by a single step. ``signal`` has shape (N,).
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
    for other in steps[:_FIRST].tolist():
        step = _common(step, other, blur)
        if step <= _FINEST * size:
            return 0.0
    while step > _FINEST * size:
        rest = np.abs(steps - step * np.round(steps / step))
        rest = rest[rest > max(blur, _ROUNDED * step)]
        if rest.size == 0:
            return step
        step = _common(step, float(rest.min()), blur)
    return 0.0


def _common(a: float, b: float, blur: float) -> float:
    """Greatest common divisor of two lengths by Euclid's algorithm, within ``blur``."""
    a, b = max(a, b), min(a, b)
    while b > max(blur, _ROUNDED * a):
        a, b = b, abs(a - b * round(a / b))
    return a
