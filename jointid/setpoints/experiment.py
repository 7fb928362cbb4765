"""An experiment as a smooth motion of the motors, from the start pose and back to it."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from jointid.arrays import Complexes, Floats

_BLEND = np.poly1d([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
"""From 0 to 1 with first and second derivatives of 0 at both ends."""
_SLOPE, _CURVATURE, _AREA = _BLEND.deriv(), _BLEND.deriv(2), _BLEND.integ()


class Motion(NamedTuple):
    """Motor angles relative to the start pose and their derivatives, each (N, n), in rad and s."""

    position: Floats
    velocity: Floats
    acceleration: Floats


@dataclass(frozen=True, eq=False)
class Run:
    """Sines of constant amplitude, one logarithmic sweep or any other motion, between two ramps.

    The angle is w(t) Im Σ A_l e^{iω_l t} + v ∫ w dt. The envelope w and its first two derivatives are
    continuous. The amplitude of a sweep falls with the frequency: its velocity amplitude is constant.
    """

    label: str
    frequency_hz: Floats
    """Shape (L,); of a sweep the first frequency, (1,)."""
    angle_rad: Complexes
    """Amplitudes and phases A, motor side, shape (L, n); of a sweep at its first frequency."""
    hold_s: float
    """Time between the ramps."""
    ramp_s: float = 0.0
    velocity_rad_s: Floats = field(default_factory=lambda: np.zeros(1))
    """Superposed velocity v, motor side, shape (n,)."""
    last_hz: float | None = None
    """Last frequency of a sweep or another motion."""
    wave: BSpline | None = None
    """Another motion in place of the sines, (N, n) over the time of the run; A is a factor on it."""

    @property
    def duration_s(self) -> float:
        """Duration with both ramps."""
        return self.hold_s + 2 * self.ramp_s

    @property
    def highest_hz(self) -> float:
        """Highest frequency."""
        return float(self.frequency_hz.max() if self.last_hz is None else self.last_hz)

    @property
    def travel_rad(self) -> Floats:
        """Angle by which the superposed velocity moves the motors, shape (n,)."""
        return np.asarray(self.velocity_rad_s * (self.hold_s + self.ramp_s))

    def motion(self, time: Floats) -> Motion:
        """Return the motion at times from the start of the run, shape (N,)."""
        r = self.ramp_s
        up, down = np.clip(time / r, 0, 1), np.clip((self.duration_s - time) / r, 0, 1)
        w = (_BLEND(up) * _BLEND(down))[:, None]
        dw = ((_SLOPE(up) - _SLOPE(down)) / r)[:, None]
        ddw = ((_CURVATURE(up) + _CURVATURE(down)) / r**2)[:, None]
        area = r * (_AREA(up) + 0.5 - _AREA(down)) + np.clip(time - r, 0, self.hold_s)
        s, ds, dds = self._sines(time)
        return Motion(
            w * s + area[:, None] * self.velocity_rad_s,
            dw * s + w * ds + w * self.velocity_rad_s,
            ddw * s + 2 * dw * ds + w * dds + dw * self.velocity_rad_s,
        )

    def _sines(self, time: Floats) -> tuple[Floats, Floats, Floats]:
        """Im Σ A e^{g(t)} or the other motion, and its first two derivatives, each (N, n)."""
        if self.wave is not None:
            wave = [self.wave(time, order) * self.angle_rad.real for order in range(3)]
            return wave[0], wave[1], wave[2]
        omega, t = 2 * np.pi * self.frequency_hz, time[:, None]
        if self.last_hz is None:
            g, dg, ddg = 1j * omega * t, 1j * omega, 0j * omega
        else:
            length = self.duration_s / np.log(self.last_hz / self.frequency_hz[0])
            growth = np.exp(t / length)
            g = -t / length + 1j * omega * length * (growth - 1)
            dg, ddg = -1 / length + 1j * omega * growth, 1j * omega * growth / length
        wave = np.exp(g)
        parts = (wave, wave * dg, wave * (ddg + dg * dg))
        position, velocity, acceleration = ((part @ self.angle_rad).imag for part in parts)
        return position, velocity, acceleration


@dataclass(frozen=True, eq=False)
class Experiment:
    """Runs one after the other, with the joints at rest before, between and after them."""

    runs: tuple[Run, ...]
    rest_s: float
    scale: float = 1.0
    """Factor on all motion that the runs contain, as chosen by the user."""

    @property
    def starts_s(self) -> Floats:
        """Start of the first ramp of each run, shape (r,)."""
        lengths = [run.duration_s + self.rest_s for run in self.runs]
        return self.rest_s + np.concatenate([[0.0], np.cumsum(lengths)[:-1]])

    @property
    def duration_s(self) -> float:
        """Duration of the whole experiment."""
        return float(self.starts_s[-1] + self.runs[-1].duration_s + self.rest_s)

    @property
    def highest_hz(self) -> float:
        """Highest frequency of all runs."""
        return max(run.highest_hz for run in self.runs)

    def motion(self, time: Floats) -> Motion:
        """Return the motion at ascending times from the start of the experiment, shape (N,)."""
        n = self.runs[0].velocity_rad_s.size
        total = Motion(*np.zeros((3, time.size, n)))
        for start, run in self._placed():
            first, last = np.searchsorted(time, [start, start + run.duration_s])
            for whole, part in zip(total, run.motion(time[first:last] - start), strict=True):
                whole[first:last] += part
            total.position[last:] += run.travel_rad
        return total

    def run_at(self, time_s: float) -> str:
        """Return the label of the run at a time, or of the last one before it."""
        index = int(np.searchsorted(self.starts_s, time_s, side="right")) - 1
        return self.runs[max(index, 0)].label

    def spans(self) -> Iterator[tuple[Run, float, float]]:
        """Each run with the times at which its full amplitude starts and ends."""
        for start, run in self._placed():
            yield run, start + run.ramp_s, start + run.ramp_s + run.hold_s

    def _placed(self) -> Iterator[tuple[float, Run]]:
        return zip(self.starts_s.tolist(), self.runs, strict=True)
