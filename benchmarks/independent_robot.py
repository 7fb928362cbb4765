"""A simulated robot that shares only the values of its records with the package.

It tests the estimators and the verdict on data that neither ``jointid.simulation`` nor the equations of
the fit have generated. Many robots and records are integrated side by side with NumPy, in closed loop:
PD control at a sample rate, torque held between samples, encoder steps, torque noise, and the effects of
real robots beside elasticity and damping: friction at motor and arm, nonlinear gears, soft links, lags,
filters, reversed and swapped axes.

A linear robot advances by its exact transition matrix, any other by the classic Runge-Kutta method.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np

from jointid import SineRecord

Array = np.ndarray
Values = Array | Sequence[float] | Sequence[Sequence[float]] | float

BRANCHES_RAD_S = 2 * np.pi * np.geomspace(0.1, 1000.0, 9)
"""Corner frequencies of the Maxwell branches that make a loss factor nearly constant between them. The
stiffness rises slowly with frequency, as causality demands; it is K at the middle."""
MIDDLE_HZ = 10.0
MAX_STEP_S = 0.25e-3
RECORDS_AT_ONCE = 600
"""Bounds the memory of the logs, some 0.5 MB per record."""
LINK_DAMPING = 0.01
"""Damping ratio of link modes."""


@dataclass(frozen=True, eq=False)
class Robot:
    """Elastic joints and their deviations from the ideal model, motor side.

    Each value is one number for all joints or one per joint; K and D are the truth to be found.
    """

    M: Values
    M2: Values
    K: Values
    D: Values
    coulomb: Values = 0.0
    """Friction level at the motor, N·m. It is set-valued: a joint that sticks does not move."""
    viscous: Values = 0.0
    asymmetry: Values = 0.0
    """The level is 1 + this times as high at positive velocity, 1 − this at negative."""
    stribeck: Values = 0.0
    """Additional level at rest, N·m; it falls with exp(−(velocity / ``stribeck_rad_s``)²)."""
    stribeck_rad_s: Values = 0.2
    load: Values = 0.0
    """Additional level per gear torque."""
    smoothing_rad_s: float = 0.0
    """Friction level × tanh(velocity / this) in place of set-valued friction."""
    presliding_rad: Values = 0.0
    """Friction level over the stiffness of its bristles, rad: friction after Dahl, or after LuGre with
    ``stribeck`` and ``bristle_damping``. 0: no bristles."""
    bristle_damping: Values = 0.0
    """Damping ratio of the motor on its bristles."""
    arm_coulomb: Values = 0.0
    arm_viscous: Values = 0.0
    arm_smoothing_rad_s: float = 0.02
    cubic: Values = 0.0
    """Hardening, N·m/rad³."""
    knee_rad: Values = 0.0
    """Deflection beyond which the slope is K times ``knee_slope``; 0: none."""
    knee_slope: Values = 1.0
    second_knee_rad: Values = 0.0
    """Deflection beyond which the slope is K times ``second_slope``; 0: none."""
    second_slope: Values = 1.0
    backlash_rad: Values = 0.0
    """Total play; hardening and changes of slope begin at its edges."""
    hysteresis_Nm: Values = 0.0
    """Saturation of a Dahl element parallel to the spring."""
    hysteresis_rad: Values = 2e-3
    loss_factor: Values = 0.0
    link_share: Values = 0.0
    """Share of M2's diagonal that sits behind a soft link."""
    link_hz: Values = 100.0
    gravity: Values = 0.0
    """Stiffness that gravity adds to the arm, N·m/rad."""
    ripple_Nm: Values = 0.0
    """Torque ripple: this times sin(``per_turn`` · motor angle + ``phase``) acts against the motor."""
    transmission_rad: Values = 0.0
    """Transmission error: the gear is free of torque at a deflection of this times the same sine."""
    per_turn: Values = 1.0
    phase: Values = 0.0
    lag_s: Values = 0.0
    """The torque acts this much after its sample."""
    position_filter_hz: Values = 0.0
    """Corner of a first-order filter on the logged angle; 0: none."""
    torque_filter_hz: Values = 0.0
    reversed: Values = 1.0
    """−1 logs angle and torque of the joint with the other sign."""
    swapped: bool = False
    """The log has the joints in reverse order."""

    def __post_init__(self) -> None:
        n = np.size(self.M)
        for name, value in vars(self).items():
            if name not in ("M2", "smoothing_rad_s", "arm_smoothing_rad_s", "swapped"):
                object.__setattr__(self, name, np.broadcast_to(np.asarray(value, float), (n,)))
        object.__setattr__(self, "M2", np.asarray(self.M2, float).reshape(n, n))

    @property
    def n(self) -> int:
        return self.M.size

    @property
    def answer(self) -> Array:
        """K and D, shape (2n,)."""
        return np.concatenate([self.K, self.D])

    @property
    def linear(self) -> bool:
        laws = (
            self.coulomb, self.stribeck, self.load, self.arm_coulomb, self.cubic, self.backlash_rad,
            self.hysteresis_Nm, self.knee_rad, self.ripple_Nm, self.transmission_rad,
        )  # fmt: skip
        return not any(np.any(law) for law in laws)

    @property
    def locked_hz(self) -> Array:
        """Resonances with the motors locked, ascending, Hz."""
        return np.sqrt(np.linalg.eigvals(np.linalg.solve(self.M2, np.diag(self.K))).real) / (2 * np.pi)


@dataclass(frozen=True, eq=False)
class Experiment:
    """Sines of all joints at once under PD control, one record per row."""

    frequency_hz: Array
    amplitude_rad: Array
    """Of the reference, shape (records, n)."""
    phase_rad: Array
    """Of the reference, shape (records, n)."""
    sample_rate_hz: float = 2000.0
    periods: float = 10.5
    noise: float = 0.01
    """Standard deviation of the logged torque over its amplitude."""
    encoder_counts: int = 65536
    """Per turn; 0: exact angles."""
    declare_hold: bool = True
    seed: int = 0
    max_step_s: float = MAX_STEP_S
    substeps: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "substeps", int(np.ceil(1 / self.sample_rate_hz / self.max_step_s - 1e-9))
        )

    @property
    def step_s(self) -> float:
        return 1 / self.sample_rate_hz / self.substeps


def paper_motions(
    robot: Robot,
    frequency_hz: Array,
    *,
    seed: int = 0,
    velocity_rad_s: float | Array = 6.0,
    levels: Sequence[float] = (1.0,),
    per_frequency: int = 2,
    **more: float,
) -> Experiment:
    """Records of all joints at each frequency, in phase and against each other, amplitudes at random."""
    rng = np.random.default_rng(seed)
    f = np.repeat(np.asarray(frequency_hz, float), per_frequency * len(levels))
    level = np.tile(np.repeat(levels, per_frequency), len(frequency_hz))
    size = rng.uniform(0.6, 1.0, (f.size, robot.n)) * level[:, None]
    turn = np.outer(np.arange(f.size) % per_frequency, np.arange(robot.n)) / max(per_frequency, robot.n)
    phase = 2 * np.pi * turn + rng.uniform(-0.5, 0.5, (f.size, robot.n))
    amplitude = size * velocity_rad_s / (2 * np.pi * f[:, None])
    return Experiment(f, amplitude, phase, seed=seed, **more)


class Plants:
    """Equations of motion of p robots with n joints, each with r records.

    The linear part is x' = A x + B (held torque). The states are blocks of n: motor angles and
    velocities, arm angles and velocities, filtered angles and torques, and, where robots have them, link
    angles and velocities and Maxwell branches. Everything else enters as forces on motors and arms.
    """

    def __init__(self, robots: Sequence[Robot]) -> None:
        self.robots = robots
        self.n = n = robots[0].n
        self.linear = all(robot.linear for robot in robots)
        blocks = ["theta", "omega", "arm", "arm_omega", "angle_log", "torque_log"]
        if any(np.any(robot.link_share) for robot in robots):
            blocks += ["link", "link_omega"]
        if any(np.any(robot.loss_factor) for robot in robots):
            blocks += [f"branch{k}" for k in range(BRANCHES_RAD_S.size)]
        self.at = {name: slice(n * i, n * i + n) for i, name in enumerate(blocks)}
        self.size = n * len(blocks)
        self.A = np.zeros((len(robots), self.size, self.size))
        self.B = np.zeros((len(robots), self.size, n))
        self.arm_force = np.zeros((len(robots), n, n))
        """Acceleration of the arm per torque on it."""
        for k, robot in enumerate(robots):
            self._linear_part(robot, self.A[k], self.B[k], self.arm_force[k])
        self.filtered = self.of("position_filter_hz") > 0
        self.B[:, self.at["torque_log"]] = 2 * np.pi * self.of("torque_filter_hz") * np.eye(n)

    def of(self, name: str) -> Array:
        """A field of all robots, shape (p, n, 1)."""
        return np.stack([getattr(robot, name) for robot in self.robots])[:, :, None]

    def _linear_part(self, robot: Robot, A: Array, B: Array, arm_force: Array) -> None:
        at, eye = self.at, np.eye(self.n)
        share = robot.link_share * np.diag(robot.M2)
        arm_force[:] = np.linalg.inv(robot.M2 - np.diag(share))
        A[at["theta"], at["omega"]] = A[at["arm"], at["arm_omega"]] = eye
        B[at["omega"]] = np.diag(1 / robot.M)
        gear = np.zeros((self.n, self.size))  # torque of the gear
        gear[:, at["theta"]], gear[:, at["arm"]] = np.diag(robot.K), -np.diag(robot.K)
        gear[:, at["omega"]], gear[:, at["arm_omega"]] = np.diag(robot.D), -np.diag(robot.D)
        if "branch0" in at:
            ratio = np.log(BRANCHES_RAD_S[1] / BRANCHES_RAD_S[0])
            stiffness = np.diag(2 / np.pi * ratio * robot.loss_factor * robot.K)
            for k, corner in enumerate(BRANCHES_RAD_S):
                branch = at[f"branch{k}"]
                for name, sign in (("theta", 1), ("arm", -1)):
                    gear[:, at[name]] += sign * 0.5 * stiffness  # half the branches are stiff at 10 Hz
                    A[branch, at[name]] = sign * corner * eye
                gear[:, branch] = -stiffness
                A[branch, branch] = -corner * eye
        A[at["omega"]] -= gear / robot.M[:, None]
        A[at["omega"], at["omega"]] -= np.diag(robot.viscous / robot.M)
        on_arm = gear.copy()
        on_arm[:, at["arm"]] -= np.diag(robot.gravity)
        on_arm[:, at["arm_omega"]] -= np.diag(robot.arm_viscous)
        if "link" in at:
            corner = 2 * np.pi * robot.link_hz
            moved = np.where(share > 0, 1.0, 0.0)
            for angle, velocity, sign in (("arm", "arm_omega", 1), ("link", "link_omega", -1)):
                per_angle, per_velocity = sign * corner**2, sign * 2 * LINK_DAMPING * corner
                on_arm[:, at[angle]] -= np.diag(share * per_angle)
                on_arm[:, at[velocity]] -= np.diag(share * per_velocity)
                A[at["link_omega"], at[angle]] = np.diag(moved * per_angle)
                A[at["link_omega"], at[velocity]] = np.diag(moved * per_velocity)
            A[at["link"], at["link_omega"]] = eye
        A[at["arm_omega"]] += arm_force @ on_arm
        for log, corner in (
            ("angle_log", robot.position_filter_hz),
            ("torque_log", robot.torque_filter_hz),
        ):
            A[at[log], at[log]] = -2 * np.pi * np.diag(corner)
        A[at["angle_log"], at["theta"]] = 2 * np.pi * np.diag(robot.position_filter_hz)

    def measured(self, x: Array) -> Array:
        """Angles as the log has them before rounding, (p, n, r)."""
        return np.where(self.filtered, x[:, self.at["angle_log"]], x[:, self.at["theta"]])

    def energy(self, x: Array) -> Array:
        """Kinetic and elastic energy of robots without link mode and play, shape (p, r)."""
        at = self.at
        deflection = x[:, at["theta"]] - x[:, at["arm"]]
        M2 = np.stack([robot.M2 for robot in self.robots])
        kinetic = self.of("M") * x[:, at["omega"]] ** 2 + x[:, at["arm_omega"]] * (
            M2 @ x[:, at["arm_omega"]]
        )
        elastic = self.of("K") * deflection**2 + 0.5 * self.of("cubic") * deflection**4
        gravity = self.of("gravity") * x[:, at["arm"]] ** 2
        return 0.5 * (kinetic + elastic + gravity).sum(axis=1)

    def controlled(self, gain: Array, damping: Array) -> Array:
        """A with a continuous PD controller around it, (p, size, size)."""
        A = self.A.copy()
        A[:, :, self.at["theta"]] -= self.B * gain[:, None]
        A[:, :, self.at["omega"]] -= self.B * damping[:, None]
        return A


class _Linear:
    """Step of linear robots: exact for a held torque."""

    def __init__(self, plants: Plants, step_s: float) -> None:
        size = plants.size
        augmented = np.zeros((len(plants.robots), size + plants.n, size + plants.n))
        augmented[:, :size, :size] = plants.A * step_s
        augmented[:, :size, size:] = plants.B * step_s
        transition = np.stack([_exponential(each) for each in augmented])
        self.A, self.B = transition[:, :size, :size].copy(), transition[:, :size, size:].copy()

    def __call__(self, x: Array, torque: Array) -> Array:
        return self.A @ x + self.B @ torque


def _exponential(matrix: Array) -> Array:
    """Matrix exponential by scaling and squaring of its series."""
    halvings = max(0, int(np.ceil(np.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-9)))) + 1)
    small = matrix / 2**halvings
    result = term = np.eye(len(matrix))
    for order in range(1, 20):
        term = term @ small / order
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return result


class _Nonlinear:
    """Runge-Kutta step of robots with friction or nonlinear gears.

    Set-valued friction keeps its direction, or sticks, within a step; a motor that comes to rest during
    one goes on from there, for the rest of the step, in the direction of a torque above the level.
    """

    def __init__(self, plants: Plants, step_s: float, records: int) -> None:
        self.plants, self.step = plants, step_s
        shape = len(plants.robots), plants.n, records
        every = plants.of
        level = [every(name) for name in ("coulomb", "stribeck", "load")]
        rubs = any(np.any(part) for part in level)
        robots = plants.robots
        self.presliding = every("presliding_rad")
        self.smoothing = robots[0].smoothing_rad_s
        if any(robot.smoothing_rad_s != self.smoothing for robot in robots):
            raise ValueError("Robots that are simulated together share one smoothing.")
        self.rubs = rubs
        bristles = self.presliding > 0
        self.reach = np.where(bristles, self.presliding, 1.0)
        self.bristle_damping = 2 * every("bristle_damping") * np.sqrt(level[0] * self.reach * every("M"))
        self.bristled, self.slips = bool(bristles.any()), not bristles.all()
        self.sets = rubs and not self.smoothing and not bristles.all()
        self.set_valued = np.broadcast_to(~bristles, shape)
        self.coulomb, self.stribeck, self.load = level
        self.falls, self.loaded = bool(self.stribeck.any()), bool(self.load.any())
        self.sliding = np.where(self.coulomb > 0, self.coulomb, 1.0)
        self.asymmetry, self.stribeck_rad_s = every("asymmetry"), every("stribeck_rad_s")
        self.skewed = bool(self.asymmetry.any())
        self.arm_coulomb, self.cubic, self.half_play = (
            every("arm_coulomb"), every("cubic"), every("backlash_rad") / 2
        )  # fmt: skip
        self.hysteresis, self.hysteresis_rad = every("hysteresis_Nm"), every("hysteresis_rad")
        self.hysteretic, self.plays = bool(self.hysteresis.any()), bool(self.half_play.any())
        self.arm_rubs = bool(self.arm_coulomb.any())
        self.arm_smoothing = robots[0].arm_smoothing_rad_s
        self.K, self.D, self.M = every("K"), every("D"), every("M")
        self.torque_corner = 2 * np.pi * every("torque_filter_hz")
        self.filters = bool(self.torque_corner.any())
        first, second = every("knee_rad"), every("second_knee_rad")
        slope = np.where(first > 0, every("knee_slope"), 1.0)
        self.knees = tuple(np.where(knee > 0, knee, np.inf) for knee in (first, second))
        self.bends = self.K * (slope - 1), self.K * (every("second_slope") - slope)
        self.bent = bool(np.isfinite(self.knees).any())
        laws = self.cubic, self.half_play, self.hysteresis, self.bent
        self.geared = any(np.any(law) for law in laws)
        self.ripple, self.transmission = every("ripple_Nm"), every("transmission_rad")
        self.per_turn, self.phase = every("per_turn"), every("phase")
        self.turns = bool(self.ripple.any() or self.transmission.any())
        if self.geared and self.transmission.any():
            raise ValueError("A nonlinear gear with transmission error is not simulated.")
        self.direction = np.zeros(shape)
        """Of set-valued friction: the sign of the velocity, 0 where a motor sticks."""
        self.plain = rubs and not (self.smoothing or self.bristled or self.falls or self.loaded)
        """Friction of this kind is the same during a step, as long as its direction is."""
        self.stuck: Array | None = None
        """Motors that stick during a step; None without any."""
        self.states = 2  # bristles at the motor and in the gear, beside the linear part
        self.shape = shape

    def start(self) -> Array:
        p, n, r = self.shape
        return np.zeros((p, self.plants.size + self.states * n, r))

    def __call__(self, x: Array, torque: Array) -> Array:
        self.torque, self.pushed = torque, torque / self.M
        if self.sets:
            self._break_away(x)
            stuck = self.set_valued & (self.direction == 0)
            self.stuck = stuck if stuck.any() else None
        self.friction = self._plain_friction()
        h = self.step
        first = self._rate(x)
        second = self._rate(x + (0.5 * h) * first)
        third = self._rate(x + (0.5 * h) * second)
        fourth = self._rate(x + h * third)
        second += third
        second *= 2
        second += first
        second += fourth
        second *= h / 6
        second += x
        if self.sets:
            self._come_to_rest(x, second)
        return second

    def _plain_friction(self) -> Array | None:
        return self._level(0.0, self.direction, 0.0) * self.direction if self.plain else None

    def _level(self, velocity: Array | float, direction: Array, x: Array | float) -> Array:
        level = self.coulomb * (1 + self.asymmetry * direction) if self.skewed else self.coulomb
        if self.falls:
            level = level + self.stribeck * np.exp(-((velocity / self.stribeck_rad_s) ** 2))
        if self.loaded:
            level = level + self.load * np.abs(self._gear(x))
        return level

    def _gear(self, x: Array) -> Array:
        at = self.plants.at
        elastic = self.K * (x[:, at["theta"]] - x[:, at["arm"]])
        return elastic + self.D * (x[:, at["omega"]] - x[:, at["arm_omega"]])

    def _drive(self, x: Array) -> Array:
        """Torque on the motors without set-valued friction."""
        direction, self.direction = self.direction, np.zeros(self.shape)
        self.friction = self._plain_friction()
        free = self._rate(x, hold=False)[:, self.plants.at["omega"]] * self.M
        self.direction = direction
        return free

    def _break_away(self, x: Array) -> None:
        stuck = self.set_valued & (self.direction == 0)
        if stuck.any():
            drive = self._drive(x)
            sign = np.sign(drive)
            level = self._level(np.zeros(self.shape), sign, x)
            np.copyto(self.direction, np.where(np.abs(drive) > level, sign, 0.0), where=stuck)

    def _come_to_rest(self, before: Array, after: Array) -> None:
        at = self.plants.at["omega"]
        v = after[:, at]
        turned = self.set_valued & (v * self.direction < 0)
        if turned.any():
            old = before[:, at]
            remains = np.where(turned, v / np.where(turned, v - old, 1.0), 0.0)
            drive = self._drive(after)
            sign = np.sign(drive)
            excess = np.maximum(np.abs(drive) - self._level(np.zeros(self.shape), sign, after), 0.0)
            moved = sign * excess / self.M * remains * self.step
            np.copyto(v, moved, where=turned)
            np.copyto(self.direction, np.sign(moved), where=turned)

    def _rate(self, x: Array, *, hold: bool = True) -> Array:
        plants, at, n = self.plants, self.plants.at, self.plants.n
        size = plants.size
        rate = np.empty_like(x)
        linear = rate[:, :size]
        np.matmul(plants.A, x[:, :size], out=linear)
        linear[:, at["omega"]] += self.pushed
        if self.filters:
            linear[:, at["torque_log"]] += self.torque_corner * self.torque
        rate[:, size:] = 0.0
        bristle, wound = rate[:, size : size + n], rate[:, size + n :]
        velocity, arm_velocity = x[:, at["omega"]], x[:, at["arm_omega"]]
        on_motor = on_arm = None
        if self.geared:
            wind_up = x[:, at["theta"]] - x[:, at["arm"]]
            if self.plays:
                free = np.minimum(np.maximum(wind_up, -self.half_play), self.half_play)
                wind_up = wind_up - free
            gear = self.cubic * wind_up**3
            if self.hysteretic:
                z, twist = x[:, size + n :], velocity - arm_velocity
                gear += self.hysteresis * z
                wind = np.where(self.hysteresis > 0, twist - np.abs(twist) * z, 0.0)
                np.divide(wind, self.hysteresis_rad, out=wound)
            if self.plays:
                gear -= self.K * free
            if self.bent:
                for knee, bend in zip(self.knees, self.bends, strict=True):
                    gear += bend * (wind_up - np.clip(wind_up, -knee, knee))
            on_motor, on_arm = -gear, gear
        if self.turns:
            turned = self.per_turn * x[:, at["theta"]] + self.phase
            slope = self.per_turn * self.transmission * np.cos(turned)
            less = self.K * self.transmission * np.sin(turned) + self.D * slope * velocity
            ripple = less + slope * (self._gear(x) - less) - self.ripple * np.sin(turned)
            on_motor = ripple if on_motor is None else on_motor + ripple
            on_arm = -less if on_arm is None else on_arm - less
        if self.arm_rubs:
            rubbing = self.arm_coulomb * np.tanh(arm_velocity / self.arm_smoothing)
            on_arm = -rubbing if on_arm is None else on_arm - rubbing
        if self.rubs:
            friction = self.friction if self.plain else self._friction(x, velocity, bristle)
            on_motor = -friction if on_motor is None else on_motor - friction
        if on_motor is not None:
            linear[:, at["omega"]] += on_motor / self.M
        if on_arm is not None:
            linear[:, at["arm_omega"]] += plants.arm_force @ on_arm
        if hold and self.stuck is not None:
            linear[:, at["omega"]][self.stuck] = 0.0
            linear[:, at["theta"]][self.stuck] = 0.0
        return rate

    def _friction(self, x: Array, velocity: Array, bristle: Array) -> Array:
        if self.smoothing:
            smooth = np.tanh(velocity / self.smoothing)
            return self._level(velocity, smooth, x) * smooth
        friction = self._level(velocity, self.direction, x) * self.direction if self.slips else 0.0
        if self.bristled:
            n, size = self.plants.n, self.plants.size
            z = x[:, size : size + n]  # 1 when the bristles slide
            level = self._level(velocity, np.sign(z), x) / self.sliding
            bristle[:] = (velocity - np.abs(velocity) * z / level) / self.reach
            state = self.coulomb * z + self.bristle_damping * bristle
            friction = np.where(self.presliding > 0, state, friction)
        return friction


def gains(robot: Robot) -> tuple[Array, Array]:
    """Position gain and damping of each joint's controller: critically damped, rather slow."""
    whole = robot.M + np.diag(robot.M2)
    corner = 0.6 * 2 * np.pi * robot.locked_hz.min()
    return whole * corner**2, 2 * whole * corner


def settling_s(robot: Robot, drop: float = 1e-5) -> float:
    """Time after which an initial transient has decayed to ``drop`` under control, at least 1 s.

    Twice as long with friction: joints that stick pass their transients on to each other for a while.
    """
    plants = Plants([replace(robot, link_share=0.0, loss_factor=0.0)])
    gain, damping = gains(robot)
    A = plants.controlled(gain[None], damping[None])[0, : 4 * robot.n, : 4 * robot.n]
    slowest = -np.linalg.eigvals(A).real.max()
    if slowest <= 0:
        raise ValueError("This robot is not stable under its controller.")
    linear = float(np.clip(np.log(1 / drop) / slowest, 1.0, 6.0))
    return 2 * linear if np.any(robot.coulomb) else linear


def steady_state(robot: Robot, experiment: Experiment) -> tuple[Array, Array, Array]:
    """Phasors of motor angles, motor torques and deflections, each (records, n), linear part only."""
    plants, n = Plants([robot]), robot.n
    gain, damping = gains(robot)
    A = plants.controlled(gain[None], damping[None])[0, : 4 * n, : 4 * n]
    s = 2j * np.pi * experiment.frequency_hz[:, None]
    reference = experiment.amplitude_rad * np.exp(1j * experiment.phase_rad)
    forced = ((gain + s * damping) * reference) @ plants.B[0, : 4 * n].T
    x = np.linalg.solve(s[:, :, None] * np.eye(4 * n) - A, forced[:, :, None])[:, :, 0]
    q = x[:, plants.at["theta"]]
    return q, (gain + s * damping) * (reference - q), q - x[:, plants.at["arm"]]


def simulate(runs: Sequence[tuple[Robot, Experiment]]) -> list[list[SineRecord]]:
    """Records of every run; those of a kind are integrated together."""
    keys = [
        (
            robot.n, experiment.frequency_hz.size, experiment.sample_rate_hz, robot.linear,
            bool(np.any(robot.link_share)), bool(np.any(robot.loss_factor)), robot.smoothing_rad_s,
            robot.arm_smoothing_rad_s, bool(np.any(robot.coulomb)), bool(np.any(robot.lag_s)),
        )
        for robot, experiment in runs
    ]  # fmt: skip
    order = sorted(range(len(runs)), key=keys.__getitem__)
    found: dict[int, list[SineRecord]] = {}
    for _, group in groupby(order, key=keys.__getitem__):
        members = list(group)
        most = max(1, RECORDS_AT_ONCE // runs[members[0]][1].frequency_hz.size)
        for first in range(0, len(members), most):
            part = members[first : first + most]
            for index, records in zip(part, _together([runs[k] for k in part]), strict=True):
                found[index] = records
    return [found[k] for k in range(len(runs))]


def _together(runs: Sequence[tuple[Robot, Experiment]]) -> list[list[SineRecord]]:
    robots, experiments = [robot for robot, _ in runs], [experiment for _, experiment in runs]
    rate = experiments[0].sample_rate_hz
    settling = np.array([settling_s(robot) for robot in robots])
    frequency = np.stack([e.frequency_hz for e in experiments])[:, None]  # (p, 1, r)
    first = np.ceil(settling * rate).astype(int)
    last = first[:, None] + np.ceil(
        np.array([[e.periods] for e in experiments]) / frequency[:, 0] * rate
    ).astype(int)
    angle, torque = _closed_loop(robots, experiments, settling / 3, int(last.max()))
    return [
        _records(robot, experiment, angle[:, k], torque[:, k], int(first[k]), last[k])
        for k, (robot, experiment) in enumerate(runs)
    ]


def _closed_loop(
    robots: Sequence[Robot], experiments: Sequence[Experiment], ramp_s: Array, samples: int
) -> tuple[Array, Array]:
    """Logged angles and commanded torques, shape (samples, p, n, r)."""
    plants, about = Plants(robots), experiments[0]
    sub, rate = _substeps(robots, about), about.sample_rate_hz
    step_s = 1 / rate / sub
    omega = 2 * np.pi * np.stack([e.frequency_hz for e in experiments])[:, None]
    amplitude = np.stack([e.amplitude_rad.T for e in experiments])
    phase = np.stack([e.phase_rad.T for e in experiments])
    counts = np.array([e.encoder_counts for e in experiments], float)[:, None, None]
    quantum = np.where(counts > 0, 2 * np.pi / np.maximum(counts, 1), 1e-15)
    gain, damping = (np.stack(each)[:, :, None] for each in zip(*map(gains, robots), strict=True))
    lag = np.rint(plants.of("lag_s")[:, :, 0] / step_s).astype(int)
    filtered = plants.of("torque_filter_hz") > 0
    p, n, r = amplitude.shape
    shape = p, plants.n, r
    advance = _Linear(plants, step_s) if plants.linear else _Nonlinear(plants, step_s, r)
    x = np.zeros((p, plants.size, r)) if isinstance(advance, _Linear) else advance.start()
    angles, torques = np.zeros((samples, *shape)), np.zeros((samples, *shape))
    logged = torques.copy() if filtered.any() else torques
    index = np.arange(p)[:, None], np.arange(n)[None]
    late = bool(lag.any())
    for k in range(samples):
        time = k / rate
        turn = omega * time + phase
        share = np.minimum(time / ramp_s, 1.0)[:, None, None]
        size = amplitude * (share * share * (3 - 2 * share))
        angles[k] = np.rint(plants.measured(x) / quantum) * quantum
        target, rate_of_target = size * np.sin(turn), size * omega * np.cos(turn)
        torques[k] = gain * (target - angles[k]) + damping * (rate_of_target - x[:, plants.at["omega"]])
        if logged is not torques:
            logged[k] = np.where(filtered, x[:, plants.at["torque_log"]], torques[k])
        for part in range(sub):
            held = torques[np.maximum((k * sub + part - lag) // sub, 0), *index] if late else torques[k]
            x = advance(x, held)
    return angles, logged


def _substeps(robots: Sequence[Robot], about: Experiment) -> int:
    """Steps per sample: short enough for a robot that is not linear, and all lags are whole steps."""
    lags = np.concatenate([robot.lag_s for robot in robots]) * about.sample_rate_hz
    least = 1 if all(robot.linear for robot in robots) else about.substeps
    for sub in range(least, least + 20):
        if np.all(np.abs(lags * sub - np.rint(lags * sub)) < 1e-6):
            return sub
    raise ValueError("No whole number of steps per sample makes every lag a whole number of steps.")


def _records(
    robot: Robot, experiment: Experiment, angle: Array, torque: Array, first: int, last: Array
) -> list[SineRecord]:
    rng = np.random.default_rng([experiment.seed, 1])
    order = slice(None, None, -1 if robot.swapped else 1)
    records = []
    for k, (f, end) in enumerate(zip(experiment.frequency_hz, last, strict=True)):
        tau = torque[first:end, :, k]
        size = np.sqrt(2) * tau.std(axis=0)
        tau = tau + experiment.noise * size * rng.standard_normal(tau.shape)
        theta = angle[first:end, :, k] * robot.reversed
        records.append(
            SineRecord(
                frequency_hz=float(f),
                time_s=np.arange(end - first) / experiment.sample_rate_hz,
                theta_rad=theta[:, order],
                tau_Nm=(tau * robot.reversed)[:, order],
                torque_hold=experiment.declare_hold,
            )
        )
    return records
