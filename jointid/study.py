"""A study: the records of one robot with its inertias, their transfer matrices by pose and fits."""

import datetime
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from jointid.arrays import Floats, finite_array, set_fields
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.inertia_prior import InertiaPrior, checked_std
from jointid.estimation.estimators.linear_fit import LINEAR
from jointid.estimation.identify_elasticity import identify_each
from jointid.estimation.identify_motion import identify_motion, require_motion_method
from jointid.joints import Elasticity, Inertia
from jointid.motion.spectral_lines import RecordSpectrum
from jointid.phasors.extract import Phasors
from jointid.records import MotionRecord, SineRecord
from jointid.robot_models.model import RobotModel
from jointid.transfer_matrix import (
    TransferMatrix,
    estimate_transfer_matrix,
    motion_transfer_matrix,
    record_spectra,
)
from jointid.verdict.motion_findings import wrong_motions
from jointid.wording import counted, plain, significant

_ROUNDED = 1e-3
"""Relative difference of gear ratios by rounding."""
_MOST_TURNED_RAD = 4 * np.pi
"""Largest joint angle of a pose: degrees in place of radians exceed it."""
INERTIA_STD = 0.05
"""Relative standard deviation of inertias if the study states none: computed from drawings, they are
known to a few per cent."""


@dataclass(frozen=True, eq=False)
class Study:
    """Records of one robot, sines or any other motion, with its rigid-body inertias.

    Raises JointIdError when there is no record, joints or pose of a record do not match, or a value has
    a wrong type.
    """

    records: tuple[SineRecord | MotionRecord, ...]
    """At least one; all with the joints of ``inertia``."""
    inertia: Inertia
    """Motor side, for records without a pose."""
    nominal: Elasticity | None = None
    """Nominal K and D: those in the controller at present."""
    name: str = ""
    origin: str = ""
    """"simulated" or "measured"; empty when not stated."""
    description: str = ""
    """Free text."""
    poses: Mapping[str, Inertia] = field(default_factory=dict)
    """Inertia of each named pose."""
    robot: str = ""
    """Name of the robot, to compare robots of a fleet and to follow one over time."""
    date: datetime.date | datetime.datetime | None = None
    """Date of the measurement; the UTC offset of a datetime, if any, in whole minutes."""
    inertia_std: float = INERTIA_STD
    """Relative standard deviation of the given inertias: 0.05 for 5 %, 0 for exact ones, ``math.inf``
    for unknown ones."""
    torque_std: float | None = None
    """Relative standard deviation of each joint's torque constant. None: not stated; assumed exact."""
    robot_model: RobotModel | None = None
    """Rigid model of the robot."""
    pose_angles_rad: Mapping[str, Floats] = field(default_factory=dict)
    """Joint angles of poses, each (n,), "" for records without one. Poses that are not in ``poses`` get
    their inertia from the model; the others must agree with it."""
    gear_ratio: Floats | None = None
    """Motor turns per joint turn, shape (n,), negative for opposite directions. They convert K and D to
    the joint side; the method does not need them."""
    gear_temperature_C: float | None = None
    """Temperature of the gears, °C."""
    note: str = ""
    """Remark on the measurement, shown with the answer."""
    assumed: tuple[str, ...] = ()
    """Unconfirmed facts about the logs, such as "gear ratio 1 (joint 2)"."""
    changes: tuple[str, ...] = ()
    """Changes to the logged data, oldest first, see ``jointid.corrections``."""

    def __post_init__(self) -> None:
        if not isinstance(self.inertia, Inertia):
            raise JointIdError(f"inertia: expected an Inertia, got {self.inertia!r:.80}.")
        if not isinstance(self.records, Sequence) or not self.records:
            raise JointIdError("The study holds no records: add at least one experiment.")
        if not all(isinstance(record, SineRecord | MotionRecord) for record in self.records):
            raise JointIdError("records: expected SineRecord and MotionRecord values only.")
        set_fields(self, records=tuple(self.records))
        self._take_poses_from_model()
        if any(not isinstance(name, str) or not name.strip() for name in self.poses):
            raise JointIdError("A pose has no name: give it one, such as stretched.")
        if self.origin not in ("", "simulated", "measured"):
            raise JointIdError(
                f'origin = "{self.origin}": expected "simulated" or "measured", or leave it out.'
            )
        _require_date(self.date)
        self._check_remarks()
        set_fields(self, inertia_std=checked_std("inertia_std", self.inertia_std))
        if self.torque_std is not None:
            set_fields(self, torque_std=checked_std("torque_std", self.torque_std))
        records = [(r.label or f"record {k}", r) for k, r in enumerate(self.records, start=1)]
        for what, joints in [*records, ("nominal", self.nominal), *self.poses.items()]:
            self._require_joints(what, joints)
        for where, record in records:
            if record.pose is not None and record.pose not in self.poses:
                known = ", ".join(self.poses) or "none"
                raise JointIdError(f'{where}: pose "{record.pose}" is not defined. Poses: {known}.')

    @property
    def sine_records(self) -> tuple[SineRecord, ...]:
        """The sines among the records."""
        return tuple(record for record in self.records if isinstance(record, SineRecord))

    @property
    def motion_records(self) -> tuple[MotionRecord, ...]:
        """The records of any other motion."""
        return tuple(record for record in self.records if isinstance(record, MotionRecord))

    @property
    def sensed_joints(self) -> np.ndarray:
        """Mask of the joints with a sensor behind the gear in a record, shape (n,)."""
        given = (r.arm_rad for r in self.motion_records if r.arm_rad is not None)
        seen = [np.isfinite(angles).any(axis=0) for angles in given]
        return np.asarray(np.any([np.zeros(self.inertia.n, bool), *seen], axis=0))

    @property
    def has_sensors(self) -> bool:
        """Whether a record has a sensor behind a gear."""
        return any(record.arm_rad is not None for record in self.motion_records)

    def arm_side_robot(self) -> RobotModel:
        """Robot model for sensors behind the gears; gear ratios that it lacks are those of the study.

        Raises JointIdError when no record has such a sensor, or the study has no robot model.
        """
        if not self.has_sensors:
            raise JointIdError(
                "No record has a sensor behind a gear: give columns theta_a1_rad …, or identify K and "
                "D from the motors alone with analyse (jointid identify)."
            )
        if (robot := self.robot_model) is None:
            raise JointIdError(
                "Sensors behind the gears need the robot model: give a file .urdf, .xml (MJCF) or .toml "
                "(Denavit–Hartenberg), as in jointid arm-side STUDY --robot-model FILE, or state "
                "[robot_model] in study.toml."
            )
        if self.gear_ratio is None or np.isfinite(robot.coupling).all():
            return robot
        return replace(robot, coupling=np.diag(1 / self.gear_ratio))

    @property
    def facts(self) -> list[str]:
        """Contents in words: joints, records, frequencies, motions and poses."""
        sines, motions = self.sine_records, self.motion_records
        facts = [counted(self.inertia.n, "joint")]
        if sines:
            facts.append(counted(len(self.records), "record"))
            f = sorted({record.frequency_hz for record in sines})
            facts += [counted(len(f), "frequency"), f"{plain(round(f[0], 3))} Hz"]
            if f[-1] > f[0] * 1.001:
                facts[-1] = f"{plain(round(f[0], 3))}–{plain(round(f[-1], 3))} Hz"
        if motions:
            seconds = sum(record.samples * record.interval_s for record in motions)
            facts.append(f"{counted(len(motions), 'motion record')}, {significant(seconds, 3)} s in all")
        if len(poses := {record.pose for record in self.records}) > 1:
            facts.append(counted(len(poses), "pose"))
        return facts

    @property
    def gear_ratios(self) -> Floats | None:
        """Gear ratios as given, else of the robot model, shape (n,); None if unknown or coupled."""
        if self.gear_ratio is not None or self.robot_model is None:
            return self.gear_ratio
        C = self.robot_model.coupling
        alone = np.isfinite(C).all() and np.array_equal(C, np.diag(np.diag(C)))
        return self.robot_model.gear_ratio if alone else None

    @property
    def remarks(self) -> list[str]:
        """Remarks shown with the answer: gear temperature, note and unconfirmed facts."""
        remarks = (
            [] if self.gear_temperature_C is None else [f"Gears at {self.gear_temperature_C:g} °C."]
        )
        remarks += [self.note] if self.note else []
        assumed = f"Assumed, not confirmed: {'; '.join(self.assumed)}."
        return [*remarks, assumed] if self.assumed else remarks

    def _require_joints(self, what: str, joints: Any) -> None:
        """Refuse another number of joints than that of the inertia."""
        if joints is not None and joints.n != self.inertia.n:
            raise JointIdError(
                f"{what} has {counted(joints.n, 'joint')}, but the study's inertia has {self.inertia.n}."
            )

    def _check_remarks(self) -> None:
        """Check texts, gear ratios and temperature."""
        for name in ("robot", "note"):
            if not isinstance(value := getattr(self, name), str):
                raise JointIdError(f"{name} = {value!r:.60}: expected text.")
        for name in ("assumed", "changes"):
            value = getattr(self, name)
            if not isinstance(value, list | tuple) or not all(isinstance(text, str) for text in value):
                raise JointIdError(f"{name} = {value!r:.60}: expected a list of strings.")
            set_fields(self, **{name: tuple(value)})
        if self.gear_ratio is not None:
            ratio = finite_array("gear_ratio (motor turns per joint turn)", self.gear_ratio, ndim=1)
            if ratio.shape != (self.inertia.n,) or not ratio.all():
                raise JointIdError(
                    f"gear_ratio = {ratio.tolist()}: give one per joint ({self.inertia.n}), not 0."
                )
            self._require_ratios_of_model(ratio)
            set_fields(self, gear_ratio=ratio)
        if self.gear_temperature_C is not None:
            celsius = float(finite_array("gear_temperature_C (°C)", self.gear_temperature_C, ndim=0))
            set_fields(self, gear_temperature_C=celsius)

    def _require_ratios_of_model(self, ratio: Floats) -> None:
        """Refuse gear ratios other than those of the robot model, apart from rounding."""
        if (robot := self.robot_model) is None:
            return
        other = np.abs(ratio / robot.gear_ratio - 1) > _ROUNDED  # not where the model has none
        for j in np.flatnonzero(other & ~robot.is_coupled)[:1].tolist():
            raise JointIdError(
                f"The gear ratio of joint {j + 1} is {plain(float(ratio[j]))}, that of the robot model "
                f"{plain(float(robot.gear_ratio[j]))}: correct one of them."
            )

    def _take_poses_from_model(self) -> None:
        """Complete ``poses`` by the joint angles of ``pose_angles_rad``."""
        poses, angles = dict(self.poses), {}
        self._require_joints("The robot model", self.robot_model)
        for name, value in self.pose_angles_rad.items():
            if self.robot_model is None:
                raise JointIdError("pose_angles_rad is given without a robot_model: give both.")
            angles[name] = finite_array(f"angles of pose {name!r} (rad)", value, ndim=1)
            if (turned := np.abs(angles[name]).max(initial=0.0)) > _MOST_TURNED_RAD:
                raise JointIdError(
                    f"A joint angle of pose {name!r} is {turned:.4g} rad, more than two turns: give "
                    "radians, not degrees, without whole turns."
                )
            of_model = self.robot_model.inertia(angles[name])
            given = poses.setdefault(name, of_model) if name else self.inertia
            if not np.allclose(given.M2, of_model.M2, rtol=1e-9, atol=1e-12 * np.abs(of_model.M2).max()):
                raise JointIdError(
                    f"{f'Pose {name}' if name else 'inertia'} has an M2 other than that of the robot "
                    "model at its joint angles: leave one of them out."
                )
        set_fields(self, poses=MappingProxyType(poses), pose_angles_rad=MappingProxyType(angles))

    def of_pose(self, pose: str) -> np.ndarray:
        """Mask of the sine records in a pose, shape (r,); "" selects those without one."""
        return np.array([(record.pose or "") == pose for record in self.sine_records], dtype=bool)

    @property
    def inertias(self) -> Sequence[Inertia]:
        """The inertia that each record was measured with, by its pose."""
        return [self.inertia if r.pose is None else self.poses[r.pose] for r in self.records]

    @property
    def sine_prior(self) -> InertiaPrior:
        """The inertias and torque scales of the sine records, with their uncertainty."""
        pairs = zip(self.inertias, self.records, strict=True)
        each = [inertia for inertia, record in pairs if isinstance(record, SineRecord)]
        inertia = each if self.poses else self.inertia
        shape = len(each), self.inertia.n
        return InertiaPrior.of(inertia, *shape, inertia_std=self.inertia_std, torque_std=self.torque_std)


def _require_date(date: object) -> None:
    if date is None:
        return
    if not isinstance(date, datetime.date):  # a datetime is one, too
        raise JointIdError(f"date = {date!r:.60}: expected a datetime.date or datetime.datetime.")
    offset = date.utcoffset() if isinstance(date, datetime.datetime) else None
    if offset is not None and offset % datetime.timedelta(minutes=1):
        raise JointIdError(f"date = {date}: its offset from UTC must be in whole minutes.")


def spectra_by_pose(
    study: Study, matrices: dict[str, TransferMatrix], problem: str
) -> tuple[dict[str, list[RecordSpectrum]], str]:
    """Spectra of the motions of the poses that have no transfer matrix by sines."""
    found: dict[str, list[RecordSpectrum]] = {}
    motions = [record for record in study.motion_records if (record.pose or "") not in matrices]
    for pose in dict.fromkeys(record.pose or "" for record in motions):
        try:
            found[pose] = record_spectra([each for each in motions if (each.pose or "") == pose])
        except JointIdError as error:  # K and D do not need H
            problem = str(error)
    return found, problem


def motion_matrices(
    by_pose: dict[str, list[RecordSpectrum]], problem: str, fit: ElasticityFit | None = None
) -> tuple[dict[str, TransferMatrix], str]:
    """Transfer matrices of motions, without the friction and the delay of a fit."""
    without: dict[str, Any] = {}
    if fit is not None:
        without = {"delay": fit.delay or 0.0}
        if fit.friction is not None:
            without |= {"coulomb": fit.friction.coulomb, "viscous": fit.friction.viscous}
    matrices = {}
    for pose, spectra in by_pose.items():
        try:
            matrices[pose] = motion_transfer_matrix(spectra, **without)
        except JointIdError as error:  # K and D do not need H
            problem = str(error)
    return matrices, problem


def sine_matrices(study: Study, phasors: Phasors) -> tuple[dict[str, TransferMatrix], str]:
    """Transfer matrices of the sines by pose, and why one is missing; empty otherwise."""
    matrices, problem = {}, ""
    for pose in dict.fromkeys(record.pose or "" for record in study.sine_records):
        try:
            matrices[pose] = estimate_transfer_matrix(phasors.select(study.of_pose(pose)))
        except JointIdError as error:  # K and D do not need H
            problem = str(error)
    return matrices, problem


def fits_with_motion(
    study: Study, phasors: Phasors, method: str, matrices: dict[str, TransferMatrix]
) -> dict[str, ElasticityFit]:
    """The fit of all records together, and linear fits of the sines where they allow them."""
    require_motion_method(method)
    inertia = study.inertias if study.poses else study.inertia
    fits = {
        method: identify_motion(
            study.records,
            inertia,
            inertia_std=study.inertia_std,
            torque_std=study.torque_std,
            gives_up=cache(lambda: bool(wrong_motions(study.records, study.inertias, matrices))),
        )
    }
    with suppress(JointIdError):  # one or two sines added to motions need not determine K and D
        fits |= identify_each(phasors, study.sine_prior, LINEAR) if phasors.omega.size else {}
    return fits
