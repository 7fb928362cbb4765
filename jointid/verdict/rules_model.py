"""Rules of the verdict on the answer: whether it is physical, precise, and limited by noise."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.special import fdtrc

from jointid.answer import fitted_parts
from jointid.estimation.elasticity import ElasticityFit, undetermined
from jointid.estimation.estimators.linear_fit import LINEAR
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.estimation.model_average import USUAL_LINK
from jointid.joints import locked_resonances, resonances
from jointid.verdict.evidence import (
    Change,
    Evidence,
    Finding,
    note,
    number,
    problem,
    relative,
    some,
    times_noise,
    warning,
)
from jointid.verdict.rules_causes import distortion, even_harmonics, half_a_sample, weights
from jointid.wording import counted, enumerated, percent

EXPLAINED = 3.0
"""Misfit up to which noise explains the data."""
MODEL_LIMITS = "The model, not the noise, limits the answer"
_CHANCE = 3e-4
"""Probability that noise alone leaves as much at the fundamentals."""
_ROUNDING = 0.3
"""Relative standard deviation of the noise of an encoder's steps within the band of a motion: with 2¹²
to 2¹⁴ counts it was 0.8 to 1.7 times that of white noise."""
_MUCH, _CONTRADICTED = 0.02, 20.0
"""Residual over the torque, and this times the misfit, from which an answer is not usable."""
_EVEN = 0.02
"""Even distortion of a torque from which a gear is loaded on one side: 0.004 by noise and friction."""
_COMPARABLE = 0.4
"""Constant velocity over that of a sine from which the joint reverses slowly, as long as it does."""
_NEGLIGIBLE_K, _NEGLIGIBLE_D = 1e-4, 1e-3
"""Relative changes of K and D that are negligible in any application."""
_ODD = 5.0
"""Misfit of one record over that of every other from which it is named."""
_LOWEST = 0.1
"""Lowest suggested frequency over the lowest of the records."""
_GAP = 1.4
"""Largest ratio of a resonance to a frequency that covers it."""
_SEEN, _CERTAIN = 2.0, 4.0
"""Standard errors below zero from which a damping is probably negative, and certainly negative."""
_FINE, _FINEST = 0.01, 0.001
"""Relative standard errors of K and D: the first needs no further frequency."""


def not_physical(evidence: Evidence) -> Iterator[Finding]:
    """Negative stiffness or damping."""
    fit = evidence.fit
    for j in range(fit.n):
        if fit.K[j] <= 0:
            yield problem(
                f"K{j + 1} is negative",
                f"The estimate is {number(fit.K[j], 4)} N·m/rad; a stiffness must be positive.",
                f"Check the sign and unit of the torque of joint {j + 1}, the gear ratios, M and M2.",
                2.0,
                "edit mapping",
            )
        elif fit.D[j] < -_SEEN * fit.errors.D[j]:
            level = problem if fit.D[j] < -_CERTAIN * fit.errors.D[j] else warning
            yield level(
                f"D{j + 1} is negative",
                f"The estimate is {number(fit.D[j])} N·m·s/rad; damping must not be negative.",
                "The torque probably leads or lags. Check its hold and delay on import, or torque_hold "
                "and torque_delay_s in study.toml.",
                2.0,
                "edit mapping",
            )


def link_in_series(evidence: Evidence) -> Iterator[Finding]:
    """Joints without coupling, where gear and link are one spring to the motor."""
    fit, M2 = evidence.fit, evidence.inertias[0].M2
    arm = np.diag(M2)
    softer = fit.K * fit.prior.link_std(fit.K, USUAL_LINK) / arm**2
    alone = np.count_nonzero(M2, axis=1) == 1
    for j in np.flatnonzero(alone & (softer * fit.K > fit.standard_error[: fit.n])).tolist():
        yield note(
            f"K{j + 1} is the stiffness of gear and link in series",
            "Records of a joint without inertial coupling cannot show a flexible link. A typical one, "
            f"with a mode at ten times the joint's resonance, makes K{j + 1} {percent(softer[j])} lower "
            "than that of the gear. The error bars do not include this difference.",
            "No action needed for a controller: it needs this K. Records of coupled joints show "
            "flexible links.",
            float(softer[j]),
        )


def hardly_known(evidence: Evidence) -> Iterator[Finding]:
    """Large standard errors."""
    fit = evidence.fit
    names = np.array(elasticity_labels(fit.n))
    is_stiffness = np.arange(2 * fit.n) < fit.n
    by_noise = fit.noise_error / np.sqrt(fit.inflation)  # a misfit has its own finding
    share = relative(by_noise, fit.estimate)
    excess = share / np.where(is_stiffness, 0.05, 0.2)
    whole = relative(fit.standard_error / np.sqrt(fit.inflation), fit.estimate)
    excess = np.maximum(excess, whole / np.where(is_stiffness, 0.3, 0.6))
    unknown = names[excess > 1].tolist()
    if unknown:
        nothing = undetermined(fit).all()
        worst = int(np.argmax(excess[: fit.n] if nothing else excess))
        stated = relative(fit.standard_error, fit.estimate)[worst]
        size = percent(stated) if np.isfinite(fit.standard_error[worst]) else ""
        title = f"{some(unknown)} {'is' if len(unknown) == 1 else 'are'} poorly determined"
        make = warning
        if nothing:
            make = problem
            title = f"These records do not determine {enumerated(names[: fit.n].tolist())}"
        yield make(
            title,
            f"One standard error of {names[worst]} is {size} of its value."
            if size
            else f"The standard error of {names[worst]} is infinite.",
            "Add records near the resonances, record longer, or move the joints more."
            if share[worst] > 0.05
            else "Add records at lower and higher frequencies, which also determine the inertias, or "
            "enter more accurate inertias.",
            float(whole.max()),
        )


def model_limits(evidence: Evidence) -> Iterator[Finding]:
    """Residual above the noise."""
    fit = evidence.fit
    misfit, freedom = fit.fundamental
    noise_freedom = 2 * float(fit.equations.noise.degrees_of_freedom.sum())
    if evidence.has_motions:  # it is measured beyond their band
        noise_freedom = 1 / (1 / noise_freedom + 0.5 * (_ROUNDING * _share_of_angles(fit)) ** 2)
    beyond = freedom > 0 and fdtrc(freedom, noise_freedom, misfit) < _CHANCE
    if fit.misfit <= EXPLAINED and not beyond:
        return
    share_left, is_negligible = _left_of_torque(fit)
    left = f"The residual is {times_noise(fit.misfit)}"
    if freedom > 0:
        left += f" (at the frequencies of the motion: {times_noise(max(misfit, 1.0))})"
    left += f"; beyond the noise it is {percent(share_left)} of the torque" * (share_left > 0)
    if is_negligible:
        text = f"{left}: too little to change K or D noticeably."
        yield note("The residual is above the noise, but negligible", text, "", share_left)
        return
    if fit.inflation > 1.05**2:  # else the factor rounds to 1
        widened = times_noise(fit.inflation).removesuffix(" × noise")
        left += f". The noise part of the error bars is widened by a factor of {widened}"
    odd_record, changes = _odd_record(evidence)
    hold, hold_changes = half_a_sample(evidence)
    loaded = max(fit.misfit, misfit) > _CONTRADICTED and _is_loaded(evidence)
    chosen = fit.method in LINEAR and not fit.candidates  # by the user: others may explain the data
    make = problem if (contradicts(fit) or loaded) and not chosen else warning
    parts = fitted_parts(fit) if make is problem else []
    if parts:
        left += f". Fitting {enumerated(parts)} does not reduce the residual to the noise level"
    finding = make(
        "The model does not explain the data" if make is problem else MODEL_LIMITS,
        f"{left}.{odd_record}",
        hold
        or (_ONE_SIDED if loaded else even_harmonics(evidence) or _usual_cause(evidence, odd_record)),
        float(relative(fit.standard_error, fit.estimate).max()),
        "edit mapping" if hold else "edit runs" if changes else "",
        *hold_changes,
        *changes,
    )
    yield replace(finding, code="model limits")


def contradicts(fit: ElasticityFit) -> bool:
    """Whether the residual is so large that the answer is not usable."""
    left = _left_of_torque(fit)[0]
    return left > _MUCH and max(fit.misfit, fit.fundamental[0]) * left > _CONTRADICTED


def _share_of_angles(fit: ElasticityFit) -> float:
    """Share of the residual's variance from the noise of the angles, mean over rows and joints."""
    equations = fit.equations
    spring = fit.K + 1j * equations.omega[:, None] * fit.D
    gain = np.abs(equations.of_b - spring[..., None] * equations.of_a) ** 2
    variance = gain * np.einsum("rjj->rj", equations.noise.covariance[:, 0]).real[:, None]
    return float((variance[..., : fit.n].sum(axis=2) / variance.sum(axis=2)).mean())


def _is_loaded(evidence: Evidence) -> bool:
    """Whether sines have even harmonics, but no constant velocity, with which friction causes them."""
    return distortion(evidence, "even") > _EVEN and not evidence.fit.phasors.is_superposed


_ONE_SIDED = (
    "The torques have even harmonics, as with backlash or a nonlinear gear under a constant load, such "
    "as gravity. The gear laws do not include such a load: measure in a pose in which gravity does "
    "not load the joints."
)


def _usual_cause(evidence: Evidence, odd_record: str) -> str:
    """Remedy for a residual above the noise."""
    fit = evidence.fit
    if odd_record:
        return (
            "Check the columns, the load and the sample rate of this record, or leave it out. Without "
            "an anti-aliasing filter, a record with a low sample rate contains aliased torque."
        )
    if fit.prior is not None and np.any(fit.prior.added) and fit.prior.torque_std == 0:
        return (
            "The fit takes the torque constants as exact; if they are wrong, they contradict the known "
            "payload. State how well they are known, for instance std = 0.05 under [torque] in "
            "study.toml: the payload then determines the torque scale. Check the payload's inertia too."
        )
    if fit.friction is not None and fit.phasors.is_superposed:
        speed = fit.phasors.omega[:, None] * np.abs(fit.phasors.q)
        constant = np.abs(fit.phasors.drift)
        if np.any((constant > _COMPARABLE * speed) & (constant < speed)):
            return (
                "Joints reverse slowly where the constant velocity is about as large as that of the "
                "sine, and the friction there is uncertain. Choose a constant velocity so large that no "
                "joint reverses, or omit it."
            )
    if fit.friction is not None:
        backlash = "" if "backlash" in fit.parameters.layout else ", backlash"
        return (
            f"The fit already includes {enumerated(fitted_parts(fit))}. Check the inertias, the torque "
            f"constants{backlash} and external disturbances."
        )
    odd = distortion(evidence)
    if odd > 1e-3:
        return f"The torque has odd harmonics of {percent(odd)}, a sign of friction. " + (
            "Use the estimator auto." if fit.method in LINEAR else "Check the inertias too."
        )
    return "Check the usual causes: friction, a torque delay, torque constants, inertias."


def _left_of_torque(fit: ElasticityFit) -> tuple[float, bool]:
    """Residual beyond the noise over the torque, of the worst joint; whether it is too small to matter.

    Both are weighted as in the fit: at low frequencies, the noise may exceed the torque. The residual
    moves K by about its share, and D by its share over the loss angle D ω/K. Where the harmonics show an
    error of the model, the noise counts too: it may hide a part. It matters unless K and D are known to
    1 %, or to 0.1 % where only the fundamentals show it.
    """
    weight, least = weights(fit), fit.residual_noise.min(axis=0)
    torque, left = np.linalg.norm(weight * np.stack([fit.equations.spring_torque, fit.residual]), axis=1)
    by_noise = least**2 * np.count_nonzero(weight, axis=0)
    beyond = relative(np.sqrt(np.maximum(left**2 - by_noise, 0.0)), torque)
    loss = np.abs(fit.D / fit.K) * fit.equations.omega.max()
    explained = fit.misfit <= EXPLAINED
    known = relative(fit.noise_error, fit.estimate).max() < (_FINEST if explained else _FINE)
    bound = np.minimum(_NEGLIGIBLE_K, _NEGLIGIBLE_D * loss)
    share = beyond if explained else relative(left, torque)
    return float(beyond.max()), bool(known and np.all(share < bound))


def _odd_record(evidence: Evidence) -> tuple[str, list[Change]]:
    """Sentence on the record with most of the residual, if the others have little; its removal."""
    fit = evidence.fit
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.nan_to_num(np.abs(fit.residual / fit.residual_noise) ** 2, posinf=0.0).mean(axis=1)
    labels, of_row = np.array(fit.phasors.labels), np.arange(len(squares))
    if evidence.has_motions:  # a motion has a row for each line
        labels, of_row = np.unique(labels, return_inverse=True)
    each = np.bincount(of_row, squares) / np.bincount(of_row)
    *others, worst = np.argsort(each).tolist()
    if not others or each[worst] < _ODD * max(1.0, each[others[-1]]) or each[others[-1]] > EXPLAINED:
        return "", []
    text = (
        f' Most of it is in "{labels[worst]}": {times_noise(each[worst])}; in the others '
        f"up to {times_noise(each[others[-1]])}."
    )
    return text, [] if evidence.has_motions else [Change("leave out", (worst,))]


def hardly_tested(evidence: Evidence) -> Iterator[Finding]:
    """Hardly more equations than unknowns: nearly any model fits."""
    fit = evidence.fit
    _, freedom = fit.fundamental
    if fit.method in LINEAR or len(set(evidence.frequency_hz.round(6))) == 1 or freedom >= 2 * fit.n:
        return
    # The noise of motions is that of the residual: without freedom, the error bars are unknown, too.
    make = problem if evidence.has_motions and freedom < 1 else warning
    yield make(
        "The records hardly test the model",
        f"{counted(len(evidence.records), 'record')} give{'s' * (len(evidence.records) == 1)} "
        + ("no more equations" if freedom < 1 else f"only {counted(int(freedom), 'more equation')}")
        + " than unknowns: an effect that the model lacks may go unnoticed.",
        "Add records at other frequencies.",
        0.3,
    )


def one_frequency(evidence: Evidence) -> Iterator[Finding]:
    """Records at a single frequency, which some K and D always fit."""
    f, count, n = evidence.frequency_hz, len(evidence.records), evidence.fit.n
    if f.max() > f.min() * (1 + 1e-6):
        return
    make = problem if count == 1 else warning
    yield make(
        f"{'One record' if count == 1 else 'Records'} at one frequency cannot confirm K and D",
        f"{counted(count, 'record')} at {number(f[0])} Hz: "
        + (
            "two equations for the two unknowns of each joint, so some K and D always fit"
            if count == 1
            else "some K and D always fit a single frequency, even with wrong inertias or units"
        )
        + ". The model cannot be tested.",
        "Add records at several frequencies, from well below to well above the resonances"
        + (", two or more at each with different relative phases of the joints." if n > 1 else "."),
        0.5,
    )


def resonance_missed(evidence: Evidence) -> Iterator[Finding]:
    """No record near a resonance, where the elasticity shows most."""
    fit = evidence.fit
    if np.any(fit.K <= 0) or np.any(-2 * fit.errors.D > fit.D):
        return
    share = float(relative(fit.standard_error / np.sqrt(fit.inflation), fit.estimate).max())
    missed: list[float] = []
    covered = 0
    for pose in dict.fromkeys(evidence.poses):
        index, inertia = evidence.of_pose(pose)
        f = evidence.frequency_hz[index]
        modes = [*locked_resonances(inertia, fit.elasticity), *resonances(inertia, fit.elasticity)]
        modes = [m for m in modes if m > 0]  # of an inaccurate fit it may round to 0
        far = [m for m in modes if np.abs(np.log(f / m)).min() > np.log(_GAP)]
        missed, covered = missed + far, covered + len(modes) - len(far)
    low, high = evidence.frequency_hz.min(), evidence.frequency_hz.max()
    quarter = 0.25 / max(record.interval_s for record in evidence.records)
    # An inaccurate fit may have resonances far outside the band.
    missed = [m for m in missed if _LOWEST * low <= m <= max(quarter, high)]
    enough = share < _FINE and covered > len(missed)  # the other resonances give K and D
    if missed and high > low and not enough:
        make = warning if share > 0.05 else note
        at = some([f"{number(m)} Hz" for m in sorted(missed)])
        has = "a resonance" if len(missed) == 1 else "resonances"
        yield make(
            f"The frequencies miss {has}",
            f"The records span {number(low)} to {number(high)} Hz; the fitted model has {has} at {at}, "
            "with no record nearby. The largest relative standard error is "
            f"{percent(float(relative(fit.standard_error, fit.estimate).max()))}.",
            f"Add records at about {at}.",
            share,
        )
