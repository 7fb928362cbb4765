"""Which model the data ask for: elasticity alone, or with friction, with a delay, with both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jointid.arrays import Floats
from jointid.candidates import Candidate, Choice, Model
from jointid.errors import JointIdError
from jointid.friction import FrictionWaveforms, friction_waveforms
from jointid.joints import Inertia
from jointid.likelihood import LikelihoodEstimate, gain_of_delay, maximum_likelihood
from jointid.noise import Noise
from jointid.phasors import Phasors
from jointid.springs import inertia_arrays

NO_FRICTION = (None, False)
FRICTIONS = ((0.0, False), (0.03, False), (0.1, False), (0.03, True), (0.1, True))
"""Forms of friction from plain to rich: below which share of the largest velocity it is left free, from
a sharp to a blunt reversal; and whether it may change with speed beyond its viscous part."""

_EXPLAINED = 1.1  # cost over its expectation below which a richer model could hardly do better
_CLEAR = 5.0  # standard errors that friction and delay must stand clear of nothing
_WORTH_A_FIT = 1.0  # gain in cost that a lag must promise; to be taken it needs ln(rows)/2, about 4
_NEEDED = 3.0  # ratio of misfits that shows a part to be needed, whatever its error
_LOST = 100.0  # misfit from which on the search is begun again elsewhere
_FAR = 1e4  # misfit of one friction's form from which on a richer one leads nowhere either
_BEYOND_DOUBT = 1000.0  # squared distance of friction from nothing, in its errors: far beyond _CLEAR


def choose_model(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    start: Floats,
    noise: Noise,
    *,
    friction: bool,
    delay: bool,
    exactly: bool = False,
) -> Choice:
    """Go from few parts to many, no further than the noise asks for, and take the best.

    Parameters
    ----------
    friction, delay : bool
        Parts that must be in the model; the others may be.
    exactly : bool
        The others must not; of friction only the form of its reversals is chosen.
    """
    frictions = FRICTIONS if friction else (NO_FRICTION,) if exactly else (NO_FRICTION, *FRICTIONS)
    lags = (delay,) if delay or exactly else (False, True)
    return _widened(_Search(phasors, inertia, start, noise, frictions, lags))


def _widened(search: _Search) -> Choice:
    """Search from the linear estimate, and where that leads nowhere, from elsewhere too.

    Heavy friction can turn the linear estimate negative, or throw it into another valley.
    """
    best = search.widen()
    misfit = search.misfit(best)
    if misfit < _LOST:
        return search.choice(best)
    better = min(misfit / 10, _FAR)
    good = _LOST if np.isinf(misfit) else min(misfit / 3, max(_LOST, misfit / _LOST))
    probe = Model(search.frictions[:3][-1][0], search.lags[-1])
    for start in _other_starts(search.phasors, search.inertia):
        other = replace(search, start=start, tried={})
        other.fit(probe)
        if other.misfit(probe) < better:
            found = other.widen()
            if other.misfit(found) < good:
                return other.choice(found)
    return search.choice(best)


def _other_starts(phasors: Phasors, inertia: Inertia | Sequence[Inertia]) -> list[Floats]:
    """K that puts each arm's inertia at resonance within the frequencies of the records, D small."""
    _, arm = inertia_arrays(phasors, inertia)
    own = np.diagonal(np.linalg.inv(arm), axis1=1, axis2=2).mean(axis=0)  # M2jj, kg·m²
    starts = []
    for share in (0.5, 1.0, 0.0):
        omega = float(np.quantile(phasors.omega, share))
        K = own * omega**2
        starts.append(np.concatenate([K, 0.05 * K / omega]))
    return starts


@dataclass
class _Search:
    """The models tried so far, with their estimates."""

    phasors: Phasors
    inertia: Inertia | Sequence[Inertia]
    start: Floats
    noise: Noise
    frictions: Sequence[tuple[float | None, bool]]
    lags: Sequence[bool]
    tried: dict[Model, LikelihoodEstimate | JointIdError] = field(default_factory=dict)
    waveforms: dict[tuple[float, bool], FrictionWaveforms] = field(default_factory=dict)

    def fit(self, model: Model) -> None:
        if model in self.tried:
            return
        if (problem := self._pointless(model)) is not None:
            self.tried[model] = problem
            return
        self.tried[model] = self._fitted(model, self._begin(model))

    def _fitted(self, model: Model, start: Floats) -> LikelihoodEstimate | JointIdError:
        try:
            return maximum_likelihood(
                self.phasors,
                self.inertia,
                start,
                friction=self._waveforms(model.reversal, model.curve),
                delay=model.delay,
                noise=self.noise,
            )
        except JointIdError as error:
            return error

    def _pointless(self, model: Model) -> JointIdError | None:
        """Say so where a fit could not be the best."""
        if self._hopeless(model):
            return JointIdError("Not fitted: there is friction beyond doubt.")
        if not model.delay:
            return None
        without = self.tried.get(replace(model, delay=False))
        if False not in self.lags or not isinstance(without, LikelihoodEstimate):
            return None
        gain = gain_of_delay(
            self.phasors,
            self.inertia,
            without,
            self._waveforms(model.reversal, model.curve),
            self.noise,
        )
        if gain / max(1.0, _misfit(without)) > _WORTH_A_FIT:
            return None
        return JointIdError("Not fitted: the data show no lag of the torque.")

    def _hopeless(self, model: Model) -> bool:
        """Whether it lacks friction where the same with friction shows Coulomb's beyond doubt.

        The cost would rise by half the square of friction's distance from nothing in its errors.
        """
        rubbing = self.tried.get(Model(0.0, model.delay))
        if isinstance(rubbing, JointIdError):  # with friction no lag is to be seen
            rubbing = self.tried.get(Model(0.0, False))
        if model.reversal is not None or not isinstance(rubbing, LikelihoodEstimate):
            return False
        coulomb = slice(2 * self.phasors.n, 3 * self.phasors.n)
        force, variance = rubbing.p[coulomb], np.diag(rubbing.covariance)[coulomb]
        clear = force**2 > _BEYOND_DOUBT * variance
        return bool(np.any(clear & (force > 0) & (variance > 0)))

    def _waveforms(self, reversal: float | None, curve: bool) -> FrictionWaveforms | None:
        if reversal is None:
            return None
        if (reversal, curve) not in self.waveforms:
            self.waveforms[reversal, curve] = friction_waveforms(self.phasors, reversal, curve=curve)
        return self.waveforms[reversal, curve]

    def best(self, models: Sequence[Model]) -> Model:
        # Without friction comes last: where friction turns out to be certain, it need not be fitted.
        for model in sorted(models, key=lambda model: model.reversal is None):
            self.fit(model)
        criterion = self._criterion()
        return min(models, key=lambda model: criterion[model])

    def widen(self) -> Model:
        """Try friction in ever richer forms until the noise is all that is left."""
        models: list[Model] = []
        for reversal, curve in self.frictions:
            models += [Model(reversal, lag, curve) for lag in self.lags]
            if reversal is None and len(self.frictions) > 1:
                continue  # whether there is friction is seen by fitting it
            if reversal is not None:
                # From a linear start friction and delay together may end in a minimum that is none.
                self.fit(Model(reversal, False, curve))
            best = self.best(models)
            if self.explains(best):
                break
        return self.plainer(best, models)

    def plainer(self, best: Model, models: Sequence[Model]) -> Model:
        """Fit again without friction from what was found with it: alone it may have gone astray."""
        plain, found = Model(None, best.delay), self.tried[best]
        if best == plain or plain not in models or self._hopeless(plain):
            return best
        if isinstance(found, JointIdError):
            return best
        lag = found.p[-1:] if best.delay else found.p[:0]
        before = self.misfit(plain)
        again = self._fitted(plain, np.concatenate([found.p[: 2 * self.phasors.n], lag]))
        if isinstance(again, LikelihoodEstimate) and _misfit(again) < before:
            self.tried[plain] = again
            return self.best(models)
        return best

    def explains(self, model: Model) -> bool:
        return self.misfit(model) < _EXPLAINED

    def misfit(self, model: Model) -> float:
        estimate = self.tried[model]
        return np.inf if isinstance(estimate, JointIdError) else _misfit(estimate)

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
            parameters=fitted.parameters if fitted else 0,
            criterion=criterion,
            chosen=chosen and fitted is not None,
        )

    def _begin(self, model: Model) -> Floats:
        """Parameters of the last fit of the same kind, or the linear estimate."""
        for lag in (model.delay, False):
            for earlier, estimate in reversed(self.tried.items()):
                alike = (earlier.reversal is None) == (model.reversal is None) and earlier.delay == lag
                if alike and isinstance(estimate, LikelihoodEstimate):
                    if earlier.curve == model.curve:
                        return estimate.p
                    return estimate.p[: 2 * self.phasors.n]
        return self.start

    def _criterion(self) -> dict[Model, float]:
        """2·cost + the penalty of the parameters, with the cost over the best model's misfit.

        Schwarz's penalty ln(rows) for what is asked for (K, D, friction, delay); Akaike's 2 for the
        free shapes of the reversals, of which there are many and none matters by itself.
        """
        fitted = {m: e for m, e in self.tried.items() if isinstance(e, LikelihoodEstimate)}
        misfit = max(1.0, min((_misfit(e) for e in fitted.values()), default=1.0))
        rows = 2 * np.count_nonzero(self.phasors.harmonics[..., : self.phasors.n])
        criterion = dict.fromkeys(self.tried, np.inf)
        for model, estimate in fitted.items():
            if self._is_clear(model, estimate):
                free = estimate.parameters - estimate.p.size
                penalty = float(np.log(np.maximum(rows, 1))) * estimate.p.size + 2 * free
                criterion[model] = 2 * estimate.cost / misfit + penalty
        return criterion

    def _is_clear(self, model: Model, estimate: LikelihoodEstimate) -> bool:
        """Whether friction and delay, where nobody demands them, are needed or stand clear of nothing.

        Free shapes of reversals soak up many small things that are no friction; this keeps them out.
        """
        n, own = self.phasors.n, _misfit(estimate)
        error = np.sqrt(np.diag(estimate.covariance) * max(1.0, own))
        clear = np.abs(estimate.p) > _CLEAR * error
        parts = []
        if model.reversal is not None and NO_FRICTION in self.frictions:
            rubs = clear[2 * n : 4 * n] & (estimate.p[2 * n : 4 * n] > 0)  # friction takes energy
            parts.append((Model(None, model.delay), (clear[2 * n :] if model.curve else rubs).any()))
        if model.delay and False in self.lags:
            parts.append((Model(model.reversal, False, model.curve), clear[-1]))
        for without, stands in parts:
            other = self.tried.get(without)
            if isinstance(other, LikelihoodEstimate):
                needed = _misfit(other) > _NEEDED * max(1.0, own)
            else:
                needed = self._hopeless(without)
            if not stands and not needed:
                return False
        return True


def _misfit(estimate: LikelihoodEstimate) -> float:
    return estimate.cost / estimate.expected_cost if estimate.expected_cost > 0 else 1.0
