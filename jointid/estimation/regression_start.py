"""Start values by regression: stiffness, friction and payload by the arm's equation.

Equation (8) takes the deflection as a small difference, which friction and a wrong payload bias. Here
the deflection is a small correction of the arm's motion: with the torque s of the springs,

    A (θ − s / (K + sD)) = s,    s = τ − s²Mθ − friction,    A = s²M2 + gravity,

is linear in A and almost linear in 1/K, D/K² and friction (Gauss-Newton).
"""

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.parameters import ParameterLayout, Parameters
from jointid.gears.motor_motion import MotorMotion
from jointid.motion.friction import friction_waveforms
from jointid.phasors.extract import Phasors

_DEGREE = 5
"""Degree of the polynomial in s for the states of motors and arm at the ends of a segment."""
_STEPS, _STEPS_OF_SINES, _NEAR = 8, 20, 0.1
"""Most steps, those of sines with changing weights, and the step in standard errors that ends them."""
_SLOWEST = 2.0
"""Largest D ω/K at the highest frequency."""
_LATEST = 1.0
"""Largest product of a delay and the highest frequency, rad; the smallest delay is 0."""
_RIDGE = 1e-10
"""Added to the normal matrix of unit diagonal."""
_ROUNDING = 1e-9
"""Torque error over the largest torque, for records without noise."""
_LOADED = 0.2
"""Torque over its largest from which a flank is in contact."""
_OUTLIER = 3.0
"""Residual of a sine over the median from which it counts less: motors that others move may stick."""
_HELD = 0.8
"""Share of a segment without clear velocity of a motor from which the motor's torque does not count."""
_EXPLAINED = 2.0
"""Cost that friction explains, over the remaining one, from which friction is fitted."""


def regression_start(
    phasors: Phasors,
    prior: InertiaPrior,
    *,
    backlash: bool = False,
    hangs: bool = False,
    lags: bool = False,
) -> Parameters:
    """The start values alone."""
    return regressed(phasors, prior, backlash=backlash, hangs=hangs, lags=lags)[0]


@np.errstate(all="ignore")  # values that the records do not determine may diverge
def regressed(
    phasors: Phasors,
    prior: InertiaPrior,
    *,
    backlash: bool = False,
    hangs: bool = False,
    lags: bool = False,
) -> tuple[Parameters, float]:
    """K, D, friction if significant and, with a common unknown as the payload, elements of M2.

    ``backlash`` adds that of every gear, which moves the arm from one flank to the other, ``hangs``
    unknown gravity stiffness, ``lags`` a delay of the torque, which is not returned. The second value is
    the misfit of the arm's equation with friction, at least 1. Of sines, outliers count less (Cauchy's
    weights).
    """
    n, shared = prior.n, bool(prior.shared.any())
    known = np.any(phasors.harmonics != 0, axis=2)
    known[~phasors.motion, 1:] = False
    known[~phasors.motion] &= not phasors.motion.any()  # sines may have far less noise
    row, bins = np.nonzero(known)
    s = 1j * phasors.omega[row] * (bins + 1)
    z, s2, one = phasors.harmonics[row, bins], (s * s)[:, None], np.eye(n)
    variance = np.einsum("bcc->bc", phasors.harmonic_covariance[row, bins]).real
    M, pose = prior.M[prior.rotor[row]], prior.pose[row]
    of_torque = variance[:, n:] + np.abs(s2 * M) ** 2 * variance[:, :n]
    friction = friction_waveforms(phasors, None)
    shapes = np.stack([friction.coulomb[row, bins], s[:, None] * z[:, :n]])
    rests = np.stack([np.zeros(n) if each is None else each.share_at_rest for each in phasors.segments])
    held = (friction.stationary | (rests > _HELD))[row]  # by friction of unknown torque
    unit = s / np.abs(s).max()
    ends = 1j * unit[:, None] ** np.arange(_DEGREE + 1) * phasors.motion[row, None]
    edges = np.flatnonzero(np.diff(row)) + 1

    middle = float(np.median(phasors.excited))
    fastest = float(np.abs(s).max())
    flank = _flanks(phasors, prior)[row, bins] if backlash else np.zeros((row.size, n))
    yielding, slow, half, weight = np.zeros((4, n))  # 1/K, D/K, half the backlash, gravity stiffness
    levels, late, payload = np.zeros((2, n)), 0.0, 0.0  # the payload in its standard deviations
    change = s2[..., None] * prior.shared[prior.part[pose]] + prior.shared_gravity[pose]
    for _ in range(_STEPS if phasors.motion.any() else _STEPS_OF_SINES):
        A = s2[..., None] * prior.M2[pose] + prior.gravity[pose] + payload * change + np.diag(weight)
        acting = z[:, n:] * np.exp(-s * late)[:, None]
        drive = acting - s2 * M * z[:, :n] - np.einsum("kbj,kj->bj", shapes, levels)
        lag = 1 + s[:, None] * slow
        C = yielding / lag
        arm = z[:, :n] - C * drive - half * flank / lag
        passed = one + A * C[:, None]
        residual = (A @ arm[..., None])[..., 0] - drive
        size = np.abs(A) ** 2 @ variance[:, :n, None] + np.abs(passed) ** 2 @ of_torque[..., None]
        size += max((_ROUNDING * np.abs(drive).max()) ** 2, np.finfo(float).tiny)
        size = np.where(held[..., None], np.inf, size)
        if not phasors.motion.any():
            square = np.abs(residual[..., None]) ** 2 / size
            typical = np.median(square[~held]) if not held.all() else 0.0
            size = size * (1 + square / (_OUTLIER**2 * max(typical, 1.0)))
        columns = [A * (-(2 * lag - 1) / lag**2 * drive)[:, None]]
        columns += [A * (s[:, None] / lag**2 * drive)[:, None]]
        columns += [passed * waveform[:, None] for waveform in shapes]
        columns += [-A * (flank / lag)[:, None]] * backlash
        columns += [one * arm[:, None]] * hangs
        columns += [passed @ (s[:, None] * acting)[..., None]] * lags
        columns += [change @ arm[..., None]] * shared
        J = np.concatenate([*columns, residual[..., None]], axis=2) / np.sqrt(size)
        normal, rows = np.zeros((J.shape[2],) * 2), 0
        for part, part_ends, part_size in zip(
            *(np.split(x, edges) for x in (J, ends, size[..., 0])), strict=True
        ):
            data = _real(part.swapaxes(0, 1))
            if np.any(part_ends):
                basis, _ = np.linalg.qr(_real(part_ends / np.sqrt(part_size.T)[..., None]))
                data = data - basis @ (basis.swapaxes(1, 2) @ data)
            data = data.reshape(-1, data.shape[2])
            normal, rows = normal + data.T @ data, rows + len(data)
        N, g, misfit = normal[:-1, :-1], normal[:-1, -1], max(normal[-1, -1] / rows, 1.0)
        if shared:
            N[-1, -1] += misfit
            g[-1] += misfit * payload
        count = (4 + backlash + hangs) * n
        step, scale, inverse = _solved(N, g)
        if lags and not 0 <= late + step[count] <= _LATEST / fastest:  # the delay stays
            N[count], N[:, count], g[count] = 0.0, 0.0, 0.0
            step, scale, inverse = _solved(N, g)
        if not np.isfinite(step).all():
            break
        rise, fall, *changes = step[: 4 * n].reshape(4, n)
        half = half + (step[4 * n : 5 * n] if backlash else 0)
        weight = weight + (step[count - n : count] if hangs else 0)
        damped = yielding * slow + fall
        stiffest = yielding + rise
        yielding = np.where(stiffest > 0, stiffest, 0.5 * yielding)
        slow = np.divide(damped, yielding, out=np.zeros(n), where=yielding > 0)
        slow = np.clip(slow, 0.0, _SLOWEST / fastest)
        levels = levels + changes
        late += float(step[count : count + lags].sum())
        payload += float(step[count + lags :].sum())
        if np.abs(step * scale).max() < _NEAR * np.sqrt(misfit):
            break
    own = np.diagonal(prior.M2[prior.pose], axis1=1, axis2=2).mean(axis=0)
    error = np.sqrt(misfit * np.diag(inverse)[:n]) / scale[:n]
    # A joint that rests shows no K, one with a stiff gear at least the inverse of the error.
    unseen = np.maximum(own * middle**2, 1 / np.maximum(error, np.finfo(float).tiny))
    K = np.where(yielding > error, 1 / np.where(yielding > error, yielding, 1.0), unseen)
    own, sizes = slice(2 * n, 4 * n), levels.ravel() * scale[2 * n : 4 * n]
    is_significant = bool(sizes @ np.linalg.solve(inverse[own, own], sizes) > _EXPLAINED * rows)
    values = {"K": K, "D": slow * K}
    values |= {"coulomb": levels[0], "viscous": levels[1]} if is_significant else {}
    values |= {"backlash": 2 * np.maximum(half, 0)} if backlash else {}
    values |= {"gravity": weight} if hangs else {}
    values |= {"M2": prior.lower + payload * prior.common} if shared else {}
    layout = ParameterLayout.of(
        n,
        friction=is_significant,
        effects=["backlash"] * backlash + ["gravity"] * hangs,
        arms=len(prior.lower) if shared else 0,
    )
    return layout.named(layout.pack(**values)), float(np.nan_to_num(misfit, nan=np.inf))


def _solved(N: Floats, g: Floats) -> tuple[Floats, Floats, Floats]:
    """Gauss-Newton step, and the square root of the diagonal of N with the inverse of N over both."""
    scale = np.sqrt(np.maximum(np.diag(N), np.finfo(float).tiny))
    inverse = np.linalg.inv(N / np.outer(scale, scale) + _RIDGE * np.eye(len(N)))
    return -inverse @ (g / scale) / scale, scale, inverse


def _flanks(phasors: Phasors, prior: InertiaPrior) -> Complexes:
    """Bins of the flank in contact, 1 or -1, by the torque; between flanks it changes uniformly."""
    motors = MotorMotion.of(phasors.segments, prior.pose, loops=False)
    if motors is None:
        return np.zeros((*phasors.harmonics.shape[:2], prior.n), complex)
    none = np.zeros(prior.n)
    torque = motors.balance(np.ones(prior.n), prior.M[0], none, none)
    for own in torque:
        loaded = np.flatnonzero(np.abs(own) > _LOADED * np.abs(own).max())
        own[:] = np.interp(np.arange(own.size), loaded, np.sign(own[loaded]))
    return motors.bins(torque, phasors.harmonics.shape[:2])


def _real(values: Complexes) -> Floats:
    """Complex (..., b, k) as real rows (..., 2b, k)."""
    return np.concatenate([values.real, values.imag], axis=-2)
