"""A refused file: one message, and a preview of its tables."""

import numpy as np
import streamlit as st

from jointid.arrays import Floats
from jointid.figures import raw_columns
from jointid.files.study_files import PeekedTable
from jointid.ui.shared.charts import is_dark, plot
from jointid.ui.shared.messages import markdown_escape, show_note
from jointid.ui.shared.workspace import Refused

_PLOTTED = 12
_ABOVE, _BELOW = 6, 7
"""Rows shown around the refused one."""


def show_refused() -> None:
    """Show the last refused file above the page until it is dismissed; the chosen study stays chosen."""
    refused: Refused | None = st.session_state.get("refused")
    if refused is None:
        return
    st.error(f"**{markdown_escape(refused.file)} was not opened.** {markdown_escape(refused.message)}")
    if refused.tables:
        names = [table.name for table in refused.tables]
        culprits = [k for k, table in enumerate(refused.tables) if table.refused]
        # Folded where no table is at fault.
        with st.expander("What is in the file", expanded=bool(culprits)):
            culprit = next(iter(culprits), 0)
            name = st.selectbox(
                "Table",
                names,
                index=culprit,
                key=f"peeked_table_{refused.file}_{hash(refused.message)}",  # per refusal
            )
            _show_table(refused.tables[names.index(name)])
    st.button("Dismiss", key="dismiss_refused", on_click=lambda: st.session_state.pop("refused", None))
    st.divider()


def _show_table(table: PeekedTable) -> None:
    if table.error or table.frame.empty:
        show_note(table.error or f"{table.name} has no rows.")
        return
    from jointid.files.table_preview import plottable  # with pandas, see peek_study

    frame, at = table.frame, table.refused_at
    place = str(frame.index.name or "Row").lower()
    lines = [int(line) for line in frame.index]
    marked = lines.index(at) if at in lines else None
    part = slice(0, 50) if marked is None else slice(max(marked - _ABOVE, 0), marked + _BELOW)
    shown = frame.iloc[part].copy()
    shown.index = [f"▶ {line}" if line == at else str(line) for line in lines[part]]
    shown.index.name = place.capitalize()
    if marked is not None:
        show_note(f"Around {place} {at} of {table.name}, marked with ▶.")
    st.dataframe(shown, height=230 if marked is None else "content")
    columns = dict(list(plottable(frame).items())[:_PLOTTED])
    if columns:
        first = f"{place.capitalize()}s {lines[0]} to {lines[-1]}"
        gaps = "; gaps are cells that hold no number" if _gaps(columns) else ""
        show_note(f"{first}, columns of numbers{gaps}.")
        figure = raw_columns(columns, marked=marked, dark=is_dark())
        plot(figure, f"Columns of {table.name}", key="peeked_plot")


def _gaps(columns: dict[str, Floats]) -> bool:
    return any(bool(np.isnan(column).any()) for column in columns.values())
