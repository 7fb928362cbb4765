"""Direction in which the arms move in motion records, which their Coulomb friction follows.

The motion of an arm follows from the records in two ways. The gear's torque f, which the balance at the
motor leaves, winds it up by δ, K δ + D δ̇ = f, and the arm moves by δ less than the motor: right for any
arm, but with the noise of the torque. And the motor drives the arm, M2 θ̈_a = K δ + D δ̇ − F sign θ̇_a:
without that noise, but only as accurate as M2, K, D and F. The difference of the torques over the noise
decides between them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline

from jointid.arrays import Complexes, Floats
from jointid.motion.reversals import phasors_of_turns, reversals
from jointid.phasors.segment import Motors, Segment
from jointid.small_matrices import decaying

_STATIONARY = 0.5
"""An arm is stationary where its largest velocity is below the least clear one over this share."""
_RENEWED = 3
"""Iterations of the arm's motion, each with friction by the direction of the previous one."""
_ALIKE = 2.0
"""Difference of the torques over the noise of the measured one up to which the driven arms are right."""
_MEDIAN = 0.455
"""Median square of normal noise over its mean."""
_FINE = 30.0
"""Points per period of the highest frequency in the arms' motion."""
_LEAST = 1e-30
"""Squared torque that counts as zero, (N·m)²."""
_DISTINCT = 1e-9
"""Relative singular value from which free motions of the arms are distinct."""


def arm_directions(
    segments: Mapping[int, Segment], motors: Sequence[Motors], arms: Sequence[DrivenArms]
) -> dict[int, Complexes]:
    """Phasors of the sign of each arm's velocity, (highest, n), by the row of the segment.

    Those of an arm at rest are zero. ``motors`` and ``arms`` have those of every row.
    """
    return {
        row: _directions(each, arms[row].velocities(each, motors[row])) for row, each in segments.items()
    }


def _directions(segment: Segment, velocities: Floats) -> Complexes:
    found, finer = np.zeros((segment.highest, len(velocities)), complex), _finer(segment)
    for j, velocity in enumerate(velocities):
        if segment.least_velocity[j] < _STATIONARY * np.abs(velocity).max():
            turns, rests, signs = reversals(velocity, 0.0, 0.0, 0.0)
            places = turns / finer, rests / finer, signs
            found[:, j] = phasors_of_turns(*places, segment.samples, segment.highest)
    return found


def _finer(segment: Segment) -> int:
    """Points of the arms' motion for each sample: between few samples per period it is no line."""
    return int(np.ceil(_FINE * segment.highest / segment.samples))


@dataclass(frozen=True, eq=False)
class DrivenArms:
    """n elastic gears and the arms of one pose behind them; arrays have shape (n,) or (n, n)."""

    K: Floats
    D: Floats
    coulomb: Floats
    """Coulomb friction F of the arms, N·m; zero where it is not known yet."""
    viscous: Floats
    """Viscous friction of the arms, N·m·s/rad."""
    M2: Floats
    gravity: Floats
    """Stiffness of the arms by gravity, N·m/rad."""

    @cached_property
    def modes(self) -> tuple[Complexes, Complexes]:
        """Poles (2n,) with the motors locked, and their shapes (2n, 2n): angles above velocities."""
        n = self.K.size
        held = np.hstack([-np.diag(self.K) - self.gravity, -np.diag(self.D + self.viscous)])
        poles, shapes = np.linalg.eig(np.vstack([np.eye(n, 2 * n, n), np.linalg.solve(self.M2, held)]))
        return poles.astype(complex), shapes.astype(complex)

    def velocities(self, segment: Segment, motors: Motors) -> Floats:
        """Velocities of the arms at the samples of a segment and, if few, in between, rad/s, (n, p)."""
        finer = _finer(segment)
        torque = segment.gear_torque(motors, np.sign(segment.velocity))
        splines = CubicSpline(np.arange(segment.samples), [segment.velocity, torque], axis=2)
        velocity, measured = splines(np.arange((segment.samples - 1) * finer + 1) / finer)
        T = segment.interval_s / finer
        found = by_torque = self._by_torque(velocity, measured, T)
        if not self.coulomb.any() or self.modes[0].real.max() > 0:
            return found
        angle = cumulative_simpson(velocity, dx=T, axis=1, initial=0)
        share = min(1.0, 4 * segment.highest / segment.samples)  # of the lines that ``gear_torque`` has
        noise = _ALIKE**2 * share * segment.torque_variance
        friction = self.coulomb[:, None] * np.sign(found)
        for _ in range(_RENEWED):
            torque, by_motor = self._driven(angle, velocity, friction, measured, T)
            if not np.isfinite(by_motor).all():  # two poles are equal
                return by_torque
            difference = np.median((measured - torque) ** 2, axis=1) / _MEDIAN  # apart from the ends
            weight = 1 - noise / np.maximum(np.maximum(difference, noise), _LEAST)
            found = by_motor + weight[:, None] * (by_torque - by_motor)
            # Half of the change: an arm that almost rests would turn back each time.
            friction = 0.5 * (friction + self.coulomb[:, None] * np.sign(found))
        return found

    def _by_torque(self, velocity: Floats, torque: Floats, T: float) -> Floats:
        damped = 2 * np.abs(self.D[:, None]) / T
        stiffness, twice = self.K[:, None] + damped, torque - torque[:, :1]
        twice[:, 1:] += twice[:, :-1].copy()
        wound = decaying((damped - self.K[:, None]) / stiffness, twice / stiffness)
        return np.asarray(velocity - np.gradient(wound, axis=1) / T)

    def _driven(
        self, angle: Floats, velocity: Floats, friction: Floats, measured: Floats, T: float
    ) -> tuple[Floats, Floats]:
        """Torques through the gears, and velocities of the arms, that the motors' motion causes.

        The start of the arms is the one that fits the measured torques best. All have shape (n, p).
        """
        (n, points), (poles, shapes) = angle.shape, self.modes
        drive = self.K[:, None] * angle + self.D[:, None] * velocity
        push = np.linalg.solve(self.M2, drive - friction)
        sizes = np.linalg.solve(shapes, np.vstack([0 * push, push]))
        x = (poles * T)[:, None]
        whole, late = np.expm1(x) / x, (np.expm1(x) - x) / x**2  # forces change linearly in a step
        steps = T * ((whole - late) * sizes[:, :-1] + late * sizes[:, 1:])
        moved = np.pad(decaying(np.exp(x), steps), ((0, 0), (1, 0)))
        # The arms' free motion from any start, real and imaginary part, and a constant torque.
        of_gears, decay = (
            np.hstack([np.diag(self.K), np.diag(self.D)]) @ shapes,
            np.exp(x * np.arange(points)),
        )
        free = -of_gears[:, :, None] * decay
        columns = np.concatenate([free.real, -free.imag], axis=1).swapaxes(1, 2).reshape(-1, 4 * n)
        columns = np.hstack([columns, np.kron(np.eye(n), np.ones((points, 1)))])
        torque = drive - (of_gears @ moved).real
        start = np.linalg.lstsq(columns, (measured - torque).ravel(), rcond=_DISTINCT)[0]
        moved += (start[: 2 * n] + 1j * start[2 * n : 4 * n])[:, None] * decay
        return torque + (columns @ start).reshape(n, -1), (shapes[n:] @ moved).real
