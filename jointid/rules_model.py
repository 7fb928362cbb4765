"""Rules of the verdict that look at the answer: friction, delay, inertias, poses and precision."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from jointid.arrays import Floats
from jointid.chosen_model import parameter_names, refit
from jointid.errors import JointIdError
from jointid.evidence import Evidence, Finding, note, percent, problem, some, warning
from jointid.inertia_check import InertiaCheck, check_inertia
from jointid.joints import locked_resonances, resonances
from jointid.poses import fits_by_pose
from jointid.validation import amplitude_dependence, freed_phasors, harmonic_content

_CLEAR = 4.0  # standard errors that are not by chance
_GAP = 1.4  # a resonance is covered when a frequency lies within this factor
_LINEAR = ("weighted", "least-squares", "explicit")


def not_physical(evidence: Evidence) -> Iterator[Finding]:
    """A spring that pushes, a damper that drives."""
    fit = evidence.fit
    for j in range(fit.n):
        if fit.K[j] <= 0:
            yield problem(
                f"K{j + 1} is negative",
                f"The estimate is {fit.K[j]:.4g} N·m/rad, which is no spring.",
                f"Check the sign and unit of the torque of joint {j + 1}, the gear ratios, M and M2.",
                2.0,
            )
        elif fit.D[j] < -2 * fit.standard_error[fit.n + j]:
            yield warning(
                f"D{j + 1} is negative",
                f"The estimate is {fit.D[j]:.3g} N·m·s/rad, which would feed energy into the arm.",
                "The torque probably leads or lags: check torque_hold and torque_delay_s.",
                2.0,
            )


def hardly_known(evidence: Evidence) -> Iterator[Finding]:
    """The error bar is so wide that the value says little."""
    fit = evidence.fit
    share = _relative(fit.standard_error, np.concatenate([fit.K, fit.D]))
    limit = np.where(np.arange(2 * fit.n) < fit.n, 0.1, 0.3)
    names = [n for n, s, m in zip(parameter_names(fit.n), share, limit, strict=True) if s > m]
    if names:
        worst = int(np.argmax(share / limit))
        yield warning(
            f"{some(names)} {'is' if len(names) == 1 else 'are'} hardly known",
            f"One standard error of {parameter_names(fit.n)[worst]} is "
            f"{percent(min(share[worst], 10.0))} of its value.",
            "Add records near the resonances, record longer, or move the joints more.",
            float(share.max()),
        )


def model_limits(evidence: Evidence) -> Iterator[Finding]:
    """What is left over is more than the noise explains."""
    fit = evidence.fit
    if fit.misfit <= 3:
        return
    remedy = "Friction, a torque delay or wrong inertias are the usual causes."
    if fit.method in _LINEAR or fit.friction is None:
        distortion = _distortion(evidence)
        if distortion > 1e-3:
            remedy = f"The torque carries odd harmonics of {percent(distortion)}: friction. " + (
                "Use the automatic estimator." if fit.method in _LINEAR else "Check the inertias too."
            )
    elif fit.friction is not None:
        remedy = (
            "Friction is allowed for already. Wrong inertias, a gear that hardens and disturbances "
            "from outside remain."
        )
    share = _relative(fit.standard_error, np.concatenate([fit.K, fit.D])).max()
    yield warning(
        "The model, not the noise, limits the answer",
        f"The equations leave {np.sqrt(fit.misfit):.2g} times what the noise explains. "
        "The error bars are widened by that factor.",
        remedy,
        float(share),
    )


def against_the_paper(evidence: Evidence) -> Iterator[Finding]:
    """What the paper's least squares would have said, where it differs by more than chance."""
    fit, paper = evidence.fit, evidence.paper
    if fit.method == paper.method or np.any(fit.K <= 0):
        return
    p, other = np.concatenate([fit.K, fit.D]), np.concatenate([paper.K, paper.D])
    by_noise = paper.standard_error / np.sqrt(max(1.0, paper.misfit))
    error = np.hypot(fit.standard_error, by_noise)
    share = _relative(other - p, p)
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
    share = _relative(without - p, p)
    if not np.any(np.abs(without - p) > fit.standard_error):
        return
    worst = int(np.nanargmax(share))
    size = f"{1e3 * abs(lag):.3g} ms" if abs(lag) >= 1e-3 else f"{1e6 * abs(lag):.3g} µs"
    remedy = f"Add {lag:.3g} s to torque_delay_s under [timing] in study.toml, if the drive explains it."
    held = [record.torque_hold for record in evidence.records]
    if not any(held) and abs(lag / interval - 0.5) < 0.1:
        remedy = "That is half a sample: set torque_hold = true if the controller holds the torque."
    elif all(held) and abs(lag / interval + 0.5) < 0.1:
        remedy = "That is half a sample: torque_hold = true seems wrong for these records."
    yield note(
        f"The torque {'lags' if lag > 0 else 'leads'} by {size}",
        f"That is {abs(lag) / interval:.2g} samples, ± {fit.delay_error / interval:.1g}, and is allowed "
        f"for. Without it {parameter_names(fit.n)[worst]} would be {percent(share[worst])} too "
        f"{'high' if without[worst] > p[worst] else 'low'}.",
        remedy,
        float(share[worst]),
    )


def inertias_look_wrong(evidence: Evidence) -> Iterator[Finding]:
    """The records would rather have other inertias, and then leave much less unexplained."""
    fit = evidence.fit
    if np.any(fit.K <= 0):
        return
    checks: list[tuple[str, InertiaCheck]] = []
    for pose in dict.fromkeys(evidence.poses):
        index, _ = evidence.of_pose(pose)
        inertias = [evidence.inertias[i] for i in index]
        tried = [freed_phasors(evidence.phasors, fit)]
        if fit.misfit > 3 and (fit.friction is not None or fit.delay is not None):
            tried.append(evidence.phasors)  # wrong inertias may have passed for friction or delay
        for phasors in tried:
            try:
                checks.append((pose, check_inertia(phasors.select(index), inertias, fit.K, fit.D)))
            except (JointIdError, np.linalg.LinAlgError):
                continue
    guilty = [(pose, check) for pose, check in checks if _guilty(check)]
    if not guilty:
        return
    pose, check = min(guilty, key=lambda item: item[1].misfit_found)
    scale = np.maximum(np.abs(check.given), 1e-3 * np.abs(check.given).max())
    off = np.where(check.significance > _CLEAR, np.abs(check.found - check.given) / scale, 0.0)
    worst = int(np.argmax(off))
    change = _relative(check.estimate - np.concatenate([fit.K, fit.D]), np.concatenate([fit.K, fit.D]))
    where = f" in pose {pose}" if pose else ""
    k = int(np.argmax(change))
    yield warning(
        f"The inertias look wrong{where}",
        f"The records would have {check.names[worst]} = {check.found[worst]:.4g} ± "
        f"{check.standard_error[worst]:.1g} kg·m², given is {check.given[worst]:.4g}. With inertias of "
        f"their own choice the misfit falls from {check.misfit_given:.2g} to {check.misfit_found:.2g}, "
        f"and {parameter_names(fit.n)[k]} changes by {percent(change[k])}.",
        "Check M and M2: the pose, the payload, the gear ratios and the motors' data sheets. An error "
        "of the torque constant scales all inertias alike.",
        float(np.nanmax(change)),
    )


def _guilty(check: InertiaCheck) -> bool:
    off = np.abs(check.found - check.given) / np.maximum(np.abs(check.given), 1e-12)
    clear = np.any((check.significance > 5) & (off > 0.01))
    left = check.misfit_found / check.misfit_given
    explained = (left < 0.3 and check.misfit_found < 4) or left < 0.05
    return bool(clear and explained and check.misfit_given > 3)


def resonance_missed(evidence: Evidence) -> Iterator[Finding]:
    """No record near a resonance: there the springs show most."""
    fit = evidence.fit
    if np.any(fit.K <= 0) or np.any(-2 * fit.standard_error[fit.n :] > fit.D):
        return
    share = float(_relative(fit.standard_error, np.concatenate([fit.K, fit.D])).max())
    missed = []
    for pose in dict.fromkeys(evidence.poses):
        index, inertia = evidence.of_pose(pose)
        f = evidence.frequency_hz[index]
        modes = [*locked_resonances(inertia, fit.elasticity), *resonances(inertia, fit.elasticity)]
        missed += [m for m in modes if np.abs(np.log(f / m)).min() > np.log(_GAP)]
    if missed:
        make = warning if share > 0.05 else note
        low, high = evidence.frequency_hz.min(), evidence.frequency_hz.max()
        yield make(
            "The frequencies miss a resonance",
            f"The records span {low:.3g} to {high:.3g} Hz; by the fit there is a resonance at "
            f"{some([f'{m:.3g}' for m in sorted(missed)])} Hz, with no record near it. The largest "
            f"relative standard error is {percent(share)}.",
            f"Add records at about {some([f'{m:.3g}' for m in sorted(missed)])} Hz.",
            share,
        )


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


def _distortion(evidence: Evidence) -> float:
    """Largest significant odd distortion of a torque."""
    try:
        content = harmonic_content(evidence.phasors)
    except JointIdError:
        return 0.0
    n = evidence.fit.n
    return float(np.where(content.significance > 4, content.odd, 0.0)[:, n:].max())


def _relative(change: Floats, p: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.nan_to_num(np.abs(change / p), nan=0.0, posinf=1e3))
