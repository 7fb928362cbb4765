"""The appendix of a report: settings, inertias, records, and all digits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from jointid.estimation.elasticity import METHODS, ElasticityFit
from jointid.estimation.parameters import elasticity_labels
from jointid.files.digest import study_digest
from jointid.joints import Inertia
from jointid.reporting.blocks import Block, Paragraph, Table
from jointid.rounding import plain, significant, with_error
from jointid.study import Analysis, Study
from jointid.version import __version__

_MAX_ROWS = 100
"""Rows of the list of records."""


def settings_blocks(analysis: Analysis) -> Iterator[Block]:
    """Software, study, estimator and model; inertias; results of other estimators."""
    study, fit = analysis.study, analysis.fit
    holds = {record.torque_hold for record in study.records}
    delays = sorted({record.torque_delay_s for record in study.records})
    hold = "held to the next sample" if True in holds else "momentary"
    hold = hold if len(holds) == 1 else "differs by record"
    facts = [
        ("Software", f"jointid {__version__}"),
        ("Study digest", f"{study_digest(study)}, the same for the same data and settings"),
        ("Estimator", f"{fit.method}: {METHODS[fit.method]}"),
        ("Fitted", _model(analysis)),
        (
            "Left over / noise",
            f"{significant(float(np.sqrt(fit.misfit)), 3)}: the equations leave so many times what "
            "noise explains; 1 is ideal",
        ),
        ("Torque samples", f"{hold}, stated delay {', '.join(plain(1e3 * d) for d in delays)} ms"),
        ("Harmonics fitted", str(analysis.phasors.harmonics.shape[1])),
    ]
    yield Table((), tuple(facts), kind="facts")
    yield _inertias(study)
    if len(fit.candidates) > 1:
        yield Table(
            ("model", "parameters", "left over / noise", "criterion", ""),
            tuple(
                (
                    c.name,
                    str(c.parameters) if not c.problem else "–",
                    significant(float(np.sqrt(c.cost / c.expected_cost)), 3)
                    if c.expected_cost > 0
                    else "–",
                    significant(c.criterion, 5) if np.isfinite(c.criterion) else "–",
                    "chosen" if c.chosen else "",
                )
                for c in fit.candidates
            ),
            "Models that were compared. Left over / noise: what the equations leave over what noise "
            "explains, 1 is ideal. "
            "The model of the smallest information criterion is chosen. One without a criterion could "
            "not be fitted, need not be because friction or the lack of a lag is certain, or adds what "
            "does not stand out of its own error.",
        )
    names = elasticity_labels(fit.n)
    yield Table(
        ("estimator", *names),
        tuple(
            (method, *(with_error(float(v), float(e)) for v, e in _estimates(other)))
            for method, other in analysis.fits.items()
        ),
        "Other estimators on the same records: the paper's least squares (13)–(14) and its explicit "
        "solution (15). They leave friction and delay out, where these were found.",
    )
    yield Table(
        ("correlation", *names),
        tuple((name, *(_two(v) for v in row)) for name, row in zip(names, fit.correlation, strict=True)),
        "How the errors of the estimates hang together.",
    )


def _model(analysis: Analysis) -> str:
    fit = analysis.fit
    chosen = next((c.name for c in fit.candidates if c.chosen), "")
    parts = ["K and D"]
    if fit.friction is not None:
        parts.append("Coulomb and viscous friction")
    if fit.delay is not None:
        parts.append("torque delay")
    free = f" ({chosen.partition(', ')[2]})" if ", " in chosen else ""
    return ", ".join(parts) + free


def _estimates(fit: ElasticityFit) -> Iterator[tuple[float, float]]:
    yield from zip(fit.estimate, fit.standard_error, strict=True)


def _inertias(study: Study) -> Table:
    n = study.inertia.n
    header = ["pose", *(f"J_m{j + 1}" for j in range(n))]
    pairs = [(i, j) for i in range(n) for j in range(i, n)]
    header += [f"J_a{i + 1}" if i == j else f"J_{i + 1}{j + 1}" for i, j in pairs]

    def row(name: str, inertia: Inertia) -> tuple[str, ...]:
        values = [*inertia.M, *(inertia.M2[i, j] for i, j in pairs)]
        return (name, *(plain(float(value)) for value in values))

    rows = [row("all records" if not study.poses else "without a pose", study.inertia)]
    rows += [row(name, inertia) for name, inertia in study.poses.items()]
    return Table(
        tuple(header),
        tuple(rows),
        "Inertias taken as known, motor side, kg·m²: J_m rotors, J_a arm, J_12 coupling. An error in "
        "them is an error in K and D.",
    )


def record_rows(study: Study) -> Table:
    """One row for all records of equal frequency, pose and length."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for number, record in enumerate(study.records, start=1):
        row = (
            record.pose or "–",
            plain(record.frequency_hz),
            significant(record.periods, 4),
            significant(record.periods / record.frequency_hz, 4),
            plain(round(1 / record.interval_s, 2)),
        )
        alike.setdefault(row, []).append(record.label or f"record {number}")
    columns = [0, *([] if all(r.pose is None for r in study.records) else [1]), 2, 3, 4, 5]
    header = ("records", "pose", "frequency (Hz)", "periods", "used (s)", "samples per s")
    table = [header, *(("; ".join(labels), *row) for row, labels in alike.items())]
    shown = [tuple(row[k] for k in columns) for row in table[: _MAX_ROWS + 1]]
    more = len(table) - len(shown)
    return Table(shown[0], tuple(shown[1:]), f"And {more} more rows, see the study." if more else "")


def digit_blocks(analysis: Analysis) -> Iterator[Block]:
    """All digits of every number, and the command to reproduce them."""
    fit = analysis.fit
    rows = [
        (name, repr(float(value)), repr(float(error)))
        for name, (value, error) in zip(elasticity_labels(fit.n), _estimates(fit), strict=True)
    ]
    if fit.friction is not None:
        values = [*fit.friction.coulomb, *fit.friction.viscous]
        names = [f"F_{kind}{j + 1}" for kind in "cv" for j in range(fit.n)]
        for name, value, error in zip(names, values, fit.friction.standard_error, strict=True):
            rows.append((name, repr(float(value)), repr(float(error))))
    if fit.delay is not None:
        rows.append(("delay", repr(fit.delay), repr(float(fit.delay_error or 0.0))))
    yield Paragraph(
        "For whoever wants to obtain the same: this study, this version and this estimator give these "
        "numbers (motor side, SI units); another processor may round the last digits otherwise. The "
        "command is: jointid identify STUDY"
        + (f" --method {fit.method}" if fit.method != "auto" else "")
        + " --json"
    )
    caption = "K in N·m/rad, D in N·m·s/rad"
    if fit.friction is not None:
        caption += "; F_c Coulomb friction in N·m, F_v viscous friction in N·m·s/rad"
    if fit.delay is not None:
        caption += "; delay in s"
    yield Table(("", "value", "standard error"), tuple(rows), f"{caption}.")


def _two(value: float) -> str:
    return f"{value + 0.0:.2f}".replace("-", "−").replace("−0.00", "0.00")
