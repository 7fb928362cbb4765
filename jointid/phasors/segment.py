"""A stretch of any motion, whose Fourier bins are phasors at the harmonics of its length."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jointid.arrays import Complexes, Floats


@dataclass(frozen=True, eq=False)
class Segment:
    """Samples of a stretch, for friction, which its phasors do not hold."""

    record: int
    """Index of the motion record that it comes from."""
    interval_s: float
    whole: Floats
    """Smoothed velocities of the motors in the part of the record without a gap, rad/s; (n, samples)."""
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
    """Variance of each sample of the angles by noise, shape (n,), rad²."""
    repeated_variance: Floats
    """Part of it that the periods of the motion share, times the further periods, shape (n,), rad²."""
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
    """Size of the friction near reversals where it is not free: unknown, but bounded, shape (n,)."""
    known: dict[tuple[object, ...], Any] = field(default_factory=dict, repr=False)
    """Friction waveforms that were found already: of all fits they are the same."""

    @property
    def velocity(self) -> Floats:
        """Smoothed velocities of the motors, shape (n, N), rad/s."""
        return self.whole[:, self.begin : self.end]

    def gear_torque(self, M: Floats, viscous: Floats) -> Floats:
        """Torque through the gears and Coulomb friction, shape (n, N), N·m; M and viscous (n,)."""
        used, v = slice(self.begin, self.end), self.velocity
        # Held torques are on average those of the samples before and after.
        torque = 0.5 * (self.torque + np.roll(self.torque, 1, axis=1)) if self.held else self.torque
        inertial = M[:, None] * np.gradient(v, self.interval_s, axis=1)
        return np.asarray(torque[:, used] - inertial - viscous[:, None] * v)

    def torque_at_reversals(self, M: Floats, viscous: Floats) -> Floats:
        """Root mean square of that torque where the motors turn back, shape (n,), N·m."""
        turns = np.diff(np.sign(self.velocity), axis=1) != 0
        squares = (turns * self.gear_torque(M, viscous)[:, 1:] ** 2).sum(axis=1)
        return np.asarray(np.sqrt(squares / np.maximum(turns.sum(axis=1), 1)))

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
