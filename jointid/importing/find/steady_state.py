"""Steady state of a sine: amplitude and phase of every signal constant, transients decayed.

In a steady run the phasors of all signals, fitted in short frames, are constant. The ends of the run are
found by growing from the steadiest frames to both sides until the phasors change; another excitation
pattern of the joints at the same frequency changes them as much as rest does.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.phasors.fitted_sine import sine_basis
from jointid.phasors.settling import settling_change

PATTERN_CHANGE = 0.12
"""Relative change of the phasors, over all signals, that separates two runs."""
SETTLED_CHANGE = 0.01
"""Relative distance from the steady phasors below which a run has settled."""
SEED_FRAMES = 5
"""Fewest frames whose phasors show that they are constant."""

_MIN_MOTION = 0.02  # phasor over the largest of its quantity, below which a joint counts as at rest
_MAX_NOISE_CHANGE = 0.4  # relative change beyond which noise is no explanation
_LINE_RESOLUTION = 1.5  # frame length × distance of the closest lines; 1 is the limit of resolution
_MULTISINE_PERIODS = 2.0  # of the lowest line in a frame
_ROUNDING_SHARE = 0.15  # of its step by which rounding may shift the phasor of a sine
_NOISE_SIGMAS = 3.0  # times the noise of all signals that a frame may deviate
_OUTLIER_SIGMAS = 3.5  # standard deviations
_SETTLED_SIGMAS = 2.0  # standard errors; an unnecessary cut of a period costs little
_MEDIAN_OVER_RMS = 0.83  # of the magnitude of a complex normal number
_SPLIT_GAIN = 10.0  # ratio of squared misfits, one sine over two, that proves a change of frequency
_SPLIT_PHASE_RAD = 0.3  # least phase difference of the two over the shorter one
_OVERLAP = np.sqrt(2.0)  # by which half overlap of the frames makes the errors of a bend larger
_AT_ENDS = np.array([1.0, 0.4])  # x² and x³ at the ends of a run, less the line 0.6 x
_GROWTH = 10  # part of a run by which it grows before its mean phasors are fitted again: one tenth


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
    signals: Floats, lines: Sequence[float] | Floats, periods: float = 1.0, hop_periods: float = 1.0
) -> Frames:
    """Fit all lines (cycles per sample), offset and drift to evenly sampled signals (N, c) in frames.

    ``periods`` is the length of the frames of a single line and ``hop_periods`` the distance of their
    beginnings. Several lines have frames long enough to resolve them, with half overlap. The phasors are
    signal by signal, shape (m, c lines); none where the signals are too short.
    """
    lines = np.sort(np.asarray(lines, float))
    length, hop = max(4, round(periods / lines[0])), hop_periods / lines[0]
    if len(lines) > 1:
        cycles = max(_LINE_RESOLUTION / np.diff(lines).min(), _MULTISINE_PERIODS / lines[0])
        length = int(np.ceil(cycles))
        hop = max(1, length // 2)
    last = len(signals) - length
    begin = np.round(np.arange(int(last / hop + 1e-9) + 1 if last >= 0 else 0) * hop).astype(int)
    begin = np.minimum(begin, last)
    clock = np.arange(length) - (length - 1) / 2
    omega = 2 * np.pi * lines
    basis = sine_basis(np.outer(clock, omega), clock / length)
    cosines, sines = np.split(np.linalg.pinv(basis)[:-2], 2)
    waves = sines + 1j * cosines
    turn = np.exp(-1j * np.outer(begin + (length - 1) / 2, omega))
    z = np.empty((len(begin), signals.shape[1], len(omega)), complex)
    for k, first in enumerate(begin):
        z[k] = (waves @ signals[first : first + length]).T * turn[k]
    return Frames(begin, length, z.reshape(len(begin), signals.shape[1] * len(omega)))


def steady_runs(frames: Frames, fewest: int) -> Iterator[tuple[int, int, float]]:
    """Yield the steady runs, the steadiest first: begin, end, rotation per frame (rad).

    Frames may overlap; their hop is half a period. A run needs the ``fewest`` frames.
    """
    y, noise = weighted(frames.z)
    apart = int(np.searchsorted(frames.begin, frames.begin[0] + frames.length)) if len(y) else 0
    todo = [(0, len(y))]
    while todo:
        low, high = todo.pop()
        if high - low < max(fewest, SEED_FRAMES):
            continue
        first, last = grown(y[low:high], noise)
        if last - first < SEED_FRAMES:
            continue
        first, last = first + low, last + low
        for a, b in _split(y[first:last], apart):
            if b - a >= fewest:
                piece = slice(first + a, first + b)
                begin, end = int(frames.begin[piece][0]), int(frames.begin[piece][-1]) + frames.length
                yield begin, end, float(_mean_phasors(y[piece])[1])
        todo += [(low, first - apart + 1), (last + apart - 1, high)]


def weighted(z: Complexes) -> tuple[Complexes, float]:
    """Phasors of positions, then torques, scaled to a common size; and the noise over all signals.

    Noisy signals are scaled to less, and joints at rest, which may creep.
    """
    if len(z) == 0:
        return z, 0.0
    size = _at_least_moving(np.sqrt(np.mean(np.abs(z) ** 2, axis=0)))
    lag = min(4, len(z) - 1)
    change = np.abs(z[lag:] - z[: len(z) - lag]) if lag else np.zeros((1, z.shape[1]))
    noise = np.median(change, axis=0) / np.sqrt(2)
    scale = np.sqrt(size**2 + (5 * noise) ** 2)
    scale = np.where(scale > 0, scale, 1.0)
    return np.asarray(z / scale), float(np.linalg.norm(noise / scale))


def _at_least_moving(size: Floats) -> Floats:
    """Sizes of positions, then torques (c,), at least those of a joint that moves."""
    largest = size.reshape(2, -1).max(axis=1)
    return np.asarray(np.maximum(size, np.repeat(_MIN_MOTION * largest, size.size // 2)))


def grown(
    y: Complexes, noise: float, seeds: slice = slice(None), change: float = PATTERN_CHANGE
) -> tuple[int, int]:
    """Grow from the steadiest of the frames ``seeds`` to both sides while the phasors rotate uniformly.

    ``y`` (m, c) are phasors of consecutive frames, ``noise`` that of all signals of a frame, ``change``
    the relative change at which a run ends. Returns the first frame and one past the last; equal where
    nothing is constant.
    """
    low, high, _ = seeds.indices(len(y))
    if high - low < SEED_FRAMES:
        return 0, 0
    windows = np.lib.stride_tricks.sliding_window_view(y[low:high], SEED_FRAMES, axis=0)
    misfit = _misfit(windows.swapaxes(1, 2))
    first = low + int(np.argmin(misfit))
    last = first + SEED_FRAMES
    size = float(np.linalg.norm(_mean_phasors(y[first:last])[0]))
    # A relative change, or a deviation within the noise.
    tolerance = max(change * size, min(_NOISE_SIGMAS * noise, _MAX_NOISE_CHANGE * size))
    if misfit.min() * size > tolerance:
        return 0, 0
    while True:
        centre, turn = _mean_phasors(y[first:last])
        rest = _level(y, turn, np.arange(len(y), dtype=float) - (first + last - 1) / 2) - centre
        far = np.flatnonzero(np.linalg.norm(rest, axis=1) > tolerance)
        step = max(1, (last - first) // _GROWTH)
        left = max([0, first - step, *(far[far < first][-1:] + 1)])
        right = min([len(y), last + step, *far[far >= last][:1]])
        if (left, right) == (first, last):
            return first, last
        first, last = left, right


def phase_bends(z: Complexes) -> tuple[Floats, Floats, float]:
    """Quadratic and cubic part of the phase common to all signals of frames (m, c), with errors, rad.

    A drifting frequency bends the phase of all signals, cubically where it turns back; a steady one does
    not. The third value is the relative growth of their amplitude from the middle to the end.
    """
    if len(z) < SEED_FRAMES:
        return np.zeros(2), np.full(2, np.inf), 0.0
    place = np.linspace(-1, 1, len(z))
    turn = _mean_phasors(weighted(z)[0])[1] * (len(z) - 1) / 2
    level = _level(z, turn, place)
    centre = level.mean(axis=0)
    scatter = (np.abs(level - centre) ** 2).mean(axis=0) + 1e-6 * np.abs(centre) ** 2 + 1e-300
    common = level @ (centre.conj() / scatter)
    phase = np.unwrap(np.angle(common))
    growth = float(place @ common.real / (place @ place) / max(common.real.mean(), 1e-300))
    found = []
    for degree in (2, 3):
        basis = np.polynomial.polynomial.polyvander(place, degree)
        spread = np.linalg.inv(basis.T @ basis)
        bend = spread @ (basis.T @ phase)
        rest = phase - basis @ bend
        found.append((bend[-1], np.sqrt(spread[-1, -1] * (rest @ rest) / (len(z) - degree - 1))))
    bends, errors = np.transpose(found) * _AT_ENDS
    return bends, _OVERLAP * errors, growth


def settled_part(
    frames: Frames, *, is_end: bool, fewest: int = 0, step: Floats | float = 0.0
) -> tuple[int, int]:
    """First sample and one past the last of the part without transients at both ends.

    Frames are dropped until the first quarter agrees with the second half, as in the verdict on a
    record. A start is accepted when the next one agrees as well. A change that persists until the fewest
    frames, or a quarter of all, are left is a drift, not a transient: then only the end is cut.
    ``is_end``: the log ends while the sine continues; otherwise the last steady frame may contain the
    start of the decay, and is left out. ``step`` (c,) is the quantisation step, 0 for fine signals;
    changes below a share of it are no evidence.
    """
    z, rounding = frames.z, _ROUNDING_SHARE * np.asarray(step)
    first, last = _without_ends(z, rounding, degree=0)
    if last - first < len(z) / 2:
        # A drift over the whole run, such as friction that warms up, is no transient.
        first, last = _without_ends(z, rounding, degree=1)
    last = max(last - (not is_end and len(z) >= 8), first + 1)
    first += _settled_from(z[first:last], fewest, rounding)
    return int(frames.begin[first]), int(frames.begin[last - 1]) + frames.length


def _without_ends(z: Complexes, rounding: Floats, degree: int) -> tuple[int, int]:
    """Frames around the middle that agree with the second half, or with its linear trend (degree 1)."""
    count = len(z)
    place = np.linspace(0, 1, count)
    inner = (place > (0.3 if degree else 0.5)) & (place < 0.95) if count >= 8 else place >= 0
    columns = np.vander(place, degree + 1).astype(complex)
    model = columns @ np.linalg.lstsq(columns[inner], z[inner], rcond=None)[0]
    away = np.abs(z - model)
    usual = np.median(away[inner], axis=0) / _MEDIAN_OVER_RMS
    least = SETTLED_CHANGE * _at_least_moving(np.abs(model[inner]).mean(axis=0)) + rounding
    wrong = np.asarray((away > np.maximum(least, _OUTLIER_SIGMAS * usual)).any(axis=1))
    middle = count // 2 if degree else 3 * count // 4
    around = np.concatenate([[True], wrong, [True]])
    wrong &= around[2:] | around[:-2]  # a single outlier is chance, except at the ends
    early, late = np.flatnonzero(wrong[:middle]), np.flatnonzero(wrong[middle:])
    first = min(int(early[-1]) + 1 if early.size else 0, count - 1)
    return first, middle + int(late[0]) if late.size else count


def _settled_from(z: Complexes, fewest: int, rounding: Floats) -> int:
    """First frame from which the first quarter agrees with the second half; 0 if no frame does."""
    count, before = len(z), False
    for first in range(0, count - max(fewest, count // 4, 8) + 1, max(1, count // 128)):
        rest = z[first:]
        change, noise = settling_change(rest)
        least = SETTLED_CHANGE / 2 * _at_least_moving(np.abs(rest.mean(axis=0)))
        least = np.maximum(least, rounding)
        now = bool(np.all(change <= np.maximum(least, _SETTLED_SIGMAS * noise)))
        if now and (before or first == 0):
            return first
        before = now
    return 0


def _mean_phasors(y: Complexes) -> tuple[Complexes, Floats]:
    """Mean phasors (..., c) in the middle of frames (..., m, c), and their rotation per frame (rad)."""
    turn: Floats = np.angle(np.sum(y[..., 1:, :] * y[..., :-1, :].conj(), axis=(-2, -1)))
    place = np.arange(y.shape[-2], dtype=float) - (y.shape[-2] - 1) / 2
    level = _level(y, turn, place)
    overlap = (level * level.mean(axis=-2, keepdims=True).conj()).sum(axis=-1)
    turn = turn + np.unwrap(np.angle(overlap)) @ place / (place @ place)
    return _level(y, turn, place).mean(axis=-2), turn


def _level(y: Complexes, turn: Floats, place: Floats) -> Complexes:
    """Frames without their uniform rotation."""
    return np.asarray(y * np.exp(-1j * np.multiply.outer(turn, place))[..., None])


def _misfit(y: Complexes) -> Floats:
    """Root mean square of the deviation from uniform rotation over the size of the mean phasors."""
    centre, turn = _mean_phasors(y)
    place = np.arange(y.shape[-2], dtype=float) - (y.shape[-2] - 1) / 2
    rest = np.sum(np.abs(_level(y, turn, place) - centre[..., None, :]) ** 2, axis=-1)
    size = np.linalg.norm(centre, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(size > 0, np.sqrt(rest.mean(axis=-1)) / size, np.inf)


def _split(y: Complexes, apart: int) -> list[tuple[int, int]]:
    """Split frames in which two sines of different frequencies follow each other; else the whole."""
    whole = [(0, len(y))]
    tries = np.arange(SEED_FRAMES + apart, len(y) - SEED_FRAMES - apart, max(1, len(y) // 64))
    if not tries.size:
        return whole
    one = float(_misfit(y))
    if one < SETTLED_CHANGE:
        return whole
    # Frames across the change belong to neither.
    left = np.array([_misfit(y[: k - apart // 2]) for k in tries])
    right = np.array([_misfit(y[k + apart // 2 :]) for k in tries])
    two = np.sqrt((left**2 * tries + right**2 * (len(y) - tries)) / len(y))
    best = int(np.argmin(two))
    if one**2 < _SPLIT_GAIN * two[best] ** 2:
        return whole
    k = int(tries[best])
    before, after = (0, k - apart // 2), (k + apart // 2, len(y))
    turns = [_mean_phasors(y[a:b])[1] for a, b in (before, after)]
    if abs(turns[1] - turns[0]) * min(k, len(y) - k) < _SPLIT_PHASE_RAD:
        return whole
    return [(a + first, a + last) for a, b in (before, after) for first, last in _split(y[a:b], apart)]
