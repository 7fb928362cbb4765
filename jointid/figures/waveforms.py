"""Waveforms with their fitted sine, spectra, and raw columns."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import plotly.graph_objects as go

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.figures.style import (
    Axis,
    Trace,
    colours,
    figure,
    frequency_axis,
    line,
    linear_axis,
    log_axis,
    plain_text,
    points,
    span,
    vertical_line,
)
from jointid.phasors.coherence import coherence
from jointid.phasors.spectrum import amplitude_spectrum
from jointid.records import JointRecord, MotionRecord, SineRecord

_MOST_POINTS = 2000
"""Points of a curve that a screen can show; longer signals are drawn by their extremes."""

_LONGEST_TITLE = 22
_QUANTITIES = (("Angle", "rad"), ("Torque", "N·m"))


def waveforms(
    record: JointRecord,
    joint: int,
    fitted: Floats | None = None,
    *,
    periods: float | None = None,
    dark: bool = False,
) -> go.Figure:
    """Motor angle over motor torque of one joint, from 0, as logged, with the fitted sine.

    ``fitted``, shape (N, 2n), is ``SineFit.at`` at the record's times. ``periods`` shows that many
    periods, of another motion than a sine seconds, from the start of the used part.
    """
    ink = colours(dark)
    last = record.time_s.size
    first = 0
    if periods is not None:
        first = record.start
        frequency = record.frequency_hz if isinstance(record, SineRecord) else 1.0
        end = record.time_s[first] + periods / frequency
        last = max(int(np.searchsorted(record.time_s, end)) + 1, first + 2)
    part = slice(first, last)
    time = record.time_s[part]
    traces: list[Trace] = []
    faint: Trace = {"opacity": 0.45} if fitted is not None else {}  # the fit lies on top of the samples
    signals = (record.theta_rad[part, joint], record.tau_Nm[part, joint])
    for row, (signal, (quantity, unit)) in enumerate(zip(signals, _QUANTITIES, strict=True), start=1):
        hover = f"%{{x:.4f}} s<br>{quantity} %{{y:.5g}} {unit}"
        shared: Trace = {
            "yaxis": f"y{row}",
            "hovertemplate": hover,
            "showlegend": row == 1,
        }
        x, y = downsampled(time, signal)
        if periods is None or x.size > 400:
            width: Trace = {"line": {"width": 3 if fitted is not None else 1.2}, **faint}
            traces.append(line(x, y, "logged", ink.measured, **width, **shared))
        else:
            small: Trace = {"marker": {"size": 5}, **faint}
            traces.append(points(x, y, "logged", ink.measured, **small, **shared))
        if fitted is not None:
            curve = fitted[part, joint + (row - 1) * record.n]
            thin: Trace = {"line": {"width": 1.2, "dash": "dash"}}
            x, y = downsampled(time, curve)
            traces.append(line(x, y, "fitted sine", ink.identified, **thin, **shared))
    shapes = []
    if periods is None and record.start > 0:
        label = {"text": "not used", "textposition": "top left"}
        end = float(record.time_s[record.start])
        shapes.append(span(float(time[0]), end, ink.quiet, 0.25, label=label))
    axes = [linear_axis(f"Motor {quantity.lower()} ({unit})") for quantity, unit in _QUANTITIES]
    return figure(traces, linear_axis("Time (s)"), *axes, height=430, dark=dark, shapes=shapes)


def gear_deflection(
    time_s: Floats, measured_rad: Floats, fitted_rad: Floats, *, dark: bool = False
) -> go.Figure:
    """Deflection of one gear between its two encoders, measured and fitted, and their difference.

    All shape (N,); one constant offset is not observable and is removed.
    """
    ink, middle = colours(dark), float(np.mean(measured_rad))
    curves = [
        ("measured", 1e3 * (measured_rad - middle), ink.measured, "y1"),
        ("fitted", 1e3 * (fitted_rad - middle), ink.identified, "y1"),
        ("measured − fitted", 1e3 * (measured_rad - fitted_rad), ink.quiet, "y2"),
    ]
    style: Trace = {"line": {"width": 1.2}, "hovertemplate": "%{x:.4f} s<br>%{y:.4g} mrad"}
    traces = [
        line(*downsampled(time_s, y), name, colour, yaxis=axis, **style)
        for name, y, colour, axis in curves
    ]
    axes = linear_axis("Deflection (mrad)", share=2.0), linear_axis("Difference (mrad)")
    return figure(traces, linear_axis("Time (s)"), *axes, height=430, dark=dark)


def spectra(record: JointRecord, joint: int, *, dark: bool = False) -> go.Figure:
    """Amplitude spectra of angle and torque of one joint.

    Of a sine, the excitation and its harmonics are marked; of another motion, its band. Raises
    JointIdError when the record is too short for a spectrum.
    """
    ink = colours(dark)
    used = slice(record.start, None)
    sine = record.frequency_hz if isinstance(record, SineRecord) else 0.0
    traces, shown = [], np.array([sine / 3, sine * 30]) if sine else _shown_hz(record)
    for row, (signals, (quantity, unit)) in enumerate(
        zip((record.theta_rad, record.tau_Nm), _QUANTITIES, strict=True), start=1
    ):
        frequency, amplitude = amplitude_spectrum(record.time_s[used], signals[used, joint])
        shown = np.array([shown[0], min(shown[1], float(frequency[-1]))])
        inside = (frequency >= shown[0] / 1.2) & (frequency <= shown[1] * 1.2)
        a = amplitude[inside]
        x, y = downsampled(
            frequency[inside], np.maximum(a, 1e-9 * (a.max(initial=0.0) or 1.0)), peaks_only=True
        )
        hover = f"%{{x:.4g}} Hz<br>{quantity} amplitude %{{y:.3g}} {unit}<extra></extra>"
        style: Trace = {"line": {"width": 1.2}, "showlegend": False, "hovertemplate": hover}
        traces.append(line(x, y, quantity, ink.measured, yaxis=f"y{row}", **style))
    marks = _band_shapes(record, ink.quiet)
    nowhere = np.array([np.nan])
    lines: list[tuple[str, tuple[int, ...], str, str, int]] = [
        ("excitation", (1,), ink.identified, "solid", 2),
        ("harmonics 2, 3, 5, 7", (2, 3, 5, 7), ink.quiet, "dot", 1),
    ]
    for name, orders, colour, dash, width in lines if sine else ():
        # The marks are shapes, which have no place in the legend.
        mark: Trace = {"line": {"width": 2, "dash": dash}, "hoverinfo": "skip"}
        traces.append(line(nowhere, nowhere, name, colour, yaxis="y1", **mark))
        for f in (h * sine for h in orders if h * sine < shown[1]):
            marks.append(vertical_line(f, colour, width=width, dash=dash, layer="below"))
    axes = [
        _decades(f"{quantity} ({unit})", traces, f"y{row}")
        for row, (quantity, unit) in enumerate(_QUANTITIES, start=1)
    ]
    return figure(traces, frequency_axis(shown), *axes, height=430, dark=dark, shapes=marks)


def coherences(record: JointRecord, joint: int, *, dark: bool = False) -> go.Figure:
    """Share of one motor's motion that is linear in all torques, and its level over the noise floor.

    Raises JointIdError when the record is too short.
    """
    ink, found = colours(dark), coherence(record)
    traces = []
    for row, (name, values) in enumerate(
        (("coherence", found.coherence), ("angle / floor", np.sqrt(found.above_floor))), start=1
    ):
        style: Trace = {"line": {"width": 1.2}, "showlegend": False}
        style["hovertemplate"] = f"%{{x:.4g}} Hz<br>{name} %{{y:.3g}}<extra></extra>"
        y = np.where(np.isfinite(values[:, joint]), values[:, joint], np.nan)
        traces.append(line(found.frequency_hz, y, name, ink.measured, yaxis=f"y{row}", **style))
    axes = linear_axis("Coherence", range=[0, 1.02]), _decades("Angle / noise floor", traces, "y2")
    shapes = _band_shapes(record, ink.quiet)
    x = frequency_axis(_shown_hz(record))
    return figure(traces, x, *axes, height=430, dark=dark, shapes=shapes)


def _decades(title: str, traces: list[Trace], axis: str) -> Axis:
    """Return a logarithmic axis for all that is drawn on it."""
    values = np.concatenate([trace["y"] for trace in traces if trace["yaxis"] == axis])
    values = np.log10(values[np.isfinite(values) & (values > 0)])
    if not values.size:
        return log_axis(title)
    margin = 0.06 * float(np.ptp(values)) + 0.05
    return log_axis(title, range=[float(values.min()) - margin, float(values.max()) + margin])


def _shown_hz(record: JointRecord) -> Floats:
    """Frequencies of a motion's figures."""
    band = record.band_hz if isinstance(record, MotionRecord) else None
    nyquist = 0.5 / record.interval_s
    if band is None:
        return np.array([max(0.5, 4 / (record.samples * record.interval_s)), nyquist])
    return np.array([max(band[0] / 3, 0.1), min(5 * band[1], nyquist)])


def _band_shapes(record: JointRecord, colour: str) -> list[Any]:
    band = record.band_hz if isinstance(record, MotionRecord) else None
    if band is None:
        return []
    label = {"text": "band used", "textposition": "top left"}
    return [span(max(band[0], 1e-3), band[1], colour, 0.15, label=label)]


def raw_columns(columns: Mapping[str, Floats], *, dark: bool = False) -> go.Figure:
    """Every column, shape (N,), against the first, or against the row when there is only one.

    NaN leaves a gap. Raises JointIdError when there is no column.
    """
    if not columns:
        raise JointIdError("There is no column of numbers to show.")
    ink = colours(dark)
    names = list(columns)
    first = np.asarray(columns[names[0]], float)
    time = first if len(names) > 1 else np.arange(float(first.size))
    shown = names[1:] or names
    known = np.isfinite(time)
    if 0 < known.sum() < time.size:  # a row without a time has a place all the same
        time = np.interp(np.arange(time.size), np.flatnonzero(known), time[known])
    traces = []
    for row, name in enumerate(shown, start=1):
        x, y = downsampled(time, np.asarray(columns[name], float))
        style: Trace = {"yaxis": f"y{row}", "line": {"width": 1.2}, "showlegend": False}
        traces.append(line(x, y, plain_text(name), ink.measured, **style))
    axes = [linear_axis(plain_text(name, most=_LONGEST_TITLE), nticks=6) for name in shown]
    across = linear_axis(plain_text(names[0]) if len(names) > 1 else "Row")
    # A title runs upwards along its panel: 7.5 px for each letter, and the gap between panels.
    panel = max(110, 20 + round(7.5 * min(_LONGEST_TITLE, max(map(len, shown)))))
    return figure(traces, across, *axes, height=60 + panel * len(shown), dark=dark)


def downsampled(x: Floats, y: Floats, *, peaks_only: bool = False) -> tuple[Floats, Floats]:
    """Keep the smallest and the largest value of every stretch, so that no spike is lost."""
    if y.size <= _MOST_POINTS:
        return np.ascontiguousarray(x), np.ascontiguousarray(y)
    stretch = -(-y.size // (_MOST_POINTS if peaks_only else _MOST_POINTS // 2))
    begin = np.arange(0, y.size, stretch)
    padded = np.full(begin.size * stretch, np.nan)
    padded[: y.size] = y
    rows = padded.reshape(begin.size, stretch)
    high = begin + np.argmax(np.where(np.isnan(rows), -np.inf, rows), axis=1)
    low = begin + np.argmin(np.where(np.isnan(rows), np.inf, rows), axis=1)
    keep = high if peaks_only else np.sort(np.column_stack([low, high]), axis=1).ravel()
    keep = np.minimum(keep, y.size - 1)
    return x[keep], y[keep]
