"""Frequencies of the lines in a stretch of a log, by least squares over all its signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats

_ROUNDS = 12
_ENOUGH_SAMPLES = 200_000  # of a longer stretch every k-th sample is used to find the frequency


@dataclass(frozen=True, eq=False)
class LineFit:
    """Lines fitted to every signal together with offset and drift."""

    frequency_hz: Floats
    """Shape (L,), Hz."""
    error_hz: Floats
    """Standard error of each frequency if what the fit leaves is white noise, shape (L,), Hz."""
    phasors: Complexes
    """y of Im(y e^{iωt}), t from ``middle_s``, shape (L, c); those of the fundamentals only."""
    residual: Floats
    """Root mean square of what is left of each signal, shape (c,)."""
    moved: Floats
    """Root mean square of each signal about its line, shape (c,)."""
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
    """Fit lines, offset and drift to all signals, and improve the frequencies by Gauss-Newton.

    Parameters
    ----------
    time_s : ndarray, shape (N,)
    signals : ndarray, shape (N, c)
        They share the frequencies; each counts by its own noise.
    frequency_hz : sequence of float
        Starting values, closer than half of one over the duration.
    harmonics : int, default 1
        Harmonics of each line that are fitted as well, as far as the sample rate carries them.
    free : bool, default True
        False keeps the frequencies.
    within : float, default 1e-8
        Change of a line's phase over the duration, rad, below which its frequency is good enough.
    """
    step = max(1, len(time_s) // _ENOUGH_SAMPLES)
    if len(time_s) < 20 * (harmonics + 1) * max(frequency_hz) * np.ptp(time_s) * step:
        step = 1  # fewer than some twenty samples per period would be left
    time, data = time_s[::step], signals[::step] - signals.mean(axis=0)
    middle = float(time[0] + time[-1]) / 2
    clock, span = time - middle, float(time[-1] - time[0])
    omega = 2 * np.pi * np.asarray(frequency_hz, float)
    start = omega.copy()
    highest = np.pi / float(np.median(np.diff(time)))
    orders = [max(1, min(harmonics, int(0.9 * highest / w))) for w in omega]
    variance = np.full(omega.size, np.inf)
    for _ in range(_ROUNDS if free else 1):
        basis, slope = _columns(clock, span, omega, orders)
        # Lines that a window tells apart are nearly orthogonal: normal equations lose nothing.
        inverse: Floats = np.asarray(np.linalg.pinv(basis.T @ basis, hermitian=True), float)
        coefficients = inverse @ (basis.T @ data)
        residual = data - basis @ coefficients
        if not free:
            break
        noise = residual.std(axis=0) + 1e-12 * np.abs(data).max(axis=0) + 1e-300
        shift, variance = _improvement(basis, inverse, slope, coefficients, residual, noise, orders)
        omega = omega + np.clip(shift, -0.5 * np.pi / span, 0.5 * np.pi / span)
        omega = np.clip(omega, start - 2 * np.pi / span, start + 2 * np.pi / span)
        if np.all(np.abs(shift) * span < within):
            break
    ramp = basis[:, :2]
    about_line = data - ramp @ (np.linalg.pinv(ramp.T @ ramp) @ (ramp.T @ data))
    places = 2 + 2 * np.concatenate([[0], np.cumsum(orders)[:-1]]).astype(int)
    return LineFit(
        frequency_hz=omega / (2 * np.pi),
        error_hz=np.sqrt(variance) / (2 * np.pi),
        phasors=coefficients[places + 1] + 1j * coefficients[places],
        residual=np.sqrt((residual**2).mean(axis=0)),
        moved=np.sqrt((about_line**2).mean(axis=0)),
        middle_s=middle,
    )


def _columns(clock: Floats, span: float, omega: Floats, orders: Sequence[int]) -> tuple[Floats, Floats]:
    """One, ramp, cosines and sines; and the derivatives of the latter two by their line's ω."""
    waves, slopes = [], []
    for w, count in zip(omega, orders, strict=True):
        for h in range(1, count + 1):
            cosine, sine = np.cos(h * w * clock), np.sin(h * w * clock)
            waves += [cosine, sine]
            slopes += [-h * clock * sine, h * clock * cosine]
    return np.column_stack([np.ones_like(clock), clock / span, *waves]), np.column_stack(slopes)


def _improvement(
    basis: Floats,
    inverse: Floats,
    slope: Floats,
    coefficients: Floats,
    residual: Floats,
    noise: Floats,
    orders: Sequence[int],
) -> tuple[Floats, Floats]:
    """Gauss-Newton step of every line's ω, and its variance."""
    lines, signals = len(orders), residual.shape[1]
    begin = 2 * np.concatenate([[0], np.cumsum(orders)])
    rates = np.empty((lines, *residual.shape))
    for k in range(lines):
        part = slice(begin[k], begin[k + 1])
        rates[k] = slope[:, part] @ coefficients[2:][part]
    flat = rates.transpose(1, 0, 2).reshape(len(basis), -1)
    # What the amplitudes can take up of a change of frequency is no evidence for it.
    flat = flat - basis @ (inverse @ (basis.T @ flat))
    rates = flat.reshape(len(basis), lines, signals) / noise
    by_line = rates.transpose(1, 0, 2).reshape(lines, -1)
    normal = by_line @ by_line.T
    right = by_line @ (residual / noise).ravel()
    spread = np.linalg.pinv(normal, hermitian=True)
    return spread @ right, np.diag(spread).copy()
