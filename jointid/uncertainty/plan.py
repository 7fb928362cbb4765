"""Experiment planning: expected accuracy of K and D with more records, and a choice of records."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Complexes, Floats, bounded_number, per_joint, whole_number
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.joints import Inertia, dynamic_arm_inertia, resonances
from jointid.phasors.extract import Phasors
from jointid.records import MotionRecord, SineRecord
from jointid.uncertainty.chosen_model import identified_friction
from jointid.uncertainty.information import PlanningModel, planning_model
from jointid.uncertainty.planned_records import PlannedRecords, planned_records
from jointid.wording import counted

_CANDIDATE_FREQUENCIES = 24
"""Default number of frequencies in the search, logarithmically spaced."""
_MOST_RECORDS = 50
"""Largest number of suggested records."""
_PARTS = 10
"""Parts of the candidates, each followed by a report of progress."""
_LOWEST, _HIGHEST = 0.1, 10.0
"""Limits of the suggested frequencies, over the lowest and the highest frequency of the records."""
_UNKNOWN = 1e-9
"""Information on an undetermined direction, over that of all candidate records together."""


@dataclass(frozen=True, eq=False)
class PredictedErrors:
    """Standard errors by the Cramér–Rao bound, with the fit's prior and inflation.

    They are infinite where nothing determines a parameter.
    """

    today: Floats
    """Standard errors with the existing records, shape (2n,); about those of the fit."""
    planned: Floats
    """Standard errors with the planned records alone, shape (2n,)."""
    together: Floats
    """Standard errors with both, shape (2n,)."""


def predict_standard_errors(
    planned: PlannedRecords,
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    fit: ElasticityFit,
    *,
    planned_inertia: Inertia | None = None,
) -> PredictedErrors:
    """Predict the accuracy of K and D; everything is fitted as in ``fit``, uncertain inertias included.

    The noise is that of the existing records, by frequency, inversely proportional to the length.
    ``planned_inertia`` is that given at the pose of the planned records, by default that of the first
    record. Raises JointIdError when the plan has another number of joints, or the fit has motion
    records.
    """
    if planned.torque_Nm.shape[1] != fit.n:
        raise JointIdError(
            f"The plan has {counted(planned.torque_Nm.shape[1], 'joint')}, but the study has {fit.n}."
        )
    now = planning_model(phasors, inertia, fit, planned_inertia)
    omega = 2 * np.pi * planned.frequency_hz
    new = now.planned_information(omega, planned.angle_rad, planned.duration_s).sum(axis=0)
    old = now.today
    return PredictedErrors(*(now.standard_errors(matrix) for matrix in (old, new, old + new)))


@dataclass(frozen=True, eq=False)
class Suggestion:
    """Records that reduce the largest relative standard error most, in the order of their benefit."""

    records: PlannedRecords
    """k of them."""
    names: tuple[str, ...]
    """K1 ... Kn, D1 ... Dn."""
    relative_error: Floats
    """Relative standard errors before the first and after each record, shape (k + 1, 2n)."""

    @property
    def worst(self) -> Floats:
        """Largest relative standard error before the first and after each record, shape (k + 1,)."""
        return np.asarray(self.relative_error.max(axis=1))


def suggest_records(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    fit: ElasticityFit,
    *,
    count: int = 3,
    duration_s: float = 4.0,
    torque_limit_Nm: ArrayLike | None = None,
    velocity_limit_rad_s: ArrayLike | None = None,
    highest_hz: float | None = None,
    planned_inertia: Inertia | None = None,
    progress: Callable[[float], object] = lambda done: None,
) -> Suggestion:
    """Choose the next records one by one (greedy), each the best of many candidates.

    Candidates are all frequencies with several relative phases of the joints' torques or angles, with
    the largest amplitude within the limits.

    ``torque_limit_Nm`` and ``velocity_limit_rad_s``, shape (n,), are the largest amplitudes of the motor
    torques, friction included, and of the velocities of motors and arm, motor side; by default the
    largest of the records. The frequencies span the band of the records and the resonances, from a
    tenth of the lowest frequency of the records up to ``highest_hz``, for instance a quarter of the
    sample rate. ``planned_inertia`` is as in ``predict_standard_errors``; ``progress`` is
    called with the finished share, 0 to 1. Raises JointIdError when no candidate stays within the
    limits, a setting is out of range, or the fit has motion records.
    """
    count = whole_number("count", count, 1, _MOST_RECORDS)
    now = planning_model(phasors, inertia, fit, planned_inertia)
    pose = now.inertia
    speed = _speed(phasors.omega, fit.phasors.q, fit.phasors.tau, fit.inertias).max(axis=0)
    torque = _limit("torque_limit_Nm", torque_limit_Nm, np.abs(phasors.tau).max(axis=0))
    velocity = _limit("velocity_limit_rad_s", velocity_limit_rad_s, speed)
    # A square wave has a fundamental of 4/π.
    torque = torque - 4 / np.pi * np.asarray(identified_friction(fit).coulomb)
    if np.any(torque <= 0):
        j = int(np.argmin(torque)) + 1
        raise JointIdError(f"The torque limit of joint {j} does not exceed its friction: raise it.")
    frequency = _candidate_frequencies(phasors, pose, fit, duration_s, highest_hz)
    candidates = _candidates(now, frequency, torque, velocity, duration_s)
    frequency, angle, duration = candidates.frequency_hz, candidates.angle_rad, candidates.duration_s
    parts, steps = [], _PARTS + _PARTS // 5 * count
    for number, part in enumerate(np.array_split(np.arange(frequency.size), _PARTS), start=1):
        omega = 2 * np.pi * frequency[part]
        parts.append(now.planned_information(omega, angle[part], duration[part]))
        progress(number / steps)
    information, total = np.concatenate(parts), now.today
    known = np.where(np.isfinite(fit.standard_error), fit.standard_error, 0.0)
    size = np.maximum(np.abs(fit.estimate), known)  # for a damping near zero
    chosen, path = [], [now.standard_errors(total) / size]
    for number in range(1, count + 1):
        trials = np.array([now.standard_errors(total + one) / size for one in information])
        best = _best_trial(trials, total + information)
        chosen.append(best)
        path.append(trials[best])
        total = total + information[best]
        progress((_PARTS + _PARTS // 5 * number) / steps)
    records = PlannedRecords(
        candidates.frequency_hz[chosen],
        candidates.torque_Nm[chosen],
        candidates.angle_rad[chosen],
        candidates.duration_s[chosen],
    )
    return Suggestion(records, elasticity_labels(fit.n), np.array(path))


def highest_logged_hz(records: Sequence[SineRecord | MotionRecord], phasors: Phasors) -> float:
    """Highest frequency for logs of the same rate, Hz: a quarter of the rate, or that of the records."""
    quarter = 0.25 / max(record.interval_s for record in records)
    return max(quarter, float(phasors.omega.max()) / (2 * np.pi))


def _best_trial(errors: Floats, information: Floats) -> int:
    """Index of the record after which the largest error is smallest; errors (trials, 2n).

    If every record leaves some errors infinite: of those that leave the fewest, the one that adds most
    to the information (trials, P, P) in all directions, including those without any before.
    """
    undetermined = np.isinf(errors).sum(axis=1)
    fewest = np.flatnonzero(undetermined == undetermined.min())
    if undetermined.min() == 0:
        return int(fewest[errors[fewest].max(axis=1).argmin()])
    size = np.sqrt(np.einsum("tpp->p", information))
    size = np.where(size > 0, size, 1.0)
    scaled = information[fewest] / np.outer(size, size) + _UNKNOWN * np.eye(size.size)
    return int(fewest[np.linalg.slogdet(scaled)[1].argmax()])


def _limit(name: str, value: ArrayLike | None, largest: Floats) -> Floats:
    if value is None:
        return largest
    limit = per_joint(name, value, largest.size)
    if np.any(limit <= 0):
        raise JointIdError(f"{name}: expected positive values, got {limit.tolist()}.")
    return limit


def _candidate_frequencies(
    phasors: Phasors, inertia: Inertia, fit: ElasticityFit, duration_s: float, highest_hz: float | None
) -> Floats:
    """Frequencies over the band and the resonances, within limits for inaccurate resonances."""
    band = phasors.omega / (2 * np.pi)
    modes = resonances(inertia, fit.elasticity)
    lowest = max(_LOWEST * float(band.min()), 1.001 / duration_s if duration_s > 0 else 0.0)
    highest = _HIGHEST * float(band.max())
    if highest_hz is not None:
        highest = bounded_number("highest_hz", "Hz", highest_hz)
    low, high = min(band.min(), 0.3 * modes[0]), max(band.max(), 1.3 * modes[-1])
    high = max(min(high, highest), lowest)  # a record holds a period
    low = min(max(low, lowest), high)
    return np.asarray(np.geomspace(low, high, _CANDIDATE_FREQUENCIES))


def _candidates(
    now: PlanningModel,
    frequency: Floats,
    torque: Floats,
    velocity: Floats,
    duration_s: float,
) -> PlannedRecords:
    """Every frequency with every pattern, as torques and as angles, scaled to the limits."""
    inertia, elasticity = now.inertia, now.fit.elasticity
    patterns = _patterns(inertia.n)
    f = np.repeat(frequency, len(patterns))
    omega = 2 * np.pi * f[:, None]
    weights = np.tile(patterns, (frequency.size, 1))
    plans = [
        planned_records(inertia, elasticity, f, torque_Nm=weights * torque, duration_s=duration_s),
        planned_records(
            inertia, elasticity, f, angle_rad=weights * velocity / omega, duration_s=duration_s
        ),
    ]
    f, torques = np.tile(f, 2), np.concatenate([plan.torque_Nm for plan in plans])
    angles = np.concatenate([plan.angle_rad for plan in plans])
    speed = _speed(2 * np.pi * f, angles, torques, [inertia] * f.size)
    needed = np.maximum(now.largest_torque(2 * np.pi * f, angles), np.abs(torques))
    share = np.maximum(needed / torque, speed / velocity).max(axis=1)[:, None]
    return PlannedRecords(f, torques / share, angles / share, np.full(f.size, float(duration_s)))


def _speed(omega: Floats, q: Complexes, tau: Complexes, inertias: Sequence[Inertia]) -> Floats:
    """Velocity amplitude of each joint, the larger of motor and arm, shape (r, n), rad/s."""
    s2 = -(omega[:, None] ** 2)
    spring = tau - np.array([i.M for i in inertias]) * s2 * q  # torque on the arm
    arm = np.linalg.solve(dynamic_arm_inertia(omega, inertias), spring[..., None])[..., 0] / s2
    return np.asarray(omega[:, None] * np.maximum(np.abs(q), np.abs(arm)))


def _patterns(n: int) -> Complexes:
    """Relative amplitudes and phases of the joints: each alone, and all together in several ways."""
    if n == 1:
        return np.ones((1, 1), complex)
    record, joint = np.ogrid[: 2 * n, :n]
    together = np.exp(1j * np.pi * record * joint / n)
    return np.concatenate([np.eye(n, dtype=complex), together])
