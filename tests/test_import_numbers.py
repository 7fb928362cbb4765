"""Typed numbers with decimal points or commas."""

from __future__ import annotations

import pytest

from jointid import JointIdError
from jointid.ui.shared.entries import matrix_in, numbers_in


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("43, 7.5", (43, 7.5)),
        ("43,7.5", (43, 7.5)),
        ("3,5,7", (3, 5, 7)),
        ("43 7.5", (43, 7.5)),
        ("0.0031; 0.0009", (0.0031, 0.0009)),
        ("0,0031 0,0009", (0.0031, 0.0009)),
        ("0,0031; 0,0009", (0.0031, 0.0009)),
        ("43 7,5", (43, 7.5)),
        ("-1,5 2,5e-3", (-1.5, 2.5e-3)),
        ("0,0031", (0.0031,)),
        ("101, \N{MINUS SIGN}93.5", (101, -93.5)),
        ("12", (12,)),
    ],
)
def test_lists(text: str, values: tuple[float, ...]) -> None:
    assert numbers_in("M", text) == values


@pytest.mark.parametrize(
    ("text", "readings"),
    [
        ("1,2", ("1, 2 (2 numbers)", "1.2 (1 number)")),
        ("0,0031, 0,0009", ("0, 31, 0, 9 (4 numbers)", "0.0031, 0.0009 (2 numbers)")),
        ("1,2 3.5", ("1, 2, 3.5 (3 numbers)", "1.2, 3.5")),
        ("1,2 3,4,5", ("1, 2, 3, 4, 5 (5 numbers)",)),
    ],
)
def test_both_readings_of_an_ambiguous_number_are_shown(text: str, readings: tuple[str, ...]) -> None:
    with pytest.raises(JointIdError, match="can be read as") as caught:
        numbers_in("Rotor inertias M", text)
    assert all(reading in str(caught.value) for reading in readings)
    assert "Write decimal points" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("0.0074, 0.0017; 0.0017, 0.0021", [(0.0074, 0.0017), (0.0017, 0.0021)]),
        ("0,0074 0,0017; 0,0017 0,0021", [(0.0074, 0.0017), (0.0017, 0.0021)]),
        ("0,0074, 0,0017; 0,0017, 0,0021", [(0.0074, 0.0017), (0.0017, 0.0021)]),
        ("1,2; 3,4;", [(1, 2), (3, 4)]),
        ("1,2", [(1.2,)]),
        ("7,4 1,7; 1,7 2", [(7.4, 1.7), (1.7, 2)]),
    ],
)
def test_a_matrix_is_square(text: str, rows: list[tuple[float, ...]]) -> None:
    assert matrix_in("M2", text) == rows


@pytest.mark.parametrize("text", ["a", "", "1,,a", "1;x", "0,1 y"])
def test_an_invalid_number_is_named(text: str) -> None:
    with pytest.raises(JointIdError, match="is not a number"):
        numbers_in("M", text)


def test_an_invalid_matrix_is_reported_with_the_row_separator() -> None:
    with pytest.raises(JointIdError, match=r'"/" is not a number.* A semicolon separates the rows'):
        matrix_in("M2", "0.0074, 0.0017 / 0.0017, 0.0021")


def test_rows_of_different_lengths_are_reported() -> None:
    with pytest.raises(JointIdError, match="its rows have 2, 1 values"):
        matrix_in("M2", "1, 2; 3")
