"""Result of an identification: stiffness and damping with their total error."""

from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import Candidate, Choice
from jointid.estimation.estimators.fitted_gears import fitted_gears
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import SpringEquations
from jointid.estimation.estimators.linear_fit import Estimate
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.parameters import Parameters
from jointid.gears.gear import Gear
from jointid.gears.torsion_curve import TorsionCurve
from jointid.joints import Elasticity, Inertia
from jointid.phasors.extract import Phasors
from jointid.wording import minus

_UNSEEN_K, _UNSEEN_D = 5e-4, 1.5e-3
"""Relative error of K and D, per unit of Coulomb friction over torque, that is not in the noise:
truncated harmonics, motion between samples. Measured on simulated robots."""
_TURNING_K, _TURNING_D = 3e-3, 6e-3
"""Relative error of K and D from motions, per square of that ratio: rests are alike at all reversals, so
that the error of their friction does not average. Measured likewise. Not added where the covariance
contains the friction of each rest as noise: the rms error on six axes is then one standard error."""


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction at the motors, (coulomb + load · |torque through the gear|) sign(θ̇) + viscous · θ̇."""

    coulomb: Floats
    """Shape (n,), N·m; with presliding, the level after a long move in one direction."""
    viscous: Floats
    """Shape (n,), N·m·s/rad."""
    standard_error: Floats
    """Standard errors of coulomb (n), then viscous (n), shape (2n,); 0 without a reversal."""
    load: Floats | float = 0.0
    """Share μ of the torque through the gear, shape (n,); 0 where it was not fitted."""
    change: Floats | float = 0.0
    """Standard deviation of ``coulomb`` between sine records, shape (n,), N·m; 0 where all have one."""


AGREEING = 2.0
"""Standard errors within which values agree: 95 % of normal errors."""


@dataclass(frozen=True, eq=False)
class ElasticityFit:
    """Stiffness and damping of n joints, motor side, identified from r records, equations (8)-(15)."""

    method: str
    """Estimator, a key of ``METHODS``."""
    K: Floats
    """Stiffness, shape (n,), N·m/rad; negative when the data contradict the model."""
    D: Floats
    """Damping, shape (n,), N·m·s/rad."""
    covariance: Floats
    """Covariance of (K1 ... Kn, D1 ... Dn), shape (2n, 2n), from all causes: noise times ``inflation``,
    prior, choice of model and, with friction, its truncated harmonics."""
    residual: Complexes
    """Difference of measured and modelled joint torque by record and joint, shape (r, n), N·m."""
    residual_noise: Floats
    """Its standard deviation from noise alone (root of the complex variance), shape (r, n), N·m."""
    cost: float
    """Sum of the squared residuals in units of their noise, over all records and harmonics fitted."""
    expected_cost: float
    """Expected value of ``cost`` for a correct model and the stated noise; 0 for one record."""
    equations: SpringEquations
    """Joint equations, with the identified friction and delay subtracted from the torque."""
    phasors: Phasors
    """Phasors in these equations, friction-compensated likewise."""
    prior: InertiaPrior
    """Inertias and torque scales as given."""
    inertias: tuple[Inertia, ...]
    """Inertia of each record, as fitted; the given one where it was exact."""
    parameters: Parameters
    """All fitted parameters: K, D, friction, delay, effects, inertias."""
    parameter_covariance: Floats
    """Their covariance by noise and prior, shape (P, P), in the order of ``parameters.layout``."""
    torsion_curves: tuple[TorsionCurve, ...]
    """Measured torque over deflection of every gear."""
    gears: tuple[Gear, ...]
    """Laws of the gears, one ``Gear`` per joint; laws that are not significant there are left out."""
    inflation: float = 1.0
    """Factor on the variances for the model's misfit, at least 1: ``misfit``, or with maximum likelihood
    the misfit of the fundamental."""
    fundamental: tuple[float, float] = (1.0, 0.0)
    """Misfit of the fundamentals, and their degrees of freedom (0 for linear estimators)."""
    odd_misfit: float = np.inf
    """Misfit of the odd harmonics of sines, including the fundamentals; infinite where not known."""
    gravity: Floats | None = None
    """Fitted gravity stiffness with each M2 of ``prior``, (p, n, n); None: as given."""
    contradicts_inertias: bool = False
    """Whether other inertias explain motions far better than those given as exact."""
    times_logged_noise: float = 0.0
    """Variance of the torque noise in the residual of motions, over that in the logged torques."""
    unseen_error: Floats | float = 0.0
    """Part of ``standard_error`` that comes from truncated friction harmonics, (2n,)."""
    prior_error: Floats | float = 0.0
    """Part of ``standard_error`` that comes from the prior of inertias and torque scales, (2n,)."""
    choice_error: Floats | float = 0.0
    """Part of ``standard_error`` that comes from other models that explain the data equally, (2n,)."""
    torque_scale: Floats | float = 1.0
    """True over logged torque, shape (n,); 1 where it was exact."""
    friction: Friction | None = None
    """Friction, if it was fitted."""
    delay: float | None = None
    """Delay of the torque in addition to that of the records, if it was fitted, s."""
    delay_error: float | None = None
    """Standard error of ``delay``, s."""
    candidates: tuple[Candidate, ...] = ()
    """Models that were compared, best first."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.K.size)

    @property
    def estimate(self) -> Floats:
        """K1 ... Kn, D1 ... Dn, shape (2n,), N·m/rad and N·m·s/rad."""
        return np.concatenate([self.K, self.D])

    @property
    def standard_error(self) -> Floats:
        """One standard error of ``estimate`` from all causes, shape (2n,); inf if undetermined."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def relative_error(self) -> Floats:
        """``standard_error`` over ``estimate``, shape (2n,)."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.standard_error / np.abs(self.estimate))

    @property
    def errors(self) -> Parameters:
        """Standard errors of all ``parameters`` by their names; of K and D those from all causes."""
        others = np.sqrt(np.diag(self.parameter_covariance))[2 * self.n :]
        return Parameters(self.parameters.layout, np.concatenate([self.standard_error, others]))

    @property
    def noise_error(self) -> Floats:
        """Part of ``standard_error`` that comes from noise, shape (2n,)."""
        parts = (self.unseen_error, self.prior_error, self.choice_error)
        known = sum(np.square(part) for part in parts)
        with np.errstate(invalid="ignore"):  # infinite where nothing determines a parameter
            noise = np.nan_to_num(np.diag(self.covariance) - known, nan=np.inf, posinf=np.inf)
        return np.asarray(np.sqrt(np.maximum(noise, 0.0)))

    @property
    def inertia(self) -> Inertia | tuple[Inertia, ...]:
        """Fitted inertia, one or one per record as given; the given one where it was exact."""
        if not {"M", "M2"} & self.prior.blocks().keys():
            return self.prior.given
        return self.inertias[0] if isinstance(self.prior.given, Inertia) else self.inertias

    @property
    def correlation(self) -> Floats:
        """Correlation matrix of the estimates, shape (2n, 2n); undetermined ones are uncorrelated."""
        known = np.isfinite(self.standard_error)
        error = np.where(known & (self.standard_error > 0), self.standard_error, 1.0)
        covariance = np.where(np.outer(known, known), self.covariance, np.diag(~known * 1.0))
        return np.asarray(covariance / np.outer(error, error))

    @property
    def misfit(self) -> float:
        """Cost over its expected value: about 1 when noise explains the residual; 1 for one record."""
        return self.cost / self.expected_cost if self.expected_cost > 0 else 1.0

    @property
    def condition(self) -> float:
        """Condition number of A in equation (12) with its columns times D1, K1, D2, K2, ..."""
        error = self.errors.D
        damping = np.maximum(np.abs(self.D), np.where(np.isfinite(error), error, 0.0))
        p = np.stack([damping, np.abs(self.K)], axis=1)
        return float(np.linalg.cond(self.equations.matrix()[0] * p.ravel()))

    @property
    def elasticity(self) -> Elasticity:
        """K and D as a model; a damping negative by at most two standard errors becomes zero.

        Raises
        ------
        JointIdError
            When K or D is unphysical: the data or the inertias are wrong.
        """
        D_error = self.errors.D
        for j in range(self.n):
            if self.K[j] <= 0:
                raise JointIdError(
                    f"K{j + 1} is {minus(f'{self.K[j]:.4g}')} N·m/rad; a spring needs K > 0. Check the "
                    f"sign and unit of the torque of joint {j + 1}, the gear ratios, and M and M2."
                )
            if self.D[j] < -AGREEING * D_error[j]:
                raise JointIdError(
                    f"D{j + 1} is {minus(f'{self.D[j]:.4g}')} N·m·s/rad; a damper needs D ≥ 0. "
                    "The torque probably leads or lags: check torque_hold and torque_delay_s."
                )
        return Elasticity(K=self.K, D=np.maximum(self.D, 0.0))


def undetermined(fit: ElasticityFit) -> np.ndarray:
    """Whether each K is within two standard errors of zero, shape (n,)."""
    return np.asarray(~(AGREEING * fit.standard_error[: fit.n] < fit.K))


def likelihood_fit(
    method: str,
    choice: Choice,
    estimate: LikelihoodEstimate,
    equations: SpringEquations,
    prior: InertiaPrior,
    curves: tuple[TorsionCurve, ...],
) -> ElasticityFit:
    """Result of a chosen model, from joint equations with the compensated phasors."""
    layout, p = estimate.layout, estimate.named
    error = np.sqrt(np.diag(estimate.covariance))
    fit = replace(
        made_fit(method, estimate, equations, estimate.phasors, prior, curves),
        candidates=choice.candidates,
        inertias=estimate.inertias,
        fundamental=estimate.fundamental,
        odd_misfit=estimate.odd_misfit,
        gravity=estimate.gravity,
        torque_scale=np.broadcast_to(p.torque_scale, p.K.shape),
        prior_error=np.sqrt(np.diag(estimate.prior_covariance)[layout.span("K", "D")]),
        choice_error=np.sqrt(np.diag(choice.spread)),
    )
    fit = replace(fit, covariance=fit.covariance + choice.spread)
    if "viscous" in layout:
        fit = replace(fit, friction=_friction(estimate))
    if "coulomb" in layout:
        braked = 4 / np.pi * np.abs(p["coulomb"])
        size = _sliding_torque(estimate.phasors.torque_size, braked)
        share = np.divide(braked, size, out=np.where(braked > 0, np.inf, 0.0), where=size > 0)
        motion, none = estimate.phasors.motion, np.zeros_like(share)
        of_sines = none if motion.all() else share
        of_motions = share**2 if motion.any() and not estimate.rests_in_noise else none
        by_K = _UNSEEN_K * of_sines + _TURNING_K * of_motions
        by_D = _UNSEEN_D * of_sines + _TURNING_D * of_motions
        floor = np.concatenate([by_K * np.abs(fit.K), by_D * np.abs(fit.D)])
        fit = replace(
            fit,
            covariance=fit.covariance + np.diag(floor**2),
            unseen_error=floor,
        )
    if "delay" in layout:
        fit = replace(fit, delay=p.delay, delay_error=float(error[layout["delay"]].item()))
    return fit


def _sliding_torque(size: Floats, braked: Floats) -> Floats:
    """Median torque of every joint, (n,), of sizes (r, n), where it exceeds the joint's friction.

    In the other records friction holds the joint, so that they carry no information on its K and D.
    """
    slides = size > braked
    slides |= ~slides.any(axis=0)
    return np.asarray(np.nanmedian(np.where(slides, size, np.nan), axis=0))


def _friction(estimate: LikelihoodEstimate) -> Friction:
    """Friction after long moves, at which presliding friction is fully developed."""
    p, C = estimate.named, estimate.covariance
    if "coulomb" not in p.layout:
        none, error = np.zeros(p.K.size), np.sqrt(np.diag(C)[p.layout["viscous"]])
        return Friction(none, p["viscous"], np.concatenate([none, error]))
    coulomb, variance = p["coulomb"], np.diag(C).copy()
    if "motor_presliding" in p.layout:
        own, rising = p.layout["coulomb"], p.layout["motor_presliding"]
        coulomb = coulomb + p["motor_presliding"]
        variance[own] += variance[rising] + 2 * np.diag(C[own, rising])
    error = np.sqrt(variance[p.layout.span("coulomb", "viscous")])
    return Friction(coulomb, p["viscous"], error, p.effect("load"), estimate.friction_change)


def made_fit(
    method: str,
    estimate: Estimate,
    equations: SpringEquations,
    phasors: Phasors,
    prior: InertiaPrior,
    curves: tuple[TorsionCurve, ...],
) -> ElasticityFit:
    """Result of any estimator, with the error by noise and prior only."""
    K, D = estimate.named.K, estimate.named.D
    squared = equations.omega[:, None] ** 2
    noise = np.sqrt(np.abs(np.einsum("rjj->rj", equations.residual_covariance(K, D))))
    if isinstance(estimate, LikelihoodEstimate):
        covariance, inflation = estimate.elasticity_covariance, estimate.inflation  # already included
        every = estimate.covariance
    else:
        inflation = max(1.0, estimate.misfit)
        covariance = every = estimate.elasticity_covariance * inflation
    return ElasticityFit(
        method=method,
        K=K,
        D=D,
        covariance=covariance,
        inflation=inflation,
        residual=-equations.residual(K, D) / squared,
        residual_noise=noise / squared,
        cost=estimate.cost,
        expected_cost=estimate.expected_cost,
        equations=equations,
        phasors=phasors,
        prior=prior,
        inertias=tuple(prior.inertias(prior.M, prior.M2)),
        parameters=estimate.named,
        parameter_covariance=every,
        torsion_curves=curves,
        gears=fitted_gears(estimate.named, every, curves),
    )
