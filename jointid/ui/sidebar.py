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
        keys = [*opened_here(), *sample_paths()]
        wanted = st.query_params.get("study")
        if (following := st.session_state.pop("next_study", None)) in keys:
            st.session_state["study"] = following
        elif wanted is not None and wanted not in keys:
            st.info(f'"{wanted}" was opened in another session and is not here any more. Open it again.')
        key = st.selectbox(
            "Study",
            keys,
            index=_first_sample(keys),
            key="study",
            bind="query-params",
            disabled=not keys,
            help="Sample studies, and what was opened, simulated or imported in this session.",
        )
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


def _first_sample(keys: list[str]) -> int:
    """A fresh session begins with the first sample."""
    return min(len(opened_here()), max(len(keys) - 1, 0))


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
