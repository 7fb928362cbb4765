"""Model selection: which friction, delay and effects the records ask for.

Models grow from the simplest. A score test (Rao) estimates in one evaluation how much every absent
part would lower the cost; the best few are fitted, and parts that they make superfluous are dropped.
Models are compared by an information criterion with the cost over the best model's misfit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import Candidate, Choice, Model
from jointid.estimation.effects import EFFECTS, GEAR_LAWS, LAWS
from jointid.estimation.friction import FrictionWaveforms, friction_waveforms
from jointid.estimation.inertia_prior import InertiaPrior
from jointid.estimation.likelihood import LikelihoodEstimate, Score, maximum_likelihood, scores
from jointid.estimation.noise import Noise
from jointid.estimation.parameters import Block, ParameterLayout, Parameters
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors

_RICHER = {
    (0.0, False): ((0.03, False), (0.1, False)),
    (0.03, False): ((0.1, False), (0.03, True)),
    (0.1, False): ((0.1, True),),
    (0.03, True): ((0.1, True),),
}
"""Richer friction models for each one: velocity, over the largest, below which friction is free (from a
sharp to a gradual reversal), and whether friction varies nonlinearly with speed."""

_EXPLAINED = 1.1
"""Misfit below which richer friction cannot improve the fit noticeably."""
_SIGNIFICANT = 5.0
"""Standard errors by which an optional part must differ from zero."""
_FREE_PENALTY = 2.0
"""Factor on its square beside free friction, whose approximations other parts absorb."""
_NEEDED = 3.0
"""Ratio of misfits from which a part is needed, whatever its standard error."""
_LOST = 100.0
"""Misfit from which the search is repeated from other start values."""
_FAR = 1e4
"""Misfit of one friction model from which a richer one from the same start does not converge either."""
_WORTH = 0.2
"""Share of the misfit beyond 1 that a part must explain where the model leaves more than noise: every
wrong part explains something."""
_CHANCE = 1e-3
"""Probability that the score of any part leads to a fit on an ideal robot."""
_SIMILAR = 0.3
"""Score over the highest from which a part is fitted: similar parts differ by the cost only."""
_DECISIVE = 0.3
"""Score over the cost from which a part is fitted before richer friction."""
_TRIED, _TRIED_LAWS = 5, 2
"""The most parts, and nonlinear laws among them, that are fitted for each one added."""
_HOPELESS = 3e4
"""Misfit of wrong units, signs or gear ratios, of which no law explains a decisive share."""
_MOST_EFFECTS = 3
_MOST_FITS = 24
"""Fits of one search; wrong data would take many more."""
_DOUBT = 0.005
"""Probability that the score of any part widens the error bars on an ideal robot."""
_OCCAM = 1 / 20
"""Weight of a model, over the best, from which it explains the data as well."""
_BENT = 4.0
"""Standard deviations of the misfit from which three slopes are fitted in place of a cubic law."""
_FAR_LAWS, _ROUGH = ("cubic", "backlash", "hysteresis"), 0.1
"""Laws that are fitted where the linear fit is lost; at their start damping over stiffness, and
hysteresis over the largest torque and deflection."""
_MOST_SLOW_FITS = 8
"""Fits with a law of the gears."""
_CERTAIN = 200.0
"""Squared parameter over its variance from which a model without it need not be fitted."""


def choose_model(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia] | InertiaPrior,
    start: Floats,
    noise: Noise,
    *,
    friction: bool,
    delay: bool,
    exactly: bool = False,
    gear: str = "auto",
) -> Choice:
    """Fit models from simple to rich until no further part is significant, and choose the best.

    Parameters
    ----------
    friction, delay : bool
        Parts that every model has; the others are optional.
    exactly : bool
        Exclude the optional parts; only the form of the friction reversals is chosen.
    gear : {"auto", "linear"}
        Whether nonlinear laws of the gears are among the optional parts.
    """
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    linear = ParameterLayout.of(phasors.n).named(start)
    optional: list[str] = []
    if not exactly:
        effects = [name for name in EFFECTS if gear == "auto" or name not in GEAR_LAWS]
        effects = [name for name in effects if name != "piecewise"]  # in place of a cubic law
        if np.any(phasors.drift):  # a superposed motion that does not reverse
            effects.remove("motor_presliding")
        optional = ["friction"] * (not friction) + ["delay"] * (not delay) + effects
    base = Model(0.0 if friction else None, delay)
    return _searched(_Search(phasors, prior, linear, noise, base, tuple(optional)))


def _searched(search: _Search) -> Choice:
    """Search from the linear estimate and, if the misfit stays large, from other start values.

    Heavy friction can make the linear estimate negative, or lead it to another local minimum.
    """
    best = search.best()
    misfit = search.misfit(best)
    if misfit < _LOST:
        return search.choice(best)
    better = min(misfit / 10, _FAR)
    good = _LOST if np.isinf(misfit) else min(misfit / 3, max(_LOST, misfit / _LOST))
    probe = search.base
    if "friction" in search.optional and search.phasors.harmonics.shape[1] > 1:
        probe = Model(0.03, search.base.delay or "delay" in search.optional)
    for start in _other_starts(search.phasors, search.prior):
        other = replace(search, start=start, tried={}, slow_fits=0)
        other.fit(probe, start)
        if other.misfit(probe) < better:
            found = other.best()
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


def _by_motion(phasors: Phasors, prior: InertiaPrior) -> Parameters:
    """K and D from torque over deflection by the given inertias, which wrong ones spoil less.

    The deflection is the difference of motor and arm angle: a record counts by the inverse of the arm's.
    """
    s = 1j * phasors.omega[:, None]
    torque = phasors.tau - s**2 * prior.M[prior.rotor] * phasors.q
    arm = np.linalg.solve(prior.M2[prior.pose], torque[..., None])[..., 0] / s**2
    delta = phasors.q - arm
    product = torque * delta.conj() / np.abs(arm) ** 2
    K = product.real.sum(axis=0) / (np.abs(delta / arm) ** 2).sum(axis=0)
    layout = ParameterLayout.of(phasors.n, effects=["hysteresis"])
    return layout.named(
        layout.pack(
            K=np.abs(K),
            D=_ROUGH * np.abs(K / phasors.omega.max()),
            hysteresis=_ROUGH * np.abs(torque).max(axis=0),
            presliding=_ROUGH * np.abs(delta).max(axis=0),
        )
    )


def _with_delay(estimate: LikelihoodEstimate) -> Parameters:
    """The parameters, with the mean of the lags as the delay where there are lags."""
    p = estimate.named
    if "lag" not in p.layout or "delay" in p.layout:
        return p
    delayed = ParameterLayout((*p.layout.blocks, Block("delay", (), ("delay",))))
    return delayed.named(np.append(p.vector, p["lag"].mean()))


@dataclass
class _Search:
    """Models fitted so far, with their estimates."""

    phasors: Phasors
    prior: InertiaPrior
    start: Parameters
    noise: Noise
    base: Model
    """Parts that every model has."""
    optional: tuple[str, ...]
    """The others: "friction", "delay" and keys of ``EFFECTS``."""
    tried: dict[Model, LikelihoodEstimate | JointIdError] = field(default_factory=dict)
    waveforms: dict[tuple[float, bool], FrictionWaveforms] = field(default_factory=dict)
    slow_fits: int = 0

    def best(self) -> Model:
        """Grow and prune from the base, or from the best model that is fitted already."""
        self.fit(self.base, self.start)
        rubbing = replace(self.base, reversal=0.0)
        if self.misfit(self.base) >= _LOST and "friction" in self.optional:
            self.fit(rubbing, self.start)  # heavy friction leads the plain fit astray
        for law in _FAR_LAWS:  # and so does a gear that is far from linear
            if min(self.misfit(m) for m in self.tried) >= _LOST and law in self.optional:
                self.fit(self.base.with_part(law), _by_motion(self.phasors, self.prior))
        best = self._least(list(self.tried))
        while len(self.tried) < _MOST_FITS:
            found = [best]
            for wider in self._extensions(best):
                leading = self._least(found)
                explained = self.misfit(leading) < _EXPLAINED < self.misfit(best)
                if explained and not {*wider.effects}.difference(best.effects).isdisjoint(LAWS):
                    continue
                if leading.reversal != best.reversal and wider.reversal == best.reversal:
                    continue  # richer friction first: other parts absorb some of it
                self._fit_wider(wider, best)
                found.append(self._pruned(wider))
            better = self._least(found)
            if better == best:
                break
            best = better
        return best

    def fit(self, model: Model, start: Parameters) -> None:
        """Fit a model; of two fits from different starts the better one stays."""
        earlier = self.tried.get(model)
        if not set(GEAR_LAWS).isdisjoint(model.effects):
            if self.slow_fits == _MOST_SLOW_FITS:
                self.tried.setdefault(model, JointIdError("Not fitted: enough laws were tried."))
                return
            self.slow_fits += 1
        try:
            estimate = maximum_likelihood(
                self.phasors,
                self.prior,
                start,
                friction=self._waveforms(model),
                delay=model.delay,
                effects=model.effects,
                noise=self.noise,
            )
        except JointIdError as error:
            self.tried.setdefault(model, error)
            return
        if not isinstance(earlier, LikelihoodEstimate) or estimate.misfit < earlier.misfit:
            self.tried[model] = estimate

    def _fit_wider(self, wider: Model, narrow: Model) -> None:
        """Fit with one more part, from the estimate without it or, where that is far off, the start."""
        if wider in self.tried:
            return
        found = self.tried[narrow]
        if self.misfit(narrow) >= _LOST:
            self.fit(wider, self.start)
        if isinstance(found, LikelihoodEstimate) and not self.misfit(wider) < _LOST:
            self.fit(wider, found.named)

    def _extensions(self, model: Model) -> list[Model]:
        """Models with one more part that may lower the cost significantly."""
        found = self.tried[model]
        if isinstance(found, JointIdError):
            return []
        scored = self.scores(model)
        order = sorted(scored, key=lambda part: scored[part].penalised(self.rows), reverse=True)
        chance = _CHANCE / max(len(self.optional), 1)
        clear = [
            part
            for part in order
            if 2 * scored[part].gain / max(1.0, found.misfit) > chi2.isf(chance, scored[part].count)
            and scored[part].gain > _SIMILAR * scored[order[0]].gain
        ]
        least = _DECISIVE * found.cost if found.misfit > _HOPELESS else 0.0
        laws = [part for part in clear if part in LAWS and scored[part].gain > least][:_TRIED_LAWS]
        wider = [model.with_part(part) for part in clear if part in laws or part not in LAWS][:_TRIED]
        if model.reversal is not None and found.misfit > _EXPLAINED:
            richer = _RICHER.get((model.reversal, model.curve), ())
            sharper = [replace(model, reversal=reversal, curve=curve) for reversal, curve in richer]
            decisive = bool(clear) and scored[clear[0]].gain > _DECISIVE * found.cost
            wider = [*wider, *sharper] if decisive else [*sharper, *wider]
        if "cubic" in model.effects and max(found.misfit, found.fundamental[0]) > 1 + _BENT / np.sqrt(
            max(found.expected_cost, 1.0)
        ):
            wider.insert(0, model.without("cubic").with_part("piecewise"))
        return [each for each in wider if each not in self.tried]

    def scores(self, model: Model) -> dict[str, Score]:
        """Score of every optional part that the model lacks."""
        found = self.tried[model]
        full = len(model.effects) >= _MOST_EFFECTS
        absent = [p for p in self.optional if p not in model.parts and not (full and p in EFFECTS)]
        if isinstance(found, JointIdError) or not absent:
            return {}
        waveforms = self._waveforms(model)
        if waveforms is None and "friction" in absent:
            waveforms = self._waveforms(replace(model, reversal=0.0))
        return scores(self.phasors, self.prior, found, waveforms, self.noise, absent)

    def _pruned(self, model: Model) -> Model:
        """The best of a model and those without parts that are not beyond doubt."""
        found = self.tried[model]
        if isinstance(found, JointIdError):
            return model
        models = [model]
        for part in model.parts:
            if part not in self.optional:
                continue
            narrower = [] if self._is_certain(found, part) else [model.without(part)]
            if part == "lag" and "delay" in self.optional:
                narrower.append(model.without(part).with_part("delay"))
            for narrow in narrower:
                models.append(narrow)
                if self.misfit(narrow) > _NEEDED * max(1.0, found.misfit):
                    self.fit(narrow, _with_delay(found))  # from other starts it may have diverged
        best = self._least(models)
        return best if best == model else self._pruned(best)

    def _is_certain(self, estimate: LikelihoodEstimate, part: str) -> bool:
        """Whether the cost without a part would be far higher, by its size in standard errors."""
        place = estimate.layout.of_part(part)
        variance = np.diag(estimate.covariance)[place] * max(1.0, estimate.misfit)
        squared = estimate.p[place] ** 2
        return bool(np.any((squared > _CERTAIN * variance) & (variance > 0)))

    def _waveforms(self, model: Model) -> FrictionWaveforms | None:
        if model.reversal is None:
            return None
        key = model.reversal, model.curve
        if key not in self.waveforms:
            self.waveforms[key] = friction_waveforms(self.phasors, key[0], curve=key[1])
        return self.waveforms[key]

    @property
    def rows(self) -> int:
        """Real equations of all records, joints and harmonics."""
        measured = int(np.count_nonzero(self.phasors.harmonics[..., : self.phasors.n]))
        return max(2 * measured, 1)

    def misfit(self, model: Model) -> float:
        """Misfit of a model that was tried; infinite where it could not be fitted."""
        estimate = self.tried.get(model)
        return estimate.misfit if isinstance(estimate, LikelihoodEstimate) else np.inf

    def _least(self, models: Sequence[Model]) -> Model:
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

    def _is_significant(self, model: Model, estimate: LikelihoodEstimate) -> bool:
        """Whether every optional part is needed, or significant and physical."""
        return all(
            self._part_is_significant(model, estimate, part)
            for part in model.parts
            if part in self.optional
        )

    def _part_is_significant(self, model: Model, estimate: LikelihoodEstimate, part: str) -> bool:
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
        beyond_noise = own > _EXPLAINED and simpler is not None and part != "friction"
        if beyond_noise and simpler and simpler.misfit - own < _WORTH * (simpler.misfit - 1):
            return False
        if simpler and part in EFFECTS:  # its standard error may be that of an uncertain inertia
            least = _SIGNIFICANT**2 * (_FREE_PENALTY if model.reversal else 1.0) + size.size
            clear[:] = 2 * (simpler.whole_cost(own) - estimate.whole_cost(own)) > least
        if part in EFFECTS and EFFECTS[part].positive:
            if np.any(size < -_SIGNIFICANT * sigma):
                return False
            clear &= size > 0
        elif part == "friction" and not model.curve:
            clear &= size > 0  # it dissipates energy
        return bool(clear.any()) or (simpler is not None and simpler.misfit > _NEEDED * own)

    def choice(self, best: Model) -> Choice:
        """The best model with the candidates, and how far others that explain the data differ."""
        criterion = self.criterion()
        candidates = [
            self._candidate(model, criterion[model], model == best)
            for model in sorted(self.tried, key=lambda model: criterion[model])
        ]
        return Choice(best, self.tried[best], tuple(candidates), self._spread(best))

    def _spread(self, best: Model) -> Floats:
        """Covariance of K and D by the choice between models, shape (2n, 2n).

        The weight of a model is exp(−½ difference of the criterion) to the best. Unlikely ones are left
        out (Occam's window; Madigan and Raftery, Journal of the American Statistical Association 89,
        1994). A part that was not fitted counts in full where its score is nearly significant: one that
        moves K by so many standard errors has a score of at least as many.
        """
        found = self.tried[best]
        size = 2 * self.phasors.n
        if isinstance(found, JointIdError):
            return np.zeros((size, size))
        criterion, shifts = self.criterion(), []
        doubt, misfit = _DOUBT / max(len(self.optional), 1), max(1.0, found.misfit)
        for model, estimate in self.tried.items():
            if model == best or not isinstance(estimate, LikelihoodEstimate):
                continue
            weight = float(np.exp(np.minimum(0.5 * (criterion[best] - criterion[model]), 0.0)))
            added = set(model.parts).difference(best.parts)
            if len(added) == 1 and added <= EFFECTS.keys() and set(best.parts) < set(model.parts):
                gain = 2 * (found.whole_cost(misfit) - estimate.whole_cost(misfit))
                weight = max(weight, float(gain > chi2.isf(doubt, estimate.p.size - found.p.size)))
            shifts.append((weight, estimate.elasticity - found.elasticity))
        for part, score in self.scores(best).items():
            clear = 2 * score.gain / misfit > chi2.isf(doubt, score.count)
            if clear and best.with_part(part) not in self.tried:
                shifts.append((1.0, score.shift))
        equals = [(weight, shift) for weight, shift in shifts if weight > _OCCAM]
        total = 1 + sum(weight for weight, _ in equals)
        spread = np.zeros((size, size))
        for weight, shift in equals:
            spread += weight / total * np.outer(shift, shift)
        return spread

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
