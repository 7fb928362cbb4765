"""Steady state of a sine: amplitude and phase of every signal constant, transients decayed.

In a steady run the phasors of all signals, fitted in short frames, are constant. The ends of the run are
found by growing from the steadiest frames to both sides until the phasors change; another excitation
pattern of the joints at the same frequency changes them as much as rest does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.importing.find.line_fit import sine_basis

PATTERN_CHANGE = 0.12
"""Relative change of the phasors, over all signals, that separates two runs."""
SETTLED_CHANGE = 0.01
"""Relative distance from the steady phasors below which a run has settled."""

_MULTISINE_CHANGE = 0.03  # as PATTERN_CHANGE, for a multisine, whose frequencies are known well
_MAX_NOISE_CHANGE = 0.4  # relative change beyond which noise is no excuse
_SEED_FRAMES = 5  # fewest frames whose phasors show that they are constant
_LINE_RESOLUTION = 1.5  # frame length × distance of the closest lines; 1 is the limit of resolution
_MULTISINE_PERIODS = 2.0  # of the lowest line in a frame
_ROUNDING_SHARE = 0.15  # of its step by which rounding may shift the phasor of a sine
_NOISE_SIGMAS = 3.0  # times the noise of all signals that a frame may deviate
_OUTLIER_SIGMAS = 3.5  # standard deviations; the verdict calls a record unsettled above five
_MEDIAN_OVER_RMS = 0.83  # of the magnitude of a complex normal number
_SPLIT_GAIN = 10.0  # ratio of squared misfits, one sine over two, that proves a change of frequency
_SPLIT_PHASE_RAD = 0.3  # least phase difference of the two over the shorter one


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
    """Fit a sine, offset and drift in frames of a few periods.

    Parameters
    ----------
    signals : ndarray, shape (N, c)
        Evenly sampled.
    frequency : float
        Cycles per sample.
    periods, hop_periods : float
        Length of the frames, and distance of their beginnings.
    to_the_end : bool, default False
        Add a frame that ends with the last sample.
    """
    length = max(4, round(periods / frequency))
    rest = len(signals) - length
    begin = np.round(np.arange(int(rest * frequency / hop_periods + 1e-9) + 1) * hop_periods / frequency)
    begin = np.minimum(begin.astype(int), rest)
    if to_the_end and begin.size and rest > begin[-1]:
        begin = np.append(begin, rest)
    return _fitted(signals, np.array([2 * np.pi * frequency]), begin, length)


def line_frames(time: Floats, signals: Floats, lines_hz: Sequence[float]) -> Frames:
    """Fit all lines, offset and drift in frames.

    A single line has frames of one period side by side; several lines have frames long enough to
    resolve them, with half overlap.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Evenly spaced.
    signals : ndarray, shape (N, c)
    lines_hz : sequence of float

    Returns
    -------
    Frames
        Signal by signal, shape (m, c lines).
    """
    interval = float(time[-1] - time[0]) / (len(time) - 1)
    omega = 2 * np.pi * np.sort(np.asarray(lines_hz, float)) * interval
    if len(omega) == 1:
        length = hop = max(4, round(2 * np.pi / float(omega[0])))
    else:
        closest = float(np.diff(omega).min())
        cycles = max(_LINE_RESOLUTION / closest, _MULTISINE_PERIODS / float(omega[0]))
        length = int(np.ceil(2 * np.pi * cycles))
        hop = max(1, length // 2)
    return _fitted(signals, omega, np.arange(0, len(time) - length + 1, hop), length)


def _fitted(signals: Floats, omega: Floats, begin: np.ndarray, length: int) -> Frames:
    """Fit sines of ``omega`` (rad per sample) in frames; no frames where the signals are too short."""
    if length > len(signals):
        begin = np.empty(0, int)
    basis = sine_basis(np.arange(length) - (length - 1) / 2, omega)
    cosines, sines = np.split(np.linalg.pinv(basis)[2:], 2)
    waves = sines + 1j * cosines
    turn = np.exp(-1j * np.outer(begin + (length - 1) / 2, omega))
    z = np.empty((len(begin), signals.shape[1], len(omega)), complex)
    for k, first in enumerate(begin):
        z[k] = (waves @ signals[first : first + length]).T * turn[k]
    return Frames(begin, length, z.reshape(len(begin), signals.shape[1] * len(omega)))


def runs(frames: Frames, fewest: int) -> Iterator[tuple[int, int]]:
    """Yield the steady runs as first and one past the last frame, the steadiest first.

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
        if high - low < max(fewest, _SEED_FRAMES):
            continue
        first, last = _grown(y[low:high], noise)
        if last - first < _SEED_FRAMES:
            continue
        first, last = first + low, last + low
        pieces = _split(y[first:last], apart)
        yield from ((first + a, first + b) for a, b in pieces if b - a >= fewest)
        todo += [(low, first - apart + 1), (last + apart - 1, high)]


def grow(z: Complexes, low: int, high: int) -> tuple[int, int]:
    """Grow the steadiest frames of ``low`` to ``high`` to both sides while the phasors are constant.

    Parameters
    ----------
    z : ndarray, shape (m, c)
        Phasors of frames that overlap by half.
    low, high : int

    Returns
    -------
    first, last : int
        The first and one past the last; equal where nothing is constant.
    """
    y, noise = _weighted(z[low:high])
    if len(y) < _SEED_FRAMES:
        return low, low
    first, last = _grown(y, noise)
    if first > 0 or last < len(y) or last - first < _SEED_FRAMES:
        return low + first, low + last
    centre = z[low:high].mean(axis=0)
    size = float(np.linalg.norm(centre))
    away = np.linalg.norm(z - centre, axis=1)
    noise = float(np.median(away[low:high]))
    tolerance = _tolerance(_MULTISINE_CHANGE, size, noise)
    while low > 0 and away[low - 1] <= tolerance:
        low -= 1
    while high < len(z) and away[high] <= tolerance:
        high += 1
    return low, high


def settled_part(frames: Frames, *, is_end: bool, step: Floats | None = None) -> tuple[int, int]:
    """Find the settled part among frames of one period.

    Parameters
    ----------
    frames : Frames
    is_end : bool
        The log ends while the sine continues. Otherwise the last steady frame may contain the start
        of the decay, and is left out.
    step : ndarray, shape (c,), optional
        Quantisation step of each signal, see ``settled_frames``.

    Returns
    -------
    first, last : int
        First sample and one past the last.
    """
    first, last = _constant_part(frames, drifts=False)
    if last - first < len(frames.z) / 2:
        # A drift over the whole run, such as friction that warms up, is no transient.
        first, last = _constant_part(frames, drifts=True)
    last -= not is_end and len(frames.z) >= 8
    first = min(first, len(frames.z) - 1)
    last = max(last, first + 1)
    step = np.zeros(frames.z.shape[1]) if step is None else step
    first += settled_frames(frames.z[first:last], 0, step)[0]
    return int(frames.begin[first]), int(frames.begin[last - 1]) + frames.length


def is_constant(z: Complexes) -> bool:
    """Whether the phasors of all frames are constant within their noise.

    Parameters
    ----------
    z : ndarray, shape (m, c)
    """
    y, noise = _weighted(z)
    if len(y) < 2:
        return False
    centre, turn, origin = _mean_phasors(y, 0)
    size = float(np.linalg.norm(centre))
    tolerance = _tolerance(PATTERN_CHANGE / 2, size, noise)
    return all(_is_near(y[k], centre, turn * (k - origin), tolerance) for k in range(len(y)))


def settled_frames(z: Complexes, fewest: int, step: Floats) -> tuple[int, int]:
    """Drop frames at both ends until the first quarter agrees with the second half.

    The verdict on a record uses the same measure. A start is accepted when the next one agrees as well.
    A change that persists until the fewest frames, or a quarter of all, are left is a drift, not a
    transient: then only the end is cut.

    Parameters
    ----------
    z : ndarray, shape (m, c)
    fewest : int
    step : ndarray, shape (c,)
        Quantisation step, 0 for fine signals; changes below a share of it are no evidence.

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
    usual = np.median(away, axis=0) / _MEDIAN_OVER_RMS
    least = 2 * (SETTLED_CHANGE * np.abs(centre) + _ROUNDING_SHARE * step)
    wrong = np.asarray((away > np.maximum(least, _OUTLIER_SIGMAS * usual)).any(axis=1))
    # A single outlier is chance; the last frame or the last two are the end of the run.
    wrong = wrong & np.append(wrong[1:], True)
    late = np.flatnonzero(wrong[len(wrong) // 2 :])
    last = count // 2 + len(wrong) // 2 + int(late[0]) if late.size else count
    latest = last - max(fewest, last // 4, 8)
    before = False
    for first in range(0, latest + 1, max(1, last // 128)):
        now = _is_settled(z[first:last], _ROUNDING_SHARE * step)
        if now and (before or first == 0):
            return first, last
        before = now
    return 0, last


def _is_settled(z: Complexes, least: Floats) -> bool:
    early, late = z[: len(z) // 4], z[len(z) // 2 :]
    amplitude = np.abs(z.mean(axis=0))
    change = np.abs(early.mean(axis=0) - late.mean(axis=0))
    least = np.maximum(SETTLED_CHANGE / 2 * amplitude, least)
    scatter = np.sqrt((np.abs(late - late.mean(axis=0)) ** 2).sum(axis=0) / (len(late) - 1))
    error = scatter * np.sqrt(1 / len(early) + 1 / len(late))
    return bool(np.all(change <= np.maximum(least, _OUTLIER_SIGMAS * error)))


def _constant_part(frames: Frames, *, drifts: bool) -> tuple[int, int]:
    """Frames around the middle whose phasors match the second half, or its linear trend (``drifts``)."""
    z, count = frames.z, len(frames.z)
    place = frames.begin / max(int(frames.begin[-1]), 1)
    inner = (place > (0.3 if drifts else 0.5)) & (place < 0.95) if count >= 8 else np.ones(count, bool)
    columns = np.column_stack([np.ones(count), place] if drifts else [np.ones(count)])
    model = columns @ np.linalg.lstsq(columns[inner].astype(complex), z[inner], rcond=None)[0]
    away = np.abs(z - model)
    noise = np.median(away[inner], axis=0) / _MEDIAN_OVER_RMS
    least = SETTLED_CHANGE * np.abs(model[inner]).mean(axis=0)
    wrong = (away > np.maximum(least, _OUTLIER_SIGMAS * noise)).any(axis=1)
    middle = 3 * count // 4 if not drifts else count // 2
    before, after = np.flatnonzero(wrong[:middle]), np.flatnonzero(wrong[middle:])
    first = int(before[-1]) + 1 if before.size else 0
    return first, middle + int(after[0]) if after.size else count


def _tolerance(change: float, size: float, noise: float) -> float:
    """Largest deviation of a frame: a relative change, or what noise excuses."""
    return max(change * size, min(_NOISE_SIGMAS * noise, _MAX_NOISE_CHANGE * size))


def _weighted(z: Complexes) -> tuple[Complexes, float]:
    """Phasors scaled to a common size, noisy signals to less; and the noise over all signals."""
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
    """Grow from the steadiest frames to both sides while the phasors rotate uniformly."""
    seeds = len(y) - _SEED_FRAMES + 1
    misfit = np.array([_misfit(y[a : a + _SEED_FRAMES]) for a in range(seeds)])
    first = int(np.argmin(misfit))
    last = first + _SEED_FRAMES
    centre, turn, origin = _mean_phasors(y[first:last], first)
    size = float(np.linalg.norm(centre))
    tolerance = _tolerance(PATTERN_CHANGE, size, noise)
    if misfit[first] * size > tolerance:
        return 0, 0
    fitted = last - first

    def near(k: int) -> bool:
        return 0 <= k < len(y) and _is_near(y[k], centre, turn * (k - origin), tolerance)

    open_left = open_right = True
    while open_left or open_right:
        if last - first > 1.1 * fitted:
            centre, turn, origin = _mean_phasors(y[first:last], first)
            fitted = last - first
        open_right = open_right and near(last)
        last += open_right
        open_left = open_left and near(first - 1)
        first -= open_left
    return first, last


def _mean_phasors(y: Complexes, first: int) -> tuple[Complexes, float, float]:
    """Mean phasors, their rotation per frame (rad), and the index of the middle frame."""
    steps = np.sum(y[1:] * y[:-1].conj())
    turn = float(np.angle(steps)) if abs(steps) > 0 else 0.0
    place = np.arange(len(y)) - (len(y) - 1) / 2
    level = y * np.exp(-1j * turn * place)[:, None]
    overlap = level @ level.mean(axis=0).conj()
    phase = np.unwrap(np.angle(overlap)) if np.all(np.abs(overlap) > 0) else np.zeros(len(y))
    turn += float(place @ phase / (place @ place))
    centre = (y * np.exp(-1j * turn * place)[:, None]).mean(axis=0)
    return centre, turn, first + (len(y) - 1) / 2


def _split(y: Complexes, apart: int) -> list[tuple[int, int]]:
    """Split frames in which two sines of different frequencies follow each other; else the whole."""
    whole = [(0, len(y))]
    tries = np.arange(_SEED_FRAMES + apart, len(y) - _SEED_FRAMES - apart, max(1, len(y) // 64))
    if not tries.size:
        return whole
    one = _misfit(y)
    # Frames across the change belong to neither.
    left = np.array([_misfit(y[: k - apart // 2]) for k in tries])
    right = np.array([_misfit(y[k + apart // 2 :]) for k in tries])
    two = np.sqrt((left**2 * tries + right**2 * (len(y) - tries)) / len(y))
    best = int(np.argmin(two))
    if one < SETTLED_CHANGE or one**2 < _SPLIT_GAIN * two[best] ** 2:
        return whole
    k = int(tries[best])
    before, after = (0, k - apart // 2), (k + apart // 2, len(y))
    turns = [_mean_phasors(y[a:b], 0)[1] for a, b in (before, after)]
    if abs(turns[1] - turns[0]) * min(k, len(y) - k) < _SPLIT_PHASE_RAD:
        return whole
    return [(a + first, a + last) for a, b in (before, after) for first, last in _split(y[a:b], apart)]


def _misfit(y: Complexes) -> float:
    centre, turn, _ = _mean_phasors(y, 0)
    size = float(np.linalg.norm(centre))
    if size == 0:
        return np.inf
    place = np.arange(len(y)) - (len(y) - 1) / 2
    away = y - centre * np.exp(1j * turn * place)[:, None]
    return float(np.sqrt(np.mean(np.sum(np.abs(away) ** 2, axis=1)))) / size


def _is_near(y: Complexes, centre: Complexes, angle: float, tolerance: float) -> bool:
    return float(np.linalg.norm(y * np.exp(-1j * angle) - centre)) <= tolerance
