"""Description of a robot in a file."""

from dataclasses import dataclass, field

import numpy as np

from jointid.arrays import Floats
from jointid.robot_models.payload import Counterbalance, Payload
from jointid.robot_models.rigid_bodies import Frame, RigidBodies


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
