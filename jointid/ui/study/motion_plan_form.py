"""Motions of a plan: limits, expected accuracy, and their set points."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import streamlit as st

from jointid import Analysis, JointIdError, Motion
from jointid.analysis import NOT_USABLE
from jointid.arrays import Floats
from jointid.ui.shared.charts import Table, csv_of, download
from jointid.ui.shared.entries import applied, choose_from, enter_number, enter_text, numbers_in
from jointid.ui.shared.messages import show_error, show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import Show, computed_on_click, run_watched
from jointid.ui.study.plan_form import PlanSettings, pose_inertia
from jointid.ui.study.set_points_form import show_set_points
from jointid.uncertainty.motion_plan import MotionLimits, PlannedMotion, largest_motion, plan_motion
from jointid.uncertainty.plan import Suggestion
from jointid.wording import percent, three_digits

_NUMBERS: dict[str, tuple[Any, ...]] = {
    "records": ("Records", 2, (1, 20)),
    "seconds": ("Length of each (s)", 20.0, (2.0, 120.0)),
    "from": ("From (Hz)", 2.0, (0.1, 1000.0)),
    "to": ("To (Hz)", 40.0, (0.2, 2000.0)),
}
"""Label, default and limits of each number."""
_KINDS = {"sweep": "Sweeps", "multisine": "Multisines on odd lines"}


@dataclass(frozen=True)
class MotionSettings:
    """A motion to plan, and its limits per joint, motor side."""

    records: int
    seconds: float
    from_hz: float
    to_hz: float
    limits: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]
    """Position from the middle, velocity and torque."""


def _planned(settings: MotionSettings, analysis: Analysis, show: Show) -> tuple[PlannedMotion, ...]:
    study = analysis.study
    limits = MotionLimits(*(np.array(each) for each in settings.limits))
    plans = []
    known = analysis.fit, pose_inertia(analysis, study.records[0].pose or "")
    interval_s, band = study.records[0].interval_s, (settings.from_hz, settings.to_hz)
    for k, (kind, name) in enumerate(_KINDS.items()):
        what = f"{name}: simulating the robot, predicting the errors"
        motion = Motion(kind, *band, settings.seconds, odd=kind == "multisine")
        given = partial(plan_motion, interval_s=interval_s, records=settings.records)
        plans.append(run_watched(partial(show, k / len(_KINDS), what), given, *known, motion, limits))
    return tuple(plans)


def show_motion_plan(
    page: Page,
    analysis: Analysis,
    sines: PlanSettings | None = None,
    suggested: Suggestion | None = None,
) -> None:
    """Ask for the limits and show the expected accuracy of each motion.

    The limits of velocity and torque are those of the plan of ``sines``, if there is one; the motions
    are compared with the sines that are ``suggested``.
    """
    st.write(
        "The identified robot is simulated with a sweep and a multisine within your limits and with the "
        "noise of this study; the table shows the expected errors of K and D. A multisine on odd "
        "lines also separates nonlinear distortion from noise."
    )
    try:
        settings = _ask(page, analysis, sines)
    except JointIdError as error:
        show_error(error)
        return
    if settings is None:
        st.caption("Predict simulates and analyses both motions: a few seconds, longer with friction.")
        return
    plans = computed_on_click(
        ("motion plan", page.digest, page.method, settings),
        "Simulate these motions",
        "motion_plan",
        lambda show: _planned(settings, analysis, show),
        at_once=True,
    )
    if plans is None:
        return
    if analysis.state != NOT_USABLE:
        st.header(_outcome(plans, analysis, suggested), anchor=False)
    show_text_table(plan_table(plans, analysis))
    st.caption(
        "Relative standard errors. With present records: both together, with common inertias. The peaks "
        "are computed for the simulated motors and include friction."
    )
    for plan in plans:
        download(
            f"Save the {plan.motion.kind}s (.csv)",
            csv_of(plan_columns(plan)),
            f"planned_{plan.motion.kind}.csv",
            hint="Positions and torques of the simulated motors over time, record by record.",
        )
    st.subheader("Set points", anchor=False)
    names = {_KINDS[plan.motion.kind]: plan for plan in plans}
    chosen = names[choose_from(st.container(), "motion_to_write", "Planned motion", list(names))]
    pose = analysis.study.records[0].pose or ""
    try:
        show_set_points(page, chosen, (settings, chosen.motion.kind), analysis, pose)
    except JointIdError as error:
        show_error(error)


def _ask(page: Page, analysis: Analysis, sines: PlanSettings | None) -> MotionSettings | None:
    study, n = analysis.study, analysis.fit.n
    largest = largest_motion(study.records)
    numbers = [
        enter_number(place, f"motion_{key}", *entry)
        for place, (key, entry) in zip(st.columns(4), _NUMBERS.items(), strict=True)
    ]
    labels = ["Largest position, ± (rad)", "Largest velocity (rad/s)", "Largest torque (N·m)"]
    values = (largest.position_rad, largest.velocity_rad_s, largest.torque_Nm)
    if sines is not None:
        del labels[1:]
        st.caption("Velocities and torques stay within the amplitudes at the top of the page.")
    texts = [
        enter_text(place, f"motion {label} {page.digest[:12]}", label, ", ".join(f"{x:.3g}" for x in of))
        for place, label, of in zip(st.columns(3), labels, values, strict=False)
    ]
    entered = applied("Predict", f"motions {page.digest}", (numbers, texts))
    if entered is None:
        return None
    (records, seconds, low, high), texts = entered
    limits = [numbers_in(label, text, count=n) for label, text in zip(labels, texts, strict=True)]
    if sines is not None:
        limits += [sines.velocity_rad_s, sines.torque_Nm]
    if min(min(each) for each in limits) <= 0:
        raise JointIdError("The largest positions, velocities and torques must be positive numbers.")
    return MotionSettings(
        int(records), float(seconds), float(low), float(high), (limits[0], limits[1], limits[2])
    )


def _outcome(plans: tuple[PlannedMotion, ...], analysis: Analysis, suggested: Suggestion | None) -> str:
    """The worst error today and after each motion, and the time on the robot, beside that of sines."""
    ways = [(f"{plan.motion.kind}s", plan.together.max(), plan.duration_s) for plan in plans]
    if suggested is not None:
        seconds = suggested.records.duration_s.sum()
        ways.append(("the sines above", suggested.worst[-1], seconds))
    after = ", ".join(f"{percent(float(e))} with {name} ({t:.0f} s)" for name, e, t in ways)
    return f"Largest error {percent(float(analysis.fit.relative_error.max()))} → {after}"


def plan_table(plans: tuple[PlannedMotion, ...], analysis: Analysis) -> Table:
    """Length, peaks and errors of the present records, and with each motion in addition."""
    found: dict[str, list[str]] = {
        "": ["Length", "Peak velocity (rad/s)", "Peak torque (N·m)", "Largest error, alone"]
        + [f"{name} error, with present records" for name in plans[0].names]
    }
    today, records = analysis.fit.relative_error, analysis.study.records
    seconds = sum(record.samples * record.interval_s for record in records)
    columns: list[tuple[str, str, Any, Floats, Floats]] = [
        ("Present records", f"{seconds:.0f} s", records, today, today)
    ]
    for plan in plans:
        length = f"{len(plan.records)} × {plan.motion.duration_s:g} s"
        kind = _KINDS[plan.motion.kind]
        columns.append((kind, length, plan.records, plan.alone, plan.together))
    for name, length, made, alone, together in columns:
        peak = largest_motion(made)
        found[name] = [
            length,
            three_digits(peak.velocity_rad_s),
            three_digits(peak.torque_Nm),
            *(percent(float(error)) for error in (alone.max(), *together)),
        ]
    return found


def plan_columns(plan: PlannedMotion) -> Table:
    """Positions and torques over time of every record, for a file."""
    columns: dict[str, list[float]] = {"time_s": plan.records[0].time_s.tolist()}
    for number, record in enumerate(plan.records, start=1):
        for j in range(record.n):
            columns[f"record{number}_theta_m{j + 1}_rad"] = record.theta_rad[:, j].tolist()
            columns[f"record{number}_tau_m{j + 1}_Nm"] = record.tau_Nm[:, j].tolist()
    return columns
