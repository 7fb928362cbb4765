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
from jointid.estimation.linear_fit import friction_start
from jointid.estimation.noise import Noise
from jointid.estimation.parameters import Block, ParameterLayout, Parameters
from jointid.estimation.residual import make_problem
from jointid.estimation.start_values import at_resonances, without_inertias
from jointid.estimation.whitened_residual import WhitenedResidual
from jointid.joints import Inertia
from jointid.motion.end_terms import motor_motion
from jointid.phasors.extract import MANY_HARMONICS, Phasors

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
_DOUBTFUL = 3.0
"""Misfit from which the simplest model is fitted from start values without the given inertias, too."""
_FAR = 1e4
"""Misfit of one friction model from which a richer one from the same start does not converge either."""
_WORTH = 0.2
"""Share of the misfit beyond 1 that a part must explain where the model leaves more than noise: every
wrong part explains something."""
_CHANCE = 1e-3
"""Probability that the score of any part leads to a fit on an ideal robot."""
_ALIKE = 1.2
"""Ratio of misfits up to which another width of the reversals explains motions as well."""
_OTHER_REVERSALS = {0.0: (0.03,), 0.03: (0.0, 0.1), 0.1: (0.03,)}
"""The next narrower and wider reversals of each one."""
_SIMILAR = 0.3
"""Score over the highest from which a part is fitted: similar parts differ by the cost only."""
_DECISIVE = 0.3
"""Score over the cost from which a part is fitted before richer friction."""
_TRIED, _TRIED_LAWS = 5, 2
"""The most parts, and nonlinear laws among them, that are fitted for each one added."""
_HOPELESS = 3e4
"""Misfit of wrong units, signs or gear ratios, of which no law explains a decisive share."""
_MOST_EFFECTS = 3
_MOST_FITS, _MOST_POOR_FITS, _POOR = 24, 16, 10.0
"""Fits of one search, and the same while the misfit is poor; wrong data would take many more."""
_DOUBT, _DOUBT_IF_FAR = 0.005, 0.05
"""Probability that the score of any part widens the error bars on an ideal robot, and the same if it
moves K or D far, which few parts do."""
_FAR_OFF = 4.0
"""Standard errors that are far."""
_OCCAM = 1 / 20
"""Weight of a model, over the best, from which it explains the data as well."""
_BENT = 4.0
"""Standard deviations of the misfit from which three slopes are fitted in place of a cubic law."""
_FAR_LAWS, _ROUGH = ("cubic", "backlash", "hysteresis"), 0.1
"""Laws that are fitted where the linear fit is lost; at their start damping over stiffness, and
hysteresis over the largest torque and deflection."""
_HALFWAY = 0.25
"""Share of what a part must explain to be kept from which its score leads to a slow fit."""
_USUAL = 0.05
"""Probability of a misfit of the fundamentals that calls for no slow fit."""
_MOST_STARTS = 2
"""Start values from which a model is fitted."""
_MANY_ROWS = 20_000
"""Equations, those of six joints in 50 records, from which one part is tried where the model explains
the data: a fit takes seconds."""
_MOST_SLOW_FITS = 8
"""Fits with a law of the gears."""
_MOST_SLOW_FITS_OF_MOTIONS = 3
"""The same where the records hold motions."""
_BEND = 4.0
"""Largest ratio of two slopes of a gear; catalogues have up to 2."""
_CERTAIN = 200.0
"""Squared parameter over its variance from which a model without it need not be fitted."""


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
    """
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    linear = start if isinstance(start, Parameters) else ParameterLayout.of(phasors.n).named(start)
    optional: list[str] = []
    if not exactly:
        effects = [name for name in EFFECTS if gear == "auto" or name not in GEAR_LAWS]
        effects = [name for name in effects if name != "piecewise"]  # in place of a cubic law
        if np.any(phasors.drift):  # a superposed motion that does not reverse
            effects.remove("motor_presliding")
        if phasors.motion.any():
            effects = [name for name in effects if name in GEAR_LAWS or name not in LAWS]
        optional = ["friction"] * (not friction) + ["delay"] * (not delay) + effects
    base = Model(0.0 if friction else None, delay)
    search = _Search(phasors, prior, linear, noise, base, tuple(optional))
    if (friction or "friction" in optional) and not phasors.motion.any():
        rubbing = friction_start(phasors, prior, linear)
        if rubbing is not None:
            search = replace(search, start=rubbing)
    return _searched(search)


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
    for start in (*search.free_start(), *at_resonances(search.phasors, search.prior)):
        other = replace(search, start=start, tried={}, fits={}, slow_fits=0)
        other.fit(probe, start)
        if other.misfit(probe) < better:
            found = other.best()
            if other.misfit(found) < good:
                return other.choice(found)
    return search.choice(best)


def _is_slow(model: Model) -> bool:
    return not set(GEAR_LAWS).isdisjoint(model.effects)


def model_waveforms(phasors: Phasors, model: Model) -> FrictionWaveforms | None:
    """Friction waveforms of a model; None without friction."""
    if model.reversal is None:
        return None
    return friction_waveforms(phasors, model.reversal, curve=model.curve)


def fit_model(
    phasors: Phasors,
    prior: InertiaPrior,
    start: Floats | Parameters,
    noise: Noise,
    model: Model,
    waveforms: FrictionWaveforms | None = None,
) -> LikelihoodEstimate:
    """Fit one model; its friction waveforms may be given."""
    return maximum_likelihood(
        phasors,
        prior,
        start,
        friction=waveforms or model_waveforms(phasors, model),
        delay=model.delay,
        effects=model.effects,
        noise=noise,
    )


def evaluated(
    phasors: Phasors,
    prior: InertiaPrior,
    model: Model,
    estimate: LikelihoodEstimate,
    noise: Noise,
    scale: Floats,
) -> WhitenedResidual:
    """Residual of a model at its estimate; ``scale`` multiplies the variances as in a fit."""
    waveforms = model_waveforms(phasors, model)
    problem = make_problem(phasors, prior, estimate.layout, estimate.named.K, waveforms, noise)
    return WhitenedResidual.of(replace(problem, motion=motor_motion(phasors)), estimate.p, scale)


def _by_motion(phasors: Phasors, prior: InertiaPrior) -> Parameters:
    """K and D from torque over deflection by the given inertias, which wrong ones spoil less.

    The deflection is the difference of motor and arm angle: a record counts by the inverse of the arm's.
    """
    s = 1j * phasors.omega[:, None]
    torque = phasors.tau - s**2 * prior.M[prior.rotor] * phasors.q
    arm = np.linalg.solve(prior.M2[prior.pose], torque[..., None])[..., 0] / s**2
    arm = np.where(torque == 0, 1.0, arm)
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
    waveforms: dict[tuple[float | None, bool], FrictionWaveforms | None] = field(default_factory=dict)
    fits: dict[Model, int] = field(default_factory=dict)
    """Number of start values from which each model was fitted."""
    slow_fits: int = 0

    def best(self) -> Model:
        """Grow and prune from the base, or from the best model that is fitted already."""
        rubbing = replace(self.base, reversal=0.0)
        if "coulomb" in self.start.layout and rubbing not in self.tried:
            self.fit(rubbing, self.start)
            rough = self.tried[rubbing]
            if isinstance(rough, LikelihoodEstimate) and rough.misfit > _EXPLAINED:
                self.fit(replace(self.base, reversal=0.03), rough.named)
        else:
            self.fit(self.base, self.start)
            if self.misfit(self.base) > _DOUBTFUL and self.phasors.harmonics.shape[1] < MANY_HARMONICS:
                for start in self.free_start():  # wrong inertias may lead the linear estimate astray
                    self.fit(self.base, start)
            if self.misfit(self.base) >= _LOST and "friction" in self.optional:
                self.fit(rubbing, self.start)  # heavy friction leads the plain fit astray
        far = () if self.phasors.motion.any() else _FAR_LAWS
        for law in far:  # and so does a gear that is far from linear
            if min(self.misfit(m) for m in self.tried) >= _LOST and law in self.optional:
                self.fit(self.base.with_part(law), _by_motion(self.phasors, self.prior))
        best = self._least(list(self.tried))
        if "coulomb" in self.start.layout:  # the start may have friction that the records do not need
            best = self._pruned(best)
        while len(self.tried) < self._most_fits(best):
            found = [best]
            for wider in sorted(self._extensions(best), key=_is_slow):
                leading = self._least(found)
                explained = self.misfit(leading) < _EXPLAINED < self.misfit(best)
                if explained and not {*wider.effects}.difference(best.effects).isdisjoint(LAWS):
                    continue
                if len(self.tried) >= self._most_fits(leading):
                    break
                if _is_slow(wider) and leading != best and self._is_explained(leading):
                    continue  # its score decides again
                if leading.reversal != best.reversal and wider.reversal == best.reversal:
                    continue  # richer friction first: other parts absorb some of it
                self._fit_wider(wider, best, leading)
                found.append(self._pruned(wider) if self._is_kept(wider, best) else wider)
            better = self._least(found)
            if better == best:
                break
            best = better
        return best

    def _most_fits(self, best: Model) -> int:
        return _MOST_POOR_FITS if self.misfit(best) > _POOR else _MOST_FITS

    def free_start(self) -> tuple[Parameters, ...]:
        """Start values without uncertain inertias, if the records give any."""
        start = without_inertias(self.phasors, self.prior) if self.prior.inertia_std else None
        return () if start is None else (start,)

    def fit(self, model: Model, start: Parameters) -> None:
        """Fit a model; of two fits from different starts the better one stays."""
        earlier = self.tried.get(model)
        self.fits[model] = self.fits.get(model, 0) + 1
        if _is_slow(model):
            motions = bool(self.phasors.motion.any())
            if self.slow_fits == (_MOST_SLOW_FITS_OF_MOTIONS if motions else _MOST_SLOW_FITS):
                self.tried.setdefault(model, JointIdError("Not fitted: enough laws were tried."))
                return
            self.slow_fits += 1
        try:
            waveforms = self._waveforms(model)
            estimate = fit_model(self.phasors, self.prior, start, self.noise, model, waveforms)
        except JointIdError as error:
            self.tried.setdefault(model, error)
            return
        worse = isinstance(earlier, LikelihoodEstimate) and earlier.whole_cost(1) < estimate.whole_cost(
            1
        )
        if not worse:
            self.tried[model] = estimate

    def _is_kept(self, wider: Model, narrow: Model) -> bool:
        """Whether a wider model may last; a slow one with a part that is not significant does not."""
        estimate = self.tried[wider]
        if isinstance(estimate, JointIdError) or not _is_slow(wider):
            return True
        added = [part for part in wider.parts if part not in narrow.parts and part in self.optional]
        return all(self._part_is_significant(wider, estimate, part) for part in added)

    def _fit_wider(self, wider: Model, narrow: Model, leading: Model) -> None:
        """Fit with one more part, from the estimate without it.

        Where that is far off, the fit starts from that of the same parts with other friction, or else
        as all do.
        """
        if wider in self.tried:
            return
        found = self.tried[narrow]
        if self.misfit(narrow) >= _LOST:
            near, start = self.tried[leading], self.start
            if isinstance(near, LikelihoodEstimate) and leading.parts == wider.parts:
                start = near.named if near.misfit < _LOST else start
            self.fit(wider, start)
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
        tried_laws = 1 if self._is_explained(model) else _TRIED_LAWS
        least = _DECISIVE * found.cost if found.misfit > _HOPELESS else 0.0
        laws = [part for part in clear if part in LAWS and scored[part].gain > least][:tried_laws]
        tried = _TRIED if self.rows < _MANY_ROWS or found.misfit > _EXPLAINED else 1
        wider = [
            model.with_part(part)
            for part in clear
            if (part in laws or part not in LAWS) and self._is_promising(model, part, scored[part])
        ][:tried]
        if model.reversal is not None and found.misfit > _EXPLAINED:
            richer = _RICHER.get((model.reversal, model.curve), ())
            sharper = [replace(model, reversal=reversal, curve=curve) for reversal, curve in richer]
            decisive = bool(clear) and scored[clear[0]].gain > _DECISIVE * found.cost
            wider = [*wider, *sharper] if decisive else [*sharper, *wider]
        if "cubic" in model.effects and max(found.misfit, found.fundamental[0]) > 1 + _BENT / np.sqrt(
            max(found.expected_cost, 1.0)
        ):
            plain = model.without("cubic")
            laws_instead = ["piecewise"] if "backlash" in model.parts else ["backlash", "piecewise"]
            wider = [*(plain.with_part(law) for law in laws_instead), *wider]
        return [each for each in wider if each not in self.tried]

    def _is_promising(self, model: Model, part: str, score: Score) -> bool:
        """Whether a slow fit with one more part is worth its time, by the part's score.

        It is not where the part cannot explain enough of the misfit to be kept, nor where the model
        explains the data without it and K and D would hardly move. Its score still widens the errors.
        """
        found = self.tried[model]
        if isinstance(found, JointIdError) or not _is_slow(model.with_part(part)):
            return True
        if part != "friction" and found.misfit > _EXPLAINED:
            needed = _WORTH * (found.misfit - 1) * found.expected_cost
            return score.gain > _HALFWAY * needed
        sigma = np.sqrt(np.diag(found.elasticity_covariance))
        return not self._is_explained(model) or bool(np.any(np.abs(score.shift) > sigma))

    def _is_explained(self, model: Model) -> bool:
        """Whether noise explains what a model leaves, at the fundamentals as well."""
        found = self.tried[model]
        if isinstance(found, JointIdError) or found.misfit > _EXPLAINED:
            return False
        misfit, freedom = found.fundamental
        return bool(chi2.sf(misfit * freedom, freedom) > _USUAL)

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
                far = self.misfit(narrow) > _NEEDED * max(1.0, found.misfit)
                if far and self.fits.get(narrow, 0) < _MOST_STARTS:
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
        key = model.reversal, model.curve
        if key not in self.waveforms:
            self.waveforms[key] = model_waveforms(self.phasors, model)
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
            if part in (*self.optional, "piecewise")
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
        return bool(clear.any()) or (simpler is not None and simpler.misfit > _NEEDED * own)

    def choice(self, best: Model) -> Choice:
        """The best model with the candidates, and how far others that explain the data differ."""
        criterion = self.criterion()
        candidates = [
            self._candidate(model, criterion[model], model == best)
            for model in sorted(self.tried, key=lambda model: criterion[model])
        ]
        spread = self._spread(best) + self._spread_of_reversals(best)
        return Choice(best, self.tried[best], tuple(candidates), spread)

    def _spread_of_reversals(self, best: Model) -> Floats:
        """Mean square change of K and D with other reversals of the friction, shape (2n, 2n).

        Motions pass their reversals at all speeds: no one width of a reversal is right for all.
        """
        found, shifts = self.tried[best], [np.zeros(2 * self.phasors.n)]
        if isinstance(found, JointIdError) or best.reversal is None or not self.phasors.motion.any():
            return np.zeros((2 * self.phasors.n,) * 2)
        for reversal in _OTHER_REVERSALS[best.reversal]:
            other = replace(best, reversal=reversal)
            if other not in self.tried:
                self.fit(other, found.named)
            estimate = self.tried[other]
            if isinstance(estimate, LikelihoodEstimate) and estimate.misfit < _ALIKE * found.misfit:
                shifts.append(estimate.elasticity - found.elasticity)
        squares = [np.outer(shift, shift) for shift in shifts[1:] or shifts]
        return np.asarray(np.mean(squares, axis=0))

    def _spread(self, best: Model) -> Floats:
        """Covariance of K and D by the choice between models, shape (2n, 2n).

        The weight of a model is exp(−½ difference of the criterion) to the best. Unlikely ones are left
        out (Occam's window; Madigan and Raftery, Journal of the American Statistical Association 89,
        1994). A part that was not fitted counts in full where its score is nearly significant, sooner
        where it would move K or D far: with uncertain inertias, a part that the records hardly show may.
        """
        found = self.tried[best]
        size = 2 * self.phasors.n
        if isinstance(found, JointIdError):
            return np.zeros((size, size))
        criterion, shifts, misfit = self.criterion(), [], max(1.0, found.misfit)
        sigma = np.sqrt(np.diag(found.elasticity_covariance))

        def is_doubtful(gain: float, count: int, shift: Floats) -> bool:
            doubt = _DOUBT_IF_FAR if np.any(np.abs(shift) > _FAR_OFF * sigma) else _DOUBT
            return bool(2 * gain > chi2.isf(doubt / max(len(self.optional), 1), count))

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
        for part, score in self.scores(best).items():
            gain, shift = score.possible
            if best.with_part(part) not in self.tried and is_doubtful(gain / misfit, score.count, shift):
                shifts.append((1.0, shift))
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
            parts=model.parts,
        )
