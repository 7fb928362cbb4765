"""Linear model whose coefficients have priors; its noise is given by its density at low frequency."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import log_ndtr

from jointid.arrays import Floats


@dataclass(frozen=True, eq=False)
class Estimate:
    """Coefficients with covariance, and −2 log of the evidence for the terms used."""

    beta: Floats
    covariance: Floats
    cost: float

    def not_negative(self, along: Floats) -> Estimate:
        """Return moments and evidence with ``along`` (p,) times the coefficients at least 0.

        The prior of that sum is symmetric about 0; its negative half is cut off.
        """
        direction = self.covariance @ along
        mean, std = float(along @ self.beta), float(np.sqrt(along @ direction))
        if std == 0.0:
            return self
        log_share = float(log_ndtr(mean / std))
        hazard = float(np.exp(-0.5 * (mean / std) ** 2 - log_share)) / np.sqrt(2 * np.pi)
        narrower = hazard * (hazard + mean / std)
        return Estimate(
            self.beta + direction / std * hazard,
            self.covariance - np.outer(direction, direction) / std**2 * narrower,
            self.cost - 2 * (log_share + float(np.log(2))),
        )


@dataclass(frozen=True, eq=False)
class Regression:
    """Data (N,) over columns (N, p)."""

    y: Floats
    columns: Floats

    def estimate(self, noise: float, std: Floats) -> Estimate:
        """Estimate coefficients in noise of one standard deviation.

        ``std``, shape (p,), are prior ones; infinite without a prior, 0 leaves a column out. A column of
        zeros without a prior is left out as well.
        """
        gram, moment, energy = self._moments
        used = (std > 0) & (np.isfinite(std) | (np.diag(gram) > 0))
        prior = std[used]
        gram, moment = gram[np.ix_(used, used)] / noise**2, moment[used] / noise**2
        scale = np.where(np.isfinite(prior), prior, np.diag(gram).clip(1e-300) ** -0.5)
        gram, moment = gram * np.outer(scale, scale), moment * scale
        A = gram + np.diag(np.isfinite(prior) * 1.0)
        factor = cho_factor(A + 1e-12 * np.trace(A) / len(A) * np.eye(len(A)))
        mean = cho_solve(factor, moment)
        beta, covariance = np.zeros(std.size), np.zeros((std.size, std.size))
        beta[used] = mean * scale
        covariance[np.ix_(used, used)] = cho_solve(factor, np.eye(len(A))) * np.outer(scale, scale)
        misfit = energy / noise**2 - 2 * float(mean @ moment) + float(mean @ A @ mean)
        return Estimate(beta, covariance, misfit + 2 * float(np.log(np.diag(factor[0])).sum()))

    @cached_property
    def _moments(self) -> tuple[Floats, Floats, float]:
        """Sums of products of columns with columns, of columns with data, and of the data."""
        X, y = self.columns, self.y
        return np.asarray(X.T @ X, float), np.asarray(X.T @ y, float), float(y @ y)

    def residual(self, estimate: Estimate) -> Floats:
        """Data minus model, shape (N,)."""
        return np.asarray(self.y - self.columns @ estimate.beta)


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
