"""One complex number per signal."""

from functools import partial

import streamlit as st

from jointid.exporting.tables import phasors_csv
from jointid.figures import phasor_plane
from jointid.ui.shared.charts import choose_joint, download, table
from jointid.ui.shared.messages import show_info
from jointid.ui.shared.method_steps import RECORDS, TRANSFER
from jointid.ui.shared.page import open_page
from jointid.ui.shared.workspace import link_to
from jointid.ui.study.data_quality import phasor_table

page = open_page(
    "Phasors",
    "A sine of known frequency is fully described by its amplitude and phase: one complex number, the "
    "phasor. Velocity and acceleration follow by multiplication with iω, without numerical "
    "differentiation of encoder noise. The torque is corrected for hold and delay.",
)
st.latex(
    r"\theta = a + ib,\;\; \dot\theta = i\omega\,\theta,\;\; "
    r"\ddot\theta = (i\omega)^2\theta \;\; (3, 4)"
)

if not page.study.sine_records:
    show_info("This study has no sine records: motions are analysed by their spectra, without phasors.")
    st.write("The spectra of the motions, and the transfer matrix from them:")
    link_to(RECORDS)
    link_to(TRANSFER)
    st.stop()
phasors = page.phasors()
chosen = st.selectbox(
    "Record drawn as arrows",
    range(len(phasors.labels)),
    format_func=lambda i: f"{i + 1}: {phasors.labels[i]}",
    key="record",
    bind="query-params",
)
joints = range(phasors.n)
has_many = phasors.n > 2  # they would hide each other
joint = choose_joint(joints, "phasor_joint") if has_many else 0
drawn = joint if has_many else None
signals = (("Motor position (rad)", "positions", False), ("Motor torque (N·m)", "torques", True))
for place, (heading, what, torque) in zip(st.columns(2), signals, strict=True):
    with place:
        st.markdown(f"**{heading}**")
        page.show(
            f"{what} {chosen} {drawn}",
            partial(phasor_plane, phasors, torque=torque, chosen=chosen, joint=drawn),
            f"Phasors of the motor {what} in the complex plane",
        )
st.caption(
    "Distance from the centre is the amplitude, on a logarithmic scale when it varies widely; direction "
    "is the phase against sin ωt on the record's clock. Two records of one frequency must differ to "
    "add information."
)
if phasors.n == 2:  # the figures show both
    joint = choose_joint(joints, "phasor_joint")
columns = phasor_table(phasors, joint)
table(columns, phone=[*columns][::2])  # amplitudes
records = page.study.sine_records
download("Save the phasors (.csv)", lambda: phasors_csv(phasors, records), "phasors.csv")
