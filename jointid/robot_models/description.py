"""Description of a robot in a file, with its payload and counterbalance."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, bounded_number, finite_array, set_fields
from jointid.errors import JointIdError
from jointid.robot_models.rigid_bodies import Array, Frame, RigidBodies

PAYLOAD_KEYS = {
    "mass": "mass = 120.0  # kg",
    "mass_std": "mass_std = 40.0  # standard deviation of the mass, kg",
    "center": "center = [0.0, 0.0, 0.1]  # of mass, in the flange's frame, m",
    "inertia": "inertia = [8.0, 8.0, 6.0, 0.0, 0.0, 0.0]  # xx yy zz xy yz xz about the centre of mass, "
    "kg·m²",
}
"""Keys of a payload in a file, with an example of each."""


@dataclass(frozen=True, eq=False)
class Payload:
    """A body at the flange, with the uncertainty of its mass.

    Raises JointIdError when a value is not finite, or a mass negative.
    """

    mass: float
    """kg."""
    center: Floats
    """Centre of mass in the flange's frame, m."""
    inertia: Floats
    """About the centre of mass in the flange's axes: xx, yy, zz, xy, yz, xz, kg·m²."""
    mass_std: float
    """Standard deviation of the mass, kg; 0 when it is exact."""

    def __init__(
        self,
        mass: float = 0.0,
        center: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike = (0.0,) * 6,
        mass_std: float = 0.0,
    ) -> None:
        set_fields(
            self,
            mass=bounded_number("payload mass", "kg", mass, zero=True),
            mass_std=bounded_number("mass_std", "kg", mass_std, zero=True),
        )
        for name, value, size in (("center", center, 3), ("inertia", inertia, 6)):
            array = finite_array(f"{name} of the payload", value, ndim=1)
            if array.shape != (size,):
                raise JointIdError(f"{name} of the payload has {array.size} values: give {size}.")
            set_fields(self, **{name: array})


@dataclass(frozen=True)
class Counterbalance:
    """A gas cylinder between two links; defaults are those of the KUKA Quantec KR300.

    Weigand, Ulmen, Janot and Ruskowski, IROS 2021. The cylinder's crank has length k on the moving link
    and its anchor the distance D on the other; the force is area × pressure of an isothermal gas.
    """

    joint: int
    """Index of the joint that it acts on, from 0."""
    zero: float
    """Angle of the joint's model at the logged angle 0, rad."""
    angle_deg: float = 95.0
    """Angle from anchor to crank where the joint's model is at 0."""
    anchor_m: float = 0.8
    crank_m: float = 0.2
    area_m2: float = float(np.pi * (0.055**2 - 0.03**2) / 4)
    """Area of the piston without its rod."""
    gas_volume_m3: float = 2 * 0.00048
    """Volume of the gas with the cylinder at its shortest."""
    gas_energy_J: float = 1.01 * 296.8 * 328 * 2 * 0.0795
    """Pressure times volume of the gas."""

    def torque(self, q: Array) -> Array:
        """Torque to be added to that of its joint, N·m, at logged angles of shape (...,)."""
        angle = q + self.zero + np.deg2rad(self.angle_deg)
        D, k = self.anchor_m, self.crank_m
        length = np.sqrt(D**2 + k**2 - 2 * D * k * np.cos(angle))
        lever = D * k * np.sin(angle) / length
        pressure = self.gas_energy_J / (self.gas_volume_m3 - (length - (D - k)) * self.area_m2)
        return np.asarray(lever * self.area_m2 * pressure)


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotDescription:
    """Rigid model of a robot with n driven joints, its gears and its payload."""

    links: RigidBodies
    """The links without the payload."""
    coupling: Floats
    """C of joint = C · motor, shape (n, n): 1/N on the diagonal without coupled joints; NaN unknown."""
    rotor_inertia: Floats
    """Motor side, shape (n,), kg·m²; NaN where it is unknown."""
    zero: Floats
    """Angle of the links' model at the logged angle 0, shape (n,), rad."""
    names: tuple[str, ...]
    """Names of the joints."""
    flange: Frame = field(default_factory=lambda: Frame(np.eye(3), np.zeros(3)))
    """Frame of the payload on the last link."""
    tool: Floats = field(default_factory=lambda: np.zeros(3))
    """Tool point in the flange's frame, shape (3,), m."""
    payload: Payload = field(default_factory=Payload)
    counterbalance: Counterbalance | None = None
    armature: Floats | None = None
    """Rotor inertias seen from the joints, shape (n,), kg·m², where the file states these instead."""
    source: tuple[str, bytes] = ("", b"")
    """Name and content of the file."""
