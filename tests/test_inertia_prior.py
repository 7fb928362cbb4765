"""Priors on inertias and torque scales, and effects: known robots, from wrong given inertias."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import (
    BAND_HZ,
    PAPER,
    PARALLELOGRAM,
    SERIAL,
    campaign,
    circular,
    exact_phasors,
    motion,
    scaled,
)
from random_cases import tries

from jointid import (
    Elasticity,
    Excitation,
    Inertia,
    JointIdError,
    Phasors,
    Study,
    analyse,
    identify_elasticity,
    simulate_records,
)
from jointid.estimation.estimators.inertia_prior import InertiaPrior, checked_std
from jointid.estimation.estimators.linear_fit import without_inertias
from jointid.estimation.estimators.parameters import ParameterLayout

TRUTH = np.concatenate([PAPER.K, PAPER.D])
SIGMA = np.array([1e-6, 1e-6, 2e-3, 1e-3])
"""Standard deviations of the phasors, rad and N·m; the torques have an amplitude of 1 N·m."""


def measured(
    inertia: Inertia = PARALLELOGRAM,
    seed: int = 0,
    frequencies: np.ndarray = BAND_HZ,
    scale: float = 1.0,
) -> Phasors:
    """Phasors of the paper's robot with noise; the logged torque is the true one over ``scale``."""
    rng = np.random.default_rng(seed)
    frequencies_hz, torques = campaign(frequencies, 2)
    covariance = np.broadcast_to(np.diag(SIGMA**2).astype(complex), (len(torques), 4, 4))
    error = circular(rng, covariance, 1)[0]
    q = motion(inertia, PAPER, frequencies_hz, torques)
    return exact_phasors(
        frequencies_hz, q + error[:, :2], torques / scale + error[:, 2:], covariance.copy()
    )


def wrong(inertia: Inertia, by: float, seed: int) -> Inertia:
    """Every inertia off by a share of itself, with random signs."""
    signs = np.random.default_rng(seed).choice([-1, 1], (3, 2))
    M2 = inertia.M2 * (1 + by * np.diag(signs[1]))
    M2[0, 1] = M2[1, 0] = inertia.M2[0, 1] * (1 + by * signs[2, 0])
    return Inertia(inertia.M * (1 + by * signs[0]), M2)


@pytest.mark.parametrize(("by", "std"), [(0.05, 0.05), (0.3, 0.3), (0.3, math.inf)])
@pytest.mark.parametrize("inertia", [PARALLELOGRAM, SERIAL])
def test_k_and_d_are_identified_with_wrong_inertias(inertia: Inertia, by: float, std: float) -> None:
    fit = identify_elasticity(measured(inertia, 1), wrong(inertia, by, 1), inertia_std=std)
    assert np.abs(fit.estimate / TRUTH - 1).max() < 0.02
    assert np.abs((fit.estimate - TRUTH) / fit.standard_error).max() < 4
    assert isinstance(fit.inertia, Inertia)
    assert pytest.approx(inertia.M, rel=0.02) == fit.inertia.M
    assert pytest.approx(inertia.M2, rel=0.05) == fit.inertia.M2
    start = wrong(inertia, by, 1)
    given = identify_elasticity(measured(inertia, 1), start, method="maximum-likelihood")
    assert given.inertia is start
    assert np.abs(given.estimate / TRUTH - 1).max() > by


def test_the_standard_error_is_that_of_the_scatter() -> None:
    scores, runs = [], tries(30, nightly=60)
    for seed in range(runs):
        fit = identify_elasticity(
            measured(seed=seed), wrong(PARALLELOGRAM, 0.03, seed), inertia_std=math.inf,
            method="maximum-likelihood",
        )  # fmt: skip
        scores.append((fit.estimate - TRUTH) / fit.standard_error)
    assert np.abs(np.mean(np.square(scores), axis=0) - 1).max() < 4 * np.sqrt(2 / runs)


def test_an_exact_prior_is_the_paper_and_a_loose_one_ends_in_the_unknown() -> None:
    phasors, given = measured(), wrong(PARALLELOGRAM, 0.02, 3)
    exact = identify_elasticity(phasors, given)
    tight = identify_elasticity(phasors, given, inertia_std=1e-7, method="maximum-likelihood")
    assert tight.estimate == pytest.approx(exact.estimate, rel=1e-4)
    assert tight.inertia == given or pytest.approx(given.M, rel=1e-5) == tight.inertia.M
    loose = identify_elasticity(phasors, given, inertia_std=100.0, method="maximum-likelihood")
    unknown = identify_elasticity(phasors, given, inertia_std=math.inf, method="maximum-likelihood")
    assert loose.estimate == pytest.approx(unknown.estimate, rel=1e-4)
    assert loose.standard_error == pytest.approx(unknown.standard_error, rel=1e-2)


def test_the_error_has_a_part_of_the_noise_and_one_of_the_prior() -> None:
    fit = identify_elasticity(measured(), PARALLELOGRAM, inertia_std=0.001)
    parts = (fit.noise_error, fit.prior_error, fit.choice_error)
    assert sum(np.square(part) for part in parts) == pytest.approx(np.square(fit.standard_error))
    assert np.all(fit.noise_error > 0)
    assert np.all(np.asarray(fit.prior_error) > 0)


def test_undetermined_parameters_have_infinite_errors() -> None:
    """One frequency gives two numbers per joint and record, fewer than the unknowns."""
    phasors = measured(frequencies=np.array([8.7]))
    known = identify_elasticity(phasors, PARALLELOGRAM)
    assert np.all(np.isfinite(known.standard_error))
    unknown = identify_elasticity(
        phasors, PARALLELOGRAM, inertia_std=math.inf, method="maximum-likelihood"
    )
    assert np.all(np.isinf(unknown.standard_error))
    assert np.all(np.isinf(unknown.noise_error))
    assert np.all(np.isfinite(unknown.estimate))


def test_the_torque_scale_and_the_inertias_are_known_together_only() -> None:
    """Scaling torque, inertias, K and D by one factor changes no motion."""
    phasors = measured(scale=1.1)
    fit = identify_elasticity(phasors, PARALLELOGRAM, inertia_std=0.001, torque_std=0.2)
    assert fit.torque_scale == pytest.approx([1.1, 1.1], rel=0.005)
    assert pytest.approx(PAPER.K, rel=0.01) == fit.K
    ratio = identify_elasticity(phasors, PARALLELOGRAM, inertia_std=math.inf, torque_std=0.1)
    share = ratio.standard_error / np.abs(ratio.estimate)
    assert share.min() > 0.05  # no better than the torque scale's prior
    own = np.diag(ratio.inertia.M2)
    assert ratio.K / own == pytest.approx(PAPER.K / np.diag(PARALLELOGRAM.M2), rel=0.01)


def test_poses_share_the_rotors() -> None:
    stretched = Inertia(PARALLELOGRAM.M, 1.7 * PARALLELOGRAM.M2)
    parts = [measured(PARALLELOGRAM, 1), measured(stretched, 2)]
    phasors = Phasors(
        **{
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in parts[0].__dict__
            if name != "labels"
        },
        labels=parts[0].labels + parts[1].labels,
    )
    count = len(parts[0].labels)
    given = [wrong(PARALLELOGRAM, 0.05, 4)] * count
    given += [Inertia(given[0].M, wrong(stretched, 0.05, 5).M2)] * count
    fit = identify_elasticity(phasors, given, inertia_std=0.05)
    assert isinstance(fit.inertia, tuple)
    assert len({id(one) for one in fit.inertia}) == 2
    assert pytest.approx(fit.inertias[-1].M) == fit.inertias[0].M
    assert pytest.approx(stretched.M2, rel=0.03) == fit.inertias[-1].M2
    assert fit.estimate == pytest.approx(TRUTH, rel=0.02)


def with_arm_friction(viscous: np.ndarray) -> Phasors:
    """The parallelogram with viscous friction at the arm side, by its own equations."""
    frequencies_hz, torques = campaign(BAND_HZ, 2)
    q = np.empty_like(torques)
    for r, f in enumerate(frequencies_hz):
        s = 2j * np.pi * f
        gear = np.diag(PAPER.K + s * PAPER.D)
        arm = s * s * PARALLELOGRAM.M2 + s * np.diag(viscous)
        dynamic = np.block([[s * s * np.diag(PARALLELOGRAM.M) + gear, -gear], [-gear, arm + gear]])
        q[r] = np.linalg.solve(dynamic, np.append(torques[r], [0, 0]))[:2]
    covariance = np.broadcast_to(np.diag(SIGMA**2).astype(complex), (len(torques), 4, 4))
    error = circular(np.random.default_rng(2), covariance, 1)[0]
    return exact_phasors(frequencies_hz, q + error[:, :2], torques + error[:, 2:], covariance.copy())


def test_friction_at_the_arm_is_distinguished_from_friction_at_the_motor() -> None:
    viscous = 0.1 * PAPER.D
    fit = identify_elasticity(with_arm_friction(viscous), PARALLELOGRAM, inertia_std=0.05)
    assert "arm-side viscous friction" in next(c.name for c in fit.candidates if c.chosen)
    assert fit.parameters["arm_viscous"] == pytest.approx(viscous, rel=0.2)
    assert np.abs((fit.estimate - TRUTH) / fit.standard_error).max() < 4


@pytest.mark.parametrize("value", [-0.1, math.nan, "5 %", True])
def test_a_standard_deviation_is_a_share(value: object) -> None:
    with pytest.raises(JointIdError, match=r"inertia_std = .*0\.05 for 5 %"):
        identify_elasticity(measured(), PARALLELOGRAM, inertia_std=value)  # type: ignore[arg-type]


def test_a_coupling_given_as_zero_stays_free() -> None:
    given = Inertia(PARALLELOGRAM.M, np.diag(np.diag(PARALLELOGRAM.M2)))
    prior = InertiaPrior.of(given, 1, 2, inertia_std=0.05)
    assert prior.blocks()["M2"][1][0, 1] == pytest.approx(0.005 * np.sqrt(0.004104 * 0.001889))
    fit = identify_elasticity(measured(), given, inertia_std=0.3)
    assert fit.inertia.M2[0, 1] == pytest.approx(PARALLELOGRAM.M2[0, 1], rel=0.05)
    assert pytest.approx(Elasticity(PAPER.K, PAPER.D).K, rel=0.01) == fit.elasticity.K


@pytest.mark.parametrize("seed", [7777, 7794, 1, 2, 3, 4])
def test_the_fit_recovers_from_a_negative_linear_start(seed: int) -> None:
    """Wrong inertias may turn the linear estimate negative."""
    fit = identify_elasticity(measured(SERIAL, seed), wrong(SERIAL, 0.4, seed), inertia_std=math.inf)
    assert np.abs(fit.estimate / TRUTH - 1).max() < 0.02


def test_inertias_that_differ_by_rounding_are_one() -> None:
    phasors = measured()
    given = [Inertia(SERIAL.M, SERIAL.M2 * (1 + 9e-16 * k)) for k in range(len(phasors.labels))]
    prior = InertiaPrior.of(given, *phasors.q.shape, inertia_std=0.05)
    assert len(prior.M2) == 1


@pytest.mark.parametrize("method", ["weighted", "least-squares", "explicit"])
def test_linear_estimators_carry_the_prior_in_their_errors(method: str) -> None:
    """First-order errors agree with the scatter over wrongly given inertias and torque scales."""
    phasors, rng = measured(), np.random.default_rng(0)
    fit = identify_elasticity(phasors, SERIAL, method=method, inertia_std=0.005, torque_std=0.005)
    exact = identify_elasticity(phasors, SERIAL, method=method)
    assert np.array_equal(fit.estimate, exact.estimate)
    assert fit.noise_error == pytest.approx(exact.standard_error)
    prior, estimates = fit.prior, []
    for _ in range(tries(80, nightly=200)):
        M, lower = (mean + std * rng.standard_normal(mean.shape) for mean, std in _inertias(prior))
        scale = 1 + 0.005 * rng.standard_normal(2)
        drawn = scaled(phasors, np.concatenate([np.ones(2), scale]))
        given = Inertia(M[0], prior.symmetric(lower)[0])
        estimates.append(identify_elasticity(drawn, given, method=method).estimate)
    assert fit.prior_error == pytest.approx(np.std(estimates, axis=0), rel=0.2)
    unknown = identify_elasticity(phasors, SERIAL, method=method, inertia_std=math.inf)
    assert np.all(np.isinf(unknown.standard_error))


def _inertias(prior: InertiaPrior) -> list[tuple[np.ndarray, np.ndarray]]:
    return [prior.blocks()[name] for name in ("M", "M2")]


def test_an_undetermined_fit_has_a_correlation_and_a_condition() -> None:
    phasors = measured(frequencies=np.array([8.7]))
    fit = identify_elasticity(phasors, PARALLELOGRAM, inertia_std=math.inf)
    assert np.all(np.isfinite(fit.correlation))
    assert np.diag(fit.correlation) == pytest.approx(1)
    assert np.isfinite(fit.condition)


def test_a_position_filter_is_distinguished_from_a_delay() -> None:
    """A first-order filter of 100 Hz on the logged position, which acts like one of the true torque."""
    frequencies_hz, torques = campaign(np.linspace(2, 30, 12), 2)
    time_constant = 1 / (2 * np.pi * 100)
    q = motion(PARALLELOGRAM, PAPER, frequencies_hz, torques)
    q = q / (1 + 2j * np.pi * frequencies_hz[:, None] * time_constant)
    covariance = np.broadcast_to(np.diag(SIGMA**2).astype(complex), (len(torques), 4, 4)).copy()
    error = circular(np.random.default_rng(5), covariance, 1)[0]
    phasors = exact_phasors(frequencies_hz, q + error[:, :2], torques + error[:, 2:], covariance)
    fit = identify_elasticity(phasors, PARALLELOGRAM, inertia_std=0.05)
    (part,) = next(c.parts for c in fit.candidates if c.chosen)
    assert part in ("position_filter", "torque_filter")
    assert fit.parameters[part] == pytest.approx(np.full(2, time_constant), rel=0.01)
    assert np.abs((fit.estimate - TRUTH) / fit.standard_error).max() < 4


@pytest.mark.parametrize(("std", "means"), [(1e-15, 0.0), (0.03, 0.03), (1e9, math.inf)])
def test_extreme_standard_deviations_count_as_exact_or_unknown(std: float, means: float) -> None:
    assert checked_std("inertia_std", std) == means


def test_start_values_need_no_inertias() -> None:
    """Of one pose, from the records alone; noise makes them inaccurate, but they are near the truth."""
    phasors = measured(SERIAL)
    given = InertiaPrior.of(Inertia([1.0, 1.0], np.eye(2)), *phasors.q.shape, inertia_std=math.inf)
    start = without_inertias(phasors, given)
    assert start is not None
    np.testing.assert_allclose(start.K, PAPER.K, rtol=0.05)
    np.testing.assert_allclose(start["M"][0], SERIAL.M, rtol=0.05)
    np.testing.assert_allclose(start["M2"][0], SERIAL.M2[np.tril_indices(2)], rtol=0.05)
    two = InertiaPrior.of([SERIAL, PARALLELOGRAM] * 7, *phasors.q.shape, inertia_std=0.1)
    assert without_inertias(phasors, two) is None


def prior_of_two_poses() -> InertiaPrior:
    """Two records each of two poses, whose M2 differ; the coupling of the second is small."""
    first = Inertia([1.0, 2.0], [[4.0, 1.0], [1.0, 9.0]])
    second = Inertia([1.0, 2.0], [[16.0, 0.12], [0.12, 1.0]])
    each = [first, first, second, second]
    return InertiaPrior.of(each, 4, 2, inertia_std=0.1, torque_std=0.02)


def test_uncertain_inertias_are_blocks_of_the_parameters() -> None:
    """A coupling is uncertain by a share of itself, and at least of a tenth of what both arms allow."""
    prior = prior_of_two_poses()
    blocks = prior.blocks()
    assert list(blocks) == ["M", "M2", "torque_scale"]
    (mean, std), (arms, errors), (scale, gain) = blocks.values()
    np.testing.assert_allclose([mean[0], std[0]], [[1.0, 2.0], [0.1, 0.2]])
    np.testing.assert_allclose(arms, [[4.0, 1.0, 9.0], [16.0, 0.12, 1.0]])
    np.testing.assert_allclose(errors, [[0.4, 0.1, 0.9], [1.6, 0.04, 0.1]])
    np.testing.assert_allclose([scale, gain], [[1.0, 1.0], [0.02, 0.02]])
    np.testing.assert_allclose(prior.covariance("M"), np.diag([0.01, 0.04]))
    np.testing.assert_allclose(prior.covariance("M2"), np.diag(errors.ravel() ** 2))
    np.testing.assert_array_equal(prior.pose, [0, 0, 1, 1])
    np.testing.assert_array_equal(prior.of_rows(np.array([3, 0])).pose, [1, 0])
    assert not InertiaPrior.of(Inertia([1.0], [[1.0]]), 2, 1).blocks()


def test_a_usual_link_is_as_flexible_as_its_mode_above_the_free_resonance() -> None:
    """J/ω² with ω² = times² · K (1/M + 1/M2), of the mean of all poses, whose coupling bounds J."""
    prior = prior_of_two_poses()
    mean = np.array([[10.0, 0.56], [0.56, 5.0]])
    unit = np.sqrt(np.diag(mean))
    rest = np.linalg.eigvalsh(mean / np.outer(unit, unit))[0]
    share = prior.link_inertia / np.diag(mean)
    assert share[0] == pytest.approx(share[1])
    assert share[0] == pytest.approx(min(rest / 2, 0.2))
    free = 50.0 * (1 / np.array([1.0, 2.0]) + 1 / np.diag(mean))
    np.testing.assert_allclose(
        prior.link_std(np.array([50.0, -50.0]), 3.0), prior.link_inertia / (9.0 * free)
    )
    coupled = InertiaPrior.of(Inertia([1.0, 2.0], [[1.0, 0.8], [0.8, 1.0]]), 1, 2)
    np.testing.assert_allclose(coupled.link_inertia, 0.1)


def test_motors_and_arms_of_each_record_have_the_fitted_parameters() -> None:
    """Lags of a motion with the delay that it states, which the phasors of a sine hold already."""
    prior = prior_of_two_poses()
    effects = ("arm_viscous", "arm_coulomb", "lag", "load", "motor_presliding", "gravity")
    layout = ParameterLayout.of(
        2, friction=True, curve_parts=2, delay=True, effects=effects, rotors=1, arms=2, torque_scale=True
    )
    values: dict[str, Any] = {
        "K": [50.0, 9.0], "D": [0.1, 0.2], "coulomb": [0.3, 0.4], "viscous": [0.01, 0.02], "delay": 1e-3,
        "curve": [[0.05, 0.02], [0.1, -0.3]], "arm_viscous": [0.5, 0.6], "arm_coulomb": [0.7, 0.8],
        "lag": [2e-4, 3e-4], "load": [0.1, 0.05], "motor_presliding": [0.01, 0.03],
        "gravity": [4.0, 5.0], "M": [[1.5, 2.5]], "M2": [[5.0, 1.2, 8.0], [15.0, 0.2, 2.0]],
        "torque_scale": [1.1, 0.9],
    }  # fmt: skip
    p = layout.named(layout.pack(**values))
    phasors: Any = SimpleNamespace(
        n=2, motion=np.array([False, True, True, False]), torque_delay_s=np.full(4, 5e-3)
    )
    motors = prior.motors(phasors, p)
    for motor, stated in zip(motors, (0.0, 5e-3, 5e-3, 0.0), strict=True):
        np.testing.assert_allclose(motor.M, [1.5, 2.5])
        np.testing.assert_allclose(motor.coulomb, [0.31, 0.43])
        np.testing.assert_allclose(motor.viscous, [0.01, 0.02])
        np.testing.assert_allclose(motor.load, [0.1, 0.05])
        np.testing.assert_allclose(motor.lag_s, stated + np.array([1.2e-3, 1.3e-3]))
        np.testing.assert_allclose(motor.torque_scale, [1.1, 0.9])
        np.testing.assert_allclose(motor.breakaway, [0.07, -0.2])
    arms = prior.arms(p)
    for arm, M2 in zip(arms, [[[5, 1.2], [1.2, 8]]] * 2 + [[[15, 0.2], [0.2, 2]]] * 2, strict=True):
        np.testing.assert_allclose(arm.M2, M2)
        np.testing.assert_allclose(arm.gravity, np.diag([4.0, 5.0]))
        np.testing.assert_allclose([arm.K, arm.D], [values["K"], values["D"]])
        np.testing.assert_allclose([arm.coulomb, arm.viscous], [[0.7, 0.8], [0.5, 0.6]])
    given = p.without("M", "M2")
    np.testing.assert_allclose(prior.motors(phasors, given)[0].M, [1.0, 2.0])
    np.testing.assert_allclose(prior.arms(given)[3].M2, [[16.0, 0.12], [0.12, 1.0]])


def test_a_common_unknown_of_arms_correlates_their_inertias() -> None:
    """Its covariance is of rank one beside each element's own error; the information is the inverse."""
    added = 0.1 * np.array([[4.0, 1.0], [1.0, 2.0]])
    each = [
        Inertia([1.0, 2.0], M2, shared=k * added, shared_gravity=k * added / 2)
        for k, M2 in ((1, [[4.0, 1.0], [1.0, 9.0]]), (2, [[16.0, 0.12], [0.12, 1.0]]))
    ]
    prior = InertiaPrior.of(each, 2, 2, inertia_std=0.1)
    common = np.array([0.4, 0.1, 0.2, 0.8, 0.2, 0.4])
    own = 0.1 * np.array([4.0, 1.0, 9.0, 16.0, 0.4, 1.0])
    covariance = np.diag(own**2) + np.outer(common, common)
    np.testing.assert_allclose(prior.covariance("M2"), covariance)
    np.testing.assert_allclose(prior.information("M2"), np.linalg.inv(covariance), rtol=1e-9)
    np.testing.assert_allclose(prior.blocks()["M2"][1].ravel(), np.hypot(own, common))
    # The most likely unknown of a change: generalised least squares with a prior of one.
    change = np.random.default_rng(1).standard_normal(6)
    unknown = (common / own**2) @ change / (1 + (common / own) @ (common / own))
    moved = prior.gravities(prior.lower + change.reshape(2, 3)) - prior.gravity
    np.testing.assert_allclose(moved, unknown * np.stack([added / 2, added]), rtol=1e-9)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ([PARALLELOGRAM, 3.0], "expected an Inertia"),
        (3.0, "expected an Inertia"),
        ({PARALLELOGRAM}, "expected an Inertia"),
        ([PARALLELOGRAM] * 3, "3 inertias for 2 records"),
        ([PARALLELOGRAM, Inertia([1.0], [[1.0]])], "2 joints, but the inertia has 1"),
    ],
)
def test_inertias_are_those_of_the_records_and_joints(given: Any, told: str) -> None:
    with pytest.raises(JointIdError, match=told):
        InertiaPrior.of(given, 2, 2)


@pytest.mark.parametrize(
    ("wrong", "size"), [("", 1.0), ("", 1e4), ("", 1e-4), ("K", 1.0), ("M", 1.0), ("M2", 1.0)]
)
def test_a_regression_without_inertias_gives_those_of_the_robot_or_of_none(
    wrong: str, size: float
) -> None:
    """Motors that move anyhow; a robot of a negative stiffness or inertia is none."""
    rng = np.random.default_rng(3)
    K, D, M, M2 = (size * each for each in (PAPER.K, PAPER.D, SERIAL.M, SERIAL.M2))
    if wrong == "K":
        K[1] *= -1
    if wrong == "M":
        M[1] *= -1
    if wrong == "M2":
        M2 *= -1
    hz = np.geomspace(3, 30, 12)
    q = rng.standard_normal((12, 2)) + 1j * rng.standard_normal((12, 2))
    tau = np.zeros((12, 2), complex)
    for r, s in enumerate(2j * np.pi * hz):
        gear = np.diag(K + s * D)
        tau[r] = s**2 * M * q[r] + gear @ (q[r] - np.linalg.solve(s**2 * M2 + gear, gear @ q[r]))
    found = without_inertias(exact_phasors(hz, q, tau), InertiaPrior.of(PARALLELOGRAM, 12, 2))
    assert (found is None) == bool(wrong)
    if found is not None:
        for name, true in (("K", K), ("D", D), ("M", [M]), ("M2", [M2[np.tril_indices(2)]])):
            np.testing.assert_allclose(found[name], true, rtol=1e-6)
        drives = [Inertia(own * SERIAL.M, SERIAL.M2) for own in (1.0, 2.0)] * 6
        assert without_inertias(exact_phasors(hz, q, tau), InertiaPrior.of(drives, 12, 2)) is None


def test_a_coupling_that_the_gears_add_is_no_wrong_unit() -> None:
    """A robot model without the coupling of its wrist: K was right, and refused as another robot's."""
    true = Elasticity(K=[52.3, 6.1], D=[0.2, 0.03])
    M, M2 = [0.0025, 0.0010], np.array([[0.0041, 0.0], [0.0, 0.0019]])
    added = 0.1 * np.sqrt(M2[0, 0] * M2[1, 1]) * (1 - np.eye(2))
    records = simulate_records(
        Inertia(M, M2 + added), true, np.geomspace(3, 30, 6), excitation=Excitation(duration_s=1.0)
    )
    for off, given, state in ((0.003, M2, "usable with care"), (1.0, 2.5 * M2, "not usable")):
        found = analyse(Study(records, Inertia(M, given), inertia_std=0.05))
        assert np.all(np.abs(found.fit.K / true.K - 1) < off)
        assert found.state == state
        said = found.findings[0].detail + found.findings[0].remedy
        assert ("coupling matrix" in said) == (state == "usable with care")
