"""Laws of gears by regression of the deflection on the torque over a period: start values from sines.

The motor's balance gives the torque through the gear, the arm's inertia the deflection that follows.
Friction of the motor changes the torque and, by the arm's compliance, the deflection; the compliance
itself is uncertain. Everything is linear in 1/K, D/K, friction, errors of the compliance and the law's
factors, so that no near start values are needed.
"""

from collections.abc import Iterator
from dataclasses import dataclass
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
_HARDENING = 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.5
"""Cubic torque over the linear one at the largest deflection."""
_EDGES = 0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 0.95
"""Torques at changes of slope over the largest."""
_STEEPEST, _PASSES = 20.0, 3
"""Largest ratio of two slopes, and number of passes, each with the damping that the last one found."""
_Fit = tuple[float, Floats, list[float]]
"""Squares left, factors of torque, velocity, friction and the law, and the law's parameters."""


@dataclass(frozen=True, eq=False)
class Regression:
    """Parameters of a law of the gears, each shape (n,), with Coulomb friction of the motors."""

    values: dict[str, Floats]
    left: float
    """Squares that the law leaves, over those of linear gears; of the joint where it explains most."""


def law_by_regression(law: str, phasors: Phasors, M: Floats, M2: Floats) -> Regression | None:
    """K, D, friction and the parameters of the law "cubic", "backlash" or "piecewise".

    ``M``, shape (r, n), and ``M2``, (r, n, n), are the inertias of the records. None where no positive
    stiffness explains the deflection.
    """
    found, least = [], 1.0
    names, shapes, loaded = _LAWS[law]
    for rows in _rows(phasors, M, M2, loaded):
        if not np.isfinite(rows).all():
            return None
        (linear, _), torque, damped = _least(rows, rows[:0]), rows[0].copy(), 0.0
        for _ in range(_PASSES):
            fits = list(shapes(rows))
            if not fits:
                return None
            squares, factors, values = min(fits, key=lambda each: each[0])
            # The law bends neither damping nor friction, which are parts of the torque.
            damped += factors[1] / factors[0]
            rows[0] = torque + damped * rows[1] - max(factors[2], 0.0) * rows[3]
        found.append([factors[0], damped, factors[2], *values])
        least = min(least, squares / max(linear, _LEAST))
    soft, damped, rubs, *values = np.transpose(found)
    own = {"K": 1 / soft, "D": np.abs(damped), "coulomb": np.maximum(rubs, 0.0)}
    return Regression(own | dict(zip(names, values, strict=True)), least)


def _backlash(rows: Floats) -> Iterator[_Fit]:
    squares, factors = _least(rows, np.sign(rows[0])[None])
    factors[0] = max(abs(factors[0]), _LEAST)
    yield squares, factors, [2 * factors[3]]


def _cubic(rows: Floats) -> Iterator[_Fit]:
    f = rows[0]
    size = max(np.abs(f).max(), _LEAST)
    for share in _HARDENING:
        shape = share * ((1 + share) / size) ** 2
        squares, factors = _least(np.stack([_softened(f, shape), *rows[1:]]), rows[:0])
        if factors[0] > 0 and factors[0] ** 3 > _LEAST:
            yield squares, factors, [shape / factors[0] ** 3]


def _softened(f: Floats, cubic: float) -> Floats:
    """Solution x of x + cubic x³ = f."""
    root = np.sqrt(3 * cubic)
    return np.asarray(2 / root * np.sinh(np.arcsinh(1.5 * root * f) / 3))


def _slopes(rows: Floats) -> Iterator[_Fit]:
    f = rows[0]
    for first, second in combinations(np.abs(f).max() * np.array(_EDGES), 2):
        squares, factors = _least(rows, np.stack([f - np.clip(f, -x, x) for x in (first, second)]))
        soft = np.cumsum(factors[[0, 3, 4]])
        if soft[0] < _LEAST:
            continue
        K = 1 / np.clip(soft, soft[0] / _STEEPEST, soft[0] * _STEEPEST)
        yield squares, factors, [K[1] - K[0], K[2] - K[1], first / K[0], (second - first) / K[1]]


_LAWS = {
    "cubic": (("cubic",), _cubic, 0.0),
    "backlash": (("backlash",), _backlash, _LOADED),
    "piecewise": (("piecewise", "second_bend", "knee", "second_knee"), _slopes, 0.0),
}
"""Parameters of each law, its fits to one joint, and the least torque over the largest."""


def _least(rows: Floats, law: Floats) -> tuple[float, Floats]:
    """Least weighted squares, and the factors of torque, rate, friction and the law.

    Friction acts by the arm's compliance and, by 1/K, on the deflection itself: its sign has a factor of
    its own, which is not returned; nor are the errors of the arm's compliance.
    """
    f, rate, shift, sign, delta, weight, *arm = rows
    columns = np.stack([f, rate, -shift, *law, sign, *arm])
    total = np.maximum(weight.sum(axis=1, keepdims=True), _LEAST)
    delta, columns = (v - (weight * v).sum(axis=-1, keepdims=True) / total for v in (delta, columns))
    unit = np.maximum(np.abs(columns).max(axis=(1, 2)), _LEAST)
    weighted = (weight * columns).reshape(len(columns), -1).T / unit
    x = np.linalg.lstsq(weighted, (weight * delta).ravel())[0]
    left = weighted @ x - (weight * delta).ravel()
    return float(left @ left), (x / unit)[: 3 + len(law)]


def _rows(phasors: Phasors, M: Floats, M2: Floats, loaded: float) -> list[Floats]:
    """Rows of the regression of every joint, each shape (r, points).

    They are the torque, the rate of the deflection, the deflection by friction of 1 N·m, its sign, the
    deflection, its weight, and the parts of the arm's angle by the torques of all joints. The weight of
    a record is its torque, because a small one may not reach both flanks, over the error of its
    deflection by errors of the given inertias; samples of less torque than ``loaded`` times the largest
    have none. Harmonics within the noise are left out.
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
    each = compliance * (torque / (s * s))[..., None, :]
    arm = each.sum(axis=3)
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
        arms = samples_of(each[:, :, j].swapaxes(1, 2).astype(complex), _POINTS).swapaxes(0, 1)
        found.append(np.stack([f, rate, shift, sign[:, j], wound, weight, *arms]))
    return found
