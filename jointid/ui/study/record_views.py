"""One record of the page Records: over time, its spectrum and its coherence."""

from functools import partial

import streamlit as st

from jointid import SineRecord
from jointid.figures import coherences, spectra, waveforms
from jointid.phasors.sine_fit import fit_sines
from jointid.ui.shared.charts import show_tabs
from jointid.ui.shared.page import Page
from jointid.ui.study.data_quality import HARMONICS, show_distortion


def show_record(page: Page, number: int) -> None:
    """Show a record, counted from 0, in tabs."""
    record, fitted = page.study.records[number], None
    is_sine = isinstance(record, SineRecord)
    if isinstance(record, SineRecord):
        (sine,) = page.computed(("sine", number), "Fitting the sine", fit_sines, [record])
        fitted = sine.at(record.time_s, record.omega)

    def show_waveforms(periods: float | None) -> None:
        page.show_per_joint(
            f"waveforms {number} {periods}",
            partial(waveforms, record, fitted=fitted, periods=periods),
            "Position and torque of joint {0} over time" + (" with the fitted sine" if is_sine else ""),
        )

    def show_spectra() -> None:
        what = "Spectra of position and torque of joint {0}"
        page.show_per_joint(f"spectra {number}", partial(spectra, record), what)
        if is_sine:
            st.caption(HARMONICS)

    def show_coherence() -> None:
        page.show_per_joint(
            f"coherence {number}",
            partial(coherences, record),
            "Coherence of the motion of joint {0} with the torques, over frequency",
        )
        st.caption(
            "Coherence: share of the motor's motion that is linear in the torques of all motors. In "
            "closed loop the torque also follows encoder noise, so only frequencies where the position "
            "exceeds its noise floor count."
        )
        show_distortion(record)

    views = {
        "A few periods" if is_sine else "Two seconds": lambda: show_waveforms(4.0 if is_sine else 2.0),
        "Whole record": lambda: show_waveforms(None),
        "Spectrum": show_spectra,
    }
    show_tabs("records_view", views if is_sine else views | {"Coherence": show_coherence})
