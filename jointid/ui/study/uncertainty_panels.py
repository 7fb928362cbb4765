"""Uncertainty of K and D: error bars of noise and of the inertias, and checks of them."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator
from streamlit.elements.lib.mutable_expander_container import ExpanderContainer

from jointid import Analysis, JointIdError
from jointid.answer import inertia_sentence
from jointid.arrays import Floats
from jointid.figures.uncertainty import confidence_outlines, influence_strip
from jointid.rounding import significant, with_error
from jointid.ui.shared.background import run_in_background
from jointid.ui.shared.charts import UNITS, Table, plot
from jointid.ui.shared.messages import (
    show_error,
    show_info,
    show_note,
    show_progress,
    show_text_table,
    show_warning,
)
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import result_cache
from jointid.uncertainty.resampling import Bootstrap, Jackknife, bootstrap, jackknife
from jointid.uncertainty.sensitivity import (
    InertiaSensitivity,
    confidence_ellipse,
    inertia_sensitivity,
)

_PATIENCE_S = 0.5
_SOON_S = 0.2
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


def ask_share() -> float:
    """Ask how well the inertias are known, as a share."""
    percent = st.number_input(
        "Inertias are known to ± (%)",
        0.0,
        50.0,
        3.0,
        0.5,
        format="%g",
        key="inertia_share",
        bind="query-params",
        width=232,
        help="Every element of M and M2 errs by so much, independently. Records say nothing of this "
        "error, so that it is kept apart from the one that noise makes.",
    )
    return float(percent) / 100


def show_errors(page: Page, analysis: Analysis, place: DeltaGenerator, share: float) -> None:
    """Both error bars and the paper's answer; slow parts are computed after the page is drawn."""
    with place:
        shown, below, details = st.empty(), st.empty(), st.container()
    found: InertiaSensitivity | str | None = result_cache().get(("inertias", page.digest, page.method))
    known = found if isinstance(found, InertiaSensitivity) else None
    show_text_table(errors_table(analysis, known, share), shown)
    if isinstance(found, str):
        show_warning(f"What the inertias add is not known. {found}", below)
        return
    if known is None:
        stopped = str(("stopped_inertias", page.digest, page.method))
        if st.session_state.get(stopped):
            below.button(
                "Compute the error bars of the inertias",
                key="start_inertias",
                on_click=lambda: st.session_state.pop(stopped, None),
            )
            return
        with below.container():
            _compute_what_the_inertias_add(page, analysis)
            st.button(  # outside of the fragment: a click within one interrupts nothing
                "Stop",
                key="stop_inertias",
                help="Leaves the second error bar unknown; the rest of the page does not need it.",
                on_click=lambda: st.session_state.update({stopped: True}),
            )
        return
    with details, st.expander("Which inertia matters"):
        _show_sensitivity(analysis, known)


@st.fragment(run_every=_SOON_S)
def _compute_what_the_inertias_add(page: Page, analysis: Analysis) -> None:
    """Reserve a line in the page's own run; compute in the next one, which the browser asks for."""
    waiting = (page.digest, page.method)
    bar = st.empty()
    if st.session_state.get("inertias_wait") != waiting:
        st.session_state["inertias_wait"] = waiting
        bar.caption("± is noise alone. What inertias that are off would add is computed next.")
        return
    try:
        found: InertiaSensitivity | str = run_in_background(
            inertia_sensitivity,
            analysis.phasors,
            page.study.inertias,
            analysis.fit,
            progress=reporter(bar, "What the inertias change"),
        )
    except JointIdError as error:
        found = str(error)
    result_cache().put(("inertias", page.digest, page.method), found)
    del st.session_state["inertias_wait"]
    st.rerun()


def show_inertia_line(page: Page, analysis: Analysis) -> None:
    """One line on the errors of the inertias, computed after the page is drawn."""
    if any(finding.level == "problem" for finding in analysis.findings):
        return  # an unusable answer needs no error bars
    found: InertiaSensitivity | str | None = result_cache().get(("inertias", page.digest, page.method))
    if found is None:
        _compute_what_the_inertias_add(page, analysis)
    elif isinstance(found, str):
        unknown = "what inertias that are off would add is not known."
        show_note(f"± is noise alone; {unknown} {found}")
    else:
        st.caption(inertia_sentence(found.standard_error()))


def errors_table(analysis: Analysis, found: InertiaSensitivity | None, share: float) -> Table:
    """One row per parameter; the error from the inertias is "…" until it is computed."""
    value, error = estimates_of(analysis)
    paper, paper_error = estimates_of(analysis, "least-squares")
    added = ["…"] * value.size
    if found is not None:
        added = [f"± {significant(float(e), 2)}" for e in found.standard_error(share)]
    same = analysis.fit.method == "least-squares"
    return {
        "": [f"{name} ({UNITS[name[0]]})" for name in names_of(analysis)],
        "Estimate ± noise": [with_error(v, e) for v, e in zip(value, error, strict=True)],
        f"Inertias ± {100 * share:g} %": added,
        "Paper's least squares": [with_error(v, e) for v, e in zip(paper, paper_error, strict=True)],
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


def _show_sensitivity(analysis: Analysis, found: InertiaSensitivity) -> None:
    names, relative = names_of(analysis), found.relative
    k, e = np.unravel_index(np.nanargmax(np.abs(relative)), relative.shape)
    st.write(
        f"The error that matters most: 1 % of {found.names[e]} moves {names[k]} by "
        f"{significant(abs(float(relative[k, e])), 2)} %. The table holds the change of each estimate "
        "in % for 1 % more of each inertia: rotors J_m, arm J_a, couplings J_12."
    )
    columns = {name: [_signed(x) for x in row] for name, row in zip(names, relative, strict=True)}
    show_text_table({"1 % more of": list(found.names)} | columns)


def _signed(percent: float) -> str:
    if not np.isfinite(percent):
        return "–"
    text = f"{abs(percent):.2f}"
    return "0" if float(text) == 0 else ("+" if percent > 0 else "−") + text


def show_checks(page: Page, analysis: Analysis) -> None:
    """Bootstrap and jackknife, on demand."""
    st.write(
        "Two checks that do not use the stated error bars. The bootstrap draws the noise anew and "
        "estimates again; the jackknife leaves out one frequency at a time and takes the scatter for "
        "the error, whatever its cause. A factor of two between them is nothing to worry about. A "
        "jackknife far above the others tells of a model that does not hold, a bootstrap far above "
        "what 68 % of its draws say of an estimate that some noise throws far off."
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
    return [f"± {significant(float(x), 2)}" for x in values]


def show_ellipses(page: Page, analysis: Analysis) -> None:
    """Joint confidence regions of two parameters."""
    names = names_of(analysis)
    left, right = st.columns(2)
    first = left.selectbox("Across", names, key="ellipse_x", bind="query-params")
    others = [name for name in names if name != first]
    second = right.selectbox("Upwards", others, key="ellipse_y", bind="query-params")
    ellipses = [confidence_ellipse(analysis.fit, first, second, level=p) for p in (0.95, 0.68)]
    plot(
        confidence_outlines(ellipses, dark=page.dark),
        f"Confidence ellipses of {first} and {second}",
        key="ellipses",
    )
    st.caption(
        "From noise alone: what the inertias are off is not in it. A slanted ellipse means that an "
        "error in one comes with an error in the other."
    )
