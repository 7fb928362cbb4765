"""A long log cut into steady sine segments, each with its frequency."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.line_fit import LineFit, fit_lines
from jointid.importing.lines import find_lines
from jointid.importing.mapping import MappedLog
from jointid.importing.sine_search import SHARE, Candidate, sine_candidates
from jointid.importing.steady import frames_of, runs, settled_part
from jointid.wording import shown

FEWEST_PERIODS = 5
"""Periods that a segment needs to be found by itself; a user may ask for fewer."""
MANY_SEGMENTS = 1000

_HARMONICS = 3  # fitted beside the fundamental, so that friction does not shift the frequency
_GAP = 3.5  # sample intervals; a longer pause parts a log
_SECOND_LINE = 0.08  # amplitude of another line over the largest that makes a multisine


@dataclass(frozen=True)
class Segment:
    """A stretch of a log in which every joint follows steady sines.

    Parameters
    ----------
    start_s, stop_s : float
        Settled part, on the clock of the log; the sample at ``stop_s`` belongs to it.
    frequency_hz : float
        The frequency, or the strongest of several lines.
    lines_hz : sequence of float, optional
        All lines at once, ascending; by default the one.
    frequency_error_hz : float, optional
        Standard error of the frequency; NaN where the user gave it.
    share : float, optional
        Share of the motor's motion that the lines explain, joint that they explain best.
    amplitude_rad : sequence of float, optional
        Of each motor at ``frequency_hz``.

    Raises
    ------
    JointIdError
        When it is empty, or a frequency is not positive.
    """

    start_s: float
    stop_s: float
    frequency_hz: float
    lines_hz: tuple[float, ...] = ()
    frequency_error_hz: float = float("nan")
    share: float = float("nan")
    amplitude_rad: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("start_s", "stop_s", "frequency_hz"):
            value = getattr(self, name)
            if not isinstance(value, float | int | np.floating) or not np.isfinite(value):
                raise JointIdError(f"{name} = {shown(value)}: expected a finite number.")
            object.__setattr__(self, name, float(value))
        lines = tuple(sorted(float(line) for line in (self.lines_hz or (self.frequency_hz,))))
        if min(lines) <= 0:
            raise JointIdError(f"A segment's frequency of {min(lines):g} Hz: must be positive.")
        if self.frequency_hz not in lines:
            raise JointIdError(
                f"frequency_hz = {self.frequency_hz:g} Hz is not among lines_hz {lines}: give it there too."
            )
        if not self.stop_s > self.start_s:
            raise JointIdError(
                f"A segment from {self.start_s:g} s to {self.stop_s:g} s is empty: the stop must come later."
            )
        object.__setattr__(self, "lines_hz", lines)
        object.__setattr__(self, "amplitude_rad", tuple(float(a) for a in self.amplitude_rad))

    @property
    def periods(self) -> float:
        """Periods of ``frequency_hz``."""
        return (self.stop_s - self.start_s) * self.frequency_hz

    @property
    def is_multisine(self) -> bool:
        """Whether several lines are there at once."""
        return len(self.lines_hz) > 1


def find_segments(log: MappedLog, *, fewest_periods: float = FEWEST_PERIODS) -> tuple[Segment, ...]:
    """Find the steady sine runs of a log, in order of time.

    Parameters
    ----------
    log : MappedLog
        One run or many, with rests, travel or nothing between them; joints one at a time or together.
    fewest_periods : float, default 5
        Shorter runs are left out.

    Returns
    -------
    tuple of Segment
        May be empty. Runs of one frequency in which the joints move in another pattern are separate,
        and carry the very same frequency. Several lines at once make one segment with ``lines_hz``.

    Raises
    ------
    JointIdError
        When ``fewest_periods`` is below 2.
    """
    if not fewest_periods >= 2:
        raise JointIdError(f"fewest_periods = {fewest_periods!r}: a segment needs at least 2 periods.")
    found: list[Segment] = []
    for begin, end in _without_gaps(log.time_s):
        stretch = _Stretch(log, begin, end, fewest_periods)
        found += stretch.segments()
        if len(found) > MANY_SEGMENTS:
            raise JointIdError(
                f"{log.name or 'The log'} falls into more than {MANY_SEGMENTS} segments: it holds no sine runs, "
                "or the time or position column is another one."
            )
    return common_frequencies(sorted(found, key=lambda s: s.start_s))


def measure_segment(
    log: MappedLog, start_s: float, stop_s: float, frequency_hz: float | None = None
) -> Segment:
    """Make a segment of a stretch that the user chose, with its frequency unless given.

    Parameters
    ----------
    log : MappedLog
    start_s, stop_s : float
        Taken as they are: nothing is discarded.
    frequency_hz : float, optional
        Taken as it is; by default estimated.

    Raises
    ------
    JointIdError
        When the stretch holds too few samples, or nothing moves in it.
    """
    part = _rows(log, start_s, stop_s)
    time, theta = log.time_s[part], log.theta_rad[part]
    if time.size < 8:
        raise JointIdError(
            f"{start_s:g} s to {stop_s:g} s holds {time.size} samples; a segment needs at least 8. The log "
            f"spans {log.time_s[0]:g} s to {log.time_s[-1]:g} s."
        )
    if frequency_hz is None:
        if not np.any(np.ptp(theta, axis=0) > 0):
            raise JointIdError(f"No joint moves from {start_s:g} s to {stop_s:g} s: no sine to measure.")
        lines = find_lines(time, theta)
        if not lines:
            raise JointIdError(
                f"From {start_s:g} s to {stop_s:g} s no line stands out: give frequency_hz, or other times."
            )
        return _measured(time, theta, log.tau_Nm[part], _worth(time, theta, lines))
    segment = Segment(float(time[0]), float(time[-1]), float(frequency_hz))
    fit = fit_lines(time, theta, [segment.frequency_hz], harmonics=_HARMONICS, free=False)
    return replace(
        segment,
        share=float(fit.share.max()),
        amplitude_rad=tuple(np.abs(fit.phasors[0, : log.n]).tolist()),
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
            errors = float(np.hypot(*(_error(s) for s in pair)))
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


def _rows(log: MappedLog, start_s: float, stop_s: float) -> slice:
    tolerance = 1e-6 * log.interval_s
    return slice(
        int(np.searchsorted(log.time_s, start_s - tolerance)),
        int(np.searchsorted(log.time_s, stop_s + tolerance, side="right")),
    )


def _without_gaps(time: Floats) -> Iterator[tuple[int, int]]:
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > _GAP * np.median(steps)) + 1
    edges = [0, *gaps.tolist(), time.size]
    for begin, end in zip(edges[:-1], edges[1:], strict=True):
        if end - begin >= 32:
            yield begin, end


def _measured(time: Floats, theta: Floats, tau: Floats, lines_hz: Sequence[float]) -> Segment:
    """Fit the lines to positions and torques together."""
    signals = np.column_stack([theta, tau])
    fit = fit_lines(time, signals, lines_hz, harmonics=_HARMONICS if len(lines_hz) == 1 else 1)
    n = theta.shape[1]
    strongest = int(np.argmax(np.linalg.norm(fit.phasors[:, :n], axis=1)))
    return Segment(
        start_s=float(time[0]),
        stop_s=float(time[-1]),
        frequency_hz=float(fit.frequency_hz[strongest]),
        lines_hz=tuple(fit.frequency_hz.tolist()),
        frequency_error_hz=float(fit.error_hz[strongest]),
        share=float(fit.share[:n].max()),
        amplitude_rad=tuple(np.abs(fit.phasors[strongest, :n]).tolist()),
    )


def _worth(time: Floats, theta: Floats, lines: Sequence[float]) -> list[float]:
    """Drop harmonics of the strongest line, and lines too small to be meant."""
    fit: LineFit = fit_lines(time, theta, lines, free=False)
    size = np.linalg.norm(fit.phasors / np.maximum(fit.moved, 1e-300), axis=1)
    strongest = int(np.argmax(size))
    kept = []
    for k, line in enumerate(lines):
        order = line / lines[strongest]
        resolution = 1.5 / (time[-1] - time[0]) / lines[strongest]
        is_harmonic = round(order) > 1 and abs(order - round(order)) < resolution
        least = 0.15 if is_harmonic else _SECOND_LINE
        if k == strongest or size[k] > least * size[strongest]:
            kept.append(line)
    return kept


def _repeats(candidate: Candidate, tried: Candidate) -> bool:
    """Whether a candidate is the same stretch at nearly the same frequency as one tried before."""
    inside = tried.begin <= candidate.begin and candidate.end <= tried.end
    return inside and abs(candidate.frequency / tried.frequency - 1) < 0.15


class _Stretch:
    """A part of a log without gaps, on an even grid for the search and as it is for the result."""

    def __init__(self, log: MappedLog, begin: int, end: int, fewest_periods: float) -> None:
        self._time = log.time_s[begin:end]
        self._theta, self._tau = log.theta_rad[begin:end], log.tau_Nm[begin:end]
        self._fewest = fewest_periods
        signals = np.column_stack([self._theta, self._tau])
        self._interval = float(self._time[-1] - self._time[0]) / (self._time.size - 1)
        grid = self._time[0] + self._interval * np.arange(self._time.size)
        if np.abs(grid - self._time).max() > 1e-3 * self._interval:
            signals = np.column_stack([np.interp(grid, self._time, s) for s in signals.T])
        self._grid, self._even = grid, signals

    def segments(self) -> list[Segment]:
        n = self._theta.shape[1]
        taken = np.zeros(self._time.size, bool)
        found: list[Segment] = []
        for candidate in self._best_first(sine_candidates(self._even[:, :n]), taken):
            for begin, end in self._steady(candidate):
                if not taken[begin:end].any() and (segment := self._single(begin, end, candidate)):
                    found.append(segment)
                    taken[begin:end] = True
        return found + list(self._multisines(taken))

    def _best_first(self, candidates: list[Candidate], taken: np.ndarray) -> Iterator[Candidate]:
        """Yield what is left of each candidate, longest first; ``taken`` grows meanwhile."""
        done = np.zeros(self._time.size, bool)
        failed: list[Candidate] = []
        for candidate in candidates:
            begin, end = int(candidate.begin), min(int(candidate.end), self._time.size)
            free = np.concatenate([[False], ~(taken | done)[begin:end], [False]])
            for first, last in np.flatnonzero(free[1:] != free[:-1]).reshape(-1, 2):
                left = replace(candidate, begin=begin + int(first), end=begin + int(last))
                if (last - first) * left.frequency < self._fewest or any(
                    _repeats(left, f) for f in failed
                ):
                    continue
                before = int(taken.sum())
                yield left
                if int(taken.sum()) > before:
                    # Edges of a run that was found look like sines of other frequencies.
                    done[int(left.begin) : int(left.end)] = True
                else:
                    failed.append(left)

    def _steady(self, candidate: Candidate) -> Iterator[tuple[int, int]]:
        """Settled stretches of one pattern inside a candidate."""
        offset = int(candidate.begin)
        part = self._even[offset : int(candidate.end)]
        rough = frames_of(part, candidate.frequency, periods=2, hop_periods=0.5)
        for first, last in runs(rough, max(3, round(2 * self._fewest) - 3)):
            begin = offset + int(rough.begin[first])
            end = offset + int(rough.begin[last - 1]) + rough.length
            inner = slice(begin + (end - begin) // 5, end - (end - begin) // 5)
            fit = fit_lines(
                self._grid[inner],
                self._even[inner],
                [self._nearby(candidate.frequency / self._interval, inner)],
                harmonics=_HARMONICS,
            )
            frequency = float(fit.frequency_hz[0]) * self._interval
            is_end = end >= self._time.size - 2 / frequency and last == len(rough.z)
            end = self._time.size if is_end else end
            fine = frames_of(
                self._even[begin:end], frequency, periods=1, hop_periods=1, to_the_end=is_end
            )
            if len(fine.z) < 2:
                continue
            from_, to = settled_part(fine, is_end=is_end)
            if (to - from_) * frequency >= self._fewest - 0.5:
                yield begin + from_, begin + to

    def _nearby(self, frequency_hz: float, part: slice) -> float:
        """Improve a frequency that is good to a few per cent: the best of a fine grid around it."""
        time = self._grid[part] - self._grid[part].mean()
        span = float(time[-1] - time[0])
        signals = self._even[part]
        columns = np.column_stack([np.ones_like(time), time / span])
        q, _ = np.linalg.qr(columns)
        rest = signals - q @ (q.T @ signals)
        rest = rest / np.maximum(np.sqrt((rest**2).mean(axis=0)), 1e-300)
        reach = max(0.08 * frequency_hz, 1 / span)
        tries = np.arange(frequency_hz - reach, frequency_hz + reach, 0.25 / span)
        tries = tries[tries > 0.3 / span]
        power = [np.linalg.norm(np.exp(-2j * np.pi * f * time) @ rest) for f in tries]
        return float(tries[int(np.argmax(power))]) if len(tries) else frequency_hz

    def _single(self, begin: int, end: int, candidate: Candidate) -> Segment | None:
        """A segment of one line, or None when others are there as well."""
        part = slice(begin, end)
        frequency = self._nearby(candidate.frequency / self._interval, part)
        segment = _measured(self._time[part], self._theta[part], self._tau[part], [frequency])
        away = abs(segment.frequency_hz * self._interval / candidate.frequency - 1)
        if segment.share < SHARE or away > 0.15:
            return None
        if segment.share < 0.98:
            lines = find_lines(self._time[part], self._theta[part])
            if len(_worth(self._time[part], self._theta[part], lines or [frequency])) > 1:
                return None
        return segment

    def _multisines(self, taken: np.ndarray) -> Iterator[Segment]:
        """Stretches of several lines among what no single sine explains."""
        free = np.concatenate([[False], ~taken, [False]])
        for first, last in np.flatnonzero(free[1:] != free[:-1]).reshape(-1, 2):
            for begin, end in self._moving(int(first), int(last)):
                part = slice(begin, end)
                lines = find_lines(self._time[part], self._theta[part])
                if not lines or min(lines) * (self._time[end - 1] - self._time[begin]) < self._fewest:
                    continue
                lines = _worth(self._time[part], self._theta[part], lines)
                fit = fit_lines(self._time[part], self._theta[part], lines, free=False)
                if len(lines) < 2 or fit.share.max() < SHARE:
                    continue
                segment = _measured(self._time[part], self._theta[part], self._tau[part], lines)
                if segment.share >= 0.9:
                    yield segment

    def _moving(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        """Where a stretch moves as much as it usually does, without its first and last parts."""
        length = max(8, round(0.25 / self._interval))
        if last - first < 8 * length:
            return
        n = self._theta.shape[1]
        part = self._even[first:last, :n]
        count = len(part) // length
        blocks = part[: count * length].reshape(count, length, n)
        size = blocks.std(axis=1)
        strong = np.quantile(size, 0.9, axis=0)
        moves = (size > 0.25 * np.maximum(strong, 1e-300)).any(axis=1) & np.any(strong > 0)
        moves = np.convolve(moves, np.ones(5), mode="same") >= 3  # a standstill between two beats
        edges = np.concatenate([[False], moves, [False]])
        for a, b in np.flatnonzero(edges[1:] != edges[:-1]).reshape(-1, 2):
            margin = max(2, (b - a) // 10)  # settling
            if b - a - 2 * margin >= 4:
                yield first + int(a + margin) * length, first + int(b - margin) * length
