"""Harmonic balance: the deflection of nonlinear gears in periodic motion, from torques and motions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from jointid.arrays import Complexes, Floats
from jointid.gears.gear import Gear
from jointid.gears.laws import GearLaws
from jointid.gears.torque_spread import dahl, inner, spread
from jointid.phasors.periods import phasors_of, samples_of

_POINTS = 8
"""Samples over a period for each harmonic."""
_FURTHER_POINTS = 4
"""The same where the highest harmonics are small ones that are measured."""
_LEAST_HARMONICS = 16
"""Harmonics that decide the number of samples where there are fewer."""
_SINE_POINTS = 512
"""Samples of a sine."""
_NEWTON, _CONVERGED = 36, 1e-6
"""Most Newton steps for the deflection, and the relative torque residual that ends them."""
_NEWTON_OF_LOOPS = 6
"""Most steps where further deflection is measured, as of loops in motions: a right law takes fewer, a
wrong one minutes with 36."""
_MANY = 32
"""Harmonics from which slopes are not inverted at every solution."""
_SLOW, _SLOW_OF_MANY = 0.2, 0.5
"""Ratio of torque residuals of a step with earlier slopes from which they are evaluated again."""
_CENTRED = 1e-9
"""Stiffness, over K, that holds a gear in the middle of backlash that it never leaves."""
_RESOLVED = 1e-9
"""Least move between samples, over the largest deflection."""


@dataclass(frozen=True, eq=False)
class WoundGears:
    """Solution of κ δ + g(δ) = f for gears with linear dynamic stiffness κ and the torque g beyond.

    A deflection is smooth, the torque through backlash is not: where the arm moves less than the gear
    winds up by the same torque, below its resonance with the motor locked, the harmonics of δ follow
    from those of the torque; above, from the motions of motor and arm. The mean of δ is that of a gear
    without mean torque: wide backlash has periodic motions that lean to one side.
    """

    laws: GearLaws
    stiffness: Complexes
    """κ, shape (r, n, H)."""
    beyond: Complexes
    """Mean and phasors of g, shape (r, n, 1 + H)."""
    low: np.ndarray
    """Harmonics whose deflection follows from the torque, shape (r, n, m)."""
    delta: Complexes
    """Mean and phasors of the deflection, shape (r, n, 1 + H + T), rad."""
    points: int
    """Samples over a period."""
    earlier: Floats
    """``inverse`` at a similar deflection."""

    @classmethod
    def solve(
        cls,
        laws: GearLaws,
        stiffness: Complexes,
        f: Complexes,
        moved: Complexes,
        low: np.ndarray,
        free: Complexes,
        start: WoundGears | None = None,
        *,
        given: Complexes | None = None,
    ) -> WoundGears:
        """Solve by Newton steps, from the linear deflection where no better one is known.

        Their slopes are those of earlier steps as long as these lead on quickly: to invert the slopes
        takes far longer than to evaluate the torque.

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
        start : WoundGears, optional
            The solution at similar parameters.
        given : ndarray, shape (r, n, T), optional
            Further deflection at the harmonics H + 1 to H + T, as measured.
        """
        H, m = f.shape[2], low.shape[2]
        measured = 0.0 if given is None or not given.size else given
        further = free.shape[2] * (given is measured)
        points = max(_POINTS * max(H, _LEAST_HARMONICS), _FURTHER_POINTS * (H + further))
        first = _started(laws, f, stiffness, points) if start is None else start.delta
        mean = np.zeros_like(f[..., :1])
        solved = np.concatenate([np.ones((*low.shape[:2], 1), bool), low], axis=2)
        delta = np.concatenate([first[..., :1], moved, first[..., 1 + H :]], axis=2)
        delta[..., : 1 + m] = np.where(solved, first[..., : 1 + m], delta[..., : 1 + m])
        if start is None:
            delta = np.concatenate([delta, measured + np.zeros_like(free)], axis=2)
        kappa = np.concatenate([mean + (1 + _CENTRED) * laws.K, stiffness], axis=2)
        f = np.concatenate([mean, f], axis=2)
        size = np.abs(f).max(axis=2) + np.finfo(float).tiny
        before, least = delta.copy(), np.full(size.shape, np.inf)
        step = np.zeros((*size.shape, 1 + m), complex)
        old = np.full(size.shape, start is None)  # whose slopes are of no use
        fresh = np.zeros(size.shape, bool)  # whose last step is with slopes where it began
        if start is None:  # a linear gear
            none = np.zeros((*size.shape, 1 + 2 * m, 1 + 2 * m))
            inverse = _inward(np.asarray(1 / kappa, complex), none, solved)
        else:
            inverse = start.latest_inverse.copy()
        most = _NEWTON_OF_LOOPS if given is measured and laws.hysteretic else _NEWTON
        slow = _SLOW if m < _MANY else _SLOW_OF_MANY
        for turn in range(most):
            beyond, slope, samples = beyond_linear(laws, delta, points)
            delta[..., 1 + H :] = measured + free * beyond[..., 1 + H :]
            beyond = beyond[..., : 1 + H]
            left = np.where(solved, (f - kappa * delta[..., : 1 + H] - beyond)[..., : 1 + m], 0)
            size_left = np.linalg.norm(left, axis=2)
            is_open = size_left > _CONVERGED * size
            if turn == most - 1 or not np.any(is_open):
                break
            better = size_left < least
            due = better & is_open & (old | (size_left > slow * least))
            if np.any(due):
                inverse[due] = _inverse(laws, slope, samples, H, kappa, solved, due)
            old = ~better & ~fresh  # to where that step began
            fresh = np.where(better, due, fresh)
            least = np.where(old, np.inf, np.minimum(size_left, least))
            before[..., : 1 + m] = np.where(better[..., None], delta[..., : 1 + m], before[..., : 1 + m])
            newton = _complex(inverse @ _parts(left)[..., None])[..., 0]
            # Where it is not better, half the step before.
            shorter = np.where(old[..., None], 0, 0.5 * step)
            step = np.where(better[..., None], newton, shorter)
            delta[..., : 1 + m] = before[..., : 1 + m] + step
        return cls(laws, stiffness, beyond, low, delta, points, inverse)

    @property
    def latest_inverse(self) -> Floats:
        """``inverse`` if it is known already, else that of an earlier step."""
        return np.asarray(vars(self).get("inverse", self.earlier))

    @cached_property
    def spread(self) -> Floats:
        """Parts of g by those of δ at the mean and the low harmonics, (r, n, 1 + 2m, 1 + 2H)."""
        return self._spread(self.low.shape[2])

    def _spread(self, m: int) -> Floats:
        _, slope, samples = beyond_linear(self.laws, self.delta, self.points)
        H, of = self.stiffness.shape[2], np.ones(slope.shape[:2], bool)
        whole = spread(self.laws, slope, _thinned(samples, H), m, H, of)
        return whole.reshape(*of.shape, *whole.shape[1:])

    @cached_property
    def inverse(self) -> Floats:
        """Parts of δ by those of the torque, shape (r, n, 1 + 2m, 1 + 2m)."""
        return np.asarray(np.linalg.inv(self._inward))

    @cached_property
    def _inward(self) -> Floats:
        m, H = self.low.shape[2], self.stiffness.shape[2]
        solved = np.concatenate([np.ones((*self.low.shape[:2], 1), bool), self.low], axis=2)
        mean = np.broadcast_to((1 + _CENTRED) * self.laws.K, (*self.low.shape[:2], 1))
        kappa = np.concatenate([mean, self.stiffness], axis=2)
        return _inward(kappa, self.spread[..., inner(m, H)], solved)

    def _wound(self, left: Floats) -> Floats:
        """Parts of δ by those of the torque, shape (r, n, 1 + 2m, 1)."""
        if self.low.shape[2] < _MANY:
            return np.asarray(self.inverse @ left)
        parts = zip(self._factors, left.reshape(-1, *left.shape[2:]), strict=True)
        found = [lu_solve(factors, each, check_finite=False) for factors, each in parts]
        return np.asarray(found).reshape(left.shape)

    @cached_property
    def _factors(self) -> list[tuple[Floats, np.ndarray]]:
        """Of the slopes of each gear in each record: an inverse of many harmonics takes far longer."""
        each = self._inward.reshape(-1, *self._inward.shape[2:])
        return [lu_factor(slopes, check_finite=False) for slopes in each]

    @property
    def law(self) -> Complexes:
        """w, the deflection beyond that of the linear gear under the same torque, (r, n, H), rad."""
        return -self.beyond[..., 1:] / self.stiffness

    def change(
        self,
        f: Complexes | float = 0.0,
        beyond: Complexes | float = 0.0,
        stiffness: Complexes | float = 0.0,
    ) -> Complexes:
        """Change of w, shape (r, n, H), with changes of the torque, of g at given δ, and of κ.

        All have a mean before their phasors, shape (r, n, 1 + H).
        """
        m, H = self.low.shape[2], self.stiffness.shape[2]
        linear = stiffness * self.delta[..., : 1 + H] if np.any(stiffness) else 0.0
        left = np.broadcast_to(f - beyond - linear, self.beyond.shape)[..., : 1 + m].copy()
        left[..., 1:] = np.where(self.low, left[..., 1:], 0)
        wound = self._wound(_parts(left)[..., None])
        through = _complex((wound.swapaxes(2, 3) @ self.spread).swapaxes(2, 3))[..., 0]
        whole = (beyond + through)[..., 1:]
        if np.any(stiffness):
            whole = whole - self.beyond[..., 1:] * (np.asarray(stiffness)[..., 1:] / self.stiffness)
        return np.asarray(-whole / self.stiffness)

    def noise(self, torque: Floats, moved: Floats) -> tuple[Complexes, Complexes, Floats]:
        """Change of w with noise of torque and ``moved`` at the same harmonic, and variance by others.

        Each (r, n, H). A gear that is far from linear, near a motion that leans or jumps, answers noise
        of one harmonic in others, and by more than the linear gear does.

        Parameters
        ----------
        torque, moved : ndarray, shape (r, n, H)
            Variance of the complex phasors of the torque, and of the deflection by the motions.
        """
        m, H = self.low.shape[2], self.stiffness.shape[2]
        spread = self._spread(H)
        solved = np.concatenate([np.ones((*self.low.shape[:2], 1), bool), self.low, self.low], axis=2)
        into = np.where(solved[..., None, :], spread[..., inner(m, H)], 0)
        by_torque = self.spread.swapaxes(2, 3) @ np.where(solved[..., None, :], self.inverse, 0)
        by_moved = spread.swapaxes(2, 3) - by_torque @ into.swapaxes(2, 3)
        given = np.concatenate([~self.low, np.ones_like(moved[..., m:], bool)], axis=2)
        rest, own = np.zeros_like(torque), []
        for by, used, variance in ((by_torque, self.low, torque), (by_moved, given, moved)):
            count = used.shape[2]
            parts = by[..., 1:, 1:].reshape(*torque.shape[:2], 2, H, 2, count)
            rest += (
                (parts**2).sum(axis=(2, 4)) @ (0.5 * np.where(used, variance[..., :count], 0))[..., None]
            )[..., 0]
            j = np.arange(count)
            (rr, ri), (ir, ii) = parts[:, :, :, j, :, j].transpose(3, 4, 1, 2, 0)
            own.append(np.zeros_like(self.stiffness))
            own[-1][..., :count] = np.where(used, 0.5 * (rr + ii) + 0.5j * (ir - ri), 0)
            rest -= np.abs(own[-1]) ** 2 * variance
        rest = np.maximum(rest, 0) / np.abs(self.stiffness) ** 2
        return -own[0] / self.stiffness, -own[1] / self.stiffness, rest


def _thinned(samples: Floats, H: int) -> Floats:
    """Samples that suffice for slopes."""
    return samples[..., :: samples.shape[-1] // (_POINTS * max(H, _LEAST_HARMONICS))]


def _inverse(
    laws: GearLaws,
    slope: Floats,
    samples: Floats,
    H: int,
    kappa: Complexes,
    solved: np.ndarray,
    due: np.ndarray,
) -> Floats:
    """``WoundGears.inverse`` of some gears in some records, due (r, n), at samples of the deflection."""
    m = solved.shape[2] - 1
    whole = spread(laws, slope, _thinned(samples, H), m, m, due)
    inward = _inward(kappa[due], whole, solved[due])
    precision = np.float64 if m < _MANY else np.float32
    return np.asarray(np.linalg.inv(inward.astype(precision)), np.float64)


def _inward(kappa: Complexes, spread: Floats, solved: np.ndarray) -> Floats:
    """Matrix of κ (..., 1 + H) and a spread (..., 1 + 2m, 1 + 2m) where solved (..., 1 + m)."""
    m = solved.shape[-1] - 1
    inward = np.array(spread.swapaxes(-2, -1))
    j, k = np.arange(1, 1 + m), kappa[..., 1 : 1 + m]
    inward[..., 0, 0] += kappa[..., 0].real
    inward[..., j, j] += k.real
    inward[..., m + j, m + j] += k.real
    inward[..., j, m + j] -= k.imag
    inward[..., m + j, j] += k.imag
    unknown = np.concatenate([solved, solved[..., 1:]], axis=-1)
    return np.where(unknown[..., None], inward, np.eye(1 + 2 * m))


def _started(laws: GearLaws, f: Complexes, stiffness: Complexes, points: int) -> Complexes:
    """Mean and phasors of the linear deflection, and half the backlash in the torque's direction."""
    delta = f / stiffness
    if laws.has_backlash:
        delta = delta + laws.half_backlash * phasors_of(np.sign(samples_of(f, points)), f.shape[2])
    return np.concatenate([np.zeros_like(f[..., :1]), delta], axis=2)


def beyond_linear(laws: GearLaws, delta: Complexes, points: int) -> tuple[Complexes, Floats, Floats]:
    """Torque beyond K δ, mean and phasors (..., 1 + H) as δ, its slope without the loop, and samples.

    Play, changes of slope and hysteresis are averaged over each step between samples, in which the
    deflection moves uniformly, by their energy (the discrete gradient of Gonzalez, Journal of Nonlinear
    Science 6, 1996) and by Dahl's exponential: an edge within a step is exact. The samples are those
    whose chords have the mean deflection of the step.
    """
    mean, delta = delta[..., :1], delta[..., 1:]
    H = delta.shape[-1]
    turn = np.arange(1, H + 1) / points
    found, slope = np.zeros((*delta.shape[:-1], 1 + H), complex), np.zeros((*delta.shape[:-1], points))
    if laws.hardens:
        plain = mean.real + samples_of(delta, points)
        torque = laws.smooth(plain)
        found[..., 0], found[..., 1:] = torque.mean(axis=-1), phasors_of(torque, H)
        slope = laws.smooth_slope(plain)
    chords = mean.real + samples_of(delta * (np.sinc(turn) / np.cos(np.pi * turn)), points)
    if not (laws.has_backlash or laws.bent or laws.hysteretic):
        return found, slope, chords
    move = chords - np.roll(chords, 1, axis=-1)
    least = _RESOLVED * np.abs(chords).max(axis=-1, keepdims=True) + np.finfo(float).tiny
    move = np.where(np.abs(move) < least, np.copysign(least, move), move)
    torque, energy = laws.kinked(chords), laws.kinked_energy(chords)
    average = (energy - np.roll(energy, 1, axis=-1)) / move
    if laws.hysteretic:
        z = dahl(chords, laws.sharpness)  # its slope depends on all moves before: ``_loop_spread``
        change = z - np.roll(z, 1, axis=-1)
        turns = np.where(laws.sharpness > 0, laws.sharpness * np.abs(move), 1.0)
        average = average + laws.level * (np.sign(move) - change / turns)
    found[..., 0] += average.mean(axis=-1)
    found[..., 1:] += phasors_of(average, H) * np.exp(1j * np.pi * turn) / np.sinc(turn)
    steep = (torque - np.roll(torque, 1, axis=-1)) / move
    return found, slope + 0.5 * (steep + np.roll(steep, -1, axis=-1)), chords


def sine_stiffness(gear: Gear, amplitude_rad: Floats) -> Floats:
    """Stiffness of a gear at sines of the deflection, with hysteresis, N·m/rad; like the amplitudes."""
    delta = np.zeros((*amplitude_rad.shape, 2), complex)
    delta[..., 1] = amplitude_rad
    beyond, *_ = beyond_linear(GearLaws.of([gear]), delta, _SINE_POINTS)
    return np.asarray(gear.K + beyond[..., 1].real / amplitude_rad)


def _parts(z: Complexes) -> Floats:
    """Mean, real and imaginary parts."""
    return np.concatenate([z.real, z[..., 1:].imag], axis=-1)


def _complex(parts: Floats) -> Complexes:
    """Mean and phasors, third axis, of their parts."""
    m = parts.shape[2] // 2
    found = parts[:, :, : 1 + m].astype(complex)
    found[:, :, 1:] += 1j * parts[:, :, 1 + m :]
    return found
