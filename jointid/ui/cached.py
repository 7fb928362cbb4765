"""Results, computed once, keyed on the study's digest: by itself streamlit only samples large arrays."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from functools import wraps
from threading import Semaphore
from typing import ParamSpec, TypeVar

import streamlit as st

from jointid import Analysis, Phasors, Study, analyse, extract_phasors
from jointid.arrays import Floats
from jointid.elasticity import METHODS
from jointid.sine_fit import fit_sines

DEFAULT_METHOD = str(inspect.signature(analyse).parameters["method"].default)
"""The estimator that ``analyse`` takes when nobody chooses."""

ESTIMATORS = {DEFAULT_METHOD: METHODS.get(DEFAULT_METHOD, "chosen for these records")} | METHODS
"""Estimators with what each is, the default first."""


MOST_ANALYSES = 64
"""Twenty persons with a study each and three estimators; the studies themselves are kept elsewhere."""


Given = ParamSpec("Given")
Found = TypeVar("Found")
_LONGEST_WAIT_S = 1.0
_turn = Semaphore(1)

# Who computes hands the interpreter on ten times as often as by default: short reruns wait less.
sys.setswitchinterval(5e-4)


def in_turn(compute: Callable[Given, Found]) -> Callable[Given, Found]:
    """Let a computation wait for those of other sessions: their short reruns go on meanwhile.

    Sessions share one interpreter, so that ten computations at once would slow everybody's every click
    tenfold, and end no sooner than in turn. None waits longer than a second, for a turn may be long.
    """

    @wraps(compute)
    def waited(*given: Given.args, **named: Given.kwargs) -> Found:
        mine = _turn.acquire(timeout=_LONGEST_WAIT_S)
        try:
            return compute(*given, **named)
        finally:
            if mine:
                _turn.release()

    return waited


@st.cache_resource(max_entries=MOST_ANALYSES, show_spinner="Fitting sines, identifying the springs")
@in_turn
def analysis(digest: str, method: str, _study: Study) -> Analysis:
    """Run the whole method."""
    return analyse(_study, method=method)


@st.cache_resource(max_entries=MOST_ANALYSES, show_spinner="Fitting sines")
def phasors(digest: str, _study: Study) -> Phasors:
    """Run the first step alone: it succeeds for records that tell nothing of the springs."""
    return extract_phasors(_study.records)


@st.cache_resource(max_entries=256, show_spinner=False)
def fitted_sine(digest: str, record: int, _study: Study) -> Floats:
    """Return the fitted fundamental with offset and drift at a record's times, (N, 2n)."""
    chosen = _study.records[record]
    return fit_sines([chosen])[0].at(chosen.time_s, chosen.omega)
