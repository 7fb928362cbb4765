"""The sidebar: the steps, which study, and what holds for the whole study."""

from __future__ import annotations

import streamlit as st
from streamlit.runtime.scriptrunner import get_script_run_ctx

from jointid import JointIdError
from jointid.files.study_files import load_study
from jointid.ui.shared import cached
from jointid.ui.shared.markdown_escape import markdown_escape
from jointid.ui.shared.messages import show_info
from jointid.ui.shared.method_steps import IMPORT, METHOD, OVERVIEW, SIMULATE
from jointid.ui.shared.recent_studies import show_recent
from jointid.ui.shared.workspace import keep, names_by_address, refuse, sample_paths, set_in_address

_ID_LENGTH = 32
_UPLOADER = "uploaded"
_ARRIVED = "arrived_study"


def choose_study() -> tuple[str, str] | None:
    """Draw the sidebar and return the chosen study's key and estimator, or None without any study."""
    with st.sidebar:
        _remember_file()
        for step in (OVERVIEW, *METHOD):
            st.page_link(step.path, label=step.name)
        st.divider()
        above = st.container()
        _open_file()
        with above:  # drawn last: it knows what has just been opened
            key = _choose()
        st.page_link(IMPORT.path, label=IMPORT.name, help=IMPORT.line)
        st.page_link(SIMULATE.path, label=SIMULATE.name, help=SIMULATE.line)
        st.divider()
        method = st.selectbox(
            "Estimator",
            list(cached.ESTIMATORS),
            key="estimator",
            bind="query-params",
            help="How K and D are computed from the phasors. "
            + "; ".join(f"{name}: {line}" for name, line in cached.ESTIMATORS.items())
            + ". The page Elasticity compares them.",
        )
    return None if key is None else (key, method)


def _choose() -> str | None:
    """Ask which study. The choice lives in the session, and in the address so that it survives F5."""
    names = names_by_address()
    wanted = st.session_state.get("chosen") or st.query_params.get("study")
    if wanted is not None and wanted not in names:
        what = "The study of this address" if len(wanted) == _ID_LENGTH else f'"{wanted}"'
        show_info(f"{what} is not in this workspace, or not any more. Open its file again.")
    if wanted not in names:
        wanted = next(iter(sample_paths()), next(iter(names), None))
    st.session_state["chosen"] = wanted
    st.session_state["study"] = None if wanted is None else names[wanted]
    st.selectbox(
        "Study",
        list(names.values()),
        key="study",
        on_change=_take_choice,
        disabled=not names,
        help="What was opened, simulated or imported at this address, and the sample studies.",
    )
    if wanted is not None:
        set_in_address("study", wanted)
    show_recent()
    return None if wanted is None else names[wanted]


def _take_choice() -> None:
    """Take what was chosen in the list of studies, by a person.

    A fragment's timer repeats what its page shows, perhaps the study before the one just opened: the
    list is in no fragment, so that what comes with a fragment's run is no choice.
    """
    context = get_script_run_ctx()
    if context is not None and context.fragment_ids_this_run:
        return
    chosen = st.session_state["study"]
    st.session_state["chosen"] = next(
        (address for address, name in names_by_address().items() if name == chosen), None
    )


def _remember_file() -> None:
    """Put a file that was dropped into the session, before anything is drawn.

    The next click ends a run wherever it is, and the uploader of another page knows nothing of the file:
    from the session, the run after the click takes it.
    """
    file = st.session_state.get(_UPLOADER)
    if file is not None and file.file_id != st.session_state.get("seen_upload"):
        st.session_state[_ARRIVED] = (file.name, file.getvalue())
        st.session_state["seen_upload"] = file.file_id


def _open_file() -> None:
    """Ask for a file, and keep the study in the one that has come."""
    with st.popover("Open a study (.zip)", width="stretch"):
        st.file_uploader(
            "A study folder, zipped",
            type="zip",
            key=_UPLOADER,
            help="study.toml with the inertias, and one table per sine experiment.",
        )
        arrived: tuple[str, bytes] | None = st.session_state.get(_ARRIVED)
        if arrived is None:
            return
        try:
            _keep_or_refuse(*arrived)
        except Exception:
            del st.session_state[_ARRIVED]  # a fault of ours must not meet every page from now on
            raise
        del st.session_state[_ARRIVED]


def _keep_or_refuse(name: str, data: bytes) -> None:
    try:
        with st.spinner(markdown_escape(f"Reading {name}")):
            study = load_study(data)
    except JointIdError as error:
        refuse(name, error, data)
    else:
        keep(study, name)
