"""The whole method in one call, and its results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from types import MappingProxyType
from typing import Any

import numpy as np

from jointid.answer import AT_MOTOR, StiffnessUnit, answer_sentence, elasticity_quantities
from jointid.arm_side.fit import ArmSideFit
from jointid.arm_side.identify import identify_arm_side
from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.linear_fit import LINEAR
from jointid.estimation.identify_elasticity import identify_each, require_method
from jointid.estimation.identify_motion import identify_motion
from jointid.estimation.quantities import Quantity
from jointid.joints import Inertia
from jointid.phasors.coherence import coherent_band
from jointid.phasors.extract import Phasors, extract_phasors, no_phasors
from jointid.records import MotionRecord, require_torques
from jointid.robot_models.model import RobotModel
from jointid.small_matrices import one_thread
from jointid.study import Study
from jointid.transfer_matrix import TransferMatrix, estimate_transfer_matrix, motion_transfer_matrix
from jointid.uncertainty.answer_tables import PriorRow, largest_part, prior_rows
from jointid.verdict.findings import Evidence, Finding, findings, is_wrong
from jointid.verdict.motion_findings import motion_findings, wrong_motions
from jointid.verdict.rules_model import MODEL_LIMITS
from jointid.wording import plain, significant

USABLE, WITH_CARE, NOT_USABLE = "usable", "usable with care", "not usable"
BEHIND_THE_GEARS = " The sensors behind the gears give K: jointid arm-side STUDY --robot FILE."
"""Ends the error of motors that alone give no K and D."""
_HARDLY_SMALLER = 0.9
"""Share of the worst error that may remain after useful planned records."""
STATES = (USABLE, WITH_CARE, NOT_USABLE)
"""States of an answer, best first."""


def answer_state(levels: Iterable[str]) -> str:
    """State of an answer, one of ``STATES``, from the levels of its findings."""
    found = set(levels)
    return NOT_USABLE if "problem" in found else WITH_CARE if "warning" in found else USABLE


@dataclass(frozen=True, eq=False)
class Analysis:
    """All results of a study."""

    study: Study
    phasors: Phasors
    """Equations (2)-(4) of the sine records, in their order; no rows without any."""
    transfer_matrices: Mapping[str, TransferMatrix]
    """Equations (16)-(18) by pose, "" for records without one; poses without a solution are missing."""
    compensated_transfer_matrices: Mapping[str, TransferMatrix]
    """The same, friction-compensated: friction and delay of ``fit`` subtracted from the torque."""
    transfer_problem: str
    """Reason why a pose has no transfer matrix, with the remedy; empty otherwise."""
    fit: ElasticityFit
    """The chosen estimate of K and D, equations (8)-(15)."""
    fits: Mapping[str, ElasticityFit]
    """Fits of the chosen estimator and, of the sine records, of the linear ones, for comparison."""
    findings: tuple[Finding, ...]
    """Findings on the data and the answer, most important first."""
    unit: StiffnessUnit = AT_MOTOR
    """Unit and side of K and D."""

    def shown_in(self, name: str) -> Analysis:
        """Return this analysis with K and D shown in a unit of ``jointid.answer.STIFFNESS_UNITS``.

        Raises JointIdError when the unit is not known, or the study lacks the gear ratios for it.
        """
        return replace(self, unit=StiffnessUnit.named(name, self.study.gear_ratios))

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """K1 ... Kn and D1 ... Dn with their standard errors (all causes), in ``unit``; 2n values."""
        return elasticity_quantities(self.fit, self.unit)

    @property
    def nominal(self) -> Floats | None:
        """Nominal K1 ... Kn and D1 ... Dn in ``unit``, shape (2n,); None if the study has no nominal."""
        of = self.study.nominal
        return None if of is None else self.unit.shown(np.concatenate([of.K, of.D]))

    @property
    def estimates(self) -> dict[str, list[str]]:
        """Table of every estimator's K, D ± standard error in ``unit`` and residual, and of nominal."""
        fits = {self.fit.method: self.fit} | dict(self.fits)
        last = [] if self.nominal is None else ["nominal"]
        columns = {"Estimator": [*fits, *last]}
        found = [elasticity_quantities(fit, self.unit) for fit in fits.values()]
        for k, same in enumerate(zip(*found, strict=True)):
            given = [] if self.nominal is None else [plain(float(f"{self.nominal[k]:.5g}"))]
            columns[same[0].heading] = [*(each.shown[0] for each in same), *given]
        residuals = [significant(float(np.sqrt(fit.misfit)), 2) for fit in fits.values()]
        return columns | {"Residual / noise": residuals + ["–" for _ in last]}

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
        """The answer as a sentence; the reason if it is not usable."""
        if self.state == NOT_USABLE:
            return f"Not usable: {self.state_reason}."
        stated = self.study.torque_std is not None
        return answer_sentence(self.fit, self.study.nominal, torque_stated=stated, unit=self.unit)

    def require_usable(self) -> None:
        """Raise JointIdError, with the reason, when the answer is not usable."""
        if self.state == NOT_USABLE:
            raise JointIdError(f"{self.headline} Resolve the findings first.")

    @property
    def caution(self) -> str:
        """Limit of a usable answer, as a sentence; empty otherwise."""
        return f"Usable with care: {self.state_reason}." if self.state == WITH_CARE else ""

    def limit_of_records(self, worst: Floats) -> str:
        """Say that more records of the same kind do not help, and what does; empty otherwise.

        ``worst`` is the predicted worst error before the first and after each planned record.
        """
        for finding in self.findings:
            if finding.code == "model limits":
                return f"{MODEL_LIMITS}: more records of the same kind do not help. {finding.remedy}"
        if worst[-1] <= _HARDLY_SMALLER * worst[0]:
            return ""
        return f"These records hardly reduce the worst error. {largest_part(self.fit)}"

    @property
    def priors(self) -> tuple[PriorRow, ...]:
        """Inertias (motor side, kg·m²) and torque scales, as given and as fitted."""
        return prior_rows(self.fit, [record.pose or "" for record in self.study.records])

    def inertia(self, pose: str = "") -> Inertia:
        """Fitted inertia of a pose ("" for records without a pose), or the given one without records."""
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
        Estimator of ``Analysis.fit``; see ``jointid.estimation.identify_elasticity.METHODS``.

    Returns
    -------
    Analysis
        Results of every step, with the state of the answer and the findings.

    Raises
    ------
    JointIdError
        When no estimate is possible.
    """
    if not isinstance(study, Study):
        raise JointIdError(f"analyse needs a Study, got {study!r:.80}. Build one, or use load_study.")
    # An overflow gives infinity or NaN, which the rules treat as a failed fit.
    with one_thread(), np.errstate(over="ignore"):
        return _analyse(study, method)


def reanalysed(study: Study, known: Analysis, method: str) -> Analysis:
    """Return ``analyse(study, method=method)``, faster: ``known`` is its analysis by "auto"."""
    if study.motion_records and method not in LINEAR:  # only "auto" fits motions
        require_method(method)
        others = {name: fit for name, fit in known.fits.items() if name in LINEAR}
        return replace(known, fits=MappingProxyType({method: known.fit} | others))
    with one_thread(), np.errstate(over="ignore"):
        return _analyse(study, method, known)


def _analyse(study: Study, method: str, known: Analysis | None = None) -> Analysis:
    require_torques(study.records)
    sines = study.sine_records
    if known is not None:
        phasors, problem = known.phasors, known.transfer_problem
        transfer_matrices = dict(known.transfer_matrices)
    else:
        phasors = extract_phasors(sines) if sines else no_phasors(study.inertia.n)
        transfer_matrices, problem = _transfer_matrices(study, phasors)
    if study.motion_records:
        by_pose, problem = _motions_by_pose(study, transfer_matrices, problem)
        of_motions, problem = _motion_matrices(by_pose, problem)
        transfer_matrices |= of_motions
        fits = _fits_with_motion(study, phasors, method, transfer_matrices)
        by_pose = {pose: by_pose[pose] for pose in of_motions}
        freed, problem = _motion_matrices(by_pose, problem, fits[method])
        found = motion_findings(study.records, study.inertias, phasors, fits, transfer_matrices)
    else:
        fits = {} if known is None else dict(known.fits)
        fits |= identify_each(phasors, study.sine_prior, [m for m in LINEAR if m not in fits])
        evidence = Evidence(
            records=sines,
            inertias=study.inertias,
            phasors=phasors,
            fit=fits["weighted"],
            transfer_matrices=transfer_matrices,
            automatic=None if known is None else known.fit,
        )
        if method not in fits:  # no rich model explains wrong data, and the search would take long
            fits |= identify_each(
                phasors, study.sine_prior, [method], gives_up=partial(is_wrong, evidence)
            )
        fits = {name: fits[name] for name in dict.fromkeys((method, *LINEAR))}
        freed, _ = _transfer_matrices(study, fits[method].phasors)
        found = findings(replace(evidence, fit=fits[method]))
    if study.assumed and found[0].level == "problem":
        assumed = f"First check what the import assumed: {'; '.join(study.assumed)}."
        found = replace(found[0], remedy=f"{assumed} {found[0].remedy}"), *found[1:]
    return Analysis(
        study=study,
        phasors=phasors,
        transfer_matrices=MappingProxyType(transfer_matrices),
        compensated_transfer_matrices=MappingProxyType(freed),
        transfer_problem=problem,
        fit=fits[method],
        fits=MappingProxyType(fits),
        findings=found,
    )


def analyse_arm_side(study: Study, robot: RobotModel | None = None) -> ArmSideFit:
    """Identify K of the joints of a study with sensors behind their gears.

    ``robot`` is by default that of the study; gear ratios that it lacks are those of the study. Raises
    JointIdError when the study has no such sensor or no robot model, or see ``identify_arm_side``.
    """
    records, robot = study.motion_records, study.robot_model if robot is None else robot
    if all(record.arm_rad is None for record in records):
        raise JointIdError(
            "No record has a sensor behind a gear: give columns theta_a1_rad …, or identify K and "
            "D from the motors alone with analyse (jointid identify)."
        )
    if robot is None:
        raise JointIdError(
            "Sensors behind the gears need the robot model: give a file .urdf, .xml (MJCF) or .toml "
            "(Denavit–Hartenberg), or state [robot_model] in study.toml."
        )
    if study.gear_ratio is not None and not np.isfinite(robot.coupling).all():
        robot = replace(robot, coupling=np.diag(1 / study.gear_ratio))
    return identify_arm_side(records, robot)


def _fits_with_motion(
    study: Study, phasors: Phasors, method: str, matrices: dict[str, TransferMatrix]
) -> dict[str, ElasticityFit]:
    """The fit of all records together, and linear fits of the sines where they allow them."""
    require_method(method)
    if method in LINEAR:
        raise JointIdError(
            f'The estimator "{method}" takes sine records only, and this study has records of other '
            'motions: choose "auto".'
        )
    inertia = study.inertias if study.poses else study.inertia
    try:
        fits = {
            method: identify_motion(
                study.records,
                inertia,
                inertia_std=study.inertia_std,
                torque_std=study.torque_std,
                gives_up=cache(lambda: bool(wrong_motions(study.records, study.inertias, matrices))),
            )
        }
    except JointIdError as error:
        if all(record.arm_rad is None for record in study.motion_records):
            raise
        raise JointIdError(f"{error}{BEHIND_THE_GEARS}") from error
    with suppress(JointIdError):  # a sine or two beside the motions need not determine K and D
        fits |= identify_each(phasors, study.sine_prior, LINEAR) if phasors.omega.size else {}
    return fits


def _motions_by_pose(
    study: Study, matrices: dict[str, TransferMatrix], problem: str
) -> tuple[dict[str, list[MotionRecord]], str]:
    """Motions, with their bands, of the poses that have no transfer matrix by sines."""
    found: dict[str, list[MotionRecord]] = {}
    motions = [record for record in study.motion_records if (record.pose or "") not in matrices]
    for pose in dict.fromkeys(record.pose or "" for record in motions):
        try:
            found[pose] = [
                replace(record, band_hz=record.band_hz or coherent_band(record))
                for record in motions
                if (record.pose or "") == pose
            ]
        except JointIdError as error:  # K and D do not need H
            problem = str(error)
    return found, problem


def _motion_matrices(
    by_pose: dict[str, list[MotionRecord]], problem: str, fit: ElasticityFit | None = None
) -> tuple[dict[str, TransferMatrix], str]:
    """Transfer matrices of motions, without the friction and the delay of a fit."""
    without: dict[str, Any] = {}
    if fit is not None:
        without = {"delay": fit.delay or 0.0}
        if fit.friction is not None:
            without |= {"coulomb": fit.friction.coulomb, "viscous": fit.friction.viscous}
    matrices = {}
    for pose, records in by_pose.items():
        try:
            matrices[pose] = motion_transfer_matrix(records, **without)
        except JointIdError as error:  # K and D do not need H
            problem = str(error)
    return matrices, problem


def _transfer_matrices(study: Study, phasors: Phasors) -> tuple[dict[str, TransferMatrix], str]:
    matrices, problem = {}, ""
    for pose in dict.fromkeys(record.pose or "" for record in study.sine_records):
        try:
            matrices[pose] = estimate_transfer_matrix(phasors.select(study.of_pose(pose)))
        except JointIdError as error:  # K and D do not need H
            problem = str(error)
    return matrices, problem
