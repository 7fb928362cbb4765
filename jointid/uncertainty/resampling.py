"""Jackknife and bootstrap: two checks of the error bars that do not use the fit's covariance.

The jackknife derives the error from the scatter between frequencies, whatever its cause; all records
share the inertias, so that their error is not in it. The bootstrap repeats the estimate on simulated
noise, with inertias and torque scales given anew each time as inaccurately as they were: uncertain
values are data, and their error is part of the whole one. With the given values as they are, the draws
would scatter by the noise alone, which is little where the prior decides.
(Efron and Tibshirani, An Introduction to the Bootstrap, 1993.)
"""

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Complexes, Floats, whole_number
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.inertia_prior import inertia_of_each
from jointid.estimation.estimators.linear_fit import LINEAR
from jointid.estimation.estimators.whitened_residual import WhitenedResidual
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.small_matrices import one_thread, root
from jointid.uncertainty.chosen_model import chosen_friction, fitted_problem, refit, require_sines
from jointid.uncertainty.information import prior_influence

_EXACT = 200
"""Degrees of freedom from which a covariance is not drawn: it varies by less than a tenth."""
_BY_PARTS = "Identify each record alone with identify_motion, and compare their K and D with the errors."


@dataclass(frozen=True, eq=False)
class Jackknife:
    """Estimates that leave out one frequency at a time."""

    frequency_hz: Floats
    """The frequency left out, shape (f,), Hz."""
    estimates: Floats
    """K1 ... Kn, D1 ... Dn without it, shape (f, 2n)."""
    standard_error: Floats
    """√((f − 1)/f Σ(p_i − p̄)²), shape (2n,), to compare with the fit's ``noise_error``; infinite where
    all other frequencies do not determine a parameter."""
    influence: Floats
    """Change of the estimate without the frequency, in standard errors of the fit, shape (f, 2n)."""


def jackknife(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    fit: ElasticityFit,
    *,
    progress: Callable[[float], None] | None = None,
) -> Jackknife:
    """Leave out one frequency at a time; the scatter checks the error bars for any kind of noise.

    ``progress`` is called with the fraction done, up to 1.0; an exception from it ends the run. Raises
    JointIdError with fewer than three frequencies, if the other records allow no estimate, or for a fit
    with motion records.
    """
    require_sines(phasors, fit, "The jackknife needs", _BY_PARTS)
    groups = phasors.by_frequency()
    if len(groups) < 3:
        raise JointIdError(
            f"The records have {len(groups)} frequencies: leaving one out in turn needs at least 3."
        )
    each = inertia_of_each(inertia, *phasors.q.shape)
    estimates, determined = [], np.isfinite(fit.standard_error)
    for done, (_, group) in enumerate(groups, start=1):
        kept = np.setdiff1d(np.arange(phasors.omega.size), group)
        with one_thread():
            left = refit(phasors.select(kept), [each[i] for i in kept], fit)
        estimates.append(left.elasticity)
        determined &= np.isfinite(np.diag(left.elasticity_covariance))
        if progress is not None:
            progress(done / len(groups))
    table, f = np.array(estimates), len(groups)
    scatter = ((table - table.mean(axis=0)) ** 2).sum(axis=0)
    error = np.where(fit.standard_error > 0, fit.standard_error, np.inf)
    return Jackknife(
        frequency_hz=np.array([omega for omega, _ in groups]) / (2 * np.pi),
        estimates=table,
        standard_error=np.where(determined, np.sqrt((f - 1) / f * scatter), np.inf),
        influence=(table - fit.estimate) / error,
    )


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Estimates from repeated simulation of the noise."""

    estimates: Floats
    """K1 ... Kn, D1 ... Dn of each draw, shape (draws, 2n)."""
    standard_error: Floats
    """Their standard deviation, shape (2n,), to compare with the fit's; infinite where that is."""
    failed: int
    """Number of draws without an estimate."""

    def interval(self, level: float = 0.95) -> Floats:
        """Lower and upper end of the central share ``level`` of the draws, shape (2, 2n)."""
        if not 0 < level < 1:
            raise JointIdError(f"level = {level!r}: must lie between 0 and 1.")
        return np.asarray(np.quantile(self.estimates, [(1 - level) / 2, (1 + level) / 2], axis=0))


def bootstrap(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    fit: ElasticityFit,
    *,
    draws: int = 200,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Bootstrap:
    """Parametric bootstrap: draw noise and given inertias, estimate again, take the scatter.

    The noise has the covariance of the phasors, times the fit's inflation. The covariance of a record of
    few periods is drawn as well, so that the weights are as uncertain as in the fit. Given inertias and
    torque scales are drawn around the fitted ones; a linear estimator carries their errors to first
    order. The friction waveforms are those of the records. 200 draws give the standard error within 5 %.
    ``progress`` is as in ``jackknife``. Raises JointIdError when fewer than half of the draws allow an
    estimate, or the fit has motion records.
    """
    require_sines(phasors, fit, "The bootstrap needs", _BY_PARTS)
    draws = whole_number("draws", draws, 2, 100_000)
    rng = np.random.default_rng(seed)
    noise = fit.equations.noise
    size = root(noise.covariance) * np.sqrt(fit.inflation)
    size *= np.any(phasors.harmonics != 0, axis=2)[..., None, None]
    centre = _explained(phasors, fit)
    prior = fit.prior.like(inertia, phasors.q.shape)
    friction = chosen_friction(phasors, fit, prior)
    found = []
    for k in range(draws):
        drawn = _with_noise(centre, _circular(rng, size), rng)
        given = prior if fit.method in LINEAR else prior.redrawn(rng, fit.parameters)
        with contextlib.suppress(JointIdError), one_thread():
            found.append(refit(drawn, given, fit, friction=friction).elasticity)
        if progress is not None:
            progress((k + 1) / draws)
    if len(found) < max(2, draws / 2):
        raise JointIdError(
            f"Only {len(found)} of {draws} draws of the noise allow an estimate: the records are too "
            "noisy for error bars. Record longer, or move the joints more."
        )
    table = np.array(found)
    if fit.method in LINEAR:
        shift = prior_influence(fit).shift
        shift = np.where(np.isfinite(shift), shift, 0.0)
        table = table + rng.standard_normal((len(table), shift.shape[1])) @ shift.T
    return Bootstrap(
        estimates=table,
        standard_error=np.where(np.isfinite(fit.standard_error), table.std(axis=0, ddof=1), np.inf),
        failed=draws - len(found),
    )


def _explained(phasors: Phasors, fit: ElasticityFit) -> Phasors:
    """Phasors without residual: those nearest to the data, in units of noise, that fit the model."""
    problem, n = fitted_problem(phasors, fit), fit.n
    smoothed = WhitenedResidual.of(problem, fit.parameters.vector).smoothed()
    harmonics = phasors.harmonics.copy()
    harmonics[:, : smoothed.shape[1]] = smoothed
    return replace(phasors, q=harmonics[:, 0, :n], tau=harmonics[:, 0, n:], harmonics=harmonics)


def _circular(rng: np.random.Generator, size: Complexes) -> Complexes:
    """Circular complex normal errors (..., 2n) by the root of their covariance."""
    shape = (*size.shape[:-1], 1)
    white = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)
    return np.asarray((size @ white)[..., 0])


def _with_noise(phasors: Phasors, error: Complexes, rng: np.random.Generator) -> Phasors:
    """Add an error (r, H, 2n), and draw the covariances of records of few periods."""
    n = phasors.n
    rounding = phasors.harmonic_rounding[..., None] * np.eye(2 * n)
    covariance = phasors.harmonic_covariance - rounding
    for record in np.flatnonzero(phasors.degrees_of_freedom < _EXACT):
        degrees = max(int(phasors.degrees_of_freedom[record]), 1)
        roots = np.repeat(root(covariance[record])[None], degrees, axis=0)
        draws = _circular(rng, roots)
        covariance[record] = np.einsum("sha,shb->hab", draws, draws.conj()) / degrees
    covariance += rounding
    # Leakage of harmonics over an incomplete period is not noise and stays.
    leaked = phasors.covariance - phasors.harmonic_covariance[:, 0]
    return replace(
        phasors,
        q=phasors.q + error[:, 0, :n],
        tau=phasors.tau + error[:, 0, n:],
        harmonics=phasors.harmonics + error,
        covariance=covariance[:, 0] + leaked,
        harmonic_covariance=covariance,
    )
