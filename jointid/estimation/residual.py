"""Residual torque of the model at the motors at every harmonic, its covariance and its Jacobian.

At harmonic h, s = ihω, the gears have the dynamic stiffness κ = K + sD and the arm A = s²M2 + G with
the known stiffness G of gravity, both with
the terms of ``effects``. The torque through the gears is X q with X = (κ⁻¹ + A⁻¹)⁻¹, and the residual
is r = c τ e^{-sδ} − F − (s²M + X) q, with friction F at the motors and the torque scale c. Without
effects s²M + X is the inverse of equation (16) times s². Nonlinear laws add w to the deflection of the
gears and friction P at the arm (``joint_laws``); the torque through the gears is then X (q − w +
A⁻¹P). Both τ and q carry noise of covariance C; r has the covariance V = E C Eᴴ with E = ∂r/∂[q; τ].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.estimation.inertia_prior import InertiaPrior
from jointid.estimation.joint_laws import JointLaws, SignSlope
from jointid.estimation.noise import Noise
from jointid.estimation.parameters import ARM_EFFECTS, GEAR_LAWS, LAWS, ParameterLayout, Parameters
from jointid.gears.harmonic_balance import WoundGears
from jointid.joints import motor_impedance
from jointid.motion.end_terms import EndTerms, motor_motion, row_groups, torque_images
from jointid.motion.free_friction import FreeFriction
from jointid.motion.friction import FrictionWaveforms
from jointid.phasors.extract import Phasors
from jointid.small_matrices import inverse, lifted

_STIFFEST = 100.0
"""Upper bound on K as a multiple of the start value; beyond it the iteration has diverged."""
_SHAPES = {"presliding": 0.03, "bristle": 0.03, "knee": 0.35, "second_knee": 0.35}
"""Presliding deflections and angles, and wind-ups at changes of slope: start values over the largest
deflection or angle."""
_SHARPEST, _SLOWEST = 1e-4, 2.0
"""Their range: beyond it a sharper hysteresis, or one that is a spring, looks the same."""
_LARGEST = 4.0
"""Upper bound on play and hysteresis over the largest linear wind-up and torque."""
_FLATTEST = 0.1
"""Least slope of a piecewise linear gear, over K."""
LOWEST_LINK = 4.0
"""Mode of a link over the joint's resonance, of the widest prior: a lower one is no term −s⁴c."""
_BENDS = {"piecewise": 0.73, "second_bend": 1.33}
"""Changes of slope in place of a cubic stiffness, over it times the largest deflection squared."""


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
    ends: EndTerms | None = None
    motion: Complexes | None = None  # (2, r, H, n), velocity and acceleration of motions
    images: Complexes | float = 0.0  # (r, H, 1), angle per torque over rotor inertia, s²
    law_noise: tuple[Complexes, Complexes, Floats] | None = None  # of ``WoundGears.noise``, (r, H, n)

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
        return (
            np.ones((len(self.s), self.n), bool) if self.friction is None else ~self.friction.stationary
        )

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

    def by_group(self, values: Floats) -> Floats:
        """Sums over the groups, shape (G,), of values (r, H)."""
        sums = np.bincount(self.group.ravel(), values.ravel(), self.main.size)
        return np.asarray(sums, float)

    def feasible(self, vector: Floats) -> bool:
        """Whether K, M and the torque scales are positive, and M2 and M2 − added positive definite."""
        p = self.layout.named(vector)
        positive = [p.K, *(p[name] for name in ("M", "torque_scale") if name in self.layout)]
        if any(np.any(values <= 0) for values in positive) or np.any(self.stiffest <= p.K):
            return False
        for name in _SHAPES:
            if name in self.layout and self.laws is not None:
                share = p[name] / self.laws.units(p)[name]
                if np.any((share < _SHARPEST) | (share > _SLOWEST)):
                    return False
        units = {} if self.laws is None else self.laws.units(p)
        bounded = [name for name in ("backlash", "hysteresis") if name in self.layout]
        if any(np.any(np.abs(p[name]) > _LARGEST * units[name]) for name in bounded):
            return False
        if "piecewise" in self.layout:
            least = np.minimum(p["piecewise"], p["piecewise"] + p["second_bend"])
            if np.any(p.K + least < _FLATTEST * p.K):
                return False
        if "M2" not in self.layout:
            return True
        matrices = self.prior.symmetric(p["M2"]), self.arm_inertia(p)
        return bool(np.all(np.linalg.eigvalsh(np.concatenate(matrices)) > 0))

    def start(self, values: Parameters) -> Floats:
        """Start vector, shape (P,): the given values, means of the prior, zero for the rest."""
        means = {name: mean for name, (mean, _) in self.prior.blocks().items()}
        shapes = {block.name: block.shape for block in self.layout.blocks}
        given = {block.name: values[block.name] for block in values.layout.blocks}
        same = {name: value for name, value in given.items() if shapes.get(name) == value.shape}
        for name, share in _SHAPES.items():
            if name in self.layout and self.laws is not None:
                means[name] = share * self.laws.units(values)[name]
        if "piecewise" in self.layout and self.laws is not None and "cubic" in given:
            rise = given["cubic"] * self.laws.units(values)["knee"] ** 2
            means |= {name: share * rise for name, share in _BENDS.items()}
        return self.layout.pack(**(means | same))

    def pull(self, vector: Floats) -> tuple[Floats, Floats]:
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
    stiffness: Floats,
    friction: FrictionWaveforms | None,
    noise: Noise,
) -> Problem:
    """Collect the data of a fit.

    Parameters
    ----------
    stiffness : ndarray, shape (n,)
        Start value of K.

    Raises
    ------
    JointIdError
        When the start has a negative stiffness.
    """
    if np.any(stiffness <= 0):
        raise JointIdError(
            f"K{int(np.argmin(stiffness)) + 1} comes out negative by least squares: check the sign and "
            "unit of the torque, the gear ratios, and the inertias M and M2."
        )
    n, z = prior.n, phasors.harmonics
    s = np.asarray(1j * phasors.omega[:, None] * np.arange(1, z.shape[1] + 1))
    laws, motion = None, None
    if any(name in layout for name in LAWS):
        motion = motor_motion(phasors)
        rotor = prior.M[prior.rotor, None]
        inertial = (s * s)[..., None] * rotor
        variance = np.einsum("rhjj->rhj", noise.covariance).real.copy()
        variance[..., n:] += np.abs(inertial) ** 2 * variance[..., :n]
        torque, angle = inertial * z[..., :n], z[..., :n]
        main = np.zeros(z.shape[:2], bool)
        main[:, 0] = True
        if motion is not None:
            moves = phasors.motion[:, None, None]
            torque = np.where(moves, motion[1] * rotor, torque)
            angle = np.where(moves, motion[1] / (s * s)[..., None], angle)
            main = np.where(moves[..., 0], np.any(motion[1] != 0, axis=2), main)
        arm = inverse(prior.M2)[prior.pose]
        laws = JointLaws.of(s, angle, z[..., n:] - torque, variance, arm, prior.M[prior.rotor], main)
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
        images=torque_images(phasors),
        prior=prior,
        friction=friction,
        layout=layout,
        laws=laws,
        stiffest=_STIFFEST * stiffness,
        link_std=prior.link_std(stiffness, LOWEST_LINK),
    )


@dataclass(frozen=True, eq=False)
class Residual:
    """Residual torque at one set of parameters."""

    problem: Problem
    p: Parameters
    r: Complexes
    """Residual, shape (r, H, n), N·m."""
    V: Complexes
    """Its covariance, shape (r, H, n, n)."""
    E: Complexes
    """∂r/∂z, shape (r, H, n, 2n)."""
    CE: Complexes
    """Covariance of the signals z with it, C Eᴴ, shape (r, H, 2n, n)."""
    gear: Complexes
    """κ, shape (r, H, n), N·m/rad."""
    arm: Complexes
    """A⁻¹, shape (r, H, n, n), rad/(N·m)."""
    X: Complexes
    """Torque through the gears over motor angle, shape (r, H, n, n), N·m/rad."""
    lag: Complexes
    """e^{-sδ} of each joint, shape (r, H, n)."""
    advance: Complexes
    """Position over logged position, shape (r, H, n)."""
    torque: Complexes
    """Torque through the gears by the balance at the motors, shape (r, H, n), N·m."""
    waveform: Complexes
    """The same for the nonlinear laws: of motions, without the terms of the ends."""
    law: tuple[Complexes, Complexes]
    """Deflection w and arm friction P of nonlinear laws, each shape (r, H, n)."""
    wound: WoundGears | None
    """Wind-up of nonlinear gears."""

    @classmethod
    def at(cls, problem: Problem, vector: Floats) -> Residual:
        """Evaluate the residual at a parameter vector, shape (P,)."""
        n, p = problem.n, problem.layout.named(vector)
        s = problem.s[..., None]
        gear = p.K * (1 + p.effect("loss_factor") * _loss(problem)) + s * p.D
        arm = _arm_compliance(problem, p)
        compliance = arm.copy()
        for j in range(n):
            compliance[..., j, j] += 1 / gear[..., j]
        X = inverse(compliance)
        lag = np.exp(-s * (p.delay + p.effect("lag")) * np.ones(n)) * _filtered(s, p)
        advance = np.asarray(1 + s * p.effect("position_filter") * np.ones(n))
        own = motor_stiffness(problem, p)
        E = _balance(own, lag * p.torque_scale)
        if problem.law_noise is not None:
            by_torque, by_moved, _ = problem.law_noise
            E += X @ (by_torque[..., None] * E + by_moved[..., None] * _moved(E, arm))
        E[..., :n] = (E[..., :n] - X) * advance[..., None, :]
        CE = problem.noise.covariance @ E.conj().swapaxes(2, 3)
        q = (problem.z[..., :n] - _images(problem, p)) * advance
        torque = lag * p.torque_scale * problem.z[..., n:] - own * q
        if problem.friction is not None:
            torque -= sliding_friction(problem.friction, p, s.shape[1])
        if "motor_presliding" in problem.layout and problem.laws is not None:
            torque -= p["motor_presliding"] * problem.laws.presliding(p["bristle"], s.shape[1])
        waveform, law, wound = torque, (np.zeros_like(q), np.zeros_like(q)), None
        if problem.laws is not None:
            waveform, angle = _without_ends(problem, p, torque, q, own)
            if "arm_coulomb" in problem.layout:
                law = law[0], p.effect("arm_coulomb") * problem.laws.arm_friction(waveform, arm)
            moved = angle - (arm @ (waveform - law[1])[..., None])[..., 0]
            wound = problem.laws.wound(waveform, moved, gear, p)
            if wound is not None:
                law = np.asarray(wound.law.swapaxes(1, 2)), law[1]
        r = torque - _through(X, arm, q, law)
        V = lifted(E @ CE, E, problem.noise.covariance)
        if problem.law_noise is not None:
            V += (X * problem.law_noise[2][..., None, :]) @ X.conj().swapaxes(2, 3)
        return cls(problem, p, r, V, E, CE, gear, arm, X, lag, advance, torque, waveform, law, wound)

    def without_ends(self) -> tuple[Complexes, Complexes]:
        """Torque through the gears and motor angles, those of motions without the terms of the ends."""
        problem = self.problem
        q = (problem.z[..., : problem.n] - _images(problem, self.p)) * self.advance
        return _without_ends(problem, self.p, self.torque, q, motor_stiffness(problem, self.p))

    def ideal_torque(self) -> Complexes:
        """Torque of equation (1) at the fitted motor angle, shape (r, h, n), N·m.

        Of the fundamental alone, h = 1, or with segments of motions of all bins.
        """
        problem, p, s = self.problem, self.p, self.problem.s[:, : self.fundamentals]
        arm = s[..., None, None] ** 2 * _without_effects(problem, p, s)
        rotor = problem.rotor_inertia(p)[problem.prior.rotor, None]
        Z, _ = motor_impedance(s, rotor, arm, p.K, p.D)
        return np.asarray((Z @ self.position[..., None])[..., 0])

    @property
    def fundamentals(self) -> int:
        """Number of harmonics that are fundamentals, or bins of a motion."""
        return 1 if self.problem.ends is None else self.problem.s.shape[1]

    @property
    def position(self) -> Complexes:
        """Motor angle, freed of a filter, shape (r, h, n) like the ideal torque, rad."""
        angle = self.problem.z[..., : self.problem.n] - _images(self.problem, self.p)
        return np.asarray((angle * self.advance)[:, : self.fundamentals])

    def jacobian(self, smooth: Complexes) -> Complexes:
        """∂r/∂p at other signals than those measured, shape (r, H, n, P).

        With the gear torque f, the arm angle A⁻¹f and the deflection κ⁻¹f, ∂f = Xκ⁻¹ ∂κ κ⁻¹f +
        XA⁻¹ ∂A A⁻¹f, and XA⁻¹ + Xκ⁻¹ = I.

        Parameters
        ----------
        smooth : ndarray, shape (r, H, 2n)
            Signals without noise.
        """
        problem, p, n, layout = self.problem, self.p, self.problem.n, self.problem.layout
        s = problem.s[..., None]
        q = (smooth[..., :n] - _images(problem, p)) * self.advance
        f = _through(self.X, self.arm, q, self.law)
        J = np.zeros((*self.r.shape, layout.size), complex)
        by_gear = -self.X / self.gear[..., None, :] * (f / self.gear)[..., None, :]  # ∂r/∂κ_j
        stiffness = {"K": 1 + p.effect("loss_factor") * _loss(problem), "D": s}
        if "loss_factor" in layout:
            stiffness["loss_factor"] = p.K * _loss(problem)
        stiffness = {name: value * np.ones(n) for name, value in stiffness.items()}
        for name, value in stiffness.items():
            J[..., layout[name]] = by_gear * value[..., None, :]
        turns = None
        if "arm_coulomb" in layout and problem.laws is not None:
            signs = problem.laws.arm_friction(self.waveform, self.arm)
            J[..., layout["arm_coulomb"]] = -(self.X @ self.arm) * signs[..., None, :]
            turns = problem.laws.arm_friction_slope(self.waveform, self.arm)
        self._differentiate_arm(J, f - self.law[1], turns)
        if "position_filter" in layout:
            J[..., layout["position_filter"]] = -self.X * (s * smooth[..., :n])[..., None, :]
        own = self._own_columns(smooth)
        slopes = {}
        if problem.laws is not None:
            sines = own if problem.motion is None else {}  # a small effect of a small effect
            slopes = problem.laws.slopes(self.wound, p, stiffness, sines)
        for name, columns in own.items():
            through = self.X * slopes[name][..., None, :] if name in slopes else 0
            whole = columns[..., None, :] * np.eye(n) + through
            if turns is not None:
                whole += self._by_turns(turns, self.arm * self._clear(columns)[..., None, :])
            block, _, part = name.partition(" ")
            place = np.arange(layout.size)[layout[block]]
            if block == "curve":
                J[..., place.reshape(n, -1)[:, int(part)]] += whole
            elif block == "M":
                for m, row in enumerate(place.reshape(-1, n)):
                    uses = problem.prior.rotor == m
                    J[uses, :, :, row[0] : row[-1] + 1] += whole[uses]
            elif block == "delay":
                J[..., place[0]] += whole.sum(axis=-1)
            else:
                J[..., place] += whole
        for name in slopes.keys() - own.keys():
            J[..., layout[name]] += self.X * slopes[name][..., None, :]
        return J

    def _clear(self, torque: Complexes) -> Complexes:
        """Harmonics of a torque, shape (r, H, n), that decide when the arm turns back."""
        laws = self.problem.laws
        return torque if laws is None else np.where(laws.clear, torque, 0)

    def _by_turns(self, turns: SignSlope, angle: Complexes) -> Complexes:
        """Change of r by Coulomb friction at the arm for changes of its angle, both (r, H, n, c).

        They move the instants at which the arm turns back.
        """
        change = turns.of(self.problem.s[..., None, None] * angle)
        force = self.p["arm_coulomb"][:, None] * change
        return np.asarray(-(self.X @ self.arm) @ force)

    def _own_columns(self, smooth: Complexes) -> dict[str, Complexes]:
        """Derivatives of the torque through a gear by its own motor's parameters, each (r, H, n)."""
        problem, p, n, layout = self.problem, self.p, self.problem.n, self.problem.layout
        s = problem.s[..., None]
        q = (smooth[..., :n] - _images(problem, p)) * self.advance
        tau = smooth[..., n:] * self.lag
        lag = -s * tau * p.torque_scale
        columns = {
            "viscous": -s * q,
            "delay": lag,
            "lag": lag,
            "torque_filter": lag / (1 + s * np.abs(p.effect("torque_filter"))),
            "torque_scale": tau,
            "position_filter": -motor_stiffness(problem, p) * s * smooth[..., :n],
            "M": -s * s * q,
        }
        if problem.friction is not None:
            columns["coulomb"] = -problem.friction.coulomb
            for c in range(problem.friction.curve.shape[3]):
                columns[f"curve {c}"] = -problem.friction.curve[..., c]
        if "motor_presliding" in layout and problem.laws is not None:
            shape = problem.laws.presliding(p["bristle"], s.shape[1])
            slope = problem.laws.presliding_slope(p["bristle"], shape)
            columns["motor_presliding"], columns["bristle"] = -shape, -p["motor_presliding"] * slope
        return {name: value for name, value in columns.items() if name.partition(" ")[0] in layout}

    def _differentiate_arm(self, J: Complexes, f: Complexes, turns: SignSlope | None) -> None:
        """Fill the columns of M2 and of the effects on the arm's dynamic stiffness.

        ``f`` is the torque that moves the arm.
        """
        problem, layout, s = self.problem, self.problem.layout, self.problem.s
        if not any(name in layout for name in (*ARM_EFFECTS, "M2")):
            return
        share = -self.X @ self.arm  # −XA⁻¹
        angle = (self.arm @ f[..., None])[..., 0]
        by_arm = share * angle[..., None, :]  # ∂r/∂A_jj
        moved = (self.arm @ self._clear(self.torque)[..., None])[..., 0]
        factors = {"arm_viscous": s, "link": -(s**4), "gravity": np.ones_like(s)}
        for name, factor in factors.items():
            if name in layout:
                J[..., layout[name]] = by_arm * factor[..., None, None]
                if turns is not None:
                    turned = -self.arm * (moved * factor[..., None])[..., None, :]
                    J[..., layout[name]] += self._by_turns(turns, turned)
        if "M2" in layout:
            square, of_elements = (s * s)[..., None], problem.prior.by_elements
            by_element = of_elements(share, angle * square)
            if turns is not None:
                turned = -of_elements(self.arm, moved * square)
                by_element += self._by_turns(turns, turned)
            for part in range(len(problem.prior.rest)):
                size = by_element.shape[-1]
                first = layout["M2"].start + part * size
                uses = problem.prior.part[problem.prior.pose] == part
                J[uses, :, :, first : first + size] = by_element[uses]
            if problem.prior.shared_gravity.any():
                J[..., layout["M2"]] += self._by_common_gravity(share, angle, moved, turns)

    def _by_common_gravity(
        self, share: Complexes, angle: Complexes, moved: Complexes, turns: SignSlope | None
    ) -> Complexes:
        """Change of r by the gravity that follows the common unknown in M2, shape (r, H, n, u t)."""
        prior = self.problem.prior
        change = prior.shared_gravity[prior.pose, None]
        by_unknown = share @ (change @ angle[..., None])
        if turns is not None:
            by_unknown = by_unknown + self._by_turns(turns, -self.arm @ (change @ moved[..., None]))
        return np.asarray(by_unknown * prior.by_lower)


def with_law_noise(problem: Problem, vector: Floats) -> Problem:
    """The problem with the noise that nonlinear gears make of the torques' at these parameters.

    It stays fixed in a fit: without its derivative a step would lower the cost by raising the noise.
    """
    if problem.motion is not None or not any(name in problem.layout for name in GEAR_LAWS):
        return problem
    at = Residual.at(replace(problem, law_noise=None), vector)
    if at.wound is None or problem.laws is None or not np.isfinite(at.wound.delta).all():
        return problem
    balance = _balance(motor_stiffness(problem, at.p), at.lag * at.p.torque_scale)
    parts = balance, _moved(balance, at.arm)
    variances = (((E @ problem.noise.covariance) * E.conj()).sum(axis=3).real for E in parts)
    return replace(problem, law_noise=problem.laws.noise(at.wound, at.p, *variances))


def _balance(own: Complexes, gain: Complexes) -> Complexes:
    """Torque through the gears by angles and torques of the motors, shape (r, H, n, 2n)."""
    eye = np.eye(own.shape[2])
    return np.concatenate([-own[..., None] * eye, gain[..., None] * eye], axis=3)


def _moved(balance: Complexes, arm: Complexes) -> Complexes:
    """Deflection of the gears by angles and torques of the motors, shape (r, H, n, 2n)."""
    moved = -arm @ balance
    for j in range(arm.shape[2]):
        moved[..., j, j] += 1
    return np.asarray(moved)


def _images(problem: Problem, p: Parameters) -> Complexes | float:
    """Angle of the motors by the images of the held torque, shape (r, H, n), rad."""
    if problem.ends is None:
        return 0.0
    torque = problem.z[..., problem.n :] * p.torque_scale
    return np.asarray(problem.images * torque / problem.rotor_inertia(p)[problem.prior.rotor, None])


def _loss(problem: Problem) -> Complexes:
    """Dynamic stiffness over K of a loss factor of 1, shape (r, H, 1).

    A loss that does not depend on frequency comes with a stiffness that rises with its logarithm, or
    it would act before its cause (Kjartansson, Journal of Geophysical Research 84, 1979). K is the
    stiffness at the mean frequency of the records, on a logarithmic scale.
    """
    s = problem.s
    reference = np.exp(np.log(np.abs(s[problem.known & problem.main[problem.group]])).mean())
    return np.asarray(1j + 2 / np.pi * np.log(np.abs(s) / reference))[..., None]


def _without_ends(
    problem: Problem, p: Parameters, torque: Complexes, q: Complexes, own: Complexes
) -> tuple[Complexes, Complexes]:
    """Torque through the gears and motor angles; of motions, from the motors' acceleration itself."""
    if problem.motion is None:
        return torque, q
    velocity, acceleration = problem.motion
    inertial = acceleration * problem.rotor_inertia(p)[problem.prior.rotor, None]
    viscous = 0.0 if problem.friction is None else p.viscous * velocity
    moved = np.any(velocity != 0, axis=(1, 2))[:, None, None]
    return (
        np.where(moved, torque + own * q - inertial - viscous, torque),
        np.where(moved, acceleration / problem.s[..., None] ** 2, q),
    )


def _filtered(s: Complexes, p: Parameters) -> Complexes | float:
    """Factor of a torque filter, 1/(1 + sT), or 1 − sT where T is negative."""
    T = p.effect("torque_filter")
    return np.where(np.asarray(T) < 0, 1 - s * T, 1 / (1 + s * np.abs(T)))


def _through(X: Complexes, arm: Complexes, q: Complexes, law: tuple[Complexes, Complexes]) -> Complexes:
    """Torque through the gears, X (q − w + A⁻¹P), shape (r, H, n)."""
    w, P = law
    return np.asarray((X @ (q - w + (arm @ P[..., None])[..., 0])[..., None])[..., 0])


def motor_stiffness(problem: Problem, p: Parameters) -> Complexes:
    """s²M with viscous friction, shape (r, H, n), N·m/rad."""
    s = problem.s[..., None]
    inertial = s * s * problem.rotor_inertia(p)[problem.prior.rotor, None]
    return np.asarray(inertial if problem.friction is None else inertial + s * p.viscous)


def _arm_compliance(problem: Problem, p: Parameters) -> Complexes:
    """A⁻¹, shape (r, H, n, n); a copy that may be changed."""
    if not any(name in problem.layout for name in ARM_EFFECTS):
        return _without_effects(problem, p, problem.s)
    s, pose = problem.s[..., None, None], problem.prior.pose
    A = s * s * problem.arm_inertia(p)[pose, None] + problem.gravity(p)[pose, None]
    own = s[..., 0] * p.effect("arm_viscous") - s[..., 0] ** 4 * p.effect("link") + p.effect("gravity")
    for j in range(problem.n):
        A[..., j, j] += own[..., j]
    return inverse(np.asarray(A))


def _without_effects(problem: Problem, p: Parameters, s: Complexes) -> Complexes:
    return ideal_compliance(problem.prior, problem.arm_inertia(p), problem.gravity(p), s)


def ideal_compliance(prior: InertiaPrior, M2: Floats, gravity: Floats, s: Complexes) -> Complexes:
    """The same without effects, of distinct M2 and gravity (p, n, n) at s of shape (r, H)."""
    squared = (s * s)[..., None, None]
    if not gravity.any():
        return np.asarray(inverse(M2)[prior.pose, None] / squared)
    return inverse(np.asarray(squared * M2[prior.pose, None] + gravity[prior.pose, None]))


def sliding_friction(friction: FrictionWaveforms, p: Parameters, h: int) -> Complexes:
    """Coulomb friction and its curve at the first h harmonics, shape (r, h, n), N·m."""
    curve = (friction.curve[:, :h] * p.curve).sum(axis=3)
    return np.asarray(p.coulomb * friction.coulomb[:, :h] + curve)
