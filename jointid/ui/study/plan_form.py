"""Experiment planning: limits, suggested records, and an own plan."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import Analysis, Inertia, JointIdError
from jointid.analysis import NOT_USABLE
from jointid.arrays import Floats
from jointid.figures.uncertainty import worst_error
from jointid.ui.shared.charts import FEW_JOINTS, NO_POSE, Table, csv_of, download
from jointid.ui.shared.entries import (
    applied,
    choose_from,
    enter_number,
    enter_text,
    numbers_in,
    numbers_out,
)
from jointid.ui.shared.messages import markdown_escape, show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import computed_on_click, run_in_background
from jointid.ui.study.uncertainty_panels import plus_minus
from jointid.uncertainty.information import planning_model
from jointid.uncertainty.plan import (
    PredictedErrors,
    Suggestion,
    predict_standard_errors,
    suggest_records,
)
from jointid.uncertainty.planned_records import PlannedRecords, phase_deg, phasor_text, planned_records
from jointid.uncertainty.validation import second_amplitude, second_amplitude_record
from jointid.wording import counted, percent, significant, three_digits

_LARGE_GAIN = (
    " Such a large gain is plausible: these records are at frequencies and phases where the motion "
    "depends most on K and D, usually close to a resonance, and the records so far determine the "
    "inertias. The prediction assumes that the model is right."
)


@dataclass(frozen=True)
class PlanSettings:
    """Limits of the planned records."""

    count: int
    seconds: float
    torque_Nm: tuple[float, ...]
    """Largest torque amplitude of each joint, friction included."""
    velocity_rad_s: tuple[float, ...]
    """Largest velocity amplitude of each joint, of motor and arm, seen from the motor."""
    pose: str = ""


def ask(analysis: Analysis, digest: str) -> PlanSettings:
    """Draw the form; the limits are at first the largest amplitudes of the study.

    Raises JointIdError when the entry is no list of positive numbers.
    """
    study, n = analysis.study, analysis.fit.n
    torque, velocity = largest_so_far(analysis)
    one, two, three, four = st.columns(4)
    count = enter_number(one, "plan_count", "Records", 3, (1, 50))
    seconds = enter_number(two, "plan_seconds", "Length of each (s)", 4.0, (0.1, 600.0))
    label, of = "Torque amplitudes up to (N·m)", "at the motors, friction included"
    torques = _ask_limits(three, f"plan_torque_{digest[:12]}", label, torque, of)
    label, of = "Velocity amplitudes up to (rad/s)", "of motor and arm, motor side"
    velocities = _ask_limits(four, f"plan_velocity_{digest[:12]}", label, velocity, of)
    st.caption(
        "The limits apply to the planned sines, if followed exactly. Ramps and the controller can cause "
        "higher peaks: the tab Set points checks them against the limits of the robot."
    )
    pose = ""
    if study.poses:
        used = {record.pose or "" for record in study.records}
        poses = [*(("",) if "" in used else ()), *study.poses]
        pose = choose_from(st.container(), "plan_pose", "Pose", poses, lambda p: p or NO_POSE)
    entered = (count, seconds, torques, velocities, pose)
    entered = applied("Suggest", f"plan {digest}", entered, at_first=True) or entered
    count, seconds, torques, velocities, pose = entered
    limits = (
        numbers_in("Torque amplitudes", torques, count=n),
        numbers_in("Velocity amplitudes", velocities, count=n),
    )
    if min(*limits[0], *limits[1]) <= 0 or not np.isfinite(limits).all():
        raise JointIdError("The amplitudes of torque and velocity must be positive numbers.")
    return PlanSettings(int(count), float(seconds), *limits, pose=pose)


def _ask_limits(place: DeltaGenerator, key: str, label: str, largest: Floats, of: str) -> str:
    """Ask for one amplitude per joint; a study's limits are its own, so ``key`` holds its digest."""
    hint = f"One per joint, {of}. Default: the largest of the study."
    return enter_text(place, key, label, ", ".join(f"{x:.3g}" for x in largest), hint)


_WORST = "Worst error afterwards"
_FREQUENCY, _LENGTH = "Frequency (Hz)", "Length (s)"
_TORQUES, _PHASES = "Torques (N·m)", "Phases (°)"
"""Columns of a plan; the latter hold one value per joint, as text."""


def largest_so_far(analysis: Analysis) -> tuple[Floats, Floats]:
    """Largest amplitudes of torque, and of velocity of motor or arm, each of shape (n,).

    That of the arm is calculated from the torques, and not used if the answer is not usable.
    """
    fit, omega = analysis.fit, analysis.phasors.omega[:, None]
    angle = np.abs(fit.phasors.q)
    if analysis.state != NOT_USABLE:
        angle = np.maximum(angle, np.abs(fit.phasors.q - fit.equations.deflection))
    return np.abs(analysis.phasors.tau).max(axis=0), (omega * angle).max(axis=0)


def pose_inertia(analysis: Analysis, pose: str) -> Inertia:
    """Return the given inertia that planned records have."""
    return analysis.study.poses[pose] if pose else analysis.study.inertia


def suggestion(page: Page, settings: PlanSettings, analysis: Analysis) -> Suggestion | None:
    """Choose the records that reduce the worst error bar most; None after an error or a stop."""
    interval_s = max(record.interval_s for record in analysis.study.records)
    return computed_on_click(
        ("plan", page.digest, page.method, settings),
        "Search for the records",
        "plan_search",
        lambda show: run_in_background(
            suggest_records,
            analysis.phasors,
            analysis.study.inertias,
            analysis.fit,
            count=settings.count,
            duration_s=settings.seconds,
            torque_limit_Nm=settings.torque_Nm,
            velocity_limit_rad_s=settings.velocity_rad_s,
            highest_hz=0.25 / interval_s,
            planned_inertia=pose_inertia(analysis, settings.pose),
            progress=lambda done: show(done, "Comparing records at every frequency and phase"),
        ),
        at_once=True,
    )


def show_suggestion(page: Page, settings: PlanSettings, found: Suggestion, analysis: Analysis) -> None:
    """Show the suggested records with the errors that they leave, and offer them as a file."""
    before, after = (float(found.worst[k]) for k in (0, -1))
    usable = analysis.state != NOT_USABLE
    gain = f": worst error {percent(before)} → {percent(after)}" * usable
    st.header(f"{counted(settings.count, 'additional record')}{gain}", anchor=False)
    if not usable:
        st.caption("Predicted with K and D that are not usable: correct the study before you measure.")
    columns = suggested_table(found)
    show_text_table({name: columns[name] for name in columns if usable or name != _WORST})
    advice = analysis.limit_of_records(found.worst), second_amplitude(analysis.fit)
    for text in filter(None, advice if usable else ()):
        st.info(text)
    st.caption(
        "Torques: amplitude ∠ phase relative to the first driven joint"
        + (", without the friction of the motors." if analysis.fit.friction is not None else ".")
        + " The errors include noise, inertias and torque scale, as in the study." * usable
        + _LARGE_GAIN * (usable and before > 2 * after)
    )
    download(
        "Save these records (.csv)",
        lambda: csv_of(suggested_columns(found)),
        "next_records.csv",
        hint="With the motor positions, for a controller that follows positions.",
    )
    if usable:
        what = "Worst relative error over the number of records added"
        page.show(f"worst {settings}", partial(worst_error, found), what)


def suggested_table(found: Suggestion) -> Table:
    """One row per record, for reading; a cell holds the values of all motors, and a phone wraps it."""
    records = found.records
    turned, _ = records.relative
    worst = found.relative_error.argmax(axis=1)[1:]
    return {
        "Frequency (Hz)": [significant(f, 4) for f in records.frequency_hz.tolist()],
        "Motor torques (N·m)": [
            ", ".join(phasor_text(y).replace(" ", "\u00a0") for y in row) for row in turned.tolist()
        ],
        "Motor velocities (rad/s)": [three_digits(row) for row in records.velocity_rad_s.tolist()],
        "Length (s)": [f"{s:g}" for s in records.duration_s.tolist()],
        _WORST: [
            f"{found.names[k]} {'± ' * bool(np.isfinite(e))}{percent(e)}"
            for k, e in zip(worst, found.worst[1:].tolist(), strict=True)
        ],
    }


def suggested_columns(found: Suggestion) -> Table:
    """The same as plain numbers with motor positions, for a file."""
    records = found.records
    columns: dict[str, list[float]] = {"frequency_hz": records.frequency_hz.tolist()}
    for what, unit, values in zip(("torque", "angle"), ("Nm", "rad"), records.relative, strict=True):
        for j in range(values.shape[1]):
            columns[f"{what}_m{j + 1}_{unit}"] = np.abs(values[:, j]).tolist()
            columns[f"{what}_m{j + 1}_phase_deg"] = phase_deg(values[:, j]).tolist()
    for j, speed in enumerate(records.velocity_rad_s.T):
        columns[f"velocity_m{j + 1}_rad_s"] = speed.tolist()
    columns["duration_s"] = records.duration_s.tolist()
    columns["worst_relative_error_after"] = found.worst[1:].tolist()
    return columns


def show_own_plan(page: Page, found: Suggestion, analysis: Analysis, pose: str) -> PlannedRecords:
    """Let a plan be edited, show its expected errors and return it.

    Raises JointIdError when a cell is empty, or the plan is no experiment.
    """
    usable = analysis.state != NOT_USABLE
    st.write(
        "Change the records, add some, or delete some: frequency f (Hz), length t (s), amplitudes τ "
        "(N·m) and phases φ (°) of the motors' torques, one per joint."
        + " The table below shows the expected accuracy."
        * usable
    )
    columns = columns_of(found.records)
    if (record := repeated_record(analysis, pose)) is not None:
        _add_repetition(columns, analysis, record)
        st.write(
            f"The last row repeats {markdown_escape(analysis.phasors.labels[record])} at half its "
            "amplitude, to decide between the gear laws."
        )
    plan = plan_of(_edit_plan(columns, analysis.fit.n, page.digest), page, analysis, pose)
    if not usable:
        return plan
    errors = page.computed(
        ("own plan", pose, content(plan)),
        "Predicting the errors",
        predict_standard_errors,
        plan,
        analysis.phasors,
        analysis.study.inertias,
        analysis.fit,
        planned_inertia=pose_inertia(analysis, pose),
    )
    show_text_table(predicted_table(errors, analysis))
    st.caption(
        f"K and D {analysis.unit.side}. This plan alone: as if its records were the whole study. Both "
        "together: its records in addition to those of the study."
    )
    return plan


def columns_of(records: PlannedRecords) -> dict[str, list[Any]]:
    """Frequency, length, torques and phases of records as the columns of a plan, rounded."""
    turned, _ = records.relative
    return {
        _FREQUENCY: [float(f"{f:.4g}") for f in records.frequency_hz],
        _LENGTH: [float(f"{t:.3g}") for t in records.duration_s],
        _TORQUES: [numbers_out(float(f"{x:.3g}") for x in row) for row in np.abs(turned)],
        _PHASES: [numbers_out(row) for row in phase_deg(turned).round()],
    }


def repeated_record(analysis: Analysis, pose: str) -> int | None:
    """Return the record to repeat at half its amplitude, if one of this pose settles a doubt."""
    record = second_amplitude_record(analysis.fit)
    if record is None or (analysis.study.records[record].pose or "") != pose:
        return None
    return record


def _add_repetition(columns: dict[str, list[Any]], analysis: Analysis, record: int) -> None:
    """Add a record to a plan at half its amplitude."""
    phasors = analysis.fit.phasors  # without the friction of the motors
    planned = PlannedRecords(
        phasors.omega[[record]] / (2 * np.pi),
        phasors.tau[[record]] / 2,
        phasors.q[[record]] / 2,
        phasors.duration_s[[record]],
    )
    for name, values in columns_of(planned).items():
        columns[name] += values
    columns[_FREQUENCY][-1] = float(f"{planned.frequency_hz[0]:.9g}")  # the same, not a near one


def _edit_plan(start: dict[str, list[Any]], joints: int, digest: str) -> dict[str, list[Any]]:
    """Let a plan be edited that begins as ``start``; rows can be added and deleted."""
    number, text = st.column_config.NumberColumn, st.column_config.TextColumn
    edited = st.data_editor(
        start,
        num_rows="dynamic",
        hide_index=True,
        key=f"own_plan_{digest[:12]}",
        # A phone shows all columns: the values of all joints share a cell, of many in several lines.
        row_height=35 if joints <= FEW_JOINTS else 64,
        column_config={
            _FREQUENCY: number("f", width=50, help=_FREQUENCY, format="%.4g", required=True),
            _LENGTH: number("t", width=40, help=_LENGTH, format="%.4g", required=True),
            _TORQUES: text("τ", width=105, help=_TORQUES, required=True),
            _PHASES: text("φ", width=95, help=_PHASES, required=True),
        },
        alt="Your own plan",
    )
    return {str(name): list(values) for name, values in dict(edited).items()}


def plan_of(columns: dict[str, list[Any]], page: Page, analysis: Analysis, pose: str) -> PlannedRecords:
    """Return the records of a plan's columns.

    Raises JointIdError when a cell is empty or wrong, or the plan is no experiment.
    """
    if not columns[_FREQUENCY]:
        raise JointIdError("The plan has no records: add a row.")
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in columns}
    for name, values in columns.items():
        count = analysis.fit.n if name in (_TORQUES, _PHASES) else 1
        for row, value in enumerate(values, start=1):
            if value is None or value != value or not str(value).strip():  # NaN: a number left out
                raise JointIdError(f"Row {row} of the plan: {name} is empty.")
            rows[name].append(numbers_in(f"Row {row} of the plan, {name}", str(value), count=count))
    given = analysis.phasors, analysis.study.inertias, analysis.fit, pose_inertia(analysis, pose)
    model = page.computed(("planning model", pose), "Preparing the plan", planning_model, *given)
    return planned_records(
        model.inertia,
        analysis.fit.elasticity,
        np.ravel(rows[_FREQUENCY]),
        torque_Nm=np.array(rows[_TORQUES]) * np.exp(1j * np.radians(rows[_PHASES])),
        duration_s=np.ravel(rows[_LENGTH]),
    )


def content(plan: PlannedRecords) -> tuple[float, ...]:
    """All numbers of a plan, as a key of what depends on it."""
    parts = (plan.frequency_hz, plan.duration_s, plan.torque_Nm.real, plan.torque_Nm.imag)
    return tuple(np.concatenate([part.ravel() for part in parts]).tolist())


def predicted_table(errors: PredictedErrors, analysis: Analysis) -> Table:
    """Error bars today, as everywhere else, with the plan alone, and with both."""
    today = analysis.quantities
    return {
        "": [found.heading for found in today],
        "Now": [found.shown[0] for found in today],
        "This plan alone": plus_minus(analysis.unit.shown(errors.planned)),
        "Both together": plus_minus(analysis.unit.shown(errors.together)),
    }
