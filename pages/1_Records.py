"""The records as logged."""

import streamlit as st

from jointid import MotionRecord
from jointid.ui.shared.page import open_page
from jointid.ui.study.data_quality import show_quality, show_record

page = open_page(
    "Records",
    "Each record is one experiment with the controllers on: sines of one frequency, or any other "
    "motion. The method uses the motors' positions and torques only.",
)
if page.study.sine_records:
    st.write(
        "A sine, an offset and a linear trend are fitted to each signal. The phasor a + ib holds "
        "amplitude and phase of the sine."
    )
    st.latex(r"f(t) \approx a\,\sin\omega t + b\,\cos\omega t + c_0 + c_1 t \;\; (2)")

records = page.study.records
kinds = ["motion, " * isinstance(record, MotionRecord) for record in records]
number = st.selectbox(
    "Record",
    range(len(records)),
    format_func=lambda i: f"{i + 1}: {records[i].label or kinds[i] + records[i].excitation}",
    key="record",
    bind="query-params",
)
show_record(page, number)
show_quality(page)
