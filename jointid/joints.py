"""The model: n elastic joints with coupled inertia, equations (1), (5)-(7) and (16).

Motor side throughout: every inertia, stiffness and damping is reflected to the motor shaft.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag, eigh

from jointid.arrays import Complexes, Floats, finite_array, frozen, set_fields
from jointid.errors import JointIdError
from jointid.small_matrices import inverse
from jointid.wording import counted

_SLOWEST = 1e-3
"""Frequency used in place of zero where gravity acts, rad/s."""


@dataclass(frozen=True, eq=False)
class Inertia:
    """Rigid-body inertia of n joints, equation (7), motor side; fields take any array_like.

    Raises JointIdError when a rotor inertia is not positive, or M2 or M2 − added is not symmetric and
    positive definite.
    """

    M: Floats
    """Rotor inertias J_m1 ... J_mn, shape (n,), kg·m²."""
    M2: Floats
    """Arm inertia matrix with the coupling inertias J_12 = J_21 off its diagonal, shape (n, n), kg·m².
    A single joint may give a plain number."""
    added: Floats
    """Exactly known part of M2, shape (n, n), kg·m², such as a payload of known mass and position. The
    uncertainty of M2 then applies to M2 − added. By default zero."""
    gravity: Floats
    """Gravity stiffness: the derivative of the static torque with respect to the joint angles,
    shape (n, n), N·m/rad; as uncertain as M2. By default zero: a horizontal arm."""
    shared: Floats
    """Change of M2 by one standard deviation of an unknown common to all poses, such as the mass of the
    payload, shape (n, n), kg·m². By default zero."""
    shared_gravity: Floats
    """Change of ``gravity`` by the same, shape (n, n), N·m/rad. By default zero."""

    def __init__(
        self,
        M: ArrayLike,
        M2: ArrayLike,
        added: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        shared: ArrayLike | None = None,
        shared_gravity: ArrayLike | None = None,
    ) -> None:
        rotor = finite_array("M (rotor inertias, kg·m²)", M, ndim=1)
        n = rotor.size
        if n == 0:
            raise JointIdError("M (rotor inertias, kg·m²) is empty: give one value per joint.")
        arm = _symmetric("M2", "arm inertia", M2, n)
        _require_positive("M", rotor, "kg·m²")
        _require_positive_definite("M2", arm)
        known = _symmetric("added", "known part of M2", added, n)
        if known.any():
            _require_positive_definite("M2 − added (M2 is the total)", arm - known)
        set_fields(
            self,
            M=rotor,
            M2=arm,
            added=known,
            gravity=_symmetric("gravity", "gravity stiffness", gravity, n, "N·m/rad"),
            shared=_symmetric("shared", "change of M2", shared, n),
            shared_gravity=_symmetric("shared_gravity", "gravity change", shared_gravity, n, "N·m/rad"),
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.M.size)

    def with_added(self, added: ArrayLike) -> Inertia:
        """Return the inertia with an exactly known addition to M2, shape (n, n), motor side, kg·m².

        Raises JointIdError when it is not symmetric or has another shape, or the sum is invalid.
        """
        more = _symmetric("added", "addition to M2", added, self.n)
        return replace(self, M2=self.M2 + more, added=self.added + more)


def dynamic_arm_inertia(omega: ArrayLike, inertia: Inertia | Sequence[Inertia]) -> Floats:
    """Return M2 − gravity/ω², shape (f, n, n): torque over acceleration of the arm at a frequency.

    ``omega``, shape (f,), is in rad/s, where 0 counts as 0.001 rad/s if gravity acts; ``inertia`` is one
    for all frequencies, or one for each.
    """
    each = [inertia] if isinstance(inertia, Inertia) else inertia
    M2, gravity = np.array([i.M2 for i in each]), np.array([i.gravity for i in each])
    squared = np.maximum(np.abs(np.asarray(omega, float)), _SLOWEST) ** 2
    if not gravity.any():
        return np.broadcast_to(M2, (squared.size, *M2.shape[1:]))
    return np.asarray(M2 - gravity / squared[:, None, None])


def _symmetric(name: str, what: str, values: ArrayLike | None, n: int, unit: str = "kg·m²") -> Floats:
    """Return a symmetric matrix of inertias or of gravity's stiffness, shape (n, n); zero by default."""
    if values is None:
        return frozen(np.zeros((n, n)))
    if isinstance(values, Sequence) and len(values) == 1 and isinstance(values[0], int | float):
        values = values[0]  # of a single joint
    matrix = finite_array(f"{name} ({what}, {unit})", values, ndim=2)
    if matrix.shape != (n, n):
        raise JointIdError(
            f"{name} has shape {matrix.shape}: expected ({n}, {n}), since M has {counted(n, 'value')}."
        )
    symbol, scale = "J", np.sqrt(np.outer(np.abs(np.diag(matrix)), np.abs(np.diag(matrix))))
    if unit != "kg·m²":  # gravity may act on one joint alone, or change its sign
        symbol, scale = name, np.full((n, n), np.abs(matrix).max())
    if np.any(np.abs(matrix - matrix.T) > 1e-6 * scale):
        i, j = np.unravel_index(np.argmax(np.abs(matrix - matrix.T)), matrix.shape)
        raise JointIdError(
            f"{name} must be symmetric: {symbol}_{i + 1}{j + 1} = {matrix[i, j]:g} {unit} but "
            f"{symbol}_{j + 1}{i + 1} = {matrix[j, i]:g} {unit}. "
            "Both elements state the same coupling: give one value."
        )
    return frozen((matrix + matrix.T) / 2)


def _require_positive_definite(name: str, matrix: Floats) -> None:
    smallest = float(np.linalg.eigvalsh(matrix)[0])
    if smallest <= 0:
        raise JointIdError(
            f"{name} must be positive definite, but its smallest eigenvalue is {smallest:g} kg·m²: "
            "a coupling inertia must stay below sqrt(J_ai · J_aj). Check units and gear ratios."
        )


def arm_inertia(i: int, j: int) -> str:
    """Name of an element of M2, joints counted from 1: J_a1, J_12."""
    return f"J_a{i}" if i == j else f"J_{min(i, j)}{max(i, j)}"


@dataclass(frozen=True, eq=False)
class Elasticity:
    """Stiffness and damping of n joints, equation (7), motor side; fields take any array_like.

    Raises JointIdError when the shapes differ, or a value is out of range.
    """

    K: Floats
    """Stiffness, shape (n,), N·m/rad, positive."""
    D: Floats
    """Damping, shape (n,), N·m·s/rad, not negative."""

    def __init__(self, K: ArrayLike, D: ArrayLike) -> None:
        stiffness = finite_array("K (stiffness, N·m/rad)", K, ndim=1)
        damping = finite_array("D (damping, N·m·s/rad)", D, ndim=1)
        if stiffness.shape != damping.shape or stiffness.size == 0:
            raise JointIdError(
                f"K has {counted(stiffness.size, 'value')} and D has {damping.size}: "
                "give one of each per joint."
            )
        _require_positive("K", stiffness, "N·m/rad")
        if np.any(damping < 0):
            j = int(np.argmin(damping))
            raise JointIdError(
                f"D{j + 1} = {damping[j]:g} N·m·s/rad: damping must not be negative "
                "(a negative one would feed energy into the arm)."
            )
        set_fields(self, K=stiffness, D=damping)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.K.size)


def motor_response(omega: ArrayLike, inertia: Inertia, elasticity: Elasticity) -> Complexes:
    """Transfer matrix from motor torque to motor acceleration, equation (16).

    Written with the compliance seen by the motors, S = M2⁻¹ + s²(K + sD)⁻¹, equations (5) and (6)
    become H = S (I + M S)⁻¹: no denominator vanishes at ω = 0, where H = (M + M2)⁻¹, or at a zero of H.

    Parameters
    ----------
    omega : array_like, shape (f,)
        Angular frequencies, rad/s.
    inertia, elasticity
        The model, n joints.

    Returns
    -------
    ndarray, shape (f, n, n), complex
        H(iω), 1/(kg·m²).

    Raises
    ------
    JointIdError
        When inertia and elasticity have different numbers of joints.
    """
    s2, spring = _laplace(omega, inertia, elasticity)
    arm = np.linalg.inv(dynamic_arm_inertia(np.ravel(omega), inertia))
    S = arm + _diagonal(s2[:, None] / spring)
    return np.asarray(S @ np.linalg.inv(np.eye(inertia.n) + inertia.M[:, None] * S))


def motor_impedance(
    s: Complexes, M: Floats, arm: Floats | Complexes, K: Floats, D: Floats
) -> tuple[Complexes, Complexes]:
    """Torque over angle at the motors, Z = s²(M + S⁻¹), the inverse of equation (16) times s².

    Of the Laplace variable s, shape (...,), rad/s, rotor inertias M, (..., n), ``arm`` = M2⁻¹,
    (..., n, n), and K and D, (n,), which unlike those of a model may have any sign. Returns Z, N·m/rad,
    and S⁻¹ = (M2⁻¹ + s²(K + sD)⁻¹)⁻¹, kg·m², each (..., n, n).
    """
    s2 = s * s
    compliance = np.empty((*s.shape, K.size, K.size), complex)
    compliance[...] = arm
    for j in range(K.size):
        compliance[..., j, j] += s2 / (K[j] + s * D[j])
    stiff = inverse(compliance)
    Z = stiff.copy()
    for j in range(K.size):
        Z[..., j, j] += M[..., j]
    Z *= s2[..., None, None]
    return Z, stiff


def locked_motor_response(omega: ArrayLike, inertia: Inertia, elasticity: Elasticity) -> Complexes:
    """Arm acceleration over arm torque with every motor locked, (M2 s² + sD + K)⁻¹ s².

    Parameters
    ----------
    omega, inertia, elasticity
        As in ``motor_response``, with the same errors.

    Returns
    -------
    ndarray, shape (f, n, n), complex
        Response of the arm on its springs, 1/(kg·m²); infinite only where an undamped joint resonates.
    """
    s2, spring = _laplace(omega, inertia, elasticity)
    dynamic = inertia.M2 * s2[:, None, None] + inertia.gravity + _diagonal(spring)
    response = np.full(dynamic.shape, np.inf + 0j)
    regular = np.abs(np.linalg.det(dynamic)) > 0
    response[regular] = s2[regular, None, None] * np.linalg.inv(dynamic[regular])
    return response


def resonances(inertia: Inertia, elasticity: Elasticity) -> Floats:
    """Undamped natural frequencies of motors and arm together, poles of H.

    Parameters
    ----------
    inertia, elasticity
        As in ``motor_response``, with the same errors.

    Returns
    -------
    ndarray, shape (n,)
        Frequencies in Hz, ascending, without the n rigid-body modes at 0 Hz.
    """
    return _natural_frequencies_hz(inertia, elasticity, moving=np.ones(inertia.n, bool))


def locked_resonances(inertia: Inertia, elasticity: Elasticity) -> Floats:
    """Undamped natural frequencies of the arm with every motor locked.

    Parameters
    ----------
    inertia, elasticity
        As in ``motor_response``, with the same errors.

    Returns
    -------
    ndarray, shape (n,)
        Frequencies in Hz, ascending.
    """
    return _natural_frequencies_hz(inertia, elasticity, moving=np.zeros(inertia.n, bool))


def diagonal_zeros(inertia: Inertia, elasticity: Elasticity) -> Floats:
    """Undamped zeros of each diagonal element H_jj: resonances with motor j locked.

    Parameters
    ----------
    inertia, elasticity
        As in ``motor_response``, with the same errors.

    Returns
    -------
    ndarray, shape (n, n)
        Row j holds the n zeros of H_jj in Hz, ascending.
    """
    rows = ~np.eye(inertia.n, dtype=bool)
    return np.array([_natural_frequencies_hz(inertia, elasticity, moving=row) for row in rows])


def _natural_frequencies_hz(inertia: Inertia, elasticity: Elasticity, moving: np.ndarray) -> Floats:
    """Spring deflections x obey ẍ = −(M⁻¹ + M2⁻¹)K x; a locked motor counts as M⁻¹ = 0."""
    require_same_joints(inertia, elasticity)
    if inertia.gravity.any():  # the n highest of arm and motors: the others swing slowly under gravity
        K, kept = np.diag(elasticity.K), np.concatenate([moving, np.ones(inertia.n, bool)])
        stiffness = np.block([[K, -K], [-K, K + inertia.gravity]])
        mass = block_diag(np.diag(inertia.M), inertia.M2)
        squared = eigh(stiffness[np.ix_(kept, kept)], mass[np.ix_(kept, kept)], eigvals_only=True)
        squared = squared[-inertia.n :]
    else:
        mobility = np.linalg.inv(inertia.M2) + np.diag(np.where(moving, 1 / inertia.M, 0.0))
        root = np.sqrt(elasticity.K)
        squared = np.linalg.eigvalsh(root[:, None] * mobility * root)
    return np.asarray(np.sqrt(np.maximum(squared, 0.0)) / (2 * np.pi))  # rounding may be below zero


def _laplace(omega: ArrayLike, inertia: Inertia, elasticity: Elasticity) -> tuple[Complexes, Complexes]:
    """s² (f,) and the spring constants K + sD (f, n) at s = iω."""
    require_same_joints(inertia, elasticity)
    s = 1j * finite_array("omega (rad/s)", omega, ndim=1)
    return s * s, elasticity.K + s[:, None] * elasticity.D


def _diagonal(rows: Complexes) -> Complexes:
    """Rows (f, n) as diagonal matrices (f, n, n)."""
    return np.asarray(rows[:, :, None] * np.eye(rows.shape[1]))


def require_same_joints(inertia: Inertia, elasticity: Elasticity) -> None:
    """Raise JointIdError when the numbers of joints differ, or a value is of another kind."""
    if not isinstance(inertia, Inertia) or not isinstance(elasticity, Elasticity):
        raise JointIdError("Expected an Inertia and an Elasticity, in this order.")
    if inertia.n != elasticity.n:
        raise JointIdError(
            f"The inertia has {counted(inertia.n, 'joint')}, the elasticity {elasticity.n}: "
            "they must agree."
        )


def _require_positive(name: str, values: Floats, unit: str) -> None:
    if np.any(values <= 0):
        j = int(np.argmin(values))
        raise JointIdError(f"{name}{j + 1} = {values[j]:g} {unit}: it must be positive.")
