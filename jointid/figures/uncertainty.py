"""Uncertainty: prediction, residuals, planned records."""

import numpy as np
import plotly.graph_objects as go

from jointid.figures.style import (
    Trace,
    colours,
    figure,
    frequency_axis,
    joint_symbol,
    line,
    linear_axis,
    log_axis,
    plain_text,
    points,
)
from jointid.uncertainty.plan import Suggestion
from jointid.uncertainty.torque_prediction import TorquePrediction
from jointid.uncertainty.validation import RecordResiduals


def left_out_prediction(prediction: TorquePrediction, *, dark: bool = False) -> go.Figure:
    """Relative difference of predicted and measured torques over frequency."""
    f, difference = prediction.frequency_hz, 100 * prediction.relative_error
    hover = "%{x:.4g} Hz<br>%{y:.2g} %<extra></extra>"
    dots = points(f, difference, "difference", colours(dark).measured, hovertemplate=hover)
    axis = linear_axis("Difference (%)", rangemode="tozero", nticks=4)
    return figure([dots], frequency_axis(f), axis, height=260, dark=dark)


def normalised_residuals(residuals: RecordResiduals, *, dark: bool = False) -> go.Figure:
    """Residual torque of each record over what noise makes of it, with lines at 1 and 3."""
    ink = colours(dark)
    f = residuals.frequency_hz
    ends = np.array([f.min() / 1.5, f.max() * 1.5])
    traces: list[Trace] = []
    for level, dash, name in ((1.0, "solid", "expected (1)"), (3.0, "dash", "seldom above (3)")):
        style = {"line": {"dash": dash, "width": 1.5}, "hoverinfo": "skip"}
        traces.append(line(ends, np.full(2, level), name, ink.quiet, **style))
    for j in range(residuals.normalised.shape[1]):
        traces.append(
            points(
                f,
                np.maximum(residuals.normalised[:, j], 1e-3),
                f"joint {j + 1}",
                ink.measured,
                marker={"symbol": joint_symbol(j) + ("-open" if j % 2 else "")},
                text=[plain_text(label) for label in residuals.labels],
                hovertemplate=f"%{{text}}<br>%{{x:.4g}} Hz<br>%{{y:.2g}}<extra>joint {j + 1}</extra>",
            )
        )
    sizes = residuals.normalised[residuals.normalised > 1e-3]
    low, high = float(sizes.min(initial=0.3)) / 1.3, max(4.0, 1.3 * float(sizes.max(initial=1.0)))
    axis = log_axis("Residual / noise", range=[float(np.log10(low)), float(np.log10(high))])
    return figure(traces, frequency_axis(f), axis, height=320, dark=dark)


def worst_error(suggestion: Suggestion, *, dark: bool = False) -> go.Figure:
    """Largest relative standard error of K and D over the number of records that are added."""
    ink = colours(dark)
    count = np.arange(float(suggestion.worst.size))
    names = [suggestion.names[k] for k in suggestion.relative_error.argmax(axis=1)]
    worst = np.where(np.isfinite(suggestion.worst), 100 * suggestion.worst, np.nan)
    hover = "%{x} additional records<br>%{customdata} ± %{y:.2g} %<extra></extra>"
    dots = {"color": ink.identified, "size": 8}
    look: Trace = {"mode": "lines+markers", "line": {"dash": "dot"}, "marker": dots}
    about: Trace = {"customdata": names, "hovertemplate": hover, "showlegend": False}
    trace = line(count, worst, "worst error", ink.identified, **look, **about)
    x = linear_axis("Records added", tickformat="d", nticks=min(count.size, 10) + 1)
    y = linear_axis("Worst error of K and D (%)", rangemode="tozero")
    return figure([trace], x, y, height=300, dark=dark)
