"""Sensors that do not show the deflection of their gear: they are left out, the other joints are not."""

from collections.abc import Sequence

import numpy as np

from jointid.arm_side.band_limited import BandLimited
from jointid.arrays import Floats
from jointid.records import MotionRecord
from jointid.robot_models.model import RobotModel
from jointid.wording import minus, significant

LEAST_RAD = 1e-4
"""Range of a joint's angle up to which it rests: noise of its encoders."""
ALIKE = 2.0
"""Largest ratio of the motions on both sides of a gear."""
_MOST_DEFLECTION_RAD = 2e-3
"""Deflection from which they are compared: that of a joint that hardly moves may exceed its motion."""
_LEAST_DEFLECTION_RAD, _ROUNDED = 2e-6, 1.1
"""Deflection that no gear stays below, and that by rounding, in standard deviations of rounding."""
_SCALE, _EXPLAINED = 2e-3, 0.9
"""Error of the scale from which it changes K, and the share of the deflection beyond torque and friction
that it then explains: a transmission error of 100 seconds of arc has less than half of both."""
_SLIDING_RAD_S = 5e-3
"""Velocity at which friction in the gear has built up."""
COMPUTED = (
    "Its sensor signal shows no deflection beyond rounding, and seems to be computed from the motor's "
    "position. Log the angle that the sensor behind the gear measures, or leave its column out."
)


def share(motion: BandLimited, j: int) -> float:
    """Motion of a sensor over that of its motor, through the gear; NaN for a joint at rest."""
    q = motion.raw[:, j]
    if np.ptp(q) < LEAST_RAD:
        return np.nan
    moves = q - q.mean()
    return float(moves @ (q - motion.raw_deflection[:, j])) / float(moves @ moves)


def sensor_faults(records: Sequence[MotionRecord], motions: Sequence[BandLimited]) -> list[str]:
    """Reason why the sensor of each joint cannot be used, n texts; empty without a fault."""
    found = [""] * records[0].n
    for k, (record, motion) in enumerate(zip(records, motions, strict=True), start=1):
        where = record.label or f"motion record {k}"
        for j in np.flatnonzero(np.isfinite(motion.deflection).all(axis=0)).tolist():
            found[j] = found[j] or _fault(motion, j, where)
    return found


def _fault(motion: BandLimited, j: int, where: str) -> str:
    moves, angle = share(motion, j), motion.raw[:, j] - motion.raw_deflection[:, j]
    if np.isnan(moves):
        return ""
    hardly = np.ptp(motion.raw[:, j]) < _MOST_DEFLECTION_RAD  # as does a sensor that works
    if not hardly and np.ptp(angle) < 1e-12 * np.ptp(motion.raw[:, j]):
        return (
            f"Its sensor does not move while its motor does ({where}: {angle[0]:.4g} rad throughout). "
            "Check the sensor and its column of the log, or leave the column out."
        )
    apart = np.ptp(motion.raw_deflection[:, j]) > _MOST_DEFLECTION_RAD
    if apart and not 1 / ALIKE < moves < ALIKE:
        return _moves_otherwise(f"{moves:.3g}", where)
    return COMPUTED if not hardly and _is_computed(motion, j) else ""


def _moves_otherwise(moves: str, where: str, implied: str = "") -> str:
    return (
        f"Its sensor moves {minus(moves)} times as far as its motor and the gear ratio imply "
        f"({where}). Give its angles in rad at the joint, and check its column, its sign and the gear "
        f"ratio{implied}; if the gear ratio is wrong, K of the other joints is also wrong."
    )


def scale_fault(
    j: int, motion: BandLimited, torque: Floats, payload: Floats, where: str, robot: RobotModel
) -> str:
    """Reason why the sensor of a joint cannot be used: its scale, or the gear ratio, is slightly wrong.

    Nothing else leaves a deflection proportional to the angle that torque (N, n) and its change with the
    payload, (N, n, 4), do not explain.
    """
    hardly = np.ptp(motion.raw[:, j]) < _MOST_DEFLECTION_RAD
    if hardly or not np.isfinite(motion.deflection[:, j]).all():
        return ""
    velocity = motion.dq[:, j]
    known = [np.ones_like(velocity), velocity, np.tanh(velocity / _SLIDING_RAD_S), motion.ddq[:, j]]
    X = np.column_stack([*known, torque[:, j], payload[:, j]])[motion.inner]
    U, singular, _ = np.linalg.svd(X / np.linalg.norm(X, axis=0).clip(1e-9), full_matrices=False)
    U = U[:, singular > 1e-9 * singular[0]]
    both = motion.q[motion.inner, j], motion.deflection[motion.inner, j]
    angle, left = (each - U @ (U.T @ each) for each in both)
    extra = float(angle @ left) / float(angle @ angle)
    explained = 1 - np.var(left - extra * angle) / np.var(left)
    apart = min(abs(extra) / _SCALE, abs(extra) * np.ptp(motion.q[:, j]) / _MOST_DEFLECTION_RAD) > 1
    if not apart or explained <= _EXPLAINED:
        return ""
    given = float(robot.gear_ratio[j])
    implied, stated = (significant(ratio) for ratio in (given / (1 - extra), given))
    ratio = f" (a correct sensor implies {implied}, the robot model states {stated})"
    return _moves_otherwise(f"{1 - extra:.4g}", where, ratio)


def _is_computed(motion: BandLimited, j: int) -> bool:
    """Whether motor and sensor differ by a constant, a skew and rounding only."""
    skew, velocity = np.zeros(motion.q.shape[1]), motion.dq[motion.inner, j]
    for _ in range(3):
        late = motion.aligned(skew).deflection[motion.inner, j]
        skew[j] += float((late - late.mean()) @ velocity) / float(velocity @ velocity)
    left = motion.aligned(skew).elastic()[motion.inner, j].std()
    rounding = _step(motion.raw[:, j] - motion.raw_deflection[:, j]) / np.sqrt(12)
    return bool(left < _ROUNDED * rounding + _LEAST_DEFLECTION_RAD)


def _step(angle: Floats) -> float:
    """Smallest change of an angle (N,), apart from that by decimals: its rounding, if it is rounded."""
    steps = np.abs(np.diff(angle))
    return float(steps[steps > 1e-9 * np.ptp(angle)].min())
