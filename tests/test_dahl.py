"""Dahl's hysteresis over samples."""

import numpy as np
import pytest

from jointid.gears.dahl import DahlSteps, dahl
from jointid.gears.laws import GearLaws
from jointid.gears.torque_spread import average_dahl, periodic_dahl, spread


@pytest.mark.parametrize("presliding", [0.03, 0.1])
def test_few_samples_show_the_turns_between_them(presliding: float) -> None:
    """Without them, z came 3° late at 24 samples a period; K of motions was up to 0.5 % low."""
    found = []
    for samples in (24, 4800):
        turn = np.arange(4 * samples) / samples
        z = dahl(np.sin(2 * np.pi * turn + 0.1)[None], np.array([[1 / presliding]]))[0]
        last = slice(3 * samples, None)
        found.append(np.mean(z[last] * np.exp(-2j * np.pi * turn[last])))
    assert found[0] / found[1] == pytest.approx(1, abs=0.006)  # 0.05 and 0.02 before


def test_a_motion_from_its_middle_slides_from_the_start() -> None:
    turn = np.arange(2000) / 1000
    moving, resting = (
        dahl(wave(2 * np.pi * turn)[None], np.array([[50.0]]))[0] for wave in (np.sin, np.cos)
    )
    assert moving[0] == 1
    assert np.abs(moving[:1000] - moving[1000:]).max() < 1e-9
    assert abs(resting[0]) < 0.05


def test_loops_of_joints_do_not_depend_on_each_other_and_scale_with_their_presliding() -> None:
    """From rest, slow and sliding starts of two parts."""
    turn = 2 * np.pi * np.arange(400) / 130
    delta = np.stack([np.cos(turn), 0.2 * np.sin(turn + 1.54), 3 * np.sin(turn)])
    sharpness, starts = np.array([[4.0], [9.0], [0.5]]), np.isin(np.arange(400), [0, 1, 200, 201])
    both = dahl(delta, sharpness, starts)
    assert np.all(np.abs(both[:2, 0]) < 0.9)
    for j in range(3):
        alone = dahl(-7 * delta[j : j + 1], sharpness[j : j + 1] / 7, starts)
        np.testing.assert_allclose(both[j], -alone[0], atol=1e-12)


def test_the_derivatives_are_those_of_the_states() -> None:
    rng = np.random.default_rng(0)
    delta = np.cumsum(np.sin(np.arange(60) / 3 + rng.normal(0, 0.3, (2, 60))), axis=1)
    starts, sharpness = np.isin(np.arange(60), [0, 1, 30, 31]), np.array([[0.7], [2.0]])
    z = dahl(delta, sharpness, starts)
    steps = DahlSteps.of(delta, z, sharpness, starts)
    assert np.abs(steps.z - z[:, 1:]).max() < 1e-12
    move = 1e-6 * rng.standard_normal((2, 60))
    moved = DahlSteps.of(delta + move, z, sharpness, starts).z - steps.z
    change = np.diff(move, axis=1)
    expected = steps.by_move * change
    expected[:, 1:] += steps.by_earlier[:, 1:] * change[:, :-1]
    assert np.abs(moved - expected).max() < 1e-9
    assert DahlSteps.of(delta, z + move, sharpness, starts).z[:, 2:28] == pytest.approx(
        (steps.z + steps.by_z * move[:, :-1])[:, 2:28], abs=1e-12
    )


def test_a_period_of_dahl_continues_itself() -> None:
    """After some periods from any state, z is the periodic solution."""
    turn = 2 * np.pi * np.arange(250) / 250
    delta = np.stack([np.sin(turn) + 0.3 * np.sin(3 * turn + 1), 0.5 * np.cos(turn)])
    sharpness = np.array([[0.8], [40.0]])
    z, found = np.array([0.9, -0.9]), np.zeros((2, 250))
    for _ in range(9):
        for k in range(250):  # from each sample to the next one
            found[:, k] = z
            move = delta[:, (k + 1) % 250] - delta[:, k]
            sign = np.sign(move)
            z = sign + (z - sign) * np.exp(-np.abs(move) * sharpness[:, 0])
    np.testing.assert_allclose(periodic_dahl(delta, sharpness), found, atol=1e-6)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-6, 0.3])
def test_the_mean_over_a_step_is_that_of_many_small_ones(size: float) -> None:
    """A gear at rest had the whole torque of the loop, and small moves lost ten digits."""
    turn = np.repeat(np.arange(40), 500) + np.tile(np.arange(500) / 500, 40)
    corners = np.append(size * np.sin(2 * np.pi * np.arange(40) / 40 + 0.3), 0)
    corners[-1] = corners[0]
    fine = np.interp(turn, np.arange(41), corners)[None]
    sharpness = np.array([[3.0]])
    z = periodic_dahl(fine, sharpness)[0].reshape(40, 500)
    expected = np.roll((z.sum(axis=1) + 0.5 * (np.roll(z, -1, axis=0)[:, 0] - z[:, 0])) / 500, 1)
    found = average_dahl(corners[None, :-1], sharpness)[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-4 * size)


@pytest.mark.parametrize("loops", [False, True])
def test_the_spread_of_a_torque_is_its_derivative(loops: bool) -> None:
    """Mean, sines and cosines of the torque by those of the deflection, against small changes."""
    m, H, points = 2, 5, 4096
    level, presliding = np.full((1, 1), 0.8 * loops), np.full((1, 1), 0.3)
    none = np.zeros((1, 1))
    pair = (none, none)
    laws = GearLaws.made(none + 2.0, none + 0.7, none, level, presliding, pair, pair)
    turn = 2 * np.pi * np.arange(points) / points
    sines, cosines = (wave(np.outer([1, 2], turn)) for wave in (np.sin, np.cos))
    waves = np.concatenate([np.ones((1, points)), sines, cosines])
    size = np.array([0.1, 1.0, 0.2, 0.1, -0.3])

    def torque(size: np.ndarray) -> np.ndarray:
        delta = size @ waves
        z = periodic_dahl(delta[None], laws.sharpness)[0] if loops else 0 * delta
        bins = np.fft.rfft(0.7 * delta**3 + laws.level[0, 0] * z) / points
        return np.array([bins[0].real, *(-2 * bins[1 : H + 1].imag), *(2 * bins[1 : H + 1].real)])

    delta = (size @ waves)[None, None]
    found = spread(laws, laws.smooth_slope(delta), delta, m, H, np.ones((1, 1), bool))[0]
    by_change = [(torque(size + step) - torque(size - step)) / 2e-4 for step in 1e-4 * np.eye(5)]
    np.testing.assert_allclose(found, by_change, atol=0.01 if loops else 1e-6)
