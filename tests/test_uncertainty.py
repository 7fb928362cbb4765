"""Error bars: the share of the inertias, and agreement with independent checks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plants import (
    BAND_HZ,
    PAPER,
    PARALLELOGRAM,
    ROBOTS,
    SERIAL,
    campaign,
    circular,
    noisy,
    plant_phasors,
    random_covariance,
    rubbing,
    scaled,
    steady_records,
)
from random_cases import tries

from jointid import (
    ElasticityFit,
    Inertia,
    JointIdError,
    Phasors,
    Study,
    analyse,
    estimate_transfer_matrix,
    extract_phasors,
    identify_elasticity,
    simulate_motion,
    spring_equations,
)
from jointid.estimation.estimators.inertia_prior import InertiaPrior
from jointid.estimation.estimators.whitened_residual import WhitenedResidual
from jointid.simulation.motion import Motion
from jointid.uncertainty.chosen_model import fitted_problem
from jointid.uncertainty.information import prior_influence
from jointid.uncertainty.plan import predict_standard_errors, suggest_records
from jointid.uncertainty.planned_records import planned_records
from jointid.uncertainty.poses import fits_by_pose
from jointid.uncertainty.resampling import bootstrap, jackknife

METHODS = ["least-squares", "explicit", "weighted", "maximum-likelihood"]


@cache
def measured(n: int = 2, noise: float = 1.0) -> Phasors:
    inertia, elasticity = ROBOTS[n]
    return extract_phasors(
        steady_records(
            inertia, elasticity, *campaign(BAND_HZ, n), noise=(1e-5 * noise, 3e-3 * noise),
            periods=20.37, seed=5,
        )
    )  # fmt: skip


def fitted(phasors: Phasors, inertia: Inertia, method: str, **model: float) -> ElasticityFit:
    return identify_elasticity(phasors, inertia, method=method, **model)


# ------------------------------------------------------------------------- influence of given values


def changed(prior: InertiaPrior, place: int, by: float) -> Inertia:
    """The given inertia with one of its values changed, in the order of ``PriorInfluence``."""
    values = np.concatenate([prior.M[0], prior.lower[0]])
    values[place] += by
    return Inertia(values[: prior.n], prior.symmetric(values[None, prior.n :])[0])


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("method", METHODS)
def test_influence_predicts_what_other_given_inertias_do(n: int, method: str) -> None:
    """Few records, so that the prior matters, against fits to other given inertias."""
    inertia, elasticity = ROBOTS[n]
    phasors = extract_phasors(
        steady_records(inertia, elasticity, *campaign([4.0, 11.0], n), noise=(1e-5, 3e-3), seed=3)
    )
    fit = fitted(phasors, inertia, method, inertia_std=0.01)
    found = prior_influence(fit)
    error = np.linalg.norm(found.shift, axis=1)
    assert len(found.names) == found.std.size == n + n * (n + 1) // 2
    for place, std in enumerate(found.std):
        up, down = (
            fitted(phasors, changed(fit.prior, place, by), method, inertia_std=0.01).estimate
            for by in (std, -std)
        )
        assert np.allclose((up - down) / 2, found.shift[:, place], atol=0.05 * error, rtol=0.05)


@pytest.mark.parametrize("method", METHODS)
def test_influences_make_the_prior_part_of_the_error(method: str) -> None:
    fit = fitted(measured(), SERIAL, method, inertia_std=0.05, torque_std=0.02)
    found = prior_influence(fit)
    assert found.names[-2:] == ("torque scale 1", "torque scale 2")
    assert np.allclose(np.linalg.norm(found.shift, axis=1), fit.prior_error, rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_scaling_law_of_the_influences(method: str) -> None:
    """K and D scale with torques and inertias together, so slopes by both sum to one."""
    phasors = measured()
    fit = fitted(phasors, SERIAL, method, inertia_std=0.02)
    found = prior_influence(fit)
    mean = np.concatenate([values.ravel() for values, _ in fit.prior.blocks().values()])
    total = found.shift @ (mean / found.std) / fit.estimate
    up = 1e-3
    stronger = scaled(phasors, np.array([1, 1, 1 + up, 1 + up]))
    other = fitted(stronger, SERIAL, method, inertia_std=0.02)
    by_torque = np.log(other.estimate / fit.estimate) / np.log(1 + up)
    assert np.allclose(total + by_torque, 1, atol=0.02)


def test_exact_values_have_no_influence_and_unknown_ones_neither() -> None:
    assert prior_influence(fitted(measured(), SERIAL, "maximum-likelihood")).names == ()
    unknown = fitted(measured(), SERIAL, "maximum-likelihood", inertia_std=np.inf)
    assert np.all(prior_influence(unknown).shift == 0)
    linear = prior_influence(fitted(measured(), SERIAL, "weighted", inertia_std=np.inf))
    assert np.isinf(np.linalg.norm(linear.shift, axis=1)).all()


def test_influences_of_inertias_belong_to_their_pose() -> None:
    """Rotors belong to all poses, arm inertias to one; a coupling of zero has an influence as well."""
    uncoupled = Inertia(M=SERIAL.M, M2=np.diag(np.diag(SERIAL.M2)))
    frequencies, torques = campaign(BAND_HZ, 2)
    records = steady_records(SERIAL, PAPER, frequencies, torques, periods=9.3)
    uneven = torques * np.tile([[1, 1], [1, 0.3]], (BAND_HZ.size, 1))  # equal ones would cancel it
    records += steady_records(uncoupled, PAPER, frequencies, uneven, periods=9.3)
    inertias = [SERIAL] * torques.shape[0] + [uncoupled] * torques.shape[0]
    phasors = extract_phasors(records)
    found = prior_influence(identify_elasticity(phasors, inertias, method="weighted", inertia_std=0.05))
    assert found.names == (
        "J_m1", "J_m2",
        "J_a1, pose 1", "J_12, pose 1", "J_a2, pose 1",
        "J_a1, pose 2", "J_12, pose 2", "J_a2, pose 2",
    )  # fmt: skip
    assert found.std[6] > 0
    assert np.all(np.abs(found.shift[:, 6]) > 1e-6)


# ------------------------------------------------------------------------------ jackknife, bootstrap


@pytest.mark.parametrize("method", METHODS)
def test_bootstrap_agrees_with_the_stated_errors(method: str) -> None:
    phasors = measured(noise=10.0)
    fit = fitted(phasors, SERIAL, method)
    result = bootstrap(phasors, SERIAL, fit, draws=tries(80, nightly=200), seed=1)
    ratio = result.standard_error / fit.standard_error
    assert np.all((ratio > 0.75) & (ratio < 1.33)), ratio
    assert np.all(np.abs(result.estimates.mean(axis=0) - fit.estimate) < 0.5 * fit.standard_error)
    low, high = result.interval(0.68)
    assert np.allclose((high - low) / 2, result.standard_error, rtol=0.25)
    assert result.failed == 0


@pytest.mark.parametrize(
    ("method", "std"),
    [
        ("least-squares", 0.3),
        ("weighted", 0.01),
        ("maximum-likelihood", 0.3),
        pytest.param("least-squares", 0.01, marks=pytest.mark.long),
        pytest.param("weighted", 0.3, marks=pytest.mark.long),
        pytest.param("maximum-likelihood", 0.01, marks=pytest.mark.long),
    ],
)
def test_bootstrap_draws_the_given_inertias_as_well(method: str, std: float) -> None:
    """The prior makes most of the error here; the scatter of the draws is the whole one."""
    phasors = extract_phasors(
        steady_records(SERIAL, PAPER, *campaign([4.0, 11.0], 2), noise=(1e-5, 3e-3), seed=1)
    )
    fit = fitted(phasors, SERIAL, method, inertia_std=std, torque_std=0.05)
    result = bootstrap(phasors, SERIAL, fit, draws=80, seed=4)
    assert np.all(fit.prior_error > fit.noise_error)
    assert np.allclose(result.standard_error / fit.standard_error, 1, atol=0.25)
    assert np.all(np.abs(result.estimates.mean(axis=0) - fit.estimate) < 0.5 * fit.standard_error)


@pytest.mark.parametrize("count", [1, 2])
def test_fits_with_motion_records_are_refused_in_words(count: int) -> None:
    inertia, elasticity = ROBOTS[1]
    records = simulate_motion(inertia, elasticity, Motion("random", 2.0, 30.0, 3.0), records=count)
    analysis = analyse(Study(records=records, inertia=inertia))
    fit = analysis.fit
    plan = planned_records(inertia, elasticity, [5.0], torque_Nm=[[1.0]])
    for phasors in (analysis.phasors, fit.phasors):
        given = phasors, inertia
        uses: list[tuple[Callable[..., object], tuple[object, ...]]] = [
            (bootstrap, (*given, fit)),
            (jackknife, (*given, fit)),
            (fits_by_pose, (*given, [None] * phasors.omega.size, fit)),
            (suggest_records, (*given, fit)),
            (predict_standard_errors, (plan, *given, fit)),
        ]
        for function, arguments in uses:
            with pytest.raises(JointIdError, match="sine records alone; this one has motion records"):
                function(*arguments)
    with pytest.raises(JointIdError, match="no sine record"):
        identify_elasticity(analysis.phasors, inertia)
    with pytest.raises(JointIdError, match="no sine record"):
        spring_equations(analysis.phasors, inertia)
    with pytest.raises(JointIdError, match="no sine record"):
        estimate_transfer_matrix(analysis.phasors)


def test_undetermined_parameters_stay_undetermined() -> None:
    """Draws of a parameter that nothing determines may scatter little; its error is infinite."""
    inertia, elasticity = ROBOTS[1]
    phasors = plant_phasors(inertia, elasticity, *campaign([5.0, 6.0, 7.0], 1))
    covariance = np.repeat(np.diag((1e-4 * np.abs(phasors.z[0])) ** 2)[None], 3, axis=0).astype(complex)
    noise = circular(np.random.default_rng(0), covariance, 1)[0]
    one = noisy(phasors, covariance, noise).select([1])
    fit = fitted(one, inertia, "maximum-likelihood", inertia_std=np.inf)
    assert np.all(np.isinf(fit.standard_error))
    assert np.all(np.isinf(bootstrap(one, inertia, fit, draws=10).standard_error))


def test_bootstrap_sees_the_bias_of_least_squares() -> None:
    """Noise in the angles biases least squares; scatter, bootstrap and theory have the same sign."""
    clean = plant_phasors(SERIAL, PAPER, *campaign(BAND_HZ, 2))
    rng = np.random.default_rng(3)
    size = 0.05 * np.abs(clean.z).mean(axis=0)
    covariance = np.repeat(random_covariance(rng, size)[None], len(clean.z), axis=0)
    draws = [
        identify_elasticity(noisy(clean, covariance, e), SERIAL, method="least-squares")
        for e in circular(rng, covariance, 400)
    ]
    true_bias = np.mean([np.r_[f.K, f.D] for f in draws], axis=0) - np.r_[PAPER.K, PAPER.D]
    start = noisy(clean, covariance, np.zeros(clean.z.shape))
    fit = identify_elasticity(start, SERIAL, method="least-squares")
    found = bootstrap(start, SERIAL, fit, draws=300).estimates.mean(axis=0) - fit.estimate
    scatter = np.std([np.r_[f.K, f.D] for f in draws], axis=0)
    clear = np.abs(true_bias) > 0.3 * scatter
    assert clear.any()
    assert np.allclose(found[clear], true_bias[clear], rtol=0.3)


def test_bootstrap_with_friction() -> None:
    phasors = extract_phasors(rubbing())
    fit = fitted(phasors, PARALLELOGRAM, "maximum-likelihood", friction=True)
    result = bootstrap(phasors, PARALLELOGRAM, fit, draws=25)
    ratio = result.standard_error / fit.noise_error
    assert np.all((ratio > 0.55) & (ratio < 1.8)), ratio


def test_bootstrap_is_repeatable_reports_and_stops() -> None:
    phasors = measured()
    fit = fitted(phasors, SERIAL, "weighted")
    seen: list[float] = []
    first = bootstrap(phasors, SERIAL, fit, draws=5, seed=7, progress=seen.append)
    second = bootstrap(phasors, SERIAL, fit, draws=5, seed=7)
    assert len(bootstrap(phasors, SERIAL, fit, draws=2, seed=7).estimates) == 2
    assert np.array_equal(first.estimates, second.estimates)
    assert seen == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])

    seen.clear()
    jackknife(phasors, SERIAL, fit, progress=seen.append)
    assert len(seen) == BAND_HZ.size
    assert seen[-1] == 1.0

    class StopError(Exception):
        pass

    def stop(_: float) -> None:
        raise StopError

    with pytest.raises(StopError):
        bootstrap(phasors, SERIAL, fit, draws=5, progress=stop)
    with pytest.raises(JointIdError, match="draws"):
        bootstrap(phasors, SERIAL, fit, draws=1)
    with pytest.raises(JointIdError, match="level"):
        first.interval(1.0)


@pytest.mark.parametrize("method", ["least-squares", "weighted", "maximum-likelihood"])
def test_jackknife_agrees_on_average(method: str) -> None:
    """The jackknife of a few frequencies is rough, so it is averaged over repetitions."""
    clean = plant_phasors(SERIAL, PAPER, *campaign(np.geomspace(3, 30, 12), 2))
    rng = np.random.default_rng(11)
    covariance = np.array([random_covariance(rng, 1e-3 * np.abs(z)) for z in clean.z])
    squares = []
    for error in circular(rng, covariance, 8):
        phasors = noisy(clean, covariance, error)
        fit = identify_elasticity(phasors, SERIAL, method=method)
        squares.append((jackknife(phasors, SERIAL, fit).standard_error / fit.standard_error) ** 2)
    ratio = np.sqrt(np.mean(squares, axis=0))
    assert np.all((ratio > 0.6) & (ratio < 1.8)), ratio


def test_jackknife_finds_the_frequency_that_is_off() -> None:
    frequencies, torques = campaign(BAND_HZ, 2)
    phasors = plant_phasors(SERIAL, PAPER, frequencies, torques)
    covariance = np.array([np.diag((1e-4 * np.abs(z)) ** 2) for z in phasors.z]).astype(complex)
    error = np.zeros(phasors.z.shape, complex)
    error[6:8] = 0.02 * phasors.z[6:8] * [1, 1, 0, 0]
    bad = noisy(phasors, covariance, error)
    result = jackknife(bad, SERIAL, identify_elasticity(bad, SERIAL, method="weighted"))
    assert result.frequency_hz == pytest.approx(BAND_HZ)
    away = np.abs(result.estimates / np.r_[PAPER.K, PAPER.D] - 1).max(axis=1)
    assert away[3] < 1e-6 < 1e-4 < np.delete(away, 3).min()  # without the culprit all is well
    few = bad.select(range(4))
    fit = identify_elasticity(few, SERIAL, method="weighted")
    with pytest.raises(JointIdError, match="at least 3"):
        jackknife(few, SERIAL, fit)
    enough = bad.select(range(6))
    fit = identify_elasticity(enough, SERIAL, method="weighted")
    assert np.isfinite(jackknife(enough, SERIAL, fit).standard_error).all()


def test_a_linear_fit_has_the_residual_of_the_fundamentals_alone() -> None:
    phasors = extract_phasors(rubbing(), harmonics=5)
    names = ("harmonics", "harmonic_covariance", "harmonic_rounding")
    first = replace(phasors, **{name: getattr(phasors, name)[:, :1] for name in names})
    fit, costs = identify_elasticity(phasors, PARALLELOGRAM, method="weighted"), []
    for each in (phasors, first):
        residual = WhitenedResidual.of(fitted_problem(each, fit), fit.parameters.vector)
        costs.append([residual.rows.size, residual.cost])
    assert costs[0] == pytest.approx(costs[1])


# -------------------------------------------------------------------------------------------- ellipses
