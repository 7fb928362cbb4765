"""Model selection: which friction, delay and effects the records ask for.

Models grow from the simplest. A score test (Rao) estimates in one evaluation how much every absent
part would lower the cost; the best few are fitted, and parts that they make superfluous are dropped.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtri

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import (
    CHANCE,
    EXPLAINED,
    NEEDED,
    WORTH,
    Choice,
    Fits,
    Model,
    fit_model,
    fundamental_chance,
    model_waveforms,
    stepped,
)
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import (
    EFFECTS,
    GEAR_LAWS,
    LAWS,
    ParameterLayout,
    Parameters,
)
from jointid.estimation.estimators.score_tests import Score, scores
from jointid.estimation.model_average import spread, spread_of_filters, spread_of_links
from jointid.estimation.start_values import (
    at_resonances,
    by_motion,
    friction_start,
    other_laws,
    with_delay,
    with_play,
    without_inertias,
)
from jointid.joints import Inertia
from jointid.motion.friction import FrictionWaveforms
from jointid.phasors.extract import MANY_HARMONICS, Phasors

_RICHER = {
    (0.0, False): ((0.03, False), (0.1, False)),
    (0.03, False): ((0.1, False), (0.03, True)),
    (0.1, False): ((0.1, True),),
    (0.03, True): ((0.1, True),),
}
"""Richer friction models for each one: velocity, over the largest, below which friction is free (from a
sharp to a gradual reversal), and whether friction varies nonlinearly with speed."""

_LOST = 100.0
"""Misfit from which the search is repeated from other start values."""
_DOUBTFUL = 3.0
"""Misfit from which the simplest model is fitted from start values without the given inertias, too."""
_FAR = 1e4
"""Misfit of one friction model from which a richer one from the same start does not converge either."""
_EXPLAINED_MOTIONS = 1.3
"""Misfit of motions below which richer friction and laws are not tried: their noise is that of the
residual, and wide reversals leave few equations."""
_ALIKE = 1.2
"""Ratio of misfits up to which another width of the reversals explains motions as well."""
_OTHER_REVERSALS = {0.0: (0.03,), 0.03: (0.0, 0.1), 0.1: (0.03,)}
"""The next narrower and wider reversals of each one."""
_SIMILAR = 0.3
"""Score over the highest from which a part is fitted: similar parts differ by the cost only."""
_DECISIVE = 0.3
"""Score over the cost from which a part is fitted before richer friction."""
_NEARLY_ALL = 0.9
"""Score over the cost from which a part is fitted in place of a law, or before others that are."""
_TRIED, _TRIED_LAWS = 5, 2
"""The most parts, and nonlinear laws among them, that are fitted for each one added."""
_HOPELESS = 3e4
"""Misfit of wrong units, signs or gear ratios, of which no law explains a decisive share."""
_MOST_EFFECTS = 3
_MOST_FITS, _MOST_POOR_FITS, _POOR = 24, 20, 10.0
"""Models of one search, and fits from any start values while the misfit is poor."""
_BENT = 4.0
"""Standard deviations of the misfit from which three slopes are fitted in place of a cubic law."""
_FAR_LAWS = "cubic", "backlash", "hysteresis"
"""Laws that are fitted where the linear fit is lost."""
_CLIMB, _MOST_CLIMBS = 0.7, 2
"""Ratio of misfits by which a part must lower one that is lost, and how many parts are tried for it."""
_HALFWAY = 0.25
"""Share of the gain needed to keep a part from which its score leads to a slow fit."""
_MOST_STARTS = 2
"""Start values from which a model is fitted."""
_MANY_ROWS = 20_000
"""Equations, those of six joints in 50 records, from which one part is tried where the model explains
the data: a fit takes seconds."""
_MOST_SLOW_FITS = 12
"""Fits with a law of the gears."""
_MOST_SLOW_FITS_OF_MOTIONS = 3
"""The same where the records hold motions."""


def choose_model(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia] | InertiaPrior,
    start: Floats | Parameters,
    noise: Noise,
    *,
    friction: bool,
    delay: bool,
    exactly: bool = False,
    gear: str = "auto",
    first: Model | None = None,
) -> Choice:
    """Fit models from simple to rich until no further part is significant, and choose the best.

    Parameters
    ----------
    start : ndarray, shape (2n,), or Parameters
        K and D of a linear estimator, or the parameters of a model with friction.
    friction, delay : bool
        Parts that every model has; the others are optional.
    exactly : bool
        Exclude the optional parts; only the form of the friction reversals is chosen.
    gear : {"auto", "linear"}
        Whether nonlinear laws of the gears are among the optional parts.
    first : Model, optional
        The model of the start values, which is fitted first.
    """
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    linear = start if isinstance(start, Parameters) else ParameterLayout.of(phasors.n).named(start)
    motions, excluded = bool(phasors.motion.any()), {"piecewise"}  # in place of a cubic law
    if gear == "linear":
        excluded |= set(GEAR_LAWS)
    if np.any(phasors.drift) or motions:  # a superposed motion does not reverse
        excluded.add("motor_presliding")
    if motions:
        excluded |= set(LAWS).difference(GEAR_LAWS)
    parts = ("friction",) * (not friction) + ("delay",) * (not delay)
    parts += tuple(name for name in EFFECTS if name not in excluded)
    optional = () if exactly else parts
    rows = 2 * int(np.count_nonzero(phasors.harmonics[..., : phasors.n]))
    search = _Search(
        phasors,
        prior,
        linear,
        noise,
        Model(0.0 if friction else None, delay),
        Fits(optional, phasors.n, max(rows, 1)),
    )
    if first is not None:
        search.fit(first, linear)
    if search.may_rub:
        search = replace(search, start=friction_start(phasors, prior, linear) or linear)
    return _searched(search)


def _searched(search: _Search) -> Choice:
    """Search from the linear estimate and, if the misfit stays large, from other start values.

    Heavy friction can make the linear estimate negative, or lead it to another local minimum.
    """
    best = search.best()
    misfit = search.fits.misfit(best)
    if misfit < _LOST:
        return search.choice(best)
    better = min(misfit / 10, _FAR)
    good = _LOST if np.isinf(misfit) else min(misfit / 3, max(_LOST, misfit / _LOST))
    probe = search.base
    if "friction" in search.fits.optional and search.phasors.harmonics.shape[1] > 1:
        probe = Model(0.03, search.base.delay or "delay" in search.fits.optional)
    for start in (*search.free_start(), *at_resonances(search.phasors, search.prior)):
        other = replace(search, start=start, fits=replace(search.fits, tried={}), starts={}, slow_fits=0)
        other.fit(probe, start)
        if other.fits.misfit(probe) < better:
            found = other.best()
            if other.fits.misfit(found) < good:
                return other.choice(found)
    return search.choice(best)


@dataclass
class _Search:
    """Growth of the model from one start."""

    phasors: Phasors
    prior: InertiaPrior
    start: Parameters
    noise: Noise
    base: Model
    """Parts that every model has."""
    fits: Fits
    waveforms: dict[tuple[float | None, bool], FrictionWaveforms | None] = field(default_factory=dict)
    scored: dict[Model, tuple[LikelihoodEstimate, dict[str, Score]]] = field(default_factory=dict)
    """Scores with the estimate at which they were evaluated."""
    starts: dict[Model, int] = field(default_factory=dict)
    """Number of start values from which each model was fitted."""
    slow_fits: int = 0

    @property
    def may_rub(self) -> bool:
        """Whether a model may have friction of sines."""
        friction = self.base.reversal is not None or "friction" in self.fits.optional
        return friction and not self.phasors.motion.any()

    def best(self) -> Model:
        """Grow and prune from the base, or from the best model that is fitted already."""
        self._fit_first()
        best = self.fits.least(list(self.fits.tried))
        lost = self._is_lost()
        if lost:
            best = self._climbed(best)
        if lost or best.reversal is not None:  # parts that only the start values, or gears, suggest
            best = self._pruned(best)
        while not self._is_spent(best):
            better = self._grown(best)
            if better == best:
                break
            best = better
        return best

    def _fit_first(self) -> None:
        """Fit friction first where the start or harmonics show it, else the base.

        Heavy friction and gears that are far from linear lead the plain fit astray.
        """
        fits, rubbing = self.fits, replace(self.base, reversal=0.0)
        by_start = "coulomb" in self.start.layout
        distorted = self.phasors.harmonics.shape[1] >= MANY_HARMONICS
        if self._is_lost() and (by_start or (self.may_rub and distorted)):
            self.fit(rubbing, self.start)
            found = fits.tried[rubbing]
            clear = by_start or fits.is_certain(rubbing, "friction")
            if isinstance(found, LikelihoodEstimate) and self._may_be_richer(found) and clear:
                free = replace(self.base, reversal=0.03)
                if by_start and self._is_lost():  # sticking leads friction without it astray
                    self.fit(free, self.start)
                if self._is_lost():
                    self.fit(free, found.named)
        if not by_start and (self._is_lost() or rubbing not in fits.tried):
            self.fit(self.base, self.start)
            if fits.misfit(self.base) > _DOUBTFUL and not distorted:
                for start in self.free_start():  # wrong inertias may lead the linear estimate astray
                    self.fit(self.base, start)
            if self._is_lost() and "delay" in fits.optional:  # the most frequent cause
                self.fit(self.base.with_part("delay"), self.start)
            if self._is_lost() and "friction" in fits.optional and rubbing not in fits.tried:
                self.fit(rubbing, self.start)
        plain = fits.misfit(self.base if self.base in fits.tried else rubbing)  # motors stick
        rubs, laws = NEEDED * min(map(fits.misfit, fits.tried)) < plain < np.inf, []
        if not rubs and not self.phasors.motion.any():
            begins = {"backlash": with_play}
            laws += [(self.base, law, begins.get(law, by_motion)) for law in _FAR_LAWS]
        if self.may_rub:
            laws += [(rubbing, "backlash", begin) for begin in (with_play, by_motion)]
        for model, law, begin in laws:
            if self._is_lost() and law in fits.optional:
                self.fit(model.with_part(law), begin(self.phasors, self.prior))

    def _may_be_richer(self, found: LikelihoodEstimate) -> bool:
        """Whether richer friction, or a law of the gears, may lower the cost noticeably."""
        if self.phasors.motion.any():
            return found.misfit > _EXPLAINED_MOTIONS
        return found.misfit > EXPLAINED or fundamental_chance(found) < CHANCE

    def _climbed(self, model: Model) -> Model:
        """The best model after adding the part of the highest score as long as the misfit falls by it.

        With several laws and friction together every model on the way is far off: comparing their
        alternatives there would use up the fits before the whole is reached.
        """
        fits, falls = self.fits, True
        while falls and len(model.effects) < _MOST_EFFECTS and fits.misfit(model) > EXPLAINED:
            found, scored = fits.tried[model], self.scores(model)
            if isinstance(found, JointIdError):
                break
            falls = False
            parts = sorted(scored, key=lambda name: -scored[name].gain)[:_MOST_CLIMBS]
            least = _NEARLY_ALL * scored[parts[0]].gain if parts else 0.0
            similar = [model.with_part(part) for part in scored if scored[part].gain > least]
            if len(similar) > 1 and not any(wider.is_slow for wider in similar):
                for wider in similar:  # a delay, lags and filters, which their cost tells apart
                    self.fit(wider, found.named)
                lowest = min(map(fits.misfit, similar))
                further = [fits.least([m for m in similar if fits.misfit(m) <= EXPLAINED * lowest])]
            else:
                further = [model.with_part(part) for part in parts]
            for law in set(GEAR_LAWS).intersection(model.effects):  # the first law may be a wrong one
                further += [model.without(law).with_part(part) for part in parts[:1]]
            for wider in further:
                self.slow_fits -= wider.is_slow  # not one of those that compare
                self.fit(wider, found.named)
                falls = fits.misfit(wider) < _CLIMB * found.misfit
                if falls:
                    model = wider
                    break
        self._pruned(model)  # friction that it needed on the way may have lost its significance
        return fits.least(list(fits.tried))

    def _is_lost(self) -> bool:
        return not min(map(self.fits.misfit, self.fits.tried), default=np.inf) < _LOST

    def _grown(self, best: Model) -> Model:
        """The best of a model and those with one more part, pruned."""
        fits, found = self.fits, [best]
        for k, wider in enumerate(sorted(self._extensions(best), key=lambda model: model.is_slow)):
            leading = fits.least(found)
            if self._is_spent(leading):
                break
            if not self._is_passed_over(wider, best, leading):
                self._fit_wider(wider, best, leading, leads=k == 0)
                found.append(self._pruned(wider) if self._is_kept(wider, best) else wider)
        return fits.least(found)

    def _is_passed_over(self, wider: Model, best: Model, leading: Model) -> bool:
        """Whether a fit is not worth its time since another extension of the best model leads."""
        fits = self.fits
        if leading == best:
            return False
        added = set(wider.effects).difference(best.effects)
        if fits.misfit(leading) < EXPLAINED < fits.misfit(best) and not added.isdisjoint(LAWS):
            return True
        if fits.is_explained(leading) and (wider.is_slow or wider.parts == leading.parts):
            return True  # the score of a slow part decides again
        # Richer friction first: other parts absorb some of it.
        return leading.reversal != best.reversal and wider.reversal == best.reversal

    def _is_spent(self, best: Model) -> bool:
        """Whether the search ends: wrong data would take many fits from several start values."""
        poor = self.fits.misfit(best) > _POOR
        return sum(self.starts.values()) >= _MOST_POOR_FITS if poor else len(self.starts) >= _MOST_FITS

    def free_start(self) -> tuple[Parameters, ...]:
        """Start values without uncertain inertias, if the records give any."""
        start = without_inertias(self.phasors, self.prior) if self.prior.inertia_std else None
        return () if start is None else (start,)

    def fit(self, model: Model, start: Parameters) -> None:
        """Fit a model; of two fits from different starts the better one stays."""
        tried = self.fits.tried
        earlier = tried.get(model)
        self.starts[model] = self.starts.get(model, 0) + 1
        if model.is_slow:
            motions = bool(self.phasors.motion.any())
            if self.slow_fits == (_MOST_SLOW_FITS_OF_MOTIONS if motions else _MOST_SLOW_FITS):
                tried.setdefault(model, JointIdError("Not fitted: the limit of fitted laws is reached."))
                return
            self.slow_fits += 1
        try:
            waveforms = self._waveforms(model)
            estimate = fit_model(self.phasors, self.prior, start, self.noise, model, waveforms)
            for other in other_laws(self.phasors, self.prior, start, estimate.named):
                if estimate.misfit > _DOUBTFUL:
                    again = fit_model(self.phasors, self.prior, other, self.noise, model, waveforms)
                    estimate = min(estimate, again, key=lambda each: each.whole_cost(1))
        except JointIdError as error:
            tried.setdefault(model, error)
            return
        if not isinstance(earlier, LikelihoodEstimate) or estimate.whole_cost(1) <= earlier.whole_cost(
            1
        ):
            tried[model] = estimate

    def _is_kept(self, wider: Model, narrow: Model) -> bool:
        """Whether a wider model may last; a slow one with a part that is not significant does not."""
        estimate = self.fits.tried[wider]
        if isinstance(estimate, JointIdError) or not wider.is_slow:
            return True
        added = set(wider.parts).difference(narrow.parts).intersection(self.fits.optional)
        return all(self.fits.part_is_significant(wider, estimate, part) for part in added)

    def _is_open(self, model: Model) -> bool:
        """Whether a model was not fitted, or is lost from its only start values."""
        return self.fits.misfit(model) >= _LOST and self.starts.get(model, 0) < _MOST_STARTS

    def _fit_wider(self, wider: Model, narrow: Model, leading: Model, *, leads: bool) -> None:
        """Fit with one more part, from the estimate without it.

        Where that is far off, the fit starts from that of the same parts with other friction, or else
        as all do; a slow one does so last, and only if it is the most promising.
        """
        fits = self.fits
        if not self._is_open(wider):
            return
        found, near = fits.tried[narrow], fits.tried[leading]
        starts = [found.named] if isinstance(found, LikelihoodEstimate) else []
        if fits.misfit(narrow) >= _LOST:
            similar = leading.parts == wider.parts and fits.misfit(leading) < _LOST
            if similar and isinstance(near, LikelihoodEstimate):
                starts.insert(0, near.named)
            elif not wider.is_slow:
                starts.insert(0, self.start)
            elif leads:
                starts.append(self.start)
        for start in starts:
            if not fits.misfit(wider) < _LOST:
                self.fit(wider, start)
        stuck = fits.misfit(wider) >= fits.misfit(narrow) > _POOR  # one more part cannot raise the cost
        if stuck and wider.is_slow and self.starts.get(wider, 0) < _MOST_STARTS:
            self.fit(wider, self.start)

    def _extensions(self, model: Model) -> list[Model]:
        """Models with one more part that may lower the cost significantly."""
        found = self.fits.tried[model]
        if isinstance(found, JointIdError):
            return []
        clear = self._clear_parts(model, found)
        scored = self.scores(model)
        least = _DECISIVE * found.cost if found.misfit > _HOPELESS else 0.0
        most_laws = 1 if self.fits.is_explained(model) else _TRIED_LAWS
        laws = [part for part in clear if part in LAWS and scored[part].gain > least][:most_laws]
        promising = (
            part
            for part in clear
            if (part in laws or part not in LAWS) and self._is_promising(model, part, scored[part])
        )
        tried = _TRIED if self.fits.rows < _MANY_ROWS or found.misfit > EXPLAINED else 1
        wider = [model.with_part(part) for part in promising][:tried]
        if model.is_slow and found.misfit >= _LOST:  # another part may explain the data without the law
            bare = replace(model, effects=tuple(e for e in model.effects if e not in GEAR_LAWS))
            instead = (part for part in clear if scored[part].gain > _NEARLY_ALL * found.cost)
            wider += [bare.with_part(part) for part in instead if part not in LAWS]
        if model.reversal is not None and self._may_be_richer(found):
            richer = _RICHER.get((model.reversal, model.curve), ())
            sharper = [replace(model, reversal=reversal, curve=curve) for reversal, curve in richer]
            decisive = bool(clear) and scored[clear[0]].gain > _DECISIVE * found.cost
            wider = [*wider, *sharper] if decisive else [*sharper, *wider]
        spread = np.sqrt(max(found.expected_cost, 1.0))
        if "cubic" in model.effects and max(found.misfit, found.fundamental[0]) > 1 + _BENT / spread:
            plain = model.without("cubic")
            laws_instead = ["piecewise"] if "backlash" in model.parts else ["backlash", "piecewise"]
            instead_of_cubic = [plain.with_part(law) for law in laws_instead]
            complete = bool(clear) and scored[clear[0]].gain > _NEARLY_ALL * found.cost
            wider = [*wider, *instead_of_cubic] if complete else [*instead_of_cubic, *wider]
        return [each for each in wider if self._is_open(each)]

    def _clear_parts(self, model: Model, found: LikelihoodEstimate) -> list[str]:
        """Absent parts with a significant score that is not far below the highest, best first."""
        scored = self.scores(model)
        order = sorted(scored, key=lambda part: scored[part].penalised(self.fits.rows), reverse=True)
        chance, misfit = CHANCE / max(len(self.fits.optional), 1), max(1.0, found.misfit)
        return [
            part
            for part in order
            if 2 * scored[part].gain / misfit > chdtri(scored[part].count, chance)
            and scored[part].gain > _SIMILAR * scored[order[0]].gain
        ]

    def _is_promising(self, model: Model, part: str, score: Score) -> bool:
        """Whether a slow fit with one more part is worth its time, by the part's score.

        It is not where the part cannot explain enough of the misfit to be kept, nor where the model
        explains the data without it and K and D would hardly move. Its score still widens the errors.
        """
        found = self.fits.tried[model]
        if isinstance(found, JointIdError) or not model.with_part(part).is_slow:
            return True
        if self.phasors.motion.any() and not self._may_be_richer(found):
            return False  # it takes a minute
        if part != "friction" and found.misfit > EXPLAINED:
            needed = WORTH * (found.misfit - 1) * found.expected_cost
            return score.gain > _HALFWAY * needed
        sigma = np.sqrt(np.diag(found.elasticity_covariance))
        return not self.fits.is_explained(model) or bool(np.any(np.abs(score.shift) > sigma))

    def scores(self, model: Model) -> dict[str, Score]:
        """Score of every optional part that the model lacks."""
        found = self.fits.tried[model]
        full = len(model.effects) >= _MOST_EFFECTS
        absent = [p for p in self.fits.optional if p not in model.parts and not (full and p in EFFECTS)]
        if isinstance(found, JointIdError) or not absent:
            return {}
        if model not in self.scored or self.scored[model][0] is not found:
            waveforms = self._waveforms(model)
            if waveforms is None and "friction" in absent:
                waveforms = self._waveforms(replace(model, reversal=0.0))
            self.scored[model] = (
                found,
                scores(self.phasors, self.prior, found, waveforms, self.noise, absent),
            )
        return self.scored[model][1]

    def _pruned(self, model: Model) -> Model:
        """The best of a model and those without parts that are not beyond doubt."""
        fits, found = self.fits, self.fits.tried[model]
        if isinstance(found, JointIdError):
            return model
        models = [model, *self._narrower(model)]
        for narrow in models[1:]:
            far = fits.misfit(narrow) > NEEDED * max(1.0, found.misfit)
            if far and self.starts.get(narrow, 0) < _MOST_STARTS:
                self.fit(narrow, with_delay(found.named))  # from other starts it may have diverged
        best = fits.least(models)
        return best if best == model else self._pruned(best)

    def _narrower(self, model: Model) -> Iterator[Model]:
        """The model without each part that is not certain, and with a delay in place of lags."""
        for part in model.parts:
            if part in self.fits.optional:
                if not self.fits.is_certain(model, part):
                    yield model.without(part)
                if part == "lag" and "delay" in self.fits.optional:
                    yield model.without(part).with_part("delay")

    def _waveforms(self, model: Model) -> FrictionWaveforms | None:
        key = model.reversal, model.curve
        if key not in self.waveforms:
            self.waveforms[key] = model_waveforms(self.phasors, model)
        return self.waveforms[key]

    def choice(self, best: Model) -> Choice:
        """The best model with the candidates, and how far others that explain the data differ."""
        found, candidates = self.fits.tried[best], self.fits.candidates(best)
        scored = self.scores(best)
        whole = spread(self.fits, best, scored) + self._spread_of_reversals(best)
        if isinstance(found, LikelihoodEstimate):
            if "link" in scored and not self.phasors.motion.any():
                whole = whole + spread_of_links(found, scored["link"], self.prior)
            whole = whole + spread_of_filters(found, scored)
        return Choice(best, found, candidates, whole)

    def _spread_of_reversals(self, best: Model) -> Floats:
        """Mean square change of K and D with other reversals of the friction, shape (2n, 2n).

        Motions pass their reversals at all speeds: no one width of a reversal is right for all.
        """
        found, shifts = self.fits.tried[best], [np.zeros(2 * self.phasors.n)]
        if isinstance(found, JointIdError) or best.reversal is None or not self.phasors.motion.any():
            return np.zeros((2 * self.phasors.n,) * 2)
        for reversal in _OTHER_REVERSALS[best.reversal]:
            other = replace(best, reversal=reversal)
            waveforms = self._waveforms(other)
            near, misfit = stepped(self.phasors, self.prior, found, self.noise, other, waveforms)
            if misfit < _ALIKE * found.misfit:
                shifts.append(near[: 2 * self.phasors.n] - found.elasticity)
        squares = [np.outer(shift, shift) for shift in shifts[1:] or shifts]
        return np.asarray(np.mean(squares, axis=0))
