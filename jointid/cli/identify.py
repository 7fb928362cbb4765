"""jointid identify and jointid arm-side."""

from pathlib import Path
from typing import Annotated

import typer

from jointid import RobotModel
from jointid.analysis import NOT_USABLE, Analysis, Answer, ArmSideAnalysis
from jointid.answer import ERROR_BARS, UNSTATED_TORQUE_SCALE, further_quantities, gear_text, model_name
from jointid.cli.files import answer_file
from jointid.cli.options import (
    INERTIA_STD,
    JSON,
    METHOD,
    SENSOR_UNIT,
    STUDY,
    TORQUE_STD,
    UNIT,
    named,
    without_none,
)
from jointid.cli.output import print_columns, print_json, print_table
from jointid.uncertainty.answer_tables import error_table, prior_table
from jointid.wording import plain


def identify(
    study: Annotated[Path, STUDY],
    method: Annotated[str, METHOD] = "auto",
    inertia_std: Annotated[float | None, INERTIA_STD] = None,
    torque_std: Annotated[float | None, TORQUE_STD] = None,
    unit: Annotated[str, UNIT] = "",
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Identify stiffness and damping of every joint.

    The first line states whether the answer is usable; findings follow, with remedies.
    """
    deviations = without_none(inertia_std=inertia_std, torque_std=torque_std)
    _print(study, answer_file(study, method, **deviations), unit, as_json)


def _print(study: Path, analysis: Answer, unit: str, as_json: bool) -> None:
    """State, headline, values and findings of every answer."""
    if as_json:
        from jointid.exporting.identification import to_document

        names = ("level", "title", "detail", "remedy")
        found = [{name: getattr(f, name) for name in names} for f in analysis.findings]
        print_json(to_document(analysis) | {"findings": found})
        return
    analysis = analysis.shown_in(unit) if unit else analysis
    print(f"{analysis.study.name or study.name}: {analysis.state}\n{analysis.headline}")
    for line in filter(None, (analysis.caution, *analysis.study.remarks)):
        print(line)
    _print_answer(analysis)
    for name, beside in [*analysis.each.items()][1:]:
        print(f"\n{name}: {beside.state}\n{beside.headline}")
        _print_answer(beside)


def _print_answer(analysis: Answer) -> None:
    """Values and findings; of an answer of the motors that is not usable the findings only."""
    if analysis.state != NOT_USABLE:
        _print_tables(analysis)
        _print_findings(analysis)
        return
    _print_findings(analysis)
    if isinstance(analysis, ArmSideAnalysis):
        _print_tables(analysis)
    else:
        print("\nK and D are not shown because they are not usable.")


def _print_findings(analysis: Answer) -> None:
    for finding in analysis.findings:
        remedy = f" {finding.remedy}" if finding.remedy else ""
        print(f"\n{finding.level.capitalize()}: {finding.title}. {finding.detail}{remedy}")


def _print_tables(analysis: Answer) -> None:
    if isinstance(analysis, ArmSideAnalysis):
        print_columns(analysis.table, right=(1, 2))
        print(analysis.error_bars)
        return
    assert isinstance(analysis, Analysis)
    fit, nominal = analysis.fit, analysis.nominal
    known = [] if nominal is None else [plain(float(value)) for value in nominal]
    fitted = (*analysis.quantities, *further_quantities(fit))
    print(f"\nModel: {model_name(fit)}. K and D {analysis.unit.side}.")
    rows = [
        [q.name if q.parameter in ("K", "D") else q.meaning, *q.shown, *known[q.place : q.place + 1]]
        for q in fitted
    ]
    print_table(["", "identified", "unit", "nominal"], rows, right=(1, 3))
    print("Gear laws, valid up to the largest torque in the records, motor side:")
    print(*(gear_text(fit, j) for j in range(fit.n)), sep="\n")
    print(f"\n{ERROR_BARS} Its parts:")
    columns = error_table(fit, analysis.unit)
    print_columns(columns, right=tuple(range(1, len(columns))))
    print("Inertias (J_m rotors, J_a arm, J_12 coupling) and torque scales:")
    print_columns(prior_table(analysis.priors), right=(1, 2, 4))
    print("σ: the larger of the two standard deviations.")
    if analysis.study.torque_std is None:
        print(UNSTATED_TORQUE_SCALE)


def arm_side(
    study: Annotated[Path, STUDY],
    robot: Annotated[
        Path | None,
        typer.Option(
            "--robot-model",
            parser=named,
            help="Robot model: .urdf, .xml (MJCF) or .toml (Denavit–Hartenberg); default: that of the "
            "study, [robot_model].",
        ),
    ] = None,
    unit: Annotated[str, SENSOR_UNIT] = "",
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Identify K from sensors behind the gears, at the joint.

    The first line states whether the answer is usable; findings follow, with the reason for each joint
    without an estimate.
    """
    changes = {} if robot is None else {"robot_model": RobotModel.load(robot)}
    _print(study, answer_file(study, "auto", arm_side=True, **changes), unit, as_json)
