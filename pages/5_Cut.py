"""Path error before and after the identification."""

import streamlit as st

from jointid import JointIdError
from jointid.analysis import USABLE
from jointid.cut.path_deflection import has_own_path
from jointid.cut.robot import NOMINAL_NAMES, cut_robot, demonstration
from jointid.ui.cut import cached_cuts, panels
from jointid.ui.cut.details import show_time_series, show_tolerance, show_tool_stiffness
from jointid.ui.cut.pictures import show_animation, show_figure_7
from jointid.ui.cut.settings import ask_or_last
from jointid.ui.shared.charts import show_tabs
from jointid.ui.shared.messages import show_error
from jointid.ui.shared.method_steps import OVERVIEW
from jointid.ui.shared.page import open_page
from jointid.ui.shared.workspace import link_to
from jointid.ui.study.arm_side import warn_of_sensors

page = open_page("Cut")
analysis = page.analysis()
warn_of_sensors(page)
if has_own_path(analysis):
    panels.show_own_path(page, analysis)
    st.header("Tool stiffness", anchor=False)
    show_tool_stiffness(page, analysis, demonstration())
    about = "Demonstration: the paper's cut by an arm of two joints, not by this robot"
    if not st.toggle(about, key="cut_demonstration", bind="query-params"):
        st.stop()
stage = st.container()  # the drawing, above the controls
try:
    robot = cut_robot(analysis)
    settings = ask_or_last(robot, page.digest, analysis.unit)
    outcome = cached_cuts.outcome(page, settings, analysis)
except JointIdError as error:
    show_error(error)
    if analysis.state != USABLE:
        link_to(OVERVIEW, f"{OVERVIEW.name}: findings and remedies")
    st.stop()
name = NOMINAL_NAMES[settings.assumption]
with stage:
    st.header(panels.headline(outcome), anchor=False)
    show_animation(outcome, name, dark=page.dark)
panels.show_gears(page, settings, outcome)
panels.show_meaning(outcome, settings, analysis)

show_tabs(
    "cut_details",
    {
        "Corner zones": lambda: show_figure_7(page, settings, outcome, name),
        "Over time": lambda: show_time_series(page, settings, outcome),
        "Tool stiffness": lambda: show_tool_stiffness(page, analysis, robot),
        "Accuracy of K": lambda: show_tolerance(page, settings, outcome),
        "Assumptions": panels.show_assumptions,
    },
)
