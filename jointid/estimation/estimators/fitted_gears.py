"""Gears as fitted: their linear dynamic stiffness, and the laws that are significant at each joint."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.parameters import CHANGES, EFFECTS, Parameters
from jointid.estimation.estimators.problem import Problem
from jointid.gears.gear import Gear
from jointid.gears.torsion_curve import TorsionCurve

_SIGNIFICANT = 3.5
"""Standard errors from which a joint has a law that is fitted to all joints."""
_UNSEEN = 1.01
"""Largest torque of the records over that of their curves from which the curves lack a motion."""
_REACHED = 0.98
"""Torque at a change of slope, over the largest, from which no record shows the slope beyond."""
_GEAR_FIELDS = {
    "cubic": ("cubic", "cubic"),
    "backlash": ("backlash_rad", "backlash"),
    "hysteresis": ("hysteresis_Nm", "hysteresis"),
    "presliding": ("presliding_rad", "hysteresis"),
    "loss_factor": ("loss_factor", "loss_factor"),
}
"""Field of ``Gear`` for each parameter, and the parameter that shows whether the law is present."""


def gear_slopes(problem: Problem, p: Parameters) -> dict[str, Complexes]:
    """Derivatives of the gears' linear dynamic stiffness by its parameters, each shape (r, H, n)."""
    s, layout = problem.s[..., None], problem.layout
    K = np.ones((*problem.s.shape, problem.n), complex)
    slopes = {"K": K, "D": s * K}
    if "loss_factor" in layout:
        loss = _loss_stiffness(problem) * K
        slopes["K"], slopes["loss_factor"] = K + p["loss_factor"] * loss, p.K * loss
    for change, of, unit in zip(CHANGES, "KD", (K, s * K), strict=True):
        for name, share in zip(EFFECTS[change].parameters, problem.progress.T, strict=True):
            if name in layout:
                slope = share[:, None, None] * unit
                slopes[of], slopes[name] = slopes[of] + p[name] * slope, p[of] * slope
    return slopes


def _loss_stiffness(problem: Problem) -> Complexes:
    """Dynamic stiffness over K of a loss factor of 1, shape (r, H, 1).

    A loss that does not depend on frequency comes with a stiffness that rises with its logarithm, or
    it would act before its cause (Kjartansson, Journal of Geophysical Research 84, 1979). K is the
    stiffness at the geometric mean frequency of the records.
    """
    s = problem.s
    reference = np.exp(np.log(np.abs(s[problem.known & problem.main[problem.group]])).mean())
    return np.asarray(1j + 2 / np.pi * np.log(np.abs(s) / reference))[..., None]


def fitted_gears(p: Parameters, covariance: Floats, curves: Sequence[TorsionCurve]) -> tuple[Gear, ...]:
    """Gears of n joints with the laws that are significant at each, from their torsion curves' range.

    ``covariance``, shape (P, P), is that of the parameters.
    """
    error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    found = {}
    for name, (target, judge) in _GEAR_FIELDS.items():
        if name in p.layout:
            clear = np.abs(p[judge]) > _SIGNIFICANT * error[p.layout[judge]]
            if EFFECTS[judge].positive:
                clear &= p[judge] > 0
            found[target] = np.where(clear, p[name], 0.0).tolist()
    if "piecewise" in p.layout:
        found |= _slopes(p, covariance, np.array([_largest(curve) for curve in curves]))
    gears = []
    for j, curve in enumerate(curves):
        gear = Gear(K=max(float(p.K[j]), 0.0), **{field: values[j] for field, values in found.items()})
        seen_rad, seen_Nm = (
            float(amplitude.max(initial=0.0)) for amplitude in (curve.amplitude_rad, curve.amplitude_Nm)
        )
        tried_rad, tried_Nm = seen_rad, _largest(curve)
        if tried_Nm > _UNSEEN * seen_Nm and gear.K > 0:  # motions below the curve's lines: by the law
            tried_rad = max(seen_rad, float(gear.deflection(tried_Nm)))
        gears.append(replace(gear, tried_rad=tried_rad, tried_Nm=tried_Nm))
    return tuple(gears)


def _largest(curve: TorsionCurve) -> float:
    """Largest torque of the records, N·m."""
    return max(float(curve.amplitude_Nm.max(initial=0.0)), curve.largest_Nm)


def _slopes(p: Parameters, covariance: Floats, largest: Floats) -> dict[str, list[float]]:
    """Three slopes and torques as in catalogues; zero at joints without a significant change.

    A slope that no torque up to the ``largest``, shape (n,), reaches is that before.
    """
    first, last = (np.arange(p.vector.size)[p.layout[bend]] for bend in ("piecewise", "second_bend"))
    bends, variance = p.vector[[first, last]], np.diag(covariance)[[first, last]]
    change = np.vstack([bends, bends.sum(axis=0)])  # each may be uncertain, and not their sum
    doubt = np.vstack([variance, variance.sum(axis=0) + 2 * covariance[first, last]])
    clear = np.any(change**2 > _SIGNIFICANT**2 * np.maximum(doubt, 0), axis=0)
    K2, T1 = p.K + bends[0], p.K * p["knee"]
    K3, T2 = K2 + bends[1], T1 + K2 * p["second_knee"]
    seen = np.isfinite(variance[1]) & (_REACHED * largest > T2)
    K3, T2 = np.where(seen, K3, K2), np.where(seen, T2, T1)
    found = {"K2": K2, "K3": K3, "T1_Nm": T1, "T2_Nm": T2}
    return {name: np.where(clear, values, 0.0).tolist() for name, values in found.items()}
