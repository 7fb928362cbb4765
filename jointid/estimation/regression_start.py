"""Start values by regression: stiffness, friction and payload by the arm's equation (Gauss-Newton).

Equation (8) takes the deflection as a small difference, which friction and a wrong payload bias. Here
the deflection is a small correction of the arm's motion: with the torque s of the springs,

    A (θ − s / (K + sD)) = s,    s = τ − s²Mθ − friction,    A = s²M2 + gravity,

is linear in A and almost linear in 1/K, D/K² and friction.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.parameters import ParameterLayout, Parameters
from jointid.gears.motor_motion import MotorMotion
from jointid.motion.friction import friction_waveforms
from jointid.phasors.extract import Phasors

_STEPS, _STEPS_OF_SINES, _NEAR = 8, 20, 0.1
"""Most steps, those of sines with changing weights, and the step in standard errors that ends them."""
_STEPS_OF_HELD, _DAMPED = 40, 1e-3
"""Most steps of sines with held joints, and the damping over the diagonal of the normal matrix after a
step that was worse (Levenberg and Marquardt)."""
_LATEST = 1.0
"""Largest product of a delay and the highest frequency, rad; the smallest delay is 0."""
_RIDGE = 1e-10
"""Added to the normal matrix of unit diagonal."""
_EXPLAINED = 2.0
"""Cost that friction explains, over the remaining one, from which friction is fitted."""
_DEGREE = 5
"""Degree of the polynomial in s for the states of motors and arm at the ends of a segment."""
_SLOWEST = 2.0
"""Largest D ω/K at the highest frequency."""
_ROUNDING = 1e-9
"""Torque error over the largest torque, for records without noise."""
_ROUGH = 0.03
"""Torque error over a joint's usual torque in such sines: motors stick at reversals."""
_OUTLIER = 3.0
"""Residual of a sine over the median from which it counts less: motors that others move may stick."""
_HELD = 0.8
"""Share of a segment without clear velocity of a motor from which the motor's torque does not count."""


def regression_start(
    phasors: Phasors,
    prior: InertiaPrior,
    *,
    backlash: bool = False,
    hangs: bool = False,
    lags: bool = False,
) -> Parameters:
    """The start values alone."""
    return regressed(phasors, prior, backlash=backlash, hangs=hangs, lags=lags)[0]


@np.errstate(all="ignore")  # values that the records do not determine may diverge
def regressed(
    phasors: Phasors,
    prior: InertiaPrior,
    *,
    backlash: bool = False,
    hangs: bool = False,
    lags: bool = False,
    stiff: float | None = None,
) -> tuple[Parameters, float]:
    """K, D, friction if significant and, with a common unknown as the payload, elements of M2.

    ``backlash`` adds that of every gear, which moves the arm from one flank to the other, ``hangs``
    unknown gravity stiffness, ``lags`` a delay of the torque, which is not returned. The second value is
    the misfit of the arm's equation with friction, at least 1. Of sines, outliers count less (Cauchy's
    weights). With ``stiff``, the unknown torques through gears of joints that friction holds in sines
    are eliminated; gears that the records hardly show are then the stiffer, the larger it is.
    """
    n, shared = prior.n, bool(prior.shared.any())
    equations = _ArmEquations.of(
        phasors, prior, backlash=backlash, hangs=hangs, lags=lags, eliminates=stiff is not None
    )
    own = np.diagonal(prior.M2[prior.pose], axis1=1, axis2=2).mean(axis=0)
    middle, fastest = float(np.median(phasors.excited)), float(np.abs(equations.s).max())
    at, damping, holds = _Values.zero(n), 0.0, stiff is not None
    best: tuple[float, _Values, Floats, Floats] | None = None
    steps = _STEPS if phasors.motion.any() else _STEPS_OF_HELD if holds else _STEPS_OF_SINES
    for _ in range(steps):
        N, g, squares, rows = equations.normal(at)
        misfit = max(squares / rows, 1.0)
        if stiff:
            weight = misfit * (stiff * own * middle**2) ** 2
            N[range(n), range(n)] += weight
            g[:n] += weight * at.yielding
            misfit += float(weight @ at.yielding**2) / rows
        if shared:
            N[-1, -1] += misfit
            g[-1] += misfit * at.payload
        damping *= 0.1
        if holds and best and not misfit <= best[0]:
            damping = max(100 * damping, _DAMPED)
            misfit, at, N, g = best
        best = misfit, at, N, g
        step, scale, inverse = _solved(N, g, damping)
        place = (4 + backlash + hangs) * n
        if lags and not 0 <= at.late + step[place] <= _LATEST / fastest:  # the delay stays
            N[place], N[:, place], g[place] = 0.0, 0.0, 0.0
            step, scale, inverse = _solved(N, g, damping)
        if not np.isfinite(step).all():
            break
        at = at.after(step, fastest, backlash=backlash, hangs=hangs, lags=lags)
        if damping < _DAMPED and np.abs(step * scale).max() < _NEAR * np.sqrt(misfit):
            break
    error = np.sqrt(misfit * np.diag(inverse)[:n]) / scale[:n]
    # A joint that rests shows no K, one with a stiff gear at least the inverse of the error.
    unseen = np.maximum(own * middle**2, 1 / np.maximum(error, np.finfo(float).tiny))
    K = np.where(at.yielding > error, 1 / np.where(at.yielding > error, at.yielding, 1.0), unseen)
    part, sizes = slice(2 * n, 4 * n), at.levels.ravel() * scale[2 * n : 4 * n]
    is_significant = bool(sizes @ np.linalg.solve(inverse[part, part], sizes) > _EXPLAINED * rows)
    values = {"K": K, "D": at.slow * K}
    values |= {"coulomb": at.levels[0], "viscous": at.levels[1]} if is_significant else {}
    values |= {"backlash": 2 * np.maximum(at.half, 0)} if backlash else {}
    values |= {"gravity": at.weight} if hangs else {}
    values |= {"M2": prior.lower + at.payload * prior.common} if shared else {}
    layout = ParameterLayout.of(
        n,
        friction=is_significant,
        effects=["backlash"] * backlash + ["gravity"] * hangs,
        arms=len(prior.lower) if shared else 0,
    )
    return layout.named(layout.pack(**values)), float(np.nan_to_num(misfit, nan=np.inf))


def _solved(N: Floats, g: Floats, damping: float) -> tuple[Floats, Floats, Floats]:
    """Damped step, and the square root of the diagonal of N with the inverse of N over both."""
    scale = np.sqrt(np.maximum(np.diag(N), np.finfo(float).tiny))
    normal, one = N / np.outer(scale, scale), np.eye(len(N))
    inverse = np.linalg.inv(normal + (_RIDGE + damping) * one)
    step = -inverse @ (g / scale) / scale
    return step, scale, inverse if damping == 0 else np.linalg.inv(normal + _RIDGE * one)


class _Values(NamedTuple):
    """The unknowns of the regression."""

    yielding: Floats
    """1/K, (n,)."""
    slow: Floats
    """D/K, (n,), s."""
    levels: Floats
    """Coulomb and viscous friction, (2, n)."""
    half: Floats
    """Half the backlash, (n,)."""
    weight: Floats
    """Gravity stiffness, (n,)."""
    late: float
    """Delay of the torque, s."""
    payload: float
    """Common unknown of M2 in its standard deviations."""

    @classmethod
    def zero(cls, n: int) -> Self:
        """Rigid joints without friction."""
        return cls(np.zeros(n), np.zeros(n), np.zeros((2, n)), np.zeros(n), np.zeros(n), 0.0, 0.0)

    def after(self, step: Floats, fastest: float, *, backlash: bool, hangs: bool, lags: bool) -> Self:
        """The values after a step, K positive and D within its limits."""
        n, count = self.slow.size, (4 + backlash + hangs) * self.slow.size
        rise, fall, *changes = step[: 4 * n].reshape(4, n)
        damped, stiffest = self.yielding * self.slow + fall, self.yielding + rise
        yielding = np.where(stiffest > 0, stiffest, 0.5 * self.yielding)
        slow = np.divide(damped, yielding, out=np.zeros(n), where=yielding > 0)
        return type(self)(
            yielding,
            np.clip(slow, 0.0, _SLOWEST / fastest),
            self.levels + changes,
            self.half + (step[4 * n : 5 * n] if backlash else 0),
            self.weight + (step[count - n : count] if hangs else 0),
            self.late + float(step[count : count + lags].sum()),
            self.payload + float(step[count + lags :].sum()),
        )


@dataclass(frozen=True, eq=False)
class _ArmEquations:
    """The arm's equation at every line of motions and every fundamental of sines, b in all."""

    phasors: Phasors
    prior: InertiaPrior
    row: np.ndarray
    """Record of each, (b,)."""
    s: Complexes
    z: Complexes
    """Angles and torques, (b, 2n)."""
    variance: Floats
    """Theirs, (b, 2n)."""
    shapes: Complexes
    """Coulomb and viscous friction of unit size, (2, b, n)."""
    held: np.ndarray
    """Whether friction of unknown torque holds a motor, (b, n)."""
    flank: Complexes
    """Side of the backlash, (b, n)."""
    backlash: bool
    hangs: bool
    lags: bool
    eliminates: bool
    """Whether the torques through gears of held joints are eliminated, in sines."""

    @classmethod
    def of(cls, phasors: Phasors, prior: InertiaPrior, *, backlash: bool, **flags: bool) -> Self:
        """Those of some records, with the unknowns that the flags name."""
        n, moves = prior.n, phasors.motion
        known = np.any(phasors.harmonics != 0, axis=2)
        known[~moves, 1:] = False
        known[~moves] &= not moves.any()  # sines may have far less noise
        row, bins = np.nonzero(known)
        motors = MotorMotion.of(phasors.segments, prior.pose, loops=False) if backlash else None
        none = np.zeros((*known.shape, n), complex)
        flank = none if motors is None else motors.flanks(prior.M[0], known.shape)
        s, z = np.asarray(1j * phasors.omega[row] * (bins + 1)), phasors.harmonics[row, bins]
        friction = friction_waveforms(phasors, None)
        rests = np.stack(
            [np.zeros(n) if each is None else each.share_at_rest for each in phasors.segments]
        )
        return cls(
            phasors,
            prior,
            row,
            s,
            z,
            variance=np.einsum("bcc->bc", phasors.harmonic_covariance[row, bins]).real,
            shapes=np.stack([friction.coulomb[row, bins], s[:, None] * z[:, :n]]),
            held=(friction.stationary | (rests > _HELD))[row],
            flank=flank[row, bins],
            backlash=backlash,
            **flags,
        )

    @cached_property
    def ends(self) -> Complexes:
        """Polynomials in s for the ends of segments, (b, degree + 1)."""
        powers = (self.s / np.abs(self.s).max())[:, None] ** np.arange(_DEGREE + 1)
        return np.asarray(1j * powers * self.phasors.motion[self.row, None])

    @cached_property
    def rotor(self) -> Complexes:
        """s²M, (b, n)."""
        return np.asarray(self.s[:, None] ** 2 * self.prior.M[self.prior.rotor[self.row]])

    @cached_property
    def given(self) -> Complexes:
        """A with the given M2 and gravity, (b, n, n)."""
        pose = self.prior.pose[self.row]
        return np.asarray(self.s[:, None, None] ** 2 * self.prior.M2[pose] + self.prior.gravity[pose])

    @cached_property
    def change(self) -> Complexes:
        """A's change per unit of the common unknown, (b, n, n)."""
        prior, pose = self.prior, self.prior.pose[self.row]
        found = self.s[:, None, None] ** 2 * prior.shared[prior.part[pose]] + prior.shared_gravity[pose]
        return np.asarray(found)

    @cached_property
    def of_torque(self) -> Floats:
        """Variance of the torque that accelerates the arm, (b, n)."""
        n = self.prior.n
        return np.asarray(self.variance[:, n:] + np.abs(self.rotor) ** 2 * self.variance[:, :n])

    @cached_property
    def rough_size(self) -> Floats:
        """Variance of the equations of rigid gears, with a torque error of sticking motors, (b, n, 1).

        It is constant: one that falls where K of a held joint makes its equation large has no minimum.
        """
        n, moves = self.prior.n, ~self.held
        torques = zip(np.abs(self.z[:, n:]).T, moves.T, strict=True)
        usual = np.array([np.median(own[sees]) if sees.any() else 0.0 for own, sees in torques])
        seen = usual[moves.any(axis=0)]
        usual[~moves.any(axis=0)] = np.median(seen) if seen.size else 0.0
        rough = self.of_torque + (_ROUGH * usual) ** 2 + np.finfo(float).tiny
        return np.asarray(np.abs(self.given) ** 2 @ self.variance[:, :n, None] + rough[..., None])

    def normal(self, at: _Values) -> tuple[Floats, Floats, float, int]:
        """Normal matrix, gradient and sum of the weighted squares, and the number of equations."""
        n, s, z, one = self.prior.n, self.s, self.z, np.eye(self.prior.n)
        A = self.given + at.payload * self.change + np.diag(at.weight)
        acting = z[:, n:] * np.exp(-s * at.late)[:, None]
        drive = acting - self.rotor * z[:, :n] - np.einsum("kbj,kj->bj", self.shapes, at.levels)
        drive = np.where(self.held, 0.0, drive) if self.eliminates else drive
        lag = 1 + s[:, None] * at.slow
        C = at.yielding / lag
        arm = z[:, :n] - C * drive - at.half * self.flank / lag
        passed = one + A * C[:, None]
        residual = (A @ arm[..., None])[..., 0] - drive
        size = self.rough_size if self.eliminates else self._size(A, passed, residual, drive)
        if self.eliminates:
            unknown, left = _eliminated(residual, passed, self.held, size)
            drive, arm = drive + unknown, arm - C * unknown
            residual = residual - (passed @ unknown[..., None])[..., 0]
        columns = [A * (-(2 * lag - 1) / lag**2 * drive)[:, None]]
        columns += [A * (s[:, None] / lag**2 * drive)[:, None]]
        columns += [passed * waveform[:, None] for waveform in self.shapes]
        columns += [-A * (self.flank / lag)[:, None]] * self.backlash
        columns += [one * arm[:, None]] * self.hangs
        columns += [passed @ (s[:, None] * acting)[..., None]] * self.lags
        columns += [self.change @ arm[..., None]] * bool(self.prior.shared.any())
        white: Any = np.concatenate([*columns, residual[..., None]], axis=2) / np.sqrt(size)
        J: Complexes = left @ white if self.eliminates else white
        normal, rows = np.zeros((J.shape[2],) * 2), 0
        edges = np.flatnonzero(np.diff(self.row)) + 1
        parts = (np.split(x, edges) for x in (J, self.ends, size[..., 0]))
        for part, part_ends, part_size in zip(*parts, strict=True):
            data = _real(part.swapaxes(0, 1))
            if np.any(part_ends):
                basis, _ = np.linalg.qr(_real(part_ends / np.sqrt(part_size.T)[..., None]))
                data = data - basis @ (basis.swapaxes(1, 2) @ data)
            data = data.reshape(-1, data.shape[2])
            normal, rows = normal + data.T @ data, rows + len(data)
        return normal[:-1, :-1], normal[:-1, -1], float(normal[-1, -1]), rows

    def _size(self, A: Complexes, passed: Complexes, residual: Complexes, drive: Complexes) -> Floats:
        """Variance of the equations, (b, n, 1); infinite where friction holds the motor."""
        n = self.prior.n
        size = np.asarray(np.abs(A) ** 2 @ self.variance[:, :n, None])
        size += np.asarray(np.abs(passed) ** 2 @ self.of_torque[..., None])
        size += max((_ROUNDING * np.abs(drive).max()) ** 2, np.finfo(float).tiny)
        size = np.where(self.held[..., None], np.inf, size)
        if not self.phasors.motion.any():
            square = np.abs(residual[..., None]) ** 2 / size
            typical = float(np.median(square[~self.held])) if not self.held.all() else 0.0
            size = size * (1 + square / (_OUTLIER**2 * max(typical, 1.0)))
        return np.asarray(size)


def _eliminated(
    residual: Complexes, passed: Complexes, held: np.ndarray, size: Floats
) -> tuple[Complexes, Complexes]:
    """Torques of the gears of held joints by least squares, and what remains of weighted residuals.

    ``residual``, ``held`` (b, n), ``passed`` (b, n, n) by which a torque acts on it, variances ``size``.
    """
    columns = np.asarray(np.where(held[:, None], passed, 0.0) / np.sqrt(size))
    found = np.linalg.pinv(columns)
    unknown = (found @ (residual[..., None] / np.sqrt(size)))[..., 0]
    return unknown, np.asarray(np.eye(residual.shape[1]) - columns @ found)


def _real(values: Complexes) -> Floats:
    """Complex (..., b, k) as real rows (..., 2b, k)."""
    return np.concatenate([values.real, values.imag], axis=-2)
