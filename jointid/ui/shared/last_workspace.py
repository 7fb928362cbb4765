"""The way back to the last workspace from the bare address: its id is kept in the browser only."""

from pathlib import Path
from urllib.parse import quote

import streamlit as st

_component = st.components.v2.component(
    "jointid_last_workspace",
    html='<a target="_self" hidden>Continue where you left off</a>',
    css="a { color: var(--st-link-color); font-size: 0.9rem; }",
    js=Path(__file__).with_suffix(".js").read_text("utf-8"),
)


def offer_last_workspace(current: str | None, study: str, unknown: str) -> None:
    """Remember the open workspace in the browser, or link to the one opened last.

    Parameters
    ----------
    current : str or None
        Id of the open workspace.
    study : str
        Key of the chosen study in the address.
    unknown : str
        Id that no longer exists on this server, to be forgotten.
    """
    _component(
        key="last_workspace", data={"current": current or "", "study": quote(study), "unknown": unknown}
    )
