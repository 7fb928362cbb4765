"""The table of all numbers that an identification reports, each with its standard error."""

from dataclasses import dataclass

import numpy as np

from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.parameters import PARAMETERS
from jointid.wording import with_error


@dataclass(frozen=True)
class Quantity:
    """A fitted number with its standard error."""

    parameter: str
    """Key of ``PARAMETERS``."""
    name: str
    """As in "K1", "Coulomb friction 2" or "J_12"."""
    unit: str
    joints: tuple[int, ...]
    """Its joint, from 1, or pair of joints; () where it belongs to all."""
    value: float
    error: float
    """One standard error; of K and D from all causes."""
    place: int
    """Index in ``fit.parameters``, and of K and D in ``fit.estimate`` and ``fit.standard_error``."""

    @property
    def heading(self) -> str:
        """Name and unit, as in "K1 (N·m/rad)"."""
        return f"{self.name} ({self.unit})"

    @property
    def meaning(self) -> str:
        """In words, as in "stiffness of joint 1"."""
        joints = " and ".join(f"joint {j}" for j in self.joints)
        return PARAMETERS[self.parameter].name + (f" of {joints}" if joints else "")

    @property
    def shown(self) -> tuple[str, str]:
        """The value ± its error, and their unit; times in milliseconds."""
        scale, unit = (1e3, "ms") if self.unit == "s" else (1.0, self.unit)
        return with_error(scale * self.value, scale * self.error), unit


def quantities(fit: ElasticityFit) -> dict[str, tuple[Quantity, ...]]:
    """Return all fitted numbers by their key in ``PARAMETERS``, motor side, SI units."""
    table: dict[str, tuple[Quantity, ...]] = {}
    values = np.concatenate([fit.estimate, fit.parameters.vector[2 * fit.n :]]).tolist()
    errors, place = fit.errors.vector.tolist(), 0
    for name, _, labels, joints in fit.parameters.layout.blocks:
        rows = enumerate(zip(labels, joints, strict=True), start=place)
        table[name] = tuple(
            Quantity(name, label, PARAMETERS[name].unit, of, values[k], errors[k], k)
            for k, (label, of) in rows
        )
        place += len(labels)
    return table
