"""The simulated robot: exact linear dynamics, set-valued friction, and the log of a controller."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants import PAPER, PARALLELOGRAM, ROBOTS, SERIAL
from random_cases import examples
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.signal import find_peaks

from jointid.errors import JointIdError
from jointid.joints import Elasticity, Inertia, motor_response
from jointid.simulation.closed_loop import simulate_records
from jointid.simulation.experiment import Controller, Excitation, Measurement, MotorFriction
from jointid.simulation.motor_dynamics import constant_torque, plant, step_with_friction

MANUTEC = (
    Inertia([0.0013, 0.0013], [[0.002274, 0.003522], [0.003522, 0.007068]]),
    Elasticity([8.0, 58.0], [0.01, 0.04]),
)
SINGLE = ROBOTS[1]
PLANTS = {
    "single": SINGLE,
    "parallelogram": (PARALLELOGRAM, PAPER),
    "serial": (SERIAL, PAPER),
    "manutec": MANUTEC,
    "three": ROBOTS[3],
}
SHORT = Excitation(duration_s=1.0)


def phasor(signal, record):
    """Sine fit with offset and drift, y = a + ib for a sin ωt + b cos ωt."""
    t, w = record.time_s, record.omega
    columns = np.stack([np.sin(w * t), np.cos(w * t), np.ones_like(t), t], axis=1)
    a, b, *_ = np.linalg.lstsq(columns, signal, rcond=None)[0]
    return a + 1j * b


def phasors(record, delay_s=None):
    """Position and acting torque: the logged one, held over the sample and delayed."""
    w, T = record.omega, record.interval_s
    delay = record.torque_delay_s if delay_s is None else delay_s
    acting = np.exp(-1j * w * (T / 2 + delay)) * np.sinc(w * T / 2 / np.pi)
    return phasor(record.theta_rad, record), acting * phasor(record.tau_Nm, record)


def measured_response(records, delay_s=None):
    """H = Y T⁻¹ of the records of one frequency, equations (17)-(18)."""
    q, tau = (np.array(z).T for z in zip(*(phasors(r, delay_s) for r in records), strict=True))
    return -(records[0].omega ** 2) * q @ np.linalg.pinv(tau)


def assert_response(records, inertia, elasticity, *, tolerance=1e-6, delay_s=None):
    for _, group in itertools.groupby(records, key=lambda r: r.omega):
        group = list(group)
        wanted = motor_response([group[0].omega], inertia, elasticity)[0]
        found = measured_response(group, delay_s)
        assert np.abs(found - wanted).max() < tolerance * np.abs(wanted).max()


def friction_phasor(record, inertia, elasticity):
    """Torque that the elastic model does not account for."""
    q, tau = phasors(record)
    return tau + record.omega**2 * np.linalg.solve(
        motor_response([record.omega], inertia, elasticity)[0], q
    )


# --- the linear robot is exact --------------------------------------------------------------------


@pytest.mark.parametrize("delay_s", [0.0, 0.00025, 0.00037, 0.0013])
@pytest.mark.parametrize("robot", PLANTS)
def test_records_carry_the_transfer_matrix_of_the_model(robot, delay_s):
    inertia, elasticity = PLANTS[robot]
    records = simulate_records(
        inertia,
        elasticity,
        [3.0, 9.7, 30.0],
        excitation=SHORT,
        controller=Controller(torque_delay_s=delay_s),
    )
    assert len(records) == 3 * inertia.n
    assert_response(records, inertia, elasticity)


@examples(15, derandomize=True)
@given(n=st.integers(1, 3), draw=st.integers(0, 10_000), delay_s=st.floats(0.0, 0.001))
def test_any_stable_robot_gives_its_transfer_matrix(n, draw, delay_s):
    rng = np.random.default_rng(draw)
    arm = rng.uniform(0.001, 0.01, n)
    mix = np.linalg.qr(rng.standard_normal((n, n)))[0]
    inertia = Inertia(rng.uniform(0.001, 0.003, n), (mix * arm) @ mix.T)
    K = inertia.M * (2 * np.pi * rng.uniform(8, 25, n)) ** 2
    elasticity = Elasticity(K, K * rng.uniform(5e-4, 3e-3, n))
    records = simulate_records(
        inertia,
        elasticity,
        [rng.uniform(3, 30)],
        excitation=Excitation(duration_s=0.5),
        controller=Controller(bandwidth_hz=4.0, torque_delay_s=delay_s),
    )
    assert_response(records, inertia, elasticity, tolerance=1e-5)


def test_viscous_friction_is_a_torque_on_the_motor():
    viscous = np.array([0.01, 0.004])
    records = simulate_records(
        SERIAL, PAPER, [8.0], excitation=SHORT, friction=MotorFriction(viscous=viscous)
    )
    for record in records:
        q, _ = phasors(record)
        found = friction_phasor(record, SERIAL, PAPER)
        np.testing.assert_allclose(found, 1j * record.omega * viscous * q, rtol=1e-4)


def test_logged_torque_is_the_documented_control_law():
    controller = Controller(position_gain=[30.0, 9.0], velocity_gain=[0.4, 0.2], torque_delay_s=0.0006)
    (record,) = simulate_records(
        SERIAL,
        PAPER,
        [4.0],
        excitation=Excitation(
            pattern=[[1.0, 0.5j]],
            velocity_rad_s=0.2 * 2 * np.pi * 4.0,
            acceleration_rad_s2=1e9,
            duration_s=0.5,
        ),
        controller=controller,
        friction=MotorFriction([0.1, 0.05]),
        measurement=Measurement(encoder_counts=8192),
    )
    A, w, T = 0.2 * np.array([1.0, 0.5j]), record.omega, record.interval_s
    r = np.imag(A * np.exp(1j * w * record.time_s)[:, None])
    y = record.theta_rad
    expected = (
        np.array([30.0, 9.0]) * (r - y)[1:]
        + np.array([0.4, 0.2]) * np.diff(r - y, axis=0) / T
        - w**2 * r[1:] @ (np.diag(SERIAL.M) + SERIAL.M2)
    )
    np.testing.assert_allclose(record.tau_Nm[1:], expected, atol=1e-9)


@pytest.mark.parametrize("delay_s", [0.0, 0.0005, 0.0011])
def test_run_starts_in_the_steady_state(delay_s):
    records = simulate_records(
        *MANUTEC,
        [7.0],
        excitation=Excitation(duration_s=1.0),
        controller=Controller(torque_delay_s=delay_s),
    )
    for record in records:
        omega, t = record.omega, record.time_s
        sine = np.imag(phasor(record.theta_rad, record) * np.exp(1j * omega * t)[:, None])
        assert np.abs(record.theta_rad - sine).max() < 1e-9


def test_settling_time_does_not_shift_the_reference():
    early, late = (
        simulate_records(SERIAL, PAPER, [5.0], excitation=Excitation(duration_s=0.5, settle_s=s))
        for s in (0.0, 0.7)
    )
    for one, other in zip(early, late, strict=True):
        np.testing.assert_allclose(one.theta_rad, other.theta_rad, atol=1e-11)


def test_an_undeclared_delay_changes_the_response():
    settings = {"excitation": SHORT, "controller": Controller(torque_delay_s=0.001)}
    silent = simulate_records(SERIAL, PAPER, [20.0], **settings, declare_timing=False)
    assert all(not r.torque_hold and r.torque_delay_s == 0 for r in silent)
    with pytest.raises(AssertionError):
        assert_response(silent, SERIAL, PAPER, tolerance=0.05)
    assert_response(silent, SERIAL, PAPER, delay_s=0.001)


# --- stability ------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay_s", [0.0, 0.002])
@pytest.mark.parametrize("robot", PLANTS)
def test_default_controller_is_stable(robot, delay_s):
    records = simulate_records(
        *PLANTS[robot], [10.0], excitation=SHORT, controller=Controller(torque_delay_s=delay_s)
    )
    assert np.abs(records[0].theta_rad).max() < 1.0


@pytest.mark.parametrize(
    "controller",
    [
        Controller(torque_delay_s=0.02),
        Controller(bandwidth_hz=500.0),
        Controller(velocity_gain=50.0),
        Controller(sample_rate_hz=100.0),
    ],
)
def test_unstable_loop_is_refused(controller):
    with pytest.raises(JointIdError, match=r"closed loop is unstable.*must stay below 1.*Lower"):
        simulate_records(SERIAL, PAPER, [5.0], controller=controller)


# --- friction -------------------------------------------------------------------------------------


def test_friction_steps_follow_a_tight_integration_through_reversal_and_rest():
    coulomb, torque = np.array([0.3, 0.05]), np.array([0.25, 0.0])
    A, B = plant(SERIAL, PAPER, np.array([0.002, 0.001]), np.zeros(2))
    x0 = np.array([0.1, -0.2, 0.0, 0.0, 6.0, -4.0, 0.0, 3.0])
    duration, step, width = 0.4, 1.25e-4, 1e-6

    def smooth(t, x):
        return A @ x + B @ (torque - coulomb * np.tanh(x[4:6] / width))

    times = np.linspace(0, duration, 41)
    wanted = solve_ivp(smooth, (0, duration), x0, method="LSODA", t_eval=times, rtol=1e-9, atol=1e-11).y
    stretch = constant_torque(A, B, step, older=False)
    Z = np.concatenate([x0, torque])[:, None]
    worst, standing = np.zeros(8), False
    for k in range(round(duration / step)):
        Z[8:, 0] = torque
        step_with_friction(Z, stretch, coulomb[:, None])
        if (k + 1) % 80 == 0:
            worst = np.maximum(worst, np.abs(Z[:8, 0] - wanted[:, (k + 1) // 80]))
        standing |= bool(Z[4, 0] == 0)
    assert standing  # else the case does not test rest
    assert worst[:4].max() < 2e-5
    assert worst[4:].max() < 2e-3


def test_a_sticking_joint_has_zero_velocity():
    records = simulate_records(
        PARALLELOGRAM,
        PAPER,
        [3.0, 12.0],
        excitation=Excitation(pattern="one-at-a-time", duration_s=1.0, settle_s=3.0),
        controller=Controller(sample_rate_hz=2000.0),
        friction=MotorFriction([0.1, 1.0], step_s=5e-4),
    )
    for record in (records[0], records[2]):
        assert np.ptp(record.theta_rad[:, 1]) == 0.0
        assert np.ptp(record.theta_rad[:, 0]) > 0.01


def test_friction_torque_is_the_sign_of_the_velocity():
    coulomb = np.array([0.2, 0.05])
    for record in simulate_records(
        SERIAL,
        PAPER,
        [5.0],
        excitation=Excitation(periods=4, settle_s=1.0),
        controller=Controller(sample_rate_hz=16000.0),
        friction=MotorFriction(coulomb),
    ):
        # Equation (2) over whole periods: a fitted drift would take up a part of friction's harmonics.
        s = 1j * record.omega
        sine = 2j * np.exp(-s * record.time_s) / record.time_s.size
        q, tau = sine @ record.theta_rad, sine @ record.tau_Nm
        tau = tau * np.exp(-s * record.interval_s / 2)  # the hold; its sinc is 1 - 2e-7 here
        H = motor_response([record.omega], SERIAL, PAPER)[0]
        found = tau - np.linalg.solve(H, s**2 * q)
        velocity = CubicSpline(record.time_s, record.theta_rad).derivative()
        t = (np.arange(300_000) + 0.5) / 300_000 * 3 / record.frequency_hz
        wanted = coulomb * (2j * np.exp(-s * t) / t.size @ np.sign(velocity(t)))
        assert np.abs((found - wanted) / coulomb).max() < 6e-4


def test_input_energy_equals_the_loss_by_friction_and_damping():
    coulomb, viscous = np.array([0.4, 0.1]), np.array([0.004, 0.002])
    for record in simulate_records(
        SERIAL,
        PAPER,
        [5.0],
        excitation=Excitation(periods=10),
        friction=MotorFriction(coulomb, viscous),
    ):
        # Whole periods; the torque is held, so its work over a sample is exact.
        moved = np.diff(record.theta_rad[: 9 * 800 + 1], axis=0)
        fed = (record.tau_Nm[: 9 * 800] * moved).sum()
        rubbed = (coulomb * np.abs(moved)).sum() + (viscous * moved**2).sum() / record.interval_s
        twist = np.zeros(2)
        for h in (1, 3, 5, 7):  # the arm follows the motor, harmonic by harmonic
            s = 1j * h * record.omega
            t = record.time_s[: 9 * 800]
            q = 2 * np.exp(-s * t) @ record.theta_rad[: 9 * 800] / t.size
            spring = np.diag(PAPER.K + s * PAPER.D)
            arm = np.linalg.solve(SERIAL.M2 * s**2 + spring, spring @ q)
            twist += np.abs(s * (q - arm)) ** 2 / 2
        damped = (PAPER.D * twist).sum() * 9 / record.frequency_hz
        assert rubbed > 0.2 * fed
        assert fed == pytest.approx(rubbed + damped, rel=1e-3)


def test_friction_converges_with_the_square_of_the_step():
    coulomb = np.array([0.3, 0.06])

    def run(step_s):
        records = simulate_records(
            PARALLELOGRAM,
            PAPER,
            [6.0, 30.0],
            excitation=Excitation(duration_s=0.5, settle_s=0.5),
            friction=MotorFriction(coulomb, step_s=step_s),
        )
        return np.array([friction_phasor(r, PARALLELOGRAM, PAPER) for r in records]) / coulomb

    fine = run(1 / 4000 / 12)
    coarse, default, half = (np.abs(run(h) - fine).max() for h in (2.5e-4, 1.25e-4, 6.25e-5))
    assert default < 2e-4
    assert half < coarse / 6


def test_default_settling_time_settles_friction():
    settings = {"friction": MotorFriction([0.3, 0.06]), "controller": Controller(sample_rate_hz=2000.0)}
    early, late = (
        simulate_records(PARALLELOGRAM, PAPER, [7.0], excitation=Excitation(settle_s=s), **settings)
        for s in (None, 6.0)
    )
    for one, other in zip(early, late, strict=True):
        np.testing.assert_allclose(
            friction_phasor(one, PARALLELOGRAM, PAPER),
            friction_phasor(other, PARALLELOGRAM, PAPER),
            atol=1e-4,
        )


def test_constant_velocity_takes_coulomb_friction_out_of_the_sine():
    records = simulate_records(
        SERIAL,
        PAPER,
        [5.0, 17.0],
        excitation=Excitation(duration_s=1.0, constant_velocity_rad_s=[15.0, -15.0], settle_s=0.5),
        friction=MotorFriction([0.4, 0.1]),
        controller=Controller(torque_delay_s=0.0004),
    )
    assert_response(records, SERIAL, PAPER)
    for record in records:
        assert np.all(np.diff(record.theta_rad, axis=0) * [1, -1] > 0)
        np.testing.assert_allclose(record.tau_Nm[:4000].mean(axis=0), [0.4, -0.1], atol=1e-3)


def test_a_joint_that_would_reverse_is_refused():
    with pytest.raises(JointIdError, match=r"joint 2 is 3 rad/s.*would reverse"):
        simulate_records(
            SERIAL, PAPER, [3.0], excitation=Excitation(constant_velocity_rad_s=[40.0, 3.0])
        )


# --- what the log shows ---------------------------------------------------------------------------


def test_encoder_counts_and_noise_are_as_specified():
    settings = {
        "excitation": Excitation(duration_s=1.0, settle_s=0.1),
        "friction": MotorFriction(0.02),
    }
    clean = simulate_records(SERIAL, PAPER, [5.0], **settings)
    seen = simulate_records(SERIAL, PAPER, [5.0], **settings, measurement=Measurement(4096))
    for record, ideal in zip(seen, clean, strict=True):
        counts = record.theta_rad * 4096 / (2 * np.pi)
        np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
        assert np.abs(record.theta_rad - ideal.theta_rad).max() > 1e-4
    noisy = simulate_records(
        SERIAL,
        PAPER,
        [5.0],
        **settings,
        measurement=Measurement(torque_noise_Nm=[0.02, 0.05]),
    )
    for record, ideal in zip(noisy, clean, strict=True):
        np.testing.assert_array_equal(record.theta_rad, ideal.theta_rad)
        std = (record.tau_Nm - ideal.tau_Nm).std(axis=0)
        np.testing.assert_allclose(std, [0.02, 0.05], rtol=0.05)


def test_position_noise_passes_through_the_controller():
    measurement = Measurement(position_noise_rad=1e-4)
    (noisy,) = simulate_records(*SINGLE, [5.0], excitation=SHORT, measurement=measurement)
    (clean,) = simulate_records(*SINGLE, [5.0], excitation=SHORT)
    assert (noisy.theta_rad - clean.theta_rad).std() == pytest.approx(1e-4, rel=0.2)
    assert (noisy.tau_Nm - clean.tau_Nm).std() > 0.05


def test_the_seed_determines_the_noise():
    measurement = Measurement(65536, 1e-5, 0.01)
    one, same, other = (
        simulate_records(SERIAL, PAPER, [5.0], excitation=SHORT, measurement=measurement, seed=s)
        for s in (7, 7, 8)
    )
    for a, b, c in zip(one, same, other, strict=True):
        np.testing.assert_array_equal(a.theta_rad, b.theta_rad)
        np.testing.assert_array_equal(a.tau_Nm, b.tau_Nm)
        assert np.any(a.tau_Nm != c.tau_Nm)
        assert np.any(a.theta_rad != c.theta_rad)
    assert np.any(one[0].tau_Nm - one[1].tau_Nm != other[0].tau_Nm - other[1].tau_Nm)


def test_records_are_labelled_and_timed():
    records = simulate_records(
        PARALLELOGRAM,
        PAPER,
        [3.0, 4.5],
        excitation=Excitation(periods=2.5),
        controller=Controller(sample_rate_hz=2000.0, torque_delay_s=0.0003),
        pose="cutting",
    )
    assert [r.label for r in records] == [
        "3.00 Hz, record 1",
        "3.00 Hz, record 2",
        "4.50 Hz, record 1",
        "4.50 Hz, record 2",
    ]
    for record in records:
        assert record.time_s[0] == 0
        assert record.interval_s == pytest.approx(1 / 2000)
        assert record.periods == pytest.approx(2.5, abs=0.01)
        assert (record.torque_hold, record.torque_delay_s, record.pose) == (True, 0.0003, "cutting")


# --- excitation -----------------------------------------------------------------------------------


def test_orthogonal_pattern_moves_all_joints_with_other_phases():
    W = Excitation().weights(3)
    np.testing.assert_allclose(np.abs(W), 1)
    np.testing.assert_allclose(W.conj().T @ W, 3 * np.eye(3), atol=1e-12)


def test_one_at_a_time_pattern_moves_one_joint():
    np.testing.assert_array_equal(
        Excitation(pattern="one-at-a-time", records_per_frequency=3).weights(2), [[1, 0], [0, 1], [1, 0]]
    )


def test_amplitude_keeps_both_limits():
    omega = 2 * np.pi * np.array([1.0, 4.0, 30.0])
    A = Excitation(velocity_rad_s=[10.0, 5.0], acceleration_rad_s2=300.0).amplitudes(omega, 2)
    assert np.all(omega[:, None] * A <= np.array([10.0, 5.0]) * (1 + 1e-12))
    assert np.all(omega[:, None] ** 2 * A <= 300.0 * (1 + 1e-12))
    np.testing.assert_allclose(A[0], [10 / omega[0], 5 / omega[0]])
    np.testing.assert_allclose(A[2], 300 / omega[2] ** 2)


# --- Figure 3 -------------------------------------------------------------------------------------


def peaks_hz(frequencies, curve):
    decibels = 20 * np.log10(np.abs(curve))
    return frequencies[find_peaks(decibels, prominence=1.0)[0]]


@pytest.mark.parametrize(
    ("elbow_deg", "pattern"),
    [(76.0, [[0.5, -1j], [0.5, 1j]]), (60.0, "one-at-a-time"), (60.0, "orthogonal")],
)
def test_one_record_shows_the_resonance_of_the_other_joints_controller(elbow_deg, pattern):
    coupling = 14.805 * np.cos(np.radians(elbow_deg)) / (100 * 90)
    inertia = Inertia([0.0025, 0.001], [[0.004104, coupling], [coupling, 0.001889]])
    frequencies = np.geomspace(3, 40, 70)
    records = simulate_records(
        inertia,
        PAPER,
        frequencies,
        excitation=Excitation(pattern=pattern, duration_s=0.5),
        controller=Controller(bandwidth_hz=12.0, feedforward=False),
    )
    alone, H11 = [], []
    for pair in (
        itertools.batched(records, 2)
        if hasattr(itertools, "batched")
        else zip(records[::2], records[1::2], strict=True)
    ):
        q, tau = phasors(pair[0])
        alone.append(-(pair[0].omega ** 2) * q[0] / tau[0])
        H11.append(measured_response(pair)[0, 0])
    low, high = peaks_hz(frequencies, np.array(alone))
    assert 8 < low < 11  # joint 2 on its controller
    assert 27 < high < 31  # joint 1 on its spring
    (only,) = peaks_hz(frequencies, np.array(H11))
    assert only == pytest.approx(high, rel=0.05)


# --- progress and stop ----------------------------------------------------------------------------


def test_progress_rises_to_one():
    seen: list[float] = []
    simulate_records(*SINGLE, [5.0], excitation=SHORT, progress=seen.append)
    assert 50 <= len(seen) <= 100
    assert np.all(np.diff(seen) > 0)
    assert seen[-1] == 1.0


def test_an_exception_from_progress_stops_the_run():
    seen: list[float] = []

    def stop(fraction):
        seen.append(fraction)
        if fraction > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_records(*SINGLE, [5.0], excitation=SHORT, progress=stop)
    assert seen[-1] < 0.35


# --- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Controller(bandwidth_hz=0.0), r"bandwidth_hz \(Hz\) is 0: it must be positive"),
        (lambda: Controller(damping_ratio=[0.5, -1]), "damping_ratio is -1"),
        (lambda: Controller(torque_delay_s=-1e-3), "torque_delay_s .* not be negative"),
        (lambda: Controller(torque_delay_s=1.0), "more than 0.1 s"),
        (lambda: Controller(sample_rate_hz=[4000.0]), "expected one number"),  # type: ignore[arg-type]
        (lambda: Controller(sample_rate_hz=np.nan), "must be finite"),
        (lambda: Controller(bandwidth_hz="fast"), "numbers, got"),  # type: ignore[arg-type]
        (lambda: Controller(bandwidth_hz=None), "bandwidth_hz"),  # type: ignore[arg-type]
        (lambda: Excitation(pattern="chirp"), '"chirp": expected "orthogonal"'),
        (lambda: Excitation(pattern=[[1, 0], [0, 0]]), "row 2 is zero"),
        (lambda: Excitation(pattern=[1, 2]), "one row per record"),
        (lambda: Excitation(pattern=[[1, 2], [3]]), "complex weights"),  # type: ignore[list-item]
        (lambda: Excitation(records_per_frequency=0), "from 1 to 1000"),
        (lambda: Excitation(duration_s=0.0), "duration_s"),
        (lambda: Excitation(settle_s=-1.0), "settle_s"),
        (lambda: MotorFriction(-0.1), r"coulomb \(N·m\) is -0.1"),
        (lambda: MotorFriction(step_s=0.0), "step_s"),
        (lambda: MotorFriction([]), "empty"),
        (lambda: Measurement(encoder_counts=0), "encoder_counts"),
        (lambda: Measurement(torque_noise_Nm=-1.0), "torque_noise_Nm"),
    ],
)
def test_bad_settings_are_refused(make, message):
    with pytest.raises(JointIdError, match=message):
        make()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"frequencies_hz": []}, "empty"),
        ({"frequencies_hz": [5.0, -3.0]}, "sine of -3 Hz"),
        ({"frequencies_hz": [2000.0]}, "below half the sample rate of 4000 Hz"),
        ({"frequencies_hz": "low"}, "numbers, got"),
        ({"elasticity": SINGLE[1]}, "2 joint.*1: they must agree"),
        ({"excitation": Excitation(pattern=[[1.0]])}, r"pattern has shape \(1, 1\)"),
        ({"excitation": Excitation(pattern=[[1, 1]], records_per_frequency=2)}, "expected 2 rows"),
        ({"excitation": Excitation(velocity_rad_s=[1, 2, 3])}, "velocity_rad_s has 3 values"),
        ({"excitation": Excitation(duration_s=0.1)}, r"less than one period of 5 Hz \(0.2 s\)"),
        ({"excitation": Excitation(periods=0.5)}, "at least one period"),
        ({"excitation": Excitation(duration_s=1e6)}, "GB"),
        ({"controller": Controller(bandwidth_hz=[1, 2, 3])}, "bandwidth_hz has 3 values"),
        ({"friction": MotorFriction([1, 2, 3])}, "coulomb has 3 values"),
        ({"measurement": Measurement(torque_noise_Nm=[1, 2, 3])}, "torque_noise_Nm has 3 values"),
        ({"seed": -1}, "seed"),
    ],
)
def test_settings_that_do_not_fit_the_robot_are_refused(settings, message):
    arguments = {"inertia": SERIAL, "elasticity": PAPER, "frequencies_hz": [5.0]} | settings
    with pytest.raises(JointIdError, match=message):
        simulate_records(**arguments)
