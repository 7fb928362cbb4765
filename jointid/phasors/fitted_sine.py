"""What a fit of a sine goes by, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.records import SineRecord


@dataclass(frozen=True, eq=False)
class Window:
    """The settled samples of a record, divided into blocks of close to whole periods."""

    record: SineRecord
    orders: int
    """Highest harmonic that the samples can tell."""
    block: int
    """Samples per block."""
    blocks: int
    """Number of whole blocks."""

    @property
    def samples(self) -> int:
        """Number of samples used."""
        return self.record.samples


@dataclass(frozen=True, eq=False)
class SineFit:
    """The fit of one record: Σ_h Im(y_h e^{ihωt}) + offset + drift · t, for 2n channels (q, then τ)."""

    fundamental: Complexes
    """Phasors of the fit without harmonics (sine, cosine, offset, drift only), shape (2n,)."""
    harmonics: Complexes
    """Phasors y_h of the fit with harmonics, on the record's clock, shape (H, 2n); those that the
    samples cannot carry are zero."""
    offset: Floats
    """Mean level at the middle of the window, shape (2n,)."""
    drift: Floats
    """Slope, per second, shape (2n,)."""
    middle_s: float
    """Time of the middle of the window, s."""
    deviations: Complexes
    """What each block adds to the error of the fundamental, shape (blocks, 2n); they sum to about 0."""
    covariance: Complexes
    """Covariance E[δy δyᴴ] of each harmonic's phasors, shape (H, 2n, 2n)."""
    freedom: int
    """Degrees of freedom of ``covariance``: how many independent complex errors it is the mean of."""

    def at(self, time_s: Floats, omega: float) -> Floats:
        """Value of the fitted curve, shape (N, 2n)."""
        orders = np.arange(1, len(self.harmonics) + 1)
        waves = np.exp(1j * omega * np.outer(time_s, orders)) @ self.harmonics
        return np.asarray(waves.imag + self.offset + np.outer(time_s - self.middle_s, self.drift))


def scatter(deviations: Complexes) -> Complexes:
    """Covariance of sums over independent blocks whose mean the fit has removed.

    Parameters
    ----------
    deviations : ndarray, shape (..., blocks, 2n)

    Returns
    -------
    ndarray, shape (..., 2n, 2n)
    """
    return np.asarray(deviations.swapaxes(-2, -1) @ deviations.conj())


def padded(rows: Complexes, harmonics: int) -> Complexes:
    """Fill up with zeros what the samples cannot carry; (r, H', ...) becomes (r, H, ...)."""
    filled = np.zeros((len(rows), harmonics, *rows.shape[2:]), complex)
    filled[:, : rows.shape[1]] = rows
    return filled
