"""Models that may be fitted to the data, and what came of the choice among them."""

from __future__ import annotations

from dataclasses import dataclass

from jointid.errors import JointIdError
from jointid.estimation.likelihood import LikelihoodEstimate


@dataclass(frozen=True)
class Model:
    """What is fitted beside K and D."""

    reversal: float | None
    """Share of the largest velocity below which friction is free; None: no friction."""
    delay: bool
    curve: bool = False
    """Whether friction may change with speed beyond its viscous part."""

    @property
    def name(self) -> str:
        """The model in words."""
        friction = ["friction that varies with speed" if self.curve else "friction"]
        parts = ["elasticity"] + friction * (self.reversal is not None) + ["delay"] * self.delay
        return " + ".join(parts) + (
            f", reversals free below {100 * self.reversal:g} %" if self.reversal else ""
        )


@dataclass(frozen=True)
class Candidate:
    """One model that the choice looked at."""

    name: str
    friction: bool
    delay: bool
    reversal: float
    """Share of the largest velocity below which friction was left free."""
    curve: bool
    """Whether friction might change with speed beyond its viscous part."""
    problem: str
    """Why it could not be fitted; empty when it could."""
    cost: float
    expected_cost: float
    parameters: int
    """Real numbers fitted, the free shapes of friction included."""
    criterion: float
    """Information criterion, 2 · cost over the best model's misfit + penalty; the least is chosen.
    Infinite where the model could not be fitted, or its friction or delay is none."""
    chosen: bool


@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen model, its estimate, and what it was chosen from."""

    model: Model
    estimate: LikelihoodEstimate | JointIdError
    """The error where no model could be fitted."""
    candidates: tuple[Candidate, ...]
    """Best first."""
