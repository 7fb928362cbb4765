"""Robots as TOML with standard Denavit-Hartenberg parameters."""

import re

import numpy as np

from jointid.arrays import Floats, frozen
from jointid.parsing.checked_toml import CheckedTable, in_place, parse_toml
from jointid.robot_models.description import PAYLOAD_KEYS, Counterbalance, Payload, RobotDescription
from jointid.robot_models.rigid_bodies import Frame, RigidBodies, symmetric_tensor
from jointid.wording import counted

_LINK = {
    "a": "a = 0.35  # m",
    "d": "d = -0.675  # m",
    "alpha_deg": "alpha_deg = 90.0",
    "offset_deg": "offset_deg = 90.0  # added to the model's angle",
    "zero_deg": "zero_deg = -90.0  # angle of the model where the log says 0",
    "gear_ratio": "gear_ratio = 221.0  # motor turns per joint turn",
    "rotor_inertia": "rotor_inertia = 0.0017  # motor side, kg·m²",
    "mass": "mass = 105.2  # kg",
    "center": "center = [-0.02, -0.02, -0.08]  # of mass, in the frame after the link, m",
    "inertia": PAYLOAD_KEYS["inertia"],
    "name": 'name = "axis 1"',
}
_BASE = {
    "rotation": 'rotation = "x 180 deg"  # of the base in the world, whose z axis points up',
    "gravity": "gravity = 9.81  # m/s²",
}
_COUNTERBALANCE = {
    "joint": "joint = 2",
    **{key: f"{key} = {getattr(Counterbalance, key):.6g}" for key in (
        "angle_deg", "anchor_m", "crank_m", "area_m2", "gas_volume_m3", "gas_energy_J",
    )},
}  # fmt: skip
_TOOL = {"origin": "origin = [0.0, 0.0, 0.2]  # tool point in the frame after the last link, m"}
_ROBOT = {
    "link": f"[[link]], {_LINK['a']}",
    "payload": f"[payload], {PAYLOAD_KEYS['mass']}",
    "base": f"[base], {_BASE['rotation']}",
    "counterbalance": "[counterbalance], joint = 2",
    "coupling": "coupling = [[0.01, 0.0], [-0.002, 0.008]]  # joint = C · motor, in place of gear_ratio",
    "tool": f"[tool], {_TOOL['origin']}",
    "name": 'name = "Palletiser"',
}
_TURN = re.compile(r"\s*([xyz])\s+([-+]?\d+(?:\.\d*)?)\s*deg\s*")
_MOST_LINKS = 64


def read_denavit_hartenberg(file: str, data: bytes) -> RobotDescription:
    """Read a robot with one [[link]] per joint.

    A link's transform is Rz(angle) Tz(d) Tx(a) Rx(alpha) with angle = logged + zero_deg + offset_deg.
    Raises JointIdError when the text is not TOML, or a value is missing or invalid.
    """
    top = parse_toml(file, data, _ROBOT)
    links = top.tables("link", _LINK)
    if not 1 <= len(links) <= _MOST_LINKS:
        raise top.error(f"{counted(len(links), '[[link]] table')}: give from 1 to {_MOST_LINKS}.")
    zero = np.deg2rad([link.number("zero_deg", 0.0) for link in links])
    offset = np.deg2rad([link.number("offset_deg", 0.0) for link in links])
    rotors = [_positive(link, "rotor_inertia") for link in links]
    flange = _after(links[-1])
    return RobotDescription(
        links=_bodies(top, links),
        coupling=_coupling(top, links),
        rotor_inertia=frozen(np.array(rotors)),
        zero=frozen(zero + offset),
        flange=flange,
        payload=_payload(top),
        tool=_vector(top.table("tool", _TOOL), "origin") if "tool" in top else np.zeros(3),
        counterbalance=_counterbalance(top, zero),
        names=tuple(link.text("name", f"axis {j}") for j, link in enumerate(links, start=1)),
        source=(file, data),
    )


def _bodies(top: CheckedTable, links: list[CheckedTable]) -> RigidBodies:
    """Bodies in the frame after Rz(angle): the rest of each transform is constant."""
    after = [_after(link) for link in links]
    base, gravity = _base(top)
    before = [Frame(np.eye(3), np.zeros(3)), *after[:-1]]
    mass = [link.number("mass") for link in links]
    if min(mass) < 0:
        raise links[int(np.argmin(mass))].error(f"mass = {min(mass):g} kg: it must not be negative.")
    centers = [
        f.origin + f.rotation @ _vector(link, "center") for f, link in zip(after, links, strict=True)
    ]
    tensors = [f.rotation @ _tensor(link) @ f.rotation.T for f, link in zip(after, links, strict=True)]
    rotations = [frame.rotation for frame in before]
    rotations[0] = base
    n = len(links)
    return RigidBodies(
        parent=tuple(range(-1, n - 1)),
        rotation=np.array(rotations),
        origin=np.array([frame.origin for frame in before]),
        axis=np.tile([0.0, 0.0, 1.0], (n, 1)),
        sliding=(False,) * n,
        mass=np.array(mass),
        center=np.array(centers),
        inertia=np.array(tensors),
        gravity=np.array([0.0, 0.0, -gravity]),
    )


def _after(link: CheckedTable) -> Frame:
    """Tz(d) Tx(a) Rx(alpha)."""
    alpha = float(np.deg2rad(link.number("alpha_deg")))
    return Frame(_turn("x", alpha), np.array([link.number("a"), 0.0, link.number("d")]))


def _turn(axis: str, angle: float) -> Floats:
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    R = np.eye(3)
    R[j, j] = R[k, k] = np.cos(angle)
    R[k, j], R[j, k] = np.sin(angle), -np.sin(angle)
    return R


def _base(top: CheckedTable) -> tuple[Floats, float]:
    if "base" not in top:
        return np.eye(3), 9.81
    base = top.table("base", _BASE)
    text = base.text("rotation", "x 0 deg")
    if not (match := _TURN.fullmatch(text)):
        raise base.error(
            f'rotation = "{text:.40}": give one axis and an angle. Example: {_BASE["rotation"]}.'
        )
    return _turn(match[1], float(np.deg2rad(float(match[2])))), base.number("gravity", 9.81)


def _coupling(top: CheckedTable, links: list[CheckedTable]) -> Floats:
    if "coupling" not in top:
        ratios = [link.number("gear_ratio") for link in links]
        if not all(ratios):
            raise links[ratios.index(0)].error("gear_ratio is 0: give motor turns per joint turn.")
        return frozen(np.diag(1 / np.array(ratios)))
    for link in links:
        if "gear_ratio" in link:
            raise link.error("gear_ratio and coupling are both given: leave gear_ratio out.")
    C = np.array(top.matrix("coupling"))
    if C.shape != (len(links),) * 2:
        raise top.error(f"coupling has shape {C.shape}: expected {len(links)} rows and columns.")
    if not np.linalg.cond(C) < 1e9:
        raise top.error("coupling is singular: some motion of the motors would move no joint.")
    return frozen(C)


def _payload(top: CheckedTable) -> Payload:
    if "payload" not in top:
        return Payload()
    table = top.table("payload", PAYLOAD_KEYS)
    values = table.values(PAYLOAD_KEYS, required=("mass", "center"))
    with in_place(table.where, table.file):
        return Payload(**values)


def _counterbalance(top: CheckedTable, zero: Floats) -> Counterbalance | None:
    if "counterbalance" not in top:
        return None
    table = top.table("counterbalance", _COUNTERBALANCE)
    joint = table.integer("joint")
    if not 1 <= joint <= zero.size:
        raise table.error(f"joint = {joint}: the robot has joints 1 to {zero.size}.")
    sizes = [key for key in _COUNTERBALANCE if key != "joint"]
    is_given = any(key in table for key in sizes)  # else that of a KUKA KR300
    given = {key: table.number(key) for key in sizes if is_given}
    found = Counterbalance(joint - 1, float(zero[joint - 1]), **given)
    positive = found.anchor_m, found.crank_m, found.area_m2, found.gas_volume_m3
    stroke = 2 * found.crank_m * found.area_m2
    if min(positive) <= 0 or found.crank_m >= found.anchor_m or stroke >= found.gas_volume_m3:
        raise table.error(
            "these sizes do not make a cylinder: all must be positive, the crank shorter than the "
            "anchor's distance, and the gas volume larger than the piston's stroke."
        )
    return found


def _vector(table: CheckedTable, key: str) -> Floats:
    return np.array(_list(table, key, 3))


def _tensor(link: CheckedTable) -> Floats:
    tensor = symmetric_tensor(np.array(_list(link, "inertia", 6)))
    least, size = float(np.linalg.eigvalsh(tensor)[0]), float(np.abs(tensor).max())
    if least < -1e-6 * size:
        raise link.error(
            f"inertia has the negative principal moment {least:g} kg·m²: check the order xx yy zz xy yz "
            "xz and the reference point, the centre of mass."
        )
    return tensor


def _list(table: CheckedTable, key: str, size: int) -> list[float]:
    values = table.numbers(key)
    if len(values) != size:
        raise table.error(f"{key} has {counted(len(values), 'value')}: give {size}.")
    return values


def _positive(link: CheckedTable, key: str) -> float:
    value = link.number(key)
    if value <= 0:
        raise link.error(f"{key} = {value:g}: it must be positive.")
    return value
