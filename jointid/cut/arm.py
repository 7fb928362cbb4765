"""The planar arm: two links in a horizontal plane, their gears and rotors.

Joint side throughout, except :meth:`PlanarArm.inertia`: joint angles, rates and torques are those of the
links. A motor shaft turns ``gear_ratio`` times its joint, so θ_motor = N q, τ_arm = N τ_motor,
K_arm = N² K and a rotor has the inertia N² J_m on the joint side.

Meaning of the joint angle ``q``, by drive:

- *parallelogram*: both motors sit on the base, q1 and q2 are the absolute angles of the links.
- *serial*: motor 2 sits on link 1, q2 is the angle of link 2 relative to link 1.

With φ the absolute link angles, φ = L q holds for both, L = I or [[1, 0], [1, 1]]. In φ the equations
of motion have one form (Spong, Hutchinson and Vidyasagar, Robot Modeling and Control, chapter 7),
and virtual work converts them to q: M_q = Lᵀ M_φ L, c_q = Lᵀ c_φ.
"""

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array, set_fields, vectors
from jointid.errors import JointIdError
from jointid.joints import Elasticity, Inertia
from jointid.wording import counted

Drive = Literal["parallelogram", "serial"]
Elbow = Literal["positive", "negative"]

_LINKS = {"parallelogram": ((1.0, 0.0), (0.0, 1.0)), "serial": ((1.0, 0.0), (1.0, 1.0))}
_SIGN = {"positive": 1.0, "negative": -1.0}
_SMALLEST_SINE = 0.01
"""Sine of the elbow angle (0.6°) below which the arm counts as singular: joint rates are then over 100
times those of an arm bent at a right angle."""


@dataclass(frozen=True, eq=False)
class PlanarArm:
    """Two links in a horizontal plane, without gravity; fields take any array_like of shape (2,).

    Raises JointIdError when a value is missing, not finite or out of range.
    """

    length_m: Floats
    """Link lengths, m; the second one reaches to the tool."""
    mass_kg: Floats
    """Link masses, kg; the second one includes the tool."""
    centre_m: Floats
    """Distance of each centre of mass from the link's own joint, along the link, m."""
    inertia_kgm2: Floats
    """Inertia of each link about its centre of mass, kg·m²."""
    gear_ratio: Floats
    """Motor turns per joint turn; negative for opposite directions."""
    rotor_inertia_kgm2: Floats
    """Rotor inertias J_m on the motor side, kg·m²."""
    drive: Drive = "parallelogram"
    """Place of motor 2: on the base ("parallelogram"), where q2 is the absolute angle of link 2, or on
    link 1 ("serial"), where q2 is its angle relative to link 1."""

    def __post_init__(self) -> None:
        if self.drive not in _LINKS:
            raise JointIdError(f'drive = "{self.drive}": expected "parallelogram" or "serial".')
        for name, (unit, rule) in _FIELDS.items():
            label = f"{name} ({unit})" if unit else name
            value = finite_array(label, getattr(self, name), ndim=1)
            if value.shape != (2,):
                raise JointIdError(
                    f"{label} has {counted(value.size, 'value')}: give one for each of the two links."
                )
            bad = {"be positive": value <= 0, "not be negative": value < 0, "not be zero": value == 0}[
                rule
            ]
            if bad.any():
                j = int(np.argmax(bad))
                stated = f"{name} of link {j + 1} is {value[j]:g} {unit}".rstrip()
                raise JointIdError(f"{stated}: it must {rule}.")
            set_fields(self, **{name: value})

    @classmethod
    def example(cls, drive: Drive = "parallelogram") -> Self:
        """Return an arm of the size of a common industrial robot, with two different gear ratios.

        The paper states neither inertias nor geometry; these values are assumed. At
        the cutting point (1.15, 0) m with a positive elbow, the paper's K and D give free resonances at
        17 Hz and 27 Hz.
        """
        return cls(
            length_m=np.array([0.705, 0.755]),
            mass_kg=np.array([45.0, 70.0]),
            centre_m=np.array([0.30, 0.30]),
            inertia_kgm2=np.array([2.2, 9.0]),
            gear_ratio=np.array([100.0, 90.0]),
            rotor_inertia_kgm2=np.array([0.0025, 0.0010]),
            drive=drive,
        )

    @property
    def moments(self) -> tuple[float, float, float]:
        """The three inertias of the planar equations, kg·m².

        a = I1 + m1 r1² + m2 l1², b = I2 + m2 r2², c = m2 l1 r2.
        """
        (m1, m2), (r1, r2), (i1, i2) = self.mass_kg, self.centre_m, self.inertia_kgm2
        l1 = self.length_m[0]
        return float(i1 + m1 * r1**2 + m2 * l1**2), float(i2 + m2 * r2**2), float(m2 * l1 * r2)

    @property
    def links_from_joints(self) -> Floats:
        """Matrix L of φ = L q, shape (2, 2)."""
        return np.array(_LINKS[self.drive])

    @property
    def rotor_inertia_arm_kgm2(self) -> Floats:
        """Rotor inertias reflected to the joint side, N² J_m, shape (2,), kg·m²."""
        return self.gear_ratio**2 * self.rotor_inertia_kgm2

    def link_angles(self, joint_angle_rad: ArrayLike) -> Floats:
        """Absolute link angles φ = L q, shape (..., 2), rad; works for rates too."""
        return np.asarray(vectors("joint_angle_rad", joint_angle_rad, 2) @ self.links_from_joints.T)

    def joint_angles(self, link_angle_rad: ArrayLike) -> Floats:
        """Joint angles q = L⁻¹ φ, shape (..., 2), rad; works for rates too."""
        inverse = np.linalg.inv(self.links_from_joints)
        return np.asarray(vectors("link_angle_rad", link_angle_rad, 2) @ inverse.T)

    def mass_matrix(self, joint_angle_rad: ArrayLike) -> Floats:
        """Mass matrix M(q) of the links, joint side, shape (..., 2, 2), kg·m².

        Parallelogram: [[a, c cos(q2−q1)], [·, b]]; serial: [[a+b+2c cos q2, b+c cos q2], [·, b]].
        """
        a, b, c = self.moments
        phi = self.link_angles(joint_angle_rad)
        coupling = c * np.cos(phi[..., 1] - phi[..., 0])
        links = np.empty((*coupling.shape, 2, 2))
        links[..., 0, 0], links[..., 1, 1] = a, b
        links[..., 0, 1] = links[..., 1, 0] = coupling
        L = self.links_from_joints
        return np.asarray(L.T @ links @ L)

    def coriolis(self, joint_angle_rad: ArrayLike, joint_rate_rad_s: ArrayLike) -> Floats:
        """Coriolis and centrifugal torques c(q, q̇), joint side, shape (..., 2), N·m.

        Parallelogram: (−h q̇2², h q̇1²) with h = c sin(q2−q1);
        serial: (−h(2 q̇1 q̇2 + q̇2²), h q̇1²) with h = c sin q2.
        """
        phi, rate = self.link_angles(joint_angle_rad), self.link_angles(joint_rate_rad_s)
        h = self.moments[2] * np.sin(phi[..., 1] - phi[..., 0])
        links = np.stack([-h * rate[..., 1] ** 2, h * rate[..., 0] ** 2], axis=-1)
        return np.asarray(links @ self.links_from_joints)

    def inertia(self, joint_angle_rad: ArrayLike) -> Inertia:
        """Motor-side inertia at one pose: M the rotor inertias, M2 = N⁻¹ M(q) N⁻¹."""
        q = finite_array("joint_angle_rad", joint_angle_rad, ndim=1)
        n = self.gear_ratio
        return Inertia(M=self.rotor_inertia_kgm2, M2=self.mass_matrix(q) / np.outer(n, n))

    def tool(self, joint_angle_rad: ArrayLike) -> Floats:
        """Forward kinematics: tool position, shape (..., 2), m; the base is the origin."""
        return self.tool_of_links(self.link_angles(joint_angle_rad))

    def tool_of_links(self, link_angle_rad: ArrayLike) -> Floats:
        """Tool position at absolute link angles φ, shape (..., 2), m."""
        phi = vectors("link_angle_rad", link_angle_rad, 2)
        return np.stack([np.cos(phi) @ self.length_m, np.sin(phi) @ self.length_m], axis=-1)

    def jacobian(self, joint_angle_rad: ArrayLike) -> Floats:
        """Derivative of the tool position with respect to the joint angles, shape (..., 2, 2), m/rad."""
        phi = self.link_angles(joint_angle_rad)
        links = np.stack([-np.sin(phi) * self.length_m, np.cos(phi) * self.length_m], axis=-2)
        return np.asarray(links @ self.links_from_joints)

    def inverse(self, tool_m: ArrayLike, elbow: Elbow = "positive") -> Floats:
        """Inverse kinematics: joint angles q, shape (..., 2), rad, for tool points (..., 2), m.

        ``elbow`` is the sign of the angle of link 2 relative to link 1; that of link 1 lies between −π
        and π. Raises JointIdError when a point is out of reach, or the arm is nearly singular there.
        """
        if elbow not in _SIGN:
            raise JointIdError(f'elbow = "{elbow}": expected "positive" or "negative".')
        point = vectors("tool_m", tool_m, 2)
        l1, l2 = self.length_m
        distance = np.hypot(point[..., 0], point[..., 1])
        cosine = (distance**2 - l1**2 - l2**2) / (2 * l1 * l2)
        self._require_reach(point, distance, cosine)
        bend = _SIGN[elbow] * np.arccos(cosine)
        phi1 = np.arctan2(point[..., 1], point[..., 0]) - np.arctan2(
            l2 * np.sin(bend), l1 + l2 * np.cos(bend)
        )
        phi1 = (phi1 + np.pi) % (2 * np.pi) - np.pi
        return self.joint_angles(np.stack([phi1, phi1 + bend], axis=-1))

    def _require_reach(self, point: Floats, distance: Floats, cosine: Floats) -> None:
        edge = np.sqrt(1 - _SMALLEST_SINE**2)
        worst = np.unravel_index(int(np.argmax(np.abs(cosine))), cosine.shape)
        if abs(cosine[worst]) <= edge:
            return
        l1, l2 = self.length_m
        inner, outer = (np.sqrt(l1**2 + l2**2 + 2 * l1 * l2 * x) for x in (-edge, edge))
        x, y = point[worst]
        fault = (
            "is out of reach"
            if abs(cosine[worst]) > 1
            else "makes the arm singular (straight or folded)"
        )
        raise JointIdError(
            f"Tool point ({x:.4g}, {y:.4g}) m {fault}: it lies {distance[worst]:.4g} m from the base, "
            f"and the arm works between {inner:.4g} m and {outer:.4g} m. Move the path, or change the "
            "lengths of the links."
        )


def require_two_joints(elasticity: Elasticity, what: str = "elasticity") -> None:
    """Refuse K and D of another number of joints than the planar arm's."""
    if elasticity.n != 2:
        raise JointIdError(f"The {what} has {counted(elasticity.n, 'joint')}; the planar arm has 2.")


_FIELDS = {
    "length_m": ("m", "be positive"),
    "mass_kg": ("kg", "be positive"),
    "centre_m": ("m", "not be negative"),
    "inertia_kgm2": ("kg·m²", "be positive"),
    "gear_ratio": ("", "not be zero"),
    "rotor_inertia_kgm2": ("kg·m²", "be positive"),
}
"""Unit of each value and the rule for it."""
