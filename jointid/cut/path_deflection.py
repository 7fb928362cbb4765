"""Tool deflection of a study's own robot along the paper's rectangle, from K and the robot model.

The joints follow the path without correction: the gears wind up by C u/K under the torque u = Cᵀτ of
gravity and inertia, and the tool moves by J C u/K. A servo that assumes K̂ leaves u/K − u/K̂. The path is
slow against the resonances here: their vibration is left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jointid.analysis import Analysis
from jointid.arrays import Floats
from jointid.cut.outcome import millimetres
from jointid.cut.rectangle import rectangle
from jointid.cut.toolpath import Toolpath
from jointid.errors import JointIdError
from jointid.robot_models.model import RobotModel

COLUMNS_MEANING = (
    "Servo: the K that it assumes; rigid: no compensation. From inertia, from gravity: parts of the "
    "deflection with the rigid servo."
)
COLUMNS = {
    "assumed_m": "servo: nominal K",
    "identified_m": "servo: identified K (95th percentile)",
    "rigid_m": "servo: rigid",
    "inertia_m": "from inertia",
    "gravity_m": "from gravity",
    "sag_m": "sag at start",
}
"""Columns of the table by their quantity, the answer first."""
_STEP_S = 0.004
_ROUNDS = 3
_NEAR_M = 1e-6
_DRAWS = 400


@dataclass(frozen=True, eq=False)
class PathDeflection:
    """Largest deflections of the tool along one path, m."""

    sag_m: float
    """Deflection by gravity at the start, taught with the path."""
    gravity_m: float
    """Change of the deflection by gravity along the path."""
    inertia_m: float
    """By the accelerations."""
    rigid_m: float
    """Both together: a servo that assumes rigid joints."""
    assumed_m: float | None
    """With a servo that assumes the study's nominal K; None without."""
    identified_m: float
    """With a servo that assumes the identified K: 95th percentile."""
    reference_m: Floats
    """The path, horizontal, shape (k, 2)."""
    before_error_m: Floats
    """Deflection from the start with the nominal K, or with a rigid servo without one, (k, 3)."""
    after_error_m: Floats
    """The same with the identified K, of the robot at the 95th percentile."""

    @property
    def before_m(self) -> float:
        """With the nominal K, or with a rigid servo without one."""
        return self.rigid_m if self.assumed_m is None else self.assumed_m


@dataclass(frozen=True, eq=False)
class JointPath:
    """Joint motion along a path, k samples, n joints."""

    lever: Floats
    """Tool motion over motor motion J C, shape (k, 3, n), m/rad."""
    gravity: Floats
    """Torque at the motors at rest, shape (k, n), N·m."""
    inertia: Floats
    """Torque at the motors by the motion, shape (k, n), N·m."""

    def deflection(self, torque: Floats, compliance: Floats) -> Floats:
        """Tool deflection, shape (..., k, 3), m, of compliances (..., n), rad/(N·m)."""
        return np.asarray(np.einsum("kdn,kn,...n->...kd", self.lever, torque, compliance))

    def error(self, torque: Floats, compliance: Floats) -> Floats:
        """Deflection relative to that at the start, shape (..., k, 3), m."""
        moved = self.deflection(torque, compliance)
        return np.asarray(moved - moved[..., :1, :])

    def change(self, torque: Floats, compliance: Floats) -> Floats:
        """Largest distance of the deflection from that at the start, shape (...), m."""
        return np.asarray(np.linalg.norm(self.error(torque, compliance), axis=-1).max(axis=-1))


def own_path_deflections(analysis: Analysis, zones_m: Sequence[float]) -> list[PathDeflection]:
    """Deflections of the study's robot along rectangles with these corner zones.

    Raises JointIdError when the answer is not usable, the study has no robot model with a pose, or the
    robot does not reach the path.
    """
    analysis.require_usable()
    study, fit = analysis.study, analysis.fit
    if not has_own_path(analysis) or study.robot_model is None:
        raise JointIdError("The study has no robot model with joint angles: give [robot_model].")
    robot, q = study.robot_model, next(iter(study.pose_angles_rad.values()))
    covariance, draws = fit.covariance[: fit.n, : fit.n], np.zeros(1)
    if np.isfinite(covariance).all():
        draws = np.random.default_rng(0).multivariate_normal(fit.K, covariance, _DRAWS)
    if np.any(draws <= 0):
        raise JointIdError("K is too uncertain for a deflection: resolve the findings first.")
    found = []
    for zone in zones_m:
        toolpath = rectangle(zone_m=zone, centre_m=(0.0, 0.0))
        path = joint_path(robot, q, toolpath)
        both, compliance = path.gravity + path.inertia, 1 / fit.K
        sag = float(np.linalg.norm(path.deflection(path.gravity, compliance)[0]))
        assumed, before = None, compliance
        if study.nominal is not None:
            before = compliance - 1 / study.nominal.K
            assumed = float(path.change(both, before))
        gravity, inertia, rigid = (
            float(path.change(torque, compliance)) for torque in (path.gravity, path.inertia, both)
        )
        after = 1 / draws - compliance
        drawn = path.change(both, after)
        identified = float(np.quantile(drawn, 0.95))
        near = after[np.argmin(np.abs(drawn - identified))]
        found.append(
            PathDeflection(
                sag,
                gravity,
                inertia,
                rigid,
                assumed,
                identified,
                toolpath.position(_times(toolpath)),
                path.error(both, before),
                path.error(both, near),
            )
        )
    return found


def rows_of(
    zones_mm: Sequence[float], found: Sequence[PathDeflection]
) -> tuple[list[str], list[list[str]]]:
    """Header and cells of the table of deflections."""
    rows = [
        [
            f"{zone:g} mm",
            *("–" if (x := getattr(each, name)) is None else millimetres(x) for name in COLUMNS),
        ]
        for zone, each in zip(zones_mm, found, strict=True)
    ]
    return ["corner zone", *COLUMNS.values()], rows


def has_own_path(analysis: Analysis) -> bool:
    """Whether the study has a robot model with a pose, and not two joints as the planar arm."""
    study = analysis.study
    return analysis.fit.n != 2 and study.robot_model is not None and bool(study.pose_angles_rad)


def meaning(analysis: Analysis) -> str:
    """Description of the robot and of its deflections."""
    pose = next(iter(analysis.study.pose_angles_rad), "")
    return (
        "The path is the paper's rectangle, horizontal, centred at the tool of the robot in its pose"
        + (f' "{pose}"' if pose else "")
        + ". The gears deflect under gravity and inertia; vibration and process forces are left out. "
        "The sag at the start of the path is taught with the path and is not counted."
    )


def _times(path: Toolpath) -> Floats:
    return np.arange(0.0, path.end_s + _STEP_S, _STEP_S)


def joint_path(robot: RobotModel, q: ArrayLike, path: Toolpath) -> JointPath:
    """Follow a horizontal path about the tool at q, shape (n,), by the shortest joint motion.

    Raises JointIdError when the robot does not reach a point of the path.
    """
    time = _times(path)
    target = np.zeros((time.size, 3))
    target[:, :2] = path.position(time)
    angles, lever = np.empty((time.size, robot.n)), np.empty((time.size, 3, robot.n))
    now = np.array(q, float)
    tool, jacobian = robot.tool_motion(now)
    target += tool
    for k, point in enumerate(target):
        for _ in range(_ROUNDS):
            now = now + np.linalg.pinv(jacobian, rcond=1e-6) @ (point - tool)
            tool, jacobian = robot.tool_motion(now)
        angles[k], lever[k] = now, jacobian @ robot.coupling
        if np.linalg.norm(point - tool) > _NEAR_M:
            raise JointIdError("The tool does not reach the rectangle: choose another pose.")
    velocity = np.gradient(angles, _STEP_S, axis=0)
    still, C = np.zeros_like(angles), robot.coupling
    gravity = robot.torque(angles, still, still)
    moving = robot.torque(angles, velocity, np.gradient(velocity, _STEP_S, axis=0))
    return JointPath(lever, gravity @ C, (moving - gravity) @ C)
