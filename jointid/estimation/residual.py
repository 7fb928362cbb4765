"""Residual torque of the model at the motors at every harmonic, its covariance and its Jacobian.

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
from jointid.estimation.free_friction import FreeFriction
from jointid.estimation.friction import FrictionWaveforms
from jointid.estimation.joint_equations import inertia_arrays, spring_equations
from jointid.estimation.noise import Noise
from jointid.estimation.parameters import ParameterLayout, Parameters
from jointid.joints import Inertia, motor_impedance
from jointid.phasors.extract import Phasors
from jointid.small_matrices import propagated

_STIFFEST = 100.0
"""Upper bound on K as a multiple of the start value; beyond it the iteration has diverged."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Data and fixed quantities of the residual; r records, n joints, H harmonics."""

    s: Complexes  # (r, H)
    z: Complexes  # (r, H, 2n)
    noise: Noise
    known: np.ndarray  # (r, H), false where the sample rate or record length excludes the harmonic
    M: Floats  # (r, n)
    arm: Floats  # M2⁻¹, (r, n, n)
    friction: FrictionWaveforms | None
    layout: ParameterLayout
    stiffest: Floats  # upper bound on K, (n,)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.M.shape[1])

    @property
    def free(self) -> FreeFriction:
        """Free friction waveforms around the reversals."""
        return FreeFriction(()) if self.friction is None else self.friction.free

    @property
    def used(self) -> np.ndarray:
        """Whether a joint's residual in a record carries information, shape (r, n)."""
        return np.ones(self.M.shape, bool) if self.friction is None else ~self.friction.stationary

    @property
    def rows(self) -> int:
        """Number of real equations."""
        return int(2 * self.known.sum(axis=1) @ self.used.sum(axis=1))


def make_problem(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    start: Floats,
    friction: FrictionWaveforms | None,
    delay: bool,
    noise: Noise | None,
) -> Problem:
    """Collect the data of a fit; parameters as in ``likelihood.maximum_likelihood``.

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
        layout=fitted_layout(n, friction, delay=delay),
        stiffest=_STIFFEST * start[:n],
    )


def fitted_layout(n: int, friction: FrictionWaveforms | None, *, delay: bool) -> ParameterLayout:
    """Parameters of a fit with these friction waveforms and with or without a delay."""
    parts = 0 if friction is None else friction.curve.shape[3]
    return ParameterLayout.of(n, friction=friction is not None, curve_parts=parts, delay=delay)


@dataclass(frozen=True, eq=False)
class Residual:
    """Residual torque at one set of parameters."""

    problem: Problem
    p: Parameters
    r: Complexes
    """Residual, shape (r, H, n), N·m."""
    V: Complexes
    """Its covariance, shape (r, H, n, n)."""
    CE: Complexes
    """Covariance of the signals z with it, C Eᴴ, shape (r, H, 2n, n)."""
    stiff: Complexes
    """S⁻¹, shape (r, H, n, n)."""
    lag: Complexes
    """e^{-sδ}, shape (r, H)."""

    @classmethod
    def at(cls, problem: Problem, vector: Floats) -> Residual:
        """Evaluate the residual at a parameter vector, shape (P,)."""
        n, s, p = problem.n, problem.s, problem.layout.named(vector)
        Z, stiff = motor_impedance(s, problem.M[:, None], problem.arm[:, None], p.K, p.D)
        lag = np.exp(-s * p.delay)
        E = np.zeros((*Z.shape[:3], 2 * n), complex)
        E[..., :n] = -Z
        for j in range(n):
            if problem.friction is not None:  # viscous friction acts on q like the impedance
                E[..., j, j] -= s * p.viscous[j]
            E[..., j, n + j] = lag
        CE = problem.noise.covariance @ E.conj().swapaxes(2, 3)
        r = (E @ problem.z[..., None])[..., 0]
        if problem.friction is not None:
            r -= sliding_friction(problem.friction, p, s.shape[1])
        return cls(problem, p, r, propagated(E, CE), CE, stiff, lag)

    def jacobian(self, weighted_residual: Complexes) -> Complexes:
        """∂r/∂p at the smoothed signals z − C Eᴴ V⁻¹r, shape (r, H, n, P).

        Parameters
        ----------
        weighted_residual : ndarray, shape (r, H, n)
            V⁻¹r without the part that free friction explains.
        """
        problem, p, n, s = self.problem, self.p, self.problem.n, self.problem.s
        layout = problem.layout
        smooth = problem.z - (self.CE @ weighted_residual[..., None])[..., 0]
        J = np.zeros((*self.r.shape, layout.size), complex)
        # ∂Z = −s² S⁻¹ ∂S S⁻¹, ∂S = −s² ∂spring/spring² on the diagonal: a product of a column and a row.
        spring = p.K + s[..., None] * p.D
        twist = (self.stiff @ smooth[..., :n, None])[..., 0] * (-((s * s) ** 2)[..., None] / spring**2)
        J[..., layout["K"]] = self.stiff * twist[..., None, :]
        J[..., layout["D"]] = s[..., None, None] * J[..., layout["K"]]
        for j in range(n):
            if problem.friction is not None:
                curve = problem.friction.curve[:, :, j]
                first = layout["curve"].start + j * curve.shape[2]
                J[..., j, layout["coulomb"].start + j] = -problem.friction.coulomb[..., j]
                J[..., j, layout["viscous"].start + j] = -s * smooth[..., j]
                J[..., j, first : first + curve.shape[2]] = -curve
            if "delay" in layout:
                J[..., j, layout["delay"].start] = -s * self.lag * smooth[..., n + j]
        return J


def sliding_friction(friction: FrictionWaveforms, p: Parameters, h: int) -> Complexes:
    """Coulomb friction and its curve at the first h harmonics, shape (r, h, n), N·m."""
    curve = (friction.curve[:, :h] * p.curve).sum(axis=3)
    return np.asarray(p.coulomb * friction.coulomb[:, :h] + curve)
