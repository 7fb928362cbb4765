"""Rules of the verdict on wrong inertias, which the method takes as known."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jointid.errors import JointIdError
from jointid.estimation.elasticity import identify_elasticity
from jointid.estimation.likelihood import LikelihoodEstimate
from jointid.estimation.parameters import elasticity_labels
from jointid.joints import Inertia
from jointid.rounding import with_error
from jointid.uncertainty.chosen_model import refit
from jointid.uncertainty.validation import compensated_phasors
from jointid.verdict.evidence import Evidence, Finding, number, percent, problem, relative, warning
from jointid.verdict.inertia_check import InertiaCheck, check_inertia
from jointid.verdict.plausibility import low_frequency_inertia
from jointid.verdict.rules_causes import CLEAR, distortion, has_unmodelled_friction


def inertias_look_wrong(evidence: Evidence) -> Iterator[Finding]:
    """Other inertias reduce the residual significantly."""
    fit, names = evidence.fit, elasticity_labels(evidence.fit.n)
    if np.any(fit.K <= 0) or fit.misfit <= 3 or has_unmodelled_friction(evidence):
        return
    wrong = [(pose, check) for pose, check in _inertia_checks(evidence) if _is_wrong(check)]
    if not wrong:
        yield from _far_off(evidence)
        return
    pose, check = min(wrong, key=lambda item: item[1].misfit_found)
    scale = np.maximum(np.abs(check.given), 1e-3 * np.abs(check.given).max())
    off = np.where(check.significance > CLEAR, np.abs(check.found - check.given) / scale, 0.0)
    worst = int(np.argmax(off))
    p = fit.estimate
    change = relative(check.estimate - p, p)
    where = f" in pose {pose}" if pose else ""
    k = int(np.argmax(change))
    found = with_error(float(check.found[worst]), float(check.standard_error[worst]))
    yield warning(
        f"The inertias look wrong{where}",
        f"The records would have {check.names[worst]} = {found} kg·m², given is "
        f"{number(check.given[worst], 4)}. With inertias of their own choice what is left falls from "
        f"{number(np.sqrt(check.misfit_given), 2)} to {number(np.sqrt(check.misfit_found), 2)} times "
        f"what noise explains, and {names[k]} changes by {percent(change[k])}.",
        "Check M and M2: the pose, the payload, the gear ratios and the motors' "
        "data sheets. An error of the torque constant scales all inertias alike.",
        float(change.max()),
        "edit inertias",
    )


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


def _inertia_checks(evidence: Evidence) -> list[tuple[str, InertiaCheck]]:
    """Inertias fitted to the records, by pose, from several start values."""
    fit, checks = evidence.fit, []
    tried = [compensated_phasors(evidence.phasors, fit)]
    if fit.friction is not None or fit.delay is not None:
        tried.append(evidence.phasors)  # wrong inertias may have passed for friction or delay
    for pose in dict.fromkeys(evidence.poses):
        index, inertia = evidence.of_pose(pose)
        for phasors in tried:
            # Wrong inertias may have led to wrong K and D: start with resonances in the band as well.
            middle = np.exp(np.log(phasors.omega[index]).mean())
            stiff = np.diag(inertia.M2) * middle**2
            for K, D in ((fit.K, fit.D), (stiff, 0.1 * stiff / middle)):
                with contextlib.suppress(JointIdError, np.linalg.LinAlgError):
                    checks.append((pose, check_inertia(phasors.select(index), inertia, K, D)))
    friction = fit.friction is not None or distortion(evidence) > 1e-3
    if friction and fit.method in ("auto", "maximum-likelihood") and len(set(evidence.poses)) == 1:
        with contextlib.suppress(JointIdError, np.linalg.LinAlgError):
            checks.append((evidence.poses[0], _with_friction(evidence)))
    return checks


def _with_friction(evidence: Evidence) -> InertiaCheck:
    """Inertias and friction in alternation, each with the last value of the other, extrapolated.

    A wrong inertia biases the friction fitted with it. In alternation both converge geometrically, so
    that two iterations give the limit.
    """
    phasors, fit, inertia = evidence.phasors, evidence.fit, evidence.inertias[0]
    n = fit.n
    if fit.friction is None:  # refused because the inertias are wrong, perhaps
        delay = fit.delay is not None
        fit = identify_elasticity(
            phasors, inertia, method="maximum-likelihood", friction=True, delay=delay
        )
    free, p = compensated_phasors(phasors, fit), fit.estimate
    path = []
    for turn in range(3):
        check = check_inertia(free, inertia, p[:n], p[n:])
        if turn == 0:
            path.append(check.given)
        path.append(check.found)
        values = check.found
        if turn == 1:
            first, second = path[1] - path[0], path[2] - path[1]
            ratio = float(np.clip(np.linalg.norm(second) / np.linalg.norm(first), 0.0, 0.8))
            values = path[2] + second * ratio / (1 - ratio)
        M2 = np.zeros((n, n))
        M2[np.triu_indices(n)] = values[n:]
        inertia = Inertia(values[:n], M2 + np.triu(M2, 1).T)
        start = replace(fit, K=check.estimate[:n], D=check.estimate[n:])
        estimate = refit(phasors, inertia, start)
        if not isinstance(estimate, LikelihoodEstimate):
            raise JointIdError("Friction needs maximum likelihood.")
        p = estimate.elasticity
        free = replace(free, q=estimate.phasors.q, tau=estimate.phasors.tau)
        free = replace(free, harmonics=free.z[:, None])
    return replace(
        check,
        given=path[0],
        found=values,
        estimate=p,
        misfit_given=fit.misfit,
        misfit_found=estimate.misfit,
    )


def _is_wrong(check: InertiaCheck) -> bool:
    """Whether significantly different inertias explain the data and the given ones do not."""
    off = np.abs(check.found - check.given) / np.maximum(np.abs(check.given), 1e-12)
    clear = np.any((check.significance > CLEAR) & (off > 0.01))
    left = check.misfit_found / check.misfit_given
    explained = (left < 0.3 and check.misfit_found < 4) or left < 0.05
    return bool(clear and explained and check.misfit_given > 3)
