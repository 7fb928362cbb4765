"""The transfer matrix H from closed-loop records, compared with pyFRF and scipy.signal.csd.

Stepped sine: 18 frequencies × 2 records of 4 s, every frequency a line of the FFT of its record, so
that the FFT estimators have no leakage. Multisine: the same 18 lines at once, two records of 72 s, so
that the measuring time and the root-mean-square motion are the same. All torques are held from sample
to sample; every estimator gets the same correction for it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.signal import csd

from benchmarks.campaign import INERTIA, RATE_HZ, TRUTH
from benchmarks.harness import NOT_INSTALLED, Cell, Table, interleaved, optional
from jointid import (
    Controller,
    Excitation,
    Measurement,
    SineRecord,
    estimate_transfer_matrix,
    extract_phasors,
    motor_response,
    simulate_records,
)

ENCODER_RAD = 2 * np.pi / 65536
TORQUE_NOISE_NM = np.array([0.02, 0.01])
COLUMNS = {
    "estimator": "",
    "data": "",
    "median error of H": ".3f",
    "largest": ".2f",
    "median": "ms",
    "spread": "",
    "× jointid": ".2f",
}


class Data(NamedTuple):
    frequencies_hz: np.ndarray
    records: tuple[SineRecord, ...]
    """Stepped sine, two of each frequency."""
    tau: np.ndarray
    """Of the multisine, (2 records, 2 joints, N), N·m."""
    theta: np.ndarray
    reference: np.ndarray
    """Reference of the joints in the multisine, rad."""
    truth: np.ndarray
    held: np.ndarray
    """Acting torque over sampled torque, shape (f,)."""


def measure(quick: bool) -> list[Table]:
    data = prepare(quick)
    calls = _estimators(data)
    found = {key: call() for key, call in calls.items()}
    names = {" · ".join(key): call for key, call in calls.items()}
    times = interleaved(
        names, against=" · ".join(JOINTID), rounds=2 if quick else 9, patience_s=8.0, warm=False
    )
    rows: list[dict[str, Cell]] = []
    for key in calls:
        error = 100 * np.abs(found[key] - data.truth) / np.abs(data.truth)
        each = times[" · ".join(key)]
        rows.append(
            {
                "estimator": key[0],
                "data": key[1],
                "median error of H": f"{np.median(error):.3f} %",
                "largest": f"{error.max():.2f} %",
                "median": each.median,
                "spread": each.spread,
                "× jointid": each.ratio,
            }
        )
    if optional("pyFRF") is None:
        rows.append({"estimator": f"pyFRF: {NOT_INSTALLED}"})
    title = f"Transfer matrix in closed loop, {data.frequencies_hz.size} frequencies"
    return [Table("transfer_matrix", title, COLUMNS, tuple(rows), (NOTE,))]


JOINTID = ("**jointid** phasors, (17)-(18)", "stepped sine")
NOTE = (
    "Error: of each element of H against the model's own response, median and largest over frequencies "
    "and elements. All estimators that see whole periods use the data equally well; Hann windows smear "
    "the resonances. jointid by default searches 31 harmonics for friction and gives the noise of H, "
    "which the others do not; with harmonics=1 it does what they do, and gives the noise."
)


def prepare(quick: bool) -> Data:
    """Records of both kinds."""
    seconds = 2.0 if quick else 4.0
    lines = np.unique(np.round(np.geomspace(3.0, 30.0, 4 if quick else 18) * 4) / 4)
    excitation = Excitation(duration_s=seconds, velocity_rad_s=8.0)
    common = {"excitation": excitation, "controller": Controller(sample_rate_hz=RATE_HZ)}
    noisy = Measurement(encoder_counts=65536, torque_noise_Nm=TORQUE_NOISE_NM)
    records = simulate_records(INERTIA, TRUTH, lines, measurement=noisy, seed=7, **common)
    clean = simulate_records(INERTIA, TRUTH, lines, **common)
    omega = 2 * np.pi * lines
    held = np.sinc(omega / RATE_HZ / (2 * np.pi)) * np.exp(-0.5j * omega / RATE_HZ)
    tau, theta, reference = _multisine(clean, excitation, lines)
    return Data(lines, records, tau, theta, reference, motor_response(omega, INERTIA, TRUTH), held)


def _multisine(
    clean: tuple[SineRecord, ...], excitation: Excitation, lines: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Without friction the loop is linear: the response to a sum is the sum of the responses.

    Each record is periodic over its window, so rolling it turns its phase. Noise comes afterwards.
    """
    rng = np.random.default_rng(18)
    samples = clean[0].time_s.size
    scale = 1 / np.sqrt(lines.size)
    A = excitation.amplitudes(2 * np.pi * lines, 2)[:, None, :] * excitation.weights(2)
    tau, theta, reference = (np.zeros((2, 2, samples)) for _ in range(3))
    for line, f in enumerate(lines):
        shift = int(rng.integers(samples))
        for k in range(2):
            record = clean[2 * line + k]
            wanted = np.outer(A[line, k], np.exp(2j * np.pi * f * record.time_s)).imag
            tau[k] += scale * np.roll(record.tau_Nm.T, shift, axis=1)
            theta[k] += scale * np.roll(record.theta_rad.T, shift, axis=1)
            reference[k] += scale * np.roll(wanted, shift, axis=1)
    repeat = (1, 1, lines.size)  # the measuring time of the stepped sine
    tau, theta, reference = (np.tile(x, repeat) for x in (tau, theta, reference))
    tau += TORQUE_NOISE_NM[:, None] * rng.standard_normal(tau.shape)
    return tau, np.rint(theta / ENCODER_RAD) * ENCODER_RAD, reference


def _estimators(data: Data) -> dict[tuple[str, str], Callable[[], np.ndarray]]:
    segment = data.records[0].time_s.size
    calls: dict[tuple[str, str], Callable[[], np.ndarray]] = {
        JOINTID: lambda: estimate_transfer_matrix(extract_phasors(data.records)).H,
        ("**jointid**, harmonics=1", "stepped sine"): lambda: (
            estimate_transfer_matrix(extract_phasors(data.records, harmonics=1)).H
        ),
    }
    if optional("pyFRF") is not None:
        for kind in ("H1", "H2"):
            calls[f"pyFRF {kind}, at the same lines", "stepped sine"] = lambda kind=kind: _pyfrf(
                data, kind
            )
    calls["scipy.signal.csd, H1, whole periods", "stepped sine"] = lambda: _csd_stepped(data)
    for name, window, length in [
        ("Hann, segments of 4 s", "hann", segment),
        ("Hann, segments of 16 s", "hann", 4 * segment),
        ("whole periods, no window", "boxcar", segment),
    ]:
        if length <= data.tau.shape[2]:
            calls[f"scipy.signal.csd, H1, {name}", "multisine"] = lambda w=window, n=length: _csd(
                data, w, n, data.tau
            )
    calls["scipy.signal.csd, reference as instrument, whole periods", "multisine"] = lambda: _csd(
        data, "boxcar", segment, data.reference
    )
    return calls


def _pyfrf(data: Data, kind: str) -> np.ndarray:
    """At its best: one call per frequency, both records as measurements, no window, nothing copied.

    It returns H of all lines of the FFT; only the excited one means anything. The rest holds noise, and
    zeros at 0 Hz, which the pseudo-inverse takes and a plain inverse would not.
    """
    from pyFRF import FRF

    found = []
    for i, f in enumerate(data.frequencies_hz):
        pair = data.records[2 * i : 2 * i + 2]
        tau = np.stack([r.tau_Nm.T for r in pair])
        theta = np.stack([r.theta_rad.T for r in pair])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of its division by 0 Hz
            frf = FRF(int(RATE_HZ), tau, theta, resp_type="d", window="none", copy=False)
            H = frf.get_H1() if kind == "H1" else frf.get_H2()
        line = round(f * tau.shape[2] / RATE_HZ)
        found.append(-((2 * np.pi * f) ** 2) * H[:, :, line])
    return np.array(found) / data.held[:, None, None]


def _csd_stepped(data: Data) -> np.ndarray:
    """At its best: the records of a frequency in one array, a segment each, so that they average."""
    found = []
    for i, f in enumerate(data.frequencies_hz):
        pair = data.records[2 * i : 2 * i + 2]
        tau = np.concatenate([r.tau_Nm for r in pair]).T
        theta = np.concatenate([r.theta_rad for r in pair]).T
        found.append(_joint(tau, theta, tau, "boxcar", pair[0].time_s.size, np.array([f]))[0])
    return np.array(found) / data.held[:, None, None]


def _csd(data: Data, window: str, segment: int, instrument: np.ndarray) -> np.ndarray:
    flat = [x.transpose(1, 0, 2).reshape(2, -1) for x in (data.tau, data.theta, instrument)]
    return _joint(*flat, window, segment, data.frequencies_hz) / data.held[:, None, None]


def _joint(
    tau: np.ndarray,
    theta: np.ndarray,
    instrument: np.ndarray,
    window: str,
    segment: int,
    frequencies_hz: np.ndarray,
) -> np.ndarray:
    """H = S_yr S_ur⁻¹ of all inputs together; with the torque itself as r this is H1."""
    overlap = (
        segment // 2 if window == "hann" else 0
    )  # a segment across two records has no whole periods
    inputs = np.concatenate([tau, theta])
    _, S = csd(
        instrument[None, :],
        inputs[:, None],
        RATE_HZ,
        window=window,
        nperseg=segment,
        noverlap=overlap,
    )
    lines = np.rint(frequencies_hz * segment / RATE_HZ).astype(int)
    S = S[:, :, lines].transpose(2, 0, 1)
    omega = 2 * np.pi * frequencies_hz
    return -(omega[:, None, None] ** 2) * (S[:, 2:] @ np.linalg.inv(S[:, :2]))
