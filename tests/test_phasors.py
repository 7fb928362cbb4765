"""Equations (2)-(4), timing of the torque, noise covariance, and quality figures of a record."""

from __future__ import annotations

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants import BAND_HZ, PAPER, SERIAL, campaign, motion, scaled, steady_records
from random_cases import examples

from jointid import JointIdError, SineRecord, extract_phasors
from jointid.phasors.extract import Phasors, _visible, no_phasors
from jointid.phasors.passivity import least_misfit, taken_power
from jointid.phasors.periods import phasors_of, samples_of, waves, waves_at
from jointid.phasors.settling import settling_change


def sine(
    frequency: float,
    time: np.ndarray,
    *,
    stated: float | None = None,
    noise: float = 0.0,
    seed: int = 0,
    torque_hold: bool = False,
    torque_delay_s: float = 0.0,
) -> SineRecord:
    """One joint whose angle is 1 at -40 degrees and whose torque is 2 at 25 degrees."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * frequency * time
    return SineRecord(
        stated or frequency,
        time,
        np.sin(angle - np.radians(40)) + noise * rng.standard_normal(time.size),
        2 * np.sin(angle + np.radians(25)) + noise * rng.standard_normal(time.size),
        torque_hold=torque_hold,
        torque_delay_s=torque_delay_s,
    )


def test_phasor_convention() -> None:
    """f = a sin ωt + b cos ωt gives y = a + ib, and its derivative is iω y."""
    time = np.arange(2000) / 1000.0
    omega = 2 * np.pi * 4.5
    wave = 3 * np.sin(omega * time) + 5 * np.cos(omega * time)
    rate = omega * (3 * np.cos(omega * time) - 5 * np.sin(omega * time))
    phasors = extract_phasors([SineRecord(4.5, time, np.c_[wave, rate], np.c_[rate, wave])])
    assert phasors.q[0, 0] == pytest.approx(3 + 5j, rel=1e-12)
    assert phasors.q[0, 1] == pytest.approx(1j * omega * (3 + 5j), rel=1e-12)
    assert phasors.tau[0, 1] == pytest.approx(3 + 5j, rel=1e-12)


@pytest.mark.parametrize("periods", [1.0, 1.37, 5.5, 10.0, 23.81])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_exact_records_give_exact_phasors(periods: float, jitter: float) -> None:
    frequencies, torques = campaign(BAND_HZ, 2)
    records = steady_records(
        SERIAL, PAPER, frequencies, torques,
        periods=periods, jitter=jitter, offset=100.0, drift=-20.0, begin_s=11.3,
    )  # fmt: skip
    phasors = extract_phasors(records)
    q = motion(SERIAL, PAPER, frequencies, torques)
    assert np.allclose(phasors.tau, torques, rtol=0, atol=1e-8)
    assert np.allclose(phasors.q / q, 1, rtol=0, atol=1e-6)
    assert np.allclose(phasors.omega, 2 * np.pi * frequencies)


@examples(25)
@given(
    seed=st.integers(0, 2**32 - 1),
    frequency=st.floats(0.8, 3.0),
    wobble=st.floats(0.0, 0.02),
)
def test_jittered_log_is_fitted_at_its_actual_times(seed: int, frequency: float, wobble: float) -> None:
    """A 100 Hz log whose clock wanders, as operating systems make them; to a millionth of a radian."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(0.01 + np.abs(wobble * rng.standard_normal(600)) * 0.5)
    signals = rng.standard_normal((2, 600)) + 4 * np.sin(2 * np.pi * frequency * time)
    record = SineRecord(frequency, time, *signals, start_s=float(time[40]))
    used = time[40:]
    angle = 2 * np.pi * frequency * used
    columns = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(used), used])
    a, b = np.linalg.lstsq(columns, signals[:, 40:].T, rcond=None)[0][:2]
    phasors = extract_phasors([record])
    assert np.allclose([phasors.q[0, 0], phasors.tau[0, 0]], a + 1j * b, rtol=0, atol=5e-6)


@pytest.mark.parametrize(("hold", "delay"), [(True, 0.0), (False, 0.0021), (True, 0.0037)])
@pytest.mark.parametrize("frequency", [3.0, 29.0, 120.0])
def test_hold_and_delay_against_the_staircase_itself(hold: bool, delay: float, frequency: float) -> None:
    """The acting torque drawn at 400 times the sample rate, and its sine coefficient by equation (2)."""
    rate, fine = 500, 400
    time = np.arange(rate) / rate  # one second: whole periods
    record = sine(frequency, time, torque_hold=hold, torque_delay_s=delay)
    dense = (np.arange(rate * fine) + 0.5) / (rate * fine)
    past = dense - delay
    if hold:
        acting = record.tau_Nm[np.floor(past * rate).astype(int) % rate, 0]
    else:
        acting = 2 * np.sin(2 * np.pi * frequency * past + np.radians(25))
    expected = 2j * np.mean(acting * np.exp(-2j * np.pi * frequency * dense))
    phasors = extract_phasors([record], harmonics=1)
    assert phasors.tau[0, 0] == pytest.approx(expected, rel=2e-3 if hold else 1e-9)
    assert phasors.q[0, 0] == pytest.approx(np.exp(-1j * np.radians(40)), rel=1e-9)  # not touched


def test_a_gap_does_not_lengthen_the_hold_of_the_torque() -> None:
    time = np.arange(2000) / 500.0
    kept = np.delete(time, slice(700, 1100))
    whole, torn = (extract_phasors([sine(29.0, t, torque_hold=True)]) for t in (time, kept))
    assert torn.hold_s == pytest.approx(0.002, rel=1e-9)
    assert torn.tau == pytest.approx(whole.tau, rel=1e-9)
    rounded = np.round(np.arange(2000) / 800.0, 3)  # steps of 1 and 2 ms
    assert extract_phasors([sine(29.0, rounded, torque_hold=True)]).hold_s == pytest.approx(0.00125)


def test_each_harmonic_is_delayed_at_its_own_frequency() -> None:
    time = np.arange(4000) / 1000.0
    angle = 2 * np.pi * 5 * time
    wave = np.sin(angle) + 0.2 * np.sin(3 * angle)
    told = SineRecord(5.0, time, wave, wave, torque_delay_s=0.004)
    phasors = extract_phasors([told], harmonics=3)
    assert phasors.harmonics[0, 2, 0] == pytest.approx(0.2, rel=1e-9)
    assert phasors.harmonics[0, 2, 1] == pytest.approx(0.2 * np.exp(-2j * np.pi * 15 * 0.004), rel=1e-9)


def test_noise_of_a_delayed_torque_turns_with_it() -> None:
    """Variances stay, the correlation of q with τ turns by the phase of the delay."""
    time = np.arange(6000) / 1000.0
    shared = np.random.default_rng(3).standard_normal(time.size)
    plain, late = (
        extract_phasors(
            [SineRecord(5.0, time, np.sin(31 * time) + shared, shared, torque_delay_s=delay)]
        ).covariance[0]
        for delay in (0.0, 0.01)
    )
    assert np.allclose(np.diag(late), np.diag(plain))
    turn = np.exp(-2j * np.pi * 5 * 0.01)
    assert late[1, 0] == pytest.approx(plain[1, 0] * turn, rel=1e-9)
    assert late[0, 1] == pytest.approx(np.conj(late[1, 0]), rel=1e-9)


def test_hold_attenuates_the_noise_as_well() -> None:
    time = np.arange(2000) / 100.0
    held, plain = (
        extract_phasors([sine(20.0, time, noise=0.1, torque_hold=hold)], harmonics=1)
        for hold in (True, False)
    )
    ratio = held.standard_deviation[0, 1] / plain.standard_deviation[0, 1]
    assert ratio == pytest.approx(np.sinc(0.2), rel=1e-9)
    assert np.allclose(held.signal_to_noise, plain.signal_to_noise)


@pytest.mark.parametrize("periods", [5.3, 31.3])
def test_signal_to_noise_is_as_simulated(periods: float) -> None:
    """White noise of deviation σ gives a phasor a complex deviation of 2σ/√N."""
    found = []
    for seed in range(40):
        time = np.arange(int(periods * 100)) / 500.0
        found.append(extract_phasors([sine(5.0, time, noise=0.05, seed=seed)]).signal_to_noise[0])
    expected = np.array([1, 2]) / (0.05 * 2 / np.sqrt(time.size))
    assert np.allclose(np.mean(found, axis=0) / expected, 1, atol=0.15)


def test_signal_to_noise_without_noise_is_very_large() -> None:
    phasors = extract_phasors([sine(5.0, np.arange(4000) / 1000)])
    assert phasors.signal_to_noise.min() > 1e10


@pytest.mark.parametrize("periods", [6.4, 20.0, 33.3])
def test_distortion_is_as_simulated(periods: float) -> None:
    time = np.arange(int(periods * 200)) / 1000.0
    angle = 2 * np.pi * 5 * time
    theta = np.sin(angle) + 0.03 * np.cos(3 * angle) + 0.04 * np.sin(5 * angle + 1)
    record = SineRecord(5.0, time, theta, 0.5 * np.sin(angle))
    phasors = extract_phasors([record], harmonics=7)
    assert phasors.total_harmonic_distortion[0] == pytest.approx([0.05, 0.0], abs=1e-9)
    assert np.abs(phasors.harmonics[0, :, 0]) == pytest.approx([1, 0, 0.03, 0, 0.04, 0, 0], abs=1e-9)


def test_distortion_without_harmonics_is_nan() -> None:
    time = np.arange(2000) / 1000.0
    record = SineRecord(5.0, time, np.sin(2 * np.pi * 5 * time) ** 3, np.cos(2 * np.pi * 5 * time))
    assert np.isnan(extract_phasors([record], harmonics=1).total_harmonic_distortion).all()


def test_distortion_is_found_by_default() -> None:
    """The default fit looks for harmonics and goes up far enough when it sees some."""
    time = np.arange(8000) / 2000.0
    angle = 2 * np.pi * 5 * time
    rubbed = np.sin(angle) + np.sign(np.cos(angle))
    phasors = extract_phasors([SineRecord(5.0, time, np.sin(angle), rubbed)])
    assert phasors.harmonics.shape[1] >= 15
    fifth = phasors.harmonics[0, 4, 1]
    assert np.abs(fifth) == pytest.approx(4 / (5 * np.pi), rel=0.02)


@pytest.mark.parametrize("periods", [8.3, 20.37, 64.0])
def test_decaying_transient_is_found_and_noise_is_not(periods: float) -> None:
    time = np.arange(int(periods * 100)) / 500.0
    clean = sine(5.0, time)
    transient = 0.3 * np.exp(-time * 8 / time[-1])[:, None] * np.sin(2 * np.pi * 5.2 * time)[:, None]
    rng = np.random.default_rng(4)
    noise = 0.01 * rng.standard_normal((2, time.size, 1))
    shaking = SineRecord(5.0, time, clean.theta_rad + transient + noise[0], clean.tau_Nm + noise[1])
    phasors = extract_phasors([shaking])
    assert phasors.settling[0, 0] > 0.03
    assert phasors.settling[0, 0] > 5 * phasors.settling_noise[0, 0]
    assert phasors.settling[0, 1] < 0.02

    quiet = extract_phasors([sine(5.0, time, noise=0.05, seed=s) for s in range(300)])
    assert (quiet.settling > 5 * quiet.settling_noise).mean() < 0.02
    ratio = np.mean(quiet.settling**2) / np.mean(quiet.settling_noise**2)
    assert 0.8 < ratio < 1.25


def test_settling_is_unknown_with_too_few_periods() -> None:
    assert np.isnan(extract_phasors([sine(5.0, np.arange(600) / 1000.0)]).settling).all()


@pytest.mark.parametrize("periods", [3.6, 9.2, 20.3, 64.7])
@pytest.mark.parametrize("error", [1.0, 1.005, 0.995, 2.0, 0.5])
@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_frequency_of_the_data_is_found(periods: float, error: float, jitter: float) -> None:
    rng = np.random.default_rng(6)
    count = int(periods * 100)
    time = (np.arange(count) + jitter * rng.uniform(-1, 1, count)) / 500.0
    record = sine(5.0, time, stated=5.0 * error, noise=0.002)
    found = extract_phasors([record]).frequency_found_hz[0]
    # Half the resolution of the window when the stated frequency is far off, much better when near.
    near = abs(error - 1) < 0.01
    tolerance = 1.5e-3 if near else 0.3 / periods
    if near and error != 1.0:
        tolerance = 0.3 * abs(error - 1) + 5e-4
    assert found == pytest.approx(5.0, rel=tolerance)


def test_frequency_is_found_under_travel() -> None:
    """A joint with constant velocity and a sine."""
    time = np.arange(8000) / 1000.0
    swing = 10.0 * time + 0.2 * np.sin(2 * np.pi * 5 * time)
    record = SineRecord(10.0, time, swing, np.cos(2 * np.pi * 5 * time))
    assert extract_phasors([record]).frequency_found_hz[0] == pytest.approx(5.0, rel=0.01)


def test_motors_at_rest_do_not_contradict_the_frequency() -> None:
    time = np.arange(2000) / 1000.0
    locked = SineRecord(5.0, time, np.full(2000, 0.7), np.sin(2 * np.pi * 5 * time))
    assert extract_phasors([locked]).frequency_found_hz[0] == pytest.approx(5.0)


def test_phasors_of_records_in_other_units_are_in_other_units() -> None:
    """Of a coarse encoder, with distorted torques; every part scales with its signal."""
    time, rng = np.arange(3000) / 1000.0, np.random.default_rng(2)
    sines = np.array([np.sin(2 * np.pi * 7 * time + phase) for phase in (0.3, 2.0)])
    angle = np.rint((0.1 * sines + 0.2) * 2**7) / 2**7
    torque = sines[::-1] + 0.2 * np.sign(sines) + 0.3 + 1e-3 * rng.standard_normal(sines.shape)
    scale, n = np.array([4.0, 0.5, -2.0, 0.125]), 2

    def phasors(size: np.ndarray) -> Phasors:
        both = (size[:, None] * np.concatenate([angle, torque])).T
        return extract_phasors([SineRecord(7.0, time, both[:, :n], both[:, n:], torque_hold=True)])

    plain, other = phasors(np.ones(4)), phasors(scale)
    assert plain.harmonic_rounding[..., :n].all()
    expected = scaled(plain, scale)
    expected = replace(
        expected,
        harmonic_rounding=plain.harmonic_rounding * scale**2,
        drift=plain.drift * scale[:n],
        mean_angle=plain.mean_angle * scale[:n],
        mean_torque=plain.mean_torque * scale[n:],
    )
    for field in fields(Phasors):
        if field.name not in ("labels", "segments"):
            mine, true = getattr(other, field.name), getattr(expected, field.name)
            size = np.abs(np.nan_to_num(true)).max()
            np.testing.assert_allclose(mine, true, rtol=1e-6, atol=1e-9 * size, err_msg=field.name)


def test_order_labels_and_selection_are_kept() -> None:
    time = np.arange(4000) / 1000.0
    records = [sine(f, time) for f in (7.0, 3.0, 5.0)]
    records[1] = SineRecord(3.0, time, 2 * records[1].theta_rad, records[1].tau_Nm, label="two.csv")
    phasors = extract_phasors(records)
    assert phasors.labels == ("record 1", "two.csv", "record 3")
    assert np.allclose(np.abs(phasors.q[:, 0]), [1, 2, 1])
    for chosen in (phasors.select([1]), phasors.select(np.array([False, True, False]))):
        assert chosen.labels == ("two.csv",)
        assert chosen.omega == pytest.approx([6 * np.pi])
        assert chosen.covariance.shape == (1, 2, 2)


def test_phasors_of_a_record_do_not_depend_on_the_others() -> None:
    frequencies, torques = campaign(BAND_HZ, 2)
    records = steady_records(SERIAL, PAPER, frequencies, torques, noise=(1e-4, 1e-2), seed=5)
    together = extract_phasors(records, harmonics=3)
    for i in (0, 7, 13):
        alone = extract_phasors([records[i]], harmonics=3)
        assert np.array_equal(alone.z[0], together.z[i])
        assert np.array_equal(alone.covariance[0], together.covariance[i])


def test_two_hundred_records_at_once() -> None:
    frequencies, torques = campaign(np.linspace(3, 30, 100), 2)
    records = steady_records(SERIAL, PAPER, frequencies, torques, sample_rate_hz=400, periods=9.1)
    assert np.allclose(extract_phasors(records).tau, torques, atol=1e-9)


def test_wrong_records_are_refused() -> None:
    time = np.arange(2000) / 1000.0
    one = sine(5.0, time)
    two = SineRecord(5.0, time, np.zeros((2000, 2)), np.zeros((2000, 2)), label="b.csv")
    with pytest.raises(JointIdError, match="no records"):
        extract_phasors([])
    with pytest.raises(JointIdError, match=r"b.csv has 2 joint.*first record 1"):
        extract_phasors([one, two])
    for wrong in (None, 3, ["a"], [None]):
        with pytest.raises(JointIdError):
            extract_phasors(wrong)  # type: ignore[arg-type]
    for harmonics in (0, -1, 2.5, "three"):
        with pytest.raises(JointIdError, match="harmonics"):
            extract_phasors([one], harmonics=harmonics)  # type: ignore[arg-type]


def test_phasors_of_no_record_have_the_joints_and_no_rows() -> None:
    none = no_phasors(2)
    assert none.q.shape == none.tau.shape == none.drift.shape == (0, 2)
    assert none.z.shape == none.settling.shape == (0, 4)
    assert none.covariance.shape == (0, 4, 4)
    assert none.harmonics.shape == none.harmonic_rounding.shape == (0, 1, 4)
    assert none.omega.shape == none.duration_s.shape == none.degrees_of_freedom.shape == (0,)
    some = extract_phasors([sine(5.0, np.arange(2000) / 1000.0)], harmonics=3)
    both = Phasors.joined([no_phasors(1), some])
    for name, value in vars(some).items():
        np.testing.assert_array_equal(getattr(both, name), value)


def test_sines_are_excited_at_their_fundamental_and_motions_in_every_bin() -> None:
    harmonics = np.zeros((3, 2, 2), complex)
    harmonics[1] = harmonics[2, 1] = 1
    known = SimpleNamespace(
        harmonics=harmonics, motion=np.array([False, True, True]), omega=np.array([2.0, 3.0, 5.0])
    )
    assert Phasors.excited.fget(known).tolist() == [2, 3, 6, 10]  # type: ignore[attr-defined]


def test_waves_begin_with_the_fundamental() -> None:
    np.testing.assert_allclose(waves(2, 4), [[1, 1j, -1, -1j], [1, -1, 1, -1]], atol=1e-15)


@pytest.mark.parametrize(("H", "points"), [(3, 150), (60, 150), (60, 100)])
def test_samples_over_a_period_are_sums_of_waves_and_phasors_their_integrals(
    H: int, points: int
) -> None:
    """Of few harmonics, of many, and of more than the samples tell apart; equation (2) as a sum."""
    rng = np.random.default_rng(1)
    y = rng.standard_normal((2, H)) + 1j * rng.standard_normal((2, H))
    turn = np.exp(2j * np.pi * np.outer(np.arange(1, H + 1), np.arange(points)) / points)
    samples = samples_of(y, points)
    np.testing.assert_allclose(samples, (y @ turn).imag, atol=1e-11)
    found = phasors_of(samples + 3.0, H)
    np.testing.assert_allclose(found, 2j / points * (samples @ turn.conj().T), atol=1e-11)
    if points > 2 * H:
        np.testing.assert_allclose(found, y, atol=1e-11)
    np.testing.assert_allclose(waves_at(np.arange(points) / points, H), turn.conj(), atol=1e-11)


def test_a_change_is_that_of_the_first_quarter_to_the_second_half() -> None:
    """From 3 to the mean of 0 and 2; its variance is 4/3, that of these, over 2 and over 4."""
    local = np.array([3, 3, 100, -100, 0, 2, 0, 2])[:, None] * np.array([1, 1j])
    change, error = settling_change(local)
    assert change == pytest.approx([2, 2])
    assert error == pytest.approx([1, 1])
    assert np.isnan(settling_change(local[:3])).all()
    assert np.isfinite(settling_change(local[:4])).all()


@pytest.mark.parametrize(("share", "superposed"), [(0.0099, False), (0.0101, True)])
def test_a_constant_velocity_is_superposed_from_a_hundredth_of_the_sine_on(
    share: float, superposed: bool
) -> None:
    """Of the joint's largest; a joint that stands still in all records has none."""
    q = np.array([[0.1, 0.0], [0.3, 0.0]], complex)
    covariance, few = np.zeros((2, 4, 4), complex), np.ones(2)
    drift = np.array([[-share * 2 * 0.3, 0.0], [0.0, 0.0]])
    phasors = Phasors(np.array([2.0, 2.0]), q, q, covariance, few, few, drift=drift)
    assert phasors.is_superposed == superposed
    assert not replace(phasors, q=0 * q, drift=0 * drift).is_superposed


def test_series_are_the_first_records_of_every_frequency_then_the_second_ones() -> None:
    hz = np.array([5.0, 3.0, 5.0, 7.0, 5.0 * (1 + 1e-10), 3.0])
    q, none = np.ones((6, 1), complex), np.zeros((6, 2, 2), complex)
    phasors = Phasors(2 * np.pi * hz, q, q, none, np.ones(6), np.ones(6))
    assert [each.tolist() for each in phasors.series()] == [[1, 0, 3], [5, 2], [4]]
    assert [group.tolist() for _, group in phasors.by_frequency()] == [[1, 5], [0, 2, 4], [3]]


@pytest.mark.parametrize(
    ("third", "noise", "seen"),
    [(5.9e-3, 1e-3, False), (6.1e-3, 1e-3, True), (0.9e-6, 1e-9, False), (1.1e-6, 1e-9, True)],
)
def test_a_harmonic_is_seen_at_six_errors_and_a_millionth_of_its_signal(
    third: float, noise: float, seen: bool
) -> None:
    """A fundamental alone, however large, is none; signals of other sizes do not matter."""
    harmonics = np.array([[1.0, 1e5], [0.0, 0.0], [third * 1j, 0.0]])
    covariance = np.tile(np.diag([noise**2, 1e6]), (3, 1, 1)).astype(complex)
    assert _visible(SimpleNamespace(harmonics=harmonics, covariance=covariance)) == seen  # type: ignore[arg-type]


def test_power_that_motors_absorb_counts_in_squared_standard_errors() -> None:
    """A tenth of the noise leaves a hundred times the misfit; motors that supply power leave none."""
    omega = 2 * np.pi * np.array([3.0, 7.0])
    velocity = np.array([[2.0, 0.5j], [1.0, 1.0]])
    torques = np.array([[3.0, -1.0j], [0.5, 2.0]])
    z = np.hstack([velocity / (1j * omega[:, None]), -torques])
    noise = np.tile(np.eye(4, dtype=complex), (2, 1, 1))
    one, less = (least_misfit(omega, z, size**2 * noise) for size in (1.0, 0.1))
    assert less == pytest.approx(100 * one)
    assert one == pytest.approx((taken_power(omega, z, noise) ** 2).sum() / 8)
    z[:, 2:] *= -1
    assert least_misfit(omega, z, noise) == 0
