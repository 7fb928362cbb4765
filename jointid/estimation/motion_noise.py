"""Noise of motions, from the residual of a fitted model, and of sines beside them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import Model
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import spring_equations
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.noise import Noise, floored, sensor_noise
from jointid.estimation.estimators.residual import unknown_friction
from jointid.estimation.model_fits import evaluated
from jointid.phasors.extract import Phasors
from jointid.phasors.segment import Motors

SAME, SAME_OF_MANY = 0.1, 0.3
"""Relative change of the variances above which the models are compared again; the second for many
equations, whose noise is already that of the chosen model."""
_LEAST_LEFT, _CLEAREST = 0.02, 0.3
"""Smallest share of a joint's equations in a segment that free friction leaves, and share above which
the segment shows the noise; if no segment does, those with the largest share are used."""
_LATEST = 0.2
"""Largest share of a motor's velocity at which friction may have turned it back: more is friction in a
wrong unit, with which all of the motion would be a reversal."""


def with_noise(
    phasors: Phasors, prior: InertiaPrior, model: Model, estimate: LikelihoodEstimate | JointIdError
) -> Phasors:
    """Phasors with the noise of motions from the residual of a fitted model."""
    if not phasors.motion.any() or isinstance(estimate, JointIdError):
        return phasors
    unweighted: Floats = np.ones(phasors.harmonics.shape[1])
    residual = evaluated(phasors, prior, model, estimate, noise_of_rows(phasors, prior), unweighted)
    left = residual.at.r - residual.free_friction()
    spread = unknown_friction(residual.at.problem, residual.at.p)
    rows = 2.0 * phasors.harmonics[..., : phasors.n].any(axis=2).sum(axis=1)[:, None]
    share = np.where(residual.at.problem.used, residual.projection.noise_left(rows) / rows, 0)
    clear = share >= np.clip(share[phasors.motion].max(axis=0), _LEAST_LEFT, _CLEAREST)
    whole = np.einsum("rhjj->rhj", residual.at.V).real
    by_noise = 1 - np.divide(spread, whole, out=np.zeros(left.shape), where=spread > 0)
    left *= np.sqrt(by_noise / np.where(clear, share, np.nan)[:, None])
    torques = sensor_noise(phasors, left, residual.at.E)
    return with_torque_noise(phasors, prior, torques, prior.motors(phasors, estimate.named))


def with_torque_noise(
    phasors: Phasors, prior: InertiaPrior, torques: dict[int, Floats], motors: Sequence[Motors]
) -> Phasors:
    """Phasors with the noise of the torques of each motion record, the usual one of those not given.

    ``torques`` are variances (n,); NaN leaves that of the segments.
    """
    usual: Floats = np.mean([*torques.values()], axis=0)
    covariance, segments = phasors.harmonic_covariance.copy(), list(phasors.segments)
    for row, segment in enumerate(phasors.segments):
        if segment is not None:
            least, most = segment.least_torque_variance, segment.most_torque_variance
            torque = torques.get(segment.record, usual)
            torque = np.where(np.isnan(torque), segment.torque_variance, torque)
            torque = np.clip(torque, least, np.maximum(most, least))
            variance = np.concatenate([segment.angle_variance, torque])
            covariance[row] = 4 / segment.samples * np.diag(variance)
            braked = np.maximum(segment.friction_at_reversals(motors[row]), 0)
            unknown = braked / motors[row].torque_scale
            late = braked / prior.M[prior.rotor[row]] * segment.velocity_blur_s
            late = np.minimum(late, _LATEST * np.abs(segment.velocity).max(axis=1))
            segments[row] = replace(segment, torque_variance=torque, turn_rad_s=late, unknown_Nm=unknown)
    return replace(phasors, harmonic_covariance=covariance, segments=tuple(segments))


def noise_differs(one: Phasors, other: Phasors, same: float = SAME) -> bool:
    """Whether the variances of motions differ by more than ``same`` times the smaller (RMS)."""
    rows = one.motion
    before, after = (np.einsum("rhjj->rj", each.harmonic_covariance[rows]).real for each in (one, other))
    least = np.minimum(before, after)
    change = np.divide(before - after, least, out=np.zeros_like(least), where=least > 0)
    return bool(np.any(np.sqrt(np.mean(change**2, axis=0)) > same))


def noise_of_rows(phasors: Phasors, prior: InertiaPrior) -> Noise:
    """Noise of sines as in their own analysis, and that of motions as stated by their phasors."""
    covariance = phasors.harmonic_covariance.copy()
    degrees = phasors.degrees_of_freedom.copy()
    sines = np.flatnonzero(~phasors.motion)
    if sines.size:
        inertias = prior.inertias(prior.M, prior.M2)
        own = spring_equations(phasors.select(sines), [inertias[k] for k in sines]).noise
        covariance[sines], degrees[sines] = own.covariance, own.degrees_of_freedom
    return Noise(floored(covariance, phasors.harmonics), degrees)
