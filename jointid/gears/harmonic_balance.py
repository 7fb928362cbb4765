"""Harmonic balance: the wind-up of nonlinear gears in periodic motion, from torques and motions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.gears.laws import GearLaws
from jointid.phasors.periods import pairs, phasors_of, samples_of

_POINTS = 8
"""Samples over a period for each harmonic."""
_LEAST_HARMONICS = 16
"""Harmonics that decide the number of samples where there are fewer."""
_NEWTON, _CONVERGED = 24, 1e-6
"""Most Newton steps for the wind-up, and what is left of the torque, over it, that ends them."""
_RESOLVED = 1e-9
"""Least move between samples, over the largest deflection."""


@dataclass(frozen=True, eq=False)
class WoundGears:
    """Solution of κ δ + g(δ) = f for gears with linear dynamic stiffness κ and the torque g beyond.

    A deflection is smooth, the torque through a play is not: where the arm moves less than the gear
    winds up by the same torque, below its resonance with the motor locked, the harmonics of δ follow
    from those of the torque; above, from the motions of motor and arm.
    """

    stiffness: Complexes
    """κ, shape (r, n, H)."""
    beyond: Complexes
    """Phasors of g, shape (r, n, H)."""
    low: np.ndarray
    """Harmonics whose deflection follows from the torque, shape (r, n, m)."""
    spread: Floats
    """Real and imaginary parts of g by those of δ at these harmonics, shape (r, n, 2m, 2H)."""
    inverse: Floats
    """Parts of δ by those of the torque, shape (r, n, 2m, 2m)."""
    delta: Complexes
    """Phasors of the deflection, shape (r, n, H + T), rad."""
    points: int
    """Samples over a period."""

    @classmethod
    def solve(
        cls,
        laws: GearLaws,
        stiffness: Complexes,
        f: Complexes,
        moved: Complexes,
        low: np.ndarray,
        free: Complexes,
        start: Complexes | None = None,
    ) -> WoundGears:
        """Solve by Newton steps, from the linear deflection where no better one is known.

        Parameters
        ----------
        laws : GearLaws
            Arrays of shape (n, 1).
        stiffness, f, moved : ndarray, shape (r, n, H)
            κ, the torque, and the deflection by the motions of motor and arm.
        low : ndarray, shape (r, n, m)
            Harmonics whose deflection follows from the torque.
        free : ndarray, shape (r, n, T)
            Deflection over g at the harmonics H + 1 to H + T, which nothing but the gear drives.
        start : ndarray, shape (r, n, H + T), optional
            The deflection at similar parameters.
        """
        H, m = f.shape[2], low.shape[2]
        points = _POINTS * max(H, _LEAST_HARMONICS)
        delta = np.concatenate([moved, np.zeros_like(free)], axis=2) if start is None else start.copy()
        delta[..., m:H] = moved[..., m:]
        delta[..., :m] = np.where(
            low, (f / stiffness if start is None else start)[..., :m], moved[..., :m]
        )
        both = np.concatenate([low, low], axis=2)
        own = np.zeros((*low.shape[:2], 2 * m, 2 * m))
        k, j = stiffness[..., :m], np.arange(m)
        own[..., j, j] = own[..., m + j, m + j] = k.real
        own[..., j, m + j], own[..., m + j, j] = -k.imag, k.imag
        size = np.abs(f).max(axis=2) + np.finfo(float).tiny
        before, least = delta.copy(), np.full(size.shape, np.inf)
        step = np.zeros((*size.shape, m), complex)
        for turn in range(_NEWTON):
            beyond, slope, samples = beyond_linear(laws, delta, points)
            delta[..., H:], beyond = free * beyond[..., H:], beyond[..., :H]
            spread = _spread(slope, m, H)
            if laws.hysteretic:
                spread = spread + _loop_spread(laws, samples, m, H)
            inward = own + spread[..., [*range(m), *range(H, H + m)]].swapaxes(2, 3)
            inverse = np.linalg.inv(np.where(both[..., None], inward, np.eye(2 * m)))
            left = np.where(low, (f - stiffness * delta[..., :H] - beyond)[..., :m], 0)
            size_left = np.linalg.norm(left, axis=2)
            if turn == _NEWTON - 1 or not np.any(size_left > _CONVERGED * size):
                break
            better = (size_left < least)[..., None]  # where it is not, half the step before
            least = np.minimum(size_left, least)
            before[..., :m] = np.where(better, delta[..., :m], before[..., :m])
            step = np.where(better, _complex(inverse @ _parts(left)[..., None])[..., 0], 0.5 * step)
            delta[..., :m] = before[..., :m] + step
        return cls(stiffness, beyond, low, spread, inverse, delta, points)

    @property
    def law(self) -> Complexes:
        """w, the deflection beyond that of the linear gear under the same torque, (r, n, H), rad."""
        return -self.beyond / self.stiffness

    def change(
        self,
        f: Complexes | float = 0.0,
        beyond: Complexes | float = 0.0,
        stiffness: Complexes | float = 0.0,
    ) -> Complexes:
        """Change of w, shape (r, n, H), with changes of the torque, of g at given δ, and of κ."""
        m, H = self.low.shape[2], self.beyond.shape[2]
        linear = stiffness * (self.delta[..., : self.beyond.shape[2]] if np.any(stiffness) else 0.0)
        left = np.broadcast_to(f - beyond - linear, self.beyond.shape)[..., :m]
        wound = self.inverse @ _parts(np.where(self.low, left, 0))[..., None]
        through = (wound.swapaxes(2, 3) @ self.spread)[..., 0, :]
        whole = beyond + through[..., :H] + 1j * through[..., H:]
        return np.asarray((self.beyond * (stiffness / self.stiffness) - whole) / self.stiffness)


def beyond_linear(laws: GearLaws, delta: Complexes, points: int) -> tuple[Complexes, Floats, Floats]:
    """Phasors (..., H) of the torque beyond K δ for those of δ, its slope without the loop, and samples.

    Play, changes of slope and hysteresis are averaged over each step between samples, in which the
    deflection moves uniformly, by their energy (the discrete gradient of Gonzalez, Journal of Nonlinear
    Science 6, 1996) and by Dahl's exponential: an edge within a step is exact. The samples are those
    whose chords have the mean deflection of the step.
    """
    H = delta.shape[-1]
    turn = np.arange(1, H + 1) / points
    found, slope = np.zeros_like(delta), np.zeros((*delta.shape[:-1], points))
    if laws.hardens:
        plain = samples_of(delta, points)
        found, slope = phasors_of(laws.smooth(plain), H), laws.smooth_slope(plain)
    chords = samples_of(delta * (np.sinc(turn) / np.cos(np.pi * turn)), points)
    if not (laws.plays or laws.bent or laws.hysteretic):
        return found, slope, chords
    move = chords - np.roll(chords, 1, axis=-1)
    least = _RESOLVED * np.abs(chords).max(axis=-1, keepdims=True) + np.finfo(float).tiny
    move = np.where(np.abs(move) < least, np.copysign(least, move), move)
    torque = laws.kinked(chords)
    energy = laws.kinked_energy(chords)
    mean = (energy - np.roll(energy, 1, axis=-1)) / move
    if laws.hysteretic:
        z = dahl(chords, laws.sharpness)  # its slope depends on all moves before: ``_loop_spread``
        change = z - np.roll(z, 1, axis=-1)
        average = np.sign(move) - change / np.where(
            laws.sharpness > 0, laws.sharpness * np.abs(move), 1.0
        )
        mean = mean + laws.level * average
    found = found + phasors_of(mean, H) * np.exp(1j * np.pi * turn) / np.sinc(turn)
    steep = (torque - np.roll(torque, 1, axis=-1)) / move
    return found, slope + 0.5 * (steep + np.roll(steep, -1, axis=-1)), chords


def dahl(delta: Floats, sharpness: Floats) -> Floats:
    """Dahl's z over a period, dz/dδ = sharpness (1 − z sign δ̇), periodic; last axis time."""
    move = _moves(delta)
    decay = np.exp(-np.abs(move) * sharpness[..., 0])
    return np.moveaxis(_periodic(decay, np.sign(move) * (1 - decay)), 0, -1)


def _moves(delta: Floats) -> Floats:
    """Moves to the next sample, first axis time."""
    return np.moveaxis(np.diff(delta, axis=-1, append=delta[..., :1]), -1, 0)


def _periodic(decay: Floats, drive: Floats) -> Floats:
    """Periodic solution of z[k + 1] = decay[k] z[k] + drive[k], first axis time."""
    z = np.zeros((len(drive) + 1, *drive.shape[1:]))  # from zero
    for k in range(len(drive)):
        np.multiply(decay[k], z[k], out=z[k + 1])
        z[k + 1] += drive[k]
    left = np.cumprod(np.concatenate([np.ones_like(decay[:1]), decay]), axis=0)
    first = z[-1] / np.maximum(1 - left[-1], 1e-9)
    return np.asarray(z[:-1] + left[:-1] * first)


def _loop_spread(laws: GearLaws, delta: Floats, m: int, H: int) -> Floats:
    """As ``_spread``, for the torque of the hysteresis, which depends on all moves before."""
    waves = pairs(H, delta.shape[-1])
    inner = waves[[*range(m), *range(H, H + m)]]
    move, z = _moves(delta), np.moveaxis(dahl(delta, laws.sharpness), -1, 0)
    decay = np.exp(-np.abs(move) * laws.sharpness[..., 0])
    gain = laws.sharpness[..., 0] * decay * (1 - np.sign(move) * z)
    changes = _periodic(decay[..., None], gain[..., None] * _moves(inner)[:, None, None])
    parts = np.moveaxis(changes, 0, -1) @ waves.T * (2 / delta.shape[-1])
    return np.asarray(laws.level[..., None] * parts)


def _spread(slope: Floats, m: int, H: int) -> Floats:
    """Parts of the torque's H harmonics by those of the deflection's first m, for a slope over time."""
    waves = pairs(H, slope.shape[-1])
    inner = waves[[*range(m), *range(H, H + m)]]
    return np.asarray((slope[..., None, :] * inner) @ waves.T * (2 / slope.shape[-1]))


def _parts(z: Complexes) -> Floats:
    return np.concatenate([z.real, z.imag], axis=-1)


def _complex(parts: Floats) -> Complexes:
    m = parts.shape[2] // 2
    return np.asarray(parts[:, :, :m] + 1j * parts[:, :, m:])
