"""Coherence of a record, its band, and distortion of a multisine, on signals of known content."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy import signal

from jointid import JointIdError, MotionRecord
from jointid.phasors.coherence import coherence, coherent_band
from jointid.phasors.distortion import distortion

RATE_HZ = 500.0
LINE_HZ = RATE_HZ / 400
"""Of records of 4000 samples: a tenth makes a segment."""
rng = np.random.default_rng


def record(theta: np.ndarray, tau: np.ndarray, start_s: float | None = None) -> MotionRecord:
    time = np.arange(len(theta)) / RATE_HZ
    return MotionRecord(time_s=time, theta_rad=theta, tau_Nm=tau, start_s=start_s)


def integrated(acceleration: np.ndarray) -> np.ndarray:
    """Angles whose second differences these are, and two samples more."""
    return np.vstack([np.zeros((2, acceleration.shape[1])), np.cumsum(np.cumsum(acceleration, 0), 0)])


def banded(low_hz: float, high_hz: float, size: float, seed: int, samples: int = 4000) -> np.ndarray:
    """Angle of constant velocity per line in a band, shape (samples, 1)."""
    frequency = np.fft.rfftfreq(samples, 1 / RATE_HZ)
    inside = (frequency >= low_hz) & (frequency <= high_hz)
    lines = np.zeros(frequency.size, complex)
    lines[inside] = rng(seed).normal(size=(inside.sum(), 2)) @ (1, 1j) / frequency[inside]
    return size * samples * np.fft.irfft(lines, samples)[:, None]


def moved(*angles: np.ndarray, noise: float = 1e-6, torque_noise: float = 0.0) -> MotionRecord:
    """The sum of angles, with the torques that a rotor of 1 kg·m² takes, and white noise on both."""
    theta = np.sum(angles, axis=0)
    tau = np.gradient(np.gradient(theta, 1 / RATE_HZ, axis=0), 1 / RATE_HZ, axis=0)
    white = rng(99).normal(size=(2, *theta.shape))
    return record(theta + noise * white[0], tau + torque_noise * tau.std() * white[1])


def test_coherence_is_the_share_of_the_motion_that_the_torques_explain() -> None:
    """White torques act on both motors; beside them other accelerations, of known power."""
    tau = rng(1).normal(size=(4000, 2)) * [1.0, 3.0]
    mixed = tau[1:-1] @ np.array([[1.0, 1.0], [2.0, 0.5]])  # of variance 37 and 3.25
    beside = rng(2).normal(size=mixed.shape) * np.sqrt([37.0 / 4, 3.25])
    found = coherence(record(integrated(mixed + beside), tau))
    np.testing.assert_allclose(found.frequency_hz, LINE_HZ * np.arange(2, 200))
    assert found.coherence.shape == found.above_floor.shape == (198, 2)
    np.testing.assert_allclose(found.coherence.mean(axis=0), [0.8, 0.5], atol=0.02)


def test_independent_signals_have_no_coherence() -> None:
    found = coherence(record(integrated(rng(3).normal(size=(3998, 2))), rng(4).normal(size=(4000, 2))))
    assert np.all(np.median(found.coherence, axis=0) < 0.05)
    assert found.coherence.min() == 0.0


def test_motion_caused_by_the_torque_alone_has_coherence_one() -> None:
    """Also where a torque is zero throughout, and where nothing moves there is none."""
    tau = rng(5).normal(size=(4000, 1)) * [1.0, 0.0]
    found = coherence(record(integrated(tau[1:-1] * [1.0, 0.0]), tau))
    assert found.coherence[:, 0].min() > 0.9999
    assert not found.coherence[:, 1].any()
    assert np.isinf(found.above_floor[:, 1]).all()


def test_the_noise_floor_is_that_of_white_encoder_noise() -> None:
    """As angle, not acceleration, at every frequency; ten times the noise is 100 times the floor."""
    theta = rng(6).normal(size=(4000, 2))
    theta[:, 1] += 10 * banded(20.0, 60.0, 1.0, 1)[:, 0] / banded(20.0, 60.0, 1.0, 1).std()
    found = coherence(record(theta, rng(7).normal(size=(4000, 2))))
    quarters = np.array_split(found.above_floor[:, 0], 4)
    np.testing.assert_allclose([part.mean() for part in quarters], 1.0, atol=0.3)
    inside = (found.frequency_hz > 22) & (found.frequency_hz < 58)
    power = found.above_floor[inside, 1] * found.frequency_hz[inside] ** 2
    width = 40.0 / (RATE_HZ / 2)  # share of the whole band, at 1/f² between 20 and 60 Hz
    expected = 100 / width * 20.0 * 60.0
    assert power.mean() == pytest.approx(expected, rel=0.3)


def test_rows_before_the_start_are_ignored() -> None:
    theta, tau = rng(8).normal(size=(2, 5000, 1))
    later = coherence(record(theta, tau, start_s=2.0))
    alone = coherence(record(theta[1000:], tau[1000:]))
    np.testing.assert_array_equal(later.coherence, alone.coherence)
    np.testing.assert_array_equal(later.frequency_hz, alone.frequency_hz)


@pytest.mark.parametrize(("joints", "parts"), [(1, 10), (2, 10), (3, 12)])
def test_a_record_too_short_names_the_samples_that_it_needs(joints: int, parts: int) -> None:
    theta, tau = rng(9).normal(size=(2, 16 * parts, joints))
    assert coherence(record(theta, tau)).frequency_hz.size == 6
    with pytest.raises(JointIdError, match=f"A record has {16 * parts - 1} .* needs {16 * parts}"):
        coherence(record(theta[1:], tau[1:]))


@pytest.mark.parametrize(("low_hz", "high_hz"), [(5.0, 20.0), (20.0, 60.0)])
def test_the_band_is_that_of_the_motion(low_hz: float, high_hz: float) -> None:
    found = coherent_band(moved(banded(low_hz, high_hz, 1e-3, 10)))
    assert found == pytest.approx((low_hz, high_hz), abs=3.01 * LINE_HZ)


def test_the_band_with_more_octaves_is_chosen() -> None:
    fast = banded(45.0, 80.0, 1e-3, 12)
    assert coherent_band(moved(banded(5.0, 14.0, 1e-3, 11), fast))[1] < 20
    assert coherent_band(moved(banded(25.0, 31.0, 1e-3, 11), fast))[0] > 38


def test_the_band_ends_at_a_sixth_of_the_sample_rate() -> None:
    _, highest = coherent_band(moved(banded(10.0, 150.0, 1e-3, 13)))
    assert RATE_HZ / 6 - LINE_HZ < highest <= RATE_HZ / 6


def test_frequencies_below_a_thirtieth_of_the_velocity_are_outside_the_band() -> None:
    """Per octave, over its largest; what moves by more is in."""
    fast = banded(30.0, 60.0, 1e-3, 14)
    for size, low_hz in ((1e-3, 5.0), (2e-5, 30.0)):
        found = coherent_band(moved(banded(5.0, 30.0, size, 15), fast, noise=1e-9))
        assert found[0] == pytest.approx(low_hz, abs=3.01 * LINE_HZ)


def test_torques_that_explain_part_of_the_motion_give_no_band() -> None:
    with pytest.raises(JointIdError) as caught:
        coherent_band(moved(banded(10.0, 60.0, 1e-3, 16), torque_noise=3.0))
    text = str(caught.value)
    assert text.startswith("The record: torque and motion are not coherent over a band")
    share, frequency_hz, spacing = re.findall(
        r"coherence is ([\d.]+) at most, at ([\d.]+) Hz, and 0.8 is needed at 5 .*, ([\d.]+) Hz apart",
        text,
    )[0]
    assert 0.3 < float(share) < 1.0
    assert 5 < float(frequency_hz) < 65
    assert float(spacing) == 1.2


def test_torques_that_follow_the_noise_of_the_encoder_give_no_band() -> None:
    """Coherent at all frequencies, but no motion."""
    noise = rng(19).normal(size=(4002, 1))
    following = record(noise[1:-1], np.diff(noise, 2, axis=0))
    assert np.median(coherence(following).coherence) > 0.99
    with pytest.raises(JointIdError, match="with a motion above the noise"):
        coherent_band(following)


def test_fewer_than_five_lines_give_no_band() -> None:
    with pytest.raises(JointIdError, match="not coherent"):
        coherent_band(moved(banded(84.0, 95.0, 1e-3, 17)))  # three lines below the highest
    assert coherent_band(moved(banded(80.0, 95.0, 1e-3, 17)))[0] > 74


PERIOD, REPEATS = 360, 3
EXCITED = np.array([3, 5, 9, 11, 15])
EVEN, ODD = np.array([4, 6, 8, 10, 12, 14]), np.array([7, 13])


def multisine(
    excited: np.ndarray = EXCITED,
    periods: float = REPEATS,
    between: float = 0.0,
    share: tuple[float, ...] = (1.0,) * 5,
    **sizes: float,
) -> np.ndarray:
    """Lines of a period with amplitudes that grow by channel, and one tone between them: (N, 4)."""
    phase = 2 * np.pi * np.arange(round(periods * PERIOD))[:, None] / PERIOD
    lines = {int(k): a / k**2 for k, a in zip(excited, share, strict=False)}
    for name, orders in (("even", EVEN), ("odd", ODD)):
        lines |= {int(k): sizes.get(name, 0.0) for k in orders if int(k) not in lines}
    wave = sum(size * np.sin(k * phase + k**2) for k, size in lines.items())
    tone = between * np.sin((7 + 1 / REPEATS) * phase + 1.0)
    return np.asarray((wave + tone) * [1.0, 2.0, 30.0, 40.0] + [5.0, 0.0, -3.0, 0.0])


def levels(signals: np.ndarray, **more: float) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    found = distortion(record(signals[:, :2], signals[:, 2:], **more))
    return found.period_s, found.even, found.odd, found.noise


def test_levels_of_distortion_are_those_simulated() -> None:
    """Root mean square of the empty even and odd lines, and of the lines between, over the excited."""
    size = np.sqrt(np.mean(1 / EXCITED.astype(float) ** 4))
    period_s, even, odd, noise = levels(multisine(even=1e-4, odd=2e-4, between=3e-4))
    assert period_s == pytest.approx(PERIOD / RATE_HZ)
    np.testing.assert_allclose(even, 1e-4 / size, rtol=1e-9)
    np.testing.assert_allclose(odd, 2e-4 / size, rtol=1e-9)
    lines = (EXCITED[-1] - EXCITED[0]) * (REPEATS - 1)
    np.testing.assert_allclose(noise, 3e-4 / size / np.sqrt(lines), rtol=1e-9)


def test_part_of_a_period_and_rows_before_the_start_are_ignored() -> None:
    signals = multisine(even=1e-4, odd=2e-4, periods=REPEATS + 0.8)
    begin = round(0.3 * PERIOD)
    signals[:begin] = 0.0
    period_s, even, odd, noise = levels(signals, start_s=begin / RATE_HZ)
    expected = levels(multisine(even=1e-4, odd=2e-4))
    assert period_s == expected[0]
    np.testing.assert_allclose((even, odd), expected[1:3], rtol=1e-6)
    assert noise.max() < 1e-9


def test_a_joint_at_rest_is_ignored_in_the_choice_of_lines() -> None:
    signals = multisine(even=1e-4, odd=2e-4)
    signals[:, 1] *= 1e-6
    np.testing.assert_allclose(levels(signals)[1], levels(multisine(even=1e-4))[1], rtol=1e-6)


def test_a_weak_line_is_excited_from_a_tenth_of_the_usual_ones_on() -> None:
    """By its acceleration; a weaker one is distortion."""
    share = (1.0, 0.5, 0.5, 0.5, 0.08)
    size = np.sqrt(np.mean((np.array(share) / EXCITED**2) ** 2))
    np.testing.assert_allclose(levels(multisine(odd=2e-4, share=share))[2], 2e-4 / size, rtol=1e-9)
    found = levels(multisine(share=(1.0, 0.5, 0.02, 0.5, 0.5)))[2]
    size = np.sqrt(np.mean((np.array([1.0, 0.5, 0.5, 0.5]) / EXCITED[[0, 1, 3, 4]] ** 2) ** 2))
    np.testing.assert_allclose(found, 0.02 / 81 / np.sqrt(3) / size, rtol=1e-9)


def test_two_periods_are_enough_and_less_are_not() -> None:
    assert levels(multisine(odd=2e-4, periods=2))[0] == pytest.approx(PERIOD / RATE_HZ)
    with pytest.raises(JointIdError, match="does not repeat"):
        levels(multisine(odd=2e-4, periods=1.6))


@pytest.mark.parametrize(
    "excited", [[3, 5, 6, 9, 15], [2, 4, 8, 10], [3, 4, 5, 6, 7], [3, 5, 7, 9, 11]], ids=str
)
def test_lines_without_gaps_or_at_even_numbers_give_no_distortion(excited: list[int]) -> None:
    with pytest.raises(JointIdError, match="not a multisine on odd lines"):
        levels(multisine(np.array(excited)))


@pytest.mark.parametrize("samples", [16, 17, 34, 2000])
def test_noise_is_the_difference_between_periods(samples: int) -> None:
    with pytest.raises(JointIdError, match="does not repeat"):
        levels(rng(18).normal(size=(samples, 4)))


def test_coherence_of_one_motor_is_that_of_scipy_less_what_chance_explains() -> None:
    """18 half-overlapping segments: one of them is explained by chance."""
    tau, theta = rng(21).normal(size=(2, 4000, 1))
    tau[1:-1] += 0.5 * np.diff(theta, 2, axis=0)
    found = coherence(record(theta, tau))
    signals = np.diff(theta[:, 0], 2), tau[1:-1, 0]
    settings = {"fs": RATE_HZ, "window": np.hanning(400), "nperseg": 400}
    frequency, share = signal.coherence(*signals, **settings)
    _, power = signal.welch(signals[0], **settings)
    np.testing.assert_allclose(found.frequency_hz, frequency[2:-1])
    expected = np.clip(1 - (1 - share[2:-1]) * 18 / 17, 0, 1)
    np.testing.assert_allclose(found.coherence[:, 0], expected, atol=1e-9)
    angle = power[2:-1] / np.sin(np.pi * frequency[2:-1] / RATE_HZ) ** 4
    np.testing.assert_allclose(found.above_floor[:, 0], angle / np.median(angle[148:]), rtol=1e-9)
