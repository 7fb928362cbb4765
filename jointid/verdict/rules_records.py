"""Rules of the verdict on the records: frequency, length, motion and resolution."""

import itertools
from collections.abc import Iterator

import numpy as np

from jointid.arrays import Floats
from jointid.phasors.fitted_sine import sine_basis
from jointid.phasors.sensor_steps import quantum
from jointid.phasors.steady_state import decimals, joint_share, steady_from, unsettled
from jointid.records import MotionRecord, SineRecord
from jointid.uncertainty.chosen_model import chosen_friction
from jointid.verdict.evidence import (
    Change,
    Evidence,
    Finding,
    note,
    number,
    problem,
    relative,
    some,
    warning,
)
from jointid.wording import counted, joints_text, percent

_HELD = 0.05
"""Amplitude over the joint's largest at the same frequency below which the joint counts as held."""
_STARTS = 3
"""Records for which a later start is searched, worst first."""
_COUNTS = 3.0
"""Amplitude over the encoder step below which rounding does not act like noise."""
_LOOP_STEP = 0.15
"""Encoder step over the presliding deflection from which K of a simulated robot shifted by 1 to 4 %."""
_LOOP_SHIFT = 0.03
"""Relative shift of K there."""
_EXAMINED = 4096
"""Samples in which the encoder step is searched."""
_ODD = np.uint64(0x9E3779B97F4A7C15)
"""Odd multiplier of the digest of a sample: 2⁶⁴ over the golden ratio."""
_SHARED = 0.5
"""Share of the samples of a motion that are also in another one, from which it is counted twice."""
CUT_OFF = (
    "A logged torque is clipped",
    "Log the torque with a larger range, or use smaller motions.",
)
UNSIGNED = (
    "A logged torque has no sign",
    "Log the torque with its sign: its magnitude alone does not determine K and D.",
)
_OPPOSITE = 0.02
"""Largest torque of one sign over that of the other from which a torque has both."""
_CUT, _FAR_MORE = 0.1, 4.0
"""Share of the samples at the largest torque from which its log is clipped there, and their number over
that at any smaller one: 2.4 for a sine in coarse steps."""
AT_LIMIT = f"more than {percent(_CUT)} of the samples are at the largest torque"


def wrong_frequency(evidence: Evidence) -> Iterator[Finding]:
    """The frequency of the motor angle differs from the stated one."""
    phasors, stated = evidence.phasors, evidence.frequency_hz
    concerned = off_frequency(evidence)
    if concerned:
        off = np.abs(phasors.frequency_found_hz / stated - 1)
        worst = max(concerned, key=lambda i: off[i])
        make = problem if off[worst] > 0.05 else warning
        yield make(
            "A record contradicts its stated frequency",
            f'"{phasors.labels[worst]}" states {number(stated[worst], 5)} Hz; the motor oscillates at '
            f"{number(phasors.frequency_found_hz[worst], 5)} Hz. "
            f"{_concerned(len(concerned))}",
            "Correct the frequency of the run or the unit of time on import, or frequency_hz and the "
            "column time_s of a study on disk.",
            float(off[worst]),
            "edit runs",
            Change("frequency", concerned),
        )


def off_frequency(evidence: Evidence) -> tuple[int, ...]:
    """Indices of records whose motor angle has a frequency other than the stated one."""
    found = evidence.phasors.frequency_found_hz
    off = np.abs(found / evidence.frequency_hz - 1)
    return tuple(
        int(i) for i in np.flatnonzero(off > 2e-3) if _turns_at(evidence.sines[i], found[i])
    )  # noise has a largest line, too


def still_settling(evidence: Evidence) -> Iterator[Finding]:
    """The beginning of a record differs significantly from its end."""
    phasors = evidence.phasors
    moving = unsettled(phasors)
    worst = int(np.argmax(moving))
    if moving[worst] > 0:
        concerned = np.argsort(-moving, kind="stable")[: np.count_nonzero(moving)]
        names = [f'"{phasors.labels[i]}"' for i in concerned]
        which = f"In {names[0]}"
        if len(names) > 1:
            which = f"{_concerned(len(names))[:-1]}: {some(names)}. In {names[0]}"
        steady, remedy = _later_starts(evidence, concerned[:_STARTS])
        changes = [Change("start", tuple(concerned.tolist()))] if "start_s" in remedy else []
        yield warning(
            "The motion is still settling",
            f"{which} the first quarter differs by {percent(moving[worst])} from the second half. "
            f"{steady}",
            remedy,
            float(moving[worst]),
            "edit runs" if changes else "",
            *changes,
        )


def _later_starts(evidence: Evidence, concerned: np.ndarray) -> tuple[str, str]:
    """Start of the steady state of these records, and the remedy."""
    steady, never = [], []
    for i in concerned:
        record, label = evidence.records[i], f'"{evidence.phasors.labels[i]}"'
        start = steady_from(record)
        if start is None:
            never.append(label)
        else:
            steady.append(f"{label}, from {start:.{decimals(record)}f} s on")
    parts = [f"Steady: {'; '.join(steady)}."] if steady else []
    if never:
        verb = "does" if len(never) == 1 else "do"
        parts.append(f"{'; '.join(never)} {verb} not become steady.")
    if not steady:
        return " ".join(parts), "Measure again. Wait longer before recording."
    ones = "record at this time" if len(steady) == 1 else "records at these times"
    return " ".join(parts), (
        f"Start the {ones}: set the start of the run on import, or start_s in "
        f"study.toml. {'Measure the others again. ' if never else ''}Next time: wait longer before "
        "recording."
    )


def few_periods(evidence: Evidence) -> Iterator[Finding]:
    """Records too short for an estimate of slow noise."""
    periods = evidence.phasors.duration_s * evidence.frequency_hz
    short = np.flatnonzero(periods < 2.999)
    if short.size:
        names = some([f'"{evidence.phasors.labels[i]}"' for i in short])
        yield note(
            "Some records are only a few periods long",
            f"{names}: {'at least ' * (short.size > 1)}{number(periods[short].min(), 2)} periods. Their "
            "noise is assumed white, since slow disturbances cannot be separated from the sine.",
            "Record five periods or more at every frequency.",
            1e-3 + 0.5 * _worst_error(evidence),
        )


def counted_twice(evidence: Evidence) -> Iterator[Finding]:
    """The study contains the same log more than once."""
    phasors = evidence.phasors
    z, pairs, second = phasors.z, [], set[int]()
    for _, group in phasors.by_frequency() if len(z) else ():
        for place, i in enumerate(group):
            for k in group[place + 1 :]:
                same = np.abs(z[i] - z[k]) <= 1e-12 * np.abs(z[i])
                if same.all() and np.array_equal(phasors.covariance[i], phasors.covariance[k]):
                    pairs.append(f'"{phasors.labels[i]}" and "{phasors.labels[k]}"')
                    second.add(int(k))
    motions = [record for record in evidence.records if isinstance(record, MotionRecord)]
    rows = [(record, sample_digests(record)) for record in motions]
    for (one, these), (other, those) in itertools.combinations(rows, 2):
        same = np.intersect1d(these, those, assume_unique=True).size
        if same > _SHARED * min(these.size, those.size):
            first = f'"{one.label}"' if one.label else "A record"
            pairs.append(f"{first} and " + (f'"{other.label}"' if other.label else "another one"))
    if pairs and (rows or np.any(phasors.covariance != 0)):
        yield warning(
            "A record is in the study twice",
            f"{some(pairs)} have the same samples. Counting the same data twice makes the error bars "
            "up to 30 % too small.",
            "Leave out one record of each pair on import, or delete its [[records]] entry in "
            "study.toml; or measure again.",
            0.4 * _worst_error(evidence),
            "edit runs",
            *([Change("leave out", tuple(sorted(second)))] if second else []),
        )


def sample_digests(record: MotionRecord) -> np.ndarray:
    """Digests, 8 bytes each, of the distinct samples of all angles and torques."""
    digest = np.zeros(record.time_s.size - record.start, np.uint64)
    for column in (*record.theta_rad.T, *record.tau_Nm.T):
        digest = digest * _ODD + np.ascontiguousarray(column[record.start :]).view(np.uint64)
        digest ^= digest >> np.uint64(32)
        digest *= _ODD
        digest ^= digest >> np.uint64(29)
    return np.unique(digest)


def stationary_joint(evidence: Evidence) -> Iterator[Finding]:
    """A sticking joint has no friction phasor, and its torque carries little information."""
    fit, phasors = evidence.fit, evidence.phasors
    waveforms = chosen_friction(phasors, fit)
    if waveforms is None or fit.friction is None:
        return
    stationary = waveforms.stationary
    has_friction = fit.friction.coulomb > 3 * fit.errors["coulomb"]
    held = np.flatnonzero(stationary.all(axis=0) & ~has_friction) + 1
    if held.size:
        yield note(
            f"{joints_text(held)} {'is' if held.size == 1 else 'are'} held in every record".capitalize(),
            "If a motor does not move, backlash makes its gear look softer, and may change D of "
            "the joints that move.",
            "Do not use K and D of held joints. To identify them, move each in some records.",
            0.0,
        )
    for j in np.flatnonzero(stationary.any(axis=0) & has_friction):
        names = [f'"{phasors.labels[i]}"' for i in np.flatnonzero(stationary[:, j])]
        share = len(names) / len(phasors.labels)
        make = warning if share > 0.9 else note
        yield make(
            f"Joint {j + 1} hardly moves in {len(names)} of {counted(len(phasors.labels), 'record')}",
            f"In {some(names)}, joint {j + 1} moves less than its noise or sticks most of the time: "
            f"friction of {number(fit.friction.coulomb[j], 2)} N·m balances its torque.",
            "Move all joints in every record, with different relative phases, or superpose a constant "
            "velocity.",
            0.02 * share,
        )


def constant_torque(evidence: Evidence) -> Iterator[Finding]:
    """A joint moves, but the log of its torque is one number: the sensor or the column is wrong."""
    constant = np.array([record.constant for record in evidence.records])
    n = evidence.fit.n
    for j in np.flatnonzero((constant[:, n:] & ~constant[:, :n]).any(axis=0)):
        concerned = np.flatnonzero(constant[:, n + j] & ~constant[:, j])
        record = evidence.records[int(concerned[0])]
        which = "this record" if concerned.size == 1 else "these records"
        names = some([f'"{evidence.phasors.labels[i]}"' for i in concerned])
        where = f"{concerned.size} of {counted(len(constant), 'record')}"
        yield problem(
            f"The torque of joint {j + 1} is constant in {where}",
            f"{names}: the joint moves while "
            f"tau_m{j + 1}_Nm stays at {number(float(record.tau_Nm[record.start, j]))} N·m.",
            f"Check the source of tau_m{j + 1}_Nm, or leave {which} out.",
            2.0,
            "",
            *[Change("leave out", tuple(concerned.tolist()))][: len(constant) - concerned.size],
        )


def coarse_encoder(evidence: Evidence) -> Iterator[Finding]:
    """Quantisation of the encoder dominates the noise of the angle."""
    phasors, n = evidence.phasors, evidence.fit.n
    variance = phasors.standard_deviation[:, :n] ** 2
    step = np.array([_encoder_steps(record) for record in evidence.sines])
    samples = np.array([record.samples for record in evidence.records])
    rounding = step**2 / 12 * 4 / samples[:, None]
    moved = joint_share(phasors)[:, :n] > _HELD
    for j in range(n):
        stepped = (rounding[:, j] > 0) & (variance[:, j] > 0) & moved[:, j]
        if not stepped.any():
            continue
        steps, shares = step[stepped, j], rounding[stepped, j] / variance[stepped, j]
        counts = np.abs(phasors.q[stepped, j]) / steps
        if (shares > 0.5).mean() > 0.5:
            what = "dominates the position noise"
            why = (
                f"Rounding causes {percent(min(1.0, float(np.median(shares))))} of the position's noise."
            )
        elif counts.min() < 10:
            what = "is coarse for the smallest motion"
            why = "Rounding to so few steps repeats with the motion and does not average out."
        else:
            continue
        size = float(np.median(steps))
        yield (warning if np.median(counts) < _COUNTS else note)(
            f"The encoder of joint {j + 1} {what}",
            f"Its step is {number(size, 2)} rad ({2 * np.pi / size:,.0f} counts per turn); "
            f"the smallest sine has an amplitude of {number(counts.min(), 2)} steps. {why}",
            "Use larger amplitudes at the frequencies with the smallest motion, record longer, and "
            "avoid frequencies that divide the sample rate, where the same steps repeat.",
            0.5 * _worst_error(evidence),
        )


def loop_below_steps(evidence: Evidence) -> Iterator[Finding]:
    """An encoder step that is a large part of the presliding deflection: its noise distorts the loop."""
    steps = np.median([_encoder_steps(record) for record in evidence.sines], axis=0)
    for j, gear in enumerate(evidence.fit.gears):
        if gear.hysteresis_Nm > 0 and steps[j] > _LOOP_STEP * gear.presliding_rad:
            yield warning(
                f"The encoder is coarse for the hysteresis of gear {j + 1}",
                f"Its step of {number(float(steps[j]), 2)} rad is "
                f"{percent(float(steps[j]) / gear.presliding_rad)} of the presliding deflection. "
                "Its noise distorts the computed loop: K may be a few per cent off.",
                "Use a finer encoder.",
                _LOOP_SHIFT,
            )


def is_clipped(torque: Floats) -> bool:
    """Whether many samples have the largest size, and far more than any smaller one."""
    counts = np.unique(np.abs(torque), return_counts=True)[1]
    return bool(counts.size > 1 and counts[-1] > max(_CUT * torque.size, _FAR_MORE * counts[:-1].max()))


def has_one_sign(torque: Floats) -> bool:
    """Whether a torque reaches zero and keeps its sign."""
    largest = float(np.abs(torque).max())
    opposite = min(float(torque.max()), -float(torque.min()))
    return abs(opposite) < _OPPOSITE * largest


def _concerned(count: int) -> str:
    return f"{counted(count, 'record')} {'is' if count == 1 else 'are'} affected."


def _turns_at(record: SineRecord, found_hz: float) -> bool:
    """Whether a sine of the frequency found fits clearly better than one of the stated frequency."""
    time = record.time_s[record.start :] - record.time_s[record.start]
    theta = record.theta_rad[record.start :]
    angle = theta[:, np.argmax(np.ptp(theta, axis=0))]
    left = []
    for frequency in (record.frequency_hz, found_hz):
        turn = 2 * np.pi * frequency * time
        columns = sine_basis(turn, time)
        left.append(np.sum((angle - columns @ np.linalg.lstsq(columns, angle, rcond=None)[0]) ** 2))
    # The largest of N noise lines is 2 ln N; 25 more are five standard deviations.
    return bool(left[0] - left[1] > (25 + 2 * np.log(time.size)) * left[1] / time.size)


def _encoder_steps(record: SineRecord) -> Floats:
    """Encoder step of each joint, averaged over the record to remove rounding, rad; 0 without steps."""
    steps = np.zeros(record.n)
    for j, angle in enumerate(record.theta_rad[record.start : record.start + _EXAMINED].T):
        if (step := quantum(angle)) > 0:
            counts = np.rint(np.diff(angle) / step)
            steps[j] = np.diff(angle) @ counts / (counts @ counts)
    return steps


def _worst_error(evidence: Evidence) -> float:
    """Largest relative standard error of K and D."""
    return float(min(1.0, relative(evidence.fit.standard_error, evidence.fit.estimate).max()))
