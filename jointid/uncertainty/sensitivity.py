"""Sensitivity of K and D to the given inertias, and confidence ellipses.

The error bars of a fit contain the uncertainty of the inertias as its prior states it; the sensitivity
gives the change of K and D when a given inertia, the mean of the prior, is another one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.inertia_prior import InertiaPrior
from jointid.estimation.parameters import elasticity_labels
from jointid.joints import Inertia, arm_inertias
from jointid.phasors.extract import Phasors
from jointid.small_matrices import one_thread
from jointid.uncertainty.chosen_model import difference_by_inertia, inertia_of_each

_STEP = 1e-2
"""Relative change of an inertia for central differences, whose error is of second order."""
_OUTLINE_POINTS = 73
"""Points of a confidence ellipse: one every 5°, the first again at the end."""


@dataclass(frozen=True, eq=False)
class InertiaSensitivity:
    """Derivatives of K and D by the given inertias."""

    names: tuple[str, ...]
    """J_m1 ... J_mn, then J_a1, J_12, J_a2 ... of each pose."""
    value: Floats
    """The inertias, shape (E,), kg·m²."""
    estimate: Floats
    """K1 ... Kn, D1 ... Dn, shape (2n,)."""
    slope: Floats
    """Derivatives of K and D by each inertia, shape (2n, E), N·m/rad or N·m·s/rad per kg·m²."""

    @property
    def relative(self) -> Floats:
        """Percent of change in K and D for one percent of each inertia, shape (2n, E)."""
        size = np.where(self.estimate == 0, np.nan, self.estimate)
        return np.asarray(self.slope * self.value / size[:, None])

    def covariance(self, relative: float = 0.03) -> Floats:
        """Covariance of K and D for independent relative errors ``relative`` of the inertias."""
        if not (np.isfinite(relative) and relative >= 0):
            raise JointIdError(f"relative = {relative!r}: give a share such as 0.03 for 3 %.")
        spread = self.slope * self.value * relative
        return np.asarray(spread @ spread.T)

    def standard_error(self, relative: float = 0.03) -> Floats:
        """Standard errors of K and D from inertias of relative error ``relative``, shape (2n,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance(relative))))


def inertia_sensitivity(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    fit: ElasticityFit,
    *,
    progress: Callable[[float], None] | None = None,
) -> InertiaSensitivity:
    """Differentiate the chosen estimator, with its model and weights, by each inertia.

    Parameters
    ----------
    phasors, inertia
        Data of ``fit``.
    fit : ElasticityFit
    progress : callable, optional
        Called with the fraction done, up to 1.0; an exception from it ends the run.

    Raises
    ------
    JointIdError
        When there is no estimate after a small change of an inertia.
    """
    each = inertia_of_each(phasors, inertia)
    prior = InertiaPrior.of(each, *phasors.q.shape)
    parts = prior.part[prior.pose].tolist()
    n = fit.n
    elements: list[_Element] = []
    for j in range(n):
        mean = float(prior.M[:, j].mean())
        elements.append(_Element(f"J_m{j + 1}", mean, mean, None, j, j))
    for part, rest in enumerate(prior.rest):
        suffix = f", pose {part + 1}" if len(prior.rest) > 1 else ""
        for name, i, j in arm_inertias(n):
            scale = float(np.sqrt(rest[i, i] * rest[j, j]))
            elements.append(_Element(name + suffix, float(rest[i, j]), scale, part, i, j))
    slope = np.empty((2 * n, len(elements)))
    with one_thread():
        difference = difference_by_inertia(phasors, each, fit)
        for column, element in enumerate(elements):
            change = _STEP * element.scale
            plus, minus = (
                [_changed(one, part, element, by) for one, part in zip(each, parts, strict=True)]
                for by in (change, -change)
            )
            slope[:, column] = difference(plus, minus) / (2 * change)
            if progress is not None:
                progress((column + 1) / len(elements))
    return InertiaSensitivity(
        names=tuple(element.name for element in elements),
        value=np.array([element.value for element in elements]),
        estimate=fit.estimate,
        slope=slope,
    )


class _Element(NamedTuple):
    name: str
    value: float
    scale: float  # reference of the step, since a coupling may be zero
    part: int | None  # uncertain part of M2, see InertiaPrior; None for a rotor
    i: int
    j: int


def _changed(inertia: Inertia, part: int, element: _Element, by: float) -> Inertia:
    """The inertia of a record with this uncertain part of M2 after the change of one element."""
    if element.part is None:
        return Inertia(inertia.M + by * (np.arange(inertia.n) == element.j), inertia.M2, inertia.added)
    if element.part != part:
        return inertia
    M2 = inertia.M2.copy()
    M2[element.i, element.j] += by
    M2[element.j, element.i] = M2[element.i, element.j]
    return Inertia(inertia.M, M2, inertia.added)


@dataclass(frozen=True, eq=False)
class ConfidenceEllipse:
    """Confidence region of two parameters."""

    names: tuple[str, str]
    centre: Floats
    """Shape (2,)."""
    semi_axes: Floats
    """Lengths, larger first, shape (2,), in units of each parameter's standard error."""
    level: float
    """Probability, for instance 0.95."""
    outline: Floats
    """Closed curve, shape (points, 2), in the units of the parameters."""


def confidence_ellipse(
    fit: ElasticityFit, first: str, second: str, *, level: float = 0.95
) -> ConfidenceEllipse:
    """Ellipse of two parameters, for instance "K1" and "D1", from the fit's covariance.

    Raises
    ------
    JointIdError
        When a name is not one of the fit's parameters, both are the same, the level is out of range, or
        the records do not determine a parameter.
    """
    names = elasticity_labels(fit.n)
    for name in (first, second):
        if name not in names:
            raise JointIdError(f'"{name}" is not a parameter. Parameters: {", ".join(names)}.')
    if first == second or not 0 < level < 1:
        raise JointIdError(
            "An ellipse needs two different parameters and a level between 0 and 1; "
            f"got {first}, {second}, {level:g}."
        )
    index = [names.index(first), names.index(second)]
    error = fit.standard_error[index]
    if not np.all(np.isfinite(error)):
        raise JointIdError(f"{names[index[np.argmax(error)]]} is not determined by these records.")
    values, vectors = np.linalg.eigh(fit.correlation[np.ix_(index, index)])
    radius = np.sqrt(-2 * np.log(1 - level))  # χ² with two degrees of freedom
    axes = radius * np.sqrt(np.maximum(values, 0))
    angle = np.linspace(0, 2 * np.pi, _OUTLINE_POINTS)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    centre = fit.estimate[index]
    return ConfidenceEllipse(
        names=(first, second),
        centre=centre,
        semi_axes=axes[::-1].copy(),
        level=float(level),
        outline=centre + ((vectors * axes) @ circle).T * error,
    )
