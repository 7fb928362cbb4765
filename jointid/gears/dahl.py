"""Dahl's hysteresis over sampled deflections: dz/dδ = (1 − z sign δ̇)/presliding.

Samples hide a turn of the motion between them, in which Dahl's element moves twice. The deflection of a
step and of the one before is taken as a parabola, whose turn is known; without it, a step of a 24th of a
period and a presliding of 3 % of the deflection put K up to 0.5 % off.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_simpson

from jointid.arrays import Complexes, Floats
from jointid.phasors.segment import Segment, bins_of
from jointid.small_matrices import decaying

_SLOW = 0.1
"""Velocity at the start over its root mean square, above which the element slides from the start."""


class DahlSteps(NamedTuple):
    """z after steps 1 … N − 1 from given states before them, and its derivatives, each (n, N − 1)."""

    z: Floats
    by_move: Floats
    by_earlier: Floats
    """By the move of the step before."""
    by_z: Floats
    """By z before the step."""

    @classmethod
    def of(cls, delta: Floats, z: Floats, sharpness: Floats, starts: np.ndarray) -> DahlSteps:
        """Steps of deflections and states (n, N); ``starts``, (N,), is true in the first two of a part.

        The sharpness is one over the presliding, shape (n, 1). In the first two steps of a part z is as
        given, and does not change with the deflection.
        """
        before, after, share = (x[:, 1:] for x in _around_turns(delta, starts))
        first, last, free = np.sign(before), np.sign(after), ~starts[1:]
        kept, remains = np.exp(-np.abs(before) * sharpness), np.exp(-np.abs(after) * sharpness)
        turned = first + (z[:, :-1] - first) * kept
        found = last + (turned - last) * remains
        by_before = sharpness * (1 - first * turned) * remains
        by_after = sharpness * (1 - last * found)
        by_turn = 0.5 * share * (by_before - by_after)
        by_move, by_earlier = by_after + (share - 1) * by_turn, (share + 1) * by_turn
        found = np.where(free, found, z[:, 1:])
        return cls(found, by_move * free, -by_earlier * free, kept * remains * free)


def dahl(delta: Floats, sharpness: Floats, starts: np.ndarray | None = None) -> Floats:
    """z over deflections (n, N); the sharpness is one over the presliding, shape (n, 1).

    A part of a record begins with z as if it had moved on as in its first step, unless that is slow:
    a motion that is recorded from its middle slides. ``starts``, (N,), is as in ``DahlSteps.of``; by
    default all is one part. Over a period that repeats, see ``periodic_dahl``.
    """
    if starts is None:
        starts = np.arange(delta.shape[1]) < 2
    before, after, _ = _around_turns(delta, starts)
    kept, remains = np.exp(-np.abs(before) * sharpness), np.exp(-np.abs(after) * sharpness)
    drive = np.sign(before) * (1 - kept) * remains + np.sign(after) * (1 - remains)
    begins = np.flatnonzero(starts)[::2]
    move = np.diff(delta, axis=1, append=delta[:, -1:])
    usual = np.sqrt((move**2).mean(axis=1, keepdims=True)) + np.finfo(float).tiny
    velocity = move[:, begins] - 0.5 * (move[:, begins + 1] - move[:, begins])
    drive[:, begins] = np.clip(velocity / (_SLOW * usual), -1, 1)
    decay = kept * remains
    decay[:, begins] = 0
    return decaying(decay, drive)


def _around_turns(delta: Floats, starts: np.ndarray) -> tuple[Floats, Floats, Floats]:
    """Moves before and after a turn in each step, shape (n, N); without a turn, the first is zero.

    The third result is zero without a turn, otherwise s, the velocity at the start of the step over the
    change of the move: the move before the turn changes with that of the step by s (s − 1)/2, and with
    that of the step before by −s (s + 1)/2.
    """
    move = np.diff(delta, axis=1, prepend=delta[:, :1])
    bend = np.where(starts, 0.0, np.diff(move, axis=1, prepend=0.0))
    begun = move - 0.5 * bend
    turns = begun * (begun + bend) < 0
    share = np.where(turns, begun / np.where(turns, bend, 1.0), 0.0)
    before = -0.5 * begun * share
    return before, move - before, share


def presliding_bins(segments: Mapping[int, Segment], sharpness: Floats) -> dict[int, Complexes]:
    """Phasors of Dahl's z over the motor angles in the bins of each segment, (highest, n), by its row.

    The sharpness, shape (n, 1), is one over the presliding angle. The first presliding angles of
    a record's motion bring z to its true value, if its start is wrong.
    """
    of_records: dict[int, Floats] = {}
    found = {}
    for row, segment in segments.items():
        velocity = segment.uniform_velocity  # that of all segments of a record
        if id(velocity) not in of_records:
            angle = cumulative_simpson(velocity, dx=segment.interval_s, axis=1, initial=0)
            of_records[id(velocity)] = dahl(angle, sharpness)
        z = of_records[id(velocity)][:, segment.begin : segment.end]
        found[row] = bins_of(z, segment.highest).T
    return found
