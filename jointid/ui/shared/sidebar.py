"""The sidebar: pages, choice of the study, and settings of the whole study."""

import streamlit as st

from jointid import JointIdError
from jointid.files.study_files import load_study
from jointid.ui.shared.charts import equip_page
from jointid.ui.shared.messages import markdown_escape
from jointid.ui.shared.method_steps import GROUPS
from jointid.ui.shared.recent_studies import show_recent
from jointid.ui.shared.settings import ESTIMATORS, SETTINGS
from jointid.ui.shared.workspace import (
    follow_address,
    keep,
    label,
    link_to,
    names_by_address,
    refuse,
    sample_paths,
    show_in_address,
)

_ID_LENGTH = 32
_UPLOADER = "uploaded"
_ARRIVED = "arrived_study"


def choose_study() -> tuple[str, str, str] | None:
    """Draw the sidebar and return the study's key, estimator and unit; None without any study."""
    follow_address()
    with st.sidebar:
        links = st.container()
        st.divider()
        above = st.container()
        _open_file()
        with above:  # drawn last, to include the study just opened
            key = _choose()
        with links:
            for group, steps in GROUPS.items():
                st.caption(group)
                for step in steps:
                    link_to(step, help_=step.line)
        st.divider()
        method = st.selectbox(
            "Estimator",
            SETTINGS["estimator"],
            key="estimator",
            help="How K and D are computed from the phasors. "
            + "; ".join(f"{name}: {line}" for name, line in ESTIMATORS.items())
            + ". The page Elasticity compares them.",
        )
        unit = st.selectbox(
            "Stiffness in",
            SETTINGS["unit"],
            key="unit",
            help="For the answer, its report, and all tables and figures of K, D and the gears. With "
            "a gear ratio N, a stiffness K at the motor is N² K at the joint. Records, phasors, H, "
            "fleets and files of K and D stay at the motor, in SI units.",
        )
        equip_page()
    return None if key is None else (key, method, unit)


def _choose() -> str | None:
    """Ask which study. The choice lives in the session, and in the address so that it survives F5."""
    names = names_by_address()
    chosen = st.session_state.get("chosen")
    if chosen not in names and (spaced := str(chosen).replace("_", " ")) in names:
        chosen = spaced  # as the sample's file is called
    if chosen not in names:
        wanted, chosen = chosen, next(iter(sample_paths()), next(iter(names), None))
        if wanted is not None:
            what = "The study of this address" if len(wanted) == _ID_LENGTH else f'"{wanted}"'
            st.session_state["not_found"] = chosen, what
    st.session_state["chosen"] = chosen
    st.session_state["study"] = None if chosen is None else names[chosen]
    st.selectbox(
        "Chosen study",
        list(names.values()),
        format_func={name: label(name) for name in names.values()}.__getitem__,
        key="study",
        on_change=_take_choice,
        disabled=not names,
        help="Studies opened, simulated or imported at this address, and the samples. Each of the two "
        "exercises contains a fault. Commands accept a sample by the name in the address of this page, "
        "for instance six_axes.",
    )
    show_in_address()
    show_recent()
    return None if chosen is None else names[chosen]


def _take_choice() -> None:
    chosen = st.session_state["study"]
    st.session_state.pop("not_found", None)
    st.session_state["chosen"] = next(
        (address for address, name in names_by_address().items() if name == chosen), None
    )


def remember_file() -> None:
    """Store a dropped file in the session; call it before anything is drawn.

    A click may end this run wherever something is drawn; the next run then takes the file from the
    session.
    """
    file = st.session_state.get(_UPLOADER)
    if file is not None and file.file_id != st.session_state.get("seen_upload"):
        st.session_state[_ARRIVED] = (file.name, file.getvalue())
        st.session_state["seen_upload"] = file.file_id


def _open_file() -> None:
    """Ask for a file, and keep its study."""
    with st.popover("Open a study (.zip)", width="stretch"):
        st.file_uploader(
            "A study folder, zipped",
            type="zip",
            key=_UPLOADER,
            help="study.toml with the inertias, and one table per experiment.",
        )
        arrived: tuple[str, bytes] | None = st.session_state.get(_ARRIVED)
        if arrived is None:
            return
        name, data = arrived
        try:
            with st.spinner(markdown_escape(f"Reading {name}")):
                study = load_study(data)
            keep(study, name)
        except JointIdError as error:
            refuse(name, error, data)
        except Exception:
            del st.session_state[_ARRIVED]  # an internal error must not recur on every page
            raise
        del st.session_state[_ARRIVED]
