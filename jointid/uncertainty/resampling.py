"""Two checks of the error bars that do not use the fit's covariance: jackknife and bootstrap.

The jackknife takes the scatter between frequencies for the error, whatever its cause. The bootstrap
repeats the estimate on drawn noise. (Efron and Tibshirani, An Introduction to the Bootstrap, 1993.)
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.elasticity import ElasticityFit
from jointid.errors import JointIdError
from jointid.joints import Inertia
from jointid.phasors import Phasors
from jointid.small_matrices import whitener
from jointid.springs import spring_equations
from jointid.uncertainty.chosen_model import inertia_of_each, refit

_EXACT_FREEDOM = 200  # a covariance of so many degrees of freedom is not worth drawing


@dataclass(frozen=True, eq=False)
class Jackknife:
    """The estimate without each frequency in turn."""

    frequency_hz: Floats
    """The frequency left out, shape (f,), Hz."""
    estimates: Floats
    """K1 ... Kn, D1 ... Dn without it, shape (f, 2n)."""
    standard_error: Floats
    """√((f − 1)/f Σ(p_i − p̄)²), shape (2n,)."""
    influence: Floats
    """What leaving a frequency out changes, in standard errors of the fit, shape (f, 2n)."""


def jackknife(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    fit: ElasticityFit,
    *,
    progress: Callable[[float], None] | None = None,
) -> Jackknife:
    """Leave one frequency out at a time; the scatter checks the error bars, whatever the noise is.

    Parameters
    ----------
    phasors, inertia, fit
        The analysis.
    progress : callable, optional
        Called with the fraction done, up to 1.0. What it raises ends the run.

    Raises
    ------
    JointIdError
        With fewer than three frequencies, or when the rest does not allow an estimate.
    """
    groups = phasors.by_frequency()
    if len(groups) < 3:
        raise JointIdError(
            f"The records have {len(groups)} frequencies: leaving one out in turn needs at least 3."
        )
    each = inertia_of_each(phasors, inertia)
    n, estimates = fit.n, []
    for done, (_, group) in enumerate(groups, start=1):
        kept = np.setdiff1d(np.arange(phasors.omega.size), group)
        estimates.append(refit(phasors.select(kept), [each[i] for i in kept], fit).p[: 2 * n])
        if progress is not None:
            progress(done / len(groups))
    table, f = np.array(estimates), len(groups)
    scatter = ((table - table.mean(axis=0)) ** 2).sum(axis=0)
    error = np.where(fit.standard_error > 0, fit.standard_error, np.inf)
    return Jackknife(
        frequency_hz=np.array([omega for omega, _ in groups]) / (2 * np.pi),
        estimates=table,
        standard_error=np.sqrt((f - 1) / f * scatter),
        influence=(table - np.concatenate([fit.K, fit.D])) / error,
    )


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Estimates from repeated draws of the noise."""

    estimates: Floats
    """K1 ... Kn, D1 ... Dn of each draw, shape (draws, 2n)."""
    standard_error: Floats
    """Their standard deviation, shape (2n,)."""
    bias: Floats
    """Their mean less the fit, shape (2n,)."""
    failed: int
    """Draws that allowed no estimate."""

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
    """Parametric bootstrap: draw the phasors' noise, estimate again, look at the scatter.

    The noise is what the phasors state, times the fit's misfit where that is above 1. Where a record has
    few periods, its covariance is drawn as well: the weights are then as badly known as they were.

    Parameters
    ----------
    draws : int, default 200
        The standard error is then known to 5 %.
    seed : int
    progress : callable, optional
        Called with the fraction done, up to 1.0. What it raises ends the run.

    Raises
    ------
    JointIdError
        When fewer than half of the draws allow an estimate.
    """
    if not isinstance(draws, int) or not 2 <= draws <= 100_000:
        raise JointIdError(f"draws = {draws!r}: expected a whole number from 2 to 100000.")
    rng = np.random.default_rng(seed)
    noise = spring_equations(phasors, inertia).noise
    root = _root(noise.covariance) * np.sqrt(fit.inflation)
    root *= np.any(phasors.harmonics != 0, axis=2)[..., None, None]
    centre = _explained(phasors, fit)
    if fit.method in ("least-squares", "explicit"):
        table = _all_at_once(centre, fit, _circular(rng, root[:, 0], draws))
        failed = 0
        if progress is not None:
            progress(1.0)
    else:
        found = []
        for k in range(draws):
            drawn = _with_noise(centre, _circular(rng, root, 1)[0], rng)
            with contextlib.suppress(JointIdError):
                found.append(refit(drawn, inertia, fit).p[: 2 * fit.n])
            if progress is not None:
                progress((k + 1) / draws)
        failed = draws - len(found)
        if len(found) < max(2, draws / 2):
            raise JointIdError(
                f"Only {len(found)} of {draws} draws of the noise allow an estimate: the records are "
                "too noisy for error bars. Record longer, or move the joints more."
            )
        table = np.array(found)
    return Bootstrap(
        estimates=table,
        standard_error=table.std(axis=0, ddof=1),
        bias=table.mean(axis=0) - np.concatenate([fit.K, fit.D]),
        failed=failed,
    )


def _explained(phasors: Phasors, fit: ElasticityFit) -> Phasors:
    """The phasors without their residual: the nearest, in units of noise, that the fit explains."""
    equations, n = fit.equations, fit.n
    spring = fit.K + 1j * equations.omega[:, None] * fit.D
    E = equations.of_b - spring[..., None] * equations.of_a
    CE = equations.noise.covariance[:, 0] @ E.conj().swapaxes(1, 2)
    e = equations.residual(fit.K, fit.D)[..., None]
    W = whitener(E @ CE)
    correction = -(CE @ W.conj().swapaxes(1, 2) @ W @ e)[..., 0]
    harmonics = phasors.harmonics.copy()
    harmonics[:, 0] += correction
    return replace(
        phasors,
        q=phasors.q + correction[:, :n],
        tau=phasors.tau + correction[:, n:],
        harmonics=harmonics,
    )


def _root(covariance: Complexes) -> Complexes:
    """A matrix whose product with its conjugate transpose is the covariance, also a singular one."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0))[..., None, :])


def _circular(rng: np.random.Generator, root: Complexes, size: int) -> Complexes:
    """Circular complex normal errors, shape (size, ..., 2n)."""
    shape = (size, *root.shape[:-1])
    white = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)
    return np.asarray(np.einsum("...ab,s...b->s...a", root, white))


def _with_noise(phasors: Phasors, error: Complexes, rng: np.random.Generator) -> Phasors:
    """Add an error (r, H, 2n), and draw the covariances where few periods tell them."""
    n = phasors.n
    covariance = phasors.harmonic_covariance.copy()
    for record in np.flatnonzero(phasors.freedom < _EXACT_FREEDOM):
        freedom = max(int(phasors.freedom[record]), 1)
        draws = _circular(rng, _root(covariance[record]), freedom)
        covariance[record] = np.einsum("sha,shb->hab", draws, draws.conj()) / freedom
    # What leaks from the harmonics over a broken period is no noise and stays as it is.
    leaked = phasors.covariance - phasors.harmonic_covariance[:, 0]
    return replace(
        phasors,
        q=phasors.q + error[:, 0, :n],
        tau=phasors.tau + error[:, 0, n:],
        harmonics=phasors.harmonics + error,
        covariance=covariance[:, 0] + leaked,
        harmonic_covariance=covariance,
    )


def _all_at_once(phasors: Phasors, fit: ElasticityFit, error: Complexes) -> Floats:
    """The paper's estimators on every draw (s, r, 2n) in one go, shape (s, 2n)."""
    equations = fit.equations
    z = phasors.z + error
    a = np.einsum("rij,srj->sri", equations.of_a, z)
    b = np.einsum("rij,srj->sri", equations.of_b, z)
    omega, power = equations.omega[:, None], np.abs(a) ** 2
    product = a.conj() * b
    K = product.real.sum(axis=1) / power.sum(axis=1)
    if fit.method == "explicit":
        D = product.imag.sum(axis=1) / (omega * power).sum(axis=1)
    else:
        D = (omega * product.imag).sum(axis=1) / (omega**2 * power).sum(axis=1)
    return np.asarray(np.concatenate([K, D], axis=1))
