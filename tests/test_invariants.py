"""Invariance of the answer to controllers, excitation, clock, amplitude and units; energy balance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants import (
    BAND_HZ,
    PAPER,
    PARALLELOGRAM,
    ROBOTS,
    SERIAL,
    campaign,
    circular,
    exact_phasors,
    motion,
    plant_phasors,
    rubbing,
    state_space,
    steady_records,
)

from jointid import (
    Inertia,
    SineRecord,
    estimate_transfer_matrix,
    extract_phasors,
    identify_elasticity,
    motor_response,
    simulate_records,
    single_record_response,
)
from jointid.estimation.candidates import Model
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.model_fits import fit_model
from jointid.estimation.regression_start import regressed, regression_start
from jointid.simulation.experiment import Controller, Excitation

METHODS = ["least-squares", "explicit", "weighted", "maximum-likelihood"]
SHORT = Excitation(periods=6.3)
CONTROLLERS = {
    "soft": Controller(bandwidth_hz=2.0, feedforward=False),
    "stiff": Controller(bandwidth_hz=9.0, damping_ratio=0.8),
    "uneven": Controller(bandwidth_hz=[3.0, 7.0], torque_delay_s=0.00037),
}
ANGLE, TORQUE, TIME = 8.0, 1024.0, 1 / 32
"""Other units: powers of two, which change no digit."""


def robot_in_other_units(inertia: Inertia) -> Inertia:
    mass = TORQUE * TIME**2 / ANGLE
    return Inertia(M=inertia.M * mass, M2=inertia.M2 * mass)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_records_are_a_steady_state_of_equation_1(n: int) -> None:
    """The phasors of the tests' records, driven through the state space in time, stay where they are."""
    from scipy.linalg import expm

    inertia, elasticity = ROBOTS[n]
    A, B = state_space(inertia, elasticity)
    torque = campaign([7.0], n, 1)[1][0]
    omega, step = 2 * np.pi * 7.0, 2e-4
    # Rotors and arm with two more states that make the sine: an exact step of the whole.
    drive = np.zeros((4 * n + 2, 4 * n + 2))
    drive[: 4 * n, : 4 * n] = A
    drive[: 4 * n, 4 * n :] = B @ np.column_stack([torque.real, torque.imag])
    drive[4 * n :, 4 * n :] = [[0, omega], [-omega, 0]]
    state = np.linalg.solve(1j * omega * np.eye(4 * n) - A, B @ torque).imag
    state = np.concatenate([state, [0.0, 1.0]])
    advance, angles = expm(drive * step), []
    for _ in range(900):
        angles.append(state[:n])
        state = advance @ state
    time = step * np.arange(900)
    q = motion(inertia, elasticity, np.array([7.0]), torque[None])
    expected = np.imag(q * np.exp(1j * omega * time)[:, None])
    assert np.allclose(angles, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("n", [1, 2, 3])
def test_response_does_not_depend_on_the_controllers(n: int) -> None:
    """The paper's central claim: H depends on the robot and not on the controllers."""
    inertia, elasticity = ROBOTS[n]
    frequencies = [4.0, 9.7, 17.0, 26.0]
    curves, alone = [], []
    for name, controller in CONTROLLERS.items():
        if name == "uneven" and n != 2:
            continue
        records = simulate_records(
            inertia, elasticity, frequencies, excitation=SHORT, controller=controller
        )
        phasors = extract_phasors(records)
        found = estimate_transfer_matrix(phasors)
        assert np.allclose(found.omega, 2 * np.pi * np.array(frequencies))
        expected = motor_response(found.omega, inertia, elasticity)
        largest = np.abs(expected).max(axis=(1, 2), keepdims=True)
        assert np.all(np.abs(found.H - expected) < 2e-4 * largest)
        curves.append(found.H / largest)
        alone.append(single_record_response(phasors)[::n, 0])
    assert np.allclose(curves[0], curves[1], rtol=0, atol=2e-4)
    if n > 1:  # one record alone does depend on them: that is why two are needed
        assert np.any(np.abs(alone[0] / alone[1] - 1) > 0.1)


@pytest.mark.parametrize("method", METHODS)
def test_elasticity_does_not_depend_on_the_controllers(method: str) -> None:
    for controller in CONTROLLERS.values():
        records = simulate_records(
            SERIAL, PAPER, [4.0, 9.7, 17.0, 26.0], excitation=SHORT, controller=controller
        )
        fit = identify_elasticity(extract_phasors(records), SERIAL, method=method)
        assert np.allclose(fit.K, PAPER.K, rtol=5e-4)
        assert np.allclose(fit.D, PAPER.D, rtol=5e-3)


@pytest.mark.parametrize("pattern", ["orthogonal", "one-at-a-time"])
def test_elasticity_does_not_depend_on_which_joints_move(pattern: str) -> None:
    excitation = Excitation(pattern=pattern, periods=6.3)
    records = simulate_records(PARALLELOGRAM, PAPER, [5.0, 11.0, 19.0], excitation=excitation)
    fit = identify_elasticity(extract_phasors(records), PARALLELOGRAM, method="least-squares")
    assert np.allclose(fit.K, PAPER.K, rtol=5e-4)
    assert np.allclose(fit.D, PAPER.D, rtol=5e-3)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_clock_of_the_record_does_not_matter(n: int) -> None:
    """A time shift is a phase, the same for all signals, and cancels."""
    inertia, elasticity = ROBOTS[n]
    records = steady_records(inertia, elasticity, *campaign(BAND_HZ, n), noise=(1e-5, 1e-3), seed=2)
    shifted = [
        SineRecord(r.frequency_hz, r.time_s + 0.0173 * i - 3.0, r.theta_rad, r.tau_Nm)
        for i, r in enumerate(records)
    ]
    here, there = extract_phasors(records), extract_phasors(shifted)
    turn = np.exp(-1j * here.omega * (0.0173 * np.arange(len(records)) - 3.0))
    assert np.allclose(there.z, here.z * turn[:, None], rtol=1e-6, atol=1e-12)
    assert np.allclose(there.covariance, here.covariance, rtol=1e-5)
    fits = [identify_elasticity(p, inertia, method="weighted") for p in (here, there)]
    assert np.allclose(fits[0].K, fits[1].K, rtol=1e-7)
    assert np.allclose(fits[0].D, fits[1].D, rtol=1e-6)


def test_linear_system_answers_in_proportion() -> None:
    """Twice the torque, twice the motion; the sum of two torques, the sum of two motions."""
    one, two = np.array([[1.0, 0.3j]]), np.array([[0.2 - 0.5j, 1.0]])
    f = np.array([8.3])
    sums = motion(SERIAL, PAPER, f, one) + 2 * motion(SERIAL, PAPER, f, two)
    assert np.allclose(motion(SERIAL, PAPER, f, one + 2 * two), sums, rtol=1e-10)


def test_motors_supply_the_power_that_the_dampers_dissipate() -> None:
    """Over a period the work of the motors equals the loss of the dampers."""
    frequencies, torques = campaign(BAND_HZ, 2)
    omega = 2 * np.pi * frequencies
    q = motion(SERIAL, PAPER, frequencies, torques)
    put_in = 0.5 * np.real(np.sum(torques * np.conj(1j * omega[:, None] * q), axis=1))
    s2 = -(omega[:, None] ** 2)
    arm = (torques - SERIAL.M * s2 * q) @ np.linalg.inv(SERIAL.M2) / s2
    taken_out = 0.5 * np.sum(PAPER.D * np.abs(omega[:, None] * (q - arm)) ** 2, axis=1)
    assert np.allclose(put_in, taken_out, rtol=1e-9)


@pytest.mark.parametrize(
    "effects",
    [
        (),
        ("cubic", "arm_viscous"),
        ("backlash",),
        ("hysteresis",),
        ("arm_coulomb",),
        ("link", "torque_filter"),
        ("position_filter", "load"),
    ],
)
def test_the_answer_does_not_depend_on_the_units(effects: tuple[str, ...]) -> None:
    """Of sines with friction and rounding, from the records to the errors."""
    step = 2 * np.pi / 8192
    records = [
        replace(r, theta_rad=step * np.round(r.theta_rad / step), tau_Nm=np.round(r.tau_Nm, 2))
        for r in rubbing()
    ]
    others = [
        replace(
            r,
            frequency_hz=r.frequency_hz / TIME,
            time_s=r.time_s * TIME,
            theta_rad=r.theta_rad * ANGLE,
            tau_Nm=r.tau_Nm * TORQUE,
        )
        for r in records
    ]
    found = []
    for logged, inertia in ((records, PARALLELOGRAM), (others, robot_in_other_units(PARALLELOGRAM))):
        phasors = extract_phasors(logged, harmonics=15)
        prior = InertiaPrior.of(inertia, *phasors.q.shape)
        noise = spring_equations(phasors, inertia).noise
        start = regression_start(phasors, prior)
        fit = fit_model(phasors, prior, start, noise, Model(0.0, delay=True, effects=effects))
        sizes = np.r_[fit.p[:4], np.sqrt(np.diag(fit.elasticity_covariance))]
        found.append([*sizes, fit.cost, fit.misfit])
    units = np.array([1, 1, TIME, TIME]) * TORQUE / ANGLE
    np.testing.assert_allclose(found[1], np.r_[units, units, 1, 1] * found[0], rtol=1e-7)


def test_a_start_from_held_joints_does_not_depend_on_the_units() -> None:
    inertia, elasticity = ROBOTS[3]
    moved = plant_phasors(inertia, elasticity, *campaign(BAND_HZ, 3))
    held = np.arange(len(moved.q))[:, None] % 3 == np.arange(3)
    z = moved.z * np.hstack([~held, np.ones_like(held)])
    variance = np.tile(np.diag((1e-2 * np.abs(z).max(axis=0)) ** 2).astype(complex), (len(z), 1, 1))
    z = z + circular(np.random.default_rng(1), variance, 1)[0] * (z != 0)
    units = np.repeat([ANGLE, TORQUE], 3)
    found = []
    for scale, time, mass in ((np.ones(6), 1.0, inertia), (units, TIME, robot_in_other_units(inertia))):
        q, tau = np.split(z * scale, 2, axis=1)
        frequencies = moved.frequency_found_hz / time
        phasors = exact_phasors(frequencies, q, tau, variance * np.outer(scale, scale))
        start, misfit = regressed(phasors, InertiaPrior.of(mass, *q.shape), stiff=1.0)
        found.append([*start.K, *start.D, misfit])
    expected = np.r_[np.full(3, 1.0), np.full(3, TIME)] * TORQUE / ANGLE
    np.testing.assert_allclose(found[1], np.r_[expected, 1] * found[0], rtol=1e-7)
