"""Limits, gears and start pose of a robot, as entered or from a TOML file."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array, per_joint, set_fields
from jointid.errors import JointIdError
from jointid.joints import Inertia
from jointid.parsing.checked_toml import in_place, parse_toml
from jointid.study import Study
from jointid.wording import counted, enumerated

LIMIT_KEYS = {
    "robot": 'robot = "cell 7, robot A"',
    "gear_ratio": "gear_ratio = [100, 90]  # motor turns per joint turn, negative if opposite",
    "start_deg": "start_deg = [0, -90, 90, 0, 45, 0]  # start pose, all axes of the robot",
    "axes": "axes = [1, 2]  # axes of the robot that are the joints of the study",
    "joint_names": 'joint_names = ["a1", "a2", "a3", "a4", "a5", "a6"]  # for ROS 2, all axes',
    "lower_deg": "lower_deg = [-170, -100]",
    "upper_deg": "upper_deg = [170, 10]",
    "velocity_deg_s": "velocity_deg_s = [105, 101]",
    "acceleration_deg_s2": "acceleration_deg_s2 = [2600, 2600]",
    "torque_Nm": "torque_Nm = [20, 12]  # of the motors",
    "load_Nm": "load_Nm = [0, 4]  # motor torque at rest in the start pose; default: the robot model's",
}
"""Keys of a limits file."""
_OPTIONAL = ("robot", "axes", "joint_names", "load_Nm")
_SAME_POSE_RAD = 2e-3
"""Rounding of the angles that a robot displays."""
_POSITIVE = ("velocity_deg_s", "acceleration_deg_s2", "torque_Nm")


@dataclass(frozen=True, eq=False)
class RobotLimits:
    """Limits of n joints in degrees as in data sheets, torques of the motors, and the start pose.

    Raises JointIdError when a value is out of range or a count is wrong.
    """

    gear_ratio: Floats
    """Motor turns over joint turns, shape (n,); negative where the motor turns the other way."""
    start_deg: Floats
    """Start pose of all m ≥ n axes of the robot, shape (m,)."""
    lower_deg: Floats
    upper_deg: Floats
    velocity_deg_s: Floats
    acceleration_deg_s2: Floats
    torque_Nm: Floats
    load_Nm: Floats = field(default_factory=lambda: np.zeros(1))
    """Motor torque at rest in the start pose: the simulated robot has gravity as a stiffness only."""
    axes: Sequence[float] = ()
    """Axes of the robot, from 1, that are the joints of the study; by default the first n."""
    joint_names: tuple[str, ...] = ()
    """Names of all m axes; by default joint_1 …"""
    robot: str = ""
    moving: tuple[int, ...] = field(init=False)
    """Indices of the joints of the study among the axes of the robot."""

    def __post_init__(self) -> None:
        start = finite_array("start_deg", self.start_deg, ndim=1)
        n = finite_array("gear_ratio", self.gear_ratio, ndim=1).size
        values: dict[str, Any] = {"start_deg": start}
        for name in ("gear_ratio", "lower_deg", "upper_deg", "load_Nm", *_POSITIVE):
            values[name] = per_joint(name, getattr(self, name), n)
            if name in _POSITIVE and np.any(values[name] <= 0):
                raise JointIdError(f"{name} = {values[name].tolist()}: limits must be positive.")
        if np.any(values["gear_ratio"] == 0):
            raise JointIdError("A gear ratio is 0: give motor turns per joint turn, such as 100.")
        if np.any(values["lower_deg"] >= values["upper_deg"]):
            j = int(np.argmax(values["lower_deg"] >= values["upper_deg"])) + 1
            raise JointIdError(f"The lowest position of joint {j} must lie below its highest.")
        axes, every = list(self.axes) or list(range(1, n + 1)), range(1, start.size + 1)
        names = tuple(self.joint_names) or tuple(f"joint_{axis}" for axis in every)
        if not len(axes) == len(set(axes)) == n or not set(axes) <= set(every):
            raise JointIdError(
                f"axes = {axes} does not match {counted(n, 'gear ratio')} and "
                f"{counted(start.size, 'angle')} of the start pose: give the angle of every "
                "axis of the robot, and one axis per joint."
            )
        if len(names) != start.size:
            raise JointIdError(
                f"{counted(len(names), 'joint name')}, but {counted(start.size, 'angle')} of the start "
                "pose: give one of each per axis of the robot."
            )
        moving = tuple(int(axis) - 1 for axis in axes)
        set_fields(self, **values, axes=axes, joint_names=names, moving=moving)

    def motor_velocity(self, joint_deg_s: ArrayLike) -> Floats:
        """Velocities of the motors in rad/s, of one velocity or one per joint in deg/s."""
        each = per_joint("superposed velocity (°/s)", joint_deg_s, self.gear_ratio.size)
        return np.asarray(np.radians(each) * self.gear_ratio)

    def on_robot(self, study: Study, pose: str, inertia: Inertia) -> tuple["RobotLimits", Inertia]:
        """Return the limits with their load at rest, and the inertia, of the robot in the start pose.

        A study with a robot model at the joint angles of ``pose`` knows both. The load is that of the
        model where none is given, with the heavier payload if its mass is uncertain. Where the start
        pose is not ``pose``, to which ``inertia`` belongs, the inertia is that of the model.
        """
        model, planned = study.robot_model, study.pose_angles_rad.get(pose)
        if model is None or planned is None:
            return self, inertia
        start, load = np.radians(self.start_deg[list(self.moving)]), model.payload
        if not np.allclose(start, planned, rtol=0, atol=_SAME_POSE_RAD):
            inertia = model.inertia(start)
        if self.load_Nm.any():
            return self, inertia
        still = np.zeros(model.n)
        loads = [
            model.with_payload(mass=mass).torque(start, still, still) @ model.coupling
            for mass in (load.mass, load.mass + load.mass_std)
        ]
        return replace(self, load_Nm=np.abs(loads).max(axis=0).round(6)), inertia

    def require_gears_of(self, study: Study) -> None:
        """Refuse gears that couple the motors of a study, or gear ratios that contradict the study's."""
        ratios, own = study.gear_ratios, self.gear_ratio
        if problem := coupling_problem(study):
            raise JointIdError(problem)
        if ratios is not None and ratios.size == own.size and not np.allclose(ratios, own, rtol=1e-3):
            raise JointIdError(
                f"gear_ratio = {own.tolist()} contradicts the study's {ratios.tolist()}: these set "
                "points would differ from the plan. Give the same ratios, with their signs."
            )


def coupling_problem(study: Study) -> str:
    """Say why a robot whose joints share a motor has no set points; empty for other robots."""
    model = study.robot_model
    if model is None or not model.is_coupled.any():
        return ""
    names = enumerated(list(compress(model.names, model.is_coupled)))
    return (
        f"Gears couple {names}: set points of joints that share a motor are not supported. Run the "
        "plan, which is given at the motors, by a program in the controller."
    )


def limits_from_toml(data: bytes, file: str) -> RobotLimits:
    """Read limits from TOML with the keys ``LIMIT_KEYS``.

    Raises JointIdError when a key is missing, unknown or wrong.
    """
    top = parse_toml(file, data, LIMIT_KEYS)
    given = top.values(LIMIT_KEYS, required=LIMIT_KEYS.keys() - _OPTIONAL)
    with in_place(file, file):
        limits = RobotLimits(**given)
        for j, pose in enumerate(limits.start_deg[list(limits.moving)].tolist()):
            low, high = limits.lower_deg[j], limits.upper_deg[j]
            if not low <= pose <= high:
                raise JointIdError(
                    f"The start angle of joint {j + 1}, {pose:g}°, lies outside its limits of "
                    f"{low:g}° and {high:g}°: give all of them in degrees."
                )
        return limits
