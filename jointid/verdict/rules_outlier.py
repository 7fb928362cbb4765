"""Rules of the verdict on records that contradict all others, and on torques of other motions.

Wrong inertias, friction and wrong units of all records affect every record. An outlier is a single
record without which the others fit well. A factor that corrects its angles or torques names its fault.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.levenberg_marquardt import LOST
from jointid.estimation.estimators.parameters import PERIODIC_EFFECTS
from jointid.estimation.identify_elasticity import identify_each
from jointid.estimation.model_fits import record_costs
from jointid.joints import Inertia
from jointid.phasors.long_records import LongRecord
from jointid.phasors.steady_state import joint_share
from jointid.verdict.causes import CAUSES, GOOD, Cause
from jointid.verdict.evidence import Change, Evidence, Finding, number, problem, some, times_noise
from jointid.verdict.rules_records import (
    AT_LIMIT,
    CUT_OFF,
    UNSIGNED,
    has_one_sign,
    is_clipped,
    off_frequency,
)
from jointid.verdict.scorer import Scorer, corrected, simplest
from jointid.wording import capitalised, counted

_LEFT = 0.02
"""Largest misfit without the outlier, over that with it; with noise alone, no record matters as much."""

_OTHERS_LEFT = 0.2
"""The same without any other record, smallest: one record is wrong, not a part of the band."""

_HIDDEN, _LARGE = 0.5, 6.0
"""Misfit without a record over that with it, squared residual over the median: outliers of a searched
model had less than 0.41 or more than 12; records that are all wrong more than 0.77 and less than 5."""
_FAR_LESS = 0.05
"""Misfit without a record over that with it, which only a wrong record explains."""
_FEWEST = 4
"""Fewest other records, so that they can contradict each other as well."""

_FAULTS: dict[tuple[int, float], Cause | None] = {(1, -1.0): None, (0, -1.0): None} | {
    (0, 1 / cause.factor) if cause.signal == "position" else (1, cause.factor): cause
    for cause in CAUSES
    if cause.by
}
"""Cause of a known fault by signal, 0 for angles and 1 for torques, and scale; None of a sign."""

_NEARLY, _NEAR = 100.0, (0.5, 2.0)
"""Cost over the least up to which a factor is refined, and the range of its change."""
_CLEAR = 4.0
"""Amplitude of a torque over its noise below which there may be no sine."""
_LOST, _EXPECTED, _MANY = 0.5, 0.1, 0.25
"""Share of the torque's variance at the frequency of the motion and its multiples, below which the
torque belongs to another motion; share of the rotor's own torque above which that is certain; share of
such records from which they are reported."""
_MOVES = 0.2
"""Amplitude over the joint's largest at the same frequency from which a record moves it."""
_FOREIGN = (
    "The torques do not belong to the motions",
    "Check that positions and torques of each record come from the same run and clock, and check the "
    "columns of the torques and the signs of torques and gear ratios.",
)
_FOLDED = 0.03
"""Second harmonic over the first from which a torque of one sign may have lost the other."""
_RESONANCE = 1.5
"""Ratio of frequencies beyond which a resonance, which needs hardly any torque, is not the cause."""

_LEAVE_OUT = "untick its run on import, or delete its [[records]] entry in study.toml"


def one_record_off(evidence: Evidence) -> tuple[int, Finding] | None:
    """Record that contradicts all others, with its finding; None unless there is exactly one.

    With a small misfit of the answer there is no search.
    """
    phasors, fit = evidence.phasors, evidence.fit
    count, n = phasors.omega.size, phasors.n
    sound = bool(np.all(fit.K > 0)) and fit.misfit < GOOD
    if sound or count - 1 < max(_FEWEST, n + 1):
        return None
    scorer = Scorer.of(phasors, evidence.inertias)
    for row, alone in _suspects(evidence, scorer):
        if (known := _fit_without(evidence, row, alone=alone)) is None:
            continue
        beside = Scorer.of(phasors, known[1])
        if found := _record_off(evidence, beside) or _off_beside_others(evidence, row, *known, beside):
            return found
    return _record_off(evidence, scorer)


def _suspects(evidence: Evidence, scorer: Scorer) -> list[tuple[int, bool]]:
    """Rows that may be wrong: the smallest misfit without it, or the largest residual of the fit.

    And whether that residual is far above those of all others.
    """
    fit, count = evidence.fit, evidence.phasors.omega.size
    if fit.prior is None or not fit.prior.inertia_std:
        return []
    as_logged = [scorer.as_logged()]
    left = scorer.scores(as_logged, 1 - np.eye(count)).misfit
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.nan_to_num(np.abs(fit.residual / fit.residual_noise) ** 2).sum(axis=1)
    shows = left < _HIDDEN * scorer.scores(as_logged).misfit[0]
    shows |= squares > _LARGE * np.median(squares)
    rows = dict.fromkeys((int(np.argmin(left)), int(np.argmax(squares))))
    second, largest = np.sort(squares)[-2:].tolist()
    alone = (squares == largest) & (largest > _LARGE * second)
    return [(row, bool(alone[row])) for row in rows if shows[row] or not fit.candidates]


def _fit_without(
    evidence: Evidence, row: int, *, alone: bool
) -> tuple[ElasticityFit, list[Inertia]] | None:
    """Fit without one record, and inertias of all; None if the others do not fit either.

    Inaccurate inertias and friction may hide a wrong record. All models are tried if its residual
    ``alone`` is large, or the misfit without it far smaller, and simple models nearly fit the others.
    """
    others = np.delete(np.arange(evidence.phasors.omega.size), row)
    phasors, prior = evidence.phasors.select(others), evidence.fit.prior.of_rows(others)
    try:
        fit = identify_each(phasors, prior, ["auto"], gives_up=lambda: True)["auto"]
        alone |= fit.misfit < _FAR_LESS * evidence.fit.misfit
        if alone and GOOD <= fit.misfit < LOST:
            fit = identify_each(phasors, prior, ["auto"], gives_up_late=lambda: True)["auto"]
    except JointIdError:
        return None
    fitted = dict(zip(others.tolist(), fit.inertias, strict=True))
    alike = [[k for k in fitted if evidence.inertias[k] is given] for given in evidence.inertias]
    if not (fit.misfit < GOOD and all(alike)):
        return None
    return fit, [fitted[same[0]] for same in alike]


def _off_beside_others(
    evidence: Evidence, row: int, others: ElasticityFit, inertias: Sequence[Inertia], scorer: Scorer
) -> tuple[int, Finding] | None:
    """A record that contradicts the model of all others, which may have friction and further effects."""
    phasors, p = evidence.phasors, others.parameters
    if any(effect in p.layout for effect in PERIODIC_EFFECTS):
        return None
    noise, prior, one = spring_equations(phasors, inertias).noise, evidence.fit.prior, np.array([row])
    if others.gravity is not None:
        prior = replace(prior, gravity=others.gravity)
    logged, of_row, own = phasors.select(one), prior.of_rows(one), noise.select(one)

    def cost(scale: Floats) -> float:
        """Cost of the record, corrected, over the median of the others."""
        scaled = replace(own, covariance=own.covariance / np.outer(scale, scale))
        try:
            found = float(record_costs(corrected(logged, scale[None]), of_row, p, scaled)[0])
        except (JointIdError, np.linalg.LinAlgError):
            return np.inf
        return found / usual if np.isfinite(found) else np.inf

    def refined(scale: Floats) -> Floats:
        """The scale with the factor of the least cost."""

        def by(inverse: float) -> Floats:
            return np.asarray(np.where(scale == 1, 1.0, scale / inverse))

        found = minimize_scalar(
            lambda x: cost(by(x)), bounds=_NEAR, method="bounded", options={"xatol": 1e-4}
        )
        return by(float(found.x))

    with np.errstate(all="ignore"):
        try:
            costs = record_costs(phasors, prior, p, noise)
        except (JointIdError, np.linalg.LinAlgError):
            return None
        usual = float(np.median(np.delete(costs, row)))
        if not costs[row] >= GOOD * costs.size * usual:
            return None
        scales = _corrections(scorer, row, others.K + 1j * phasors.omega[row] * others.D)
        known = len(_FAULTS) * (phasors.n + 1)
        found = np.array([cost(scale) for scale in scales])
        for k in known + np.flatnonzero(found[known:] < _NEARLY * found.min()):
            scales[k] = refined(scales[k])
            found[k] = cost(scales[k])
    scale = scales[simplest(found)] if found.min() < GOOD else np.ones(2 * phasors.n)
    return row, _contradicting(evidence, row, scale, evidence.fit.misfit, others.misfit)


def _record_off(evidence: Evidence, scorer: Scorer) -> tuple[int, Finding] | None:
    """Record that contradicts all others with these inertias."""
    phasors = evidence.phasors
    count = phasors.omega.size
    as_logged = [scorer.as_logged()]
    whole = scorer.scores(as_logged)
    if whole.cost[0] < GOOD:
        return None
    without = scorer.scores(as_logged, 1 - np.eye(count))
    first, second = np.argsort(without.cost, kind="stable")[:2].tolist()
    left, reference = float(without.cost[first]), float(whole.misfit[0])
    if not (left < _LEFT * reference and without.cost[second] >= _OTHERS_LEFT * reference):
        return None
    scales = _corrections(scorer, first, without.K[first] + 1j * scorer.omega[first] * without.D[first])
    cost = np.array([scorer.corrected(first, scale).scores(as_logged).cost[0] for scale in scales])
    scale = scales[simplest(cost)]
    if cost.min() > max(3 * left, GOOD):
        if left >= GOOD:
            return None  # the others do not fit either
        scale = np.ones_like(scale)
    return first, _contradicting(evidence, first, scale, float(whole.cost[0]), left)


def _contradicting(evidence: Evidence, row: int, scale: Floats, whole: float, left: float) -> Finding:
    """The finding on a record, for misfits with it and without it."""
    before = "the fit has no positive stiffness"
    if np.isfinite(whole):
        before = f"the residual is {times_noise(whole)}"
    title, cause, remedy, is_known = _outlier_text(evidence.phasors.labels[row], scale)
    return problem(
        title,
        f"With this record, {before}; without it, the residual of the other "
        f"{evidence.phasors.omega.size - 1} records is {times_noise(left)}. {cause}",
        remedy,
        10.0,
        "edit runs",
        *([Change("scale", (row,), tuple(scale.tolist()))] if is_known else []),
        Change("leave out", (row,)),
    )


def _corrections(scorer: Scorer, record: int, spring: Complexes) -> list[Floats]:
    """Logged over true angles, then torques, of a record: known faults first, then any factor.

    The coupling of the joints shows which signal of one joint is scaled. A factor of all joints may
    belong to angle or torque: the usual signal is assumed. ``spring`` is K + iωD of the other records,
    shape (n,); each scale has shape (2n,).
    """
    n, z = scorer.n, scorer.z[record]
    found: list[Floats] = []
    for joints in (slice(n), *range(n)):
        for signal, factor in _FAULTS:
            scale: Floats = np.ones((2, n))
            scale[signal, joints] = factor
            found.append(scale.ravel())
    of_a, of_b = scorer.equations(scorer.as_logged())
    left = of_b[record] - spring[:, None] * of_a[record]
    for columns in (np.arange(n, 2 * n), *np.arange(2 * n)[:, None]):
        part = left[:, columns] @ z[columns]
        with np.errstate(all="ignore"):
            factor = np.vdot(part, part).real / np.vdot(part, part - left @ z).real
        if np.isfinite(factor) and factor != 0:
            scale = np.ones(2 * n)
            scale[columns] = factor
            found.append(scale)
    return found


def _outlier_text(label: str, scale: Floats) -> tuple[str, str, str, bool]:
    """Title, cause and remedy, for scales of angles and torques, shape (2n,), and whether it is known.

    All scales are 1 where none corrects the record.
    """
    wrong, n = np.flatnonzero(scale != 1), scale.size // 2
    if not wrong.size:
        return (
            f'"{label}" contradicts all other records',
            "No factor on its positions or torques corrects it.",
            f"Check the columns, the pose and the load of this record, or leave it out: {_LEAVE_OUT}.",
            False,
        )
    fault = int(wrong[0] // n), float(scale[wrong[0]])
    signal = "torque" if fault[0] else "position"
    names = ", ".join(f"tau_m{j + 1}_Nm" if fault[0] else f"theta_m{j + 1}_rad" for j in wrong % n)
    joints = "" if wrong.size == n else f" of joint {wrong[0] % n + 1}"
    where = f'The {signal}{joints} in "{label}"'
    cause = (
        f"The {signal}{joints} is {number(fault[1])} times the value expected from the other records."
    )
    if fault not in _FAULTS:
        return (
            f"{where} differs in scale from all other records",
            cause,
            f"Check the gear ratio, the unit and the sign of {names} in this record, or leave it out: "
            f"{_LEAVE_OUT}.",
            False,
        )
    unit = _FAULTS[fault]
    if unit is None:
        title, remedy = f"{where} looks reversed in sign", f"Reverse the sign of {names}"
    else:
        title, remedy = f"{where} {unit.title}", capitalised(unit.by.format(names))
    return title, cause, f"{remedy} in this record.", True


def foreign_torques(evidence: Evidence) -> Iterator[Finding]:
    """Torques that are clipped, or lack their sign or the frequency of the motion."""
    phasors, n = evidence.phasors, evidence.phasors.n
    noise = np.sqrt(np.einsum("rjj->rj", phasors.harmonic_covariance[:, 0, n:, n:]).real)
    moves = joint_share(phasors)[:, :n] > _MOVES
    suspicious = moves & (np.abs(phasors.harmonics[:, 0, n:]) < _CLEAR * noise)
    squared = phasors.omega[:, None] ** 2
    rotors = 0.5 * np.abs(np.array([each.M for each in evidence.inertias]) * squared * phasors.q) ** 2
    orders = np.abs(phasors.harmonics[..., n:])
    at_multiples = 0.5 * (orders**2).sum(axis=1)
    folded = moves & (orders[:, 1:2].sum(axis=1) > _FOLDED * orders[:, 0])
    poor, found = evidence.fit.misfit >= GOOD, np.zeros((3, len(noise)), bool)
    for i, record in enumerate(evidence.sines):
        if isinstance(record, LongRecord) or not (poor or suspicious[i].any()):
            continue
        torque = record.tau_Nm[record.start :]
        whole = torque.var(axis=0)
        lost = (at_multiples[i] < _LOST * whole) & (rotors[i] > _EXPECTED * whole)
        found[0, i] = np.any(suspicious[i] & lost)
        found[1, i] = poor and any(is_clipped(torque[:, j]) for j in np.flatnonzero(moves[i]))
        found[2, i] = poor and any(has_one_sign(torque[:, j]) for j in np.flatnonzero(folded[i]))
    found[0, list(off_frequency(evidence))] = False
    lacking = phasors.omega[found[0]]
    if found[0].mean() > _MANY and (poor or lacking.max() > _RESONANCE * lacking.min()):
        yield foreign(evidence, found[0], "the torque lacks the frequency of the motion")
    elif found[2].mean() > _MANY:
        why = (
            "the torque reaches zero but keeps its sign, with a component at twice the frequency of "
            "the motion"
        )
        yield foreign(evidence, found[2], why, UNSIGNED)
    elif found[1].any():
        yield foreign(evidence, found[1], AT_LIMIT, CUT_OFF)


def foreign(
    evidence: Evidence, concerned: np.ndarray, why: str, words: tuple[str, str] = _FOREIGN
) -> Finding:
    """The finding on records whose torques belong to other motions, with the reason."""
    rows = np.flatnonzero(concerned).tolist()
    labels = [f'"{evidence.phasors.labels[i]}"' for i in rows]
    few = 2 * len(rows) < concerned.size
    return problem(
        words[0],
        f"In {len(labels)} of {counted(concerned.size, 'record')}, {why}: {some(labels)}. The residual "
        f"is {times_noise(evidence.fit.misfit)}.",
        words[1],
        3.0,
        "edit columns",
        *([Change("leave out", tuple(rows))] if few else []),
    )
