"""Growth of a model by one part: the most promising parts are fitted, and the rest pruned.

A score test (Rao) estimates in one evaluation how much every absent part would lower the cost.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from jointid.errors import JointIdError
from jointid.estimation.candidates import CHANCE, EXPLAINED, WORTH, Model
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.parameters import GEAR_LAWS, LAWS
from jointid.estimation.estimators.score_tests import Score
from jointid.estimation.model_search import LOST, POOR, Search

_RICHER = {
    (0.0, False): ((0.03, False), (0.1, False)),
    (0.03, False): ((0.1, False), (0.03, True)),
    (0.1, False): ((0.1, True),),
    (0.03, True): ((0.1, True),),
}
"""Richer friction models for each one: velocity, over the largest, below which friction is free (from a
sharp to a gradual reversal), and whether friction varies nonlinearly with speed."""
_SIMILAR = 0.3
"""Score over the highest from which a part is fitted: similar parts differ by the cost only."""
_DECISIVE = 0.3
"""Score over the cost from which a part is fitted before richer friction."""
NEARLY_ALL = 0.9
"""Score over the cost from which a part is fitted in place of a law, or before others that are."""
_TRIED, _TRIED_LAWS = 5, 2
"""The most parts, and nonlinear laws among them, that are fitted for each one added."""
_HOPELESS = 3e4
"""Misfit of wrong units, signs or gear ratios, of which no law explains a decisive share."""
_BENT = 4.0
"""Standard deviations of the misfit from which three slopes are fitted in place of a cubic law."""
_HALFWAY = 0.25
"""Share of the gain needed to keep a part from which its score leads to a slow fit."""
_MANY_ROWS = 20_000
"""Equations, those of six joints in 50 records, from which one part is tried where the model explains
the data: a fit takes seconds."""


def grown(search: Search, best: Model) -> Model:
    """The best of a model and those with one more part, pruned."""
    fits, found = search.fits, [best]
    for k, wider in enumerate(sorted(_extensions(search, best), key=lambda model: model.is_slow)):
        leading = fits.least(found)
        if search.is_spent(leading):
            break
        if not _is_passed_over(search, wider, best, leading):
            _fit_wider(search, wider, best, leading, leads=k == 0)
            found.append(search.pruned(wider) if _is_kept(search, wider, best) else wider)
    return fits.least(found)


def _is_passed_over(search: Search, wider: Model, best: Model, leading: Model) -> bool:
    """Whether a fit is not worth its time since another extension of the best model leads."""
    fits = search.fits
    if leading == best:
        return False
    added = set(wider.effects).difference(best.effects)
    if fits.misfit(leading) < EXPLAINED < fits.misfit(best) and not added.isdisjoint(LAWS):
        return True
    if fits.is_explained(leading) and (wider.is_slow or wider.parts == leading.parts):
        return True  # the score of a slow part decides again
    # Richer friction first: other parts absorb some of it.
    return leading.reversal != best.reversal and wider.reversal == best.reversal


def _is_kept(search: Search, wider: Model, narrow: Model) -> bool:
    """Whether a wider model may last; a slow one with a part that is not significant does not."""
    estimate = search.fits.tried[wider]
    if isinstance(estimate, JointIdError) or not wider.is_slow:
        return True
    added = set(wider.parts).difference(narrow.parts).intersection(search.fits.optional)
    return all(search.fits.part_is_significant(wider, estimate, part) for part in added)


def _fit_wider(search: Search, wider: Model, narrow: Model, leading: Model, *, leads: bool) -> None:
    """Fit with one more part, from the estimate without it.

    Where that is far off, the fit starts from that of the same parts with other friction, or else
    as all do; a slow one does so last, and only if it is the most promising.
    """
    fits = search.fits
    if not search.is_open(wider):
        return
    found, near = fits.tried[narrow], fits.tried[leading]
    starts = [found.named] if isinstance(found, LikelihoodEstimate) else []
    if fits.misfit(narrow) >= LOST:
        similar = leading.parts == wider.parts and fits.misfit(leading) < LOST
        if similar and isinstance(near, LikelihoodEstimate):
            starts.insert(0, near.named)
        elif not wider.is_slow:
            starts.insert(0, search.start)
        elif leads:
            starts.append(search.start)
    for start in starts:
        if not fits.misfit(wider) < LOST:
            search.fit(wider, start)
    stuck = fits.misfit(wider) >= fits.misfit(narrow) > POOR  # one more part cannot raise the cost
    if stuck and wider.is_slow and search.may_start_again(wider):
        search.fit(wider, search.start)


def _extensions(search: Search, model: Model) -> list[Model]:
    """Models with one more part that may lower the cost significantly."""
    found = search.fits.tried[model]
    if isinstance(found, JointIdError):
        return []
    clear = _clear_parts(search, model, found)
    scored = search.scores(model)
    least = _DECISIVE * found.cost if found.misfit > _HOPELESS else 0.0
    most_laws = 1 if search.fits.is_explained(model) else _TRIED_LAWS
    laws = [part for part in clear if part in LAWS and scored[part].gain > least][:most_laws]
    promising = (
        part
        for part in clear
        if (part in laws or part not in LAWS) and _is_promising(search, model, part, scored[part])
    )
    tried = _TRIED if search.fits.rows < _MANY_ROWS or found.misfit > EXPLAINED else 1
    wider = [model.with_part(part) for part in promising][:tried]
    if model.is_slow and found.misfit >= LOST:  # another part may explain the data without the law
        bare = replace(model, effects=tuple(e for e in model.effects if e not in GEAR_LAWS))
        instead = (part for part in clear if scored[part].gain > NEARLY_ALL * found.cost)
        wider += [bare.with_part(part) for part in instead if part not in LAWS]
    highest = scored[clear[0]].gain / found.cost if clear else 0.0
    if model.reversal is not None and search.may_be_richer(found):
        richer = _RICHER.get((model.reversal, model.curve), ())
        sharper = [replace(model, reversal=reversal, curve=curve) for reversal, curve in richer]
        wider = [*wider, *sharper] if highest > _DECISIVE else [*sharper, *wider]
    spread = np.sqrt(max(found.expected_cost, 1.0))
    if "cubic" in model.effects and max(found.misfit, found.fundamental[0]) > 1 + _BENT / spread:
        plain = model.without("cubic")
        laws_instead = ["piecewise"] if "backlash" in model.parts else ["backlash", "piecewise"]
        instead_of_cubic = [plain.with_part(law) for law in laws_instead]
        wider = [*wider, *instead_of_cubic] if highest > NEARLY_ALL else [*instead_of_cubic, *wider]
    return [each for each in wider if search.is_open(each)]


def _clear_parts(search: Search, model: Model, found: LikelihoodEstimate) -> list[str]:
    """Absent parts with a significant score that is not far below the highest, best first.

    What friction with sharp reversals leaves looks like other parts: where it explains the data, the
    part must be significant beside free reversals, too.
    """
    fits, scored = search.fits, search.scores(model)
    chance = CHANCE / max(len(fits.optional), 1)

    def is_clear(score: Score, misfit: float) -> bool:
        return bool(2 * score.gain / max(1.0, misfit) > chdtri(score.count, chance))

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


def _is_promising(search: Search, model: Model, part: str, score: Score) -> bool:
    """Whether a slow fit with one more part is worth its time, by the part's score.

    It is not where the part cannot explain enough of the misfit to be kept, nor where the model
    explains the data without it and K and D would hardly move. Its score still widens the errors.
    """
    found = search.fits.tried[model]
    if isinstance(found, JointIdError) or not model.with_part(part).is_slow:
        return True
    if search.has_motions and not search.may_be_richer(found):
        return False  # it takes a minute
    if part != "friction" and found.misfit > EXPLAINED:
        needed = WORTH * (found.misfit - 1) * found.expected_cost
        return score.gain > _HALFWAY * needed
    sigma = np.sqrt(np.diag(found.elasticity_covariance))
    return not search.fits.is_explained(model) or bool(np.any(np.abs(score.shift) > sigma))
