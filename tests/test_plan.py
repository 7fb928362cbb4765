"""Planned records: predictions against simulated campaigns, suggestions within their limits."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from plants import BAND_HZ, PAPER, PARALLELOGRAM, ROBOTS, SERIAL, campaign, rubbing, steady_records
from random_cases import tries

from jointid import (
    ElasticityFit,
    Excitation,
    Inertia,
    JointIdError,
    Measurement,
    MotorFriction,
    Phasors,
    SineRecord,
    Study,
    analyse,
    extract_phasors,
    identify_elasticity,
    simulate_records,
)
from jointid.figures.uncertainty import worst_error
from jointid.gears.gear import Gear
from jointid.ui.study.plan_form import suggested_table
from jointid.uncertainty.plan import (
    PlannedRecords,
    planned_records,
    predict_standard_errors,
    suggest_records,
)

NOISE = (1e-4, 1e-2)


def run(
    inertia: Inertia, frequencies: np.ndarray, torques: np.ndarray, seconds: float, seed: int
) -> Phasors:
    n = inertia.n
    springs = ROBOTS[n][1]
    records = []
    for k, (f, torque) in enumerate(zip(frequencies, torques, strict=True)):
        records += steady_records(
            inertia, springs, [f], torque[None], noise=NOISE, periods=seconds * f, seed=1000 * seed + k
        )
    return extract_phasors(records)


@cache
def base(n: int = 2) -> tuple[Phasors, ElasticityFit]:
    inertia, _ = ROBOTS[n]
    phasors = run(inertia, *campaign(BAND_HZ, n), 3.0, 1)
    return phasors, identify_elasticity(phasors, inertia, method="maximum-likelihood")


@cache
def under_friction() -> tuple[Phasors, ElasticityFit]:
    phasors = extract_phasors(rubbing())
    return phasors, identify_elasticity(
        phasors, PARALLELOGRAM, method="maximum-likelihood", friction=True
    )


# --------------------------------------------------------------------------------------------- planning


@pytest.mark.parametrize("n", [1, 2, 3])
def test_torque_and_motion_are_two_views_of_one_plan(n: int) -> None:
    inertia, springs = ROBOTS[n]
    frequencies, torques = campaign([4.0, 11.0], n)
    by_torque = planned_records(inertia, springs, frequencies, torque_Nm=torques)
    by_angle = planned_records(inertia, springs, frequencies, angle_rad=by_torque.angle_rad)
    assert np.allclose(by_angle.torque_Nm, torques)
    speed = np.abs(by_torque.angle_rad) * 2 * np.pi * frequencies[:, None]
    assert np.allclose(by_torque.velocity_rad_s, speed)


def test_an_invalid_plan_is_refused() -> None:
    with pytest.raises(JointIdError, match="either the torques or the angles"):
        planned_records(SERIAL, PAPER, [3.0])
    with pytest.raises(JointIdError, match="one period"):
        planned_records(SERIAL, PAPER, [3.0], torque_Nm=[1, 1], duration_s=0.1)
    with pytest.raises(JointIdError, match=r"one column per joint \(2\)"):
        planned_records(SERIAL, PAPER, [3.0], torque_Nm=[1, 1, 1])


# ------------------------------------------------------------------------------------------- prediction


@pytest.mark.parametrize("n", [1, 2, 3])
def test_present_errors_are_those_of_the_fit(n: int) -> None:
    phasors, fit = base(n)
    inertia, _ = ROBOTS[n]
    plan = planned_records(inertia, fit.elasticity, [9.0], torque_Nm=np.ones(n))
    predicted = predict_standard_errors(plan, phasors, inertia, fit)
    assert np.allclose(predicted.today, fit.standard_error, rtol=0.1)
    assert np.all(predicted.together < predicted.today)


def test_a_plan_for_gears_that_changed_starts_from_the_errors_of_the_fit() -> None:
    """K falls by 2 % over the records: the plan ended with a KeyError."""
    frequencies, torques = campaign(BAND_HZ, 2)
    records = []
    for k, (f, torque) in enumerate(zip(frequencies, torques, strict=True)):
        springs = replace(PAPER, K=PAPER.K * (1.01 - 0.02 * k / (frequencies.size - 1)))
        records += steady_records(SERIAL, springs, [f], torque[None], noise=NOISE, seed=k)
    phasors = extract_phasors(records)
    fit = identify_elasticity(phasors, SERIAL)
    assert "stiffness_change" in fit.parameters.layout
    plan = planned_records(SERIAL, fit.elasticity, [9.0], torque_Nm=np.ones(2))
    predicted = predict_standard_errors(plan, phasors, SERIAL, fit)
    assert np.allclose(predicted.today, fit.standard_error, rtol=0.1)
    assert np.all(predicted.together < predicted.today)


def test_repeated_records_reduce_errors_by_root_two() -> None:
    phasors, fit = base()
    frequencies, torques = campaign(BAND_HZ, 2)
    plan = planned_records(SERIAL, fit.elasticity, frequencies, torque_Nm=torques, duration_s=3.0)
    predicted = predict_standard_errors(plan, phasors, SERIAL, fit)
    assert np.allclose(predicted.planned / predicted.today, 1, rtol=0.05)
    assert np.allclose(predicted.together / predicted.today, np.sqrt(0.5), rtol=0.05)
    longer = planned_records(SERIAL, fit.elasticity, frequencies, torque_Nm=torques, duration_s=12.0)
    assert np.allclose(
        predict_standard_errors(longer, phasors, SERIAL, fit).planned, predicted.planned / 2
    )
    larger = planned_records(SERIAL, fit.elasticity, frequencies, torque_Nm=3 * torques, duration_s=3.0)
    assert np.allclose(
        predict_standard_errors(larger, phasors, SERIAL, fit).planned, predicted.planned / 3
    )


def test_prediction_against_campaigns() -> None:
    """A plan unlike the records it is predicted from, carried out 60 times."""
    phasors, fit = base()
    frequencies, torques = campaign([6.1, 9.4, 17.3, 24.1], 2, amplitude=1.7)
    plan = planned_records(SERIAL, fit.elasticity, frequencies, torque_Nm=torques, duration_s=2.0)
    predicted = predict_standard_errors(plan, phasors, SERIAL, fit).planned / np.sqrt(
        max(1.0, fit.misfit)
    )
    errors = []
    for seed in range(60):
        made = identify_elasticity(
            run(SERIAL, frequencies, torques, 2.0, 100 + seed), SERIAL, method="maximum-likelihood"
        )
        errors.append(np.r_[made.K, made.D] - np.r_[PAPER.K, PAPER.D])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / predicted
    assert np.all((ratio > 0.7) & (ratio < 1.4)), ratio


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("std", [0.05, 0.3, np.inf])
def test_uncertain_inertias_are_part_of_the_prediction(n: int, std: float) -> None:
    """A plan unlike the records it is predicted from, against what fits to it state."""
    inertia, springs = ROBOTS[n]
    phasors, _ = base(n)
    uncertain = {"inertia_std": std, "torque_std": 0.02, "method": "maximum-likelihood"}
    fit = identify_elasticity(phasors, inertia, **uncertain)
    frequencies, torques = campaign([6.1, 9.4, 17.3, 24.1], n, amplitude=1.7)
    plan = planned_records(inertia, springs, frequencies, torque_Nm=torques, duration_s=2.0)
    predicted = predict_standard_errors(plan, phasors, inertia, fit)
    assert np.allclose(predicted.today, fit.standard_error, rtol=0.02)
    stated = [
        identify_elasticity(
            run(inertia, frequencies, torques, 2.0, seed), inertia, **uncertain
        ).standard_error
        for seed in range(200, 204)
    ]
    assert np.allclose(predicted.planned / np.mean(stated, axis=0), 1, atol=0.15)
    exact = predict_standard_errors(plan, phasors, inertia, base(n)[1])
    assert np.all(exact.planned < predicted.planned)


def test_a_linear_estimator_plans_with_its_own_error() -> None:
    phasors, _ = base()
    fit = identify_elasticity(phasors, SERIAL, method="weighted", inertia_std=0.05)
    frequencies, torques = campaign(BAND_HZ, 2)
    plan = planned_records(SERIAL, fit.elasticity, frequencies, torque_Nm=torques, duration_s=30.0)
    predicted = predict_standard_errors(plan, phasors, SERIAL, fit)
    assert np.allclose(predicted.today, fit.standard_error, rtol=0.1)
    assert np.allclose(predicted.together, fit.standard_error, rtol=0.1)  # more records do not help


def test_another_pose_has_inertias_of_its_own() -> None:
    """Records at a new pose cannot be better than those at the same one: M2 there is unknown."""
    phasors, _ = base()
    fit = identify_elasticity(phasors, SERIAL, method="maximum-likelihood", inertia_std=0.05)
    frequencies, torques = campaign([9.0], 2)
    stretched = Inertia(SERIAL.M, (1 + 1e-6) * SERIAL.M2)
    plan = planned_records(SERIAL, fit.elasticity, frequencies, torque_Nm=torques, duration_s=3.0)
    same = predict_standard_errors(plan, phasors, SERIAL, fit)
    other = predict_standard_errors(plan, phasors, SERIAL, fit, planned_inertia=stretched)
    assert np.all(other.together > same.together)
    assert np.all(other.together < other.today)


def test_friction_is_part_of_the_prediction() -> None:
    phasors, fit = under_friction()
    plan = planned_records(
        PARALLELOGRAM,
        fit.elasticity,
        phasors.omega / (2 * np.pi),
        angle_rad=phasors.q,
        duration_s=2.0,
    )
    predicted = predict_standard_errors(plan, phasors, PARALLELOGRAM, fit)
    assert np.allclose(predicted.today, fit.standard_error, rtol=0.05)
    noise = np.sqrt(predicted.today**2 - np.square(fit.unseen_error))
    assert np.allclose(noise, fit.noise_error, rtol=0.05)
    assert np.allclose(predicted.planned, predicted.today, rtol=0.1)
    # A joint that stands sticks: that record tells nothing of its own.
    still = planned_records(PARALLELOGRAM, fit.elasticity, [9.0], angle_rad=[0.05, 0])
    alone = predict_standard_errors(still, phasors, PARALLELOGRAM, fit).planned
    assert np.isinf(alone[[1, 3]]).all()


def test_friction_by_load_is_followed_to_other_poses_and_records() -> None:
    """It needs the inertias of these records; the fit of each pose alone, and the plan, failed."""
    M, K, D = 0.0006, 9.0, 0.018
    arms = {"": 0.0014, "stretched": 0.0024}
    rng, t, records = np.random.default_rng(1), np.arange(3000) / 1000, []
    for (pose, M2), f in product(arms.items(), np.geomspace(6, 40, 8)):
        s, theta = 2j * np.pi * f, 1 / f
        wave = theta * np.exp(s * t)
        gear = (wave / (1 / (K + s * D) + 1 / (M2 * s * s))).imag
        tau = (wave * M * s * s).imag + gear + (0.02 + 0.1 * np.abs(gear)) * np.sign((wave * s).imag)
        tau += 0.003 * tau.std() * rng.standard_normal(t.size)
        angle = wave.imag + 1e-6 * rng.standard_normal(t.size)
        records.append(
            SineRecord(f, t, angle[:, None], tau[:, None], pose=pose or None, torque_hold=False)
        )
    inertia, other = (Inertia([M], [[M2]]) for M2 in arms.values())
    study = Study(records, inertia, poses={"stretched": other}, inertia_std=0.05, torque_std=0.0)
    found = analyse(study)
    assert found.fit.parameters["load"] == pytest.approx(0.1, rel=0.1)
    assert np.all(np.abs(found.fit.estimate - [K, D]) < 3 * found.fit.standard_error)
    plan = suggest_records(found.phasors, study.inertias, found.fit, count=2, duration_s=3.0)
    assert np.all(np.diff(plan.worst) < 0)


def test_a_plan_beyond_a_hardening_gear_does_not_determine_the_torque_scale() -> None:
    """Torques that the iteration had not found predicted errors of 0.002 % in place of 2 %/√2."""
    records = simulate_records(
        PARALLELOGRAM,
        PAPER,
        np.geomspace(3, 30, 8),
        excitation=Excitation(duration_s=tries(1.5, nightly=4.0)),
        gears=[Gear(cubic=9000.0), Gear()],
        measurement=Measurement(encoder_counts=65536, torque_noise_Nm=0.01),
    )
    study = Study(records, PARALLELOGRAM, inertia_std=0.05, torque_std=0.02)
    found = analyse(study)
    assert found.fit.gears[0].kind == "hardening"
    plan = suggest_records(found.phasors, study.inertias, found.fit, count=1)
    assert np.all(plan.relative_error[:, :2] > 0.9 * found.fit.standard_error[:2] / found.fit.K)


def test_parameters_that_a_plan_does_not_determine_have_infinite_errors() -> None:
    phasors, fit = base()
    rigid = Inertia(M=SERIAL.M, M2=np.diag(np.diag(SERIAL.M2)))
    plan = planned_records(rigid, fit.elasticity, [9.0], torque_Nm=[1, 0])
    predicted = predict_standard_errors(plan, phasors, SERIAL, fit, planned_inertia=rigid)
    assert np.isinf(predicted.planned[[1, 3]]).all()
    assert np.isfinite(predicted.planned[[0, 2]]).all()
    assert np.isfinite(predicted.together).all()


# ------------------------------------------------------------------------------------------- suggestion


@pytest.mark.parametrize("n", [1, 2, 3])
def test_suggestion_reduces_the_worst_error(n: int) -> None:
    phasors, fit = base(n)
    inertia, _ = ROBOTS[n]
    suggestion = suggest_records(phasors, inertia, fit, count=3, duration_s=3.0)
    assert suggestion.relative_error.shape == (4, 2 * n)
    assert np.all(np.diff(suggestion.worst) < 0)
    assert np.all(np.diff(suggestion.relative_error, axis=0) <= 0)
    records = suggestion.records
    table = suggested_table(suggestion)
    assert len(table) == 5  # a phone shows as many columns, of six joints, too
    assert [cell.count(", ") for cell in table["Motor velocities (rad/s)"]] == 3 * [n - 1]
    again = predict_standard_errors(records, phasors, inertia, fit)
    assert np.allclose(again.together / np.abs(fit.estimate), suggestion.relative_error[-1])
    # Better than the same number of records taken at random from what was done before.
    rng = np.random.default_rng(0)
    frequencies, torques = campaign(BAND_HZ, n)
    for _ in range(5):
        rows = rng.integers(0, len(torques), 3)
        plan = planned_records(
            inertia, fit.elasticity, frequencies[rows], torque_Nm=torques[rows], duration_s=3.0
        )
        other = predict_standard_errors(plan, phasors, inertia, fit)
        assert (other.together / fit.estimate).max() > suggestion.worst[-1]


def test_suggested_records_reach_the_predicted_errors() -> None:
    phasors, fit = base()
    suggestion = suggest_records(phasors, SERIAL, fit, count=2, duration_s=3.0)
    promised = suggestion.relative_error[-1] * np.abs(np.r_[fit.K, fit.D])
    promised /= np.sqrt(max(1.0, fit.misfit))
    frequencies, torques = campaign(BAND_HZ, 2)
    errors = []
    for seed in range(40):
        made = identify_elasticity(
            run(
                SERIAL,
                np.r_[frequencies, suggestion.records.frequency_hz],
                np.vstack([torques, suggestion.records.torque_Nm]),
                3.0,
                500 + seed,
            ),
            SERIAL,
            method="maximum-likelihood",
        )
        errors.append(np.r_[made.K, made.D] - np.r_[PAPER.K, PAPER.D])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / promised
    assert np.all((ratio > 0.65) & (ratio < 1.5)), ratio


@pytest.mark.parametrize("n", [1, 2])
def test_suggestion_adds_the_record_that_determines_the_parameters(n: int) -> None:
    """Unknown inertias at one frequency: nothing is determined until another one is added."""
    inertia, _ = ROBOTS[n]
    phasors = run(inertia, *campaign([6.0], n), 3.0, 1)
    phasors = replace(
        phasors,
        harmonics=phasors.harmonics[:, :1],
        harmonic_covariance=phasors.harmonic_covariance[:, :1],
    )
    fit = identify_elasticity(phasors, inertia, method="maximum-likelihood", inertia_std=np.inf)
    assert np.all(np.isinf(fit.standard_error))
    suggestion = suggest_records(phasors, inertia, fit, count=2, duration_s=3.0)
    assert np.all(np.isinf(suggestion.relative_error[0]))
    assert np.all(suggestion.relative_error[-1] < 0.01)
    assert np.all(np.abs(suggestion.records.frequency_hz / 6.0 - 1) > 0.2)
    worst_error(suggestion)


def test_harmonics_below_the_noise_give_no_information() -> None:
    inertia, _ = ROBOTS[1]
    phasors = run(inertia, *campaign([6.0], 1), 3.0, 1)
    fit = identify_elasticity(phasors, inertia, method="maximum-likelihood", inertia_std=np.inf)
    plan = planned_records(inertia, fit.elasticity, [9.0, 15.0], torque_Nm=[1.0])
    predicted = predict_standard_errors(plan, phasors, inertia, fit)
    assert np.all(np.isinf(predicted.today))
    assert np.all(np.isfinite(predicted.together))


def velocities(records: PlannedRecords, inertia: Inertia) -> np.ndarray:
    """Of motors and arm, by the motors' equation of motion."""
    omega = 2 * np.pi * records.frequency_hz[:, None]
    on_arm = records.torque_Nm + inertia.M * omega**2 * records.angle_rad
    arm = np.linalg.solve(inertia.M2, on_arm.T).T / -(omega**2)
    return omega * np.maximum(np.abs(arm), np.abs(records.angle_rad))


@pytest.mark.parametrize(("torque", "velocity"), [(0.5, 2.0), (3.0, 0.3), (0.05, 10.0)])
def test_suggestion_stays_within_the_limits(torque: float, velocity: float) -> None:
    phasors, fit = base()
    suggestion = suggest_records(
        phasors,
        SERIAL,
        fit,
        torque_limit_Nm=[torque, torque / 2],
        velocity_limit_rad_s=[velocity, velocity],
    )
    torques = np.abs(suggestion.records.torque_Nm) / [torque, torque / 2]
    speeds = velocities(suggestion.records, SERIAL) / velocity
    assert np.all(torques <= 1 + 1e-9)
    assert np.all(speeds <= 1 + 1e-9)
    assert np.allclose(np.maximum(torques, speeds).max(axis=1), 1)  # and uses them


def test_suggestion_reserves_torque_for_viscous_friction() -> None:
    """That of planned sines is beside the acceleration: without it, up to 1.4 times the limit."""
    viscous = np.array([0.08])
    friction = MotorFriction(coulomb=0.02, viscous=viscous, step_s=2.5e-4)
    inertia, springs = ROBOTS[1]
    brief = Excitation(duration_s=2.0)
    phasors = extract_phasors(
        simulate_records(inertia, springs, BAND_HZ[:3], friction=friction, excitation=brief)
    )
    fit = identify_elasticity(phasors, inertia, method="maximum-likelihood", friction=True)
    sines = suggest_records(phasors, inertia, fit, torque_limit_Nm=[1.0]).records
    rubbing = 2j * np.pi * sines.frequency_hz[:, None] * viscous * sines.angle_rad
    needed = np.abs(sines.torque_Nm + rubbing) + 4 / np.pi * 0.02
    assert needed.max() == pytest.approx(1.0, abs=0.01)


def test_suggestion_reserves_torque_for_friction() -> None:
    phasors, fit = under_friction()
    assert fit.friction is not None
    suggestion = suggest_records(phasors, PARALLELOGRAM, fit, torque_limit_Nm=[1.0, 0.5])
    left = np.array([1.0, 0.5]) - 4 / np.pi * fit.friction.coulomb
    assert np.all(np.abs(suggestion.records.torque_Nm) <= left + 1e-9)
    assert np.all(np.abs(suggestion.records.angle_rad) > 0)
    with pytest.raises(JointIdError, match="joint 1 does not exceed its friction"):
        suggest_records(phasors, PARALLELOGRAM, fit, torque_limit_Nm=[0.1, 0.5])


def test_settings_out_of_range_are_refused() -> None:
    phasors, fit = base()
    for wrong, message in [
        ({"count": 0}, "count"),
        ({"torque_limit_Nm": [-1.0, 1.0]}, "torque_limit_Nm"),
        ({"velocity_limit_rad_s": [1.0, 1.0, 1.0]}, "velocity_limit_rad_s"),
    ]:
        with pytest.raises(JointIdError, match=message):
            suggest_records(phasors, SERIAL, fit, **wrong)


def test_suggested_frequencies_stay_in_a_sensible_band() -> None:
    """Resonances of an uncertain stiffness may be anywhere; records there would not help."""
    records = steady_records(SERIAL, PAPER, *campaign(BAND_HZ, 2), noise=(1e-5, 3e-3), seed=1)
    phasors = extract_phasors(records)
    fit = identify_elasticity(phasors, SERIAL, method="weighted")
    soft = replace(fit, K=1e-9 * fit.K)
    low = suggest_records(phasors, SERIAL, soft, count=5, duration_s=20.0).records.frequency_hz
    assert low.min() >= 0.0999 * BAND_HZ.min()
    stiff = replace(fit, K=1e9 * fit.K)
    high = suggest_records(phasors, SERIAL, stiff, count=5, highest_hz=100.0).records.frequency_hz
    assert high.max() <= 100.1
    below = suggest_records(phasors, SERIAL, fit, count=2, highest_hz=0.5 * BAND_HZ.max())
    assert below.records.frequency_hz.max() <= 0.5 * BAND_HZ.max()
