"""Stiffness from second encoders on random six-axis robots: errors, pulls, skew, predictions.

python -m benchmarks.arm_side [cases]
"""

from __future__ import annotations

import sys

import numpy as np

from jointid import identify_arm_side
from tests.arm_side_robot import ARC_SECOND, ROBOT, SENSORS, motion_record, random_truth


def table(title: str, payload_known: bool, cases: int, **changes: float) -> None:
    pulls, errors, skews, left, refused = [], [], [], [], 0
    for seed in range(cases):
        truth = random_truth(np.random.default_rng(seed), **changes)
        robot = ROBOT.with_payload(mass=truth.payload_kg, mass_std=0.0) if payload_known else ROBOT
        fit = identify_arm_side(motion_record(truth, seed + 100), robot)
        K, sigma = fit.K[:SENSORS], fit.standard_error[:SENSORS]
        kept = np.isfinite(K)
        refused += int((~kept).sum())
        pulls += list(((K - truth.K) / sigma)[kept])
        errors += list(100 * np.abs(K / truth.K - 1)[kept])
        skews += list(1e3 * np.abs(fit.skew_s[:SENSORS] - truth.skew_s))
        other = motion_record(truth, seed + 5000)
        assert other.arm_rad is not None
        rest = other.theta_rad / ROBOT.gear_ratio - other.arm_rad - fit.predict(other)
        left += list(rest[:, :SENSORS].std(axis=0) / ARC_SECOND)
    pull = np.array(pulls)
    print(
        f"{title:34s} {cases:5d} {pull.size:5d} {refused:7d} {np.median(errors):8.2f}"
        f" {np.max(errors):7.2f}"
        f" {np.mean(pull):6.2f} {np.sqrt(np.mean(pull**2)):6.2f} {np.sum(np.abs(pull) > 2):4d}"
        f" {np.sum(np.abs(pull) > 3):4d} {np.max(skews):9.4f}"
        f" {np.median(left):7.1f} {np.max(left):7.1f}",
        flush=True,
    )


def main() -> None:
    cases = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    print(
        f"{'records of 20 s, skew 0 to 5 ms':34s} cases    K refused  K err %  max % pull"
        "   rms  > 2  > 3  skew ms  predict and max, arc seconds"
    )
    quiet = {"eccentricity": 2.0, "ripple": 1.0, "teeth": 2.0, "vibration": 0.3, "hysteresis": 2.0}
    table("payload unknown by 40 kg", False, cases)
    table("payload known, quiet gear", True, cases, **quiet)


if __name__ == "__main__":
    main()
