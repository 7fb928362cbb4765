"""The logs as they are: first rows and curves, folded once the columns are understood."""

from collections.abc import Sequence

import streamlit as st

from jointid.figures import raw_columns
from jointid.importing import LogTable
from jointid.ui.importing.files import Log
from jointid.ui.shared.charts import is_dark, plot, table
from jointid.ui.shared.messages import show_note

_FIRST_ROWS = 50
_FEW_CURVES = 4


def choose_log(logs: Sequence[Log]) -> Log:
    """Ask which log to look at when there are several."""
    if len(logs) == 1:
        return logs[0]
    by_key = {log.key: log for log in logs}
    if st.session_state.get("import look", logs[0].key) not in by_key:
        del st.session_state["import look"]
    key = st.selectbox(
        "Log to show",
        list(by_key),
        format_func=lambda key: by_key[key].table.name,
        key="import look",
        persist_state="session",
        help="Logs with the same columns share one mapping. All of them go into the study.",
    )
    return by_key[key]


def show_raw(log: LogTable, proposed: Sequence[str]) -> None:
    """First rows, and curves of some columns over the time column or the row."""
    for note in log.notes:
        show_note(note)
    left, right = st.columns([2, 3])
    with left:
        show_note(f"{log.name}: {log.rows} rows, {len(log.columns)} columns. The first rows:")
        headings = {c.name: _heading(c.name, c.unit) for c in log.columns}
        names = list(log.names)
        time = proposed[0] if proposed else names[0]
        rows = {headings[c.name]: c.values[:_FIRST_ROWS].tolist() for c in log.columns}
        table(rows, height=400, exact=headings[time])
    with right:
        others = [name for name in names if name != time]
        curves = others if len(others) <= _FEW_CURVES else list(proposed[1:]) or others
        key = f"import curves {log.signature}"
        begun = curves[:_FEW_CURVES]
        chosen = st.multiselect(
            "Columns in the picture", others, begun, key=key, persist_state="session"
        )
        if chosen:
            shown = {headings[name]: log.column(name).values for name in (time, *chosen)}
            plot(raw_columns(shown, dark=is_dark()), "Columns as they are in the file")


def _heading(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name
