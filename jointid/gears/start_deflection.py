"""Deflection of gears from several start values, some of which do not converge."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

import numpy as np

from jointid.gears.driven_gears import DrivenGears
from jointid.gears.harmonic_balance import WoundGears

_STRONGER = (10.0, 3.0)
"""Factors on the observer of gears in motions; each solution starts the next smaller factor."""

_Solution = TypeVar("_Solution", WoundGears, DrivenGears)


def first_finite(
    solve: Callable[[_Solution | None], _Solution], starts: Sequence[_Solution | None]
) -> _Solution:
    """Solution from the first start that converges; one from other parameters may not."""
    for start in starts:
        found = solve(start)
        if np.isfinite(found.delta).all():
            return found
    return solve(None)


def from_observers(
    solve: Callable[[float, DrivenGears | None], DrivenGears],
    strength: float,
    starts: Sequence[DrivenGears | None],
) -> DrivenGears:
    """Solution from the first start that converges.

    Without a start, solutions with a stronger observer come before: an arm on the wrong flank of a
    backlash would stay on it.
    """
    solved = partial(solve, strength)
    far, near = _STRONGER
    return first_finite(solved, starts or [solve(near * strength, solve(far * strength, None))])
