"""Columns of the deflection equation of one joint: what can make motor and arm encoder differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arm_side.band_limited import BandLimited, GaussianFilter
from jointid.arrays import Floats
from jointid.gears.dahl import dahl
from jointid.robot_models.model import RobotModel

_PRESLIDING_RAD = 3e-4
"""Motion after a reversal in which friction in the gear builds up."""
_SLIDING_RAD_S = 5e-3
"""Velocity at which friction in the gear builds up, where it does so by velocity instead."""
SLOW_HARMONICS = (1, 2, 3, 4)
"""Harmonics of the joint angle: eccentric gear wheels and encoder discs."""
MOTOR_HARMONICS = (1, 2)
"""Harmonics of the motor angle: the first gear stage."""
_COARSEST_RAD = 0.25
"""Longest wavelength of the ripple; a slower error belongs to the harmonics of the joint."""
_FINEST_RAD = 0.04
"""Shortest wavelength of the ripple of the second stage, which has tens of periods a turn."""
_MOST_RIPPLES = 60
_WIDER = 4.0
"""Band of the motion that gives the torque, in bands of the record; the torque is filtered after it."""


@dataclass(frozen=True, eq=False)
class Ripple:
    """Fourier basis over the range of a joint for a transmission error of unknown shape."""

    range_rad: tuple[float, float]
    period_rad: float
    first: int
    count: int
    orders: Floats
    """Wavenumbers of clear periodic errors, of teeth or of a sensor's lines, shape (m,)."""

    @classmethod
    def over(cls, q: Floats, orders: Floats) -> Ripple:
        """Basis for joint angles; its period exceeds their range, so that the two ends are free."""
        period = 1.5 * float(np.ptp(q)) + 1e-9
        first = int(np.ceil(period / _COARSEST_RAD))
        count = int(min(_MOST_RIPPLES, np.ceil(period / _FINEST_RAD)))
        return cls((float(q.min()), float(q.max())), period, first, count, orders)

    @property
    def wavenumbers(self) -> Floats:
        """Radians per radian of the joint, shape (count,)."""
        return np.asarray(2 * np.pi * np.arange(self.first, self.count + 1) / self.period_rad, float)

    def __call__(self, q: Floats) -> Floats:
        """Waves at joint angles (N,), (N, 2 count)."""
        return self._held(q, self.wavenumbers)

    def slow(self, q: Floats) -> Floats:
        """Harmonics of the joint angle (N,), shape (N, 2 harmonics)."""
        return self._held(q, np.array(SLOW_HARMONICS, float))

    def _held(self, q: Floats, orders: Floats) -> Floats:
        """Waves at joint angles; beyond the range those at its end.

        A series says nothing beyond: its waves would add up to tens of seconds of arc.
        """
        return waves(np.clip(q, *self.range_rad) - self.range_rad[0], orders)


@dataclass(frozen=True, eq=False)
class Terms:
    """Columns by group; each group shares one kind of coefficient."""

    columns: Floats
    groups: dict[str, slice]


def waves(angle: Floats, orders: Floats) -> Floats:
    """Cosines, then sines of each order over angles (N,), shape (N, 2 orders)."""
    turning, steps = np.empty((orders.size, angle.size), complex), np.diff(orders)
    alike = steps.size > 0 and np.allclose(steps, steps[0], rtol=1e-9)
    turn = np.exp(1j * steps[0] * angle) if alike else None
    for k, order in enumerate(orders.tolist()):  # a product takes a tenth of the time of cosine and sine
        again = k > 0 and turn is not None
        turning[k] = turning[k - 1] * turn if again else np.exp(1j * order * angle)
    return np.concatenate([turning.real, turning.imag]).T


def joint_torque(
    motion: BandLimited, robot: RobotModel, elastic: Floats
) -> tuple[Floats, Floats, Floats]:
    """Torque through the gears, (N, n), and its changes by payload, (N, n, 4), and parts, (N, n, n + 1).

    They are those of ``RobotModel.torque_changes``. The arm's angle is the motor's minus the deflection
    without skew, ``elastic`` (N, n), rad. The torque is filtered, not the motion: products of the motion
    do not commute with a filter. Since noise grows with each derivative, a wider filter smooths the
    motion first, which leaves out the motion's spread within its kernel: a standard deviation of width
    times rate. The torque is the mean of those at both its ends, correct to the second order; at its
    centre, it was up to 0.5 % too large in quick moves.
    """
    lowpass = motion.lowpass
    wide = GaussianFilter(lowpass.interval_s, min(_WIDER * lowpass.band_hz, 0.25 / lowpass.interval_s))
    rest = GaussianFilter(lowpass.interval_s, (lowpass.band_hz**-2.0 - wide.band_hz**-2.0) ** -0.5)
    state = np.array([wide(motion.raw - elastic, order) for order in range(3)])
    spread = wide.width_s * np.gradient(state, lowpass.interval_s, axis=1)
    both = (robot.torque_changes(*each) for each in (state + spread, state - spread))
    torque, payload, parts = (rest((ahead + back) / 2) for ahead, back in zip(*both, strict=True))
    return torque, payload, parts


def joint_terms(
    j: int, motion: BandLimited, torque: Floats, payload: Floats, motor: Floats, ripple: Ripple
) -> Terms:
    """Columns of joint j over all N samples, each in the band of the record.

    ``torque``, (N, n), and ``payload``, (N, n, 4), N·m, are those of ``joint_torque``, ``motor`` (N,) is
    the motor's angle, rad.
    """
    lowpass, raw = motion.lowpass, motion.raw[:, j]
    by_way = dahl(raw[None], np.array([[1 / _PRESLIDING_RAD]]))[0]
    friction = lowpass(np.stack([by_way, np.tanh(motion.dq[:, j] / _SLIDING_RAD_S)], axis=1))
    parts = {
        "compliance": torque[:, j, None],
        "skew": motion.dq[:, j, None],
        "payload": payload[:, j],
        "damping": lowpass(torque[:, j, None], 1),
        "slow": lowpass(ripple.slow(raw)),
        "motor": lowpass(waves(motor, np.array(MOTOR_HARMONICS, float))),
        "ripple": lowpass(ripple(raw)),
        "teeth": lowpass(waves(raw, ripple.orders)),
        "friction": friction,
        "loaded": friction * np.abs(torque[:, j, None]),
    }
    ends = np.cumsum([0, *(part.shape[1] for part in parts.values())])
    groups = {name: slice(a, b) for name, a, b in zip(parts, ends[:-1], ends[1:], strict=True)}
    return Terms(np.concatenate(list(parts.values()), axis=1), groups)
