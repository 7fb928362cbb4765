"""One element of the transfer matrix as a figure, and the matrix as a table."""

from functools import partial
from typing import Any

import numpy as np
import streamlit as st

from jointid import Analysis, TransferMatrix
from jointid.figures import VIEWS, element_response, single_record, torque_condition
from jointid.ui.shared.charts import NO_POSE, Table, choose_segment, table
from jointid.ui.shared.messages import show_info
from jointid.ui.shared.page import Page
from jointid.ui.study.overview import freed_note
from jointid.wording import minus, significant, with_error


def choose_pose(poses: list[str]) -> str:
    """Ask for the pose when there are several."""
    if len(poses) == 1:
        return poses[0]
    return st.selectbox(
        "Pose",
        poses,
        format_func=lambda pose: pose or NO_POSE,
        key="pose",
        bind="query-params",
        help="K and D do not depend on the pose; the arm's inertia, and so H, does.",
    )


def choose_element(n: int) -> tuple[int, int]:
    """Ask which element of H to look at: the diagonal ones, then one of each symmetric pair."""
    if n == 1:
        return 0, 0
    pairs = [(j, j) for j in range(n)] + [(i, j) for i in range(n) for j in range(i + 1, n)]
    names = [f"H{i + 1}{j + 1}" + ("" if i == j else f" and H{j + 1}{i + 1}") for i, j in pairs]
    shown = choose_segment(
        "Element",
        names,
        "element",
        hint="$H_{ij}$ is the acceleration of motor i over the torque of motor j. "
        "On the diagonal a motor's own torque acts.",
    )
    return pairs[names.index(shown)]


def show_element(page: Page, analysis: Analysis, pose: str, i: int, j: int) -> None:
    """Show H_ij over frequency; a diagonal element beside the single-record responses of its joint."""
    n, name = page.study.inertia.n, f"H{i + 1}{j + 1}"
    view = choose_segment("View", VIEWS, "view", hide_label=True)
    drawn: dict[str, Any] = {"pose": pose, "view": view}
    what = f"{name} over frequency, measured and modelled"
    draw = partial(element_response, analysis, i, j, **drawn)
    if i == j and n > 1 and page.study.of_pose(pose).any():
        left, right = st.columns(2)
        with left:
            st.markdown(f"**One record alone** (Figure 3): acceleration over torque of joint {i + 1}")
            page.show(
                f"alone {i} {pose} {view}",
                partial(single_record, analysis, i, **drawn),
                f"Acceleration over torque of joint {i + 1} from single records, over frequency",
            )
        with right:
            figure_number = {0: " (Figure 4)", 1: " (Figure 5)"}.get(i, "")
            st.markdown(f"**All records together**{figure_number}: {name}")
            page.show(f"H {i} {j} {pose} {view}", draw, what)
        caption = "A peak seen only in one record alone comes from the other joints' controllers."
    else:
        page.show(f"H {i} {j} {pose} {view}", draw, what)
        caption = "Measured points with ± one standard error."
        if i != j:
            caption = (
                f"{name} and H{j + 1}{i + 1} are equal, because the coupling inertia is one number."
            )
    st.caption(caption + freed_note(analysis))


def show_how_well_known(page: Page, matrix: TransferMatrix, pose: str, i: int, j: int) -> None:
    """Condition and reciprocity over frequency, rejected frequencies, and H_ij as numbers."""
    if matrix.H.shape[1] > 1:
        st.header("How well H is known", anchor=False)
        st.write(
            "With a condition number of 1 the torques of the records are orthogonal; at 100 their "
            "noise is amplified about a hundredfold. The reciprocity error is the largest difference "
            "between $H_{ij}$ and $H_{ji}$, relative to the diagonal."
        )
        what = "Condition number and reciprocity error over frequency"
        page.show(f"condition {pose}", partial(torque_condition, matrix), what)
    for text in matrix.rejected:
        show_info(text)
    table(element_table(matrix, i, j))
    st.caption("The chosen element as measured. |H| in 1/(kg·m²) with ± one standard error.")


def element_table(matrix: TransferMatrix, i: int, j: int) -> Table:
    """One row per frequency: magnitude of H_ij, and H_ji, with standard error; phase; condition."""
    n = matrix.H.shape[1]
    columns: dict[str, list[object]] = {"Hz": [significant(f, 5) for f in matrix.omega / (2 * np.pi)]}
    error = matrix.standard_deviation / np.sqrt(2)
    for row, column in dict.fromkeys([(i, j), (j, i)]):
        size, angle = (f(matrix.H[:, row, column]) for f in (np.abs, np.angle))
        name = f"H{row + 1}{column + 1}"
        pairs = zip(size, error[:, row, column], strict=True)
        columns[f"|{name}|"] = [with_error(a, e) for a, e in pairs]
        columns[f"∠{name} (°)"] = [minus(f"{a:.1f}") for a in np.degrees(angle)]
    if n > 1:
        columns["Condition"] = [significant(c, 3) for c in matrix.condition]
        columns["Reciprocity (%)"] = [significant(100 * e, 2) for e in matrix.reciprocity_error]
    return columns
