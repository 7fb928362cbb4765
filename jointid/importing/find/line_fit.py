"""Frequencies of the lines in a span of a log, by least squares over all its signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.phasors.fitted_sine import sine_basis

_MAX_ITERATIONS = 12
_MAX_SAMPLES = 200_000  # of a longer span only every k-th sample is used: this fixes the frequency
_LEAST_RATE = 20  # samples per period of the highest harmonic that decimation must leave
_BAND = 0.9  # of the Nyquist frequency, up to which harmonics are fitted


@dataclass(frozen=True, eq=False)
class LineFit:
    """Lines fitted to every signal together with offset and drift."""

    frequency_hz: Floats
    """Shape (L,), Hz."""
    error_hz: Floats
    """Standard error of each frequency for a white residual, shape (L,), Hz; infinite if not fitted."""
    phasors: Complexes
    """y of Im(y e^{iωt}), t from ``middle_s``, shape (L, c); those of the fundamentals only."""
    residual: Floats
    """Root mean square of each signal's residual, shape (c,)."""
    moved: Floats
    """Root mean square of each signal without offset and drift, shape (c,)."""
    middle_s: float
    """Time in the middle, s."""

    @property
    def share(self) -> Floats:
        """Share of each signal's variance that the fit explains, shape (c,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.nan_to_num(1 - (self.residual / self.moved) ** 2)


def fit_lines(
    time_s: Floats,
    signals: Floats,
    frequency_hz: Sequence[float],
    *,
    harmonics: int = 1,
    free: bool = True,
    within: float = 1e-8,
) -> LineFit:
    """Fit lines, offset and drift to all signals, and refine the frequencies by Gauss-Newton.

    Parameters
    ----------
    time_s : ndarray, shape (N,)
    signals : ndarray, shape (N, c)
        They share the frequencies; each is weighted by its own noise.
    frequency_hz : sequence of float
        Initial values, within half of one over the duration.
    harmonics : int, default 1
        Highest harmonic fitted to each line, as far as the sample rate allows.
    free : bool, default True
        False keeps the frequencies.
    within : float, default 1e-8
        Convergence: change of a line's phase over the duration, rad.
    """
    step = max(1, len(time_s) // _MAX_SAMPLES)
    if len(time_s) < _LEAST_RATE * (harmonics + 1) * max(frequency_hz) * np.ptp(time_s) * step:
        step = 1
    time, data = time_s[::step], signals[::step] - signals.mean(axis=0)
    middle = float(time[0] + time[-1]) / 2
    clock, span = time - middle, float(time[-1] - time[0])
    omega = 2 * np.pi * np.asarray(frequency_hz, float)
    start = omega.copy()
    highest = np.pi / float(np.median(np.diff(time)))
    orders = [max(1, min(harmonics, int(_BAND * highest / w))) for w in omega]
    line = np.repeat(np.arange(omega.size), orders)
    order = np.concatenate([np.arange(1, count + 1) for count in orders])
    variance = np.full(omega.size, np.inf)
    for _ in range(_MAX_ITERATIONS if free else 1):
        basis = sine_basis(np.outer(clock, order * omega[line]), clock / span)
        # Lines that a window resolves are nearly orthogonal: normal equations lose nothing.
        inverse: Floats = np.asarray(np.linalg.pinv(basis.T @ basis, hermitian=True), float)
        coefficients = inverse @ (basis.T @ data)
        residual = data - basis @ coefficients
        if not free:
            break
        slopes = _slopes(clock, basis, coefficients, line, order)
        # A change that the amplitudes can absorb is no evidence for a change of frequency.
        slopes -= basis @ (inverse @ (basis.T @ slopes))
        noise = residual.std(axis=0) + 1e-12 * np.abs(data).max(axis=0) + 1e-300
        weighted = (slopes / noise).reshape(omega.size, -1)
        spread = np.linalg.pinv(weighted @ weighted.T, hermitian=True)
        shift, variance = spread @ (weighted @ (residual / noise).ravel()), np.diag(spread).copy()
        omega = omega + np.clip(shift, -0.5 * np.pi / span, 0.5 * np.pi / span)
        omega = np.clip(omega, np.maximum(start - 2 * np.pi / span, start / 4), start + 2 * np.pi / span)
        if np.all(np.abs(shift) * span < within):
            break
    ramp = basis[:, -2:]
    about_line = data - ramp @ (np.linalg.pinv(ramp.T @ ramp) @ (ramp.T @ data))
    cosine, sine = np.split(coefficients[:-2], 2)
    return LineFit(
        frequency_hz=omega / (2 * np.pi) if free else np.asarray(frequency_hz, float),
        error_hz=np.sqrt(variance) / (2 * np.pi),
        phasors=(sine + 1j * cosine)[order == 1],
        residual=np.sqrt((residual**2).mean(axis=0)),
        moved=np.sqrt((about_line**2).mean(axis=0)),
        middle_s=middle,
    )


def _slopes(
    clock: Floats, basis: Floats, coefficients: Floats, line: np.ndarray, order: np.ndarray
) -> Floats:
    """Derivative of the fitted signals by the ω of each line, shape (L, N, c)."""
    cosines, sines = np.split(basis[:, :-2], 2, axis=1)
    cosine, sine = np.split(coefficients[:-2] * np.tile(order, 2)[:, None], 2)
    return np.stack(
        [
            clock[:, None] * (cosines[:, part] @ sine[part] - sines[:, part] @ cosine[part])
            for part in (line == k for k in range(line[-1] + 1))
        ]
    )
