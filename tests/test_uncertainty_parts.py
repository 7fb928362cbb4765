"""Plans of motions, poses, given inertias and torsion curves with handwritten numbers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import BAND_HZ, ROBOTS, campaign, exact_phasors, plant_phasors
from scipy.stats import chi2

from jointid import (
    Elasticity,
    Inertia,
    JointIdError,
    Motion,
    MotionRecord,
    identify_elasticity,
    motor_response,
)
from jointid.estimation.candidates import Model
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.parameters import EFFECTS, ParameterLayout
from jointid.gears.gear import Gear
from jointid.gears.torsion_curve import TorsionCurve
from jointid.motion.friction import friction_waveforms
from jointid.simulation.experiment import Measurement, MotorFriction
from jointid.uncertainty import motion_plan
from jointid.uncertainty.answer_tables import PriorRow
from jointid.uncertainty.chosen_model import chosen_friction
from jointid.uncertainty.information import PlanningModel
from jointid.uncertainty.motion_plan import MotionLimits, largest_motion
from jointid.uncertainty.plan import _best_trial, _candidate_frequencies, _patterns, _speed
from jointid.uncertainty.planned_records import PlannedRecords, phase_deg, phasor_text
from jointid.uncertainty.poses import PoseFits, fits_by_pose
from jointid.uncertainty.resampling import Bootstrap
from jointid.uncertainty.validation import _same_motion, rival_laws

# --- plans of motions


def test_the_largest_motion_is_that_from_the_middle_at_the_mean_velocity() -> None:
    """A sine of 1 Hz on a travel of 3 rad/s; the start, with larger values, is not used."""
    time = np.arange(-100, 1000) / 1000.0
    angle = 0.2 * np.sin(2 * np.pi * time) + 3 * time
    angle[:50] = 100
    torque = np.where(np.arange(1100) < 50, 9.0, -0.5 * np.cos(2 * np.pi * time))
    record = MotionRecord(time, angle, torque, start_s=0.0)
    slow = MotionRecord(time, 0 * time, 0 * time)
    found = largest_motion([slow, record])
    assert found.position_rad[0] == pytest.approx(np.ptp(angle[100:]) / 2)
    assert found.velocity_rad_s[0] == pytest.approx(0.2 * 2 * np.pi, rel=0.01)
    assert found.torque_Nm[0] == pytest.approx(0.5)


def test_the_velocity_of_a_coarse_encoder_is_that_over_two_milliseconds() -> None:
    time = np.arange(4000) / 4000.0
    angle = np.zeros(4000)
    angle[2000:] = 1e-3  # a step of the encoder, in one sample
    found = largest_motion([MotionRecord(time, angle, time)])
    assert found.velocity_rad_s[0] == pytest.approx(1e-3 / 2e-3, rel=0.01)


def test_sensor_noise_is_that_of_a_sample() -> None:
    """White noise σ of N samples gives a phasor the deviation 2σ/√N."""
    samples, sigma = np.array([400, 900, 1600]), np.array([0.1, 3.0])
    phasors = SimpleNamespace(
        standard_deviation=2 * sigma / np.sqrt(samples)[:, None], duration_s=samples * 0.01
    )
    fit: Any = SimpleNamespace(phasors=phasors)
    np.testing.assert_allclose(motion_plan.sensor_noise(fit, 0.01), sigma)


def test_information_of_two_fits_adds_and_their_prior_counts_once() -> None:
    """K, D and one M; without correlation their variances add by their inverse."""
    blocks = [SimpleNamespace(name=name, shape=(1,)) for name in ("K", "D", "M")]

    class Layout(dict[str, slice]):
        size = 3

    Layout.blocks = blocks  # type: ignore[attr-defined]
    layout = Layout({name: slice(k, k + 1) for k, name in enumerate("KDM")})

    def fit(K: float, D: float, M: float, coupling: float = 0.0) -> Any:
        covariance = np.diag([1.0, 1.0, M])
        covariance[0, 2] = covariance[2, 0] = coupling
        return SimpleNamespace(
            n=1, parameters=SimpleNamespace(layout=layout), covariance=np.diag([K, D]),
            parameter_covariance=covariance,
            prior=SimpleNamespace(information=lambda _: np.array([[0.5]])),
        )  # fmt: skip

    np.testing.assert_allclose(
        motion_plan._together(fit(4.0, 1.0, 1.0), fit(4.0, np.inf, 1.0)), [np.sqrt(2), 1.0]
    )
    found = motion_plan._together(fit(4.0, 1.0, 1.0, 0.8), fit(4.0, 1.0, 0.8, -0.4))
    inverse = [np.linalg.inv([[4, c], [c, M]]) for M, c in ((1.0, 0.8), (0.8, -0.4))]
    both = np.linalg.inv(inverse[0] + inverse[1] - np.diag([0, 0.5]))
    np.testing.assert_allclose(found, np.sqrt([both[0, 0], 0.5]))


@pytest.mark.parametrize("blocked", [False, True])
def test_a_planned_motion_is_the_largest_within_its_limits(
    monkeypatch: pytest.MonkeyPatch, blocked: bool
) -> None:
    """Torques grow with acceleration, beside Coulomb friction; velocity and angle overshoot by 10 %."""
    limits = MotionLimits(np.array([1.0, 1.0]), np.array([2.0, 3.0]), np.array([1.0, 2.0]))
    coulomb, tried = np.array([0.2, 0.5]), []

    def simulated(fit: Any, motion: Motion, interval_s: float, **settings: Any) -> Any:
        tried.append(settings)
        friction = np.asarray(settings["friction"].coulomb) * np.ones(2)
        torque = np.asarray(motion.acceleration_rad_s2) * [0.05, 0.02] + friction
        return MotionLimits(
            1.1 * np.asarray(motion.position_rad), 1.1 * np.asarray(motion.velocity_rad_s),
            torque + 9 * blocked * (settings["measurement"] is not None),
        )  # fmt: skip

    monkeypatch.setattr(motion_plan, "_simulated", simulated)
    monkeypatch.setattr(motion_plan, "largest_motion", lambda made: made)
    fit: Any = SimpleNamespace(n=2)
    motion = Motion("sweep", 2.0, 30.0, 10.0, acceleration_rad_s2=1.0)
    given = (limits, MotorFriction(coulomb=coulomb), Measurement(), 1e-3, 2)
    if blocked:
        with pytest.raises(JointIdError, match="joint 1 does not overcome friction and sensor noise"):
            motion_plan._within(fit, motion, *given)
        assert len(tried) == 10
        return
    chosen, reached = motion_plan._within(fit, motion, *given)
    assert [settings["measurement"] is None for settings in tried[:5]] == [True] * 4 + [False]
    for value, limit in zip(vars(reached).values(), vars(limits).values(), strict=True):
        assert np.all(value <= limit * (1 + 1e-9))
    assert np.all(reached.position_rad > 0.95)
    # The velocity is exhausted first: each doubling of the acceleration ends there.
    assert np.all(np.asarray(chosen.acceleration_rad_s2) > 0.5)


def test_a_slower_controller_is_tried_where_a_fast_one_is_unstable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried = []

    def simulate(*_: Any, controller: Any, **__: Any) -> Any:
        tried.append(controller.bandwidth_hz)
        if controller.bandwidth_hz > stable_hz:
            raise JointIdError(f"unstable at {controller.bandwidth_hz} Hz")
        return controller

    monkeypatch.setattr(motion_plan, "simulate_motion", simulate)
    fit: Any = SimpleNamespace(inertias=[None], elasticity=None, gears=[Gear(K=2.0)])
    motion = Motion("sweep", 2.0, 30.0, 10.0)
    stable_hz = 5.0
    assert motion_plan._simulated(fit, motion, 1e-3).sample_rate_hz == pytest.approx(1000)
    assert tried == [10.0, 4.0]
    stable_hz = 1.0
    with pytest.raises(JointIdError, match=r"unstable at 1\.5 Hz"):
        motion_plan._simulated(fit, motion, 1e-3)


# --- poses


def poses(estimates: list[float], shared: float = 0.0) -> PoseFits:
    """K and D of poses whose errors are 1, of which a part is shared."""
    m = len(estimates)
    values = np.array([[20 + value, 1.0] for value in estimates])
    shift = np.zeros((m, 2, 1))
    shift[:, 0] = shared
    return PoseFits(tuple("abc"[:m]), values, np.tile(np.eye(2), (m, 1, 1)), shift, ())


def test_poses_agree_within_the_errors_that_they_do_not_share() -> None:
    found = poses([0.0, 2.0])
    assert found.significance == pytest.approx([np.sqrt(2), 0])
    assert found.spread == pytest.approx([2 / 21, 0])
    assert found.probability == pytest.approx(chi2.sf(2.0, 2))  # (2/√2)²
    alike = poses([0.0, 2.0], shared=0.8)  # 0.36 of the variance is their own
    assert alike.significance == pytest.approx([np.sqrt(2) / 0.6, 0])
    assert alike.probability == pytest.approx(chi2.sf(2.0 / 0.36, 2))
    assert poses([0.0, 2.0], shared=1.0).significance[0] == pytest.approx(np.sqrt(2e3))
    three = poses([0.0, 1.0, 2.0])
    assert three.significance[0] == pytest.approx(1.0)
    assert three.probability == pytest.approx(chi2.sf(2.0, 4))
    assert (poses([3.0]).probability, poses([3.0]).significance.tolist()) == (1.0, [0, 0])


def test_every_record_has_one_pose() -> None:
    inertia, elasticity = ROBOTS[1]
    phasors = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, 1))
    fit = identify_elasticity(phasors, inertia, method="weighted")
    r = phasors.omega.size
    for count in (r - 1, r + 1):
        with pytest.raises(JointIdError, match=f"{count} poses for {r} records"):
            fits_by_pose(phasors, inertia, ["low"] * count, fit)
    alone = fits_by_pose(phasors, inertia, ["low"] * r, fit)
    np.testing.assert_allclose(alone.estimates[0], fit.estimate, rtol=1e-9)


@pytest.mark.parametrize(("channel", "name"), [(0, "theta_m1_rad"), (1, "tau_m1_Nm")])
def test_signals_whose_products_overflow_are_refused(channel: int, name: str) -> None:
    inertia, elasticity = ROBOTS[1]
    phasors = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, 1))
    spring_equations(phasors, inertia)
    signals = [phasors.q.copy(), phasors.tau.copy()]
    signals[channel][3] = 2e30
    with pytest.raises(JointIdError, match=rf"record 4: {name} has an amplitude of 2e\+30"):
        spring_equations(exact_phasors(BAND_HZ, *signals), inertia)


# --- given and fitted inertias, draws


def test_given_and_fitted_inertias_stand_side_by_side() -> None:
    row = PriorRow("J_m1", "kg·m²", 2.0, 0.1, 2.3, 0.2, True)
    assert row.disagreement == pytest.approx(1.5)
    assert row.cells == ["J_m1", "2 ± 5.0 %", "2.3 ± 0.2", "kg·m²", "+1.5 σ"]
    less = replace(row, fitted=1.7, fitted_std=0.02)
    assert less.disagreement == pytest.approx(-3.0)
    assert less.cells[4] == "−3.0 σ"
    assert replace(row, fitted=2.19).cells[4] == "within 1 σ"
    assert replace(row, fitted=2.22).cells[4] == "+1.1 σ"
    for unknown in (
        {"given_std": 0.0},
        {"given_std": np.inf},
        {"fitted_std": np.inf},
        {"is_fitted": False},
    ):
        assert replace(row, **unknown).disagreement is None
        assert replace(row, **unknown).cells[4] == "–"
    assert replace(row, given_std=0.0).cells[1] == "2 (exact)"
    assert replace(row, given=0.0).cells[1] == "0 ± 0.10"
    assert replace(row, given_std=np.inf).cells[1] == "2.00 (start value)"
    assert replace(row, is_fitted=False).cells[2] == "as given"


def test_the_interval_of_draws_leaves_out_equal_shares() -> None:
    draws = Bootstrap(np.arange(101.0)[:, None] * [1, 2], np.ones(2), 0)
    np.testing.assert_allclose(draws.interval(0.9), [[5, 10], [95, 190]])
    np.testing.assert_allclose(draws.interval(), [[2.5, 5], [97.5, 195]])
    for level in (0.0, 1.0):
        with pytest.raises(JointIdError, match="between 0 and 1"):
            draws.interval(level)


# --- torsion curves


def test_a_torsion_curve_shows_its_stiffness_and_noise() -> None:
    """Damping turns the torque; the noise of the deflection counts by the slope."""
    turn = 2 * np.pi * np.arange(64) / 64
    waves = [0.01 * np.sin(turn), 0.02 * np.cos(turn), 0.01 * np.sin(3 * turn)]
    torque = [0.5 * np.sin(turn) + 0.3 * np.cos(turn), 0.8 * np.cos(turn), 0.4 * np.sin(3 * turn)]
    curve = TorsionCurve(
        np.array(waves),
        np.array(torque),
        np.array([0.0, 3e-4, 0]),
        np.array([2e-3, 0.016, 1]),
        np.ones(3),
    )
    K, noise, size = curve.stiffness
    np.testing.assert_allclose(K, [50, 40, np.nan])
    np.testing.assert_allclose(noise, [0.2, np.hypot(0.016, 0.012) / 0.02, np.nan])
    np.testing.assert_allclose(size, [np.hypot(0.5, 0.3), 0.8, 0], atol=1e-12)
    np.testing.assert_allclose(curve.amplitude_rad[:2], [0.01, 0.02])
    np.testing.assert_allclose(curve.amplitude_Nm[1], 0.8)
    beside = curve.noise_beside(Gear(K=40.0))
    np.testing.assert_allclose(beside[1], np.hypot(0.016, 0.012))
    np.testing.assert_allclose(beside[0], 2e-3)


# --- planned records


def test_noise_between_two_frequencies_is_that_of_both_by_the_logarithm() -> None:
    """Per length of the record; beyond the measured frequencies it is that of the nearest."""
    density = np.stack([np.eye(2), 3 * np.eye(2), 9 * np.eye(2)]).astype(complex)
    model: Any = SimpleNamespace(omega=np.array([1.0, 100.0, 400.0]), density=density)
    omega, length = np.array([[0.1, 1.0, 10.0], [200.0, 400.0, 1e4]]), np.array([[1.0], [4.0]])
    found = PlanningModel.noise(model, omega, np.broadcast_to(length, omega.shape))
    np.testing.assert_allclose(found[..., 0, 0], [[1.0, 1.0, 2.0], [1.5, 2.25, 2.25]])
    assert not found[..., 0, 1].any()


def test_the_best_record_lowers_the_largest_error_or_determines_most() -> None:
    errors = np.array([[0.1, 0.5], [0.3, 0.4], [0.2, 0.6]])
    information = np.tile(np.eye(2), (3, 1, 1))
    assert _best_trial(errors, information) == 1
    errors[[1, 2], 0] = np.inf
    assert _best_trial(errors, information) == 0  # the only one with finite errors
    errors[0, 1] = np.inf  # all leave one: that with most information in all directions
    information[1], information[2] = [[4.0, 1.9], [1.9, 1.0]], [[2.0, 0.0], [0.0, 0.0]]
    assert _best_trial(errors, information) == 0
    information[1] = [[4.0, 1.0], [1.0, 2.0]]
    assert _best_trial(errors, information) == 1
    errors[0] = np.inf
    assert _best_trial(errors, information[[2, 1, 0]]) == 1


def test_every_joint_moves_alone_and_with_the_others_in_every_phase() -> None:
    np.testing.assert_array_equal(_patterns(1), [[1]])
    found = _patterns(3)
    np.testing.assert_array_equal(found[:3], np.eye(3))
    assert len(found) == 9
    np.testing.assert_allclose(np.abs(found[3:]), 1)
    turns = np.degrees(np.angle(found[3:, 1] / found[3:, 0])) % 360
    np.testing.assert_allclose(turns, 60 * np.arange(6), atol=1e-9)
    np.testing.assert_allclose(found[3:, 2], found[3:, 1] ** 2)


def test_speeds_are_those_of_the_faster_of_motor_and_arm() -> None:
    """A motor in front of its resonance and beyond it, by equation (1)."""
    inertia, elasticity = Inertia([0.0025], [[0.0041]]), Elasticity([43.0], [0.1])
    omega = 2 * np.pi * np.array([5.0, 13.0, 60.0])
    tau = np.array([[1.0], [2.0j], [1.0]])
    q = motor_response(omega, inertia, elasticity) @ tau[..., None] / -(omega[:, None, None] ** 2)
    spring = 43.0 + 0.1j * omega
    arm = q[:, 0, 0] * spring / (spring - 0.0041 * omega**2)
    true = omega * np.maximum(np.abs(q[:, 0, 0]), np.abs(arm))
    np.testing.assert_allclose(_speed(omega, q[..., 0], tau, [inertia] * 3)[:, 0], true)
    assert abs(arm[1]) > abs(q[1, 0, 0])
    assert abs(arm[2]) < abs(q[2, 0, 0])


@pytest.mark.parametrize("highest", [None, 20.0, 60.0])
def test_candidates_span_the_band_and_the_resonances(highest: float | None) -> None:
    """From a tenth of the lowest frequency, or a period, to ten times the highest, or the limit."""
    inertia = Inertia([1.0], [[1.0]])

    def band(K: float, duration_s: float = 100.0) -> tuple[float, float]:
        fit: Any = SimpleNamespace(elasticity=Elasticity([K], [0.0]))
        phasors: Any = SimpleNamespace(omega=2 * np.pi * np.array([4.0, 30.0]))
        found = _candidate_frequencies(phasors, inertia, fit, duration_s, highest)
        assert found.size == 24
        np.testing.assert_allclose(np.diff(np.log(found)), np.log(found[1] / found[0]))
        return float(found[0]), float(found[-1])

    def stiffness(hz: float) -> float:
        return (2 * np.pi * hz) ** 2 / 2

    top = highest or 300.0
    usual = min(30.0, top)
    assert band(stiffness(15.0)) == pytest.approx((4.0, usual))
    assert band(stiffness(5.0)) == pytest.approx((1.5, usual))
    assert band(stiffness(5.0), 0.5) == pytest.approx((2.002, usual))
    assert band(stiffness(1.0)) == pytest.approx((0.4, usual))
    assert band(stiffness(50.0)) == pytest.approx((4.0, min(65.0, top)))
    assert band(stiffness(500.0)) == pytest.approx((4.0, top))


def test_relative_phases_are_those_to_the_first_driven_joint() -> None:
    torque = np.array([[2j, 1.0], [1e-9, 3j]])
    plan = PlannedRecords(np.array([1.0, 2.0]), torque, torque / 10, np.ones(2))
    torques, angles = plan.relative
    np.testing.assert_allclose(torques, [[2.0, -1j], [0.0, 3.0]], atol=1e-15)
    np.testing.assert_allclose(angles, [[0.2, -0.1j], [-1e-10j, 0.3]], atol=1e-15)
    np.testing.assert_allclose(plan.velocity_rad_s, np.abs(torque) / 10 * 2 * np.pi * [[1], [2]])
    turns = np.exp(1j * np.radians([0.0, 359.4, 359.6, -90.0]))
    np.testing.assert_allclose(phase_deg(turns), [0.0, 359.4, 0.0, 270.0], atol=1e-9)
    assert (phasor_text(0), phasor_text(1.94 * turns[3])) == ("0", "1.94 ∠ 270°")


@pytest.mark.parametrize(("behind", "rivals"), [(9.9, ("hardening",)), (10.1, ())])
def test_laws_within_ten_of_the_criterion_are_rivals(behind: float, rivals: tuple[str, ...]) -> None:
    def candidate(name: str, criterion: float, *, chosen: bool = False) -> Any:
        return SimpleNamespace(name=name, criterion=criterion, chosen=chosen)

    names = {law: EFFECTS[law].name for law in ("cubic", "backlash", "hysteresis")}
    fit: Any = SimpleNamespace(
        parameters=SimpleNamespace(layout={"backlash": 0}),
        candidates=[
            candidate("elasticity + " + names["backlash"], 5.0, chosen=True),
            candidate("elasticity + friction + " + names["cubic"], 5.0 + behind),
            candidate("elasticity + " + names["hysteresis"], 30.0),
            candidate("elasticity + gravity stiffness", 6.0),
        ],
    )
    assert rival_laws(fit) == tuple(names["cubic"] for _ in rivals)


def test_records_of_one_frequency_and_proportion_are_compared() -> None:
    """Joints of very different sizes, in records of any amplitude and phase."""
    one = np.array([1.0, 1e-4])
    turned, other = np.array([1.0, 1e-4 * np.exp(0.2j)]), np.array([1.0, 5e-5 * np.exp(1j)])
    deflection = np.stack([one, 0.3j * one, other, turned, one, -2 * other])
    omega = np.array([10.0, 10.0, 10.0, 10.0, 20.0, 10.0])
    groups = [group.tolist() for group in _same_motion(omega, deflection)]
    assert groups == [[0, 1, 3], [2, 5], [4]]


def test_friction_of_a_fit_without_candidates_has_sharp_reversals() -> None:
    phasors = plant_phasors(*ROBOTS[2], *campaign(BAND_HZ, 2))
    layout = ParameterLayout.of(2, friction=True)
    p = layout.named(layout.pack(K=1.0, D=1.0, coulomb=0.1))
    fit: Any = SimpleNamespace(parameters=p, candidates=(), prior=None)
    found, sharp = chosen_friction(phasors, fit), friction_waveforms(phasors, 0.0)
    assert found is not None
    np.testing.assert_array_equal(found.coulomb, sharp.coulomb)
    assert found.curve.shape[3] == 0
    assert found.free.shapes == 0
    fit.candidates = (SimpleNamespace(chosen=True, model=Model(0.1, delay=False, curve=True)),)
    free = chosen_friction(phasors, fit)
    assert free is not None
    assert free.free.shapes > 0
    assert free.curve.shape[3] == 5
    layout = ParameterLayout.of(2)
    fit.parameters = layout.named(layout.pack(K=1.0, D=1.0))
    assert chosen_friction(phasors, fit) is None
