"""Search for segments in a part of a log without gaps: candidates, then steady and settled runs.

Multisines are spans in which several lines are constant together. Windows of decreasing length are
examined. Where a few narrow lines hold nearly all of the motion, short frames are fitted with all of
them, and the steadiest frames grow to both sides while the phasors of all lines are constant. So neither
a rest nor another pattern nor a series of single sines is part of a run.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jointid.arrays import Complexes, Floats, true_runs
from jointid.importing.find.lines import MOST_LINES, find_lines, fit_lines, in_lines
from jointid.importing.find.segment import (
    FEWEST_PERIODS,
    HARMONICS,
    Segment,
    measured,
    significant_lines,
)
from jointid.importing.find.sine_candidates import Candidate, averaged, sine_candidates
from jointid.importing.find.steady_state import (
    SEED_FRAMES,
    Frames,
    frames_of,
    grown,
    settled_part,
    steady_runs,
    weighted,
)
from jointid.importing.map.mapped_log import MappedLog
from jointid.phasors.fitted_sine import sine_basis
from jointid.phasors.sensor_steps import quantum
from jointid.phasors.spectrum import evenly_sampled

_CHANCE_SHARE = 25.0  # share of the variance × samples, above that of a fit to noise
_MAX_OTHERS = 0.05  # power of other lines over that of a single sine
_OTHERS_BAND = 2.5  # times the frequency of a sine, below which other lines count
_MIN_TRAVEL = 0.05  # travel of a joint over the largest, below which its lines are ignored
_ROUGH_PHASE_RAD = 1e-3  # phase error over the run, small enough to see where it has settled
_MERGE_CYCLES = 0.1  # phase difference of two parts of one run
_MERGE_CHANGE = 0.06  # relative change of the phasors within both
_MERGE_GAP_PERIODS = 4  # longest pause between two parts of one run, or the shorter part
_HOP_PERIODS = 0.5  # between the frames in which the phase of a candidate is followed
_EDGE = 5  # part of a run at each end that does not count for its frequency: one fifth
_MULTISINE_WORK = 0.2  # share of the work, for the progress
_CANDIDATE_WORK = 0.3


class SegmentSearch:
    """Search rows of a log without gaps: on an even grid, measured at the original samples."""

    def __init__(self, log: MappedLog, begin: int, end: int) -> None:
        self._time = log.time_s[begin:end]
        self._theta, self._tau = log.theta_rad[begin:end], log.tau_Nm[begin:end]
        self._grid, self._even = evenly_sampled(self._time, np.column_stack([self._theta, self._tau]))
        self._interval = float(self._time[-1] - self._time[0]) / (self._time.size - 1)

    def segments(self, progress: Callable[[float], None]) -> list[Segment]:
        """Find single sines, and multisines where no clear sine is; ``progress`` gets the share done."""
        progress(0.0)
        candidates = sine_candidates(self._even, lambda share: progress(_CANDIDATE_WORK * share))
        clear = np.zeros(self._time.size, bool)
        work = 1 - _CANDIDATE_WORK - _MULTISINE_WORK
        singles = self._singles(
            candidates, clear, lambda share: progress(_CANDIDATE_WORK + work * share)
        )
        multisine_runs, several = [], np.zeros(self._time.size, bool)
        for begin, end, lines in multisines(
            self._grid, self._even, ~clear, lambda share: progress(1 - _MULTISINE_WORK * (1 - share))
        ):
            several[begin:end] = True
            multisine_runs.append(self._settled(begin, end, lines))
        # Parts of a multisine have looked like sines.
        found = [run for run in singles if not several[self._rows(run)].any()]
        return self._merged(sorted(found + multisine_runs, key=lambda s: s.start_s))

    def _merged(self, found: list[Segment]) -> list[Segment]:
        """Merge neighbours that are parts of one run: a single sine continues through both."""
        merged: list[Segment] = []
        for segment in found:
            if merged and (both := self._as_one(merged[-1], segment)):
                merged[-1] = both
            else:
                merged.append(segment)
        return merged

    def _as_one(self, one: Segment, two: Segment) -> Segment | None:
        gap, shorter = two.start_s - one.stop_s, min(s.stop_s - s.start_s for s in (one, two))
        cycles = abs(one.frequency_hz - two.frequency_hz) * (gap + shorter)
        several = one.is_multisine or two.is_multisine
        longest = max(shorter, _MERGE_GAP_PERIODS / one.frequency_hz)
        if several or cycles > _MERGE_CYCLES or gap > longest:
            return None
        longer = max(one, two, key=lambda s: s.stop_s - s.start_s)
        begin, end = self._rows(one).start, self._rows(two).stop
        y, noise = weighted(self._frames(begin, end, [longer.frequency_hz]).z)
        whole = grown(y, noise, change=_MERGE_CHANGE) == (0, len(y))
        return self._settled(begin, end, [longer.frequency_hz]) if whole else None

    def _singles(
        self, candidates: list[Candidate], clear: np.ndarray, progress: Callable[[float], None]
    ) -> list[Segment]:
        """Return the sines in the free parts of candidates, the best first.

        Those without any other line are marked in ``clear`` (N,).
        """
        found: list[Segment] = []
        blocked = np.zeros(self._time.size, bool)
        for number, candidate in enumerate(candidates):
            progress(number / len(candidates))
            begin, end = candidate.begin, min(candidate.end, self._time.size)
            for first, last in true_runs(~blocked[begin:end]):
                part = replace(candidate, begin=begin + first, end=begin + last)
                if (last - first) * part.frequency < FEWEST_PERIODS:
                    continue
                before = len(found)
                for low, high, near in self._steady(part):
                    if not blocked[low:high].any() and (run := self._single(low, high, near)):
                        rows = self._rows(run)
                        found.append(run)
                        blocked[rows] = True
                        one = len(excited_lines(self._grid[rows], self._even[rows])) == 1
                        clear[low:high] |= part == candidate and one
                if len(found) > before:
                    # The edges of a run that was found look like sines of other frequencies.
                    blocked[part.begin : part.end] = True
        return found

    def _steady(self, candidate: Candidate) -> Iterator[tuple[int, int, float]]:
        """Runs of one excitation pattern within a candidate, transients included, and their Hz."""
        part = self._even[candidate.begin : candidate.end]
        frames = frames_of(part, [candidate.frequency], periods=2, hop_periods=_HOP_PERIODS)
        hop = _HOP_PERIODS / candidate.frequency
        for begin, end, turn in steady_runs(frames, max(3, round(2 * FEWEST_PERIODS) - 3)):
            frequency = candidate.frequency + turn / (2 * np.pi * hop)
            if frequency > 0:  # rounding noise of a joint at rest turns either way
                yield candidate.begin + begin, candidate.begin + end, frequency / self._interval

    def _single(self, begin: int, end: int, near: float) -> Segment | None:
        """Return the settled part of a run, or None when it is short or other lines are present."""
        edge = (end - begin) // _EDGE
        inner = slice(begin + edge, end - edge)
        lines = self._fitted(inner, [near], harmonics=HARMONICS, within=_ROUGH_PHASE_RAD)
        segment = self._settled(begin, end, lines)
        part = self._rows(segment)
        # Motion without torque is a flickering last digit, torque without motion is hum; both together
        # are a sine, however coarse the encoder.
        chance = min(segment.share, segment.torque_share) < _CHANCE_SHARE / (part.stop - part.start)
        if chance or segment.periods < FEWEST_PERIODS - 0.5:
            return None
        return segment if self._others(part, segment.frequency_hz) < _MAX_OTHERS else None

    def _rows(self, segment: Segment) -> slice:
        begin, last = np.searchsorted(self._time, [segment.start_s, segment.stop_s]).tolist()
        return slice(begin, last + 1)

    def _fitted(self, part: slice, lines: Sequence[float], **how: Any) -> list[float]:
        """Frequencies of lines fitted to a part, Hz."""
        fit = fit_lines(self._grid[part], self._even[part], lines, **how)
        return [float(f) for f in fit.frequency_hz]

    def _settled(self, begin: int, end: int, lines: Sequence[float]) -> Segment:
        """Measure the settled part of a run of constant lines."""
        several = len(lines) > 1
        is_end = end > self._time.size - 2 / (min(lines) * self._interval)
        end = self._time.size if is_end else end
        frames = self._frames(begin, end, lines)
        if several and len(frames.z) >= 10:
            # The transients at both ends have biased the frequencies, so that all phasors rotate.
            inner = slice(begin + int(frames.begin[2]), begin + int(frames.begin[-2]))
            lines = self._fitted(inner, lines)
            frames = self._frames(begin, end, lines)
        if len(frames.z):
            # A multisine was grown by frames with half overlap: it began within the first two.
            outer = 2 * (several and len(frames.z) >= 12)
            fewest = np.ceil(FEWEST_PERIODS / min(lines) / (self._interval * frames.length))
            first, last = settled_part(
                Frames(frames.begin[outer:], frames.length, frames.z[outer:]),
                is_end=is_end,
                fewest=int(fewest) * (1 + several),
                step=np.repeat([quantum(signal) for signal in self._even[begin:end].T], len(lines)),
            )
            if not is_end or last < frames.begin[-1] + frames.length:
                end = begin + last
            begin += first
        part = slice(begin, end)
        return measured(self._time[part], self._theta[part], self._tau[part], lines)

    def _frames(self, begin: int, end: int, lines: Sequence[float]) -> Frames:
        return frames_of(self._even[begin:end], np.asarray(lines) * self._interval)

    def _others(self, part: slice, frequency_hz: float) -> float:
        """Power near a sine that the sine and its harmonics do not explain, over that of the sine.

        Part of a beat looks like a sine of one frequency; its residual lies nearby, unlike noise.
        """
        time, theta = self._grid[part], self._even[part, : self._theta.shape[1]]
        theta = theta[:, np.ptp(theta, axis=0) > _MIN_TRAVEL * np.ptp(theta, axis=0).max()]
        theta = theta / theta.std(axis=0)
        omega = 2 * np.pi * frequency_hz * np.arange(1, HARMONICS + 1)
        clock = time - (time[0] + time[-1]) / 2
        basis = sine_basis(np.outer(clock, omega), clock)
        q, _ = np.linalg.qr(basis[:, [-2, -1, *range(2 * HARMONICS)]])
        rest = theta - q @ (q.T @ theta)
        line = q[:, [2, 2 + HARMONICS]].T @ theta
        power = (np.abs(np.fft.rfft(rest, axis=0)) ** 2).sum(axis=1) * 2 / time.size
        edge = int(np.ceil(_OTHERS_BAND * frequency_hz * (time[-1] - time[0]))) + 1
        near, above = power[1:edge], power[edge:]
        # White noise has the same density above the band; ln 2 is the median of unit power.
        noise = float(np.median(above)) / np.log(2) * near.size if above.size > near.size else 0.0
        excess, total = max(near.sum() - noise, 0.0), float((line**2).sum())
        return float(excess / total) if total > 0 else np.inf


_SHORTEST = 512  # samples of a window
_LONGEST = 1 << 15  # the same, beyond which its samples are averaged
_MIN_IN_LINES = 0.85  # share of the power around the lines that must lie on them
_CHANGE = 0.03  # relative change of the phasors that ends a run; the frequencies are known well
_MAX_ROUNDS = 8  # of growing, each to three times the length at most
_MIN_EXPLAINED = 0.9  # share of the motion that the lines must explain


def multisines(
    time: Floats, signals: Floats, free: np.ndarray, progress: Callable[[float], None]
) -> Iterator[tuple[int, int, list[float]]]:
    """Yield begin and end of the spans in which several lines are constant, and these lines in Hz.

    ``time`` (N,) is evenly spaced; ``signals`` (N, 2n) are positions, then torques. Runs lie where
    ``free`` (N,) is true, and are removed from it. ``progress`` gets the share done.
    """
    lengths = [len(time), *(1 << k for k in reversed(range(len(time).bit_length())))]
    lengths = [length for length in lengths if length >= _SHORTEST]
    for number, length in enumerate(lengths):
        progress(number / len(lengths))
        for begin in range(0, len(time) - length + 1, length // 2):
            window = slice(begin, begin + length)
            if not free[window].all():
                continue
            lines = excited_lines(time[window], signals[window], _MIN_IN_LINES)
            if len(lines) < 2:
                continue
            part = _free_around(free, begin, begin + length)
            found = _grown_run(time[part], signals[part], begin - part.start, length, lines)
            if found is None:
                continue
            first, last, lines = found
            if (last - first) * (time[1] - time[0]) * min(lines) < FEWEST_PERIODS:
                continue
            free[part.start + first : part.start + last] = False
            yield part.start + first, part.start + last, lines


def excited_lines(time: Floats, signals: Floats, share: float = 0.0) -> list[float]:
    """Return the excited lines of a span, Hz; none if too little of the power around them is on them.

    Shapes and order as in ``multisines``; long spans are averaged.
    """
    width = max(1, len(time) // _LONGEST)
    time = averaged(time, width)
    theta, tau = np.hsplit(averaged(signals, width), 2)
    lines = find_lines(time, theta, tau)
    if len(lines) > 1 and (len(lines) == MOST_LINES or in_lines(time, theta, lines) < share):
        return []
    return significant_lines(time, theta, tau, lines) if len(lines) > 1 else lines


def _free_around(free: np.ndarray, begin: int, end: int) -> slice:
    """Largest free slice around a window."""
    before, after = np.flatnonzero(~free[:begin]), np.flatnonzero(~free[end:])
    first = int(before[-1]) + 1 if before.size else 0
    return slice(first, end + int(after[0]) if after.size else len(free))


def _grown_run(
    time: Floats, signals: Floats, begin: int, length: int, lines: list[float]
) -> tuple[int, int, list[float]] | None:
    """Grow from the steadiest frames of a window while all lines are constant."""
    interval = float(time[1] - time[0])
    first, last = begin, begin + length
    for attempt in range(_MAX_ROUNDS):
        part = slice(first, last)
        if attempt:
            lines = excited_lines(time[part], signals[part])
        if len(lines) < 2:
            return None
        lines = [float(f) for f in fit_lines(time[part], signals[part], lines).frequency_hz]
        # Frames far from the part cost time and cannot be reached in this round.
        low, high = max(0, first - (last - first)), min(len(time), last + (last - first))
        frames = frames_of(signals[low:high], np.array(lines) * interval)
        inside = (frames.begin + low >= first) & (frames.begin + low + frames.length <= last)
        if inside.sum() < SEED_FRAMES:
            return None
        seeds = np.flatnonzero(inside)
        y = _by_size(frames.z, signals.shape[1])
        noise = weighted(y[inside])[1]
        from_, to = grown(y, noise, slice(int(seeds[0]), int(seeds[-1]) + 1), _CHANGE)
        if to - from_ < SEED_FRAMES:
            return None
        new = low + int(frames.begin[from_]), low + int(frames.begin[to - 1]) + frames.length
        if attempt and new == (first, last):
            break
        first, last = new
    explained = in_lines(time[first:last], signals[first:last, : signals.shape[1] // 2], lines)
    return (first, last, lines) if explained > _MIN_EXPLAINED else None


def _by_size(z: Complexes, signals: int) -> Complexes:
    """Normalise each signal by all its lines, so that a weak line of a quiet joint weighs little."""
    by_signal = z.reshape(len(z), signals, -1)
    size = np.sqrt((np.abs(by_signal) ** 2).sum(axis=2).mean(axis=0))
    scaled: Complexes = by_signal / np.where(size > 0, size, 1.0)[:, None]
    return scaled.reshape(len(z), -1)
