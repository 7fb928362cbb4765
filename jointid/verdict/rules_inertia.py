"""Rules of the verdict on the given inertias: wrong, or of other joints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit, identify_elasticity
from jointid.estimation.parameters import elasticity_labels
from jointid.joints import Inertia
from jointid.rounding import plain, significant, with_error
from jointid.uncertainty.chosen_model import refit
from jointid.uncertainty.prior_rows import PriorRow, disagreements, prior_rows
from jointid.uncertainty.validation import compensated_phasors
from jointid.verdict.evidence import Evidence, Finding, number, percent, problem, relative, some, warning
from jointid.verdict.plausibility import low_frequency_inertia
from jointid.verdict.rules_causes import CLEAR, distortion, has_unmodelled_friction

_EXPLAINED = 3.0
"""Misfit up to which other inertias explain the data."""
_LOOSE = 0.3
"""Relative standard deviation with which inertias that are given as exact are fitted for comparison."""

_NEARLY = 0.01
"""The same for the comparison of joints that may be mixed up."""


def inertias_look_wrong(evidence: Evidence) -> Iterator[Finding]:
    """Fitted inertias explain the data and differ from the given ones by more than their uncertainty."""
    fit = evidence.fit
    if np.any(fit.K <= 0) or has_unmodelled_friction(evidence):
        return
    judged = _judged(evidence)
    if judged is None or judged.misfit > _EXPLAINED:
        yield from _far_off(evidence)
        return
    exact = judged is not fit
    rows = [(_significance(row, exact), row) for row in prior_rows(judged, evidence.poses) if row.unit]
    off = sorted((pair for pair in rows if pair[0] > CLEAR), key=lambda pair: -pair[0])
    if not off:
        return
    row = off[0][1]
    given = plain(row.given) + ("" if exact else f" ± {significant(row.given_std, 2)}")
    others = f" So do {some([other.name for _, other in off[1:]])}." if off[1:] else ""
    change = relative(judged.estimate - fit.estimate, fit.estimate)
    k = int(np.argmax(change))
    accounts = "K and D come from the fitted inertias."
    if exact:
        accounts = (
            f"With fitted inertias what is left falls from {number(np.sqrt(fit.misfit), 2)} to "
            f"{number(np.sqrt(judged.misfit), 2)} times what noise explains, and "
            f"{elasticity_labels(fit.n)[k]} changes by {percent(change[k])}."
        )
    yield warning(
        "The inertias look wrong",
        f"{row.name} is given as {given} kg·m², the records have "
        f"{with_error(row.fitted, row.fitted_std)} kg·m².{others} {accounts}",
        "Check M and M2: the pose, the payload, the gear ratios and the motors' data sheets. An error "
        "of the torque constant scales all inertias alike.",
        float(change.max()) if exact else 0.05,
        "edit inertias",
    )


def _judged(evidence: Evidence) -> ElasticityFit | None:
    """The fit with inertias of its own; exact ones that explain the data are not questioned."""
    fit = evidence.fit
    if "M2" in fit.parameters.layout:
        return fit
    if fit.misfit <= _EXPLAINED:
        return None
    try:
        return identify_elasticity(evidence.phasors, list(evidence.inertias), inertia_std=_LOOSE)
    except JointIdError:
        return None


def _significance(row: PriorRow, exact: bool) -> float:
    """Difference of fitted and given value, in standard deviations of what is uncertain."""
    scale = row.fitted_std if exact else row.given_std
    return abs(row.fitted - row.given) / scale if scale > 0 else 0.0


def joints_mixed_up(evidence: Evidence) -> Iterator[Finding]:
    """Inertias or torques of two joints exchanged, or an axis that runs backwards."""
    fit = evidence.fit
    if fit.n == 1 or (fit.misfit <= _EXPLAINED and not np.any(disagreements(fit) > CLEAR)):
        return
    as_given = _misfit(evidence, list(evidence.inertias), np.arange(fit.n))
    tried = []
    for a in range(fit.n):
        for b in range(a + 1, fit.n):
            order = np.arange(fit.n)
            order[[a, b]] = b, a
            swapped = [
                Inertia(i.M[order], i.M2[np.ix_(order, order)], gravity=i.gravity)
                for i in evidence.inertias
            ]
            names = f"joints {a + 1} and {b + 1}"
            tried += [
                (
                    _misfit(evidence, swapped, np.arange(fit.n)),
                    f"The inertias of {names} look exchanged",
                ),
                (
                    _misfit(evidence, list(evidence.inertias), order),
                    f"The torques of {names} look exchanged",
                ),
            ]
    for j in range(fit.n):
        sign = np.where(np.arange(fit.n) == j, -1.0, 1.0)
        mirrored = [
            Inertia(i.M, i.M2 * np.outer(sign, sign), gravity=i.gravity) for i in evidence.inertias
        ]
        title = f"Joint {j + 1} looks reversed against the others"
        tried.append((_misfit(evidence, mirrored, np.arange(fit.n)), title))
    best, title = min(tried)
    if best < 0.1 * as_given and best < 100:
        yield problem(
            title,
            f"As given, the records leave {number(np.sqrt(as_given), 2)} times what noise explains; "
            f"otherwise {number(np.sqrt(best), 2)} times.",
            "Check the order of the joints in M and M2 and of the columns, and the sign of the coupling "
            "inertias: position and torque of a joint may both be reversed.",
            1.0,
            "edit inertias",
        )


def _misfit(evidence: Evidence, inertias: list[Inertia], order: np.ndarray) -> float:
    """Misfit of the chosen friction and delay with other inertias or another order of the torques."""
    phasors, n = evidence.phasors, evidence.fit.n
    columns = np.concatenate([np.arange(n), n + order])
    changed = replace(
        phasors,
        tau=phasors.tau[:, order],
        harmonics=phasors.harmonics[..., columns],
        harmonic_covariance=phasors.harmonic_covariance[..., columns[:, None], columns],
        covariance=phasors.covariance[:, columns[:, None], columns],
    )
    fit = evidence.fit
    try:
        estimate = identify_elasticity(
            changed,
            inertias,
            method="maximum-likelihood",
            friction=fit.friction is not None,
            delay=fit.delay is not None,
            inertia_std=float(np.clip(fit.prior.inertia_std, _NEARLY, _LOOSE)),
        )
    except JointIdError:
        return np.inf
    return estimate.misfit + float(np.square(disagreements(estimate)).sum())


def _far_off(evidence: Evidence) -> Iterator[Finding]:
    """At low frequency the torques are (M + M2) q̈, which shows inertias of another pose or drive."""
    fit = evidence.fit
    free = compensated_phasors(evidence.phasors, fit)
    if fit.misfit < 100 or distortion(evidence) > 0.02:
        return
    for pose in dict.fromkeys(evidence.poses):
        index, inertia = evidence.of_pose(pose)
        if _explained_alone(evidence, index, inertia):
            continue
        measured = low_frequency_inertia(free.select(index), [inertia] * index.size)
        if measured is None:
            continue
        given = np.diag(inertia.M) + inertia.M2
        scale = np.sqrt(np.outer(np.diag(given), np.diag(given)))
        off = np.abs((measured + measured.T) / 2 - given) / scale
        i, j = (int(k) for k in np.unravel_index(np.argmax(off), off.shape))
        if off[i, j] > 0.2:
            element = f"J_m{i + 1} + J_a{i + 1}" if i == j else f"J_{i + 1}{j + 1}"
            where = f" in pose {pose}" if pose else ""
            yield problem(
                f"The inertias look wrong{where}",
                "At low frequency, where the springs drop out, torque over acceleration says "
                f"{element} = {number((measured[i, j] + measured[j, i]) / 2, 2)} kg·m² or so; given is "
                f"{number(given[i, j])}. The equations leave {number(np.sqrt(fit.misfit), 2)} times "
                "what the noise explains.",
                "Check M and M2: another pose or drive, a missing payload, wrong gear ratios.",
                float(off[i, j]),
                "edit inertias",
            )


def _explained_alone(evidence: Evidence, index: np.ndarray, inertia: Inertia) -> bool:
    """Whether some K and D explain one pose by itself."""
    try:
        alone = refit(evidence.phasors.select(index), inertia, evidence.fit)
    except JointIdError:
        return False
    return alone.expected_cost > 0 and alone.cost < 100 * alone.expected_cost
