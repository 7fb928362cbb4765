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


@dataclass(frozen=True, eq=False)
class MotorMotion:
    """Motion of n motors in N steps; the parts of the records without a gap follow each other."""

    angle: Floats
    """Less its mean in each part, shape (n, N), rad."""
    rise: Floats
    """Its second differences, shape (n, N), rad."""
    jerk: Floats
    """Central differences of ``rise`` at its middle, shape (n, N), rad."""
    step_s: Floats
    """Shape (N,), s."""
    starts: np.ndarray
    """Whether a step is one of the first two of a part, shape (N,)."""
    pose: np.ndarray
    """Index of the pose in every step, shape (N,)."""
    torque: Floats
    """Torque of the motors, shape (n, N), N·m."""
    rows: Sequence[tuple[int, slice, Complexes]]
    """Row and steps of every segment, and the matrix from their samples to its bins, (steps, H). Steps
    that begin or end beside those of the samples differ by terms of the ends."""

    @classmethod
    def of(cls, segments: Iterable[Segment | None], pose: np.ndarray, loops: bool) -> MotorMotion | None:
        """Motion up to the last of the segments of each part; None without any.

        ``segments`` and ``pose`` have shape (r,); ``loops`` is whether the gears may have hysteresis.
        """
        parts: dict[int, list[tuple[int, Segment]]] = {}
        for row, each in enumerate(segments):
            if each is not None:
                parts.setdefault(id(each.uniform_velocity), []).append((row, each))
        angles, rises, jerks, steps, starts = [], [], [], [], []
        poses, torques, rows, count = [], [], [], 0
        for members in parts.values():
            own = [each for _, each in members]
            T, end = own[0].interval_s, max(each.end for each in own)
            step = 1 / (
                (_STEPS_OF_LOOPS if loops else _STEPS)
                * max(each.highest / each.duration_s for each in own)
            )
            time, grid = np.arange(end) * T, np.arange(0, (end - 0.5) * T, step)
            angle = CubicSpline(time, own[0].uniform_velocity[:, :end], axis=1).antiderivative()(grid)
            rise = np.zeros(angle.shape)
            rise[:, 2:] = np.diff(angle, 2, axis=1)
            angles.append(angle - angle.mean(axis=1, keepdims=True))
            rises.append(rise)
            jerks.append(np.zeros(angle.shape))
            jerks[-1][:, 2:] = np.gradient(rise[:, 2:], axis=1)
            steps.append(np.full(grid.size, step))
            starts.append(np.arange(grid.size) < 2)
            # Held torques are on average those of the samples before and after.
            torque = own[0].torque[:, :end]
            if own[0].held:
                torque = 0.5 * (torque + np.concatenate([torque[:, :1], torque[:, :-1]], axis=1))
            torques.append(CubicSpline(time, torque, axis=1)(grid))
            poses.append(np.full(grid.size, pose[members[0][0]]))
            for row, each in members:
                first, last = np.searchsorted(grid, np.array([each.begin, each.end]) * T).tolist()
                turn = (grid[first:last] - each.begin * T) / each.duration_s
                bins = np.ascontiguousarray(waves_at(turn, each.highest).T)
                bins *= 2j * step / each.duration_s
                rows.append((row, slice(count + first, count + last), bins))
            count += grid.size
        if not rows:
            return None
        return cls(
            np.concatenate(angles, axis=1), np.concatenate(rises, axis=1),
            np.concatenate(jerks, axis=1), np.concatenate(steps), np.concatenate(starts),
            np.concatenate(poses), np.concatenate(torques, axis=1), tuple(rows),
        )  # fmt: skip

    def part(self, used: slice) -> MotorMotion:
        """Motion in some steps."""
        starts = self.starts[used].copy()
        starts[:2] = True
        own = self.angle[:, used], self.rise[:, used], self.jerk[:, used], self.step_s[used]
        return MotorMotion(*own, starts, self.pose[used], self.torque[:, used], ())

    def balance(self, scale: Floats, M: Floats, viscous: Floats, coulomb: Floats) -> Floats:
        """Torque through the gears, shape (n, N), by parameters of the motors, each (n,)."""
        velocity = np.gradient(self.angle, axis=1) / self.step_s
        middle = np.roll(self.rise, -1, axis=1)
        middle = np.where(self.starts, np.roll(middle, -1, axis=1), middle) / self.step_s**2
        own = scale[:, None] * self.torque - M[:, None] * middle
        return np.asarray(own - viscous[:, None] * velocity - coulomb[:, None] * np.sign(velocity))

    def bins(self, samples: Floats, shape: tuple[int, int]) -> Complexes:
        """Phasors of samples (..., N) in the first H bins of each of r segments, (r, H, ...)."""
        found = np.zeros((*shape, samples[..., 0].size), complex)
        rows = samples.reshape(-1, samples.shape[-1])
        for row, used, waves in self.rows:  # real products take half the time
            found[row, : waves.shape[1]] = (rows[:, used] @ waves.view(float)).view(complex).T
        return found.reshape(*shape, *samples.shape[:-1])


def each(matrices: Floats, rows: Floats, pose: np.ndarray) -> Floats:
    """Rows (..., n, k) times the matrices (p, ..., n, n) of their poses."""
    found = matrices[0] @ rows
    for p in range(1, len(matrices)):
        found[..., pose == p] = (matrices[p] @ rows)[..., pose == p]
    return np.asarray(found)
