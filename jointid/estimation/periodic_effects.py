"""Effects that repeat with the turns of a motor: their periods, found in the residual of a model."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from jointid.arrays import Floats
from jointid.estimation.candidates import CHANCE, EXPLAINED, Model
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.parameters import PERIODIC_EFFECTS, Parameters
from jointid.estimation.estimators.score_tests import PerTurnScores, scores_per_turn
from jointid.estimation.model_climb import fit_hanging, freed
from jointid.estimation.model_search import Search
from jointid.motion.per_turn import PerTurn

HIGHEST_ORDER = 48
"""Most periods per turn of a motor of the effects that are sought: above those of usual motors."""
_SHARE = 0.5
"""Share of the misfit beyond noise that an effect must explain to be tried."""
_LEAST_MISFIT = 1.5
"""Misfit from which the effects are sought: deviations of a simulated sampling left 1.2."""
_LEADING = 2.0
"""Score, over the highest of the other parts, from which it is tried."""
_STRAIGHT = 0.9
"""Score of a straight line in place of a wave, over that of the wave, from which it is not tried: 0.03
to 0.6 with the effect; 1.4 and more with gears that harden or have hysteresis."""
_ROUNDS = 3
"""Fits from which the orders are sought again: far from the data, they may be others."""
_UNDECIDED = 0.5
"""Score of an order, over that of the best one, from which it is fitted, too."""
_ALIKE = 5.5
"""Cost beyond that of the best order, over the misfit, up to which further orders are fitted: a
likelihood ratio of 1 : 250."""
_MOST_STEPS = 4
"""Steps from the best order up to which further ones are fitted."""


def fit_periodic(search: Search, nearest: Model) -> bool:
    """Fit torque ripple and transmission error where they clearly explain the residual of a model.

    Returns whether one was fitted.
    """
    fits, fitted = search.fits, False
    for _ in PERIODIC_EFFECTS * search.may_be_periodic:
        if not search.has_motions:
            nearest = _with_simple_parts(search, nearest)
        found = fits.estimate(nearest)
        if found is None or found.misfit < _LEAST_MISFIT:
            break
        effect = _clearest(search, nearest, found)
        if effect is None:
            break
        search.add_per_turn(effect)
        nearest = replace(nearest, per_turn=(*nearest.per_turn, effect))
        sliding = replace(nearest, reversal=nearest.reversal or 0.0)
        for each in dict.fromkeys((sliding, sliding.without("gravity"))):  # which may be an imitation
            _fit_orders(search, each, effect, found.named)
        if effect.effect == "ripple" and "gravity" in fits.optional:
            search.fit(nearest.with_part("gravity"), found.named)
        nearest, fitted = min(fits.tried, key=fits.misfit), True
    return fitted


def _with_simple_parts(search: Search, nearest: Model) -> Model:
    """The model nearest to sines after fits of gravity and sticking, which look like these effects."""
    fits, found = search.fits, search.fits.estimate(nearest)
    gravity = search.scores(nearest).get("gravity") if search.is_lost else None
    if found and gravity and gravity.gain > _SHARE * found.cost:
        fit_hanging(search)
        if search.is_lost:
            search.fit(nearest.with_part("gravity"), found.named)
        nearest = min(fits.tried, key=fits.misfit)
    if fits.misfit(nearest) < _LEAST_MISFIT:
        return nearest
    tried = set(fits.tried)
    free = freed(search, nearest)
    if free == nearest:  # no further fit starts there
        for each in fits.tried.keys() - tried:
            del fits.tried[each]
    return free


def _clearest(search: Search, model: Model, found: LikelihoodEstimate) -> PerTurn | None:
    """The absent effect that lowers the cost of a model most; None if others may explain as much.

    Where the motors turn little, the effects are like springs: they imitate gravity, which is fitted
    for comparison, slow friction, and the laws of gears.
    """
    gains = {name: score.gain for name, score in search.scores(model).items() if name != "gravity"}
    usual = _LEADING * max(gains.values(), default=0.0)
    most, best = max(_SHARE * max(found.cost - found.expected_cost, 0.0), usual), None
    # Waveforms of transmission errors in motions hold the noise of the torque.
    known = *model.effects, *search.fits.optional, *["transmission"] * search.has_motions
    if most > found.cost:
        return None
    for name, (gain, phase, straight) in _scores(search, model, found.named).items():
        if name not in known:
            order, joints = gain.argmax(axis=0), np.arange(gain.shape[1])
            highest = gain[order, joints]
            clear = 2 * highest / max(1.0, found.misfit) > chdtri(2, CHANCE / gain.size)
            like_wave = straight.sum() > _STRAIGHT * highest.sum()
            if clear.any() and (highest * clear).sum() > most and not like_wave:
                if name == "transmission":  # the other gears have one, too
                    clear = highest > 0
                most, best = (highest * clear).sum(), _effect(name, (order + 1) * clear, phase)
    return best


def with_best_orders(search: Search, best: Model) -> Model:
    """The model with the best orders of its periodic effects, together with its other parts."""
    for effect in best.per_turn:
        found = search.fits.estimate(best)
        others = {model for model in search.fits.tried if replace(model, per_turn=best.per_turn) == best}
        if found is not None and effect.effect in best.effects and len(others) == 1:
            _fit_orders(search, best.without(effect.effect), effect, _without(found, effect))
            alike = [m for m in search.fits.tried if replace(m, per_turn=best.per_turn) == best]
            best = search.fits.least(alike)
    return best


def _fit_orders(search: Search, model: Model, effect: PerTurn, near: Parameters) -> None:
    """Fit a model with an effect, of the orders that explain the data best or as well.

    Where the motors turn little, the scores of neighbouring orders are alike, and the fits decide: a
    transmission error then acts as a change of the gear ratio, which depends on the order.
    """
    moved, nearest = np.array(effect.orders) > 0, None
    for _ in range(_ROUNDS):
        found = _fitted(search, model, effect, near)
        if found is None:
            break
        near = _without(found, effect)
        gain, phase, _ = _scores(search, model, near)[effect.effect]
        if nearest is None or found.cost < nearest[1].cost:
            nearest = effect, found, gain
        before, effect = effect.orders, _effect(effect.effect, (gain.argmax(axis=0) + 1) * moved, phase)
        if effect.orders == before:
            break
    if nearest is None:
        return
    effect, found, gain = nearest
    if effect.effect == "transmission" or found.misfit > EXPLAINED:
        for j in 2 * np.flatnonzero(moved).tolist():
            best = gain[:, j].max()
            neighbours = gain[[max(effect.orders[j] - 2, 0), min(effect.orders[j], len(gain) - 1)], j]
            if np.any((neighbours > _UNDECIDED * best) & (neighbours < best)):
                effect, found = _descended(search, model, effect, found, j)


def _descended(
    search: Search, model: Model, effect: PerTurn, found: LikelihoodEstimate, j: int
) -> tuple[PerTurn, LikelihoodEstimate]:
    """The effect with the order of joint j that fits best, and its estimate."""
    for step in (-1, 1):
        order = effect.orders[j] + step
        while 1 <= order <= HIGHEST_ORDER and abs(order - effect.orders[j]) <= _MOST_STEPS:
            orders, near = np.array(effect.orders), _without(found, effect)
            orders[j] = order
            phase = _scores(search, model, near, (order,))[effect.effect].phase
            phases = tuple(
                float(phase[0, i]) if i == j else each for i, each in enumerate(effect.phases)
            )
            other = PerTurn(effect.effect, tuple(orders.tolist()), phases)
            fitted = _fitted(search, model, other, near)
            if fitted is None or fitted.cost > found.cost + _ALIKE * max(1.0, found.misfit):
                break
            if fitted.cost < found.cost:
                effect, found = other, fitted
            order += step
    return effect, found


def _fitted(
    search: Search, model: Model, effect: PerTurn, near: Parameters
) -> LikelihoodEstimate | None:
    """Estimate of the model with an effect, from parameters without it; one of each order suffices."""
    wider = _with(model, effect)
    orders = [(each.effect, each.orders) for each in wider.per_turn]
    for tried, found in search.fits.tried.items():
        same = [(each.effect, each.orders) for each in tried.per_turn] == orders
        if same and replace(tried, per_turn=wider.per_turn) == wider:
            return found if isinstance(found, LikelihoodEstimate) else None
    search.fit(wider, near, compares=False)
    return search.fits.estimate(wider)


def _without(found: LikelihoodEstimate, effect: PerTurn) -> Parameters:
    return found.named.without(effect.effect, f"{effect.effect}_quadrature")


def _effect(name: str, orders: np.ndarray, phase: Floats) -> PerTurn:
    """The effect of some orders, (n,), with the phases (k, n) at each order from 1."""
    at_order = phase[np.maximum(orders, 1) - 1, np.arange(orders.size)]
    return PerTurn(name, tuple(orders.tolist()), tuple(at_order.tolist()))


def _with(model: Model, effect: PerTurn) -> Model:
    """The model with an effect of its orders."""
    others = tuple(each for each in model.per_turn if each.effect != effect.effect)
    return replace(model.with_part(effect.effect), per_turn=(*others, effect))


def _scores(
    search: Search, model: Model, near: Parameters, orders: Sequence[int] = range(1, HIGHEST_ORDER + 1)
) -> dict[str, PerTurnScores]:
    """Scores of orders added to a model, see ``scores_per_turn``."""
    waveforms = search.completed_waveforms(model, near, model.parts)
    found, prior = search.fits.estimate(model), search.prior
    prior = prior if found is None else replace(prior, gravity=found.gravity)
    return scores_per_turn(
        search.phasors, prior, near, waveforms, search.noise, model.delay, model.effects, orders
    )
