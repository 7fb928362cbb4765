"""Fit of jittered or very short records by normal equations at the sample times."""

from collections.abc import Iterator

import numpy as np

from jointid.arrays import Floats
from jointid.phasors.fitted_sine import SineFit, Window, padded, scatter, sine_basis
from jointid.records import SineRecord

_CHUNK = 65_536
"""Samples per pass, which bounds the memory."""
_RESOLVED = 0.6
"""Distance of a spectral line from the fitted ones, in lines, from which the fit leaves noise there."""


def fit_directly(window: Window, harmonics: int, *, by_scatter: bool) -> SineFit:
    """Fit a record by normal equations at its sample times; two passes, the second for the noise.

    ``harmonics`` is the number of rows of ``SineFit.harmonics``. The noise is estimated from the scatter
    of the blocks (``by_scatter``); else from the spectral lines next to the sine, or without such lines
    from the residual, assumed white.
    """
    record, block, blocks = window.record, window.block, max(window.blocks, 1)
    orders = np.arange(1, window.orders + 1)
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
    degrees_of_freedom = samples - size
    # The fit removes a known share of white noise at each line.
    left = 1 - np.einsum("lc,cd,ld->l", fitted.conj(), inverse, fitted).real / samples
    beside, left = beside[left > 0.1], left[left > 0.1]
    if by_scatter:
        covariance, degrees_of_freedom = blocks / (blocks - 1) * scatter(deviations), blocks - 1
    elif left.size > 0:
        density = np.einsum("la,lb->ab", beside / left[:, None], beside.conj()) / (left.size * samples)
        covariance[0] = spread[0] * density
        degrees_of_freedom = left.size
    phasors = solution[count:-2] + 1j * solution[:count]
    return SineFit(
        fundamental=(alone[1] + 1j * alone[0]) * clock[0],
        harmonics=padded(phasors[None] * clock[:, None], harmonics)[0],
        offset=solution[-2],
        drift=solution[-1] / span,
        middle_s=middle_s,
        deviations=deviations[0],
        covariance=padded(covariance[None], harmonics)[0],
        degrees_of_freedom=degrees_of_freedom,
    )


def _free_lines(record: SineRecord, orders: np.ndarray) -> Floats:
    """Spectral lines next to the fundamental and not in the fit, where noise is measured, rad/s."""
    steps = np.array([-3, -2, -1, 1, 2, 3]) / record.periods
    place = 1 + steps  # in units of the fundamental
    taken = np.concatenate([[0.0], orders])
    distance = np.abs(place[:, None] - taken).min(axis=1)
    return np.asarray(record.omega * place[distance > _RESOLVED / record.periods])


def _chunks(
    record: SineRecord, orders: np.ndarray, middle_s: float, span: float
) -> Iterator[tuple[Floats, Floats]]:
    """Basis functions and data (q, then τ), chunk by chunk."""
    for begin in range(record.start, record.time_s.size, _CHUNK):
        part = slice(begin, begin + _CHUNK)
        time = record.time_s[part] - middle_s
        columns = sine_basis(record.omega * np.outer(time, orders), time / span)
        yield columns, np.hstack([record.theta_rad[part], record.tau_Nm[part]])
