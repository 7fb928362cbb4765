"""Stiffness and damping of elastic robot joints, and what knowing them is worth in millimetres."""

from jointid.errors import JointIdError
from jointid.joints import (
    Elasticity,
    Inertia,
    diagonal_zeros,
    locked_motor_response,
    locked_resonances,
    motor_response,
    resonances,
)
from jointid.records import SineRecord
from jointid.study import Study

__all__ = [
    "Elasticity",
    "Inertia",
    "JointIdError",
    "SineRecord",
    "Study",
    "diagonal_zeros",
    "locked_motor_response",
    "locked_resonances",
    "motor_response",
    "resonances",
]
