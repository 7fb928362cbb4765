"""Six axes with gravity and heavy friction: accuracy, findings and processor time of one analysis.

python -m benchmarks.six_axes [--quick]    or  python -m benchmarks six_axes
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.harness import Table
from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Measurement,
    Motion,
    MotionRecord,
    MotorFriction,
    RobotModel,
    SineRecord,
    Study,
    analyse,
    simulate_motion,
    simulate_records,
)

ROBOT = Path(__file__).parents[1] / "sample_data" / "six_axis_robot.toml"
POSE = np.deg2rad([0.0, -60.0, 100.0, 20.0, 40.0, 10.0])
JOINT_K = np.array([5.0e6, 7.5e6, 4.2e6, 1.3e6, 1.1e6, 0.4e6])
DAMPING_S = np.array([0.003, 0.003, 0.0025, 0.002, 0.002, 0.002])
FRICTION = MotorFriction(
    coulomb=[1.0, 1.2, 1.0, 0.35, 0.35, 0.3], viscous=[0.02, 0.02, 0.02, 0.004, 0.004, 0.004]
)


COLUMNS = {"records": "", "prior": ".2f", "payload σ, kg": ".0f", "payload off, kg": ".0f",
           "K off %": ".3f", "D off %": ".3f", "K σ %": ".3f", "D σ %": ".3f",
           "noise alone: K %": ".3f", "D %": ".3f", "CPU s": ".1f", "findings": ""}  # fmt: skip
CASES = ((0.0, 0.0, 0.0), (0.05, 0.0, 0.0), (0.0, 40.0, 35.0), (0.05, 40.0, 35.0))
"""Prior of the inertias, standard deviation and error of the payload, kg."""
KINDS = {
    "orthogonal": (3.0, CASES),
    "orthogonal, low": (0.5, CASES[2:]),
    "one-at-a-time": (3.0, CASES),
    "motions": (3.0, CASES[2:3]),
}
"""Lowest frequency, Hz, and cases."""
MOTION = Motion("random", 3.0, 40.0, 20.0, velocity_rad_s=30.0, acceleration_rad_s2=1000.0)
"""Its torques are about those of the sines; with the default limits the wrist sticks throughout."""


def records_of(
    kind: str, robot: RobotModel, lowest_hz: float, frequencies: int
) -> list[SineRecord] | list[MotionRecord]:
    """Sine records of a pattern, or six motions of 20 s."""
    K = JOINT_K / robot.gear_ratio**2
    elasticity, inertia = Elasticity(K, DAMPING_S * K), robot.inertia(POSE)
    noise = Measurement(position_noise_rad=1e-5, torque_noise_Nm=0.01)
    if kind == "motions":
        return list(
            simulate_motion(inertia, elasticity, MOTION, records=6, friction=FRICTION, measurement=noise)
        )
    return simulate_records(
        inertia,
        elasticity,
        np.geomspace(lowest_hz, 40, frequencies),
        excitation=Excitation(pattern=kind.split(",")[0]),
        controller=Controller(),
        friction=FRICTION,
        measurement=noise,
    )


def row(
    kind: str, records: Any, robot: RobotModel, std: float, mass_std: float, off: float
) -> dict[str, Any]:
    """Accuracy, findings and processor time of one analysis.

    python -m benchmarks.six_axes [--quick]    or  python -m benchmarks six_axes
    """
    carrying = robot.with_payload(mass=robot.payload.mass + off, mass_std=mass_std)
    study = Study(
        records,
        carrying.inertia(POSE),
        robot_model=carrying,
        pose_angles_rad={"": POSE},
        inertia_std=std,
    )
    with threadpool_limits(1):
        begin = time.process_time()
        found = analyse(study)
        spent = time.process_time() - begin
    K = JOINT_K / robot.gear_ratio**2
    fit, true = found.fit, np.concatenate([K, DAMPING_S * K])
    worst = [
        (100 * np.abs(part / true)).reshape(2, 6).max(axis=1)
        for part in (fit.estimate - true, fit.standard_error, fit.noise_error)
    ]
    levels = [f"{f.level}: {f.title}" for f in found.findings if f.level != "good"]
    figures = [kind, std, mass_std, off, *np.concatenate(worst).tolist(), spent, "; ".join(levels)]
    return dict(zip(COLUMNS, figures, strict=True))


def measure(quick: bool) -> Iterator[Table]:
    """Return one table for each kind of records."""
    robot = RobotModel.load(ROBOT)
    for kind, (lowest_hz, cases) in KINDS.items():
        if quick and kind != "orthogonal":
            continue
        records = records_of(kind, robot, lowest_hz, 6 if quick else 14)
        cases = cases[:1] if quick else cases
        rows = tuple(row(kind, records, robot, *case) for case in cases)
        yield Table("six_axes", f"Six axes with friction, from {lowest_hz:g} Hz: {kind}", COLUMNS, rows)


if __name__ == "__main__":
    for each in measure("--quick" in sys.argv):
        print(each.markdown(), flush=True)
