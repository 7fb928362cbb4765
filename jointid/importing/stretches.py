"""A part of a log without gaps: from candidates to settled, measured segments."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from jointid.importing.line_fit import fit_lines
from jointid.importing.lines import find_lines
from jointid.importing.mapped_log import MappedLog
from jointid.importing.segment import HARMONICS, Segment, lines_worth, measured
from jointid.importing.sine_search import SHARE, Candidate, sine_candidates
from jointid.importing.steady import frames_of, runs, settled_part

_BY_CHANCE = 25.0  # over the number of samples: more of its variance than noise lends to a fit

_SEARCH = 0.3  # share of the work that goes into the candidates


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
        """Single sines first, then what several lines explain of the rest; ``tell`` the share done."""
        tell(0.0)
        n = self._theta.shape[1]
        taken = np.zeros(self._time.size, bool)
        found: list[Segment] = []
        candidates = sine_candidates(self._even[:, :n], lambda share: tell(_SEARCH * share))
        for candidate in self._best_first(candidates, taken, tell):
            for begin, end in self._steady(candidate):
                if not taken[begin:end].any() and (segment := self._single(begin, end, candidate)):
                    found.append(segment)
                    taken[begin:end] = True
        return found + list(self._multisines(taken))

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
        segment = measured(self._time[part], self._theta[part], self._tau[part], [frequency])
        away = abs(segment.frequency_hz * self._interval / candidate.frequency - 1)
        if segment.share < SHARE or away > 0.15:
            return None
        if segment.torque_share < _BY_CHANCE / (end - begin):
            return None  # a joint that moves without torque is a sensor's last digit that flickers
        if segment.share < 0.98:
            lines = find_lines(self._time[part], self._theta[part])
            if len(lines_worth(self._time[part], self._theta[part], lines or [frequency])) > 1:
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
                lines = lines_worth(self._time[part], self._theta[part], lines)
                fit = fit_lines(self._time[part], self._theta[part], lines, free=False)
                if len(lines) < 2 or fit.share.max() < SHARE:
                    continue
                segment = measured(self._time[part], self._theta[part], self._tau[part], lines)
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
