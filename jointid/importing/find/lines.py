"""The lines of a spectrum that stand out of everything around them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jointid.arrays import Floats

MOST_LINES = 60
"""More lines than any multisine has."""

_PROMINENCE = 12.0  # amplitude over the median around it
_SMALLEST = 0.02  # amplitude over the largest


def find_lines(time_s: Floats, *signals: Floats) -> list[float]:
    """Return the frequencies of the lines in all signals together, ascending, Hz.

    Parameters
    ----------
    time_s : ndarray, shape (N,)
        Jittered times are interpolated, which is good enough to find a line.
    *signals : ndarray, shape (N, n)
        Groups of one kind: positions, torques. A line may stand out in any of them.

    Returns
    -------
    list of float
        Good to a tenth of one over the duration; lines closer than four of these are one.
    """
    if time_s.size < 16:
        return []
    found: list[tuple[float, float]] = []
    resolution = (time_s.size - 1) / time_s.size / float(time_s[-1] - time_s[0])
    for group in signals:
        amplitude = _spectrum(time_s, group)
        for peak in _peaks(amplitude):
            left, centre, right = np.log(np.maximum(amplitude[peak - 1 : peak + 2], 1e-300))
            curvature = left - 2 * centre + right
            shift = (
                0.0 if curvature == 0 else float(np.clip(0.5 * (left - right) / curvature, -0.5, 0.5))
            )
            found.append((float(amplitude[peak] / amplitude.max()), peak + shift))
    kept: list[float] = []
    for _, place in sorted(found, reverse=True):
        if len(kept) < MOST_LINES and all(abs(place - other) > 3 for other in kept):
            kept.append(place)
    return sorted(place * resolution for place in kept)


def in_lines(time_s: Floats, signals: Floats, lines_hz: Sequence[float]) -> float:
    """Share of what moves about the lines that lies on them, 0 to 1.

    Noise above them does not count, nor does a slow wander below.

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


def _spectrum(time_s: Floats, signals: Floats) -> Floats:
    """Amplitudes of all signals together, each by its own size, without offset and drift."""
    count = time_s.size
    grid = np.linspace(time_s[0], time_s[-1], count)
    if np.abs(grid - time_s).max() > 1e-3 * (grid[1] - grid[0]):
        signals = np.column_stack([np.interp(grid, time_s, signal) for signal in signals.T])
    slope = np.linspace(-1, 1, count)
    # Offset and slope are orthogonal here.
    mean = signals.mean(axis=0)
    drift = slope @ signals / (slope @ slope)
    rest = signals - mean - np.outer(slope, drift)
    size = rest.std(axis=0)
    largest = float(size.max())
    if not largest > 0:
        return np.zeros(count // 2 + 1)
    # A joint that hardly moves shows its noise, not lines.
    rest = rest[:, size > 0.05 * largest] / size[size > 0.05 * largest]
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
    kept: list[int] = []
    for place in order:
        if len(kept) == MOST_LINES or amplitude[place] < max(floor, _SMALLEST * amplitude[order[0]]):
            break
        if all(abs(place - other) > 3 for other in kept):
            kept.append(int(place))
    return kept
