"""Deviations of real robots from equation (1) that take one number per joint."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Effect:
    """One effect; its parameter is zero on an ideal robot."""

    label: str
    """Label of the parameter, without the joint's number."""
    unit: str
    name: str
    """Name in the description of a model and in the verdict."""


EFFECTS = {
    "arm_viscous": Effect("arm-side viscous friction", "N·m·s/rad", "arm-side viscous friction"),
    "loss_factor": Effect("loss factor", "", "structural damping"),
    "lag": Effect("lag", "s", "a lag per joint"),
    "position_filter": Effect("position filter", "s", "a position filter"),
    "link": Effect("link flexibility", "kg·m²·s²", "link flexibility"),
    "gravity": Effect("gravity stiffness", "N·m/rad", "gravity stiffness"),
}
"""By parameter block. With s = iω, ``arm_viscous`` v and ``gravity`` G add sv + G to the arm's dynamic
stiffness, ``link`` c adds −s⁴c (the first term of a mode above the band, c = J_link/ω_link²),
``loss_factor`` η adds iηK to the gear's, ``lag`` d multiplies a joint's torque by e^{-sd}, and
``position_filter`` T its position by 1 + sT."""

ARM_EFFECTS = ("arm_viscous", "link", "gravity")
"""Effects on the arm's dynamic stiffness."""
