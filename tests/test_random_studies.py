"""Random studies: each ends in an answer or a JointIdError; no other exception, warning or output.

Studies come from seeds (``study_generator.random_study``): robots at any scale, repeated, collinear,
constant, clipped, tiny and huge signals. A failure names its seed;
``faults(seed, small=True)`` repeats it. With ``--long`` there are four times as many, with ``--nightly``
thirty times. The environment sets the number of larger studies with every use of an analysis:

    JOINTID_LONG=3000 python -m pytest -n 0 --timeout 0 tests/test_random_studies.py
"""

from __future__ import annotations

import os
import traceback

import numpy as np
import pytest
from random_cases import tries
from study_generator import faults, random_study

from benchmarks import random_studies
from jointid import Inertia, JointIdError, SineRecord, Study, analyse

AT_ONCE, EVERY = 5, 4
LONG = int(os.environ.get("JOINTID_LONG", "2"))


def told(seed: int, found: list[tuple[str, Exception]]) -> str:
    lines = [f"seed {seed}:"]
    for name, error in found:
        lines += [f"{name}: {error!r}", *traceback.format_tb(error.__traceback__)[-3:]]
    return "\n".join(lines)


@pytest.mark.parametrize("first", range(*tries((14, 19), long=(25, 45), nightly=(0, 150)), AT_ONCE))
def test_any_study_is_analysed_or_refused(first: int) -> None:
    for seed in range(first, first + AT_ONCE):
        found = faults(seed, small=True, every=EVERY)
        assert not found, told(seed, found)


@pytest.mark.parametrize("seed", range(10_000, 10_000 + LONG))
def test_any_large_study_is_analysed_or_refused(seed: int) -> None:
    found = faults(seed, slow=seed % 20 == 0)
    assert not found, told(seed, found)


@pytest.mark.usefixtures("analysed_anew")
def test_two_analyses_of_a_study_agree_or_are_both_refused() -> None:
    """With inertias known to any degree, one in four with many joints; the benchmark tries 10,000."""
    mended = (
        770284,
        9104366,
        9106792,
        71273,
        71794,
        500149,
        9100407,
        9101790,
        9109096,
        80000105,
        80001326,
        80001640,
        80003132,
        500522,
        500332,
        500968,
    )
    mended = mended[: tries(6, nightly=16)]  # the last takes longest
    seeds = (*mended, *range(100, 100 + tries(4, nightly=12)))
    found = [random_studies.trial(seed) for seed in seeds]
    assert {each.seed: each.fault for each in found if each.fault} == {}
    assert sum(each.answered for each in found) >= len(seeds) // 4
    for table in random_studies.tables(found):
        assert table.markdown()


def test_a_seed_makes_the_same_study_twice() -> None:
    first, second = (random_study(3, small=True) for _ in range(2))
    for a, b in zip(first.records, second.records, strict=True):
        np.testing.assert_array_equal(a.theta_rad, b.theta_rad)
        np.testing.assert_array_equal(a.tau_Nm, b.tau_Nm)


def two_joints(torque: np.ndarray, *, constant: tuple[bool, ...]) -> Study:
    """Records of both joints; where ``constant``, the second motor's torque is replaced by a number."""
    time = np.arange(800) / 1000
    records = []
    for k, (f, level) in enumerate(zip((5.0, 9.0, 14.0), torque, strict=True)):
        phase = 2 * np.pi * f * time[:, None] + np.array([0.0, 1.0 + k])
        tau = np.sin(phase)
        if constant[k]:
            tau[:, 1] = level
        theta = -0.05 / f * np.sin(phase + 0.1)
        records.append(SineRecord(f, time, theta, tau, label=f"run {k + 1}"))
    return Study(records=records, inertia=Inertia([0.002, 0.001], [[0.004, 0.0004], [0.0004, 0.002]]))


@pytest.mark.parametrize("level", [0.0, -3.5])
def test_a_torque_that_is_constant_in_all_records_is_refused_by_name(level: float) -> None:
    study = two_joints(np.full(3, level), constant=(True, True, True))
    with pytest.raises(
        JointIdError, match=r"Joint 2 moves, but its torque tau_m2_Nm is constant"
    ) as told:
        analyse(study)
    assert f"{level:.6g} N·m in run 1" in str(told.value)


def test_a_torque_that_is_constant_in_some_records_is_found_by_name() -> None:
    study = two_joints(np.zeros(3), constant=(False, True, False))
    found = [f for f in analyse(study).findings if "constant" in f.title]
    assert [f.title for f in found] == ["The torque of joint 2 is constant in 1 of 3 records"]
    assert "run 2" in found[0].detail
    assert found[0].level == "problem"
