"""Model selection: which friction, delay and effects the records require.

Models grow from the simplest. A score test estimates in one evaluation how much every absent part would
lower the cost; the best few are fitted, and parts that they make superfluous are dropped.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import EXPLAINED, Choice, Fits, Model
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.levenberg_marquardt import LOST
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import (
    CHANGES,
    EFFECTS,
    GEAR_LAWS,
    PERIODIC_EFFECTS,
    ParameterLayout,
    Parameters,
)
from jointid.estimation.model_average import (
    spread,
    spread_of_accuracy,
    spread_of_modes,
    spread_of_reversals,
    spread_of_unseen,
)
from jointid.estimation.model_climb import (
    climb_from_first,
    climb_from_nearest,
    climbed,
    fit_complete,
    fit_first,
    fit_hanging,
    fit_laws,
    fit_regressed,
)
from jointid.estimation.model_fits import fit_without_inertias, freest, start_with_friction
from jointid.estimation.model_growth import MANY_ROWS, NEARLY_ALL, exchanged, grown, narrowed
from jointid.estimation.model_search import DOUBTFUL, POOR, PROMISING, Search
from jointid.estimation.periodic_effects import fit_periodic, with_best_orders
from jointid.estimation.start_values import at_resonances
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.phasors.passivity import least_misfit

LOOSE = 0.3
"""Relative standard deviation with which inertias that are given as exact are fitted for comparison."""
_BETTER, _FAR_BETTER = 0.1, 0.01
"""Ratio of misfits from which other start values are better, and from which no further ones are tried;
the same of free inertias in place of exact ones, near the data and far from them."""
_LEFT = 0.03
"""Score over the cost of the last model from which complete models are fitted: up to 0.03 beside linear
gears with friction, 0.05 and more where the growth has missed a law."""
_EXCHANGES = 3
"""Upper limit of parts that are exchanged one after another."""
FAR = 10.0
"""Misfit of the first models from which the data may be wrong."""


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
    gives_up: Callable[[], bool] = bool,
    gives_up_late: Callable[[], bool] = bool,
    first: Sequence[Model] = (),
    rejected: Sequence[Model] = (),
    most: float = np.inf,
    far: float = FAR,
    earlier_misfit: float | None = None,
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
    gives_up : callable
        Asked where the first models are far from the data; True, as for wrong data, ends the search.
    gives_up_late : callable
        The same where models with a law of the gears are far from sines, too.
    first : sequence of Model, optional
        Models that an earlier search could not distinguish, which are fitted first. The start values are
        those of the first one.
    rejected : sequence of Model, optional
        Models that it fitted and that are not fitted again.
    most : float, optional
        Misfit above which the choice is useless: the search ends once some records show it.
    far : float, optional
        Misfit of the first models from which ``gives_up`` is asked.
    earlier_misfit : float, optional
        That of the model an earlier search chose. If it was far from the data, there is no near one
        unless the first one is; and backlash that it rejected in motions is not fitted again.
    """
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    linear = start if isinstance(start, Parameters) else ParameterLayout.of(phasors.n).named(start)
    per_turn = first[0].per_turn if first else ()
    found = {each.effect for each in per_turn} | {part for model in first for part in model.effects}
    # Slopes take the place of a cubic law; the others are found where they explain most.
    excluded = {"piecewise", *({*CHANGES, *PERIODIC_EFFECTS} - found)}
    if gear == "linear":
        excluded |= set(GEAR_LAWS)
    if friction:
        excluded.add("viscous")
    if phasors.is_superposed:  # presliding of sines is computed for angles that return
        excluded.add("motor_presliding")
    parts = ("friction",) * (not friction) + ("delay",) * (not delay)
    parts += tuple(name for name in EFFECTS if name not in excluded)
    rows = 2 * int(np.count_nonzero(phasors.harmonics[..., : phasors.n]))
    search = Search(
        phasors,
        prior,
        linear,
        noise,
        Model(0.0 if friction else None, delay, per_turn=per_turn),
        Fits(() if exactly else parts, max(rows, 1), levels=2 * phasors.q.size),
        first=tuple(first),
        rejected=tuple(rejected),
        most=most,
        far=far,
        gives_up=gives_up,
        gives_up_late=gives_up_late,
        is_repeated=earlier_misfit is not None,
        may_be_periodic=(friction or "friction" in parts) and not (exactly or phasors.is_superposed),
    )
    if first and earlier_misfit is not None and earlier_misfit >= LOST:
        search.fit(first[0], linear)
        if LOST <= search.fits.misfit(first[0]) < np.inf:
            return _given_up(search) if gives_up() else _choice(search, first[0])
    if search.may_have_friction and not isinstance(start, Parameters):
        search = replace(search, start=start_with_friction(phasors, prior, linear, noise, search.base))
    return _searched(search)


def _searched(search: Search) -> Choice:
    """Search from the linear estimate and, if the misfit stays large, from other start values.

    Heavy friction can make the linear estimate negative, or place it near another local minimum; a
    start with its model is that of a near fit. The search ends soon where no passive robot can produce
    the records, or no model explains a part of them.
    """
    phasors = search.phasors
    if not search.has_motions and least_misfit(phasors.omega, phasors.z, phasors.covariance) > LOST:
        search.fit(search.base, search.start)
        return _choice(search, search.base)
    for model in search.first:
        if model not in search.fits.tried:
            search.fit(model, search.start)
    fit_first(search)
    if not search.fits.least_misfit < search.far and search.gives_up():
        return _given_up(search)
    loosened = _loosened(search)
    wrong = _inertias_are_wrong(search, loosened)
    if wrong and not search.is_lost:
        return _choice(search, search.fits.least())
    if not (wrong or search.has_motions):
        fit_periodic(search, min(search.fits.tried, key=search.fits.misfit))
    if search.is_lost and search.may_have_friction and search.is_distorted:
        climb_from_first(search)
    rows = search.few_rows()
    if search.is_lost and rows.size < phasors.omega.size:
        return _searched_in_few(search, rows)
    fit_regressed(search)
    if search.is_lost and _inertias_are_wrong(search, loosened):
        return _choice(search, search.fits.least())
    if search.is_lost and not (search.has_motions or search.is_distorted):
        climb_from_nearest(search, PROMISING)
    before = search.fits.least_misfit
    if search.is_lost:
        fit_hanging(search)
    if search.is_lost and search.fits.least_misfit < _BETTER * before:
        climb_from_nearest(search, PROMISING)
    fit_laws(search)
    if search.is_lost and search.gives_up_late():
        return _choice(search, search.fits.least())
    if search.is_lost and not search.explains_little:
        fit_complete(search)
    if search.is_lost and (search.has_motions or not search.first):
        other = _other_start(search)
        if other.fits.least_misfit < _BETTER * search.fits.least_misfit:
            search = other
            fit_first(search)
            fit_laws(search)
    if search.is_lost and search.explains_little:
        return _choice(search, search.fits.least())
    best = _best(search)
    if fit_periodic(search, best):
        best = _grown(search, search.pruned(search.fits.least()))
    linear = [each for each in search.fits.tried if not each.is_slow and search.fits.estimate(each)]
    if search.is_lost and search.has_motions and linear:  # under a wrong law the gears' motion diverges
        best = search.fits.least(linear)
    return _choice(search, with_best_orders(search, best))


def _given_up(search: Search) -> Choice:
    """The best of the first models, from the first start values that allow a fit."""
    for start in (*search.free_start(), *at_resonances(search.phasors, search.prior)):
        if search.fits.least_misfit < np.inf:
            break
        search.fit(search.base, start)
    best, n = search.fits.least(), search.phasors.n
    return Choice(best, search.fits.tried[best], search.fits.candidates(best), np.zeros((2 * n, 2 * n)))


def _loosened(search: Search) -> LikelihoodEstimate | None:
    """Fit far from the data with free inertias in place of exact ones; None without such."""
    # With many equations the search among other models takes minutes.
    is_far = search.is_lost or (search.fits.rows > MANY_ROWS and search.fits.least_misfit > DOUBTFUL)
    if not is_far or search.prior.inertia_std or search.has_motions:
        return None
    prior = replace(search.prior, inertia_std=LOOSE)
    model = freest(search.phasors, search.base, search.fits.optional)
    return fit_without_inertias(search.phasors, prior, search.start, search.noise, model)


def _inertias_are_wrong(search: Search, loosened: LikelihoodEstimate | None) -> bool:
    """Whether the inertias, given as exact, keep the models from the data."""
    share, most = (_FAR_BETTER, LOST) if search.is_lost else (_BETTER, DOUBTFUL)
    if loosened is None or not loosened.misfit < min(most, share * search.fits.least_misfit):
        return False
    model = freest(search.phasors, search.base, search.fits.optional)
    search.fit(model, loosened.named)  # heavy friction may have biased the others
    return share * search.fits.least_misfit > loosened.misfit


def _other_start(search: Search) -> Search:
    """The search from those further start values from which a flexible model comes nearest."""
    probe, others = freest(search.phasors, search.base, search.fits.optional), []
    for start in (*search.free_start(), *at_resonances(search.phasors, search.prior)):
        others.append(search.again(start))
        others[-1].fit(probe, start)
        if others[-1].fits.least_misfit < max(DOUBTFUL, _FAR_BETTER * search.fits.least_misfit):
            break
    return min(others, key=lambda each: each.fits.misfit(probe))


def _searched_in_few(search: Search, rows: np.ndarray) -> Choice:
    """Search in some records; a model near those is the start for all, and grows.

    If no model explains some records, none explains all.
    """
    fits, few = search.fits, search.of_rows(rows)
    choice = _searched(few)
    search.has_two_laws = few.has_two_laws
    if few.fits.least_misfit > search.most:
        return _choice(search, fits.least())
    if isinstance(choice.estimate, LikelihoodEstimate):
        search.fit(choice.model, choice.estimate.named, compares=False)
    if search.is_lost and search.gives_up_late():
        return _choice(search, fits.least())
    if search.is_lost:  # several parts explained these records
        climb_from_nearest(search, NEARLY_ALL)
    return _choice(search, fits.least() if search.is_lost else _best(search))


def _best(search: Search) -> Model:
    """Grow and prune from the best model that is fitted already."""
    fits = search.fits
    if not search.is_lost and fits.misfit(fits.least()) > LOST:
        # The model that explains the data has an insignificant part: fit it without.
        search.pruned(min(fits.tried, key=fits.misfit))
    best, lost = fits.least(), search.is_lost
    if lost:
        best = climbed(search, best)
    linear = [each for each in fits.tried if not each.is_slow and fits.estimate(each)]
    if search.is_lost and search.has_motions and best.is_slow and linear:  # it may be the wrong law
        best = climbed(search, fits.least(linear))
    if not search.is_lost and (lost or best.reversal is not None):
        # Parts that only start values or gear laws suggest.
        best = search.pruned(best)
    best = _grown(search, best)
    if not (lost or search.has_motions or search.is_spent) and fits.misfit(best) > POOR:
        best = search.pruned(climbed(search, best))  # each of several parts alone helps little
    if not (lost or search.has_motions or best.reversal) and EXPLAINED < fits.misfit(best) < LOST:
        for _ in range(_EXCHANGES):
            best, before = exchanged(search, best), best
            if best == before:
                break
    # Complete models have one level of friction, and come no nearer than friction of each record.
    is_open = not (search.is_lost or search.is_full(best) or best.differs)
    if (found := fits.estimate(best)) and found.misfit > EXPLAINED and is_open:
        highest = max((score.gain for score in search.scores(best).values()), default=0.0)
        if highest > _LEFT * found.cost and not search.explains_little:
            further = replace(search, starts={}, slow_fits=0)
            fit_complete(further)
            search.has_two_laws = True
            nearest = fits.least()
            best = best if nearest == best else _grown(further, nearest)
    return narrowed(search, best)


def _grown(search: Search, best: Model) -> Model:
    """Grow part by part."""
    while not (search.is_spent or (search.is_lost and search.has_sought_friction(best))):
        better = grown(search, best)
        if better == best:
            break
        best = better
    return best


def _choice(search: Search, best: Model) -> Choice:
    """The best model with the candidates, and how far others that explain the data differ."""
    found, candidates = search.fits.tried[best], search.fits.candidates(best)
    if isinstance(found, JointIdError):
        return Choice(best, found, candidates, np.zeros((0, 0)))
    scored = search.scores(best)
    whole = spread(search.fits, best, found, scored)
    if "link" in best.effects:
        whole = whole + spread_of_modes(found, search.prior)
    whole = whole + spread_of_accuracy(best, found, of_motions=search.has_motions)
    if search.has_motions:
        scored = {name: score for name, score in scored.items() if name != "link"}
        whole = whole + spread_of_reversals(search, best, found)
    return Choice(best, found, candidates, whole + spread_of_unseen(found, scored, search.prior))
