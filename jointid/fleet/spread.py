"""Spread, outliers and drift of a fleet's values.

All statistics are robust (medians): a few broken robots or bad studies must not mask themselves.
"""

import datetime
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, median_abs_deviation, t, theilslopes

from jointid.analysis import USABLE, WITH_CARE
from jointid.arrays import Floats
from jointid.fleet.row import Row

OUTLIER_Z = 4.0
"""An outlier is more than this many expected distances from the centre."""
MIN_VALUES = 5
"""Fewest values for a spread or a drift."""

_THEIL_SEN = float(np.sqrt(np.pi / 3))
"""Standard error of the Theil-Sen slope over that of least squares, for normal errors."""
_MAX_PAIRED = 300  # most values of which all pairs are formed; of more, an evenly spaced selection
_YEAR_S = 365.25 * 86400.0


@dataclass(frozen=True, eq=False)
class Spread:
    """One quantity of one joint over m studies of a fleet."""

    name: str
    """Quantity and joint, as in "K1"."""
    rows: tuple[Row, ...]
    """Studies with this quantity."""
    value: Floats
    """Shape (m,), N·m/rad or N·m·s/rad."""
    error: Floats
    """One standard error, shape (m,)."""
    median: float
    """NaN without values."""
    spread: float
    """1.4826 times the median absolute deviation from the median; NaN below ``MIN_VALUES`` values."""
    centre: Floats
    """Reference of each value, shape (m,): the median of the fleet or of its robot."""
    z: Floats
    """Distance from the centre over its expected value, shape (m,); NaN below ``MIN_VALUES`` values."""

    @property
    def outliers(self) -> np.ndarray:
        """Mask of the outliers, shape (m,)."""
        return np.asarray(np.abs(self.z) > OUTLIER_Z)


def fleet_spread(
    rows: Sequence[Row], quantity: str, joint: int, *, within_robot: bool = False
) -> Spread:
    """Return the spread and the outliers of one quantity ("K" or "D") of a joint, from 1, over a fleet.

    The expected distance from the centre is √(s² + e²): s is the robust spread of the compared values, e
    the value's own standard error. Neither the fleet's variation nor an uncertain study makes outliers.
    Studies are compared with the whole fleet, or with those of the same robot. Rows without a usable
    answer, with fewer joints or without a finite value are skipped.
    """
    having = tuple(row for row in rows if _has(row, quantity, joint))
    value, error = _of_joint(having, quantity, joint), _of_joint(having, f"{quantity}_error", joint)
    keys = np.array([row.robot if within_robot else "" for row in having], dtype=object)
    centre, scale = np.full(value.size, np.nan), np.full(value.size, np.nan)
    for key in set(keys):
        same = keys == key
        centre[same] = np.median(value[same])
        scale[same] = robust_spread(value[same])
    expected = np.hypot(scale, error)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(value == centre, 0.0 * scale, (value - centre) / expected)
    median = float(np.median(value)) if value.size else float("nan")
    spread = robust_spread(value)
    return Spread(f"{quantity}{joint}", having, value, error, median, spread, centre, z)


def _has(row: Row, quantity: str, joint: int) -> bool:
    if row.state not in (USABLE, WITH_CARE) or len(getattr(row, quantity)) < joint:
        return False
    both = (getattr(row, name)[joint - 1] for name in (quantity, f"{quantity}_error"))
    return all(np.isfinite(value) for value in both)


def _of_joint(rows: Sequence[Row], quantity: str, joint: int) -> Floats:
    return np.array([getattr(row, quantity)[joint - 1] for row in rows])


def robust_spread(values: Floats) -> float:
    """Return 1.4826 times the median absolute deviation, NaN below ``MIN_VALUES`` values.

    It estimates the standard deviation of normal values; up to half of them may be outliers.
    """
    few = values.size < MIN_VALUES
    return float("nan") if few else float(median_abs_deviation(values, scale="normal"))


def few_values(values: Floats, errors: Floats) -> tuple[float, float, float, float]:
    """Return the scatter of two or more values, with their standard errors, too few for a robust spread.

    These are the standard deviation s of the values, the lower and upper 95 % limit of the true one
    (normal values, (m − 1) s²/σ² ~ χ²), and the scatter over the stated errors, about 1 for values that
    agree.
    """
    left = values.size - 1
    deviation = float(values.std(ddof=1))
    low, high = deviation * np.sqrt(left / chi2.ppf([0.975, 0.025], left))
    weight = 1 / np.maximum(errors, 1e-300) ** 2
    mean = (weight * values).sum() / weight.sum()
    scatter = float(np.sqrt((weight * (values - mean) ** 2).sum() / left))
    return deviation, float(low), float(high), scatter


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
    """Median of the slopes between all pairs (Theil and Sen); NaN below ``MIN_VALUES`` times."""
    slope_error_per_s: float
    """Standard error of the slope, from the scatter around the line."""
    level: float
    """Value of the line at the median time."""
    p_value: float
    """Probability of such a slope, or a larger one, of a robot without drift; NaN without a slope."""

    @property
    def per_year(self) -> tuple[float, float]:
        """Relative change per year, and its standard error."""
        scale = _YEAR_S / abs(self.level) if self.level else float("nan")
        return self.slope_per_s * scale, self.slope_error_per_s * scale

    def line(self) -> Floats:
        """The line at the times of the values, shape (m,)."""
        return self.level + self.slope_per_s * (self.time_s - np.median(self.time_s))


def robot_drift(rows: Sequence[Row], quantity: str, joint: int, robot: str) -> Drift:
    """Return the drift of "K" or "D" of a joint, from 1, of one robot over its studies' dates.

    Rows of other robots, without a usable answer or without a date are skipped.
    """
    of_robot = (row for row in rows if row.robot == robot and row.date and _has(row, quantity, joint))
    having = sorted(of_robot, key=lambda row: (seconds(row.date), row.study))
    time = np.array([seconds(row.date) for row in having])
    value = _of_joint(having, quantity, joint)
    error = _of_joint(having, f"{quantity}_error", joint)
    line = _theil_sen(time, value, error)
    return Drift(f"{quantity}{joint}", robot, time, value, error, tuple(having), *line)


def seconds(date: str) -> float:
    """Return a row's date as seconds since 1970; without an offset it is UTC.

    Raises ValueError when it is not ISO 8601.
    """
    at = datetime.datetime.fromisoformat(date)
    return (at if at.tzinfo else at.replace(tzinfo=datetime.UTC)).timestamp()


def _theil_sen(time: Floats, value: Floats, error: Floats) -> tuple[float, float, float, float]:
    """Slope, its standard error, the value at the median time, and the p-value of the slope.

    The scatter is that of the values which are no outliers from the line: the median distance of a few
    values is often far too small by chance.
    """
    if np.unique(time).size < MIN_VALUES:
        level = float(np.median(value)) if value.size else float("nan")
        return float("nan"), float("nan"), level, float("nan")
    pick = np.unique(np.linspace(0, time.size - 1, min(time.size, _MAX_PAIRED)).round().astype(int))
    x, v = time[pick] - np.median(time), value[pick]
    with np.errstate(invalid="ignore"):  # in its interval, not used here, where values repeat
        slope = float(theilslopes(v, x).slope)
    level = float(np.median(v - slope * x))
    rest = v - slope * x - level
    kept = np.abs(rest) <= OUTLIER_Z * np.hypot(robust_spread(rest), error[pick])
    left = max(int(kept.sum()) - 2, 1)
    scatter = np.sqrt(np.sum(rest[kept] ** 2) / left)
    slope_error = float(_THEIL_SEN * scatter / np.sqrt(np.sum((x[kept] - x[kept].mean()) ** 2)))
    p_value = float(2 * t.sf(abs(slope) / slope_error, left)) if slope_error else float(slope == 0)
    return slope, slope_error, level, p_value
