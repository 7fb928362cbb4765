"""A long log cut into steady sine segments, each with its frequency."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.find.line_fit import fit_lines
from jointid.importing.find.lines import find_lines
from jointid.importing.find.segment import HARMONICS, Segment, lines_worth, measured
from jointid.importing.find.segment_search import Stretch
from jointid.importing.find.unused_spans import untaken, without_sweeps
from jointid.importing.map.mapped_log import MappedLog
from jointid.wording import counted

FEWEST_PERIODS = 5
"""Periods that a segment needs to be found by itself; a user may ask for fewer."""
MANY_SEGMENTS = 1000

_GAP = 10.5  # sample intervals; a longer pause parts a log


class FoundSegments(tuple[Segment, ...]):
    """Segments in order of time, with what is to be said about the rest of the log."""

    notes: tuple[str, ...]
    """Stretches that move but were not taken: when, why, and what to do."""

    def __new__(cls, segments: Iterable[Segment] = (), notes: Iterable[str] = ()) -> FoundSegments:
        """Take segments and notes."""
        found = super().__new__(cls, segments)
        found.notes = tuple(notes)
        return found

    def __getnewargs__(self) -> tuple[tuple[Segment, ...], tuple[str, ...]]:
        """Arguments that make the same again: notes go with the segments to another process."""
        return tuple(self), self.notes


def find_segments(
    log: MappedLog,
    *,
    fewest_periods: float = FEWEST_PERIODS,
    progress: Callable[[float], None] | None = None,
) -> FoundSegments:
    """Find the steady sine runs of a log, in order of time.

    Parameters
    ----------
    log : MappedLog
        One run or many, with rests, travel or nothing between them; joints one at a time or together.
    fewest_periods : float, default 5
        Shorter runs are left out.
    progress : callable, optional
        Told the share that is done, 0 to 1; what it raises ends the search.

    Returns
    -------
    FoundSegments
        May be empty. Runs of one frequency in which the joints move in another pattern are separate,
        and carry the very same frequency. Several lines at once make one segment with ``lines_hz``.
        Its ``notes`` say what moves but was not taken, such as sweeps.

    Raises
    ------
    JointIdError
        When ``fewest_periods`` is below 2.
    """
    if not fewest_periods >= 2:
        raise JointIdError(f"fewest_periods = {fewest_periods!r}: a segment needs at least 2 periods.")
    found: list[Segment] = []
    for begin, end in _without_gaps(log.time_s):

        def tell(share: float, begin: int = begin, end: int = end) -> None:
            if progress is not None:
                progress((begin + share * (end - begin)) / log.time_s.size)

        stretch = Stretch(log, begin, end, fewest_periods)
        found += stretch.segments(tell)
        if len(found) > MANY_SEGMENTS:
            raise JointIdError(
                f"{log.name or 'The log'} falls into more than {MANY_SEGMENTS} segments: it holds no "
                "sine runs, or the columns are the wrong ones. Choose another time or position column."
            )
    found, sweeps, notes = without_sweeps(log, sorted(found, key=lambda s: s.start_s))
    return FoundSegments(common_frequencies(found), [*notes, *untaken(log, found, sweeps)])


def measure_segment(
    log: MappedLog,
    start_s: float,
    stop_s: float,
    frequency_hz: float | Sequence[float] | None = None,
) -> Segment:
    """Make a segment of a stretch that the user chose, with its frequency unless given.

    Parameters
    ----------
    log : MappedLog
    start_s, stop_s : float
        Taken as they are: nothing is discarded.
    frequency_hz : float or sequence of float, optional
        The line, or all lines at once, taken as they are; by default all that are found.

    Raises
    ------
    JointIdError
        When the stretch holds too few samples, nothing moves in it, or a frequency is not positive.
    """
    part = log.rows(start_s, stop_s)
    time, theta = log.time_s[part], log.theta_rad[part]
    if time.size < 8:
        raise JointIdError(
            f"{start_s:g} s to {stop_s:g} s holds {counted(time.size, 'sample')}; a segment needs at "
            f"least 8. The log spans {log.time_s[0]:g} s to {log.time_s[-1]:g} s."
        )
    if frequency_hz is None:
        if not np.any(np.ptp(theta, axis=0) > 0):
            raise JointIdError(
                f"No joint moves from {start_s:g} s to {stop_s:g} s: choose times at which one does."
            )
        tau = log.tau_Nm[part]
        lines = find_lines(time, theta, tau)
        if not lines:
            raise JointIdError(
                f"From {start_s:g} s to {stop_s:g} s no line stands out: give frequency_hz, or other "
                "times."
            )
        return measured(time, theta, tau, lines_worth(time, theta, tau, lines))
    lines = [float(f) for f in np.atleast_1d(np.asarray(frequency_hz, float))]
    if not lines:
        raise JointIdError(
            "frequency_hz is empty: give one frequency or more, or None to have it found."
        )
    segment = Segment(float(time[0]), float(time[-1]), lines[0], tuple(lines))
    signals = np.column_stack([theta, log.tau_Nm[part]])
    lines = list(segment.lines_hz)
    fit = fit_lines(time, signals, lines, harmonics=HARMONICS if len(lines) == 1 else 1, free=False)
    strongest = int(np.argmax(np.linalg.norm(fit.phasors[:, : log.n], axis=1)))
    return replace(
        segment,
        frequency_hz=lines[strongest],
        share=float(fit.share[: log.n].max()),
        torque_share=float(fit.share[log.n :].max()),
        amplitude_rad=tuple(np.abs(fit.phasors[strongest, : log.n]).tolist()),
    )


def common_frequencies(segments: Sequence[Segment]) -> tuple[Segment, ...]:
    """Give segments that agree within their errors one frequency, so that their records belong together.

    Lines closer than 1e-4 of themselves, than four standard errors, or than a hundredth of one over the
    shorter duration are the same set point of the controller; they get the mean, weighted by the errors.
    """
    entries = sorted((line, k) for k, s in enumerate(segments) for line in s.lines_hz)
    shared: dict[tuple[int, float], float] = {}
    group: list[tuple[float, int]] = []

    def close() -> None:
        weights = [1 / (_error(segments[k]) ** 2 + (1e-9 * line) ** 2) for line, k in group]
        mean = float(np.average([line for line, _ in group], weights=weights))
        shared.update({(k, line): mean if len(group) > 1 else line for line, k in group})

    for line, k in entries:
        if group:
            last, other = group[-1]
            pair = (segments[k], segments[other])
            errors = float(np.hypot(_error(pair[0]), _error(pair[1])))
            unresolved = 0.01 / min(s.stop_s - s.start_s for s in pair)
            near = line - last <= max(1e-4 * line, unresolved, min(4 * errors, 1e-3 * line))
            if not near or k in [index for _, index in group]:
                close()
                group = []
        group.append((line, k))
    if group:
        close()
    return tuple(
        replace(
            s,
            frequency_hz=shared[k, s.frequency_hz],
            lines_hz=tuple(shared[k, line] for line in s.lines_hz),
        )
        for k, s in enumerate(segments)
    )


def _error(segment: Segment) -> float:
    return segment.frequency_error_hz if np.isfinite(segment.frequency_error_hz) else 0.0


def _without_gaps(time: Floats) -> Iterator[tuple[int, int]]:
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > _GAP * np.median(steps)) + 1
    edges = [0, *gaps.tolist(), time.size]
    for begin, end in pairwise(edges):
        if end - begin >= 32:
            yield begin, end
