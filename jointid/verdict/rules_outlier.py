"""Rules of the verdict on records that contradict all others, and on torques of other motions.

Wrong inertias, friction and wrong units of all records affect every record. Here the others fit well
without a single record. Its error follows from the torques that K and D of the others predict for its
angles: a factor on angle or torque that corrects the record.
"""

from collections.abc import Iterator

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.passivity import taken_power
from jointid.joints import Inertia, dynamic_arm_inertia, motor_impedance
from jointid.phasors.extract import Phasors
from jointid.phasors.long_records import LongRecord
from jointid.verdict.causes import CAUSES, GOOD
from jointid.verdict.evidence import (
    Change,
    Evidence,
    Finding,
    number,
    problem,
    some,
    times_noise,
)
from jointid.verdict.rules_records import off_frequency
from jointid.verdict.scorer import Scorer
from jointid.verdict.steady_state import joint_share
from jointid.wording import capitalised, counted, percent

_LEFT = 0.02
"""Largest share of the misfit without the record; by noise alone, one record changes little."""

_OTHERS_LEFT = 0.2
"""Smallest share of the misfit without another record: one record is wrong, not a part of the band."""

_FEWEST = 4
"""Fewest other records, so that they can contradict each other as well."""

_TOLERANCE = 0.15
"""Relative difference within which a factor counts as a known one, or as 1."""

_UNITS = {cause.factor: cause for cause in CAUSES if cause.by}
"""Wrong units of one signal by torque over angle, measured over expected."""
_KNOWN = (1.0, -1.0, *(sign * factor for factor in _UNITS for sign in (1.0, -1.0)))

_CLEAR = 4.0
"""Amplitude of a torque over its noise below which there may be no sine."""
_LOST, _EXPECTED, _MANY = 0.5, 0.1, 0.25
"""Share of the torque's variance at the frequency of the motion and its multiples below which the rest
is another signal, that of the rotor's own torque which cannot be missed, and share of such records from
which they are reported."""
_MOVES = 0.2
"""Amplitude over the joint's largest at the same frequency from which a record moves it."""
_SURE = 5.0
"""Standard errors of a power."""
_FOREIGN = (
    "The torques do not belong to the motions",
    "Check that angles and torques of each record come from the same run and clock, and check the "
    "columns of the torques and the signs of torques and gear ratios.",
)
_CUT_OFF = (
    "A logged torque is clipped",
    "Log the torque with a larger range, or use smaller motions.",
)
_CUT, _FAR_MORE = 0.1, 4.0
"""Share of the samples at the largest torque from which its log is clipped there, and their number over
that at any smaller one: 2.4 for a sine in coarse steps."""
_RESONANCE = 1.5
"""Ratio of frequencies beyond which no resonance, which needs hardly any torque, explains its lack."""

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
    as_logged = [scorer.as_logged()]
    whole = scorer.scores(as_logged)
    if whole.cost[0] < GOOD:
        return None
    without = scorer.scores(as_logged, 1 - np.eye(count))
    first, second = np.argsort(without.cost, kind="stable")[:2].tolist()
    left, reference = float(without.cost[first]), float(whole.misfit[0])
    if not (left < _LEFT * reference and without.cost[second] >= _OTHERS_LEFT * reference):
        return None
    K, D = without.K[first], without.D[first]
    factor, by_angle = _factor(phasors, evidence.inertias[first], K, D, first)
    if factor is not None:
        scale = np.r_[1 / factor, np.ones(n)] if by_angle else np.r_[np.ones(n), factor]
        corrected = scorer.corrected(first, scale).scores(as_logged).cost[0]
        factor = factor if corrected <= max(3 * left, 0.1 * _LEFT * reference) else None
    if factor is None and not left < GOOD:
        return None  # the others do not fit either
    own = np.abs(spring_equations(phasors, evidence.inertias).stiffness[first])
    stiffness = own / np.abs(K + 1j * phasors.omega[first] * D)
    k = int(np.argmax(np.abs(np.log(np.maximum(stiffness, 1e-12)))))
    before = "the fit has no positive stiffness"
    if np.isfinite(whole.cost[0]):
        before = f"the residual is {times_noise(float(whole.cost[0]))}"
    title, cause, remedy = _outlier_text(phasors.labels[first], factor, by_angle)
    changes = [Change("leave out", (first,))]
    if factor is not None and np.isin(factor, _KNOWN).all():
        changes.insert(0, Change("scale", (first,), tuple(scale.tolist())))
    return first, problem(
        title,
        f"With it, {before}; without it, the residual of the other {count - 1} "
        f"records is {times_noise(left)}. Its value for the dynamic stiffness of joint "
        f"{k + 1} is {number(float(stiffness[k]), 2)} times that of the other records. {cause}",
        remedy,
        10.0,
        "edit runs",
        *changes,
    )


def _outlier_text(label: str, factors: Floats | None, by_angle: bool) -> tuple[str, str, str]:
    """Title, cause and remedy, for factors on the angles or torques of all joints.

    ``factors`` is None where none corrects the record.
    """
    if factors is None:
        return (
            f"{label} contradicts all other records",
            "No factor on its angles or torques corrects it.",
            f"Check the columns, the pose and the load of {label}, or leave it out: {_LEAVE_OUT}.",
        )
    wrong = np.flatnonzero(~np.isclose(factors, 1))
    signal = "angle" if by_angle else "torque"
    names = ", ".join(f"theta_m{j + 1}_rad" if by_angle else f"tau_m{j + 1}_Nm" for j in wrong)
    joints = "" if wrong.size == factors.size else " of joint " + " and ".join(str(j + 1) for j in wrong)
    factor = float(factors[wrong[0]])
    scale = 1 / factor if by_angle else factor
    cause = f"The {signal}{joints} is {number(scale)} times the value expected from the other records."
    unit, alike = _UNITS.get(abs(factor)), np.all(factors[wrong] == factor)
    if alike and factor == -1:
        title = f"The {signal}{joints} in {label} looks reversed in sign"
        return title, cause, f"Reverse the sign of {names} in this record."
    if alike and unit and _usual_on_angle(factor) == by_angle:
        title, sign = f"The {signal}{joints} in {label} {unit.title}", ""
        if factor < 0:
            title, sign = f"{title}, with the sign reversed", " and reverse its sign"
        return title, cause, f"{capitalised(unit.by.format(names))}{sign} in this record."
    return (
        f"The {signal}{joints} in {label} differs in scale from all other records",
        cause,
        f"Check the gear ratio, the unit and the sign of {names} in {label}, or leave the record out: "
        f"{_LEAVE_OUT}.",
    )


def _factor(
    phasors: Phasors, inertia: Inertia, K: Floats, D: Floats, i: int
) -> tuple[Floats | None, bool]:
    """Real factors of each joint that make a record agree with K and D of the others."""
    s = np.asarray(1j * phasors.omega[i : i + 1], np.complex128)
    arm = np.asarray(np.linalg.inv(dynamic_arm_inertia(s.imag, inertia)), np.float64)
    Z = motor_impedance(s, inertia.M, arm, K, D)[0][0]
    q, tau = phasors.q[i], phasors.tau[i]
    # One factor for all joints does not separate angle from torque: the usual signal is assumed.
    predicted = Z @ q
    if np.linalg.norm(predicted) > 0:
        whole = np.vdot(predicted, tau) / np.vdot(predicted, predicted)
        rest = np.linalg.norm(tau - whole * predicted)
        if rest < _TOLERANCE * np.linalg.norm(tau) and _is_real(np.array([whole])):
            value = _snapped(float(whole.real))
            return np.full(q.size, value), _usual_on_angle(value)
    with np.errstate(divide="ignore", invalid="ignore"):
        of_torque = tau / predicted
        try:
            of_angle = np.linalg.solve(Z * q, tau)  # true over logged angle
        except np.linalg.LinAlgError:
            of_angle = np.full(q.size, np.nan + 0j)
    possible = []
    for factors, by_angle in ((of_angle, True), (of_torque, False)):
        if np.isfinite(factors).all() and _is_real(factors):
            values = np.array([_snapped(float(f)) for f in factors.real])
            if np.any(values == 1) and np.any(values != 1):
                possible.append((values, by_angle))
    for values, by_angle in possible:  # joints that do not couple leave both possible
        if _usual_on_angle(float(values[values != 1][0])) == by_angle:
            return values, by_angle
    return possible[0] if possible else (None, True)


def _is_real(factors: Complexes) -> bool:
    return bool(np.all(np.abs(factors.imag) < _TOLERANCE * np.abs(factors)))


def _snapped(factor: float) -> float:
    return next((known for known in _KNOWN if abs(factor / known - 1) < _TOLERANCE), factor)


def _usual_on_angle(factor: float) -> bool:
    unit = _UNITS.get(abs(factor))
    return factor != -1 and (unit is None or unit.signal == "position")


def foreign_torques(evidence: Evidence) -> Iterator[Finding]:
    """Torques that are clipped, or lack the frequency at which the motor moves."""
    phasors, n = evidence.phasors, evidence.phasors.n
    noise = np.sqrt(np.einsum("rjj->rj", phasors.harmonic_covariance[:, 0, n:, n:]).real)
    moves = joint_share(phasors)[:, :n] > _MOVES
    suspicious = moves & (np.abs(phasors.harmonics[:, 0, n:]) < _CLEAR * noise)
    squared = phasors.omega[:, None] ** 2
    rotors = 0.5 * np.abs(np.array([each.M for each in evidence.inertias]) * squared * phasors.q) ** 2
    at_multiples = 0.5 * (np.abs(phasors.harmonics[..., n:]) ** 2).sum(axis=1)
    poor, found = evidence.fit.misfit >= GOOD, np.zeros((2, len(noise)), bool)
    for i, record in enumerate(evidence.sines):
        if isinstance(record, LongRecord) or not (poor or suspicious[i].any()):
            continue
        torque = record.tau_Nm[record.start :]
        whole = torque.var(axis=0)
        lost = (at_multiples[i] < _LOST * whole) & (rotors[i] > _EXPECTED * whole)
        found[0, i] = np.any(suspicious[i] & lost)
        found[1, i] = poor and any(_is_clipped(torque[:, j]) for j in np.flatnonzero(moves[i]))
    found[0, list(off_frequency(evidence))] = False
    lacking = phasors.omega[found[0]]
    if found[0].mean() > _MANY and (poor or lacking.max() > _RESONANCE * lacking.min()):
        yield _foreign(evidence, found[0], "the torque lacks the frequency at which the motor moves")
    elif found[1].any():
        yield _foreign(
            evidence,
            found[1],
            f"more than {percent(_CUT)} of the samples are at the largest torque",
            _CUT_OFF,
        )


def _is_clipped(torque: Floats) -> bool:
    """Whether many samples have the largest size, and far more than any smaller one."""
    counts = np.unique(np.abs(torque), return_counts=True)[1]
    return bool(counts.size > 1 and counts[-1] > max(_CUT * torque.size, _FAR_MORE * counts[:-1].max()))


def motors_take_power(evidence: Evidence) -> Iterator[Finding]:
    """Records in which the motors would absorb power from the robot."""
    phasors = evidence.phasors
    taken = taken_power(phasors.omega, phasors.z, phasors.covariance) > _SURE
    if taken.any():
        yield _foreign(
            evidence,
            taken,
            "the motors would absorb power, which elastic joints, inertias and friction cannot supply",
        )


def _foreign(
    evidence: Evidence, concerned: np.ndarray, why: str, words: tuple[str, str] = _FOREIGN
) -> Finding:
    rows = np.flatnonzero(concerned).tolist()
    labels = [evidence.phasors.labels[i] for i in rows]
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
