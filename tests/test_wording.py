"""Numbers with as many digits as their standard error supports."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from random_cases import examples

from jointid.wording import length_with_error, plain, significant, unbroken, with_error


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (43.0187263, 0.0313, "43.02 ± 0.03"),
        (0.10034539, 0.00026455, "0.1003 ± 0.0003"),
        (7.5, 0.0097, "7.500 ± 0.010"),
        (43, 0.13, "43.00 ± 0.13"),
        (43, 0.0199, "43.00 ± 0.02"),
        (12345, 678, "12300 ± 700"),
        (3.2, 200, "0 ± 200"),
        (-3.2, 0.4, "−3.2 ± 0.4"),
        (1.2e-7, 3e-9, "(1.20 ± 0.03)×10⁻⁷"),
        (2.5e7, 2e5, "(2.50 ± 0.02)×10⁷"),
        (43, 1e-12, "43.00000 ± 0.00001"),
        (43, 0, "43.00000 ± 0"),
        (0, 0, "0 ± 0"),
        (-0.001, 0.1, "0.00 ± 0.10"),
        (5, math.nan, "5.00 ± ?"),
        (5, math.inf, "not determined"),
        (math.nan, math.inf, "not determined"),
        (math.nan, 1, "unknown"),
        (math.inf, 1, "unknown"),
    ],
)
def test_known_cases(value: float, error: float, text: str) -> None:
    assert with_error(value, error) == text


@pytest.mark.parametrize(
    ("length_m", "error_m", "text"),
    [
        (34.675e-6, 6e-9, "34.7 ± 0.1 µm"),
        (34.675e-6, 1.2e-6, "34.7 ± 1.2 µm"),
        (2.9e-3, 3e-5, "2.90 ± 0.03 mm"),
        (2.9e-3, 3e-9, "2.9000 ± 0.0001 mm"),
        (2e-5, 3e-4, "0.0 ± 0.3 mm"),
        (1e-4, math.inf, "not determined"),
    ],
)
def test_a_length_ends_at_a_tenth_of_a_micrometre(length_m: float, error_m: float, text: str) -> None:
    assert length_with_error(length_m, error_m) == text


@examples(300, derandomize=True)
@given(
    st.floats(1e-2, 1e4) | st.floats(-1e4, -1e-2),
    st.floats(1e-5, 1.0),
)
def test_written_values_are_right_within_a_fraction_of_the_error(value: float, relative: float) -> None:
    error = relative * abs(value)
    text = with_error(value, error)
    assume("×" not in text)
    number, _, bar = text.replace("−", "-").partition(" ± ")
    assert abs(float(number) - value) <= 0.5 * error * 1.001
    assert float(bar) == pytest.approx(error, rel=0.3)
    decimals = [len(part.partition(".")[2]) for part in (number, bar)]
    assert decimals[0] == decimals[1]
    assert len(re.sub(r"^[0.]+|[.]", "", bar).rstrip("0") or "0") <= 2


def test_a_negative_error_raises_value_error() -> None:
    with pytest.raises(ValueError, match="standard error"):
        with_error(1.0, -1.0)


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (43.0187, 4, "43.02"),
        (1.23456e-5, 4, "1.235×10⁻⁵"),
        (-0.00123, 2, "−0.0012"),
        (999.96, 4, "1000"),
        (0, 3, "0"),
        (math.inf, 3, "∞"),
    ],
)
def test_significant_digits(value: float, digits: int, text: str) -> None:
    assert significant(value, digits) == text


@pytest.mark.parametrize(("value", "text"), [(20.0, "20"), (3.5, "3.5"), (0.015, "0.015"), (-1.0, "−1")])
def test_chosen_numbers_are_written_as_chosen(value: float, text: str) -> None:
    assert plain(value) == text


def test_a_number_stays_with_its_error_and_unit() -> None:
    assert unbroken("joint 2 is 6 ± 3 % stiffer") == "joint 2 is 6\xa0±\xa03\xa0% stiffer"
    assert unbroken("1.752 ms after 2 rad") == "1.752\xa0ms after 2\xa0rad"
    assert unbroken("0.4 mm per joint") == "0.4\xa0mm per joint"
    assert unbroken("D1 0.14 %, D2 0.047 %") == "D1\xa00.14\xa0%, D2\xa00.047\xa0%"
    assert unbroken("1.2 × noise, K1 of all") == "1.2\xa0×\xa0noise, K1 of all"
    assert unbroken("4–28 Hz") == "4–\N{WORD JOINER}28\xa0Hz"
