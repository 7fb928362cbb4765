"""Fit of uniformly sampled records by a two-level transform, limited by memory bandwidth.

With the sample number m = kB + j, e^{-iωt} is an outer product, so that all sums of the normal equations
come from one matrix product over the data. The blocks are nearly whole periods; the scatter of their
contributions gives the noise of the result. The Gram matrix of the basis is known in closed form
(Dirichlet kernels). The steps after the matrix product are vectorised over the records, since for short
records they dominate.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.phasors.fitted_sine import SineFit, Window, padded, scatter

_BATCH_NUMBERS = 1 << 16
"""Numbers in the block sums of one batch of records: they fit into the processor's cache."""
_CACHED_NUMBERS = 1 << 17
"""Largest table of sines that is cached, which bounds the memory."""


def fit_side_by_side(windows: Sequence[Window], harmonics: int) -> list[SineFit]:
    """Fit uniformly sampled records of eight blocks or more, with the same number of joints and orders.

    ``harmonics`` is the number of rows of ``SineFit.harmonics``.
    """
    longest = max(window.blocks for window in windows) + 1
    each = 2 * windows[0].record.n * longest * (2 * windows[0].orders + 2)
    step = max(1, _BATCH_NUMBERS // each)
    parts = [windows[begin : begin + step] for begin in range(0, len(windows), step)]
    return [fit for part in parts for fit in _fit_together(part, harmonics)]


def _fit_together(windows: Sequence[Window], harmonics: int) -> list[SineFit]:
    count = windows[0].orders
    shapes = tuple((w.record.omega * w.record.interval_s, w.samples, w.block, w.blocks) for w in windows)
    plan = _plan(shapes, count)
    columns = [_columns(x, block, count)[0] for x, _, block, _ in shapes]
    sums = _block_sums(windows, columns, plan.begin.shape[1])

    waves: Complexes = sums[..., :count] - 1j * sums[..., count:-2]  # (r, 2n, K + 1, H)
    waves = np.einsum("rckh,rkh->rhc", waves, plan.turn)
    level = sums[..., -2].sum(axis=2)[:, None]
    ramp = (sums[..., -1].sum(axis=2) + np.einsum("rck,rk->rc", sums[..., -2], plan.begin))[:, None]
    cosine = plan.even @ np.concatenate([waves.real, level], axis=1)  # (r, H + 1, 2n)
    sine = plan.odd @ np.concatenate([-waves.imag, ramp], axis=1)
    phasors: Complexes = sine[:, :-1] + 1j * cosine[:, :-1]
    first = waves[:, :1]
    alone = (plan.odd_alone @ np.concatenate([-first.imag, ramp], axis=1))[:, 0] + 1j * (
        plan.even_alone @ np.concatenate([first.real, level], axis=1)
    )[:, 0]

    # Residual of each block: its sums less those of the fitted curve in the block's coordinates.
    local: Complexes = phasors.swapaxes(1, 2)[:, :, None] * plan.turn.conj()[:, None]
    fitted = np.empty_like(sums)
    fitted[..., :count] = local.imag
    fitted[..., count:-2] = local.real
    fitted[..., -1] = sine[:, -1, :, None]
    fitted[..., -2] = cosine[:, -1, :, None] + sine[:, -1, :, None] * plan.begin[:, None]
    residual = sums[..., :-2] - fitted @ plan.products[:, None]
    deviations: Complexes = residual[..., :count] - 1j * residual[..., count:]
    deviations = deviations * (plan.turn * plan.whole)[:, None]
    middle_s = np.array([w.record.time_s[w.record.start] for w in windows])
    middle_s += [(w.samples - 1) / 2 * w.record.interval_s for w in windows]
    omega = np.array([w.record.omega for w in windows])
    clock: Complexes = np.exp(-1j * np.outer(omega * middle_s, np.arange(1, count + 1)))
    samples = np.array([w.samples for w in windows])
    deviations = deviations.transpose(0, 3, 2, 1) * (2j / samples[:, None] * clock)[..., None, None]
    covariance = padded(scatter(deviations) * plan.spread[:, None, None, None], harmonics)
    phasors = padded(phasors * clock[..., None], harmonics)
    alone = alone * clock[:, :1]
    interval = np.array([w.record.interval_s for w in windows])
    drift = sine[:, -1] / interval[:, None]
    return [
        SineFit(
            fundamental=alone[r],
            harmonics=phasors[r],
            offset=cosine[r, -1],
            drift=drift[r],
            middle_s=float(middle_s[r]),
            deviations=deviations[r, 0, : window.blocks],
            covariance=covariance[r],
            degrees_of_freedom=window.blocks - 1,
        )
        for r, window in enumerate(windows)
    ]


@dataclass(frozen=True, eq=False)
class _Plan:
    """Data-independent tables, cached per shape; r records of at most K blocks.

    Each record has one more block with the remaining samples; rows beyond are zero.
    """

    products: Floats  # of all columns with the cosines and sines, (r, 2H + 2, 2H)
    begin: Floats  # first sample of every block, from the middle of the window, (r, K + 1)
    turn: Complexes  # e^{-ihxm} there, (r, K + 1, H)
    whole: Floats  # 1 for whole blocks, else 0, (r, K + 1, 1)
    spread: Floats  # from the scatter of whole blocks to that of the result, (r,)
    even: Floats  # inverse Gram matrix of cosines and one, (r, H + 1, H + 1)
    odd: Floats  # inverse Gram matrix of sines and ramp
    even_alone: Floats  # the same without harmonics, (r, 2, 2)
    odd_alone: Floats


@lru_cache(maxsize=64)
def _plan(shapes: tuple[tuple[float, int, int, int], ...], count: int) -> _Plan:
    turns = np.array([[shape[0]] for shape in shapes])
    samples, block, blocks = np.array([shape[1:] for shape in shapes]).T[..., None]
    place = np.arange(int(blocks.max()) + 1)
    begin: Floats = np.where(place <= blocks, block * place - (samples - 1) / 2, 0.0)
    orders = np.arange(1, count + 1)
    even, odd = _gram(samples, turns, orders)
    ends = np.ix_(range(len(shapes)), [0, -1], [0, -1])
    return _Plan(
        products=np.array([_columns(x, block, count)[1] for x, _, block, _ in shapes]),
        begin=begin,
        turn=np.exp(-1j * (turns * begin)[..., None] * orders),
        whole=(place < blocks).astype(float)[..., None],
        spread=(blocks / (blocks - 1) * samples / (block * blocks))[:, 0],
        even=np.asarray(np.linalg.inv(even), float),
        odd=np.asarray(np.linalg.inv(odd), float),
        even_alone=np.asarray(np.linalg.inv(even[ends]), float),
        odd_alone=np.asarray(np.linalg.inv(odd[ends]), float),
    )


def _columns(x: float, block: int, count: int) -> tuple[Floats, Floats]:
    """Cosines, sines, one and ramp, (block, 2H + 2), and their products with cosines and sines."""
    return (_kept_columns if block * count < _CACHED_NUMBERS else _made_columns)(x, block, count)


def _made_columns(x: float, block: int, count: int) -> tuple[Floats, Floats]:
    waves = _powers(x, block, count)
    columns = np.empty((block, 2 * count + 2))
    columns[:, :count] = waves.real
    columns[:, count:-2] = waves.imag
    columns[:, -2] = 1
    columns[:, -1] = np.arange(block)
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


def _block_sums(windows: Sequence[Window], columns: Sequence[Floats], most: int) -> Floats:
    """Columns times every block and the remaining samples, (r, 2n, most, 2H + 2).

    The only pass over the data.
    """
    n = windows[0].record.n
    sums = np.zeros((len(windows), 2 * n, most, columns[0].shape[1]))
    for window, table, result in zip(windows, columns, sums, strict=True):
        record, blocks = window.record, window.blocks
        end = record.start + window.block * blocks
        rest = table[: record.time_s.size - end]
        for rows, signal in ((result[:n], record.theta_rad.T), (result[n:], record.tau_Nm.T)):
            data = signal[:, record.start : end].reshape(n, blocks, window.block)
            np.matmul(data, table, out=rows[:, :blocks])
            np.matmul(signal[:, end:], rest, out=rows[:, blocks])
    return sums


def _gram(samples: np.ndarray, x: Floats, orders: np.ndarray) -> tuple[Floats, Floats]:
    """Gram matrices of (cosines, one) and (sines, ramp), orthogonal over a centred window.

    ``samples`` and ``x``, shape (r, 1), are the number of samples and the radians per sample; ``orders``
    has shape (H,).
    """
    half = 0.5 * x * np.arange(1, 2 * orders[-1] + 1)
    sine, wave_sine, wave_cosine = np.sin(half), np.sin(samples * half), np.cos(samples * half)
    aliased = np.abs(sine) < 1e-12  # an order that falls on a multiple of the sample rate
    sine = np.where(aliased, 1.0, sine)
    kernel = np.where(aliased, samples * wave_cosine / np.cos(half), wave_sine / sine)
    kernel = np.concatenate([samples, kernel], axis=1)  # Σ cos(q x m), q = 0, 1, ...
    slope = (np.cos(half) * wave_sine / sine - samples * wave_cosine) / sine
    ramp = np.where(aliased, 0.0, slope / 2)  # Σ m sin(q x m), q = 1, 2, ...
    difference, total = np.abs(orders[:, None] - orders), orders[:, None] + orders
    count = orders.size
    even, odd = np.empty((2, len(x), count + 1, count + 1))
    even[:, :-1, :-1] = (kernel[:, difference] + kernel[:, total]) / 2
    odd[:, :-1, :-1] = (kernel[:, difference] - kernel[:, total]) / 2
    even[:, -1, :-1] = even[:, :-1, -1] = kernel[:, orders]
    odd[:, -1, :-1] = odd[:, :-1, -1] = ramp[:, orders - 1]
    even[:, -1, -1] = samples[:, 0]
    odd[:, -1, -1] = samples[:, 0] * (samples[:, 0] ** 2 - 1.0) / 12
    return even, odd
