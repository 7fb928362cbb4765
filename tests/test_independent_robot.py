"""The independent simulated robot of the benchmarks: conservation laws and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.bound import impedance
from benchmarks.independent_robot import (
    LINK_DAMPING,
    Array,
    Experiment,
    Plants,
    Robot,
    _Linear,
    _Nonlinear,
    paper_motions,
    simulate,
    steady_state,
)
from benchmarks.real_robots import MANUTEC, PAPER, band, random_robot
from jointid import Elasticity, Inertia, estimate_transfer_matrix, extract_phasors, motor_response

STEP_S = 0.25e-3
THREE = random_robot(np.random.default_rng(3), 3)
ROTOR = Robot(M=[2e-3], M2=[[1e-3]], K=[1e-12], D=[1e-12], coulomb=[0.1])
"""A rotor on its own: its spring is next to nothing."""


def exact(robot: Robot, frequency_hz: Array) -> Experiment:
    return paper_motions(
        robot, frequency_hz, noise=0.0, encoder_counts=0, per_frequency=robot.n, periods=6.3
    )


def admittance(robot: Robot) -> Array:
    """Motor angle over motor torque of each record of one joint."""
    (records,) = simulate([(robot, exact(robot, np.array([4.0, 9.0, 17.0])))])
    phasors = extract_phasors(records, harmonics=1)
    return phasors.q[:, 0] / phasors.tau[:, 0]


def driven(robot: Robot, state: Array, torque: float, steps: int) -> Array:
    """States of one record of a nonlinear robot, shape (steps + 1, size)."""
    plants = Plants([robot])
    advance = _Nonlinear(plants, STEP_S, 1)
    x = advance.start()
    x[0, : state.size, 0] = state
    advance.direction[0, :, 0] = np.sign(x[0, plants.at["omega"], 0])
    states = [x]
    for _ in range(steps):
        states.append(advance(states[-1], np.full((1, robot.n, 1), torque)))
    return np.array(states)[:, 0, :, 0]


@pytest.mark.parametrize("robot", [PAPER, MANUTEC, THREE], ids=["paper", "Manutec", "three joints"])
def test_the_ideal_robot_has_the_response_of_the_model(robot: Robot) -> None:
    (records,) = simulate([(robot, exact(robot, band(robot, count=5)))])
    found = estimate_transfer_matrix(extract_phasors(records, harmonics=1))
    expected = motor_response(found.omega, Inertia(robot.M, robot.M2), Elasticity(robot.K, robot.D))
    size = np.sqrt(np.abs(np.diagonal(expected, axis1=1, axis2=2)))
    assert np.abs((found.H - expected) / (size[:, :, None] * size[:, None])).max() < 1e-4


def test_the_steady_state_is_the_simulated_one() -> None:
    experiment = exact(PAPER, np.array([5.0, 14.0]))
    (records,) = simulate([(PAPER, experiment)])
    phasors = extract_phasors(records, harmonics=1)
    q, tau, deflection = steady_state(PAPER, experiment)
    s = 2j * np.pi * experiment.frequency_hz
    Z = impedance(s, PAPER.M, PAPER.M2, PAPER.K, PAPER.D)
    np.testing.assert_allclose((Z @ q[:, :, None])[:, :, 0], tau, rtol=1e-9)
    # The sampled controller is a little late against the continuous one.
    np.testing.assert_allclose(np.abs(phasors.q), np.abs(q), rtol=0.03)
    assert deflection.shape == q.shape


@pytest.mark.parametrize("cubic", [0.0, 3000.0])
def test_energy_is_kept_without_damping(cubic: float) -> None:
    robot = replace(PAPER, D=0.0, cubic=cubic, gravity=0.4)
    plants = Plants([robot])
    advance = _Nonlinear(plants, STEP_S, 1) if cubic else _Linear(plants, STEP_S)
    x = advance.start() if isinstance(advance, _Nonlinear) else np.zeros((1, plants.size, 1))
    x[0, :8, 0] = [0.1, -0.05, 3.0, -2.0, 0.0, 0.02, 1.0, 0.5]
    begin = plants.energy(x)[0, 0]
    for _ in range(4000):
        x = advance(x, np.zeros((1, 2, 1)))
    np.testing.assert_allclose(plants.energy(x)[0, 0], begin, rtol=1e-5 if cubic else 1e-10)


def test_runge_kutta_meets_the_exact_transition() -> None:
    robot = replace(PAPER, loss_factor=0.02, link_share=0.2, link_hz=60.0, gravity=0.3, arm_viscous=1e-3)
    plants = Plants([robot])
    linear, other = _Linear(plants, STEP_S), _Nonlinear(plants, STEP_S, 1)
    x, y = np.zeros((1, plants.size, 1)), other.start()
    for k in range(400):
        torque = np.sin(0.05 * k + np.arange(2.0))[None, :, None]
        x, y = linear(x, torque), other(y, torque)
    np.testing.assert_allclose(y[:, : plants.size], x, atol=1e-6 * np.abs(x).max())


def test_a_motor_below_the_friction_level_does_not_move() -> None:
    stuck = driven(ROTOR, np.zeros(4), 0.0999, 100)
    assert not stuck[:, :2].any()


def test_a_motor_above_the_level_accelerates_by_the_rest() -> None:
    states = driven(ROTOR, np.zeros(4), 0.16, 100)
    np.testing.assert_allclose(states[-1, 1], (0.16 - 0.1) / 2e-3 * 100 * STEP_S, rtol=1e-9)


def test_friction_stops_a_motor_after_the_distance_of_its_energy() -> None:
    begin = np.array([0.0, 1.23, 0.0, 0.0])
    states = driven(ROTOR, begin, 0.0, 200)
    assert states[-1, 1] == 0.0
    np.testing.assert_allclose(states[-1, 0], 0.5 * 2e-3 * 1.23**2 / 0.1, rtol=1e-3)


def test_friction_levels_add_up() -> None:
    """Stribeck's part and the asymmetry act at rest, so a torque just below their sum moves nothing."""
    robot = replace(ROTOR, stribeck=0.05, asymmetry=0.2)
    assert not driven(robot, np.zeros(4), 0.1699, 50)[:, 0].any()
    assert driven(robot, np.zeros(4), 0.1701, 50)[-1, 0] > 0
    assert driven(robot, np.zeros(4), -0.1301, 50)[-1, 0] < 0


def test_presliding_friction_starts_as_a_spring() -> None:
    robot = replace(ROTOR, coulomb=0.4, presliding_rad=1e-3, bristle_damping=1.0)
    states = driven(robot, np.zeros(4), 0.01, 400)
    np.testing.assert_allclose(0.01 / states[-1, 0], 0.4 / 1e-3, rtol=0.05)


def test_backlash_passes_no_torque_within_its_play() -> None:
    free = replace(ROTOR, coulomb=0.0, K=50.0, backlash_rad=0.02)
    x = driven(free, np.array([0.0, 0.1, 0.0, 0.0]), 0.0, 200)
    assert np.all(np.abs(x[:, 0] - x[:, 2]) < 0.01)
    np.testing.assert_allclose(x[:, 1], 0.1, rtol=1e-9)
    wound = driven(free, np.array([0.03, 0.0, 0.0, 0.0]), 0.0, 1)
    np.testing.assert_allclose(wound[1, 1], -50.0 * 0.02 / 2e-3 * STEP_S, rtol=0.01)


def test_hysteresis_dissipates_its_loop() -> None:
    """Once around between ± x, far beyond presliding, costs nearly four times x times the level."""
    robot = replace(ROTOR, coulomb=0.0, hysteresis_Nm=0.05, hysteresis_rad=1e-4)
    advance = _Nonlinear(Plants([robot]), STEP_S, 1)
    omega, x, work = 20.0, advance.start(), 0.0
    for k in range(round(4 * np.pi / omega / STEP_S)):
        x[0, :4, 0] = 0.02 * np.sin(omega * k * STEP_S), 0.02 * omega * np.cos(omega * k * STEP_S), 0, 0
        z = x[0, -1, 0]
        work += 0.05 * z * x[0, 1, 0] * STEP_S
        x = advance(x, np.zeros((1, 1, 1)))
    np.testing.assert_allclose(work / 2, 4 * 0.02 * 0.05, rtol=0.03)


def test_the_loss_factor_is_nearly_constant() -> None:
    one = Robot(M=[2e-3], M2=[[4e-3]], K=[40.0], D=[0.0], loss_factor=[0.03])
    plants = Plants([one])
    for f in (5.0, 10.0, 20.0):
        s = 2j * np.pi * f
        x = np.linalg.solve(s * np.eye(plants.size) - plants.A[0], plants.B[0])[:, 0]
        gear = 4e-3 * s**2 * x[plants.at["arm"]] / (x[plants.at["theta"]] - x[plants.at["arm"]])
        np.testing.assert_allclose(gear.imag / gear.real, 0.03, rtol=0.05)
        np.testing.assert_allclose(gear.real, 40.0, rtol=0.02)


def test_lags_and_filters_turn_the_phasors() -> None:
    one = Robot(M=[2e-3], M2=[[4e-3]], K=[40.0], D=[0.05])
    s = 2j * np.pi * np.array([4.0, 9.0, 17.0])
    ideal = admittance(one)
    low_pass = 1 / (1 + s / (2 * np.pi * 50.0))
    for change, factor in (
        ({"lag_s": 5e-4}, np.exp(-5e-4 * s)),
        ({"position_filter_hz": 50.0}, low_pass),
        ({"reversed": -1.0}, 1.0),
    ):
        np.testing.assert_allclose(admittance(replace(one, **change)), ideal * factor, rtol=1e-4)
    filtered = admittance(replace(one, torque_filter_hz=50.0))
    # The filter sees the held torque, whose phasor is half a sample late.
    np.testing.assert_allclose(np.abs(filtered), np.abs(ideal / low_pass), rtol=2e-3)


def test_a_soft_link_adds_its_mode() -> None:
    one = Robot(M=[2e-3], M2=[[4e-3]], K=[40.0], D=[0.05])
    soft = replace(one, link_share=0.25, link_hz=80.0)
    s = 2j * np.pi * np.array([4.0, 9.0, 17.0])
    corner = 2 * np.pi * 80.0
    spring = 2 * LINK_DAMPING * corner * s + corner**2
    arm = 3e-3 + 1e-3 * spring / (s**2 + spring)
    gear = 40.0 + 0.05 * s
    expected = 1 / (s**2 * 2e-3 + gear - gear**2 / (s**2 * arm + gear))
    np.testing.assert_allclose(admittance(soft), expected, rtol=1e-4)


def test_axes_are_swapped_and_reversed_in_the_log_alone() -> None:
    experiment = exact(PAPER, np.array([8.0]))
    plain, other, turned = simulate(
        [
            (PAPER, experiment),
            (replace(PAPER, swapped=True), experiment),
            (replace(PAPER, reversed=[1.0, -1.0]), experiment),
        ]
    )
    np.testing.assert_array_equal(other[0].theta_rad, plain[0].theta_rad[:, ::-1])
    np.testing.assert_array_equal(turned[0].tau_Nm, plain[0].tau_Nm * [1.0, -1.0])


def test_noise_is_as_large_as_stated() -> None:
    experiment = replace(exact(PAPER, np.array([5.0, 8.0])), noise=0.03)
    quiet, noisy = simulate([(PAPER, replace(experiment, noise=0.0)), (PAPER, experiment)])
    for a, b in zip(quiet, noisy, strict=True):
        share = (b.tau_Nm - a.tau_Nm).std(axis=0) / (np.sqrt(2) * a.tau_Nm.std(axis=0))
        np.testing.assert_allclose(share, 0.03, rtol=0.1)


def test_a_seed_makes_the_same_records_again() -> None:
    experiment = paper_motions(PAPER, np.array([9.0]), seed=4)
    first, second = (simulate([(PAPER, experiment)])[0] for _ in range(2))
    np.testing.assert_array_equal(first[0].tau_Nm, second[0].tau_Nm)
