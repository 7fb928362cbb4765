"""The robot without its controllers."""

import streamlit as st

from jointid.ui.shared.charts import introduce
from jointid.ui.shared.messages import show_warning
from jointid.ui.shared.page import open_page
from jointid.ui.study.data_quality import choose_element, choose_pose, show_element, show_how_well_known
from jointid.ui.study.overview import warn_if_unusable

page = open_page("Transfer matrix")
n = page.study.inertia.n
if n > 1:
    introduce(
        "A single record shows a motor's acceleration over its torque including the controllers of the "
        "other joints, which may add a resonance. Several records with different torques at the same "
        "frequency give the transfer matrix H of the robot alone."
    )
else:
    introduce(
        "H is the motor's acceleration over its torque. With a single joint, every record gives H at "
        "its frequency."
    )
st.latex(
    r"""\begin{gathered}
    \ddot{\mathbf q} = \mathbf H(i\omega)\,\boldsymbol\tau \quad (16) \\
    \mathbf H = [\,\ddot{\mathbf q}^{(1)}\;\ddot{\mathbf q}^{(2)}\cdots]\;
    [\,\boldsymbol\tau^{(1)}\;\boldsymbol\tau^{(2)}\cdots]^{-1} \; (18)
    \end{gathered}"""
)
if page.study.motion_records:
    st.caption(
        "H of a motion is estimated by local polynomials in narrow frequency bands, together with the "
        "transients from both ends of each record; the scatter gives the error bars. "
        "Close to a narrow resonance the polynomials underestimate the curvature of H."
    )
analysis = page.analysis()
warn_if_unusable(analysis)
if analysis.transfer_problem:
    show_warning(analysis.transfer_problem)
if not analysis.transfer_matrices:
    st.stop()
pose = choose_pose(list(analysis.transfer_matrices))
i, j = choose_element(n)
show_element(page, analysis, pose, i, j)
show_how_well_known(analysis.transfer_matrices[pose], i, j)
