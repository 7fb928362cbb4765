"""Phasors and transfer matrix as CSV tables that open anywhere; numbers are exact."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from io import StringIO

import numpy as np

from jointid.study import Analysis


def phasor_table(analysis: Analysis) -> str:
    """One row per record: the phasors of the motor angles and torques, equations (2)-(4).

    Parameters
    ----------
    analysis : Analysis

    Returns
    -------
    str
        CSV with a header row. f(t) = re sin ωt + im cos ωt; ``std`` is the root of the variance of the
        complex number. The torque is corrected for hold and delay.
    """
    p = analysis.phasors
    names = [f"theta_m{j + 1}|rad" for j in range(p.n)] + [f"tau_m{j + 1}|Nm" for j in range(p.n)]
    header = ["record", "pose", "frequency_hz"]
    for name in names:
        signal, unit = name.split("|")
        header += [f"{signal}_{part}_{unit}" for part in ("re", "im", "std")]
    values = np.stack([p.z.real, p.z.imag, p.standard_deviation], axis=2).reshape(p.omega.size, -1)
    rows = (
        [label, record.pose or "", record.frequency_hz, *row]
        for label, record, row in zip(p.labels, analysis.study.records, values.tolist(), strict=True)
    )
    return _csv(header, rows)


def transfer_matrix_table(analysis: Analysis) -> str:
    """One row per pose and frequency: H of equations (16)-(18), acceleration over torque, 1/(kg·m²).

    Parameters
    ----------
    analysis : Analysis

    Returns
    -------
    str
        CSV with a header row; only the header when the records allow no transfer matrix.
    """
    n = analysis.study.inertia.n
    header = ["pose", "frequency_hz"]
    for i in range(n):
        for j in range(n):
            header += [f"H{i + 1}{j + 1}_{part}" for part in ("re", "im", "std")]
    header += ["condition", "reciprocity_error"]
    rows: list[list[object]] = []
    for pose, matrix in analysis.transfer_matrices.items():
        f = matrix.omega / (2 * np.pi)
        values = np.stack([matrix.H.real, matrix.H.imag, matrix.standard_deviation], axis=3)
        quality = zip(matrix.condition.tolist(), matrix.reciprocity_error.tolist(), strict=True)
        for frequency, row, more in zip(
            f.tolist(), values.reshape(f.size, -1).tolist(), quality, strict=True
        ):
            rows.append([pose, frequency, *row, *more])
    return _csv(header, rows)


def _csv(header: list[str], rows: Iterable[list[object]]) -> str:
    """Python writes floats with the fewest digits that read back as the same number."""
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()
