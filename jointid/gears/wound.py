"""Deflection of nonlinear gears in sines and motions together, from starts that may not converge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from jointid.arrays import Complexes, Floats
from jointid.gears.driven_gears import DrivenGears
from jointid.gears.harmonic_balance import WoundGears, beyond_linear
from jointid.gears.laws import GearLaws
from jointid.gears.motor_motion import MotorMotion


@dataclass(frozen=True, eq=False)
class Wound:
    """Nonlinear gears at some parameters."""

    beyond: Complexes
    """Mean and phasors of the torque beyond K δ, shape (r, n, 1 + H), N·m."""
    of_sines: WoundGears | None
    of_motions: DrivenGears | None

    def by_law(self, laws: GearLaws, step: Floats) -> tuple[Complexes, Floats | float]:
        """Change of this torque to other laws at the same deflection, over steps (n, 1) of a parameter.

        In sines, shape (r, n, 1 + H) of r sines, and in motions, shape (n, N).
        """
        of_sines = self.beyond[:0]
        of_motions: Floats | float = 0.0
        if self.of_sines is not None:
            there, *_ = beyond_linear(laws, self.of_sines.delta, self.of_sines.points)
            of_sines = (there[..., : self.beyond.shape[2]] - self.of_sines.beyond) / step
        if self.of_motions is not None:
            of_motions = (self.of_motions.at_deflection(laws) - self.of_motions.beyond) / step
        return of_sines, of_motions

    def alone(self) -> Wound | None:
        """That in motions, without what further evaluations need."""
        return Wound(self.beyond[:0], None, replace(self.of_motions)) if self.of_motions else None

    def on(self, motors: MotorMotion) -> Wound:
        """The start of solutions at similar parameters, over other steps of the same motion."""
        return Wound(self.beyond, None, self.of_motions and self.of_motions.on(motors))


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
    has_backlash: bool,
) -> DrivenGears:
    """Solution from the first start that converges.

    From none, solutions with a stronger observer come before: an arm on the wrong flank of a backlash
    would stay on it. Other laws need them where they do not converge without.
    """
    solved, begun = partial(solve, strength), [each for each in starts if each is not None]
    if begun or not has_backlash:
        found = first_finite(solved, begun)
        if begun or np.isfinite(found.delta).all():
            return found
    far, near = _STRONGER
    return solved(solve(near * strength, solve(far * strength, None)))
