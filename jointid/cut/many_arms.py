"""Many planar elastic arms, vectorised over runs.

Same equations and leapfrog scheme as ``jointid.cut.arm_simulation.ArmSimulation``, with the mass matrix
in place of pymunk's pivots: the two agree within nanometres at the tool.
"""

import numpy as np

from jointid.arrays import Floats
from jointid.cut.arm import PlanarArm
from jointid.cut.servo import (
    ARRAYS,
    MotorFrictionLike,
    ServoPlan,
    driven,
    friction_values,
    require_tracking,
    sampled_law,
)


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
        Joint angles at time 0, without deflection.
    runs : int
        Number of arms.
    friction : optional
        As in :func:`~jointid.cut.tracking.track`.

    Attributes
    ----------
    link, motor : ndarray, shape (2, runs)
        Absolute link angles and reflected motor angles at the present instant, rad.
    motor_rate : ndarray, shape (2, runs)
        Reflected motor rates, rad/s.
    log : list of ndarray
        ``link`` at the start of each step.
    """

    def __init__(
        self,
        arm: PlanarArm,
        K: Floats,
        D: Floats,
        dt: float,
        joint_angle_rad: Floats,
        runs: int,
        friction: MotorFrictionLike | None,
    ) -> None:
        n2 = arm.gear_ratio[:, None] ** 2
        rotor = arm.rotor_inertia_arm_kgm2[:, None]
        coulomb, viscous = friction_values(friction)
        a, b, self._c = arm.moments
        self._dt, self._serial = dt, arm.drive == "serial"
        self._K, self._D, self._F = n2 * K, n2 * D, n2 * viscous[:, None]
        self._kick = dt / rotor
        self._slows = np.abs(arm.gear_ratio * coulomb)[:, None] * self._kick
        self._slides = not coulomb.any()
        self._ab, self._ba = a * b, np.array([[b], [a]])
        self.link = np.repeat(arm.link_angles(joint_angle_rad)[:, None], runs, axis=1)
        self.motor = np.repeat(joint_angle_rad[:, None], runs, axis=1)
        still = np.zeros((2, runs))
        self._link_rate = self.motor_rate = self._link_before = self._motor_before = still
        self.log: list[Floats] = []

    def step(self, torque: Floats) -> None:
        """Advance by one step under motor torques reflected to the joint side, (2, runs), N·m."""
        self.log.append(self.link)
        dt, link, rate = self._dt, self.link, self._link_rate
        joint, joint_rate = link, rate
        if self._serial:
            joint, joint_rate = joint.copy(), joint_rate.copy()
            joint[1] -= link[0]
            joint_rate[1] -= rate[0]
        spring = self._K * (self.motor - joint) + self._D * (self.motor_rate - joint_rate)
        load, square, bend = spring.copy(), rate * rate, link[1] - link[0]
        if self._serial:
            load[0] -= spring[1]
        coupling, h = self._c * np.cos(bend), self._c * np.sin(bend)
        load[0] += h * square[1]
        load[1] -= h * square[0]
        v = (self._ba * load - coupling * load[::-1]) * (dt / (self._ab - coupling * coupling))
        v += self._link_before
        w = (torque - spring - self._F * self.motor_rate) * self._kick + self._motor_before
        if not self._slides:  # friction reduces the rotor's speed, at most to zero
            w = w - np.minimum(np.maximum(w, -self._slows), self._slows)
        self.link, self.motor = link + v * dt, self.motor + w * dt
        self._link_rate = 1.5 * v - 0.5 * self._link_before
        self.motor_rate = 1.5 * w - 0.5 * self._motor_before
        self._link_before, self._motor_before = v, w


def run_many(plan: ServoPlan, arms: ManyArms, substeps: int) -> None:
    """Drive many arms along a plan, or each along its own, by the law of ``servo.run_servo``.

    Raises
    ------
    JointIdError
        When a motor of any arm runs away from its reference.
    """
    tables = [list(x if x.ndim == 3 else x[..., None]) for x in (plan.angle, plan.rate, plan.torque)]
    gains = [x[:, None] for x in (plan.proportional, plan.derivative, plan.count, plan.limit)]
    law = sampled_law(plan, tables, gains, ARRAYS)

    def torques(k: int) -> tuple[Floats]:
        return (law(k, arms.motor, arms.motor_rate),)

    for _ in driven(len(plan.torque), torques, arms.step, substeps):
        pass
    require_tracking(ARRAYS.largest(arms.motor - tables[0][-1]))
