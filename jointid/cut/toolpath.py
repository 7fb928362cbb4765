"""Tool paths as smooth time laws: each piece carries the velocity vector from one value to the next.

Within a piece of duration T, v(t) = v_a + (v_b − v_a) S(t/T) with the smoothstep of order seven,
S(x) = 35x⁴ − 84x⁵ + 70x⁶ − 20x⁷. Three of its derivatives vanish at both ends, so position, velocity,
acceleration, jerk and snap are continuous along the path, which the feedforward of an elastic arm needs.
A cruise has v_a = v_b, a ramp v_a ∥ v_b, and a corner turns from one side's direction to the next's.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from jointid.arrays import Floats, finite_array
from jointid.errors import JointIdError
from jointid.wording import counted

_STEP = Polynomial([0, 0, 0, 0, 35, -84, 70, -20])
_STEEPEST = 35 / 16
"""Largest slope of the smoothstep, at its middle."""
_REACHED = 0.9
"""Share of the cutting speed that the tool must reach on some side."""
_SMALLEST_ZONE_M = 1e-9
_REST_M_S = 1e-12
_CHORDS = 400
"""Chords of the outline in a corner; in a zone of 10 mm they stay within 0.1 µm of the curve."""


@dataclass(frozen=True, eq=False)
class Toolpath:
    """A path in the plane with its time law, from rest to rest.

    Parameters
    ----------
    start_m : array_like, shape (2,)
        Where the tool starts, m.
    velocity_m_s : array_like, shape (m + 1, 2)
        Velocity vectors at the knots between the m pieces, m/s; the first and the last are zero.
    duration_s : array_like, shape (m,)
        Duration of each piece, s.

    Raises
    ------
    JointIdError
        When the shapes disagree, a duration is not positive, or the path does not begin and end at rest.
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
    top_speed_m_s: float = field(init=False)
    """Largest speed, m/s."""
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
                f"duration_s of piece {piece + 1} is {duration[piece]:g} s: must be positive."
            )
        if velocity[0].any() or velocity[-1].any():
            raise JointIdError("velocity_m_s must be zero at the first and the last knot: rest to rest.")
        time = np.concatenate([[0.0], np.cumsum(duration)])
        moves = 0.5 * (velocity[:-1] + velocity[1:]) * duration[:, None]
        knot = start + np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
        change = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
        values = {
            "start_m": start,
            "velocity_m_s": velocity,
            "duration_s": duration,
            "time_s": finite_array("time_s", time, ndim=1),
            "knot_m": finite_array("knot_m", knot, ndim=2),
            "top_speed_m_s": float(np.linalg.norm(velocity, axis=1).max()),
            "peak_acceleration_m_s2": float((_STEEPEST * change / duration).max()),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def end_s(self) -> float:
        """Duration of the whole path, s."""
        return float(self.time_s[-1])

    def derivatives(self, time_s: ArrayLike) -> Floats:
        """Position, velocity, acceleration, jerk and snap.

        Parameters
        ----------
        time_s : array_like, shape (k,)
            Times, s; before the start and after the end the tool rests.

        Returns
        -------
        ndarray, shape (5, k, 2)
            Time derivatives 0 to 4 of the tool position, m/s^order.
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
        """Wanted tool position, shape (k, 2), m."""
        return np.asarray(self.derivatives(time_s)[0])

    def distance(self, point_m: ArrayLike) -> Floats:
        """Distance of each point from the nearest point of the whole path, its contour error.

        Parameters
        ----------
        point_m : array_like, shape (..., 2)
            Points, m.

        Returns
        -------
        ndarray, shape (...)
            Distances, m.
        """
        point = np.asarray(point_m, dtype=np.float64)
        flat = point.reshape(-1, 2)
        turning = self._turning()
        closest = np.full(len(flat), np.inf)
        sides = np.stack([self.knot_m[:-1], self.knot_m[1:]], axis=1)[~turning]
        # Repetitions run over the same sides; nanometres tell two sides apart.
        _, first = np.unique(np.round(sides, 9), axis=0, return_index=True)
        for start, end in sides[first]:
            np.minimum(closest, _segment_distance(flat, start, end), out=closest)
        if turning.any():
            share = np.linspace(0.0, 1.0, _CHORDS + 1)
            times = self.time_s[:-1][turning, None] + share * self.duration_s[turning, None]
            chords = self.position(times.ravel())
            _, vertex = cKDTree(chords).query(flat)
            # From one corner's last vertex to the next corner's first the path is straight: a chord too.
            for neighbour in (vertex - 1, vertex + 1):
                other = np.clip(neighbour, 0, len(chords) - 1)
                np.minimum(closest, _segment_distance(flat, chords[vertex], chords[other]), out=closest)
        return closest.reshape(point.shape[:-1])

    def corners(self) -> tuple[Floats, Floats, Floats]:
        """Return the corners of the path: where the straight sides before and after would meet.

        Returns
        -------
        point_m : ndarray, shape (c, 2)
            Corner points, m.
        ahead : ndarray, shape (c, 2)
            Unit vector of the side that ends there; beyond the corner along it lies the overshoot.
        span_s : ndarray, shape (c, 2)
            From the beginning of the corner to the beginning of the next one, or the path's end, s.
        """
        before = self.velocity_m_s[:-1]
        turning = np.flatnonzero(self._turning())
        # A piece moves by T/2 (v_a + v_b), so its two tangents meet T/2 v_a from its start.
        point = self.knot_m[turning] + 0.5 * before[turning] * self.duration_s[turning, None]
        ahead = before[turning] / np.linalg.norm(before[turning], axis=1, keepdims=True)
        begins = self.time_s[turning]
        span = np.stack([begins, np.append(begins[1:], self.end_s)[: begins.size]], axis=1)
        return point, ahead, span

    def _turning(self) -> np.ndarray:
        """Which pieces change direction, shape (m,)."""
        before, after = self.velocity_m_s[:-1], self.velocity_m_s[1:]
        cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        size = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        return np.asarray((np.abs(cross) > 1e-6 * size) & (size > _REST_M_S**2))


def rectangle(
    *,
    width_m: float = 0.028,
    height_m: float = 0.045,
    speed_m_s: float = 0.3,
    zone_m: float = 0.010,
    acceleration_m_s2: float = 15.0,
    shortest_ramp_s: float = 0.050,
    centre_m: ArrayLike = (1.15, 0.0),
    angle_rad: float = 0.0,
    repetitions: int = 1,
    settle_s: float = 0.1,
) -> Toolpath:
    """Rectangle with rounded corners, counter-clockwise: the paper's Figure 7 (28 × 45 mm at 300 mm/s).

    The tool starts at rest on the line of a longer side, is up to speed in the middle of that side, goes
    round, and slows down past the same middle. A corner begins ``zone_m`` before the corner point, ends
    as far behind it, and takes 2 zone / speed. A small zone is passed more slowly, so that neither the
    acceleration limit nor the shortest ramp is violated, and the sides then ramp up and down. On a side
    too short for its ramps the tool goes as fast as they allow.

    Parameters
    ----------
    width_m, height_m : float
        Sides along x and y, before turning by ``angle_rad``, m.
    speed_m_s : float
        Cutting speed, m/s.
    zone_m : float
        Corner zone, m; 0 stops in each corner.
    acceleration_m_s2 : float
        Largest acceleration, m/s².
    shortest_ramp_s : float
        Shortest time for a change of velocity, s.
    centre_m : array_like, shape (2,)
        Centre of the rectangle, m.
    angle_rad : float
        Turn of the rectangle about its centre, rad.
    repetitions : int
        How many times round.
    settle_s : float
        Rest after the end, s; shows what still swings.

    Raises
    ------
    JointIdError
        When a value is out of range, the zone does not fit the shorter side, or no side lets the tool
        come within 10 % of the speed; the message says what would do.
    """
    values = {
        "width_m": (width_m, "m"),
        "height_m": (height_m, "m"),
        "speed_m_s": (speed_m_s, "m/s"),
        "acceleration_m_s2": (acceleration_m_s2, "m/s²"),
        "shortest_ramp_s": (shortest_ramp_s, "s"),
        "settle_s": (settle_s, "s"),
        "zone_m": (zone_m, "m"),
    }
    for name, (value, unit) in values.items():
        number = float(finite_array(f"{name} ({unit})", value, ndim=0))
        if number < 0 or (number == 0 and name not in ("zone_m", "settle_s")):
            rule = "not be negative" if name in ("zone_m", "settle_s") else "be positive"
            raise JointIdError(f"{name} = {number:g} {unit}: it must {rule}.")
    centre = finite_array("centre_m (m)", centre_m, ndim=1)
    angle = float(finite_array("angle_rad (rad)", angle_rad, ndim=0))
    if centre.shape != (2,):
        raise JointIdError(f"centre_m has {counted(centre.size, 'value')}: give x and y in m.")
    if isinstance(repetitions, bool) or not isinstance(repetitions, int | np.integer) or repetitions < 1:
        raise JointIdError(f"repetitions = {repetitions!r}: give a whole number of rounds, at least 1.")
    if zone_m > min(width_m, height_m) / 2:
        raise JointIdError(
            f"zone_m = {zone_m:g} m does not fit: two zones share the shorter side of "
            f"{min(width_m, height_m):g} m. Use a zone of at most {min(width_m, height_m) / 2:g} m or a "
            "longer side."
        )
    zone_m = zone_m if zone_m > _SMALLEST_ZONE_M else 0.0
    limits = _Limits(speed_m_s, acceleration_m_s2, shortest_ramp_s)
    corner = limits.corner_speed(zone_m)
    # Counter-clockwise from the longer side, where the lead-in has more room.
    first = 0 if width_m >= height_m else 1
    straights = [(width_m, height_m)[(first + side) % 2] - 2 * zone_m for side in range(4)]
    peaks = [limits.peak_speed(corner, length) for length in straights]
    if max(peaks) < _REACHED * speed_m_s:
        raise JointIdError(
            f"speed_m_s = {speed_m_s:g} m/s is not reached: zones of {zone_m:g} m are passed at "
            f"{corner:.3g} m/s, and {acceleration_m_s2:g} m/s² and ramps of {shortest_ramp_s:g} s allow "
            f"{max(peaks):.3g} m/s on the longest straight, {max(straights):.3g} m. Lower speed_m_s to "
            f"{np.floor(max(peaks) * 1e4) / 1e4:g} m/s, or enlarge the sides or acceleration_m_s2."
        )
    turn = angle + (first + np.arange(5)) * np.pi / 2
    directions = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    lead = limits.ramp_time(peaks[0])
    pieces: list[tuple[float, Floats]] = [(lead, peaks[0] * directions[0])]
    for _ in range(int(repetitions)):
        # A round begins and ends in the middle of the first side.
        half = 0.5 * limits.cruise_time(peaks[0], corner, straights[0])
        pieces.append((half, peaks[0] * directions[0]))
        for side, (ahead, following) in enumerate(pairwise(directions)):
            peak, rise = peaks[side], peaks[(side + 1) % 4]
            if side > 0:
                pieces.append((limits.cruise_time(peak, corner, straights[side]), peak * ahead))
            if peak > corner:
                pieces.append((limits.ramp_time(peak - corner), corner * ahead))
            if corner > 0:
                pieces.append((2 * zone_m / corner, corner * following))
            if rise > corner:
                pieces.append((limits.ramp_time(rise - corner), rise * following))
        pieces.append((half, peaks[0] * directions[0]))
    pieces += [(lead, np.zeros(2)), (settle_s, np.zeros(2))]
    pieces = [piece for piece in pieces if piece[0] > 0]
    # The first side lies half the other side's length to the right of the centre, seen along it.
    middle = centre - 0.5 * (height_m, width_m)[first] * directions[1]
    return Toolpath(
        start_m=middle - 0.5 * lead * peaks[0] * directions[0],
        velocity_m_s=np.array([np.zeros(2), *(velocity for _, velocity in pieces)]),
        duration_s=np.array([duration for duration, _ in pieces]),
    )


@dataclass(frozen=True)
class _Limits:
    """What bounds a change of velocity: speed, acceleration, and the shortest ramp."""

    speed: float
    acceleration: float
    shortest: float

    def ramp_time(self, change: float) -> float:
        """Duration of a straight ramp by ``change`` m/s."""
        return max(self.shortest, _STEEPEST * change / self.acceleration)

    def corner_speed(self, zone: float) -> float:
        """Highest speed at which a right-angled corner of this zone keeps the limits."""
        by_acceleration = np.sqrt(self.acceleration * 2 * zone / (_STEEPEST * np.sqrt(2)))
        return float(min(self.speed, by_acceleration, 2 * zone / self.shortest))

    def peak_speed(self, corner: float, length: float) -> float:
        """Highest speed on a straight between two corners: up and down again within its length."""
        slow = length / self.shortest - corner
        fast = np.sqrt(corner**2 + length * self.acceleration / _STEEPEST)
        # Where the shortest ramp binds, the acceleration does not, and the other way round.
        return float(np.clip(min(slow, fast), corner, self.speed))

    def cruise_time(self, peak: float, corner: float, length: float) -> float:
        """Time at the peak speed on a straight, between its two ramps."""
        if peak > corner:
            length -= (peak + corner) * self.ramp_time(peak - corner)
        return length / peak if length > 1e-12 else 0.0


def _segment_distance(point: Floats, start: Floats, end: Floats) -> Floats:
    """Distance of each point (k, 2) from a segment, or each from its own, shape (k,)."""
    along = end - start
    length2 = np.asarray((along * along).sum(axis=-1))
    offset = point - start
    share = (offset * along).sum(axis=-1) / np.where(length2 > 0, length2, 1.0)
    apart = offset - np.clip(share, 0.0, 1.0)[:, None] * along
    return np.asarray(np.hypot(apart[:, 0], apart[:, 1]))
