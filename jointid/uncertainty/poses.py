"""Fits by pose, and whether the poses agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.small_matrices import positive_inverse, whitener
from jointid.uncertainty.chosen_model import inertia_of_each, refit


@dataclass(frozen=True, eq=False)
class PoseFits:
    """K and D of each pose alone, with the model chosen for all records."""

    names: tuple[str, ...]
    """The poses, m of them; "" for records without one."""
    estimates: Floats
    """K1 ... Kn, D1 ... Dn by pose, shape (m, 2n)."""
    covariance: Floats
    """Covariance of each pose's estimates, times its misfit if above 1, shape (m, 2n, 2n)."""
    mean: Floats
    """Mean over the poses, weighted by their covariances, shape (2n,)."""
    problems: tuple[str, ...]
    """Poses without an estimate of their own, each with the reason."""

    @property
    def standard_error(self) -> Floats:
        """Shape (m, 2n)."""
        return np.asarray(np.sqrt(np.einsum("mpp->mp", self.covariance)))

    @property
    def spread(self) -> Floats:
        """Largest less smallest estimate of each parameter over its mean, shape (2n,)."""
        return np.asarray(np.ptp(self.estimates, axis=0) / np.abs(self.mean))

    @property
    def significance(self) -> Floats:
        """Root mean square distance of the poses from their mean, in standard errors, shape (2n,).

        About 1 when the poses agree.
        """
        variance = np.einsum("mpp->mp", self.covariance)
        weight = 1 / variance
        mean = (weight * self.estimates).sum(axis=0) / weight.sum(axis=0)
        squares = (weight * (self.estimates - mean) ** 2).sum(axis=0)
        return np.asarray(np.sqrt(squares / max(len(self.names) - 1, 1)))

    @property
    def probability(self) -> float:
        """p-value of the poses' differences under agreement, by χ²; 1 for a single pose."""
        degrees_of_freedom = (len(self.names) - 1) * self.mean.size
        if degrees_of_freedom == 0:
            return 1.0
        deviation = (self.estimates - self.mean)[..., None]
        squares = float(((whitener(self.covariance) @ deviation) ** 2).sum())
        return float(chdtrc(degrees_of_freedom, squares))


def fits_by_pose(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    poses: Sequence[str | None],
    fit: ElasticityFit,
) -> PoseFits:
    """Fit every pose alone.

    Parameters
    ----------
    phasors, inertia
        Data of ``fit``.
    poses : sequence of str or None
        The pose of each record.
    fit : ElasticityFit
        Fit to all poses; its model is applied to each.

    Raises
    ------
    JointIdError
        When no pose allows an estimate, or there is not one pose per record.
    """
    if len(poses) != phasors.omega.size:
        raise JointIdError(f"{len(poses)} poses for {phasors.omega.size} records: give one per record.")
    each = inertia_of_each(phasors, inertia)
    names, estimates, covariances, problems = [], [], [], []
    for pose in dict.fromkeys(poses):
        records = [i for i, name in enumerate(poses) if name == pose]
        try:
            one = refit(phasors.select(records), [each[i] for i in records], fit)
        except JointIdError as error:
            problems.append(f"{pose or 'Records without a pose'}: {error}")
            continue
        if not np.isfinite(one.elasticity_covariance).all():
            problems.append(f"{pose or 'Records without a pose'}: alone, they do not determine K and D.")
            continue
        names.append(pose or "")
        estimates.append(one.elasticity)
        covariances.append(one.elasticity_covariance * max(1.0, one.misfit))
    if not names:
        raise JointIdError(f"No pose allows an estimate alone. {problems[0]}")
    table, covariance = np.array(estimates), np.array(covariances)
    information = np.array([positive_inverse(own) for own in covariance])
    mean = positive_inverse(information.sum(axis=0)) @ (information @ table[..., None]).sum(axis=0)[:, 0]
    return PoseFits(tuple(names), table, covariance, np.asarray(mean), tuple(problems))
