"""Experiments as set points: the motion, the simulated robot, the limits, and every file read back."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from plants import PAPER, PARALLELOGRAM, ROBOTS
from random_cases import share
from setpoint_readers import limit_shares, outcome, random_trial, read
from typer.testing import CliRunner

from jointid import (
    Analysis,
    Elasticity,
    Inertia,
    JointIdError,
    Motion,
    MotionRecord,
    MotorFriction,
    RobotModel,
    Study,
    analyse,
    identify_motion,
    motor_response,
    save_study,
    simulate_motion,
)
from jointid.arrays import Floats
from jointid.cli import app
from jointid.importing import MappedLog, find_segments, study_from_logs
from jointid.setpoints.experiment import Experiment
from jointid.setpoints.files import set_points
from jointid.setpoints.formats import FORMATS
from jointid.setpoints.from_plan import KINDS, planned_experiment
from jointid.setpoints.robot_limits import RobotLimits, limits_from_toml
from jointid.setpoints.simulated_experiment import SimulatedExperiment, simulate_experiment
from jointid.uncertainty.motion_plan import PlannedMotion
from jointid.uncertainty.planned_records import PlannedRecords, planned_records
from tests.robots import SIX_AXES

RATIO = np.array([100.0, -90.0])
START_DEG = np.array([10.0, -90.0, 90.0, 0.0, 45.0, -30.0])
WIDE = RobotLimits(
    gear_ratio=RATIO,
    start_deg=START_DEG,
    lower_deg=[-170.0, -20.0],
    upper_deg=[170.0, 60.0],
    velocity_deg_s=200.0,
    acceleration_deg_s2=4000.0,
    torque_Nm=20.0,
    axes=[3, 5],
    robot="cell 7",
)
TOML = """
robot = "cell 7"
gear_ratio = [100, -90]
start_deg = [10, -90, 90, 0, 45, -30]
axes = [3, 5]
lower_deg = [-170, -20]
upper_deg = [170, 60]
velocity_deg_s = 200
acceleration_deg_s2 = 4000
torque_Nm = 20
"""


@cache
def plan() -> PlannedRecords:
    frequency = np.repeat([4.0, 7.0, 12.0, 23.0], 2)
    pattern = np.tile([[1.0, 0.3j], [-1.0, 0.3j]], (4, 1))
    return planned_records(PARALLELOGRAM, PAPER, frequency, torque_Nm=pattern, duration_s=1.0)


def experiment(**settings: object) -> Experiment:
    return planned_experiment(plan(), PARALLELOGRAM, PAPER, **settings)


@cache
def simulated(kind: str = "sines") -> SimulatedExperiment:
    return simulate_experiment(experiment(kind=kind), PARALLELOGRAM, PAPER)


# ----------------------------------------------------------------------------------------- motion


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("velocity", [0.0, 2.5])
def test_the_motion_is_smooth_and_ends_where_it_starts(kind: str, velocity: float) -> None:
    """Position, velocity and acceleration have no jump; each is the derivative of the one before."""
    made = experiment(kind=kind, velocity_rad_s=[velocity, -velocity])
    step = 1e-4
    time = np.arange(-1000, made.duration_s / step + 1000) * step
    q, dq, ddq = made.motion(time)
    for lower, upper in ((q, dq), (dq, ddq)):
        slope = (lower[2:] - lower[:-2]) / (2 * step)
        assert np.abs(slope - upper[1:-1]).max() < 2e-3 * np.abs(upper).max()
    assert np.abs(np.diff(ddq, axis=0)).max() < 0.03 * np.abs(ddq).max()
    for values in (q, dq, ddq):
        assert np.abs(values[[0, -1]]).max() < 1e-12


def test_the_plans_sines_are_there_at_full_amplitude() -> None:
    made = experiment(repeats=2, scale=0.5)
    assert len(made.runs) == 16
    for k, (run, begin, end) in enumerate(made.spans()):
        f, A = plan().frequency_hz[k % 8], plan().angle_rad[k % 8]
        assert end - begin >= 8 / f - 1e-9
        time = np.linspace(begin, end, 200)
        expected = 0.5 * np.imag(A * np.exp(2j * np.pi * f * (time - begin + run.ramp_s))[:, None])
        assert np.allclose(made.motion(time).position, expected, atol=1e-12)


def test_a_superposed_velocity_alternates() -> None:
    still, moving = experiment(), experiment(velocity_rad_s=[3.0, -1.0])
    assert len(moving.runs) == 2 * len(still.runs)
    (run, begin, end), (back, after, _) = list(moving.spans())[:2]
    middle = np.linspace(begin, end, 500)
    velocity = moving.motion(middle).velocity
    expected = still.motion(middle).velocity + np.array([3.0, -1.0])
    assert np.allclose(velocity, expected, atol=1e-9)
    assert moving.motion(np.array([after])).position[0, 0] > 0.9 * run.travel_rad[0]
    assert np.allclose(run.travel_rad, -back.travel_rad)


def test_a_sweep_runs_through_its_frequencies_at_one_velocity_amplitude() -> None:
    made = experiment(kind="sweep")
    run, begin, end = next(made.spans())
    time = np.linspace(begin, end, 40_000)
    q, dq, _ = made.motion(time)
    crossings = time[1:][np.diff(np.signbit(q[:, 0])) != 0]
    rate = 0.5 / np.diff(crossings)
    centre = (crossings[1:] + crossings[:-1]) / 2 - (begin - run.ramp_s)
    expected = 4.0 * (23.0 / 4.0) ** (centre / run.duration_s)
    assert np.allclose(rate, expected, rtol=0.03)
    peaks = [np.abs(part[:, 0]).max() for part in np.array_split(dq, 5)]
    assert np.ptp(peaks) < 0.02 * max(peaks)


@pytest.mark.parametrize("kind", ["multisine", "sweep"])
def test_other_motions_stay_within_the_velocities_and_torques_of_the_plan(kind: str) -> None:
    made = simulated(kind)
    velocity = made.experiment.motion(made.time_s).velocity
    assert np.all(np.abs(velocity).max(axis=0) < 1.05 * plan().velocity_rad_s.max(axis=0))
    torque = peaks(made)["torque", "exact following"]
    # A ramp and the ringing of the arm come on top.
    assert np.all(torque < 1.5 * np.abs(plan().torque_Nm).max(axis=0))


# ----------------------------------------------------------------------- the simulated robot


def test_no_sine_of_a_multisine_is_above_the_plan() -> None:
    """Its lines are spaced evenly; set points may leave no room above the planned frequencies."""
    high = planned_records(
        PARALLELOGRAM, PAPER, [11.3, 16.6667], torque_Nm=np.ones((2, 2)), duration_s=4.0
    )
    experiment = planned_experiment(high, PARALLELOGRAM, PAPER, kind="multisine")
    assert experiment.highest_hz <= 16.6667


@pytest.mark.parametrize("n", [1, 2, 3])
def test_exact_following_needs_the_torque_of_the_model(n: int) -> None:
    """Against equation (16) in the frequency domain, arm and motors, whole experiment."""
    inertia, springs = ROBOTS[n]
    records = planned_records(
        inertia, springs, [9.0, 16.0], torque_Nm=np.exp(1j * np.arange(n)), duration_s=0.5
    )
    made = simulate_experiment(
        planned_experiment(records, inertia, springs, rest_s=2.0), inertia, springs
    )
    torque, arm = followed(made.time_s, made.experiment.motion(made.time_s).position, inertia, springs)
    found = {each[:2]: each for each in made.peaks}
    for key, expected in (
        (("torque", "exact following"), torque),
        (("position", "arm, exact following"), arm),
        (("acceleration", "arm, exact following"), np.diff(arm, 2, axis=0) / made.time_s[1] ** 2),
    ):
        extremes = np.array([expected.min(axis=0), expected.max(axis=0)])
        assert np.allclose(found[key].values, extremes, atol=2e-3 * np.abs(expected).max()), key
        for j in range(n):
            at = np.searchsorted(made.time_s, found[key].time_s[:, j] - 1e-9)
            assert np.allclose(expected[at, j], extremes[:, j], atol=5e-3 * np.abs(expected).max())


def peaks(made: SimulatedExperiment) -> dict[tuple[str, str], Floats]:
    """Largest magnitudes by quantity and source, each (n,)."""
    return {each[:2]: np.abs(each.values).max(axis=0) for each in made.peaks}


def followed(time: Floats, theta: Floats, inertia: object, springs: object) -> tuple[Floats, Floats]:
    """Torque and arm angle for a motion of the motors that begins and ends at rest."""
    omega = 2 * np.pi * np.fft.rfftfreq(time.size, time[1])
    q = np.fft.rfft(theta, axis=0)
    tau = np.zeros_like(q)
    s2 = -(omega[1:] ** 2)[:, None]
    tau[1:] = np.linalg.solve(motor_response(omega[1:], inertia, springs), (s2 * q[1:])[..., None])[
        ..., 0
    ]
    arm = q.copy()
    arm[1:] = np.linalg.solve(inertia.M2, (tau[1:] - inertia.M * s2 * q[1:]).T).T / s2
    return tuple(np.fft.irfft(part, time.size, axis=0) for part in (tau, arm))


def test_friction_adds_to_the_torque() -> None:
    free = simulated("multisine")
    coulomb, viscous, load = np.array([[0.3, 0.1], [0.002, 0.001], [0.2, 0.1]])
    friction = MotorFriction(coulomb=coulomb, viscous=viscous, load=load)
    made = simulate_experiment(free.experiment, PARALLELOGRAM, PAPER, friction=friction)
    position, velocity, acceleration = made.experiment.motion(made.time_s)
    torque, _ = followed(made.time_s, position, PARALLELOGRAM, PAPER)
    level = coulomb + load * np.abs(torque - PARALLELOGRAM.M * acceleration)
    expected = np.abs(torque + level * np.sign(velocity) + viscous * velocity).max(axis=0)
    assert np.allclose(peaks(made)["torque", "exact following"], expected, rtol=5e-3)
    assert np.all(
        peaks(made)["torque", "simulated control"] > peaks(free)["torque", "simulated control"]
    )


def test_gravity_and_friction_at_the_arm_add_to_the_torque() -> None:
    friction = np.array([0.08, 0.03])
    inertia = Inertia(PARALLELOGRAM.M, PARALLELOGRAM.M2, gravity=np.diag([1.5, 0.4]))
    free = simulated("multisine").experiment
    made = simulate_experiment(free, inertia, PAPER, friction=MotorFriction(arm_viscous=friction))
    theta = made.experiment.motion(made.time_s).position
    s = 2j * np.pi * np.fft.rfftfreq(theta.shape[0], made.time_s[1])[:, None, None]
    arm = s**2 * inertia.M2 + s * np.diag(friction) + inertia.gravity
    spring = np.diag(PAPER.K) + s * np.diag(PAPER.D)
    motors = s**2 * np.diag(inertia.M) + arm @ np.linalg.solve(spring + arm, spring)
    torque = np.fft.irfft((motors @ np.fft.rfft(theta, axis=0)[..., None])[..., 0], len(theta), axis=0)
    expected = np.abs(torque).max(axis=0)
    assert np.allclose(peaks(made)["torque", "exact following"], expected, rtol=5e-3)
    followed_by_control = peaks(made)["torque", "simulated control"]
    assert np.allclose(followed_by_control, expected, rtol=0.5)  # the controller overshoots


# ---------------------------------------------------------------------------------- the files


@pytest.mark.parametrize("name", FORMATS)
def test_a_saved_file_holds_the_motion(name: str) -> None:
    text = set_points(simulated(), WIDE, name, study="Paper").text()
    found = read(name, text, START_DEG)
    made = simulated().experiment
    assert found.time_s[-1] >= made.duration_s - 1e-9
    expected = np.tile(START_DEG, (found.time_s.size, 1))
    expected[:, [2, 4]] += np.degrees(made.motion(found.time_s).position / RATIO)
    assert np.abs(found.position_deg - expected).max() < 1e-7
    for said in (
        "NOT RUN ON HARDWARE", "Study: Paper. Robot: cell 7.", "SAFETY", "ISO 10218", "emergency stop",
        "Duration:", "gear ratios 100, -90", "CHECK", "joint 2 torque:", "LOG", "record 8 (23 Hz): ",
    ):  # fmt: skip
        assert said in found.head, said


def test_the_ros_file_holds_velocities_and_accelerations() -> None:
    lines = set_points(simulated(), WIDE, "ros2").text().splitlines()
    points = [json.loads(re.sub(r"(\w+):", r'"\1":', line[2:])) for line in lines if line[:2] == "- "]
    times = np.array(
        [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points]
    )
    assert np.allclose(times, 0.004 * np.arange(1, times.size + 1), atol=1e-12)
    _, dq, ddq = simulated().experiment.motion(times)
    for key, values in (("velocities", dq), ("accelerations", ddq)):
        found = np.array([p[key] for p in points])
        assert np.allclose(found[:, [2, 4]], values / RATIO, atol=1e-8)
        assert not found[:, [0, 1, 3, 5]].any()


@pytest.mark.parametrize(
    ("kind", "name"), [*(("sines", name) for name in FORMATS), ("multisine", "rsi")]
)
def test_the_set_points_of_a_file_give_k_and_d_back(kind: str, name: str) -> None:
    """Another robot follows the file exactly; its log goes through the importer."""
    found = read(name, set_points(simulated(kind), WIDE, name).text(), START_DEG)
    theta = np.radians(found.position_deg[:, [2, 4]] - START_DEG[[2, 4]]) * RATIO
    torque, _ = followed(found.time_s, theta, PARALLELOGRAM, PAPER)
    noise = np.random.default_rng(1).standard_normal((2, *theta.shape))
    theta, torque = theta + 1e-7 * noise[0], torque + 1e-5 * noise[1]
    imported(MappedLog(found.time_s, theta, torque, name="file"), kind)


@pytest.mark.parametrize("kind", ["sines", "multisine"])
def test_the_simulated_motion_gives_k_and_d_back(kind: str) -> None:
    made = simulated(kind)
    log = MappedLog(made.time_s, made.theta_rad, made.tau_Nm, torque_hold=True, name="simulated")
    imported(log, kind)


@pytest.mark.long
def test_a_rest_without_noise_is_imported() -> None:
    """The torque of the arm decays below 1e-12 N·m while the angles are constant to the last bit."""
    found = read("csv", set_points(simulated(), WIDE, "csv").text(), START_DEG)
    theta = np.radians(found.position_deg[:, [2, 4]] - START_DEG[[2, 4]]) * RATIO
    torque, _ = followed(found.time_s, theta, PARALLELOGRAM, PAPER)
    part = (found.time_s > 8) & (found.time_s < 12)
    (segment,) = find_segments(MappedLog(found.time_s[part], theta[part], torque[part]))
    assert segment.frequency_hz == pytest.approx(7.0, rel=1e-6)


def imported(log: MappedLog, kind: str) -> None:
    segments = find_segments(log)
    lines = sorted(round(f, 2) for segment in segments for f in segment.lines_hz)
    assert lines == sorted(plan().frequency_hz.tolist())
    assert len(segments) == (8 if kind == "sines" else 2)
    fit = analyse(study_from_logs(log, list(segments), PARALLELOGRAM)).fit
    assert np.allclose(fit.K, PAPER.K, rtol=1e-3)
    assert np.allclose(fit.D, PAPER.D, rtol=5e-3)


@pytest.mark.parametrize("kind", ["sweep", "multisine", "random", "moves"])
def test_a_planned_motion_is_simulated_and_gives_k_and_d_back(kind: str) -> None:
    """Within its limits, from rest to rest; a log of the full amplitude goes to the estimator."""
    motion = Motion(
        kind, 3, 30, 8.0, velocity_rad_s=6.0, acceleration_rad_s2=[300.0, 500.0], position_rad=0.5
    )
    (record,) = simulate_motion(PARALLELOGRAM, PAPER, replace(motion, duration_s=2.0), records=1)
    planned = PlannedMotion(motion, (record, record), (), np.zeros(4), np.zeros(4))
    made = simulate_experiment(
        planned_experiment(planned, PARALLELOGRAM, PAPER, scale=0.5), PARALLELOGRAM, PAPER
    )
    spans = list(made.experiment.spans())
    assert len(spans) == 2
    position, velocity, acceleration = made.experiment.motion(made.time_s)
    assert np.abs(position[[0, -1]]).max() < 1e-9
    slope = np.gradient(position, made.time_s[1], axis=0)
    assert np.allclose(slope, velocity, atol=2e-3 * np.abs(velocity).max())
    inside = np.concatenate([np.flatnonzero((made.time_s > a) & (made.time_s < b)) for _, a, b in spans])
    share = np.abs(acceleration[inside]).max(axis=0) / [150.0, 250.0]
    assert np.all(share < 1.02)
    assert kind == "moves" or np.all(share > 0.5)
    torque, _ = followed(made.time_s, position, PARALLELOGRAM, PAPER)
    noise = np.random.default_rng(1).standard_normal((2, *torque.shape))
    records = []
    for _, begin, end in spans:
        rows = slice(*np.searchsorted(made.time_s, [begin, end]), 2)
        theta, tau = position + 1e-7 * noise[0], torque + 1e-4 * noise[1]
        records.append(MotionRecord(made.time_s[rows], theta[rows], tau[rows], band_hz=(3, 30)))
    fit = identify_motion(records, PARALLELOGRAM)
    assert np.allclose(fit.K, PAPER.K, rtol=2e-3)
    assert np.allclose(fit.D, PAPER.D, rtol=2e-2)
    text = set_points(made, replace(WIDE, acceleration_deg_s2=1e5), "csv").text()
    assert f"{kind} 2 (3 to 30 Hz): " in text


def test_texts_of_a_user_cannot_close_the_comment() -> None:
    evil = replace(
        WIDE, robot="x\nmovej([0,0,0,0,0,0])\u2028y", joint_names=tuple("a: ]\nb" + c for c in "123456")
    )
    one = planned_records(PARALLELOGRAM, PAPER, [9.0], torque_Nm=[1.0, 0.3j], duration_s=0.5)
    short = simulate_experiment(planned_experiment(one, PARALLELOGRAM, PAPER), PARALLELOGRAM, PAPER)
    for name in FORMATS:
        text = set_points(short, evil, name, study="s\r\nstopj(1)").text()
        assert read(name, text, START_DEG).time_s.size > 100
        assert not any(line.startswith(("movej", "stopj(1)", "y")) for line in text.splitlines())


# --------------------------------------------------------------------------------- the limits


@pytest.mark.parametrize(
    ("quantity", "factor"),
    [("velocity_deg_s", 0.8), ("acceleration_deg_s2", 0.5), ("torque_Nm", 0.7)],
)
def test_over_a_limit_nothing_is_written(quantity: str, factor: float) -> None:
    row = {"velocity_deg_s": 2, "acceleration_deg_s2": 3, "torque_Nm": 4}[quantity]
    peak = set_points(simulated(), WIDE, "egm").rows[row].peak
    limits = getattr(WIDE, quantity).copy()
    limits[0] = factor * peak
    tight = replace(WIDE, **{quantity: limits})
    name = quantity.split("_")[0]
    expected = rf"The {name} of joint 1 reaches .* \(record \d \(.* Hz\), [\d.]+ s, .*; its limit is"
    with pytest.raises(JointIdError, match=expected) as refusal:
        set_points(simulated(), tight, "egm").text()
    scale = float(re.search(r"motion scale to ([\d.]+) \(now 1\)", str(refusal.value))[1])
    assert 0.88 * factor < scale < factor
    smaller = simulate_experiment(experiment(scale=scale), PARALLELOGRAM, PAPER)
    text = set_points(smaller, tight, "egm").text()
    assert max(limit_shares(read("egm", text, START_DEG), axes_first(tight)).values()) < 1


def axes_first(robot: RobotLimits) -> RobotLimits:
    """A stand-in whose shares are those of the moving axes only, in the order of the file."""
    wide = np.full(6, 1e6)
    values = {}
    for name in ("lower_deg", "upper_deg", "velocity_deg_s", "acceleration_deg_s2", "torque_Nm"):
        full = -wide if name == "lower_deg" else wide.copy()
        full[[2, 4]] = getattr(robot, name)
        values[name] = full
    return RobotLimits(gear_ratio=np.ones(6), start_deg=robot.start_deg, **values)


def test_a_position_limit_holds_for_the_motion_around_the_start_pose() -> None:
    rows = set_points(simulated(), WIDE, "ur").rows
    low, high = rows[5], rows[6]
    assert (low.quantity, high.quantity) == ("lowest position", "highest position")
    assert low.peak < 45 < high.peak
    half = (high.peak - 45) / 2
    tight = replace(WIDE, upper_deg=np.array([170.0, 45 + half]))
    with pytest.raises(JointIdError, match=r"highest position of joint 2 .* motion scale to 0.4"):
        set_points(simulated(), tight, "ur").text()
    outside = replace(WIDE, upper_deg=np.array([170.0, 44.0]))
    with pytest.raises(JointIdError, match="another start pose"):
        set_points(simulated(), outside, "ur").text()


def test_the_load_at_rest_uses_up_torque() -> None:
    loaded = replace(WIDE, load_Nm=np.array([0.0, -19.9]))
    with pytest.raises(JointIdError, match=r"torque of joint 2 .* Set the motion scale to 0\.\d"):
        set_points(simulated(), loaded, "csv").text()
    with pytest.raises(JointIdError, match="check load and friction"):
        set_points(simulated(), replace(WIDE, load_Nm=np.array([0.0, 20.1])), "csv").text()


def test_load_and_inertia_are_those_of_the_robot_model_in_the_start_pose() -> None:
    """The load was 0 and the inertia that of the planned pose, also where the model knows better."""
    model = RobotModel.parse("six.toml", SIX_AXES.encode()).with_payload(mass_std=40.0)
    q, still = np.deg2rad([0.0, -60.0, 100.0, 20.0, 40.0, 10.0]), np.zeros(6)
    known = model.inertia(q)
    spring = Elasticity([50.0] * 6, [0.1] * 6)
    (record,) = simulate_motion(known, spring, Motion(duration_s=2.0), records=1)
    study = Study([record], known, robot_model=model, pose_angles_rad={"": q})
    fitted = Inertia(1.01 * known.M, 1.01 * known.M2)
    free: dict[str, object] = dict.fromkeys(
        ("velocity_deg_s", "acceleration_deg_s2", "torque_Nm", "upper_deg"), 360.0
    )
    robot = RobotLimits(model.gear_ratio, np.degrees(q).round(1), lower_deg=-360.0, **free)
    found, inertia = robot.on_robot(study, "", fitted)
    assert inertia is fitted
    heavier = model.with_payload(mass=model.payload.mass + 40)
    loads = [np.abs(each.torque(q, still, still) / model.gear_ratio) for each in (model, heavier)]
    np.testing.assert_allclose(found.load_Nm, np.max(loads, axis=0), rtol=1e-2, atol=1e-2)
    assert found.load_Nm.max() > 3
    other = np.degrees(q) + 20 * np.eye(6)[1]
    np.testing.assert_array_equal(
        replace(robot, start_deg=other).on_robot(study, "", fitted)[1].M2,
        model.inertia(np.radians(other)).M2,
    )
    given = replace(robot, load_Nm=np.ones(6))
    assert given.on_robot(study, "", fitted)[0] is given
    assert robot.on_robot(replace(study, pose_angles_rad={}), "", fitted) == (robot, fitted)


def test_no_scale_helps_where_rest_exceeds_the_limit() -> None:
    made = simulate_experiment(
        experiment(scale=1e-6), PARALLELOGRAM, PAPER, friction=MotorFriction(coulomb=0.5)
    )
    with pytest.raises(JointIdError, match="check load and friction"):
        set_points(made, replace(WIDE, torque_Nm=np.array([0.3, 9.0])), "csv").text()


def test_a_plan_without_motion_is_constant() -> None:
    none = planned_records(PARALLELOGRAM, PAPER, [4.0, 9.0], torque_Nm=[0.0, 0.0])
    for kind in KINDS:
        still = planned_experiment(none, PARALLELOGRAM, PAPER, kind=kind)
        assert not still.motion(np.linspace(0, still.duration_s, 999)).position.any()


def test_a_heavy_arm_on_small_rotors_is_simulated() -> None:
    heavy = Inertia(M=[1e-4, 1e-4], M2=[[0.02, 0.001], [0.001, 0.01]])
    records = planned_records(heavy, PAPER, [9.0], torque_Nm=[0.1, 0.1j], duration_s=0.5)
    made = simulate_experiment(planned_experiment(records, heavy, PAPER), heavy, PAPER)
    assert np.all(peaks(made)["torque", "simulated control"] < 1.0)


@pytest.mark.parametrize("seed", range(share(100)))
def test_no_file_of_a_random_plan_exceeds_a_limit(seed: int) -> None:
    found = outcome(random_trial(seed))
    assert found.fault == ""
    assert 0 < found.share <= 1


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"kind": "chirp"}, "sines, multisine, sweep"),
        ({"repeats": 0}, "repeats = 0"),
        ({"rest_s": 0.0}, "rest_s = 0"),
        ({"scale": -1.0}, "scale = -1"),
        ({"repeats": 100, "rest_s": 60.0}, "limit is 600 s"),
        ({"velocity_rad_s": [1, 2, 3]}, "3 values"),
    ],
)
def test_invalid_settings_are_refused(settings: dict[str, object], said: str) -> None:
    with pytest.raises(JointIdError, match=said):
        experiment(**settings)


def test_a_format_refuses_unsupported_motions() -> None:
    with pytest.raises(JointIdError, match="start angles of 6 axes"):
        set_points(simulated(), replace(WIDE, start_deg=START_DEG[:5], joint_names=()), "ur")
    with pytest.raises(JointIdError, match="possible intervals: 4 and 12 ms"):
        set_points(simulated(), WIDE, "rsi", interval_ms=2.0)
    with pytest.raises(JointIdError, match=r"23\.00 Hz has fewer than 5 .* up to 16\.66 Hz, or shorten"):
        set_points(simulated(), WIDE, "rsi", interval_ms=12.0)  # 16.67 Hz would be refused as well
    with pytest.raises(JointIdError, match="csv, ros2, ur, egm, rsi"):
        set_points(simulated(), WIDE, "krl")
    one = limits_from_toml(
        b"gear_ratio = 100\nstart_deg = 0\nlower_deg = -90\nupper_deg = 90\n"
        b"velocity_deg_s = 9\nacceleration_deg_s2 = 9\ntorque_Nm = 9",
        "one.toml",
    )
    with pytest.raises(JointIdError, match="experiment has 2 joints, but the limits are for 1 joint"):
        set_points(simulated(), one, "csv")


# ------------------------------------------------------------------------- limits as a file


def test_gears_that_contradict_the_study_are_refused() -> None:
    """Its set points would move the motors otherwise than planned."""
    study = Study(
        simulate_motion(PARALLELOGRAM, PAPER, Motion(duration_s=2.0), records=1), PARALLELOGRAM
    )
    WIDE.require_gears_of(study)
    WIDE.require_gears_of(replace(study, gear_ratio=RATIO * 1.0001))
    with pytest.raises(JointIdError, match="contradicts the study's"):
        WIDE.require_gears_of(replace(study, gear_ratio=-RATIO))
    toml = SIX_AXES.split("[[link]]")
    coupled = RobotModel.parse("two.toml", "[[link]]".join(toml[:3]).encode())
    C = coupled.coupling + 1e-3 * np.eye(2, k=-1)
    with pytest.raises(JointIdError, match="Gears couple axis 1 and axis 2"):
        WIDE.require_gears_of(replace(study, robot_model=replace(coupled, coupling=C)))


def test_limits_are_read_from_toml() -> None:
    read_back = limits_from_toml(TOML.encode(), "cell.toml")
    for name, value in vars(WIDE).items():
        assert np.array_equal(getattr(read_back, name), value), name


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("torque_Nm = 20\n", "", "torque_Nm is missing"),
        ("velocity_deg_s", "velocity_deg", 'Did you mean "velocity_deg_s"'),
        ("[100, -90]", "[100, 0]", "gear ratio is 0"),
        ("axes = [3, 5]", "axes = [3, 9]", r"axes = \[3.0, 9.0\] does not match"),
        ("axes = [3, 5]", "axes = [3, 3]", "one axis per joint"),
        ("axes = [3, 5]", "axes = [3, 4.5]", "does not match"),
        ("= 200", "= -200", "limits must be positive"),
        ("= [170, 60]", "= [170, -30]", "lowest position of joint 2"),
        ("= 4000", "= [1, 2, 3]", "3 values"),
    ],
)
def test_wrong_limits_are_named(old: str, new: str, said: str) -> None:
    assert old in TOML
    with pytest.raises(JointIdError, match=rf"(?s)cell\.toml.*{said}"):
        limits_from_toml(TOML.replace(old, new).encode(), "cell.toml")


# ------------------------------------------------------------------------- the command line


def test_the_command_writes_a_checked_file(
    sample_folder: Path, tmp_path: Path, studies: dict[int, Study]
) -> None:
    limits, output = tmp_path / "limits.toml", tmp_path / "cell.script"
    limits.write_text(TOML, "utf-8")
    command = ["setpoints", str(sample_folder / "paper.zip"), "--limits", str(limits), "-o", str(output)]
    command += ["--format", "ur", "--count", "1"]
    run = CliRunner().invoke(app, [*command, "--scale", "500"])
    assert run.exit_code == 1
    assert run.stdout == ""
    assert "Set the motion scale to" in run.stderr
    assert not output.exists()
    run = CliRunner().invoke(app, [*command, "--json"])
    assert run.exit_code == 0, run.stderr
    document = json.loads(run.stdout)
    assert len(document["check"]) == 10
    assert min(row["margin"] for row in document["check"]) > 0
    found = read("ur", output.read_text("utf-8"), START_DEG)
    assert found.time_s[-1] == pytest.approx(document["duration_s"], abs=0.002)
    assert studies[2].name in found.head
    assert CliRunner().invoke(app, [*command, "--kind", "sweep"]).exit_code == 1  # old name; it exists
    both = CliRunner().invoke(app, [*command, "--sines-as=sweep", "--motion", "sweep"])
    assert (both.exit_code, "--sines-as applies to" in both.stderr) == (2, True)
    assert "Margin" in CliRunner().invoke(app, [*command, "--overwrite"]).stdout


@pytest.mark.parametrize(("file_format", "interval_ms"), [("ur", 8), ("rsi", 12)])
def test_the_command_plans_no_faster_than_the_set_points(
    file_format: str,
    interval_ms: int,
    analyses: dict[int, Analysis],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """A controller that takes few set points a second runs the best plan of lower frequencies."""
    analysis, limits, output = analyses[2], tmp_path / "limits.toml", tmp_path / "cell.script"
    module = import_module("jointid.cli.plan")
    monkeypatch.setattr(module, "load_named", lambda path: analysis.study)
    monkeypatch.setattr(module, "analyse", lambda study, method: analysis)
    limits.write_text(TOML, "utf-8")
    command = ["setpoints", "paper", "--limits", str(limits), "-o", str(output), "--count", "1"]
    command += ["--format", file_format, "--interval-ms", str(interval_ms), "--duration-s", "1"]
    run = CliRunner().invoke(app, command)
    assert run.exit_code == 0, run.stderr
    found = re.search(r"record 1 \(([\d.]+) Hz\)", output.read_text("utf-8"))
    assert float(found[1]) <= round(200 / interval_ms, 2)
    assert max(record.frequency_hz for record in analysis.study.sine_records) > 200 / interval_ms


def test_the_command_writes_a_planned_motion_of_a_study_of_motions(tmp_path: Path) -> None:
    limits, output = tmp_path / "limits.toml", tmp_path / "cell.csv"
    limits.write_text(TOML, "utf-8")
    command = ["setpoints", "motions", "--limits", str(limits), "-o", str(output)]
    refused = CliRunner().invoke(app, command)
    assert "add --motion sweep" in refused.stderr
    run = CliRunner().invoke(app, [*command, "--motion", "multisine", "--count", "1"])
    assert run.exit_code == 0, run.stderr
    assert "multisine 1 (2 to 40 Hz): " in output.read_text("utf-8")


def test_an_answer_that_is_not_usable_gives_no_set_points(
    tmp_path: Path, studies: dict[int, Study]
) -> None:
    """The check of the limits plays on the identified robot, which would be a wrong one."""
    limits, output = tmp_path / "limits.toml", tmp_path / "cell.csv"
    limits.write_text(TOML, "utf-8")
    reversed_torque = [replace(record, tau_Nm=-record.tau_Nm) for record in studies[1].records]
    save_study(replace(studies[1], records=reversed_torque), tmp_path / "wrong.zip")
    command = ["setpoints", str(tmp_path / "wrong.zip"), "--limits", str(limits), "-o", str(output)]
    run = CliRunner().invoke(app, command)
    assert run.exit_code == 1
    assert "The sign of the torque" in run.stderr
    assert not output.exists()
