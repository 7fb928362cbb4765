"""From records to phasors, equations (2)-(4): one complex number per signal, with its noise.

Convention: f(t) = a sin ωt + b cos ωt = Im(y e^{iωt}) with y = a + ib: a derivative is a factor iω.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.records import SineRecord
from jointid.sine_fit import SineFit, fit_sines


@dataclass(frozen=True, eq=False)
class Phasors:
    """Fourier coefficients of r records of n joints, with what they say about each record's quality."""

    omega: Floats
    """Excitation frequencies, shape (r,), rad/s."""
    q: Complexes
    """Motor angles, shape (r, n), rad."""
    tau: Complexes
    """Motor torques as they act, corrected for hold and delay, shape (r, n), N·m."""
    covariance: Complexes
    """Noise covariance E[δz δzᴴ] of z = [q; τ], shape (r, 2n, 2n); a diagonal entry is the variance
    of a complex number, twice that of its real part."""
    freedom: Floats
    """Degrees of freedom of each covariance, shape (r,); few periods make few."""
    harmonics: Complexes
    """Phasors of z at ω, 2ω, 3ω ..., shape (r, H, 2n); row 0 repeats q and tau."""
    settling: Floats
    """How far z of the first quarter of a record is from z of its second half, relative to z,
    shape (r, 2n); NaN when there are too few periods to tell."""
    settling_noise: Floats
    """Standard error of ``settling``, shape (r, 2n)."""
    frequency_found_hz: Floats
    """The frequency that the motor angle has, from the drift of its phase, shape (r,), Hz."""
    labels: tuple[str, ...]
    """Name of each record, for messages and plots."""

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
        """Amplitude of all harmonics above the first over that of the first, shape (r, 2n)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.linalg.norm(self.harmonics[:, 1:], axis=1) / np.abs(self.z))

    def select(self, records: Sequence[int] | np.ndarray) -> Phasors:
        """Return the phasors of some records only, by index or boolean mask."""
        index = np.arange(self.omega.size)[np.asarray(records)]
        return Phasors(
            omega=self.omega[index],
            q=self.q[index],
            tau=self.tau[index],
            covariance=self.covariance[index],
            freedom=self.freedom[index],
            harmonics=self.harmonics[index],
            settling=self.settling[index],
            settling_noise=self.settling_noise[index],
            frequency_found_hz=self.frequency_found_hz[index],
            labels=tuple(self.labels[i] for i in index),
        )


def extract_phasors(records: Sequence[SineRecord], *, harmonics: int = 1) -> Phasors:
    """Fit sine, cosine, offset and drift to every signal; equation (2) is the case of whole periods.

    Parameters
    ----------
    records : sequence of SineRecord
        Of the same joints. The window need not span whole periods.
    harmonics : int, default 1
        Fit the harmonics up to this one together with the fundamental. More than 1 tells the
        distortion, and keeps harmonics from leaking into the fundamental of a broken period.

    Returns
    -------
    Phasors
        A held torque is corrected by e^{-iωT/2} sinc(ωT/2), a delayed one by e^{-iωδ}, each
        harmonic at its own frequency.

    Raises
    ------
    JointIdError
        When there is no record, or the records differ in their number of joints.
    """
    records = tuple(records)
    if not records:
        raise JointIdError("There are no records to extract phasors from: give at least one.")
    if harmonics < 1:
        raise JointIdError(f"harmonics = {harmonics}: must be 1 (the fundamental) or more.")
    n = records[0].n
    for number, record in enumerate(records, start=1):
        if record.n != n:
            raise JointIdError(
                f"{record.label or f'record {number}'} has {record.n} joint(s), the first record {n}: "
                "records that are analysed together must have the same joints."
            )
    fits = fit_sines(records, harmonics)
    omega = np.array([record.omega for record in records])
    timing = _torque_timing(records, omega[:, None] * np.arange(1, harmonics + 1))
    factor = np.ones((len(records), harmonics, 2 * n), complex)
    factor[:, :, n:] = timing[:, :, None]
    z = np.array([fit.harmonics for fit in fits]) * factor
    first = factor[:, 0]
    covariance = np.array([fit.covariance for fit in fits])
    covariance *= first[:, :, None] * first[:, None, :].conj()
    settling, noise = _settling(fits)
    return Phasors(
        omega=omega,
        q=z[:, 0, :n],
        tau=z[:, 0, n:],
        covariance=covariance,
        freedom=np.array([float(fit.freedom) for fit in fits]),
        harmonics=z,
        settling=settling,
        settling_noise=noise,
        frequency_found_hz=np.array(
            [_frequency_found(r, f) for r, f in zip(records, fits, strict=True)]
        ),
        labels=tuple(r.label or f"record {i}" for i, r in enumerate(records, start=1)),
    )


def _torque_timing(records: Sequence[SineRecord], omega: Floats) -> Complexes:
    """Acting torque over sampled torque, shape (r, H): a hold of T lags by T/2 and attenuates."""
    delay = np.array([record.torque_delay_s for record in records])
    hold = np.array([record.interval_s if record.torque_hold else 0.0 for record in records])
    held = np.sinc(omega * hold[:, None] / (2 * np.pi))  # numpy's sinc(x) is sin(πx)/(πx)
    return np.asarray(held * np.exp(-1j * omega * (delay + hold / 2)[:, None]))


def _settling(fits: Sequence[SineFit]) -> tuple[Floats, Floats]:
    """Change of the local phasor from the first quarter of the blocks to the second half."""
    change = np.full((len(fits), fits[0].harmonics.shape[1]), np.nan)
    noise = np.full_like(change, np.nan)
    for row, fit in enumerate(fits):
        blocks = len(fit.deviations)
        if blocks < 4:
            continue
        local = blocks * fit.deviations  # from the phasor of the whole record
        early, late = local[: blocks // 4], local[blocks // 2 :]
        with np.errstate(divide="ignore", invalid="ignore"):
            amplitude = np.abs(fit.harmonics[0])
            change[row] = np.abs(early.mean(axis=0) - late.mean(axis=0)) / amplitude
            variance = (np.abs(late - late.mean(axis=0)) ** 2).sum(axis=0) / (len(late) - 1)
            noise[row] = np.sqrt(variance * (1 / len(early) + 1 / len(late))) / amplitude
    return change, noise


def _frequency_found(record: SineRecord, fit: SineFit) -> float:
    """Stated frequency, corrected by how fast the phase of the largest motion turns over the record."""
    largest = int(np.argmax(np.abs(fit.harmonics[0, : record.n])))
    phasor, local = fit.harmonics[0, largest], len(fit.deviations) * fit.deviations[:, largest]
    scatter = np.sqrt(np.mean(np.abs(local) ** 2))
    if abs(phasor) == 0 or scatter > 0.5 * abs(phasor):
        return _spectral_peak_hz(record, largest)
    if len(local) < 3:
        return record.frequency_hz
    span = record.interval_s * (record.time_s.size - record.start)
    time = span * (np.arange(len(local)) - (len(local) - 1) / 2) / len(local)
    turning = float((local / phasor).imag @ time / (time @ time))
    return record.frequency_hz + turning / (2 * np.pi)


def _spectral_peak_hz(record: SineRecord, joint: int) -> float:
    """Largest line of the spectrum of a motor angle, for a record that contradicts its frequency."""
    signal = record.theta_rad[record.start :, joint]
    ends = np.linspace(signal[0], signal[-1], signal.size)
    spectrum = np.abs(np.fft.rfft((signal - ends) * np.hanning(signal.size)))
    peak = int(np.argmax(spectrum[1:-1])) + 1
    left, centre, right = np.log(np.maximum(spectrum[peak - 1 : peak + 2], 1e-300))
    curvature = left - 2 * centre + right
    shift = 0.0 if curvature == 0 else 0.5 * (left - right) / curvature
    return float((peak + shift) / (signal.size * record.interval_s))
