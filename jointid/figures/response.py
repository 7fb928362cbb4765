"""The transfer matrix of the motors: Figures 3, 4 and 5 of the paper, for n joints."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go

from jointid.arrays import Floats
from jointid.figures.response_curves import (
    Response,
    element_name,
    freed_or_measured,
    identified,
    magnitude_limits,
    measured,
    nominal,
    phase_deg,
    single_records,
)
from jointid.figures.style import (
    Axis,
    Trace,
    colours,
    figure,
    frequency_axis,
    line,
    log_axis,
    phase_axis,
    points,
)
from jointid.study import Analysis

_UNIT = "1/(kg·m²)"
_OPEN_SYMBOLS = ("circle-open", "square-open", "diamond-open", "triangle-up-open")


@dataclass(frozen=True, eq=False)
class _Curve:
    """One frequency response in the figure."""

    name: str
    colour: str
    response: Response
    symbol: str = ""  # of measured points; empty for a model's line
    dash: str = "solid"


def element_response(
    analysis: Analysis, i: int, j: int, *, pose: str = "", dark: bool = False
) -> go.Figure:
    """Magnitude and phase of H_ij: measured points with ± one standard error, models as lines.

    Where friction or a delay was found, points from torques without it are drawn full, those as
    measured open. Off the diagonal H_ji is shown too: without errors it equals H_ij.

    Parameters
    ----------
    analysis : Analysis
    i, j : int
        Joint that accelerates and joint whose torque acts, from 0.
    pose : str
        "" for records without a pose.
    """
    ink = colours(dark)
    freed, removed = freed_or_measured(analysis, pose)
    name = removed or f"measured {element_name(i, j)}"
    if i != j:
        name = f"measured {element_name(i, j)}{removed and ', ' + removed}"
    curves = [_Curve(name, ink.measured, measured(freed, i, j), "circle")]
    if i != j:
        name = f"measured {element_name(j, i)}{removed and ', ' + removed}"
        curves.append(_Curve(name, ink.measured, measured(freed, j, i), "square-open"))
    elif freed is not analysis.transfer_matrices[pose]:
        raw = measured(analysis.transfer_matrices[pose], i, j)
        curves.append(_Curve("as measured", ink.measured, raw, "circle-open"))
    models = _models(analysis, pose, i, j, dark)
    return _bode([*models, *curves], dark, magnitude_limits(analysis, pose, i) if i == j else None)


def single_record(analysis: Analysis, joint: int, *, pose: str = "", dark: bool = False) -> go.Figure:
    """Figure 3: acceleration over torque of one joint from each record alone, beside the model of H_jj.

    The other joints' controllers are in it; drawn to the scale of ``element_response``.
    """
    responses = single_records(analysis, pose, joint)
    curves = []
    for k, response in enumerate(responses):
        name = f"record {k + 1} of each frequency" if len(responses) > 1 else "each record alone"
        symbol = _OPEN_SYMBOLS[k % len(_OPEN_SYMBOLS)]
        curves.append(_Curve(name, colours(dark).measured, response, symbol))
    models = _models(analysis, pose, joint, joint, dark)
    return _bode([*models, *curves], dark, magnitude_limits(analysis, pose, joint))


def model_over_measurement(
    analysis: Analysis, joint: int, *, pose: str = "", dark: bool = False
) -> go.Figure:
    """Magnitude of H_jj only, small: what was measured, the identified and the nominal model.

    The measurement is freed of the friction and the delay that were found.
    """
    matrix, removed = freed_or_measured(analysis, pose)
    name = f"measured{removed and ', ' + removed}"
    curves = [
        *_models(analysis, pose, joint, joint, dark),
        _Curve(name, colours(dark).measured, measured(matrix, joint, joint), "circle"),
    ]
    traces = [_magnitude(curve, element_name(joint, joint)) for curve in curves]
    title = f"|{element_name(joint, joint)}| ({_UNIT})"
    return figure(
        traces,
        height=300,
        dark=dark,
        xaxis=frequency_axis(_frequencies(curves)),
        yaxis=log_axis(title, range=_log_range(magnitude_limits(analysis, pose, joint))),
    )


def _models(analysis: Analysis, pose: str, i: int, j: int, dark: bool) -> list[_Curve]:
    """Identified over nominal, where there are such."""
    ink = colours(dark)
    curves = []
    if (assumed := nominal(analysis, pose, i, j)) is not None:
        curves.append(_Curve("nominal model", ink.nominal, assumed, dash="dash"))
    if (found := identified(analysis, pose, i, j)) is not None:
        curves.append(_Curve("identified model", ink.identified, found))
    return curves


def _bode(curves: list[_Curve], dark: bool, magnitudes: tuple[float, float] | None) -> go.Figure:
    model = next((c.response for c in reversed(curves) if not c.symbol), None)
    phases = [phase_deg(curve.response, model) for curve in curves]
    traces: list[Trace] = []
    for curve, phase in zip(curves, phases, strict=True):
        traces += [_magnitude(curve, curve.name), _phase(curve, phase)]
    y: Axis = {"domain": [0.42, 1.0]}
    if magnitudes is not None:
        y["range"] = _log_range(magnitudes)
    known = np.concatenate(phases)
    known = known[np.isfinite(known)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 180.0)
    if magnitudes is not None:  # a diagonal element; the same scale for all views of it
        low, high = min(low, -90.0), max(high, 180.0)
    return figure(
        traces,
        height=520,
        dark=dark,
        xaxis=frequency_axis(_frequencies(curves), anchor="y2"),
        yaxis=log_axis(f"Magnitude ({_UNIT})", **y),
        yaxis2=phase_axis(domain=[0.0, 0.36], range=[min(low, 0.0) - 15, max(high, 90.0) + 15]),
        margin={"l": 8, "r": 12, "t": 60, "b": 8},  # room for a legend of two lines
    )


def _magnitude(curve: _Curve, label: str) -> Trace:
    size, error = np.abs(curve.response.H), curve.response.error
    more = {}
    if curve.symbol and error is not None:
        # A log axis has no room for bars below zero.
        bars = {"array": error, "arrayminus": np.minimum(error, 0.95 * size), "symmetric": False}
        more = {"customdata": error, "error": bars}
    plus = f" ± %{{customdata:.2g}} {_UNIT}" if more else f" {_UNIT}"
    hover = f"%{{x:.4g}} Hz<br>%{{y:.4g}}{plus}<extra>{label}</extra>"
    return _trace(curve, size, hovertemplate=hover, **more)


def _phase(curve: _Curve, phase: Floats) -> Trace:
    relative = curve.response.relative_error
    more = {}
    if curve.symbol and relative is not None:
        error = np.degrees(np.minimum(relative, np.pi))
        more = {"customdata": error, "error": {"array": error}}
    plus = " ± %{customdata:.2g}°" if more else ""
    hover = f"%{{x:.4g}} Hz<br>%{{y:.1f}}°{plus}<extra>{curve.name}</extra>"
    return _trace(curve, phase, hovertemplate=hover, **more, yaxis="y2", showlegend=False)


def _trace(curve: _Curve, y: Floats, **more: Any) -> Trace:
    """Points for what was measured, a line for a model."""
    x = curve.response.frequency_hz
    if curve.symbol:
        return points(x, y, curve.name, curve.colour, marker={"symbol": curve.symbol}, **more)
    return line(x, y, curve.name, curve.colour, line={"dash": curve.dash}, **more)


def _log_range(limits: tuple[float, float]) -> list[float]:
    return [float(np.log10(limits[0] / 1.25)), float(np.log10(limits[1] * 1.25))]


def _frequencies(curves: Iterable[_Curve]) -> Floats:
    return np.concatenate([c.response.frequency_hz for c in curves if c.symbol])
