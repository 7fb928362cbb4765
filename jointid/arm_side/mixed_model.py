"""Linear model whose coefficients have priors; its noise is given by its density at low frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from jointid.arrays import Floats


@dataclass(frozen=True)
class Estimate:
    """Coefficients with covariance, and −2 log of the evidence for the terms used."""

    beta: Floats
    covariance: Floats
    cost: float


@dataclass(frozen=True, eq=False)
class Regression:
    """Data (N,) over columns (N, p)."""

    y: Floats
    columns: Floats

    def estimate(self, noise: float, std: Floats) -> Estimate:
        """Estimate coefficients in noise of one standard deviation.

        Parameters
        ----------
        noise : float
        std : ndarray, shape (p,)
            Prior standard deviations; infinite without a prior, 0 leaves a column out.
        """
        used = std > 0
        X, prior = self.columns[:, used] / noise, std[used]
        scale = np.where(np.isfinite(prior), prior, 1 / np.linalg.norm(X, axis=0).clip(1e-300))
        X, y = X * scale, self.y / noise
        A = X.T @ X + np.diag(np.isfinite(prior) * 1.0)
        factor = cho_factor(A + 1e-12 * np.trace(A) / len(A) * np.eye(len(A)))
        mean = cho_solve(factor, X.T @ y)
        beta, covariance = np.zeros(std.size), np.zeros((std.size, std.size))
        beta[used] = mean * scale
        covariance[np.ix_(used, used)] = cho_solve(factor, np.eye(len(A))) * np.outer(scale, scale)
        misfit = float(np.sum((y - X @ mean) ** 2) + np.sum((mean**2)[np.isfinite(prior)]))
        return Estimate(beta, covariance, misfit + 2 * float(np.log(np.diag(factor[0])).sum()))

    def residual(self, estimate: Estimate) -> Floats:
        """Data minus model, shape (N,)."""
        return np.asarray(self.y - self.columns @ estimate.beta)


def low_frequency_noise(residual: Floats, spans: list[int], lags: int, freedom: float) -> float:
    """Standard deviation of the white noise with the residual's density at low frequency.

    Motion is slow and the residual is coloured: what counts for the error is the density where the
    motion is (Bartlett's estimate, Newey and West 1987).

    Parameters
    ----------
    residual : ndarray, shape (N,)
    spans : list of int
        First index of every record after the first.
    lags : int
        Samples over which the residual is taken as correlated.
    freedom : float
        Number of fitted coefficients, which lower the residual.
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
