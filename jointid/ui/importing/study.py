"""Entries that no log contains: inertias, poses and a name."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import streamlit as st

from jointid import JointIdError
from jointid.importing import Segment
from jointid.importing.robot_inertia import KnownRobot
from jointid.importing.study import parse_date, run_counts, study_name
from jointid.rounding import plain
from jointid.study import INERTIA_STD
from jointid.ui.importing.inertia import ask_inertia, ask_nominal, inertias_given, show_inertia
from jointid.ui.shared.charts import NO_POSE
from jointid.ui.shared.deviations import ask_inertia_std, ask_torque_std
from jointid.ui.shared.markdown_escape import markdown_escape
from jointid.ui.shared.messages import show_error
from jointid.wording import counted

T = TypeVar("T")

ROBOT = "the-robot"
"""Where the page asks for the inertias."""


@dataclass(frozen=True, eq=False)
class Robot:
    """The entered robot."""

    name: str
    known: KnownRobot
    pose_of: tuple[str | None, ...]
    """Pose of each log; None: that of ``known.inertia``."""
    robot: str = ""
    date: datetime.date | None = None


def show_next_step(runs: Mapping[str, Sequence[Segment]], to_check: bool) -> None:
    """Show the state of the import and its next step in one line.

    Parameters
    ----------
    runs : mapping of str to sequence of Segment
        Runs to use, by log.
    to_check : bool
        Whether part of the mapping is unconfirmed.
    """
    used = [segment for part in runs.values() for segment in part]
    if not used:
        st.markdown("**Next:** mark a run in the table of runs, or choose other columns.")
        return
    hertz = [f for segment in used for f in segment.band_hz or (segment.frequency_hz,)]
    low, high = (plain(float(f"{f:.3g}")) for f in (min(hertz), max(hertz)))
    band = f"{low} Hz" if low == high else f"{low} to {high} Hz"
    look = "look at what is marked To check, then " if to_check else ""
    goal = "open it as a study" if inertias_given() else "give the inertias"
    st.markdown(
        f"{run_counts(used, 'steady sine run')} of {band} found. **Next:** {look}[{goal}](#{ROBOT})."
    )


def ask_robot(
    gear_ratios: Sequence[float], logs: Sequence[str], not_confirmed: str = ""
) -> Robot | None:
    """Ask for name and inertias, and show them; None until the button is clicked.

    Parameters
    ----------
    gear_ratios : sequence of float
        One per joint.
    logs : sequence of str
        Names.
    not_confirmed : str, optional
        Unconfirmed part of the mapping, shown at the button.
    """
    joints = len(gear_ratios)
    problems: list[str] = []
    known = _answer(problems, lambda: ask_inertia(gear_ratios))
    if known is not None and known.inertia.n != joints:
        problems.append(
            f"The inertias are those of {counted(known.inertia.n, 'joint')}, the mapping has {joints}: "
            "make them agree."
        )
    inertia_std, torque_std = _ask_deviations(problems, known)
    with st.expander("Optional: nominal K and D to compare with; robot and date, for a fleet's drift"):
        nominal = _answer(problems, lambda: ask_nominal(joints))
        robot, date = _ask_which()
    day = _answer(problems, lambda: parse_date(date))
    if known is not None:
        known = replace(known, inertia_std=inertia_std, torque_std=torque_std)
    if nominal is not None and known is not None:
        known = replace(known, nominal=nominal)
    problem = " ".join(problems)
    poses = _ask_poses(known, logs)
    left, right = st.columns([3, 1], vertical_alignment="bottom")
    name = left.text_input(
        "Name of the study",
        key="import name",
        placeholder=(known.name if known else "") or study_name(logs),
        persist_state="session",
    )
    # The button is above everything of variable height, so that it never moves under a click.
    clicked = right.button("Open as study", type="primary", width="stretch")
    if not_confirmed:
        st.caption(f":orange-badge[To check] {markdown_escape(not_confirmed)}")
    if clicked and known is None:
        problem = problem or (
            "The inertias are missing, or some of them: give those of all joints. K and D cannot be "
            "found without them."
        )
    if problem:
        show_error(problem)
    elif known is None:
        st.caption("M and M2 are shown here as the method takes them, as soon as they are entered.")
    else:
        show_inertia(known)
    if not clicked or problem or known is None:
        return None
    return Robot(name.strip() or known.name or study_name(logs), known, poses, robot.strip(), day)


def _answer(problems: list[str], ask: Callable[[], T]) -> T | None:
    """Return the answer; collect its problem if it is unusable."""
    try:
        return ask()
    except JointIdError as error:
        problems.append(str(error))
        return None


def _ask_deviations(problems: list[str], known: KnownRobot | None) -> tuple[float | None, float | None]:
    """How well inertias and torque scale are known, unless the TOML states it."""
    left, right = st.columns(2)
    inertia_std, torque_std = (None, None) if known is None else (known.inertia_std, known.torque_std)
    if inertia_std is None:
        ask = partial(ask_inertia_std, left, "import inertia std", INERTIA_STD)
        inertia_std = _answer(problems, ask)
    if torque_std is None:
        torque_std = _answer(problems, partial(ask_torque_std, right, "import torque std"))
    return inertia_std, torque_std


def _ask_which() -> tuple[str, str]:
    """Which robot it is, and when it was measured."""
    left, right = st.columns(2)
    texts = [
        place.text_input(label, key=f"import {key}", placeholder=example, persist_state="session")
        for place, label, key, example in (
            (left, "Robot (optional)", "robot", "cell 7, robot A"),
            (right, "Date of the measurement (optional)", "date", "2026-11-20"),
        )
    ]
    return texts[0], texts[1]


def _ask_poses(known: KnownRobot | None, logs: Sequence[str]) -> tuple[str | None, ...]:
    """Ask which pose each log was measured in, when there are poses."""
    if known is None or not known.poses:
        return (None,) * len(logs)
    options = [NO_POSE, *known.poses]
    chosen = []
    places = st.columns(min(len(logs), 3))
    for number, log in enumerate(logs):
        key = f"import pose of {log} {number}"
        if st.session_state.get(key, NO_POSE) not in options:
            del st.session_state[key]
        place = places[number % len(places)]
        label = markdown_escape(f"Pose of {log}")
        chosen.append(place.selectbox(label, options, key=key, persist_state="session"))
    return tuple(None if pose == NO_POSE else pose for pose in chosen)
