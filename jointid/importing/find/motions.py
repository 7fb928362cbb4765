"""Spans of a log with motion that is no steady sine: they become motion records."""

from __future__ import annotations

from collections.abc import Callable

from jointid.errors import JointIdError
from jointid.importing.find.segment import Segment
from jointid.importing.find.segments import FoundSegments, find_segments, measure_segment, without_gaps
from jointid.importing.find.unused_spans import moving_spans
from jointid.importing.map.mapped_log import MappedLog
from jointid.phasors.coherence import coherent_band
from jointid.records import MotionRecord

_LONGEST_REST_S = 3.0
"""A longer rest or gap ends a record."""
_SHORTEST_S = 3.0
"""Shorter spans do not become records."""
_MARGIN_S = 0.2
"""Rest kept before and after the motion."""
_MOST_LINES = 24
"""Lines of a multisine that become records of their own."""
_LEAST_SHARE = 0.5
"""Share of motion and torque that steady lines explain at least, where nobody stated a frequency."""


def find_runs(log: MappedLog, *, progress: Callable[[float], None] | None = None) -> FoundSegments:
    """Find the steady sines of a log; in a log without any, the spans of any other motion.

    Parameters
    ----------
    log, progress
        As in :func:`find_segments`.

    Returns
    -------
    FoundSegments
        Empty, with the reasons, when torque and motion are not coherent either.
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
    log: MappedLog, start_s: float, stop_s: float, frequency_hz: float | None = None
) -> Segment:
    """Measure a span that a user marked: steady lines where they explain it, else any motion.

    Parameters and errors as in :func:`measure_segment`.
    """
    if frequency_hz is not None:
        return measure_segment(log, start_s, stop_s, frequency_hz)
    try:
        segment = measure_segment(log, start_s, stop_s)
        if min(segment.share, segment.torque_share) >= _LEAST_SHARE:
            return segment
    except JointIdError:
        segment = None
    try:
        return measure_motion(log, start_s, stop_s)
    except JointIdError:
        return segment or measure_segment(log, start_s, stop_s)


def measure_motion(log: MappedLog, start_s: float, stop_s: float) -> Segment:
    """Return a span as motion, with the band that its coherence proposes.

    Raises
    ------
    JointIdError
        When torque and motion are not coherent, or the span is too short.
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
