"""What friction and an untold delay do to the estimators, on the paper's robot in closed loop.

    python benchmarks/friction.py [seeds]          or  python -m benchmarks friction

Simulates campaigns of 18 frequencies × 2 records (12.5 periods, 2 kHz, 16-bit encoder, noise) and
prints the largest error of K and of D over joints and seeds, also in standard errors, and the model
that was chosen.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Inertia,
    Measurement,
    MotorFriction,
    extract_phasors,
    identify_elasticity,
    simulate_records,
)

INERTIA = Inertia(M=[0.0025, 0.0010], M2=[[0.004104, 0.000395], [0.000395, 0.001889]])
TRUTH = Elasticity(K=[43.0, 7.5], D=[0.10, 0.015])
CASES = {
    "none": ([0.0, 0.0], 0.0),
    "mild friction, 0.05 and 0.012 N·m": ([0.05, 0.012], 0.0),
    "heavy friction, 0.4 and 0.08 N·m": ([0.4, 0.08], 0.0),
    "no friction, 1.5 ms of delay untold": ([0.0, 0.0], 0.0015),
    "heavy friction and the delay": ([0.4, 0.08], 0.0015),
}
HEADINGS = (
    "what spoils the data", "estimator", "K off by", "D off by", "in standard errors", "model chosen"
)  # fmt: skip


def rows(seeds: int, cases: Collection[str] = CASES.keys()) -> Iterator[tuple[str, ...]]:
    """What spoils the data, estimator, K and D off by, in standard errors, model chosen."""
    for name, (coulomb, delay) in CASES.items():
        if name not in cases:
            continue
        campaigns = [campaign(coulomb, delay, seed) for seed in range(seeds)]
        for method in ("least-squares", "weighted", "auto"):
            fits = [identify_elasticity(phasors, INERTIA, method=method) for phasors in campaigns]
            K = max(np.abs(fit.K / TRUTH.K - 1).max() for fit in fits)
            D = max(np.abs(fit.D / TRUTH.D - 1).max() for fit in fits)
            truth = np.concatenate([TRUTH.K, TRUTH.D])
            score = max(
                (np.abs(np.concatenate([f.K, f.D]) - truth) / f.standard_error).max() for f in fits
            )
            models = {c.name.split(",")[0] for fit in fits for c in fit.candidates if c.chosen}
            yield (
                *(name, method, f"{100 * K:.3f} %", f"{100 * D:.3f} %", f"{score:.1f}"),
                "; ".join(sorted(models)),
            )


def measure(quick: bool) -> list[Any]:
    """Return the table for ``python -m benchmarks friction``."""
    from benchmarks.harness import Table  # a script run by its path does not see the package

    chosen = rows(1, ["none"]) if quick else rows(5)
    found = tuple(dict(zip(HEADINGS, row, strict=True)) for row in chosen)
    return [Table("friction", "Friction and untold delay", dict.fromkeys(HEADINGS, ""), found)]


def main(seeds: int) -> None:
    print("| " + " | ".join(HEADINGS) + " |")
    print("|---" * len(HEADINGS) + "|")
    for row in rows(seeds):
        print("| " + " | ".join(row) + " |", flush=True)


def campaign(coulomb: list[float], delay: float, seed: int):
    records = simulate_records(
        INERTIA,
        TRUTH,
        np.geomspace(3.0, 30.0, 18).round(2),
        excitation=Excitation(periods=12.5, velocity_rad_s=8.0),
        controller=Controller(sample_rate_hz=2000.0, torque_delay_s=delay),
        friction=MotorFriction(coulomb=coulomb, viscous=[0.002, 0.0005] if any(coulomb) else 0.0),
        measurement=Measurement(encoder_counts=65536, torque_noise_Nm=[0.02, 0.01]),
        declare_timing=delay == 0,
        seed=seed,
    )
    return extract_phasors(records)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
