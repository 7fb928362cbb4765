"""The identified model as a state space, and the measured H as frequency response data.

Inputs are the motor torques, outputs the motor accelerations, all motor side. Equation (1), with the
spring deflections x = q − q_a and the spring torque Kx + Dẋ:

    M q̈ = τ − Kx − Dẋ            ẍ = M⁻¹τ − (M⁻¹ + M2⁻¹)(Kx + Dẋ)

The motor acceleration needs only the 2n states x, ẋ, and its response is finite at ω = 0.
"""

from typing import Any, NamedTuple

import numpy as np

from jointid.arrays import Floats
from jointid.errors import import_optional
from jointid.joints import Elasticity, Inertia, require_same_joints
from jointid.transfer_matrix import TransferMatrix

_CONTROL = ("control", "control", "Models for python-control", "control")


class StateSpaceModel(NamedTuple):
    """ż = Az + Bτ, y = Cz + Dτ; motor side, SI units."""

    A: Floats
    """Shape (2n, 2n); the states are x1 ... xn (rad), then their rates."""
    B: Floats
    """Shape (2n, n)."""
    C: Floats
    """Shape (n, 2n)."""
    D: Floats
    """Direct feedthrough, shape (n, n); not the damping."""


def state_space(inertia: Inertia, elasticity: Elasticity) -> StateSpaceModel:
    """Return H of equation (16), motor torques to motor accelerations, as a state space.

    Raises JointIdError when the numbers of joints differ.
    """
    require_same_joints(inertia, elasticity)
    eye, none, motor = np.eye(inertia.n), np.zeros((inertia.n, inertia.n)), np.diag(1 / inertia.M)
    spring = np.hstack([np.diag(elasticity.K), np.diag(elasticity.D)])  # torque from (x, ẋ)
    A = np.vstack([np.hstack([none, eye]), -(motor + np.linalg.inv(inertia.M2)) @ spring])
    return StateSpaceModel(A, np.vstack([none, motor]), -motor @ spring, motor)


def control_state_space(inertia: Inertia, elasticity: Elasticity) -> Any:
    """Return the model of ``state_space`` as a ``control.StateSpace`` with named signals.

    Raises JointIdError when the numbers of joints differ, or python-control is not installed.
    """
    control, n = import_optional(*_CONTROL), inertia.n
    states = [f"{name}{j + 1}" for name in ("x", "dx") for j in range(n)]
    model = state_space(inertia, elasticity)
    return control.ss(*model, name="robot", states=states, **_signals(n))


def control_frd(matrix: TransferMatrix) -> Any:
    """Return the measured H as ``control.FrequencyResponseData`` of python-control.

    ``matrix`` is motor acceleration over motor torque, equations (16)-(18), 1/(kg·m²). Raises
    JointIdError when python-control is not installed.
    """
    H = np.moveaxis(matrix.H, 0, -1)
    return import_optional(*_CONTROL).frd(H, matrix.omega, name="measured", **_signals(len(H)))


def _signals(n: int) -> dict[str, list[str]]:
    """Names of the inputs, N·m, and outputs, rad/s²."""
    names = {"inputs": "tau_m", "outputs": "ddtheta_m"}
    return {kind: [f"{name}{j + 1}" for j in range(n)] for kind, name in names.items()}
