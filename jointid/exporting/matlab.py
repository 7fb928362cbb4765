"""All results as one MATLAB file (version 5), for ``ss`` and ``frd``."""

from collections.abc import Mapping
from contextlib import suppress
from io import BytesIO
from typing import Any

import numpy as np
from scipy.io import savemat

from jointid.analysis import NOT_USABLE, Analysis
from jointid.errors import JointIdError
from jointid.exporting.identification import to_document
from jointid.exporting.state_space import state_space
from jointid.exporting.tables import without_friction_and_delay
from jointid.transfer_matrix import TransferMatrix

_HEADER = b"MATLAB 5.0 MAT-file, written by jointid"
_HEADER_BYTES = 116
"""Length of the text header of a MAT-file, version 5."""


def to_mat(analysis: Analysis) -> bytes:
    """Write results as a .mat file; equal analyses give equal bytes.

    Variables: ``identification`` (struct as in JSON: state, K, D, covariance, obtained ...; Inf where
    JSON has null); ``model`` (struct A, B, C, D for ``ss(model.A, model.B, model.C, model.D)``, torque
    to acceleration of the motors, with the fitted inertias; missing for an unphysical estimate and an
    unusable answer); ``transfer`` (struct array by pose: ``frd(transfer(1).H, transfer(1).omega)``, H as
    measured); ``transfer_without_friction_and_delay`` (friction- and delay-compensated; missing without
    them); ``phasors`` (struct omega, q, tau, std, labels).
    """
    document = to_document(analysis)
    if poses := document.pop("poses", None):
        document["poses"] = [{"name": name, **table} for name, table in poses.items()]
    phasors = analysis.phasors
    contents: dict[str, Any] = {
        "identification": _prepared(document),
        "phasors": {
            "omega": phasors.omega,
            "q": phasors.q,
            "tau": phasors.tau,
            "std": phasors.standard_deviation,
            "labels": np.array(phasors.labels, dtype=object),
        },
    }
    if analysis.transfer_matrices:
        contents["transfer"] = _transfer(analysis.transfer_matrices)
    if free := without_friction_and_delay(analysis):
        contents["transfer_without_friction_and_delay"] = _transfer(free)
    if analysis.state != NOT_USABLE:
        with suppress(JointIdError):  # an unphysical estimate has no model
            contents["model"] = state_space(analysis.inertia(), analysis.fit.elasticity)._asdict()
    file = BytesIO()
    options: dict[str, Any] = {"long_field_names": True, "do_compression": True, "oned_as": "column"}
    savemat(file, contents, **options)  # type: ignore[arg-type]
    data = file.getvalue()
    return _HEADER.ljust(_HEADER_BYTES) + data[_HEADER_BYTES:]  # without the time of writing


def _transfer(matrices: Mapping[str, TransferMatrix]) -> np.ndarray:
    return _structs(
        {
            "pose": pose,
            "omega": matrix.omega,
            "H": np.moveaxis(matrix.H, 0, -1),
            "std": np.moveaxis(matrix.standard_deviation, 0, -1),
            "condition": matrix.condition,
        }
        for pose, matrix in matrices.items()
    )


def _prepared(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _prepared(item) for key, item in value.items()}
    if isinstance(value, list):
        if value and isinstance(value[0], dict):
            return _structs(_prepared(item) for item in value)
        if value and isinstance(value[0], str):
            return np.array(value, dtype=object)
        array = np.array(value, dtype=np.float64)
        array[np.isnan(array)] = np.inf  # None
        return array
    if value is None:
        return np.inf
    return float(value) if isinstance(value, int) else value


def _structs(rows: Any) -> np.ndarray:
    """A MATLAB struct array, indexed with (k)."""
    rows = list(rows)
    array = np.empty(len(rows), dtype=[(name, object) for name in rows[0]])
    for k, row in enumerate(rows):
        array[k] = tuple(row.values())
    return array
