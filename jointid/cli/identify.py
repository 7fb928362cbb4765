"""jointid identify."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from jointid.cli.files import analysed
from jointid.cli.options import JSON, METHOD, STUDY
from jointid.cli.output import print_json, print_table
from jointid.cli.program import reported
from jointid.estimation.parameters import elasticity_labels
from jointid.study import Analysis


@reported
def identify(
    study: Annotated[Path, STUDY],
    method: Annotated[str, METHOD] = "auto",
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Identify stiffness and damping of every joint."""
    analysis = analysed(study, method, quiet=as_json)
    document = identify_document(analysis)
    if as_json:
        print_json(document)
        return
    from jointid.rounding import plain, with_error

    fit, nominal = analysis.fit, analysis.study.nominal
    rows = []
    for k, name in enumerate(elasticity_labels(fit.n)):
        unit = "N·m/rad" if k < fit.n else "N·m·s/rad"
        known = "" if nominal is None else plain(float([*nominal.K, *nominal.D][k]))
        value = with_error(float(fit.estimate[k]), float(fit.standard_error[k]))
        rows.append([name, value, unit, known])
    if fit.friction is not None:
        values = [*fit.friction.coulomb, *fit.friction.viscous]
        for k, (value, error) in enumerate(zip(values, fit.friction.standard_error, strict=True)):
            unit = "N·m" if k < fit.n else "N·m·s/rad"
            name = f"{'Coulomb' if k < fit.n else 'viscous'} friction {k % fit.n + 1}"
            rows.append([name, with_error(float(value), float(error)), unit, ""])
    if fit.delay is not None:
        delay = with_error(1e3 * fit.delay, 1e3 * (fit.delay_error or 0.0))
        rows.append(["torque delay", delay, "ms", ""])
    print(f"{analysis.study.name or study.name}\n{document['answer']}\n")
    print_table(["", "identified", "unit", "nominal"], rows, right=(1, 3))
    for finding in analysis.findings:
        remedy = f" {finding.remedy}" if finding.remedy else ""
        print(f"\n{finding.level.capitalize()}: {finding.title}. {finding.detail}{remedy}")


def identify_document(analysis: Analysis) -> dict[str, Any]:
    """Document of the identification, with the answer as a sentence and the findings."""
    from jointid.answer import answer_sentence
    from jointid.exporting.identification import identification
    from jointid.exporting.identification_files import to_document

    return to_document(identification(analysis)) | {
        "answer": answer_sentence(analysis.fit, analysis.study.nominal),
        "findings": [
            {"level": f.level, "title": f.title, "detail": f.detail, "remedy": f.remedy}
            for f in analysis.findings
        ],
    }
