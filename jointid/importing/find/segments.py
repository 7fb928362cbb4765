"""Cut a log into steady sine segments, each with its frequency, or into spans of any other motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.find.lines import find_lines
from jointid.importing.find.segment import Segment, measured, significant_lines
from jointid.importing.find.segment_search import SegmentSearch
from jointid.importing.find.unused_spans import moving_spans, unused_spans, without_sweeps
from jointid.importing.map.mapped_log import MappedLog
from jointid.importing.map.sample_times import GAP
from jointid.phasors.coherence import coherent_band
from jointid.records import MotionRecord
from jointid.small_matrices import one_thread
from jointid.wording import counted

MANY_SEGMENTS = 1000
_FEWEST_SAMPLES = 32  # of a part of a log between gaps


class FoundSegments(tuple[Segment, ...]):
    """Segments in order of time, with notes about the rest of the log."""

    notes: tuple[str, ...]
    """Moving spans without a segment: when, why, and what to do."""

    def __new__(cls, segments: Iterable[Segment] = (), notes: Iterable[str] = ()) -> FoundSegments:
        """Create from segments and notes."""
        found = super().__new__(cls, segments)
        found.notes = tuple(notes)
        return found


def find_segments(log: MappedLog, *, progress: Callable[[float], None] | None = None) -> FoundSegments:
    """Find the steady sine runs of a log, in order of time; possibly none.

    The log holds one run or many, with rests, travel or nothing between them; joints one at a time or
    together. Runs of one frequency with different excitation patterns are separate segments with the
    same frequency; a multisine is one segment with ``lines_hz``. ``notes`` of the result name moving
    spans without a segment, such as sweeps. ``progress`` is called with the share done, 0 to 1; an
    exception it raises ends the search.
    """
    found: list[Segment] = []
    for begin, end in without_gaps(log.time_s):

        def report(share: float, begin: int = begin, end: int = end) -> None:
            if progress is not None:
                progress((begin + share * (end - begin)) / log.time_s.size)

        with one_thread():  # its matrices are small: more threads only wait for each other
            found += SegmentSearch(log, begin, end).segments(report)
        if len(found) > MANY_SEGMENTS:
            raise JointIdError(
                f"{log.name or 'The log'} has more than {MANY_SEGMENTS} runs: it holds no "
                "sines, or the wrong columns are chosen. Choose another time or position column."
            )
    found, sweeps, notes = without_sweeps(log, sorted(found, key=lambda s: s.start_s))
    return FoundSegments(common_frequencies(found), [*notes, *unused_spans(log, found, sweeps)])


def common_frequencies(segments: Sequence[Segment]) -> tuple[Segment, ...]:
    """Give segments that agree within their errors one frequency, so that their records form a group.

    Lines closer than 1e-4 of the frequency, four standard errors, or a hundredth of one over the shorter
    duration are the same set point of the controller; they get the mean, weighted by the errors.
    """
    entries = sorted((line, k) for k, s in enumerate(segments) for line in s.lines_hz)
    groups: list[list[tuple[float, int]]] = []
    for line, k in entries:
        if groups and k not in [index for _, index in groups[-1]]:
            last, other = groups[-1][-1]
            pair = (segments[k], segments[other])
            errors = float(np.hypot(_error(pair[0]), _error(pair[1])))
            unresolved = 0.01 / min(s.stop_s - s.start_s for s in pair)
            if line - last <= max(1e-4 * line, unresolved, min(4 * errors, 1e-3 * line)):
                groups[-1].append((line, k))
                continue
        groups.append([(line, k)])
    shared: dict[tuple[int, float], float] = {}
    for group in groups:
        weights = [1 / (_error(segments[k]) ** 2 + (1e-9 * line) ** 2) for line, k in group]
        least = group[0][0]  # equal lines keep their value exactly
        mean = least + float(np.average([line - least for line, _ in group], weights=weights))
        shared |= {(k, line): mean if len(group) > 1 else line for line, k in group}
    return tuple(
        replace(
            s,
            frequency_hz=shared[k, s.frequency_hz],
            lines_hz=tuple(shared[k, line] for line in s.lines_hz),
        )
        if s.lines_hz
        else s
        for k, s in enumerate(segments)
    )


def _error(segment: Segment) -> float:
    return segment.frequency_error_hz if np.isfinite(segment.frequency_error_hz) else 0.0


def without_gaps(time: Floats) -> Iterator[tuple[int, int]]:
    """First row and one past the last of each part of a log without gaps."""
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > GAP * np.median(steps)) + 1
    for begin, end in pairwise([0, *gaps.tolist(), time.size]):
        if end - begin >= _FEWEST_SAMPLES:
            yield begin, end


_LONGEST_REST_S = 3.0  # a longer rest or gap ends a record
_SHORTEST_S = 3.0  # shorter spans do not become records
_MARGIN_S = 0.2  # rest kept before and after the motion
_MOST_LINES = 24  # lines of a multisine that become records of their own
_LEAST_SHARE = 0.5
"""Least share of motion and torque in steady lines, without a stated frequency."""


def find_runs(log: MappedLog, *, progress: Callable[[float], None] | None = None) -> FoundSegments:
    """Find the steady sines of a log; in a log without any, the spans of any other motion.

    Arguments as in :func:`find_segments`. The result is empty, with the reasons, when torque and motion
    are not coherent either.
    """
    sines = find_segments(log, progress=progress)
    if sines:
        return FoundSegments((_dense(log, segment) for segment in sines), sines.notes)
    motions, reasons = [], []
    for begin, end in _spans(log):
        try:
            motions.append(measure_motion(log, begin, end))
        except JointIdError as error:
            reasons.append(str(error))
    return FoundSegments(motions) if motions else FoundSegments((), [*sines.notes, *reasons])


def _dense(log: MappedLog, segment: Segment) -> Segment:
    """The segment, a multisine of very many lines as motion: their records would repeat the log."""
    if len(segment.lines_hz) <= _MOST_LINES:
        return segment
    try:
        return measure_motion(log, segment.start_s, segment.stop_s)
    except JointIdError:
        return segment


def measure_run(
    log: MappedLog, start_s: float, stop_s: float, frequency_hz: float | Sequence[float] | None = None
) -> Segment:
    """Measure a span that a user marked: steady lines where they explain it, else any motion.

    The span is used as given: no transient is discarded. So is ``frequency_hz``, a line or all lines; by
    default those found. Raises JointIdError when the span holds too few samples or no motion, or a
    frequency is not positive.
    """
    part = log.rows(start_s, stop_s)
    time, theta, tau = log.time_s[part], log.theta_rad[part], log.tau_Nm[part]
    if time.size < 8:
        raise JointIdError(
            f"{start_s:g} s to {stop_s:g} s holds {counted(time.size, 'sample')}; a run needs at "
            f"least 8. The log spans {log.time_s[0]:g} s to {log.time_s[-1]:g} s."
        )
    if frequency_hz is not None:
        lines = np.atleast_1d(frequency_hz).tolist()
        segment = Segment(float(time[0]), float(time[-1]), lines[0], tuple(lines))  # checks them
        return measured(time, theta, tau, segment.lines_hz, free=False)
    if not np.any(np.ptp(theta, axis=0) > 0):
        raise JointIdError(f"No joint moves from {start_s:g} s to {stop_s:g} s: choose other times.")
    lines = find_lines(time, theta, tau)
    found = measured(time, theta, tau, significant_lines(time, theta, tau, lines)) if lines else None
    if found and min(found.share, found.torque_share) >= _LEAST_SHARE:
        return found
    try:
        return measure_motion(log, start_s, stop_s)
    except JointIdError as error:
        if found:
            return found
        raise JointIdError(
            f"From {start_s:g} s to {stop_s:g} s no spectral line exceeds the noise ({error}): give "
            "the frequency, or other times."
        ) from error


def measure_motion(log: MappedLog, start_s: float, stop_s: float) -> Segment:
    """Return a span as motion, with the band that its coherence proposes.

    Raises JointIdError when torque and motion are not coherent, or the span is too short.
    """
    part = log.rows(start_s, stop_s)
    time = log.time_s[part]
    place = f"{start_s:.2f} to {stop_s:.2f} s"
    record = MotionRecord(time, log.theta_rad[part], log.tau_Nm[part], label=place)
    return Segment(float(time[0]), float(time[-1]), float("nan"), band_hz=coherent_band(record))


def _spans(log: MappedLog) -> list[tuple[float, float]]:
    """Parts of a log without gaps and long rests; the whole part where motion never rests."""
    moving = moving_spans(log)
    spans = []
    for first, last in without_gaps(log.time_s):
        low, high = float(log.time_s[first]), float(log.time_s[last - 1])
        inside = [(max(a, low), min(b, high)) for a, b in moving if a < high and b > low]
        merged: list[tuple[float, float]] = []
        for begin, end in inside:
            if merged and begin - merged[-1][1] < _LONGEST_REST_S:
                begin = merged.pop()[0]
            merged.append((begin, end))
        kept = [
            (max(begin - _MARGIN_S, low), min(end + _MARGIN_S, high))
            for begin, end in merged
            if end - begin >= _SHORTEST_S
        ]
        spans += kept or ([(low, high)] if high - low >= _SHORTEST_S else [])
    return spans
