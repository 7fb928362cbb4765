"""Thousands and decimal marks in numbers; share of a signal's power on spectral lines."""

from __future__ import annotations

import numpy as np
import pytest

from jointid import JointIdError
from jointid.importing.find.lines import in_lines
from jointid.importing.read.text.numbers import marks_note, proven_thousands


@pytest.mark.parametrize(
    ("text", "decimal", "separator", "mark"),
    [
        ("1.234,5;2", ",", ";", "."),
        ("1,234.5;2", ".", ";", ","),
        ("1.234;2,5", ",", ";", ""),  # no number has both marks
        ("1.23,4;2", ",", ";", ""),  # two digits are no thousands
        ("1.234,", ",", ";", ""),
        ("1,234.5", ".", ",", ""),  # here the comma separates the columns
    ],
)
def test_thousands_are_proven_by_a_number_with_both_marks(
    text: str, decimal: str, separator: str, mark: str
) -> None:
    assert proven_thousands(text, decimal, separator) == mark


@pytest.mark.parametrize(
    ("cells", "decimal", "thousands", "said"),
    [
        (["1.234,5", "2"], ",", ".", '"1.234,5" is read as 1234.5 (thousands: ".", decimals: ",")'),
        (["1,234,567"], ".", ",", '"1,234,567" is read as 1234567 (thousands: ",", decimals: ".")'),
        (["1 234"], ",", " ", 'thousands: "blank"'),
        (["1.234", "5.678"], ".", "", '"1.234" is not 1234.'),
    ],
)
def test_the_note_states_how_marks_are_read(
    cells: list[str], decimal: str, thousands: str, said: str
) -> None:
    assert said in marks_note("log.csv", cells, decimal, thousands)


@pytest.mark.parametrize("cells", [["1.5", "1.234"], ["0.125"], ["12", "7"], []])
def test_plain_numbers_need_no_note(cells: list[str]) -> None:
    assert marks_note("log.csv", cells, ".", "") == ""


@pytest.mark.parametrize(
    ("cells", "decimal", "thousands", "said"),
    [
        (["1.234", "5,5"], ",", ".", '"1.234" may be .*"5,5" occurs as well'),
        (["1,234", "5,678"], ",", "", '"1,234" may be 1.234 or 1234'),
    ],
)
def test_two_readings_are_an_error_that_names_both(
    cells: list[str], decimal: str, thousands: str, said: str
) -> None:
    with pytest.raises(JointIdError, match=f"log.csv: {said}"):
        marks_note("log.csv", cells, decimal, thousands)


TIME_S = np.arange(4000) / 1000.0


def sines(**amplitudes: float) -> np.ndarray:
    """Signal (N, 1) of whole periods: amplitude by frequency, f10=1.0 for 10 Hz."""
    parts = [a * np.sin(2 * np.pi * float(name[1:]) * TIME_S) for name, a in amplitudes.items()]
    return np.sum(parts, axis=0)[:, None]


@pytest.mark.parametrize(
    ("signal", "share"),
    [
        (sines(f10=1.0), 1.0),
        (sines(f10=1.0, f13=1.0), 0.5),
        (sines(f10=2.0, f13=1.0), 0.8),
        (sines(f10=1.0, f40=1.0), 1.0),  # above the band of the line, to 1.5 × 10 Hz
        (sines(f13=1.0), 0.0),
    ],
)
def test_power_is_shared_as_the_squares_of_the_amplitudes(signal: np.ndarray, share: float) -> None:
    assert in_lines(TIME_S, signal, [10.0]) == pytest.approx(share, abs=0.01)


def test_drift_does_not_count_and_rest_has_no_lines() -> None:
    drifting = sines(f10=1.0, f13=1.0) + 5.0 * TIME_S[:, None] + 3.0
    assert in_lines(TIME_S, drifting, [10.0, 13.0]) == pytest.approx(1.0, abs=0.01)
    assert in_lines(TIME_S, np.zeros((TIME_S.size, 1)), [10.0]) == 0.0
