"""The simulated robot: n elastic joints, equation (1), under sampled joint control → sine records.

The robot stands in the horizontal plane: no gravity, and small motions, so no velocity coupling.
Between two events (a control sample, a change of the delayed torque) the motor torque is constant and
the linear dynamics advance exactly, by a matrix exponential. All records advance together.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from jointid.arrays import Complexes, Floats, finite_array
from jointid.errors import JointIdError
from jointid.experiment import Controller, Excitation, Measurement, MotorFriction, per_joint
from jointid.joints import Elasticity, Inertia
from jointid.records import SineRecord
from jointid.wording import counted

_CHUNKS = 64
_LARGEST_LOG_BYTES = 2e9
_SETTLED = 1e-5


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
        velocity=per_joint("constant_velocity_rad_s", excitation.constant_velocity_rad_s, robot.n),
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
                f"The inertia has {counted(inertia.n, 'joint')}, the elasticity {elasticity.n}: "
                "they must agree."
            )
        n = self.n = inertia.n
        self.T = 1 / controller.sample_rate_hz
        self.inertia, self.elasticity = inertia, elasticity
        self.coulomb = per_joint("coulomb", friction.coulomb, n)[:, None]
        self.viscous = per_joint("viscous", friction.viscous, n)
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
            (np.random.default_rng(s), per_joint(name, std, n)[:, None])
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
    omega = 2 * np.pi * per_joint("bandwidth_hz", controller.bandwidth_hz, n)
    zeta = per_joint("damping_ratio", controller.damping_ratio, n)
    kp, kv = J * omega**2, 2 * zeta * J * omega
    if controller.position_gain is not None:
        kp = per_joint("position_gain", controller.position_gain, n)
    if controller.velocity_gain is not None:
        kv = per_joint("velocity_gain", controller.velocity_gain, n)
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
