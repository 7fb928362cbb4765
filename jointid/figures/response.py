"""The transfer matrix of the motors: Figures 3, 4 and 5 of the paper, for n joints."""

from typing import Any, Literal, get_args

import numpy as np
import plotly.graph_objects as go

from jointid.analysis import Analysis
from jointid.arrays import Floats
from jointid.figures.response_curves import (
    Curve,
    Source,
    compensated_or_measured,
    element_curves,
    element_name,
    identified,
    magnitude_limits,
    measured,
    measured_frequencies,
    model_curves,
    phases_deg,
    single_record_curves,
)
from jointid.figures.style import MARGIN, Axis, Sketch, frequency_axis, linear_axis, log_axis, plain_text

_UNIT = "1/(kg·m²)"
_TWO_LINES = MARGIN | {"t": 70}
"""Margins with room for a legend of two lines."""
View = Literal["Magnitude and phase", "In dB", "Nyquist"]
VIEWS: tuple[View, ...] = get_args(View)
"""Ways to draw a frequency response; 0 dB is 1/(kg·m²)."""


def element_response(
    analysis: Analysis, i: int, j: int, *, pose: str = "", dark: bool = False, view: View = VIEWS[0]
) -> go.Figure:
    """Draw H_ij: measured points with ± one standard error, models as lines, see ``element_curves``.

    Joint i accelerates and the torque of joint j acts, from 0; the pose is "" for records without one.
    """
    limits = magnitude_limits(analysis, pose, i) if i == j else None
    return _drawn(element_curves(analysis, pose, i, j), dark, limits, view)


def single_record(
    analysis: Analysis, joint: int, *, pose: str = "", dark: bool = False, view: View = VIEWS[0]
) -> go.Figure:
    """Figure 3: acceleration over torque of one joint from each record alone, beside the model of H_jj.

    The other joints' controllers are in it; drawn to the scale of ``element_response``.
    """
    curves = single_record_curves(analysis, pose, joint)
    return _drawn(curves, dark, magnitude_limits(analysis, pose, joint), view)


def model_over_measurement(
    analysis: Analysis, joint: int, *, pose: str = "", dark: bool = False
) -> go.Figure:
    """Small plot of |H_jj|: friction- and delay-compensated measurement, and the models."""
    matrix, removed = compensated_or_measured(analysis, pose)
    name = f"measured{removed and ', ' + removed}"
    curves = [
        *model_curves(analysis, pose, joint, joint),
        Curve(name, "measured", measured(matrix, joint, joint), "circle"),
    ]
    return _magnitudes(curves, joint, [magnitude_limits(analysis, pose, joint)], 300, dark)


def compared_responses(
    analyses: tuple[Analysis, Analysis], names: tuple[str, str], joint: int, *, dark: bool = False
) -> go.Figure:
    """Plot |H_jj| of two studies, each with its model as a line and its measurement as points.

    Both have a transfer matrix, and their first poses are drawn; the joint counts from 0.
    """
    curves, limits = [], []
    sources: tuple[Source, Source] = ("identified", "other")
    for analysis, name, source in zip(analyses, map(plain_text, names), sources, strict=True):
        pose = next(iter(analysis.transfer_matrices))
        matrix, _ = compensated_or_measured(analysis, pose)
        if (model := identified(analysis, pose, joint, joint)) is not None:
            curves.append(Curve(f"{name}, model", source, model))
        found = measured(matrix, joint, joint)
        curves.append(Curve(f"{name}, measured", source, found, "circle-open"))
        limits.append(magnitude_limits(analysis, pose, joint))
    return _magnitudes(curves, joint, limits, 340, dark)


def _magnitudes(
    curves: list[Curve], joint: int, limits: list[tuple[float, float]], height: int, dark: bool
) -> go.Figure:
    """|H_jj| of several curves, to the largest of the limits."""
    sketch = Sketch(dark)
    for curve in curves:
        _add_magnitude(sketch, curve)
    low, high = zip(*limits, strict=True)
    title = f"|{element_name(joint, joint)}| ({_UNIT})"
    size = log_axis(title, range=_log_range((min(low), max(high))))
    x = frequency_axis(measured_frequencies(curves))
    return sketch.figure(x, size, height=height, margin=_TWO_LINES)


def _drawn(
    curves: list[Curve], dark: bool, magnitudes: tuple[float, float] | None, view: View
) -> go.Figure:
    if view == "Nyquist":
        return _nyquist(curves, dark)
    decibels = view == "In dB"
    sketch, phases = Sketch(dark), phases_deg(curves)
    for curve, phase in zip(curves, phases, strict=True):
        _add_magnitude(sketch, curve, decibels=decibels)
        _add_phase(sketch, curve, phase)
    y: Axis = {"share": 1.6}
    if magnitudes is not None:
        y["range"] = [20 * limit if decibels else limit for limit in _log_range(magnitudes)]
    size = linear_axis(f"Magnitude (dB of {_UNIT})", **y)
    if not decibels:
        size = log_axis(f"Magnitude ({_UNIT})", **y)
    known = np.concatenate(phases)
    known = known[np.isfinite(known)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 180.0)
    if magnitudes is not None:  # a diagonal element; the same scale for all views of it
        low, high = min(low, -90.0), max(high, 180.0)
    x, span = frequency_axis(measured_frequencies(curves)), [min(low, 0.0) - 15, max(high, 90.0) + 15]
    turn = linear_axis("Phase (°)", range=span, tick0=0, dtick=90)
    return sketch.figure(x, size, turn, height=520, margin=_TWO_LINES)


def _nyquist(curves: list[Curve], dark: bool) -> go.Figure:
    """Imaginary over real part, to one scale; the error is the same along both."""
    sketch = Sketch(dark)
    for curve in curves:
        H, error = curve.response.H, curve.response.error
        more: dict[str, Any] = {"customdata": curve.response.frequency_hz}
        if curve.symbol and error is not None:
            more |= {"error": {"array": error}, "error_x": {"type": "data", "array": error, "width": 3}}
        hover = f"%{{customdata:.4g}} Hz<br>%{{x:.4g}} + %{{y:.4g}} i {_UNIT}<extra>{curve.name}</extra>"
        _add(sketch, curve, H.real, H.imag, hovertemplate=hover, **more)
    axes = linear_axis(f"Real part ({_UNIT})"), linear_axis(f"Imaginary part ({_UNIT})", scaleanchor="x")
    return sketch.figure(*axes, height=520, margin=_TWO_LINES)


def _add_magnitude(sketch: Sketch, curve: Curve, *, decibels: bool = False) -> None:
    size, error = np.abs(curve.response.H), curve.response.error
    scale, unit = (_decibels, "dB") if decibels else (np.asarray, _UNIT)
    more: dict[str, Any] = {}
    if curve.symbol and error is not None:
        # A logarithm has no room for bars below zero.
        above = scale(size + error) - scale(size)
        below = scale(size) - scale(size - np.minimum(error, 0.95 * size))
        bars = {"array": above, "arrayminus": below, "symmetric": False}
        more = {"customdata": above, "error": bars}
    plus = f" ± %{{customdata:.2g}} {unit}" if more else f" {unit}"
    hover = f"%{{x:.4g}} Hz<br>%{{y:.4g}}{plus}<extra>{curve.name}</extra>"
    _add(sketch, curve, curve.response.frequency_hz, scale(size), hovertemplate=hover, **more)


def _decibels(size: Floats) -> Floats:
    return 20 * np.log10(np.maximum(size, 1e-300))


def _add_phase(sketch: Sketch, curve: Curve, phase: Floats) -> None:
    relative = curve.response.relative_error
    more: dict[str, Any] = {"yaxis": "y2", "showlegend": False}
    plus = ""
    if curve.symbol and relative is not None:
        error = np.degrees(np.minimum(relative, np.pi))
        more |= {"customdata": error, "error": {"array": error}}
        plus = " ± %{customdata:.2g}°"
    hover = f"%{{x:.4g}} Hz<br>%{{y:.1f}}°{plus}<extra>{curve.name}</extra>"
    _add(sketch, curve, curve.response.frequency_hz, phase, hovertemplate=hover, **more)


def _add(sketch: Sketch, curve: Curve, x: Floats, y: Floats, **more: Any) -> None:
    """Points for measurements, a line for a model."""
    if curve.symbol:
        sketch.points(x, y, curve.name, curve.source, marker={"symbol": curve.symbol}, **more)
        return
    dash = "dash" if curve.source == "nominal" else "solid"
    sketch.line(x, y, curve.name, curve.source, dash=dash, **more)


def _log_range(limits: tuple[float, float]) -> list[float]:
    return [float(np.log10(limits[0] / 1.25)), float(np.log10(limits[1] * 1.25))]
