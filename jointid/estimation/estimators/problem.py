"""Data and fixed quantities of a fit, and the range of its parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.estimation.estimators.held_torque import HeldTorque
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_laws import JointLaws
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import (
    ARM_EFFECTS,
    FILTERS,
    GEAR_LAWS,
    LAWS,
    ParameterLayout,
    Parameters,
)
from jointid.gears.motor_motion import MotorMotion
from jointid.motion.arm_motion import arm_directions
from jointid.motion.end_terms import EndTerms, motor_motion, row_groups
from jointid.motion.free_friction import FreeFriction
from jointid.motion.friction import FrictionWaveforms
from jointid.phasors.extract import Phasors
from jointid.small_matrices import inverse

_STIFFEST = 100.0
"""Upper bound on K as a multiple of the start value; beyond it the iteration has diverged."""
_SHAPES = {"presliding": 0.03, "bristle": 0.03, "knee": 0.35, "second_knee": 0.35}
"""Presliding deflections and angles, and deflections at changes of slope: start values over the largest
deflection or angle."""
_SHARPEST, _SLOWEST = 1e-4, 2.0
"""Their range: beyond it, a sharper hysteresis or one like a spring cannot be distinguished."""
_LARGEST = 4.0
"""Upper bound on backlash and hysteresis over the largest linear deflection and torque."""
_FLATTEST = 0.1
"""Smallest slope of a piecewise linear gear, over K."""
LOWEST_LINK = 4.0
"""Lowest link mode of the prior, over the joint's resonance: −s⁴c does not describe lower ones."""
_FILTER_SHARE, _LEAST_FILTER = 0.3, 0.05
"""Start value of a filter's time constant beside a delay or lags: over the delay (reduced by it),
and over the period at the highest frequency / 2π. At zero its effect is that of the delay."""
_BENDS = {"piecewise": 0.73, "second_bend": 1.33}
"""Start values of changes of slope, over cubic stiffness times the square of the largest deflection."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Data and fixed quantities of the residual; r records, n joints, H harmonics."""

    s: Complexes  # (r, H)
    z: Complexes  # (r, H, 2n)
    noise: Noise
    known: np.ndarray  # (r, H), false where the sample rate or record length excludes the harmonic
    prior: InertiaPrior
    friction: FrictionWaveforms | None
    layout: ParameterLayout
    laws: JointLaws | None
    stiffest: Floats  # upper bound on K, (n,)
    link_std: Floats  # of the prior of link flexibility, (n,)
    group: np.ndarray  # (r, H), the misfit of each group of rows is its own
    main: np.ndarray  # (G,), groups of the fundamentals of sines and of all bins of motions
    held: HeldTorque
    progress: Floats  # (r, 3), slow changes over the records
    ends: EndTerms | None = None
    motion: Complexes | None = None  # (2, r, H, n), velocity and acceleration of motions
    repeated: Floats | None = None  # (r, n), part of the angles' variance that adds up over periods
    free_torque: Complexes | float = 0.0  # (r, H, n), not through nonlinear gears: free friction
    law_noise: tuple[Complexes, Floats] | None = None  # w by noise, ``with_law_noise``, (r, H, n)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.prior.n

    @property
    def free(self) -> FreeFriction:
        """Free friction waveforms around the reversals."""
        return FreeFriction(()) if self.friction is None else self.friction.free

    @property
    def used(self) -> np.ndarray:
        """Whether a joint's residual in a record carries information, shape (r, n)."""
        every = np.ones((len(self.s), self.n), bool)
        return every if self.friction is None else ~self.friction.stationary

    @property
    def rows(self) -> int:
        """Number of real equations."""
        return int(2 * self.known.sum(axis=1) @ self.used.sum(axis=1))

    def rotor_inertia(self, p: Parameters) -> Floats:
        """Distinct M, shape (m, n), kg·m²."""
        return p["M"] if "M" in self.layout else self.prior.M

    def arm_inertia(self, p: Parameters) -> Floats:
        """Distinct M2, shape (p, n, n), kg·m²."""
        return self.prior.totals(p["M2"]) if "M2" in self.layout else self.prior.M2

    def gravity(self, p: Parameters) -> Floats:
        """Gravity stiffness with each M2, shape (p, n, n), N·m/rad."""
        return self.prior.gravities(p["M2"]) if "M2" in self.layout else self.prior.gravity

    @property
    def highest_rad_s(self) -> float:
        """Highest fundamental of the sines, or frequency of the motions."""
        return float(np.abs(self.s[self.known & self.main[self.group]]).max())

    def by_group(self, values: Floats) -> Floats:
        """Sums over the groups, shape (G,), of values (r, H)."""
        return np.bincount(self.group.ravel(), values.ravel(), self.main.size).astype(float)

    def feasible(self, vector: Floats) -> bool:
        """Whether K, M and the torque scales are positive, and M2 and M2 − added positive definite."""
        p = self.layout.named(vector)
        positive = [p.K, *(p[name] for name in ("M", "torque_scale") if name in self.layout)]
        if any(np.any(values <= 0) for values in positive) or np.any(self.stiffest <= p.K):
            return False
        if self.laws and self.laws.motors and np.any(p.D < 0):  # only the observer would hold the arms
            return False
        units = {} if self.laws is None else self.laws.units(p)
        for name in (*_SHAPES, "backlash", "hysteresis"):
            if name in self.layout and name in units:
                low, high = (_SHARPEST, _SLOWEST) if name in _SHAPES else (-_LARGEST, _LARGEST)
                if np.any((p[name] < low * units[name]) | (p[name] > high * units[name])):
                    return False
        if "piecewise" in self.layout:
            least = np.minimum(p["piecewise"], p["piecewise"] + p["second_bend"])
            if np.any(p.K + least < _FLATTEST * p.K):
                return False
        if "M2" not in self.layout:
            return True
        matrices = self.prior.symmetric(p["M2"]), self.arm_inertia(p)
        return bool(np.all(np.linalg.eigvalsh(np.concatenate(matrices)) > 0))

    def start(self, values: Parameters, filter_share: float = 0.0) -> Floats:
        """Start vector, shape (P,): the given values, means of the prior, zero for the rest.

        ``filter_share`` is the time constant of a further filter beside a delay or lags, over the
        period at the highest frequency / 2π; by default it follows from the delay.
        """
        means = {name: mean for name, (mean, _) in self.prior.blocks().items()}
        shapes = {block.name: block.shape for block in self.layout.blocks}
        given = {block.name: values[block.name] for block in values.layout.blocks}
        same = {name: value for name, value in given.items() if shapes.get(name) == value.shape}
        timing = next((name for name in ("lag", "delay") if name in shapes), None)
        for name in FILTERS:
            if timing and name in shapes and name not in same:
                late, shortest = same.get(timing, np.zeros(())), 1 / self.highest_rad_s
                least = np.maximum(_FILTER_SHARE * np.abs(late).mean(), _LEAST_FILTER * shortest)
                means[name] = np.full(self.n, filter_share * shortest or least)
                same[timing] = late - means[name][0]
        for name, share in _SHAPES.items():
            if name in self.layout and self.laws is not None:
                means[name] = share * self.laws.units(values)[name]
        if "piecewise" in self.layout and self.laws is not None and "cubic" in given:
            rise = given["cubic"] * self.laws.units(values)["knee"] ** 2
            means |= {name: share * rise for name, share in _BENDS.items()}
        return np.maximum(self.layout.pack(**(means | same)), self.layout.lowest)

    def prior_residual(self, vector: Floats) -> tuple[Floats, Floats]:
        """Deviation from the prior's mean, shape (P,), and the prior's information, shape (P, P)."""
        deviation, weight = np.zeros(vector.size), np.zeros((vector.size, vector.size))
        for name, (mean, _) in self.prior.blocks().items():
            if name in self.layout:
                place = self.layout[name]
                deviation[place] = vector[place] - mean.ravel()
                weight[place, place] = self.prior.information(name)
        if "link" in self.layout:
            place = self.layout["link"]
            deviation[place] = vector[place]
            weight[place, place] = np.diag(self.link_std**-2.0)
        return deviation, weight


def fitted_layout(
    prior: InertiaPrior,
    friction: FrictionWaveforms | None,
    delay: bool,
    effects: Sequence[str] = (),
) -> ParameterLayout:
    """Parameters of a fit with these friction waveforms, delay and effects."""
    parts = 0 if friction is None else friction.curve.shape[3]
    free = prior.blocks()
    return ParameterLayout.of(
        prior.n,
        friction=friction is not None,
        curve_parts=parts,
        delay=delay,
        effects=effects,
        rotors=len(prior.M) if "M" in free else 0,
        arms=len(prior.rest) if "M2" in free else 0,
        torque_scale="torque_scale" in free,
    )


def make_problem(
    phasors: Phasors,
    prior: InertiaPrior,
    layout: ParameterLayout,
    start: Parameters,
    friction: FrictionWaveforms | None,
    noise: Noise,
) -> Problem:
    """Collect the data of a fit.

    Parameters
    ----------
    start : Parameters
        Start values; the torques through the gears by them decide where arms with friction turn back.

    Raises
    ------
    JointIdError
        When the start has a negative stiffness.
    """
    stiffness = start.K
    if np.any(stiffness <= 0):
        raise JointIdError(
            f"K{int(np.argmin(stiffness)) + 1} is negative by least squares: check the sign and "
            "unit of the torque, the gear ratios, and the inertias M and M2."
        )
    n, z = prior.n, phasors.harmonics
    s = np.asarray(1j * phasors.omega[:, None] * np.arange(1, z.shape[1] + 1))
    laws, motion = None, None
    if any(name in layout for name in LAWS):
        motion = motor_motion(phasors)
        rotor = prior.M[prior.rotor, None]
        inertial = (s * s)[..., None] * rotor
        variance = np.einsum("rhjj->rhj", noise.covariance).real
        torque, angle = inertial * z[..., :n], z[..., :n]
        if motion is not None:
            moves = phasors.motion[:, None, None]
            torque = np.where(moves, motion[1] * rotor, torque)
            angle = np.where(moves, motion[1] / (s * s)[..., None], angle)
        arm = inverse(prior.M2)[prior.pose]
        bends = any(name in layout for name in GEAR_LAWS)
        laws = JointLaws.of(
            s, angle, z[..., n:] - torque, variance, arm, prior.M[prior.rotor],
            MotorMotion.of(phasors.segments, prior.pose, "hysteresis" in layout) if bends else None,
            segments := {row: each for row, each in enumerate(phasors.segments) if each is not None},
        )  # fmt: skip
        if "arm_coulomb" in layout and segments:
            directions = arm_directions(segments, prior.motors(phasors, start), prior.arms(start))
            laws = replace(laws, arm_directions=directions)
    repeated = np.zeros((len(s), n))
    for row, segment in enumerate(phasors.segments):
        if segment is not None:
            repeated[row] = 4 / segment.samples * segment.repeated_variance
    known = np.any(z != 0, axis=2)
    group, groups = row_groups(phasors, known)
    return Problem(
        s=s,
        z=z,
        noise=noise,
        known=known,
        group=group,
        main=groups,
        ends=EndTerms.of(phasors, s),
        motion=motion,
        repeated=repeated if repeated.any() else None,
        held=HeldTorque.of(s, phasors.hold_s, phasors.torque_delay_s),
        progress=phasors.progress,
        prior=prior,
        friction=friction,
        layout=layout,
        laws=laws,
        stiffest=_STIFFEST * stiffness,
        link_std=prior.link_std(stiffness, LOWEST_LINK),
    )


def motor_stiffness(problem: Problem, p: Parameters) -> Complexes:
    """s²M with viscous friction, shape (r, H, n), N·m/rad."""
    s = problem.s[..., None]
    inertial = s * s * problem.rotor_inertia(p)[problem.prior.rotor, None]
    return np.asarray(inertial + s * p.effect("viscous"))


def friction_advance(problem: Problem, p: Parameters) -> Complexes | float:
    """Friction over that at the logged motion, shape (r, H, n).

    A motor turns back before its filtered position does: earlier by the delay of the filter at the
    fundamental, which decides the sign of the velocity. The waveforms may lack a similar filter already.
    """
    if "position_filter" not in problem.layout:
        return 1.0
    first, friction = np.abs(problem.s[:, :1, None]), problem.friction
    freed = 0.0 if friction is None else friction.position_filter
    earlier = np.arctan(first * p["position_filter"]) - np.arctan(first * freed)
    return np.asarray(np.exp(problem.s[..., None] * earlier / first))


def motor_friction(problem: Problem, p: Parameters) -> Complexes:
    """Coulomb friction, its curve and presliding at the motors, and ripple, shape (r, H, n), N·m."""
    H = problem.s.shape[1]
    found = np.zeros((*problem.s.shape, problem.n), complex)
    if problem.friction is not None:
        for name, wave in problem.friction.by_parameter.items():
            block, _, part = name.partition(" ")
            if block in problem.layout:
                found += (p[block][:, int(part)] if part else p[block]) * wave[:, :H]
    if "motor_presliding" in problem.layout and problem.laws is not None:
        found += p["motor_presliding"] * problem.laws.presliding(p["bristle"], H)
    return np.asarray(found * friction_advance(problem, p))


def free_deflection(problem: Problem, p: Parameters) -> Complexes | float:
    """Deflection of the gears without torque, by transmission error, shape (r, H, n), rad."""
    waves = {} if problem.friction is None else problem.friction.deflection
    return sum(p[name] * wave for name, wave in waves.items() if name in problem.layout)


def arm_compliance(problem: Problem, p: Parameters) -> Complexes:
    """A⁻¹, shape (r, H, n, n); a copy that may be changed."""
    if not any(name in problem.layout for name in ARM_EFFECTS):
        return rigid_arm_compliance(problem, p, problem.s)
    s, pose = problem.s[..., None, None], problem.prior.pose
    A = s * s * problem.arm_inertia(p)[pose, None] + problem.gravity(p)[pose, None]
    own = s[..., 0] * p.effect("arm_viscous") - s[..., 0] ** 4 * p.effect("link") + p.effect("gravity")
    for j in range(problem.n):
        A[..., j, j] += own[..., j]
    return inverse(np.asarray(A))


def rigid_arm_compliance(problem: Problem, p: Parameters, s: Complexes) -> Complexes:
    """A⁻¹ without effects at s of shape (r, H)."""
    return ideal_compliance(problem.prior, problem.arm_inertia(p), problem.gravity(p), s)


def ideal_compliance(prior: InertiaPrior, M2: Floats, gravity: Floats, s: Complexes) -> Complexes:
    """The same without effects, of distinct M2 and gravity (p, n, n) at s of shape (r, H)."""
    squared = (s * s)[..., None, None]
    if not gravity.any():
        return np.asarray(inverse(M2)[prior.pose, None] / squared)
    return inverse(np.asarray(squared * M2[prior.pose, None] + gravity[prior.pose, None]))
