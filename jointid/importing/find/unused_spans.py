"""What a search for runs leaves out, and why: sweeps, and what moves without a steady sine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from jointid.importing.find.segment import Segment
from jointid.importing.map.mapped_log import MappedLog
from jointid.rounding import significant
from jointid.wording import listed

_FEWEST = 3  # runs in a row that make a sweep
_ALIKE = 2.0  # within which factor a run's frequency runs as fast as from run to run
_RUNS_BY = 2e-3  # relative change from run to run that is no error of the estimate
_BLOCK_S = 0.1
_MOVES = 0.05  # of the usual strong motion
_ABOVE_REST = 3.0  # times the quietest
_WORTH_TELLING_S = 1.0
_NAMED = 3  # stretches that a note names

_BY_HAND = "or mark it by its start and stop on the page Import a log."


def without_sweeps(
    log: MappedLog, segments: Sequence[Segment]
) -> tuple[list[Segment], list[tuple[float, float]], list[str]]:
    """Take out runs that are pieces of a sweep.

    In a piece of a sweep the frequency runs as fast as it does from one piece to the next; in a
    staircase of sines it stands still.

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
    spans: list[tuple[float, float]] = []
    notes: list[str] = []
    for chain in _chains(singles, [_rate(log, s) for s in singles]):
        begin, end = chain[0].start_s, chain[-1].stop_s
        spans.append((begin, end))
    spans = _merged(spans)
    kept = list(segments)
    for begin, end in spans:
        inside = [s for s in kept if s.stop_s > begin and s.start_s < end and not s.is_multisine]
        kept = [s for s in kept if s not in inside]
        notes.append(
            f"{_times(begin, end)}: the frequency runs through from "
            f"{significant(inside[0].frequency_hz, 3)} to {significant(inside[-1].frequency_hz, 3)} Hz: "
            "this is a sweep, of which no runs are taken. Record single frequencies or a multisine, "
            + _BY_HAND
        )
    return kept, spans, notes


def _chains(singles: Sequence[Segment], rates: Sequence[float]) -> Iterator[list[Segment]]:
    """Runs in a row whose frequency goes on running."""
    chain: list[Segment] = []
    for k, segment in enumerate(singles):
        if chain and _goes_on(chain[-1], segment, (rates[k - 1], rates[k])):
            chain.append(segment)
            continue
        if len(chain) >= _FEWEST:
            yield chain
        chain = [segment]
    if len(chain) >= _FEWEST:
        yield chain


def _goes_on(one: Segment, two: Segment, rates: tuple[float, float]) -> bool:
    gap = two.start_s - one.stop_s
    if gap > 1.5 * max(s.stop_s - s.start_s for s in (one, two)):
        return False
    change = two.frequency_hz - one.frequency_hz
    if abs(change) < _RUNS_BY * one.frequency_hz:
        return False
    slope = 2 * change / (two.start_s + two.stop_s - one.start_s - one.stop_s)
    return all(1 / _ALIKE < rate / slope < _ALIKE for rate in rates)


def _rate(log: MappedLog, segment: Segment) -> float:
    """How fast the frequency of a run changes, Hz/s: from the bend of its phase."""
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
    """Parts of one sweep that a miss has parted."""
    merged: list[tuple[float, float]] = []
    for begin, end in spans:
        if merged and begin - merged[-1][1] < 0.25 * max(merged[-1][1] - merged[-1][0], end - begin):
            merged[-1] = (merged[-1][0], end)
        else:
            merged.append((begin, end))
    return merged


def untaken(
    log: MappedLog, segments: Sequence[Segment], told: Sequence[tuple[float, float]] = ()
) -> list[str]:
    """Say which stretches move although no run was taken there, why, and what to do.

    Parameters
    ----------
    log : MappedLog
    segments : sequence of Segment
        What was taken.
    told : sequence of (float, float)
        Spans, s, that other notes are about.

    Returns
    -------
    list of str
        One sentence or two for each reason.
    """
    covered = [*((s.start_s, s.stop_s) for s in segments), *told]
    reasons: dict[str, list[tuple[float, float]]] = {}
    for begin, end in _moving(log):
        for first, last in _uncovered(begin, end, covered):
            if last - first >= _WORTH_TELLING_S:
                reasons.setdefault(_why(log, first, last), []).append((first, last))
    return [f"{_named(spans)}: {why}" for why, spans in reasons.items()]


def _moving(log: MappedLog) -> list[tuple[float, float]]:
    """Stretches in which a position or a torque moves, about a straight line, as it does in runs."""
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
    rests = quiet < 0.2 * strong
    least = np.maximum(_MOVES * strong, np.where(rests, _ABOVE_REST * quiet, 0.0))
    # Noise is as strong all the time: where nothing rests nothing can be told from it.
    moves = ((size > least) & rests).any(axis=1)
    moves = np.convolve(moves, np.ones(5), mode="same") >= 3
    edges = np.flatnonzero(np.diff(np.concatenate([[0], moves.astype(int), [0]]))).reshape(-1, 2)
    times = log.time_s[::length][: count + 1]
    end = float(log.time_s[-1])
    return [(float(times[a]), float(times[b]) if b < len(times) else end) for a, b in edges]


def _uncovered(
    begin: float, end: float, covered: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """What is left of a stretch beside the runs and what settles and ends around them."""
    left = [(begin, end)]
    for first, last in covered:
        margin = max(_WORTH_TELLING_S, 0.5 * (last - first))
        low, high = first - margin, last + margin
        left = [
            part for a, b in left for part in ((a, min(b, low)), (max(a, high), b)) if part[1] > part[0]
        ]
    return left


def _why(log: MappedLog, begin: float, end: float) -> str:
    part = log.rows(begin, end)
    theta, tau = log.theta_rad[part], log.tau_Nm[part]
    steps = max(np.unique(np.round(signal, 12)).size for signal in theta.T)
    if steps <= 4 and np.ptp(tau, axis=0).max() > 0:
        return (
            "the torque swings while the position shows four steps of its sensor or fewer, too little "
            "for a run. Excite the joint more there, or record the position more finely."
        )
    return (
        "something moves, but no sine stands still in it for five periods. Record each frequency "
        "longer, with rests between, " + _BY_HAND
    )


def _named(spans: Sequence[tuple[float, float]]) -> str:
    named = [_times(*span) for span in spans[:_NAMED]]
    more = len(spans) - len(named)
    return listed(
        [*named, f"{more} more stretches" if more > 1 else "1 more stretch"] if more else named
    )


def _times(begin: float, end: float) -> str:
    return f"{begin:.2f} to {end:.2f} s"
