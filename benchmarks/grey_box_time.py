"""A grey-box fit in the time domain: K, D, friction and, if unknown, inertias of two joints, compiled.

Its best use: the linear part advances exactly (matrix exponential, torque held over the sample) and
friction is set-valued at rest, so the model can be the robot itself; all records in parallel; the
initial state is rest, or follows from the harmonics of a sine record and the friction at hand; the
measured torque moves the model in open loop, so a high-pass filter below the excitation removes the
drift; logarithms of positive parameters, bounds, scaled columns; a second fit weights records by the
residuals of the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit, prange
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.signal import butter

from jointid import Inertia, MotionRecord, Phasors, SineRecord, extract_phasors

AVERAGED = 8
"""This many successive residuals are averaged: they vary slowly, and the Jacobian stays small."""
SKIPPED_PERIODS = 2.5
_FRICTION_UNIT = np.array([0.1, 0.1, 1e-3, 1e-3])


class TimeData(NamedTuple):
    """All records end to end."""

    tau: np.ndarray  # (N, 2)
    theta: np.ndarray  # (N, 2)
    begin: np.ndarray  # (R + 1,)
    filters: np.ndarray  # (R, 2, 6), second-order sections
    skip: np.ndarray  # (R,) samples
    rows: np.ndarray  # (R + 1,), of the residual
    initial: np.ndarray  # (R, 8, 5): state per 1, Fc1, Fc2, Fv1, Fv2
    interval_s: float


class TimeAnswer(NamedTuple):
    p: np.ndarray
    """K1, K2, D1, D2, Fc1, Fc2, Fv1, Fv2, and unless they are known M1, M2, M2_11, M2_22, M2_12."""
    cost: float
    simulations: int


def prepare(records: tuple[SineRecord, ...], inertia: Inertia) -> TimeData:
    """Everything that does not depend on the parameters."""
    states = initial_states(extract_phasors(records, harmonics=31), inertia)
    return _prepared(records, [r.frequency_hz for r in records], states)


def prepare_motions(records: Sequence[MotionRecord], lowest_hz: float) -> TimeData:
    """The same of motions that begin at rest; their excitation begins at ``lowest_hz``."""
    return _prepared(records, [lowest_hz] * len(records), np.zeros((len(records), 8, 5)))


def _prepared(
    records: Sequence[SineRecord | MotionRecord], lowest_hz: Sequence[float], initial: np.ndarray
) -> TimeData:
    interval_s = float(np.diff(records[0].time_s[:2])[0])
    rate = 1 / interval_s
    sizes = [r.time_s.size for r in records]
    skip = np.array([round(SKIPPED_PERIODS * rate / f) for f in lowest_hz])
    kept = [(size - s) // AVERAGED for size, s in zip(sizes, skip, strict=True)]
    sections = [butter(4, 0.5 * f, "highpass", fs=rate, output="sos") for f in lowest_hz]
    return TimeData(
        tau=np.concatenate([r.tau_Nm for r in records]),
        theta=np.concatenate([r.theta_rad for r in records]),
        begin=np.concatenate([[0], np.cumsum(sizes)]),
        filters=np.array(sections),
        skip=skip,
        rows=np.concatenate([[0], np.cumsum(kept)]),
        initial=initial,
        interval_s=interval_s,
    )


def initial_states(phasors: Phasors, inertia: Inertia) -> np.ndarray:
    """State θm, θa, θ̇m, θ̇a at the first sample, linear in friction, (R, 8, 5).

    The arm needs neither K nor D: M2 s²q_a = τ − friction − M s²q, harmonic by harmonic.
    """
    H, n = phasors.harmonics.shape[1], 2
    s = 1j * phasors.omega[:, None] * np.arange(1, H + 1)
    s2 = (s * s)[..., None]
    q, tau = phasors.harmonics[..., :n], phasors.harmonics[..., n:]
    grid = np.exp(2j * np.pi * np.outer(np.arange(1024) / 1024, np.arange(1, H + 1)))
    velocity = np.einsum("th,rhj->rtj", grid, s[..., None] * q).imag
    coulomb = 2j * np.einsum("th,rtj->rhj", grid.conj(), np.sign(velocity)) / 1024
    mobility = np.linalg.inv(inertia.M2)
    parts = [tau - inertia.M * s2 * q]
    for regressor in (coulomb, s[..., None] * q):
        parts += [-regressor * (np.arange(n) == j) for j in range(n)]
    states = np.zeros((q.shape[0], 4 * n, 5))
    for k, torque in enumerate(parts):
        arm = torque @ mobility / s2
        states[:, 2:4, k] = arm.sum(axis=1).imag
        states[:, 6:8, k] = (s[..., None] * arm).sum(axis=1).imag
    states[:, 0:2, 0] = q.sum(axis=1).imag
    states[:, 4:6, 0] = (s[..., None] * q).sum(axis=1).imag
    return states


def fit(data: TimeData, inertia: Inertia, start: np.ndarray) -> TimeAnswer:
    """Fit from one start; with 13 parameters the inertias are free, with eight they are given."""
    count, size = 0, len(start)

    def simulated(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        nonlocal count
        count += len(points)
        return residuals(_values(points), data, inertia, weights)

    # Friction may be zero, which has no logarithm.
    x = np.concatenate([np.log(start[:4]), start[4:8] / _FRICTION_UNIT, np.log(start[8:])])
    lower, upper = x - np.log(1e3), x + np.log(1e3)
    lower[4:8], upper[4:8] = 0.0, 1e3
    amplitude = np.sqrt(
        [(data.theta[b:e] ** 2).mean(axis=0) for b, e in zip(data.begin, data.begin[1:], strict=False)]
    )
    weights = 1 / amplitude
    found = None
    for _ in range(2):

        def jacobian(x: np.ndarray, weights: np.ndarray = weights) -> np.ndarray:
            step = 1e-5
            moved = simulated(np.vstack([x, x + step * np.eye(size)]), weights)
            return ((moved[1:] - moved[0]) / step).T

        found = least_squares(
            lambda x, weights=weights: simulated(x[None], weights)[0],
            np.clip(x, lower + 1e-6, upper - 1e-6),
            jacobian,
            bounds=(lower, upper),
            x_scale="jac",
            xtol=1e-6,
            ftol=1e-6,
            max_nfev=60,
        )
        x = found.x
        left = residuals(_values(x[None]), data, inertia, np.ones_like(weights))[0].reshape(-1, 2)
        pieces = zip(data.rows, data.rows[1:], strict=False)
        weights = 1 / np.sqrt([(left[b:e] ** 2).mean(axis=0) for b, e in pieces])
    assert found is not None
    return TimeAnswer(_values(found.x[None])[0], float(found.cost), count)


def _values(x: np.ndarray) -> np.ndarray:
    return np.concatenate([np.exp(x[:, :4]), x[:, 4:8] * _FRICTION_UNIT, np.exp(x[:, 8:])], axis=1)


def residuals(p: np.ndarray, data: TimeData, inertia: Inertia, weights: np.ndarray) -> np.ndarray:
    """High-passed, averaged, weighted differences of the motor angles, (points, 2 · rows)."""
    masses = [inertia_of(each) if each.size > 8 else inertia for each in p]
    steps = np.array([_step(*each, data.interval_s) for each in zip(p, masses, strict=True)])
    friction = np.concatenate([np.ones((len(p), 1)), p[:, 4:8]], axis=1)
    initial = np.einsum("rsk,pk->prs", data.initial, friction)
    out = np.zeros((len(p), data.rows[-1], 2))
    _simulate(
        steps, np.ascontiguousarray(p[:, 4:6]), initial, data.tau, data.theta, data.begin, data.filters,
        data.skip, data.rows, weights, out,
    )  # fmt: skip
    return out.reshape(len(p), -1)


def inertia_of(p: np.ndarray) -> Inertia:
    """Return the inertias among the parameters."""
    return Inertia(p[8:10], [[p[10], p[12]], [p[12], p[11]]])


def _step(p: np.ndarray, inertia: Inertia, interval_s: float) -> np.ndarray:
    """State and torque to the next state, (8, 10)."""
    K, D, viscous = np.diag(p[:2]), np.diag(p[2:4]), np.diag(p[6:8])
    mass = np.zeros((4, 4))
    mass[:2, :2], mass[2:, 2:] = np.diag(inertia.M), inertia.M2
    forces = np.block([[-K, K, -D - viscous, D], [K, -K, D, -D]])
    extended = np.zeros((10, 10))
    extended[:4, 4:8] = np.eye(4)
    extended[4:8, :8] = np.linalg.solve(mass, forces)
    extended[4:6, 8:] = np.diag(1 / inertia.M)
    return expm(extended * interval_s)[:8]


@njit(cache=True, parallel=True, fastmath=True)
def _simulate(steps, coulomb, initial, tau, theta, begin, filters, skip, rows, weights, out):
    records = begin.size - 1
    for job in prange(len(steps) * records):
        point, r = job // records, job % records
        E = steps[point]
        resist = np.array([1 / E[4, 8], 1 / E[5, 9]])
        x, new = np.empty(10), np.empty(8)
        x[:8] = initial[point, r]
        memory = np.zeros((2, 2, 2))
        total = np.zeros(2)
        origin = x[:2] - theta[begin[r]]
        row, filled = rows[r], 0
        for k in range(begin[r + 1] - begin[r]):
            sample = begin[r] + k
            for j in range(2):
                value = x[j] - theta[sample, j] - origin[j]
                for section in range(2):
                    c = filters[r, section]
                    passed = c[0] * value + memory[j, section, 0]
                    memory[j, section, 0] = c[1] * value - c[4] * passed + memory[j, section, 1]
                    memory[j, section, 1] = c[2] * value - c[5] * passed
                    value = passed
                total[j] += value
            if k < skip[r]:
                total[:] = 0.0
            else:
                filled += 1
                if filled == AVERAGED:
                    if row < rows[r + 1]:
                        for j in range(2):
                            out[point, row, j] = total[j] / AVERAGED * weights[r, j]
                        row += 1
                    total[:] = 0.0
                    filled = 0
            # Friction as it is averaged over the step: sliding, coming to rest, or turning round.
            stand = np.zeros(2, np.bool_)
            for j in range(2):
                x[8 + j] = tau[sample, j]
            for j in range(2):
                velocity, limit = x[4 + j], coulomb[point, j]
                sign = np.sign(velocity)
                free = 0.0
                for i in range(10):
                    free += E[4 + j, i] * x[i]
                needed = resist[j] * free
                rub = sign * limit
                if sign * (needed - rub) <= 0:
                    other = needed - resist[j] * velocity
                    if abs(other) <= limit:
                        rub = needed
                        stand[j] = True
                    else:
                        share = resist[j] * velocity / (rub - other)
                        rub += (1 - share) * (np.sign(other) * limit - rub)
                new[j] = rub
            x[8] -= new[0]
            x[9] -= new[1]
            for i in range(8):
                value = 0.0
                for m in range(10):
                    value += E[i, m] * x[m]
                new[i] = value
            for j in range(2):
                if stand[j]:
                    new[4 + j] = 0.0
            x[:8] = new
