"""Largest path errors of many cuts along one path, vectorised over the cuts."""

from collections.abc import Callable
from typing import TypedDict

import numpy as np

from jointid.arrays import Floats
from jointid.cut.arm import Elbow, PlanarArm
from jointid.cut.arm_simulation import require_resolved
from jointid.cut.feedforward import plan_servo
from jointid.cut.many_arms import ManyArms, run_many
from jointid.cut.servo import MotorFrictionLike, Servo
from jointid.cut.toolpath import Toolpath
from jointid.cut.tracking import substeps_per_sample

_BATCH_RUNS = 512
"""Runs per batch, which keeps the arrays within some hundred megabytes."""
_STRIDE = 32
"""Every so many instants give the lower bound of a run's largest contour error."""


class CutOptions(TypedDict, total=False):
    """Optional arguments of :func:`largest_errors`."""

    servo: Servo | None
    friction: MotorFrictionLike | None
    elbow: Elbow
    dt: float
    progress: Callable[[float], None] | None


def largest_errors(
    arm: PlanarArm,
    toolpath: Toolpath,
    runs: int,
    *,
    true: tuple[Floats, Floats],
    assumed: tuple[Floats, Floats],
    servo: Servo | None = None,
    friction: MotorFrictionLike | None = None,
    elbow: Elbow = "positive",
    dt: float = 5e-4,
    progress: Callable[[float], None] | None = None,
) -> tuple[Floats, Floats]:
    """Simulate one cut with each arm.

    Parameters
    ----------
    arm, toolpath, servo, friction, elbow, dt, progress
        As in :func:`~jointid.cut.tracking.track`.
    runs : int
    true : tuple of ndarray
        K and D of the arms, motor side, shape (2, runs) each, or (2, 1) for equal arms.
    assumed : tuple of ndarray
        K and D that the servo assumes, shape (2, runs) each, or (2,) for equal servos.

    Returns
    -------
    tuple of ndarray, shape (runs,) each
        Largest contour error and largest tracking error of each run, m.

    Raises
    ------
    JointIdError
        As in :func:`~jointid.cut.tracking.track`.
    """
    servo = servo or Servo()
    substeps = substeps_per_sample(servo, dt)
    step = servo.interval_s / substeps
    contour, tracking = np.empty(runs), np.empty(runs)
    for first in range(0, runs, _BATCH_RUNS):
        part = slice(first, min(first + _BATCH_RUNS, runs))
        count = part.stop - part.start
        K, D = (x if x.shape[1] == 1 else x[:, part] for x in true)
        K_assumed, D_assumed = (x if x.ndim == 1 else x[:, part] for x in assumed)
        plan = plan_servo(arm, toolpath, servo, K_assumed, D_assumed, elbow)
        require_resolved(arm, K.max(axis=1), D.max(axis=1), step, plan.start_angle)
        arms = ManyArms(arm, K, D, step, plan.start_angle, count, friction)
        with np.errstate(over="ignore", invalid="ignore"):
            run_many(plan, arms, substeps, _share(progress, part.start / runs, count / runs))
        tool = arm.tool_of_links(np.array([*arms.log, arms.link]).swapaxes(1, 2))
        reference = toolpath.position(np.arange(len(tool)) * step)
        deviation = tool - reference[:, None]
        tracking[part] = _length(deviation).max(axis=0)
        contour[part] = _largest_contour_error(toolpath, tool, reference, step)
    if progress is not None:
        progress(1.0)
    return contour, tracking


def _largest_contour_error(toolpath: Toolpath, tool: Floats, reference: Floats, step_s: float) -> Floats:
    """Largest contour error of each run, (runs,), of tools (k, runs, 2) with the reference (k, 2).

    No contour error exceeds the distance to any one point of the path. A coarse sample of instants gives
    a lower bound; only instants farther than that from one well-chosen point need the nearest one.
    """
    largest = np.asarray(toolpath.distance(tool[::_STRIDE]).max(axis=0))
    candidates = _beside(tool, reference, toolpath.peak_acceleration_m_s2 * step_s**2) > largest
    candidates[::_STRIDE] = False
    _, run = np.nonzero(candidates)
    np.maximum.at(largest, run, toolpath.distance(tool[candidates]))
    return largest


def _beside(tool: Floats, reference: Floats, bend_m: float) -> Floats:
    """Upper bound of the contour error, shape (k, runs): distance to the path abreast of the tool.

    The tool is ahead of the reference or behind by so many samples. The path is interpolated there, with
    an error of at most an eighth of ``bend_m``, acceleration times step squared.
    """
    sample: Floats = np.arange(len(reference), dtype=np.float64)
    deviation, pace = tool - reference[:, None], np.gradient(reference, axis=0)
    square = (pace**2).sum(axis=1)
    pace /= np.where(square > 0, square, 1.0)[:, None]
    ahead = deviation[..., 0] * pace[:, None, 0] + deviation[..., 1] * pace[:, None, 1]
    abreast = sample[:, None] + ahead
    path = np.stack([np.interp(abreast, sample, reference[:, c]) for c in (0, 1)], axis=-1)
    return np.asarray(np.minimum(_length(tool - path) + bend_m, _length(deviation)))


def _length(vector: Floats) -> Floats:
    return np.asarray(np.sqrt(vector[..., 0] ** 2 + vector[..., 1] ** 2))


def _share(
    progress: Callable[[float], None] | None, start: float, share: float
) -> Callable[[float], None] | None:
    """The progress of one batch as a share of the whole."""
    if progress is None:
        return None
    return lambda fraction: progress(start + share * 0.9 * fraction)
