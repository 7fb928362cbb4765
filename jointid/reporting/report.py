"""The report of a study: answer, verdict, figures, settings, records.

The same study gives the same report to the last byte: it has no date and no machine name.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from math import isfinite

import numpy as np

from jointid.analysis import NOT_USABLE, Analysis, Answer, ArmSideAnalysis
from jointid.answer import (
    ERROR_BARS,
    STIFFNESS_UNITS,
    UNSTATED_TORQUE_SCALE,
    change_from,
    friction_note,
    further_quantities,
    model_name,
)
from jointid.cut.outcome import Outcome, cut_with_laws, millimetres, robot_text, with_laws_text
from jointid.cut.path_deflection import has_own_path
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.estimation.identify_elasticity import METHODS
from jointid.files.application import __version__
from jointid.files.digest import study_digest
from jointid.records import SineRecord
from jointid.reporting.blocks import Block, Paragraph, Report, Section, Table, Verdict
from jointid.reporting.evidence import (
    cut_blocks,
    outcome_of,
    own_path_blocks,
    response_blocks,
    sensor_blocks,
    torsion_blocks,
)
from jointid.reporting.html import to_html
from jointid.reporting.pdf import to_pdf
from jointid.study import INERTIA_STD, Study
from jointid.uncertainty.answer_tables import (
    COMPARED_MODELS,
    compared_models,
    error_table,
    estimates_table,
    parts_meaning,
    prior_table,
)
from jointid.wording import UNDETERMINED, capitalised, minus, plain, significant

__all__ = ["make_report", "to_html", "to_pdf"]

_MAX_ROWS = 100
"""Rows of the list of records."""
_INERTIA_DEFAULT = f"{plain(100 * INERTIA_STD)} % is assumed where a study states no σ of its inertias. "


def make_report(
    analysis: Answer,
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
    numbers = (f"Figure {k}." for k in count(1))
    sections = list(
        _sections(analysis, numbers, cut, tell)
        if isinstance(analysis, Analysis)
        else _sections_of_sensors(analysis, numbers)
    )
    tell(0.9, "Writing data and settings")
    sections += [
        Section("Data and settings", tuple(_settings(analysis))),
        Section("Records", (_records(study),)),
    ]
    if analysis.state != NOT_USABLE:
        sections.append(Section("Values with all digits", tuple(_digits(analysis))))
    return Report(
        title=study.name or "Study without a name",
        facts=" · ".join([study.origin or "origin not stated", *study.facts]),
        sections=tuple(sections),
        footer=f"jointid {__version__} · study {study_digest(study)}",
    )


def _sections(
    analysis: Analysis, numbers: Iterator[str], cut: bool, tell: Callable[[float, str], object]
) -> Iterator[Section]:
    """The answer of the motors with its evidence, and that of sensors behind the gears beside it."""
    outcome, problem = outcome_of(analysis) if cut else (None, "")
    tell(0.4, "Drawing the transfer matrix")
    values = () if analysis.state == NOT_USABLE else _answer(analysis, outcome)
    yield Section("Answer", (*_headline(analysis), *values))
    yield Section("Verdict", (Verdict(analysis.findings),))
    if found := analysis.sensors:
        blocks = *_state(found), Verdict(found.findings), *sensor_blocks(found, numbers)
        yield Section("Sensors behind the gears", blocks)
    yield Section("Torsion curves of the gears", tuple(torsion_blocks(analysis, numbers)))
    yield Section("Model and measurement", tuple(response_blocks(analysis, numbers)))
    tell(0.5, "Simulating the three corner zones")
    if outcome is not None or problem:
        yield Section("Path error before and after", tuple(cut_blocks(outcome, problem, numbers)))
    if cut and has_own_path(analysis):
        yield Section("Uncompensated deflection of the tool", tuple(own_path_blocks(analysis)))


def _sections_of_sensors(analysis: Answer, numbers: Iterator[str]) -> Iterator[Section]:
    """The answer of sensors behind the gears where the motors give none that is usable."""
    assert isinstance(analysis, ArmSideAnalysis)
    table, *evidence = sensor_blocks(analysis, numbers)
    yield Section("Answer", (*_headline(analysis), table))
    yield Section("Verdict", (Verdict(analysis.findings),))
    yield Section("Measured and fitted deflection", tuple(evidence))
    if motors := analysis.motors:
        yield Section("Motors", (*_state(motors), Verdict(motors.findings)))


def _state(analysis: Answer) -> Iterator[Block]:
    if analysis.state != NOT_USABLE:  # else the headline says so
        yield Paragraph(analysis.caution or "Usable.")
    yield Paragraph(analysis.headline, "lead")


def _headline(analysis: Answer) -> Iterator[Block]:
    """State and answer, and what the study says about itself."""
    study = analysis.study
    yield from _state(analysis)
    for text in (study.description, *study.remarks):
        if text:
            yield Paragraph(text, "quiet")
    if study.changes:
        yield Paragraph(f"Changed from the data as logged: {' '.join(study.changes)}")


def _answer(analysis: Analysis, outcome: Outcome | None) -> Iterator[Block]:
    study, fit = analysis.study, analysis.fit
    caption = f"{capitalised(analysis.unit.side)}. {ERROR_BARS}"
    columns = {
        "": [f"{q.name}, {q.meaning}" for q in analysis.quantities],
        "identified": [q.shown[0] for q in analysis.quantities],
        "unit": [q.shown[1] for q in analysis.quantities],
    }
    if analysis.nominal is not None:
        caption += " Nominal: in the controller at present."
        pairs = list(zip(analysis.quantities, analysis.nominal.tolist(), strict=True))
        columns["nominal"] = [plain(reference) for _, reference in pairs]
        changes = [change_from(q.value, q.error, reference) for q, reference in pairs]
        columns["change"] = changes
    yield replace(Table.of(columns, caption, "lrlrr"[: len(columns)]), kind="answer")
    if outcome is not None:
        yield Paragraph(
            f"Simulated path error of {robot_text(outcome.robot)}, as in Figure 7 of the paper: "
            f"{millimetres(outcome.before_m)} before, {millimetres(outcome.after_m)} after "
            f"({outcome.which}). {outcome.not_better if outcome.depends_on_elasticity else ''}".rstrip()
        )
        if outcome.robot.gears:
            run = cut_with_laws(outcome.robot, outcome.toolpath, friction=outcome.robot.friction)
            laws = "The simulated robots have the identified gear laws."
            yield Paragraph(f"{laws} {with_laws_text(run)}")
    parts = error_table(fit, analysis.unit)
    caption = f"Parts of the standard errors by cause, {analysis.unit.side}. {parts_meaning(parts)}"
    yield Table.of(parts, caption.rstrip())
    caption = (
        "Inertias and torque scales, motor side: J_m rotors, J_a arm, J_12 coupling. σ: the "
        "larger of the two standard deviations. "
    )
    caption += _INERTIA_DEFAULT if study.inertia_std == INERTIA_STD else ""
    caption += UNSTATED_TORQUE_SCALE if study.torque_std is None else ""
    yield Table.of(prior_table(analysis.priors), caption, "lrrlr")
    if further := further_quantities(fit):
        rows = [(capitalised(quantity.meaning), *quantity.shown) for quantity in further]
        caption = f"Fitted together with K and D. {friction_note(fit)}"
        yield Table(("", "identified", "unit"), tuple(rows), caption, "lrl")


def _known_to(std: float) -> str:
    """A relative standard deviation in words and per cent."""
    if std == 0:
        return "exact"
    return "unknown" if np.isinf(std) else f"{plain(100 * std)} %"


def _entered(study: Study) -> Table:
    """What was entered with the logs, as far as a study keeps it, and what of it is assumed."""
    stated = "given" if study.gear_ratio is not None else "from the robot model"
    ratios = study.gear_ratios
    default = ", assumed where nothing is stated" * (study.inertia_std == INERTIA_STD)
    unstated = "not stated: assumed exact"
    scale = unstated if study.torque_std is None else _known_to(study.torque_std)
    ratios_text = None if ratios is None else f"{', '.join(plain(x) for x in ratios.tolist())}, {stated}"
    facts = (
        ("Robot", study.robot or "not stated"),
        ("Date", str(study.date or "not stated")),
        ("Gear ratios, motor turns per joint turn", ratios_text or "not stated"),
        ("Relative σ of the inertias", f"{_known_to(study.inertia_std)}{default}"),
        ("Relative σ of the torque scale", scale),
        ("Assumed, not confirmed", "; ".join(study.assumed) or "nothing"),
    )
    caption = (
        "As entered. Positions and torques are stored at the motor, in rad and N·m: side, directions "
        "and rated torques of the logs were applied on import and are stated in the mapping only."
    )
    return Table((), facts, caption, kind="facts")


def _settings(analysis: Answer) -> Iterator[Block]:
    """Software, study, estimator and model; results of other estimators."""
    study, fit = analysis.study, analysis.fit
    yield _entered(study)
    facts = [
        ("Software", f"jointid {__version__}"),
        ("Paper", "Identification of Joint Elasticity of Industrial Robots"),
        ("Study digest", f"{study_digest(study)}, a checksum of data and settings"),
    ]
    if not isinstance(analysis, Analysis):
        facts[1:2] = [("Estimator", fit.method), ("Fitted model", model_name(fit))]
        yield Table((), tuple(facts), kind="facts")
        return
    fit = analysis.fit
    holds = {record.torque_hold for record in study.records}
    delays = sorted({record.torque_delay_s for record in study.records})
    hold = "held until the next sample" if True in holds else "not held"
    hold = hold if len(holds) == 1 else "differs by record"
    harmonics = [("Harmonics fitted", str(analysis.phasors.harmonics.shape[1]))]
    facts += [
        ("Estimator", f"{fit.method}: {METHODS[fit.method]}"),
        ("Fitted model", _model(analysis)),
        ("Residual / noise", f"{significant(float(np.sqrt(fit.misfit)), 3)}; 1 is ideal"),
        ("Torque samples", f"{hold}, stated delay {', '.join(plain(1e3 * d) for d in delays)} ms"),
        *(harmonics if study.sine_records else []),
    ]
    yield Table((), tuple(facts), kind="facts")
    if len(fit.candidates) > 1:
        yield Table.of(compared_models(fit), COMPARED_MODELS)
    if analysis.state == NOT_USABLE:
        return
    names = elasticity_labels(fit.n)
    fits = (fit, *analysis.fits.values())
    header, *rows = [
        (name, *cells) for name, cells in estimates_table(fits, analysis.nominal, analysis.unit).items()
    ]
    caption = (
        f"Estimators, {analysis.unit.side}. The linear ones keep the given inertias and ignore friction "
        "and delay: the paper's least squares (13)–(14), its explicit solution (15), and weighted least "
        "squares."
    )
    yield Table(header, tuple(rows), caption)
    rows = [
        (name, *(minus(f"{v + 0.0:.2f}").replace("−0.00", "0.00") for v in row))
        for name, row in zip(names, fit.correlation, strict=True)
    ]
    yield Table(("correlation", *names), tuple(rows), "Correlation of the errors of the estimates.")


def _model(analysis: Analysis) -> str:
    """The fitted model, with the extent of free friction."""
    chosen = next((c.name for c in analysis.fit.candidates if c.chosen), "")
    free = f" ({chosen.partition(', ')[2]})" if ", " in chosen else ""
    return model_name(analysis.fit) + free


def _records(study: Study) -> Table:
    """One row for all records of equal frequency, pose and length."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for number, record in enumerate(study.records, start=1):
        periods = significant(record.periods, 4) if isinstance(record, SineRecord) else "–"
        row = (
            record.pose or "–",
            record.excitation.removesuffix(" Hz"),
            periods,
            significant(record.samples * record.interval_s, 4),
            plain(round(1 / record.interval_s, 2)),
        )
        alike.setdefault(row, []).append(record.label or f"record {number}")
    header = ("records", "pose", "frequency (Hz)", "periods", "used (s)", "samples per s")
    table = [header, *(("; ".join(labels), *row) for row, labels in alike.items())]
    if all(record.pose is None for record in study.records):
        table = [(row[0], *row[2:]) for row in table]
    more = len(table) - 1 - _MAX_ROWS
    rows = tuple(table[1 : _MAX_ROWS + 1])
    return Table(table[0], rows, f"{more} more rows: see the study." if more > 0 else "")


def _digits(analysis: Answer) -> Iterator[Block]:
    """All digits of every number, and the command to reproduce them."""
    found, side = analysis.shown_in(next(iter(STIFFNESS_UNITS))).quantities, "joint"
    command = "arm-side STUDY"
    if isinstance(analysis, Analysis):
        fit = analysis.fit
        found, side = (*found, *further_quantities(fit)), "motor"
        command = "identify STUDY" + (f" --method {fit.method}" if fit.method != "auto" else "")
    rows = [
        (
            q.meaning if " " in q.name else q.name,
            repr(q.value) if isfinite(q.value) else "–",
            repr(q.error) if isfinite(q.error) else UNDETERMINED,
            q.unit,
        )
        for q in found
    ]
    yield Paragraph(
        f"To reproduce these numbers ({side} side, SI units), use this study, version and estimator; "
        f"another processor may round the last digits differently. Command: jointid {command} --json"
    )
    yield Table(("", "value", "standard error", "unit"), tuple(rows), align="lrrl")
