"""Motion of the motors between the samples of a held torque.

A torque that is held from sample to sample, for T, acts at its images s_k = s + 2πik/T as well as at s,
with s/s_k of the torque at s. The motors follow them, and sampling aliases this motion to s. A motor is
then a rotor on its gear: at the images the arm hardly moves, and the coupling of the joints is of second
order in it. The images are 0.1 % of the rotor's angle at a tenth of the sample rate, 1 % at a sixth; a
delay rotates them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.parameters import Parameters

_MOST_ORDERS, _LEFT = 8, 1e-6
"""Largest order of the images, and the angle by those of higher order over the rotor's where fewer
suffice; they fall with the fourth power of the order."""


@dataclass(frozen=True, eq=False)
class HeldTorque:
    """Images of r records with H harmonics at K orders."""

    hold_s: Floats
    """Time for which each torque is held, 0 where it is not, shape (r, 1, 1), s."""
    s: Complexes
    """s of each image, shape (K, r, H, 1)."""
    powers: Complexes
    """s over the third to sixth power of s of each image, shape (4, K, r, H, 1); 0 where it has none."""
    per_turn_s: Floats
    """Delay that turns the image by 2π, shape (K, r, 1, 1), s."""
    delay_s: Floats
    """Known delay, shape (r, 1, 1), s."""

    @classmethod
    def of(cls, s: Complexes, hold_s: Floats, delay_s: Floats) -> HeldTorque:
        """Images of records at s, shape (r, H), with hold and delay of shape (r,).

        A torque that is not held has none.
        """
        hold = hold_s[:, None, None]
        turn = np.abs(s[..., None]) * hold
        seen = (hold > 0) & (turn < np.pi)
        largest = float(turn[seen].max(initial=0.0))
        # Of order k, 6 (turn / 2π k)⁴; the sum of those beyond k is its third times k.
        most = np.ceil(np.cbrt(2 * (largest / (2 * np.pi)) ** 4 / _LEFT))
        count = int(min(most, _MOST_ORDERS))
        orders = np.array([sign * k for k in range(1, count + 1) for sign in (1, -1)], float)
        per_turn = np.where(hold > 0, hold, 1.0) / orders[:, None, None, None]
        image = np.where(seen, s[..., None] + 2j * np.pi / per_turn, s[..., None])
        inverse = 1 / image
        third = np.where(seen, s[..., None] * inverse * inverse * inverse, 0)
        powers = np.array([third, third * inverse, third * inverse**2, third * inverse**3])
        return cls(hold, image, powers, per_turn, delay_s[:, None, None])

    @cached_property
    def _sums(self) -> Complexes:
        """Sums of ``powers`` over the orders, shape (4, r, H, 1)."""
        return np.asarray(self.powers.sum(axis=1))

    def images(self, p: Parameters, s: Complexes, rotor: Floats, arm: Floats) -> Complexes:
        """Angle by the images per acting torque, shape (r, H, n), rad/(N·m).

        ``s`` has shape (r, H, 1); ``rotor``, shape (r, n), and ``arm``, shape (r, n, n), are M and M2⁻¹.
        """
        late = self.delay_s + p.delay + p.effect("lag")
        passed = np.exp(-2j * np.pi * late / self.per_turn_s) if np.any(late) else None
        for name in ("torque_filter", "position_filter"):
            if name in p.layout:
                T = np.maximum(p[name], 0)  # a negative one filters the log of the torque only
                gain = (1 + s * T if name == "torque_filter" else 1) / (1 + self.s * T)
                passed = gain if passed is None else passed * gain
        M, own = rotor[:, None], np.diagonal(arm, axis1=1, axis2=2)[:, None]
        # The motor's stiffness over s²M is 1 + a/s + b/s² + c/s³; its inverse is such a series, too.
        coefficients = (
            p.effect("viscous") + p.D,
            p.K - p.D**2 * own,
            p.D**3 * own**2 - 2 * p.K * p.D * own,
        )
        most = 0.5 * np.pi / np.where(self.hold_s > 0, self.hold_s, 1.0)  # half of the slowest image
        a, b, c = (np.clip(x / M, -(most**k), most**k) for k, x in enumerate(coefficients, start=1))
        sums = self._sums if passed is None else (self.powers * passed).sum(axis=1)
        first, second, third, fourth = sums
        found = first - a * second + (a * a - b) * third + (2 * a * b - a**3 - c) * fourth
        return np.asarray(found / M, np.complex128)

    def filter_gain(self, p: Parameters, s: Complexes) -> Complexes:
        """Acting over logged torque by a filter, shape (r, H, n): 1/(1 + sT), or its inverse, T < 0."""
        if "torque_filter" not in p.layout:
            return np.ones_like(s)
        rate, T = self.filter_rate(p, s), p["torque_filter"]
        return np.where(T < 0, 1 - rate * T, 1 / (1 + rate * np.abs(T)))

    def filter_rate(self, p: Parameters, s: Complexes) -> Complexes:
        """Rate of change of a torque by which its filter acts, over the torque, shape (r, H, n).

        That of the acting torque, s. Where the time constant is negative, the log was filtered: of a
        held torque its samples obey a difference equation.
        """
        T = np.where(self.hold_s > 0, self.hold_s, 1.0)
        logged = np.where(self.hold_s > 0, -np.expm1(-s * T) / T, s)
        return np.where(p["torque_filter"] < 0, logged, s)
