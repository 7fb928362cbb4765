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

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.fitted_gears import gear_slopes
from jointid.estimation.estimators.joint_equations import balance, gear_torque
from jointid.estimation.estimators.parameters import ARM_EFFECTS, Parameters
from jointid.estimation.estimators.problem import (
    Problem,
    arm_compliance,
    free_deflection,
    friction_advance,
    motor_friction,
    motor_stiffness,
    rigid_arm_compliance,
)
from jointid.gears.arm_friction import ArmFriction
from jointid.gears.wound import Wound
from jointid.joints import motor_impedance
from jointid.small_matrices import inverse, lifted

_By = dict[str, Complexes]
"""Derivatives by the names of parameters."""


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
    gear_slopes: _By
    """Its derivatives by the parameters in it, each shape (r, H, n)."""
    arm: Complexes
    """A⁻¹, shape (r, H, n, n), rad/(N·m)."""
    X: Complexes
    """Torque through the gears over motor angle, shape (r, H, n, n), N·m/rad."""
    lag: Complexes
    """e^{-sδ} of each joint, shape (r, H, n)."""
    advance: Complexes
    """Position over logged position, shape (r, H, n)."""
    images: Complexes
    """Angle of the motors by the images of a held torque, shape (r, H, n), rad."""
    friction: Complexes
    """Friction at the motors without its free part, shape (r, H, n), N·m."""
    torque: Complexes
    """Torque through the gears by the balance at the motors, shape (r, H, n), N·m."""
    law: tuple[Complexes, Complexes]
    """Deflection w and arm friction P of nonlinear laws, each shape (r, H, n)."""
    wound: Wound | None
    """Deflection of nonlinear gears."""
    turns: ArmFriction | None
    """Coulomb friction at the arm."""

    @classmethod
    def at(cls, problem: Problem, vector: Floats) -> Residual:
        """Evaluate the residual at a parameter vector, shape (P,)."""
        n, p = problem.n, problem.layout.named(vector)
        s = problem.s[..., None]
        slopes = gear_slopes(problem, p)
        gear = np.asarray(p.K * slopes["K"] + p.D * slopes["D"])
        arm = arm_compliance(problem, p)
        compliance = arm.copy()
        for j in range(n):
            compliance[..., j, j] += 1 / gear[..., j]
        X = inverse(compliance)
        lag = np.exp(-s * (p.delay + p.effect("lag")) * np.ones(n)) * problem.held.filter_gain(p, s)
        advance = np.asarray(1 + s * p.effect("position_filter") * np.ones(n))
        own = motor_stiffness(problem, p)
        E = balance(own, lag * p.torque_scale)
        if problem.law_noise is not None and problem.laws is not None:
            by_deflection, _ = problem.law_noise
            E += X @ (by_deflection[..., None] * problem.laws.by_signals(E, arm, gear))
        E[..., :n] = (E[..., :n] - X) * advance[..., None, :]
        CE = problem.noise.covariance @ E.conj().swapaxes(2, 3)
        drive = lag * p.torque_scale * problem.z[..., n:]
        rotor = problem.rotor_inertia(p)[problem.prior.rotor]
        rigid = inverse(problem.arm_inertia(p))[problem.prior.pose]
        images = problem.held.images(p, s, rotor, rigid) * drive
        q = (problem.z[..., :n] - images) * advance
        torque = drive - own * q
        friction = motor_friction(problem, p)
        torque -= friction
        q = q - free_deflection(problem, p)  # from here on that of the gear
        law, wound, turns = (np.zeros_like(q), np.zeros_like(q)), None, None
        if problem.laws is not None:
            through = torque - problem.free_torque
            if "arm_coulomb" in problem.layout:
                turns = problem.laws.arm_friction(p["arm_coulomb"], through, arm)
                law = law[0], turns.level * turns.sign
            apart = q - (arm @ (through - law[1])[..., None])[..., 0]
            both = problem.arm_inertia(p), problem.gravity(p)
            wound = problem.laws.wound(through, apart, gear, p, both, problem.rotor_inertia(p)[0])
            if wound is not None:
                law = problem.laws.law(wound, gear), law[1]
        r = torque - gear_torque(X, arm, q, law)
        V = lifted(E @ CE, E, problem.noise.covariance)
        if problem.law_noise is not None:
            V += (X * problem.law_noise[1][..., None, :]) @ X.conj().swapaxes(2, 3)
        return cls(
            problem, p, r, V, E, CE, gear, slopes, arm, X, lag, advance, images, friction, torque, law,
            wound, turns,
        )  # fmt: skip

    def without_ends(self) -> tuple[Complexes, Complexes]:
        """Torque through the gears and motor angles, those of motions without the terms of the ends."""
        problem, p, q = self.problem, self.p, self._before_filter(self.problem.z)
        if problem.motion is None:
            return self.torque, q
        velocity, acceleration = problem.motion
        inertial = acceleration * problem.rotor_inertia(p)[problem.prior.rotor, None]
        viscous = p.effect("viscous") * velocity
        moved = np.any(velocity != 0, axis=(1, 2))[:, None, None]
        torque = self.torque + motor_stiffness(problem, p) * q - inertial - viscous
        angle = np.where(moved, acceleration / problem.s[..., None] ** 2, q)
        return np.where(moved, torque, self.torque), angle

    def ideal_torque(self) -> Complexes:
        """Torque of equation (1) at the fitted motor angle, shape (r, h, n), N·m.

        Of the fundamental alone, h = 1, or with segments of motions of all bins.
        """
        problem, p, s = self.problem, self.p, self.problem.s[:, : self.fundamentals]
        arm = s[..., None, None] ** 2 * rigid_arm_compliance(problem, p, s)
        rotor = problem.rotor_inertia(p)[problem.prior.rotor, None]
        Z, _ = motor_impedance(s, rotor, arm, p.K, p.D)
        return np.asarray((Z @ self.position[..., None])[..., 0])

    @property
    def fundamentals(self) -> int:
        """Number of harmonics that are fundamentals, or bins of a motion."""
        return 1 if self.problem.ends is None else self.problem.s.shape[1]

    @property
    def position(self) -> Complexes:
        """Motor angle without its filter, shape (r, h, n) like the ideal torque, rad."""
        return self._before_filter(self.problem.z)[:, : self.fundamentals]

    def _before_filter(self, signals: Complexes) -> Complexes:
        """Motor angle in signals (r, H, 2n), without images and its filter, shape (r, H, n), rad."""
        return np.asarray((signals[..., : self.problem.n] - self.images) * self.advance)

    def by_position_filter(self, friction: Complexes) -> Complexes:
        """Change of a friction torque (r, H, n) with the time constants of the position filter."""
        problem, T = self.problem, self.p.effect("position_filter")
        first = np.abs(problem.s[:, :1, None])
        return np.asarray(problem.s[..., None] / (1 + (first * T) ** 2) * friction)

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
        q = self._before_filter(smooth) - free_deflection(problem, p)
        f = gear_torque(self.X, self.arm, q, self.law)
        J = np.zeros((*self.r.shape, layout.size), complex)
        by_gear = -self.X / self.gear[..., None, :] * (f / self.gear)[..., None, :]  # ∂r/∂κ_j
        for name, value in self.gear_slopes.items():
            J[..., layout[name]] = by_gear * value[..., None, :]
        turns, share = self.turns, np.asarray(self.X @ self.arm)
        if turns is not None:
            force = turns.settled(turns.sign[..., None] * np.eye(n))
            J[..., layout["arm_coulomb"]] = -share @ force
        if "position_filter" in layout:
            J[..., layout["position_filter"]] = -self.X * (s * smooth[..., :n])[..., None, :]
        own, turned = self._own_columns(smooth), _By()
        if turns is not None:
            for name, columns in own.items():
                turned[name] = self._turned(turns, self.arm * self._clear(columns)[..., None, :])
        slopes = self._by_laws(smooth, own, turned)
        for name, columns in self._by_arm(share, f - self.law[1]).items():
            J[..., layout[name]] = -columns
        for name, columns in own.items():
            through = self.X @ slopes[name] if name in slopes else 0
            whole = columns[..., None, :] * np.eye(n) + through
            if name in turned:
                whole -= share @ turned[name]
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
        for name, wave in self._deflections().items():
            J[..., layout[name]] += self.X * wave[..., None, :]
        for name in slopes.keys() - own.keys():
            J[..., layout[name]] += self.X @ slopes[name]
        return J

    def by_gravity(self, smooth: Complexes) -> Complexes:
        """∂r by the lower elements of the gravity stiffness of each pose, shape (r, H, n, e)."""
        q = self._before_filter(smooth) - free_deflection(self.problem, self.p)
        through = gear_torque(self.X, self.arm, q, self.law) - self.law[1]
        angle = (self.arm @ through[..., None])[..., 0]
        return -self.problem.prior.by_elements(np.asarray(self.X @ self.arm), angle)

    def _by_laws(self, smooth: Complexes, own: _By, turned: _By) -> _By:
        """Derivatives of w by the parameters, each (r, H, n, c).

        ``own`` torques of the motors change the friction of the arms by ``turned``.
        """
        laws, problem, p = self.problem.laws, self.problem, self.p
        if laws is None or self.wound is None:
            return {}
        torque = self.lag * p.torque_scale * smooth[..., problem.n :] - self.friction - self.law[1]
        torque -= motor_stiffness(problem, p) * self._before_filter(smooth) + problem.free_torque
        apart = self._by_arm(self.arm, torque)
        for name, columns in own.items():
            apart[name] = -self.arm * columns[..., None, :]
            if name in turned:
                apart[name] += self.arm @ turned[name]
        for name, wave in self._deflections().items():
            apart[name] = -wave[..., None] * np.eye(problem.n)
        if "position_filter" in own:
            moved = problem.s[..., None] * smooth[..., : problem.n]
            apart["position_filter"] += moved[..., None] * np.eye(problem.n)
        arm = problem.prior.by_lower_element if "M2" in problem.layout else None
        return laws.slopes(self.wound, self.p, self.gear, self.gear_slopes, own, apart, arm)

    def _deflections(self) -> _By:
        """Deflection of the gears without torque per unit of its parameters, each (r, H, n)."""
        waves = {} if self.problem.friction is None else self.problem.friction.deflection
        return {name: wave for name, wave in waves.items() if name in self.problem.layout}

    def _clear(self, torque: Complexes) -> Complexes:
        """Harmonics of a torque, shape (r, H, n), that decide when the arm turns back."""
        laws = self.problem.laws
        return torque if laws is None else np.where(laws.clear, torque, 0)

    def _turned(self, turns: ArmFriction, angle: Complexes) -> Complexes:
        """Change of Coulomb friction at the arm for changes of its angle, both (r, H, n, c).

        They move the instants at which the arm turns back.
        """
        return turns.by_motion(self.problem.s[..., None, None] * angle)

    def _own_columns(self, smooth: Complexes) -> _By:
        """Derivatives of the torque through a gear by its own motor's parameters, each (r, H, n)."""
        problem, p, n, layout = self.problem, self.p, self.problem.n, self.problem.layout
        s = problem.s[..., None]
        q = self._before_filter(smooth)
        tau = smooth[..., n:] * self.lag
        lag = -s * tau * p.torque_scale
        columns = {
            "viscous": -s * q,
            "delay": lag,
            "lag": lag,
            "torque_scale": tau,
            "position_filter": -motor_stiffness(problem, p) * s * smooth[..., :n]
            - self.by_position_filter(self.friction),
            "M": -s * s * q,
        }
        if "torque_filter" in layout:
            rate = problem.held.filter_rate(p, s)
            columns["torque_filter"] = rate / s * lag / (1 + rate * np.abs(p["torque_filter"]))
        earlier = friction_advance(problem, p)
        if problem.friction is not None:
            own = problem.friction.by_parameter
            columns |= {name: -wave * earlier for name, wave in own.items()}
        if "motor_presliding" in layout and problem.laws is not None:
            shape = problem.laws.presliding(p["bristle"], s.shape[1])
            slope = problem.laws.presliding_slope(p["bristle"], shape)
            columns["motor_presliding"] = -shape * earlier
            columns["bristle"] = -p["motor_presliding"] * slope * earlier
        return {name: value for name, value in columns.items() if name.partition(" ")[0] in layout}

    def _by_arm(self, left: Complexes, f: Complexes) -> _By:
        """Changes of left A⁻¹(f − P) by the parameters of the arm, with a negative sign, (r, H, n, c).

        ``left`` has the shape (r, H, n, n), ``f`` is the torque f − P that moves the arm.
        """
        problem, layout, found = self.problem, self.problem.layout, _By()
        if not any(name in layout for name in (*ARM_EFFECTS, "M2")):
            return found
        s, of_elements = problem.s[..., None], problem.prior.by_elements
        angle = (self.arm @ f[..., None])[..., 0]
        moved = (self.arm @ (self._clear(self.torque) - self.law[1])[..., None])[..., 0]

        def turned(change: Complexes) -> Complexes | float:
            return 0.0 if self.turns is None else left @ self._turned(self.turns, -change)

        for name, factor in {"arm_viscous": s, "link": -(s**4), "gravity": np.ones_like(s)}.items():
            if name in layout:
                found[name] = left * (angle * factor)[..., None, :]
                found[name] += turned(self.arm * (moved * factor)[..., None, :])
        if "M2" not in layout:
            return found
        by_element = of_elements(left, angle * s * s) + turned(of_elements(self.arm, moved * s * s))
        found["M2"] = np.zeros((*angle.shape, problem.prior.lower.size), complex)
        size = by_element.shape[3]
        for part in range(len(problem.prior.rest)):
            uses = problem.prior.part[problem.prior.pose] == part
            found["M2"][uses, :, :, part * size : (part + 1) * size] = by_element[uses]
        if problem.prior.shared_gravity.any():
            change = problem.prior.shared_gravity[problem.prior.pose, None]
            by_unknown = left @ (change @ angle[..., None])
            by_unknown += turned(self.arm @ (change @ moved[..., None]))
            found["M2"] += by_unknown * problem.prior.by_lower
        return found
