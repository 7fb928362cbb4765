"""How a fleet's values are spread, which of them stand out, and how they drift.

Medians throughout: a few robots that are broken, or studies that went wrong, must not hide themselves.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats
from jointid.fleet.row import Row

OUTSTANDING = 4.0
"""A value stands out when it lies this many times its expected distance from the median."""
LEAST = 5
"""Fewer values than this tell no spread."""

_NORMAL = 1.4826  # median absolute deviation to standard deviation, for a normal distribution
_THEIL_SEN = float(np.sqrt(np.pi / 3))  # its standard error over that of least squares, likewise
_MOST_PAIRED = 300
_YEAR_S = 365.25 * 86400.0


@dataclass(frozen=True, eq=False)
class Spread:
    """One quantity of one joint over m studies of a fleet."""

    name: str
    """Such as "K1"."""
    rows: tuple[Row, ...]
    """The studies that have it."""
    value: Floats
    """Shape (m,), N·m/rad or N·m·s/rad."""
    error: Floats
    """One standard error, shape (m,)."""
    median: float
    """NaN without any value."""
    spread: float
    """1.4826 times the median absolute deviation from the median; NaN below ``LEAST`` values."""
    centre: Floats
    """What each value is compared with, shape (m,): the fleet's median, or its robot's."""
    z: Floats
    """Distance from the centre over what is expected, shape (m,); NaN where too few are compared."""

    @property
    def outstanding(self) -> np.ndarray:
        """Which values stand out, shape (m,)."""
        return np.asarray(np.abs(self.z) > OUTSTANDING)


def fleet_spread(
    rows: Sequence[Row], quantity: str, joint: int, *, within_robot: bool = False
) -> Spread:
    """Say how one quantity is spread over a fleet, and which values stand out.

    The expected distance from the centre is √(s² + e²): s is the robust spread of the values that are
    compared, e the value's own standard error. So neither a fleet that varies nor a study that knows
    little makes a value stand out.

    Parameters
    ----------
    rows : sequence of Row
        Those without an answer, with fewer joints, or with a value that is not finite are passed over.
    quantity : {"K", "D"}
    joint : int
        From 1.
    within_robot : bool, default False
        Compare every study with those of the same robot rather than with the whole fleet.
    """
    having = tuple(row for row in rows if _has(row, quantity, joint))
    value = np.array([getattr(row, quantity)[joint - 1] for row in having])
    error = np.array([getattr(row, f"{quantity}_error")[joint - 1] for row in having])
    keys = np.array([row.robot if within_robot else "" for row in having], dtype=object)
    centre, scale = np.full(value.size, np.nan), np.full(value.size, np.nan)
    for key in set(keys):
        same = keys == key
        centre[same] = np.median(value[same])
        scale[same] = robust_spread(value[same])
    expected = np.hypot(scale, error)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(value == centre, 0.0 * scale, (value - centre) / expected)
    return Spread(
        name=f"{quantity}{joint}",
        rows=having,
        value=value,
        error=error,
        median=float(np.median(value)) if value.size else float("nan"),
        spread=robust_spread(value),
        centre=centre,
        z=z,
    )


def _has(row: Row, quantity: str, joint: int) -> bool:
    if not row.is_good or len(getattr(row, quantity)) < joint:
        return False
    both = (getattr(row, name)[joint - 1] for name in (quantity, f"{quantity}_error"))
    return all(np.isfinite(value) for value in both)


def robust_spread(values: Floats) -> float:
    """Return 1.4826 times the median absolute deviation, NaN below ``LEAST`` values.

    For normally distributed values it is their standard deviation; up to half of them may be anything.
    """
    if values.size < LEAST:
        return float("nan")
    return float(_NORMAL * np.median(np.abs(values - np.median(values))))


@dataclass(frozen=True, eq=False)
class Drift:
    """One quantity of one joint of one robot over time."""

    name: str
    robot: str
    time_s: Floats
    """Seconds since 1970, ascending, shape (m,)."""
    value: Floats
    error: Floats
    rows: tuple[Row, ...]
    slope_per_s: float
    """Median of the slopes between all pairs (Theil and Sen); NaN below ``LEAST`` times."""
    slope_error_per_s: float
    """Its standard error from the scatter around the line."""
    level: float
    """Value of the line at the median time."""

    @property
    def per_year(self) -> tuple[float, float]:
        """Change per year over the level, and its standard error."""
        scale = _YEAR_S / abs(self.level) if self.level else float("nan")
        return self.slope_per_s * scale, self.slope_error_per_s * scale

    def line(self) -> Floats:
        """The line at the times of the values, shape (m,)."""
        return self.level + self.slope_per_s * (self.time_s - np.median(self.time_s))


def robot_drift(rows: Sequence[Row], quantity: str, joint: int, robot: str) -> Drift:
    """Follow a quantity of one robot over the dates that its studies state.

    Parameters
    ----------
    rows : sequence of Row
        Those without a date, with an error, or of other robots are passed over.
    quantity : {"K", "D"}
    joint : int
        From 1.
    robot : str
    """
    having = [
        (seconds(row.date), row)
        for row in rows
        if row.robot == robot and row.date and _has(row, quantity, joint)
    ]
    having.sort(key=lambda pair: (pair[0], pair[1].study))
    time = np.array([at for at, _ in having])
    value = np.array([getattr(row, quantity)[joint - 1] for _, row in having])
    error = np.array([getattr(row, f"{quantity}_error")[joint - 1] for _, row in having])
    slope, slope_error, level = _theil_sen(time, value)
    return Drift(
        name=f"{quantity}{joint}",
        robot=robot,
        time_s=time,
        value=value,
        error=error,
        rows=tuple(row for _, row in having),
        slope_per_s=slope,
        slope_error_per_s=slope_error,
        level=level,
    )


def seconds(date: str) -> float:
    """Return a row's date as seconds since 1970; what states no offset counts as UTC.

    Raises
    ------
    ValueError
        When it is not ISO 8601.
    """
    at = datetime.datetime.fromisoformat(date)
    return (at if at.tzinfo else at.replace(tzinfo=datetime.UTC)).timestamp()


def _theil_sen(time: Floats, value: Floats) -> tuple[float, float, float]:
    """Slope, its standard error, and the value at the median time."""
    if np.unique(time).size < LEAST:
        return float("nan"), float("nan"), float(np.median(value)) if value.size else float("nan")
    # Of very many values, some that are spread evenly say the same.
    pick = np.unique(np.linspace(0, time.size - 1, min(time.size, _MOST_PAIRED)).round().astype(int))
    t, v = time[pick] - np.median(time), value[pick]
    i, j = np.triu_indices(t.size, 1)
    apart = t[j] != t[i]
    slope = float(np.median((v[j] - v[i])[apart] / (t[j] - t[i])[apart]))
    level = float(np.median(v - slope * t))
    scatter = _NORMAL * float(np.median(np.abs(v - slope * t - level)))
    scatter *= np.sqrt(t.size / (t.size - 2))
    return slope, float(_THEIL_SEN * scatter / np.sqrt(np.sum((t - t.mean()) ** 2))), level
