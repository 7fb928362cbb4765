"""A log by form: columns of numbers become one record of a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
import streamlit as st

from jointid import Inertia, JointIdError, SineRecord, Study
from jointid.arrays import Floats
from jointid.rounding import plain
from jointid.spectrum import largest_line_hz
from jointid.ui.numbers_in import matrix_in, numbers_in

Columns = Mapping[str, Floats]

_TIME_UNITS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6}
_ANGLE_UNITS = {"rad": 1.0, "°": np.pi / 180}
_HINTS = {
    "time": ("time", "zeit", "t"),
    "position": ("theta", "position", "angle", "pos", "ist"),
    "torque": ("tau", "torque", "effort", "moment"),
}


@dataclass(frozen=True)
class Mapped:
    """Which columns are what, and in which unit."""

    time: str
    positions: tuple[str, ...]
    torques: tuple[str, ...]
    time_unit_s: float
    angle_unit_rad: float


@dataclass(frozen=True, eq=False)
class Experiment:
    """What a log does not say of itself."""

    frequency_hz: float
    inertia: Inertia
    start_s: float
    torque_hold: bool


def choose_columns(columns: Columns) -> Mapped:
    """Ask which column is what; names that say it are proposed."""
    names = list(columns)
    first, second, third = st.columns(3)
    joints = int(first.number_input("Joints", 1, 6, 1, key="import_joints"))
    time = second.selectbox("Time", names, index=_guess(names, "time", 0), key="import_time")
    unit = third.selectbox("Unit of time", list(_TIME_UNITS), key="import_time_unit")
    positions: list[str] = []
    torques: list[str] = []
    left, right = st.columns(2)
    for j in range(joints):
        taken = [time, *positions, *torques]
        at = _guess(names, "position", j, taken)
        positions.append(
            left.selectbox(f"Position of joint {j + 1}", names, index=at, key=f"import_position_{j}")
        )
        at = _guess(names, "torque", j, [*taken, positions[-1]])
        label = f"Torque of joint {j + 1} (N·m)"
        torques.append(right.selectbox(label, names, index=at, key=f"import_torque_{j}"))
    angle = left.selectbox("Unit of position", list(_ANGLE_UNITS), key="import_angle_unit")
    return Mapped(time, tuple(positions), tuple(torques), _TIME_UNITS[unit], _ANGLE_UNITS[angle])


def signals(columns: Columns, mapped: Mapped) -> tuple[Floats, Floats, Floats]:
    """Return time (N,), positions and torques (N, n) in SI units, without rows that miss a value."""
    time = columns[mapped.time] * mapped.time_unit_s
    theta = np.column_stack([columns[name] for name in mapped.positions]) * mapped.angle_unit_rad
    tau = np.column_stack([columns[name] for name in mapped.torques])
    complete = np.isfinite(np.column_stack([time, theta, tau])).all(axis=1)
    if not complete.any():
        raise JointIdError(
            f"No row has all of {mapped.time}, position and torque: choose other columns."
        )
    return time[complete], theta[complete], tau[complete]


def proposed_frequency_hz(time_s: Floats, theta_rad: Floats) -> float | None:
    """Return the largest spectral line of the position that moves most, or None when there is none."""
    try:
        moving = int(np.argmax(np.ptp(theta_rad, axis=0)))
        return largest_line_hz(time_s, theta_rad[:, moving])
    except JointIdError:
        return None


def ask_rest(file: str, joints: int, proposed_hz: float | None) -> Experiment | None:
    """Ask for frequency, timing and inertias; None until the form is sent.

    Raises
    ------
    JointIdError
        When something is missing or is no inertia.
    """
    with st.form("import", border=False):
        left, middle, right = st.columns(3)
        frequency = left.number_input(
            "Frequency of the sine (Hz)",
            min_value=0.0,
            value=None if proposed_hz is None else round(proposed_hz, 4),
            format="%.4f",
            key=f"import_frequency_{file}_{proposed_hz}",
            help="Proposed: the largest line in the spectrum of the position. Correct it if need be.",
        )
        M = middle.text_input(
            "Rotor inertias M (kg·m²)", key="import_M", placeholder="0.0025", persist_state="session"
        )
        M2 = right.text_input(
            "Arm inertia M2 (kg·m²), rows separated by ;",
            key="import_M2",
            placeholder="0.0041" if joints == 1 else "0.0041, 0.0004; 0.0004, 0.0019",
            persist_state="session",
            help="The method takes the rigid-body inertias, seen from the motors, as known. "
            "K and D are as right as they are.",
        )
        start = left.number_input(
            "Settled from (s)", value=0.0, key="import_start", help="Earlier rows are kept but not used."
        )
        held = st.checkbox(
            "The torque is held from sample to sample, as by a digital controller",
            key="import_held",
            persist_state="session",
        )
        if not st.form_submit_button("Make a study of it", type="primary"):
            return None
    if not frequency:
        raise JointIdError("Frequency of the sine: a positive number of Hz is needed.")
    if not M.strip() or not M2.strip():
        raise JointIdError(
            "The inertias are missing: give M and M2 of the joints, motor side, in kg·m². "
            "K and D cannot be found without them."
        )
    inertia = Inertia(numbers_in("Rotor inertias M", M), matrix_in("Arm inertia M2", M2))
    if inertia.n != joints:
        raise JointIdError(
            f"The inertias are those of {inertia.n} joint(s), the log has {joints}: make them agree."
        )
    return Experiment(float(frequency), inertia, float(start), held)


def imported_study(
    file: str, experiment: Experiment, time_s: Floats, theta_rad: Floats, tau_Nm: Floats
) -> Study:
    """Make a study of one record.

    Raises
    ------
    JointIdError
        When the samples are no sine record.
    """
    record = SineRecord(
        frequency_hz=experiment.frequency_hz,
        time_s=time_s,
        theta_rad=theta_rad,
        tau_Nm=tau_Nm,
        torque_hold=experiment.torque_hold,
        start_s=max(experiment.start_s, float(time_s[0])),
        label=file,
    )
    return Study(
        records=(record,),
        inertia=experiment.inertia,
        name=PurePath(file).stem.replace("_", " "),
        origin="measured",
        description=f"Imported from {file}: one record at {plain(experiment.frequency_hz)} Hz.",
    )


def _guess(names: Sequence[str], what: str, joint: int, taken: Sequence[str] = ()) -> int:
    """Place of the column whose name says what it is; the joint-th of them when there are several."""
    free = [k for k, name in enumerate(names) if name not in taken]
    for hint in _HINTS[what]:
        fitting = [k for k in free if _says(names[k], hint)]
        if fitting:
            numbered = [k for k in fitting if str(joint + 1) in names[k]]
            return (numbered or fitting)[0]
    return (free or [0])[0]


def _says(name: str, hint: str) -> bool:
    lowered = name.lower()
    return lowered == hint if len(hint) == 1 else lowered.startswith(hint) or f" {hint}" in lowered
