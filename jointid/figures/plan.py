"""Experiment planning: worst error over the number of added records."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from jointid.figures.style import colours, figure, linear_axis
from jointid.uncertainty.plan import Suggestion


def worst_error(suggestion: Suggestion, *, dark: bool = False) -> go.Figure:
    """Largest relative standard error of K and D over the number of records that are added."""
    ink = colours(dark)
    count = np.arange(suggestion.worst.size)
    names = [suggestion.names[k] for k in suggestion.relative_error.argmax(axis=1)]
    trace = {
        "type": "scatter",
        "mode": "lines+markers",
        "x": count,
        "y": np.where(np.isfinite(suggestion.worst), 100 * suggestion.worst, np.nan),
        "line": {"color": ink.identified, "width": 2, "dash": "dot"},
        "marker": {"color": ink.identified, "size": 8},
        "customdata": names,
        "hovertemplate": "%{x} records more<br>%{customdata} ± %{y:.2g} %<extra></extra>",
        "showlegend": False,
    }
    return figure(
        [trace],
        height=300,
        dark=dark,
        xaxis=linear_axis("Records added", tickformat="d", nticks=min(count.size, 10) + 1),
        yaxis=linear_axis("Worst error of K and D (%)", rangemode="tozero"),
    )
