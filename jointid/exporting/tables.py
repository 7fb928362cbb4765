"""The answer, phasors and transfer matrix as CSV tables; numbers are exact."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO

import numpy as np

from jointid.analysis import NOT_USABLE, Analysis, Answer, ArmSideAnalysis
from jointid.answer import without
from jointid.arrays import Floats
from jointid.exporting.identification import stored, warning_text
from jointid.gears.gear import knees
from jointid.phasors.extract import Phasors
from jointid.records import SineRecord
from jointid.transfer_matrix import TransferMatrix

_EVERY = 4
"""Every fourth point of a torsion curve is written, for a file of moderate size."""
_ROWS = 101
"""Rows of the look-up table of a law, besides its kinks; odd, so that zero is one of them."""
_NOT_TRIED_RAD = 1e-3
"""Its range for a gear without a torsion curve."""
_FORMULA = ("=", "+", "-", "@", "\t")
"""First characters by which a spreadsheet takes a text for a formula, and runs it."""


def answer_table(analysis: Answer) -> str:
    """One row per joint: K, and D where identified, with standard errors; NaN where not determined.

    CSV with a header row; ``side`` is that of the gear. With sensors behind the gears also their skew,
    the errors of the fitted deflection and of that predicted for records left out, and the reason of a
    refusal. Of an answer that is not usable, K and D are NaN.
    """
    header, sensed = ["joint", "side", "state"], isinstance(analysis, ArmSideAnalysis)
    rows: list[list[object]] = [
        [j + 1, "joint" if sensed else "motor", analysis.state] for j in range(analysis.study.inertia.n)
    ]
    for name, unit in (("K", "Nm_rad"), ("D", "Nms_rad")):
        own = [found for found in stored(analysis).quantities if found.parameter == name]
        header += [f"{name}_{unit}", f"{name}_std_{unit}"] if own else []
        for row, found in zip(rows, own, strict=False):
            known = np.isfinite(found.error) and analysis.state != NOT_USABLE
            row += [found.value, found.error] if known else [np.nan, np.nan]
    if isinstance(analysis, ArmSideAnalysis):
        fit = analysis.fit
        more = fit.skew_s, fit.skew_error_s, fit.residual_rad, analysis.left_out_rad
        header += ["skew_s", "skew_std_s", "residual_rad", "left_out_rad", "reason"]
        for row, values, reason in zip(rows, np.transpose(more).tolist(), fit.reasons, strict=True):
            row += [*values, reason]
    return csv_text(header, rows)


def phasor_table(analysis: Analysis) -> str:
    """One row per record of an analysis, see ``phasors_csv``."""
    return phasors_csv(analysis.phasors, analysis.study.sine_records)


def phasors_csv(p: Phasors, records: Sequence[SineRecord]) -> str:
    """One row per record: the phasors of the motor angles and torques, equations (2)-(4).

    CSV with a header row: f(t) = re sin ωt + im cos ωt; ``std`` is the root of the variance of the
    complex number. The torque is corrected for hold and delay.
    """
    header = ["record", "pose", "frequency_hz"]
    for signal, unit in (("theta", "rad"), ("tau", "Nm")):
        header += [
            f"{signal}_m{j + 1}_{part}_{unit}" for j in range(p.n) for part in ("re", "im", "std")
        ]
    values = np.stack([p.z.real, p.z.imag, p.standard_deviation], axis=2).reshape(p.omega.size, 6 * p.n)
    rows = (
        [label, record.pose or "", record.frequency_hz, *row]
        for label, record, row in zip(p.labels, records, values.tolist(), strict=True)
    )
    return csv_text(header, rows)


def transfer_matrix_table(analysis: Analysis) -> str:
    """One row per pose and frequency: H of equations (16)-(18), acceleration over torque, 1/(kg·m²).

    CSV with a header row; only the header without a transfer matrix. H as measured; with identified
    friction or delay also compensated, in columns ``H11_without_friction_and_delay_re`` and so on.
    """
    n = analysis.study.inertia.n
    free = without_friction_and_delay(analysis)
    names = [f"H{i + 1}{j + 1}" for i in range(n) for j in range(n)]
    header = ["pose", "frequency_hz", *_parts(names), "condition", "reciprocity_error"]
    if free:
        header += _parts([f"{name}_without_friction_and_delay" for name in names])
    rows: list[list[object]] = []
    for pose, matrix in analysis.transfer_matrices.items():
        quality = zip(matrix.condition.tolist(), matrix.reciprocity_error.tolist(), strict=True)
        cleaned = dict(zip(free[pose].omega.tolist(), _cells(free[pose]), strict=True)) if free else {}
        nothing = [""] * (3 * n * n if free else 0)
        for omega, row, more in zip(matrix.omega.tolist(), _cells(matrix), quality, strict=True):
            frequency = omega / (2 * np.pi)
            rows.append([pose, frequency, *row, *more, *cleaned.get(omega, nothing)])
    return csv_text(header, rows)


def torsion_table(analysis: Analysis) -> str:
    """Torsion curves: one row per joint, record (of a motion: segment) and point of its period.

    CSV with a header row: measured deflection and torque of the gear with their noise (standard
    deviation), and the elastic torque of the fitted law: damping and hysteresis are part of the measured
    torque alone. Motor side; the mean deflection of a record is set to 0.
    """
    header = ["joint", "record", "pose", "frequency_hz", "deflection_rad", "torque_Nm"]
    header += ["deflection_std_rad", "torque_std_Nm", "elastic_law_Nm"]
    rows: list[list[object]] = []
    labels = analysis.phasors.labels  # of sines; a motion has segments
    for j, (curve, gear) in enumerate(zip(analysis.fit.torsion_curves, analysis.fit.gears, strict=True)):
        law = gear.torque(curve.deflection_rad)
        for r, frequency in enumerate(curve.frequency_hz.tolist()):
            name, pose = f"segment {r + 1}", ""
            if len(labels) == len(curve.frequency_hz):
                name, pose = labels[r], analysis.study.records[r].pose or ""
            noise = float(curve.deflection_noise_rad[r]), float(curve.torque_noise_Nm[r])
            points = np.stack([curve.deflection_rad[r], curve.torque_Nm[r], law[r]], axis=1)[::_EVERY]
            rows += [[j + 1, name, pose, frequency, x, y, *noise, f] for x, y, f in points.tolist()]
    return csv_text(header, rows)


def gear_table(analysis: Analysis) -> str:
    """Torque of every gear's law over its deflection as a look-up table, up to the torque tried.

    For Simulink's 1-D Lookup Table and your own controller, which interpolate linearly: edges of the
    backlash and changes of slope are among its rows. Without damping and hysteresis; motor side. CSV
    with columns ``deflection_m1_rad, torque_m1_Nm, deflection_m2_rad, ...``. The torques of an unusable
    answer are NaN, and the first column's name says so.
    """
    header = [
        f"{name}_m{j + 1}_{unit}"
        for j in range(analysis.fit.n)
        for name, unit in (("deflection", "rad"), ("torque", "Nm"))
    ]
    if analysis.state == NOT_USABLE:
        header[:1] = [f"NOT_USABLE_{header[0]}"]
    return csv_text(header, np.concatenate(_law_tables(analysis), axis=1).tolist())


def modelica_table(analysis: Analysis) -> str:
    """The same as tables ``gear1, gear2, ...`` of one text file for Modelica's CombiTable1Ds."""
    lines = ["#1"]
    if analysis.state == NOT_USABLE:
        lines = [f"#1 {warning_text(analysis, 'The torques are NaN.')}"]
    for j, table in enumerate(_law_tables(analysis), start=1):
        lines.append(f"double gear{j}({len(table)},2)  # deflection (rad), torque (N.m), motor side")
        lines += [f"{x!r} {y!r}" for x, y in table.tolist()]
    return "\n".join(lines) + "\n"


def _law_tables(analysis: Analysis) -> list[Floats]:
    """Deflection and torque of every gear, as many rows of each, shape (rows, 2)."""
    gears = analysis.fit.gears
    most = [gear.tried_rad or _NOT_TRIED_RAD for gear in gears]
    shares = [np.linspace(-1, 1, _ROWS)]
    for gear, range_rad in zip(gears, most, strict=True):
        half = 0.5 * gear.backlash_rad
        kinks = np.array([half, *(half + knee for knee in knees(gear)[0])]) / range_rad
        shares += [-kinks[kinks <= 1], kinks[kinks <= 1]]
    grid, usable = np.unique(np.concatenate(shares)), 1.0 if analysis.state != NOT_USABLE else np.nan
    return [
        np.stack([range_rad * grid, usable * gear.torque(range_rad * grid)], axis=1)
        for gear, range_rad in zip(gears, most, strict=True)
    ]


def without_friction_and_delay(analysis: Analysis) -> Mapping[str, TransferMatrix]:
    """Return transfer matrices without friction, delay and effects by pose; empty if none was fitted."""
    poses = analysis.transfer_matrices.keys() & analysis.compensated_transfer_matrices.keys()
    if not without(analysis.fit) or len(poses) < len(analysis.transfer_matrices):
        return {}
    return analysis.compensated_transfer_matrices


def _parts(names: Iterable[str]) -> list[str]:
    return [f"{name}_{part}" for name in names for part in ("re", "im", "std")]


def _cells(matrix: TransferMatrix) -> list[list[float]]:
    values = np.stack([matrix.H.real, matrix.H.imag, matrix.standard_deviation], axis=3)
    cells: list[list[float]] = values.reshape(matrix.omega.size, -1).tolist()
    return cells


def csv_text(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return CSV; floats have the fewest digits that give the same number again.

    A text that a spreadsheet would take for a formula gets an apostrophe in front, as spreadsheets do.
    """
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([_plain(name) for name in header])
    writer.writerows([_plain(cell) for cell in row] for row in rows)
    return text.getvalue()


def _plain(cell: object) -> object:
    if not isinstance(cell, str):
        return cell
    text = cell.replace("\r", " ")  # the writer leaves it bare: a spreadsheet begins a row there
    return f"'{text}" if text.lstrip(" ").startswith(_FORMULA) else text
