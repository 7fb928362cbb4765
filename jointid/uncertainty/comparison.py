"""Two identifications side by side: before and after a gear change, cold and warm, two estimators."""

from dataclasses import dataclass

import numpy as np

from jointid.answer import AT_MOTOR, StiffnessUnit, elasticity_quantities
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.quantities import Quantity
from jointid.wording import counted


@dataclass(frozen=True)
class Difference:
    """One parameter of two identifications."""

    first: Quantity
    second: Quantity
    relative: float
    """Second over first, less 1."""
    sigmas: float
    """Difference over its standard error; NaN where the two errors are not independent."""


def compare(
    first: ElasticityFit,
    second: ElasticityFit,
    *,
    same_records: bool = False,
    units: tuple[StiffnessUnit, StiffnessUnit] = (AT_MOTOR, AT_MOTOR),
) -> tuple[Difference, ...]:
    """Compare K and D of two identifications.

    The standard error of a difference takes both errors as independent. A common cause, such as the
    torque constant of the same robot, moves both alike and makes the stated number of standard errors
    too small. With ``same_records`` the noise is common, and no number of standard errors is stated.
    ``units`` are those of either study, of one side and angle, each with its own gear ratios. Returns
    K1 ... Kn, D1 ... Dn. Raises JointIdError when the numbers of joints differ.
    """
    if first.n != second.n:
        raise JointIdError(
            f"The first study has {counted(first.n, 'joint')}, the second {counted(second.n, 'joint')}: "
            "choose studies of the same joints."
        )
    shown = map(elasticity_quantities, (first, second), units)
    found = []
    for one, other in zip(*shown, strict=True):
        error = float(np.hypot(one.error, other.error))
        change = other.value - one.value
        sigmas = np.nan if same_records or error == 0 else change / error
        relative = change / one.value if one.value else np.nan
        found.append(Difference(one, other, relative, float(sigmas)))
    return tuple(found)
