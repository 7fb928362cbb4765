"""Errors from the scatter of records: as stated on right data, larger where records disagree."""

from __future__ import annotations

import numpy as np
import pytest
from plants import BAND_HZ, PAPER, SERIAL, campaign, circular, noisy, plant_phasors, random_covariance
from random_cases import tries

from jointid import Inertia, Phasors, identify_elasticity
from jointid.estimation.estimators.levenberg_marquardt import quadratic
from jointid.estimation.estimators.maximum_likelihood import Misfit
from jointid.estimation.estimators.whitened_residual import WhitenedResidual, widened_covariance
from jointid.uncertainty.chosen_model import fitted_problem


def drawn(seed: int, share: float, extra: float) -> Phasors:
    """Noise of 0.1 % of the signals; in a share of the records ``extra`` times as much, not stated."""
    clean = plant_phasors(SERIAL, PAPER, *campaign(BAND_HZ, 2))
    rng = np.random.default_rng(seed)
    covariance = np.array([random_covariance(rng, 1e-3 * np.abs(z)) for z in clean.z])
    error = circular(rng, covariance, 1)[0]
    worse = rng.random(len(error)) < share
    error[worse] *= extra
    return noisy(clean, covariance, error)


def errors(phasors: Phasors, std: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Error of K and D, stated and widened standard error, each (4,)."""
    rng = np.random.default_rng(int(1e6 * abs(phasors.q[0, 0])) % 1000)
    off = 1 + min(std, 0.05) * rng.standard_normal(5)
    M2 = SERIAL.M2 * [[off[2], off[3]], [off[3], off[4]]]
    fit = identify_elasticity(
        phasors, Inertia(SERIAL.M * off[:2], M2), method="maximum-likelihood", inertia_std=std
    )
    problem, p = fitted_problem(phasors, fit), fit.parameters.vector
    residual = WhitenedResidual.of(problem, p, np.ones(problem.s.shape[1]))
    misfit = Misfit.of(residual, p, quadratic(residual, p)[2])
    residual = WhitenedResidual.of(problem, p, misfit.scale)
    C = fit.parameter_covariance
    weight = problem.prior_residual(p)[1]
    wide = widened_covariance(residual, C, (C * weight) @ C)
    assert np.all(np.linalg.eigvalsh(wide / np.sqrt(np.outer(np.diag(C), np.diag(C)))) > -1e-9)
    truth = np.r_[PAPER.K, PAPER.D]
    return fit.estimate - truth, fit.standard_error, np.sqrt(np.diag(wide)[:4])


@pytest.mark.parametrize("std", [0.0, 0.05])
def test_right_errors_are_not_widened(std: float) -> None:
    widened = 0
    for seed in range(30):
        _, stated, wide = errors(drawn(seed, 0.0, 1.0), std)
        widened += bool(np.any(wide > stated))
        assert np.all(wide >= stated)
        assert np.all(wide < 2 * stated)
    assert widened <= 1


@pytest.mark.parametrize("std", [0.0, 0.05])
def test_records_that_disagree_widen_the_errors(std: float) -> None:
    """The misfit is below the inflation that the harmonics' mean gives, since few records are off."""
    off, stated, wide = (
        np.array(part)
        for part in zip(
            *(errors(drawn(seed, 0.2, 20.0), std) for seed in range(tries(15, long=30))), strict=True
        )
    )
    before, after = (np.sqrt(np.mean((off / error) ** 2)) for error in (stated, wide))
    assert np.mean(np.abs(off / wide) < 1.96) > 0.88
    assert after < before
    assert after < 1.4


def test_few_records_show_no_scatter() -> None:
    phasors = drawn(0, 0.0, 1.0).select([4, 5, 9])
    _, stated, wide = errors(phasors, 0.05)
    assert np.array_equal(stated, wide)
