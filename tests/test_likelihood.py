"""Maximum likelihood with friction and delay: known answers for common friction laws."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import PAPER, PARALLELOGRAM, SERIAL, exact_phasors
from scipy.special import chdtrc, log_ndtr

from jointid import (
    Controller,
    Elasticity,
    ElasticityFit,
    Excitation,
    Inertia,
    JointIdError,
    Measurement,
    MotorFriction,
    SineRecord,
    extract_phasors,
    identify_elasticity,
    motor_response,
    simulate_records,
)
from jointid.arrays import Complexes, Floats
from jointid.estimation import model_average
from jointid.estimation.candidates import Fits, Model
from jointid.estimation.estimators import levenberg_marquardt
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.levenberg_marquardt import minimised, one_step, quadratic
from jointid.estimation.estimators.linear_fit import weighted
from jointid.estimation.estimators.maximum_likelihood import (
    LikelihoodEstimate,
    Misfit,
    maximum_likelihood,
)
from jointid.estimation.estimators.noise import sensor_noise
from jointid.estimation.estimators.parameters import EFFECTS, ParameterLayout
from jointid.estimation.estimators.parameters import LAWS as NONLINEAR
from jointid.estimation.estimators.problem import fitted_layout, make_problem
from jointid.estimation.estimators.residual import Residual
from jointid.estimation.estimators.score_tests import Score, scores
from jointid.estimation.estimators.whitened_residual import WhitenedResidual
from jointid.estimation.model_average import (
    positive_moments,
    spread,
    spread_by_prior,
    spread_of_unseen,
)
from jointid.estimation.model_search import Search
from jointid.estimation.model_selection import choose_model
from jointid.gears.arm_friction import PeriodicFriction
from jointid.gears.gear import Gear, gears_with
from jointid.motion.friction import change_of_level, friction_waveforms, with_levels
from jointid.motion.noise import repeated_variances
from jointid.motion.reversals import _transforms

LINEAR_EFFECTS = tuple(name for name in EFFECTS if name not in NONLINEAR)
Law = Callable[[np.ndarray], np.ndarray]
BAND_HZ = np.geomspace(3.0, 30.0, 10).round(2)
COULOMB = np.array([0.4, 0.08])


def errors_percent(fit: ElasticityFit, truth: Elasticity = PAPER) -> np.ndarray:
    return 100 * np.abs(np.concatenate([fit.K / truth.K - 1, fit.D / truth.D - 1]))


def in_standard_errors(fit: ElasticityFit, truth: Elasticity = PAPER) -> np.ndarray:
    off = np.concatenate([fit.K - truth.K, fit.D - truth.D])
    return np.abs(off) / fit.standard_error


def prescribed_motion(
    law: Law, *, delay_s: float = 0.0, filter_s: float = 0.0, seed: int = 0
) -> list[SineRecord]:
    """Motors that move in exact sines against any law of friction; inverse dynamics give the torque.

    The log has the angle behind a first-order filter.
    """
    rng = np.random.default_rng(seed)
    records = []
    for frequency in BAND_HZ:
        omega = 2 * np.pi * frequency
        impedance = -(omega**2) * np.linalg.inv(motor_response([omega], PARALLELOGRAM, PAPER)[0])
        for phase in (0.3, 2.1):
            q = min(8 / omega, 300 / omega**2) * np.array([1, np.exp(1j * phase)])
            time = np.arange(8000) / 2000.0
            late = np.exp(1j * omega * (time + delay_s))[:, None]  # the log runs ahead of what acts
            torque = (late * (impedance @ q)).imag + COULOMB * law((late * 1j * omega * q).imag)
            angle = (np.exp(1j * omega * time)[:, None] * q / (1 + 1j * omega * filter_s)).imag
            noise = rng.standard_normal((2, *angle.shape)) * [[[3e-6]], [[5e-3]]]
            records.append(SineRecord(float(frequency), time, angle + noise[0], torque + noise[1]))
    return records


LAWS: dict[str, Law] = {
    "Coulomb": np.sign,
    "narrow": lambda v: np.tanh(v / 0.02),
    "wide": lambda v: np.tanh(v / 0.5),
    "Stribeck": lambda v: (1 + 0.5 * np.exp(-((v / 0.5) ** 2))) * np.tanh(v / 0.05),
    "unequal": lambda v: np.where(v > 0, 1.2, -0.8),
}


@pytest.mark.parametrize(
    "law", [pytest.param(law, marks=pytest.mark.long) if law == "wide" else law for law in LAWS]
)
def test_the_estimate_is_right_under_any_law_of_friction(law: str) -> None:
    """Coulomb torque of half the smallest torque amplitude, where least squares is 20 to 60 % off."""
    phasors = extract_phasors(prescribed_motion(LAWS[law]))
    fit = identify_elasticity(phasors, PARALLELOGRAM)
    plain = identify_elasticity(phasors, PARALLELOGRAM, method="least-squares")
    assert errors_percent(plain)[2:].min() > 20
    assert np.all(errors_percent(fit) < [0.05, 0.05, 0.2, 0.2])
    assert np.all(in_standard_errors(fit) < 4)
    assert fit.friction is not None
    if law in ("Coulomb", "narrow"):
        assert np.allclose(fit.friction.coulomb, COULOMB, rtol=0.02)


def test_friction_and_delay_together() -> None:
    phasors = extract_phasors(prescribed_motion(np.sign, delay_s=0.0015))
    fit = identify_elasticity(phasors, PARALLELOGRAM)
    assert fit.friction is not None
    assert fit.delay == pytest.approx(0.0015, abs=1e-6)
    assert np.all(errors_percent(fit) < [0.05, 0.05, 0.2, 0.2])


def test_friction_turns_with_the_motor_not_with_its_filtered_position() -> None:
    """A filter of 200 Hz: friction at the logged reversals is 0.1 rad late at 20 Hz."""
    motion = prescribed_motion(np.sign, delay_s=0.002, filter_s=8e-4)
    fit = identify_elasticity(extract_phasors(motion), PARALLELOGRAM)
    assert fit.delay == pytest.approx(0.002, abs=2e-5)
    assert fit.parameters["position_filter"] == pytest.approx(8e-4, abs=2e-5)
    assert np.all(errors_percent(fit) < [0.05, 0.05, 0.2, 0.2])
    assert in_standard_errors(fit).max() < 4


def test_reversals_are_those_of_the_motion_before_a_filter() -> None:
    """A filter delays harmonics by other times than the fundamental, which shifts the reversals."""
    phasors = extract_phasors(prescribed_motion(np.sign))
    n, filter_s = phasors.n, np.array([3e-3, 1e-3])
    z = phasors.harmonics.copy()
    z[:, 2, :n] = 0.05j * z[:, 0, :n]
    moved = replace(phasors, harmonics=z)
    s = 1j * phasors.omega[:, None, None] * np.arange(1, z.shape[1] + 1)[:, None]
    gain = np.ones(z.shape, complex)
    gain[..., :n] /= 1 + s * filter_s
    covariance = gain[..., None] * phasors.harmonic_covariance * gain[..., None, :].conj()
    logged = replace(phasors, harmonics=gain * z, harmonic_covariance=covariance)
    there = friction_waveforms(moved, 0.0).coulomb
    found = friction_waveforms(logged, 0.0, position_filter=filter_s).coulomb
    np.testing.assert_allclose(found, there, atol=5e-3)  # a sample of the period
    late = np.exp(s * np.arctan(s[:, :1].imag * filter_s) / s[:, :1].imag)
    assert np.abs(friction_waveforms(logged, 0.0).coulomb * late - there).max() > 0.02


def simulated(
    inertia: Inertia = PARALLELOGRAM, *, delay_s: float = 0.0, told: bool = True, **friction: object
) -> tuple[SineRecord, ...]:
    return simulate_records(
        inertia,
        PAPER,
        BAND_HZ,
        excitation=Excitation(periods=12.5, velocity_rad_s=8.0),
        controller=Controller(sample_rate_hz=2000.0, torque_delay_s=delay_s),
        friction=MotorFriction(**{"step_s": 5e-4} | friction),  # type: ignore[arg-type]
        measurement=Measurement(encoder_counts=65536, torque_noise_Nm=0.01),
        declare_timing=told,
        seed=4,
    )


@pytest.mark.parametrize(
    "inertia",
    [
        pytest.param(PARALLELOGRAM, id="parallelogram"),
        pytest.param(SERIAL, id="serial", marks=pytest.mark.long),
    ],
)
def test_the_estimate_is_right_when_joints_stick(inertia: Inertia) -> None:
    """Set-valued friction in closed loop: the motors stand for up to a fifth of the period.

    What the fit leaves of the torque is what springs and inertias take.
    """
    fit = identify_elasticity(extract_phasors(simulated(inertia, coulomb=COULOMB)), inertia)
    assert np.all(errors_percent(fit) < [0.1, 0.1, 0.3, 0.3])
    assert np.all(in_standard_errors(fit) < 4)
    assert fit.friction is not None
    assert np.allclose(fit.friction.coulomb, COULOMB, rtol=0.01)
    assert fit.delay is None
    H = motor_response(fit.phasors.omega, inertia, PAPER)
    acceleration = np.einsum("rij,rj->ri", H, fit.phasors.tau)
    measured = -(fit.phasors.omega[:, None] ** 2) * fit.phasors.q
    assert np.abs(acceleration - measured).max() < 5e-3 * np.abs(measured).max()


def test_an_unknown_delay_of_three_samples_is_the_only_effect_found() -> None:
    fit = identify_elasticity(extract_phasors(simulated(delay_s=0.0015, told=False)), PARALLELOGRAM)
    assert fit.friction is None
    assert fit.delay == pytest.approx(0.0015 + 0.00025, rel=2e-3)  # the hold lags by half a sample
    assert np.all(errors_percent(fit) < [0.1, 0.1, 0.3, 0.3])


def test_no_effect_is_found_on_an_ideal_robot() -> None:
    fit = identify_elasticity(extract_phasors(simulated()), PARALLELOGRAM)
    assert fit.friction is None
    assert fit.delay is None
    assert fit.misfit < 1.5
    assert [c.chosen for c in fit.candidates].count(True) == 1
    assert fit.candidates[0].chosen
    assert fit.candidates[0].name == "elasticity"


def test_motor_that_never_reverses_has_no_coulomb_phasor() -> None:
    records = simulate_records(
        PARALLELOGRAM,
        PAPER,
        [5.0, 12.0, 20.0],
        excitation=Excitation(periods=10.0, velocity_rad_s=5.0, constant_velocity_rad_s=20.0),
        friction=MotorFriction(coulomb=COULOMB, step_s=5e-4),
        measurement=Measurement(torque_noise_Nm=0.005, position_noise_rad=2e-6),
        seed=6,
    )
    phasors = extract_phasors(records)
    assert np.all(friction_waveforms(phasors, 0.0).coulomb == 0)
    fit = identify_elasticity(phasors, PARALLELOGRAM, method="maximum-likelihood", friction=True)
    assert fit.friction is not None
    assert np.all(fit.friction.coulomb == 0)
    assert np.all(errors_percent(fit) < [0.1, 0.1, 0.5, 0.5])


def test_harmonics_below_the_noise_do_not_change_the_reversals() -> None:
    """Thirty harmonics of noise, a hundredth of the fundamental each, have 72 % of its velocity."""
    rng = np.random.default_rng(0)
    angle = rng.standard_normal(31) + 1j * rng.standard_normal(31)
    angle[0] = 100 * np.sqrt(2)
    z = np.stack([angle, np.zeros(31)], axis=1)[None]
    found = exact_phasors(np.array([5.0]), z[:, 0, :1], z[:, 0, 1:])
    noise = np.zeros((1, 31, 2, 2), complex)
    noise[..., 0, 0] = 2.0
    waveforms = friction_waveforms(replace(found, harmonics=z, harmonic_covariance=noise), 0.0)
    assert not waveforms.stationary.any()
    assert abs(waveforms.coulomb[0, 0, 0]) == pytest.approx(4 / np.pi, rel=0.01)


def test_a_motor_that_sticks_but_for_short_slips_tells_nothing_of_its_spring() -> None:
    """Its harmonics hide the rests: six axes with a joint like this had a misfit of 165."""
    rng, period, noise = np.random.default_rng(0), 0.0305, 1e-5
    t = np.arange(60 * 61) * 0.5e-3
    turn = (t / period) % 1
    slips = np.where(turn % 0.5 < 0.13, np.sin(np.pi * turn / 0.13 % np.pi) * np.sign(0.5 - turn), 0.0)
    other = np.cos(2 * np.pi * t / period)
    angle = np.stack([np.cumsum(0.011 * slips) * 0.5e-3, 0.01 * other], axis=1)
    angle += noise * rng.standard_normal(angle.shape)
    tau = np.stack([0.4 * other, other], axis=1) + 0.01 * rng.standard_normal(angle.shape)
    found = extract_phasors([SineRecord(1 / period, t, angle, tau)])
    assert friction_waveforms(found, 0.1).stationary.tolist() == [[True, False]]


def test_a_torque_of_the_wrong_sign_gives_a_large_misfit() -> None:
    records = [replace(record, tau_Nm=-record.tau_Nm) for record in simulated()]
    fit = identify_elasticity(extract_phasors(records), PARALLELOGRAM, method="maximum-likelihood")
    assert fit.misfit > 1000


@pytest.mark.parametrize(
    "start",
    [(-10, 8, 0.1, 0.02), (40, -1, 0.1, 0.02), (3.4, 0.7, -0.07, 0.1), (4000, 1000, -0.1, 1)],
    ids=str,
)
def test_the_fit_recovers_from_a_linear_start_biased_by_heavy_friction(start: tuple[float, ...]) -> None:
    phasors = extract_phasors(prescribed_motion(np.sign))
    noise = spring_equations(phasors, PARALLELOGRAM).noise
    choice = choose_model(phasors, PARALLELOGRAM, np.array(start), noise, friction=False, delay=False)
    good = identify_elasticity(phasors, PARALLELOGRAM)
    assert isinstance(choice.estimate, LikelihoodEstimate)
    found = choice.estimate.p[:4]
    assert np.all(np.abs(found - [*good.K, *good.D]) < 0.05 * good.standard_error)


def test_another_start_is_found_where_the_model_fits_badly() -> None:
    """Rotor inertias 5 % off under friction."""
    phasors = extract_phasors(prescribed_motion(np.sign))
    wrong = Inertia(1.05 * PARALLELOGRAM.M, PARALLELOGRAM.M2)
    good = identify_elasticity(phasors, wrong)
    assert good.misfit > 20
    choice = choose_model(
        phasors,
        wrong,
        np.array([-10, 8, 0.1, 0.02]),
        spring_equations(phasors, wrong).noise,
        friction=False,
        delay=False,
    )
    assert isinstance(choice.estimate, LikelihoodEstimate)
    assert np.allclose(choice.estimate.p[:2], good.K, rtol=1e-4)


@pytest.mark.parametrize(
    "delay_s", [0.013, *(pytest.param(each, marks=pytest.mark.long) for each in (0.008, -0.004))]
)
def test_a_long_lag_is_not_identified_as_friction(delay_s: float) -> None:
    fit = identify_elasticity(
        extract_phasors(prescribed_motion(lambda v: 0 * v, delay_s=delay_s)), PARALLELOGRAM
    )
    assert fit.friction is None
    assert fit.delay == pytest.approx(delay_s, abs=2e-6)
    assert errors_percent(fit).max() < 0.2


def test_error_bars_are_widened_once_by_the_misfit() -> None:
    """Rotor inertias 1 % off: bars grow as the root of the fundamental's misfit, no further."""
    phasors = extract_phasors(prescribed_motion(lambda v: 0 * v))
    right = identify_elasticity(phasors, PARALLELOGRAM, method="maximum-likelihood")
    wrong = identify_elasticity(
        phasors, Inertia(1.01 * PARALLELOGRAM.M, PARALLELOGRAM.M2), method="maximum-likelihood"
    )
    assert wrong.inflation > 3
    wider = wrong.standard_error / right.standard_error * np.sqrt(right.inflation)
    assert np.allclose(wider, np.sqrt(wrong.inflation), rtol=0.1)


def test_linear_methods_fit_no_friction() -> None:
    phasors = extract_phasors(simulated())
    with pytest.raises(JointIdError, match="maximum-likelihood"):
        identify_elasticity(phasors, PARALLELOGRAM, method="weighted", friction=True)


@pytest.mark.parametrize("delay_s", [0.0, 2e-5, -2e-5])
def test_the_score_test_predicts_the_gain_of_a_lag(delay_s: float) -> None:
    """The score test agrees with the fit: nothing to gain without a lag, much with a small one."""
    phasors = extract_phasors(prescribed_motion(lambda v: 0 * v, delay_s=delay_s), harmonics=3)
    equations = spring_equations(phasors, PARALLELOGRAM)
    known = {"noise": equations.noise}
    without = maximum_likelihood(phasors, PARALLELOGRAM, weighted(equations).p, **known)
    lagging = maximum_likelihood(phasors, PARALLELOGRAM, without.p, delay=True, **known)
    prior = InertiaPrior.of(PARALLELOGRAM, *phasors.q.shape)
    parts = ["delay", *(name for name, effect in EFFECTS.items() if effect.positive)]
    found = scores(phasors, prior, without, None, equations.noise, parts)
    gain, value = found["delay"].gain, found["delay"].value
    assert gain == pytest.approx(without.cost - lagging.cost, rel=0.05, abs=0.05)
    assert (gain > 100) == (delay_s != 0)
    assert value == pytest.approx(lagging.named.delay, rel=1e-3)
    stiffer = np.concatenate([lagging.named.K - without.named.K, lagging.named.D - without.named.D])
    assert found["delay"].slope @ value == pytest.approx(stiffer, rel=0.02)
    check_scores(found)


def check_scores(found: dict[str, Score], positive: Sequence[str] = ()) -> None:
    """Gain, change and information belong to one parabola, whose possible part has allowed signs."""
    for name, score in found.items():
        signed = name in positive or (name in EFFECTS and EFFECTS[name].positive)
        kept = score.value > 0 if signed else np.ones(score.count, bool)
        bent = score.information[np.ix_(kept, kept)]
        some = np.linalg.solve(bent, (score.information @ score.value)[kept])
        assert score.gain == pytest.approx(0.5 * score.value @ score.information @ score.value)
        assert score.possible[0] == pytest.approx(0.5 * some @ bent @ some)
        assert score.possible[1] == pytest.approx(score.slope[:, kept] @ some)


def test_the_square_of_a_filter_of_the_position_is_positive() -> None:
    phasors = extract_phasors(prescribed_motion(lambda v: 0 * v, delay_s=0.002, seed=3), harmonics=3)
    equations = spring_equations(phasors, PARALLELOGRAM)
    without = maximum_likelihood(
        phasors, PARALLELOGRAM, weighted(equations).p, delay=True, noise=equations.noise
    )
    prior = InertiaPrior.of(PARALLELOGRAM, *phasors.q.shape)
    parts = ["position_filter", "torque_filter"]
    found = scores(phasors, prior, without, None, equations.noise, parts)
    assert all(np.all(score.value < 0) for score in found.values())
    check_scores(found, positive=parts[:1])


@pytest.mark.parametrize("filter_s", [0.0, 4e-4])
def test_the_score_test_predicts_the_gain_of_a_filter_beside_a_delay(filter_s: float) -> None:
    """The slope of the cost at no filter is that of the delay; the score is that of the square."""
    motion = prescribed_motion(lambda v: 0 * v, delay_s=0.002, filter_s=filter_s)
    phasors = extract_phasors(motion, harmonics=3)
    equations = spring_equations(phasors, PARALLELOGRAM)
    known = {"delay": True, "noise": equations.noise}
    without = maximum_likelihood(phasors, PARALLELOGRAM, weighted(equations).p, **known)
    filtered = maximum_likelihood(
        phasors, PARALLELOGRAM, without.named, effects=["position_filter"], **known
    )
    prior = InertiaPrior.of(PARALLELOGRAM, *phasors.q.shape)
    part = ["position_filter"]
    score = scores(phasors, prior, without, None, equations.noise, part)["position_filter"]
    assert score.possible[0] == pytest.approx(without.cost - filtered.cost, rel=0.3, abs=1.0)
    assert (score.possible[0] > 20) == (filter_s > 0)
    assert np.all(np.abs(np.sqrt(np.abs(score.value)) - filter_s) < 2e-4)


@pytest.mark.parametrize("method", ["auto", "maximum-likelihood"])
@pytest.mark.parametrize("friction", [False, True])
@pytest.mark.parametrize("delay", [False, True])
@pytest.mark.parametrize("rubs", [False, True])
def test_forced_parts_are_fitted_on_an_ideal_robot(
    rubs: bool, method: str, friction: bool, delay: bool
) -> None:
    law = np.sign if rubs else lambda v: 0 * v
    phasors = extract_phasors(prescribed_motion(law), harmonics=9)
    fit = identify_elasticity(phasors, PARALLELOGRAM, method=method, friction=friction, delay=delay)
    assert (fit.friction is not None) >= friction
    assert (fit.delay is not None) >= delay
    if friction or method == "auto" or not rubs:
        assert errors_percent(fit).max() < 0.2
        assert in_standard_errors(fit).max() < 4


def test_friction_turns_strongly_coupled_arms_back_earlier() -> None:
    """The direction of the arms is that of the motion under torque and friction together."""
    M2 = np.array([[0.002274, 0.003522], [0.003522, 0.007068]])
    s = 2j * np.pi * np.array([[5.0], [12.0]]) * np.arange(1, 16)
    torque = np.zeros((2, 15, 2), complex)
    torque[:, 0] = [[1.0, 0.8j], [0.5, -0.7]]
    level, mobility = np.array([0.02, 0.02]), np.linalg.inv(M2) / s[..., None, None]
    found = PeriodicFriction.solve(level, mobility, torque, 128)
    again = PeriodicFriction.at(level, mobility, torque - level * found.sign, 128)
    alone = PeriodicFriction.at(level, mobility, torque, 128)
    size = np.linalg.norm(found.sign)
    assert np.linalg.norm(again.sign - found.sign) < 1e-3 * size < 0.1 * size
    assert np.linalg.norm(alone.sign - found.sign) > 0.02 * size


def test_friction_that_differs_between_sines_has_waveforms_of_its_own() -> None:
    """Half of Coulomb and viscous friction; a torque with some of either shows its Coulomb friction."""
    phasors = extract_phasors(prescribed_motion(np.sign), harmonics=15)
    found = friction_waveforms(phasors, 0.03)
    coulomb, viscous = np.array([0.3, 0.1]), np.array([0.02, 0.0])
    levels = with_levels(found, phasors, coulomb, viscous).levels
    np.testing.assert_allclose(levels[..., 0], 0.5 * coulomb * found.coulomb)
    rate = 1j * phasors.omega[:, None, None] * np.arange(1, 16)[:, None] * phasors.harmonics[..., :2]
    np.testing.assert_allclose(levels[..., 1], 0.5 * viscous * rate)
    change = 0.1 * np.random.default_rng(1).standard_normal((len(levels), 1, 2))
    torque = change * found.coulomb
    for row, own in enumerate(found.unknown):
        for j, free in enumerate(own.free):
            torque[row, :, j] += free.sum(axis=1)
    np.testing.assert_allclose(change_of_level(found, torque), change[:, 0].std(axis=0), rtol=1e-5)


def test_the_jacobian_with_coulomb_friction_at_the_arm() -> None:
    """Against central differences: every parameter moves the instants at which the arm turns back."""
    phasors = extract_phasors(prescribed_motion(np.sign), harmonics=15)
    effects = ("arm_viscous", "arm_coulomb", "lag", "position_filter", "gravity")
    prior = InertiaPrior.of(PARALLELOGRAM, *phasors.q.shape, inertia_std=0.05, torque_std=0.05)
    friction = friction_waveforms(phasors, 0.0)
    layout = fitted_layout(prior, friction, True, effects)
    noise = spring_equations(phasors, PARALLELOGRAM).noise
    given = ParameterLayout.of(2, friction=True, effects=("arm_coulomb", "arm_viscous"))
    friction_of_arms = {"arm_coulomb": 0.05 * COULOMB, "arm_viscous": 1e-3}  # they do not stick
    start = given.named(given.pack(K=PAPER.K, D=PAPER.D, coulomb=COULOMB, **friction_of_arms))
    problem = make_problem(phasors, prior, layout, start, friction, noise)
    p = problem.start(start)
    J = Residual.at(problem, p).jacobian(problem.z)
    for k, label in enumerate(layout.labels):
        step = 1e-6 * max(abs(p[k]), 1e-3) * np.eye(p.size)[k]
        ahead, behind = (Residual.at(problem, p + sign * step).r for sign in (1, -1))
        column = (ahead - behind) / (2 * step[k])
        assert np.linalg.norm(J[..., k] - column) < 1e-4 * np.linalg.norm(column), label


@pytest.mark.parametrize("window", [None, 0.0, 0.1])
@pytest.mark.parametrize(
    ("delay", "effects", "std"),
    [(False, (), 0.0), (True, (), 0.0), (True, (), math.inf), (False, LINEAR_EFFECTS, 0.05)],
)
def test_the_gradient_is_that_of_the_cost(
    window: float | None, delay: bool, effects: tuple[str, ...], std: float
) -> None:
    """Against central differences, with position and torque noise that are correlated."""
    rng = np.random.default_rng(1)
    phasors = extract_phasors(prescribed_motion(np.sign), harmonics=9)
    root = rng.standard_normal((4, 4))
    size = np.diag([1e-6, 1e-6, 1e-3, 1e-3])
    noise = replace(
        spring_equations(phasors, PARALLELOGRAM).noise,
        covariance=np.broadcast_to(
            size @ (root @ root.T + np.eye(4)) @ size, phasors.harmonic_covariance.shape
        ).astype(complex),
    )
    friction = None if window is None else friction_waveforms(phasors, window)
    prior = InertiaPrior.of(PARALLELOGRAM, *phasors.q.shape, inertia_std=std, torque_std=std)
    layout = fitted_layout(prior, friction, delay, effects)
    off = ParameterLayout.of(2, effects=effects)
    start = off.named(
        off.pack(K=1.02 * PAPER.K, D=0.97 * PAPER.D, **{name: [1e-4, 2e-4] for name in effects})
    )
    problem = make_problem(phasors, prior, layout, start, friction, noise)
    p = problem.start(start)
    p = np.where(p == 0, 2e-4 if delay else 0.01, 1.01 * p)
    if "link" in effects:
        p[layout["link"]] = 1e-9
    scale = np.linspace(1, 2, 9)
    _, gradient, _ = quadratic(WhitenedResidual.of(problem, p, scale), p)
    for k in range(p.size):
        step = 1e-5 * p[k] * np.eye(p.size)[k]
        ahead, behind = (
            quadratic(WhitenedResidual.of(problem, at, scale), at)[0] for at in (p + step, p - step)
        )
        assert (ahead - behind) / (4e-5 * p[k]) == pytest.approx(gradient[k], rel=1e-4), layout.labels[k]


@pytest.mark.parametrize("correlation", [-0.99, -0.5, 0.0, 0.9])
def test_probability_of_positive_values(correlation: float) -> None:
    """The quadrant probability by Sheppard's formula, and moments of a truncated normal variable."""
    covariance = np.array([[1.0, correlation], [correlation, 1.0]])
    log_positive, _ = positive_moments(np.zeros(2), covariance)
    assert np.exp(log_positive) == pytest.approx(0.25 + np.arcsin(correlation) / (2 * np.pi), rel=0.03)
    log_positive, moments = positive_moments(np.array([-1.0]), np.eye(1))
    hazard = np.exp(-0.5) / np.sqrt(2 * np.pi) / np.exp(log_ndtr(-1.0))
    assert log_positive == pytest.approx(log_ndtr(-1.0))
    assert moments[0, 0] == pytest.approx(2 - hazard, rel=0.02)


@pytest.mark.parametrize(("seen", "widens"), [(0.5, False), (2.0, True), (100.0, False)])
def test_an_unseen_part_widens_the_error_where_the_data_may_hold_it(seen: float, widens: bool) -> None:
    """Of a part of 5 % that the data show to 5 %/seen and that is zero: the Bayes factor by hand."""
    std, slope = 0.05, np.array([[0.3], [-2.0]])
    score = Score(
        gain=0.0,
        count=1,
        possible=(0.0, np.zeros(2)),
        value=np.zeros(1),
        information=np.array([[(seen / std) ** 2]]),
        slope=slope,
        unit=np.ones(1),
    )
    found = spread_by_prior(score, np.full(1, np.inf), np.full(1, std), 1.0)
    factor = (1 + seen**2) ** -0.5
    variance = std**2 / (1 + seen**2) * factor / (1 + factor) * widens
    np.testing.assert_allclose(found, variance * slope @ slope.T, rtol=0.01)


@pytest.mark.parametrize(
    ("misfit", "value"), [(1.0, [0.01, 0.03]), (2.5, [0.02, 0.05]), (1.0, [-0.3, 0.0])]
)
def test_an_unseen_part_is_weighed_by_the_integral_of_its_likelihood(
    misfit: float, value: list[float]
) -> None:
    """Of two coupled values that are positive, with a usual size and a wide one in the fit."""
    std, wide = np.array([0.05, 0.04]), np.array([0.2, 0.3])
    data = np.array([[1500.0, 600.0], [600.0, 1800.0]])
    information, slope = data + np.diag(wide**-2), np.array([[1.0, 0.3], [-0.5, 2.0]])
    score = Score(0.0, 2, (0.0, np.zeros(2)), np.array(value), information, slope, np.ones(2))
    found = spread_by_prior(score, wide, std, misfit)
    axis = (np.arange(400) + 0.5) / 400 * 6
    x = np.stack(np.meshgrid(axis * std[0], axis * std[1], indexing="ij"), axis=-1)
    gain = x @ information @ value - 0.5 * np.einsum("...i,ij,...j", x, data, x)
    density = np.exp(gain / misfit - 0.5 * ((x / std) ** 2).sum(axis=-1)) * 4 / (2 * np.pi)
    factor = density.sum() * (axis[1] - axis[0]) ** 2
    moment = np.einsum("xy,xyi,xyj->ij", density, x, x) / density.sum()
    part = slope @ moment @ slope.T * factor / (1 + factor) * (factor > 1 / 3)
    np.testing.assert_allclose(found, part, rtol=0.03, atol=1e-9)
    assert np.any(part) == (value[0] > 0)


@pytest.mark.parametrize("misfit", [0.5, 4.0])
@pytest.mark.parametrize("moves", [False, True])
def test_parts_of_usual_size_that_a_model_lacks(
    monkeypatch: pytest.MonkeyPatch, misfit: float, moves: bool
) -> None:
    """Links, losses and hysteresis of usual robots; filters as large as the lags they stand for."""
    asked: dict[int, tuple[Any, ...]] = {}

    def spread(score: Score, *sizes: Any) -> np.ndarray:
        asked[id(score) if score.count == 2 else 0] = (score, *sizes)
        return np.eye(4)

    monkeypatch.setattr(model_average, "spread_by_prior", spread)
    layout = ParameterLayout.of(2, effects=["lag"])
    p = layout.named(layout.pack(K=[40.0, 8.0], D=[0.1, 0.02], lag=[1e-3, -2e-3]))
    value, information = np.array([2e-7, 1e-7]), np.array([[3.0, 1.0], [1.0, 2.0]]) * 1e13
    score = Score(0.0, 2, (0.0, np.zeros(4)), value, information, np.ones((4, 2)), np.array([2.0, 4.0]))
    prior = InertiaPrior.of(PARALLELOGRAM, 3, 2)
    fit: Any = SimpleNamespace(
        named=p, misfit=misfit, elasticity_covariance=np.zeros((4, 4)),
        phasors=SimpleNamespace(motion=np.array([False, moves])),
    )  # fmt: skip
    usual = {
        "link": (prior.link_std(p.K, 4.0), prior.link_std(p.K, 10.0)),
        "loss_factor": (np.full(2, np.inf), np.array([0.1, 0.2])),
        "hysteresis": (np.full(2, np.inf), np.array([0.1, 0.2])),
    }
    for name, (wide, std) in usual.items():
        own = replace(score)
        np.testing.assert_array_equal(spread_of_unseen(fit, {name: own}, prior), np.eye(4))
        np.testing.assert_allclose(asked[id(own)][1], wide)
        np.testing.assert_allclose(asked[id(own)][2], std)
        assert asked[id(own)][3] == max(1.0, misfit)
    assert not spread_of_unseen(fit, {"gravity": replace(score)}, prior).any()
    assert not spread_of_unseen(fit, {"link": replace(score, information=0 * information)}, prior).any()
    for name, along in (("position_filter", [1e-6, 4e-6]), ("torque_filter", [-1e-6, -4e-6])):
        spread_of_unseen(fit, {name: replace(score, count=1)}, prior)
        part, wide, std, factor = asked[0]
        of_one = np.array(along) @ information @ along
        size = np.array(along) @ information @ value / of_one  # of a value along the lags' squares
        np.testing.assert_allclose(part.value, [size])
        np.testing.assert_allclose(part.information, [[of_one]])
        np.testing.assert_allclose(part.slope[:, 0], np.ones(4) * sum(along))
        seen = np.sqrt(size**2 + 2 * max(1.0, misfit) / of_one)
        np.testing.assert_allclose(std, [seen if moves else 1.0])
        assert (wide[0], wide.size, factor) == (np.inf, 1, max(1.0, misfit))


@pytest.mark.parametrize("squared", [1e-7, 0.0])
def test_a_filter_far_shorter_than_the_delay_widens_the_errors(squared: float) -> None:
    """Of the log of a motion's torque, within two standard errors; beside a lead of one sample, 4 ms."""
    layout = ParameterLayout.of(1, delay=True)
    p = layout.named(layout.pack(K=np.array([10.0]), D=np.array([0.1]), delay=np.array(-4e-3)))
    sigma, slope = 5e-8, np.array([[1e6], [0.0]])
    value, information = np.array([-squared]), np.array([[sigma**-2]])
    score = Score(0.0, 1, (0.0, np.zeros(2)), value, information, slope, np.ones(1))
    fit = SimpleNamespace(
        named=p,
        misfit=1.0,
        elasticity_covariance=np.zeros((2, 2)),
        phasors=SimpleNamespace(motion=np.array([True])),
    )
    found = spread_of_unseen(fit, {"torque_filter": score}, None)
    assert np.sqrt(found[0, 0]) > 0.4 * 1e6 * max(squared, sigma)


@pytest.mark.parametrize(("behind", "weight"), [(2.0, np.exp(-1.0)), (5.9, np.exp(-2.95)), (6.1, 0.0)])
def test_a_rival_model_widens_the_errors_by_its_weight(behind: float, weight: float) -> None:
    """A twentieth of the best one's weight is the least that counts."""
    best, rival = Model(None, delay=False), Model(0.0, delay=False)
    estimates = {
        model: SimpleNamespace(
            elasticity=K_and_D, elasticity_covariance=np.eye(2), misfit=1.0, fundamental=(1.0, 10)
        )
        for model, K_and_D in ((best, np.array([43.0, 0.1])), (rival, np.array([44.0, 0.08])))
    }
    fits = SimpleNamespace(
        estimate=estimates.get, joints=1, tried=estimates, optional=(),
        criterion=lambda: {best: 10.0, rival: 10.0 + behind},
    )  # fmt: skip
    shift = np.array([1.0, -0.02])
    found = spread(fits, best, estimates[best], {})  # type: ignore[arg-type]
    np.testing.assert_allclose(found, weight / (1 + weight) * np.outer(shift, shift), atol=1e-12)


@pytest.mark.parametrize(
    ("gain", "stiffer", "parts", "widens"),
    [
        (4.0, 1.0, ("link",), True),
        (3.9, 1.0, ("link",), False),
        (2.0, 4.1, ("link",), True),
        (1.9, 4.1, ("link",), False),
        (2.0, 3.9, ("link",), False),
        (9.0, 4.1, ("link", "gravity"), False),
    ],
)
def test_a_fitted_part_widens_the_errors_if_it_may_be_real(
    gain: float, stiffer: float, parts: tuple[str, ...], widens: bool
) -> None:
    """One part: of a chance of 1 : 200, or of 1 : 20 if it moves K by more than four errors."""
    best, wider = Model(None, delay=False), Model(None, delay=False, effects=parts)
    shift = np.array([stiffer, -0.02])

    def estimate(size: int, cost: float, K_and_D: np.ndarray) -> SimpleNamespace:
        return SimpleNamespace(
            elasticity=K_and_D, elasticity_covariance=np.eye(2), misfit=4.0, p=np.zeros(size),
            fundamental=(1.0, 10), whole_cost=lambda misfit: cost / misfit,
        )  # fmt: skip

    fitted = {best: estimate(2, 400.0, 0 * shift), wider: estimate(3, 400.0 - 4 * gain, shift)}
    fits = SimpleNamespace(
        estimate=fitted.get, tried=fitted, optional=(), criterion=lambda: {best: 0.0, wider: 99.0}
    )
    found = spread(fits, best, fitted[best], {})  # type: ignore[arg-type]
    np.testing.assert_allclose(found, 0.5 * widens * np.outer(shift, shift), atol=1e-12)


@pytest.mark.parametrize(("fall", "widens"), [(1.9, True), (2.1, False)])
def test_a_part_that_the_fundamentals_do_not_ask_for_widens_the_errors(
    fall: float, widens: bool
) -> None:
    """Fundamentals of 10 degrees of freedom, and two units of their cost for one parameter."""
    best, narrow = (Model(None, delay=False, effects=parts) for parts in (("arm_viscous",), ()))
    shift = np.array([1.0, -0.02])

    def estimate(size: int, fundamental: float, K_and_D: np.ndarray) -> SimpleNamespace:
        return SimpleNamespace(
            elasticity=K_and_D, elasticity_covariance=np.eye(2), misfit=1.0, p=np.zeros(size),
            fundamental=(fundamental, 10), whole_cost=lambda misfit: 0.0,
        )  # fmt: skip

    fitted = {best: estimate(3, 1.0, shift), narrow: estimate(2, 1.0 + fall / 10, 0 * shift)}
    fits = SimpleNamespace(
        estimate=fitted.get, tried=fitted, optional=(), criterion=lambda: {best: 0.0, narrow: 99.0}
    )
    found = spread(fits, best, fitted[best], {})  # type: ignore[arg-type]
    np.testing.assert_allclose(found, 0.5 * widens * np.outer(shift, shift), atol=1e-12)


@pytest.mark.parametrize(("errors", "significant"), [(4.95, False), (5.05, True)])
def test_an_optional_part_must_differ_from_zero_by_five_standard_errors(
    errors: float, significant: bool
) -> None:
    """A delay of that many standard errors, by its variance, without a fit that lacks it."""
    sensors, brief = Measurement(torque_noise_Nm=0.01), Excitation(duration_s=1.5)
    records = simulate_records(
        PARALLELOGRAM, PAPER, [5.0, 12.0, 20.0], measurement=sensors, excitation=brief, seed=1
    )
    phasors = extract_phasors(records)
    start = weighted(spring_equations(phasors, PARALLELOGRAM)).p
    model = Model(None, delay=True)
    found = maximum_likelihood(phasors, PARALLELOGRAM, start, delay=True)
    place, covariance = found.layout["delay"], found.covariance.copy()
    covariance[place, place] = (found.p[place] / errors) ** 2 / max(1.0, found.misfit)
    fits = Fits(("delay",), 100, {model: replace(found, covariance=covariance)})
    assert fits.part_is_significant(model, fits.tried[model], "delay") is significant


def test_a_search_with_a_large_misfit_tries_free_reversals() -> None:
    """Joints that stick are far from every model whose reversals are not free."""
    sticking, plain = Model(0.0, delay=False), Model(None, delay=False)
    search: Any = SimpleNamespace(fits=Fits((), 1, dict.fromkeys([plain, sticking], JointIdError(""))))
    assert Search.has_sought_friction(search, plain)
    assert not Search.has_sought_friction(search, sticking)
    search.fits.tried[Model(0.1, delay=False)] = JointIdError("")
    assert Search.has_sought_friction(search, sticking)


def test_no_part_is_promising_where_a_lost_estimate_has_no_scores() -> None:
    """Derivatives that overflow give no scores: angles in degrees with exact inertias."""
    found = SimpleNamespace(misfit=5e8, cost=1.0)
    search = SimpleNamespace(
        fits=SimpleNamespace(estimate=lambda _: found), has_motions=True, scores=lambda _: {}
    )
    assert not Search.may_explain(search, Model(0.0, delay=False), "load")  # type: ignore[arg-type]


def test_noise_of_torques_is_what_neighbouring_lines_do_not_explain() -> None:
    """A part that is linear in the angles is an error of the model; the second record has an alias."""
    rng = np.random.default_rng(4)

    def normal(*shape: int) -> Complexes:
        return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)

    lines, samples, steps = 400, 4000, 0.01
    q = normal(2, lines, 2)  # angle and torque of one joint
    model_error = (0.5 + 0.001 * np.arange(lines)) * q[..., 0]
    sigma = np.array([0.3, 0.3])
    E = np.zeros((2, lines, 1, 2))
    E[..., 0], E[..., 1] = 2.0, 3.0
    segments = [
        SimpleNamespace(record=k, lowest=11, highest=380, samples=samples, angle_variance=variance)
        for k, variance in ((0, np.full((380, 1), steps)), (1, np.full((380, 1), steps)))
    ]
    phasors: Any = SimpleNamespace(n=1, harmonics=q, segments=[*segments, None])

    def found(sigma: Floats, hidden: slice = slice(0)) -> dict[int, Floats]:
        variance = 9 * sigma**2 + 4 * steps
        left = model_error + np.sqrt(4 / samples * variance)[:, None] * normal(2, lines)
        left[:, :10], left[:, 380:] = 1e3, 1e3  # beyond the segment
        left[:, hidden] = np.nan
        return sensor_noise(phasors, left[..., None], E)

    alike = found(sigma, slice(100, 120))
    assert alike[0] == alike[1] == pytest.approx([0.09], rel=0.15)
    assert np.isnan(found(sigma, slice(400))[0])
    apart = found(np.array([0.3, 3.0]))
    assert apart[0] == pytest.approx([0.09], rel=0.3)
    assert apart[1] == pytest.approx([9.0], rel=0.3)


def test_slow_torques_have_the_sizes_of_a_sign_that_changes_anywhere() -> None:
    """Root mean squares of the Legendre coefficients of a unit step, over its places."""
    _, std = _transforms(40, 400, 20, 5)
    places, points, width = np.linspace(-1, 1, 1001), (np.arange(4000) + 0.5) / 2000 - 1, 1 / 2000
    shapes = np.polynomial.legendre.legvander(points, 4)
    signs = np.sign(points[:, None] - places)
    sizes = (np.arange(5) + 0.5)[:, None] * (shapes.T * width) @ signs
    np.testing.assert_allclose(std, np.sqrt((sizes**2).mean(axis=1)), rtol=2e-3)


@pytest.mark.parametrize("periods", [3.0, 8.0, 8.3])
def test_rounding_that_repeats_counts_once_for_each_further_period(periods: float) -> None:
    """Of a motion that does not repeat there is none."""
    turn = 2 * np.pi * np.arange(int(200 * periods)) / 200
    step = 1e-3
    angle = np.round((0.3 * np.sin(turn) + 0.1 * np.sin(3 * turn + 1)) / step) * step
    part: Any = SimpleNamespace(theta=[angle])
    assert repeated_variances([part]) == pytest.approx([step**2 / 12 * (periods - 1)], rel=1e-6)
    part.theta = [np.round(np.cumsum(np.random.default_rng(2).standard_normal(600))) * step]
    assert repeated_variances([part]) == [0.0]


def test_a_gear_may_state_the_same_stiffness_as_the_elasticity() -> None:
    for off, same in ((0.0, True), (0.9e-9, True), (1.1e-9, False), (-1.1e-9, False)):
        gear = Gear(K=2.0 * (1 + off))
        if same:
            assert gears_with(np.array([2.0]), [gear])[0].K == 2.0
        else:
            with pytest.raises(JointIdError, match="state it once"):
                gears_with(np.array([2.0]), [gear])


def test_parameters_of_several_poses_are_numbered() -> None:
    labels = [
        label
        for block in ParameterLayout.of(2, rotors=1, arms=2).blocks
        if block.name in ("M", "M2")
        for label in block.labels
    ]
    assert labels[:2] == ["J_m1", "J_m2"]
    assert labels[2:] == [f"{name}, pose {pose}" for pose in (1, 2) for name in ("J_a1", "J_12", "J_a2")]


class Valley:
    """Rosenbrock's function as a problem: residuals a (y − x²) and (1 − x)/σ, beside a given rest."""

    ends = motion = None
    s = np.zeros((1, 1))

    def __init__(self, lowest: Sequence[float], *, rest: float = 0.0, most: float = np.inf) -> None:
        self.layout: Any = type("Layout", (dict,), {"lowest": np.array(lowest)})()
        self.rest, self.most, self.rows, self.evaluations = rest, most, 4, 0

    def feasible(self, p: np.ndarray) -> bool:
        return bool(p[1] < self.most)

    def of(self, p: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        self.evaluations += 1
        left = np.array([30 * (p[1] - p[0] ** 2), 5 * (1 - p[0]), self.rest])
        J = np.array([[-60 * p[0], 30.0], [-5.0, 0.0], [0.0, 0.0]])
        return float(left @ left), J.T @ left, J.T @ J


@pytest.fixture
def _in_a_valley(monkeypatch: pytest.MonkeyPatch) -> None:
    def residual(problem: Valley, p: np.ndarray, _: Any = None) -> Any:
        found = problem.of(p)
        projection = SimpleNamespace(rank=lambda: 1)
        return SimpleNamespace(cost=found[0], found=found, projection=projection)

    monkeypatch.setattr(levenberg_marquardt, "WhitenedResidual", SimpleNamespace(of=residual))
    monkeypatch.setattr(levenberg_marquardt, "quadratic", lambda residual, _: residual.found)
    monkeypatch.setattr(levenberg_marquardt, "penalty", lambda *_: 0.0)


@pytest.mark.usefixtures("_in_a_valley")
@pytest.mark.parametrize(
    ("lowest", "most", "end"),
    [
        ([-9.0, -9.0], 99.0, [1.0, 1.0]),
        ([1.2, -9.0], 99.0, [1.2, 1.44]),  # at a bound
        ([1.2, 1.9], 99.0, [1.378, 1.9]),  # at one of two
    ],
)
def test_the_iteration_ends_at_the_optimum_within_its_bounds(
    lowest: list[float], most: float, end: list[float]
) -> None:
    for damping in (1e-3, 1.0):
        problem: Any = Valley(lowest, most=most)
        p, normal = minimised(problem, np.array([1.6, 2.0]), np.ones(1), damping=damping)
        there = problem.of(p)[2]
        error = np.sqrt(np.diag(np.linalg.inv(there)))
        assert np.all(np.abs(p - end) < 0.3 * error)
        assert np.all(p >= lowest)
        np.testing.assert_allclose(normal, there, rtol=0.1, atol=50)
        assert problem.evaluations < 40


@pytest.mark.usefixtures("_in_a_valley")
def test_the_iteration_stays_where_parameters_are_possible() -> None:
    problem: Any = Valley([-9.0, -9.0], most=0.8)
    p, _ = minimised(problem, np.array([-1.0, 0.7]), np.ones(1), damping=1e-3)
    assert p[1] < 0.8
    assert problem.of(p)[0] < 0.1 * problem.of(np.array([-1.0, 0.7]))[0]


@pytest.mark.usefixtures("_in_a_valley")
@pytest.mark.parametrize("rows", [4, 10_000])
def test_a_model_that_does_not_explain_the_data_is_left_early(rows: int) -> None:
    """Steps that lower the cost by less than three per mille end it, in a row of three."""
    counts = []
    for rest in (0.0, 1e4):
        problem: Any = Valley([-9.0, -9.0], rest=rest)
        problem.rows = rows
        minimised(problem, np.array([-1.0, 2.0]), np.ones(1), damping=1.0)
        counts.append(problem.evaluations)
    assert counts[1] <= 4 < counts[0]


@pytest.mark.usefixtures("_in_a_valley")
def test_one_step_ends_at_the_optimum_of_the_parabola() -> None:
    problem: Any = Valley([-9.0, 0.3], rest=2.0)
    problem.rows = 23  # the rank and two parameters less, twenty of half a unit
    start = np.array([0.9, 0.9])
    cost, gradient, normal = problem.of(start)
    step = -np.linalg.solve(normal, gradient)
    p, misfit = one_step(problem, start)
    np.testing.assert_allclose(p, start + step, rtol=1e-6)
    assert misfit == pytest.approx((cost + gradient @ step) / 10)
    problem.layout.lowest[1], problem.rows = 1.5, 3
    p, misfit = one_step(problem, start)
    assert p[1] == 1.5
    assert misfit == pytest.approx(cost + gradient @ step)


@pytest.mark.parametrize("moves", [False, True])
def test_a_misfit_is_the_cost_over_that_of_noise(moves: bool) -> None:
    """Less the free friction and the parameters, of which the prior has its share."""
    r, H, n = 4, 3, 2
    used, known = np.ones((r, n), bool), np.ones((r, H), bool)
    used[0, 1], known[2, 2] = False, False
    group, main = np.broadcast_to(np.arange(H), (r, H)), np.array([True, moves, False])
    weight, normal = np.diag([3.0, 0.0, 8.0]), np.array([[4.0, 1.0, 0.0], [1.0, 9.0, 0.0], [0, 0, 4.0]])
    problem: Any = SimpleNamespace(
        used=used, known=known, group=group, main=main, rows=2 * (7 + 7 + 5), ends=moves or None,
        by_group=lambda values: values.sum(axis=0, dtype=float),
        prior_residual=lambda p: (0 * p, weight),
    )  # fmt: skip
    by_harmonic = np.array([1.5, 0.9, 9.0])
    residual: Any = SimpleNamespace(
        at=SimpleNamespace(problem=problem), cost=40.0,
        projection=SimpleNamespace(rank=lambda: 5), misfit_by_harmonic=lambda rank: by_harmonic.copy(),
    )  # fmt: skip
    found = Misfit.of(residual, np.zeros(3), normal)
    # The prior has 0.5·3·9/35 of the first parameter, nothing of the second and all of the third.
    determined = 3 - (0.5 * 3 * 9 / 35 + 1)
    assert (found.cost, found.rank) == (40.0, 5)
    assert found.expected_cost == pytest.approx((38 - 5 - determined) / 2)
    rows = np.array([14, 14, 10]) * (1 - 5 / 38)
    measured = rows[main].sum()
    left = measured - determined
    corrected = np.where(main, by_harmonic * measured / left, by_harmonic)
    assert found.fundamental == pytest.approx((corrected[main] @ rows[main] / measured, left))
    worse = corrected > 1
    if moves:  # a band of few equations may have it by chance
        worse &= chdtrc(rows, corrected * rows) < 1e-3
        assert worse.tolist() == [False, False, True]
    scale = np.where(worse, corrected, 1.0)
    np.testing.assert_allclose(found.scale, np.tile(scale, (r, 1)))
    few = Misfit.of(residual, np.zeros(3), 1e9 * normal)
    problem.main = np.zeros(H, bool)
    assert Misfit.of(residual, np.zeros(3), normal).fundamental == (1.0, 0.0)
    assert few.expected_cost == pytest.approx((38 - 5 - 3) / 2, rel=1e-6)
