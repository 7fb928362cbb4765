"""Elastic joints as snippets for robot simulators, on the joint side of the gears.

A motor shaft turns N times its joint, so on the joint side

    K_arm = N² K,   D_arm = N² D,   rotor inertia N² J_m,   F_c,arm = |N| F_c,   F_v,arm = N² F_v.

An elastic joint is two hinges in series about one axis: the driven one of the motor, with the rotor and
its friction, and the one of the spring, with stiffness and damping.
"""

import re
from typing import NamedTuple
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np
from numpy.typing import ArrayLike

from jointid.analysis import NOT_USABLE, Analysis
from jointid.answer import laws_text
from jointid.arrays import Floats, per_joint
from jointid.errors import JointIdError
from jointid.exporting.identification import answer_text, origin_text
from jointid.wording import UNDETERMINED, printable


class ArmSide(NamedTuple):
    """An identification on the joint side of the gears; every value has the shape (n,), M2 (n, n)."""

    gear_ratio: Floats
    """Motor turns per joint turn, negative where the motor turns the other way."""
    K: Floats
    """Stiffness, N·m/rad; of a nonlinear gear the secant stiffness at the largest torque tried."""
    D: Floats
    """Damping, N·m·s/rad."""
    rotor: Floats
    """Reflected rotor inertias, kg·m²."""
    M2: Floats
    """Arm inertia matrix of records without a pose, kg·m²."""
    coulomb: Floats
    """Coulomb friction of the motors, N·m; 0 where it was not fitted."""
    viscous: Floats
    """Viscous friction of the motors, N·m·s/rad; 0 where it was not fitted."""


def arm_side(analysis: Analysis, gear_ratio: ArrayLike) -> ArmSide:
    """Reflect an identification to the joint side; fitted values of an unusable answer are NaN.

    ``gear_ratio`` holds motor turns per joint turn; a single number holds for all joints.

    Raises JointIdError when there is not one ratio per joint, or one is zero.
    """
    fit, inertia = analysis.fit, analysis.inertia()
    N = per_joint("gear_ratio", gear_ratio, fit.n)
    if np.any(N == 0):
        raise JointIdError(
            f"gear_ratio of joint {int(np.argmin(np.abs(N))) + 1} is 0: give motor turns per joint turn."
        )
    friction = [0.0, 0.0] if fit.friction is None else [fit.friction.coulomb, fit.friction.viscous]
    # A small negative friction is noise; simulators refuse it.
    coulomb, viscous = (np.maximum(np.zeros(fit.n), each) for each in friction)
    K = fit.K.copy()
    for j, gear in enumerate(fit.gears):
        if gear.kind != "linear":
            K[j] = gear.secant_K
    usable = np.nan if analysis.state == NOT_USABLE else 1.0
    return ArmSide(
        gear_ratio=N,
        K=usable * N**2 * K,
        D=usable * N**2 * fit.elasticity.D,
        rotor=usable * N**2 * inertia.M,
        M2=usable * N[:, None] * inertia.M2 * N,
        coulomb=usable * np.abs(N) * coulomb,
        viscous=usable * N**2 * viscous,
    )


def mujoco_snippet(analysis: Analysis, gear_ratio: ArrayLike) -> str:
    """Hinges, armatures and actuators for MuJoCo.

    ``gear_ratio`` holds motor turns per joint turn. Returns XML that MuJoCo loads: each joint on its
    own, with the two hinges of its link's body, and the motors. The actuators' inputs are motor torques.

    Raises JointIdError as in ``arm_side``.
    """
    arm = arm_side(analysis, gear_ratio)
    root = Element("mujoco", model="elastic_joints")
    world, actuators = _add(root, "worldbody"), _add(root, "actuator")
    for j in range(analysis.fit.n):
        name = f"joint{j + 1}"
        body = _add(world, "body", name=f"{name}_link")
        body.append(Comment(" Both hinges belong to the body of the link: their angles add up. "))
        hinge = {"type": "hinge", "axis": "0 0 1"}
        motor = {"armature": arm.rotor[j], "damping": arm.viscous[j], "frictionloss": arm.coulomb[j]}
        spring = {"stiffness": arm.K[j], "springref": 0, "damping": arm.D[j]}
        _add(body, "joint", name=f"{name}_motor", **hinge, **motor)
        _add(body, "joint", name=f"{name}_spring", **hinge, **spring)
        about = " ".join(3 * [_text(arm.M2[j, j])])
        _add(body, "inertial", pos="0 0 0", mass=_LINK_MASS_KG, diaginertia=about)
        gear = arm.gear_ratio[j]
        _add(actuators, "motor", name=f"{name}_torque", joint=f"{name}_motor", gear=gear)
    return _document(analysis, arm, _NESTING_NOTE, root)


def urdf_snippet(analysis: Analysis, gear_ratio: ArrayLike) -> str:
    """Joints, rotor links and transmissions for URDF, stiffness in Gazebo's extension.

    Parameters and errors as in ``mujoco_snippet``. URDF itself has no spring.
    """
    arm = arm_side(analysis, gear_ratio)
    root = Element("robot", name="elastic_joints")
    _add(root, "link", name=_BASE)
    for j in range(analysis.fit.n):
        name = f"joint{j + 1}"
        motor, spring = hinges = _hinges(arm, name, j)
        for hinge in hinges:
            inertial = _add(_add(root, "link", name=hinge.child), "inertial")
            _add(inertial, "mass", value=hinge.mass)
            _add(inertial, "inertia", **dict.fromkeys(_DIAGONAL, hinge.inertia), ixy=0, ixz=0, iyz=0)
            joint = _add(root, "joint", name=hinge.name, type="continuous")
            _add(joint, "parent", link=hinge.parent)
            _add(joint, "child", link=hinge.child)
            _add(joint, "axis", xyz="0 0 1")
            _add(joint, "dynamics", damping=hinge.damping, friction=hinge.friction)
        gazebo = _add(root, "gazebo", reference=spring.name)
        _add_texts(gazebo, springReference=0, springStiffness=spring.stiffness)
        transmission = _add(root, "transmission", name=f"{name}_transmission")
        _add(transmission, "type", "transmission_interface/SimpleTransmission")
        _add(transmission, "joint", name=motor.name)
        actuator = _add(transmission, "actuator", name=f"{name}_actuator")
        _add(actuator, "mechanicalReduction", arm.gear_ratio[j])
    return _document(analysis, arm, _ROTOR_NOTE, root)


def sdf_snippet(analysis: Analysis, gear_ratio: ArrayLike) -> str:
    """Joints and rotor links for SDFormat (Gazebo); parameters and errors as in ``mujoco_snippet``.

    SDFormat joints take joint-side torques: multiply a motor torque by the gear ratio.
    """
    arm = arm_side(analysis, gear_ratio)
    root = Element("sdf", version="1.9")
    model = _add(root, "model", name="elastic_joints")
    _add(model, "link", name=_BASE)
    fixed = _add(model, "joint", name=f"{_BASE}_fixed", type="fixed")
    _add_texts(fixed, parent="world", child=_BASE)
    for j in range(analysis.fit.n):
        name = f"joint{j + 1}"
        for hinge in _hinges(arm, name, j):
            inertial = _add(_add(model, "link", name=hinge.child), "inertial")
            _add_texts(inertial, mass=hinge.mass)
            _add_texts(_add(inertial, "inertia"), **dict.fromkeys(_DIAGONAL, hinge.inertia))
            joint = _add(model, "joint", name=hinge.name, type="continuous")
            _add_texts(joint, parent=hinge.parent, child=hinge.child)
            axis = _add(joint, "axis")
            _add_texts(axis, xyz="0 0 1")
            dynamics = _add(axis, "dynamics")
            _add_texts(dynamics, damping=hinge.damping, friction=hinge.friction)
            if hinge.stiffness:
                _add_texts(dynamics, spring_reference=0, spring_stiffness=hinge.stiffness)
    return _document(analysis, arm, _ROTOR_NOTE, root)


_BASE = "elastic_joints_base"
_LINK_MASS_KG = 1.0
"""Placeholder: the links' own masses take its place."""
_ROTOR_MASS_KG = 1e-3
"""Simulators refuse links without mass."""
_FRAGMENT_NOTE = """\
<!-- This file can be loaded for inspection: each joint is attached to the base, and its link has the
     arm inertia J_a of this pose, without couplings J_12. For a model of the arm, copy the joints, nest
     the links like those of the arm, and replace J_a and the 1 kg by their masses and inertias. -->"""
_NESTING_NOTE = """\
<!-- Nest the bodies like those of your arm. If motor 2 turns link 2 relative to link 1 (serial drive),
     keep the hinges; a parallelogram drive turns link 2 relative to the base. -->"""
_ROTOR_NOTE = """\
<!-- The rotor link carries the rotor inertia reflected to the joint side. As a separate body it also
     turns with its parent. That is exact for a joint on the base and for parallelogram drives, but adds
     too much inertia for a motor on a moving link: use MuJoCo's armature there. The mass of the rotor
     is a placeholder, because simulators refuse links without mass. -->"""


_DIAGONAL = ("ixx", "iyy", "izz")


class _Hinge(NamedTuple):
    """A hinge between two links of URDF and SDFormat, with mass and inertia of the second one."""

    name: str
    parent: str
    child: str
    mass: float
    inertia: float
    damping: float
    friction: float = 0.0
    stiffness: float = 0.0


def _hinges(arm: ArmSide, name: str, j: int) -> tuple[_Hinge, _Hinge]:
    """The motor's hinge with its rotor, and the spring's with the link."""
    rotor = f"{name}_rotor", _ROTOR_MASS_KG, arm.rotor[j]
    link = f"{name}_link", _LINK_MASS_KG, arm.M2[j, j]
    motor = _Hinge(f"{name}_motor", _BASE, *rotor, arm.viscous[j], arm.coulomb[j])
    return motor, _Hinge(f"{name}_spring", rotor[0], *link, arm.D[j], stiffness=arm.K[j])


def _add(parent: Element, tag: str, text: str | float = "", /, **attributes: str | float) -> Element:
    element = SubElement(parent, tag, {name: _text(value) for name, value in attributes.items()})
    element.text = _text(text)
    return element


def _add_texts(element: Element, /, **texts: str | float) -> None:
    for tag, text in texts.items():
        _add(element, tag, text)


def _text(value: str | float) -> str:
    """Text as it is, a number with all its digits."""
    return value if isinstance(value, str) else repr(float(value))


def _document(analysis: Analysis, arm: ArmSide, note: str, root: Element) -> str:
    """The XML of a snippet below its comments."""
    indent(root)
    lines = [*_heading(analysis, arm), _FRAGMENT_NOTE, note, tostring(root, "unicode"), ""]
    return "\n".join(lines)


def _heading(analysis: Analysis, arm: ArmSide) -> list[str]:
    """State of the answer, source, units and side of the numbers, as an XML comment."""
    fit, study = analysis.fit, analysis.study
    ratios = ", ".join(_text(value) for value in arm.gear_ratio)
    lines = [
        f"<!-- {_comment(answer_text(analysis))}",
        f"     Elastic joints of {_comment(study.name or 'a study')}, by",
        f"     {_comment(origin_text(analysis))}.",
        f"     Joint side, SI units: gear ratios N = {ratios} are applied, K_joint = N^2 K, D_joint = "
        f"N^2 D,",
        "     rotor inertia N^2 J_m, Coulomb friction |N| F_c, viscous friction N^2 F_v.",
    ]
    for j, J_m in enumerate(analysis.inertia().M if analysis.state != NOT_USABLE else ()):
        lines.append(
            f"     Joint {j + 1}, motor side: K = {_text(fit.K[j])} N.m/rad {_error(fit.errors.K[j])}, "
            f"D = {_text(fit.D[j])} N.m.s/rad {_error(fit.errors.D[j])}, J_m = {_text(J_m)} kg.m^2."
        )
        gear = fit.gears[j]
        if gear.kind != "linear":
            lines.append(
                f"     Its gear is nonlinear ({laws_text(gear.laws)}), and this format has linear "
                f"springs only: the file contains the secant stiffness {_text(gear.secant_K)} N.m/rad "
                f"at {gear.tried_Nm:.3g} N.m (motor side, without backlash), not the tangent stiffness "
                "K above."
            )
    fitted = any(row.is_fitted for row in analysis.priors)
    lines.append(f"     Inertias are those {'fitted together with K and D' if fitted else 'given'}.")
    if fit.friction is None:
        lines.append("     Friction was not identified and is 0 here.")
    lines[-1] += " -->"
    return lines


def _error(error: float) -> str:
    return f"(+- {error:.2g})" if np.isfinite(error) else f"({UNDETERMINED} by these records)"


def _comment(text: str) -> str:
    """Text that is valid in an XML comment."""
    return re.sub("-(?=-)", "- ", printable(text))
