"""From phasors to stiffness and damping, equations (8)-(15) and beyond: one call, several estimators."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.estimation.candidates import Candidate, Choice
from jointid.estimation.joint_equations import SpringEquations, spring_equations
from jointid.estimation.likelihood import LikelihoodEstimate
from jointid.estimation.linear_fit import Estimate, explicit, least_squares, weighted
from jointid.estimation.model_selection import choose_model
from jointid.joints import Elasticity, Inertia
from jointid.phasors.extract import Phasors
from jointid.small_matrices import one_thread

METHODS = {
    "auto": "maximum likelihood, with the simplest model that the noise allows",
    "maximum-likelihood": "errors in variables; friction and delay on demand",
    "weighted": "weighted least squares, weights from the noise of each record",
    "least-squares": "the paper's pseudo-inverse, equations (13)-(14)",
    "explicit": "the paper's explicit solution, equation (15) as printed",
}
"""Estimators by name, with a line that says what each is."""

_UNSEEN_K, _UNSEEN_D = 5e-4, 1.5e-3
"""Relative error of K and D, per unit of Coulomb friction over torque, that the noise does not tell:
harmonics beyond the last, steps between samples; measured on simulated robots."""

_LINEAR = {"weighted": weighted, "least-squares": least_squares, "explicit": explicit}


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction at the motors, τ_effective = τ − coulomb · sign(θ̇) − viscous · θ̇."""

    coulomb: Floats
    """Shape (n,), N·m."""
    viscous: Floats
    """Shape (n,), N·m·s/rad."""
    standard_error: Floats
    """Of coulomb (n), then viscous (n), shape (2n,); 0 where nothing shows it."""


@dataclass(frozen=True, eq=False)
class ElasticityFit:
    """Stiffness and damping of n joints as found from r records."""

    method: str
    K: Floats
    """Stiffness, shape (n,), N·m/rad; negative when the data contradict the model."""
    D: Floats
    """Damping, shape (n,), N·m·s/rad."""
    covariance: Floats
    """Covariance of (K1 ... Kn, D1 ... Dn), shape (2n, 2n): the noise of the phasors carried through
    the estimator, times ``inflation``; with friction, what its unseen harmonics may do is added."""
    residual: Complexes
    """Spring torque that K and D leave unexplained, by record and joint, shape (r, n), N·m."""
    residual_noise: Floats
    """What noise alone would leave there (root of the complex variance), shape (r, n), N·m."""
    cost: float
    """Sum of the squared residual in units of its noise, over all that was fitted."""
    expected_cost: float
    """What ``cost`` is on average when the model is right and the noise as stated; 0 for one record."""
    equations: SpringEquations
    """The springs' equations, their torque freed from friction and delay where these were fitted."""
    phasors: Phasors
    """The phasors in these equations: those given, freed from friction and delay likewise."""
    inflation: float = 1.0
    """Factor by which the model's misfit widens the variances, at least 1: ``misfit``, or with maximum
    likelihood that of the fundamental."""
    unseen_error: Floats | float = 0.0
    """The part of ``standard_error`` that no noise makes: friction beyond the harmonics, (2n,)."""
    friction: Friction | None = None
    """Friction that was fitted together with K and D, if it was."""
    delay: float | None = None
    """Seconds by which the torque was found to lag beyond what the records state, if it was fitted."""
    delay_error: float | None = None
    """Standard error of ``delay``, s."""
    candidates: tuple[Candidate, ...] = ()
    """The models that were compared, best first."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.K.size)

    @property
    def standard_error(self) -> Floats:
        """Root of the covariance's diagonal, shape (2n,), order K1 ... Kn, D1 ... Dn."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def noise_error(self) -> Floats:
        """The part of ``standard_error`` that noise makes, shape (2n,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance) - np.square(self.unseen_error)))

    @property
    def correlation(self) -> Floats:
        """Correlation matrix of the estimates, shape (2n, 2n)."""
        error = np.where(self.standard_error > 0, self.standard_error, 1.0)
        return np.asarray(self.covariance / np.outer(error, error))

    @property
    def misfit(self) -> float:
        """Cost over its expected value: about 1 when noise explains the residual; 1 for one record."""
        return self.cost / self.expected_cost if self.expected_cost > 0 else 1.0

    @property
    def condition(self) -> float:
        """Condition number of A in equation (12), its columns in units of D1, K1, D2, K2, ..."""
        p = np.stack([np.maximum(np.abs(self.D), self.standard_error[self.n :]), np.abs(self.K)], axis=1)
        return float(np.linalg.cond(self.equations.matrix()[0] * p.ravel()))

    @property
    def elasticity(self) -> Elasticity:
        """K and D as a model; a damping that is negative within two standard errors counts as zero.

        Raises
        ------
        JointIdError
            When the estimate is no spring and damper, and so the data or the inertias are wrong.
        """
        n = self.n
        for j in range(n):
            if self.K[j] <= 0:
                raise JointIdError(
                    f"K{j + 1} comes out as {self.K[j]:.4g} N·m/rad, which is no spring. Check the "
                    f"sign and unit of the torque of joint {j + 1}, the gear ratios, and M and M2."
                )
            if self.D[j] < -2 * self.standard_error[n + j]:
                raise JointIdError(
                    f"D{j + 1} comes out as {self.D[j]:.4g} N·m·s/rad, which would feed energy into the "
                    "arm. The torque probably leads or lags: check torque_hold and torque_delay_s."
                )
        return Elasticity(K=self.K, D=np.maximum(self.D, 0.0))


def identify_elasticity(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    *,
    method: str = "auto",
    friction: bool = False,
    delay: bool = False,
) -> ElasticityFit:
    """Find K and D of every joint; one record suffices in principle.

    Parameters
    ----------
    phasors : Phasors
        r records of n joints.
    inertia : Inertia or sequence of Inertia
        Known rigid-body inertia, motor side; one per record when they come from several poses.
    method : {"auto", "maximum-likelihood", "weighted", "least-squares", "explicit"}
        See ``METHODS``. "auto" compares models with and without friction and delay and takes the one
        of the smallest information criterion; where none can be fitted, it is "weighted".
    friction : bool, default False
        Fit Coulomb and viscous friction at the motors together with K and D ("auto": always, rather
        than when the data ask for it).
    delay : bool, default False
        Fit a lag of the torque likewise.

    Raises
    ------
    JointIdError
        When a joint's spring is not deflected in any record, the method is not known, or the records
        cannot tell the parameters apart.
    """
    fits = identify_each(phasors, inertia, [method], friction=friction, delay=delay)
    return fits[method]


def identify_each(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    methods: Iterable[str],
    *,
    friction: bool = False,
    delay: bool = False,
) -> dict[str, ElasticityFit]:
    """Find K and D by several estimators, which share the equations.

    Parameters, errors and each of the fits as in :func:`identify_elasticity`.
    """
    names = list(dict.fromkeys(methods))
    for method in names:
        if method not in METHODS:
            raise JointIdError(f'method = "{method}" is not known. Methods: {", ".join(METHODS)}.')
    equations = spring_equations(phasors, inertia)
    return {name: _identified(name, phasors, inertia, equations, friction, delay) for name in names}


def _identified(
    method: str,
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    equations: SpringEquations,
    friction: bool,
    delay: bool,
) -> ElasticityFit:
    if method in _LINEAR:
        if friction or delay:
            raise JointIdError(
                f'method = "{method}" fits K and D only; friction and delay need "maximum-likelihood".'
            )
        return _fit(method, _LINEAR[method](equations), equations, phasors)
    linear = weighted(equations)
    asked = {"friction": friction, "delay": delay, "exactly": method != "auto"}
    with one_thread():
        choice = choose_model(phasors, inertia, linear.p, equations.noise, **asked)
    if isinstance(choice.estimate, LikelihoodEstimate):
        equations = spring_equations(choice.estimate.phasors, inertia, noise=equations.noise)
        return _likelihood_fit(method, choice, choice.estimate, equations)
    if method == "auto":  # better an answer that shows what is wrong than none
        return replace(_fit("weighted", linear, equations, phasors), candidates=choice.candidates)
    raise choice.estimate


def _likelihood_fit(
    method: str, choice: Choice, estimate: LikelihoodEstimate, equations: SpringEquations
) -> ElasticityFit:
    n, p = equations.a.shape[1], estimate.p
    fit = _fit(method, estimate, equations, estimate.phasors)
    if choice.model.reversal is not None:
        share = 4 / np.pi * np.abs(p[2 * n : 3 * n]) / np.median(np.abs(estimate.phasors.tau), axis=0)
        floor = np.concatenate([_UNSEEN_K * share * fit.K, _UNSEEN_D * share * fit.D])
        fit = replace(fit, covariance=fit.covariance + np.diag(floor**2), unseen_error=floor)
    error = np.sqrt(np.diag(estimate.covariance))
    friction = (
        Friction(p[2 * n : 3 * n], p[3 * n : 4 * n], error[2 * n : 4 * n])
        if choice.model.reversal is not None
        else None
    )
    return replace(
        fit,
        friction=friction,
        delay=float(p[-1]) if choice.model.delay else None,
        delay_error=float(error[-1]) if choice.model.delay else None,
        candidates=choice.candidates,
    )


def _fit(method: str, estimate: Estimate, equations: SpringEquations, phasors: Phasors) -> ElasticityFit:
    n = equations.a.shape[1]
    K, D = estimate.p[:n], estimate.p[n : 2 * n]
    squared = equations.omega[:, None] ** 2
    noise = np.sqrt(np.abs(np.einsum("rjj->rj", equations.residual_covariance(K, D))))
    covariance, inflation = estimate.covariance[: 2 * n, : 2 * n], 1.0
    if isinstance(estimate, LikelihoodEstimate):
        inflation = estimate.inflation  # which its covariance holds
    elif estimate.expected_cost > 0:
        inflation = max(1.0, estimate.cost / estimate.expected_cost)
        covariance = covariance * inflation
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
    )
