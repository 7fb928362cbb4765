"""Identification of stiffness and damping from phasors, equations (8)-(15), by several estimators."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jointid.arrays import Complexes
from jointid.errors import JointIdError
from jointid.estimation.candidates import Model
from jointid.estimation.elasticity import ElasticityFit, likelihood_fit, made_fit
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.joint_equations import (
    SpringEquations,
    balance,
    noise_of,
    spring_equations,
    wind_up,
)
from jointid.estimation.estimators.linear_fit import LINEAR, Estimate, prior_covariance, weighted
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.parameters import Parameters
from jointid.estimation.estimators.problem import ideal_compliance
from jointid.estimation.model_fits import evaluated
from jointid.estimation.model_selection import choose_model
from jointid.gears.torsion_curve import TorsionCurve, torsion_curves
from jointid.joints import Inertia
from jointid.motion.friction import friction_waveforms
from jointid.phasors.extract import Phasors
from jointid.small_matrices import one_thread

METHODS = {
    "auto": "maximum likelihood, with the simplest model consistent with the noise",
    "maximum-likelihood": "maximum likelihood of one model, by default without friction and delay",
    "weighted": "weighted least squares, weights from the noise of each record",
    "least-squares": "the paper's pseudo-inverse, equations (13)–(14)",
    "explicit": "the paper's explicit solution, equation (15) as printed",
}
"""Estimators by name, with a one-line description."""


def identify_elasticity(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    *,
    method: str = "auto",
    friction: bool = False,
    delay: bool = False,
    inertia_std: float | None = None,
    torque_std: float | None = None,
    gear: str = "auto",
) -> ElasticityFit:
    """Identify K and D of every joint, equations (8)-(15); one record suffices in principle.

    Parameters
    ----------
    phasors : Phasors
        r records of n joints.
    inertia : Inertia or sequence of Inertia
        Known rigid-body inertia, motor side; one per record for records of several poses.
    method : {"auto", "maximum-likelihood", "weighted", "least-squares", "explicit"}
        See ``METHODS``. "auto" compares models with and without friction and delay by an information
        criterion; if no model can be fitted, it falls back to "weighted".
    friction : bool, default False
        Fit Coulomb and viscous friction at the motors together with K and D (with "auto": in every
        model compared).
    delay : bool, default False
        Fit a delay of the torque likewise.
    inertia_std : float, optional
        Relative standard deviation of the given inertias M and M2: 0.05 for 5 %, ``math.inf`` for start
        values only. "auto" and "maximum-likelihood" fit them; the others keep them and widen the
        errors. By default they are exact, as in the paper.
    torque_std : float, optional
        The same for the torque constant of each joint.
    gear : {"auto", "linear"}, default "auto"
        Whether "auto" fits nonlinear gears where the data require them.

    Returns
    -------
    ElasticityFit
        K, D and their covariance, motor side, with friction, delay, inertias and gears as fitted.

    Raises
    ------
    JointIdError
        When a joint is not excited in any record, the method is unknown, or the records do not separate
        the parameters.
    """
    phasors.require_records()
    prior = InertiaPrior.of(inertia, *phasors.q.shape, inertia_std=inertia_std, torque_std=torque_std)
    return identify_each(phasors, prior, [method], friction=friction, delay=delay, gear=gear)[method]


def require_method(method: str) -> None:
    """Refuse an estimator that is not one of ``METHODS``."""
    if method not in METHODS:
        raise JointIdError(f'method = "{method:.60}" is not known. Methods: {", ".join(METHODS)}.')


def require_gear(gear: str) -> None:
    """Refuse a choice of gear laws that is neither "auto" nor "linear"."""
    if gear not in ("auto", "linear"):
        raise JointIdError(f'gear = {gear!r:.60} is not known: expected "auto" or "linear".')


def identify_each(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia] | InertiaPrior,
    methods: Iterable[str],
    *,
    friction: bool = False,
    delay: bool = False,
    gear: str = "auto",
    gives_up: Callable[[], bool] = bool,
    gives_up_late: Callable[[], bool] = bool,
    start: Parameters | None = None,
    first: Model | None = None,
    most: float = np.inf,
) -> dict[str, ElasticityFit]:
    """Identify K and D by several estimators from the same equations.

    Parameters, errors and each fit as in :func:`identify_elasticity`. ``gives_up`` is asked where the
    first models are far from the data, ``gives_up_late`` where those with a law of the gears are, too;
    if true, the search ends. ``start`` holds the parameters of a similar fit, from which the models
    start in place of a linear estimate, ``first`` its model, and ``most`` is the misfit above which a
    fit has no use.
    """
    names = list(dict.fromkeys(methods))
    for method in names:
        require_method(method)
    require_gear(gear)
    prior = InertiaPrior.of(inertia, *phasors.q.shape)
    equations = spring_equations(phasors, prior.inertias(prior.M, prior.M2))
    ends = gives_up, gives_up_late
    data = _Data(phasors, prior, equations, friction, delay, gear, *ends, start, first, most)
    return {name: data.fit(name) for name in names}


@dataclass(frozen=True, eq=False)
class _Data:
    """Equations and settings of several fits."""

    phasors: Phasors
    prior: InertiaPrior
    equations: SpringEquations
    friction: bool
    delay: bool
    gear: str
    gives_up: Callable[[], bool]
    gives_up_late: Callable[[], bool]
    start: Parameters | None
    first: Model | None
    most: float

    def fit(self, method: str) -> ElasticityFit:
        """Fit by one estimator."""
        if method in LINEAR:
            if self.friction or self.delay:
                raise JointIdError(
                    f'method = "{method}" fits K and D only; friction and delay need '
                    '"maximum-likelihood".'
                )
            return self._linear(method, LINEAR[method](self.equations))
        linear, noise = weighted(self.equations), self.equations.noise
        with one_thread():
            choice = choose_model(
                self.phasors,
                self.prior,
                self.start or linear.p,
                noise,
                friction=self.friction,
                delay=self.delay,
                exactly=method != "auto",
                gear=self.gear,
                gives_up=self.gives_up,
                gives_up_late=self.gives_up_late,
                first=() if self.first is None else (self.first,),
                most=self.most,
            )
            estimate = choice.estimate
            if isinstance(estimate, LikelihoodEstimate):
                fitted = evaluated(
                    self.phasors, self.prior, choice.model, estimate, noise, estimate.scale
                )
                rests: np.ndarray | bool = False
                if choice.model.reversal is not None:
                    rests = np.asarray(friction_waveforms(self.phasors, None).stationary.all(axis=0))
                try:
                    equations = spring_equations(
                        estimate.phasors, list(estimate.inertias), noise=noise, rests=rests
                    )
                except JointIdError as error:  # friction takes all torque of a joint
                    estimate = error
                else:
                    curves = fitted.torsion_curves()
                    return likelihood_fit(method, choice, estimate, equations, self.prior, curves)
        if method == "auto":  # a fit with a large misfit lets the verdict name the cause
            return replace(self._linear("weighted", linear), candidates=choice.candidates)
        raise estimate

    def _linear(self, method: str, estimate: Estimate) -> ElasticityFit:
        phasors, prior = self.phasors, self.prior
        fit = made_fit(method, estimate, self.equations, phasors, prior, self.linear_curves)
        if not prior.blocks():
            return fit
        by_prior = prior_covariance(method, phasors, prior, self.equations.noise)
        whole = fit.covariance + by_prior
        by_prior_error = np.sqrt(np.diag(by_prior))
        return replace(fit, covariance=whole, parameter_covariance=whole, prior_error=by_prior_error)

    @cached_property
    def linear_curves(self) -> tuple[TorsionCurve, ...]:
        """Torsion curves with the inertias as given, and without friction."""
        phasors, prior = self.phasors, self.prior
        orders = np.arange(1, phasors.harmonics.shape[1] + 1)
        s: Complexes = np.asarray(1j * phasors.omega[:, None] * orders)
        own: Complexes = np.asarray((s * s)[..., None] * prior.M[prior.rotor, None])
        arm = ideal_compliance(prior, prior.M2, prior.gravity, s)
        by = balance(own, np.ones_like(own))
        rows, z = (wind_up(by, arm), by), phasors.harmonics[..., None]
        deflection, torque = curves = np.stack([(each @ z)[..., 0] for each in rows])
        noise, every = noise_of(rows, phasors.harmonic_covariance), np.ones(torque.shape, bool)
        return torsion_curves(s, deflection, torque, noise, curves, every)
