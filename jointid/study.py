"""A study: the records of one robot with its inertias, and the whole method in one call."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from jointid.answer import answer_sentence
from jointid.arrays import Floats, finite_array
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit, identify_each
from jointid.estimation.inertia_prior import InertiaPrior, checked_std
from jointid.joints import Elasticity, Inertia
from jointid.phasors.extract import Phasors, extract_phasors
from jointid.records import SineRecord
from jointid.robot_models.model import RobotModel
from jointid.small_matrices import one_thread
from jointid.transfer_matrix import TransferMatrix, estimate_transfer_matrix
from jointid.uncertainty.prior_rows import PriorRow, prior_rows
from jointid.verdict.findings import Evidence, Finding, findings
from jointid.wording import counted

INERTIA_STD = 0.05
"""Relative standard deviation of inertias where a study says nothing: computed from drawings, they are
known to a few per cent."""

USABLE, WITH_CARE, NOT_USABLE = "usable", "usable with care", "not usable"
STATES = (USABLE, WITH_CARE, NOT_USABLE)
"""What may be done with an answer."""


def answer_state(levels: Iterable[str]) -> str:
    """State of an answer, one of ``STATES``, from the levels of its findings."""
    found = set(levels)
    return NOT_USABLE if "problem" in found else WITH_CARE if "warning" in found else USABLE


@dataclass(frozen=True, eq=False)
class Study:
    """Sine records of one robot, with its rigid-body inertias.

    Parameters
    ----------
    records : sequence of SineRecord
        At least one; all with the joints of ``inertia``.
    inertia : Inertia
        Motor side, for records without a pose.
    nominal : Elasticity, optional
        K and D that the controller assumes.
    name : str, default ""
    origin : {"", "simulated", "measured"}
        Origin of the records; empty when not stated.
    description : str, default ""
        Free text.
    poses : mapping of str to Inertia, optional
        Inertia of each named pose.
    robot : str, default ""
        Name of the robot, to compare robots of a fleet and to follow one over time.
    date : date or datetime, optional
        When it was measured; a datetime's offset from UTC, if it has one, in whole minutes.
    inertia_std : float, default 0.05
        Relative standard deviation of the given inertias: 0.05 for 5 %, 0 for exact ones,
        ``math.inf`` for unknown ones.
    torque_std : float, optional
        The same for the torque constant of each joint. None: not stated, and taken as exact.
    robot_model : RobotModel, optional
        Rigid model of the robot.
    pose_angles_rad : mapping of str to (n,), optional
        Joint angles of poses, "" for records without one. Poses that are not in ``poses`` get their
        inertia from the model; the others must agree with it.

    Raises
    ------
    JointIdError
        When a record's joints or pose do not fit, there is no record, or the robot is no text or the
        date no date.
    """

    records: tuple[SineRecord, ...]
    inertia: Inertia
    nominal: Elasticity | None = None
    name: str = ""
    origin: str = ""
    description: str = ""
    poses: Mapping[str, Inertia] = field(default_factory=dict)
    robot: str = ""
    date: datetime.date | datetime.datetime | None = None
    inertia_std: float = INERTIA_STD
    torque_std: float | None = None
    robot_model: RobotModel | None = None
    pose_angles_rad: Mapping[str, Floats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.inertia, Inertia):
            raise JointIdError(f"inertia: expected an Inertia, got {self.inertia!r:.80}.")
        if not isinstance(self.records, Sequence) or not self.records:
            raise JointIdError("The study holds no records: add at least one sine experiment.")
        if not all(isinstance(record, SineRecord) for record in self.records):
            raise JointIdError("records: expected SineRecord values only.")
        object.__setattr__(self, "records", tuple(self.records))
        self._take_poses_from_model()
        if any(not isinstance(name, str) or not name.strip() for name in self.poses):
            raise JointIdError("A pose has no name: call it something, such as stretched.")
        if self.origin not in ("", "simulated", "measured"):
            raise JointIdError(
                f'origin = "{self.origin}": expected "simulated" or "measured", or leave it out.'
            )
        if not isinstance(self.robot, str):
            raise JointIdError(f"robot = {self.robot!r:.60}: expected a text such as cell 7, robot A.")
        _require_date(self.date)
        object.__setattr__(self, "inertia_std", checked_std("inertia_std", self.inertia_std))
        if self.torque_std is not None:
            object.__setattr__(self, "torque_std", checked_std("torque_std", self.torque_std))
        for number, record in enumerate(self.records, start=1):
            where = record.label or f"record {number}"
            if record.n != self.inertia.n:
                raise JointIdError(
                    f"{where} has {counted(record.n, 'joint')}, the study's inertia has "
                    f"{self.inertia.n}."
                )
            if record.pose is not None and record.pose not in self.poses:
                known = ", ".join(self.poses) or "none"
                raise JointIdError(
                    f'{where}: pose "{record.pose}" is not defined. Known poses: {known}.'
                )
        for what, joints in [("nominal", self.nominal), *self.poses.items()]:
            if joints is not None and joints.n != self.inertia.n:
                raise JointIdError(
                    f"{what} has {counted(joints.n, 'joint')}, the study's inertia has {self.inertia.n}."
                )

    def _take_poses_from_model(self) -> None:
        """Complete ``poses`` by the joint angles of ``pose_angles_rad``."""
        poses, angles = dict(self.poses), {}
        if self.robot_model is not None and self.robot_model.n != self.inertia.n:
            raise JointIdError(
                f"The robot's model has {counted(self.robot_model.n, 'joint')}, the study's inertia has "
                f"{self.inertia.n}."
            )
        for name, value in self.pose_angles_rad.items():
            if self.robot_model is None:
                raise JointIdError("pose_angles_rad is given without a robot_model: give both.")
            angles[name] = finite_array(f"angles of pose {name!r} (rad)", value, ndim=1)
            of_model = self.robot_model.inertia(angles[name])
            given = poses.setdefault(name, of_model) if name else self.inertia
            if not np.allclose(given.M2, of_model.M2, rtol=1e-9, atol=1e-12 * np.abs(of_model.M2).max()):
                raise JointIdError(
                    f"{f'Pose {name}' if name else 'inertia'} has joint angles and another M2 than the "
                    "robot's model there: leave one of them out."
                )
        object.__setattr__(self, "poses", MappingProxyType(poses))
        object.__setattr__(self, "pose_angles_rad", MappingProxyType(angles))

    def of_pose(self, pose: str) -> np.ndarray:
        """Which records were measured in a pose, shape (r,); "" means those without one."""
        return np.array([(record.pose or "") == pose for record in self.records])

    @property
    def inertias(self) -> Sequence[Inertia]:
        """The inertia that each record was measured with, by its pose."""
        return [self.inertia if r.pose is None else self.poses[r.pose] for r in self.records]

    @property
    def prior(self) -> InertiaPrior:
        """The inertias and torque scales of the records, with their uncertainty."""
        inertia = self.inertias if self.poses else self.inertia
        shape = len(self.records), self.inertia.n
        return InertiaPrior.of(inertia, *shape, inertia_std=self.inertia_std, torque_std=self.torque_std)


def _require_date(date: object) -> None:
    if date is None:
        return
    if not isinstance(date, datetime.date):  # a datetime is one, too
        raise JointIdError(f"date = {date!r:.60}: expected a datetime.date or datetime.datetime.")
    offset = date.utcoffset() if isinstance(date, datetime.datetime) else None
    if offset is not None and offset % datetime.timedelta(minutes=1):
        raise JointIdError(f"date = {date}: its offset from UTC must be of whole minutes.")


@dataclass(frozen=True, eq=False)
class Analysis:
    """All results of a study."""

    study: Study
    phasors: Phasors
    """Equations (2)-(4), in the order of the study's records."""
    transfer_matrices: Mapping[str, TransferMatrix]
    """Equations (16)-(18) by pose, "" for records without one; poses without a solution are missing."""
    freed_transfer_matrices: Mapping[str, TransferMatrix]
    """The same, friction-compensated: friction and delay of ``fit`` subtracted from the torque."""
    transfer_problem: str
    """Reason why a pose has no transfer matrix, with the remedy; empty otherwise."""
    fit: ElasticityFit
    """The chosen estimate of K and D, equations (8)-(15)."""
    fits: Mapping[str, ElasticityFit]
    """Fits of the chosen estimator and of the linear ones, for comparison."""
    findings: tuple[Finding, ...]
    """Findings on the data and the answer, most important first."""

    @property
    def state(self) -> str:
        """One of ``STATES``, see ``answer_state``."""
        return answer_state(finding.level for finding in self.findings)

    @property
    def state_reason(self) -> str:
        """Title of the finding that limits the use of the answer; empty if it is usable."""
        limits = (f.title for f in self.findings if answer_state([f.level]) == self.state)
        return "" if self.state == USABLE else next(limits)

    @property
    def headline(self) -> str:
        """The answer as a sentence; of an unusable one, the reason."""
        if self.state == NOT_USABLE:
            return f"Not usable: {self.state_reason}."
        stated = self.study.torque_std is not None
        return answer_sentence(self.fit, self.study.nominal, torque_stated=stated)

    @property
    def caution(self) -> str:
        """What limits a usable answer, as a sentence; empty otherwise."""
        return f"Usable with care: {self.state_reason}." if self.state == WITH_CARE else ""

    @property
    def priors(self) -> tuple[PriorRow, ...]:
        """Inertias and torque scales as given and as fitted."""
        return prior_rows(self.fit, [record.pose or "" for record in self.study.records])

    def inertia(self, pose: str = "") -> Inertia:
        """Fitted inertia of a pose, "" for records without one; the given one if it has no record."""
        given = self.study.poses[pose] if pose else self.study.inertia
        of_records = zip(self.study.records, self.fit.inertias, strict=True)
        return next((found for record, found in of_records if (record.pose or "") == pose), given)


def analyse(study: Study, *, method: str = "auto") -> Analysis:
    """Run the whole method on a study: phasors, transfer matrix, elasticity, verdict.

    The result does not depend on the number of cores: BLAS uses one.

    Parameters
    ----------
    study : Study
    method : str, default "auto"
        Estimator of ``Analysis.fit``; see ``jointid.estimation.elasticity.METHODS``.

    Raises
    ------
    JointIdError
        When no estimate is possible.
    """
    if not isinstance(study, Study):
        raise JointIdError(f"analyse needs a Study, got {study!r:.80}. Build one, or use load_study.")
    with one_thread():
        return _analyse(study, method)


def _analyse(study: Study, method: str) -> Analysis:
    _require_torques(study)
    phasors = extract_phasors(study.records)
    transfer_matrices, problem = _transfer_matrices(study, phasors)
    fits = identify_each(phasors, study.prior, [method, "weighted", "least-squares", "explicit"])
    freed, _ = _transfer_matrices(study, fits[method].phasors)
    return Analysis(
        study=study,
        phasors=phasors,
        transfer_matrices=MappingProxyType(transfer_matrices),
        freed_transfer_matrices=MappingProxyType(freed),
        transfer_problem=problem,
        fit=fits[method],
        fits=MappingProxyType(fits),
        findings=findings(
            Evidence(
                records=study.records,
                inertias=study.inertias,
                phasors=phasors,
                fit=fits[method],
                paper=fits["least-squares"],
                transfer_matrices=transfer_matrices,
            )
        ),
    )


def _require_torques(study: Study) -> None:
    """Refuse a joint that moves while its torque is the same number throughout all records."""
    constant = np.array([record.constant for record in study.records])
    n = study.inertia.n
    lost = constant[:, n:].all(axis=0) & ~constant[:, :n].all(axis=0)
    if lost.any():
        j = int(np.argmax(lost))
        moving = int(np.argmin(constant[:, j]))
        record = study.records[moving]
        raise JointIdError(
            f"Joint {j + 1} moves, but its torque tau_m{j + 1}_Nm is constant in every record: "
            f"{record.tau_Nm[record.start, j]:.6g} N·m in {record.label or f'record {moving + 1}'}. "
            f"K{j + 1} and D{j + 1} cannot be found. Log the torque or the current of motor {j + 1}."
        )


def _transfer_matrices(study: Study, phasors: Phasors) -> tuple[dict[str, TransferMatrix], str]:
    matrices, problem = {}, ""
    for pose in dict.fromkeys(record.pose or "" for record in study.records):
        try:
            matrices[pose] = estimate_transfer_matrix(phasors.select(study.of_pose(pose)))
        except JointIdError as error:  # K and D do not need H
            problem = str(error)
    return matrices, problem
