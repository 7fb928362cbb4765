"""The appendix of a report: settings, inertias, records, and all digits."""

from collections.abc import Iterator
from math import isfinite

import numpy as np

from jointid.analysis import Analysis
from jointid.answer import elasticity_quantities, further_quantities, model_name
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.estimation.identify_elasticity import METHODS
from jointid.files.application import __version__
from jointid.files.digest import study_digest
from jointid.records import SineRecord
from jointid.reporting.blocks import Block, Paragraph, Table
from jointid.study import Study
from jointid.uncertainty.compared_models import COMPARED_MODELS, compared_models
from jointid.wording import UNDETERMINED, minus, plain, significant

_MAX_ROWS = 100
"""Rows of the list of records."""


def settings_blocks(analysis: Analysis) -> Iterator[Block]:
    """Software, study, estimator and model; results of other estimators."""
    study, fit = analysis.study, analysis.fit
    holds = {record.torque_hold for record in study.records}
    delays = sorted({record.torque_delay_s for record in study.records})
    hold = "held to the next sample" if True in holds else "instantaneous"
    hold = hold if len(holds) == 1 else "differs by record"
    harmonics = [("Harmonics fitted", str(analysis.phasors.harmonics.shape[1]))]
    facts = [
        ("Software", f"jointid {__version__}"),
        ("Paper", "Identification of Joint Elasticity of Industrial Robots"),
        ("Study digest", f"{study_digest(study)}, a checksum of data and settings"),
        ("Estimator", f"{fit.method}: {METHODS[fit.method]}"),
        ("Fitted model", _model(analysis)),
        ("Residual / noise", f"{significant(float(np.sqrt(fit.misfit)), 3)}; 1 is ideal"),
        ("Torque samples", f"{hold}, stated delay {', '.join(plain(1e3 * d) for d in delays)} ms"),
        *(harmonics if study.sine_records else []),
    ]
    yield Table((), tuple(facts), kind="facts")
    if len(fit.candidates) > 1:
        yield Table.of(compared_models(fit), COMPARED_MODELS)
    names = elasticity_labels(fit.n)
    header, *rows = [(name, *cells) for name, cells in analysis.estimates.items()]
    yield Table(
        header,
        tuple(rows),
        f"Estimators, {analysis.unit.side}. All except auto keep the given inertias and ignore "
        "friction and delay: the paper's least squares (13)–(14), its explicit solution (15), and "
        "weighted least squares.",
    )
    yield Table(
        ("correlation", *names),
        tuple(
            (name, *(minus(f"{v + 0.0:.2f}").replace("−0.00", "0.00") for v in row))
            for name, row in zip(names, fit.correlation, strict=True)
        ),
        "Correlation of the errors of the estimates.",
    )


def _model(analysis: Analysis) -> str:
    """The fitted model, with the extent of free friction."""
    chosen = next((c.name for c in analysis.fit.candidates if c.chosen), "")
    free = f" ({chosen.partition(', ')[2]})" if ", " in chosen else ""
    return model_name(analysis.fit) + free


def record_rows(study: Study) -> Table:
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
    return Table(table[0], rows, f"And {more} more rows, see the study." if more > 0 else "")


def digit_blocks(analysis: Analysis) -> Iterator[Block]:
    """All digits of every number, and the command to reproduce them."""
    fit = analysis.fit
    found = (*elasticity_quantities(fit), *further_quantities(fit))
    rows = [
        (q.name, repr(q.value), repr(q.error) if isfinite(q.error) else UNDETERMINED, q.unit)
        for q in found
    ]
    yield Paragraph(
        "To reproduce these numbers (motor side, SI units), use this study, version and estimator; "
        "another processor may round the last digits differently. Command: jointid identify STUDY"
        + (f" --method {fit.method}" if fit.method != "auto" else "")
        + " --json"
    )
    yield Table(("", "value", "standard error", "unit"), tuple(rows), align="lrrl")
