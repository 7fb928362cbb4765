"""Score tests: reduction of the cost by one more part, without its fit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from jointid.arrays import Complexes, Floats
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.levenberg_marquardt import quadratic
from jointid.estimation.estimators.maximum_likelihood import LikelihoodEstimate
from jointid.estimation.estimators.noise import Noise
from jointid.estimation.estimators.parameters import (
    CHANGES,
    EFFECTS,
    FILTERS,
    PERIODIC_EFFECTS,
    Parameters,
)
from jointid.estimation.estimators.problem import fitted_layout, make_problem
from jointid.estimation.estimators.whitened_residual import (
    DRIVEN_LAWS,
    WhitenedResidual,
    near_solution,
    with_law_signals,
)
from jointid.motion.friction import FrictionWaveforms, friction_waveforms, gear_torque_of
from jointid.motion.per_turn import turn_waves
from jointid.phasors.extract import Phasors
from jointid.phasors.periods import samples_of

_FILTER = 3e-3
"""Time constant of a filter where its score is evaluated beside a delay, as of ``Problem.start``."""
_CLEARLY, _ALONE, _CHANCE = 0.5, 10.0, 1e-6
"""Share of the misfit beyond noise that a change of the gears must explain to count, as robots that
change are rare; ratio to any other part from which half of that suffices (link modes in the band had 5);
and probability that it does on a robot that does not change."""
_FEWEST = 8
"""Rows from which such changes are sought."""
_RIDGE = 1e-12
"""Added to the diagonal of the normalised normal matrix, so that rounding does not make it singular."""
_RANK = 1e-6
"""Relative singular value below which motions do not separate cosine and sine."""


@dataclass(frozen=True, eq=False)
class Score:
    """Effect of a further part of the model, to second order (Rao's score test)."""

    gain: float
    """Decrease of the cost."""
    count: int
    """Number of its parameters."""
    possible: tuple[float, Floats]
    """Gain, and change of K1 ... Kn, D1 ... Dn, shape (2n,), by the values alone that have a sign that
    they can have."""
    value: Floats
    """Its most likely parameters, shape (count,); squares of a filter's beside a delay or lags."""
    information: Floats
    """Inverse covariance of its parameters, shape (count, count)."""
    slope: Floats
    """Change of K1 ... Kn, D1 ... Dn with its parameters, shape (2n, count)."""
    unit: Floats
    """Value at which a nonlinear law is as large as the linear gear, 1 for other parts, (count,)."""

    def penalised(self, rows: int) -> float:
        """Decrease of half the information criterion: of the cost, less the penalty."""
        return self.gain - 0.5 * self.count * float(np.log(rows))


class PerTurnScores(NamedTuple):
    """Decrease of the cost by an effect of each joint that repeats with the turns of its motor."""

    gain: Floats
    """By waves of k orders, shape (k, n)."""
    phase: Floats
    """Their phases, rad, (k, n)."""
    straight: Floats
    """Decrease by a straight line in place of a wave, (n,): alike where a motor turns little."""


def scores(
    phasors: Phasors,
    prior: InertiaPrior,
    estimate: LikelihoodEstimate,
    friction: FrictionWaveforms | None,
    noise: Noise,
    parts: Sequence[str],
) -> dict[str, Score]:
    """Score of each further part, "friction", "delay" or a key of ``EFFECTS``, by one evaluation.

    An estimate so far off that its derivatives overflow, or that no motion determines, has no scores.

    Beside a delay or lags, filters act by the square of their time constant: their slope at zero is that
    of the delay. It is evaluated where the time constant is not zero, and the square extrapolates.
    """
    fitted = estimate.layout
    effects = [name for name in EFFECTS if name in fitted or name in parts]
    delay = "delay" in fitted or "delay" in parts
    layout = fitted_layout(prior, friction, delay, effects)
    prior = replace(prior, gravity=estimate.gravity)
    problem = make_problem(phasors, prior, layout, estimate.named, friction, noise)
    problem, p = near_solution(problem, estimate.wound), problem.start(estimate.named, _FILTER)
    if any(name in fitted for name in DRIVEN_LAWS):
        problem = with_law_signals(problem, p)
    with np.errstate(all="ignore"):
        try:
            residual = WhitenedResidual.of(problem, p)
        except np.linalg.LinAlgError:
            return {}
        _, gradient, normal = quadratic(residual, p)
    if not np.isfinite(normal).all():
        return {}
    size = np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
    normal, gradient = normal / np.outer(size, size), gradient / size
    base = np.concatenate([np.arange(layout.size)[layout[block.name]] for block in fitted.blocks])
    inner = normal[np.ix_(base, base)] + _RIDGE * np.eye(base.size)
    late = "delay" in fitted or "lag" in fitted
    per_unit = 2 * _FILTER / problem.highest_rad_s
    units = {} if problem.laws is None else problem.laws.units(layout.named(p))
    found = {}
    for name in parts:
        squared = late and name in FILTERS
        positive = name in EFFECTS and (
            EFFECTS[name].positive or (squared and name == "position_filter")
        )
        own = np.setdiff1d(np.arange(layout.size)[layout.of_part(name)], base)
        step, gain, through, left = _further_step(gradient, normal, inner, base, own)
        possible = gain, through @ step / size[base]
        if positive and np.any(step > 0):
            some = own[step < 0]
            step_of_some, gain_of_some, through_some, _ = _further_step(
                gradient, normal, inner, base, some
            )
            possible = gain_of_some, through_some @ step_of_some / size[base]
        of_joints = slice(2 * prior.n)
        unit = size[own] / per_unit if squared else size[own]
        found[name] = Score(
            gain,
            own.size,
            (possible[0], possible[1][of_joints]),
            value=-step / unit,
            information=2 * left * np.outer(unit, unit),
            slope=-(through * unit / size[base][:, np.newaxis])[of_joints],
            unit=units.get(name, np.ones(own.size)),
        )
    return found


def scores_with_changes(
    phasors: Phasors,
    prior: InertiaPrior,
    estimate: LikelihoodEstimate,
    friction: FrictionWaveforms | None,
    noise: Noise,
    parts: Sequence[str],
) -> dict[str, Score]:
    """Scores of the parts, and of absent changes of the gears that explain more than any of them.

    None beside a link mode: further modes, which the model lacks, look like such changes.
    """
    may_change = phasors.omega.size >= _FEWEST and "link" not in estimate.layout
    sought = [n for n in CHANGES if may_change and n not in parts and n not in estimate.layout]
    found = scores(phasors, prior, estimate, friction, noise, [*parts, *sought])
    by_chance = 0.5 * chdtri(3 * prior.n, _CHANCE) * max(1.0, estimate.misfit)  # three per joint
    beyond_noise = estimate.cost - estimate.expected_cost
    others = max((found[name].gain for name in parts if name in found), default=0.0)
    most_of_it = min(_CLEARLY * beyond_noise, max(_ALONE * others, 0.5 * _CLEARLY * beyond_noise))
    least = max(by_chance, most_of_it, others)
    return {name: each for name, each in found.items() if name in parts or each.gain > least}


def scores_per_turn(
    phasors: Phasors,
    prior: InertiaPrior,
    near: Parameters,
    friction: FrictionWaveforms | None,
    noise: Noise,
    delay: bool,
    effects: Sequence[str],
    orders: Sequence[int],
) -> dict[str, PerTurnScores]:
    """Decrease of the cost by each periodic effect of each joint, beside a delay and other effects.

    K, D and all parameters are fitted along to first order from those given.
    """
    layout = fitted_layout(prior, friction, delay, effects)
    problem = make_problem(phasors, prior, layout, near, friction, noise)
    p = problem.start(near)
    residual = WhitenedResidual.of(with_law_signals(problem, p), p)
    n, size = prior.n, problem.layout.size
    base, _ = np.linalg.qr(residual.columns().reshape(-1, size))
    left = residual.rows.ravel()
    left = left - base @ (base.T @ left)

    def decrease(columns: Complexes) -> Floats:
        """Decrease, and factors up to a scale, for columns (r, H, n, c n) of c waves, (1 + c, n)."""
        rows = residual.projection.rows(columns).reshape(left.size, -1)
        rows -= base @ (base.T @ rows)
        found = []
        for j in range(n):
            own = rows[:, j::n]
            own = own / max(np.abs(own).max(), np.finfo(float).tiny)  # angles may be as small as 1e-300
            factors = np.linalg.lstsq(own, -left, rcond=_RANK)[0]
            found.append([(left**2).sum() - ((left + own @ factors) ** 2).sum(), *factors])
        return np.array(found).T

    sliding = friction or friction_waveforms(phasors, None)
    torque = gear_torque_of(sliding, phasors, prior.motors(phasors, near), loaded=False)
    X, eye, q = residual.at.X, np.eye(n), phasors.harmonics[..., None, :n]
    # That of the model: waves of the measured one hold, and would explain, the residual.
    through = residual.at.torque - residual.at.r
    modelled = samples_of(through[~phasors.motion].swapaxes(1, 2), torque.sines.shape[2])
    torque = replace(torque, sines=modelled + torque.sines.mean(axis=2, keepdims=True))
    straight = {"ripple": -q * eye, "transmission": X * q + through[..., None, :] * eye}
    found = {name: np.zeros((3, len(orders), n)) for name in PERIODIC_EFFECTS}
    for place, k in enumerate(orders):
        cosine, sine = (wave[..., None, :] for wave in turn_waves(phasors, np.full(n, k)))
        by_cosine, by_sine = (k * w[..., None, :] for w in turn_waves(phasors, np.full(n, k), torque))
        waves = {
            "ripple": [-cosine * eye, -sine * eye],
            "transmission": [X * cosine - by_sine * eye, X * sine + by_cosine * eye],
        }
        for name, each in waves.items():
            found[name][:, place] = decrease(np.concatenate(each, axis=3))
    return {
        name: PerTurnScores(gain, np.arctan2(of_cosine, of_sine), decrease(straight[name])[0])
        for name, (gain, of_cosine, of_sine) in found.items()
    }


def _further_step(
    gradient: Floats, normal: Floats, inner: Floats, base: np.ndarray, own: np.ndarray
) -> tuple[Floats, float, Floats, Floats]:
    """Step against further parameters, decrease of the cost, change of the base per step, curvature."""
    coupling = normal[np.ix_(base, own)]
    through = np.linalg.solve(inner, coupling)
    left = normal[np.ix_(own, own)] - coupling.T @ through + _RIDGE * np.eye(own.size)
    pull = gradient[own] - through.T @ gradient[base]
    step = np.linalg.solve(left, pull)
    return step, float(pull @ step), through, left
