"""The sidebar: the steps, which study, and what holds for the whole study."""

from __future__ import annotations

import streamlit as st

from jointid import JointIdError
from jointid.study_files import load_study
from jointid.ui import cached
from jointid.ui.steps import IMPORT, METHOD, OVERVIEW, SIMULATE
from jointid.ui.workspace import keep, opened_here, refuse, sample_paths


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
    keys = [*opened_here(), *sample_paths()]
    wanted = st.session_state.get("chosen") or st.query_params.get("study")
    if wanted is not None and wanted not in keys:
        st.info(f'"{wanted}" was opened in another session and is not here any more. Open it again.')
    if wanted not in keys:
        wanted = next(iter(sample_paths()), keys[0] if keys else None)
    st.session_state["chosen"] = st.session_state["study"] = wanted
    st.selectbox(
        "Study",
        keys,
        key="study",
        on_change=_take_choice,
        disabled=not keys,
        help="Sample studies, and what was opened, simulated or imported in this session.",
    )
    if wanted is not None:
        st.query_params["study"] = wanted  # links between pages drop it
    return wanted


def _take_choice() -> None:
    st.session_state["chosen"] = st.session_state["study"]


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
