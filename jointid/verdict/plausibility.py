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
from jointid.errors import JointIdError
from jointid.estimation.elasticity import identify_elasticity
from jointid.estimation.joint_equations import LARGEST, LEAST
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.verdict.evidence import Finding, number, problem
from jointid.verdict.link_side import link_side_finding
from jointid.verdict.scale_causes import (
    COMMON_FACTORS,
    LARGEST_GEAR_RATIO,
    POSITION_OR_TORQUE_FACTORS,
    diagnose_factor,
)

GOOD = 10.0
"""Misfit above which something is left to be explained."""

_DEGREES = np.pi / 180
_SNAP = 1.35  # a factor this close to a known one is taken for it
_BETTER = 0.1  # share of the misfit that mended data may leave
_FARTHEST = 0.5  # how far from its rough value a ratio is sought, as a logarithm
_GRID = 0.24  # the part of it that is searched first
_FARTHEST_FACTOR = 5e3  # degrees taken for radians twice, and a little more
_MOST_JOINTS = 4  # above, the combinations of hypotheses are too many

_KNOWN = (-1.0, *POSITION_OR_TORQUE_FACTORS, -_DEGREES)
"""Measured over expected ratio of torque to acceleration that a wrong sign or unit makes."""


@dataclass(frozen=True, eq=False)
class _Hypothesis:
    kind: str  # "angle", "torque" or "both" are scaled, or "inertia" (M2 on the arm side)
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
    if misfit is not None and misfit < GOOD:
        return ()
    phasors = replace(  # the linear estimator uses the fundamentals only
        phasors,
        harmonics=phasors.harmonics[:, :1],
        harmonic_covariance=phasors.harmonic_covariance[:, :1],
    )
    as_is = _misfit(phasors, inertias)
    if as_is < GOOD:
        return ()
    bar = _BETTER * min(as_is, _misfit(phasors, inertias, possible=False))
    found = []
    for hypothesis in _hypotheses(phasors, inertias):
        mended = _misfit(*_mend(hypothesis, phasors, inertias))
        if mended < bar:
            found.append((mended, hypothesis))
    if min((mended for mended, _ in found), default=np.inf) > GOOD:
        # At low frequency ratios are seen roughly only, too roughly for a spring to come out.
        rough = [
            *(h for _, h in sorted(found, key=lambda pair: pair[0])[:1]),
            *_sides(phasors, inertias),
        ]
        found = []
        for hypothesis in rough:
            refined = _refined(hypothesis, phasors, inertias)
            mended = _misfit(*_mend(refined, phasors, inertias))
            if mended < bar and _is_possible(refined):
                found.append((mended, refined))
    if min((mended for mended, _ in found), default=np.inf) > GOOD:
        arm = link_side_finding(phasors, inertias)
        if arm:
            return arm
    if not found:
        return ()
    best = min(mended for mended, _ in found)
    chosen = next(h for m, h in found if m <= 2 * max(best, 1.0))
    mended = _misfit(*_mend(chosen, phasors, inertias))
    return (_told(chosen, phasors, as_is, mended, _side(chosen, mended, phasors, inertias)),)


def _is_possible(hypothesis: _Hypothesis) -> bool:
    """Whether every factor can be that of a gear, or of a unit with a gear's beside it."""
    parts = np.abs(np.concatenate([hypothesis.angle, hypothesis.torque]))
    factor = hypothesis.torque / hypothesis.angle
    within = np.all((parts >= 1 / LARGEST_GEAR_RATIO) & (parts <= LARGEST_GEAR_RATIO))
    return bool(
        hypothesis.gear.max() <= LARGEST_GEAR_RATIO
        and (
            within
            or any(np.all(np.abs(np.log(np.abs(factor) / c)) < np.log(30)) for c in COMMON_FACTORS)
            or np.all((np.abs(factor) < _FARTHEST_FACTOR) & (np.abs(factor) > 1 / _FARTHEST_FACTOR))
        )
    )


def _sides(phasors: Phasors, inertias: Sequence[Inertia]) -> list[_Hypothesis]:
    """Torques, positions or both on the other side of the gear, in all joints that look wrong."""
    measured = low_frequency_inertia(phasors, inertias)
    if measured is None:
        return []
    expected = np.mean([np.diag(i.M) + i.M2 for i in inertias], axis=0)
    ratio = np.diag(measured) / np.diag(expected)
    return _on_sides(np.where((ratio > 1 / 2) & (ratio < 2), 1.0, ratio))


def _on_sides(factor: Floats) -> list[_Hypothesis]:
    """What makes these factors between torque and acceleration, if a gear does."""
    one = np.ones(factor.size)
    if np.all(factor == 1):
        return []
    found = [_Hypothesis("torque", one, factor, one), _Hypothesis("angle", 1 / factor, one, one)]
    if np.all(factor > 0):  # a ratio that is applied twice makes no sign
        wrong = np.flatnonzero(factor != 1)[1:]
        for signs in product((1.0, -1.0), repeat=min(wrong.size, _MOST_JOINTS - 1)):
            root = np.sqrt(factor)
            root[wrong[: len(signs)]] *= signs
            found.append(_Hypothesis("both", 1 / root, root, one))
    return found


def _side(chosen: _Hypothesis, mended: float, phasors: Phasors, inertias: Sequence[Inertia]) -> str:
    """Return "torque", "angle" or "both" where the coupling of the joints tells which, else ""."""
    factor = chosen.torque / chosen.angle
    if chosen.kind == "inertia" or np.all(np.abs(factor) == 1) or factor.size == 1:
        return ""
    best: dict[str, float] = {}
    for hypothesis in _on_sides(np.where(np.isclose(factor, 1), 1.0, factor)):
        refined = _refined(hypothesis, phasors, inertias)
        misfit = _misfit(*_mend(refined, phasors, inertias))
        best[refined.kind] = min(misfit, best.get(refined.kind, np.inf))
    first, *others = sorted(best, key=lambda kind: best[kind]) or [""]
    clear = bool(first) and best[first] <= 2 * max(mended, 1.0)
    return first if clear and all(best[o] > 4 * max(best[first], 1.0) for o in others) else ""


def _refined(hypothesis: _Hypothesis, phasors: Phasors, inertias: Sequence[Inertia]) -> _Hypothesis:
    """The gear ratios that explain the data best; at low frequency they are seen roughly only."""
    parts = np.array([hypothesis.angle, hypothesis.torque, hypothesis.gear])
    # A ratio that scales both, angle and torque, is one number.
    free = np.any(np.abs(parts) != 1, axis=0)
    if not free.any():
        return hypothesis

    def scaled(x: Floats) -> _Hypothesis:
        logs = np.log(np.abs(parts[:, free]))
        more = np.where(np.abs(logs) > 0, np.sign(logs) * np.sign(np.abs(logs).sum(axis=0)) * x, 0.0)
        factor = np.ones(parts.shape)
        factor[:, free] = np.exp(more)
        return _Hypothesis(hypothesis.kind, *(parts * factor))

    def cost(x: Floats) -> float:
        if np.any(np.abs(x) > _FARTHEST):
            return 1e3
        return float(min(np.log(max(_misfit(*_mend(scaled(x), phasors, inertias)), 1e-300)), 1e3))

    # Beside the valley of the right ratios lie others, where springs are negative.
    count = int(free.sum())
    axis = np.linspace(-_GRID, _GRID, 17) if count < 3 else np.zeros(1)
    start = np.array(
        min(product(axis, repeat=count), key=lambda x: (cost(np.array(x)), float(np.sum(np.square(x)))))
    )
    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={
            "initial_simplex": np.vstack([start, 0.02 * np.eye(start.size)]),
            "maxfev": 60 * start.size,
            "xatol": 1e-4,
            "fatol": 0.01,
        },
    )
    return scaled(np.asarray(found.x, float))


def _misfit(phasors: Phasors, inertias: Sequence[Inertia], *, possible: bool = True) -> float:
    """Misfit of the springs' equations; infinite when no spring comes out that is possible."""
    try:
        fit = identify_elasticity(phasors, inertias, method="weighted")
    except JointIdError:
        return np.inf
    lossy = -4 * fit.standard_error[fit.n :] < fit.D
    return fit.misfit if not possible or (np.all(fit.K > 0) and lossy.all()) else np.inf


def _mend(
    hypothesis: _Hypothesis, phasors: Phasors, inertias: Sequence[Inertia]
) -> tuple[Phasors, Sequence[Inertia]]:
    mended = phasors.scaled(1 / np.concatenate([hypothesis.angle, hypothesis.torque]))
    if np.all(hypothesis.gear == 1):
        return mended, inertias
    reflected = {
        id(i): Inertia(i.M, i.M2 / np.outer(hypothesis.gear, hypothesis.gear), gravity=i.gravity)
        for i in inertias
    }
    return mended, [reflected[id(i)] for i in inertias]


def _hypotheses(phasors: Phasors, inertias: Sequence[Inertia]) -> Iterator[_Hypothesis]:
    """What to try, the simplest first."""
    n = phasors.n
    one = np.ones(n)
    for factor in (*_KNOWN, *COMMON_FACTORS):
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
    if factor[0] in (-1.0, 1e3, *COMMON_FACTORS):
        return _Hypothesis("torque", one, factor, one)
    return _Hypothesis("angle", 1 / factor, one, one)


def _snapped(ratio: float) -> float:
    for known in (*_KNOWN, *COMMON_FACTORS):
        if ratio * known > 0 and 1 / _SNAP < ratio / known < _SNAP:
            return known
    return float(ratio)


def low_frequency_inertia(phasors: Phasors, inertias: Sequence[Inertia]) -> Floats | None:
    """Return the matrix (n, n) that maps acceleration to torque at ω → 0, as measured; None if too few.

    The springs' share grows with ω²; it is taken off by extrapolation over the lowest frequencies. The
    torque of gravity is subtracted.
    """
    gravity = np.einsum("rij,rj->ri", np.array([i.gravity for i in inertias]), phasors.q)
    tau = phasors.tau - gravity
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
            b = np.concatenate([tau[rows].real, tau[rows].imag])
            inertia = (np.linalg.lstsq(real, b, rcond=None)[0] / size[:, None])[:n].T
            size = np.abs(np.diag(inertia))
            return np.asarray(inertia) if np.all((size > LEAST) & (size < LARGEST)) else None
    return None


def _told(hypothesis: _Hypothesis, phasors: Phasors, as_is: float, mended: float, side: str) -> Finding:
    n = hypothesis.angle.size
    proof = _proof(as_is, mended)
    if hypothesis.kind == "inertia":
        gears = ", ".join(number(value) for value in hypothesis.gear)
        return problem(
            "M2 looks given on the arm side",
            f"With gear ratios of about {gears} it would fit the torques at low frequency. {proof}",
            "Enter M2 as given on the joint side, or divide element ij of M2 in study.toml by the gear "
            "ratios n_i·n_j.",
            float(np.log10(hypothesis.gear.max() ** 2)),
            "edit inertias",
        )
    factor = hypothesis.torque / hypothesis.angle
    wrong = np.flatnonzero(~np.isclose(factor, 1) | ~np.isclose(hypothesis.angle, 1))
    if np.all(np.isclose(np.abs(factor[wrong]), 1)):
        joints = "all joints" if wrong.size == n and n > 1 else f"joint {int(wrong[0]) + 1}"
        what, column = (
            ("position", "theta_m{}_rad") if hypothesis.kind == "angle" else ("torque", "tau_m{}_Nm")
        )
        columns = ", ".join(column.format(int(k) + 1) for k in wrong)
        return problem(
            f"The sign of the {what} of {joints} looks reversed",
            f"At low frequency the torque is −1 times what M and M2 say. {proof}",
            f"Set the direction of the {what} of {joints} to reversed on import, or reverse the sign of "
            f"{columns} in the study's tables: a positive torque then accelerates the motor to positive "
            "positions.",
            1.0,
            "edit mapping",
        )
    return diagnose_factor(
        factor, proof=proof, duration_s=float(phasors.duration_s.max()), good=mended <= GOOD, side=side
    )


def _proof(as_is: float, mended: float) -> str:
    """What mending changes, and whether something else is wrong, too."""
    before = (
        "allow no positive stiffness"
        if np.isinf(as_is)
        else f"leave {number(np.sqrt(as_is), 2)} times what noise explains"
    )
    left = f"{number(np.sqrt(mended), 2)} times what noise explains"
    if mended <= GOOD:
        return f"As they stand, the records {before}; mended, they leave {left} (1 is ideal)."
    return (
        f"As they stand, the records {before}; mended, they still leave {left}, where 1 is ideal: "
        "friction, which this check leaves out, or something else is wrong, too. Mend this first and "
        "look again."
    )
