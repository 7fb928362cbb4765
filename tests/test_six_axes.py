"""Six axes with gravity and friction, from joint angles to K and D."""

from __future__ import annotations

import numpy as np
import pytest

from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Measurement,
    MotorFriction,
    RobotModel,
    extract_phasors,
    identify_elasticity,
    simulate_records,
)
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.parameters import ParameterLayout
from jointid.estimation.start_values import friction_start
from tests.robots import SIX_AXES

ROBOT = RobotModel.parse("six.toml", SIX_AXES.encode())
INERTIA = ROBOT.inertia(np.deg2rad([0.0, -60.0, 100.0, 20.0, 40.0, 10.0]))
K = np.array([5.0e6, 7.5e6, 4.2e6, 1.3e6, 1.1e6, 0.4e6]) / ROBOT.gear_ratio**2
ELASTICITY = Elasticity(K, 0.003 * K)
FRICTION = MotorFriction(coulomb=[1.0, 1.2, 1.0, 0.35, 0.35, 0.3], viscous=0.004)


@pytest.mark.parametrize(("frequencies", "rate_hz"), [(8, 1000.0), (14, 2000.0)])
def test_heavy_friction_does_not_hide_the_springs(frequencies: int, rate_hz: float) -> None:
    """Plain least squares is off by tens of per cent; the start is not."""
    records = simulate_records(
        INERTIA,
        ELASTICITY,
        np.geomspace(3, 40, frequencies),
        excitation=Excitation(periods=6, settle_s=0.5),
        controller=Controller(sample_rate_hz=rate_hz),
        friction=FRICTION,
        measurement=Measurement(position_noise_rad=1e-5, torque_noise_Nm=0.01),
    )
    phasors = extract_phasors(records)
    plain = identify_elasticity(phasors, INERTIA, method="least-squares")
    assert np.abs(plain.K / K - 1).max() > 0.6
    layout = ParameterLayout.of(6)
    start = friction_start(
        phasors, InertiaPrior.of(INERTIA, *phasors.q.shape), layout.named(plain.estimate)
    )
    assert start is not None
    np.testing.assert_allclose(start.K, K, rtol=0.4)
    np.testing.assert_allclose(start.coulomb, FRICTION.coulomb, rtol=0.1)
    exact = layout.named(np.concatenate([K, ELASTICITY.D]))
    clean = extract_phasors(simulate_records(INERTIA, ELASTICITY, [6.0, 12.0, 25.0, 40.0]))
    assert friction_start(clean, InertiaPrior.of(INERTIA, *clean.q.shape), exact) is None
