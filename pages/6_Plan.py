"""Experiment planning: the records that reduce the error bars most."""

import streamlit as st

from jointid import JointIdError
from jointid.ui.shared.charts import introduce
from jointid.ui.shared.messages import show_error
from jointid.ui.shared.page import open_page
from jointid.ui.study import own_plan_form, plan_form
from jointid.ui.study.arm_side import warn_of_sensors
from jointid.ui.study.motion_plan_form import show_motion_plan
from jointid.ui.study.overview import warn_if_unusable
from jointid.ui.study.set_points_form import show_set_points

page = open_page("Plan")
analysis = page.analysis()
warn_of_sensors(page)
warn_if_unusable(analysis)
if page.study.motion_records:  # the plan of sines needs the noise of sines
    show_motion_plan(page, analysis)
    st.stop()
introduce(
    "Records that reduce the error bars most. The search covers frequencies and relative phases of the "
    "joints, at the largest motion within the limits. It adds one record at a time, each the one that "
    "reduces the largest error most. Any controller may be used; only the resulting motion matters."
)
try:
    settings = plan_form.ask(analysis, page.digest)
except JointIdError as error:
    show_error(error)
    st.stop()
own_plan_form.begin_model(page, analysis, settings.pose)
found = plan_form.suggestion(page, settings, analysis)
if found is None:
    st.stop()
plan_form.show_suggestion(page, settings, found, analysis)

tabs = ["Your own plan", "Set points", "Motions in place of sines"]
own, set_points, motions = st.tabs(tabs, key="plan_view", bind="query-params")
try:
    with own:
        plan = own_plan_form.show_own_plan(page, found, analysis, settings.pose)
    if set_points.open:
        with set_points:
            show_set_points(page, plan, own_plan_form.content(plan), analysis, settings.pose)
except JointIdError as error:
    show_error(error)
if motions.open:
    with motions:
        show_motion_plan(page, analysis, settings, found)
