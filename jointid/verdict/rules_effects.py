"""Rule of the verdict on deviations from the ideal model that are fitted along with K and D."""

from __future__ import annotations

from collections.abc import Iterator

from jointid.answer import EFFECT_PARAMETERS, effect_values
from jointid.rounding import with_error
from jointid.verdict.evidence import Evidence, Finding, note

_REMEDIES = {
    "arm_viscous": ("There is viscous friction at the arm", ""),
    "arm_coulomb": ("There is Coulomb friction at the arm", ""),
    "loss_factor": (
        "The gears have structural damping",
        "D holds the viscous part only. K is the stiffness at the mean frequency of the records, on a "
        "logarithmic scale; it rises with frequency.",
    ),
    "lag": ("The torques lag, each by a time of its own", "Check when each drive samples and acts."),
    "position_filter": (
        "The positions are filtered",
        "Log unfiltered positions if the drive allows it.",
    ),
    "torque_filter": (
        "The torques are filtered",
        "Log the torque set point, or the current without a filter, if the drive allows it.",
    ),
    "motor_presliding": ("The motors' friction has a presliding part", ""),
    "link": (
        "The links bend above the band",
        "K and D hold for the gears alone; a controller for higher frequencies needs the links as well.",
    ),
    "gravity": ("Gravity acts as a spring at the arm", ""),
    "cubic": (
        "A gear hardens or softens",
        "K holds for small deflections. Measure at the amplitude that the work needs.",
    ),
    "piecewise": (
        "A gear has three slopes",
        "K holds for small deflections. Measure at the amplitude that the work needs.",
    ),
    "backlash": ("A gear has backlash", "K holds outside the play. Check the gear's preload."),
    "hysteresis": ("A gear has hysteresis", "K is the spring without its hysteresis."),
}
"""Title and remedy by effect, that is by its first parameter."""


def effects_found(evidence: Evidence) -> Iterator[Finding]:
    """Every effect that the chosen model has, with its size."""
    for name, (sizes, errors) in effect_values(evidence.fit).items():
        if name not in _REMEDIES:
            continue
        label, unit = EFFECT_PARAMETERS[name]
        values = ", ".join(
            f"{with_error(float(size), float(error))} (joint {j})"
            for j, (size, error) in enumerate(zip(sizes, errors, strict=True), start=1)
        )
        title, remedy = _REMEDIES[name]
        detail = f"{label[:1].upper()}{label[1:]}: {values} {unit}".rstrip()
        yield note(title, f"{detail}. The answer accounts for it.", remedy, 0.01)
