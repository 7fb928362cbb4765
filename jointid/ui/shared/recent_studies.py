"""The studies kept at this address, and the way back to them from the bare address."""

from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

import streamlit as st

from jointid import JointIdError
from jointid.files.store_files import Entry
from jointid.ui.shared import workspace
from jointid.ui.shared.messages import markdown_escape, show_warning

_component = st.components.v2.component(
    "jointid_last_workspace",
    html='<a target="_self" hidden>Continue where you left off</a>',
    css="a { color: var(--st-link-color); font-size: 0.9rem; }",
    js=Path(__file__).with_name("last_workspace.js").read_text("utf-8"),
)


_MOST_SHOWN = 20
_NEARLY_FULL = 0.8


def show_notes(place: str | None, forget: str = "") -> None:
    """Show the notes on removed entries of a place in the store until they are dismissed.

    ``forget`` is a key of the session that goes with them.
    """
    with suppress(JointIdError):
        for entry, note in workspace.store().notes(place).items() if place else ():
            show_warning(note)
            given = place, entry, forget
            st.button("Dismiss", key=f"dismiss_{entry}", on_click=_dismiss, args=given)


def _dismiss(place: str, note: str, forget: str) -> None:
    with workspace.noting_problems():
        workspace.store().dismiss(place, note)
    if forget:
        st.session_state.pop(forget, None)


def _link_to_last(key: str) -> None:
    """Let the browser remember workspace and study, forget an unknown one, or link to the last ones."""
    chosen, unknown = (st.session_state.get(key) or "" for key in ("chosen", "unknown_workspace"))
    data = {"current": workspace.workspace() or "", "study": quote(chosen), "unknown": unknown}
    _component(key=key, data=data)


def link_to_last_on_a_phone() -> None:
    """Link to the last workspace on the page itself, where a phone has folded the sidebar."""
    if not workspace.workspace():
        with st.container(key="narrow way back"):
            _link_to_last("last_workspace_on_page")


def show_recent() -> None:
    """List the workspace's studies, with the notes and problems of the store."""
    if problem := st.session_state.pop("store_problem", None):
        show_warning(problem)
    show_notes(workspace.workspace())
    _link_to_last("last_workspace")
    kept = workspace.recent()
    if not kept:
        return
    with st.expander(f"Recent studies ({len(kept)})"):
        for name, entry in list(kept.items())[:_MOST_SHOWN]:
            _row(name, entry)
        _show_storage(kept)


def _row(name: str, entry: Entry) -> None:
    with st.container(horizontal=True, vertical_alignment="center", gap="small"):
        st.button(
            markdown_escape(name),
            key=f"open_{entry.id}",
            type="tertiary",
            width="stretch",
            on_click=lambda: st.session_state.update(chosen=entry.digest),
        )
        with st.popover("Edit", help=f"Rename or delete {markdown_escape(name)}"):
            key = f"name_{entry.id}"
            st.text_input(
                "Name",
                entry.name,
                key=key,
                on_change=lambda: workspace.change_store("rename", entry.id, st.session_state[key]),
            )
            st.caption(f"{entry.size_bytes / 2**20:.1f} MiB. Deleting cannot be undone.")
            remove = "delete", entry.id
            st.button("Delete", key=f"delete_{entry.id}", on_click=workspace.change_store, args=remove)


def _show_storage(kept: dict[str, Entry]) -> None:
    store = workspace.store()
    try:
        used = _used(str(store.folder))
    except JointIdError:
        return
    here, all_of_it, limit = (
        f"{size / 2**20:.1f}"
        for size in (sum(entry.size_bytes for entry in kept.values()), used, store.limit_bytes)
    )
    st.caption(
        "Stored under this page's address: bookmark it. Anyone with the address sees these studies. "
        f"They take {here} MiB; the store on this computer holds {all_of_it} of {limit} MiB."
    )
    if used > _NEARLY_FULL * store.limit_bytes:
        st.warning("The store is nearly full: the least recently opened studies will be deleted.")


@st.cache_data(ttl=10, show_spinner=False)
def _used(folder: str) -> int:
    return workspace.store().size_bytes()
