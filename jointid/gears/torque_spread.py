"""Change of torques in periodic motion, of gears and of friction, with the harmonics of the motion."""

from functools import lru_cache

import numpy as np
from scipy.sparse import csr_array

from jointid.arrays import Complexes, Floats
from jointid.gears.laws import GearLaws
from jointid.phasors.periods import pairs


def periodic_dahl(delta: Floats, sharpness: Floats) -> Floats:
    """Dahl's z over a period, dz/dδ = sharpness (1 − z sign δ̇), periodic; last axis time."""
    move = np.moveaxis(np.diff(delta, axis=-1, append=delta[..., :1]), -1, 0)
    decay = np.exp(-np.abs(move) * sharpness[..., 0])
    return np.moveaxis(_periodic(decay, np.sign(move) * (1 - decay)), 0, -1)


def _periodic(decay: Floats, drive: Floats) -> Floats:
    """Periodic solution of z[k + 1] = decay[k] z[k] + drive[k], first axis time.

    Blocks are solved side by side from zero, with the effect of their starts, and then joined.
    """
    samples = len(drive)
    length = int(np.ceil(np.sqrt(samples)))
    blocks = -(-samples // length)

    def split(x: Floats, rest: float) -> Floats:
        filled = np.full((blocks * length, *x.shape[1:]), rest)
        filled[:samples] = x
        return filled.reshape(blocks, length, *x.shape[1:]).swapaxes(0, 1)

    decay, drive = split(decay, 1.0), split(drive, 0.0)
    z = np.zeros((length + 1, *drive.shape[1:]))
    for k in range(length):
        np.multiply(decay[k], z[k], out=z[k + 1])
        z[k + 1] += drive[k]
    left = np.cumprod(np.concatenate([np.ones_like(decay[:1]), decay]), axis=0)
    start = np.zeros((blocks + 1, *z.shape[2:]))
    for k in range(blocks):
        start[k + 1] = left[-1, k] * start[k] + z[-1, k]
    before = np.cumprod(np.concatenate([np.ones_like(left[-1, :1]), left[-1]]), axis=0)
    start += before * (start[-1] / np.maximum(1 - before[-1], 1e-9))
    whole = z[:-1] + left[:-1] * start[:-1]
    return np.asarray(whole.swapaxes(0, 1).reshape(blocks * length, *whole.shape[2:])[:samples])


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
    """Slope of the torque of the hysteresis, and its spread by the moves before, beside that slope's.

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
        np.full((count.max(), delta.shape[0], size), rest)
        for size, rest in ((1, 1.0), (1 + 2 * m, 0.0), (1 + 2 * H, 0.0))
    )
    kept[turn, gear, 0], lasting[turn, gear] = decay[ends], level[gear, None] * parts
    drive[(turn - 1) % count[gear], gear] = jump * waves[inner(m, H)].T[at - 1]
    y = _periodic(kept, drive)
    slope = (level * sharpness)[:, None] * (1 - s * z)
    return slope, y.transpose(1, 2, 0) @ lasting.swapaxes(0, 1)


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
