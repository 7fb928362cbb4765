"""Panels of K from sensors behind the gears."""

from dataclasses import replace

import streamlit as st

from jointid import JointIdError, RobotModel
from jointid.analysis import ArmSideAnalysis
from jointid.figures import gear_deflection
from jointid.ui.shared import workspace
from jointid.ui.shared.charts import choose_joint, choose_segment, plot
from jointid.ui.shared.messages import show_error, show_text_table, show_warning
from jointid.ui.shared.method_steps import ELASTICITY
from jointid.ui.shared.page import Page
from jointid.ui.study.overview import show_findings, show_headline

_WITH_MODEL = ", with robot model"


def ask_for_robot(page: Page) -> None:
    """Take the robot model into a study that lacks it for its sensors behind the gears."""
    if not page.study.has_sensors or page.study.robot_model is not None:
        return
    st.write(
        "The study has sensors behind the gears. With the torque of the robot model they give K at the "
        "joint, from any motion. A copy of the study with the model is added to the list."
    )
    kinds = "URDF, MJCF (.xml) or Denavit–Hartenberg TOML, with gear ratios."
    key = "robot_model_of_sensors"
    file = st.file_uploader("Robot model", RobotModel.ENDINGS, max_upload_size=1, key=key, help=kinds)
    if file is None:
        return
    try:
        study = replace(page.study, robot_model=RobotModel.parse(file.name, file.getvalue()))
    except JointIdError as error:
        show_error(error)
        return
    workspace.keep(study, page.key.removesuffix(_WITH_MODEL) + _WITH_MODEL)
    st.rerun()


def warn_of_sensors(page: Page) -> None:
    """Say on a page that uses K of the motors that sensors behind the gears contradict it."""
    if title := page.answered().contradiction:
        show_warning(f"{title}. This page uses K from the motors.")
        workspace.link_to(ELASTICITY)


def show_sensors(page: Page, found: ArmSideAnalysis) -> None:
    """State, answer, values by joint, and measured and fitted deflection."""
    show_headline(found, page)
    show_text_table(found.table)
    st.caption(
        f"{found.error_bars} Skew: age of the sample behind the gear relative to that of the motor."
    )
    show_findings(page, found)
    _show_deflection(page, found)


def _show_deflection(page: Page, found: ArmSideAnalysis) -> None:
    fit, motions = found.fit, page.study.motion_records
    joints = [j for j in range(fit.robot.n) if fit.joints[j] is not None]
    measured = [k for k, record in enumerate(motions) if record.arm_rad is not None]
    if not joints:
        return
    joints.sort(key=lambda j: bool(fit.reasons[j]))  # those with K first
    j, k = choose_joint(joints, "arm_side_joint"), measured[0]
    st.caption(
        "The difference between the two encoders of a joint is the deflection of its gear."
        + " The line is the fit, which does not determine K." * bool(fit.reasons[j])
    )
    if len(measured) > 1:
        names = {k: motions[k].label or f"Motion {k + 1}" for k in measured}
        k = choose_segment("Record", measured, "arm_side_record", format_func=names.__getitem__)
    doing = "Predicting the deflection"
    time_s, deflection, fitted = page.computed(("followed", k), doing, fit.deflection, motions[k])
    plot(
        gear_deflection(time_s, deflection[:, j], fitted[:, j], dark=page.dark),
        f"Deflection of the gear of joint {j + 1} over time, measured and fitted",
        key="gear_deflection",
    )
