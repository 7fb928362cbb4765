"""The settings of the cut, and their controls."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import streamlit as st

from jointid import Elasticity, JointIdError
from jointid.answer import AT_MOTOR, StiffnessUnit
from jointid.cut.arm import Drive
from jointid.cut.outcome import TYPICAL_SERVO
from jointid.cut.rectangle import rectangle
from jointid.cut.robot import CUTTING_POINT_M, NOMINAL_NAMES, Assumption, CutFriction, CutRobot
from jointid.cut.servo import Servo
from jointid.cut.toolpath import Toolpath
from jointid.ui.shared.charts import choose_segment
from jointid.ui.shared.entries import choose_from, enter_number, enter_text, numbers_in, numbers_out
from jointid.ui.shared.messages import show_error
from jointid.wording import capitalised, counted

_rectangle = lru_cache(maxsize=64)(rectangle)  # a page asks for each of its paths several times
_ZONE_MM, _SIDES_MM, _SPEED_MM_S = 10.0, (28.0, 45.0), 300.0
"""Figure 7's path at its largest zone; sides and speed are the paper's."""
_NUMBERS: dict[str, dict[str, tuple[Any, ...]]] = {
    "Path": {
        "width": ("Width (mm)", _SIDES_MM[0], (2.0, 150.0)),
        "height": ("Height (mm)", _SIDES_MM[1], (2.0, 150.0)),
        "speed": ("Speed (mm/s)", _SPEED_MM_S, (10.0, 1000.0)),
    },
    "Servo": {
        "rate": ("Control rate (Hz)", TYPICAL_SERVO.sample_rate_hz, (500.0, 8000.0)),
        "delay": (
            "Delay (samples)",
            TYPICAL_SERVO.delay_samples,
            (0, 5),
            "From measurement to the resulting torque. The feedforward runs ahead by this time.",
        ),
        "bits": (
            "Encoder (bits per turn), 0: ideal",
            TYPICAL_SERVO.encoder_bits or 0,
            (0, 24),
            "With an encoder, the velocity is computed from the difference of two positions.",
        ),
    },
}
"""Label, default, limits and explanation of each number, by its heading."""
_FRICTION = ("As identified", "None", "Custom")
_DRIVES: dict[str, Drive | None] = {
    "As in this study": None,
    "Parallelogram": "parallelogram",
    "Serial": "serial",
}
_HINT = (
    "K and D in the servo before the identification. Nominal: those that the study states. Rigid: no "
    "compensation of the deflection. 0.4 K and 3 K: the identified stiffnesses times 0.4 or 3. "
    "The paper does not state its non-optimal parameters; these factors are assumed."
)


@dataclass(frozen=True, kw_only=True)
class CutSettings:
    """All settings of a cut besides the study; a key of the cache."""

    assumption: Assumption
    custom_K: tuple[float, ...] = ()
    custom_D: tuple[float, ...] = ()
    zone_m: float = 1e-3 * _ZONE_MM
    width_m: float = 1e-3 * _SIDES_MM[0]
    height_m: float = 1e-3 * _SIDES_MM[1]
    speed_m_s: float = 1e-3 * _SPEED_MM_S
    servo: Servo = TYPICAL_SERVO
    friction: CutFriction | None
    """Friction at the motors; None without."""
    drive: Drive

    @property
    def custom(self) -> Elasticity | None:
        """The custom nominal values, in the study's units."""
        return Elasticity(self.custom_K, self.custom_D) if self.assumption == "custom" else None

    @property
    def toolpath(self) -> Toolpath:
        """The reference path."""
        return _rectangle(
            width_m=self.width_m,
            height_m=self.height_m,
            speed_m_s=self.speed_m_s,
            zone_m=self.zone_m,
            centre_m=CUTTING_POINT_M,
        )

    @property
    def after(self) -> CutSettings:
        """The settings of the cut after the identification: all but the nominal controller."""
        return replace(self, assumption="rigid", custom_K=(), custom_D=())


def usual(robot: CutRobot) -> CutSettings:
    """Default settings: the paper's path and the default servo."""
    assumption: Assumption = "study" if robot.nominal else "rigid"
    return CutSettings(assumption=assumption, friction=robot.friction, drive=robot.arm.drive)


def ask_or_last(robot: CutRobot, digest: str, unit: StiffnessUnit) -> CutSettings:
    """Draw the controls; while an entry is wrong, say so and return the last valid settings."""
    key = f"cut_settings {digest}"
    try:
        entered = ask(robot, digest, unit)
        _ = entered.custom  # refuses values that are no springs
        st.session_state[key] = entered
    except JointIdError as error:
        show_error(error)
        st.caption("The drawing shows the last valid settings.")
    settings: CutSettings = st.session_state.get(key) or usual(robot)
    return settings


def ask(robot: CutRobot, digest: str, unit: StiffnessUnit) -> CutSettings:
    """Draw the controls and return the choice. Raises JointIdError when an entry is not a number.

    The robot of the study has the drive that suits its inertias; the study's digest keeps entries for
    one robot from applying to another. ``unit`` is that of the study's K and D.
    """
    left, right = st.columns([3, 2])
    with left:
        choices = [name for name in NOMINAL_NAMES if name != "study" or robot.nominal]
        key = "cut_nominal" if robot.nominal else "cut_servo"  # they differ in their choices
        names = {name: capitalised(NOMINAL_NAMES[name]) for name in choices}
        assumption = choose_segment(
            "Servo before identification", choices, key, format_func=names.__getitem__, hint=_HINT
        )
    with right:
        zone = st.slider(
            "Corner zone (mm)",
            0.5,
            _ZONE_MM,
            _ZONE_MM,
            0.5,
            format="%g",
            key="cut_zone",
            bind="query-params",
            help="Distance before a corner at which the tool begins to turn: it passes the rounded "
            "corner without stopping.",
        )
    K, D = _ask_custom(robot, digest, unit) if assumption == "custom" else ((), ())
    with st.expander("Path, servo and drive"):
        places = st.columns(3)
        number: dict[str, float] = {}
        for place, (heading, entries) in zip(places, _NUMBERS.items(), strict=False):
            place.markdown(f"**{heading}**")
            number |= {key: enter_number(place, f"cut_{key}", *of) for key, of in entries.items()}
        with places[2]:
            st.markdown("**Robot**")
            place, hint = places[2], "Coulomb friction is constant, opposite to the motion."
            source = choose_from(place, "cut_friction", "Friction at the motors", _FRICTION, help_=hint)
            coulomb = "0.5, 0.25"
            if source == "Custom":
                coulomb = enter_text(place, "cut_coulomb", "Coulomb friction (N·m)", coulomb)
            hint = "Parallelogram: both motors sit on the base. Serial: motor 2 sits on link 1."
            drive = choose_from(place, "cut_drive", "Drive", list(_DRIVES), help_=hint)
            compensated = st.checkbox(
                "The servo compensates friction",
                key="cut_compensated",
                bind="query-params",
                help="Applies to both cuts. The servo knows the friction exactly.",
            )
    friction = {"As identified": robot.friction, "None": None}.get(source)
    if source == "Custom":
        friction = CutFriction(numbers_in("Coulomb friction", coulomb, count=2), (0.0, 0.0))
    return CutSettings(
        assumption=assumption,
        custom_K=K,
        custom_D=D,
        zone_m=1e-3 * zone,
        width_m=1e-3 * number["width"],
        height_m=1e-3 * number["height"],
        speed_m_s=1e-3 * number["speed"],
        servo=Servo(
            sample_rate_hz=number["rate"],
            delay_samples=int(number["delay"]),
            encoder_bits=int(number["bits"]) if number["bits"] >= 4 else None,
            differentiated_velocity=number["bits"] >= 4,
            friction_compensation=friction if compensated else None,
        ),
        friction=friction,
        drive=_DRIVES[drive] or robot.arm.drive,
    )


def _ask_custom(robot: CutRobot, digest: str, unit: StiffnessUnit) -> list[tuple[float, ...]]:
    """Ask for nominal K and D in the study's unit; defaults are its nominal or identified values.

    Returns them in N·m/rad and N·m·s/rad at the motor.
    """
    start, whose = robot.of_the_study(robot.nominal or robot.elasticity), "this study's robot"
    if robot.rule == "demonstration":
        unit, whose = AT_MOTOR, "the example arm"
    factors = np.split(unit.shown(np.ones(4)), 2)
    side = "" if unit.is_default else f" {unit.side}"
    found = []
    units = {"K": f"N·m/{unit.angle}{side}", "D": f"N·m·s/rad{side}"}
    for place, (name, of), factor in zip(st.columns(2), units.items(), factors, strict=True):
        value = numbers_out(float(f"{x:.5g}") for x in factor * getattr(start, name))
        label = f"{name}1, {name}2 assumed by the servo, for {whose} ({of})"
        key = f"cut_{name}_{digest[:12]}{'' if unit.is_default else of}"  # of this study and unit only
        values = numbers_in(f"{name} in the servo", enter_text(place, key, label, value))
        if len(values) != 2:
            count = counted(len(values), "value")
            raise JointIdError(f"{name} in the servo: {count} for 2 joints. Give one per joint.")
        found.append(tuple((np.array(values) / factor).tolist()))
    return found
