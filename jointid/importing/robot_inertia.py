"""The inertias that a log does not say: from TOML, or from the joint side of the gears."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array
from jointid.checked_toml import CheckedTable, parse_toml
from jointid.errors import JointIdError
from jointid.joints import Elasticity, Inertia
from jointid.wording import counted

INERTIA_UNITS = {
    "kg·m²": 1.0,
    "kg·cm²": 1e-4,
    "kg·mm²": 1e-6,
    "g·cm²": 1e-7,
    "lb·ft²": 0.45359237 * 0.3048**2,
    "lb·in²": 0.45359237 * 0.0254**2,
}
"""Inertia units in kg·m²; lb is the pound of mass."""

_KEYS = {
    "M": "M = [0.0025, 0.0010]  # rotor inertias, motor side, kg·m²",
    "M2": "M2 = [[0.0041, 0.0004], [0.0004, 0.0019]]  # arm inertia, motor side, kg·m²",
}
_NOMINAL = {"K": "K = [20.0, 3.5]  # N·m/rad", "D": "D = [0.10, 0.015]  # N·m·s/rad"}
_TOP = {
    "inertia": f"[inertia], {_KEYS['M']}, {_KEYS['M2']}",
    **_KEYS,
    "poses": f"[poses.stretched], {_KEYS['M2']}",
    "nominal": "[nominal], K = [20.0, 3.5], D = [0.10, 0.015]",
    "name": 'name = "Waterjet cell, axes 1 and 2"',
    # What else a study.toml holds; the logs take its place here.
    "format": "format = 1",
    "origin": 'origin = "measured"',
    "description": 'description = "Cold robot, no tool"',
    "robot": 'robot = "cell 7, robot A"',
    "date": "date = 2026-11-20",
    "timing": "[timing], torque_hold = true",
    "records": '[[records]], file = "records/01.csv"',
}


@dataclass(frozen=True, eq=False)
class KnownRobot:
    """What is known of a robot beside its logs, motor side."""

    inertia: Inertia
    poses: Mapping[str, Inertia] = field(default_factory=dict)
    """Inertia of each named pose."""
    nominal: Elasticity | None = None
    """What the controller assumes, where stated."""
    name: str = ""


def robot_from_toml(text: str | bytes, file: str = "The TOML") -> KnownRobot:
    """Read inertias, and poses, nominal values and a name where they are given.

    Parameters
    ----------
    text : str or bytes
        ``M`` and ``M2`` at the top or under ``[inertia]``; a whole study.toml will do.
    file : str, optional
        For messages.

    Raises
    ------
    JointIdError
        When it is no TOML, or M or M2 is missing or is no inertia.
    """
    data = text.encode() if isinstance(text, str) else text
    top = parse_toml(file, data, _TOP)
    if "inertia" not in top and "M" not in top and "M2" not in top:
        raise JointIdError(f"{file}: [inertia] is missing. Example: {_TOP['inertia']}.")
    inertia = _inertia(top.table("inertia", _KEYS) if "inertia" in top else top)
    nominal = None
    if "nominal" in top:
        table = top.table("nominal", _NOMINAL)
        nominal = Elasticity(K=table.numbers("K"), D=table.numbers("D"))
    poses = top.named_tables("poses", _KEYS)
    return KnownRobot(
        inertia,
        {name: _inertia(table, inertia) for name, table in poses.items()},
        nominal,
        top.text("name", ""),
    )


def motor_side(joint_inertia: ArrayLike, gear_ratio: ArrayLike) -> Floats:
    """Return M2 = N⁻¹ M N⁻¹: the arm's inertia matrix as the motors feel it.

    Parameters
    ----------
    joint_inertia : array_like, shape (n, n)
        On the joints' side of the gears, kg·m².
    gear_ratio : array_like, shape (n,)
        Motor turns over joint turns; a negative one turns the sign of its couplings.

    Raises
    ------
    JointIdError
        When shapes disagree, or a ratio is 0.
    """
    M = finite_array("M2 on the joint side (kg·m²)", joint_inertia, ndim=2)
    n = _ratios(gear_ratio)
    if M.shape != (n.size, n.size):
        raise JointIdError(
            f"M2 has shape {M.shape}, and there are {counted(n.size, 'gear ratio')}: give one row "
            "and one column "
            "per joint."
        )
    return np.asarray(M / np.outer(n, n))


def rotor_at_motor(reflected_inertia: ArrayLike, gear_ratio: ArrayLike) -> Floats:
    """Return J_m of rotors whose inertia is given as the joints feel it, n² J_m.

    Parameters
    ----------
    reflected_inertia, gear_ratio : array_like, shape (n,)
        In kg·m², and motor turns over joint turns.

    Raises
    ------
    JointIdError
        When shapes disagree, or a ratio is 0.
    """
    J = finite_array("M seen from the joints (kg·m²)", reflected_inertia, ndim=1)
    n = _ratios(gear_ratio)
    if J.shape != n.shape:
        raise JointIdError(
            f"M has {counted(J.size, 'value')}, and there are {counted(n.size, 'gear ratio')}: give "
            "one per joint."
        )
    return np.asarray(J / n**2)


def _ratios(gear_ratio: ArrayLike) -> Floats:
    n = finite_array("gear ratios", gear_ratio, ndim=1)
    if not n.all():
        raise JointIdError("A gear ratio is 0: give motor turns over joint turns, for instance 100.")
    return n


def _inertia(table: CheckedTable, default: Inertia | None = None) -> Inertia:
    M = default.M if default is not None and "M" not in table else table.numbers("M")
    M2 = table.matrix("M2")
    try:
        return Inertia(M=M, M2=M2)
    except JointIdError as error:
        raise JointIdError(f"{table.where}: {error}") from error
