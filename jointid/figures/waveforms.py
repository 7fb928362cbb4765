"""Waveforms with their fitted sine, spectra, and raw columns."""

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.figures.style import Axis, Sketch, Trace, frequency_axis, linear_axis, log_axis, plain_text
from jointid.phasors.coherence import coherence
from jointid.phasors.spectrum import amplitude_spectrum
from jointid.records import JointRecord, MotionRecord, SineRecord

_MOST_POINTS = 2000
"""Points of a curve that a screen can show; longer signals are drawn by their extremes."""

_MOST_MARKS = 400
"""Samples shown as marks; more are shown as a line."""
_LONGEST_TITLE = 22
_QUANTITIES = (("Position", "rad"), ("Torque", "N·m"))


def waveforms(
    record: JointRecord,
    joint: int,
    fitted: Floats | None = None,
    *,
    periods: float | None = None,
    dark: bool = False,
) -> go.Figure:
    """Motor position over motor torque of one joint, from 0, as logged, with the fitted sine.

    ``fitted``, shape (N, 2n), is ``SineFit.at`` at the record's times. ``periods`` shows that many
    periods, of another motion than a sine seconds, from the start of the used part.
    """
    sketch, part = Sketch(dark), slice(None)
    if periods is not None:
        frequency = record.frequency_hz if isinstance(record, SineRecord) else 1.0
        end = record.time_s[record.start] + periods / frequency
        last = int(np.searchsorted(record.time_s, end)) + 1
        part = slice(record.start, max(last, record.start + 2))
    time = record.time_s[part]
    faint: Trace = {"opacity": 0.45} if fitted is not None else {}  # the fit lies on top of the samples
    signals = (record.theta_rad[part, joint], record.tau_Nm[part, joint])
    for row, (signal, (quantity, unit)) in enumerate(zip(signals, _QUANTITIES, strict=True), start=1):
        hover = f"%{{x:.4f}} s<br>{quantity} %{{y:.5g}} {unit}"
        shared: Trace = {"yaxis": f"y{row}", "hovertemplate": hover, "showlegend": row == 1}
        x, y = downsampled(time, signal)
        if periods is None or x.size > _MOST_MARKS:
            width = 3 if fitted is not None else 1.2
            sketch.line(x, y, "logged", "measured", width=width, **faint, **shared)
        else:
            sketch.points(x, y, "logged", "measured", marker={"size": 5}, **faint, **shared)
        if fitted is not None:
            curve = downsampled(time, fitted[part, joint + (row - 1) * record.n])
            sketch.line(*curve, "fitted sine", "identified", width=1.2, dash="dash", **shared)
    if periods is None and record.start > 0:
        label = {"text": "not used", "textposition": "top left"}
        sketch.span(float(time[0]), float(time[record.start]), "quiet", 0.25, label=label)
    axes = [linear_axis(f"Motor {quantity.lower()} ({unit})") for quantity, unit in _QUANTITIES]
    return sketch.figure(linear_axis("Time (s)"), *axes, height=430)


def gear_deflection(
    time_s: Floats, measured_rad: Floats, fitted_rad: Floats, *, dark: bool = False
) -> go.Figure:
    """Deflection of one gear between its two encoders, measured and fitted, and their difference.

    All shape (N,); one constant offset is not observable and is removed.
    """
    sketch, middle = Sketch(dark), float(np.mean(measured_rad))
    for name, y, colour, axis, width in (
        ("measured", measured_rad - middle, "measured", "y1", 1.2),
        ("fitted", fitted_rad - middle, "identified", "y1", 2.5),
        ("measured − fitted", measured_rad - fitted_rad, "quiet", "y2", 1.2),
    ):
        hover: Trace = {"hovertemplate": "%{x:.4f} s<br>%{y:.4g} mrad", "yaxis": axis}
        sketch.line(*downsampled(time_s, 1e3 * y), name, colour, width=width, **hover)
    axes = linear_axis("Deflection (mrad)", share=2.0), linear_axis("Difference (mrad)")
    return sketch.figure(linear_axis("Time (s)"), *axes, height=430)


def spectra(record: JointRecord, joint: int, *, dark: bool = False) -> go.Figure:
    """Amplitude spectra of position and torque of one joint.

    Of a sine, the excitation and its harmonics are marked; of another motion, its band. Raises
    JointIdError when the record is too short for a spectrum.
    """
    sketch, used = Sketch(dark), slice(record.start, None)
    sine = record.frequency_hz if isinstance(record, SineRecord) else 0.0
    shown = np.array([sine / 3, sine * 30]) if sine else _shown_hz(record)
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
        style: Trace = {"showlegend": False, "hovertemplate": hover, "yaxis": f"y{row}"}
        sketch.line(x, y, quantity, "measured", width=1.2, **style)
    _show_band(sketch, record)
    nowhere = np.array([np.nan])
    lines: list[tuple[str, tuple[int, ...], str, str, int]] = [
        ("excitation", (1,), "identified", "solid", 2),
        ("harmonics 2, 3, 5, 7", (2, 3, 5, 7), "quiet", "dot", 1),
    ]
    for name, orders, colour, dash, width in lines if sine else ():
        # The marks are shapes, which have no place in the legend.
        sketch.line(nowhere, nowhere, name, colour, yaxis="y1", dash=dash, hoverinfo="skip")
        for f in (h * sine for h in orders if h * sine < shown[1]):
            sketch.vertical_line(f, colour, width=width, dash=dash, layer="below")
    axes = [
        _decades(f"{quantity} ({unit})", sketch, f"y{row}")
        for row, (quantity, unit) in enumerate(_QUANTITIES, start=1)
    ]
    return sketch.figure(frequency_axis(shown), *axes, height=430)


def coherences(record: JointRecord, joint: int, *, dark: bool = False) -> go.Figure:
    """Share of one motor's motion that is linear in all torques, and its level over the noise floor.

    Raises JointIdError when the record is too short.
    """
    sketch, found = Sketch(dark), coherence(record)
    for row, (name, values) in enumerate(
        (("coherence", found.coherence), ("position / floor", np.sqrt(found.above_floor))), start=1
    ):
        style: Trace = {"showlegend": False, "yaxis": f"y{row}"}
        style["hovertemplate"] = f"%{{x:.4g}} Hz<br>{name} %{{y:.3g}}<extra></extra>"
        y = np.where(np.isfinite(values[:, joint]), values[:, joint], np.nan)
        sketch.line(found.frequency_hz, y, name, "measured", width=1.2, **style)
    _show_band(sketch, record)
    axes = linear_axis("Coherence", range=[0, 1.02]), _decades("Position / noise floor", sketch, "y2")
    return sketch.figure(frequency_axis(_shown_hz(record)), *axes, height=430)


def _decades(title: str, sketch: Sketch, axis: str) -> Axis:
    """Return a logarithmic axis for all that is drawn on it."""
    values = np.concatenate([trace["y"] for trace in sketch.traces if trace["yaxis"] == axis])
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


def _show_band(sketch: Sketch, record: JointRecord) -> None:
    band = record.band_hz if isinstance(record, MotionRecord) else None
    if band is not None:
        label = {"text": "band used", "textposition": "top left"}
        sketch.span(max(band[0], 1e-3), band[1], "quiet", 0.15, label=label)


def raw_columns(columns: Mapping[str, Floats], *, dark: bool = False) -> go.Figure:
    """Every column, shape (N,), against the first, or against the row when there is only one.

    NaN leaves a gap. Raises JointIdError when there is no column.
    """
    if not columns:
        raise JointIdError("There is no column of numbers to show.")
    sketch, names = Sketch(dark), list(columns)
    first = np.asarray(columns[names[0]], float)
    time = first if len(names) > 1 else np.arange(float(first.size))
    shown = names[1:] or names
    known = np.isfinite(time)
    if 0 < known.sum() < time.size:  # a row without a time has a place all the same
        time = np.interp(np.arange(time.size), np.flatnonzero(known), time[known])
    for row, name in enumerate(shown, start=1):
        x, y = downsampled(time, np.asarray(columns[name], float))
        style: Trace = {"yaxis": f"y{row}", "showlegend": False}
        sketch.line(x, y, plain_text(name), "measured", width=1.2, **style)
    axes = [linear_axis(_column_title(name), nticks=6) for name in shown]
    across = linear_axis(plain_text(names[0]) if len(names) > 1 else "Row", minexponent=6)
    # A title runs upwards along its panel: 7.5 px for each letter, and the gap between panels.
    panel = max(110, 20 + round(7.5 * min(_LONGEST_TITLE, max(map(len, shown)))))
    return sketch.figure(across, *axes, height=60 + panel * len(shown))


def _column_title(name: str) -> str:
    """Shorten the name of a column, not its unit."""
    quantity, bracket, unit = name.rpartition(" (")
    room = _LONGEST_TITLE - len(bracket + unit)
    if not bracket or room < _LONGEST_TITLE // 2:
        return plain_text(name, most=_LONGEST_TITLE)
    return plain_text(quantity, most=room) + plain_text(bracket + unit)


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
