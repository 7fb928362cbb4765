"""Motion of the motors over time, as motion records show it: it drives the gears of ``driven_gears``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from jointid.arrays import Complexes, Floats
from jointid.phasors.periods import waves_at
from jointid.phasors.segment import Segment

_STEPS, _STEPS_OF_LOOPS = 16.0, 24.0
"""Steps over a period of the motion's highest frequency, and with hysteresis."""
_BLOCK = 40
"""Steps whose waves all blocks of a segment share."""
_PAUSE_S = 1.0
"""Time between records in one array."""
_LEAD = 0.25
"""Motion before a segment, over its length, in which an error of the state at the start decays."""
_LOADED = 0.2
"""Torque over its largest from which a flank is in contact."""


@dataclass(frozen=True, eq=False)
class MotorMotion:
    """Motion of n motors in N steps; the parts without a gap follow each other."""

    angle: Floats
    """Less its mean in each part, shape (n, N), rad."""
    rise: Floats
    """Its second differences, shape (n, N), rad."""
    jerk: Floats
    """Central differences of ``rise`` at its middle, shape (n, N), rad."""
    time_s: Floats
    """Of each step, shape (N,), s; the records follow each other after a pause."""
    step_s: Floats
    """Shape (N,), s."""
    starts: np.ndarray
    """Whether a step is one of the first two of a part, shape (N,)."""
    pose: np.ndarray
    """Index of the pose in every step, shape (N,)."""
    torque: Floats
    """Torque of the motors, shape (n, N), N·m."""
    rows: Sequence[tuple[int, slice, Complexes, Complexes]]
    """Row and steps of every segment, and waves of its bins in the steps of a block, (b, H), and at the
    start of every block, (blocks, H). Steps that begin or end between samples differ by terms of the
    ends."""

    @classmethod
    def of(cls, segments: Iterable[Segment | None], pose: np.ndarray, loops: bool) -> MotorMotion | None:
        """Motion in the segments and shortly before them; None without any.

        ``segments`` and ``pose`` have shape (r,); ``loops`` is whether the gears may have hysteresis.
        """
        parts: dict[int, list[tuple[int, Segment]]] = {}
        for row, each in enumerate(segments):
            if each is not None:
                parts.setdefault(id(each.uniform_velocity), []).append((row, each))
        angles, rises, jerks, steps, starts = [], [], [], [], []
        times: list[Floats] = []
        poses, torques, rows, count = [], [], [], 0
        for members in parts.values():
            own = [each for _, each in members]
            T, end = own[0].interval_s, max(each.end for each in own)
            step = 1 / (
                (_STEPS_OF_LOOPS if loops else _STEPS)
                * max(each.highest / each.duration_s for each in own)
            )
            time, grid = np.arange(end) * T, np.arange(0, (end - 0.5) * T, step)
            edges = [np.array([each.begin, each.end]) * T for each in own]
            spans = [np.searchsorted(grid, edge).tolist() for edge in edges]
            used = np.zeros(grid.size, bool)
            for first, last in spans:
                used[max(first - round(_LEAD * (last - first)), 0) : last] = True
            starts.append(np.diff(used.astype(int), prepend=0)[used] > 0)
            starts[-1][1:] |= starts[-1][:-1]
            angle = CubicSpline(time, own[0].uniform_velocity[:, :end], axis=1).antiderivative()(grid)
            rise = np.zeros(angle.shape)
            rise[:, 2:] = np.diff(angle, 2, axis=1)
            jerk = np.zeros(angle.shape)
            jerk[:, 2:] = np.gradient(rise[:, 2:], axis=1)
            angles.append((angle - angle.mean(axis=1, keepdims=True))[:, used])
            rises.append(rise[:, used])
            jerks.append(jerk[:, used])
            times.append(grid[used] + (times[-1][-1] + _PAUSE_S if times else 0.0))
            steps.append(np.full(used.sum(), step))
            # Held torques are on average those of the samples before and after.
            torque = own[0].torque[:, :end]
            if own[0].held:
                torque = 0.5 * (torque + np.concatenate([torque[:, :1], torque[:, :-1]], axis=1))
            torques.append(CubicSpline(time, torque, axis=1)(grid[used]))
            poses.append(np.full(used.sum(), pose[members[0][0]]))
            places = count + np.cumsum(used) - 1
            for (row, each), (first, last) in zip(members, spans, strict=True):
                turn = (grid[first:last] - each.begin * T) / each.duration_s
                inner = waves_at(grid[:_BLOCK] / each.duration_s, each.highest).T
                outer = waves_at(turn[::_BLOCK], each.highest).T * (2j * step / each.duration_s)
                span = slice(places[first], places[last - 1] + 1)
                rows.append((row, span, np.ascontiguousarray(inner), outer))
            count += int(used.sum())
        if not rows:
            return None
        return cls(
            np.concatenate(angles, axis=1), np.concatenate(rises, axis=1),
            np.concatenate(jerks, axis=1), np.concatenate(times), np.concatenate(steps),
            np.concatenate(starts),
            np.concatenate(poses), np.concatenate(torques, axis=1), tuple(rows),
        )  # fmt: skip

    def part(self, used: slice | np.ndarray) -> MotorMotion:
        """Motion in some steps."""
        starts = self.starts[used].copy()
        starts[:2] = True
        own = self.angle[:, used], self.rise[:, used], self.jerk[:, used]
        steps = self.time_s[used], self.step_s[used], starts, self.pose[used]
        return MotorMotion(*own, *steps, self.torque[:, used], ())

    def balance(self, scale: Floats, M: Floats, viscous: Floats, coulomb: Floats) -> Floats:
        """Torque through the gears, shape (n, N), by parameters of the motors, each (n,)."""
        velocity = np.gradient(self.angle, axis=1) / self.step_s
        begins = np.flatnonzero(self.starts)[2::2]  # the parts before them end elsewhere
        velocity[:, begins], velocity[:, begins - 1] = velocity[:, begins + 1], velocity[:, begins - 2]
        middle = np.roll(self.rise, -1, axis=1)
        middle = np.where(self.starts, np.roll(middle, -1, axis=1), middle) / self.step_s**2
        own = scale[:, None] * self.torque - M[:, None] * middle
        return np.asarray(own - viscous[:, None] * velocity - coulomb[:, None] * np.sign(velocity))

    def flanks(self, M: Floats, shape: tuple[int, int]) -> Complexes:
        """Bins of the flank in contact, 1 or -1, by the torque; between flanks it changes uniformly."""
        none = np.zeros(len(M))
        torque = self.balance(np.ones(len(M)), M, none, none)
        for own in torque:
            loaded = np.flatnonzero(np.abs(own) > _LOADED * np.abs(own).max())
            own[:] = np.interp(np.arange(own.size), loaded, np.sign(own[loaded]))
        return self.bins(torque, shape)

    def bins(self, samples: Floats, shape: tuple[int, int]) -> Complexes:
        """Phasors of samples (..., N) in the first H bins of each of r segments, (r, H, ...)."""
        found = np.zeros((*shape, samples[..., 0].size), complex)
        rows = samples.reshape(-1, samples.shape[-1])
        for row, used, inner, outer in self.rows:
            blocks = np.zeros((len(rows), len(outer) * len(inner)))
            blocks[:, : used.stop - used.start] = rows[:, used]
            # Real products take half the time.
            parts = (blocks.reshape(-1, len(inner)) @ inner.view(float)).view(complex)
            parts = parts.reshape(len(rows), *outer.shape)
            found[row, : outer.shape[1]] = np.einsum("cbh,bh->hc", parts, outer)
        return found.reshape(*shape, *samples.shape[:-1])


def each(matrices: Floats, rows: Floats, pose: np.ndarray) -> Floats:
    """Rows (..., n, k) times the matrices (p, ..., n, n) of their poses."""
    found = matrices[0] @ rows
    for p in range(1, len(matrices)):
        found[..., pose == p] = (matrices[p] @ rows)[..., pose == p]
    return np.asarray(found)
