"""H of any motion by local polynomials: known answers of multisines whose response is exact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from plants import ROBOTS

from jointid import (
    Controller,
    JointIdError,
    Measurement,
    Motion,
    MotionRecord,
    motor_response,
    simulate_motion,
)
from jointid.arrays import Floats
from jointid.transfer_matrix import TransferMatrix, _of_images, motion_transfer_matrix, record_spectra

RATE_HZ, DURATION_S = 500.0, 20.0
BAND_HZ = (3.0, 60.0)
N = int(RATE_HZ * DURATION_S)
FREQUENCIES_HZ = np.fft.rfftfreq(N, 1 / RATE_HZ)


def response(n: int) -> np.ndarray:
    """H at all lines; zero outside of the band and some more."""
    inertia, elasticity = ROBOTS[n]
    H = np.zeros((FREQUENCIES_HZ.size, n, n), complex)
    inside = (FREQUENCIES_HZ > 0.5) & (FREQUENCIES_HZ < 90)
    H[inside] = motor_response(2 * np.pi * FREQUENCIES_HZ[inside], inertia, elasticity)
    return H


def record(
    n: int,
    seed: int,
    *,
    delay_s: float = 0.0,
    stated_delay_s: float = 0.0,
    held: bool = False,
    coulomb_Nm: float = 0.0,
    viscous: float = 0.0,
    alike: bool = False,
    still: int | None = None,
) -> MotionRecord:
    """One period of a multisine: angles follow from torques exactly."""
    rng = np.random.default_rng(seed)
    H = response(n)
    lines = np.any(H != 0, axis=(1, 2))
    tau = np.zeros((lines.size, n), complex)
    tau[lines] = np.exp(2j * np.pi * rng.random((lines.sum(), n)))
    if alike:
        tau[:, 1] = tau[:, 0]
    if still is not None:
        tau[:, still] = 0
    omega = 2 * np.pi * FREQUENCIES_HZ[:, None]
    q = np.einsum("fij,fj->fi", H, tau)
    q = np.divide(-q, omega**2, out=np.zeros_like(q), where=omega > 0)
    angle, velocity = (np.fft.irfft(x * N, N, axis=0) for x in (q, 1j * omega * q))
    if held:  # logged is what is held: the arm feels its average over a sample
        s = np.where(omega > 0, 1j * omega / RATE_HZ, 1)
        tau = tau * np.where(omega > 0, s / -np.expm1(-s), 1)
    torque = np.fft.irfft(tau * N * np.exp(1j * omega * delay_s), N, axis=0)
    torque += coulomb_Nm * np.sign(velocity) + viscous * velocity
    time = np.arange(N) / RATE_HZ
    return MotionRecord(
        time, angle, torque, torque_hold=held, torque_delay_s=stated_delay_s, band_hz=BAND_HZ
    )


def estimated(records: Sequence[MotionRecord], **without: Any) -> TransferMatrix:
    """H of motion records, without friction and a delay."""
    return motion_transfer_matrix(record_spectra(records), **without)


def error_of(found: TransferMatrix, n: int) -> Floats:
    """Error relative to the largest element at each frequency."""
    true = motor_response(found.omega, *ROBOTS[n])
    size = np.abs(true).max(axis=(1, 2), keepdims=True)
    return np.asarray((np.abs(found.H - true) / size).max(axis=(1, 2)))


@pytest.mark.parametrize("n", [1, 2])
def test_a_multisine_gives_the_response_at_every_band(n: int) -> None:
    found = estimated([record(n, seed) for seed in range(n + 1)])
    f = found.omega / (2 * np.pi)
    # Bands of 8 lines of the longest record to both sides, at least 0.6 Hz, side by side.
    np.testing.assert_allclose(np.diff(f), 1.2, rtol=1e-9)
    assert BAND_HZ[0] + 0.6 == pytest.approx(f[0])
    assert BAND_HZ[1] - 2 * 1.2 < f[-1] < BAND_HZ[1] - 0.6
    assert np.median(error_of(found, n)) < 1e-5
    assert found.rejected == ()
    assert np.all(found.condition >= 1)
    assert found.condition.max() < 5
    assert np.all(found.condition == 1) if n == 1 else np.all(found.condition > 1)
    assert found.reciprocity_error.max() < 0.1


def test_short_records_have_wider_bands() -> None:
    whole = record(1, 1)
    part = MotionRecord(
        whole.time_s[:2000],
        whole.theta_rad[:2000],
        whole.tau_Nm[:2000],
        torque_hold=False,
        band_hz=BAND_HZ,
    )
    found = estimated([part])  # 4 s: 8 lines are 2 Hz
    np.testing.assert_allclose(np.diff(found.omega) / (2 * np.pi), 4.0, rtol=1e-9)


def test_a_part_between_two_gaps_may_have_no_line_in_the_band() -> None:
    whole = record(1, 1)
    kept = np.r_[: N - 200, N - 100 : N]  # 0.2 s: lines 5 Hz apart
    torn = replace(
        whole, time_s=whole.time_s[kept], theta_rad=whole.theta_rad[kept], tau_Nm=whole.tau_Nm[kept]
    )
    torn = replace(torn, band_hz=(11.0, 14.0))
    assert np.median(error_of(estimated([torn]), 1)) < 1e-3


@pytest.mark.parametrize("noise", [1e-4, 1e-6])
@pytest.mark.parametrize("n", [1, 2])
def test_error_is_the_covariance(n: int, noise: float) -> None:
    """Also with little noise, where polynomials of low order miss a sharp resonance."""
    records = [record(n, seed) for seed in range(3)]
    rng = np.random.default_rng(8)
    squares = []
    for _ in range(6):
        noisy = [
            replace(r, theta_rad=r.theta_rad + noise * rng.standard_normal(r.theta_rad.shape))
            for r in records
        ]
        found = estimated(noisy)
        true = motor_response(found.omega, *ROBOTS[n])
        own = np.einsum("faa->fa", found.covariance).real.reshape(found.H.shape)
        squares.append(np.mean(np.abs(found.H - true) ** 2 / own))
    assert 0.8 < np.mean(squares) < 1.2


def test_delay_and_friction_are_subtracted() -> None:
    plain = error_of(estimated([record(1, 1)]), 1).max()
    held = estimated([record(1, 1, held=True)])
    assert error_of(held, 1).max() < 2 * plain + 1e-6
    late = record(1, 1, delay_s=0.003)
    assert error_of(estimated([late]), 1).max() > 0.1
    assert error_of(estimated([late], delay=0.003), 1).max() < 2 * plain + 1e-6
    stated = record(1, 1, delay_s=0.003, stated_delay_s=0.002)
    assert error_of(estimated([stated], delay=0.001), 1).max() < 2 * plain + 1e-6
    rubbing = record(1, 1, viscous=0.02, coulomb_Nm=2.0)
    kept = np.median(error_of(estimated([rubbing]), 1))
    freed = estimated([rubbing], viscous=0.02, coulomb=2.0)
    assert np.median(error_of(freed, 1)) < kept / 5


@pytest.mark.parametrize(
    ("records", "reason"),
    [
        ([record(2, 1, alike=True), record(2, 2, alike=True)], "are not independent"),
        ([record(2, 1, still=1), record(2, 2, still=1)], "torque of a joint is zero"),
        ([], "needs motion records"),
    ],
    ids=["alike", "zero", "none"],
)
def test_motions_without_an_answer_are_refused(records: list[MotionRecord], reason: str) -> None:
    with pytest.raises(JointIdError, match=reason):
        estimated(records)


def test_bands_of_noise_are_rejected() -> None:
    silent = record(1, 1)
    angle = np.random.default_rng(3).standard_normal((N, 1))
    with pytest.raises(JointIdError, match="noise"):
        estimated([MotionRecord(silent.time_s, angle, silent.tau_Nm, band_hz=BAND_HZ)])


def test_a_response_is_shown_where_its_error_is_below_half_of_it() -> None:
    """With noise of the angles that hides the motion in the upper part of the band."""
    seen = record(1, 1)
    noise = 0.005 * np.abs(seen.theta_rad).max() * np.random.default_rng(3).standard_normal((N, 1))
    found = estimated([replace(seen, theta_rad=seen.theta_rad + noise)])
    share = (found.standard_deviation / np.abs(found.H)).ravel()
    assert found.omega.size > 20
    assert 0.4 < share.max() < 0.55
    assert any("does not exceed the noise" in reason for reason in found.rejected)


def with_torque_noise(noise_Nm: float) -> list[MotionRecord]:
    rng = np.random.default_rng(8)
    return [
        replace(r, tau_Nm=r.tau_Nm + noise_Nm * rng.standard_normal(r.tau_Nm.shape))
        for r in (record(1, seed) for seed in range(3))
    ]


def test_noise_of_the_torque_counts_in_the_error() -> None:
    """Least squares make H too small by the share of noise in the power of the torques."""
    found = estimated(with_torque_noise(40.0))
    true = motor_response(found.omega, *ROBOTS[1])
    assert found.omega.size > 40
    assert np.mean(np.abs((found.H - true) / found.standard_deviation) ** 2) < 2
    with pytest.raises(JointIdError, match="noise may reduce H by more than 20 %"):
        estimated(with_torque_noise(150.0))


@pytest.mark.parametrize(("counts", "kind"), [(4096, "sweep"), (8192, "sweep")])
def test_the_answer_of_a_controller_to_a_coarse_encoder_is_not_the_response(
    counts: int, kind: str
) -> None:
    """Where the motion ends, least squares give the inverse of the controller, up to 90 errors off."""
    records = simulate_motion(
        *ROBOTS[1],
        Motion(kind, 2.0, 30.0, 10.0, acceleration_rad_s2=52.0),
        controller=Controller(sample_rate_hz=2000.0),
        measurement=Measurement(encoder_counts=counts, torque_noise_Nm=9e-4),
        seed=9,
    )
    found = estimated([replace(each, band_hz=(2.0, 30.0)) for each in records])
    assert found.omega.size > 8
    off = np.abs(found.H - motor_response(found.omega, *ROBOTS[1])) / found.standard_deviation
    assert off.max() < 3.5


def test_a_joint_whose_encoder_stands_still_has_no_response() -> None:
    """H is singular there; its inverse ended in an error of linear algebra."""
    records = [record(2, seed) for seed in (1, 2)]
    angles = [np.column_stack([each.theta_rad[:, 0], np.full(N, 0.5)]) for each in records]
    braked = [replace(each, theta_rad=q) for each, q in zip(records, angles, strict=True)]
    with pytest.raises(JointIdError, match="does not move"):
        estimated(braked)


@pytest.mark.parametrize(("rate_Hz", "counts", "least"), [(500.0, None, 0.5), (2000.0, 2**14, 0.7)])
def test_errors_are_those_of_a_held_torque_and_of_a_fine_encoder(
    rate_Hz: float, counts: int | None, least: float
) -> None:
    """Images of the torque were off by 147 stated errors; those of the encoder were thrice too wide."""
    records = simulate_motion(
        *ROBOTS[1],
        Motion("random", 2.0, 40.0, 10.0, acceleration_rad_s2=50.0),
        controller=Controller(sample_rate_hz=rate_Hz),
        measurement=Measurement(encoder_counts=counts),
    )
    found = estimated([replace(each, band_hz=(2.0, 40.0)) for each in records])
    off = np.abs(found.H - motor_response(found.omega, *ROBOTS[1])) / found.standard_deviation
    assert off.max() < 4
    assert np.sqrt(np.mean(off**2)) > least


@pytest.mark.parametrize(("angle", "torque"), [(2.0**10, 1.0), (1.0, 2.0**-9)])
def test_units_of_angle_and_torque_only_scale_the_response_and_its_error(
    angle: float, torque: float
) -> None:
    """A controller answers white noise of the angles; powers of two leave every digit."""
    rng, records = np.random.default_rng(4), []
    for seed in (1, 2):
        plain = record(1, seed)
        noise = 2e-4 * rng.standard_normal(plain.theta_rad.shape)
        answer = 500.0 * noise + 1e-2 * rng.standard_normal(noise.shape)
        records.append(replace(plain, theta_rad=plain.theta_rad + noise, tau_Nm=plain.tau_Nm - answer))
    scaled = [
        replace(each, theta_rad=angle * each.theta_rad, tau_Nm=torque * each.tau_Nm) for each in records
    ]
    found, other = estimated(records), estimated(scaled)
    ratio = angle / torque
    assert found.omega.size > 10
    np.testing.assert_allclose(other.omega, found.omega, rtol=1e-12)
    np.testing.assert_allclose(other.H, ratio * found.H, rtol=1e-9)
    np.testing.assert_allclose(other.standard_deviation, ratio * found.standard_deviation, rtol=1e-6)
    np.testing.assert_allclose(other.condition, found.condition)


def test_motions_of_unlike_joints_are_refused() -> None:
    with pytest.raises(JointIdError, match="all of the same joints"):
        estimated([record(1, 1), record(2, 1)])


def test_the_velocity_under_friction_knows_the_rounding_of_the_encoder(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A step has a variance of its square over twelve."""
    step, asked = 2 * np.pi / 4096, []

    def velocity(theta: Floats, interval_s: float, floor: Floats) -> tuple[Floats]:
        asked.append(floor)
        return (np.gradient(theta, interval_s, axis=1),)

    monkeypatch.setattr("jointid.motion.spectral_lines.smooth_velocity", velocity)
    plain = record(1, 1)
    coarse = replace(plain, theta_rad=step * np.rint(5 * plain.theta_rad / step))
    estimated([coarse], viscous=1e-9)
    np.testing.assert_allclose(asked, [[step**2 / 12]])


def test_the_spectral_lines_are_those_of_the_band() -> None:
    """Including its ends; they were one line, 1/T, too high."""
    rng, t = np.random.default_rng(0), np.arange(2000) / 100
    record = MotionRecord(
        time_s=t, theta_rad=rng.standard_normal((2000, 1)), tau_Nm=rng.standard_normal((2000, 1))
    )
    (found,) = record_spectra([replace(record, band_hz=(3.0, 20.0))])
    np.testing.assert_allclose(found.frequency_hz, np.arange(60, 401) / 20)


def test_images_of_held_torques_move_rotors_alone() -> None:
    """(ωT/2)⁴/15 of 1/M, the response of the diagonal far above the resonances, in no other element."""
    H = np.zeros((3, 2, 2), complex)
    H[:, 0, 0], H[:, 1, 1], H[:, 0, 1] = [1, 2, -5], [10, 3j, 1], 99
    rotors = np.array([5.0, 3.0])  # of the last frequency, or the median: the last may be a resonance
    omega, none = np.array([10.0, 20.0, 40.0]), np.zeros(3)
    matrix = TransferMatrix(omega, H, np.zeros((3, 4, 4), complex), none, none, ())
    variance = ((0.5 * omega[:, None] * 0.01) ** 4 / 15 * rotors) ** 2
    expected = np.zeros((3, 4, 4))
    expected[:, 0, 0], expected[:, 3, 3] = variance.T
    np.testing.assert_allclose(_of_images(matrix, 0.01), expected)
