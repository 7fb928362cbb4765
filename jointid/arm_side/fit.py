"""Stiffness of each joint from its deflection, and the prediction for other records."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from jointid.arm_side.band_limited import band_limited, joint_angles
from jointid.arm_side.payload import MotorTorques
from jointid.arm_side.position_map import PositionMap
from jointid.arm_side.terms import Ripple, joint_terms, joint_torque
from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.records import MotionRecord
from jointid.robot_models.model import RobotModel
from jointid.small_matrices import one_thread
from jointid.wording import with_error


@dataclass(frozen=True, eq=False)
class JointDeflection:
    """Fitted deflection of one joint."""

    ripple: Ripple
    beta: Floats
    compliance: float
    compliance_std: float
    skew_s: float
    aligned_s: float
    """The part of the skew that was taken out before the fit."""
    skew_std_s: float
    residual_rad: float
    position_map: PositionMap | None


@dataclass(frozen=True, eq=False)
class ArmSideFit:
    """Joint stiffness from sensors behind the gears; joint side, n joints.

    The deflection motor/N − arm of a joint is torque/K + skew · velocity + offset, plus transmission
    error, friction and damping in the gear.
    """

    K: Floats
    """Stiffness, shape (n,), N·m/rad; NaN where undetermined."""
    standard_error: Floats
    """Standard error of K, shape (n,), N·m/rad: noise, payload, choice of terms, rigid model; NaN where
    undetermined."""
    skew_s: Floats
    """Age of the arm's sample relative to the motor's, shape (n,), s; NaN without a sensor."""
    skew_error_s: Floats
    """Standard error of ``skew_s``, shape (n,), s."""
    reasons: tuple[str, ...]
    """Reason why K is undetermined, (n,); empty otherwise."""
    residual_rad: Floats
    """Root mean square of measured minus fitted deflection in the band, shape (n,), rad."""
    robot: RobotModel
    band_hz: float | None
    """Upper edge of the band, Hz; None for that of each record."""
    joints: tuple[JointDeflection | None, ...]
    """Terms of each joint, for ``predict``; None where K is undetermined."""
    motors: MotorTorques
    """Payload that the motor torques indicate, and whether they agree with the robot model."""
    method: ClassVar[str] = "sensors behind the gears"
    model: ClassVar[str] = "elasticity + friction + transmission error + skew + payload"

    @property
    def table(self) -> dict[str, list[str]]:
        """K with its standard error, skew and reason if undetermined, of every joint, as text."""
        return self.table_in("N·m/rad", 1.0)

    def table_in(self, unit: str, factor: float) -> dict[str, list[str]]:
        """Return the table with K in another unit, ``factor`` of it for each N·m/rad."""
        pairs = {
            f"K at the joint ({unit})": (factor * self.K, factor * self.standard_error),
            "Skew of the sensor (µs)": (1e6 * self.skew_s, 1e6 * self.skew_error_s),
        }
        cells = {
            name: [
                with_error(float(v), float(e)) if np.isfinite(v) else "–"
                for v, e in zip(*both, strict=True)
            ]
            for name, both in pairs.items()
        }
        return {"Joint": [f"{j + 1}" for j in range(self.K.size)]} | cells | {"Note": [*self.reasons]}

    def predict(self, record: MotionRecord) -> Floats:
        """Deflection motor/N − arm of another record, shape (N, n), rad; NaN without a fit.

        Limited to the band of the fit, apart from the transmission error. Only the motion of the motors
        is used. The constant offset is that of the fit; where the record has a sensor it is the median
        difference from the sensor, since encoders may be homed again between records. Beyond
        the positions of the fit, the slow transmission error is that at the nearest one.
        """
        with one_thread():
            return self._predict(record)

    def deflection(self, record: MotionRecord) -> tuple[Floats, Floats, Floats]:
        """Times, (k,), s, measured deflection and that of ``predict``, (k, n), rad, of the samples used.

        Raises JointIdError when the record has no sensor behind a gear.
        """
        if record.arm_rad is None:
            raise JointIdError(f"The record {record.label!r} has no sensor behind a gear.")
        measured, used = joint_angles(record, self.robot) - record.arm_rad, slice(record.start, None)
        return record.time_s[used], measured[used], self.predict(record)[used]

    def _predict(self, record: MotionRecord) -> Floats:
        skew = np.array([joint.aligned_s if joint else 0.0 for joint in self.joints])
        motion = replace(band_limited(record, self.robot, self.band_hz), skew_s=skew)
        elastic = np.zeros_like(motion.q)
        found = np.full(motion.q.shape, np.nan)
        for _ in range(2):
            torque, payload, _ = joint_torque(motion, self.robot, elastic)
            torque, payload = torque + payload @ self.motors.mean, payload @ self.motors.root
            for j, joint in enumerate(self.joints):
                if joint is not None:
                    motor = record.theta_rad[record.start :, j]
                    terms = joint_terms(j, motion, torque, payload, motor, joint.ripple)
                    beta, offsets = np.split(joint.beta, [terms.columns.shape[1]])
                    elastic[:, j] = terms.columns @ beta
                    found[:, j] = (
                        elastic[:, j]
                        + motion.by_skew(j, elastic[:, j])
                        + offsets[: offsets.size // 2].mean()
                    )
            elastic += torque.mean(axis=0) / self.K - elastic.mean(axis=0)
            elastic[:, ~np.isfinite(self.K)] = 0.0
        result = np.full(record.theta_rad.shape, np.nan)
        for j in map(int, np.flatnonzero(np.isfinite(found).all(axis=0))):
            joint = self.joints[j]
            if joint is not None and joint.position_map is not None:
                found[:, j] += joint.position_map(motion.raw[:, j], motion.lowpass)
            result[:, j] = np.interp(record.time_s, motion.time_s, found[:, j])
        if record.arm_rad is not None:
            measured = joint_angles(record, self.robot) - record.arm_rad
            seen = np.isfinite(measured).all(axis=0) & np.isfinite(result).all(axis=0)
            difference = (measured - result)[record.start :][motion.inner]
            result[:, seen] += np.median(difference[:, seen], axis=0)
        return result
