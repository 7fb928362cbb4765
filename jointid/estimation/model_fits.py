"""Fit of one candidate model: its friction waveforms, its estimate and its residual."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import NEEDED, Model
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.levenberg_marquardt import one_step
from jointid.estimation.estimators.linear_fit import without_inertias
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate, maximum_likelihood
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import EFFECTS, ParameterLayout, Parameters
from jointid.estimation.estimators.problem import fitted_layout, make_problem
from jointid.estimation.estimators.whitened_residual import (
    WhitenedResidual,
    near_solution,
    with_law_signals,
)
from jointid.estimation.regression_start import regressed, regression_start
from jointid.motion.end_terms import motor_motion
from jointid.motion.friction import (
    FrictionWaveforms,
    friction_waveforms,
    gear_torque_of,
    with_levels,
    with_load,
)
from jointid.motion.per_turn import with_turns
from jointid.phasors.extract import Phasors

_SAME_FILTER = 0.02
"""Relative difference between time constants below which friction keeps its waveforms. Beyond it they
are renewed once: ``friction_advance`` follows the time constant to first order; the square of the
difference is left."""
_SAME_WAVEFORM = 0.005
"""Relative change of friction that follows from the parameters, below which a model keeps its first fit:
the friction itself is some 5 % of the torque."""
_HELD = 0.1
"""Share of the motors' motions within their noise from which several start values are tried."""
_STIFFNESSES = 1.0, 3.0, 10.0, 0.3, 2.0, 5.0, 0.6, 0.1, 20.0, 7.0, 1.5, 0.03
"""How stiff regressions assume gears that records with held joints hardly show: four per joint beyond
the second. A fit from one of them was near in 4 of 10 cases of two to four moving axes of six."""
_NEAR, _SAME = 1.25, 1.01
"""Misfit below which no other start values are tried, and ratio of costs of the same minimum."""


def filters_before_friction(model: Model, p: Parameters | None) -> Floats | None:
    """Time constants of the position filters that are removed from a model's friction, shape (n,), s."""
    if p is None or "position_filter" not in model.effects or "position_filter" not in p.layout:
        return None
    return p["position_filter"]


def model_waveforms(
    phasors: Phasors, model: Model, p: Parameters | None = None
) -> FrictionWaveforms | None:
    """Friction waveforms of a model, with the position filters of ``p``; None without friction."""
    if model.reversal is None:
        return None
    return friction_waveforms(
        phasors,
        model.reversal,
        curve=model.curve,
        position_filter=filters_before_friction(model, p),
    )


def completed(
    waveforms: FrictionWaveforms | None,
    model: Model,
    phasors: Phasors,
    prior: InertiaPrior,
    p: Parameters,
    parts: Sequence[str] | None = None,
) -> FrictionWaveforms | None:
    """Friction waveforms of a model with those that follow from some parameters.

    These are the part that differs from record to record, and periodic effects and load-dependent
    friction by the gear torque, of other ``parts`` than those of the model where they are given.
    """
    parts = model.effects if parts is None else parts
    effects = [each for each in model.per_turn if each.effect in parts]
    if waveforms is None:
        return None
    if model.differs and "coulomb" in p.layout:
        friction = (p[name] / p.torque_scale for name in ("coulomb", "viscous"))
        waveforms = with_levels(waveforms, phasors, *friction)
    if not (effects or "load" in parts):
        return waveforms
    loaded = "load" in parts
    torque = gear_torque_of(waveforms, phasors, prior.motors(phasors, p), loaded=loaded)
    waveforms = with_turns(waveforms, phasors, effects, torque)
    return with_load(waveforms, phasors, torque) if loaded else waveforms


def fit_model(
    phasors: Phasors,
    prior: InertiaPrior,
    start: Floats | Parameters,
    noise: Noise,
    model: Model,
    waveforms: FrictionWaveforms | None = None,
    *,
    is_near: bool = False,
) -> LikelihoodEstimate:
    """Fit one model; its friction waveforms may be given, and the start may come from few records.

    Raises JointIdError when the model does not fit, or its parameters overflow.
    """
    waveforms = waveforms or model_waveforms(phasors, model)
    if not isinstance(start, Parameters):
        start = ParameterLayout.of(phasors.n).named(start)

    def at(p: Parameters) -> FrictionWaveforms | None:
        return completed(waveforms, model, phasors, prior, p)

    def fitted(start: Parameters, friction: FrictionWaveforms | None) -> LikelihoodEstimate:
        return maximum_likelihood(
            phasors,
            prior,
            start,
            friction=friction,
            delay=model.delay,
            effects=model.effects,
            noise=noise,
            is_near=is_near,
        )

    try:
        with np.errstate(over="ignore", invalid="ignore"):
            friction = at(start)
            estimate = fitted(start, friction)
            if not np.isfinite(estimate.cost):  # the gear's motion diverges from some starts
                raise np.linalg.LinAlgError("not finite")
            # Load-dependent friction and, in motions, the arms' directions follow from the parameters.
            turned = "arm_coulomb" in model.effects and phasors.motion.any()
            follows = {"load", "transmission"}.intersection(model.effects)
            own = model.differs and "coulomb" not in start.layout
            same = not (turned or own) and not (follows and _differ(friction, at(estimate.named)))
            if waveforms and "position_filter" in model.effects and not phasors.motion.any():
                found = estimate.named["position_filter"]
                if not np.allclose(found, waveforms.position_filter, rtol=_SAME_FILTER):
                    waveforms, same = model_waveforms(phasors, model, estimate.named), False
            return estimate if same else fitted(estimate.named, at(estimate.named))
    except np.linalg.LinAlgError as error:
        raise JointIdError("The model does not fit: its parameters overflow.") from error


def _differ(one: FrictionWaveforms | None, other: FrictionWaveforms | None) -> bool:
    """Whether waveforms that follow from the parameters differ between two sets of them."""
    if one is None or other is None:
        return one is not other
    before, after = ({**each.further, **each.deflection} for each in (one, other))
    pairs = ((before[name], after[name]) for name in before)
    return any(np.linalg.norm(a - b) > _SAME_WAVEFORM * np.linalg.norm(b) for a, b in pairs)


def freest(phasors: Phasors, base: Model, optional: Sequence[str]) -> Model:
    """The model with friction and delays that wrong inertias and start values affect least.

    ``base`` where friction is not optional, or there are no harmonics, which free friction needs.
    """
    if "friction" not in optional or phasors.harmonics.shape[1] == 1:
        return base
    if "lag" in optional and phasors.n > 1 and not (base.delay or phasors.motion.any()):
        return replace(base, reversal=0.03, effects=("lag",))
    return replace(base, reversal=0.03, delay=base.delay or "delay" in optional)


def start_with_friction(
    phasors: Phasors, prior: InertiaPrior, linear: Parameters, noise: Noise, base: Model
) -> Parameters:
    """Start values with friction and a common unknown as the payload; without either, the linear ones.

    Where M2 has a common unknown, a fit of it with otherwise exact inertias comes first: with all
    inertias free, small ones of a wrist stop at their bounds far from the optimum. So do fits where
    friction holds joints.
    """
    start, model = regression_start(phasors, prior), replace(base, reversal=0.03)
    exact = replace(prior, inertia_std=0.0) if 0 < prior.inertia_std < np.inf else prior
    if friction_waveforms(phasors, None).stationary.mean() > _HELD:
        return _start_with_held(phasors, prior, exact, start, noise, model)
    if not prior.shared.any():
        return start if "coulomb" in start.layout else linear
    if exact is not prior:
        with suppress(JointIdError):
            return fit_model(phasors, exact, start, noise, model).named
    return start


def _start_with_held(
    phasors: Phasors,
    prior: InertiaPrior,
    exact: InertiaPrior,
    start: Parameters,
    noise: Noise,
    model: Model,
) -> Parameters:
    """The nearest fit from several start values, where friction holds joints.

    Resonances of the arm with held joints, whose K records hardly show, make many local minima. Inertias
    that are free from the start lead to more of them. Two starts with the same minimum are enough.
    """
    found: list[LikelihoodEstimate] = []
    for stiff in (None, *_STIFFNESSES[: 4 * max(phasors.n - 2, 0)]):
        near = start if stiff is None else regressed(phasors, exact, stiff=stiff)[0]
        with suppress(JointIdError):
            estimate = fit_model(phasors, exact, near, noise, model)
            if estimate.misfit < _NEAR:
                return estimate.named
            if exact is not prior:
                estimate = fit_model(phasors, prior, estimate.named, noise, model)
            found = sorted([*found, estimate], key=lambda each: each.whole_cost(1))
        if len(found) > 1 and found[1].whole_cost(1) < _SAME * found[0].whole_cost(1):
            break
    return found[0].named if found else start


def fit_without_inertias(
    phasors: Phasors, prior: InertiaPrior, start: Floats | Parameters, noise: Noise, model: Model
) -> LikelihoodEstimate | None:
    """The better fit with uncertain inertias, from a start with and one without the given ones."""
    found: list[LikelihoodEstimate] = []
    for each in (start, without_inertias(phasors, prior)):
        if each is not None and not (found and found[0].misfit < NEEDED):
            with suppress(JointIdError):
                found.append(fit_model(phasors, prior, each, noise, model))
    return min(found, key=lambda estimate: estimate.misfit, default=None)


def evaluated(
    phasors: Phasors,
    prior: InertiaPrior,
    model: Model,
    estimate: LikelihoodEstimate,
    noise: Noise,
    scale: Floats,
) -> WhitenedResidual:
    """Residual of a model at its estimate; ``scale`` multiplies the variances as in a fit.

    That which the fit kept is not evaluated again. Raises JointIdError when the deflection of gears in
    motions is not found again.
    """
    if estimate.residual is not None and scale is estimate.scale:
        kept = estimate.residual
        problem = replace(kept.at.problem, motion=motor_motion(phasors))
        return replace(kept, at=replace(kept.at, problem=problem))
    prior = replace(prior, gravity=estimate.gravity)
    waveforms = model_waveforms(phasors, model, estimate.named)
    waveforms = completed(waveforms, model, phasors, prior, estimate.named)
    problem = make_problem(phasors, prior, estimate.layout, estimate.named, waveforms, noise)
    problem = near_solution(replace(problem, motion=motor_motion(phasors)), estimate.wound)
    problem = with_law_signals(problem, estimate.p)
    found = WhitenedResidual.of(problem, estimate.p, scale)
    if not np.isfinite(found.cost):
        raise JointIdError(
            "The gear law has no solution: the arm computed from the measured motor motion diverges. "
            'Identify with gear="linear", or record sines.'
        )
    return found


def record_costs(phasors: Phasors, prior: InertiaPrior, p: Parameters, noise: Noise) -> Floats:
    """Cost of each record, shape (r,), at the parameters of a fit; friction is free near reversals."""
    effects = tuple(name for name in EFFECTS if name in p.layout)
    rubs, curve = "coulomb" in p.layout, "curve" in p.layout and p["curve"].size > 0
    model = Model(0.1 if rubs else None, "delay" in p.layout, curve, effects)
    waveforms = completed(model_waveforms(phasors, model, p), model, phasors, prior, p)
    problem = make_problem(phasors, prior, p.layout, p, waveforms, noise)
    rows = WhitenedResidual.of(with_law_signals(problem, p.vector), p.vector).rows
    return np.asarray((rows**2).sum(axis=1))


def stepped(
    phasors: Phasors,
    prior: InertiaPrior,
    estimate: LikelihoodEstimate,
    noise: Noise,
    model: Model,
    waveforms: FrictionWaveforms | None = None,
) -> tuple[Floats, float]:
    """Parameters and misfit of a model one step from the estimate of a similar one."""
    prior = replace(prior, gravity=estimate.gravity)
    waveforms = waveforms or model_waveforms(phasors, model, estimate.named)
    waveforms = completed(waveforms, model, phasors, prior, estimate.named)
    layout = fitted_layout(prior, waveforms, model.delay, model.effects)
    problem = make_problem(phasors, prior, layout, estimate.named, waveforms, noise)
    problem, p = near_solution(problem, estimate.wound), problem.start(estimate.named)
    return one_step(with_law_signals(problem, p), p)
