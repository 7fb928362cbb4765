"""Uncertainty of K and D: the whole error, its causes, and checks of it."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator
from streamlit.elements.lib.mutable_expander_container import ExpanderContainer

from jointid import Analysis, JointIdError
from jointid.arrays import Floats
from jointid.figures.uncertainty import confidence_outlines, influence_strip
from jointid.rounding import significant, with_error
from jointid.ui.shared.background import run_in_background
from jointid.ui.shared.charts import UNITS, Table, plot
from jointid.ui.shared.messages import (
    show_error,
    show_info,
    show_progress,
    show_text_table,
    show_warning,
)
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import result_cache
from jointid.uncertainty.resampling import Bootstrap, Jackknife, bootstrap, jackknife
from jointid.uncertainty.sensitivity import PriorInfluence, confidence_ellipse, prior_influence

_PATIENCE_S = 0.5
_UNDETERMINED = "not determined"
_SLOW_DRAWS, _FAST_DRAWS = 60, 300


def reporter(place: DeltaGenerator, what: str) -> Callable[[float], None]:
    """Return a function that shows progress at ``place`` after half a second."""
    began, show = monotonic(), steps_at(place)
    return lambda done: show(done, what) if monotonic() > began + _PATIENCE_S and done > 0 else None


def steps_at(place: DeltaGenerator) -> Callable[[float, str], None]:
    """Return a function that shows progress by step at ``place``, with an estimate of the time left."""
    began = monotonic()

    def show(done: float, what: str) -> None:
        taken = monotonic() - began
        left = f", {taken * (1 - done) / done:.0f} s left" if taken > _PATIENCE_S and done > 0.05 else ""
        show_progress(done, f"{what}: {done:.0%}{left}", place)

    return show


def names_of(analysis: Analysis) -> list[str]:
    """K1 ... Kn, D1 ... Dn."""
    return [f"{q}{j + 1}" for q in "KD" for j in range(analysis.fit.n)]


def estimates_of(analysis: Analysis, method: str = "") -> tuple[Floats, Floats]:
    """Estimate and standard error in the order of ``names_of``; of the chosen estimator by default."""
    fit = analysis.fits[method] if method else analysis.fit
    return np.concatenate([fit.K, fit.D]), fit.standard_error


def on_demand(label: str, key: str) -> ExpanderContainer:
    """Return an expander, closed at first; its content may be computed once it is ``open``."""
    return st.expander(label, key=f"show_{key}", on_change="rerun", bind="query-params")


def show_errors(analysis: Analysis) -> None:
    """Errors and their causes beside the paper's answer, and the given values that matter."""
    show_text_table(errors_table(analysis))
    try:
        found = prior_influence(analysis.fit)
    except JointIdError as error:
        show_warning(f"The influence of the inertias is not known. {error}")
        return
    if found.names:
        with st.expander("Which given value matters"):
            _show_influence(analysis, found)


def errors_table(analysis: Analysis) -> Table:
    """One row per parameter: estimate, whole error, its parts, and the paper's estimate."""
    fit = analysis.fit
    value, error = estimates_of(analysis)
    paper, paper_error = estimates_of(analysis, "least-squares")
    parts = {"Noise": fit.noise_error, "Inertias and torque scale": fit.prior_error}
    if np.any(fit.unseen_error):
        parts["Friction harmonics"] = fit.unseen_error
    same = fit.method == "least-squares"
    return {
        "": [f"{name} ({UNITS[name[0]]})" for name in names_of(analysis)],
        "Estimate ± error": _estimates(value, error),
        **{name: _errors(np.broadcast_to(part, value.shape)) for name, part in parts.items()},
        "Paper's least squares": _estimates(paper, paper_error),
        "Difference": [
            "the same" if same else difference(p, v) for p, v in zip(paper, value, strict=True)
        ],
    }


def difference(other: float, value: float) -> str:
    """Deviation of ``other`` from ``value``, in per cent of it."""
    if value == 0:
        return "–"
    percent = 100 * (other - value) / abs(value)
    size = f"{abs(percent):.0f}" if abs(percent) >= 10 else significant(abs(percent), 2)
    return f"{'+' if percent > 0 else '−'}{size} %" if percent else "0 %"


def _show_influence(analysis: Analysis, found: PriorInfluence) -> None:
    names, size = names_of(analysis), np.abs(estimates_of(analysis)[0])[:, None]
    percent = np.divide(100 * found.shift, size, out=np.zeros_like(found.shift), where=size > 0)
    k, e = np.unravel_index(np.argmax(np.abs(percent)), percent.shape)
    st.write(
        f"The given value that matters most: {found.names[e]} adds ± "
        f"{significant(abs(float(percent[k, e])), 2)} % to {names[k]}. The table shows the change of "
        "each estimate in % when a given value is larger by its standard deviation: rotors J_m, arm "
        "J_a, couplings J_12. Near zero, the records determine the value better than its prior does."
    )
    columns = {name: [_signed(x) for x in row] for name, row in zip(names, percent, strict=True)}
    show_text_table({"": list(found.names)} | columns)


def _signed(percent: float) -> str:
    if not np.isfinite(percent):
        return _UNDETERMINED
    text = f"{abs(percent):.2f}"
    return "0" if float(text) == 0 else ("+" if percent > 0 else "−") + text


def show_checks(page: Page, analysis: Analysis) -> None:
    """Bootstrap and jackknife, on demand."""
    st.write(
        "Two checks that do not use the stated errors. The bootstrap draws the noise and the given "
        "inertias again and repeats the estimate: compare it with the whole error. The jackknife leaves "
        "out one frequency at a time; the inertias are the same in all records, so that their error is "
        "not in its scatter: compare it with the noise part. Both checks are accurate to a factor of "
        "two. A jackknife far above the noise part indicates an error of the model, a bootstrap far "
        "above the interval of 68 % of its draws an estimate that some noise moves far away."
    )
    key = ("checks", page.digest, page.method)
    checks: tuple[Bootstrap, Jackknife | str] | None = result_cache().get(key)
    if checks is None:
        place, working = st.empty(), st.empty()
        slow = analysis.fit.friction is not None or analysis.fit.delay is not None
        draws = _SLOW_DRAWS if slow else _FAST_DRAWS
        if not place.button(f"Check the error bars ({draws} draws)", key="check_errors"):
            return
        place.button("Checking the error bars", key="checking_errors", disabled=True)
        with working.container():
            bar = st.progress(0.0, "Drawing noise")
            st.button("Stop", key="stop_checks", help="Ends the check; nothing is kept of it.")
        try:
            checks = _checks(page, analysis, draws, bar)
        except JointIdError as error:
            show_error(error, working)
            return
        result_cache().put(key, checks)
        place.empty()
        working.empty()
    drawn, left_out = checks
    names, (_, stated) = names_of(analysis), estimates_of(analysis)
    low, high = drawn.interval(0.68)
    columns = {"": names, "Stated": _errors(stated), "Bootstrap": _errors(drawn.standard_error)}
    columns["68 % of the draws"] = _errors((high - low) / 2)
    columns["Noise part"] = _errors(analysis.fit.noise_error)
    if isinstance(left_out, Jackknife):
        columns["Jackknife"] = _errors(left_out.standard_error)
    show_text_table(columns)
    if drawn.failed:
        st.caption(f"{drawn.failed} draws allowed no estimate and are left out.")
    if isinstance(left_out, str):
        show_info(left_out)
        return
    st.write("What leaving out a frequency changes, in standard errors:")
    plot(
        influence_strip(left_out, names, dark=page.dark), "Influence of each frequency", key="influence"
    )


def _checks(
    page: Page, analysis: Analysis, draws: int, bar: DeltaGenerator
) -> tuple[Bootstrap, Jackknife | str]:
    given = (analysis.phasors, page.study.inertias, analysis.fit)
    drawn = run_in_background(bootstrap, *given, draws=draws, progress=reporter(bar, "Drawing noise"))
    try:
        return drawn, run_in_background(
            jackknife, *given, progress=reporter(bar, "Leaving out frequencies")
        )
    except JointIdError as error:
        return drawn, str(error)


def _errors(values: Floats) -> list[str]:
    return [f"± {significant(x, 2)}" if np.isfinite(x) else _UNDETERMINED for x in values.tolist()]


def _estimates(values: Floats, errors: Floats) -> list[str]:
    pairs = zip(values.tolist(), errors.tolist(), strict=True)
    return [with_error(v, e) if np.isfinite(e) else _UNDETERMINED for v, e in pairs]


def show_ellipses(page: Page, analysis: Analysis) -> None:
    """Joint confidence regions of two parameters."""
    names = names_of(analysis)
    left, right = st.columns(2)
    first = left.selectbox("Across", names, key="ellipse_x", bind="query-params")
    others = [name for name in names if name != first]
    second = right.selectbox("Upwards", others, key="ellipse_y", bind="query-params")
    try:
        ellipses = [confidence_ellipse(analysis.fit, first, second, level=p) for p in (0.95, 0.68)]
    except JointIdError as error:
        show_info(error)
        return
    plot(
        confidence_outlines(ellipses, dark=page.dark),
        f"Confidence ellipses of {first} and {second}",
        key="ellipses",
    )
    st.caption(
        "Of the whole error. A slanted ellipse means that an error in one comes with an error in the "
        "other."
    )
