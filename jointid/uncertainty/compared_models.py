"""The fitted models of a study, side by side."""

import numpy as np

from jointid.estimation.elasticity import ElasticityFit
from jointid.wording import significant

COMPARED_MODELS = (
    "Fitted models compared. The smallest information criterion is chosen: the residual plus a penalty "
    "for every parameter. A dash: the fit failed, a part of the model is not significant, or its "
    "friction at the reversals contradicts the fundamentals. Reversals free below 3 %: a motor may "
    "stick around a reversal, so that its friction is not modelled below 3 % of the largest speed."
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
