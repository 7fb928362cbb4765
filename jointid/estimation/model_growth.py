"""Growth of a model by one part: the most promising parts are fitted, and the rest pruned.

A score test (Rao) estimates in one evaluation how much every absent part would lower the cost.
"""

from dataclasses import replace
from itertools import product

import numpy as np
from scipy.special import chdtri

from jointid.arrays import Floats
from jointid.estimation.candidates import CHANCE, EXPLAINED, NEEDED, WORTH, Model
from jointid.estimation.estimators.levenberg_marquardt import LOST
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.parameters import (
    CHANGES,
    EFFECTS,
    FRICTION_EFFECTS,
    GEAR_LAWS,
    LAWS,
)
from jointid.estimation.estimators.score_tests import Score
from jointid.estimation.estimators.whitened_residual import DRIVEN_LAWS
from jointid.estimation.model_fits import stepped
from jointid.estimation.model_search import POOR, Search

_RICHER = {
    (0.0, False): ((0.03, False), (0.1, False)),
    (0.03, False): ((0.1, False), (0.03, True)),
    (0.1, False): ((0.1, True),),
    (0.0, True): ((0.03, True), (0.1, True)),
    (0.03, True): ((0.1, True),),
}
"""Richer friction models for each one: velocity, over the largest, below which friction is free (from a
sharp to a gradual reversal), and whether friction varies nonlinearly with speed."""
NARROWER = {0.1: 0.03, 0.03: 0.0}
"""The next narrower reversal of each one."""
_DIFFERS = 0.5
"""Ratio of misfits from which friction that differs from record to record is fitted."""
_BESIDE = 0.5
"""Score of a law over the cost beyond noise from which it is fitted beside such friction."""
_SIMILAR = 0.3
"""Score over the highest from which a part is fitted: similar parts differ by the cost only."""
NEARLY_ALL = 0.9
"""Score over the cost from which a part is fitted in place of a law, or before others that are."""
_LEADING = 0.15
"""The same of a part that is no law of the gears, whose fit is quicker than those of further laws."""
_LARGE = 0.1
"""Score over the cost from which a part is fitted to motions that leave no more than noise: their noise
is that of the residual, which a missing part raises."""
_CLIMB = 0.7
"""Ratio of misfits of motions below which further laws wait for the scores with the leading model."""
_TRIED_LAWS = 2
"""The most nonlinear laws that are fitted for each part added, and parts with a law in motions."""
_NEARER = 10.0
"""Difference of the criteria from which an excluded model is pruned: its fits take time."""
_INIMITABLE = 5e3
"""Squared cubic stiffness over its variance beyond which three slopes in its place leave a residual
above the noise: they explain 99.5 % of its effect."""
MANY_ROWS = 10_000
"""Equations, those of six joints in 33 records, from which one part is tried where the model explains
the data, as with a law of the gears or Coulomb friction at the arm: a fit takes seconds."""


def grown(search: Search, best: Model) -> Model:
    """The best of a model and those with richer friction, else with one more part, pruned.

    Richer friction first: other parts absorb some of it.
    """
    for extensions in (_richer_friction, _extensions):
        better = _best_extension(search, best, extensions(search, best))
        if better != best:
            return better
    return _without_insignificant(search, best)


def _without_insignificant(search: Search, best: Model) -> Model:
    """The best of a model and the nearest one, pruned, where only an insignificant part excludes that.

    A part of the right model may follow one in place of it, which then is no longer needed.
    """
    fits = search.fits
    judged, plain = fits.criterion(), fits.criterion(judged=False)
    nearest = min(plain, key=lambda model: plain[model])
    if search.has_motions or judged[nearest] < np.inf or plain[nearest] > judged[best] - _NEARER:
        return best
    return fits.least([best, search.pruned(nearest)])


def _best_extension(search: Search, best: Model, extensions: list[Model]) -> Model:
    fits = search.fits
    before = [each for each in extensions if each in fits.tried and not search.is_open(each)]
    found = [best, *before]
    for wider in sorted(filter(search.is_open, extensions), key=lambda each: _order(search, each, best)):
        leading = fits.least(found)
        if search.is_spent:
            break
        if not _is_passed_over(search, wider, best, leading):
            _fit_wider(search, wider, best)
            found.append(search.pruned(wider) if _is_kept(search, wider, best) else wider)
    return fits.least(found)


def exchanged(search: Search, best: Model) -> Model:
    """The best of a model and those with another quick part in place of one of its own, pruned.

    On the way to two parts together, a third may be the nearest to both: each then gains nothing more.
    """
    fits = search.fits
    if (found := fits.estimate(best)) is None:
        return best
    quick = [p for p in fits.optional if p not in ("friction", *FRICTION_EFFECTS, *LAWS)]
    pairs = product([p for p in quick if p in best.parts], [p for p in quick if p not in best.parts])
    others = list(dict.fromkeys(best.replacing(part, other) for part, other in pairs))
    others = [model for model in others if model not in fits.tried]
    for model in others:
        search.fit(model, found.named)
    nearest = min([best, *others], key=fits.misfit)
    return best if nearest == best else fits.least([best, search.pruned(nearest)])


def _order(search: Search, wider: Model, best: Model) -> tuple[bool, bool]:
    """Quick fits first; of motions, then those that keep the laws of the best model."""
    laws = set(GEAR_LAWS).intersection(best.effects)
    return wider.is_slow, search.has_motions and not laws.issubset(wider.effects)


def _is_passed_over(search: Search, wider: Model, best: Model, leading: Model) -> bool:
    """Whether a fit is not worth its time because another extension of the best model is ahead."""
    fits = search.fits
    if leading == best:
        return False
    added = set(wider.effects).difference(best.effects)
    if fits.misfit(leading) < EXPLAINED < fits.misfit(best) and not added.isdisjoint(LAWS):
        return True
    if fits.is_explained(leading) and (wider.is_slow or wider.parts == leading.parts):
        return True  # the score decides on a slow part
    if search.has_motions and wider.is_slow and fits.misfit(leading) < _CLIMB * fits.misfit(best):
        return True
    # Richer friction, or none, is ahead: parts added to the former one absorbed some of its residual.
    return leading.reversal != best.reversal and wider.reversal == best.reversal


def _is_kept(search: Search, wider: Model, narrow: Model) -> bool:
    """Whether a wider model is kept; a slow one is not if one of its parts is not significant."""
    estimate = search.fits.estimate(wider)
    if estimate is None or not wider.is_slow:
        return True
    added = set(wider.parts).difference(narrow.parts).intersection(search.fits.optional)
    return all(search.fits.part_is_significant(wider, estimate, part) for part in added)


def _fit_wider(search: Search, wider: Model, narrow: Model) -> None:
    """Fit with one more part, from the estimate without it.

    If the misfit does not fall, it starts from the usual start values: one more part cannot raise the
    cost.
    """
    fits, near = search.fits, search.fits.estimate(narrow)
    starts = [near.named] if near else []
    bar = max(POOR, fits.misfit(narrow))
    # The gears' motion would diverge; in a repeated search it would start from a near estimate again.
    if not (search.has_motions and (narrow.is_slow or (wider.is_slow and search.is_repeated))):
        starts.append(search.start)
    for start in starts:
        if fits.misfit(wider) >= bar and search.may_start_again(wider):
            search.fit(wider, start)


def _richer_friction(search: Search, model: Model) -> list[Model]:
    """The model with richer friction where that may explain more."""
    found = search.fits.estimate(model)
    if found is None or model.reversal is None or not search.may_be_richer(found):
        return []
    richer = _RICHER.get((model.reversal, model.curve), ())
    others = [replace(model, reversal=reversal, curve=curve) for reversal, curve in richer]
    return [*friction_of_records(search, model), *others]


def friction_of_records(search: Search, model: Model) -> list[Model]:
    """The model with friction that differs from record to record, where that explains far more.

    Far from the data it would only absorb a part of what is missing, as it would of changing gears.
    """
    found, own = search.fits.estimate(model), replace(model, differs=True)
    if found is None or not model.reversal or model.differs or search.has_motions:
        return []
    if step_towards(search, own, found)[1] > min(_DIFFERS * found.misfit, LOST):
        return []
    scored = search.scores(model)
    return [own] * (not scored or max(scored, key=lambda part: scored[part].gain) not in CHANGES)


def _extensions(search: Search, model: Model) -> list[Model]:
    """Models with one more part that may lower the cost significantly."""
    fits, found = search.fits, search.fits.estimate(model)
    if found is None:
        return []
    clear, scored = _clear_parts(search, model, found), search.scores(model)
    if "piecewise" in model.effects:  # slopes are in place of a cubic law
        clear = [part for part in clear if part != "cubic"]
    may_be_richer = search.may_be_richer(found)
    if search.first and search.has_motions and model.reversal is not None and not may_be_richer:
        # Filters and lags would absorb the residual of sticking.
        clear = [part for part in clear if scored[part].gain > _LARGE * found.cost]
    if model.differs:  # what such friction leaves looks like laws, whose fits are slow beside it
        least = _BESIDE * (found.cost - found.expected_cost)
        clear = [part for part in clear if part not in LAWS or scored[part].gain > least]
    explained = found.misfit <= EXPLAINED
    laws = [part for part in clear if part in LAWS][: 1 if explained else _TRIED_LAWS]
    tried = [part for part in clear if part in laws or part not in LAWS]
    if explained and (fits.rows > MANY_ROWS or not set(DRIVEN_LAWS).isdisjoint(model.effects)):
        tried = tried[:1]
    if search.has_motions and model.is_slow:
        tried = tried[:_TRIED_LAWS]
    wider = [model.with_part(part) for part in tried if _is_promising(search, model, scored[part], part)]
    if model.is_slow and found.misfit >= LOST:  # another part may explain the data without the law
        bare = replace(model, effects=tuple(e for e in model.effects if e not in GEAR_LAWS))
        instead = (part for part in clear if scored[part].gain > NEARLY_ALL * found.cost)
        wider += [bare.with_part(part) for part in instead if part not in LAWS]
    if search.has_motions and not may_be_richer and _friction_varies_with_speed(search, model, found):
        wider = [replace(model, curve=True), *wider]
    if "piecewise" in model.effects and not search.has_motions:
        # They may have taken the place of a cubic law before the model was complete.
        plain = model.replacing("piecewise", "cubic")
        alike = [fits.misfit(each) for each in fits.tried if each.effects == plain.effects]
        if min(alike, default=0.0) < NEEDED * max(1.0, found.misfit):
            wider = [plain, *wider]
    curved = "cubic" in model.effects
    if search.has_motions:
        curved &= found.misfit < LOST
    elif curved:
        curved = not (explained and fits.is_certain(model, "cubic", _INIMITABLE))
    if curved:
        plain = model.without("cubic")  # slopes may explain as well as it, with another K
        others = ["backlash"] * (may_be_richer and "backlash" not in model.parts) + ["piecewise"]
        others = others[::-1] if search.has_motions else others  # their fits are few
        instead_of_cubic = [plain.with_part(law) for law in others]
        later = other_part_leads(search, model) and not search.has_motions
        wider = [*wider, *instead_of_cubic] if later else [*instead_of_cubic, *wider]
    return wider


def other_part_leads(search: Search, model: Model) -> bool:
    """Whether a part comes before other laws in place of one: it explains nearly all, or is no law."""
    found, scored = search.fits.estimate(model), search.scores(model)
    if found is None or not scored:
        return False
    first = max(scored, key=lambda part: scored[part].gain)
    return scored[first].gain > (NEARLY_ALL if first in GEAR_LAWS else _LEADING) * found.cost


def step_towards(search: Search, other: Model, found: LikelihoodEstimate) -> tuple[Floats, float]:
    """Parameters and misfit of a model with other friction, one step from the estimate of a model."""
    waveforms = search.waveforms(other, found.named)
    return stepped(search.phasors, search.prior, found, search.noise, other, waveforms)


def narrowed(search: Search, best: Model) -> Model:
    """The model, or it with narrower reversals or friction of one level, where they explain as much.

    Richer friction, which parts that were missing required, takes the information on K and D.
    """
    found = search.fits.estimate(best)
    if found is None or search.has_motions:
        return best
    others = [replace(best, differs=False)] * best.differs
    if best.reversal in NARROWER:
        others.append(replace(best, reversal=NARROWER[best.reversal]))
    for sharper in others:
        if sharper not in search.fits.tried:
            _, misfit = step_towards(search, sharper, found)
            if misfit > NEEDED * max(1.0, found.misfit):
                continue
            search.fit(sharper, found.named)
        if search.fits.least([best, sharper]) == sharper:
            return narrowed(search, sharper)
    return best


def _friction_varies_with_speed(search: Search, model: Model, found: LikelihoodEstimate) -> bool:
    """Whether a step towards such friction lowers the cost of a model with friction significantly.

    Motions pass all speeds, so that it hides in a misfit near 1 and still shifts D.
    """
    if model.reversal is None or model.curve or model.is_slow:
        return False
    p, misfit = step_towards(search, replace(model, curve=True), found)
    gain = 2 * (found.cost - misfit * found.expected_cost) / max(1.0, found.misfit)
    return bool(gain > chdtri(p.size - found.p.size, CHANCE))


def _clear_parts(search: Search, model: Model, found: LikelihoodEstimate) -> list[str]:
    """Absent parts with a significant score that is not far below the highest, best first.

    The residual of friction with sharp reversals looks like other parts: where friction explains the
    data, a part must also be significant with free reversals.
    """
    fits, scored = search.fits, search.scores(model)
    chance = CHANCE / max(len(fits.optional), 1)

    # Of a model that is off, a part must explain more (``part_is_significant``): half by its score.
    worth = 0.5 * WORTH * (found.cost - found.expected_cost) * (found.misfit > EXPLAINED)

    def is_clear(score: Score, misfit: float) -> bool:
        if score.gain < worth:
            return False
        return bool(2 * score.gain / max(1.0, misfit) > chdtri(score.count, chance))

    if search.is_full(model):
        scored = {part: score for part, score in scored.items() if part not in EFFECTS}
    order = sorted(scored, key=lambda part: scored[part].penalised(fits.rows), reverse=True)
    clear = [
        part
        for part in order
        if is_clear(scored[part], found.misfit) and scored[part].gain > _SIMILAR * scored[order[0]].gain
    ]
    free = replace(model, reversal=0.03)
    if clear and model.reversal == 0 and found.misfit < EXPLAINED and not search.has_motions:
        if free not in fits.tried:
            search.fit(free, found.named)
        beside = search.scores(free)
        clear = [p for p in clear if p not in beside or is_clear(beside[p], fits.misfit(free))]
    return clear


def _is_promising(search: Search, model: Model, score: Score, part: str) -> bool:
    """Whether a slow fit with one more part, or one to many rows, is worth its time, by its score.

    It is not where the model explains the data without it and K and D would hardly move. Its score still
    widens the errors.
    """
    found, is_slow = search.fits.estimate(model), model.with_part(part).is_slow
    if found is None or not (is_slow or search.fits.rows > MANY_ROWS):
        return True
    if not search.may_explain(model, part):
        return False
    if is_slow and search.has_motions and not search.may_be_richer(found):
        return score.gain > _LARGE * found.cost
    sigma = np.sqrt(np.diag(found.elasticity_covariance))
    return not search.fits.is_explained(model) or bool(np.any(np.abs(score.possible[1]) > sigma))
