"""Search for steady sine runs in one long log, with their frequencies."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from plants import PAPER, PARALLELOGRAM
from random_cases import examples, tries

from jointid import Inertia, JointIdError, analyse, extract_phasors, motor_response
from jointid.arrays import Complexes
from jointid.importing import (
    MappedLog,
    Segment,
    common_frequencies,
    find_segments,
    measure_run,
    runs_from_json,
    runs_to_json,
    segment_records,
    study_from_logs,
)
from jointid.importing.find.segments import FoundSegments
from jointid.importing.find.steady_state import Frames, settled_part
from jointid.importing.map import mapping

BOTH = np.array([1.0, 0.6 * np.exp(0.4j)])
OTHER = np.array([0.8, -0.9 * np.exp(-0.5j)])
FIRST, SECOND = np.array([1.0, 0.03j]), np.array([-0.02, 1.0])


@dataclass(frozen=True)
class Run:
    """Torques of one or more lines for some periods; what the motors do follows from the model."""

    hz: float
    periods: float
    torque: Complexes
    others: tuple[tuple[float, Complexes], ...] = ()
    rest_s: float = 0.8
    size: float = 1.0

    @property
    def seconds(self) -> float:
        return self.periods / self.hz

    @property
    def lines(self) -> tuple[tuple[float, Complexes], ...]:
        return ((self.hz, self.size * self.torque), *((f, self.size * t) for f, t in self.others))


def angles(hz: float, torque: Complexes) -> Complexes:
    """Motor angles for motor torques, equation (16)."""
    omega = 2 * np.pi * hz
    response: Complexes = motor_response([omega], PARALLELOGRAM, PAPER)[0]
    return -(response @ torque) / omega**2


def log_of(
    runs: list[Run], *, rate: float = 1000.0, noise: float = 0.0, seed: int = 0, jitter_s: float = 0.0
) -> tuple[MappedLog, list[tuple[float, float]]]:
    """A log of runs with rests between, each beginning softly, ringing down; and the runs' times."""
    rng = np.random.default_rng(seed)
    begins, clock = [], 0.5
    for run in runs:
        begins.append(clock)
        clock += run.seconds + run.rest_s
    time = np.arange(0, clock, 1 / rate)
    time = time + jitter_s * rng.uniform(-1, 1, time.size)
    theta, tau = np.empty((2, time.size, 2))
    theta[:], tau[:] = [0.4, -7.0], [0.01, -0.02]
    for run, begin in zip(runs, begins, strict=True):
        inside = (time >= begin) & (time < begin + run.seconds)
        t = time[inside] - begin
        ramp = min(1.5 / run.hz, 0.2 * run.seconds)
        envelope = np.clip(np.minimum(t, run.seconds - t) / ramp, 0, 1)
        envelope = envelope * envelope * (3 - 2 * envelope)
        settling = 1 + 0.4 * np.exp(-4 * t * run.hz / 2)
        for hz, torque in run.lines:
            wave = np.exp(2j * np.pi * hz * t)
            tau[inside] += (envelope[:, None] * np.outer(wave, torque)).imag
            moved = np.outer(wave * settling, angles(hz, torque)).imag
            theta[inside] += envelope[:, None] * moved
    scale = max(np.abs(angles(run.hz, run.size * run.torque)).max() for run in runs)
    theta += noise * scale * rng.standard_normal(theta.shape)
    tau += noise * rng.standard_normal(tau.shape)
    spans = [(b, b + run.seconds) for b, run in zip(begins, runs, strict=True)]
    return MappedLog(time, theta, tau, name="log.csv"), spans


@lru_cache(maxsize=4)
def found_in(log: MappedLog) -> FoundSegments:
    """What is found in a log, which several checks look at."""
    return find_segments(log)


def check(
    log: MappedLog, runs: list[Run], spans: list[tuple[float, float]], accuracy: float = 1e-4
) -> None:
    """Every run is found once, inside its true times, most of it, at its frequency."""
    found = found_in(log)
    said = [(round(s.start_s, 2), round(s.stop_s, 2), round(s.frequency_hz, 4)) for s in found]
    assert len(found) == len(runs), said
    for segment, run, (begin, end) in zip(found, runs, spans, strict=True):
        assert abs(segment.frequency_hz / run.hz - 1) < accuracy, said
        assert begin <= segment.start_s < segment.stop_s <= end + 1e-9, (said, begin, end)
        assert segment.stop_s - segment.start_s > 0.4 * (end - begin), (said, begin, end)


def phasors_right(log: MappedLog, runs: list[Run], accuracy: float) -> None:
    """The torque over angle of every run is the model's: nothing of rest or settling is left."""
    records = segment_records(log, found_in(log))
    phasors = extract_phasors(records)
    for q, tau, record, run in zip(phasors.q, phasors.tau, records, runs, strict=True):
        expected = angles(record.frequency_hz, tau)
        np.testing.assert_allclose(q, expected, atol=accuracy * np.abs(expected).max())
        turn = np.vdot(run.torque, tau) / np.vdot(run.torque, run.torque)
        np.testing.assert_allclose(np.abs(turn), run.size, rtol=accuracy)


LADDER = [Run(f, 16, t) for f in (3.1, 4.7, 7.3, 11.9, 19.0, 27.7) for t in (BOTH, OTHER)]


def test_a_ladder_of_runs_with_rests() -> None:
    log, spans = log_of(LADDER)
    check(log, LADDER, spans, accuracy=1e-4)
    phasors_right(log, LADDER, 0.01)


def test_with_noise() -> None:
    runs = [replace(run, size=run.hz / 3) for run in LADDER]
    log, spans = log_of(runs, rate=500.0, noise=0.01, seed=1)
    check(log, runs, spans, accuracy=5e-4)


def test_noise_of_a_third_of_the_motion() -> None:
    runs = [Run(5.0, 30, BOTH), Run(9.0, 30, BOTH)]
    log, spans = log_of(runs)
    rng = np.random.default_rng(8)
    noise = rng.standard_normal(log.theta_rad.shape) * np.abs(angles(9.0, BOTH)).max() / 3
    check(replace(log, theta_rad=log.theta_rad + noise), runs, spans, accuracy=1e-3)


def test_one_joint_at_a_time() -> None:
    runs = [Run(f, 14, t) for f in (3.0, 6.1, 12.4) for t in (FIRST, SECOND)]
    log, spans = log_of(runs, noise=1e-4, seed=2)
    check(log, runs, spans)


def test_same_frequency_with_another_pattern_and_no_rest() -> None:
    runs = [Run(5.0, 15, t, rest_s=0.0) for t in (BOTH, OTHER, BOTH)]
    log, spans = log_of(runs)
    check(log, runs, spans)
    found = found_in(log)
    assert found[0].frequency_hz == found[1].frequency_hz == found[2].frequency_hz


def test_pattern_that_jumps_in_the_middle_of_the_sine() -> None:
    """No ramp, no rest: from one sample to the next the joints move in another pattern."""
    time = np.arange(0, 8, 1e-3)
    theta, tau = np.empty((2, time.size, 2))
    for torque, part in ((BOTH, time < 4), (OTHER, time >= 4)):
        wave = np.exp(2j * np.pi * 4.0 * time[part])
        tau[part] = np.outer(wave, torque).imag
        theta[part] = np.outer(wave, angles(4.0, torque)).imag
    first, second = find_segments(MappedLog(time, theta, tau))
    assert 3.2 < first.stop_s < 4.0 <= second.start_s < 4.8
    assert abs(first.frequency_hz / 4 - 1) < 1e-4
    assert first.frequency_hz == second.frequency_hz


def test_frequencies_close_to_each_other_without_rest() -> None:
    runs = [Run(f, 20, BOTH, rest_s=0.0) for f in (5.0, 5.2, 5.5)]
    log, spans = log_of(runs)
    check(log, runs, spans)


def test_amplitudes_that_differ_a_hundredfold() -> None:
    runs = [Run(4.0, 12, BOTH, size=s) for s in (1.0, 0.01, 0.1, 1.0)]
    log, spans = log_of(runs)
    check(log, runs, spans)


def test_jittered_clock() -> None:
    runs = [Run(f, 15, BOTH) for f in (1.0, 2.3, 5.1)]
    log, spans = log_of(runs, rate=100.0, jitter_s=7e-4)
    check(log, runs, spans)


def test_a_single_run_without_rest_is_one_segment() -> None:
    time = np.arange(999) / 100
    wave = np.exp(2j * np.pi * 1.0 * time)
    log = MappedLog(time, (0.4 * wave.imag + 0.06)[:, None], (0.05 * (wave * 1j).imag)[:, None])
    (segment,) = find_segments(log)
    assert abs(segment.frequency_hz - 1) < 1e-9
    assert segment.periods > 9
    assert segment.share == pytest.approx(1)
    phasors = extract_phasors(segment_records(log, [segment]))
    np.testing.assert_allclose(np.abs(phasors.q), [[0.4]], rtol=1e-9)


def test_travel_superposed() -> None:
    """The joint moves on at a constant velocity during the sine, and by much between the runs."""
    runs = [Run(6.0, 18, BOTH), Run(9.0, 25, OTHER)]
    log, spans = log_of(runs)
    travel = 3.0 * log.time_s[:, None] + [0.0, 5.0]
    check(replace(log, theta_rad=log.theta_rad + travel), runs, spans)


def test_gap_in_the_log_splits_a_run() -> None:
    log, _ = log_of([Run(5.0, 40, BOTH)])
    kept = (log.time_s < 4.0) | (log.time_s > 4.6)
    cut = MappedLog(log.time_s[kept], log.theta_rad[kept], log.tau_Nm[kept])
    first, second = find_segments(cut)
    assert first.stop_s < 4.0
    assert second.start_s > 4.6


def test_slow_tail_under_the_noise_is_discarded() -> None:
    """Noise hides it in each period; the first quarter against the second half shows it."""
    rng = np.random.default_rng(10)
    time = np.arange(0, 12, 1e-3)
    wave = np.exp(2j * np.pi * 5.0 * time)
    noise = 0.1 * rng.standard_normal((2, time.size))
    theta = (wave * (1 + 0.05 * np.exp(-time / 1.5))).imag + noise[0]
    log = MappedLog(time, theta[:, None], (2j * wave).imag[:, None] + noise[1][:, None])
    (segment,) = find_segments(log)
    assert segment.start_s > 0.6
    assert segment.stop_s > 11.0
    phasors = extract_phasors(segment_records(log, [segment]))
    assert abs(phasors.q[0, 0]) == pytest.approx(1.0, rel=4.5e-3)


@pytest.mark.parametrize("tail", [0.0, 0.03])
def test_first_quarter_must_agree_with_the_second_half(tail: float) -> None:
    """A tail of three standard deviations of a frame: no frame alone shows it."""
    rng = np.random.default_rng(11)
    k = np.arange(80)
    noise = 0.01 * (rng.standard_normal(k.size) + 1j * rng.standard_normal(k.size)) / np.sqrt(2)
    z = 1 + tail * np.exp(-k / 12) + noise
    frames = Frames(10 * k, 10, np.column_stack([z, z]))
    first, last = settled_part(frames, is_end=True)
    assert last == 800
    assert (first > 30) == (tail > 0)


def test_a_joint_that_creeps_at_rest_hides_no_sine_of_another() -> None:
    """Friction releases its spring slowly: its frames change, though by 2 % of the other motion."""
    log, _ = log_of([Run(6.8, 16, SECOND), Run(1.7, 30, SECOND)])
    creep = 0.02 * np.abs(log.theta_rad[:, 1] + 7).max() * np.exp(-(log.time_s - 0.5) / 3)
    quiet = np.column_stack([0.4 + creep, log.theta_rad[:, 1]])
    torque = np.column_stack([0.1 * creep, log.tau_Nm[:, 1]])
    found = find_segments(replace(log, theta_rad=np.round(quiet, 7), tau_Nm=torque))
    assert [round(s.frequency_hz, 3) for s in found] == [6.8, 1.7]
    assert [s.periods > share * n for s, share, n in zip(found, (0.7, 0.7), (16, 30), strict=True)]


def test_beginning_of_a_soft_end_is_left_out() -> None:
    """The ramp down begins inside a period that still looks steady within a hundredth."""
    time = np.arange(0, 8, 1e-3)
    wave = np.exp(2j * np.pi * 4.0 * time) * np.clip((6.2 - time) / 6.0 + 0.97, 0, 1)
    fades = np.where(time < 6.05, wave, 0.9 * wave * np.clip(7 - time, 0, 1))
    log = MappedLog(time, fades.imag[:, None], (1j * fades).imag[:, None])
    (segment,) = find_segments(log)
    assert segment.stop_s < 6.02


def test_long_break_in_the_clock() -> None:
    """The logger was stopped for ten minutes: runs before and after are found."""
    runs = [Run(5.0, 20, BOTH), Run(8.0, 20, OTHER)]
    log, spans = log_of(runs)
    later = log.time_s >= spans[1][0] - 0.2
    broken = replace(log, time_s=log.time_s + 600.0 * later)
    check(broken, runs, [spans[0], (spans[1][0] + 600, spans[1][1] + 600)])


def test_flicker_of_the_last_digit_is_not_found_as_a_sine() -> None:
    """A resting joint whose encoder flickers in step, while the torque is noise alone."""
    rng = np.random.default_rng(9)
    time = np.arange(4000) * 1e-3
    theta = np.zeros((time.size, 1))
    theta[2000:2150, 0] = 1e-5 * np.round(np.sin(2 * np.pi * 60.0 * time[2000:2150]))
    assert find_segments(MappedLog(time, theta, rng.standard_normal(theta.shape))) == ()
    moved = np.sin(2 * np.pi * 60.0 * time)[:, None]
    assert (
        len(find_segments(MappedLog(time, theta, moved + 0.1 * rng.standard_normal(theta.shape)))) == 1
    )


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_multisine_gives_one_record_per_line(noise: float) -> None:
    others = tuple((f, t) for f, t in ((5.0, 2 * OTHER), (8.0, 3 * BOTH), (13.0, 6 * OTHER)))
    runs = [Run(3.0, 36, BOTH, others), Run(6.0, 20, OTHER)]
    log, spans = log_of(runs, noise=noise, seed=3)
    multi, single = find_segments(log)
    assert multi.is_multisine
    assert not single.is_multisine
    np.testing.assert_allclose(multi.lines_hz, [3, 5, 8, 13], rtol=1e-4)
    assert spans[0][0] <= multi.start_s < multi.stop_s <= spans[0][1]
    records = segment_records(log, [multi])
    assert [round(r.frequency_hz, 2) for r in records] == [3, 5, 8, 13]
    phasors = extract_phasors(records)
    for q, tau, record in zip(phasors.q, phasors.tau, records, strict=True):
        expected = angles(record.frequency_hz, tau)
        np.testing.assert_allclose(q, expected, atol=(1e-4 + 2 * noise) * np.abs(expected).max())


def test_signals_without_a_sine_give_no_segment() -> None:
    rng = np.random.default_rng(4)
    time = np.arange(8_000) * 1e-3
    still = MappedLog(time, np.zeros((time.size, 1)), np.zeros((time.size, 1)))
    assert find_segments(still) == ()
    noise = MappedLog(time, rng.standard_normal((time.size, 1)), rng.standard_normal((time.size, 1)))
    assert find_segments(noise) == ()
    random_walk = np.cumsum(rng.standard_normal((time.size, 1)), axis=0)
    assert find_segments(MappedLog(time, random_walk, random_walk)) == ()
    square = np.sign(np.sin(2 * np.pi * time * (1 + 0.05 * time)))[:, None]  # sweeps
    assert all(s.periods < 10 for s in find_segments(MappedLog(time, square, square)))


@examples(tries(5, long=10), derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_any_sequence_of_runs(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 4))
    runs = []
    for _ in range(count):
        hz = data.draw(st.floats(3.0, 30.0))
        pattern = data.draw(st.sampled_from([BOTH, OTHER, FIRST, SECOND]))
        periods = data.draw(st.floats(14.0, 30.0))
        rest_s = data.draw(st.floats(0.3, 2.0))
        runs.append(Run(hz, periods, pattern, rest_s=rest_s, size=data.draw(st.floats(0.3, 3.0))))
    log, spans = log_of(runs, noise=1e-5, seed=5)
    check(log, runs, spans)


@examples(40, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_any_signals_give_segments_or_none(data: st.DataObject) -> None:
    """No log causes an exception or an overflow."""
    samples = data.draw(st.integers(2, 600))
    seed = data.draw(st.integers(0, 99))
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.2, 1.0, samples) * data.draw(st.sampled_from([1e-6, 1e-3, 1.0, 1e5])))
    makers = {
        "still": lambda: np.full(samples, 3.0),
        "steps": lambda: np.round(rng.standard_normal(samples)),
        "huge": lambda: 1e80 * rng.standard_normal(samples),
        "tiny": lambda: 1e-80 * rng.standard_normal(samples),
        "spike": lambda: np.eye(1, samples, samples // 2)[0],
        "square": lambda: np.sign(np.sin(np.arange(samples) / 5)),
        "sine": lambda: 1e30 * np.sin(np.arange(samples) / 4),
        "nyquist": lambda: (-1.0) ** np.arange(samples),
        "ramp": lambda: 1e12 * np.arange(samples),
    }
    kinds = st.sampled_from(sorted(makers))
    theta, tau = (np.column_stack([makers[data.draw(kinds)]() for _ in range(2)]) for _ in range(2))
    log = MappedLog(time, theta, tau)
    found = find_segments(log)
    for segment in found:
        assert time[0] <= segment.start_s < segment.stop_s <= time[-1]
        assert np.isfinite(segment.frequency_hz)
    try:
        segment_records(log, found)
        measure_run(log, float(time[0]), float(time[-1]))
    except JointIdError:
        return


def test_user_adds_and_corrects_a_segment() -> None:
    runs = [Run(4.0, 12, BOTH)]
    log, ((begin, end),) = log_of(runs)
    (found,) = find_segments(log)
    chosen = measure_run(log, begin + 1.0, end - 0.6)
    assert abs(chosen.frequency_hz / 4 - 1) < 1e-3
    assert abs(chosen.start_s - begin - 1.0) < 2e-3
    given_ = measure_run(log, found.start_s, found.stop_s, frequency_hz=4.1)
    assert given_.frequency_hz == 4.1
    assert given_.share < found.share
    with pytest.raises(JointIdError, match="spans 0 s"):
        measure_run(log, 100.0, 101.0)
    with pytest.raises(JointIdError, match="No joint moves"):
        measure_run(log, 0.0, 0.4)
    with pytest.raises(JointIdError, match="give a later stop"):
        Segment(2.0, 1.0, 3.0)
    with pytest.raises(JointIdError, match="must be positive"):
        Segment(1.0, 2.0, -3.0)


def test_only_runs_of_nearly_equal_frequency_share_it() -> None:
    segments = [
        Segment(0, 5, 4.00001, frequency_error_hz=1e-5),
        Segment(6, 9, 3.99999, frequency_error_hz=1e-5),
        Segment(10, 15, 4.05, frequency_error_hz=1e-5),
    ]
    one, two, three = common_frequencies(segments)
    assert one.frequency_hz == two.frequency_hz == pytest.approx(4, abs=1e-8)
    assert three.frequency_hz == 4.05


def test_study_of_a_log_gives_back_the_elasticity() -> None:
    log, _ = log_of(LADDER, rate=500.0, noise=1e-5, seed=6)
    study = study_from_logs(log, find_segments(log), PARALLELOGRAM, name="Cell")
    analysis = analyse(study)
    np.testing.assert_allclose(analysis.fit.K, PAPER.K, rtol=5e-3)
    np.testing.assert_allclose(analysis.fit.D, PAPER.D, rtol=5e-2)
    assert analysis.transfer_problem == ""
    assert len(analysis.transfer_matrices[""].omega) == 6
    assert study.origin == "measured"


def test_study_of_many_logs() -> None:
    halves = [log_of(LADDER[k::2], rate=500.0, seed=k)[0] for k in (0, 1)]
    study = study_from_logs(halves, [find_segments(log) for log in halves], PARALLELOGRAM)
    assert len(study.records) == len(LADDER)
    assert len({record.frequency_hz for record in study.records}) == 6


def test_unusable_segments_are_refused() -> None:
    log, _ = log_of([Run(4.0, 12, BOTH)])
    with pytest.raises(JointIdError, match="No sine runs"):
        study_from_logs(log, [], PARALLELOGRAM)
    with pytest.raises(JointIdError, match="2 joints, the inertia 1"):
        study_from_logs(log, find_segments(log), Inertia(0.002, 0.004))
    with pytest.raises(JointIdError, match="Run 1"):
        segment_records(log, [Segment(1.0, 1.1, 4.0)])


def test_one_run_in_a_long_log() -> None:
    """A minute at 1 kHz with one run: the search takes few passes, not one per frequency."""
    log, spans = log_of([Run(7.0, 40, BOTH, rest_s=60.0)])
    check(log, [Run(7.0, 40, BOTH)], spans)


def test_a_record_with_a_transient_starts_later_in_the_study() -> None:
    """The verdict's own test decides; the rows before stay in the file, the inputs unchanged."""
    time = np.arange(0, 6.0, 1e-3)
    wave = np.cos(2 * np.pi * 5.0 * time)
    decay = np.exp(-time / 0.3) * np.sin(2 * np.pi * 3.0 * time)
    noise = 1e-5 * np.random.default_rng(5).standard_normal((time.size, 4))
    theta = np.column_stack([0.1 * wave + 0.05 * decay, 0.08 * wave])
    tau = np.column_stack([-0.4 * wave, -0.3 * wave])
    steady = MappedLog(time, theta[:, [1, 1]] + noise[:, :2], tau + noise[:, 2:], name="steady")
    settling = MappedLog(time, theta + noise[:, :2], tau + noise[:, 2:], name="settling")
    whole = [Segment(0.0, 5.9, 5.0)]
    inertia = Inertia([0.003, 0.002], [[0.004, 0.0004], [0.0004, 0.002]])
    study = study_from_logs([steady, settling], [whole, whole], inertia)
    assert study.records[0].start_s is None
    start = study.records[1].start_s
    assert start is not None
    assert 0.5 < start < 4.0
    assert study.records[1].time_s[0] == 0.0
    assert "1 record trimmed to the steady state" in study.description


# --- a list of runs


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is not JSON"),
        ("[]", '"format": 1'),
        ('{"format": 0, "runs": []}', '"format": 1'),
        ('{"format": 1, "runs": [{"start_s": 0, "stop_s": 1, "band_hz": [1, 2, 3]}]}', "expected two"),
        ('{"format": 1, "runs": [3]}', "expected an object with the keys"),
        ('{"format": 1, "runs": [{"start": 1}]}', 'unknown key "start"'),
        ('{"format": 1, "runs": [{"start_s": 1}]}', "stop_s = None; expected a number"),
        ('{"format": 1, "runs": [{"start_s": 3, "stop_s": 1, "frequency_hz": 5}]}', "Run 1 of the list"),
        ('{"format": 1, "runs": [{"start_s": 0, "stop_s": 1, "frequency_hz": -5}]}', "must be positive"),
        (
            '{"format": 1, "runs": [{"start_s": NaN, "stop_s": 1, "frequency_hz": 5}]}',
            "Run 1 of the list",
        ),
        ('{"format": 1, "runs": [{"start_s": 0, "stop_s": 1, "band_hz": [5]}]}', "expected two"),
        (
            '{"format": 1, "runs": [{"start_s": 0, "stop_s": 1, "band_hz": [1, 2], "frequency_hz": 2}]}',
            "keep one of them",
        ),
    ],
)
def test_a_faulty_list_of_runs_is_refused_with_its_place(text: str, said: str) -> None:
    time = np.arange(2000) * 1e-3
    log = MappedLog(time, np.sin(30 * time)[:, None], np.cos(30 * time)[:, None], name="log.csv")
    with pytest.raises(JointIdError, match=re.escape(said)):
        runs_from_json(text, [log])


def test_multisines_and_motions_are_kept_by_a_list_of_runs() -> None:
    time = np.arange(6000) * 1e-3
    log = MappedLog(time, np.sin(30 * time)[:, None], np.cos(30 * time)[:, None], name="log.csv")
    segments = [
        Segment(0.5, 2.0, 5.0, (4.0, 5.0)),
        Segment(2.5, 5.5, float("nan"), band_hz=(2.0, 30.0)),
    ]
    (found,) = runs_from_json(runs_to_json([log], [segments]), [log])
    assert [s.lines_hz for s in found] == [(4.0, 5.0), ()]
    assert [(s.start_s, s.stop_s, s.band_hz) for s in found] == [
        (s.start_s, s.stop_s, s.band_hz) for s in segments
    ]


def test_a_list_of_runs_names_the_log_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    time = np.arange(3000) * 1e-3
    one, two = (
        MappedLog(time, np.sin(30 * time)[:, None], np.cos(30 * time)[:, None], name=name)
        for name in ("one.csv", "two.csv")
    )
    runs = (("two.csv", 1, [5, 4]), ("two.csv", 0.5, 4), ("one.csv", 1, []))
    keys = ("log", "start_s", "frequency_hz")
    rows = [dict(zip(keys, run, strict=True)) | {"stop_s": 2.5} for run in runs]
    text = json.dumps({"format": 1, "runs": rows})
    (of_one, of_two) = runs_from_json(text, [one, two])
    assert [segment.lines_hz for segment in of_two] == [(4.0,), (4.0, 5.0)]  # in order of time
    assert [s.frequency_hz for s in of_one] == pytest.approx([30 / 2 / np.pi], rel=1e-5)  # measured
    for wrong in ('"three.csv"', "3", "null"):
        with pytest.raises(JointIdError, match=r"expected one of one\.csv, two\.csv"):
            runs_from_json(text.replace('"one.csv"', wrong), [one, two])
    with pytest.raises(JointIdError, match=r"log = None; expected one of one\.csv, two\.csv"):
        runs_from_json(text.replace('"log": "two.csv", ', ""), [one, two])
    for start in ("true", '"1"'):
        with pytest.raises(JointIdError, match=r"Run 2 of the list: start_s = .*; expected a number"):
            runs_from_json(text.replace("0.5", start), [one, two])
    again = replace(two, name="one.csv")  # from another folder
    found = runs_from_json(runs_to_json([one, again], [of_one, of_two]), [one, again])
    assert [len(runs) for runs in found] == [1, 2]
    monkeypatch.setattr(mapping, "_MAX_LENGTH", len(text) - 1)
    with pytest.raises(JointIdError, match="more than the limit"):
        runs_from_json(text, [one, two])
    monkeypatch.setattr(mapping, "_MAX_LENGTH", len(text))
    assert len(runs_from_json(text, [one, two])) == 2
