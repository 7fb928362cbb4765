"""From which time on a record is steady: the first start after which its beginning is like its end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jointid.errors import JointIdError
from jointid.phasors.extract import extract_phasors
from jointid.phasors.long_records import LongRecord
from jointid.records import SineRecord

_TRIED = 32
"""Starts that are tried, whole periods apart."""
_LEFT = 5.0
"""Periods that must be left, and a quarter of the record."""
_BY_CHANCE = 3.0  # standard errors
_NOTHING = 2e-3
"""A change of the phasor by this share is no settling that matters, whatever the noise."""


def steady_from(record: SineRecord) -> float | None:
    """Return a start on the record's own clock, s, from which on it is steady.

    The same measure as of the record as a whole, first quarter against second half, is taken of what
    is left after each start; the first start after which this and the next are within the noise holds.

    Parameters
    ----------
    record : SineRecord

    Returns
    -------
    float or None
        Rounded up to a tenth of a period or finer. None where it cannot be told: the motion does not
        become steady as long as a quarter of the record and five periods are left, or the record is
        larger than memory.
    """
    if isinstance(record, LongRecord):
        return None
    begin, period = float(record.time_s[record.start]), 1 / record.frequency_hz
    most = int(min(0.75 * record.periods, record.periods - _LEFT))
    if most < 2:
        return None
    starts = begin + period * np.unique(np.linspace(0, most, _TRIED).round())
    try:
        phasors = extract_phasors([replace(record, start_s=float(t)) for t in starts], harmonics=1)
    except JointIdError:
        return None
    change, noise = phasors.settling, phasors.settling_noise
    clear = change > np.maximum(_BY_CHANCE * noise, _NOTHING)
    # A change that goes on for the whole record shrinks with what is left of it: that is no settling.
    left = phasors.duration_s[:, None] / phasors.duration_s[0]
    goes_on = (change > np.maximum(0.5 * left * change[0], _NOTHING)) & clear[0]
    steady = np.asarray(~(clear | goes_on).any(axis=1) & np.isfinite(change).all(axis=1))
    both = np.flatnonzero(steady[1:-1] & steady[2:])
    if both.size == 0:
        return None
    digits = decimals(record)
    return float(np.ceil(starts[both[0] + 1] * 10**digits - 1e-6) / 10**digits)


def decimals(record: SineRecord) -> int:
    """Digits after the point with which a start of this record is told."""
    return max(0, int(np.ceil(np.log10(10 * record.frequency_hz))))
