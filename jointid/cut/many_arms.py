"""Many planar elastic arms at once, as arrays over runs.

Same equations and same leapfrog scheme as ``jointid.cut.arm_simulation.ArmSimulation``, with the mass
matrix in place of pymunk's pivots: the two agree within nanometres at the tool.
"""

from __future__ import annotations

import numpy as np

from jointid.arrays import Floats
from jointid.cut.arm import PlanarArm
from jointid.cut.servo import MotorFrictionLike, Number, friction_values


class ManyArms:
    """Many arms of one geometry, each with its own K and D, stepped together from rest.

    Parameters
    ----------
    arm : PlanarArm
    K, D : ndarray, shape (2, runs) or (2, 1)
        True stiffness and damping, motor side.
    dt : float
        Step, s.
    joint_angle_rad : ndarray, shape (2,)
        Joint angles at time 0; the springs are relaxed.
    runs : int
        Number of arms.
    friction : optional
        As in :func:`~jointid.cut.tracking.track`.

    Attributes
    ----------
    log : list of (link1, link2)
        Absolute link angles, each (runs,), at each instant that a step began from.
    """

    def __init__(
        self,
        arm: PlanarArm,
        K: Floats,
        D: Floats,
        dt: float,
        joint_angle_rad: Floats,
        runs: int,
        friction: MotorFrictionLike | None = None,
    ) -> None:
        n2 = arm.gear_ratio**2
        self._dt, self._serial, self._moments = dt, arm.drive == "serial", arm.moments
        self._K1, self._K2 = n2[:, None] * K
        self._D1, self._D2 = n2[:, None] * D
        self._B1, self._B2 = arm.rotor_inertia_arm_kgm2.tolist()
        coulomb, viscous = (np.zeros(2), np.zeros(2)) if friction is None else friction_values(friction)
        self._F1, self._F2 = (n2 * viscous).tolist()
        self._slow1, self._slow2 = (
            np.abs(arm.gear_ratio) * coulomb * dt / (n2 * arm.rotor_inertia_kgm2)
        ).tolist()
        still = np.zeros(runs)
        self.link1, self.link2 = (still + angle for angle in arm.link_angles(joint_angle_rad))
        self.motor1, self.motor2 = (still + angle for angle in joint_angle_rad)
        self.motor1_rate, self.motor2_rate, self._link1_rate, self._link2_rate = (still,) * 4
        self._before: tuple[Floats, ...] = (still,) * 4
        self.log: list[tuple[Floats, Floats]] = []

    def step(self, torque1: Number, torque2: Number) -> None:
        """Advance by one step under motor torques reflected to the arm side, N·m, (runs,) each."""
        self.log.append((self.link1, self.link2))
        dt, (a, b, c) = self._dt, self._moments
        rate1, rate2 = self._link1_rate, self._link2_rate
        bend = self.link2 - self.link1
        s1 = self._K1 * (self.motor1 - self.link1) + self._D1 * (self.motor1_rate - rate1)
        if self._serial:
            s2 = self._K2 * (self.motor2 - bend) + self._D2 * (self.motor2_rate - rate2 + rate1)
            load1 = s1 - s2
        else:
            s2 = self._K2 * (self.motor2 - self.link2) + self._D2 * (self.motor2_rate - rate2)
            load1 = s1
        coupling, h = c * np.cos(bend), c * np.sin(bend)
        load1 = load1 + h * rate2 * rate2
        load2 = s2 - h * rate1 * rate1
        scale = dt / (a * b - coupling * coupling)
        u1, u2, u3, u4 = self._before
        v1 = u1 + (b * load1 - coupling * load2) * scale
        v2 = u2 + (a * load2 - coupling * load1) * scale
        v3 = u3 + (torque1 - s1 - self._F1 * self.motor1_rate) * (dt / self._B1)
        v4 = u4 + (torque2 - s2 - self._F2 * self.motor2_rate) * (dt / self._B2)
        if self._slow1 > 0:
            v3 = v3 - np.clip(v3, -self._slow1, self._slow1)
        if self._slow2 > 0:
            v4 = v4 - np.clip(v4, -self._slow2, self._slow2)
        self.link1, self.link2 = self.link1 + v1 * dt, self.link2 + v2 * dt
        self.motor1, self.motor2 = self.motor1 + v3 * dt, self.motor2 + v4 * dt
        self._link1_rate, self._link2_rate = 1.5 * v1 - 0.5 * u1, 1.5 * v2 - 0.5 * u2
        self.motor1_rate, self.motor2_rate = 1.5 * v3 - 0.5 * u3, 1.5 * v4 - 0.5 * u4
        self._before = (v1, v2, v3, v4)
