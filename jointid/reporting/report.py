"""The report of a study: answer, verdict, figures, settings, records.

The same study gives the same report to the last byte: it has no date and no machine name.
"""

from collections.abc import Callable, Iterator
from itertools import count

from jointid.analysis import NOT_USABLE, Analysis
from jointid.answer import (
    ERROR_BARS,
    UNSTATED_TORQUE_SCALE,
    change_from,
    friction_note,
    further_quantities,
)
from jointid.cut.outcome import Outcome, millimetres, robot_text
from jointid.files.application import __version__
from jointid.files.digest import study_digest
from jointid.reporting.blocks import Block, Paragraph, Report, Section, Table, Verdict
from jointid.reporting.evidence import cut_blocks, outcome_of, response_blocks, torsion_blocks
from jointid.reporting.html import to_html
from jointid.reporting.pdf import to_pdf
from jointid.reporting.settings import digit_blocks, record_rows, settings_blocks
from jointid.uncertainty.error_parts import PARTS_MEANING, error_table
from jointid.uncertainty.prior_rows import PRIOR_HEADER
from jointid.wording import capitalised, plain

__all__ = ["make_report", "to_html", "to_pdf"]


def make_report(
    analysis: Analysis,
    *,
    cut: bool = True,
    progress: Callable[[float, str], object] | None = None,
) -> Report:
    """Write the report of an analysis, for ``to_html`` and ``to_pdf``.

    ``cut`` includes the cut of Figure 7, about a second; for two joints only. ``progress`` is called
    with the share done and the next step. Its exceptions end the work.
    """
    study = analysis.study
    tell = progress or (lambda done, what: None)
    tell(0.0, "Simulating the cut before and after")
    outcome, problem = outcome_of(analysis) if cut else (None, "")
    numbers = (f"Figure {k}." for k in count(1))
    tell(0.4, "Drawing the transfer matrix")
    sections = [
        Section("Answer", tuple(_answer(analysis, outcome))),
        Section("Verdict", (Verdict(analysis.findings),)),
        Section("Torsion curves of the gears", tuple(torsion_blocks(analysis, numbers))),
        Section("Model and measurement", tuple(response_blocks(analysis, numbers))),
    ]
    tell(0.5, "Simulating the three corner zones")
    if outcome is not None or problem:
        sections.append(
            Section("Path error before and after", tuple(cut_blocks(outcome, problem, numbers)))
        )
    tell(0.9, "Writing data and settings")
    sections += [
        Section("Data and settings", tuple(settings_blocks(analysis))),
        Section("Records", (record_rows(study),)),
        Section("Values with all digits", tuple(digit_blocks(analysis))),
    ]
    return Report(
        title=study.name or "Study without a name",
        facts=" · ".join([study.origin or "origin not stated", *study.facts]),
        sections=tuple(sections),
        footer=f"jointid {__version__} · study {study_digest(study)}",
    )


def _answer(analysis: Analysis, outcome: Outcome | None) -> Iterator[Block]:
    study, fit = analysis.study, analysis.fit
    yield Paragraph(analysis.headline, "lead")
    if analysis.caution:
        yield Paragraph(analysis.caution)
    for text in (study.description, *study.remarks):
        if text:
            yield Paragraph(text, "quiet")
    if study.changes:
        yield Paragraph(f"Changed from the data as logged: {' '.join(study.changes)}")
    header: tuple[str, ...] = ("", "identified", "unit", "nominal", "change")
    caption = f"{capitalised(analysis.unit.side)}. {ERROR_BARS} Nominal: in the controller at present."
    rows: list[tuple[str, ...]] = []
    for found in analysis.quantities:
        nominal, change = "–", "–"
        if analysis.nominal is not None:
            reference = float(analysis.nominal[found.place])
            nominal = plain(reference)
            if analysis.state != NOT_USABLE:
                change = change_from(found.value, found.error, reference)
        rows.append((f"{found.name}, {found.meaning}", *found.shown, nominal, change))
    if study.nominal is None:
        header, rows = header[:3], [row[:3] for row in rows]
        caption = caption.partition(" Nominal")[0]
    yield Table(header, tuple(rows), caption, "lrlrr"[: len(header)], kind="answer")
    if outcome is not None:
        yield Paragraph(
            f"Simulated path error of {robot_text(outcome.robot)}, as in Figure 7 of the paper: "
            f"{millimetres(outcome.before_m)} before, {millimetres(outcome.after_m)} after "
            f"({outcome.which}). {outcome.not_better if outcome.depends_on_elasticity else ''}".rstrip()
        )
    caption = f"Parts of the standard errors by cause, {analysis.unit.side}. {PARTS_MEANING}"
    yield Table.of(error_table(fit, analysis.unit), caption)
    yield Table(
        tuple(PRIOR_HEADER),
        tuple(tuple(row.cells) for row in analysis.priors),
        "Inertias and torque scales, motor side: J_m rotors, J_a arm, J_12 coupling. σ: standard "
        "deviation of the less certain value. "
        + (UNSTATED_TORQUE_SCALE if study.torque_std is None else ""),
        "lrrlr",
    )
    if further := further_quantities(fit):
        rows = [(quantity.name, *quantity.shown) for quantity in further]
        yield Table(
            ("", "identified", "unit"),
            tuple(rows),
            f"Fitted together with K and D. {friction_note(fit)}",
            "lrl",
        )
