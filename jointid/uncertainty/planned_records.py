"""Planned sine experiments: torques from the motion, or the motion from the torques."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Complexes, Floats, finite_array
from jointid.errors import JointIdError
from jointid.joints import Elasticity, Inertia, motor_response
from jointid.wording import significant


@dataclass(frozen=True, eq=False)
class PlannedRecords:
    """Planned sine experiments."""

    frequency_hz: Floats
    """Shape (r,), Hz."""
    torque_Nm: Complexes
    """Torque amplitudes and phases without motor friction, shape (r, n), N·m."""
    angle_rad: Complexes
    """Motor angle amplitudes and phases, shape (r, n), rad."""
    duration_s: Floats
    """Shape (r,), s."""

    @property
    def velocity_rad_s(self) -> Floats:
        """Velocity amplitudes of the motors, shape (r, n)."""
        return np.asarray(np.abs(self.angle_rad) * 2 * np.pi * self.frequency_hz[:, None])

    @property
    def relative(self) -> tuple[Complexes, Complexes]:
        """Torques and angles turned to phase 0 of the first driven joint's torque, each (r, n).

        Only the phases between the joints matter.
        """
        size = np.abs(self.torque_Nm)
        driven = size > 1e-6 * size.max(axis=1, keepdims=True)
        first = np.take_along_axis(self.torque_Nm, driven.argmax(axis=1)[:, None], axis=1)
        turn = np.exp(-1j * np.angle(first))
        return np.where(driven, self.torque_Nm * turn, 0.0), self.angle_rad * turn


def phase_deg(values: Complexes) -> Floats:
    """Phase from 0° to 359.5°: an editable grid has no typographic minus."""
    angle = np.degrees(np.angle(values)) % 360
    return np.asarray(np.where(angle < 359.5, angle, 0.0))


def phasor_text(value: complex) -> str:
    """Format amplitude and phase, "1.9 ∠ 83°"."""
    if value == 0:
        return "0"
    return f"{significant(abs(value), 3)} ∠ {round(float(phase_deg(np.array(value))))}°"


def planned_records(
    inertia: Inertia,
    elasticity: Elasticity,
    frequency_hz: ArrayLike,
    *,
    torque_Nm: ArrayLike | None = None,
    angle_rad: ArrayLike | None = None,
    duration_s: ArrayLike = 4.0,
) -> PlannedRecords:
    """Plan records by their torques or by their motor angles; the other follows from the model.

    ``frequency_hz`` has shape (r,), ``duration_s`` that or one value; ``torque_Nm`` or ``angle_rad``,
    complex, shape (r, n) or (n,), holds amplitudes and phases, y for Im(y e^{iωt}). Raises JointIdError
    when not exactly one of the two is given, or a shape or value is wrong.
    """
    frequency = finite_array("frequency_hz", frequency_hz, ndim=1)
    duration = finite_array("duration_s", np.broadcast_to(duration_s, frequency.shape), ndim=1)
    if frequency.size == 0 or np.any(frequency <= 0) or np.any(duration * frequency < 1):
        raise JointIdError(
            "Planned records need positive frequencies, and at least one period each: check "
            "frequencies and durations."
        )
    if (torque_Nm is None) == (angle_rad is None):
        raise JointIdError("Give either the torques or the angles of the planned records.")
    given = np.asarray(torque_Nm if angle_rad is None else angle_rad, np.complex128)
    shape = (frequency.size, inertia.n)
    if given.shape not in (shape, shape[1:]) or not np.isfinite(given).all():
        raise JointIdError(
            f"Amplitudes of shape {given.shape}: expected finite numbers, one row per record "
            f"({shape[0]}) and one column per joint ({shape[1]})."
        )
    given = np.array(np.broadcast_to(given, shape), np.complex128)
    H = motor_response(2 * np.pi * frequency, inertia, elasticity)
    s2 = -((2 * np.pi * frequency)[:, None] ** 2)
    if angle_rad is None:
        return PlannedRecords(frequency, given, (H @ given[..., None])[..., 0] / s2, duration)
    torque = np.linalg.solve(H, (s2 * given)[..., None])[..., 0]
    return PlannedRecords(frequency, np.asarray(torque, np.complex128), given, duration)
