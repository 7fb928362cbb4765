"""The estimator and model of a fit, applied to other phasors or other inertias."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointid.errors import JointIdError
from jointid.estimation.candidates import Model
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.linear_fit import LINEAR, Estimate
from jointid.estimation.estimators.maximum_likelihood import maximum_likelihood
from jointid.estimation.estimators.parameters import EFFECTS, Parameters
from jointid.estimation.estimators.problem import Problem, make_problem
from jointid.estimation.model_fits import completed, filters_before_friction
from jointid.joints import Inertia
from jointid.motion.friction import FrictionWaveforms, friction_waveforms
from jointid.phasors.extract import Phasors
from jointid.simulation.experiment import MotorFriction

_LEAST_STIFFNESS = 1e-9
"""In place of an estimate of zero, N·m/rad."""


def require_sines(phasors: Phasors, fit: ElasticityFit, use: str, remedy: str) -> None:
    """Refuse a fit with motion records, whose spectral lines are no records of their own."""
    if len(fit.inertias) != fit.phasors.omega.size:
        raise JointIdError(f"{use} a fit of sine records alone; this one has motion records. {remedy}")
    phasors.require_records()


def identified_friction(fit: ElasticityFit, *, step_s: float = 1.25e-4) -> MotorFriction:
    """Friction of a fit for the simulated robot; negative estimates count as none.

    Coulomb friction at the arm and presliding friction count as Coulomb friction of the motors.
    """
    p, own = fit.parameters, fit.friction
    friction = {
        "coulomb": 0.0 if own is None else np.maximum(own.coulomb, 0.0),
        "viscous": p.effect("viscous"),
        "load": p.effect("load"),
        "arm_viscous": p.effect("arm_viscous"),
    }
    friction["coulomb"] = friction["coulomb"] + p.effect("arm_coulomb") + p.effect("motor_presliding")
    each = {name: np.maximum(np.zeros(fit.n), part) for name, part in friction.items()}
    return MotorFriction(**each, step_s=step_s)


def refit(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia] | InertiaPrior,
    fit: ElasticityFit,
    *,
    friction: FrictionWaveforms | None = None,
) -> Estimate:
    """Estimate again with the model of ``fit``: same method, friction, delay, effects and prior.

    ``phasors`` are other records, or the same records with other noise; ``inertia`` is one for all
    records or one per record, as uncertain as in ``fit``, or a prior of its own; ``fit`` also gives the
    start values, and ``friction`` the waveforms of its friction, by default those of the phasors. Raises
    JointIdError when these phasors do not allow an estimate with that model.
    """
    if not isinstance(inertia, InertiaPrior):
        inertia = fit.prior.like(inertia, phasors.q.shape)
    if fit.method in LINEAR:
        each = inertia.inertias(inertia.M, inertia.M2)
        return LINEAR[fit.method](spring_equations(phasors, each))
    if friction is None:
        friction = chosen_friction(phasors, fit, inertia)
    return maximum_likelihood(
        phasors,
        inertia,
        fit.parameters,
        friction=friction,
        delay=fit.delay is not None,
        effects=[name for name in EFFECTS if name in fit.parameters.layout],
    )


def fitted_problem(phasors: Phasors, fit: ElasticityFit) -> Problem:
    """Return the residual that ``fit`` made small, for its ``parameters.vector``.

    A linear estimator has that of the fundamentals alone.
    """
    noise = fit.equations.noise
    if fit.method in LINEAR:
        phasors = replace(phasors, harmonics=phasors.harmonics[:, :1])
        noise = replace(noise, covariance=noise.covariance[:, :1])
    friction = chosen_friction(phasors, fit)
    layout, vector = fit.parameters.layout, fit.parameters.vector.copy()
    vector[layout["K"]] = np.maximum(np.abs(fit.K), _LEAST_STIFFNESS)
    prior = fit.prior if fit.gravity is None else replace(fit.prior, gravity=fit.gravity)
    return make_problem(phasors, prior, layout, layout.named(vector), friction, noise)


def chosen_friction(
    phasors: Phasors,
    fit: ElasticityFit,
    prior: InertiaPrior | None = None,
    parameters: Parameters | None = None,
) -> FrictionWaveforms | None:
    """Friction waveforms of these phasors for the model of the fit, if that has Coulomb friction.

    Of other records than those of the fit, ``prior`` holds the inertias; ``parameters`` replace those
    of the fit.
    """
    if "coulomb" not in fit.parameters.layout:
        return None
    model = next((c.model for c in fit.candidates if c.chosen), Model(0.0, delay=False))
    p = parameters or fit.parameters
    filters = filters_before_friction(model, p)
    waveforms = friction_waveforms(
        phasors, model.reversal or 0.0, curve=model.curve, position_filter=filters
    )
    prior = prior or fit.prior
    return completed(waveforms, model, phasors, prior, p)
