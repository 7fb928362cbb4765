"""Findings on the data and the answer, most important first."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np

from jointid.answer import fitted_parts
from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.estimation.identify_elasticity import identify_each
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.uncertainty.answer_tables import disagreements, largest_part
from jointid.verdict.causes import GOOD
from jointid.verdict.evidence import Evidence, Finding, good, relative, times_noise
from jointid.verdict.rules_causes import (
    against_the_paper,
    poses_disagree,
    torque_lags,
)
from jointid.verdict.rules_effects import (
    depends_on_amplitude,
    effects_found,
    friction_changes,
    gears_change,
)
from jointid.verdict.rules_inertia import axes_exchanged, inertias_look_wrong
from jointid.verdict.rules_model import (
    MODEL_LIMITS,
    hardly_known,
    hardly_tested,
    link_in_series,
    model_limits,
    not_physical,
    one_frequency,
    resonance_missed,
)
from jointid.verdict.rules_outlier import foreign_torques, one_record_off
from jointid.verdict.rules_records import (
    coarse_encoder,
    constant_torque,
    counted_twice,
    few_periods,
    loop_below_steps,
    off_frequency,
    stationary_joint,
    still_settling,
    wrong_frequency,
)
from jointid.verdict.rules_response import foreign_peak, motors_take_power, rejected
from jointid.verdict.rules_skew import joints_apart
from jointid.verdict.scorer import Scorer
from jointid.verdict.wrong_data import wrong_data
from jointid.wording import enumerated, percent

__all__ = ["Evidence", "Finding", "findings"]


_HARDLY_SMALLER = 0.9
"""Share of the worst error that may remain after useful planned records."""
_WIDE = 0.03
"""Relative standard error of K or D from which its main cause is stated."""
_FAR = 4.0
"""Difference of a fitted from a given inertia, in standard deviations, from which units may be wrong."""

_Rule = Callable[[Evidence], Iterator[Finding]]

_OF_RECORDS: tuple[_Rule, ...] = (
    wrong_frequency,
    still_settling,
    counted_twice,
    stationary_joint,
    few_periods,
    constant_torque,
    coarse_encoder,
    loop_below_steps,
)
"""Rules on the records, independent of the answer."""

_OF_THE_ANSWER: tuple[_Rule, ...] = (
    not_physical,
    against_the_paper,
    torque_lags,
    effects_found,
    friction_changes,
    gears_change,
    link_in_series,
    foreign_peak,
    rejected,
)
"""Rules that require correct units, signs and gear ratios."""

_OF_ITS_PRECISION: tuple[_Rule, ...] = (
    model_limits,
    hardly_tested,
    hardly_known,
    resonance_missed,
)
"""Rules that apply if no cause of an error is known, or if they make the answer not usable."""


def findings(evidence: Evidence) -> tuple[Finding, ...]:
    """All findings, most important first, including one if no action is needed.

    Parameters
    ----------
    evidence : Evidence
        One analysis.
    """
    found = [*of_records(evidence), *one_frequency(evidence)]
    judge = _best_fit(evidence)
    judged = replace(evidence, fit=judge)
    scales = tuple(foreign_torques(judged)) or wrong_columns(judged, evidence.phasors, evidence.inertias)
    outlier = None if scales else one_record_off(judged)
    if outlier is not None and outlier[0] not in off_frequency(evidence):  # reported with its cause
        found.append(outlier[1])
    if outlier is None and not scales:
        scales = tuple(joints_apart(judged))
        if not scales and _physical_misfit(judge) >= GOOD:
            scales = tuple(motors_take_power(evidence))
    if scales:  # the advice of notes, such as on amplitudes, requires correct data
        found = [finding for finding in found if finding.level != "note"]
    found += scales
    if outlier is None and not scales:
        found += [finding for rule in _OF_THE_ANSWER for finding in rule(evidence)]
        wrong = list(inertias_look_wrong(judged))
        found += wrong
        if not wrong:  # wrong inertias cause these, too
            causes = [*poses_disagree(evidence), *depends_on_amplitude(evidence)]
            doubts = [finding for rule in _OF_ITS_PRECISION for finding in rule(evidence)]
            found += causes + [each for each in doubts if not causes or each.level == "problem"]
    return ranked(found, evidence.fit)


def is_wrong(evidence: Evidence) -> bool:
    """Whether signs, units, columns or times of the joints are wrong, or torques are damaged."""
    damaged = any(foreign_torques(evidence)) or bool(wrong_data(evidence.phasors, evidence.inertias))
    return damaged or any(joints_apart(evidence))


def ends_early(evidence: Evidence) -> tuple[Callable[[], bool], Callable[[], bool]]:
    """Whether wrong data end a search for models far from them: ``gives_up`` and ``gives_up_late``.

    One record may also contradict all others where only it shows a law of the gears. Data that the known
    automatic fit explains are not wrong.
    """
    known = evidence.automatic
    if known is not None and _physical_misfit(known) < GOOD:
        return bool, bool
    return cache(partial(is_wrong, evidence)), cache(lambda: one_record_off(evidence) is not None)


def _best_fit(evidence: Evidence) -> ElasticityFit:
    """Fit that the rules assess: the best model, since a model that fits excludes wrong data."""
    fit = evidence.fit
    searched = fit.method == "auto" or (fit.method == "weighted" and fit.candidates)  # none fitted
    if searched or _physical_misfit(fit) < GOOD:
        return fit
    best = evidence.automatic
    if best is None:
        try:
            best = identify_each(evidence.phasors, fit.prior, ["auto"])["auto"]
        except JointIdError:
            return fit
    return best if _physical_misfit(best) < GOOD else fit


def wrong_columns(
    evidence: Evidence, phasors: Phasors, inertias: Sequence[Inertia]
) -> tuple[Finding, ...]:
    """Wrong units, signs, columns and axes, from phasors and one inertia per record."""
    if not may_be_wrong(evidence):
        return ()
    found = wrong_data(phasors, inertias)
    return found or tuple(axes_exchanged(evidence, Scorer.of(phasors, inertias)))


def may_be_wrong(evidence: Evidence) -> bool:
    """Whether the fit is so far off that units, signs, columns or axes may be wrong."""
    # Fitted inertias may absorb a wrong scale.
    off = np.any(disagreements(evidence.fit) > _FAR)
    return bool(off or _physical_misfit(evidence.fit) >= GOOD)


def _physical_misfit(fit: ElasticityFit) -> float:
    return np.inf if np.any(fit.K <= 0) or np.any(fit.D <= 0) else fit.misfit


def of_records(evidence: Evidence) -> list[Finding]:
    """Findings on the records themselves, whatever the answer is."""
    return [finding for rule in _OF_RECORDS for finding in rule(evidence)]


def ranked(found: Sequence[Finding], fit: ElasticityFit) -> tuple[Finding, ...]:
    """Findings, most important first, with a "good" one if none is a problem or warning."""
    if not any(finding.level in ("problem", "warning") for finding in found):
        found = [*found, _all_well(fit)]
    return tuple(sorted(found, key=lambda finding: -finding.weight))


def _all_well(fit: ElasticityFit) -> Finding:
    """The finding that the model explains the data."""
    share = relative(fit.standard_error, fit.estimate)
    errors = ", ".join(
        f"{name} {percent(s)}" for name, s in zip(elasticity_labels(fit.n), share, strict=True)
    )
    beyond = fitted_parts(fit)
    parts = " with " + enumerated(beyond) if beyond else ""
    cause = f" {largest_part(fit)}" if share.max() > _WIDE else ""
    return good(
        "The model explains the data",
        f"Residual of the model{parts}: {times_noise(fit.misfit)}. One standard error: {errors}.{cause}",
    )


def limit_of_records(findings: Sequence[Finding], fit: ElasticityFit, worst: Floats) -> str:
    """Say that more records of the same kind do not help, and what does; empty otherwise.

    ``worst`` is the predicted worst error before the first and after each planned record.
    """
    for finding in findings:
        if finding.code == "model limits":
            return f"{MODEL_LIMITS}: more records of the same kind do not help. {finding.remedy}"
    if worst[-1] <= _HARDLY_SMALLER * worst[0]:
        return ""
    return f"These records hardly reduce the largest error. {largest_part(fit)}"
