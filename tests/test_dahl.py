"""Dahl's hysteresis over samples."""

import numpy as np
import pytest

from jointid.gears.dahl import DahlSteps, dahl


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
