"""Six axes with gravity and friction, from joint angles to K and D."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import six_axes
from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Measurement,
    Motion,
    MotorFriction,
    RobotModel,
    extract_phasors,
    identify_elasticity,
    identify_motion,
    simulate_motion,
    simulate_records,
)
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.parameters import ParameterLayout
from jointid.estimation.motion_start import motion_start
from jointid.estimation.start_values import friction_start
from jointid.motion.spectra import motion_phasors
from tests.robots import SIX_AXES

ROBOT = RobotModel.parse("six.toml", SIX_AXES.encode())
POSE = np.deg2rad([0.0, -60.0, 100.0, 20.0, 40.0, 10.0])
INERTIA = ROBOT.inertia(POSE)
K = np.array([5.0e6, 7.5e6, 4.2e6, 1.3e6, 1.1e6, 0.4e6]) / ROBOT.gear_ratio**2
ELASTICITY = Elasticity(K, 0.003 * K)
FRICTION = MotorFriction(coulomb=[1.0, 1.2, 1.0, 0.35, 0.35, 0.3], viscous=0.004, step_s=5e-4)


@pytest.mark.parametrize(("frequencies", "rate_hz"), [(7, 1000.0), (14, 2000.0)])
def test_start_values_are_near_k_under_heavy_friction(frequencies: int, rate_hz: float) -> None:
    """Least squares is off by tens of per cent; the start values are not."""
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
    np.testing.assert_allclose(start["coulomb"], FRICTION.coulomb, rtol=0.1)
    # A wrong payload is found with it: K5 was 98 % too low.
    wrong = ROBOT.with_payload(mass=ROBOT.payload.mass + 35, mass_std=40.0).inertia(POSE)
    prior = InertiaPrior.of(wrong, *phasors.q.shape)
    loaded = friction_start(phasors, prior, layout.named(plain.estimate))
    assert loaded is not None
    np.testing.assert_allclose(loaded.K, K, rtol=0.4)
    found, given, true = (
        np.diag(M2) for M2 in (prior.symmetric(loaded["M2"])[0], prior.M2[0], INERTIA.M2)
    )
    assert np.abs(found - true).max() < 0.3 * np.abs(given - true).max()
    exact = layout.named(np.concatenate([K, ELASTICITY.D]))
    clean = extract_phasors(
        simulate_records(INERTIA, ELASTICITY, [6.0, 12.0, 25.0, 40.0], excitation=Excitation(periods=6))
    )
    assert friction_start(clean, InertiaPrior.of(INERTIA, *clean.q.shape), exact) is None


def test_motions_start_near_k_and_the_payload_with_friction() -> None:
    """Equation (8) alone is off by 99 %: its small differences are those of the friction."""
    records = simulate_motion(
        INERTIA,
        ELASTICITY,
        Motion("random", 3.0, 40.0, 4.0, velocity_rad_s=30.0, acceleration_rad_s2=1000.0),
        records=2,
        friction=FRICTION,
        measurement=Measurement(position_noise_rad=1e-5, torque_noise_Nm=0.01),
    )
    heavier = ROBOT.with_payload(mass=ROBOT.payload.mass + 35, mass_std=40)
    prior = InertiaPrior.of(heavier.inertia(POSE), 2, 6)
    segments = motion_phasors(records, np.array([INERTIA.M, INERTIA.M]))
    rows = np.array([segment.record for segment in segments.segments])
    start = motion_start(segments, prior.of_rows(rows))
    assert np.abs(start.K / K - 1).max() < 0.25
    assert np.all(start["coulomb"] > 0)
    found, given, true = (
        np.diag(M2) for M2 in (prior.symmetric(start["M2"])[0], prior.M2[0], INERTIA.M2)
    )
    assert np.abs(found - true).max() < 0.4 * np.abs(given - true).max()


def test_joints_that_move_in_turn_with_heavy_friction() -> None:
    """The others stick, so that friction takes the start values far off."""
    records = []
    for joint in range(6):
        velocity, acceleration = (np.full(6, size) for size in (1e-6, 1e-4))
        velocity[joint], acceleration[joint] = 30.0, 500.0
        records += simulate_motion(
            INERTIA,
            ELASTICITY,
            Motion("random", 4.0, 40.0, 1.5, velocity_rad_s=velocity, acceleration_rad_s2=acceleration),
            records=1,
            friction=FRICTION,
            measurement=Measurement(position_noise_rad=1e-5, torque_noise_Nm=0.01),
            seed=joint,
        )
    fit = identify_motion(records, INERTIA)
    assert np.all(np.abs(fit.K - K) < 3 * fit.standard_error[:6])
    np.testing.assert_allclose(fit.K[[0, 1, 2, 4]], K[[0, 1, 2, 4]], rtol=0.01)


def test_sines_of_joints_that_move_in_turn_with_heavy_friction() -> None:
    """Those that are held stick: the misfit was 268, and K up to 100 % off, after half a minute."""
    robot = six_axes.RobotModel.load(six_axes.ROBOT)
    records = six_axes.records_of("one-at-a-time", robot, 3.0, 14)
    fit = identify_elasticity(extract_phasors(records), robot.inertia(six_axes.POSE))
    stiffness = six_axes.JOINT_K / robot.gear_ratio**2
    assert fit.misfit < 1.5
    np.testing.assert_allclose(fit.K, stiffness, rtol=0.003)
    assert np.all(np.abs(fit.K - stiffness) < 3 * fit.standard_error[:6])
    # Records in which friction holds a joint do not enlarge its error: it was 2.1 % of K1.
    assert np.all(fit.standard_error[:6] < 0.005 * stiffness)
