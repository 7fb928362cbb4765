"""How well the transfer matrix is known."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from jointid.figures.style import colours, figure, frequency_axis, linear_axis, log_axis, points
from jointid.transfer_matrix import TransferMatrix


def torque_condition(matrix: TransferMatrix, *, dark: bool = False) -> go.Figure:
    """How independent the records are, and how far H is from symmetric, at each frequency."""
    ink = colours(dark)
    f = matrix.omega / (2 * np.pi)
    condition = points(
        f,
        matrix.condition,
        "condition",
        ink.measured,
        hovertemplate="%{x:.4g} Hz<br>condition number %{y:.3g}<extra></extra>",
        showlegend=False,
    )
    reciprocity = points(
        f,
        100 * matrix.reciprocity_error,
        "reciprocity",
        ink.measured,
        hovertemplate="%{x:.4g} Hz<br>|H_ij − H_ji| is %{y:.3g} % of the largest element<extra></extra>",
        showlegend=False,
        yaxis="y2",
    )
    top = max(2.0, float(matrix.condition.max()) * 1.2)
    title = "Condition of T"
    scale = (
        linear_axis(title, range=[0.8, top])
        if top < 20
        else log_axis(title, range=[-0.05, float(np.log10(top))])
    )
    return figure(
        [condition, reciprocity],
        height=380,
        dark=dark,
        xaxis=frequency_axis(f, anchor="y2"),
        yaxis=scale | {"domain": [0.56, 1.0]},
        yaxis2=linear_axis("Reciprocity (%)", domain=[0.0, 0.44], rangemode="tozero"),
    )
