"""Lines of a spectrum that are prominent above the noise, and their frequencies by least squares."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from jointid.arrays import Complexes, Floats
from jointid.phasors.fitted_sine import sine_basis
from jointid.phasors.spectrum import evenly_sampled, vertex

MOST_LINES = 60
"""Upper bound on the lines of a multisine."""

_PROMINENCE = 12.0  # amplitude over the median of the spectrum
_MIN_AMPLITUDE = 0.02  # over the largest line
_MIN_MOTION = 0.05  # motion of a joint over the largest, below which it shows its noise, not lines
_DISTANCE = 3  # bins: the main lobe of a Hann window spans four


def find_lines(time_s: Floats, *signals: Floats) -> list[float]:
    """Return the frequencies of the lines in all signals together, ascending, Hz.

    They are accurate to 0.1 / duration; lines closer than four bins count as one. Each
    group of signals (N, n) is of one quantity, positions or torques; a line may be prominent in any of
    them. Uneven times are interpolated, which is accurate enough to find a line.
    """
    if time_s.size < 16:
        return []
    found: list[tuple[float, float]] = []
    resolution = (time_s.size - 1) / time_s.size / float(time_s[-1] - time_s[0])
    for group in signals:
        amplitude = _spectrum(time_s, group)
        least = _PROMINENCE * float(np.median(amplitude))
        peaks = 1 + find_peaks(amplitude[1:], height=least, distance=_DISTANCE + 1)[0]
        clear = amplitude[peaks] >= _MIN_AMPLITUDE * amplitude[peaks].max(initial=0.0)
        for peak in peaks[clear].tolist():
            found.append((float(amplitude[peak] / amplitude.max()), peak + vertex(amplitude, peak)))
    kept: list[float] = []
    for _, place in sorted(found, reverse=True):
        if len(kept) < MOST_LINES and all(abs(place - other) > _DISTANCE for other in kept):
            kept.append(place)
    return sorted(place * resolution for place in kept)


def in_lines(time_s: Floats, signals: Floats, lines_hz: Sequence[float]) -> float:
    """Share of the power around the lines that lies on them, 0 to 1.

    Noise above the band of the lines and slow drift below it do not count. Shapes: ``time_s`` (N,),
    ``signals`` (N, n).
    """
    power = _spectrum(time_s, signals) ** 2
    place = np.asarray(lines_hz) * float(time_s[-1] - time_s[0]) * time_s.size / (time_s.size - 1)
    low, high = int(0.5 * place.min()), int(np.ceil(1.5 * place.max())) + 3
    on = np.zeros(power.size, bool)
    for p in place:
        on[max(0, round(p) - 2) : round(p) + 3] = True
    about = power[low:high]
    total = float(about.sum())
    return float(about[on[low:high]].sum() / total) if total > 0 else 0.0


def _spectrum(time_s: Floats, signals: Floats) -> Floats:
    """Amplitudes of all signals together, each normalised, without offset and drift."""
    count = time_s.size
    even, slope = evenly_sampled(time_s, signals)[1], np.linspace(-1, 1, count)[:, None]
    drift = slope.T @ even / (slope.T @ slope)  # orthogonal to the offset
    rest = even - even.mean(axis=0) - slope * drift
    size = rest.std(axis=0)
    largest = float(size.max())
    if not largest > 0:
        return np.zeros(count // 2 + 1)
    moves = size > _MIN_MOTION * largest
    rest = rest[:, moves] / size[moves]
    window = np.hanning(count)
    spectra = np.abs(np.fft.rfft(rest * window[:, None], axis=0))
    return np.asarray(np.sqrt((spectra**2).sum(axis=1)))


_MAX_ITERATIONS = 12
_MAX_SAMPLES = 200_000  # of a longer span only every k-th sample is used: this fixes the frequency
_LEAST_RATE = 20  # samples per period of the highest harmonic that decimation must leave
_BAND = 0.9  # of the Nyquist frequency, up to which harmonics are fitted


@dataclass(frozen=True, eq=False)
class LineFit:
    """Lines fitted to every signal together with offset and drift."""

    frequency_hz: Floats
    """Shape (L,), Hz."""
    error_hz: Floats
    """Standard error of each frequency for a white residual, shape (L,), Hz; infinite if not fitted."""
    phasors: Complexes
    """y of Im(y e^{iωt}), t from ``middle_s``, shape (L, c); those of the fundamentals only."""
    share: Floats
    """Share of each signal's variance that the fit explains, shape (c,)."""
    middle_s: float
    """Time in the middle, s."""


def fit_lines(
    time_s: Floats,
    signals: Floats,
    frequency_hz: Sequence[float],
    *,
    harmonics: int = 1,
    free: bool = True,
    within: float = 1e-8,
) -> LineFit:
    """Fit lines, offset and drift to all signals (N, c), and refine the frequencies by Gauss-Newton.

    The signals share the frequencies; each is weighted by its own noise. Initial frequencies are within
    0.5 / duration of the true ones; unless ``free``, they are kept. ``harmonics`` is the highest fitted
    to each line, as far as the sample rate allows. The iteration ends when the phase of every line
    changes over the duration by less than ``within``, rad.
    """
    step = max(1, len(time_s) // _MAX_SAMPLES)
    if len(time_s) < _LEAST_RATE * (harmonics + 1) * max(frequency_hz) * np.ptp(time_s) * step:
        step = 1
    time, data = time_s[::step], signals[::step] - signals.mean(axis=0)
    middle = float(time[0] + time[-1]) / 2
    clock, span = time - middle, float(time[-1] - time[0])
    omega = 2 * np.pi * np.asarray(frequency_hz, float)
    start = omega.copy()
    highest = np.pi / float(np.median(np.diff(time)))
    orders = [max(1, min(harmonics, int(_BAND * highest / w))) for w in omega]
    line = np.repeat(np.arange(omega.size), orders)
    order = np.concatenate([np.arange(1, count + 1) for count in orders])
    variance = np.full(omega.size, np.inf)
    for _ in range(_MAX_ITERATIONS if free else 1):
        basis = sine_basis(np.outer(clock, order * omega[line]), clock / span)
        # Lines that a window resolves are nearly orthogonal: normal equations lose nothing.
        inverse: Floats = np.asarray(np.linalg.pinv(basis.T @ basis, hermitian=True), float)
        coefficients = inverse @ (basis.T @ data)
        residual = data - basis @ coefficients
        if not free:
            break
        slopes = _slopes(clock, basis, coefficients, line, order)
        # A change that the amplitudes can absorb is no evidence for a change of frequency.
        slopes -= basis @ (inverse @ (basis.T @ slopes))
        noise = residual.std(axis=0) + 1e-12 * np.abs(data).max(axis=0) + 1e-300
        weighted = (slopes / noise).reshape(omega.size, -1)
        spread = np.linalg.pinv(weighted @ weighted.T, hermitian=True)
        shift, variance = spread @ (weighted @ (residual / noise).ravel()), np.diag(spread).copy()
        omega = omega + np.clip(shift, -0.5 * np.pi / span, 0.5 * np.pi / span)
        omega = np.clip(omega, np.maximum(start - 2 * np.pi / span, start / 4), start + 2 * np.pi / span)
        if np.all(np.abs(shift) * span < within):
            break
    ramp = basis[:, -2:]
    moved = data - ramp @ (np.linalg.pinv(ramp.T @ ramp) @ (ramp.T @ data))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.nan_to_num(1 - (residual**2).sum(axis=0) / (moved**2).sum(axis=0))
    cosine, sine = np.split(coefficients[:-2], 2)
    return LineFit(
        frequency_hz=omega / (2 * np.pi) if free else np.asarray(frequency_hz, float),
        error_hz=np.sqrt(variance) / (2 * np.pi),
        phasors=(sine + 1j * cosine)[order == 1],
        share=share,
        middle_s=middle,
    )


def _slopes(
    clock: Floats, basis: Floats, coefficients: Floats, line: np.ndarray, order: np.ndarray
) -> Floats:
    """Derivative of the fitted signals by the ω of each line, shape (L, N, c)."""
    cosines, sines = np.split(basis[:, :-2], 2, axis=1)
    cosine, sine = np.split(coefficients[:-2] * np.tile(order, 2)[:, None], 2)
    return np.stack(
        [
            clock[:, None] * (cosines[:, part] @ sine[part] - sines[:, part] @ cosine[part])
            for part in (line == k for k in range(line[-1] + 1))
        ]
    )
