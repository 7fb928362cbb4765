"""The estimator behind an answer, applied again to other phasors or other inertias."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from jointid.arrays import Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.friction import FrictionWaveforms, friction_waveforms
from jointid.estimation.joint_equations import inertia_arrays, spring_equations
from jointid.estimation.likelihood import harmonic_scale, inverse_normal, maximum_likelihood, quadratic
from jointid.estimation.linear_fit import Estimate, explicit, least_squares, weighted
from jointid.estimation.residual import make_problem
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors

_GAUSS_NEWTON = 2  # steps after which inertias that are off by a per cent move the optimum no more
_LINEAR = {"least-squares": least_squares, "explicit": explicit, "weighted": weighted}


def refit(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    fit: ElasticityFit,
    *,
    delay: bool | None = None,
) -> Estimate:
    """Estimate again with the model that ``fit`` chose: same method, same friction, same delay.

    Parameters
    ----------
    phasors : Phasors
        Other records, or the same with other noise.
    inertia : Inertia or sequence of Inertia
        One for all records, or one per record.
    fit : ElasticityFit
        Says which model, and where to begin.
    delay : bool, optional
        Fit a delay, or none, whatever ``fit`` did.

    Raises
    ------
    JointIdError
        When these phasors do not allow an estimate with that model.
    """
    if fit.method in _LINEAR:
        return _LINEAR[fit.method](spring_equations(phasors, inertia))
    waveforms = None if fit.friction is None else chosen_friction(phasors, fit)
    lags = fit.delay is not None if delay is None else delay
    start = _parameters(fit, waveforms, lags)
    return maximum_likelihood(phasors, inertia, start, friction=waveforms, delay=lags)


def _parameters(fit: ElasticityFit, waveforms: FrictionWaveforms | None, lags: bool) -> Floats:
    """Parameters of the likelihood as the fit found them; of a friction curve it keeps none."""
    parts = [fit.K, fit.D]
    if fit.friction is not None and waveforms is not None:
        curve = waveforms.curve.shape[2] * waveforms.curve.shape[3]
        parts += [fit.friction.coulomb, fit.friction.viscous, np.zeros(curve)]
    if lags:
        parts.append(np.array([fit.delay or 0.0]))
    return np.concatenate(parts)


def difference_by_inertia(
    phasors: Phasors, inertia: Sequence[Inertia], fit: ElasticityFit
) -> Callable[[Sequence[Inertia], Sequence[Inertia]], Floats]:
    """Return a function of two sets of inertias that says by how much K and D differ between them.

    A linear estimator estimates twice. The likelihood's optimum is followed by Gauss-Newton steps from
    the fit, each with the weights that the harmonics have by then. Noise and friction's waveforms are
    those of the records, of which inertias change nothing.

    Parameters
    ----------
    phasors, inertia
        What ``fit`` was made from, one inertia per record.
    fit : ElasticityFit
    """
    n2 = 2 * fit.n
    if fit.method in _LINEAR:
        return lambda one, other: refit(phasors, one, fit).p[:n2] - refit(phasors, other, fit).p[:n2]
    waveforms = None if fit.friction is None else chosen_friction(phasors, fit)
    lags, noise = fit.delay is not None, fit.equations.noise
    p = _parameters(fit, waveforms, lags)
    if waveforms is not None and waveforms.curve.shape[3]:
        p = maximum_likelihood(phasors, inertia, p, friction=waveforms, delay=lags, noise=noise).p
    problem = make_problem(phasors, inertia, p, waveforms, lags, noise)

    def optimum(inertias: Sequence[Inertia]) -> Floats:
        M, arm = inertia_arrays(phasors, inertias)
        changed, x = replace(problem, M=M, arm=arm), p
        for _ in range(_GAUSS_NEWTON):
            _, scale = harmonic_scale(changed, x)
            _, gradient, normal = quadratic(changed, x, scale)
            x = x - inverse_normal(changed, normal) @ gradient
        return x[:n2]

    return lambda one, other: optimum(one) - optimum(other)


def chosen_friction(phasors: Phasors, fit: ElasticityFit) -> FrictionWaveforms:
    """Friction waveforms of these phasors in the form that the chosen model gave friction."""
    chosen = next((c for c in fit.candidates if c.chosen), None)
    if chosen is None:
        return friction_waveforms(phasors, 0.0)
    return friction_waveforms(phasors, chosen.reversal, curve=chosen.curve)


def free_reversal(fit: ElasticityFit) -> float:
    """Share of the largest velocity below which the chosen model left friction free."""
    return next((c.reversal for c in fit.candidates if c.chosen), 0.0)


def inertia_of_each(phasors: Phasors, inertia: Inertia | Sequence[Inertia]) -> list[Inertia]:
    """One inertia per record."""
    return [inertia] * phasors.omega.size if isinstance(inertia, Inertia) else list(inertia)


def parameter_names(n: int) -> tuple[str, ...]:
    """K1 ... Kn, D1 ... Dn."""
    return tuple(f"{letter}{j + 1}" for letter in "KD" for j in range(n))
