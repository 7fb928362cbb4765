"""A six-axis robot with elastic gears and a second encoder, by its inverse dynamics: no integration.

The links follow given curves; torque through the gear, deflection, transmission error and friction then
give the motor's angle exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid import MotionRecord, RobotModel
from tests.robots import SIX_AXES

ARC_SECOND = np.pi / 180 / 3600
ROBOT = RobotModel.parse("six.toml", SIX_AXES.encode())
SENSORS = 3


@dataclass(frozen=True)
class Truth:
    """True values of the robot; joint side, the joints with a sensor behind the gear."""

    K: np.ndarray
    skew_s: np.ndarray
    payload_kg: float
    damping_s: float = 1e-3
    """D over K."""
    eccentricity: float = 10.0
    ripple: float = 3.0
    teeth: float = 5.0
    hysteresis: float = 5.0
    """Amplitudes of errors over the position, and half the hysteresis, seconds of arc."""
    rest: float = 0.0
    """Deflection of a joint that hardly moves, seconds of arc."""
    vibration: float = 1.0
    """Coloured noise of the arm's encoder, seconds of arc."""
    resolution_rad: float = 1e-7
    shape_seed: int = 0
    """Of phases and orders of the transmission error."""

    def transmission_error(self, q: np.ndarray) -> np.ndarray:
        rng = np.random.default_rng(self.shape_seed)
        error = np.zeros_like(q)
        for size, low, high, count in (
            (self.eccentricity, 1, 1, 1),
            (self.eccentricity / 2, 2, 2, 1),
            (self.ripple, 30, 80, 2),
            (self.teeth, 500, 900, 1),
        ):
            for _ in range(count):
                order = np.round(rng.uniform(low, high, q.shape[1]))
                phase = rng.uniform(0, 2 * np.pi, q.shape[1])
                error += size * ARC_SECOND * np.cos(order * q + phase)
        return error


def random_truth(rng: np.random.Generator, **changes: object) -> Truth:
    values = {
        "K": rng.uniform(2e6, 8e6, SENSORS),
        "skew_s": np.full(SENSORS, rng.uniform(0, 5e-3)),
        "payload_kg": 120.0 + 40.0 * rng.uniform(-1, 1),
        "shape_seed": int(rng.integers(1 << 30)),
    }
    return Truth(**(values | changes))  # type: ignore[arg-type]


def motion_record(
    truth: Truth,
    seed: int,
    seconds: float = 20.0,
    rate_hz: float = 250.0,
    creep_deg: float = 0.0,
    amplitude: float = 1.0,
) -> MotionRecord:
    """Joints 1 to 6 in slow random motion from rest to rest; sensors on the first three.

    With ``creep_deg``, joint 3 makes one slow move there and back of at most so many degrees.
    ``amplitude`` scales the motion of all joints.
    """
    rng = np.random.default_rng(seed)
    T = min(rng.uniform(1.5, 3.0), seconds / 2)  # no jump of the velocity
    hertz = rng.uniform(0.1, 0.8, (4, 6))
    size = amplitude * np.deg2rad(rng.uniform(4, 14, (4, 6))) / (1 + 2 * hertz)
    if creep_deg:
        hertz[:, 2], size[:, 2] = 0.5 / seconds, np.deg2rad(creep_deg) / 4
    phase = rng.uniform(0, 2 * np.pi, (4, 6))

    def links(t: np.ndarray) -> np.ndarray:
        ramp = np.clip(np.minimum(t, seconds - t) / T, 0, 1)
        ramp = ramp**4 * (35 - 84 * ramp + 70 * ramp**2 - 20 * ramp**3)
        wave = size * np.sin(2 * np.pi * hertz * t[:, None, None] + phase)
        return np.deg2rad([5, -20, 15, 10, 30, 0]) + ramp[:, None] * wave.sum(axis=1)

    t = np.arange(int(seconds * rate_hz) + 1) / rate_hz
    h = 1e-3

    def torque(t: np.ndarray) -> np.ndarray:
        q, before, after = links(t), links(t - h), links(t + h)
        loaded = ROBOT.with_payload(mass=truth.payload_kg)
        return loaded.torque(q, (after - before) / (2 * h), (after - 2 * q + before) / h**2)

    def motors(t: np.ndarray) -> np.ndarray:
        q, velocity = links(t), (links(t + h) - links(t - h)) / (2 * h)
        s, change = torque(t), (torque(t + h) - torque(t - h)) / (2 * h)
        K = np.r_[truth.K, np.full(6 - truth.K.size, 1e6)]
        friction = truth.hysteresis * np.tanh(velocity / 3e-3)
        friction += truth.rest * np.exp(-np.abs(velocity) / 0.01)
        error = friction * ARC_SECOND + truth.transmission_error(q)
        return q + (s - truth.damping_s * change) / K + error

    N, J = ROBOT.gear_ratio, ROBOT.rotor_inertia
    before, theta, after = (motors(t + shift) for shift in (-h, 0, h))
    acceleration = (after - 2 * theta + before) / h**2
    velocity = (after - before) / (2 * h)
    tau = torque(t) / N + J * N * acceleration + 1.5 * np.tanh(velocity / 3e-3) + 5 * velocity
    arm = np.full(theta.shape, np.nan)
    noise = np.zeros((t.size, truth.K.size))
    for i in range(2, t.size):  # a lightly damped structure near 10 Hz
        noise[i] = 1.88 * noise[i - 1] - 0.942 * noise[i - 2] + rng.normal(size=truth.K.size)
    noise *= truth.vibration * ARC_SECOND / noise.std()
    for j in range(truth.K.size):
        arm[:, j] = links(t - truth.skew_s[j])[:, j] + noise[:, j] + 1e-3 * (j + 1)
        arm[:, j] = np.round(arm[:, j] / truth.resolution_rad) * truth.resolution_rad
    theta = np.round(theta * N / 1e-5) * 1e-5
    tau = tau + rng.normal(size=tau.shape) * 0.05
    return MotionRecord(time_s=t, theta_rad=theta, tau_Nm=tau, arm_rad=arm)
