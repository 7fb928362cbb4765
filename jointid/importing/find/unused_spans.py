"""Spans in which a log moves without a segment, and why: sweeps, short runs, coarse encoders."""

from collections.abc import Iterable, Sequence
from itertools import compress

import numpy as np
from scipy.signal import detrend

from jointid.arrays import Floats, true_runs
from jointid.importing.find.segment import Segment
from jointid.importing.find.steady_state import frames_of, phase_bends
from jointid.importing.map.mapped_log import MappedLog
from jointid.wording import listed, significant

_MIN_BEND_RAD = 0.015  # of the phase of a run, above which its frequency drifts: 0.4 % in 5 periods
_BEND_SIGMAS = 5.0  # standard errors of the bend
_MIN_STEADY = 0.2  # of a span of motion with a sweep, below which its steady runs are chance
_MAX_GROWTH = 0.05  # of the amplitude of a run from its middle to its end, above which it is a ramp
_SWEEP_GAP = 1.5  # times the longer piece: longest pause within a sweep
_BLOCK_S = 0.1  # length of the blocks whose motion is compared
_MIN_MOTION = 0.05  # of the strong motion of a log (90 % quantile)
_MIN_ABOVE_REST = 3.0  # times the motion at rest (2 % quantile)
_MAX_REST = 0.2  # motion at rest over strong motion, above which all is noise
_MIN_SPAN_S = 1.0  # shorter spans are not reported
_MARGIN = 0.5  # of a run to each side, which transients take
_COARSE_STEPS = 4  # positions of an encoder that are too few for a sine
_MAX_NAMED = 3  # spans that a note names

_REMEDY = "or mark it by its start and stop."


def without_sweeps(
    log: MappedLog, segments: Sequence[Segment]
) -> tuple[list[Segment], list[tuple[float, float]], list[str]]:
    """Remove pieces of sweeps: return the other runs, start and stop (s) of each sweep, and notes.

    In a piece of a sweep the frequency drifts or turns back, which bends the phase; in a staircase of
    sines it is constant. Noise may hide the drift of a piece between others. Ramps beside a longer run
    are removed, too: they bias the frequency. Segments are in order of time.
    """
    bends = [_trends(log, s) for s in segments]
    edges = [s for k, s in enumerate(segments) if _is_edge(k, segments, bends[k][2])]
    limits = [np.maximum(_MIN_BEND_RAD, _BEND_SIGMAS * error) for _, error, _ in bends]
    drifts = [bool(np.any(np.abs(b) > most)) for (b, *_), most in zip(bends, limits, strict=True)]
    spans = _merged(compress(segments, drifts))
    for k, segment in enumerate(segments):
        reach = _SWEEP_GAP * (segment.stop_s - segment.start_s)
        near = any(a - reach < segment.stop_s and segment.start_s < b + reach for a, b in spans)
        drifts[k] |= near and bool(abs(bends[k][0][0]) + limits[k][0] > 2 * _MIN_BEND_RAD)
    if any(drifts) and not all(drifts):
        for begin, end in moving_spans(log) or [(float(log.time_s[0]), float(log.time_s[-1]))]:
            here = [k for k, s in enumerate(segments) if s.start_s < end and s.stop_s > begin]
            steady = sum(segments[k].stop_s - segments[k].start_s for k in here if not drifts[k])
            if any(drifts[k] for k in here) and steady < _MIN_STEADY * (end - begin):
                for k in here:
                    drifts[k] = True
    pieces = list(compress(segments, drifts))
    spans = _merged(pieces)
    notes = []
    for begin, end in spans:
        inside = [s for s in pieces if begin <= s.start_s < end]
        low, high = _edge_hz(log, inside[0], -1), _edge_hz(log, inside[-1], 1)
        notes.append(
            f"{_times(begin, end)}: a sweep from {significant(low, 3)} to {significant(high, 3)} Hz, "
            "not used as a sine run. "
            "Record single frequencies or a multisine, " + _REMEDY
        )
    return [s for s in segments if s not in pieces and s not in edges], spans, notes


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


def _trends(log: MappedLog, segment: Segment) -> tuple[Floats, Floats, float]:
    """Bends of a run's phase, their standard errors, rad, and the growth of its amplitude."""
    part = log.rows(segment.start_s, segment.stop_s)
    signals = np.column_stack([log.theta_rad[part], log.tau_Nm[part]])
    interval = (segment.stop_s - segment.start_s) / (len(signals) - 1)
    lines = interval * np.array(segment.lines_hz)
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
    return [f"{_listed_times(spans)}: {why}" for why, spans in reasons.items()]


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


def _listed_times(spans: Sequence[tuple[float, float]]) -> str:
    named = [_times(*span) for span in spans[:_MAX_NAMED]]
    more = len(spans) - len(named)
    return listed([*named, f"{more} more spans" if more > 1 else "1 more span"] if more else named)


def _times(begin: float, end: float) -> str:
    return f"{begin:.2f} to {end:.2f} s"
