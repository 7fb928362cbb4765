"""Change of a gear's torque in periodic motion with the harmonics of its deflection."""

from functools import lru_cache

import numpy as np

from jointid.arrays import Floats
from jointid.gears.laws import GearLaws
from jointid.phasors.periods import pairs


def dahl(delta: Floats, sharpness: Floats) -> Floats:
    """Dahl's z over a period, dz/dδ = sharpness (1 − z sign δ̇), periodic; last axis time."""
    move = _moves(delta)
    decay = np.exp(-np.abs(move) * sharpness[..., 0])
    return np.moveaxis(_periodic(decay, np.sign(move) * (1 - decay)), 0, -1)


def _moves(delta: Floats) -> Floats:
    """Moves to the next sample, first axis time."""
    return np.moveaxis(np.diff(delta, axis=-1, append=delta[..., :1]), -1, 0)


def _periodic(decay: Floats, drive: Floats) -> Floats:
    """Periodic solution of z[k + 1] = decay[k] z[k] + drive[k], first axis time.

    Blocks are solved side by side from zero, with the effect of their starts, and then joined.
    """
    samples = len(drive)
    length = int(np.ceil(np.sqrt(samples)))
    blocks = -(-samples // length)
    spare = ((0, blocks * length - samples),)
    decay = np.pad(decay, spare + ((0, 0),) * (decay.ndim - 1), constant_values=1.0)
    drive = np.pad(drive, spare + ((0, 0),) * (drive.ndim - 1))
    decay, drive = (x.reshape(blocks, length, *x.shape[1:]).swapaxes(0, 1) for x in (decay, drive))
    z = np.zeros((length + 1, *drive.shape[1:]))
    left = np.ones((length + 1, *decay.shape[1:]))
    for k in range(length):
        np.multiply(decay[k], z[k], out=z[k + 1])
        z[k + 1] += drive[k]
        np.multiply(decay[k], left[k], out=left[k + 1])
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


def _loop_spread(laws: GearLaws, delta: Floats, m: int, H: int) -> Floats:
    """As ``smooth_spread``, for the torque of the hysteresis, which depends on all moves before.

    While δ moves in one direction s from a reversal, 1 − sz decays with it: with z' at the reversal and
    g = dz/dδ = sharpness (1 − sz), z' = g δ' + decay · y, and y = z' − g δ' just after the reversal
    lasts until the next one.
    """
    waves, weights = _waves(H, delta.shape[-1])
    z, s = dahl(delta, laws.sharpness), np.sign(delta - np.roll(delta, 1, axis=-1))
    s[s == 0] = 1.0
    slope = laws.sharpness * (1 - s * z)
    found = smooth_spread(laws.level * slope, m, H)
    shape = delta.shape[:-1]
    level, sharpness = (np.broadcast_to(x[..., 0], shape) for x in (laws.level, laws.sharpness))
    for place in np.ndindex(shape):
        turns = np.flatnonzero(s[place] != np.roll(s[place], 1))
        if level[place] and turns.size:
            order = np.roll(np.arange(delta.shape[-1]), -turns[0])
            length = np.diff(turns, append=turns[0] + order.size)
            moved = delta[place][order] - np.repeat(delta[place][turns - 1], length)
            decay = np.exp(-np.abs(moved) * sharpness[place])
            starts = turns - turns[0]
            parts = np.add.reduceat(decay[:, None] * weights[order], starts)
            jump = 2 * (sharpness[place] * s[place][turns] * z[place][turns - 1])[:, None]
            drive = jump * waves[inner(m, H)][:, turns - 1].T
            y = _periodic(decay[starts + length - 1, None], np.roll(drive, -1, axis=0))
            found[place] += level[place] * (y.T @ parts)
    return found


def smooth_spread(slope: Floats, m: int, H: int) -> Floats:
    """Parts of the torque by those of the deflection's mean and first m harmonics, for a slope.

    A product of two waves is one of the sum and one of the difference of their orders: the slope's own
    Fourier coefficients hold all of it.
    """
    c = np.fft.rfft(slope, axis=-1)[..., : m + H + 1] / slope.shape[-1]
    k, h = np.arange(1, m + 1)[:, None], np.arange(1, H + 1)
    apart, sign, together = np.abs(h - k), np.sign(h - k), h + k
    re, im = np.ascontiguousarray(c.real), np.ascontiguousarray(c.imag)
    found = np.empty((*slope.shape[:-1], 1 + 2 * m, 1 + 2 * H))
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


def whole_spread(laws: GearLaws, slope: Floats, samples: Floats, m: int, H: int) -> Floats:
    """As ``smooth_spread``, with that of the hysteresis."""
    spread = smooth_spread(slope, m, H)
    return spread + _loop_spread(laws, samples, m, H) if laws.hysteretic else spread
