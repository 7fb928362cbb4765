"""Where a sine is steady: same amplitude and phase of every signal, no change of pattern, settled.

The phasors of all signals in short frames, turned back by the frequency, stand still in a steady run.
Growing from the quietest place to both sides until they move finds its ends; another pattern of the
joints at the same frequency moves them as much as rest does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats

PATTERN = 0.12
"""Relative change of the phasors, over all signals, that makes another run."""
SETTLED = 0.01
"""Relative distance from the steady phasors below which a run has settled."""

_STAYS = 0.03  # the same of all lines of a multisine, whose frequencies are known well
_SEED = 5  # frames
_APART = 1.5  # over the distance of the closest lines: what a frame needs to tell them apart
_PERIODS = 2.0  # of the lowest of several lines in a frame
_ROUNDING = 0.15  # of its step by which rounding may shift a sine's phasor
_CLEARLY = 4.5  # standard errors; a record is said to be settling above five
_PARTED = 10.0  # how much less two sines must leave than one to be two runs
_TURNS = 0.3  # rad that they part over the shorter of them
_MOST_NOISE = 0.4  # relative change that noise may excuse
_MEDIAN = 0.83  # median size of a complex normal number over its root mean square
_SCATTERS = 3.5  # times the usual that noise may move a frame's phasors


@dataclass(frozen=True, eq=False)
class Frames:
    """Phasors of all signals in frames of a few periods."""

    begin: np.ndarray
    """First sample of each frame, shape (m,)."""
    length: int
    """Samples of each frame."""
    z: Complexes
    """Phasors on the clock of sample 0, shape (m, c)."""


def frames_of(
    signals: Floats, frequency: float, periods: float, hop_periods: float, *, to_the_end: bool = False
) -> Frames:
    """Fit sine, offset and drift in every frame.

    Parameters
    ----------
    signals : ndarray, shape (N, c)
        Evenly sampled.
    frequency : float
        Cycles per sample.
    periods, hop_periods : float
        Length of the frames and distance of their beginnings.
    to_the_end : bool, default False
        Add a frame that ends with the last sample.
    """
    length = max(4, round(periods / frequency))
    count = int((len(signals) - length) * frequency / hop_periods + 1e-9) + 1
    if len(signals) < length:
        return Frames(np.empty(0, int), length, np.empty((0, signals.shape[1]), complex))
    begin = np.minimum(
        np.round(np.arange(count) * hop_periods / frequency).astype(int), len(signals) - length
    )
    if to_the_end and begin[-1] + length < len(signals):
        begin = np.append(begin, len(signals) - length)
        count += 1
    x = 2 * np.pi * frequency
    j = np.arange(length) - (length - 1) / 2
    columns = np.column_stack([np.cos(x * j), np.sin(x * j), np.ones(length), j / length])
    weights = np.linalg.pinv(columns)[:2]
    waves = weights[1] + 1j * weights[0]
    z = np.empty((count, signals.shape[1]), complex)
    for c, signal in enumerate(signals.T):
        windows = np.lib.stride_tricks.sliding_window_view(signal, length)
        z[:, c] = [windows[b] @ waves for b in begin] if count < 64 else _gathered(windows, begin, waves)
    turn = np.exp(-1j * x * (begin + (length - 1) / 2))
    return Frames(begin, length, z * turn[:, None])


def line_frames(time: Floats, signals: Floats, lines_hz: Sequence[float]) -> Frames:
    """Fit all lines, offset and drift in frames: of one period of a single line, side by side, and of
    what tells several lines apart, overlapping by half.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Even.
    signals : ndarray, shape (N, c)
    lines_hz : sequence of float

    Returns
    -------
    Frames
        With phasors on the clock of the first sample, signal by signal, shape (m, c lines).
    """
    interval = float(time[-1] - time[0]) / (len(time) - 1)
    omega = 2 * np.pi * np.sort(np.asarray(lines_hz, float)) * interval
    if len(omega) == 1:
        length = hop = max(4, round(2 * np.pi / float(omega[0])))
    else:
        apart = float(np.diff(omega).min())
        length = int(np.ceil(2 * np.pi * max(_APART / apart, _PERIODS / float(omega[0]))))
        hop = max(1, length // 2)
    if length > len(time):
        return Frames(np.empty(0, int), length, np.empty((0, signals.shape[1] * len(omega)), complex))
    begin = np.arange(0, len(time) - length + 1, hop)
    j = np.arange(length) - (length - 1) / 2
    columns = np.column_stack(
        [np.cos(np.outer(j, omega)), np.sin(np.outer(j, omega)), np.ones(length), j / length]
    )
    weights = np.linalg.pinv(columns)[: 2 * len(omega)]
    waves = weights[len(omega) :] + 1j * weights[: len(omega)]
    turn = np.exp(-1j * np.outer(begin + (length - 1) / 2, omega))
    z = np.empty((len(begin), signals.shape[1], len(omega)), complex)
    for k, b in enumerate(begin):
        z[k] = (waves @ signals[b : b + length]).T * turn[k]
    return Frames(begin, length, z.reshape(len(begin), -1))


def _gathered(windows: np.ndarray, begin: np.ndarray, waves: Complexes) -> Complexes:
    step = max(1, (1 << 20) // len(waves))
    parts = [windows[begin[k : k + step]] @ waves for k in range(0, len(begin), step)]
    return np.concatenate(parts)


def runs(frames: Frames, fewest: int) -> Iterator[tuple[int, int]]:
    """Yield the steady runs as first and one past the last frame, the longest-lived seeds first.

    Parameters
    ----------
    frames : Frames
        They may overlap; the hop is half a period.
    fewest : int
        Frames that a run needs.
    """
    y, noise = _weighted(frames.z)
    apart = int(np.searchsorted(frames.begin, frames.begin[0] + frames.length)) if len(y) else 0
    todo = [(0, len(y))]
    while todo:
        low, high = todo.pop()
        if high - low < max(fewest, _SEED):
            continue
        first, last = _grown(y[low:high], noise)
        if last - first < _SEED:
            continue
        first, last = first + low, last + low
        pieces = _parted(y[first:last], apart)
        yield from ((first + a, first + b) for a, b in pieces if b - a >= fewest)
        todo += [(low, first - apart + 1), (last + apart - 1, high)]


def grown(z: Complexes, low: int, high: int) -> tuple[int, int]:
    """Grow the quietest frames of ``low`` to ``high`` to both sides as long as they stand still.

    Parameters
    ----------
    z : ndarray, shape (m, c)
        Phasors of frames that overlap by half.
    low, high : int

    Returns
    -------
    first, last : int
        The first and one past the last; equal where nothing stands still.
    """
    y, noise = _weighted(z[low:high])
    if len(y) < _SEED:
        return low, low
    first, last = _grown(y, noise)
    if first > 0 or last < len(y) or last - first < _SEED:
        return low + first, low + last
    centre = z[low:high].mean(axis=0)
    size = float(np.linalg.norm(centre))
    away = np.linalg.norm(z - centre, axis=1)
    noise = float(np.median(away[low:high]))
    most = max(_STAYS * size, min(3 * noise, _MOST_NOISE * size))
    while low > 0 and away[low - 1] <= most:
        low -= 1
    while high < len(z) and away[high] <= most:
        high += 1
    return low, high


def settled_part(frames: Frames, *, is_end: bool, step: Floats | None = None) -> tuple[int, int]:
    """Find what has settled among frames of one period.

    Parameters
    ----------
    frames : Frames
    is_end : bool
        The log ends here while the sine goes on. Otherwise the last frame that looks steady may hold
        the beginning of the run's end, and is left out.
    step : ndarray, shape (c,), optional
        Of what is rounded, see ``settled_frames``.

    Returns
    -------
    first, last : int
        First sample and one past the last.
    """
    first, last = _standing(frames, drifts=False)
    if last - first < len(frames.z) / 2:
        # A change that goes on for the whole run, such as friction that warms up, is no settling.
        first, last = _standing(frames, drifts=True)
    last -= not is_end and len(frames.z) >= 8
    least = _ROUNDING * (np.zeros(frames.z.shape[1]) if step is None else step)
    first = _settled_first(frames.z, first, last, least)
    first = min(first, len(frames.z) - 1)
    last = max(last, first + 1)
    return int(frames.begin[first]), int(frames.begin[last - 1]) + frames.length


def stands_still(z: Complexes) -> bool:
    """Whether the phasors of all frames stay where they are, as far as their noise tells.

    Parameters
    ----------
    z : ndarray, shape (m, c)
    """
    y, noise = _weighted(z)
    if len(y) < 2:
        return False
    centre, turn, origin = _steady(y, 0)
    size = float(np.linalg.norm(centre))
    most = max(PATTERN / 2 * size, min(3 * noise, _MOST_NOISE * size))
    return all(_near(y[k], centre, turn * (k - origin), most) for k in range(len(y)))


def settled_frames(z: Complexes, fewest: int, step: Floats) -> tuple[int, int]:
    """Leave out frames at both ends until the first quarter agrees with the second half.

    That is the measure by which a record is later said to be still settling. The beginning counts once
    it agrees from the next frame on as well. A change that goes on until the fewest frames, or a
    quarter of all, are left is no settling: then only the end is cut.

    Parameters
    ----------
    z : ndarray, shape (m, c)
    fewest : int
    step : ndarray, shape (c,)
        Of what is rounded: below a part of it no change is evidence.

    Returns
    -------
    first, last : int
    """
    count = len(z)
    if count < 8:
        return 0, count
    half = z[count // 2 :]
    centre = np.median(half.real, axis=0) + 1j * np.median(half.imag, axis=0)
    away = np.abs(half - centre)
    usual = np.median(away, axis=0) / _MEDIAN
    wrong = np.asarray(
        (away > np.maximum(2 * SETTLED * np.abs(centre) + 2 * _ROUNDING * step, _SCATTERS * usual)).any(
            axis=1
        )
    )
    # One frame by itself is chance, the last two frames or the last one are the run's end.
    wrong = wrong & np.append(wrong[1:], True)
    late = np.flatnonzero(wrong[len(wrong) // 2 :])
    last = count // 2 + len(wrong) // 2 + int(late[0]) if late.size else count
    most = last - max(fewest, last // 4, 8)
    before = False
    for first in range(0, most + 1, max(1, last // 128)):
        now = _is_settled(z[first:last], _ROUNDING * step)
        if now and (before or first == 0):
            return first, last
        before = now
    return 0, last


def _is_settled(z: Complexes, least: Floats) -> bool:
    early, late = z[: len(z) // 4], z[len(z) // 2 :]
    amplitude = np.abs(z.mean(axis=0))
    change = np.abs(early.mean(axis=0) - late.mean(axis=0))
    scatter = np.sqrt((np.abs(late - late.mean(axis=0)) ** 2).sum(axis=0) / (len(late) - 1))
    error = scatter * np.sqrt(1 / len(early) + 1 / len(late))
    return bool(
        np.all(change <= np.maximum(np.maximum(SETTLED / 2 * amplitude, least), _CLEARLY * error))
    )


def _standing(frames: Frames, *, drifts: bool) -> tuple[int, int]:
    """Frames about the middle whose phasors stay where the second half has them, or on their line."""
    z, count = frames.z, len(frames.z)
    place = frames.begin / max(int(frames.begin[-1]), 1)
    inner = (place > (0.3 if drifts else 0.5)) & (place < 0.95) if count >= 8 else np.ones(count, bool)
    columns = np.column_stack([np.ones(count), place] if drifts else [np.ones(count)])
    model = columns @ np.linalg.lstsq(columns[inner].astype(complex), z[inner], rcond=None)[0]
    away = np.abs(z - model)
    noise = np.median(away[inner], axis=0) / _MEDIAN
    least = SETTLED * np.abs(model[inner]).mean(axis=0)
    wrong = (away > np.maximum(least, _SCATTERS * noise)).any(axis=1)
    middle = 3 * count // 4 if not drifts else count // 2
    before, after = np.flatnonzero(wrong[:middle]), np.flatnonzero(wrong[middle:])
    first = int(before[-1]) + 1 if before.size else 0
    return first, middle + int(after[0]) if after.size else count


def _settled_first(z: Complexes, first: int, last: int, step: Floats) -> int:
    """Leave out frames at the beginning until the first quarter agrees with the second half.

    A slow tail hides in the noise of single frames. What does not end by the middle is no settling.
    """
    noise = _noise(z[first:last])
    for begin in range(first, (first + last) // 2):
        count = last - begin
        if count < 8:
            break
        early, late = (
            z[begin : begin + count // 4].mean(axis=0),
            z[last - count // 2 : last].mean(axis=0),
        )
        error = noise * np.sqrt(1 / (count // 4) + 1 / (count // 2))
        least = np.maximum(SETTLED / 2 * np.abs(late), step)
        if np.all(np.abs(early - late) <= np.maximum(least, _SCATTERS * error)):
            return begin
    return first


def _noise(z: Complexes) -> Floats:
    """Usual size of what is random in each signal's frames, whatever drifts, shape (c,)."""
    if len(z) < 3:
        return np.zeros(z.shape[1])
    bend = np.abs(z[2:] - 2 * z[1:-1] + z[:-2])
    return np.asarray(np.median(bend, axis=0) / np.sqrt(6) / _MEDIAN)


def _weighted(z: Complexes) -> tuple[Complexes, float]:
    """Signals to a common size, those that drown in noise smaller; and the noise of all together."""
    if len(z) == 0:
        return z, 0.0
    size = np.sqrt(np.mean(np.abs(z) ** 2, axis=0))
    lag = min(4, len(z) - 1)
    change = np.abs(z[lag:] - z[: len(z) - lag]) if lag else np.zeros((1, z.shape[1]))
    noise = np.median(change, axis=0) / np.sqrt(2)
    scale = np.sqrt(size**2 + (5 * noise) ** 2)
    scale = np.where(scale > 0, scale, 1.0)
    return np.asarray(z / scale), float(np.linalg.norm(noise / scale))


def _grown(y: Complexes, noise: float) -> tuple[int, int]:
    """Grow from the quietest frames to both sides, as long as the phasors stay where they are."""
    seeds = len(y) - _SEED + 1
    misfit = np.array([_misfit(y[a : a + _SEED]) for a in range(seeds)])
    first = int(np.argmin(misfit))
    last = first + _SEED
    centre, turn, origin = _steady(y[first:last], first)
    size = float(np.linalg.norm(centre))
    most = max(PATTERN * size, min(3 * noise, _MOST_NOISE * size))
    if misfit[first] * size > most:
        return 0, 0
    fitted = last - first
    open_left = open_right = True
    while open_left or open_right:
        if last - first > 1.1 * fitted:
            centre, turn, origin = _steady(y[first:last], first)
            fitted = last - first
        if open_right:
            open_right = last < len(y) and _near(y[last], centre, turn * (last - origin), most)
            last += open_right
        if open_left:
            open_left = first > 0 and _near(y[first - 1], centre, turn * (first - 1 - origin), most)
            first -= open_left
    return first, last


def _steady(y: Complexes, first: int) -> tuple[Complexes, float, float]:
    """Mean phasors, how far they turn per frame, and the frame in the middle."""
    steps = np.sum(y[1:] * y[:-1].conj())
    turn = float(np.angle(steps)) if abs(steps) > 0 else 0.0
    place = np.arange(len(y)) - (len(y) - 1) / 2
    level = y * np.exp(-1j * turn * place)[:, None]
    overlap = level @ level.mean(axis=0).conj()
    phase = np.unwrap(np.angle(overlap)) if np.all(np.abs(overlap) > 0) else np.zeros(len(y))
    turn += float(place @ phase / (place @ place))
    centre = (y * np.exp(-1j * turn * place)[:, None]).mean(axis=0)
    return centre, turn, first + (len(y) - 1) / 2


def _parted(y: Complexes, apart: int) -> list[tuple[int, int]]:
    """Pieces of frames in which two sines of other frequencies follow each other, else the whole."""
    whole = [(0, len(y))]
    tries = np.arange(_SEED + apart, len(y) - _SEED - apart, max(1, len(y) // 64))
    if not tries.size:
        return whole
    one = _misfit(y)
    # Frames on the change belong to neither.
    left = np.array([_misfit(y[: k - apart // 2]) for k in tries])
    right = np.array([_misfit(y[k + apart // 2 :]) for k in tries])
    two = np.sqrt((left**2 * tries + right**2 * (len(y) - tries)) / len(y))
    best = int(np.argmin(two))
    if one < SETTLED or one**2 < _PARTED * two[best] ** 2:
        return whole
    k = int(tries[best])
    before, after = (0, k - apart // 2), (k + apart // 2, len(y))
    turns = [_steady(y[a:b], 0)[1] for a, b in (before, after)]
    if abs(turns[1] - turns[0]) * min(k, len(y) - k) < _TURNS:
        return whole
    return [(a + first, a + last) for a, b in (before, after) for first, last in _parted(y[a:b], apart)]


def _misfit(y: Complexes) -> float:
    centre, turn, _ = _steady(y, 0)
    size = float(np.linalg.norm(centre))
    if size == 0:
        return np.inf
    place = np.arange(len(y)) - (len(y) - 1) / 2
    away = y - centre * np.exp(1j * turn * place)[:, None]
    return float(np.sqrt(np.mean(np.sum(np.abs(away) ** 2, axis=1)))) / size


def _near(y: Complexes, centre: Complexes, angle: float, most: float) -> bool:
    return float(np.linalg.norm(y * np.exp(-1j * angle) - centre)) <= most
