"""Changes to a study that may remedy a finding: from a study to a study that lists the change.

The data as logged are never changed: the new study holds corrected copies of the records concerned.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.phasors.extract import extract_phasors
from jointid.phasors.long_records import LongRecord
from jointid.phasors.steady_state import steady_from
from jointid.records import JointRecord, MotionRecord, SineRecord
from jointid.study import Study
from jointid.verdict.evidence import Change, ChangeKind
from jointid.wording import capitalised, counted, enumerated, listed, minus, plain, significant

_STEPS = 4
"""Steps of the search for a frequency; each reduces the difference to a tenth or less."""
_Record = SineRecord | MotionRecord


def corrected(study: Study, change: Change) -> Study:
    """Return the study with a change made, and a sentence on it at the end of ``changes``.

    ``study`` is that of the finding that proposes the change. Raises JointIdError when the change is not
    possible, such as a later start of a record that never becomes steady, or a record that is read in
    parts.
    """
    made, sentence = _CHANGES[change.kind][0](study, change)
    return replace(made, changes=(*study.changes, sentence))


def label(study: Study, change: Change) -> str:
    """Return a change in a few words, as an instruction: "Leave out 05.csv"."""
    return _CHANGES[change.kind][1](study, change)


def _start(study: Study, change: Change) -> tuple[Study, str]:
    records = {k: study.records[k] for k in _concerned(study, change)}
    sines = {k: record for k, record in records.items() if isinstance(record, SineRecord)}
    starts = {k: at for k, record in sines.items() if (at := steady_from(record)) is not None}
    if not starts:
        raise JointIdError("No part of these records is steady: wait longer before recording.")
    begin = {k: f"{_name(study, k)} at {start:.6g} s" for k, start in starts.items()}
    each = _each(study, starts, lambda record, start: replace(record, start_s=start))
    return each, f"Later start, at the steady state: {listed(begin.values())}."


def _frequency(study: Study, change: Change) -> tuple[Study, str]:
    found = {k: _measured_frequency(study.records[k]) for k in _concerned(study, change)}
    stated = [
        f"{_name(study, k)} {hertz:.6g} Hz (stated: {study.records[k].excitation})"
        for k, hertz in found.items()
    ]
    each = _each(study, found, lambda record, hertz: replace(record, frequency_hz=hertz))
    return each, f"Frequency as measured: {listed(stated)}."


def _measured_frequency(record: Any) -> float:
    """Frequency of the motor angle; a step of the sine fit leaves a part of a large difference."""
    for _ in range(_STEPS):
        record = replace(record, frequency_hz=float(extract_phasors([record]).frequency_found_hz[0]))
    return float(record.frequency_hz)


def _leave_out(study: Study, change: Change) -> tuple[Study, str]:
    left = set(_concerned(study, change))
    kept = [record for k, record in enumerate(study.records) if k not in left]
    names = listed([_name(study, k) for k in sorted(left)])
    return replace(study, records=tuple(kept)), f"Left out: {names}."


def _delay(study: Study, change: Change) -> tuple[Study, str]:
    delays = _delays(study, change)
    before = _milliseconds({k: record.torque_delay_s for k, record in enumerate(study.records)})
    each = _each(study, delays, lambda record, delay: replace(record, torque_delay_s=delay))
    return each, f"Torque delay set to {_milliseconds(delays)} (before: {before})."


def _hold(study: Study, change: Change) -> tuple[Study, str]:
    hold = bool(change.values[0])
    each = dict.fromkeys(_concerned(study, change), hold)
    words = "held until the next sample" if hold else "not held"
    made = _each(study, each, lambda record, held: replace(record, torque_hold=held))
    return made, f"Torque set to {words}."


def _scale(study: Study, change: Change) -> tuple[Study, str]:
    angle, torque = np.split(np.array(change.values), 2)
    concerned = _concerned(study, change)

    def scaled(record: Any, _: object) -> Any:
        return replace(record, theta_rad=record.theta_rad / angle, tau_Nm=record.tau_Nm / torque)

    made = _each(study, dict.fromkeys(concerned), scaled)
    names = listed([_name(study, k) for k in concerned])
    where = f" in {names}" if change.records else ""
    return made, f"{capitalised(_factors(change.values))}{where}."


def _order(study: Study, change: Change) -> tuple[Study, str]:
    column, n = np.array(change.values, int), study.inertia.n

    def reordered(record: Any, _: object) -> Any:
        both = np.concatenate([record.theta_rad, record.tau_Nm], axis=1)[:, column]
        return replace(record, theta_rad=both[:, :n], tau_Nm=both[:, n:])

    made = _each(study, dict.fromkeys(_concerned(study, change)), reordered)
    return made, f"{capitalised(_exchange(change.values))}."


def _shift(study: Study, change: Change) -> tuple[Study, str]:
    late = np.array(change.values, int)
    most = int(late.max())

    def moved(record: Any, _: object) -> Any:
        kept = len(record.time_s) - most
        signals = {k: getattr(record, k, None) for k in ("theta_rad", "tau_Nm", "arm_rad")}
        columns = {
            name: np.column_stack([values[k : k + kept, j] for j, k in enumerate(late.tolist())])
            for name, values in signals.items()
            if values is not None
        }
        return replace(record, time_s=record.time_s[:kept], **columns)

    made = _each(study, dict.fromkeys(_concerned(study, change)), moved)
    return made, f"{_earlier(change.values)}."


def _inertias(study: Study, change: Change) -> tuple[Study, str]:
    found = change.inertias
    given = {"": study.inertia, **study.poses}
    made = replace(
        study,
        inertia=found.get("", study.inertia),
        poses={name: found.get(name, pose) for name, pose in study.poses.items()},
        pose_angles_rad={name: q for name, q in study.pose_angles_rad.items() if name not in found},
        inertia_std=change.values[0] if change.values else study.inertia_std,
    )
    before = [
        f"{name or '[inertia]'} M = {_list(given[name].M)}, M2 = {_list(given[name].M2)}"
        for name in found
    ]
    return made, f"M and M2 as fitted to these records. As given: {listed(before)} (kg·m²)."


_Make = Callable[[Study, Change], tuple[Study, str]]
_Label = Callable[[Study, Change], str]
_CHANGES: Mapping[ChangeKind, tuple[_Make, _Label]] = {
    "start": (_start, lambda study, change: f"Start {_some(study, change)} at the steady state"),
    "frequency": (
        _frequency,
        lambda study, change: f"Use the measured frequency of {_some(study, change)}",
    ),
    "leave out": (_leave_out, lambda study, change: f"Leave out {_some(study, change)}"),
    "delay": (
        _delay,
        lambda study, change: f"Set the torque delay to {_milliseconds(_delays(study, change))}",
    ),
    "hold": (
        _hold,
        lambda _, change: f"Treat the torque as {'held' if change.values[0] else 'not held'}",
    ),
    "scale": (
        _scale,
        lambda study, change: (
            capitalised(_factors(change.values))
            + (f" in {_some(study, change)}" if change.records else "")
        ),
    ),
    "order": (_order, lambda _, change: capitalised(_exchange(change.values))),
    "shift": (_shift, lambda _, change: _earlier(change.values)),
    "inertias": (_inertias, lambda *_: "Accept the fitted inertias"),
}
"""Each change with its label."""


def _concerned(study: Study, change: Change) -> list[int]:
    """Places in ``study.records`` of the records concerned, in the order of the change."""
    sines = [k for k, record in enumerate(study.records) if isinstance(record, SineRecord)]
    return [sines[k] for k in change.records] if change.records else list(range(len(study.records)))


def _each(study: Study, values: Mapping[int, Any], make: Callable[[Any, Any], _Record]) -> Study:
    """Return the study with ``make(record, value)`` in place of the records concerned."""
    records = list(study.records)
    for k, value in values.items():
        if isinstance(records[k], LongRecord):
            raise JointIdError(
                f"{_name(study, k)} is read in parts and cannot be changed here: correct its table or "
                "its entry in study.toml."
            )
        records[k] = make(records[k], value)
    return replace(study, records=tuple(records))


def _name(study: Study, k: int) -> str:
    record: JointRecord = study.records[k]
    return record.label or f"record {k + 1}"


def _some(study: Study, change: Change) -> str:
    names = [_name(study, k) for k in _concerned(study, change)]
    return names[0] if len(names) == 1 else counted(len(names), "record")


def _delays(study: Study, change: Change) -> dict[int, float]:
    return {k: study.records[k].torque_delay_s + sum(change.values) for k in _concerned(study, change)}


def _milliseconds(delays: Mapping[int, float]) -> str:
    return enumerated([minus(f"{1e3 * delay:.4g}") for delay in sorted(set(delays.values()))]) + " ms"


def _factors(values: tuple[float, ...]) -> str:
    """Instruction for the scales of all channels, logged over true."""
    n, parts = len(values) // 2, dict[str, list[str]]()
    for k, value in enumerate(values):
        if value != 1:
            verb, size = ("multiply", 1 / value) if abs(value) < 1 else ("divide", value)
            by = "" if abs(value) == 1 else f" by {significant(abs(size), 4)}"
            how = f"{verb} {{}}{by}" if value > 0 else "reverse {}" + (by and f" and {verb}{by}")
            what = f"the {'position' if k < n else 'torque'} of joint {k % n + 1}"
            parts.setdefault(how, []).append(what)
    return "; ".join(how.format(enumerated(what)) for how, what in parts.items())


def _exchange(values: tuple[float, ...]) -> str:
    """Instruction for a new order of the channels."""
    order, n = np.array(values, int), len(values) // 2
    moved = np.flatnonzero(order != np.arange(2 * n))
    signals = [name for name, k in (("positions", 0), ("torques", 1)) if np.any(moved // n == k)]
    joints = enumerated([f"{k + 1}" for k in np.unique(moved % n)])
    return f"swap the {enumerated(signals)} of joints {joints}"


def _earlier(values: tuple[float, ...]) -> str:
    """Instruction for joints that are moved in time."""
    each = [f"joint {j + 1} by {counted(int(k), 'sample')}" for j, k in enumerate(values) if k]
    return f"Move {enumerated(each)} to earlier times"


def _list(values: Floats) -> str:
    return "[" + ", ".join(_list(x) if np.ndim(x) else plain(float(x)) for x in values) + "]"
