"""Findings on studies with records of motions that are no sines."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from jointid.arrays import Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.records import MotionRecord, SineRecord
from jointid.verdict.evidence import Evidence, Finding, percent, some, warning
from jointid.verdict.findings import all_well, of_records
from jointid.verdict.rules_causes import torque_lags
from jointid.verdict.rules_effects import effects_found
from jointid.verdict.rules_inertia import inertias_off, judged
from jointid.verdict.rules_model import hardly_known, hardly_tested, model_limits, not_physical
from jointid.verdict.rules_records import counted_twice

_RESTS, _LOOSELY = 0.35, 0.01
"""Share of the time at rest, and relative standard error of K, from which a joint is reported."""
_SPAN_S, _FAST, _SLOW = 0.01, 0.98, 0.03
"""Time in which a motor moves, s; the quantile of its moves that counts as fast; a rest over it."""


def motion_findings(
    records: Sequence[SineRecord | MotionRecord],
    inertias: Sequence[Inertia],
    phasors: Phasors,
    fits: Mapping[str, ElasticityFit],
) -> tuple[Finding, ...]:
    """All findings, most important first, including one if no action is needed.

    Parameters
    ----------
    records : sequence of SineRecord and MotionRecord
    inertias : sequence of Inertia
        Inertia of each record.
    phasors : Phasors
        Of the sine records.
    fits : mapping of str to ElasticityFit
        The fit of all records first, then the linear ones of the sines.
    """
    fit = next(iter(fits.values()))
    evidence = Evidence(tuple(records), inertias, fit.phasors, fit, {})
    motions = tuple(record for record in records if isinstance(record, MotionRecord))
    of_motions = Evidence(motions, inertias, phasors.select(np.zeros(0, int)), fit, {})
    found = [*not_physical(evidence), *counted_twice(of_motions)]
    sines = [k for k, record in enumerate(records) if isinstance(record, SineRecord)]
    if linear := fits.get("weighted"):
        chosen = tuple(record for record in records if isinstance(record, SineRecord))
        theirs = [inertias[k] for k in sines]
        found += of_records(Evidence(chosen, theirs, phasors, linear, {}))
    own = None if np.any(fit.K <= 0) else judged(evidence)
    causes = [] if own is None else list(inertias_off(evidence, own))
    found += [*causes, *effects_found(evidence), *torque_lags(evidence)]
    if not causes:
        resting = list(_resting(of_motions))
        rules = (model_limits, hardly_tested, hardly_known)[: 2 if resting else 3]
        found += [*resting, *(each for rule in rules for each in rule(evidence))]
    if not any(finding.level in ("problem", "warning") for finding in found):
        found.append(all_well(fit))
    return tuple(sorted(found, key=lambda finding: -finding.weight))


def _resting(evidence: Evidence) -> Iterator[Finding]:
    """Joints that friction holds so long that their own torques hardly show the spring."""
    fit = evidence.fit
    records = [record for record in evidence.records if isinstance(record, MotionRecord)]
    if fit.friction is None or not records:
        return
    shares = np.mean([share_at_rest(record) for record in records], axis=0)
    known = fit.standard_error[: fit.n] / np.abs(fit.K)
    joints = np.flatnonzero((shares > _RESTS) & (known > _LOOSELY))
    if joints.size:
        j = int(joints[np.argmax(known[joints])])
        size = percent(known[j]) if np.isfinite(known[j]) else "not determined"
        yield warning(
            f"{some([f'Joint {k + 1}' for k in joints])} rested for much of the motion",
            f"Motor {j + 1} hardly moved during {percent(shares[j])} of the time. While friction holds "
            f"it, its torque does not show the spring, and K{j + 1} follows from the other joints and "
            f"the short moves: one standard error is {size}.",
            f"Move joint {j + 1} faster or farther, with torques well above its friction, so that it "
            "reverses without a rest.",
            float(min(known[j], 1.0)),
        )


def share_at_rest(record: MotionRecord) -> Floats:
    """Share of the time in which each motor hardly moves, shape (n,)."""
    theta = record.theta_rad[record.start :]
    span = max(1, round(_SPAN_S / record.interval_s))
    moves = np.abs(theta[span:] - theta[:-span])
    fast = np.quantile(moves, _FAST, axis=0)
    return np.asarray(np.where(fast > 0, np.mean(moves <= _SLOW * fast, axis=0), 1.0))
