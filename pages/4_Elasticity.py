"""Stiffness and damping of every joint."""

import streamlit as st

from jointid.figures import dynamic_stiffness, element_response, unexplained_torque
from jointid.ui.shared.charts import plot, side_by_side
from jointid.ui.shared.page import open_page
from jointid.ui.study.estimates import show_also_fitted, show_estimates, show_matrix
from jointid.ui.study.model_check import show_model_holds, show_poses
from jointid.ui.study.overview import freed_note, show_findings, show_tiles
from jointid.ui.study.uncertainty_panels import (
    ask_share,
    on_demand,
    show_checks,
    show_ellipses,
    show_errors,
)

page = open_page("Elasticity")
st.title("Elasticity", anchor=False)
st.write(
    "Since the rigid-body inertias are known, every record tells how far each spring was deflected and "
    "which torque it passed on. Their ratio holds K and D; the problem is linear, so no start values "
    "are needed."
)
analysis = page.analysis()
fit, n = analysis.fit, page.study.inertia.n
show_tiles(fit, page.study.nominal)
show_findings(analysis.findings)

st.subheader("How well they are known", anchor=False)
share = ask_share()
errors = st.container()

st.subheader("Dynamic stiffness of each record", anchor=False)
st.latex(
    r"""\begin{gathered}
    (K_j + i\omega D_j)\,a_j = b_j \quad (8) \\
    \mathbf a = (\mathbf I + \mathbf M_2^{-1}\mathbf M)s^2\mathbf q
    - \mathbf M_2^{-1}\boldsymbol\tau \quad (9) \\
    \mathbf b = s^2\boldsymbol\tau - \mathbf M s^4\mathbf q \quad (11)
    \end{gathered}"""
)
st.caption(
    "The real part of b/a is K at every frequency, the imaginary part grows as ωD. Bars: ± one standard "
    "error. Points that leave the lines at some frequencies only tell of friction, a torque delay, or "
    "inertias that are off; a joint that hardly moves in a record tells little there."
)
for j, place in enumerate(side_by_side(n)):
    with place:
        st.markdown(f"**Joint {j + 1}**")
        figure = page.drawn(
            f"stiffness {j}",
            lambda j=j: dynamic_stiffness(fit, j, page.study.nominal, dark=page.dark),
        )
        plot(figure, f"Dynamic stiffness of joint {j + 1}", key=f"stiffness_{j}")

st.subheader("Every estimator", anchor=False)
show_estimates(analysis)
show_also_fitted(fit)

st.subheader("What the model leaves unexplained", anchor=False)
st.caption(
    "Points at the height of the dashes: noise explains the rest. Points far above: there the model is "
    "wrong, not the noise, and the error bars are widened accordingly."
)
for j, place in enumerate(side_by_side(n)):
    with place:
        st.markdown(f"**Joint {j + 1}**")
        figure = page.drawn(f"unexplained {j}", lambda j=j: unexplained_torque(fit, j, dark=page.dark))
        plot(figure, f"Unexplained torque of joint {j + 1} against noise", key=f"unexplained_{j}")
if analysis.transfer_matrices:
    st.subheader("Fit over measurement", anchor=False)
    st.caption("The identified and the nominal model over the transfer matrix." + freed_note(fit))
    pose = next(iter(analysis.transfer_matrices))
    for j, place in enumerate(side_by_side(n)):
        with place:
            st.markdown(f"**H{j + 1}{j + 1}**")
            name = f"H{j + 1}{j + 1} over frequency, measured and modelled"
            figure = page.drawn(
                f"element {j} {j} {pose}",
                lambda j=j: element_response(analysis, j, j, pose=pose, dark=page.dark),
            )
            plot(figure, name, key=f"fit_{j}")
with st.expander("The matrix A, its condition, and how the estimates are correlated"):
    show_matrix(fit)
with on_demand("Check the error bars", "checks") as check:
    if check.open:
        show_checks(page, analysis)
with on_demand("Confidence ellipses", "ellipses") as ellipses:
    if ellipses.open:
        show_ellipses(page, analysis)
with on_demand("Does the model hold", "model") as model:
    if model.open:
        show_model_holds(page, analysis)
if len({record.pose for record in page.study.records}) > 1:
    with on_demand("Every pose alone", "poses") as poses:
        if poses.open:
            show_poses(page, analysis)
show_errors(page, analysis, errors, share)
