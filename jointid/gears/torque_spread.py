"""Change of torques in periodic motion, of gears and of friction, with the harmonics of the motion."""

from functools import lru_cache

import numpy as np
from scipy.sparse import csr_array

from jointid.arrays import Complexes, Floats
from jointid.gears.laws import GearLaws
from jointid.phasors.periods import pairs
from jointid.small_matrices import decaying


def periodic_dahl(delta: Floats, sharpness: Floats) -> Floats:
    """Dahl's z over a period, dz/dδ = sharpness (1 − z sign δ̇), periodic; last axis time."""
    return _dahl_steps(delta, sharpness)[0]


def average_dahl(delta: Floats, sharpness: Floats) -> Floats:
    """Mean of ``periodic_dahl`` over the steps to each sample, in which the deflection moves uniformly.

    Accurate for the smallest steps, also of a gear at rest.
    """
    z, sign, way, lost = _dahl_steps(delta, sharpness)
    kept = np.divide(-lost, way, out=np.ones_like(way), where=way > 0)
    return np.roll(z * kept + sign * (1 - kept), 1, axis=-1)


def _dahl_steps(delta: Floats, sharpness: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """z at each sample; of the step from there the sign, the length in presliding w, and e^{−w} − 1."""
    move = np.diff(delta, axis=-1, append=delta[..., :1])
    sign, way = np.sign(move), np.abs(move) * sharpness
    lost = np.expm1(-way)
    decay, drive = (x.reshape(-1, delta.shape[-1]) for x in (1 + lost, -sign * lost))
    return _periodic(decay, drive[..., None]).reshape(delta.shape), sign, way, lost


def _periodic(decay: Floats, drive: Floats) -> Floats:
    """Periodic solution of z[k + 1] = decay[k] z[k] + drive[k] of g gears, (g, t) and (g, t, c)."""
    after, left = decaying(decay, drive), decay.cumprod(axis=1)[..., None]
    after += left * (after[:, -1:] / np.maximum(1 - left[:, -1:], 1e-9))
    return np.roll(after, 1, axis=1)


def inner(m: int, H: int) -> list[int]:
    """Parts of the mean and the first m of H harmonics."""
    return [0, *range(1, 1 + m), *range(1 + H, 1 + H + m)]


@lru_cache(maxsize=8)
def _waves(H: int, points: int) -> tuple[Floats, Floats]:
    """One, sines and cosines (1 + 2H, points), and the matrix from samples to their coefficients."""
    waves = np.concatenate([np.ones((1, points)), pairs(H, points)])
    weight = np.full(1 + 2 * H, 2 / points)
    weight[0] = 1 / points
    return waves, np.ascontiguousarray(waves.T * weight)


def _loop_spread(
    level: Floats, sharpness: Floats, delta: Floats, m: int, H: int
) -> tuple[Floats, Floats]:
    """Slope of the hysteresis torque, and its spread by earlier moves apart from that of the slope.

    Shapes (g,) of g gears, (g, t) of δ. While δ moves in one direction s from a reversal, 1 − sz decays
    with it: with z' at the reversal and g = dz/dδ = sharpness (1 − sz), z' = g δ' + decay · y, and
    y = z' − g δ' just after the reversal lasts until the next one.
    """
    points = delta.shape[1]
    waves, weights = _waves(H, points)
    z, s = periodic_dahl(delta, sharpness[:, None]), np.sign(delta - np.roll(delta, 1, axis=1))
    s[s == 0] = 1.0
    turns = s != np.roll(s, 1, axis=1)
    turns[:, 0] |= ~turns.any(axis=1)
    order = (turns.argmax(axis=1)[:, None] + np.arange(points)) % points  # begins with a reversal
    starts = np.flatnonzero(np.take_along_axis(turns, order, axis=1))
    ends = np.append(starts[1:], delta.size) - 1
    gear, at = starts // points, order.ravel()[starts]
    origin = np.repeat(delta[gear, at - 1], ends + 1 - starts).reshape(delta.shape)
    moved = np.abs(np.take_along_axis(delta, order, axis=1) - origin)
    decay = np.exp(-moved * sharpness[:, None]).ravel()
    shape = starts.size, points
    parts = csr_array((decay, order.ravel(), np.append(starts, delta.size)), shape=shape) @ weights
    jump = 2 * (sharpness[gear] * s[gear, at] * z[gear, at - 1])[:, None]
    count = turns.sum(axis=1)
    turn = np.arange(starts.size) - (np.cumsum(count) - count)[gear]
    kept, drive, lasting = (
        np.full((delta.shape[0], count.max(), size), rest)
        for size, rest in ((1, 1.0), (1 + 2 * m, 0.0), (1 + 2 * H, 0.0))
    )
    kept[gear, turn, 0], lasting[gear, turn] = decay[ends], level[gear, None] * parts
    drive[gear, (turn - 1) % count[gear]] = jump * waves[inner(m, H)].T[at - 1]
    y = _periodic(kept[..., 0], drive)
    slope = (level * sharpness)[:, None] * (1 - s * z)
    return slope, y.swapaxes(1, 2) @ lasting


def _slope_spread(c: Complexes, m: int, H: int) -> Floats:
    """As ``spread``, for a slope's Fourier coefficients 0 ... m + H.

    A product of two waves is one of the sum and one of the difference of their orders: the slope's own
    Fourier coefficients hold all of it.
    """
    k, h = np.arange(1, m + 1)[:, None], np.arange(1, H + 1)
    apart, sign, together = np.abs(h - k), np.sign(h - k), h + k
    re, im = np.ascontiguousarray(c.real), np.ascontiguousarray(c.imag)
    found = np.empty((*c.shape[:-1], 1 + 2 * m, 1 + 2 * H))
    sines, cosines = slice(1, 1 + m), slice(1 + m, None)
    found[..., 0, 0], found[..., 0, 1 : 1 + H], found[..., 0, 1 + H :] = (
        re[..., 0], -2 * im[..., 1 : 1 + H], 2 * re[..., 1 : 1 + H]
    )  # fmt: skip
    found[..., sines, 0], found[..., cosines, 0] = -im[..., 1 : 1 + m], re[..., 1 : 1 + m]
    near, far = re[..., apart], re[..., together]
    found[..., sines, 1 : 1 + H], found[..., cosines, 1 + H :] = near - far, near + far
    near, far = sign * im[..., apart], im[..., together]
    found[..., cosines, 1 : 1 + H], found[..., sines, 1 + H :] = -near - far, near - far
    return found


def spread(laws: GearLaws, slope: Floats, samples: Floats, m: int, H: int, of: np.ndarray) -> Floats:
    """Parts of the torque by those of the deflection's mean and first m harmonics, (g, 1 + 2m, 1 + 2H).

    Of the g gears and records in ``of``, shape (r, n), for the slope without the hysteresis, and samples
    of the deflection, each shape (r, n, t).
    """
    c = _fourier(slope[of], m + H)
    level, sharpness = (np.broadcast_to(x[..., 0], of.shape) for x in (laws.level, laws.sharpness))
    loops = of & (level != 0)
    if not loops.any():
        return _slope_spread(c, m, H)
    of_loops, lasting = _loop_spread(level[loops], sharpness[loops], samples[loops], m, H)
    c[loops[of]] += _fourier(of_loops, m + H)
    found = _slope_spread(c, m, H)
    found[loops[of]] += lasting
    return found


def _fourier(samples: Floats, highest: int) -> Complexes:
    return np.asarray(np.fft.rfft(samples, axis=-1)[..., : highest + 1] / samples.shape[-1])
