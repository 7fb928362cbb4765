"""A whole log with the sine runs that were found in it."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from jointid.arrays import Floats
from jointid.figures.style import Sketch, Trace, linear_axis
from jointid.figures.waveforms import downsampled
from jointid.importing import MappedLog, Mapping, Segment
from jointid.importing.columns.units import QUANTITIES

_ROW_PX = 112
_LADDER = 1.07
"""Height of the row of frequencies, in rows."""


def log_spans(
    log: MappedLog,
    kept: Sequence[Segment],
    dropped: Sequence[Segment] = (),
    *,
    mapping: Mapping | None = None,
    dark: bool = False,
) -> go.Figure:
    """Draw position and torque of every joint over time, with the segments as coloured spans.

    Used ones are blue and solid, others grey and dashed; the frequencies of sines are in the top row.
    Signals whose scale ``mapping`` assumes are drawn in the unit of their column.
    """
    sketch = Sketch(dark)
    rows = [row for j in range(log.n) for row in _rows(log, j, mapping)]
    has_sines = any(len(segment.lines_hz) for segment in (*kept, *dropped))
    axes = [linear_axis("Sine (Hz)", share=_LADDER, nticks=6, rangemode="tozero")] * has_sines
    for chosen, name, colour, dash, opacity in (
        (kept, "used", "identified", "solid", 0.28),
        (dropped, "left out", "quiet", "dot", 0.18),
    ):
        if any(len(segment.lines_hz) for segment in chosen):
            _add_ladder(sketch, chosen, name, colour, dash)
        for segment in chosen:
            sketch.span(segment.start_s, segment.stop_s, colour, opacity, layer="below")
    for number, (title, values) in enumerate(rows, start=1 + has_sines):
        axes.append(linear_axis(title, nticks=6))
        x, y = downsampled(log.time_s, values)
        style: Trace = {"showlegend": False, "yaxis": f"y{number}" if number > 1 else "y"}
        style["hovertemplate"] = "%{x:.5g} s: %{y:.4g}"
        sketch.line(x, y, title, "measured", width=1.1, **style)
    across = linear_axis("Time (s)", range=[float(log.time_s[0]), float(log.time_s[-1])])
    height = 60 + round(_ROW_PX * (_LADDER * has_sines + len(rows)))
    return sketch.figure(across, *axes, height=height)


def _rows(log: MappedLog, j: int, mapping: Mapping | None) -> list[tuple[str, Floats]]:
    """Titles and values of position and torque of one joint."""
    rows = [
        (f"Position {j + 1} (rad)", log.theta_rad[:, j]),
        (f"Torque {j + 1} (N·m)", log.tau_Nm[:, j]),
    ]
    if mapping is None:
        return rows
    joint = mapping.joints[j]
    factors = (joint.rad_per_unit, joint.Nm_per_unit)
    for k, (role, factor) in enumerate(zip(QUANTITIES, factors, strict=True)):
        if f"scale of {role} of joint {j + 1}" in mapping.assumed:
            channel, title = getattr(joint, role), rows[k][0].partition(" (")[0]
            rows[k] = f"{title} ({channel.unit})", channel.sign * rows[k][1] / factor
    return rows


def _add_ladder(sketch: Sketch, segments: Sequence[Segment], name: str, colour: str, dash: str) -> None:
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
    style: Trace = {"dash": dash, "text": text, "hovertemplate": hover}
    sketch.line(np.array(x, float), np.array(y, float), name, colour, width=5, **style)
