"""Rules of the verdict that name a cause: friction, delay, wrong inertias, a gear that hardens."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jointid.chosen_model import parameter_names, refit
from jointid.elasticity import identify_elasticity
from jointid.errors import JointIdError
from jointid.evidence import Evidence, Finding, note, percent, problem, relative, warning
from jointid.inertia_check import InertiaCheck, check_inertia
from jointid.joints import Inertia
from jointid.likelihood import LikelihoodEstimate
from jointid.plausibility import low_frequency_inertia
from jointid.poses import fits_by_pose
from jointid.validation import amplitude_dependence, freed_phasors, harmonic_content

_CLEAR = 4.0  # standard errors that are not by chance


def against_the_paper(evidence: Evidence) -> Iterator[Finding]:
    """What the paper's least squares would have said, where it differs by more than chance."""
    fit, paper = evidence.fit, evidence.paper
    if fit.method == paper.method or np.any(fit.K <= 0):
        return
    p, other = np.concatenate([fit.K, fit.D]), np.concatenate([paper.K, paper.D])
    by_noise = paper.standard_error / np.sqrt(max(1.0, paper.misfit))
    error = np.hypot(fit.standard_error, by_noise)
    share = relative(other - p, p)
    clear = (np.abs(other - p) > _CLEAR * error) & (share > 2e-3)
    if not clear.any():
        return
    names = parameter_names(fit.n)
    worst = int(np.argmax(np.where(clear, share, 0.0)))
    high = "high" if other[worst] > p[worst] else "low"
    if fit.friction is not None:
        coulomb = ", ".join(f"{c:.2g}" for c in fit.friction.coulomb)
        title, cause = "Friction matters", f"Coulomb friction is {coulomb} N·m and is allowed for. "
        remedy = "Nothing for the answer. Larger motions, or a superposed constant velocity, reduce it."
    elif fit.delay is not None:
        return  # the rule of the delay says it better
    else:
        title, cause = "Noise biases the paper's estimate", ""
        remedy = "Nothing for the answer: the chosen estimate weighs the noise of angle and torque."
    others = [
        f"{names[k]} {percent(share[k])} too {'high' if other[k] > p[k] else 'low'}"
        for k in np.flatnonzero(clear)
        if k != worst
    ]
    also = f" ({', '.join(others)})" if others else ""
    yield note(
        f"{title}: the paper's estimate of {names[worst]} would be {percent(share[worst])} too {high}",
        f"{cause}Least squares as in the paper gives {other[worst]:.4g}, this fit {p[worst]:.4g} ± "
        f"{fit.standard_error[worst]:.2g}{also}.",
        remedy,
        float(share[worst]),
    )


def torque_lags(evidence: Evidence) -> Iterator[Finding]:
    """The torque acts later, or earlier, than its samples say."""
    fit = evidence.fit
    if fit.delay is None or fit.delay_error is None:
        return
    interval = float(np.median([record.interval_s for record in evidence.records]))
    lag = fit.delay
    if abs(lag) < max(0.01 * interval, _CLEAR * fit.delay_error):
        return
    try:
        without = refit(evidence.phasors, list(evidence.inertias), fit, delay=False).p[: 2 * fit.n]
    except JointIdError:
        without = np.full(2 * fit.n, np.nan)
    p = np.concatenate([fit.K, fit.D])
    share = relative(without - p, p)
    if not np.any(np.abs(without - p) > fit.standard_error):
        return
    worst = int(np.nanargmax(share))
    size = f"{1e3 * abs(lag):.3g} ms" if abs(lag) >= 1e-3 else f"{1e6 * abs(lag):.3g} µs"
    remedy = f"Add {lag:.3g} s to torque_delay_s under [timing] in study.toml, if the drive explains it."
    remedy = half_a_sample(evidence, lag) or remedy
    yield note(
        f"The torque {'lags' if lag > 0 else 'leads'} by {size}",
        f"That is {abs(lag) / interval:.2g} samples, ± {fit.delay_error / interval:.1g}, and is allowed "
        f"for. Without it {parameter_names(fit.n)[worst]} would be {percent(share[worst])} too "
        f"{'high' if without[worst] > p[worst] else 'low'}.",
        remedy,
        float(share[worst]),
    )


def half_a_sample(evidence: Evidence, lag: float) -> str:
    """The remedy when the lag is that of a hold which was not stated, or stated wrongly; else empty."""
    held = [record.torque_hold for record in evidence.records]
    samples = lag / float(np.median([record.interval_s for record in evidence.records]))
    if not any(held) and abs(samples - 0.5) < 0.1:
        return (
            "The torque lags by half a sample: set torque_hold = true, if the controller holds the "
            "torque from one sample to the next."
        )
    if all(held) and abs(samples + 0.5) < 0.1:
        return "The torque leads by half a sample: torque_hold = true seems wrong for these records."
    return ""


def inertias_look_wrong(evidence: Evidence) -> Iterator[Finding]:
    """The records would rather have other inertias, and then leave much less unexplained."""
    fit, names = evidence.fit, parameter_names(evidence.fit.n)
    if np.any(fit.K <= 0) or fit.misfit <= 3:
        return
    guilty = [(pose, check) for pose, check in _inertia_checks(evidence) if _guilty(check)]
    if not guilty:
        yield from _far_off(evidence)
        return
    pose, check = min(guilty, key=lambda item: item[1].misfit_found)
    scale = np.maximum(np.abs(check.given), 1e-3 * np.abs(check.given).max())
    off = np.where(check.significance > _CLEAR, np.abs(check.found - check.given) / scale, 0.0)
    worst = int(np.argmax(off))
    p = np.concatenate([fit.K, fit.D])
    change = relative(check.estimate - p, p)
    where = f" in pose {pose}" if pose else ""
    k = int(np.argmax(change))
    yield warning(
        f"The inertias look wrong{where}",
        f"The records would have {check.names[worst]} = {check.found[worst]:.4g} ± "
        f"{check.standard_error[worst]:.1g} kg·m², given is {check.given[worst]:.4g}. With inertias of "
        f"their own choice the misfit falls from {check.misfit_given:.2g} to {check.misfit_found:.2g}, "
        f"and {names[k]} changes by {percent(change[k])}.",
        "Check M and M2: the pose, the payload, the gear ratios and the motors' data sheets. An error "
        "of the torque constant scales all inertias alike.",
        float(change.max()),
    )


def _far_off(evidence: Evidence) -> Iterator[Finding]:
    """At low frequency the torques are (M + M2) q̈; inertias of another pose or drive show there."""
    fit = evidence.fit
    free = freed_phasors(evidence.phasors, fit)
    if fit.misfit < 100 or distortion(evidence) > 0.02:
        return
    for pose in dict.fromkeys(evidence.poses):
        index, inertia = evidence.of_pose(pose)
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
                f"{element} = {(measured[i, j] + measured[j, i]) / 2:.2g} kg·m² or so; given is "
                f"{given[i, j]:.3g}. The equations leave {np.sqrt(fit.misfit):.2g} times what the noise "
                "explains.",
                "Check M and M2: another pose or drive, a missing payload, wrong gear ratios.",
                float(off[i, j]),
            )


def _inertia_checks(evidence: Evidence) -> list[tuple[str, InertiaCheck]]:
    """Inertias as the records would have them, pose by pose, in the ways that there are to get them."""
    fit, checks = evidence.fit, []
    tried = [freed_phasors(evidence.phasors, fit)]
    if fit.friction is not None or fit.delay is not None:
        tried.append(evidence.phasors)  # wrong inertias may have passed for friction or delay
    for pose in dict.fromkeys(evidence.poses):
        index, inertia = evidence.of_pose(pose)
        for phasors in tried:
            # Inertias that are far off may have driven K and D far off: begin in the band as well.
            middle = np.exp(np.log(phasors.omega[index]).mean())
            stiff = np.diag(inertia.M2) * middle**2
            for K, D in ((fit.K, fit.D), (stiff, 0.1 * stiff / middle)):
                with contextlib.suppress(JointIdError, np.linalg.LinAlgError):
                    checks.append((pose, check_inertia(phasors.select(index), inertia, K, D)))
    rubs = fit.friction is not None or distortion(evidence) > 1e-3
    if rubs and fit.method in ("auto", "maximum-likelihood") and len(set(evidence.poses)) == 1:
        with contextlib.suppress(JointIdError, np.linalg.LinAlgError):
            checks.append((evidence.poses[0], _with_friction(evidence)))
    return checks


def _with_friction(evidence: Evidence) -> InertiaCheck:
    """Inertias and friction in turn, each with the other as found last; one step ahead in the end.

    A wrong inertia bends the friction found with it. In turn, both approach their values
    geometrically, so that two turns tell where this leads.
    """
    phasors, fit, inertia = evidence.phasors, evidence.fit, evidence.inertias[0]
    n = fit.n
    if fit.friction is None:  # refused because the inertias are wrong, perhaps
        delay = fit.delay is not None
        fit = identify_elasticity(
            phasors, inertia, method="maximum-likelihood", friction=True, delay=delay
        )
    free, p = freed_phasors(phasors, fit), np.concatenate([fit.K, fit.D])
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
        p = estimate.p[: 2 * n]
        free = replace(free, q=estimate.phasors.q, tau=estimate.phasors.tau)
        free = replace(free, harmonics=free.z[:, None])
    return replace(
        check,
        given=path[0],
        found=values,
        estimate=p,
        misfit_given=fit.misfit,
        misfit_found=estimate.cost / estimate.expected_cost,
    )


def _guilty(check: InertiaCheck) -> bool:
    """Whether other inertias, clearly other ones, explain what those given do not."""
    off = np.abs(check.found - check.given) / np.maximum(np.abs(check.given), 1e-12)
    clear = np.any((check.significance > _CLEAR) & (off > 0.01))
    left = check.misfit_found / check.misfit_given
    explained = (left < 0.3 and check.misfit_found < 4) or left < 0.05
    return bool(clear and explained and check.misfit_given > 3)


def poses_disagree(evidence: Evidence) -> Iterator[Finding]:
    """K and D do not depend on the pose; when they seem to, something else does."""
    if len(set(evidence.poses)) < 2 or np.any(evidence.fit.K <= 0):
        return
    try:
        fits = fits_by_pose(evidence.phasors, list(evidence.inertias), evidence.poses, evidence.fit)
    except (JointIdError, np.linalg.LinAlgError):
        return
    if len(fits.names) < 2:
        return
    apart = np.where(fits.significance > _CLEAR, fits.spread, 0.0)
    worst = int(np.argmax(apart))
    if apart[worst] < 5e-3 or fits.probability > 1e-4:
        return
    values = ", ".join(
        f"{value:.4g} ± {error:.2g} ({name or 'no pose'})"
        for name, value, error in zip(
            fits.names, fits.estimates[:, worst], fits.standard_error[:, worst], strict=True
        )
    )
    yield warning(
        f"The poses disagree on {parameter_names(evidence.fit.n)[worst]}",
        f"{values}: {percent(fits.spread[worst])} apart, {fits.significance[worst]:.2g} standard "
        "errors.",
        "Check M2 of each pose first. If the inertias are right, the gear hardens: its stiffness then "
        "depends on the load, which depends on the pose.",
        float(apart[worst]),
    )


def depends_on_amplitude(evidence: Evidence) -> Iterator[Finding]:
    """The stiffness changes with the deflection."""
    if np.any(evidence.fit.K <= 0):
        return
    found = amplitude_dependence(evidence.fit)
    clear = (np.abs(found.change) > 5 * found.standard_error) & (np.abs(found.change) > 5e-3)
    for j in np.flatnonzero(clear):
        low, high = found.deflection_rad[j]
        more = found.change[j] > 0
        yield warning(
            f"The stiffness of joint {j + 1} {'rises' if more else 'falls'} with the deflection",
            f"By {percent(found.change[j])} ± {percent(found.standard_error[j])} from {low:.2g} to "
            f"{high:.2g} rad of deflection, seen at frequencies with several amplitudes.",
            "A gear hardens, or friction is not fully allowed for. Measure at the amplitude that the "
            "work needs.",
            float(abs(found.change[j])),
        )


def distortion(evidence: Evidence) -> float:
    """Largest significant odd distortion of a torque."""
    try:
        content = harmonic_content(evidence.phasors)
    except JointIdError:
        return 0.0
    n = evidence.fit.n
    return float(np.where(content.significance > 4, content.odd, 0.0)[:, n:].max())
