"""Rules of the verdict on the given inertias and torque scales: wrong, or of other joints."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.special import chdtrc, ndtri

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import Model
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.linear_fit import Estimate, weighted
from jointid.estimation.estimators.parameters import ARM_EFFECTS, FILTERS, elasticity_labels
from jointid.estimation.identify_elasticity import identify_each
from jointid.estimation.identify_motion import identify_motion, motion_misfits
from jointid.estimation.model_fits import fit_without_inertias, freest
from jointid.estimation.model_selection import LOOSE
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.uncertainty.answer_tables import PriorRow, disagreements, prior_rows
from jointid.uncertainty.chosen_model import refit
from jointid.verdict.cause_findings import axes_look_wrong
from jointid.verdict.evidence import (
    Change,
    Evidence,
    Finding,
    number,
    problem,
    relative,
    some,
    times_noise,
    warning,
)
from jointid.verdict.rules_causes import (
    CLEAR,
    distortion,
    has_unmodelled_friction,
    is_far_nearer,
    leads_beside_friction,
)
from jointid.verdict.rules_model import EXPLAINED, contradicts
from jointid.verdict.scorer import Hypothesis, Scorer
from jointid.verdict.wrong_data import axis_hypotheses, low_frequency_inertia
from jointid.wording import capitalised, percent, plain, significant, with_error

_ABSURD = 10.0
"""Difference from a given inertia, in standard deviations, from which the answer is not usable."""
_FAR_OFF, _SURE = 0.2, 2.0
"""Relative error of K or D from inertias given as exact, from which an answer with a large misfit is not
usable, and standard errors by which it must be exceeded."""
_LOWER, _FAR_LOWER, _NEARER = 0.7, 0.3, 0.5
"""Misfit of a linear fit, that of one with free friction, and difference from the given inertias in
standard deviations, over those as logged, from which axes look swapped or reversed."""
_FAR, _SURELY = np.log(2.0), 0.2
"""Logarithm of fitted over given diagonals from which a start value is wrong (start values lie within
50 %), and largest relative error of the fitted rotor inertias that show it."""
_Probe = tuple[Model | None, Estimate]
_IMITATIONS = ("delay", "lag", *FILTERS, *ARM_EFFECTS)
"""Effects that explain motions under wrong inertias given as exact: the noise of motions is that of the
residual, so that no misfit shows these inertias."""
_CHANCE = 5e-4
"""Probability that a correct value differs this far from the given one: any value, or all together."""


def inertias_look_wrong(evidence: Evidence) -> Iterator[Finding]:
    """Fitted inertias explain the data and differ from the given ones by more than their uncertainty."""
    fit = evidence.fit
    if np.any(fit.K <= 0) or has_unmodelled_friction(evidence):
        return
    own = judged(evidence)
    yield from _far_off(evidence) if own is None else inertias_contradict(evidence, own)


def axes_exchanged(evidence: Evidence, scorer: Scorer | None = None) -> Iterator[Finding]:
    """Exchanged or reversed axes, by a complete fit: friction and gears hide them from a linear one.

    ``scorer`` compares the hypotheses on sines; motions have a regression with friction.
    """
    fit = evidence.fit
    one = np.ones(fit.n)
    hypotheses = [Hypothesis.of("", one, one), *axis_hypotheses(fit.n)]
    tried = [[each.inertia(given) for given in evidence.inertias] for each in hypotheses]
    priors = [fit.prior.like(inertias, (len(inertias), fit.n)) for inertias in tried]
    if scorer is None:
        misfit = motion_misfits(list(evidence.records), priors)
    else:
        misfit = scorer.scores(hypotheses).misfit
    best = int(np.argmin(misfit))
    if misfit[best] > _LOWER * misfit[0]:
        return
    as_given = None if evidence.has_motions else _probed(evidence.phasors, fit.prior)
    other = _refitted(evidence, priors[best], as_given[1].misfit if as_given else np.inf)
    if other is None:
        return
    before, after = (float(disagreements(each).max(initial=0.0)) for each in (fit, other))
    most = min(CLEAR, _NEARER * before) if fit.misfit <= EXPLAINED else CLEAR
    if np.any(other.estimate <= 0) or after > most:
        return
    texts = [
        times_noise(each.misfit)
        + f" with inertias up to {number(off, 2)} standard deviations from the given ones" * (before > 0)
        for each, off in ((fit, before), (other, after))
    ]
    proof = f"Residual as given: {texts[0]}; corrected: {texts[1]}."
    yield axes_look_wrong(hypotheses[best], proof)


def _probed(phasors: Phasors, prior: InertiaPrior) -> _Probe | None:
    """Fit with free friction and delays, which hide wrong inertias and exchanged axes; None without."""
    equations = spring_equations(phasors, prior.inertias(prior.M, prior.M2))
    plain = Model(None, delay=False)
    free = freest(phasors, plain, ("friction", "delay", "lag"))
    for model in (free, plain):  # few records do not determine the first
        found = fit_without_inertias(phasors, prior, weighted(equations).p, equations.noise, model)
        if found is not None:
            return model, found
    return None


def inertias_contradict(evidence: Evidence, own: ElasticityFit) -> Iterator[Finding]:
    """Given inertias, or start values of unknown ones, far from those that explain the data."""
    yield from _starts_exchanged(evidence, own)
    yield from inertias_off(evidence, own)


def inertias_off(evidence: Evidence, own: ElasticityFit) -> Iterator[Finding]:
    """Difference of the inertias and torque scales of a fit that explains the data from the given ones.

    One may be far off, or several together: inertias and torques share a wrong scale.
    """
    fit = evidence.fit
    exact = own is not fit
    uncertain = [row for row in prior_rows(own, evidence.poses) if row.unit or not exact]
    rows = sorted(((_significance(row, exact), row) for row in uncertain), key=lambda pair: -pair[0])
    sizes = np.array([size for size, _ in rows if size > 0])
    together = fit.contradicts_inertias if exact else chdtrc(sizes.size, sizes @ sizes) < _CHANCE
    most = -ndtri(_CHANCE / (2 * max(sizes.size, 1)))
    off = [pair for k, pair in enumerate(rows) if pair[0] > most or (together and k == 0)]
    if not off:
        return

    def is_absurd(size: float, row: PriorRow) -> bool:
        return not exact and size > _ABSURD and (not _is_coupling(row) or _far_coupled(evidence, own))

    off.sort(key=lambda pair: not is_absurd(*pair))  # those lead
    row, absurd = off[0][1], is_absurd(*off[0])
    unit = f" {row.unit}".rstrip()
    given = plain(row.given) + ("" if exact else f" ± {significant(row.given_std, 2)}")
    others = f" Also different: {some([other.name for _, other in off[1:]])}." if off[1:] else ""
    change = relative(own.estimate - fit.estimate, fit.estimate)
    k = int(np.argmax(change))
    accounts = "K and D are based on the fitted values."
    if exact:
        before, after = times_noise(fit.misfit), times_noise(own.misfit)
        accounts = (
            f"Refitting the inertias changes {elasticity_labels(fit.n)[k]} by {percent(change[k])}"
        )
        accounts += f" and cuts the residual from {before} to {after}." if before != after else "."
    couplings = all(_is_coupling(other) for _, other in off)
    if couplings and not absurd:
        accounts += " Only couplings differ, as with gears that couple the motors of these joints."
    own_inertias = dict(zip(evidence.poses, own.inertias, strict=True))
    if absurd:
        accounts += (
            " So large a difference indicates a wrong unit, a wrong torque constant or the inertias of "
            "another robot."
        )
    sure = change - relative(_SURE * own.standard_error, fit.estimate)
    unusable = absurd or (exact and contradicts(fit) and sure.max() > _FAR_OFF)
    yield (problem if unusable else warning)(
        "The inertias look wrong" if row.unit else "The torque scales or inertias look wrong",
        f"{capitalised(row.name)} was entered as {given}{unit}; the records indicate "
        f"{with_error(row.fitted, row.fitted_std)}{unit}.{others} {accounts}",
        ("" if row.unit else "Check rated torques and torque constants. ")
        + "Add the coupling matrix of the gears to the robot model. " * (couplings and not absurd)
        + "Check M and M2: the pose, the payload, the gear ratios and the motors' data sheets. An error "
        "in the torque constant scales all inertias alike.",
        float(change.max()) if exact else 0.05,
        "edit inertias",
        *([] if absurd or not row.unit else [Change("inertias", (), (LOOSE,) * exact, own_inertias)]),
    )


def _is_coupling(row: PriorRow) -> bool:
    """Whether it is an element J_ij of M2 off its diagonal."""
    return row.name[:2] == "J_" and row.name[2].isdigit()


def _far_coupled(evidence: Evidence, own: ElasticityFit) -> bool:
    """Whether couplings differ by so large a share of the arms' inertias that these would look wrong.

    The prior of a small coupling is narrow: gears whose coupling is left out exceed it many times.
    """
    shares = [0.0]
    for given, fitted in zip(evidence.inertias, own.inertias, strict=True):
        size = np.sqrt(np.outer(np.diag(given.M2), np.diag(given.M2)))
        shares.append(float(np.abs(np.tril(fitted.M2 - given.M2, -1) / size).max()))
    return max(shares) > min(_ABSURD * own.prior.inertia_std, 1.0)


def judged(evidence: Evidence) -> ElasticityFit | None:
    """The fit with inertias or torque scales of its own, if it explains the data; exact ones stay."""
    fit = evidence.fit
    imitated = any(name in fit.parameters.layout for name in _IMITATIONS)
    if evidence.has_motions and fit.prior.inertia_std == 0 and (imitated or fit.contradicts_inertias):
        if leads_beside_friction(fit) and not fit.contradicts_inertias:
            return None
        prior = InertiaPrior.of(fit.inertias, len(fit.inertias), fit.n, inertia_std=LOOSE)
        own = _refitted(evidence, prior, fit.misfit)
        if own is not None and leads_beside_friction(own) and not is_far_nearer(own, fit):
            return None  # they imitate a part of the friction
        return own
    if "M2" in fit.parameters.layout:
        return fit if fit.misfit <= EXPLAINED else None
    if fit.misfit <= EXPLAINED:
        return fit if "torque_scale" in fit.parameters.layout else None
    return _refitted(evidence, replace(fit.prior, inertia_std=LOOSE, torque_std=0.0), fit.misfit)


def _same_model(phasors: Phasors, prior: InertiaPrior, fit: ElasticityFit) -> _Probe:
    """Fit with the model of ``fit``."""
    return next((c.model for c in fit.candidates if c.chosen), None), refit(phasors, prior, fit)


def _refitted(evidence: Evidence, prior: InertiaPrior, misfit: float) -> ElasticityFit | None:
    """Search for a fit with other inertias that explains the records; None without success.

    The search is slow. It requires that a fit with free friction, or with the model of the given fit,
    explains far more than ``misfit``.
    """
    phasors, found, near = evidence.phasors, None, None
    for probe in () if evidence.has_motions else (_probed, partial(_same_model, fit=evidence.fit)):
        with suppress(JointIdError):
            probed = probe(phasors, prior)
            if probed is not None and probed[1].misfit <= max(EXPLAINED, _FAR_LOWER * misfit):
                near = probed
                break
    with suppress(JointIdError):
        if near is not None:
            model, start = near[0], near[1].named
            by = identify_each(phasors, prior, ["auto"], start=start, first=model, most=EXPLAINED)
            found = by["auto"]
        elif evidence.has_motions:
            found = identify_motion(
                evidence.records, prior.given, inertia_std=prior.inertia_std, torque_std=prior.torque_std
            )
    return found if found is not None and found.misfit <= EXPLAINED else None


def _starts_exchanged(evidence: Evidence, own: ElasticityFit) -> Iterator[Finding]:
    """Unknown inertias whose start values match the fitted ones far better with exchanged joints."""
    unknown = np.isinf(own.prior.inertia_std) and "M" in own.parameters.layout
    if not unknown or np.any(own.errors["M"] > _SURELY * own.parameters["M"]):
        return

    def distances(hypothesis: Hypothesis) -> Floats:
        starts = [hypothesis.inertia(given) for given in evidence.inertias]
        pairs = list(zip(own.inertias, starts, strict=True))
        rotors = [fitted.M / start.M for fitted, start in pairs]
        arms = [np.diag(fitted.M2) / np.diag(start.M2) for fitted, start in pairs]
        return np.asarray(np.abs(np.log(rotors + arms)))

    one = np.ones(own.n)
    as_given = distances(Hypothesis.of("", one, one))
    exchanges = [each for each in axis_hypotheses(own.n) if np.all(each.scale > 0)]
    nearest = min(exchanges, key=lambda each: float(distances(each).max()), default=None)
    if nearest is None or as_given.max() <= _FAR:
        return
    left = distances(nearest)
    if left.max() < _FAR and (left**2).sum() < (as_given**2).sum() / 4:
        most, least = (significant(float(np.exp(each.max())), 2) for each in (as_given, left))
        yield axes_look_wrong(
            nearest,
            f"The fitted inertias differ from the start values by factors of up to {most} as given, and "
            f"up to {least} with these joints swapped. K and D follow the order of the columns.",
        )


def _significance(row: PriorRow, exact: bool) -> float:
    """Difference of fitted and given value, in standard deviations of the less certain one."""
    if not exact:
        return abs(row.disagreement or 0.0)
    return abs(row.fitted - row.given) / row.fitted_std if row.fitted_std > 0 else 0.0


def _far_off(evidence: Evidence) -> Iterator[Finding]:
    """Inertias of another pose or drive: at low frequency the torques are (M + M2) q̈."""
    fit = evidence.fit
    if fit.misfit < 100 or distortion(evidence) > 0.02:
        return
    for pose in dict.fromkeys(evidence.poses):
        index, inertia = evidence.of_pose(pose)
        if _explained_alone(evidence, index, inertia):
            continue
        measured = low_frequency_inertia(fit.phasors.select(index), [inertia] * index.size)
        if measured is None:
            continue
        given = np.diag(inertia.M) + inertia.M2
        scale = np.sqrt(np.outer(np.diag(given), np.diag(given)))
        off = np.abs((measured + measured.T) / 2 - given) / scale
        i, j = (int(k) for k in np.unravel_index(np.argmax(off), off.shape))
        falling = np.flatnonzero(np.diag(measured) <= 0)
        where = f" in pose {pose}" if pose else ""
        if falling.size:
            yield problem(
                f"A spring or gravity acts on joint {falling[0] + 1} at low frequency{where}",
                "At the lowest frequencies its torque opposes the acceleration, unlike that of an "
                f"inertia. The residual is {times_noise(fit.misfit)}.",
                "Check the sign of the torque. If it is right, measure at higher frequencies, or in a "
                "pose without gravity torque and without forces from springs and hoses.",
                1.0,
            )
        elif (
            off[i, j] > _FAR_OFF > _unexplained(fit.phasors.select(index), measured)
        ):  # the measured inertia explains the torques, the given one does not
            element = f"J_m{i + 1} + J_a{i + 1}" if i == j else f"J_{i + 1}{j + 1}"
            yield problem(
                f"The inertias look wrong{where}",
                "At low frequency, where the elasticity has no effect, torque over acceleration gives "
                f"about {element} = {number((measured[i, j] + measured[j, i]) / 2, 2)} kg·m² (entered: "
                f"{number(given[i, j])}). The residual is {times_noise(fit.misfit)}.",
                "Check M and M2 for another pose or drive, a missing payload or wrong gear ratios.",
                float(off[i, j]),
                "edit inertias",
            )


def _unexplained(phasors: Phasors, inertia: Floats) -> float:
    """Share of the torques at the lowest frequency that an inertia (n, n) does not explain."""
    rows = phasors.by_frequency()[0][1]
    torque = phasors.tau[rows]
    left = torque + phasors.omega[rows, None] ** 2 * phasors.q[rows] @ inertia.T
    size = float(np.linalg.norm(torque))
    return float(np.linalg.norm(left)) / size if size > 0 else np.inf


def _explained_alone(evidence: Evidence, index: np.ndarray, inertia: Inertia) -> bool:
    """Whether some K and D explain one pose by itself."""
    try:
        alone = refit(evidence.phasors.select(index), inertia, evidence.fit)
    except JointIdError:
        return False
    return alone.expected_cost > 0 and alone.cost < 100 * alone.expected_cost
