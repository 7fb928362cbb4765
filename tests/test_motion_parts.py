"""Parts of the analysis of motions on their own: sampling, spectra, waveforms and end terms."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import exact_phasors
from scipy.interpolate import CubicSpline

from jointid import Inertia, JointIdError, MotionRecord
from jointid.arrays import Floats
from jointid.estimation import motion_noise
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.identify_motion import _few, _lines
from jointid.estimation.motion_noise import noise_differs, times_logged_noise, with_torque_noise
from jointid.gears.motor_motion import MotorMotion
from jointid.motion.arm_motion import DrivenArms, _directions
from jointid.motion.band import proposed_band
from jointid.motion.complement import Complement, Waveforms
from jointid.motion.end_terms import EndTerms, motor_motion, row_groups
from jointid.motion.free_friction import FreeFriction
from jointid.motion.friction import (
    _WIDTHS,
    GRID,
    _freed,
    _hats,
    _slow,
    friction_waveforms,
    gear_torque_of,
    seen_angles,
    with_load,
)
from jointid.motion.noise import _non_negative, logged_noise, repeated_variances, sensor_variances
from jointid.motion.reversals import (
    _polynomials,
    _stretches,
    _transforms,
    _unknown,
    segment_friction,
)
from jointid.motion.sampling import UniformPart, uniform_parts, windowed_spectrum
from jointid.motion.spectra import motion_phasors
from jointid.motion.spectral_lines import SpectralLines, _continued, _gain, _rounding
from jointid.motion.velocity import smooth_velocity
from jointid.phasors.periods import phasors_of, samples_of
from jointid.phasors.segment import Motors, Segment
from jointid.small_matrices import whitener

T = 0.01


def part_of(theta: np.ndarray, tau: np.ndarray, held: bool = False) -> UniformPart:
    return UniformPart(0, T, theta, tau, held)


def logged(time: np.ndarray, *, held: bool = False) -> MotionRecord:
    """A joint whose angle and torque are sines of 1 Hz."""
    angle = np.sin(2 * np.pi * time)
    return MotionRecord(time, angle, np.cos(2 * np.pi * time), torque_hold=held, band_hz=(0.5, 5.0))


# --- sampling


def test_the_spectrum_of_white_noise_is_its_variance() -> None:
    f, spectrum = windowed_spectrum(0.3 * np.random.default_rng(1).standard_normal((2, 4000)), T)
    assert np.mean(np.abs(spectrum) ** 2, axis=1) == pytest.approx(0.09, rel=0.1)
    np.testing.assert_allclose(f, np.arange(2001) / 40)


def test_the_rotor_sees_accelerations_and_the_torque_over_both_steps() -> None:
    """A torque that is held from sample to sample acts, on average, half a step late."""
    k = np.arange(100.0)
    for held in (False, True):
        part = part_of(1.5 * (k * T)[None] ** 2, k[None], held)  # 3 rad/s²; torque: sample number
        _, torque, bend = part.rotor_spectra
        for found, known in ((torque, k[1:-1] - 0.5 * held), (bend, np.full(98, 3.0))):
            np.testing.assert_allclose(found, windowed_spectrum(known[None], T)[1], atol=1e-8)


def test_the_power_of_each_signal_is_without_its_trend() -> None:
    k = np.arange(200)
    wave = np.sin(2 * np.pi * 10 * k / 200)
    theta = np.stack([k * T, 5 + 7 * k * T])  # constant velocities
    _, power = part_of(theta, np.stack([wave, 3 * wave + 40 + 0.1 * k])).power
    assert power[0].max() < 1e-20
    alone = np.abs(windowed_spectrum(wave, T)[1][10]) ** 2
    assert power[1, :, 10] == pytest.approx([alone, 9 * alone], rel=0.02)
    assert power[1, :, 30:].max() < 1e-3 * alone


def test_a_gap_of_two_steps_divides_a_motion() -> None:
    time = np.arange(300) * T
    whole = uniform_parts(logged(time), 3, "run")
    assert [(each.record, each.theta.shape) for each in whole] == [(3, (1, 300))]
    torn = uniform_parts(logged(np.delete(time, [100])), 0, "run")
    np.testing.assert_array_equal(torn[0].theta[0], np.sin(2 * np.pi * time[:100]))
    np.testing.assert_array_equal(torn[1].tau[0], np.cos(2 * np.pi * time[101:]))


@pytest.mark.parametrize("samples", [63, 64])
def test_a_part_has_64_samples(samples: int) -> None:
    short = np.delete(np.arange(300) * T, slice(samples, samples + 50))
    assert len(uniform_parts(logged(short), 0, "run")) == 1 + (samples == 64)
    if samples < 64:
        with pytest.raises(JointIdError, match=r"run: no segment .* has 64 samples .median step 10 ms"):
            uniform_parts(logged(short[:samples]), 0, "run")


@pytest.mark.parametrize(("late", "told"), [(0.44, False), (0.46, True)])
def test_a_clock_is_uneven_from_nearly_half_a_step_on(late: float, told: bool) -> None:
    time = np.arange(300) * T
    time[200:] += late * T
    if told:
        with pytest.raises(JointIdError, match=r"run: the clock .* at 1.99 s is 14.6 ms, the median"):
            uniform_parts(logged(time), 0, "run")
    else:
        assert len(uniform_parts(logged(time), 0, "run")) == 1


@pytest.mark.parametrize("held", [False, True])
def test_jitter_is_resampled_and_a_held_torque_keeps_its_impulse(held: bool) -> None:
    rng = np.random.default_rng(2)
    time = np.arange(500) * T
    time[1:-1] += 0.2 * T * rng.uniform(-1, 1, 498)
    (part,) = uniform_parts(logged(time, held=held), 0, "run")
    grid = np.arange(500) * T
    np.testing.assert_allclose(part.theta[0], np.sin(2 * np.pi * grid), atol=1e-5)
    torque, lasts = np.cos(2 * np.pi * time), np.diff(time)
    if held:
        impulse = np.append(0, np.cumsum(torque[:-1] * lasts))
        np.testing.assert_allclose(
            np.cumsum(part.tau[0, :-1]) * T, np.interp(grid[1:], time, impulse), atol=1e-12
        )
        assert part.tau[0, -1] == pytest.approx(torque[-1], rel=0.01)
    else:
        np.testing.assert_allclose(part.tau[0], np.cos(2 * np.pi * grid), atol=1e-5)


def test_the_band_is_that_of_motion_and_torque_above_the_noise() -> None:
    """Both from 2 to 6 Hz; up to 9 Hz the torque alone."""
    rng = np.random.default_rng(3)
    time, noise = np.arange(4000) * T, 1e-6
    theta, tau = noise * rng.standard_normal((2, 1, 4000))
    for f in np.arange(0.5, 9.0, 0.05):
        phase = 2 * np.pi * f * time + rng.uniform(0, 6)
        tau[0] += np.sin(phase)
        theta[0] += np.sin(phase) / f if 2 <= f <= 6 else 0
    low, high = proposed_band([part_of(theta, tau)], np.full(2, noise**2))
    assert low == pytest.approx(2, rel=0.3)
    assert high == pytest.approx(6, rel=0.12)
    silent = part_of(np.zeros((1, 4000)), tau)
    assert proposed_band([silent], np.full(2, noise**2)) == pytest.approx((5 / 40, 16))


@pytest.mark.parametrize(
    ("torque", "share", "seen"),
    [(False, 27, False), (False, 33, True), (True, 29.6, False), (True, 30.4, True)],
)
def test_a_line_is_in_the_band_at_thirty_times_the_noise_over_half_a_hertz(
    torque: bool, share: float, seen: bool
) -> None:
    """Of 40 s, half a hertz has 20 lines; the line of amplitude a has the power a² N / 4 of all."""
    time, noise, amplitude = np.arange(4000) * T, 1e-4, np.sqrt(share * 20 / 1000)
    line = noise * amplitude * np.sin(2 * np.pi * 12 * time)
    faint = line + 1e-3 * sum(np.sin(2 * np.pi * f * time + f**2) for f in np.arange(2, 4, 0.05))
    theta, tau = (300 * faint, faint) if torque else (faint, 300 * faint)
    variance = np.array([noise, noise]) ** 2
    low, high = proposed_band([part_of(theta[None], tau[None])], variance)
    assert low == pytest.approx(2, rel=0.15)
    assert high == pytest.approx(12 if seen else 4, rel=0.1)


def test_an_empty_band_is_named_with_its_ends() -> None:
    record = replace(logged(np.arange(300) * T), band_hz=(1.5, 2.5))
    with pytest.raises(
        JointIdError, match=r"record 1: the band of 1.5 to 2.5 Hz of the study holds too"
    ):
        motion_phasors([record], np.ones((1, 1)))


@pytest.mark.parametrize(
    ("band", "count", "lowest", "highest"),
    [
        ((0.05, 20.0), 1, 1, 400),  # 4 cycles, as far as the record has them
        ((0.45, 20.0), 2, 5, 200),
        ((3.0, 20.0), 8, 8, 50),  # 2.5 s
        ((3.0, 8.0), 4, 15, 40),  # 40 periods
    ],
)
def test_segments_have_enough_periods_of_their_band(
    band: tuple[float, float], count: int, lowest: int, highest: int
) -> None:
    """A stated band is used to its lowest line."""
    time, rng = np.arange(2000) * T, np.random.default_rng(6)
    theta = np.cumsum(np.cumsum(rng.standard_normal(2000))) * T**2
    record = MotionRecord(time, theta, rng.standard_normal(2000), torque_hold=False, band_hz=band)
    segments = [each for each in motion_phasors([record], np.ones((1, 1))).segments if each is not None]
    assert [each.samples for each in segments] == [2000 // count] * count
    assert {(each.lowest, each.highest) for each in segments} == {(lowest, highest)}
    assert [each.begin for each in segments] == list(range(0, 2000, 2000 // count))


def test_a_chosen_band_may_be_widened_and_limited() -> None:
    """By a factor, if the samples allow it, and to no less than an octave."""
    time, rng = np.arange(4000) * T, np.random.default_rng(7)
    phases = [2 * np.pi * f * time + rng.uniform(0, 6) for f in np.arange(2.0, 6.0, 0.05)]
    theta = np.sum([np.sin(phase) for phase in phases], axis=0) + 1e-6 * rng.standard_normal(4000)
    record = MotionRecord(time, theta, np.gradient(np.gradient(theta, T), T), torque_hold=False)

    def found(**changed: float) -> tuple[float, float, float]:
        (segment, *_) = (s for s in motion_phasors([record], np.ones((1, 1)), **changed).segments if s)
        return (
            segment.lowest / segment.duration_s,
            segment.highest / segment.duration_s,
            segment.duration_s,
        )

    low, high, length = found()
    assert (low, high) == pytest.approx((2, 6), rel=0.15)
    assert length == pytest.approx(40 / high, rel=0.1)  # 40 periods
    assert found(widened=1.5)[1] == pytest.approx(1.5 * high, rel=0.05)
    assert found(widened=4.0)[1] == pytest.approx(high)  # beyond the samples
    assert found(most_hz=5.0)[1] == pytest.approx(5, rel=0.05)
    assert found(most_hz=3.0)[1] == pytest.approx(2 * low, rel=0.1)


@pytest.mark.parametrize("held", [False, True])
def test_bins_of_a_motion_of_whole_periods_are_its_phasors(held: bool) -> None:
    """Of 2.5 s, with the torque delayed at each line, and held: by the mean of its wave over a step."""
    rng, N, H = np.random.default_rng(8), 250, 50
    y = complex_noise(rng, H, 4)
    time = np.arange(N) * T
    wave = np.imag(np.exp(2j * np.pi * np.outer(time, np.arange(1, H + 1)) / 2.5) @ y)
    record = MotionRecord(
        time, wave[:, :2], wave[:, 2:], torque_hold=held, torque_delay_s=0.003, band_hz=(1.9, 20.1)
    )
    phasors = motion_phasors([record], np.ones((1, 2)))
    (segment,) = phasors.segments
    assert segment is not None
    assert (segment.lowest, segment.highest, segment.samples) == (5, 50, N)
    s = 2j * np.pi * np.arange(1, H + 1)[:, None] / 2.5
    late = np.exp(-0.003 * s)
    if held:
        late = late * np.mean(np.exp(-s * T * (np.arange(2000) + 0.5) / 2000), axis=1)[:, None]
    expected = y * np.hstack([np.ones((H, 2)), late, late])
    expected[:4] = 0.0
    np.testing.assert_allclose(phasors.harmonics[0], expected, atol=1e-6)
    np.testing.assert_array_equal(phasors.z, phasors.harmonics[:, 0])
    np.testing.assert_array_equal(phasors.covariance, phasors.harmonic_covariance[:, 0])
    variance = np.einsum("hjj->hj", phasors.harmonic_covariance[0]).real
    at_samples = np.hstack([segment.angle_variance, np.tile(segment.torque_variance, (H, 1))])
    np.testing.assert_allclose(variance[:, :2], 4 / N * at_samples[:, :2])
    np.testing.assert_allclose(variance[:, 2:], 4 / N * at_samples[:, 2:] * np.abs(late) ** 2, rtol=1e-6)
    square = (wave[:, 2:] ** 2).mean(axis=0)
    np.testing.assert_allclose(segment.least_torque_variance, 1e-10 * square)
    np.testing.assert_allclose(
        segment.torque_variance, np.maximum(segment.torque_variance, 9e-6 * square)
    )
    assert phasors.omega == pytest.approx(2 * np.pi / 2.5)
    assert phasors.hold_s == pytest.approx(T * held)
    assert (phasors.duration_s[0], phasors.torque_delay_s[0]) == pytest.approx((2.5, 0.003))


@pytest.mark.parametrize(("lowest_hz", "used"), [(1.1, True), (1.3, False)])
def test_a_segment_has_eight_lines(lowest_hz: float, used: bool) -> None:
    """Of 2.5 s, from 1.2 or 1.6 Hz to 4 Hz."""
    record = replace(logged(np.arange(250) * T), band_hz=(lowest_hz, 4.05))
    if used:
        (segment,) = motion_phasors([record], np.ones((1, 1))).segments
        assert segment is not None
        assert (segment.lowest, segment.highest) == (3, 10)
    else:
        with pytest.raises(JointIdError, match="holds too few lines"):
            motion_phasors([record], np.ones((1, 1)))


def test_an_encoder_has_at_least_the_noise_of_its_step() -> None:
    """Its angle stands but for one step; the torque is exact to ten digits of its largest."""
    theta, tau = np.zeros((1, 4000)), 3 * np.exp(-(((np.arange(4000)[None] - 2000) / 300) ** 2))
    theta[0, 2000:] = 0.01
    variance, _ = sensor_variances([part_of(theta, tau)], 4.0, np.array([1e-13]))
    np.testing.assert_allclose(variance, [0.01**2 / 12, (3e-10) ** 2], rtol=0.01)


def test_what_the_angle_leaves_is_no_noise_of_a_quiet_torque() -> None:
    """Accelerations that no logged torque explains, as an encoder makes them at rest."""
    rng, sigma = np.random.default_rng(4), 1e-3
    bend = rng.standard_normal(6000)
    bend -= np.polyval(np.polyfit(np.arange(6000), bend, 2), np.arange(6000))
    theta = np.cumsum(np.cumsum(bend))[None] * T**2
    variance, most = sensor_variances(
        [part_of(theta, sigma * rng.standard_normal((1, 6000)))], 4.0, np.array([0.05])
    )
    assert sigma**2 < variance[1] < 1.6 * sigma**2
    assert most[0] > 0.5 * 0.05**2  # which the records may decide otherwise


@pytest.mark.parametrize("held", [False, True])
def test_the_noise_of_angles_and_torques_is_told_apart_beyond_the_band(held: bool) -> None:
    """White noise of both sensors of two joints, in two parts; of equal power near 22 Hz."""
    rng, M = np.random.default_rng(9), np.array([0.01, 0.02])
    of_angle, of_torque = np.array([1e-5, 2e-5]), np.array([2e-3, 5e-3])
    parts = [
        part_of(
            of_angle[:, None] * rng.standard_normal((2, N)),
            of_torque[:, None] * rng.standard_normal((2, N)),
            held,
        )
        for N in (4000, 9000)
    ]
    variance, most = sensor_variances(parts, 4.0, M)
    np.testing.assert_allclose(variance[:2], of_angle**2, rtol=0.15)
    np.testing.assert_allclose(variance[2:], of_torque**2, rtol=0.15)
    assert np.all((most > 1.05 * variance[2:]) & (most < 1.6 * variance[2:]))
    scale = np.array([4.0, 0.5])  # other units of each joint's angle, with its inertia
    other = [replace(part, theta=part.theta * scale[:, None]) for part in parts]
    found, limit = sensor_variances(other, 4.0, M / scale)
    np.testing.assert_allclose(found, variance * np.append(scale, [1, 1]) ** 2, rtol=1e-9)
    np.testing.assert_allclose(limit, most, rtol=1e-9)


# --- friction


def test_slow_stretches_end_at_clear_motion() -> None:
    """A turn at once, a pause, a slow passage that never rests, and a rest at the end."""
    v = np.array([2.0, -2, -2, 0.1, 0, -2, -2, -0.8, -0.8, -2, -2, 0])
    found = _stretches(v, threshold=1.0, blur=0.5)
    np.testing.assert_array_equal(found, [[0, 1], [2, 5]])
    v = np.append(v, 0.0)
    np.testing.assert_array_equal(_stretches(v, threshold=1.0, blur=0.5)[-1], [10, 12])
    np.testing.assert_array_equal(_stretches(np.zeros(9), threshold=1.0, blur=0.5), [[0, 8]])


@pytest.mark.parametrize("steps", [3, 40])
def test_transforms_of_polynomials_are_their_integrals(steps: int) -> None:
    N, H, count = 100, 6, 4
    found, std = _transforms(steps, N, H, count)
    x = (np.arange(20_000) + 0.5) / 10_000 - 1  # over the stretch, from -1 to 1
    shapes = np.polynomial.legendre.legvander(x, count - 1)
    turn = np.exp(-2j * np.pi * np.outer(np.arange(1, H + 1), x * steps / 2) / N)
    np.testing.assert_allclose(found, steps * (turn @ shapes).T / x.size, atol=1e-6)
    # A unit that changes its sign at x has the coefficients of -sign: their mean squares over x.
    edges = np.linspace(-1, 1, 401)
    signs = np.where(x[None, ::20] < edges[:, None], -1.0, 1.0)
    sizes = signs @ shapes[::20] * (2 * np.arange(count) + 1) / x[::20].size
    np.testing.assert_allclose(std, np.sqrt(np.mean(sizes**2, axis=0)), rtol=0.01)


def test_slow_stretches_of_a_period_include_reversals_stops_and_that_over_its_end() -> None:
    phase = 2 * np.pi * (np.arange(GRID) + 0.5) / GRID
    assert _slow(np.zeros(GRID), 0.1) == []
    assert _slow(np.ones(GRID), 0.1) == []
    threshold = np.sin(10 * 2 * np.pi / GRID)  # slower in ten samples before and after each zero
    last = [GRID // 2 - 11, GRID - 11]
    turns = [(last[0], 21, 1.0, -1.0), (last[1], 21, -1.0, 1.0)]
    assert _slow(np.sin(phase), threshold) == turns
    stopped = np.where(np.arange(GRID) // 50 == 4, 0.0, np.sin(phase))  # and goes on
    assert _slow(stopped, threshold) == [(199, 51, 1.0, 1.0), *turns]


@pytest.mark.parametrize(("length", "waveforms"), [(63, 0), (65, 3)])
def test_a_stop_of_half_a_period_of_the_highest_harmonic_is_resolved(
    length: int, waveforms: int
) -> None:
    """A reversal always is; the sign changes in the middle of it."""
    assert GRID == 1024
    velocity, threshold, eight = np.ones((1, 1, GRID)), np.full((1, 1), 0.1), np.array([8])
    velocity[..., 500 : 499 + length] = 0.0
    signs = velocity.copy()
    ((free,),) = _freed(velocity, signs, threshold, eight, 9)
    assert free.shape == (9, waveforms)
    turning = velocity.copy()
    turning[..., 499 + length :] = -1.0
    turning[..., :200] = -1.0
    signs = np.sign(turning)
    ((free,),) = _freed(turning, signs, threshold, eight, 9)
    assert free.shape == (9, 3 + 2)
    after = 499 + (length + 1) // 2
    np.testing.assert_array_equal(signs[0, 0, 200:after], 1.0)
    np.testing.assert_array_equal(signs[0, 0, after:], -1.0)


def test_hats_of_a_reversal_add_to_one() -> None:
    inside = np.zeros(GRID)
    inside[:21] = 1
    hats = _hats(20, 4, 9)
    assert hats.shape == (9, 5)
    np.testing.assert_allclose(hats.sum(axis=1), phasors_of(inside, 9), atol=1e-12)
    first = np.zeros(GRID)
    first[:5] = [1, 0.8, 0.6, 0.4, 0.2]
    np.testing.assert_allclose(hats[:, 0], phasors_of(first, 9), atol=1e-12)


def test_torques_of_slow_stretches_span_a_constant_and_a_line_in_every_bin_of_the_band() -> None:
    segment: Any = SimpleNamespace(highest=40, lowest=5, samples=400)
    stretches = [np.array([[20, 60], [200, 260]]), np.array([[100, 130]])]
    found = _unknown(segment, stretches, np.array([True, False]))
    inside = np.arange(1, 41) >= 5
    assert found.known.tolist() == [[bool(each), False] for each in inside]
    assert found.free[1].shape[1] == 0  # a joint at rest
    (free, _), basis = found.free, np.linalg.svd(found.free[0][inside], full_matrices=False)[0]
    assert not free[~inside].any()
    k = np.arange(400)
    for begin, end in stretches[0]:
        for power in (0, 1):
            fine = (np.arange(16 * 400) + 0.5) / 16
            wave = np.where((fine >= begin) & (fine < end), (fine - begin) ** power, 0.0)
            bins = np.exp(-2j * np.pi / 400 * np.outer(k[1:41], fine)) @ wave
            bins = bins[inside] / np.abs(bins).max()
            assert np.linalg.norm(bins - basis @ (basis.conj().T @ bins)) < 1e-3


def test_dependent_waveforms_of_free_size_count_once() -> None:
    rng = np.random.default_rng(7)
    one, two = complex_noise(rng, 5, 1), complex_noise(rng, 5, 1)
    free = [np.hstack([one, 1e-6 * two, one + two, 2 * two]), np.zeros((5, 0))]
    known = np.ones((5, 2), bool)
    known[0, 1] = False  # no equation
    basis = Waveforms(free, [np.zeros((5, 0))] * 2, known).basis
    assert basis.freed.tolist() == [2, 0]
    assert np.bincount(basis.joint).tolist() == [8]
    rows = np.hstack([basis.torques.real, basis.torques.imag])
    np.testing.assert_allclose(rows @ rows.T, np.eye(8), atol=1e-12)
    for wave in (one, two):
        np.testing.assert_allclose(rows @ np.concatenate([wave.real, wave.imag]), 0, atol=1e-9)
    assert not basis.kept[:, 0].any()  # the other joint keeps its bins
    assert basis.kept[:, 1].tolist() == known[:, 1].tolist()
    whitened = Complement.of(
        (basis,), np.tile(np.eye(2) + 0.5j * np.eye(2)[::-1] * [[1], [-1]], (1, 5, 1, 1))
    )
    values = complex_noise(rng, 1, 5, 2, 1)
    found = whitened.rows(values)
    values[:, 0, 1] += 9.0
    np.testing.assert_allclose(whitened.rows(values), found)


@pytest.mark.parametrize("window", [None, 0.1])
def test_friction_of_a_sine_is_a_square_wave_of_its_velocity(window: float | None) -> None:
    """4/π of the fundamental, a quarter of a period ahead; none of a joint at rest or in noise."""
    q = np.array([[0.3 * np.exp(0.4j), 0.0], [0.3 * np.exp(2j), 1e-3]])
    noise = np.zeros((2, 4, 4), complex)
    noise[1, 1, 1] = 1e-5
    phasors = exact_phasors(np.array([2.0, 3.0]), q, np.ones((2, 2)), noise)
    found = friction_waveforms(phasors, window)
    assert found.stationary.tolist() == [[False, True], [False, True]]
    turn = np.exp(1j * np.array([0.4, 2.0])) * 1j
    np.testing.assert_allclose(found.coulomb[:, 0, 0], 4 / np.pi * turn, rtol=2 * np.pi / GRID)
    assert not found.coulomb[..., 1].any()
    for record, direction in enumerate(found.direction):
        time = np.arange(GRID) / GRID
        velocity = np.imag(turn[record] * np.exp(2j * np.pi * time))
        clear = np.abs(velocity) > 4 * np.pi / GRID
        np.testing.assert_array_equal(direction[0][clear], np.sign(velocity)[clear])
        assert not direction[1].any()
    if window is None:
        assert found.free.shapes == 0
    else:  # around both reversals, together of as many waveforms as the fundamental resolves
        assert found.free.shapes > 0


def test_a_curve_of_friction_fades_with_the_speed() -> None:
    """Mean of exp(−|sin|/w) over the period in phase with the velocity, for widths over the largest.

    Fast records and those of joints at rest do not count: the curve was too coarse for the usual ones.
    """
    q = np.array([[0.3], [0.3], [0.3], [9.0], [9.0], [0.0], [0.0]], complex)
    phasors = exact_phasors(np.full(7, 2.0), q, np.ones((7, 1)))
    found = friction_waveforms(phasors, None, curve=True)
    phase = np.linspace(0, np.pi, 20_001)
    for width, curve in zip(_WIDTHS, found.curve[0, 0, 0], strict=True):
        expected = 4 / np.pi * np.trapezoid(np.exp(-np.sin(phase) / width) * np.sin(phase), phase) / 2
        assert curve == pytest.approx(1j * expected, abs=5 / GRID)


# --- lines of a narrow band


def complex_noise(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def test_a_response_of_polynomials_is_solved_beside_the_terms_of_the_ends() -> None:
    rng = np.random.default_rng(4)
    x, order = np.linspace(-1, 1, 12), 2
    powers = x[:, None] ** np.arange(order + 1)
    u, C, ends = (complex_noise(rng, *shape) for shape in ((12, 2), (2, order + 1, 2), (order + 1, 2)))
    y = np.einsum("kj,kd,jdi->ki", u, powers, C) + powers @ ends
    lines = SpectralLines.of(x, order, y, u, np.ones((2, 12, 2)))
    np.testing.assert_allclose(lines.regressors(u) @ C.reshape(-1, 2), lines.left @ y, atol=1e-12)
    np.testing.assert_allclose(lines.expected_noise, np.full((2, 2), 12 - order - 1))
    drawn = [lines.regressors(complex_noise(rng, 12, 1)) for _ in range(1500)]
    normal = np.mean([each.conj().T @ each for each in drawn], axis=0)
    np.testing.assert_allclose(normal, lines.noise_power, atol=0.4)


def test_the_gain_of_a_controller_is_measured_and_continued() -> None:
    """From lines above the motion to those in it; the square is linear in that of |1 - z|."""
    rng = np.random.default_rng(5)
    angle = complex_noise(rng, 1, 5000)
    gain, error, power = _gain(angle, 3 * angle)
    assert (gain[0], error[0]) == pytest.approx((9 * (1 - 2 / 5000), 9 * (1 + 2 / 5000)))
    assert power[0] == pytest.approx(np.mean(np.abs(angle) ** 2))
    apart, error, _ = _gain(angle, 3 * complex_noise(rng, 1, 5000))
    assert apart[0] < 0.02
    assert 9 * 2 / 5000 * 0.9 < error[0] < 0.02
    assert _gain(0 * angle, angle)[0] == 0

    at, wanted = np.linspace(0.2, 0.45, 6), np.array([0.01, 0.1])
    square = [4 + 30 * np.sin(np.pi * place) ** 2 for place in (at, wanted)]
    np.testing.assert_allclose(_continued(at, square[0], 0.1 * square[0], wanted), square[1])
    assert not _continued(at, square[0], 0 * at, wanted).any()


# --- ends


def test_terms_of_the_arm_move_the_motors_by_the_response_to_the_arm() -> None:
    rng = np.random.default_rng(6)
    r, H, n = 3, 5, 2
    segment = SimpleNamespace(record=0, highest=H)
    phasors: Any = SimpleNamespace(
        motion=np.array([False, True, True]), segments=(None, segment, segment)
    )
    s = 1j * np.outer([1.0, 2.0, 3.0], np.arange(1, H + 1))
    terms = EndTerms.of(phasors, s)
    assert terms is not None
    unit = (np.arange(1, H + 1) / H) * 1j
    for degree, found in zip((0, 1, 2, 3, -1), terms.powers[1].T, strict=True):
        np.testing.assert_allclose(found, 1j * unit**degree)
    arm, sizes = complex_noise(rng, r, H, n, n), rng.standard_normal((r, 2 * n))
    columns = terms.columns(arm)
    assert columns.shape == (2, H, n, 2 * n + 5 * n)
    moved = (arm @ terms.on_arm(sizes, n)[..., None])[..., 0]
    by_columns = np.einsum("mhnk,mk->mhn", columns[..., : 2 * n], sizes[1:])
    np.testing.assert_allclose(moved[1:], by_columns, atol=1e-12)
    assert not moved[0].any()
    at_motor = columns[..., 2 * n :].reshape(2, H, n, n, 5)
    np.testing.assert_allclose(at_motor, np.eye(n)[:, :, None] * terms.powers[:, :, None, None])
    phasors.motion[:] = False
    assert EndTerms.of(phasors, s) is None


def test_bins_of_motions_share_misfits_in_bands_of_150_equations() -> None:
    known = np.ones((2, 200), bool)
    phasors: Any = SimpleNamespace(motion=np.array([True, True]), omega=np.array([1.0, 1.0]), n=2)
    group, of_fundamental = row_groups(phasors, known)  # 800 equations, five bands
    assert of_fundamental.tolist() == [True] * 5
    np.testing.assert_array_equal(group[0], np.repeat(np.arange(5), 40))
    phasors.motion[0] = False
    group, of_fundamental = row_groups(phasors, known)
    np.testing.assert_array_equal(group[0], np.arange(200))
    np.testing.assert_array_equal(group[1], 200 + np.repeat(np.arange(2), 100))
    assert np.flatnonzero(of_fundamental).tolist() == [0, 200, 201]


def test_the_acceleration_of_a_segment_is_s_times_its_velocity() -> None:
    """In the lines of its band, of a motion that ends in rest; sines have none."""
    N, step_s = 1000, 2e-3
    k = np.arange(N)
    velocity = np.sin(np.pi * k / N) ** 2 * np.sin(2 * np.pi * np.array([[40.0], [57.0]]) * k / N + 1)
    segment = segment_of(velocity, 0 * velocity, step_s)
    phasors: Any = SimpleNamespace(
        motion=np.array([False, True]), segments=(None, segment), harmonics=np.zeros((2, 70, 4)), n=2
    )
    found = motor_motion(phasors)
    assert found is not None
    assert not found[:, 0].any()
    s = 2j * np.pi * np.arange(1, 71)[:, None] / (N * step_s)
    known = 2j / N * np.exp(-2j * np.pi * np.outer(np.arange(1, 71), k) / N) @ velocity.T
    known[:4] = known[60:] = 0.0
    np.testing.assert_allclose(found[0, 1], known, atol=1e-12)
    np.testing.assert_allclose(found[1, 1], s * known, atol=1e-3)
    phasors.motion[:] = False
    assert motor_motion(phasors) is None


# --- torques through gears, and noise, of a segment


def segment_of(velocity: np.ndarray, torque: np.ndarray, step_s: float, **changed: Any) -> Segment:
    """A whole record without noise, unless changed."""
    none = np.zeros(len(velocity))
    whole = [0, step_s, velocity, velocity, torque, False, 0, velocity.shape[1], *[none] * 7, 5, 60]
    return replace(Segment(*whole), **changed)


def test_friction_that_fades_with_the_velocity_has_the_spectrum_of_its_samples() -> None:
    """Of sign θ̇ · exp(−|θ̇|/w): sums over a fine grid, in which no reversal is near a sample."""
    fine, coarse, w = 60_000, 2_000, np.array([[0.3, 2.0]])

    def velocity(samples: int) -> np.ndarray:
        phase = 2 * np.pi * (np.arange(samples) + 0.3 * samples / coarse) / samples
        return (np.sin(3 * phase) + 0.4 * np.sin(8 * phase + 1))[None]

    segment = segment_of(velocity(coarse), velocity(coarse), 1e-3)
    coulomb, curve, *_ = segment_friction(segment, None, w)
    v, band = velocity(fine), slice(segment.lowest - 1, segment.highest)
    for found, samples in (
        (coulomb[:, 0], np.sign(v[0])),
        (curve[:, 0, 0], np.sign(v[0]) * np.exp(-np.abs(v[0]) / 0.3)),
        (curve[:, 0, 1], np.sign(v[0]) * np.exp(-np.abs(v[0]) / 2.0)),
    ):
        expected = 2j / fine * np.fft.rfft(samples)[1 : segment.highest + 1]
        np.testing.assert_allclose(found[band], expected[band], atol=2e-3)


@pytest.mark.parametrize("held", [False, True])
def test_the_torque_through_a_gear_is_what_the_motor_leaves(held: bool) -> None:
    """Of two motors, late by stated delays; a share of what the gear passes on is friction."""
    step, N, s = 1e-3, 2000, 2j * np.pi * np.array([3.0, 7.0])
    t, v = step * np.arange(N), np.array([[2.0, 0.0], [0.0, 1.0]])
    gear = np.array([[0.5, 0.1j], [0.3, -0.2]])
    motors = Motors(
        *np.array([[2e-3, 1e-3], [0.03, 0], [0.01, 0.02], [0, 0.2], [1.3e-3, -2e-3], [1.1, 1], [0, 0]])
    )
    velocity, through = (np.einsum("jk,kt->jt", x, np.exp(np.outer(s, t))).imag for x in (v, gear))
    rate = np.einsum("jk,kt->jt", v * s, np.exp(np.outer(s, t))).imag
    direction = np.sign(velocity)
    whole = through + motors.M[:, None] * rate + motors.viscous[:, None] * velocity
    whole += (motors.coulomb[:, None] + motors.load[:, None] * np.abs(through)) * direction
    # The log is early by the lag, over the scale; a held one is on average that before, half a step.
    logged = np.stack(
        [
            np.interp(t + lag + 0.5 * step * held, t, own, period=N * step)
            for lag, own in zip(motors.lag_s, whole, strict=True)
        ]
    )
    segment = segment_of(velocity, logged / motors.torque_scale[:, None], step, held=held)
    found = segment.gear_torque(motors, direction)
    inside = slice(40, -40)
    size = np.abs(through).max()
    assert np.abs(found - through)[:, inside].mean() < 0.01 * size
    turns = np.diff(direction, axis=1) != 0
    at = np.sqrt((turns * through[:, 1:] ** 2).sum(axis=1) / turns.sum(axis=1))
    np.testing.assert_allclose(
        segment.friction_at_reversals(motors), motors.coulomb + motors.load * at, rtol=0.03
    )
    plain = motors._replace(load=np.zeros(2))
    np.testing.assert_array_equal(segment.friction_at_reversals(plain), motors.coulomb)


def test_arms_follow_their_motors_by_the_equation() -> None:
    """Two coupled arms with gravity and friction, from a start in the middle of their motion."""
    step, N, s = 1e-3, 500, 2j * np.pi * np.array([5.0, 17.0])
    K, D, v = np.array([50.0, 20.0]), np.array([0.1, 0.05]), np.array([0.02, 0.01])
    M2, G = np.array([[4e-3, 1e-3], [1e-3, 2e-3]]), np.array([[2.0, 0.5], [0.5, 1.0]])
    motor, push = np.array([[0.1, 0.03j], [0.05j, -0.04]]), np.array([[0.2, 0.1], [0.1j, 0.0]])
    arm = np.stack(
        [
            np.linalg.solve(
                x * x * M2 + G + np.diag(x * v + K + x * D), (K + x * D) * motor[:, k] - push[:, k]
            )
            for k, x in enumerate(s)
        ],
        axis=1,
    )
    waves = np.exp(np.outer(s, step * np.arange(N)))
    angle, speed, friction, gear, moved = (
        (each @ waves).imag
        for each in (motor, motor * s, push, (K[:, None] + D[:, None] * s) * (motor - arm), arm * s)
    )
    arms = DrivenArms(K, D, np.zeros(2), v, M2, G)
    offset = np.array([[0.3], [-0.2]])  # of the torque sensors, which is none of the gears'
    torque, found = arms._driven(angle, speed, friction, gear + offset, step)
    np.testing.assert_allclose(found, moved, atol=2e-3 * np.abs(moved).max())
    np.testing.assert_allclose(torque, gear + offset, atol=2e-3 * np.abs(gear).max())
    by_torque = arms._by_torque(speed, gear, step)[:, 100:-1]
    np.testing.assert_allclose(by_torque, moved[:, 100:-1], atol=0.02 * np.abs(moved).max())


@pytest.mark.parametrize("held", [False, True])
def test_a_part_of_a_record_needs_its_torque_only_nearby(held: bool) -> None:
    """A spline of the whole record in every segment took time and memory by the square of its length."""
    torque, late = np.random.default_rng(0).standard_normal((1, 5000)), 12.3
    segment = segment_of(torque, torque, 1e-3, held=held, begin=2000, end=2500)
    far = torque.copy()
    far[:, :1900] = far[:, 2600:] = np.nan
    places = np.arange(2000, 2500) - late
    found = segment._torque_at(0, places)
    spline = CubicSpline(np.arange(5000), torque[0])
    integral = spline.antiderivative()
    expected = integral(places) - integral(places - 1) if held else spline(places)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_array_equal(replace(segment, torque=far)._torque_at(0, places), found)


def test_noise_of_motions_is_within_its_limits_and_shared_by_records() -> None:
    """And the friction that brakes a motor shows how late it turns back."""
    velocity = np.stack([np.sin(np.linspace(0, 9, 300)), np.cos(np.linspace(0, 9, 300))])
    limits = {
        "least_torque_variance": np.array([1e-4, 1e-4]),
        "most_torque_variance": np.array([4e-4, 1]),
    }
    angles = np.array([[1e-9, 2e-9], [1e-9, 2e-9], [1e-9, 4e-9]])  # of three lines
    limits |= {"angle_variance": angles, "highest": 3, "velocity_blur_s": np.array([1e-4, 0.1])}
    segments = [segment_of(velocity, velocity, 0.01, record=k, **limits) for k in (0, 1, 4)]
    z = np.ones((4, 3, 4), complex)
    phasors = replace(
        exact_phasors(np.ones(4), z[:, 0, :2], z[:, 0, 2:]),
        harmonics=z, harmonic_covariance=np.zeros((4, 3, 4, 4), complex), segments=(None, *segments),
    )  # fmt: skip
    prior = InertiaPrior.of(Inertia([0.1, 0.2], np.eye(2)), 4, 2)
    one, none = np.ones(2), np.zeros(2)
    motors = [
        Motors(prior.M[0], np.array([0.2, 0.5]), none, none, none, 2 * one, np.array([0.1, -0.1]))
    ] * 4
    torques = {0: np.array([2e-4, 3e-4]), 1: np.array([9e-4, 1e-5])}
    unseen = {number: np.array([np.nan, np.nan]) for number in torques}
    kept = with_torque_noise(phasors, prior, unseen, motors).segments[1:]
    for one, before in zip(kept, segments, strict=True):
        limited = np.clip(before.torque_variance, [1e-4, 1e-4], [4e-4, 1])
        np.testing.assert_array_equal(one.torque_variance, limited)
    found = with_torque_noise(phasors, prior, torques, motors)
    kept = [[2e-4, 3e-4], [4e-4, 1e-4], [4e-4, 1.55e-4]]  # as given, limited, and the mean of both
    for row, (variance, each) in enumerate(zip(kept, found.segments[1:], strict=True), start=1):
        whole = [4 / 300 * np.diag([*angle, *variance]) for angle in angles]
        np.testing.assert_allclose(found.harmonic_covariance[row], whole, rtol=1e-9)
        np.testing.assert_allclose(each.torque_variance, variance)
        np.testing.assert_allclose(each.unknown_Nm, [0.15, 0.2])
        largest = np.abs(velocity[1]).max()
        np.testing.assert_allclose(each.turn_rad_s, [3e-4, 0.2 * largest])
    assert not found.harmonic_covariance[0].any()
    louder = np.where(np.arange(4) < 3, 1.0, 1.3)[None, None]  # one joint's torque
    other = replace(found, harmonic_covariance=found.harmonic_covariance * louder[..., None])
    for one_of, two in ((found, other), (other, found)):
        assert noise_differs(one_of, two, 0.29)
        assert not noise_differs(one_of, two, 0.31)


def test_lines_of_a_fit_are_the_bins_of_motions_and_the_fundamentals_of_sines() -> None:
    z = np.arange(1, 37).reshape(3, 3, 4) * (1 + 1j)
    z[1, 2] = 0.0  # outside the band
    rows = exact_phasors(np.array([5.0, 0.5, 0.25]), z[:, 0, :2] + 9, z[:, 0, 2:] + 9)
    still = segment_of(np.ones((2, 9)), np.ones((2, 9)), 0.1)
    rows = replace(rows, harmonics=z, harmonic_covariance=np.zeros((3, 3, 4, 4), complex))
    rows = replace(rows, segments=(None, still, still), harmonic_rounding=np.zeros((3, 3, 4)))
    noise = Noise(np.arange(3 * 3 * 16).reshape(3, 3, 4, 4).astype(complex), np.ones(3))
    estimate: Any = SimpleNamespace(phasors=rows, inertias="abc")
    lines, inertias = _lines(estimate, rows, noise)
    np.testing.assert_allclose(lines.frequency_found_hz, [5.0, 0.5, 1.0, 0.25, 0.5, 0.75])
    np.testing.assert_allclose(lines.omega, 2 * np.pi * lines.frequency_found_hz)
    place = [1, 1, 2, 2, 2], [0, 1, 0, 1, 2]
    np.testing.assert_array_equal(lines.z, np.concatenate([rows.z[:1], z[place]]))
    np.testing.assert_array_equal(lines.harmonics[:, 0], lines.z)
    covariance = np.concatenate([noise.covariance[:1, 0], noise.covariance[place]])
    np.testing.assert_array_equal(lines.covariance, covariance)
    np.testing.assert_array_equal(lines.harmonic_covariance[:, 0], covariance)
    assert "".join(inertias) == "abbccc"
    assert not lines.motion.any()


def test_flanks_of_backlash_are_in_contact_from_a_fifth_of_the_torque() -> None:
    """Between the flanks the contact changes uniformly; the ends have that of the nearest load."""
    torque = np.array([[0.1, 0.21, 1.0, 0.19, 0.0, -0.19, -0.21, -0.5, 0.0]])
    asked = []

    def balance(*parameters: np.ndarray) -> np.ndarray:
        asked.append(parameters)
        return torque.copy()

    motors: Any = SimpleNamespace(balance=balance, bins=lambda flank, shape: (flank, shape))
    flank: Any
    flank, shape = MotorMotion.flanks(motors, np.array([0.1]), (1, 3))
    np.testing.assert_allclose(flank[0], [1, 1, 1, 0.5, 0, -0.5, -1, -1, -1])
    assert shape == (1, 3)
    assert [float(each[0]) for each in asked[0]] == [1.0, 0.1, 0.0, 0.0]


def test_the_errors_of_two_variances_are_those_of_their_powers() -> None:
    """Each in bands of its own: exponential powers of which neighbours through a window are one."""
    rng, count = np.random.default_rng(7), np.full(20, 40.0)
    gains = np.kron(np.eye(2), np.ones((10, 1))) * rng.uniform(0.5, 2, (20, 1))
    true = np.array([3e-6, 0.4])
    power = gains @ true * (1 + 0.1 * rng.standard_normal(20))
    found, error = _non_negative(gains, power, count)
    np.testing.assert_allclose(found, true, rtol=0.15)
    np.testing.assert_allclose(error, found * np.sqrt(2 / 400), rtol=1e-6)
    negative = _non_negative(np.array([[1.0, 2.0], [1.0, 1.0]]), np.array([3.0, 1.0]), count[:2])
    assert negative[0].min() == 0.0


def test_a_model_is_sought_in_segments_of_every_joint_s_motion() -> None:
    """Evenly spread, two of each joint where six are enough, beside all sines: of every pose."""
    moves = np.repeat([0, 1, 2, 0], [8, 9, 3, 6])  # the joint that moves most, of 26 segments
    size = np.where(moves[:, None] == np.arange(3), 1.0, 0.2) * [1e-3, 5.0, 0.3]
    z = np.zeros((28, 4, 6), complex)
    z[2:, 1:, :3] = size[:, None]
    still = segment_of(np.ones((3, 9)), np.ones((3, 9)), 0.1)
    rows = replace(
        exact_phasors(np.ones(28), z[:, 0, :3], z[:, 0, 3:]),
        harmonics=z, harmonic_covariance=np.zeros((28, 4, 6, 6), complex),
        segments=(None, None, *[still] * 26), harmonic_rounding=np.zeros((28, 4, 6)),
    )  # fmt: skip
    one = InertiaPrior.of(Inertia(np.ones(3), np.eye(3)), 28, 3)
    every = [2 + np.flatnonzero(moves == j)[::step] for j, step in enumerate((7, 5, 2))]
    assert _few(rows, one).tolist() == [0, 1, *sorted(np.concatenate(every).tolist())]
    poses = [Inertia(np.ones(3), (1 + k % 2) * np.eye(3)) for k in range(28)]
    chosen = _few(rows, InertiaPrior.of(poses, 28, 3))
    assert chosen[:2].tolist() == [0, 1]
    kinds = Counter((int(moves[k - 2]), int(k % 2)) for k in chosen[2:])
    assert kinds == Counter({(j, k): 2 for j in range(3) for k in range(2)}) - Counter([(2, 0)])
    few = rows.select(np.arange(8))
    assert _few(few, one).tolist() == list(range(8))


@pytest.mark.parametrize("filtered", [False, True])
def test_the_torque_through_a_gear_in_sines_is_what_the_motor_leaves(filtered: bool) -> None:
    """Under travel and a constant load; a lag and a scale of the log, and a filter of the positions."""
    H, points, lag = 30, GRID, np.array([1e-3, -5e-4])
    omega = 2 * np.pi * np.array([4.0, 9.0])
    s = 1j * omega[:, None, None] * np.arange(1, H + 1)[:, None]
    q, gear = np.zeros((2, 2, H, 2), complex)
    q[:, 0], q[:, 1:3] = [[0.2, 0.1j], [0.1, -0.2]], 0.003  # of seen harmonics only
    gear[:, 0], gear[:, 1] = [[1.0, 0.5j], [0.5, 0.4]], [[0.2, 0.0], [0.0, 0.1j]]
    drift, mean = np.array([[0.5, 0.0], [0.0, -1.0]]), np.array([[0.3, 0.1], [0.0, -0.2]])
    M, coulomb, viscous = np.array([[2e-3, 1e-3], [0.05, 0.02], [0.01, 0.03]])
    load, scale = np.array([0.1, 0.0]), np.array([1.2, 0.9])
    T = np.array([2e-4, 0.0]) * filtered
    through = mean[..., None] + samples_of(gear.swapaxes(1, 2), points)
    sign = np.sign(samples_of((s * q).swapaxes(1, 2), points) + drift[..., None])
    rubbing = (coulomb[:, None] + load[:, None] * np.abs(through)) * sign
    whole = gear + s * (s * M + viscous) * q + phasors_of(rubbing, H).swapaxes(1, 2)
    tau, z_mean = whole * np.exp(s * lag) / scale, mean + viscous * drift + rubbing.mean(axis=2)
    z = np.concatenate([q / (1 + s * T), tau], axis=2)
    phasors = replace(
        exact_phasors(omega / (2 * np.pi), z[:, 0, :2], tau[:, 0]), drift=drift, harmonics=z,
        harmonic_covariance=np.zeros((2, H, 4, 4), complex), mean_torque=z_mean / scale,
        harmonic_rounding=np.zeros(z.shape),
    )  # fmt: skip
    friction = friction_waveforms(phasors, None, position_filter=T if filtered else None)
    motors = [Motors(M, coulomb, viscous, load, lag, scale, np.zeros(2))] * 2
    found = gear_torque_of(friction, phasors, motors, loaded=True)
    size = np.abs(through).max()
    assert np.abs(found.sines - through).mean() < 0.01 * size
    waves = with_load(friction, phasors, found).further["load"]
    true = phasors_of(np.abs(through) * sign, H).swapaxes(1, 2)
    np.testing.assert_allclose(waves[:, 0], true[:, 0], atol=0.02 * size)
    np.testing.assert_allclose(waves, true, atol=0.05 * size)


# --- projection of free friction


@pytest.mark.parametrize("ends", [False, True])
@pytest.mark.parametrize(("bounded", "H"), [(False, 6), (True, 6), (True, 30)])
def test_free_friction_is_that_of_generalised_least_squares(bounded: bool, ends: bool, H: int) -> None:
    """Rows, weighted residuals, friction and its size, against one large real system per record.

    Joints with few waveforms for their bins keep these.
    """
    rng = np.random.default_rng(8)
    r, n, counts = 3, 2, ((2, 1), (0, 3), (1, 1)) if H == 6 else ((2, 9), (0, 3), (12, 1))
    root = complex_noise(rng, r, H, n, n)
    V = root @ root.conj().swapaxes(2, 3) + 0.5 * np.eye(n)
    sizes = rng.uniform(0.5, 2, (r, n))
    records = [
        Waveforms(
            [complex_noise(rng, H, k) for k in own],
            [complex_noise(rng, H, 2 * bounded) for _ in own],
            np.ones((H, n), bool),
        )
        for own in counts
    ]
    free, number = (
        FreeFriction.of(records, sizes, np.zeros((r, H, n, 0), complex)),
        sum(map(sum, counts)),
    )
    assert bool(free.bases) == bounded
    assert free.shapes == number
    at_ends, further = np.array([0, 2]), complex_noise(rng, 2, H, n, 3)
    projection = (free.with_columns(at_ends, further) if ends else free).projection(whitener(V), V)
    values = complex_noise(rng, r, H, n, 1)
    rows = projection.rows(values)
    weighted = projection.W.conj().swapaxes(2, 3) @ projection.whitened(rows)
    explained, first = projection.explained(values), projection.first_sizes(values, 2)
    kept = projection.noise_left(np.full((r, 1), 2.0 * H)).sum(axis=1)

    def real(columns: np.ndarray) -> np.ndarray:
        flat = columns.reshape(H * n, -1)
        return np.concatenate([flat.real, flat.imag])

    def placed(waves: np.ndarray, j: int) -> np.ndarray:
        return real(waves[:, None] * np.eye(n)[j][:, None])

    for k, own in enumerate(records):
        whole = np.zeros((H, n, H, n), complex)
        whole[range(H), :, range(H)] = V[k]
        whole = whole.reshape(H * n, H * n)
        noise = np.block([[whole.real, -whole.imag], [whole.imag, whole.real]])
        C, columns = noise.copy(), [placed(own.free[j], j) for j in range(n)]
        for j in range(n):  # rows of noise have half of its variance
            shapes = sizes[k, j] * placed(own.bounded[j], j)
            C += 2 * shapes @ shapes.T
        if ends and k in at_ends:
            columns.append(real(further[at_ends.tolist().index(k)]))
        F, y, inverse = np.concatenate(columns, axis=1), real(values[k])[:, 0], np.linalg.inv(C)
        amplitudes = np.linalg.solve(F.T @ inverse @ F, F.T @ inverse @ y)
        left = inverse @ (y - F @ amplitudes)
        assert (rows[k] ** 2).sum() == pytest.approx(y @ left, rel=1e-6)
        np.testing.assert_allclose(real(weighted[k])[:, 0], left, atol=1e-6)
        np.testing.assert_allclose(real(explained[k])[:, 0], y - noise @ left, atol=1e-6)
        at = amplitudes[-3:-1] if ends and k in at_ends else [0.0, 0.0]
        np.testing.assert_allclose(first[k], at, atol=1e-6)
        by_noise = inverse @ (noise - F @ np.linalg.solve(F.T @ inverse @ F, F.T @ inverse @ noise))
        # Ends count as if noise kept nothing of their span, also where bounded friction does; between
        # motors that keep their bins and others, squares are left out.
        assert kept[k] == pytest.approx(
            np.trace(by_noise @ by_noise), rel=0.02 if bounded and ends else 1e-3
        )
    assert projection.rank() == number + 6 * ends


def test_free_friction_moves_and_scales_with_the_record() -> None:
    """The columns times a phase of every bin, and bounded torques of another size."""
    rng, H, n = np.random.default_rng(9), 5, 2
    for bounded in (0, 1):
        shapes = [[complex_noise(rng, H, k) for _ in range(n)] for k in (2, bounded)]
        turn = np.exp(1j * rng.uniform(0, 6, (1, H, n)))
        V, known = np.tile(np.eye(n).astype(complex), (1, H, 1, 1)), np.ones((H, n), bool)
        size, scale = np.array([[1.0, 2.0]]), np.array([0.5, 3.0])
        same = np.zeros((1, H, n, 0), complex)
        free = FreeFriction.of([Waveforms(*shapes, known)], size, same)
        moved = [[own * turn[0, :, j, None] for j, own in enumerate(each)] for each in shapes]
        values = complex_noise(rng, 1, H, n, 1)
        for found, own, std in (
            (free.moved(turn), moved, size),
            (free.scaled(scale), shapes, size * scale),
        ):
            true = FreeFriction.of([Waveforms(*own, known)], std, same)
            costs = [(each.projection(V, V).rows(values) ** 2).sum() for each in (found, true)]
            assert costs[0] == pytest.approx(costs[1])


def test_noise_is_sought_where_free_friction_leaves_equations(monkeypatch: pytest.MonkeyPatch) -> None:
    """A segment shows it from 30 % of its equations on, or if it has the largest share, above 2 %."""
    r, H, n = 4, 3, 3
    z = np.ones((r, H, 2 * n), complex)
    z[1, 2] = 0.0
    still = segment_of(np.ones((n, 9)), np.ones((n, 9)), 0.1)
    phasors = replace(
        exact_phasors(np.ones(r), z[:, 0, :n], z[:, 0, n:]), segments=(None, still, still, still),
        harmonics=z, harmonic_covariance=np.zeros((r, H, 2 * n, 2 * n), complex),
    )  # fmt: skip
    share = np.array([[0.9, 0.9, 0.9], [0.29, 0.1, 0.01], [0.31, 0.2, 0.015], [0.9, 0.15, 0.9]])
    used = np.ones((r, n), bool)
    used[3, 2] = False
    asked = []

    def noise_left(rows: np.ndarray) -> np.ndarray:
        asked.append(rows[:, 0].tolist())
        return share * rows

    at = SimpleNamespace(
        r=np.full((r, H, n), 5.0 + 0j), E="E", p=None, problem=SimpleNamespace(used=used)
    )
    residual = SimpleNamespace(
        at=at, free_friction=lambda: 2.0, projection=SimpleNamespace(noise_left=noise_left)
    )
    monkeypatch.setattr(motion_noise, "evaluated", lambda *_: residual)
    monkeypatch.setattr(motion_noise, "noise_of_rows", lambda *_: None)
    monkeypatch.setattr(motion_noise, "sensor_noise", lambda phasors, left, E: (left, E))
    monkeypatch.setattr(motion_noise, "with_torque_noise", lambda phasors, prior, torques, _: torques)
    prior: Any = SimpleNamespace(motors=lambda *_: None)
    estimate: Any = SimpleNamespace(named=None)
    left: Any = motion_noise.with_noise(phasors, prior, None, estimate)  # type: ignore[arg-type]
    assert asked == [[6.0, 4.0, 6.0, 6.0]]
    shown = np.array([[True] * 3, [False, False, False], [True, True, False], [True, False, False]])
    expected = np.where(shown, 3.0 / np.sqrt(share), np.nan)
    np.testing.assert_allclose(left[0][:, 0].real, expected)
    assert left[1] == "E"
    sines = phasors.select(np.array([0]))
    assert motion_noise.with_noise(sines, prior, None, estimate) is sines  # type: ignore[arg-type]


# --- known answers of small signals


def test_a_constant_velocity_is_exact_at_every_sample() -> None:
    for samples in (64, 97, 101):
        angle = np.array([[3.0, -0.5]]).T * 0.01 * np.arange(samples) + 7.0
        velocity, noise, _ = smooth_velocity(angle, 0.01, np.full(2, 1e-10))
        np.testing.assert_allclose(velocity, np.array([[3.0], [-0.5]]) * np.ones(samples), rtol=1e-9)
        assert np.all(noise < 1e-3)


def test_the_velocity_of_a_motion_without_noise_is_its_derivative() -> None:
    """Of 1010 samples, which are reflected to 1025; there are ten periods."""
    time = np.arange(1010) * T
    turn = 2 * np.pi * 10 / time[-1] * (time - time[-1])
    angle = np.stack([np.sin(turn), 30 + 4 * time + 3 * np.sin(turn)])
    velocity, noise, blur = smooth_velocity(angle, T, np.zeros(2))
    rate = 2 * np.pi * 10 / time[-1]
    expected = np.stack([rate * np.cos(turn), 4 + 3 * rate * np.cos(turn)])
    np.testing.assert_allclose(velocity, expected, atol=2e-2)
    np.testing.assert_allclose(velocity[:, :900], expected[:, :900], atol=2e-4)
    assert not noise.any()
    assert blur == pytest.approx([2 * T / np.pi**2] * 2, rel=0.01)  # of the highest frequency alone


def test_velocities_of_joints_do_not_depend_on_each_other_and_scale_with_them() -> None:
    rng = np.random.default_rng(3)
    noise = np.array([1e-3, 3e-2])
    angle = np.sin(np.arange(700) * T * np.array([[3.0], [8.0]])) + noise[:, None] * rng.standard_normal(
        (2, 700)
    )
    both = smooth_velocity(angle, T, noise**2)
    for j in range(2):
        alone = smooth_velocity(8 * angle[j : j + 1], T, 64 * noise[j : j + 1] ** 2)
        for found, own, unit in zip(both, alone, (8, 8, 1), strict=True):
            np.testing.assert_allclose(unit * found[j], own[0], rtol=1e-9, atol=1e-9)


def test_a_motor_at_rest_has_no_velocity_and_no_noise_of_it() -> None:
    velocity, noise, blur = smooth_velocity(np.zeros((1, 200)), T, np.array([1e-6]))
    assert not velocity.any()
    assert not noise.any()
    assert np.isfinite(blur).all()


def test_the_noise_of_a_velocity_that_is_not_filtered_is_that_of_a_derivative() -> None:
    """π σ / (√3 T) of angles up to half the sample rate."""
    angle = np.random.default_rng(4).standard_normal((1, 2000))
    _, noise, _ = smooth_velocity(angle, T, np.array([1e-8]))
    assert noise == pytest.approx([1e-4 * np.pi / (np.sqrt(3) * T)], rel=0.01)


@pytest.mark.parametrize(("least", "moves"), [(0.4, True), (0.6, False)])
def test_the_direction_of_an_arm_is_a_square_wave_unless_it_rests(least: float, moves: bool) -> None:
    """Three periods of a sine: its odd multiples have 4/π over their order, with their phases."""
    N, H = 1200, 40
    segment: Any = SimpleNamespace(record=0, highest=H, samples=N, least_velocity=np.array([least]))
    velocity = np.sin(2 * np.pi * 3 * np.arange(N) / N + 0.3)
    found = _directions(segment, velocity[None])[:, 0]
    expected = np.zeros(H, complex)
    for order in (1, 3, 5, 7, 9, 11, 13):
        expected[3 * order - 1] = moves * 4 / np.pi / order * np.exp(0.3j * order)
    np.testing.assert_allclose(found, expected, atol=1e-2)


def moving_arm(coulomb: float, noise: float, damping: float = 0.1) -> tuple[Any, DrivenArms, np.ndarray]:
    """A segment of one motor of two sines, noise of its torque, and the velocity of its arm."""
    step, N, s = 1e-3, 500, 2j * np.pi * np.array([6.0, 17.0])
    K, M2, motor = 50.0, 4e-3, np.array([0.1, 0.03j])
    arm = (K + s * damping) * motor / (s * s * M2 + K + s * damping)
    waves = np.exp(np.outer(s, step * np.arange(N)))
    speed, torque, moved = (
        (each @ waves).imag[None] for each in (motor * s, (K + s * damping) * (motor - arm), arm * s)
    )
    torque = torque + noise * np.random.default_rng(7).standard_normal(torque.shape)
    segment = SimpleNamespace(
        samples=N, highest=30, interval_s=step, velocity=speed, torque_variance=np.full(1, noise**2),
        gear_torque=lambda *_: torque,
    )  # fmt: skip
    one = np.ones(1)
    arms = DrivenArms(K * one, damping * one, coulomb * one, 0 * one, M2 * np.eye(1), 0 * np.eye(1))
    return segment, arms, moved


def test_an_arm_without_friction_moves_as_the_torque_through_its_gear_says() -> None:
    segment, arms, moved = moving_arm(0.0, 0.0)
    found = arms.velocities(segment, None)  # type: ignore[arg-type]
    finer = 2  # thirty points per period of the highest bin
    assert found.shape == (1, finer * 499 + 1)
    np.testing.assert_allclose(found[:, ::finer][:, 100:-1], moved[:, 100:-1], atol=0.01)


def test_an_arm_with_friction_follows_its_motor_where_its_torque_is_noisy() -> None:
    """Unless it is unstable: then the measured torque alone tells."""
    segment, arms, moved = moving_arm(1e-9, 0.05)
    found = arms.velocities(segment, None)[:, ::2]  # type: ignore[arg-type]
    plain = replace(arms, coulomb=np.zeros(1)).velocities(segment, None)[:, ::2]  # type: ignore[arg-type]
    inside = slice(20, -20)
    off, by_torque = (np.abs(each - moved)[:, inside].max() for each in (found, plain))
    assert off < 0.3 * by_torque
    segment, arms, _ = moving_arm(1e-9, 0.05, damping=-0.01)
    np.testing.assert_array_equal(
        arms.velocities(segment, None),  # type: ignore[arg-type]
        replace(arms, coulomb=np.zeros(1)).velocities(segment, None),  # type: ignore[arg-type]
    )


@pytest.mark.parametrize("size", [1.0, 1e-5, 1e4])
def test_rounding_that_ten_periods_share_counts_nine_times_more(size: float) -> None:
    """A variance of step²/12; of a drift or without steps it is none."""
    phase = 2 * np.pi * np.arange(1000) / 100
    step = size * 2 * np.pi / 4096
    periodic = step * np.rint(20 * np.sin(phase) + 7.3 * np.sin(2 * phase))
    drifting = step * np.rint(20 * np.sin(phase) + 0.371234 * np.arange(1000))
    exact = size * np.sin(phase)
    part: Any = SimpleNamespace(theta=np.stack([periodic, exact]))
    found = repeated_variances([part])
    assert found[0] == pytest.approx(9 * step**2 / 12, rel=1e-6, abs=0)
    assert found[1] == 0
    alone = repeated_variances([SimpleNamespace(theta=drifting[None])])  # type: ignore[list-item]
    assert alone[0] < 0.5 * found[0]


def test_rounding_that_periods_share_is_that_around_any_angle_and_of_a_slow_motion() -> None:
    """An offset and a velocity of whole steps change nothing; 1400 samples in a period nor."""
    k, step = np.arange(14_000), 2.0**-12
    slow = np.rint(100 * np.sin(2 * np.pi * k / 1400)) * step
    for drift in (0.0, 1.0, -3.0):
        part: Any = SimpleNamespace(theta=slow[None] + step * (5000 + drift * k))
        assert repeated_variances([part]) == pytest.approx([9 * step**2 / 12], rel=1e-6, abs=0)


def test_rounding_of_a_fast_motion_is_white_and_that_of_a_slow_one_is_not() -> None:
    T, N, step = 1e-3, 4000, 1e-3
    t, f = T * np.arange(N), np.arange(2.0, 40.0, 1 / (N * T))
    rng = np.random.default_rng(9)
    fast = sum(np.sin(2 * np.pi * (h * t + rng.random())) for h in range(5, 35))
    np.testing.assert_allclose(_rounding(step * np.rint(fast / step), f, T), step**2 / 12)
    long, low = T * np.arange(4 * N), np.arange(0.5, 2.0, 0.25 / (N * T))
    slow = step * np.rint(3.2 * np.sin(2 * np.pi * 0.5 * long))
    found = _rounding(slow, low, T)
    assert found.shape == low.shape
    assert found[0] > 10 * step**2 / 12
    assert not _rounding(fast, f, T).any()
    np.testing.assert_allclose(_rounding(8 * slow, low, T), 64 * found)
    for ramp in (3.7, 12.3, 40.6):  # in steps; a mean over the band
        move = 3.2 * np.sin(2 * np.pi * 0.5 * long) + ramp * np.linspace(0, 1, long.size)
        error = np.abs(np.fft.rfft(np.rint(move) - move)) ** 2 * step**2 / long.size
        error = error[round(low[0] * 4 * N * T) :][: low.size]
        assert 1 / 8 < _rounding(step * np.rint(move), low, T).mean() / error.mean() < 8


@pytest.mark.parametrize(("power", "seen"), [(5.9, False), (6.1, True)])
def test_harmonics_of_six_times_their_noise_are_seen(power: float, seen: bool) -> None:
    """The fundamental always is."""
    covariance = np.zeros((1, 3, 2, 2), complex)
    covariance[..., 0, 0] = 4e-6
    z = np.full((1, 3, 2), np.sqrt(power * 4e-6) * 1j)
    z[:, 0] = 0.0
    phasors: Any = SimpleNamespace(n=1, harmonic_covariance=covariance, harmonics=z)
    variance, found = seen_angles(phasors)
    np.testing.assert_allclose(variance, 4e-6)
    assert found[0, :, 0].tolist() == [True, seen, seen]


def test_polynomials_of_a_joint_do_not_depend_on_the_other_joints() -> None:
    slow = [np.array([[3, 40], [70, 95]]), np.array([[10, 35]]), np.array([[0, 25], [50, 75]])]
    inside = np.ones(30)
    inside[:2] = 0.0
    together = list(_polynomials(slow, 120, inside, 20))
    for j, own in enumerate(slow):
        for found, alone in zip(together, _polynomials([own], 120, inside, 20), strict=True):
            assert found[j].shape[1] > 0 or not alone[0].shape[1]
            np.testing.assert_allclose(found[j], alone[0], atol=1e-12)
            assert not found[j][:2].any()


@pytest.mark.parametrize(("joints", "highest_hz", "count"), [(2, 200.0, 4), (3, 200.0, 8), (3, 60.0, 4)])
def test_segments_of_more_than_two_joints_are_shorter_in_wide_bands(
    joints: int, highest_hz: float, count: int
) -> None:
    """2.5 s, or as many as hold 1600 equations: in ten seconds up to 200 Hz, eight of three joints."""
    rng, time = np.random.default_rng(3), np.arange(10_000) / 1000
    lines = np.zeros((5001, joints), complex)
    inside = slice(100, int(10 * highest_hz))
    lines[inside] = complex_noise(rng, inside.stop - 100, joints) / np.arange(100, inside.stop)[:, None]
    theta = 1e4 * np.fft.irfft(lines, axis=0)
    tau = np.gradient(np.gradient(theta, time, axis=0), time, axis=0)
    record = MotionRecord(time, theta, tau, torque_hold=False, band_hz=(10.0, highest_hz))
    phasors = motion_phasors([record], np.ones((1, joints)))
    assert len([each for each in phasors.segments if each is not None]) == count


@pytest.mark.parametrize(
    ("shape", "most"),
    [
        (lambda x: np.exp(-(x**2)), 0.011),
        (lambda x: np.exp(-x), 0.001),
        (lambda x: 1 / (1 + x**2), 0.004),
        (np.tanh, 0.003),
    ],
)
def test_the_friction_curve_has_the_shape_of_any_stribeck_curve(
    shape: Callable[[Floats], Floats], most: float
) -> None:
    """Root mean square over a sine, and over the widths of the curve; beside Coulomb and viscous."""
    speed = np.sin(np.linspace(0, np.pi / 2, 2001))
    parts = [np.ones(speed.size), speed, *(np.exp(-speed / width) for width in _WIDTHS)]
    Q, _ = np.linalg.qr(np.stack(parts, axis=1))
    curves = np.stack([shape(speed / width) for width in np.geomspace(0.01, 0.5, 14)], axis=1)
    assert np.sqrt(np.mean((curves - Q @ (Q.T @ curves)) ** 2)) < most


def test_the_noise_of_logged_torques_is_bounded_by_the_quietest_part_of_their_spectrum() -> None:
    rng = np.random.default_rng(3)
    slow = 50 * np.sin(0.02 * np.arange(8000)) + np.cumsum(rng.standard_normal(8000))
    found = logged_noise(np.stack([slow, 0 * slow]) + [[2.0], [0.1]] * rng.standard_normal((2, 8000)))
    np.testing.assert_allclose(found, [4.5, 0.0105], rtol=0.15)  # with the quietest part of the walk


@pytest.mark.parametrize("samples", [50, 100, 400, 3000])
def test_the_noise_of_a_short_log_is_hardly_taken_too_small(samples: int) -> None:
    """Few lines per band made it up to five times too small."""
    noise = 0.3 * np.random.default_rng(samples).standard_normal((300, samples))
    found = logged_noise(noise) / 0.09
    assert 1.0 < found.mean() < 2.5
    assert np.mean(found < 1 / 3) < 0.01


@pytest.mark.parametrize("order", [1, -1])
def test_the_noise_of_a_log_is_that_of_its_noisiest_part(order: int) -> None:
    """The last part of a record replaced the others: ratios of 97 and 0.97 by their order."""
    rng = np.random.default_rng(0)
    parts = [size * rng.standard_normal((1, 2000)) for size in (1.0, 0.1)][::order]
    segments = [SimpleNamespace(torque=t, record=0, torque_variance=np.ones(1)) for t in parts]
    found = times_logged_noise(SimpleNamespace(segments=(*segments, None)))  # type: ignore[arg-type]
    assert found == pytest.approx(1.0, abs=0.2)


def test_the_longest_stretches_have_free_friction_up_to_a_share_of_the_equations() -> None:
    """Shorter ones have bounded friction; those of few periods of the band count as short rests."""
    H, N = 40, 400
    slow = [np.array([[10, 30], [100, 130], [200, 225]]), np.array([[50, 70]])]
    count = np.ceil(2 * np.diff(slow[0])[:, 0] / N * H + 0.5).astype(int)  # values of the band

    def free(most: int) -> list[int]:
        return [each.shape[1] for each in next(_polynomials(slow, N, np.ones(H, bool), most))]

    assert min(count) > 2  # rests, which are free anyway
    assert free(0) == [count.sum(), count[0]]
    short = [np.array([[10, 12], [100, 107], [200, 205]]), np.array([[50, 52]])]
    values = [int(np.ceil(2 * length / N * H + 0.5)) for length in (7, 5, 2)]
    for most in range(sum(values) + 2):
        first, second = (each.shape[1] for each in next(_polynomials(short, N, np.ones(H, bool), most)))
        kept = sum(
            c for c, whole in zip(values, np.cumsum(values), strict=True) if whole <= most or c > 2
        )
        assert first == kept
        assert second == (values[2] if values[2] <= most else 0)


def test_unknown_torques_of_short_rests_are_those_of_few_periods() -> None:
    """Two periods of the highest bin are short, and eight are not."""
    N, v = 600, np.ones((1, 600))
    v[0, 250:] = -1.0
    v[0, 100:121] = v[0, 400:481] = 0.0
    segment = segment_of(v, v, 1e-3, velocity_noise=np.array([0.02]), velocity_blur_s=np.ones(1))
    *_, unknown, _ = segment_friction(segment, 0.0, np.zeros((1, 0)))
    periods = 22 / N * segment.highest
    turn = 1 / N * segment.highest  # between two samples
    expected = sum(np.ceil(np.pi * each + 0.5) + 1 for each in (periods, turn))
    assert unknown.in_short_rests.tolist() == [expected]


def test_an_angle_without_noise_has_that_of_ten_digits_of_its_size() -> None:
    still = part_of(np.full((1, 400), 1e-3), np.zeros((1, 400)))
    found, most = sensor_variances([still], 5.0, np.array([1e-3]))
    np.testing.assert_allclose(np.sqrt([*found, *most]), [1e-13, 0.0, 0.0])
