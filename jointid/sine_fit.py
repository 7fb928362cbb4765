"""Least-squares fit of a sine with its harmonics, an offset and a drift to every channel of a record.

Splitting the sample number into m = kB + j makes e^{-iωt} an outer product, so that all the sums of the
normal equations come from one matrix product over the data (the two-level transform): the fit runs at
the speed of memory. The blocks are close to whole periods; how their contributions scatter is the
noise of the result. The Gram matrix of the columns is known in closed form (Dirichlet kernels).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.records import SineRecord
from jointid.threads import one_thread

FEWEST_BLOCKS = 8
"""With fewer blocks the residual, taken as white, tells the noise better than their scatter."""

_BLOCK_SAMPLES = 1024  # shorter blocks leave the matrix product bound by overhead, not by memory
_NEGLIGIBLE_PHASE = 1e-6  # rad; jitter below it cannot be seen in a phasor
_CHUNK = 65_536  # samples of a jittered record whose sines stand in memory at a time


FEWEST_SAMPLES = 8
"""Four unknowns per signal, and as many again to tell the noise."""


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


def fit_sines(records: Sequence[SineRecord], harmonics: int = 1) -> list[SineFit]:
    """Fit every record; uniform ones by the two-level transform, jittered or very short ones directly.

    Parameters
    ----------
    records : sequence of SineRecord
    harmonics : int, default 1
        Highest harmonic in the fit. Those at or above 0.45 of the sample rate, or more than a quarter
        of the samples can tell, are left out.

    Returns
    -------
    list of SineFit
        In the order of ``records``.

    Raises
    ------
    JointIdError
        When a record has fewer than ``FEWEST_SAMPLES`` usable samples.
    """
    return [_fit_one(record, harmonics) for record in records]


def _fit_one(record: SineRecord, harmonics: int) -> SineFit:
    samples = record.time_s.size - record.start
    if samples < FEWEST_SAMPLES:
        raise JointIdError(
            f"{record.label or 'A record'} has {samples} usable samples; a sine with offset and drift "
            f"needs {FEWEST_SAMPLES}. Sample faster, or record longer."
        )
    highest = min(0.45 / (record.frequency_hz * record.interval_s), samples / 8 - 1, harmonics)
    if record.periods < 2:  # within little more than a period, harmonics and drift look alike
        highest = 1
    orders = np.arange(1, max(1, int(highest)) + 1)
    block, blocks = _block_layout(record)
    if is_uniform(record) and blocks >= FEWEST_BLOCKS:
        return _fit_blocks(record, orders, harmonics, block, blocks)
    with one_thread():
        return _fit_directly(record, orders, harmonics, block, blocks)


def is_uniform(record: SineRecord) -> bool:
    """Whether the jitter is too small to be seen in the record's phasors."""
    return record.jitter_s * record.omega < _NEGLIGIBLE_PHASE


def _block_layout(record: SineRecord) -> tuple[int, int]:
    """Samples per block, a few periods rounded to a sample, and the number of whole blocks."""
    samples = record.time_s.size - record.start
    period = 1 / (record.frequency_hz * record.interval_s)
    most = max(1, int(samples / period / (2 * FEWEST_BLOCKS)))
    least = min(most, int(np.ceil(_BLOCK_SAMPLES / period)))
    choices = period * np.arange(least, min(most, least + 7) + 1)
    block = round(choices[np.argmin(np.abs(choices - np.round(choices)))])
    return block, int(samples // block)


@dataclass(frozen=True, eq=False)
class _Plan:
    """All that records of one frequency, sample rate and length share."""

    columns: Floats  # cosines, sines, one and ramp within a block, (block, 2H + 2)
    products: Floats  # of all columns with the cosines and sines, (2H + 2, 2H)
    begin: Floats  # first sample of every block and of the rest, from the middle of the window
    turn: Complexes  # e^{-ihxm} there, (blocks + 1, H)
    even: Floats  # inverse Gram matrix of cosines and one
    odd: Floats  # inverse Gram matrix of sines and ramp
    even_alone: Floats  # the same without harmonics, (2, 2)
    odd_alone: Floats


@lru_cache(maxsize=64)
def _plan(x: float, samples: int, block: int, count: int) -> _Plan:
    orders = np.arange(1, count + 1)
    waves = _powers(x, block, count)
    columns = np.empty((block, 2 * count + 2))
    columns[:, :count] = waves.real
    columns[:, count:-2] = waves.imag
    columns[:, -2] = 1
    columns[:, -1] = np.arange(block)
    begin: Floats = block * np.arange(samples // block + 1, dtype=float) - (samples - 1) / 2
    even, odd = _gram(samples, x, orders)
    return _Plan(
        columns=columns,
        products=columns.T @ columns[:, :-2],
        begin=begin,
        turn=np.exp(-1j * x * np.outer(begin, orders)),
        even=np.asarray(np.linalg.inv(even), float),
        odd=np.asarray(np.linalg.inv(odd), float),
        even_alone=np.asarray(np.linalg.inv(even[np.ix_([0, -1], [0, -1])]), float),
        odd_alone=np.asarray(np.linalg.inv(odd[np.ix_([0, -1], [0, -1])]), float),
    )


def _powers(x: float, samples: int, count: int) -> Complexes:
    """e^{ihxj} for j < samples, h = 1 ... count; few exponentials: the product of two short rows."""
    fine = np.exp(1j * x * np.arange(64))
    coarse = np.exp(64j * x * np.arange(-(-samples // 64)))
    waves = np.empty((samples, count), complex)
    waves[:, 0] = first = np.multiply.outer(coarse, fine).ravel()[:samples]
    for h in range(1, count):
        np.multiply(waves[:, h - 1], first, out=waves[:, h])
    return waves


def _fit_blocks(
    record: SineRecord, orders: np.ndarray, harmonics: int, block: int, blocks: int
) -> SineFit:
    samples = record.time_s.size - record.start
    count = orders.size
    plan = _plan(record.omega * record.interval_s, samples, block, count)
    whole, rest = _block_sums(record, plan.columns, block, blocks)

    sums = np.concatenate([whole, rest], axis=1)
    waves = ((sums[..., :count] - 1j * sums[..., count:-2]) * plan.turn).sum(axis=1)
    level = sums[..., -2].sum(axis=1)
    ramp = sums[..., -1].sum(axis=1) + sums[..., -2] @ plan.begin
    cosine = plan.even @ np.vstack([waves.real.T, level])
    sine = plan.odd @ np.vstack([-waves.imag.T, ramp])
    phasors = sine[:-1] + 1j * cosine[:-1]
    alone = 1j * (plan.even_alone @ np.vstack([waves[:, 0].real, level]))[0]
    alone += (plan.odd_alone @ np.vstack([-waves[:, 0].imag, ramp]))[0]

    # The fitted curve in each block's own coordinates, taken from the block's sums, leaves its residual.
    local = phasors.T[:, None] / plan.turn[:-1]
    fitted = np.empty_like(whole)
    fitted[..., :count] = local.imag
    fitted[..., count:-2] = local.real
    fitted[..., -2] = cosine[-1][:, None] + np.outer(sine[-1], plan.begin[:-1])
    fitted[..., -1] = sine[-1][:, None]
    residual = whole[..., :-2] - fitted @ plan.products
    middle_s = float(record.time_s[record.start]) + (samples - 1) / 2 * record.interval_s
    clock = np.exp(-1j * record.omega * middle_s * orders)
    deviations = (residual[..., :count] - 1j * residual[..., count:]) * plan.turn[:-1]
    deviations = (2j / samples * clock * deviations).transpose(2, 1, 0)
    return SineFit(
        fundamental=alone * clock[0],
        harmonics=_padded(phasors * clock[:, None], harmonics),
        offset=cosine[-1],
        drift=sine[-1] / record.interval_s,
        middle_s=middle_s,
        deviations=deviations[0],
        covariance=_padded(_scatter(deviations) * (samples / (block * blocks)), harmonics),
        freedom=blocks - 1,
    )


def _block_sums(record: SineRecord, columns: Floats, block: int, blocks: int) -> tuple[Floats, Floats]:
    """Columns times every block, and times the samples left over: the one pass over the data."""
    n = record.n
    end = record.start + block * blocks
    whole = np.empty((2 * n, blocks, columns.shape[1]))
    rest = np.empty((2 * n, 1, columns.shape[1]))
    for rows, signal in ((slice(n), record.theta_rad.T), (slice(n, 2 * n), record.tau_Nm.T)):
        np.matmul(signal[:, record.start : end].reshape(n, blocks, block), columns, out=whole[rows])
        rest[rows, 0] = signal[:, end:] @ columns[: signal.shape[1] - end]
    return whole, rest


def _gram(samples: int, x: float, orders: np.ndarray) -> tuple[Floats, Floats]:
    """Gram matrices of (cosines, one) and (sines, ramp), orthogonal over a centred window."""
    half = 0.5 * x * np.arange(1, 2 * orders[-1] + 1)
    sine, wave_sine, wave_cosine = np.sin(half), np.sin(samples * half), np.cos(samples * half)
    aliased = np.abs(sine) < 1e-12  # an order that falls on a multiple of the sample rate
    sine = np.where(aliased, 1.0, sine)
    kernel = np.where(aliased, samples * wave_cosine / np.cos(half), wave_sine / sine)
    kernel = np.concatenate([[samples], kernel])  # Σ cos(q x m), q = 0, 1, ...
    slope = (np.cos(half) * wave_sine / sine - samples * wave_cosine) / sine
    ramp = np.where(aliased, 0.0, slope / 2)  # Σ m sin(q x m), q = 1, 2, ...
    difference, total = np.abs(orders[:, None] - orders), orders[:, None] + orders
    count = orders.size
    even, odd = np.empty((2, count + 1, count + 1))
    even[:-1, :-1] = (kernel[difference] + kernel[total]) / 2
    odd[:-1, :-1] = (kernel[difference] - kernel[total]) / 2
    even[-1, :-1] = even[:-1, -1] = kernel[orders]
    odd[-1, :-1] = odd[:-1, -1] = ramp[orders - 1]
    even[-1, -1] = samples
    odd[-1, -1] = samples * (samples * samples - 1.0) / 12
    return even, odd


def _fit_directly(
    record: SineRecord, orders: np.ndarray, harmonics: int, block: int, blocks: int
) -> SineFit:
    """Normal equations at the actual sample times, in chunks; two passes, the second for the noise."""
    used = record.time_s[record.start :]
    middle_s = float(used[0] + used[-1]) / 2
    span = float(used[-1] - used[0])
    samples, count, size = used.size, orders.size, 2 * orders.size + 2
    gram, right = np.zeros((size, size)), np.zeros((size, 2 * record.n))
    for columns, data in _chunks(record, orders, middle_s, span):
        gram += columns.T @ columns
        right += columns.T @ data
    # Near one period some columns are nearly dependent: a pseudo-inverse stays finite.
    inverse = np.linalg.pinv(gram, hermitian=True)
    solution = inverse @ right
    simple = [0, count, size - 2, size - 1]
    alone = np.linalg.lstsq(gram[np.ix_(simple, simple)], right[simple], rcond=None)[0]

    blocks = max(blocks, 1)
    owner = np.minimum(np.arange(samples) // block, blocks - 1)
    deviations = np.zeros((blocks, count, 2 * record.n), complex)
    power = np.zeros((2 * record.n, 2 * record.n))
    lines = _free_lines(record, orders)
    beside = np.zeros((lines.size, 2 * record.n), complex)
    fitted = np.zeros((lines.size, size), complex)
    done = 0
    for columns, data in _chunks(record, orders, middle_s, span):
        residual = data - columns @ solution
        power += residual.T @ residual
        time = record.time_s[record.start + done : record.start + done + len(data)] - middle_s
        neighbours = np.exp(-1j * np.outer(lines, time))
        beside += neighbours @ residual
        fitted += neighbours @ columns
        waves = columns[:, :count] - 1j * columns[:, count:-2]
        for each in np.unique(owner[done : done + len(data)]):
            inside = owner[done : done + len(data)] == each
            deviations[each] += waves[inside].T @ residual[inside]
        done += len(data)
    clock = np.exp(-1j * record.omega * middle_s * orders)
    deviations = (2j / samples * clock[:, None] * deviations).swapaxes(0, 1)
    # White noise of covariance R: a coefficient's variance is R times the inverse Gram's diagonal.
    spread = np.diag(inverse)[:count] + np.diag(inverse)[count:-2]
    covariance = (spread[:, None, None] * power / (samples - size)).astype(complex)
    freedom = samples - size
    # The fit has removed part of the noise at each line; what it left of white noise is known.
    left = 1 - np.einsum("lc,cd,ld->l", fitted.conj(), inverse, fitted).real / samples
    beside, left = beside[left > 0.1], left[left > 0.1]
    if blocks >= FEWEST_BLOCKS:
        covariance, freedom = _scatter(deviations), blocks - 1
    elif left.size > 0:
        density = np.einsum("la,lb->ab", beside / left[:, None], beside.conj()) / (left.size * samples)
        covariance[0] = spread[0] * density
        freedom = left.size
    return SineFit(
        fundamental=(alone[1] + 1j * alone[0]) * clock[0],
        harmonics=_padded((solution[count:-2] + 1j * solution[:count]) * clock[:, None], harmonics),
        offset=solution[-2],
        drift=solution[-1] / span,
        middle_s=middle_s,
        deviations=deviations[0],
        covariance=_padded(covariance, harmonics),
        freedom=freedom,
    )


def _free_lines(record: SineRecord, orders: np.ndarray) -> Floats:
    """Spectral lines beside the fundamental that the fit leaves free, where the noise shows, rad/s."""
    steps = np.array([-3, -2, -1, 1, 2, 3]) / record.periods
    place = 1 + steps  # in units of the fundamental
    taken = np.concatenate([[0.0], orders])
    distance = np.abs(place[:, None] - taken).min(axis=1)
    return np.asarray(record.omega * place[distance > 0.6 / record.periods])


def _chunks(
    record: SineRecord, orders: np.ndarray, middle_s: float, span: float
) -> Iterator[tuple[Floats, Floats]]:
    """Columns (cosines, sines, one, ramp) and data (q, then τ) of some samples at a time."""
    for begin in range(record.start, record.time_s.size, _CHUNK):
        part = slice(begin, begin + _CHUNK)
        time = record.time_s[part] - middle_s
        angle = record.omega * np.outer(time, orders)
        columns = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(time), time / span])
        yield columns, np.hstack([record.theta_rad[part], record.tau_Nm[part]])


def _scatter(deviations: Complexes) -> Complexes:
    """Covariance (H, 2n, 2n) of sums over independent blocks whose mean the fit has removed."""
    blocks = deviations.shape[1]
    return np.asarray(blocks / (blocks - 1) * deviations.swapaxes(1, 2) @ deviations.conj())


def _padded(rows: Complexes, harmonics: int) -> Complexes:
    """Fill up with zeros what the samples cannot carry."""
    padded = np.zeros((harmonics, *rows.shape[1:]), complex)
    padded[: len(rows)] = rows
    return padded
