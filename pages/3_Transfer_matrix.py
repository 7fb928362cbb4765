"""The robot without its controllers."""

import streamlit as st

from jointid.figures import element_response, single_record
from jointid.ui.shared.charts import plot
from jointid.ui.shared.messages import show_warning
from jointid.ui.shared.page import open_page
from jointid.ui.study.matrix_elements import choose_element, choose_pose, show_how_well_known
from jointid.ui.study.overview import freed_note

page = open_page("Transfer matrix")
st.title("Transfer matrix", anchor=False)
n = page.study.inertia.n
if n > 1:
    st.write(
        "One record alone shows a motor's acceleration over its torque with the neighbour's controller "
        "mixed in: it may add a resonance that no spring has. Records with different torques at the "
        "same frequency, taken together, give the transfer matrix H of the robot by itself, whatever "
        "the controllers do."
    )
else:
    st.write(
        "H is the motor's acceleration over its torque. A single joint has no neighbour whose "
        "controller could mix in, so every record gives H at its frequency."
    )
st.latex(
    r"""\begin{gathered}
    \ddot{\mathbf q} = \mathbf H(i\omega)\,\boldsymbol\tau \quad (16) \\
    \mathbf H = [\,\ddot{\mathbf q}^{(1)}\;\ddot{\mathbf q}^{(2)}\cdots]\;
    [\,\boldsymbol\tau^{(1)}\;\boldsymbol\tau^{(2)}\cdots]^{-1} \; (18)
    \end{gathered}"""
)
analysis = page.analysis()
if analysis.transfer_problem:
    show_warning(analysis.transfer_problem)
if not analysis.transfer_matrices:
    st.stop()
pose = choose_pose(list(analysis.transfer_matrices))
i, j = choose_element(n)
matrix = analysis.transfer_matrices[pose]
name = f"H{i + 1}{j + 1}"

figure = page.drawn(
    f"element {i} {j} {pose}", lambda: element_response(analysis, i, j, pose=pose, dark=page.dark)
)
if i == j and n > 1:
    left, right = st.columns(2)
    with left:
        st.markdown(f"**One record alone** (Figure 3): acceleration over torque of joint {i + 1}")
        alone = page.drawn(
            f"single {i} {pose}", lambda: single_record(analysis, i, pose=pose, dark=page.dark)
        )
        plot(
            alone,
            f"Acceleration over torque of joint {i + 1} from single records, over frequency",
            key="alone",
        )
    with right:
        figure_number = {0: " (Figure 4)", 1: " (Figure 5)"}.get(i, "")
        st.markdown(f"**All records together**{figure_number}: {name}")
        plot(figure, f"{name} over frequency, magnitude and phase, measured and modelled", key="H")
    st.caption(
        "Both figures share their scale. A peak that stands on the left only is made by the other "
        "joints' controllers." + freed_note(analysis.fit)
    )
else:
    if i == j:
        st.caption("Measured points with ± one standard error." + freed_note(analysis.fit))
    plot(figure, f"{name} over frequency, magnitude and phase, measured and modelled", key="H")
    if i != j:
        st.caption(
            f"{name} and H{j + 1}{i + 1} must be equal, because the coupling inertia is one number."
            + freed_note(analysis.fit)
        )

show_how_well_known(matrix, dark=page.dark)
