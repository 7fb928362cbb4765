"""A fleet's results: how a quantity is spread, and how it drifts."""

import numpy as np
import plotly.graph_objects as go

from jointid.arrays import Floats
from jointid.estimation.estimators.parameters import PARAMETERS
from jointid.figures.style import Sketch, linear_axis, plain_text
from jointid.fleet.spread import Drift, Spread
from jointid.wording import with_error

_MOST_BINS = 40
_PAPER = {False: "#FFFFFF", True: "#0E1117"}
"""Edges of the bars, so that neighbours of the same height stay apart."""
_MS = 1e3
"""A date axis takes ms since 1970."""
_WIDE = 6.0
"""Range of the figures in robust spreads from the median; values beyond are arrows at the edge."""


def distribution(spread: Spread, *, dark: bool = False) -> go.Figure:
    """Number of studies by value, one or more; the median, its robust spread, and outliers."""
    sketch, (low, high) = Sketch(dark), _range(spread)
    inside = (spread.value >= low) & (spread.value <= high)
    count = int(np.clip(2 * np.sqrt(inside.sum()), 5, _MOST_BINS))
    height, edges = np.histogram(spread.value[inside], bins=count, range=(low, high))
    unit = PARAMETERS[spread.name[0]].unit
    hover = f"%{{y}} studies<br>%{{customdata[0]:.4g}} to %{{customdata[1]:.4g}} {unit}<extra></extra>"
    ends, edge = np.stack([edges[:-1], edges[1:]], axis=1), {"width": 1, "color": _PAPER[dark]}
    studies = {"type": "bar", "x": ends.mean(axis=1), "y": height, "width": np.diff(edges)}
    studies |= {"name": "studies", "customdata": ends, "hovertemplate": hover}
    look = {"color": sketch.ink.identified, "opacity": 0.85, "line": edge}
    sketch.traces.append(studies | {"marker": look})
    for mask, name in ((spread.outliers & inside, "outlier"), (~inside, "beyond the axis")):
        if mask.any():
            _add_marks(sketch, spread, mask, name, low, high)
    sketch.vertical_line(spread.median, "measured")
    if np.isfinite(spread.spread) and spread.spread > 0:
        for side in (-1, 1):
            sketch.vertical_line(spread.median + side * spread.spread, "measured", dash="dot")
    x = linear_axis(f"{spread.name} ({unit})", range=[low, high], nticks=6)
    y = linear_axis("Studies", rangemode="tozero", tick0=0, dtick=_whole_step(int(height.max())))
    return sketch.figure(x, y, height=270, bargap=0, showlegend=True)


def drift_over_time(
    spread: Spread, all_times_s: Floats, shown: Drift, *, dark: bool = False
) -> go.Figure:
    """Every dated study of a fleet over time, one robot with its error bars and its line.

    ``all_times_s``, shape (m,), are the dates of the studies, s since 1970, NaN where not stated.
    """
    sketch, unit = Sketch(dark), PARAMETERS[spread.name[0]].unit
    low, high = _range(spread)
    ends = np.concatenate([shown.value - shown.error, shown.value + shown.error])
    inside = ends[np.isfinite(ends)].tolist()
    low, high = min([low, *inside]), max([high, *inside])
    dated = np.isfinite(all_times_s)
    value = spread.value[dated]
    below, above = value < low, value > high
    beyond = f"; ▼▲ beyond the axis ({count})" if (count := int((below | above).sum())) else ""
    sketch.points(
        _MS * all_times_s[dated],
        np.clip(value, low, high),
        f"all robots{beyond}",
        "quiet",
        marker={
            "size": np.where(below | above, 8, 4),
            "opacity": 0.7,
            "symbol": np.select([below, above], ["triangle-down", "triangle-up"], "circle"),
        },
        text=[
            _label(row.robot, row.name) for row, in_it in zip(spread.rows, dated, strict=True) if in_it
        ],
        customdata=value,
        hovertemplate=f"%{{text}}<br>%{{x|%Y-%m-%d}}: %{{customdata:.4g}} {unit}<extra></extra>",
    )
    if shown.value.size:
        time = _MS * shown.time_s
        sketch.points(
            time,
            shown.value,
            plain_text(shown.robot) or "no robot stated",
            "identified",
            error={"array": shown.error},
            text=[
                f"{_label(row.robot, row.name)}<br>{with_error(float(v), float(e))} {unit}"
                for row, v, e in zip(shown.rows, shown.value, shown.error, strict=True)
            ],
            hovertemplate="%{text}<br>%{x|%Y-%m-%d}<extra></extra>",
        )
        if np.isfinite(shown.slope_per_s):
            sketch.line(time, shown.line(), "its trend", "identified", hoverinfo="skip")
    margin = 0.03 * (high - low)
    x = linear_axis("Date", type="date", nticks=5)
    y = linear_axis(f"{spread.name} ({unit})", range=[low - margin, high + margin], nticks=6)
    return sketch.figure(x, y, height=300)


def _add_marks(
    sketch: Sketch, spread: Spread, which: np.ndarray, name: str, low: float, high: float
) -> None:
    """Crosses on the axis; arrows at its ends for values beyond."""
    unit = PARAMETERS[spread.name[0]].unit
    value = spread.value[which]
    symbols = np.where(value < low, "triangle-left", np.where(value > high, "triangle-right", "x"))
    rows = [row for row, out in zip(spread.rows, which, strict=True) if out]
    text = [
        f"{_label(row.robot, row.name or row.study.rpartition('/')[2])}<br>"
        f"{with_error(float(v), float(e))} {unit}<br>z = {z:.1f}"
        for row, v, e, z in zip(rows, value, spread.error[which], spread.z[which], strict=True)
    ]
    sketch.points(
        np.clip(value, low + 0.02 * (high - low), high - 0.02 * (high - low)),
        np.zeros(value.size),
        f"{name} ({value.size})",
        "measured",
        marker={"symbol": symbols, "size": 10},
        text=text,
        hovertemplate="%{text}<extra></extra>",
        cliponaxis=False,
    )


def _range(spread: Spread) -> tuple[float, float]:
    """From where to where a figure reaches: all values but those far from the median."""
    value = spread.value
    low, high = float(value.min()), float(value.max())
    if np.isfinite(spread.spread) and spread.spread > 0:
        reach = _WIDE * spread.spread
        low, high = max(low, spread.median - reach), min(high, spread.median + reach)
        low, high = min(low, spread.median - spread.spread), max(high, spread.median + spread.spread)
    margin = 0.04 * (high - low) or 0.05 * abs(high) or 1.0
    return low - margin, high + margin


def _whole_step(highest: int) -> int:
    """Distance of about five ticks, of 1, 2 or 5 studies and their multiples: there are no halves."""
    return next(s for s in (m * int(10.0**k) for k in range(12) for m in (1, 2, 5)) if 5 * s >= highest)


def _label(robot: str, name: str) -> str:
    return plain_text(" · ".join(part for part in (robot, name) if part) or "study without a name")
