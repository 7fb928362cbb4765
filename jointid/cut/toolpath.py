"""Tool paths with smooth time laws: each piece changes the velocity vector from one value to the next.

Within a piece of duration T, v(t) = v_a + (v_b − v_a) S(t/T) with the smoothstep of order seven,
S(x) = 35x⁴ − 84x⁵ + 70x⁶ − 20x⁷. Three of its derivatives vanish at both ends, so position, velocity,
acceleration, jerk and snap are continuous, as the feedforward of an elastic arm requires.
A cruise has v_a = v_b, a ramp v_a ∥ v_b, and a corner turns from one side's direction to the next's.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from jointid.arrays import Floats, finite_array, set_fields
from jointid.errors import JointIdError

_STEP = Polynomial([0, 0, 0, 0, 35, -84, 70, -20])
STEEPEST = 35 / 16
"""Largest slope of the smoothstep, at its middle."""
_REST_M_S = 1e-12
"""Speed below which the tool is at rest, m/s."""
_CHORDS = 400
"""Chords of the outline in a corner; in a zone of 10 mm they stay within 0.1 µm of the curve."""


@dataclass(frozen=True, eq=False)
class Toolpath:
    """A path in the plane with its time law, from rest to rest.

    Takes array_like values. Raises JointIdError when the shapes disagree, a duration is not positive, or
    the path does not begin and end at rest.
    """

    start_m: Floats
    """Start of the path, shape (2,), m."""
    velocity_m_s: Floats
    """Velocity at the knots, shape (m + 1, 2), m/s."""
    duration_s: Floats
    """Duration of the pieces, shape (m,), s."""
    time_s: Floats = field(init=False, repr=False)
    """Times of the knots, shape (m + 1,), s."""
    knot_m: Floats = field(init=False, repr=False)
    """Positions of the knots, shape (m + 1, 2), m."""
    peak_acceleration_m_s2: float = field(init=False)
    """Largest acceleration, m/s²."""

    def __post_init__(self) -> None:
        start = finite_array("start_m", self.start_m, ndim=1)
        velocity = finite_array("velocity_m_s", self.velocity_m_s, ndim=2)
        duration = finite_array("duration_s", self.duration_s, ndim=1)
        if start.shape != (2,) or velocity.shape != (duration.size + 1, 2) or duration.size == 0:
            raise JointIdError(
                f"start_m, velocity_m_s and duration_s have shapes {start.shape}, {velocity.shape} and "
                f"{duration.shape}: expected (2,), (m + 1, 2) and (m,) for a path of m pieces."
            )
        if duration.min() <= 0:
            piece = int(np.argmin(duration))
            raise JointIdError(
                f"duration_s of piece {piece + 1} is {duration[piece]:g} s: it must be positive."
            )
        if velocity[0].any() or velocity[-1].any():
            raise JointIdError("velocity_m_s must be zero at the first and the last knot: rest to rest.")
        time = np.concatenate([[0.0], np.cumsum(duration)])
        moves = 0.5 * (velocity[:-1] + velocity[1:]) * duration[:, None]
        knot = start + np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
        change = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
        set_fields(
            self,
            start_m=start,
            velocity_m_s=velocity,
            duration_s=duration,
            time_s=finite_array("time_s", time, ndim=1),
            knot_m=finite_array("knot_m", knot, ndim=2),
            peak_acceleration_m_s2=float((STEEPEST * change / duration).max()),
        )

    @property
    def end_s(self) -> float:
        """Duration of the whole path, s."""
        return float(self.time_s[-1])

    def derivatives(self, time_s: ArrayLike) -> Floats:
        """Position, velocity, acceleration, jerk and snap at times (k,): shape (5, k, 2), m/s^order.

        Before the start and after the end the tool rests.
        """
        time = np.clip(finite_array("time_s", np.atleast_1d(time_s), ndim=1), 0.0, self.end_s)
        piece = np.clip(
            np.searchsorted(self.time_s, time, side="right") - 1, 0, self.duration_s.size - 1
        )
        T = self.duration_s[piece]
        x = (time - self.time_s[piece]) / T
        before = self.velocity_m_s[piece]
        change = self.velocity_m_s[piece + 1] - before
        result = np.empty((5, time.size, 2))
        for order in range(5):
            # Derivative 0 integrates the step, derivative 1 is the step itself.
            shape = _STEP.integ() if order == 0 else _STEP.deriv(order - 1) if order > 1 else _STEP
            result[order] = change * (shape(x) * T ** (1 - order))[:, None]
        result[0] += self.knot_m[piece] + before * (x * T)[:, None]
        result[1] += before
        return result

    def position(self, time_s: ArrayLike) -> Floats:
        """Reference tool position, shape (k, 2), m."""
        return np.asarray(self.derivatives(time_s)[0])

    def distance(self, point_m: ArrayLike) -> Floats:
        """Distance of points (..., 2) from the nearest point of the path: contour error (...), m."""
        point = np.asarray(point_m, dtype=np.float64)
        x, y = np.ascontiguousarray(point.reshape(-1, 2).T)
        turning = self._turning()
        closest = np.full(x.size, np.inf)  # squared
        sides = np.stack([self.knot_m[:-1], self.knot_m[1:]], axis=1)[~turning]
        # Repetitions have the same sides; sides that differ by less than nanometres are equal.
        _, first = np.unique(np.round(sides, 9), axis=0, return_index=True)
        for start, end in sides[first]:
            np.minimum(closest, _squared_distance(x, y, start, end), out=closest)
        if turning.any():
            share = np.linspace(0.0, 1.0, _CHORDS + 1)
            times = self.time_s[:-1][turning, None] + share * self.duration_s[turning, None]
            chords = self.position(times.ravel())
            _, vertex = cKDTree(chords).query(np.stack([x, y], axis=1))
            # Between two corners the path is straight: a chord as well.
            for neighbour in (vertex - 1, vertex + 1):
                other = np.clip(neighbour, 0, len(chords) - 1)
                near = _squared_distance(x, y, chords[vertex].T, chords[other].T)
                np.minimum(closest, near, out=closest)
        return np.asarray(np.sqrt(closest).reshape(point.shape[:-1]))

    def _turning(self) -> np.ndarray:
        """Mask of the pieces that change direction, shape (m,)."""
        before, after = self.velocity_m_s[:-1], self.velocity_m_s[1:]
        cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        size = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        return np.asarray((np.abs(cross) > 1e-6 * size) & (size > _REST_M_S**2))


def _squared_distance(x: Floats, y: Floats, start: Floats, end: Floats) -> Floats:
    """Squared distance of each point, (k,) and (k,), from a segment, (2,), or its own, (2, k); m²."""
    along_x, along_y = end - start
    length2 = along_x * along_x + along_y * along_y
    off_x, off_y = x - start[0], y - start[1]
    share = (off_x * along_x + off_y * along_y) / np.where(length2 > 0, length2, 1.0)
    share = np.minimum(np.maximum(share, 0.0), 1.0)
    off_x -= share * along_x
    off_y -= share * along_y
    return np.asarray(off_x * off_x + off_y * off_y)
