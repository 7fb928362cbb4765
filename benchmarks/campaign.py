"""The paper's robot and the campaigns that several parts measure: 18 frequencies × 2 records."""

from __future__ import annotations

import numpy as np

from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Inertia,
    Measurement,
    MotorFriction,
    SineRecord,
    simulate_records,
)

INERTIA = Inertia(M=[0.0025, 0.0010], M2=[[0.004104, 0.000395], [0.000395, 0.001889]])
TRUTH = Elasticity(K=[43.0, 7.5], D=[0.10, 0.015])
ANSWER = np.concatenate([TRUTH.K, TRUTH.D])
FREQUENCIES_HZ = np.geomspace(3.0, 30.0, 18).round(2)
RATE_HZ = 4000.0
ENCODER_COUNTS = 65536
COUNT_RAD = 2 * np.pi / ENCODER_COUNTS
TORQUE_NOISE_NM = (0.02, 0.01)
"""Standard deviation of each logged sample."""
VISCOUS = np.array([0.002, 0.0005])
FRICTION = {"none": (0.0, 0.0), "mild": (0.05, 0.012), "heavy": (0.4, 0.08)}
"""Coulomb friction at the motors, N·m. Heavy: about half the smallest torque amplitude; joints stick."""


def simulated(
    friction: str,
    seed: int,
    *,
    frequencies_hz: np.ndarray | None = None,
    periods: float = 12.5,
    rate_hz: float = RATE_HZ,
    unstated_delay_s: float = 0.0,
) -> tuple[SineRecord, ...]:
    """A campaign in closed loop with a 16-bit encoder and noise on the logged torque.

    With a delay the records state no timing, not even that torques are held.
    """
    coulomb = FRICTION[friction]
    return simulate_records(
        INERTIA,
        TRUTH,
        FREQUENCIES_HZ if frequencies_hz is None else frequencies_hz,
        excitation=Excitation(periods=periods, velocity_rad_s=8.0),
        controller=Controller(sample_rate_hz=rate_hz, torque_delay_s=unstated_delay_s),
        friction=MotorFriction(coulomb=coulomb, viscous=VISCOUS if any(coulomb) else 0.0),
        measurement=Measurement(encoder_counts=ENCODER_COUNTS, torque_noise_Nm=TORQUE_NOISE_NM),
        declare_timing=unstated_delay_s == 0,
        seed=seed,
    )
