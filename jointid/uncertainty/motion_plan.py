"""Planning of motions: expected errors of K and D from a sweep or a multisine within limits."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jointid.arrays import Floats, per_joint
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.estimation.identify_motion import identify_motion
from jointid.gears.gear import Gear
from jointid.joints import Inertia, resonances
from jointid.records import MotionRecord, SineRecord
from jointid.simulation.closed_loop import simulate_motion
from jointid.simulation.experiment import Controller, Measurement, MotorFriction
from jointid.simulation.motion import Motion
from jointid.small_matrices import determined_covariance
from jointid.uncertainty.chosen_model import identified_friction
from jointid.wording import enumerated, significant

_ROUNDS, _MOST_ROUNDS = 4, 10
"""Iterations of the amplitude for the limits without Coulomb friction and noise, and with both; these
make it nonlinear."""
_LEAST = 1e-9
"""Least torque beyond Coulomb friction, over the limit."""
_RESERVE = 0.99
"""Share of the limits to which a motion beyond them is reduced."""
_SHARED = "K", "D", "M", "M2", "torque_scale"
"""Parameters that records of the same robot and pose have in common."""
_BANDWIDTHS_HZ = (10.0, 4.0, 1.5)
"""Bandwidths tried for the controllers of the simulation; only the resulting motion matters."""


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Largest motion of each joint, motor side, and torque, each shape (n,)."""

    position_rad: Floats
    velocity_rad_s: Floats
    torque_Nm: Floats


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """A motion with its predicted errors."""

    motion: Motion
    records: tuple[MotionRecord, ...]
    """Simulated with the identified robot: the reference to follow, and the torque that it takes."""
    names: tuple[str, ...]
    """K1 ... Kn, D1 ... Dn."""
    alone: Floats
    """Relative standard errors from these records alone, shape (2n,)."""
    together: Floats
    """Relative standard errors together with the records so far, shape (2n,)."""

    @property
    def duration_s(self) -> float:
        """Length of all records, s."""
        return float(sum(record.samples * record.interval_s for record in self.records))


def sensor_noise(fit: ElasticityFit, interval_s: float) -> Floats:
    """Standard deviation of white noise in each sample of the angles and torques, shape (2n,)."""
    phasors = fit.phasors
    variance = phasors.standard_deviation**2 * (phasors.duration_s / interval_s)[:, None] / 4
    return np.asarray(np.sqrt(np.median(variance, axis=0)))


def largest_motion(records: Sequence[SineRecord | MotionRecord]) -> MotionLimits:
    """Return the largest distance from the middle, velocity and torque of each joint in the records."""
    position, velocity, torque = [], [], []
    for record in records:
        used = slice(record.start, None)
        theta, step = record.theta_rad[used], max(1, round(2e-3 / record.interval_s))
        position.append(np.ptp(theta, axis=0) / 2)
        speed = (theta[step:] - theta[:-step]) / (step * record.interval_s)
        velocity.append(np.abs(speed - speed.mean(axis=0)).max(axis=0, initial=0.0))
        torque.append(np.abs(record.tau_Nm[used]).max(axis=0))
    return MotionLimits(*(np.max(each, axis=0) for each in (position, velocity, torque)))


def plan_motion(
    fit: ElasticityFit,
    inertia: Inertia,
    motion: Motion,
    limits: MotionLimits,
    *,
    interval_s: float,
    records: int = 2,
) -> PlannedMotion:
    """Predict the errors of K and D from a motion within limits.

    The identified robot is simulated with this motion, with the sensor noise of the fit, and the
    estimator states its errors; inertias and torque scale are fitted as in the study, and errors
    together with the records so far are those of springs and inertias that are the same in both.
    ``fit`` is the answer so far, ``inertia`` that given at the pose of the motion, whose own limits
    ``limits`` replaces. Raises JointIdError when the torque does not overcome the friction, or the
    motion does not determine the springs.
    """
    n, friction = fit.n, identified_friction(fit, step_s=max(interval_s, 1.25e-4))
    blocked = limits.torque_Nm <= friction.coulomb
    if blocked.any():
        j = int(np.argmax(blocked)) + 1
        raise JointIdError(f"The torque limit of joint {j} does not exceed its friction: raise it.")
    noise = sensor_noise(fit, interval_s)
    measurement = Measurement(position_noise_rad=noise[:n], torque_noise_Nm=noise[n:])
    chosen, made = _within(fit, motion, limits, friction, measurement, interval_s, records)
    prior, gear = fit.prior, "linear" if _gears(fit) is None else "auto"
    try:
        found = identify_motion(
            made, inertia, inertia_std=prior.inertia_std, torque_std=prior.torque_std, gear=gear
        )
    except JointIdError as error:  # it is about records, which nobody has made yet
        raise _too_little(fit, chosen) from error
    size = np.abs(fit.estimate)
    known = np.isfinite(fit.standard_error) | np.isfinite(found.standard_error)
    together = np.where(known, _together(fit, found), np.inf)
    with np.errstate(divide="ignore"):
        return PlannedMotion(
            chosen, made, elasticity_labels(n), found.standard_error / size, together / size
        )


def _too_little(fit: ElasticityFit, motion: Motion) -> JointIdError:
    """Say why a motion does not determine the springs, and which setting helps."""
    of_robot, hertz = resonances(fit.inertias[0], fit.elasticity), f"{motion.to_hz:g} Hz"
    missed = of_robot[(of_robot < motion.from_hz) | (of_robot > motion.to_hz)]
    what = (
        f"The planned {motion.kind} from {motion.from_hz:g} to {hertz} does not determine every spring"
    )
    if not missed.size:
        return JointIdError(
            f"{what} within its limits, although it reaches all resonances: raise the limits of "
            "position, velocity or torque, or the duration."
        )
    ends = {
        "lower the lowest frequency (from_hz) to {:.2g} Hz": (missed < motion.from_hz, missed.min() / 2),
        "raise the highest frequency (to_hz) to {:.3g} Hz": (missed > motion.to_hz, 1.2 * missed.max()),
    }
    remedy = " and ".join(text.format(value) for text, (mask, value) in ends.items() if mask.any())
    return JointIdError(f"{what}: it misses {_hertz(missed)}. To reach all resonances, {remedy}.")


def _hertz(missed: Floats) -> str:
    names = enumerated([significant(float(each), 3) for each in missed])
    return f"the resonance{'s' * (missed.size > 1)} at {names} Hz"


def _together(fit: ElasticityFit, found: ElasticityFit) -> Floats:
    """Standard errors of K and D from both fits, (2n,): of the same springs, inertias and torque scales.

    The prior of these is in both fits, and counts once.
    """
    shapes = [{b.name: b.shape for b in each.parameters.layout.blocks} for each in (fit, found)]
    names = [name for name in _SHARED if name in shapes[0] and shapes[0][name] == shapes[1].get(name)]
    one, other = (_information(_covariance(each, names)) for each in (fit, found))
    information, first = one + other, 2 * fit.n
    for name in names[2:]:
        prior = found.prior.information(name)
        own = slice(first, first + len(prior))
        information[own, own] -= prior
        first = own.stop
    return np.asarray(np.sqrt(np.diag(determined_covariance(information))[: 2 * fit.n]))


def _covariance(fit: ElasticityFit, names: Sequence[str]) -> Floats:
    """Covariance of some parameters, K and D first, whose own is the whole one."""
    layout, own = fit.parameters.layout, slice(2 * fit.n)
    place = np.concatenate([np.arange(layout.size)[layout[name]] for name in names])
    found = np.array(fit.parameter_covariance[np.ix_(place, place)])
    found[own, own] = fit.covariance
    return found


def _information(covariance: Floats) -> Floats:
    """Inverse of a covariance; zero for parameters that are not known."""
    known = np.isfinite(np.diag(covariance)) & (np.diag(covariance) > 0)
    size = np.sqrt(np.where(known, np.diag(covariance), 1.0))
    unit = np.where(np.outer(known, known), covariance, np.eye(size.size)) / np.outer(size, size)
    return np.asarray(np.linalg.pinv(unit) / np.outer(size, size) * np.outer(known, known))


def _within(
    fit: ElasticityFit,
    motion: Motion,
    limits: MotionLimits,
    friction: MotorFriction,
    measurement: Measurement,
    interval_s: float,
    records: int,
) -> tuple[Motion, tuple[MotionRecord, ...]]:
    """The motion with the largest acceleration that keeps the limits, and its simulated records."""
    acceleration = per_joint("acceleration_rad_s2", motion.acceleration_rad_s2, fit.n)
    share, coulomb = np.ones(fit.n), per_joint("coulomb", friction.coulomb, fit.n)
    for number in range(_MOST_ROUNDS):  # the motors overshoot their reference
        whole = number >= _ROUNDS
        motion = replace(
            motion,
            velocity_rad_s=limits.velocity_rad_s * share,
            acceleration_rad_s2=acceleration,
            position_rad=limits.position_rad * share,
        )
        made = _simulated(
            fit,
            motion,
            interval_s,
            records=records,
            friction=friction if whole else replace(friction, coulomb=0.0),
            measurement=measurement if whole else None,
        )
        reached = largest_motion(made)
        torque = np.maximum(reached.torque_Nm - whole * coulomb, _LEAST * limits.torque_Nm)
        ratio = np.min(
            [
                (limits.torque_Nm - coulomb) / torque,
                limits.velocity_rad_s / reached.velocity_rad_s,
                limits.position_rad / reached.position_rad,
            ],
            axis=0,
        )
        if whole:
            if np.all(ratio >= 1):
                return motion, made
            worst = int(np.argmin(ratio))
            ratio = np.full(fit.n, ratio[worst] * _RESERVE)  # coupling: each moves the others
        acceleration = acceleration * np.minimum(ratio, 2.0)
        share = share * np.minimum(ratio, 1.0)
    raise JointIdError(
        f"Within its limits, joint {worst + 1} does not overcome friction and sensor noise. Raise the "
        "limits of position, velocity or torque."
    )


def _gears(fit: ElasticityFit) -> Sequence[Gear] | None:
    """Nonlinear gears of the fit; None where all are linear."""
    return None if all(gear.kind == "linear" for gear in fit.gears) else fit.gears


def _simulated(
    fit: ElasticityFit, motion: Motion, interval_s: float, **settings: Any
) -> tuple[MotionRecord, ...]:
    """Simulate the identified robot with the fastest controllers that are stable."""
    problem: JointIdError | None = None
    for bandwidth in _BANDWIDTHS_HZ:
        controller = Controller(bandwidth_hz=bandwidth, sample_rate_hz=1 / interval_s)
        try:
            return simulate_motion(
                fit.inertias[0],
                fit.elasticity,
                motion,
                controller=controller,
                gears=_gears(fit),
                **settings,
            )
        except JointIdError as error:
            problem = error
    assert problem is not None
    raise problem
