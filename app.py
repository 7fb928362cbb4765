"""The study on one screen: the answer first, then its evidence."""

from functools import partial

import streamlit as st

from jointid import Analysis
from jointid.figures import model_over_measurement
from jointid.ui.cut.cached_cuts import begin_overview
from jointid.ui.cut.panels import outcome_panel
from jointid.ui.shared.messages import show_info
from jointid.ui.shared.page import open_page
from jointid.ui.study import overview
from jointid.ui.study.arm_side import ask_for_robot, show_sensors
from jointid.ui.study.elasticity_figures import show_prediction

page = open_page("Study", heading=False)
overview.show_heading(page)
overview.show_changes(page)
analysis = page.answer(ask=partial(ask_for_robot, page))

if isinstance(analysis, Analysis):
    begin_overview(page, analysis)  # while the lines above them are shown
    overview.show_headline(analysis, page)
    overview.show_tiles(analysis)
    show_prediction(page, analysis)
    outcome_panel(page, analysis)
    overview.show_findings(page, analysis)

    st.header("Model and measurement", anchor=False)
    st.caption(
        "Acceleration of each motor over its own torque, without the effect of the controllers. Where "
        "points and line agree, the model holds." + overview.freed_note(analysis)
    )
    if analysis.transfer_matrices:
        pose = next(iter(analysis.transfer_matrices))
        page.show_per_joint(
            f"model {pose}",
            partial(model_over_measurement, analysis, pose=pose),
            "Magnitude of H{0}{0} over frequency, measured and modelled",
        )
    else:
        show_info(analysis.transfer_problem)
else:
    show_sensors(page, analysis)

st.header("Step by step", anchor=False)
overview.show_steps()
