"""Lines of a spectrum that are prominent above the noise."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from jointid.arrays import Floats
from jointid.phasors.spectrum import vertex

MOST_LINES = 60
"""Upper bound on the lines of a multisine."""

_PROMINENCE = 12.0  # amplitude over the median of the spectrum
_MIN_AMPLITUDE = 0.02  # over the largest line
_MIN_MOTION = 0.05  # motion of a joint over the largest, below which it shows its noise, not lines
_DISTANCE = 3  # bins: the main lobe of a Hann window spans four
_JITTER = 1e-3  # of a sample interval, below which times count as evenly spaced


def find_lines(time_s: Floats, *signals: Floats) -> list[float]:
    """Return the frequencies of the lines in all signals together, ascending, Hz.

    Parameters
    ----------
    time_s : ndarray, shape (N,)
        Uneven times are interpolated, which is accurate enough to find a line.
    *signals : ndarray, shape (N, n)
        Groups of one quantity: positions, torques. A line may be prominent in any of them.

    Returns
    -------
    list of float
        Accurate to a tenth of one over the duration; lines closer than four bins count as one.
    """
    if time_s.size < 16:
        return []
    found: list[tuple[float, float]] = []
    resolution = (time_s.size - 1) / time_s.size / float(time_s[-1] - time_s[0])
    for group in signals:
        amplitude = _spectrum(time_s, group)
        for peak in _peaks(amplitude):
            found.append((float(amplitude[peak] / amplitude.max()), peak + vertex(amplitude, peak)))
    kept = _apart([place for _, place in sorted(found, reverse=True)])
    return sorted(place * resolution for place in kept)


def _apart(places: Iterable[float]) -> list[float]:
    """Places in order, without those within three bins of an earlier one; at most ``MOST_LINES``."""
    kept: list[float] = []
    for place in places:
        if len(kept) < MOST_LINES and all(abs(place - other) > _DISTANCE for other in kept):
            kept.append(place)
    return kept


def in_lines(time_s: Floats, signals: Floats, lines_hz: Sequence[float]) -> float:
    """Share of the power around the lines that lies on them, 0 to 1.

    Noise above the band of the lines and slow drift below it do not count.

    Parameters
    ----------
    time_s : ndarray, shape (N,)
    signals : ndarray, shape (N, n)
    lines_hz : sequence of float
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


def evenly_sampled(time_s: Floats, signals: Floats) -> tuple[Floats, Floats]:
    """Return an even grid and the signals on it, interpolated if the times are uneven.

    Parameters
    ----------
    time_s : ndarray, shape (N,)
    signals : ndarray, shape (N, c)
    """
    grid = np.linspace(time_s[0], time_s[-1], time_s.size)
    if np.abs(grid - time_s).max() > _JITTER * (grid[1] - grid[0]):
        signals = np.column_stack([np.interp(grid, time_s, signal) for signal in signals.T])
    return grid, signals


def without_drift(signals: Floats) -> Floats:
    """Return evenly sampled signals without their offset and linear drift, shape (N, c)."""
    slope = np.linspace(-1, 1, len(signals))  # orthogonal to the offset
    return np.asarray(
        signals - signals.mean(axis=0) - np.outer(slope, slope @ signals / (slope @ slope))
    )


def _spectrum(time_s: Floats, signals: Floats) -> Floats:
    """Amplitudes of all signals together, each normalised, without offset and drift."""
    count = time_s.size
    rest = without_drift(evenly_sampled(time_s, signals)[1])
    size = rest.std(axis=0)
    largest = float(size.max())
    if not largest > 0:
        return np.zeros(count // 2 + 1)
    moves = size > _MIN_MOTION * largest
    rest = rest[:, moves] / size[moves]
    window = np.hanning(count)
    spectra = np.abs(np.fft.rfft(rest * window[:, None], axis=0))
    return np.asarray(np.sqrt((spectra**2).sum(axis=1)))


def _peaks(amplitude: Floats) -> list[int]:
    """Indices of peaks, the largest first, none within three bins of a larger one."""
    inner = amplitude[1:-1]
    highest = (inner >= amplitude[:-2]) & (inner > amplitude[2:])
    places = np.flatnonzero(highest) + 1
    places = places[places >= 2]
    order = places[np.argsort(-amplitude[places])][: 8 * MOST_LINES]
    floor = float(np.median(amplitude)) * _PROMINENCE
    clear = amplitude[order] >= np.maximum(floor, _MIN_AMPLITUDE * amplitude[order[:1]])
    return [int(place) for place in _apart(order[clear])]
