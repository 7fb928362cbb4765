"""Nonlinear laws of gear and arm: their waveforms over a period, as phasors.

The torque through a gear is known from the balance at its motor, f = τ − Mθ̈ − friction. A gear with

    f = K e + c e³ + F z(δ) + D δ̇,   δ = e + (b/2) sign f

(cubic stiffness c, total backlash b, hysteresis of level F with Dahl's z) is wound up by
δ = f/(K + sD) + w; w is the contribution of the law to the deflection, found by harmonic balance of the
torque or, of motions, from the motors' motion over time. Coulomb friction at the arm is
F_a sign θ̇_a, presliding friction at the motor F_p z(θ). All enter the residual as phasors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.joint_equations import wind_up
from jointid.estimation.estimators.parameters import GEAR_LAWS, Parameters
from jointid.gears.arm_friction import ArmFriction
from jointid.gears.dahl import presliding_bins
from jointid.gears.driven_gears import DrivenGears
from jointid.gears.harmonic_balance import WoundGears
from jointid.gears.laws import GearLaws
from jointid.gears.motor_motion import MotorMotion
from jointid.gears.torque_spread import periodic_dahl
from jointid.gears.wound import Wound, first_finite, from_observers
from jointid.phasors.periods import phasors_of, samples_of
from jointid.phasors.segment import Segment

_CLEAR = 3.0
"""Standard deviations from which a harmonic of the torque counts; the others are noise."""
_POINTS = 8
"""Samples per period for each harmonic."""
_FINE = 250
"""Number of samples from which half as many per harmonic suffice."""
_LEAST_HARMONICS = 16
"""Harmonics that decide the number of samples where the phasors hold fewer."""
_BY_TORQUE = 3.0
"""Frequency, over the resonance with the motor locked, up to which the deflection follows from the
torque. Noise alone asks for 1. Beyond it the deflection is computed from M2 and gravity: if they are
wrong at the start, fits of strongly coupled arms end at local minima. From 5 on, M hides the torque."""
_STILL = 1e-12
"""Deflection and torque below which a gear transmits no torque, rad and N·m."""
_LEAST_ANGLE = 1e-30
"""Presliding angle of a joint that does not move, rad."""
_STEP = 1e-3
"""Relative change of a presliding angle for its derivative."""
_SMALL = 1e-4
"""Step of a parameter for its derivative, over the value at which the law equals the linear gear."""
_GEAR = (
    "K", "cubic", "backlash", "hysteresis", "presliding",
    "piecewise", "knee", "second_bend", "second_knee",
)  # fmt: skip
"""Parameters of a gear's torque over deflection."""

_BALANCED = "torque_scale", "M", "viscous", "coulomb"
"""Parameters of the motors' balance in ``MotorMotion.balance``."""


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
    locked: Floats
    """Resonance with the motor locked, rad/s."""
    free: Floats
    """1/M + M2⁻¹ of each joint, shape (n,)."""
    sines: np.ndarray
    """Rows that are no segments of motions."""
    motors: MotorMotion | None
    """Motion of the motors in the others."""
    segments: Mapping[int, Segment] = field(default_factory=dict)
    """Those of motions by their row."""
    arm_directions: Mapping[int, Complexes] = field(default_factory=dict)
    """Phasors of the signs of the arms' velocities in them, (bins, n), for Coulomb friction."""
    strength: float = 1.0
    """Factor on the observer of the gears in motions."""
    latest: list[Wound] = field(default_factory=list)
    """Deflection as last solved, from which the next solution starts."""

    @classmethod
    def of(
        cls,
        s: Complexes,
        angle: Complexes,
        torque: Complexes,
        variance: Floats,
        arm: Floats,
        rotor: Floats,
        motors: MotorMotion | None,
        segments: Mapping[int, Segment],
    ) -> JointLaws:
        """Collect the signals.

        Parameters
        ----------
        s : ndarray, shape (r, H)
        angle, torque : ndarray, shape (r, H, n)
            Of the motors, and through the gears.
        variance : ndarray, shape (r, H, 2n)
            Of the logged angles and torques.
        arm : ndarray, shape (r, n, n)
            M2⁻¹ of every record.
        rotor : ndarray, shape (r, n)
            M of every record.
        motors : MotorMotion, optional
            Of rows that are segments of motions.
        segments : mapping of int to Segment
            These by their row.
        """
        n, H, squared = angle.shape[2], angle.shape[1], (s * s)[..., None]
        noise = variance.copy()
        noise[..., n:] += np.abs(squared * rotor[:, None]) ** 2 * variance[..., :n]
        clear = np.abs(np.concatenate([angle, torque], axis=2)) ** 2 > _CLEAR**2 * noise
        clear[:, 0] = True
        samples = samples_of(np.where(clear[..., :n], angle, 0).swapaxes(1, 2), _points(H))
        largest = np.linalg.norm(torque * clear[..., n:], axis=1).max(axis=0)
        arm_angle = np.einsum("rij,rhj->rhi", arm, torque) / squared
        size = np.maximum(np.abs(angle - arm_angle), np.finfo(float).tiny)
        sines = np.setdiff1d(np.arange(len(s)), list(segments))
        locked = (np.sqrt(np.abs(arm_angle) / size) * np.abs(s)[..., None])[:, 0]
        middle = np.median(locked[sines] if sines.size else locked, axis=0)
        free = (1 / rotor + np.einsum("rjj->rj", arm)).mean(axis=0)
        return cls(
            s, clear[..., n:], np.asarray(largest), samples, middle, free, sines, motors, segments
        )

    def planned(self, s: Complexes, angle: Complexes) -> JointLaws:
        """The same laws in r other records, at s of shape (r, H) with motor angles (r, H, n)."""
        samples, clear = samples_of(angle.swapaxes(1, 2), _points(s.shape[1])), np.ones_like(angle, bool)
        every = np.arange(len(s))
        sines = replace(self, s=s, clear=clear, angle=samples, sines=every, latest=[])
        return replace(sines, motors=None, segments={}, arm_directions={})

    @property
    def low(self) -> np.ndarray:
        """Harmonics at which the deflection follows from the torque, shape (r, H, n)."""
        return np.asarray(np.abs(self.s)[..., None] < _BY_TORQUE * self.locked)

    def units(self, p: Parameters) -> dict[str, Floats]:
        """Value of each parameter at which its law is as large as the linear gear, each shape (n,)."""
        wind_up = np.maximum(self.peak / p.K, _STILL)
        return {
            **dict.fromkeys(("K", "piecewise", "second_bend"), p.K),
            **dict.fromkeys(("backlash", "presliding", "knee", "second_knee"), wind_up),
            "D": p.K / np.abs(self.s).max(),
            "cubic": p.K / wind_up**2,
            "hysteresis": np.maximum(self.peak, _STILL),
            "arm_coulomb": self.peak,
            "bristle": np.abs(self.angle).max(axis=(0, 2)),
        }

    def by_signals(self, of_torque: Complexes, arm: Complexes, stiffness: Complexes) -> Complexes:
        """Deflection of linear gears by angles and torques of the motors, shape (r, H, n, 2n).

        ``of_torque`` are the torques through the gears by them, and ``arm`` is the arm's compliance.
        """
        return np.where(self.low[..., None], of_torque / stiffness[..., None], wind_up(of_torque, arm))

    def wound(
        self,
        torque: Complexes,
        moved: Complexes,
        stiffness: Complexes,
        p: Parameters,
        arm: tuple[Floats, Floats],
        rotor: Floats,
    ) -> Wound | None:
        """Deflection of nonlinear gears, None of linear ones, from signals of shape (r, H, n).

        ``moved`` is the deflection by the motions of motor and arm, ``stiffness`` linear and dynamic;
        ``arm`` are M2 and the gravity stiffness of every pose, each (p, n, n), ``rotor`` is M, (n,).
        """
        if not any(name in p.layout for name in GEAR_LAWS):
            return None
        laws, (r, H, n), rows = _laws(_values(p)), torque.shape, self.sines
        beyond = np.zeros((r, n, 1 + H), complex)
        of_sines: WoundGears | None = None
        of_motions: DrivenGears | None = None
        with np.errstate(all="ignore"):  # far-off parameters are rejected by their cost
            if rows.size:
                by_torque, further = (self.low / stiffness)[rows], self._beyond_measured(p)
                drive = np.where(self.low[rows], by_torque * torque[rows], moved[rows])
                both = _with_mean([drive, 0 * further]), _with_mean([by_torque, further])
                m = int(self.low[rows].sum(axis=1).max())
                starts = [each.of_sines for each in self.latest]
                of_sines = first_finite(partial(WoundGears.solve, laws, *both, H, m), starts)
                beyond[rows] = of_sines.beyond
            if self.motors:
                own = p.torque_scale, rotor, p.effect("viscous"), p.effect("coulomb")
                measured = self.motors.balance(*(np.broadcast_to(each, p.K.shape) for each in own))
                of_motions = from_observers(
                    partial(DrivenGears.solve, self.motors, laws, p.D, *arm, measured),
                    self.strength,
                    [each.of_motions for each in self.latest],
                    laws.has_backlash,
                )
                beyond[..., 1:] += self.motors.bins(of_motions.beyond, (r, H)).swapaxes(1, 2)
        found = Wound(beyond, of_sines, of_motions)
        if np.isfinite(beyond).all():
            self.latest[:] = [found]
        return found

    def _beyond_measured(self, p: Parameters) -> Complexes:
        """Deflection over torque beyond K δ at the next harmonics of sines, (r, T, n).

        The edges of backlash have harmonics beyond those of the records. The controller has no effect
        there: the gear moves motor and arm against each other.
        """
        H = self.s.shape[1]
        count = H * ("backlash" in p.layout or "piecewise" in p.layout)
        s = (self.s[self.sines, :1] * np.arange(H + 1, H + 1 + count))[..., None]
        return np.asarray(1 / (s * s / self.free + p.K + s * p.D))

    def slopes(
        self,
        wound: Wound | None,
        p: Parameters,
        gear: Complexes,
        stiffness: Mapping[str, Complexes],
        torque: Mapping[str, Complexes],
        apart: Mapping[str, Complexes],
        arm: Floats | None,
    ) -> dict[str, Complexes]:
        """Derivatives of all w by the parameters, shape (r, H, n, c) of c parameters.

        Parameters
        ----------
        gear : ndarray, shape (r, H, n)
            Linear dynamic stiffness.
        stiffness : mapping of str to ndarray, shape (r, H, n)
            Its derivatives by the parameters in it.
        torque : mapping of str to ndarray, shape (r, H, n)
            Derivatives of the torque f by other parameters of the same joint.
        apart : mapping of str to ndarray, shape (r, H, n, c)
            Derivatives of the deflection by the motions of motor and arm.
        arm : ndarray, shape (c, p, n, n), optional
            Derivatives of M2 of every pose by its parameters.
        """
        if wound is None:
            return {}
        values, units, H, n = _values(p), self.units(p), gear.shape[1], p.K.size
        names = list(dict.fromkeys((*apart, *stiffness, *(n for n in _GEAR if n in p.layout))))
        counts = [apart[name].shape[3] if name in apart else n for name in names]
        found = {
            name: np.zeros((*gear.shape, c), complex) for name, c in zip(names, counts, strict=True)
        }
        rows, inward, columns = self.sines, (self.low / gear)[self.sines], []
        by_angles, driven = (self.clear & ~self.low)[rows, ..., None], {}
        for name, c in zip(names, counts, strict=True):
            drive, beyond = np.zeros((2, rows.size, n, 1 + H, c), complex)
            of_motions: Floats | float = 0.0
            if name in _GEAR:
                step, changed = _SMALL * units[name][:, None], values.copy()
                changed[_GEAR.index(name)] += step[:, 0]
                of_sines, of_motions = wound.by_law(_laws(changed), step)
                beyond += _own(of_sines)
            if name in _BALANCED or name not in apart:
                unit = [np.full(n, float(name == each)) for each in _BALANCED]
                measured = self.motors.balance(*unit) if self.motors and name in _BALANCED else 0.0
                driven[name] = of_motions, measured
            if name in apart:
                drive += _with_mean([by_angles * apart[name][rows]])
            if name in torque:
                drive += _own(_with_mean([inward * torque[name][rows]]))
            if name in stiffness and wound.of_sines is not None:
                linear = _with_mean([inward * stiffness[name][rows]])
                linear[..., 0] = (name == "K") / p.K
                drive -= _own(linear * wound.of_sines.delta[..., : 1 + H])
            columns.append((drive, beyond))
        if wound.of_sines is not None:
            changes = wound.of_sines.change(
                *(np.concatenate(each, axis=3) for each in zip(*columns, strict=True))
            )
            for name, change in zip(
                names, np.split(changes, np.cumsum(counts)[:-1], axis=3), strict=True
            ):
                found[name][rows] = change[:, :, 1:].swapaxes(1, 2)
        if wound.of_motions is not None:
            for name, change in wound.of_motions.slopes(driven, self.s.shape, arm).items():
                found[name] += change
        w = self.law(wound, gear)
        for name, value in stiffness.items():
            found[name] += (w * value)[..., None] * np.eye(n)
        return {name: -value / gear[..., None] for name, value in found.items()}

    def law(self, wound: Wound, stiffness: Complexes) -> Complexes:
        """w, the deflection beyond that of the linear gear under the same torque, (r, H, n), rad."""
        return np.asarray(-wound.beyond[..., 1:].swapaxes(1, 2) / stiffness)

    def arm_friction(self, level: Floats, torque: Complexes, arm: Complexes) -> ArmFriction:
        """Friction of levels (n,) under torques (r, H, n) at arms of compliance A⁻¹, (r, H, n, n)."""
        clear, mobility = np.where(self.clear, torque, 0), self.s[..., None, None] * arm
        return ArmFriction.solve(level, mobility, clear, _points(torque.shape[1]), self.arm_directions)

    def presliding(self, bristle: Floats, H: int) -> Complexes:
        """Phasors of z(θ) for presliding angles, shape (n,); shape (r, H, n)."""
        sharpness = 1 / np.maximum(bristle, _LEAST_ANGLE)[:, None]
        found = np.zeros((len(self.s), H, bristle.size), complex)
        if self.sines.size:
            z = periodic_dahl(self.angle[self.sines], sharpness)
            found[self.sines] = phasors_of(z, H).swapaxes(1, 2)
        for row, bins in presliding_bins(self.segments, sharpness).items():
            found[row, : len(bins)] = bins
        return found

    def presliding_slope(self, bristle: Floats, shape: Complexes) -> Complexes:
        """Derivative of the phasors ``shape`` of z(θ) by the presliding angles, shape (r, H, n)."""
        changed = self.presliding((1 + _STEP) * bristle, shape.shape[1])
        return np.asarray((changed - shape) / (_STEP * np.maximum(bristle, _LEAST_ANGLE)))


def _points(H: int) -> int:
    points = _POINTS * max(H, _LEAST_HARMONICS)
    return points if points < _FINE else max(_FINE, points // 2)


def _with_mean(parts: Sequence[Complexes]) -> Complexes:
    """A mean of zero before consecutive harmonics, each (r, H, n, ...): shape (r, n, 1 + H, ...)."""
    return np.concatenate([0 * parts[0][:, :1], *parts], axis=1).swapaxes(1, 2)


def _own(columns: Complexes) -> Complexes:
    """Columns (r, n, 1 + H) of the parameter of each joint, (r, n, 1 + H, n)."""
    return columns[..., None] * np.eye(columns.shape[1])[:, None]


def _values(p: Parameters) -> Floats:
    """Parameters of the gears, shape (9, n); those not fitted are zero."""
    return np.array([np.broadcast_to(p.effect(name), p.K.shape) for name in _GEAR])


def _laws(values: Floats) -> GearLaws:
    K, cubic, backlash, level, presliding, bend, knee, second, further = values[..., None]
    return GearLaws.made(K, cubic, backlash, level, presliding, (knee, knee + further), (bend, second))
