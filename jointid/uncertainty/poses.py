"""Fits by pose, and whether the poses agree."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.inertia_prior import InertiaPrior, inertia_of_each
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.linear_fit import LINEAR, carried_covariance
from jointid.joints import Inertia
from jointid.phasors.extract import Phasors
from jointid.small_matrices import positive_inverse, whitener
from jointid.uncertainty.chosen_model import refit, require_sines
from jointid.uncertainty.information import prior_shift

_LEAST_OWN = 1e-3
"""Least share of a pose's variance that is its own: what the poses share is known to first order."""


@dataclass(frozen=True, eq=False)
class PoseFits:
    """K and D of each pose alone, with the model chosen for all records."""

    names: tuple[str, ...]
    """The poses, m of them; "" for records without one."""
    estimates: Floats
    """K1 ... Kn, D1 ... Dn by pose, shape (m, 2n)."""
    covariance: Floats
    """Covariance of each pose's estimates, as the fit states its own, shape (m, 2n, 2n)."""
    shared: Floats
    """Change of each pose's estimates by one standard deviation of every given value that all poses
    share (rotor inertias, torque scales), shape (m, 2n, c)."""
    problems: tuple[str, ...]
    """Poses without an estimate of their own, each with the reason."""

    @property
    def standard_error(self) -> Floats:
        """Shape (m, 2n)."""
        return np.asarray(np.sqrt(np.einsum("mpp->mp", self.covariance)))

    @property
    def spread(self) -> Floats:
        """Largest minus smallest estimate of each parameter over their mean, shape (2n,)."""
        range_, mean = np.ptp(self.estimates, axis=0), np.abs(self.estimates.mean(axis=0))
        none = np.where(range_ > 0, np.inf, 0.0)
        return np.asarray(np.divide(range_, mean, out=none, where=mean > 0))

    @property
    def significance(self) -> Floats:
        """Root mean square distance of the poses from their mean, in standard errors, shape (2n,).

        About 1 when the poses agree.
        """
        variance = np.einsum("mpp->mp", self.covariance)
        own = np.maximum(variance - (self.shared**2).sum(axis=2), _LEAST_OWN * variance)
        weight = 1 / own
        mean = (weight * self.estimates).sum(axis=0) / weight.sum(axis=0)
        squares = (weight * (self.estimates - mean) ** 2).sum(axis=0)
        return np.asarray(np.sqrt(squares / max(len(self.names) - 1, 1)))

    @property
    def probability(self) -> float:
        """p-value of the poses' differences under agreement, by χ²; 1 for a single pose."""
        m, own = self.estimates.shape
        shift = self.shared.reshape(m * own, -1)
        covariance = shift @ shift.T
        for k, part in enumerate(self.covariance):
            covariance[k * own : (k + 1) * own, k * own : (k + 1) * own] = part
        W = whitener(covariance)
        A, b = W @ np.tile(np.eye(own), (m, 1)), W @ self.estimates.ravel()
        left = b - A @ (positive_inverse(A.T @ A) @ A.T @ b)
        return float(chdtrc((m - 1) * own, left @ left)) if m > 1 else 1.0


def fits_by_pose(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    poses: Sequence[str | None],
    fit: ElasticityFit,
) -> PoseFits:
    """Fit every pose alone, with the model of the fit to all poses.

    ``poses`` holds the pose of each record. Raises JointIdError when no pose allows an estimate, or
    there is not one pose per record, or the fit has motion records.
    """
    require_sines(
        phasors, fit, "Fits by pose need", "Call identify_motion with the records of each pose alone."
    )
    if len(poses) != phasors.omega.size:
        raise JointIdError(f"{len(poses)} poses for {phasors.omega.size} records: give one per record.")
    each = inertia_of_each(inertia, *phasors.q.shape)
    names, estimates, covariances, shifts, problems = [], [], [], [], []
    for pose in dict.fromkeys(poses):
        records = [i for i, name in enumerate(poses) if name == pose]
        part, given = phasors.select(records), [each[i] for i in records]
        # K and D that change over the records are the means of this pose.
        part = replace(part, progress=part.progress - part.progress.mean(axis=0))
        try:
            one = refit(part, given, fit)
        except JointIdError as error:
            problems.append(f"{pose or 'Records without a pose'}: {error}")
            continue
        prior = fit.prior.like(given, part.q.shape)
        noise = spring_equations(part, given).noise
        std, shift = prior_shift(fit.method, part, prior, noise, one.covariance)
        covariance = one.elasticity_covariance
        if fit.method in LINEAR and np.isfinite(shift).all():
            covariance = covariance * max(1.0, one.misfit) + carried_covariance(shift, np.ones(std.size))
        if not (np.isfinite(np.diag(covariance)).all() and np.isfinite(shift).all()):
            problems.append(f"{pose or 'Records without a pose'}: alone, they do not determine K and D.")
            continue
        names.append(pose or "")
        estimates.append(one.elasticity)
        covariances.append(covariance)
        shifts.append(shift[:, _is_shared(fit, prior)])
    if not names:
        raise JointIdError(f"No pose alone allows an estimate. {problems[0]}")
    return PoseFits(
        tuple(names), np.array(estimates), np.array(covariances), np.array(shifts), tuple(problems)
    )


def _is_shared(fit: ElasticityFit, prior: InertiaPrior) -> np.ndarray:
    """Whether all poses of a fit share each given value of one pose's prior, shape (E,)."""
    shared = {"M": len(fit.prior.M) == 1, "M2": False, "torque_scale": True}
    sizes = {name: mean.size for name, (mean, _) in prior.blocks().items()}
    return np.repeat([shared[name] for name in sizes], list(sizes.values())).astype(bool)
