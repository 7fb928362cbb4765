"""Tables of the answer: parts of the standard errors by their cause, and the compared models."""

from collections.abc import Iterable

import numpy as np

from jointid.answer import AT_MOTOR, StiffnessUnit, elasticity_quantities
from jointid.arrays import Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.wording import UNDETERMINED, capitalised, significant

_PARTS = {
    "noise": ("noise", "use longer records or a larger motion"),
    "prior": (
        "inertias and torque scale",
        "enter more accurate inertias or torque constants, or add records with a known payload",
    ),
    "unseen": ("friction harmonics", "move the joints faster, so that friction matters less"),
    "choice": (
        "choice of model",
        "add records of other amplitudes and frequencies, which decide between the models",
    ),
}
"""Name of each part, and what reduces it; the fit holds it as ``noise_error`` and so on."""
_MEANING = {
    "friction harmonics": "allowance for the shape of friction beyond the fitted harmonics",
    "choice of model": "difference from models that fit about as well",
}


def error_parts(fit: ElasticityFit) -> dict[str, Floats]:
    """Return the parts of ``fit.standard_error`` by cause, each (2n,); their squares add up to its own.

    Parts that do not apply are zero.
    """
    return {key: np.zeros(2 * fit.n) + getattr(fit, f"{key}_error") for key in _PARTS}


def largest_part(fit: ElasticityFit) -> str:
    """Say which part makes the largest relative error, and what reduces that part."""
    parts, size = error_parts(fit), np.maximum(np.abs(fit.estimate), np.finfo(float).tiny)
    worst = int(np.argmax(fit.standard_error / size))
    main = max(parts, key=lambda key: float(parts[key][worst]))
    name, (part, remedy) = elasticity_labels(fit.n)[worst], _PARTS[main]
    if not np.isfinite(fit.standard_error[worst]):
        return f"{name} is {UNDETERMINED}: the findings name the record that is missing."
    return f"The largest error is that of {name}; its largest part comes from {part}: {remedy}."


def error_table(fit: ElasticityFit, unit: StiffnessUnit = AT_MOTOR) -> dict[str, list[str]]:
    """Columns of a table: the total standard error of K and D, and its parts.

    Parts that are zero throughout are left out; that with the largest share of an error comes first.
    """
    parts = [(_PARTS[key][0], error) for key, error in error_parts(fit).items() if np.any(error > 0)]
    total = fit.standard_error
    known = np.isfinite(total) & (total > 0)
    parts.sort(key=lambda part: -float(np.max(part[1][known] / total[known], initial=0.0)))
    columns = {"": [found.heading for found in elasticity_quantities(fit, unit)]}
    for name, error in (("total error", total), *parts):
        unknown = UNDETERMINED if error is total else "–"
        sizes = zip(unit.shown(error).tolist(), np.isinf(total), strict=True)
        columns[name] = [unknown if lost else significant(size, 2) for size, lost in sizes]
    return columns


def parts_meaning(table: Iterable[str]) -> str:
    """Explain those columns of ``error_table`` that need it."""
    found = [f"{capitalised(name)}: {_MEANING[name]}." for name in table if name in _MEANING]
    return " ".join(found)


COMPARED_MODELS = (
    "Fitted models compared. The smallest information criterion is chosen: the residual plus a penalty "
    "for every parameter. A dash: the fit failed, a part of the model is not significant, or its "
    "friction at the reversals contradicts the fundamentals. Reversals free below 3 %: a motor may "
    "stick around a reversal, so its friction below 3 % of the largest speed is not modelled; it has a "
    "free waveform, whose values count as parameters."
)
"""Explains ``compared_models``."""


def compared_models(fit: ElasticityFit) -> dict[str, list[str]]:
    """Columns of a table: the models that were fitted, best first."""
    columns: dict[str, list[str]] = {
        "Fitted model": [c.name + " (chosen)" * c.chosen for c in fit.candidates],
        "Parameters": ["–" if c.problem else str(c.parameters) for c in fit.candidates],
    }
    misfits = [c.cost / c.expected_cost if c.expected_cost > 0 else np.inf for c in fit.candidates]
    criteria = np.array([c.criterion for c in fit.candidates])
    for name, values, digits in (
        ("Residual / noise", np.sqrt(misfits), 3),
        ("Criterion", criteria, 5),
    ):
        columns[name] = [significant(x, digits) if np.isfinite(x) else "–" for x in values.tolist()]
    return columns
