"""The whole method in one call, and its results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import ClassVar, Self, TypeVar

import numpy as np

from jointid.answer import AT_MOTOR, ERROR_BARS, StiffnessUnit, answer_sentence, elasticity_quantities
from jointid.arm_side.fit import ArmSideFit
from jointid.arm_side.identify import TORQUE_STD, identify_arm_side
from jointid.arm_side.left_out import left_out_error
from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.linear_fit import LINEAR
from jointid.estimation.identify_elasticity import identify_each, require_method
from jointid.estimation.quantities import Quantity
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors, extract_phasors, no_phasors
from jointid.records import require_torques
from jointid.small_matrices import one_thread
from jointid.study import Study, fits_with_motion, motion_matrices, sine_matrices, spectra_by_pose
from jointid.transfer_matrix import TransferMatrix
from jointid.uncertainty.answer_tables import PriorRow, prior_rows
from jointid.verdict.findings import Evidence, Finding, ends_early, findings, limit_of_records
from jointid.verdict.motion_findings import arm_side_findings, at_odds, motion_findings

USABLE, WITH_CARE, NOT_USABLE = "usable", "usable with care", "not usable"
MOTORS_ALONE = "The motors alone give neither K nor D"
SENSORS_FAIL = "The sensors behind the gears give no K"
UNUSABLE_MOTORS = "The answer of the motors is not usable"
Found = TypeVar("Found")
STATES = (USABLE, WITH_CARE, NOT_USABLE)
"""States of an answer, best first."""


def answer_state(levels: Iterable[str]) -> str:
    """State of an answer, one of ``STATES``, from the levels of its findings."""
    found = set(levels)
    return NOT_USABLE if "problem" in found else WITH_CARE if "warning" in found else USABLE


@dataclass(frozen=True, eq=False, kw_only=True)
class Answer:
    """An identification with its state and headline, whatever gave it: motors or arm-side sensors."""

    study: Study
    findings: tuple[Finding, ...]
    """Findings on the data and the answer, most important first."""
    unit: StiffnessUnit = AT_MOTOR
    """Unit and side of K and D."""
    fit: ElasticityFit | ArmSideFit
    """The chosen estimate."""
    sensors: ArmSideAnalysis | None = None
    """K from sensors behind the gears beside that of the motors; None without them."""
    contradiction: str = ""
    """Title of the finding that motors and sensors behind the gears disagree; empty without."""
    error_bars: ClassVar[str] = ERROR_BARS
    """Causes that the standard errors include."""

    @property
    def torque_stated(self) -> bool:
        """Whether the errors include that of the torque scale; the robot model's always is."""
        return isinstance(self.fit, ArmSideFit) or self.study.torque_std is not None

    @property
    def each(self) -> dict[str, Answer]:
        """This answer, then the other one of the study if there is one, by their names."""
        both = {"Motors": self, "Sensors behind the gears": self.sensors}
        return {name: answer for name, answer in both.items() if answer}

    def shown_in(self, name: str) -> Self:
        """Return this answer in a unit of ``jointid.answer.STIFFNESS_UNITS``."""
        raise NotImplementedError

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """K1 ... Kn, and D1 ... Dn where identified, with their standard errors in ``unit``."""
        raise NotImplementedError

    @property
    def nominal(self) -> Floats | None:
        """Nominal K1 ... Kn and D1 ... Dn in ``unit``, shape (2n,); None if the study has no nominal."""
        of = self.study.nominal
        return None if of is None else self.unit.shown(np.concatenate([of.K, of.D]))

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
        stated, side = self.torque_stated, self.unit.side
        return answer_sentence(self.quantities, self.nominal, torque_stated=stated, side=side)

    def require_usable(self) -> None:
        """Raise JointIdError, with the reason, when the answer is not usable."""
        if self.state == NOT_USABLE:
            raise JointIdError(f"{self.headline} Resolve the findings first.")

    @property
    def caution(self) -> str:
        """Limit of a usable answer, as a sentence; empty otherwise."""
        return f"Usable with care: {self.state_reason}." if self.state == WITH_CARE else ""


@dataclass(frozen=True, eq=False, kw_only=True)
class ArmSideAnalysis(Answer):
    """K of joints with sensors behind their gears, at the joint, without D."""

    fit: ArmSideFit
    left_out_rad: Floats
    """Root mean square error of the deflection predicted for a record left out of the fit, shape (n,);
    NaN where K is undetermined or there is one record only."""
    motors: Analysis | None = None
    """Answer of the motors, where it is not usable; None where they give none."""
    error_bars: ClassVar[str] = (
        "± is one standard error from noise, payload, choice of terms and "
        f"{100 * TORQUE_STD:g} % of the robot model's torque."
    )

    @property
    def each(self) -> dict[str, Answer]:
        """This answer, then that of the motors if there is one, by their names."""
        return {"Sensors behind the gears": self} | ({"Motors": self.motors} if self.motors else {})

    def shown_in(self, name: str) -> Self:
        """Return this answer for the angle of a unit of ``STIFFNESS_UNITS``; it stays at the joint."""
        angle = StiffnessUnit.named(name, self.unit.gear_ratio).angle
        known = self.study.gear_ratios is not None
        motors = self.motors.shown_in(name) if self.motors and known else self.motors
        return replace(self, unit=replace(self.unit, angle=angle), motors=motors)

    @property
    def _unit_of_K(self) -> tuple[str, float]:
        scale = StiffnessUnit(self.unit.angle).of_gear(0)
        return scale.unit, scale.stiffness

    @property
    def table(self) -> dict[str, list[str]]:
        """K, skew and the reason if undetermined, of every joint, as text."""
        return self.fit.table_in(*self._unit_of_K)

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """K1 ... Kn with their standard errors, infinite where undetermined, in ``unit``."""
        unit, factor = self._unit_of_K
        errors = np.where(np.isfinite(self.fit.K), self.fit.standard_error, np.inf).tolist()
        return tuple(
            Quantity("K", f"K{j + 1}", unit, (j + 1,), factor * K, factor * error, j)
            for j, (K, error) in enumerate(zip(self.fit.K.tolist(), errors, strict=True))
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Analysis(Answer):
    """All results from the logs of the motors; ``sensors`` has those from sensors behind the gears."""

    phasors: Phasors
    """Equations (2)-(4) of the sine records, in their order; empty if there are none."""
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

    def shown_in(self, name: str) -> Self:
        """Return this analysis with K and D shown in a unit of ``jointid.answer.STIFFNESS_UNITS``.

        Raises JointIdError when the unit is not known, or the study lacks the gear ratios for it.
        """
        sensors = self.sensors and self.sensors.shown_in(name)
        return replace(self, unit=StiffnessUnit.named(name, self.study.gear_ratios), sensors=sensors)

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """K1 ... Kn and D1 ... Dn with their standard errors (all causes), in ``unit``; 2n values."""
        return elasticity_quantities(self.fit, self.unit)

    def limit_of_records(self, worst: Floats) -> str:
        """Remedy if k more records, with worst errors ``worst`` (k + 1,), do not help; else empty."""
        return limit_of_records(self.findings, self.fit, worst)

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
        transfer_matrices, problem = sine_matrices(study, phasors)
    if study.motion_records:
        by_pose, problem = spectra_by_pose(study, transfer_matrices, problem)
        of_motions, problem = motion_matrices(by_pose, problem)
        transfer_matrices |= of_motions
        fits = fits_with_motion(study, phasors, method, transfer_matrices)
        by_pose = {pose: by_pose[pose] for pose in of_motions}
        freed, problem = motion_matrices(by_pose, problem, fits[method])
        found = motion_findings(study.records, study.inertias, phasors, fits, transfer_matrices)
    else:
        fits = {} if known is None else dict(known.fits)
        fits |= identify_each(phasors, study.sine_prior, [m for m in LINEAR if m not in fits])
        given = sines, study.inertias, phasors, fits["weighted"], transfer_matrices
        evidence = Evidence(*given, automatic=None if known is None else known.fit)
        if method not in fits:  # no rich model explains wrong data, and the search would take long
            early, late = ends_early(evidence)
            fits |= identify_each(
                phasors, study.sine_prior, [method], gives_up=early, gives_up_late=late
            )
        fits = {name: fits[name] for name in dict.fromkeys((method, *LINEAR))}
        freed, _ = sine_matrices(study, fits[method].phasors)
        found = findings(replace(evidence, fit=fits[method]))
    if study.assumed and found[0].level == "problem":
        # The remarks of the study list it, wherever findings are shown.
        assumed = 'First check the assumptions of the import, listed as "Assumed, not confirmed".'
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


def analyse_arm_side(study: Study) -> ArmSideAnalysis:
    """Identify K of the joints of a study with sensors behind their gears.

    Raises JointIdError as ``Study.arm_side_robot`` and ``identify_arm_side``.
    """
    records, robot = study.motion_records, study.arm_side_robot()
    fit, left_out = identify_arm_side(records, robot), left_out_error(records, robot)
    of_motors = fit.motors.contradicted, fit.motors.misplaced, fit.motors.reversed.torque
    found = arm_side_findings(
        fit.K, fit.standard_error, fit.reasons, study.sensed_joints, left_out, *of_motors
    )
    unit = StiffnessUnit(gear_ratio=np.where(robot.is_coupled, np.nan, robot.gear_ratio))
    return ArmSideAnalysis(study=study, findings=found, unit=unit, fit=fit, left_out_rad=left_out)


def answer_of(
    study: Study,
    motors: Callable[[Study], Analysis] = analyse,
    sensors: Callable[[Study], ArmSideAnalysis] = analyse_arm_side,
) -> Analysis | ArmSideAnalysis:
    """Return all that a study gives: the analysis of its motors or of sensors behind its gears.

    The motors lead, as they also give D, with the others as ``sensors``; where only the sensors give a
    usable answer, they lead, with the others as ``motors``.
    Raises JointIdError, with both reasons, when neither gives an answer.
    """
    if not study.has_sensors:
        return motors(study)
    (found, lack), (beside, refusal) = _tried(motors, study), _tried(sensors, study)
    texts = [(MOTORS_ALONE, lack), (SENSORS_FAIL, refusal)]
    if found is None and beside is None:
        raise JointIdError(" ".join(f"{title}. {text}" for title, text in texts))
    if beside is not None and (found is None or found.state == NOT_USABLE != beside.state):
        texts.append((UNUSABLE_MOTORS, found.state_reason + "." if found else ""))
        return replace(beside, findings=_with_notes(beside, texts), motors=found)
    assert found is not None
    if beside and (odds := at_odds(replace(found, unit=beside.unit).quantities, beside.quantities)):
        found = replace(found, findings=(*found.findings, odds), contradiction=odds.title)
    return replace(found, findings=_with_notes(found, texts), sensors=beside)


def _with_notes(answer: Answer, notes: list[tuple[str, str]]) -> tuple[Finding, ...]:
    noted = [Finding("note", title, text, "", 0.0) for title, text in notes if text]
    return tuple(sorted((*answer.findings, *noted), key=lambda finding: -finding.weight))


def _tried(compute: Callable[[Study], Found], study: Study) -> tuple[Found | None, str]:
    """The result and no text, or no result and the reason."""
    try:
        return compute(study), ""
    except JointIdError as error:
        return None, str(error)
