"""The planar elastic arm: one as pymunk bodies, and many of them vectorised over runs.

Chipmunk updates the positions first, x += v dt, and then the velocities, v += a dt: a velocity belongs
to half a step before the position that it is stored with (leapfrog scheme). For second order, torques
must be those in the middle of the velocity's step. Before each step the angles are therefore
predicted, φ⁺ = φ + v dt (exactly those after the step), the rates extrapolated to the same instant,
v⁺ = 1.5 v − 0.5 v_before, and the joint torques K Δφ⁺ + D Δv⁺ are applied.

``ManyArms`` has the same equations and scheme, with the mass matrix in place of pymunk's pivots: the two
agree within nanometres at the tool.
"""

import numpy as np
import pymunk
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array
from jointid.cut.arm import PlanarArm, require_two_joints
from jointid.cut.servo import MotorFrictionLike, friction_values
from jointid.errors import JointIdError
from jointid.gears.laws import GearLaws, GearState
from jointid.joints import Elasticity

_set_torque = vars(pymunk.Body)["torque"].fset
"""``body.torque = ...`` checks the name of the attribute: a tenth of the time of a cut."""
LONGEST_STEP_S = 1e-3
"""Longest step: the error grows with the square of the step, up to instability."""


class ArmSimulation:
    """Two links on pivots and two rotors on springs, at rest without deflection, stepped by pymunk.

    Of the true K and D, motor side, in steps of ``dt``, s, from the joint angles at time 0, shape (2,),
    rad. ``friction`` as in :func:`~jointid.cut.tracking.track`: Coulomb friction with sticking, as a
    pymunk motor of rate zero and limited torque. ``gears`` are laws in addition to K and D, joint side.
    Raises JointIdError when the step is above 1 ms or too long for the highest resonance, or a value
    does not fit.
    """

    log: list[tuple[float, float, float, float]]
    """``angles`` at the start of each step."""

    def __init__(
        self,
        arm: PlanarArm,
        elasticity: Elasticity,
        dt: float,
        joint_angle_rad: ArrayLike,
        friction: MotorFrictionLike | None = None,
        gears: GearLaws | None = None,
    ) -> None:
        q = finite_array("joint_angle_rad", joint_angle_rad, ndim=1)
        require_step(dt)
        require_two_joints(elasticity)
        require_resolved(arm, elasticity.K, elasticity.D, dt, q)
        n2 = arm.gear_ratio**2
        coulomb, viscous = friction_values(friction)
        self._dt = float(dt)
        self._serial = arm.drive == "serial"
        self._gears = None if gears is None else GearState(gears, np.zeros(2))
        self._K1, self._K2 = (n2 * elasticity.K).tolist()
        self._D1, self._D2 = (n2 * elasticity.D).tolist()
        self._F1, self._F2 = (n2 * viscous).tolist()
        self._space = pymunk.Space()
        self._space.iterations = _ITERATIONS
        self._links = _build_links(self._space, arm, arm.link_angles(q))
        self._rotors = _build_rotors(
            self._space, arm.rotor_inertia_arm_kgm2, np.abs(arm.gear_ratio) * coulomb, q
        )
        self._link1, self._link2 = arm.link_angles(q).tolist()
        self._motor1, self._motor2 = q.tolist()
        self._motor1_rate = self._motor2_rate = self._link1_rate = self._link2_rate = 0.0
        self._before = (0.0, 0.0, 0.0, 0.0)
        self.log = []

    def step(self, torque: Floats) -> None:
        """Advance by one step under motor torques reflected to the joint side, shape (2, 1), N·m.

        The torque acts from half a step before to half a step after the present instant: if a held
        torque changes at this instant, give the mean of old and new.
        """
        self.log.append(self.angles)
        (torque1,), (torque2,) = torque.tolist()
        dt, motor1, motor2 = self._dt, self._motor1, self._motor2
        link1, link2 = self._links
        rotor1, rotor2 = self._rotors
        rate1, rate2 = self._link1_rate, self._link2_rate
        motor1_rate, motor2_rate = self._motor1_rate, self._motor2_rate
        joint2, joint2_rate = self._link2, rate2
        if self._serial:
            joint2, joint2_rate = joint2 - self._link1, joint2_rate - rate1
        s1 = self._K1 * (motor1 - self._link1) + self._D1 * (motor1_rate - rate1)
        s2 = self._K2 * (motor2 - joint2) + self._D2 * (motor2_rate - joint2_rate)
        if self._gears is not None:
            more = self._gears.torque(np.array([[motor1 - self._link1], [motor2 - joint2]]))
            s1, s2 = s1 + float(more[0, 0]), s2 + float(more[1, 0])
        _set_torque(link1, s1 - s2 if self._serial else s1)
        _set_torque(link2, s2)
        _set_torque(rotor1, torque1 - s1 - self._F1 * motor1_rate)
        _set_torque(rotor2, torque2 - s2 - self._F2 * motor2_rate)
        self._space.step(dt)
        v1, v2 = link1.angular_velocity, link2.angular_velocity
        v3, v4 = rotor1.angular_velocity, rotor2.angular_velocity
        u1, u2, u3, u4 = self._before
        self._link1, self._link2 = link1.angle + v1 * dt, link2.angle + v2 * dt
        self._motor1, self._motor2 = rotor1.angle + v3 * dt, rotor2.angle + v4 * dt
        self._link1_rate, self._link2_rate = 1.5 * v1 - 0.5 * u1, 1.5 * v2 - 0.5 * u2
        self._motor1_rate, self._motor2_rate = 1.5 * v3 - 0.5 * u3, 1.5 * v4 - 0.5 * u4
        self._before = (v1, v2, v3, v4)

    @property
    def angles(self) -> tuple[float, float, float, float]:
        """Absolute link angles and reflected motor angles at the present instant, rad."""
        return self._link1, self._link2, self._motor1, self._motor2

    @property
    def motor(self) -> Floats:
        """Reflected motor angles, shape (2, 1), rad."""
        return np.array([[self._motor1], [self._motor2]])

    @property
    def motor_rate(self) -> Floats:
        """Reflected motor rates, shape (2, 1), rad/s."""
        return np.array([[self._motor1_rate], [self._motor2_rate]])


class ManyArms:
    """Many arms of one geometry, each with its own K and D, stepped together from rest.

    Of the true stiffness and damping ``K`` and ``D``, motor side, shape (2, runs) or (2, 1), in steps of
    ``dt``, s, from the joint angles at time 0, shape (2,), without deflection. ``gears`` are laws in
    addition to K and D, joint side, of all arms or of each.
    """

    angles: Floats
    """Absolute link angles, then reflected motor angles, at the present instant, (4, runs), rad."""
    log: list[Floats]
    """``angles`` at the start of each step."""

    def __init__(
        self,
        arm: PlanarArm,
        K: Floats,
        D: Floats,
        dt: float,
        joint_angle_rad: Floats,
        runs: int,
        friction: MotorFrictionLike | None,
        gears: GearLaws | None = None,
    ) -> None:
        n2 = arm.gear_ratio[:, None] ** 2
        each = np.ones((2, runs))  # numpy multiplies arrays of equal shape faster
        coulomb, viscous = friction_values(friction)
        a, b, self._c = arm.moments
        self._dt, self._serial = dt, arm.drive == "serial"
        self._K, self._D, self._F = n2 * K * each, n2 * D * each, n2 * viscous[:, None] * each
        self._kick = dt / arm.rotor_inertia_arm_kgm2[:, None] * each
        self._slows = np.abs(arm.gear_ratio * coulomb)[:, None] * self._kick
        self._stops = -self._slows
        self._slides = not coulomb.any()
        self._gears = None if gears is None else GearState(gears, np.zeros(2))
        self._ab, self._ba = a * b, np.array([[b], [a]]) * each
        self._turns = np.array([[1.0], [-1.0]]) * self._c * each
        start = np.concatenate([arm.link_angles(joint_angle_rad), joint_angle_rad])
        self.angles = np.repeat(start[:, None], runs, axis=1)
        self._rate = self._before = np.zeros((4, runs))
        self.log = []

    @property
    def motor(self) -> Floats:
        """Reflected motor angles at the present instant, shape (2, runs), rad."""
        return self.angles[2:]

    @property
    def motor_rate(self) -> Floats:
        """Reflected motor rates, shape (2, runs), rad/s."""
        return self._rate[2:]

    def step(self, torque: Floats) -> None:
        """Advance by one step under motor torques reflected to the joint side, (2, runs), N·m."""
        self.log.append(self.angles)
        dt, x, rate = self._dt, self.angles, self._rate
        link_rate, motor_rate = rate[:2], rate[2:]
        deflection, spring = x[2:] - x[:2], motor_rate - link_rate
        if self._serial:
            deflection[1] += x[0]
            spring[1] += rate[0]
        spring *= self._D
        spring += self._K * deflection
        if self._gears is not None:
            spring += self._gears.torque(deflection)
        bend = x[1] - x[0]
        coupling = np.cos(bend)
        coupling *= self._c
        # Centrifugal torques: c sin(φ2 − φ1) times the square of the other link's rate.
        load = self._turns * np.sin(bend)
        load *= (link_rate * link_rate)[::-1]
        load += spring
        if self._serial:
            load[0] -= spring[1]
        v = np.empty_like(x)
        links, rotors = v[:2], v[2:]
        np.multiply(self._ba, load, out=links)
        load *= coupling
        links -= load[::-1]
        links *= dt / (self._ab - coupling * coupling)
        np.subtract(torque, spring, out=rotors)
        rotors -= self._F * motor_rate
        rotors *= self._kick
        v += self._before
        if not self._slides:  # friction reduces the rotor's speed, at most to zero
            rotors -= np.minimum(np.maximum(rotors, self._stops), self._slows)
        self.angles = x + v * dt
        self._rate = 1.5 * v
        self._rate -= 0.5 * self._before
        self._before = v


_LARGEST_PHASE = 0.5
"""Largest ω dt: the explicit scheme is stable up to 2; a quarter of that keeps it accurate."""
_ITERATIONS = 30
"""Iterations of Chipmunk's solver over the two pivots; with warm start only rounding remains."""


def require_step(dt: float) -> None:
    """Raise JointIdError when a step is above 1 ms or not a positive number."""
    if not (np.isfinite(dt) and 0 < dt <= LONGEST_STEP_S):
        raise JointIdError(
            f"dt = {dt:g} s: the step must be positive and at most {LONGEST_STEP_S:g} s (1 ms); "
            "longer ones lose accuracy, then stability. The default, 0.00025 s, is exact to 1 µm."
        )


def fastest_mode(arm: PlanarArm, K: Floats, D: Floats, joint_angle_rad: Floats) -> float:
    """Fastest frequency or decay of the joint resonances, rad/s; K and D (2,), motor side."""
    inertia = arm.inertia(joint_angle_rad)
    mobility = np.linalg.inv(inertia.M2) + np.diag(1 / inertia.M)
    frequency = np.sqrt(np.linalg.eigvals(mobility * K).real.max())
    decay = np.linalg.eigvals(mobility * D).real.max()
    return float(max(frequency, decay))


def require_resolved(arm: PlanarArm, K: Floats, D: Floats, dt: float, joint_angle_rad: Floats) -> None:
    """Refuse a step that is too long for the joint resonances; K and D (2,), motor side.

    The JointIdError states the longest possible step.
    """
    fastest = fastest_mode(arm, K, D, joint_angle_rad)
    if dt * fastest > _LARGEST_PHASE:
        raise JointIdError(
            f"A step of {dt:g} s is too long for this arm: its fastest mode is at {fastest:.4g} rad/s. "
            f"Use a dt of at most {_LARGEST_PHASE / fastest:.2g} s, or check K (N·m/rad) and D "
            "(N·m·s/rad)."
        )


def _build_links(space: pymunk.Space, arm: PlanarArm, angle: Floats) -> list[pymunk.Body]:
    """Links on their pivots at absolute angles."""
    l1 = float(arm.length_m[0])
    r1, r2 = arm.centre_m.tolist()
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    places = np.array([[r1, 0.0], [l1, r2]]) @ along
    links = []
    for mass, inertia, at, place in zip(arm.mass_kg, arm.inertia_kgm2, angle, places, strict=True):
        link = pymunk.Body(float(mass), float(inertia))
        link.angle, link.position = float(at), tuple(place.tolist())
        links.append(link)
    base = pymunk.PivotJoint(space.static_body, links[0], (0.0, 0.0), (-r1, 0.0))
    elbow = pymunk.PivotJoint(links[0], links[1], (l1 - r1, 0.0), (-r2, 0.0))
    # No remaining bias: each step closes the gap that the straight step of a turning body opens.
    base.error_bias = elbow.error_bias = 0.0
    space.add(*links, base, elbow)
    return links


def _build_rotors(
    space: pymunk.Space, inertia: Floats, coulomb: Floats, angle: Floats
) -> list[pymunk.Body]:
    """Rotors as free bodies, with Coulomb friction as a brake of limited torque."""
    rotors = []
    for value, friction, at in zip(inertia, coulomb, angle, strict=True):
        rotor = pymunk.Body(1.0, float(value))
        rotor.angle = float(at)
        space.add(rotor)
        if friction > 0:
            brake = pymunk.SimpleMotor(space.static_body, rotor, 0.0)
            brake.max_force = float(friction)
            space.add(brake)
        rotors.append(rotor)
    return rotors
