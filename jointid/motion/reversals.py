"""Friction of a segment at its bins: the sign of the velocity, and free friction at its pauses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.phasors.segment import Segment, bins_of

_HATS = 2.2
"""Hat functions per period of the highest bin: finer than the bins resolve."""
_MARGIN = 4.0
"""Standard deviations of the velocity within which its sign is unknown."""
_SHORTEST = 0.05
"""Periods of the highest bin that the shortest pause with free friction lasts."""
_STATIONARY = 0.5
"""Share of the largest velocity with unknown sign from which a joint counts as stationary."""


@dataclass(frozen=True, eq=False)
class SegmentFriction:
    """Friction of one segment per unit of each parameter, at H bins."""

    coulomb: Complexes
    """Of sign θ̇, shape (H, n)."""
    curve: Complexes
    """Of sign θ̇ · exp(−|θ̇|/w) for each width w, shape (H, n, c)."""
    free: Complexes
    """Hat functions over the reversals, shape (H, n, k)."""
    stationary: np.ndarray
    """Whether a joint's motion is within its noise, shape (n,)."""


def segment_friction(segment: Segment, window: float, widths: Floats) -> SegmentFriction:
    """Transforms of the friction waveforms of a segment.

    Parameters
    ----------
    segment : Segment
    window : float
        A reversal is where |θ̇| is below this share of its largest, or within its noise; 0 uses sign θ̇
        everywhere.
    widths : ndarray, shape (n, c)
        Decay velocities of a friction curve, rad/s.
    """
    v, H = segment.velocity, segment.highest
    n, N = v.shape
    blur = _MARGIN * segment.velocity_noise
    largest = np.abs(v).max(axis=1)
    stationary = blur > _STATIONARY * largest
    coulomb, curve = np.zeros((H, n), complex), np.zeros((H, n, widths.shape[1]), complex)
    columns = [np.zeros((H, n, 0), complex)]
    for j in np.flatnonzero(~stationary).tolist():
        threshold = max(window * largest[j], blur[j])
        for begin, end in _pauses(v[j], threshold, blur[j], _SHORTEST * N / H) if window > 0 else []:
            column = np.zeros((H, n, _hat_count(segment, end - begin)), complex)
            column[:, j] = _hats(segment, begin, end, column.shape[2])
            columns.append(column)
        turns, signs = _steps(v[j], blur[j])
        coulomb[:, j] = _of_steps(turns, signs, N, H)
        fades = np.expm1(-np.abs(v[j]) / widths[j][:, None]) * _square_wave(turns, signs, N)
        curve[:, j] = coulomb[:, j, None] + bins_of(fades, H).T
    inside = np.arange(1, H + 1) >= segment.lowest
    return SegmentFriction(
        coulomb=coulomb * inside[:, None],
        curve=curve * inside[:, None, None],
        free=np.concatenate(columns, axis=2) * inside[:, None, None],
        stationary=stationary,
    )


def _steps(v: Floats, blur: float) -> tuple[Floats, Floats]:
    """Samples, with their fraction, at which the direction changes, and the directions (m + 1,).

    Where a motor rests, the change is in the middle of its last and first clear motion.
    """
    clear = np.flatnonzero(np.abs(v) > blur)
    sign = np.sign(v[clear])
    turn = np.flatnonzero(sign[1:] != sign[:-1])
    before, after = clear[turn], clear[turn + 1]
    # A straight line between the last and the first clear sample; exact for neighbours.
    share = np.abs(v[before]) / (np.abs(v[before]) + np.abs(v[after]))
    return before + share * (after - before), np.append(sign[:1], sign[turn + 1])


def _of_steps(turns: Floats, signs: Floats, N: int, H: int) -> Complexes:
    """Phasors (H,) of a square wave over N steps that changes its sign at some samples."""
    k = 2j * np.pi * np.arange(1, H + 1) / N
    found = signs[0] - signs[-1] + np.exp(-np.outer(k, turns)) @ np.diff(signs)
    return np.asarray(found / k * (2j / N))


def _square_wave(turns: Floats, signs: Floats, N: int) -> Floats:
    return np.asarray(signs[np.searchsorted(turns, np.arange(N))])


def _pauses(v: Floats, threshold: float, blur: float, shortest: float) -> list[tuple[int, int]]:
    """First and last + 1 sample of every stretch of slow motion in which the motor may stick.

    A shorter one looks like a step of the friction in its middle.
    """
    slow = np.concatenate([[False], np.abs(v) <= threshold, [False]])
    edges = np.flatnonzero(slow[1:] != slow[:-1]).reshape(-1, 2)
    lowest = np.minimum.reduceat(np.abs(v), edges[:, 0]) if edges.size else np.zeros(0)
    found = []
    for (begin, end), least in zip(edges.tolist(), lowest.tolist(), strict=True):
        turns = begin > 0 and end < v.size and v[begin - 1] * v[end] < 0
        if end - begin >= shortest and (turns or least <= blur):
            found.append((begin, end))
    return found


def _hat_count(segment: Segment, samples: int) -> int:
    length = samples * segment.interval_s * segment.highest / segment.duration_s
    return max(1, int(np.ceil(_HATS * length)) - 1)


def _hats(segment: Segment, begin: int, end: int, count: int) -> Complexes:
    """Transforms (H, count) of hat functions between the ends of a stretch."""
    N = segment.samples
    width = (end - begin + 1) / (count + 1)
    centre = begin - 1 + width * np.arange(1, count + 1)
    turns = np.arange(1, segment.highest + 1)[:, None] / N
    return np.asarray(
        2j * width / N * np.sinc(turns * width) ** 2 * np.exp(-2j * np.pi * turns * centre)
    )
