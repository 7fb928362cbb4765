"""The sidebar: the steps, which study, and what holds for the whole study."""

from __future__ import annotations

import streamlit as st

from jointid import JointIdError
from jointid.study_files import load_study
from jointid.ui import cached
from jointid.ui.recent import show_recent
from jointid.ui.steps import IMPORT, METHOD, OVERVIEW, SIMULATE
from jointid.ui.workspace import keep, names_by_address, refuse, sample_paths

_ID_LENGTH = 32


def choose_study() -> tuple[str, str] | None:
    """Draw the sidebar and return the chosen study's key and estimator, or None without any study."""
    with st.sidebar:
        for step in (OVERVIEW, *METHOD):
            st.page_link(step.path, label=step.name)
        st.divider()
        key = _choose()
        _open_file()
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
        st.info(f"{what} is not in this workspace, or not any more. Open its file again.")
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
        st.query_params["study"] = wanted  # links between pages drop it
    show_recent()
    return None if wanted is None else names[wanted]


def _take_choice() -> None:
    chosen = st.session_state["study"]
    st.session_state["chosen"] = next(
        (address for address, name in names_by_address().items() if name == chosen), None
    )


def _open_file() -> None:
    with st.popover("Open a study (.zip)", width="stretch"):
        file = st.file_uploader(
            "A study folder, zipped",
            type="zip",
            key="uploaded",
            help="study.toml with the inertias, and one table per sine experiment.",
        )
    if file is None or file.file_id == st.session_state.get("seen_upload"):
        return
    st.session_state["seen_upload"] = file.file_id
    data = file.getvalue()
    try:
        with st.spinner(f"Reading {file.name}"):
            study = load_study(data)
    except JointIdError as error:
        refuse(file.name, error, data)
    else:
        keep(study, file.name)
    st.rerun()
