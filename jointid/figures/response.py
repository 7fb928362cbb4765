"""The transfer matrix of the motors: Figures 3, 4 and 5 of the paper, for n joints."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from jointid.answer import without
from jointid.arrays import Complexes, Floats
from jointid.errors import JointIdError
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
from jointid.joints import Elasticity, Inertia, motor_response, resonances
from jointid.study import Analysis
from jointid.transfer_matrix import TransferMatrix, single_record_response

_UNIT = "1/(kg·m²)"
_OPEN_SYMBOLS = ("circle-open", "square-open", "diamond-open", "triangle-up-open")


@dataclass(frozen=True)
class _Curve:
    """One frequency response in the figure."""

    name: str
    colour: str
    frequency_hz: Floats
    H: Complexes
    error: Floats | None = None  # root of the complex variance
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
    name = removed or f"measured {_label(i, j)}"
    if i != j:
        name = f"measured {_label(i, j)}{removed and ', ' + removed}"
    curves = [_measured(freed, i, j, ink.measured, "circle", name=name)]
    if i != j:
        name = f"measured {_label(j, i)}{removed and ', ' + removed}"
        curves.append(_measured(freed, j, i, ink.measured, "square-open", name=name))
    elif freed is not analysis.transfer_matrices[pose]:
        raw = analysis.transfer_matrices[pose]
        curves.append(_measured(raw, i, j, ink.measured, "circle-open", name="as measured"))
    models = _models(analysis, pose, i, j, dark)
    return _bode([*models, *curves], dark, _magnitudes(analysis, pose, i) if i == j else None)


def single_record(analysis: Analysis, joint: int, *, pose: str = "", dark: bool = False) -> go.Figure:
    """Figure 3: acceleration over torque of one joint from each record alone, beside the model of H_jj.

    The other joints' controllers are in it; drawn to the scale of ``element_response``.
    """
    rows = analysis.study.of_pose(pose)
    omega = analysis.phasors.omega[rows]
    response = single_record_response(analysis.phasors)[rows, joint]
    ink = colours(dark)
    curves = []
    for k, index in enumerate(analysis.phasors.select(rows).series()):
        f = omega[index] / (2 * np.pi)
        name = "each record alone" if k == 0 else f"record {k + 1} of each frequency"
        symbol = _OPEN_SYMBOLS[k % len(_OPEN_SYMBOLS)]
        curves.append(_Curve(name, ink.measured, f, response[index], symbol=symbol))
    if len(curves) > 1:
        curves[0] = _renamed(curves[0], "record 1 of each frequency")
    models = _models(analysis, pose, joint, joint, dark)
    return _bode([*models, *curves], dark, _magnitudes(analysis, pose, joint))


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
        _measured(matrix, joint, joint, colours(dark).measured, "circle", name=name),
    ]
    traces = [_magnitude(curve, _label(joint, joint)) for curve in curves]
    title = f"|{_label(joint, joint)}| ({_UNIT})"
    return figure(
        traces,
        height=300,
        dark=dark,
        xaxis=frequency_axis(_frequencies(curves)),
        yaxis=log_axis(title, range=_log_range(_magnitudes(analysis, pose, joint))),
    )


def freed_or_measured(analysis: Analysis, pose: str) -> tuple[TransferMatrix, str]:
    """Return the transfer matrix to hold against the model, and what is not in it, in words."""
    removed = without(analysis.fit)
    if not removed or pose not in analysis.freed_transfer_matrices:
        return analysis.transfer_matrices[pose], ""
    return analysis.freed_transfer_matrices[pose], removed


def _measured(matrix: TransferMatrix, i: int, j: int, colour: str, symbol: str, *, name: str) -> _Curve:
    return _Curve(
        name,
        colour,
        matrix.omega / (2 * np.pi),
        matrix.H[:, i, j],
        matrix.standard_deviation[:, i, j],
        symbol,
    )


def _models(analysis: Analysis, pose: str, i: int, j: int, dark: bool) -> list[_Curve]:
    """Identified over nominal; an estimate that is no spring has no model."""
    inertia = analysis.study.poses[pose] if pose else analysis.study.inertia
    measured = analysis.phasors.omega[analysis.study.of_pose(pose)] / (2 * np.pi)
    ink = colours(dark)
    curves = []
    if analysis.study.nominal is not None:
        f, H = _model(measured, inertia, analysis.study.nominal)
        curves.append(_Curve("nominal model", ink.nominal, f, H[:, i, j], dash="dash"))
    try:
        f, H = _model(measured, inertia, analysis.fit.elasticity)
        curves.append(_Curve("identified model", ink.identified, f, H[:, i, j]))
    except JointIdError:
        pass
    return curves


def _model(measured_hz: Floats, inertia: Inertia, elasticity: Elasticity) -> tuple[Floats, Complexes]:
    """A curve dense enough for its peaks, over the measured band and a little more."""
    low, high = float(measured_hz.min()) / 1.12, float(measured_hz.max()) * 1.12
    low, high = (low, high) if high > 1.5 * low else (low / 2, high * 2)
    peaks = [peak * np.geomspace(0.97, 1.03, 41) for peak in resonances(inertia, elasticity)]
    f = np.concatenate([np.geomspace(low, high, 400), *peaks])
    f = np.unique(f[(f >= low) & (f <= high)])
    return f, motor_response(2 * np.pi * f, inertia, elasticity)


def _bode(curves: list[_Curve], dark: bool, magnitudes: tuple[float, float] | None) -> go.Figure:
    reference = next((c for c in reversed(curves) if not c.symbol), None)
    traces: list[Trace] = []
    phases: list[Floats] = []
    for curve in curves:
        label = curve.name
        traces.append(_magnitude(curve, label))
        phase, trace = _phase(curve, reference, label)
        phases.append(phase)
        traces.append(trace)
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
    size = np.abs(curve.H)
    hover = f"%{{x:.4g}} Hz<br>%{{y:.4g}} {_UNIT}<extra>{label}</extra>"
    if not curve.symbol:
        style = {"line": {"dash": curve.dash}}
        return line(curve.frequency_hz, size, curve.name, curve.colour, hovertemplate=hover, **style)
    more = {}
    if curve.error is not None:
        # Half of a complex variance lies along the phasor. A log axis has no room for bars below zero.
        error = curve.error / np.sqrt(2)
        hover = f"%{{x:.4g}} Hz<br>%{{y:.4g}} ± %{{customdata:.2g}} {_UNIT}<extra>{label}</extra>"
        bars = {"array": error, "arrayminus": np.minimum(error, 0.95 * size), "symmetric": False}
        more = {"customdata": error, "error": bars}
    return points(
        curve.frequency_hz,
        size,
        curve.name,
        curve.colour,
        marker={"symbol": curve.symbol},
        hovertemplate=hover,
        **more,
    )


def _phase(curve: _Curve, reference: _Curve | None, label: str) -> tuple[Floats, Trace]:
    """Phase on the branch that lies nearest to the model, so that points do not jump by 360°."""
    angle = np.degrees(np.angle(curve.H))
    centre: Floats | float = 90.0
    if reference is not None:
        unwrapped = np.degrees(np.unwrap(np.angle(reference.H)))
        unwrapped -= 360 * np.round((np.median(unwrapped) - 90) / 360)
        centre = np.interp(np.log(curve.frequency_hz), np.log(reference.frequency_hz), unwrapped)
    phase = centre + (angle - centre + 180) % 360 - 180
    shared = {"yaxis": "y2", "showlegend": False}
    hover = f"%{{x:.4g}} Hz<br>%{{y:.1f}}°<extra>{label}</extra>"
    if not curve.symbol:
        style = {"line": {"dash": curve.dash}, "hovertemplate": hover}
        return phase, line(curve.frequency_hz, phase, curve.name, curve.colour, **style, **shared)
    more = {}
    if curve.error is not None:
        with np.errstate(divide="ignore", invalid="ignore"):
            error = np.degrees(np.minimum(curve.error / np.sqrt(2) / np.abs(curve.H), np.pi))
        hover = f"%{{x:.4g}} Hz<br>%{{y:.1f}}° ± %{{customdata:.2g}}°<extra>{label}</extra>"
        more = {"customdata": error, "error": {"array": error}}
    return phase, points(
        curve.frequency_hz,
        phase,
        curve.name,
        curve.colour,
        marker={"symbol": curve.symbol},
        hovertemplate=hover,
        **more,
        **shared,
    )


def _magnitudes(analysis: Analysis, pose: str, joint: int) -> tuple[float, float]:
    """Range of H_jj and of what single records show of it, so that figures of a joint share their scale.

    A joint that stands still makes single responses of any size; they do not stretch the scale by
    more than a factor of ten.
    """
    robot = [np.abs(c.H) for c in _models(analysis, pose, joint, joint, dark=False)]
    for matrices in (analysis.transfer_matrices, analysis.freed_transfer_matrices):
        if pose in matrices:
            robot.append(np.abs(matrices[pose].H[:, joint, joint]))
    single = np.abs(single_record_response(analysis.phasors)[analysis.study.of_pose(pose), joint])
    every = np.concatenate(robot) if robot else single
    every = every[np.isfinite(every) & (every > 0)]
    if not every.size:
        return 1.0, 10.0
    low, high = float(every.min()), float(every.max())
    near = single[(single > low / 10) & (single < high * 10)]
    return min(low, float(near.min(initial=low))), max(high, float(near.max(initial=high)))


def _log_range(limits: tuple[float, float]) -> list[float]:
    return [float(np.log10(limits[0] / 1.25)), float(np.log10(limits[1] * 1.25))]


def _frequencies(curves: Iterable[_Curve]) -> Floats:
    measured = [c.frequency_hz for c in curves if c.symbol]
    return np.concatenate(measured)


def _renamed(curve: _Curve, name: str) -> _Curve:
    return _Curve(name, curve.colour, curve.frequency_hz, curve.H, curve.error, curve.symbol)


def _label(i: int, j: int) -> str:
    return f"H{_digit(i)}{_digit(j)}"


def _digit(k: int) -> str:
    return str(k + 1).translate(str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉"))
