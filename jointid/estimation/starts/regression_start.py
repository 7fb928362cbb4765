"""Start values by regression: stiffness, friction and payload by the arm's equation (Gauss-Newton).

Equation (8) takes the deflection as a small difference, which friction and a wrong payload bias. In the
arm's equation the deflection is a small correction of the motion.
"""

import numpy as np

from jointid.arrays import Floats
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.parameters import ParameterLayout, Parameters
from jointid.estimation.starts.arm_equations import ArmEquations, ArmValues
from jointid.phasors.extract import Phasors

_STEPS, _STEPS_OF_SINES, _NEAR = 8, 20, 0.1
"""Most steps, those of sines with changing weights, and the step in standard errors that ends them."""
_STEPS_OF_HELD, _DAMPED = 40, 1e-3
"""Most steps of sines with held joints, and the damping over the diagonal of the normal matrix after a
step that was worse (Levenberg and Marquardt)."""
_LATEST = 1.0
"""Largest product of a delay and the highest frequency, rad; the smallest delay is 0."""
_RIDGE = 1e-10
"""Added to the normal matrix of unit diagonal."""
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
    stiff: float | None = None,
) -> tuple[Parameters, float]:
    """K, D, friction if significant and, with a common unknown as the payload, elements of M2.

    ``backlash`` adds that of every gear, which moves the arm from one flank to the other, ``hangs``
    unknown gravity stiffness, ``lags`` a delay of the torque, which is not returned. The second value is
    the misfit of the arm's equation with friction, at least 1. Of sines, outliers count less (Cauchy's
    weights). With ``stiff``, the unknown torques through gears of joints that friction holds in sines
    are eliminated; gears that the records hardly show are then the stiffer, the larger it is.
    """
    n, shared = prior.n, bool(prior.shared.any())
    equations = ArmEquations.of(
        phasors, prior, backlash=backlash, hangs=hangs, lags=lags, eliminates=stiff is not None
    )
    own = np.diagonal(prior.M2[prior.pose], axis1=1, axis2=2).mean(axis=0)
    middle, fastest = float(np.median(phasors.excited)), float(np.abs(equations.s).max())
    at, damping, holds = ArmValues.zero(n), 0.0, stiff is not None
    best: tuple[float, ArmValues, Floats, Floats] | None = None
    steps = _STEPS if phasors.motion.any() else _STEPS_OF_HELD if holds else _STEPS_OF_SINES
    for _ in range(steps):
        N, g, squares, rows = equations.normal(at)
        misfit = max(squares / rows, 1.0)
        if stiff:
            weight = misfit * (stiff * own * middle**2) ** 2
            N[range(n), range(n)] += weight
            g[:n] += weight * at.yielding
            misfit += float(weight @ at.yielding**2) / rows
        if shared:
            N[-1, -1] += misfit
            g[-1] += misfit * at.payload
        damping *= 0.1
        if holds and best and not misfit <= best[0]:
            damping = max(100 * damping, _DAMPED)
            misfit, at, N, g = best
        best = misfit, at, N, g
        step, scale, inverse = _solved(N, g, damping)
        place = (4 + backlash + hangs) * n
        if lags and not 0 <= at.late + step[place] <= _LATEST / fastest:  # the delay stays
            N[place], N[:, place], g[place] = 0.0, 0.0, 0.0
            step, scale, inverse = _solved(N, g, damping)
        if not np.isfinite(step).all():
            break
        at = at.after(step, fastest, backlash=backlash, hangs=hangs, lags=lags)
        if damping < _DAMPED and np.abs(step * scale).max() < _NEAR * np.sqrt(misfit):
            break
    error = np.sqrt(misfit * np.diag(inverse)[:n]) / scale[:n]
    # A joint that rests shows no K, one with a stiff gear at least the inverse of the error.
    unseen = np.maximum(own * middle**2, 1 / np.maximum(error, np.finfo(float).tiny))
    K = np.where(at.yielding > error, 1 / np.where(at.yielding > error, at.yielding, 1.0), unseen)
    part, sizes = slice(2 * n, 4 * n), at.levels.ravel() * scale[2 * n : 4 * n]
    is_significant = bool(sizes @ np.linalg.solve(inverse[part, part], sizes) > _EXPLAINED * rows)
    values = {"K": K, "D": at.slow * K}
    values |= {"coulomb": at.levels[0], "viscous": at.levels[1]} if is_significant else {}
    values |= {"backlash": 2 * np.maximum(at.half, 0)} if backlash else {}
    values |= {"gravity": at.weight} if hangs else {}
    values |= {"M2": prior.lower + at.payload * prior.common} if shared else {}
    layout = ParameterLayout.of(
        n,
        friction=is_significant,
        effects=["backlash"] * backlash + ["gravity"] * hangs,
        arms=len(prior.lower) if shared else 0,
    )
    return layout.named(layout.pack(**values)), float(np.nan_to_num(misfit, nan=np.inf))


def _solved(N: Floats, g: Floats, damping: float) -> tuple[Floats, Floats, Floats]:
    """Damped step, and the square root of the diagonal of N with the inverse of N over both."""
    scale = np.sqrt(np.maximum(np.diag(N), np.finfo(float).tiny))
    normal, one = N / np.outer(scale, scale), np.eye(len(N))
    inverse = np.linalg.inv(normal + (_RIDGE + damping) * one)
    step = -inverse @ (g / scale) / scale
    return step, scale, inverse if damping == 0 else np.linalg.inv(normal + _RIDGE * one)
