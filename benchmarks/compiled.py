"""A sine fit as one would write it in numba: a rotating phasor per lane, and closed normal equations."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np
from numba import njit

LANES = 16
"""Samples that advance side by side, so that the compiler fills its vector registers."""
BLOCK = 2048
"""Samples after which the phasor is recomputed: rounding stays small, and 4 blocks fit the cache."""


@njit(cache=True, fastmath=True)
def _one(signal, x, harmonics, out):
    """Sums of one channel: s·cos, s·sin for every harmonic, s and s·n, into out (2H + 2,)."""
    n = signal.size
    out[:] = 0.0
    cosine, sine = np.empty(LANES), np.empty(LANES)
    for begin in range(0, n, BLOCK):
        last = min(begin + BLOCK, n)
        rows = (last - begin) // LANES
        part = signal[begin : begin + rows * LANES]
        for h in range(1, harmonics + 1):
            for lane in range(LANES):
                cosine[lane] = np.cos(h * x * (begin + lane))
                sine[lane] = np.sin(h * x * (begin + lane))
            c, s = np.cos(h * x * LANES), np.sin(h * x * LANES)
            sum_c, sum_s = np.zeros(LANES), np.zeros(LANES)
            for row in range(rows):
                for lane in range(LANES):
                    value = part[row * LANES + lane]
                    a, b = cosine[lane], sine[lane]
                    sum_c[lane] += value * a
                    sum_s[lane] += value * b
                    cosine[lane] = a * c - b * s
                    sine[lane] = a * s + b * c
            out[h - 1] += sum_c.sum()
            out[harmonics + h - 1] += sum_s.sum()
        level, ramp = 0.0, 0.0
        for k in range(rows * LANES):
            level += part[k]
            ramp += part[k] * k
        out[-2] += level
        out[-1] += ramp + begin * level
        for k in range(begin + rows * LANES, last):
            for h in range(1, harmonics + 1):
                out[h - 1] += signal[k] * np.cos(h * x * k)
                out[harmonics + h - 1] += signal[k] * np.sin(h * x * k)
            out[-2] += signal[k]
            out[-1] += signal[k] * k


@njit(cache=True, nogil=True)
def _sums(signals, x, harmonics):
    """Sums of every channel of a record, signals (channels, N)."""
    out = np.empty((len(signals), 2 * harmonics + 2))
    for i in range(len(signals)):
        _one(signals[i], x, harmonics, out[i])
    return out


def phasors(channels: Sequence[tuple[float, np.ndarray]], harmonics: int) -> np.ndarray:
    """Phasors of the fundamental, shape (r, 4), from (N, 2) arrays two per record, clock from 0."""
    return np.array([_phasors(x, signal, harmonics) for x, signal in channels]).reshape(-1, 4)


def phasors_on_all_cores(channels: Sequence[tuple[float, np.ndarray]], harmonics: int) -> np.ndarray:
    """The same with a thread per core; the compiled loop does not hold Python's lock."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(lambda each: _phasors(*each, harmonics), channels))
    return np.array(found).reshape(-1, 4)


def _phasors(x: float, signal: np.ndarray, harmonics: int) -> np.ndarray:
    y = np.linalg.solve(_gram(x, signal.shape[0], harmonics), _sums(signal.T, x, harmonics).T)
    return 1j * y[0] + y[harmonics]


@lru_cache(maxsize=256)
def _gram(x: float, samples: int, harmonics: int) -> np.ndarray:
    """Products of cos hxn, sin hxn, 1 and n over n = 0 … N − 1, in closed form (geometric sums)."""
    orders = np.concatenate([np.arange(1, harmonics + 1) * x, [0.0]])
    plus, minus = orders[:, None] + orders, orders[:, None] - orders
    P, M = _geometric(plus, samples), _geometric(minus, samples)
    H, size = harmonics, 2 * harmonics + 2
    G = np.empty((size, size))
    c, s = np.arange(H), np.arange(H, 2 * H)
    G[np.ix_(c, c)] = (M.real + P.real)[:H, :H] / 2
    G[np.ix_(s, s)] = (M.real - P.real)[:H, :H] / 2
    G[np.ix_(c, s)] = ((P.imag - M.imag) / 2)[:H, :H]
    G[np.ix_(s, c)] = G[np.ix_(c, s)].T
    wave = _geometric(orders[:H], samples)
    slope = _ramped(orders[:H], samples)
    G[-2, :H], G[-2, H:-2] = wave.real, wave.imag
    G[-1, :H], G[-1, H:-2] = slope.real, slope.imag
    G[:-2, -2:] = G[-2:, :-2].T
    n = samples
    G[-2, -2], G[-1, -1] = n, (n - 1) * n * (2 * n - 1) / 6
    G[-2, -1] = G[-1, -2] = n * (n - 1) / 2
    return G


def _geometric(x: np.ndarray, n: int) -> np.ndarray:
    """Σ e^{ixk} over k < n."""
    small = np.abs(np.sin(x / 2)) < 1e-12
    safe = np.where(small, 1.0, x)
    value = np.exp(1j * safe * (n - 1) / 2) * np.sin(n * safe / 2) / np.sin(safe / 2)
    return np.where(small, n, value)


def _ramped(x: np.ndarray, n: int) -> np.ndarray:
    """Σ k e^{ixk} over k < n."""
    z = np.exp(1j * x)
    return (z - n * z**n + (n - 1) * z ** (n + 1)) / (1 - z) ** 2
