"""Parts of the standard errors of K and D by their cause."""

from dataclasses import dataclass

import numpy as np

from jointid.answer import AT_MOTOR, StiffnessUnit
from jointid.arrays import Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.wording import UNDETERMINED, significant

_PARTS = {
    "noise": "noise",
    "prior": "inertias and torque scale",
    "unseen": "friction harmonics",
    "choice": "choice of model",
}
"""Name of each part; the fit holds it as ``noise_error`` and so on."""
PARTS_MEANING = (
    "Friction harmonics: allowance for the shape of friction beyond the fitted harmonics. Choice of "
    "model: difference to models that fit about as well."
)
"""Explains the parts that need it."""


@dataclass(frozen=True, eq=False)
class ErrorPart:
    """Part of the standard errors due to one cause."""

    key: str
    name: str
    error: Floats
    """Of K1 ... Kn, D1 ... Dn, shape (2n,); the squares of all parts add up to the total."""


def error_parts(fit: ElasticityFit) -> tuple[ErrorPart, ...]:
    """Return the parts of ``fit.standard_error``; those that do not apply are zero."""
    parts = []
    for key, name in _PARTS.items():
        error = np.broadcast_to(getattr(fit, f"{key}_error"), 2 * fit.n)
        parts.append(ErrorPart(key, name, np.asarray(error, float)))
    return tuple(parts)


def error_table(fit: ElasticityFit, unit: StiffnessUnit = AT_MOTOR) -> dict[str, list[str]]:
    """Columns of a table: the total standard error of K and D, and its parts.

    Parts that are zero throughout are left out; that with the largest share of an error comes first.
    """
    parts = [part for part in error_parts(fit) if np.any(part.error > 0)]
    total = fit.standard_error
    known = np.isfinite(total) & (total > 0)
    parts.sort(key=lambda part: -float(np.max(part.error[known] / total[known], initial=0.0)))
    names = zip(elasticity_labels(fit.n), unit.units(fit.n), strict=True)
    columns = {"": [f"{name} ({of})" for name, of in names]}
    for name, error in (("total error", total), *((part.name, part.error) for part in parts)):
        unknown = UNDETERMINED if error is total else "–"
        sizes = zip(unit.shown(error).tolist(), np.isinf(total), strict=True)
        columns[name] = [unknown if lost else significant(size, 2) for size, lost in sizes]
    return columns
