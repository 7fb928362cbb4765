"""Keys of a study.toml with an example of each, and the values that several readers share."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from jointid.arrays import Floats
from jointid.files.container_limits import safe_name
from jointid.joints import Elasticity, Inertia
from jointid.parsing.checked_toml import CheckedTable, in_place
from jointid.robot_models.description import PAYLOAD_KEYS
from jointid.robot_models.model import RobotModel
from jointid.wording import listed, nearest

PARTS = ("added", "gravity", "shared", "shared_gravity")
"""Optional matrices of an inertia."""
INERTIA_KEYS = {
    "M": "M = [0.0025, 0.0010]  # rotor inertias, motor side, kg·m²",
    "M2": "M2 = [[0.0041, 0.0004], [0.0004, 0.0019]]  # arm inertia, motor side, kg·m²",
    "added": "added = [[0.0012, 0.0005], [0.0005, 0.0009]]  # exactly known part of M2, kg·m²",
    "gravity": "gravity = [[0.06, 0.01], [0.01, 0.02]]  # gravity stiffness, motor side, N·m/rad",
    "shared": "shared = [[0.0004, 0.0001], [0.0001, 0.0003]]  # change per 1 σ of the payload, kg·m²",
    "shared_gravity": "shared_gravity = [[0.01, 0.0], [0.0, 0.01]]  # the same for gravity, N·m/rad",
    "angles_deg": "angles_deg = [0.0, -60.0, 100.0, 0.0, 40.0, 0.0]  # joint angles, in place of M2",
    "angles_rad": "angles_rad = [0.0, -1.05, 1.75, 0.0, 0.7, 0.0]  # joint angles, in place of M2",
    "std": "std = 0.03  # M and M2 are known to 3 %",
}
POSE_KEYS = {
    **{key: INERTIA_KEYS[key] for key in INERTIA_KEYS if key != "std"},
    "base": 'base = "stretched"  # pose to which the added inertia is added',
}
ROBOT_KEYS = {
    "file": 'file = "robot.toml"  # or .urdf, .xml (MJCF)',
    "gear_ratio": "gear_ratio = [240.0, 260.0]  # motor turns per joint turn, where the file has none",
    "rotor_inertia": "rotor_inertia = [0.009, 0.011]  # motor side, kg·m², where the file has none",
    "payload": "[robot_model.payload], mass = 120.0, center = [0.0, 0.0, 0.1]",
}
TORQUE_KEYS = {"std": "std = 0.02  # the torque constants are known to 2 %"}
NOMINAL_KEYS = {"K": "K = [20.0, 3.5]  # N·m/rad", "D": "D = [0.10, 0.015]  # N·m·s/rad"}
TIMING_KEYS = {"torque_hold": "torque_hold = true", "torque_delay_s": "torque_delay_s = 0.0005"}
RECORD_KEYS = {
    "file": 'file = "records/01.csv"',
    "frequency_hz": "frequency_hz = 3.0  # a sine; without it, the record is any other motion",
    "band_hz": "band_hz = [2.5, 38.0]  # frequencies of a motion to use",
    "start_s": "start_s = 2.0",
    "pose": 'pose = "stretched"',
    "label": 'label = "axis 1 leads"',
    **TIMING_KEYS,
}
STUDY_KEYS = {
    "format": "format = 1",
    "name": 'name = "Waterjet cell, axes 1 and 2"',
    "origin": 'origin = "measured"',
    "description": 'description = "Cold robot, no tool"',
    "robot": 'robot = "cell 7, robot A"',
    "date": "date = 2026-11-20",
    "gear_ratio": "gear_ratio = [101.0, -93.5]  # motor turns per joint turn",
    "gear_temperature_C": "gear_temperature_C = 24.0",
    "note": 'note = "after two hours of operation"',
    "assumed": 'assumed = ["torque held between samples"]  # unconfirmed facts',
    "changes": 'changes = ["Left out: 05.csv"]  # changes to the data as logged',
    "inertia": f"[inertia], {INERTIA_KEYS['M']}, {INERTIA_KEYS['M2']}",
    "nominal": "[nominal], K = [20.0, 3.5], D = [0.10, 0.015]",
    "torque": f"[torque], {TORQUE_KEYS['std']}",
    "robot_model": '[robot_model], file = "robot.toml"',
    "timing": "[timing], torque_hold = true",
    "poses": f"[poses.stretched], {INERTIA_KEYS['M2']}",
    "records": '[[records]], file = "records/01.csv", frequency_hz = 3.0',
}


STUDY_VALUES = (
    "name", "origin", "description", "robot", "note", "date", "gear_ratio", "gear_temperature_C",
    "assumed", "changes",
)  # fmt: skip
"""Keys that are attributes of a study, in their order on disk."""
RECORD_VALUES = ("frequency_hz", "band_hz", "start_s", "pose", "label")
"""Keys that are attributes of a record, in their order on disk."""


def written_values(source: object, keys: Iterable[str]) -> dict[str, Any]:
    """Return the attributes of these names as TOML has them, without empty ones."""
    values = {key: getattr(source, key, None) for key in keys}
    plain = {key: v.tolist() if isinstance(v, np.ndarray) else v for key, v in values.items()}
    return {key: value for key, value in plain.items() if value not in (None, "", ())}


def _inertia(table: CheckedTable, default: Inertia | None, robot: RobotModel | None) -> Inertia:
    """Inertia of a table; a pose without M has the rotors of ``default``.

    Joint angles in place of M2 take the inertia and the gravity from the robot model.
    """
    angles = read_angles(table)
    if angles is not None:
        both = [key for key in ("M", "M2", *PARTS, "base") if key in table]
        if both:
            raise table.error(f"joint angles and {both[0]} are both given: leave one of them out.")
        if robot is None:
            raise table.error("joint angles need the robot model. Example: [robot_model], file = …")
        with in_place(table.where, table.file):
            return robot.inertia(angles)
    M = default.M if default is not None and "M" not in table else table.numbers("M")
    M2 = table.matrix("M2")
    parts = {key: table.matrix(key) for key in PARTS if key in table}
    with in_place(table.where, table.file):
        return Inertia(M, M2, **parts)


def read_angles(table: CheckedTable) -> Floats | None:
    """Return the joint angles of a pose in rad; None without.

    Raises JointIdError when they are given both in degrees and in radians.
    """
    if "angles_deg" in table and "angles_rad" in table:
        raise table.error("angles_deg and angles_rad are both given: leave one of them out.")
    if "angles_deg" in table:
        return np.deg2rad(table.numbers("angles_deg"))
    return np.array(table.numbers("angles_rad")) if "angles_rad" in table else None


def read_robot_model(top: CheckedTable, read: Callable[[str], bytes]) -> RobotModel | None:
    """Return the robot model, None without [robot_model]; ``read`` returns a file by its name.

    Raises JointIdError when the file is missing or is no robot.
    """
    if "robot_model" not in top:
        return None
    table = top.table("robot_model", ROBOT_KEYS)
    given = table.values(("gear_ratio", "rotor_inertia"))
    with in_place(table.where, table.file):
        name = safe_name(table.text("file"))
        robot = RobotModel.parse(name, read(name), **given)
    if "payload" not in table:
        return robot
    load = table.table("payload", PAYLOAD_KEYS)
    values = load.values(PAYLOAD_KEYS)
    with in_place(load.where, load.file):
        return robot.with_payload(**values)


def robot_file(robot: RobotModel) -> str:
    """Return the name of a robot model's file in a study, whatever it was called before."""
    return "robot" + PurePosixPath(robot.source[0]).suffix.lower()


def read_known(
    top: CheckedTable, inertia: CheckedTable, robot: RobotModel | None = None
) -> dict[str, Any]:
    """Return the robot in a file: inertia, standard deviations if stated, poses, nominal, name, model.

    ``inertia`` is the table with M and M2. Raises JointIdError when one of them is invalid.
    """
    given = _inertia(inertia, None, robot)
    known: dict[str, Any] = {"inertia": given, "name": top.text("name", "")}
    if "std" in inertia:
        known["inertia_std"] = inertia.deviation("std")
    if "torque" in top:
        known["torque_std"] = top.table("torque", TORQUE_KEYS).deviation("std")
    if "nominal" in top:
        table = top.table("nominal", NOMINAL_KEYS)
        K, D = table.numbers("K"), table.numbers("D")
        with in_place(table.where, table.file):
            known["nominal"] = Elasticity(K=K, D=D)
    named = {"": inertia, **top.named_tables("poses", POSE_KEYS)}
    angles = {pose: q for pose, of in named.items() if (q := read_angles(of)) is not None}
    poses = _poses(top, given, robot)
    return known | {"poses": poses, "robot_model": robot, "pose_angles_rad": angles}


def _poses(top: CheckedTable, default: Inertia, robot: RobotModel | None) -> dict[str, Inertia]:
    """Inertia of each named pose.

    ``default``, the inertia of records without a pose, gives the rotors of a pose without M, and M2 of a
    pose that adds to it; ``robot`` gives the inertia of poses with joint angles.
    """
    tables = top.named_tables("poses", POSE_KEYS)
    additions = {name for name, table in tables.items() if "M2" not in table and "added" in table}
    for name, table in tables.items():
        if "base" in table and name not in additions:
            raise table.error("base needs the key added, the change of the base's M2, in place of M2.")
    own = {
        name: _inertia(table, default, robot) for name, table in tables.items() if name not in additions
    }
    return {name: own[name] if name in own else _sum(tables[name], default, own) for name in tables}


def _sum(table: CheckedTable, default: Inertia, poses: Mapping[str, Inertia]) -> Inertia:
    """Inertia of a pose that is given as an addition to another one."""
    name = table.text("base") if "base" in table else None
    base = default if name is None else poses.get(name)
    if base is None:
        raise table.error(
            f'base = "{name:.60}": no pose of this name has an M2.{nearest(name or "", poses)} '
            f"Poses with M2: {listed(poses)}. Without base, added changes [inertia]."
        )
    with in_place(table.where, table.file):
        loaded = base.with_added(table.matrix("added"))
        return replace(loaded, M=np.array(table.numbers("M"))) if "M" in table else loaded
