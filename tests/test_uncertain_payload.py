"""The payload's mass: one unknown that the inertias of all poses share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from random_cases import tries

from jointid import (
    Elasticity,
    Excitation,
    Inertia,
    Measurement,
    RobotModel,
    Study,
    extract_phasors,
    identify_elasticity,
    load_study,
    save_study,
    simulate_records,
)
from jointid.estimation.estimators.inertia_prior import InertiaPrior

ROBOT = RobotModel.load(Path(__file__).parents[1] / "sample_data" / "six_axis_robot.toml")
M = [0.0025, 0.0010]
POSES = [[[0.0041, 0.0004], [0.0004, 0.0019]], [[0.0081, 0.0021], [0.0021, 0.0019]]]
BY_PAYLOAD = [[[0.0006, 0.0001], [0.0001, 0.0004]], [[0.0015, 0.0006], [0.0006, 0.0004]]]
TRUE = Elasticity(K=[52.3, 6.1], D=[0.2, 0.03])
MISSED = 1.3


def given() -> list[Inertia]:
    return [Inertia(M, M2, shared=by) for M2, by in zip(POSES, BY_PAYLOAD, strict=True)]


def test_an_uncertain_payload_changes_the_inertia_of_every_pose_together() -> None:
    q = np.deg2rad([0.0, -60.0, 100.0, 20.0, 40.0, 10.0])
    heavier = ROBOT.with_payload(mass=ROBOT.payload.mass + 2 * ROBOT.payload.mass_std)
    exact = ROBOT.with_payload(mass_std=0.0)
    found = ROBOT.inertia(q)
    np.testing.assert_allclose(found.M2 + 2 * found.shared, heavier.inertia(q).M2, rtol=1e-9, atol=1e-12)
    assert not exact.inertia(q).shared.any()
    np.testing.assert_allclose(
        found.gravity + 2 * found.shared_gravity, heavier.inertia(q).gravity, rtol=1e-9, atol=1e-9
    )


def test_the_information_is_the_inverse_of_the_covariance() -> None:
    for std in (0.0, 0.05):
        prior = InertiaPrior.of(given(), 2, 2, inertia_std=std)
        product = prior.information("M2") @ prior.covariance("M2")
        np.testing.assert_allclose(product, np.eye(6), atol=1e-5)
        np.testing.assert_allclose(np.diag(prior.covariance("M2")), prior.blocks()["M2"][1].ravel() ** 2)


def test_stiffness_and_payload_come_back_from_two_poses() -> None:
    records, inertias = [], []
    for number, (M2, by, one) in enumerate(zip(POSES, BY_PAYLOAD, given(), strict=True)):
        true = Inertia(M, np.array(M2) + MISSED * np.array(by))
        brief = Excitation(duration_s=tries(1.5, long=4.0))
        made = simulate_records(true, TRUE, np.geomspace(3, 30, 6), excitation=brief, seed=number)
        records += made
        inertias += [one] * len(made)
    phasors = extract_phasors(records)
    fit = identify_elasticity(phasors, inertias, inertia_std=0.0)
    assert np.all(np.abs(fit.K - TRUE.K) < np.maximum(4 * fit.standard_error[:2], 1e-3 * TRUE.K))
    assert isinstance(fit.inertia, tuple)
    first = fit.inertia[0].M2
    np.testing.assert_allclose(first, np.array(POSES[0]) + MISSED * np.array(BY_PAYLOAD[0]), rtol=0.02)
    apart = identify_elasticity(phasors, inertias, inertia_std=0.3)
    assert np.all(fit.noise_error[:2] < apart.noise_error[:2])
    draws = [fit.prior.redrawn(np.random.default_rng(k), fit.parameters) for k in range(50)]
    shifts = np.array([draw.offsets["M2"] for draw in draws])
    assert np.corrcoef(shifts[:, 0, 0], shifts[:, 1, 0])[0, 1] > 0.99


def test_a_wrong_payload_does_not_fit_as_another_gravity() -> None:
    """The payload's mass changes the arm's inertia and its weight together."""
    q = np.deg2rad([0.0, -60.0, 100.0, 20.0, 40.0, 10.0])
    true = ROBOT.inertia(q)
    K = np.array([5.0e6, 7.5e6, 4.2e6, 1.3e6, 1.1e6, 0.4e6]) / ROBOT.gear_ratio**2
    quiet = Measurement(position_noise_rad=1e-6, torque_noise_Nm=1e-3)
    records = simulate_records(
        true, Elasticity(K, 0.003 * K), np.geomspace(3, 40, tries(6, long=9)), measurement=quiet, seed=1
    )
    carrying = ROBOT.with_payload(mass=ROBOT.payload.mass + 35, mass_std=40.0)
    fit = identify_elasticity(extract_phasors(records), carrying.inertia(q), inertia_std=0.0)
    np.testing.assert_allclose(fit.K, K, rtol=1e-3)
    assert not any("gravity" in each.name for each in fit.candidates if each.chosen)
    found = fit.inertia[0] if isinstance(fit.inertia, tuple) else fit.inertia
    assert isinstance(found, Inertia)
    np.testing.assert_allclose(found.gravity, true.gravity, atol=0.01 * np.abs(true.gravity).max())


def test_a_study_keeps_the_common_unknown(tmp_path: Path) -> None:
    records = simulate_records(given()[0], TRUE, [3.0, 9.0], excitation=Excitation(periods=3.0))
    study = Study(records, given()[0], name="Payload")
    save_study(study, tmp_path / "study")
    np.testing.assert_array_equal(load_study(tmp_path / "study").inertia.shared, BY_PAYLOAD[0])
