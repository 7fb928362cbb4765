"""Change of torques in periodic motion, of gears and of friction, with the harmonics of the motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_array

from jointid.arrays import Complexes, Floats
from jointid.gears.laws import GearLaws
from jointid.phasors.periods import pairs, phasors_of, samples_of

_NEWTON = 4
"""Newton steps for the motion of arms with friction: friction of 3 % of the torque takes three."""


def dahl(delta: Floats, sharpness: Floats) -> Floats:
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
    z, s = dahl(delta, sharpness[:, None]), np.sign(delta - np.roll(delta, 1, axis=1))
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


@dataclass(frozen=True, eq=False)
class ArmFriction:
    """Coulomb friction P = F sign θ̇ of arms in periodic motion θ̇ = Y (f − P) under torques f.

    The friction changes the motion, by more where joints are strongly coupled. Of the samples of the
    sign only those at its jumps, up to m over a period, change with θ̇.
    """

    level: Floats
    """F, shape (n,), N·m."""
    mobility: Complexes
    """Y, shape (r, H, n, n)."""
    sign: Complexes
    """Phasors of sign θ̇, shape (r, H, n)."""
    inner: Floats
    """Change of the samples at jumps by the sines and cosines of θ̇, shape (r, n, m, 2H)."""
    outer: Floats
    """Their sines and cosines, shape (r, n, 2H, m)."""

    @classmethod
    def solve(cls, level: Floats, mobility: Complexes, torque: Complexes, points: int) -> ArmFriction:
        """Newton steps from the motion without friction under torques f, shape (r, H, n).

        They are halved where they lead away, as with an arm that sticks.
        """
        before = force = step = np.zeros_like(torque)
        least = np.full(len(torque), np.inf)
        for _ in range(_NEWTON):
            found = cls.at(level, mobility, torque - force, points)
            left = level * found.sign - force
            size = np.linalg.norm(left, axis=(1, 2))
            better = (size < least)[:, None, None]
            before, least = np.where(better, force, before), np.fmin(size, least)
            step = np.where(better, found.settled(left[..., None])[..., 0], 0.5 * step)
            force = before + step
        return cls.at(level, mobility, torque - force, points)

    @classmethod
    def at(cls, level: Floats, mobility: Complexes, torque: Complexes, points: int) -> ArmFriction:
        """Friction in the motion under torques f − P, shape (r, H, n)."""
        H = torque.shape[1]
        waves = pairs(H, points).T
        x = samples_of((mobility @ torque[..., None])[..., 0].swapaxes(1, 2), points)
        sign = phasors_of(signs(x), H).swapaxes(1, 2)
        rise = np.roll(x, -1, axis=-1) - np.roll(x, 1, axis=-1)
        inside = np.abs(x) < 0.25 * np.abs(rise)
        place = np.argsort(~inside, axis=-1, kind="stable")[..., : max(1, inside.sum(axis=-1).max())]
        x, rise = (np.take_along_axis(v, place, axis=-1)[..., None] for v in (x, rise))
        inside = np.take_along_axis(inside, place, axis=-1)[..., None]
        rise, own = np.where(inside, rise, np.inf), waves[place]
        move = (x / rise) * (waves[(place + 1) % points] - waves[place - 1])
        inner = np.where(inside, 4 * (own - move) / np.abs(rise), 0.0)
        return cls(level, mobility, sign, inner, (2 / points) * own.swapaxes(2, 3))

    def by_motion(self, change: Complexes) -> Complexes:
        """Change of P for changes of Y f, both shape (r, H, n, c)."""
        return self.settled(self._forces(np.asarray(self.inner @ _rows(change))))

    def settled(self, force: Complexes) -> Complexes:
        """Changes of P that remain of ones at a given motion, which they change; (r, H, n, c)."""
        r, n, m, _ = self.inner.shape
        each = np.eye(n * m).reshape(1, n, m, n * m)
        jumps = self._jumps(self._forces(each)) + np.eye(n * m)
        sizes = np.linalg.solve(jumps, self._jumps(force))
        left = self._forces(np.asarray(sizes.reshape(r, n, m, -1)))
        return np.asarray(force - left)

    def _jumps(self, force: Complexes) -> Floats:
        """Change of −sign at the jumps with forces (r, H, n, c), shape (r, n m, c)."""
        found = self.inner @ _rows(self.mobility @ force)
        return np.asarray(found.reshape(len(found), -1, force.shape[3]))

    def _forces(self, samples: Floats) -> Complexes:
        """Phasors (r, H, n, c) of F times samples at the jumps, (r, n, m, c)."""
        found = self.outer @ samples
        H = found.shape[2] // 2
        phasors = (found[:, :, :H] + 1j * found[:, :, H:]).swapaxes(1, 2)
        return np.asarray(self.level[:, None] * phasors)


def _rows(phasors: Complexes) -> Floats:
    """Real above imaginary parts, (r, n, 2H, c), of phasors (r, H, n, c)."""
    return np.concatenate([phasors.real, phasors.imag], axis=1).swapaxes(1, 2)


def signs(x: Floats) -> Floats:
    """Sign of periodic samples, with a jump that is resolved between samples."""
    step = 0.25 * np.abs(np.roll(x, -1, axis=-1) - np.roll(x, 1, axis=-1))
    inside = np.abs(x) < step
    return np.where(inside, x / np.where(inside, step, 1.0), np.sign(x))
