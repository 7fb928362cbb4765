"""Waveforms over one period and their phasors."""

from functools import lru_cache

import numpy as np

from jointid.arrays import Complexes, Floats

_MANY = 48
"""Harmonics from which the fast Fourier transform pays; the bins of motions are more."""


@lru_cache(maxsize=8)
def waves(H: int, points: int) -> Complexes:
    """Samples of e^{ihφ} over a period, (H, t)."""
    return np.asarray(np.exp(2j * np.pi * np.outer(np.arange(1, H + 1), np.arange(points) / points)))


def waves_at(turns: Floats, H: int) -> Complexes:
    """e^{-2πihx} at turns x, (m,), of a period, (H, m): powers are far cheaper than exponentials."""
    first = np.exp(-2j * np.pi * turns)
    return np.asarray(np.cumprod(np.broadcast_to(first, (H, turns.size)), axis=0))


@lru_cache(maxsize=8)
def pairs(H: int, points: int) -> Floats:
    """Sines above cosines, (2H, t): the real synthesis matrix of phasors."""
    return np.concatenate([waves(H, points).imag, waves(H, points).real])


def samples_of(phasors: Complexes, points: int) -> Floats:
    """Samples over a period (..., t) of phasors (..., H); of few by a product of contiguous matrices."""
    H = phasors.shape[-1]
    if _MANY <= H < points / 2:
        spectrum = np.zeros((*phasors.shape[:-1], points // 2 + 1), complex)
        spectrum[..., 1 : H + 1] = -0.5j * points * phasors
        return np.fft.irfft(spectrum, points)
    parts = np.concatenate([phasors.real, phasors.imag], axis=-1)
    flat = parts.reshape(-1, parts.shape[-1]) @ pairs(H, points)
    return np.asarray(flat.reshape(*phasors.shape[:-1], points))


def phasors_of(samples: Floats, H: int) -> Complexes:
    """Phasors (..., H) of samples over a period (..., t)."""
    points = samples.shape[-1]
    if _MANY <= H < points / 2:
        return np.asarray(np.fft.rfft(samples)[..., 1 : H + 1] * (2j / points))
    parts = (samples.reshape(-1, points) @ pairs(H, points).T) * (2 / points)
    return np.asarray((parts[:, :H] + 1j * parts[:, H:]).reshape(*samples.shape[:-1], H))
