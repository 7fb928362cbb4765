"""Residual torque in units of its noise, with the free friction at the reversals projected out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import chdtri

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.joint_equations import balance, gear_torque, noise_of, wind_up
from jointid.estimation.estimators.parameters import GEAR_LAWS
from jointid.estimation.estimators.problem import (
    Problem,
    free_deflection,
    friction_advance,
    motor_stiffness,
)
from jointid.estimation.estimators.residual import Residual
from jointid.gears.torsion_curve import TorsionCurve, torsion_curves
from jointid.gears.wound import Wound
from jointid.motion.free_friction import FreeFriction, Projection
from jointid.small_matrices import finite_part, inverse, whitener

DRIVEN_LAWS = (*GEAR_LAWS, "arm_coulomb")
"""Laws that follow from the torque through the gears."""
_RESOLVED = 1.0
"""Dynamic stiffness of the arm over K from which a motion's torsion curve has a line of its spectrum."""
_CLEAR = 4.0
"""Standard deviations from which a harmonic counts as a signal."""
_CHANCE, _CHANCE_OF_MOTIONS = 1e-4, 0.05
"""Probability that the scatter widens the errors of a correct model; motions have many segments."""
_MOST_LEVERAGE = 0.999
"""Largest share of a direction's information from one record; its residual there is rounding."""
_LEAST_RECORDS = 4
"""Fewest records, or segments of motions, from which a scatter is computed; of whole motions, two."""
POOR = 10.0
"""Misfit of a model that does not explain the data."""
_EVALUATIONS = 2
"""Evaluations of the free friction beside gear laws: the torque through the gears changes it little."""
_STICKING = 1000.0
"""Misfit from which it is not evaluated; backlash with sticking motors fits with it, and has a misfit of
15 to 500 without."""


@dataclass(frozen=True, eq=False)
class WhitenedResidual:
    """Whitened residual at one set of parameters; its Jacobian on demand."""

    at: Residual
    weight: Floats
    """Factor on the variance of the noise alone, shape (r, H)."""
    free: FreeFriction
    """Columns that are projected out: free friction, and the end terms of motions."""
    W: Complexes
    """W V Wᴴ = I for the residuals in use, zero for the others, shape (r, H, n, n)."""
    projection: Projection
    rows: Floats
    """Whitened residual after the projection, shape (r, m)."""

    @classmethod
    def of(cls, problem: Problem, vector: Floats, scale: Floats | None = None) -> WhitenedResidual:
        """Whiten the residual, with a factor on each harmonic's variance, ``scale`` (H,) or (r, H).

        The factor is 1 by default.
        """
        at = Residual.at(problem, vector)
        scale = np.ones(problem.s.shape[1]) if scale is None else scale
        weight = problem.noise.inverse_bias[:, None] * scale
        V = at.V * weight[..., None, None]
        W = _whitener(problem, V)
        free = problem.free
        if free.shapes and "position_filter" in problem.layout:
            free = free.moved(np.asarray(friction_advance(problem, at.p)))
        if free.has_known_sizes and "torque_scale" in problem.layout:
            free = free.scaled(at.p["torque_scale"])
        if problem.ends is not None:
            free = free.with_columns(problem.ends.records, problem.ends.columns(at.X @ at.arm))
        projection = free.projection(W, V)
        if problem.ends is not None:
            sizes = projection.first_sizes(at.r[..., None], 2 * problem.n)
            at = replace(at, law=(at.law[0], at.law[1] + problem.ends.on_arm(sizes, problem.n)))
        return cls(at, weight, free, W, projection, projection.rows(at.r[..., None])[..., 0])

    @property
    def cost(self) -> float:
        """Σ rᴴV⁻¹r."""
        return float((self.rows**2).sum())

    def columns(self, signals: Complexes | None = None) -> Floats:
        """Jacobian of the rows, shape (r, m, P), at the smoothed signals or at others (r, H, 2n)."""
        return self._own_columns if signals is None else self.projection.rows(self._jacobian(signals))

    @cached_property
    def _own_columns(self) -> Floats:
        return self.projection.rows(self._jacobian(self.smoothed()))

    def _jacobian(self, signals: Complexes) -> Complexes:
        """∂r/∂p, shape (r, H, n, P), with the free friction that moves with a position filter."""
        J, layout = self.at.jacobian(signals), self.at.problem.layout
        if self.free.shapes and "position_filter" in layout:
            moved = self.at.by_position_filter(self.free_friction() - self._ends())
            J[..., layout["position_filter"]] -= moved[..., None] * np.eye(moved.shape[2])
        if self.free.has_known_sizes and "torque_scale" in layout:
            # Unknown friction is a part of the logged torque and has its scale.
            complement = self.projection.complement
            own = (complement.bounded_friction if complement else self.free.of_known_size)(self.rows)
            by_scale = (own / self.at.p.torque_scale)[..., None] * np.eye(own.shape[2])
            J[..., layout["torque_scale"]] -= by_scale
        return J

    def _ends(self) -> Complexes:
        """Torque of the ends of motions, shape (r, H, n), N·m."""
        found = np.zeros(self.at.r.shape, complex)
        if self.free.ends is not None:
            records, columns = self.free.ends
            sizes = self.projection.first_sizes(self.at.r[..., None], columns.shape[3])[records]
            found[records] = (columns @ sizes[:, None, :, None])[..., 0]
        return found

    def smoothed(self) -> Complexes:
        """Signals nearest to those measured, in units of noise, without residual: z − C Eᴴ V⁻¹r.

        Rows that free friction explains, or that are not in use, carry no information on the signals.
        """
        left = self.projection.whitened(self.rows[..., None])
        weighted = (self.W.conj().swapaxes(2, 3) @ left)[..., 0] * self.weight[..., None]
        return np.asarray(self.at.problem.z - (self.at.CE @ weighted[..., None])[..., 0])

    def information(self) -> Floats:
        """Normal matrix Σ JᵀJ without harmonics that are within their noise, shape (P, P)."""
        rows = self.visible_columns.reshape(-1, self.at.problem.layout.size)
        return np.asarray(rows.T @ rows)

    @cached_property
    def visible_columns(self) -> Floats:
        """Jacobian of the rows without harmonics that are within their noise, shape (r, m, P).

        Otherwise the noise of an absent harmonic would count like a small signal and determine
        parameters that no signal determines.
        """
        problem = self.at.problem
        variance = np.einsum("rhjj->rhj", problem.noise.covariance).real * self.weight[..., None]
        visible = np.any(np.abs(problem.z) ** 2 > _CLEAR**2 * variance, axis=2)
        visible[:, 0] = True
        J = self._jacobian(self.smoothed())
        visible |= ~problem.known
        if visible.all() or self.projection.complement:
            return self.projection.rows(J * visible[..., None, None])
        return self.free.projection(self.W * visible[..., None, None], self.at.V).rows(J)

    def misfit_by_harmonic(self, rank: int) -> Floats:
        """Cost over expected cost of each group of rows, (G,); rank is that of the free friction.

        Coordinates of a complement and known amplitudes belong to no bin: all groups have one misfit.
        """
        problem = self.at.problem
        measured = problem.used.sum(axis=1)[:, None] * problem.known
        if self.free.has_known_sizes:
            squares = measured * (self.cost / max(float(measured.sum()), 1.0))
        else:
            squares = (self.rows**2).reshape(len(self.rows), 2, -1, problem.n).sum(axis=(1, 3))
        squares, measured = (problem.by_group(each) for each in (squares, measured))
        left = 1 - rank / max(problem.rows, 1)
        return np.asarray(squares / np.maximum(measured * left, 1.0))

    def free_friction(self) -> Complexes:
        """Free friction at the reversals and terms of the ends, shape (r, H, n), N·m."""
        return self.projection.explained(self.at.r[..., None])

    def friction_of_motors(self) -> Complexes:
        """Free friction, and at stationary motors the whole residual, shape (r, H, n), N·m."""
        used = self.at.problem.used[:, None]
        return np.asarray(np.where(used, self.free_friction(), self.at.r))

    def torsion_curves(self) -> tuple[TorsionCurve, ...]:
        """Torque through every gear, by the balance at its motor, over its deflection."""
        at, problem = self.at, self.at.problem
        torque, angle = at.without_ends()
        angle = angle - free_deflection(problem, at.p)
        left, resolved = self.free_friction(), np.ones(torque.shape, bool)
        if problem.ends is not None:
            rows = problem.ends.records
            left[rows] = 0  # the ends are in it
            # At lower frequencies the deflection is the small difference of two integrated motions.
            moved = np.abs(np.diagonal(inverse(at.arm[rows]), axis1=2, axis2=3))
            above = moved > _RESOLVED * at.p.K
            power = np.abs(torque[rows]) ** 2
            most = 2 * (power * above).sum(axis=1) > power.sum(axis=1)
            resolved[rows] = above & most[:, None]
        torque = torque - left
        by_law = gear_torque(at.X, at.arm, angle, at.law)

        def wound(torque: Complexes) -> Complexes:
            return np.asarray(angle - (at.arm @ (torque - at.law[1])[..., None])[..., 0])

        by = balance(motor_stiffness(problem, at.p), at.lag * at.p.torque_scale)
        variance = noise_of((wind_up(by, at.arm), by), problem.noise.covariance)
        fitted = np.stack([wound(by_law), by_law])
        return torsion_curves(problem.s, wound(torque), torque, variance, fitted, resolved)

    def compensated(self) -> tuple[Complexes, Complexes]:
        """Motor angle and torque without friction, delay, effects and ends, both shape (r, h, n).

        The torque is that of equation (1) at the fitted parameters, plus the residual.
        """
        h = self.at.fundamentals
        left = (self.at.r - self.friction_of_motors())[:, :h]
        return self.at.position, np.asarray(self.at.ideal_torque() + left)


def _whitener(problem: Problem, V: Complexes) -> Complexes:
    used = problem.used[:, None, :, None]
    if not used.all():
        V = np.where(used & used.swapaxes(2, 3), V, np.eye(problem.n))
    return np.asarray(whitener(V) * (problem.known[..., None, None] & used))


def widened_covariance(residual: WhitenedResidual, covariance: Floats, prior_part: Floats) -> Floats:
    """Covariance of all parameters, widened where the records scatter more than their noise explains.

    At the optimum the gradients g of the records cancel. Their scatter gives the sandwich covariance A⁻¹
    (Σ ggᵀ) A⁻¹, with the leverage correction CR2 (Bell and McCaffrey, Survey Methodology 28, 2002). It
    holds for any cause of residuals that differs between records, such as sticking friction. The
    scatter of few records is inaccurate: it counts if that of K and D is significant, and then widens
    the noise of each parameter by the ratio of both standard errors, if that is above 1. Segments of
    motions scatter one by one, and the motion records as a whole: a torque scale may differ between
    them, and is the same in all segments of one. ``residual`` is that at the estimate; ``prior_part`` of
    its covariance, both shape (P, P), comes from the prior, the rest from noise.
    """
    finite, ends = finite_part(covariance), residual.at.problem.ends
    noise = finite - prior_part
    if not np.all(np.diag(noise)[: 2 * residual.at.problem.n] > 0):
        return covariance
    rows = np.arange(len(residual.rows))
    ratio = _scatter(residual, finite, noise, rows) if rows.size >= _LEAST_RECORDS else np.ones(1)
    if ends is not None and np.unique(ends.logs).size > 1:
        rows[ends.records] = rows.size + ends.logs
        ratio = np.maximum(ratio, _scatter(residual, finite, noise, rows))
    factor = np.sqrt(ratio) * np.ones(len(noise))
    return np.asarray(covariance + noise * (np.outer(factor, factor) - 1))


def _scatter(residual: WhitenedResidual, finite: Floats, noise: Floats, whole: np.ndarray) -> Floats:
    """Variance of each parameter by the scatter of records over that by noise, (P,); at least 1.

    ``whole``, shape (r,), is the record of each row.
    """
    own, size = 2 * residual.at.problem.n, np.diag(noise)
    shift, expected = _shifts(residual, finite, whole)
    scatter = len(shift) / (len(shift) - 1) * ((shift - shift.mean(axis=0)) ** 2).sum(axis=0)
    W = whitener(noise[:own, :own])
    chance = _CHANCE if residual.at.problem.ends is None else _CHANCE_OF_MOTIONS
    with np.errstate(invalid="ignore"):  # infinite for angles near zero
        pulls, share = shift[:, :own] @ W.T, W @ expected[:, :own, :own] @ W.T
        degrees_of_freedom = own**2 / (share**2).sum()
        found = (pulls**2).sum() / own
        is_significant = found * degrees_of_freedom >= chdtri(degrees_of_freedom, chance)
    ratio = np.divide(scatter, size, out=np.ones_like(size), where=size > 0)
    return np.maximum(ratio, 1.0) if is_significant else np.ones_like(size)


def repeated_covariance(residual: WhitenedResidual, covariance: Floats) -> tuple[Floats, float]:
    """Covariance by rounding that repeats in every period, shape (P, P), and its share of the noise.

    Each segment's part of it is in ``covariance`` as if the segments were independent; their scatter
    does not show the rest.
    """
    problem = residual.at.problem
    if problem.repeated is None:
        return np.zeros_like(covariance), 0.0
    n, C = problem.n, finite_part(covariance)
    errors = (residual.W @ residual.at.E[..., :n]) * np.sqrt(problem.repeated)[:, None, None]
    whole = residual.projection.whitened(residual.visible_columns)
    pulls = (errors.conj().swapaxes(2, 3) @ whole).reshape(-1, whole.shape[3])
    share = 2 * float((np.abs(errors) ** 2).sum()) / max(problem.rows, 1)
    return 2 * C @ (pulls.conj().T @ pulls).real @ C, share


def with_free_torque(problem: Problem, vector: Floats) -> Problem:
    """The problem without free friction in the torque that moves arms and nonlinear gears.

    It stays fixed in a fit. Linear joints need no such correction: it is a part of the projection.
    """
    may_rub = problem.motion is None and (problem.free.shapes > 0 or not problem.used.all())
    for _ in range(_EVALUATIONS * may_rub * any(name in problem.layout for name in DRIVEN_LAWS)):
        residual = WhitenedResidual.of(problem, vector)
        if not residual.cost < _STICKING * problem.rows / 2:
            break
        free = residual.friction_of_motors() * problem.known[..., None]
        problem = replace(problem, free_torque=free)
    return problem


def with_law_noise(problem: Problem, vector: Floats) -> Problem:
    """The problem with the noise of nonlinear gears, which follows from that of the torques.

    It stays fixed in a fit: without its derivative a step would lower the cost by raising the noise.
    """
    if problem.motion is not None or not any(name in problem.layout for name in GEAR_LAWS):
        return problem
    at = Residual.at(replace(problem, law_noise=None), vector)
    wound = None if at.wound is None else at.wound.of_sines
    if wound is None or problem.laws is None or not np.isfinite(wound.delta).all():
        return problem
    by = balance(motor_stiffness(problem, at.p), at.lag * at.p.torque_scale)
    E = problem.laws.by_signals(by, at.arm, at.gear)
    (variance,) = noise_of([E], problem.noise.covariance)
    own, rest = wound.noise(variance.swapaxes(1, 2))
    by_deflection, rest = -own.swapaxes(1, 2) / at.gear, rest.swapaxes(1, 2) / np.abs(at.gear) ** 2
    return replace(problem, law_noise=(by_deflection, rest))


def near_solution(problem: Problem, wound: Wound | None) -> Problem:
    """The problem with gears in motions that start from their solution at similar parameters."""
    laws = problem.laws
    if laws is None or laws.motors is None or wound is None:
        return problem
    return replace(problem, laws=replace(laws, latest=[wound.on(laws.motors)]))


def with_law_signals(problem: Problem, vector: Floats) -> Problem:
    """The problem as at the end of a fit: with the noise of gear laws, and without free friction.

    The latter only where this lowers the cost: near a jump of the motion it may raise it.
    """
    free = with_free_torque(problem, vector)
    if free is not problem:
        plain, other = (WhitenedResidual.of(each, vector).cost for each in (problem, free))
        problem = free if other < plain else problem
    return with_law_noise(problem, vector)


def _shifts(residual: WhitenedResidual, covariance: Floats, whole: np.ndarray) -> tuple[Floats, Floats]:
    """Change of the parameters by each record's gradient, (k, P), and its covariance, (k, P, P)."""
    size = np.sqrt(np.diag(covariance))
    size = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    root = size[:, None] * vectors * np.sqrt(2 * np.maximum(values, 0.0))  # of the inverse normal matrix
    columns = residual.visible_columns @ root
    member = np.asarray(np.unique(whole)[:, None] == whole, float)
    leverage, directions = np.linalg.eigh(np.tensordot(member, columns.swapaxes(1, 2) @ columns, 1))
    gradient = member @ (columns.swapaxes(1, 2) @ residual.rows[..., None])[..., 0]
    left = np.sqrt(1 - np.clip(leverage, 0.0, _MOST_LEVERAGE))
    along = (directions.swapaxes(1, 2) @ gradient[..., None])[..., 0] / left
    back = root @ directions
    shift = (back @ along[..., None])[..., 0]
    return shift, 0.5 * (back * np.maximum(leverage, 0.0)[:, None]) @ back.swapaxes(1, 2)
