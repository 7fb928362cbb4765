"""Errors of the estimators relative to the Cramér–Rao bound, and coverage of their intervals.

    python -m benchmarks.cramer_rao [draws] [periods ...]     or  python -m benchmarks cramer_rao

Draws noise on the noise-free steady state of the paper's robot (18 frequencies × 2 records, 2 kHz), runs
phasor extraction and every estimator on each draw, and prints as Markdown: root-mean-square error over
the bound for K1, K2, D1, D2, and the share of 68 % and 95 % intervals that contain the true value.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.campaign import ANSWER, INERTIA, TRUTH
from benchmarks.harness import Table, print_rows
from jointid import Phasors, SineRecord, extract_phasors, identify_elasticity, motor_response
from jointid.estimation.estimators.maximum_likelihood import maximum_likelihood

FREQUENCIES_HZ = np.geomspace(3.0, 30.0, 18)
SAMPLE_RATE_HZ = 2000.0
NOISE = np.array([1e-4, 1e-4, 0.05, 0.05])
"""Standard deviation of each sample: motor angles in rad, torques in N·m."""
HEADINGS = (
    "periods", "estimator", "RMSE / bound: K1", "K2", "D1", "D2", "truth within the 68 % interval",
    "truth within the 95 % interval",
)  # fmt: skip
METHODS = ("least-squares", "weighted", "maximum-likelihood", "auto")


def steady_state(periods: float) -> list[tuple[float, np.ndarray, np.ndarray, np.ndarray]]:
    """Frequency, times, noise-free channels (N, 4) and phasors (4,) of every record."""
    experiments = []
    for frequency in FREQUENCIES_HZ:
        omega = 2 * np.pi * frequency
        H = motor_response([omega], INERTIA, TRUTH)[0]
        for sign in (1.0, -1.0):
            tau = np.array([1.0, 0.5 * sign], complex)
            z = np.concatenate([-H @ tau / omega**2, tau])
            time = np.arange(round(periods / frequency * SAMPLE_RATE_HZ)) / SAMPLE_RATE_HZ
            experiments.append((frequency, time, np.imag(np.exp(1j * omega * time)[:, None] * z), z))
    return experiments


def bound(experiments: list[tuple[float, np.ndarray, np.ndarray, np.ndarray]]) -> np.ndarray:
    """Smallest possible standard errors of K1, K2, D1, D2 for white noise of known size."""
    z = np.array([each[3] for each in experiments])
    covariance = np.array([np.diag(4 * NOISE**2 / each[1].size).astype(complex) for each in experiments])
    phasors = extract_phasors(
        [SineRecord(f, t, x[:, :2], x[:, 2:]) for f, t, x, _ in experiments], harmonics=1
    )
    exact = replace(
        phasors,
        q=z[:, :2],
        tau=z[:, 2:],
        covariance=covariance,
        harmonics=z[:, None],
        harmonic_covariance=covariance[:, None],
        degrees_of_freedom=np.full(len(z), 1e9),
    )
    return np.sqrt(np.diag(maximum_likelihood(exact, INERTIA, ANSWER).covariance))


def draw(
    experiments: list[tuple[float, np.ndarray, np.ndarray, np.ndarray]], rng: np.random.Generator
) -> Phasors:
    records = []
    for frequency, time, exact, _ in experiments:
        noisy = exact + NOISE * rng.standard_normal(exact.shape)
        records.append(SineRecord(frequency, time, noisy[:, :2], noisy[:, 2:]))
    return extract_phasors(records)


def rows(draws: int, period_counts: Sequence[float]) -> Iterator[tuple[str, ...]]:
    """Periods, estimator, error over the bound for K1, K2, D1, D2, and coverage of the intervals."""
    for periods in period_counts:
        rng = np.random.default_rng(2026)
        experiments = steady_state(periods)
        least = bound(experiments)
        errors: dict[str, list[np.ndarray]] = {method: [] for method in METHODS}
        stated: dict[str, list[np.ndarray]] = {method: [] for method in METHODS}
        for _ in range(draws):
            phasors = draw(experiments, rng)
            for method in METHODS:
                fit = identify_elasticity(phasors, INERTIA, method=method)
                errors[method].append(np.concatenate([fit.K, fit.D]) - ANSWER)
                stated[method].append(fit.standard_error)
        for method in METHODS:
            error, sigma = np.array(errors[method]), np.array(stated[method])
            ratio = np.sqrt((error**2).mean(axis=0)) / least
            held = [f"{100 * (np.abs(error) < k * sigma).mean():.1f} %" for k in (0.99446, 1.95996)]
            yield (f"{periods:g}", method, *(f"{value:.2f}" for value in ratio), *held)


def measure(quick: bool) -> list[Table]:
    """Return the table for ``python -m benchmarks cramer_rao``."""
    found = tuple(
        dict(zip(HEADINGS, row, strict=True))
        for row in rows(*((2, [5.0]) if quick else (1000, [5.0, 8.0, 20.0])))
    )
    return [Table("cramer_rao", "Against the bound", dict.fromkeys(HEADINGS, ""), found)]


if __name__ == "__main__":
    arguments = [float(a) for a in sys.argv[1:]]
    draws = int(arguments[0]) if arguments else 1000
    print_rows(HEADINGS, rows(draws, arguments[1:] or [5.0, 8.0, 12.0, 20.0]))
