"""Robots as URDF or MJCF, read by pinocchio from text without shapes and file references.

pinocchio takes an unreadable mass for 0 and ignores unknown elements; the checks here precede it.
"""

import os
from collections.abc import Iterator
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree.ElementTree import Element, tostring

import numpy as np

from jointid.arrays import Floats, frozen
from jointid.errors import JointIdError, import_optional
from jointid.parsing.checked_xml import parse_xml, require_numbers
from jointid.robot_models.description import RobotDescription
from jointid.robot_models.rigid_bodies import RigidBodies
from jointid.wording import counted, listed

_MOST_JOINTS = 64
_TENSOR = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_URDF_NUMBERS = {
    "origin": {"xyz": range(3, 4), "rpy": range(3, 4)},
    "axis": {"xyz": range(3, 4)},
    "mass": {"value": range(1, 2)},
    "inertia": dict.fromkeys(_TENSOR, range(1, 2)),
}
_URDF_JOINTS = ("revolute", "continuous", "prismatic", "fixed")
_FRAME = {
    "pos": range(3, 4),
    "quat": range(4, 5),
    "euler": range(3, 4),
    "axisangle": range(4, 5),
    "xyaxes": range(6, 7),
    "zaxis": range(3, 4),
}
_MJCF_NUMBERS = {
    "body": _FRAME,
    "inertial": {
        **_FRAME, "mass": range(1, 2), "diaginertia": range(3, 4), "fullinertia": range(6, 7),
    },
    "joint": {"pos": range(3, 4), "axis": range(3, 4), "armature": range(1, 2), "ref": range(1, 2)},
    "geom": {
        **_FRAME, "size": range(1, 4), "mass": range(1, 2), "density": range(1, 2), 
        "fromto": range(6, 7),
    },
}  # fmt: skip
_SHAPES = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
_SKIPPED = {"site", "camera", "light", "geom"}
_COMPILER = {
    "inertiafromgeom": ("auto", "false"),
    "angle": ("degree", "radian"),
    "coordinate": ("local",),
    "eulerseq": (),
    "autolimits": (),
}
"""Supported settings; empty: any value."""
_IGNORED_COMPILER = {
    "meshdir", "texturedir", "assetdir", "strippath", "discardvisual", "usethread", "fusestatic",
}  # fmt: skip


def read_urdf(file: str, data: bytes) -> RobotDescription:
    """Read a robot from URDF; gear ratios from transmissions, rotor inertias are unknown.

    Raises JointIdError when it is no usable URDF, or pinocchio is not installed.
    """
    root = parse_xml(file, data, "robot")
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    _require_urdf(file, root)
    return _described(file, data, root, _gears(file, root, "transmission"))


def read_mjcf(file: str, data: bytes) -> RobotDescription:
    """Read a robot from MJCF; gear ratios from the actuators' ``gear``, rotors from ``armature``.

    Raises JointIdError when it is no usable MJCF, or pinocchio is not installed.
    """
    root = parse_xml(file, data, "mujoco")
    plain = Element("mujoco")
    for part in root:
        if part.tag == "include":
            raise _error(file, "<include>: other files are not read. Insert the included text.")
        if part.tag == "equality" and any(c.tag in ("connect", "weld", "joint") for c in part):
            raise _error(
                file, "<equality>: closed loops and coupled joints are not supported. Remove them."
            )
        if part.tag == "compiler":
            _require_compiler(file, part)
        if part.tag in ("compiler", "default", "worldbody"):
            plain.append(part)
    if plain.find("worldbody") is None:
        raise _error(file, "<worldbody> is missing: it must hold the robot's bodies.")
    _require_numbers(file, plain, _MJCF_NUMBERS)
    world = plain.findall("worldbody")
    for place in world:
        for part in [part for part in place if part.tag in _SKIPPED]:
            place.remove(part)
    for body in [*world, *plain.iter("body")]:
        _require_body(file, body)
    _require_unique(file, [joint for place in world for joint in place.iter("joint")])
    _require_unique(file, [body for place in world for body in place.iter("body")])
    option = root.find("option")
    gravity = "0 0 -9.81" if option is None else option.get("gravity", "0 0 -9.81")
    down = require_numbers(file, "<option gravity>", gravity, range(3, 4))
    return _described(file, data, plain, _gears(file, root, "actuator"), gravity=np.array(down))


def _require_urdf(file: str, root: Element) -> None:
    links = [link.get("name", "") for link in root.findall("link")]
    joints = root.findall("joint")
    _require_unique(file, joints)
    _require_unique(file, root.findall("link"))
    _require_numbers(file, root, _URDF_NUMBERS)
    for joint in joints:
        name, kind = joint.get("name", ""), joint.get("type", "")
        if kind not in _URDF_JOINTS:
            raise _error(
                file, f"joint {name} is {kind or 'without a type'}: expected {listed(_URDF_JOINTS)}."
            )
        if joint.find("mimic") is not None:
            raise _error(file, f"joint {name} mimics another joint: remove it, or make it fixed.")
        axis = joint.find("axis")
        if axis is not None and not any(map(float, axis.get("xyz", "1 0 0").split())):
            raise _error(file, f"joint {name} has the axis 0 0 0: give its direction.")
        for role in ("parent", "child"):
            end = joint.find(role)
            linked = "" if end is None else end.get("link", "")
            if linked not in links:
                raise _error(
                    file,
                    f'joint {name}: its {role} link "{linked}" is not defined. Links: {listed(links)}.',
                )
    children = [end.get("link", "") for joint in joints for end in joint.findall("child")]
    roots = [link for link in links if link not in children]
    if len(roots) != 1 or len(set(children)) < len(children):
        raise _error(
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
                raise _error(
                    file, f"link {link.get('name')}: <inertial> needs mass and all six inertias."
                )


def _require_unique(file: str, parts: list[Element]) -> None:
    names = [part.get("name") for part in parts]
    for part, name in zip(parts, names, strict=True):
        if name is not None and names.count(name) > 1:
            raise _error(file, f'two elements <{part.tag}> have the name "{name:.60}": rename one.')


def _require_numbers(file: str, root: Element, known: dict[str, dict[str, range]]) -> None:
    """Refuse attributes that are not numbers, and negative masses."""
    for owner in root.iter():
        for part in owner:
            for key, count in known.get(part.tag, {}).items():
                if (text := part.get(key)) is None:
                    continue
                name = part.get("name") or owner.get("name") or ""
                place = f"<{part.tag}> of {name}, {key}" if name else f"<{part.tag}>, {key}"
                values = require_numbers(file, place, text, count)
                if (key in ("mass", "density", "armature") or part.tag == "mass") and values[0] < 0:
                    raise _error(file, f"{place} = {values[0]:g}: it must not be negative.")
                if key in ("axis", "quat") and not any(values):
                    raise _error(file, f"{place} is zero: give a direction.")


def _require_compiler(file: str, compiler: Element) -> None:
    for key in _IGNORED_COMPILER & compiler.attrib.keys():
        del compiler.attrib[key]
    for key, value in compiler.attrib.items():
        if key not in _COMPILER or (_COMPILER[key] and value not in _COMPILER[key]):
            raise _error(
                file, f"<compiler {key}> is not supported: save the model with explicit inertias."
            )
    compiler.attrib.pop("inertiafromgeom", None)


def _require_body(file: str, body: Element) -> None:
    name = body.get("name", body.tag)
    known = {"body", "inertial", "joint"} | _SKIPPED
    for part in body:
        if part.tag not in known:
            raise _error(
                file,
                f"body {name}: <{part.tag[:60]}> is not supported: write bodies out, on a fixed base.",
            )
    joints = body.findall("joint")
    if len(joints) > 1:
        raise _error(file, f"body {name} has {len(joints)} joints: give each its own body.")
    for joint in joints:
        if joint.get("type", "hinge") not in ("hinge", "slide"):
            raise _error(
                file, f"joint {joint.get('name', '')} is {joint.get('type')}: expected hinge or slide."
            )
    inertial = body.find("inertial")
    if inertial is not None and "mass" not in inertial.attrib:
        raise _error(file, f"body {name}: <inertial> has no mass.")
    for geom in body.findall("geom"):
        if inertial is not None:
            body.remove(geom)  # its inertia is stated
        elif "mesh" in geom.attrib or geom.get("type", "sphere") not in _SHAPES:
            raise _error(
                file,
                f"body {name} has no <inertial>; its mass would follow from a mesh, which is not read: "
                "add <inertial>.",
            )


def _gears(file: str, root: Element, tag: str) -> Iterator[tuple[str, float]]:
    """Gear ratio of every joint that states one."""
    for part in root.iter(tag):
        found: list[tuple[str | None, str | None]] = []
        if tag == "actuator":
            found = [(a.get("joint"), a.get("gear")) for a in part]
        elif len(joints := part.findall("joint")) == 1:
            found = [(joints[0].get("name"), e.text) for e in part.iter("mechanicalReduction")]
        for joint, text in found:
            if joint is not None and text is not None:
                place = f"gear ratio of joint {joint}"
                ratio = require_numbers(file, place, text, range(1, 7))[0]
                if ratio == 0:
                    raise _error(file, f"{place} is 0: give motor turns per joint turn.")
                yield joint, ratio


def _described(
    file: str,
    data: bytes,
    root: Element,
    gears: Iterator[tuple[str, float]],
    *,
    gravity: Floats | None = None,
) -> RobotDescription:
    """Robot of a cleaned document."""
    pin = import_optional("pinocchio", "pin", "URDF and MJCF", "robot")
    text = tostring(root, "unicode")
    try:
        if root.tag == "robot":
            model = pin.buildModelFromXML(text)
        else:
            with TemporaryDirectory() as folder:  # pinocchio reads MJCF from a file only
                path = os.path.join(folder, "robot.xml")
                with open(path, "w", encoding="utf-8") as stream:
                    stream.write(text)
                model = pin.buildModelFromMJCF(path)
    except Exception as error:  # pinocchio raises what its C++ libraries raise
        reason = str(error).split("message:")[-1].split("/tmp")[-1].strip()
        raise _error(file, f"pinocchio cannot read this robot: {reason:.200}.") from error
    names = tuple(model.names)[1:]
    if not 1 <= len(names) <= _MOST_JOINTS:
        raise _error(
            file,
            f"the robot has {counted(len(names), 'moving joint')}: 1 to {_MOST_JOINTS} can be used.",
        )
    stated = dict(gears)
    unknown = np.full(len(names), np.nan)
    armature = np.array(model.armature)
    return RobotDescription(
        links=_bodies(file, pin, model, gravity),
        coupling=frozen(np.diag([1 / stated.get(name, np.nan) for name in names])),
        rotor_inertia=frozen(unknown),
        zero=frozen(np.zeros(len(names))),
        names=names,
        armature=frozen(np.where(armature > 0, armature, np.nan)) if armature.any() else None,
        source=(file, data),
    )


def _bodies(file: str, pin: Any, model: Any, gravity: Floats | None) -> RigidBodies:
    data, neutral = model.createData(), pin.neutral(model)
    axes, sliding = [], []
    for j in range(1, model.njoints):
        if model.joints[j].nv != 1:
            raise _error(
                file,
                f"joint {model.names[j]} has {model.joints[j].nv} degrees of freedom: one is expected.",
            )
        # one column comes without its axis
        columns = pin.computeJointJacobian(model, data, neutral, j).reshape(6, -1)
        column = columns[:, model.joints[j].idx_v]
        sliding.append(bool(np.any(column[:3])))
        axes.append(column[:3] if sliding[-1] else column[3:])
        moments = np.linalg.eigvalsh(model.inertias[j].inertia)
        if moments[0] < -1e-6 * np.abs(moments).max():
            raise _error(
                file,
                f"the bodies moved by joint {model.names[j]} have the negative principal moment "
                f"{moments[0]:g} kg·m²: check its inertias.",
            )
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
        gravity=np.array(model.gravity.linear) if gravity is None else gravity,
    )


def _error(file: str, message: str) -> JointIdError:
    return JointIdError(f"{file}: {message}", file=file)
