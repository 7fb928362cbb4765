"""Compliance of the tool point: how far a force moves the tool while the motors hold their angles.

A force F at the tool turns the motors' side of the gears by x with (K + G) x = Cᵀ Jᵀ F, where J is the
tool's Jacobian, C the gears (joint = C · motor) and G the gravity stiffness; the tool then moves by
J C x. With C = 1/N, the compliance J (N²K)⁻¹ Jᵀ is that of the stiffness at the joints.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array, vectors
from jointid.cut.arm import PlanarArm
from jointid.joints import Elasticity, Inertia, locked_resonances
from jointid.robot_models.model import RobotModel


@dataclass(frozen=True, eq=False)
class ToolStiffness:
    """Compliance of the tool point in one pose; d = 2 or 3 directions, world axes."""

    compliance: Floats
    """Tool deflection over force, shape (d, d), m/N."""
    resonances_hz: Floats
    """Undamped natural frequencies with the motors locked, shape (n,), Hz."""
    lever: Floats
    """Tool motion over motor motion J C, shape (d, n), m/rad."""
    stiffness: Floats
    """diag(K) + G, shape (n, n), N·m/rad."""

    def deflection(self, force_N: ArrayLike) -> Floats:
        """Tool deflection under forces of shape (..., d), m; JointIdError for other components."""
        return np.asarray(vectors("force_N", force_N, len(self.compliance)) @ self.compliance)

    @property
    def principal(self) -> tuple[Floats, Floats]:
        """Compliances, m/N, largest first, shape (d,), and their directions as rows, shape (d, d).

        A force along such a direction moves the tool along it.
        """
        values, vectors = np.linalg.eigh(self.compliance)
        directions = vectors.T[::-1]
        largest = np.argmax(np.abs(directions), axis=1)[:, None]
        return values[::-1], directions * np.sign(np.take_along_axis(directions, largest, 1))

    def standard_error(self, covariance: ArrayLike) -> Floats:
        """Standard error of each principal compliance, shape (d,), m/N.

        ``covariance`` is that of K, shape (n, n), (N·m/rad)².
        """
        by_joint = np.linalg.solve(self.stiffness, (self.principal[1] @ self.lever).T).T
        slope = by_joint**2  # of uᵀ J C (K + G)⁻¹ Cᵀ Jᵀ u by K_j, with a minus sign
        variance = np.einsum("di,ij,dj->d", slope, finite_array("covariance", covariance, ndim=2), slope)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def tool_stiffness(robot: RobotModel, q: ArrayLike, elasticity: Elasticity) -> ToolStiffness:
    """Compliance of a robot's tool point at joint angles q, shape (n,), rad; d = 3.

    ``elasticity`` is motor side. Raises JointIdError when the numbers of joints differ, or gear ratios
    or rotor inertias are unknown.
    """
    inertia = robot.inertia(q)
    return _compliance(robot.tool_motion(q)[1] @ robot.coupling, inertia, elasticity)


def planar_tool_stiffness(arm: PlanarArm, q: ArrayLike, elasticity: Elasticity) -> ToolStiffness:
    """Compliance of the planar arm's tool in its plane at joint angles q, shape (2,), rad; d = 2."""
    return _compliance(arm.jacobian(q) / arm.gear_ratio, arm.inertia(q), elasticity)


def _compliance(lever: Floats, inertia: Inertia, elasticity: Elasticity) -> ToolStiffness:
    frequencies = locked_resonances(inertia, elasticity)  # refuses other numbers of joints
    stiffness = np.diag(elasticity.K) + inertia.gravity
    compliance = lever @ np.linalg.solve(stiffness, lever.T)
    return ToolStiffness((compliance + compliance.T) / 2, frequencies, lever, stiffness)
