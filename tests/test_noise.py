"""Noise of the phasors by a common model of the sensors, from drawn variances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants import BAND_HZ, ONE, ONE_SPRING, PAPER, SERIAL, campaign, plant_phasors
from scipy.special import digamma

from jointid.estimation.estimators.noise import (
    Noise,
    _further_variance,
    _prior_degrees_of_freedom,
    _sensor_variances,
    _torque_variances,
    floored,
    moderated_noise,
)


def test_variances_of_sensors_follow_from_those_of_residuals() -> None:
    """Exactly where they fit; one sensor is exact, and a record without motion says nothing."""
    rng = np.random.default_rng(1)
    gains = rng.uniform(0.1, 2, (9, 2, 2, 4)) * [1e6, 1e5, 1, 1]
    true = np.array([[3e-9, 1e-8, 4e-3, 0.0], [1e-9, 0.0, 1e-3, 2e-2]])
    variances = np.einsum("rhjc,hc->rhj", gains, true)
    np.testing.assert_allclose(_sensor_variances(gains, variances), true, rtol=1e-6, atol=1e-12)
    gains[4], variances[4] = 1e9, 0.0
    np.testing.assert_allclose(_sensor_variances(gains, variances), true, rtol=1e-6, atol=1e-12)


def test_variances_of_sensors_are_unbiased_and_not_negative() -> None:
    """Of exponential powers; weights by the powers themselves would halve them."""
    rng = np.random.default_rng(2)
    gains = rng.uniform(0.1, 2, (3000, 1, 1, 2))
    variances = gains @ [1.0, 3.0] * rng.exponential(size=(3000, 1, 1))
    assert _sensor_variances(gains, variances)[0] == pytest.approx([1.0, 3.0], rel=0.15)
    odd = np.array([[[[1.0, 2.0]]], [[[1.0, 1.0]]]])  # solved by −1 and 2
    assert _sensor_variances(odd, np.array([[[3.0]], [[1.0]]])).min() == 0.0


def test_a_further_variance_is_found_beside_known_ones() -> None:
    rng = np.random.default_rng(3)
    own, others = rng.uniform(0.5, 2, 4000), rng.uniform(0, 3, 4000)
    power = (others + 2.0 * own) * rng.exponential(size=4000)
    share = np.ones(4000)
    assert _further_variance(power, own, others, share) == pytest.approx(2.0, rel=0.1)
    # Known noise that explains more than all leaves a millionth.
    low = 1e-6 * np.median(power / own)
    assert _further_variance(power, own, others + 1e3, share) == pytest.approx(low)
    assert _further_variance(*np.zeros((4, 0))) == 0.0


def test_a_further_variance_is_the_most_likely_one() -> None:
    """Of exponential powers, each line with its share: the likelihood is flat there."""
    rng = np.random.default_rng(8)
    own, others = rng.uniform(0.2, 5, 300), rng.uniform(0, 9, 300)
    power, share = (others + 2.0 * own) * rng.exponential(size=300), rng.uniform(0.1, 1, 300)
    found = _further_variance(power, own, others, share)
    variance = others + found * own
    slope = share * own * (power - variance) / variance**2
    assert abs(slope.sum()) < 1e-4 * np.abs(slope).sum()


def test_noise_of_a_single_record_of_few_periods_has_no_correlation() -> None:
    """There is no model of others to shrink towards: weights from so few degrees would be singular."""
    base = plant_phasors(ONE, ONE_SPRING, np.array([8.0]), np.ones((1, 1)))
    covariance = np.array([[[[4e-10, 1e-6j], [-1e-6j, 9e-3]]]])
    for freedom, kept in ((3.0, 4.0), (3.1, 3.1)):
        phasors = replace(base, harmonic_covariance=covariance, degrees_of_freedom=np.full(1, freedom))
        M, arm = np.tile(ONE.M, (1, 1)), np.linalg.inv(ONE.M2)[None]
        noise = moderated_noise(phasors, M, arm, ONE_SPRING.K, ONE_SPRING.D)
        np.testing.assert_allclose(noise.degrees_of_freedom, kept)
        np.testing.assert_allclose(np.diag(noise.covariance[0, 0]).real, [4e-10, 9e-3])
        assert noise.covariance[0, 0, 0, 1] == pytest.approx(1e-6j * (freedom > 3), abs=1e-12)


def test_noise_of_a_torque_is_seen_where_that_of_the_angle_is_small() -> None:
    """Of a held joint only the lowest lines show it; the others hid it: misfit 3.3 of perfect data."""
    rng = np.random.default_rng(5)
    blocks, width, columns = 24, 42, 14
    real, imaginary = rng.normal(0, np.sqrt(0.5), (2, blocks, width, columns + 1))
    local, noise = np.split(real + 1j * imaginary, [columns], axis=2)
    known = np.broadcast_to(1e-4 * np.geomspace(1, 1e4, width), (blocks, width))
    records = np.repeat([0, 1, 2], blocks // 3)
    variance = np.where(records == 2, 0.09, 0.01)
    residual = noise[..., 0] * np.sqrt(known + variance[:, None]) + 1e3 * local.sum(axis=2)
    found = _torque_variances(local, residual, np.ones(known.shape), known, records)
    for record, true in enumerate([0.01, 0.01, 0.09]):
        assert found.get(record, found[None]) == pytest.approx(true, rel=0.4)


@pytest.mark.parametrize("true", [1.5, 6.0])
def test_the_scatter_around_a_model_gives_its_degrees_of_freedom(true: float) -> None:
    """Variances of 20 degrees of freedom each; true ones inverse gamma with centred logarithms."""
    rng = np.random.default_rng(4)
    modelled = rng.uniform(1, 5, (3000, 2))
    scattered = modelled * np.exp(digamma(true)) / rng.gamma(true, size=modelled.shape)
    own = scattered * rng.gamma(20, size=modelled.shape) / 20
    prior, factor = _prior_degrees_of_freedom(own, modelled, np.full(3000, 20.0))
    assert prior == pytest.approx(true, rel=0.1)
    # The mean of the inverse of the true variances is that of the model times the factor.
    assert factor == pytest.approx(1 / np.mean(modelled / scattered), rel=0.1)


def test_variances_as_modelled_have_all_weight_on_the_model_and_others_none() -> None:
    rng = np.random.default_rng(5)
    modelled = np.ones((400, 1))
    freedom = np.full(400, 20.0)
    alike = rng.gamma(20, size=(400, 1)) / 20
    prior, factor = _prior_degrees_of_freedom(alike, modelled, freedom)
    assert prior > 100
    assert factor == pytest.approx(1.0, abs=0.02)
    wild = np.exp(9 * rng.standard_normal((400, 1)))
    assert _prior_degrees_of_freedom(wild, modelled, freedom) == (0.0, 1.0)
    few = np.ones((4, 1))
    few[3:] = 0  # without noise
    assert _prior_degrees_of_freedom(few, few, freedom[:4]) == (1000.0, 1.0)
    few[2:] = 0
    assert _prior_degrees_of_freedom(few, few, freedom[:4]) == (0.0, 1.0)


def test_no_sensor_is_better_than_nine_digits() -> None:
    """A signal that is zero throughout has the floor of the largest of its kind."""
    z = np.array([[[1.0 + 0j, 0.0, 5.0, 2.0]], [[-3.0, 0.0, 1.0, 4.0j]]])
    found = floored(np.zeros((2, 1, 4, 4), complex), z)
    np.testing.assert_allclose(np.sqrt(found[1, 0].real), 1e-9 * np.diag([3.0, 3.0, 5.0, 4.0]))


def test_weights_from_estimated_covariances_cost_variance() -> None:
    """2 × 2 Wishart matrices of 9 degrees of freedom: 9/7 and 81/48."""
    noise = Noise(np.eye(4, dtype=complex)[None, None], np.array([9.0]))
    assert noise.inverse_bias == pytest.approx([9 / 7])
    assert noise.weight_penalty == pytest.approx([81 / 48])


def test_noise_as_modelled_stays_as_it_is() -> None:
    """Sensors of known variance, some in proportion to the torque, beside known rounding."""
    base = plant_phasors(SERIAL, PAPER, *campaign(BAND_HZ, 2))
    r, rng = base.omega.size, np.random.default_rng(6)
    z = np.stack([base.z, 0.1 * base.z[:, ::-1]], axis=1)
    duration, size = rng.uniform(1, 9, r), np.abs(base.tau) / np.abs(base.tau).max(axis=0)
    sensors = np.array([[3e-9, 1e-8, 4e-5, 1e-5], [1e-9, 2e-9, 2e-5, 3e-5]])
    density = np.tile(sensors, (r, 1, 1))
    density[..., 2:] += np.array([[2e-4, 3e-4], [1e-4, 5e-4]]) * size[:, None] ** 2
    rounding = rng.uniform(1e-10, 2e-10, density.shape)
    variance = density / duration[:, None, None] + rounding
    phasors = replace(
        base,
        harmonics=z,
        harmonic_covariance=variance[..., None] * np.eye(4).astype(complex),
        harmonic_rounding=rounding,
        degrees_of_freedom=np.full(r, 20.0),
        duration_s=duration,
    )
    M, arm = np.tile(SERIAL.M, (r, 1)), np.tile(np.linalg.inv(SERIAL.M2), (r, 1, 1))
    noise = moderated_noise(phasors, M, arm, PAPER.K, PAPER.D)
    found = np.einsum("rhjj->rhj", noise.covariance).real
    np.testing.assert_allclose(found, variance, rtol=1e-4)
    assert np.abs(noise.covariance * (1 - np.eye(4))).max() < 1e-12 * variance.max()
    np.testing.assert_allclose(noise.degrees_of_freedom, 1020.0)
    # Of few degrees of freedom, a record has those of the model; correlations of its own weigh little.
    coupled = phasors.harmonic_covariance.copy()
    own = np.sqrt(density[..., 0] * density[..., 2]) / duration[:, None]
    coupled[..., 0, 2] = coupled[..., 2, 0] = 0.5 * own
    some = moderated_noise(replace(phasors, harmonic_covariance=coupled), M, arm, PAPER.K, PAPER.D)
    share = 20.0 / some.degrees_of_freedom
    np.testing.assert_allclose(some.covariance[..., 0, 2].real, share[:, None] * 0.5 * own, rtol=1e-9)
