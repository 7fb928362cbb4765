"""Effect of friction and an unstated delay on the estimators, for the paper's robot in closed loop.

    python -m benchmarks.friction [seeds]          or  python -m benchmarks friction

Simulates campaigns of 18 frequencies × 2 records (12.5 periods, 2 kHz, 16-bit encoder, noise) and
prints the largest error of K and of D over joints and seeds, also in standard errors, and the model
that was chosen.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator

import numpy as np

from benchmarks.campaign import ANSWER, INERTIA, TRUTH, simulated
from benchmarks.harness import Table, print_rows
from jointid import extract_phasors, identify_elasticity

RATE_HZ = 2000.0
CASES = {
    "none": ("none", 0.0),
    "mild friction, 0.05 and 0.012 N·m": ("mild", 0.0),
    "heavy friction, 0.4 and 0.08 N·m": ("heavy", 0.0),
    "no friction, unstated delay of 1.5 ms": ("none", 0.0015),
    "heavy friction and the delay": ("heavy", 0.0015),
}
HEADINGS = (
    "disturbance", "estimator", "error of K", "error of D", "largest error, σ", "chosen model"
)  # fmt: skip


def rows(seeds: int, cases: Collection[str] = CASES.keys()) -> Iterator[tuple[str, ...]]:
    """Disturbance, estimator, errors of K and D, the largest in standard errors, and chosen model."""
    for name, (friction, delay) in CASES.items():
        if name not in cases:
            continue
        campaigns = [
            extract_phasors(simulated(friction, seed, rate_hz=RATE_HZ, unstated_delay_s=delay))
            for seed in range(seeds)
        ]
        for method in ("least-squares", "weighted", "auto"):
            fits = [identify_elasticity(phasors, INERTIA, method=method) for phasors in campaigns]
            K = max(np.abs(fit.K / TRUTH.K - 1).max() for fit in fits)
            D = max(np.abs(fit.D / TRUTH.D - 1).max() for fit in fits)
            score = max(
                (np.abs(np.concatenate([f.K, f.D]) - ANSWER) / f.standard_error).max() for f in fits
            )
            models = {c.name.split(",")[0] for fit in fits for c in fit.candidates if c.chosen}
            yield (
                *(name, method, f"{100 * K:.3f} %", f"{100 * D:.3f} %", f"{score:.1f}"),
                "; ".join(sorted(models)),
            )


def measure(quick: bool) -> list[Table]:
    """Return the table for ``python -m benchmarks friction``."""
    chosen = rows(1, ["none"]) if quick else rows(5)
    found = tuple(dict(zip(HEADINGS, row, strict=True)) for row in chosen)
    return [Table("friction", "Friction and unstated delay", dict.fromkeys(HEADINGS, ""), found)]


if __name__ == "__main__":
    print_rows(HEADINGS, rows(int(sys.argv[1]) if len(sys.argv) > 1 else 5))
