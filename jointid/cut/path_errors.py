"""Largest path errors of many cuts along one path, vectorised over the cuts.

Mismatches show the required accuracy of K; draws from a fit's covariance give the path error
after an identification.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array, frozen, whole_number
from jointid.cut.arm import PlanarArm, require_two_joints
from jointid.cut.arm_simulation import ManyArms, require_resolved
from jointid.cut.feedforward import plan_servo
from jointid.cut.servo import MotorFrictionLike, Servo, run_servo
from jointid.cut.toolpath import Toolpath
from jointid.cut.tracking import substeps_per_sample
from jointid.errors import JointIdError
from jointid.gears.gear import Gear
from jointid.gears.laws import nonlinear_laws
from jointid.joints import Elasticity
from jointid.wording import percent

_BATCH_RUNS = 512
"""Runs per batch, which keeps the arrays within some hundred megabytes."""


class CutOptions(TypedDict, total=False):
    """Optional arguments of the functions here, as in :func:`~jointid.cut.tracking.track`."""

    servo: Servo | None
    friction: MotorFrictionLike | None
    gears: Sequence[Gear] | None
    dt: float  # by default 0.5 ms


@dataclass(frozen=True, eq=False)
class PathErrorDistribution:
    """Largest path errors of arms drawn from the uncertainty of the identified one."""

    K: Floats
    """Stiffness of the arms drawn, shape (samples, 2), N·m/rad."""
    D: Floats
    """Damping of the arms drawn, shape (samples, 2), N·m·s/rad."""
    max_contour_error_m: Floats
    """Largest contour error of each cut, shape (samples,), m."""
    median_m: float
    """Median of the largest contour error, m."""
    p95_m: float
    """95th percentile of the largest contour error, m."""


def errors_of_mismatch(
    arm: PlanarArm,
    toolpath: Toolpath,
    elasticity: Elasticity,
    ratios: ArrayLike,
    **options: Unpack[CutOptions],
) -> Floats:
    """Simulate one cut for each pair of assumed stiffnesses; the assumed damping is the true one.

    ``ratios``, shape (2, runs), are K̂1 / K1 and K̂2 / K2 of each cut, ``elasticity`` the true K and D,
    motor side; ``options`` are servo, friction, gears and dt (by default 0.5 ms) as in
    :func:`~jointid.cut.tracking.track`. Returns the largest contour error of each cut, shape (runs,), m.
    Raises JointIdError when a ratio is not positive, and as ``track``.
    """
    require_two_joints(elasticity)
    pairs = finite_array("ratios (K̂ / K)", ratios, ndim=2)
    if len(pairs) != 2 or pairs.size == 0 or pairs.min() <= 0:
        raise JointIdError(f"ratios (K̂ / K), shape {pairs.shape}: give positive values (2, runs).")
    K, D = elasticity.K[:, None], elasticity.D[:, None]
    assumed = (K * pairs, np.repeat(D, pairs.shape[1], axis=1))
    return _largest_errors(arm, toolpath, pairs.shape[1], (K, D), assumed, **options)


def path_error_distribution(
    arm: PlanarArm,
    toolpath: Toolpath,
    elasticity: Elasticity,
    covariance: ArrayLike,
    *,
    samples: int = 200,
    seed: int = 0,
    **options: Unpack[CutOptions],
) -> PathErrorDistribution:
    """Path error after an identification: the servo assumes the fit, arms are drawn from its covariance.

    ``elasticity`` holds the identified K and D, which the servo assumes, and ``covariance``, shape (4,
    4), is that of K1, K2, D1, D2. ``samples`` arms are drawn from the normal distribution, without K ≤ 0
    and D < 0; the same ``seed`` gives the same arms. Raises JointIdError when the covariance is invalid,
    or so large that most draws have negative stiffness or damping. Options and other errors as in
    ``errors_of_mismatch``.
    """
    require_two_joints(elasticity)
    samples = whole_number("samples", samples, 1)
    drawn = _draw(elasticity, covariance, samples, seed)
    true = drawn[:, :2].T, drawn[:, 2:].T
    assumed = elasticity.K[:, None], elasticity.D[:, None]
    contour = _largest_errors(arm, toolpath, samples, true, assumed, **options)
    return PathErrorDistribution(
        K=frozen(drawn[:, :2]),
        D=frozen(drawn[:, 2:]),
        max_contour_error_m=frozen(contour),
        median_m=float(np.median(contour)),
        p95_m=float(np.percentile(contour, 95)),
    )


def _draw(elasticity: Elasticity, covariance: ArrayLike, samples: int, seed: int) -> Floats:
    """Physical draws of K1, K2, D1, D2, shape (samples, 4)."""
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
            f"The covariance allows negative K or D in {percent(1 - len(physical) / len(draws))} of the "
            "draws: they are not determined well enough to predict a path error. Record "
            "longer, or at frequencies nearer to the resonances."
        )
    return np.asarray(physical[:samples])


def _largest_errors(
    arm: PlanarArm,
    toolpath: Toolpath,
    runs: int,
    true: tuple[Floats, Floats],
    assumed: tuple[Floats, Floats],
    *,
    servo: Servo | None = None,
    friction: MotorFrictionLike | None = None,
    gears: Sequence[Gear] | None = None,
    dt: float = 5e-4,
) -> Floats:
    """Largest contour error of each cut, shape (runs,), m.

    ``true`` holds K and D of the arms, motor side, shape (2, runs) each, or (2, 1) for equal arms;
    ``assumed`` those that the servos assume.
    """
    servo = servo or Servo()
    substeps = substeps_per_sample(servo, dt)
    step = servo.interval_s / substeps
    contour = np.empty(runs)
    for first in range(0, runs, _BATCH_RUNS):
        part = slice(first, min(first + _BATCH_RUNS, runs))
        count = part.stop - part.start
        K, D, K_assumed, D_assumed = (x if x.shape[1] == 1 else x[:, part] for x in (*true, *assumed))
        plan = plan_servo(arm, toolpath, servo, K_assumed, D_assumed)
        require_resolved(arm, K.max(axis=1), D.max(axis=1), step, plan.start_angle)
        laws = nonlinear_laws(K, gears, arm.gear_ratio)
        arms = ManyArms(arm, K, D, step, plan.start_angle, count, friction, laws)
        with np.errstate(over="ignore", invalid="ignore"):
            run_servo(plan, arms, substeps)
        links = np.array([angles[:2] for angles in (*arms.log, arms.angles)])
        tool = arm.tool_of_links(links.swapaxes(1, 2))
        reference = toolpath.position(np.arange(len(tool)) * step)
        contour[part] = _largest_contour_error(toolpath, tool, reference)
    return contour


def _largest_contour_error(toolpath: Toolpath, tool: Floats, reference: Floats) -> Floats:
    """Largest contour error of each run, (runs,), of tools (k, runs, 2) with the reference (k, 2).

    No contour error exceeds the distance from any point of the path, such as that beside the tool along
    the chords between the samples of the reference. The instant with the largest upper bound gives a
    lower bound of the largest error; only instants with a larger upper bound need their nearest point.
    """
    along = np.gradient(reference, axis=0)
    size = np.hypot(*along.T)
    if not size.any():
        return np.asarray(toolpath.distance(tool).max(axis=0))
    moving = np.flatnonzero(size)  # at rest, the direction of the motion that follows or ended
    at = moving[np.minimum(np.searchsorted(moving, np.arange(len(size))), moving.size - 1)]
    chords = np.diff(reference, axis=0)
    arc = np.pad(np.cumsum(np.hypot(*chords.T)), (1, 0))
    place = np.einsum("krc,kc->kr", tool - reference[:, None], along[at] / size[at, None])
    place += arc[:, None]
    beside = np.interp(place, arc, np.arange(float(arc.size)))
    before = np.minimum(beside.astype(np.intp), len(chords) - 1)
    off = tool - reference[before] - (beside - before)[..., None] * chords[before]
    bound = np.sqrt(np.einsum("krc,krc->kr", off, off))
    bends = np.pad(np.hypot(*np.diff(chords, axis=0).T), 1, mode="edge")
    # The sag of a chord is an eighth of the bend between chords; a third more for its changes.
    bound += (np.maximum(bends[:-1], bends[1:]) / 6)[before]
    largest = toolpath.distance(tool[np.argmax(bound, axis=0), np.arange(tool.shape[1])])
    candidates = bound > largest
    _, run = np.nonzero(candidates)
    np.maximum.at(largest, run, toolpath.distance(tool[candidates]))
    return largest
