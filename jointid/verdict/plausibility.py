"""Are the units, signs and gear ratios right? Hypotheses about scales, tried by fitting again.

At low frequency the springs drop out and the torques are (M + M2) q̈. A scale that is off shows there as
a factor on a joint. Whether that is what is wrong is then tried: with the scale mended, the springs'
equations must be satisfied far better than without. Data that are right cannot be mended.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.optimize import minimize

from jointid.arrays import Floats
from jointid.elasticity import identify_elasticity
from jointid.errors import JointIdError
from jointid.joints import Inertia
from jointid.phasors import Phasors
from jointid.verdict.evidence import Finding, number, problem

_DEGREES = np.pi / 180
_SNAP = 1.35  # a factor this close to a known one is taken for it
_BETTER = 0.1  # share of the misfit that mended data may leave
_MOST_JOINTS = 4  # above, the combinations of hypotheses are too many

_KNOWN = (
    (-1.0, "sign"),
    (_DEGREES, "degrees"),
    (-_DEGREES, "degrees, and the sign is reversed"),
    (2 * np.pi, "revolutions"),
    (1e3, "torque in mN·m"),
    (1e-3, "angle in mrad"),
)
"""Measured over expected ratio of torque to acceleration, and what makes it."""


@dataclass(frozen=True, eq=False)
class _Hypothesis:
    kind: str  # "angle" or "torque" (scaled by ``factor``), or "inertia" (M2 on the arm side)
    angle: Floats  # angle as logged over true angle, (n,)
    torque: Floats  # torque as logged over true torque, (n,)
    gear: Floats  # by which M2 is divided on both sides, (n,)


def scale_findings(
    phasors: Phasors, inertias: Sequence[Inertia], *, misfit: float | None = None
) -> tuple[Finding, ...]:
    """Find reversed signs, wrong units and gear ratios that were applied twice or not at all.

    Parameters
    ----------
    phasors : Phasors
    inertias : sequence of Inertia
        One per record.
    misfit : float, optional
        Of the answer that was given. When it is small there is nothing to look for.

    Returns
    -------
    tuple of Finding
        At most one, which explains the data best. It needs no estimate to be possible as they stand.
    """
    if misfit is not None and misfit < 10:
        return ()
    as_is = _misfit(phasors, inertias)
    if as_is < 10:
        return ()
    found = []
    for hypothesis in _hypotheses(phasors, inertias):
        mended = _misfit(*_mend(hypothesis, phasors, inertias))
        if mended < _BETTER * as_is:
            found.append((mended, hypothesis))
    if not found:
        return ()
    best = min(mended for mended, _ in found)
    chosen = next(h for m, h in found if m <= 2 * max(best, 1.0))
    if best > 10:
        chosen = _refined(chosen, phasors, inertias)
    return (_told(chosen, as_is, _misfit(*_mend(chosen, phasors, inertias))),)


def _refined(hypothesis: _Hypothesis, phasors: Phasors, inertias: Sequence[Inertia]) -> _Hypothesis:
    """The gear ratios that explain the data best; at low frequency they are seen roughly only."""
    parts = np.array([hypothesis.angle, hypothesis.torque, hypothesis.gear])
    free = np.abs(parts) != 1
    if not free.any():
        return hypothesis

    def scaled(x: Floats) -> _Hypothesis:
        factor = np.ones(free.shape)
        factor[free] = np.exp(x)
        return _Hypothesis(hypothesis.kind, *(parts * factor))

    def cost(x: Floats) -> float:
        return float(min(np.log(_misfit(*_mend(scaled(x), phasors, inertias))), 1e3))

    start = np.zeros(int(free.sum()))
    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={
            "initial_simplex": np.vstack([start, 0.1 * np.eye(start.size)]),
            "maxfev": 60 * start.size,
            "xatol": 1e-4,
            "fatol": 0.01,
        },
    )
    return scaled(np.asarray(found.x, float))


def _misfit(phasors: Phasors, inertias: Sequence[Inertia]) -> float:
    """Misfit of the springs' equations; infinite when no spring comes out."""
    try:
        fit = identify_elasticity(phasors, inertias, method="weighted")
    except JointIdError:
        return np.inf
    lossy = -4 * fit.standard_error[fit.n :] < fit.D
    return fit.misfit if np.all(fit.K > 0) and lossy.all() else np.inf


def _mend(
    hypothesis: _Hypothesis, phasors: Phasors, inertias: Sequence[Inertia]
) -> tuple[Phasors, Sequence[Inertia]]:
    n, scale = phasors.n, 1 / np.concatenate([hypothesis.angle, hypothesis.torque])
    both = np.outer(scale, scale)
    z = phasors.z * scale
    mended = replace(
        phasors,
        q=z[:, :n],
        tau=z[:, n:],
        covariance=phasors.covariance * both,
        harmonics=phasors.harmonics * scale,
        harmonic_covariance=phasors.harmonic_covariance * both,
    )
    if np.all(hypothesis.gear == 1):
        return mended, inertias
    reflected = {
        id(i): Inertia(i.M, i.M2 / np.outer(hypothesis.gear, hypothesis.gear)) for i in inertias
    }
    return mended, [reflected[id(i)] for i in inertias]


def _hypotheses(phasors: Phasors, inertias: Sequence[Inertia]) -> Iterator[_Hypothesis]:
    """What to try, the simplest first."""
    n = phasors.n
    one = np.ones(n)
    for factor, _ in _KNOWN:
        yield _one_kind(np.full(n, factor))
    measured = low_frequency_inertia(phasors, inertias)
    if measured is None or n > _MOST_JOINTS:
        return
    expected = np.mean([np.diag(i.M) + i.M2 for i in inertias], axis=0)
    ratio = np.diag(measured) / np.diag(expected)
    ratio = np.where((ratio > 1 / 2) & (ratio < 2), 1.0, ratio)
    snapped = np.array([_snapped(r) for r in ratio])
    for factors in (snapped, ratio):
        wrong = np.flatnonzero(factors != 1)
        for angles in product((True, False), repeat=wrong.size):
            # Coupling tells apart whether the angle or the torque of a single joint is scaled.
            by_angle = np.isin(np.arange(n), wrong[list(angles)])
            kind = "angle" if by_angle.any() else "torque"
            yield _Hypothesis(
                kind, np.where(by_angle, 1 / factors, 1), np.where(by_angle, 1, factors), one
            )
    for j in range(n):
        for sign_of in ("angle", "torque"):
            flip = np.where(np.arange(n) == j, -1.0, 1.0)
            angle, torque = (flip, one) if sign_of == "angle" else (one, flip)
            yield _Hypothesis(sign_of, angle, torque, one)
    M = np.mean([i.M for i in inertias], axis=0)
    square = (np.diag(expected) - M) / np.where(np.diag(measured) > M, np.diag(measured) - M, np.inf)
    if np.all(square > 4):
        yield _Hypothesis("inertia", one, one, np.sqrt(square))


def _one_kind(factor: Floats) -> _Hypothesis:
    """All joints alike: as torque or as angle, that is the same to the equations."""
    one = np.ones(factor.size)
    if factor[0] in (-1.0, 1e3):
        return _Hypothesis("torque", one, factor, one)
    return _Hypothesis("angle", 1 / factor, one, one)


def _snapped(ratio: float) -> float:
    for known, _ in _KNOWN:
        if ratio * known > 0 and 1 / _SNAP < ratio / known < _SNAP:
            return known
    return float(ratio)


def low_frequency_inertia(phasors: Phasors, inertias: Sequence[Inertia]) -> Floats | None:
    """Return the matrix (n, n) that maps acceleration to torque at ω → 0, as measured; None if too few.

    The springs' share grows with ω²; it is taken off by extrapolation over the lowest frequencies.
    """
    n = phasors.n
    groups = phasors.by_frequency()
    acceleration = -(phasors.omega[:, None] ** 2) * phasors.q
    for frequencies, order in ((3, 1), (2, 1), (1, 0)):
        rows = np.concatenate([group for _, group in groups[:frequencies]])
        if len(groups) < frequencies or rows.size < n * (order + 1):
            continue
        x = (phasors.omega[rows] / phasors.omega[rows].max()) ** 2
        terms = [acceleration[rows] * (x**k)[:, None] for k in range(order + 1)]
        A = np.concatenate(terms, axis=1)
        size = np.linalg.norm(A, axis=0)
        if not np.all(size > 0):
            continue
        real = np.concatenate([(A / size).real, (A / size).imag])
        if np.linalg.cond(real) < 1e4:
            b = np.concatenate([phasors.tau[rows].real, phasors.tau[rows].imag])
            return np.asarray((np.linalg.lstsq(real, b, rcond=None)[0] / size[:, None])[:n].T)
    return None


def _told(hypothesis: _Hypothesis, as_is: float, mended: float) -> Finding:
    n = hypothesis.angle.size
    before = "leave no positive stiffness" if np.isinf(as_is) else f"have a misfit of {number(as_is, 2)}"
    proof = f"As they stand, the records {before}; mended, the misfit is {number(mended, 2)}."
    if hypothesis.kind == "inertia":
        gears = _list(hypothesis.gear)
        return problem(
            "M2 looks given on the arm side",
            f"With gear ratios of about {gears} it would fit the torques at low frequency. {proof}",
            "Reflect M2 to the motors: divide element ij by the gear ratios n_i·n_j.",
            float(np.log10(hypothesis.gear.max() ** 2)),
        )
    factor = hypothesis.torque / hypothesis.angle
    wrong = np.flatnonzero(~np.isclose(factor, 1) | ~np.isclose(hypothesis.angle, 1))
    j = int(wrong[np.argmax(np.abs(np.log(np.abs(factor[wrong]))))])
    joints = "all joints" if wrong.size == n and n > 1 else f"joint {j + 1}"
    numbers = [str(k + 1) for k in wrong]
    columns = ", ".join(f"theta_m{k}_rad" for k in numbers)
    torques = ", ".join(f"tau_m{k}_Nm" for k in numbers)
    name = next((text for known, text in _KNOWN if np.isclose(factor[j], known)), "gear")
    effect = float(abs(np.log10(abs(factor[j])))) + 1
    if name == "sign":
        what = "angle" if hypothesis.kind == "angle" else "torque"
        column = columns if what == "angle" else torques
        return problem(
            f"The sign of the {what} of {joints} looks reversed",
            f"At low frequency the torque is −1 times what the inertias say. {proof}",
            f"Reverse the sign of {column}, so that a positive torque accelerates the motor to "
            "positive angles.",
            effect,
        )
    if name.startswith("degrees"):
        return problem(
            f"The angle of {joints} looks logged in degrees"
            + (", with the sign reversed" if "sign" in name else ""),
            f"Angles are {180 / np.pi:.1f} times what torques and inertias say. {proof}",
            f"Multiply {columns} by π/180.",
            effect,
        )
    if name != "gear":
        quantity = "Divide the torque by 1000" if "torque" in name else "Bring the angle to radians"
        shown = name if "in" in name.split() else f"angle in {name}"
        return problem(
            f"The unit of {joints} looks wrong: {shown}",
            f"Torque over acceleration is {number(factor[j], 4)} times what the inertias say. {proof}",
            f"{quantity} ({torques if 'torque' in name else columns}).",
            effect,
        )
    twice = abs(factor[j]) < 1
    ratios = np.abs(factor[wrong]) ** (-1 if twice else 1)
    reversed_too = " The sign is reversed as well." if factor[j] < 0 else ""
    return problem(
        f"The gear ratio of {joints} looks {'applied twice' if twice else 'not applied'}",
        f"Torque over acceleration is {_list(factor[wrong])} times what the inertias say: gear ratios "
        f"of {_list(ratios)} on angle or torque, or of {_list(np.sqrt(ratios))} on both.{reversed_too} "
        f"{proof}",
        f"Give angles and torques as the motor sees them: {'divide' if twice else 'multiply'} {columns} "
        f"by the ratio, or {'multiply' if twice else 'divide'} {torques} by it. M and M2 are on the "
        "motor side as well.",
        effect,
    )


def _list(values: Floats) -> str:
    return ", ".join(number(value) for value in values)
