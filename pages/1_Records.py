"""The records as logged."""

import streamlit as st

from jointid.figures import spectra, waveforms
from jointid.ui.shared import cached
from jointid.ui.shared.page import open_page
from jointid.ui.study.data_quality import show_quality

page = open_page("Records")
st.title("Records", anchor=False)
st.write(
    "Each record is one experiment: the joints follow sines of one frequency while their controllers "
    "stay on. The method uses the motors' angles and torques only. A sine, an offset and a drift are "
    "fitted to each signal, and the sine is what goes on to the next step."
)
st.latex(r"f(t) \approx a\,\sin\omega t + b\,\cos\omega t + c_0 + c_1 t \qquad (2)")

records = page.study.records
number = st.selectbox(
    "Record",
    range(len(records)),
    format_func=lambda i: f"{i + 1}: {records[i].label or f'{records[i].frequency_hz:g} Hz'}",
    key="record",
    bind="query-params",
)
record = records[number]
fitted = cached.fitted_sine(page.digest, number, page.study)
views = st.tabs(["A few periods", "Whole record", "Spectrum"])
for view, periods in zip(views, (4.0, None), strict=False):
    with view:
        page.show_per_joint(
            f"waveforms {number} {periods}",
            lambda joint, periods=periods: waveforms(
                record, joint, fitted, periods=periods, dark=page.dark
            ),
            "Angle and torque of joint {0} over time with the fitted sine",
        )
with views[2]:
    page.show_per_joint(
        f"spectra {number}",
        lambda joint: spectra(record, joint, dark=page.dark),
        "Spectra of angle and torque of joint {0}",
    )
    st.caption("Friction shows at the harmonics 2, 3, 5 and 7 of the excitation.")

show_quality(page)
