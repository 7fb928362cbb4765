"""Harmonic balance: the deflection of nonlinear gears in periodic motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.gears.gear import Gear
from jointid.gears.laws import GearLaws
from jointid.gears.torque_spread import average_dahl, inner, spread
from jointid.phasors.periods import phasors_of, samples_of

_POINTS = 8
"""Samples over a period for each harmonic."""
_FURTHER_POINTS = 4
"""The same where the highest harmonics are small ones that are measured."""
_LEAST_HARMONICS = 16
"""Harmonics that decide the number of samples where there are fewer."""
_NEWTON, _CONVERGED = 36, 1e-6
"""Most Newton steps for the deflection, and its relative residual that ends them."""
_MANY = 32
"""Harmonics from which slopes are inverted seldom and roughly."""
_FELT = 0.3
"""Compliance times K from which a further harmonic is solved with the first ones: g changes it much near
a resonance of motor and arm."""
_SLOW, _SLOW_OF_MANY = 0.2, 0.5
"""Ratio of residuals of a step with earlier slopes from which they are evaluated again."""
_CENTRED = 1e-9
"""Stiffness, over K, that holds a gear in the middle of backlash that it never leaves."""
_RESOLVED = 1e-9
"""Least move between samples, over the largest deflection."""


@dataclass(frozen=True, eq=False)
class WoundGears:
    """Solution of δ = F − β g(δ): deflection of gears with the torque g beyond K δ, at all harmonics.

    F is the deflection that signals give without the law, β the compliance by which g changes it: 1/κ
    where it follows from the torque through a gear of dynamic stiffness κ, 0 where it is measured. The
    mean of δ is that of a gear without mean torque: wide backlash has periodic motions with a mean
    deflection.
    """

    laws: GearLaws
    compliance: Complexes
    """β, shape (r, n, 1 + H + T) like F, the mean first."""
    beyond: Complexes
    """Mean and phasors of g, shape (r, n, 1 + H)."""
    delta: Complexes
    """Mean and phasors of the deflection, shape (r, n, 1 + H + T), rad."""
    inverse: Floats
    """Parts of δ by those of F at the mean and the first m harmonics, (r, n, 1 + 2m, 1 + 2m), there or
    at a similar deflection."""

    @classmethod
    def solve(
        cls,
        laws: GearLaws,
        drive: Complexes,
        compliance: Complexes,
        H: int,
        m: int,
        start: WoundGears | None = None,
    ) -> WoundGears:
        """Solve by Newton steps at the first m harmonics, from ``start`` or the linear deflection.

        Slopes of earlier steps are reused while they converge quickly: inverting them takes far longer
        than evaluating the torque. Further harmonics, which g hardly changes, follow; m is larger where
        it changes them much.

        Parameters
        ----------
        laws : GearLaws
            Arrays of shape (n, 1).
        drive, compliance : ndarray, shape (r, n, 1 + H + T)
            F and β; the mean is overwritten.
        H, m : int
            Harmonics of g that are asked for, and those that depend on it much.
        start : WoundGears, optional
            The solution at similar parameters.
        """
        points = _points(H, drive.shape[2])
        drive, compliance = drive.copy(), compliance.copy()
        drive[..., 0], compliance[..., 0] = 0, 1 / ((1 + _CENTRED) * laws.K[:, 0])
        felt = np.abs(compliance[..., 1 + H :] * laws.K) > _FELT
        m = max([m, *(H + 1 + np.flatnonzero(felt.any(axis=(0, 1)))).tolist()])
        if start is None:
            delta = drive.copy()
            if laws.has_backlash:  # on the flank in the direction of the torque
                sign = phasors_of(np.sign(samples_of(drive[..., 1:], points)), drive.shape[2] - 1)
                delta[..., 1:] += compliance[..., 1:] * laws.K * laws.half_backlash * sign
        else:
            delta = start.delta.copy()
            other = slice(1 + m, 1 + H)
            delta[..., other] = drive[..., other] - compliance[..., other] * start.beyond[..., other]
        if start is not None and start.inverse.shape[2] == 1 + 2 * m:
            inverse = start.inverse.copy()
        else:  # of a linear gear
            start, inverse = None, np.tile(np.eye(1 + 2 * m), (*drive.shape[:2], 1, 1))
        size = np.abs(drive).max(axis=2) + np.finfo(float).tiny
        before, least = delta[..., : 1 + m].copy(), np.full(size.shape, np.inf)
        step = np.zeros_like(before)
        old = np.full(size.shape, start is None)  # with outdated slopes
        fresh = np.zeros(size.shape, bool)  # with slopes evaluated at the start of the last step
        slow = _SLOW if m < _MANY else _SLOW_OF_MANY
        for turn in range(_NEWTON):
            beyond, slope, samples = beyond_linear(laws, delta, points)
            found = drive - compliance * beyond
            delta[..., 1 + m :] = found[..., 1 + m :]
            left = (found - delta)[..., : 1 + m]
            size_left = np.linalg.norm(left, axis=2)
            is_open = size_left > _CONVERGED * size
            if turn == _NEWTON - 1 or not np.any(is_open):
                break
            better = size_left < least
            due = better & is_open & (old | (size_left > slow * least))
            if np.any(due):
                inward = _inward(
                    compliance[due, : 1 + m], spread(laws, slope, _thinned(samples, H), m, m, due)
                )
                precision = np.float64 if m < _MANY else np.float32
                inverse[due] = np.linalg.inv(inward.astype(precision))
            old = ~better & ~fresh  # return to the start of that step
            fresh = np.where(better, due, fresh)
            least = np.where(old, np.inf, np.minimum(size_left, least))
            before = np.where(better[..., None], delta[..., : 1 + m], before)
            newton = _complex(inverse @ _parts(left[..., None]))[..., 0]
            # Where it is not better, half the step before.
            shorter = np.where(old[..., None], 0, 0.5 * step)
            step = np.where(better[..., None], newton, shorter)
            delta[..., : 1 + m] = before + step
        return cls(laws, compliance, beyond[..., : 1 + H], delta, inverse)

    @property
    def points(self) -> int:
        """Samples over a period."""
        return _points(self.beyond.shape[2] - 1, self.delta.shape[2])

    def _spread(self, m: int) -> Floats:
        """Parts of g by those of δ at the mean and the first m harmonics, (r, n, 1 + 2m, 1 + 2H).

        With more than H of δ, those of g are as many.
        """
        _, slope, samples = beyond_linear(self.laws, self.delta, self.points)
        of, H = np.ones(slope.shape[:2], bool), self.beyond.shape[2] - 1
        whole = spread(self.laws, slope, _thinned(samples, H), m, max(m, H), of)
        return whole.reshape(*of.shape, *whole.shape[1:])

    def change(self, drive: Complexes, beyond: Complexes) -> Complexes:
        """Change of g with changes of F, and of g at given δ, each shape (r, n, 1 + H, c)."""
        H, m = self.beyond.shape[2] - 1, (self.inverse.shape[3] - 1) // 2
        k = max(m, *np.flatnonzero(drive.any(axis=(0, 1, 3))), 0)
        compliance, by = self.compliance[..., : 1 + k], self._spread(k)
        left = np.zeros((*compliance.shape, drive.shape[3]), complex)
        used = slice(1 + min(k, H))
        left[:, :, used] = drive[:, :, used] - compliance[:, :, used, None] * beyond[:, :, used]
        inward = _inward(compliance, by[..., inner(k, max(k, H))])
        if k < _MANY:
            inverse, first = np.linalg.inv(inward), inner(m, k)
            self.inverse[:] = inverse[..., first, :][..., first]  # the next solution starts with it
            wound: Floats = inverse @ _parts(left)
        else:
            wound = np.asarray(np.linalg.solve(inward, _parts(left)))
        return np.asarray(beyond + _complex(by.swapaxes(2, 3) @ wound)[:, :, : 1 + H])

    def noise(self, variance: Floats) -> tuple[Complexes, Floats]:
        """Change of g with noise of F at the same harmonic, and its variance by others, (r, n, H).

        A gear that is far from linear, near a biased motion or a jump, responds to noise of one harmonic
        in others, and by more than the linear gear does.

        Parameters
        ----------
        variance : ndarray, shape (r, n, H)
            Of the complex phasors of F.
        """
        H = variance.shape[2]
        spread = self._spread(H)
        by = spread.swapaxes(2, 3) @ np.linalg.inv(_inward(self.compliance[..., : 1 + H], spread))
        parts = by[..., 1:, 1:].reshape(*variance.shape[:2], 2, H, 2, H)
        j = np.arange(H)
        (rr, ri), (ir, ii) = parts[:, :, :, j, :, j].transpose(3, 4, 1, 2, 0)
        own = 0.5 * (rr + ii) + 0.5j * (ir - ri)
        whole = ((parts**2).sum(axis=(2, 4)) @ (0.5 * variance)[..., None])[..., 0]
        return own, np.maximum(whole - np.abs(own) ** 2 * variance, 0)


def _points(H: int, count: int) -> int:
    return max(_POINTS * max(H, _LEAST_HARMONICS), _FURTHER_POINTS * (count - 1))


def _thinned(samples: Floats, H: int) -> Floats:
    """Samples that suffice for slopes."""
    return samples[..., :: samples.shape[-1] // _points(H, 0)]


def _inward(compliance: Complexes, spread: Floats) -> Floats:
    """I + β G, parts of F by those of δ: of β (..., 1 + m) and a spread (..., 1 + 2m, 1 + 2m)."""
    m = compliance.shape[-1] - 1
    by, beta = spread.swapaxes(-2, -1), compliance[..., 1:, None]
    mean, real, imaginary = np.split(by, (1, 1 + m), axis=-2)
    parts = [
        compliance.real[..., :1, None] * mean,
        beta.real * real - beta.imag * imaginary,
        beta.real * imaginary + beta.imag * real,
    ]
    return np.asarray(np.concatenate(parts, axis=-2) + np.eye(1 + 2 * m))


def beyond_linear(laws: GearLaws, delta: Complexes, points: int) -> tuple[Complexes, Floats, Floats]:
    """Torque beyond K δ, mean and phasors (..., 1 + H) as δ, its slope without the loop, and samples.

    Backlash, changes of slope and hysteresis are averaged over each step between samples, in which the
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
        # Its slope depends on all moves before: ``_loop_spread``.
        average = average + laws.level * average_dahl(chords, laws.sharpness)
    found[..., 0] += average.mean(axis=-1)
    found[..., 1:] += phasors_of(average, H) * np.exp(1j * np.pi * turn) / np.sinc(turn)
    steep = (torque - np.roll(torque, 1, axis=-1)) / move
    return found, slope + 0.5 * (steep + np.roll(steep, -1, axis=-1)), chords


def law_stiffness(gear: Gear, deflection_rad: Floats) -> Floats:
    """Real part of torque over deflection at the fundamental, with hysteresis, shape (r,), N·m/rad.

    Of a gear at a period of r deflections, shape (r, points).
    """
    points = deflection_rad.shape[1]
    delta = np.zeros((len(deflection_rad), points // _POINTS), complex)
    delta[:, 1:] = phasors_of(deflection_rad, points // _POINTS - 1)
    beyond, *_ = beyond_linear(GearLaws.of([gear]), delta, points)
    with np.errstate(invalid="ignore"):  # of a joint that does not move
        return np.asarray(gear.K + (beyond[:, 1] / delta[:, 1]).real)


def _parts(z: Complexes) -> Floats:
    """Mean, real and imaginary parts (..., 1 + 2m, c) of a mean and phasors (..., 1 + m, c)."""
    return np.concatenate([z.real, z[..., 1:, :].imag], axis=-2)


def _complex(parts: Floats) -> Complexes:
    """Mean and phasors of their parts."""
    m = parts.shape[-2] // 2
    found = parts[..., : 1 + m, :].astype(complex)
    found[..., 1:, :] += 1j * parts[..., 1 + m :, :]
    return found
