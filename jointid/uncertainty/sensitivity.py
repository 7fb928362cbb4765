"""Contribution of each given inertia and torque scale to the errors of K and D; confidence ellipses.

With the information A of the records and B of the given values, a fit has the covariance C = (A + B)⁻¹,
and its estimate moves by C B per unit of the given values. An error of one standard deviation in the
given value e moves K and D by C B^½, column e; all columns together make the prior's part C B C of C.
"""

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.linear_fit import LINEAR, prior_slopes
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.estimation.estimators.problem import fitted_layout
from jointid.phasors.extract import Phasors

_OUTLINE_POINTS = 73
"""Points of a confidence ellipse: one every 5°, the first again at the end."""


@dataclass(frozen=True, eq=False)
class PriorInfluence:
    """Influence of the given inertias and torque scales on K and D."""

    names: tuple[str, ...]
    """J_m1 ... J_mn, then J_a1, J_12, J_a2 ... of each pose, then the torque scales, E of them."""
    std: Floats
    """Standard deviations of the given values, shape (E,)."""
    shift: Floats
    """Change of K and D when a given value is larger by its standard deviation, shape (2n, E)."""

    @property
    def error(self) -> Floats:
        """Standard errors of K and D from all given values, shape (2n,)."""
        return np.asarray(np.linalg.norm(self.shift, axis=1))


def prior_influence(fit: ElasticityFit) -> PriorInfluence:
    """Influence of each given value; empty if all are exact, zero for unknown ones, which are fitted.

    Raises
    ------
    JointIdError
        When a linear estimator has no result after a small change of an inertia.
    """
    prior, noise = fit.prior, fit.equations.noise
    names = fitted_layout(prior, None, False).labels[2 * fit.n :]
    std, shift = prior_shift(fit.method, fit.phasors, prior, noise, fit.parameter_covariance)
    return PriorInfluence(names, std, shift)


def prior_shift(
    method: str, phasors: Phasors, prior: InertiaPrior, noise: Noise, covariance: Floats
) -> tuple[Floats, Floats]:
    """``std`` and ``shift`` of ``PriorInfluence`` for an estimate with this covariance, shape (P, P)."""
    if method in LINEAR:
        slope, std = prior_slopes(method, phasors, prior, noise)
        with np.errstate(invalid="ignore"):
            return std, np.where(slope == 0, 0.0, slope * std)
    std = np.concatenate([np.zeros(0), *(std.ravel() for _, std in prior.blocks().values())])
    return std, covariance[: 2 * prior.n, len(covariance) - std.size :] / std


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
        When a name is not one of the fit's parameters or nothing determines it, both are the same, or
        the level is out of range.
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
    for name, one in zip((first, second), error.tolist(), strict=True):
        if np.isinf(one):
            raise JointIdError(f"The records do not determine {name}: it has no confidence ellipse.")
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
