"""Deflection of the tool under a force from any direction."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from jointid.cut.tool_stiffness import ToolStiffness
from jointid.figures.style import colours, figure, line, linear_axis


def deflection_ellipse(
    stiffness: ToolStiffness,
    force_N: float,
    nominal: ToolStiffness | None = None,
    *,
    axes: Sequence[str] = ("x", "y"),
    dark: bool = False,
) -> go.Figure:
    """Tool deflection under a force of one size turned through all directions, worst one drawn.

    Parameters
    ----------
    stiffness : ToolStiffness
        With the identified K.
    force_N : float
    nominal : ToolStiffness, optional
        With the nominal K.
    axes : sequence of str
        Names of the two axes; for a spatial compliance these are its two softest directions.
    """
    ink = colours(dark)
    _, directions = stiffness.principal
    spatial = len(directions) == 3
    plane = directions[:2] if spatial else np.eye(2)
    angle = np.linspace(0.0, 2 * np.pi, 181)
    forces = force_N * np.stack([np.cos(angle), np.sin(angle)], axis=1) @ plane
    drawn = [(stiffness, "identified", ink.identified)]
    if nominal is not None:
        drawn.insert(0, (nominal, "nominal", ink.nominal))
    traces = []
    for of, name, colour in drawn:
        moved = 1e3 * of.deflection(forces) @ plane.T
        hover = "%{x:.3f}, %{y:.3f} mm"
        traces.append(line(moved[:, 0], moved[:, 1], name, colour, hovertemplate=hover))
    worst = 1e3 * force_N * stiffness.principal[0][0] * (directions[0] @ plane.T)
    ends = np.stack([-worst, worst])
    traces.append(line(ends[:, 0], ends[:, 1], "worst direction", ink.quiet, hoverinfo="skip"))
    x, y = (linear_axis(f"Deflection along {axis} (mm)") for axis in axes)
    return figure(traces, x, y | {"scaleanchor": "x"}, height=320, dark=dark)
