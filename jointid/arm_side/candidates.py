"""Sensible sets of terms for the deflection of one joint, their average, and its clear moves."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from jointid.arm_side.mixed_model import Regression, low_frequency_noise
from jointid.arm_side.terms import MOTOR_HARMONICS, SLOW_HARMONICS
from jointid.arrays import Floats

_ARC_SECOND = np.pi / 180 / 3600
_SLOW_RAD = tuple(a * _ARC_SECOND for a in (1.0, 3.0, 10.0, 30.0, 100.0))
"""Expected size of the transmission error once a turn of the joint; harmonic k has 1/k of it."""
_RIPPLE_RAD = tuple(a * _ARC_SECOND for a in (0.1, 3.0))
"""Expected size of each wave of the gear's ripple and of the harmonics of the motor."""
_TEETH_RAD = 10 * _ARC_SECOND
"""Expected size of a periodic error that the deflection shows above the band."""
_FRICTION_RAD = np.array([20.0, 10.0]) * _ARC_SECOND
"""Expected deflection by friction in the gear that builds up over the way, and with the velocity."""
_FRICTION_LOAD_NM = 3000.0
"""Torque at which friction by load is expected to equal the constant friction."""
_DRIFT_RAD = 3 * _ARC_SECOND
"""Expected drift of gear or encoder from the middle of a record to its end."""
_DAMPING_S = 3e-3
"""Expected ratio of damping and stiffness of a joint."""
_MEMORY_S = 0.5
"""Longest time over which the residual is correlated."""
_ROUNDS = 4


@dataclass(frozen=True)
class Scale:
    """Data of a joint before its fit."""

    compliance: float
    """Scale of the compliance for priors that are relative to it, rad/(N·m)."""
    skew_std_s: float = np.inf
    """Prior of the remaining skew, s: infinite where it is fitted, 0 where it is left out."""


@dataclass(frozen=True)
class TermSet:
    """One choice of terms."""

    slow_rad: float
    ripple_rad: float
    friction: bool

    def std(self, groups: dict[str, slice], size: int, scale: Scale) -> Floats:
        """Prior standard deviations of all coefficients, shape (size,).

        Offsets and drifts of the records come last; offsets are free.
        """
        compliance = scale.compliance
        std = np.zeros(size)
        last = max(group.stop for group in groups.values())
        std[last:] = np.repeat([np.inf, _DRIFT_RAD], (size - last) // 2)
        std[groups["compliance"]] = np.inf
        std[groups["skew"]] = scale.skew_std_s
        std[groups["payload"]] = compliance
        std[groups["damping"]] = compliance * _DAMPING_S
        std[groups["slow"]] = self.slow_rad / np.tile(SLOW_HARMONICS, 2)
        std[groups["motor"]] = self.ripple_rad / np.tile(MOTOR_HARMONICS, 2)
        std[groups["ripple"]] = self.ripple_rad
        std[groups["teeth"]] = _TEETH_RAD
        std[groups["friction"]] = self.friction * _FRICTION_RAD
        std[groups["loaded"]] = self.friction * _FRICTION_RAD / _FRICTION_LOAD_NM
        return std


CANDIDATES = [TermSet(*choice) for choice in product(_SLOW_RAD, _RIPPLE_RAD, (False, True))]
_REFERENCE = TermSet(_SLOW_RAD[3], _RIPPLE_RAD[1], True)


@dataclass(frozen=True, eq=False)
class Average:
    """Mean over the candidates by their evidence; the covariance includes their spread."""

    beta: Floats
    covariance: Floats
    noise: float


def noise_of(
    data: Regression, groups: dict[str, slice], spans: list[int], interval_s: float, scale: Scale
) -> float:
    """Noise of the data, rad, from the residual of a rich set of terms."""
    std = _REFERENCE.std(groups, data.columns.shape[1], scale)
    noise, lags = _ARC_SECOND, int(_MEMORY_S / interval_s)
    for _ in range(_ROUNDS):
        fitted = data.estimate(noise, std)
        free = np.sum((data.columns @ fitted.covariance) * data.columns) / noise**2
        noise = low_frequency_noise(data.residual(fitted), spans, lags, float(free))
    return noise


def average(data: Regression, groups: dict[str, slice], noise: float, scale: Scale) -> Average:
    """Fit every candidate and average. Friction in the gear opposes the motion: it is not negative."""
    size = data.columns.shape[1]
    fits = data.estimate(noise, np.array([each.std(groups, size, scale) for each in CANDIDATES]))
    opposing = np.zeros((len(CANDIDATES), size))
    state, loaded = (data.columns[:, groups[name]] for name in ("friction", "loaded"))
    opposing[:, groups["friction"]] = 1.0
    opposing[:, groups["loaded"]] = np.abs(loaded).sum() / max(1e-9, np.abs(state).sum())
    fits = fits.not_negative(opposing * np.array([[each.friction] for each in CANDIDATES]))
    weights = np.exp(-0.5 * (fits.cost - fits.cost.min()))
    weights /= weights.sum()
    mean = weights @ fits.beta
    spread = np.einsum("m,mi,mj->ij", weights, fits.beta - mean, fits.beta - mean)
    within = np.einsum("m,mij->ij", weights, fits.covariance)
    return Average(mean, within + spread, noise)


_REST = 0.02
"""Velocity, in parts of the joint's largest, up to which it rests."""
_CLEAR = 0.25
"""Peak velocity of a clear move, in parts of the joint's largest."""


def over_own_move(v: Floats, fastest: float) -> Floats:
    """Velocity v (N,) over the largest between two rests or reversals, (N,); 0 where the joint rests."""
    rest = _REST * fastest
    size = np.abs(v) * (np.abs(v) > rest)
    begins = np.flatnonzero(np.diff(np.sign(size * v), prepend=np.nan))
    peak = np.maximum.reduceat(np.abs(v), begins).clip(rest)
    return np.asarray(size / np.repeat(peak, np.diff(begins, append=v.size)))


def clear_moves(velocities: list[Floats]) -> int:
    """Number of clear moves in the velocities of a joint, one (N,) of each record."""
    fastest = max(float(np.abs(v).max()) for v in velocities)
    peaks = ((over_own_move(v, fastest) == 1) & (np.abs(v) > _CLEAR * fastest) for v in velocities)
    return sum(int(np.count_nonzero(each)) for each in peaks)
