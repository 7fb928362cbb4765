"""Rigid model of a robot: joint torque, motor-side inertia, gravity stiffness and the tool point."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointid.arrays import Floats, frozen, per_joint, vectors
from jointid.errors import JointIdError
from jointid.joints import Inertia
from jointid.robot_models.denavit_hartenberg import read_denavit_hartenberg
from jointid.robot_models.description import Payload, RobotDescription
from jointid.robot_models.mjcf import read_mjcf
from jointid.robot_models.rigid_bodies import Array, RigidBodies, combined, cross, symmetric_tensor
from jointid.robot_models.urdf import read_urdf
from jointid.wording import enumerated

MAX_FILE_BYTES = 4 << 20
"""Largest robot description that is read, bytes."""
_READERS = {".toml": read_denavit_hartenberg, ".urdf": read_urdf, ".xml": read_mjcf}
_STEP = 1e-30
"""Imaginary step of derivatives: exact to rounding, since nothing is subtracted."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotModel(RobotDescription):
    """Rigid model of a robot with n driven joints. Build it with ``RobotModel.load``.

    Joint angles are those of the log, in radians; they may have leading axes, (..., n).
    """

    ENDINGS: ClassVar[tuple[str, ...]] = tuple(_READERS)
    """Endings of the files that ``load`` reads."""

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        *,
        gear_ratio: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
    ) -> RobotModel:
        """Read a robot from URDF (.urdf), MJCF (.xml) or Denavit–Hartenberg TOML (.toml).

        No other file is read: meshes and included files are not opened.

        Parameters
        ----------
        path : path
        gear_ratio : array_like, shape (n,), optional
            Motor turns per joint turn, in place of those of the file. URDF states them as
            ``mechanicalReduction`` of transmissions, MJCF as ``gear`` of actuators.
        rotor_inertia : array_like, shape (n,), optional
            Motor side, kg·m², in place of those of the file. MJCF states them times N² as ``armature``.

        Raises
        ------
        JointIdError
            When the file cannot be used; the message names the fault and its place.
        """
        try:
            file = Path(path)
            with file.open("rb") as opened:
                data = opened.read(MAX_FILE_BYTES + 1)
        except (OSError, ValueError, TypeError) as error:
            fault = getattr(error, "strerror", None) or error
            raise JointIdError(
                f"{path!s:.200} cannot be read: {fault!s:.200}. Give a robot's file: .urdf, .xml "
                "(MJCF) or .toml (Denavit–Hartenberg)."
            ) from error
        return cls.parse(file.name, data, gear_ratio=gear_ratio, rotor_inertia=rotor_inertia)

    @classmethod
    def parse(
        cls,
        name: str,
        data: bytes,
        *,
        gear_ratio: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
    ) -> RobotModel:
        """Read a robot from the content of a file, as ``load``."""
        if len(data) > MAX_FILE_BYTES:
            raise JointIdError(
                f"{name} has more than the limit of {MAX_FILE_BYTES} bytes: it must describe the robot "
                "without meshes.",
                file=name,
            )
        suffix = Path(name).suffix.lower()
        if suffix not in _READERS:
            raise JointIdError(
                f"{name:.200}: expected a robot as .urdf, .xml (MJCF) or .toml (Denavit–Hartenberg).",
                file=name,
            )
        robot = cls(**vars(_READERS[suffix](name, data)))
        if gear_ratio is not None:
            N = per_joint("gear_ratio (motor turns per joint turn)", gear_ratio, robot.n)
            if not N.all():
                raise JointIdError(f"gear_ratio of joint {int(np.argmin(np.abs(N))) + 1} must not be 0.")
            robot = replace(robot, coupling=frozen(np.diag(1 / N)))
        if rotor_inertia is not None:
            J = per_joint("rotor_inertia (motor side, kg·m²)", rotor_inertia, robot.n)
            if J.min() <= 0:
                raise JointIdError(f"rotor_inertia of joint {int(np.argmin(J)) + 1} must be positive.")
            return replace(robot, rotor_inertia=frozen(J), armature=None)
        if robot.armature is not None:
            return replace(robot, rotor_inertia=frozen(robot.armature / robot.gear_ratio**2))
        return robot

    @property
    def n(self) -> int:
        """Number of driven joints."""
        return self.links.n

    @property
    def gear_ratio(self) -> Floats:
        """Motor turns per joint turn with the other joints at rest, shape (n,); NaN where unknown."""
        known = np.isfinite(self.coupling).all()
        return frozen(np.diag(np.linalg.inv(self.coupling)) if known else 1 / np.diag(self.coupling))

    @property
    def is_coupled(self) -> NDArray[np.bool_]:
        """Whether one motor moves a joint together with others, shape (n,); False where unknown."""
        off = np.nan_to_num(self.coupling - np.diag(np.diag(self.coupling))) != 0
        return np.asarray(off.any(axis=0) | off.any(axis=1))

    def with_payload(
        self,
        mass: float | None = None,
        center: ArrayLike | None = None,
        inertia: ArrayLike | None = None,
        mass_std: float | None = None,
    ) -> RobotModel:
        """Return the robot with another payload; values that are not given stay, see ``Payload``."""
        given = {"mass": mass, "center": center, "inertia": inertia, "mass_std": mass_std}
        values: dict[str, Any] = {
            k: getattr(self.payload, k) if v is None else v for k, v in given.items()
        }
        return replace(self, payload=Payload(**values))

    def torque(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Floats:
        """Joint torque of links, payload, counterbalance and gravity, without rotors and friction.

        Parameters
        ----------
        q, dq, ddq : array_like, shape (..., n)
            Joint angles, rad, velocities and accelerations; they broadcast.

        Returns
        -------
        ndarray, shape (..., n)
            N·m, on the joint side of the gears.

        Raises
        ------
        JointIdError
            When the last axis does not have n values, or a value is not finite.
        """
        return np.asarray(self._torque(*self._checked(q=q, dq=dq, ddq=ddq)))

    def torque_changes(
        self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike
    ) -> tuple[Floats, Floats, Floats]:
        """``torque``, its change with the payload, (..., n, 4), and with each part, (..., n, n + 1).

        Payload: per standard deviation of its mass and of its centre along x, y and z of the flange;
        relative to its distance from the flange, the centre is as uncertain as the mass. Parts: the n
        links, then the counterbalance (0 without one), per unit relative change of the mass and inertia,
        or of the force; this equals the part's own torque.
        """
        angles, *rates = self._checked(q=q, dq=dq, ddq=ddq)
        motion, load = self.links.motion(angles + self.zero, *rates), self.payload
        lever = float(np.linalg.norm(load.center))

        def heavier(center: Floats) -> Array:
            return self.links.of_unit_mass(motion, self.flange.origin + self.flange.rotation @ center)

        # half a mass on one side and minus half on the other have a first moment only
        moved = [(heavier(side) - heavier(-side)) / 2 for side in lever * np.eye(3)]
        payload = load.mass_std * np.stack([heavier(load.center), *moved], axis=-1)
        parts = np.zeros((*angles.shape, self.n + 1))
        parts[..., :-1] = self.links.of_each(motion)
        if (balance := self.counterbalance) is not None:
            parts[..., balance.joint, -1] = balance.torque(angles[..., balance.joint])
        last = self.n - 1
        loaded = self.links.of_one(motion, last, *self._loaded.wrench(motion, last))
        torque = parts.sum(axis=-1) - parts[..., last] + loaded
        return np.asarray(torque), np.asarray(payload), parts

    def joint_inertia(self, q: ArrayLike) -> Floats:
        """Inertia matrix of links and payload on the joint side, shape (n, n), kg·m²."""
        angles = self._pose(q)
        return self._loaded.inertia_matrix(angles + self.zero)

    def inertia(self, q: ArrayLike) -> Inertia:
        """Inertia at joint angles of shape (n,), motor side: M the rotors, M2 the links, and gravity.

        An uncertain mass of the payload is the common unknown of all poses, ``Inertia.shared``. Raises
        JointIdError when gear ratios or rotor inertias are unknown, or M2 is not positive definite.
        """
        C = self.coupling
        if not np.isfinite(C).all():
            raise self._unknown("gear ratio", np.diag(C), "gear_ratio")
        if not np.isfinite(self.rotor_inertia).all():
            raise self._unknown("rotor inertia", self.rotor_inertia, "rotor_inertia")
        M2, gravity = self._at_motors(q)
        if unmoved := [
            name for name, J in zip(self.names, np.diag(M2), strict=True) if 1e-12 * M2.max() >= J
        ]:
            raise JointIdError(
                f"{self.source[0]}: no mass moves with {enumerated(unmoved[:8])}. State the mass and "
                "inertia of the link that it moves, or of the payload.",
                file=self.source[0],
            )
        shared, shared_gravity = None, None
        if std := self.payload.mass_std:
            heavier = self.with_payload(mass=self.payload.mass + std)._at_motors(q)
            shared, shared_gravity = heavier[0] - M2, heavier[1] - gravity
        return Inertia(
            self.rotor_inertia,
            M2,
            gravity=gravity,
            shared=shared,
            shared_gravity=shared_gravity,
        )

    def _at_motors(self, q: ArrayLike) -> tuple[Floats, Floats]:
        """Inertia and gravity stiffness on the motor side, each (n, n), symmetric to the last bit."""
        C = self.coupling
        joint = (C.T @ each @ C for each in (self.joint_inertia(q), self.gravity_stiffness(q)))
        M2, gravity = (np.asarray((each + each.T) / 2) for each in joint)
        return M2, gravity

    def gravity_stiffness(self, q: ArrayLike) -> Floats:
        """Derivative of the static torque with respect to the joint angles, shape (n, n), N·m/rad.

        Joint side, at joint angles of shape (n,), with payload and counterbalance.
        """
        angles = self._pose(q)
        many = angles + 1j * _STEP * np.eye(self.n)
        still = np.zeros_like(many)
        return np.asarray(self._torque(many, still, still).imag.T / _STEP)

    def tool_motion(self, q: ArrayLike) -> tuple[Floats, Floats]:
        """Tool point, shape (3,), m, and its Jacobian, shape (3, n), m/rad, in world axes, at q (n,)."""
        angles = self._pose(q)
        still, flange = np.zeros(self.n), self.flange
        motion = self.links.motion(angles + self.zero, still, still)
        last = motion.frames[-1]
        tool = last.origin + last.rotation @ (flange.origin + flange.rotation @ self.tool)
        columns, j = np.zeros((3, self.n)), self.n - 1
        while j >= 0:
            z, arm = motion.axes[j], tool - motion.frames[j].origin
            columns[:, j] = z if self.links.sliding[j] else cross(z, arm)
            j = self.links.parent[j]
        return np.asarray(tool), columns

    @cached_property
    def _loaded(self) -> RigidBodies:
        """The links with the payload as part of the last one."""
        links, load = self.links, self.payload
        R, origin = self.flange
        parts = [
            (float(links.mass[-1]), links.center[-1], links.inertia[-1]),
            (load.mass, origin + R @ load.center, R @ symmetric_tensor(load.inertia) @ R.T),
        ]
        mass, center, tensor = combined(parts)
        last = {"mass": mass, "center": center, "inertia": tensor}
        changed: dict[str, Any] = {
            name: np.concatenate([getattr(links, name)[:-1], [own]]) for name, own in last.items()
        }
        return replace(links, **changed)

    def _torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        tau = self._loaded.torque(q + self.zero, dq, ddq)
        if (balance := self.counterbalance) is not None:
            tau[..., balance.joint] += balance.torque(q[..., balance.joint])
        return tau

    def _pose(self, q: ArrayLike) -> Floats:
        """Joint angles of one pose, shape (n,)."""
        angles = vectors("q (joint angles)", q, self.n)
        if angles.ndim > 1:
            raise JointIdError(f"q has shape {angles.shape}: expected ({self.n},), one value per joint.")
        return angles

    def _checked(self, **values: ArrayLike) -> list[Floats]:
        """Finite arrays of one shape (..., n)."""
        arrays = {name: vectors(name, value, self.n) for name, value in values.items()}
        try:
            return list(np.broadcast_arrays(*arrays.values()))
        except ValueError:
            shapes = enumerated([f"{name} {array.shape}" for name, array in arrays.items()])
            raise JointIdError(f"The shapes of {shapes} do not agree.") from None

    def _unknown(self, what: str, values: Floats, argument: str) -> JointIdError:
        missing = [
            name for name, value in zip(self.names, values, strict=True) if not np.isfinite(value)
        ]
        return JointIdError(
            f"{self.source[0]} does not state the {what} of {enumerated(missing[:8])}: "
            f"state it in the file, or as {argument} under [robot_model] in study.toml or in "
            "RobotModel.load.",
            file=self.source[0],
        )
