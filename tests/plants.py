"""Robots with known parameters, and the records and phasors that equation (1) gives for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Inertia,
    Measurement,
    MotorFriction,
    Phasors,
    SineRecord,
    motor_response,
    simulate_records,
)

PARALLELOGRAM = Inertia(M=[0.0025, 0.0010], M2=[[0.004104, 0.000395], [0.000395, 0.001889]])
SERIAL = Inertia(M=[0.0025, 0.0010], M2=[[0.006345, 0.002095], [0.002095, 0.001889]])
PAPER = Elasticity(K=[43.0, 7.5], D=[0.10, 0.015])
ONE = Inertia(M=[0.0025], M2=[[0.004104]])
ONE_SPRING = Elasticity(K=[43.0], D=[0.10])
THREE = Inertia(
    M=[0.0025, 0.0010, 0.0017],
    M2=[[0.0063, 0.0021, 0.0004], [0.0021, 0.0029, -0.0006], [0.0004, -0.0006, 0.0031]],
)
THREE_SPRINGS = Elasticity(K=[43.0, 7.5, 20.0], D=[0.10, 0.015, 0.04])
ROBOTS = {
    1: (ONE, ONE_SPRING),
    2: (SERIAL, PAPER),
    3: (THREE, THREE_SPRINGS),
}
"""A robot by its number of joints."""

BAND_HZ = np.array([3.1, 5.3, 8.7, 11.9, 16.3, 21.7, 28.9])
"""Frequencies that divide no sample rate used here."""

IMAGES = 40
"""Orders of the steps of a held torque that count."""


def orthogonal(count: int, n: int) -> np.ndarray:
    """Torques (count, n) of amplitude 1 whose phases differ from record to record."""
    r, j = np.ogrid[:count, :n]
    return np.exp(2j * np.pi * r * j / max(count, n) + 0.4j * r + 0.9j * j)


def campaign(
    frequencies_hz: Sequence[float] | np.ndarray,
    n: int,
    count: int | None = None,
    amplitude: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (r,) in Hz and acting torque phasors (r, n), ``count`` records per frequency."""
    frequencies = np.asarray(frequencies_hz, float)
    torques = amplitude * orthogonal(count or n, n)
    return np.repeat(frequencies, len(torques)), np.tile(torques, (frequencies.size, 1))


def state_space(inertia: Inertia, elasticity: Elasticity) -> tuple[np.ndarray, np.ndarray]:
    """Equation (1) as x' = A x + B τ, x = (θm, θa, θm', θa'); shares nothing with the package."""
    n = inertia.M.size
    mass = np.zeros((2 * n, 2 * n))
    mass[:n, :n], mass[n:, n:] = np.diag(inertia.M), inertia.M2
    pairs = np.array([[1, -1], [-1, 1]])
    stiffness, damping = np.kron(pairs, np.diag(elasticity.K)), np.kron(pairs, np.diag(elasticity.D))
    A = np.zeros((4 * n, 4 * n))
    A[: 2 * n, 2 * n :] = np.eye(2 * n)
    A[2 * n :, : 2 * n] = -np.linalg.solve(mass, stiffness)
    A[2 * n :, 2 * n :] = -np.linalg.solve(mass, damping)
    B = np.zeros((4 * n, n))
    B[2 * n :] = np.linalg.solve(mass, np.eye(2 * n)[:, :n])
    return A, B


def motion(
    inertia: Inertia, elasticity: Elasticity, frequencies_hz: np.ndarray, torques: np.ndarray
) -> np.ndarray:
    """Motor angle phasors (r, n) that the acting torques make."""
    omega = 2 * np.pi * np.asarray(frequencies_hz)
    response = motor_response(omega, inertia, elasticity)
    return np.einsum("rij,rj->ri", response, torques) / -(omega[:, None] ** 2)


def between_samples(
    inertia: Inertia, elasticity: Elasticity, f: float, torque: np.ndarray, step: float, delay_s: float
) -> np.ndarray:
    """Motor angle phasors (n,), as sampled, that a held torque makes beside those of its sine.

    The steps of the torque are sines of f + k/step, which the samples cannot tell from f.
    """
    A, B = state_space(inertia, elasticity)
    k = np.concatenate([np.arange(-IMAGES, 0), np.arange(1, IMAGES + 1)])
    s = 2j * np.pi * (f + k / step)
    shares = 2j * np.pi * f / s * np.exp(-2j * np.pi * k * delay_s / step)
    acting = np.broadcast_to(B @ torque, (k.size, len(A)))[..., None]
    states = np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, acting)[..., 0]
    return shares @ states[:, : inertia.M.size]


def steady_records(
    inertia: Inertia,
    elasticity: Elasticity,
    frequencies_hz: np.ndarray,
    torques: np.ndarray,
    *,
    sample_rate_hz: float = 1000.0,
    periods: float = 10.37,
    noise: tuple[float, float] = (0.0, 0.0),
    hold: bool = False,
    delay_s: float = 0.0,
    jitter: float = 0.0,
    offset: float = 0.0,
    drift: float = 0.0,
    begin_s: float = 0.0,
    seed: int = 0,
    told: bool = True,
    pose: str | None = None,
) -> list[SineRecord]:
    """Exact steady-state logs; ``told`` = False hides hold and delay from the record.

    ``noise`` are standard deviations of white noise on angle and torque, ``jitter`` is the largest shift
    of a sample time in sample intervals, ``offset`` (rad, N·m) and ``drift`` (per second) go on top.
    """
    rng = np.random.default_rng(seed)
    records = []
    for f, torque, q in zip(
        frequencies_hz, torques, motion(inertia, elasticity, frequencies_hz, torques), strict=True
    ):
        omega, step = 2 * np.pi * f, 1 / sample_rate_hz
        count = int(np.ceil(periods / f * sample_rate_hz))
        time = begin_s + step * (np.arange(count) + jitter * rng.uniform(-1, 1, count))
        lag = delay_s + (step / 2 if hold else 0.0)
        commanded = torque * np.exp(1j * omega * lag) / (np.sinc(f * step) if hold else 1.0)
        wave = np.exp(1j * omega * time)[:, None]
        line = offset + drift * (time - begin_s)[:, None]
        if hold:
            q = q + between_samples(inertia, elasticity, f, torque, step, delay_s)
        theta, tau = np.imag(q * wave) + line, np.imag(commanded * wave) + line
        records.append(
            SineRecord(
                frequency_hz=f,
                time_s=time,
                theta_rad=theta + noise[0] * rng.standard_normal(theta.shape),
                tau_Nm=tau + noise[1] * rng.standard_normal(tau.shape),
                torque_hold=hold and told,
                torque_delay_s=delay_s if told else 0.0,
                pose=pose,
            )
        )
    return records


@cache
def rubbing(
    coulomb: tuple[float, float] = (0.1, 0.02),
    pattern: str = "orthogonal",
    step_s: float = 5e-4,
    every: int = 2,
) -> tuple[SineRecord, ...]:
    """A short campaign in closed loop with Coulomb friction, at every second frequency of the band."""
    return simulate_records(
        PARALLELOGRAM,
        PAPER,
        BAND_HZ[::every],
        friction=MotorFriction(coulomb=list(coulomb), step_s=step_s),
        controller=Controller(sample_rate_hz=2000),
        excitation=Excitation(duration_s=2.0, pattern=pattern),
        measurement=Measurement(position_noise_rad=1e-5, torque_noise_Nm=3e-3),
    )


def exact_phasors(
    frequencies_hz: np.ndarray,
    q: np.ndarray,
    tau: np.ndarray,
    covariance: np.ndarray | None = None,
    freedom: float = 1e9,
) -> Phasors:
    """Phasors as given, as if they had been extracted."""
    r, n = q.shape
    if covariance is None:
        covariance = np.zeros((r, 2 * n, 2 * n), complex)
    return Phasors(
        omega=2 * np.pi * np.asarray(frequencies_hz, float),
        q=q,
        tau=tau,
        covariance=covariance,
        degrees_of_freedom=np.full(r, float(freedom)),
        duration_s=np.full(r, 2.0),
        harmonics=np.hstack([q, tau])[:, None],
        harmonic_covariance=covariance[:, None],
        drift=np.zeros((r, n)),
        settling=np.full((r, 2 * n), np.nan),
        settling_noise=np.full((r, 2 * n), np.nan),
        frequency_found_hz=np.asarray(frequencies_hz, float),
        labels=tuple(f"record {i}" for i in range(1, r + 1)),
    )


def plant_phasors(
    inertia: Inertia, elasticity: Elasticity, frequencies_hz: np.ndarray, torques: np.ndarray
) -> Phasors:
    """Phasors of the plant without noise."""
    return exact_phasors(frequencies_hz, motion(inertia, elasticity, frequencies_hz, torques), torques)


def random_covariance(rng: np.random.Generator, scale: np.ndarray) -> np.ndarray:
    """A Hermitian positive definite matrix whose diagonal is ``scale``², with strong correlations."""
    size = scale.size
    root = rng.standard_normal((size, size)) + 1j * rng.standard_normal((size, size))
    matrix = root @ root.conj().T + size * np.eye(size)
    unit = np.sqrt(np.diag(matrix).real)
    return matrix / np.outer(unit, unit) * np.outer(scale, scale)


def circular(rng: np.random.Generator, covariance: np.ndarray, size: int) -> np.ndarray:
    """Circular complex normal draws, shape (size, r, m), with covariance E[z zᴴ] of shape (r, m, m)."""
    root = np.linalg.cholesky(covariance)
    r, m, _ = covariance.shape
    white = (rng.standard_normal((size, r, m)) + 1j * rng.standard_normal((size, r, m))) / np.sqrt(2)
    return np.einsum("rab,srb->sra", root, white)


def estimated(rng: np.random.Generator, covariance: np.ndarray, freedom: int) -> np.ndarray:
    """What ``freedom`` draws would tell about a covariance (r, m, m)."""
    draws = circular(rng, covariance, freedom)
    return np.einsum("sra,srb->rab", draws, draws.conj()) / freedom


def noisy(phasors: Phasors, covariance: np.ndarray, error: np.ndarray, freedom: float = 1e9) -> Phasors:
    """The same phasors with an error (r, 2n) added, and a covariance stated."""
    n, f = phasors.n, phasors.omega / (2 * np.pi)
    return exact_phasors(f, phasors.q + error[:, :n], phasors.tau + error[:, n:], covariance, freedom)


def scaled(phasors: Phasors, scale: np.ndarray) -> Phasors:
    """The same phasors with all signals times factors (2n,): in other units."""
    q, tau = np.split(phasors.z * scale, [phasors.n], axis=1)
    both = np.outer(scale, scale)
    return replace(
        phasors,
        q=q,
        tau=tau,
        covariance=phasors.covariance * both,
        harmonics=phasors.harmonics * scale,
        harmonic_covariance=phasors.harmonic_covariance * both,
    )
