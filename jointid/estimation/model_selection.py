"""Model selection: elasticity alone, with friction, with a delay, or with both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import Candidate, Choice, Model
from jointid.estimation.effects import EFFECTS
from jointid.estimation.friction import FrictionWaveforms, friction_waveforms
from jointid.estimation.inertia_prior import InertiaPrior
from jointid.estimation.likelihood import LikelihoodEstimate, maximum_likelihood, score_gains
from jointid.estimation.noise import Noise
from jointid.estimation.parameters import ParameterLayout, Parameters
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors

NO_FRICTION = (None, False)
FRICTIONS = ((0.0, False), (0.03, False), (0.1, False), (0.03, True), (0.1, True))
"""Friction models from simple to rich: velocity, over the largest, below which friction is free (from a
sharp to a gradual reversal), and whether friction varies nonlinearly with speed."""

_EXPLAINED = 1.1
"""Misfit below which a richer model cannot improve the fit noticeably."""
_SIGNIFICANT = 5.0
"""Standard errors by which friction and delay must differ from zero."""
_WORTH_A_FIT = 1.0
"""Predicted decrease of the cost from which a delay is fitted; it is chosen from ln(rows)/2, about 4."""
_NEEDED = 3.0
"""Ratio of misfits from which a part is needed, whatever its standard error."""
_LOST = 100.0
"""Misfit from which the search is repeated from other start values."""
_FAR = 1e4
"""Misfit of one friction model from which a richer one from the same start does not converge either."""
_CHANCE = 1e-3
"""Probability that the score of any effect leads to a fit on an ideal robot."""
_MOST_EFFECTS = 3
_TRIED = 2
"""Effects of the highest scores that are fitted for each one added: similar ones differ by cost only."""
_CERTAIN = 1000.0
"""Squared Coulomb friction over its variance from which models without friction are skipped; far above
the square of ``_SIGNIFICANT``."""


def choose_model(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia] | InertiaPrior,
    start: Floats,
    noise: Noise,
    *,
    friction: bool,
    delay: bool,
    exactly: bool = False,
) -> Choice:
    """Fit models from simple to rich until the noise explains the residual, and choose the best.

    Parameters
    ----------
    friction, delay : bool
        Parts that every model has; the others are optional.
    exactly : bool
        Exclude the optional parts; only the form of the friction reversals is chosen.
    """
    frictions = FRICTIONS if friction else (NO_FRICTION,) if exactly else (NO_FRICTION, *FRICTIONS)
    lags = (delay,) if delay or exactly else (False, True)
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    linear = ParameterLayout.of(phasors.n).named(start)
    effects = prior.inertia_std > 0 and not exactly
    search = _Search(phasors, prior, linear, noise, frictions, lags, effects)
    return _searched(search)


def _searched(search: _Search) -> Choice:
    """Search from the linear estimate and, if the misfit stays large, from other start values.

    Heavy friction can make the linear estimate negative, or lead it to another local minimum.
    """
    best = search.with_effects(search.search())
    misfit = search.misfit(best)
    if misfit < _LOST:
        return search.choice(best)
    better = min(misfit / 10, _FAR)
    good = _LOST if np.isinf(misfit) else min(misfit / 3, max(_LOST, misfit / _LOST))
    probe = Model(search.frictions[:3][-1][0], search.lags[-1])
    if search.phasors.harmonics.shape[1] == 1:  # friction shows in harmonics only
        probe = Model(search.frictions[0][0], search.lags[0])
    for start in _other_starts(search.phasors, search.prior):
        other = replace(search, start=start, tried={})
        other.fit(probe)
        if other.misfit(probe) < better:
            found = other.with_effects(other.search())
            if other.misfit(found) < good:
                return other.choice(found)
    return search.choice(best)


def _other_starts(phasors: Phasors, prior: InertiaPrior) -> list[Parameters]:
    """K with the arm's resonance at frequencies of the records, and a small D."""
    own = np.diagonal(prior.M2[prior.pose], axis1=1, axis2=2).mean(axis=0)  # M2jj, kg·m²
    layout, starts = ParameterLayout.of(phasors.n), []
    for share in (0.5, 1.0, 0.0):
        omega = float(np.quantile(phasors.omega, share))
        K = own * omega**2
        starts.append(layout.named(layout.pack(K=K, D=0.05 * K / omega)))
    return starts


@dataclass
class _Search:
    """Models fitted so far, with their estimates."""

    phasors: Phasors
    prior: InertiaPrior
    start: Parameters
    noise: Noise
    frictions: Sequence[tuple[float | None, bool]]
    lags: Sequence[bool]
    effects: bool
    """Whether effects of real robots are tried."""
    tried: dict[Model, LikelihoodEstimate | JointIdError] = field(default_factory=dict)
    waveforms: dict[tuple[float, bool], FrictionWaveforms] = field(default_factory=dict)

    def fit(self, model: Model) -> None:
        if model in self.tried:
            return
        if (problem := self._reason_to_skip(model)) is not None:
            self.tried[model] = problem
            return
        self.tried[model] = self._fitted(model, self._start(model))

    def _fitted(self, model: Model, start: Parameters) -> LikelihoodEstimate | JointIdError:
        try:
            return maximum_likelihood(
                self.phasors,
                self.prior,
                start,
                friction=self._waveforms(model.reversal, model.curve),
                delay=model.delay,
                effects=model.effects,
                noise=self.noise,
            )
        except JointIdError as error:
            return error

    def _reason_to_skip(self, model: Model) -> JointIdError | None:
        """Reason why a model cannot be the best; None if it has to be fitted."""
        if self._lacks_friction(model):
            return JointIdError("Not fitted: there is friction beyond doubt.")
        if not model.delay:
            return None
        without = self.tried.get(replace(model, delay=False))
        if False not in self.lags or not isinstance(without, LikelihoodEstimate):
            return None
        if self._gains(model, without, ["delay"])["delay"] / max(1.0, without.misfit) > _WORTH_A_FIT:
            return None
        return JointIdError("Not fitted: the data show no lag of the torque.")

    def _gains(
        self, model: Model, estimate: LikelihoodEstimate, blocks: Sequence[str]
    ) -> dict[str, float]:
        waveforms = self._waveforms(model.reversal, model.curve)
        return score_gains(self.phasors, self.prior, estimate, waveforms, self.noise, blocks)

    def with_effects(self, best: Model) -> Model:
        """The best model with effects; a delay may have been chosen in place of one."""
        if not self.effects:
            return best
        starts = [best]
        if best.delay and False in self.lags:
            starts.append(replace(best, delay=False))
        found = [best, *(self._extended(start) for start in starts if start in self.tried)]
        criterion = self._criterion()
        return min(found, key=lambda model: criterion[model])

    def _extended(self, best: Model) -> Model:
        """Add effects with a significant score, one at a time, and drop superfluous parts."""
        while isinstance(found := self.tried[best], LikelihoodEstimate):
            absent = [name for name in EFFECTS if name not in best.effects]
            if not absent or len(best.effects) == _MOST_EFFECTS:
                break
            gains = self._gains(best, found, absent)
            least = chi2.isf(_CHANCE / len(EFFECTS), self.phasors.n)
            wider = []
            for name in sorted(absent, key=lambda name: -gains[name])[:_TRIED]:
                if 2 * gains[name] / max(1.0, found.misfit) > least:
                    effects = tuple(known for known in EFFECTS if known in (*best.effects, name))
                    richer = replace(best, effects=effects)
                    self.tried[richer] = self._fitted(richer, found.named)
                    wider.append(self._simplified(richer))
            criterion = self._criterion()
            better = min([best, *wider], key=lambda model: criterion[model])
            if better == best:
                break
            best = better
        return best

    def _simplified(self, model: Model) -> Model:
        """The best of a model and those without its friction, delay or single effects."""
        found = self.tried[model]
        if isinstance(found, JointIdError):
            return model
        simpler = [
            replace(model, effects=tuple(e for e in model.effects if e != one)) for one in model.effects
        ]
        if model.delay and False in self.lags:
            simpler.append(replace(model, delay=False))
        if model.reversal is not None and NO_FRICTION in self.frictions:
            simpler.append(replace(model, reversal=None, curve=False))
            simpler.append(replace(model, reversal=None, curve=False, delay=False))
        for one in simpler:
            if one not in self.tried or isinstance(self.tried[one], JointIdError):
                self.tried[one] = self._fitted(one, found.named)
        criterion = self._criterion()
        return min([model, *simpler], key=lambda one: criterion[one])

    def _lacks_friction(self, model: Model) -> bool:
        """Whether a model has no friction although the same with friction finds it with certainty.

        The cost would rise by half the squared friction over its variance.
        """
        found = self.tried.get(Model(0.0, model.delay))
        if isinstance(found, JointIdError):  # with friction there is no delay
            found = self.tried.get(Model(0.0, False))
        if model.reversal is not None or not isinstance(found, LikelihoodEstimate):
            return False
        coulomb, variance = found.named.coulomb, np.diag(found.covariance)[found.layout["coulomb"]]
        certain = coulomb**2 > _CERTAIN * variance
        return bool(np.any(certain & (coulomb > 0) & (variance > 0)))

    def _waveforms(self, reversal: float | None, curve: bool) -> FrictionWaveforms | None:
        if reversal is None:
            return None
        if (reversal, curve) not in self.waveforms:
            self.waveforms[reversal, curve] = friction_waveforms(self.phasors, reversal, curve=curve)
        return self.waveforms[reversal, curve]

    def best(self, models: Sequence[Model]) -> Model:
        # Models without friction come last: if friction is certain, they are skipped.
        for model in sorted(models, key=lambda model: model.reversal is None):
            self.fit(model)
        criterion = self._criterion()
        return min(models, key=lambda model: criterion[model])

    def search(self) -> Model:
        """Fit richer and richer friction models until the noise explains the residual."""
        models: list[Model] = []
        for reversal, curve in self.frictions:
            models += [Model(reversal, lag, curve) for lag in self.lags]
            if reversal is None and len(self.frictions) > 1:
                continue  # fitted together with the first friction model
            if reversal is not None:
                # From a linear start, friction and delay together may end in a local minimum.
                self.fit(Model(reversal, False, curve))
            best = self.best(models)
            if self.misfit(best) < _EXPLAINED:
                break
        return self.without_friction(best, models)

    def without_friction(self, best: Model, models: Sequence[Model]) -> Model:
        """Fit without friction from the estimate with it; from the linear one it may have diverged."""
        plain, found = Model(None, best.delay), self.tried[best]
        if best == plain or plain not in models or self._lacks_friction(plain):
            return best
        if isinstance(found, JointIdError):
            return best
        before = self.misfit(plain)
        again = self._fitted(plain, found.named)
        if isinstance(again, LikelihoodEstimate) and again.misfit < before:
            self.tried[plain] = again
            return self.best(models)
        return best

    def misfit(self, model: Model) -> float:
        estimate = self.tried[model]
        return np.inf if isinstance(estimate, JointIdError) else estimate.misfit

    def choice(self, best: Model) -> Choice:
        criterion = self._criterion()
        candidates = [
            self._candidate(model, criterion[model], model == best)
            for model in sorted(self.tried, key=lambda model: criterion[model])
        ]
        return Choice(best, self.tried[best], tuple(candidates))

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
        )

    def _start(self, model: Model) -> Parameters:
        """Parameters of the last fit of a similar model, or the linear estimate."""
        for lag in (model.delay, False):
            for earlier, estimate in reversed(self.tried.items()):
                alike = (earlier.reversal is None) == (model.reversal is None) and earlier.delay == lag
                if alike and isinstance(estimate, LikelihoodEstimate):
                    if earlier.curve == model.curve:
                        return estimate.named
                    return self.start.layout.named(estimate.elasticity)
        return self.start

    def _criterion(self) -> dict[Model, float]:
        """2·cost + the penalty of the parameters, with the cost over the best model's misfit.

        Schwarz's penalty ln(rows) for the parameters (K, D, friction, delay), Akaike's 2 for each degree
        of freedom of the free friction.
        """
        fitted = {m: e for m, e in self.tried.items() if isinstance(e, LikelihoodEstimate)}
        misfit = max(1.0, min((e.misfit for e in fitted.values()), default=1.0))
        rows = 2 * np.count_nonzero(self.phasors.harmonics[..., : self.phasors.n])
        criterion = dict.fromkeys(self.tried, np.inf)
        for model, estimate in fitted.items():
            if self._is_significant(model, estimate):
                free = estimate.parameter_count - estimate.p.size
                penalty = float(np.log(np.maximum(rows, 1))) * estimate.p.size + 2 * free
                criterion[model] = 2 * estimate.cost / misfit + penalty
        return criterion

    def _is_significant(self, model: Model, estimate: LikelihoodEstimate) -> bool:
        """Whether optional friction and delay are needed or differ from zero significantly.

        Free friction absorbs many small effects that are not friction; this rejects them.
        """
        layout, own = estimate.layout, estimate.misfit
        error = np.sqrt(np.diag(estimate.covariance) * max(1.0, own))
        significant = np.abs(estimate.p) > _SIGNIFICANT * error
        parts: list[tuple[Model, bool]] = []
        if model.reversal is not None and NO_FRICTION in self.frictions:
            own_part = layout.span("coulomb", "viscous")
            found = significant[own_part] & (estimate.p[own_part] > 0)  # friction dissipates energy
            if model.curve:
                found = significant[layout.span("coulomb", "curve")]
            without = replace(model, reversal=None, curve=False)
            parts.append((without, bool(found.any())))
        if model.delay and False in self.lags:
            parts.append((replace(model, delay=False), bool(significant[layout["delay"]].any())))
        for without, clear in parts:
            other = self.tried.get(without)
            if isinstance(other, LikelihoodEstimate):
                needed = other.misfit > _NEEDED * max(1.0, own)
            else:
                needed = self._lacks_friction(without)
            if not clear and not needed:
                return False
        return True
