"""Errors from the scatter of records: as stated on right data, larger where records disagree."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plants import BAND_HZ, PAPER, SERIAL, campaign, circular, noisy, plant_phasors, random_covariance
from random_cases import tries
from scipy.special import chdtri

from jointid import Inertia, Phasors, identify_elasticity
from jointid.estimation.estimators import whitened_residual
from jointid.estimation.estimators.levenberg_marquardt import quadratic
from jointid.estimation.estimators.maximum_likelihood import Misfit
from jointid.estimation.estimators.whitened_residual import (
    WhitenedResidual,
    _shifts,
    repeated_covariance,
    widened_covariance,
)
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
    for seed in range(tries(12, nightly=30)):
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


def test_the_change_by_each_record_is_that_of_least_squares() -> None:
    """Of rows of noise of variance ½ its covariance is as expected, and the sum that of the estimate."""
    rng = np.random.default_rng(3)
    columns = (
        rng.standard_normal((5, 6, 3)) * [1e3, 1.0, 1e-3] * np.array([3.0, 1, 1, 2, 1])[:, None, None]
    )
    J = columns.reshape(30, 3)
    normal = J.T @ J
    left = np.eye(30) - J @ np.linalg.solve(normal, J.T)

    def shifts(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residual: Any = SimpleNamespace(rows=rows.reshape(5, 6), visible_columns=columns)
        return _shifts(residual, 0.5 * np.linalg.inv(normal), np.arange(5))

    each = np.array([shifts(rows)[0] for rows in left])  # of each row of noise
    expected = shifts(np.zeros(30))[1]
    found = 0.5 * np.einsum("arp,arq->rpq", each, each)
    size = np.sqrt(np.diag(np.linalg.inv(normal)))
    unit = np.outer(size, size)
    np.testing.assert_allclose(found / unit, expected / unit, atol=1e-9)
    np.testing.assert_allclose(2 * expected.sum(axis=0) / unit, np.linalg.inv(normal) / unit, atol=1e-9)
    # Without a record, the estimate moves by its change over the root of what leverage leaves.
    one = rng.standard_normal(30)
    rows = left @ one
    alone = np.array([[[1.0]]]) * columns[:1, :, :1]
    gain = float((alone**2).sum())
    residual: Any = SimpleNamespace(rows=rows[:6][None], visible_columns=alone)
    (moved,), _ = _shifts(residual, np.array([[0.5 / (4 * gain)]]), np.arange(1))
    assert moved == pytest.approx(alone[0, :, 0] @ rows[:6] / (4 * gain) / np.sqrt(1 - 0.25))


@pytest.mark.parametrize("records", [3, 8])
def test_scatter_beyond_chance_widens_each_parameter_by_its_own(
    monkeypatch: pytest.MonkeyPatch, records: int
) -> None:
    """Two joints, a fifth parameter of the prior alone, and noise that explains the scatter or not."""
    rng, noise = np.random.default_rng(4), np.diag([4.0, 1.0, 9.0, 0.25, 0.0])
    prior = np.diag([1.0, 0, 0, 0, 2.0])
    shift = rng.standard_normal((records, 5))
    shift -= shift.mean(axis=0)
    found = records / (records - 1) * (shift**2).sum(axis=0)
    expected = np.tile(noise / records, (records, 1, 1))
    problem = SimpleNamespace(n=2, ends=None)
    residual: Any = SimpleNamespace(rows=shift, at=SimpleNamespace(problem=problem))
    freedom = 16 / (records * 4 / records**2)  # trace² over squares of equal shares
    segments = SimpleNamespace(logs=np.zeros(records, int))  # of one motion
    for ends, chance in ((None, 1e-4), (segments, 0.05)):
        problem.ends = ends
        limit = chdtri(freedom, chance) / freedom
        ratio = np.ones(5)
        for factor in (0.99, 1.01):
            size = np.sqrt(
                factor * limit * 4 / (found[:4] / np.diag(noise)[:4]).sum() * records / (records - 1)
            )
            monkeypatch.setattr(whitened_residual, "_shifts", lambda *_, s=size: (s * shift, expected))
            wide = widened_covariance(residual, noise + prior, prior)
            ratio[:4] = np.sqrt(np.maximum(size**2 * found[:4] / np.diag(noise)[:4], 1.0))
            if factor < 1 or records < 4:
                ratio[:] = 1.0
            np.testing.assert_allclose(wide, prior + np.outer(ratio, ratio) * noise)


def test_rounding_that_repeats_moves_the_estimate_by_its_gradient() -> None:
    """Of independent errors of the angles in every record, to first order."""
    phasors = drawn(1, 0.0, 1.0)
    fit = identify_elasticity(phasors, SERIAL, method="maximum-likelihood")
    problem, p = fitted_problem(phasors, fit), fit.parameters.vector
    repeated = np.random.default_rng(2).uniform(1e-12, 3e-12, phasors.q.shape)
    residual = WhitenedResidual.of(replace(problem, repeated=repeated), p, np.ones(1))
    C, J = fit.parameter_covariance, residual.visible_columns
    errors, total, square = residual.at.E[..., :2] * np.sqrt(repeated)[:, None, None], 0 * C, 0.0
    for part in (errors, 1j * errors):  # of circular errors, real and imaginary parts are half
        rows = residual.projection.rows(part)
        square += 0.5 * (rows**2).sum()
        moved = 2 * C @ (J.swapaxes(1, 2) @ rows)
        total += 0.5 * np.einsum("rpk,rqk->pq", moved, moved)
    found, share = repeated_covariance(residual, C)
    np.testing.assert_allclose(found, total, rtol=1e-6, atol=1e-9 * np.abs(total).max())
    assert share == pytest.approx(2 * square / problem.rows)
    none = repeated_covariance(replace(residual, at=replace(residual.at, problem=problem)), C)
    assert not none[0].any()
    assert none[1] == 0.0


def test_the_misfit_is_that_at_the_estimate_with_all_weights() -> None:
    """The weights of a misfit change the estimate beside a prior; the stated cost is without them."""
    phasors = drawn(1, 1.0, 6.0)
    given = Inertia(1.1 * SERIAL.M, 0.95 * SERIAL.M2)
    fit = identify_elasticity(phasors, given, method="maximum-likelihood", inertia_std=0.02)
    residual = WhitenedResidual.of(fitted_problem(phasors, fit), fit.parameters.vector)
    assert fit.misfit > 4
    assert fit.cost == pytest.approx(residual.cost, rel=1e-9)
