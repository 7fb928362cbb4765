"""Snippets for robot simulators, with the gear ratio applied.

Simulators see the joints from the arm. A motor shaft turns N times its joint, so on the arm side

    K_arm = N² K,   D_arm = N² D,   rotor inertia N² J_m,   F_c,arm = |N| F_c,   F_v,arm = N² F_v.

An elastic joint is two hinges about the same axis in series: the motor's, which is driven and carries
the rotor and its friction, then the spring's, which carries stiffness and damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array
from jointid.errors import JointIdError
from jointid.exporting.identification import Identification
from jointid.wording import counted


@dataclass(frozen=True, eq=False)
class ArmSide:
    """An identification as the arm sees it."""

    gear_ratio: Floats
    """Motor turns per joint turn, negative where the motor turns the other way, shape (n,)."""
    K: Floats
    """Stiffness, shape (n,), N·m/rad."""
    D: Floats
    """Damping, shape (n,), N·m·s/rad."""
    covariance: Floats
    """Of K1 ... Kn, D1 ... Dn, shape (2n, 2n)."""
    rotor: Floats
    """Reflected rotor inertias, shape (n,), kg·m²."""
    M2: Floats
    """Arm inertia matrix in the pose of ``inertia``, shape (n, n), kg·m²."""
    coulomb: Floats
    """Coulomb friction of the motors, shape (n,), N·m; 0 where it was not fitted."""
    viscous: Floats
    """Viscous friction of the motors, shape (n,), N·m·s/rad; 0 where it was not fitted."""

    @property
    def standard_error(self) -> Floats:
        """Of K1 ... Kn, D1 ... Dn, shape (2n,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def arm_side(identification: Identification, gear_ratio: ArrayLike) -> ArmSide:
    """Carry an identification through the gears.

    Parameters
    ----------
    identification : Identification
        Motor side.
    gear_ratio : array_like, shape (n,)
        Motor turns per joint turn; a single number holds for all joints.

    Raises
    ------
    JointIdError
        When there is not one ratio per joint, or one is zero.
    """
    i = identification
    ratio = finite_array("gear_ratio (motor turns per joint turn)", np.atleast_1d(gear_ratio), ndim=1)
    if ratio.size not in (1, i.n):
        raise JointIdError(
            f"gear_ratio has {counted(ratio.size, 'value')}: give one, or one per joint ({i.n})."
        )
    N = np.array(np.broadcast_to(ratio, (i.n,)))
    if np.any(N == 0):
        raise JointIdError(f"gear_ratio of joint {int(np.argmin(np.abs(N))) + 1} is 0: it must not be.")
    twice = np.concatenate([N**2, N**2])
    none = np.zeros(i.n)
    # A small negative friction is noise; no simulator takes it.
    friction = [none, none] if i.friction is None else [i.friction.coulomb, i.friction.viscous]
    return ArmSide(
        gear_ratio=N,
        K=N**2 * i.elasticity.K,
        D=N**2 * i.elasticity.D,
        covariance=twice[:, None] * i.covariance * twice,
        rotor=N**2 * i.inertia.M,
        M2=N[:, None] * i.inertia.M2 * N,
        coulomb=np.abs(N) * np.maximum(friction[0], 0.0),
        viscous=N**2 * np.maximum(friction[1], 0.0),
    )


def mujoco_snippet(
    identification: Identification, gear_ratio: ArrayLike, names: Sequence[str] | None = None
) -> str:
    """Hinges, armatures and actuators for MuJoCo.

    Parameters
    ----------
    identification : Identification
    gear_ratio : array_like, shape (n,)
        Motor turns per joint turn.
    names : sequence of str, optional
        Names of the joints; by default joint1 ... jointn.

    Returns
    -------
    str
        XML that MuJoCo loads: each joint on its own, with the two hinges that are to stand in the body
        of its link, and the motors. The actuators' inputs are motor torques.

    Raises
    ------
    JointIdError
        As in ``arm_side``, or when the names do not fit.
    """
    arm, names = arm_side(identification, gear_ratio), _names(identification.n, names)
    lines = [*_heading(identification, arm), _FRAGMENT_NOTE, _NESTING_NOTE]
    lines += ['<mujoco model="elastic_joints">', "  <worldbody>"]
    for j, name in enumerate(names):
        about = _x(arm.M2[j, j])
        lines += [
            f"    <body name={quoteattr(f'{name}_link')}>",
            "      <!-- Both hinges stand in the body of the link: their angles add up. -->",
            f'      <joint name={quoteattr(f"{name}_motor")} type="hinge" axis="0 0 1" '
            f'armature="{_x(arm.rotor[j])}" damping="{_x(arm.viscous[j])}" '
            f'frictionloss="{_x(arm.coulomb[j])}"/>',
            f'      <joint name={quoteattr(f"{name}_spring")} type="hinge" axis="0 0 1" '
            f'stiffness="{_x(arm.K[j])}" springref="0" damping="{_x(arm.D[j])}"/>',
            f'      <inertial pos="0 0 0" mass="{_x(_LINK_MASS)}" '
            f'diaginertia="{about} {about} {about}"/>',
            "    </body>",
        ]
    lines += ["  </worldbody>", "  <actuator>"]
    for j, name in enumerate(names):
        lines.append(
            f"    <motor name={quoteattr(f'{name}_torque')} joint={quoteattr(f'{name}_motor')} "
            f'gear="{_x(arm.gear_ratio[j])}"/>'
        )
    return "\n".join([*lines, "  </actuator>", "</mujoco>", ""])


def urdf_snippet(
    identification: Identification, gear_ratio: ArrayLike, names: Sequence[str] | None = None
) -> str:
    """Joints, rotor links and transmissions for URDF, stiffness in Gazebo's extension.

    Parameters and errors as in ``mujoco_snippet``. URDF itself knows no spring.
    """
    arm, names = arm_side(identification, gear_ratio), _names(identification.n, names)
    lines = [*_heading(identification, arm), _FRAGMENT_NOTE, _ROTOR_NOTE]
    lines += ['<robot name="elastic_joints">', f'  <link name="{_BASE}"/>']
    for j, name in enumerate(names):
        motor, spring, rotor = (quoteattr(f"{name}_{part}") for part in ("motor", "spring", "rotor"))
        link = quoteattr(f"{name}_link")
        lines += [
            *_urdf_link(rotor, _ROTOR_MASS, float(arm.rotor[j])),
            *_urdf_link(link, _LINK_MASS, float(arm.M2[j, j])),
            f'  <joint name={motor} type="continuous">',
            f'    <parent link="{_BASE}"/>',
            f"    <child link={rotor}/>",
            '    <axis xyz="0 0 1"/>',
            f'    <dynamics damping="{_x(arm.viscous[j])}" friction="{_x(arm.coulomb[j])}"/>',
            "  </joint>",
            f'  <joint name={spring} type="continuous">',
            f"    <parent link={rotor}/>",
            f"    <child link={link}/>",
            '    <axis xyz="0 0 1"/>',
            f'    <dynamics damping="{_x(arm.D[j])}" friction="0"/>',
            "  </joint>",
            f"  <gazebo reference={spring}>",
            "    <springReference>0</springReference>",
            f"    <springStiffness>{_x(arm.K[j])}</springStiffness>",
            "  </gazebo>",
            f"  <transmission name={quoteattr(f'{name}_transmission')}>",
            "    <type>transmission_interface/SimpleTransmission</type>",
            f"    <joint name={motor}/>",
            f"    <actuator name={quoteattr(f'{name}_actuator')}>",
            f"      <mechanicalReduction>{_x(arm.gear_ratio[j])}</mechanicalReduction>",
            "    </actuator>",
            "  </transmission>",
        ]
    return "\n".join([*lines, "</robot>", ""])


def sdf_snippet(
    identification: Identification, gear_ratio: ArrayLike, names: Sequence[str] | None = None
) -> str:
    """Joints and rotor links for SDFormat (Gazebo); parameters and errors as in ``mujoco_snippet``.

    SDFormat joints take arm-side torques: multiply a motor torque by the gear ratio.
    """
    arm, names = arm_side(identification, gear_ratio), _names(identification.n, names)
    lines = [*_heading(identification, arm), _FRAGMENT_NOTE, _ROTOR_NOTE]
    lines += [
        '<sdf version="1.9">',
        '  <model name="elastic_joints">',
        f'    <link name="{_BASE}"/>',
        f'    <joint name="{_BASE}_fixed" type="fixed">',
        f"      <parent>world</parent><child>{_BASE}</child>",
        "    </joint>",
    ]
    for j, name in enumerate(names):
        spring = (
            f"<spring_reference>0</spring_reference><spring_stiffness>{_x(arm.K[j])}</spring_stiffness>"
        )
        lines += [
            *_sdf_link(f"{name}_rotor", _ROTOR_MASS, float(arm.rotor[j])),
            *_sdf_link(f"{name}_link", _LINK_MASS, float(arm.M2[j, j])),
            *_sdf_joint(
                name, "motor", (_BASE, f"{name}_rotor"),
                f"<damping>{_x(arm.viscous[j])}</damping><friction>{_x(arm.coulomb[j])}</friction>",
            ),
            *_sdf_joint(
                name, "spring", (f"{name}_rotor", f"{name}_link"),
                f"<damping>{_x(arm.D[j])}</damping>{spring}",
            ),
        ]  # fmt: skip
    return "\n".join([*lines, "  </model>", "</sdf>", ""])


_BASE = "elastic_joints_base"
_LINK_MASS = 1.0
_FRAGMENT_NOTE = """\
<!-- It loads as it is, for a look: every joint stands on the base on its own, and its link has the arm
     inertia J_a that the joint sees in this pose; couplings J_12 are not in it. For a model of the arm
     take the joints over, nest the links as the arm does, and put the links' own masses and inertias in
     place of J_a and the 1 kg. -->"""
_NESTING_NOTE = """\
<!-- Nest the bodies as your arm does. Where motor 2 turns link 2 against link 1 (serial drive) the
     hinges stand as they are; a parallelogram drive turns link 2 against the base. -->"""
_ROTOR_MASS = 1e-3
_ROTOR_NOTE = """\
<!-- The rotor link carries the rotor inertia reflected to the arm side. As a body of its own it also
     turns with its parent. That is exact for a joint on the base and for parallelogram drives, but too
     much inertia for a motor that rides on a moving link: there MuJoCo's armature is right. The
     rotor's mass only keeps it from being zero. -->"""


def _urdf_link(name: str, mass: float, inertia: float) -> list[str]:
    about = _x(inertia)
    return [
        f"  <link name={name}>",
        "    <inertial>",
        f'      <mass value="{_x(mass)}"/>',
        f'      <inertia ixx="{about}" iyy="{about}" izz="{about}" ixy="0" ixz="0" iyz="0"/>',
        "    </inertial>",
        "  </link>",
    ]


def _sdf_link(name: str, mass: float, inertia: float) -> list[str]:
    about = _x(inertia)
    return [
        f"    <link name={quoteattr(name)}>",
        f"      <inertial><mass>{_x(mass)}</mass><inertia>",
        f"        <ixx>{about}</ixx><iyy>{about}</iyy><izz>{about}</izz>",
        "      </inertia></inertial>",
        "    </link>",
    ]


def _sdf_joint(name: str, part: str, links: tuple[str, str], dynamics: str) -> list[str]:
    return [
        f'    <joint name={quoteattr(f"{name}_{part}")} type="continuous">',
        f"      <parent>{escape(links[0])}</parent>",
        f"      <child>{escape(links[1])}</child>",
        f"      <axis><xyz>0 0 1</xyz><dynamics>{dynamics}</dynamics></axis>",
        "    </joint>",
    ]


def _heading(identification: Identification, arm: ArmSide) -> list[str]:
    """What the numbers are, as an XML comment."""
    i = identification
    ratios = ", ".join(_x(value) for value in arm.gear_ratio)
    lines = [
        f"<!-- Elastic joints of {_comment(i.obtained.study or 'a study')}, by jointid "
        f"{_comment(i.obtained.version)}; study {_comment(i.obtained.digest)}.",
        f"     Arm side, SI units: gear ratios N = {ratios} are applied, K_arm = N^2 K, D_arm = N^2 D,",
        "     rotor inertia N^2 J_m, Coulomb friction |N| F_c, viscous friction N^2 F_v.",
    ]
    for j in range(i.n):
        lines.append(
            f"     Joint {j + 1}, motor side: K = {_x(i.K[j])} N.m/rad, D = {_x(i.D[j])} N.m.s/rad, "
            f"J_m = {_x(i.inertia.M[j])} kg.m^2."
        )
    if i.friction is None:
        lines.append("     Friction was not identified and is 0 here.")
    lines[-1] += " -->"
    return lines


def _names(n: int, names: Sequence[str] | None) -> list[str]:
    if names is None:
        return [f"joint{j + 1}" for j in range(n)]
    given = list(names)
    if len(given) != n or len(set(given)) != n or not all(isinstance(x, str) and x for x in given):
        raise JointIdError(
            f"names = {given!r:.200}: give {counted(n, 'different name')}, one per joint."
        )
    return given


def _comment(text: str) -> str:
    """Text as it may stand in an XML comment."""
    return "".join(c if c.isprintable() else " " for c in text).replace("--", "- -")


def _x(value: float) -> str:
    """All digits."""
    return repr(float(value))
