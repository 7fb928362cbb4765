"""The cut over time, one corner of it, and the predicted path error."""

from functools import partial

import streamlit as st

from jointid.cut.outcome import Outcome, remainder
from jointid.figures.cut import (
    corner_detail,
    path_error_histogram,
    path_error_over_time,
    torque_over_time,
)
from jointid.ui.cut.settings import CutSettings
from jointid.ui.shared.charts import choose_segment, side_by_side
from jointid.ui.shared.page import Page


def show_time_series(page: Page, settings: CutSettings, outcome: Outcome) -> None:
    """Show error, torque, a corner, and the distribution of the path error."""
    error, torque, corner, distribution = side_by_side(4)
    with error:
        st.markdown("**Error**")
        st.caption(
            "Path error: distance to the nearest point of the path. Tracking error: distance to "
            "the reference position at that time."
        )
        draw = partial(path_error_over_time, outcome)
        page.show(f"error {settings}", draw, "Path and tracking error over time")
    with torque:
        st.markdown("**Torque**")
        st.caption(
            "Torque command of each motor. A servo that knows the springs adds the torque that moves "
            "the motors by the deflection x."
        )
        page.show(f"torque {settings}", partial(torque_over_time, outcome), "Motor torques over time")
    with corner:
        st.markdown("**A corner**")
        names = [str(k + 1) for k in range(len(outcome.toolpath.corners()[0]))]
        chosen = int(choose_segment("Corner", names, "cut_corner", hide_label=True)) - 1
        draw = partial(corner_detail, outcome, chosen)
        page.show(f"corner {chosen} {settings}", draw, "Tool paths around a corner")
    with distribution:
        _show_distribution(page, settings, outcome)


def _show_distribution(page: Page, settings: CutSettings, outcome: Outcome) -> None:
    st.markdown("**Predicted path error**")
    if outcome.distribution is None:
        st.caption("Not available: see the reason above.")
        return
    if not outcome.springs_matter:
        st.caption(remainder(outcome, settings.servo, settings.friction))
        return
    demonstrated = outcome.robot.rule == "demonstration"
    source = "the errors of this demonstration" if demonstrated else "the fit's covariance"
    st.caption(
        f"{outcome.distribution.K.shape[0]} robots drawn from {source}, each cut by a servo with the "
        "identified values."
    )
    draw = partial(path_error_histogram, outcome.distribution)
    page.show(f"promise {settings}", draw, "Distribution of the path error")
