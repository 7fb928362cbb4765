"""Stiffness and damping of every joint."""

import streamlit as st

from jointid.analysis import NOT_USABLE, Analysis, ArmSideAnalysis
from jointid.ui.shared.charts import show_tabs
from jointid.ui.shared.page import open_page
from jointid.ui.study import uncertainty_panels
from jointid.ui.study.arm_side import ask_for_robot, show_sensors
from jointid.ui.study.elasticity_figures import (
    figures,
    show_model_holds,
    show_poses,
    show_prediction,
)
from jointid.ui.study.overview import show_bands, show_findings, show_headline, show_tiles

page = open_page(
    "Elasticity",
    "The inertias and the motor data give the deflection of each gear and the torque through it. Their "
    "ratio is the dynamic stiffness K + iωD.",
)
ask_for_robot(page)
analysis = page.answer(ask=lambda: None)  # asked above
if sensors := analysis if isinstance(analysis, ArmSideAnalysis) else analysis.sensors:
    st.header("Sensors behind the gears", anchor=False)
    show_sensors(page, sensors)
motors = analysis.each.get("Motors")
if not isinstance(motors, Analysis):
    st.stop()
if sensors:
    st.header("Motors", anchor=False)
show_headline(motors, None if motors is analysis else page)
if motors is not analysis:
    show_findings(page, motors)
analysis = motors
show_tiles(analysis)
show_bands(analysis)
show_prediction(page, analysis)
show_tabs("figure", figures(page, analysis))

st.header("Details", anchor=False)
details = {
    "Error bars": lambda: uncertainty_panels.show_errors(analysis),
    "Inertias": lambda: uncertainty_panels.show_inertias(analysis),
    "Fitted model": lambda: uncertainty_panels.show_fitted_model(analysis.fit),
    "Estimators": lambda: uncertainty_panels.show_estimates(analysis),
}
if not page.study.motion_records:  # these look at every sine by itself
    details |= {
        "Model check": lambda: show_model_holds(page, analysis),
        "Bootstrap": lambda: uncertainty_panels.show_checks(page, analysis),
        "Matrix A": lambda: uncertainty_panels.show_matrix(analysis.fit),
    }
    if len({record.pose for record in page.study.records}) > 1:
        details["Poses"] = lambda: show_poses(page, analysis)
if analysis.state == NOT_USABLE:
    for name in ("Error bars", "Estimators", "Bootstrap"):
        details.pop(name, None)
show_tabs("details", details)
