"""Set points of a plan: limits of the robot, check table and file."""

from collections.abc import Hashable
from typing import Any

import numpy as np
import streamlit as st

from jointid import Analysis, JointIdError
from jointid.arrays import Floats
from jointid.setpoints.files import set_points
from jointid.setpoints.formats import FORMATS
from jointid.setpoints.from_plan import KINDS, planned_experiment
from jointid.setpoints.limit_check import check_table, require_within_limits
from jointid.setpoints.robot_limits import RobotLimits, coupling_problem, limits_from_toml
from jointid.setpoints.simulated_experiment import SimulatedExperiment, simulate_experiment
from jointid.ui.shared.charts import download
from jointid.ui.shared.entries import (
    applied,
    choose_from,
    enter_number,
    enter_text,
    numbers_in,
    numbers_out,
)
from jointid.ui.shared.messages import show_error, show_info, show_text_table, show_warning
from jointid.ui.shared.page import Page
from jointid.uncertainty.chosen_model import identified_friction
from jointid.uncertainty.motion_plan import PlannedMotion
from jointid.uncertainty.planned_records import PlannedRecords
from jointid.wording import enumerated, file_stem, significant

_LIMITS = {
    "gear_ratio": (
        "Gear ratios",
        "100, 90",
        "Motor turns per joint turn, negative if they turn in opposite directions.",
    ),
    "start_deg": ("Start pose (°), all axes", "0, -90, 90, 0, 45, 0", "As displayed by the robot."),
    "lower_deg": ("Lowest positions (°)", "-150, -80", ""),
    "upper_deg": ("Highest positions (°)", "150, 60", ""),
    "velocity_deg_s": ("Velocities (°/s)", "100, 90", "Largest velocities of the joints."),
    "acceleration_deg_s2": ("Accelerations (°/s²)", "2000, 1500", "Largest accelerations."),
    "torque_Nm": ("Motor torques (N·m)", "10, 8", "Largest torques of the motors."),
    "load_Nm": (
        "Motor torques at rest (N·m)",
        "0, 4",
        "From gravity in the start pose. Empty: that of the robot model, or none without a model.",
    ),
    "axes": ("Axes of the robot", "1, 2", "Axes that are joints of the study; empty: the first ones."),
    "joint_names": ("Names of all axes", "joint_1, joint_2", "For ROS 2; empty: joint_1, joint_2, …"),
}
_AMPLIFIED = 1.3
"""Peak over the planned amplitude above which a warning is shown."""
_SUPERPOSED = "Avoids sticking at reversals; every record then runs forward and back."
_OPTIONAL = ("load_Nm", "axes", "joint_names")
_PLAYED: dict[str, tuple[Any, ...]] = {
    "scale": ("Motion scale", 1.0, (0.001, 100.0), "Factor on all amplitudes."),
    "repeats": ("Repeats", 1, (1, 100)),
    "ramp": ("Ramps (s)", 0.5, (0.05, 10.0)),
    "rest": ("Rest between records (s)", 1.0, (0.1, 60.0)),
}
"""Label, default and limits of each number."""
_SINES = "Sines"
_FORMS = dict(zip((_SINES, "Multisine", "Sweeps"), KINDS, strict=True))


def show_set_points(
    page: Page,
    plan: PlannedRecords | PlannedMotion,
    content: Hashable,
    analysis: Analysis,
    pose: str,
) -> None:
    """Draw the form; with limits entered, the check and the file. ``content`` identifies the plan.

    Raises JointIdError when the answer is not usable or an entry is wrong.
    """
    analysis.require_usable()
    if problem := coupling_problem(analysis.study):
        show_info(problem)
        return
    st.write(
        "The plan above as a motion of the joints, for the controller. It is first simulated, with "
        "exact following and with a controller; a file is written only if the whole motion, with ramps "
        "and load at rest, stays within the limits of the robot. Amplitudes are limited by the plan. "
        "Read the header of the file before use."
    )
    sines = isinstance(plan, PlannedRecords)
    ratios = analysis.study.gear_ratios
    entered = {} if ratios is None else {"gear_ratio": numbers_out(ratios)}
    keys = {name: f"setpoints_{name}_{page.digest[:12]}" for name in _LIMITS if name not in entered}
    _load_limits(keys)
    places = [column for _ in range(0, len(keys), 3) for column in st.columns(3)]
    for place, (name, key) in zip(places, keys.items(), strict=False):
        label, example, hint = _LIMITS[name]
        if name == "start_deg" and pose in analysis.study.pose_angles_rad:
            example = numbers_out(np.degrees(analysis.study.pose_angles_rad[pose]).round(3))
        elif name == "axes":
            example = numbers_out(range(1, analysis.fit.n + 1))
        elif analysis.fit.n != 2 and name not in ("start_deg", "joint_names"):
            example = example.partition(",")[0]  # one for all
        entered[name] = enter_text(place, key, label, "", hint, example)
    *first, two, three, four = st.columns(4 if sines else 3)
    kind = choose_from(first[0], "setpoints_kind", "Motion", list(_FORMS)) if sines else _SINES
    titles = {name: each.title for name, each in FORMATS.items()}
    file_format = choose_from(two, "setpoints_format", "Format", list(FORMATS), titles.__getitem__)
    interval_hint = "Empty: the default of the format."
    interval = enter_text(three, "setpoints_interval", "Interval (ms)", "", interval_hint)
    numbers: list[Any] = [
        enter_number(place, f"setpoints_{key}", *entry)
        for place, (key, entry) in zip((four, *st.columns(3)), _PLAYED.items(), strict=True)
    ]
    drift_entry = "setpoints_superposed", "Superposed velocities (°/s)", "0", _SUPERPOSED
    superposed = enter_text(st.container(), *drift_entry)
    choice = (entered, kind, file_format, interval, numbers, superposed)
    known = applied("Check on the simulated robot", f"setpoints {page.digest} {sines}", choice)
    entered, kind, file_format, interval, numbers, superposed = known or choice
    if known is None:
        ratios_too = "gear ratios, " if ratios is None else ""
        st.caption(
            f"Enter {ratios_too}start pose and limits: without them there is no check and no file. "
            "A limit is one value per joint, or one for all."
        )
        return
    needed = [name for name in _LIMITS if name not in _OPTIONAL and not entered[name].strip()]
    if needed:
        labels = enumerated([f'"{_LIMITS[name][0]}"' for name in needed])
        raise JointIdError(f"Not checked. Enter {labels}.")
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
    robot.require_gears_of(analysis.study)
    drift = tuple(robot.motor_velocity(numbers_in("Superposed velocities", superposed)).tolist())
    settings = {"kind": _FORMS[kind], "scale": scale, "repeats": repeats, "ramp_s": ramp_s}
    settings |= {"rest_s": rest_s, "velocity_rad_s": drift}
    fit = analysis.fit
    robot, inertia = robot.on_robot(analysis.study, pose, analysis.inertia(pose))
    simulated = page.computed(
        ("simulated", pose, content, *settings.values(), *robot.start_deg.tolist()),
        "Running on the simulated robot",
        simulate_experiment,
        planned_experiment(plan, inertia, fit.elasticity, **settings),
        inertia,
        fit.elasticity,
        friction=identified_friction(fit),
    )
    (interval_ms,) = numbers_in("Interval", interval, count=1) if interval.strip() else (None,)
    points = set_points(
        simulated, robot, file_format, interval_ms=interval_ms, study=analysis.study.name
    )
    above = st.container()  # the answer, above the evidence
    show_text_table(check_table(points.rows))
    st.caption(
        f"{simulated.experiment.duration_s:.0f} s. Position, velocity and acceleration at the joint, "
        "torque at the motor. Each peak is the largest of set points, simulated control and exact "
        "following, for motors and arm. Peaks may exceed the planned amplitudes: the controller, ramps, "
        "friction, holding torque and, in a multisine, coinciding sine peaks add to them. "
        "Not run on hardware."
    )
    try:
        require_within_limits(points.rows, points.scale)
    except JointIdError as error:
        show_error(error, above)
        return
    above.success("All limits are met.")
    if isinstance(plan, PlannedRecords):
        planned = {
            "torque": (np.abs(plan.torque_Nm).max(axis=0) + simulated.coulomb_Nm, "N·m"),
            "velocity": (plan.velocity_rad_s.max(axis=0), "rad/s at the motor"),
        }
        with above:
            show_amplified(simulated, planned, scale)
    chosen = FORMATS[file_format]
    name = f"{file_stem(analysis.study.name)}_set_points{chosen.ending}"
    download(f"Save the set points ({chosen.title})", points.text, name)
    with st.expander("Header of the file"):
        st.code("\n".join(points.comments), language=None, height=360)


def show_amplified(
    simulated: SimulatedExperiment, planned: dict[str, tuple[Floats, str]], scale: float
) -> None:
    """Warn where the peaks of a quantity exceed the planned amplitudes, (n,) with their unit."""
    for quantity, (amplitude, unit) in planned.items():
        peaks = [each for each in simulated.peaks if each.quantity == quantity]
        values = np.array([np.abs(each.values).max(axis=0) for each in peaks])
        ratio = np.divide(values, scale * amplitude, out=np.zeros_like(values), where=amplitude > 0)
        k, j = np.unravel_index(ratio.argmax(), ratio.shape)
        if ratio[k, j] > _AMPLIFIED:
            show_warning(
                f"The {quantity} of joint {j + 1} reaches {significant(float(values[k, j]))} {unit} "
                f"({peaks[k].source}), {significant(float(ratio[k, j]), 2)} × the planned amplitude: "
                "ramps or the position controller excite a resonance. If this is too much, reduce the "
                "motion scale."
            )


def _load_limits(keys: dict[str, str]) -> None:
    """Fill the fields in from the file of limits that ``jointid setpoints`` reads."""
    hint = "The file that jointid setpoints --limits reads. Its values fill the fields below."
    label = "Limits of the robot and start pose (.toml), optional"
    file = st.file_uploader(label, ["toml"], key="setpoints limits", help=hint, max_upload_size=1)
    if file is None or st.session_state.get("setpoints file") == file.file_id:
        return
    st.session_state["setpoints file"] = file.file_id
    robot = limits_from_toml(file.getvalue(), file.name)
    for name, key in keys.items():
        value = getattr(robot, name)
        text = ", ".join(value) if name == "joint_names" else numbers_out(value)
        st.session_state[key] = text  # of an entry that is drawn later in this run
