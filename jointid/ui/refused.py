"""A file that was refused: one message, and its tables as they stand."""

from __future__ import annotations

import streamlit as st

from jointid.figures import raw_columns
from jointid.study_files import PeekedTable
from jointid.ui.charts import is_dark, plot
from jointid.ui.workspace import Refused

_PLOTTED = 12


def show_refused() -> None:
    """Show the last refused file above the page until it is put away; the chosen study stays chosen."""
    refused: Refused | None = st.session_state.get("refused")
    if refused is None:
        return
    st.error(f"**{refused.file} was not opened.** {refused.message}")
    if refused.tables:
        with st.expander("What is in the file", expanded=True):
            names = [table.name for table in refused.tables]
            name = st.selectbox("Table", names, key="peeked_table")
            _show_table(refused.tables[names.index(name)])
    st.button("Put away", key="put_away", on_click=lambda: st.session_state.pop("refused", None))
    st.divider()


def _show_table(table: PeekedTable) -> None:
    if table.error or table.frame.empty:
        st.write(table.error or f"{table.name} has no rows.")
        return
    st.dataframe(table.frame.head(50), height=230)
    numbers = table.frame.select_dtypes("number")
    columns = {str(name): numbers[name].to_numpy(float) for name in list(numbers)[:_PLOTTED]}
    if columns:
        st.caption(f"The first {len(table.frame)} rows of its columns of numbers.")
        plot(raw_columns(columns, dark=is_dark()), f"Columns of {table.name}", key="peeked_plot")
