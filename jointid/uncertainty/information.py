"""Fisher information of single records: what each tells of K, D, friction and delay.

The torque balance of ``estimation.likelihood`` has the residual r = τ e^{-sδ} − F − Z q of covariance
V = E C Eᴴ; a record's information on the parameters is 2 Re JᴴV⁻¹J with J = ∂r/∂p at the true signals,
after what friction is free to do around its reversals has been projected out. Records add up, and the
inverse of the sum is the Cramér–Rao bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.friction import friction_waveforms
from jointid.estimation.noise import Noise
from jointid.estimation.residual import Problem, parameter_names
from jointid.estimation.whitened_residual import WhitenedBalance
from jointid.joints import Inertia
from jointid.phasors.extract import MANY_HARMONICS, Phasors
from jointid.uncertainty.chosen_model import free_reversal
from jointid.uncertainty.validation import freed_phasors

_WELL_KNOWN = 1e12  # degrees of freedom of a noise that is given


@dataclass(frozen=True, eq=False)
class Situation:
    """What is assumed of records that are still to be made: the fit, and the noise by frequency."""

    fit: ElasticityFit
    omega: Floats
    """Frequencies at which the noise is known, ascending, shape (f,), rad/s."""
    density: Complexes
    """Covariance of z = [q; τ] times the length of the record there, shape (f, 2n, 2n), per second."""

    @property
    def parameters(self) -> int:
        """K and D, Coulomb and viscous friction, delay: as far as the fit has them."""
        n = self.fit.n
        friction = 2 * n if self.fit.friction is not None else 0
        return 2 * n + friction + (self.fit.delay is not None)

    def noise(self, omega: Floats, duration_s: Floats) -> Complexes:
        """Covariance (..., 2n, 2n) of records of these frequencies and lengths, both shaped (...)."""
        place = np.interp(np.log(omega), np.log(self.omega), np.arange(self.omega.size))
        low = np.floor(place).astype(int)
        high = np.minimum(low + 1, self.omega.size - 1)
        share = (place - low)[..., None, None]
        mixed = (1 - share) * self.density[low] + share * self.density[high]
        return np.asarray(mixed / duration_s[..., None, None])


def situation(phasors: Phasors, fit: ElasticityFit) -> Situation:
    """Noise by frequency, averaged over the records of each."""
    noise = fit.equations.noise  # what is not well known weighs less, as in the estimator itself
    length = (phasors.duration_s * noise.inverse_bias)[:, None, None]
    covariance = noise.covariance[:, 0] * length
    groups = phasors.by_frequency()
    return Situation(
        fit=fit,
        omega=np.array([omega for omega, _ in groups]),
        density=np.array([covariance[group].mean(axis=0) for _, group in groups]),
    )


def measured_information(phasors: Phasors, inertias: list[Inertia], now: Situation) -> Floats:
    """Information of records that have been made, shape (r, P, P)."""
    free = freed_phasors(phasors, now.fit)
    return record_information(phasors.omega, free.q, free.tau, phasors.duration_s, inertias, now)


def record_information(
    omega: Floats,
    q: Complexes,
    tau: Complexes,
    duration_s: Floats,
    inertias: list[Inertia],
    now: Situation,
) -> Floats:
    """Information of each record, shape (r, P, P).

    Parameters
    ----------
    omega : ndarray, shape (r,)
    q, tau : ndarray, shape (r, n), complex
        Motor angles, and torques without friction.
    duration_s : ndarray, shape (r,)
    inertias : list of Inertia
        One per record.
    now : Situation
    """
    fit, n = now.fit, q.shape[1]
    orders = np.arange(1, (MANY_HARMONICS if fit.friction is not None else 1) + 1)
    s = np.asarray(1j * np.multiply.outer(omega, orders))
    C = now.noise(np.abs(s), np.broadcast_to(duration_s[:, None], s.shape))
    waves, motor = None, tau
    if fit.friction is not None:
        waves = friction_waveforms(_sines(omega, q, tau, C, duration_s), free_reversal(fit))
        motor = tau + fit.friction.coulomb * waves.coulomb[:, 0]
    signals = np.zeros((*s.shape, 2 * n), complex)
    signals[:, 0] = np.hstack([q, motor])
    problem = Problem(
        s=s,
        z=signals,
        noise=Noise(C, np.full(omega.size, _WELL_KNOWN)),
        known=np.ones(s.shape, bool),
        M=np.array([i.M for i in inertias]),
        arm=np.linalg.inv(np.array([i.M2 for i in inertias])),
        friction=waves,
        names=parameter_names(n, waves, delay=fit.delay is not None),
        stiffest=np.full(n, np.inf),
    )
    p = np.zeros(now.parameters)
    p[: 2 * n] = *fit.K, *fit.D
    columns = WhitenedBalance.of(problem, p, np.ones(orders.size)).columns(smooth=False)
    return np.asarray(2 * columns.swapaxes(1, 2) @ columns)


def bound(information: Floats) -> Floats:
    """Inverse of an information matrix (P, P); infinite variances where it tells nothing."""
    size = np.sqrt(np.diag(information))
    seen = size > 0
    covariance = np.full(information.shape, 0.0)
    covariance[~seen, ~seen] = np.inf
    scaled = information[np.ix_(seen, seen)] / np.outer(size[seen], size[seen])
    values, vectors = np.linalg.eigh(scaled)
    told = values > 1e-10
    inner = (vectors[:, told] / values[told]) @ vectors[:, told].T
    untold = np.any(np.abs(vectors[:, ~told]) > 1e-3, axis=1)
    inner[untold, untold] = np.inf
    covariance[np.ix_(seen, seen)] = inner / np.outer(size[seen], size[seen])
    return covariance


def _sines(omega: Floats, q: Complexes, tau: Complexes, C: Complexes, duration_s: Floats) -> Phasors:
    """Phasors of pure sines, for the velocity waveform that friction needs."""
    r, n = q.shape
    harmonics = np.full((r, C.shape[1], 2 * n), 1e-300 + 0j)  # carried by the samples, but empty
    harmonics[:, 0] = np.hstack([q, tau])
    unknown = np.full((r, 2 * n), np.nan)
    return Phasors(
        omega=omega,
        q=q,
        tau=tau,
        covariance=C[:, 0],
        freedom=np.full(r, 100.0),
        duration_s=duration_s,
        harmonics=harmonics,
        harmonic_covariance=C,
        drift=np.zeros((r, n)),
        settling=unknown,
        settling_noise=unknown,
        frequency_found_hz=omega / (2 * np.pi),
        labels=tuple(f"planned {i + 1}" for i in range(r)),
    )
