"""Noise of motions, from the residual of a fitted model, and of sines in the same study."""

import contextlib
import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import EXPLAINED, Model, dissipates
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.noise import Noise, floored, sensor_noise
from jointid.estimation.estimators.parameters import Parameters
from jointid.estimation.model_fits import evaluated, fit_model, stepped
from jointid.estimation.model_selection import FAR, LOOSE
from jointid.estimation.regression_start import regression_start
from jointid.estimation.start_values import at_resonances
from jointid.motion.noise import logged_noise
from jointid.phasors.extract import Phasors
from jointid.phasors.segment import Motors

_CHANCE, _MATTERS = 1e-4, 2.0
"""Probability of a lower cost with other inertias by noise alone, that contradicts them, and change of K
or D by them that matters, in their stated standard errors."""
SAME, SAME_OF_MANY = 0.1, 0.3
"""Relative change of the variances above which the models are compared again; the second for many
equations, whose noise is already that of the chosen model."""
_OTHER_FRICTION = 0.3
"""Relative change of the unknown friction above which they are, too: a curve adds to it at rest."""
_LEAST_LEFT, _CLEAREST = 0.02, 0.3
"""Smallest share of a joint's equations in a segment that free friction leaves, and share above which
the segment shows the noise; if no segment does, those with the largest share are used."""
_BETTER = 0.9
"""Ratio of misfits from which a richer friction model is better."""
_NOISES = 4
"""Estimates of the noise from the first segments of many."""
_POOR, _FAR_BETTER = 1.5, 0.3
"""Misfit above which friction of motors at rest may bias the start; ratio that shows a better one."""
_DIFFERS = 0.8
"""Ratio of misfits from which friction differs from segment to segment; it is 0.96 or more where it does
not, 0.6 to 0.8 where it falls by 5 % over three records."""
_LATEST = 0.2
"""Largest share of a motor's velocity at which friction may have turned it back: more is friction in a
wrong unit, with which all of the motion would be a reversal."""


def with_noise(
    phasors: Phasors, prior: InertiaPrior, model: Model, estimate: LikelihoodEstimate | JointIdError
) -> Phasors:
    """Phasors with the noise of motions from the residual of a fitted model."""
    if not phasors.motion.any() or isinstance(estimate, JointIdError):
        return phasors
    unweighted: Floats = np.ones(phasors.harmonics.shape[1])
    residual = evaluated(phasors, prior, model, estimate, noise_of_rows(phasors, prior), unweighted)
    left = residual.at.r - residual.free_friction()
    rows = 2.0 * phasors.harmonics[..., : phasors.n].any(axis=2).sum(axis=1)[:, None]
    share = np.where(residual.at.problem.used, residual.projection.noise_left(rows) / rows, 0)
    clear = share >= np.clip(share[phasors.motion].max(axis=0), _LEAST_LEFT, _CLEAREST)
    left *= np.sqrt(1 / np.where(clear, share, np.nan))[:, None]
    torques = sensor_noise(phasors, left, residual.at.E)
    return with_torque_noise(phasors, prior, torques, prior.motors(phasors, estimate.named))


def with_torque_noise(
    phasors: Phasors, prior: InertiaPrior, torques: dict[int, Floats], motors: Sequence[Motors]
) -> Phasors:
    """Phasors with the noise of the torques of each motion record, the usual one of those not given.

    ``torques`` are variances (n,); NaN leaves that of the segments.
    """
    usual: Floats = np.mean([*torques.values()], axis=0)
    covariance, segments = phasors.harmonic_covariance.copy(), list(phasors.segments)
    shown = [np.abs(each.torque).max(axis=1) for each in phasors.segments if each is not None]
    overcome = np.max(shown, axis=0)  # a motor that moves anywhere has no more Coulomb friction
    for row, segment in enumerate(phasors.segments):
        if segment is not None:
            least, most = segment.least_torque_variance, segment.most_torque_variance
            torque = torques.get(segment.record, usual)
            torque = np.where(np.isnan(torque), segment.torque_variance, torque)
            torque = np.clip(torque, least, np.maximum(most, least))
            braked = np.maximum(segment.friction_at_reversals(motors[row]), 0)
            unknown = np.minimum(braked / motors[row].torque_scale, overcome)
            late = braked / prior.M[prior.rotor[row]] * segment.velocity_blur_s
            late = np.minimum(late, _LATEST * np.abs(segment.velocity).max(axis=1))
            own = replace(segment, torque_variance=torque, turn_rad_s=late, unknown_Nm=unknown)
            segments[row], covariance[row, : own.highest] = own, own.covariance
    return replace(phasors, harmonic_covariance=covariance, segments=tuple(segments))


def times_logged_noise(phasors: Phasors) -> float:
    """Variance of the torques' noise by the residual of motions over that in their logs; largest joint.

    That of a record is the largest of its parts between gaps.
    """
    own = [each for each in phasors.segments if each is not None]
    parts = {id(each.torque): each for each in own}  # segments of a part share its torque
    logged: dict[int, Floats] = {}
    for each in parts.values():
        before = logged.get(each.record, np.zeros(len(each.torque)))
        logged[each.record] = np.maximum(before, logged_noise(each.torque))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = [each.torque_variance / logged[each.record] for each in own]
    return float(np.nan_to_num(np.mean(ratios, axis=0)).max())


def noise_differs(one: Phasors, other: Phasors, same: float = SAME) -> bool:
    """Whether the variances of motions differ by more than ``same`` times the smaller (RMS).

    Or the friction that is unknown near reversals by ``_OTHER_FRICTION``. Sines alone have neither.
    """
    if not one.motion.any():
        return False
    variances = (
        np.einsum("rhjj->rj", each.harmonic_covariance[one.motion]).real for each in (one, other)
    )
    unknown = (
        np.stack([own.unknown_Nm * np.ones(each.n) for own in each.segments if own is not None])
        for each in (one, other)
    )
    return _change(*variances) > same or _change(*unknown) > _OTHER_FRICTION


def _change(before: Floats, after: Floats) -> float:
    """Largest relative change of a joint's values, (r, n), over the smaller ones (RMS)."""
    least = np.minimum(before, after)
    change = np.divide(before - after, least, out=np.zeros_like(least), where=least > 0)
    return float(np.sqrt(np.mean(change**2, axis=0)).max())


def noise_of_rows(phasors: Phasors, prior: InertiaPrior) -> Noise:
    """Noise of sines as in their own analysis, and that of motions as stated by their phasors."""
    covariance = phasors.harmonic_covariance.copy()
    degrees = phasors.degrees_of_freedom.copy()
    sines = np.flatnonzero(~phasors.motion)
    if sines.size:
        inertias = prior.inertias(prior.M, prior.M2)
        own = spring_equations(phasors.select(sines), [inertias[k] for k in sines]).noise
        covariance[sines], degrees[sines] = own.covariance, own.degrees_of_freedom
    return Noise(floored(covariance, phasors.harmonics), degrees)


def with_first_noise(
    phasors: Phasors,
    prior: InertiaPrior,
    rows: np.ndarray,
    start: Parameters,
    *,
    many: bool,
    gives_up: Callable[[], bool],
) -> tuple[Phasors, Floats | Parameters, tuple[Model, ...], float]:
    """Phasors with the noise from a fit of some rows, its parameters and model, and what misfit is far.

    Any is, once that fit was far: its noise hides it. With ``many`` equations the noise is estimated
    several times.
    """
    if not phasors.motion.any():
        return phasors, start, (), FAR
    if "coulomb" in start.layout:
        size = np.maximum(start["coulomb"], 0.0)
        bounded = [each and replace(each, unknown_Nm=size) for each in phasors.segments]
        phasors = replace(phasors, segments=tuple(bounded))
    first = _first_fit(phasors.select(rows), prior.of_rows(rows), start, gives_up)
    if first is None:
        return phasors, start, (), FAR
    model, found = first
    far = FAR if found.misfit < FAR else 0.0
    phasors = with_noise(phasors, prior, model, found)
    for _ in range(_NOISES if many else 1):
        before = phasors
        with contextlib.suppress(JointIdError):  # the weights of the earlier fit were wrong
            noise = noise_of_rows(phasors, prior)
            moved = replace(found, p=stepped(phasors, prior, found, noise, model)[0])
            phasors, found = with_noise(phasors, prior, model, moved), moved
        if not noise_differs(before, phasors):
            break
    return phasors, found.named if "coulomb" in found.layout else found.elasticity, (model,), far


def _first_fit(
    phasors: Phasors, prior: InertiaPrior, start: Parameters, gives_up: Callable[[], bool]
) -> tuple[Model, LikelihoodEstimate] | None:
    """A model and its fit; where that stays far from the data, from further start values.

    These are a regression with a delay, and resonances.
    """
    noise = noise_of_rows(phasors, prior)
    best = _fit_from(phasors, prior, start, noise)
    if (best is not None and best[1].misfit < _POOR) or "coulomb" not in start.layout or gives_up():
        return best
    others = itertools.chain(
        [regression_start(phasors, prior, lags=True)], at_resonances(phasors, prior, friction=start)
    )
    for other in others:
        again = _fit_from(phasors, prior, other, noise)
        if again and (best is None or again[1].misfit < _FAR_BETTER * best[1].misfit):
            return again
    return best


def _fit_from(
    phasors: Phasors, prior: InertiaPrior, start: Parameters, noise: Noise
) -> tuple[Model, LikelihoodEstimate] | None:
    """A model with friction, where the records show it, and what explains far more.

    That is friction that differs from segment to segment, or a delay.
    """
    best: tuple[Model, LikelihoodEstimate] | None = None
    rubs = Model(0.0, delay=False)
    for model in (Model(None, delay=False), rubs)["coulomb" in start.layout :]:
        with contextlib.suppress(JointIdError):
            richer = fit_model(phasors, prior, start, noise, model)
            if best and (richer.misfit > _BETTER * best[1].misfit or not dissipates(richer)):
                break
            best = model, richer
    if best is not None and best[0].reversal is not None:
        model, found = best
        with contextlib.suppress(JointIdError):
            own = replace(model, differs=True)
            if stepped(phasors, prior, found, noise, own)[1] < _DIFFERS * found.misfit:
                best = own, fit_model(phasors, prior, found.named, noise, own)
    if best is not None:
        model, found = best
        with contextlib.suppress(JointIdError):  # for example of a hold that is not declared
            late = replace(model, delay=True)
            richer = fit_model(phasors, prior, found.named, noise, late)
            if richer.misfit < _FAR_BETTER * found.misfit:
                best = late, richer
    return best


def contradicts_inertias(
    phasors: Phasors,
    prior: InertiaPrior,
    estimate: LikelihoodEstimate,
    noise: Noise,
    model: Model,
    error: Floats,
) -> bool:
    """Whether other inertias than those given as exact explain motions, with another K or D.

    ``error`` is the stated standard error of K and D, shape (2n,). The noise of motions is that of the
    residual, so that no misfit shows wrong inertias. Beside a misfit that other inertias leave, they
    would imitate what the model lacks.
    """
    if prior.inertia_std != 0:
        return False
    loose = replace(prior, inertia_std=LOOSE)
    try:
        free = fit_model(phasors, loose, estimate.named, noise, model, is_near=True)
    except JointIdError:
        return False
    added = sum(value.size for value, _ in loose.blocks().values())
    gain = 2 * (estimate.cost - free.cost) / max(1.0, free.misfit)
    matters = bool(np.any(np.abs(free.elasticity - estimate.elasticity) > _MATTERS * error))
    explains = free.misfit < EXPLAINED
    return explains and matters and bool(chdtrc(added, max(gain, 0.0)) < _CHANCE)
