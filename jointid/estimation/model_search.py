"""Search for a model: fits from start values within limits of time, their scores, and pruning."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from jointid.errors import JointIdError
from jointid.estimation.candidates import CHANCE, EXPLAINED, NEEDED, Fits, Model, fundamental_chance
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.levenberg_marquardt import LOST
from jointid.estimation.estimators.linear_fit import without_inertias
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import FILTERS, FRICTION_EFFECTS, GEAR_LAWS, Parameters
from jointid.estimation.estimators.score_tests import Score, scores_with_changes
from jointid.estimation.model_fits import completed, filters_before_friction, fit_model, model_waveforms
from jointid.estimation.start_values import by_regression, other_laws, with_delay, with_one_bend
from jointid.motion.friction import FrictionWaveforms
from jointid.motion.per_turn import PerTurn
from jointid.phasors.extract import MANY_HARMONICS, Phasors

DOUBTFUL = 3.0
"""Misfit from which a model is fitted from other start values, too."""
PROMISING, _SOME = 0.5, 0.15
"""Score over the cost from which a part is fitted if no model explains the data, also together with a
law: the first for most parts; the second for a delay, which rotates the phase far, for presliding, whose
angle may be far from its start, and for another law (0.19 with heavy rotors)."""
POOR = 10.0
"""Misfit of a model that does not explain the data."""
_MOST_EFFECTS = 3
_LITTLE = 1 / 3
"""Residual over the torques from which two laws of the gears do not explain them: up to 0.3 where one of
them is fitted; 0.35 to 4 with wrong signs, units and columns."""
_SAME_COST = 4.0
"""Largest decrease of the cost by a superfluous change of slope."""
_REGRESSED = {"cubic": 1.0, "backlash": 1.0, "piecewise": 2.0}
"""Laws with a regression of the deflection, and factors on the squares that they leave: slopes imitate
the others."""
_EXPLAINED_MOTIONS = 1.3
"""Misfit of motions below which richer friction and laws are not tried: their noise is that of the
residual, and wide reversals leave few equations."""
_FEW = 10
"""Records per joint in which models are sought where the simple ones are far from the data."""
_MOST_FITS, _MOST_NEAR_FITS, _MOST_STARTS = 24, 48, 2
"""Fits of one search, far from the data and near them, and start values from which a model is fitted."""
_MOST_SLOW_FITS, _MOST_SLOW_FITS_OF_MOTIONS, _MOST_LAWS_OF_MOTIONS = 12, 9, 4
"""Fits with a law of the gears that compare models; all such fits where the records hold motions, and
the sets of laws that they compare."""


@dataclass
class Search:
    """Models fitted to the same records from one start."""

    phasors: Phasors
    prior: InertiaPrior
    start: Parameters
    noise: Noise
    base: Model
    """Parts that every model has."""
    fits: Fits
    first: tuple[Model, ...] = ()
    """Models of an earlier search, whose noise motions then have; that of the start values first."""
    rejected: tuple[Model, ...] = ()
    """Models with a law of the gears that it fitted and found far from its choice."""
    is_repeated: bool = False
    """Whether an earlier search compared models of the same records."""
    most: float = np.inf
    """Misfit above which a model is not considered."""
    far: float = np.inf
    """Misfit of the first models from which ``gives_up`` is asked."""
    gives_up: Callable[[], bool] = bool
    gives_up_late: Callable[[], bool] = bool
    """Whether the search ends where the first models, and those with a law of the gears, are far off."""
    starts: dict[Model, int] = field(default_factory=dict)
    """Number of start values from which each model was fitted."""
    slow_fits: int = 0
    laws: list[list[str]] = field(default_factory=list)
    """Laws of the gears in these fits; of motions, other parts with the same laws do not count."""
    has_two_laws: bool = False
    """Whether two laws of the gears were fitted at once; a second time would give the same."""
    may_be_periodic: bool = False
    """Whether effects of the motors' positions are sought."""
    regressed: set[tuple[str, Model]] = field(default_factory=set)
    """Models that were fitted from the regression of a law."""
    _waveforms: dict[tuple[float | None, ...], FrictionWaveforms | None] = field(default_factory=dict)
    _scores: dict[Model, tuple[LikelihoodEstimate, dict[str, Score]]] = field(default_factory=dict)
    """Scores with the estimate at which they were evaluated."""

    def add_per_turn(self, effect: PerTurn) -> None:
        """Make a periodic effect of the motors' positions one of the optional parts of all models."""

        def of(model: Model) -> Model:
            return replace(model, per_turn=(*model.per_turn, effect))

        self.base, self.fits.optional = of(self.base), (*self.fits.optional, effect.effect)
        self.fits.tried = {of(model): found for model, found in self.fits.tried.items()}
        self.starts = {of(model): count for model, count in self.starts.items()}
        self._scores.clear()

    def again(self, start: Parameters) -> Search:
        """The same search from another start."""
        fits = replace(self.fits, tried={})
        return replace(self, start=start, fits=fits, starts={}, slow_fits=0, laws=[], has_two_laws=False)

    @property
    def has_motions(self) -> bool:
        """Whether there is a motion record."""
        return bool(self.phasors.motion.any())

    @property
    def is_distorted(self) -> bool:
        """Whether the harmonics of sines exceed the noise, as nonlinear laws make them."""
        return bool(self.phasors.harmonics.shape[1] >= MANY_HARMONICS)

    @property
    def may_have_friction(self) -> bool:
        """Whether a model may have friction of sines."""
        friction = self.base.reversal is not None or "friction" in self.fits.optional
        return friction and not self.has_motions

    @property
    def is_lost(self) -> bool:
        """Whether no model comes near the data."""
        return not self.fits.least_misfit < LOST

    @property
    def explains_little(self) -> bool:
        """Whether even the nearest model leaves more of the torques of sines than gear laws explain."""
        if self.has_motions or not self.fits.tried:
            return False
        found = self.fits.estimate(min(self.fits.tried, key=self.fits.misfit))
        if found is None:
            return False
        n = self.phasors.n
        variance = np.diagonal(self.phasors.harmonic_covariance, axis1=2, axis2=3)[..., n:].real
        power = np.abs(self.phasors.harmonics[..., n:]) ** 2
        signal = np.divide(power, variance, out=np.zeros_like(power), where=variance > 0)
        return bool(found.cost > _LITTLE**2 * signal.sum())

    def has_sought_friction(self, model: Model) -> bool:
        """Whether friction that a model has was fitted with free reversals."""
        return model.reversal is None or any(each.reversal for each in self.fits.tried)

    @property
    def is_spent(self) -> bool:
        """Whether the search ends: wrong data would take many fits."""
        most = _MOST_NEAR_FITS if self.fits.least_misfit < DOUBTFUL else _MOST_FITS
        return sum(self.starts.values()) >= most

    def is_open(self, model: Model) -> bool:
        """Whether a model was not fitted, or did not converge from its only start values."""
        return self.fits.misfit(model) >= LOST and self.may_start_again(model)

    def may_start_again(self, model: Model) -> bool:
        """Whether a model may be fitted from further start values."""
        return self.starts.get(model, 0) < _MOST_STARTS

    def may_be_richer(self, found: LikelihoodEstimate) -> bool:
        """Whether richer friction, or a law of the gears, may lower the cost noticeably."""
        if self.has_motions:
            return found.misfit > _EXPLAINED_MOTIONS
        return found.misfit > EXPLAINED or fundamental_chance(found) < CHANCE

    @cached_property
    def regressed_laws(self) -> list[tuple[str, Parameters, float]]:
        """Laws of the gears with start values by regression, and the squares left, the fewest first."""
        found = []
        for law, factor in _REGRESSED.items():
            regressed = by_regression(law, self.phasors, self.prior)
            if regressed and ("cubic" if law == "piecewise" else law) in self.fits.optional:
                found.append((law, regressed[0], factor * regressed[1]))
        return sorted(found, key=lambda each: each[2])

    def may_explain(self, model: Model, part: str) -> bool:
        """Whether a fit with one more part is worth its time; slow ones far from the data rarely are."""
        found, is_slow = self.fits.estimate(model), model.with_part(part).is_slow
        if found is None or found.misfit < LOST or not (is_slow or self.has_motions):
            return True
        less = "delay", "lag", "motor_presliding", *FILTERS, *GEAR_LAWS
        least = _SOME if part in less else PROMISING
        score = self.scores(model).get(part)  # none if the estimate is too far off
        return score is not None and score.gain > least * found.cost

    def of_rows(self, rows: np.ndarray) -> Search:
        """The same search in some rows."""
        noise, fits = self.noise, self.fits
        fewer = rows.size / len(noise.covariance)
        return Search(
            self.phasors.select(rows),
            self.prior.of_rows(rows),
            self.start,
            noise.select(rows),
            self.base,
            Fits(fits.optional, int(fits.rows * fewer), levels=round(fits.levels * fewer)),
            self.first,
            gives_up_late=self.gives_up_late,
        )

    def few_rows(self, per_joint: int = _FEW) -> np.ndarray:
        """Rows of sines of evenly spread frequencies around one pose, if there are half as many more."""
        every, most = np.arange(self.phasors.omega.size), per_joint * self.phasors.n
        if self.has_motions or len(self.prior.M2) > 1 or 2 * every.size < 3 * most:
            return every
        groups = [group for _, group in self.phasors.by_frequency()]
        place = np.linspace(0, len(groups) - 1, max(2, len(groups) * most // every.size))
        return np.sort(np.concatenate([groups[k] for k in np.unique(place.round().astype(int))]))

    def free_start(self) -> tuple[Parameters, ...]:
        """Start values without uncertain inertias, if the records give any."""
        start = without_inertias(self.phasors, self.prior) if self.prior.inertia_std else None
        return () if start is None else (start,)

    def fit(
        self, model: Model, start: Parameters, *, compares: bool = True, is_limited: bool = True
    ) -> None:
        """Fit a model; of two fits from different starts the better one stays.

        The number of fits with a law is limited where they compare models, not where they seek a start.
        """
        tried, earlier = self.fits.tried, self.fits.estimate(model)
        if model in self.rejected:
            tried.setdefault(model, JointIdError("Not fitted: some segments contradict it."))
            return
        self.starts[model] = self.starts.get(model, 0) + 1
        laws = [law for law in GEAR_LAWS if law in model.effects]
        if model.is_slow and (compares or self.has_motions):
            others = self.has_motions and compares and laws not in self.laws
            most = _MOST_SLOW_FITS_OF_MOTIONS if self.has_motions else _MOST_SLOW_FITS
            is_last = laws == ["piecewise"] and others  # in place of a cubic law: K may differ much
            if (is_limited and not is_last) and (
                self.slow_fits >= most or (others and len(self.laws) >= _MOST_LAWS_OF_MOTIONS)
            ):
                tried.setdefault(
                    model, JointIdError("Not fitted: the limit on fits of gear laws is reached.")
                )
                return
            self.slow_fits += 1
            self.laws += [laws] * others
        try:
            waveforms = self.waveforms(model, start)
            estimate = fit_model(self.phasors, self.prior, start, self.noise, model, waveforms)
            # A loop without width at one joint hardly affects the fit.
            doubtful = EXPLAINED if "hysteresis" in model.effects else DOUBTFUL
            for is_near, bound in ((False, np.inf), (True, POOR)):
                for other in other_laws(
                    self.phasors, self.prior, start, estimate.named, is_near=is_near
                ):
                    if doubtful < estimate.misfit <= bound:
                        estimate = self._better(estimate, model, other, waveforms)
            has_law = model.is_slow and not self.has_motions
            for law, other, _ in self.regressed_laws if has_law else ():
                is_new = law in model.effects and (law, model) not in self.regressed
                if is_new and (other is start or DOUBTFUL < estimate.misfit <= LOST):
                    self.regressed.add((law, model))
                    if other is not start:
                        estimate = self._better(estimate, model, other, waveforms)
            apart = with_one_bend(estimate.named)
            if apart is not None and estimate.misfit < DOUBTFUL:
                estimate = self._better(estimate, model, apart, waveforms, _SAME_COST)
            if estimate.misfit < DOUBTFUL and model.imitates_other_law(estimate):
                raise JointIdError("Its slopes are those of backlash or hysteresis.")
        except JointIdError as error:
            tried.setdefault(model, error)
            return
        if earlier is None or estimate.whole_cost(1) <= earlier.whole_cost(1):
            tried[model] = estimate

    def _better(
        self,
        estimate: LikelihoodEstimate,
        model: Model,
        start: Parameters,
        waveforms: FrictionWaveforms | None,
        most: float = 0.0,
    ) -> LikelihoodEstimate:
        """The estimate, or that from another start whose cost is higher by less than ``most``."""
        try:
            other = fit_model(self.phasors, self.prior, start, self.noise, model, waveforms)
        except JointIdError:
            return estimate
        return other if other.whole_cost(1) < estimate.whole_cost(1) + most else estimate

    def waveforms(self, model: Model, p: Parameters) -> FrictionWaveforms | None:
        """Friction waveforms of a model at some parameters."""
        filters = filters_before_friction(model, p)
        key = model.reversal, model.curve, *(() if filters is None else filters.tolist())
        if key not in self._waveforms:
            self._waveforms[key] = model_waveforms(self.phasors, model, p)
        return self._waveforms[key]

    def completed_waveforms(
        self, model: Model, p: Parameters, parts: Sequence[str]
    ) -> FrictionWaveforms | None:
        """The same with those that follow from the gear torque at these parameters."""
        waveforms = self.waveforms(model, p)
        return completed(waveforms, model, self.phasors, self.prior, p, parts)

    @staticmethod
    def is_full(model: Model) -> bool:
        """Whether a model has all the effects that it may have; viscous friction counts as friction."""
        return len(set(model.effects) - {"viscous"}) >= _MOST_EFFECTS

    def scores(self, model: Model) -> dict[str, Score]:
        """Score of every optional part that the model lacks."""
        found = self.fits.estimate(model)
        # Unmodelled Coulomb friction looks like them, and friction contains the viscous one.
        never = FRICTION_EFFECTS if model.reversal is None else ("viscous",)
        absent = [part for part in self.fits.optional if part not in (*model.parts, *never)]
        if found is None or not absent:
            return {}
        if model not in self._scores or self._scores[model][0] is not found:
            sliding = replace(model, reversal=0.0) if "friction" in absent else model
            waveforms = self.completed_waveforms(sliding, found.named, (*model.parts, *absent))
            of_each = scores_with_changes(self.phasors, self.prior, found, waveforms, self.noise, absent)
            self.fits.optional = (*self.fits.optional, *(part for part in of_each if part not in absent))
            self._scores[model] = found, of_each
        return self._scores[model][1]

    def pruned(self, model: Model) -> Model:
        """The best of a model and of those without its uncertain parts.

        One that explains the data is pruned beyond the limit on fits: an uncertain part excludes it.
        """
        fits, found = self.fits, self.fits.estimate(model)
        if found is None:
            return model
        models = [model, *self._narrower(model)]
        for narrow in models[1:]:
            far = fits.misfit(narrow) > NEEDED * max(1.0, found.misfit)
            if far and self.may_start_again(narrow) and not fits.is_behind(narrow, model):
                # From other starts it may have diverged.
                self.fit(narrow, with_delay(found.named), is_limited=found.misfit > EXPLAINED)
        best = fits.least([each for each in models if each in fits.tried])
        return best if best == model else self.pruned(best)

    def _narrower(self, model: Model) -> Iterator[Model]:
        """The model without each part that is not certain, and with a delay in place of others."""
        for part in model.parts:
            if part in self.fits.optional:
                if part == "friction" and not self.fits.is_certain(model, "coulomb"):
                    yield model.with_part("viscous")
                if not self.fits.is_certain(model, part):
                    yield model.without(part)
                if part in ("lag", *FILTERS) and "delay" in self.fits.optional:  # one common delay
                    yield model.replacing(part, "delay")
