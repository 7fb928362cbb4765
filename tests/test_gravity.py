"""Gravity stiffness in the model, the simulated robot, the fit and the study."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigvals

from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Inertia,
    JointIdError,
    RobotModel,
    SineRecord,
    Study,
    diagonal_zeros,
    extract_phasors,
    identify_elasticity,
    load_study,
    motor_response,
    resonances,
    save_study,
    simulate_records,
)
from jointid.estimation.estimators.whitened_residual import WhitenedResidual
from jointid.uncertainty.chosen_model import fitted_problem
from tests.robots import SIX_AXES

G = np.array([[0.05, 0.02], [0.02, 0.03]])
INERTIA = Inertia([0.0025, 0.0010], [[0.0041, 0.0004], [0.0004, 0.0019]], gravity=G)
FLAT = Inertia(INERTIA.M, INERTIA.M2)
ELASTICITY = Elasticity([43.0, 7.5], [0.10, 0.015])


def test_response_is_that_of_the_equations_of_motion() -> None:
    """H from the dynamic stiffness of motors and arm as one matrix, at three frequencies."""
    omega = np.array([5.0, 60.0, 150.0])
    for w, H in zip(omega, motor_response(omega, INERTIA, ELASTICITY), strict=True):
        s = 1j * w
        spring = np.diag(ELASTICITY.K + s * ELASTICITY.D)
        whole = np.block([
            [np.diag(s**2 * INERTIA.M) + spring, -spring],
            [-spring, s**2 * INERTIA.M2 + G + spring],
        ])  # fmt: skip
        np.testing.assert_allclose(H, s**2 * np.linalg.inv(whole)[:2, :2], rtol=1e-10)


def test_resonances_with_gravity() -> None:
    spring = np.diag(ELASTICITY.K)
    stiffness = np.block([[spring, -spring], [-spring, spring + G]])
    mass = np.block([[np.diag(INERTIA.M), np.zeros((2, 2))], [np.zeros((2, 2)), INERTIA.M2]])
    found = np.sort(np.sqrt(np.abs(eigvals(stiffness, mass).real))) / (2 * np.pi)
    np.testing.assert_allclose(resonances(INERTIA, ELASTICITY), found[2:], rtol=1e-9)
    assert diagonal_zeros(INERTIA, ELASTICITY).shape == (2, 2)
    tiny = Inertia(INERTIA.M, INERTIA.M2, gravity=1e-9 * G)
    np.testing.assert_allclose(resonances(tiny, ELASTICITY), resonances(FLAT, ELASTICITY), rtol=1e-8)


def test_gravity_in_the_fit() -> None:
    """Records of a robot under gravity: exact with it, wrong without it by every estimator."""
    brief = Excitation(duration_s=2.0)
    records = simulate_records(INERTIA, ELASTICITY, np.geomspace(2, 30, 8), excitation=brief)
    phasors = extract_phasors(records)
    for method in ("auto", "weighted", "least-squares", "explicit"):
        fit = identify_elasticity(phasors, INERTIA, method=method)
        np.testing.assert_allclose(fit.K, ELASTICITY.K, rtol=2e-4)
        np.testing.assert_allclose(fit.D, ELASTICITY.D, rtol=2e-3)
    wrong = identify_elasticity(phasors, FLAT, method="least-squares")
    assert np.abs(wrong.K / ELASTICITY.K - 1).max() > 0.001


def test_gravity_is_one_symmetric_matrix() -> None:
    with pytest.raises(JointIdError, match=r"gravity has shape \(1, 1\): expected \(2, 2\)"):
        Inertia([1.0, 1.0], np.eye(2), gravity=[[1.0]])
    with pytest.raises(JointIdError, match="gravity must be symmetric"):
        Inertia([1.0, 1.0], np.eye(2), gravity=[[1.0, 2.0], [0.0, 1.0]])


ROBOT = RobotModel.parse("six.toml", SIX_AXES.encode())
POSES = {"": np.deg2rad([0, -60, 100, 20, 40, 10.0]), "low": np.deg2rad([30, -20, 70, 20, 40, 10.0])}


def six_axes(robot: RobotModel = ROBOT) -> Study:
    N2 = robot.gear_ratio**2
    K = np.array([5e6, 7.5e6, 4.2e6, 1.3e6, 1.1e6, 0.4e6]) / N2
    records = []
    for name, q in POSES.items():
        records += simulate_records(
            robot.inertia(q),
            Elasticity(K, 0.003 * K),
            [6.0, 25.0],
            excitation=Excitation(periods=8),
            controller=Controller(sample_rate_hz=1000.0, bandwidth_hz=6.0),
            pose=name or None,
        )
    return Study(
        records, robot.inertia(POSES[""]), robot_model=robot, pose_angles_rad=POSES, inertia_std=0.0
    )


def test_a_study_by_joint_angles(tmp_path: Path) -> None:
    """M2 and gravity of each pose come from the model; saved and read, the study is the same."""
    for robot in (ROBOT, ROBOT.with_payload(mass=80.0)):
        study = six_axes(robot)
        save_study(study, tmp_path / f"{robot.payload.mass:g}.zip")
        read = load_study(tmp_path / f"{robot.payload.mass:g}.zip")
        for one, other in ((study.inertia, read.inertia), (study.poses["low"], read.poses["low"])):
            for name in ("M", "M2", "gravity"):
                assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
        assert read.robot_model is not None
        assert read.robot_model.payload.mass == robot.payload.mass
        np.testing.assert_array_equal(read.pose_angles_rad["low"], POSES["low"])
    study = six_axes()
    found = identify_elasticity(extract_phasors(study.records), study.inertias, method="weighted")
    K = np.array([5e6, 7.5e6, 4.2e6, 1.3e6, 1.1e6, 0.4e6]) / ROBOT.gear_ratio**2
    np.testing.assert_allclose(found.K, K, rtol=1e-3)


def test_wrong_joint_angles_are_named(tmp_path: Path) -> None:
    save_study(six_axes(), tmp_path / "cell")
    file = tmp_path / "cell" / "study.toml"
    text = file.read_text()

    def refused(old: str, new: str, match: str) -> None:
        assert old in text
        file.write_text(text.replace(old, new, 1))
        with pytest.raises(JointIdError, match=match):
            load_study(tmp_path / "cell")

    refused("[poses.low]", "[poses.low]\nM2 = [[1.0]]", r"\[poses.low\].*angles and M2 are both given")
    refused("[poses.low]", "[poses.low]\nangles_deg = [1.0]", "angles_deg and angles_rad are both")
    refused('file = "robot.toml"', 'file = "../robot.toml"', "leaves its folder")
    refused('file = "robot.toml"', 'file = "other.toml"', "other.toml is missing")
    refused('[robot_model]\nfile = "robot.toml"\n', "", "need the robot model")
    refused("angles_rad = [", "angles_rad = [0.0, ", r"shape \(7,\)")
    with pytest.raises(JointIdError, match="Pose low has an M2 other than that of the robot model"):
        Study(
            six_axes().records,
            ROBOT.inertia(POSES[""]),
            poses={"low": ROBOT.inertia(POSES[""])},
            robot_model=ROBOT,
            pose_angles_rad=POSES,
        )
    with pytest.raises(JointIdError, match=r"pose 'low' is .* rad, more than two turns: give radians"):
        replace(six_axes(), poses={}, pose_angles_rad={"low": np.degrees(POSES["low"])})
    with pytest.raises(JointIdError, match=r"q \(joint angles\) has shape \(0,\)"):
        replace(six_axes(), poses={}, pose_angles_rad={"low": np.zeros(0)})


def test_friction_by_load_counts_the_mean_torque_of_a_sine() -> None:
    """Gravity loads the gear as the motion does: with the motion's torque alone the misfit was 700."""
    rng, records = np.random.default_rng(1), []
    M, M2, K, D = 0.0025, 0.0041, 43.0, 0.1
    for f in np.geomspace(5, 25, 5):
        time_s = np.arange(0, 12 / f, 5e-4)
        s = 2j * np.pi * f
        stiffness = 1 / (1 / (K + s * D) + 1 / (M2 * s * s))
        theta, velocity, gear = (
            np.imag(6 / abs(s) * np.exp(s * time_s) * factor) for factor in (1, s, stiffness)
        )
        gear += 0.3
        tau = M * (s * s).real * theta + gear + (0.02 + 0.1 * np.abs(gear)) * np.sign(velocity)
        tau += 0.005 * tau.std() * rng.standard_normal(tau.size)
        records.append(SineRecord(f, time_s, theta[:, None], tau[:, None], torque_hold=False))
    fit = identify_elasticity(extract_phasors(records), Inertia([M], [[M2]]), inertia_std=0.05)
    assert fit.friction is not None
    np.testing.assert_allclose(fit.friction.load, 0.1, rtol=0.01)
    np.testing.assert_allclose(fit.estimate, [K, D], rtol=2e-3)
    assert fit.misfit < 2


@pytest.mark.parametrize("wrong", [1.0, 1.06])
def test_gravity_is_as_uncertain_as_the_inertias(wrong: float) -> None:
    """With a gear ratio 3 % wrong, K was 0.3 % and 4.7 standard errors off: gravity was exact."""
    rng, records = np.random.default_rng(0), []
    true = replace(INERTIA, gravity=20 * G)
    for record in simulate_records(true, ELASTICITY, np.geomspace(3, 30, 8)):
        noise = 0.1 * np.abs(record.tau_Nm).max(axis=0) * rng.normal(size=record.tau_Nm.shape)
        records.append(replace(record, tau_Nm=record.tau_Nm + noise))
    given = replace(true, gravity=wrong * true.gravity)
    of = {
        std: identify_elasticity(
            extract_phasors(records), given, method="maximum-likelihood", inertia_std=std
        )
        for std in (0.05, 0.0)
    }
    fit, exact = of[0.05], of[0.0]
    off = np.abs(fit.estimate - [*ELASTICITY.K, *ELASTICITY.D])
    assert np.all(off < 3.5 * fit.standard_error)
    assert np.all(fit.standard_error[:2] < 0.004 * fit.K)
    np.testing.assert_allclose(fit.inertias[0].gravity, true.gravity, rtol=0.03)
    np.testing.assert_array_equal(exact.inertias[0].gravity, given.gravity)
    assert (exact.misfit < 2) == (wrong == 1)


def test_a_gravity_wrong_within_its_uncertainty_hardly_changes_the_answer() -> None:
    """Steps of the gravity alone left D 0.5 σ off; scores at the given one made σ 100 times larger."""
    rng, records = np.random.default_rng(0), []
    true = replace(INERTIA, gravity=20 * G)
    for record in simulate_records(true, ELASTICITY, np.geomspace(3, 30, 8)):
        noise = 0.1 * np.abs(record.tau_Nm).max(axis=0) * rng.normal(size=record.tau_Nm.shape)
        records.append(replace(record, tau_Nm=record.tau_Nm + noise))
    phasors = extract_phasors(records)
    right, wrong = (
        identify_elasticity(phasors, replace(true, gravity=factor * true.gravity), inertia_std=0.05)
        for factor in (1.0, 1.06)
    )
    assert np.all(np.abs(wrong.estimate - right.estimate) < 0.05 * right.standard_error)
    np.testing.assert_allclose(wrong.standard_error, right.standard_error, rtol=0.02)
    again = WhitenedResidual.of(fitted_problem(phasors, wrong), wrong.parameters.vector)
    np.testing.assert_allclose(again.cost, wrong.cost, rtol=1e-6)
