"""Panels of the fleet page: headline, spread, outliers, failed and single studies."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import streamlit as st

from jointid import JointIdError
from jointid.analysis import NOT_USABLE, STATES, USABLE, WITH_CARE
from jointid.estimation.estimators.parameters import PARAMETERS
from jointid.figures.fleet import distribution
from jointid.files.study_files import load_study
from jointid.fleet.row import Row
from jointid.fleet.spread import MIN_VALUES, OUTLIER_Z, Spread, few_values
from jointid.ui.fleet.files import OpenFleet
from jointid.ui.shared.charts import choose_segment, plot, side_by_side, table
from jointid.ui.shared.messages import markdown_escape, show_error, show_note, show_text_table
from jointid.ui.shared.method_steps import OVERVIEW
from jointid.ui.shared.workspace import go_to, keep, recent
from jointid.wording import counted, listed, minus, significant, with_error

_QUANTITIES = {"K": "Stiffness", "D": "Damping"}
_CHOOSABLE = "table of studies"
_MOST_REASONS, _MOST_NAMES = 20, 5
"""Reasons of failed studies that are listed, and studies named with each."""


def show_headline(rows: Sequence[Row]) -> None:
    """Number of studies and robots, and the states of the answers."""
    good = [row for row in rows if row.is_good]
    robots = {row.robot for row in good if row.robot}
    parts = [counted(len(rows), "study")]
    if robots:
        parts.append(counted(len(robots), "robot"))
    parts += [
        f"{count} {state}" for state in STATES if (count := sum(row.state == state for row in good))
    ]
    if failed := len(rows) - len(good):
        parts.append(f"{failed} failed")
    st.markdown(" &nbsp;·&nbsp; ".join(parts))


def choose(rows: Sequence[Row]) -> tuple[int, bool]:
    """Ask for the joint, from 1, and whether studies are compared within their robot."""
    joints = max((row.joints for row in rows), default=0)
    left, right = st.columns(2)
    with left:
        joint = choose_segment(
            "Joint", range(1, joints + 1), "fleet_joint", format_func=lambda j: f"Joint {j}"
        )
    choices = ["the fleet", "the same robot"]
    with right:
        against = choose_segment(
            "Every study is compared with",
            choices,
            "fleet_against",
            hint="Where robots differ by design, compare each with its own studies.",
        )
    return min(joint, joints), against == choices[1]


def show_spread(spreads: Sequence[Spread], *, dark: bool) -> None:
    """Stiffness and damping side by side, with their median and spread in words."""
    for spread, place in zip(spreads, side_by_side(len(spreads)), strict=True):
        with place:
            quantity = spread.name[0]
            st.markdown(f"**{_QUANTITIES[quantity]} {spread.name}**: {spread_in_words(spread)}")
            plot(
                distribution(spread, dark=dark),
                f"Histogram of {spread.name} over the studies",
                key=f"fleet_{quantity}",
            )
    st.caption(
        "Solid line: median. Dotted lines: the robust spread to either side, 1.48 times the median "
        "distance from the median. Crosses: outliers; ◄ and ►: studies beyond the axis. "
        "Answers that are not usable are left out."
    )


def spread_in_words(spread: Spread) -> str:
    unit = PARAMETERS[spread.name[0]].unit
    if np.isfinite(spread.spread):
        share = 100 * spread.spread / abs(spread.median) if spread.median else float("nan")
        text = with_error(spread.median, spread.spread)
        return f"median ± robust spread {text} {unit} ({significant(share, 2)} %)"
    if spread.value.size < 2:
        return f"{significant(spread.median, 3)} {unit}; a spread needs at least 2 studies"
    *limits, ratio = (significant(x, 2) for x in few_values(spread.value, spread.error))
    return (
        f"mean {significant(float(spread.value.mean()), 4)}, standard deviation {limits[0]} {unit} from "
        f"{spread.value.size} studies (95 %: {limits[1]} to {limits[2]}), {ratio} × the standard errors"
    )


def show_outstanding(spreads: Sequence[Spread], *, within_robot: bool) -> None:
    """Outliers, and their criterion."""
    st.header("Outliers", anchor=False)
    whose = "its robot's studies" if within_robot else "the fleet"
    st.caption(
        f"A value is an outlier beyond |z| = {OUTLIER_Z:g}: z is its distance from the median of "
        f"{whose} over √(s² + e²), with the robust spread s and the value's own standard error e. "
        f"K in {PARAMETERS['K'].unit}, D in {PARAMETERS['D'].unit}."
    )
    if not any(len(spread.rows) >= MIN_VALUES for spread in spreads):
        st.info(f"Outliers need at least {MIN_VALUES} studies.")
        return
    found = [(spread, k) for spread in spreads for k in np.flatnonzero(spread.outliers)]
    if not found:
        st.success("No outliers for this joint.")
        return
    found.sort(key=lambda pair: -abs(float(pair[0].z[pair[1]])))
    rows = [spread.rows[k] for spread, k in found]
    columns = _which(rows) | {
        "Value": [f"{s.name} = {with_error(float(s.value[k]), float(s.error[k]))}" for s, k in found],
        "Median": [significant(float(s.centre[k]), 4) for s, k in found],
        "z": [minus(f"{s.z[k]:+.1f}") for s, k in found],
        "State": [SIGNS[row.state] for row in rows],
    }
    table(columns, height=300, phone=["Study", "Value", "z"])


SIGNS = {USABLE: "✓ usable", WITH_CARE: "△ usable with care", NOT_USABLE: "✕ not usable", "": "— failed"}


def show_failed(rows: Sequence[Row]) -> None:
    """Studies without an answer, and why."""
    failed = [row for row in rows if not row.is_good]
    if not failed:
        return
    st.header(f"Failed: {counted(len(failed), 'study')}", anchor=False)
    studies: dict[str, list[str]] = {}
    for row in failed:
        studies.setdefault(row.error, []).append(label(row))
    shown = dict(list(studies.items())[:_MOST_REASONS])
    names = [listed(each, at_most=_MOST_NAMES) for each in shown.values()]
    show_text_table({"Studies": names, "Why": list(shown)})
    if len(studies) > len(shown):
        st.caption(f"The first {len(shown)} of {len(studies)} reasons; the saved results hold all.")


def show_studies(fleet: OpenFleet, rows: Sequence[Row]) -> None:
    """Every study in a table; a chosen one can be opened."""
    st.header("Every study", anchor=False)
    if not fleet.columns:
        fleet.columns = _columns(rows)
    taken: dict[str, Any] = {"on_select": _take_selection, "selection_mode": "single-row"}
    table(fleet.columns, height=400, phone=("Study", "State"), key=_CHOOSABLE, **taken)
    st.caption(
        f"K in {PARAMETERS['K'].unit}, D in {PARAMETERS['D'].unit}, seen from the motor, ± one standard "
        "error. On a phone, the table shows the states only."
    )
    st.selectbox(
        "Study to show",
        range(len(rows)),
        index=None,
        format_func=lambda k: f"{k + 1}: {label(rows[k])}",
        key="fleet_study",
        placeholder="Choose here, or tick a row of a wide table",
    )
    chosen = st.session_state.get("fleet_study")
    if chosen is not None and chosen < len(rows):
        _show_study(fleet, rows[chosen])


def _which(rows: Sequence[Row]) -> dict[str, list[str]]:
    return {
        "Study": [label(row) for row in rows],
        "Robot": [row.robot for row in rows],
        "Date": [row.date for row in rows],
    }


def _columns(rows: Sequence[Row]) -> dict[str, list[str]]:
    columns = _which(rows) | {"State": [SIGNS[row.state] for row in rows]}
    for quantity in "KD":
        for j in range(max(row.joints for row in rows)):
            columns[f"{quantity}{j + 1}"] = [_value(row, quantity, j) for row in rows]
    return columns


def _take_selection() -> None:
    selected = st.session_state[_CHOOSABLE]["selection"]["rows"]
    if selected:
        st.session_state["fleet_study"] = selected[0]


def _show_study(fleet: OpenFleet, row: Row) -> None:
    with st.container(border=True):
        st.markdown(f"**{markdown_escape(row.name or label(row))}** &nbsp;·&nbsp; {SIGNS[row.state]}")
        if not row.is_good:
            show_error(row.error)
        for finding in row.findings[:3]:
            show_note(finding)
        entry = next((e for e in recent().values() if row.digest and e.digest == row.digest), None)
        if entry is not None or (row.is_good and row.content in fleet.studies):
            if not st.button("Open this study", key="fleet_open_study"):
                return
            try:
                if entry is not None:
                    st.session_state["chosen"] = entry.digest
                else:
                    keep(load_study(fleet.studies[row.content]), label(row))
                go_to(OVERVIEW)
            except JointIdError as error:
                show_error(error)
        elif row.is_good:
            st.caption(
                "This study is not in this workspace, and for security, paths "
                "in a table are not opened. Open its .zip in the sidebar, or drop it above: then it "
                "opens from here."
            )


def label(row: Row) -> str:
    """A short name: the last two parts of the path."""
    return "/".join(row.study.replace("\\", "/").rstrip("/").split("/")[-2:])


def _value(row: Row, quantity: str, j: int) -> str:
    if len(getattr(row, quantity)) <= j:
        return ""
    if row.state == NOT_USABLE:
        return "–"
    return with_error(getattr(row, quantity)[j], getattr(row, f"{quantity}_error")[j])
