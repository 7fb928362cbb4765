"""Candidate models, and the comparison of their fits to the same data.

Models are compared by an information criterion with the cost over the best model's misfit, so that a
misfitting model does not buy spurious parts; a part must also be significant and physical.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtrc, chdtri, log_ndtr, ndtri_exp

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.effects import EFFECTS, GEAR_LAWS
from jointid.estimation.likelihood import LikelihoodEstimate, Score

EXPLAINED = 1.1
"""Misfit below which richer friction cannot improve the fit noticeably."""
NEEDED = 3.0
"""Ratio of misfits from which a part is needed, whatever its standard error."""
_SIGNIFICANT = 5.0
"""Standard errors by which an optional part must differ from zero."""
_FREE_PENALTY = 2.0
"""Factor on its square beside free friction, whose approximations other parts absorb."""
WORTH = 0.2
"""Share of the misfit beyond 1 that a part must explain where the model leaves more than noise: every
wrong part explains something."""
_DOUBT, _DOUBT_IF_FAR = 0.005, 0.05
"""Probability that the score of any part widens the error bars on an ideal robot, and the same if it
moves K or D far, which few parts do."""
_FAR_OFF = 4.0
"""Standard errors that are far."""
_OCCAM = 1 / 20
"""Weight of a model, over the best, from which it explains the data as well."""
_EVIDENCE = 3.0
"""Bayes factor from which evidence counts."""
_DRAWS = 1024
"""Points of an integral over positive values: accurate to a per cent."""
_RIDGE = 1e-12
"""Variance, over the prior's, below that of any part."""
_USUAL = 0.05
"""Probability of a misfit of the fundamentals that calls for no slow fit."""
_BEND = 4.0
"""Largest ratio of two slopes of a gear; catalogues have up to 2."""
_CERTAIN = 200.0
"""Squared parameter over its variance from which a model without it need not be fitted."""


@dataclass(frozen=True)
class Model:
    """Parameters fitted in addition to K and D."""

    reversal: float | None
    """Velocity below which friction is free, over the record's largest; None: no friction."""
    delay: bool
    curve: bool = False
    """Whether friction has a part that varies nonlinearly with speed."""
    effects: tuple[str, ...] = ()
    """Keys of ``EFFECTS``, in its order."""

    @property
    def parts(self) -> tuple[str, ...]:
        """What the model has beside K and D: "friction", "delay", keys of ``EFFECTS``."""
        friction = ("friction",) if self.reversal is not None else ()
        return (*friction, *(("delay",) if self.delay else ()), *self.effects)

    @property
    def is_slow(self) -> bool:
        """Whether the model has a law of the gears."""
        return not set(GEAR_LAWS).isdisjoint(self.effects)

    def with_part(self, part: str) -> Model:
        """The model with one more part."""
        if part == "friction":
            return replace(self, reversal=0.0)
        if part == "delay":
            return replace(self, delay=True)
        return replace(self, effects=tuple(e for e in EFFECTS if e in (*self.effects, part)))

    def without(self, part: str) -> Model:
        """The model with one part less."""
        if part == "friction":
            return replace(self, reversal=None, curve=False)
        if part == "delay":
            return replace(self, delay=False)
        return replace(self, effects=tuple(e for e in self.effects if e != part))

    @property
    def name(self) -> str:
        """Description of the model."""
        friction = ["friction that varies with speed" if self.curve else "friction"]
        parts = ["elasticity"] + friction * (self.reversal is not None) + ["delay"] * self.delay
        parts += [EFFECTS[name].name for name in self.effects]
        return " + ".join(parts) + (
            f", reversals free below {100 * self.reversal:g} %" if self.reversal else ""
        )


@dataclass(frozen=True)
class Candidate:
    """One model of the comparison."""

    name: str
    friction: bool
    delay: bool
    reversal: float
    """Velocity below which friction was free, over the record's largest."""
    curve: bool
    """Whether friction has a part that varies nonlinearly with speed."""
    problem: str
    """Reason why it was not fitted; empty otherwise."""
    cost: float
    expected_cost: float
    parameters: int
    """Number of fitted real numbers, those of free friction included."""
    criterion: float
    """Information criterion, 2 · cost over the best model's misfit + penalty; the smallest is chosen.
    Infinite where the model was not fitted, or a part of it is not significant."""
    chosen: bool
    parts: tuple[str, ...] = ()
    """What it has beside K and D, see ``Model.parts``."""


@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen model, its estimate, and all candidates."""

    model: Model
    estimate: LikelihoodEstimate | JointIdError
    """The error if no model could be fitted."""
    candidates: tuple[Candidate, ...]
    """Best first."""
    spread: Floats
    """Covariance of K1 ... Kn, D1 ... Dn by the choice between models, shape (2n, 2n)."""


@dataclass
class Fits:
    """Models that were fitted to the same data of n joints, with their estimates."""

    optional: tuple[str, ...]
    """Parts that a model may lack: "friction", "delay" and keys of ``EFFECTS``."""
    joints: int
    rows: int
    """Real equations of all records, joints and harmonics."""
    tried: dict[Model, LikelihoodEstimate | JointIdError] = field(default_factory=dict)

    def misfit(self, model: Model) -> float:
        """Misfit of a model that was tried; infinite where it could not be fitted."""
        estimate = self.tried.get(model)
        return estimate.misfit if isinstance(estimate, LikelihoodEstimate) else np.inf

    def least(self, models: Sequence[Model]) -> Model:
        """Model with the smallest criterion."""
        criterion = self.criterion()
        return min(models, key=lambda model: criterion[model])

    def criterion(self) -> dict[Model, float]:
        """2·cost + the penalty of the parameters, with the cost over the best model's misfit.

        Schwarz's penalty ln(rows) for the parameters, Akaike's 2 for each degree of freedom of the free
        friction.
        """
        fitted = {m: e for m, e in self.tried.items() if isinstance(e, LikelihoodEstimate)}
        misfit = max(1.0, min((e.misfit for e in fitted.values()), default=1.0))
        criterion = dict.fromkeys(self.tried, np.inf)
        for model, estimate in fitted.items():
            if not self._is_significant(model, estimate):
                continue
            free = estimate.parameter_count - estimate.p.size
            penalty = float(np.log(self.rows)) * estimate.p.size + 2 * free
            criterion[model] = 2 * estimate.whole_cost(misfit) + penalty
        return criterion

    def is_explained(self, model: Model) -> bool:
        """Whether noise explains what a model leaves, at the fundamentals as well."""
        found = self.tried[model]
        if isinstance(found, JointIdError) or found.misfit > EXPLAINED:
            return False
        misfit, freedom = found.fundamental
        return bool(chdtrc(freedom, misfit * freedom) > _USUAL)

    def is_certain(self, model: Model, part: str) -> bool:
        """Whether the cost without a part would be far higher, by its size in standard errors."""
        estimate = self.tried[model]
        if isinstance(estimate, JointIdError):
            return False
        place = estimate.layout.of_part(part)
        variance = np.diag(estimate.covariance)[place] * max(1.0, estimate.misfit)
        squared = estimate.p[place] ** 2
        return bool(np.any((squared > _CERTAIN * variance) & (variance > 0)))

    def _is_significant(self, model: Model, estimate: LikelihoodEstimate) -> bool:
        """Whether every optional part is needed, or significant and physical."""
        return all(
            self.part_is_significant(model, estimate, part)
            for part in model.parts
            if part in (*self.optional, "piecewise")
        )

    def part_is_significant(self, model: Model, estimate: LikelihoodEstimate, part: str) -> bool:
        """By its standard error and, for effects, by the likelihood ratio.

        Free friction absorbs many small effects that are not friction; this rejects them.
        """
        own = max(1.0, estimate.misfit)
        place = estimate.layout.of_part(part)
        size = estimate.p[place]
        sigma = np.sqrt(np.diag(estimate.covariance)[place] * own)
        clear = np.abs(size) > _SIGNIFICANT * sigma
        other = self.tried.get(model.without(part))
        simpler = other if isinstance(other, LikelihoodEstimate) else None
        beyond_noise = own > EXPLAINED and simpler is not None and part != "friction"
        if beyond_noise and simpler and simpler.misfit - own < WORTH * (simpler.misfit - 1):
            return False
        if simpler and part in EFFECTS:  # its standard error may be that of an uncertain inertia
            least = _SIGNIFICANT**2 * (_FREE_PENALTY if model.reversal else 1.0) + size.size
            clear[:] = 2 * (simpler.whole_cost(own) - estimate.whole_cost(own)) > least
        if part == "piecewise":  # a first slope near zero, or a steep one, is play or hysteresis
            p = estimate.named
            stiffer = (p.K + p["piecewise"]) / np.maximum(p.K, np.finfo(float).tiny)
            if np.any((stiffer > _BEND) | (stiffer < 1 / _BEND)):
                return False
        if part in EFFECTS and EFFECTS[part].positive:
            if np.any(size < -_SIGNIFICANT * sigma):
                return False
            clear &= size > 0
        elif part == "friction" and not model.curve:
            clear &= size > 0  # it dissipates energy
        return bool(clear.any()) or (simpler is not None and simpler.misfit > NEEDED * own)

    def candidates(self, best: Model) -> tuple[Candidate, ...]:
        """All models, best first."""
        criterion = self.criterion()
        order = sorted(self.tried, key=lambda model: criterion[model])
        return tuple(self._candidate(model, criterion[model], model == best) for model in order)

    def _candidate(self, model: Model, criterion: float, chosen: bool) -> Candidate:
        estimate = self.tried[model]
        fitted = estimate if isinstance(estimate, LikelihoodEstimate) else None
        return Candidate(
            name=model.name,
            friction=model.reversal is not None,
            delay=model.delay,
            reversal=model.reversal or 0.0,
            curve=model.curve,
            problem="" if fitted else str(estimate),
            cost=fitted.cost if fitted else np.inf,
            expected_cost=fitted.expected_cost if fitted else 0.0,
            parameters=fitted.parameter_count if fitted else 0,
            criterion=criterion,
            chosen=chosen and fitted is not None,
            parts=model.parts,
        )

    def spread(self, best: Model, scores: Mapping[str, Score]) -> Floats:
        """Covariance of K and D by the choice between models, shape (2n, 2n).

        The weight of a model is exp(−½ difference of the criterion) to the best. Unlikely ones are left
        out (Occam's window; Madigan and Raftery, Journal of the American Statistical Association 89,
        1994). A part that was not fitted counts in full where its score is nearly significant, sooner
        where it would move K or D far: with uncertain inertias, a part that the records hardly show may.
        """
        found = self.tried[best]
        size = 2 * self.joints
        if isinstance(found, JointIdError):
            return np.zeros((size, size))
        criterion, shifts, misfit = self.criterion(), [], max(1.0, found.misfit)
        sigma = np.sqrt(np.diag(found.elasticity_covariance))

        def is_doubtful(gain: float, count: int, shift: Floats) -> bool:
            doubt = _DOUBT_IF_FAR if np.any(np.abs(shift) > _FAR_OFF * sigma) else _DOUBT
            return bool(2 * gain > chdtri(count, doubt / max(len(self.optional), 1)))

        for model, estimate in self.tried.items():
            if model == best or not isinstance(estimate, LikelihoodEstimate):
                continue
            weight = float(np.exp(np.minimum(0.5 * (criterion[best] - criterion[model]), 0.0)))
            added = set(model.parts).difference(best.parts)
            if len(added) == 1 and added <= EFFECTS.keys() and set(best.parts) < set(model.parts):
                gain, count = found.whole_cost(misfit) - estimate.whole_cost(misfit), estimate.p.size
                shift = estimate.elasticity - found.elasticity
                weight = max(weight, float(is_doubtful(gain, count - found.p.size, shift)))
            shifts.append((weight, estimate.elasticity - found.elasticity))
        for part, score in scores.items():
            gain, shift = score.possible
            if best.with_part(part) not in self.tried and is_doubtful(gain / misfit, score.count, shift):
                shifts.append((1.0, shift))
        equals = [(weight, shift) for weight, shift in shifts if weight > _OCCAM]
        total = 1 + sum(weight for weight, _ in equals)
        spread = np.zeros((size, size))
        for weight, shift in equals:
            spread += weight / total * np.outer(shift, shift)
        return spread


def spread_by_prior(score: Score, wide: Floats, std: Floats, misfit: float) -> Floats:
    """Covariance of K and D by an absent positive part of roughly known size, shape (2n, 2n).

    A part whose effect other parameters can imitate lowers the cost little and moves K and D far: no
    test of significance sees it. The Bayes factor with a half-normal prior of its size decides instead
    (Kass and Raftery, Journal of the American Statistical Association 90, 1995): the covariance is the
    mean square shift times the part's probability, at even prior odds, unless the evidence against the
    part is "worth more than a bare mention" on their scale, a factor of 3.

    Parameters
    ----------
    score : Score
        Of the part, at the estimate without it.
    wide : ndarray, shape (count,)
        Standard deviations of its prior in a fit, which the score contains.
    std : ndarray, shape (count,)
        Standard deviations of the normal prior before its negative half is cut.
    misfit : float
        Factor on the variances of the data.
    """
    fitted = std[:, np.newaxis] * score.information * std
    information = (fitted - np.diag((std / wide) ** 2)) / misfit
    eigenvalue, vectors = np.linalg.eigh(information)
    eigenvalue = np.maximum(eigenvalue, 0.0)
    covariance = (vectors / (1 + eigenvalue)) @ vectors.T
    pull = fitted @ (score.value / std) / misfit
    mean = covariance @ pull
    log_positive, second_moment = positive_moments(mean, covariance)
    log_factor = 0.5 * float(mean @ pull - np.log1p(eigenvalue).sum())
    log_factor += log_positive + std.size * np.log(2)
    if not log_factor > -np.log(_EVIDENCE):
        return np.zeros((score.shift.size,) * 2)
    slope = score.slope * std
    return np.asarray(slope @ second_moment @ slope.T / (1 + np.exp(-log_factor)))


def positive_moments(mean: Floats, covariance: Floats) -> tuple[float, Floats]:
    """Log probability that all n normal variables are positive, and their second moment there, (n, n).

    By importance sampling after Geweke, Hajivassiliou and Keane: each variable is drawn from its
    positive part given those before it. The points are those of the golden ratio's generalisation, with
    ``ratio``ⁿ⁺¹ = ``ratio`` + 1.
    """
    n = mean.size
    ratio = np.roots([1.0, *np.zeros(n - 1), -1.0, -1.0]).real.max()
    uniform = (0.5 + np.outer(np.arange(_DRAWS), ratio ** -np.arange(1.0, n + 1))) % 1
    factor = np.linalg.cholesky(covariance + _RIDGE * np.eye(n))
    normal, log_weight = np.zeros((_DRAWS, n)), np.zeros(_DRAWS)
    for j in range(n):
        log_tail = log_ndtr((mean[j] + normal[:, :j] @ factor[j, :j]) / factor[j, j])
        log_weight += log_tail
        normal[:, j] = -ndtri_exp(log_tail + np.log(uniform[:, j]))
    largest = log_weight.max()
    weight = np.exp(log_weight - largest)
    drawn = mean + normal @ factor.T
    second_moment = (drawn.T * weight) @ drawn / weight.sum()
    return float(largest + np.log(weight.mean())), np.asarray(second_moment)
