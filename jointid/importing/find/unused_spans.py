"""Spans in which a log moves without a segment, and why: sweeps, short runs, coarse encoders."""

from collections.abc import Iterable, Sequence
from itertools import compress

import numpy as np
from scipy.signal import detrend

from jointid.arrays import Floats, true_runs
from jointid.importing.find.segment import Segment
from jointid.importing.find.steady_state import frames_of, phase_bends
from jointid.importing.map.mapped_log import MappedLog
from jointid.phasors.spectrum import evenly_sampled
from jointid.wording import listed, significant

_MIN_BEND_RAD = 0.015  # of the phase of a run, above which its frequency drifts: 0.4 % in 5 periods
_BEND_SIGMAS = 5.0  # standard errors of the bend
_EVIDENCE = 6.0  # twice the log-likelihood ratio of a sweep over steady sines
_FOUND_BEND = 0.5  # of the bend of a sweep in its pieces: the search prefers those that bend less
_RATE_ERROR = 0.3  # relative error of the bend that the neighbours predict
_MOST_OF_ONE = 9.0  # evidence of one run
_LIKELY_SIGMAS = 3.0  # the same next to a piece of a sweep, and for a lone run amid other motion
_PAST_TRANSIENT = 3.0  # periods
_MIN_POWER = 0.25  # of a run, below which a period rests
_MAX_GROWTH = 0.05  # of the amplitude of a run from its middle to its end, above which it is a ramp
_SWEEP_GAP = 1.5  # times the longer piece: longest pause within a sweep
_BLOCK_S = 0.1  # length of the blocks whose motion is compared
_MIN_MOTION = 0.05  # of the strong motion of a log (90 % quantile)
_MIN_ABOVE_REST = 3.0  # times the motion at rest (2 % quantile)
_MAX_REST = 0.2  # motion at rest over strong motion, above which all is noise
_MIN_SPAN_S = 1.0  # shorter spans are not reported
_MARGIN = 0.5  # of a run to each side, which transients take
_COARSE_STEPS = 4  # positions of an encoder that are too few for a sine

_Trend = tuple[Floats, Floats, float]
"""Bends of the phase of a run, their standard errors, rad, and the growth of its amplitude."""

_REMEDY = "or mark it by its start and stop."


def without_sweeps(
    log: MappedLog, segments: Sequence[Segment]
) -> tuple[list[Segment], list[tuple[float, float]], list[str]]:
    """Remove pieces of sweeps: return the other runs, start and stop (s) of each sweep, and notes.

    In a piece of a sweep the frequency drifts or turns back, which bends the phase; in a staircase of
    sines it is constant. Noise may hide the bend of a piece: then those of its neighbours count, too.
    Ramps beside a longer run are removed: they bias the frequency. Segments are in order of time.
    """
    trends = [_trends(log, s) for s in segments]
    edges = [s for k, s in enumerate(segments) if _is_edge(k, segments, trends[k][2])]
    pieces: list[Segment] = []
    for chain in _chains(log, segments):
        runs = [segments[k] for k in chain]
        pieces += compress(runs, _drifts(log, runs, [trends[k] for k in chain]))
    spans = _merged(pieces)
    notes = []
    for begin, end in spans:
        inside = [s for s in pieces if begin <= s.start_s < end]
        ends = _edge_hz(log, inside[0], -1), _edge_hz(log, inside[-1], 1)
        low, high = (significant(hz, 3) for hz in ends)
        what = (
            f"a sine of {low} Hz whose phase shifts"
            if low == high
            else f"a sweep from {low} to {high} Hz"
        )
        notes.append(
            f"{_times(begin, end)}: {what}, not used as a sine run. "
            "Record single frequencies or a multisine, " + _REMEDY
        )
    return [s for s in segments if s not in pieces and s not in edges], spans, notes


def _chains(log: MappedLog, segments: Sequence[Segment]) -> list[list[int]]:
    """Indices of consecutive runs without a rest between them."""
    chains: list[list[int]] = []
    for k, segment in enumerate(segments):
        if k and _moves(log, segment, segments[k - 1].stop_s, segment.start_s):
            chains[-1].append(k)
        else:
            chains.append([k])
    return chains


def _moves(log: MappedLog, run: Segment, begin: float, end: float) -> bool:
    """Whether the motion is nearly as strong in every period of a span as in a run beside it."""
    inside, span = (log.theta_rad[log.rows(*ends)] for ends in ((run.start_s, run.stop_s), (begin, end)))
    # Torques show the noise of a reference more than positions do.
    power = ((span - inside.mean(axis=0)) ** 2).sum(axis=1) / inside.var(axis=0).sum()
    width = max(1, round(1 / run.frequency_hz / log.interval_s))
    if power.size < width:
        return True
    return bool(np.convolve(power, np.full(width, 1 / width), mode="valid").min() > _MIN_POWER)


def _drifts(log: MappedLog, runs: Sequence[Segment], trends: Sequence[_Trend]) -> np.ndarray:
    """Whether the frequency drifts in each run of a chain.

    In a sweep the frequencies of the runs before and after predict how far the phase of a run bends; in
    a staircase it does not bend. The likelihood ratio of the two is that of all runs of the chain.
    """
    bend, error = np.array([trend[:2] for trend in trends]).transpose(1, 0, 2)
    sure, likely = (
        np.any(np.abs(bend) > np.maximum(_MIN_BEND_RAD, sigmas * error), axis=1)
        for sigmas in (_BEND_SIGMAS, _LIKELY_SIGMAS)
    )
    if sure.any() or (len(runs) == 1 and _amid_motion(log, runs[0])):
        sure = likely
    if len(runs) == 1:
        return np.asarray(sure)
    bend, error = bend[:, 0], error[:, 0]
    middle = np.array([(s.start_s + s.stop_s) / 2 for s in runs])
    hz = np.array([s.frequency_hz for s in runs])
    length = np.array([s.stop_s - s.start_s for s in runs]) - 1 / hz
    predicted = _FOUND_BEND * np.pi / 4 * np.gradient(hz, middle) * length**2
    variance = error**2 + (_RATE_ERROR * predicted) ** 2 + _MIN_BEND_RAD**2
    evidence = np.clip(predicted * (2 * bend - predicted) / variance, -_MOST_OF_ONE, _MOST_OF_ONE)
    return np.asarray(sure | ((evidence.sum() > _EVIDENCE) & (evidence > -_MOST_OF_ONE)))


def _amid_motion(log: MappedLog, run: Segment) -> bool:
    """Whether the motion is as strong some periods before and after a run, past all transients."""
    near, far = _PAST_TRANSIENT / run.frequency_hz, (_PAST_TRANSIENT + 1) / run.frequency_hz
    first, last = float(log.time_s[0]), float(log.time_s[-1])
    spans = (run.start_s - far, run.start_s - near), (run.stop_s + near, run.stop_s + far)
    return all(first <= a and b <= last and _moves(log, run, a, b) for a, b in spans)


def _edge_hz(log: MappedLog, piece: Segment, side: int) -> float:
    """Frequency at the begin (-1) or end (1) of a piece of a sweep."""
    duration = piece.stop_s - piece.start_s
    return piece.frequency_hz + side * 2 / np.pi * float(_trends(log, piece)[0][0]) / duration


def _is_edge(number: int, segments: Sequence[Segment], growth: float) -> bool:
    """Whether a run is the ramp of the longer one before or after it: its amplitude grows or decays."""
    own, beside = segments[number], [*segments[max(number - 1, 0) : number], *segments[number + 1 :][:1]]
    length = own.stop_s - own.start_s
    return abs(growth) > _MAX_GROWTH and any(
        other.stop_s - other.start_s > length
        and max(other.start_s - own.stop_s, own.start_s - other.stop_s) < length
        for other in beside
    )


def _trends(log: MappedLog, segment: Segment) -> _Trend:
    part = log.rows(segment.start_s, segment.stop_s)
    time, signals = evenly_sampled(
        log.time_s[part], np.column_stack([log.theta_rad[part], log.tau_Nm[part]])
    )
    lines = float(time[1] - time[0]) * np.array(segment.lines_hz)
    return phase_bends(frames_of(signals, lines, hop_periods=0.5).z)


def _merged(pieces: Iterable[Segment]) -> list[tuple[float, float]]:
    """Merge pieces of one sweep, between which others were missed."""
    merged: list[tuple[float, float]] = []
    for piece in pieces:
        begin, longer = piece.start_s, piece.stop_s - piece.start_s
        if merged:
            longer = max(longer, merged[-1][1] - merged[-1][0])
            if begin - merged[-1][1] < _SWEEP_GAP * longer:
                begin = merged.pop()[0]
        merged.append((begin, piece.stop_s))
    return merged


def unused_spans(
    log: MappedLog, segments: Sequence[Segment], sweeps: Sequence[tuple[float, float]]
) -> list[str]:
    """Describe the spans that move without a segment: why, and what to do; sweeps have a note."""
    covered = [*((s.start_s, s.stop_s) for s in segments), *sweeps]
    reasons: dict[str, list[tuple[float, float]]] = {}
    for begin, end in moving_spans(log):
        for first, last in _uncovered(begin, end, covered):
            if last - first >= _MIN_SPAN_S:
                reasons.setdefault(_reason(log, first, last), []).append((first, last))
    named = {why: listed((_times(*s) for s in spans), at_most=3) for why, spans in reasons.items()}
    return [f"{times}: {why}" for why, times in named.items()]


def moving_spans(log: MappedLog) -> list[tuple[float, float]]:
    """Spans in which a position or torque moves, without drift, as strongly as in runs."""
    length = max(8, round(_BLOCK_S / log.interval_s))
    count = len(log.time_s) // length
    if count < 8:
        return []
    signals = np.column_stack([log.theta_rad, log.tau_Nm])[: count * length]
    blocks = signals.reshape(count, length, -1)
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.sqrt((detrend(blocks, axis=1) ** 2).mean(axis=1))
        strong, quiet = np.nan_to_num(np.quantile(size, [0.9, 0.02], axis=0))
    rests = quiet < _MAX_REST * strong
    least = np.maximum(_MIN_MOTION * strong, np.where(rests, _MIN_ABOVE_REST * quiet, 0.0))
    # Noise has constant strength: without a rest, motion cannot be separated from it.
    moves = ((size > least) & rests).any(axis=1)
    moves = np.convolve(moves, np.ones(5), mode="same") >= 3
    times = log.time_s[::length][: count + 1]
    end = float(log.time_s[-1])
    return [(float(times[a]), float(times[b]) if b < len(times) else end) for a, b in true_runs(moves)]


def _uncovered(
    begin: float, end: float, covered: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Parts of a span outside the runs and their transients."""
    left = [(begin, end)]
    for first, last in covered:
        margin = max(_MIN_SPAN_S, _MARGIN * (last - first))
        low, high = first - margin, last + margin
        parts = [part for a, b in left for part in ((a, min(b, low)), (max(a, high), b))]
        left = [(a, b) for a, b in parts if b > a]
    return left


def _reason(log: MappedLog, begin: float, end: float) -> str:
    part = log.rows(begin, end)
    theta, tau = log.theta_rad[part], log.tau_Nm[part]
    steps = max(np.unique(np.round(signal, 12)).size for signal in theta.T)
    if steps <= _COARSE_STEPS and np.ptp(tau, axis=0).max() > 0:
        return (
            "the torque oscillates, but the position has at most four sensor steps, too few for a run. "
            "Excite the joint more, or log the position with a finer resolution."
        )
    return (
        "motion without a steady sine of five periods. Record each frequency "
        "longer, with rests between, " + _REMEDY
    )


def _times(begin: float, end: float) -> str:
    return f"{begin:.2f} to {end:.2f} s"
