"""Checks of a record: shapes, times, timing, and at least one period below Nyquist."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_cases import examples

from jointid import JointIdError, MotionRecord, SineRecord, extract_phasors

TIME = np.arange(1000) / 1000.0
SINE = np.sin(2 * np.pi * 5.0 * TIME)


def record(**changes: Any) -> SineRecord:
    settings_: dict[str, Any] = {"frequency_hz": 5.0, "time_s": TIME, "theta_rad": SINE, "tau_Nm": SINE}
    return SineRecord(**{**settings_, **changes})


def test_signals_of_a_single_joint_may_be_a_list() -> None:
    assert record().theta_rad.shape == (1000, 1)
    assert record().n == 1
    assert record(theta_rad=np.c_[SINE, SINE], tau_Nm=np.c_[SINE, SINE]).n == 2


def test_interval_periods_and_jitter_are_measured() -> None:
    assert record().interval_s == pytest.approx(1e-3, rel=1e-12)
    assert record().periods == pytest.approx(5.0)
    assert record().omega == pytest.approx(10 * np.pi)
    assert record().jitter_s < 1e-12
    bent = TIME.copy()
    bent[500] += 4e-4
    assert record(time_s=bent).jitter_s == pytest.approx(4e-4, rel=1e-9)


def test_start_counts_from_the_clock_of_the_record() -> None:
    late = record(time_s=TIME + 100.0, start_s=100.5)
    assert late.start == 500
    assert late.periods == pytest.approx(2.5)
    assert record(start_s=-3.0).start == 0


def test_clock_in_seconds_since_1970_gives_the_sample_rate() -> None:
    """Seconds since 1970 leave a quarter of a microsecond of resolution."""
    unix = record(time_s=TIME + 1.79e9)
    assert unix.interval_s == pytest.approx(1e-3, rel=1e-6)
    assert unix.jitter_s < 1e-6


def test_signals_are_copied_and_cannot_change() -> None:
    theta = SINE.copy()
    made = record(theta_rad=theta)
    theta[0] = 9.0
    assert made.theta_rad[0, 0] == 0.0
    for array in (made.time_s, made.theta_rad, made.tau_Nm):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


BROKEN = SINE.copy()
BROKEN[17] = np.nan


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"theta_rad": SINE[:-1]}, r"theta_rad has shape \(999, 1\).*1000 samples"),
        ({"tau_Nm": np.zeros((1000, 0))}, "tau_Nm has shape.*one column per joint"),
        ({"tau_Nm": np.c_[SINE, SINE]}, "theta_rad has 1 joint.*tau_Nm 2"),
        ({"theta_rad": BROKEN}, r"theta_rad: the value at index \(17, 0\) is nan.*[Rr]emove"),
        ({"time_s": TIME[::-1]}, r"time_s goes back from 0.999 s at row 1.*Sort"),
        ({"time_s": np.minimum(TIME, 0.5)}, r"time_s repeats 0.5 s at row 501.*duplicates"),
        ({"time_s": 1000 * TIME}, r"half the sample rate of 1 Hz.*unit of time"),
        ({"time_s": TIME / 1000}, r"less than one period of 5 Hz \(0.2 s\).*unit of time"),
        ({"frequency_hz": 500.0}, "at or above half the sample rate"),
        ({"frequency_hz": 0.9}, "less than one period of 0.9 Hz"),
        ({"frequency_hz": 0.0}, "frequency_hz = 0 Hz: it must be positive"),
        ({"frequency_hz": -5.0}, "must be positive"),
        ({"frequency_hz": np.nan}, "frequency_hz.*nan"),
        ({"torque_delay_s": np.inf}, "torque_delay_s.*inf"),
        ({"start_s": 2.0}, "start_s = 2 s lies after the last sample at 0.999 s"),
        ({"start_s": 0.9}, "less than one period"),
        ({"time_s": [0.0], "theta_rad": [0.0], "tau_Nm": [0.0]}, "1 sample"),
        ({"time_s": [], "theta_rad": [], "tau_Nm": []}, "0 sample"),
        ({"start_s": "late"}, "start_s.*late"),
        ({"start_s": [1.0]}, "start_s"),
        ({"start_s": np.nan}, "start_s.*nan"),
        ({"theta_rad": [[1, 2], [3]]}, "theta_rad: expected.*numbers"),
        ({"theta_rad": SINE + 1j}, "theta_rad"),
        ({"torque_hold": "false"}, "torque_hold"),
        ({"torque_hold": np.array([1, 2])}, "torque_hold"),
        ({"label": 5}, "label"),
        ({"pose": ["stretched"]}, "pose"),
    ],
)
def test_wrong_record_says_what_where_and_remedy(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(JointIdError, match=message):
        record(**changes)


@pytest.mark.parametrize(("count", "frequency"), [(3, 0.4), (4, 0.3), (5, 0.25)])
def test_fewer_samples_than_unknowns_are_refused(count: int, frequency: float) -> None:
    """Sine, cosine, offset and drift are four unknowns; the noise needs a few more samples."""
    rng = np.random.default_rng(1)
    signals = rng.standard_normal((2, count))
    with pytest.raises(JointIdError, match="samples"):
        extract_phasors([SineRecord(frequency, np.arange(count), *signals)])


WILD = st.one_of(
    st.none(),
    st.text(max_size=4),
    st.booleans(),
    st.integers(-(10**400), 10**400),
    st.floats(),
    st.complex_numbers(),
    st.lists(st.floats(), max_size=12),
    st.lists(st.lists(st.floats(), max_size=3), max_size=12),
    st.lists(st.one_of(st.none(), st.text(max_size=2), st.lists(st.integers())), max_size=5),
    st.sampled_from(
        [
            TIME,
            SINE,
            SINE + 1j,
            TIME * 1e308,
            (2 * TIME - 1) * 1.7e308,
            np.zeros((1000, 2, 2)),
            np.zeros((0, 0)),
            np.full(1000, "x"),
            np.array([None] * 1000),
            np.array([object()] * 1000),
            np.arange(1000).astype("datetime64[s]"),
            {},
            object(),
        ]
    ),
)
FIELDS = ["frequency_hz", "time_s", "theta_rad", "tau_Nm", "torque_hold", "torque_delay_s", "start_s"]


@examples(400)
@given(st.dictionaries(st.sampled_from(FIELDS), WILD, min_size=1, max_size=3))
def test_arbitrary_input_raises_only_jointiderror(changes: dict[str, Any]) -> None:
    try:
        made = record(**changes)
    except JointIdError:
        return
    assert made.periods >= 1 - 1e-9
    assert np.isfinite(made.theta_rad).all()
    assert np.isfinite([made.frequency_hz, made.interval_s, made.jitter_s, made.torque_delay_s]).all()


@examples(60)
@given(
    st.lists(st.floats(1e-6, 1e3), min_size=8, max_size=60),
    st.floats(1e-3, 1e3),
)
def test_any_increasing_times_give_a_record_or_a_reason(steps: list[float], frequency: float) -> None:
    time = np.cumsum(steps)
    signal = np.sin(time)
    try:
        made = SineRecord(frequency, time, signal, signal)
    except JointIdError:
        return
    assert made.frequency_hz * made.interval_s < 0.5


def motion(**changes: Any) -> MotionRecord:
    settings_: dict[str, Any] = {
        "time_s": TIME,
        "theta_rad": np.c_[SINE, SINE],
        "tau_Nm": np.c_[SINE, SINE],
    }
    return MotionRecord(**{**settings_, **changes})


def test_a_motion_record_has_the_checks_of_a_sine_but_no_frequency() -> None:
    made = motion(start_s=0.25, band_hz=[2.5, 38], torque_hold=True)
    assert (made.n, made.samples, made.band_hz) == (2, 750, (2.5, 38.0))
    assert made.interval_s == pytest.approx(1e-3)
    with pytest.raises(JointIdError, match="theta_rad has 2 joints and tau_Nm 1"):
        motion(tau_Nm=SINE)


def test_arm_angles_are_nan_only_in_columns_without_a_sensor() -> None:
    one = motion(arm_rad=np.c_[np.full(1000, np.nan), SINE]).arm_rad
    assert one is not None
    assert np.isnan(one[:, 0]).all()
    np.testing.assert_array_equal(one[:, 1], SINE)
    assert motion(arm_rad=np.full((1000, 2), np.nan)).arm_rad is None


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"arm_rad": np.c_[SINE, BROKEN]}, r"arm_rad: the value at index \(17, 1\) is nan"),
        ({"arm_rad": SINE}, "arm_rad has 1 joint, theta_rad 2"),
        ({"arm_rad": [[1.0], [1.0, 2.0]]}, "arm_rad: expected real numbers"),
        ({"band_hz": 5.0}, "expected a lowest and a highest"),
        ({"band_hz": (8.0, 3.0)}, r"band_hz = \[8, 3\] Hz: expected a lowest"),
        ({"band_hz": (8.0, 500.0)}, "reaches half the sample rate of 1000 Hz"),
        ({"start_s": 0.99}, "at least 16 samples; this one has 10"),
    ],
)
def test_unusable_motion_records_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(JointIdError, match=message):
        motion(**changes)
