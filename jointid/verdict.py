"""What to know before the answer is trusted: findings in plain words, most important first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jointid.elasticity import ElasticityFit
from jointid.phasors import Phasors
from jointid.transfer_matrix import TransferMatrix


@dataclass(frozen=True)
class Finding:
    """One thing found in the data, with its figure and its remedy."""

    level: str
    """"problem" (the answer is not usable), "warning" (it is worse than it looks) or "good"."""
    title: str
    """The finding as a short sentence."""
    detail: str
    """The figure behind it, and where."""
    remedy: str
    """What to do; empty when nothing needs doing."""
    weight: float
    """How much it changes the answer, for the order."""


def findings(
    phasors: Phasors, fit: ElasticityFit, transfer_matrices: dict[str, TransferMatrix]
) -> tuple[Finding, ...]:
    """All findings, most important first; when there is nothing to mend, one that says so.

    Parameters
    ----------
    phasors, fit, transfer_matrices
        One analysis; the transfer matrices by pose.
    """
    rules = (
        _not_physical(fit),
        _wrong_frequency(phasors),
        _still_settling(phasors),
        _misfit(fit),
        _rejected(transfer_matrices),
    )
    found = sorted((f for rule in rules for f in rule), key=lambda f: -f.weight)
    return tuple(found) or (_all_well(fit),)


def _not_physical(fit: ElasticityFit) -> Iterator[Finding]:
    for j in range(fit.n):
        if fit.K[j] <= 0:
            yield Finding(
                "problem",
                f"K{j + 1} is negative",
                f"The estimate is {fit.K[j]:.4g} N·m/rad, which is no spring.",
                f"Check the sign and unit of the torque of joint {j + 1}, the gear ratios, M and M2.",
                weight=100.0,
            )
        elif fit.D[j] < -2 * fit.standard_error[fit.n + j]:
            yield Finding(
                "warning",
                f"D{j + 1} is negative",
                f"The estimate is {fit.D[j]:.3g} N·m·s/rad, which would feed energy into the arm.",
                "The torque probably leads or lags: check torque_hold and torque_delay_s.",
                weight=50.0,
            )


def _wrong_frequency(phasors: Phasors) -> Iterator[Finding]:
    stated = phasors.omega / (2 * np.pi)
    off = np.abs(phasors.frequency_found_hz / stated - 1)
    worst = int(np.argmax(off))
    if off[worst] > 2e-3:
        yield Finding(
            "problem" if off[worst] > 0.05 else "warning",
            "A record contradicts its stated frequency",
            f"{phasors.labels[worst]} says {stated[worst]:.5g} Hz; the motor angle has "
            f"{phasors.frequency_found_hz[worst]:.5g} Hz. "
            f"{int((off > 2e-3).sum())} record(s) concerned.",
            "Correct frequency_hz in study.toml, or the unit of time_s.",
            weight=60.0 * min(1.0, float(off[worst]) * 20),
        )


def _still_settling(phasors: Phasors) -> Iterator[Finding]:
    with np.errstate(invalid="ignore", divide="ignore"):
        significance = phasors.settling / phasors.settling_noise
    moving = np.nan_to_num(np.where(significance > 5, phasors.settling, 0.0)).max(axis=1)
    worst = int(np.argmax(moving))
    if moving[worst] > 0.01:
        yield Finding(
            "warning",
            "The motion is still settling",
            f"In {phasors.labels[worst]} the first quarter differs by {moving[worst]:.1%} from the "
            f"second half. {int((moving > 0.01).sum())} record(s) concerned.",
            "Set start_s of these records later, or wait longer before recording.",
            weight=10.0 * min(1.0, float(moving[worst]) * 10),
        )


def _misfit(fit: ElasticityFit) -> Iterator[Finding]:
    if fit.misfit > 3:
        yield Finding(
            "warning",
            "The model, not the noise, limits the answer",
            f"The equations leave {np.sqrt(fit.misfit):.1f} times what the noise explains. "
            "The error bars are widened by that factor.",
            "Friction, a torque delay or wrong inertias are the usual causes.",
            weight=5.0 + float(np.log10(fit.misfit)),
        )


def _rejected(transfer_matrices: dict[str, TransferMatrix]) -> Iterator[Finding]:
    rejected = [text for matrix in transfer_matrices.values() for text in matrix.rejected]
    if rejected:
        yield Finding(
            "warning",
            f"{len(rejected)} frequencies have no transfer matrix",
            rejected[0],
            "K and D do not need it; the comparison of model and measurement does.",
            weight=1.0,
        )


def _all_well(fit: ElasticityFit) -> Finding:
    return Finding(
        "good",
        "The model explains the data",
        f"The equations leave {np.sqrt(fit.misfit):.2g} times what the noise explains.",
        "",
        weight=0.0,
    )
