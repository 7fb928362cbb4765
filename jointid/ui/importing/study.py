"""Entries that no log contains: inertias, poses and a name."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import streamlit as st

from jointid import JointIdError
from jointid.importing.robot_inertia import KnownRobot
from jointid.importing.study import parse_date, study_name
from jointid.ui.importing.inertia import ask_inertia, ask_nominal, missing_inertia, show_inertia
from jointid.ui.shared.charts import NO_POSE
from jointid.ui.shared.entries import (
    ask_inertia_std,
    ask_torque_std,
    choose_from,
    deviation_text,
    enter_text,
    numbers_in,
)
from jointid.ui.shared.messages import markdown_escape, show_error
from jointid.wording import counted

T = TypeVar("T")

_FACTS = {
    "robot": ("Robot", "cell 7, robot A"),
    "date": ("Date of the measurement", "2026-11-20"),
    "gear temperature": ("Gear temperature (°C)", "24"),
    "note": ("Note, shown with the answer", "after two hours of operation, no tool"),
}
"""Label and example of each optional fact."""


def ask_robot(
    gear_ratios: Sequence[float],
    logs: Sequence[str],
    assumed: Sequence[str] = (),
    elsewhere: Sequence[str] = (),
) -> tuple[dict[str, Any] | None, str, str]:
    """Ask for inertias and a name, for logs by their names and gear ratios by joint, and show them.

    ``assumed`` is the unconfirmed part of the mapping, shown at the buttons; ``elsewhere`` are wrong
    entries of other steps, which disable the buttons. Returns the robot as
    arguments of ``study_from_logs``, None until a button is clicked and everything is given; a text of
    the given entries, which begins with M, or of the missing ones; and "study", "report" or "" for the
    button.
    """
    joints = len(gear_ratios)
    problems: list[str] = []
    known = _answer(problems, lambda: ask_inertia(gear_ratios))
    if known is not None and known.inertia.n != joints:
        problems.append(
            f"The inertias are for {counted(known.inertia.n, 'joint')}, but step 2 has {joints}: "
            "make them agree."
        )
    inertia_std, torque_std = _ask_deviations(problems, known)
    with st.popover("Optional: nominal K and D, robot, date, gear temperature, note"):
        nominal = _answer(problems, lambda: ask_nominal(joints))
        facts = _answer(problems, _ask_facts) or {}
    if known is not None:
        known = replace(known, inertia_std=inertia_std, torque_std=torque_std)
        known = known if nominal is None else replace(known, nominal=nominal)
    problem = " ".join(problems)
    poses = _ask_poses(known, logs)
    left, middle, right = st.columns([2, 1, 1], vertical_alignment="bottom")
    name = left.text_input(
        "Name of the study",
        key="import name",
        placeholder=(known.name if known else "") or study_name(logs),
        persist_state="session",
    )
    # The buttons are above everything of variable height, so that they never move under a click.
    # A wrong entry of this step leaves them enabled: it is often corrected by the same click.
    about: dict[str, Any] = {"width": "stretch", "disabled": bool(elsewhere)}
    clicked = "study" if middle.button("Open as study", type="primary", **about) else ""
    clicked = "report" if right.button("Open its report", **about) else clicked
    if elsewhere:
        show_error("\n".join(elsewhere))
    if assumed:
        st.markdown(
            f":orange-badge[Assumed] :small[{markdown_escape('; '.join(assumed))}. Not confirmed: "
            "marked in the study, its report and its files. Confirm in steps 2 and 3.]"
        )
    if clicked and known is None:
        problem = problem or missing_inertia()[1]
    if problem:
        show_error(problem)
    elif known is not None:
        show_inertia(known)
    state = missing_inertia()[0] if known is None else f"M and M2 {deviation_text(inertia_std)}"
    if not clicked or problem or elsewhere or known is None:
        return None, "to correct" if problem else state, clicked
    of_study = {"name": name.strip() or known.name or study_name(logs), "pose_of": poses}
    return vars(known) | facts | of_study, state, clicked


def _answer(problems: list[str], ask: Callable[[], T]) -> T | None:
    """Return the answer; collect its problem if it is unusable."""
    try:
        return ask()
    except JointIdError as error:
        problems.append(str(error))
        return None


def _ask_deviations(problems: list[str], known: KnownRobot | None) -> tuple[float | None, float | None]:
    """Ask for the uncertainty of inertias and torque scale, unless the TOML states it."""
    left, right = st.columns(2)
    inertia_std, torque_std = (None, None) if known is None else (known.inertia_std, known.torque_std)
    if inertia_std is None:
        inertia_std = _answer(problems, partial(ask_inertia_std, left, "import inertia std"))
    if torque_std is None:
        torque_std = _answer(problems, partial(ask_torque_std, right, "import torque std"))
    return inertia_std, torque_std


def _ask_facts() -> dict[str, Any]:
    """Ask for robot, date, gear temperature and note: parameters of ``Study``."""
    texts = {
        key: enter_text(place, f"import {key}", label, "", example=example)
        for place, (key, (label, example)) in zip(2 * st.columns(2), _FACTS.items(), strict=True)
    }
    warm = texts["gear temperature"].strip().removesuffix("°C")
    celsius = numbers_in("Gear temperature", warm, count=1)[0] if warm else None
    return {
        "robot": texts["robot"].strip(),
        "date": parse_date(texts["date"]),
        "note": texts["note"].strip(),
        "gear_temperature_C": celsius,
    }


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
        label = markdown_escape(f"Pose of {log}")
        chosen.append(choose_from(places[number % len(places)], key, label, options))
    return tuple(None if pose == NO_POSE else pose for pose in chosen)
