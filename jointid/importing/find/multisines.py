"""Several lines at once: where in a log they stand still together, and which they are.

Windows of falling length are looked at. Where a few narrow lines hold nearly all of the motion, short
frames are fitted with all of them at once, and the quietest frames grow to both sides as long as the
phasors of all lines stay where they are. So neither a rest, nor another pattern, nor a row of single
sines is taken for one record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.importing.find.line_fit import fit_lines
from jointid.importing.find.lines import MOST_LINES, find_lines, in_lines
from jointid.importing.find.segment import lines_worth
from jointid.importing.find.steady_state import grown, line_frames

_SHORTEST = 512  # samples of a window
_IN_LINES = 0.85  # share of the motion near the lines that the lines must hold
_FRAMES = 5  # that a run needs, overlapping by half
_ROUNDS = 8  # of growing, each at most to three times the length
_EXPLAINED = 0.9  # share of the motion that the lines explain


def multisines(
    time: Floats,
    theta: Floats,
    tau: Floats,
    fewest_periods: float,
    tell: Callable[[float], None],
) -> Iterator[tuple[int, int, list[float]]]:
    """Yield the stretches in which several lines stand still, and their lines in Hz.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Even.
    theta, tau : ndarray, shape (N, n)
    fewest_periods : float
        Of the lowest line.
    tell : callable
        Told the share that is done, 0 to 1.

    Yields
    ------
    begin, end : int
    lines_hz : list of float
    """
    free = np.ones(len(time), bool)
    lengths = [1 << k for k in range(len(time).bit_length(), 0, -1) if 1 << k >= _SHORTEST]
    lengths = [length for length in lengths if length <= len(time)]
    if len(time) >= _SHORTEST:
        lengths.insert(0, len(time))
    for number, length in enumerate(lengths):
        tell(number / len(lengths))
        for begin in range(0, len(time) - length + 1, length // 2):
            window = slice(begin, begin + length)
            if not free[window].all():
                continue
            lines = _narrow_lines(time[window], theta[window], tau[window])
            if len(lines) < 2:
                continue
            part = _left(free, begin, begin + length)
            found = _steady(time[part], theta[part], tau[part], begin - part.start, length, lines)
            if found is None:
                continue
            first, last, lines = found
            if (last - first) * (time[1] - time[0]) * min(lines) < fewest_periods:
                continue
            free[part.start + first : part.start + last] = False
            yield part.start + first, part.start + last, lines


def _narrow_lines(time: Floats, theta: Floats, tau: Floats) -> list[float]:
    """Lines of a window if they hold nearly all that moves in their neighbourhood."""
    lines = find_lines(time, theta, tau)
    if not 2 <= len(lines) < MOST_LINES or in_lines(time, theta, lines) < _IN_LINES:
        return []
    return lines_worth(time, theta, tau, lines)


def _left(free: np.ndarray, begin: int, end: int) -> slice:
    """What is free around a window."""
    before, after = np.flatnonzero(~free[:begin]), np.flatnonzero(~free[end:])
    first = int(before[-1]) + 1 if before.size else 0
    return slice(first, end + int(after[0]) if after.size else len(free))


def _steady(
    time: Floats, theta: Floats, tau: Floats, begin: int, length: int, lines: list[float]
) -> tuple[int, int, list[float]] | None:
    """Grow from the quietest frames of a window as far as all lines stand still."""
    signals = np.column_stack([theta, tau])
    first, last = begin, begin + length
    for attempt in range(_ROUNDS):
        part = slice(first, last)
        if attempt:
            lines = find_lines(time[part], theta[part], tau[part])
            lines = lines_worth(time[part], theta[part], tau[part], lines) if lines else []
            if len(lines) < 2:
                return None
        fit = fit_lines(time[part], signals[part], lines)
        lines = [float(f) for f in fit.frequency_hz]
        # Around the part only: frames that are far away cost time and say nothing.
        low, high = max(0, first - (last - first)), min(len(time), last + (last - first))
        frames = line_frames(time[low:high], signals[low:high], lines)
        inside = (frames.begin + low >= first) & (frames.begin + low + frames.length <= last)
        if inside.sum() < _FRAMES:
            return None
        z = _by_size(frames.z, signals.shape[1])
        quiet = np.flatnonzero(inside)
        from_, to = grown(z, int(quiet[0]), int(quiet[-1]) + 1)
        if to - from_ < _FRAMES:
            return None
        new = low + int(frames.begin[from_]), low + int(frames.begin[to - 1]) + frames.length
        if attempt and new == (first, last):
            break
        first, last = new
    part = slice(first, last)
    share = fit_lines(time[part], theta[part], lines, free=False).share
    if share.max() < _EXPLAINED and in_lines(time[part], theta[part], lines) < _EXPLAINED:
        return None
    return first, last, lines


def _by_size(z: Complexes, signals: int) -> Complexes:
    """Every signal counts by all its lines, so that a line of a quiet joint is not worth a whole one."""
    by_signal = z.reshape(len(z), signals, -1)
    size = np.sqrt((np.abs(by_signal) ** 2).sum(axis=2).mean(axis=0))
    scaled: Complexes = by_signal / np.where(size > 0, size, 1.0)[:, None]
    return scaled.reshape(len(z), -1)
