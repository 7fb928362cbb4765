"""Rule of the verdict on a single record that contradicts all others.

Wrong inertias, friction and wrong units of all records are in every record. Here the others fit well
without a single record. Its error follows from the torques that K and D of the others predict for its
angles: a factor on angle or torque that corrects the record.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit, identify_elasticity
from jointid.estimation.joint_equations import spring_equations
from jointid.joints import Inertia, dynamic_arm_inertia, motor_impedance
from jointid.phasors.extract import Phasors
from jointid.verdict.evidence import Evidence, Finding, number, problem

_SUSPECTS = 8
"""Number of records left out one at a time: those with a stiffness furthest from the median."""

_LEFT = 0.02
"""Largest share of the misfit without the record; by noise alone, one record changes little."""

_OTHERS_LEFT = 0.2
"""Smallest share of the misfit without another record: one record is wrong, not a part of the band."""

_FEWEST = 4
"""Fewest other records, so that they can contradict each other as well."""

_TOLERANCE = 0.15
"""Relative difference within which a factor counts as a known one, or as 1."""

_DEGREES = np.pi / 180
_KNOWN = (
    (_DEGREES, "angle", "looks logged in degrees", "Multiply {} by π/180 in this record."),
    (-_DEGREES, "angle", "looks logged in degrees, with the sign reversed", "Multiply {} by −π/180."),
    (-1.0, "torque", "looks reversed in sign", "Reverse the sign of {} in this record."),
    (1e3, "torque", "looks logged in mN·m", "Divide {} by 1000 in this record."),
    (1e-3, "angle", "looks logged in mrad", "Divide {} by 1000 in this record."),
    (2 * np.pi, "angle", "looks logged in revolutions", "Multiply {} by 2π in this record."),
)
"""Torque over angle, measured over expected; signal, description and remedy."""

_LEAVE_OUT = "untick its run on import, or take its [[records]] out of study.toml"


@dataclass(frozen=True, eq=False)
class Outlier:
    """One record that contradicts the others."""

    record: int
    misfit_with: float
    """Cost over its expected value with all records; infinite for unphysical K."""
    misfit_without: float
    """The same without the record."""
    stiffness: Floats
    """Magnitude of its own dynamic stiffness over that of the others, (n,)."""
    factor: Floats | None
    """Torque over angle of each joint, measured over expected, (n,); None when no factor mends it."""
    by_angle: bool
    """Whether the factor is on the angles rather than on the torques."""


def one_record_off(evidence: Evidence, found: Outlier) -> Finding:
    """Finding on the record that contradicts the others, and the factor that corrects it."""
    label, n = evidence.phasors.labels[found.record], evidence.fit.n
    k = int(np.argmax(np.abs(np.log(np.maximum(found.stiffness, 1e-12)))))
    before = (
        "no positive stiffness comes out"
        if np.isinf(found.misfit_with)
        else f"the equations leave {number(np.sqrt(found.misfit_with), 2)} times what noise explains"
    )
    detail = (
        f"With it, {before}; without it, the other {evidence.phasors.omega.size - 1} records leave "
        f"{number(np.sqrt(found.misfit_without), 2)} times what noise explains. Its own dynamic "
        f"stiffness of joint {k + 1} is {number(float(found.stiffness[k]), 2)} times that of the "
        "others. "
    )
    title, cause, remedy = _told(found, label, n)
    return problem(title, detail + cause, remedy, 10.0, "edit runs")


def find_outlier(
    phasors: Phasors, inertias: list[Inertia], fit: ElasticityFit | None = None
) -> Outlier | None:
    """Find the record that contradicts the others; None unless there is exactly one.

    Parameters
    ----------
    phasors : Phasors
    inertias : list of Inertia
        One per record.
    fit : ElasticityFit, optional
        The answer. With a small misfit there is no search.
    """
    count, n = phasors.omega.size, phasors.n
    sound = fit is not None and bool(np.all(fit.K > 0)) and fit.misfit < 10
    if sound or count - 1 < max(_FEWEST, n + 1):
        return None
    as_is = _fitted(phasors, inertias)
    with_it = np.inf if as_is is None else as_is.misfit
    if with_it < 10:
        return None
    stiffness = np.abs(spring_equations(phasors, inertias).stiffness)
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.abs(np.log(stiffness / np.median(stiffness, axis=0)))
    order = np.argsort(-np.nan_to_num(apart, nan=50.0, posinf=50.0).max(axis=1))[:_SUSPECTS]
    fits = {int(i): _fitted(*_without(phasors, inertias, int(i))) for i in order}
    misfit = {i: np.inf if each is None else each.misfit for i, each in fits.items()}
    first, *others = sorted(misfit, key=lambda i: misfit[i])
    left = misfit[first]
    reference = with_it if np.isfinite(with_it) else _infinite_as(phasors, inertias)
    if not left < _LEFT * reference or any(misfit[i] < _OTHERS_LEFT * reference for i in others):
        return None
    best = fits[first]
    if best is None:
        return None
    factor, by_angle = _factor(phasors, inertias[first], best, first)
    if factor is not None:
        mended = _fitted(_mended(phasors, first, factor, by_angle), inertias)
        if mended is None or mended.misfit > max(3 * left, 0.1 * _LEFT * reference):
            factor = None
    if factor is None and not left < 10:
        return None  # the others do not fit either
    own = spring_equations(phasors, inertias).stiffness[first]
    expected = np.abs(best.K + 1j * phasors.omega[first] * best.D)
    return Outlier(first, with_it, left, np.abs(own) / expected, factor, by_angle)


def _told(found: Outlier, label: str, n: int) -> tuple[str, str, str]:
    """Title, cause and remedy."""
    if found.factor is None:
        return (
            f"{label} contradicts all other records",
            "No factor on its angles or torques mends it.",
            f"Check the columns, the pose and the load of {label}, or leave it out: {_LEAVE_OUT}.",
        )
    wrong = np.flatnonzero(~np.isclose(found.factor, 1))
    signal = "angle" if found.by_angle else "torque"
    names = ", ".join(f"theta_m{j + 1}_rad" if found.by_angle else f"tau_m{j + 1}_Nm" for j in wrong)
    joints = "" if wrong.size == n else " of joint " + " and ".join(str(j + 1) for j in wrong)
    factor = float(found.factor[wrong[0]])
    scale = 1 / factor if found.by_angle else factor
    cause = f"Its {signal}s{joints} are {number(scale)} times what the other records say."
    for known, usual, looks, remedy in _KNOWN:
        if np.allclose(found.factor[wrong], known) and (known == -1 or usual == signal):
            return f"The {signal}{joints} in {label} {looks}", cause, remedy.format(names)
    return (
        f"The {signal}{joints} in {label} has another scale than in all other records",
        cause,
        f"Check the gear ratio, the unit and the sign of {names} in {label}, or leave the record out: "
        f"{_LEAVE_OUT}.",
    )


def _factor(
    phasors: Phasors, inertia: Inertia, fit: ElasticityFit, i: int
) -> tuple[Floats | None, bool]:
    """Real factors of each joint that make a record agree with K and D of the others."""
    s = np.asarray(1j * phasors.omega[i : i + 1], np.complex128)
    arm = np.asarray(np.linalg.inv(dynamic_arm_inertia(s.imag, inertia)), np.float64)
    Z = motor_impedance(s, inertia.M, arm, fit.K, fit.D)[0][0]
    q, tau = phasors.q[i], phasors.tau[i]
    # One factor for all joints does not separate angle from torque: the usual signal is assumed.
    predicted = Z @ q
    if np.linalg.norm(predicted) > 0:
        whole = np.vdot(predicted, tau) / np.vdot(predicted, predicted)
        rest = np.linalg.norm(tau - whole * predicted) / np.linalg.norm(tau)
        if rest < _TOLERANCE and _is_real(np.array([whole])):
            value = _snapped(float(whole.real))
            return np.full(q.size, value), _usual_on_angle(value)
    with np.errstate(divide="ignore", invalid="ignore"):
        of_torque = tau / predicted
        try:
            of_angle = np.linalg.solve(Z * q, tau)  # true over logged angle
        except np.linalg.LinAlgError:
            of_angle = np.full(q.size, np.nan + 0j)
    possible = []
    for factors, by_angle in ((of_angle, True), (of_torque, False)):
        if np.isfinite(factors).all() and _is_real(factors):
            values = np.array([_snapped(float(f)) for f in factors.real])
            if np.any(values == 1) and np.any(values != 1):
                possible.append((values, by_angle))
    for values, by_angle in possible:  # joints that do not couple leave both possible
        if _usual_on_angle(float(values[values != 1][0])) == by_angle:
            return values, by_angle
    return possible[0] if possible else (None, True)


def _is_real(factors: Complexes) -> bool:
    return bool(np.all(np.abs(factors.imag) < _TOLERANCE * np.abs(factors)))


def _snapped(factor: float) -> float:
    for known in (1.0, *(known for known, *_ in _KNOWN)):
        if abs(factor / known - 1) < _TOLERANCE:
            return known
    return factor


def _usual_on_angle(factor: float) -> bool:
    return next((signal for known, signal, *_ in _KNOWN if known == factor), "angle") == "angle"


def _mended(phasors: Phasors, i: int, factor: Floats, by_angle: bool) -> Phasors:
    """The phasors with one record divided by the factor."""
    n = phasors.n
    scale = np.ones((phasors.omega.size, 2 * n))
    scale[i] = np.r_[factor, np.ones(n)] if by_angle else np.r_[np.ones(n), 1 / factor]
    return phasors.scaled(scale)


def _without(phasors: Phasors, inertias: list[Inertia], i: int) -> tuple[Phasors, list[Inertia]]:
    rest = [k for k in range(phasors.omega.size) if k != i]
    return phasors.select(rest), [inertias[k] for k in rest]


def _fitted(phasors: Phasors, inertias: list[Inertia]) -> ElasticityFit | None:
    """The linear fit; None when it is unphysical."""
    try:
        fit = identify_elasticity(phasors, inertias, method="weighted")
    except JointIdError:
        return None
    lossy = -4 * fit.standard_error[fit.n :] < fit.D
    return fit if np.all(fit.K > 0) and lossy.all() else None


def _infinite_as(phasors: Phasors, inertias: list[Inertia]) -> float:
    """Misfit assigned to unphysical fits; without any fit, larger than any other."""
    try:
        return max(identify_elasticity(phasors, inertias, method="weighted").misfit, 500.0)
    except JointIdError:
        return 1e6
