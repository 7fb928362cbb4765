"""Start of the steady state of a record, by the settling test of the phasors."""

from dataclasses import replace

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.phasors.extract import Phasors, extract_phasors
from jointid.phasors.long_records import LongRecord
from jointid.records import SineRecord

_CANDIDATES = 32
"""Number of candidate starts, whole periods apart."""
_REMAINING = 5.0
"""Fewest remaining periods, besides a quarter of the record."""
_SIGNIFICANT = 3.0
"""Standard errors of a significant change."""
_NEGLIGIBLE = 2e-3
"""Relative change of the phasor that never counts as settling."""
_CHANCE = 1e-3
"""Probability that some signal of steady records seems to settle."""


def unsettled(phasors: Phasors) -> Floats:
    """Relative change from the first quarter to the second half, shape (r,); 0 where it is no settling.

    A change counts if it is above five standard errors, and more where there are many tests, and one per
    cent of the joint's largest amplitude at the same frequency: the residual motion of a held joint is
    no evidence.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        rounding = 2 * phasors.harmonic_rounding[:, 0] / np.abs(phasors.z) ** 2  # of both parts
        significance = phasors.settling / np.sqrt(phasors.settling_noise**2 + rounding)
    periods = np.round(phasors.omega * phasors.duration_s / (2 * np.pi))
    # A short record has a block per period, and its noise is not estimated from their scatter.
    blocks = np.minimum(phasors.degrees_of_freedom + 1, np.maximum(periods, 1.0))[:, None]
    left = np.maximum(np.ceil(blocks / 2) - 1, 1)  # degrees of freedom of the second half's scatter
    chance = (1 + significance**2 / left) ** -left * significance.size
    clear = (significance > 5) & (chance < _CHANCE)
    moving = np.nan_to_num(np.where(clear, phasors.settling * joint_share(phasors), 0.0)).max(axis=1)
    return np.asarray(np.where(moving > 0.01, moving, 0.0))


def joint_share(phasors: Phasors) -> Floats:
    """Amplitudes over the joint's largest at the same frequency, shape (r, 2n)."""
    size, largest = np.abs(phasors.z), np.zeros(phasors.z.shape)
    for _, group in phasors.by_frequency():
        largest[group] = size[group].max(axis=0)
    return np.divide(size, largest, out=np.zeros_like(size), where=largest > 0)


def steady_from(record: SineRecord) -> float | None:
    """Return the start of the steady state on the record's own clock, s.

    The settling test, first quarter against second half, is applied to the rest of the record after each
    candidate. The result is the first candidate at which this and the next test are within the noise,
    rounded up to a tenth of a period or finer. None if the motion does not become steady while a quarter
    of the record and five periods remain, or if the record is larger than memory.
    """
    if isinstance(record, LongRecord):
        return None
    begin, period = float(record.time_s[record.start]), 1 / record.frequency_hz
    most = int(min(0.75 * record.periods, record.periods - _REMAINING))
    if most < 2:
        return None
    starts = begin + period * np.unique(np.linspace(0, most, _CANDIDATES).round())
    try:
        phasors = extract_phasors([replace(record, start_s=float(t)) for t in starts], harmonics=1)
    except JointIdError:
        return None
    change, noise = phasors.settling, phasors.settling_noise
    clear = change > np.maximum(_SIGNIFICANT * noise, _NEGLIGIBLE)
    # A change in proportion to the remaining length is a drift of the whole record, no settling.
    left = phasors.duration_s[:, None] / phasors.duration_s[0]
    goes_on = (change > np.maximum(0.5 * left * change[0], _NEGLIGIBLE)) & clear[0]
    steady = np.asarray(~(clear | goes_on).any(axis=1) & np.isfinite(change).all(axis=1))
    both = np.flatnonzero(steady[1:-1] & steady[2:])
    if both.size == 0:
        return None
    digits = decimals(record)
    return float(np.ceil(starts[both[0] + 1] * 10**digits - 1e-6) / 10**digits)


def decimals(record: SineRecord) -> int:
    """Decimals of a start of this record."""
    return max(0, int(np.ceil(np.log10(10 * record.frequency_hz))))
