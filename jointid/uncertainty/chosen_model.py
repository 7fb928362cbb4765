"""The estimator and model of a fit, applied to other phasors or other inertias."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from jointid.arrays import Floats
from jointid.estimation.effects import EFFECTS
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.friction import FrictionWaveforms, friction_waveforms
from jointid.estimation.joint_equations import spring_equations
from jointid.estimation.likelihood import harmonic_scale, maximum_likelihood, quadratic
from jointid.estimation.linear_fit import LINEAR, Estimate
from jointid.estimation.residual import make_problem
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.small_matrices import positive_inverse

_GAUSS_NEWTON = 2
"""Steps that follow the optimum when an inertia changes by a per cent."""


def refit(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    fit: ElasticityFit,
    *,
    delay: bool | None = None,
) -> Estimate:
    """Estimate again with the model of ``fit``: same method, same friction, same delay.

    Parameters
    ----------
    phasors : Phasors
        Other records, or the same records with other noise.
    inertia : Inertia or sequence of Inertia
        One for all records, or one per record.
    fit : ElasticityFit
        Gives the model and the start values.
    delay : bool, optional
        Fit a delay or not; by default as in ``fit``.

    Raises
    ------
    JointIdError
        When these phasors do not allow an estimate with that model.
    """
    if fit.method in LINEAR:
        return LINEAR[fit.method](spring_equations(phasors, inertia))
    return maximum_likelihood(
        phasors,
        fit.prior.like(inertia, phasors.q.shape),
        fit.parameters,
        friction=None if fit.friction is None else chosen_friction(phasors, fit),
        delay=fit.delay is not None if delay is None else delay,
        effects=[name for name in EFFECTS if name in fit.parameters.layout],
    )


def difference_by_inertia(
    phasors: Phasors, inertia: Sequence[Inertia], fit: ElasticityFit
) -> Callable[[Sequence[Inertia], Sequence[Inertia]], Floats]:
    """Return a function that gives the difference of K and D between two sets of inertias.

    A linear estimator is evaluated twice. The optimum of the likelihood is followed from the fit by
    Gauss-Newton steps with updated weights. Noise and friction waveforms depend on the records only.

    Parameters
    ----------
    phasors, inertia
        Data of ``fit``, one inertia per record.
    fit : ElasticityFit
    """
    if fit.method in LINEAR:
        return lambda one, other: (
            refit(phasors, one, fit).elasticity - refit(phasors, other, fit).elasticity
        )
    waveforms = None if fit.friction is None else chosen_friction(phasors, fit)
    layout, p = fit.parameters.layout, fit.parameters.vector
    shape = phasors.q.shape
    prior = fit.prior.like(inertia, shape)
    problem = make_problem(phasors, prior, layout, fit.K, waveforms, fit.equations.noise)

    def optimum(inertias: Sequence[Inertia]) -> Floats:
        changed, x = replace(problem, prior=fit.prior.like(inertias, shape)), p
        for _ in range(_GAUSS_NEWTON):
            _, _, normal = quadratic(changed, x, np.ones(changed.s.shape[1]))
            _, scale, _ = harmonic_scale(changed, x, normal)
            _, gradient, normal = quadratic(changed, x, scale)
            x = x - positive_inverse(normal) @ gradient
        return x[layout.span("K", "D")]

    return lambda one, other: optimum(one) - optimum(other)


def chosen_friction(phasors: Phasors, fit: ElasticityFit) -> FrictionWaveforms:
    """Friction waveforms of these phasors for the friction model of the fit."""
    chosen = next((c for c in fit.candidates if c.chosen), None)
    if chosen is None:
        return friction_waveforms(phasors, 0.0)
    return friction_waveforms(phasors, chosen.reversal, curve=chosen.curve)


def free_reversal(fit: ElasticityFit) -> float:
    """Share of the largest velocity below which friction is free in the chosen model."""
    return next((c.reversal for c in fit.candidates if c.chosen), 0.0)


def inertia_of_each(phasors: Phasors, inertia: Inertia | Sequence[Inertia]) -> list[Inertia]:
    """One inertia per record."""
    return [inertia] * phasors.omega.size if isinstance(inertia, Inertia) else list(inertia)
