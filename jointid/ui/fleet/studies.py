"""The studies of a fleet one by one: those that failed, all in a table, one to open."""

from collections.abc import Sequence

import streamlit as st

from jointid import JointIdError
from jointid.analysis import NOT_USABLE, USABLE, WITH_CARE
from jointid.answer import UNITS
from jointid.files.study_files import load_study
from jointid.fleet.row import Row
from jointid.ui.fleet.files import OpenFleet
from jointid.ui.shared.charts import table
from jointid.ui.shared.markdown_escape import markdown_escape
from jointid.ui.shared.messages import show_error, show_note
from jointid.ui.shared.method_steps import OVERVIEW
from jointid.ui.shared.workspace import keep, recent
from jointid.wording import counted, with_error

SIGNS = {USABLE: "✓ usable", WITH_CARE: "△ usable with care", NOT_USABLE: "✕ not usable", "": "— failed"}


def show_failed(rows: Sequence[Row]) -> None:
    """Studies without an answer, and why."""
    failed = [row for row in rows if not row.is_good]
    if not failed:
        return
    st.header(f"Failed: {counted(len(failed), 'study')}", anchor=False)
    table({"Study": [label(row) for row in failed], "Why": [row.error for row in failed]}, height=300)


def show_studies(fleet: OpenFleet, rows: Sequence[Row]) -> None:
    """Every study in a table; a chosen one can be opened."""
    st.header("Every study", anchor=False)
    if not fleet.columns:
        fleet.columns = _columns(rows)
    st.dataframe(
        fleet.columns,
        hide_index=True,
        height=min(36 + 35 * len(rows), 400),
        key="fleet_table",
        on_select=_take_selection,
        selection_mode="single-row",
        column_config={"Study": st.column_config.Column(pinned=True)},
    )
    st.caption(
        f"K in {UNITS['K']}, D in {UNITS['D']}, seen from the motor, ± one standard error. A table of "
        "many joints scrolls sideways."
    )
    st.selectbox(
        "Study to show",
        range(len(rows)),
        index=None,
        format_func=lambda k: f"{k + 1}: {label(rows[k])}",
        key="fleet_study",
        placeholder="Choose here, or tick a row of the table",
    )
    chosen = st.session_state.get("fleet_study")
    if chosen is not None and chosen < len(rows):
        _show_study(fleet, rows[chosen])


def _columns(rows: Sequence[Row]) -> dict[str, list[str]]:
    columns = {
        "Study": [label(row) for row in rows],
        "Robot": [row.robot for row in rows],
        "Date": [row.date for row in rows],
        "State": [SIGNS[row.state] for row in rows],
    }
    for j in range(max(row.joints for row in rows)):
        for quantity in "KD":
            columns[f"{quantity}{j + 1}"] = [_value(row, quantity, j) for row in rows]
    return columns


def _take_selection() -> None:
    selected = st.session_state["fleet_table"]["selection"]["rows"]
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
                    st.session_state["chosen"] = entry.id
                else:
                    keep(load_study(fleet.studies[row.content]), label(row))
                st.switch_page(OVERVIEW.path)
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
    if row.joints <= j:
        return ""
    return with_error(getattr(row, quantity)[j], getattr(row, f"{quantity}_error")[j])
