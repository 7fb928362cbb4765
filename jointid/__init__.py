"""Stiffness and damping of elastic robot joints, and what knowing them is worth in millimetres."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jointid.cut.arm import PlanarArm
    from jointid.cut.rectangle import rectangle
    from jointid.cut.tracking import TrackingRun, track
    from jointid.errors import JointIdError
    from jointid.estimation.elasticity import ElasticityFit, Friction, identify_elasticity
    from jointid.estimation.joint_equations import spring_equations
    from jointid.files.study_files import load_study
    from jointid.files.study_saving import save_study
    from jointid.joints import (
        Elasticity,
        Inertia,
        diagonal_zeros,
        locked_motor_response,
        locked_resonances,
        motor_response,
        resonances,
    )
    from jointid.phasors.extract import Phasors, extract_phasors
    from jointid.records import SineRecord
    from jointid.simulation.closed_loop import simulate_records
    from jointid.simulation.experiment import Controller, Excitation, Measurement, MotorFriction
    from jointid.study import Analysis, Study, analyse
    from jointid.transfer_matrix import (
        TransferMatrix,
        estimate_transfer_matrix,
        single_record_response,
    )
    from jointid.verdict.findings import Finding

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

# Each name is imported when it is first asked for: who wants the phasors need not load the optimiser,
# pandas or pymunk.
_HOMES = {
    "Analysis": "study",
    "Controller": "simulation.experiment",
    "Elasticity": "joints",
    "ElasticityFit": "estimation.elasticity",
    "Excitation": "simulation.experiment",
    "Finding": "verdict.findings",
    "Friction": "estimation.elasticity",
    "Inertia": "joints",
    "JointIdError": "errors",
    "Measurement": "simulation.experiment",
    "MotorFriction": "simulation.experiment",
    "Phasors": "phasors.extract",
    "PlanarArm": "cut.arm",
    "SineRecord": "records",
    "Study": "study",
    "TrackingRun": "cut.tracking",
    "TransferMatrix": "transfer_matrix",
    "analyse": "study",
    "diagonal_zeros": "joints",
    "estimate_transfer_matrix": "transfer_matrix",
    "extract_phasors": "phasors.extract",
    "identify_elasticity": "estimation.elasticity",
    "load_study": "files.study_files",
    "locked_motor_response": "joints",
    "locked_resonances": "joints",
    "motor_response": "joints",
    "rectangle": "cut.rectangle",
    "resonances": "joints",
    "save_study": "files.study_saving",
    "simulate_records": "simulation.closed_loop",
    "single_record_response": "transfer_matrix",
    "spring_equations": "estimation.joint_equations",
    "track": "cut.tracking",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'jointid' has no attribute {name!r}")
    value = getattr(import_module(f"jointid.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
