"""Details of a cut: over time, the required accuracy of K, and the tool under a force."""

from functools import partial

import numpy as np
import streamlit as st

from jointid import JointIdError
from jointid.analysis import Analysis
from jointid.cut.outcome import Outcome, millimetres, other_causes
from jointid.cut.robot import CUTTING_POINT_M, CutRobot
from jointid.cut.tool_stiffness import ToolStiffness, planar_tool_stiffness, tool_stiffness
from jointid.figures.cut import cut_over_time, deflection_ellipse
from jointid.ui.cut import cached_cuts
from jointid.ui.cut.settings import CutSettings
from jointid.ui.shared.charts import NO_POSE, choose_segment, side_by_side
from jointid.ui.shared.messages import show_error, show_text_table
from jointid.ui.shared.page import Page
from jointid.wording import length_with_error, minus, plain, significant, three_digits, unbroken


def show_time_series(page: Page, settings: CutSettings, outcome: Outcome) -> None:
    """Show path and tracking error, and the torques."""
    st.caption(
        "Path error: distance to the nearest point of the path. Tracking error: distance to the "
        "reference position at that time. Torque: command of each motor; a servo that assumes elastic "
        "joints adds the torque that moves the motors by the deflection x."
    )
    what = "Path error, tracking error and motor torques over time"
    page.show(f"over_time {settings}", partial(cut_over_time, outcome), what)


def show_tolerance(page: Page, settings: CutSettings, outcome: Outcome) -> None:
    """Show the path error for some errors of K̂, in both joints and in each alone."""
    st.write(
        "Worst-case path error on this path with this controller, if the servo's K̂ is this much above "
        "or below the robot's identified K."
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
    causes = other_causes(outcome.robot, settings.servo, settings.friction)
    st.caption(f"With exact K̂, the path error is {millimetres(exact)}, from {causes}.")


_FORCE_N = 100.0


def show_tool_stiffness(page: Page, analysis: Analysis, robot: CutRobot) -> None:
    """Show the tool's deflection under a force: of the study's own robot, or of the arm that cuts."""
    figure, words = side_by_side(2)
    try:
        with words:
            of, nominal, covariance, where = _stiffnesses(analysis, robot)
            force = st.number_input(
                "Force at the tool (N)", 1.0, 1e5, _FORCE_N, 50.0, key="tool_force", format="%.0f"
            )
            _show_numbers(of, covariance, force, where)
    except JointIdError as error:
        show_error(error)
        return
    spatial = len(of.compliance) == 3
    axes = ("the softest axis", "the second axis") if spatial else ("x", "y")
    draw = partial(deflection_ellipse, of, force, nominal, axes=axes)
    with figure:
        what = "Tool deflection under a force from any direction"
        page.show(f"tool_stiffness {where} {force:g}", draw, what)


def _stiffnesses(
    analysis: Analysis, robot: CutRobot
) -> tuple[ToolStiffness, ToolStiffness | None, np.ndarray, str]:
    """Compliance with the identified and the nominal K, covariance of K, and the pose."""
    study, fit, n = analysis.study, analysis.fit, analysis.fit.n
    if study.robot_model is None or not study.pose_angles_rad:
        where, n = "the arm of the cut, tool at the cutting point", 2
        of = partial(planar_tool_stiffness, robot.arm, robot.arm.inverse(CUTTING_POINT_M))
        identified, nominal, covariance = robot.elasticity, robot.nominal, robot.covariance
    else:
        names = list(study.pose_angles_rad)
        pose = names[0]
        if len(names) > 1:
            pose = choose_segment("Pose", names, "tool_pose", format_func=lambda name: name or NO_POSE)
        angles = study.pose_angles_rad[pose]
        degrees = ", ".join(minus(plain(round(x, 1) + 0.0)) for x in np.rad2deg(angles))
        where = f"joint angles {degrees}°"
        of = partial(tool_stiffness, study.robot_model, angles)
        identified, nominal, covariance = fit.elasticity, study.nominal, fit.covariance
    assumed = None if nominal is None else of(nominal)
    return of(identified), assumed, covariance[:n, :n], f"{where}, motors locked"


def _show_numbers(of: ToolStiffness, covariance: np.ndarray, force: float, where: str) -> None:
    values, directions = of.principal
    errors = of.standard_error(covariance)
    texts = [length_with_error(force * x, force * e) for x, e in zip(values, errors, strict=True)]
    st.write(unbroken(f"**A force of {force:.0f} N moves the tool by up to {texts[0]}** ({where})."))
    show_text_table(
        {
            f"Direction ({', '.join('xyz'[: len(directions)])})": [
                ", ".join(minus(f"{part:+.2f}") for part in row) for row in directions
            ],
            "Deflection": texts,
            "Stiffness (N/mm)": [significant(1e-3 / value, 3) for value in values],
        }
    )
    lowest = three_digits(of.resonances_hz[:3])
    st.caption(
        f"Directions are in {'world' if len(directions) == 3 else 'base'} axes; a force along one of "
        f"them moves the tool along it. Lowest natural frequencies: {unbroken(f'{lowest} Hz')}."
    )
