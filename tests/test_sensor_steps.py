"""Detection of quantisation steps, and error bars that include them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jointid import Elasticity, Inertia, Phasors, SineRecord, extract_phasors
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.joints import motor_response
from jointid.phasors.sensor_steps import (
    _AT_REST,
    _runs,
    _undithered,
    may_have_steps,
    quantum,
    rounded_variance,
    sharing,
    step_variance,
    unresolved_variance,
)


@given(
    step=st.floats(1e-6, 1e3),
    multiples=st.lists(st.integers(-40, 40), min_size=3, max_size=60),
    offset=st.floats(-10, 10),
)
def test_the_step_is_the_common_divisor(step: float, multiples: list[int], offset: float) -> None:
    signal = step * (np.array(multiples) + offset)
    divisor = np.gcd.reduce(np.diff(multiples))
    assert quantum(signal) == pytest.approx(step * divisor, rel=1e-6)


@pytest.mark.parametrize(("pause", "noise"), [(0, 0.0), (1500, 0.0), (1500, 1.0)])
def test_rounding_of_moves_with_rests_is_larger_at_low_frequencies(pause: int, noise: float) -> None:
    """In a rest the error stays the same; noise of a step dithers it."""
    rng, N, H, step = np.random.default_rng(3), 2500, 100, 1e-4
    moves = [rng.uniform(-1, 1) * (1 - np.cos(np.linspace(0, np.pi, 300))) for _ in range(80)]
    parts = [np.concatenate([move, np.full(rng.integers(pause + 1), move[-1])]) for move in moves]
    ends = np.cumsum([0.0, *(part[-1] for part in parts)])[:-1]
    angle = np.concatenate([part + end for part, end in zip(parts, ends, strict=True)])
    angle += noise * step * rng.standard_normal(angle.size)
    logged = step * np.round(angle / step)
    found, stated = np.zeros((2, H))
    for begin in range(0, angle.size - N, N):
        part = slice(begin, begin + N)
        error = np.fft.rfft(logged[part] - angle[part])[1 : H + 1]
        found += np.abs(error) ** 2 / N / (step**2 / 12)
        variance = step**2 * (1 / 12 + noise**2)
        own = rounded_variance(logged[part], step, variance, H) / (step**2 / 12) - 12 * noise**2
        stated += 1 + (own - 1) / _AT_REST  # here, the errors of rests are even
    ratio = [f.sum() / s.sum() for f, s in zip(np.split(found, 4), np.split(stated, 4), strict=True)]
    assert max(ratio) < 1.35
    assert min(ratio) > (0.3 if pause else 0.9)  # a move begins where the rest ended, without a jump
    assert (found[:5].sum() > 5 * found[-5:].sum()) == (pause > 0 and noise == 0)


def test_signals_without_steps_give_zero() -> None:
    rng = np.random.default_rng(0)
    assert quantum(rng.standard_normal(1000)) == 0
    assert quantum(np.sin(0.1 * np.arange(1000))) == 0
    assert quantum(np.zeros(100)) == 0
    assert quantum(np.ones(1)) == 0
    assert quantum(np.array([3.0, 3.5])) == 0.5


@pytest.mark.parametrize("dither", [0.0, 0.1, 0.5])
@pytest.mark.parametrize(("hertz", "rate", "periods"), [(10.0, 1000.0, 30), (3.1, 4000.0, 12)])
def test_the_error_of_a_coarse_encoder_is_included(
    hertz: float, rate: float, periods: int, dither: float
) -> None:
    """Thirteen steps of amplitude; most of the error comes back with every period."""
    rng = np.random.default_rng(1)
    time = np.arange(round(periods * rate / hertz)) / rate
    off, claimed = [], []
    for _ in range(40):
        y = 13 * rng.uniform(0.5, 1.5) * np.exp(1j * rng.uniform(0, 2 * np.pi))
        wave = (y * np.exp(2j * np.pi * hertz * time)).imag + rng.uniform(-1, 1)
        log = np.rint(wave + dither * rng.standard_normal(time.size))
        phasors = extract_phasors([SineRecord(hertz, time, log, wave)])
        off.append(abs(phasors.q[0, 0] - y) ** 2)
        claimed.append(phasors.covariance[0, 0, 0].real)
    assert 0.2 < np.sqrt(np.mean(off) / np.mean(claimed)) < 2.2


@pytest.mark.parametrize(("centre", "first"), [(0.0, 0), (0.25, 1)])
def test_turning_points_repeat_the_rounding_of_a_fast_sine(centre: float, first: int) -> None:
    """On odd harmonics where the sine is centred on a step, on even ones a quarter of a step beside."""
    rng = np.random.default_rng(4)
    time = np.arange(int(8.3 * 61.56)) / 61.56
    off, claimed, scatter = np.zeros(4), np.zeros(4), np.zeros(4)
    for _ in range(60):
        wave = 34 * rng.uniform(0.95, 1.05) * np.sin(2 * np.pi * (time + rng.random()))[:, None] + centre
        rounded, exact = (
            extract_phasors([SineRecord(1.0, time, signal, wave)], harmonics=31)
            for signal in (np.rint(wave), wave)
        )
        off += np.abs(rounded.harmonics - exact.harmonics)[0, :4, 0] ** 2
        claimed += rounded.harmonic_covariance[0, :4, 0, 0].real
        scatter += (rounded.harmonic_covariance[0, :4, 0, 0].real) - rounded.harmonic_rounding[0, :4, 0]
    assert np.all((off > 0.5 * claimed)[first::2] & (off < claimed)[first::2])
    assert np.all((off > 1.1 * scatter)[first::2])
    assert np.all(claimed[1 - first :: 2] == pytest.approx(scatter[1 - first :: 2], rel=0.05))


def test_a_record_keeps_the_rounding_that_repeats_in_it() -> None:
    """One of twelve frequencies divides the sample rate; the noise common to all is not its own."""
    rng = np.random.default_rng(3)
    inertia, elasticity = Inertia([0.01], [[0.05]]), Elasticity([400.0], [0.4])
    records = []
    for hertz in (*np.geomspace(2.1, 19.3, 11), 10.0):
        time = np.arange(int(5.3 * 1000 / hertz)) / 1000
        phase = 2 * np.pi * hertz * time + rng.random()
        response = motor_response([2 * np.pi * hertz], inertia, elasticity)[0, 0, 0]
        angle = np.rint(40 * np.sin(phase)) / 100
        tau = 0.4 * (-((2 * np.pi * hertz) ** 2) / response * np.exp(1j * phase)).imag
        records.append(SineRecord(hertz, time, angle, tau))
    phasors = extract_phasors(records)
    repeated = phasors.harmonic_rounding[-1, 0, 0]
    assert repeated == pytest.approx(1e-4 / 3 / 100, rel=0.3)
    equations = spring_equations(phasors, inertia)
    assert equations.noise.covariance[-1, 0, 0, 0].real > repeated


def test_rounding_that_records_share_does_not_average() -> None:
    """Sines of one amplitude and mean are rounded alike at every frequency; of others they are not."""
    time = np.arange(4000) / 1000
    claimed = []
    for spread in (0.0, 2.0):
        waves = [
            (9.3 + spread * k) * np.sin(2 * np.pi * f * time + k) for k, f in enumerate((3.3, 4.7, 7.1))
        ]
        records = [
            SineRecord(f, time, np.rint(wave[:, None] + 0.2), wave[:, None])
            for f, wave in zip((3.3, 4.7, 7.1), waves, strict=True)
        ]
        phasors = extract_phasors(records)
        repeated = phasors.harmonic_rounding[:, 0, 0]
        claimed.append(phasors.harmonic_covariance[:, 0, 0, 0].real / repeated)
    assert np.all(claimed[0] > 2.5)
    assert np.all(claimed[1][1:] < 2.5)


@pytest.mark.parametrize("rest", [0.0, 0.3])
@pytest.mark.parametrize("amplitude", [1.5, 10.0, 300.0])
@pytest.mark.parametrize("samples", [401.37, 67.0])
def test_rounding_of_slow_and_sticking_motion_is_in_the_error(
    samples: float, amplitude: float, rest: float
) -> None:
    """The joint rests at both ends for a share of the period; the error repeats in all ten periods."""
    rng = np.random.default_rng(1)
    time = np.arange(int(10.5 * samples)) / (5.0 * samples)
    off, claimed = [], []
    for _ in range(40):
        phase = 2 * np.pi * (5.0 * time + rng.random())
        motion = np.clip(np.sin(phase) / (1 - rest), -1, 1)[:, None]
        motion = amplitude * rng.uniform(0.9, 1.1) * motion + rng.uniform(-0.5, 0.5)
        rounded, exact = (
            extract_phasors([SineRecord(5.0, time, signal, np.cos(phase)[:, None])], harmonics=31)
            for signal in (np.round(motion), motion)
        )
        off.append(np.abs(rounded.harmonics - exact.harmonics)[0, :, 0] ** 2)
        claimed.append(np.abs(rounded.harmonic_covariance[0, :, 0, 0]))
    of_first = np.sqrt(np.mean(off, axis=0)[0] / np.mean(claimed, axis=0)[0])
    assert 0.3 < of_first < 1.7
    assert 0.4 < np.sqrt(np.mean(off) / np.mean(claimed)) < 1.6


def rounded_sine(
    samples: float, amplitude: float, *, rest: float = 0.0, drift: float = 0.0, offset: float = 0.0
) -> Phasors:
    """Ten periods of a sine that rests at both ends for a share of its period, in steps of one."""
    turn = np.arange(int(10.5 * samples)) / samples
    wave = np.sin(2 * np.pi * (turn + 0.123))
    motion = 0.1 + amplitude * np.clip(wave / (1 - rest), -1, 1) + drift * turn / turn[-1]
    return extract_phasors([SineRecord(1.0, turn, np.rint(motion) + offset, wave)], harmonics=9)


@pytest.mark.parametrize("rest", [0.0, 0.3])
def test_rounding_of_a_slow_motion_is_that_of_the_position_whenever_it_is_sampled(rest: float) -> None:
    whole, uneven = (rounded_sine(samples, 10.0, rest=rest) for samples in (401.0, 401.37))
    claimed = [np.abs(each.harmonic_covariance[0, :, 0, 0]) for each in (whole, uneven)]
    np.testing.assert_allclose(claimed[1], claimed[0], rtol=0.2)
    repeated = [each.harmonic_rounding[0, :, 0] for each in (whole, uneven)]
    np.testing.assert_allclose(repeated[1], repeated[0], rtol=0.2)


@pytest.mark.parametrize("rest", [0.0, 0.02])
def test_rounding_does_not_depend_on_the_place_of_the_zero(rest: float) -> None:
    here, there = (rounded_sine(61.37, 34.0, rest=rest, offset=offset) for offset in (0.0, -7.37))
    np.testing.assert_allclose(there.harmonic_rounding, here.harmonic_rounding, rtol=1e-6, atol=1e-9)
    assert here.harmonic_rounding[0, 0, 0] > 0


def test_a_drift_of_more_than_a_step_leaves_no_rounding_that_repeats_at_turning_points() -> None:
    steady, slow, fast = (rounded_sine(61.56, 34.0, drift=drift) for drift in (0.0, 0.8, 1.2))
    repeated = [each.harmonic_rounding[0, :, 0].sum() for each in (steady, slow, fast)]
    assert repeated[1] == pytest.approx(repeated[0], rel=0.5)
    assert repeated[2] < 0.2 * repeated[0]


@pytest.mark.parametrize("dwell", [0.0, 0.015, 0.04])
def test_the_amplitude_of_a_motor_that_sticks_for_a_moment_has_its_error(dwell: float) -> None:
    """After each reversal the motor rests for a share of the period; both ends have the same error."""
    rng = np.random.default_rng(7)
    turn = np.arange(int(10.5 * 248)) / 248.3
    off, claimed = np.zeros(2), 0.0
    for _ in range(100):
        moving = np.maximum(turn % 0.5 - dwell, 0) / (0.5 - dwell)
        wave = rng.uniform(200, 220) * np.cos(np.pi * moving) * (-1) ** (turn // 0.5)
        rounded, exact = (
            extract_phasors([SineRecord(1.0, turn, signal, wave)], harmonics=9)
            for signal in (np.rint(wave), wave)
        )
        error = (rounded.q - exact.q)[0, 0] / np.exp(
            1j * np.angle(exact.q[0, 0] * np.exp(1j * np.pi * dwell))
        )
        off += np.array([error.real, error.imag]) ** 2
        claimed += rounded.covariance[0, 0, 0].real / 2
    assert 0.3 < np.sqrt(off.max() / claimed) < 1.25


@pytest.mark.parametrize("rate", [1000.0, 617.3])
def test_a_motion_below_one_step_has_the_error_of_a_step(rate: float) -> None:
    """The logged angle is constant, but other records show the encoder's step."""
    rng = np.random.default_rng(2)
    time = np.arange(3000) / rate
    off, claimed = [], []
    for _ in range(60):
        size, at = rng.uniform(0.05, 0.45), rng.uniform(0, 2 * np.pi)
        hidden = size * np.sin(2 * np.pi * 7.0 * time + at)
        large = 5 * np.sin(2 * np.pi * 7.0 * time + 1.0)
        wave = np.cos(2 * np.pi * 7.0 * time)
        records = [SineRecord(7.0, time, np.rint(motion), wave) for motion in (hidden, large)]
        phasors = extract_phasors(records)
        assert phasors.q[0, 0] == 0
        off.append(size**2)
        claimed.append(phasors.covariance[0, 0, 0].real)
    assert 0.5 < np.sqrt(np.mean(off) / np.mean(claimed)) < 1.5
    exact = extract_phasors([SineRecord(7.0, time, 0 * wave, wave), SineRecord(7.0, time, large, wave)])
    assert exact.covariance[0, 0, 0].real == 0  # a blocked motor under an exact sensor


@pytest.mark.parametrize(
    ("least", "largest", "dither"), [(0.33, 0.55, 0.0), (0.19, 0.62, 0.0), (0.9, 1.0, 0.3)]
)
def test_motions_of_about_a_step_have_the_error_that_rounding_leaves(
    least: float, largest: float, dither: float
) -> None:
    """Two levels hide the amplitude of a sine; noise of 0.3 steps leaves a part of the error of all."""
    rng = np.random.default_rng(5)
    time = np.arange(4000) * 1e-3
    off, claimed = [], []
    for _ in range(150):
        size, hertz = rng.uniform(least, largest), rng.choice([4.0, 6.5, 9.0])
        wave = size * np.sin(2 * np.pi * hertz * time) + rng.uniform(-0.5, 0.5)
        log = np.rint(wave + dither * rng.standard_normal(time.size))
        if np.ptp(log) > 0 and (dither or np.ptp(log) < 2):
            phasors = extract_phasors([SineRecord(hertz, time, log, wave)])
            off.append(abs(phasors.q[0, 0] - size) ** 2)
            claimed.append(phasors.covariance[0, 0, 0].real)
    squares = np.array(off) / claimed
    assert 0.4 < np.sqrt(np.mean(squares)) < 1.15
    assert np.sqrt(squares.max()) < 4


@pytest.mark.parametrize("noise", [0.003, 0.02, 0.08])
def test_dither_leaves_the_share_of_rounding_that_repeats(noise: float) -> None:
    """By Widrow: of noise of the variance σ², in steps squared, the share u = exp(-4π²σ²)."""
    share = np.exp(-4 * np.pi**2 * noise)
    assert _undithered(noise + (1 - share) / 12) == pytest.approx(share, rel=1e-4)
    assert _undithered(0.0) == pytest.approx(1.0)


def test_rounding_counts_once_for_each_step_that_a_signal_crosses() -> None:
    """A staircase of steps of three samples: its ramps cancel, its two ends are as if at rest."""
    length, share = _runs(np.repeat(np.arange(10.0), 3), 1e9, 2)
    assert length == 3
    np.testing.assert_allclose(share, (8 * 1 + 2 * 9) / 30, rtol=1e-9)
    length, share = _runs(np.zeros(30), 1e9, 2)  # at rest: one error for all samples
    assert length == 30
    np.testing.assert_allclose(share, 30, rtol=1e-9)
    length, share = _runs(np.repeat(np.arange(15.0), 2), 1e9, 1)  # too short for a ramp of its own
    assert (length, share[0]) == (2, pytest.approx(2.0))


@pytest.mark.parametrize(("turn", "counts"), [(14, 1 / 3), (15, 1)])
def test_a_turn_within_a_step_counts_a_third(turn: int, counts: float) -> None:
    """A parabola stays in the step where it turns up to 4.83 times as long as in its neighbours."""
    up = np.repeat(np.arange(6.0), 3)
    signal = np.concatenate([up, np.full(turn, 6.0), up[::-1]])
    _, share = _runs(signal, 1e9, 1)
    assert share[0] == pytest.approx((10 * 1 + 2 * 9 + counts * turn**2) / signal.size, rel=1e-9)


def test_errors_of_a_rest_average_at_harmonics_of_which_it_holds_periods() -> None:
    """Rests of a fifth of a period; the inner eight of ten are turns, which count a third."""
    square = np.repeat([0.0, 1.0] * 5, 10)
    _, share = _runs(square, 50.0, 5)
    counted = (2 + 8 / 3) / 10 * 10
    np.testing.assert_allclose(share, counted * np.sinc(np.arange(1, 6) / 5) ** 2, atol=1e-12)


@pytest.mark.parametrize(
    ("size", "mean", "alike"),
    [(3.14, 0.0, True), (3.16, 0.0, False), (3.0, 2.14, True), (3.0, 1.86, True), (3.0, 0.16, False)],
)
def test_sines_of_one_size_and_place_on_the_steps_are_rounded_alike(
    size: float, mean: float, alike: bool
) -> None:
    time = np.arange(400) / 100
    wave = np.rint(20 * np.sin(2 * np.pi * time)) * 0.1
    records = [SineRecord(1.0, time, wave, np.sin(time))] * 3
    fits: Any = [
        SimpleNamespace(harmonics=0.1 * np.array([[s, s]]), offset=0.1 * np.array([m, m]))
        for s, m in ((3.0, 0.0), (size, mean), (0.49, 0.0))
    ]
    found = sharing(records, fits)
    assert found[:, 0].tolist() == ([2, 2, 1] if alike else [1, 1, 1])
    assert found[:, 1].tolist() == [1, 1, 1]  # no steps


def test_an_angle_at_rest_is_unknown_within_a_disc_of_half_a_step() -> None:
    time = np.arange(400) / 100
    steps = [np.rint(20 * np.sin(2 * np.pi * time)) * step for step in (0.1, 0.0, 0.2)]
    smooth = np.sin(2 * np.pi * time)
    records = [
        SineRecord(1.0, time, np.c_[own, smooth, 0 * own], np.ones((400, 3)) * time[:, None])
        for own in steps
    ]
    assert [may_have_steps(record) for record in records] == [True] * 3
    assert not may_have_steps(SineRecord(1.0, time, smooth + time, time))
    variance = unresolved_variance(records)  # a joint that rests in all records shows no step
    np.testing.assert_allclose(variance, [[0, 0, 0], [0.1**2 / 8, 0, 0], [0, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_joint_that_begins_at_rest_shows_the_step_later(sign: float) -> None:
    """A sine that reaches the next step in two short peaks; its phasor may be off by some of it."""
    time = np.arange(4000) * 5e-4
    log = np.zeros(4000)
    log[[700, 2100]] = sign
    phasors = extract_phasors([SineRecord(5.0, time, log, np.sin(2 * np.pi * 5 * time))])
    assert phasors.covariance[0, 0, 0].real > 0.05


def known_fit(record: SineRecord, size: float, step: float, noise: float = 0.0) -> Any:
    """The first three harmonics of a sine of some steps, with noise of a variance in steps squared."""
    covariance = noise * 4 / record.samples * step**2 * np.eye(2) * np.ones((3, 1, 1))
    harmonics = np.array([[size * step, 1.0], [0, 0], [0, 0]], complex)
    return SimpleNamespace(
        harmonics=harmonics, covariance=covariance, offset=np.zeros(2), drift=np.zeros(2)
    )


@pytest.mark.parametrize("step", [0.125, 8.0])
@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("size", [1.0, 1.8, 7.0])
def test_turning_points_leave_the_mean_square_of_the_bessel_functions(
    size: float, noise: float, step: float
) -> None:
    """2 ζ(3)/π⁴ over the amplitude on odd harmonics; noise σ in steps dithers it by exp(−4π²σ²)."""
    time = np.arange(20_000) / 6.156789
    log = step * np.rint(size * np.sin(2 * np.pi * time))
    record = SineRecord(1.0, time, log, np.cos(2 * np.pi * time))
    fit = known_fit(record, size, step, noise + 1 / 12 if noise else 0.0)
    found = step_variance(record, fit).sum(axis=0)
    zeta = np.sum(1 / np.arange(1.0, 2000) ** 3)
    expected = 2 * zeta / np.pi**4 / size * np.exp(-4 * np.pi**2 * noise)
    assert found[::2, 0] / step**2 == pytest.approx([expected, expected], rel=1e-3)
    assert found[1, 0] < 0.4 * found[0, 0]  # only what averages over many samples
    assert not found[:, 1].any()


@pytest.mark.parametrize(("size", "unknown"), [(0.49, True), (0.51, False)])
@pytest.mark.parametrize("step", [0.125, 8.0])
def test_a_signal_of_two_levels_has_an_unknown_amplitude(
    size: float, unknown: bool, step: float
) -> None:
    """Variance 1/16 of a squared step, besides that of rounding; with three levels it does not."""
    time = np.arange(4000) / 61.56789
    wave = np.sin(2 * np.pi * time)
    for levels in (2, 3):
        log = step * np.where(wave > 0.9, 1.0, np.where(wave < -0.9, 2 - levels, 0.0))
        record = SineRecord(1.0, time, log + 0.0, wave)
        fit = known_fit(record, size, step, 1.0)  # of so much noise that rounding adds nothing
        found = step_variance(record, fit)[:, :, 0] / step**2
        if levels == 2 and unknown:
            assert found[1, 0] == pytest.approx(1 / 16)
        else:
            assert found[1, 0] < 1 / 50


def test_a_ramp_counts_by_its_integral_with_the_wave() -> None:
    """A signal that crosses six steps of 40 samples, against waves of 100 samples and shorter."""
    _, share = _runs(np.repeat(np.arange(8.0), 40), 100.0, 5)
    x = (
        np.arange(4000) + 0.5
    ) / 4000 - 0.5  # error of a ramp, in steps; that of a rest is its mean square
    waves = np.exp(2j * np.pi * np.outer(np.arange(1, 6), x) * 40 / 100)
    ramp, rest = (np.abs(np.mean(waves * error, axis=1)) ** 2 * 12 for error in (x, 12**-0.5))
    np.testing.assert_allclose(share, (6 * (1 + 40**2 * ramp) + 2 * 40**2 * rest) / 320, rtol=1e-5)


def test_rests_of_a_motion_add_their_spectrum_to_white_rounding() -> None:
    """Rests of 400 and 51 samples in 1000; one of 49 is shorter than half a period of harmonic 10."""
    signal = np.concatenate([np.zeros(400), np.arange(1, 499), np.full(51, 499.0), np.arange(500, 502)])
    signal = np.append(signal, np.full(49, 502.0))
    h, step = np.arange(1, 11), 0.25
    gain = 1.5 / 1000 * sum((n * np.sinc(h * n / 1000)) ** 2 for n in (400, 51))
    white = step**2 / 12
    np.testing.assert_allclose(rounded_variance(step * signal, step, white, 10), white * (1 + gain))
    dithered = rounded_variance(step * signal, step, white + 0.02 * step**2, 10)
    expected = 0.02 * step**2 + white * (1 + gain * np.exp(-4 * np.pi**2 * 0.02))
    np.testing.assert_allclose(dithered, expected)
    # A variance below that of rounding, or no steps: nothing to add.
    np.testing.assert_array_equal(rounded_variance(signal, 1.0, 0.05, 3), 0.05)
    np.testing.assert_array_equal(rounded_variance(signal, 0.0, 0.05, 3), 0.05)
