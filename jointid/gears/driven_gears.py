"""Deflection of gears behind motors of known motion, over time: the arm's equation of motion.

    M2 (θ̈ − δ̈) + G (θ − δ) = f + M2 c (f − u)˙,   f = f(δ) + D δ̇

The torque u through the gears by the balance at the motors holds the deflection near the measured one
(an observer): otherwise small errors grow, as arms with backlash are hardly stable.

A second difference of an angle is the integral of its acceleration over a hat of two steps, which
Numerov's weights find from three samples. The same integral of D δ̇ differs from a central difference of
D δ by D h⁴/12 times the third derivative of δ, which follows from the equation. The equations of all
steps form one banded system, solved by Newton steps; the change of the deflection with every parameter
follows from the same system.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dgbtrf, dgbtrs

from jointid.arrays import Complexes, Floats
from jointid.gears.dahl import DahlSteps, dahl
from jointid.gears.laws import GearLaws
from jointid.gears.motor_motion import MotorMotion, each

_HAT = (1 / 12, 10 / 12, 1 / 12)
"""Weights of three samples in the integral over a hat (Numerov)."""
_SECOND, _CENTRAL = (1.0, -2.0, 1.0), (0.5, 0.0, -0.5)
"""Second difference, and half the difference over two steps."""
_NEWTON, _CONVERGED = 25, 1e-3
"""Most Newton steps, and the residual of each joint, over its largest torque, that ends them."""
_OBSERVED, _OF_BACKLASH = 0.02, 5.0
"""Rate of the observer over the resonance with the motor locked, and what the square of half the
backlash over the largest linear deflection adds: an arm that often leaves its flanks is unstable."""
_FIRST, _STARTS = 6, 3
"""Steps at the start of a motion whose smoothed velocity is inaccurate, and Gauss-Newton steps for its
state."""
_WHOLE, _WINDOW, _SHORTEST, _MOST = 10, 2000, 8, 1200
"""Newton steps over the whole motion; after them, it is solved in windows of that many steps, or of
fewer where they do not converge; the most for each window: far hardening took over 600."""


@dataclass(frozen=True, eq=False)
class DrivenGears:
    """Deflection of gears behind moving motors that carry an arm."""

    motors: MotorMotion
    laws: GearLaws
    """Arrays of shape (n, 1)."""
    delta: Floats
    """Deflection, shape (n, N), rad."""
    loop: Floats
    """State of the hysteresis, shape (n, N)."""
    D: Floats
    """Shape (n,)."""
    M2: Floats
    """Of every pose, shape (p, n, n)."""
    G: Floats
    """Stiffness of gravity of every pose, shape (p, n, n)."""
    measured: Floats
    """Torque through the gears by the motors' balance, shape (n, N), N·m."""
    observed: Floats
    """Rate of the observer over that resonance, shape (n,)."""

    @classmethod
    def solve(
        cls,
        motors: MotorMotion,
        laws: GearLaws,
        D: Floats,
        M2: Floats,
        G: Floats,
        measured: Floats,
        strength: float,
        start: DrivenGears | None = None,
    ) -> DrivenGears:
        """Solve from ``start``, the solution at similar parameters, or from the linear deflection.

        ``strength`` multiplies the rate of the observer.
        """
        largest = np.abs(measured).max(axis=1) + np.finfo(float).tiny
        share = (laws.K * laws.half_backlash)[:, 0] / largest
        own = M2, G, measured, strength * (_OBSERVED + _OF_BACKLASH * np.minimum(share**2, 1))
        if start is None:
            none = np.zeros(motors.rise.shape)
            linear = cls(motors, laws.linear, none, none, D, *own)._stepped()
            delta = laws.deflection(laws.K * linear.delta)
        else:
            delta = start.delta
        found = begun = cls(motors, laws, delta, _loop(laws, delta, motors.starts), D, *own)._begun()
        largest = np.abs(laws.K * delta).max(axis=1, keepdims=True)
        for _ in range(_WHOLE):
            if found._solves(largest).all():
                return found
            found = found._stepped()
        return (found if np.isfinite(found.delta).all() else begun)._followed(begun, largest)

    def _begun(self) -> DrivenGears:
        """With the state at the start of each part by the torque measured in a first period."""
        n, delta = len(self.delta), self.delta.copy()
        squared = np.linalg.eigvals(np.linalg.solve(self.M2, np.diag(self.laws.K[:, 0])))
        period = 2 * np.pi / np.sqrt(np.maximum(squared.real.min(), np.finfo(float).tiny))
        largest = np.abs(self.measured).max(axis=1, keepdims=True)
        begins = np.flatnonzero(self.motors.starts)[::2].tolist()
        for at, end in zip(begins, [*begins[1:], delta.shape[1]], strict=True):
            step = self.motors.step_s[at]
            used = slice(at, at + int(min(max(period / step, 4 * _FIRST), end - at)))
            part = self._part(used, delta, self.loop)
            unit, joints = np.zeros((2, n, *part._shape)), range(n)
            unit[0, joints, joints, :2] = unit[1, joints, joints, 1:2] = 1
            part = part._followed(part, largest)
            for _ in range(_STARTS):
                moved = part._solved(unit.reshape(-1, unit.shape[-1])).reshape(2 * n, *part._shape)
                torque = part._slope * moved[:, :n]
                if self.laws.hysteretic:
                    torque += self.laws.level * moved[:, n:]
                both = np.concatenate([part.laws.K * part.delta + part.beyond - part.measured, *torque])
                turn = np.concatenate([part.delta, *moved[:, :n]])
                both, turn = (rows.reshape(1 + 2 * n, n, -1) for rows in (both, turn))
                damping = self.D[:, None] * (turn[..., 2:] - turn[..., :-2]) / (2 * step)
                rows = ((both[..., 1:-1] + damping) / largest)[..., _FIRST:].reshape(1 + 2 * n, -1)
                if not np.isfinite(rows).all():
                    return replace(self, delta=np.full(delta.shape, np.nan))
                size = np.linalg.norm(rows[1:], axis=1)
                change = np.linalg.lstsq((rows[1:] / size[:, None]).T, -rows[0])[0] / size
                moves = np.tensordot(change, moved, 1)
                loop = part.loop + moves[n:] if self.laws.hysteretic else part.loop
                begun = replace(part, delta=part.delta + moves[:n], loop=loop)
                begun = begun._followed(begun, largest)
                if not np.isfinite(begun.delta).all():
                    break
                part = begun
            delta[:, at : at + 2] = part.delta[:, :2]
        return replace(self, delta=delta)

    def _part(self, used: slice, delta: Floats, loop: Floats) -> DrivenGears:
        """Some steps, with the state of the first two."""
        own = delta[:, used], loop[:, used], self.measured[:, used]
        return replace(self, motors=self.motors.part(used), delta=own[0], loop=own[1], measured=own[2])

    def _stepped(self) -> DrivenGears:
        """After a Newton step."""
        n, step = len(self.delta), self._solved(-self._left)
        loop = self.loop + step[n:] if self.laws.hysteretic else self.loop
        return replace(self, delta=self.delta + step[:n], loop=loop)

    def _solves(self, largest: Floats) -> np.ndarray:
        """Whether each step solves the equations, (N,); ``largest`` torques of the joints are (n, 1)."""
        torques, loops = np.split(np.abs(self._left), [len(largest)])
        is_solved = np.all(torques <= _CONVERGED * largest * self.motors.step_s**2, axis=0)
        return np.asarray(is_solved & np.all(loops <= _CONVERGED, axis=0))

    def _followed(self, guess: DrivenGears, largest: Floats) -> DrivenGears:
        """Solution window by window: Newton steps diverge where the kinks lie elsewhere."""
        wrong = ~self._solves(largest)
        delta, loop, N = self.delta.copy(), self.loop.copy(), wrong.size
        at, count, left = int(wrong.argmax()), _WINDOW, _MOST * -(-N // _WINDOW)
        delta[:, at:], loop[:, at:] = guess.delta[:, at:], guess.loop[:, at:]
        while at < N:
            used = slice(max(at - 2, 0), min(at + count, N))
            part = self._part(used, delta, loop)
            for _ in range(_NEWTON):
                if part._solves(largest).all():
                    break
                part, left = part._stepped(), left - 1
            if not part._solves(largest).all():
                if count <= _SHORTEST or left <= 0:  # it has no solution, nor have the steps that follow
                    return replace(self, delta=np.full(delta.shape, np.nan))
                count = max(count // 8, _SHORTEST)
                continue
            delta[:, used], loop[:, used] = part.delta, part.loop
            at, count = used.stop, min(4 * count, _WINDOW)
        return replace(self, delta=delta, loop=loop)

    @property
    def beyond(self) -> Floats:
        """Torque beyond K δ, shape (n, N), N·m."""
        return self.laws.beyond_linear(self.delta, self.loop)

    def at_deflection(self, laws: GearLaws) -> Floats:
        """Torque beyond K δ of other laws at the same deflection, shape (n, N), N·m."""
        return laws.beyond_linear(self.delta, _loop(laws, self.delta, self.motors.starts))

    def slopes(
        self,
        name: str,
        beyond: Floats | float,
        shape: tuple[int, int],
        arm: Floats | None = None,
        measured: Floats | float = 0.0,
    ) -> Complexes:
        """Bins of the change of the torque beyond K δ by a parameter, (r, H, n, n) or (r, H, n, c).

        Parameters
        ----------
        name, shape : str, tuple of int
            Parameter, which each joint has, or "M2"; r and H.
        beyond : ndarray, shape (n, N), or 0
            Change of this torque at a given deflection by the parameter of the joint.
        arm : ndarray, shape (c, p, n, n), optional
            Derivatives of M2 of every pose by its c parameters.
        measured : ndarray, shape (n, N), or 0
            Change of the torque by the motors' balance, which the observer follows.
        """
        (n, N), step = self.delta.shape, self.motors.step_s[2:]
        unit = np.eye(n)[..., None]
        own = beyond * unit
        left = np.zeros((n if arm is None else len(arm), *self._shape))
        if arm is not None:
            bend = np.diff(self.delta, 2, axis=1) - self.motors.rise[:, 2:]
            left[:, :n, 2:] = each(arm.swapaxes(0, 1), bend, self.motors.pose[2:])
        else:
            elastic, damping = own + (name == "K") * self.delta * unit, (name == "D") * np.eye(n)
            left[:, :n] = self._hat_torque(elastic)
            left[:, :n, 2:] += self._held(self._changes(elastic, damping))
            followed = self._changes(measured * unit + 0 * elastic, 0 * damping)
            left[:, :n, 2:] -= each(self._observer, followed, self.motors.pose[2:])
            apart = 0.5 * step * (self.delta[:, 2:] - self.delta[:, :-2])
            left[:, :n, 2:] += damping[..., None] * apart
        left[..., self.motors.starts] = 0
        moved = self._solved(-left.reshape(-1, N)).reshape(left.shape)
        found = (self._slope - self.laws.K) * moved[:, :n]
        if self.laws.hysteretic:
            found += self.laws.level * moved[:, n:]
        found += own if arm is None else 0
        return self.motors.bins(found.swapaxes(0, 1), shape)

    @cached_property
    def _observer(self) -> Floats:
        """M2 c of every pose, shape (p, n, n)."""
        own = np.diagonal(np.linalg.inv(self.M2), axis1=1, axis2=2)
        return self.M2 * (self.observed * np.sqrt(own / self.laws.K[:, 0]))[:, None]

    @cached_property
    def _damping(self) -> Floats:
        """D M2⁻¹/12 of every pose, shape (p, n, n)."""
        return self.D[:, None] / 12 * np.linalg.inv(self.M2)

    def _changes(self, torque: Floats, D: Floats) -> Floats:
        """Rate of a torque (..., n, N) beside D δ̇, times the squared step, at steps 2 … N."""
        apart = 0.5 * self.motors.step_s[2:] * (torque[..., 2:] - torque[..., :-2])
        return np.asarray(apart + D[..., None] * np.diff(self.delta, 2, axis=1))

    def _held(self, changes: Floats) -> Floats:
        """Terms of the observer and of D δ̇ by changes of the torque."""
        step, pose = self.motors.step_s[2:], self.motors.pose[2:]
        return each(self._observer, changes, pose) + step**2 * each(self._damping, changes, pose)

    @property
    def _shape(self) -> tuple[int, int]:
        n, N = self.delta.shape
        return n * (2 if self.laws.hysteretic else 1), N

    def _hat_torque(self, torque: Floats) -> Floats:
        """Integral of a torque (..., N) over hats, times the step."""
        found = np.zeros(torque.shape)
        for weight, late in zip(_HAT, (0, 1, 2), strict=True):
            found[..., 2:] += weight * torque[..., 2 - late : torque.shape[-1] - late]
        return np.where(self.motors.starts, 0, found * self.motors.step_s**2)

    @cached_property
    def _left(self) -> Floats:
        """What is left of the equations, rows of ``_shape``."""
        m, delta, step = self.motors, self.delta, self.motors.step_s[2:]
        n = len(delta)
        left = np.zeros(self._shape)
        torque = self.laws.K * delta + self.beyond
        held = self._held(self._changes(torque, self.D)) - step * self.D[:, None] / 12 * m.jerk[:, 2:]
        held -= each(self._observer, self._changes(self.measured, 0 * self.D), m.pose[2:])
        if self.G.any():
            torque = torque - each(self.G, m.angle - delta, m.pose)
        left[:n] = self._hat_torque(torque)
        bend = np.diff(delta, 2, axis=1) - m.rise[:, 2:]
        left[:n, 2:] += held + each(self.M2, bend, m.pose[2:])
        left[:n, 2:] += 0.5 * step * self.D[:, None] * (delta[:, 2:] - delta[:, :-2])
        left[:n, m.starts] = 0
        if self.laws.hysteretic:
            left[n:, 1:] = self.loop[:, 1:] - self._loops.z
            left[n:, m.starts] = 0
        return left

    @cached_property
    def _loops(self) -> DahlSteps:
        return DahlSteps.of(self.delta, self.loop, self.laws.sharpness, self.motors.starts)

    @cached_property
    def _slope(self) -> Floats:
        """Of the elastic torque, shape (n, N)."""
        return self.laws.slope(self.delta)

    @cached_property
    def _factors(self) -> tuple[Floats, np.ndarray, int, int]:
        """LU factors of the derivative of ``_left``, in bands; unknowns of a step follow each other."""
        m, laws = self.motors, self.laws
        n, (size, N) = len(self.delta), self._shape
        upper, lower = size - 1, 3 * size - 1
        band = np.zeros((N, size, 2 * lower + upper + 1))
        diagonal = lower + upper

        def place(row: int, column: int, late: int, values: Floats | float) -> None:
            """Derivative of equations 2 … N by unknowns some steps earlier."""
            band[2 - late : N - late, column, diagonal + row - column + late * size] += values

        inner, squared = ~m.starts[2:], m.step_s[2:] ** 2
        pose = m.pose[2:]
        for late in range(3):
            for i in range(n):
                for j in range(n):
                    rigid = _SECOND[late] * self.M2[pose, i, j]
                    rigid += _HAT[late] * squared * self.G[pose, i, j]
                    by_change = self._observer[pose, i, j] + squared * self._damping[pose, i, j]
                    held = _CENTRAL[late] * m.step_s[2:] * by_change
                    rigid += held * self._slope[j, 2 - late : N - late]
                    rigid += _SECOND[late] * by_change * self.D[j]
                    if laws.hysteretic:
                        place(i, n + j, late, inner * held * laws.level[j, 0])
                    if i == j:
                        rigid += _HAT[late] * squared * self._slope[i, 2 - late : N - late]
                        rigid += _CENTRAL[late] * m.step_s[2:] * self.D[i]
                    place(i, j, late, inner * rigid)
                if laws.hysteretic:
                    place(i, n + i, late, inner * _HAT[late] * squared * laws.level[i, 0])
        band[np.flatnonzero(m.starts), :n, diagonal] = 1
        if laws.hysteretic:
            loops = self._loops
            for j in range(n):
                band[:, n + j, diagonal] = 1
                band[1:, j, diagonal + n] = -loops.by_move[j]
                band[:-1, j, diagonal + n + size] = (loops.by_move - loops.by_earlier)[j]
                band[:-2, j, diagonal + n + 2 * size] = loops.by_earlier[j, 1:]
                band[:-1, n + j, diagonal + size] = -loops.by_z[j]
        factors, pivots, bad = dgbtrf(band.reshape(N * size, -1).T, lower, upper, overwrite_ab=True)
        if bad:
            factors[:] = np.nan  # a singular system has no solution
        return factors, pivots, lower, upper

    def _solved(self, rows: Floats) -> Floats:
        """Unknowns (c m, N) whose change of the equations is ``rows``, of the same shape."""
        size, N = self._shape
        factors, pivots, lower, upper = self._factors
        right = rows.reshape(-1, size, N).transpose(2, 1, 0).reshape(N * size, -1)
        found, _ = dgbtrs(factors, lower, upper, np.asfortranarray(right), pivots)
        return np.asarray(found.reshape(N, size, -1).transpose(2, 1, 0).reshape(rows.shape))


def _loop(laws: GearLaws, delta: Floats, starts: np.ndarray) -> Floats:
    """State of the hysteresis over deflections (n, N)."""
    return dahl(delta, laws.sharpness, starts) if laws.hysteretic else np.zeros(delta.shape)
