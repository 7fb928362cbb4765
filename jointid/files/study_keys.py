"""Keys of a study.toml with an example of each, and the values that several readers share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from jointid.errors import JointIdError
from jointid.files.checked_toml import CheckedTable
from jointid.joints import Elasticity, Inertia

INERTIA_KEYS = {
    "M": "M = [0.0025, 0.0010]  # rotor inertias, motor side, kg·m²",
    "M2": "M2 = [[0.0041, 0.0004], [0.0004, 0.0019]]  # arm inertia, motor side, kg·m²",
}
NOMINAL_KEYS = {"K": "K = [20.0, 3.5]  # N·m/rad", "D": "D = [0.10, 0.015]  # N·m·s/rad"}
TIMING_KEYS = {"torque_hold": "torque_hold = true", "torque_delay_s": "torque_delay_s = 0.0005"}
RECORD_KEYS = {
    "file": 'file = "records/01.csv"',
    "frequency_hz": "frequency_hz = 3.0",
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
    "inertia": f"[inertia], {INERTIA_KEYS['M']}, {INERTIA_KEYS['M2']}",
    "nominal": "[nominal], K = [20.0, 3.5], D = [0.10, 0.015]",
    "timing": "[timing], torque_hold = true",
    "poses": f"[poses.stretched], {INERTIA_KEYS['M2']}",
    "records": '[[records]], file = "records/01.csv", frequency_hz = 3.0',
}


def read_inertia(table: CheckedTable, default: Inertia | None = None) -> Inertia:
    """Return the inertia of a table; a pose without M has the rotors of ``default``.

    Raises
    ------
    JointIdError
        When M or M2 is missing or is no inertia.
    """
    M = default.M if default is not None and "M" not in table else table.numbers("M")
    M2 = table.matrix("M2")
    with in_place(table.where, table.file):
        return Inertia(M=M, M2=M2)


def read_poses(top: CheckedTable, default: Inertia) -> dict[str, Inertia]:
    """Return the inertia of each named pose, none when there is no [poses.NAME].

    Raises
    ------
    JointIdError
        When one of them is no inertia.
    """
    tables = top.named_tables("poses", INERTIA_KEYS)
    return {name: read_inertia(table, default) for name, table in tables.items()}


def read_nominal(top: CheckedTable) -> Elasticity | None:
    """Return the controller's present values; None without [nominal].

    Raises
    ------
    JointIdError
        When K or D is missing or is no spring.
    """
    if "nominal" not in top:
        return None
    table = top.table("nominal", NOMINAL_KEYS)
    K, D = table.numbers("K"), table.numbers("D")
    with in_place(table.where, table.file):
        return Elasticity(K=K, D=D)


@contextmanager
def in_place(where: str, file: str) -> Iterator[None]:
    """Put the place of a refused value before its message, unless the message names the file."""
    try:
        yield
    except JointIdError as error:
        if error.file == file:
            raise
        raise error.within(where, file=file) from error
