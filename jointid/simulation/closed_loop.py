"""Records of sine experiments on the simulated robot: elastic joints, equation (1), joint control.

Between two events (a control sample, a change of the delayed torque) the motor torque is constant and
the linear dynamics advance exactly, by a matrix exponential. All records advance in parallel.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array, per_joint, whole_number
from jointid.errors import JointIdError
from jointid.gears.gear import Gear
from jointid.gears.laws import nonlinear_laws
from jointid.joints import Elasticity, Inertia
from jointid.records import MotionRecord, SineRecord
from jointid.simulation.experiment import Controller, Excitation, Measurement, MotorFriction
from jointid.simulation.motion import Motion, sampled
from jointid.simulation.robot import Reference, Robot

_LARGEST_LOG_BYTES = 2e9


def simulate_records(
    inertia: Inertia,
    elasticity: Elasticity,
    frequencies_hz: ArrayLike,
    *,
    excitation: Excitation | None = None,
    controller: Controller | None = None,
    friction: MotorFriction | None = None,
    measurement: Measurement | None = None,
    gears: Sequence[Gear] | None = None,
    pose: str | None = None,
    declare_timing: bool = True,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> tuple[SineRecord, ...]:
    """Simulate sine experiments and return their logs.

    Parameters
    ----------
    inertia, elasticity
        The robot, n joints, equation (1).
    frequencies_hz : array_like, shape (f,)
        Excitation frequencies, Hz, below half the sample rate.
    excitation : Excitation, optional
        Reference of the joints; by default n records per frequency in which all joints move.
    controller : Controller, optional
        The joint control.
    friction : MotorFriction, optional
        By default no friction.
    measurement : Measurement, optional
        By default exact.
    gears : sequence of Gear, optional
        Laws of the gears in addition to K and D; by default linear ones. Integrated in steps of
        ``friction.step_s``.
    pose : str, optional
        Name that the records carry.
    declare_timing : bool
        Whether the records state hold and delay of the torque. False: as from a logger without this
        information.
    seed : int
        Seed of the noise: the same seed gives identical arrays.
    progress : callable, optional
        Called about 64 times with the fraction done, up to 1.0; an exception from it ends the run.

    Returns
    -------
    tuple of SineRecord
        R records for each frequency, in the order of the frequencies; labels are "3.00 Hz, record 1".

    Raises
    ------
    JointIdError
        When settings do not match the robot, the closed loop is unstable, or a joint with a superposed
        constant velocity would reverse.
    """
    excitation, controller = excitation or Excitation(), controller or Controller()
    friction, measurement = friction or MotorFriction(), measurement or Measurement()
    frequencies = _frequencies(frequencies_hz, controller.sample_rate_hz)
    seed = whole_number("seed", seed, 0)
    robot = Robot(inertia, elasticity, controller, friction, nonlinear_laws(elasticity.K, gears))
    weights = excitation.weights(robot.n)
    A = excitation.amplitudes(2 * np.pi * frequencies, robot.n)[:, None, :] * weights
    reference = Reference(
        omega=np.repeat(2 * np.pi * frequencies, len(weights)),
        A=A.reshape(-1, robot.n).T,
        velocity=per_joint("constant_velocity_rad_s", excitation.constant_velocity_rad_s, robot.n),
    )
    samples = _record_lengths(excitation, controller, reference.omega / (2 * np.pi))
    settle = excitation.settle_s
    if settle is None:
        settle = robot.settling_time_s() if robot.gears or np.any(robot.coulomb > 0) else 0.0
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
            label=f"{reference.omega[r] / (2 * np.pi):.2f} Hz, record {r % len(weights) + 1}",
            **_stated(controller, pose, declare_timing),
        )
        for r, length in enumerate(samples)
    )


def simulate_motion(
    inertia: Inertia,
    elasticity: Elasticity,
    motion: Motion | None = None,
    *,
    records: int = 2,
    controller: Controller | None = None,
    friction: MotorFriction | None = None,
    measurement: Measurement | None = None,
    gears: Sequence[Gear] | None = None,
    pose: str | None = None,
    declare_timing: bool = True,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> tuple[MotionRecord, ...]:
    """Simulate experiments with any motion and return their logs.

    Parameters
    ----------
    inertia, elasticity
        The robot, n joints, equation (1).
    motion : Motion, optional
        Reference of the joints; by default a sweep.
    records : int
        Number of records, each with different random phases, points or sweep directions.
    controller, friction, measurement, gears, pose, declare_timing, progress
        As in :func:`simulate_records`.
    seed : int
        Seed of the motion and of the noise.

    Returns
    -------
    tuple of MotionRecord

    Raises
    ------
    JointIdError
        When settings do not match the robot, or the closed loop is unstable.
    """
    motion, controller = motion or Motion(), controller or Controller()
    friction, measurement = friction or MotorFriction(), measurement or Measurement()
    seed, records = whole_number("seed", seed, 0), whole_number("records", records, 1, 1000)
    robot = Robot(inertia, elasticity, controller, friction, nonlinear_laws(elasticity.K, gears))
    before = int(np.ceil(2 * robot.settling_time_s() / robot.T))
    length = int(np.ceil(motion.duration_s / robot.T - 1e-6))
    _require_memory(before + length, 2 * robot.n * records)
    reference = sampled(motion, robot.n, records, robot.T, before, seed)
    theta, tau = robot.run(reference, before, length, measurement, seed, progress)
    time = robot.T * np.arange(float(length))
    return tuple(
        MotionRecord(
            time_s=time,
            theta_rad=theta[before:, :, r],
            tau_Nm=tau[before:, :, r],
            label=f"{motion.kind} {r + 1}",
            **_stated(controller, pose, declare_timing),
        )
        for r in range(records)
    )


def _stated(controller: Controller, pose: str | None, declare_timing: bool) -> dict[str, Any]:
    """Pose and timing that a record states."""
    delay = controller.torque_delay_s if declare_timing else 0.0
    return {"torque_hold": declare_timing, "torque_delay_s": delay, "pose": pose}


def _frequencies(values: ArrayLike, sample_rate_hz: float) -> Floats:
    frequencies = finite_array("frequencies_hz", np.atleast_1d(values), ndim=1)
    if frequencies.size == 0:
        raise JointIdError("frequencies_hz is empty: give at least one excitation frequency in Hz.")
    wrong = (frequencies <= 0) | (frequencies >= sample_rate_hz / 2)
    if wrong.any():
        raise JointIdError(
            f"A sine of {frequencies[wrong][0]:g} Hz cannot be simulated: its frequency must be "
            f"positive and below half the sample rate of {sample_rate_hz:g} Hz."
        )
    return frequencies


def _record_lengths(excitation: Excitation, controller: Controller, frequency: Floats) -> np.ndarray:
    """Samples of each record."""
    if excitation.periods is not None:
        if excitation.periods < 1:
            raise JointIdError(f"{excitation.periods:g} periods: a record needs at least one period.")
        duration = excitation.periods / frequency
    else:
        duration = np.full(frequency.shape, excitation.duration_s)
    samples = np.ceil(duration * controller.sample_rate_hz - 1e-6).astype(int)
    if np.any(samples * frequency < controller.sample_rate_hz):
        slowest = float(frequency.min())
        raise JointIdError(
            f"A record of {excitation.duration_s:g} s is less than one period of {slowest:g} Hz "
            f"({1 / slowest:.4g} s). Record longer, or raise the lowest frequency."
        )
    return samples


def _require_memory(samples: int, channels: int) -> None:
    needed = 2 * 8.0 * samples * channels
    if needed > _LARGEST_LOG_BYTES:
        raise JointIdError(
            f"The logs, with {samples} samples per record, would take "
            f"{needed / 1e9:.1f} GB; the limit is {_LARGEST_LOG_BYTES / 1e9:g} GB. "
            "Shorten the records, or simulate fewer at a time."
        )


LOADED = "loaded"
"""Pose of the records with the payload."""


class Campaign(NamedTuple):
    """Records, and the inertias that a study of them is given."""

    records: tuple[SineRecord | MotionRecord, ...]
    inertia: Inertia
    poses: dict[str, Inertia]


def simulate_campaign(
    inertia: Inertia,
    elasticity: Elasticity,
    experiment: ArrayLike | Motion,
    *,
    inertia_error: float = 0.0,
    added: ArrayLike | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    **settings: Any,
) -> Campaign:
    """Simulate the records of a study, with the errors that given inertias have.

    ``experiment`` holds the frequencies of the sines, shape (f,), Hz, or is another motion;
    ``inertia_error`` is the share by which the given inertias differ from the robot's, see
    ``with_inertia_error``. With ``added``, the addition of a payload to M2, shape (n, n), kg·m², all
    experiments are made a second time with it, as records of the pose "loaded", and it is given exactly.
    ``seed`` is that of the noise and of the signs of ``inertia_error``; ``progress`` is called with the
    fraction done, up to 1.0; ``settings`` are further ones of ``simulate_records`` or
    ``simulate_motion``.

    Raises JointIdError when the settings do not match the robot.
    """
    seed = whole_number("seed", seed, 0)
    given = with_inertia_error(inertia, inertia_error, seed)
    robots = {None: inertia} | ({} if added is None else {LOADED: inertia.with_added(added)})
    records: list[SineRecord | MotionRecord] = []
    for k, (pose, robot) in enumerate(robots.items()):

        def report(done: float, before: int = k) -> None:
            if progress is not None:
                progress((before + done) / len(robots))

        own = seed if pose is None else int(np.random.SeedSequence(seed).generate_state(1)[0])
        settings |= {"pose": pose, "seed": own, "progress": report}
        simulate: Any = simulate_motion if isinstance(experiment, Motion) else simulate_records
        records += simulate(robot, elasticity, experiment, **settings)
    poses = {} if added is None else {LOADED: given.with_added(added)}
    return Campaign(tuple(records), given, poses)


def with_inertia_error(inertia: Inertia, error: float, seed: int = 0) -> Inertia:
    """Return the inertia with every rotor and arm inertia off by a share, up or down at random.

    A coupling inertia is off by the geometric mean of the factors of its two joints, so that M2 stays
    positive definite; ``inertia.added`` stays exact. Raises JointIdError when the share is not in 0 to
    below 1.
    """
    if not 0 <= error < 1:
        raise JointIdError(f"inertia_error = {error!r:.40}: expected 0 ≤ relative error < 1.")
    signs = np.random.default_rng([seed, inertia.n]).choice([-1.0, 1.0], (2, inertia.n))
    factor = 1 + error * signs
    rest = (inertia.M2 - inertia.added) * np.sqrt(np.outer(factor[1], factor[1]))
    return replace(inertia, M=inertia.M * factor[0], M2=rest + inertia.added)
