"""Terms of the two ends of a motion's segment in the residual, and further terms of its bins.

Over a finite time the motors and the arm differ at the ends in angle and velocity. In the residual
that is a polynomial in s with real coefficients at each motor, and X A⁻¹ times one of degree 1 from the
arm. Samples add terms of higher degree, and a linear drift of a logged torque one of degree −1. The
coefficients are eliminated like free friction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.phasors.extract import Phasors
from jointid.phasors.segment import Segment, bins_of

_DEGREES = (0, 1, 2, 3, -1)
"""Degrees of the terms at the motors, those of the arm first. Up to 1, the Fourier integral is exact, up
to 3 that of samples; −1 is a drift of the torque, for instance of a sensor that warms up."""
_ROWS = 150
"""Complex equations in a group of bins that share a misfit."""


@dataclass(frozen=True, eq=False)
class EndTerms:
    """Polynomials of the m rows that are segments of motion records."""

    records: np.ndarray
    """Rows, shape (m,)."""
    logs: np.ndarray
    """Motion record of each of them, shape (m,)."""
    powers: Complexes
    """Powers of s over its largest value, with the factor i of phasors, shape (m, H, degrees)."""

    @classmethod
    def of(cls, phasors: Phasors, s: Complexes) -> EndTerms | None:
        """Terms of the rows of phasors that are segments; None without any."""
        records = np.flatnonzero(phasors.motion)
        if not records.size:
            return None
        own = [each for each in phasors.segments if each is not None]
        highest, logs = np.array([(each.highest, each.record) for each in own]).T
        unit = s[records] / np.abs(s[records, highest - 1])[:, None]
        return cls(records, logs, 1j * unit[..., None] ** np.array(_DEGREES))

    def columns(self, arm: Complexes) -> Complexes:
        """Columns (m, H, n, k) for the response X A⁻¹ of the motors to the arm, (r, H, n, n).

        The 2n of the arm come first.
        """
        m, H, degrees = self.powers.shape
        n = arm.shape[2]
        of_arm = arm[self.records][..., None] * self.powers[:, :, None, None, :2]
        of_motor = np.eye(n)[:, :, None] * self.powers[:, :, None, None]
        return np.concatenate(
            [of_arm.reshape(m, H, n, 2 * n), of_motor.reshape(m, H, n, n * degrees)], axis=3
        )

    def on_arm(self, sizes: Floats, n: int) -> Complexes:
        """Torque at the arm of its terms with sizes (r, 2n), shape (r, H, n)."""
        torque = np.zeros((len(sizes), self.powers.shape[1], n), complex)
        each = sizes[self.records].reshape(-1, n, 2)
        torque[self.records] = np.einsum("mhd,mjd->mhj", self.powers[..., :2], each)
        return torque


def motor_motion(phasors: Phasors) -> Complexes | None:
    """Bins of velocity and acceleration without the ends' terms, shape (2, r, H, n); None of sines."""
    if not phasors.motion.any():
        return None
    r, H, _ = phasors.harmonics.shape
    found = np.zeros((2, r, H, phasors.n), complex)
    for row, segment in enumerate(phasors.segments):
        if segment is not None:
            used = slice(segment.lowest - 1, segment.highest)
            found[0, row, used] = bins_of(segment.velocity, segment.highest).T[used]
            found[1, row, used] = _acceleration(segment, segment.highest)[used]
    return found


def _acceleration(segment: Segment, bins: int) -> Complexes:
    """First bins of the motors' acceleration, shape (bins, n)."""
    rise = np.gradient(segment.velocity, segment.interval_s, axis=1)
    # A central difference is too small by the sine of ωT over ωT.
    turn = 2 * np.arange(1, bins + 1) / segment.samples
    return np.asarray(bins_of(rise, bins).T / np.sinc(turn)[:, None])


def row_groups(phasors: Phasors, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Group of each row (r, H): a sine's harmonic, or a band of a motion's bins.

    Also which groups the misfit of the fundamental comes from, shape (G,).
    """
    r, H = known.shape
    group = np.tile(np.arange(H), (r, 1))
    motion = phasors.motion
    if motion.any():
        frequency = (phasors.omega[:, None] * np.arange(1, H + 1))[motion]
        used = known[motion]
        count = max(1, int(used.sum() * phasors.n) // _ROWS)
        edges = np.quantile(frequency[used], np.linspace(0, 1, count + 1)[1:-1])
        group[motion] = H + np.searchsorted(edges, frequency)
        if motion.all():
            group -= H
            return group, np.ones(count, bool)
    numbers = np.arange(group.max() + 1)
    return group, (numbers == 0) | (numbers >= H)
