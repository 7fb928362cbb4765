"""Motions other than single sines, as references of the simulated joints."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from jointid.arrays import Floats, per_joint
from jointid.errors import JointIdError
from jointid.simulation.experiment import PerJoint, checked_setting

KINDS = {
    "sweep": "logarithmic sweep; neighbouring joints sweep in opposite directions",
    "multisine": "multisine with random phases, repeated",
    "random": "band-limited random motion",
    "moves": "point-to-point moves with pauses",
}
"""Motions by name, with a one-line description."""

_PERIODS = 4
"""Periods of a multisine in a record: their differences are noise."""
_GROUP = 4
"""Number of neighbouring odd lines of which one stays empty and shows odd distortion."""
_PEAK_VELOCITY, _PEAK_ACCELERATION = 1.875, 10 / np.sqrt(3)
"""Peaks of the quintic move of unit distance and time."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Reference motion of the joints within limits of position, velocity and acceleration.

    Raises JointIdError when a value is out of range or the kind is unknown.
    """

    kind: str = "sweep"
    """"sweep", "multisine", "random" or "moves", see ``KINDS``."""
    from_hz: float = 2.0
    """Lowest frequency of a sweep, multisine or random motion, Hz."""
    to_hz: float = 40.0
    """Highest frequency, Hz."""
    duration_s: float = 20.0
    """Length of the log, s."""
    velocity_rad_s: PerJoint = 10.0
    """Largest velocity of the reference, motor side, rad/s."""
    acceleration_rad_s2: PerJoint = 300.0
    """Largest acceleration of the reference, motor side, rad/s²."""
    position_rad: PerJoint = 1.0
    """Largest distance from the pose, motor side, rad."""
    odd: bool = False
    """Multisine: excite odd multiples of the line spacing only, three of every four. Lines without
    excitation then show nonlinear distortion, even and odd."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise JointIdError(f'Motion "{self.kind!s:.40}" is unknown: expected {", ".join(KINDS)}.')
        for name, unit in (("from_hz", "Hz"), ("to_hz", "Hz"), ("duration_s", "s")):
            checked_setting(self, name, unit, positive=True, single=True)
        for name, unit in LIMITS.items():
            checked_setting(self, name, unit, positive=True)
        if self.from_hz >= self.to_hz:
            raise JointIdError(
                f"The band from {self.from_hz:g} Hz to {self.to_hz:g} Hz is empty: raise its upper end."
            )
        if self.duration_s * self.from_hz < _PERIODS and self.kind != "moves":
            raise JointIdError(
                f"A motion of {self.duration_s:g} s is too short: {_PERIODS} periods of "
                f"{self.from_hz:g} Hz last {_PERIODS / self.from_hz:.3g} s. Record longer, or raise the "
                "lowest frequency."
            )

    def limits(self, n: int) -> tuple[Floats, Floats, Floats]:
        """Largest position, velocity and acceleration of n joints, each (n,)."""
        position, velocity, acceleration = (per_joint(k, getattr(self, k), n) for k in LIMITS)
        return position, velocity, acceleration

    def amplitude(self, omega: Floats, n: int) -> Floats:
        """Largest position amplitude of n joints at frequencies, rad/s, within the limits, (n, k)."""
        position, velocity, acceleration = (limit[:, None] for limit in self.limits(n))
        return np.minimum(np.minimum(position, velocity / omega), acceleration / omega**2)


LIMITS = {"position_rad": "rad", "velocity_rad_s": "rad/s", "acceleration_rad_s2": "rad/s²"}
"""Unit of each limit of a ``Motion``."""


class SampledReference(NamedTuple):
    """Reference of n joints in R records on the samples of the control, at rest before the first."""

    interval_s: float
    position: Floats  # (N, n, R), the first two samples at rest
    first: int  # sample number of the first row, relative to the start of the log

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """Position and acceleration at samples of the control, each (N, n, R)."""
        k = np.clip(np.rint(time / self.interval_s).astype(int) - self.first, 1, len(self.position) - 2)
        before, now, after = (self.position[k + step] for step in (-1, 0, 1))
        return now, (after - 2 * now + before) / self.interval_s**2


def sampled(
    motion: Motion, n: int, records: int, interval_s: float, before: int, seed: int
) -> SampledReference:
    """Return the references of n joints in R different records.

    The joints start from rest ``before`` samples ahead of the log; a sweep, multisine or random motion
    is in full swing when the log begins. Raises JointIdError when the band reaches half the sample rate.
    """
    if motion.to_hz * interval_s >= 0.5:
        raise JointIdError(
            f"The highest frequency, {motion.to_hz:g} Hz, must be below half the sample rate of "
            f"{1 / interval_s:g} Hz."
        )
    samples = int(np.ceil(motion.duration_s / interval_s - 1e-6))
    time = interval_s * np.arange(-before - 1.0, samples + 1.0)
    rise = np.clip((time + before * interval_s) / max(before * interval_s / 2, interval_s), 0.0, 1.0)
    position = np.empty((time.size, n, records))
    for record, source in enumerate(np.random.default_rng([seed, 7]).spawn(records)):
        if motion.kind == "moves":
            position[:, :, record] = _moves(motion, n, time, source)
            continue
        shape = _sweep if motion.kind == "sweep" else _lines
        table = shape(motion, n, record, time, source)
        position[:, :, record] = _within(motion.limits(n), table, interval_s) * _step(rise)[:, None]
    return SampledReference(interval_s, position, -before - 1)


def _sweep(motion: Motion, n: int, record: int, time: Floats, source: np.random.Generator) -> Floats:
    """Logarithmic sweeps; the amplitude follows the tightest limit at each frequency."""
    ratio = np.log(motion.to_hz / motion.from_hz)
    span = time[-1] - time[0]  # from before the log, so that nothing jumps where it begins
    share = (time - time[0]) / span
    table = np.empty((time.size, n))
    for j in range(n):
        up = (record + j) % 2 == 0
        start, rate = (motion.from_hz, ratio) if up else (motion.to_hz, -ratio)
        cycles = start * span / rate * np.expm1(rate * share)
        amplitude = motion.amplitude(2 * np.pi * (start * np.exp(rate * share)), n)[j]
        table[:, j] = amplitude * np.sin(2 * np.pi * (cycles + source.uniform()))
    return table


def _lines(motion: Motion, n: int, record: int, time: Floats, source: np.random.Generator) -> Floats:
    """Sums of sines: the lines of one period, or lines so close that they never repeat in the log."""
    repeats = motion.kind == "multisine"
    period = motion.duration_s / _PERIODS if repeats else 2.5 * motion.duration_s
    order = np.arange(np.ceil(motion.from_hz * period), np.floor(motion.to_hz * period) + 1)
    if motion.odd and repeats:
        order = order[order % 2 == 1]
        empty = np.arange(0, order.size, _GROUP) + source.integers(_GROUP, size=-(-order.size // _GROUP))
        order = np.delete(order, empty[empty < order.size])
    omega = 2 * np.pi * order / period
    size = 1 << int(np.ceil(np.log2(max(4 * order[-1], period / (time[1] - time[0])))))
    grid = np.arange(size + 1) * period / size
    table = np.empty((time.size, n))
    for j, amplitude in enumerate(motion.amplitude(omega, n)):
        phase = np.exp(2j * np.pi * source.uniform(size=order.size))
        if not repeats:
            phase = source.standard_normal((order.size, 2)) @ np.array([1.0, 1.0j])
        spectrum = np.zeros(size // 2 + 1, complex)
        spectrum[order.astype(int)] = amplitude * phase
        wave = np.fft.irfft(spectrum, size) * size / 2
        whole = CubicSpline(grid, np.append(wave, wave[0]), bc_type="periodic")
        table[:, j] = whole(time % period)
    return table


def _moves(motion: Motion, n: int, time: Floats, source: np.random.Generator) -> Floats:
    """Moves to random points, all joints at once, with pauses of 0.1-0.4 s."""
    table, here, now = np.empty((time.size, n)), np.zeros(n), 0.0
    table[:] = here
    position, velocity, acceleration = motion.limits(n)
    while now < time[-1]:
        there = position * source.uniform(-1, 1, n)
        distance = np.abs(there - here)
        slowest = np.sqrt(_PEAK_ACCELERATION * distance / acceleration)
        lasts = np.maximum(_PEAK_VELOCITY * distance / velocity, slowest).max()
        part = slice(int(np.searchsorted(time, now)), None)
        table[part] = here + _step((time[part, None] - now) / lasts) * (there - here)
        here, now = there, now + lasts + source.uniform(0.1, 0.4)
    return table


def _step(share: Floats) -> Floats:
    """Quintic step from 0 to 1, at rest at both ends."""
    x = np.clip(share, 0.0, 1.0)
    return np.asarray(x**3 * (10 + x * (6 * x - 15)))


def _within(limits: tuple[Floats, Floats, Floats], table: Floats, interval_s: float) -> Floats:
    """Scale each joint so that position, velocity and acceleration reach but do not pass a limit."""
    peaks = [np.abs(np.diff(table, order, axis=0)).max(axis=0) / interval_s**order for order in range(3)]
    factor = np.min([limit / peak for limit, peak in zip(limits, peaks, strict=True)], axis=0)
    return np.asarray(table * factor)
