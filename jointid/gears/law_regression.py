"""Laws of gears by regression of the deflection on the torque over a period: start values from sines.

The motor's balance gives the torque through the gear, the arm's inertia the deflection that follows.
Friction of the motor changes the torque and, by the arm's compliance, the deflection. Everything is
linear in 1/K, D/K, friction and the law's factors, so that no near start values are needed.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from jointid.arrays import Floats
from jointid.phasors.extract import Phasors
from jointid.phasors.periods import phasors_of, samples_of

_POINTS, _LOADED, _LEAST = 128, 0.2, 1e-30
"""Samples over a period, torque over its largest from which they count for backlash, and the least
number above zero."""
_CLEAR = 5.0
"""Standard deviations from which a harmonic of the torque is no noise."""
_EDGES = 0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 0.95
"""Torques at changes of slope over the largest."""
_BENT, _STEEPEST = 0.7, 20.0
"""Squares that slopes must leave of those of a linear gear, and the largest ratio of two slopes."""


def backlash_by_regression(phasors: Phasors, M: Floats, M2: Floats) -> dict[str, Floats]:
    """K, D, backlash and Coulomb friction of every joint, each shape (n,).

    ``M``, shape (r, n), and ``M2``, (r, n, n), are the inertias of the records.
    """
    rows = _rows(phasors, M, M2, _LOADED)
    soft, damped, rubs, law = np.transpose([_least(each, np.sign(each[0])[None])[1] for each in rows])
    soft = np.maximum(np.abs(soft), _LEAST)
    return _parameters(soft, damped, rubs) | {"backlash": 2 * law}


def slopes_by_regression(phasors: Phasors, M: Floats, M2: Floats) -> dict[str, Floats] | None:
    """K, D, three slopes and Coulomb friction, as ``backlash_by_regression``; None of linear gears."""
    found, bends, explained = [], [], 1.0
    for rows in _rows(phasors, M, M2, 0.0):
        f = rows[0]
        if not np.isfinite(rows).all():
            return None
        least, linear = np.inf, _least(rows, np.zeros((0, *f.shape)))[0]
        for edges in combinations(np.abs(f).max() * np.array(_EDGES), 2):
            squares, each = _least(rows, np.stack([f - np.clip(f, -edge, edge) for edge in edges]))
            if squares < least:
                least, best, at = squares, each, edges
        soft = np.cumsum(best[[0, 3, 4]])
        if not soft[0] > 0:
            return None
        K = 1 / np.clip(soft, soft[0] / _STEEPEST, soft[0] * _STEEPEST)
        bends.append([K[1] - K[0], K[2] - K[1], at[0] / K[0], (at[1] - at[0]) / K[1]])
        found.append(best[:3])
        explained = min(explained, least / max(linear, _LEAST))
    if not explained < _BENT:
        return None
    names = "piecewise", "second_bend", "knee", "second_knee"
    return _parameters(*np.transpose(found)) | dict(zip(names, np.transpose(bends), strict=True))


def _parameters(soft: Floats, damped: Floats, rubs: Floats) -> dict[str, Floats]:
    return {"K": 1 / soft, "D": np.abs(damped) / soft, "coulomb": np.maximum(rubs, 0.0)}


def _least(rows: Floats, law: Floats) -> tuple[float, Floats]:
    """Least weighted squares, and the factors of torque, rate, friction and the law.

    Friction acts by the arm's compliance and, by 1/K, on the deflection itself: its sign has a factor of
    its own, which is not returned.
    """
    f, rate, shift, sign, delta, weight = rows
    columns = np.stack([f, rate, -shift, sign, *law])
    total = np.maximum(weight.sum(axis=1, keepdims=True), _LEAST)
    delta, columns = (v - (weight * v).sum(axis=-1, keepdims=True) / total for v in (delta, columns))
    unit = np.maximum(np.abs(columns).max(axis=(1, 2)), _LEAST)
    weighted = (weight * columns).reshape(len(columns), -1).T / unit
    x = np.linalg.lstsq(weighted, (weight * delta).ravel())[0]
    left = weighted @ x - (weight * delta).ravel()
    return float(left @ left), np.delete(x / unit, 3)


def _rows(phasors: Phasors, M: Floats, M2: Floats, loaded: float) -> list[Floats]:
    """Rows of the regression of every joint, each shape (r, points).

    They are the torque, the rate of the deflection, the deflection by friction of 1 N·m, its sign, the
    deflection, and the weight. The weight of a record is its torque, because a small one may not reach
    both flanks, over the error of its deflection by errors of the given inertias; samples of less torque
    than ``loaded`` times the largest have none. Harmonics within the noise are left out.
    """
    n, z = phasors.n, phasors.harmonics
    s = 1j * phasors.omega[:, None, None] * np.arange(1, z.shape[1] + 1)[:, None]
    own = s * s * M[:, None]
    variance = np.einsum("rhjj->rhj", phasors.harmonic_covariance).real
    noise = variance[..., n:] + np.abs(own) ** 2 * variance[..., :n]
    rotor = own * z[..., :n]
    clear = np.abs(z[..., n:] - rotor) ** 2 > _CLEAR**2 * noise
    clear[:, 0] = True
    torque = np.where(clear, z[..., n:] - rotor, 0)
    compliance = np.linalg.inv(M2)[:, None]
    arm = (compliance @ torque[..., None])[..., 0] / (s * s)
    delta = np.where(clear, z[..., :n], 0) - arm
    sign = np.sign(samples_of((s * z[..., :n]).swapaxes(1, 2), _POINTS))
    own = np.diagonal(compliance, axis1=2, axis2=3) / (s * s)
    moved = own * phasors_of(sign, z.shape[1]).swapaxes(1, 2)
    waves = samples_of(np.stack([torque, delta, s * delta, moved, arm, rotor]).swapaxes(2, 3), _POINTS)
    found = []
    for j in range(n):
        f, wound, rate, shift, *given = waves[:, :, j]
        size = np.maximum(np.abs(f).max(axis=1, keepdims=True), _LEAST)
        spread = [np.maximum(v.std(axis=1), _LEAST) for v in (f, wound, *given)]
        doubt = np.hypot(spread[2], spread[3] * spread[1] / spread[0])
        weight = (np.abs(f) >= loaded * size) * size / doubt[:, None]
        found.append(np.stack([f, rate, shift, sign[:, j], wound, weight]))
    return found
