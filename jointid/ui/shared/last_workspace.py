"""The way back to the last workspace from the bare address: its id is kept in the browser only."""

from urllib.parse import quote

import streamlit as st

_JS = """
const KEY = "jointid workspace";

export default function ({ parentElement, data }) {
  const link = parentElement.querySelector("a");
  link.hidden = true;
  try {
    if (data.current) return localStorage.setItem(KEY, `w=${data.current}&study=${data.study}`);
    const last = localStorage.getItem(KEY) ?? "";
    if (data.unknown && last.includes(data.unknown)) return localStorage.removeItem(KEY);
    if (!/^w=[A-Za-z0-9_-]{32}&study=/.test(last)) return;
    link.href = `?${last}`;
    link.hidden = false;
  } catch {
    // A browser may forbid storage: then there is no way back but the full address.
  }
}
"""

_component = st.components.v2.component(
    "jointid_last_workspace",
    html='<a target="_self" hidden>Continue where you left off</a>',
    css="a { color: var(--st-link-color); font-size: 0.9rem; }",
    js=_JS,
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
