"""The inertias as numbers, TOML, robot model or links of the arm, converted to the motor side."""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress

import numpy as np
import streamlit as st

from jointid import Elasticity, Inertia, JointIdError, PlanarArm, RobotModel
from jointid.importing.robot_inertia import (
    INERTIA_UNITS,
    KnownRobot,
    motor_side,
    robot_from_toml,
    rotor_at_motor,
)
from jointid.ui.shared.entries import (
    choose_from,
    deviation_text,
    enter_text,
    matrix_in,
    numbers_in,
    numbers_out,
)
from jointid.ui.shared.messages import markdown_escape, show_error, show_note
from jointid.wording import counted

_MOTOR, _JOINT = "motor side", "joint side"
_LINK_UNITS: dict[str, tuple[str, Mapping[str, float]]] = {
    "drive": ("Motor 2 turns", dict.fromkeys(("link 2 (parallelogram)", "joint 2 (serial)"), 1.0)),
    "rotor side": ("Rotor inertias on the", dict.fromkeys((_MOTOR, _JOINT), 1.0)),
    "length unit": ("Unit of lengths", {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}),
    "mass unit": ("Unit of masses", {"kg": 1.0, "g": 1e-3, "lb": 0.45359237}),
    "link unit": ("Unit of inertias", INERTIA_UNITS),
    "angle unit": ("Unit of the joint angles", {"deg": np.pi / 180, "rad": 1.0}),
}
"""Label and options of each choice for an arm of links, with their factors to SI."""
_LINKS = {
    "length": ("Link lengths", "length unit", "0.8, 0.6"),
    "mass": ("Link masses", "mass unit", "40, 60"),
    "centre": ("Distances of the centres of mass from the joints", "length unit", "0.30, 0.30"),
    "link": ("Link inertias about their centres of mass", "link unit", "3, 5"),
    "rotor": ("Rotor inertias", "link unit", "0.003, 0.002"),
    "pose": ("Joint angles of the logs' pose", "angle unit", "-30, 60"),
}
"""Label, unit and example of each entry for an arm of links."""
_UPLOADS = "import_toml_uploads"
_CORRECTED = "The fit corrects them within the uncertainty stated below."
_HELP = {
    "M": f"Motor side: the rotors' own inertias, from the data sheets of the motors. {_CORRECTED}",
    "M2": "Motor side: divided by both gear ratios. Values on the joint side are divided by the gear "
    f"ratios of step 3. {_CORRECTED}",
}


def ask_inertia(gear_ratios: Sequence[float]) -> KnownRobot | None:
    """Ask for the inertias of a robot; None while some are missing.

    Raises JointIdError when the entries are no inertia.
    """
    ask: Mapping[str, Callable[[Sequence[float]], KnownRobot | None]] = {
        "Numbers": _by_numbers,
        "TOML": _by_toml,
        "Robot model": _by_model,
        "Links of the arm": _by_links,
    }
    source = st.segmented_control(
        "Inertias from",
        list(ask),
        default="Numbers",
        required=True,
        key="import inertia source",
        persist_state="session",
    )
    return ask[source](gear_ratios)


def missing_inertia() -> tuple[str, str]:
    """What the entries of ``ask_inertia`` lack: in a word, and as a sentence with the remedy."""
    by_model = st.session_state.get("import inertia source") == "Robot model"
    if by_model and st.session_state.get("import model text"):
        return "missing: joint angles", "Joint angles are missing: M2 of a robot depends on its pose."
    return "missing", (
        "Inertias are missing: enter those of all joints in step 5. K and D cannot be identified "
        "without them."
    )


def offer_gears_of_model(joints: int) -> None:
    """Offer to take the gear ratios from a robot model, which step 5 then uses for the inertias."""
    with st.popover("Gear ratios from a robot model"):
        _ask_model("Robot model with gear ratios", "import_model_of_gears")
    try:
        model = _given_model()
    except JointIdError as error:
        show_error(error)
        return
    if model is not None and model.n != joints:
        show_error(f"The robot model has {counted(model.n, 'joint')}, but step 2 has {joints}.")


def ask_nominal(joints: int) -> Elasticity | None:
    """Ask for the controller's nominal K and D; None when left empty.

    Raises JointIdError when one of them is missing or is no stiffness or damping.
    """
    left, right = st.columns(2)
    help_ = "The controller's present values; the app compares them with the identified ones."
    K = enter_text(left, "import nominal K", "Nominal K (N·m/rad), optional", "", help_, "30, 5")
    D = enter_text(right, "import nominal D", "Nominal D (N·m·s/rad), optional", "", help_, "0.2, 0.05")
    if not K.strip() and not D.strip():
        return None
    for name, text in (("K", K), ("D", D)):
        if not text.strip():
            raise JointIdError(f"Nominal {name} is missing: give K and D of every joint, or neither.")
    nominal = Elasticity(numbers_in("Nominal K", K), numbers_in("Nominal D", D))
    if nominal.n != joints:
        raise JointIdError(
            f"Nominal K and D are for {counted(nominal.n, 'joint')}, but step 2 has {joints}: "
            "give one of each per joint."
        )
    return nominal


def show_inertia(robot: KnownRobot) -> None:
    """Show the inertias, motor side, with their uncertainty."""
    M, *M2 = (
        numbers_out(float(f"{value:.5g}") for value in row)
        for row in (robot.inertia.M, *_without_rounding_errors(robot.inertia.M2))
    )
    st.markdown(f"Used by the method, motor side: M = {M}; M2 = {'; '.join(M2)} kg·m²")
    show_note(
        f"M and M2: {deviation_text(robot.inertia_std)}. "
        f"Torque scale: {deviation_text(robot.torque_std)}."
    )
    if (nominal := robot.nominal) is not None:
        st.caption(
            f"Nominal K = {numbers_out(nominal.K.tolist())} N·m/rad, "
            f"D = {numbers_out(nominal.D.tolist())} N·m·s/rad."
        )
    if robot.poses:
        show_note(f"M2 of {counted(len(robot.poses), 'pose')}: {', '.join(robot.poses)}.")


def _without_rounding_errors(M2: np.ndarray) -> np.ndarray:
    """Couplings that only the arithmetic of a robot model leaves, as zero."""
    size = np.sqrt(np.diag(M2))
    return np.where(np.abs(M2) < 1e-9 * np.outer(size, size), 0.0, M2)


def _by_numbers(ratios: Sequence[float]) -> KnownRobot | None:
    n = len(ratios)
    M, M_unit, M_side = _row(
        "Rotor inertias M, one per joint", "M", ", ".join(["0.003", "0.002", "0.001"][:n])
    )
    M2, M2_unit, M2_side = _row(
        "Arm inertia M2, rows separated by ;",
        "M2",
        "0.005" if n == 1 else "0.005, 0.001; 0.001, 0.002",
    )
    sides = _MOTOR not in (M_side, M2_side) or M_side != M2_side
    if sides:
        st.caption(f"Gear ratios of step 3: {numbers_out(ratios)}.")
    if not M.strip() or not M2.strip():
        return None
    rotor = np.array(numbers_in("Rotor inertias M", M)) * INERTIA_UNITS[M_unit]
    arm = np.array(matrix_in("Arm inertia M2", M2)) * INERTIA_UNITS[M2_unit]
    if M_side == _JOINT:
        rotor = rotor_at_motor(rotor, ratios)
    if M2_side == _JOINT:
        arm = motor_side(arm, ratios)
    return KnownRobot(Inertia(rotor, arm))


def _by_toml(ratios: Sequence[float]) -> KnownRobot | None:
    left, right = st.columns([3, 2])
    with right:
        number = st.session_state.get(_UPLOADS, 0)
        st.file_uploader(
            "TOML file (.toml)",
            ["toml"],
            max_upload_size=1,
            key=f"import_toml_file {number}",
            on_change=_take_toml,
        )
    text = left.text_area(
        "TOML with M and M2, motor side, kg·m²",
        key="import toml",
        placeholder="e.g.\n[inertia]\nM  = [0.0025, 0.0010]\nM2 = [[0.0041, 0.0004], [0.0004, 0.0019]]",
        height=150,
        persist_state="session",
        help="As in study.toml; a whole study.toml, with poses, also works.",
    )
    return robot_from_toml(text) if text.strip() else None


def _take_toml() -> None:
    if (file := _taken("import_toml_file")) is not None:
        st.session_state["import toml"] = file[1]


def _taken(key: str) -> tuple[str, str] | None:
    """Name and text of the file just given to the uploader of this key, which is empty afterwards."""
    number = st.session_state.get(_UPLOADS, 0)
    file = st.session_state.get(f"{key} {number}")
    if file is None:
        return None
    st.session_state[_UPLOADS] = number + 1
    # A file that is no text is refused by its reader.
    return file.name, file.getvalue()[: 1 << 20].decode("utf-8-sig", "replace")


def _by_model(ratios: Sequence[float]) -> KnownRobot | None:
    left, right = st.columns(2)
    with left:
        _ask_model("Robot model", "import_model_file")
    example = ", ".join(["0", "-90", "90", "0", "45", "0"][: len(ratios)])
    label = "Joint angles of the logs' pose (°)"
    about = "As logged; the model must have the same zero positions."
    angles = enter_text(right, "import model pose", label, "", about, example)
    if _given_model() is None or not angles.strip():  # its problem, before the angles are entered
        return None
    name, text = _model_file()
    at = list(numbers_in(label, angles))
    return robot_from_toml(
        f"[robot_model]\nfile = {json.dumps(name)}\n[inertia]\nangles_deg = {at}",
        read=lambda _: text.encode(),
    )


def _ask_model(label: str, key: str) -> None:
    """Ask for the robot model of both steps, and name the one given."""
    st.file_uploader(
        f"{label} (Denavit–Hartenberg .toml, .urdf or MJCF .xml)",
        RobotModel.ENDINGS,
        max_upload_size=1,
        key=f"{key} {st.session_state.get(_UPLOADS, 0)}",
        on_change=_take_model,
        args=(key,),
    )
    if name := _model_file()[0]:
        st.caption(markdown_escape(name))


def _model_file() -> tuple[str, str]:
    """Name and text of the robot model given; empty without one."""
    name, text = (st.session_state.get(f"import model {what}", "") for what in ("name", "text"))
    return name, text


def _given_model() -> RobotModel | None:
    name, text = _model_file()
    return RobotModel.parse(name, text.encode()) if text else None


def _take_model(key: str) -> None:
    """Keep the model for both steps; enter its gear ratios in step 3 where there are none yet."""
    if (file := _taken(key)) is None:
        return
    st.session_state["import model name"], st.session_state["import model text"] = file
    st.session_state["import inertia source"] = "Robot model"
    with suppress(JointIdError):  # shown where the model was given
        if (model := _given_model()) is not None:
            known = np.isfinite(model.gear_ratio) & ~model.is_coupled
            pairs = zip(model.gear_ratio.tolist(), known, strict=True)
            ratios = ", ".join(f"{ratio:.10g}" if sure else "?" for ratio, sure in pairs)
            for entry in [str(name) for name in st.session_state]:
                if entry.startswith(f"import gear ratio  {model.n} ") and not st.session_state[entry]:
                    st.session_state[entry] = ratios


def _by_links(ratios: Sequence[float]) -> KnownRobot | None:
    units = {
        name: choose_from(place, f"import {name}", label, list(options))
        for place, (name, (label, options)) in zip(2 * st.columns(3), _LINK_UNITS.items(), strict=True)
    }
    scale = {name: options.get(units[name], 1.0) for name, (_, options) in _LINK_UNITS.items()}
    texts = {
        name: enter_text(place, f"import {name}", f"{label} ({units[unit]})", "", example=example)
        for place, (name, (label, unit, example)) in zip(2 * st.columns(3), _LINKS.items(), strict=True)
    }
    st.caption(
        "Two links in a horizontal plane, the tool counted with link 2. Gear ratios of step 3: "
        f"{numbers_out(ratios)}."
    )
    if not all(text.strip() for text in texts.values()):
        return None
    if len(ratios) != 2:
        raise JointIdError(
            f"The links of the arm have 2 joints, but step 2 has {len(ratios)}: give the inertias as "
            "numbers or as TOML."
        )
    of = {
        name: scale[unit] * np.array(numbers_in(label, texts[name]))
        for name, (label, unit, _) in _LINKS.items()
    }
    at_joint = units["rotor side"] == _JOINT
    arm = PlanarArm(
        length_m=of["length"],
        mass_kg=of["mass"],
        centre_m=of["centre"],
        inertia_kgm2=of["link"],
        gear_ratio=np.array(ratios, float),
        rotor_inertia_kgm2=rotor_at_motor(of["rotor"], ratios) if at_joint else of["rotor"],
        drive="serial" if "serial" in units["drive"] else "parallelogram",
    )
    return KnownRobot(arm.inertia(of["pose"]))


def _row(label: str, name: str, example: str) -> tuple[str, str, str]:
    one, two, three = st.columns([4, 1.5, 1.5])
    text = enter_text(one, f"import {name}", label, "", _HELP[name], example)
    unit = choose_from(two, f"import {name} unit", f"Unit of {name}", list(INERTIA_UNITS))
    side = choose_from(three, f"import {name} side", f"{name} is given on the", [_MOTOR, _JOINT])
    return text, unit, side
