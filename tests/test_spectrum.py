"""Frequency and amplitude of a sine from its spectrum."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_cases import examples

from jointid import JointIdError, SineRecord
from jointid.phasors.spectrum import amplitude_spectrum, frequency_found, largest_line_hz, vertex


@examples(60, derandomize=True)
@given(st.floats(0.9, 40.0), st.floats(0.0, 6.28), st.floats(-5.0, 5.0), st.floats(-1.0, 1.0))
def test_the_largest_line_is_the_sine_also_on_a_drift(
    frequency: float, phase: float, offset: float, drift: float
) -> None:
    time = np.arange(2000) / 200.0
    signal = np.sin(2 * np.pi * frequency * time + phase) + offset + drift * time
    assert largest_line_hz(time, signal) == pytest.approx(frequency, abs=0.02)


def test_the_amplitude_is_that_of_the_sine() -> None:
    time = np.arange(1000) / 100.0
    sine = 0.3 * np.sin(2 * np.pi * 5 * time)
    for clock, signal in ((time, sine), (time + 50, sine + 2 * time)):  # a drift, on a late clock
        frequency, amplitude = amplitude_spectrum(clock, signal)
        assert frequency[np.argmax(amplitude)] == pytest.approx(5.0)
        assert amplitude.max() == pytest.approx(0.3, rel=0.01)


def test_a_flat_spectrum_has_no_vertex_beside_its_line() -> None:
    assert vertex(np.ones(3), 1) == 0.0


def test_jitter_does_not_hide_the_sine() -> None:
    rng = np.random.default_rng(2)
    time = np.arange(1000) / 100.0 + rng.uniform(0, 0.7e-3, 1000)
    assert largest_line_hz(time, np.sin(2 * np.pi * time)) == pytest.approx(1.0, abs=0.01)


def test_a_constant_signal_has_no_frequency() -> None:
    time = np.arange(100) / 100.0
    with pytest.raises(JointIdError, match="signal is constant"):
        largest_line_hz(time, np.zeros(100))


def test_a_few_samples_have_no_spectrum() -> None:
    with pytest.raises(JointIdError, match="at least 8 samples"):
        amplitude_spectrum(np.arange(5.0), np.arange(5.0))
    with pytest.raises(JointIdError, match="there are 0 over 0 s"):
        amplitude_spectrum(np.zeros(0), np.zeros(0))
    with pytest.raises(JointIdError, match="over 0 s"):
        amplitude_spectrum(np.zeros(20), np.arange(20.0))
    with pytest.raises(JointIdError, match="over -7 s"):
        amplitude_spectrum(np.arange(8.0)[::-1], np.arange(8.0))
    assert amplitude_spectrum(np.arange(8.0), np.arange(8.0))[0].tolist() == [0.125, 0.25, 0.375, 0.5]


def frequency_of_local(local: list[complex], *, rest: float = 0.0, size: float = 1.0) -> float:
    """``frequency_found`` of 4 periods of 2 Hz from the phasors of blocks, beside a residual at 3 Hz."""
    time = np.arange(200) / 100
    theta = rest * np.sqrt(2) * np.sin(2 * np.pi * 3.0 * time)
    fit: Any = SimpleNamespace(
        harmonics=np.array([[1.0, 1.0], [0.1, 0.1]]),
        fundamental=np.array([1.0j, 1.0]),
        offset=np.zeros(2),
        local=size * np.array(local)[:, None] * np.ones(2),
        at=lambda time_s, _: np.zeros((time_s.size, 2)),
    )
    return frequency_found(SineRecord(2.0, time, theta, theta), fit)


def test_the_frequency_is_corrected_by_the_phase_drift_of_the_blocks() -> None:
    """A phase that rises by 0.2 rad from block to block is 0.2 · 4 rad over the record."""
    drift = [1j * 1j * 0.1 * k for k in (-1.5, -0.5, 0.5, 1.5)]
    assert frequency_of_local(drift) == pytest.approx(2.0 + 0.1 * 4 / (2 * np.pi * 2.0))
    assert frequency_of_local([0, 0, 0]) == 2.0


@pytest.mark.parametrize(
    ("blocks", "rest", "found"), [(2, 0.29, 2.0), (2, 0.31, 3.0), (3, 0.31, 2.0), (1, 0.31, 3.0)]
)
def test_few_blocks_of_another_signal_have_the_frequency_of_its_largest_line(
    blocks: int, rest: float, found: float
) -> None:
    assert frequency_of_local([0] * blocks, rest=rest) == pytest.approx(found, abs=0.01)


@pytest.mark.parametrize(("size", "found"), [(0.49, 2.0), (0.51, 3.0)])
def test_blocks_unlike_the_record_have_the_frequency_of_the_largest_line(
    size: float, found: float
) -> None:
    local = [1j, -1j, -1j, 1j]
    assert frequency_of_local(local, rest=0.1, size=size) == pytest.approx(found, abs=0.01)
