"""Fisher information of single records on K, D, friction and delay.

With the residual r = τ e^{-sδ} − F − Z q of covariance V = E C Eᴴ (``estimation.residual``), a record's
information on the parameters is 2 Re JᴴV⁻¹J with J = ∂r/∂p at the true signals and the free friction
projected out. Records add up; the inverse of the sum is the Cramér–Rao bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.friction import friction_waveforms
from jointid.estimation.inertia_prior import InertiaPrior
from jointid.estimation.noise import Noise
from jointid.estimation.parameters import ParameterLayout
from jointid.estimation.residual import Problem
from jointid.estimation.whitened_residual import WhitenedResidual
from jointid.joints import Inertia
from jointid.phasors.extract import MANY_HARMONICS, Phasors
from jointid.uncertainty.chosen_model import free_reversal
from jointid.uncertainty.validation import compensated_phasors

_EXACT = 1e12
"""Degrees of freedom of a given noise covariance."""


@dataclass(frozen=True, eq=False)
class PlanningModel:
    """Assumptions on planned records: the fit, and the noise by frequency."""

    fit: ElasticityFit
    omega: Floats
    """Frequencies at which the noise is known, ascending, shape (f,), rad/s."""
    density: Complexes
    """Covariance of z = [q; τ] times the length of the record there, shape (f, 2n, 2n), per second."""

    @property
    def layout(self) -> ParameterLayout:
        """Parameters of the fit, without those of a friction curve."""
        fit = self.fit
        return ParameterLayout.of(fit.n, friction=fit.friction is not None, delay=fit.delay is not None)

    def noise(self, omega: Floats, duration_s: Floats) -> Complexes:
        """Covariance (..., 2n, 2n) of records of these frequencies and lengths, both shaped (...)."""
        place = np.interp(np.log(omega), np.log(self.omega), np.arange(self.omega.size))
        low = np.floor(place).astype(int)
        high = np.minimum(low + 1, self.omega.size - 1)
        share = (place - low)[..., None, None]
        mixed = (1 - share) * self.density[low] + share * self.density[high]
        return np.asarray(mixed / duration_s[..., None, None])


def planning_model(phasors: Phasors, fit: ElasticityFit) -> PlanningModel:
    """Planning model of a fit, with the noise averaged over the records of each frequency."""
    noise = fit.equations.noise  # weighted as in the estimator
    length = (phasors.duration_s * noise.inverse_bias)[:, None, None]
    covariance = noise.covariance[:, 0] * length
    groups = phasors.by_frequency()
    return PlanningModel(
        fit=fit,
        omega=np.array([omega for omega, _ in groups]),
        density=np.array([covariance[group].mean(axis=0) for _, group in groups]),
    )


def measured_information(phasors: Phasors, inertias: list[Inertia], now: PlanningModel) -> Floats:
    """Information of existing records, shape (r, P, P)."""
    free = compensated_phasors(phasors, now.fit)
    return record_information(phasors.omega, free.q, free.tau, phasors.duration_s, inertias, now)


def record_information(
    omega: Floats,
    q: Complexes,
    tau: Complexes,
    duration_s: Floats,
    inertias: list[Inertia],
    now: PlanningModel,
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
    now : PlanningModel
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
        noise=Noise(C, np.full(omega.size, _EXACT)),
        known=np.ones(s.shape, bool),
        prior=InertiaPrior.of(inertias, *q.shape),
        friction=waves,
        layout=now.layout,
        stiffest=np.full(n, np.inf),
    )
    p = now.layout.pack(K=fit.K, D=fit.D)
    columns = WhitenedResidual.of(problem, p, np.ones(orders.size)).columns(smooth=False)
    return np.asarray(2 * columns.swapaxes(1, 2) @ columns)


def _sines(omega: Floats, q: Complexes, tau: Complexes, C: Complexes, duration_s: Floats) -> Phasors:
    """Phasors of pure sines, for the velocity waveform of the friction model."""
    r, n = q.shape
    harmonics = np.full((r, C.shape[1], 2 * n), 1e-300 + 0j)  # known, but practically zero
    harmonics[:, 0] = np.hstack([q, tau])
    unknown = np.full((r, 2 * n), np.nan)
    return Phasors(
        omega=omega,
        q=q,
        tau=tau,
        covariance=C[:, 0],
        degrees_of_freedom=np.full(r, 100.0),
        duration_s=duration_s,
        harmonics=harmonics,
        harmonic_covariance=C,
        drift=np.zeros((r, n)),
        settling=unknown,
        settling_noise=unknown,
        frequency_found_hz=omega / (2 * np.pi),
        labels=tuple(f"planned {i + 1}" for i in range(r)),
    )
