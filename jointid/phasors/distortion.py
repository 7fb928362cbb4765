"""Nonlinear distortion against noise in a repeated multisine on odd lines.

Odd nonlinearities, friction among them, appear on odd lines without excitation, even ones on even lines;
noise appears between the lines of a period as well (Pintelon and Schoukens, System Identification, 2nd
ed. 2012, section 4.3).
"""

from typing import NamedTuple

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.records import JointRecord

_ALIKE = 0.9
"""Correlation of the acceleration with itself one period later."""
_EXCITED = 0.1
"""Amplitude of an excited line over the median of the strong ones."""
_HIGHEST = 6
"""Sample rate over the highest line considered."""
_FEWEST = 2
"""Periods in a record."""
_SHORTEST = 16
"""Samples in a period."""


class Distortion(NamedTuple):
    """Root mean square per line over that of the excited lines: angles, then torques, each (2n,)."""

    period_s: float
    even: Floats
    odd: Floats
    noise: Floats


def distortion(record: JointRecord) -> Distortion:
    """Return the levels of distortion and noise in a multisine on odd lines.

    Raises JointIdError when the record is no repeated multisine, or has no empty odd and even lines.
    """
    used = slice(record.start, None)
    signals = np.hstack([record.theta_rad[used], record.tau_Nm[used]])
    period = _period(np.diff(record.theta_rad[used], 2, axis=0) + 0.0)
    repeats = len(signals) // period
    part = signals[: repeats * period] - signals[: repeats * period].mean(axis=0)
    power = np.abs(np.fft.rfft(part, axis=0)) ** 2
    count = period // _HIGHEST  # above, encoder noise exceeds any acceleration
    lines = power[: count * repeats : repeats]
    frequency = np.arange(count)[:, None] ** 4 * lines[:, : record.n]
    strength = np.sqrt((frequency / frequency.max(axis=0)).max(axis=1))
    strong = strength > _EXCITED * np.median(np.sort(strength)[-max(4, count // 50) :])
    excited = np.flatnonzero(strong)
    low, high = int(excited[0]), int(excited[-1])
    inside = np.arange(low, high + 1)
    empty = inside[~strong[inside]]
    even, odd = empty[empty % 2 == 0], empty[empty % 2 == 1]
    if np.mean(excited % 2) < 1 or not even.size or not odd.size:
        raise JointIdError(
            "The record is not a multisine on odd lines with unexcited lines between them."
        )
    between = (inside[:-1, None] * repeats + np.arange(1, repeats)).ravel()
    size = np.sqrt(lines[excited].mean(axis=0))

    def level(rows: Floats) -> Floats:
        return np.asarray(np.sqrt(rows.mean(axis=0)) / size)

    return Distortion(
        period * record.interval_s, level(lines[even]), level(lines[odd]), level(power[between])
    )


def _period(motion: Floats) -> int:
    """Samples of the period with which a motion repeats."""
    samples = len(motion)
    spectrum = np.abs(np.fft.rfft(motion - motion.mean(axis=0), 2 * samples, axis=0)) ** 2
    likeness = np.fft.irfft((spectrum / spectrum.sum(axis=0)).sum(axis=1))[:samples]
    # Fewer products overlap at longer lags.
    likeness = likeness / likeness[0] * samples / (samples - np.arange(samples))
    possible = likeness[_SHORTEST : samples // _FEWEST + 1]
    if not possible.size or possible.max() < _ALIKE:
        raise JointIdError("The record does not repeat: it is not a multisine of several periods.")
    first = _SHORTEST + int(np.argmax(possible > 0.98 * possible.max()))
    return first + int(np.argmax(likeness[first : first + 3]))
