"""Nonlinear laws of gear and arm: their waveforms over a period, as phasors.

The torque through a gear is known from the balance at its motor, f = τ − Mθ̈ − friction. A gear with

    f = K e + c e³ + F z(δ) + D δ̇,   δ = e + (b/2) sign f

(cubic stiffness c, total backlash b, hysteresis of level F with Dahl's z) is wound up by
δ = f/(K + sD) + w; w is what the law adds to the linear deflection. Coulomb friction at the arm is
F_a sign θ̇_a, presliding friction at the motor F_p z(θ). All enter the residual as phasors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.effects import GEAR_LAWS
from jointid.estimation.parameters import Parameters
from jointid.phasors.periods import pairs, phasors_of, samples_of

_CLEAR = 3.0
"""Standard deviations from which a harmonic of the torque counts; the others are noise."""
_POINTS = 8
"""Samples over a period for each harmonic."""
_FINE = 250
"""Samples from which half as many for each harmonic do."""
_LEAST_HARMONICS = 16
"""Harmonics that decide the number of samples where the phasors hold fewer."""
_NEWTON = 2
"""Newton steps for the deflection at each sample, from that extrapolated."""
_STABLE = 0.1
"""Least slope of a softening spring, over K."""
_SLACK = 1e-3
"""Least stiffness inside the play, over K, where the damping is zero."""
_STILL = 1e-12
"""Wind-up of a gear that transmits no torque, rad."""
_LEAST_ANGLE = 1e-30
"""Presliding angle of a joint that does not move, rad."""
_STEP = 1e-3
"""Relative change of a presliding angle for its derivative."""
_SMALL = 1e-4
"""Step of a parameter for its derivative, over the value at which the law equals the linear gear."""
_GEAR = ("K", "D", "cubic", "backlash", "hysteresis", "presliding")
"""Parameters of a gear."""


@dataclass(frozen=True, eq=False)
class JointLaws:
    """Signals that do not depend on the parameters; r records, H harmonics, n joints."""

    s: Complexes
    """(r, H)"""
    clear: np.ndarray
    """Harmonics of the torque above the noise, shape (r, H, n)."""
    peak: Floats
    """Largest torque of each joint, shape (n,), N·m."""
    angle: Floats
    """Motor angles over a period, shape (r, n, t), rad."""

    @classmethod
    def of(cls, s: Complexes, angle: Complexes, torque: Complexes, variance: Floats) -> JointLaws:
        """Collect the signals.

        Parameters
        ----------
        s : ndarray, shape (r, H)
        angle, torque : ndarray, shape (r, H, n)
            Of the motors, and through the gears.
        variance : ndarray, shape (r, H, 2n)
            Of both.
        """
        n, H = angle.shape[2], angle.shape[1]
        clear = np.abs(np.concatenate([angle, torque], axis=2)) ** 2 > _CLEAR**2 * variance
        clear[:, 0] = True
        samples = samples_of(np.where(clear[..., :n], angle, 0).swapaxes(1, 2), _points(H))
        largest = np.linalg.norm(torque * clear[..., n:], axis=1).max(axis=0)
        return cls(s, clear[..., n:], np.asarray(largest), samples)

    def units(self, p: Parameters) -> dict[str, Floats]:
        """Value of each parameter at which its law is as large as the linear gear, each shape (n,)."""
        wind_up = np.maximum(self.peak / p.K, _STILL)
        return {
            "K": p.K,
            "D": p.K / np.abs(self.s).max(),
            "cubic": p.K / wind_up**2,
            "backlash": wind_up,
            "hysteresis": self.peak,
            "presliding": wind_up,
            "arm_coulomb": self.peak,
            "bristle": np.abs(self.angle).max(axis=(0, 2)),
        }

    def deflection(self, torque: Complexes, p: Parameters) -> Complexes:
        """w, the deflection beyond the linear one, shape (r, H, n), rad, for the torque f."""
        if not any(name in p.layout for name in GEAR_LAWS):
            return np.zeros_like(torque)
        return np.asarray(self._deflections(torque[None], _values(p)[None])[0])

    def slopes(
        self, torque: Complexes, p: Parameters, directions: Mapping[str, Complexes]
    ) -> dict[str, Complexes]:
        """Derivatives of w, each shape (r, H, n): by the gears' parameters, and along other directions.

        Parameters
        ----------
        directions : mapping of str to ndarray, shape (r, H, n)
            Derivatives of the torque f by other parameters of the same joint.
        """
        if not any(name in p.layout for name in GEAR_LAWS):
            return {}
        units, values = self.units(p), _values(p)
        if not values[2:5].any():
            return self._first_order(torque, p)
        names = [name for name in _GEAR if name in p.layout]
        changed = np.repeat(values[None], 1 + len(names) + len(directions), axis=0)
        forces = np.repeat(torque[None], len(changed), axis=0)
        steps = [_SMALL * units[name] for name in names]
        for k, name in enumerate(names, start=1):
            changed[k, _GEAR.index(name)] += steps[k - 1]
        for k, direction in enumerate(directions.values(), start=1 + len(names)):
            size = np.abs(np.where(self.clear, direction, 0)).max(axis=(0, 1))
            steps.append(_SMALL * self.peak / np.where(size > 0, size, 1.0))
            forces[k] += steps[-1] * direction
        w = self._deflections(forces, changed)
        found = [*names, *directions]
        return {name: (w[k] - w[0]) / steps[k - 1] for k, name in enumerate(found, start=1)}

    def _first_order(self, torque: Complexes, p: Parameters) -> dict[str, Complexes]:
        """Derivatives of w by the laws' amplitudes where all are zero: −g/(K + sD) for a law g."""
        H = torque.shape[1]
        f = np.where(self.clear, torque, 0).swapaxes(1, 2)
        K = p.K[:, None]
        compliance = 1 / (K + self.s[:, None] * p.D[:, None])
        delta = samples_of(compliance * f, _points(H))
        laws = {}
        if "cubic" in p.layout:
            laws["cubic"] = delta**3
        if "backlash" in p.layout:
            laws["backlash"] = -0.5 * K * _sign(delta)
        if "hysteresis" in p.layout:
            laws["hysteresis"] = _dahl(delta, p["presliding"][:, None])
        return {name: -(compliance * phasors_of(law, H)).swapaxes(1, 2) for name, law in laws.items()}

    def _deflections(self, torque: Complexes, values: Floats) -> Complexes:
        """w for several torques, each shape (B, r, H, n), and sets of parameters, shape (B, 6, n)."""
        H = torque.shape[2]
        f = np.where(self.clear, torque, 0).swapaxes(2, 3)
        samples = np.moveaxis(samples_of(f, _points(H)), -1, 0)
        gear = _Gear.of(values, 2 * np.pi / (np.abs(self.s[:, :1]) * _points(H)))
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # parameters far off are refused by their cost
            delta = phasors_of(np.moveaxis(gear.wound_up(samples), 0, -1), H)
        return np.asarray((delta - gear.linear_compliance(H, _points(H)) * f).swapaxes(2, 3))

    def arm_friction(self, torque: Complexes, arm: Complexes) -> Complexes:
        """Phasors of sign θ̇_a, shape (r, H, n), for the arm's compliance A⁻¹, shape (r, H, n, n)."""
        f, H = np.where(self.clear, torque, 0), torque.shape[1]
        velocity = self.s[..., None] * (arm @ f[..., None])[..., 0]
        signs = _sign(samples_of(velocity.swapaxes(1, 2), _points(H)))
        return phasors_of(signs, H).swapaxes(1, 2)

    def arm_friction_slope(self, torque: Complexes, arm: Complexes) -> SignSlope:
        """Derivative of the phasors of sign θ̇_a by those of θ̇_a, both of them for the torque f."""
        f, H = np.where(self.clear, torque, 0), torque.shape[1]
        velocity = self.s[..., None] * (arm @ f[..., None])[..., 0]
        return SignSlope.at(samples_of(velocity.swapaxes(1, 2), _points(H)), H)

    def presliding(self, bristle: Floats, H: int) -> Complexes:
        """Phasors of z(θ) for presliding angles, shape (n,); shape (r, H, n)."""
        return phasors_of(_dahl(self.angle, bristle[:, None]), H).swapaxes(1, 2)

    def presliding_slope(self, bristle: Floats, shape: Complexes) -> Complexes:
        """Derivative of the phasors ``shape`` of z(θ) by the presliding angles, shape (r, H, n)."""
        changed = self.presliding((1 + _STEP) * bristle, shape.shape[1])
        return np.asarray((changed - shape) / (_STEP * np.maximum(bristle, _LEAST_ANGLE)))


@dataclass(frozen=True, eq=False)
class SignSlope:
    """Derivative of ``_sign``: of the samples at its jumps alone, up to m over a period."""

    inner: Floats
    """Change of these samples by the sines and cosines of the signal, shape (r, n, m, 2H)."""
    outer: Floats
    """Their sines and cosines, shape (r, n, 2H, m)."""

    @classmethod
    def at(cls, x: Floats, H: int) -> SignSlope:
        """Derivative at samples over a period, shape (r, n, t)."""
        points = x.shape[-1]
        rise = np.roll(x, -1, axis=-1) - np.roll(x, 1, axis=-1)
        inside = np.abs(x) < 0.25 * np.abs(rise)
        place = np.argsort(~inside, axis=-1, kind="stable")[..., : max(1, inside.sum(axis=-1).max())]
        x, rise = (np.take_along_axis(v, place, axis=-1)[..., None] for v in (x, rise))
        inside = np.take_along_axis(inside, place, axis=-1)[..., None]
        waves = pairs(H, points).T
        rise = np.where(inside, rise, np.inf)
        turn = (x / rise) * (waves[(place + 1) % points] - waves[place - 1])
        own = waves[place]
        inner = np.where(inside, 4 * (own - turn) / np.abs(rise), 0.0)
        return cls(inner, (2 / points) * own.swapaxes(2, 3))

    def of(self, change: Complexes) -> Complexes:
        """Change of the sign's phasors for changes of the signal's, both shape (r, H, n, c)."""
        rows = np.concatenate([change.real, change.imag], axis=1).swapaxes(1, 2)
        found = self.outer @ (self.inner @ rows)
        H = change.shape[1]
        return np.asarray((found[:, :, :H] + 1j * found[:, :, H:]).swapaxes(1, 2))


def _points(H: int) -> int:
    points = _POINTS * max(H, _LEAST_HARMONICS)
    return points if points < _FINE else max(_FINE, points // 2)


def _values(p: Parameters) -> Floats:
    """Parameters of the gears, shape (6, n); those not fitted are zero."""
    return np.array([np.broadcast_to(p.effect(name), p.K.shape) for name in _GEAR])


@dataclass(frozen=True, eq=False)
class _Gear:
    """Gears with B sets of parameters, each shape (B, 1, n), integrated over a period in equal steps.

    The θ-method, exponentially fitted: exact for a linear gear under constant torque, whether its time
    constant D/K is longer or shorter than a step.
    """

    K: Floats
    cubic: Floats
    half_play: Floats
    level: Floats
    sharpness: Floats
    """Inverse of the presliding deflection; 0 without hysteresis."""
    rate: Floats
    """Damping over the step, (B, r, n), N·m/rad."""
    theta: Floats
    """Weight of the new torque in a step, (B, r, n)."""

    @classmethod
    def of(cls, values: Floats, step: Floats) -> _Gear:
        """Gears with parameters of shape (B, 6, n) and steps of shape (r, 1), s."""
        K, D, cubic, play, level, presliding = np.moveaxis(values, 1, 0)[:, :, None]
        rate = np.maximum(D / step, _SLACK * K)
        z = np.clip(K / rate, 1e-3, 500.0)
        sharpness = np.where(level != 0, 1 / np.where(presliding > 0, presliding, 1.0), 0.0)
        return cls(K, cubic, 0.5 * play, level, sharpness, rate, 1 / -np.expm1(-z) - 1 / z)

    def linear_compliance(self, H: int, points: int) -> Complexes:
        """Response of the same integration to the torque with K and D alone, shape (B, r, n, H)."""
        late = np.exp(-2j * np.pi * np.arange(1, H + 1) / points)
        K, rate, theta = (v[..., None] for v in (self.K, self.rate, self.theta))
        pole = rate - (1 - theta) * K
        return np.asarray((theta + (1 - theta) * late) / (rate + theta * K - pole * late))

    def wound_up(self, f: Floats) -> Floats:
        """Periodic deflection under the torque f, both shape (t, B, r, n)."""
        theta, rate, hysteretic, points = self.theta, self.rate, bool(self.level.any()), len(f)
        before = points if hysteretic else points // 2  # hysteresis needs a period to become periodic
        first = f[-before % points]
        delta, spring, loop = first / self.K, first, np.zeros_like(first)
        step, found = np.zeros_like(first), np.empty(f.shape)
        for k in range(1 - before, points):
            target = theta * f[k % points] + (1 - theta) * (f[(k - 1) % points] - spring) + rate * delta
            new = delta + step
            for _ in range(_NEWTON):
                spring, slope, _ = self._spring(new, delta, loop, target, hysteretic)
                new = new + (target - rate * new - theta * spring) / (rate + theta * slope)
            spring, _, loop = self._spring(new, delta, loop, target, hysteretic)
            step, delta = new - delta, new
            if k >= 0:
                found[k] = delta
        return found

    def _spring(
        self, new: Floats, old: Floats, loop: Floats, target: Floats, hysteretic: bool
    ) -> tuple[Floats, Floats, Floats]:
        """Torque without damping after a step, its slope, and the state of the hysteresis."""
        e, slope = new, self.K
        if self.half_play.any():
            e = new - np.minimum(np.maximum(new, -self.half_play), self.half_play)
            slope = np.where(e == 0, 0.0, slope)
        spring = self.K * e
        if self.cubic.any():
            squared = self.cubic * e * e
            spring = spring + squared * e
            slope = np.maximum(slope + 3 * squared, _STABLE * slope)
        if hysteretic:
            move = new - old
            sign = np.sign(np.where(move == 0, target - self.rate * new - self.theta * spring, move))
            loop = sign + (loop - sign) * np.exp(-np.abs(move) * self.sharpness)
            spring = spring + self.level * loop
            slope = slope + self.level * self.sharpness * (1 - sign * loop)
        return spring, slope, loop


def _sign(x: Floats) -> Floats:
    """Sign of periodic samples, with a jump that is resolved between samples."""
    step = 0.25 * np.abs(np.roll(x, -1, axis=-1) - np.roll(x, 1, axis=-1))
    return np.asarray(np.clip(x / np.maximum(step, np.finfo(float).tiny), -1, 1))


def _dahl(delta: Floats, preslide: Floats) -> Floats:
    """Dahl's z over a period, dz/dδ = (1 − z sign δ̇)/x, in its periodic steady state; last axis time."""
    step = np.moveaxis(np.diff(delta, axis=-1, append=delta[..., :1]), -1, 0)
    decay = np.exp(-np.abs(step) / np.maximum(preslide[..., 0], _LEAST_ANGLE))
    drive = np.sign(step) * (1 - decay)
    z, last = np.zeros(step.shape), np.zeros(step.shape[1:])
    for k in range(len(step)):
        last = drive[k] + decay[k] * last
    last /= np.maximum(1 - np.prod(decay, axis=0), 1e-9)
    for k in range(len(step)):
        z[k] = last
        last = drive[k] + decay[k] * last
    return np.moveaxis(z, 0, -1)
