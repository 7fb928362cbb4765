"""The rectangle of the paper's Figure 7, as fast as corners and ramps allow."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, bounded_number, finite_array, whole_number
from jointid.cut.toolpath import STEEPEST, Toolpath
from jointid.errors import JointIdError
from jointid.wording import counted

_REACHED = 0.9
"""Share of the cutting speed that the tool must reach on some side."""
_SHORTEST_RAMP_S = 0.050
"""Shortest time for a change of velocity."""
_SMALLEST_ZONE_M = 1e-9
"""Zones below this stop in the corner, m."""


def rectangle(
    *,
    width_m: float = 0.028,
    height_m: float = 0.045,
    speed_m_s: float = 0.3,
    zone_m: float = 0.010,
    acceleration_m_s2: float = 15.0,
    centre_m: ArrayLike = (1.15, 0.0),
    angle_rad: float = 0.0,
    repetitions: int = 1,
    settle_s: float = 0.1,
) -> Toolpath:
    """Rectangle with rounded corners, counter-clockwise: the paper's Figure 7 (28 × 45 mm at 300 mm/s).

    The tool starts at rest on the line of a longer side, reaches the speed in the middle of that side,
    goes round, and slows down beyond the same point. A corner begins ``zone_m`` before the corner point,
    ends as far behind it, and takes 2 zone / speed. A small zone is passed more slowly, so that neither
    the acceleration limit nor the shortest ramp is violated, and the sides then ramp up and down. On a
    side too short for its ramps the tool moves as fast as the ramps permit.

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
    centre_m : array_like, shape (2,)
        Centre of the rectangle, m.
    angle_rad : float
        Rotation of the rectangle about its centre, rad.
    repetitions : int
        Number of passes.
    settle_s : float
        Rest after the end, which shows residual vibration, s.

    Returns
    -------
    Toolpath
        Tool motion in time, m and s.

    Raises
    ------
    JointIdError
        When a value is out of range, the zone does not fit the shorter side, or no side allows 90 % of
        the speed; the message gives possible values.
    """
    values = {
        "width_m": (width_m, "m"),
        "height_m": (height_m, "m"),
        "speed_m_s": (speed_m_s, "m/s"),
        "acceleration_m_s2": (acceleration_m_s2, "m/s²"),
        "settle_s": (settle_s, "s"),
        "zone_m": (zone_m, "m"),
    }
    for name, (value, unit) in values.items():
        bounded_number(name, unit, value, zero=name in ("zone_m", "settle_s"))
    centre = finite_array("centre_m (m)", centre_m, ndim=1)
    angle = float(finite_array("angle_rad (rad)", angle_rad, ndim=0))
    if centre.shape != (2,):
        raise JointIdError(f"centre_m has {counted(centre.size, 'value')}: give x and y in m.")
    repetitions = whole_number("repetitions", repetitions, 1)
    if zone_m > min(width_m, height_m) / 2:
        raise JointIdError(
            f"A corner zone of {1e3 * zone_m:g} mm does not fit: two zones share the shorter side of "
            f"{1e3 * min(width_m, height_m):g} mm. Use a zone of at most "
            f"{500 * min(width_m, height_m):g} mm or a longer side."
        )
    zone_m = zone_m if zone_m > _SMALLEST_ZONE_M else 0.0
    limits = _Limits(speed_m_s, acceleration_m_s2)
    corner = limits.corner_speed(zone_m)
    # Counter-clockwise from the longer side, where the lead-in has more room.
    first = 0 if width_m >= height_m else 1
    straights = [(width_m, height_m)[(first + side) % 2] - 2 * zone_m for side in range(4)]
    peaks = [limits.peak_speed(corner, length) for length in straights]
    if max(peaks) < _REACHED * speed_m_s:
        raise JointIdError(
            f"A speed of {1e3 * speed_m_s:g} mm/s is not reached: zones of {1e3 * zone_m:g} mm are "
            f"passed at {1e3 * corner:.3g} mm/s, and {acceleration_m_s2:g} m/s² and ramps of "
            f"{_SHORTEST_RAMP_S:g} s allow {1e3 * max(peaks):.3g} mm/s on the longest straight, "
            f"{1e3 * max(straights):.3g} mm. Lower the speed to {np.floor(max(peaks) * 1e4) / 10:g} "
            "mm/s, or increase the side lengths or the acceleration."
        )
    turn = angle + (first + np.arange(5)) * np.pi / 2
    directions = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    lead = limits.ramp_time(peaks[0])
    pieces: list[tuple[float, Floats]] = [(lead, peaks[0] * directions[0])]
    for _ in range(repetitions):
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
    speed: float
    acceleration: float

    def ramp_time(self, change: float) -> float:
        """Duration of a straight ramp by ``change`` m/s."""
        return max(_SHORTEST_RAMP_S, STEEPEST * change / self.acceleration)

    def corner_speed(self, zone: float) -> float:
        """Highest speed at which a right-angled corner of this zone keeps the limits."""
        by_acceleration = np.sqrt(self.acceleration * 2 * zone / (STEEPEST * np.sqrt(2)))
        return float(min(self.speed, by_acceleration, 2 * zone / _SHORTEST_RAMP_S))

    def peak_speed(self, corner: float, length: float) -> float:
        """Highest speed on a straight between two corners, with a ramp up and down."""
        slow = length / _SHORTEST_RAMP_S - corner
        fast = np.sqrt(corner**2 + length * self.acceleration / STEEPEST)
        # Where the shortest ramp binds, the acceleration does not, and the other way round.
        return float(np.clip(min(slow, fast), corner, self.speed))

    def cruise_time(self, peak: float, corner: float, length: float) -> float:
        """Time at the peak speed on a straight, between its two ramps."""
        if peak > corner:
            length -= (peak + corner) * self.ramp_time(peak - corner)
        return length / peak if length > 1e-12 else 0.0
