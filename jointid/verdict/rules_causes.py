"""Rules of the verdict that name a cause: friction, delay, poses that disagree."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import EXPLAINED
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.linear_fit import LINEAR, least_squares
from jointid.estimation.estimators.parameters import EFFECTS, elasticity_labels
from jointid.small_matrices import finite_part
from jointid.uncertainty.poses import fits_by_pose
from jointid.uncertainty.validation import harmonic_content
from jointid.verdict.evidence import (
    Change,
    Evidence,
    Finding,
    note,
    number,
    relative,
    times_noise,
    warning,
)
from jointid.wording import decimal_place, enumerated, percent, with_error

CLEAR = 4.0
"""Standard errors from which a difference is significant."""
_MORE_THAN_LOGGED = 3.0
"""Noise by the residual over that of the logged torques from which friction is not explained: up to 1.4
where the model fits, 10 with presliding friction."""
_FAR_MORE_THAN_LOGGED = 12.0
"""The same for any model with friction: up to 7.3 where it fits, from 16 with torques that are 2 % of
the largest too small, or contain 2 % of another joint's."""
_FAR_NEARER = 0.7
"""Power of the residual under other inertias, over that under the given ones, from which these are wrong
although presliding friction is not modelled: 0.94 to 1.1 where the inertias were right."""


def against_the_paper(evidence: Evidence) -> Iterator[Finding]:
    """Result of the paper's least squares with the same inertias, if it differs significantly."""
    fit, logged = evidence.fit, evidence.phasors
    if fit.method == "least-squares" or np.any(fit.K <= 0):
        return
    coulomb = fit.friction.coulomb if fit.friction and "coulomb" in fit.parameters.layout else None
    if coulomb is not None and np.any(coulomb < -fit.errors["coulomb"]):
        return  # friction dissipates energy
    if any(gear.laws != ("linear",) for gear in fit.gears):
        return  # the gears make most of the difference, and have findings of their own
    # Wrong inertias and torque scales, which the fit corrects, are not an effect of friction.
    scaled = replace(logged, tau=logged.tau * fit.torque_scale)
    paper = least_squares(spring_equations(scaled, fit.inertias))
    p, other = fit.estimate, paper.elasticity
    error = np.hypot(fit.standard_error, np.sqrt(np.diag(paper.elasticity_covariance)))
    share = relative(other - p, p)
    clear = (np.abs(other - p) > CLEAR * error) & (share > 2e-3)
    if not clear.any():
        return
    names = elasticity_labels(fit.n)
    worst = int(np.argmax(np.where(clear, share, 0.0)))
    high = "high" if other[worst] > p[worst] else "low"
    lag, paper_fit = lag_size(evidence), "the paper's least squares"
    if fit.friction is not None:
        kind, levels, unit = "Coulomb", fit.friction.coulomb, "N·m"
        if coulomb is None:
            kind, levels, unit = "Viscous", fit.friction.viscous, "N·m·s/rad"
        found = f"{kind} friction is {enumerated([number(level, 2) for level in levels])} {unit}"
        title, cause = "Friction matters", f"{found}; the fit includes it. "
        if lag is not None:
            verb = "lags" if fit.delay is not None and fit.delay > 0 else "leads"
            title = f"Friction and a torque {verb[:-1]} matter"
            cause = f"{found}, and the torque {verb} by {lag}; the fit includes both. "
        remedy = "Larger motions, or a superposed constant velocity, reduce the effect of friction."
        if lag is None:  # a lag has a remedy of its own
            remedy = f"No action needed. {remedy}"
    elif fit.delay is not None:
        return  # covered by the rule of the delay
    elif fit.misfit > 3:
        return  # the cause is unknown
    else:
        title, cause, paper_fit = "Noise biases the paper's least squares", "", "it"
        remedy = "No action needed: the chosen estimator weights positions and torques by their noise."
    others = [
        f"{names[k]} {percent(share[k])} too {'high' if other[k] > p[k] else 'low'}"
        for k in np.flatnonzero(clear)
        if k != worst
    ]
    also = "Both fits use the same inertias."
    if others:
        also = f"With the same inertias, least squares also gives {enumerated(others)}."
    yield note(
        f"{title}: {paper_fit} gives {names[worst]} {percent(share[worst])} too {high}",
        f"{cause}{also}",
        remedy,
        float(share[worst]),
    )


def lag_size(evidence: Evidence) -> str | None:
    """Delay or lead of the torque, if it was fitted and is significant; else None."""
    lag, error = evidence.fit.delay, evidence.fit.delay_error
    interval = float(np.median([record.interval_s for record in evidence.records]))
    if lag is None or error is None or abs(lag) < max(0.01 * interval, CLEAR * error):
        return None
    return f"{_as_text(1e3 * abs(_rounded(lag, error)))} ms"


def torque_lags(evidence: Evidence) -> Iterator[Finding]:
    """The torque acts later, or earlier, than its samples."""
    fit, size = evidence.fit, lag_size(evidence)
    if fit.delay is None or fit.delay_error is None or size is None:
        return
    # Least squares without a parameter shift by its covariance with the others, to first order.
    C, delay = finite_part(fit.parameter_covariance), fit.parameters.layout["delay"]
    shift = -(C[: 2 * fit.n, delay] / C[delay, delay])[:, 0] * fit.delay
    if not np.any(np.abs(shift) > fit.standard_error):
        return
    share = relative(shift, fit.estimate)
    worst = int(np.argmax(share))
    lag, interval = fit.delay, float(np.median([record.interval_s for record in evidence.records]))
    others = " or ".join(alternatives(fit, "delay").values())
    title = f"The torque {'lags' if lag > 0 else 'leads'} by {size}"
    without = f"{percent(share[worst])} too {'high' if shift[worst] > 0 else 'low'}"
    without = without if without.startswith("more") else f"about {without}"
    if fit.estimate[worst] + shift[worst] < 0:
        without = "negative"
    samples = with_error(abs(lag) / interval, fit.delay_error / interval)
    remedy, changes = half_a_sample(evidence)
    rounded = _rounded(lag, fit.delay_error)
    by_ms, by_s = _as_text(1e3 * abs(rounded)), _as_text(abs(rounded))
    what, change, to = ("delay", "add", "to") if lag > 0 else ("lead", "subtract", "from")
    yield note(
        f"{title}, or there is {others}" if others else title,
        f"{CANNOT_TELL if others else ''}The {'lag' if lag > 0 else 'lead'} is {samples} samples; the "
        f"fit includes it. If it were ignored, {elasticity_labels(fit.n)[worst]} would be {without}.",
        remedy
        or f"If the drive has such a {what}, {change} {by_ms} ms {to} the torque's delay on "
        f"import, or {by_s} s {to} torque_delay_s under [timing] in study.toml.",
        float(share[worst]),
        "edit mapping",
        *(changes or [Change("delay", values=(rounded,))]),
    )


def _rounded(lag: float, error: float) -> float:
    """Round to the digits that the standard error supports, at most four: sentence and button agree."""
    return round(lag, -max(decimal_place(error), decimal_place(lag) - 3))


def _as_text(value: float) -> str:
    """Format a number for the app or a study.toml."""
    return np.format_float_positional(float(f"{value:.6g}"), trim="-")


CANNOT_TELL = "The records cannot distinguish these. "
_EQUAL = 6.0
"""Difference of the criterion up to which two models explain the data equally well, 2 ln 20."""


def alternatives(fit: ElasticityFit, part: str) -> dict[str, str]:
    """Parts, with their names, that explain the data as well as the given part of the model."""
    chosen = next((c for c in fit.candidates if c.chosen), None)
    if chosen is None:
        return {}
    rest, found = set(chosen.parts) - {part}, {}
    for other in fit.candidates:
        added = set(other.parts) - set(chosen.parts)
        if rest < set(other.parts) and len(added) == 1 and len(other.parts) == len(chosen.parts):
            (name,) = added
            if other.criterion - chosen.criterion < _EQUAL:
                found[name] = EFFECTS[name].name if name in EFFECTS else f"a {name}"
    return found


def half_a_sample(evidence: Evidence) -> tuple[str, list[Change]]:
    """Remedy and change for a delay from a missing or wrong statement of the hold; else empty.

    A filter of the torque acts like a delay by its time constant, one of the position like a lead. They
    count where a delay explains the data as well, and in addition to a delay: together these have phase
    and magnitude of a hold.
    """
    p, held = evidence.fit.parameters, [record.torque_hold for record in evidence.records]
    lag = p.delay + p.effect("lag")
    delayed = bool(np.any(lag))
    for name, sign in (("torque_filter", 1), ("position_filter", -1)):
        if delayed or {"delay", "lag"} & alternatives(evidence.fit, name).keys():
            lag = lag + sign * p.effect(name)
    samples = np.atleast_1d(lag) / float(np.median([r.interval_s for r in evidence.records]))
    filtered = any(np.any(p.effect(name)) for name in ("torque_filter", "position_filter"))
    whose = "With lag and filter together, the" if delayed and filtered else "The"
    if not any(held) and np.all(np.abs(samples - 0.5) < 0.1):
        return (
            f"{whose} torque lags by half a sample. If the controller holds the torque from one "
            "sample to the next, set torque held on import, or torque_hold = true in study.toml."
        ), [Change("hold", values=(1.0,))]
    if all(held) and np.all(np.abs(samples + 0.5) < 0.1):
        return (
            f"{whose} torque leads by half a sample, so it is probably not held. Set torque not held on "
            "import, or torque_hold = false in study.toml."
        ), [Change("hold", values=(0.0,))]
    return "", []


def leads_beside_friction(fit: ElasticityFit) -> bool:
    """Whether the torques lead in a model with friction, as with presliding after a reversal."""
    p, layout = fit.parameters, fit.parameters.layout
    times = [name for name in ("delay", "lag") if name in layout and "coulomb" in layout]
    return any(bool(np.any(p[name] < -CLEAR * fit.errors[name])) for name in times)


def weights(fit: ElasticityFit) -> Floats:
    """Weights of the equations in the fit, those of each joint over the largest, shape (r, n)."""
    with np.errstate(invalid="ignore"):  # equations without noise have all the weight
        share = fit.residual_noise.min(axis=0) / fit.residual_noise
        return np.asarray(np.nan_to_num(share, nan=1.0))


def is_far_nearer(one: ElasticityFit, other: ElasticityFit) -> bool:
    """Whether the residual of some joint is far smaller than that of the other fit."""

    def power(fit: ElasticityFit) -> Floats:
        weight = weights(fit) ** 2
        return np.asarray((weight * np.abs(fit.residual) ** 2).sum(axis=0) / weight.sum(axis=0))

    return bool(np.any(power(one) < _FAR_NEARER * power(other)))


def beyond_logged_noise(evidence: Evidence) -> Iterator[Finding]:
    """Motions with friction whose residual exceeds the noise of their logs.

    With friction, the noise follows from the residual, so that the misfit shows no error of the model.
    """
    fit, times = evidence.fit, evidence.fit.times_logged_noise
    rubs = "coulomb" in fit.parameters.layout
    if leads_beside_friction(fit) and times > _MORE_THAN_LOGGED:
        if half_a_sample(evidence)[0]:
            return
        what, so = "friction of the motors", "K and D may be off by more than their error bars."
        why = (
            "The fitted torques lead, which indicates friction that acts like a spring before a motor "
            "slides (presliding). "
        )
        remedy = (
            "Move the joints faster, with torques well above their friction, or measure with sines. If "
            "the logged torques are filtered, log them without the filter."
        )
    elif rubs and times > _FAR_MORE_THAN_LOGGED and fit.misfit <= EXPLAINED:
        what, why = "motions", ""
        so = "The error bars follow from this residual; K and D may be off by more."
        remedy = (
            "Check the torques of the log: a dead zone around zero, a scale that changes with the "
            "torque, and the torque of another joint in the channel cause this. So does friction that "
            "the model lacks: measure with sines to find out."
        )
    else:
        return
    yield warning(
        f"The model does not fully explain the {what}",
        f"{why}Residual: {times_noise(times)} of the logged torques. {so}",
        remedy,
        float(relative(fit.standard_error, fit.estimate).max()),
    )


def poses_disagree(evidence: Evidence) -> Iterator[Finding]:
    """K and D differ between poses, though they do not depend on the pose."""
    if len(set(evidence.poses)) < 2 or np.any(evidence.fit.K <= 0) or has_unmodelled_friction(evidence):
        return
    try:
        fits = fits_by_pose(evidence.phasors, list(evidence.inertias), evidence.poses, evidence.fit)
    except (JointIdError, np.linalg.LinAlgError):
        return
    if len(fits.names) < 2:
        return
    apart = np.where(fits.significance > CLEAR, fits.spread, 0.0)
    worst = int(np.argmax(apart))
    if apart[worst] < 5e-3 or fits.probability > 1e-4:
        return
    common = float(evidence.fit.estimate[worst])
    values = ", ".join(
        f"{_change(float(value) / common - 1, float(error) / abs(common))} ({name or 'no pose'})"
        for name, value, error in zip(
            fits.names, fits.estimates[:, worst], fits.standard_error[:, worst], strict=True
        )
    )
    name = elasticity_labels(evidence.fit.n)[worst]
    yield warning(
        f"The poses disagree on {name}",
        f"Each pose alone, relative to all together: {values}. They are "
        f"{percent(fits.spread[worst])} apart, {number(fits.significance[worst], 2)} standard errors.",
        "Check M2 of each pose first, under [poses] in the inertia file or in study.toml. "
        "If the inertias are right, the gear is probably nonlinear: its stiffness then "
        "depends on the load, which depends on the pose.",
        float(apart[worst]),
        "edit inertias",
    )


def _change(share: float, error: float) -> str:
    return f"{'+' * (share > 0)}{with_error(100 * share, 100 * error)} %"


def distortion(evidence: Evidence, kind: str = "odd") -> float:
    """Largest significant "odd" or "even" distortion of a torque."""
    try:
        content = harmonic_content(evidence.phasors)
    except JointIdError:
        return 0.0
    n = evidence.fit.n
    return float(np.where(content.significance > 4, getattr(content, kind), 0.0)[:, n:].max())


def even_harmonics(evidence: Evidence) -> str:
    """Remedy where only the even harmonics of sines exceed their noise; empty otherwise.

    Friction and symmetric laws of a gear make odd ones; the dynamics of an arm are of second order.
    """
    fit = evidence.fit
    if evidence.has_motions or not fit.odd_misfit <= EXPLAINED < fit.misfit:
        return ""
    return (
        "Only the even harmonics exceed the noise; K and D follow mainly from the fundamentals. The "
        "inertia and gravity of the arm change during the motion, which causes second harmonics: repeat "
        "a record at half the amplitude, and they fall to a quarter. A nonlinear gear under a constant "
        "load causes them as well: K is then its tangent stiffness at that load. So does a torque whose "
        "scale depends on its sign: K and D are then off by half the difference."
    )


def has_unmodelled_friction(evidence: Evidence) -> bool:
    """Whether a linear estimator ignores friction, which then biases the answer."""
    return evidence.fit.method in LINEAR and distortion(evidence) > 1e-3
