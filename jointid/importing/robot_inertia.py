"""Inertias, which no log contains: from TOML, or converted from the joint side of the gears."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array
from jointid.errors import JointIdError
from jointid.files.study_keys import INERTIA_KEYS, STUDY_KEYS, read_known, read_robot_model
from jointid.joints import Elasticity, Inertia
from jointid.parsing.checked_toml import parse_toml
from jointid.robot_models.model import RobotModel
from jointid.wording import counted

INERTIA_UNITS = {
    "kg·m²": 1.0,
    "g·m²": 1e-3,
    "kg·cm²": 1e-4,
    "kg·mm²": 1e-6,
    "g·cm²": 1e-7,
    "lb·ft²": 0.45359237 * 0.3048**2,
    "lb·in²": 0.45359237 * 0.0254**2,
}
"""Inertia units in kg·m²; lb is the pound of mass."""

_TOP = {"inertia": STUDY_KEYS["inertia"], **INERTIA_KEYS, **STUDY_KEYS}
"""M and M2 may be at the top level; other keys of a study.toml are allowed and ignored."""


@dataclass(frozen=True, eq=False)
class KnownRobot:
    """Properties of a robot that its logs do not contain, motor side."""

    inertia: Inertia
    poses: Mapping[str, Inertia] = field(default_factory=dict)
    """Inertia of each named pose."""
    nominal: Elasticity | None = None
    """Nominal K and D, if given."""
    name: str = ""
    inertia_std: float | None = None
    """Relative standard deviation of the inertias, if given."""
    torque_std: float | None = None
    """Relative standard deviation of the torque constants, if given."""
    robot_model: RobotModel | None = None
    pose_angles_rad: Mapping[str, Floats] = field(default_factory=dict)
    """Joint angles, shape (n,), of the poses whose inertia is that of the model."""


def robot_from_toml(
    text: str | bytes, file: str = "The text", read: Callable[[str], bytes] | None = None
) -> KnownRobot:
    """Read ``M``, ``M2`` and ``std``, at the top or under ``[inertia]``; a whole study.toml will do.

    Standard deviations, poses, nominal values and name are optional. Where ``read`` returns a file by
    its name, joint angles in place of M2 take the inertia from the robot model. Raises JointIdError
    when the text is not TOML, or M or M2 is missing or invalid.
    """
    data = text.encode() if isinstance(text, str) else text
    if b"[[link]]" in data:
        raise JointIdError(
            f"{file} describes a robot model, not inertias. Give it as Robot model in the app, and with "
            "--robot-model to jointid convert."
        )
    top = parse_toml(file, data, _TOP)
    if "inertia" not in top and "M" not in top and "M2" not in top:
        raise JointIdError(f"{file}: [inertia] is missing. Example: {_TOP['inertia']}.")
    table = top.table("inertia", INERTIA_KEYS) if "inertia" in top else top
    robot = None if read is None else read_robot_model(top, read)
    return KnownRobot(**read_known(top, table, robot))


def motor_side(joint_inertia: ArrayLike, gear_ratio: ArrayLike) -> Floats:
    """Return M2 = N⁻¹ M N⁻¹: the arm's inertia matrix (n, n), kg·m², on the motor side.

    ``gear_ratio`` (n,) is motor turns over joint turns; a negative ratio reverses the sign of its
    couplings. Raises JointIdError when shapes disagree, or a ratio is 0.
    """
    n = _ratios(gear_ratio)
    M = _per_joint("M2 on the joint side (kg·m²)", joint_inertia, (n.size, n.size))
    return np.asarray(M / np.outer(n, n))


def rotor_at_motor(reflected_inertia: ArrayLike, gear_ratio: ArrayLike) -> Floats:
    """Return the rotor inertia J_m (n,) from its value on the joint side, N² J_m, kg·m².

    Raises JointIdError when shapes disagree, or a ratio of motor turns over joint turns is 0.
    """
    n = _ratios(gear_ratio)
    J = _per_joint("M seen from the joints (kg·m²)", reflected_inertia, n.shape)
    return np.asarray(J / n**2)


def _ratios(gear_ratio: ArrayLike) -> Floats:
    n = finite_array("gear ratios", gear_ratio, ndim=1)
    if not n.all():
        raise JointIdError("A gear ratio is 0: give motor turns per joint turn, such as 100.")
    return n


def _per_joint(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Floats:
    """Return values as an array of the shape that the gear ratios require."""
    array = finite_array(name, values, ndim=len(shape))
    if array.shape != shape:
        found, wanted = (" × ".join(map(str, size)) for size in (array.shape, shape))
        raise JointIdError(
            f"{name}: {found} given, but {counted(shape[0], 'gear ratio')} need {wanted}: give one "
            "per joint, in the order of the joints."
        )
    return array
