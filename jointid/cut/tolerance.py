"""What an error in K and D costs on the path: many cuts at once.

A grid of mismatches says how well K must be known; draws from a fit's covariance say which path error
an identification promises.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array
from jointid.cut.arm import Elbow, PlanarArm
from jointid.cut.arm_simulation import require_resolved
from jointid.cut.feedforward import plan_servo
from jointid.cut.many_arms import ManyArms
from jointid.cut.servo import MotorFrictionLike, Servo, run_servo
from jointid.cut.toolpath import Toolpath
from jointid.cut.tracking import substeps_per_sample
from jointid.errors import JointIdError
from jointid.joints import Elasticity
from jointid.wording import counted

_RUNS_AT_ONCE = 512
"""Keeps the arrays of a batch within some hundred megabytes."""
_STRIDE = 8


@dataclass(frozen=True, eq=False)
class ToleranceMap:
    """Largest path errors over a grid of assumed stiffnesses."""

    ratios_1: Floats
    """K̂1 / K1 of the rows, shape (a,)."""
    ratios_2: Floats
    """K̂2 / K2 of the columns, shape (b,)."""
    max_contour_error_m: Floats
    """Largest contour error of each cut, shape (a, b), m."""
    max_tracking_error_m: Floats
    """Largest tracking error of each cut, shape (a, b), m."""


@dataclass(frozen=True, eq=False)
class PathErrorDistribution:
    """Largest path errors of arms that differ from the identified one as its uncertainty allows."""

    K: Floats
    """Stiffness of the arms drawn, shape (samples, 2), N·m/rad."""
    D: Floats
    """Damping of the arms drawn, shape (samples, 2), N·m·s/rad."""
    max_contour_error_m: Floats
    """Largest contour error of each cut, shape (samples,), m."""
    max_tracking_error_m: Floats
    """Largest tracking error of each cut, shape (samples,), m."""
    median_m: float
    """Median of the largest contour error, m."""
    p95_m: float
    """Largest contour error that 95 % of the cuts stay below, m."""


def tolerance_map(
    arm: PlanarArm,
    toolpath: Toolpath,
    elasticity: Elasticity,
    ratios_1: ArrayLike | None = None,
    ratios_2: ArrayLike | None = None,
    *,
    servo: Servo | None = None,
    friction: MotorFrictionLike | None = None,
    elbow: Elbow = "positive",
    dt: float = 5e-4,
    progress: Callable[[float], None] | None = None,
) -> ToleranceMap:
    """Cut with every combination of assumed stiffnesses; the assumed damping is the true one.

    Parameters
    ----------
    arm, toolpath
        The cut.
    elasticity : Elasticity
        The true K and D, motor side.
    ratios_1, ratios_2 : array_like, shape (a,) and (b,), optional
        K̂1 / K1 and K̂2 / K2. By default 20 values from 1/3 to 3, even on a logarithmic scale;
        ``ratios_2`` left out is ``ratios_1``.
    servo, friction, elbow, dt, progress
        As in :func:`~jointid.cut.tracking.track`.

    Returns
    -------
    ToleranceMap

    Raises
    ------
    JointIdError
        When a ratio is not positive, and as in :func:`~jointid.cut.tracking.track`.
    """
    first = _ratios("ratios_1", np.geomspace(1 / 3, 3, 20) if ratios_1 is None else ratios_1)
    second = first if ratios_2 is None else _ratios("ratios_2", ratios_2)
    _require_two_joints(elasticity)
    grid = np.stack([g.ravel() for g in np.meshgrid(first, second, indexing="ij")])
    contour, tracking = _largest_errors(
        arm,
        toolpath,
        servo or Servo(),
        true=(elasticity.K[:, None], elasticity.D[:, None]),
        assumed=(elasticity.K[:, None] * grid, np.repeat(elasticity.D[:, None], grid.shape[1], axis=1)),
        runs=grid.shape[1],
        friction=friction,
        elbow=elbow,
        dt=dt,
        progress=progress,
    )
    shape = (first.size, second.size)
    return ToleranceMap(first, second, _frozen(contour.reshape(shape)), _frozen(tracking.reshape(shape)))


def path_error_distribution(
    arm: PlanarArm,
    toolpath: Toolpath,
    elasticity: Elasticity,
    covariance: ArrayLike,
    *,
    samples: int = 200,
    seed: int = 0,
    servo: Servo | None = None,
    friction: MotorFrictionLike | None = None,
    elbow: Elbow = "positive",
    dt: float = 5e-4,
    progress: Callable[[float], None] | None = None,
) -> PathErrorDistribution:
    """Path error that an identification promises: the servo assumes the fit, the arm is drawn around it.

    Parameters
    ----------
    arm, toolpath
        The cut.
    elasticity : Elasticity
        The identified K and D, which the servo assumes.
    covariance : array_like, shape (4, 4)
        Their covariance in the order K1, K2, D1, D2, as a fit gives it.
    samples : int
        Number of arms drawn from the normal distribution; draws with K ≤ 0 or D < 0 are drawn again.
    seed : int
        The same seed gives the same arms.
    servo, friction, elbow, dt, progress
        As in :func:`~jointid.cut.tracking.track`.

    Returns
    -------
    PathErrorDistribution

    Raises
    ------
    JointIdError
        When the covariance is not one, or so large that it allows negative stiffness or damping more
        often than not; and as in :func:`~jointid.cut.tracking.track`.
    """
    _require_two_joints(elasticity)
    if isinstance(samples, bool) or not isinstance(samples, int | np.integer) or samples < 1:
        raise JointIdError(f"samples = {samples!r}: give a whole number of arms to draw, at least 1.")
    drawn = _draw(elasticity, covariance, int(samples), seed)
    contour, tracking = _largest_errors(
        arm,
        toolpath,
        servo or Servo(),
        true=(drawn[:, :2].T, drawn[:, 2:].T),
        assumed=(elasticity.K, elasticity.D),
        runs=int(samples),
        friction=friction,
        elbow=elbow,
        dt=dt,
        progress=progress,
    )
    return PathErrorDistribution(
        K=_frozen(drawn[:, :2]),
        D=_frozen(drawn[:, 2:]),
        max_contour_error_m=_frozen(contour),
        max_tracking_error_m=_frozen(tracking),
        median_m=float(np.median(contour)),
        p95_m=float(np.percentile(contour, 95)),
    )


def _largest_errors(
    arm: PlanarArm,
    toolpath: Toolpath,
    servo: Servo,
    *,
    true: tuple[Floats, Floats],
    assumed: tuple[Floats, Floats],
    runs: int,
    friction: MotorFrictionLike | None,
    elbow: Elbow,
    dt: float,
    progress: Callable[[float], None] | None,
) -> tuple[Floats, Floats]:
    """Largest contour and tracking error of each run, (runs,) each, m.

    True K and D are (2, runs) or (2, 1), the assumed ones (2, runs) or, for all runs alike, (2,).
    """
    substeps = substeps_per_sample(servo, dt)
    step = servo.interval_s / substeps
    contour, tracking = np.empty(runs), np.empty(runs)
    for first in range(0, runs, _RUNS_AT_ONCE):
        part = slice(first, min(first + _RUNS_AT_ONCE, runs))
        count = part.stop - part.start
        K, D = (x if x.shape[1] == 1 else x[:, part] for x in true)
        K_assumed, D_assumed = (x if x.ndim == 1 else x[:, part] for x in assumed)
        plan = plan_servo(arm, toolpath, servo, K_assumed, D_assumed, elbow)
        require_resolved(arm, K.max(axis=1), D.max(axis=1), step, plan.start_angle)
        arms = ManyArms(arm, K, D, step, plan.start_angle, count, friction)
        with np.errstate(over="ignore", invalid="ignore"):
            run_servo(plan, arms, substeps, _share(progress, part.start / runs, count / runs))
        links = np.array([*arms.log, (arms.link1, arms.link2)])
        tool = arm.tool(arm.joint_angles(links.transpose(0, 2, 1)))
        wanted = toolpath.position(np.arange(len(tool)) * step)
        apart = np.hypot(*np.moveaxis(tool - wanted[:, None], -1, 0))
        tracking[part] = apart.max(axis=0)
        contour[part] = _largest_contour_error(toolpath, tool, apart)
    if progress is not None:
        progress(1.0)
    return contour, tracking


def _largest_contour_error(toolpath: Toolpath, tool: Floats, apart: Floats) -> Floats:
    """Largest contour error of each run, (runs,).

    The contour error never exceeds the tracking error ``apart`` (k, runs). So a coarse look gives a
    lower bound, and only instants whose tracking error exceeds it need the nearest point of the path.
    """
    largest = np.asarray(toolpath.distance(tool[::_STRIDE]).max(axis=0))
    candidates = apart > largest
    candidates[::_STRIDE] = False
    _, run = np.nonzero(candidates)
    np.maximum.at(largest, run, toolpath.distance(tool[candidates]))
    return largest


def _draw(elasticity: Elasticity, covariance: ArrayLike, samples: int, seed: int) -> Floats:
    """Draws of K1, K2, D1, D2 that are physical, shape (samples, 4)."""
    C = finite_array("covariance", covariance, ndim=2)
    if C.shape != (4, 4):
        raise JointIdError(f"covariance has shape {C.shape}; expected (4, 4): K1, K2, D1, D2.")
    scale = np.sqrt(np.outer(np.abs(np.diag(C)), np.abs(np.diag(C))))
    correlation = C / np.where(scale > 0, scale, 1.0)
    if (
        np.any(np.diag(C) < 0)
        or np.abs(correlation - correlation.T).max() > 1e-6
        or np.linalg.eigvalsh(correlation).min() < -1e-6
    ):
        raise JointIdError("covariance must be symmetric without negative eigenvalues.")
    # Factor the correlation, not the covariance: K² and D² differ by many powers of ten.
    value, vector = np.linalg.eigh(correlation)
    factor = np.sqrt(np.diag(C))[:, None] * vector * np.sqrt(np.maximum(value, 0.0))
    mean = np.concatenate([elasticity.K, elasticity.D])
    generator = np.random.default_rng(seed)
    draws = mean + generator.standard_normal((4 * samples + 40, 4)) @ factor.T
    physical = draws[(draws[:, :2] > 0).all(axis=1) & (draws[:, 2:] >= 0).all(axis=1)]
    if 2 * len(physical) < len(draws) or len(physical) < samples:
        raise JointIdError(
            f"The covariance allows negative K or D in {1 - len(physical) / len(draws):.0%} of the "
            "draws: they are not determined well enough to promise a path error. Record more, "
            "or at frequencies nearer to the resonances."
        )
    return np.asarray(physical[:samples])


def _ratios(name: str, value: ArrayLike) -> Floats:
    array = finite_array(f"{name} (K̂ / K)", np.atleast_1d(np.asarray(value)), ndim=1)
    if array.size == 0 or array.min() <= 0:
        shown = f"{array.min():g}" if array.size else "empty"
        raise JointIdError(f"{name} (K̂ / K) is {shown}: give positive ratios.")
    return array


def _require_two_joints(elasticity: Elasticity) -> None:
    if elasticity.n != 2:
        raise JointIdError(f"The elasticity has {counted(elasticity.n, 'joint')}; the planar arm has 2.")


def _share(
    progress: Callable[[float], None] | None, start: float, share: float
) -> Callable[[float], None] | None:
    """The progress of one batch as a share of the whole."""
    if progress is None:
        return None
    return lambda fraction: progress(start + share * 0.9 * fraction)


def _frozen(array: Floats) -> Floats:
    array = array.copy()
    array.setflags(write=False)
    return array
