"""The estimators side by side, and the linear problem in detail."""

from collections.abc import Sequence

import numpy as np
import streamlit as st

from jointid import Analysis, ElasticityFit
from jointid.answer import (
    ERROR_BARS,
    elasticity_quantities,
    friction_note,
    further_quantities,
    model_name,
)
from jointid.estimation.candidates import Candidate
from jointid.ui.shared.charts import Table, table
from jointid.ui.shared.messages import show_text_table
from jointid.ui.shared.sidebar import ESTIMATORS
from jointid.wording import plain, significant


def show_estimates(analysis: Analysis) -> None:
    """One row per estimator, the chosen one first."""
    show_text_table(estimates_table(analysis))
    st.caption(
        f"All pages show **{analysis.fit.method}**; the sidebar selects another. {ERROR_BARS} "
        f"K and D {analysis.unit.side}. "
        "The linear estimators keep the given inertias, so their error bars contain the whole "
        "uncertainty of these."
    )
    st.markdown("\n".join(f"- **{name}**: {line}" for name, line in ESTIMATORS.items()))
    st.markdown(
        "The D formula that the paper prints as (15) weights the records differently from its "
        "pseudo-inverse (13)–(14). Both are exact without noise."
    )


def show_fitted_model(fit: ElasticityFit) -> None:
    """The model, the effects fitted in addition to K and D, and the compared models."""
    st.write(f"Fitted model: {model_name(fit)}.")
    if further := further_quantities(fit):
        names, shown = [q.name for q in further], [q.shown for q in further]
        show_text_table(
            {"": names, "Fitted": [text for text, _ in shown], "Unit": [unit for _, unit in shown]}
        )
    if of_friction := friction_note(fit):
        st.caption(of_friction)
    if fit.candidates:
        _show_candidates(fit.candidates)


def _show_candidates(candidates: Sequence[Candidate]) -> None:
    st.write(
        "Models compared. The one with the smallest information criterion is chosen: its residual "
        "plus a penalty for every parameter. Around a reversal a motor may stick and its friction is "
        'unknown: "free below 3 %" leaves friction free below 3 % of the largest speed.'
    )
    show_text_table(
        {
            "Model": [c.name + (" (chosen)" if c.chosen else "") for c in candidates],
            "Parameters": ["–" if c.problem else str(c.parameters) for c in candidates],
            "Residual / noise": [_left_over(c) for c in candidates],
            "Criterion": [c.problem or significant(c.criterion, 4) for c in candidates],
        }
    )


def _left_over(candidate: Candidate) -> str:
    if candidate.problem or candidate.expected_cost <= 0:
        return "–"
    return significant(float(np.sqrt(candidate.cost / candidate.expected_cost)), 2)


def estimates_table(analysis: Analysis) -> Table:
    """K, D ± standard error of every estimator, and the nominal values."""
    fits = {analysis.fit.method: analysis.fit} | dict(analysis.fits)
    nominal = analysis.nominal
    columns: dict[str, list[object]] = {"Estimator": [*fits]}
    found = [elasticity_quantities(fit, analysis.unit) for fit in fits.values()]
    for k, same in enumerate(zip(*found, strict=True)):
        cells = columns[f"{same[0].name} ({same[0].unit})"] = [each.shown[0] for each in same]
        if nominal is not None:
            cells.append(plain(float(f"{nominal[k]:.5g}")))
    columns["Residual / noise"] = [significant(float(np.sqrt(fit.misfit)), 2) for fit in fits.values()]
    if nominal is not None:
        columns["Estimator"].append("nominal")
        columns["Residual / noise"].append("–")
    return columns


def show_matrix(fit: ElasticityFit) -> None:
    """Equation (12) with its condition, and the correlation of the estimates."""
    st.write(
        f"A has {2 * fit.n * fit.equations.omega.size} rows, two per joint and record. With columns of "
        f"unit length its condition number is {significant(fit.condition, 3)}; near 1, the records "
        "determine K and D independently."
    )
    A, b = fit.equations.matrix()
    names = [name for j in range(1, fit.n + 1) for name in (f"D{j}", f"K{j}")]
    table({name: A[:, k].tolist() for k, name in enumerate(names)} | {"b": b.tolist()}, height=300)
    st.write("Correlation of the estimates:")
    order = [f"K{j + 1}" for j in range(fit.n)] + [f"D{j + 1}" for j in range(fit.n)]
    rows = [[significant(float(x), 2) for x in row] for row in fit.correlation]
    columns = {name: [row[k] for row in rows] for k, name in enumerate(order)}
    show_text_table({"": order} | columns)
