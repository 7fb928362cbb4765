"""Units in their usual spellings, with their factors to SI."""

import re

import numpy as np

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
"""Seconds per unit; "samples" needs a rate instead."""
SAMPLES = "samples"

ANGLE_UNITS = {
    "rad": 1.0,
    "mrad": 1e-3,
    "deg": np.pi / 180,
    "rev": 2 * np.pi,
    "counts": 2 * np.pi,  # over counts per turn
    "V": np.pi / 180,  # times degrees per volt
}
"""Radians per unit; for "counts" and "V" with the scale of ``POSITION_SCALES``."""

TORQUE_UNITS = {
    "N·m": 1.0,
    "mN·m": 1e-3,
    "kN·m": 1e3,
    "A": 1.0,  # times torque constant
    "mA": 1e-3,
    "%": 1e-2,  # of rated torque
    "‰": 1e-3,
    "V": 1.0,  # times N·m per volt
}
"""Newton metres per unit; for all but the first three with the scale of ``TORQUE_SCALES``."""

POSITION_SCALES = {"counts": "counts per turn", "V": "degrees per volt"}
"""Meaning of the scale of a position, by unit; other units have none."""
TORQUE_SCALES = {
    "A": "torque constant, N·m/A",
    "mA": "torque constant, N·m/A",
    "%": "rated torque, N·m",
    "‰": "rated torque, N·m",
    "V": "N·m per volt",
}
"""Meaning of the scale of a torque, by unit; other units have none."""

QUANTITIES = {"position": (ANGLE_UNITS, POSITION_SCALES), "torque": (TORQUE_UNITS, TORQUE_SCALES)}
"""Units and scales of the two channels of a joint."""

_SPELLINGS = {
    "s": "s sec secs second seconds sek sekunde sekunden seconde secondes segundos secondi",
    "ms": "ms msec msek millis millisecond milliseconds millisekunde millisekunden",
    "µs": "µs us usec µsec microsecond microseconds mikrosekunde mikrosekunden",
    "ns": "ns nsec nanosecond nanoseconds nanosec nanosekunden",
    "samples": "sample samples takt takte cycle cycles zyklus zyklen tick",
    "rad": "rad radian radians radiant bogenmaß",
    "mrad": "mrad",
    "deg": "deg ° degs degree degrees grad grd degré degrés grados gradi °deg",
    "rev": "rev revs revolution revolutions turn turns u umdr umdrehung umdrehungen tr tours r",
    "counts": "count counts cnt cnts inc incs incr increment increments ink inkr inkremente inkrement "
    "ticks pulse pulses puls pls impulse imp lsb digit digits",
    "N·m": "nm n·m n*m n.m n-m newtonmeter newtonmeters newtonmetre newtonmetres newton-meter",
    "mN·m": "mnm mn·m mn*m mn.m",
    "kN·m": "knm kn·m kn*m kn.m",
    "A": "a amp amps ampere amperes arms aeff apk",
    "mA": "ma milliamp milliampere",
    "%": "% percent prozent pct",
    "‰": "‰ permille promille",
    "V": "v volt volts",
    "deg/s": "dps deg/s °/s deg/sec grad/s degrees/s deg/sek",
    "rad/s": "rads radps rad/s rad/sec 1/s rad·s-1",
    "rpm": "rpm u/min 1/min min-1 umin rev/min r/min",
    "m": "m meter metre",
    "mm": "mm",
    "N": "n newton",
    "°C": "°c degc",
    "Hz": "hz",
    "W": "w watt kw",
}
_CANONICAL = {spelling: unit for unit, line in _SPELLINGS.items() for spelling in line.split()}
_IN_NAMES = {  # accepted as the last word of a name without brackets; "a", "u" or "n" are ambiguous
    "s", "sec", "ms", "us", "µs", "ns", "rad", "mrad", "deg", "grad", "degrees", "counts", "ticks",
    "inc", "incr", "nm", "mnm", "knm", "amps", "ma", "percent", "prozent", "pct", "volt", "volts", "rpm",
    "°", "v", "rads", "degs", "radps", "dps",
}  # fmt: skip
_LONGEST = 256
"""Characters of a name that are read: searches for its end take their square."""
_BRACKETS = re.compile(r"\s*[\[({<]\s*([^\[\](){}<>]{0,24}?)\s*[\])}>]\s*$")
_LAST_WORD = re.compile(r"(?:^|[\s_./,-]+)([^\s_./,\-]+)$")


def unit_of(text: str) -> str:
    """Return the unit that a text names, in the spelling of this module, or ""."""
    plain = re.sub(r"\s+", "", text.replace("μ", "µ").replace("⋅", "·")).strip("[](){}<>")
    return "" if plain == "n" else _CANONICAL.get(plain.lower(), "")


def split_unit(name: str) -> tuple[str, str]:
    """Split a column's name from its unit: "Zeit [ms]", "torque (Nm)", "angle_deg", "t in s"; or ""."""
    name = name.strip()[:_LONGEST]
    bracket = _BRACKETS.search(name)
    if bracket:
        unit = unit_of(bracket[1])
        return (name[: bracket.start()].strip() or name, unit) if unit else (name, "")
    word = _LAST_WORD.search(name)
    # A letter may be the name of an axis or signal: "S", "v"; a unit has its own case.
    if (
        word
        and (len(word[1]) > 1 or (word.start() > 0 and word[1] in ("s", "V", "°")))
        and (word[1].lower() in _IN_NAMES)
    ):
        unit = "deg/s" if word[1].lower() == "degs" else unit_of(word[1])
        # "vel_rad_s", "speed deg/s": the s belongs to a quotient.
        before = _LAST_WORD.search(name[: word.start()])
        if unit == "s" and before and before[1].lower() in ("rad", "deg", "grad", "°", "m", "mm"):
            quotient = unit_of(f"{before[1]}/s")
            return name[: before.start()] or name, quotient or unit
        bare = re.sub(r"(?:\s+in|[\s_./,-]+)$", "", name[: word.start()]).strip()
        return (bare or name), unit
    return name, ""
