"""Errors of the parameters from the scatter of the records: a check of the noise model that costs no fit.

At the optimum every record pulls the parameters by its gradient, and the pulls cancel. Their scatter gives
a covariance that holds whatever makes the residuals, as long as it differs from record to record: the
sandwich A⁻¹ (Σ gᵣgᵣᵀ) A⁻¹ by record, with the leverage correction CR2 (Bell and McCaffrey, Survey
Methodology 28, 2002). Sticking friction, rounding and other deterministic errors are of that kind.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from jointid.arrays import Floats
from jointid.estimation.whitened_residual import WhitenedResidual
from jointid.small_matrices import whitener

_CHANCE = 1e-3
"""Probability that the scatter widens the errors of a right model."""
_MOST_LEVERAGE = 0.999
"""Largest share of a direction's information from one record; its residual there is rounding."""
_LEAST_RECORDS = 4
"""Fewest records that show a scatter."""


def widened_covariance(residual: WhitenedResidual, covariance: Floats, prior_part: Floats) -> Floats:
    """Covariance of all parameters, widened where the records scatter more than their noise explains.

    The scatter of few records is inaccurate. It counts if that of K and D is significant, and then widens
    the noise of each parameter by the ratio of both standard errors, if that is above 1.

    Parameters
    ----------
    residual : WhitenedResidual
        At the estimate.
    covariance, prior_part : ndarray, shape (P, P)
        Covariance of the estimate, and the part that the prior makes; noise makes the rest.
    """
    noise = np.where(np.isfinite(covariance), covariance - prior_part, 0.0)
    records, own = len(residual.rows), 2 * residual.at.problem.n
    if records < _LEAST_RECORDS or not np.all(np.diag(noise)[:own] > 0):
        return covariance
    shift, expected = _shifts(residual, np.where(np.isfinite(covariance), covariance, 0.0))
    scatter = records / (records - 1) * ((shift - shift.mean(axis=0)) ** 2).sum(axis=0)
    W = whitener(noise[:own, :own])
    pulls, share = shift[:, :own] @ W.T, W @ expected[:, :own, :own] @ W.T
    degrees_of_freedom = own**2 / (share**2).sum()
    found = (pulls**2).sum() / own
    if found * degrees_of_freedom < chdtri(degrees_of_freedom, _CHANCE):
        return covariance
    size = np.diag(noise)
    ratio = np.divide(scatter, size, out=np.ones_like(size), where=size > 0)
    factor = np.sqrt(np.maximum(ratio, 1.0))
    return np.asarray(covariance + noise * (np.outer(factor, factor) - 1))


def _shifts(residual: WhitenedResidual, covariance: Floats) -> tuple[Floats, Floats]:
    """Pull of each record on the parameters, shape (r, P), and its covariance from noise, (r, P, P)."""
    size = np.sqrt(np.diag(covariance))
    size = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    root = size[:, None] * vectors * np.sqrt(2 * np.maximum(values, 0.0))  # of the inverse normal matrix
    columns = residual.columns() @ root
    leverage, directions = np.linalg.eigh(columns.swapaxes(1, 2) @ columns)
    gradient = (columns.swapaxes(1, 2) @ residual.rows[..., None])[..., 0]
    left = np.sqrt(1 - np.clip(leverage, 0.0, _MOST_LEVERAGE))
    along = (directions.swapaxes(1, 2) @ gradient[..., None])[..., 0] / left
    back = root @ directions
    shift = (back @ along[..., None])[..., 0]
    return shift, 0.5 * (back * np.maximum(leverage, 0.0)[:, None]) @ back.swapaxes(1, 2)
