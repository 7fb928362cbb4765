"""A refused file: one message, and the lines around its fault."""

import streamlit as st

from jointid.ui.shared.messages import markdown_escape
from jointid.ui.shared.workspace import Refused


def show_refused() -> None:
    """Show the last refused file above the page until it is dismissed; the chosen study stays chosen."""
    refused: Refused | None = st.session_state.get("refused")
    if refused is None:
        return
    st.error(f"**{markdown_escape(refused.file)} was not opened.** {markdown_escape(refused.message)}")
    if refused.lines:
        st.code(refused.lines, language=None)
    st.button("Dismiss", key="dismiss_refused", on_click=lambda: st.session_state.pop("refused", None))
    st.divider()
