"""Robots as URDF, read by pinocchio from text without shapes and file references.

pinocchio takes an unreadable mass for 0 and ignores unknown elements; the checks here precede it.
"""

from typing import Any
from xml.etree.ElementTree import Element, tostring

import numpy as np

from jointid.arrays import frozen
from jointid.errors import import_optional
from jointid.parsing.checked_xml import parse_xml, require_numbers
from jointid.robot_models.description import RobotDescription
from jointid.robot_models.rigid_bodies import RigidBodies
from jointid.robot_models.xml_checks import (
    require_joints,
    require_numeric,
    require_physical,
    require_unique,
    xml_error,
)
from jointid.wording import counted, listed

_TENSOR = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_NUMBERS = {
    "origin": {"xyz": range(3, 4), "rpy": range(3, 4)},
    "axis": {"xyz": range(3, 4)},
    "mass": {"value": range(1, 2)},
    "inertia": dict.fromkeys(_TENSOR, range(1, 2)),
}
_ONCE = ("inertial", "origin", "mass", "inertia", "axis", "parent", "child")
_JOINTS = ("revolute", "continuous", "prismatic", "fixed")


def read_urdf(file: str, data: bytes) -> RobotDescription:
    """Read a robot from URDF; gear ratios from transmissions, rotor inertias are unknown.

    Raises
    ------
    JointIdError
        When it is no usable URDF, or pinocchio is not installed.
    """
    root = parse_xml(file, data, "robot")
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    _require_urdf(file, root)
    pin = import_optional("pinocchio", "pin", "URDF files", "robot")
    try:
        model = pin.buildModelFromXML(tostring(root, "unicode"))
    except Exception as error:  # pinocchio passes on any exception of its C++ libraries
        reason = str(error).split("message:")[-1].strip()
        raise xml_error(file, f"pinocchio cannot read this robot: {reason:.200}.") from error
    names = tuple(model.names)[1:]
    require_joints(file, len(names))
    gears, links = _gears(file, root), _bodies(pin, model)
    require_physical(file, names, links)
    return RobotDescription(
        links=links,
        coupling=frozen(np.diag([1 / gears.get(name, np.nan) for name in names])),
        rotor_inertia=frozen(np.full(links.n, np.nan)),
        zero=frozen(np.zeros(links.n)),
        names=names,
        source=(file, data),
    )


def _require_urdf(file: str, root: Element) -> None:
    _require_spelling(file, root)
    links = [link.get("name", "") for link in root.findall("link")]
    joints = root.findall("joint")
    require_unique(file, joints)
    require_unique(file, root.findall("link"))
    require_numeric(file, root, _NUMBERS)
    for joint in joints:
        name, kind = joint.get("name", ""), joint.get("type", "")
        if kind not in _JOINTS:
            raise xml_error(
                file, f"joint {name} is {kind or 'without a type'}: expected {listed(_JOINTS)}."
            )
        if joint.find("mimic") is not None:
            raise xml_error(file, f"joint {name} mimics another joint: remove it, or make it fixed.")
        axis = joint.find("axis")
        if axis is not None and not any(map(float, axis.get("xyz", "0 0 0").split())):
            raise xml_error(file, f"joint {name} has the axis 0 0 0: give its direction.")
        for role in ("parent", "child"):
            end = joint.find(role)
            linked = "" if end is None else end.get("link", "")
            if linked not in links:
                raise xml_error(
                    file,
                    f'joint {name}: its {role} link "{linked}" is not defined. Links: {listed(links)}.',
                )
    children = [end.get("link", "") for joint in joints for end in joint.findall("child")]
    roots = [link for link in links if link not in children]
    if len(roots) != 1 or len(set(children)) < len(children):
        raise xml_error(
            file,
            f"{counted(len(roots), 'link')} without a parent ({listed(roots)}): every link but one, the "
            "base, must be the child of one joint.",
        )
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is not None:
            mass, tensor = inertial.find("mass"), inertial.find("inertia")
            if (
                mass is None
                or tensor is None
                or "value" not in mass.attrib
                or set(_TENSOR) - set(tensor.attrib)
            ):
                raise xml_error(
                    file, f"link {link.get('name')}: <inertial> needs mass and all six inertias."
                )


def _require_spelling(file: str, root: Element) -> None:
    """Refuse parts that pinocchio ignores: macros, other spellings, repeated parts."""
    for part in root.iter():
        known = part.tag.lower()
        if known.startswith("xacro:"):
            raise xml_error(file, f"<{part.tag:.60}> is a macro: convert the file with xacro first.")
        if known in (*_ONCE, "link", "joint") and part.tag != known:
            raise xml_error(file, f"<{part.tag}>: the elements of URDF are lower-case, <{known}>.")
        if part.tag in ("origin", "axis") and (extra := set(part.attrib) - {"xyz", "rpy"}):
            raise xml_error(file, f"<{part.tag} {min(extra):.60}> is not supported: give xyz and rpy.")
    if root.find("gravity") is not None:
        raise xml_error(
            file,
            "<gravity> is not part of URDF: its gravity is always 9.81 m/s² along -z. Use MJCF or TOML.",
        )
    for part in [*root.findall("link"), *root.findall("joint")]:
        if inner := [*part.findall("link"), *part.findall("joint")]:
            name = f'<{inner[0].tag} name="{inner[0].get("name", ""):.60}">'
            raise xml_error(file, f"{name} is inside a {part.tag}: move it directly into <robot>.")
    for part in [*root.findall("link"), *root.findall("link/inertial"), *root.findall("joint")]:
        for tag in _ONCE:
            if len(part.findall(tag)) > 1:
                name = f"{part.tag} {part.get('name', '')}".rstrip()
                raise xml_error(file, f"{name}: expected one <{tag}>, got several.")


def _gears(file: str, root: Element) -> dict[str, float]:
    """Gear ratios that are stated, by joint."""
    found: dict[str, float] = {}
    for part in root.iter("transmission"):
        if len(joints := part.findall("joint")) == 1:
            name = joints[0].get("name", "")
            for each in part.iter("mechanicalReduction"):
                place = f"gear ratio of joint {name}"
                ratio = require_numbers(file, place, each.text or "", range(1, 7))[0]
                if ratio == 0 or found.setdefault(name, ratio) != ratio:
                    other = f" and {found[name]:g}" if ratio else ""
                    raise xml_error(
                        file, f"{place} is {ratio:g}{other}: give one, motor turns per joint turn."
                    )
    return found


def _bodies(pin: Any, model: Any) -> RigidBodies:
    data, neutral = model.createData(), pin.neutral(model)
    axes, sliding = [], []
    for j in range(1, model.njoints):
        # one column comes without its axis
        columns = pin.computeJointJacobian(model, data, neutral, j).reshape(6, -1)
        column = columns[:, model.joints[j].idx_v]
        sliding.append(bool(np.any(column[:3])))
        axes.append(column[:3] if sliding[-1] else column[3:])
    bodies = list(model.inertias)[1:]
    placed = list(model.jointPlacements)[1:]
    return RigidBodies(
        parent=tuple(int(p) - 1 for p in list(model.parents)[1:]),
        rotation=np.array([place.rotation for place in placed]),
        origin=np.array([place.translation for place in placed]),
        axis=np.array(axes),
        sliding=tuple(sliding),
        mass=np.array([body.mass for body in bodies]),
        center=np.array([body.lever for body in bodies]),
        inertia=np.array([body.inertia for body in bodies]),
        gravity=np.array(model.gravity.linear),
    )
