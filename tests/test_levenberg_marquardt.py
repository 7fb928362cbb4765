"""The iteration of the maximum-likelihood fit on functions whose minimum is known."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jointid.estimation.estimators import levenberg_marquardt
from jointid.estimation.estimators.levenberg_marquardt import minimised

Array = np.ndarray
Residual = Callable[[Array], tuple[Array, Array]]
"""Residuals and their Jacobian."""


class Layout:
    """Lower bounds of parameters, of none of the gears' laws."""

    def __init__(self, lowest: list[float]) -> None:
        self.lowest = np.array(lowest)

    def __contains__(self, name: str) -> bool:
        return False


def bowl(p: Array) -> tuple[Array, Array]:
    """Minimum 0 at (3, -1), in units that differ by a thousand."""
    J = np.array([[200.0, 0.05], [0.0, 0.2], [100.0, -0.1]])
    return J @ (p - [3.0, -1.0]), J


def valley(p: Array) -> tuple[Array, Array]:
    """Rosenbrock's curved valley, with its minimum 0 at (1, 1)."""
    x, y = p
    return np.array([30 * (y - x * x), 3 * (1 - x)]), np.array([[-60 * x, 30.0], [-3.0, 0.0]])


def run(
    monkeypatch: pytest.MonkeyPatch,
    residual: Residual,
    start: list[float],
    lowest: list[float],
    *,
    feasible: Callable[[Array], bool] = lambda _: True,
    rest: float = 0.0,
    **settings: Any,
) -> tuple[Array, Array, int]:
    """Where the iteration ends, the normal matrix there, and how many points it tried."""
    tried = []

    def cost(p: Array) -> float:
        return 0.5 * float(residual(p)[0] @ residual(p)[0]) + rest

    def of(_: Any, p: Array, __: Any) -> Any:
        tried.append(p)
        return SimpleNamespace(cost=cost(p))

    def quadratic(_: Any, p: Array) -> tuple[float, Array, Array]:
        r, J = residual(p)
        return cost(p), J.T @ r, J.T @ J

    monkeypatch.setattr(levenberg_marquardt, "WhitenedResidual", SimpleNamespace(of=of))
    monkeypatch.setattr(levenberg_marquardt, "quadratic", quadratic)
    monkeypatch.setattr(levenberg_marquardt, "penalty", lambda *_: 0.0)
    problem: Any = SimpleNamespace(
        layout=Layout(lowest), rows=4, motion=None, ends=None, feasible=feasible
    )
    given = {"damping": 1e-3} | settings
    found, normal = minimised(problem, np.array(start), np.ones(2), **given)
    return found, normal, len(tried)


NONE = [-np.inf, -np.inf]


def test_a_linear_problem_is_solved_within_a_few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    found, normal, tried = run(monkeypatch, bowl, [0.0, 50.0], NONE)
    np.testing.assert_allclose(found, [3.0, -1.0], atol=1e-4)
    np.testing.assert_allclose(normal, bowl(found)[1].T @ bowl(found)[1])
    assert tried <= 4


def test_a_curved_valley_is_followed_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some steps are too long at first: stronger damping shortens them."""
    found, _, tried = run(monkeypatch, valley, [-1.2, 1.0], NONE)
    np.testing.assert_allclose(found, [1.0, 1.0], atol=1e-3)
    assert tried < 60


@pytest.mark.parametrize("start", [[4.0, 5.0], [3.5, 5.0]])
def test_a_parameter_stays_at_its_bound_while_others_reach_their_optimum(
    monkeypatch: pytest.MonkeyPatch, start: list[float]
) -> None:
    found, _, _ = run(monkeypatch, bowl, start, [3.5, -np.inf])
    J = bowl(found)[1]
    at_bound = -1.0 - 0.5 * (J[:, 0] @ J[:, 1]) / (J[:, 1] @ J[:, 1])
    np.testing.assert_allclose(found, [3.5, at_bound], atol=1e-3)


def test_a_parameter_leaves_its_bound_towards_the_optimum(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _, _ = run(monkeypatch, bowl, [2.0, -5.0], [2.0, -5.0])
    np.testing.assert_allclose(found, [3.0, -1.0], atol=1e-3)


def test_points_that_are_not_feasible_are_not_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """The optimum is out of reach: the iteration ends on this side of the border."""
    found, _, _ = run(monkeypatch, bowl, [0.0, 0.0], NONE, feasible=lambda p: bool(p[0] < 2.0))
    assert 1.0 < found[0] < 2.0


def test_of_a_poor_model_a_rough_optimum_suffices(monkeypatch: pytest.MonkeyPatch) -> None:
    exact, _, most = run(monkeypatch, valley, [-0.5, 1.0], NONE)
    rough, _, few = run(monkeypatch, valley, [-0.5, 1.0], NONE, roughly=True)
    assert few < most
    costs = [np.sum(valley(p)[0] ** 2) for p in (exact, rough, np.array([-0.5, 1.0]))]
    assert costs == sorted(costs)
    assert costs[1] < 0.1 * costs[2]


def test_strong_damping_does_not_end_the_iteration(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short step shows an optimum only where the damping is weak: here it is 20 errors away."""
    found, _, _ = run(monkeypatch, bowl, [3.09, -1.0], NONE, damping=2500.0)
    np.testing.assert_allclose(found, [3.0, -1.0], atol=1e-4)
