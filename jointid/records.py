"""Logs of one experiment: motor position and torque of n joints over time."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array, set_fields
from jointid.errors import JointIdError
from jointid.wording import counted

_GLANCE = 64
_LAG = 64
"""Samples between two times whose difference shows the usual sample interval."""
_FEWEST = 16
"""Fewest samples of a motion record: fewer leave no equation beyond the end terms."""


@dataclass(frozen=True, eq=False)
class JointRecord:
    """Fields and checks that a sine and any other motion have in common."""

    time_s: Floats
    """Sample times, shape (N,), strictly increasing, s. Jitter is allowed and measured."""
    theta_rad: Floats
    """Motor angles, shape (N, n), each joint contiguous in memory, motor side, rad. A single joint may
    give shape (N,)."""
    tau_Nm: Floats
    """Motor torques, like the angles, N·m."""
    torque_hold: bool = False
    """Whether the torque of a sample is held until the next one (zero-order hold), as a digital
    controller does, or the samples are the instantaneous torque."""
    torque_delay_s: float = 0.0
    """The torque acts this much after its sample, s."""
    start_s: float | None = None
    """Start of the steady state on the clock of ``time_s``; earlier rows are kept but not used."""
    pose: str | None = None
    """Name of the pose; M2 depends on the pose, K and D do not."""
    label: str = ""
    """Name for messages and plots, for instance the file name."""
    start: int = field(init=False, repr=False)
    """Index of the first sample used."""
    interval_s: float = field(init=False)
    """Mean sample interval of the samples used, s."""
    jitter_s: float = field(init=False)
    """Largest distance of a used sample time from its place on the uniform grid, s."""

    def __post_init__(self) -> None:
        delay = float(finite_array("torque_delay_s", self.torque_delay_s, ndim=0))
        time = finite_array("time_s", self.time_s, ndim=1)
        theta = _channels("theta_rad", self.theta_rad, time.size)
        tau = _channels("tau_Nm", self.tau_Nm, time.size)
        if theta.shape != tau.shape:
            raise JointIdError(
                f"theta_rad has {counted(theta.shape[1], 'joint')} and tau_Nm {tau.shape[1]}: "
                "give position and torque of the same joints."
            )
        _require_increasing(time)
        if not isinstance(self.torque_hold, bool | np.bool_):
            raise JointIdError(f"torque_hold = {self.torque_hold!r}: expected true or false.")
        if not isinstance(self.label, str) or not isinstance(self.pose, str | None):
            raise JointIdError(f"label and pose must be text, got {self.label!r} and {self.pose!r}.")
        begin = None if self.start_s is None else float(finite_array("start_s", self.start_s, ndim=0))
        start = 0 if begin is None else int(np.searchsorted(time, begin - 1e-9))
        if start >= time.size:
            raise JointIdError(f"start_s = {begin:g} s lies after the last sample at {time[-1]:g} s.")
        used = time[start:]
        interval = float((used[-1] - used[0]) / (used.size - 1)) if used.size > 1 else 0.0
        set_fields(
            self,
            time_s=time,
            theta_rad=theta,
            tau_Nm=tau,
            torque_hold=bool(self.torque_hold),
            torque_delay_s=delay,
            start=start,
            interval_s=interval,
            jitter_s=float(np.abs(used - used[0] - interval * np.arange(used.size)).max()),
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.theta_rad.shape[1])

    @property
    def samples(self) -> int:
        """Number of samples used, those from ``start`` on."""
        return self.time_s.size - self.start

    @property
    def usual_interval_s(self) -> float:
        """Sample interval without gaps, s; a median over several samples, for times may be rounded."""
        used, lag = self.time_s[self.start :], min(_LAG, max(1, self.samples // 4))
        return float(np.median(used[lag:] - used[:-lag])) / lag

    @property
    def constant(self) -> np.ndarray:
        """Whether all used samples of a signal are equal, shape (2n,): the angles, then the torques."""
        return np.array([_is_constant(c[self.start :]) for c in (*self.theta_rad.T, *self.tau_Nm.T)])


@dataclass(frozen=True, eq=False)
class _OfOneFrequency:
    """The first field of a sine record; its place in the bases makes it the first argument."""

    frequency_hz: float
    """Excitation frequency, Hz."""


@dataclass(frozen=True, eq=False)
class SineRecord(JointRecord, _OfOneFrequency):
    """A log of n joints that move in a sine of one known frequency under closed-loop control.

    The first arguments are ``frequency_hz``, ``time_s``, ``theta_rad`` and ``tau_Nm``.

    Raises JointIdError on shapes that disagree, values that are not finite, times that do not
    increase, less than one period of data after ``start_s``, or a frequency at or above half the sample
    rate.
    """

    def __post_init__(self) -> None:
        frequency = float(finite_array("frequency_hz", self.frequency_hz, ndim=0))
        if frequency <= 0:
            raise JointIdError(f"frequency_hz = {frequency:g} Hz: it must be positive.")
        set_fields(self, frequency_hz=frequency)
        super().__post_init__()
        used, interval = self.time_s.size - self.start, self.interval_s
        if used * interval * frequency < 1 - 1e-9:
            raise JointIdError(
                f"{used} usable samples last {used * interval:.4g} s, less than one period "
                f"of {frequency:g} Hz ({1 / frequency:.4g} s). Record longer, or check the "
                "frequency and the unit of time (seconds)."
            )
        if frequency * interval >= 0.5:
            raise JointIdError(
                f"frequency_hz = {frequency:g} Hz is at or above half the sample rate of "
                f"{1 / interval:.4g} Hz. Check the frequency and the unit of time (seconds)."
            )

    @property
    def omega(self) -> float:
        """Excitation frequency, rad/s."""
        return 2 * np.pi * self.frequency_hz

    @property
    def excitation(self) -> str:
        """The frequency in words."""
        return f"{self.frequency_hz:.6g} Hz"

    @property
    def periods(self) -> float:
        """Number of periods of the samples used; need not be whole."""
        return self.samples * self.interval_s * self.frequency_hz


@dataclass(frozen=True, eq=False)
class MotionRecord(JointRecord):
    """A log of n joints in any motion around one pose: a sweep, random motion, the robot's own moves.

    Raises JointIdError on shapes that disagree, values that are not finite, times that do not
    increase, fewer than 16 samples after ``start_s``, or a band that is empty or reaches half the sample
    rate.
    """

    arm_rad: Floats | None = None
    """Joint angles measured behind the gears, shape (N, n), rad; a column of NaN for a joint without a
    sensor."""
    band_hz: tuple[float, float] | None = None
    """Lowest and highest frequency to use, Hz; None: chosen from the record."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.samples < _FEWEST:
            raise JointIdError(
                f"A motion record needs at least {_FEWEST} samples; this one has {self.samples}: "
                "record longer, or correct start_s."
            )
        set_fields(self, arm_rad=self._checked_arm(), band_hz=self._checked_band())

    @property
    def excitation(self) -> str:
        """The band in words."""
        band = self.band_hz
        return "automatic band" if band is None else f"{band[0]:.3g}–{band[1]:.3g} Hz"

    def _checked_arm(self) -> Floats | None:
        if self.arm_rad is None:
            return None
        given, without = self.arm_rad, np.zeros(self.n, dtype=bool)
        if isinstance(given, np.ndarray) and given.dtype.kind == "f" and given.size:
            without = np.atleast_1d(np.isnan(given).all(axis=0))
            given = np.where(without, 0.0, given)
        arm = _channels("arm_rad", given, self.time_s.size)
        if arm.shape[1] != self.n:
            raise JointIdError(
                f"arm_rad has {counted(arm.shape[1], 'joint')}, theta_rad {self.n}: give one column "
                "per joint, NaN for a joint without a sensor."
            )
        arm = np.where(without, np.nan, arm)
        arm.setflags(write=False)
        return None if without.all() else arm

    def _checked_band(self) -> tuple[float, float] | None:
        if self.band_hz is None:
            return None
        band = finite_array("band_hz", self.band_hz, ndim=1).tolist()
        if len(band) != 2 or not 0 <= band[0] < band[1]:
            given = ", ".join(f"{hertz:g}" for hertz in band)
            raise JointIdError(
                f"band_hz = [{given}] Hz: expected a lowest and a highest, 0 ≤ lowest < highest."
            )
        low, high = band
        if high * self.interval_s >= 0.5:
            raise JointIdError(
                f"band_hz = [{low:g}, {high:g}] Hz reaches half the sample rate of "
                f"{1 / self.interval_s:.4g} Hz. Lower it, or check the unit of time_s (seconds)."
            )
        return low, high


def _is_constant(samples: Floats) -> bool:
    """Whether all samples are equal; for most signals the first few show that they are not."""
    return all(bool(np.all(part == samples[0])) for part in (samples[:_GLANCE], samples))


def _channels(name: str, value: ArrayLike, samples: int) -> Floats:
    try:
        column = np.ndim(value) == 1
    except ValueError:  # ragged rows; finite_array says so
        column = False
    array = finite_array(name, np.asarray(value)[:, None] if column else value, ndim=2, order="F")
    if array.shape[0] != samples or array.shape[1] == 0:
        raise JointIdError(
            f"{name} has shape {array.shape}; expected one row for each of the {samples} samples of "
            "time_s and one column per joint."
        )
    return array


def _require_increasing(time: Floats) -> None:
    if time.size < 2:
        raise JointIdError(
            f"time_s has {counted(time.size, 'sample')}: a record needs at least one period."
        )
    steps = np.diff(time)
    if steps.min() <= 0:
        row = int(np.argmax(steps <= 0)) + 1
        fault = "repeats" if steps[row - 1] == 0 else "goes back from"
        raise JointIdError(
            f"time_s {fault} {time[row - 1]:.9g} s at row {row} (value {time[row]:.9g} s): times must "
            "increase. Sort the rows, remove duplicates, and keep one experiment per file."
        )


def require_equal_joints(records: Sequence[JointRecord]) -> None:
    """Raise JointIdError when the records do not all have the same number of joints."""
    first = records[0].n
    for number, record in enumerate(records, start=1):
        if record.n != first:
            raise JointIdError(
                f"{record.label or f'record {number}'} has {counted(record.n, 'joint')}, the first "
                f"record {first}: records that are analysed together must have the same joints."
            )


def require_torques(records: Sequence[JointRecord]) -> None:
    """Refuse a joint that moves while its torque is the same number throughout all records.

    Raises JointIdError when there is one.
    """
    constant = np.array([record.constant for record in records])
    n = constant.shape[1] // 2
    lost = constant[:, n:].all(axis=0) & ~constant[:, :n].all(axis=0)
    if lost.any():
        j = int(np.argmax(lost))
        moving = int(np.argmin(constant[:, j]))
        record = records[moving]
        raise JointIdError(
            f"Joint {j + 1} moves, but its torque tau_m{j + 1}_Nm is constant in every record: "
            f"{record.tau_Nm[record.start, j]:.6g} N·m in {record.label or f'record {moving + 1}'}. "
            f"K{j + 1} and D{j + 1} cannot be identified. Log the torque or current of motor {j + 1}."
        )
