"""Validation: silent and calibrated if the model holds, a clear deviation if not."""

from __future__ import annotations

import re

import numpy as np
import pytest
from plants import (
    BAND_HZ,
    PAPER,
    PARALLELOGRAM,
    ROBOTS,
    SERIAL,
    campaign,
    circular,
    noisy,
    plant_phasors,
    random_covariance,
    rubbing,
    steady_records,
)

from jointid import (
    Elasticity,
    Inertia,
    JointIdError,
    Phasors,
    extract_phasors,
    identify_elasticity,
    motor_response,
)
from jointid.uncertainty.poses import fits_by_pose
from jointid.uncertainty.validation import (
    amplitude_dependence,
    harmonic_content,
    predict_torques,
    record_residuals,
)

FREQUENCIES = np.geomspace(3, 30, 8)


def drawn(n: int, seed: int, relative: float = 1e-3, elasticity: Elasticity | None = None) -> Phasors:
    inertia, springs = ROBOTS[n]
    clean = plant_phasors(inertia, elasticity or springs, *campaign(FREQUENCIES, n))
    rng = np.random.default_rng(seed)
    covariance = np.array([random_covariance(rng, relative * np.abs(z)) for z in clean.z])
    return noisy(clean, covariance, circular(rng, covariance, 1)[0])


# ---------------------------------------------------------------------------------- left out, predicted


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("method", ["least-squares", "maximum-likelihood"])
def test_prediction_errors_have_the_stated_size(n: int, method: str) -> None:
    inertia, _ = ROBOTS[n]
    scores = []
    for seed in range(6):
        phasors = drawn(n, seed)
        fit = identify_elasticity(phasors, inertia, method=method)
        prediction = predict_torques(fit)
        assert np.unique(prediction.frequency_hz) == pytest.approx(FREQUENCIES)
        scores.append(prediction.misfit)
    assert 0.6 < np.mean(scores) < 1.5


def test_prediction_is_exact_without_noise() -> None:
    phasors = plant_phasors(SERIAL, PAPER, *campaign(FREQUENCIES, 2))
    fit = identify_elasticity(phasors, SERIAL, method="weighted")
    assert np.all(predict_torques(fit, folds=3).relative_error < 1e-6)


def test_prediction_fails_where_the_springs_change() -> None:
    """Softer springs above 10 Hz: each half contradicts the other."""
    phasors = drawn(2, 0)
    softer = drawn(2, 0, elasticity=Elasticity(K=[36.0, 7.5], D=[0.1, 0.015]))
    high = phasors.omega > 2 * np.pi * 10
    mixed = Phasors(
        **{
            name: np.where(high.reshape(-1, *[1] * (getattr(phasors, name).ndim - 1)),
                           getattr(softer, name), getattr(phasors, name))
            for name in phasors.__dataclass_fields__ if name != "labels"
        },
        labels=phasors.labels,
    )  # fmt: skip
    fit = identify_elasticity(mixed, SERIAL, method="weighted")
    good = identify_elasticity(phasors, SERIAL, method="weighted")
    assert fit.misfit > 10
    bad, well = (np.median(predict_torques(each).relative_error) for each in (fit, good))
    assert bad > 5 * well


def test_prediction_of_torques_finds_springs_that_change_with_the_pose() -> None:
    """The second of two poses has another inertia, as given, and softer springs."""

    def relative_error(K1: float) -> float:
        other = Elasticity(K=[K1, 7.5], D=[0.1, 0.015])
        parts = [
            plant_phasors(inertia, springs, *campaign(FREQUENCIES[k::2], 2))
            for k, (inertia, springs) in enumerate(((SERIAL, PAPER), (PARALLELOGRAM, other)))
        ]
        both = Phasors(
            **{
                name: np.concatenate([getattr(part, name) for part in parts])
                for name in parts[0].__dataclass_fields__ if name != "labels"
            },
            labels=parts[0].labels + parts[1].labels,
        )  # fmt: skip
        inertias = [SERIAL] * parts[0].omega.size + [PARALLELOGRAM] * parts[1].omega.size
        fit = identify_elasticity(both, inertias, method="weighted")
        return float(np.median(predict_torques(fit).relative_error))

    assert relative_error(float(PAPER.K[0])) < 1e-6
    assert relative_error(0.8 * float(PAPER.K[0])) > 0.02


def test_prediction_with_friction() -> None:
    phasors = extract_phasors(rubbing((0.2, 0.04)))
    fit = identify_elasticity(phasors, PARALLELOGRAM, method="maximum-likelihood", friction=True)
    assert np.all(predict_torques(fit).relative_error < 0.01)
    raw = identify_elasticity(phasors, PARALLELOGRAM, method="least-squares")
    assert predict_torques(raw).relative_error.max() > 0.05


def test_prediction_needs_frequencies() -> None:
    phasors = drawn(2, 0).select(range(6))
    fit = identify_elasticity(phasors, SERIAL, method="weighted")
    with pytest.raises(JointIdError, match="3 frequencies"):
        predict_torques(fit)


def test_friction_compensated_phasors_satisfy_the_model() -> None:
    phasors = extract_phasors(rubbing((0.2, 0.04)))
    fit = identify_elasticity(phasors, PARALLELOGRAM, method="maximum-likelihood", friction=True)
    free = fit.phasors
    H = motor_response(free.omega, PARALLELOGRAM, PAPER)
    expected = -(free.omega[:, None] ** 2) * free.q
    found = np.einsum("rij,rj->ri", H, free.tau)
    assert np.linalg.norm(found - expected) < 0.01 * np.linalg.norm(expected)
    assert np.allclose(free.q, phasors.q, rtol=0.01)
    assert np.abs(free.tau - phasors.tau).max() > 0.1  # friction was there to take off


# -------------------------------------------------------------------------------------------- residuals


def test_residuals_have_their_expected_size() -> None:
    squares = []
    for seed in range(8):
        phasors = drawn(2, seed)
        fit = identify_elasticity(phasors, SERIAL, method="weighted")
        residuals = record_residuals(phasors, fit)
        squares.append((residuals.normalised**2).mean())
    assert np.mean(squares) == pytest.approx(1.0, abs=0.35)


def test_the_largest_residual_is_that_of_the_bad_record() -> None:
    phasors = drawn(2, 1)
    error = np.zeros(phasors.z.shape, complex)
    error[5, 3] = 0.1 * phasors.tau[5, 1]
    bad = noisy(phasors, phasors.covariance, error)
    fit = identify_elasticity(bad, SERIAL, method="weighted")
    residuals = record_residuals(bad, fit)
    assert residuals.worst == (5, 1)
    assert residuals.labels[5] == "record 6"


# ------------------------------------------------------------------------------------------- harmonics


def test_harmonics_are_those_of_friction() -> None:
    content = harmonic_content(extract_phasors(rubbing((0.2, 0.04))))
    assert content.odd.shape == content.even.shape == content.significance.shape == (8, 4)
    assert content.odd[:, 2:].max() > 0.02
    assert content.even[:, 2:].max() < 0.2 * content.odd[:, 2:].max()
    assert content.significance[:, 2:].max() > 20


def test_harmonics_of_noise_are_noise() -> None:
    records = steady_records(
        SERIAL, PAPER, *campaign(BAND_HZ, 2), noise=(1e-5, 3e-3), periods=20.37, seed=2
    )
    content = harmonic_content(extract_phasors(records, harmonics=5))
    assert 0.6 < np.sqrt((content.significance**2).mean()) < 1.5
    with pytest.raises(JointIdError, match="harmonics=3"):
        harmonic_content(extract_phasors(records, harmonics=1))


# ------------------------------------------------------------------------------------------- amplitude


def two_amplitudes(harder: float, ratio: float = 3.0) -> Phasors:
    """Every frequency at a small and a large amplitude; springs stiffer at the large one."""
    frequencies, torques = campaign(FREQUENCIES, 2)
    stiffer = Elasticity(K=[PAPER.K[0] * (1 + harder), PAPER.K[1]], D=PAPER.D)
    records = steady_records(SERIAL, PAPER, frequencies, torques, noise=(1e-5, 1e-3), seed=1)
    records += steady_records(SERIAL, stiffer, frequencies, ratio * torques, noise=(1e-5, 1e-3), seed=2)
    return extract_phasors(records)


def test_stiffness_rises_with_amplitude_for_a_hardening_gear() -> None:
    found = amplitude_dependence(identify_elasticity(two_amplitudes(0.02), SERIAL, method="weighted"))
    ends = found.deflection_rad[0]
    whole = np.log(ends[1] / ends[0]) / np.log(3)  # the step of 2 % is per factor three
    assert found.change[0] == pytest.approx(0.02 * whole, rel=0.3)
    assert found.change[0] > 5 * found.standard_error[0]
    assert abs(found.change[1]) < 0.2 * found.change[0]


def test_stiffness_of_linear_joints_does_not_depend_on_amplitude() -> None:
    found = amplitude_dependence(identify_elasticity(two_amplitudes(0.0), SERIAL, method="weighted"))
    assert np.all(np.abs(found.change) < 4 * found.standard_error)
    assert np.all(found.standard_error < 0.01)


def test_scatter_beyond_the_noise_widens_the_error_of_a_trend() -> None:
    """A weighted regression with a constant for each pair of records at one frequency."""
    frequencies, torques = campaign(FREQUENCIES, 2)
    rng, records = np.random.default_rng(3), []
    for size in (1, 3):
        for f, torque in zip(frequencies, torques, strict=True):
            springs = Elasticity(K=PAPER.K * (1 + 0.01 * rng.standard_normal(2)), D=PAPER.D)
            records += steady_records(
                SERIAL, springs, [f], size * torque[None], noise=(1e-6, 1e-4), seed=len(records)
            )
    fit = identify_elasticity(extract_phasors(records), SERIAL, method="weighted")
    found = amplitude_dependence(fit)
    for j in range(2):
        deflection = np.abs(fit.equations.deflection[:, j])
        weight = deflection / fit.residual_noise[:, j]
        pairs = np.tile(np.eye(deflection.size // 2), (2, 1))
        columns = weight[:, None] * np.column_stack([np.log(deflection), pairs])
        measured = weight * fit.equations.stiffness[:, j].real
        slope, left, *_ = np.linalg.lstsq(columns, measured)
        covariance = np.linalg.inv(columns.T @ columns) * left / (len(columns) - columns.shape[1])
        ends = np.log(deflection.max() / deflection.min()) / fit.K[j]
        assert found.change[j] == pytest.approx(ends * slope[0], rel=1e-3)
        assert found.standard_error[j] == pytest.approx(ends * np.sqrt(covariance[0, 0]), rel=1e-3)


def test_one_amplitude_gives_no_trend() -> None:
    found = amplitude_dependence(identify_elasticity(drawn(2, 0), SERIAL, method="weighted"))
    assert np.all(np.isinf(found.standard_error))
    assert np.isnan(found.deflection_rad).all()


@pytest.mark.parametrize(("ratio", "compared"), [(1.27, False), (1.33, True)])
def test_amplitudes_are_compared_from_a_ratio_of_1_3(ratio: float, compared: bool) -> None:
    fit = identify_elasticity(two_amplitudes(0.0, ratio), SERIAL, method="weighted")
    assert np.all(np.isfinite(amplitude_dependence(fit).standard_error) == compared)


# ------------------------------------------------------------------------------------------------ poses


def two_poses(second: Elasticity = PAPER) -> tuple[Phasors, list[Inertia], list[str]]:
    frequencies, torques = campaign(FREQUENCIES, 2)
    records = steady_records(SERIAL, PAPER, frequencies, torques, noise=(1e-5, 3e-3), seed=1)
    records += steady_records(PARALLELOGRAM, second, frequencies, torques, noise=(1e-5, 3e-3), seed=2)
    count = len(torques)
    return (
        extract_phasors(records),
        [SERIAL] * count + [PARALLELOGRAM] * count,
        ["here"] * count + ["there"] * count,
    )


def test_poses_agree_within_their_errors() -> None:
    phasors, inertias, poses = two_poses()
    fit = identify_elasticity(phasors, inertias, method="weighted")
    fits = fits_by_pose(phasors, inertias, poses, fit)
    assert fits.names == ("here", "there")
    assert np.all(fits.significance < 3.5)
    assert fits.probability > 1e-3
    assert np.all(np.abs(fits.estimates - np.r_[PAPER.K, PAPER.D]) < 5 * fits.standard_error)
    alone = identify_elasticity(phasors.select(range(16)), SERIAL, method="weighted")
    assert np.allclose(fits.estimates[0], np.r_[alone.K, alone.D])


def test_poses_disagree_on_the_joint_that_differs() -> None:
    phasors, inertias, poses = two_poses(Elasticity(K=[43.0, 7.7], D=PAPER.D))
    fit = identify_elasticity(phasors, inertias, method="weighted")
    fits = fits_by_pose(phasors, inertias, poses, fit)
    assert int(np.argmax(fits.spread[:2])) == 1
    assert fits.spread[1] == pytest.approx(0.2 / 7.6, rel=0.05)
    assert fits.significance[1] > 10
    assert fits.probability < 1e-6


def test_poses_measured_one_after_another_disagree_beside_changing_gears() -> None:
    """A change over the records explains most of it; each pose's K was that of all records."""
    phasors, inertias, poses = two_poses(Elasticity(K=[43.0, 7.7], D=PAPER.D))
    fit = identify_elasticity(phasors, inertias)
    assert "stiffness_change" in fit.parameters.layout
    fits = fits_by_pose(phasors, inertias, poses, fit)
    assert fits.estimates[:, 1] == pytest.approx([7.5, 7.7], rel=1e-3)
    assert fits.significance[1] > 10


def test_a_pose_with_too_few_records_is_named() -> None:
    phasors, inertias, poses = two_poses()
    fit = identify_elasticity(phasors, inertias, method="weighted")
    q, tau = phasors.q.copy(), phasors.tau.copy()
    q[16:, 1] = tau[16:, 1] = 0
    still = Phasors(
        **{
            **{name: getattr(phasors, name) for name in phasors.__dataclass_fields__},
            "q": q,
            "tau": tau,
        }
    )
    fits = fits_by_pose(still, inertias, poses, fit)
    assert fits.names == ("here",)
    assert fits.probability == 1.0
    assert re.match(r"there: Joint 2", fits.problems[0])
    with pytest.raises(JointIdError, match="one per record"):
        fits_by_pose(phasors, inertias, poses[:3], fit)


# --------------------------------------------------------------------------------------------- inertias


@pytest.mark.parametrize("n", [1, 2, 3])
def test_inertias_are_found_from_the_records(n: int) -> None:
    inertia, elasticity = ROBOTS[n]
    given = Inertia(M=inertia.M, M2=inertia.M2 * 1.05)
    fit = identify_elasticity(drawn(n, 3), given, inertia_std=0.3)
    assert isinstance(fit.inertia, Inertia)
    assert fit.misfit < 2
    error = np.sqrt(np.diag(fit.parameter_covariance)[fit.parameters.layout["M2"]])
    found = fit.inertia.M2[np.tril_indices(n)]
    assert np.all(np.abs(found - inertia.M2[np.tril_indices(n)]) < 5 * error)
    assert np.all(np.abs(fit.K - elasticity.K) < 5 * fit.standard_error[:n])
    exact = identify_elasticity(drawn(n, 3), given, method="maximum-likelihood")
    assert exact.misfit > 5
