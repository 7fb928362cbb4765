"""First fits of a model search, and the addition of parts where no simple model is near the data."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from jointid.estimation.candidates import EXPLAINED, NEEDED, Model
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.levenberg_marquardt import LOST
from jointid.estimation.estimators.parameters import FRICTION_EFFECTS, GEAR_LAWS, Parameters
from jointid.estimation.model_growth import NEARLY_ALL, friction_of_records, other_part_leads
from jointid.estimation.model_search import DOUBTFUL, POOR, PROMISING, Search
from jointid.estimation.regression_start import regression_start
from jointid.estimation.start_values import at_resonances, by_motion
from jointid.phasors.extract import Phasors

Start = Callable[[Phasors, InertiaPrior], Parameters]
"""Start values for some records."""

_BENT = 0.7
"""Squares of a regression over those of linear gears below which its law is tried before other parts."""
_OTHER_LAWS = 2.0
"""These squares over those of the best law from which another one is not tried."""
_COMPLETE = (("cubic", "hysteresis"), ("backlash", "hysteresis"), ("cubic", "backlash"))
"""Laws of the gears that are fitted at once."""
_NEAR = 0.5
"""Misfit of a cubic law over that of linear gears below which slopes are tried: they give up to 0.4."""
_LEADING, _ALONE = 0.1, 2.0
"""Score over the cost, and over the next score, from which a part is fitted before growth: gravity
beside friction has 0.13 to 0.28, further parts 0.02; of wrong data several parts are alike."""
_RIVAL = 0.3
"""Score over the highest from which a law with start values of its own is fitted to motions."""
_FEWEST, _APART = 3, 0.03
"""Records per joint that show whether two laws of the gears come near the data, and their misfit with
friction alone, over that of all records, below which laws are not the cause: 0.4 and more with laws."""
_CLIMB, _STEEP = 0.7, 0.3
"""Ratio of misfits by which a part must lower that of a model far from the data: in general, and of the
first models, where wrong data gave 0.4 and more, and gravity beside friction 0.1."""


def fit_first(search: Search) -> None:
    """Fit friction first where the start or harmonics show it, else the base model.

    Heavy friction biases a fit without friction.
    """
    fits, start, base = search.fits, search.start, search.base
    sliding, free = replace(base, reversal=0.0), replace(base, reversal=0.03)
    by_start = "coulomb" in start.layout
    if search.is_lost and (by_start or (search.may_have_friction and search.is_distorted)):
        search.fit(sliding, start)
        found = fits.estimate(sliding)
        clear = by_start or fits.is_certain(sliding, "friction")
        if found and search.may_be_richer(found) and clear:
            if by_start and search.is_lost:  # sticking biases friction without it
                search.fit(free, start)
            if search.is_lost:
                search.fit(free, found.named)
            nearest = fits.estimate(free)
            if search.is_lost and nearest:  # friction that changes, or motors that stick for long
                for model in (*friction_of_records(search, free), replace(base, reversal=0.1)):
                    if search.is_lost:
                        search.fit(model, nearest.named)
    if not by_start and (search.is_lost or sliding not in fits.tried):
        search.fit(base, start)
        if fits.misfit(base) > DOUBTFUL and not search.is_distorted:
            for other in search.free_start():  # wrong inertias may bias the linear estimate
                search.fit(base, other)
        if search.is_lost and "delay" in fits.optional:  # the most frequent cause
            search.fit(base.with_part("delay"), start)
        if search.is_lost and "friction" in fits.optional and sliding not in fits.tried:
            search.fit(sliding, start)
    of_sliding = fits.estimate(sliding)
    seeks_parts = search.is_lost and not search.has_motions
    if seeks_parts and of_sliding and NEEDED * of_sliding.misfit < fits.misfit(base) < np.inf:
        search.fit(free, of_sliding.named)  # the residual of sticking hides further parts
    known = next((model for model in search.first[:1] if model.reversal == 0), sliding)
    found = fits.estimate(known)
    if found is None or found.misfit <= DOUBTFUL or not search.has_motions:
        return
    for part in FRICTION_EFFECTS:
        if part in fits.optional and search.may_explain(known, part):
            # Coulomb friction may be insignificant, and hence left out, until these are known.
            search.fit(known.with_part(part), found.named)


def fit_hanging(search: Search) -> None:
    """Fit gravity, and friction where harmonics show it, where no other model explains sines.

    After heavy friction alone, and before it, a fit of gravity ends at another local minimum, and so it
    does from start values without gravity.
    """
    model = replace(search.base, reversal=0.0 if search.may_have_friction else search.base.reversal)
    if search.has_motions or "gravity" not in search.fits.optional:
        return
    starts = [regression_start(search.phasors, search.prior, hangs=True)]
    if not search.is_distorted:
        model, starts = search.base, [*starts, *at_resonances(search.phasors, search.prior)]
    for each in starts:
        if search.is_lost:
            search.fit(model.with_part("gravity"), each, compares=False)
    freed(search, model.with_part("gravity"))


def fit_regressed(search: Search, most_left: float = _BENT) -> None:
    """Fit laws of the gears to sines, from regressions of the deflection that leave little of it."""
    fits, base = search.fits, search.base
    if search.has_motions or not search.is_distorted or fits.least_misfit <= DOUBTFUL:
        return
    sliding = [replace(base, reversal=0.0)] * search.may_have_friction
    models = list(dict.fromkeys((base, *sliding)))
    for law, start, left in search.regressed_laws:
        most_left = min(most_left, _OTHER_LAWS * left)
        for model in models if left < most_left else ():
            wider = model.with_part(law)
            if fits.least_misfit > DOUBTFUL and (law, wider) not in search.regressed:
                _fit_law(search, wider, start)
                if (
                    search.is_lost
                    and model == models[-1]
                    and fits.misfit(wider) > _linear_misfit(search)
                ):
                    return  # wrong data


def fit_laws(search: Search) -> None:
    """Fit laws of the gears from their own start values where no other model explains the data."""
    fits, base = search.fits, search.base
    if not (search.is_distorted or search.has_motions):
        return
    sliding = replace(base, reversal=0.0)
    plain = fits.misfit(base if base in fits.tried else sliding)  # motors stick
    needs_friction = NEEDED * _linear_misfit(search) < plain < np.inf
    if search.is_lost:
        fit_regressed(search, np.inf)
    laws: list[tuple[Model, str, Start]] = []
    if not (needs_friction or search.has_motions or search.first):
        laws += [(base, "hysteresis", by_motion)]
    if search.may_have_friction:
        laws += [(sliding, law, by_motion) for law in ("hysteresis", "backlash")]
    if search.has_motions and not search.is_repeated and POOR < fits.least_misfit < np.inf:
        laws = _laws_of_motions(search, fits.least())
    for model, law, begin in laws:
        is_far = fits.least_misfit > POOR if search.has_motions else search.is_lost
        if is_far and law in fits.optional:
            wider = model.with_part(law)
            _fit_law(search, wider, begin(search.phasors, search.prior))
            if search.has_motions and fits.misfit(wider) > _CLIMB * fits.misfit(model):
                del fits.tried[wider]  # growth is slow beside a law that explains nothing


def _laws_of_motions(search: Search, model: Model) -> list[tuple[Model, str, Start]]:
    """Laws that the scores of a model do not rule out, the best first, with their start values.

    Wide backlash looks like hardening, and hysteresis with a delay does. The leading law is among them:
    growth from a rival that came nearer by its own start values would not return to it.
    """
    gains = {part: score.gain for part, score in search.scores(model).items()}
    order, found = sorted(gains, key=lambda part: -gains[part]), search.fits.estimate(model)
    starts: dict[str, Start] = {"backlash": partial(regression_start, backlash=True)}
    if found and order and order[0] in GEAR_LAWS:  # friction at the arm resembles hysteresis
        starts["hysteresis"], near = regression_start, found.named
        starts.setdefault(order[0], lambda *_: near)
    rivals = [part for part in order if part in starts and gains[part] > _RIVAL * gains[order[0]]]
    return [(model, part, starts[part]) for part in rivals]


def _fit_law(search: Search, wider: Model, start: Parameters) -> None:
    """Fit a model with a law of the gears, and what follows from its estimate if it is far off."""
    fits = search.fits
    search.fit(wider, start, compares=not search.has_motions)
    near, rubs = fits.estimate(wider), replace(wider, reversal=0.0)
    leads = search.is_lost and fits.misfit(wider) < _STEEP * _linear_misfit(search)
    if near and leads and search.may_have_friction and rubs not in fits.tried:
        search.fit(rubs, near.named)
        search.regressed.update((law, rubs) for law in rubs.effects)  # no other start is needed
    if search.is_lost:
        freed(search, wider)
    fit_slopes(search, wider)


def fit_complete(search: Search) -> None:
    """Fit two laws of the gears at once, beside friction, where growth part by part stays far off.

    Every model on the way may be far from the data, and a wrong part may come nearer than a right one.
    The complete model converges from the first start values; its narrower ones do from its estimate.
    """
    fits, sliding = search.fits, replace(search.base, reversal=0.0)
    if search.has_two_laws or not (search.is_distorted and search.may_have_friction):
        return
    search.has_two_laws = True
    rows, nearest_so_far = search.few_rows(_FEWEST), fits.least_misfit
    if rows.size < len(search.phasors.omega):  # wrong data, or other parts, would take long
        few = search.of_rows(rows)
        few.fit(replace(sliding, reversal=0.03), search.start)
        if few.fits.least_misfit <= max(EXPLAINED, _APART * nearest_so_far):
            return  # the records contradict each other
        fit_complete(few)
        if few.fits.least_misfit > min(LOST, max(nearest_so_far, DOUBTFUL)):
            return
        best = few.fits.least()
        near = few.fits.estimate(best)
        for start in (*([near.named] if near else []), *_regressed(search, best)):
            search.fit(best, start, compares=False)
        if not search.is_lost:
            search.pruned(best)
            return
    pairs = [sliding.with_part(first).with_part(second) for first, second in _COMPLETE]
    models = [each for both in pairs for each in (both, both.with_part("motor_presliding"))]
    models = [model for model in models if set(model.effects).issubset(fits.optional)]
    for model in models:
        for start in (*_regressed(search, model), *[search.start] * (model not in fits.tried)):
            if fits.misfit(model) > DOUBTFUL:
                search.fit(model, start, compares=False)
        if fits.misfit(model) < POOR and fits.misfit(freed(search, model)) < EXPLAINED:
            break
    if models:
        nearest = freed(search, min(models, key=fits.misfit))
        for each in (nearest, *fit_slopes(search, nearest)):
            if fits.misfit(each) < LOST:
                search.pruned(each)


def _regressed(search: Search, model: Model) -> list[Parameters]:
    """The start values of the best regression with a law of the model, if there is one."""
    return [start for law, start, _ in search.regressed_laws if law in model.effects][:1]


def _linear_misfit(search: Search) -> float:
    """Least misfit of the models without a law of the gears."""
    fits = search.fits
    return min((fits.misfit(each) for each in fits.tried if not each.is_slow), default=np.inf)


def fit_slopes(search: Search, model: Model) -> list[Model]:
    """Fit three slopes, from a cubic law that comes near the data of sines, but not near enough."""
    found, slopes = search.fits.estimate(model), model.replacing("cubic", "piecewise")
    if "cubic" not in model.effects or search.has_motions or not search.may_start_again(slopes):
        return []
    is_near = found and DOUBTFUL < found.misfit < _NEAR * _linear_misfit(search)
    if not (found and is_near) or other_part_leads(search, model):
        return []
    search.fit(slopes, found.named, compares=False)
    return [slopes]


def freed(search: Search, model: Model) -> Model:
    """A model far from the data, or the same with free friction reversals if that is nearer.

    The residual of sticking looks like further parts.
    """
    found, free = search.fits.estimate(model), replace(model, reversal=0.03)
    if found is None or search.has_motions or model.reversal != 0 or found.misfit <= EXPLAINED:
        return model
    if free not in search.fits.tried:
        search.fit(free, found.named, compares=False)
    return free if search.fits.misfit(free) < max(EXPLAINED, _CLIMB * found.misfit) else model


def climb_from_nearest(search: Search, share: float, ratio: float = _CLIMB) -> None:
    """Add parts to the model that is nearest to the data where one may explain a share of its cost."""
    _climb_from(search, min(search.fits.tried, key=search.fits.misfit), share, ratio)


def climb_from_first(search: Search) -> None:
    """Add parts to friction. Its free reversals, which hide friction at the arm, come after that."""
    nearest = min(search.fits.tried, key=search.fits.misfit)
    sharp, arm = replace(nearest, reversal=0.0), "arm_coulomb"
    scored = search.scores(sharp) if nearest.reversal and sharp in search.fits.tried else {}
    if arm in scored and scored[arm].gain == max(each.gain for each in scored.values()):
        _climb_from(search, sharp, PROMISING, _STEEP)
    if search.is_lost:
        climb_from_nearest(search, PROMISING, _STEEP)


def _climb_from(search: Search, model: Model, share: float, ratio: float) -> None:
    found, scored = search.fits.estimate(model), search.scores(model)
    if not (found and len(scored) > 1):
        return
    first = max(scored, key=lambda part: scored[part].gain)
    alike = GEAR_LAWS if first in GEAR_LAWS else (first,)  # they imitate each other
    further = max((each.gain for part, each in scored.items() if part not in alike), default=0.0)
    gain = scored[first].gain
    if gain > share * found.cost or gain > max(_LEADING * found.cost, _ALONE * further):
        climbed(search, model, ratio)


def climbed(search: Search, model: Model, ratio: float = _CLIMB) -> Model:
    """The best model after adding the part of the highest score as long as the misfit falls by a ratio.

    With several laws and friction together every model on the way is far off: comparing alternatives
    there would use up the fits before the complete model is reached. A part may also become significant
    only with the next one: opposite filters of position and torque cancel their delays.
    """
    fits = search.fits
    while not search.is_full(model) and fits.misfit(model) > EXPLAINED:
        found, wider = fits.estimate(model), _wider(search, model)
        if found is None or not wider:  # no part lowers the cost
            break
        wider, least = _fitted_from(search, model, found.named, wider)
        plain = fits.criterion(judged=False)
        nearest = freed(search, min(wider, key=lambda each: plain.get(each, np.inf)))
        there, least = fits.estimate(nearest), min(least, fits.misfit(nearest))
        highest = max((score.gain for score in search.scores(nearest).values()), default=0.0)
        promises = there and highest > NEARLY_ALL * there.cost
        is_wrong = search.is_lost and nearest.is_slow and search.gives_up_late()
        if is_wrong or least == np.inf or (least >= ratio * found.misfit and not promises):
            break
        model = nearest
        if there and there.misfit < DOUBTFUL and highest < _LEADING * there.cost:
            break  # growth tries richer friction first
    if not search.is_lost:
        search.pruned(model)  # friction that it needed on the way may have lost its significance
    return fits.least()


def _wider(search: Search, model: Model) -> list[Model]:
    """The model with each part of nearly the highest score, and with the first in place of each law."""
    scored = search.scores(model)
    able = (part for part in scored if search.may_explain(model, part))
    parts = sorted(able, key=lambda part: -scored[part].gain)
    nearly = [part for part in parts if scored[part].gain > NEARLY_ALL * scored[parts[0]].gain]
    laws = [law for law in GEAR_LAWS if law in model.effects and parts]  # any may be a wrong one
    return [*map(model.with_part, nearly), *(model.replacing(law, parts[0]) for law in laws)]


def _fitted_from(
    search: Search, model: Model, near: Parameters, wider: list[Model]
) -> tuple[list[Model], float]:
    """Fit wider models from a model's values: they, others that these call for, and the least misfit."""
    fits, least, slopes = search.fits, np.inf, list[Model]()
    lower = _CLIMB * fits.misfit(model)
    for each in wider:  # a delay, lags and filters are similar, which their cost distinguishes
        if not (each.is_slow and least < lower):
            search.fit(each, near, compares=False)
            bends = each.is_slow and not search.has_motions
            bar = POOR if bends else np.inf if each.is_slow else lower
            if bends and POOR < fits.misfit(each) < LOST:
                slopes += fit_slopes(search, each)
                if min(map(fits.misfit, slopes), default=np.inf) > POOR:
                    search.fit(each, by_motion(search.phasors, search.prior), compares=False)
            if fits.misfit(each) >= bar:  # the model without the part may have diverged
                search.fit(each, search.start, compares=False)
            least = min(least, fits.misfit(each))
    wider = [*wider, *(slopes or fit_slopes(search, min(wider, key=fits.misfit)))]
    if "piecewise" in model.effects and least > DOUBTFUL:  # beside the missing part they imitated
        wider.append(wider[0].replacing("piecewise", "cubic"))
        search.fit(wider[-1], near, compares=False)
    return wider, least
