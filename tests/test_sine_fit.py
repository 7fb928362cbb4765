"""The fast sine fit against least squares, and its stated noise against the scatter of many fits."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from random_cases import examples

from jointid import JointIdError, SineRecord
from jointid.phasors.direct_fit import _free_lines, fit_directly
from jointid.phasors.fitted_sine import Window
from jointid.phasors.sine_fit import _layout, fit_sines, is_uniform


def reference(record: SineRecord, harmonics: int) -> tuple[np.ndarray, np.ndarray]:
    """Phasors (H, 2n) and the curve, from numpy's least squares at the actual sample times."""
    time = record.time_s[record.start :]
    middle = (time[0] + time[-1]) / 2
    angle = record.omega * np.outer(time - middle, np.arange(1, harmonics + 1))
    ramp = (time - middle) / (time[-1] - time[0])
    columns = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(time), ramp])
    data = np.hstack([record.theta_rad, record.tau_Nm])[record.start :]
    solution = np.linalg.lstsq(columns, data, rcond=None)[0]
    y = solution[:harmonics] + 1j * solution[harmonics:-2]
    clock = np.exp(-1j * record.omega * middle * np.arange(1, harmonics + 1))
    return y * clock[:, None], columns @ solution


def messy(
    rng: np.random.Generator,
    *,
    frequency: float,
    periods: float,
    samples_per_period: float,
    n: int = 2,
    offset: float = 0.0,
    drift: float = 0.0,
    begin: float = 0.0,
    jitter: float = 0.0,
    skip: int = 0,
) -> SineRecord:
    """A sine with a third harmonic, noise, offset and drift, on a clock of its own."""
    step = 1 / (frequency * samples_per_period)
    count = int(np.ceil(periods * samples_per_period)) + skip + (2 if jitter else 0)
    time = begin + step * (np.arange(count) + jitter * rng.uniform(-0.5, 0.5, count))
    omega = 2 * np.pi * frequency
    y = rng.standard_normal((2, 2 * n)) + 1j * rng.standard_normal((2, 2 * n))
    wave = np.imag(np.exp(1j * omega * time)[:, None] * y[0])
    wave += 0.1 * np.imag(np.exp(3j * omega * time)[:, None] * y[1])
    wave += offset + drift * (time - begin)[:, None] + 0.05 * rng.standard_normal(wave.shape)
    start = None if skip == 0 else float(time[skip])
    return SineRecord(frequency, time, wave[:, :n], wave[:, n:], start_s=start)


@examples(120)
@given(
    seed=st.integers(0, 2**32 - 1),
    frequency=st.floats(0.05, 400),
    periods=st.floats(1.0, 60),
    samples_per_period=st.floats(17.0, 150),
    harmonics=st.integers(1, 7),
    offset=st.sampled_from([0.0, 1.0, -100.0]),
    drift=st.sampled_from([0.0, 5.0]),
    begin=st.sampled_from([0.0, -3.7, 250.0]),
    jitter=st.sampled_from([0.0, 0.0, 0.4]),
    skip=st.sampled_from([0, 0, 33]),
)
@example(
    seed=1, frequency=3.0, periods=8.0, samples_per_period=100.0, harmonics=7,
    offset=-100.0, drift=5.0, begin=250.0, jitter=0.0, skip=33,
)  # fmt: skip
def test_fit_is_least_squares_at_the_actual_times(
    seed: int,
    frequency: float,
    periods: float,
    samples_per_period: float,
    harmonics: int,
    **signal: float,
) -> None:
    signal["drift"] *= frequency  # per period, so that slow records do not drift further than fast ones
    record = messy(
        np.random.default_rng(seed),
        frequency=frequency,
        periods=periods,
        samples_per_period=samples_per_period,
        **signal,  # type: ignore[arg-type]
    )
    fit = fit_sines([record], harmonics)[0]
    assert np.allclose(fit.fundamental, reference(record, 1)[0][0], rtol=0, atol=1e-8)

    carried = int(np.any(fit.harmonics != 0, axis=1).sum())
    assert carried == harmonics or carried < 0.46 * samples_per_period
    expected, curve = reference(record, carried)
    assert np.allclose(fit.harmonics[:carried], expected, rtol=0, atol=1e-7)
    assert not fit.harmonics[carried:].any()
    assert not fit.covariance[carried:].any()
    drawn = fit.at(record.time_s[record.start :], record.omega)
    assert np.allclose(drawn, curve, rtol=0, atol=2e-7)


@pytest.mark.parametrize("samples_per_period", [2.02, 2.5, 3.0, 7.3, 10.0])
def test_few_samples_per_period(samples_per_period: float) -> None:
    record = messy(
        np.random.default_rng(4), frequency=20.0, periods=160.3, samples_per_period=samples_per_period
    )
    fit = fit_sines([record])[0]
    assert np.allclose(fit.fundamental, reference(record, 1)[0][0], rtol=0, atol=1e-9)


def test_a_small_sine_is_exact_under_huge_offset_and_travel() -> None:
    """A microradian on a joint that stands at 100 rad and travels 1000 more: found to 1e-12 of that."""
    time = np.arange(20_000) / 4000.0
    y = 1e-6 * np.exp(0.7j)
    theta = 100.0 + 200.0 * time + np.imag(y * np.exp(1j * 2 * np.pi * 7.3 * time))
    fit = fit_sines([SineRecord(7.3, time, theta, np.sin(time))])[0]
    assert fit.fundamental[0] == pytest.approx(y, abs=1e-9)
    assert fit.drift[0] == pytest.approx(200.0, rel=1e-12)
    assert fit.offset[0] == pytest.approx(theta.mean(), rel=1e-9)


def test_integral_of_the_paper_is_the_case_of_whole_periods() -> None:
    """Equation (2) with L ten periods."""
    rng = np.random.default_rng(2)
    time = np.arange(1000) / 1000.0
    signal = 0.3 + np.sin(2 * np.pi * 10 * time + 0.4) + 0.2 * rng.standard_normal(1000)
    signal -= np.polyval(np.polyfit(time, signal, 1), time)  # (2) has no drift term
    fit = fit_sines([SineRecord(10.0, time, signal, signal)])[0]
    a = 2 / 1.0 * np.sum(signal * np.sin(20 * np.pi * time)) * 1e-3
    b = 2 / 1.0 * np.sum(signal * np.cos(20 * np.pi * time)) * 1e-3
    # What is left is the small overlap of the sine with the removed drift.
    assert fit.fundamental[0] == pytest.approx(a + 1j * b, abs=0.01)
    level = np.ones((1000, 1)) * 0.7
    exact = np.imag(np.exp(20j * np.pi * time) * (1 + 2j))
    assert fit_sines([SineRecord(10.0, time, exact, level)])[0].fundamental[0] == pytest.approx(1 + 2j)


def test_time_shift_is_phase() -> None:
    record = messy(np.random.default_rng(3), frequency=3.3, periods=12.4, samples_per_period=80)
    shifted = SineRecord(3.3, record.time_s + 0.071, record.theta_rad, record.tau_Nm)
    turn = np.exp(-1j * record.omega * 0.071)
    assert np.allclose(
        fit_sines([shifted])[0].fundamental, turn * fit_sines([record])[0].fundamental, atol=1e-9
    )


def test_negligible_jitter_uses_the_uniform_fit() -> None:
    rng = np.random.default_rng(5)
    steady = messy(rng, frequency=5.0, periods=20, samples_per_period=50, jitter=1e-9)
    loose = messy(rng, frequency=5.0, periods=20, samples_per_period=50, jitter=0.2)
    assert is_uniform(steady)
    assert not is_uniform(loose)
    for record in (steady, loose):  # the noise of both is the scatter of all blocks
        assert fit_sines([record], 1)[0].degrees_of_freedom > 8


def white(rng: np.random.Generator, count: int, memory: float) -> np.ndarray:
    del memory
    return rng.standard_normal((count, 2))


def coloured(rng: np.random.Generator, count: int, memory: float) -> np.ndarray:
    """First-order autoregressive noise of unit innovation, already in its steady state."""
    from scipy.signal import lfilter

    return np.asarray(lfilter([1], [1, -memory], rng.standard_normal((count + 400, 2)), axis=0)[400:])


CASES = {
    # periods, samples per period, harmonics, noise, memory, jitter
    "one period": (1.0, 200.0, 1, white, 0.0, 0.0),
    "hardly one period, harmonics": (1.05, 150.0, 7, white, 0.0, 0.0),
    "two and a bit": (2.3, 100.0, 1, white, 0.0, 0.0),
    "just under eight": (7.9, 40.0, 3, white, 0.0, 0.0),
    "just over eight": (8.2, 40.0, 3, white, 0.0, 0.0),
    "many": (40.37, 30.3, 7, white, 0.0, 0.0),
    "near Nyquist": (300.0, 2.02, 1, white, 0.0, 0.0),
    "coloured": (40.37, 30.3, 1, coloured, 0.9, 0.0),
    "coloured, jittered": (30.2, 30.3, 1, coloured, 0.9, 0.4),
    "coloured, few periods": (5.5, 100.0, 1, coloured, 0.9, 0.0),
}


@pytest.mark.parametrize("case", CASES)
def test_stated_covariance_is_the_scatter_of_the_phasors(case: str) -> None:
    """600 realisations of correlated noise on q and τ.

    A ratio of variances then has a standard deviation of about 0.05 (0.08 where the stated one has few
    degrees of freedom), so that 0.8 to 1.25 neither fails by bad luck nor passes by good.
    """
    periods, rate, harmonics, noise, memory, jitter = CASES[case]
    rng = np.random.default_rng(7)
    runs, frequency = 600, 2.0
    count = int(np.ceil(periods * rate))
    time = (np.arange(count) + jitter * rng.uniform(-0.5, 0.5, count)) / (frequency * rate)
    wave = np.imag(np.exp(2j * np.pi * frequency * time)[:, None] * np.array([1.0, 0.5j])) + 3.0
    mix = np.array([[1.0, 0.6], [0.0, 0.8]])
    records = []
    for _ in range(runs):
        signal = wave + 0.01 * noise(rng, count, memory) @ mix
        records.append(SineRecord(frequency, time, signal[:, 0], signal[:, 1]))
    fits = fit_sines(records, harmonics)
    error = np.array([fit.fundamental for fit in fits]) - [1.0, 0.5j]
    stated = np.mean([fit.covariance[0] for fit in fits], axis=0)
    scatter = error.T @ error.conj() / runs

    root = np.linalg.cholesky(np.linalg.inv(stated))  # scatter in units of the stated covariance
    ratio = np.linalg.eigvalsh(root.conj().T @ scatter @ root)
    assert ratio.min() > 0.8
    assert ratio.max() < 1.25
    # How much the stated variances vary from run to run is what the degrees of freedom claim.
    variances = np.array([np.diag(fit.covariance[0]).real for fit in fits])
    claimed = 1 / np.sqrt(fits[0].degrees_of_freedom)
    assert np.all(variances.std(axis=0) / variances.mean(axis=0) < 1.5 * claimed + 0.02)
    assert np.allclose(error.mean(axis=0), 0, atol=5 * np.sqrt(np.diag(stated).real.max() / runs))


def test_deviations_sum_to_zero() -> None:
    for periods in (9.3, 33.7):
        fit = fit_sines(
            [messy(np.random.default_rng(8), frequency=2.0, periods=periods, samples_per_period=60)], 3
        )[0]
        total = np.abs(fit.deviations.sum(axis=0))
        assert np.all(total < 0.5 * np.abs(fit.deviations).sum(axis=0))
        assert fit.degrees_of_freedom == len(fit.deviations) - 1


def test_noise_free_record_has_next_to_no_noise() -> None:
    time = np.arange(4000) / 1000.0
    wave = np.sin(2 * np.pi * 7.3 * time)
    fit = fit_sines([SineRecord(7.3, time, wave, wave)], 7)[0]
    assert np.abs(fit.covariance).max() < 1e-24


@pytest.mark.parametrize("samples", [10, 12, 17])
def test_one_period_of_few_samples_has_a_finite_error(samples: int) -> None:
    """Seven harmonics would fit ten noisy samples perfectly and leave no residual to see noise in."""
    time = np.arange(samples) / samples
    rng = np.random.default_rng(9)
    errors, stated = [], []
    for _ in range(200):
        wave = np.sin(2 * np.pi * time) + 0.1 * rng.standard_normal(samples)
        fit = fit_sines([SineRecord(1.0, time, wave, wave)], 7)[0]
        errors.append(np.abs(fit.fundamental[0] - 1) ** 2)
        stated.append(fit.covariance[0, 0, 0].real)
    assert np.mean(stated) > 0.5 * np.mean(errors)


@pytest.mark.parametrize(
    ("periods", "orders", "lines"),
    [
        (10.0, 3, [0.7, 0.8, 0.9, 1.1, 1.2, 1.3]),
        (2.0, 1, [-0.5, 0.5, 1.5, 2.0, 2.5]),
        (2.0, 2, [-0.5, 0.5, 1.5, 2.5]),
        (1.0, 4, [-2.0, -1.0]),
    ],
)
def test_noise_is_measured_at_three_lines_to_both_sides_that_are_not_in_the_fit(
    periods: float, orders: int, lines: list[float]
) -> None:
    """In units of the fundamental, which itself is in the fit, as are the harmonics and the offset."""
    record: Any = SimpleNamespace(periods=periods, omega=2.0)
    found = _free_lines(record, np.arange(1, orders + 1))
    np.testing.assert_allclose(found, 2.0 * np.array(lines), rtol=1e-12)


def test_the_noise_of_one_period_with_harmonics_is_that_of_the_residual() -> None:
    """No spectral line near the sine is free: white noise of the residual, over its freedom, remains."""
    time = np.arange(200) / 200
    data = np.sin(2 * np.pi * time) + 0.1 * np.random.default_rng(2).standard_normal((2, 200))
    record = SineRecord(1.0, time, data[0], data[1])
    fit = fit_directly(Window(record, orders=7, block=200, blocks=1), 7, by_scatter=False)
    left = data.T - reference(record, 7)[1]
    angle = 2 * np.pi * np.outer(time - time.mean(), np.arange(1, 8))
    ramp = np.linspace(-0.5, 0.5, 200)
    columns = np.column_stack([np.sin(angle), np.cos(angle), np.ones(200), ramp])
    spread = np.diag(np.linalg.inv(columns.T @ columns))
    expected = (spread[:7] + spread[7:14])[:, None, None] * (left.T @ left) / 184
    np.testing.assert_allclose(fit.covariance, expected, rtol=1e-6, atol=1e-12)
    assert fit.degrees_of_freedom == 184


def test_eight_samples_are_enough_and_seven_are_not() -> None:
    record = SineRecord(1.0, np.arange(8) / 8, np.sin(np.arange(8)), np.cos(np.arange(8)))
    assert np.isfinite(fit_sines([record])[0].covariance).all()
    with pytest.raises(JointIdError, match=r"A record has 7 usable samples; .* needs 8"):
        fit_sines([SineRecord(1.0, np.arange(7) / 7, np.arange(7) % 3, np.arange(7) % 2)])


@pytest.mark.parametrize(
    ("samples", "period", "highest"),
    [
        (48, 20.0, 5), (47, 20.0, 4), (800, 20.1, 9), (800, 19.9, 8), (800, 3.0, 1), (79, 40.0, 1),
        (80, 40.0, 9),
    ],
)  # fmt: skip
def test_harmonics_are_below_half_the_rate_and_their_unknowns_a_quarter_of_the_samples(
    samples: int, period: float, highest: int
) -> None:
    """2H + 2 of S/4, at most 0.45 per sample, and the first alone within two periods."""
    assert _layout(samples, period, 31)[0] == highest
    assert _layout(samples, period, 2)[0] == min(highest, 2)


@pytest.mark.parametrize(
    ("samples", "period", "block"),
    [
        (100_000, 10.25, 1025),
        (4000, 40.5, 243),
        (1700, 100.0, 100),
        (3300, 100.3, 201),
        (700, 100.0, 100),
    ],
)
def test_blocks_are_nearly_whole_periods_of_a_thousand_samples_or_of_a_sixteenth(
    samples: int, period: float, block: int
) -> None:
    """Of 40.5 samples and 98 periods: six periods, of 243 samples."""
    assert _layout(samples, period, 1)[1] == block
