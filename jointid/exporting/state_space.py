"""The identified model as a state space, and the measured H as frequency response data.

Inputs are the motor torques, outputs the motor accelerations, velocities or positions, all motor side.
Equation (1), with the spring deflections x = q − q_a and the spring torque Kx + Dẋ:

    M q̈ = τ − Kx − Dẋ            ẍ = M⁻¹τ − (M⁻¹ + M2⁻¹)(Kx + Dẋ)

The motor acceleration needs only the 2n states x, ẋ, and its response is finite at ω = 0. Velocity adds
the n states q̇, position also q.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.joints import Elasticity, Inertia, require_same_joints
from jointid.transfer_matrix import TransferMatrix

if TYPE_CHECKING:
    from scipy.signal import StateSpace

Output = Literal["acceleration", "velocity", "position"]

_SIGNALS = {
    "acceleration": ("ddtheta_m", "rad/s²"),
    "velocity": ("dtheta_m", "rad/s"),
    "position": ("theta_m", "rad"),
}
"""Symbol and unit of each output; each is the integral of the one before."""


@dataclass(frozen=True, eq=False)
class StateSpaceModel:
    """ż = Az + Bτ, y = Cz + Dτ with named signals; motor side, SI units."""

    A: Floats
    """Shape (s, s)."""
    B: Floats
    """Shape (s, n)."""
    C: Floats
    """Shape (n, s)."""
    D: Floats
    """Direct feedthrough, shape (n, n); not the damping."""
    states: tuple[str, ...]
    """x1 ... deflections q − q_a (rad), dx1 ... their rates (rad/s); then dtheta_m1 ..., theta_m1 ..."""
    inputs: tuple[str, ...]
    """tau_m1 ... tau_mn, N·m."""
    outputs: tuple[str, ...]
    """ddtheta_m1 ..., dtheta_m1 ... or theta_m1 ..."""
    unit: str
    """Unit of the outputs."""


def state_space(
    inertia: Inertia, elasticity: Elasticity, *, output: Output = "acceleration"
) -> StateSpaceModel:
    """Return the state space from motor torques to motor motion of a model of n joints.

    The output "acceleration" gives H of equation (16), with 2n states; "velocity" has 3n, "position" 4n.
    Raises JointIdError when the numbers of joints differ, or the output is not known.
    """
    if output not in get_args(Output):
        raise JointIdError(f'output = "{output}": expected one of {", ".join(get_args(Output))}.')
    require_same_joints(inertia, elasticity)
    n = inertia.n
    eye, none = np.eye(n), np.zeros((n, n))
    motor = np.diag(1 / inertia.M)
    spring = np.hstack([np.diag(elasticity.K), np.diag(elasticity.D)])  # torque from (x, ẋ)
    acceleration = -motor @ spring
    A = np.vstack([np.hstack([none, eye]), -(motor + np.linalg.inv(inertia.M2)) @ spring])
    B = np.vstack([none, motor])
    states = [f"{name}{j + 1}" for name in ("x", "dx") for j in range(n)]
    C, D = acceleration, motor
    outputs = list(_SIGNALS)
    for level in outputs[1 : outputs.index(output) + 1]:
        A = np.block([[A, np.zeros((len(A), n))], [C, np.zeros((n, n))]])
        B = np.vstack([B, D])
        C, D = np.hstack([np.zeros((n, len(A) - n)), eye]), none
        states += [f"{_SIGNALS[level][0]}{j + 1}" for j in range(n)]
    return StateSpaceModel(
        A=A,
        B=B,
        C=C,
        D=D,
        states=tuple(states),
        inputs=tuple(f"tau_m{j + 1}" for j in range(n)),
        outputs=tuple(f"{_SIGNALS[output][0]}{j + 1}" for j in range(n)),
        unit=_SIGNALS[output][1],
    )


def scipy_state_space(
    inertia: Inertia, elasticity: Elasticity, *, output: Output = "acceleration"
) -> StateSpace:
    """Return the model as a continuous ``scipy.signal.StateSpace``; parameters as in ``state_space``."""
    from scipy.signal import StateSpace

    model = state_space(inertia, elasticity, output=output)
    return StateSpace(model.A, model.B, model.C, model.D)


def control_state_space(
    inertia: Inertia, elasticity: Elasticity, *, output: Output = "acceleration", name: str = "robot"
) -> Any:
    """Return the model as a ``control.StateSpace`` of python-control, its signals and itself named.

    Parameters as in ``state_space``. Raises JointIdError when python-control is not installed.
    """
    control = _python_control()
    model = state_space(inertia, elasticity, output=output)
    signals = {key: list(getattr(model, key)) for key in ("states", "inputs", "outputs")}
    return control.ss(model.A, model.B, model.C, model.D, name=name, **signals)


def control_frd(matrix: TransferMatrix, *, name: str = "measured") -> Any:
    """Return the measured H as ``control.FrequencyResponseData`` of python-control.

    ``matrix`` is motor acceleration over motor torque, equations (16)-(18), 1/(kg·m²). Raises
    JointIdError when python-control is not installed.
    """
    control = _python_control()
    n = matrix.H.shape[1]
    return control.frd(
        np.moveaxis(matrix.H, 0, -1),
        matrix.omega,
        name=name,
        inputs=[f"tau_m{j + 1}" for j in range(n)],
        outputs=[f"ddtheta_m{j + 1}" for j in range(n)],
    )


def _python_control() -> Any:
    try:
        return import_module("control")
    except ImportError as error:
        raise JointIdError(
            "This needs the package python-control, which is not installed: pip install jointid[control]"
        ) from error
