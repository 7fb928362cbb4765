"""Planning of motions: limits, and the expected accuracy of a sweep and a multisine."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import streamlit as st

from jointid import Analysis, JointIdError, Motion
from jointid.ui.shared.charts import Table, csv_of, download
from jointid.ui.shared.entries import applied, choose_from, enter_number, enter_text, numbers_in
from jointid.ui.shared.messages import show_error, show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import Show, computed_on_click, run_in_background
from jointid.ui.study.plan_form import percent, pose_inertia
from jointid.ui.study.setpoints_form import show_set_points
from jointid.uncertainty.motion_plan import MotionLimits, PlannedMotion, largest_motion, plan_motion
from jointid.wording import significant

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
    for k, (kind, name) in enumerate(_KINDS.items()):
        show(k / len(_KINDS), f"{name}: simulating the robot, predicting the errors")
        motion = Motion(
            kind, settings.from_hz, settings.to_hz, settings.seconds, odd=kind == "multisine"
        )
        plans.append(
            run_in_background(
                plan_motion,
                analysis.fit,
                pose_inertia(analysis, study.records[0].pose or ""),
                motion,
                limits,
                interval_s=study.records[0].interval_s,
                records=settings.records,
            )
        )
    return tuple(plans)


def show_motion_plan(page: Page, analysis: Analysis) -> None:
    """Ask for the limits and show the expected accuracy of each motion."""
    st.write(
        "The identified robot is simulated with a sweep and a multisine within your limits and with the "
        "noise of this study; the table shows the expected errors of K and D. A multisine on odd "
        "lines also separates nonlinear distortion from noise."
    )
    try:
        settings = _ask(page, analysis)
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
    show_text_table(plan_table(plans))
    st.caption(
        "Relative standard errors. Together: with the records so far, with shared inertias. The peaks "
        "are those of the simulated motors and contain friction."
    )
    for plan in plans:
        download(
            f"Save the {plan.motion.kind}s (.csv)",
            csv_of(plan_columns(plan)),
            f"planned_{plan.motion.kind}.csv",
            hint="Angles and torques of the simulated motors over time, record by record.",
        )
    st.subheader("Set points", anchor=False)
    names = {_KINDS[plan.motion.kind]: plan for plan in plans}
    chosen = names[choose_from(st.container(), "motion_to_write", "Planned motion", list(names))]
    pose = analysis.study.records[0].pose or ""
    try:
        show_set_points(page, chosen, (settings, chosen.motion.kind), analysis, pose)
    except JointIdError as error:
        show_error(error)


def _ask(page: Page, analysis: Analysis) -> MotionSettings | None:
    study, n = analysis.study, analysis.fit.n
    largest = largest_motion(study.records)
    numbers = [
        enter_number(place, f"motion_{key}", *entry)
        for place, (key, entry) in zip(st.columns(4), _NUMBERS.items(), strict=True)
    ]
    labels = ("Largest angle, ± (rad)", "Largest velocity (rad/s)", "Largest torque (N·m)")
    values = (largest.position_rad, largest.velocity_rad_s, largest.torque_Nm)
    texts = [
        enter_text(place, f"motion {label} {page.digest[:12]}", label, ", ".join(f"{x:.3g}" for x in of))
        for place, label, of in zip(st.columns(3), labels, values, strict=True)
    ]
    entered = applied("Predict", f"motions {page.digest}", (numbers, texts))
    if entered is None:
        return None
    (records, seconds, low, high), texts = entered
    limits = [numbers_in(label, text, count=n) for label, text in zip(labels, texts, strict=True)]
    if min(min(each) for each in limits) <= 0:
        raise JointIdError("The largest angles, velocities and torques must be positive numbers.")
    return MotionSettings(
        int(records), float(seconds), float(low), float(high), (limits[0], limits[1], limits[2])
    )


def plan_table(plans: tuple[PlannedMotion, ...]) -> Table:
    """One row per motion: duration, peaks and errors."""
    peaks = [largest_motion(plan.records) for plan in plans]
    columns: dict[str, list[str]] = {
        "Motion": [_KINDS[plan.motion.kind] for plan in plans],
        "Duration": [f"{len(p.records)} × {significant(p.motion.duration_s, 3)} s" for p in plans],
        "Peak velocity (rad/s)": [_listed(peak.velocity_rad_s) for peak in peaks],
        "Peak torque (N·m)": [_listed(peak.torque_Nm) for peak in peaks],
        "Worst error alone": [percent(float(plan.alone.max())) for plan in plans],
        "Worst error together": [percent(float(plan.together.max())) for plan in plans],
    }
    for k, name in enumerate(plans[0].names):
        columns[f"{name} together"] = [percent(float(plan.together[k])) for plan in plans]
    return columns


def plan_columns(plan: PlannedMotion) -> Table:
    """Angles and torques over time of every record, for a file."""
    columns: dict[str, list[float]] = {"time_s": plan.records[0].time_s.tolist()}
    for number, record in enumerate(plan.records, start=1):
        for j in range(record.n):
            columns[f"record{number}_theta_m{j + 1}_rad"] = record.theta_rad[:, j].tolist()
            columns[f"record{number}_tau_m{j + 1}_Nm"] = record.tau_Nm[:, j].tolist()
    return columns


def _listed(values: np.ndarray) -> str:
    return ", ".join(significant(float(value), 3) for value in values)
