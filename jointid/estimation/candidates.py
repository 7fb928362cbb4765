"""Candidate models and the result of the model selection."""

from __future__ import annotations

from dataclasses import dataclass, replace

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.estimation.effects import EFFECTS
from jointid.estimation.likelihood import LikelihoodEstimate


@dataclass(frozen=True)
class Model:
    """Parameters fitted in addition to K and D."""

    reversal: float | None
    """Velocity below which friction is free, over the record's largest; None: no friction."""
    delay: bool
    curve: bool = False
    """Whether friction has a part that varies nonlinearly with speed."""
    effects: tuple[str, ...] = ()
    """Keys of ``EFFECTS``, in its order."""

    @property
    def parts(self) -> tuple[str, ...]:
        """What the model has beside K and D: "friction", "delay", keys of ``EFFECTS``."""
        friction = ("friction",) if self.reversal is not None else ()
        return (*friction, *(("delay",) if self.delay else ()), *self.effects)

    def with_part(self, part: str) -> Model:
        """The model with one more part."""
        if part == "friction":
            return replace(self, reversal=0.0)
        if part == "delay":
            return replace(self, delay=True)
        return replace(self, effects=tuple(e for e in EFFECTS if e in (*self.effects, part)))

    def without(self, part: str) -> Model:
        """The model with one part less."""
        if part == "friction":
            return replace(self, reversal=None, curve=False)
        if part == "delay":
            return replace(self, delay=False)
        return replace(self, effects=tuple(e for e in self.effects if e != part))

    @property
    def name(self) -> str:
        """Description of the model."""
        friction = ["friction that varies with speed" if self.curve else "friction"]
        parts = ["elasticity"] + friction * (self.reversal is not None) + ["delay"] * self.delay
        parts += [EFFECTS[name].name for name in self.effects]
        return " + ".join(parts) + (
            f", reversals free below {100 * self.reversal:g} %" if self.reversal else ""
        )


@dataclass(frozen=True)
class Candidate:
    """One model of the comparison."""

    name: str
    friction: bool
    delay: bool
    reversal: float
    """Velocity below which friction was free, over the record's largest."""
    curve: bool
    """Whether friction has a part that varies nonlinearly with speed."""
    problem: str
    """Reason why it was not fitted; empty otherwise."""
    cost: float
    expected_cost: float
    parameters: int
    """Number of fitted real numbers, those of free friction included."""
    criterion: float
    """Information criterion, 2 · cost over the best model's misfit + penalty; the smallest is chosen.
    Infinite where the model was not fitted, or a part of it is not significant."""
    chosen: bool
    parts: tuple[str, ...] = ()
    """What it has beside K and D, see ``Model.parts``."""


@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen model, its estimate, and all candidates."""

    model: Model
    estimate: LikelihoodEstimate | JointIdError
    """The error if no model could be fitted."""
    candidates: tuple[Candidate, ...]
    """Best first."""
    spread: Floats
    """Covariance of K1 ... Kn, D1 ... Dn by the choice between models, shape (2n, 2n)."""
