"""From phasors to stiffness and damping, equations (8)-(15): a linear problem, one line per joint.

With the motors' phasors q and τ and s = iω, the spring deflections have the second derivative

    a = (I + M2⁻¹M) s²q − M2⁻¹τ          (9)

and the springs' torques b = s²τ − M s⁴q (11), again as second derivatives. K and D are diagonal, so that
equation (8) falls into one complex equation per joint and record, (K_j + iωD_j) a_j = b_j.

Erratum. The pseudo-inverse (13)-(14) gives K = Σ Re(a*b) / Σ|a|² and D = Σ ω Im(a*b) / Σ ω²|a|². The
paper's explicit solution (15) has the same K, but D = Σ Im(a*b) / Σ ω|a|²: the same for one frequency,
another weighting for several, exact as well when there is no noise. Both are offered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.joints import Elasticity, Inertia
from jointid.phasors import Phasors

METHODS = {
    "least-squares": "pseudo-inverse, equations (13)-(14)",
    "explicit": "explicit solution, equation (15) as printed",
    "weighted": "weighted least squares, weights from the noise of each record",
}
"""Estimators by name, with a line that says what each is."""

_NOISE_FLOOR = 1e-9  # of the largest phasor of a signal: rounding is never taken for information


@dataclass(frozen=True, eq=False)
class SpringEquations:
    """The n equations (K_j + iωD_j) a_j = b_j of each of r records, and the noise of a and b."""

    omega: Floats
    """Frequencies, shape (r,), rad/s."""
    a: Complexes
    """Second derivative of the deflections, equation (9), shape (r, n), rad/s²."""
    b: Complexes
    """Second derivative of the spring torques, equation (11), shape (r, n), N·m/s²."""
    of_a: Complexes
    """Matrix with a = of_a z, z = [q; τ], shape (r, n, 2n)."""
    of_b: Complexes
    """Matrix with b = of_b z, shape (r, n, 2n)."""
    noise: Complexes
    """Covariance of z, shape (r, 2n, 2n)."""

    @property
    def deflection(self) -> Complexes:
        """Spring deflections q − q_a = a/s², shape (r, n), rad."""
        return np.asarray(-self.a / self.omega[:, None] ** 2)

    @property
    def spring_torque(self) -> Complexes:
        """Spring torques b/s², shape (r, n), N·m."""
        return np.asarray(-self.b / self.omega[:, None] ** 2)

    @property
    def stiffness(self) -> Complexes:
        """Dynamic stiffness b/a of each record alone, K + iωD if the model holds, (r, n), N·m/rad."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.b / self.a)

    def residual(self, K: Floats, D: Floats) -> Complexes:
        """Equation error b − (K + iωD) a, shape (r, n), N·m/s²."""
        return np.asarray(self.b - (K + 1j * self.omega[:, None] * D) * self.a)

    def residual_covariance(self, K: Floats, D: Floats) -> Complexes:
        """Covariance of the equation error from the noise of both a and b, shape (r, n, n)."""
        spring = K + 1j * self.omega[:, None] * D
        E = self.of_b - spring[:, :, None] * self.of_a
        return np.asarray(E @ self.noise @ E.conj().swapaxes(1, 2))

    def matrix(self) -> tuple[Floats, Floats]:
        """A (2nr, 2n) and b (2nr,) of equation (12), in the paper's order D1, K1, D2, K2, ..."""
        r, n = self.a.shape
        A = np.zeros((r, n, 2, n, 2))
        for j in range(n):
            columns = np.stack([1j * self.omega * self.a[:, j], self.a[:, j]], axis=1)
            A[:, j, 0, j], A[:, j, 1, j] = columns.real, columns.imag
        b = np.stack([self.b.real, self.b.imag], axis=2)
        return A.reshape(2 * n * r, 2 * n), b.reshape(2 * n * r)


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction at the motors, τ_effective = τ − coulomb · sign(θ̇) − viscous · θ̇."""

    coulomb: Floats
    """Shape (n,), N·m."""
    viscous: Floats
    """Shape (n,), N·m·s/rad."""


@dataclass(frozen=True, eq=False)
class ElasticityFit:
    """Stiffness and damping of n joints as found from r records."""

    method: str
    K: Floats
    """Stiffness, shape (n,), N·m/rad; negative when the data contradict the model."""
    D: Floats
    """Damping, shape (n,), N·m·s/rad."""
    covariance: Floats
    """Covariance of (K1 ... Kn, D1 ... Dn), shape (2n, 2n): the noise of the phasors carried through
    the estimator, times ``misfit`` where that is above 1."""
    residual: Complexes
    """Torque that the model leaves unexplained, by record and joint, shape (r, n), N·m."""
    residual_noise: Floats
    """What noise alone would leave there (root of the complex variance), shape (r, n), N·m."""
    cost: float
    """Sum over records of eᴴV⁻¹e, the residual measured by its noise."""
    expected_cost: float
    """What ``cost`` is on average when the model is right and the noise as stated: n(r − 1)."""
    equations: SpringEquations
    """The equations that were solved."""
    friction: Friction | None = None
    """Friction that was fitted together with K and D, if it was."""
    delay: float | None = None
    """Seconds by which the torque was found to lag beyond what the records state, if it was fitted."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.K.size)

    @property
    def standard_error(self) -> Floats:
        """Root of the covariance's diagonal, shape (2n,), order K1 ... Kn, D1 ... Dn."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlation(self) -> Floats:
        """Correlation matrix of the estimates, shape (2n, 2n)."""
        error = np.where(self.standard_error > 0, self.standard_error, 1.0)
        return np.asarray(self.covariance / np.outer(error, error))

    @property
    def misfit(self) -> float:
        """Cost over its expected value: about 1 when noise explains the residual; 1 for one record."""
        return self.cost / self.expected_cost if self.expected_cost > 0 else 1.0

    @property
    def condition(self) -> float:
        """Condition number of A in equation (12) with columns of unit length."""
        A, _ = self.equations.matrix()
        singular = np.linalg.svd(A / np.linalg.norm(A, axis=0), compute_uv=False)
        return float(singular[0] / singular[-1])

    @property
    def elasticity(self) -> Elasticity:
        """K and D as a model; a damping that is negative within two standard errors counts as zero.

        Raises
        ------
        JointIdError
            When the estimate is no spring and damper, and so the data or the inertias are wrong.
        """
        n = self.n
        for j in range(n):
            if self.K[j] <= 0:
                raise JointIdError(
                    f"K{j + 1} comes out as {self.K[j]:.4g} N·m/rad, which is no spring. Check the "
                    f"sign and unit of the torque of joint {j + 1}, the gear ratios, and M and M2."
                )
            if self.D[j] < -2 * self.standard_error[n + j]:
                raise JointIdError(
                    f"D{j + 1} comes out as {self.D[j]:.4g} N·m·s/rad, which would feed energy into the "
                    "arm. The torque probably leads or lags: check torque_hold and torque_delay_s."
                )
        return Elasticity(K=self.K, D=np.maximum(self.D, 0.0))


def spring_equations(phasors: Phasors, inertia: Inertia | Sequence[Inertia]) -> SpringEquations:
    """Form equations (9) and (11) for every record.

    Parameters
    ----------
    phasors : Phasors
        r records of n joints.
    inertia : Inertia or sequence of Inertia
        One for all records, or one per record when they come from several poses.
    """
    r, n = phasors.q.shape
    inertias = [inertia] * r if isinstance(inertia, Inertia) else list(inertia)
    if len(inertias) != r:
        raise JointIdError(f"{len(inertias)} inertias for {r} records: give one, or one per record.")
    for each in inertias:
        if each.n != n:
            raise JointIdError(f"The records have {n} joint(s), the inertia has {each.n}.")
    s2 = -(phasors.omega[:, None, None] ** 2)
    M = np.array([np.diag(each.M) for each in inertias])
    arm = np.linalg.inv(np.array([each.M2 for each in inertias]))
    eye = np.broadcast_to(np.eye(n), (r, n, n))
    of_a = np.concatenate([(eye + arm @ M) * s2, -arm], axis=2).astype(complex)
    of_b = np.concatenate([-M * s2**2, eye * s2], axis=2).astype(complex)
    z = phasors.z
    floor = np.diag((_NOISE_FLOOR * np.abs(z).max(axis=0)) ** 2)
    return SpringEquations(
        omega=phasors.omega,
        a=np.einsum("rij,rj->ri", of_a, z),
        b=np.einsum("rij,rj->ri", of_b, z),
        of_a=of_a,
        of_b=of_b,
        noise=phasors.covariance + floor,
    )


def identify_elasticity(
    phasors: Phasors, inertia: Inertia | Sequence[Inertia], *, method: str = "weighted"
) -> ElasticityFit:
    """Find K and D of every joint; one record suffices in principle.

    Parameters
    ----------
    phasors : Phasors
        r records of n joints.
    inertia : Inertia or sequence of Inertia
        Known rigid-body inertia, motor side; one per record when they come from several poses.
    method : {"weighted", "least-squares", "explicit"}
        See ``METHODS``. "weighted" starts from least squares and weights each record's equations
        by the inverse covariance of their error.

    Raises
    ------
    JointIdError
        When a joint's spring is not deflected in any record, or the method is not known.
    """
    if method not in METHODS:
        raise JointIdError(f'method = "{method}" is not known. Methods: {", ".join(METHODS)}.')
    equations = spring_equations(phasors, inertia)
    n = phasors.n
    still = ~(np.abs(equations.a).max(axis=0) > 0)
    if still.any():
        j = int(np.argmax(still)) + 1
        raise JointIdError(
            f"Joint {j} is not excited: its spring is not deflected in any record, so K{j} and D{j} "
            f"cannot be found. Move joint {j}, and check the columns theta_m{j}_rad and tau_m{j}_Nm."
        )
    gain = _explicit(equations) if method == "explicit" else _least_squares(equations)
    if method == "weighted":
        for _ in range(3):  # the weights hang on K and D only weakly: measured, the second pass is final
            p = _apply(gain, equations.b)
            gain = _weighted(equations, equations.residual_covariance(p[:n], p[n:]))
    return _fit(method, equations, gain)


def _least_squares(equations: SpringEquations) -> Complexes:
    """Equations (13)-(14): p = Σ_r Re(G_r b_r) with p = (K, D), G of shape (r, 2n, n)."""
    a, omega = equations.a, equations.omega[:, None]
    stiffness = a.conj() / (np.abs(a) ** 2).sum(axis=0)
    damping = -1j * omega * a.conj() / ((omega * np.abs(a)) ** 2).sum(axis=0)
    return _diagonals(stiffness, damping)


def _explicit(equations: SpringEquations) -> Complexes:
    """Equation (15) as printed."""
    a, omega = equations.a, equations.omega[:, None]
    stiffness = a.conj() / (np.abs(a) ** 2).sum(axis=0)
    damping = -1j * a.conj() / (omega * np.abs(a) ** 2).sum(axis=0)
    return _diagonals(stiffness, damping)


def _weighted(equations: SpringEquations, V: Complexes) -> Complexes:
    """Generalised least squares: the error of joint i may be correlated with that of joint j."""
    R = _diagonals(equations.a, 1j * equations.omega[:, None] * equations.a).swapaxes(1, 2)
    weighted = np.linalg.solve(V, R).conj().swapaxes(1, 2)  # RᴴV⁻¹
    normal = (weighted @ R).sum(axis=0).real
    scale = 1 / np.sqrt(np.diag(normal))  # K and D differ by orders of magnitude
    inverse = scale[:, None] * np.linalg.inv(scale[:, None] * normal * scale) * scale
    return np.asarray(inverse @ weighted)


def _diagonals(first: Complexes, second: Complexes) -> Complexes:
    """Rows (r, n) and (r, n) as two stacked diagonal matrices, (r, 2n, n)."""
    eye = np.eye(first.shape[1])
    return np.concatenate([first[:, :, None] * eye, second[:, :, None] * eye], axis=1)


def _apply(gain: Complexes, b: Complexes) -> Floats:
    return np.asarray(np.einsum("rpj,rj->p", gain, b).real)


def _fit(method: str, equations: SpringEquations, gain: Complexes) -> ElasticityFit:
    r, n = equations.a.shape
    p = _apply(gain, equations.b)
    K, D = p[:n], p[n:]
    e = equations.residual(K, D)
    V = equations.residual_covariance(K, D)
    cost = float(np.einsum("ri,ri->", e.conj(), np.linalg.solve(V, e[..., None])[..., 0]).real)
    expected = float(n * (r - 1))
    # Re(G e) of a circular complex e has half the covariance of the complex number.
    covariance = 0.5 * np.einsum("rpi,rij,rqj->pq", gain, V, gain.conj()).real
    inflation = max(1.0, cost / expected) if expected > 0 else 1.0
    noise = np.sqrt(np.abs(np.einsum("rjj->rj", V)))
    squared = equations.omega[:, None] ** 2
    return ElasticityFit(
        method=method,
        K=K,
        D=D,
        covariance=covariance * inflation,
        residual=-e / squared,
        residual_noise=noise / squared,
        cost=cost,
        expected_cost=expected,
        equations=equations,
    )
