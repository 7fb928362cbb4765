"""Joints whose torque or direction has the wrong sign, by their motor torques."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jointid.arm_side.band_limited import BandLimited
from jointid.arm_side.payload import Shared, Signs, Torques
from jointid.arrays import Floats
from jointid.records import MotionRecord
from jointid.robot_models.model import RobotModel

_DRIVES = -5.0
"""Mean friction along the motion, in its standard deviations, below which the torque has the wrong sign,
unless the model clearly speaks against it; above, the model must clearly speak for it."""
_FLOOR = 0.02
"""Least error of a model, in parts of a torque: no evidence comes from residuals below it."""
_SURELY = 30.0
"""Difference of the costs, twice the logarithm of a ratio of likelihoods, from which a sign is wrong.
The right one gains 46 or more for a last axis, whose torque hardly depends on it, and 500 for others."""


def reversed_joints(
    records: list[MotionRecord], motions: list[BandLimited], robot: RobotModel, torque_std: float
) -> Signs:
    """Find wrong signs of the joints, by friction, which opposes the motion, and by the model's torque.

    A torque that friction would drive is reversed. The direction of a joint is the one whose torques of
    the model explain those of the motors better: by gravity and inertia, also those of other joints.
    Joints that share a motor are tested for their direction only.
    """
    found, each = Signs.right(robot.n), np.eye(robot.n, dtype=bool)
    given, payload = _modelled(records, motions, robot, torque_std)
    for j in np.flatnonzero(~robot.is_coupled).tolist():
        cost, along = _cost(given, payload, j)
        if along < 0:
            better = cost - _cost(_with_torque(given, each[j]), payload, j)[0]
            found.torque[j] = better > (_SURELY if along > _DRIVES else -_SURELY)
    right = _with_torque(given, found.torque)
    least = _whole(right, payload)
    moving = [j for j in range(robot.n) if any(np.ptp(m.q[:, j]) > 0 for m in motions)]
    for _ in moving:  # one after the other, the clearest first
        ways = [found.axis ^ each[j] for j in moving]
        costs = [_whole(*_in_direction(right, robot, torque_std, way)) for way in ways]
        best = int(np.argmin(costs))
        if costs[best] > least - _SURELY:
            break
        least = costs[best]
        found.axis[:] = ways[best]
    return found


def _modelled(
    records: list[MotionRecord], motions: list[BandLimited], robot: RobotModel, torque_std: float
) -> tuple[Torques, list[Floats]]:
    """Torques of motors and model with stiff gears, and the model's changes with the payload."""
    model, payload, parts = _changes(motions, robot, torque_std)
    return Torques.of(records, motions, robot, torque_std, model, parts), payload


def _changes(
    motions: list[BandLimited], robot: RobotModel, torque_std: float
) -> tuple[list[Floats], list[Floats], list[Floats]]:
    changes = [robot.torque_changes(m.q, m.dq, m.ddq) for m in motions]
    model, payload, parts = ([each[k] for each in changes] for k in range(3))
    return model, payload, [torque_std * each for each in parts]


def _in_direction(
    torques: Torques, robot: RobotModel, torque_std: float, turned: NDArray[np.bool_]
) -> tuple[Torques, list[Floats]]:
    """As ``_modelled``, with the directions of some joints changed, mask (n,)."""
    way = np.where(turned, -1.0, 1.0)
    motions = [replace(m, q=m.q * way, dq=m.dq * way, ddq=m.ddq * way) for m in torques.motions]
    model, payload, parts = _changes(motions, robot, torque_std)
    motor, rotor = ([each * way for each in both] for both in (torques.motor, torques.rotor))
    return replace(torques, motions=motions, model=model, parts=parts, motor=motor, rotor=rotor), payload


def _with_torque(torques: Torques, turned: NDArray[np.bool_]) -> Torques:
    """Change the signs of some logged torques, mask (n,)."""
    signs = np.where(turned, -1.0, 1.0)
    pairs = zip(torques.motor, torques.rotor, strict=True)
    return replace(torques, motor=[(motor + rotor) * signs - rotor for motor, rotor in pairs])


def _whole(torques: Torques, payload: list[Floats]) -> float:
    return sum(_cost(torques, payload, j)[0] for j in range(torques.gravity_std.size))


def _cost(torques: Torques, payload: list[Floats], j: int) -> tuple[float, float]:
    """-2 log of the likelihood of a joint's torque and priors; its friction along the motion, in σ."""
    found = torques.fitted(j, Shared(payload, np.zeros(4), np.ones(4)))
    if found is None:
        return 0.0, 0.0
    data, std, fitted = found
    whole = np.mean((data.y + data.columns[:, -7]) ** 2)
    variance = np.mean(data.residual(fitted) ** 2) + _FLOOR**2 * whole
    known = np.isfinite(std) & (std > 0)
    cost = torques.independent(data)[0] * np.log(variance) + np.sum(
        (fitted.beta[known] / std[known]) ** 2
    )
    friction = slice(-5, -1)
    way = np.mean(data.columns[:, -5, None] * data.columns[:, friction], axis=0)
    spread = np.sqrt(way @ fitted.covariance[friction, friction] @ way)
    return float(cost), float(way @ fitted.beta[friction] / max(spread, 1e-300))
