"""Path error over errors of the assumed stiffness: a table, and a map on demand."""

from functools import partial

import numpy as np
import streamlit as st

from jointid import JointIdError
from jointid.arrays import Floats
from jointid.cut.outcome import Outcome, millimetres
from jointid.cut.robot import CutRobot
from jointid.cut.tolerance import ToleranceMap, tolerance_map
from jointid.figures.cut_tolerance import tolerance_heatmap
from jointid.ui.cut import cached_cuts
from jointid.ui.cut.settings import CutSettings
from jointid.ui.shared.background import run_in_background
from jointid.ui.shared.charts import choose_segment
from jointid.ui.shared.messages import show_error
from jointid.ui.shared.page import Page
from jointid.ui.shared.results import Show, computed_on_click

_WIDE = 21
"""Cuts along each axis of the map."""
_RANGES = ("± 10 %", "A factor of 3", "This identification's uncertainty")


def show_tolerance(page: Page, settings: CutSettings, outcome: Outcome) -> None:
    """Show the path error for some errors of K̂, and on demand a map of a few hundred cuts."""
    st.write(
        "Largest path error when the servo assumes K̂ and the robot has the identified K, with this path "
        "and controller. On the map, lines join equal errors."
    )
    try:
        _show_costs(page, settings, outcome)
        _show_map(page, settings, outcome)
    except JointIdError as error:
        show_error(error)


def _show_costs(page: Page, settings: CutSettings, outcome: Outcome) -> None:
    exact, *off = cached_cuts.offset_costs(page, settings.after, outcome.robot).tolist()
    costs = [exact, *(max(pair) for pair in zip(off[::2], off[1::2], strict=True))]  # the worse sign
    heads = ["exact", *(f"± {100 * offset:g} %" for offset in cached_cuts.OFFSETS)]
    st.markdown(
        f"| Error of K̂, both joints | {' | '.join(heads)} |\n|{' --- |' * (len(heads) + 1)}\n"
        f"| Path error, worse sign | {' | '.join(map(millimetres, costs))} |"
    )


def _show_map(page: Page, settings: CutSettings, outcome: Outcome) -> None:
    span = choose_segment("Range of K̂/K", _RANGES, "cut_map_range")
    robot = outcome.robot

    def compute(show: Show) -> ToleranceMap:
        return run_in_background(
            tolerance_map,
            robot.arm,
            outcome.toolpath,
            robot.elasticity,
            *(_ratios(robot, joint, span) for joint in (0, 1)),
            servo=settings.servo,
            friction=settings.friction,
            progress=lambda done: show(done, "Cutting"),
        )

    tolerance = computed_on_click(
        ("tolerance map", page.digest, page.method, settings.after, span),
        f"Compute the map ({_WIDE * _WIDE} cuts)",
        "cut_map",
        compute,
        hint="Takes a few seconds. Later visits with the same settings show it at once.",
    )
    if tolerance is None:
        return
    given = tolerance, robot.elasticity, robot.covariance, outcome.assumed
    what = "Largest path error over the ratios of assumed to true stiffness"
    page.show(f"map {settings} {span}", partial(tolerance_heatmap, *given), what)
    path_error = tolerance.max_contour_error_m
    least, exact = (millimetres(e) for e in (path_error.min(), path_error[_WIDE // 2, _WIDE // 2]))
    beside = (
        f" At K̂ = K, friction, delay and encoders leave {exact}; a wrong K̂ may cancel a part of it and "
        "give a smaller error."
    )
    st.caption(
        f"Errors on this map: {least} to {millimetres(path_error.max())}." + beside * (least != exact)
    )


def _ratios(robot: CutRobot, joint: int, span: str) -> Floats:
    """K̂/K within 10 %, from 1/3 to 3, or as far as four standard errors."""
    if span == _RANGES[2]:
        error = float(np.sqrt(robot.covariance[joint, joint]) / robot.elasticity.K[joint])
        most = 1 + float(np.clip(4 * error, 1e-5, 2.0))
    else:
        most = 3.0 if span == _RANGES[1] else 1 / 0.9
    return np.geomspace(1 / most, most, _WIDE)
