"""Stiffness from second encoders on random six-axis robots: errors, their z values, skew, predictions.

python -m benchmarks.arm_side [cases] [faults]    or  python -m benchmarks arm_side

With ``faults``, it counts the reversed joints and wrong gear ratios that are named.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.harness import Table
from jointid import identify_arm_side
from jointid.arm_side.identify import TORQUE_STD
from tests.arm_side_robot import ARC_SECOND, ROBOT, SENSORS, motion_record, random_truth

COLUMNS = {"robots": "", "identified": ".0f", "refused": ".0f", "error of K, median, %": ".2f",
           "largest": ".2f", "rms, σ": ".2f", "beyond 3 σ": ".0f", "error of skew, largest, ms": ".4f",
           "error of prediction, median, ″": ".1f", "largest, ″": ".1f"}  # fmt: skip
QUIET = {"eccentricity": 2.0, "ripple": 1.0, "teeth": 2.0, "vibration": 0.3, "hysteresis": 2.0}


def row(
    title: str, payload_known: bool, cases: int, *, torque_std: float = TORQUE_STD, **changes: float
) -> dict[str, str | float]:
    """Errors over random robots; each fit predicts another record of its robot."""
    ratios, errors, skews, left, refused = [], [], [], [], 0
    for seed in range(cases):
        truth = random_truth(np.random.default_rng(seed), **changes)
        robot = ROBOT.with_payload(mass=truth.payload_kg, mass_std=0.0) if payload_known else ROBOT
        fit = identify_arm_side(motion_record(truth, seed + 100), robot, torque_std=torque_std)
        K, sigma = fit.K[:SENSORS], fit.standard_error[:SENSORS]
        kept = np.isfinite(K)
        refused += int((~kept).sum())
        ratios += list(((K - truth.K) / sigma)[kept])
        errors += list(100 * np.abs(K / truth.K - 1)[kept])
        skews += list(1e3 * np.abs(fit.skew_s[:SENSORS] - truth.skew_s))
        other = motion_record(truth, seed + 5000)
        assert other.arm_rad is not None
        rest = other.theta_rad / ROBOT.gear_ratio - other.arm_rad - fit.predict(other)
        left += list(rest[:, :SENSORS].std(axis=0) / ARC_SECOND)
    z = np.array(ratios)
    figures = [title, z.size, refused, np.median(errors), max(errors), np.sqrt(np.mean(z**2))]
    figures += [np.sum(np.abs(z) > 3), max(skews), np.median(left), max(left)]
    return dict(zip(COLUMNS, figures, strict=True))


FAULTS = ("none", "torque 4", "torque 5", "torque 6", "direction 4", "direction 5", "direction 6",
          "ratio 5", "ratio 6")  # fmt: skip
"""Reversed torque or direction of a joint, or a gear ratio 3 % too small."""


def faulty(fault: str, sensors: int, cases: int) -> dict[str, str | float]:
    """Count the robots whose fault is named, and errors of K; sensors on the first joints."""
    kind, joint = (*fault.split(), "1")[:2]
    sign = np.where(np.arange(6) == int(joint) - 1, -1.0, 1.0)
    counts, ratios, refused = np.zeros(3, int), [0.0], 0
    for seed in range(cases):
        rng = np.random.default_rng(seed)
        K = rng.uniform(2e6, 8e6, 6) * np.repeat([1, 0.2], 3)
        skew = np.full(sensors, rng.uniform(0, 5e-3))
        truth = random_truth(rng, K=K[:sensors], skew_s=skew)
        record, factor = motion_record(truth, seed + 100), np.ones(6)
        if kind == "torque":
            record = replace(record, tau_Nm=record.tau_Nm * sign)
        elif kind != "none":
            factor = sign if kind == "direction" else np.where(sign < 0, 1.03, 1.0)
        fit = identify_arm_side(record, replace(ROBOT, coupling=ROBOT.coupling * factor))
        signs = fit.motors.reversed
        ratio = [j for j, reason in enumerate(fit.reasons) if "sensor implies" in reason]
        named = [np.flatnonzero(signs.torque), np.flatnonzero(signs.axis), np.array(ratio)]
        counts += [int(joint) - 1 in each for each in named]
        ratios += list(np.abs((fit.K[:sensors] - truth.K) / fit.standard_error[:sensors]))
        refused += int(np.isnan(fit.K[:sensors]).sum())
    figures = [f"{fault}, {sensors} sensors", cases, *counts, refused, np.nanmax(ratios)]
    return dict(zip(FAULT_COLUMNS, figures, strict=True))


FAULT_COLUMNS = {"fault of joint": "", "robots": ".0f", "torque named": ".0f", "direction named": ".0f",
                 "ratio named": ".0f", "K refused": ".0f", "largest error of K, σ": ".1f"}  # fmt: skip


def faults(cases: int) -> Table:
    """Return the table of named faults."""
    rows = tuple(faulty(fault, sensors, cases) for sensors in (3, 6) for fault in FAULTS)
    return Table("arm_side", f"Wrong signs and ratios, {cases} robots each", FAULT_COLUMNS, rows)


def measure(quick: bool, cases: int = 50) -> Iterator[Table]:
    """Return the table for ``python -m benchmarks arm_side``."""
    cases = 1 if quick else cases
    rows = (
        row("payload uncertain by 40 kg", False, cases),
        row("payload uncertain by 40 kg, model stated as exact", False, cases, torque_std=0.0),
        row("payload known, small transmission error", True, cases, **QUIET),
    )
    title = f"Second encoders, {cases} robots, 20 s each, skew of 0 to 5 ms"
    yield Table("arm_side", title, COLUMNS, rows)


if __name__ == "__main__":
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    for each in [faults(number)] if "faults" in sys.argv else measure(False, number):
        print(each.markdown(), flush=True)
