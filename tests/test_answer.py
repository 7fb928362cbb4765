"""The sentence says what the numbers say."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from jointid import Elasticity
from jointid.answer import answer_sentence


def fit(K: list[float], error: float = 0.01) -> SimpleNamespace:
    n = len(K)
    return SimpleNamespace(n=n, K=np.array(K), D=np.full(n, 0.1), standard_error=np.full(2 * n, error))


@pytest.mark.parametrize(
    ("K", "nominal", "said"),
    [
        ([44.0, 7.5], [20.0, 3.5], "Joint 1 is 2.2 times as stiff as the controller assumes"),
        ([44.0, 7.5], [20.0, 3.5], "joint 2 is 2.1 times as stiff."),
        ([7.5, 7.5], [3.5, 3.5], "Every joint is 2.1 times as stiff as the controller assumes."),
        ([43.0], [40.0], "Joint 1 is 7.5 % stiffer than the controller assumes."),
        ([36.0], [40.0], "Joint 1 is 10 % softer than the controller assumes."),
        ([10.0], [40.0], "Joint 1 is 0.25 times as stiff as the controller assumes."),
        ([40.2], [40.0], "Joint 1 is as stiff as the controller assumes."),
        ([43.0, 3.5], [20.0, 3.5], "joint 2 is as stiff as assumed."),
    ],
)
def test_against_the_nominal_stiffness(K: list[float], nominal: list[float], said: str) -> None:
    assert said in answer_sentence(fit(K), Elasticity(nominal, [0.1] * len(K)))


def test_a_difference_within_the_uncertainty_is_none() -> None:
    sentence = answer_sentence(fit([43.5], error=1.0), Elasticity([42.0], [0.1]))
    assert sentence == "Joint 1 is as stiff as the controller assumes."


def test_without_a_nominal_stiffness() -> None:
    assert answer_sentence(fit([43.0, 7.5])) == (
        "Joint 1 and joint 2 have stiffnesses of 43.0 N·m/rad and 7.50 N·m/rad, seen from the motor."
    )


@pytest.mark.parametrize("K", [-3.0, 0.015, float("nan")])
def test_what_the_records_do_not_tell_is_not_told(K: float) -> None:
    assert "do not tell the stiffness of joint 2" in answer_sentence(fit([43.0, K]))
