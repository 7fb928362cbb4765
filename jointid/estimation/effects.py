"""Deviations of real robots from equation (1), each of one or two numbers per joint."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Effect:
    """One effect; its first parameter is zero on an ideal robot."""

    name: str
    """Name in the description of a model and in the verdict."""
    parameters: dict[str, tuple[str, str]]
    """Label, without the joint's number, and unit of each block of parameters."""
    positive: bool = False
    """Whether the first parameter cannot be negative: friction and damping take energy, masses are."""


EFFECTS = {
    "arm_viscous": Effect(
        "arm-side viscous friction",
        {"arm_viscous": ("arm-side viscous friction", "N·m·s/rad")},
        positive=True,
    ),
    "arm_coulomb": Effect(
        "arm-side Coulomb friction",
        {"arm_coulomb": ("arm-side Coulomb friction", "N·m")},
        positive=True,
    ),
    "loss_factor": Effect("structural damping", {"loss_factor": ("loss factor", "")}, positive=True),
    "lag": Effect("a lag per joint", {"lag": ("lag", "s")}),
    "position_filter": Effect("a position filter", {"position_filter": ("position filter", "s")}),
    "torque_filter": Effect("a torque filter", {"torque_filter": ("torque filter", "s")}),
    "motor_presliding": Effect(
        "presliding friction",
        {
            "motor_presliding": ("presliding friction", "N·m"),
            "bristle": ("presliding angle", "rad"),
        },
        positive=True,
    ),
    "link": Effect("link flexibility", {"link": ("link flexibility", "kg·m²·s²")}, positive=True),
    "gravity": Effect("gravity stiffness", {"gravity": ("gravity stiffness", "N·m/rad")}),
    "cubic": Effect("a hardening gear", {"cubic": ("cubic stiffness", "N·m/rad³")}),
    "piecewise": Effect(
        "a gear with three slopes",
        {
            "piecewise": ("change of slope at T1", "N·m/rad"),
            "knee": ("wind-up at T1", "rad"),
            "second_bend": ("change of slope at T2", "N·m/rad"),
            "second_knee": ("wind-up from T1 to T2", "rad"),
        },
    ),
    "backlash": Effect("backlash", {"backlash": ("backlash", "rad")}, positive=True),
    "hysteresis": Effect(
        "gear hysteresis",
        {
            "hysteresis": ("hysteresis", "N·m"),
            "presliding": ("presliding deflection", "rad"),
        },
        positive=True,
    ),
}
"""By key. With s = iω, ``arm_viscous`` v and ``gravity`` G add sv + G to the arm's dynamic stiffness,
and ``link`` c adds −s⁴c (the first term of a mode above the band, c = J_link/ω_link²); ``loss_factor``
η adds iηK, and the stiffness that comes with it, to the gear's. ``lag`` d multiplies a joint's torque
by e^{-sd}, ``torque_filter`` T by 1/(1 + sT), or by 1 − sT where T is negative, and
``position_filter`` T its position by 1 + sT. The others are laws in time (``joint_laws``)."""

ARM_EFFECTS = ("arm_viscous", "link", "gravity")
"""Effects on the arm's dynamic stiffness."""

GEAR_LAWS = ("cubic", "piecewise", "backlash", "hysteresis")
"""Nonlinear laws of the gear."""

LAWS = (*GEAR_LAWS, "arm_coulomb", "motor_presliding")
"""All nonlinear laws."""
