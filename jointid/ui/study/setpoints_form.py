"""Set points of a plan: limits of the robot, check table and file."""

from collections.abc import Hashable
from typing import Any

import streamlit as st

from jointid import Analysis
from jointid.setpoints.files import FORMATS, set_points
from jointid.setpoints.from_plan import KINDS, planned_experiment
from jointid.setpoints.limit_check import check_table, require_within_limits
from jointid.setpoints.played import play
from jointid.setpoints.robot_limits import RobotLimits, limits_from_toml
from jointid.ui.shared.charts import download
from jointid.ui.shared.entries import (
    applied,
    choose_from,
    enter_number,
    enter_text,
    fill_in,
    numbers_in,
    numbers_out,
)
from jointid.ui.shared.messages import show_text_table
from jointid.ui.shared.page import Page
from jointid.uncertainty.motion_plan import PlannedMotion
from jointid.uncertainty.plan import PlannedRecords
from jointid.wording import file_stem

_LIMITS = {
    "gear_ratio": ("Gear ratios", "100, 90", "Motor turns per joint turn, negative when reversed."),
    "start_deg": ("Start pose (°), all axes", "0, -90, 90, 0, 45, 0", "As displayed by the robot."),
    "lower_deg": ("Lowest positions (°)", "-170, -100", ""),
    "upper_deg": ("Highest positions (°)", "170, 10", ""),
    "velocity_deg_s": ("Velocities (°/s)", "105, 101", "Largest velocities of the joints."),
    "acceleration_deg_s2": ("Accelerations (°/s²)", "2600, 2600", "Largest of the joints."),
    "torque_Nm": ("Motor torques (N·m)", "20, 12", "Largest torques of the motors."),
    "load_Nm": ("Motor torques at rest (N·m)", "0, 4", "Such as gravity at the start; empty: none."),
    "axes": ("Axes of the robot", "1, 2", "Axes that are the joints of the study; empty: the first."),
    "joint_names": ("Names of all axes", "joint_1, joint_2", "For ROS 2; empty: joint_1, joint_2, …"),
}
_SUPERPOSED = "Avoids sticking at reversals; every record then runs forward and back."
_OPTIONAL = ("load_Nm", "axes", "joint_names")
_NUMBERS: dict[str, tuple[Any, ...]] = {
    "scale": ("Scale of the motion", 1.0, (0.001, 100.0)),
    "repeats": ("Repeats", 1, (1, 100)),
    "ramp": ("Ramps (s)", 0.5, (0.05, 10.0)),
    "rest": ("Rest between records (s)", 1.0, (0.1, 60.0)),
}
"""Label, default and limits of each number."""
_SINES = "Sines"
_KINDS = dict(zip((_SINES, "Multisine", "Sweeps"), KINDS, strict=True))


def show_set_points(
    page: Page,
    plan: PlannedRecords | PlannedMotion,
    content: Hashable,
    analysis: Analysis,
    pose: str,
) -> None:
    """Draw the form; with limits entered, the check and the file. ``content`` identifies the plan.

    Raises
    ------
    JointIdError
        When the answer is not usable, an entry is wrong or a limit is exceeded.
    """
    analysis.require_usable()
    st.write(
        "The plan above as a motion of the joints, for the controller. It runs on the simulated robot "
        "first; a file is written only if all limits hold. Read its header before use."
    )
    sines = isinstance(plan, PlannedRecords)
    form = "setpoints" if sines else "setpoints of motions"
    ratios = analysis.study.gear_ratios
    entered = {} if ratios is None else {"gear_ratio": numbers_out(ratios)}
    keys = {name: f"{form}_{name}_{page.digest[:12]}" for name in _LIMITS if name not in entered}
    _load_limits(keys, form)
    places = [column for _ in range(4) for column in st.columns(3)]
    for place, (name, key) in zip(places, keys.items(), strict=False):
        label, example, hint = _LIMITS[name]
        entered[name] = enter_text(place, key, label, "", hint, example)
    one, two, three, four = st.columns(4)
    kind = choose_from(one, f"{form}_kind", "Motion", list(_KINDS)) if sines else _SINES
    file_format = choose_from(two, f"{form}_format", "Format", list(FORMATS), _title)
    interval_hint = "Empty: the default of the format."
    interval = enter_text(three, f"{form}_interval", "Interval (ms)", "", interval_hint)
    numbers: list[Any] = [
        enter_number(place, f"{form}_{key}", *entry)
        for place, (key, entry) in zip((four, *st.columns(3)), _NUMBERS.items(), strict=True)
    ]
    label = "Superposed velocities (°/s)"
    superposed = enter_text(st.container(), f"{form}_superposed", label, "0", _SUPERPOSED)
    choice = (entered, kind, file_format, interval, numbers, superposed)
    known = applied("Check on the simulated robot", f"{form} {page.digest}", choice)
    if known is not None:
        entered, kind, file_format, interval, numbers, superposed = known
    if known is None or not entered["gear_ratio"].strip():
        st.caption(
            "Enter gear ratios, start pose and limits: without them there is no check and no file."
        )
        return
    scale, repeats, ramp_s, rest_s = numbers
    n = analysis.fit.n
    given: dict[str, Any] = {
        name: numbers_in(_LIMITS[name][0], text, count=None if name in ("start_deg", "axes") else n)
        for name, text in entered.items()
        if name != "joint_names" and (text.strip() or name not in _OPTIONAL)
    }
    names = entered["joint_names"].split(",")
    given["joint_names"] = tuple(name.strip() for name in names if name.strip())
    robot = RobotLimits(**given, robot=analysis.study.robot)
    drift = tuple(robot.motor_velocity(numbers_in("Superposed velocities", superposed)).tolist())
    settings = {"kind": _KINDS[kind], "scale": scale, "repeats": repeats, "ramp_s": ramp_s}
    settings |= {"rest_s": rest_s, "velocity_rad_s": drift}
    inertia, fit = analysis.inertia(pose), analysis.fit
    played = page.computed(
        ("played", pose, content, *settings.values()),
        "Running on the simulated robot",
        play,
        planned_experiment(plan, inertia, fit.elasticity, **settings),
        inertia,
        fit.elasticity,
        friction=fit.friction,
    )
    (interval_ms,) = numbers_in("Interval", interval, count=1) if interval.strip() else (None,)
    points = set_points(played, robot, file_format, interval_ms=interval_ms, study=analysis.study.name)
    show_text_table(check_table(points.rows))
    st.caption(
        f"{played.experiment.duration_s:.0f} s. Positions to accelerations at the joint, torque at the "
        "motor. Peaks of the set points, and of motors and arm under simulated control and under exact "
        "following, whichever is larger. Not run on hardware."
    )
    require_within_limits(points.rows, points.scale)
    chosen = FORMATS[file_format]
    name = f"{file_stem(analysis.study.name)}_set_points{chosen.ending}"
    download(f"Save the set points ({chosen.title})", points.text, name)
    with st.expander("Header of the file"):
        st.code("\n".join(points.comments), language=None, height=360)


def _load_limits(keys: dict[str, str], form: str) -> None:
    """Fill the fields in from the file of limits that ``jointid setpoints`` reads."""
    hint = "The file that jointid setpoints --limits reads. Its values fill the fields below."
    label = "Limits and start pose (.toml), optional"
    file = st.file_uploader(label, ["toml"], key=f"{form} limits", help=hint)
    if file is None or st.session_state.get(f"{form} file") == file.file_id:
        return
    st.session_state[f"{form} file"] = file.file_id
    robot = limits_from_toml(file.getvalue(), file.name)
    for name, key in keys.items():
        value = getattr(robot, name)
        fill_in(key, ", ".join(value) if name == "joint_names" else numbers_out(value))


def _title(name: str) -> str:
    return FORMATS[name].title
