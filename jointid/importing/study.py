"""From segments of logs to the records of a study."""

import datetime
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Any, cast

import numpy as np

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import log_path
from jointid.importing.find.lines import fit_lines
from jointid.importing.find.segment import Segment
from jointid.importing.find.segments import common_frequencies
from jointid.importing.map.mapped_log import MappedLog
from jointid.joints import Inertia
from jointid.phasors.extract import extract_phasors
from jointid.phasors.steady_state import steady_from, unsettled
from jointid.records import MotionRecord, SineRecord
from jointid.study import INERTIA_STD, Study
from jointid.wording import counted, shown, significant


def segment_records(
    log: MappedLog, segments: Sequence[Segment], *, pose: str | None = None
) -> tuple[SineRecord | MotionRecord, ...]:
    """Cut the records out of a log: one per segment, or one per line of a multisine segment.

    A segment of any other motion becomes a motion record, with the angles behind the gears. All are on
    the clock of the log and in one ``pose``. From the record of one line of a multisine the other lines
    are subtracted by least squares; the noise remains. Raises JointIdError when a segment is too short
    for its frequency.
    """
    records: list[SineRecord | MotionRecord] = []
    for number, segment in enumerate(segments, start=1):
        part = log.rows(segment.start_s, segment.stop_s)
        time, theta, tau = log.time_s[part], log.theta_rad[part], log.tau_Nm[part]
        signals = np.column_stack([theta, tau])
        place = f"{significant(segment.start_s)} to {significant(segment.stop_s)} s"
        shared: dict[str, Any] = {
            "time_s": time,
            "torque_hold": log.torque_hold,
            "torque_delay_s": log.torque_delay_s,
            "pose": pose,
        }
        name = f"{log.name}: {place}".removeprefix(": ")
        try:
            if segment.is_motion:
                arm = None if log.arm_rad is None else log.arm_rad[part]
                # The band is that of the motors' torques; the stiffness behind the gears has its own.
                shared |= {"arm_rad": arm, "band_hz": segment.band_hz if arm is None else None}
                records.append(MotionRecord(theta_rad=theta, tau_Nm=tau, label=name, **shared))
            for line in segment.lines_hz:
                others = [other for other in segment.lines_hz if other != line]
                label = f"{name}, {significant(line)} Hz" if others else name
                rest = signals - _other_lines(time, signals, line, others)
                q, u = np.hsplit(rest, 2)
                records.append(SineRecord(line, theta_rad=q, tau_Nm=u, label=label, **shared))
        except JointIdError as error:
            raise JointIdError(f"Run {number} ({place}): {error}") from error
    return tuple(records)


def study_from_logs(
    logs: MappedLog | Sequence[MappedLog],
    segments: Sequence[Segment] | Sequence[Sequence[Segment]],
    inertia: Inertia,
    *,
    pose_of: Sequence[str | None] | None = None,
    inertia_std: float | None = None,
    **facts: Any,
) -> Study:
    """Make a study of the segments of one or many logs.

    ``logs`` have the joints of ``inertia``, motor side; ``segments`` is one sequence for each of several
    logs. ``pose_of`` is the pose of each log; None, the default, is that of ``inertia``.
    ``inertia_std`` and ``facts`` are parameters of ``Study``; name and description are by default from
    the logs, see ``study_name``. Raises JointIdError when there is no segment, or joints disagree.
    """
    if isinstance(logs, MappedLog):
        logs, segments = [logs], cast(Sequence[Sequence[Segment]], [segments])
    each = [list(part) for part in cast(Sequence[Sequence[Segment]], segments)]
    pose_of = pose_of or [None] * len(logs)
    for what, given in (("run list", each), ("pose", pose_of)):
        if len(given) != len(logs):
            raise JointIdError(
                f"{counted(len(logs), 'log')}, but {counted(len(given), what)}: give one for each log."
            )
    if not any(each):
        raise JointIdError(
            "No sine runs or other motions were found or chosen. Mark one by its start and stop, or "
            "check the time, position and torque columns."
        )
    for log in logs:
        if log.n != inertia.n:
            raise JointIdError(
                f"{log.name or 'The log'} has {counted(log.n, 'joint')}, the inertia {inertia.n}: "
                "they must agree."
            )
    # Frequencies of all logs together, so that runs of one set point in two logs form a group.
    flat = iter(common_frequencies([segment for part in each for segment in part]))
    shared = [[next(flat) for _ in part] for part in each]
    records, trimmed = _settled(
        [
            record
            for log, part, pose in zip(logs, shared, pose_of, strict=True)
            for record in segment_records(log, part, pose=pose)
        ]
    )
    names = [log.name for log in logs if log.name]
    said = f"Imported: {run_counts([s for part in each for s in part])} of "
    said += f"{', '.join(names[:5]) or 'a log'}."
    said += f" {counted(trimmed, 'record')} trimmed to the steady state." if trimmed else ""
    facts["name"] = facts.get("name") or study_name(names)
    facts["description"] = facts.get("description") or said
    std = INERTIA_STD if inertia_std is None else inertia_std
    return Study(tuple(records), inertia, origin="measured", inertia_std=std, **facts)


def _settled(
    records: Sequence[SineRecord | MotionRecord],
) -> tuple[list[SineRecord | MotionRecord], int]:
    """Let records that the verdict would call unsettled begin later; return how many do."""
    sines = [record for record in records if isinstance(record, SineRecord)]
    later: dict[int, SineRecord] = {}
    with suppress(JointIdError):  # the analysis reports records without phasors
        moving = unsettled(extract_phasors(sines)) if sines else np.zeros(0)
        for record in (sines[k] for k in np.flatnonzero(moving)):
            if (start := steady_from(record)) is not None:
                later[id(record)] = replace(record, start_s=start)
    return [later.get(id(record), record) for record in records], len(later)


def run_counts(segments: Sequence[Segment]) -> str:
    """Return "3 sine runs and 1 motion"."""
    motions = sum(segment.is_motion for segment in segments)
    sines = len(segments) - motions
    parts = [counted(sines, "sine run")] if sines or not motions else []
    return " and ".join([*parts, *([counted(motions, "motion")] if motions else [])])


def parse_date(text: str) -> datetime.date | None:
    """Parse a date; None for an empty text. Raises JointIdError when it is not an ISO date."""
    if not text.strip():
        return None
    try:
        return datetime.date.fromisoformat(text.strip())
    except ValueError:
        raise JointIdError(
            f"{shown(text)} is not a date: write year, month and day as in 2026-11-20."
        ) from None


def study_name(logs: Sequence[str]) -> str:
    """Name a study after its logs, "cell 3" or "cell 3 and 2 more", or after their common archive.

    Names of logs are such as "cell_3.csv", "logs.zip/1.csv", "book.xlsx: Sheet1".
    """
    paths = [log_path(log) for log in logs if log]
    archives = {path.parts[0] if len(path.parts) > 1 else "" for path in paths}
    if len(archives) == 1 and any(archives):
        paths = [PurePosixPath(*archives)]
    files = list(dict.fromkeys(paths))
    if not files:
        return ""
    stem = files[0].stem.replace("_", " ")
    return stem if len(files) == 1 else f"{stem} and {len(files) - 1} more"


def _other_lines(
    time: np.ndarray, signals: np.ndarray, line: float, others: Sequence[float]
) -> np.ndarray:
    """Contribution of the other lines to each signal, shape (N, 2n)."""
    if not others:
        return np.zeros_like(signals)
    fit = fit_lines(time, signals, [line, *others], free=False)
    waves = np.exp(2j * np.pi * np.outer(time - fit.middle_s, others))
    return np.asarray((waves @ fit.phasors[1:]).imag)
