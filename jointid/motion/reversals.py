"""Friction of a segment at its bins: the sign of the velocity, and free friction at its pauses."""

from functools import lru_cache

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.motion.complement import Waveforms
from jointid.phasors.periods import waves_at
from jointid.phasors.segment import Segment, bins_of

_RESOLVED = 0.5
"""Polynomials of a stretch beyond its phase at the highest bin, which decides how many it needs."""
_FURTHER = 1
"""Further polynomials, which the highest bin resolves in part."""
_RESTS = 2
"""Polynomials of a stretch beyond which it is a rest, with any friction up to its level."""
_MOST = 0.6
"""Largest share of a joint's equations that shorter stretches take: the longest first, for in the
shortest the unknown friction is an impulse, like noise."""
_TURN = 0.25
"""Place of the change of sign in a rest. Friction drops when the motor stops, to any torque within its
level, and follows the drive to the other level: its mean is that of a change after a quarter."""
_MORE = 6
"""Degrees beyond those of a stretch for which a quadrature has twice as many points and is exact."""
_MARGIN = 4.0
"""Standard deviations of the velocity within which its sign is unknown."""
_REST = 2
"""Samples without clear velocity above which a motor may rest."""
_STATIONARY, _STILL = 0.5, 0.95
"""Share of the largest velocity with unknown sign, and share of the time without clear velocity, from
which a joint counts as stationary: its friction at rest is unknown and its torque shows no spring."""


def segment_friction(
    segment: Segment, window: float, widths: Floats
) -> tuple[Complexes, Complexes, Floats, Waveforms, np.ndarray]:
    """Transforms of the friction waveforms of a segment.

    Friction is unknown around a reversal where |θ̇| is below the share ``window`` of its largest, or
    within the errors of its noise and smoothing: the motor may stick there. ``widths``, shape (n, c),
    are decay velocities w of a friction curve, rad/s. Returns the transforms of sign θ̇, shape (H, n),
    and of sign θ̇ · exp(−|θ̇|/w), shape (H, n, c); sign θ̇ at the samples, (n, N); polynomials over the
    stretches with unknown friction, those of the shorter ones bounded; and whether a joint's motion is
    within its noise, but for short moves, shape (n,).
    """
    v = segment.velocity
    blur, largest = _MARGIN * segment.velocity_noise, np.abs(v).max(axis=1)
    stationary = (blur > _STATIONARY * largest) | (largest == 0)
    stationary |= np.mean(np.abs(v) <= blur[:, None], axis=1) > _STILL
    late: Floats = segment.turn_rad_s * np.ones(len(v))
    # Smoothing hides where a motor comes to rest; the stretches hold whole samples anyway.
    by_sampling = 2 / np.pi**2 * segment.interval_s
    least = blur + late * np.maximum(1 - by_sampling / segment.velocity_blur_s, 0.0)
    thresholds = np.maximum(window * largest, least)
    slow = [_stretches(*each) for each in zip(v, thresholds, least, strict=True)]
    known = *(each.tobytes() for each in slow), stationary.tobytes()
    if known not in segment.known:
        segment.known[known] = _unknown(segment, slow, ~stationary)
    signs = widths.tobytes(), late.tobytes()
    if signs not in segment.known:
        segment.known[signs] = _of_signs(segment, np.where(stationary, np.inf, blur), late, widths)
    return (*segment.known[signs], segment.known[known], stationary)


def _unknown(segment: Segment, slow: list[np.ndarray], moves: np.ndarray) -> Waveforms:
    """Friction that is unknown in the slow stretches of every joint that moves."""
    N, H = segment.samples, segment.highest
    inside = np.arange(1, H + 1) >= segment.lowest
    most = int(2 * _MOST * np.count_nonzero(inside))
    parts = [_polynomials(own[: own.size * moves[j]], N, H, most) for j, own in enumerate(slow)]
    free, bounded = zip(*((a * inside[:, None], b * inside[:, None]) for a, b in parts), strict=True)
    return Waveforms(free, bounded, inside[:, None] & moves)


def _of_signs(
    segment: Segment, blur: Floats, late: Floats, widths: Floats
) -> tuple[Complexes, Complexes, Floats]:
    """Coulomb friction (H, n), its curve (H, n, c) and sign (n, N) by the velocities beyond ``blur``."""
    v, H = segment.velocity, segment.highest
    n, N = v.shape
    latest = segment.velocity_blur_s * np.ones(n) / segment.interval_s
    coulomb, curve = np.zeros((H, n), complex), np.zeros((H, n, widths.shape[1]), complex)
    direction = np.zeros((n, N))
    for j in np.flatnonzero(np.isfinite(blur)).tolist():
        turns, signs = reversals(v[j], blur[j], late[j], latest[j])
        coulomb[:, j] = _of_steps(turns, signs, N, H)
        direction[j] = signs[np.searchsorted(turns, np.arange(N))]
        if widths.size:
            fades = np.expm1(-np.abs(v[j]) / widths[j][:, None]) * direction[j]
            curve[:, j] = coulomb[:, j, None] + bins_of(fades, H).T
    inside = (np.arange(1, H + 1) >= segment.lowest)[:, None]
    return coulomb * inside, curve * inside[..., None], direction


def reversals(v: Floats, blur: float, late: float, latest: float) -> tuple[Floats, Floats]:
    """Samples, with their fraction, at which the direction changes, and the directions (m + 1,).

    The velocity is then ``late`` in the direction before, but the motor turned no more than ``latest``
    samples ago. Where a motor rests, the change is at ``_TURN`` between its last and first clear motion.
    """
    clear = np.flatnonzero(np.abs(v) > blur)
    sign = np.sign(v[clear])
    turn = np.flatnonzero(sign[1:] != sign[:-1])
    before, after = clear[turn], clear[turn + 1]
    # A straight line between the last and the first clear sample; exact for neighbours.
    samples = (after - before) / (np.abs(v[before]) + np.abs(v[after]))
    at_once = np.abs(v[before]) * samples - np.minimum(late * samples, latest)
    at = np.where(after - before > _REST, _TURN * (after - before), at_once)
    return before.astype(float) + at, np.append(sign[:1], sign[turn + 1])


def _of_steps(turns: Floats, signs: Floats, N: int, H: int) -> Complexes:
    """Phasors (H,) of a square wave over N steps that changes its sign at some samples."""
    k = 2j * np.pi * np.arange(1, H + 1) / N
    found = signs[0] - signs[-1] + waves_at(turns / N, H) @ np.diff(signs)
    return np.asarray(found / k * (2j / N))


def _stretches(v: Floats, threshold: float, blur: float) -> np.ndarray:
    """Last sample before, and first after, every slow stretch in which the motor may stick, (m, 2)."""
    known = np.flatnonzero(np.abs(v) > threshold)
    edges = np.concatenate([[0], known, [v.size - 1]])
    edges = edges[np.append(True, np.diff(edges) > 0)]
    begin, end = edges[:-1], edges[1:]
    lowest = np.minimum.reduceat(np.abs(v), begin)
    rests = (end - begin > 1) & (lowest <= blur)
    return np.asarray(np.stack([begin, end], axis=1)[rests | (v[begin] * v[end] < 0)])


def _polynomials(stretches: np.ndarray, N: int, H: int, most: int) -> tuple[Complexes, Complexes]:
    """Transforms (H, k) of Legendre's polynomials on stretches (m, 2) of N steps, and of the rest.

    Of degree d, that is a spherical Bessel function of the phase over half a stretch, which vanishes
    where d exceeds the phase: few polynomials hold most that H bins resolve of any waveform. The rest,
    of shorter stretches and of the next degrees, has the standard deviation of a unit that changes its
    sign anywhere.
    """
    length, middle = np.diff(stretches, axis=1)[:, 0], stretches.mean(axis=1)
    count = np.ceil(np.pi * length / N * H + _RESOLVED).astype(int)
    longest = np.argsort(-length)
    is_free = count > _RESTS
    is_free[longest[np.cumsum(count[longest]) <= most]] = True
    late = waves_at(middle / N, H) * (2j / N)
    free, bounded = [np.zeros((H, 0), complex)], [np.zeros((H, 0), complex)]
    for each, (steps, resolved) in enumerate(zip(length.tolist(), count.tolist(), strict=True)):
        shapes, std = _shapes(steps, resolved + _FURTHER, N, H)
        own, first = late[:, each, None] * shapes, resolved * is_free[each]
        free.append(own[:, :first])
        bounded.append(std[first:] * own[:, first:])
    return np.concatenate(free, axis=1), np.concatenate(bounded, axis=1)


@lru_cache(maxsize=512)  # segments and their fits share them
def _shapes(steps: int, degrees: int, N: int, H: int) -> tuple[Complexes, Floats]:
    """Transforms (H, d) of polynomials on a stretch about time 0, and their standard deviations (d,)."""
    degree = np.arange(degrees)
    x, weighted = _quadrature((degrees + _MORE).bit_length())
    std = np.sqrt(np.where(degree, 1 / (2 * degree - 1) + 1 / (2 * degree + 3), 1 / 3))
    return 0.5 * steps * waves_at(0.5 * steps / N * x, H) @ weighted[:, :degrees], std


@lru_cache
def _quadrature(doublings: int) -> tuple[Floats, Floats]:
    """Points of Gauss's quadrature (p,), and their weights times Legendre's polynomials (p, p / 2)."""
    x, weights = np.polynomial.legendre.leggauss(2 ** (doublings + 1))
    return x, weights[:, None] * np.polynomial.legendre.legvander(x, x.size // 2 - 1)
