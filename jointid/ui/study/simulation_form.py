"""The form of a simulated robot, and its study."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from jointid import (
    Controller,
    Elasticity,
    Excitation,
    Inertia,
    JointIdError,
    Measurement,
    Motion,
    MotorFriction,
    Study,
)
from jointid.rounding import plain
from jointid.simulation.campaign import simulate_campaign
from jointid.simulation.motion import KINDS
from jointid.study import INERTIA_STD
from jointid.ui.shared.background import run_in_background
from jointid.ui.shared.deviations import ask_inertia_std, ask_torque_std
from jointid.ui.shared.parse_numbers import matrix_in, numbers_in, numbers_out

Number = TypeVar("Number", int, float)
_RECORDS = {
    "Sines, all joints, another phase each time": "orthogonal",
    "Sines, one joint at a time, the others held": "one-at-a-time",
    "Sweeps": "sweep",
    "Multisines on odd lines": "multisine",
    "Random motion": "random",
    "Point-to-point moves": "moves",
}
_COUNT_HELP = "Number of sines. Of another motion, every joint gives one record, at least two."
_M2 = "0.004104, 0.000395; 0.000395, 0.001889"
_M2_HELP = (
    "On the diagonal each joint's own inertia, off it the coupling inertia: how much torque one joint "
    "needs because the other accelerates. Motor side: divided by both gear ratios."
)
_WRONG_HELP = (
    "The study's inertias differ from the robot's by this much, each up or down at random; the fit must "
    "correct them."
)
_GAIN_HELP = (
    "1.05: the log shows 5 % more torque than the motors make. One number for all joints, or one each."
)
_ADDED_HELP = (
    "All experiments are made again with a payload of known mass at a known place. Its inertia, motor "
    "side, is exact; it fixes the absolute torque scale."
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
        When what was entered is no robot or no experiment.
    """
    with st.form("simulate", border=False):
        left, right = st.columns(2)
        with left:
            st.markdown("**The robot, seen from the motors**")
            K = _text("Stiffness K (N·m/rad), one per joint", "43, 7.5", "K")
            D = _text("Damping D (N·m·s/rad)", "0.10, 0.015", "D")
            M = _text("Rotor inertias M (kg·m²)", "0.0025, 0.0010", "M")
            M2 = _text("Arm inertia M2 (kg·m²), rows separated by ;", _M2, "M2", _M2_HELP)
            coulomb = _text(
                "Coulomb friction (N·m)", "0.02, 0.01", "coulomb", "Constant, against the motion."
            )
            viscous = _text(
                "Viscous friction (N·m·s/rad)", "0, 0", "viscous", "Grows with the velocity."
            )
        with right:
            st.markdown("**The experiments**")
            one, two = st.columns(2)
            first = _number(one, "First frequency (Hz)", 3.0, (0.05, 1000.0), "first")
            last = _number(two, "Last frequency (Hz)", 30.0, (0.05, 1000.0), "last")
            one, two = st.columns(2)
            count = _number(one, "Frequencies", 16, (1, 60), "count", _COUNT_HELP)
            seconds = _number(two, "Length of a record (s)", 4.0, (0.2, 60.0), "seconds")
            pattern = st.selectbox("Motion", list(_RECORDS), key="sim_pattern", persist_state="session")
            one, two = st.columns(2)
            noise = _number(one, "Torque noise (N·m)", 0.02, (0.0, 10.0), "noise")
            counts = _number(two, "Encoder counts per turn, 0: ideal", 65536, (0, 2**24), "counts")
            one, two = st.columns(2)
            bandwidth = _number(one, "Controllers' bandwidth (Hz)", 5.0, (0.2, 50.0), "bandwidth")
            seed = _number(two, "Seed of the noise", 1, (0, 2**31 - 1), "seed")
        st.markdown("**What the study is given**")
        left, right = st.columns(2)
        wrong = _number(left, "Inertias wrong by (%)", 0.0, (0.0, 90.0), "wrong", _WRONG_HELP)
        inertia_std = ask_inertia_std(right, "sim_inertia_std", INERTIA_STD)
        left, right = st.columns(2)
        gain = left.text_input(
            "Logged torque / true torque", "1", key="sim_gain", persist_state="session", help=_GAIN_HELP
        )
        torque_std = ask_torque_std(right, "sim_torque_std")
        added = st.text_input(
            "Second set of records with a payload: its addition to M2 (kg·m²), optional",
            key="sim_added",
            placeholder="0.0012, 0.0005; 0.0005, 0.0009",
            persist_state="session",
            help=_ADDED_HELP,
        )
        if not st.form_submit_button("Simulate", type="primary"):
            return None
    if last < first:
        raise JointIdError(
            f"Last frequency {last:g} Hz lies below the first, {first:g} Hz: exchange them."
        )
    rotors = numbers_in("Rotor inertias M", M)
    joints = len(rotors)
    return Settings(
        inertia=Inertia(rotors, matrix_in("Arm inertia M2", M2)),
        elasticity=Elasticity(numbers_in("Stiffness K", K), numbers_in("Damping D", D)),
        frequencies_hz=tuple(np.geomspace(first, last, int(count)).round(4).tolist()),
        pattern=_RECORDS[pattern],
        seconds=float(seconds),
        bandwidth_hz=float(bandwidth),
        coulomb_Nm=numbers_in("Coulomb friction", coulomb, count=joints),
        viscous_Nms=numbers_in("Viscous friction", viscous, count=joints),
        encoder_counts=int(counts) or None,
        torque_noise_Nm=float(noise),
        seed=int(seed),
        inertia_error=float(wrong) / 100,
        torque_gain=numbers_in("Logged torque / true torque", gain, count=joints),
        added=tuple(matrix_in("Addition to M2", added)) if added.strip() else (),
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
    """Describe what the study is given: its errors, and a payload."""
    text = ""
    if settings.inertia_error:
        text += f" Given inertias wrong by {plain(100 * settings.inertia_error)} %."
    if any(gain != 1 for gain in settings.torque_gain):
        text += f" Logged torque / true torque = {numbers_out(settings.torque_gain)}."
    if settings.added:
        text += " All experiments without and with a known payload."
    return text


def _text(label: str, value: str, key: str, help_text: str | None = None) -> str:
    return st.text_input(label, value, key=f"sim_{key}", help=help_text, persist_state="session")


def _number(
    place: DeltaGenerator,
    label: str,
    value: Number,
    limits: tuple[Number, Number],
    key: str,
    help_text: str | None = None,
) -> Number:
    return place.number_input(
        label, *limits, value, key=f"sim_{key}", persist_state="session", help=help_text
    )
