"""Search for multisines: spans in which several lines are constant together.

Windows of decreasing length are examined. Where a few narrow lines hold nearly all of the motion, short
frames are fitted with all of them, and the steadiest frames grow to both sides while the phasors of all
lines are constant. So neither a rest nor another pattern nor a series of single sines is part of a run.
"""

from collections.abc import Callable, Iterator

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.importing.find.lines import MOST_LINES, find_lines, fit_lines, in_lines
from jointid.importing.find.segment import FEWEST_PERIODS, significant_lines
from jointid.importing.find.sine_candidates import averaged
from jointid.importing.find.steady_state import SEED_FRAMES, frames_of, grown, weighted

_SHORTEST = 512  # samples of a window
_LONGEST = 1 << 15  # the same, beyond which its samples are averaged
_MIN_IN_LINES = 0.85  # share of the power around the lines that must lie on them
_CHANGE = 0.03  # relative change of the phasors that ends a run; the frequencies are known well
_MAX_ROUNDS = 8  # of growing, each to three times the length at most
_MIN_EXPLAINED = 0.9  # share of the motion that the lines must explain


def multisines(
    time: Floats, signals: Floats, free: np.ndarray, progress: Callable[[float], None]
) -> Iterator[tuple[int, int, list[float]]]:
    """Yield begin and end of the spans in which several lines are constant, and these lines in Hz.

    ``time`` (N,) is evenly spaced; ``signals`` (N, 2n) are positions, then torques. Runs lie where
    ``free`` (N,) is true, and are removed from it. ``progress`` gets the share done.
    """
    lengths = [len(time), *(1 << k for k in reversed(range(len(time).bit_length())))]
    lengths = [length for length in lengths if length >= _SHORTEST]
    for number, length in enumerate(lengths):
        progress(number / len(lengths))
        for begin in range(0, len(time) - length + 1, length // 2):
            window = slice(begin, begin + length)
            if not free[window].all():
                continue
            lines = excited_lines(time[window], signals[window], _MIN_IN_LINES)
            if len(lines) < 2:
                continue
            part = _free_around(free, begin, begin + length)
            found = _grown_run(time[part], signals[part], begin - part.start, length, lines)
            if found is None:
                continue
            first, last, lines = found
            if (last - first) * (time[1] - time[0]) * min(lines) < FEWEST_PERIODS:
                continue
            free[part.start + first : part.start + last] = False
            yield part.start + first, part.start + last, lines


def excited_lines(time: Floats, signals: Floats, share: float = 0.0) -> list[float]:
    """Return the excited lines of a span, Hz; none if too little of the power around them is on them.

    Shapes and order as in ``multisines``; long spans are averaged.
    """
    width = max(1, len(time) // _LONGEST)
    time = averaged(time, width)
    theta, tau = np.hsplit(averaged(signals, width), 2)
    lines = find_lines(time, theta, tau)
    if len(lines) > 1 and (len(lines) == MOST_LINES or in_lines(time, theta, lines) < share):
        return []
    return significant_lines(time, theta, tau, lines) if len(lines) > 1 else lines


def _free_around(free: np.ndarray, begin: int, end: int) -> slice:
    """Largest free slice around a window."""
    before, after = np.flatnonzero(~free[:begin]), np.flatnonzero(~free[end:])
    first = int(before[-1]) + 1 if before.size else 0
    return slice(first, end + int(after[0]) if after.size else len(free))


def _grown_run(
    time: Floats, signals: Floats, begin: int, length: int, lines: list[float]
) -> tuple[int, int, list[float]] | None:
    """Grow from the steadiest frames of a window while all lines are constant."""
    interval = float(time[1] - time[0])
    first, last = begin, begin + length
    for attempt in range(_MAX_ROUNDS):
        part = slice(first, last)
        if attempt:
            lines = excited_lines(time[part], signals[part])
        if len(lines) < 2:
            return None
        lines = [float(f) for f in fit_lines(time[part], signals[part], lines).frequency_hz]
        # Frames far from the part cost time and cannot be reached in this round.
        low, high = max(0, first - (last - first)), min(len(time), last + (last - first))
        frames = frames_of(signals[low:high], np.array(lines) * interval)
        inside = (frames.begin + low >= first) & (frames.begin + low + frames.length <= last)
        if inside.sum() < SEED_FRAMES:
            return None
        seeds = np.flatnonzero(inside)
        y = _by_size(frames.z, signals.shape[1])
        noise = weighted(y[inside])[1]
        from_, to = grown(y, noise, slice(int(seeds[0]), int(seeds[-1]) + 1), _CHANGE)
        if to - from_ < SEED_FRAMES:
            return None
        new = low + int(frames.begin[from_]), low + int(frames.begin[to - 1]) + frames.length
        if attempt and new == (first, last):
            break
        first, last = new
    explained = in_lines(time[first:last], signals[first:last, : signals.shape[1] // 2], lines)
    return (first, last, lines) if explained > _MIN_EXPLAINED else None


def _by_size(z: Complexes, signals: int) -> Complexes:
    """Normalise each signal by all its lines, so that a weak line of a quiet joint weighs little."""
    by_signal = z.reshape(len(z), signals, -1)
    size = np.sqrt((np.abs(by_signal) ** 2).sum(axis=2).mean(axis=0))
    scaled: Complexes = by_signal / np.where(size > 0, size, 1.0)[:, None]
    return scaled.reshape(len(z), -1)
