"""Contribution of each given inertia and torque scale to the errors of K and D.

With the information A of the records and B of the given values, a fit has the covariance C = (A + B)⁻¹,
and its estimate moves by C B per unit of the given values. An error of one standard deviation in the
given value e moves K and D by C B^½, column e; all columns together make the prior's part C B C of C.
"""

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.linear_fit import LINEAR, prior_slopes
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.problem import fitted_layout
from jointid.phasors.extract import Phasors


@dataclass(frozen=True, eq=False)
class PriorInfluence:
    """Influence of the given inertias and torque scales on K and D."""

    names: tuple[str, ...]
    """J_m1 ... J_mn, then J_a1, J_12, J_a2 ... of each pose, then the torque scales, E of them."""
    std: Floats
    """Standard deviations of the given values, shape (E,)."""
    shift: Floats
    """Change of K and D when a given value is larger by its standard deviation, shape (2n, E)."""


def prior_influence(fit: ElasticityFit) -> PriorInfluence:
    """Influence of each given value; empty if all are exact, zero for unknown ones, which are fitted.

    Raises JointIdError when a linear estimator has no result after a small change of an inertia.
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
