"""Fit of a uniformly sampled record by a two-level transform, limited by memory bandwidth.

With the sample number m = kB + j, e^{-iωt} is an outer product, so that all sums of the normal equations
come from one matrix product over the data. The blocks are nearly whole periods; the scatter of their
contributions gives the noise of the result. The Gram matrix of the basis is known in closed form
(Dirichlet kernels).
"""

from functools import lru_cache

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.phasors.fitted_sine import SineFit, Window, padded, scatter

_CACHED_NUMBERS = 1 << 17
"""Largest table of sines that is cached, which bounds the memory."""


def fit_uniformly(window: Window, harmonics: int) -> SineFit:
    """Fit a uniformly sampled record of eight blocks or more.

    ``harmonics`` is the number of rows of ``SineFit.harmonics``.
    """
    record, count, block, blocks = window.record, window.orders, window.block, window.blocks
    samples, orders, x = window.samples, np.arange(1, count + 1), record.omega * record.interval_s
    columns, products = _columns(x, block, count)
    sums = _block_sums(window, columns)
    begin = block * np.arange(blocks + 1) - (samples - 1) / 2  # of every block, from the middle
    turn = np.exp(-1j * (x * begin)[:, None] * orders)

    waves: Complexes = sums[..., :count] - 1j * sums[..., count:-2]  # (2n, K + 1, H)
    waves = np.einsum("ckh,kh->hc", waves, turn)
    level = sums[..., -2].sum(axis=1)
    ramp = sums[..., -1].sum(axis=1) + sums[..., -2] @ begin
    even, odd = np.vstack([waves.real, level]), np.vstack([-waves.imag, ramp])
    (of_even, of_odd), alone = _inverse_grams(samples, x, count)
    cosine, sine = of_even @ even, of_odd @ odd  # (H + 1, 2n)
    phasors: Complexes = sine[:-1] + 1j * cosine[:-1]
    without_harmonics = alone[1] @ odd[[0, -1]] + 1j * (alone[0] @ even[[0, -1]])

    # Residual of each block: its sums less those of the fitted curve in the block's coordinates.
    local: Complexes = phasors.T[:, None] * turn.conj()
    fitted = np.empty_like(sums)
    fitted[..., :count] = local.imag
    fitted[..., count:-2] = local.real
    fitted[..., -1] = sine[-1][:, None]
    fitted[..., -2] = cosine[-1][:, None] + sine[-1][:, None] * begin
    residual = (sums[..., :-2] - fitted @ products)[:, :blocks]  # of whole blocks
    deviations: Complexes = (residual[..., :count] - 1j * residual[..., count:]) * turn[:blocks]
    middle_s = float(record.time_s[record.start]) + (samples - 1) / 2 * record.interval_s
    clock = np.exp(-1j * record.omega * middle_s * orders)
    deviations = deviations.T * (2j / samples * clock)[:, None, None]  # (H, K, 2n)
    spread = blocks / (blocks - 1) * samples / (block * blocks)
    return SineFit(
        fundamental=without_harmonics[0] * clock[0],
        harmonics=padded((phasors * clock[:, None])[None], harmonics)[0],
        offset=cosine[-1],
        drift=sine[-1] / record.interval_s,
        middle_s=middle_s,
        deviations=deviations[0],
        covariance=padded(scatter(deviations)[None] * spread, harmonics)[0],
        degrees_of_freedom=blocks - 1,
    )


def _columns(x: float, block: int, count: int) -> tuple[Floats, Floats]:
    """Cosines, sines, one and ramp, (block, 2H + 2), and their products with cosines and sines."""
    return (_kept_columns if block * count < _CACHED_NUMBERS else _made_columns)(x, block, count)


def _made_columns(x: float, block: int, count: int) -> tuple[Floats, Floats]:
    waves = _powers(x, block, count)
    columns = np.column_stack([waves.real, waves.imag, np.ones(block), np.arange(block)])
    return columns, columns.T @ columns[:, :-2]


_kept_columns = lru_cache(maxsize=64)(_made_columns)


def _powers(x: float, samples: int, count: int) -> Complexes:
    """e^{ihxj} for j < samples, h = 1 ... count, from few exponentials: a product of two short rows."""
    fine = np.exp(1j * x * np.arange(64))
    coarse = np.exp(64j * x * np.arange(-(-samples // 64)))
    waves = np.empty((samples, count), complex)
    waves[:, 0] = first = np.multiply.outer(coarse, fine).ravel()[:samples]
    for h in range(1, count):
        np.multiply(waves[:, h - 1], first, out=waves[:, h])
    return waves


def _block_sums(window: Window, columns: Floats) -> Floats:
    """Columns times every block and the remaining samples, (2n, K + 1, 2H + 2).

    The only pass over the data.
    """
    record, blocks, n = window.record, window.blocks, window.record.n
    sums = np.empty((2 * n, blocks + 1, columns.shape[1]))
    end = record.start + window.block * blocks
    rest = columns[: record.time_s.size - end]
    for rows, signal in ((sums[:n], record.theta_rad.T), (sums[n:], record.tau_Nm.T)):
        data = signal[:, record.start : end].reshape(n, blocks, window.block)
        np.matmul(data, columns, out=rows[:, :blocks])
        np.matmul(signal[:, end:], rest, out=rows[:, blocks])
    return sums


@lru_cache(maxsize=256)
def _inverse_grams(samples: int, x: float, count: int) -> tuple[Floats, Floats]:
    """Inverse Gram matrices of (cosines, one) and (sines, ramp), shape (2, H + 1, H + 1).

    The two are orthogonal over a centred window of ``samples`` of ``x`` rad each. The second result
    holds those of the fundamental alone, shape (2, 2, 2).
    """
    orders, half = np.arange(1, count + 1), 0.5 * x * np.arange(1, 2 * count + 1)
    sine, wave_sine, wave_cosine = np.sin(half), np.sin(samples * half), np.cos(samples * half)
    aliased = np.abs(sine) < 1e-12  # an order that falls on a multiple of the sample rate
    sine = np.where(aliased, 1.0, sine)
    kernel = np.where(aliased, samples * wave_cosine / np.cos(half), wave_sine / sine)
    kernel = np.append(float(samples), kernel)  # Σ cos(q x m), q = 0, 1, ...
    slope = (np.cos(half) * wave_sine / sine - samples * wave_cosine) / sine
    difference, total = kernel[np.abs(orders[:, None] - orders)], kernel[orders[:, None] + orders]
    gram = np.empty((2, count + 1, count + 1))
    gram[0, :-1, :-1], gram[1, :-1, :-1] = (difference + total) / 2, (difference - total) / 2
    gram[0, -1, :-1] = gram[0, :-1, -1] = kernel[orders]
    gram[1, -1, :-1] = gram[1, :-1, -1] = np.where(aliased, 0.0, slope / 2)[orders - 1]  # Σ m sin(x m)
    gram[:, -1, -1] = samples, samples * (samples**2 - 1.0) / 12
    return np.asarray(np.linalg.inv(gram)), np.asarray(np.linalg.inv(gram[:, [[0], [-1]], [0, -1]]))
