"""Unused spans of a log are reported; sweeps and coarse encoders give no sine runs."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from test_import_segments import BOTH, FIRST, SECOND, Run, angles, check, found_in, log_of

from jointid.importing import MappedLog, Segment, find_segments
from jointid.importing.find.unused_spans import without_sweeps

LADDER = [Run(f, 20, t) for f in (3.1, 5.3, 9.7) for t in (FIRST, SECOND)]


def rounded(log: MappedLog, step: float) -> MappedLog:
    return replace(log, theta_rad=step * np.round(log.theta_rad / step))


@pytest.mark.parametrize("steps", [3, pytest.param(13, marks=pytest.mark.long)])
def test_coarse_encoder(steps: int) -> None:
    """The driven joint moves by a few encoder steps: its runs are found as single sines."""
    runs = [replace(run, size=(run.hz / 3) ** 2) for run in LADDER]
    log, spans = log_of(runs, rate=1000.0, noise=0.0)
    coarse = rounded(log, float(np.abs(log.theta_rad - [0.4, -7.0]).max()) / steps / 1.4)
    check(coarse, runs, spans, accuracy=2e-3)
    assert not any(segment.is_multisine for segment in found_in(coarse))


def test_run_below_the_encoder_resolution_is_not_found() -> None:
    log, spans = log_of([Run(3.0, 20, BOTH), Run(12.0, 30, BOTH)])
    step = 4 * float(np.abs(log.theta_rad[log.time_s > spans[1][0]] - [0.4, -7.0]).max())
    found = find_segments(rounded(replace(log, theta_rad=log.theta_rad - [0.4, -7.0]), step))
    assert len(found) == 1
    (note,) = found.notes
    assert "the torque oscillates, but the position has" in note


def test_a_slow_sweep_is_found_in_noise() -> None:
    """In pieces of a second the curvature of the phase is below the noise; the neighbours show it."""
    time = np.arange(8500) / 250
    swept = np.clip(time - 2, 0, 30)
    wave = np.sin(2 * np.pi * (4 * swept + swept**2 / 60)) * ((time >= 2) & (time < 32))
    rng = np.random.default_rng(13)
    theta, tau = wave + 0.05 * rng.standard_normal(8500), 0.45 * rng.standard_normal(8500) - wave
    assert find_segments(MappedLog(time, theta[:, None], tau[:, None])) == ()


def test_the_ramp_of_a_run_is_not_a_separate_run() -> None:
    """A controller's ramp holds a few periods, of a frequency that the growth biases."""
    time = np.arange(3000) / 1000
    wave = np.clip((time - 0.5) / 0.3, 0, 1) * np.sin(2 * np.pi * 25 * time)
    log = MappedLog(time, wave[:, None], -wave[:, None])
    ramp, run = Segment(0.6, 0.8, 24.85), Segment(0.9, 2.9, 25.0)
    assert without_sweeps(log, [ramp, run])[0] == [run]
    steady = Segment(0.82, 1.02, 25.0), Segment(1.1, 2.9, 25.0)
    assert without_sweeps(log, steady)[0] == [*steady]


@pytest.mark.parametrize(
    ("growth", "way"),
    [
        ("linear", -1),
        ("logarithmic", 1),
        pytest.param("linear", 1, marks=pytest.mark.long),
        pytest.param("logarithmic", -1, marks=pytest.mark.long),
    ],
)
def test_sweep_gives_no_runs_but_a_note(growth: str, way: int) -> None:
    time = np.arange(0, 40, 2e-3)
    hz = 2 + 20 * time / 40 if growth == "linear" else 2 * 11 ** (time / 40)
    phase = 2 * np.pi * np.cumsum(hz[::way]) * 2e-3
    wave = np.exp(1j * phase)
    log = MappedLog(time, (wave / hz[::way]).imag[:, None], (wave * 1j).imag[:, None])
    found = find_segments(log)
    assert found == ()
    assert "a sweep from" in found.notes[0]
    assert "sweep" in found.notes[0]


@pytest.mark.parametrize("seed", [1, 2])
def test_a_fast_sweep_is_found_in_noise(seed: int) -> None:
    """The curvature of the phase of a short piece is below the noise; the neighbours show the drift."""
    rng, time = np.random.default_rng(seed), np.arange(0, 40, 4e-3)
    wave = np.exp(2j * np.pi * np.cumsum(2 + 20 * time / 40) * 4e-3)
    theta = (wave / (2 + 20 * time / 40)).imag + 0.01 * rng.standard_normal(time.size)
    tau = wave.real + 0.2 * rng.standard_normal(time.size)
    assert find_segments(MappedLog(time, theta[:, None], tau[:, None])) == ()


def noisy(hz: np.ndarray, level: float, seed: int) -> MappedLog:
    """A wave of these frequencies at 250 Hz, with the noise of a reference; 0 is a rest."""
    noise = np.random.default_rng(seed).standard_normal(hz.size)
    noise = level * np.convolve(noise, np.full(12, 12**-0.5), mode="same")
    wave = np.exp(2j * np.pi * np.cumsum(hz) / 250) * (hz > 0)
    parts = ((part + noise)[:, None] for part in (wave.imag, wave.real))
    return MappedLog(np.arange(hz.size) / 250, *parts)


@pytest.mark.parametrize("seed", [0, 4, 6])
def test_a_sweep_is_found_from_its_noisy_pieces_together(seed: int) -> None:
    """The frequencies of the neighbours give the curvature of the phase of a piece."""
    log = noisy(2 + 0.25 * np.arange(10_000) / 250, 0.2, seed)
    begins = np.arange(3.0, 38, 3.5)
    pieces = [Segment(t, t + 6 / f, f) for t, f in zip(begins, 2.25 + 0.25 * begins, strict=True)]
    assert without_sweeps(log, pieces)[0] == []


@pytest.mark.parametrize("seed", [4, 7, 15])
def test_a_piece_beside_that_of_a_sweep_needs_less_evidence(seed: int) -> None:
    """In a sweep up and down within 4 s, noise hides the drift in some of the pieces."""
    up = np.linspace(1, 25, 450)
    log = noisy(np.concatenate([np.zeros(200), up, up[::-1], np.zeros(200)]), 0.05, seed)
    assert find_segments(log) == ()


@pytest.mark.parametrize("rest", [0, 200])
@pytest.mark.parametrize("seed", [17, 31, 50])
def test_steady_sines_with_noise_are_not_reported_as_a_sweep(seed: int, rest: int) -> None:
    steps = (3.0, 4.2, 2.5, 6.0, 3.6, 5.0)
    hz = np.concatenate([np.repeat([f, 0.0], [1000 - rest, rest]) for f in steps])
    runs = [Segment(4 * k + 0.3, 4 * k + 0.3 + 6 / f, f) for k, f in enumerate(steps)]
    assert without_sweeps(noisy(hz, 0.06, seed), runs)[0] == runs


def test_missing_samples_are_no_drift_of_the_frequency() -> None:
    """Each lost sample would shift the phase by its share of the period if the rest were numbered."""
    runs = [Run(f, 4 * f, BOTH) for f in (16.0, 18.0, 20.0, 22.0)]
    log, _ = log_of(runs)
    kept = np.ones(log.time_s.size, bool)
    kept[[900, 1100, 3100, 3300, 5400, 7600, 7700, 7800]] = False
    rows = (getattr(log, name)[kept] for name in ("time_s", "theta_rad", "tau_Nm"))
    found = find_segments(MappedLog(*rows))
    assert [round(segment.frequency_hz, 2) for segment in found] == [16.0, 18.0, 20.0, 22.0]


def test_sines_beside_a_sweep_are_kept() -> None:
    log, spans = log_of([Run(5.0, 20, BOTH, rest_s=15.0), Run(8.0, 30, BOTH)])
    t = log.time_s - spans[0][1] - 1.0
    inside = (t > 0) & (t < 13)
    sweep = np.where(inside, np.sin(2 * np.pi * (2 * t + 0.6 * t * t)), 0.0)
    size = np.abs(log.theta_rad - [0.4, -7.0]).max()
    mixed = replace(
        log, theta_rad=log.theta_rad + size * sweep[:, None], tau_Nm=log.tau_Nm + sweep[:, None]
    )
    found = find_segments(mixed)
    assert [round(segment.frequency_hz, 3) for segment in found] == [5.0, 8.0]
    assert "sweep" in found.notes[0]


@pytest.mark.parametrize(
    ("seconds", "noise", "growth"),
    [
        (4, 0.0, "linear"),
        (4, 0.05, "linear"),
        (40, 0.0, "linear"),
        (40, 0.05, "linear"),
        (4, 0.0, "exponential"),
        (40, 0.05, "exponential"),
        pytest.param(120, 0.0, "linear", marks=pytest.mark.long),
    ],
)
def test_no_piece_of_a_sweep_is_a_sine(seconds: float, noise: float, growth: str) -> None:
    """There are gaps between some pieces, and noise hides the drift of others."""
    rng = np.random.default_rng(1)
    time = np.arange(0, seconds + 2, 2e-3)
    place = np.clip((time - 1) / seconds, 0, 1)
    hz = 1 + 19 * place if growth == "linear" else 20**place
    wave = np.exp(2j * np.pi * np.cumsum(hz) * 2e-3) * ((time > 1) & (time < seconds + 1))
    moved = np.outer(wave / hz**2, [1.0, 0.6j]).imag
    moved += noise * moved.std() * rng.standard_normal(moved.shape)
    torque = np.outer(-wave, [1.0, 0.6j]).imag + noise * rng.standard_normal(moved.shape)
    assert find_segments(MappedLog(time, moved, torque)) == ()


@pytest.mark.parametrize(
    ("hz", "swing", "period_s"), [(8.0, 2.0, 6.0), (12.0, 3.0, 4.0), (10.0, 0.5, 4.0)]
)
def test_a_sweep_is_not_steady_at_its_turning_points(hz: float, swing: float, period_s: float) -> None:
    """At its turning points the frequency is constant for some periods: the phase is symmetric."""
    time = np.arange(3000) / 250
    phase = 2 * np.pi * np.cumsum(hz + swing * np.sin(2 * np.pi * time / period_s)) / 250
    moved = np.column_stack([0.05 * np.sin(phase), -np.sin(phase - 0.05)])
    moved += [1e-6, 1e-3] * np.random.default_rng(1).standard_normal(moved.shape)
    assert find_segments(MappedLog(time, moved[:, :1], moved[:, 1:])) == ()


@pytest.mark.parametrize("step", [0.01, 0.04])
def test_frequencies_that_change_without_a_pause_are_runs_of_their_own(step: float) -> None:
    """The phase goes on, and no ramp shows where one sine becomes the next."""
    stairs = 5 * (1 + step) ** np.arange(5)
    hz = np.concatenate([np.full(int(40 / f * 500), f) for f in stairs])
    phase = 2 * np.pi * np.cumsum(hz) / 500
    log = MappedLog(np.arange(hz.size) / 500, np.sin(phase)[:, None], np.cos(phase)[:, None])
    np.testing.assert_allclose([s.frequency_hz for s in find_segments(log)], stairs, rtol=1e-4)


def test_stepped_sines_are_not_reported_as_a_sweep() -> None:
    runs = [Run(f, 20, BOTH, rest_s=0.0) for f in (5.0, 5.05, 5.3, 5.6, 6.0, 6.4)]
    log, spans = log_of(runs)
    check(log, runs, spans)
    assert found_in(log).notes == ()


def test_consecutive_sines_without_a_ramp_are_separated() -> None:
    """Steps of 0.5 % in frequency alone: amplitude and phase continue, so that no frame shows them."""
    steps_hz, rate = 6.0 * 1.005 ** np.arange(3), 500.0
    edges = np.cumsum([0.0, *(30 / steps_hz)])
    time = np.arange(0, edges[-1], 1 / rate)
    step = np.searchsorted(edges[1:-1], time, side="right")
    wave = np.exp(2j * np.pi * np.cumsum(steps_hz[step]) / rate)[:, None]
    response = np.array([angles(hz, BOTH) for hz in steps_hz])
    found = find_segments(MappedLog(time, (wave * response[step]).imag, (wave * BOTH).imag))
    assert [segment.frequency_hz for segment in found] == pytest.approx(steps_hz, rel=5e-5)
    for segment, begin, end in zip(found, edges[:-1], edges[1:], strict=True):
        assert begin - 0.1 < segment.start_s < segment.stop_s < end + 0.1


def test_runs_that_are_too_short_are_reported() -> None:
    log, _ = log_of([Run(5.0, 20, BOTH), Run(2.0, 3, BOTH, size=0.2), Run(7.0, 20, BOTH)])
    found = find_segments(log)
    assert len(found) == 2
    (note,) = found.notes
    assert "without a steady sine" in note
    assert "mark it" in note


def test_rests_and_noise_give_no_note() -> None:
    log, _ = log_of(LADDER, rate=500.0, noise=1e-3, seed=1)
    assert find_segments(log).notes == ()


def test_notes_are_kept_with_the_segments() -> None:
    time = np.arange(0, 40, 2e-3)
    wave = np.sin(2 * np.pi * (2 * time + 0.25 * time**2))[:, None]
    found = find_segments(MappedLog(time, wave, wave))
    assert found.notes
    assert pickle.loads(pickle.dumps(found)).notes == copy.copy(found).notes == found.notes


def test_a_multisine_of_a_strong_and_a_weak_line_is_no_single_sine() -> None:
    """A beat of 6 % changes the phasors by less than a pattern does; beside it there are no sines."""
    weak = Run(8.0, 160, BOTH, others=((8.9, 0.06 * BOTH),))
    runs = [Run(5.0, 30, FIRST), weak, Run(11.0, 40, SECOND)]
    log, _ = log_of(runs, noise=1e-3, seed=5)
    np.testing.assert_allclose(
        [line for segment in find_segments(log) for line in segment.lines_hz],
        [5.0, 8.0, 8.9, 11.0],
        rtol=1e-3,
    )
