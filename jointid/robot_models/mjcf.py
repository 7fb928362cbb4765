"""Robots as MJCF, read by MuJoCo from text without meshes and file references.

The text is rebuilt from known elements and attributes after the checks here, so that MuJoCo opens no
file.
"""

from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from jointid.arrays import Floats, frozen
from jointid.errors import import_optional
from jointid.parsing.checked_xml import parse_xml
from jointid.robot_models.description import RobotDescription
from jointid.robot_models.rigid_bodies import RigidBodies, combined
from jointid.robot_models.xml_checks import require_joints, require_numeric, require_physical, xml_error

_FRAME = {"pos", "quat", "euler", "axisangle", "xyaxes", "zaxis"}
_NUMBERS = {
    "option": {"gravity"},
    "body": {"gravcomp", *_FRAME},
    "inertial": {"mass", "diaginertia", "fullinertia", *_FRAME},
    "joint": {"pos", "axis", "armature", "ref", "stiffness", "springdamper"},
    "geom": {"size", "mass", "density", "fromto", *_FRAME},
    "general": {"gear"},
}
_TEXTS = {
    "compiler": {"angle", "eulerseq", "inertiafromgeom", "balanceinertia"},
    "default": {"class"},
    "flag": {"gravity"},
    "body": {"name", "childclass"},
    "joint": {"name", "class", "type"},
    "geom": {"class", "type", "mesh", "shellinertia"},
    "general": {"class", "joint"},
}
_READ = {"mujoco", "worldbody", "actuator", *_NUMBERS, *_TEXTS}
_ACTUATORS = {"motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle"}
_IGNORED = {
    "autolimits", "meshdir", "texturedir", "assetdir", "strippath", "discardvisual", "usethread",
    "fusestatic",
}  # fmt: skip
"""Settings of the compiler that do not change the masses."""
_NO_GEAR = 1e-300
"""Gear of an actuator that states none."""
_WITHOUT_MESHES = " Meshes are not read: a body made of meshes needs an <inertial>."


def read_mjcf(file: str, data: bytes) -> RobotDescription:
    """Read a robot from MJCF; gear ratios from the actuators' ``gear``, rotors from ``armature``.

    Raises
    ------
    JointIdError
        When it is no usable MJCF, or MuJoCo is not installed.
    """
    root = parse_xml(file, data, "mujoco")
    _require_readable(file, root)
    plain = _plain(root)
    require_numeric(
        file, plain, {tag: dict.fromkeys(keys, range(1, 7)) for tag, keys in _NUMBERS.items()}
    )
    mujoco = import_optional("mujoco", "mujoco-core", "MJCF files", "robot")
    mujoco.set_mju_user_warning(lambda _: None)  # else MuJoCo writes a log into the current folder
    try:
        model = mujoco.MjModel.from_xml_string(tostring(plain, "unicode"))
    except ValueError as error:
        reason = " ".join(str(error).rpartition(", line")[0].split())
        raise xml_error(
            file,
            f"MuJoCo cannot read this robot: {reason:.200}.{_WITHOUT_MESHES * ('mesh' in reason)}",
        ) from error
    names = tuple(model.joint(j).name or f"joint_{j + 1}" for j in range(model.njnt))
    hinge, slide = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
    for name, kind in zip(names, model.jnt_type, strict=True):
        if kind not in (hinge, slide):
            raise xml_error(file, f"joint {name} must be a hinge or a slide.")
    links = _bodies(mujoco, model, tuple((model.jnt_type == slide).tolist()))
    require_physical(file, names, links)
    if (
        model.jnt_stiffness.any()
        or model.body_gravcomp.any()
        or root.find("tendon/*[@stiffness]") is not None
    ):
        raise xml_error(
            file,
            "springs (stiffness, springdamper) and gravcomp are not supported: remove them if the "
            "motors carry the weight.",
        )
    armature = model.dof_armature
    return RobotDescription(
        links=links,
        coupling=frozen(np.diag(1 / _gears(file, names, model))),
        rotor_inertia=frozen(np.full(links.n, np.nan)),
        zero=frozen(-model.qpos0),
        names=names,
        armature=frozen(np.where(armature > 0, armature, np.nan)) if armature.any() else None,
        source=(file, data),
    )


def _gears(file: str, names: tuple[str, ...], model: Any) -> Floats:
    """Gear ratios that the actuators state, shape (n,); NaN where none does."""
    ratio: Floats = np.full(len(names), np.nan)
    for j, gear in zip(model.actuator_trnid[:, 0].tolist(), model.actuator_gear[:, 0], strict=True):
        if gear == _NO_GEAR:
            continue
        if gear == 0 or (np.isfinite(ratio[j]) and ratio[j] != gear):
            fault = f"actuators with gears {ratio[j]:g} and {gear:g}" if gear else "a gear of 0"
            raise xml_error(
                file, f"joint {names[j]} has {fault}: give one gear, motor turns per joint turn."
            )
        ratio[j] = gear
    return ratio


def _require_readable(file: str, root: Element) -> None:
    """Refuse parts that change the motion or the masses and are not read."""
    if root.find(".//include") is not None:
        raise xml_error(file, "<include>: other files are not read. Insert the included text.")
    if any(root.find(f"equality/{tie}") is not None for tie in ("connect", "weld", "joint")):
        raise xml_error(file, "<equality>: remove closed loops and coupled joints.")
    for key, value in (pair for part in root.findall("compiler") for pair in part.items()):
        usual = key in _TEXTS["compiler"] | _IGNORED and (key, value) != ("inertiafromgeom", "true")
        if not usual and (key, value) != ("coordinate", "local"):
            raise xml_error(
                file, f"<compiler {key}> is not supported: save the model with explicit inertias."
            )
    classes = {part.get("class") for part in root.iter("default")} | {"main"}
    for part in root.iter():
        name = part.get("childclass", part.get("class", "main"))
        if name not in classes:
            raise xml_error(file, f'<{part.tag[:60]}>: the class "{name:.60}" has no <default>.')
    bodies = [body for world in root.findall("worldbody") for body in (world, *world.iter("body"))]
    joints = [len(body.findall("joint")) for body in bodies]
    require_joints(file, sum(joints))
    for body, count in zip(bodies, joints, strict=True):
        name = body.get("name", body.tag)
        known = {"body", "inertial", "joint", "geom", "site", "camera", "light"}
        if unknown := {part.tag for part in body} - known:
            raise xml_error(
                file,
                f"body {name}: <{min(unknown)[:60]}> is not supported: write every body "
                "explicitly and fix the base.",
            )
        if count > 1:
            raise xml_error(file, f"body {name} has {count} joints: give each its own body.")


def _plain(root: Element) -> Element:
    """Copy of the parts of a file that are read; actuators without a gear get ``_NO_GEAR``."""
    plain = _copy(root)
    plain.insert(0, Element("default"))
    SubElement(plain[0], "general", gear=f"{_NO_GEAR}")
    return plain


def _copy(element: Element, *, moved: bool = False) -> Element:
    """Copy of an element with the parts that are read; shapes only where a moving mass needs them."""
    tag = _tag(element)
    known = _TEXTS.get(tag, set()) | _NUMBERS.get(tag, set())
    copy = Element(tag, {key: value for key, value in element.items() if key in known})
    moved |= tag == "body" and element.find("joint") is not None
    shapes = tag == "default" or (moved and element.find("inertial") is None)
    copy.extend(
        _copy(part, moved=moved)
        for part in element
        if _tag(part) in _READ
        and (part.tag != "geom" or shapes)
        and (tag != "actuator" or "joint" in part.attrib)
    )
    if "name" in element.attrib:  # for messages
        for k, shape in enumerate(copy.findall("geom"), start=1):
            shape.set("name", f"{element.get('name')}, shape {k}")
    return copy


def _tag(element: Element) -> str:
    """Tag of an element; all actuators share theirs, as they share defaults."""
    return "general" if element.tag in _ACTUATORS else element.tag


def _bodies(mujoco: Any, model: Any, sliding: tuple[bool, ...]) -> RigidBodies:
    """The bodies of a model, those on one joint as one."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    # Joint that moves each body; -1 is the base, the last of the frames below.
    mover = model.body_jntadr[model.body_weldid]
    R = np.concatenate([data.xmat[model.jnt_bodyid].reshape(-1, 3, 3), np.eye(3)[None]])
    anchor = np.concatenate([data.xanchor, np.zeros((1, 3))])
    parts: list[list[tuple[float, Floats, Floats]]] = [[] for _ in range(model.njnt)]
    for k in np.flatnonzero(mover >= 0):
        j = mover[k]
        turn = R[j].T @ data.ximat[k].reshape(3, 3)
        tensor = turn @ np.diag(model.body_inertia[k]) @ turn.T
        parts[j].append((float(model.body_mass[k]), R[j].T @ (data.xipos[k] - anchor[j]), tensor))
    mass, center, inertia = zip(*map(combined, parts), strict=True)
    parent = mover[model.body_parentid[model.jnt_bodyid]]
    inward, no_gravity = np.swapaxes(R[parent], 1, 2), int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    return RigidBodies(
        parent=tuple(parent.tolist()),
        rotation=inward @ R[:-1],
        origin=np.einsum("nij,nj->ni", inward, anchor[:-1] - anchor[parent]),
        axis=np.array(model.jnt_axis),
        sliding=sliding,
        mass=np.array(mass),
        center=np.array(center),
        inertia=np.array(inertia),
        gravity=np.array(model.opt.gravity) * (not model.opt.disableflags & no_gravity),
    )
