"""Readers of set-point files, written from the descriptions of the formats, and random experiments."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import lsim

from jointid import Elasticity, Inertia, JointIdError, MotorFriction, RobotModel
from jointid.arrays import Floats
from jointid.setpoints.experiment import Experiment
from jointid.setpoints.file_format import SetPoints
from jointid.setpoints.files import set_points
from jointid.setpoints.from_plan import KINDS, planned_experiment
from jointid.setpoints.robot_limits import RobotLimits
from jointid.setpoints.simulated_experiment import SimulatedExperiment, simulate_experiment
from jointid.uncertainty.planned_records import PlannedRecords, planned_records

SIX = RobotModel.load(Path(__file__).parents[1] / "sample_data" / "six_axis_robot.toml")
NUMBER = r"[-+]?\d+\.\d+"


class File(NamedTuple):
    """A file as a controller would read it."""

    head: str
    time_s: Floats
    position_deg: Floats
    """Of all axes, (N, m)."""


def read(name: str, text: str, start_deg: Floats) -> File:
    """Read a file by the rules of its format; it must be ASCII and begin with its head."""
    lines = text.encode("ascii").decode().split("\n")
    count = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    body = lines[count:]
    time, values = {"ros2": _ros2, "ur": _urscript}.get(name, _table)(body)
    if name == "ros2":  # from where it is
        time, values = np.r_[0.0, time], np.vstack([np.radians(start_deg), values])
    if name == "rsi":
        values = values + start_deg
    if name not in ("egm", "rsi"):
        values = np.degrees(values)
    return File("\n".join(lines[:count]), time, values)


def _table(lines: list[str]) -> tuple[Floats, Floats]:
    header, *rows = list(csv.reader(line for line in lines if line))
    assert header[1] == "time_ms"
    numbers = np.array([[float(cell) for cell in row] for row in rows])
    assert np.array_equal(numbers[:, 0], np.arange(len(rows)))
    return numbers[:, 1] / 1e3, numbers[:, 2:]


def _ros2(lines: list[str]) -> tuple[Floats, Floats]:
    assert lines[0].startswith("header:")
    assert lines[1].startswith("joint_names: [")
    assert lines[2] == "points:"
    times, points = [], []
    for line in filter(None, lines[3:]):
        lists = re.findall(r"(\w+): \[([^]]*)\]", line)
        assert [key for key, _ in lists] == ["positions", "velocities", "accelerations"]
        seconds, nanoseconds = re.findall(r"sec: (\d+)", line)
        times.append(int(seconds) + 1e-9 * int(nanoseconds))
        points.append([float(value) for value in lists[0][1].split(",")])
    return np.array(times), np.array(points)


def _urscript(lines: list[str]) -> tuple[Floats, Floats]:
    """Follow the script: a helper ``s`` calls servoj, each for one interval."""
    script = "\n".join(lines)
    assert re.match(r"def jointid_experiment\(\):\n", script)
    assert script.rstrip().endswith("stopj(2.0)\nend")
    names = re.search(r"def s\(([^)]*)\):", script)[1].split(", ")
    target, step = re.search(r"servoj\(\[([^]]*)\], 0, 0, ([\d.]+), 0.03, 1000\)", script).groups()
    rows = []
    for call in re.findall(rf"^  s\(((?:{NUMBER}(?:, )?)+)\)$", script, re.MULTILINE):
        given = dict(zip(names, call.split(", "), strict=True))
        rows.append([float(given.get(axis, axis)) for axis in target.split(", ")])
    return float(step) * np.arange(len(rows)), np.array(rows)


class Trial(NamedTuple):
    """A random experiment for a random robot in a random format."""

    plan: PlannedRecords
    inertia: Inertia
    elasticity: Elasticity
    settings: dict[str, object]
    robot: RobotLimits
    file_format: str
    friction: MotorFriction

    def experiment(self, scale: float) -> Experiment:
        return planned_experiment(self.plan, self.inertia, self.elasticity, scale=scale, **self.settings)

    def simulated(self, scale: float) -> SimulatedExperiment:
        return simulate_experiment(
            self.experiment(scale), self.inertia, self.elasticity, friction=self.friction
        )

    def points(self, scale: float) -> SetPoints:
        return set_points(self.simulated(scale), self.robot, self.file_format)


def random_trial(seed: int) -> Trial:
    """Up to three joints, or a robot of six in a random pose; limits that many plans exceed."""
    rng = np.random.default_rng([seed, 14])
    n = int(rng.choice([1, 2, 3, 6]))
    elasticity = Elasticity(K=rng.uniform(8, 60, n), D=rng.uniform(0.01, 0.1, n))
    if n == 6:
        inertia = replace(SIX.inertia(rng.uniform(-1, 1, n)), shared=None, shared_gravity=None)
    else:
        root = rng.normal(size=(n, n))
        M2 = root @ root.T / n + 0.5 * np.eye(n)
        inertia = Inertia(M=rng.uniform(5e-4, 3e-3, n), M2=3e-3 * M2)
    count = 2
    frequency = 10 ** rng.uniform(1.2, 1.6, count)
    torque = rng.normal(size=(count, n)) + 1j * rng.normal(size=(count, n))
    plan = planned_records(inertia, elasticity, frequency, torque_Nm=torque, duration_s=0.1)
    kind = str(rng.choice(KINDS))
    if frequency.max() < 1.3 * frequency.min():
        kind = "sines"
    ratio = SIX.gear_ratio if n == 6 else rng.uniform(40, 180, n) * rng.choice([-1, 1], n)
    drift = rng.uniform(-0.5, 0.5, n) * (rng.random() < 0.2)
    settings = {
        "kind": kind,
        "ramp_s": float(rng.uniform(0.05, 0.15)),
        "rest_s": float(rng.uniform(0.02, 0.15)),
        "repeats": int(rng.random() < 0.05) + 1,
        "velocity_rad_s": drift,
    }
    start, room = rng.uniform(-90, 90, 6), 10 ** (0.08 * (n - 1))
    moving = start[:n]
    robot = RobotLimits(
        gear_ratio=ratio,
        start_deg=start,
        lower_deg=moving - room * 10 ** rng.uniform(-1.0, 1.5, n),
        upper_deg=moving + room * 10 ** rng.uniform(-1.0, 1.5, n),
        velocity_deg_s=room * 10 ** rng.uniform(0.5, 2.5, n),
        acceleration_deg_s2=room * 10 ** rng.uniform(2.5, 4.5, n),
        torque_Nm=room * 10 ** rng.uniform(-0.2, 1.5, n),
    )
    coulomb = rng.uniform(0, 0.1, n) * (rng.random() < 0.2)
    file_format = str(rng.choice(["csv", "ros2", "ur", "egm", "rsi"]))
    return Trial(plan, inertia, elasticity, settings, robot, file_format, MotorFriction(coulomb))


class Outcome(NamedTuple):
    """Outcome of a random trial."""

    refused: bool
    """At scale 1."""
    fault: str
    """Limit that a written file exceeds, or another fault; empty when all is well."""
    share: float
    """Largest share of a limit that a written file uses."""


def outcome(trial: Trial) -> Outcome:
    """Write a trial, at the scale that the refusal names if need be, and measure the file."""
    scale, refused = 1.0, False
    checked = trial.points(scale)
    try:
        text = checked.text()
    except JointIdError as error:
        refused = True
        found = re.search(r"Set the motion scale to ([\d.e+-]+) ", str(error))
        if not found:
            return Outcome(True, f"no scale in: {error}", 0.0)
        checked = trial.points(float(found[1]))
        try:
            text = checked.text()
        except JointIdError as again:
            return Outcome(True, f"refused again: {again}", 0.0)
    file = read(trial.file_format, text, trial.robot.start_deg)
    shares = limit_shares(file, trial.robot) | {"torque": torque_share(file, trial)}
    worst = max(shares, key=lambda name: shares[name])
    beyond = shares[worst] > 1 + 1e-9
    return Outcome(refused, f"{worst}: {shares[worst]:.9f}" if beyond else "", shares[worst])


def limit_shares(file: File, robot: RobotLimits) -> dict[str, float]:
    """Share of each limit that the differences of a file use; infinite where a held axis moves."""
    n = robot.gear_ratio.size
    step = file.time_s[1]
    assert np.allclose(np.diff(file.time_s), step, atol=1e-9)
    q, held = file.position_deg[:, :n], file.position_deg[:, n:]
    ends = np.abs(file.position_deg[[0, -1]] - robot.start_deg).max()
    still = max(np.abs(np.diff(held, axis=0)).max(initial=0), ends)
    middle, half = (robot.upper_deg + robot.lower_deg) / 2, (robot.upper_deg - robot.lower_deg) / 2
    return {
        "position": float((np.abs(q - middle) / half).max()),
        "velocity": float((np.abs(np.diff(q, axis=0)) / step / robot.velocity_deg_s).max()),
        "acceleration": float(
            (np.abs(np.diff(q, 2, axis=0)) / step**2 / robot.acceleration_deg_s2).max()
        ),
        "held axes and ends": 0.0 if still < 1e-6 else np.inf,
    }


def torque_share(file: File, trial: Trial) -> float:
    """Largest share of a torque limit that motors need to follow a file; 1 % is left to interpolation.

    Equation (1) on a spline through the set points, in steps of 0.2 ms.
    """
    (K, D), M2, n = (trial.elasticity.K, trial.elasticity.D), trial.inertia.M2, trial.inertia.n
    moved = np.radians(file.position_deg[:, :n] - trial.robot.start_deg[:n]) * trial.robot.gear_ratio
    curve, time = make_interp_spline(file.time_s, moved, k=5), np.arange(0, file.time_s[-1], 2e-4)
    angle, velocity, acceleration = (curve(time, order) for order in range(3))
    springs, gravity = np.hstack([np.diag(K), np.diag(D)]), np.zeros((n, 2 * n))
    gravity[:, :n] = np.broadcast_to(trial.inertia.gravity, (n, n))
    drive = np.linalg.solve(M2, springs)
    A = np.vstack([np.eye(2 * n)[n:], -np.linalg.solve(M2, springs + gravity)])
    B = np.vstack([np.zeros((n, 2 * n)), drive])
    arm = lsim((A, B, np.eye(2 * n), 0 * B), np.hstack([angle, velocity]), time)[1]
    torque = trial.inertia.M * acceleration + K * (angle - arm[:, :n]) + D * (velocity - arm[:, n:])
    torque += trial.friction.coulomb * np.sign(velocity)
    return float((np.abs(torque) / trial.robot.torque_Nm).max() / 1.01)
