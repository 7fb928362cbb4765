"""Table of wrong units by the factor that they make."""

from typing import NamedTuple

import numpy as np

from jointid.verdict.evidence import Action

DEGREES = np.pi / 180
CLOSE, ROUGH, NEAR = 1.03, 1.1, 1.35
"""Ratio within which a factor counts as a known one: of a good fit, with another fault, for a hint."""
GOOD = 10.0
"""Misfit below which a fit explains the records."""
VELOCITY_UNITS = {1.0: "rad/s", DEGREES: "°/s", np.pi / 30: "rpm"}
"""Units of a velocity that may be taken for a position, by their size in rad/s."""
INACCURATE = 1.8
"""Factor up to which inaccurate inertias may be the cause."""
LARGEST_GEAR_RATIO = 1000.0
"""Largest plausible gear ratio; its inverse is the smallest."""
ALIKE = 0.02
"""Spread of the factors' logarithms up to which one cause, such as time, explains all joints."""


class Cause(NamedTuple):
    """A wrong unit."""

    factor: float
    """Torque over acceleration, logged over expected."""
    signal: str
    """"position" or "torque" of any joint; "time" or "inertia" of all."""
    title: str
    """After "the position of joint 1" or the like."""
    why: str
    remedy: str
    """With {} for the joints."""
    by: str = ""
    """What to do in the files with {}, the columns of a unit of one signal."""

    @property
    def is_common(self) -> bool:
        """Whether it concerns all joints alike."""
        return self.signal in ACTIONS


def _unit(factor: float, signal: str, title: str, why: str, unit: str, by: str) -> Cause:
    remedy = f"Set the unit of the {signal} of {{}} to {unit} on import, or {by.format('its values')}"
    return Cause(factor, signal, title, why, remedy, by)


def _time(factor: float, unit: str, taken: str, why: str, by: str) -> Cause:
    short = {"milliseconds": "ms", "microseconds": "µs", "seconds": "s"}[unit]
    return Cause(
        factor,
        "time",
        f"Time is probably in {unit} but was read as {taken}",
        f"acceleration scales with time squared, {why}",
        f"Set the unit of time to {short} on import, or {by} in the files",
    )


ACTIONS: dict[str, Action] = {"time": "edit mapping", "inertia": "edit inertias"}
CAUSES = (
    _unit(DEGREES, "position", "seems to be in degrees",
          "a position in degrees read as radians (180/π = 57.3)", "deg",
          "multiply {} by π/180"),
    _unit(1 / DEGREES, "position", "seems to be converted from degrees, although it is in radians",
          "a position in radians read as degrees (180/π = 57.3)", "rad",
          "multiply {} by 180/π"),
    Cause(DEGREES**2, "position", "seems to be in degrees, and its gear ratio 57.3 times too large",
          "degrees read as radians twice, in the position and in the gear ratio ((180/π)² = 3283)",
          "Check the unit of the position of {}, degrees or radians, and the gear ratio"),
    Cause(DEGREES**-2, "position", "seems to be converted from degrees twice",
          "radians read as degrees twice, in the position and in the gear ratio ((180/π)² = 3283)",
          "Check the unit of the position of {}, degrees or radians, and the gear ratio"),
    _unit(2 * np.pi, "position", "seems to be in revolutions",
          "a position in revolutions read as radians (2π)", "rev", "multiply {} by 2π"),
    _unit(1 / (2 * np.pi), "position",
          "seems to be converted from revolutions, although it is in radians",
          "a position in radians read as revolutions (2π)", "rad", "divide {} by 2π"),
    _unit(1e3, "torque", "seems to be in mN·m",
          "a torque in mN·m read as N·m", "mN·m", "divide {} by 1000"),
    _unit(1e-3, "position", "seems to be in mrad",
          "a position in mrad read as rad", "mrad", "divide {} by 1000"),
    Cause(np.sqrt(0.5), "torque", "seems to be an rms value in place of the peak",
          "an rms current read as peak (1/√2)",
          "Check whether current and torque constant of {} are both rms or both peak values"),
    Cause(np.sqrt(2), "torque", "seems to be a peak value in place of rms",
          "a peak current read as rms (√2)",
          "Check whether current and torque constant of {} are both rms or both peak values"),
    _time(1e6, "milliseconds", "seconds", "1000² = 10⁶", "divide it by 1000"),
    _time(1e-6, "seconds", "milliseconds", "1000² = 10⁶", "multiply it by 1000"),
    _time(1e12, "microseconds", "seconds", "(10⁶)² = 10¹²", "divide it by 10⁶"),
    _time(1e-12, "seconds", "microseconds", "(10⁶)² = 10¹²", "multiply it by 10⁶"),
    Cause(1e-4, "inertia", "M and M2 are probably in kg·cm²", "1 kg·cm² is 10⁻⁴ kg·m²",
          "Set the unit of the entered M and M2 to kg·cm², or divide them by 10⁴ in study.toml"),
)  # fmt: skip
"""Wrong units by their factor."""
SUBTLE = (np.sqrt(0.5), np.sqrt(2))
"""Factors that wrong inertias may also cause."""
OTHER_CAUSES = {
    1e-3: "M and M2 seem to be in g·m²",
    1e-6: "The position of all joints seems to be in µrad",
}
"""Alternative cause of a factor that is the same in all joints."""


def known_cause(factor: float, close: float) -> Cause | None:
    """Wrong unit of a position or torque behind a factor of either sign."""
    near = (c for c in CAUSES if not c.is_common and abs(np.log(abs(factor) / c.factor)) < np.log(close))
    return next(near, None)
