"""Input and result of a sine fit, and the basis functions of both."""

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.records import SineRecord


@dataclass(frozen=True, eq=False)
class Window:
    """Steady-state samples of a record, divided into blocks of nearly whole periods."""

    record: SineRecord
    orders: int
    """Highest harmonic in the fit."""
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
    """Phasors y_h of the fit with harmonics, on the record's clock, shape (H, 2n); zero where the sample
    rate or the record length excludes the harmonic."""
    offset: Floats
    """Mean level at the middle of the window, shape (2n,)."""
    drift: Floats
    """Slope, per second, shape (2n,)."""
    middle_s: float
    """Time of the middle of the window, s."""
    deviations: Complexes
    """Contribution of each block to the error of the fundamental, shape (blocks, 2n); their sum is about
    zero."""
    covariance: Complexes
    """Covariance E[δy δyᴴ] of each harmonic's phasors, shape (H, 2n, 2n)."""
    degrees_of_freedom: int
    """Degrees of freedom of ``covariance``: number of independent complex errors in its mean."""

    @property
    def local(self) -> Complexes:
        """Phasors of each block less those of the record, shape (blocks, 2n)."""
        return self.deviations * len(self.deviations)

    def at(self, time_s: Floats, omega: float) -> Floats:
        """Value of the fitted curve, shape (N, 2n)."""
        orders = np.arange(1, len(self.harmonics) + 1)
        waves = np.exp(1j * omega * np.outer(time_s, orders)) @ self.harmonics
        return np.asarray(waves.imag + self.offset + np.outer(time_s - self.middle_s, self.drift))


def sine_basis(phase: Floats, ramp: Floats) -> Floats:
    """Columns cosines, sines, one and ramp of a linear sine fit, shape (N, 2H + 2).

    ``phase``, shape (N,) or (N, H), is hωt of each harmonic at each sample, rad; ``ramp``, shape (N,),
    the time in any unit.
    """
    return np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(ramp), ramp])


def scatter(deviations: Complexes) -> Complexes:
    """Covariance (..., 2n, 2n) of a sum over independent blocks, from their deviations from the mean.

    ``deviations`` has shape (..., blocks, 2n).
    """
    return np.asarray(deviations.swapaxes(-2, -1) @ deviations.conj())


def padded(rows: Complexes, harmonics: int) -> Complexes:
    """Append zeros for harmonics that are not in the fit; (r, H', ...) becomes (r, H, ...)."""
    filled = np.zeros((len(rows), harmonics, *rows.shape[2:]), complex)
    filled[:, : rows.shape[1]] = rows
    return filled
