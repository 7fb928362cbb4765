"""Six axes with gravity and heavy friction: accuracy, findings and processor time of one analysis."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Measurement,
    MotorFriction,
    RobotModel,
    Study,
    analyse,
    simulate_records,
)

ROBOT = Path(__file__).parents[1] / "sample_data" / "six_axis_robot.toml"
POSE = np.deg2rad([0.0, -60.0, 100.0, 20.0, 40.0, 10.0])
JOINT_K = np.array([5.0e6, 7.5e6, 4.2e6, 1.3e6, 1.1e6, 0.4e6])
DAMPING_S = np.array([0.003, 0.003, 0.0025, 0.002, 0.002, 0.002])
FRICTION = MotorFriction(
    coulomb=[1.0, 1.2, 1.0, 0.35, 0.35, 0.3], viscous=[0.02, 0.02, 0.02, 0.004, 0.004, 0.004]
)


def main() -> None:
    robot = RobotModel.load(ROBOT)
    K = JOINT_K / robot.gear_ratio**2
    elasticity, inertia = Elasticity(K, DAMPING_S * K), robot.inertia(POSE)
    print("pattern          std   payload   K off %   D off %   K std %   D std %   CPU s   findings")
    for pattern in ("orthogonal", "one-at-a-time"):
        records = simulate_records(
            inertia,
            elasticity,
            np.geomspace(3, 40, 14),
            excitation=Excitation(pattern=pattern),
            controller=Controller(),
            friction=FRICTION,
            measurement=Measurement(position_noise_rad=1e-5, torque_noise_Nm=0.01),
        )
        for std, mass_std in ((0.0, 0.0), (0.05, 0.0), (0.0, 40.0)):
            carrying = robot.with_payload(mass_std=mass_std)
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
            fit, true = found.fit, np.concatenate([elasticity.K, elasticity.D])
            off = 100 * np.abs(fit.estimate / true - 1).reshape(2, 6).max(axis=1)
            sigma = 100 * (fit.standard_error / true).reshape(2, 6).max(axis=1)
            levels = [f"{f.level}: {f.title}" for f in found.findings if f.level != "good"]
            numbers = f"{off[0]:7.3f}   {off[1]:7.3f}   {sigma[0]:9.3f}   {sigma[1]:9.3f}   {spent:5.1f}"
            print(
                f"{pattern:15}  {std:.2f}   {mass_std:4.0f} kg   {numbers}   {'; '.join(levels)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
