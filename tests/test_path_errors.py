"""Vectorised cuts: equal to those of pymunk, and the spread of path errors within the error bars."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from jointid.cut import path_errors
from jointid.cut.arm import PlanarArm
from jointid.cut.path_errors import errors_of_mismatch, path_error_distribution
from jointid.cut.rectangle import rectangle
from jointid.cut.servo import Servo
from jointid.cut.toolpath import Toolpath
from jointid.cut.tracking import track
from jointid.errors import JointIdError
from jointid.gears.gear import Gear
from jointid.joints import Elasticity

DRIVES = ("parallelogram", "serial")
TRUE = Elasticity(K=[43.0, 7.5], D=[0.10, 0.015])
COVARIANCE = np.diag([0.43, 0.075, 0.005, 0.00075]) ** 2
FRICTION = SimpleNamespace(coulomb=[0.5, 0.25], viscous=[0.004, 0.002])
GEARS = [Gear(cubic=5e3, K2=60.0, K3=80.0, T1_Nm=0.5, T2_Nm=1.0), Gear(0.0, 0.0, 0.01, 0.02, 0.004)]
REAL = Servo(
    sample_rate_hz=2000.0,
    delay_samples=1,
    encoder_bits=16,
    differentiated_velocity=True,
    friction_compensation=FRICTION,
    torque_limit_Nm=[20.0, 8.0],
)


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("zone", [0.001, 0.010])
def test_mismatches_are_single_cuts(drive, zone) -> None:
    arm, path = PlanarArm.example(drive), rectangle(zone_m=zone)
    ratios = np.array([[0.4, 0.95, 2.0, 0.4], [0.7, 1.02, 0.7, 1.02]])
    for pair, error in zip(ratios.T, errors_of_mismatch(arm, path, TRUE, ratios), strict=True):
        run = track(arm, path, TRUE, Elasticity(K=TRUE.K * pair, D=TRUE.D))
        assert error == pytest.approx(run.max_contour_error_m, abs=1e-7)


@pytest.mark.parametrize("drive", DRIVES)
def test_mismatches_are_single_cuts_with_every_option_of_the_servo(drive) -> None:
    arm, path = PlanarArm.example(drive), rectangle()
    ratios = np.array([[0.4, 1.0, 0.4, 1.0], [0.4, 0.4, 1.0, 1.0]])
    errors = errors_of_mismatch(arm, path, TRUE, ratios, servo=REAL, friction=FRICTION, dt=2.5e-4)
    for pair, error in zip(ratios.T, errors, strict=True):
        assumed = Elasticity(K=TRUE.K * pair, D=TRUE.D)
        run = track(arm, path, TRUE, assumed, servo=REAL, friction=FRICTION)
        # Encoder counts and sticking amplify rounding, so no longer to nanometres.
        assert error == pytest.approx(run.max_contour_error_m, abs=5e-6)


@pytest.mark.parametrize("lag", [0.0, 0.003, -0.004])
@pytest.mark.parametrize("zone", [0.001, 0.010])
def test_the_largest_contour_error_is_that_of_all_instants(lag, zone) -> None:
    """Tools that oscillate around the path, ahead of it or behind it."""
    path, step = rectangle(zone_m=zone), 5e-4
    time = np.arange(0.0, path.end_s + 0.05, step)
    across = np.random.default_rng(3).normal(0, 1, (time.size, 4, 2)) * [[1e-7], [1e-5], [1e-4], [2e-3]]
    tool = path.position(time - lag)[:, None] + across
    largest = path_errors._largest_contour_error(path, tool, path.position(time))
    assert np.array_equal(largest, path.distance(tool).max(axis=0))


def test_few_instants_of_a_cut_need_their_nearest_point(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tool lags behind its reference: the tracking error alone would leave most of them."""
    points = []
    distance = Toolpath.distance
    monkeypatch.setattr(
        Toolpath, "distance", lambda path, at: points.append(len(at)) or distance(path, at)
    )
    path, runs = rectangle(zone_m=0.005), 20
    errors_of_mismatch(PlanarArm.example(), path, TRUE, np.ones((2, runs)), servo=REAL)
    assert sum(points) < 0.05 * runs * path.end_s * REAL.sample_rate_hz


def test_a_path_at_rest_has_no_error() -> None:
    rest = Toolpath([0.3, 0.1], np.zeros((2, 2)), [0.05])
    assert errors_of_mismatch(PlanarArm.example(), rest, TRUE, [[1.0], [1.0]]) < 1e-12


def test_the_error_grows_with_the_mismatch_of_either_joint() -> None:
    ratio = np.geomspace(0.5, 2.0, 9)
    for ratios in ([ratio, np.ones(9)], [np.ones(9), ratio]):
        errors = errors_of_mismatch(PlanarArm.example(), rectangle(), TRUE, ratios)
        assert errors[4] < 1e-6
        assert np.all(np.diff(errors[4:]) > 0)
        assert np.all(np.diff(errors[:5]) < 0)


def test_about_three_percent_of_stiffness_is_enough_for_a_tenth_of_a_millimetre() -> None:
    for drive in DRIVES:
        ratios = [[0.97, 1.03, 0.97, 1.03], [0.97, 0.97, 1.03, 1.03]]
        errors = errors_of_mismatch(PlanarArm.example(drive), rectangle(), TRUE, ratios)
        assert 3e-5 < errors.max() < 1.3e-4


def test_a_fit_without_uncertainty_predicts_the_cut_itself() -> None:
    arm = PlanarArm.example()
    result = path_error_distribution(arm, rectangle(), TRUE, np.zeros((4, 4)), samples=3)
    exact = track(arm, rectangle(), TRUE, TRUE)
    np.testing.assert_allclose(result.max_contour_error_m, exact.max_contour_error_m, atol=1e-8)


@pytest.mark.parametrize("gears", [None, GEARS])
def test_each_draw_is_an_arm_whose_servo_assumes_the_fit(gears: list[Gear] | None) -> None:
    arm, path = PlanarArm.example("serial"), rectangle()
    result = path_error_distribution(arm, path, TRUE, COVARIANCE, samples=2, seed=3, gears=gears)
    for K, D, error in zip(result.K, result.D, result.max_contour_error_m, strict=True):
        run = track(arm, path, Elasticity(K=K, D=D), TRUE, gears=gears, dt=5e-4)
        assert error == pytest.approx(run.max_contour_error_m, abs=1e-7)


def test_the_95th_percentile_grows_with_the_uncertainty_and_is_repeatable() -> None:
    one, again, other, third = (
        path_error_distribution(PlanarArm.example(), rectangle(), TRUE, C, samples=25, seed=seed)
        for C, seed in ((COVARIANCE, 1), (COVARIANCE, 1), (COVARIANCE, 2), (COVARIANCE / 9, 1))
    )
    np.testing.assert_array_equal(one.max_contour_error_m, again.max_contour_error_m)
    assert np.any(one.max_contour_error_m != other.max_contour_error_m)
    assert third.p95_m == pytest.approx(one.p95_m / 3, rel=0.05)
    assert one.median_m == np.median(one.max_contour_error_m)
    assert one.median_m < one.p95_m < 2e-4


def test_draws_have_the_covariance_that_was_given() -> None:
    C = COVARIANCE.copy()
    C[0, 1] = C[1, 0] = 0.8 * np.sqrt(C[0, 0] * C[1, 1])
    path = rectangle(speed_m_s=0.2, zone_m=0.012)
    result = path_error_distribution(
        PlanarArm.example(), path, TRUE, C, samples=600, servo=Servo(sample_rate_hz=1000.0), dt=1e-3
    )
    drawn = np.concatenate([result.K, result.D], axis=1)
    np.testing.assert_allclose(drawn.std(axis=0), np.sqrt(np.diag(C)), rtol=0.1)
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(0.8, abs=0.05)
    assert abs(np.corrcoef(drawn.T)[0, 2]) < 0.15


def test_bad_input_is_refused() -> None:
    arm, path = PlanarArm.example(), rectangle()
    with pytest.raises(JointIdError, match=r"ratios .* give positive values"):
        errors_of_mismatch(arm, path, TRUE, [[-1.0], [1.0]])
    with pytest.raises(JointIdError, match=r"ratios .* shape \(2, 0\)"):
        errors_of_mismatch(arm, path, TRUE, [[], []])
    with pytest.raises(JointIdError, match="1 ms"):
        errors_of_mismatch(arm, path, TRUE, [[1.0], [1.0]], dt=2e-3)
    with pytest.raises(JointIdError, match="1 joint"):
        errors_of_mismatch(arm, path, Elasticity(K=[43.0], D=[0.1]), [[1.0], [1.0]])
    with pytest.raises(JointIdError, match="unstable"):
        errors_of_mismatch(arm, path, TRUE, [[0.5], [1.0]], servo=Servo(bandwidth_hz=5000.0))
    with pytest.raises(JointIdError, match=r"expected \(4, 4\)"):
        path_error_distribution(arm, path, TRUE, np.eye(2))
    with pytest.raises(JointIdError, match="symmetric"):
        path_error_distribution(arm, path, TRUE, np.diag([1.0, 1.0, -1.0, 1.0]))
    with pytest.raises(JointIdError, match="not determined well enough"):
        path_error_distribution(arm, path, TRUE, np.diag([43.0, 7.5, 1.0, 1.0]) ** 2)
    with pytest.raises(JointIdError, match="samples = 0"):
        path_error_distribution(arm, path, TRUE, COVARIANCE, samples=0)
