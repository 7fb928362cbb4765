"""Frequency responses as the report draws them: which, by what name, with what colour and symbol."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jointid.arrays import Floats
from jointid.figures.response_curves import (
    Response,
    freed_or_measured,
    identified,
    measured,
    nominal,
    phase_deg,
    single_records,
)
from jointid.reporting.drawing import Symbol
from jointid.study import Analysis

MEASURED, NOMINAL, IDENTIFIED, WANTED = "#000000", "#D55E00", "#0072B2", "#9A9A9A"
"""One colour per meaning, told apart by the colour-blind as well (Okabe and Ito)."""

_SYMBOLS: tuple[Symbol, ...] = ("ring", "square", "circle")


@dataclass(frozen=True, eq=False)
class Curve:
    """One frequency response in a drawing."""

    name: str
    colour: str
    response: Response
    symbol: Symbol | None = None
    """Of measured points; None for a model's line."""
    dash: tuple[float, ...] = ()
    has_bars: bool = True
    """Whether the errors of points are drawn, where they are known."""


def element_curves(analysis: Analysis, pose: str, joint: int) -> list[Curve]:
    """H_jj of the models, then as measured by equations (17)-(18).

    Where friction or a delay was found, the points from torques without it are full, as measured they
    are rings.
    """
    curves = _models(analysis, pose, joint)
    raw, (freed, removed) = analysis.transfer_matrices[pose], freed_or_measured(analysis, pose)
    if removed:
        rings = measured(raw, joint, joint)
        curves.append(Curve("measured", MEASURED, rings, "ring", has_bars=False))
    return [*curves, Curve(removed or "measured", MEASURED, measured(freed, joint, joint), "circle")]


def single_record_curves(analysis: Analysis, pose: str, joint: int) -> list[Curve]:
    """H_jj of the models, then acceleration over torque of one joint from each record alone."""
    curves = _models(analysis, pose, joint)
    responses = single_records(analysis, pose, joint)
    for k, response in enumerate(responses):
        name = "each record alone" if len(responses) == 1 else f"record {k + 1} alone"
        curves.append(Curve(name, MEASURED, response, _SYMBOLS[k % len(_SYMBOLS)]))
    return curves


def phase_of(curve: Curve, curves: Sequence[Curve]) -> Floats:
    """Phase in degrees on the branch nearest to the last model."""
    model = next((c.response for c in reversed(curves) if c.symbol is None), None)
    return phase_deg(curve.response, model)


def _models(analysis: Analysis, pose: str, joint: int) -> list[Curve]:
    """Nominal and identified H_jj, where there are such."""
    curves = []
    if (assumed := nominal(analysis, pose, joint, joint)) is not None:
        curves.append(Curve("nominal", NOMINAL, assumed, dash=(4, 2)))
    if (found := identified(analysis, pose, joint, joint)) is not None:
        curves.append(Curve("identified", IDENTIFIED, found))
    return curves
