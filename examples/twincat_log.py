"""Write ``cell7.csv`` as TwinCAT Scope exports it: twenty sine runs of two joints in one log.

Positions are those of the joints in degrees, torques those of the motors in per cent of their rated
torque, as drives log them.
"""

from __future__ import annotations

import numpy as np

from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Inertia,
    Measurement,
    MotorFriction,
    simulate_records,
)

GEAR_RATIO = np.array([101.0, -93.5])
RATED_NM = np.array([8.2, 2.1])
RATE_HZ = 1000.0
CHANNELS = (("ActPos", "° (Angle)"), ("ActTorque", "%"))


def log() -> np.ndarray:
    """Position and torque of joint 1, then of joint 2, one row per sample: rests between the sines."""
    records = simulate_records(
        Inertia(M=[0.0025, 0.0010], M2=[[0.0046, 0.00052], [0.00052, 0.0017]]),
        Elasticity(K=[52.3, 6.1], D=[0.12, 0.012]),
        [4, 6, 8, 10, 12.5, 15, 18, 21, 25, 30],
        excitation=Excitation(periods=12.5),
        friction=MotorFriction(coulomb=[0.06, 0.015], viscous=[0.002, 0.0005]),
        controller=Controller(sample_rate_hz=RATE_HZ),
        measurement=Measurement(encoder_counts=2**20, torque_noise_Nm=0.01),
    )
    ramp = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, 800))[:, None]
    parts, last = [], np.zeros(2)
    for record in records:
        moved = last + (record.theta_rad[0] - last) * ramp
        theta = np.vstack([moved, record.theta_rad])
        tau = np.vstack([0 * moved, record.tau_Nm])
        position, torque = np.degrees(theta / GEAR_RATIO), 100 * tau / RATED_NM
        parts.append(np.stack([position, torque], axis=2).reshape(len(theta), 4))
        last = record.theta_rad[-1]
    return np.vstack(parts)


def main() -> None:
    rows = log()
    names = [(f"Axis{axis}.{name}", unit) for axis in (1, 2) for name, unit in CHANNELS]
    about = [
        ["Name", "Cell 7"],
        [],
        ["Name", *(name for name, _ in names)],
        ["Data-Type", *["REAL64"] * 4],
        ["SampleTime[ms]", *[f"{1e3 / RATE_HZ:g}"] * 4],
        ["SymbolName", *(f"NC.Axes.{name}" for name, _ in names)],
        ["Unit", *(unit for _, unit in names)],
        [],
    ]
    lines = ["\t".join(row) for row in about]
    for k, row in enumerate(rows):
        cells = [f"{1e3 * k / RATE_HZ:g}", *(f"{value:.9g}" for value in row)]
        lines.append("\t".join(cells).replace(".", ","))
    with open("cell7.csv", "w", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\nEOF\n")
    print(f"cell7.csv: {len(rows)} rows, {len(rows) / RATE_HZ:.0f} s")


if __name__ == "__main__":
    main()
