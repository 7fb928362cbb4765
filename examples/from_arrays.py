"""K and D from NumPy arrays: any source of motor angles and torques will do."""

from __future__ import annotations

import numpy as np

from jointid import (
    Elasticity,
    Inertia,
    Measurement,
    SineRecord,
    Study,
    analyse,
    simulate_records,
)

INERTIA = Inertia(M=[0.0025, 0.0010], M2=[[0.0041, 0.0004], [0.0004, 0.0019]])  # kg·m², motor side


def measured() -> list[tuple[float, np.ndarray, np.ndarray, np.ndarray]]:
    """Stand-in for your own log: frequency in Hz, times in s, angles in rad, torques in N·m."""
    simulated = simulate_records(
        INERTIA,
        Elasticity(K=[43.0, 7.5], D=[0.10, 0.015]),
        np.linspace(3, 28, 9),
        measurement=Measurement(encoder_counts=65536, torque_noise_Nm=0.03),
    )
    return [(r.frequency_hz, r.time_s, r.theta_rad, r.tau_Nm) for r in simulated]


def main() -> None:
    records = [
        SineRecord(frequency_hz, time_s, theta_rad, tau_Nm, torque_hold=True)
        for frequency_hz, time_s, theta_rad, tau_Nm in measured()
    ]
    analysis = analyse(Study(records, INERTIA, inertia_std=0.05))
    fit = analysis.fit
    print(analysis.state, "-", analysis.headline)
    names = ["K1", "K2", "D1", "D2"]
    for name, value, error in zip(names, [*fit.K, *fit.D], fit.standard_error, strict=True):
        print(f"{name} = {value:.6g} ± {error:.1g}")
    for finding in analysis.findings:
        print(f"[{finding.level}] {finding.title}: {finding.remedy}")


if __name__ == "__main__":
    main()
