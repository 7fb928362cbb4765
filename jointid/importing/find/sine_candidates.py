"""Spans of a log that a sine explains, at every frequency.

Every frequency of a fine geometric grid is fitted, with offset and drift, in windows of a few periods
that slide by one period. The share of the motion that the sine explains separates sines from rest, noise
and travel. Low frequencies are searched in averaged samples, so that a long log needs few passes.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from jointid.arrays import Floats, true_runs
from jointid.phasors.fitted_sine import sine_basis

WINDOW_PERIODS = 4
"""Periods in one window: with fewer, a sine is like any other motion."""
SHARE = 0.6
"""Least share of the motion that a sine must explain."""

_GRID = 1.06  # ratio of neighbouring frequencies; half a step costs 2 % of the share
_FEWEST_PER_PERIOD = 8  # samples; at higher frequencies a window is too short to exclude noise
_COARSE_PER_PERIOD = 16  # samples per period that averaging leaves
_CHUNK = 1 << 21  # numbers of the windows in memory at a time
_ROUND_OFF = 1e-12  # variance over the mean square below which a signal is constant


@dataclass(frozen=True)
class Candidate:
    """A span in which one frequency explains most of the motion."""

    begin: int
    """First sample, of the original ones."""
    end: int
    """One past the last sample."""
    frequency: float
    """Cycles per sample, within a few per cent."""
    score: float
    """Number of periods, weighted by the share of the motion explained."""


def sine_candidates(signals: Floats, progress: Callable[[float], None]) -> list[Candidate]:
    """Find all spans that a sine explains, at every frequency that explains them, the best first.

    Neighbouring frequencies explain the same span: take the best, then the rest. Signals (N, n) are
    evenly sampled; in each window the signal counts that a sine explains best. ``progress`` gets the
    share done.
    """
    found: list[Candidate] = []
    mean = signals - np.median(signals, axis=0)
    power = mean**2
    samples = len(signals)
    width = 1
    highest = 1 / _FEWEST_PER_PERIOD
    lowest = (WINDOW_PERIODS + 0.5) / samples
    frequency = highest
    while frequency > lowest:
        progress(1 - frequency / highest)  # with averaging, the cost is proportional to the frequency
        while frequency * width * 2 * _COARSE_PER_PERIOD <= 1 and len(mean) >= 8:
            mean, power = averaged(mean, 2), averaged(power, 2)
            width *= 2
        found += _at_frequency(mean, power, width, frequency)
        frequency /= _GRID
    return sorted(found, key=lambda c: -c.score)


def averaged(values: Floats, width: int) -> Floats:
    """Return means of ``width`` samples each: a long span shows low frequencies in few samples."""
    whole = values[: len(values) // width * width]
    return values if width == 1 else whole.reshape(-1, width, *values.shape[1:]).mean(axis=1)


def _at_frequency(mean: Floats, power: Floats, width: int, frequency: float) -> Iterator[Candidate]:
    period = 1 / (frequency * width)
    length = round(WINDOW_PERIODS * period)
    hop = max(1, round(period))
    if len(mean) < length:
        return
    share = _shares(mean, power, length, hop, 2 * np.pi / period)
    for first, last in true_runs(share >= SHARE):
        begin, end = first * hop * width, ((last - 1) * hop + length) * width
        score = float((share[first:last] - 0.5).sum()) * hop / period
        score += WINDOW_PERIODS * float(share[first:last].mean() - 0.5)
        yield Candidate(begin, end, frequency, score)


@lru_cache(maxsize=512)  # the frequencies of all logs are the same
def _basis(length: int, x: float) -> Floats:
    """Orthonormal columns of drift, offset and a sine of x rad per sample."""
    clock = np.arange(length, dtype=float) - (length - 1) / 2
    basis, _ = np.linalg.qr(sine_basis(x * clock, clock)[:, ::-1])
    return np.asarray(basis)


def _shares(mean: Floats, power: Floats, length: int, hop: int, x: float) -> Floats:
    """Share of the variance about offset and drift that a sine explains, best signal of each window."""
    basis, count = _basis(length, x), (len(mean) - length) // hop + 1
    best = np.zeros(count)
    step = max(1, _CHUNK // length)
    for signal, square in zip(mean.T, power.T, strict=True):
        windows = np.lib.stride_tricks.sliding_window_view(signal, length)[::hop]
        squares = np.concatenate([[0.0], np.cumsum(square)])
        start = hop * np.arange(count)
        total = squares[start + length] - squares[start]
        for begin in range(0, count, step):
            part = slice(begin, begin + step)
            energy = (windows[part] @ basis) ** 2
            about_line = total[part] - energy[:, 0] - energy[:, 1]
            moves = about_line > _ROUND_OFF * np.maximum(total[part], 1e-300)
            explained = energy[:, 2:].sum(axis=1)
            share = np.divide(explained, about_line, out=np.zeros_like(explained), where=moves)
            best[part] = np.maximum(best[part], share)
    return best
