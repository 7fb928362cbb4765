"""Uncertainty of K and D: error bars, their parts, inertias, estimators, and checks."""

import numpy as np
import streamlit as st

from jointid import Analysis, ElasticityFit, JointIdError
from jointid.analysis import NOT_USABLE
from jointid.answer import (
    ERROR_BARS,
    UNSTATED_TORQUE_SCALE,
    friction_note,
    further_quantities,
    model_name,
)
from jointid.arrays import Floats
from jointid.estimation.estimators.parameters import elasticity_labels
from jointid.ui.shared.charts import FEW_JOINTS, choose_joint, table
from jointid.ui.shared.messages import show_info, show_text_table
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import Show, computed_on_click, run_in_background
from jointid.ui.shared.settings import ESTIMATORS
from jointid.uncertainty.answer_tables import (
    COMPARED_MODELS,
    compared_models,
    error_table,
    estimates_table,
    parts_meaning,
    prior_table,
)
from jointid.uncertainty.information import prior_influence
from jointid.uncertainty.resampling import Bootstrap, Jackknife, bootstrap, jackknife
from jointid.wording import UNDETERMINED, capitalised, minus, signed_percent, significant, unbroken


def show_estimates(analysis: Analysis) -> None:
    """One column per estimator, the chosen one first, and the nominal values."""
    fits = (analysis.fit, *analysis.fits.values())
    estimates = estimates_table(fits, analysis.nominal, analysis.unit)
    names, *values = ((name, *cells) for name, cells in estimates.items())
    columns: dict[str, list[str]] = {"": [name for name, *_ in values]}
    columns |= {name: [row[k] for row in values] for k, name in enumerate(names) if k}
    show_text_table(columns)
    st.caption(
        f"All pages show **{analysis.fit.method}**; the sidebar selects another. {ERROR_BARS} "
        f"K and D {analysis.unit.side}. "
        "The linear estimators keep the given inertias, so their error bars contain the whole "
        "uncertainty of these."
    )
    st.markdown("\n".join(f"- **{name}**: {line}" for name, line in ESTIMATORS.items()))
    st.markdown(
        "For D, equation (15) as printed weights the records differently from the pseudo-inverse "
        "(13)–(14). Both are exact without noise."
    )


def show_fitted_model(fit: ElasticityFit) -> None:
    """The model, the effects fitted in addition to K and D, and the compared models."""
    st.write(f"Fitted model: {model_name(fit)}.")
    if further := further_quantities(fit):
        names, shown = [capitalised(q.meaning) for q in further], [q.shown for q in further]
        show_text_table(
            {"": names, "Fitted": [text for text, _ in shown], "Unit": [unit for _, unit in shown]}
        )
    if of_friction := friction_note(fit):
        st.caption(of_friction)
    if fit.candidates:
        st.write(unbroken(COMPARED_MODELS))
        show_text_table(compared_models(fit))


def show_matrix(fit: ElasticityFit) -> None:
    """Equation (12) with its condition, and the correlation of the estimates."""
    joints = range(1, fit.n + 1)
    names = [f"{name}{j}" for j in joints for name in "DK"]
    unknowns = r"\;".join(f"{name[0]}_{{{name[1:]}}}" for name in names[:4])
    dots = r"\cdots" if fit.n > 2 else ""
    st.latex(rf"\mathbf A\,[{unknowns}{dots}]^T = \mathbf b \quad (12)")
    st.write(
        f"A has {2 * fit.n * fit.equations.omega.size} rows, two per joint and record. With its columns "
        f"multiplied by the fitted D and K, its condition number is {significant(fit.condition, 3)}; "
        "near 1, the records determine all of them with similar relative errors."
    )
    A, b = fit.equations.matrix()
    joint = choose_joint(range(fit.n), "details_joint") if fit.n > 1 else 0
    rows = np.arange(b.size).reshape(-1, fit.n, 2)[:, joint].ravel()
    columns = {"Row": [f"{part} {row}" for row in fit.phasors.labels for part in ("Re", "Im")]}
    for name, values in (*zip(names, A.T, strict=True), ("b", b)):
        if name in (f"D{joint + 1}", f"K{joint + 1}", "b"):
            columns[name] = [significant(float(x), 5) for x in values[rows]]
    table(columns, height=300)
    if fit.n > 1:
        st.caption(f"In the rows of joint {joint + 1}, all other columns of A are zero.")
    order, C = elasticity_labels(fit.n), fit.correlation
    i, k = np.unravel_index(np.abs(np.triu(C, 1)).argmax(), C.shape)
    strongest = f"{order[i]} and {order[k]}, {significant(float(C[i, k]), 2)}"
    st.write(f"Correlation of the estimates; the strongest is that of {strongest}.")
    columns = {order[k]: [significant(float(x), 2) for x in C[:, k]] for k in (joint, joint + fit.n)}
    show_text_table({"": list(order)} | columns)


_SLOW_DRAWS, _FAST_DRAWS = 60, 300


def show_errors(analysis: Analysis) -> None:
    """K and D with the parts of their errors."""
    columns = error_table(analysis.fit, analysis.unit)
    show_text_table({capitalised(name): cells for name, cells in columns.items()})
    meaning = parts_meaning(columns)
    st.caption(
        f"Estimator: **{analysis.fit.method}**. Total: one standard error; the squares "
        f"of its parts add up to its square. K and D {analysis.unit.side}. {meaning}"
    )
    if analysis.study.torque_std is None:
        st.caption(UNSTATED_TORQUE_SCALE)


def show_inertias(analysis: Analysis) -> None:
    """Inertias and torque scales as given and as fitted, and the change of K and D by each."""
    columns = prior_table(analysis.priors)
    show_text_table({capitalised(name): cells for name, cells in columns.items()})
    st.caption(
        "Motor side: J_m rotors, J_a arm, J_12 coupling. Given: with the standard deviation that the "
        "study states. Fitted: together with K and D. σ: the larger of the two standard deviations."
    )
    if analysis.state == NOT_USABLE:
        return
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
        f"{names[k]}. The table shows the change of each estimate when a given value is larger by its "
        "standard deviation. A change near zero: the records determine the value better than its prior."
    )
    shown = range(len(names))
    if analysis.fit.n > FEW_JOINTS:
        joint = choose_joint(range(analysis.fit.n), "details_joint")
        shown = range(joint, len(names), analysis.fit.n)
    columns = {
        f"{names[k]} (%)": [signed_percent(x).removesuffix(" %") for x in percent[k]] for k in shown
    }
    show_text_table({"": list(found.names)} | columns)


def show_checks(page: Page, analysis: Analysis) -> None:
    """Bootstrap and jackknife, on demand."""
    st.write(
        "Two checks independent of the standard errors above. The bootstrap repeats the estimate with "
        "new noise and new given inertias: compare it with the standard error. The jackknife leaves out "
        "one frequency at a time; its scatter includes every cause except the inertias, which all "
        "records share: compare it with the part from noise. A factor of two is normal. A larger "
        "jackknife indicates a wrong model. Half the range of the central 68 % of the draws is far "
        "below their scatter only if a few draws are outliers."
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
        "Standard error": fit.standard_error,
        "Bootstrap": drawn.standard_error,
        "Central 68 % of the draws": (high - low) / 2,
        "From noise": fit.noise_error,
    }
    if isinstance(left_out, Jackknife):
        errors["Jackknife"] = left_out.standard_error
    show_text_table(
        {"": [quantity.heading for quantity in analysis.quantities]}
        | {name: plus_minus(analysis.unit.shown(error)) for name, error in errors.items()}
    )
    if drawn.failed:
        st.caption(f"{drawn.failed} draws gave no estimate and are left out.")
    if isinstance(left_out, str):
        show_info(left_out)
        return
    f, k = np.unravel_index(np.abs(left_out.influence).argmax(), left_out.influence.shape)
    change = minus(f"{left_out.influence[f, k]:+.2g}")
    hertz = significant(left_out.frequency_hz[f], 3)
    st.write(f"Largest influence: without {hertz} Hz, {names[k]} changes by {change} standard errors.")


def _checks(page: Page, analysis: Analysis, draws: int, show: Show) -> tuple[Bootstrap, Jackknife | str]:
    given = (analysis.phasors, page.study.inertias, analysis.fit)
    drawn = run_in_background(
        bootstrap, *given, draws=draws, progress=lambda done: show(done, "Simulating noise")
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
