"""Linear model whose coefficients have priors; its noise is given by its density at low frequency."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dpotri
from scipy.special import log_ndtr

from jointid.arrays import Floats


@dataclass(frozen=True, eq=False)
class Estimate:
    """Coefficients (..., p) with covariance, and −2 log of the evidence for the terms used, (...)."""

    beta: Floats
    covariance: Floats
    cost: Floats

    def not_negative(self, along: Floats) -> Estimate:
        """Return moments and evidence with ``along`` (..., p) times the coefficients at least 0.

        The prior of that sum is symmetric about 0; its negative half is cut off. A sum that is exactly
        known stays.
        """
        direction = np.einsum("...ij,...j->...i", self.covariance, along)
        std = np.sqrt(np.sum(along * direction, axis=-1))
        known = std == 0
        direction = direction / np.where(known, 1.0, std)[..., None]
        mean = np.sum(along * self.beta, axis=-1) / np.where(known, 1.0, std)
        log_share = log_ndtr(mean)
        hazard = ~known * np.exp(-0.5 * mean**2 - log_share) / np.sqrt(2 * np.pi)
        narrower = (hazard * (hazard + mean))[..., None, None]
        return Estimate(
            self.beta + direction * hazard[..., None],
            self.covariance - direction[..., :, None] * direction[..., None, :] * narrower,
            self.cost - 2 * ~known * (log_share + np.log(2)),
        )


@dataclass(frozen=True, eq=False)
class Regression:
    """Data (N,) over columns (N, p)."""

    y: Floats
    columns: Floats

    def estimate(self, noise: float, std: Floats) -> Estimate:
        """Estimate coefficients in noise of one standard deviation, for every set of priors.

        ``std``, shape (..., p), are prior ones; infinite without a prior, 0 leaves a column out. A
        column of zeros without a prior is left out as well.
        """
        gram, moment, energy = self._moments
        gram, moment = gram / noise**2, moment / noise**2
        length, prior = np.diag(gram), np.isfinite(std)
        used = (std > 0) & (prior | (length > 0))
        scale = used * np.where(prior, std, length.clip(1e-300) ** -0.5)
        moment = moment * scale
        A = gram * scale[..., :, None] * scale[..., None, :]
        own = np.arange(std.shape[-1])
        A[..., own, own] += prior | ~used
        size = np.sum(A[..., own, own] * used, axis=-1) / used.sum(axis=-1)
        factor = np.linalg.cholesky(A + 1e-12 * size[..., None, None] * np.eye(own.size))
        inverse = _inverse_of(factor)
        mean = np.einsum("...ij,...j->...i", inverse, moment)
        misfit = energy / noise**2 + np.sum(
            mean * (np.einsum("...ij,...j->...i", A, mean) - 2 * moment), axis=-1
        )
        covariance = inverse * used[..., None, :] * scale[..., :, None] * scale[..., None, :]
        evidence = 2 * np.log(factor[..., own, own]).sum(axis=-1)
        return Estimate(mean * scale, covariance, misfit + evidence)

    @cached_property
    def _moments(self) -> tuple[Floats, Floats, float]:
        """Sums of products of columns with columns, of columns with data, and of the data."""
        X, y = self.columns, self.y
        return np.asarray(X.T @ X, float), np.asarray(X.T @ y, float), float(y @ y)

    def residual(self, estimate: Estimate) -> Floats:
        """Data minus model, shape (N,)."""
        return np.asarray(self.y - self.columns @ estimate.beta)


def _inverse_of(factor: Floats) -> Floats:
    """Inverse of L Lᵀ, (..., p, p), from L, by LAPACK: in half the time of a product of inverses."""
    size = factor.shape[-1]
    upper = np.triu([dpotri(L.T)[0] for L in factor.reshape(-1, size, size)])
    return np.asarray((upper + np.triu(upper, 1).mT).reshape(factor.shape))


def low_frequency_noise(residual: Floats, spans: list[int], lags: int, freedom: float) -> float:
    """Standard deviation of the white noise with the residual's density at low frequency.

    Motion is slow and the residual is coloured: what counts for the error is the density where the
    motion is (Bartlett's estimate, Newey and West 1987). ``spans`` are the first indices of every record
    after the first in ``residual``, shape (N,); ``lags`` the samples over which it is taken as
    correlated; ``freedom`` the number of fitted coefficients, which lower it.
    """
    parts = np.split(residual, spans)
    lag = min([lags, *(part.size - 1 for part in parts)])
    products = [sum(float(part[k:] @ part[: part.size - k]) for part in parts) for k in range(lag + 1)]
    # the fit takes the slowest part out of the residual: the window with the largest density counts
    windows = [
        products[0] + 2 * sum((1 - k / (width + 1)) * products[k] for k in range(1, width + 1))
        for width in range(lag + 1)
    ]
    total = max(windows)
    return float(np.sqrt(total / max(residual.size - freedom, 0.25 * residual.size)))
