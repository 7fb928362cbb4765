"""Maximum likelihood of K, D, friction and delay: errors in variables, all harmonics, one Gauss-Newton.

With the residual r and its covariance V (``residual``), maximising the likelihood over the unknown true
τ and q as well leaves Σ rᴴV⁻¹r to be minimised over the parameters. Its gradient is 2 Re JᴴV⁻¹r with the
Jacobian J at the smoothed signals z − C EᴴV⁻¹r, which removes the bias of least squares with noise in q
(Pintelon and Schoukens, System Identification, 2nd ed. 2012, chapter 9; Söderström, Errors-in-Variables
Methods in System Identification, 2018).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.special import chdtrc

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.estimators.gravity_prior import Gravity, gravity_std, with_gravity
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.levenberg_marquardt import LOST, minimised, penalty
from jointid.estimation.estimators.linear_fit import Estimate
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import GEAR_LAWS, ParameterLayout, Parameters
from jointid.estimation.estimators.problem import Problem, fitted_layout, make_problem
from jointid.estimation.estimators.whitened_residual import (
    POOR,
    WhitenedResidual,
    repeated_covariance,
    widened_covariance,
    with_free_torque,
    with_law_noise,
)
from jointid.gears.wound import Wound
from jointid.joints import Inertia
from jointid.motion.friction import FrictionWaveforms, change_of_level
from jointid.phasors.extract import Phasors
from jointid.small_matrices import (
    INSEPARABLE,
    determined_covariance,
    finite_part,
    positive_inverse,
    unit_diagonal,
)

_FAR, _NEAR = 1e-3, 1e-6
"""Initial damping of the iteration: from start values, and from an estimate near the optimum."""
_CHANCE = 1e-3
"""Probability of a band's misfit by noise alone, below which it counts as an error of the model."""
_HELD = 3.0
"""Strength of the observer of gears in motions for the first part of a fit from far off."""
_DOUBTFUL = 3.0
"""Misfit of a model with a law of the gears that is not fitted again with weights by harmonic; of
motions without one, ``LOST``."""


@dataclass(frozen=True, eq=False)
class LikelihoodEstimate(Estimate):
    """The estimate, with the friction-compensated phasors."""

    phasors: Phasors
    """Phasors with friction and delay subtracted from the torque: the part on springs and inertias."""
    penalty: float
    """Cost of the prior, beside ``cost`` of the data."""
    fundamental: tuple[float, float]
    """Misfit of the fundamentals, and their degrees of freedom."""
    odd_misfit: float
    """Misfit of the odd harmonics, including the fundamentals; with motions that of all bins."""
    repeated: float
    """Variance of errors that repeat in every period of a motion, times the further periods, over that
    of the noise."""
    inflation: float
    """Factor on the fundamental's variance in ``covariance`` that accounts for the model's misfit."""
    rests_in_noise: bool
    """Whether ``covariance`` has the unknown friction at the reversals of motions as noise."""
    prior_covariance: Floats
    """The part of ``covariance`` that comes from the prior, shape (P, P); the rest comes from noise."""
    inertias: tuple[Inertia, ...]
    """Fitted inertia of each record; the given one where it is exact."""
    scale: Floats
    """Factor on each row's variance in the fit, as of ``Misfit``."""
    gravity: Floats
    """Fitted gravity stiffness with each M2, shape (p, n, n), without that of a common unknown."""
    friction_change: Floats
    """Standard deviation of Coulomb friction between sines, (n,), N·m; 0 where it does not differ."""
    wound: Wound | None
    """Deflection of nonlinear gears in motions."""
    residual: WhitenedResidual | None = None
    """That of the last evaluation, for a fit from an estimate near it; it is large."""

    def whole_cost(self, misfit: float) -> float:
        """Cost of the data over a misfit, plus that of the prior."""
        return self.cost / misfit + self.penalty


def maximum_likelihood(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia] | InertiaPrior,
    start: Floats | Parameters,
    *,
    friction: FrictionWaveforms | None = None,
    delay: bool = False,
    effects: Sequence[str] = (),
    noise: Noise | None = None,
    is_near: bool = False,
) -> LikelihoodEstimate:
    """Fit K and D, and optionally friction, delay, effects and inertias, to all records and harmonics.

    ``inertia`` is one for all records, or one per record; with a prior, uncertain inertias and torque
    scales are fitted as well. ``start`` holds K and D of a linear estimator, shape (2n,), or the
    parameters of a similar fit. Coulomb and viscous friction are fitted with the waveforms ``friction``,
    a ``delay`` of the torque in addition to that of the records, and ``effects``, keys of
    ``parameters.EFFECTS``. ``noise`` is that of the phasors, where it is already known;
    ``is_near`` is whether ``start`` is the estimate from a part of the records.

    ``layout`` of the result names the parameters. The Coulomb friction of a motor that never reverses is
    zero with variance zero. Raises JointIdError when K and D cannot be separated from each other, or no
    positive stiffness fits.
    """
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    if not isinstance(start, Parameters):
        start = ParameterLayout.of(phasors.n).named(start)
    if noise is None:
        noise = spring_equations(phasors, prior.inertias(prior.M, prior.M2)).noise
    problem = make_problem(
        phasors, prior, fitted_layout(prior, friction, delay, effects), start, friction, noise
    )
    p = problem.start(start)
    scale: Floats = np.ones(problem.s.shape[1])
    _require_rows(problem, p)
    if "backlash" in effects and problem.laws is not None and problem.laws.motors is not None:
        held = replace(problem, laws=replace(problem.laws, strength=_HELD, latest=[]))
        if WhitenedResidual.of(held, p, scale).cost > POOR * problem.rows / 2:
            # Arms that leave their flanks have many local minima.
            p, _ = minimised(held, p, scale, damping=_FAR)
    slow = not set(GEAR_LAWS).isdisjoint(effects)
    # In sines, the noise of the laws, which follows, changes the optimum a little.
    fit = partial(minimised, roughly=slow and problem.motion is None)
    p, normal = fit(problem, p, scale, damping=_NEAR if is_near else _FAR)
    if (free := with_free_torque(problem, p)) is not problem:
        near, there = fit(free, p, scale, damping=_NEAR)
        costs = [WhitenedResidual.of(*each, scale).cost for each in ((free, near), (problem, p))]
        if costs[0] < costs[1]:
            problem, p, normal = free, near, there
    problem = with_law_noise(problem, p)
    std = gravity_std(prior)
    if std is not None:
        problem, p = with_gravity(problem, p, scale, prior, std)
    fitted = WhitenedResidual.of(problem, p, scale)
    misfit = first = Misfit.of(fitted, p, normal)
    scale = first.scale
    most = LOST if problem.ends is not None else np.inf
    most = _DOUBTFUL if slow else most
    is_reweighted = bool(np.any(scale > 1)) or problem.law_noise is not None
    if is_reweighted and not first.cost > most * first.expected_cost > 0:
        poor = first.cost > POOR * first.expected_cost > 0
        p, normal = minimised(problem, p, scale, damping=_NEAR, roughly=poor)
        if std is not None:
            problem, p = with_gravity(problem, p, scale, prior, std)
    if is_reweighted:
        fitted = WhitenedResidual.of(problem, p, scale)
    q, tau = fitted.compensated()
    harmonics = phasors.harmonics
    if problem.ends is not None:  # of motions, every bin is a phasor of its own
        found = np.where(problem.known[..., None], np.concatenate([q, tau], axis=2), 0)
        harmonics = np.where(phasors.motion[:, None, None], found, harmonics)
    clean = replace(
        phasors,
        q=q[:, 0],
        tau=tau[:, 0],
        covariance=phasors.harmonic_covariance[:, 0],
        harmonics=harmonics,
        hold_s=np.zeros(len(tau)),
    )
    named = problem.layout.named(p)
    if not prior.blocks():
        _require_separable(problem, normal)
    given = 0.5 * problem.prior_residual(p)[1]
    normal = fitted.information() + given
    covariance = 0.5 * determined_covariance(normal, given)
    for name in ("coulomb", "curve"):
        if name in problem.layout:  # not determined by a motor that never reverses
            own = np.arange(p.size)[problem.layout[name]]
            covariance[own, own] = np.where(np.diag(normal)[own] > 0, covariance[own, own], 0.0)
    if is_reweighted:
        misfit = Misfit.of(WhitenedResidual.of(problem, p), p, normal)
    by_prior = _prior_part(problem, p, covariance)
    repeated, share = repeated_covariance(fitted, covariance)
    of_gravity = np.zeros_like(covariance)
    if std is not None:
        of_gravity = Gravity.of(fitted, fitted.visible_columns, covariance, std).covariance()
    covariance = widened_covariance(fitted, covariance, by_prior) + repeated + of_gravity
    change: Floats = np.zeros(problem.n)
    if friction is not None and problem.ends is None and friction.levels.size:
        change = change_of_level(friction, fitted.free_friction())
    return LikelihoodEstimate(
        layout=problem.layout,
        p=p,
        covariance=covariance,
        rests_in_noise=fitted.projection.complement is not None,
        prior_covariance=by_prior + of_gravity,
        cost=misfit.cost,
        penalty=penalty(problem, p),
        expected_cost=misfit.expected_cost,
        parameter_count=misfit.rank + p.size,
        phasors=clean,
        repeated=share,
        inflation=max(1.0, first.fundamental[0]),
        fundamental=misfit.fundamental,
        odd_misfit=misfit.odd,
        inertias=tuple(
            prior.inertias(
                problem.rotor_inertia(named), problem.arm_inertia(named), problem.gravity(named)
            )
        ),
        scale=scale,
        gravity=problem.prior.gravity,
        friction_change=change,
        wound=fitted.at.wound and fitted.at.wound.alone(),
        residual=fitted if is_near and problem.laws is None else None,
    )


@dataclass(frozen=True, eq=False)
class Misfit:
    """Ratio of the residual at some parameters to its noise."""

    cost: float
    """Σ rᴴV⁻¹r."""
    expected_cost: float
    """Its expected value, less the parameters that the data determine and the free friction."""
    rank: int
    """Effective degrees of freedom of the free friction."""
    scale: Floats
    """Factor on each harmonic's variance, its misfit, at least 1, (r, H): a harmonic that the model
    does not explain gets less weight. The noise of motions is that of the residual: a band of their bins
    gets less where its misfit is significant."""
    fundamental: tuple[float, float]
    """Misfit of the fundamentals, corrected for the parameters, and their degrees of freedom."""
    odd: float
    """Misfit of the odd harmonics, including the fundamentals; with motions that of all bins."""

    @classmethod
    def of(cls, residual: WhitenedResidual, p: Floats, normal: Floats) -> Misfit:
        """From the residual in units of its noise and the normal matrix, shape (P, P)."""
        problem = residual.at.problem
        rank, determined = residual.projection.rank(), _determined_by_data(problem, p, normal)
        by_harmonic = residual.misfit_by_harmonic(rank)
        main = problem.main
        every = 2 * problem.by_group(problem.used.sum(axis=1)[:, None] * problem.known)
        every *= 1 - rank / max(problem.rows, 1)
        rows = every[main]
        measured = float(rows.sum())
        left = measured - determined
        left = left if left >= 1 else 0.0
        by_harmonic[main] = by_harmonic[main] * measured / left if left else 1.0
        fundamental = float(by_harmonic[main] @ rows) / measured if measured else 1.0
        odd = every if problem.ends is not None else np.where(np.arange(every.size) % 2, 0.0, every)
        worse = by_harmonic > 1
        if problem.ends is not None:
            worse &= chdtrc(every, by_harmonic * every) < _CHANCE
        return cls(
            cost=residual.cost,
            expected_cost=float(max((problem.rows - rank - determined) / 2, 0.0)),
            rank=rank,
            scale=np.where(worse, by_harmonic, 1.0)[problem.group],
            fundamental=(fundamental, left),
            odd=float(by_harmonic @ odd) / max(float(odd.sum()), 1.0),
        )


def _determined_by_data(problem: Problem, p: Floats, normal: Floats) -> float:
    """Number of parameters that the data determine: P − tr(C B), with the prior's information B."""
    variance = positive_inverse(normal) / 2
    known = np.where(np.isfinite(variance), variance, 0.0)
    by_prior = np.einsum("ij,ji->i", problem.prior_residual(p)[1], known)
    return float(p.size - np.minimum(by_prior, 1.0).sum())


def _require_rows(problem: Problem, p: Floats) -> None:
    if problem.rows == 0:
        raise JointIdError(
            "No motor moves above its noise in any record, so that friction cannot be separated from "
            "elasticity: move the motors more, or log their positions with more digits."
        )
    if problem.rows >= problem.free.shapes + 2 * p.size or not problem.free.shapes:
        return
    residual = WhitenedResidual.of(problem, p)
    if problem.rows < residual.projection.rank() + 2 * p.size:
        raise JointIdError(
            "The motors rest for so long that friction cannot be separated from elasticity: record "
            "faster motions, or motions with fewer rests and reversals."
            if problem.ends is not None
            else "The records hold too few frequencies to separate friction from elasticity: sample "
            "faster, or record motions of a wider band."
        )


def _prior_part(problem: Problem, p: Floats, covariance: Floats) -> Floats:
    """The part of the covariance that comes from the prior, shape (P, P).

    With the information A of the data and B of the prior, C = (A + B)⁻¹ = C A C + C B C.
    """
    C = finite_part(covariance)
    part = C @ problem.prior_residual(p)[1] @ C
    np.fill_diagonal(part, np.maximum(np.diag(part), 0.0))  # rounding
    return np.asarray(part)


def _require_separable(problem: Problem, normal: Floats) -> None:
    """Refuse exact inertias with records that do not determine all parameters."""
    seen, _, scaled = unit_diagonal(normal)
    if not np.all(seen[: 2 * problem.n]):
        name = problem.layout.labels[int(np.argmin(seen))]
        raise JointIdError(f"The records do not determine {name}: move joint {name[1:]} more.")
    values, vectors = np.linalg.eigh(scaled)
    if values[0] < INSEPARABLE:
        names = np.array(problem.layout.labels)[seen][np.abs(vectors[:, 0]) > 0.3]
        raise JointIdError(
            f"The records cannot separate {' and '.join(names)}. Add records at other frequencies, "
            "and with different relative amplitudes and phases of the joints."
        )
