"""Torque of a gear over its deflection: linear, hardening, three slopes, backlash, hysteresis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats
from jointid.errors import JointIdError

_BISECTIONS = 60
"""Halvings of the range of a deflection."""


@dataclass(frozen=True)
class Gear:
    """Torque over deflection of one gear, motor side.

    With the deflection δ less the backlash, e = δ − clip(δ, ± backlash/2), the elastic torque is
    K e + cubic e³, plus the changes of slope to K2 at the torque T1 and to K3 at T2. Damping D δ̇ and
    hysteresis (Dahl: dz/dδ = (1 − z sign δ̇)/presliding, torque ``hysteresis`` · z) are added.

    Raises
    ------
    JointIdError
        When a value is not finite or out of range.
    """

    K: float = 0.0
    """Tangent stiffness, N·m/rad: slope of the elastic law at zero torque, outside the backlash. In a
    simulated robot, 0 means the K of its elasticity."""
    cubic: float = 0.0
    """Cubic stiffness, N·m/rad³; negative for a softening gear."""
    backlash_rad: float = 0.0
    """Total angle between the flanks, rad."""
    hysteresis_Nm: float = 0.0
    """Saturation level of the hysteresis, half the height of its loop, N·m."""
    presliding_rad: float = 0.0
    """Level of the hysteresis divided by its initial slope, rad."""
    loss_factor: float = 0.0
    """Structural damping: amplitude of the torque in phase with the velocity over that of K δ."""
    K2: float = 0.0
    """Slope between the torques T1 and T2, N·m/rad; 0: no change of slope."""
    K3: float = 0.0
    """Slope beyond T2, N·m/rad."""
    T1_Nm: float = 0.0
    """Torque from which the slope is K2, N·m."""
    T2_Nm: float = 0.0
    """Torque from which the slope is K3, N·m."""
    tried_rad: float = 0.0
    """Largest deflection in the records, rad."""
    tried_Nm: float = 0.0
    """Largest torque through the gear in the records, N·m."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not np.isfinite(value) or (value < 0 and field.name != "cubic"):
                rule = "be finite" if field.name == "cubic" else "be finite and not negative"
                raise JointIdError(f"{field.name} of a gear is {value:g}: it must {rule}.")
        if self.hysteresis_Nm and not self.presliding_rad:
            raise JointIdError(
                "A gear with hysteresis needs a presliding deflection (presliding_rad) above 0."
            )
        if self.K2 and not (self.K3 and 0 < self.T1_Nm <= self.T2_Nm):
            raise JointIdError("A gear with K2 needs K3 above 0 and torques 0 < T1 ≤ T2.")

    @property
    def laws(self) -> tuple[str, ...]:
        """Names of the laws present, the dominant one first; ("linear",) if there is no other.

        Dominant is the law with the largest torque at the largest deflection in the records, over K δ.
        """
        size = self.tried_rad or 1.0
        share = {
            "hardening": abs(self.cubic) * size**2,
            "piecewise": self.K2 and abs(_bend(self, size)) / size,
            "backlash": 0.5 * self.backlash_rad * (self.K or 1.0) / size,
            "hysteresis": self.hysteresis_Nm / size,
        }
        present = sorted((name for name in share if share[name]), key=lambda name: -share[name])
        return tuple(present) or ("linear",)

    @property
    def kind(self) -> str:
        """Dominant law: "linear", "hardening", "piecewise", "backlash" or "hysteresis"."""
        return self.laws[0]

    @property
    def backlash_share(self) -> float:
        """Backlash over the largest peak-to-peak deflection; NaN where no deflection was tried."""
        return 0.5 * self.backlash_rad / self.tried_rad if self.tried_rad else np.nan

    def torque(self, deflection_rad: ArrayLike) -> Floats:
        """Elastic torque, without damping and hysteresis, N·m, in the shape of ``deflection_rad``."""
        delta = np.asarray(deflection_rad, dtype=np.float64)
        half = 0.5 * self.backlash_rad
        e = delta - np.clip(delta, -half, half)
        return np.asarray(self.K * e + self.cubic * e**3 + _bend(self, e))

    def deflection(self, torque_Nm: ArrayLike) -> Floats:
        """Deflection at an elastic torque, rad: the inverse of ``torque``, half the backlash included.

        A softening gear carries no more than the torque at its flattest slope; for larger torques the
        result is the deflection there.
        """
        torque = np.asarray(torque_Nm, dtype=np.float64)
        size = np.abs(torque)
        flattest = np.sqrt(self.K / (-3 * self.cubic)) if self.cubic < 0 else np.inf
        slope = min(self.K, self.K2, self.K3) if self.K2 else self.K
        low = np.full(size.shape, 0.5 * self.backlash_rad)
        high = low + np.minimum(size / slope if self.cubic >= 0 else np.inf, flattest)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            above = self.torque(middle) > size
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        return np.asarray(np.sign(torque) * low)

    @property
    def secant_K(self) -> float:
        """Secant stiffness at the largest torque in the records, N·m/rad; K if linear or untried."""
        return self.K if self.kind == "linear" or not self.tried_Nm else self.secant(self.tried_Nm)

    def secant(self, torque_Nm: float) -> float:
        """Secant stiffness from zero to a torque, without backlash and hysteresis, N·m/rad."""
        wind_up = float(self.deflection(torque_Nm)) - 0.5 * self.backlash_rad
        return torque_Nm / wind_up

    def scaled(self, factor: float) -> Gear:
        """Return the gear with all torques times a factor."""
        torques = ("K", "cubic", "hysteresis_Nm", "K2", "K3", "T1_Nm", "T2_Nm", "tried_Nm")
        return replace(self, **{name: factor * getattr(self, name) for name in torques})


def _bend(gear: Gear, e: ArrayLike) -> Floats:
    """Torque of the changes of slope at deflections without backlash."""
    (first, second), (step1, step2) = knees(gear)
    size = np.abs(e)
    bend = step1 * np.maximum(size - first, 0) + step2 * np.maximum(size - second, 0)
    return np.asarray(np.sign(e) * bend)


def knees(gear: Gear) -> tuple[tuple[float, float], tuple[float, float]]:
    """Deflections at T1 and T2, rad, and the changes of slope there, N·m/rad."""
    if not gear.K2:
        return (0.0, 0.0), (0.0, 0.0)
    first = gear.T1_Nm / (gear.K or gear.K2)
    return (first, first + (gear.T2_Nm - gear.T1_Nm) / gear.K2), (gear.K2 - gear.K, gear.K3 - gear.K2)


def gears_with(K: Floats, gears: Sequence[Gear]) -> tuple[Gear, ...]:
    """Gears of joints with the stiffness K, shape (n,).

    Raises
    ------
    JointIdError
        When there is not one gear for each joint, or a gear states another stiffness.
    """
    if len(gears) != K.size or not all(isinstance(gear, Gear) for gear in gears):
        raise JointIdError(f"gears: expected one Gear for each of the {K.size} joints.")
    for j, (gear, own) in enumerate(zip(gears, K.tolist(), strict=True), start=1):
        if gear.K and abs(gear.K - own) > 1e-9 * own:
            raise JointIdError(
                f"gears: K of gear {j} is {gear.K:g} N·m/rad, but the elasticity has {own:g}: state it "
                "once, or leave out the K of the gear."
            )
    return tuple(replace(gear, K=own) for gear, own in zip(gears, K.tolist(), strict=True))
