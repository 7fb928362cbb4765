"""Equations (16)-(18): exact without noise, calibrated with noise, refused where singular."""

from __future__ import annotations

import numpy as np
import pytest
from plants import (
    BAND_HZ,
    PAPER,
    ROBOTS,
    SERIAL,
    campaign,
    circular,
    exact_phasors,
    noisy,
    plant_phasors,
    random_covariance,
    steady_records,
)

from jointid import (
    JointIdError,
    Phasors,
    SineRecord,
    estimate_transfer_matrix,
    extract_phasors,
    motor_response,
    single_record_response,
)


def two_joints(count: int = 2, frequencies: np.ndarray = BAND_HZ) -> Phasors:
    return plant_phasors(SERIAL, PAPER, *campaign(frequencies, 2, count))


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("extra", [0, 1, 4])
def test_exact_phasors_give_the_response(n: int, extra: int) -> None:
    inertia, elasticity = ROBOTS[n]
    phasors = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, n, n + extra))
    found = estimate_transfer_matrix(phasors)
    assert np.allclose(found.omega, 2 * np.pi * BAND_HZ)
    assert np.allclose(found.H, motor_response(found.omega, inertia, elasticity), rtol=1e-9)
    assert found.reciprocity_error.max() < 1e-9
    assert found.rejected == ()
    assert np.all(found.condition >= 1 - 1e-12)
    assert found.condition.max() < 20


@pytest.mark.parametrize("n", [1, 2, 3])
def test_records_of_broken_periods_give_the_response(n: int) -> None:
    inertia, elasticity = ROBOTS[n]
    records = steady_records(
        inertia, elasticity, *campaign(BAND_HZ, n), periods=7.31, hold=False, delay_s=0.002, offset=30.0
    )
    found = estimate_transfer_matrix(extract_phasors(records))
    assert np.allclose(found.H, motor_response(found.omega, inertia, elasticity), rtol=1e-6)


def test_the_condition_is_that_of_the_torques() -> None:
    phasors = two_joints()
    found = estimate_transfer_matrix(phasors)
    torques = phasors.tau.reshape(BAND_HZ.size, 2, 2) if phasors.omega[0] == phasors.omega[1] else None
    if torques is None:  # the campaign lists all frequencies of one experiment first
        torques = phasors.tau.reshape(2, BAND_HZ.size, 2).swapaxes(0, 1)
    np.testing.assert_allclose(found.condition, np.linalg.cond(torques), rtol=1e-9)


def test_order_of_the_records_does_not_matter() -> None:
    phasors = two_joints(3)
    mixed = phasors.select(np.random.default_rng(1).permutation(phasors.omega.size))
    straight, shuffled = estimate_transfer_matrix(phasors), estimate_transfer_matrix(mixed)
    assert np.all(np.diff(shuffled.omega) > 0)
    assert np.allclose(straight.H, shuffled.H, rtol=1e-10)


def test_more_records_than_joints_are_solved_by_least_squares() -> None:
    rng = np.random.default_rng(2)
    base = two_joints(5, BAND_HZ[:1])
    tau = base.tau + 0.05 * (rng.standard_normal((5, 2)) + 1j * rng.standard_normal((5, 2)))
    phasors = exact_phasors(np.full(5, BAND_HZ[0]), base.q, tau)
    omega = 2 * np.pi * BAND_HZ[0]
    rows = np.linalg.lstsq(tau, -(omega**2) * base.q, rcond=None)[0]  # (17), one column per joint
    assert np.allclose(estimate_transfer_matrix(phasors).H[0], rows.T, rtol=1e-10)


@pytest.mark.parametrize(("n", "count"), [(1, 1), (2, 2), (2, 4), (3, 3)])
def test_covariance_is_the_scatter_of_the_elements(n: int, count: int) -> None:
    """800 realisations of strongly correlated noise, different in every record."""
    rng = np.random.default_rng(3)
    inertia, elasticity = ROBOTS[n]
    base = plant_phasors(inertia, elasticity, *campaign([11.3], n, count))
    scale = 3e-4 * np.abs(base.z).max(axis=0)
    noise = np.array([random_covariance(rng, scale * (1 + r)) for r in range(count)])
    found = [estimate_transfer_matrix(noisy(base, noise, error)) for error in circular(rng, noise, 800)]
    true = motor_response(base.omega[:1], inertia, elasticity)[0]
    error = np.array([matrix.H[0] - true for matrix in found]).reshape(800, -1)
    stated = np.mean([matrix.covariance[0] for matrix in found], axis=0)
    assert np.allclose(stated, stated.conj().T)
    deviations = np.array([matrix.standard_deviation[0] for matrix in found]).mean(axis=0)
    assert np.allclose(deviations.ravel() ** 2, np.diag(stated).real, rtol=0.01)

    scatter = error.T @ error.conj() / 800
    ratio = np.diag(scatter).real / np.diag(stated).real
    assert np.all((ratio > 0.85) & (ratio < 1.17))  # four standard deviations of 800 complex squares
    whole = np.einsum("ri,ij,rj->r", error.conj(), np.linalg.inv(stated), error).real
    assert whole.mean() == pytest.approx(n * n, rel=0.12)


def test_one_record_includes_the_effect_of_the_other_joints_torque() -> None:
    """H11 + H12 τ2/τ1, what Figure 3 plots."""
    phasors = two_joints()
    H = motor_response(phasors.omega, SERIAL, PAPER)
    tau = phasors.tau
    response = single_record_response(phasors)
    assert np.allclose(response[:, 0], H[:, 0, 0] + H[:, 0, 1] * tau[:, 1] / tau[:, 0], rtol=1e-10)
    assert np.allclose(response[:, 1], H[:, 1, 1] + H[:, 1, 0] * tau[:, 0] / tau[:, 1], rtol=1e-10)


def test_one_record_without_torque_shows_nothing() -> None:
    phasors = plant_phasors(SERIAL, PAPER, np.array([5.0]), np.array([[1.0 + 0j, 0.0]]))
    response = single_record_response(phasors)
    assert np.isfinite(response[0, 0])
    assert np.isnan(response[0, 1])


@pytest.mark.parametrize("repeated", [[1.0, 1.0], [1.0, -2.0 + 0.5j]])
def test_the_same_experiment_twice_is_refused_with_the_remedy(repeated: list[complex]) -> None:
    torques = np.array([[1.0, 0.3j]]) * np.array(repeated)[:, None]
    phasors = plant_phasors(SERIAL, PAPER, np.array([5.0, 5.0]), torques)
    told = r'At 5 Hz .*record 1", ".*record 2".*tau_m1_Nm.*not independent'
    with pytest.raises(JointIdError, match=told):
        estimate_transfer_matrix(phasors)
    with pytest.raises(JointIdError, match=r"different relative amplitudes or phases"):
        estimate_transfer_matrix(phasors)


def test_the_same_experiment_twice_is_refused_when_only_noise_differs() -> None:
    twice = np.array([[1.0, 0.3j]] * 2)
    records = steady_records(
        SERIAL, PAPER, np.array([5.0, 5.0]), twice, noise=(1e-5, 1e-2), periods=20.3
    )
    with pytest.raises(JointIdError, match="not independent"):
        estimate_transfer_matrix(extract_phasors(records))


def test_a_joint_without_torque_is_named() -> None:
    phasors = plant_phasors(SERIAL, PAPER, np.array([5.0, 5.0]), np.array([[1.0, 0], [1j, 0]]))
    with pytest.raises(JointIdError, match=r"joint 2 .column tau_m2_Nm. is zero in every.*excite"):
        estimate_transfer_matrix(phasors)


@pytest.mark.parametrize("level", [0.0, 5.0])
def test_a_constant_torque_column_is_no_excitation(level: float) -> None:
    """Rounding of a constant leaves a phasor of 1e-17, which must not be divided by."""
    time = np.arange(4000) / 1000.0
    angle = 2 * np.pi * 5.3 * time
    for other in (np.zeros((4000, 0)), np.sin(angle)[:, None]):
        tau = np.hstack([other, np.full((4000, 1), level)])
        records = [
            SineRecord(5.3, time, np.sin(angle + shift)[:, None] * np.ones(tau.shape[1]), tau)
            for shift in np.arange(tau.shape[1])
        ]
        with pytest.raises(JointIdError):
            estimate_transfer_matrix(extract_phasors(records))


def test_too_few_records_are_named_with_the_remedy() -> None:
    phasors = plant_phasors(SERIAL, PAPER, np.array([5.0]), np.array([[1.0, 0.4]]))
    with pytest.raises(JointIdError, match=r"At 5 Hz the study has 1 record .*2 joints need 2"):
        estimate_transfer_matrix(phasors)


def test_a_single_joint_below_the_noise_is_not_reported_as_a_repetition() -> None:
    base = plant_phasors(*ROBOTS[1], np.array([5.0]), np.array([[1e-3 + 0j]]))
    noise = np.diag([1e-12, 1.0]).astype(complex)[None]
    with pytest.raises(JointIdError) as caught:
        estimate_transfer_matrix(noisy(base, noise, np.zeros((1, 2))))
    assert "repeated experiments" not in str(caught.value)


def test_good_frequencies_are_kept_and_bad_ones_listed() -> None:
    frequencies, torques = campaign([3.0, 7.0, 11.0], 2)
    torques[2:4] = 1.0
    found = estimate_transfer_matrix(plant_phasors(SERIAL, PAPER, frequencies, torques))
    assert np.allclose(found.omega / (2 * np.pi), [3.0, 11.0])
    assert found.H.shape == (2, 2, 2)
    assert found.covariance.shape == (2, 4, 4)
    assert len(found.rejected) == 1
    assert "7 Hz" in found.rejected[0]


def test_units_of_a_joint_only_scale_H() -> None:
    """Joints a million times apart in scale: H scales, condition and verdict stay."""
    frequencies, torques = campaign(BAND_HZ, 2)
    base = plant_phasors(SERIAL, PAPER, frequencies, torques)
    unit = np.array([1e3, 1e-3])
    scaled = exact_phasors(frequencies, base.q * unit, base.tau / unit)
    straight, bent = estimate_transfer_matrix(base), estimate_transfer_matrix(scaled)
    assert np.allclose(bent.H / np.outer(unit, unit), straight.H, rtol=1e-8)
    assert np.allclose(bent.condition, straight.condition, rtol=1e-8)


def test_reciprocity_error_is_as_simulated_in_any_units() -> None:
    """H12 and H21 one per cent apart, measured in the joints' own scales."""
    frequencies, torques = campaign(BAND_HZ[:3], 2)
    H = motor_response(2 * np.pi * frequencies, SERIAL, PAPER)
    H[:, 0, 1] *= 1.01
    q = np.einsum("rij,rj->ri", H, torques) / -((2 * np.pi * frequencies[:, None]) ** 2)
    errors = []
    for unit in ([1.0, 1.0], [10.0, 0.1], [1e-3, 1e-2]):
        phasors = exact_phasors(frequencies, q * unit, torques / unit)
        errors.append(estimate_transfer_matrix(phasors).reciprocity_error)
    assert np.all(errors[0] > 1e-3)
    assert np.all(errors[0] < 0.02)
    assert np.allclose(errors[0], errors[1:], rtol=1e-6)


def test_a_joint_with_a_constant_encoder_has_zero_response() -> None:
    """Coarse encoders hide high frequencies: that row of H is zero, and H is as far from reciprocal."""
    frequencies, torques = campaign(BAND_HZ[:3], 2)
    base = plant_phasors(SERIAL, PAPER, frequencies, torques)
    found = estimate_transfer_matrix(exact_phasors(frequencies, base.q * [1.0, 0.0], base.tau))
    assert not found.H[:, 1].any()
    assert np.all(np.isinf(found.reciprocity_error))
    none = estimate_transfer_matrix(exact_phasors(frequencies, 0 * base.q, base.tau))
    assert not none.reciprocity_error.any()


def test_two_hundred_records_of_one_frequency() -> None:
    phasors = two_joints(200, np.array([9.0]))
    found = estimate_transfer_matrix(phasors)
    assert np.allclose(found.H, motor_response(found.omega, SERIAL, PAPER), rtol=1e-10)
