"""The lines of a spectrum that stand out of everything around them."""

from __future__ import annotations

import numpy as np

from jointid.arrays import Floats

MOST_LINES = 60
"""More lines than any multisine has."""

_PROMINENCE = 12.0  # amplitude over the median around it
_SMALLEST = 0.02  # amplitude over the largest


def find_lines(time_s: Floats, signals: Floats) -> list[float]:
    """Return the frequencies of the lines in all signals together, ascending, Hz.

    Parameters
    ----------
    time_s : ndarray, shape (N,)
        Jittered times are interpolated, which is good enough to find a line.
    signals : ndarray, shape (N, n)

    Returns
    -------
    list of float
        Good to a tenth of one over the duration; lines closer than four of these are one.
    """
    count = time_s.size
    if count < 16:
        return []
    grid = np.linspace(time_s[0], time_s[-1], count)
    if np.abs(grid - time_s).max() > 1e-3 * (grid[1] - grid[0]):
        signals = np.column_stack([np.interp(grid, time_s, signal) for signal in signals.T])
    slope = np.linspace(-1, 1, count)
    columns = np.column_stack([np.ones(count), slope])
    rest = signals - columns @ np.linalg.lstsq(columns, signals, rcond=None)[0]
    size = rest.std(axis=0)
    largest = float(size.max())
    if not largest > 0:
        return []
    # A joint that hardly moves shows its noise, not lines.
    rest = rest[:, size > 0.05 * largest] / size[size > 0.05 * largest]
    window = np.hanning(count)
    amplitude = np.sqrt((np.abs(np.fft.rfft(rest * window[:, None], axis=0)) ** 2).sum(axis=1))
    lines: list[float] = []
    resolution = 1 / (grid[-1] - grid[0]) * (count - 1) / count
    for peak in _peaks(amplitude):
        left, centre, right = np.log(np.maximum(amplitude[peak - 1 : peak + 2], 1e-300))
        curvature = left - 2 * centre + right
        shift = 0.0 if curvature == 0 else float(np.clip(0.5 * (left - right) / curvature, -0.5, 0.5))
        lines.append((peak + shift) * resolution)
    return sorted(lines)


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
