"""Motion records on a uniform grid: small jitter is resampled, gaps divide a record."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import prev_fast_len
from scipy.interpolate import CubicSpline

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.records import MotionRecord

_GAP = 1.9
"""Step of the clock, in median steps, from which samples are missing."""
_UNIFORM = 1e-6
"""Deviation from a uniform grid, in steps, that needs no resampling."""
_MOST_JITTER = 0.45
"""Largest deviation of a step from the median one that is resampled."""
SHORTEST = 64
"""Samples of the shortest part that is used."""


@dataclass(frozen=True, eq=False)
class UniformPart:
    """Samples in equal steps, without a gap."""

    record: int
    """Index of the motion record."""
    interval_s: float
    theta: Floats
    """Shape (n, N), rad."""
    tau: Floats
    """Shape (n, N), N·m."""
    held: bool

    @property
    def duration_s(self) -> float:
        """Time of all samples, a step each."""
        return float(self.theta.shape[1] * self.interval_s)

    @cached_property
    def rotor_spectra(self) -> tuple[Floats, Complexes, Complexes]:
        """Frequencies (f,), and spectra of mean torque over two steps and acceleration, each (n, f)."""
        tau = self.tau
        torque = 0.5 * (tau[:, 1:-1] + tau[:, :-2]) if self.held else tau[:, 1:-1]
        bend = np.diff(self.theta, 2, axis=1) / self.interval_s**2
        f, spectra = windowed_spectrum(np.stack([torque, bend]), self.interval_s)
        return f, *spectra

    @cached_property
    def power(self) -> tuple[Floats, Floats]:
        """Frequencies (f,), and power of velocities and torques without their trend, (2, n, f)."""
        signals = np.stack([np.gradient(self.theta, self.interval_s, axis=1), self.tau])
        first, last = signals[..., :1], signals[..., -1:]
        level = signals - first - (last - first) * np.linspace(0, 1, signals.shape[-1])
        f, spectra = windowed_spectrum(level - level.mean(axis=-1, keepdims=True), self.interval_s)
        return f, np.abs(spectra) ** 2


def windowed_spectrum(signals: Floats, interval_s: float) -> tuple[Floats, Complexes]:
    """Frequencies (f,), Hz, and spectra of signals (..., N), (..., f); of white noise, |.|² is σ².

    Without the few last samples that would make the transform slow.
    """
    samples = prev_fast_len(signals.shape[-1], real=True)
    window = np.hanning(samples)
    window /= np.sqrt((window**2).sum())
    f = np.asarray(np.fft.rfftfreq(samples, interval_s), float)
    return f, np.fft.rfft(signals[..., :samples] * window, axis=-1)


def parts_of_records(records: Sequence[MotionRecord]) -> list[list[UniformPart]]:
    """``uniform_parts`` of every record."""
    return [uniform_parts(record, k, name_of(record, k)) for k, record in enumerate(records)]


def name_of(record: MotionRecord, index: int) -> str:
    """Name of a record in messages."""
    return record.label or f"motion record {index + 1}"


def uniform_parts(record: MotionRecord, index: int, name: str) -> list[UniformPart]:
    """Parts of a record between its gaps, each on a uniform grid.

    Raises JointIdError when the clock is too uneven, or no part is long enough.
    """
    time = record.time_s[record.start :]
    steps = np.diff(time)
    interval = float(np.median(steps))
    ends = np.flatnonzero(steps > _GAP * interval) + 1
    edges = [0, *ends.tolist(), time.size]
    parts = []
    for begin, end in itertools.pairwise(edges):
        if end - begin < SHORTEST:
            continue
        uneven = np.abs(np.diff(time[begin:end]) / interval - 1)
        if uneven.max() > _MOST_JITTER:
            row = int(uneven.argmax())
            raise JointIdError(
                f"{name}: the clock is too uneven for a spectrum: the step at {time[begin + row]:.6g} s "
                f"is {steps[begin + row] * 1e3:.4g} ms, the median step {interval * 1e3:.4g} ms. Log at "
                "a constant rate."
            )
        used = slice(record.start + begin, record.start + end)
        parts.append(_uniform(record, index, used))
    if not parts:
        raise JointIdError(
            f"{name}: no segment without a gap has {SHORTEST} samples (median step "
            f"{interval * 1e3:.4g} ms). Log without interruptions."
        )
    return parts


def _uniform(record: MotionRecord, index: int, used: slice) -> UniformPart:
    time, theta, tau = record.time_s[used], record.theta_rad[used].T, record.tau_Nm[used].T
    interval = float((time[-1] - time[0]) / (time.size - 1))
    grid = time[0] + interval * np.arange(time.size)
    if np.abs(time - grid).max() > _UNIFORM * interval:
        theta = CubicSpline(time, theta, axis=1)(grid)
        if record.torque_hold:  # the mean over each new step keeps the impulse
            impulse = np.concatenate([np.zeros((len(tau), 1)), np.cumsum(tau * _steps(time), axis=1)], 1)
            edges = np.append(time, time[-1] + interval)
            ends = np.append(grid, grid[-1] + interval)
            tau = np.diff([np.interp(ends, edges, each) for each in impulse], axis=1) / interval
        else:
            tau = CubicSpline(time, tau, axis=1)(grid)
    return UniformPart(index, interval, np.asarray(theta), np.asarray(tau), record.torque_hold)


def _steps(time: Floats) -> Floats:
    steps = np.diff(time)
    return np.append(steps, steps.mean())
