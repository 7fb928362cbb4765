"""Simulated cut: the servo drives the arm along a tool path; contour and tracking error."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats, finite_array, set_fields
from jointid.cut.arm import Elbow, PlanarArm, require_two_joints
from jointid.cut.arm_simulation import ArmSimulation, require_step
from jointid.cut.feedforward import plan_servo
from jointid.cut.servo import MotorFrictionLike, Servo, run_servo
from jointid.cut.toolpath import Toolpath
from jointid.errors import JointIdError
from jointid.gears.gear import Gear
from jointid.gears.laws import nonlinear_laws
from jointid.joints import Elasticity


@dataclass(frozen=True, eq=False)
class TrackingRun:
    """One cut, sampled at every step of the simulation.

    The arm starts at rest without joint deflection: motor and joint angles of sample 0 are equal. From
    the held torques and the equations of :class:`~jointid.cut.arm.PlanarArm` the run can be recomputed.
    """

    time_s: Floats
    """Times, shape (k,), s."""
    tool_m: Floats
    """Tool position, shape (k, 2), m."""
    reference_m: Floats
    """Reference tool position at the same time, shape (k, 2), m."""
    motor_torque_Nm: Floats
    """Torque held by the servo from ``time_s[i]`` to ``time_s[i + 1]``, before friction, motor side,
    shape (k, 2), N·m."""
    joint_angle_rad: Floats
    """Joint angles q: absolute link angles with a parallelogram drive; with a serial one q2 is relative
    to link 1. Shape (k, 2), rad."""
    motor_angle_rad: Floats
    """Motor angles reflected to the joint side, θ / gear ratio, shape (k, 2), rad."""
    contour_error_m: Floats
    """Distance of the tool from the nearest point of the reference path, shape (k,), m."""
    tracking_error_m: Floats
    """Distance of the tool from its reference position at the same time, shape (k,), m."""
    torque_limit_hit: bool
    """Whether a motor torque reached its limit."""

    def __post_init__(self) -> None:
        k = np.size(self.time_s)
        planar = ("tool_m", "reference_m", "motor_torque_Nm", "joint_angle_rad", "motor_angle_rad")
        for name in (*planar, "time_s", "contour_error_m", "tracking_error_m"):
            shape = (k, 2) if name in planar else (k,)
            value = finite_array(name, getattr(self, name), ndim=len(shape))
            if value.shape != shape:
                raise JointIdError(f"{name} has shape {value.shape}; expected {shape}.")
            set_fields(self, **{name: value})

    @property
    def max_contour_error_m(self) -> float:
        """Largest contour error (path error), m."""
        return float(self.contour_error_m.max())

    @property
    def max_tracking_error_m(self) -> float:
        """Largest tracking error, m."""
        return float(self.tracking_error_m.max())


def track(
    arm: PlanarArm,
    toolpath: Toolpath,
    elasticity: Elasticity,
    assumed: Elasticity | None = None,
    *,
    servo: Servo | None = None,
    friction: MotorFrictionLike | None = None,
    gears: Sequence[Gear] | None = None,
    assumed_gears: Sequence[Gear] | None = None,
    elbow: Elbow = "positive",
    dt: float = 2.5e-4,
    progress: Callable[[float], None] | None = None,
) -> TrackingRun:
    """Simulate a cut with an arm whose servo assumes given joint elasticities.

    Parameters
    ----------
    arm : PlanarArm
    toolpath : Toolpath
    elasticity : Elasticity
        The arm's true K and D, motor side.
    assumed : Elasticity, optional
        K and D that the servo assumes, motor side. None: rigid joints.
    servo : Servo, optional
        Settings of the controllers.
    friction : optional
        True friction at the motors, with sticking: any object with ``coulomb`` (N·m) and ``viscous``
        (N·m·s/rad), motor side.
    gears : sequence of Gear, optional
        True laws of the gears in addition to K and D, motor side; by default linear ones.
    assumed_gears : sequence of Gear, optional
        Laws that the servo assumes, motor side, with the ``assumed`` K and D.
    elbow : {"positive", "negative"}
        Sign of the angle of link 2 relative to link 1.
    dt : float
        Longest step of the simulation, s, at most 1 ms; each control interval is divided into equal
        steps no longer than this.
    progress : callable, optional
        Called with the fraction done, from 0 to 1; an exception from it ends the run.

    Returns
    -------
    TrackingRun

    Raises
    ------
    JointIdError
        When the path leaves the workspace, the step is above 1 ms or too long for the arm, or the
        control loop is unstable.
    """
    servo = servo or Servo()
    substeps = substeps_per_sample(servo, dt)
    if assumed is not None:
        require_two_joints(assumed, "assumed elasticity")
    K, D = (None, None) if assumed is None else (assumed.K[:, None], assumed.D[:, None])
    known = None if assumed is None else nonlinear_laws(assumed.K, assumed_gears, arm.gear_ratio)
    plan = plan_servo(arm, toolpath, servo, K, D, elbow, known)
    step = servo.interval_s / substeps
    true = nonlinear_laws(elasticity.K, gears, arm.gear_ratio)
    simulation = ArmSimulation(arm, elasticity, step, plan.start_angle, friction, true)
    held = np.array(run_servo(plan, simulation, substeps, progress))[..., 0]
    angles = np.array([*simulation.log, simulation.angles])
    time: Floats = step * np.arange(len(angles), dtype=np.float64)
    torque = np.concatenate([np.repeat(held, substeps, axis=0), held[-1:]])
    q = arm.joint_angles(angles[:, :2])
    tool, reference = arm.tool(q), toolpath.position(time)
    return TrackingRun(
        time_s=time,
        tool_m=tool,
        reference_m=reference,
        motor_torque_Nm=torque / arm.gear_ratio,
        joint_angle_rad=q,
        motor_angle_rad=angles[:, 2:],
        contour_error_m=toolpath.distance(tool),
        tracking_error_m=np.hypot(*(tool - reference).T),
        torque_limit_hit=bool((np.abs(held) >= plan.limit).any()),
    )


def substeps_per_sample(servo: Servo, dt: float) -> int:
    """Number of equal steps, none longer than ``dt``, in a control interval."""
    require_step(dt)
    return max(1, int(np.ceil(servo.interval_s / dt - 1e-9)))
