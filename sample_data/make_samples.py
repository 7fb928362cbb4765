"""Make the sample studies beside this file, each from the simulated robot with a fixed seed.

    python sample_data/make_samples.py

Motor angles are rounded to 1e-7 rad and torques to 1e-5 N·m, far below encoder step and noise, so that
the files stay small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TypeVar

import numpy as np

from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Inertia,
    Measurement,
    Motion,
    MotionRecord,
    MotorFriction,
    RobotModel,
    SineRecord,
    Study,
    analyse,
    save_study,
    simulate_motion,
    simulate_records,
)
from jointid.fleet.row import Row, row_of
from jointid.fleet.table import to_parquet

Record = TypeVar("Record", SineRecord, MotionRecord)
HERE = Path(__file__).parent
CUTTING_POSE = Inertia(M=[0.0025, 0.0010], M2=[[0.004104, 0.000395], [0.000395, 0.001889]])
PAPER = Elasticity(K=[43.0, 7.5], D=[0.10, 0.015])
HALF_AND_QUARTER_TURN = np.array([[0.5, -1j], [0.5, 1j]])
"""Joint 2 moves with full amplitude, joint 1 with half, a quarter period before or after: both always
move, and the controller of the other joint shows in a single record."""


def paper() -> Study:
    """Two coupled joints in the cutting pose, light friction."""
    records = simulate_records(
        CUTTING_POSE,
        PAPER,
        np.geomspace(3.0, 30.0, 18).round(2),
        excitation=Excitation(pattern=HALF_AND_QUARTER_TURN, velocity_rad_s=8.0, periods=12.5),
        controller=Controller(bandwidth_hz=12.0, feedforward=False, sample_rate_hz=2000.0),
        friction=MotorFriction(coulomb=[0.05, 0.012], viscous=[0.002, 0.0005]),
        measurement=Measurement(encoder_counts=65536, torque_noise_Nm=[0.02, 0.01]),
        seed=1,
    )
    return Study(
        name="Waterjet cell, axes 1 and 2",
        origin="simulated",
        description="The paper's case: K = 43.0 and 7.5 N·m/rad, D = 0.10 and 0.015 N·m·s/rad, with "
        "light friction, an encoder of 65,536 counts per turn and torque noise. The inertias are "
        "assumed: the paper states none.",
        records=_compact(records),
        inertia=CUTTING_POSE,
        nominal=Elasticity(K=[20.0, 3.5], D=[0.10, 0.015]),
    )


def heavy_friction() -> Study:
    """The same robot, worn, with a logger that does not state when the torque acts."""
    records = simulate_records(
        CUTTING_POSE,
        PAPER,
        np.geomspace(3.0, 30.0, 12).round(2),
        excitation=Excitation(velocity_rad_s=8.0, periods=12.5),
        controller=Controller(bandwidth_hz=8.0, sample_rate_hz=2000.0, torque_delay_s=0.0015),
        friction=MotorFriction(coulomb=[0.4, 0.08], viscous=[0.002, 0.0005]),
        measurement=Measurement(encoder_counts=65536, torque_noise_Nm=[0.02, 0.01]),
        declare_timing=False,
        seed=2,
    )
    return Study(
        name="Worn cell: heavy friction, torque lag not stated",
        origin="simulated",
        description="The robot of the sample paper with 0.4 and 0.08 N·m of Coulomb friction and a "
        "torque lag of 1.5 ms plus half a sample of hold, which the log does not state.",
        records=_compact(records),
        inertia=CUTTING_POSE,
        nominal=Elasticity(K=[20.0, 3.5], D=[0.10, 0.015]),
    )


def single_joint() -> Study:
    """One joint without friction."""
    inertia, elasticity = Inertia(M=[0.003], M2=[[0.005]]), Elasticity(K=[30.0], D=[0.05])
    records = simulate_records(
        inertia,
        elasticity,
        [4.0, 7.0, 11.0, 15.0, 18.0, 21.0, 25.0, 30.0],
        excitation=Excitation(velocity_rad_s=6.0, duration_s=1.5),
        controller=Controller(sample_rate_hz=1000.0),
        measurement=Measurement(torque_noise_Nm=0.005, position_noise_rad=2e-6),
        seed=3,
    )
    return Study(
        name="Single joint, clean",
        origin="simulated",
        description="One joint without friction: K = 30 N·m/rad, D = 0.05 N·m·s/rad.",
        records=_compact(records),
        inertia=inertia,
        nominal=Elasticity(K=[25.0], D=[0.05]),
    )


def manutec_r3() -> Study:
    """Two joints whose coupling inertia is nearly as large as it can be."""
    inertia = Inertia(M=[0.0013, 0.0013], M2=[[0.002274, 0.003522], [0.003522, 0.007068]])
    elasticity = Elasticity(K=[8.0, 58.0], D=[0.01, 0.04])
    records = simulate_records(
        inertia,
        elasticity,
        np.geomspace(4.0, 55.0, 16).round(2),
        excitation=Excitation(velocity_rad_s=8.0, periods=14.5),
        controller=Controller(sample_rate_hz=2000.0),
        friction=MotorFriction(coulomb=[0.03, 0.03]),
        measurement=Measurement(encoder_counts=65536, torque_noise_Nm=0.02),
        seed=4,
    )
    return Study(
        name="Manutec r3, axes 2 and 3, strongly coupled",
        origin="simulated",
        description="Inertias with 15 kg load and stretched arm, K = 8 and 58 N·m/rad and D = 0.01 and "
        "0.04 N·m·s/rad as published with the Modelica Standard Library; light friction.",
        records=_compact(records),
        inertia=inertia,
        nominal=Elasticity(K=[10.0, 50.0], D=[0.01, 0.04]),
    )


def motions() -> Study:
    """The paper's robot without sines: a sweep and random motion of a few seconds."""
    records = [
        record
        for kind in ("sweep", "random")
        for record in simulate_motion(
            CUTTING_POSE,
            PAPER,
            Motion(kind, from_hz=2.0, to_hz=35.0, duration_s=8.0),
            records=1,
            controller=Controller(bandwidth_hz=8.0, sample_rate_hz=500.0),
            friction=MotorFriction(coulomb=[0.05, 0.012], viscous=[0.002, 0.0005]),
            measurement=Measurement(encoder_counts=65536, torque_noise_Nm=[0.02, 0.01]),
            seed=5,
        )
    ]
    return Study(
        name="Waterjet cell in motion: sweep and random",
        origin="simulated",
        description="The paper's case without sines: two records of 8 s, a sweep and random motion. "
        "K = 43.0 and 7.5 N·m/rad, D = 0.10 and 0.015 N·m·s/rad, with light friction.",
        records=_compact(records),
        inertia=CUTTING_POSE,
        nominal=Elasticity(K=[20.0, 3.5], D=[0.10, 0.015]),
    )


def six_axes() -> Study:
    """A heavy robot by its joint angles, under gravity; every joint moves in every record."""
    robot = RobotModel.load(HERE / "six_axis_robot.toml")
    poses = {"": np.deg2rad([0.0, -60.0, 100.0, 20.0, 40.0, 10.0])}
    inertia, N2 = robot.inertia(poses[""]), robot.gear_ratio**2
    K = np.array([5.0e6, 7.5e6, 4.2e6, 1.3e6, 1.1e6, 0.4e6]) / N2
    elasticity = Elasticity(K, np.array([0.003, 0.003, 0.0025, 0.002, 0.002, 0.002]) * K)
    records = simulate_records(
        inertia,
        elasticity,
        np.geomspace(5.0, 60.0, 8).round(2),
        excitation=Excitation(velocity_rad_s=12.0, periods=8.5),
        controller=Controller(bandwidth_hz=8.0, sample_rate_hz=1000.0),
        friction=MotorFriction(coulomb=[0.2, 0.25, 0.2, 0.05, 0.05, 0.05], viscous=0.002),
        measurement=Measurement(encoder_counts=1 << 20, torque_noise_Nm=0.01),
        seed=5,
    )
    return Study(
        name="Six axes of a heavy robot, from its own model",
        origin="simulated",
        description="An invented robot, given by its Denavit–Hartenberg parameters and joint angles, "
        "under gravity. At the joints K = 5.0, 7.5, 4.2, 1.3, 1.1 and 0.4 million N·m/rad; the nominal "
        "K is 30 % lower, the nominal D exact.",
        records=_compact(records),
        inertia=inertia,
        nominal=Elasticity(0.7 * elasticity.K, elasticity.D),
        robot_model=robot,
        pose_angles_rad=poses,
    )


def exercise_1() -> Study:
    """The torque columns of the joints exchanged: what a failed study shows."""
    return _faulty(1, [replace(r, tau_Nm=r.tau_Nm[:, ::-1]) for r in _short_records()])


def exercise_2() -> Study:
    """A record twice: what an answer that is usable with care shows."""
    records = _short_records()
    return _faulty(2, [*records, replace(records[0], label="4.00 Hz, record 3")])


def _faulty(number: int, records: Sequence[SineRecord]) -> Study:
    name = f"Exercise {number}: a log with a fault"
    description = "The paper's robot. The page Study names the fault and offers the correction."
    nominal = Elasticity(K=[20.0, 3.5], D=[0.10, 0.015])
    given = {"origin": "simulated", "inertia": CUTTING_POSE, "nominal": nominal}
    return Study(name=name, description=description, records=_compact(records), **given)


def _short_records() -> list[SineRecord]:
    return simulate_records(
        CUTTING_POSE,
        PAPER,
        np.geomspace(4.0, 28.0, 6).round(2),
        excitation=Excitation(velocity_rad_s=8.0, duration_s=1.5),
        controller=Controller(bandwidth_hz=8.0, sample_rate_hz=1000.0),
        friction=MotorFriction(coulomb=[0.05, 0.012]),
        measurement=Measurement(encoder_counts=65536, torque_noise_Nm=[0.02, 0.01]),
        seed=6,
    )


def fleet() -> list[Row]:
    """Five measurements of each of eight equal robots; one is soft, one loses 4 % of K1 a year."""
    rng, rows = np.random.default_rng(7), []
    for robot in range(8):
        own = rng.normal(1.0, 0.02, 4)
        own[0] -= 0.25 * (robot == 5)
        for year in range(5):
            worn = np.array([1 - 0.04 * year * (robot == 2), 1, 1, 1])
            K, D = np.split(np.concatenate([PAPER.K, PAPER.D]) * own * worn, 2)
            records = simulate_records(
                CUTTING_POSE,
                Elasticity(K, D),
                np.geomspace(4.0, 28.0, 6).round(2),
                excitation=Excitation(velocity_rad_s=8.0, duration_s=1.5),
                controller=Controller(bandwidth_hz=8.0, sample_rate_hz=1000.0),
                friction=MotorFriction(coulomb=[0.05, 0.012]),
                measurement=Measurement(encoder_counts=65536, torque_noise_Nm=[0.3, 0.1]),
                seed=100 + 10 * robot + year,
            )
            study = Study(
                name=f"Cell {robot + 1}, {2021 + year}",
                origin="simulated",
                robot=f"cell {robot + 1}",
                date=date(2021 + year, 3, 1 + robot),
                records=_compact(records),
                inertia=CUTTING_POSE,
            )
            rows.append(row_of(analyse(study), study=f"cell_{robot + 1}_{2021 + year}.zip"))
    return rows


def _compact(records: Sequence[Record]) -> list[Record]:
    return [
        replace(r, theta_rad=r.theta_rad.round(7), tau_Nm=r.tau_Nm.round(5), time_s=r.time_s.round(9))
        for r in records
    ]


if __name__ == "__main__":
    for name, study in [
        ("paper.zip", paper()),
        ("single_joint", single_joint()),
        ("manutec_r3.zip", manutec_r3()),
        ("worn_cell.zip", heavy_friction()),
        ("motions.zip", motions()),
        ("six_axes.zip", six_axes()),
        ("exercise_1.zip", exercise_1()),
        ("exercise_2.zip", exercise_2()),
    ]:
        save_study(study, HERE / name, overwrite=True)
        print(f"{name}: {len(study.records)} records")
    (HERE / "fleet.parquet").write_bytes(to_parquet(fleet()))
