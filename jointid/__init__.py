"""Stiffness and damping of elastic robot joints, and what knowing them is worth in millimetres."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from jointid.elasticity import ElasticityFit, Friction, identify_elasticity
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
from jointid.spring_equations import spring_equations
from jointid.study import Analysis, Study, analyse
from jointid.transfer_matrix import (
    TransferMatrix,
    estimate_transfer_matrix,
    single_record_response,
)
from jointid.verdict.findings import Finding

if TYPE_CHECKING:
    from jointid.closed_loop import simulate_records
    from jointid.cut.arm import PlanarArm
    from jointid.cut.toolpath import rectangle
    from jointid.cut.tracking import TrackingRun, track
    from jointid.experiment import Controller, Excitation, Measurement, MotorFriction
    from jointid.study_files import load_study
    from jointid.study_saving import save_study

__all__ = [
    "Analysis",
    "Controller",
    "Elasticity",
    "ElasticityFit",
    "Excitation",
    "Finding",
    "Friction",
    "Inertia",
    "JointIdError",
    "Measurement",
    "MotorFriction",
    "Phasors",
    "PlanarArm",
    "SineRecord",
    "Study",
    "TrackingRun",
    "TransferMatrix",
    "analyse",
    "diagonal_zeros",
    "estimate_transfer_matrix",
    "extract_phasors",
    "identify_elasticity",
    "load_study",
    "locked_motor_response",
    "locked_resonances",
    "motor_response",
    "rectangle",
    "resonances",
    "save_study",
    "simulate_records",
    "single_record_response",
    "spring_equations",
    "track",
]

# What needs pandas, pymunk or more of SciPy is imported when it is first asked for.
_HOMES = {
    "Controller": "experiment",
    "Excitation": "experiment",
    "Measurement": "experiment",
    "MotorFriction": "experiment",
    "PlanarArm": "cut.arm",
    "TrackingRun": "cut.tracking",
    "load_study": "study_files",
    "rectangle": "cut.toolpath",
    "save_study": "study_saving",
    "simulate_records": "closed_loop",
    "track": "cut.tracking",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'jointid' has no attribute {name!r}")
    return getattr(import_module(f"jointid.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
