"""Six axes with gravity and heavy friction: accuracy, findings and processor time of one analysis.

python -m benchmarks.six_axes [--quick]    or  python -m benchmarks six_axes
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.bound import impedance
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
    extract_phasors,
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


NOISE = Measurement(position_noise_rad=1e-5, torque_noise_Nm=0.01)
COLUMNS = {"records": "", "prior": ".2f", "payload σ, kg": ".0f", "error of payload, kg": ".0f",
           "error of K, %": ".3f", "error of D, %": ".3f", "σ of K, %": ".3f", "σ of D, %": ".3f",
           "noise part of σ of K, %": ".3f", "noise part of σ of D, %": ".3f",
           "CPU, s": ".1f", "findings": ""}  # fmt: skip
CASES = ((0.0, 0.0, 0.0), (0.05, 0.0, 0.0), (0.0, 40.0, 35.0), (0.05, 40.0, 35.0))
"""Prior of the inertias, standard deviation and error of the payload, kg."""
KINDS = {
    "orthogonal": (3.0, CASES),
    "orthogonal, low": (0.5, CASES[2:]),
    "one-at-a-time": (3.0, CASES),
    "one-at-a-time, slipping": (3.0, CASES[2:]),
    "axes 2 and 3": (3.0, CASES[2:]),
    "axes 1 and 5": (3.0, CASES[2:]),
    "axes 4 to 6": (3.0, CASES[2:]),
    "motions": (3.0, CASES[2:]),
}
"""Lowest frequency, Hz, and cases. Slipping: soft controllers and little friction hold the other joints,
so that these move in steps."""
MOVED = {"axes 2 and 3": [1, 2], "axes 1 and 5": [0, 4], "axes 4 to 6": [3, 4, 5]}
"""Joints that move, in as many records per frequency; friction holds the others. Errors are theirs."""
MOTION = Motion("random", 3.0, 40.0, 20.0, velocity_rad_s=30.0, acceleration_rad_s2=1000.0)
"""Its torques are about those of the sines; with the default limits the wrist sticks throughout."""


def records_of(
    kind: str, robot: RobotModel, lowest_hz: float, frequencies: int
) -> list[SineRecord] | list[MotionRecord]:
    """Sine records of a pattern, or six motions of 20 s."""
    K, slips = JOINT_K / robot.gear_ratio**2, "slipping" in kind
    pattern: Any = kind.split(",")[0]
    elasticity, inertia = Elasticity(K, DAMPING_S * K), robot.inertia(POSE)
    if kind == "motions":
        return list(
            simulate_motion(inertia, elasticity, MOTION, records=6, friction=FRICTION, measurement=NOISE)
        )
    if kind in MOVED:
        moved = MOVED[kind]
        waves = np.exp(2j * np.pi * np.outer(range(len(moved)), range(len(moved))) / len(moved))
        pattern = np.zeros((len(moved), robot.n), complex)
        pattern[:, moved] = waves
    return simulate_records(
        inertia,
        elasticity,
        np.geomspace(lowest_hz, 40, frequencies),
        excitation=Excitation(pattern=pattern, velocity_rad_s=20.0 if slips else 10.0),
        controller=Controller(bandwidth_hz=1.6, damping_ratio=1.0) if slips else Controller(),
        friction=replace(FRICTION, coulomb=0.3 * np.asarray(FRICTION.coulomb)) if slips else FRICTION,
        measurement=NOISE,
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
    moved = MOVED.get(kind, list(range(robot.n)))
    worst = [
        (100 * np.abs(part / true)).reshape(2, robot.n)[:, moved].max(axis=1)
        for part in (fit.estimate - true, fit.standard_error, fit.noise_error)
    ]
    levels = [f"{f.level}: {f.title}" for f in found.findings if f.level != "good"]
    figures = [kind, std, mass_std, off, *np.concatenate(worst).tolist(), spent, "; ".join(levels)]
    return dict(zip(COLUMNS, figures, strict=True))


def bound(records: list[SineRecord], robot: RobotModel) -> Table:
    """Cramér–Rao bound of K and D where friction is known but for its levels, by the motors' equations.

    The amplitudes of the motors are nuisance parameters.
    """
    phasors, inertia, n = extract_phasors(records), robot.inertia(POSE), robot.n
    s, q = 1j * phasors.omega, phasors.q[..., None]
    K, below = JOINT_K / robot.gear_ratio**2, np.tril_indices(n)
    truth = np.concatenate([K, DAMPING_S * K, inertia.M, inertia.M2[below]])
    own = np.sqrt(np.diag(inertia.M2))
    scale = np.maximum(np.abs(truth), np.append(np.zeros(3 * n), 0.1 * np.outer(own, own)[below]))

    def response(p: np.ndarray) -> np.ndarray:
        M2 = np.zeros((n, n))
        M2[below] = M2.T[below] = p[3 * n :]
        return impedance(s, p[2 * n : 3 * n], M2, p[:n], p[n : 2 * n])

    parts = [(response(truth + h) - response(truth - h)) @ q / 2e-5 for h in 1e-5 * np.diag(scale)]
    velocity = np.eye(n) * (s[:, None, None] * q)
    turns = np.divide(velocity, np.abs(velocity), out=0 * velocity, where=velocity != 0)
    J = np.concatenate([*parts, velocity, turns], axis=2)  # per relative change; friction last
    Z, samples = response(truth), np.array([len(record.time_s) for record in records])
    angle, torque = NOISE.position_noise_rad**2, NOISE.torque_noise_Nm**2
    C = 4 / samples[:, None, None] * (torque * np.eye(n) + angle * Z @ Z.conj().swapaxes(1, 2))
    information = 2 * np.einsum("rak,ral->kl", J.conj(), np.linalg.solve(C, J)).real
    rows = []
    for std in (1e-6, 0.05, np.inf):
        prior = np.zeros(len(information))
        prior[2 * n : truth.size] = std**-2
        least = 100 * np.sqrt(np.diag(np.linalg.inv(information + np.diag(prior)))[: 2 * n])
        rows.append(
            {"prior": std} | {f"{k}{j + 1} %": least[n * (k == "D") + j] for k in "KD" for j in range(n)}
        )
    return Table("six_axes", "Cramér–Rao bound", dict.fromkeys(rows[0], ".3f"), tuple(rows))


def measure(quick: bool) -> Iterator[Table]:
    """Return one table for each kind of records."""
    robot = RobotModel.load(ROBOT)
    for kind, (lowest_hz, cases) in KINDS.items():
        if quick and kind != "orthogonal":
            continue
        records = records_of(kind, robot, lowest_hz, 6 if quick else 14)
        if kind == "orthogonal":
            yield bound(records, robot)
        cases = cases[:1] if quick else cases
        rows = tuple(row(kind, records, robot, *case) for case in cases)
        yield Table("six_axes", f"Six axes with friction, from {lowest_hz:g} Hz: {kind}", COLUMNS, rows)


if __name__ == "__main__":
    for each in measure("--quick" in sys.argv):
        print(each.markdown(), flush=True)
