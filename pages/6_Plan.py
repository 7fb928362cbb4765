"""Experiment planning: the records that reduce the error bars most."""

from functools import partial

import streamlit as st

from jointid import JointIdError
from jointid.analysis import NOT_USABLE
from jointid.figures.uncertainty import worst_error
from jointid.ui.shared.charts import csv_of, download, introduce
from jointid.ui.shared.messages import show_error, show_text_table
from jointid.ui.shared.page import open_page
from jointid.ui.study import plan_form
from jointid.ui.study.motion_plan_form import show_motion_plan, show_set_points
from jointid.uncertainty.validation import second_amplitude
from jointid.wording import counted, percent

_LARGE_GAIN = (
    " Such a large gain is plausible: these records are at frequencies and phases where the motion "
    "depends most on K and D, usually close to a resonance, and the records so far determine the "
    "inertias. The prediction is as good as the model."
)
page = open_page("Plan")
analysis = page.analysis()
if analysis.state == NOT_USABLE:
    show_error(analysis.headline)
if page.study.motion_records:  # the plan of sines needs the noise of sines
    show_motion_plan(page, analysis)
    st.stop()
introduce(
    "Records that reduce the error bars most. The search covers frequencies and relative phases of the "
    "joints, at the largest motion within the limits. It takes the record that reduces the worst error "
    "most, then the next one. Any controller may be used; only the resulting motion matters."
)
try:
    settings = plan_form.ask(analysis, page.digest)
except JointIdError as error:
    show_error(error)
    st.stop()
found = plan_form.suggestion(page, settings, analysis)
if found is None:
    st.stop()
count = settings.count
before, after = (float(found.worst[k]) for k in (0, -1))
gain = f": worst error {percent(before)} → {percent(after)}" * (analysis.state != NOT_USABLE)
st.header(f"{counted(count, 'additional record')}{gain}", anchor=False)
if not gain:
    st.caption("Predicted with K and D that are not usable: a guide to frequencies, not to errors.")
show_text_table(plan_form.suggested_table(found))
for advice in filter(None, (analysis.limit_of_records(found.worst), second_amplitude(analysis.fit))):
    st.info(advice)
st.caption(
    "Torques: amplitude ∠ phase relative to the first driven joint"
    + (", without the friction of the motors." if analysis.fit.friction is not None else ".")
    + " The errors include noise, inertias and torque scale, as in the study."
    + _LARGE_GAIN * (before > 2 * after)
)
download(
    "Save these records (.csv)",
    lambda: csv_of(plan_form.suggested_columns(found)),
    "next_records.csv",
    hint="With the motor angles, for a controller that follows positions.",
)
what = "Worst relative error over the number of records added"
page.show(f"worst {settings}", partial(worst_error, found), what)

tabs = ["Your own plan", "Set points", "Motions in place of sines"]
own, set_points, motions = st.tabs(tabs, key="plan_view", bind="query-params")
try:
    with own:
        plan = plan_form.show_own_plan(page, found, analysis, settings.pose)
    if set_points.open:
        with set_points:
            show_set_points(page, plan, plan_form.content(plan), analysis, settings.pose)
except JointIdError as error:
    show_error(error)
if motions.open:
    with motions:
        show_motion_plan(page, analysis, settings)
