"""Phasors of records, equations (2)-(4): one complex number per signal, with its noise.

Convention: f(t) = a sin ωt + b cos ωt = Im(y e^{iωt}) with y = a + ib: a derivative is a factor iω.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.polynomial.legendre import legvander

from jointid.arrays import Complexes, Floats, whole_number
from jointid.errors import JointIdError
from jointid.phasors.fitted_sine import SineFit, padded
from jointid.phasors.segment import Segment
from jointid.phasors.sensor_steps import may_have_steps, sharing, step_variance, unresolved_variance
from jointid.phasors.settling import settling_change
from jointid.phasors.sine_fit import fit_sines
from jointid.phasors.spectrum import frequency_found
from jointid.records import SineRecord, require_equal_joints

MANY_HARMONICS = 31
"""Harmonics of Coulomb friction fall as 1/h; this many resolve sticking over a thirtieth of a period."""

_VISIBLE = 6.0
"""Standard errors by which a harmonic exceeds the noise."""

_SUPERPOSED = 0.01
"""Constant velocity over the largest of the sines; below it, it is noise or slow drift."""
_PER_ROW = ("labels", "segments")
"""Fields of ``Phasors`` that are tuples."""


@dataclass(frozen=True, eq=False)
class Phasors:
    """Phasors of r records of n joints, equations (2)-(4), with figures of each record's quality."""

    omega: Floats
    """Excitation frequencies, shape (r,), rad/s."""
    q: Complexes
    """Motor angles, shape (r, n), rad."""
    tau: Complexes
    """Motor torques as they act, corrected for hold and delay, shape (r, n), N·m."""
    covariance: Complexes
    """Noise covariance E[δz δzᴴ] of z = [q; τ], shape (r, 2n, 2n), including leakage of harmonics over
    an incomplete period; a diagonal entry is the variance of a complex number, twice that of its real
    part."""
    degrees_of_freedom: Floats
    """Degrees of freedom of each covariance, shape (r,); they grow with the number of periods."""
    duration_s: Floats
    """Length of each record, shape (r,), s; noise variances are inversely proportional to it."""
    harmonics: Complexes = field(default_factory=lambda: np.zeros(0, complex))
    """Phasors of z at ω, 2ω, 3ω ... fitted together, shape (r, H, 2n). Row 0 is z without leakage of
    harmonics over an incomplete period. Zero for harmonics that are not in the fit."""
    harmonic_covariance: Complexes = field(default_factory=lambda: np.zeros(0, complex))
    """Noise covariance of each harmonic, shape (r, H, 2n, 2n)."""
    drift: Floats = field(default_factory=lambda: np.zeros(0))
    """Constant velocity superposed on each motor's sine, shape (r, n), rad/s."""
    mean_angle: Floats = field(default_factory=lambda: np.zeros(0))
    """Mean angle of each motor in a sine, shape (r, n), rad."""
    mean_torque: Floats = field(default_factory=lambda: np.zeros(0))
    """Mean torque of each motor in a sine, such as that of gravity, shape (r, n), N·m."""
    settling: Floats = field(default_factory=lambda: np.zeros(0))
    """Difference of z between the first quarter and the second half of a record, relative to z,
    shape (r, 2n); NaN with too few periods."""
    settling_noise: Floats = field(default_factory=lambda: np.zeros(0))
    """Standard error of ``settling``, shape (r, 2n)."""
    frequency_found_hz: Floats = field(default_factory=lambda: np.zeros(0))
    """Frequency of the motor angle, from the drift of its phase, shape (r,), Hz."""
    labels: tuple[str, ...] = ()
    """Name of each record, for messages and plots."""
    segments: Sequence[Segment | None] | np.ndarray = ()
    """Segment of each row that comes from a motion record, None for a sine, as an array of shape (r,).
    Its harmonics are multiples of one over its length, zero outside its band."""
    harmonic_rounding: Floats = field(default_factory=lambda: np.zeros(0))
    """Part of the variances in ``harmonic_covariance`` from rounding that repeats with the motion, which
    differs by record, shape (r, H, 2n)."""
    hold_s: Floats = field(default_factory=lambda: np.zeros(0))
    """Time for which each torque sample is held, shape (r,), s; 0 where it is not."""
    torque_delay_s: Floats = field(default_factory=lambda: np.zeros(0))
    """Delay of the torque that ``tau`` is corrected for, shape (r,), s."""
    progress: Floats = field(default_factory=lambda: np.zeros(0))
    """Slow changes over the records: half the Legendre polynomials of degree 1 to 3 at the place of each
    row, less their mean, shape (r, 3)."""

    def __post_init__(self) -> None:
        rows, n = np.full(np.size(self.omega), None, dtype=object), self.q.shape[1]
        unknown = np.full((rows.size, 2 * n), np.nan)
        usual = {
            "harmonics": self.z[:, None],
            "harmonic_covariance": self.covariance[:, None],
            "drift": np.zeros((rows.size, n)),
            **dict.fromkeys(("mean_angle", "mean_torque"), np.zeros((rows.size, n))),
            "settling": unknown,
            "settling_noise": unknown,
            "frequency_found_hz": np.asarray(self.omega) / (2 * np.pi),
            "hold_s": np.zeros(rows.size),
            "torque_delay_s": np.zeros(rows.size),
            "progress": slow_changes(rows.size),
            "labels": ("",) * rows.size,
        }
        for name, values in usual.items():
            if not np.size(getattr(self, name)):
                object.__setattr__(self, name, values)
        if not self.harmonic_rounding.size:
            object.__setattr__(self, "harmonic_rounding", np.zeros(self.harmonics.shape))
        if len(self.segments):
            rows[:] = self.segments
        object.__setattr__(self, "segments", rows)

    @property
    def is_superposed(self) -> bool:
        """Whether a constant velocity is added to the sines of a joint, beyond noise and slow drift."""
        velocity = self.omega[:, None] * np.abs(self.q)
        return bool(np.any(np.abs(self.drift).max(axis=0) > _SUPERPOSED * velocity.max(axis=0)))

    @classmethod
    def joined(cls, parts: Sequence[Phasors]) -> Phasors:
        """Return the rows of several phasors, with as many harmonics as the largest has."""
        most = max(part.harmonics.shape[1] for part in parts)

        def every(name: str) -> np.ndarray:
            each = [getattr(part, name) for part in parts]
            return np.concatenate([padded(a, most) for a in each] if "harmonic" in name else each)

        arrays = {f.name: every(f.name) for f in fields(cls) if f.name not in _PER_ROW}
        labels = tuple(label for part in parts for label in part.labels)
        return cls(**arrays, labels=labels, segments=np.concatenate([p.segments for p in parts]))

    @property
    def motion(self) -> np.ndarray:
        """Mask of the rows from motion records, shape (r,)."""
        return np.array([segment is not None for segment in self.segments], dtype=bool)

    @property
    def torque_size(self) -> Floats:
        """Amplitude of the torque's fundamental (of all lines together for a motion), (r, n), N·m."""
        whole = np.linalg.norm(self.harmonics[..., self.n :], axis=1)
        return np.where(self.motion[:, None], whole, np.abs(self.tau))

    @property
    def excited(self) -> Floats:
        """Frequencies of the fundamentals of sines and of all lines of motions, rad/s."""
        orders = np.arange(1, self.harmonics.shape[1] + 1)
        known = np.any(self.harmonics != 0, axis=2) & self.motion[:, None]
        known[:, 0] |= ~self.motion
        return np.asarray((self.omega[:, None] * orders)[known])

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    @property
    def z(self) -> Complexes:
        """Motor angles and torques side by side, shape (r, 2n)."""
        return np.hstack([self.q, self.tau])

    @property
    def standard_deviation(self) -> Floats:
        """Root of the variance of each complex number in z, shape (r, 2n)."""
        return np.asarray(np.sqrt(np.abs(np.einsum("rjj->rj", self.covariance))))

    @property
    def signal_to_noise(self) -> Floats:
        """Amplitude over standard deviation of each number in z, shape (r, 2n); inf without noise."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.abs(self.z) / self.standard_deviation)

    @property
    def total_harmonic_distortion(self) -> Floats:
        """Amplitude of the harmonics above the first over that of the first, (r, 2n); NaN if unknown."""
        if self.harmonics.shape[1] == 1:
            return np.full(self.z.shape, np.nan)
        overtones = np.linalg.norm(self.harmonics[:, 1:], axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(overtones / np.abs(self.harmonics[:, 0]))

    def require_records(self) -> None:
        """Raise JointIdError if there is no sine record, as in a study of motions alone."""
        if not self.omega.size:
            raise JointIdError(
                "There is no sine record: measure sines, or identify motions with identify_motion."
            )

    def by_frequency(self) -> list[tuple[float, np.ndarray]]:
        """Angular frequencies in ascending order, each with the indices of its records."""
        self.require_records()
        ordered = self.omega[order := np.argsort(self.omega, kind="stable")]
        gaps = np.flatnonzero(np.diff(ordered) > 1e-9 * ordered[:-1]) + 1
        return [(float(self.omega[group[0]]), group) for group in np.split(order, gaps)]

    def series(self) -> list[np.ndarray]:
        """Indices of the first record of every frequency, then of the second ones, and so on."""
        groups = [group for _, group in self.by_frequency()]
        most = max(group.size for group in groups)
        return [np.array([g[k] for g in groups if g.size > k]) for k in range(most)]

    def select(self, records: Sequence[int] | np.ndarray) -> Phasors:
        """Return the phasors of some records only, by index or boolean mask."""
        index = np.arange(self.omega.size)[np.asarray(records)]
        arrays = {f.name: getattr(self, f.name)[index] for f in fields(self) if f.name not in _PER_ROW}
        segments = np.asarray(self.segments, dtype=object)[index]
        return Phasors(**arrays, labels=tuple(self.labels[i] for i in index), segments=segments)


def extract_phasors(records: Sequence[SineRecord], *, harmonics: int | None = None) -> Phasors:
    """Fit sine, cosine, offset and trend to every signal; equation (2) is the case of whole periods.

    Parameters
    ----------
    records : sequence of SineRecord
        Of the same joints. The window need not span whole periods.
    harmonics : int, optional
        Highest harmonic of a second fit. By default 3, or 31 (``MANY_HARMONICS``) if these exceed the
        noise, since they then show friction.

    Returns
    -------
    Phasors
        A held torque is multiplied by e^{-iωT/2} sinc(ωT/2), a torque with delay d by e^{-iωd}, each
        harmonic at its own frequency.

    Raises
    ------
    JointIdError
        When there is no record, the records differ in their number of joints, or one is too short.
    """
    records = _checked(records)
    if harmonics is not None:
        harmonics = whole_number("harmonics", harmonics, 1)
    fits = fit_sines(records, harmonics or 3)
    if harmonics is None and any(map(_distorted, records, fits)):
        fits = fit_sines(records, MANY_HARMONICS)
    n, count = records[0].n, len(fits[0].harmonics)
    omega = np.array([record.omega for record in records])
    timing = np.ones((len(records), count, 2 * n), complex)
    delay_s: Floats = np.array([record.torque_delay_s for record in records])
    hold_s: Floats = np.array([r.usual_interval_s if r.torque_hold else 0.0 for r in records])
    angular: Floats = omega[:, None] * np.arange(1, count + 1)
    timing[:, :, n:] = _torque_timing(angular, hold_s[:, None], delay_s[:, None])[:, :, None]
    z = np.array([fit.fundamental for fit in fits]) * timing[:, 0]
    covariance = np.array([fit.covariance for fit in fits], dtype=np.complex128)
    covariance += _rounding(fits)
    # The sensors are the same in all records: a few records show whether they have steps.
    stepped = count > 3 or any(may_have_steps(r) for r in records[:: max(1, len(records) // 4)])
    rounding = np.zeros((len(records), count, 2 * n))
    for k, fit in enumerate(fits):
        if stepped or _visible(fit):
            white, rounding[k] = step_variance(records[k], fit)
            covariance[k][:, range(2 * n), range(2 * n)] += white
    if rounding.any():
        covariance[:, :, range(2 * n), range(2 * n)] += rounding * sharing(records, fits)[:, None]
    covariance[:, :, range(n), range(n)] += unresolved_variance(records)[:, None]
    covariance *= timing[..., :, None] * timing[..., None, :].conj()
    # Leakage of harmonics over an incomplete period: plain fit less the fit with harmonics.
    leakage = z - np.array([fit.harmonics[0] for fit in fits]) * timing[:, 0]
    plain = covariance[:, 0] + leakage[:, :, None] * leakage[:, None].conj()
    settled = np.array([settling_change(fit.local) for fit in fits])
    with np.errstate(divide="ignore", invalid="ignore"):
        settling, settling_noise = settled.swapaxes(0, 1) / np.abs([fit.fundamental for fit in fits])
    return Phasors(
        omega=omega,
        q=z[:, :n],
        tau=z[:, n:],
        covariance=plain,
        degrees_of_freedom=np.array([float(fit.degrees_of_freedom) for fit in fits]),
        duration_s=np.array([record.periods / record.frequency_hz for record in records]),
        harmonics=np.array([fit.harmonics for fit in fits]) * timing,
        harmonic_covariance=covariance,
        drift=np.array([fit.drift[:n] for fit in fits]),
        mean_angle=np.array([fit.offset[:n] for fit in fits]),
        mean_torque=np.array([fit.offset[n:] for fit in fits]),
        settling=settling,
        settling_noise=settling_noise,
        frequency_found_hz=np.array([*map(frequency_found, records, fits)]),
        labels=tuple(r.label or f"record {i}" for i, r in enumerate(records, start=1)),
        harmonic_rounding=rounding * np.abs(timing) ** 2,
        hold_s=hold_s,
        torque_delay_s=delay_s,
    )


def slow_changes(count: int) -> Floats:
    """``Phasors.progress`` of consecutive rows."""
    found = 0.5 * legvander(np.linspace(-1, 1, count), 3)[:, 1:]
    return np.asarray(found - found.sum(axis=0) / max(count, 1))


def no_phasors(n: int) -> Phasors:
    """Return the phasors of no record of n joints."""
    none, signals = np.zeros(0), np.zeros((0, n), complex)
    return Phasors(none, signals, signals, np.zeros((0, 2 * n, 2 * n), complex), none, none)


def _checked(records: Sequence[SineRecord]) -> tuple[SineRecord, ...]:
    records = (records,) if isinstance(records, SineRecord) else records
    if not isinstance(records, Iterable):
        raise JointIdError(f"records: expected a list of SineRecord, got {records!r:.80}.")
    records = tuple(records)
    if not all(isinstance(record, SineRecord) for record in records):
        raise JointIdError(
            f"records: expected SineRecord values only, got {records!r:.50}. Identify motion records "
            "with identify_motion or analyse."
        )
    if not records:
        raise JointIdError("There are no records to extract phasors from: give at least one.")
    require_equal_joints(records)
    return records


def _rounding(fits: Sequence[SineFit]) -> Floats:
    """Variance from floating-point rounding, diagonal (r, 1, 2n, 2n)."""
    size = np.abs([fit.offset for fit in fits]) + np.abs([fit.fundamental for fit in fits])
    return np.asarray(((1e-14 * size) ** 2)[:, None, :, None] * np.eye(size.shape[1]))


def _distorted(record: SineRecord, fit: SineFit) -> bool:
    """Whether the record has harmonics that noise and quantisation do not explain."""
    if not _visible(fit):
        return False
    steps = step_variance(record, fit).sum(axis=0)
    return _visible(replace(fit, covariance=fit.covariance + steps[..., None] * np.eye(steps.shape[1])))


def _visible(fit: SineFit) -> bool:
    """Whether a harmonic exceeds the noise, and 1e-6 of its signal."""
    power = np.abs(fit.harmonics) ** 2
    noise = np.abs(np.einsum("hjj->hj", fit.covariance))
    visible = (power > 1e-12 * power[0]) & (power > _VISIBLE**2 * noise)
    return bool(visible[1:].any())


def _torque_timing(omega: Floats, hold_s: Floats, delay_s: Floats) -> Complexes:
    """Acting torque over sampled torque, shape (r, H): a hold of T delays by T/2 and attenuates."""
    held = np.sinc(omega * hold_s / (2 * np.pi))  # numpy's sinc(x) is sin(πx)/(πx)
    return np.asarray(held * np.exp(-1j * omega * (delay_s + hold_s / 2)))
