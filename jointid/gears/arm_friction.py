"""Coulomb friction at the arms and its change with their motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.phasors.periods import pairs, phasors_of, samples_of

_NEWTON, _CONVERGED = 12, 1e-4
"""Most Newton steps for the motion of arms with friction, and the change of the friction over its level
that ends them: friction of 3 % of the torque takes three, and more where arms nearly stick."""


@dataclass(frozen=True, eq=False)
class ArmFriction:
    """Coulomb friction P = F sign θ̇ of the arms in r records.

    In periodic motion it changes the motion that it follows. In segments of motion records the signs are
    known from the measured motion.
    """

    level: Floats
    """F, shape (n,), N·m."""
    sign: Complexes
    """Phasors of sign θ̇, shape (r, H, n)."""
    periodic: np.ndarray
    """Rows that are no segments."""
    of_periodic: PeriodicFriction | None
    """Friction in these rows."""

    @classmethod
    def solve(
        cls,
        level: Floats,
        mobility: Complexes,
        torque: Complexes,
        points: int,
        known: Mapping[int, Complexes],
    ) -> ArmFriction:
        """Friction under torques f, shape (r, H, n), at arms of mobility Y, shape (r, H, n, n).

        ``known`` holds the phasors of the signs in segments, (bins, n), by their row.
        """
        sign, rows = np.zeros_like(torque), np.setdiff1d(np.arange(len(torque)), list(known))
        for row, bins in known.items():
            sign[row, : len(bins)] = bins
        own = None
        if rows.size:
            own = PeriodicFriction.solve(level, mobility[rows], torque[rows], points)
            sign[rows] = own.sign
        return cls(level, sign, rows, own)

    def by_motion(self, change: Complexes) -> Complexes:
        """Change of P for changes of Y f, both shape (r, H, n, c)."""
        found = np.zeros_like(change)
        if self.of_periodic is not None:
            found[self.periodic] = self.of_periodic.by_motion(change[self.periodic])
        return found

    def settled(self, force: Complexes) -> Complexes:
        """Changes of P that remain of ones at a given motion, which they change; (r, H, n, c)."""
        found = force.copy()
        if self.of_periodic is not None:
            found[self.periodic] = self.of_periodic.settled(force[self.periodic])
        return found


@dataclass(frozen=True, eq=False)
class PeriodicFriction:
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
    def solve(
        cls, level: Floats, mobility: Complexes, torque: Complexes, points: int
    ) -> PeriodicFriction:
        """Newton steps from the motion without friction under torques f, shape (r, H, n).

        They are halved where they lead away, as with an arm that sticks.
        """
        before, force, step = (np.zeros_like(torque) for _ in range(3))
        least, rows = np.full(len(torque), np.inf), np.arange(len(torque))
        for _ in range(_NEWTON):
            found = cls.at(level, mobility[rows], (torque - force)[rows], points)
            left = level * found.sign - force[rows]
            size = np.linalg.norm(left, axis=(1, 2))
            better = (size < least[rows])[:, None, None]
            before[rows] = np.where(better, force[rows], before[rows])
            newton = found.settled(left[..., None])[..., 0]
            step[rows] = np.where(better, newton, 0.5 * step[rows])
            force[rows] = before[rows] + step[rows]
            least[rows] = np.fmin(size, least[rows])
            rows = rows[size > _CONVERGED * np.linalg.norm(level)]
            if not rows.size:
                break
        return cls.at(level, mobility, torque - force, points)

    @classmethod
    def at(cls, level: Floats, mobility: Complexes, torque: Complexes, points: int) -> PeriodicFriction:
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
