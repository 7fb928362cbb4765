"""Findings on studies with motion records."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from jointid.arrays import Floats
from jointid.estimation.candidates import EXPLAINED
from jointid.estimation.elasticity import ElasticityFit, undetermined
from jointid.estimation.quantities import Quantity
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.records import MotionRecord, SineRecord
from jointid.transfer_matrix import TransferMatrix
from jointid.uncertainty.comparison import compare
from jointid.verdict.evidence import Evidence, Finding, good, problem, some, warning
from jointid.verdict.findings import may_be_wrong, of_records, ranked
from jointid.verdict.rules_causes import beyond_logged_noise, torque_lags
from jointid.verdict.rules_effects import effects_found, friction_changes, gears_change
from jointid.verdict.rules_inertia import axes_exchanged, inertias_contradict, judged
from jointid.verdict.rules_model import hardly_known, hardly_tested, model_limits, not_physical
from jointid.verdict.rules_records import (
    AT_LIMIT,
    CUT_OFF,
    UNSIGNED,
    counted_twice,
    has_one_sign,
    is_clipped,
)
from jointid.verdict.rules_skew import joints_apart
from jointid.verdict.wrong_data import wrong_data
from jointid.wording import (
    capitalised,
    counted,
    enumerated,
    joints_text,
    minus,
    percent,
    significant,
    with_error,
)

_RESTS, _LOOSELY = 0.35, 0.01
"""Share of the time at rest and relative standard error of K from which a joint is reported."""
_SURE = 1e4
"""Degrees of freedom of the covariance of transfer matrices."""
_SPAN_S, _FAST, _SLOW = 0.01, 0.98, 0.03
"""Interval of a move, s; quantile of the moves that counts as fast; largest move at rest, relative to
it."""
_CONTRADICTED = "The motor torques of {} contradict the robot model"
_IN_MODEL = (
    "Robot model, payload and friction do not explain these torques. K of every joint depends on the "
    "torque of the robot model."
)
_CHECK_MODEL = (
    "Check the order, signs and zero positions of the joint angles, the order and unit of the torques, "
    "the unit of time, the payload and the gear ratios."
)
_REVERSED = "The motor torques of {} have the wrong sign"
_DRIVEN = (
    "With the logged sign, friction would drive the motion or gravity act upwards. The estimates of "
    "payload and K depend on these torques."
)
_CHECK_SIGN = "Check the columns of these torques in the log, and reverse their sign."
_UNCHECKED = (
    "The records do not check the gear ratios of joints without a sensor, on which K of the others "
    "depends: compare them with the data sheet, or turn each of these joints by a known angle."
)
_ZEROS = "The zero position{} of {} look{} wrong"
_CHECK_ZEROS = (
    "Check the zero positions of the joints in the robot model (zero_deg in TOML) and in the log, their "
    "gear ratios, the pose of the base (gravity), and the payload."
)
_ARC_SECONDS = 180 / np.pi * 3600


def motion_findings(
    records: Sequence[SineRecord | MotionRecord],
    inertias: Sequence[Inertia],
    phasors: Phasors,
    fits: Mapping[str, ElasticityFit],
    matrices: Mapping[str, TransferMatrix],
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
    matrices : mapping of str to TransferMatrix
        By pose.
    """
    fit = next(iter(fits.values()))
    evidence = Evidence(tuple(records), inertias, fit.phasors, fit, {})
    motions = tuple(record for record in records if isinstance(record, MotionRecord))
    of_motions = Evidence(motions, inertias, phasors.select(np.zeros(0, int)), fit, {})
    found = [*not_physical(evidence), *counted_twice(of_motions)]
    if linear := fits.get("weighted"):
        pairs = zip(records, inertias, strict=True)
        theirs = [inertia for record, inertia in pairs if isinstance(record, SineRecord)]
        found += of_records(Evidence(evidence.sines, theirs, phasors, linear, {}))
    rests = _rests(motions)
    causes: list[Finding] = []
    if may_be_wrong(evidence):
        causes += wrong_motions(records, inertias, matrices) or axes_exchanged(evidence)
    elif fit.misfit > EXPLAINED:
        causes += damaged_torques(motions)
    causes += [] if causes else joints_apart(evidence)
    own = None if causes or np.any(fit.K <= 0) else judged(evidence)
    causes += [] if own is None else inertias_contradict(evidence, own)
    found += [*causes, *effects_found(evidence), *friction_changes(evidence)]
    found += [*gears_change(evidence), *torque_lags(evidence)]
    if not causes:
        found += beyond_logged_noise(evidence)
        resting = list(_joints_at_rest(fit, rests))
        rules = (model_limits, hardly_tested, hardly_known)[: 2 if resting else 3]
        found += [*resting, *(each for rule in rules for each in rule(evidence))]
    return ranked(found, fit)


def wrong_motions(
    records: Sequence[SineRecord | MotionRecord],
    inertias: Sequence[Inertia],
    matrices: Mapping[str, TransferMatrix],
) -> tuple[Finding, ...]:
    """Find torques that are clipped or lack their sign, and wrong signs, units, gear ratios and columns.

    The latter by ``wrong_data`` from transfer matrices, unless a motor rests: friction that holds it
    acts like another inertia.
    """
    motions = [record for record in records if isinstance(record, MotionRecord)]
    damaged = tuple(damaged_torques(motions))
    if damaged or not matrices or _rests(motions).max() >= _RESTS:
        return damaged
    return tuple(wrong_data(*_responses(records, inertias, matrices)))


def damaged_torques(motions: Sequence[MotionRecord]) -> Iterator[Finding]:
    """Torques of moving joints that are clipped, or lack their sign in all motions."""
    moving = [(r, np.flatnonzero(share_at_rest(r) < _RESTS)) for r in motions]
    torques = [(f'"{r.label}"', [r.tau_Nm[r.start :, j] for j in joints]) for r, joints in moving]
    unsigned = [name for name, each in torques if each and all(has_one_sign(tau) for tau in each)]
    clipped = [name for name, each in torques if any(is_clipped(tau) for tau in each)]
    damages: list[tuple[list[str], tuple[str, str], str]] = [(clipped, CUT_OFF, AT_LIMIT)]
    if len(unsigned) == len(motions):
        damages.insert(0, (unsigned, UNSIGNED, "no torque changes its sign"))
    for names, (title, remedy), why in damages:
        if names:
            where = f"In {len(names)} of {counted(len(motions), 'motion')}"
            yield problem(title, f"{where}, {why}: {some(names)}.", remedy, 3.0, "edit columns")
            return


def _responses(
    records: Sequence[SineRecord | MotionRecord],
    inertias: Sequence[Inertia],
    matrices: Mapping[str, TransferMatrix],
) -> tuple[Phasors, list[Inertia]]:
    """Transfer matrices as motions under a torque of 1 N·m at each motor in turn, and their inertias."""
    n, parts, of_rows = inertias[0].n, [], []
    longest = max(float(np.ptp(record.time_s)) for record in records)
    poses = [record.pose or "" for record in records]
    for pose, matrix in matrices.items():
        rows, square = n * matrix.omega.size, matrix.omega[:, None, None] ** 2
        covariance = np.zeros((rows, 2 * n, 2 * n), complex)
        of_columns = np.einsum("fijkj->fjik", matrix.covariance.reshape(-1, n, n, n, n))
        covariance[:, :n, :n] = (of_columns / square[..., None] ** 2).reshape(rows, n, n)
        motions = Phasors(
            omega=np.repeat(matrix.omega, n),
            q=-(matrix.H / square).swapaxes(1, 2).reshape(rows, n),
            tau=np.tile(np.eye(n, dtype=complex), (matrix.omega.size, 1)),
            covariance=covariance,
            degrees_of_freedom=np.full(rows, _SURE),
            duration_s=np.full(rows, longest),
        )
        parts.append(motions)
        of_rows += [inertias[poses.index(pose)]] * rows
    return Phasors.joined(parts), of_rows


def arm_side_findings(
    K: Floats,
    error: Floats,
    reasons: Sequence[str],
    sensed: np.ndarray,
    left_out_rad: Floats,
    contradicted: np.ndarray,
    misplaced: Floats,
    reversed_torques: np.ndarray,
) -> tuple[Finding, ...]:
    """Findings on K from sensors behind the gears: joints refused by reason, most important first.

    All shape (n,): K and its error, NaN where refused; the reasons; whether the joint has a sensor; the
    error of the deflection predicted for a record left out, NaN where not known; and whether the motor's
    torque contradicts the robot model. ``misplaced``, (2, n), rad, are the angles to add to those
    logged, according to these torques, and their standard deviations; NaN where the zero is right.
    ``reversed_torques`` are the joints whose logged torque has the wrong sign.
    """
    known, found = np.isfinite(K), []
    if known.any() and reversed_torques.any():
        title = _REVERSED.format(joints_text(np.flatnonzero(reversed_torques) + 1))
        found.append(warning(title, _DRIVEN, _CHECK_SIGN, 1.0 + K.size))
    elif known.any() and contradicted.any():
        title = _CONTRADICTED.format(joints_text(np.flatnonzero(contradicted) + 1))
        found.append(warning(title, _IN_MODEL, _CHECK_MODEL, 1.0 + K.size))
    elif known.any() and np.isfinite(misplaced).any():
        found.append(_wrong_zeros(*np.rad2deg(misplaced)))
    for reason in dict.fromkeys(filter(None, reasons)):
        joints = np.flatnonzero([text == reason for text in reasons])
        title = f"K of {joints_text(joints + 1)} is not determined"
        if sensed.any() and not sensed[joints].any():
            found.append(Finding("note", title, reason, _UNCHECKED * bool(known.any()), 0.0))
        elif known.any():
            found.append(warning(title, reason, "", float(joints.size)))
        else:
            found.append(problem(title, reason, "", float(joints.size)))
    if known.any():
        worst = int(np.nanargmax(np.where(known, error / K, np.nan)))
        detail = (
            f"The largest relative error is {percent(error[worst] / K[worst])}, at joint {worst + 1}."
        )
        if np.isfinite(left_out_rad).any():
            ends = [end(left_out_rad) * _ARC_SECONDS for end in (np.nanmin, np.nanmax)]
            most = " to ".join(dict.fromkeys(significant(float(end), 2) for end in ends))
            detail += (
                " In records left out of the fit, it predicts the deflection with an error of "
                f"{most} seconds of arc (rms)."
            )
        which = joints_text(np.flatnonzero(known) + 1)
        found.append(good(f"The sensors behind the gears determine K of {which}", detail))
    return tuple(sorted(found, key=lambda finding: -finding.weight))


def _wrong_zeros(change_deg: Floats, std_deg: Floats) -> Finding:
    """Joint angles whose zero differs from that of the robot model; both (n,), NaN where it is right."""
    joints = np.flatnonzero(np.isfinite(change_deg))
    changes = [
        f"({minus(with_error(float(change_deg[j]), float(std_deg[j])))})° to the angle of joint {j + 1}"
        for j in joints
    ]
    one = joints.size == 1
    return warning(
        _ZEROS.format("" if one else "s", joints_text(joints + 1), "s" if one else ""),
        f"The motor torques fit the robot model best after adding {enumerated(changes)}. K of every "
        "joint depends on the torque of the robot model at the logged angles.",
        _CHECK_ZEROS,
        1.0 + joints.size,
    )


def at_odds(motors: Sequence[Quantity], sensors: Sequence[Quantity]) -> Finding | None:
    """Joints whose K from the motors differs significantly from that of sensors behind their gears.

    Both begin with K1 ... Kn, N·m/rad at the joint.
    """
    apart = [row for row in compare(motors, sensors) if row.is_clear]
    if not apart:
        return None
    worst = max(apart, key=lambda row: abs(row.sigmas))
    motor, sensor = worst.first, worst.second
    which = joints_text(row.first.joints[0] for row in apart)
    return warning(
        f"Motors and sensors behind the gears disagree on K of {which}",
        f"{motor.name} at the joint is {' '.join(motor.shown)} from the motors, and "
        f"{' '.join(sensor.shown)} from the sensor behind the gear: {abs(worst.sigmas):.1f} "
        "standard errors apart.",
        "Check torque constants, inertias, gear ratios and the motion. Prefer K from the sensors: "
        "they measure the deflection itself.",
        float(abs(motor.value / sensor.value - 1)),
    )


def _rests(motions: Sequence[MotionRecord]) -> Floats:
    """Mean share of the time in which each motor hardly moves, shape (n,)."""
    return np.asarray(np.mean([share_at_rest(record) for record in motions], axis=0))


def _joints_at_rest(fit: ElasticityFit, shares: Floats) -> Iterator[Finding]:
    """Joints at rest for so long that their own torques carry little information on K."""
    if fit.friction is None:
        return
    known = fit.errors.K / np.abs(fit.K)
    joints = np.flatnonzero((shares > _RESTS) & (known > _LOOSELY))
    if joints.size:
        j, which = int(joints[np.argmax(known[joints])]), capitalised(joints_text(joints + 1))
        result = f"do not determine K{j + 1}."
        if np.isfinite(known[j]):
            result = f"determine K{j + 1} with a standard error of {percent(known[j])}."
        make = problem if np.any(undetermined(fit)[joints]) else warning
        yield make(
            f"{which} rest{'s' * (joints.size == 1)} for much of the motion",
            f"Motor {j + 1} hardly moves for {percent(shares[j])} of the time. While friction holds "
            "it, its torque carries no information on K. The other joints and its short moves " + result,
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
