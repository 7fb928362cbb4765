"""Deflection of nonlinear gears in sines and motions together."""

from dataclasses import dataclass

from jointid.arrays import Complexes, Floats
from jointid.gears.driven_gears import DrivenGears
from jointid.gears.harmonic_balance import WoundGears, beyond_linear
from jointid.gears.laws import GearLaws


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
