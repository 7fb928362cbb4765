"""Experiment planning: limits, suggested records, and a custom plan."""

from dataclasses import dataclass
from functools import partial

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import Analysis, Inertia, JointIdError
from jointid.analysis import NOT_USABLE
from jointid.arrays import Floats
from jointid.figures.uncertainty import worst_error
from jointid.ui.shared.charts import NO_POSE, Table, csv_of, download
from jointid.ui.shared.entries import applied, choose_from, enter_number, enter_text, numbers_in
from jointid.ui.shared.messages import show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import computed_on_click, run_in_background
from jointid.uncertainty.plan import Suggestion, highest_logged_hz, suggest_records
from jointid.uncertainty.planned_records import phase_deg, phasor_text
from jointid.uncertainty.validation import second_amplitude
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
    highest_hz: float
    pose: str = ""


def ask(analysis: Analysis, digest: str) -> PlanSettings:
    """Draw the form; the limits are at first the largest amplitudes of the study.

    Raises JointIdError when the entry is no list of positive numbers.
    """
    study, n = analysis.study, analysis.fit.n
    torque, velocity = largest_so_far(analysis)
    one, two, three = st.columns(3)
    four, five = st.columns(2)
    count = enter_number(one, "plan_count", "Records", 3, (1, 50))
    seconds = enter_number(two, "plan_seconds", "Length of each (s)", 4.0, (0.1, 600.0))
    most_hz = highest_logged_hz(study.records, analysis.phasors)
    hint = "Default: a quarter of the sample rate. Set points at 4 ms allow 50 Hz, at 8 ms 25 Hz."
    name = "Highest frequency"
    highest = enter_text(three, f"plan_highest_{digest[:12]}", f"{name} (Hz)", f"{most_hz:.6g}", hint)
    label, of = "Torque amplitudes up to (N·m)", "at the motors, friction included"
    torques = _ask_limits(four, f"plan_torque_{digest[:12]}", label, torque, of)
    label, of = "Velocity amplitudes up to (rad/s)", "of motor and arm, motor side"
    velocities = _ask_limits(five, f"plan_velocity_{digest[:12]}", label, velocity, of)
    st.caption(
        "The limits apply to the planned sines, if followed exactly. Ramps and the controller can cause "
        "higher peaks: the tab Set points checks them against the limits of the robot."
    )
    pose = ""
    if study.poses:
        used = {record.pose or "" for record in study.records}
        poses = [*(("",) if "" in used else ()), *study.poses]
        pose = choose_from(st.container(), "plan_pose", "Pose", poses, lambda p: p or NO_POSE)
    entered = (count, seconds, highest, torques, velocities, pose)
    entered = applied("Suggest", f"plan {digest}", entered, at_first=True) or entered
    count, seconds, highest, torques, velocities, pose = entered
    (highest_hz,) = numbers_in(name, highest, count=1)
    limits = (
        numbers_in("Torque amplitudes", torques, count=n),
        numbers_in("Velocity amplitudes", velocities, count=n),
    )
    if min(*limits[0], *limits[1]) <= 0 or not np.isfinite(limits).all():
        raise JointIdError("The amplitudes of torque and velocity must be positive numbers.")
    if not 0 < highest_hz < np.inf:
        raise JointIdError(f"{name}: {highest} Hz; expected a positive number.")
    return PlanSettings(int(count), float(seconds), *limits, min(highest_hz, most_hz), pose)


def _ask_limits(place: DeltaGenerator, key: str, label: str, largest: Floats, of: str) -> str:
    """Ask for one amplitude per joint; a study's limits are its own, so ``key`` holds its digest."""
    hint = f"One per joint, {of}. Default: the largest of the study."
    return enter_text(place, key, label, ", ".join(f"{x:.3g}" for x in largest), hint)


_WORST = "Largest error afterwards"


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
            highest_hz=settings.highest_hz,
            planned_inertia=pose_inertia(analysis, settings.pose),
            progress=lambda done: show(done, "Comparing records at every frequency and phase"),
        ),
        at_once=True,
    )


def show_suggestion(page: Page, settings: PlanSettings, found: Suggestion, analysis: Analysis) -> None:
    """Show the suggested records with the errors that they leave, and offer them as a file."""
    before, after = (float(found.worst[k]) for k in (0, -1))
    usable = analysis.state != NOT_USABLE
    gain = f": largest error {percent(before)} → {percent(after)}" * usable
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
        what = "Largest relative error over the number of records added"
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
