"""Joint equations (8)-(12), linear in stiffness and damping: one per joint and record.

With the motor phasors q and τ and s = iω, the second derivative of the joint deflections is

    a = (I + M2⁻¹M) s²q − M2⁻¹τ          (9)

and that of the joint torques is b = s²τ − M s⁴q (11). K and D are diagonal, so that equation (8)
separates into one complex equation per joint and record, (K_j + iωD_j) a_j = b_j.

Torques through the gears and their deflections are linear functions of the logged signals, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.estimation.estimators.held_torque import HeldTorque
from jointid.estimation.estimators.inertia_prior import inertia_of_each
from jointid.estimation.estimators.noise import Noise, moderated_noise
from jointid.estimation.estimators.parameters import ParameterLayout
from jointid.joints import Inertia, dynamic_arm_inertia
from jointid.phasors.extract import Phasors
from jointid.small_matrices import lifted

LEAST, LARGEST = 1e-30, 1e30
"""Range of signals and inertias in SI units; products of several of them do not overflow."""


@dataclass(frozen=True, eq=False)
class SpringEquations:
    """The n equations (K_j + iωD_j) a_j = b_j of r records, with the noise of a and b."""

    omega: Floats
    """Frequencies, shape (r,), rad/s."""
    a: Complexes
    """Second derivative of the deflections, equation (9), shape (r, n), rad/s²."""
    b: Complexes
    """Second derivative of the joint torques, equation (11), shape (r, n), N·m/s²."""
    of_a: Complexes
    """Matrix with a = of_a z, z = [q; τ], shape (r, n, 2n)."""
    of_b: Complexes
    """Matrix with b = of_b z, shape (r, n, 2n)."""
    noise: Noise
    """Noise of z at every harmonic."""
    leakage: Complexes
    """Covariance of z from leakage of harmonics over an incomplete period, (r, 2n, 2n)."""

    @property
    def deflection(self) -> Complexes:
        """Joint deflections q − q_a = a/s², shape (r, n), rad."""
        return np.asarray(-self.a / self.omega[:, None] ** 2)

    @property
    def spring_torque(self) -> Complexes:
        """Joint torques b/s², shape (r, n), N·m."""
        return np.asarray(-self.b / self.omega[:, None] ** 2)

    @property
    def stiffness(self) -> Complexes:
        """Dynamic stiffness b/a of each record, K + iωD if the model holds, (r, n), N·m/rad."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.b / self.a)

    def residual(self, K: Floats, D: Floats) -> Complexes:
        """Equation error b − (K + iωD) a, shape (r, n), N·m/s²."""
        return np.asarray(self.b - (K + 1j * self.omega[:, None] * D) * self.a)

    def residual_gain(self, K: Floats, D: Floats) -> Complexes:
        """Matrix E of the equation error E z, shape (r, n, 2n)."""
        spring = K[..., None, :] + 1j * self.omega[:, None] * D[..., None, :]
        return np.asarray(self.of_b - spring[..., None] * self.of_a)

    def residual_covariance(self, K: Floats, D: Floats) -> Complexes:
        """Covariance of the equation error from the noise of both a and b, shape (r, n, n).

        Raises JointIdError when an equation has no error: of a motor at rest, whose torque cancels.
        """
        E = self.residual_gain(K, D)
        C = self.noise.covariance[:, 0] + self.leakage
        V = lifted(E @ C @ E.conj().swapaxes(-2, -1), E, C)
        if np.any(at_rest := np.diagonal(V, axis1=-2, axis2=-1).real <= 0):
            raise JointIdError(
                f"The motor of joint {np.argwhere(at_rest)[0, -1] + 1} does not move in a record; its "
                "torque alone does not determine K. Move it more, or log its position with more digits."
            )
        return V

    def changed(self, z: Complexes, of_a: Floats, of_b: Floats) -> SpringEquations:
        """Equations of z after E changes of ``of_a`` and ``of_b``, each shape (E, r, n, 2n), at once."""
        a, b = (each + (of @ z[..., None])[..., 0] for each, of in ((self.a, of_a), (self.b, of_b)))
        return replace(self, a=a, b=b, of_a=self.of_a + of_a, of_b=self.of_b + of_b)

    @property
    def excitation(self) -> Floats:
        """Signal-to-noise ratio of each deflection over all records, √(Σ|a|²/Σ var a), shape (n,)."""
        variance = np.einsum("ria,rab,rib->i", self.of_a, self.noise.covariance[:, 0], self.of_a.conj())
        return np.asarray(np.sqrt((np.abs(self.a) ** 2).sum(axis=0) / np.abs(variance)))

    def matrix(self) -> tuple[Floats, Floats]:
        """A (2nr, 2n) and b (2nr,) of equation (12), in the paper's order D1, K1, D2, K2, ..."""
        r, n = self.a.shape
        A = np.zeros((r, n, 2, n, 2))
        for j in range(n):
            columns = np.stack([1j * self.omega * self.a[:, j], self.a[:, j]], axis=1)
            A[:, j, 0, j], A[:, j, 1, j] = columns.real, columns.imag
        b = np.stack([self.b.real, self.b.imag], axis=2)
        return A.reshape(2 * n * r, 2 * n), b.reshape(2 * n * r)


def spring_equations(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    *,
    noise: Noise | None = None,
    rests: np.ndarray | bool = False,
) -> SpringEquations:
    """Form equations (9) and (11) for every record.

    Parameters
    ----------
    phasors : Phasors
        r records of n joints.
    inertia : Inertia or sequence of Inertia
        One for all records, or one per record for records of several poses.
    noise : Noise, optional
        Noise of the phasors, where it is already known.
    rests : ndarray of bool, shape (n,), optional
        Joints that friction holds in all records: friction may balance their whole torque.

    Returns
    -------
    SpringEquations
        a and b of every record and joint, shape (r, n), with their noise.

    Raises
    ------
    JointIdError
        When the inertias do not match the records, or a joint is not deflected.
    """
    _require_plausible(phasors)
    z = phasors.z
    empty = np.abs(z).max(axis=0) < LEAST
    if np.any(empty[: phasors.n] & empty[phasors.n :]):
        j = int(np.argmax(empty[: phasors.n] & empty[phasors.n :])) + 1
        raise JointIdError(
            f"Joint {j} is not excited: the columns theta_m{j}_rad and tau_m{j}_Nm contain no sine in "
            f"any record, so K{j} and D{j} cannot be identified. Move joint {j}."
        )
    if np.all(empty[phasors.n :]):
        raise JointIdError(
            "No torque contains a sine in any record, so K and D cannot be identified: check the "
            f"columns tau_m1_Nm to tau_m{phasors.n}_Nm."
        )
    M, arm = inertia_arrays(phasors, inertia)
    eye = np.eye(phasors.n)
    s2 = -(phasors.omega[:, None, None] ** 2)
    rigid_a = np.concatenate([(eye + arm * M[:, None]) * s2, -arm], axis=2).astype(complex)
    rigid_b = np.concatenate([-M[:, None] * eye * s2**2, eye * s2], axis=2).astype(complex)
    s = np.asarray(1j * phasors.omega[:, None], np.complex128)
    held = HeldTorque.of(s, phasors.hold_s, phasors.torque_delay_s)
    layout = ParameterLayout.of(phasors.n)
    p = np.zeros(layout.size)
    for _ in range(2 if held.s.size else 1):  # the motion by the images depends on K and D
        moved = held.images(layout.named(p), s[..., None], M, arm)[:, 0]
        of_a, of_b = (_without(moved, rigid) for rigid in (rigid_a, rigid_b))
        a, b = np.einsum("rij,rj->ri", of_a, z), np.einsum("rij,rj->ri", of_b, z)
        for j in np.flatnonzero(np.abs(a).max(axis=0) == 0).tolist():
            raise _not_deflected(j)
        p = np.concatenate(pseudo_inverse(phasors.omega, a, b))
    K, D = np.split(p, 2)
    equations = SpringEquations(
        omega=phasors.omega,
        a=a,
        b=b,
        of_a=of_a,
        of_b=of_b,
        noise=noise or moderated_noise(phasors, M, arm, K, D),
        leakage=phasors.covariance - phasors.harmonic_covariance[:, 0],
    )
    # Noise alone gives an excitation of 1 ± 1/√r; the threshold is three standard deviations above.
    lost = (equations.excitation < 1 + 3 / np.sqrt(phasors.omega.size)) & ~np.asarray(rests)
    if lost.any():
        raise _not_deflected(int(np.argmax(lost)))
    return equations


def _without(moved: Complexes, of_z: Complexes) -> Complexes:
    """Matrix (r, n, 2n) of the signals; angles include the motion ``moved``, (r, n), per torque."""
    n = moved.shape[1]
    found = of_z.copy()
    found[..., n:] -= of_z[..., :n] * moved[:, None]
    return found


def _not_deflected(joint: int) -> JointIdError:
    j = joint + 1
    return JointIdError(
        f"Joint {j} is not excited: its spring is not deflected above the noise in any record, so "
        f"K{j} and D{j} cannot be identified. Move joint {j} more, nearer to its resonance, and "
        f"check the columns theta_m{j}_rad and tau_m{j}_Nm."
    )


def _require_plausible(phasors: Phasors) -> None:
    """Refuse signals whose products overflow, and no signals."""
    phasors.require_records()
    deviation = np.sqrt(np.abs(np.einsum("rhjj->rhj", phasors.harmonic_covariance))).max(axis=1)
    size = np.maximum(np.abs(phasors.harmonics).max(axis=1), np.maximum(np.abs(phasors.z), deviation))
    record, column = np.unravel_index(np.argmax(size), size.shape)
    if size[record, column] > LARGEST:
        n = phasors.n
        name = f"theta_m{column + 1}_rad" if column < n else f"tau_m{column - n + 1}_Nm"
        raise JointIdError(
            f"{phasors.labels[record]}: {name} has an amplitude of {size[record, column]:.3g}; the "
            f"limit is {LARGEST:g}. Check the unit and the values of this column."
        )


def pseudo_inverse(
    omega: Floats, a: Complexes, b: Complexes, *, explicit: bool = False
) -> tuple[Floats, Floats]:
    """K and D of equations (13)-(14): Σ Re(a*b) / Σ|a|² and Σ ω Im(a*b) / Σ ω²|a|², each shape (..., n).

    ``omega`` has shape (r,), ``a`` and ``b`` (..., r, n). ``explicit``: D of equation (15) as printed
    instead, Σ Im(a*b) / Σ ω|a|².
    """
    power, product = np.abs(a) ** 2, a.conj() * b
    weight = np.ones_like(omega) if explicit else omega
    with np.errstate(divide="ignore", invalid="ignore"):
        K = product.real.sum(axis=-2) / power.sum(axis=-2)
        D = weight @ product.imag / ((weight * omega) @ power)
    return K, D


def inertia_arrays(phasors: Phasors, inertia: Inertia | Sequence[Inertia]) -> tuple[Floats, Floats]:
    """M (r, n) and M2⁻¹ (r, n, n) of every record, with gravity at its fundamental."""
    r, n = phasors.q.shape
    inertias = inertia_of_each(inertia, r, n)
    for each in inertias:
        sizes = np.concatenate([each.M, np.diag(each.M2)])
        if sizes.min() < LEAST or sizes.max() > LARGEST:
            wrong = sizes.min() if sizes.min() < LEAST else sizes.max()
            raise JointIdError(
                f"M or M2 holds {wrong:.3g} kg·m²; the limits are {LEAST:g} and {LARGEST:g} kg·m². "
                "Check the unit of the inertias."
            )
    arm = np.linalg.inv(dynamic_arm_inertia(phasors.omega, inertias))
    return np.array([each.M for each in inertias]), np.asarray(arm, float)


def balance(own: Complexes, gain: Complexes) -> Complexes:
    """Torque through the gears by angles and torques of the motors, shape (r, H, n, 2n)."""
    eye = np.eye(own.shape[2])
    return np.concatenate([-own[..., None] * eye, gain[..., None] * eye], axis=3)


def wind_up(of_torque: Complexes, arm: Complexes) -> Complexes:
    """Deflection of the gears by angles and torques of the motors, shape (r, H, n, 2n)."""
    found = -arm @ of_torque
    for j in range(arm.shape[2]):
        found[..., j, j] += 1
    return np.asarray(found)


def noise_of(rows: Iterable[Complexes], covariance: Complexes) -> Floats:
    """Variances, each (r, H, n), of rows (r, H, n, 2n) times signals of a covariance (r, H, 2n, 2n)."""
    return np.stack([((E @ covariance) * E.conj()).sum(axis=3).real for E in rows])


def gear_torque(
    X: Complexes, arm: Complexes, q: Complexes, law: tuple[Complexes, Complexes]
) -> Complexes:
    """Torque through the gears, X (q − w + A⁻¹P), shape (r, H, n)."""
    w, P = law
    return np.asarray((X @ (q - w + (arm @ P[..., None])[..., 0])[..., None])[..., 0])
