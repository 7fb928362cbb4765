"""The cut over time, and the tool under a force."""

from collections.abc import Callable, Sequence

import numpy as np
import plotly.graph_objects as go

from jointid.arrays import Floats
from jointid.cut.outcome import Outcome
from jointid.cut.tool_stiffness import ToolStiffness
from jointid.cut.tracking import TrackingRun
from jointid.figures.style import Trace, colours, figure, line, linear_axis

_STRIDE = 4
"""One point per millisecond."""


_PANELS: dict[str, Callable[[TrackingRun], Floats]] = {
    "Path error (mm)": lambda run: 1e3 * run.contour_error_m,
    "Tracking error (mm)": lambda run: 1e3 * run.tracking_error_m,
    "Torque, motor 1 (N·m)": lambda run: run.motor_torque_Nm[:, 0],
    "Torque, motor 2 (N·m)": lambda run: run.motor_torque_Nm[:, 1],
}


def cut_over_time(outcome: Outcome, *, dark: bool = False) -> go.Figure:
    """Errors and motor torques with both controllers, one panel above the other."""
    ink = colours(dark)
    traces: list[Trace] = []
    for name, run, colour in (
        ("nominal", outcome.before, ink.nominal),
        ("identified", outcome.after, ink.identified),
    ):
        for k, (title, values) in enumerate(_PANELS.items(), start=1):
            what, _, unit = title.rstrip(")").partition(" (")
            hover = f"%{{x:.0f}} ms<br>%{{y:.3g}} {unit}<extra>{name}, {what.lower()}</extra>"
            style = {"yaxis": f"y{k}", "showlegend": k == 1, "legendgroup": name}
            x, y = 1e3 * run.time_s[::_STRIDE], values(run)[::_STRIDE]
            traces.append(line(x, y, name, colour, hovertemplate=hover, **style))
    axes = [linear_axis(title, nticks=4) for title in _PANELS]
    return figure(traces, linear_axis("Time (ms)"), *axes, height=720, dark=dark)


def deflection_ellipse(
    stiffness: ToolStiffness,
    force_N: float,
    nominal: ToolStiffness | None = None,
    *,
    axes: Sequence[str] = ("x", "y"),
    dark: bool = False,
) -> go.Figure:
    """Tool deflection under a force of one size turned through all directions, worst one drawn.

    ``stiffness`` is that of the identified, ``nominal`` that of the nominal K; ``axes`` name the two
    axes, for a spatial compliance its two softest directions.
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
