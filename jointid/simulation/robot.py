"""The simulated robot: arm, motors and sampled joint control, exact between the samples.

Small motions around one pose: gravity as a stiffness, and no velocity coupling.
"""

from collections import deque
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from jointid.arrays import Complexes, Floats, per_joint
from jointid.errors import JointIdError
from jointid.gears.laws import GearLaws
from jointid.joints import Elasticity, Inertia, require_same_joints
from jointid.simulation.experiment import Controller, Measurement, MotorFriction
from jointid.simulation.motion import SampledReference
from jointid.simulation.motor_dynamics import (
    Step,
    constant_torque,
    gear_input,
    plant,
    slide,
    step_with_friction,
)

_CHUNKS = 64
"""Calls of a progress function per run."""
_SETTLED = 1e-5
"""Share of a transient that may remain when the log begins."""


class Reference(NamedTuple):
    """r(t) = Im(A e^{iωt}) + vt of n joints in R records."""

    omega: Floats  # (R,)
    A: Complexes  # (n, R)
    velocity: Floats  # (n,)

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """Position and acceleration, each (N, n, R)."""
        sine = np.imag(self.A * np.exp(1j * np.multiply.outer(time, self.omega))[:, None, :])
        return sine + np.multiply.outer(time, self.velocity)[:, :, None], -(self.omega**2) * sine


class Robot:
    """Arm, motors and joint control; sampled, exact between the samples."""

    def __init__(
        self,
        inertia: Inertia,
        elasticity: Elasticity,
        controller: Controller,
        friction: MotorFriction,
        gears: GearLaws | None = None,
    ) -> None:
        require_same_joints(inertia, elasticity)
        n = self.n = inertia.n
        self.T = 1 / controller.sample_rate_hz
        self.inertia, self.elasticity = inertia, elasticity
        self.coulomb = per_joint("coulomb", friction.coulomb, n)[:, None]
        self.viscous = per_joint("viscous", friction.viscous, n)
        self.load = per_joint("load", friction.load, n)[:, None]
        self.has_load = bool(np.any(self.load > 0))
        self.has_friction = self.has_load or bool(np.any(self.coulomb > 0))
        self.kp, self.kv = _gains(controller, inertia)
        self.feedforward = controller.feedforward * (np.diag(inertia.M) + inertia.M2)
        whole = int(controller.torque_delay_s / self.T + 1e-9)
        share = max(controller.torque_delay_s / self.T - whole, 0.0)
        self.delay = whole  # in samples; the older torque acts for a share of the sample longer
        arm_viscous = per_joint("arm_viscous", friction.arm_viscous, n)
        self.A, self.B = plant(inertia, elasticity, self.viscous, arm_viscous)
        self.gears = gears
        inputs = self.B if gears is None else np.hstack([self.B, gear_input(inertia)])
        longest = self.T if gears is None and not self.has_friction else friction.step_s
        self.steps: list[Step] = []
        for part, older in [(share, True), (1 - share, False)]:
            if part > 1e-9:
                count = int(np.ceil(part * self.T / longest - 1e-9))
                self.steps.append(constant_torque(self.A, inputs, part * self.T / count, older, count))
        self.closed, self.drive = self._closed_loop()
        self._require_stable()

    def settling_time_s(self) -> float:
        """Time in which the slowest mode of the closed loop decays to 1e-5, s."""
        slowest = np.abs(np.linalg.eigvals(self.closed)).max()
        return float(np.log(_SETTLED) / np.log(slowest) * self.T)

    def run(
        self,
        reference: Reference | SampledReference,
        before: int,
        samples: int,
        measurement: Measurement,
        seed: int,
        progress: Callable[[float], None] | None,
    ) -> tuple[Floats, Floats]:
        """Log ``before`` samples ahead of t = 0 and ``samples`` after it: θ and τ, (N, n, R)."""
        n, shape = self.n, (before + samples, *reference.at(np.zeros(1))[0].shape[1:])
        theta, tau = np.empty(shape), np.empty(shape)
        if isinstance(reference, Reference):
            Z, y_before, torques = self._steady_state(reference, -before)
        else:  # at rest, with the springs relaxed
            Z = np.zeros((self.steps[0].EG.shape[1], shape[2]))
            y_before = np.zeros(shape[1:])
            torques = deque([y_before] * (self.delay + 1), maxlen=self.delay + 2)
        motor, arm, motor_rate, arm_rate, acting, *of_gears = Z.reshape(-1, *shape[1:])  # views
        loop = np.zeros_like(y_before)
        seeds = np.random.SeedSequence(seed).spawn(2)
        position_source, torque_source = map(np.random.default_rng, seeds)
        position_noise = per_joint("position_noise_rad", measurement.position_noise_rad, n)
        torque_noise = per_joint("torque_noise_Nm", measurement.torque_noise_Nm, n)
        torque_gain = per_joint("torque_gain", measurement.torque_gain, n)[:, None]
        count = 2 * np.pi / measurement.encoder_counts if measurement.encoder_counts else 0.0
        proportional, difference = (self.kp + self.kv / self.T)[:, None], (self.kv / self.T)[:, None]
        K, D, level = self.elasticity.K[:, None], self.elasticity.D[:, None], self.coulomb
        constant = self.has_friction and not self.has_load and self.gears is None
        bounds = np.unique(np.linspace(0, shape[0], _CHUNKS + 1).astype(int))
        for first, last in pairwise(bounds.tolist()):
            feed = self._feed(reference, np.arange(first, last) - before)
            disturbed = _noise(position_source, position_noise, feed.shape)
            for k in range(last - first):
                y = motor + disturbed[k]
                if count:
                    y = np.rint(y / count) * count
                torque = feed[k] - proportional * y + difference * y_before
                theta[first + k], tau[first + k] = y, torque
                y_before = y
                torques.append(torque)
                for step in self.steps:
                    acting[:] = torque = torques[0 if step.older else 1]
                    if constant and slide(Z, step, level):
                        continue
                    for _ in range(step.steps):
                        acting[:] = torque
                        delta, rate = motor - arm, motor_rate - arm_rate
                        moved = 0.5 * step.duration_s * rate  # to the middle of the step
                        if self.gears is not None:
                            middle = self.gears.loop(loop, moved)
                            of_gears[0][:] = self.gears.beyond_linear(delta + moved, middle)
                        if self.has_load:
                            passed = sum(of_gears, K * (delta + moved) + D * rate)
                            level = self.coulomb + self.load * np.abs(passed)
                        if self.has_friction:
                            step_with_friction(Z, step, level)
                        else:
                            Z[: 4 * n] = step.EG @ Z
                        if self.gears is not None:
                            loop = self.gears.loop(loop, motor - arm - delta)
            tau[first:last] *= torque_gain
            tau[first:last] += _noise(torque_source, torque_noise, feed.shape)
            if progress is not None:
                progress(float(last / shape[0]))
        return theta, tau

    def _feed(self, reference: Reference | SampledReference, k: np.ndarray) -> Floats:
        """The part of the commanded torque that does not depend on the encoder, (N, n, R)."""
        position, acceleration = reference.at(k * self.T)
        past, _ = reference.at((k - 1) * self.T)
        kp, kv = self.kp[:, None], self.kv[:, None]
        control = kp * position + kv * (position - past) / self.T
        return np.asarray(control + self.feedforward @ acceleration)

    def _closed_loop(self) -> tuple[Floats, Floats]:
        """Exact linear closed loop: s ← closed s + drive w with s = x, last y, last torques.

        w is the part of the torque that comes from the reference.
        """
        n, delay = self.n, self.delay
        size = 5 * n + (delay + 1) * n
        plant = np.eye(4 * n, size + n)  # x after the sample from s and the new torque
        for step in self.steps:
            E, G, older = step.all_EG[:, : 4 * n], step.all_EG[:, 4 * n : 5 * n], step.older
            plant = E @ plant
            # Torque columns run from the newest of s to the oldest; the new one follows s.
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
                f"{largest:.6f} and must stay below 1. Lower the bandwidth or the gains, shorten the "
                f"torque delay, or raise the sample rate ({1 / self.T:g} Hz)."
            )

    def _steady_state(self, reference: Reference, k: int) -> tuple[Floats, Floats, deque[Floats]]:
        """State, last encoder position and last torques at sample k, in steady state.

        Coulomb friction enters only if a constant velocity determines its sign.
        """
        n, (omega, A, velocity) = self.n, reference
        z = np.exp(1j * omega * self.T)
        w = (self.kp[:, None] + (self.kv / self.T)[:, None] * (1 - 1 / z)) * A
        w -= omega**2 * (self.feedforward @ A)
        loop = z[:, None, None] * np.eye(len(self.closed)) - self.closed
        S = np.linalg.solve(loop, (self.drive @ w).T[:, :, None])[:, :, 0].T
        amplitude = np.abs(omega * S[:n]).max(axis=1)
        reverses = (velocity != 0) & (np.abs(velocity) <= amplitude)
        if reverses.any():
            j = int(np.argmax(reverses))
            raise JointIdError(
                f"constant_velocity_rad_s of joint {j + 1} is {velocity[j]:g} rad/s, but its sine "
                f"reaches {amplitude[j]:.3g} rad/s: the joint would reverse. Raise it, or lower the "
                "amplitude."
            )
        if velocity.any() and self.inertia.gravity.any():
            raise JointIdError(
                "constant_velocity_rad_s is not 0 and gravity acts: the pose changes. Set one to 0."
            )
        state = np.imag(S * z**k)
        # At constant velocity motor and arm travel together and the controller balances friction.
        load = self.coulomb[:, 0] * np.sign(velocity) + self.viscous * velocity
        lag = load / self.kp
        now = velocity * k * self.T - lag
        drift = [now, now, velocity, velocity, now - velocity * self.T, *[load] * (self.delay + 1)]
        state += np.concatenate(drift)[:, None]
        history = [state[start : start + n] for start in range(5 * n, len(state), n)]
        Z = np.vstack([state[: 4 * n], *[np.zeros_like(A.real)] * (1 if self.gears is None else 2)])
        return Z, state[4 * n : 5 * n], deque(reversed(history), maxlen=self.delay + 2)


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


def _noise(source: np.random.Generator, std: Floats, shape: tuple[int, ...]) -> Floats:
    """White noise of each joint's standard deviation, (N, n, R)."""
    return std[:, None] * source.standard_normal(shape) if std.any() else np.zeros(shape)
