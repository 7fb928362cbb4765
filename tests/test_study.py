"""Consistency of a study; ``analyse`` equals the steps called one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from plants import (
    BAND_HZ,
    ONE,
    PAPER,
    PARALLELOGRAM,
    ROBOTS,
    SERIAL,
    campaign,
    steady_records,
)

from jointid import (
    Elasticity,
    JointIdError,
    SineRecord,
    Study,
    analyse,
    estimate_transfer_matrix,
    extract_phasors,
    identify_elasticity,
    motor_response,
)

METHODS = ["least-squares", "explicit", "weighted"]
RECORDS = steady_records(SERIAL, PAPER, *campaign(BAND_HZ, 2), noise=(1e-5, 3e-3), periods=16.3)


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("method", METHODS)
def test_without_noise_the_analysis_is_exact(n: int, method: str) -> None:
    inertia, elasticity = ROBOTS[n]
    records = steady_records(inertia, elasticity, *campaign(BAND_HZ, n), periods=9.37, hold=True)
    analysis = analyse(Study(records, inertia), method=method)
    assert np.allclose(analysis.fit.K, elasticity.K, rtol=1e-6)
    assert np.allclose(analysis.fit.D, elasticity.D, rtol=1e-5)
    matrix = analysis.transfer_matrices[""]
    assert np.allclose(matrix.H, motor_response(matrix.omega, inertia, elasticity), rtol=1e-5)


def test_analysis_is_its_steps() -> None:
    study = Study(RECORDS, SERIAL, name="cell", nominal=Elasticity(K=[20.0, 3.5], D=[0.1, 0.015]))
    analysis = analyse(study, method="weighted")
    phasors = extract_phasors(RECORDS)
    assert analysis.study is study
    assert np.array_equal(analysis.phasors.q, phasors.q)
    expected = identify_elasticity(phasors, SERIAL, method="weighted", inertia_std=0.05)
    assert np.array_equal(analysis.fit.K, expected.K)
    assert np.array_equal(analysis.fit.covariance, expected.covariance)
    assert np.array_equal(analysis.transfer_matrices[""].H, estimate_transfer_matrix(phasors).H)
    assert analysis.transfer_problem == ""
    for method in METHODS:
        assert analysis.fits[method].method == method


def test_two_analyses_of_a_study_are_equal() -> None:
    first, second = (analyse(Study(RECORDS, SERIAL)) for _ in range(2))
    assert np.array_equal(first.fit.K, second.fit.K)
    assert np.array_equal(first.fit.covariance, second.fit.covariance)
    assert first.findings == second.findings


def test_poses_are_told_apart() -> None:
    frequencies, torques = campaign(BAND_HZ, 2)
    records = [
        *steady_records(SERIAL, PAPER, frequencies, torques),
        *steady_records(PARALLELOGRAM, PAPER, frequencies, torques, pose="cutting"),
    ]
    study = Study(records, SERIAL, poses={"cutting": PARALLELOGRAM})
    assert study.inertias[0] is SERIAL
    assert study.inertias[-1] is PARALLELOGRAM
    analysis = analyse(study, method="weighted")
    assert np.allclose(analysis.fit.K, PAPER.K, rtol=1e-6)
    assert set(analysis.transfer_matrices) == {"", "cutting"}
    for pose, inertia in [("", SERIAL), ("cutting", PARALLELOGRAM)]:
        matrix = analysis.transfer_matrices[pose]
        assert np.allclose(matrix.H, motor_response(matrix.omega, inertia, PAPER), rtol=1e-5)


def test_elasticity_is_found_where_the_transfer_matrix_cannot_be() -> None:
    analysis = analyse(Study(RECORDS[::2], SERIAL), method="weighted")  # one record per frequency
    assert not analysis.transfer_matrices
    assert "2 joints need 2" in analysis.transfer_problem
    assert np.allclose(analysis.fit.K, PAPER.K, rtol=0.05)


def test_a_single_record_is_a_study() -> None:
    analysis = analyse(Study(RECORDS[6:7], SERIAL), method="weighted")
    error = analysis.fit.standard_error
    assert np.all(np.abs(analysis.fit.K - PAPER.K) < 5 * error[:2])
    assert np.all(np.abs(analysis.fit.D - PAPER.D) < 5 * error[2:])


@pytest.mark.parametrize("name", ["", " "])
def test_a_pose_has_a_name(name: str) -> None:
    """Without a name its records would count as those without a pose, which have another inertia."""
    with pytest.raises(JointIdError, match="A pose has no name"):
        Study(RECORDS, SERIAL, poses={name: PARALLELOGRAM})


def test_poses_and_records_of_a_study_cannot_change() -> None:
    poses = {"cutting": PARALLELOGRAM}
    study = Study(RECORDS, SERIAL, poses=poses)
    poses["other"] = SERIAL
    assert set(study.poses) == {"cutting"}
    assert isinstance(study.records, tuple)
    with pytest.raises(TypeError):
        study.poses["other"] = SERIAL  # type: ignore[index]


ONE_JOINT = SineRecord(5.0, np.arange(1000) / 1000, np.zeros(1000), np.zeros(1000), label="a.csv")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"records": []}, "no records"),
        ({"records": None}, "records"),
        ({"records": [1]}, "SineRecord"),
        ({"records": [*RECORDS, ONE_JOINT]}, r"a.csv has 1 joint.*inertia has 2"),
        ({"inertia": ONE}, r"record 1 has 2 joint.*inertia has 1"),
        ({"inertia": None}, "Inertia"),
        ({"nominal": Elasticity(K=[1.0], D=[0.0])}, "nominal has 1 joint"),
        ({"poses": {"bent": ONE}}, "bent has 1 joint"),
        ({"origin": "dreamt"}, 'origin = "dreamt".*simulated.*measured'),
    ],
)
def test_an_inconsistent_study_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(JointIdError, match=message):
        Study(**{"records": RECORDS, "inertia": SERIAL, **changes})


def test_unknown_pose_is_named_with_the_known_ones() -> None:
    record = steady_records(SERIAL, PAPER, BAND_HZ[:1], np.ones((1, 2)), pose="bent")
    with pytest.raises(JointIdError, match=r'record 1: pose "bent" is not defined.*cutting'):
        Study(record, SERIAL, poses={"cutting": PARALLELOGRAM})


def test_unknown_method_is_refused_before_any_work() -> None:
    with pytest.raises(JointIdError, match=r'"magic" is not known'):
        analyse(Study(RECORDS, SERIAL), method="magic")


@pytest.mark.parametrize("wrong", [None, 3, "study", RECORDS])
def test_a_value_that_is_no_study_is_refused(wrong: object) -> None:
    with pytest.raises(JointIdError):
        analyse(wrong)  # type: ignore[arg-type]
