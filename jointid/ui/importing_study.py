"""What a log does not say, by form: inertias and a name; then the study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath

import streamlit as st

from jointid import Inertia, JointIdError
from jointid.ui.numbers_in import matrix_in, numbers_in

_UNITS = {"kg·m²": 1.0, "kg·cm²": 1e-4, "g·cm²": 1e-7}


@dataclass(frozen=True, eq=False)
class Robot:
    """What was entered."""

    name: str
    inertia: Inertia


def ask_robot(joints: int, files: Sequence[str]) -> Robot | None:
    """Ask for name and inertias; None until the form is sent.

    Raises
    ------
    JointIdError
        When something is missing or is no inertia.
    """
    with st.form("import", border=False):
        left, right = st.columns([3, 1])
        name = left.text_input(
            "Name of the study",
            key="import_name",
            placeholder=_stem(files),
            persist_state="session",
        )
        unit = right.selectbox(
            "Unit of the inertias", list(_UNITS), key="import_inertia_unit", persist_state="session"
        )
        left, right = st.columns(2)
        M = left.text_input(
            "Rotor inertias M, one per joint",
            key="import_M",
            placeholder=", ".join(["0.0025", "0.0010", "0.0008"][:joints]),
            persist_state="session",
        )
        M2 = right.text_input(
            "Arm inertia M2 seen from the motors, rows separated by ;",
            key="import_M2",
            placeholder="0.0041" if joints == 1 else "0.0041, 0.0004; 0.0004, 0.0019",
            persist_state="session",
            help="The method takes the rigid-body inertias, seen from the motors (divided by both gear "
            "ratios), as known. K and D are as right as they are.",
        )
        if not st.form_submit_button("Open as study", type="primary"):
            return None
    if not M.strip() or not M2.strip():
        raise JointIdError(
            "The inertias are missing: give M and M2 of the joints, motor side. "
            "K and D cannot be found without them."
        )
    factor = _UNITS[unit]
    inertia = Inertia(
        [factor * value for value in numbers_in("Rotor inertias M", M)],
        [[factor * value for value in row] for row in matrix_in("Arm inertia M2", M2)],
    )
    if inertia.n != joints:
        raise JointIdError(
            f"The inertias are those of {inertia.n} joint(s), the mapping has {joints}: make them agree."
        )
    return Robot(name.strip() or _stem(files), inertia)


def _stem(files: Sequence[str]) -> str:
    stem = PurePath(files[0].partition(": ")[0]).stem.replace("_", " ")
    return stem if len(files) == 1 else f"{stem} and {len(files) - 1} more"
