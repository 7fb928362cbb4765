"""The balance of torques at the motors at every harmonic: what is left over, its noise, its Jacobian.

At harmonic h, s = ihω, the residual is r = τ e^{-sδ} − F − Z q with the impedance Z = s²(M + S⁻¹),
S = M2⁻¹ + s²(K + sD)⁻¹, the inverse of equation (16), and friction F. Both τ and q carry noise of
covariance C, so that r has the covariance V = E C Eᴴ with E = [−Z, e^{-sδ} I].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.free_friction import FreeFriction
from jointid.friction import FrictionWaveforms
from jointid.joints import Inertia, motor_impedance
from jointid.noise import Noise
from jointid.phasors import Phasors
from jointid.small_matrices import propagated
from jointid.springs import inertia_arrays, spring_equations


@dataclass(frozen=True, eq=False)
class Problem:
    """All that the balance is made of beside the parameters; r records, n joints, H harmonics."""

    s: Complexes  # (r, H)
    z: Complexes  # (r, H, 2n)
    noise: Noise
    known: np.ndarray  # (r, H), false where the samples could not carry the harmonic
    M: Floats  # (r, n)
    arm: Floats  # M2⁻¹, (r, n, n)
    friction: FrictionWaveforms | None
    names: tuple[str, ...]  # of the parameters, K and D first
    stiffest: Floats  # far above the linear estimate: a stiffness that runs away is none

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.M.shape[1])

    @property
    def free(self) -> FreeFriction:
        """What friction may do around the reversals."""
        return FreeFriction(()) if self.friction is None else self.friction.free

    @property
    def counts(self) -> np.ndarray:
        """Whether a joint's torque balance in a record says anything, (r, n)."""
        return np.ones(self.M.shape, bool) if self.friction is None else ~self.friction.standing

    @property
    def rows(self) -> int:
        """How many real equations there are."""
        return int(2 * self.known.sum(axis=1) @ self.counts.sum(axis=1))


def make_problem(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    start: Floats,
    friction: FrictionWaveforms | None,
    delay: bool,
    noise: Noise | None,
) -> Problem:
    """Lay a problem out; the parameters are those of ``jointid.likelihood.maximum_likelihood``.

    Raises
    ------
    JointIdError
        When the start has a negative stiffness, or the inertias do not fit the records.
    """
    n = phasors.n
    if np.any(start[:n] <= 0):
        raise JointIdError(
            f"K{int(np.argmin(start[:n])) + 1} comes out negative by least squares: check the sign and "
            "unit of the torque, the gear ratios, and the inertias M and M2."
        )
    M, arm = inertia_arrays(phasors, inertia)
    return Problem(
        s=np.asarray(1j * phasors.omega[:, None] * np.arange(1, phasors.harmonics.shape[1] + 1)),
        z=phasors.harmonics,
        noise=noise or spring_equations(phasors, inertia).noise,
        known=np.any(phasors.harmonics != 0, axis=2),
        M=M,
        arm=arm,
        friction=friction,
        names=parameter_names(n, friction, delay=delay),
        stiffest=100 * start[:n],
    )


def parameter_names(n: int, friction: FrictionWaveforms | None, *, delay: bool) -> tuple[str, ...]:
    """Names of the parameters in their order."""
    names = [f"{letter}{j + 1}" for letter in "KD" for j in range(n)]
    if friction is not None:
        names += [f"{kind} friction {j + 1}" for kind in ("Coulomb", "viscous") for j in range(n)]
        parts = range(friction.curve.shape[3])
        names += [f"friction curve {c + 1} of joint {j + 1}" for j in range(n) for c in parts]
    return (*names, "delay") if delay else tuple(names)


@dataclass(frozen=True, eq=False)
class Balance:
    """The balance at one set of parameters."""

    problem: Problem
    p: Floats
    r: Complexes
    """Torque left over, shape (r, H, n)."""
    V: Complexes
    """Its covariance, shape (r, H, n, n)."""
    CE: Complexes
    """Covariance of the signals z with it, C Eᴴ, shape (r, H, 2n, n)."""
    stiff: Complexes
    """S⁻¹, shape (r, H, n, n)."""
    lag: Complexes
    """e^{-sδ}, shape (r, H)."""

    @classmethod
    def at(cls, problem: Problem, p: Floats) -> Balance:
        """Form the balance."""
        n, s = problem.n, problem.s
        Z, stiff = motor_impedance(s, problem.M[:, None], problem.arm[:, None], p[:n], p[n : 2 * n])
        lag = np.exp(-s * p[-1]) if problem.names[-1] == "delay" else np.ones_like(s)
        E = np.zeros((*Z.shape[:3], 2 * n), complex)
        E[..., :n] = -Z
        for j in range(n):
            if problem.friction is not None:  # what is viscous acts on q like the impedance
                E[..., j, j] -= s * p[3 * n + j]
            E[..., j, n + j] = lag
        CE = problem.noise.covariance @ E.conj().swapaxes(2, 3)
        r = (E @ problem.z[..., None])[..., 0]
        if problem.friction is not None:
            r -= sliding(problem, p, s.shape[1])
        return cls(problem, p, r, propagated(E, CE), CE, stiff, lag)

    def jacobian(self, pull: Complexes) -> Complexes:
        """∂r/∂p at the smoothed signals z − C Eᴴ V⁻¹r, shape (r, H, n, P).

        Parameters
        ----------
        pull : ndarray, shape (r, H, n)
            V⁻¹r, of that part of r which tells of the signals.
        """
        problem, p, n, s = self.problem, self.p, self.problem.n, self.problem.s
        smooth = problem.z - (self.CE @ pull[..., None])[..., 0]
        J = np.zeros((*self.r.shape, p.size), complex)
        # ∂Z = −s² S⁻¹ ∂S S⁻¹, ∂S = −s² ∂spring/spring² on the diagonal: a product of a column and a row.
        spring = p[:n] + s[..., None] * p[n : 2 * n]
        twist = (self.stiff @ smooth[..., :n, None])[..., 0] * (-((s * s) ** 2)[..., None] / spring**2)
        J[..., :n] = self.stiff * twist[..., None, :]
        J[..., n : 2 * n] = s[..., None, None] * J[..., :n]
        for j in range(n):
            if problem.friction is not None:
                curve = problem.friction.curve[:, :, j]
                first = 4 * n + j * curve.shape[2]
                J[..., j, 2 * n + j] = -problem.friction.coulomb[..., j]
                J[..., j, 3 * n + j] = -s * smooth[..., j]
                J[..., j, first : first + curve.shape[2]] = -curve
            if problem.names[-1] == "delay":
                J[..., j, -1] = -s * self.lag * smooth[..., n + j]
        return J


def sliding(problem: Problem, p: Floats, h: int) -> Complexes:
    """Coulomb friction and its curve at the first h harmonics, shape (r, h, n)."""
    assert problem.friction is not None
    n, curve = problem.n, problem.friction.curve[:, :h]
    weights = p[4 * n : 4 * n + n * curve.shape[3]].reshape(n, -1)
    coulomb = p[2 * n : 3 * n] * problem.friction.coulomb[:, :h]
    return np.asarray(coulomb + (curve * weights).sum(axis=3))
