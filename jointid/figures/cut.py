"""The cut over time, and the tool under a force."""

from collections.abc import Callable, Sequence

import numpy as np
import plotly.graph_objects as go

from jointid.arrays import Floats
from jointid.cut.outcome import Outcome
from jointid.cut.tool_stiffness import ToolStiffness
from jointid.cut.tracking import TrackingRun
from jointid.figures.style import Sketch, Trace, linear_axis

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
    sketch = Sketch(dark)
    for colour, run in (("nominal", outcome.before), ("identified", outcome.after)):
        for k, (title, values) in enumerate(_PANELS.items(), start=1):
            what, _, unit = title.rstrip(")").partition(" (")
            hover = f"%{{x:.0f}} ms<br>%{{y:.3g}} {unit}<extra>{colour}, {what.lower()}</extra>"
            style: Trace = {"yaxis": f"y{k}", "showlegend": k == 1, "legendgroup": colour}
            x, y = 1e3 * run.time_s[::_STRIDE], values(run)[::_STRIDE]
            sketch.line(x, y, colour, colour, hovertemplate=hover, **style)
    axes = [linear_axis(title, nticks=4) for title in _PANELS]
    return sketch.figure(linear_axis("Time (ms)"), *axes, height=720)


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
    sketch, (_, directions) = Sketch(dark), stiffness.principal
    spatial = len(directions) == 3
    plane = directions[:2] if spatial else np.eye(2)
    angle = np.linspace(0.0, 2 * np.pi, 181)
    forces = force_N * np.stack([np.cos(angle), np.sin(angle)], axis=1) @ plane
    longest = force_N * float(stiffness.principal[0][0])
    scale, unit = (1e3, "mm") if longest >= 1e-4 else (1e6, "µm")
    for colour, of in (("nominal", nominal), ("identified", stiffness)):
        if of is not None:
            moved = scale * of.deflection(forces) @ plane.T
            hover = f"%{{x:.3f}}, %{{y:.3f}} {unit}"
            sketch.line(moved[:, 0], moved[:, 1], colour, colour, hovertemplate=hover, cliponaxis=False)
    worst = scale * longest * (directions[0] @ plane.T)
    ends = np.stack([-worst, worst])
    sketch.line(ends[:, 0], ends[:, 1], "worst direction", "quiet", hoverinfo="skip")
    x, y = (linear_axis(f"Deflection along {axis} ({unit})") for axis in axes)
    return sketch.figure(x, y | {"scaleanchor": "x"}, height=320)
