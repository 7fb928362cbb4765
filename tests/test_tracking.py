"""The cut: pymunk against an independent integration, and closed forms of the path error."""

from __future__ import annotations

from itertools import pairwise
from math import cos, sin
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointid.cut.arm import PlanarArm
from jointid.cut.rectangle import rectangle
from jointid.cut.servo import Servo
from jointid.cut.toolpath import Toolpath
from jointid.cut.tracking import TrackingRun, track
from jointid.errors import JointIdError
from jointid.joints import Elasticity

DRIVES = ("parallelogram", "serial")
ONE_DRIVE = [DRIVES[0], *(pytest.param(drive, marks=pytest.mark.long) for drive in DRIVES[1:])]
ZONES = (0.001, 0.005, 0.010)
TRUE = Elasticity(K=[43.0, 7.5], D=[0.10, 0.015])
CONTROLLERS = {
    "true": TRUE,
    "0.4 K": Elasticity(K=0.4 * TRUE.K, D=TRUE.D),
    "3 K": Elasticity(K=3 * TRUE.K, D=TRUE.D),
    "rigid": None,
}


def independent_tool(drive: str, run: TrackingRun) -> np.ndarray:
    """Tool path under the run's held torques, written out in numbers and integrated tightly."""
    l1, l2, m1, m2, r1, r2, i1, i2 = 0.705, 0.755, 45.0, 70.0, 0.30, 0.30, 2.2, 9.0
    a, b, c = i1 + m1 * r1**2 + m2 * l1**2, i2 + m2 * r2**2, m2 * l1 * r2
    n1, n2, B1, B2 = 100.0, 90.0, 100.0**2 * 0.0025, 90.0**2 * 0.0010
    K1, K2, D1, D2 = n1**2 * 43.0, n2**2 * 7.5, n1**2 * 0.10, n2**2 * 0.015

    def slope(_: float, y: np.ndarray, tau1: float, tau2: float) -> list[float]:
        q1, q2, t1, t2, w1, w2, v1, v2 = y.tolist()
        s1, s2 = K1 * (t1 - q1) + D1 * (v1 - w1), K2 * (t2 - q2) + D2 * (v2 - w2)
        if drive == "parallelogram":
            h, k = c * sin(q2 - q1), c * cos(q2 - q1)
            m11, m12, m22, c1, c2 = a, k, b, -h * w2**2, h * w1**2
        else:
            h, k = c * sin(q2), c * cos(q2)
            m11, m12, m22 = a + b + 2 * k, b + k, b
            c1, c2 = -h * (2 * w1 * w2 + w2**2), h * w1**2
        u1, u2, det = s1 - c1, s2 - c2, m11 * m22 - m12**2
        accelerations = [(m22 * u1 - m12 * u2) / det, (m11 * u2 - m12 * u1) / det]
        return [w1, w2, v1, v2, *accelerations, (tau1 - s1) / B1, (tau2 - s2) / B2]

    tau = run.motor_torque_Nm * [n1, n2]
    y = np.concatenate([run.joint_angle_rad[0], run.motor_angle_rad[0], np.zeros(4)])
    states = [y]
    changes = 1 + np.flatnonzero(np.any(np.diff(tau, axis=0) != 0, axis=1))
    edges = np.unique([0, *changes, len(tau) - 1])
    for first, last in pairwise(edges.tolist()):
        time = run.time_s[first : last + 1]
        piece = solve_ivp(
            slope, time[[0, -1]], y, "DOP853", time, args=tuple(tau[first]), rtol=1e-9, atol=1e-12
        ).y.T
        states.extend(piece[1:])
        y = piece[-1]
    q = np.array(states)[:, :2]
    phi1, phi2 = q.T if drive == "parallelogram" else np.cumsum(q, axis=1).T
    return np.stack(
        [l1 * np.cos(phi1) + l2 * np.cos(phi2), l1 * np.sin(phi1) + l2 * np.sin(phi2)], axis=1
    )


def deviation(drive: str, run: TrackingRun) -> float:
    return float(np.hypot(*(run.tool_m - independent_tool(drive, run)).T).max())


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("zone", ZONES)
def test_pymunk_agrees_with_an_independent_integration(drive, zone) -> None:
    """Worst case of the controllers: the springs swing most with 0.4 K."""
    servo = Servo(sample_rate_hz=500.0)
    run = track(
        PlanarArm.example(drive), rectangle(zone_m=zone), TRUE, CONTROLLERS["0.4 K"], servo=servo
    )
    assert run.max_contour_error_m > 1e-3
    assert deviation(drive, run) < 1e-6


@pytest.mark.parametrize("drive", ONE_DRIVE)
def test_pymunk_agrees_with_an_independent_integration_with_the_default_servo(drive) -> None:
    run = track(PlanarArm.example(drive), rectangle(), TRUE)
    assert deviation(drive, run) < 3e-7


@pytest.mark.parametrize("drive", ONE_DRIVE)
def test_the_deviation_shrinks_with_the_square_of_the_step(drive) -> None:
    servo = Servo(sample_rate_hz=250.0)
    errors = [
        deviation(drive, track(PlanarArm.example(drive), rectangle(), TRUE, None, servo=servo, dt=dt))
        for dt in (1e-3, 5e-4, 2.5e-4)
    ]
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.1)


def test_a_run_starts_at_rest_and_keeps_its_torque_between_samples() -> None:
    arm, path = PlanarArm.example("serial"), rectangle()
    run = track(arm, path, TRUE, servo=Servo(sample_rate_hz=1000.0), dt=2.5e-4)
    np.testing.assert_array_equal(run.joint_angle_rad[0], run.motor_angle_rad[0])
    np.testing.assert_allclose(run.tool_m[0], path.start_m, atol=1e-12)
    np.testing.assert_allclose(np.diff(run.time_s), 2.5e-4)
    assert run.time_s[-1] >= path.end_s
    held = run.motor_torque_Nm[:-1].reshape(-1, 4, 2)
    np.testing.assert_array_equal(held, held[:, :1].repeat(4, axis=1))
    np.testing.assert_allclose(arm.tool(run.joint_angle_rad), run.tool_m, atol=1e-15)
    np.testing.assert_allclose(path.position(run.time_s), run.reference_m, atol=1e-15)


@pytest.mark.parametrize("drive", ONE_DRIVE)
@pytest.mark.parametrize("zone", ZONES)
def test_identified_parameters_cut_within_hundredths_of_a_millimetre(drive, zone) -> None:
    arm, path = PlanarArm.example(drive), rectangle(zone_m=zone)
    assert track(arm, path, TRUE, TRUE).max_tracking_error_m < 1e-6
    for k1, k2, d in ((1.01, 0.99, 1.05), (0.99, 1.01, 0.95), (1.01, 1.01, 0.95), (0.99, 0.99, 1.05)):
        near = Elasticity(K=TRUE.K * [k1, k2], D=TRUE.D * d)
        assert track(arm, path, TRUE, near).max_contour_error_m < 6e-5


@pytest.mark.parametrize("drive", ONE_DRIVE)
def test_wrong_parameters_give_errors_of_millimetres_largest_in_the_largest_zone(drive) -> None:
    arm = PlanarArm.example(drive)
    for name, least in (("0.4 K", 2.5e-3), ("3 K", 1.2e-3), ("rigid", 2e-3)):
        worst = [
            track(arm, rectangle(zone_m=z), TRUE, CONTROLLERS[name]).max_contour_error_m for z in ZONES
        ]
        assert worst[-1] == max(worst)
        assert least < worst[-1] < 6e-3


@pytest.mark.parametrize("drive", ONE_DRIVE)
def test_error_scales_with_the_error_of_the_compliance(drive) -> None:
    """With both stiffnesses scaled alike, the deflection left over is |K/K̂ − 1| of the rigid one."""
    arm, path = PlanarArm.example(drive), rectangle()
    rigid = track(arm, path, TRUE).max_tracking_error_m
    for scale in (0.7, 0.9, 0.98, 1.02, 1.1, 1.5, 3.0):
        run = track(arm, path, TRUE, Elasticity(K=scale * TRUE.K, D=scale * TRUE.D))
        assert run.max_tracking_error_m == pytest.approx(abs(1 / scale - 1) * rigid, rel=0.03)


@pytest.mark.parametrize("drive", DRIVES)
def test_a_real_controller(drive) -> None:
    """Friction, 0.5 ms control, one sample of delay, 16-bit encoders with differentiated velocity."""
    friction = SimpleNamespace(coulomb=[0.5, 0.25], viscous=[0.0, 0.0])
    servo = Servo(
        sample_rate_hz=2000.0,
        delay_samples=1,
        encoder_bits=16,
        differentiated_velocity=True,
        friction_compensation=friction,
    )
    arm = PlanarArm.example(drive)
    near = Elasticity(K=TRUE.K * [1.01, 0.99], D=TRUE.D * [1.05, 0.95])
    errors = [
        track(arm, rectangle(), TRUE, assumed, servo=servo, friction=friction).max_contour_error_m
        for assumed in (near, CONTROLLERS["0.4 K"], None)
    ]
    assert errors[0] < 6e-5
    assert errors[1] > 2.5e-3
    assert errors[2] > 2e-3


@pytest.mark.parametrize("drive", DRIVES)
def test_contour_and_tracking_errors_match_their_definitions(drive) -> None:
    path = rectangle(zone_m=0.005)
    run = track(PlanarArm.example(drive), path, TRUE)
    np.testing.assert_allclose(run.tracking_error_m, np.hypot(*(run.tool_m - run.reference_m).T))
    assert np.all(run.contour_error_m <= run.tracking_error_m + 1e-7)
    dense = path.position(np.linspace(0, path.end_s, 20_000))
    for i in range(0, len(run.time_s), 97):
        nearest = np.hypot(*(dense - run.tool_m[i]).T).min()
        assert run.contour_error_m[i] == pytest.approx(nearest, abs=1e-5)


def test_the_other_elbow_and_another_place() -> None:
    arm = PlanarArm.example("serial")
    path = rectangle(centre_m=(0.3, -0.9), angle_rad=1.0)
    for elbow in ("positive", "negative"):
        run = track(arm, path, TRUE, TRUE, elbow=elbow)
        assert run.max_tracking_error_m < 1e-6
        assert np.sign(run.joint_angle_rad[0, 1]) == (1 if elbow == "positive" else -1)


def test_a_cut_across_the_back_of_the_arm_does_not_jump() -> None:
    """Link angles pass ±180° on the way."""
    run = track(PlanarArm.example(), rectangle(centre_m=(-0.9, 0.0), zone_m=0.005), TRUE, TRUE)
    assert np.abs(np.diff(run.joint_angle_rad, axis=0)).max() < 1e-3
    assert run.max_tracking_error_m < 1e-6


def test_progress_runs_from_zero_to_one_and_can_stop_the_cut() -> None:
    seen: list[float] = []
    track(PlanarArm.example(), rectangle(repetitions=2), TRUE, progress=seen.append)
    assert seen[0] == 0.0
    assert seen[-1] == 1.0
    assert np.all(np.diff(seen) > 0)

    def stop(fraction: float) -> None:
        if fraction > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        track(PlanarArm.example(), rectangle(), TRUE, progress=stop)


def test_a_result_cannot_be_changed() -> None:
    run = track(PlanarArm.example(), rectangle(), TRUE)
    with pytest.raises(ValueError, match="read-only"):
        run.tool_m[0] = 0.0
    with pytest.raises(AttributeError):
        run.tool_m = run.reference_m


@pytest.mark.parametrize("dt", [1.001e-3, 4e-3, 0.0, -1e-4, float("nan")])
def test_steps_above_a_millisecond_are_refused(dt) -> None:
    with pytest.raises(
        JointIdError, match=r"dt = .* s: the step must be positive and at most 0.001 s \(1 ms\)"
    ):
        track(PlanarArm.example(), rectangle(), TRUE, dt=dt)


def test_inputs_for_another_number_of_joints_are_refused() -> None:
    arm, path = PlanarArm.example(), rectangle()
    three = Elasticity(K=[1.0] * 3, D=[0.0] * 3)
    with pytest.raises(JointIdError, match="3 joint"):
        track(arm, path, three)
    with pytest.raises(JointIdError, match="assumed elasticity has 3 joint"):
        track(arm, path, TRUE, three)
    with pytest.raises(JointIdError, match="out of reach"):
        track(arm, rectangle(centre_m=(1.5, 0.0)), TRUE)
    with pytest.raises(JointIdError, match="too long for this arm"):
        track(arm, path, Elasticity(K=[4e5, 7.5], D=[0.1, 0.0]))
    with pytest.raises(JointIdError, match="too long for this arm"):
        track(arm, path, Elasticity(K=[43.0, 7.5], D=[50.0, 0.0]))
    with pytest.raises(JointIdError, match="negative"):
        track(arm, path, TRUE, friction=SimpleNamespace(coulomb=[-1.0, 0.0], viscous=[0.0, 0.0]))


def test_a_straight_line_is_cut_as_well() -> None:
    line = Toolpath(
        start_m=[1.1, 0.0],
        velocity_m_s=[[0, 0], [0.2, 0.1], [0.2, 0.1], [0, 0]],
        duration_s=[0.1, 0.2, 0.1],
    )
    run = track(PlanarArm.example(), line, TRUE)
    assert run.max_contour_error_m > 1e-5
