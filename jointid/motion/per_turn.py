"""Waveforms that repeat with the turns of a motor: torque ripple, and transmission error of its gear."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.motion.friction import GRID, FrictionWaveforms, GearTorque, seen_angles
from jointid.phasors.extract import Phasors
from jointid.phasors.periods import phasors_of, samples_of
from jointid.phasors.segment import bins_of
from jointid.wording import enumerated


class PerTurn(NamedTuple):
    """An effect of the position θ of each motor, a sin(kθ + φ) + b cos(kθ + φ)."""

    effect: str
    """Key of ``EFFECTS``, and the parameter a; that of b is its "_quadrature"."""
    orders: tuple[int, ...]
    """Periods k per turn of each of n motors; 0 without the effect."""
    phases: tuple[float, ...]
    """Phases φ, rad."""

    @property
    def of_joints(self) -> str:
        """The orders of the joints with the effect, as in "2 and 6"."""
        return enumerated([str(k) for k in self.orders if k])

    def waves(self, phasors: Phasors, torque: GearTorque | None = None) -> Complexes:
        """Phasors per unit of a and of b, shape (2, r, H, n).

        With a torque, those of its product with the derivative by θ.
        """
        cosine, sine = turn_waves(phasors, np.array(self.orders), torque)
        if torque is not None:
            cosine, sine = -np.array(self.orders) * sine, np.array(self.orders) * cosine
        c, s = np.cos(self.phases), np.sin(self.phases)
        return np.stack([sine * c + cosine * s, cosine * c - sine * s])


def with_turns(
    friction: FrictionWaveforms, phasors: Phasors, effects: Sequence[PerTurn], torque: GearTorque
) -> FrictionWaveforms:
    """Waveforms with those of effects that repeat with the turns of the motors.

    A gear with the transmission error w(θ) is deflected by w less, and passes the share 1 − dw/dθ of its
    torque on to the motor: it does no work.
    """
    torques, deflections = dict(friction.further), dict(friction.deflection)
    for each in effects:
        names, waves = (each.effect, f"{each.effect}_quadrature"), each.waves(phasors)
        if each.effect == "transmission":
            deflections |= zip(names, waves, strict=True)
            waves = -each.waves(phasors, torque)
        torques |= zip(names, waves, strict=True)
    return replace(friction, further=torques, deflection=deflections)


def turn_waves(phasors: Phasors, orders: np.ndarray, factor: GearTorque | None = None) -> Complexes:
    """Phasors of cos kθ and sin kθ, times a factor, shape (2, r, H, n), for orders k of shape (n,).

    They are zero where k is.
    """
    (r, H, _), n = phasors.harmonics.shape, phasors.n
    found, k = np.zeros((2, r, H, n), complex), orders[:, None]

    def waves(angle: Floats, factor: Floats | float) -> Floats:
        return np.stack([np.cos(k * angle), np.sin(k * angle)]) * factor

    if (sines := np.flatnonzero(~phasors.motion)).size:
        swing = (phasors.harmonics[..., :n] * seen_angles(phasors)[1])[sines].swapaxes(1, 2)
        angle = samples_of(swing, GRID) + phasors.mean_angle[sines][..., None]
        found[:, sines] = phasors_of(waves(angle, factor.sines if factor else 1.0), H).swapaxes(2, 3)
    for row, segment in enumerate(phasors.segments):
        if segment is not None:
            angle, bins = segment.uniform_angle[:, segment.begin : segment.end], segment.highest
            own = bins_of(waves(angle, factor.segments[row] if factor else 1.0), bins)
            found[:, row, :bins] = own.swapaxes(1, 2)
            found[:, row, : segment.lowest - 1] = 0
    return np.asarray(found * (orders > 0) * np.any(phasors.harmonics != 0, axis=2)[..., None])
