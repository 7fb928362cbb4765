"""Results cached by the study's digest: streamlit's own hash only samples large arrays."""

import inspect

import streamlit as st

from jointid import Analysis, Phasors, SineRecord, Study, analyse, extract_phasors
from jointid.arrays import Floats
from jointid.estimation.identify_elasticity import METHODS
from jointid.phasors.sine_fit import fit_sines
from jointid.ui.shared.background import run_in_background

DEFAULT_METHOD = str(inspect.signature(analyse).parameters["method"].default)
"""The default estimator of ``analyse``."""

ESTIMATORS = {DEFAULT_METHOD: METHODS.get(DEFAULT_METHOD, "chosen for these records")} | METHODS
"""Estimators with their descriptions, the default first."""


MOST_ANALYSES = 64
"""Room for twenty sessions with one study and three estimators each."""


@st.cache_resource(max_entries=MOST_ANALYSES, show_spinner="Fitting sines, identifying the springs")
def analysis(digest: str, method: str, _study: Study) -> Analysis:
    """Run the whole method."""
    return run_in_background(analyse, _study, method=method)


@st.cache_resource(max_entries=MOST_ANALYSES, show_spinner="Fitting sines")
def phasors(digest: str, _study: Study) -> Phasors:
    """Run the first step alone: it succeeds for records that do not determine the springs."""
    return extract_phasors(_study.sine_records)


@st.cache_resource(max_entries=256, show_spinner=False)
def fitted_sine(digest: str, record: int, _study: Study) -> Floats | None:
    """Return the fitted fundamental with offset and drift at a record's times, (N, 2n).

    None for a record of another motion.
    """
    chosen = _study.records[record]
    if not isinstance(chosen, SineRecord):
        return None
    return fit_sines([chosen])[0].at(chosen.time_s, chosen.omega)
