"""Times of day, with or without dates, converted to seconds from the first."""

import re

import numpy as np

from jointid.arrays import Floats

_DAY_S = 86400.0
_DATE = (
    r"\d{4}[-./]\d{1,2}[-./]\d{1,2}|\d{1,2}(?P<mark>[-./])\d{1,2}(?P=mark)(?:\d{4}|\d{2})"
    r"|\d{1,2}[-. /]{1,2}[^\W\d]{3,9}[-. /]{1,2}(?:\d{4}|\d{2})"
)
_CLOCK = re.compile(
    rf"(?:(?P<date>{_DATE})(?:[T_]|[ ,;-]+))?"
    r"(?P<hours>\d{1,2}):(?P<minutes>\d\d):(?P<seconds>\d\d(?:[.,:]\d{1,9})?)"
    r"(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?(?: ?(?:Z|UTC|[+-]\d\d:?\d\d))?"
)
_COMPACT = re.compile(  # 20260507T090000.123; without a T it needs the fraction, unlike a counter
    r"(?P<date>(?:19|20)\d\d(?:0[1-9]|1[0-2])(?:0[1-9]|[12]\d|3[01]))(?P<mark>[T_])?"
    r"(?P<hours>[01]\d|2[0-3])(?P<minutes>[0-5]\d)(?P<seconds>[0-5]\d(?(mark)(?:[.,]\d{1,9})?|[.,]\d{1,9}))"
    r"Z?"
)
_SECONDS = {"ms": 1e-3, "s": 1.0, "sec": 1.0, "min": 60.0, "hr": 3600.0}
_DURATION = re.compile(rf"(-?\d+(?:[.,]\d+)?) ({'|'.join(_SECONDS)})")  # as MATLAB writes them


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day, "07.05.2026 09:00:00,123", or a duration, "0.004 sec"."""
    return len(cell) <= 64 and bool(_time_of_day(cell) or _DURATION.fullmatch(cell))


def _time_of_day(cell: str) -> re.Match[str] | None:
    return _CLOCK.fullmatch(cell) or _COMPACT.fullmatch(cell)


class ClockCells:
    """Reads one column of times, cell by cell."""

    def __init__(self) -> None:
        self._dates: dict[str, int] = {}
        self._codes: list[int] = []

    def read(self, cell: str) -> float | None:
        """Return the seconds of the day, None for other text. Call for every row."""
        found = _time_of_day(cell) if len(cell) <= 64 else None
        self._codes.append(0)
        if found is None:
            length = _DURATION.fullmatch(cell) if len(cell) <= 64 else None
            return float(length[1].replace(",", ".")) * _SECONDS[length[2]] if length else None
        hours = int(found["hours"])
        if half := found.groupdict().get("half"):
            hours = hours % 12 + 12 * (half in "Pp")
        self._codes[-1] = self._dates.setdefault(found["date"] or "", len(self._dates))
        seconds = float(re.sub("[,:]", ".", found["seconds"]))
        return hours * 3600.0 + int(found["minutes"]) * 60.0 + seconds

    def seconds(self, of_day: Floats) -> Floats:
        """Return seconds from the first row, for all rows read.

        Every new date counts as the next day, whatever the order of its parts: a log may continue over
        midnight, but a pause of several days is counted as one.
        """
        time = of_day + _DAY_S * np.asarray(self._codes)
        known = time[np.isfinite(time)]
        return np.asarray(time - known[0]) if known.size else time
