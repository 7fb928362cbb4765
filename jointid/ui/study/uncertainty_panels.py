"""Uncertainty of K and D: error bars, their parts, inertias as given and fitted, and checks."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import streamlit as st

from jointid import Analysis, JointIdError
from jointid.answer import ERROR_BARS, UNSTATED_TORQUE_SCALE, elasticity_quantities
from jointid.arrays import Floats
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.figures.uncertainty import confidence_outlines, influence_strip
from jointid.ui.shared.background import run_in_background
from jointid.ui.shared.charts import Table
from jointid.ui.shared.messages import show_info, show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import Show, computed_on_click
from jointid.uncertainty.error_parts import error_table
from jointid.uncertainty.prior_rows import PRIOR_HEADER
from jointid.uncertainty.resampling import Bootstrap, Jackknife, bootstrap, jackknife
from jointid.uncertainty.sensitivity import confidence_ellipse, prior_influence
from jointid.wording import UNDETERMINED, capitalised, significant

_SLOW_DRAWS, _FAST_DRAWS = 60, 300


def show_errors(analysis: Analysis) -> None:
    """K and D with the parts of their errors, beside the paper's answer."""
    show_text_table(errors_table(analysis))
    st.caption(
        f"Estimator: **{analysis.fit.method}**. {ERROR_BARS} The squares of its parts add up to its "
        f"square. K and D {analysis.unit.side}."
    )
    if analysis.study.torque_std is None:
        st.caption(UNSTATED_TORQUE_SCALE)


def errors_table(analysis: Analysis) -> Table:
    """One row per parameter: estimate, parts of its error, and the paper's answer."""
    fit, found = analysis.fit, analysis.quantities
    header, rows = error_table(fit, analysis.unit)
    columns: dict[str, Sequence[str]] = {
        "": [f"{quantity.name} ({quantity.unit})" for quantity in found],
        "Estimate": [quantity.shown[0] for quantity in found],
    }
    parts = zip(map(capitalised, header), zip(*rows, strict=True), strict=True)
    columns |= dict(list(parts)[2:])  # after name and total error
    if "least-squares" not in analysis.fits or fit.method == "least-squares":
        return columns
    paper = elasticity_quantities(analysis.fits["least-squares"], analysis.unit)
    pairs = list(zip(paper, found, strict=True))
    known = [np.isfinite([one.error, other.error]).all() for one, other in pairs]
    apart = [difference(one.value, other.value) for one, other in pairs]
    return columns | {
        "Paper's least squares": [quantity.shown[0] for quantity in paper],
        "Difference": [text if is_known else "–" for text, is_known in zip(apart, known, strict=True)],
    }


def difference(other: float, value: float) -> str:
    """Deviation of ``other`` from ``value``, in per cent of it."""
    if value == 0:
        return "–"
    percent = 100 * (other - value) / abs(value)
    size = f"{abs(percent):.0f}" if abs(percent) >= 10 else significant(abs(percent), 2)
    return f"{'+' if percent > 0 else '−'}{size} %" if percent else "0 %"


def show_inertias(analysis: Analysis) -> None:
    """Inertias and torque scales as given and as fitted, and the change of K and D by each."""
    heads, cells = (
        map(capitalised, PRIOR_HEADER),
        zip(*(row.cells for row in analysis.priors), strict=True),
    )
    show_text_table(dict(zip(heads, cells, strict=True)))
    st.caption(
        "Motor side: J_m rotors, J_a arm, J_12 coupling. Given: with the standard deviation σ that the "
        "study states. Fitted: together with K and D."
    )
    try:
        found = prior_influence(analysis.fit)
    except JointIdError as error:
        show_info(error)
        return
    if not found.names:
        st.write("The study states exact inertias and torque scales: they add nothing to the errors.")
        return
    names, size = elasticity_labels(analysis.fit.n), np.abs(analysis.fit.estimate)[:, None]
    percent = np.divide(100 * found.shift, size, out=np.zeros_like(found.shift), where=size > 0)
    k, e = np.unravel_index(np.argmax(np.abs(percent)), percent.shape)
    st.write(
        f"Largest influence: {found.names[e]} adds ± {significant(abs(float(percent[k, e])), 2)} % to "
        f"{names[k]}. The table shows the change of each estimate in % when a given value is larger by "
        "its standard deviation. Near zero, the records determine the value better than its prior does."
    )
    columns = {name: [_signed(x) for x in row] for name, row in zip(names, percent, strict=True)}
    show_text_table({"": list(found.names)} | columns)


def _signed(percent: float) -> str:
    if not np.isfinite(percent):
        return UNDETERMINED
    text = f"{abs(percent):.2f}"
    return "0" if float(text) == 0 else ("+" if percent > 0 else "−") + text


def show_checks(page: Page, analysis: Analysis) -> None:
    """Bootstrap and jackknife, on demand."""
    st.write(
        "Two checks independent of the standard errors above. The bootstrap repeats the estimate with "
        "new noise and new given inertias: compare it with the standard error. The jackknife leaves out "
        "one frequency at a time; its scatter includes every cause except the inertias, which all "
        "records share: compare it with the part from noise. A factor of two is normal. A jackknife "
        "far above it indicates a wrong model; a bootstrap far above the range of 68 % of its draws "
        "indicates outliers caused by noise."
    )
    slow = analysis.fit.friction is not None or analysis.fit.delay is not None
    draws = _SLOW_DRAWS if slow else _FAST_DRAWS
    checks = computed_on_click(
        ("checks", page.digest, page.method),
        f"Check the error bars ({draws} draws)",
        "check_errors",
        lambda show: _checks(page, analysis, draws, show),
    )
    if checks is None:
        return
    drawn, left_out = checks
    fit, names = analysis.fit, elasticity_labels(analysis.fit.n)
    low, high = drawn.interval(0.68)
    errors = {
        "Stated": fit.standard_error,
        "Bootstrap": drawn.standard_error,
        "68 % of the draws": (high - low) / 2,
        "From noise": fit.noise_error,
    }
    if isinstance(left_out, Jackknife):
        errors["Jackknife"] = left_out.standard_error
    show_text_table(
        {"": [f"{quantity.name} ({quantity.unit})" for quantity in analysis.quantities]}
        | {name: plus_minus(analysis.unit.shown(error)) for name, error in errors.items()}
    )
    if drawn.failed:
        st.caption(f"{drawn.failed} draws allowed no estimate and are left out.")
    if isinstance(left_out, str):
        show_info(left_out)
        return
    st.write("Change by leaving out a frequency, in standard errors:")
    page.show("influence", partial(influence_strip, left_out, names), "Influence of each frequency")


def _checks(page: Page, analysis: Analysis, draws: int, show: Show) -> tuple[Bootstrap, Jackknife | str]:
    given = (analysis.phasors, page.study.inertias, analysis.fit)
    drawn = run_in_background(
        bootstrap, *given, draws=draws, progress=lambda done: show(done, "Drawing noise")
    )
    try:
        return drawn, run_in_background(
            jackknife, *given, progress=lambda done: show(done, "Leaving out frequencies")
        )
    except JointIdError as error:
        return drawn, str(error)


def plus_minus(values: Floats) -> list[str]:
    """Write standard errors with their sign."""
    return [f"± {significant(float(x), 2)}" if np.isfinite(x) else UNDETERMINED for x in values]


def show_ellipses(page: Page, analysis: Analysis) -> None:
    """Joint confidence regions of two parameters."""
    names = elasticity_labels(analysis.fit.n)
    left, right = st.columns(2)
    first = left.selectbox("Across", names, key="ellipse_x", bind="query-params")
    others = [name for name in names if name != first]
    second = right.selectbox("Upwards", others, key="ellipse_y", bind="query-params")
    try:
        ellipses = [confidence_ellipse(analysis.fit, first, second, level=p) for p in (0.95, 0.68)]
    except JointIdError as error:
        show_info(error)
        return
    units = dict(zip(names, analysis.unit.units(analysis.fit.n), strict=True))
    size = dict(zip(names, analysis.unit.shown(np.ones(len(names))), strict=True))
    scale = np.array([size[first], size[second]])
    shown = [replace(e, centre=e.centre * scale, outline=e.outline * scale) for e in ellipses]
    draw = partial(confidence_outlines, shown, units)
    page.show(f"ellipses {first} {second}", draw, f"Confidence ellipses of {first} and {second}")
    st.caption(
        "From the total error. A slanted ellipse means that an error in one comes with an error in the "
        "other."
    )
