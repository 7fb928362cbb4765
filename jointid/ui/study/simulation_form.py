"""The form of a simulated robot, and its study."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import streamlit as st

from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Gear,
    Inertia,
    JointIdError,
    Measurement,
    Motion,
    MotorFriction,
    Study,
)
from jointid.simulation.closed_loop import simulate_campaign
from jointid.simulation.motion import KINDS, LIMITS
from jointid.ui.shared.entries import (
    ask_inertia_std,
    ask_torque_std,
    choose_from,
    enter_number,
    enter_text,
    matrix_in,
    numbers_in,
    numbers_out,
)
from jointid.ui.shared.messages import show_error
from jointid.ui.shared.results import run_in_background
from jointid.wording import plain

_RECORDS = {
    "Sines, all joints, different phases in each record": "orthogonal",
    "Sines, one joint at a time, the others held": "one-at-a-time",
    "Sweeps": "sweep",
    "Multisines on odd lines": "multisine",
    "Random motion": "random",
    "Point-to-point moves": "moves",
}
_COUNT_HELP = "Number of sines. Other motions: one record per joint, at least two."
_AMPLITUDES_HELP = (
    "At 100 %, up to 10 rad/s and 300 rad/s² of every motor. 100, 30: all sines with both amplitudes, "
    "which shows nonlinear gears. Other motions have one amplitude."
)
_M2_HELP = (
    "On the diagonal each joint's own inertia, off it the coupling inertia: torque on one joint per "
    "acceleration of another. Motor side: divided by both gear ratios."
)
_WRONG_HELP = (
    "The given inertias differ from the robot's by this much, each up or down at random; the fit must "
    "correct the inertias."
)
_GAIN_HELP = "1.05: the logged torque is 5 % too large. One number for all joints, or one each."
_ROBOT = {
    "K": ("Stiffness K (N·m/rad), one per joint", "43, 7.5"),
    "D": ("Damping D (N·m·s/rad)", "0.10, 0.015"),
    "M": ("Rotor inertias M (kg·m²)", "0.0025, 0.0010"),
    "M2": (
        "Arm inertia M2 (kg·m²), rows separated by ;",
        "0.004104, 0.000395; 0.000395, 0.001889",
        _M2_HELP,
    ),
    "coulomb": ("Coulomb friction (N·m)", "0.02, 0.01", "Constant, opposite to the motion."),
    "viscous": ("Viscous friction (N·m·s/rad)", "0, 0", "Proportional to the velocity."),
    "load": (
        "Load-dependent friction coefficient",
        "0",
        "Share of the torque through the gear, under 1.",
    ),
}
"""Label, default and explanation of each text."""
_EXPERIMENTS: dict[str, tuple[Any, ...]] = {
    "first": ("First frequency (Hz)", 3.0, (0.05, 1000.0)),
    "last": ("Last frequency (Hz)", 30.0, (0.05, 1000.0)),
    "count": ("Frequencies", 16, (1, 60), _COUNT_HELP),
    "seconds": ("Length of a record (s)", 4.0, (0.2, 60.0)),
    "noise": ("Torque noise (N·m)", 0.02, (0.0, 10.0)),
    "counts": ("Encoder counts per turn, 0: ideal", 65536, (0, 2**24)),
    "bandwidth": ("Controllers' bandwidth (Hz)", 5.0, (0.2, 50.0)),
    "seed": ("Seed of noise and motion", 1, (0, 2**31 - 1)),
}
"""Label, default, limits and explanation of each number."""
_UNUSED = dict.fromkeys(KINDS, ("count",)) | {"moves": ("first", "last", "count")}
"""Numbers that a motion does not depend on."""
_LAWS = {
    "cubic": ("Cubic stiffness (N·m/rad³)", "Torque c δ³ in addition to K δ: the gear hardens."),
    "backlash_rad": ("Backlash (rad)", "Total angle between the flanks, seen from the motor."),
    "hysteresis_Nm": ("Hysteresis (N·m)", "Half the height of the loop (Dahl model)."),
    "presliding_rad": ("Presliding (rad)", "Hysteresis torque over the initial slope of its loop."),
    "T1_Nm": ("Catalogue T1 (N·m)", "Torque from which the slope is K2."),
    "K2": ("Catalogue K2 (N·m/rad)", "Slope beyond the torque T1; 0: no change of slope."),
    "T2_Nm": ("Catalogue T2 (N·m)", "Torque from which the slope is K3."),
    "K3": ("Catalogue K3 (N·m/rad)", "Slope beyond the torque T2."),
}
"""Label and explanation of the laws of a gear, one number for all joints or one each."""
_GROUPS = {
    "Hardening, backlash": ("cubic", "backlash_rad"),
    "Friction in the gear": ("hysteresis_Nm", "presliding_rad"),
    "Three slopes, as in gear catalogues": ("T1_Nm", "K2", "T2_Nm", "K3"),
}
"""Laws that belong together."""
_ADDED_HELP = (
    "Repeats all experiments with a payload of known mass and position. Its inertia, motor side, is "
    "exact and determines the torque scale."
)


class Simulation(NamedTuple):
    """A robot and its experiments, as ``simulate_campaign`` takes them, and what their study states."""

    campaign: dict[str, Any]
    study: dict[str, Any]
    records: int
    """Number of all records."""


def ask() -> Simulation | None:
    """Draw the form and return the simulation when it was sent.

    Raises JointIdError when the entries are no robot or no experiment.
    """
    left, right = st.columns(2)
    left.markdown("**The robot, seen from the motors**")
    text = {key: enter_text(left, f"sim_{key}", *entry) for key, entry in _ROBOT.items()}
    laws = {}
    with left.expander("Nonlinear gears", key="sim_gears", on_change="rerun", bind="query-params"):
        for group, names in _GROUPS.items():
            st.caption(group)
            places = [place for _ in names[::2] for place in st.columns(2)]
            for name, place in zip(names, places, strict=True):
                label, about = _LAWS[name]
                laws[name] = enter_text(place, f"sim_{name}", label, "0", about)
    right.markdown("**The experiments**")
    pattern = choose_from(right, "sim_pattern", "Motion", list(_RECORDS))
    places = [place for _ in range(4) for place in right.columns(2)]
    number, wrong_entries = {}, False
    for place, (key, entry) in zip(places, _EXPERIMENTS.items(), strict=True):
        try:
            unused = key in _UNUSED.get(_RECORDS[pattern], ())
            number[key] = enter_number(place, f"sim_{key}", *entry, disabled=unused)
        except JointIdError as error:  # the other entries stay in view
            show_error(error, place)
            wrong_entries = True
    sizes = enter_text(right, "sim_amplitudes", "Amplitudes (%)", "100", _AMPLITUDES_HELP)
    st.markdown("**Stated in the study**")
    left, right = st.columns(2)
    wrong = enter_number(left, "sim_wrong", "Error of the inertias (%)", 0.0, (0.0, 90.0), _WRONG_HELP)
    inertia_std = ask_inertia_std(right, "sim_inertia_std")
    left, right = st.columns(2)
    gain = enter_text(left, "sim_gain", "Logged torque / true torque", "1", _GAIN_HELP)
    torque_std = ask_torque_std(right, "sim_torque_std")
    label = "Second set of records with a payload: its addition to M2 (kg·m²), optional"
    example = "0.0012, 0.0005; 0.0005, 0.0009"
    added = enter_text(st.container(), "sim_added", label, "", _ADDED_HELP, example)
    if not st.button("Simulate", type="primary", key="simulate") or wrong_entries:
        return None
    first, last = number["first"], number["last"]
    if _RECORDS[pattern] == "moves":  # has no frequencies, and its fields cannot be corrected
        first, last = (_EXPERIMENTS[key][1] for key in ("first", "last"))
    if last < first:
        raise JointIdError(f"Last frequency {last:g} Hz is below the first, {first:g} Hz: swap them.")
    rotors = numbers_in("Rotor inertias M", text["M"])
    joints, kind, seconds = len(rotors), _RECORDS[pattern], float(number["seconds"])
    K, D = numbers_in("Stiffness K", text["K"]), numbers_in("Damping D", text["D"])
    coulomb = numbers_in("Coulomb friction", text["coulomb"], count=joints)
    frequencies = np.geomspace(first, last, int(number["count"])).round(4).tolist()
    amplitudes = [size / 100 for size in _positive("Amplitudes (%)", sizes)]
    if kind in KINDS:
        if len(amplitudes) > 1:
            raise JointIdError(f"Amplitudes (%): {sizes.strip()[:60]}. Only sines may have several.")
        records = max(joints, 2)
        motion = Motion(kind, float(first), float(last), seconds, odd=kind == "multisine")
        largest = {name: amplitudes[0] * getattr(motion, name) for name in LIMITS}
        experiment: dict[str, Any] = {"experiment": replace(motion, **largest), "records": records}
    else:
        weights = Excitation(pattern=kind).weights(joints)
        sines = Excitation(np.vstack([size * weights for size in amplitudes]), duration_s=seconds)
        records = len(frequencies) * joints * len(amplitudes)
        experiment = {"experiment": tuple(frequencies), "excitation": sines}
    values = [numbers_in(_LAWS[name][0], entry, count=joints) for name, entry in laws.items()]
    of_gears = zip(*values, strict=True)
    payload = matrix_in("Addition to M2", added) if added.strip() else None
    campaign = experiment | {
        "inertia": Inertia(rotors, matrix_in("Arm inertia M2", text["M2"])),
        "elasticity": Elasticity(K, D),
        "controller": Controller(bandwidth_hz=float(number["bandwidth"])),
        "friction": MotorFriction(
            coulomb=coulomb,
            viscous=numbers_in("Viscous friction", text["viscous"], count=joints),
            load=numbers_in("Load-dependent friction coefficient", text["load"], count=joints),
        ),
        "measurement": Measurement(
            encoder_counts=int(number["counts"]) or None,
            torque_noise_Nm=float(number["noise"]),
            torque_gain=_positive("Logged torque / true torque", gain, joints),
        ),
        "gears": tuple(Gear(**dict(zip(laws, row, strict=True))) for row in of_gears),
        "inertia_error": float(wrong) / 100,
        "added": payload,
        "seed": int(number["seed"]),
    }
    study = {
        "inertia_std": inertia_std,
        "torque_std": torque_std,
        "name": f"Simulated robot, K = {numbers_out(K)} N·m/rad",
        "origin": "simulated",
        "description": f"True values: K = {numbers_out(K)} N·m/rad, D = {numbers_out(D)} N·m·s/rad; "
        f"Coulomb friction {numbers_out(coulomb)} N·m; torque noise {plain(float(number['noise']))} "
        f"N·m; amplitudes {numbers_out(100 * size for size in amplitudes)} %; "
        f"seed {int(number['seed'])}.{_errors(campaign)}",
    }
    return Simulation(campaign, study, records * (1 if payload is None else 2))


def _positive(name: str, text: str, joints: int | None = None) -> tuple[float, ...]:
    values = numbers_in(name, text, count=joints)
    if not all(value > 0 for value in values):
        raise JointIdError(f"{name}: {text.strip()[:60]}. Give positive numbers.")
    return values


def simulated_study(simulation: Simulation, progress: Callable[[float], None]) -> Study:
    """Run the experiments.

    Raises JointIdError when the settings do not fit each other.
    """
    made = run_in_background(simulate_campaign, **simulation.campaign, progress=progress)
    return Study(**made._asdict(), **simulation.study)


def _errors(campaign: dict[str, Any]) -> str:
    """Describe the stated values: their errors, and a payload."""
    text, gain = "", campaign["measurement"].torque_gain
    if campaign["inertia_error"]:
        text += f" Given inertias wrong by {plain(100 * campaign['inertia_error'])} %."
    if any(each != 1 for each in gain):
        text += f" Logged torque / true torque = {numbers_out(gain)}."
    if campaign["added"]:
        text += " All experiments without and with a known payload."
    for j, gear in enumerate(campaign["gears"], start=1):
        if gear.kind != "linear":
            values = ((label.rstrip(")"), getattr(gear, name)) for name, (label, *_) in _LAWS.items())
            parts = [(*label.split(" ("), value) for label, value in values if value]
            shown = ", ".join(
                f"{name[0].lower()}{name[1:]} {plain(value)} {unit}" for name, unit, value in parts
            )
            text += f" Gear {j}: {shown}."
    return text
