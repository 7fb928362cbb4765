"""The records as logged."""

from functools import partial

import streamlit as st

from jointid import SineRecord
from jointid.figures import coherences, spectra, waveforms
from jointid.phasors.sine_fit import fit_sines
from jointid.ui.shared.charts import show_tabs
from jointid.ui.shared.page import open_page
from jointid.ui.study.data_quality import HARMONICS, show_distortion, show_quality

page = open_page(
    "Records",
    "Each record is one experiment with the controllers on: sines of one frequency, or any other "
    "motion. The method uses the motors' angles and torques only.",
)
if page.study.sine_records:
    st.write("A sine, an offset and a linear trend are fitted to each signal; the sine is its phasor.")
    st.latex(r"f(t) \approx a\,\sin\omega t + b\,\cos\omega t + c_0 + c_1 t \qquad (2)")

records = page.study.records
number = st.selectbox(
    "Record",
    range(len(records)),
    format_func=lambda i: f"{i + 1}: {records[i].label or records[i].excitation}",
    key="record",
    bind="query-params",
)
record = records[number]
is_sine = isinstance(record, SineRecord)
fitted = None
if isinstance(record, SineRecord):
    (sine,) = page.computed(("sine", number), "Fitting the sine", fit_sines, [record])
    fitted = sine.at(record.time_s, record.omega)


def show_waveforms(periods: float | None) -> None:
    """Angle and torque over time."""
    page.show_per_joint(
        f"waveforms {number} {periods}",
        partial(waveforms, record, fitted=fitted, periods=periods),
        "Angle and torque of joint {0} over time" + (" with the fitted sine" if is_sine else ""),
    )


def show_spectra() -> None:
    """Spectra of angle and torque."""
    page.show_per_joint(
        f"spectra {number}",
        partial(spectra, record),
        "Spectra of angle and torque of joint {0}",
    )
    if is_sine:
        st.caption(HARMONICS)


def show_coherence() -> None:
    """Coherence of a motion, and its distortion."""
    page.show_per_joint(
        f"coherence {number}",
        partial(coherences, record),
        "Coherence of the motion of joint {0} with the torques, over frequency",
    )
    st.caption(
        "Coherence: share of the motor's motion that is linear in the torques of all motors. In "
        "closed loop the torque also follows encoder noise, so only frequencies where the angle "
        "exceeds its noise floor count."
    )
    show_distortion(record)


views = {
    "A few periods" if is_sine else "Two seconds": lambda: show_waveforms(4.0 if is_sine else 2.0),
    "Whole record": lambda: show_waveforms(None),
    "Spectrum": show_spectra,
}
show_tabs("records_view", views if is_sine else views | {"Coherence": show_coherence})
show_quality(page)
