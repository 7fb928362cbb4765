"""The estimator behind an answer, applied again to other phasors or other inertias."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jointid.elasticity import ElasticityFit
from jointid.friction import FrictionWaveforms, friction_waveforms
from jointid.joints import Inertia
from jointid.likelihood import maximum_likelihood
from jointid.linear_fit import Estimate, explicit, least_squares, weighted
from jointid.phasors import Phasors
from jointid.springs import spring_equations

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
    start = [fit.K, fit.D]
    if fit.friction is not None and waveforms is not None:
        parts = waveforms.curve.shape[2] * waveforms.curve.shape[3]
        start += [fit.friction.coulomb, fit.friction.viscous, np.zeros(parts)]
    if lags:
        start.append(np.array([fit.delay or 0.0]))
    return maximum_likelihood(phasors, inertia, np.concatenate(start), friction=waveforms, delay=lags)


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
