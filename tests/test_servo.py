"""The servo: feedforward against closed forms, and each option against its counterpart."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_cases import examples

from jointid.cut.arm import PlanarArm
from jointid.cut.feedforward import deflection, joint_motion, plan_servo
from jointid.cut.rectangle import rectangle
from jointid.cut.servo import Servo, require_tracking, run_servo
from jointid.cut.tracking import TrackingRun, track
from jointid.errors import JointIdError
from jointid.joints import Elasticity

DRIVES = ("parallelogram", "serial")
ELASTICITY = Elasticity(K=[43.0, 7.5], D=[0.10, 0.015])
FRICTION = SimpleNamespace(coulomb=[0.5, 0.25], viscous=[0.004, 0.002])


def cut(servo: Servo, drive: str = "parallelogram", **options: object) -> TrackingRun:
    arm = PlanarArm.example(drive)
    return track(
        arm, rectangle(), ELASTICITY, options.pop("assumed", ELASTICITY), servo=servo, **options
    )


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("elbow", ["positive", "negative"])
def test_joint_motion_and_torque_agree_with_finite_differences(drive, elbow) -> None:
    arm, path, h = PlanarArm.example(drive), rectangle(zone_m=0.005), 1e-5
    time = np.linspace(0.001, path.end_s - 0.001, 1500)
    now, before, after = (
        joint_motion(arm, path.derivatives(time + shift), elbow) for shift in (0.0, -h, h)
    )
    np.testing.assert_allclose(arm.tool(now.q[0]), path.position(time), atol=1e-13)
    for k in (0, 1):
        for name in ("q", "u"):
            slope = (getattr(after, name)[k] - getattr(before, name)[k]) / (2 * h)
            exact = getattr(now, name)[k + 1]
            np.testing.assert_allclose(slope, exact, atol=2e-3 * np.abs(exact).max())
    angle, rate, acceleration = now.q
    inertial = (arm.mass_matrix(angle) @ acceleration[..., None])[..., 0]
    np.testing.assert_allclose(now.u[0], inertial + arm.coriolis(angle, rate), atol=1e-9)


@examples(50, derandomize=True)
@given(K=st.floats(1.0, 1e6), lag=st.floats(1e-5, 0.05), step=st.sampled_from([1e-4, 1e-3]))
def test_deflection_under_a_torque_ramp_is_the_closed_form(K, lag, step) -> None:
    time = step * np.arange(400)
    expected = (time - lag * -np.expm1(-time / lag)) / K
    np.testing.assert_allclose(deflection(time, K, lag * K, step), expected, atol=1e-9 * expected.max())


def test_deflection_under_a_parabola_errs_with_the_square_of_the_step() -> None:
    K, lag = 7.5, 0.002
    errors = []
    for step in (4e-4, 2e-4, 1e-4):
        time = step * np.arange(1, round(0.1 / step) + 1)
        exact = (time**2 - 2 * lag * time - 2 * lag**2 * np.expm1(-time / lag)) / K
        series = np.concatenate([[0.0], time**2])
        errors.append(np.abs(deflection(series, K, lag * K, step)[1:] - exact).max())
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.1)


def test_deflection_without_damping_is_the_limit_of_little_damping() -> None:
    torque = np.sin(np.linspace(0, 3, 300)) ** 4
    np.testing.assert_allclose(
        deflection(torque, 7.5, 1e-9, 1e-3), deflection(torque, 7.5, 0.0, 1e-3), atol=1e-7
    )


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("damping", [[0.10, 0.015], [0.0, 0.0]])
def test_feedforward_alone_follows_the_path(drive, damping) -> None:
    """With the right torque no feedback is needed."""
    true = Elasticity(K=ELASTICITY.K, D=damping)
    run = track(PlanarArm.example(drive), rectangle(), true, true, servo=Servo(bandwidth_hz=1e-3))
    assert run.max_tracking_error_m < 2e-5


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize(
    "option",
    [
        {"sample_rate_hz": 1000.0},
        {"sample_rate_hz": 2000.0, "delay_samples": 1},
        {"sample_rate_hz": 1000.0, "delay_samples": 2},
        {"differentiated_velocity": True},
        {"sample_rate_hz": 2000.0, "encoder_bits": 16},
        {
            "sample_rate_hz": 2000.0,
            "encoder_bits": 16,
            "differentiated_velocity": True,
            "delay_samples": 1,
        },
        {"torque_limit_Nm": [60.0, 30.0]},
    ],
)
def test_with_a_perfect_model_no_option_costs_accuracy(drive, option) -> None:
    run = cut(Servo(**option), drive)
    assert run.max_tracking_error_m < 5e-6
    assert not run.torque_limit_hit


def test_options_change_the_error_under_a_mismatch() -> None:
    """The options change the feedback, so they change the error where feedback acts."""
    plain = cut(Servo(sample_rate_hz=1000.0), assumed=None)
    for option in ({"delay_samples": 1}, {"differentiated_velocity": True}, {"encoder_bits": 8}):
        other = cut(Servo(sample_rate_hz=1000.0, **option), assumed=None)
        assert np.abs(other.tool_m - plain.tool_m).max() > 1e-6


def test_gains_are_critically_damped_at_ten_hertz() -> None:
    arm = PlanarArm.example("serial")
    plan = plan_servo(arm, rectangle(), Servo(), None, None)
    J = arm.rotor_inertia_arm_kgm2 + np.diag(arm.mass_matrix(arm.inverse((1.15, 0.0))))
    for j in range(2):
        poles = np.roots([J[j], plan.derivative[j], plan.proportional[j]])
        np.testing.assert_allclose(poles, -2 * np.pi * 10.0, rtol=1e-6)


def test_encoder_counts_are_on_the_motor_shaft() -> None:
    plan = plan_servo(PlanarArm.example(), rectangle(), Servo(encoder_bits=10), None, None)
    np.testing.assert_allclose(plan.count, 2 * np.pi / 1024 / np.array([100.0, 90.0]))


@dataclass
class Turning:
    """A plant that turns evenly whatever the torque, and keeps what it was given."""

    motor: np.ndarray
    motor_rate = np.array([[0.3], [-0.2]])
    steps: list[np.ndarray] = field(default_factory=list)

    def step(self, torque: np.ndarray) -> None:
        self.steps.append(torque)
        self.motor = self.motor + 0.5e-3 * self.motor_rate


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("differentiated", [False, True])
@pytest.mark.parametrize("bits", [None, 12])
def test_the_control_law_sample_by_sample(delay, differentiated, bits) -> None:
    servo = Servo(
        sample_rate_hz=1000.0,
        delay_samples=delay,
        encoder_bits=bits,
        differentiated_velocity=differentiated,
        torque_limit_Nm=[30.0, 12.0],
    )
    plan = plan_servo(
        PlanarArm.example(), rectangle(), servo, ELASTICITY.K[:, None], ELASTICITY.D[:, None]
    )
    plant = Turning(plan.start_angle[:, None])
    shares: list[float] = []
    held = np.array(run_servo(plan, plant, 2, shares.append))[..., 0]
    k = np.arange(len(held))[:, None]
    true_rate = np.array([0.3, -0.2])
    y = plan.start_angle + 1e-3 * k * true_rate
    if bits:
        count = 2 * np.pi / 2**bits / np.array([100.0, 90.0])
        y = count * np.round(y / count)
    speed = np.diff(y, axis=0, prepend=y[:1]) * 1000.0 if differentiated else true_rate
    angle, rate, torque = (table[..., 0] for table in (plan.angle, plan.rate, plan.torque))
    feedback = plan.proportional * (angle - y) + plan.derivative * (rate - speed)
    late = np.concatenate([np.zeros((delay, 2)), feedback[: len(held) - delay]])
    limit = np.array([30.0 * 100.0, 12.0 * 90.0])
    # A position exactly between two counts may round either way.
    np.testing.assert_allclose(held, np.clip(torque + late, -limit, limit), atol=1e-4)
    assert np.any(np.abs(held) == limit)
    steps = np.array(plant.steps).reshape(-1, 2, 2)
    np.testing.assert_allclose(steps[:, 1], held)
    np.testing.assert_allclose(steps[1:, 0], 0.5 * (held[1:] + held[:-1]))
    np.testing.assert_allclose(steps[0, 0], 0.5 * held[0])
    every = len(held) // 50
    np.testing.assert_array_equal(shares, [*np.arange(0, len(held), every) / len(held), 1.0])


@pytest.mark.parametrize("drive", DRIVES)
def test_friction_costs_accuracy_and_its_compensation_restores_it(drive) -> None:
    without = cut(Servo(), drive, friction=FRICTION)
    compensated = cut(Servo(friction_compensation=FRICTION), drive, friction=FRICTION)
    assert without.max_contour_error_m > 1.5e-4
    assert compensated.max_contour_error_m < 2e-5


def test_one_friction_value_counts_for_both_joints() -> None:
    one, two = (
        SimpleNamespace(coulomb=0.2, viscous=0.0),
        SimpleNamespace(coulomb=[0.2, 0.2], viscous=[0, 0]),
    )
    runs = [cut(Servo(friction_compensation=f), friction=f) for f in (one, two)]
    np.testing.assert_array_equal(runs[0].tool_m, runs[1].tool_m)


def test_torque_limit_holds_and_is_reported() -> None:
    free = cut(Servo())
    peak = np.abs(free.motor_torque_Nm).max(axis=0)
    limited = cut(Servo(torque_limit_Nm=0.7 * peak))
    np.testing.assert_allclose(np.abs(limited.motor_torque_Nm).max(axis=0), 0.7 * peak, rtol=1e-12)
    assert limited.torque_limit_hit
    assert limited.max_contour_error_m > 100 * free.max_contour_error_m


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"sample_rate_hz": 0.0}, "sample_rate_hz = 0 Hz: it must be positive"),
        ({"sample_rate_hz": 1e6}, "expected 50 to 20000 Hz"),
        ({"bandwidth_hz": -1.0}, "bandwidth_hz = -1 Hz"),
        ({"delay_samples": 0.5}, "delay_samples = 0.5"),
        ({"delay_samples": -1}, "delay_samples = -1"),
        ({"encoder_bits": 0}, "encoder_bits = 0"),
        ({"encoder_bits": 16.5}, "encoder_bits = 16.5"),
        ({"torque_limit_Nm": [1.0, 0.0]}, "torque_limit_Nm is 0 N·m"),
        ({"torque_limit_Nm": [1.0, 1.0, 1.0]}, "3 values"),
        (
            {"friction_compensation": SimpleNamespace(coulomb=-0.1, viscous=0.0)},
            "coulomb friction is -0.1",
        ),
        ({"bandwidth_hz": float("nan")}, "bandwidth_hz"),
    ],
)
def test_bad_settings_are_refused(option, message) -> None:
    with pytest.raises(JointIdError, match=message):
        Servo(**option)


@pytest.mark.parametrize(
    ("name", "least", "most", "step"),
    [("sample_rate_hz", 50, 20_000, 0.01), ("delay_samples", 0, 100, 1), ("encoder_bits", 4, 40, 1)],
)
def test_the_limits_of_a_setting_are_allowed(name, least, most, step) -> None:
    assert [getattr(Servo(**{name: value}), name) for value in (least, most)] == [least, most]
    for value in (least - step, most + step):
        with pytest.raises(JointIdError, match=name):
            Servo(**{name: value})


def test_friction_may_be_zero_and_the_torque_limit_small() -> None:
    Servo(friction_compensation=SimpleNamespace(coulomb=0.0, viscous=0.0), torque_limit_Nm=1e-3)
    for name, unit in (("coulomb", "N·m"), ("viscous", "N·m·s/rad")):
        friction = SimpleNamespace(**{"coulomb": 0.0, "viscous": 0.0, name: [0.0, -0.5]})
        with pytest.raises(JointIdError, match=f"{name} friction is -0.5 {unit}"):
            Servo(friction_compensation=friction)


@pytest.mark.parametrize("away", [2.999, 3.0, np.nan])
def test_a_motor_three_radians_off_stops_the_run(away) -> None:
    require_tracking(np.array([[-2.999], [0.0]]))
    if away < 3:
        require_tracking(np.array([[0.0], [away]]))
        return
    with pytest.raises(JointIdError, match="more than 3 rad"):
        require_tracking(np.array([[0.0], [away]]))


def test_with_a_delay_longer_than_the_cut_feedback_never_acts() -> None:
    """36 samples: the bandwidth makes no difference."""
    slow, fast = (
        cut(Servo(sample_rate_hz=50.0, delay_samples=100, bandwidth_hz=hz)) for hz in (5.0, 20.0)
    )
    np.testing.assert_allclose(slow.tool_m, fast.tool_m, rtol=0, atol=1e-12)


@pytest.mark.parametrize("option", [{"bandwidth_hz": 5000.0}, {"delay_samples": 80}])
def test_an_unstable_loop_is_reported(option) -> None:
    with pytest.raises(JointIdError, match="unstable: lower its bandwidth or delay"):
        cut(Servo(**option), assumed=None)
