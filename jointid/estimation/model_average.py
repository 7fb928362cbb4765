"""Spread of K and D over the models that explain the same data equally well: the error of the choice."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.special import chdtri, log_ndtr, ndtri_exp

from jointid.arrays import Floats
from jointid.estimation.candidates import CHANCE, EXPLAINED, Fits, Model, fundamental_chance
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.parameters import EFFECTS, FILTERS, GEAR_LAWS, Parameters
from jointid.estimation.estimators.problem import LOWEST_LINK
from jointid.estimation.estimators.score_tests import Score
from jointid.estimation.model_growth import NARROWER, step_towards
from jointid.estimation.model_search import Search

_DOUBT, _DOUBT_IF_FAR = 0.005, 0.05
"""Probability that the score of any part widens the error bars on an ideal robot, and the same if it
moves K or D far, which few parts do."""
_FAR_OFF = 4.0
"""Standard errors of a shift that counts as far."""
_OCCAM = 1 / 20
"""Weight of a model, relative to the best, above which it explains the data equally well."""
_EVIDENCE = 3.0
"""Bayes factor above which evidence counts."""
_DRAWS = 1024
"""Points of an integral over positive values: accurate to a per cent."""
_RIDGE = 1e-12
"""Added relative variance, below that of any part."""
_RICHER_LAW = {"cubic"}, {"piecewise"}
"""A law, and one with more parameters that imitates it."""
_ORDERS, _ORDERS_IF_STICKING = 60.0, 150.0
"""Cost beyond that of the best orders of periodic effects, over the misfit, below which others count:
noise made wrong ones better by up to 45, and free friction by up to 60."""
_ALIKE = 1.2
"""Ratio of misfits up to which another width of the reversals explains motions as well."""
USUAL_LINK = 10.0
"""Link mode of a usual arm over the resonance of the joint with its motor free."""
_USUAL = {"loss_factor": 0.05, "hysteresis": 0.05}
"""Standard deviations of usual gears: of the loss factor, and of the hysteresis over the peak torque."""

_LAWS_BEYOND, _LOOPS_BEYOND = 1.0, 4.0
"""Variance that a law of the gears or friction at the arms in motions adds, over that of the noise, and
one of hysteresis: its waveform is computed in steps. They shifted K of a robot with a loop of 10 % by
0.06 %. The second holds for presliding where friction varies with speed: Dahl's model is rough then."""
_LAW_ACCURACY = np.array([2e-4, 1e-3])
"""Relative standard error of K and D by these steps: D of robots without noise was 0.04 to 0.1 % low.
The same of a friction curve by its five parts."""
_PARTS_ACCURACY = {"hysteresis": (1e-5, 2e-4)} | dict.fromkeys(
    ("piecewise", "transmission", "loss_factor"), (1e-4, 3e-4)
)
"""The same of parts in sines, by harmonics beyond those of the records: with three slopes, 90 % of the
intervals by noise alone held K, off by some 0.02 %; with hysteresis, D was 0.004 to 0.024 % low. The
torque by which transmission errors act on the motor is that of the records. No gear keeps a loss factor
exactly constant: of a chain of nine Maxwell elements K was 0.006 to 0.01 % off."""


def spread(fits: Fits, best: Model, found: LikelihoodEstimate, scores: Mapping[str, Score]) -> Floats:
    """Covariance of K and D by the choice between models, shape (2n, 2n).

    The weight of a model is exp(−Δ/2), Δ its criterion above the best one. Unlikely models are left out
    (Occam's window; Madigan and Raftery, Journal of the American Statistical Association 89, 1994). A
    part that was not fitted counts in full where its score is nearly significant, sooner where it would
    move K or D far: with uncertain inertias, a part that the records hardly show may. One that was
    fitted to a model that is not exact at the fundamentals, with free reversals for instance, may
    explain what the model lacks there: the model without it counts in full. So it does where the
    fundamentals, which give K and D, do not require the part: the harmonics may require it only because
    a waveform, or their noise, is inaccurate.
    """
    criterion, shifts, misfit = fits.criterion(), [], max(1.0, found.misfit)
    sigma = np.sqrt(np.diag(found.elasticity_covariance))
    inexact = fundamental_chance(found) < CHANCE
    extra = set(best.effects).difference(GEAR_LAWS)

    def is_doubtful(gain: float, count: int, shift: Floats) -> bool:
        doubt = _DOUBT_IF_FAR if np.any(np.abs(shift) > _FAR_OFF * sigma) else _DOUBT
        return bool(2 * gain > chdtri(count, doubt / max(len(fits.optional), 1)))

    for model in fits.tried:
        estimate = fits.estimate(model)
        if estimate is None or replace(model, per_turn=best.per_turn) == best:
            continue
        weight = float(np.exp(np.minimum(0.5 * (criterion[best] - criterion[model]), 0.0)))
        added = set(model.parts).difference(best.parts)
        lost = set(best.parts).difference(model.parts)
        if len(added) == 1 and added <= EFFECTS.keys() and (not lost or (lost, added) == _RICHER_LAW):
            gain, count = found.whole_cost(misfit) - estimate.whole_cost(misfit), estimate.p.size
            shift = estimate.elasticity - found.elasticity
            weight = max(weight, float(is_doubtful(gain, count - found.p.size, shift)))
        without_effect = estimate.misfit < EXPLAINED and any(best.without(e) == model for e in extra)
        if without_effect and (inexact or _fundamentals_are_alike(estimate, found)):
            weight = 1.0
        shifts.append((weight, estimate.elasticity - found.elasticity))
    for part, score in scores.items():
        gain, shift = score.possible
        if best.with_part(part) not in fits.tried and is_doubtful(gain / misfit, score.count, shift):
            shifts.append((1.0, shift))
    equals = [(weight, shift) for weight, shift in shifts if weight > _OCCAM]
    total = 1 + sum(weight for weight, _ in equals)
    squares = [weight / total * np.outer(shift, shift) for weight, shift in equals]
    return sum(squares, np.diag(_squares_by_orders(fits, best, found)))


def _squares_by_orders(fits: Fits, best: Model, found: LikelihoodEstimate) -> Floats:
    """Largest squared change of K and D by other orders of periodic effects, shape (2n,)."""
    if not best.orders:
        return np.zeros(found.elasticity.size)
    sticks = best.reversal is not None and best.reversal > 0
    most = found.cost + (_ORDERS_IF_STICKING if sticks else _ORDERS) * max(1.0, found.misfit)
    squares = [np.zeros(found.elasticity.size)]
    for model in fits.tried:
        estimate = fits.estimate(model)
        if estimate and estimate.cost < most and replace(model, per_turn=best.per_turn) == best:
            squares.append((estimate.elasticity - found.elasticity) ** 2)
    return np.asarray(np.max(squares, axis=0))


def _fundamentals_are_alike(narrow: LikelihoodEstimate, wide: LikelihoodEstimate) -> bool:
    """Whether a wider model lowers the cost of the fundamentals by no more than Akaike's penalty."""
    lower = np.prod(narrow.fundamental) - np.prod(wide.fundamental)
    return bool(lower <= 2 * (wide.p.size - narrow.p.size))


def spread_of_reversals(search: Search, best: Model, found: LikelihoodEstimate) -> Floats:
    """Mean square change of K and D with other reversals of the friction, shape (2n, 2n).

    Motions pass their reversals at all speeds: no one width of a reversal is right for all.
    """
    size, shifts = 2 * search.phasors.n, []
    pairs = [pair for pair in NARROWER.items() if best.reversal in pair]
    for reversal in (each for pair in pairs for each in pair if each != best.reversal):
        near, misfit = step_towards(search, replace(best, reversal=reversal), found)
        if misfit < _ALIKE * found.misfit:
            shifts.append(near[:size] - found.elasticity)
    squares = [np.outer(shift, shift) for shift in shifts or [np.zeros(size)]]
    return np.asarray(np.mean(squares, axis=0))


def spread_of_accuracy(best: Model, found: LikelihoodEstimate, *, of_motions: bool) -> Floats:
    """Covariance of K and D by the accuracy with which a model's parts are computed, shape (2n, 2n)."""
    count = found.elasticity.size
    rough = [_PARTS_ACCURACY[part] for part in best.effects if part in _PARTS_ACCURACY]
    accuracy, whole = np.max([(0.0, 0.0), *rough], axis=0), np.zeros((count, count))
    if of_motions:
        has_law = best.is_slow or "arm_coulomb" in best.effects
        accuracy = _LAW_ACCURACY if has_law or best.curve else np.zeros(2)
        if has_law or (best.curve and "motor_presliding" in best.effects):
            is_rough = "hysteresis" in best.effects or (best.curve and not best.is_slow)
            whole += (_LOOPS_BEYOND if is_rough else _LAWS_BEYOND) * found.elasticity_covariance
    return np.asarray(whole + np.diag((accuracy.repeat(count // 2) * found.elasticity) ** 2))


def spread_of_unseen(
    estimate: LikelihoodEstimate, scores: Mapping[str, Score], prior: InertiaPrior
) -> Floats:
    """Covariance of K and D by effects of usual size that a model lacks, shape (2n, 2n).

    Links bend like −s⁴c; K and M2 imitate most of it, and D most of the losses in a gear.
    """
    p, found = estimate.named, np.zeros_like(estimate.elasticity_covariance)
    never: Floats = np.full(p.K.size, np.inf)
    for name, score in scores.items():
        part, wide, usual = score, never, _USUAL.get(name, 0.0) * score.unit
        if name == "link":
            wide, usual = (prior.link_std(p.K, times) for times in (LOWEST_LINK, USUAL_LINK))
        elif name in FILTERS:
            part, wide = _in_place_of_delay(p, name, score), never[:1]
            usual = np.ones(1)  # as large as the delay
            if estimate.phasors.motion.any() and part.information[0, 0] > 0:
                # Up to the size that motions can detect: filters beside a delay shifted K by 3.5 σ.
                usual = np.sqrt(part.value**2 + 2 * max(1.0, estimate.misfit) / part.information[0])
        if np.any(usual) and np.any(part.information):
            found += spread_by_prior(part, wide, usual, max(1.0, estimate.misfit))
    return found


def spread_of_modes(found: LikelihoodEstimate, prior: InertiaPrior) -> Floats:
    """Covariance of K and D by the further terms of fitted link modes, shape (2n, 2n).

    A mode adds −s⁴c/(1 + s²c/J), of which the fit has the first term: at the highest frequency the
    share ω²c/J of it is missing, and of its change of K and D. The harmonics of nonlinear gears are
    nearer to the mode and show another c: all of a usual link may then be missing.
    """
    of_link, size = found.layout["link"], len(found.elasticity_covariance)
    c, C = np.abs(found.named["link"]), found.covariance[:, of_link]
    missing = c * np.minimum(found.phasors.omega.max() ** 2 * c / prior.link_inertia, 1.0)
    if any(law in found.layout for law in GEAR_LAWS):
        missing = np.maximum(c, prior.link_std(found.named.K, USUAL_LINK))
    if not np.isfinite(C).all():  # the records do not determine the modes, nor K and D
        return np.zeros((size, size))
    shift = C[:size] @ np.linalg.pinv(C[of_link]) * missing
    return np.asarray(shift @ shift.T)


def _in_place_of_delay(p: Parameters, name: str, score: Score) -> Score:
    """Score of filters that replace a part of a delay or of lags, along one direction.

    Filters of the position and of the logged torque change the amplitudes in opposite directions, by the
    square of a time constant, which is roughly a joint's delay.
    """
    late = p["lag"] if "lag" in p.layout else np.full(p.K.size, p.delay)
    along = np.where(name == "position_filter", 1, -1) * late**2
    pull = along @ score.information
    information = pull @ along
    return replace(
        score,
        value=np.atleast_1d(pull @ score.value / (information or 1.0)),
        information=np.atleast_2d(information),
        slope=(score.slope @ along)[:, np.newaxis],
    )


def spread_by_prior(score: Score, wide: Floats, std: Floats, misfit: float) -> Floats:
    """Covariance of K and D by an absent positive part of roughly known size, shape (2n, 2n).

    A part whose effect other parameters can imitate lowers the cost little and moves K and D far: no
    test of significance sees it. The Bayes factor with a half-normal prior of its size decides instead
    (Kass and Raftery, Journal of the American Statistical Association 90, 1995): the covariance is the
    mean square shift times the part's probability, at even prior odds, unless the evidence against the
    part is "worth more than a bare mention" on their scale, a factor of 3.
    Records that could not show a part of usual size in any direction carry no information on it: K and D
    then include this part, such as gear and link in series.

    ``score`` is that of the part, at the estimate without it; ``wide``, shape (count,), are the standard
    deviations of its prior in a fit, which the score contains, ``std`` those of the normal prior before
    its negative half is cut; ``misfit`` is a factor on the variances of the data.
    """
    fitted = std[:, np.newaxis] * score.information * std
    information = (fitted - np.diag((std / wide) ** 2)) / misfit
    eigenvalue, vectors = np.linalg.eigh(information)
    eigenvalue = np.maximum(eigenvalue, 0.0)
    covariance = (vectors / (1 + eigenvalue)) @ vectors.T
    pull = fitted @ (score.value / std) / misfit
    mean = covariance @ pull
    log_positive, second_moment = positive_moments(mean, covariance)
    log_factor = 0.5 * float(mean @ pull - np.log1p(eigenvalue).sum())
    log_factor += log_positive + std.size * np.log(2)
    if eigenvalue.max() < 1 or not log_factor > -np.log(_EVIDENCE):
        return np.zeros((len(score.slope),) * 2)
    slope = score.slope * std
    return np.asarray(slope @ second_moment @ slope.T / (1 + np.exp(-log_factor)))


def positive_moments(mean: Floats, covariance: Floats) -> tuple[float, Floats]:
    """Log probability that all n normal variables are positive, and their second moment there, (n, n).

    By importance sampling after Geweke, Hajivassiliou and Keane: each variable is drawn from its
    positive part given those before it. The points are those of the golden ratio's generalisation, with
    ``ratio``ⁿ⁺¹ = ``ratio`` + 1.
    """
    n = mean.size
    ratio = np.roots([1.0, *np.zeros(n - 1), -1.0, -1.0]).real.max()
    uniform = (0.5 + np.outer(np.arange(_DRAWS), ratio ** -np.arange(1.0, n + 1))) % 1
    factor = np.linalg.cholesky(covariance + _RIDGE * np.eye(n))
    normal, log_weight = np.zeros((_DRAWS, n)), np.zeros(_DRAWS)
    for j in range(n):
        log_tail = log_ndtr((mean[j] + normal[:, :j] @ factor[j, :j]) / factor[j, j])
        log_weight += log_tail
        normal[:, j] = -ndtri_exp(log_tail + np.log(uniform[:, j]))
    largest = log_weight.max()
    weight = np.exp(log_weight - largest)
    drawn = mean + normal @ factor.T
    second_moment = (drawn.T * weight) @ drawn / weight.sum()
    return float(largest + np.log(weight.mean())), np.asarray(second_moment)
