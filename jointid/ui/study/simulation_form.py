"""The form of a simulated robot, and its study."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

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
from jointid.simulation.campaign import simulate_campaign
from jointid.simulation.motion import KINDS
from jointid.study import INERTIA_STD
from jointid.ui.shared.background import run_in_background
from jointid.ui.shared.entries import (
    ask_inertia_std,
    ask_torque_std,
    choose_from,
    enter_number,
    enter_text,
)
from jointid.ui.shared.parse_numbers import matrix_in, numbers_in, numbers_out
from jointid.wording import plain

_RECORDS = {
    "Sines, all joints, a new phase in each record": "orthogonal",
    "Sines, one joint at a time, the others held": "one-at-a-time",
    "Sweeps": "sweep",
    "Multisines on odd lines": "multisine",
    "Random motion": "random",
    "Point-to-point moves": "moves",
}
_COUNT_HELP = "Number of sines. Other motions: one record per joint, at least two."
_M2_HELP = (
    "On the diagonal each joint's own inertia, off it the coupling inertia: how much torque one joint "
    "needs because the other accelerates. Motor side: divided by both gear ratios."
)
_WRONG_HELP = (
    "The given inertias differ from the robot's by this much, each up or down at random; the fit must "
    "correct them."
)
_GAIN_HELP = (
    "1.05: the log shows 5 % more torque than the motors make. One number for all joints, or one each."
)
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
    "viscous": ("Viscous friction (N·m·s/rad)", "0, 0", "Grows with the velocity."),
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
    "seed": ("Seed of the noise", 1, (0, 2**31 - 1)),
}
"""Label, default, limits and explanation of each number."""
_LAWS = {
    "cubic": ("Cubic stiffness (N·m/rad³)", "Torque c δ³ in addition to K δ: the gear hardens."),
    "backlash_rad": ("Backlash (rad)", "Total play, seen from the motor."),
    "hysteresis_Nm": ("Hysteresis (N·m)", "Half the height of the loop (Dahl model)."),
    "presliding_rad": ("Presliding (rad)", "Hysteresis over the initial slope of its loop."),
    "K2": ("K2 (N·m/rad)", "Slope beyond the torque T1; 0: no change of slope."),
    "K3": ("K3 (N·m/rad)", "Slope beyond the torque T2."),
    "T1_Nm": ("T1 (N·m)", "Torque from which the slope is K2."),
    "T2_Nm": ("T2 (N·m)", "Torque from which the slope is K3."),
}
"""Label and explanation of the laws of a gear, one number for all joints or one each."""
_ADDED_HELP = (
    "Repeats all experiments with a payload of known mass and position. Its inertia, motor side, is "
    "exact and determines the torque scale."
)


@dataclass(frozen=True)
class Settings:
    """A robot and its experiments."""

    inertia: Inertia
    elasticity: Elasticity
    frequencies_hz: tuple[float, ...]
    pattern: str
    """Of ``Excitation``, or the kind of a ``Motion``."""
    seconds: float
    bandwidth_hz: float
    coulomb_Nm: tuple[float, ...]
    viscous_Nms: tuple[float, ...]
    encoder_counts: int | None
    torque_noise_Nm: float
    seed: int
    inertia_error: float
    """Share by which the study's inertias differ from the robot's."""
    torque_gain: tuple[float, ...]
    """Logged over true torque, by joint."""
    added: tuple[tuple[float, ...], ...]
    """Addition to M2 by the known payload of a second set of records; empty without one."""
    gears: tuple[Gear, ...]
    """Laws of the gears in addition to K and D."""
    inertia_std: float
    torque_std: float | None

    @property
    def records(self) -> int:
        """Number of records without payload."""
        n = self.inertia.n
        return max(n, 2) if self.pattern in KINDS else len(self.frequencies_hz) * n


def ask() -> Settings | None:
    """Draw the form and return its settings when it was sent.

    Raises
    ------
    JointIdError
        When the entries are no robot or no experiment.
    """
    left, right = st.columns(2)
    left.markdown("**The robot, seen from the motors**")
    text = {key: enter_text(left, f"sim_{key}", *entry) for key, entry in _ROBOT.items()}
    with left.expander("Nonlinear gears") as gears:
        laws = {
            name: enter_text(gears, f"sim_{name}", label, "0", about)
            for name, (label, about) in _LAWS.items()
        }
    right.markdown("**The experiments**")
    pattern = choose_from(right, "sim_pattern", "Motion", list(_RECORDS))
    places = [place for _ in range(4) for place in right.columns(2)]
    number = {
        key: enter_number(place, f"sim_{key}", *entry)
        for place, (key, entry) in zip(places, _EXPERIMENTS.items(), strict=True)
    }
    st.markdown("**Stated in the study**")
    left, right = st.columns(2)
    wrong = enter_number(left, "sim_wrong", "Error of the inertias (%)", 0.0, (0.0, 90.0), _WRONG_HELP)
    inertia_std = ask_inertia_std(right, "sim_inertia_std", INERTIA_STD)
    left, right = st.columns(2)
    gain = enter_text(left, "sim_gain", "Logged torque / true torque", "1", _GAIN_HELP)
    torque_std = ask_torque_std(right, "sim_torque_std")
    label = "Second set of records with a payload: its addition to M2 (kg·m²), optional"
    example = "0.0012, 0.0005; 0.0005, 0.0009"
    added = enter_text(st.container(), "sim_added", label, "", _ADDED_HELP, example)
    if not st.button("Simulate", type="primary", key="simulate"):
        return None
    first, last = number["first"], number["last"]
    if last < first:
        raise JointIdError(
            f"Last frequency {last:g} Hz lies below the first, {first:g} Hz: exchange them."
        )
    rotors = numbers_in("Rotor inertias M", text["M"])
    joints = len(rotors)
    return Settings(
        inertia=Inertia(rotors, matrix_in("Arm inertia M2", text["M2"])),
        elasticity=Elasticity(numbers_in("Stiffness K", text["K"]), numbers_in("Damping D", text["D"])),
        frequencies_hz=tuple(np.geomspace(first, last, int(number["count"])).round(4).tolist()),
        pattern=_RECORDS[pattern],
        seconds=float(number["seconds"]),
        bandwidth_hz=float(number["bandwidth"]),
        coulomb_Nm=numbers_in("Coulomb friction", text["coulomb"], count=joints),
        viscous_Nms=numbers_in("Viscous friction", text["viscous"], count=joints),
        encoder_counts=int(number["counts"]) or None,
        torque_noise_Nm=float(number["noise"]),
        seed=int(number["seed"]),
        inertia_error=float(wrong) / 100,
        torque_gain=numbers_in("Logged torque / true torque", gain, count=joints),
        added=tuple(matrix_in("Addition to M2", added)) if added.strip() else (),
        gears=_gears(laws, joints),
        inertia_std=inertia_std,
        torque_std=torque_std,
    )


def simulated_study(settings: Settings, progress: Callable[[float], None]) -> Study:
    """Run the experiments.

    Raises
    ------
    JointIdError
        When the settings do not fit each other.
    """
    f, kind = settings.frequencies_hz, settings.pattern
    experiment: Any = f
    shape: dict[str, Any] = {}
    if kind in KINDS:
        experiment = Motion(kind, f[0], f[-1], settings.seconds, odd=kind == "multisine")
        shape["records"] = settings.records
    else:
        shape["excitation"] = Excitation(pattern=kind, duration_s=settings.seconds)
    campaign = run_in_background(
        simulate_campaign,
        settings.inertia,
        settings.elasticity,
        experiment,
        **shape,
        controller=Controller(bandwidth_hz=settings.bandwidth_hz),
        friction=MotorFriction(coulomb=settings.coulomb_Nm, viscous=settings.viscous_Nms),
        measurement=Measurement(
            encoder_counts=settings.encoder_counts,
            torque_noise_Nm=settings.torque_noise_Nm,
            torque_gain=settings.torque_gain,
        ),
        gears=settings.gears,
        inertia_error=settings.inertia_error,
        added=settings.added or None,
        seed=settings.seed,
        progress=progress,
    )
    truth = settings.elasticity
    return Study(
        **campaign._asdict(),
        inertia_std=settings.inertia_std,
        torque_std=settings.torque_std,
        name=f"Simulated robot, K = {numbers_out(truth.K)} N·m/rad",
        origin="simulated",
        description=f"True values: K = {numbers_out(truth.K)} N·m/rad, "
        f"D = {numbers_out(truth.D)} N·m·s/rad; "
        f"Coulomb friction {numbers_out(settings.coulomb_Nm)} N·m; torque noise "
        f"{plain(settings.torque_noise_Nm)} N·m; seed {settings.seed}.{_errors(settings)}",
    )


def _errors(settings: Settings) -> str:
    """Describe the stated values: their errors, and a payload."""
    text = ""
    if settings.inertia_error:
        text += f" Given inertias wrong by {plain(100 * settings.inertia_error)} %."
    if any(gain != 1 for gain in settings.torque_gain):
        text += f" Logged torque / true torque = {numbers_out(settings.torque_gain)}."
    if settings.added:
        text += " All experiments without and with a known payload."
    for j, gear in enumerate(settings.gears, start=1):
        if gear.kind != "linear":
            values = ((label, getattr(gear, name)) for name, (label, *_) in _LAWS.items())
            shown = ", ".join(f"{label.lower()} {plain(value)}" for label, value in values if value)
            text += f" Gear {j}: {shown}."
    return text


def _gears(laws: dict[str, str], joints: int) -> tuple[Gear, ...]:
    values = [numbers_in(_LAWS[name][0], text, count=joints) for name, text in laws.items()]
    rows = zip(*values, strict=True)
    return tuple(Gear(**dict(zip(laws, row, strict=True))) for row in rows)
