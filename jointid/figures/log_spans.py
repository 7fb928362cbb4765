"""A whole log with the sine runs that were found in it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from jointid.figures.style import Shape, Trace, colours, figure, line, linear_axis, span
from jointid.figures.waveforms import thinned
from jointid.importing import MappedLog, Segment

_ROW_PX = 112
_LADDER_PX = 120


def log_spans(
    log: MappedLog, kept: Sequence[Segment], dropped: Sequence[Segment] = (), *, dark: bool = False
) -> go.Figure:
    """Draw angle and torque of every joint over time, with the segments as coloured spans.

    Parameters
    ----------
    log : MappedLog
        Long logs are drawn by the extremes of every stretch.
    kept, dropped : sequence of Segment
        Used ones are blue and solid, others grey and dashed; their frequencies are in the top row.
    dark : bool, default False
        For a dark background.
    """
    ink = colours(dark)
    rows = [
        (f"{what} {j + 1} ({unit})", signals[:, j])
        for j in range(log.n)
        for what, unit, signals in (("Angle", "rad", log.theta_rad), ("Torque", "N·m", log.tau_Nm))
    ]
    height = 60 + _LADDER_PX + _ROW_PX * len(rows)
    ladder = _LADDER_PX / (_LADDER_PX + _ROW_PX * len(rows))
    axes: dict[str, Any] = {
        "yaxis": linear_axis("Sine (Hz)", domain=[1 - 0.86 * ladder, 1.0], nticks=4, rangemode="tozero")
    }
    traces: list[Trace] = []
    shapes: list[Shape] = []
    for chosen, name, colour, dash, opacity in (
        (kept, "used", ink.identified, "solid", 0.28),
        (dropped, "left out", ink.quiet, "dot", 0.18),
    ):
        if chosen:
            traces.append(_ladder(chosen, name, colour, dash))
        shapes += [span(s.start_s, s.stop_s, colour, opacity, layer="below") for s in chosen]
    if not traces:  # an axis without a curve is not drawn
        traces.append(line(log.time_s[[0, -1]], np.zeros(2), "", "rgba(0,0,0,0)", showlegend=False))
    for row, (title, values) in enumerate(rows):
        top = (1 - ladder) * (1 - row / len(rows))
        gap = 0.12 if row + 1 < len(rows) else 0.0  # the last stands on the axis of time
        bottom = max(top - (1 - gap) * (1 - ladder) / len(rows), 0.0)
        axes[f"yaxis{row + 2}"] = linear_axis(title, domain=[bottom, top], nticks=4)
        x, y = thinned(log.time_s, values)
        style: Trace = {"line": {"width": 1.1}, "showlegend": False, "yaxis": f"y{row + 2}"}
        traces.append(line(x, y, title, ink.measured, hovertemplate="%{x:.5g} s: %{y:.4g}", **style))
    axes["xaxis"] = linear_axis(
        "Time (s)", anchor=f"y{len(rows) + 1}", range=[float(log.time_s[0]), float(log.time_s[-1])]
    )
    return figure(traces, height=height, dark=dark, shapes=shapes, **axes)


def _ladder(segments: Sequence[Segment], name: str, colour: str, dash: str) -> Trace:
    """Every line of every segment as a bar at the height of its frequency."""
    x: list[float | None] = []
    y: list[float | None] = []
    text: list[str] = []
    for segment in segments:
        for hertz in segment.lines_hz:
            x += [segment.start_s, segment.stop_s, None]
            y += [hertz, hertz, None]
            periods = (segment.stop_s - segment.start_s) * hertz
            said = f"{segment.start_s:.5g} to {segment.stop_s:.5g} s<br>{hertz:.6g} Hz"
            text += [f"{said}, {periods:.3g} periods"] * 2 + [""]
    hover = "%{text}<extra></extra>"
    style: Trace = {"line": {"width": 5, "dash": dash}, "text": text, "hovertemplate": hover}
    return line(np.array(x, float), np.array(y, float), name, colour, **style)
