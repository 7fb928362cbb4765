"""Uncertainty: prediction, residuals, planned records."""

import numpy as np
import plotly.graph_objects as go

from jointid.figures.style import Sketch, frequency_axis, joint_symbol, linear_axis, log_axis, plain_text
from jointid.uncertainty.plan import Suggestion
from jointid.uncertainty.validation import RecordResiduals, TorquePrediction


def left_out_prediction(prediction: TorquePrediction, *, dark: bool = False) -> go.Figure:
    """Relative difference of predicted and measured torques over frequency."""
    sketch, f = Sketch(dark), prediction.frequency_hz
    hover = "%{x:.4g} Hz<br>%{y:.2g} %<extra></extra>"
    difference = 100 * prediction.relative_error
    sketch.points(f, difference, "difference", "measured", hovertemplate=hover)
    axis = linear_axis("Difference (%)", rangemode="tozero", nticks=4)
    return sketch.figure(frequency_axis(f), axis, height=260)


def normalised_residuals(residuals: RecordResiduals, *, dark: bool = False) -> go.Figure:
    """Residual torque of each record over its standard deviation by noise, with lines at 1 and 3."""
    sketch, f = Sketch(dark), residuals.frequency_hz
    ends = np.array([f.min() / 1.5, f.max() * 1.5])
    for level, dash, name in ((1.0, "solid", "expected (1)"), (3.0, "dash", "seldom above (3)")):
        sketch.line(ends, np.full(2, level), name, "quiet", width=1.5, dash=dash, hoverinfo="skip")
    for j in range(residuals.normalised.shape[1]):
        sketch.points(
            f,
            np.maximum(residuals.normalised[:, j], 1e-3),
            f"joint {j + 1}",
            "measured",
            marker={"symbol": joint_symbol(j) + ("-open" if j % 2 else "")},
            text=[plain_text(label) for label in residuals.labels],
            hovertemplate=f"%{{text}}<br>%{{x:.4g}} Hz<br>%{{y:.2g}}<extra>joint {j + 1}</extra>",
        )
    sizes = residuals.normalised[residuals.normalised > 1e-3]
    low, high = float(sizes.min(initial=0.3)) / 1.3, max(4.0, 1.3 * float(sizes.max(initial=1.0)))
    axis = log_axis("Residual / noise", range=[float(np.log10(low)), float(np.log10(high))])
    return sketch.figure(frequency_axis(f), axis, height=320)


def worst_error(suggestion: Suggestion, *, dark: bool = False) -> go.Figure:
    """Largest relative standard error of K and D over the number of records that are added."""
    sketch, count = Sketch(dark), np.arange(float(suggestion.worst.size))
    names = [suggestion.names[k] for k in suggestion.relative_error.argmax(axis=1)]
    worst = np.where(np.isfinite(suggestion.worst), 100 * suggestion.worst, np.nan)
    sketch.line(
        count,
        worst,
        "largest error",
        "identified",
        mode="lines+markers",
        dash="dot",
        marker={"color": sketch.ink.identified, "size": 8},
        customdata=names,
        hovertemplate="%{x} additional records<br>%{customdata} ± %{y:.2g} %<extra></extra>",
        showlegend=False,
    )
    x = linear_axis("Records added", tickformat="d", nticks=min(count.size, 10) + 1)
    y = linear_axis("Largest error of K and D (%)", rangemode="tozero")
    return sketch.figure(x, y, height=300)
