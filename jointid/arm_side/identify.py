"""Stiffness of each joint from the deflection between its two encoders."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jointid.arm_side.band_limited import BandLimited, band_limited, distinct
from jointid.arm_side.candidates import Average, Scale, average, clear_moves, noise_of, over_own_move
from jointid.arm_side.fit import ArmSideFit, JointDeflection
from jointid.arm_side.mixed_model import Regression
from jointid.arm_side.payload import payload_from_motors
from jointid.arm_side.position_map import position_map, tooth_orders
from jointid.arm_side.reversed_joints import reversed_joints
from jointid.arm_side.sensor_faults import ALIKE, scale_fault, sensor_faults, share
from jointid.arm_side.terms import Ripple, joint_terms, joint_torque
from jointid.arrays import Floats, bounded_number, frozen
from jointid.errors import JointIdError
from jointid.records import MotionRecord
from jointid.robot_models.model import RobotModel
from jointid.small_matrices import one_thread
from jointid.wording import percent

LARGEST_ERROR = 0.25
"""Relative standard error beyond which a stiffness is refused."""
_SLIP = 0.1
"""Lowest velocity, in parts of the largest between two rests or reversals: as a joint starts or stops,
friction and lubrication of the gear change its deflection by more than any law of friction here."""
_OTHER_SLIPS = (0.05, 0.2)
"""Other choices of that limit; the change of the result is part of the error."""
_WEIGHTLESS, _FEWEST_MOVES = 0.1, 4
"""Share of gravity in the variation of a torque below which only acceleration shows K, and the fewest
moves required then: in a move there and back, the accelerations depend on the position as a transmission
error does, and are largest where friction changes."""
_PARTS = (6, 10)
"""Numbers of parts of the time, each left out in turn: the same part of every record."""
_FEWEST = 60
_FIRST_COMPLIANCE = 2e-7
_ROUNDS, _MOST_ROUNDS, _SETTLED_RAD = 3, 8, 1e-4
"""Rounds, and most of them until the deflection of soft gears settles: gravity depends on it."""
_SLOW_RAD_S, _SLOW_FRICTION_RAD = 0.02, 1.5e-5
"""Velocity below which friction in the gear still changes with it (Stribeck), and the deflection by this
change: in a joint that hardly moves, it passes for a skew of milliseconds."""
_SKEW_STD_S = 5e-5
"""Difference between the skews of joints that one clock samples."""
_OTHER_CLOCKS_S = 1e-4
"""Difference beyond which the joints are sampled by clocks of their own."""
TORQUE_STD = 0.03
"""Usual relative standard deviation of a rigid model's torque: link masses, centres, counterbalance."""


def identify_arm_side(
    records: MotionRecord | Sequence[MotionRecord],
    robot: RobotModel,
    *,
    band_hz: float | None = None,
    torque_std: float = TORQUE_STD,
    jackknife: bool = True,
) -> ArmSideFit:
    """Identify the stiffness of every joint with a sensor behind its gear.

    Torques come from the rigid model at the measured motion. The fit includes the skew between the
    encoders, transmission error, friction and damping in the gear, offsets, drifts and the payload. The
    error includes the choice of these terms (an average over all sensible sets, weighted by evidence)
    and the change when any part of the records is left out (jackknife): noise does not reveal a single
    disturbance that dominates the result.

    Parameters
    ----------
    records : MotionRecord or sequence of MotionRecord
        Any motion, all joints, with ``arm_rad`` of at least one. A record given twice counts once.
    robot : RobotModel
        With gear ratios; ``robot.payload.mass_std`` is the prior of the payload.
    band_hz : float, optional
        Upper edge of the band, Hz; otherwise that of each record, or 6 Hz.
    torque_std : float, default 0.03
        Relative standard deviation of the rigid model: of the mass and inertia of every link and of the
        counterbalance, which act like a payload, and of the torque, which scales K. 0 for an exact
        model. The motors' torque constants have their own standard deviation, 15 %.
    jackknife : bool, default True
        Whether the error includes the change when parts of the records or other velocities are left out;
        False saves half the time where only the prediction counts.

    Returns
    -------
    ArmSideFit
        K of every joint, N·m/rad on the joint side; NaN with a reason where undetermined.

    Raises
    ------
    JointIdError
        When no record has a sensor, a record is too short, the robot does not match, or ``torque_std``
        is negative or not finite.

    Notes
    -----
    Viscous friction F behind the gear of one joint acts like a skew of F/K; the two are not separated.
    """
    given = [records] if isinstance(records, MotionRecord) else records
    if (
        not isinstance(given, Sequence)
        or not given
        or not all(isinstance(record, MotionRecord) for record in given)
    ):
        raise JointIdError("identify_arm_side needs one or more MotionRecord values.")
    if not isinstance(robot, RobotModel):
        raise JointIdError(f"robot = {robot!r:.60}: expected a RobotModel, see RobotModel.load.")
    if band_hz is not None:
        band_hz = bounded_number("band_hz", "Hz", band_hz)
    torque_std = bounded_number("torque_std", "", torque_std, zero=True)
    if all(record.arm_rad is None for record in given):
        raise JointIdError(
            "No record has a sensor behind a gear: give arm_rad, or use identify_motion with motor data."
        )
    with one_thread():
        return _identified(distinct(given), robot, band_hz, torque_std, jackknife)


def _identified(
    given: list[MotionRecord],
    robot: RobotModel,
    band_hz: float | None,
    torque_std: float,
    jackknife: bool,
) -> ArmSideFit:
    motions = [band_limited(record, robot, band_hz) for record in given]
    sensors = np.any([np.isfinite(m.deflection).all(axis=0) for m in motions], axis=0)
    faults = sensor_faults(given, motions)
    motions = [m.without(np.array([bool(fault) for fault in faults])) for m in motions]
    elastic = [np.zeros_like(m.q) for m in motions]
    joints: list[JointDeflection | None] = [None] * robot.n
    mean: Floats = np.zeros(4)
    skew_error, settled = np.full(robot.n, np.inf), False
    for round_ in range(_MOST_ROUNDS):
        last = round_ == _MOST_ROUNDS - 1 or (settled and round_ >= _ROUNDS - 1)
        both = [joint_torque(m, robot, e) for m, e in zip(motions, elastic, strict=True)]
        torque, payload, parts = ([each[k] for each in both] for k in range(3))
        if not round_:
            for k, record in enumerate(given):
                where = record.label or f"motion record {k + 1}"
                of_record = motions[k], torque[k], payload[k], where
                faults = [f or scale_fault(j, *of_record, robot) for j, f in enumerate(faults)]
            motions = [m.without(np.array([bool(fault) for fault in faults])) for m in motions]
        parts = [torque_std * each for each in parts]
        known = given, motions, robot, torque_std, torque, payload, parts, mean
        motors = payload_from_motors(*known, zeros=last and jackknife)
        if last and jackknife:
            motors = replace(motors, reversed=reversed_joints(given, motions, robot, torque_std))
        torque, mean = [t + p @ motors.mean for t, p in zip(torque, payload, strict=True)], motors.mean
        payload = [p @ motors.root for p in payload]
        data, checked = (given, motions, torque, payload), round_ > 0 and jackknife
        joints = [
            _joint(j, *data, near, float(skew_error[j]), last, checked) for j, near in enumerate(joints)
        ]
        if last:
            break
        skew = np.array([joint.skew_s if joint else 0.0 for joint in joints])
        if round_:
            skew, skew_error = _skews(joints, skew)
        motions = [m.aligned(skew) for m in motions]
        # a sensor that the torque does not explain says nothing about the angle of the arm
        seen = np.array([not _reason(joint, True, True, False) for joint in joints])
        compliance = np.array([joint.compliance if joint else 0.0 for joint in joints])
        pairs = zip(motions, torque, strict=True)  # offsets of the sensors hide the mean deflection
        before = elastic
        elastic = [seen * (m.elastic() + compliance * t.mean(axis=0)) for m, t in pairs]
        settled = all(np.abs(a - b).max() < _SETTLED_RAD for a, b in zip(elastic, before, strict=True))
    joints = [
        joint
        and replace(
            joint, compliance_std=float(np.hypot(joint.compliance_std, torque_std * joint.compliance))
        )
        for joint in joints
    ]
    swing, weight = (
        np.concatenate([robot.torque(m.q, m.dq * on, m.ddq * on) for m in motions]).std(axis=0)
        for on in (1, 0)
    )
    shown = [
        weight[j] > _WEIGHTLESS * swing[j] or clear_moves([m.dq[:, j] for m in motions]) >= _FEWEST_MOVES
        for j in range(robot.n)
    ]
    reasons = tuple(
        faults[j]
        or (motors.reversed.refusal if sensors[j] else "")
        or _reason(joint, bool(sensors[j]), bool(shown[j]), bool(robot.is_coupled[j]))
        for j, joint in enumerate(joints)
    )
    K, error, skew, skew_error, residual = np.full((5, robot.n), np.nan)
    for j, joint in enumerate(joints):
        if joint is None:
            continue
        skew[j], skew_error[j], residual[j] = joint.skew_s, joint.skew_std_s, joint.residual_rad
        if not reasons[j]:
            K[j] = 1 / joint.compliance
            error[j] = K[j] * joint.compliance_std / joint.compliance
    return ArmSideFit(
        frozen(K), frozen(error), frozen(skew), frozen(skew_error), reasons, frozen(residual),
        robot, band_hz, tuple(joints), motors,
    )  # fmt: skip


def _skews(joints: list[JointDeflection | None], own: Floats) -> tuple[Floats, Floats]:
    """Skew of each joint, (n,), and its standard error, (n,), s; infinite where it stays free.

    Joints that agree are sampled by one clock: a joint whose own motion hardly determines its skew, or
    only together with its stiffness, takes that of the others. The spread beyond the errors is
    estimated by moments (DerSimonian and Laird 1986).
    """
    known = np.array([joint is not None for joint in joints])
    found, free = own.copy(), np.full(own.size, np.inf)
    if known.sum() < 2:
        return own, free
    value, error = own[known], np.array([joint.skew_std_s for joint in joints if joint])
    weight = error**-2.0
    excess = weight @ (value - weight @ value / weight.sum()) ** 2 - (value.size - 1)
    between = max(0.0, excess / (weight.sum() - weight @ weight / weight.sum()))
    if between > _OTHER_CLOCKS_S**2 and excess > 3 * np.sqrt(2 * (value.size - 1)):
        return own, free
    weight = 1 / (error**2 + _SKEW_STD_S**2)
    common = weight @ value / weight.sum()
    trust = _SKEW_STD_S**2 * weight
    found[known] = common + trust * (value - common)
    free[known] = np.sqrt(trust * error**2 + (1 - trust) ** 2 / weight.sum())
    return found, free


def _joint(
    j: int,
    given: list[MotionRecord],
    motions: list[BandLimited],
    torque: list[Floats],
    payload: list[Floats],
    near: JointDeflection | None,
    skew_error: float,
    last: bool,
    checked: bool,
) -> JointDeflection | None:
    sensed = [k for k, m in enumerate(motions) if np.isfinite(m.deflection[:, j]).all()]
    seen = [k for k in sensed if 1 / ALIKE < share(motions[k], j) < ALIKE]
    fastest = max((float(np.abs(motions[k].dq[:, j]).max()) for k in seen), default=0.0)
    own = {k: over_own_move(motions[k].dq[:, j], fastest) for k in seen}
    seen = [k for k in seen if own[k][motions[k].inner].max() > _SLIP]
    if not seen:
        return None
    angle = np.concatenate([motions[k].raw[motions[k].inner, j] for k in seen])
    above = np.concatenate([motions[k].above_band[motions[k].inner, j] for k in seen])
    ripple = near.ripple if near else Ripple.over(angle, tooth_orders(angle, above))
    y, columns, speed, source, progress, every = [], [], [], [], [], []
    for i, k in enumerate(seen):
        m, motor = motions[k], given[k].theta_rad[given[k].start :, j]
        terms = joint_terms(j, m, torque[k], payload[k], motor, ripple)
        step = max(1, int(1 / (8 * m.lowpass.band_hz * m.lowpass.interval_s)))
        rows = np.arange(len(m.q))[m.inner][::step]
        offset = np.zeros((len(m.q), 2 * len(seen)))
        offset[:, i], offset[:, len(seen) + i] = 1.0, np.linspace(-1.0, 1.0, len(m.q))
        if last:
            every.append((m.deflection[m.inner, j], np.hstack([terms.columns, offset])[m.inner]))
        y.append(m.deflection[rows, j])
        columns.append(np.hstack([terms.columns[rows], offset[rows]]))
        speed.append(own[k][rows])
        source.append(np.full(rows.size, i))
        moving = np.cumsum(speed[-1] > _SLIP)
        progress.append((moving - 1) / max(1, moving[-1]))
    data = Regression(np.concatenate(y), np.concatenate(columns))
    taken_out = bool(np.isfinite(skew_error))
    size = max(near.compliance, 1e-9) if near else _FIRST_COMPLIANCE
    scale = Scale(size, 0.0 if taken_out else np.inf)
    record, ratio, part_of = np.concatenate(source), np.concatenate(speed), np.concatenate(progress)
    interval, groups = step * m.lowpass.interval_s, terms.groups
    used = ratio > _SLIP
    if used.sum() < _FEWEST or not data.columns[used, 0].any():
        return None

    def fitted(rows: NDArray[np.bool_], noise: float | None = None) -> Average:
        part = Regression(data.y[rows], data.columns[rows])
        if noise is None:
            spans = (np.flatnonzero(np.diff(record[rows])) + 1).tolist()
            noise = noise_of(part, groups, spans, interval, scale)
        return average(part, groups, noise, scale)

    whole = fitted(used)
    beta, free = whole.beta, [0, groups["skew"].start]
    variance, left = np.diag(whole.covariance)[free], None
    if checked:
        spread = np.array([fitted(ratio >= slip).beta[free] - beta[free] for slip in _OTHER_SLIPS])
        variance = variance + np.sum(spread**2, axis=0) / (1 + len(_OTHER_SLIPS))
    if last:
        rest = [deflection - X @ beta for deflection, X in every]
        slow = np.concatenate([each - np.median(each) for each in rest])
        left = position_map(angle, slow, above, ripple.orders)
    parts = np.zeros(2)
    for count in _PARTS if checked else ():
        part = (part_of * count).astype(int)
        without = np.array([fitted(used & (part != k), whole.noise).beta[free] for k in range(count)])
        parts += without.var(axis=0) * (count - 1) / len(_PARTS)
    variance = np.maximum(variance, parts)
    velocity = data.columns[used, free[1]]
    slow_rad = _SLOW_FRICTION_RAD * np.mean(np.abs(velocity) < _SLOW_RAD_S)
    variance[1] += slow_rad**2 / np.mean(velocity**2)
    if taken_out:
        later = Regression(data.y + skew_error * data.columns[:, free[1]], data.columns)
        moved = average(Regression(later.y[used], later.columns[used]), groups, whole.noise, scale).beta
        variance = np.array([variance[0] + (moved[0] - beta[0]) ** 2, skew_error**2])
    residual = (data.y - data.columns @ beta)[used]
    error = np.sqrt(variance)
    return JointDeflection(
        ripple,
        beta,
        float(beta[0]),
        float(error[0]),
        float(beta[free[1]] + motions[0].skew_s[j]),
        float(motions[0].skew_s[j]),
        float(error[1]),
        float(np.sqrt(np.mean(residual**2))),
        left,
    )


def _reason(joint: JointDeflection | None, sensor: bool, shown: bool, coupled: bool) -> str:
    if not sensor:
        return "No sensor behind the gear in these records."
    if coupled:
        return (
            "Gears that couple joints are not supported: torques of other joints also deflect this one."
        )
    if joint is None:
        return "The joint moves too little, or no torque loads it: give a record with motion under load."
    relative = joint.compliance_std / abs(joint.compliance)
    if joint.compliance <= 0 or relative > LARGEST_ERROR:
        fault = "it is negative" if joint.compliance <= 0 else f"its error is {percent(relative)}"
        return (
            f"K is not identifiable from this motion: {fault}. "
            "The joint's torque varies too little, or only together with the transmission error. "
            "Move through poses with other gravity torques, or faster; check the sensor for dropouts."
        )
    if not shown:
        return (
            f"K is not identifiable from fewer than {_FEWEST_MOVES} moves: gravity does not load this "
            "joint, and the torque of its acceleration cannot be separated from transmission error and "
            "friction. Move it back and forth several times, at different speeds."
        )
    return ""
