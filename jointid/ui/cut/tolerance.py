"""Path error over errors of the assumed stiffness."""

import streamlit as st

from jointid import JointIdError
from jointid.cut.outcome import Outcome, millimetres
from jointid.ui.cut import cached_cuts
from jointid.ui.cut.settings import CutSettings
from jointid.ui.shared.messages import show_error, show_text_table
from jointid.ui.shared.page import Page


def show_tolerance(page: Page, settings: CutSettings, outcome: Outcome) -> None:
    """Show the path error for some errors of K̂, in both joints and in each alone."""
    st.write(
        "Largest path error when the servo assumes a wrong K̂ and the robot has the identified K, with "
        "this path and controller. Of both signs of an error, the worse counts."
    )
    try:
        exact, wrong = cached_cuts.offset_costs(page, settings.after, outcome.robot)
    except JointIdError as error:
        show_error(error)
        return
    offsets = zip(cached_cuts.OFFSETS, wrong.T, strict=True)
    show_text_table(
        {"Error of K̂ in": ["both joints", "joint 1", "joint 2"]}
        | {f"± {100 * offset:g} %": [*map(millimetres, errors)] for offset, errors in offsets}
    )
    st.caption(f"With exact K̂, friction, delay and encoders leave {millimetres(exact)}.")
