"""The simulated robot: n elastic joints, equation (1), under sampled joint control → sine records.

The robot stands in the horizontal plane: no gravity, and small motions, so no velocity coupling.
Between two events (a control sample, a change of the delayed torque) the motor torque is constant and
the linear dynamics advance exactly, by a matrix exponential. All records advance together.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from jointid.arrays import Complexes, Floats, finite_array
from jointid.errors import JointIdError
from jointid.joints import Elasticity, Inertia
from jointid.records import SineRecord

PerJoint: TypeAlias = float | Sequence[float] | Floats
"""One number for all joints, or one per joint."""

_CHUNKS = 64
_LARGEST_LOG_BYTES = 2e9
_SETTLED = 1e-5


@dataclass(frozen=True, eq=False)
class Controller:
    """Sampled position and velocity control of every joint by itself, with torque feedforward.

    With the reference r, the encoder position y and the control interval T, sample k commands
    τ = kp (r − y) + kv (Δr − Δy)/T + (M + M2) r̈, where Δ is the difference to the sample before.
    The defaults kp = J ω², kv = 2ζ J ω belong to the rigid joint, J = J_m + J_a and ω = 2π bandwidth.

    Parameters
    ----------
    bandwidth_hz : float or (n,)
        Natural frequency of the controlled rigid joint, Hz.
    damping_ratio : float or (n,)
        Its damping ratio ζ.
    position_gain, velocity_gain : float or (n,), optional
        kp in N·m/rad and kv in N·m·s/rad, in place of those from bandwidth and damping ratio.
    feedforward : bool
        Whether the rigid-body torque of the reference acceleration is added.
    sample_rate_hz : float
        Control rate, which is also the rate of the log, Hz.
    torque_delay_s : float
        The torque acts this much after the sample that it was computed from, s. Need not be a
        whole number of samples.

    Raises
    ------
    JointIdError
        When a value is out of range.
    """

    bandwidth_hz: PerJoint = 10.0
    damping_ratio: PerJoint = 0.5
    position_gain: PerJoint | None = None
    velocity_gain: PerJoint | None = None
    feedforward: bool = True
    sample_rate_hz: float = 4000.0
    torque_delay_s: float = 0.0

    def __post_init__(self) -> None:
        _store(self, "bandwidth_hz", "Hz", positive=True)
        _store(self, "damping_ratio", "", positive=True)
        _store(self, "position_gain", "N·m/rad", positive=True)
        _store(self, "velocity_gain", "N·m·s/rad", positive=True)
        _store(self, "sample_rate_hz", "Hz", positive=True, single=True)
        _store(self, "torque_delay_s", "s", single=True)
        if self.torque_delay_s > 0.1:
            raise JointIdError(
                f"torque_delay_s = {self.torque_delay_s:g} s: more than 0.1 s cannot be simulated. "
                "Check the unit (seconds)."
            )


@dataclass(frozen=True, eq=False)
class Excitation:
    """The sine that every joint is asked to follow, and for how long.

    The reference of joint j in record r is Im(A_fj W_rj e^{iωt}) + v_j t, with t = 0 at the first
    logged sample. The amplitude A = min(velocity/ω, acceleration/ω²) bounds speed and rigid-body torque.

    Parameters
    ----------
    pattern : {"orthogonal", "one-at-a-time"} or array_like, shape (R, n), complex
        The weights W. "orthogonal": e^{2πi rj/R}, so all joints move in every record, each time with
        another relative phase. "one-at-a-time": record r moves joint r, the controllers hold the others.
    records_per_frequency : int, optional
        R; by default n, or the rows of ``pattern``.
    velocity_rad_s, acceleration_rad_s2 : float or (n,)
        Largest velocity and acceleration amplitude of the reference, motor side.
    position_rad : float, (f,) or (f, n), optional
        Position amplitude at each frequency, in place of the two limits, rad.
    constant_velocity_rad_s : float or (n,)
        Superposed constant velocity v, rad/s. A joint that has one must never reverse.
    duration_s : float
        Length of each record, s.
    periods : float, optional
        Length of each record in periods of its frequency, in place of ``duration_s``.
    settle_s : float, optional
        Time before the log begins, s. The run starts in the steady state of the robot without Coulomb
        friction. The default lets what Coulomb friction changes decay to 1e-5 by the slowest mode of the
        closed loop, and is zero where there is no Coulomb friction.

    Raises
    ------
    JointIdError
        When a value is out of range, or the pattern is unknown.
    """

    pattern: str | ArrayLike = "orthogonal"
    records_per_frequency: int | None = None
    velocity_rad_s: PerJoint = 10.0
    acceleration_rad_s2: PerJoint = 300.0
    position_rad: ArrayLike | None = None
    constant_velocity_rad_s: PerJoint = 0.0
    duration_s: float = 4.0
    periods: float | None = None
    settle_s: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.pattern, str):
            object.__setattr__(self, "pattern", _weights_table(self.pattern))
        elif self.pattern not in ("orthogonal", "one-at-a-time"):
            raise JointIdError(
                f'pattern = "{self.pattern}": expected "orthogonal", "one-at-a-time" or a table of '
                "complex weights, one row per record and one column per joint."
            )
        count = self.records_per_frequency
        if count is not None and (not isinstance(count, int | np.integer) or not 1 <= count <= 1000):
            raise JointIdError(
                f"records_per_frequency = {count!r}: expected a whole number from 1 to 1000."
            )
        _store(self, "velocity_rad_s", "rad/s", positive=True)
        _store(self, "acceleration_rad_s2", "rad/s²", positive=True)
        _store(self, "constant_velocity_rad_s", "rad/s", signed=True)
        _store(self, "duration_s", "s", positive=True, single=True)
        _store(self, "periods", "", positive=True, single=True)
        _store(self, "settle_s", "s", single=True)

    def weights(self, n: int) -> Complexes:
        """Weights W of the joints' sines, shape (R, n)."""
        count = self.records_per_frequency
        if isinstance(self.pattern, str):
            record, joint = np.ogrid[: count or n, :n]
            if self.pattern == "one-at-a-time":
                return np.where(record % n == joint, 1.0 + 0j, 0j)
            return np.asarray(np.exp(2j * np.pi * record * joint / record.size))
        table = np.asarray(self.pattern, dtype=np.complex128)
        if table.shape[1] != n or count not in (None, table.shape[0]):
            raise JointIdError(
                f"pattern has shape {table.shape}; expected {count or 'R'} rows, one per record, "
                f"and {n} column(s), one per joint."
            )
        return table

    def amplitudes(self, omega: Floats, n: int) -> Floats:
        """Position amplitudes A of the joints' sines, shape (f, n), rad."""
        if self.position_rad is None:
            velocity = _per_joint("velocity_rad_s", self.velocity_rad_s, n)
            acceleration = _per_joint("acceleration_rad_s2", self.acceleration_rad_s2, n)
            return np.minimum(velocity / omega[:, None], acceleration / omega[:, None] ** 2)
        name = "position_rad (amplitude, rad)"
        try:
            given = np.atleast_1d(np.asarray(self.position_rad, dtype=np.float64))
        except (TypeError, ValueError) as error:
            raise JointIdError(f"{name}: expected numbers, got {self.position_rad!r:.80}.") from error
        given = finite_array(name, given, ndim=min(given.ndim, 2))
        table = given[:, None] if given.ndim == 1 else given
        if table.shape[0] not in (1, omega.size) or table.shape[1] not in (1, n) or np.any(table <= 0):
            raise JointIdError(
                f"{name}: expected positive values, one for each of the {omega.size} frequencies, or "
                f"one row per frequency and one column for each of the {n} joint(s); "
                f"got shape {given.shape} and smallest value {table.min(initial=np.inf):g} rad."
            )
        return np.array(np.broadcast_to(table, (omega.size, n)))


@dataclass(frozen=True, eq=False)
class MotorFriction:
    """Friction at each motor, τ_friction = F_c sign(θ̇) + F_v θ̇.

    A motor at rest stays there until the other torques on it exceed F_c.

    Parameters
    ----------
    coulomb : float or (n,)
        F_c, N·m.
    viscous : float or (n,)
        F_v, N·m·s/rad.
    step_s : float
        Longest step in which Coulomb friction is resolved, s. A reversal is located inside its step, so
        the error is of second order: about 1e-4 of the friction phasor up to 30 Hz with the default.

    Raises
    ------
    JointIdError
        When a value is negative or the step is not positive.
    """

    coulomb: PerJoint = 0.0
    viscous: PerJoint = 0.0
    step_s: float = 1.25e-4

    def __post_init__(self) -> None:
        _store(self, "coulomb", "N·m")
        _store(self, "viscous", "N·m·s/rad")
        _store(self, "step_s", "s", positive=True, single=True)


@dataclass(frozen=True, eq=False)
class Measurement:
    """What the log shows of position and torque; the controller sees the same position.

    Parameters
    ----------
    encoder_counts : int, optional
        Encoder counts per motor revolution; None is an ideal encoder.
    position_noise_rad : float or (n,)
        Standard deviation of white noise on the position, ahead of the encoder's rounding, rad.
    torque_noise_Nm : float or (n,)
        Standard deviation of white noise on the logged torque, N·m. The motor is spared.

    Raises
    ------
    JointIdError
        When a value is out of range.
    """

    encoder_counts: int | None = None
    position_noise_rad: PerJoint = 0.0
    torque_noise_Nm: PerJoint = 0.0

    def __post_init__(self) -> None:
        _store(self, "encoder_counts", "per revolution", positive=True, single=True)
        _store(self, "position_noise_rad", "rad")
        _store(self, "torque_noise_Nm", "N·m")


def simulate_records(
    inertia: Inertia,
    elasticity: Elasticity,
    frequencies_hz: ArrayLike,
    *,
    excitation: Excitation | None = None,
    controller: Controller | None = None,
    friction: MotorFriction | None = None,
    measurement: Measurement | None = None,
    pose: str | None = None,
    declare_timing: bool = True,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> tuple[SineRecord, ...]:
    """Run sine experiments on the simulated robot and return their logs.

    Parameters
    ----------
    inertia, elasticity
        The robot, n joints, equation (1).
    frequencies_hz : array_like, shape (f,)
        Excitation frequencies, Hz, below half the sample rate.
    excitation : Excitation, optional
        What the joints are asked to do; by default n records per frequency in which all joints move.
    controller : Controller, optional
        The joint control.
    friction : MotorFriction, optional
        By default there is none.
    measurement : Measurement, optional
        By default the log is exact.
    pose : str, optional
        Name that the records carry.
    declare_timing : bool
        Whether the records tell that the torque was held and how long it was delayed. False leaves
        them as from a logger that does not know.
    seed : int
        Of the noise: the same seed gives identical arrays.
    progress : callable, optional
        Called about 64 times with the fraction done, up to 1.0. What it raises ends the run.

    Returns
    -------
    tuple of SineRecord
        R records for each frequency, frequency by frequency, as "3.00 Hz, record 1".

    Raises
    ------
    JointIdError
        When settings do not fit the robot, the closed loop is unstable, or a joint with a superposed
        constant velocity would reverse.
    """
    excitation, controller = excitation or Excitation(), controller or Controller()
    friction, measurement = friction or MotorFriction(), measurement or Measurement()
    frequencies = _frequencies(frequencies_hz, controller.sample_rate_hz)
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise JointIdError(f"seed = {seed!r}: expected a whole number that is not negative.")
    robot = _Robot(inertia, elasticity, controller, friction)
    weights = excitation.weights(robot.n)
    A = excitation.amplitudes(2 * np.pi * frequencies, robot.n)[:, None, :] * weights
    reference = _Reference(
        omega=np.repeat(2 * np.pi * frequencies, len(weights)),
        A=A.reshape(-1, robot.n).T,
        velocity=_per_joint("constant_velocity_rad_s", excitation.constant_velocity_rad_s, robot.n),
    )
    samples = _record_lengths(excitation, controller, reference.omega / (2 * np.pi))
    settle = excitation.settle_s
    if settle is None:
        settle = robot.settling_time_s() if np.any(robot.coulomb > 0) else 0.0
    before = int(np.ceil(settle / robot.T - 1e-9))
    _require_memory(before + int(samples.max()), reference.A.size)

    theta, tau = robot.run(reference, before, int(samples.max()), measurement, seed, progress)
    time = np.arange(samples.max()) * robot.T
    return tuple(
        SineRecord(
            frequency_hz=float(reference.omega[r] / (2 * np.pi)),
            time_s=time[:length],
            theta_rad=theta[before : before + length, :, r],
            tau_Nm=tau[before : before + length, :, r],
            torque_hold=declare_timing,
            torque_delay_s=controller.torque_delay_s if declare_timing else 0.0,
            pose=pose,
            label=f"{reference.omega[r] / (2 * np.pi):.2f} Hz, record {r % len(weights) + 1}",
        )
        for r, length in enumerate(samples)
    )


class _Reference(NamedTuple):
    """r(t) = Im(A e^{iωt}) + vt of n joints in R records."""

    omega: Floats  # (R,)
    A: Complexes  # (n, R)
    velocity: Floats  # (n,)

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """Position and acceleration, each (N, n, R)."""
        sine = np.imag(self.A * np.exp(1j * np.multiply.outer(time, self.omega))[:, None, :])
        return sine + np.multiply.outer(time, self.velocity)[:, :, None], -(self.omega**2) * sine


class _Stretch(NamedTuple):
    """A stretch of time under a constant motor torque: x ← [E G] [x; torque], x = θm, θa, θ̇m, θ̇a."""

    EG: Floats  # (4n, 5n)
    resistance: Floats  # (n, 1), torque that changes a motor's velocity by 1 rad/s over the stretch
    older: bool  # the torque that the delay still lets act at the start of a sample


class _Robot:
    """Arm, motors and joint control; sampled, exact between the samples."""

    def __init__(
        self, inertia: Inertia, elasticity: Elasticity, controller: Controller, friction: MotorFriction
    ) -> None:
        if inertia.n != elasticity.n:
            raise JointIdError(
                f"The inertia has {inertia.n} joint(s), the elasticity {elasticity.n}: they must agree."
            )
        n = self.n = inertia.n
        self.T = 1 / controller.sample_rate_hz
        self.inertia, self.elasticity = inertia, elasticity
        self.coulomb = _per_joint("coulomb", friction.coulomb, n)[:, None]
        self.viscous = _per_joint("viscous", friction.viscous, n)
        self.kp, self.kv = _gains(controller, inertia)
        self.feedforward = controller.feedforward * (np.diag(inertia.M) + inertia.M2)
        whole = int(controller.torque_delay_s / self.T + 1e-9)
        share = max(controller.torque_delay_s / self.T - whole, 0.0)
        self.delay = whole  # in samples; the older torque acts for a share of the sample longer
        self.A, self.B = _plant(inertia, elasticity, self.viscous)
        longest = friction.step_s if np.any(self.coulomb > 0) else self.T
        self.stretches: list[_Stretch] = []
        for part, older in [(share, True), (1 - share, False)]:
            if part > 1e-9:
                steps = int(np.ceil(part * self.T / longest - 1e-9))
                self.stretches += [_stretch(self.A, self.B, part * self.T / steps, older)] * steps
        self.closed, self.drive = self._closed_loop()
        self._require_stable()

    def settling_time_s(self) -> float:
        """Time in which the slowest mode of the closed loop decays to 1e-5, s."""
        slowest = np.abs(np.linalg.eigvals(self.closed)).max()
        return float(np.log(_SETTLED) / np.log(slowest) * self.T)

    def run(
        self,
        reference: _Reference,
        before: int,
        samples: int,
        measurement: Measurement,
        seed: int,
        progress: Callable[[float], None] | None,
    ) -> tuple[Floats, Floats]:
        """Log ``before`` samples ahead of t = 0 and ``samples`` after it: θ and τ, (N, n, R)."""
        n, shape = self.n, (before + samples, self.n, reference.omega.size)
        theta, tau = np.empty(shape), np.empty(shape)
        Z, y_before, torques = self._steady_state(reference, -before)
        position_noise, torque_noise = (
            (np.random.default_rng(s), _per_joint(name, std, n)[:, None])
            for s, name, std in zip(
                np.random.SeedSequence(seed).spawn(2),
                ("position_noise_rad", "torque_noise_Nm"),
                (measurement.position_noise_rad, measurement.torque_noise_Nm),
                strict=True,
            )
        )
        count = 2 * np.pi / measurement.encoder_counts if measurement.encoder_counts else 0.0
        proportional, difference = (self.kp + self.kv / self.T)[:, None], (self.kv / self.T)[:, None]
        rubs = bool(np.any(self.coulomb > 0))
        bounds = np.unique(np.linspace(0, shape[0], _CHUNKS + 1).astype(int))
        for first, last in pairwise(bounds.tolist()):
            wanted = self._feed(reference, np.arange(first, last) - before)
            disturbed = _noise(position_noise, wanted.shape)
            for k in range(last - first):
                y = Z[:n] + disturbed[k] if disturbed is not None else Z[:n].copy()
                if count:
                    y = np.rint(y / count) * count
                torque = wanted[k] - proportional * y + difference * y_before
                theta[first + k], tau[first + k] = y, torque
                y_before = y
                torques.append(torque)
                for stretch in self.stretches:
                    Z[4 * n :] = torques[0 if stretch.older else 1]
                    if rubs:
                        _step_with_friction(Z, stretch, self.coulomb)
                    else:
                        Z[: 4 * n] = stretch.EG @ Z
            seen = _noise(torque_noise, wanted.shape)
            if seen is not None:
                tau[first:last] += seen
            if progress is not None:
                progress(float(last / shape[0]))
        return theta, tau

    def _feed(self, reference: _Reference, k: np.ndarray) -> Floats:
        """The part of the commanded torque that does not depend on the encoder, (N, n, R)."""
        position, acceleration = reference.at(k * self.T)
        past, _ = reference.at((k - 1) * self.T)
        kp, kv = self.kp[:, None], self.kv[:, None]
        control = kp * position + kv * (position - past) / self.T
        return np.asarray(control + self.feedforward @ acceleration)

    def _closed_loop(self) -> tuple[Floats, Floats]:
        """The linear closed loop, exactly: s ← closed s + drive w with s = x, y before, torques before.

        w is the part of the torque that comes from the reference.
        """
        n, delay = self.n, self.delay
        size = 5 * n + (delay + 1) * n
        plant = np.eye(4 * n, size + n)  # x after the sample from s and the new torque
        for EG, _, older in self.stretches:
            E, G = EG[:, : 4 * n], EG[:, 4 * n :]
            plant = E @ plant
            # Torque columns run from the newest of s to the oldest; the new one stands behind s.
            age = delay + older
            column = size if age == 0 else 5 * n + (age - 1) * n
            plant[:, column : column + n] += G
        torque = np.zeros((n, size))
        torque[:, :n] = -np.diag(self.kp + self.kv / self.T)
        torque[:, 4 * n : 5 * n] = np.diag(self.kv / self.T)
        closed, drive = np.zeros((size, size)), np.zeros((size, n))
        closed[: 4 * n] = plant[:, :size] + plant[:, size:] @ torque
        drive[: 4 * n] = plant[:, size:]
        closed[4 * n : 5 * n, :n] = np.eye(n)
        closed[5 * n : 6 * n] = torque
        drive[5 * n : 6 * n] = np.eye(n)
        closed[6 * n :, 5 * n : -n] = np.eye(delay * n)
        return closed, drive

    def _require_stable(self) -> None:
        largest = float(np.abs(np.linalg.eigvals(self.closed)).max())
        if largest >= 1 - 1e-12:
            raise JointIdError(
                f"The closed loop is unstable: the largest eigenvalue of the sampled loop has magnitude "
                f"{largest:.6f} and must stay below 1. Lower bandwidth_hz or the gains, shorten "
                f"torque_delay_s, or raise sample_rate_hz ({1 / self.T:g} Hz)."
            )

    def _steady_state(self, reference: _Reference, k: int) -> tuple[Floats, Floats, deque[Floats]]:
        """State, encoder position before and torques before sample k, as if it had run for ever.

        Coulomb friction enters only where a constant velocity fixes its sign.
        """
        n, (omega, A, velocity) = self.n, reference
        z = np.exp(1j * omega * self.T)
        w = (self.kp[:, None] + (self.kv / self.T)[:, None] * (1 - 1 / z)) * A
        w -= omega**2 * (self.feedforward @ A)
        loop = z[:, None, None] * np.eye(len(self.closed)) - self.closed
        S = np.linalg.solve(loop, (self.drive @ w).T[:, :, None])[:, :, 0].T
        _require_one_direction(velocity, np.abs(omega * S[:n]))
        state = np.imag(S * z**k)
        # At constant velocity motor and arm travel together and the controller balances friction.
        load = self.coulomb[:, 0] * np.sign(velocity) + self.viscous * velocity
        lag = load / self.kp
        now = velocity * k * self.T - lag
        drift = [now, now, velocity, velocity, now - velocity * self.T, *[load] * (self.delay + 1)]
        state += np.concatenate(drift)[:, None]
        history = [state[start : start + n] for start in range(5 * n, len(state), n)]
        Z = np.vstack([state[: 4 * n], np.zeros_like(A.real)])
        return Z, state[4 * n : 5 * n], deque(reversed(history), maxlen=self.delay + 2)


def _step_with_friction(Z: Floats, stretch: _Stretch, coulomb: Floats) -> None:
    """Advance Z = [x; torque] in place over one stretch with Coulomb friction, set-valued at rest.

    The friction torque of the stretch is its time average: its full value against the motion while a
    motor moves one way; what keeps the motor standing where that is enough; and where a motor
    reverses, the full value one way up to the instant of rest and the other way after it.

    Parameters
    ----------
    Z : ndarray, shape (5n, R)
    stretch : _Stretch
    coulomb : ndarray, shape (n, 1)
        F_c, N·m.
    """
    n = len(coulomb)
    EG, resistance, _ = stretch
    motors = slice(2 * n, 3 * n)
    # One motor's torque moves another only through springs and arm: within a stretch ten orders of
    # magnitude less than itself. So each motor is judged alone.
    velocity = Z[motors]
    momentum = resistance * velocity  # per length of the stretch, so a torque
    needed = resistance * (EG[motors] @ Z)  # friction that would stop the motor at the end
    sign = np.sign(velocity)
    rub = sign * coulomb
    stops = sign * (needed - rub) <= 0
    if not stops.any():
        Z[4 * n :] -= rub
        Z[: 4 * n] = EG @ Z
        return
    other = needed - momentum  # torque of all but friction, on average
    stands = stops & (np.abs(other) <= coulomb)
    reverses = stops & ~stands
    share = np.divide(momentum, rub - other, out=np.zeros_like(rub), where=reverses)
    after = np.sign(other) * coulomb
    rub += reverses * (1 - share) * (after - rub)
    np.copyto(rub, needed, where=stands)
    stayed = stands & (velocity == 0)
    theta = Z[:n].copy()
    Z[4 * n :] -= rub
    Z[: 4 * n] = EG @ Z
    np.copyto(Z[motors], 0.0, where=stands)
    np.copyto(Z[:n], theta, where=stayed)


def _plant(inertia: Inertia, elasticity: Elasticity, viscous: Floats) -> tuple[Floats, Floats]:
    """Equation (1) as ẋ = A x + B τ with x = θm, θa, θ̇m, θ̇a."""
    n, K, D = inertia.n, np.diag(elasticity.K), np.diag(elasticity.D)
    none, one = np.zeros((n, n)), np.eye(n)
    forces = np.block([[-K, K, -D - np.diag(viscous), D], [K, -K, D, -D]])
    mass = np.block([[np.diag(inertia.M), none], [none, inertia.M2]])
    kinematics = np.block([[none, none, one, none], [none, none, none, one]])
    B = np.vstack([none, none, np.diag(1 / inertia.M), none])
    return np.vstack([kinematics, np.linalg.solve(mass, forces)]), B


def _stretch(A: Floats, B: Floats, duration: float, older: bool) -> _Stretch:
    """The exact step under a constant torque, by one matrix exponential."""
    states, n = B.shape
    extended = np.zeros((states + n, states + n))
    extended[:states] = np.hstack([A, B])
    EG = np.ascontiguousarray(expm(extended * duration)[:states])
    return _Stretch(EG, 1 / np.diagonal(EG[2 * n : 3 * n, 4 * n :])[:, None], older)


def _gains(controller: Controller, inertia: Inertia) -> tuple[Floats, Floats]:
    """Gains kp (n,) in N·m/rad and kv (n,) in N·m·s/rad."""
    n, J = inertia.n, inertia.M + np.diag(inertia.M2)
    omega = 2 * np.pi * _per_joint("bandwidth_hz", controller.bandwidth_hz, n)
    zeta = _per_joint("damping_ratio", controller.damping_ratio, n)
    kp, kv = J * omega**2, 2 * zeta * J * omega
    if controller.position_gain is not None:
        kp = _per_joint("position_gain", controller.position_gain, n)
    if controller.velocity_gain is not None:
        kv = _per_joint("velocity_gain", controller.velocity_gain, n)
    return kp, kv


def _noise(source: tuple[np.random.Generator, Floats], shape: tuple[int, ...]) -> Floats | None:
    generator, std = source
    return std * generator.standard_normal(shape) if np.any(std > 0) else None


def _frequencies(values: ArrayLike, sample_rate_hz: float) -> Floats:
    frequencies = finite_array("frequencies_hz", np.atleast_1d(values), ndim=1)
    if frequencies.size == 0:
        raise JointIdError("frequencies_hz is empty: give at least one excitation frequency in Hz.")
    wrong = (frequencies <= 0) | (frequencies >= sample_rate_hz / 2)
    if wrong.any():
        raise JointIdError(
            f"frequencies_hz contains {frequencies[wrong][0]:g} Hz: must be positive and below half "
            f"the sample rate of {sample_rate_hz:g} Hz."
        )
    return frequencies


def _record_lengths(excitation: Excitation, controller: Controller, frequency: Floats) -> np.ndarray:
    """Samples of each record."""
    if excitation.periods is not None:
        if excitation.periods < 1:
            raise JointIdError(f"periods = {excitation.periods:g}: a record needs at least one period.")
        duration = excitation.periods / frequency
    else:
        duration = np.full(frequency.shape, excitation.duration_s)
    samples = np.ceil(duration * controller.sample_rate_hz - 1e-6).astype(int)
    if np.any(samples * frequency < controller.sample_rate_hz):
        slowest = float(frequency.min())
        raise JointIdError(
            f"duration_s = {excitation.duration_s:g} s is less than one period of {slowest:g} Hz "
            f"({1 / slowest:.4g} s). Record longer, or set periods."
        )
    return samples


def _require_memory(samples: int, channels: int) -> None:
    needed = 2 * 8.0 * samples * channels
    if needed > _LARGEST_LOG_BYTES:
        raise JointIdError(
            f"The log would hold {samples} samples of {channels} joints and records, "
            f"{needed / 1e9:.1f} GB; at most {_LARGEST_LOG_BYTES / 1e9:g} GB. "
            "Shorten the records, or simulate fewer at a time."
        )


def _require_one_direction(velocity: Floats, amplitude: Floats) -> None:
    reverses = (velocity != 0) & (np.abs(velocity) <= amplitude.max(axis=1))
    if reverses.any():
        j = int(np.argmax(reverses))
        raise JointIdError(
            f"constant_velocity_rad_s of joint {j + 1} is {velocity[j]:g} rad/s, but its sine reaches "
            f"{amplitude[j].max():.3g} rad/s: the joint would reverse. Superpose more, or move less."
        )


def _per_joint(name: str, value: object, n: int) -> Floats:
    """A checked setting as (n,)."""
    array = np.atleast_1d(np.asarray(value, dtype=np.float64))
    if array.size not in (1, n):
        raise JointIdError(
            f"{name} has {array.size} values: give one, or one for each of the {n} joint(s)."
        )
    return np.array(np.broadcast_to(array, (n,)))


def _store(
    settings: object,
    name: str,
    unit: str,
    *,
    positive: bool = False,
    signed: bool = False,
    single: bool = False,
) -> None:
    """Check one setting of a frozen dataclass and keep a copy; None means not given."""
    value = getattr(settings, name)
    if value is None and getattr(type(settings), name, 0.0) is None:
        return
    scalar = np.isscalar(value) or getattr(value, "ndim", None) == 0 or value is None
    what = f"{name} ({unit})" if unit else name
    array = finite_array(what, [value] if scalar else value, ndim=1)
    if single and not scalar:
        raise JointIdError(f"{what}: expected one number, got {array.size}.")
    wrong = np.zeros(array.shape, bool) if signed else array <= 0 if positive else array < 0
    if array.size == 0 or wrong.any():
        shown = f"{array[wrong][0]:g}" if array.size else "empty"
        rule = "be positive" if positive else "not be negative"
        raise JointIdError(f"{what} is {shown}: must {rule}.")
    object.__setattr__(settings, name, float(array[0]) if scalar else array)


def _weights_table(value: ArrayLike) -> Complexes:
    try:
        table = np.array(value, dtype=np.complex128)
    except (TypeError, ValueError) as error:
        raise JointIdError(f"pattern: expected complex weights, got {value!r:.80}.") from error
    if table.ndim != 2 or table.size == 0 or not np.isfinite(table).all():
        raise JointIdError(
            "pattern: expected finite complex weights, one row per record and one column per joint; "
            f"got shape {table.shape}."
        )
    if not table.any(axis=1).all():
        row = int(np.argmin(table.any(axis=1))) + 1
        raise JointIdError(f"pattern: row {row} is zero: no joint moves in this record.")
    table.setflags(write=False)
    return table
