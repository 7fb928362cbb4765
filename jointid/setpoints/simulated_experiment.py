"""An experiment on the simulated robot: the motion of motors and arm, and the torques."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from jointid.arrays import Floats, per_joint
from jointid.joints import Elasticity, Inertia
from jointid.setpoints.experiment import Experiment, Motion
from jointid.simulation.experiment import Controller, Measurement, MotorFriction
from jointid.simulation.motion import SampledReference
from jointid.simulation.robot import Robot

_RATE_HZ, _SAMPLES_PER_PERIOD = (2000.0, 20_000.0), 40
"""Lowest and highest rate of the simulated control, and samples per period of the motion."""
_DAMPING_STEP = 0.3
"""Share of a rotor's velocity that the control removes within a sample; above 1 it is unstable."""
BANDWIDTH_HZ = 10.0
"""Default bandwidth of the simulated control."""


class Peaks(NamedTuple):
    """Lowest and highest values of a quantity, shape (2, n), and their times."""

    quantity: str
    """Position, velocity, acceleration or torque."""
    source: str
    values: Floats
    time_s: Floats

    @classmethod
    def of(cls, quantity: str, source: str, time: Floats, values: Floats) -> Peaks:
        """Find the peaks of a series (N, n)."""
        at = np.array([values.argmin(axis=0), values.argmax(axis=0)])
        return cls(quantity, source, np.take_along_axis(values, at, axis=0), time[at])


@dataclass(frozen=True, eq=False)
class SimulatedExperiment:
    """An experiment on two simulated robots, motor side.

    One follows the set points exactly and needs the torque that the motion needs, whatever its
    controller. The other has sampled position and velocity control with feedforward of the rigid robot.
    """

    experiment: Experiment
    elasticity: Elasticity
    coulomb_Nm: Floats
    """Coulomb friction of the motors, shape (n,)."""
    load_friction: Floats
    """Share of the torque through the gears that is friction, shape (n,)."""
    time_s: Floats
    theta_rad: Floats
    """Motor angles under simulated control, the log of the experiment with ``tau_Nm``, (N, n)."""
    tau_Nm: Floats
    peaks: tuple[Peaks, ...]
    """Peaks of the motion of motors and arm, and of torques, on both robots, motor side."""


def simulate_experiment(
    experiment: Experiment,
    inertia: Inertia,
    elasticity: Elasticity,
    *,
    friction: MotorFriction | None = None,
) -> SimulatedExperiment:
    """Run an experiment on the simulated robot, equation (1): one pose, gravity as a stiffness.

    Raises JointIdError when the joints disagree or the closed loop is unstable.
    """
    friction = friction or MotorFriction()
    coulomb, viscous, load, on_arm = (
        per_joint(name, getattr(friction, name), inertia.n)
        for name in ("coulomb", "viscous", "load", "arm_viscous")
    )
    ratio = float(np.max(1 + np.diag(inertia.M2) / inertia.M))
    steady_hz = min(2 * np.pi * BANDWIDTH_HZ * ratio / _DAMPING_STEP, _RATE_HZ[1])
    rate = max(_RATE_HZ[0], _SAMPLES_PER_PERIOD * experiment.highest_hz, steady_hz)
    controller = Controller(sample_rate_hz=rate, bandwidth_hz=BANDWIDTH_HZ)
    robot = Robot(inertia, elasticity, controller, replace(friction, step_s=1 / rate))
    time = np.arange(int(np.ceil(experiment.duration_s * rate)) + 1) / rate
    exact = experiment.motion(time)
    position = np.pad(exact.position, ((1, 1), (0, 0)), mode="edge")[..., None]
    reference = SampledReference(1 / rate, position, first=-1)
    theta, tau = (log[:, :, 0] for log in robot.run(reference, 0, time.size, Measurement(), 0, None))
    acceleration = np.zeros_like(theta)
    acceleration[1:-1] = np.diff(theta, 2, axis=0) * rate**2
    controlled = Motion(theta, np.asarray(np.gradient(theta, 1 / rate, axis=0)), acceleration)
    peaks = [Peaks.of("torque", "simulated control", time, tau)]
    for way, motors in (("exact following", exact), ("simulated control", controlled)):
        arm, spring = _arm(motors, inertia, elasticity, on_arm, 1 / rate)
        # Friction makes the motors' accelerations jump: those are the arm's.
        for part, motion, count in (("motor", motors, 2), ("arm", arm, 3)):
            for quantity, values in list(motion._asdict().items())[:count]:
                peaks.append(Peaks.of(quantity, f"{part}, {way}", time, values))
        if motors is exact:
            loss_Nm = (coulomb + load * np.abs(spring)) * np.sign(exact.velocity)
            loss_Nm += viscous * exact.velocity
            torque = inertia.M * exact.acceleration + spring + loss_Nm
            peaks.append(Peaks.of("torque", way, time, torque))
    return SimulatedExperiment(experiment, elasticity, coulomb, load, time, theta, tau, tuple(peaks))


def _arm(
    motors: Motion, inertia: Inertia, elasticity: Elasticity, viscous: Floats, step_s: float
) -> tuple[Motion, Floats]:
    """Motion of the arm and torque of the springs for a given motion of the motors.

    With the deflection x = θ − θ_a: ẍ = θ̈ − M2⁻¹(K x + D ẋ − G θ_a − F θ̇_a), with the stiffness G of
    gravity and friction F (n,), exact for accelerations that are linear between the samples.
    """
    n = inertia.n
    springs = np.hstack([np.diag(elasticity.K), np.diag(elasticity.D)])
    holding = np.hstack([np.broadcast_to(inertia.gravity, (n, n)), np.diag(viscous)])
    system = np.zeros((6 * n, 6 * n))  # θ, θ̇, x, ẋ, θ̈ and its change over a step
    system[:n, n : 2 * n] = system[2 * n : 3 * n, 3 * n : 4 * n] = np.eye(n)
    system[n : 2 * n, 4 * n : 5 * n] = system[3 * n : 4 * n, 4 * n : 5 * n] = np.eye(n)
    system[4 * n : 5 * n, 5 * n :] = np.eye(n) / step_s
    system[3 * n : 4 * n, : 4 * n] = np.linalg.solve(
        inertia.M2, np.hstack([holding, -springs - holding])
    )
    advance = expm(system * step_s)[2 * n : 4 * n]
    A = advance[:, 2 * n : 4 * n]
    moved = np.hstack([motors.position, motors.velocity])
    drive = moved[:-1] @ advance[:, : 2 * n].T
    drive += motors.acceleration[:-1] @ advance[:, 4 * n : 5 * n].T
    drive += np.diff(motors.acceleration, axis=0) @ advance[:, 5 * n :].T
    x = np.zeros((len(drive) + 1, 2 * n))
    for before, after, forced in zip(x, x[1:], drive, strict=False):
        np.add(np.dot(A, before, out=after), forced, out=after)
    spring = x @ springs.T
    on_arm = spring - (moved - x) @ holding.T
    acceleration = np.asarray(np.linalg.solve(inertia.M2, on_arm.T).T, np.float64)
    return Motion(motors.position - x[:, :n], motors.velocity - x[:, n:], acceleration), spring
