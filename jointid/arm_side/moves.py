"""Moves of a joint between its rests and reversals."""

import numpy as np

from jointid.arrays import Floats

_REST = 0.02
"""Velocity, in parts of the joint's largest, up to which it rests."""
_CLEAR = 0.25
"""Peak velocity of a clear move, in parts of the joint's largest."""


def over_own_move(v: Floats, fastest: float) -> Floats:
    """Velocity v (N,) over the largest between two rests or reversals, (N,); 0 where the joint rests."""
    rest = _REST * fastest
    size = np.abs(v) * (np.abs(v) > rest)
    begins = np.flatnonzero(np.diff(np.sign(size * v), prepend=np.nan))
    peak = np.maximum.reduceat(np.abs(v), begins).clip(rest)
    return np.asarray(size / np.repeat(peak, np.diff(begins, append=v.size)))


def clear_moves(velocities: list[Floats]) -> int:
    """Number of clear moves in the velocities of a joint, one (N,) of each record."""
    fastest = max(float(np.abs(v).max()) for v in velocities)
    peaks = ((over_own_move(v, fastest) == 1) & (np.abs(v) > _CLEAR * fastest) for v in velocities)
    return sum(int(np.count_nonzero(each)) for each in peaks)
