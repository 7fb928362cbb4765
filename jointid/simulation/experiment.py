"""Settings of an experiment on the simulated robot: control, excitation, friction and sensors."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Complexes, Floats, finite_array, per_joint, whole_number
from jointid.errors import JointIdError
from jointid.wording import counted

_LONGEST_DELAY_S = 0.1
"""Longer delays are errors of the unit, and make the closed loop a large matrix."""
PerJoint: TypeAlias = float | Sequence[float] | Floats
"""One number for all joints, or one per joint."""


@dataclass(frozen=True, eq=False)
class Controller:
    """Sampled, decentralised position and velocity control, with torque feedforward.

    With the reference r, the encoder position y and the control interval T, sample k commands
    τ = kp (r − y) + kv (Δr − Δy)/T + (M + M2) r̈, where Δ is the difference from sample k − 1.
    The defaults kp = J ω², kv = 2ζ J ω are those of the rigid joint, J = J_m + J_a and ω = 2π bandwidth.
    Raises JointIdError when a value is out of range.
    """

    bandwidth_hz: PerJoint = 10.0
    """Natural frequency of the controlled rigid joint, Hz."""
    damping_ratio: PerJoint = 0.5
    """Its damping ratio ζ."""
    position_gain: PerJoint | None = None
    """kp, N·m/rad, in place of that from bandwidth and damping ratio."""
    velocity_gain: PerJoint | None = None
    """kv, N·m·s/rad, likewise."""
    feedforward: bool = True
    """Whether the rigid-body torque of the reference acceleration is added."""
    sample_rate_hz: float = 4000.0
    """Control rate, which is also the rate of the log, Hz."""
    torque_delay_s: float = 0.0
    """Delay from a sample to the action of the torque computed from it, s. Need not be a whole number of
    samples."""

    def __post_init__(self) -> None:
        checked_setting(self, "bandwidth_hz", "Hz", positive=True)
        checked_setting(self, "damping_ratio", "", positive=True)
        checked_setting(self, "position_gain", "N·m/rad", positive=True)
        checked_setting(self, "velocity_gain", "N·m·s/rad", positive=True)
        checked_setting(self, "sample_rate_hz", "Hz", positive=True, single=True)
        checked_setting(self, "torque_delay_s", "s", single=True)
        if self.torque_delay_s > _LONGEST_DELAY_S:
            raise JointIdError(
                f"torque_delay_s = {self.torque_delay_s:g} s: more than {_LONGEST_DELAY_S:g} s cannot "
                "be simulated. Check the unit (seconds)."
            )


@dataclass(frozen=True, eq=False)
class Excitation:
    """Reference sine of every joint, and its duration.

    The reference of joint j in record r is Im(A_fj W_rj e^{iωt}) + v_j t, with t = 0 at the first
    logged sample. The amplitude A = min(velocity/ω, acceleration/ω²) bounds speed and rigid-body torque.
    Raises JointIdError when a value is out of range, or the pattern is unknown.
    """

    pattern: str | ArrayLike = "orthogonal"
    """The weights W, shape (R, n), complex, or their name. "orthogonal": e^{2πi rj/R}: all joints move
    in every record, with different relative phases. "one-at-a-time": record r moves joint r; the
    controllers hold the others."""
    records_per_frequency: int | None = None
    """R; by default n, or the rows of ``pattern``."""
    velocity_rad_s: PerJoint = 10.0
    """Largest velocity amplitude of the reference, motor side, rad/s."""
    acceleration_rad_s2: PerJoint = 300.0
    """Largest acceleration amplitude of the reference, motor side, rad/s²."""
    constant_velocity_rad_s: PerJoint = 0.0
    """Superposed constant velocity v, rad/s. A joint with a constant velocity must not reverse."""
    duration_s: float = 4.0
    """Length of each record, s."""
    periods: float | None = None
    """Length of each record in periods of its frequency, in place of ``duration_s``."""
    settle_s: float | None = None
    """Time before the log begins, s. The run starts in the steady state of the robot without Coulomb
    friction. By default long enough for the slowest mode of the closed loop to decay to 1e-5, and zero
    without Coulomb friction."""

    def __post_init__(self) -> None:
        if not isinstance(self.pattern, str):
            object.__setattr__(self, "pattern", _weights_table(self.pattern))
        elif self.pattern not in ("orthogonal", "one-at-a-time"):
            raise JointIdError(
                f'pattern = "{self.pattern}": expected "orthogonal", "one-at-a-time" or a table of '
                "complex weights, one row per record and one column per joint."
            )
        if self.records_per_frequency is not None:
            whole_number("records_per_frequency", self.records_per_frequency, 1, 1000)
        checked_setting(self, "velocity_rad_s", "rad/s", positive=True)
        checked_setting(self, "acceleration_rad_s2", "rad/s²", positive=True)
        checked_setting(self, "constant_velocity_rad_s", "rad/s", signed=True)
        checked_setting(self, "duration_s", "s", positive=True, single=True)
        checked_setting(self, "periods", "", positive=True, single=True)
        checked_setting(self, "settle_s", "s", single=True)

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
                f"and {counted(n, 'column')}, one per joint."
            )
        return table

    def amplitudes(self, omega: Floats, n: int) -> Floats:
        """Position amplitudes A of the joints' sines, shape (f, n), rad."""
        velocity = per_joint("velocity_rad_s", self.velocity_rad_s, n)
        acceleration = per_joint("acceleration_rad_s2", self.acceleration_rad_s2, n)
        return np.minimum(velocity / omega[:, None], acceleration / omega[:, None] ** 2)


@dataclass(frozen=True, eq=False)
class MotorFriction:
    """Friction at each motor, (F_c + μ|g|) sign(θ̇) + F_v θ̇, with the torque g through its gear.

    Viscous friction at the arm is added. A motor at rest stays there until the other torques on it
    exceed F_c + μ|g|. Raises JointIdError when a value is negative or the step is not positive.
    """

    coulomb: PerJoint = 0.0
    """F_c, N·m."""
    viscous: PerJoint = 0.0
    """F_v, N·m·s/rad."""
    load: PerJoint = 0.0
    """μ, share of the torque through the gear."""
    step_s: float = 1.25e-4
    """Longest step if F_c or μ is not 0, s. A reversal is located within its step, so that the error is
    of second order: about 1e-4 of the friction phasor up to 30 Hz with the default."""
    arm_viscous: PerJoint = 0.0
    """Viscous friction at the arm, motor side, N·m·s/rad."""

    def __post_init__(self) -> None:
        checked_setting(self, "coulomb", "N·m")
        checked_setting(self, "viscous", "N·m·s/rad")
        checked_setting(self, "arm_viscous", "N·m·s/rad")
        checked_setting(self, "load", "")
        checked_setting(self, "step_s", "s", positive=True, single=True)


@dataclass(frozen=True, eq=False)
class Measurement:
    """Sensors of position and torque; the controller uses the logged position.

    Raises JointIdError when a value is out of range.
    """

    encoder_counts: int | None = None
    """Encoder counts per motor turn; None is an ideal encoder."""
    position_noise_rad: PerJoint = 0.0
    """Standard deviation of white noise on the position, before rounding by the encoder, rad."""
    torque_noise_Nm: PerJoint = 0.0
    """Standard deviation of white noise on the logged torque, not on the motor's, N·m."""
    torque_gain: PerJoint = 1.0
    """Logged torque over the motor's: 1.05 when the controller's torque constant is 5 % too large. The
    noise is added afterwards."""

    def __post_init__(self) -> None:
        checked_setting(self, "encoder_counts", "per turn", positive=True, single=True)
        checked_setting(self, "position_noise_rad", "rad")
        checked_setting(self, "torque_noise_Nm", "N·m")
        checked_setting(self, "torque_gain", "", positive=True)


def checked_setting(
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
        raise JointIdError(f"{what}: expected one number, got an array of {array.size}.")
    wrong = np.zeros(array.shape, bool) if signed else array <= 0 if positive else array < 0
    if array.size == 0 or wrong.any():
        shown = f"{array[wrong][0]:g}" if array.size else "empty"
        rule = "be positive" if positive else "not be negative"
        raise JointIdError(f"{what} is {shown}: it must {rule}.")
    object.__setattr__(settings, name, float(array[0]) if scalar else array)


def _weights_table(value: ArrayLike) -> Complexes:
    try:
        table = np.array(value, dtype=np.complex128)
    except (TypeError, ValueError):
        table = np.empty(0, dtype=np.complex128)
    if table.ndim != 2 or table.size == 0 or not np.isfinite(table).all():
        raise JointIdError(
            "pattern: expected finite complex weights, one row per record and one column per joint; "
            f"got {value!r:.80}."
        )
    if not table.any(axis=1).all():
        row = int(np.argmin(table.any(axis=1))) + 1
        raise JointIdError(f"pattern: row {row} is zero: no joint moves in this record.")
    table.setflags(write=False)
    return table
