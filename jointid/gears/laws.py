"""Laws of many gears as arrays: torques beyond those of linear springs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats, set_fields
from jointid.gears.gear import Gear, gears_with, knees

_INVERTED, _LEAST_SLOPE = 8, 0.1
"""Newton steps for the deflection under a torque, and the smallest slope in them over K."""


@dataclass(frozen=True, eq=False)
class GearLaws:
    """Springs f = K e + cubic e³ + bends + level z of gears; arrays that broadcast to one shape."""

    K: Floats
    cubic: Floats
    half_backlash: Floats
    level: Floats
    sharpness: Floats
    """Inverse of the presliding deflection; 0 without hysteresis."""
    knees: tuple[Floats, Floats]
    """Deflections at which the slope changes."""
    bends: tuple[Floats, Floats]
    """Changes of the slope there."""

    def __post_init__(self) -> None:
        present = {
            "hardens": self.cubic, "has_backlash": self.half_backlash, "hysteretic": self.level,
            "bent": np.abs(self.bends[0]).max() + np.abs(self.bends[1]).max(),
        }  # fmt: skip
        set_fields(self, **{name: bool(np.any(values)) for name, values in present.items()})

    hardens: bool = False
    has_backlash: bool = False
    hysteretic: bool = False
    bent: bool = False

    @classmethod
    def of(cls, gears: Sequence[Gear], ratio: Floats | float = 1.0, runs: int = 1) -> GearLaws:
        """Laws of n gears, or of each in several runs in turn, seen from behind gear ratios (n,).

        Each array has shape (n, runs).
        """
        joints = len(gears) // runs
        n = np.repeat(np.abs(np.broadcast_to(np.asarray(ratio, float), (joints,))), runs)
        names = ("K", "cubic", "backlash_rad", "hysteresis_Nm", "presliding_rad")
        K, cubic, backlash, level, presliding = np.array([[getattr(g, x) for g in gears] for x in names])
        at, bends = np.moveaxis(np.array([knees(gear) for gear in gears]), 0, -1)
        arm = (n**2 * K, n**4 * cubic, backlash / n, n * level, presliding / n)
        K, cubic, backlash, level, presliding = (v.reshape(joints, runs) for v in arm)
        at, bends = (v.reshape(2, joints, runs) for v in (at / n, n**2 * bends))
        return cls.made(K, cubic, backlash, level, presliding, at, bends)

    @classmethod
    def made(
        cls,
        K: Floats,
        cubic: Floats,
        backlash: Floats,
        level: Floats,
        presliding: Floats,
        at: Sequence[Floats],
        bends: Sequence[Floats],
    ) -> GearLaws:
        """Laws from their parameters, arrays of one shape."""
        sharpness = np.where(level != 0, 1 / np.where(presliding > 0, presliding, 1.0), 0.0)
        return cls(K, cubic, 0.5 * backlash, level, sharpness, (at[0], at[1]), (bends[0], bends[1]))

    @property
    def linear(self) -> GearLaws:
        """The springs K alone."""
        zero = 0 * self.K
        return self.made(self.K, zero, zero, zero, zero, (zero, zero), (zero, zero))

    def smooth(self, delta: Floats) -> Floats:
        """Torque of the cubic stiffness."""
        e = self._beyond_backlash(delta)
        return np.asarray(self.cubic * (e * e * e))  # far faster than a power

    def smooth_slope(self, delta: Floats) -> Floats:
        """Slope of ``smooth``."""
        return np.asarray(3 * self.cubic * self._beyond_backlash(delta) ** 2)

    def kinked(self, delta: Floats) -> Floats:
        """Torque beyond K δ of backlash and changes of slope."""
        torque = -self.K * self._within_backlash(delta)
        if self.bent:
            e = self._beyond_backlash(delta)
            for at, bend in zip(self.knees, self.bends, strict=True):
                torque = torque + bend * _beyond(e, at)
        return np.asarray(torque)

    def kinked_energy(self, delta: Floats) -> Floats:
        """Integral of ``kinked`` over the deflection."""
        part = self._within_backlash(delta)
        energy = -self.K * part * (delta - 0.5 * part)
        if self.bent:
            e = self._beyond_backlash(delta)
            for at, bend in zip(self.knees, self.bends, strict=True):
                energy = energy + 0.5 * bend * _beyond(e, at) ** 2
        return np.asarray(energy)

    def beyond_linear(self, delta: Floats, loop: Floats) -> Floats:
        """Torque in addition to K δ, with the hysteresis in the state ``loop``."""
        return np.asarray(self.smooth(delta) + self.kinked(delta) + self.level * loop)

    def wound(self, delta: Floats, loop: Floats, move: Floats) -> tuple[Floats, Floats]:
        """Torque without damping after a move to a deflection, and its slope."""
        after = self.loop(loop, move) if self.hysteretic else loop
        slope = self.slope(delta) + self.level * self.sharpness * (1 - np.sign(move) * after)
        return self.K * delta + self.beyond_linear(delta, after), np.asarray(slope)

    def slope(self, delta: Floats) -> Floats:
        """Slope of the torque without damping and hysteresis."""
        e = self._beyond_backlash(delta)
        slope = np.where(e == 0, 0.0, self.K) if self.has_backlash else self.K + 0 * e
        for at, bend in zip(self.knees, self.bends, strict=True):
            slope = slope + bend * (np.abs(e) > at)
        return np.asarray(slope + 3 * self.cubic * e * e)

    def deflection(self, torque: Floats) -> Floats:
        """Deflection under a torque without damping and hysteresis, to a few per cent.

        That of a softening gear is at most where its slope has fallen to ``_LEAST_SLOPE``.
        """
        delta = torque / self.K + self.half_backlash * np.sign(torque)
        softens = np.maximum(-3 * self.cubic / self.K, np.finfo(float).tiny)
        most = self.half_backlash + np.sqrt((1 - _LEAST_SLOPE) / softens)
        for _ in range(_INVERTED if self.hardens or self.bent else 0):
            excess = self.K * delta + self.smooth(delta) + self.kinked(delta) - torque
            delta = delta - excess / np.maximum(self.slope(delta), _LEAST_SLOPE * self.K)
            delta = np.clip(delta, -most, most)
        return np.asarray(delta)

    def loop(self, before: Floats, move: Floats) -> Floats:
        """State z of the hysteresis after a move of the deflection in one direction."""
        sign = np.sign(move)
        return np.asarray(sign + (before - sign) * np.exp(-np.abs(move) * self.sharpness))

    def _within_backlash(self, delta: Floats) -> Floats:
        return np.minimum(np.maximum(delta, -self.half_backlash), self.half_backlash)

    def _beyond_backlash(self, delta: Floats) -> Floats:
        return delta - self._within_backlash(delta) if self.has_backlash else delta


def nonlinear_laws(
    K: Floats, gears: Sequence[Gear] | None, ratio: Floats | float = 1.0
) -> GearLaws | None:
    """Laws of gears of stiffness K, (n,) or (n, runs), as ``GearLaws.of``; None where all are linear."""
    if gears is None:
        return None
    of_runs = [gears_with(own, gears) for own in K.reshape(len(K), -1).T]
    whole = [gear for of_joint in zip(*of_runs, strict=True) for gear in of_joint]
    linear = all(gear.laws == ("linear",) for gear in whole)
    return None if linear else GearLaws.of(whole, ratio, len(of_runs))


def _beyond(x: Floats, edge: Floats) -> Floats:
    """Part of x beyond ± edge; np.clip is slower on small arrays."""
    return np.asarray(x - np.minimum(np.maximum(x, -edge), edge))


class GearState:
    """Gears in a simulation, with the state of their hysteresis."""

    def __init__(self, laws: GearLaws, delta: Floats) -> None:
        self._laws, self._delta, self._loop = laws, delta.reshape(len(delta), -1), 0.0 * laws.K

    def torque(self, delta: Floats) -> Floats:
        """Torque beyond K δ at the next deflection, shape (n, runs)."""
        if self._laws.hysteretic:
            self._loop = self._laws.loop(self._loop, delta - self._delta)
            self._delta = delta
        return self._laws.beyond_linear(delta, self._loop)
