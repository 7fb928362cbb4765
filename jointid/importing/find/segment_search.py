"""A part of a log without gaps: from candidates to settled, measured segments."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from jointid.arrays import Floats
from jointid.importing.find.line_fit import fit_lines
from jointid.importing.find.multisines import multisines
from jointid.importing.find.segment import HARMONICS, Segment, line_sizes, measured
from jointid.importing.find.sine_search import SHARE, Candidate, sine_candidates
from jointid.importing.find.steady_state import (
    frames_of,
    line_frames,
    runs,
    settled_frames,
    settled_part,
    stands_still,
)
from jointid.importing.map.mapped_log import MappedLog

_BY_CHANCE = 25.0  # over the number of samples: more of its variance than noise lends to a fit

_OTHERS = 0.05  # share of the motion about a single sine that it may leave
_ABOUT = 2.5  # times the frequency of the sine: up to there other lines would be
_MOVES = 0.05  # travel of a joint over the largest, below which it is not asked
_ROUGHLY = 1e-3  # rad over the run to which a frequency is needed to see where it is settled
_SAME = 0.1  # turns that two parts of one run may seem to differ by
_MANY = 0.15  # share of the work that goes into several lines at once
_SEARCH = 0.4  # the same with the candidates


def _repeats(candidate: Candidate, tried: Candidate) -> bool:
    """Whether a candidate is the same stretch at nearly the same frequency as one tried before."""
    inside = tried.begin <= candidate.begin and candidate.end <= tried.end
    return inside and abs(candidate.frequency / tried.frequency - 1) < 0.15


class Stretch:
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

    def segments(self, tell: Callable[[float], None]) -> list[Segment]:
        """Several lines at once first, then single sines in the rest; ``tell`` the share done."""
        tell(0.0)
        n = self._theta.shape[1]
        taken = np.zeros(self._time.size, bool)
        found: list[Segment] = []
        theta, tau = self._even[:, :n], self._even[:, n:]
        for begin, end, lines in multisines(
            self._grid, theta, tau, self._fewest, lambda share: tell(_MANY * share)
        ):
            taken[begin:end] = True
            found.append(self._settled(begin, end, lines))
        candidates = sine_candidates(self._even, lambda share: tell(_MANY + (_SEARCH - _MANY) * share))
        for candidate in self._best_first(candidates, taken, tell):
            for begin, end in self._steady(candidate):
                if not taken[begin:end].any() and (segment := self._single(begin, end, candidate)):
                    found.append(segment)
                    taken[begin:end] = True
        return self._joined(sorted(found, key=lambda s: s.start_s))

    def _joined(self, found: list[Segment]) -> list[Segment]:
        """Make one of neighbours that are parts of the same run: one sine goes through both."""
        joined: list[Segment] = []
        for segment in found:
            if joined and (both := self._as_one(joined[-1], segment)):
                joined[-1] = both
            else:
                joined.append(segment)
        return joined

    def _as_one(self, one: Segment, two: Segment) -> Segment | None:
        if one.is_multisine or two.is_multisine:
            return None
        gap, shorter = two.start_s - one.stop_s, min(s.stop_s - s.start_s for s in (one, two))
        parted = abs(one.frequency_hz - two.frequency_hz) * (gap + shorter)
        if parted > _SAME or gap > max(shorter, 4 / one.frequency_hz):
            return None
        longer = max(one, two, key=lambda s: s.stop_s - s.start_s)
        begin, end = np.searchsorted(self._grid, [one.start_s, two.stop_s]).tolist()
        frames = line_frames(self._grid[begin:end], self._even[begin:end], [longer.frequency_hz])
        if not stands_still(frames.z):
            return None
        return self._settled(begin, end, [longer.frequency_hz])

    def _best_first(
        self, candidates: list[Candidate], taken: np.ndarray, tell: Callable[[float], None]
    ) -> Iterator[Candidate]:
        """Yield what is left of each candidate, longest first; ``taken`` grows meanwhile."""
        done = np.zeros(self._time.size, bool)
        failed: list[Candidate] = []
        for number, candidate in enumerate(candidates):
            tell(_SEARCH + (1 - _SEARCH) * number / len(candidates))
            begin, end = int(candidate.begin), min(int(candidate.end), self._time.size)
            free = np.concatenate([[False], ~(taken[begin:end] | done[begin:end]), [False]])
            for first, last in np.flatnonzero(free[1:] != free[:-1]).reshape(-1, 2):
                left = replace(candidate, begin=begin + int(first), end=begin + int(last))
                if (last - first) * left.frequency < self._fewest or any(
                    _repeats(left, f) for f in failed
                ):
                    continue
                part = slice(int(left.begin), int(left.end))
                before = int(taken[part].sum())
                yield left
                if int(taken[part].sum()) > before:
                    # Edges of a run that was found look like sines of other frequencies.
                    done[part] = True
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
                harmonics=HARMONICS,
                within=_ROUGHLY,
            )
            frequency = float(fit.frequency_hz[0]) * self._interval
            is_end = end >= self._time.size - 2 / frequency and last == len(rough.z)
            end = self._time.size if is_end else end
            fine = frames_of(
                self._even[begin:end], frequency, periods=1, hop_periods=1, to_the_end=is_end
            )
            if len(fine.z) < 2:
                continue
            from_, to = settled_part(fine, is_end=is_end, step=_steps(self._even[begin:end]))
            if (to - from_) * frequency >= self._fewest - 0.5:
                yield begin + from_, begin + to

    def _nearby(self, frequency_hz: float, part: slice) -> float:
        """Improve a frequency that is good to a few per cent: the best of a fine grid around it."""
        span = float(self._grid[part.stop - 1] - self._grid[part.start])
        signals = self._even[part]
        count = len(signals)
        columns = np.column_stack([np.ones(count), np.linspace(-1, 1, count)])
        q, _ = np.linalg.qr(columns)
        rest = signals - q @ (q.T @ signals)
        rest = rest / np.maximum(np.sqrt((rest**2).mean(axis=0)), 1e-300)
        reach = max(0.08 * frequency_hz, 1 / span)
        resolution = 0.25 / (count * self._interval)
        low = max(frequency_hz - reach, 0.3 / span)
        tries = np.arange(int(np.ceil(low / resolution)), int((frequency_hz + reach) / resolution) + 1)
        spectrum = np.fft.rfft(rest, n=4 * count, axis=0)
        tries = tries[tries < len(spectrum)]
        power = np.linalg.norm(spectrum[tries], axis=1)
        return float(resolution * tries[int(np.argmax(power))]) if len(tries) else frequency_hz

    def _single(self, begin: int, end: int, candidate: Candidate) -> Segment | None:
        """A segment of one line, or None when others are there as well."""
        part = slice(begin, end)
        frequency = self._nearby(candidate.frequency / self._interval, part)
        segment = measured(self._time[part], self._theta[part], self._tau[part], [frequency])
        away = abs(segment.frequency_hz * self._interval / candidate.frequency - 1)
        if away > 0.15 or max(segment.share, segment.torque_share) < SHARE:
            return None
        # A joint that moves without torque is a sensor's last digit that flickers; a torque that moves
        # nothing is hum. Both at once are a sine, however coarse the encoder is.
        if min(segment.share, segment.torque_share) < _BY_CHANCE / (end - begin):
            return None
        if not any(self._moves_at(part, segment.frequency_hz)):
            return None
        if self._others(part, segment.frequency_hz) > _OTHERS:
            return None
        return self._settled(begin, end, [segment.frequency_hz])

    def _settled(self, begin: int, end: int, lines: Sequence[float]) -> Segment:
        """Measure the settled part of a stretch in which these lines stand still."""
        frames = line_frames(self._grid[begin:end], self._even[begin:end], lines)
        if len(lines) > 1 and len(frames.z) >= 10:
            # What begins and ends has bent the frequencies, and so all phasors turn.
            inner = slice(begin + int(frames.begin[2]), begin + int(frames.begin[-2]))
            fit = fit_lines(self._grid[inner], self._even[inner], lines)
            lines = [float(f) for f in fit.frequency_hz]
            frames = line_frames(self._grid[begin:end], self._even[begin:end], lines)
        fewest = np.ceil(self._fewest / min(lines) / (self._interval * frames.length))
        if len(frames.z):
            # A run of several lines grew by frames that overlap by half: it began within the first two.
            outer = 2 * int(len(lines) > 1 and len(frames.z) >= 12)
            first, last = settled_frames(
                frames.z[outer : len(frames.z) - outer // 2],
                int(fewest * (1 if len(lines) == 1 else 2)),
                np.repeat(_steps(self._even[begin:end]), len(lines)),
            )
            first, last = first + outer, last + outer
            end = end if last == len(frames.z) else begin + int(frames.begin[last - 1]) + frames.length
            begin += int(frames.begin[first])
        part = slice(begin, end)
        return measured(self._time[part], self._theta[part], self._tau[part], lines)

    def _moves_at(self, part: slice, frequency_hz: float) -> Iterator[bool]:
        """Whether each joint's position has a line that is clear of the noise about it."""
        n = self._theta.shape[1]
        size, floor, moved = line_sizes(self._grid[part], self._even[part, :n], np.array([frequency_hz]))
        for j in range(n):
            # Half of the motion is a line by itself: short runs have no spectrum beside it.
            yield bool(moved[j] > 0 and size[0, j] > min(5 * floor[0, j], 1.5 * moved[j]))

    def _others(self, part: slice, frequency_hz: float) -> float:
        """Share of what moves about a sine that the sine and its harmonics do not explain.

        A part of a beat looks like a sine of one frequency; what is left of it lies close by, unlike
        noise, which lies everywhere.
        """
        time, theta = self._grid[part], self._even[part, : self._theta.shape[1]]
        theta = theta[:, np.ptp(theta, axis=0) > _MOVES * np.ptp(theta, axis=0).max()]
        theta = theta / theta.std(axis=0)
        basis = [np.ones_like(time), np.linspace(-1, 1, time.size)]
        basis += [
            wave(2 * np.pi * h * frequency_hz * time)
            for h in range(1, HARMONICS + 1)
            for wave in (np.cos, np.sin)
        ]
        q, _ = np.linalg.qr(np.column_stack(basis))
        rest = theta - q @ (q.T @ theta)
        line = q[:, 2:4].T @ theta
        power = (np.abs(np.fft.rfft(rest, axis=0)) ** 2).sum(axis=1) * 2 / time.size
        bins = frequency_hz * (time[-1] - time[0])
        about = power[1 : int(np.ceil(_ABOUT * bins)) + 1]
        # White noise has as much above, which is taken off.
        above = power[int(np.ceil(_ABOUT * bins)) + 1 :]
        noise = float(np.median(above)) / np.log(2) * about.size if above.size > about.size else 0.0
        left, there = max(about.sum() - noise, 0.0), float((line**2).sum())
        return float(left / there) if there > 0 else np.inf


def _steps(signals: Floats) -> Floats:
    """Step of each signal that is rounded coarsely, 0 of the others, shape (c,)."""
    steps = np.zeros(signals.shape[1])
    for c, signal in enumerate(signals.T):
        values = np.unique(signal)
        if 1 < values.size < len(signal) / 4:
            apart = np.diff(values)
            steps[c] = float(apart[apart > 1e-9 * apart.max()].min())
    return steps
