"""A part of any motion, whose Fourier bins are phasors at the harmonics of its length."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.fft import dct, idct
from scipy.interpolate import CubicSpline

from jointid.arrays import Complexes, Floats

_REFINED, _SAME = 30, 1e-4
"""Fixed-point steps for the torque through a gear, each of which multiplies the error by the coefficient
of load-dependent friction; and the relative change that ends them."""
_MARGIN = 4.0
"""Standard deviations of the velocity within which its sign is unknown."""
_BESIDE = 30
"""Samples before and after those of a segment that a spline of its torque needs: the influence of a
sample falls by 0.27 per sample."""
_MOST = 0.9
"""Largest coefficient of load-dependent friction; at 1, a gear is self-locking."""


class Motors(NamedTuple):
    """Parameters of n motors, each of shape (n,), or (r, n) of several records."""

    M: Floats
    coulomb: Floats
    viscous: Floats
    load: Floats
    """Share of the torque through the gear that is friction."""
    lag_s: Floats
    """Delay of the torque as logged."""
    torque_scale: Floats
    """Torque over that logged."""
    breakaway: Floats
    """Coulomb friction at rest in addition to that in motion (Stribeck curve)."""

    def without_load_friction(
        self, torque: Floats, direction: Floats, smooth: Callable[[Floats], Floats]
    ) -> Floats:
        """Torques through the gears from their sum with the friction by load, both (..., n, N).

        ``smooth`` keeps the harmonics that are known of both, and removes the others.
        """
        found, share = np.zeros_like(torque), np.minimum(self.load, _MOST)[..., None]
        for _ in range(_REFINED):
            before, found = found, smooth(torque - share * np.abs(found) * direction)
            change, size = (np.abs(each).max(axis=(-2, -1)) for each in (found - before, found))
            if np.all(change <= _SAME * size):
                break
        return found


@dataclass(frozen=True, eq=False)
class Segment:
    """Samples of a part of a motion, from which its friction is computed."""

    record: int
    """Index of the motion record that it comes from."""
    interval_s: float
    uniform_angle: Floats
    """Logged angles in the uniformly sampled part of the record, rad, shape (n, samples)."""
    uniform_velocity: Floats
    """Smoothed velocities there, rad/s, shape (n, samples)."""
    torque: Floats
    """Torques of the motors there, N·m, shape (n, samples)."""
    held: bool
    """Whether each is held until the next."""
    begin: int
    """First of its N samples in that part."""
    end: int
    """The one after its last sample."""
    velocity_noise: Floats
    """Their standard deviation, shape (n,), rad/s."""
    velocity_blur_s: Floats
    """Velocity at a jump of the acceleration, by smoothing, over half the jump, shape (n,), s."""
    angle_variance: Floats
    """Variance of each angle by noise, at each harmonic, times N/4: that of each sample if the noise is
    white; shape (highest, n), rad²."""
    repeated_variance: Floats
    """Part of it that the periods of the motion share, times the further periods, shape (n,), rad²."""
    torque_variance: Floats
    """Variance of each sample of the torques by noise, shape (n,), (N·m)²."""
    least_torque_variance: Floats
    """Square of the residual torque that sampling itself causes, shape (n,), (N·m)²."""
    most_torque_variance: Floats
    """The most that the variance of each sample of the torques can be by noise, shape (n,), (N·m)²."""
    lowest: int
    """First bin of its band."""
    highest: int
    """Last bin of its band."""
    turn_rad_s: Floats | float = 0.0
    """Velocity, in the direction before, at which a motor with friction turns back, shape (n,)."""
    unknown_Nm: Floats | float = 0.0
    """Size of the friction near reversals where it is not free: unknown, but bounded, shape (n,), in
    units of the logged torque."""
    known: dict[tuple[object, ...], Any] = field(default_factory=dict, repr=False)
    """Friction waveforms that were found already: of all fits they are the same."""

    @property
    def velocity(self) -> Floats:
        """Smoothed velocities of the motors, shape (n, N), rad/s."""
        return self.uniform_velocity[:, self.begin : self.end]

    @property
    def least_velocity(self) -> Floats:
        """Velocity of each motor below which noise hides its sign, shape (n,), rad/s."""
        return _MARGIN * self.velocity_noise

    @property
    def share_at_rest(self) -> Floats:
        """Share of the time with a lower velocity, shape (n,)."""
        return np.asarray(np.mean(np.abs(self.velocity) <= self.least_velocity[:, None], axis=1))

    def gear_torque(self, motors: Motors, direction: Floats) -> Floats:
        """Torque through the gears, shape (n, N), N·m, by the balance at motors moving in a direction.

        It is limited to twice the highest frequency of the band: the load at the end of a sweep reaches
        beyond the band, but farther on the smoothed velocity lacks the jumps of friction.
        """
        places, late = np.arange(self.begin, self.end), motors.lag_s / self.interval_s
        acting = (self._torque_at(j, places - late[j]) for j in range(late.size))
        left = motors.torque_scale[:, None] * np.stack([*acting])
        left -= motors.M[:, None] * self._acceleration
        left -= motors.viscous[:, None] * self.velocity + motors.coulomb[:, None] * direction

        def low(torque: Floats) -> Floats:
            lines = dct(torque, axis=1)
            lines[:, 4 * self.highest :] = 0.0  # two lines of a cosine transform per bin
            return np.asarray(idct(lines, axis=1))

        return motors.without_load_friction(left, direction, low)

    def _torque_at(self, j: int, places: Floats) -> Floats:
        """Torque of motor j at samples of the record, with their fraction: of held ones, their mean."""
        places = np.clip(places, self.held, self.torque.shape[1] - 1)
        first, last = max(int(places[0]) - _BESIDE, 0), int(places[-1]) + _BESIDE
        own = self.torque[j, first:last]
        spline = CubicSpline(first + np.arange(own.size), own)
        if not self.held:
            return np.asarray(spline(places))
        integral = spline.antiderivative()
        return np.asarray(integral(places) - integral(places - 1))

    @cached_property
    def _acceleration(self) -> Floats:
        spline = CubicSpline(np.arange(self.samples), self.velocity, axis=1)
        return np.asarray(spline(spline.x, 1) / self.interval_s)

    def friction_at_reversals(self, motors: Motors) -> Floats:
        """Coulomb friction at rest and the root mean square of that by load there, shape (n,), N·m."""
        level = motors.coulomb + motors.breakaway
        if not motors.load.any():
            return level
        direction = np.sign(self.velocity)
        turns = np.diff(direction, axis=1) != 0
        squares = (turns * self.gear_torque(motors, direction)[:, 1:] ** 2).sum(axis=1)
        at_turns = np.sqrt(squares / np.maximum(turns.sum(axis=1), 1))
        return np.asarray(level + motors.load * at_turns)

    @property
    def covariance(self) -> Floats:
        """Covariance of the harmonics of angles and torques by noise, shape (highest, 2n, 2n)."""
        torques = np.broadcast_to(self.torque_variance, self.angle_variance.shape)
        variance = np.concatenate([self.angle_variance, torques], axis=1)
        return 4 / self.samples * variance[:, None] * np.eye(variance.shape[1])

    @property
    def samples(self) -> int:
        """Number of samples N."""
        return self.end - self.begin

    @property
    def duration_s(self) -> float:
        """Period of the Fourier series, s."""
        return self.samples * self.interval_s


def bins_of(samples: Floats, bins: int) -> Complexes:
    """Phasors (..., bins) of the first harmonics of samples (..., N) over their length."""
    spectrum = np.fft.rfft(samples, axis=-1)[..., 1 : bins + 1]
    return np.asarray(spectrum * (2j / samples.shape[-1]))
