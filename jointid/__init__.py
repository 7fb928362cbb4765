"""Stiffness and damping of elastic robot joints, and what knowing them is worth in millimetres."""

from jointid.elasticity import ElasticityFit, Friction, identify_elasticity, spring_equations
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
from jointid.phasors import Phasors, extract_phasors
from jointid.records import SineRecord
from jointid.study import Analysis, Study, analyse
from jointid.transfer_matrix import (
    TransferMatrix,
    estimate_transfer_matrix,
    single_record_response,
)
from jointid.verdict import Finding

__all__ = [
    "Analysis",
    "Elasticity",
    "ElasticityFit",
    "Finding",
    "Friction",
    "Inertia",
    "JointIdError",
    "Phasors",
    "SineRecord",
    "Study",
    "TransferMatrix",
    "analyse",
    "diagonal_zeros",
    "estimate_transfer_matrix",
    "extract_phasors",
    "identify_elasticity",
    "locked_motor_response",
    "locked_resonances",
    "motor_response",
    "resonances",
    "single_record_response",
    "spring_equations",
]
