"""Spans in which a log moves without a segment, and why: sweeps, short runs, coarse encoders."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from jointid.arrays import true_runs
from jointid.importing.find.segment import Segment
from jointid.importing.map.mapped_log import MappedLog
from jointid.rounding import significant
from jointid.wording import listed

_SWEEP_RUNS = 3  # fewest consecutive runs of a sweep
_SWEEP_RATE_RATIO = 2.0  # largest ratio of the sweep rate within a run and from run to run
_SWEEP_STEP = 2e-3  # relative change of frequency from run to run beyond the error of the estimate
_SWEEP_GAP = 1.5  # times the longer run: longest pause within a sweep
_MERGE_GAP = 0.25  # times the longer part: pause that merges two parts of a sweep
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
    """Remove runs that are pieces of a sweep.

    Within a piece of a sweep the frequency changes at the same rate as from piece to piece; in a
    staircase of sines it is constant.

    Parameters
    ----------
    log : MappedLog
    segments : sequence of Segment
        In order of time.

    Returns
    -------
    kept : list of Segment
    spans : list of (float, float)
        Start and stop of each sweep, s.
    notes : list of str
    """
    singles = [s for s in segments if not s.is_multisine]
    chains = _chains(singles, [_rate(log, s) for s in singles])
    spans = _merged([(chain[0].start_s, chain[-1].stop_s) for chain in chains])
    notes: list[str] = []
    kept = list(segments)
    for begin, end in spans:
        inside = [s for s in kept if s.stop_s > begin and s.start_s < end and not s.is_multisine]
        kept = [s for s in kept if s not in inside]
        notes.append(
            f"{_times(begin, end)}: the frequency runs through from "
            f"{significant(inside[0].frequency_hz, 3)} to {significant(inside[-1].frequency_hz, 3)} Hz: "
            "this is a sweep, which is not used. Record single frequencies or a multisine, " + _REMEDY
        )
    return kept, spans, notes


def _chains(singles: Sequence[Segment], rates: Sequence[float]) -> list[Sequence[Segment]]:
    """Consecutive runs whose frequency keeps changing."""
    pairs = zip(pairwise(singles), pairwise(rates), strict=True)
    starts = [k for k, (runs, slopes) in enumerate(pairs, start=1) if not _continues(runs, slopes)]
    chains = [singles[a:b] for a, b in pairwise([0, *starts, len(singles)])]
    return [chain for chain in chains if len(chain) >= _SWEEP_RUNS]


def _continues(runs: tuple[Segment, Segment], rates: tuple[float, float]) -> bool:
    one, two = runs
    gap = two.start_s - one.stop_s
    change = two.frequency_hz - one.frequency_hz
    too_far = gap > _SWEEP_GAP * max(s.stop_s - s.start_s for s in runs)
    if too_far or abs(change) < _SWEEP_STEP * one.frequency_hz:
        return False
    slope = 2 * change / (two.start_s + two.stop_s - one.start_s - one.stop_s)
    return all(1 / _SWEEP_RATE_RATIO < rate / slope < _SWEEP_RATE_RATIO for rate in rates)


def _rate(log: MappedLog, segment: Segment) -> float:
    """Rate of change of a run's frequency, Hz/s, from the curvature of its phase."""
    part = log.rows(segment.start_s, segment.stop_s)
    time, theta = log.time_s[part], log.theta_rad[part]
    if len(time) < 16:
        return 0.0
    clock = time - (time[0] + time[-1]) / 2
    x = clock / clock[-1]
    wave = np.exp(2j * np.pi * segment.frequency_hz * clock)
    bent = wave[:, None] * x[:, None] ** np.arange(3)
    basis = np.column_stack([np.ones_like(x), x, bent.real, bent.imag])
    largest = theta[:, int(np.argmax(theta.std(axis=0)))]
    c = np.linalg.lstsq(basis, largest - largest.mean(), rcond=None)[0]
    y = c[5:] + 1j * c[2:5]
    if y[0] == 0:
        return 0.0
    return float((2 * y[2] / y[0] - (y[1] / y[0]) ** 2).imag / (2 * np.pi * clock[-1] ** 2))


def _merged(spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Merge parts of one sweep between which a run was missed."""
    merged: list[tuple[float, float]] = []
    for begin, end in spans:
        if merged and begin - merged[-1][1] < _MERGE_GAP * max(
            merged[-1][1] - merged[-1][0], end - begin
        ):
            merged[-1] = (merged[-1][0], end)
        else:
            merged.append((begin, end))
    return merged


def unused_spans(
    log: MappedLog, segments: Sequence[Segment], sweeps: Sequence[tuple[float, float]]
) -> list[str]:
    """Describe the spans that move without a segment: why, and what to do.

    Parameters
    ----------
    log : MappedLog
    segments : sequence of Segment
    sweeps : sequence of (float, float)
        Spans, s, that have a note already.

    Returns
    -------
    list of str
        One sentence or two for each reason.
    """
    covered = [*((s.start_s, s.stop_s) for s in segments), *sweeps]
    reasons: dict[str, list[tuple[float, float]]] = {}
    for begin, end in _moving(log):
        for first, last in _uncovered(begin, end, covered):
            if last - first >= _MIN_SPAN_S:
                reasons.setdefault(_reason(log, first, last), []).append((first, last))
    return [f"{_listed_times(spans)}: {why}" for why, spans in reasons.items()]


def _moving(log: MappedLog) -> list[tuple[float, float]]:
    """Spans in which a position or torque moves, without drift, as strongly as in runs."""
    length = max(8, round(_BLOCK_S / log.interval_s))
    count = len(log.time_s) // length
    if count < 8:
        return []
    signals = np.column_stack([log.theta_rad, log.tau_Nm])[: count * length]
    blocks = signals.reshape(count, length, -1)
    blocks = blocks - blocks.mean(axis=1, keepdims=True)
    x = np.linspace(-1, 1, length)
    drift = np.einsum("j,bjc->bc", x, blocks) / (x @ x)
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.sqrt(((blocks - x[:, None] * drift[:, None]) ** 2).mean(axis=1))
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
            "the torque swings while the position shows four steps of its sensor or fewer, too little "
            "for a run. Excite the joint more there, or record the position more finely."
        )
    return (
        "something moves, but no sine stands still in it for five periods. Record each frequency "
        "longer, with rests between, " + _REMEDY
    )


def _listed_times(spans: Sequence[tuple[float, float]]) -> str:
    named = [_times(*span) for span in spans[:_MAX_NAMED]]
    more = len(spans) - len(named)
    return listed([*named, f"{more} more spans" if more > 1 else "1 more span"] if more else named)


def _times(begin: float, end: float) -> str:
    return f"{begin:.2f} to {end:.2f} s"
