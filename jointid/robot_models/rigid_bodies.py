"""Rigid bodies on joints of one axis: torque by the recursion of Newton and Euler.

All vectors are in the base frame, so that forces and moments about its origin add up along the tree, and
the torque of joint j is z_j · (moment − o_j × force) of all bodies beyond it. No step takes an absolute
value or a conjugate: complex angles give exact derivatives.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jointid.arrays import Floats

Array = NDArray[Any]
"""Real or complex numbers."""


class Frame(NamedTuple):
    """A frame in another one, or in many poses."""

    rotation: Array
    """Shape (..., 3, 3)."""
    origin: Array
    """Shape (..., 3), m."""


class Motion(NamedTuple):
    """Motion of every body's frame in the base frame; arrays are in order of the bodies."""

    frames: list[Frame]
    axes: list[Array]
    """Axis of each body's joint, shape (..., 3)."""
    velocity: list[Array]
    """Angular, shape (..., 3), rad/s."""
    angular: list[Array]
    """Angular acceleration, shape (..., 3), rad/s²."""
    linear: list[Array]
    """Acceleration of the origin less gravity, shape (..., 3), m/s²."""


@dataclass(frozen=True, eq=False)
class RigidBodies:
    """n bodies, each on a joint of one axis that its parent carries."""

    parent: tuple[int, ...]
    """Index of each body's parent, smaller than its own; -1 is the base."""
    rotation: Floats
    """Joint frame in the parent's frame, shape (n, 3, 3)."""
    origin: Floats
    """Its origin there, shape (n, 3), m."""
    axis: Floats
    """Unit axis in the joint's frame, shape (n, 3)."""
    sliding: tuple[bool, ...]
    """Whether a joint slides along its axis instead of turning about it."""
    mass: Floats
    """Shape (n,), kg."""
    center: Floats
    """Centre of mass in the body's frame, shape (n, 3), m."""
    inertia: Floats
    """About the centre of mass, in the body's frame, shape (n, 3, 3), kg·m²."""
    gravity: Floats
    """In the base frame, shape (3,), m/s²."""

    @property
    def n(self) -> int:
        """Number of bodies and joints."""
        return len(self.parent)

    def motion(self, q: Array, dq: Array, ddq: Array) -> Motion:
        """Motion of all bodies at joint positions, velocities and accelerations, shape (..., n)."""
        still = np.zeros((*q.shape[:-1], 3), q.dtype)
        ground = Frame(np.broadcast_to(np.eye(3), (*q.shape[:-1], 3, 3)), still)
        found = Motion([], [], [], [], [])
        for j, p in enumerate(self.parent):
            base = p < 0
            frame = ground if base else found.frames[p]
            w = still if base else found.velocity[p]
            alpha = still if base else found.angular[p]
            a = still - self.gravity if base else found.linear[p]
            rate, gain = dq[..., j, None], ddq[..., j, None]
            rotation = frame.rotation @ self.rotation[j]
            origin = frame.origin + frame.rotation @ self.origin[j]
            z = rotation @ self.axis[j]
            if self.sliding[j]:
                origin = origin + z * q[..., j, None]
                a = a + z * gain + 2 * cross(w, z * rate)
            else:
                turn = q[..., j, None, None]
                K = _skew(self.axis[j])  # Rodrigues' formula
                rotation = (
                    rotation + np.sin(turn) * (rotation @ K) + (1 - np.cos(turn)) * (rotation @ K @ K)
                )
            arm = origin - frame.origin
            a = a + cross(alpha, arm) + cross(w, cross(w, arm))
            if not self.sliding[j]:
                alpha = alpha + z * gain + cross(w, z * rate)
                w = w + z * rate
            found.frames.append(Frame(rotation, origin))
            found.axes.append(z)
            found.velocity.append(w)
            found.angular.append(alpha)
            found.linear.append(a)
        return found

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torque (force of a sliding joint) that moves the bodies, shape (..., n), N·m.

        Joint angles, rad, velocities and accelerations have this shape, too.
        """
        motion = self.motion(q, dq, ddq)
        wrenches = [self.wrench(motion, j) for j in range(self.n)]
        forces, moments = ([wrench[k] for wrench in wrenches] for k in (0, 1))
        return self.on_joints(motion, forces, moments)

    def wrench(self, motion: Motion, j: int) -> tuple[Array, Array]:
        """Force that moves a body, and its moment about the base's origin, (..., 3)."""
        w, alpha = motion.velocity[j], motion.angular[j]
        R, origin = motion.frames[j]
        arm = R @ self.center[j]
        force = self.mass[j] * (motion.linear[j] + cross(alpha, arm) + cross(w, cross(w, arm)))
        spin, gain = (_apply(R, _to_body(R, v) @ self.inertia[j]) for v in (w, alpha))
        return force, gain + cross(w, spin) + cross(origin + arm, force)

    def of_one(self, motion: Motion, j: int, force: Array, moment: Array) -> Array:
        """Joint torques, shape (..., n), of the force and moment of a single body."""
        forces, moments = ([np.zeros_like(force)] * self.n for _ in range(2))
        forces[j], moments[j] = force, moment
        return self.on_joints(motion, forces, moments)

    def of_each(self, motion: Motion) -> Array:
        """Joint torques of every body alone, shape (..., n, n), the body last."""
        return np.stack([self.of_one(motion, j, *self.wrench(motion, j)) for j in range(self.n)], -1)

    def on_joints(self, motion: Motion, forces: list[Array], moments: list[Array]) -> Array:
        """Joint torques, shape (..., n), from each body's force and moment about the base's origin."""
        tau = []
        for j in reversed(range(self.n)):
            z, force = motion.axes[j], forces[j]
            about = force if self.sliding[j] else moments[j] - cross(motion.frames[j].origin, force)
            tau.append((z * about).sum(axis=-1))
            if (p := self.parent[j]) >= 0:
                forces[p] = forces[p] + force
                moments[p] = moments[p] + moments[j]
        return np.stack(tau[::-1], axis=-1)

    def inertia_matrix(self, q: Floats) -> Floats:
        """Inertia matrix at joint angles, shape (n,): (n, n), kg·m²."""
        still, unit = np.zeros((self.n, self.n)), np.eye(self.n)
        weightless = replace(self, gravity=np.zeros(3))
        columns = weightless.torque(np.broadcast_to(q, unit.shape), still, unit)
        return np.asarray((columns + columns.T) / 2)

    def of_unit_mass(self, motion: Motion, place: Floats) -> Array:
        """Joint torques of 1 kg at a place in the last body's frame, shape (3,): (..., n)."""
        last, w, alpha = motion.frames[-1], motion.velocity[-1], motion.angular[-1]
        arm = last.rotation @ place
        force = motion.linear[-1] + cross(alpha, arm) + cross(w, cross(w, arm))
        return self.of_one(motion, self.n - 1, force, cross(last.origin + arm, force))


def cross(a: Array, b: Array) -> Array:
    """Cross product along the last axis; several times as fast as ``numpy.cross``."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def symmetric_tensor(six: Array) -> Array:
    """Tensor of shape (3, 3) from its elements xx, yy, zz, xy, yz, xz."""
    xx, yy, zz, xy, yz, xz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def combined(parts: Sequence[tuple[float, Floats, Floats]]) -> tuple[float, Floats, Floats]:
    """Mass, centre of mass and inertia about it of several bodies with theirs, in one frame."""
    mass = sum(m for m, _, _ in parts)
    center = sum((m * c for m, c, _ in parts), np.zeros(3)) / (mass or 1.0)
    tensor = np.zeros((3, 3))
    for m, c, own in parts:
        arm = c - center
        tensor += own + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, center, tensor


def _skew(axis: Array) -> Array:
    x, y, z = axis
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _apply(R: Array, vectors: Array) -> Array:
    return np.asarray((R @ vectors[..., None])[..., 0])


def _to_body(R: Array, vectors: Array) -> Array:
    return np.asarray((vectors[..., None, :] @ R)[..., 0, :])
