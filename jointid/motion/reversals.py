"""Friction of a segment at its bins: the sign of the velocity, and free friction at its pauses."""

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.motion.complement import Waveforms
from jointid.phasors.periods import waves_at
from jointid.phasors.segment import Segment, bins_of

_RESOLVED = 0.5
"""Polynomials of a stretch in addition to its phase at the highest bin, which gives their number."""
_SHORT = 4.0
"""Periods of the highest bin below which a stretch is short: its friction hardly follows the drive. Of a
length L, a band up to F holds 2LF values (Landau and Pollak, Bell System Technical Journal 41, 1962)."""
_FURTHER = 1
"""Further polynomials, which the highest bin resolves in part."""
_RESTS = 2
"""Number of polynomials above which a stretch counts as a rest, with any friction up to its level."""
_MOST = 0.6
"""Largest share of a joint's equations that shorter stretches take: the longest first, for in the
shortest the unknown friction is an impulse, like noise."""
_TURN = 0.25
"""Fraction of a rest at which a change of sign gives the mean friction of ``phasors_of_turns``."""
_MORE = 6
"""Degrees beyond those of a stretch for which a quadrature has twice as many points and is exact."""
_REST = 2
"""Samples without clear velocity above which a motor may rest."""
_STATIONARY, _STILL = 0.5, 0.95
"""Share of the largest velocity with unknown sign, and share of the time without clear velocity, from
which a joint counts as stationary: its friction at rest is unknown and its torque shows no spring."""


def segment_friction(
    segment: Segment, window: float | None, widths: Floats
) -> tuple[Complexes, Complexes, Floats, Waveforms, np.ndarray]:
    """Transforms of the friction waveforms of a segment.

    Friction is unknown around a reversal where |θ̇| is below the share ``window`` of its largest, or
    within the errors of its noise and smoothing: the motor may stick there; with None it is known
    everywhere. ``widths``, shape (n, c), are decay velocities w of a friction curve, rad/s. Returns the
    transforms of sign θ̇, shape (H, n), and of sign θ̇ · exp(−|θ̇|/w), shape (H, n, c); sign θ̇ at the
    samples, (n, N); polynomials over the stretches with unknown friction, those of the shorter ones
    bounded; and whether a joint's motion, except short moves, is within its noise, shape (n,).
    """
    v = segment.velocity
    blur, largest = segment.least_velocity, np.abs(v).max(axis=1)
    stationary = (blur > _STATIONARY * largest) | (segment.share_at_rest > _STILL)
    late: Floats = segment.turn_rad_s * np.ones(len(v))
    if window is None:
        none = [np.zeros((segment.highest, 0), complex)] * len(v)
        unknown = Waveforms(none, none, np.zeros((segment.highest, len(v)), bool))
    else:
        # Smoothing hides where a motor comes to rest; the stretches hold whole samples anyway.
        by_sampling = 2 / np.pi**2 * segment.interval_s
        least = blur + late * np.maximum(1 - by_sampling / segment.velocity_blur_s, 0.0)
        thresholds = np.maximum(window * largest, least)
        slow = [_stretches(*each) for each in zip(v, thresholds, least, strict=True)]
        known = *(each.tobytes() for each in slow), stationary.tobytes()
        if known not in segment.known:
            segment.known[known] = _unknown(segment, slow, ~stationary)
        unknown = segment.known[known]
    signs = widths.tobytes(), late.tobytes()
    if signs not in segment.known:
        segment.known[signs] = _of_signs(segment, np.where(stationary, np.inf, blur), late, widths)
    return (*segment.known[signs], unknown, stationary)


def _unknown(segment: Segment, slow: list[np.ndarray], moves: np.ndarray) -> Waveforms:
    """Friction that is unknown in the slow stretches of every joint that moves."""
    H = segment.highest
    inside = np.arange(1, H + 1) >= segment.lowest
    most = int(2 * _MOST * np.count_nonzero(inside))
    slow = [own[: own.size * moves[j]] for j, own in enumerate(slow)]
    free, bounded = _polynomials(slow, segment.samples, inside, most)
    periods = [np.diff(own)[:, 0] / segment.samples * H for own in slow]
    short = [_unknown_torques(own[own < _SHORT]).sum() for own in periods]
    return Waveforms(free, bounded, inside[:, None] & moves, np.array(short))


def _unknown_torques(periods: Floats) -> Floats:
    """Number of polynomials of stretches of some periods of the highest bin."""
    return np.ceil(np.pi * periods + _RESOLVED) + _FURTHER


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
        turns, rests, signs = reversals(v[j], blur[j], late[j], latest[j])
        coulomb[:, j] = phasors_of_turns(turns, rests, signs, N, H)
        direction[j] = signs[np.searchsorted(turns, np.arange(N))]
        if widths.size:
            fades = np.expm1(-np.abs(v[j]) / widths[j][:, None]) * direction[j]
            curve[:, j] = coulomb[:, j, None] + bins_of(fades, H).T
    inside = (np.arange(1, H + 1) >= segment.lowest)[:, None]
    return coulomb * inside, curve * inside[..., None], direction


def reversals(v: Floats, blur: float, late: float, latest: float) -> tuple[Floats, Floats, Floats]:
    """Samples, with their fraction, at which the direction changes (m,), and the directions (m + 1,).

    Between them: samples of rest at each change, (m,), zero where the motor turns at once. The velocity
    is then ``late`` in the direction before, but the motor turned no more than ``latest`` samples ago.
    Where a motor rests, the change is at ``_TURN`` between its last and first clear motion.
    """
    clear = np.flatnonzero(np.abs(v) > blur)
    sign = np.sign(v[clear])
    turn = np.flatnonzero(sign[1:] != sign[:-1])
    before, after = clear[turn], clear[turn + 1]
    # A straight line between the last and the first clear sample; exact for neighbours.
    samples = (after - before) / (np.abs(v[before]) + np.abs(v[after]))
    at_once = np.abs(v[before]) * samples - np.minimum(late * samples, latest)
    rests = np.where(after - before > _REST, after - before, 0.0)
    at = np.where(rests > 0, _TURN * rests, at_once)
    return before.astype(float) + at, rests, np.append(sign[:1], sign[turn + 1])


def phasors_of_turns(turns: Floats, rests: Floats, signs: Floats, N: int, H: int) -> Complexes:
    """Phasors (H,) of friction over N steps that changes its sign at some samples.

    When a motor stops, friction drops to the torque that holds it, which is 0 on average, and follows
    the drive from there to the other level.
    """
    k = 2j * np.pi * np.arange(1, H + 1) / N
    jumps, long = np.diff(signs), rests > 0
    found = signs[0] - signs[-1] + waves_at(turns[~long] / N, H) @ jumps[~long]
    half, rests = jumps[long] / 2, rests[long]
    begin = turns[long] - _TURN * rests
    stops, starts = waves_at(begin / N, H), waves_at((begin + rests) / N, H)
    found += stops @ half + (stops - starts) @ (half / rests) / k
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


def _polynomials(
    slow: Sequence[np.ndarray], N: int, inside: np.ndarray, most: int
) -> Iterator[list[Complexes]]:
    """Transforms (H, k) of Legendre's polynomials on the stretches (m, 2) of each joint, and the rest.

    Of N steps, at the bins ``inside`` the band, (H,). Of degree d, a transform is a spherical Bessel
    function of the phase over half a stretch, which vanishes where d exceeds the phase: few polynomials
    hold most that H bins resolve of any waveform. In short stretches as many are free as the band holds
    values. The rest has the standard deviation of a unit that changes its sign anywhere.
    """
    H = inside.size
    stretches = np.concatenate(slow)
    begin, end = stretches.T
    length, joint = end - begin, np.repeat(np.arange(len(slow)), [len(own) for own in slow])
    periods = length / N * H
    count = np.ceil(np.where(periods < _SHORT, 2, np.pi) * periods + _RESOLVED).astype(int)
    is_free = count > _RESTS
    for j in range(len(slow)):
        longest = np.flatnonzero(joint == j)[np.argsort(-length[joint == j])]
        is_free[longest[np.cumsum(count[longest]) <= most]] = True
    late = waves_at((begin + end) / (2 * N), H).T * (2j / N * inside)
    free, bounded = ([(np.zeros((0, H), complex), joint[:0])] for _ in range(2))
    for steps in np.unique(length).tolist():  # stretches of equal length share their functions
        equal = length == steps
        resolved = int(count[equal][0])
        shapes, std = _transforms(steps, N, H, int(_unknown_torques(periods[equal])[0]))
        for some, first in ((equal & is_free, resolved), (equal & ~is_free, 0)):
            for found, part in ((free, shapes[:first]), (bounded, (std[:, None] * shapes)[first:])):
                rows = late[some, None] * part
                found.append((rows.reshape(-1, H), np.repeat(joint[some], len(part))))
    for found in (free, bounded):
        rows, of = (np.concatenate(each) for each in zip(*found, strict=True))
        yield [rows[of == j].T for j in range(len(slow))]


@lru_cache(maxsize=512)
def _transforms(steps: int, N: int, H: int, count: int) -> tuple[Complexes, Floats]:
    """Transforms (count, H) of Legendre's polynomials on some of N steps centred at time 0.

    Also the standard deviations (count,) of their sizes in a unit that changes its sign anywhere.
    """
    degree = np.arange(count)
    x, even, odd = _quadrature((count + _MORE).bit_length())
    turn = np.outer(x, np.pi * steps / N * np.arange(1, H + 1))
    shapes = steps * (even @ np.cos(turn) - 1j * (odd @ np.sin(turn)))[:count]
    std = np.sqrt(np.where(degree, 1 / (2 * degree - 1) + 1 / (2 * degree + 3), 1 / 3))
    return shapes, std


@lru_cache
def _quadrature(doublings: int) -> tuple[Floats, Floats, Floats]:
    """Positive points of Gauss's quadrature (p,), and weights times Legendre's polynomials (p, p).

    The polynomials of even and those of odd degree, each 0 in place of the others: on the other half,
    only the sign of the odd ones differs.
    """
    x, weights = np.polynomial.legendre.leggauss(2 ** (doublings + 1))
    x, weights = x[x > 0], weights[x > 0]
    weighted = (weights[:, None] * np.polynomial.legendre.legvander(x, x.size - 1)).T
    is_odd = np.arange(x.size)[:, None] % 2
    return x, weighted * (1 - is_odd), weighted * is_odd
