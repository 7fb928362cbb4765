"""Stiffness and damping of every joint."""

import streamlit as st

from jointid.ui.shared.page import open_page
from jointid.ui.study.elasticity_figures import show_dynamic_stiffness, show_response, show_unexplained
from jointid.ui.study.estimates import show_also_fitted, show_estimates, show_matrix
from jointid.ui.study.model_check import show_model_holds, show_poses
from jointid.ui.study.overview import show_findings, show_headline, show_tiles
from jointid.ui.study.uncertainty_panels import (
    on_demand,
    show_checks,
    show_ellipses,
    show_errors,
    show_influence,
)

page = open_page("Elasticity")
st.title("Elasticity", anchor=False)
st.write(
    "With the rigid-body inertias, every record gives each spring's deflection and transmitted torque; "
    "their ratio gives K and D. The inertias are fitted along within their uncertainty."
)
analysis = page.analysis()
show_headline(analysis)
show_tiles(analysis)
show_findings(analysis.findings)

st.subheader("How well they are known", anchor=False)
show_errors(analysis)
only_sines = not page.study.motion_records  # what follows looks at every sine by itself
if only_sines:
    show_dynamic_stiffness(page, analysis)
st.subheader("Every estimator", anchor=False)
show_estimates(analysis)
show_also_fitted(analysis.fit)
if only_sines:
    show_unexplained(page, analysis)
if analysis.transfer_matrices:
    show_response(page, analysis)

details = {
    "inertias": ("Which given inertia matters", show_influence),
    "ellipses": ("Confidence ellipses", show_ellipses),
}
if only_sines:
    with st.expander("The matrix A, its condition, and how the estimates are correlated"):
        show_matrix(analysis.fit)
    details = {"checks": ("Check the error bars", show_checks)} | details
    details["model"] = ("Does the model hold", show_model_holds)
    if len({record.pose for record in page.study.records}) > 1:
        details["poses"] = ("Every pose alone", show_poses)
for key, (label, show) in details.items():
    with on_demand(label, key) as expander:
        if expander.open:
            show(page, analysis)
