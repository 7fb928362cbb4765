"""Robots as MJCF, read as MuJoCo reads them: classes of defaults, units of angles, masses of shapes.

pinocchio's reader of MJCF (4.1) drops joints, mistakes classes for others and ignores ``eulerseq``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from jointid.arrays import Floats, frozen
from jointid.parsing.checked_xml import parse_xml, require_numbers
from jointid.robot_models.description import RobotDescription
from jointid.robot_models.rigid_bodies import Frame, RigidBodies, combined, symmetric_tensor
from jointid.robot_models.xml_checks import (
    gear_ratios,
    require_numeric,
    require_physical,
    require_unique,
    xml_error,
)

_TURNS = {"quat": 4, "euler": 3, "axisangle": 4, "xyaxes": 6, "zaxis": 3}
"""Orientations, and how many numbers each has."""
_FRAME = {name: range(count, count + 1) for name, count in {"pos": 3, **_TURNS}.items()}
_NUMBERS = {
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
_SIZES = {"sphere": 1, "capsule": 2, "ellipsoid": 3, "cylinder": 2, "box": 3}
"""Shapes with a known mass, and how many sizes each has."""
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
_PARTS = {"body", "inertial", "joint", "geom", "site", "camera", "light"}
_ACTUATORS = {"general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle"}
_BEFORE = Frame(np.eye(3), np.zeros(3))

Classes = dict[str, dict[str, dict[str, str]]]
"""Attributes by class and element."""


@dataclass
class _Tree:
    """Bodies on joints, in the order of the file."""

    file: str
    compiler: Mapping[str, str]
    classes: Classes
    joints: list[dict[str, str]] = field(default_factory=list)
    parent: list[int] = field(default_factory=list)
    frames: list[Frame] = field(default_factory=list)
    """Of each joint in the frame of the one before it."""
    parts: list[list[tuple[float, Floats, Floats]]] = field(default_factory=list)
    """Mass, centre and inertia of the bodies that each joint moves, in its frame."""

    def add(self, body: Element, moving: int, before: Frame, inherited: str) -> None:
        """Add a body with those on it, placed in the frame of the joint that moves its parent."""
        name, style = body.get("name", body.tag), body.get("childclass", inherited)
        here = _within(before, self.frame(body.attrib))
        for part in body:
            if part.tag not in _PARTS:
                raise xml_error(
                    self.file,
                    f"body {name}: <{part.tag[:60]}> is not supported: write bodies out, on a fixed "
                    "base.",
                )
        joints = [self.attributes(joint, style) for joint in body.findall("joint")]
        if len(joints) > 1:
            raise xml_error(self.file, f"body {name} has {len(joints)} joints: give each its own body.")
        for joint in joints:
            if joint.get("type", "hinge") not in ("hinge", "slide"):
                raise xml_error(
                    self.file,
                    f"joint {joint.get('name', '')} is {joint['type']}: expected hinge or slide.",
                )
            place = self.numbers(joint, "pos", "0 0 0")
            self.joints.append(joint)
            self.parent.append(moving)
            self.frames.append(_within(here, Frame(np.eye(3), place)))
            self.parts.append([])
            moving, here = len(self.parts) - 1, Frame(np.eye(3), -place)
        if moving >= 0:
            self.parts[moving] += [
                (mass, here.origin + here.rotation @ center, here.rotation @ own @ here.rotation.T)
                for mass, center, own in self.masses(body, name, style)
            ]
        for child in body.findall("body"):
            self.add(child, moving, here, style)

    def masses(self, body: Element, name: str, style: str) -> list[tuple[float, Floats, Floats]]:
        """Mass, centre and inertia of a body's parts in its frame."""
        if (inertial := body.find("inertial")) is not None:
            return [self.stated(inertial, name)]
        if self.compiler.get("inertiafromgeom") == "false":
            return []
        return [self.shape(self.attributes(geom, style), name) for geom in body.findall("geom")]

    def stated(self, inertial: Element, name: str) -> tuple[float, Floats, Floats]:
        """Mass, centre and inertia of an <inertial>."""
        given = inertial.attrib
        if "mass" not in given or not {"diaginertia", "fullinertia"} & given.keys():
            lacks = "no mass" if "mass" not in given else "neither diaginertia nor fullinertia"
            raise xml_error(self.file, f"body {name}: <inertial> has {lacks}.")
        R, center = self.frame(given)
        if "fullinertia" in given:
            tensor = symmetric_tensor(self.numbers(given, "fullinertia")[[0, 1, 2, 3, 5, 4]])
        else:
            tensor = np.diag(self.numbers(given, "diaginertia"))
        return float(given["mass"]), center, R @ tensor @ R.T

    def shape(self, geom: Mapping[str, str], name: str) -> tuple[float, Floats, Floats]:
        """Mass, centre and inertia of a homogeneous shape."""
        kind = geom.get("type", "sphere")
        if "mesh" in geom or kind not in _SIZES or geom.get("shellinertia", "false") != "false":
            raise xml_error(
                self.file,
                f"body {name} has no <inertial>; its mass would follow from a mesh, which is not read, "
                "or from a shell: add <inertial>.",
            )
        R, center = self.frame(geom)
        size, count = self.numbers(geom, "size", "0"), _SIZES[kind]
        if "fromto" in geom:
            first, last = self.numbers(geom, "fromto").reshape(2, 3)
            R, center = _towards(last - first), (first + last) / 2
            size = np.append(size[: count - 1], np.linalg.norm(last - first) / 2)
        if size.size < count or size[:count].min() <= 0:
            raise xml_error(self.file, f"body {name}: <geom> needs {count} positive sizes.")
        volume, squares = _of_unit_mass(kind, size)
        mass = float(geom.get("mass", volume * float(geom.get("density", 1000.0))))
        return mass, center, mass * R @ np.diag(squares) @ R.T

    def attributes(self, element: Element, style: str) -> dict[str, str]:
        """Attributes of an element, with the defaults of its class."""
        name = element.get("class", style)
        if name not in self.classes:
            raise xml_error(self.file, f'<{element.tag}>: the class "{name:.60}" has no <default>.')
        return self.classes[name].get(_kind(element), {}) | element.attrib

    def frame(self, given: Mapping[str, str]) -> Frame:
        """Frame of an element in that around it."""
        unit, R = self.unit, np.eye(3)
        if "quat" in given:
            w, *xyz = self.numbers(given, "quat")
            R = Rotation.from_quat([*xyz, w]).as_matrix()
        elif "euler" in given:
            for letter, angle in zip(
                self.compiler.get("eulerseq", "xyz"), self.numbers(given, "euler"), strict=True
            ):
                turn = Rotation.from_euler(letter.lower(), unit * angle).as_matrix()
                R = R @ turn if letter.islower() else turn @ R
        elif "axisangle" in given:
            *axis, angle = self.numbers(given, "axisangle")
            R = Rotation.from_rotvec(unit * angle * _unit(np.array(axis))).as_matrix()
        elif "xyaxes" in given:
            x, y = self.numbers(given, "xyaxes").reshape(2, 3)
            x = _unit(x)
            y = _unit(y - x * (x @ y))
            R = np.stack([x, y, np.cross(x, y)], axis=1)
        elif "zaxis" in given:
            R = _towards(self.numbers(given, "zaxis"))
        return Frame(R, self.numbers(given, "pos", "0 0 0"))

    @property
    def unit(self) -> float:
        """Radians per unit of an angle."""
        return 1.0 if self.compiler.get("angle") == "radian" else float(np.pi / 180)

    def numbers(self, given: Mapping[str, str], name: str, default: str = "") -> Floats:
        """Numbers of an attribute."""
        return np.array(given.get(name, default).split(), float)

    def bodies(self, gravity: Floats) -> RigidBodies:
        """The bodies, those on one joint as one."""
        masses = [combined(parts) for parts in self.parts]
        return RigidBodies(
            parent=tuple(self.parent),
            rotation=np.array([frame.rotation for frame in self.frames]),
            origin=np.array([frame.origin for frame in self.frames]),
            axis=np.array([_unit(self.numbers(joint, "axis", "0 0 1")) for joint in self.joints]),
            sliding=tuple(joint.get("type") == "slide" for joint in self.joints),
            mass=np.array([mass for mass, _, _ in masses]),
            center=np.array([center for _, center, _ in masses]),
            inertia=np.array([tensor for _, _, tensor in masses]),
            gravity=gravity,
        )


def read_mjcf(file: str, data: bytes) -> RobotDescription:
    """Read a robot from MJCF; gear ratios from the actuators' ``gear``, rotors from ``armature``.

    Raises
    ------
    JointIdError
        When it is no usable MJCF.
    """
    root = parse_xml(file, data, "mujoco")
    for part in root:
        if part.tag == "include":
            raise xml_error(file, "<include>: other files are not read. Insert the included text.")
        if part.tag == "equality" and any(c.tag in ("connect", "weld", "joint") for c in part):
            raise xml_error(
                file, "<equality>: closed loops and coupled joints are not supported. Remove them."
            )
    worlds = root.findall("worldbody")
    if not worlds:
        raise xml_error(file, "<worldbody> is missing: it must hold the robot's bodies.")
    require_numeric(file, root, _NUMBERS)
    for tag in ("joint", "body"):
        require_unique(file, [part for world in worlds for part in world.iter(tag)])
    classes: Classes = {"": {}}
    for top in root.findall("default"):
        _add_class(file, top, {}, classes)
    tree = _Tree(file, _compiler(file, root), classes)
    for world in worlds:
        tree.add(world, -1, _BEFORE, "")
    option = root.find("option")
    gravity = "0 0 -9.81" if option is None else option.get("gravity", "0 0 -9.81")
    names = tuple(joint.get("name", f"joint_{k}") for k, joint in enumerate(tree.joints, start=1))
    coupling = gear_ratios(
        file,
        names,
        ((each.get("joint"), each.get("gear")) for each in (
            tree.attributes(actuator, "") for part in root.findall("actuator") for actuator in part
        )),
    )  # fmt: skip
    links = tree.bodies(np.array(require_numbers(file, "<option gravity>", gravity, range(3, 4))))
    require_physical(file, names, links)
    armature = np.array([float(joint.get("armature", "0")) for joint in tree.joints])
    ref = np.array([float(joint.get("ref", "0")) for joint in tree.joints])
    return RobotDescription(
        links=links,
        coupling=coupling,
        rotor_inertia=frozen(np.full(links.n, np.nan)),
        zero=frozen(np.where(links.sliding, -ref, -tree.unit * ref)),
        names=names,
        armature=frozen(np.where(armature > 0, armature, np.nan)) if armature.any() else None,
        source=(file, data),
    )


def _compiler(file: str, root: Element) -> Mapping[str, str]:
    found = {k: v for part in root.findall("compiler") for k, v in part.attrib.items()}
    for key, value in found.items():
        if key in _IGNORED_COMPILER:
            continue
        if key not in _COMPILER or (_COMPILER[key] and value not in _COMPILER[key]):
            raise xml_error(
                file, f"<compiler {key}> is not supported: save the model with explicit inertias."
            )
    sequence = found.get("eulerseq", "xyz")
    if len(sequence) != 3 or set(sequence.lower()) - set("xyz"):
        raise xml_error(file, f'<compiler eulerseq="{sequence:.20}">: expected three of x, y and z.')
    return found


def _add_class(
    file: str, element: Element, above: dict[str, dict[str, str]], found: Classes, name: str = ""
) -> None:
    """Collect a class of defaults with those in it; each inherits from the one around it."""
    own = {kind: dict(values) for kind, values in (above | found.get(name, {})).items()}
    for part in element:
        if part.tag != "default":
            own[_kind(part)] = own.get(_kind(part), {}) | part.attrib
    found[name] = own
    if not name:
        found[element.get("class", "main")] = own
    for part in element.findall("default"):
        if not part.get("class"):
            raise xml_error(file, "a <default> in another one has no class: name it.")
        _add_class(file, part, own, found, part.get("class", ""))


def _kind(element: Element) -> str:
    """Element whose defaults hold: all actuators share theirs."""
    return "actuator" if element.tag in _ACTUATORS else element.tag


def _within(outer: Frame, inner: Frame) -> Frame:
    """A frame in another one, seen from around that."""
    return Frame(outer.rotation @ inner.rotation, outer.origin + outer.rotation @ inner.origin)


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))


def _towards(z: Floats) -> Floats:
    """The smallest rotation of the z axis to a direction, shape (3, 3)."""
    axis = np.array([-z[1], z[0], 0.0])
    axis = _unit(axis) if np.any(axis) else np.array([1.0, 0.0, 0.0])
    return Rotation.from_rotvec(axis * np.arctan2(np.hypot(z[0], z[1]), z[2])).as_matrix()


def _of_unit_mass(kind: str, size: Floats) -> tuple[float, Floats]:
    """Volume of a shape, m³, and its moments of inertia of unit mass about x, y and z, m²."""
    if kind in ("box", "ellipsoid"):
        square = size[:3] ** 2 * (1 / 3 if kind == "box" else 1 / 5)
        factor = 8.0 if kind == "box" else 4 * np.pi / 3
        return float(factor * size[:3].prod()), square.sum() - square
    r, L = size[0], 0.0 if kind == "sphere" else 2 * size[1]
    tube, balls = np.pi * r**2 * L, 0.0 if kind == "cylinder" else 4 * np.pi / 3 * r**3
    # the half balls of a capsule have their centres of mass 3/8 of the radius beyond its tube
    across = tube * (L**2 / 12 + r**2 / 4) + balls * (0.4 * r**2 + 0.375 * r * L + L**2 / 4)
    along = tube * r**2 / 2 + balls * 0.4 * r**2
    volume = float(tube + balls)
    return volume, np.array([across, across, along]) / volume
