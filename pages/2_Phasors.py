"""One complex number per signal."""

import streamlit as st

from jointid.figures import phasor_plane
from jointid.ui.shared.charts import csv_bytes, download, plot, table
from jointid.ui.shared.messages import show_info
from jointid.ui.shared.page import open_page
from jointid.ui.study.data_quality import phasor_columns, phasor_table

page = open_page("Phasors")
st.title("Phasors", anchor=False)
st.write(
    "A sine of known frequency is fully described by its amplitude and phase: one complex number, the "
    "phasor. Velocity and acceleration follow by multiplication with iω, without numerical "
    "differentiation of encoder noise. Hold and delay of the torque are corrected."
)
st.latex(
    r"\theta = a + ib, \quad \dot\theta = i\omega\,\theta, "
    r"\quad \ddot\theta = (i\omega)^2\,\theta \quad (3, 4)"
)

if not page.study.sine_records:
    show_info("This study has no sine records: motions are used by their spectra, without phasors.")
    st.stop()
phasors = page.phasors()
chosen = st.selectbox(
    "Record drawn as arrows",
    range(len(phasors.labels)),
    format_func=lambda i: f"{i + 1}: {phasors.labels[i]}",
    key="record",
    bind="query-params",
)
left, right = st.columns(2)
with left:
    st.markdown("**Motor angle (rad)**")
    figure = page.drawn(f"angles {chosen}", lambda: phasor_plane(phasors, chosen=chosen, dark=page.dark))
    plot(figure, "Phasors of the motor angles in the complex plane", key="angles")
with right:
    st.markdown("**Motor torque (N·m)**")
    what = "Phasors of the motor torques in the complex plane"
    figure = page.drawn(
        f"torques {chosen}",
        lambda: phasor_plane(phasors, torque=True, chosen=chosen, dark=page.dark),
    )
    plot(figure, what, key="torques")
st.caption(
    "Distance from the centre is the amplitude, on a logarithmic scale when it varies much; direction "
    "is the phase against sin ωt on the record's clock. Two records of one frequency must differ to "
    "add information."
)
table(phasor_table(phasors))
download(
    "Save the phasors (.csv)", lambda: csv_bytes(phasor_columns(phasors)), "phasors.csv", "text/csv"
)
