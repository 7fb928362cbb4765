"""Fisher information of measured and planned records on all parameters of a fit.

With the residual r of covariance V (``estimators.residual``), a record's information on the parameters
is 2 Re JᴴV⁻¹J with J = ∂r/∂p at the true signals and the free friction projected out. The information of
records and of the prior of the inertias adds up; the inverse of the sum is the Cramér–Rao bound.

With the information A of the records and B of the given inertias and torque scales, a fit has the
covariance C = (A + B)⁻¹, and its estimate moves by C B per unit of the given values. An error of one
standard deviation in the given value e moves K and D by C B^½, column e; all columns together make the
prior's part C B C of C.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.estimation.elasticity import ElasticityFit
from jointid.estimation.estimators.held_torque import HeldTorque
from jointid.estimation.estimators.inertia_prior import InertiaPrior, inertia_of_each
from jointid.estimation.estimators.levenberg_marquardt import quadratic
from jointid.estimation.estimators.linear_fit import LINEAR, carried_covariance, prior_slopes
from jointid.estimation.estimators.maximum_likelihood import Misfit
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import CHANGES, EFFECTS
from jointid.estimation.estimators.problem import Problem, fitted_layout
from jointid.estimation.estimators.residual import Residual
from jointid.estimation.estimators.whitened_residual import WhitenedResidual
from jointid.joints import Inertia
from jointid.motion.friction import FrictionWaveforms
from jointid.phasors.extract import Phasors
from jointid.small_matrices import determined_covariance
from jointid.uncertainty.chosen_model import chosen_friction, fitted_problem, require_sines

_EXACT = 1e12
"""Degrees of freedom of a given noise covariance."""
_ITERATIONS = 10
"""Iterations of the torque through a nonlinear gear at most."""
_SOLVED = 1e-4
"""Last change of a torque, relative to it, after which its iteration is complete.

An incomplete one appears as information on the torque scale, which no torque has.
"""
_DIVERGED = 100.0
"""Torque over that of the linear gear, beyond which the iteration diverges."""


@dataclass(frozen=True, eq=False)
class PlanningModel:
    """The fit with the inertia of the planned records, and the noise by frequency."""

    fit: ElasticityFit
    problem: Problem
    """Measured records; the prior's last inertia is that of the planned ones."""
    p: Floats
    """All parameters, shape (P,); those that only the planned records have are as given."""
    scale: Floats
    """Factor on each harmonic's variance for the model's misfit, shape (H,) or (r, H)."""
    pose: tuple[int, int]
    """Row of M and matrix of M2 of the planned records."""
    omega: Floats
    """Frequencies at which the noise is known, ascending, shape (f,), rad/s."""
    density: Complexes
    """Covariance of z = [q; τ] times the length of the record there, shape (f, 2n, 2n), per second."""

    @property
    def inertia(self) -> Inertia:
        """Inertia of the planned records, as fitted if measured records have it as well."""
        p = self.problem.layout.named(self.p)
        rotor, pose = self.pose
        gravity = self.problem.gravity(p)[pose]
        return Inertia(
            self.problem.rotor_inertia(p)[rotor], self.problem.arm_inertia(p)[pose], gravity=gravity
        )

    def noise(self, omega: Floats, duration_s: Floats) -> Complexes:
        """Covariance (..., 2n, 2n) of records of these frequencies and lengths, both shaped (...)."""
        place = np.interp(np.log(omega), np.log(self.omega), np.arange(self.omega.size))
        low = np.floor(place).astype(int)
        high = np.minimum(low + 1, self.omega.size - 1)
        share = (place - low)[..., None, None]
        mixed = (1 - share) * self.density[low] + share * self.density[high]
        return np.asarray(mixed / duration_s[..., None, None])

    @cached_property
    def today(self) -> Floats:
        """Information of all measured records, shape (P, P)."""
        return 2 * WhitenedResidual.of(self.problem, self.p, self.scale).information()

    def planned_information(self, omega: Floats, q: Complexes, duration_s: Floats) -> Floats:
        """Information of each planned record, shape (r, P, P).

        ``omega`` and ``duration_s`` have shape (r,); the torques follow from the motor angles ``q``,
        shape (r, n), by the model. A record whose torque the iteration does not find, such as one far
        beyond the measured range of a hardening gear, has no information.
        """
        n, laws = q.shape[1], self.problem.laws
        distorted = self.problem.friction is not None or laws is not None
        scales = np.atleast_2d(self.scale)[0]  # a harmonic of sines has one misfit in all records
        orders = np.arange(1, (scales.size if distorted else 1) + 1)
        s = np.asarray(1j * np.multiply.outer(omega, orders))
        C = self.noise(np.abs(s), np.broadcast_to(duration_s[:, None], s.shape))
        signals = np.zeros((*s.shape, 2 * n), complex)
        signals[:, 0, :n] = q
        problem = self._planned_problem(s, signals, C)
        waveforms = partial(self._waveforms, problem.prior, omega, signals, C, duration_s)
        planned_laws = laws and laws.planned(s, signals[..., :n])
        problem = replace(problem, friction=waveforms(), laws=planned_laws)
        scale = np.broadcast_to(self.problem.layout.named(self.p).torque_scale, n)
        has_load = "load" in self.problem.layout
        solved = lost = np.zeros(omega.size, bool)
        largest = np.full(omega.size, np.inf)
        for _ in range(_ITERATIONS if laws or has_load else 1):  # the torque leaves no residual
            left = Residual.at(problem, self.p)
            change = left.r / (left.lag * scale)
            signals[..., n:] -= change
            size = np.abs(signals[..., n:]).max(axis=(1, 2))
            lost = lost | ~(size < largest)
            largest = np.minimum(largest, _DIVERGED * size)
            solved = ~lost & (np.abs(change).max(axis=(1, 2)) <= _SOLVED * size)
            signals[lost, :, n:] = 0.0
            if has_load:
                problem = replace(problem, friction=waveforms())
            if np.all(solved | lost):
                break
        if laws or has_load:
            signals[~solved, :, n:] = 0.0
        residual = WhitenedResidual.of(problem, self.p, scales[: orders.size])
        columns = residual.columns(signals)
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.asarray(2 * columns.swapaxes(1, 2) @ columns)
        if laws or has_load:
            found[~solved] = 0.0
        if not np.isfinite(found).all():
            raise JointIdError(
                "The information of the planned records on K and D is not finite: check the units of "
                "torque, angle and inertias."
            )
        return found

    def largest_torque(self, omega: Floats, q: Complexes) -> Floats:
        """Largest torque for motor angles q of planned records, shape (r, n), N·m.

        All linear effects of the fit and its load-dependent friction are included, Coulomb friction and
        nonlinear gears are not. ``omega`` has shape (r,).
        """
        r, n = q.shape
        signals = np.concatenate([q, np.zeros_like(q)], axis=1)[:, None]
        noise = np.zeros((r, 1, 2 * n, 2 * n), complex)
        problem = self._planned_problem(np.asarray(1j * omega[:, None]), signals, noise)
        at = Residual.at(problem, self.p)
        drive = at.r / (at.lag * np.broadcast_to(at.p.torque_scale, n))
        through = at.p.effect("load") * np.abs(at.torque - at.r)
        return np.asarray((np.abs(drive) + through)[:, 0])

    def _planned_problem(self, s: Complexes, signals: Complexes, covariance: Complexes) -> Problem:
        """The problem of records with signals (r, H, 2n) at s (r, H), without friction and gear laws."""
        (r, H), (rotor, pose) = s.shape, self.pose
        prior = replace(self.problem.prior, rotor=np.full(r, rotor), pose=np.full(r, pose))
        return replace(
            self.problem,
            s=s,
            z=signals,
            noise=Noise(covariance, np.full(r, _EXACT)),
            known=np.ones(s.shape, bool),
            prior=prior,
            friction=None,
            group=np.broadcast_to(np.arange(H), s.shape),
            main=np.arange(H) == 0,
            held=HeldTorque.of(s, np.zeros(r), np.zeros(r)),
            laws=None,
        )

    def standard_errors(self, information: Floats) -> Floats:
        """Standard errors of K and D, shape (2n,), from the information of records and the prior.

        Errors in the fit beyond the bound (choice of the model, scatter of the records, an estimator
        without weights) fall with it; the part from truncated friction harmonics stays.
        """
        variance = np.diag(self.covariance(information)) * self._widening
        return np.asarray(np.sqrt(variance + np.square(self.fit.unseen_error)))

    @cached_property
    def _prior(self) -> Floats:
        return self.problem.prior_residual(self.p)[1]

    @cached_property
    def _widening(self) -> Floats:
        """Stated variance over the bound with the measured records, at least 1, shape (2n,)."""
        fit, today = self.fit, np.diag(self.covariance(self.today))
        stated = np.diag(fit.covariance) - np.square(fit.unseen_error)
        known = np.isfinite(stated) & np.isfinite(today) & (today > 0)
        return np.maximum(np.divide(stated, today, out=np.ones_like(today), where=known), 1.0)

    def covariance(self, information: Floats) -> Floats:
        """Covariance of K and D, shape (2n, 2n), from the information of records and the prior.

        A linear estimator keeps the given inertias; their errors are carried into K and D.
        """
        weight, own = self._prior, 2 * self.fit.n
        if self.fit.method not in LINEAR:
            return determined_covariance(information + weight)[:own, :own]
        noise = determined_covariance(information[:own, :own])
        slope = np.where(np.isfinite(noise), noise, 0.0) @ information[:own, own:]
        with np.errstate(divide="ignore"):
            return noise + carried_covariance(slope, np.diag(weight)[own:] ** -0.5)

    def _waveforms(
        self,
        prior: InertiaPrior,
        omega: Floats,
        harmonics: Complexes,
        C: Complexes,
        duration_s: Floats,
    ) -> FrictionWaveforms | None:
        """Friction waveforms of the chosen model for pure sines."""
        r, _, channels = harmonics.shape
        sines = Phasors(
            omega=omega,
            q=harmonics[:, 0, : channels // 2],
            tau=harmonics[:, 0, channels // 2 :],
            covariance=C[:, 0],
            degrees_of_freedom=np.full(r, _EXACT),
            duration_s=duration_s,
            harmonics=np.where(harmonics == 0, 1e-300, harmonics),  # known, but practically zero
            harmonic_covariance=C,
        )
        return chosen_friction(sines, self.fit, prior, self.problem.layout.named(self.p))


def planning_model(
    phasors: Phasors,
    inertia: Inertia | Sequence[Inertia],
    fit: ElasticityFit,
    planned_inertia: Inertia | None = None,
) -> PlanningModel:
    """Planning model of a fit, with the noise averaged over the records of each frequency.

    ``planned_inertia`` is that given at the pose of the planned records, by default that of the first
    record. Raises JointIdError when the fit has motion records.
    """
    remedy = "Plan a motion: jointid plan --motion sweep."
    require_sines(phasors, fit, "Planned sines need", remedy)
    each = inertia_of_each(inertia, *phasors.q.shape)
    measured = fitted_problem(phasors, fit)
    prior = fit.prior.like([*each, planned_inertia or each[0]], (len(each) + 1, fit.n))
    known = measured.prior.gravity  # as fitted; distinct inertias are in order of appearance
    prior = replace(prior, gravity=np.concatenate([known, prior.gravity[len(known) :]]))
    effects = [name for name in EFFECTS if name in measured.layout and name not in CHANGES]
    layout = fitted_layout(prior, measured.friction, fit.delay is not None, effects)
    p = replace(measured, prior=prior, layout=layout).start(fit.parameters)
    for block in fit.parameters.layout.blocks:
        if block.name in layout:  # the robot of the planned records does not change
            values, first = fit.parameters[block.name].ravel(), layout[block.name].start
            p[first : first + values.size] = values
    scale = np.full(1, fit.inflation)
    if fit.method not in LINEAR:
        vector = fit.parameters.vector
        residual = WhitenedResidual.of(measured, vector)
        scale = Misfit.of(residual, vector, quadratic(residual, vector)[2]).scale
    noise = fit.equations.noise  # weighted as in the estimator
    density = noise.covariance[:, 0] * (phasors.duration_s * noise.inverse_bias)[:, None, None]
    groups = phasors.by_frequency()
    rotor, pose = int(prior.rotor[-1]), int(prior.pose[-1])
    prior = replace(prior, rotor=prior.rotor[:-1], pose=prior.pose[:-1])
    return PlanningModel(
        fit=fit,
        problem=replace(measured, prior=prior, layout=layout),
        p=p,
        scale=scale,
        pose=(rotor, pose),
        omega=np.array([omega for omega, _ in groups]),
        density=np.array([density[group].mean(axis=0) for _, group in groups]),
    )


@dataclass(frozen=True, eq=False)
class PriorInfluence:
    """Influence of the given inertias and torque scales on K and D."""

    names: tuple[str, ...]
    """J_m1 ... J_mn, then J_a1, J_12, J_a2 ... of each pose, then the torque scales, E of them."""
    std: Floats
    """Standard deviations of the given values, shape (E,)."""
    shift: Floats
    """Change of K and D when a given value is larger by its standard deviation, shape (2n, E)."""


def prior_influence(fit: ElasticityFit) -> PriorInfluence:
    """Influence of each given value; empty if all are exact, zero for unknown ones, which are fitted.

    Raises JointIdError when a linear estimator has no result after a small change of an inertia.
    """
    prior, noise = fit.prior, fit.equations.noise
    names = fitted_layout(prior, None, False).labels[2 * fit.n :]
    std, shift = prior_shift(fit.method, fit.phasors, prior, noise, fit.parameter_covariance)
    return PriorInfluence(names, std, shift)


def prior_shift(
    method: str, phasors: Phasors, prior: InertiaPrior, noise: Noise, covariance: Floats
) -> tuple[Floats, Floats]:
    """``std`` and ``shift`` of ``PriorInfluence`` for an estimate with this covariance, shape (P, P)."""
    if method in LINEAR:
        slope, std = prior_slopes(method, phasors, prior, noise)
        with np.errstate(invalid="ignore"):
            return std, np.where(slope == 0, 0.0, slope * std)
    std = np.concatenate([np.zeros(0), *(std.ravel() for _, std in prior.blocks().values())])
    return std, covariance[: 2 * prior.n, len(covariance) - std.size :] / std
