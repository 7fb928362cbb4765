"""The import in progress, kept at this workspace's address: logs, entries and corrected runs.

Files and a small JSON lie in the store as long as the logs are open: a refresh, a closed tab or a killed
server loses neither. The JSON holds the entries, never results.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager

import streamlit as st

from jointid import JointIdError
from jointid.ui.importing.files import Dropped, dropped, hold
from jointid.ui.importing.mapping import mappings_from_json, mappings_to_json, of_mapping, offer_again
from jointid.ui.importing.segments import forget_rows, rows_from_json, rows_to_json
from jointid.ui.shared import workspace
from jointid.ui.shared.messages import show_warning
from jointid.ui.shared.recent_studies import show_notes

_PART = "import"
_DRAFT = "entries"
_ENTRY = "import "
"""Prefixes of the keys of all entries of the page; buttons and tables have others."""
_WRITTEN = "kept_import"
_MADE = "import_made"
_PROBLEM = "import_problem"
_LOST = "import_lost"
_SHARE = 4
"""An import takes at most the store's size over this, so that it does not push studies out."""


@contextmanager
def kept_import() -> Iterator[None]:
    """Restore the import of this address once per session; keep its state at the end of the page."""
    if _WRITTEN not in st.session_state:
        st.session_state[_WRITTEN] = ""
        _restore()
    try:
        yield
    finally:  # also when the page stops halfway, or is run again
        keep_import()


def keep_import() -> None:
    """Write the open logs and entries to the store if they have changed."""
    files = dropped()
    text = _snapshot(files)
    if text == st.session_state[_WRITTEN]:
        return
    st.session_state[_WRITTEN] = text
    try:
        if not files:
            workspace.empty_part(_PART)
        else:
            _write(files, text.encode())
    except JointIdError as error:
        st.session_state[_PROBLEM] = f"The logs are open in this session only. {error}"
    else:
        st.session_state.pop(_PROBLEM, None)


def is_finished() -> bool:
    """Whether a study was made from the open logs and entries."""
    return bool(dropped()) and st.session_state.get(_MADE) == st.session_state.get(_WRITTEN)


def show_storage_state() -> None:
    """Show whether the import is kept, and what could not be kept or restored."""
    if problem := st.session_state.get(_PROBLEM):
        show_warning(problem)
    for problem in st.session_state.get(_LOST, []):
        show_warning(problem)
    place = workspace.place_for(_PART)
    if place is None:
        return
    if dropped() and not st.session_state.get(_PROBLEM):
        st.caption(
            "The study made from these logs is kept. Logs and entries stay open in this session only; "
            "the next change stores them again."
            if is_finished()
            else "Logs and entries are stored under this page's address until they are closed or opened "
            "as a study."
        )
    show_notes(place, _LOST)


def forget_import() -> None:
    """Remove the import from the store; it stays open in this session."""
    keep_import()
    with workspace.noting_problems():
        workspace.empty_part(_PART)
        st.session_state[_MADE] = st.session_state[_WRITTEN]


def clear_entries() -> None:
    """Clear the entries of the robot and the runs; mappings stay."""
    for key in [key for key in st.session_state if str(key).startswith(_ENTRY)]:
        if not of_mapping(str(key)):
            del st.session_state[key]
    forget_rows()
    offer_again()


def _write(files: list[Dropped], text: bytes) -> None:
    size, limit = sum(len(file.data) for file in files), workspace.store().limit_bytes / _SHARE
    if size > limit:
        raise JointIdError(
            f"The logs take {size / 2**20:.4g} MiB, and the store keeps up to {limit / 2**20:.4g} MiB "
            "of logs: open them as a study, or import them in parts."
        )
    there = workspace.part_entries(_PART)
    for file in files:
        if file.digest not in there:
            workspace.keep_part(_PART, file.name, file.digest, file.data)
    digests = [file.digest for file in files]
    workspace.keep_part(_PART, "Entries of the import", _DRAFT, text, beside=digests)


def _snapshot(files: list[Dropped]) -> str:
    """Return files and entries as JSON; empty without files."""
    if not files:
        return ""
    entries = {
        key: value
        for key, value in st.session_state.items()
        if isinstance(key, str) and key.startswith(_ENTRY) and _is_plain(value)
    }
    values = {
        "format": 1,
        "files": [[file.name, file.digest] for file in files],
        "entries": dict(sorted(entries.items())),
        "mappings": mappings_to_json(),
        "rows": rows_to_json(),
    }
    return json.dumps(values)


def _is_plain(value: object) -> bool:
    if isinstance(value, list):
        return all(isinstance(item, str) for item in value)
    return isinstance(value, str | int | float)


def _restore() -> None:
    """Fill the session from the store; show which files are lost."""
    place = workspace.place_for(_PART)
    if place is None or dropped():
        return
    try:
        entries = workspace.part_entries(_PART)
    except JointIdError as error:
        st.session_state["store_problem"] = str(error)
        return
    draft = entries.pop(_DRAFT, None)
    names: list[tuple[str, str]] = [(entry.name, entry.digest) for entry in entries.values()]
    if draft is not None:
        try:
            values = json.loads(workspace.store().read(place, draft.id))
            if values["format"] != 1:
                raise ValueError(values["format"])
            names = [(str(name), str(digest)) for name, digest in values["files"]]
            mappings_from_json(values["mappings"])
            rows_from_json(values["rows"])
            for key, value in values["entries"].items():
                if key.startswith(_ENTRY) and _is_plain(value):
                    st.session_state[key] = value
        except JointIdError as error:
            st.session_state["store_problem"] = str(error)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            workspace.store().set_aside(place, draft.id, "its format is unknown to this version")
    files, lost = [], []
    for name, digest in names:
        try:
            if digest not in entries:
                raise JointIdError("It is no longer in the store.")
            files.append(Dropped(name, workspace.store().read(place, entries[digest].id), digest))
        except JointIdError as error:
            lost.append(f"{name} is no longer open: drop it again. {error}")
    hold(files)
    st.session_state[_LOST] = lost
    st.session_state[_WRITTEN] = _snapshot(files)
