"""Deflection of gears behind motors of known motion, over time: the arm's equation of motion.

    M2 (θ̈ − δ̈) + G (θ − δ) = f + M2 c (f − u)˙,   f = f(δ) + D δ̇

The torque u through the gears by the balance at the motors holds the deflection near the measured one
(an observer): otherwise small errors grow, as arms with backlash are hardly stable.

A second difference of an angle is the integral of its acceleration over a hat of two steps, which
Numerov's weights find from three samples. The same integral of D δ̇ differs from a central difference of
D δ by D h⁴/12 times the third derivative of δ, which follows from the equation. The equations of all
steps are solved by Newton steps, which are recursions in time: each equation holds the unknowns of its
step and of the two before. So is the change of the deflection with every parameter.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.gears.dahl import DahlSteps, dahl
from jointid.gears.laws import GearLaws
from jointid.gears.motor_motion import MotorMotion, each
from jointid.gears.recursion import Recursion

_HAT = (1 / 12, 10 / 12, 1 / 12)
"""Weights of three samples in the integral over a hat (Numerov)."""
_SECOND, _CENTRAL = (1.0, -2.0, 1.0), (0.5, 0.0, -0.5)
"""Second difference, and half the difference over two steps."""
_NEWTON, _CONVERGED = 25, 1e-3
"""Most Newton steps, and the residual of each joint, over its largest torque, that ends them."""
_OBSERVED, _OF_BACKLASH = 0.2, 5.0
"""Rate of the observer over the resonance with the motor locked, and what the square of half the
backlash over the largest linear deflection adds: an arm that often leaves its flanks is unstable. At a
third of the rate, an arm behind a gear that hardens stays on the wrong branch of its resonance."""
_FIRST, _STARTS, _BEGUN = 6, 3, 0.01
"""Steps at the start of a motion whose smoothed velocity is inaccurate; most Gauss-Newton steps for its
state, and their change of the deflection, over the largest, that ends them."""
_SAME_MOTION = 0.1
"""Difference of angles over the largest that indicates another motion."""
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
    """Gravity stiffness of every pose, shape (p, n, n)."""
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
        delta = laws.deflection(laws.K * linear.delta) if start is None else start.delta
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
        largest, joints = np.abs(self.measured).max(axis=1, keepdims=True), range(n)
        begins, spans = np.flatnonzero(self.motors.starts)[::2], []
        for at, end in zip(begins, [*begins[1:], delta.shape[1]], strict=True):
            count = max(period / self.motors.step_s[at], 4 * _FIRST)
            spans.append(np.arange(at, int(min(at + count, end))))
        edges = np.cumsum([0, *map(len, spans)])
        part = self._part(np.concatenate(spans), delta, self.loop)
        unit, places = np.zeros((2, n, *part._shape)), edges[:-1]
        for j in joints:
            unit[0, j, j, places] = unit[0, j, j, places + 1] = unit[1, j, j, places + 1] = 1
        part = part._followed(part, largest)
        for _ in range(_STARTS):
            moved = part._recursion.solve(unit.reshape(-1, *part._shape))
            torque = part._slope * moved[:, :n]
            if self.laws.hysteretic:
                torque += self.laws.level * moved[:, n:]
            left = part.laws.K * part.delta + part.beyond - part.measured
            rows = np.concatenate([left[None], torque])
            turn = np.concatenate([part.delta[None], moved[:, :n]])
            rate = (turn[..., 2:] - turn[..., :-2]) / (2 * part.motors.step_s[1:-1])
            rows[..., 1:-1] += self.D[:, None] * rate
            rows /= largest
            if not np.isfinite(rows).all():
                return replace(self, delta=np.full(delta.shape, np.nan))
            for at, end in itertools.pairwise(edges.tolist()):
                own = rows[..., at + 1 + _FIRST : end - 1].reshape(1 + 2 * n, -1)
                size = np.linalg.norm(own[1:], axis=1)
                size[size == 0] = 1.0  # an arm at rest between the flanks transmits no torque
                change = np.linalg.lstsq((own[1:] / size[:, None]).T, -own[0])[0] / size
                moved[0, :, at:end] = np.tensordot(change, moved[..., at:end], 1)
            moves = moved[0]
            loop = part.loop + moves[n:] if self.laws.hysteretic else part.loop
            begun = replace(part, delta=part.delta + moves[:n], loop=loop)
            begun = begun._followed(begun, largest)
            if not np.isfinite(begun.delta).all():
                break
            part = begun
            if np.all(np.abs(moves[:n]).max(axis=1) < _BEGUN * np.abs(part.delta).max(axis=1)):
                break
        for late in (0, 1):
            delta[:, begins + late] = part.delta[:, places + late]
        return replace(self, delta=delta)

    def on(self, motors: MotorMotion) -> DrivenGears | None:
        """With the deflection in other steps of the same motion; None in those of another motion."""
        angle, delta = (
            np.array([np.interp(motors.time_s, self.motors.time_s, own) for own in rows])
            for rows in (self.motors.angle, self.delta)
        )
        is_same = np.abs(angle - motors.angle).max() < _SAME_MOTION * np.abs(motors.angle).max()
        return replace(self, delta=delta) if is_same else None

    def _part(self, used: slice | np.ndarray, delta: Floats, loop: Floats) -> DrivenGears:
        """Some steps, with the state of the first two."""
        own = delta[:, used], loop[:, used], self.measured[:, used]
        return replace(self, motors=self.motors.part(used), delta=own[0], loop=own[1], measured=own[2])

    def _stepped(self) -> DrivenGears:
        """After a Newton step."""
        n, step = len(self.delta), self._recursion.solve(-self._left)
        loop = self.loop + step[n:] if self.laws.hysteretic else self.loop
        return replace(self, delta=self.delta + step[:n], loop=loop)

    def _solves(self, largest: Floats) -> np.ndarray:
        """Whether each step solves the equations, (N,); ``largest`` torques of the joints are (n, 1)."""
        torques, loops = np.split(np.abs(self._left), [len(largest)])
        is_solved = np.all(torques <= _CONVERGED * largest * self.motors.step_s**2, axis=0)
        return np.asarray(is_solved & np.all(loops <= _CONVERGED, axis=0))

    def _followed(self, guess: DrivenGears, largest: Floats) -> DrivenGears:
        """Solution window by window: Newton steps diverge where the kinks lie elsewhere."""
        wrong, delta, loop = ~self._solves(largest), self.delta.copy(), self.loop.copy()
        for begin, end in itertools.pairwise([*np.flatnonzero(self.motors.starts)[::2], wrong.size]):
            if not wrong[begin:end].any():
                continue
            at, count = begin + int(wrong[begin:end].argmax()), _WINDOW
            left = _MOST * -(-(end - begin) // _WINDOW)
            delta[:, at:end], loop[:, at:end] = guess.delta[:, at:end], guess.loop[:, at:end]
            while at < end:
                used = slice(at - 2, min(at + count, end))
                part = self._part(used, delta, loop)
                for _ in range(_NEWTON):
                    if part._solves(largest).all():
                        break
                    part, left = part._stepped(), left - 1
                if not part._solves(largest).all():
                    if count <= _SHORTEST or left <= 0:  # it has no solution, nor have further steps
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
        changes: Mapping[str, tuple[Floats | float, Floats | float]],
        shape: tuple[int, int],
        arm: Floats | None = None,
    ) -> dict[str, Complexes]:
        """Bins of the change of the torque beyond K δ by parameters, each (r, H, n, n) or (r, H, n, c).

        ``changes``, for parameters that each joint has, are that of this torque at a given deflection by
        the joint's parameter, and that of the torque by the motors' balance, which the observer follows,
        each of shape (n, N), or 0. ``shape`` is (r, H); ``arm``, (c, p, n, n), are derivatives of M2 of
        every pose by its c parameters.
        """
        n, joints = len(self.delta), range(len(self.delta))
        shown = [np.broadcast_to(beyond, self.delta.shape) for beyond, _ in changes.values()]
        bins = self.motors.bins(np.reshape(shown, (-1, *self.delta.shape)), shape)
        found = {name: bins[:, :, at, :, None] * np.eye(n) for at, name in enumerate(changes)}
        further, count = self._slope - self.laws.K, len(changes) * n
        if not (further.any() or self.laws.hysteretic):  # linear: 0 at every deflection
            return found
        left = np.zeros((count + (0 if arm is None else len(arm)), *self._shape))
        observer = self._of_steps(self._observer).swapaxes(0, 1)
        damping = self._of_steps(self._damping).swapaxes(0, 1) * self.motors.step_s**2
        for at, (name, (beyond, measured)) in zip(range(0, count, n), changes.items(), strict=True):
            part, D = left[at : at + n, :n], (name == "D") * np.ones(n)
            elastic = beyond + (name == "K") * self.delta
            part[joints, joints] = self._hat_torque(elastic) + D[:, None] * self._rise
            part += damping * self._changes(elastic, D)[:, None]
            part += observer * self._changes(elastic - measured, D)[:, None]
        if arm is not None:
            left[count:, :n] = each(arm.swapaxes(0, 1), self._bend - self.motors.rise, self.motors.pose)
        left[..., self.motors.starts] = 0
        moved = self._recursion.solve(-left)
        own = further * moved[:, :n]
        if self.laws.hysteretic:
            own += self.laws.level * moved[:, n:]
        bins = self.motors.bins(own.swapaxes(0, 1), shape)
        for at, name in enumerate(changes):
            found[name] += bins[..., at * n : (at + 1) * n]
        return found if arm is None else {**found, "M2": bins[..., count:]}

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
        """Rate of a torque (n, N) added to D δ̇, times the squared step."""
        found = np.zeros(torque.shape)
        found[:, 2:] = 0.5 * self.motors.step_s[2:] * (torque[:, 2:] - torque[:, :-2])
        return np.asarray(found + D[:, None] * self._bend)

    @cached_property
    def _bend(self) -> Floats:
        """Second differences of the deflection, shape (n, N)."""
        found = np.zeros(self.delta.shape)
        found[:, 2:] = np.diff(self.delta, 2, axis=1)
        return found

    @cached_property
    def _rise(self) -> Floats:
        """Rate of the deflection, times the squared step, shape (n, N)."""
        return self._changes(self.delta, 0 * self.D)

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
        m, delta, D, n = self.motors, self.delta, self.D[:, None], len(self.delta)
        left = np.zeros(self._shape)
        torque = self.laws.K * delta + self.beyond
        left[:n] = each(self._observer, self._changes(torque - self.measured, self.D), m.pose)
        left[:n] += m.step_s**2 * each(self._damping, self._changes(torque, self.D), m.pose)
        left[:n] += each(self.M2, self._bend - m.rise, m.pose)
        left[:n] += D * (self._rise - m.step_s / 12 * m.jerk)
        if self.G.any():
            torque = torque - each(self.G, m.angle - delta, m.pose)
        left[:n] += self._hat_torque(torque)
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

    def _of_steps(self, matrices: Floats) -> Floats:
        """Matrices of every pose (p, n, n) in every step, (n, n, N), or (n, n, 1) of all."""
        if len(matrices) == 1:
            return matrices[0, ..., None]
        return np.ascontiguousarray(np.moveaxis(matrices[self.motors.pose], 0, 2))

    @cached_property
    def _recursion(self) -> Recursion:
        """Derivative of ``_left`` by the unknowns."""
        m, laws, n, D = self.motors, self.laws, len(self.delta), self.D[:, None]
        step, squared, own = m.step_s, m.step_s**2, np.eye(n)[..., None]
        M2, G = self._of_steps(self.M2), self._of_steps(self.G)
        by_change = self._of_steps(self._observer) + squared * self._of_steps(self._damping)
        torques = np.empty((n, 3, *self._shape))
        for late, (second, central, hat) in enumerate(zip(_SECOND, _CENTRAL, _HAT, strict=True)):
            by_torque = hat * squared * own + central * step * by_change
            torques[:, late, :n] = by_torque * np.roll(self._slope, late, axis=1)
            rigid = second * (M2 + by_change * D) + hat * squared * G
            torques[:, late, :n] += rigid + central * step * D * own
            if laws.hysteretic:
                torques[:, late, n:] = by_torque * laws.level
        torques[..., m.starts] = 0
        torques[:, 0, :n, m.starts] = np.eye(n)
        return Recursion.of(torques, self._loops if laws.hysteretic else None)


def _loop(laws: GearLaws, delta: Floats, starts: np.ndarray) -> Floats:
    """State of the hysteresis over deflections (n, N)."""
    return dahl(delta, laws.sharpness, starts) if laws.hysteretic else np.zeros(delta.shape)
