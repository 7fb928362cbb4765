"""Path error from errors in K and D, over many cuts.

A grid of mismatches shows the required accuracy of K; draws from a fit's covariance give the path error
after an identification.
"""

from dataclasses import dataclass
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, finite_array, frozen, whole_number
from jointid.cut.arm import PlanarArm, require_two_joints
from jointid.cut.path_errors import CutOptions, largest_errors
from jointid.cut.toolpath import Toolpath
from jointid.errors import JointIdError
from jointid.joints import Elasticity


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
    """Largest path errors of arms drawn from the uncertainty of the identified one."""

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
    """95th percentile of the largest contour error, m."""


def tolerance_map(
    arm: PlanarArm,
    toolpath: Toolpath,
    elasticity: Elasticity,
    ratios_1: ArrayLike | None = None,
    ratios_2: ArrayLike | None = None,
    **options: Unpack[CutOptions],
) -> ToleranceMap:
    """Simulate every combination of assumed stiffnesses; the assumed damping is the true one.

    Parameters
    ----------
    arm, toolpath
        The cut.
    elasticity : Elasticity
        The true K and D, motor side.
    ratios_1, ratios_2 : array_like, shape (a,) and (b,), optional
        K̂1 / K1 and K̂2 / K2. By default 20 values from 1/3 to 3 with logarithmic spacing, and
        ``ratios_2`` equal to ``ratios_1``.
    **options
        ``servo``, ``friction``, ``elbow``, ``dt``, ``progress`` as in
        :func:`~jointid.cut.tracking.track`; ``dt`` is 0.5 ms by default.

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
    grid = np.stack([g.ravel() for g in np.meshgrid(first, second, indexing="ij")])
    errors = errors_of_mismatch(arm, toolpath, elasticity, grid, **options)
    contour, tracking = (frozen(error.reshape(first.size, second.size)) for error in errors)
    return ToleranceMap(first, second, contour, tracking)


def errors_of_mismatch(
    arm: PlanarArm,
    toolpath: Toolpath,
    elasticity: Elasticity,
    ratios: ArrayLike,
    **options: Unpack[CutOptions],
) -> tuple[Floats, Floats]:
    """Simulate one cut for each pair of assumed stiffnesses; the assumed damping is the true one.

    Parameters
    ----------
    arm, toolpath, elasticity, **options
        As in :func:`tolerance_map`, with the same errors.
    ratios : array_like, shape (2, runs) or (runs,)
        K̂1 / K1 and K̂2 / K2 of each cut, or one ratio for both joints alike.

    Returns
    -------
    tuple of ndarray, shape (runs,) each
        Largest contour error and largest tracking error of each cut, m.
    """
    require_two_joints(elasticity)
    pairs = np.asarray(ratios, dtype=np.float64)
    if pairs.ndim == 1:
        pairs = np.stack([pairs, pairs])
    first, second = (_ratios("ratios", x) for x in pairs)
    K, D = elasticity.K[:, None], elasticity.D[:, None]
    assumed = (K * np.stack([first, second]), np.repeat(D, first.size, axis=1))
    return largest_errors(arm, toolpath, first.size, true=(K, D), assumed=assumed, **options)


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

    Parameters
    ----------
    arm, toolpath
        The cut.
    elasticity : Elasticity
        The identified K and D, which the servo assumes.
    covariance : array_like, shape (4, 4)
        Their covariance in the order K1, K2, D1, D2, as a fit gives it.
    samples : int
        Number of arms from the normal distribution; draws with K ≤ 0 or D < 0 are repeated.
    seed : int
        The same seed gives the same arms.
    **options
        ``servo``, ``friction``, ``elbow``, ``dt``, ``progress`` as in
        :func:`~jointid.cut.tracking.track`; ``dt`` is 0.5 ms by default.

    Returns
    -------
    PathErrorDistribution

    Raises
    ------
    JointIdError
        When the covariance is invalid, or so large that most draws have negative stiffness or damping;
        and as in :func:`~jointid.cut.tracking.track`.
    """
    require_two_joints(elasticity)
    samples = whole_number("samples", samples, 1)
    drawn = _draw(elasticity, covariance, samples, seed)
    true, assumed = (drawn[:, :2].T, drawn[:, 2:].T), (elasticity.K, elasticity.D)
    contour, tracking = largest_errors(arm, toolpath, samples, true=true, assumed=assumed, **options)
    return PathErrorDistribution(
        K=frozen(drawn[:, :2]),
        D=frozen(drawn[:, 2:]),
        max_contour_error_m=frozen(contour),
        max_tracking_error_m=frozen(tracking),
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
            f"The covariance allows negative K or D in {1 - len(physical) / len(draws):.0%} of the "
            "draws: they are not determined well enough to predict a path error. Record more, "
            "or at frequencies nearer to the resonances."
        )
    return np.asarray(physical[:samples])


def _ratios(name: str, value: ArrayLike) -> Floats:
    array = finite_array(f"{name} (K̂ / K)", np.atleast_1d(np.asarray(value)), ndim=1)
    if array.size == 0 or array.min() <= 0:
        shown = f"{array.min():g}" if array.size else "empty"
        raise JointIdError(f"{name} (K̂ / K) is {shown}: give positive ratios.")
    return array
