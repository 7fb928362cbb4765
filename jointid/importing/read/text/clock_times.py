"""Times of day, with or without dates, converted to seconds from the first."""

import datetime
import re
import unicodedata
from contextlib import suppress

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError

_DAY_S = 86400.0
_MAX_PAUSE_S = 3600.0  # longest pause of a log that continues over a change of date
_MONTHS = {
    name: month
    for month, line in enumerate(
        (
            "jan january januar janvier enero ene gennaio gen",
            "feb february februar fevrier febrero febbraio fev",
            "mar march marz maerz mrz mars marzo",
            "apr april avril abril abr aprile avr",
            "may mai mayo maggio mag",
            "jun june juni juin junio giugno giu",
            "jul july juli juillet julio luglio lug",
            "aug august aout agosto ago",
            "sep sept september septembre septiembre settembre set",
            "oct october oktober okt octobre octubre ottobre ott",
            "nov november novembre noviembre",
            "dec december dezember dez decembre diciembre dic dicembre",
        ),
        start=1,
    )
    for name in line.split()
}
_DATE = (
    r"\d{4}[-./]\d{1,2}[-./]\d{1,2}|\d{1,2}(?P<mark>[-./])\d{1,2}(?P=mark)(?:\d{4}|\d{2})"
    r"|\d{1,2}[-. /]{1,2}[^\W\d]{3,9}[-. /]{1,2}(?:\d{4}|\d{2})"
)
_CLOCK = re.compile(
    rf"(?:(?P<date>{_DATE})(?:[T_]|[ ,;-]+))?"
    r"(?P<hours>\d{1,2}):(?P<minutes>\d\d):(?P<seconds>\d\d(?:[.,:]\d{1,9})?)"
    r"(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?(?: ?(?:Z|UTC|[+-]\d\d:?\d\d))?"
)
_SECONDS = {"ms": 1e-3, "s": 1.0, "sec": 1.0, "min": 60.0, "hr": 3600.0}
_DURATION = re.compile(rf"(-?\d+(?:[.,]\d+)?) ({'|'.join(_SECONDS)})")  # as MATLAB writes them


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day, "07.05.2026 09:00:00,123", or a duration, "0.004 sec"."""
    return len(cell) <= 64 and bool(_CLOCK.fullmatch(cell) or _DURATION.fullmatch(cell))


class ClockCells:
    """Reads one column of times, cell by cell; ``place`` names column and file in messages."""

    def __init__(self, place: str) -> None:
        self._place = place
        self._dates: dict[str, int] = {}
        self._codes: list[int] = []

    def read(self, cell: str) -> float | None:
        """Return the seconds of the day, None for other text. Call for every row."""
        found = _CLOCK.fullmatch(cell) if len(cell) <= 64 else None
        self._codes.append(-1)
        if found is None:
            length = _DURATION.fullmatch(cell) if len(cell) <= 64 else None
            return float(length[1].replace(",", ".")) * _SECONDS[length[2]] if length else None
        hours = int(found["hours"])
        if found["half"]:
            hours = hours % 12 + 12 * (found["half"] in "Pp")
        self._codes[-1] = self._dates.setdefault(found["date"] or "", len(self._dates))
        seconds = float(re.sub("[,:]", ".", found["seconds"]))
        return hours * 3600.0 + int(found["minutes"]) * 60.0 + seconds

    def seconds(self, of_day: Floats) -> tuple[Floats, str]:
        """Return seconds from the first row, for all rows read, and a note or "".

        Raises JointIdError when the log spans dates of ambiguous order.
        """
        dates = [date for date in self._dates if date]
        note = ""
        if len(dates) > 1:
            days, note = self._days(dates, of_day)
            by_code = np.array([days.get(date, np.nan) for date in self._dates])
            of_day = of_day + _DAY_S * np.append(by_code, np.nan)[self._codes]
        known = of_day[np.isfinite(of_day)]
        return (of_day - known[0] if known.size else of_day), note

    def _days(self, dates: list[str], of_day: Floats) -> tuple[dict[str, int], str]:
        """Day number of each date, by the only valid order or the one that makes the log continuous."""
        readings: dict[str, dict[str, int]] = {}
        for order in ("day.month.year", "month.day.year"):
            with suppress(ValueError, KeyError):  # no date of a calendar
                days = [_day_number(date, order) for date in dates]
                readings[order] = {date: day - days[0] for date, day in zip(dates, days, strict=True)}
        distinct = list({tuple(days.values()): order for order, days in readings.items()}.values())
        continuous = [order for order in distinct if self._is_continuous(readings[order], of_day)]
        if len(distinct) == 1:
            return readings[distinct[0]], ""
        if len(continuous) == 1:
            return readings[continuous[0]], (
                f'{self._place}: the dates are read as {continuous[0]} ("{dates[0]}", "{dates[1]}"), '
                "because only this order gives a log without gaps."
            )
        if not distinct:
            raise JointIdError(
                f'{self._place}: "{dates[0]}" and "{dates[1]}" are not both dates of a calendar. Export '
                "the time in seconds, or as 2026-05-07 09:00:00.123."
            )
        raise JointIdError(
            f'{self._place}: the log spans the dates "{dates[0]}" and "{dates[1]}", which may have '
            "the day or the month first, and it pauses between them. Export the dates as 2026-05-07, or "
            "cut the log between the two."
        )

    def _is_continuous(self, days: dict[str, int], of_day: Floats) -> bool:
        codes = np.asarray(self._codes)
        at = np.array([days.get(date, 0) for date in self._dates])
        total = (of_day + _DAY_S * np.append(at, 0)[codes])[codes >= 0]
        changes = np.flatnonzero(np.diff(codes[codes >= 0]))
        pauses = np.diff(total)[changes]
        return bool(np.all((pauses > -_MAX_PAUSE_S) & (pauses < _MAX_PAUSE_S)))


def _day_number(date: str, order: str) -> int:
    """Proleptic day number; ValueError or KeyError for an invalid date."""
    parts = [part for part in re.split(r"[-./ ]+", date) if part]
    if len(parts[0]) == 4:
        year, month, day = parts
    elif not parts[1].isdigit() or order.startswith("day"):
        day, month, year = parts
    else:
        month, day, year = parts
    full = int(year) + (2000 if len(year) == 2 else 0)
    if not month.isdigit():
        plain = unicodedata.normalize("NFKD", month.lower())
        month = str(_MONTHS["".join(c for c in plain if not unicodedata.combining(c))])
    return datetime.date(full, int(month), int(day)).toordinal()
