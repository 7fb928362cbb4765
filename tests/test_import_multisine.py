"""Multisines in a log: one phasor per line, whatever the amplitudes, and no spurious line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants import PAPER, PARALLELOGRAM
from test_import_segments import BOTH, OTHER, Run, angles, log_of

from jointid import JointIdError, analyse, extract_phasors
from jointid.arrays import Complexes
from jointid.importing import (
    MappedLog,
    find_segments,
    measure_run,
    segment_records,
    study_from_logs,
)
from jointid.importing.find.segment import significant_lines


def several(lines: list[float], seconds: float, seed: int, rest_s: float = 0.5) -> Run:
    """A multisine of torques of like size, in random phases, both joints at once."""
    rng = np.random.default_rng(seed)

    def torque() -> Complexes:
        return np.array([1.0, 0.4]) * np.exp(2j * np.pi * rng.random(2))

    first, *others = lines
    return Run(first, seconds * first, torque(), tuple((f, torque()) for f in others), rest_s)


def all_lines(
    log: MappedLog, runs: list[Run], spans: list[tuple[float, float]], accuracy: float
) -> None:
    """Every run is one segment with all its lines, and torque over angle of each is the model's."""
    found = find_segments(log)
    assert len(found) == len(runs), found
    for segment, run, (begin, end) in zip(found, runs, spans, strict=True):
        np.testing.assert_allclose(segment.lines_hz, sorted(f for f, _ in run.lines), rtol=1e-4)
        assert begin <= segment.start_s < segment.stop_s <= end + 1e-9
        assert segment.stop_s - segment.start_s > 0.5 * (end - begin)
    phasors = extract_phasors(segment_records(log, found))
    for q, tau, omega in zip(phasors.q, phasors.tau, phasors.omega, strict=True):
        expected = angles(omega / (2 * np.pi), tau)
        np.testing.assert_allclose(q, expected, atol=accuracy * np.abs(expected).max())


@pytest.mark.parametrize(
    "lines",
    [
        [5.0, 11.0],
        [4.0, 6.0, 9.0],
        [3.0, 5.0, 8.0, 12.0, 18.0],
        pytest.param(
            [2.0, 3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0, 17.0, 19.0, 21.0, 23.0], marks=pytest.mark.long
        ),
        [3.3, 4.73, 7.1, 10.9, 16.57, 24.1],
    ],
)
def test_lines_over_a_decade_with_short_rests(lines: list[float]) -> None:
    """The position falls with the square of the frequency: a hundredth at the upper end."""
    runs = [several(lines, 14.0, seed) for seed in (1, 2)]
    log, spans = log_of(runs, rate=500.0)
    all_lines(log, runs, spans, 2e-3)


def test_harmonic_grid_with_its_fundamental() -> None:
    runs = [several([3.0, 6.0, 9.0, 15.0], 12.0, seed) for seed in (3, 4)]
    log, spans = log_of(runs, rate=500.0)
    all_lines(log, runs, spans, 2e-3)


@pytest.mark.parametrize("seed", [1, 2])
def test_odd_lines_of_equal_acceleration(seed: int) -> None:
    """Towards the resonances the torque falls to a tenth: no line is a harmonic of the first."""
    rng = np.random.default_rng(seed)
    lines = [1.0 * k for k in range(1, 30, 2)]

    def torque(hz: float) -> Complexes:
        angle = -np.array([1.0, 2.0]) * np.exp(2j * np.pi * rng.random(2)) / hz**2
        unit = np.column_stack([angles(hz, column) for column in np.eye(2)])
        return np.asarray(np.linalg.solve(unit, angle))

    first, *others = [(hz, torque(hz)) for hz in lines]
    run = Run(1.0, 20.0, first[1], tuple(others))
    log, spans = log_of([run], rate=500.0)
    all_lines(log, [run], spans, 2e-3)


def test_two_patterns_back_to_back() -> None:
    runs = [several([4.0, 5.0, 6.0, 7.0, 9.0], 14.0, seed, rest_s=0.0) for seed in (5, 6)]
    log, spans = log_of(runs, noise=1e-4, seed=1)
    all_lines(log, runs, spans, 1e-2)


def test_elasticity_of_a_noisy_multisine() -> None:
    lines = [3.0, 4.5, 7.0, 10.0, 13.0, 16.5, 19.0, 23.0]
    runs = [several(lines, 20.0, seed) for seed in (7, 8)]
    log, _ = log_of(runs, rate=500.0, noise=1e-4, seed=2)
    study = study_from_logs(log, find_segments(log), PARALLELOGRAM)
    assert len(study.records) == 16
    np.testing.assert_allclose(analyse(study).fit.K, PAPER.K, rtol=0.01)


def test_two_joints_at_two_frequencies() -> None:
    run = Run(5.0, 60, np.array([1.0, 0]), ((8.2, np.array([0, 0.6])),))
    log, _ = log_of([run])
    (segment,) = find_segments(log)
    np.testing.assert_allclose(segment.lines_hz, [5.0, 8.2], rtol=1e-5)


def sine(hz: float, harmonics: dict[int, tuple[float, float]], seed: int = 0) -> MappedLog:
    """One joint at one sine; harmonics as shares of the position and of the torque."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, 10, 1e-3)
    theta, tau = np.sin(2 * np.pi * hz * time), np.sin(2 * np.pi * hz * time + 3)
    for order, (position, torque) in harmonics.items():
        theta += position * np.sin(2 * np.pi * order * hz * time + 0.4)
        tau += torque * np.sin(2 * np.pi * order * hz * time + 1.1)
    theta += 1e-4 * rng.standard_normal(time.size)
    tau += 1e-4 * rng.standard_normal(time.size)
    return MappedLog(time, theta[:, None], tau[:, None])


@pytest.mark.parametrize(
    "harmonics",
    [
        {3: (0.003, 0.3), 5: (0.001, 0.18), 7: (0.0, 0.12)},  # friction under a stiff controller
        {3: (0.03, 0.02), 5: (0.02, 0.01)},  # friction under a soft one
        {3: (0.032, 0.81), 5: (0.0086, 0.37), 7: (0.003, 0.17)},  # heavy, near the locked resonance
        {5: (0.01, 0.0), 7: (0.005, 0.0)},  # rounding of the position
        {2: (0.02, 0.05)},
    ],
)
def test_harmonics_of_one_sine_are_not_found_as_lines(harmonics: dict[int, tuple[float, float]]) -> None:
    (segment,) = find_segments(sine(6.3, harmonics))
    assert abs(segment.frequency_hz / 6.3 - 1) < 1e-5
    assert not segment.is_multisine


def test_mains_hum_is_not_found_as_a_line() -> None:
    log = sine(6.3, {})
    hum = 0.1 * np.sin(2 * np.pi * 50 * log.time_s)[:, None]
    (segment,) = find_segments(replace(log, tau_Nm=log.tau_Nm + hum))
    assert segment.lines_hz == (segment.frequency_hz,)


def test_beats_are_not_found_as_sines() -> None:
    """A multisine too short to separate its lines gives no lines rather than wrong ones."""
    time = np.arange(0, 3, 1e-3)
    theta = sum(np.sin(2 * np.pi * f * time + f * f) for f in (8.0, 8.3, 8.7, 9.0, 9.4))
    log = MappedLog(time, np.asarray(theta)[:, None], np.asarray(theta)[:, None])
    assert all(segment.periods > 15 for segment in find_segments(log))


def test_marked_by_hand() -> None:
    """The line that a user states, or all that are found."""
    run = several([5.0, 11.0, 14.0], 8.0, 9)
    log, ((begin, end),) = log_of([run])
    found = measure_run(log, begin + 1, end - 1)
    np.testing.assert_allclose(found.lines_hz, [5.0, 11.0, 14.0], rtol=1e-3)
    assert measure_run(log, begin + 1, end - 1, 11.0).lines_hz == (11.0,)
    with pytest.raises(JointIdError, match="positive"):
        measure_run(log, begin + 1, end - 1, -11.0)


def test_weak_lines_count_by_their_torque() -> None:
    time = np.arange(0, 10, 1e-3)
    hz = np.array([2.0, 7.3, 23.0])
    waves = np.sin(2 * np.pi * np.outer(time, hz))
    theta, tau = waves @ (1 / hz**2), waves @ [1.0, 1.0, 1.0]
    assert significant_lines(time, theta[:, None], tau[:, None], hz) == hz.tolist()


def test_rests_of_both_patterns_and_a_single_sine_between() -> None:
    runs = [several([3.0, 7.0, 11.0], 8.0, 10), Run(6.0, 25, OTHER, rest_s=0.5), Run(9.0, 30, BOTH)]
    log, _ = log_of(runs)
    found = find_segments(log)
    assert [len(segment.lines_hz) for segment in found] == [3, 1, 1]
