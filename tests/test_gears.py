"""Gears: their laws, their measured torsion curves, simulated robots and arms that have them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants import PAPER as PLANT
from plants import PARALLELOGRAM
from random_cases import tries
from scipy.integrate import solve_ivp

from benchmarks.independent_robot import MAX_STEP_S, Experiment, Robot, paper_motions, simulate
from benchmarks.real_robots import LOW, Case, Change, Loads, rubbing
from jointid import (
    Controller,
    Elasticity,
    ElasticityFit,
    Excitation,
    Gear,
    Inertia,
    JointIdError,
    Measurement,
    Motion,
    MotionRecord,
    MotorFriction,
    Phasors,
    PlanarArm,
    analyse,
    extract_phasors,
    identify_elasticity,
    identify_motion,
    rectangle,
    simulate_motion,
    simulate_records,
    track,
)
from jointid.answer import gear_terms, without_curve
from jointid.cut.arm import Drive
from jointid.estimation import model_selection
from jointid.estimation.candidates import Fits, Model
from jointid.estimation.estimators.fitted_gears import fitted_gears
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.joint_laws import JointLaws
from jointid.estimation.estimators.levenberg_marquardt import quadratic
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate, maximum_likelihood
from jointid.estimation.estimators.noise import moderated_noise
from jointid.estimation.estimators.parameters import GEAR_LAWS, ParameterLayout, Parameters
from jointid.estimation.estimators.problem import fitted_layout, make_problem
from jointid.estimation.estimators.residual import Residual
from jointid.estimation.model_climb import _laws_of_motions, climbed, fit_laws, fit_regressed
from jointid.estimation.model_fits import evaluated
from jointid.estimation.model_growth import grown
from jointid.estimation.model_search import Search
from jointid.estimation.start_values import by_regression, other_laws, with_one_bend
from jointid.figures.stiffness import stiffness_over_amplitude, torsion_curve
from jointid.gears.arm_friction import PeriodicFriction
from jointid.gears.driven_gears import DrivenGears, _loop
from jointid.gears.gear import knees
from jointid.gears.harmonic_balance import WoundGears, beyond_linear, law_stiffness
from jointid.gears.law_regression import law_by_regression
from jointid.gears.laws import GearLaws, nonlinear_laws
from jointid.gears.motor_motion import MotorMotion
from jointid.gears.motor_motion import each as by_pose
from jointid.gears.torque_spread import periodic_dahl
from jointid.gears.torsion_curve import torsion_curves
from jointid.motion.friction import friction_waveforms
from jointid.motion.spectra import motion_phasors
from jointid.phasors.periods import phasors_of, samples_of
from jointid.small_matrices import inverse
from jointid.uncertainty.validation import second_amplitude, second_amplitude_record
from jointid.verdict.rules_effects import effects_found

PAPER = Robot(
    M=[0.0025, 0.0010], M2=[[0.004104, 0.000395], [0.000395, 0.001889]], K=[43.0, 7.5], D=[0.10, 0.015]
)
INERTIA = Inertia(PAPER.M, PAPER.M2)
BAND = np.array([3.0, 6, 11, 18, 30])
HARD, PLAY, DAHL, SLOPES = (
    Gear(cubic=9000.0),
    Gear(backlash_rad=0.004),
    Gear(hysteresis_Nm=0.08, presliding_rad=0.002),
    Gear(K2=70.0, K3=90.0, T1_Nm=0.7, T2_Nm=1.6),
)
COMBINED = (
    (PLAY, ("backlash_rad",)),
    (HARD, ("cubic",)),
    (replace(SLOPES, backlash_rad=0.004), ("backlash_rad", "K2", "K3", "T1_Nm", "T2_Nm")),
)
"""Further laws of a gear with hysteresis."""


WORN = {
    "hardening": replace(PAPER, cubic=[9000.0, 0.0]),
    "play": replace(PAPER, backlash_rad=[0.003, 0.0]),
    "wide play": replace(PAPER, backlash_rad=[0.0138, 0.0465]),
    "hysteresis": replace(PAPER, hysteresis_Nm=[0.08, 0.0], hysteresis_rad=0.003),
    "heavy rotors": replace(PAPER, M=[0.0123, 0.0057], cubic=[30000.0, 1000.0]),
    "wide loops": replace(
        PAPER, cubic=[40000.0, 300.0], hysteresis_Nm=[0.15, 0.02], hysteresis_rad=0.002
    ),
    "beside a stiff gear": replace(
        PAPER, K=[43.0, 2000.0], D=[0.10, 0.25], hysteresis_Nm=[0.08, 0.0], hysteresis_rad=0.003
    ),
}
MOTIONS = {"noise": 0.003, "periods": 4.5, "max_step_s": tries(5e-4, nightly=MAX_STEP_S)}
COARSE: dict[str, Any] = tries(
    {"controller": Controller(sample_rate_hz=2000), "friction": MotorFriction(step_s=5e-4)}, nightly={}
)
"""Of simulated gears: fewer samples and longer steps than by default."""
LATER = ("heavy rotors", "wide loops", "beside a stiff gear")
"""Those that only a long run fits."""


@cache
def measured() -> dict[str, Phasors]:
    """Phasors of the worn robots, which are integrated side by side."""
    names = [name for name in WORN if name not in tries(LATER, long=())]
    logs = simulate([(WORN[name], paper_motions(WORN[name], BAND, **MOTIONS)) for name in names])
    return {name: extract_phasors(records) for name, records in zip(names, logs, strict=True)}


def fitted(name: str) -> ElasticityFit:
    """Fit of a worn robot; its K and D are within the errors."""
    fit = identify_elasticity(measured()[name], Inertia(WORN[name].M, PAPER.M2))
    assert np.all(np.abs(fit.estimate - WORN[name].answer) < 4 * fit.standard_error)
    return fit


@pytest.fixture(scope="module")
def stiffening() -> ElasticityFit:
    return fitted("hardening")


def test_a_gear_that_was_not_tried_has_the_stiffness_at_zero() -> None:
    """Motions below the resonance show no torsion curve, hence no largest torque."""
    assert Gear(K=10.0, cubic=3.0).secant_K == 10.0


def test_torque_and_deflection_are_inverse() -> None:
    torque = np.linspace(-2.5, 2.5, 11)
    for gear in (HARD, PLAY, SLOPES, Gear()):
        whole = replace(gear, K=43.0)
        np.testing.assert_allclose(whole.torque(whole.deflection(torque)), torque, atol=1e-9)
    softening = Gear(K=43.0, cubic=-9000.0)
    top = np.sqrt(43.0 / 27000)
    assert softening.deflection(99.0) == pytest.approx(top)


@pytest.mark.parametrize("gear", [HARD, PLAY, SLOPES, Gear(cubic=-9000.0)], ids=lambda gear: gear.kind)
def test_deflections_of_many_torques_are_near_those_of_the_gear(gear: Gear) -> None:
    """With torques beyond the largest of a softening gear they overflowed, and nothing was solved."""
    gear = replace(gear, K=50.0)
    torque = np.linspace(-4.0, 4.0, 41)[None]
    delta = GearLaws.of([gear]).deflection(torque)
    held = np.abs(gear.torque(gear.deflection(torque)) - torque) < 1e-9
    np.testing.assert_allclose(delta[held], gear.deflection(torque)[held], atol=0.002)
    assert np.abs(delta).max() < 2 * np.abs(gear.deflection(torque)).max()


@given(
    st.sampled_from(["", "cubic", "backlash_rad", "hysteresis_Nm", "K2"]),
    st.sampled_from([1.0, -2.5, 0.4]),
    st.integers(0, 99),
)
def test_laws_behind_a_gear_ratio_are_those_of_the_gear(missing: str, ratio: float, seed: int) -> None:
    """Torque, slope and energy of gears with all laws or all but one, in two runs side by side."""
    rng, n = np.random.default_rng(seed), abs(ratio)
    gear = replace(HARD, K=43.0, backlash_rad=0.004, hysteresis_Nm=0.08, presliding_rad=0.002)
    gear = replace(gear, K2=70.0, K3=60.0, T1_Nm=0.7, T2_Nm=1.6)
    gear = replace(gear, **({missing: 0.0} if missing else {}))
    gears = gear, gear.scaled(2.0)
    laws, small = GearLaws.of(gears, np.array([ratio]), 2), 1e-7 / n
    delta = rng.uniform(-0.06, 0.06, (1, 2)) / n
    loop, move = rng.uniform(-1, 1, (1, 2)), rng.uniform(-0.005, 0.005, (1, 2)) / n
    elastic = [n * float(g.torque(n * d)) for g, d in zip(gears, delta[0], strict=True)]
    level = n * np.array([g.hysteresis_Nm for g in gears])

    def through(step: float) -> np.ndarray:
        return laws.K * (delta + step) + laws.beyond_linear(delta + step, loop)

    def change(of: Callable[[float], np.ndarray]) -> np.ndarray:
        return (of(small) - of(-small)) / (2 * small)

    np.testing.assert_allclose(through(0.0)[0], elastic + level * loop[0], rtol=1e-9)
    near = {"rtol": 1e-5, "atol": 1e-5}
    np.testing.assert_allclose(laws.slope(delta), change(through), **near)
    kinked = change(lambda step: laws.kinked_energy(delta + step))
    np.testing.assert_allclose(laws.kinked(delta), kinked, **near)
    torque, slope = laws.wound(delta, loop, move)
    after = np.sign(move) + (loop - np.sign(move)) * np.exp(-np.abs(n * move) / gear.presliding_rad)
    np.testing.assert_allclose(torque[0], elastic + level * after[0], rtol=1e-9)
    moved = change(lambda step: laws.wound(delta + step, loop, move + step)[0])
    np.testing.assert_allclose(slope, moved, **near)


def test_three_slopes_are_those_of_a_catalogue() -> None:
    gear = replace(SLOPES, K=43.0)
    at = gear.deflection([0.7, 1.6])
    assert at == pytest.approx([0.7 / 43, 0.7 / 43 + 0.9 / 70])
    beyond = gear.torque(at[1] + 0.01) - gear.torque(at[1])
    assert beyond == pytest.approx(0.9)
    assert gear.secant(0.5) == pytest.approx(43.0)
    assert gear.secant(1.6) == pytest.approx(1.6 / at[1])


def test_the_dominant_law_names_the_gear() -> None:
    both = Gear(K=43.0, cubic=9000.0, backlash_rad=1e-4, tried_rad=0.05)
    assert (both.kind, both.laws) == ("hardening", ("hardening", "backlash"))
    assert replace(both, tried_rad=0.002).kind == "backlash"
    assert Gear(K=43.0, loss_factor=0.1).laws == ("linear",)


def test_the_secant_stiffness_is_that_at_the_torque_tried_without_the_backlash() -> None:
    """K + cubic δ² of a hardening gear; of a gear of other torques, as many times as large."""
    gear = Gear(K=43.0, cubic=9000.0, backlash_rad=0.004, tried_rad=0.032)
    gear = replace(gear, tried_Nm=float(gear.torque(0.032)))
    assert gear.secant_K == pytest.approx(43 + 9000 * 0.03**2)
    assert gear.scaled(2.5).secant_K == pytest.approx(2.5 * gear.secant_K)
    assert gear.backlash_share == pytest.approx(0.002 / 0.032)
    at = np.linspace(-0.04, 0.04, 9)
    whole = replace(gear, hysteresis_Nm=0.2, presliding_rad=0.01, K2=50.0, K3=60.0, T1_Nm=0.4, T2_Nm=0.9)
    np.testing.assert_allclose(whole.scaled(2.5).torque(at), 2.5 * whole.torque(at))
    assert whole.scaled(2.5).hysteresis_Nm == pytest.approx(0.5)
    assert replace(gear, cubic=0.0, backlash_rad=0.0).secant_K == 43.0


@pytest.mark.parametrize("gear", [HARD, PLAY, SLOPES, DAHL], ids=lambda gear: gear.kind)
def test_a_law_at_one_joint_is_a_law_of_all(gear: Gear) -> None:
    K = np.array([43.0, 7.5])
    laws = nonlinear_laws(K, [Gear(), gear], 2.0)
    assert laws is not None
    np.testing.assert_allclose(laws.K, 4 * K[:, None])
    assert nonlinear_laws(K, [Gear(), Gear(loss_factor=0.1)]) is None
    assert nonlinear_laws(K, None) is None


def test_a_fitted_hysteresis_has_its_width_with_either_sign() -> None:
    """A fit may pass zero, where there is no loop."""
    level, none = np.array([[0.2, -0.2, 0.0]]), np.zeros((1, 3))
    laws = GearLaws.made(none + 43.0, none, none, level, none + 0.01, (none, none), (none, none))
    np.testing.assert_allclose(laws.sharpness, [[100.0, 100.0, 0.0]])
    torque, _ = laws.wound(none, none, none + 0.01)
    np.testing.assert_allclose(torque, level * (1 - np.exp(-1)))


@pytest.mark.parametrize("share", [0.2, 0.7])
def test_the_stiffness_in_a_sine_is_the_describing_function_of_the_law(share: float) -> None:
    """3/4 of the cubic torque; of an edge at a share x of the amplitude, (asin x + x √(1 − x²)) 2/π."""
    a, K = 0.03, 50.0
    within = 2 / np.pi * (np.arcsin(share) + share * np.sqrt(1 - share**2))
    second = 2 / np.pi * (np.arcsin(0.9) + 0.9 * np.sqrt(1 - 0.9**2))
    first_Nm = K * share * a
    slopes = {"K2": 80.0, "K3": 20.0, "T1_Nm": first_Nm, "T2_Nm": first_Nm + 80 * (0.9 - share) * a}
    delta = a * np.sin(2 * np.pi * np.arange(1024) / 1024)[None]
    for law, expected in (
        ({"cubic": 3e4}, K + 0.75 * 3e4 * a**2),
        ({"backlash_rad": 2 * share * a}, K * (1 - within)),
        (slopes, K + 30 * (1 - within) - 60 * (1 - second)),
    ):
        for sign in (1, -1):
            found = law_stiffness(Gear(K=K, **law), sign * delta)
            assert found == pytest.approx([expected], rel=1e-5)
            larger = law_stiffness(Gear(K=K, **law).scaled(3.0), sign * delta)
            assert larger == pytest.approx([3 * expected], rel=1e-5)


@pytest.mark.parametrize("gear", [HARD, PLAY, SLOPES, DAHL], ids=lambda gear: gear.kind)
def test_a_wound_gear_satisfies_its_equation_in_any_units(gear: Gear) -> None:
    """δ = F − β g(δ), with g over many samples; a change of F moves it as the next solution says."""
    H, m, rng = 15, 15, np.random.default_rng(6)
    orders = np.arange(1 + H)
    drive = 0.05 * (rng.standard_normal((2, 1, 1 + H)) + 1j * rng.standard_normal((2, 1, 1 + H)))
    drive = drive / np.maximum(orders, 1) ** 3
    compliance = np.broadcast_to(1 / (60.0 + 8j * orders), drive.shape).copy()
    gear = replace(gear, K=43.0)
    laws = GearLaws.of([gear])
    found = WoundGears.solve(laws, drive, compliance, H, m)
    fine = found.delta[..., 0].real[..., None] + samples_of(found.delta[..., 1:], 8192)
    loop = periodic_dahl(fine, laws.sharpness) if gear.hysteresis_Nm else 0 * fine
    beyond = gear.torque(fine) - 43.0 * fine + gear.hysteresis_Nm * loop
    left = found.delta[..., 1:] - drive[..., 1:] + compliance[..., 1:] * phasors_of(beyond, H)
    assert np.abs(left).max() < 5e-4 * np.abs(drive).max()
    assert (
        np.abs(beyond.mean(axis=2) + 43.0 * found.delta[..., 0].real).max() < 2e-3 * np.abs(beyond).max()
    )

    a, c = 7.0, 0.3  # units of angle and torque
    other = replace(
        gear, K=43.0 * c / a, cubic=gear.cubic * c / a**3, backlash_rad=a * gear.backlash_rad,
        hysteresis_Nm=c * gear.hysteresis_Nm, presliding_rad=a * gear.presliding_rad,
        K2=gear.K2 * c / a, K3=gear.K3 * c / a, T1_Nm=c * gear.T1_Nm, T2_Nm=c * gear.T2_Nm,
    )  # fmt: skip
    scaled = WoundGears.solve(GearLaws.of([other]), a * drive, compliance * a / c, H, m)
    np.testing.assert_allclose(scaled.delta, a * found.delta, atol=1e-6 * np.abs(a * found.delta).max())
    np.testing.assert_allclose(
        scaled.beyond, c * found.beyond, atol=1e-5 * np.abs(c * found.beyond).max()
    )

    fewer = WoundGears.solve(laws, drive, compliance, H, 7, found)  # a start with more of them
    np.testing.assert_allclose(fewer.delta, found.delta, atol=1e-4 * np.abs(found.delta).max())
    move = np.where(orders == 1, 1e-4j, 0.0) + np.where(orders == 3, 5e-5, 0.0) + 0 * drive
    ahead, behind = (
        WoundGears.solve(laws, drive + sign * move, compliance, H, m, found).beyond for sign in (1, -1)
    )
    expected = (ahead - behind) / 2
    change = found.change(move[..., None], 0 * move[..., None])[..., 0]
    assert np.linalg.norm(change - expected) < 0.07 * np.linalg.norm(expected)  # edges are averaged


def test_impossible_gears_are_refused() -> None:
    for wrong in ({"backlash_rad": -1.0}, {"hysteresis_Nm": 1.0}, {"K2": 3.0}, {"cubic": np.nan}):
        with pytest.raises(JointIdError):
            Gear(**wrong)
    with pytest.raises(JointIdError, match=r"backlash_rad .* is -1: it must be finite and not negative"):
        Gear(backlash_rad=-1.0)
    with pytest.raises(JointIdError, match=r"cubic of a gear is inf: it must be finite\."):
        Gear(cubic=np.inf)
    slopes = {"K": 2.0, "K2": 3.0, "K3": 4.0, "T1_Nm": 0.5, "T2_Nm": 0.5}
    assert Gear(**slopes).kind == "piecewise"
    for name, value in (("K3", 0.0), ("T1_Nm", 0.0), ("T1_Nm", 0.6)):
        with pytest.raises(JointIdError, match="K2 needs K3"):
            Gear(**{**slopes, name: value})
    with pytest.raises(JointIdError, match="one Gear for each"):
        simulate_records(INERTIA, Elasticity(PAPER.K, PAPER.D), [5.0], gears=[Gear()])
    with pytest.raises(JointIdError, match="state it once"):
        simulate_records(INERTIA, Elasticity(PAPER.K, PAPER.D), [5.0], gears=[Gear(K=1.0), Gear()])


def test_a_hardening_gear_is_found_at_its_joint(stiffening: ElasticityFit) -> None:
    first, second = stiffening.gears
    assert (first.kind, second.kind) == ("hardening", "linear")
    assert first.cubic == pytest.approx(9000.0, rel=0.01)
    assert (stiffening.K[0], stiffening.K[1]) == (first.K, second.K)
    assert pytest.approx(PAPER.K, rel=2e-3) == stiffening.K


def test_a_law_is_reported_at_the_joints_that_have_it(stiffening: ElasticityFit) -> None:
    (found,) = effects_found(SimpleNamespace(fit=stiffening))  # type: ignore[arg-type]
    assert "(joint 1)" in found.detail
    assert "(joint 2)" not in found.detail


def test_the_torsion_curve_is_the_gear_s_torque(stiffening: ElasticityFit) -> None:
    curve = stiffening.torsion_curves[0]
    assert curve.deflection_rad.shape == curve.torque_Nm.shape == (2 * BAND.size, 256)
    np.testing.assert_allclose(curve.deflection_rad.mean(axis=1), 0, atol=1e-12)
    omega = 2 * np.pi * curve.frequency_hz[:, None]
    steps = np.roll(curve.deflection_rad, -1, axis=1) - np.roll(curve.deflection_rad, 1, axis=1)
    rate = steps * omega * 256 / (4 * np.pi)
    true = 43.0 * curve.deflection_rad + 9000 * curve.deflection_rad**3 + 0.10 * rate
    within = 8 * (curve.torque_noise_Nm + 43.0 * curve.deflection_noise_rad)
    assert np.all(np.abs(curve.torque_Nm - true).max(axis=1) < within + 2e-3 * curve.amplitude_Nm.max())
    assert stiffening.gears[0].tried_Nm == pytest.approx(curve.amplitude_Nm.max())


def test_a_torsion_curve_has_the_frequency_of_most_power() -> None:
    """Of all joints together: 24.2 and 25, of amplitudes with the sums 6.9 and 5.9."""
    s = 2j * np.pi * np.array([[3.0, 6.0]])
    torque = np.array([[[3.0, 3.9], [4.9, 1.0]]]).astype(complex)
    variance, fitted = np.full((2, *torque.shape), 1e-9), np.stack([torque / 40, torque])
    for curve in torsion_curves(s, torque / 40, torque, variance, fitted, np.ones(torque.shape, bool)):
        np.testing.assert_allclose(curve.frequency_hz, [6.0])


def test_the_band_of_a_torsion_curve_holds_harmonics_that_noise_hides() -> None:
    """Estimated noise that is too large hides them; the fitted law tells their size."""
    order = np.arange(1, 32)
    torque = np.where(order % 2, 1.0 / order**2, 0)[None, :, None].astype(complex)
    both, noise = np.stack([torque, torque]), np.full((2, *torque.shape), 4e-4)
    s = 10j * np.pi * order[None]
    (curve,) = torsion_curves(s, *both, noise, both, np.ones(torque.shape, bool))
    missed = curve.torque_Nm - samples_of(torque[..., 0], curve.torque_Nm.shape[1])
    assert 0.02 < missed.std() < curve.torque_noise_Nm[0] < 2 * missed.std()


@pytest.mark.parametrize("gear", [Gear(K=50.0), Gear(K=50.0, cubic=4e4)], ids=lambda gear: gear.kind)
def test_the_band_of_a_torsion_curve_includes_the_noise_of_the_deflection(gear: Gear) -> None:
    """At low frequency noise of the torque moves the deflection by far more than the torque."""
    records, rng = 200, np.random.default_rng(3)
    delta = 0.03 * np.sin(2 * np.pi * np.arange(256) / 256)
    torque = np.tile(phasors_of(gear.torque(delta), 3), (records, 1))[..., None]
    deflection = np.tile(phasors_of(delta, 3), (records, 1))[..., None]
    noise, per_torque = 5e-3, 11 / gear.K
    moved = noise * (rng.standard_normal((2, *torque.shape)) * [[[[1]]], [[[1j]]]]).sum(axis=0)
    fitted = np.stack([deflection, torque])
    both = fitted + np.stack([per_torque * moved, moved])
    variance = 2 * noise**2 * np.stack([np.full(torque.shape, per_torque**2), np.ones(torque.shape)])
    s = np.tile(2j * np.pi * np.arange(1, 4), (records, 1))
    (curve,) = torsion_curves(s, *both, variance, fitted, np.ones(torque.shape, bool))
    error = curve.torque_Nm - gear.torque(curve.deflection_rad)
    assert 0.93 < np.mean(np.abs(error) < 2 * curve.noise_beside(gear)) < 0.99


def test_the_range_tried_includes_motion_below_the_lines_of_a_curve() -> None:
    """Random motion had torques of 0.41 N·m, of which the lines of its curve made 0.27 N·m."""
    order = np.arange(1, 32)
    torque = np.where(order < 4, 1.0, 0)[None, :, None].astype(complex)
    both, noise = np.stack([torque, torque / 50]), np.full((2, *torque.shape), 1e-12)
    above = np.broadcast_to((order > 1)[:, None], torque.shape)
    (curve,) = torsion_curves(10j * np.pi * order[None], both[1], both[0], noise, both, above)
    layout = ParameterLayout.of(1)
    (gear,) = fitted_gears(layout.named(np.array([50.0, 0.0])), 1e-9 * np.eye(2), [curve])
    assert gear.tried_Nm == curve.largest_Nm > 1.2 * curve.amplitude_Nm.max()
    assert gear.tried_rad == pytest.approx(gear.tried_Nm / 50)


def test_a_gear_without_a_curve_is_valid_up_to_the_torque_of_the_motion(
    stiffening: ElasticityFit,
) -> None:
    """Point-to-point moves stay below the locked resonance, where no deflection is measured."""
    order = np.arange(1, 32)
    torque = np.where(order % 2, 2.0 / order**2, 0)[None, :, None].astype(complex)
    both, noise = np.stack([torque, torque]), np.full((2, *torque.shape), 1e-12)
    nowhere = np.zeros(torque.shape, bool)
    (curve,) = torsion_curves(10j * np.pi * order[None], *both, noise, both, nowhere)
    assert curve.torque_Nm.size == 0
    layout = ParameterLayout.of(1, effects=["cubic"])
    p = layout.named(layout.pack(K=[43.0], cubic=[9000.0]))
    gears = fitted_gears(p, 1e-9 * np.eye(layout.size), [curve])
    assert gears[0].tried_Nm == pytest.approx(np.abs(samples_of(torque[..., 0], 256)).max(), rel=1e-6)
    assert gears[0].torque(gears[0].tried_rad) == pytest.approx(gears[0].tried_Nm)
    fit = replace(stiffening, torsion_curves=(curve, stiffening.torsion_curves[1]), gears=gears * 2)
    assert gear_terms(fit, 0)["Lost motion"] == "not measured"
    assert "No measured torsion curve of joint 1:" in without_curve(fit)
    assert without_curve(stiffening) == ""


def test_colours_of_the_curve_rise_with_frequency_or_amplitude(stiffening: ElasticityFit) -> None:
    curve = stiffening.torsion_curves[0]
    ends = {
        by: [trace.name for trace in torsion_curve(stiffening, 0, colour_by=by).data if trace.showlegend]
        for by in ("frequency", "amplitude")
    }
    assert ends["frequency"][0] == "from 3 Hz"
    largest = ends["amplitude"][1]
    assert largest == f"to {curve.amplitude_Nm.max():.3g} N·m"
    assert float(ends["amplitude"][0].split()[1]) < float(largest.split()[1])


def test_backlash_and_damping_are_distinguished() -> None:
    fit = fitted("play")
    assert [gear.laws for gear in fit.gears] == [("backlash",), ("linear",)]
    assert fit.gears[0].backlash_rad == pytest.approx(0.003, rel=0.02)
    modes = [stiffness_over_amplitude(fit, j).data[0].mode for j in (0, 1)]
    assert modes == ["markers", "lines"]  # with backlash, the law depends on the waveform as well


def test_the_edges_of_the_backlash_are_found_between_samples() -> None:
    """Phasors from a few samples against those from very many, with edges anywhere."""
    gear = Gear(K=43.0, backlash_rad=0.013)
    delta = np.array([[0.003, 0.05 + 0.01j, 0, 0.004 - 0.006j, 0, 0.001j]])
    few, *_ = beyond_linear(GearLaws.of([gear]), delta, 128)
    fine = 0.003 + samples_of(delta[:, 1:], 1 << 16)
    beyond = gear.torque(fine) - gear.K * fine
    many = np.append(beyond.mean(), phasors_of(beyond, delta.shape[1] - 1))
    assert np.abs(few - many).max() < 2e-6 * gear.K * np.abs(delta).max()


@pytest.mark.parametrize("gear", [HARD, Gear(backlash_rad=0.03), DAHL], ids=lambda gear: gear.kind)
def test_the_noise_of_a_law_is_that_of_many_draws(gear: Gear) -> None:
    rng, draws, H = np.random.default_rng(1), 1500, 5
    laws, orders = GearLaws.of([replace(gear, K=43.0)]), np.arange(H + 1)
    kappa = 43.0 + 2j * orders
    compliance = np.where(orders < 3, 1 / kappa, 0)[None, None]
    f = np.array([0, 1.3 + 0.6j, 0, 0.1j, 0, 0.02])
    drive = (f / kappa / np.where(orders < 3, 1, orders) ** 2)[None, None]
    found = WoundGears.solve(laws, drive, compliance, H, 2)
    variance = np.where(orders[1:] < 3, 1e-7 / np.abs(kappa[1:]) ** 2, 1e-11)[None, None]
    own, rest = found.noise(variance)
    parts = rng.standard_normal((2, draws, 1, H)) * np.sqrt(variance[0] / 2)
    noise = parts[0] + 1j * parts[1]
    drives = np.repeat(drive, draws, 0)
    drives[..., 1:] += noise
    with_noise = WoundGears.solve(laws, drives, np.repeat(compliance, draws, 0), H, 2)
    left = (with_noise.beyond - found.beyond)[..., 1:] - own * noise
    size = (np.abs(own) ** 2 * variance + rest).max()
    np.testing.assert_allclose((np.abs(left) ** 2).mean(axis=0), rest[0], rtol=0.2, atol=0.01 * size)


@pytest.mark.long
def test_three_slopes_of_a_random_motion_are_no_cubic_law() -> None:
    """A cubic law leaves little more than noise there, with a K that is 2.5 % off."""
    gear = Gear(K=43.0, K2=55.0, K3=65.0, T1_Nm=0.5, T2_Nm=1.0)
    inertia, motion = Inertia(M=[0.0025], M2=[[0.0041]]), Motion("random", 3.0, 30.0, 5.0)
    records = simulate_motion(
        inertia,
        Elasticity(K=[43.0], D=[0.1]),
        motion,
        records=1,
        friction=MotorFriction(coulomb=[0.02]),
        gears=[gear],
        seed=3,
    )
    fit = identify_motion(records, inertia, inertia_std=0.05)
    assert fit.gears[0].kind == "piecewise"
    assert abs(fit.K[0] - 43.0) < min(3 * fit.standard_error[0], 0.2)
    assert abs(fit.gears[0].K3 - 65.0) < 1.3


def test_an_asymmetric_motion_has_no_mean_torque() -> None:
    """An even harmonic of the torque moves the gear to one side of its play."""
    gear = Gear(K=43.0, backlash_rad=0.03)
    f = np.array([[[0, 1.0 + 0j, 0.3j, 0]]])
    found = WoundGears.solve(GearLaws.of([gear]), f / 43.0, np.full_like(f, 1 / 43.0), 3, 3)
    fine = found.delta[0, 0, 0].real + samples_of(found.delta[0, 0, 1:], 1 << 14)
    torque = gear.torque(fine)
    assert abs(found.delta[0, 0, 0]) > 1e-3
    assert abs(torque.mean()) < 1e-4
    assert np.abs(phasors_of(torque, 3) - f[0, 0, 1:]).max() < 1e-4


def test_stiffness_in_a_sine_is_that_of_an_integration() -> None:
    amplitude = np.array([0.002, 0.01, 0.04])
    turn = 2 * np.pi * np.arange(20_000) / 20_000
    sines = amplitude[:, None] * np.sin(turn[::40])
    for gear in (replace(g, K=43.0) for g in (HARD, PLAY, DAHL, SLOPES)):
        for size, found in zip(amplitude, law_stiffness(gear, sines), strict=True):
            delta, z = size * np.sin(turn), 0.0
            torque = gear.torque(delta)
            if gear.hysteresis_Nm:
                loop = []
                for move in np.diff(np.tile(delta, 3), prepend=0.0) / gear.presliding_rad:
                    z += move * (1 - z * np.sign(move))
                    loop.append(z)
                torque = torque + gear.hysteresis_Nm * np.array(loop[-turn.size :])
            assert found == pytest.approx(2 * (torque * np.sin(turn)).mean() / size, rel=2e-3, abs=1e-4)


def test_backlash_of_a_sixth_of_the_deflection_is_found() -> None:
    """Terms have the error of the finding, and no secant stiffness that repeats K."""
    fit = fitted("wide play")
    gears, terms = fit.gears, gear_terms(fit, 0)
    assert re.match(r"13\.\d+ ± 0\.0\d+ mrad, ", terms["Backlash"])
    assert not [name for name in terms if name.startswith("Secant")]
    assert [gear.kind for gear in gears] == ["backlash"] * 2
    assert [gear.backlash_rad for gear in gears] == pytest.approx([0.0138, 0.0465], rel=1e-3)


@pytest.mark.long
def test_wide_backlash_is_found_beside_friction() -> None:
    """Friction of a fifth of the torque hides the backlash from a start without friction."""
    robot = Robot(
        M=[0.0006, 0.0006], M2=[[0.000562, -0.000052], [-0.000052, 0.000753]], K=[0.375, 11.47],
        D=[0.0022, 0.0072], backlash_rad=[0.2325, 0.0076], coulomb=[0.0068, 0.012],
    )  # fmt: skip
    motions = paper_motions(robot, np.geomspace(1.5, 12, 7), noise=0.01, periods=4.5, max_step_s=2e-4)
    (records,) = simulate([(robot, motions)])
    fit = identify_elasticity(extract_phasors(records), Inertia(robot.M, robot.M2))
    np.testing.assert_allclose(fit.K, robot.K, rtol=0.01)
    assert [gear.backlash_rad for gear in fit.gears] == pytest.approx([0.2325, 0.0076], rel=0.02)


def fit_law(robot: Robot, motions: Experiment, law: str) -> LikelihoodEstimate:
    """Fit with one law of the gears and free friction, from the true values."""
    (records,) = simulate([(robot, motions)])
    phasors = extract_phasors(records)
    return maximum_likelihood(
        phasors,
        Inertia(robot.M, robot.M2),
        robot.answer,
        friction=friction_waveforms(phasors, 0.03),
        effects=(law,),
    )


def test_free_friction_does_not_deflect_a_hardening_gear() -> None:
    """The torque of the friction model has an error near reversals, which the law would distort."""
    robot = replace(PAPER, cubic=[9000.0, 0.0], coulomb=[0.15, 0.03])
    fit = fit_law(robot, paper_motions(robot, BAND, **MOTIONS | {"max_step_s": MAX_STEP_S}), "cubic")
    assert fit.fundamental[0] < 1.2
    assert fit.named["cubic"][0] == pytest.approx(9000, rel=1e-3)


def test_friction_that_holds_a_motor_is_unknown_to_its_gear() -> None:
    """Its whole residual is friction; within the torque through the gear, it shifts K2 by 0.4 %."""
    robot = replace(PAPER, hysteresis_Nm=[0.08, 0.03], hysteresis_rad=0.003, coulomb=[0.1, 0.2])
    motions = paper_motions(robot, BAND, **MOTIONS)
    moves = np.arange(motions.frequency_hz.size)[:, None] % 2 == np.arange(2)
    motions = replace(motions, amplitude_rad=motions.amplitude_rad * moves)
    fit = fit_law(robot, motions, "hysteresis")
    np.testing.assert_allclose(fit.named.K, robot.K, rtol=2e-3)


def test_indistinguishable_laws_give_the_remedy_of_a_second_amplitude(stiffening: ElasticityFit) -> None:
    assert second_amplitude(stiffening) == ""
    best, *others = stiffening.candidates
    rival = replace(others[0], name="elasticity + backlash", criterion=best.criterion + 3)
    advice = second_amplitude(replace(stiffening, candidates=(best, rival)))
    assert "backlash" in advice
    assert "half the amplitude" in advice
    assert second_amplitude_record(stiffening) is None
    record = second_amplitude_record(replace(stiffening, candidates=(best, rival)))
    assert record is not None
    assert stiffening.phasors.labels[record] in advice


def test_slopes_count_by_their_sum_and_without_what_no_record_shows() -> None:
    """Two uncertain changes with a certain sum are a law; an undetermined third slope is not."""
    layout = ParameterLayout.of(2, effects=["piecewise"])
    values = {"K": [50.0, 50.0], "piecewise": [6.0, 9.0], "second_bend": [-1.0, 25.0]}
    p = layout.named(layout.pack(**values, knee=[0.01, 0.01], second_knee=[0.002, 0.08]))
    covariance = 1e-6 * np.eye(layout.size)
    first, last = (layout[name].start for name in ("piecewise", "second_bend"))
    covariance[[first, last], [first, last]] = 5.0
    covariance[[first, last], [last, first]] = -4.99
    covariance[last + 1, last + 1] = np.inf
    seen = {"amplitude_rad": np.full(1, 0.02), "amplitude_Nm": np.ones(1), "largest_Nm": 1.0}
    curves = [SimpleNamespace(**seen)] * 2
    sure, unseen = fitted_gears(p, covariance, curves)
    short = SimpleNamespace(**(seen | {"amplitude_Nm": np.full(1, 0.613), "largest_Nm": 0.0}))
    beyond, _ = fitted_gears(p, covariance, [short, short])
    assert (sure.T2_Nm, beyond.K3) == (pytest.approx(0.612), beyond.K2)
    assert (sure.kind, unseen.kind) == ("piecewise", "piecewise")
    assert (sure.K2, sure.K3) == (56.0, 55.0)
    assert (unseen.K2, unseen.K3, unseen.T2_Nm) == (59.0, 59.0, unseen.T1_Nm)
    for errors, kind in ((3.4, "linear"), (3.6, "piecewise")):
        alone = np.zeros_like(covariance)
        alone[first, first] = (6.0 / errors) ** 2
        alone[last, last] = 100.0
        assert fitted_gears(p, alone, curves)[0].kind == kind


def test_a_noisy_harmonic_does_not_fold_a_torsion_curve() -> None:
    """Rounding that repeats was a third of the torque at 510 Hz, and six standard deviations."""
    s = 2j * np.pi * 30.0 * np.arange(1, 18)[None]
    torque, fitted = np.zeros((1, 17, 1), complex), np.zeros((2, 1, 17, 1), complex)
    torque[0, 0, 0], torque[0, 16, 0] = 0.3, 0.1
    fitted[:, 0, 0, 0] = 0.3 / 7.5, 0.3
    variance = np.stack(
        [np.full((1, 17, 1), 1e-12), (1.7e-2 * np.abs(s / s[0, -1]) ** 2)[..., None] ** 2]
    )
    (curve,) = torsion_curves(s, torque / 7.5, torque, variance, fitted, np.ones(torque.shape, bool))
    assert np.count_nonzero(np.diff(np.sign(np.diff(curve.torque_Nm[0])))) == 2


def test_hysteresis_is_distinguished_from_damping() -> None:
    fit = fitted("hysteresis")
    assert fit.gears[0].kind == "hysteresis"
    assert " ± 0.0" in gear_terms(fit, 0)["Hysteresis (half loop height)"]
    assert fit.gears[0].hysteresis_Nm == pytest.approx(0.08, rel=0.15)


def test_hysteresis_is_found_beside_a_stiff_gear() -> None:
    """The models fitted before it leave the stiff gear uncertain; its damping hardly shows."""
    robot = WORN["beside a stiff gear"]
    fit = identify_elasticity(measured()["beside a stiff gear"], Inertia(robot.M, PAPER.M2))
    assert fit.gears[0].laws == ("hysteresis",)
    shown = slice(3)  # K1, K2, D1
    assert np.all(np.abs(fit.estimate - robot.answer)[shown] < 4 * fit.standard_error[shown])


def test_hardening_is_found_beside_a_gear_of_one_encoder_step() -> None:
    """K of the stiff gear was lost; its deflection is that of one step."""
    stiff = replace(PAPER, K=[43.0, 8000.0], D=[0.1, 0.05], cubic=[9000.0, 0.0])
    (records,) = simulate([(stiff, paper_motions(stiff, BAND))])
    fit = identify_elasticity(extract_phasors(records), INERTIA)
    assert [gear.kind for gear in fit.gears] == ["hardening", "linear"]
    assert fit.K[0] == pytest.approx(43.0, rel=0.05)
    assert abs(fit.K[1] - 8000) < 3 * fit.standard_error[1] > 0.1 * fit.K[1]


def test_backlash_is_found_with_unknown_inertias_and_torque_scale() -> None:
    """Inertias and torque constants unknown, K is undetermined, and its ratios are not."""
    fit = identify_elasticity(measured()["play"], INERTIA, inertia_std=np.inf, torque_std=np.inf)
    assert fit.gears[0].laws == ("backlash",)
    assert fit.misfit < 1.5


def test_strong_hardening_is_found_behind_heavy_rotors() -> None:
    """Their torque is a small part of the motors' own."""
    gears = fitted("heavy rotors").gears
    assert [gear.laws for gear in gears] == [("hardening",)] * 2
    assert [gear.cubic for gear in gears] == pytest.approx([30000.0, 1000.0], rel=2e-3)


def test_hysteresis_is_found_beside_much_hardening() -> None:
    gears = fitted("wide loops").gears
    assert [gear.laws for gear in gears] == [("hardening", "hysteresis")] * 2
    assert [gear.hysteresis_Nm for gear in gears] == pytest.approx([0.15, 0.02], rel=0.01)


def test_several_laws_are_found_where_each_alone_fits_badly() -> None:
    """Beside friction, neither hardening nor backlash alone fits the data."""
    rubbing = replace(
        PAPER, coulomb=[0.2, 0.05], viscous=[2e-3, 4e-4], backlash_rad=[0.01, 0.02], cubic=[9000.0, 0.0]
    )
    (records,) = simulate([(rubbing, paper_motions(rubbing, BAND, **MOTIONS))])
    fit = identify_elasticity(extract_phasors(records), INERTIA)
    assert [set(gear.laws) for gear in fit.gears] == [{"hardening", "backlash"}, {"backlash"}]
    np.testing.assert_allclose(fit.K, PAPER.K, rtol=2e-3)


STICKY = {"coulomb": [0.2, 0.05], "viscous": [2e-3, 4e-4], "presliding_rad": [0.01, 0.01]}
STIFFENING = {
    law: replace(PAPER, cubic=[9000.0, 300.0], **STICKY, **more)
    for law, more in {
        "hardening": {},
        "backlash": {"backlash_rad": [0.004, 0.008]},
        "hysteresis": {"hysteresis_Nm": [0.08, 0.02], "hysteresis_rad": 0.003},
    }.items()
}
"""Hardening gears beside presliding friction, by their further law."""


@cache
def of_sticky_motors() -> dict[str, Phasors]:
    """Phasors of the stiffening robots, which are integrated side by side."""
    laws = tries(("hysteresis",), nightly=tuple(STIFFENING))
    logs = simulate([(STIFFENING[x], paper_motions(STIFFENING[x], BAND, **MOTIONS)) for x in laws])
    return {law: extract_phasors(records) for law, records in zip(laws, logs, strict=True)}


@pytest.mark.parametrize("law", STIFFENING)
def test_hardening_is_found_beside_presliding_friction(law: str) -> None:
    """Linear gears leave 150,000 times the noise, and no single part comes near the data."""
    fit = identify_elasticity(of_sticky_motors()[law], INERTIA)
    assert [set(gear.laws) for gear in fit.gears] == [{"hardening", law}] * 2
    np.testing.assert_allclose(fit.K, PAPER.K, rtol=2e-3)


def test_slopes_start_within_the_deflection_of_a_hardening_gear() -> None:
    """The largest torque over K would be far beyond it."""
    phasors = measured()["hardening"]
    prior = InertiaPrior.of(INERTIA, *phasors.q.shape)
    layout = ParameterLayout.of(2, effects=["cubic"])
    cubic = layout.named(layout.pack(K=PAPER.K, D=PAPER.D, cubic=[90000.0, 9000.0]))
    slopes = ParameterLayout.of(2, effects=["piecewise"])
    starts = other_laws(phasors, prior, cubic, slopes.named(slopes.pack(K=PAPER.K)), is_near=True)
    peak = np.abs(phasors.tau + phasors.omega[:, None] ** 2 * INERTIA.M * phasors.q).max(axis=0)
    largest = [Gear(K, c).deflection(u) for K, c, u in zip(PAPER.K, cubic["cubic"], peak, strict=True)]
    assert len(starts) == 2
    for start in starts:
        assert np.all(start["knee"] < largest)
        assert np.all(start["knee"] + start["second_knee"] < largest)


def test_a_cubic_law_is_tried_again_in_place_of_slopes() -> None:
    """Slopes may come nearer before the model is complete; here the given noise is too small by half."""
    robot = replace(PAPER, cubic=[9000.0, 300.0])
    (records,) = simulate([(robot, paper_motions(robot, BAND, **MOTIONS))])
    phasors = extract_phasors(records)
    prior = InertiaPrior.of(INERTIA, *phasors.q.shape)
    noise = moderated_noise(
        phasors, prior.M[prior.rotor], inverse(prior.M2)[prior.pose], PAPER.K, PAPER.D
    )
    noise = replace(noise, covariance=noise.covariance / 4)
    layout = ParameterLayout.of(2, effects=["cubic"])
    start = layout.named(layout.pack(K=PAPER.K, D=PAPER.D, cubic=robot.cubic))
    search = Search(phasors, prior, start, noise, Model(None, delay=False), Fits(("cubic",), 1000))
    slopes = search.base.with_part("piecewise")
    search.fit(slopes, start)
    assert grown(search, slopes).effects == ("cubic",)


def test_a_fit_of_backlash_starts_near_it() -> None:
    """Start values from deflection over torque; noise of high harmonics would hide the torque."""
    phasors = measured()["play"]
    start, _ = by_regression("backlash", phasors, InertiaPrior.of(INERTIA, *phasors.q.shape))
    np.testing.assert_allclose(start.K, PAPER.K, rtol=0.05)
    assert start["backlash"] == pytest.approx([0.003, 0.0], abs=0.0015)


def scripted(
    name: str, misfits: dict[Model, list[float]], monkeypatch: pytest.MonkeyPatch
) -> tuple[Search, list[tuple[Model, Parameters]]]:
    """A search whose fits have given misfits in turn, beside that of linear gears, and their starts."""
    phasors, base = measured()[name], Model(None, delay=False)
    prior = InertiaPrior.of(INERTIA, *phasors.q.shape)
    noise = moderated_noise(
        phasors, prior.M[prior.rotor], inverse(prior.M2)[prior.pose], PAPER.K, PAPER.D
    )
    found, calls = maximum_likelihood(phasors, INERTIA, PAPER.answer, noise=noise), []
    fits = Fits(("friction", "backlash", "hysteresis"), 1000, {base: found})

    def fit(self: Search, model: Model, start: Parameters, **_: bool) -> None:
        calls.append((model, start))
        left = misfits.get(model, [])
        cost = left.pop(0) * found.expected_cost if left else found.cost
        self.fits.tried[model] = replace(found, cost=cost)

    monkeypatch.setattr(Search, "fit", fit)
    return Search(phasors, prior, found.named, noise, base, fits), calls


def test_friction_beside_a_law_starts_from_the_law(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the start values of both together, backlash of 30 % of the motion is not found."""
    law = Model(None, delay=False, effects=("backlash",))
    search, calls = scripted("wide play", {law: [200.0]}, monkeypatch)
    fit_laws(search)
    sliding = Model(0.0, delay=False)
    starts = dict(reversed(calls))
    from_law = starts[sliding.with_part("backlash")]
    assert from_law.layout == search.fits.tried[law].named.layout  # without friction
    assert "hysteresis" in starts[sliding.with_part("hysteresis")].layout  # no law leads to this one


def test_a_law_beside_friction_starts_from_its_regression(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also after a fit from other start values: slopes from a cubic law left 1800 times the noise."""
    law = Model(None, delay=False, effects=("backlash",))
    beside = replace(law, reversal=0.0)
    search, calls = scripted("wide play", {law: [1e6]}, monkeypatch)
    search.fits.tried[beside] = search.fits.tried[search.base]
    fit_regressed(search, np.inf)
    assert [start for model, start in calls if model == beside] == [search.regressed_laws[0][1]]


def test_the_leading_law_of_motions_is_fitted_before_its_rivals(monkeypatch: pytest.MonkeyPatch) -> None:
    """Backlash took the place of hardening beside a hold that was not declared: K was 22 % off."""
    search, _ = scripted("hardening", {}, monkeypatch)
    gains = {"backlash": 0.6, "cubic": 0.8, "hysteresis": 0.1, "delay": 0.1}
    scored = {part: SimpleNamespace(gain=gain) for part, gain in gains.items()}
    monkeypatch.setattr(Search, "scores", lambda *_: scored)
    laws = _laws_of_motions(search, search.base)
    assert [part for _, part, _ in laws] == ["cubic", "backlash"]
    assert laws[0][2](search.phasors, search.prior).vector is search.start.vector


def test_a_law_far_from_its_optimum_starts_from_its_own_values(monkeypatch: pytest.MonkeyPatch) -> None:
    """A misfit of 57, of a minor optimum, counts as near the data: K was off by 25 %."""
    law = Model(None, delay=False, effects=("hysteresis",))
    search, calls = scripted("hysteresis", {law: [57.0, 0.9]}, monkeypatch)
    monkeypatch.setattr(Search, "pruned", lambda self, model: model)
    monkeypatch.setattr(Fits, "part_is_significant", lambda *_: True)
    climbed(search, search.base)
    assert ["hysteresis" in start.layout for model, start in calls if model == law] == [False, True]
    assert search.fits.misfit(law) == 0.9


LOADED = 0.03 / (0.3 / 43.0 + 0.3 / 60.0 + 0.4 / 75.0)


def behind_gears(
    gears: tuple[Gear, Gear], D: np.ndarray, coulomb: np.ndarray
) -> tuple[Phasors, np.ndarray, np.ndarray]:
    """Phasors of three sines of the deflections, exact up to harmonic 40, and the inertias."""
    M, M2, H, points = np.array([0.002, 0.001]), np.array([[4e-3, 1e-3], [1e-3, 2e-3]]), 40, 4096
    omega = 2 * np.pi * np.array([4.0, 7.0, 9.0])
    s = 1j * omega[:, None, None] * np.arange(1, H + 1)[:, None]
    delta = np.zeros((3, H, 2), complex)
    delta[:, 0] = 0.03 * np.array([[1.0, 0.7j], [0.9, -0.8], [0.5j, 1.0]])
    wound = samples_of(delta.swapaxes(1, 2), points)
    elastic = np.stack([gear.torque(wound[:, j]) for j, gear in enumerate(gears)], axis=1)
    f = phasors_of(elastic, H).swapaxes(1, 2) + s * D * delta
    q = delta + np.einsum("ij,rhj->rhi", np.linalg.inv(M2), f) / s**2
    sign = np.sign(samples_of((s * q).swapaxes(1, 2), points))
    tau = f + s**2 * M * q + coulomb * phasors_of(sign, H).swapaxes(1, 2)
    z, none = np.concatenate([q, tau], axis=2), np.zeros((3, H, 4, 4), complex)
    many = np.full(3, 1e9)
    phasors = Phasors(omega, q[:, 0], tau[:, 0], none[:, 0], many, np.full(3, 2.0), z, none)
    return phasors, np.tile(M, (3, 1)), np.tile(M2, (3, 1, 1))


@pytest.mark.parametrize(
    ("law", "gear"),
    [
        ("cubic", Gear(K=43.0, cubic=0.4 * 43.0 / 0.03**2)),
        ("backlash", Gear(K=43.0, backlash_rad=0.012)),
        ("piecewise", Gear(K=43.0, K2=60.0, K3=75.0, T1_Nm=0.3 * LOADED, T2_Nm=0.6 * LOADED)),
    ],
)
def test_a_law_follows_from_the_deflection_over_the_torque(law: str, gear: Gear) -> None:
    """Exactly without friction; changes of slope are at torques that the regression tries."""
    none, coulomb, factor = np.zeros(2), np.array([0.03, 0.0]), np.array([1.0, 0.2])
    (first, second), (step1, step2) = knees(gear)
    true = {
        "K": 43.0 * factor, "cubic": gear.cubic * factor, "backlash": gear.backlash_rad + none,
        "piecewise": step1 * factor, "second_bend": step2 * factor, "knee": first + none,
        "second_knee": second - first + none,
    }  # fmt: skip
    gears = gear, gear.scaled(0.2)
    plain = law_by_regression(law, *behind_gears(gears, none, none))
    rubbing = law_by_regression(law, *behind_gears(gears, none, coulomb))
    assert plain is not None
    assert rubbing is not None
    for name in plain.values.keys() & true.keys():
        assert plain.values[name] == pytest.approx(true[name], rel=2e-3), name
        assert rubbing.values[name][0] == pytest.approx(true[name][0], rel=0.1), name
    assert plain.values["coulomb"] == pytest.approx(none, abs=1e-4)
    assert rubbing.values["coulomb"][0] == pytest.approx(coulomb[0], rel=0.2)
    assert plain.left < 1e-3
    driving = law_by_regression(law, *behind_gears(gears, none, -coulomb))
    assert driving is not None
    assert driving.values["coulomb"].min() == 0.0  # no friction drives a motor
    damped = law_by_regression(law, *behind_gears(gears, 0.002 * np.array([43.0, 8.6]), none))
    assert damped is not None
    assert damped.values["D"] == pytest.approx(0.002 * np.array([43.0, 8.6]), rel=0.05)


def test_hysteresis_fitted_as_zero_restarts_from_a_usual_level() -> None:
    """With a level of zero the width has no effect."""
    phasors = measured()["hysteresis"]
    prior = InertiaPrior.of(INERTIA, *phasors.q.shape)
    layout = ParameterLayout.of(2, effects=["hysteresis"])

    def again(level: float) -> tuple[Parameters, ...]:
        values = {"K": PAPER.K, "hysteresis": [level, level], "presliding": [0.002, 0.002]}
        p = layout.named(layout.pack(**values))
        return other_laws(phasors, prior, p, p, is_near=False)

    (start,) = again(1e-6)
    assert np.all(start["hysteresis"] > 0.01)
    np.testing.assert_allclose(start["presliding"], start["hysteresis"] / PAPER.K)
    assert not again(0.08)


@pytest.mark.parametrize("name", ["hardening", "hysteresis"])
def test_backlash_is_never_negative(name: str) -> None:
    """The second joint has no backlash; with other laws a fit could make it negative."""
    found = maximum_likelihood(measured()[name], INERTIA, WORN[name].answer, effects=("backlash",))
    assert np.all(found.named["backlash"] >= 0)


@pytest.mark.parametrize(("name", "law"), [("wide play", "backlash"), ("hardening", "cubic")])
def test_a_law_is_fitted_under_the_noise_that_it_passes_on(name: str, law: str) -> None:
    """Otherwise the stated errors are those of other weights: K was off by four of them."""
    phasors, robot = measured()[name], WORN[name]
    prior = InertiaPrior.of(INERTIA, *phasors.q.shape)
    noise = spring_equations(phasors, [INERTIA] * len(phasors.q)).noise
    noise = replace(noise, covariance=9 * noise.covariance)  # no harmonic exceeds it
    found = maximum_likelihood(phasors, INERTIA, robot.answer, effects=(law,), noise=noise)
    assert np.all(found.scale == 1)
    model = Model(None, delay=False, effects=(law,))
    residual = evaluated(phasors, prior, model, found, noise, found.scale)
    _, gradient, normal = quadratic(residual, found.p)
    step = np.linalg.solve(normal, gradient)
    assert np.all(np.abs(step) < 0.05 * np.sqrt(np.diag(found.covariance)))


def test_with_gear_linear_no_law_is_fitted() -> None:
    fit = identify_elasticity(measured()["hardening"], INERTIA, gear="linear")
    assert [gear.laws for gear in fit.gears] == [("linear",)] * 2


@pytest.mark.parametrize("gear", [HARD, PLAY, DAHL, SLOPES], ids=lambda gear: gear.kind)
def test_simulated_records_follow_their_gear_law(gear: Gear) -> None:
    """A single joint in open loop: the logged torque drives an independent integration."""
    inertia, elasticity = Inertia([0.0025], [[0.0041]]), Elasticity([43.0], [0.1])
    gear = replace(gear, K=43.0)
    (record,) = simulate_records(
        inertia, elasticity, [8.0], gears=[gear], excitation=Excitation(duration_s=0.25, settle_s=0.0)
    )
    step = record.time_s[1]
    start = simulate_records(
        inertia, elasticity, [8.0], excitation=Excitation(duration_s=0.25, settle_s=0.0)
    )[0]
    held = record.tau_Nm[:, 0]

    def rate(time: float, x: np.ndarray) -> list[float]:
        theta, arm, w, v, z = x
        spring = float(gear.torque(theta - arm)) + 0.1 * (w - v) + gear.hysteresis_Nm * z
        torque = held[min(int(time / step + 1e-9), held.size - 1)]
        turn = (w - v) / gear.presliding_rad if gear.presliding_rad else 0.0
        return [w, v, (torque - spring) / 0.0025, spring / 0.0041, turn - abs(turn) * z]

    x = np.array([record.theta_rad[0, 0], *_steady(start, inertia, elasticity), 0.0])
    theta = [x[0]]
    for k in range(300):
        x = solve_ivp(rate, (k * step, (k + 1) * step * (1 - 1e-12)), x, rtol=1e-8, atol=1e-11).y[:, -1]
        theta.append(x[0])
    moved = np.ptp(record.theta_rad)
    assert np.abs(np.array(theta) - record.theta_rad[:301, 0]).max() < 1e-4 * moved


def _steady(record: object, inertia: Inertia, elasticity: Elasticity) -> tuple[float, float, float]:
    """Arm angle, motor velocity and arm velocity of the linear robot at the first sample."""
    phasors = extract_phasors([record])  # type: ignore[list-item]
    s, q, tau = 1j * phasors.omega[0], phasors.q[0, 0], phasors.tau[0, 0]
    arm = (tau - s * s * inertia.M[0] * q) / (s * s * inertia.M2[0, 0])
    return arm.imag, (s * q).imag, (s * arm).imag


@pytest.mark.parametrize(
    "gear",
    [HARD, PLAY, DAHL, SLOPES]
    + [replace(DAHL, **{name: getattr(other, name) for name in names}) for other, names in COMBINED],
    ids=lambda gear: " ".join(replace(gear, tried_rad=0.02).laws),
)
@pytest.mark.parametrize("drive", ["parallelogram", pytest.param("serial", marks=pytest.mark.long)])
def test_the_cut_agrees_with_an_independent_integration(gear: Gear, drive: Drive) -> None:
    arm, elasticity = PlanarArm.example(drive), Elasticity([43.0, 7.5], [0.10, 0.015])
    gears = [gear, gear.scaled(7.5 / 43.0)]
    run = track(arm, rectangle(zone_m=0.010), elasticity, elasticity, gears=gears, dt=1e-4)
    n, stop = arm.gear_ratio, 1500
    step = run.time_s[1]
    laws = [replace(law, K=K) for law, K in zip(gears, (43.0, 7.5), strict=True)]
    level = np.array([law.hysteresis_Nm for law in laws])
    reach = np.array([law.presliding_rad or np.inf for law in laws])

    def rate(x: np.ndarray, torque: np.ndarray) -> np.ndarray:
        q, theta, v, w, z = x.reshape(5, 2)
        twist, turn = n * (theta - q), n * (w - v)
        elastic = np.array([float(law.torque(t)) for law, t in zip(laws, twist, strict=True)])
        spring = n * (elastic + elasticity.D * turn + level * z)
        motor = (n * torque - spring) / arm.rotor_inertia_arm_kgm2
        loop = (turn - np.abs(turn) * z) / reach
        links = np.linalg.solve(arm.mass_matrix(q), spring - arm.coriolis(q, v))
        return np.concatenate([v, w, links, motor, loop])

    x = np.concatenate([run.joint_angle_rad[0]] * 2 + [np.zeros(6)])
    places = [x[:2]]
    for k in range(stop):
        torque = run.motor_torque_Nm[k]
        first = rate(x, torque)
        second = rate(x + 0.5 * step * first, torque)
        third = rate(x + 0.5 * step * second, torque)
        x = x + step / 6 * (first + 2 * second + 2 * third + rate(x + step * third, torque))
        places.append(x[:2])
    gap = arm.tool(np.array(places)) - run.tool_m[: stop + 1]
    assert np.hypot(*gap.T).max() < 5e-6


def test_a_servo_with_the_torsion_curve_has_a_smaller_error() -> None:
    arm, elasticity = PlanarArm.example(), Elasticity([43.0, 7.5], [0.10, 0.015])
    gears, path = [HARD, Gear(cubic=250.0)], rectangle(zone_m=0.010)
    linear = track(arm, path, elasticity, elasticity, gears=gears)
    known = track(arm, path, elasticity, elasticity, gears=gears, assumed_gears=gears)
    assert known.max_contour_error_m < 0.1 * linear.max_contour_error_m


@pytest.mark.parametrize("seed", [2, 5])
def test_backlash_is_not_identified_as_three_slopes(seed: int) -> None:
    """Three slopes imitate a play of 3 % of the deflection, with a first slope that is no stiffness."""
    inertia = Inertia([0.0028, 0.0012], [[0.0050, 0.0011], [0.0011, 0.0023]])
    play = [9.4e-4, 2.37e-3]
    records = simulate_records(
        inertia,
        Elasticity([36, 9.5], [0.08, 0.02]),
        np.geomspace(3, 28, tries(8, nightly=12)).tolist(),
        excitation=Excitation(periods=tries(6.5, nightly=None)),
        gears=[Gear(K=K, backlash_rad=b) for K, b in zip((36, 9.5), play, strict=True)],
        measurement=Measurement(encoder_counts=65536, torque_noise_Nm=[0.03, 0.015]),
        seed=seed,
    )
    fit = identify_elasticity(extract_phasors(records), inertia)
    assert [gear.kind for gear in fit.gears] == ["backlash"] * 2
    assert [gear.backlash_rad for gear in fit.gears] == pytest.approx(play, rel=0.02)
    np.testing.assert_allclose(fit.K, [36, 9.5], rtol=1e-3)


def test_backlash_is_sought_where_slopes_imitate_it() -> None:
    """Slopes explained the records: K1 was 97 % too small, of the gear inside its play."""

    def play(robot: Robot, loads: Loads) -> dict[str, Any]:
        return {"backlash_rad": [0.06 * loads.deflection[0], 0]}

    campaign = Case(change=play).campaign(4)
    (records,) = simulate([(campaign.robot, campaign.experiment)])
    fit = analyse(campaign.study(records)).fit
    assert [gear.kind for gear in fit.gears] == ["backlash", "linear"]
    assert fit.gears[0].backlash_rad == pytest.approx(campaign.robot.backlash_rad[0], rel=0.02)
    np.testing.assert_allclose(fit.K, campaign.robot.K, rtol=2e-3)


@pytest.mark.parametrize(("ratio", "edge"), [(2.0, 0.1), (3.0, 0.2), (3.0, 0.35)])
def test_three_slopes_as_in_a_catalogue_are_found(ratio: float, edge: float) -> None:
    """From the start values of a cubic law the fit ended elsewhere: K was 20 to 270 % off."""
    inertia = Inertia([0.0028, 0.0012], [[0.0050, 0.0011], [0.0011, 0.0023]])
    K, size = (36.0, 9.5), (2.0, 0.8)
    gears = [
        Gear(K=k, K2=ratio * k, K3=1.3 * ratio * k, T1_Nm=edge * peak, T2_Nm=2 * edge * peak)
        for k, peak in zip(K, size, strict=True)
    ]
    records = simulate_records(
        inertia,
        Elasticity(K, [0.08, 0.02]),
        np.geomspace(3, 28, 6).tolist(),
        excitation=Excitation(periods=6.5),
        gears=gears,
        **COARSE,
        measurement=Measurement(encoder_counts=65536, torque_noise_Nm=[0.03, 0.015]),
        seed=2,
    )
    fit = identify_elasticity(extract_phasors(records), inertia)
    assert [gear.kind for gear in fit.gears] == ["piecewise"] * 2
    assert fit.misfit < 1
    np.testing.assert_allclose(fit.K, K, rtol=0.01)
    assert [gear.T1_Nm for gear in fit.gears] == pytest.approx([g.T1_Nm for g in gears], rel=0.05)


def moving(angle: np.ndarray, step_s: float, torque: np.ndarray) -> MotorMotion:
    """Motors of angles and torques (n, N) in equal steps."""
    N = angle.shape[1]
    rise = np.pad(np.diff(angle, 2, axis=1), ((0, 0), (2, 0)))
    jerk = np.gradient(rise, axis=1)
    start = np.arange(N) < 2
    time, steps, pose = step_s * np.arange(N), np.full(N, step_s), np.zeros(N, int)
    return MotorMotion(angle, rise, jerk, time, steps, start, pose, torque, ())


def test_the_deflection_behind_moving_motors_is_that_of_the_equation() -> None:
    """With 16 steps over a period, damping costs no accuracy."""
    K, D, M2, step = 9.0, 0.05, 0.0014, 1 / (16 * 30)
    s = 2j * np.pi * np.array([7.0, 30.0])
    inertia, waves = s**2 * M2, np.exp(np.outer(s, step * np.arange(600)))
    motor = np.array([1.0, 0.3])
    wound = motor * inertia / (inertia + K + s * D)
    angle, delta, torque = ((each @ waves).imag[None] for each in (motor, wound, (K + s * D) * wound))
    laws, none = GearLaws.of([Gear(K=K)]), np.zeros((1, 1, 1))
    motors = moving(angle, step, torque)
    found = DrivenGears.solve(motors, laws, np.array([D]), none + M2, none, torque, 0.1)
    assert np.abs(found.delta - delta)[:, 100:-1].max() < 5e-4 * np.abs(delta).max()
    again = found.on(motors)  # a start for similar parameters, not for another motion
    assert again is not None
    np.testing.assert_array_equal(again.delta, found.delta)
    assert found.on(moving(1.2 * angle, step, torque)) is None


@pytest.mark.parametrize("size", [0.1, 0.3])
def test_a_hardening_gear_far_from_linear_is_solved_without_a_near_solution(size: float) -> None:
    """The linear deflection is several times as large: from it the solution diverged."""
    gear, D, M2, step = Gear(K=9.0, cubic=9e3), 0.03, 0.0014, 1 / (16 * 30)
    t, omega = step * np.arange(800), 2 * np.pi * np.array([4.0, 9.0, 13.0])
    a, phase = size * np.array([1.0, 0.6, 0.5]), np.arange(3)

    def motor(t: float) -> tuple[float, float]:
        turn = omega * t + phase
        return float(a @ np.sin(turn)), float((a * omega) @ np.cos(turn))

    def through(t: float, arm: np.ndarray) -> float:
        angle, velocity = motor(t)
        return float(gear.torque(angle - arm[0])) + D * (velocity - arm[1])

    def moved(t: float, arm: np.ndarray) -> list[float]:
        return [arm[1], through(t, arm) / M2]

    arm = solve_ivp(moved, (0, t[-1]), motor(0), t_eval=t, rtol=1e-7, atol=1e-9, max_step=step).y
    angle = np.array([motor(each)[0] for each in t])
    torque = np.array([[through(*each) for each in zip(t, arm.T, strict=True)]])
    none, motors = np.zeros((1, 1, 1)), moving(angle[None], step, torque)
    laws, damping = GearLaws.of([gear]), np.array([D])
    with np.errstate(all="ignore"):
        found = DrivenGears.solve(motors, laws, damping, none + M2, none, torque, 1.0).delta[0]
    assert np.abs(found - angle + arm[0])[100:-1].max() < 2e-3 * np.abs(angle - arm[0]).max()


@pytest.mark.parametrize(
    "law",
    [
        {"cubic": 2000.0},
        {"backlash_rad": 0.003, "K2": 60.0, "K3": 50.0, "T1_Nm": 0.3, "T2_Nm": 0.5},
        {"hysteresis_Nm": 0.05, "presliding_rad": 0.01},
    ],
    ids=lambda law: next(iter(law)),
)
def test_slopes_of_gears_in_motion_are_changes_of_their_solution(law: dict[str, float]) -> None:
    """Two coupled arms under gravity, in two poses, against Newton steps after a small change."""
    N, step, none = 80, 1 / (24 * 25), np.zeros(2)
    turn = 2 * np.pi * np.outer([11.0, 23.0], step * np.arange(N))
    angle = np.array([[0.02, 0.005], [-0.01, 0.008]]) @ np.sin(turn + np.array([[0.3], [1.0]]))
    waves = np.exp(-2j * np.pi * np.outer(np.arange(40), np.arange(1, 10)) / 40)
    motors = replace(
        moving(angle, step, 20 * angle),
        starts=np.isin(np.arange(N), [0, 1, 40, 41]),
        pose=np.repeat([0, 1], 40),
        rows=[(0, slice(0, 40), waves, np.ones((1, 9))), (1, slice(40, 80), waves, np.ones((1, 9)))],
    )
    M2 = np.array([[[4e-3, 1e-3], [1e-3, 2e-3]], [[3e-3, 5e-4], [5e-4, 2e-3]]])
    gear, D = Gear(K=43.0, **law), np.array([0.05, 0.01])
    gears, small = (gear, gear.scaled(0.2)), {"K": 1e-4, "D": 1e-6, "M2": 1e-8, "viscous": 1e-6}
    laws, delta = GearLaws.of(gears), 0.02 * np.sin(turn[:1] + np.array([[0.1], [1.3]]))
    loop = _loop(laws, delta, motors.starts)

    def settled(of: DrivenGears) -> DrivenGears:
        for _ in range(6):
            of = of._stepped()
        return of

    base = settled(DrivenGears(motors, laws, delta, loop, D, M2, 200 * M2, 0 * angle, none))
    base = settled(replace(base, loop=_loop(laws, base.delta, motors.starts)))
    # The observer is at rest at the solution: the torques as measured are those of the gears.
    rate, bend = np.zeros((2, N)), 2 / step * np.diff(base.delta, 2, axis=1)
    for k in range(2, N):
        rate[:, k] = rate[:, k - 2] + bend[:, k - 2]
    torque = laws.K * base.delta + base.beyond + D[:, None] * rate
    base = replace(base, measured=torque, observed=np.array([0.7, 0.4]))
    assert np.abs(base._left).max() < 1e-12
    arms = np.zeros((2, 2, 2, 2))
    arms[0, 1], arms[1, 0] = [[1, 2], [2, 0]], [[0, 0], [0, 1]]

    def changed(name: str, j: int, size: float) -> DrivenGears:
        one = np.eye(2)[j]
        if name == "M2":
            return settled(replace(base, M2=M2 + size * arms[j]))
        if name == "D":
            return settled(replace(base, D=D + size * one))
        if name == "viscous":
            own = motors.balance(none, none, size * one, none)
            return settled(replace(base, measured=torque + own))
        moved = list(gears)
        moved[j] = replace(gears[j], **{name: getattr(gears[j], name) + size})
        return settled(replace(base, laws=GearLaws.of(moved)))

    for name, size in [*small.items(), *((name, 1e-5 * value) for name, value in law.items())]:
        for j in (0, 1):
            ahead, behind = (changed(name, j, sign * size) for sign in (1, -1))
            own, measured, after = (
                (each(ahead) - each(behind)) / (2 * size)
                for each in (
                    lambda of: base.at_deflection(of.laws),
                    lambda of: of.measured,
                    lambda of: motors.bins(of.beyond, (2, 9)),
                )
            )
            own_change = {} if name == "M2" else {name: (own, measured)}
            found = base.slopes(own_change, (2, 9), arms if name == "M2" else None)[name][..., j]
            # The slopes leave out how D and M2 change the observer and the terms of order step².
            near = {"D": 0.01, "M2": 1e-3, "presliding_rad": 0.02}.get(name, 1e-6)
            assert np.linalg.norm(found - after) < near * np.linalg.norm(after), (name, j)


def test_motions_far_from_one_law_are_searched_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Backlash took the place of three slopes, and no score beside it was high enough to go on."""
    linear, law = Model(None, delay=False), Model(None, delay=False, effects=("backlash",))
    found, models = SimpleNamespace(misfit=300.0), list[Model]()
    fits = SimpleNamespace(
        tried=[linear, law],
        least=lambda among=(linear, law): among[-1],
        estimate=lambda _: found,
        misfit=lambda _: found.misfit,
    )
    search = SimpleNamespace(fits=fits, is_lost=True, has_motions=True, is_spent=True)

    def climbs(_: object, model: Model) -> Model:
        models.append(model)
        return law

    monkeypatch.setattr(model_selection, "climbed", climbs)
    assert model_selection._best(search) == law  # type: ignore[arg-type]
    assert models == [law, linear]


def test_gears_of_segments_are_computed_near_them_only() -> None:
    """The first search has a few segments of each motion; fits to them computed all of it."""
    time = np.arange(20_000) / 1000
    angle = np.stack([np.sin(2 * np.pi * f * time) for f in (5.0, 11.0)], axis=1)
    record = MotionRecord(time, angle, 0.1 * angle, band_hz=(2.0, 20.0))
    segments = motion_phasors([record], np.full((1, 2), 1e-3)).segments
    few = MotorMotion.of(segments[2:4], np.zeros(2, int), False)
    whole = MotorMotion.of(segments, np.zeros(len(segments), int), False)
    assert few is not None
    assert whole is not None
    assert few.angle.shape[1] < 0.4 * whole.angle.shape[1]
    _, used, *waves = whole.rows[2]
    for kept, other in zip(few.rows[0][2:], waves, strict=True):
        np.testing.assert_allclose(kept, other)
    np.testing.assert_allclose(few.angle[:, few.rows[0][1]], whole.angle[:, used], atol=1e-6)


def test_the_balance_at_motors_has_no_velocity_between_records() -> None:
    """That between the last angle of a record and the first of the next counted as viscous friction."""
    step, none = 1e-3, np.zeros(1)
    angle = np.sin(20 * np.pi * step * np.arange(100))[None]
    alone, two = moving(angle, step, angle), moving(np.hstack([angle, angle + 5]), step, 0 * angle)
    two = replace(two, torque=np.hstack([angle, angle]), starts=np.tile(alone.starts, 2))
    own, of_both = (each.balance(none + 1, none, none + 0.1, none) for each in (alone, two))
    np.testing.assert_allclose(of_both[:, 1:99], own[:, 1:99], atol=1e-9)
    np.testing.assert_allclose(of_both[:, 101:199], own[:, 1:99], atol=1e-9)
    assert np.abs(of_both[:, 99:101] - own[:, [-1, 0]]).max() < 0.1


def test_the_balance_of_a_uniformly_accelerated_motor_is_exact() -> None:
    """Of two motors from the first step on: torque less inertia and both frictions."""
    step, count = 4e-3, 50
    time, acceleration, speed = (
        step * np.arange(count),
        np.array([[3.0], [-8.0]]),
        np.array([[0.1], [0.9]]),
    )
    torque = np.stack([np.cos(time), np.sin(time)])
    motors = moving(speed * time + 0.5 * acceleration * time**2, step, torque)
    scale, M, viscous, coulomb = np.array([[1.2, 0.9], [0.02, 0.3], [0.5, 0.1], [0.04, 0.2]])
    velocity = speed + acceleration * time
    expected = scale[:, None] * torque - M[:, None] * acceleration
    expected -= viscous[:, None] * velocity + coulomb[:, None] * np.sign(velocity)
    found = motors.balance(scale, M, viscous, coulomb)[:, 1:-1]
    np.testing.assert_allclose(found, expected[:, 1:-1], rtol=1e-9)


def test_an_arm_at_rest_between_the_flanks_has_a_deflection() -> None:
    """Its first period does not give its state: the fit of backlash to such motions ended there."""
    step, none = 1e-3, np.zeros((1, 1))
    angle = np.where(np.arange(2000) < 600, 0, np.sin(0.02 * np.pi * (np.arange(2000) - 600)))[None]
    pair, M2 = (none, none), np.array([[[0.004]]])
    laws = GearLaws.made(none + 50, none, none + 0.01, none, none, pair, pair)
    torque = np.where(angle == 0, 0, 0.4 * angle)
    found = DrivenGears.solve(
        moving(angle, step, torque), laws, np.array([0.1]), M2, 0 * M2, torque, 10.0
    )
    assert np.isfinite(found.delta).all()


def test_a_gear_of_small_torques_follows_its_parameters() -> None:
    """Beside a torque a thousand times as large, its deflection stayed where the solution started."""
    gear = Gear(cubic=300.0)
    D, M2, step = np.array([0.05, 5e-5]), np.diag([1.4e-3, 1.4e-6])[None], 1 / (24 * 20)
    t = step * np.arange(600)
    angle = np.tile(0.3 * np.sin(2 * np.pi * 7 * t) + 0.1 * np.sin(2 * np.pi * 19 * t), (2, 1))
    motors, one, none = moving(angle, step, 0 * angle), np.ones(2), np.zeros(2)
    measured = motors.balance(one, np.array([0.02, 2e-5]), none, none)
    found = None
    for K in (9.0, 9.3):
        laws = GearLaws.of([replace(gear, K=9.3), replace(gear, K=K).scaled(1e-3)])
        with np.errstate(over="ignore", invalid="ignore"):  # as in a fit
            found = DrivenGears.solve(motors, laws, D, M2, 0 * M2, measured, 1.0, found)
    assert found is not None
    first, second = found.delta
    np.testing.assert_allclose(second[300:], first[300:], atol=1e-4 * np.abs(first).max())


def test_further_harmonics_near_a_resonance_are_solved() -> None:
    """Wide play at a low frequency: impacts excite motor and arm beyond the harmonics of the record."""
    gear, H = Gear(K=30.0, backlash_rad=0.02), 8
    s = 2j * np.pi * 3.0 * np.arange(2 * H + 1)
    rigid, D = 1 / 0.001 + 1 / 0.0019, 0.015
    with np.errstate(divide="ignore"):
        compliance = np.where(np.arange(2 * H + 1) > H, 1 / (s**2 / rigid + gear.K + s * D), 0)
    drive = np.zeros(2 * H + 1, complex)
    drive[[1, 3]] = 0.3 / gear.K + 0.0125, 0.0125 / 3
    found = WoundGears.solve(GearLaws.of([gear]), drive[None, None], compliance[None, None], H, 2)
    beyond, *_ = beyond_linear(found.laws, found.delta, found.points)
    left = (drive - compliance * beyond - found.delta)[..., 1:]
    assert np.abs(left).max() < 1e-5 * np.abs(drive).max()


@pytest.mark.parametrize(
    ("K", "cubic", "backlash"), [(5.0, -1e3, 0.0), (0.01, -1e9, 0.1), (50.0, 1e300, 0.0)]
)
def test_a_diverging_gear_has_no_deflection_and_prints_nothing(
    K: float, cubic: float, backlash: float, capfd: pytest.CaptureFixture[str]
) -> None:
    step, N, none = 1e-3, 400, np.zeros((1, 1))
    angle = np.sin(2 * np.pi * 20 * step * np.arange(N))[None]
    motors = moving(angle, step, 50 * angle)
    pair = none, none
    laws = GearLaws.made(none + K, none + cubic, none + backlash, none, none, pair, pair)
    measured = motors.balance(np.ones(1), np.array([0.002]), np.zeros(1), np.zeros(1))
    inertia = np.array([[[0.004]]])
    with np.errstate(all="ignore"):
        found = DrivenGears.solve(motors, laws, np.array([0.01]), inertia, 0 * inertia, measured, 1.0)
    assert not np.isfinite(found.delta).any()
    assert capfd.readouterr() == ("", "")


def test_two_laws_are_found_beside_an_unstated_delay() -> None:
    """Slopes that start within the deflection of all the hardening took the place of both laws."""
    loop = {"hysteresis_Nm": 0.05, "presliding_rad": 0.005}
    records = simulate_records(
        PARALLELOGRAM,
        PLANT,
        np.geomspace(3, 30, 6).round(2),
        gears=[Gear(43.0, 9000.0, **loop), Gear(7.5, 300.0, **loop)],
        controller=Controller(torque_delay_s=3e-4),
        measurement=Measurement(torque_noise_Nm=0.005, position_noise_rad=1e-5),
        declare_timing=False,
        seed=1,
    )
    fit = identify_elasticity(extract_phasors(records), PARALLELOGRAM)
    assert {"cubic", "hysteresis"} <= set(next(each.parts for each in fit.candidates if each.chosen))
    assert fit.misfit < 1.2


def low_band_fit(change: Change, run: int) -> tuple[ElasticityFit, np.ndarray]:
    """Fit of a study at 0.2 to 0.6 of the lowest resonance, and its errors over the stated ones."""
    campaign = Case(change=change, band=LOW).campaign(run)
    (records,) = simulate([(campaign.robot, campaign.experiment)])
    fit = analyse(campaign.study(records)).fit
    return fit, (np.concatenate([fit.K, fit.D]) - campaign.answer) / fit.standard_error


@pytest.mark.long
def test_backlash_is_found_beside_motors_that_stick() -> None:
    rubs = rubbing(0.3, viscous=0.04)
    fit, z = low_band_fit(
        lambda robot, loads: rubs(robot, loads) | {"backlash_rad": 0.06 * loads.deflection}, 12
    )
    assert fit.misfit < 1.5
    assert np.abs(z).max() < 4


@pytest.mark.long
def test_gravity_is_found_beside_heavy_friction() -> None:
    """Both start together: after either alone the fit ends at another local minimum."""
    rubs = rubbing(0.6, viscous=0.04)
    fit, z = low_band_fit(lambda robot, loads: rubs(robot, loads) | {"gravity": 0.03 * robot.K}, 14)
    assert fit.misfit < 1.5
    assert np.abs(z).max() < 4


@pytest.mark.long
def test_friction_at_the_arm_is_found_beside_that_of_the_motors() -> None:
    """Motors with free reversals took a share of it, and the search ended at a misfit of 704."""
    rubs = rubbing(0.1, viscous=0.04)
    fit, _ = low_band_fit(
        lambda robot, loads: rubs(robot, loads) | {"arm_coulomb": 0.05 * loads.torque}, 20
    )
    assert "arm_coulomb" in fit.parameters.layout
    assert fit.misfit < 1.5


def test_friction_of_arms_that_nearly_stick_follows_their_motion() -> None:
    """The motion with friction that it follows itself: four Newton steps left 10 % of it."""
    phasors = np.zeros((1, 15, 1), complex)
    phasors[0, :3, 0] = 1.0, 0.3j, 0.5
    mobility = np.broadcast_to(1 / (1j * np.arange(1, 16)[None, :, None, None]), (1, 15, 1, 1))
    found = PeriodicFriction.solve(np.array([0.45]), mobility, phasors, 256)
    again = PeriodicFriction.at(np.array([0.45]), mobility, phasors - 0.45 * found.sign, 256)
    assert np.abs(again.sign - found.sign).max() < 1e-3


@pytest.mark.long
def test_two_laws_are_not_tried_where_the_torques_are_those_of_no_robot() -> None:
    """Their search would take as long as the rest of the analysis twice."""
    rubs = rubbing(0.3, viscous=0.04)
    campaign = Case(change=rubs).campaign(0)
    (records,) = simulate([(campaign.robot, campaign.experiment)])
    turned = [replace(record, tau_Nm=record.tau_Nm * [1.0, -1.0]) for record in records]
    analysis = analyse(campaign.study(turned))
    assert "sign of the torque of joint 2" in analysis.headline
    assert all(len(set(GEAR_LAWS).intersection(c.parts)) < 2 for c in analysis.fit.candidates)


def test_two_changes_of_slope_that_coincide_become_one() -> None:
    """They did not determine each other: the gear was reported as linear, its torque 15 % too small."""
    layout = ParameterLayout.of(2, effects=["piecewise"])
    values = {"piecewise": [6.0, 5.0], "second_bend": [6.0, 1.0], "knee": [0.05, 0.04]}
    p = layout.named(layout.pack(K=[40.0, 18.0], D=[0.1, 0.1], second_knee=[6e-4, 0.02], **values))
    one = with_one_bend(p)
    assert one is not None
    assert one["piecewise"] == pytest.approx([12.0, 5.0])
    assert one["second_bend"] == pytest.approx([0.0, 1.0])
    assert one["knee"] == pytest.approx([0.0503, 0.04])
    assert with_one_bend(one) is None


@pytest.mark.parametrize(
    "law", [{"cubic": 9000.0}, {"backlash": 3e-3}, {"hysteresis": 0.08, "presliding": 2e-3}]
)
def test_the_jacobian_behind_nonlinear_gears(law: dict[str, float]) -> None:
    """Against central differences: inertias move the arm, hence deflections measured at harmonics.

    Without this part, standard errors were ten times too small far below the resonance.
    """
    phasors = measured()["hardening"]
    prior = InertiaPrior.of(PARALLELOGRAM, *phasors.q.shape, inertia_std=0.05, torque_std=0.05)
    effects = ("arm_viscous", "lag", "position_filter", "gravity", *law.keys() - {"presliding"})
    layout = fitted_layout(prior, None, False, effects)
    given = ParameterLayout.of(2, effects=effects)
    rest = {"arm_viscous": 0.02, "lag": 1e-3, "position_filter": 1e-3, "gravity": 0.3}
    start = given.named(given.pack(K=PAPER.K, D=PAPER.D, **(rest | law)))
    noise = moderated_noise(
        phasors, prior.M[prior.rotor], inverse(prior.M2)[prior.pose], PAPER.K, PAPER.D
    )
    problem = make_problem(phasors, prior, layout, start, None, noise)
    p = problem.start(start)
    J = Residual.at(problem, p).jacobian(problem.z)
    for k, label in enumerate(layout.labels):
        step = 1e-3 * abs(p[k]) * np.eye(p.size)[k]
        ahead, behind = (Residual.at(problem, p + sign * step).r for sign in (1, -1))
        column = (ahead - behind) / (2 * step[k])
        assert np.linalg.norm(J[..., k] - column) < 0.01 * np.linalg.norm(column), label


def test_opposite_changes_of_slope_that_coincide_leave_a_deflection_above_zero() -> None:
    layout = ParameterLayout.of(1, effects=["piecewise"])
    values = {"piecewise": 20.0, "second_bend": -19.9, "knee": 0.05, "second_knee": 2e-3}
    one = with_one_bend(layout.named(layout.pack(K=40.0, **values)))
    assert one is not None
    assert 0.05 <= one["knee"][0] <= 0.052


def test_opposite_changes_of_slope_that_cancel_leave_the_first_deflection() -> None:
    """And changes whose sum is one unit are shared as any others."""
    layout = ParameterLayout.of(1, effects=["piecewise"])
    for bend, last, knee in ((5.0, -5.0, 0.02), (0.25, 0.75, 0.0203)):
        both = layout.named(
            layout.pack(K=9.0, D=0.1, piecewise=bend, second_bend=last, knee=0.02, second_knee=4e-4)
        )
        one = with_one_bend(both)
        assert one is not None
        assert one["piecewise"] == pytest.approx([bend + last])
        assert one["knee"] == pytest.approx([knee])


def test_a_first_slope_at_no_deflection_is_left_out() -> None:
    """In a motion K was 1.3 for 3.39 N·m/rad: the slope up to 12 µrad, which no data show."""
    layout = ParameterLayout.of(1, effects=["piecewise"])
    values = {"piecewise": 2.1, "second_bend": 1.7, "knee": 1.2e-5, "second_knee": 0.025}
    one = with_one_bend(layout.named(layout.pack(K=1.3, **values)))
    assert one is not None
    assert [one["K"][0], one["piecewise"][0], one["second_bend"][0]] == pytest.approx([3.4, 1.7, 0.0])
    assert one["knee"] == pytest.approx(0.025, rel=1e-3)
    assert with_one_bend(one) is None


def test_hardening_of_coupled_joints_is_found_far_below_the_resonance() -> None:
    """K was 20 to 30 % off: no start came near, and the fit took the errors of the inertias for K."""
    M, M2 = np.array([1.3e-3, 1.05e-3]), np.array([[2.2e-3, 3.7e-3], [3.7e-3, 8.2e-3]])
    records = simulate_records(
        Inertia(M, M2),
        Elasticity([9.33, 52.6], [0.01, 0.04]),
        np.geomspace(1.66, 4.98, 6).tolist(),
        excitation=Excitation(periods=6.5),
        gears=[Gear(9.33, 207.0), Gear(52.6, 9700.0)],
        **COARSE,
        measurement=Measurement(position_noise_rad=2e-6, torque_noise_Nm=[0.002, 0.004]),
        seed=1,
    )
    wrong = Inertia(M * [0.98, 1.03], M2 * np.outer([1.02, 0.97], [1.02, 0.97]))
    fit = identify_elasticity(extract_phasors(records), wrong, inertia_std=0.05)
    assert [gear.kind for gear in fit.gears] == ["hardening"] * 2
    np.testing.assert_allclose(fit.K, [9.33, 52.6], rtol=0.01)
    assert np.all(np.abs(fit.K - [9.33, 52.6]) < 3 * fit.standard_error[:2])


def test_signals_of_the_laws_are_those_of_the_robot() -> None:
    """Peaks, resonances, and the size at which each law equals the linear gear, of sines."""
    K, H, omega = 43.0, 3, 2 * np.pi * np.array([3.0, 9.0, 25.0])
    s = 1j * omega[:, None] * np.arange(1, H + 1)
    f = np.array([[1.0, 0.3j, 0.01], [0.5, 0.1, 0.2], [2j, 0.0, 0.004]])[..., None]
    squared = (s * s)[..., None]
    angle = f / K + f / (squared * 0.0041)
    variance = np.concatenate([0 * f.real, np.full(f.shape, 1e-4)], axis=2)
    arm, rotor = np.full((3, 1, 1), 1 / 0.0041), np.full((3, 1), 0.0025)
    laws = JointLaws.of(s, angle, f, variance, arm, rotor, None, {})
    clear = np.abs(f) > 0.03  # three standard deviations
    np.testing.assert_array_equal(laws.clear, clear | (np.arange(H) == 0)[:, None])
    assert laws.peak == pytest.approx([2.0])
    assert laws.locked == pytest.approx([np.sqrt(K / 0.0041)])
    assert laws.free == pytest.approx([1 / 0.0025 + 1 / 0.0041])
    np.testing.assert_array_equal(laws.low, (np.abs(s) < 3 * np.sqrt(K / 0.0041))[..., None])
    np.testing.assert_allclose(
        laws.angle, samples_of(angle.swapaxes(1, 2), laws.angle.shape[2]), atol=1e-12
    )
    assert laws.sines.tolist() == [0, 1, 2]
    # Noise of the angles counts by the rotor's torque.
    moved = np.concatenate([1e-4 / np.abs(squared * 0.0025) ** 2, 0 * f.real], axis=2)
    other = JointLaws.of(s, angle, f, moved, arm, rotor, None, {})
    np.testing.assert_array_equal(other.clear, laws.clear)
    layout = ParameterLayout.of(1)
    units = laws.units(layout.named(layout.pack(K=K, D=0.1)))
    wound = 2.0 / K
    expected = {
        "K": K, "D": K / np.abs(s).max(), "cubic": K / wound**2, "backlash": wound, "hysteresis": 2.0,
        "presliding": wound, "piecewise": K, "knee": wound, "second_bend": K, "second_knee": wound,
        "arm_coulomb": 2.0, "bristle": np.abs(laws.angle).max(),
    }  # fmt: skip
    assert units.keys() == expected.keys()
    for name, value in expected.items():
        assert units[name] == pytest.approx(value), name
    with_gap = ParameterLayout.of(1, effects=["backlash"])
    beyond = laws._beyond_measured(with_gap.named(with_gap.pack(K=K, D=0.1)))
    s = 1j * omega[:, None] * np.arange(H + 1, 2 * H + 1)  # motor and arm move against each other
    reduced = 1 / (1 / 0.0025 + 1 / 0.0041)
    np.testing.assert_allclose(beyond[..., 0], 1 / (s * s * reduced + K + s * 0.1))
    assert laws._beyond_measured(layout.named(layout.pack(K=K, D=0.1))).shape == (3, 0, 1)
    shape = laws.presliding(np.array([0.01]), H)
    slope = laws.presliding_slope(np.array([0.01]), shape)
    change = (laws.presliding(np.array([0.0101]), H) - laws.presliding(np.array([0.0099]), H)) / 2e-4
    np.testing.assert_allclose(slope, change, rtol=0.02, atol=0.01 * np.abs(change).max())
    planned = laws.planned(laws.s[:2], 2 * angle[:2])
    np.testing.assert_allclose(planned.angle, 2 * laws.angle[:2])
    assert planned.clear.all()
    assert planned.sines.tolist() == [0, 1]
    assert planned.peak == laws.peak


def test_rows_are_multiplied_by_the_matrix_of_their_pose() -> None:
    rng, pose = np.random.default_rng(1), np.array([2, 0, 1, 2, 1, 0])
    matrices, rows = rng.standard_normal((3, 2, 2)), rng.standard_normal((4, 2, 6))
    true = np.einsum("kij,cjk->cik", matrices[pose], rows)
    np.testing.assert_allclose(by_pose(matrices, rows, pose), true)


def test_gears_without_a_solution_end_after_a_limit_of_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows of eight steps that hardly converge took 25 Newton steps each, minutes for a motion."""
    steps, original = [0], DrivenGears._stepped

    def counted(self: DrivenGears) -> DrivenGears:
        steps[0] += 1
        return original(self)

    def solves_short(self: DrivenGears, largest: np.ndarray) -> np.ndarray:
        return np.full(self.delta.shape[1], steps[0] % 25 == 0 and self.delta.shape[1] < 20)

    step, N, none = 1e-3, 4000, np.zeros((1, 1))
    angle = np.sin(2 * np.pi * 5 * step * np.arange(N))[None]
    motors = moving(angle, step, 50 * angle)
    pair, inertia = (none, none), np.array([[[0.004]]])
    laws = GearLaws.made(none + 50, none, none + 0.01, none, none, pair, pair)
    gears = DrivenGears(
        motors, laws, 0 * angle, 0 * angle, np.array([0.01]), inertia, 0 * inertia, angle, np.ones(1)
    )
    monkeypatch.setattr(DrivenGears, "_stepped", counted)
    monkeypatch.setattr(DrivenGears, "_solves", solves_short)
    assert not np.isfinite(gears._followed(gears, np.ones((1, 1))).delta).any()
    assert steps[0] <= 2500
