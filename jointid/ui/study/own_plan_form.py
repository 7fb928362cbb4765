"""A plan of one's own: the table to edit, and its expected errors."""

import json
from collections.abc import Hashable
from typing import Any

import numpy as np
import streamlit as st

from jointid import Analysis, JointIdError
from jointid.analysis import NOT_USABLE
from jointid.ui.shared.charts import FEW_JOINTS, Table
from jointid.ui.shared.entries import numbers_in, numbers_out
from jointid.ui.shared.messages import markdown_escape, show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.study.plan_form import pose_inertia
from jointid.ui.study.uncertainty_panels import plus_minus
from jointid.uncertainty.information import planning_model
from jointid.uncertainty.plan import PredictedErrors, Suggestion, predict_standard_errors
from jointid.uncertainty.planned_records import PlannedRecords, phase_deg, planned_records
from jointid.uncertainty.validation import second_amplitude_record

Columns = dict[str, list[Any]]
_FREQUENCY, _LENGTH = "Frequency (Hz)", "Length (s)"
_TORQUES, _PHASES = "Torques (N·m)", "Phases (°)"
"""Columns of a plan; these hold one value per joint, as text."""
_COLUMNS = {
    _FREQUENCY: (int, float, type(None)),
    _LENGTH: (int, float, type(None)),
    _TORQUES: (str, type(None)),
    _PHASES: (str, type(None)),
}
"""Types of the cells of each column."""


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
            f'The last row repeats "{markdown_escape(analysis.phasors.labels[record])}" at half its '
            "amplitude, to decide between the gear laws."
        )
    plan = plan_of(_edited(columns, analysis.fit.n, page.digest), page, analysis, pose)
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


def columns_of(records: PlannedRecords) -> Columns:
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


def _add_repetition(columns: Columns, analysis: Analysis, record: int) -> None:
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


def _edited(suggested: Columns, joints: int, digest: str) -> Columns:
    """Let a plan be edited that begins as ``suggested``; rows can be added and deleted.

    The session keeps it for the way back to this page, the address for F5.
    """
    key = f"own_plan_{digest[:12]}"
    start, last = _start(key, suggested)
    number, text = st.column_config.NumberColumn, st.column_config.TextColumn
    edited = st.data_editor(
        start,
        num_rows="dynamic",
        hide_index=True,
        key=key,
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
    found = {str(name): list(values) for name, values in dict(edited).items()}
    st.session_state[f"{key} kept"] = suggested, start, found
    if found != last:
        if found == suggested:
            st.query_params.pop(key, None)
        else:
            st.query_params[key] = json.dumps([*found.values()], ensure_ascii=False)
    return found


def _start(key: str, suggested: Columns) -> tuple[Columns, Columns]:
    """Return what the table begins as, and the plan of the last run, empty if there is none."""
    of, start, last = st.session_state.get(f"{key} kept", (None, suggested, suggested))
    if of is None:
        last = _in_address(key) or {}
        start = last or suggested
    elif of != suggested:
        start, last = suggested, {}
    elif key not in st.session_state:  # back from another page, without the edits of the table
        start, last = last, {}
    return start, last


def _in_address(key: str) -> Columns | None:
    """Return the plan in the address; None if there is none or it is none."""
    try:
        columns = json.loads(st.query_params.get(key, ""))
        cells = zip(_COLUMNS.values(), columns, strict=True)
        right = all(isinstance(cell, types) for types, values in cells for cell in values)
        whole = len({len(values) for values in columns}) == 1
    except (ValueError, TypeError):
        return None
    return dict(zip(_COLUMNS, columns, strict=True)) if right and whole else None


def plan_of(columns: Columns, page: Page, analysis: Analysis, pose: str) -> PlannedRecords:
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
    what, given = _model(analysis, pose)
    model = page.computed(what, "Preparing the plan", planning_model, *given)
    return planned_records(
        model.inertia,
        analysis.fit.elasticity,
        np.ravel(rows[_FREQUENCY]),
        torque_Nm=np.array(rows[_TORQUES]) * np.exp(1j * np.radians(rows[_PHASES])),
        duration_s=np.ravel(rows[_LENGTH]),
    )


def begin_model(page: Page, analysis: Analysis, pose: str) -> None:
    """Start what a plan needs in addition to the suggested records, for which the search runs."""
    what, given = _model(analysis, pose)
    page.begin(what, planning_model, *given)


def _model(analysis: Analysis, pose: str) -> tuple[Hashable, tuple[Any, ...]]:
    """Name of the planning model, and what it is computed from."""
    given = analysis.phasors, analysis.study.inertias, analysis.fit, pose_inertia(analysis, pose)
    return ("planning model", pose), given


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
