"""Wrong units, signs, columns and axes, in all records or in one, by phasors of a known robot."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

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
    estimated,
    exact_phasors,
    noisy,
    plant_phasors,
)

from jointid import Elasticity, Inertia, Phasors
from jointid.verdict import rules_inertia, rules_outlier, wrong_data
from jointid.verdict.causes import DEGREES
from jointid.verdict.evidence import Finding
from jointid.verdict.scorer import VELOCITY, Hypothesis, Scorer, simplest

FREEDOM = 40.0


def long(*values: Any) -> Any:
    """A case of a kind that other cases stand for in a normal run."""
    return pytest.param(*values, marks=pytest.mark.long)


@cache
def measured(n: int = 2, noise: float = 1e-3) -> Phasors:
    """Phasors of a robot of n joints with some noise, relative to the mean amplitudes."""
    exact = plant_phasors(*ROBOTS[n], *campaign(BAND_HZ, n))
    size = noise * np.abs(exact.z).mean(axis=0)
    covariance = np.tile(np.diag(size**2) + 0j, (exact.omega.size, 1, 1))
    error = circular(np.random.default_rng(1), covariance, 1)[0]
    return noisy(exact, covariance, error, FREEDOM)


def of(z: Any, covariance: Any, like: Phasors) -> Phasors:
    """Phasors with other values."""
    n = like.n
    frequency_hz = like.omega / (2 * np.pi)
    return exact_phasors(frequency_hz, z[:, :n], z[:, n:], covariance, FREEDOM)


def logged(
    angle: Any = 1.0, torque: Any = 1.0, phasors: Phasors | None = None, row: Any = slice(None)
) -> Phasors:
    """Phasors of which some rows have scaled angles and torques."""
    phasors = phasors or measured()
    scale = np.ones((phasors.omega.size, 2, phasors.n))
    scale[row, 0], scale[row, 1] = angle, torque
    factor = scale.reshape(phasors.z.shape)
    covariance = phasors.covariance * factor[:, :, None] * factor[:, None]
    return of(phasors.z * factor, covariance, phasors)


def fault(phasors: Phasors, inertia: Inertia = SERIAL) -> Finding | None:
    found = wrong_data.wrong_data(phasors, [inertia] * phasors.omega.size)
    assert len(found) < 2
    return found[0] if found else None


# --- the scorer


@pytest.mark.parametrize(("n", "freedom"), [(1, 3), (2, 3), (2, 40)])
def test_the_score_of_right_data_is_one(n: int, freedom: int) -> None:
    """Also with variances of few degrees of freedom, of noise that the phasors share."""
    inertia, elasticity = ROBOTS[n]
    exact = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, n))
    size = 1e-3 * np.abs(exact.z).mean(axis=0)
    mixed = np.eye(2 * n) + 0.5 * (np.eye(2 * n, k=1) * 1j + np.eye(2 * n, k=-1) * -1j)
    covariance = np.tile(mixed * np.outer(size, size), (exact.omega.size, 1, 1))
    rng = np.random.default_rng(2)
    misfits, off = [], []
    for error in circular(rng, covariance, 150):
        phasors = noisy(exact, estimated(rng, covariance, freedom), error, freedom)
        scorer = Scorer.of(phasors, [inertia] * exact.omega.size)
        scores = scorer.scores([scorer.as_logged()])
        misfits.append(scores.misfit[0])
        off.append(np.r_[scores.K[0] / elasticity.K, scores.D[0] / elasticity.D] - 1)
    # The mean of a product of inverse variances of 3 degrees of freedom scatters more.
    assert np.median(misfits) == pytest.approx(1, abs=0.1 if freedom == 40 else 0.25)
    assert np.abs(np.mean(off, axis=0)).max() < 0.01


@pytest.mark.parametrize(
    ("cost", "chosen"),
    [([9, 2.0, 0.1], 1), ([9, 2.1, 0.1], 2), ([9, 6.0, 3.0], 1), ([9, 6.1, 3.0], 2), ([5, 5], 0)],
)
def test_the_simplest_hypothesis_that_explains_about_as_much_is_taken(
    cost: list[float], chosen: int
) -> None:
    """Up to twice the least residual, or twice the noise."""
    assert simplest(np.array(cost)) == chosen


def test_each_hypothesis_corrects_its_own_fault() -> None:
    phasors = measured(noise=1e-6)
    n, square = 2, phasors.omega[:, None] ** 2
    spring_torque = phasors.tau + square * SERIAL.M * phasors.q
    arm_angle = -np.linalg.solve(SERIAL.M2, spring_torque.T).T / square
    rate = np.where(np.arange(2 * n) < n, 1j * phasors.omega[:, None], 1.0)
    noise = phasors.covariance * rate[:, :, None] * rate[:, None].conj()
    velocities = replace(phasors, q=rate[:, :n] * phasors.q, covariance=noise)
    one, gear = np.ones(n), np.array([100.0, 90.0])
    plain = Hypothesis.of("arm angle", one, one)
    exchanged = replace(plain, kind="exchanged", order=np.array([1, 0, 2, 3]))
    scaled = Hypothesis.of("both", np.array([2.0, -1.0]), np.array([1.0, 5.0]))
    assert scaled.factor.tolist() == [0.5, -5.0]
    faults: list[tuple[Hypothesis, Phasors, Inertia]] = [
        (scaled, logged([2.0, -1.0], [1.0, 5.0], phasors), SERIAL),
        (exchanged, replace(phasors, q=phasors.q[:, ::-1]), SERIAL),
        (plain, replace(phasors, q=arm_angle), SERIAL),
        (replace(plain, kind="gear torque"), replace(phasors, tau=spring_torque), SERIAL),
        (replace(plain, kind=VELOCITY), velocities, SERIAL),
        (
            replace(plain, kind="inertia", gear=gear),
            phasors,
            Inertia(SERIAL.M, SERIAL.M2 * np.outer(gear, gear)),
        ),
    ]
    for hypothesis, spoiled, inertia in faults:
        scorer = Scorer.of(spoiled, [inertia] * square.size)
        scores = scorer.scores([scorer.as_logged(), hypothesis])
        assert scores.K[1] == pytest.approx(PAPER.K, rel=1e-4), hypothesis.kind
        assert scores.D[1] == pytest.approx(PAPER.D, rel=1e-3), hypothesis.kind
        assert scores.misfit[1] < 3 < 1000 < scores.misfit[0]


@pytest.mark.parametrize(("torque", "time"), [(1e-4, 1.0), (1.0, 1e3), (3e5, 1e-2)])
def test_a_score_does_not_depend_on_the_units_of_torque_and_time(torque: float, time: float) -> None:
    """Of a very small robot, or a very fast one."""
    phasors, unit = measured(), np.array([1.0, 1.0, torque, torque])
    kinds = ("", "arm angle", "gear torque", VELOCITY)
    found = []
    for of_torque, of_time in ((1.0, 1.0), (torque, time)):
        mass = of_torque * of_time**2
        z = phasors.z * (unit if of_torque != 1.0 else 1.0)
        noise = phasors.covariance * (np.outer(unit, unit) if of_torque != 1.0 else 1.0)
        own = exact_phasors(phasors.omega / (2 * np.pi * of_time), z[:, :2], z[:, 2:], noise, 1e3)
        scorer = Scorer.of(own, [Inertia(mass * SERIAL.M, mass * SERIAL.M2)] * own.omega.size)
        rates = (of_time if kind == VELOCITY else 1.0 for kind in kinds)
        tried = [
            Hypothesis.of(kind, np.full(2, rate), np.ones(2))
            for kind, rate in zip(kinds, rates, strict=True)
        ]
        scores = scorer.scores(tried)
        found.append(
            [scores.K / of_torque, scores.D / (of_torque * of_time), scores.misfit, scores.cost]
        )
    for plain, other in zip(*found, strict=True):
        np.testing.assert_allclose(other, plain, rtol=1e-6)


def test_inertias_of_reversed_and_exchanged_axes() -> None:
    order, flip = np.array([1, 0, 3, 2]), np.array([1.0, -1.0])
    found = replace(Hypothesis.of("exchanged", flip, flip), order=order).inertia(
        Inertia([1.0, 2.0], [[3.0, 0.5], [0.5, 4.0]], gravity=[[7.0, 0.25], [0.25, 8.0]])
    )
    assert found.M.tolist() == [2, 1]
    assert found.M2.tolist() == [[4, -0.5], [-0.5, 3]]
    assert found.gravity.tolist() == [[8, -0.25], [-0.25, 7]]


@pytest.mark.parametrize(
    ("K", "damping", "noise", "possible"),
    [
        (20.0, 0.1, 0.0, True),
        (-20.0, 0.1, 0.0, False),
        (20.0, -3.0, 0.0, True),
        (20.0, -5.0, 0.0, False),
        (20.0, 0.1, 0.34, True),
        (20.0, 0.1, 0.36, False),
    ],
)
def test_a_score_is_infinite_where_a_spring_is_not_possible(
    K: float, damping: float, noise: float, possible: bool
) -> None:
    """Damping below −4 standard errors, and deflections within their noise, are not.

    ``damping`` below 0 is in standard errors. The noise of the deflections is 4/3 of ``noise``, relative
    to them, and may be 1/(1 + 3/√7) of them.
    """
    omega, M, M2, count = 2 * np.pi * BAND_HZ, 0.01, 0.03, BAND_HZ.size
    deflection = np.full(count, 1e-3 + 0j)
    error = 1e-4  # of the torques, N·m
    sigma_D = error / np.sqrt(2 * (omega**2 * np.abs(deflection) ** 2).sum())
    D = damping if damping > 0 else damping * sigma_D
    torque = (K + 1j * omega * D) * deflection
    arm = torque / (-(omega**2) * M2)
    q = arm + deflection
    tau = torque - omega**2 * M * q
    covariance = np.zeros((count, 2, 2), complex)
    covariance[:, 1, 1] = error**2
    covariance[:, 0, 0] = (noise * 1e-3) ** 2
    phasors = exact_phasors(BAND_HZ, q[:, None], tau[:, None], covariance)
    scorer = Scorer.of(phasors, [Inertia([M], [[M2]])] * count)
    cost = scorer.scores([scorer.as_logged()]).cost[0]
    assert np.isfinite(cost) == possible


def test_records_can_be_left_out_and_corrected() -> None:
    phasors = logged([2.0, 1.0], row=3)
    scorer = Scorer.of(phasors, [SERIAL] * phasors.omega.size)
    without = scorer.scores([scorer.as_logged()], 1 - np.eye(phasors.omega.size)).misfit
    assert int(np.argmin(without)) == 3
    assert without[3] < 2 < 100 < np.delete(without, 3).min()
    corrected = scorer.corrected(3, np.array([2.0, 1, 1, 1]))
    np.testing.assert_allclose(corrected.z, measured().z, rtol=1e-12)
    right = corrected.scores([scorer.as_logged()])
    whole = Scorer.of(measured(), [SERIAL] * 14).scores([scorer.as_logged()])
    assert right.misfit[0] == pytest.approx(whole.misfit[0], rel=1e-9)
    alone = scorer.scores([scorer.as_logged()], np.eye(14)[:1])
    assert alone.misfit[0] == 1.0  # a record alone is no test


# --- all records


@pytest.mark.parametrize(
    ("angle", "torque", "title", "detail", "scales"),
    [
        (1, -1, "The sign of the torque of all joints looks", "opposite in sign", [1, 1, -1, -1]),
        (1, [1, -1], "The sign of the torque of joint 2 looks", "opposite in sign", [1, 1, 1, -1]),
        ([-1, 1], 1, "The sign of the position of joint 1 looks", "opposite in sign", [-1, 1, 1, 1]),
        (1 / DEGREES, 1, "The position of all joints seems to be in degrees", "57.3", [1 / DEGREES] * 2),
        ([1, 1 / DEGREES], 1, "The position of joint 2 seems to be in degrees", "57.3", [1]),
        ([1, -1 / DEGREES], 1, "joint 2 seems to be in degrees, its sign reversed", "−0.0175", [1]),
        (DEGREES, 1, "The position of all joints seems to be converted from degrees", "57.3", [DEGREES]),
        (DEGREES**-2, 1, "degrees, and its gear ratio", "3283", [DEGREES**-2] * 2),
        (1 / (2 * np.pi), 1, "The position of all joints seems to be in revolutions", "6.28", [1]),
        (1, 1000, "The torque of all joints seems to be in mN·m", "1000", [1, 1, 1e3, 1e3]),
        (1e3, 1, "M and M2 seem to be in g·m², or the position of all joints seems to", "0.001", []),
        (1, 0.5**0.5, "The torque of all joints seems to be an rms value", "0.707", []),
        (1e6, 1, "The position of all joints seems to be in µrad, or time is probably", "10⁶", []),
        ([1 / 100, 1 / 90], 1, "the unit of the torque, looks wrong for all joints", "100 and 90", []),
        (1, [1, 90], "A gear ratio, or the unit of the torque, looks wrong for joint 2", "90", []),
        (1, [1 / 8.12, 1 / 2.09], "or M and M2 look wrong for all", "8.12 and 2.09 N·m", []),
        (1, [1, 3.3], "or M and M2 look wrong for joint 2", "Wrong M and M2 have the same effect", []),
        ([1 / DEGREES, 1], [1, 8.12],
         "1 seems to be in degrees; the scale of the position or torque of joint 2", "8.12", []),
    ],
)  # fmt: skip
def test_wrong_scales_are_named(
    angle: Any, torque: Any, title: str, detail: str, scales: list[float]
) -> None:
    found = fault(logged(angle, torque))
    assert found is not None
    assert found.level == "problem"
    assert title in found.title
    assert detail in found.detail
    assert "corrected: 0" in found.detail
    assert "second fault" not in found.detail
    columns = ("theta_m" in found.remedy, "tau_m" in found.remedy)
    assert any(columns) or "Time" in found.title or "time" in found.title
    changes = [change for change in found.changes if change.kind == "scale"]
    assert bool(changes) == bool(scales)
    for change in changes:
        expected = np.ones(4)
        expected[:2], expected[2:] = angle, torque
        assert change.values == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("scale", [1.0, [1 / 8.12, 1 / 2.09]])
def test_time_in_milliseconds_is_named(scale: Any) -> None:
    """Accelerations go with the square of time: no gear ratio, whatever the torque's scale is."""
    right = logged(torque=scale)
    slow = replace(right, omega=right.omega / 1e3, duration_s=1e3 * right.duration_s)
    found = fault(slow)
    assert found is not None
    assert found.title == "Time is probably in milliseconds but was read as seconds"
    assert "The longest record then lasts 2 s." in found.detail
    assert ("in % needs the rated torque" in found.remedy) == (scale != 1.0)


def test_corrected_data_that_do_not_fit_are_not_reported_as_good() -> None:
    """Degrees and wrong inertias: the finding names the unit and states a further fault."""
    found = fault(logged(1 / DEGREES), Inertia(SERIAL.M, SERIAL.M2 * [[1.3, 1], [1, 1]]))
    assert found is not None
    assert "degrees" in found.title + found.remedy
    assert "or a second fault" in found.detail


@pytest.mark.parametrize(
    ("angle", "torque", "seen"),
    [
        (1, [101, -93.5], "points to the torque"),
        long(1, [40, 160], "points to the torque"),
        long([1 / 101, -1 / 93.5], 1, "points to the position"),
        long([1 / 20, 1 / 12], [20, 12], "points to both"),
        long(1, 0.25, "0.5 times the given one"),  # at 500 Hz, taken for 1000 Hz
    ],
)
def test_side_of_the_gear_is_found_from_the_coupling(angle: Any, torque: Any, seen: str) -> None:
    found = fault(logged(angle, torque))
    assert found is not None
    assert "gear ratio" in found.title
    assert seen in found.detail
    assert ("reverses the direction" in found.detail) == bool(
        np.any(np.asarray(torque) / np.asarray(angle) < 0)
    )


@pytest.mark.parametrize("factor", [1e9, long(1e-9), long(1e7)])
def test_impossible_gear_ratios_are_not_suggested(factor: float) -> None:
    found = fault(logged(1, [factor, 3 * factor]))
    assert found is None or "gear ratio of" not in found.detail


def test_both_inertias_in_grams_are_named_beside_positions_in_mrad() -> None:
    """Both give the same factor, and the same K and D: the data cannot decide."""
    for found in (fault(measured(), Inertia(1e3 * SERIAL.M, 1e3 * SERIAL.M2)), fault(logged(1e3))):
        assert found is not None
        assert found.title.startswith("M and M2 seem to be in g·m², or the position of all joints")
        assert "divide them by 1000" in found.remedy
        assert not found.changes


def test_arm_inertia_on_the_arm_side_is_named() -> None:
    gears = np.outer([100.0, 90.0], [100.0, 90.0])
    found = fault(measured(), Inertia(SERIAL.M, SERIAL.M2 * gears))
    assert found is not None
    assert found.title == "M2 seems to be given on the joint side"
    assert "gear ratios of about 100 and 90, M2 fits" in found.detail


@pytest.mark.parametrize("band", [slice(None), slice(3, None), slice(2), slice(4, 5)])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_right_scales_give_no_finding(band: slice, n: int) -> None:
    """Above a resonance angles oppose torques, which must not be reported as a reversed sign."""
    rows = np.arange(n * BAND_HZ.size).reshape(-1, n)[band].ravel()
    assert fault(measured(n).select(rows), ROBOTS[n][0]) is None


@pytest.mark.parametrize(
    ("order", "inertia", "title"),
    [
        ([0, 1, 3, 2], SERIAL, "The torques of joints 1 and 2 look swapped"),
        ([1, 0, 2, 3], SERIAL, "The positions of joints 1 and 2 look swapped"),
        ([1, 0, 3, 2], SERIAL, "The inertias of joints 1 and 2 look swapped"),
        (
            [0, 1, 2, 3],
            Inertia(SERIAL.M, SERIAL.M2 * [[1, -1], [-1, 1]]),
            "Joint 1 or joint 2 looks rev",
        ),
        (
            [1, 0, 3, 2],
            Inertia(SERIAL.M, SERIAL.M2 * [[1, -1], [-1, 1]]),
            "The inertias of joints 1 and 2 look swapped, and joint 1 or joint 2 looks reversed",
        ),
    ],
)
def test_exchanged_and_reversed_joints_are_named(order: list[int], inertia: Inertia, title: str) -> None:
    right = measured()
    wrong = of(right.z[:, order], right.covariance[:, order][:, :, order], right)
    found = fault(wrong, inertia)
    assert found is not None
    assert found.title.startswith(title)
    assert found.action == (
        "edit columns" if "s of joints" in title[:25] and "in" not in title[:6] else "edit inertias"
    )


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("noise", [1e-6, 1e-3])
def test_angles_of_the_arm_and_torques_of_the_gear_are_recognised(n: int, noise: float) -> None:
    """θ_a = −M2⁻¹ f / ω², and f = τ − M θ̈_m, which a torque sensor at the joint measures."""
    right, inertia = measured(n, 1e-6), ROBOTS[n][0]
    square = right.omega[:, None] ** 2
    f = right.tau + square * inertia.M * right.q
    rng = np.random.default_rng(5)
    more = 1 + noise * (rng.normal(size=f.shape) + 1j * rng.normal(size=f.shape))
    arm = replace(right, q=-np.linalg.solve(inertia.M2, f.T).T / square * more)
    found = fault(arm, inertia)
    assert found is not None
    assert found.title == "The positions seem to be measured at the arm, not at the motors"
    gear = fault(replace(right, tau=f), inertia)
    assert gear is not None
    assert gear.title == "The torques seem to be measured behind the gears, not at the motors"
    for finding in (found, gear):
        told = finding.detail.split("K of about ")[1].split(" N·m/rad")[0]
        assert [float(K) for K in told.replace(" and ", ", ").split(", ")] == pytest.approx(
            ROBOTS[n][1].K, rel=0.05
        )


def of_the_arm(found: Finding | None) -> bool:
    return found is not None and ("at the arm" in found.title or "behind the gears" in found.title)


@pytest.mark.parametrize("n", [1, long(2), long(3)])
def test_motor_angles_are_not_reported_as_arm_angles(n: int) -> None:
    """Nor with inertias that are wrong, or another scale."""
    inertia, _ = ROBOTS[n]
    for M, M2 in ((1, 1.3), (1, 0.7), (1.5, 1), (0.5, 1), (1, 2)):
        assert not of_the_arm(fault(measured(n), Inertia(inertia.M * M, inertia.M2 * M2)))
    for factor in (2.0, 100.0):
        assert not of_the_arm(fault(logged(factor, phasors=measured(n)), inertia))


def test_wrong_inertias_give_no_finding_about_scales() -> None:
    assert fault(measured(), Inertia(SERIAL.M, SERIAL.M2 * 1.1)) is None


def test_a_reversed_sign_is_named_by_power_beside_wrong_inertias() -> None:
    """No hypothesis then explains the torques; the sign is that of the only joint that supplies none."""
    wrong = Inertia(1.8 * SERIAL.M, SERIAL.M2 * np.array([[0.4, 1.0], [1.0, 2.5]]))
    found = fault(logged([1.0, -1.0]), wrong)
    assert found is not None
    assert found.title in (
        "The sign of the position of joint 2 looks reversed",
        "The sign of the torque of joint 2 looks reversed",
    )
    assert "reverse the sign of the gear ratio" in found.remedy


@pytest.mark.parametrize(("angle", "torque"), [([1, -1], 1), (1, [1, -1]), ([-1, 1], 1), (1, [-1, 1])])
def test_a_reversed_sign_is_named_beside_start_inertias_that_are_far_off(
    angle: Any, torque: Any
) -> None:
    """A regression without the inertias is physical for the right sign only."""
    wrong = Inertia(SERIAL.M * [1.28, 0.75], SERIAL.M2 * np.array([[0.74, 1.15], [1.15, 1.29]]))
    found = fault(logged(angle, torque), wrong)
    assert found is not None
    what = "torque" if angle == 1 else "position"
    joint = 1 + int(np.argmin(torque if angle == 1 else angle))
    assert found.title == f"The sign of the {what} of joint {joint} looks reversed"
    assert fault(measured(), wrong) is None


def test_a_reversed_sign_is_named_beside_start_inertias_of_several_poses() -> None:
    one, other = measured(), plant_phasors(PARALLELOGRAM, PAPER, *campaign(BAND_HZ[:4], 2))
    hz = np.concatenate([one.omega, other.omega]) / (2 * np.pi)
    z = [np.concatenate([getattr(one, name), getattr(other, name)]) for name in ("q", "tau")]
    noise = np.concatenate([one.covariance, one.covariance[:8]])
    phasors = logged(1, [-1, 1], exact_phasors(hz, *z, noise, FREEDOM))
    M2 = np.array([[0.74, 1.15], [1.15, 1.29]])
    far, near = (Inertia(pose.M * [1.28, 0.75], pose.M2 * M2) for pose in (SERIAL, PARALLELOGRAM))
    (found,) = wrong_data.wrong_data(phasors, [far] * 14 + [near] * 8)
    assert found.title == "The sign of the torque of joint 1 looks reversed"


def test_motors_that_stand_still_are_not_logged_in_microseconds() -> None:
    """Their records would last microseconds."""
    still = logged(1e-12)
    found = fault(replace(still, duration_s=1e6 * still.duration_s))
    assert found is not None
    assert found.title == "Time is probably in microseconds but was read as seconds"
    other = fault(still)
    assert other is None or "Time" not in other.title


# --- low frequency


def test_inertias_are_measured_at_low_frequency() -> None:
    low = plant_phasors(SERIAL, PAPER, *campaign([0.5, 0.7, 0.9, 3.0], 2))
    expected = np.diag(SERIAL.M) + SERIAL.M2

    def measured_from(phasors: Phasors, inertia: Inertia = SERIAL) -> Any:
        return wrong_data.low_frequency_inertia(phasors, [inertia] * phasors.omega.size)

    np.testing.assert_allclose(measured_from(low), expected, rtol=1e-4)
    two, one = low.select(np.arange(4)), low.select(np.arange(2))
    np.testing.assert_allclose(measured_from(two), expected, rtol=2e-3)
    np.testing.assert_allclose(measured_from(one), expected, rtol=0.05)
    assert measured_from(low.select(np.arange(1))) is None
    same = replace(one, q=one.q[[0, 0]].real + 0j, tau=one.tau[[0, 0]].real + 0j)
    assert measured_from(same) is None
    assert measured_from(replace(one, q=0 * one.q)) is None
    pull = Inertia(SERIAL.M, SERIAL.M2, gravity=np.diag([0.3, 0.2]))
    hung = plant_phasors(pull, Elasticity(1e4 * PAPER.K, PAPER.D), *campaign([0.5, 0.7, 0.9], 2))
    np.testing.assert_allclose(measured_from(hung, pull), expected, rtol=1e-3)


@pytest.mark.parametrize(
    ("measured_M", "ratio"),
    [(1.75, 1.0), (1.85, 1.85), (1 / 1.75, 1.0), (1 / 1.85, 1 / 1.85), (-1.0, -1.0)],
)
def test_a_ratio_below_1_8_may_be_that_of_wrong_inertias(measured_M: float, ratio: float) -> None:
    inertias = [Inertia([1.0, 1.0], np.eye(2)), Inertia([1.0, 1.0], 3 * np.eye(2))]
    found = wrong_data._ratio(3.0 * np.diag([1.0, measured_M]), inertias)
    assert found == pytest.approx([1.0, ratio])
    assert wrong_data._ratio(None, inertias).tolist() == [1, 1]


def test_a_hypothesis_without_a_factor_has_nothing_to_refine() -> None:
    scorer = Scorer.of(measured(), [SERIAL] * measured().omega.size)
    as_logged = scorer.as_logged()
    assert wrong_data._refined(as_logged, scorer) is as_logged
    known = Hypothesis.of("torque", np.ones(2), np.array([1.0, 0.97]))
    assert wrong_data._refined(known, scorer).scale == pytest.approx([1, 1, 1, 1], rel=0.01)


def test_velocities_in_place_of_positions_take_no_power() -> None:
    """A reversed torque does."""
    phasors = measured()
    moved = replace(phasors, q=1j * phasors.omega[:, None] * phasors.q)
    as_velocity = Hypothesis.of(VELOCITY, np.ones(2), np.ones(2))
    assert wrong_data._supplies_power(moved, as_velocity)
    assert not wrong_data._supplies_power(moved, replace(as_velocity, scale=np.array([1.0, 1, -1, 1])))
    assert wrong_data._supplies_power(phasors, replace(as_velocity, kind="angle"))


def test_the_share_of_the_torques_that_an_inertia_leaves() -> None:
    """At the lowest frequency alone."""
    omega = np.array([2.0, 2.0, 5.0])
    inertia = np.array([[3.0, 1.0], [1.0, 2.0]])
    q = np.array([[1.0, 0.5j], [0.2, -1.0], [1.0, 1.0]])
    tau = -(omega[:, None] ** 2) * q @ inertia
    tau[2] *= 9
    lowest: Any = SimpleNamespace(omega=omega, q=q, tau=tau, by_frequency=lambda: [(2.0, np.arange(2))])
    assert rules_inertia._unexplained(lowest, inertia) == pytest.approx(0, abs=1e-12)
    assert rules_inertia._unexplained(lowest, 1.1 * inertia) == pytest.approx(0.1)


def test_gears_are_on_one_side_or_both() -> None:
    found = wrong_data._on_sides(np.array([1.0, 100.0]))
    assert [each.kind for each in found] == ["torque", "angle", "both"]
    assert all(each.factor == pytest.approx([1, 100]) for each in found)
    both = wrong_data._on_sides(np.array([4.0, 100.0]))[2:]
    assert [each.scale.tolist() for each in both] == [[0.5, 0.1, 2, 10], [0.5, -0.1, 2, -10]]
    assert len(wrong_data._on_sides(np.array([1.0, -100.0]))) == 2
    assert wrong_data._on_sides(np.ones(2)) == []


@pytest.mark.parametrize(
    ("angle", "torque", "gear", "possible"),
    [
        ([1, 1], [1, 999], [1, 1], True),
        ([1, 1], [1, 4999], [1, 1], True),  # degrees twice, and a little more
        ([1, 1], [1, 5001], [1, 1], False),
        ([1 / 999, 1], [-999, 1], [1, 1], True),
        ([1 / 999, 1], [1001, 1], [1, 1], False),
        ([1, 1], [2.9e7, 1e6], [1, 1], True),  # milliseconds, and gears
        ([1, 1], [3.1e7, 1e6], [1, 1], False),
        ([1, 1], [1, 1], [1, 999], True),
        ([1, 1], [1, 1], [1, 1001], False),
    ],
)
def test_factors_are_those_of_gears_or_units(
    angle: list[float], torque: list[float], gear: list[float], possible: bool
) -> None:
    hypothesis = Hypothesis.of("both", np.array(angle, float), np.array(torque, float))
    assert wrong_data._is_possible(replace(hypothesis, gear=np.array(gear, float))) == possible


# --- one record


def one_off(phasors: Phasors, inertia: Inertia = SERIAL, **fit: Any) -> tuple[int, Finding] | None:
    usual = {"K": np.ones(phasors.n), "misfit": 1e4, "prior": None}
    evidence: Any = SimpleNamespace(
        phasors=phasors, inertias=[inertia] * phasors.omega.size, fit=SimpleNamespace(**usual | fit)
    )
    return rules_outlier.one_record_off(evidence)


@pytest.mark.parametrize(
    ("angle", "torque", "title", "cause", "remedy"),
    [
        (
            1 / DEGREES, 1, 'The position in "record 4" seems to be in degrees',
            "The position is 57.3 times",
            "Multiply theta_m1_rad, theta_m2_rad by π/180 in this record.",
        ),
        (
            [1 / DEGREES, 1], 1, 'The position of joint 1 in "record 4" seems to be in degrees',
            "The position of joint 1 is 57.3 times", "Multiply theta_m1_rad by π/180 in this record.",
        ),
        (
            -1, 1, 'The torque in "record 4" looks reversed in sign', "The torque is −1 times",
            "Reverse the sign of tau_m1_Nm, tau_m2_Nm in this record.",
        ),
        (
            [1, -1], 1, 'The position of joint 2 in "record 4" looks reversed in sign', "joint 2 is −1",
            "Reverse the sign of theta_m2_rad in this record.",
        ),
        (
            1, [1, -1], 'The torque of joint 2 in "record 4" looks reversed in sign', "joint 2 is −1",
            "Reverse the sign of tau_m2_Nm in this record.",
        ),
        (
            1, 1e3, 'The torque in "record 4" seems to be in mN·m', "The torque is 1000 times",
            "Divide tau_m1_Nm, tau_m2_Nm by 1000 in this record.",
        ),
        (
            1e3, 1, 'The position in "record 4" seems to be in mrad', "The position is 1000 times",
            "Divide theta_m1_rad, theta_m2_rad by 1000 in this record.",
        ),
        (
            1, 87.0, 'The torque in "record 4" differs in scale from all', "The torque is 87 times",
            "Check the gear ratio, the unit and the sign of tau_m1_Nm, tau_m2_Nm in this record, "
            "or leave",
        ),
        (
            1, [-30, 1], 'The torque of joint 1 in "record 4" differs in scale', "joint 1 is −30 times",
            "Check the gear ratio, the unit and the sign of tau_m1_Nm in this record, or leave",
        ),
        (
            [1, 33.0], 1, 'The position of joint 2 in "record 4" differs in scale',
            "joint 2 is 33 times",
            "Check the gear ratio, the unit and the sign of theta_m2_rad in this record, or leave",
        ),
        (
            [1, 2.0], [3, 4], '"record 4" contradicts all other records',
            "No factor on its positions or",
            "Check the columns, the pose and the load of this record, or leave it out: untick its run",
        ),
    ],
)  # fmt: skip
def test_the_fault_of_one_record_is_named(
    angle: Any, torque: Any, title: str, cause: str, remedy: str
) -> None:
    found = one_off(logged(angle, torque, row=3))
    assert found is not None
    record, finding = found
    assert record == 3
    assert finding.level == "problem"
    assert finding.title.startswith(title)
    assert cause in finding.detail
    assert "the other 13 records is 0" in finding.detail
    assert finding.remedy.startswith(remedy)
    known = ["scale"] * remedy.endswith("in this record.")
    assert [(c.kind, c.records) for c in finding.changes] == [
        (kind, (3,)) for kind in (*known, "leave out")
    ]
    if known:
        torque = angle if title.startswith('The torque in "record 4" looks rev') else torque
        right = np.ones(4)
        right[:2] = angle if "position" in title else 1
        right[2:] = torque
        assert finding.changes[0].values == pytest.approx(right)


def test_a_record_is_off_only_where_all_others_agree() -> None:
    """Two wrong records, few of them, or a small misfit give no finding."""
    wrong = logged(1 / DEGREES, row=3)
    assert one_off(wrong, misfit=9.9) is None
    assert one_off(wrong, misfit=9.9, K=np.array([1.0, -1.0])) is not None
    assert one_off(logged(1 / DEGREES, row=[3, 8])) is None
    assert one_off(measured()) is None
    last = [3, 0, 5, 8, 11]
    assert one_off(wrong.select(np.array(last))) is not None
    assert one_off(wrong.select(np.array(last[:4]))) is None
    assert one_off(measured(), Inertia(SERIAL.M, 1.3 * SERIAL.M2)) is None


def test_damping_may_be_negative_by_four_errors_of_what_a_fit_leaves() -> None:
    """Of torques with three times the stated noise."""
    omega, M2, rng, error = 2 * np.pi * BAND_HZ, 3.0, np.random.default_rng(1), 1e-4
    deflection, one = np.full(BAND_HZ.size, 1e-3 + 0j), np.ones(1)
    sigma = error / np.sqrt(2 * (omega**2 * np.abs(deflection) ** 2).sum())
    covariance = np.tile(np.diag([0.0, error**2]).astype(complex), (BAND_HZ.size, 1, 1))
    seen = []
    for _ in range(40):
        torque = (20.0 - 12j * omega * sigma) * deflection
        q = deflection - torque / (omega**2 * M2)
        tau = torque - omega**2 * 0.01 * q + 3 * circular(rng, covariance[:, 1:, 1:], 1)[0, :, 0]
        phasors = exact_phasors(BAND_HZ, q[:, None], tau[:, None], covariance)
        scorer = Scorer.of(phasors, [Inertia([0.01], [[M2]])] * BAND_HZ.size)
        scores = scorer.scores([Hypothesis.of("", one, one)])
        size = scores.D[0, 0] / (sigma * np.sqrt(scores.misfit[0]))
        if abs(size + 4) > 0.2:
            seen.append(size > -4)
            assert np.isfinite(scores.cost[0]) == seen[-1]
    assert 5 < sum(seen) < 35


def test_suspects_are_the_record_that_spoils_the_fit_and_that_of_most_residual() -> None:
    """With whether its residual is six times any other: the squares are 18 and 16, or 16 and 2."""
    phasors = logged([2.0, 1.0], row=3)
    scorer, residual = Scorer.of(phasors, [SERIAL] * 14), np.ones((14, 2))
    residual[8], residual[5] = [3.0, 3.0], [4.0, 0.0]
    fit = SimpleNamespace(prior=SimpleNamespace(inertia_std=0.05), residual=residual)
    fit.residual_noise = np.ones((14, 2))
    evidence: Any = SimpleNamespace(phasors=phasors, fit=fit)
    assert rules_outlier._suspects(evidence, scorer) == [(3, False), (8, False)]
    fit.residual_noise[8], fit.residual_noise[3, 0] = 10.0, 0.0
    assert rules_outlier._suspects(evidence, scorer) == [(3, True)]  # infinite
    fit.residual[3] = 0.0  # over no noise
    assert rules_outlier._suspects(evidence, scorer) == [(3, False), (5, True)]
    fit.prior.inertia_std = 0.0
    assert rules_outlier._suspects(evidence, scorer) == []


@pytest.mark.parametrize(
    ("n", "count", "sought"), [(2, 5, True), (2, 4, False), (4, 6, True), (4, 5, False)]
)
def test_an_outlier_is_sought_among_four_others_or_one_more_than_joints(
    monkeypatch: pytest.MonkeyPatch, n: int, count: int, sought: bool
) -> None:
    asked = []
    monkeypatch.setattr(rules_outlier, "Scorer", SimpleNamespace(of=lambda *_: "scorer"))
    monkeypatch.setattr(rules_outlier, "_record_off", lambda *_: asked.append(1))
    none = np.zeros((count, n), complex)
    one_off(exact_phasors(np.ones(count), none, none))
    assert bool(asked) == sought


def test_the_stiffness_of_other_records_may_be_negative_with_the_wrong_one() -> None:
    found = one_off(logged([1, 33.0], row=3))
    assert found is not None
    assert found[1].detail.startswith("With this record, the fit has no positive stiffness; without it")


@pytest.mark.parametrize(
    ("left", "corrected", "title"),
    [
        (8.0, 23.9, 'The torque in "b" looks reversed in sign'),
        (8.0, 24.1, '"b" contradicts all other records'),
        (0.1, 9.9, 'The torque in "b" looks reversed in sign'),
        (0.1, 10.1, '"b" contradicts all other records'),
        (10.1, 30.0, 'The torque in "b" looks reversed in sign'),
        (10.1, 30.4, None),  # the others do not fit either
    ],
)
def test_a_correction_leaves_three_times_the_residual_without_the_record(
    monkeypatch: pytest.MonkeyPatch, left: float, corrected: float, title: str | None
) -> None:
    count, scale = 6, np.array([1.0, 1.0, -1.0, -1.0])

    def scores(_: Any, use: Any = None) -> Any:
        if use is None:
            return SimpleNamespace(cost=np.array([1e6]), misfit=np.array([1e6]))
        cost = np.where(np.arange(count) == 1, left, 1e6)
        return SimpleNamespace(cost=cost, K=np.ones((count, 2)), D=np.ones((count, 2)))

    def corrected_by(record: int, of: np.ndarray) -> Any:
        assert (record, of.tolist()) == (1, scale.tolist())
        return SimpleNamespace(scores=lambda _: SimpleNamespace(cost=np.array([corrected])))

    scorer: Any = SimpleNamespace(
        as_logged=str, scores=scores, omega=np.ones(count), corrected=corrected_by
    )
    monkeypatch.setattr(rules_outlier, "_corrections", lambda *_: [scale])
    evidence: Any = SimpleNamespace(phasors=SimpleNamespace(omega=np.ones(count), labels="abcdef"))
    found = rules_outlier._record_off(evidence, scorer)
    assert (None if found is None else (found[0], found[1].title)) == (title and (1, title))


@pytest.mark.parametrize(
    ("best", "second", "told"),
    [(1.99e4, 2.01e5, True), (2.01e4, 9e5, False), (9.0, 1.99e5, False)],
)
def test_an_outlier_leaves_a_fiftieth_and_any_other_record_a_fifth_of_the_residual(
    monkeypatch: pytest.MonkeyPatch, best: float, second: float, told: bool
) -> None:
    def scores(_: Any, use: Any = None) -> Any:
        cost = np.array([1e6]) if use is None else np.array([1e6, second, 1e6, best, 1e6, 1e6])
        return SimpleNamespace(cost=cost, misfit=cost, K=np.ones((6, 2)), D=np.ones((6, 2)))

    right = SimpleNamespace(scores=lambda _: SimpleNamespace(cost=np.array([best])))
    scorer: Any = SimpleNamespace(
        as_logged=str, scores=scores, omega=np.ones(6), corrected=lambda *_: right
    )
    monkeypatch.setattr(rules_outlier, "_corrections", lambda *_: [np.array([1.0, 1.0, -1.0, -1.0])])
    evidence: Any = SimpleNamespace(phasors=SimpleNamespace(omega=np.ones(6), labels="abcdef"))
    found = rules_outlier._record_off(evidence, scorer)
    assert (found is not None and found[0] == 3) == told


@pytest.mark.parametrize(("free", "tried"), [(1, 17), (2, 17**2), (3, 1)])
def test_ratios_of_up_to_two_joints_are_sought_on_a_grid(free: int, tried: int) -> None:
    """Within a factor of 1.27 each; of more joints, from those at low frequency."""
    asked = []

    def scores(hypotheses: list[Hypothesis]) -> Any:
        asked.append([each.scale[3:] for each in hypotheses])
        return SimpleNamespace(cost=np.array([((h.scale[3:] - 5) ** 2).sum() for h in hypotheses]))

    factor = np.where(np.arange(3) < free, 5.5, 1.0)
    hypothesis = Hypothesis.of("torque", np.ones(3), factor)
    found = wrong_data._refined(hypothesis, SimpleNamespace(n=3, scores=scores))  # type: ignore[arg-type]
    assert len(asked[0]) == tried
    np.testing.assert_array_equal(asked[0][0], factor)  # as it is
    most = np.exp(0.24) if free < 3 else 1.0
    assert np.max(asked[0]) == pytest.approx(5.5 * most)
    np.testing.assert_allclose(found.scale[3:], np.where(factor > 1, 5.0, 1.0), rtol=0.02)
