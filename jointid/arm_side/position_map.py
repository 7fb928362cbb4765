"""Transmission error over the joint's position that remains after the fit: for predictions only."""

from dataclasses import dataclass

import numpy as np

from jointid.arm_side.band_limited import GaussianFilter
from jointid.arm_side.mixed_model import Regression
from jointid.arm_side.terms import Ripple, waves
from jointid.arrays import Floats

_MOST_WAVES = 120
_MOST_ORDERS = 4
_COARSEST_ORDER = 60.0
"""Smallest wavenumber of a tooth order, rad/rad; longer waves belong to the map."""
_FINEST_ORDER = 3000.0
_CLEAR = 12.0
"""Power of a tooth order over the mean of the spectrum, at least; noise alone stays below ln(N)."""
_WAVE_RAD = 1.5e-5
"""Expected size of one wave of the map, about 3 seconds of arc."""


@dataclass(frozen=True, eq=False)
class PositionMap:
    """Waves over the joint angle: a map in the band, and tooth orders at any frequency."""

    basis: Ripple
    waves: Floats
    order_waves: Floats

    def __call__(self, q: Floats, lowpass: GaussianFilter) -> Floats:
        """Error at joint angles (N,), rad."""
        fast = waves(q, self.basis.orders) @ self.order_waves
        return np.asarray(self.basis(q) @ self.waves + fast - lowpass(fast))


def position_map(q: Floats, slow: Floats, fast: Floats, orders: Floats) -> PositionMap:
    """Fit the map to the residual of a model.

    Of the joint angles ``q`` of all records, the residual in the band (``slow``) and the deflection
    above it (``fast``), rad, each shape (N,), with the ``orders`` (m,) of ``tooth_orders``.
    """
    low, high = float(q.min()), float(q.max())
    basis = Ripple((low, high), 1.1 * (high - low) + 1e-9, 1, _MOST_WAVES, orders)
    # the residual of neighbouring samples is alike: one in ten counts
    data = Regression(slow, basis(q))
    noise = np.sqrt(10.0) * max(float(slow.std()), 1e-7)
    fitted = data.estimate(noise, np.full(2 * _MOST_WAVES, _WAVE_RAD))
    return PositionMap(basis, fitted.beta, _sizes(q, fast, orders))


def tooth_orders(q: Floats, y: Floats) -> Floats:
    """Find wavenumbers with clear power in a deflection above the band y (N,) over angles q (N,)."""
    step = max(0.5, 1.0 / float(np.ptp(q) + 1e-9))
    count = int((_FINEST_ORDER - _COARSEST_ORDER) / step)
    found: list[float] = []
    left = y
    for _ in range(_MOST_ORDERS):
        power = _power(q, left, _COARSEST_ORDER, step, count)
        if not power.size or power.max() < _CLEAR * power.mean():
            break
        peak = _COARSEST_ORDER + step * int(np.argmax(power))
        near = _power(q, left, peak - step, 0.1 * step, 21)
        found.append(peak + step * (0.1 * int(np.argmax(near)) - 1.0))
        left = y - waves(q, np.array(found)) @ _sizes(q, y, np.array(found))
    return np.array(found)


def _sizes(q: Floats, y: Floats, orders: Floats) -> Floats:
    """Coefficients of the waves in y (N,)."""
    return np.asarray(np.linalg.lstsq(waves(q, orders), y, rcond=None)[0], float)


def _power(q: Floats, y: Floats, first: float, step: float, count: int) -> Floats:
    """Power of y (N,) at equally spaced wavenumbers, shape (count,)."""
    power, turning, turn = np.empty(count), y * np.exp(-1j * first * q), np.exp(-1j * step * q)
    for i in range(count):
        power[i] = np.abs(turning.sum()) ** 2
        turning *= turn
    return power
