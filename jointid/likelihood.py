"""Maximum likelihood of K, D, friction and delay: errors in variables, every harmonic, one Gauss-Newton.

At harmonic h, s = ihω, the torque balance at the motors is r = τ e^{-sδ} − F − Z q = 0 with the
impedance Z = s²(M + S⁻¹), S = M2⁻¹ + s²(K + sD)⁻¹, the inverse of equation (16), and friction F. Both τ
and q carry noise of covariance C, so that r has the covariance V = E C Eᴴ, E = [−Z, I]. Maximising the
likelihood over the unknown true τ and q as well leaves Σ rᴴV⁻¹r to be minimised over the parameters. Its
gradient is 2 Re JᴴV⁻¹r with the Jacobian J taken at the smoothed signals z − C EᴴV⁻¹r: this is what
removes the bias that noise in q brings to least squares (Pintelon and Schoukens, System Identification,
2nd ed. 2012, chapter 9; Söderström, Errors-in-Variables Methods in System Identification, 2018).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.free_friction import FreeFriction, real_rows
from jointid.friction import FrictionWaveforms
from jointid.joints import Inertia, motor_impedance
from jointid.linear_fit import Estimate
from jointid.noise import Noise
from jointid.phasors import Phasors
from jointid.small_matrices import inverse, whitener
from jointid.springs import inertia_arrays, spring_equations

_PASSES = 15  # twice what any model that fits has taken
_INSEPARABLE = 1e-10  # smallest eigenvalue of the scaled information matrix that still tells two apart


@dataclass(frozen=True, eq=False)
class LikelihoodEstimate(Estimate):
    """The estimate, with what it takes for friction and delay."""

    phasors: Phasors
    """The phasors whose torque is freed from friction and delay: what the springs and inertias got."""


@dataclass(frozen=True, eq=False)
class _Problem:
    s: Complexes  # (r, H)
    z: Complexes  # (r, H, 2n)
    noise: Noise
    known: np.ndarray  # (r, H), false where the samples could not carry the harmonic
    M: Floats  # (r, n)
    arm: Floats  # M2⁻¹, (r, n, n)
    friction: FrictionWaveforms | None
    names: tuple[str, ...]  # of the parameters, K and D first
    free: FreeFriction
    stiffest: Floats  # far above the linear estimate: a stiffness that runs away is none

    @property
    def n(self) -> int:
        return int(self.M.shape[1])

    @property
    def counts(self) -> np.ndarray:
        """Whether a joint's torque balance in a record says anything, (r, n)."""
        return np.ones(self.M.shape, bool) if self.friction is None else ~self.friction.standing

    @property
    def rows(self) -> int:
        """How many real equations there are."""
        return int(2 * self.known.sum(axis=1) @ self.counts.sum(axis=1))


def maximum_likelihood(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    start: Floats,
    *,
    friction: FrictionWaveforms | None = None,
    delay: bool = False,
    noise: Noise | None = None,
) -> LikelihoodEstimate:
    """Fit K and D, and on demand friction and delay, to all records and harmonics.

    Parameters
    ----------
    phasors : Phasors
    inertia : Inertia or sequence of Inertia
        One for all records, or one per record.
    start : ndarray, shape (2n,) or (P,)
        K and D to begin with, from a linear estimator, or all parameters from a like fit.
    friction : FrictionWaveforms, optional
        Fit Coulomb and viscous friction with these waveforms.
    delay : bool, default False
        Fit a lag of the torque beyond what the records state.
    noise : Noise, optional
        Of the phasors, where it is known already.

    Returns
    -------
    LikelihoodEstimate
        p = (K, D, then coulomb (n), viscous (n) and the friction curve (n · c), then delay), as far as
        fitted. A Coulomb friction
        that no record shows, since its motor never reverses, is zero with variance zero.

    Raises
    ------
    JointIdError
        When the data cannot tell some parameters apart, or no positive stiffness fits.
    """
    n = phasors.n
    names = [f"{letter}{j + 1}" for letter in "KD" for j in range(n)]
    if friction is not None:
        names += [f"{kind} friction {j + 1}" for kind in ("Coulomb", "viscous") for j in range(n)]
        parts = range(friction.curve.shape[3])
        names += [f"friction curve {c + 1} of joint {j + 1}" for j in range(n) for c in parts]
    if delay:
        names.append("delay")
    if np.any(start[:n] <= 0):
        raise JointIdError(
            f"K{int(np.argmin(start[:n])) + 1} comes out negative by least squares: check the sign and "
            "unit of the torque, the gear ratios, and the inertias M and M2."
        )
    M, arm = inertia_arrays(phasors, inertia)
    problem = _Problem(
        s=np.asarray(1j * phasors.omega[:, None] * np.arange(1, phasors.harmonics.shape[1] + 1)),
        z=phasors.harmonics,
        noise=noise or spring_equations(phasors, inertia).noise,
        known=np.any(phasors.harmonics != 0, axis=2),
        M=M,
        arm=arm,
        friction=friction,
        names=tuple(names),
        free=FreeFriction(()) if friction is None else FreeFriction.of(friction.reversals),
        stiffest=100 * start[:n],
    )
    p = np.concatenate([start, np.zeros(len(names) - start.size)])
    scale = np.ones(problem.s.shape[1])
    _require_rows(problem, p)
    p, _ = _minimise(problem, p, scale)
    rank = _rank(problem, p)
    # A harmonic that the model leaves unexplained counts as much less as it fits worse, and never more.
    scale = np.maximum(1.0, _misfit_by_harmonic(problem, p, rank))
    p, normal = _minimise(problem, p, scale)
    information = _inverse(problem, normal)
    rows, _ = _whitened(problem, p, np.ones_like(scale))
    first = problem.z[:, 0]
    clean = replace(phasors, q=first[:, :n], tau=first[:, n:] - _taken(problem, p, scale))
    clean = replace(clean, covariance=phasors.harmonic_covariance[:, 0])
    return LikelihoodEstimate(
        p=p,
        covariance=0.5 * information,
        cost=float((rows**2).sum()),
        expected_cost=max((problem.rows - rank - len(names)) / 2, 0.0),
        parameters=rank + len(names),
        phasors=clean,
    )


def _require_rows(problem: _Problem, p: Floats) -> None:
    if problem.rows >= problem.free.shapes + 2 * p.size or not problem.free.groups:
        return
    if problem.rows < _rank(problem, p) + 2 * p.size:
        raise JointIdError(
            "The phasors hold too few harmonics to tell friction from elasticity: extract them with "
            "harmonics=31, or sample faster."
        )


def _minimise(problem: _Problem, p: Floats, scale: Floats) -> tuple[Floats, Floats]:
    """Levenberg-Marquardt; returns the parameters and the normal matrix Σ JᵀJ there.

    It ends when a step is a hundredth of an error bar, as the misfit widens it.
    """
    n, damping = problem.n, 1e-3
    cost, gradient, normal = _quadratic(problem, p, scale)
    for _ in range(_PASSES):
        size = np.sqrt(np.diag(normal))
        size = np.where(size > 0, size, 1.0)
        near = 1e-2 * np.sqrt(max(1.0, 2 * cost / problem.rows))
        while True:
            scaled = normal / np.outer(size, size) + damping * np.eye(p.size)
            step = -np.linalg.solve(scaled, gradient / size) / size
            trial = p + step
            if np.all(trial[:n] > 0) and np.all(trial[:n] < problem.stiffest):
                if damping < 1 and np.abs(step * size).max() < near:
                    return trial, normal
                new = _quadratic(problem, trial, scale)
                if new[0] <= cost * (1 + 1e-12):
                    break
            if damping > 1e8:
                return p, normal
            damping = max(10 * damping, 1e-6)
        p, (cost, gradient, normal) = trial, new
        damping /= 10
    return p, normal


def _quadratic(problem: _Problem, p: Floats, scale: Floats) -> tuple[float, Floats, Floats]:
    """Cost, half its gradient, and normal matrix."""
    rows, columns = _whitened(problem, p, scale)
    rows, columns = rows.reshape(-1), columns.reshape(-1, p.size)
    return float(rows @ rows), columns.T @ rows, columns.T @ columns


def _whitened(problem: _Problem, p: Floats, scale: Floats) -> tuple[Floats, Floats]:
    """Residual (r, m) and Jacobian (r, m, P) in units of noise, without what friction is free to do."""
    r, V, J = _balance(problem, p)
    W = _whitener(problem, V, scale)
    both = real_rows(W @ np.concatenate([r[..., None], J], axis=3))
    problem.free.take_out(both, W)
    return both[..., 0], both[..., 1:]


def _rank(problem: _Problem, p: Floats) -> int:
    """How many real numbers the free shapes are worth."""
    if not problem.free.groups:
        return 0
    _, V, _ = _balance(problem, p)
    return problem.free.rank(_whitener(problem, V, np.ones(problem.s.shape[1])))


def _whitener(problem: _Problem, V: Complexes, scale: Floats) -> Complexes:
    """W with W V Wᴴ = I for the balances that count, zero for the others, (r, H, n, n)."""
    V = V * (problem.noise.inverse_bias[:, None] * scale)[..., None, None]
    counts = problem.counts[:, None, :, None]
    V = np.where(counts & counts.swapaxes(2, 3), V, np.eye(problem.n))
    return np.asarray(whitener(V) * (problem.known[..., None, None] & counts))


def _taken(problem: _Problem, p: Floats, scale: Floats) -> Complexes:
    """Fundamental of the torque that friction and delay take, shape (r, n)."""
    n, s, z = problem.n, problem.s[:, :1], problem.z[:, 0]
    lag = p[-1] if problem.names[-1] == "delay" else 0.0
    taken = z[:, n:] * (1 - np.exp(-s * lag))
    if problem.friction is None:
        return np.asarray(taken)
    taken = taken + _sliding(problem, p, 1)[:, 0] + p[3 * n : 4 * n] * s * z[:, :n]
    r, V, _ = _balance(problem, p)
    taken = taken + problem.free.fundamental(r, _whitener(problem, V, scale))
    taken = np.where(problem.counts, taken, taken + r[:, 0])  # all that is left over is friction
    return np.asarray(taken)


def _balance(problem: _Problem, p: Floats) -> tuple[Complexes, Complexes, Complexes]:
    """Torque left over r (r, H, n), its covariance (r, H, n, n) and Jacobian (r, H, n, P)."""
    n, s, z = problem.n, problem.s, problem.z
    K, D = p[:n], p[n : 2 * n]
    spring = K + s[..., None] * D
    Z, stiff = motor_impedance(s, problem.M[:, None], problem.arm[:, None], K, D)
    if problem.friction is not None:  # what is viscous acts on q like the impedance
        Z = Z + s[..., None, None] * (p[3 * n : 4 * n] * np.eye(n))
    lag = np.exp(-s * p[-1]) if problem.names[-1] == "delay" else np.ones_like(s)
    E = np.concatenate([-Z, lag[..., None, None] * np.eye(n)], axis=3)
    CE = problem.noise.covariance @ E.conj().swapaxes(2, 3)
    V = E @ CE
    r = (E @ z[..., None])[..., 0]
    if problem.friction is not None:
        r = r - _sliding(problem, p, s.shape[1])
    smooth = z - (CE @ (inverse(V) @ r[..., None]))[..., 0]

    J = np.zeros((*r.shape, p.size), complex)
    # ∂Z = −s² S⁻¹ ∂S S⁻¹ and ∂S = −s² ∂spring/spring² on the diagonal: a product of a column and a row.
    pull = (stiff @ smooth[..., :n, None])[..., 0] / spring**2
    J[..., :n] = -(s[..., None, None] ** 4) * stiff * pull[..., None, :]
    J[..., n : 2 * n] = s[..., None, None] * J[..., :n]
    if problem.friction is not None:
        J[..., 2 * n : 3 * n] = -problem.friction.coulomb[..., None] * np.eye(n)
        J[..., 3 * n : 4 * n] = -(s[..., None] * smooth[..., :n])[..., None] * np.eye(n)
        curve = problem.friction.curve
        for j in range(n):
            first = 4 * n + j * curve.shape[3]
            J[..., j, first : first + curve.shape[3]] = -curve[:, :, j]
    if problem.names[-1] == "delay":
        J[..., -1] = -(s * lag)[..., None] * smooth[..., n:]
    return r, V, J


def _sliding(problem: _Problem, p: Floats, h: int) -> Complexes:
    """Coulomb friction and its curve at the first h harmonics, shape (r, h, n)."""
    assert problem.friction is not None
    n, curve = problem.n, problem.friction.curve[:, :h]
    weights = p[4 * n : 4 * n + n * curve.shape[3]].reshape(n, -1)
    coulomb = p[2 * n : 3 * n] * problem.friction.coulomb[:, :h]
    return np.asarray(coulomb + (curve * weights).sum(axis=3))


def _misfit_by_harmonic(problem: _Problem, p: Floats, rank: int) -> Floats:
    """Cost over expected cost of each harmonic, shape (H,)."""
    ones = np.ones(problem.s.shape[1])
    rows, _ = _whitened(problem, p, ones)
    H, n = problem.s.shape[1], problem.n
    squares = (rows**2).reshape(-1, 2, H, n).sum(axis=(0, 1, 3))
    measured = problem.counts.sum(axis=1) @ problem.known
    left = 1 - rank / max(problem.rows, 1)
    return np.asarray(squares / np.maximum(measured * left, 1.0))


def _inverse(problem: _Problem, normal: Floats) -> Floats:
    """Inverse of the normal matrix; parameters without any effect stay out of it."""
    size = np.sqrt(np.diag(normal))
    seen = size > 0
    scaled = normal[np.ix_(seen, seen)] / np.outer(size[seen], size[seen])
    values, vectors = np.linalg.eigh(scaled)
    if values[0] < _INSEPARABLE:
        names = np.array(problem.names)[seen][np.abs(vectors[:, 0]) > 0.3]
        raise JointIdError(
            f"The records cannot tell {' and '.join(names)} apart. Add records at other frequencies, "
            "and with other relative amplitudes and phases of the joints."
        )
    inverse = np.zeros_like(normal)
    inverse[np.ix_(seen, seen)] = np.linalg.inv(scaled) / np.outer(size[seen], size[seen])
    return inverse
