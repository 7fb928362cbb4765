"""Motion of the rotors between the samples of a held torque.

A torque that is held from sample to sample, for T, acts at its images s + 2πik/T as well as at s. The
rotor follows them, and sampled that motion appears at s: relative to the torque at s over the rotor
inertia it is s/(s + 2πik/T)³, where the torque acts without delay. At a tenth of the sample rate that is
0.1 % of the rotor's angle, at a sixth 1 %, and a delay turns it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.parameters import Parameters

_ORDERS = np.array([1, -1, 2, -2, 3, -3])
"""k of the images. Without the further ones and without the gear, their sum is exact to 2 to 4 %."""


@dataclass(frozen=True, eq=False)
class HeldTorque:
    """Images of r records with H harmonics at K orders."""

    hold_s: Floats
    """Time for which each torque is held, 0 where it is not, shape (r, 1, 1), s."""
    s: Complexes
    """s of each image, shape (K, r, H, 1)."""
    response: Complexes
    """Angle per torque over rotor inertia, without delay, shape (K, r, H, 1), s²."""
    per_turn_s: Floats
    """Delay that turns the image by 2π, shape (K, r, 1, 1), s."""
    delay_s: Floats
    """Known delay, shape (r, 1, 1), s."""

    @classmethod
    def of(cls, s: Complexes, hold_s: Floats, delay_s: Floats) -> HeldTorque:
        """Images of records at s, shape (r, H), with hold and delay of shape (r,).

        Of no order where no torque is held.
        """
        hold = hold_s[:, None, None]
        orders = _ORDERS if hold.any() else _ORDERS[:0]
        T = np.where(hold > 0, hold, 1.0)
        per_turn = T / orders[:, None, None, None]
        image = s[..., None] + 2j * np.pi / per_turn
        seen = (hold > 0) & (np.abs(s[..., None]) * T < np.pi)
        response = np.divide(s[..., None], image**3, out=np.zeros_like(image), where=seen)
        return cls(hold, image, response, per_turn, delay_s[:, None, None])

    def images(self, p: Parameters, s: Complexes) -> Complexes:
        """Angle by the images per acting torque over rotor inertia, shape (r, H, n), s².

        ``s`` has the shape (r, H, 1).
        """
        late = self.delay_s + p.delay + p.effect("lag")
        passed = self.response * np.exp(-2j * np.pi * late / self.per_turn_s)
        for name in ("torque_filter", "position_filter"):
            if name in p.layout:
                T = np.maximum(p[name], 0)  # a negative one filters the log of the torque only
                passed = passed * ((1 + s * T if name == "torque_filter" else 1) / (1 + self.s * T))
        return np.asarray(passed.sum(axis=0))

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
