"""Frequency responses ready to draw: measured points and the models over them, on one phase branch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.answer import without
from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
from jointid.joints import Elasticity, Inertia, motor_response, resonances
from jointid.reporting.drawing import Symbol
from jointid.study import Analysis
from jointid.transfer_matrix import TransferMatrix, single_record_response

MEASURED, NOMINAL, IDENTIFIED, WANTED = "#000000", "#D55E00", "#0072B2", "#9A9A9A"
"""One colour per meaning, told apart by the colour-blind as well (Okabe and Ito)."""

_SYMBOLS: tuple[Symbol, ...] = ("ring", "square", "circle")


@dataclass(frozen=True, eq=False)
class Curve:
    """One frequency response in a figure."""

    name: str
    colour: str
    frequency_hz: Floats
    H: Complexes
    error: Floats | None = None
    """Root of the complex variance."""
    symbol: Symbol | None = None
    """Of measured points; None for a model's line."""
    dash: tuple[float, ...] = ()


def element_curves(analysis: Analysis, pose: str, joint: int) -> list[Curve]:
    """H_jj of the models, then as measured by equations (17)-(18).

    Where friction or a delay was found, the points from torques without it are full, as measured they
    are rings.
    """
    curves = _models(analysis, pose, joint)
    measured = analysis.transfer_matrices[pose]
    fit, freed = analysis.fit, analysis.freed_transfer_matrices.get(pose)
    if freed is None or (fit.friction is None and fit.delay is None):
        return [*curves, _points("measured", measured, joint, "circle")]
    return [
        *curves,
        _points("measured", measured, joint, "ring", error=False),
        _points(without(fit), freed, joint, "circle"),
    ]


def single_record_curves(analysis: Analysis, pose: str, joint: int) -> list[Curve]:
    """H_jj of the models, then acceleration over torque of one joint from each record alone."""
    rows = analysis.study.of_pose(pose)
    omega = analysis.phasors.omega[rows]
    response = single_record_response(analysis.phasors)[rows, joint]
    series = analysis.phasors.select(rows).series()
    curves = _models(analysis, pose, joint)
    for k, index in enumerate(series):
        name = "each record alone" if len(series) == 1 else f"record {k + 1} alone"
        symbol = _SYMBOLS[k % len(_SYMBOLS)]
        frequency = omega[index] / (2 * np.pi)
        curves.append(Curve(name, MEASURED, frequency, response[index], symbol=symbol))
    return curves


def _points(
    name: str, matrix: TransferMatrix, joint: int, symbol: Symbol, *, error: bool = True
) -> Curve:
    deviation = matrix.standard_deviation[:, joint, joint] if error else None
    frequency = matrix.omega / (2 * np.pi)
    return Curve(name, MEASURED, frequency, matrix.H[:, joint, joint], deviation, symbol)


def _models(analysis: Analysis, pose: str, joint: int) -> list[Curve]:
    """Nominal and identified H_jj; an estimate that is no spring has no model."""
    inertia = analysis.study.poses[pose] if pose else analysis.study.inertia
    band = band_of(analysis.phasors.omega[analysis.study.of_pose(pose)] / (2 * np.pi))
    curves = []
    if analysis.study.nominal is not None:
        f, H = _model(band, inertia, analysis.study.nominal)
        curves.append(Curve("nominal", NOMINAL, f, H[:, joint, joint], dash=(4, 2)))
    try:
        f, H = _model(band, inertia, analysis.fit.elasticity)
    except JointIdError:
        return curves
    return [*curves, Curve("identified", IDENTIFIED, f, H[:, joint, joint])]


def _model(
    band: tuple[float, float], inertia: Inertia, elasticity: Elasticity
) -> tuple[Floats, Complexes]:
    """A curve dense enough for its peaks."""
    peaks = [peak * np.geomspace(0.97, 1.03, 31) for peak in resonances(inertia, elasticity)]
    f = np.concatenate([np.geomspace(*band, 240), *peaks])
    f = np.unique(f[(f >= band[0]) & (f <= band[1])])
    return f, motor_response(2 * np.pi * f, inertia, elasticity)


def band_of(frequency_hz: Floats) -> tuple[float, float]:
    """Measured band and a little more, Hz."""
    low, high = float(frequency_hz.min()), float(frequency_hz.max())
    margin = 1.12 if high > 1.5 * low else 2.0
    return low / margin, high * margin


def magnitude_limits(analysis: Analysis, pose: str, joint: int) -> tuple[float, float]:
    """Range of |H_jj|, measured and modelled, so that the figures of a joint share their scale."""
    sizes = [np.abs(curve.H) for curve in _models(analysis, pose, joint)]
    for matrices in (analysis.transfer_matrices, analysis.freed_transfer_matrices):
        if pose in matrices:
            sizes.append(np.abs(matrices[pose].H[:, joint, joint]))
    single = np.abs(single_record_response(analysis.phasors)[analysis.study.of_pose(pose), joint])
    every = np.concatenate(sizes) if sizes else single
    every = every[np.isfinite(every) & (every > 0)]
    if not every.size:
        return 1.0, 10.0
    low, high = float(every.min()), float(every.max())
    near = single[(single > low / 10) & (single < high * 10)]
    return min(low, float(near.min(initial=low))), max(high, float(near.max(initial=high)))


def phase_of(curve: Curve, curves: Sequence[Curve]) -> Floats:
    """Phase in degrees on the branch nearest to the last model, so that points do not jump by 360°."""
    reference = next((c for c in reversed(curves) if c.symbol is None), None)
    angle = np.degrees(np.angle(curve.H))
    centre: Floats | float = 90.0
    if reference is not None:
        unwrapped = np.degrees(np.unwrap(np.angle(reference.H)))
        unwrapped -= 360 * np.round((np.median(unwrapped) - 90) / 360)
        centre = np.interp(np.log(curve.frequency_hz), np.log(reference.frequency_hz), unwrapped)
    return np.asarray(centre + (angle - centre + 180) % 360 - 180)
