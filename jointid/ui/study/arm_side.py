"""Stiffness from sensors behind the gears."""

from hashlib import sha256

import numpy as np
import streamlit as st

from jointid import ArmSideFit, JointIdError, RobotModel, Study
from jointid.analysis import analyse_arm_side
from jointid.figures import gear_deflection
from jointid.ui.shared.background import run_in_background
from jointid.ui.shared.charts import choose_segment, plot
from jointid.ui.shared.messages import show_error, show_text_table
from jointid.ui.shared.page import Page

_ENDINGS = ("toml", "urdf", "xml")


@st.cache_resource(max_entries=16, show_spinner="Evaluating the sensors behind the gears")
def _fitted(digest: str, model: str, _study: Study, _robot: RobotModel | None) -> ArmSideFit:
    return run_in_background(analyse_arm_side, _study, _robot)


@st.cache_resource(max_entries=64, show_spinner=False)
def _predicted(digest: str, model: str, record: int, _study: Study, _fit: ArmSideFit) -> np.ndarray:
    return _fit.predict(_study.motion_records[record])


def show_arm_side(page: Page) -> None:
    """K of every joint with a sensor behind its gear; nothing for studies without one."""
    study = page.study
    measured = [k for k, record in enumerate(study.motion_records) if record.arm_rad is not None]
    if not measured:
        return
    st.header("Sensors behind the gears", anchor=False)
    st.write(
        "The angle between the two encoders of a joint is the wind-up of its gear. With the torque of "
        "the robot's model it gives K at the joint, from any motion."
    )
    robot, model, file = study.robot_model, "", None
    if robot is None:
        kinds = "URDF, MJCF (.xml) or Denavit-Hartenberg TOML, with gear ratios."
        file = st.file_uploader("Robot model", _ENDINGS, help=kinds)
        if file is None:
            return
    try:
        if file is not None:
            model = sha256(file.getvalue()).hexdigest()
            robot = RobotModel.parse(file.name, file.getvalue())
        fit = _fitted(page.digest, model, study, robot)
    except JointIdError as error:
        show_error(error)
        return
    show_text_table(fit.table)
    st.caption(
        "± one standard error: noise, choice of terms, payload, and 3 % of the model's torque. Skew: "
        "age of the arm sensor's sample against the motor's."
    )
    joints = np.flatnonzero(np.isfinite(fit.skew_s)).tolist()
    if not joints:
        return
    j = choose_segment("Joint", joints, "arm_side_joint", format_func=lambda j: f"Joint {j + 1}")
    k = measured[0]
    if len(measured) > 1:
        k = choose_segment("Record", measured, "arm_side_record", format_func=lambda k: _label(study, k))
    record = study.motion_records[k]
    assert record.arm_rad is not None
    predicted = _predicted(page.digest, model, k, study, fit)
    used = slice(record.start, None)
    deflection = (record.theta_rad @ fit.robot.coupling.T - record.arm_rad)[used, j]
    plot(
        gear_deflection(record.time_s[used], deflection, predicted[used, j], dark=page.dark),
        f"Deflection of the gear of joint {j + 1} over time, measured and fitted",
        key="gear_deflection",
    )


def _label(study: Study, k: int) -> str:
    return study.motion_records[k].label or f"Motion {k + 1}"
