"""Motion and deflection of a record in one band: one zero-phase filter for every signal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import next_fast_len
from scipy.interpolate import CubicSpline

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.records import MotionRecord
from jointid.robot_models.model import RobotModel

BAND_HZ = 6.0
"""Upper edge of the band where a record states none: rigid motion of a robot, below its resonances."""
_REACH = 4.0
"""Half length of the filter in standard deviations."""


@dataclass(frozen=True)
class GaussianFilter:
    """Zero-phase low-pass filter and its derivatives.

    They use one kernel, so that no signal is filtered more than another.
    """

    interval_s: float
    band_hz: float

    @property
    def width_s(self) -> float:
        """Standard deviation of the kernel; the gain at ``band_hz`` is 1/√2."""
        return float(np.sqrt(np.log(2)) / (2 * np.pi * self.band_hz))

    @property
    def reach(self) -> int:
        """Samples at either end of a record that the filter completes by extrapolation."""
        return int(np.ceil(_REACH * self.width_s / self.interval_s))

    def __call__(self, x: Floats, order: int = 0, *, later_s: float = 0.0) -> Floats:
        """Filter along the first axis, or return the first or second derivative.

        ``later_s`` gives the signal that much later, exactly in the band; for order 0 only.
        """
        if not x.size:
            return x
        m = min(self.reach + int(np.ceil(abs(later_s) / self.interval_s)), len(x) - 1)
        t = self.interval_s * np.arange(-m, m + 1) - later_s
        kernel = np.exp(-0.5 * (t / self.width_s) ** 2)
        kernel /= kernel.sum()
        # moments set exactly: on any sampling, a ramp has the right delay and slope, and a parabola the
        # right curvature; the ends of the kernel that are cut off would shift it by microseconds
        early = t - kernel @ t
        kernel *= 1 - (kernel @ t) / (kernel @ early**2) * early
        if order == 1:
            kernel = kernel * t / np.sum(kernel * t**2)
        if order == 2:
            variance = np.sum(kernel * t**2)
            kernel = kernel * (t**2 - variance)
            kernel *= 2 / np.sum(kernel * t**2)
        ends = (2 * x[0] - x[m:0:-1], x, 2 * x[-1] - x[-2 : -m - 2 : -1])
        padded = np.concatenate(ends)
        return _convolved(padded, kernel[::-1])


def _convolved(x: Floats, kernel: Floats) -> Floats:
    """Convolution along the first axis where the kernel lies within the samples.

    As ``scipy.signal.oaconvolve``, whose import takes a third of a second.
    """
    size = next_fast_len(len(x), real=True)
    gain = np.fft.rfft(kernel, size).reshape(-1, *[1] * (x.ndim - 1))
    found = np.fft.irfft(np.fft.rfft(x, size, axis=0) * gain, size, axis=0)
    return np.asarray(found[len(kernel) - 1 : len(x)])


@dataclass(frozen=True, eq=False)
class BandLimited:
    """One record on a uniform grid. Joint side; N samples, n joints."""

    lowpass: GaussianFilter
    time_s: Floats
    raw: Floats
    """Motor angles through the gear, unfiltered, (N, n), rad."""
    q: Floats
    dq: Floats
    ddq: Floats
    raw_deflection: Floats
    skew_s: Floats
    """Skew that is taken out of the deflection, (n,), s."""
    deflection: Floats
    """Motor minus arm that much later, filtered, (N, n), rad; NaN without a sensor."""

    def aligned(self, skew_s: Floats) -> BandLimited:
        """Return the record with the arm's samples moved to the time of the motor's, skew (n,)."""
        deflection = self.deflection.copy()
        for j in np.flatnonzero(np.isfinite(deflection).all(axis=0)):
            arm = self.raw[:, j] - self.raw_deflection[:, j]
            deflection[:, j] = self.q[:, j] - self.lowpass(arm, later_s=float(skew_s[j]))
        return replace(self, skew_s=skew_s, deflection=deflection)

    def without(self, joints: np.ndarray) -> BandLimited:
        """Return the record without the sensors of some joints, mask (n,)."""
        return replace(self, deflection=np.where(joints, np.nan, self.deflection))

    def by_skew(self, j: int, elastic: Floats) -> Floats:
        """Deflection (N,) by the skew taken out of joint j, with ``elastic`` (N,) in its gear."""
        arm = self.raw[:, j] - elastic
        return np.asarray(self.lowpass(arm) - self.lowpass(arm, later_s=-float(self.skew_s[j])))

    def elastic(self) -> Floats:
        """Deflection without skew and mean, unfiltered, (N, n), rad; 0 without a sensor."""
        elastic = np.zeros_like(self.raw)
        for j in np.flatnonzero(np.isfinite(self.deflection).all(axis=0)):
            arm = CubicSpline(self.time_s, self.raw[:, j] - self.raw_deflection[:, j])
            moved = np.clip(self.time_s + self.skew_s[j], self.time_s[0], self.time_s[-1])
            elastic[:, j] = self.raw[:, j] - arm(moved)
        return np.asarray(elastic - elastic.mean(axis=0))

    @property
    def above_band(self) -> Floats:
        """Deflection above the band, (N, n), rad."""
        return self.raw_deflection - self.lowpass(self.raw_deflection)

    @property
    def inner(self) -> slice:
        """Samples whose filter lies within the record, also where the arm's samples are moved."""
        moved = int(np.abs(self.skew_s).max() / self.lowpass.interval_s)
        ends = self.lowpass.reach + min(moved, len(self.time_s) // 8)
        return slice(ends, len(self.time_s) - ends)


def distinct(given: Sequence[MotionRecord]) -> list[MotionRecord]:
    """Drop repeated records: the same noise twice adds no evidence."""
    found: list[MotionRecord] = []
    for record in given:
        if not any(
            np.array_equal(record.theta_rad, other.theta_rad)
            and np.array_equal(record.tau_Nm, other.tau_Nm)
            for other in found
        ):
            found.append(record)
    return found


def joint_angles(record: MotionRecord, robot: RobotModel) -> Floats:
    """Motor angles through the gears, shape (N, n), rad.

    Raises JointIdError when the robot has another number of joints, or unknown gear ratios.
    """
    if record.n != robot.n:
        raise JointIdError(
            f"The record {record.label!r} has {record.n} joints and the robot {robot.n}: log all of "
            "them, because the torque of one joint depends on the motion of the others."
        )
    if not np.isfinite(robot.coupling).all():
        raise JointIdError("The robot model does not state the gear ratios: add them to its file.")
    return np.asarray(record.theta_rad @ robot.coupling.T)


def band_limited(record: MotionRecord, robot: RobotModel, band_hz: float | None = None) -> BandLimited:
    """Filter one record; the upper edge is ``band_hz``, else the record's own, else ``BAND_HZ``."""
    q = joint_angles(record, robot)[record.start :]
    arm = np.full(q.shape, np.nan) if record.arm_rad is None else record.arm_rad[record.start :].copy()
    time = record.time_s[record.start :]
    if band_hz is None:
        band_hz = BAND_HZ if record.band_hz is None else record.band_hz[1]
    grid = time[0] + record.interval_s * np.arange(time.size)
    band_hz = min(band_hz, 0.2 / record.interval_s)
    lowpass = GaussianFilter(record.interval_s, band_hz)
    if time.size < 8 * lowpass.reach:
        raise JointIdError(
            f"The record {record.label!r} lasts {time[-1] - time[0]:.3g} s: too short for the band up "
            f"to {band_hz:g} Hz. Record longer or give a higher band_hz."
        )
    seen = np.isfinite(arm).all(axis=0)
    if record.jitter_s > 1e-6 * record.interval_s:
        q = CubicSpline(time, q)(grid)
        arm[:, seen] = CubicSpline(time, arm[:, seen])(grid)
    raw, deflection = q - arm, np.full(q.shape, np.nan)
    deflection[:, seen] = lowpass(raw[:, seen])
    return BandLimited(
        lowpass, grid, q, lowpass(q), lowpass(q, 1), lowpass(q, 2), raw, np.zeros(q.shape[1]), deflection
    )
