"""Results for other tools, as text or bytes; nothing here writes to disk."""

from jointid.exporting.identification import Identification, Obtained, identification
from jointid.exporting.identification_files import (
    from_json,
    from_toml,
    load_identification,
    to_document,
    to_json,
    to_toml,
)
from jointid.exporting.matlab import to_mat
from jointid.exporting.robot_models import ArmSide, arm_side, mujoco_snippet, sdf_snippet, urdf_snippet
from jointid.exporting.state_space import (
    StateSpaceModel,
    control_frd,
    control_state_space,
    scipy_state_space,
    state_space,
)
from jointid.exporting.tables import phasor_table, transfer_matrix_table

__all__ = [
    "ArmSide",
    "Identification",
    "Obtained",
    "StateSpaceModel",
    "arm_side",
    "control_frd",
    "control_state_space",
    "from_json",
    "from_toml",
    "identification",
    "load_identification",
    "mujoco_snippet",
    "phasor_table",
    "scipy_state_space",
    "sdf_snippet",
    "state_space",
    "to_document",
    "to_json",
    "to_mat",
    "to_toml",
    "transfer_matrix_table",
    "urdf_snippet",
]
