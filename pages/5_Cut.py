"""Path error before and after the identification."""

import streamlit as st

from jointid import JointIdError
from jointid.cut.robot import cut_robot
from jointid.ui.cut import cached_cuts
from jointid.ui.cut.animation import show_animation
from jointid.ui.cut.panels import (
    headline,
    show_assumptions,
    show_gears,
    show_meaning,
    show_rule,
)
from jointid.ui.cut.pictures import show_figure_7
from jointid.ui.cut.settings import ask, nominal_name
from jointid.ui.cut.time_series import show_time_series
from jointid.ui.cut.tolerance import show_tolerance
from jointid.ui.shared.messages import show_error
from jointid.ui.shared.page import open_page

page = open_page("Cut")
st.title("Cut", anchor=False)
st.write(
    "Springs bend while the arm accelerates, and the tool leaves its path unless the servo moves the "
    "motors by as much in advance. It computes this deflection x from the K̂ and D̂ that it assumes: "
    "where these are wrong, the cut is wrong."
)
st.latex(
    r"""\begin{gathered}
    \mathbf u = \mathbf M_2(\mathbf q)\,\ddot{\mathbf q} + \mathbf c(\mathbf q, \dot{\mathbf q}) \\
    \hat D_j\,\dot x_j + \hat K_j\,x_j = u_j, \qquad \theta_j = q_j + x_j
    \end{gathered}"""
)
analysis = page.analysis()
try:
    robot = cut_robot(analysis)
    settings = ask(robot, page.digest)
    outcome = cached_cuts.outcome(page.digest, page.method, settings, analysis)
    cached_cuts.offset_costs(page.digest, page.method, settings.after, outcome.robot)  # for below
except JointIdError as error:
    show_error(error)
    st.stop()
name = nominal_name(settings.assumption)
st.subheader(headline(outcome), anchor=False)
show_rule(outcome.robot)
show_animation(outcome, name, dark=page.dark)
show_meaning(outcome, settings)
show_gears(page, settings, outcome.robot)

st.subheader("Three corner zones", anchor=False)
st.caption(
    "As Figure 7 of the paper: larger zones are cut faster through the corner, which bends the springs "
    "more. Grey is the reference path; below each shape stands the largest path error."
)
show_figure_7(page, settings, outcome, name)

show_time_series(page, settings, outcome)

show_tolerance(page, settings, outcome)
show_assumptions()
