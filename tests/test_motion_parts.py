"""Parts of the analysis of motions on their own: sampling, spectra, waveforms and terms of the ends."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import exact_phasors

from jointid import JointIdError, MotionRecord
from jointid.motion.band import proposed_band
from jointid.motion.complement import Waveforms
from jointid.motion.end_terms import EndTerms, row_groups
from jointid.motion.friction import _WIDTHS, GRID, _hats, _reversals, friction_waveforms
from jointid.motion.reversals import _stretches, _transforms
from jointid.motion.sampling import UniformPart, uniform_parts, windowed_spectrum
from jointid.motion.spectral_lines import SpectralLines, _continued, _gain
from jointid.phasors.periods import phasors_of

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


def test_reversals_of_a_period_include_that_over_its_end() -> None:
    phase = 2 * np.pi * (np.arange(GRID) + 0.5) / GRID
    assert _reversals(np.zeros(GRID), 0.1) == []
    assert _reversals(np.ones(GRID), 0.1) == []
    threshold = np.sin(10 * 2 * np.pi / GRID)  # slower in ten samples before and after each zero
    last = [GRID // 2 - 11, GRID - 11]
    assert _reversals(np.sin(phase), threshold) == [(last[0], 21, 1.0), (last[1], 21, -1.0)]


def test_hats_of_a_reversal_add_to_one() -> None:
    inside = np.zeros(GRID)
    inside[:21] = 1
    hats = _hats(20, 4, 9)
    assert hats.shape == (9, 5)
    np.testing.assert_allclose(hats.sum(axis=1), phasors_of(inside, 9), atol=1e-12)
    first = np.zeros(GRID)
    first[:5] = [1, 0.8, 0.6, 0.4, 0.2]
    np.testing.assert_allclose(hats[:, 0], phasors_of(first, 9), atol=1e-12)


def test_dependent_waveforms_of_free_size_count_once() -> None:
    rng = np.random.default_rng(7)
    one, two = complex_noise(rng, 5, 1), complex_noise(rng, 5, 1)
    free = [np.hstack([one, 1e-6 * two, one + two, 2 * two]), np.zeros((5, 0))]
    known = np.ones((5, 2), bool)
    known[0, 1] = False  # no equation
    basis = Waveforms(free, [np.zeros((5, 0))] * 2, known).basis
    assert basis.freed.tolist() == [2, 0]
    assert np.bincount(basis.joint).tolist() == [8, 8]
    rows = np.hstack([basis.torques.real, basis.torques.imag])
    np.testing.assert_allclose(rows[:8] @ rows[:8].T, np.eye(8), atol=1e-12)
    np.testing.assert_allclose(rows[8:] @ rows[8:].T, np.eye(8), atol=1e-12)
    for wave in (one, two):
        np.testing.assert_allclose(rows[:8] @ np.concatenate([wave.real, wave.imag]), 0, atol=1e-9)
    assert not rows[8:, [0, 5]].any()


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
    assert not found.spread.any()
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
    """Mean of exp(−|sin|/w) over the period in phase with the velocity, for widths over the largest."""
    phasors = exact_phasors(np.array([2.0]), np.array([[0.3 + 0j]]), np.ones((1, 1)))
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
    segment = SimpleNamespace(highest=H)
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
