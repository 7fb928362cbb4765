"""The cut over time, one corner, the path error's distribution, and the tool under a force."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from jointid.arrays import Floats
from jointid.cut.outcome import Outcome
from jointid.cut.tolerance import PathErrorDistribution
from jointid.cut.tool_stiffness import ToolStiffness
from jointid.cut.tracking import TrackingRun
from jointid.figures.style import Trace, bars, colours, figure, line, linear_axis

_STRIDE = 4
"""One point per millisecond."""


def path_error_over_time(outcome: Outcome, *, dark: bool = False) -> go.Figure:
    """Contour error above, tracking error below, both controllers, against time."""
    panels = (
        ("Path error (mm)", lambda run: 1e3 * run.contour_error_m),
        ("Tracking error (mm)", lambda run: 1e3 * run.tracking_error_m),
    )
    return _over_time(outcome, panels, dark, rangemode="tozero")


def torque_over_time(outcome: Outcome, *, dark: bool = False) -> go.Figure:
    """Motor torques of both joints, both controllers, against time."""
    panels = (
        ("Torque, motor 1 (N·m)", lambda run: run.motor_torque_Nm[:, 0]),
        ("Torque, motor 2 (N·m)", lambda run: run.motor_torque_Nm[:, 1]),
    )
    return _over_time(outcome, panels, dark)


def corner_detail(outcome: Outcome, corner: int = 0, *, dark: bool = False) -> go.Figure:
    """The tool paths around one corner, to scale.

    Parameters
    ----------
    outcome : Outcome
    corner : int
        From 0, in the order of the cut.
    """
    ink = colours(dark)
    point, ahead, span = outcome.toolpath.corners()
    begin, end = span[corner]
    largest = max(outcome.before_m, outcome.after.max_contour_error_m)
    zone = float(np.linalg.norm(outcome.toolpath.position([begin])[0] - point[corner]))
    half = max(2.2 * largest, 0.9 * zone, 0.004)
    traces = []
    runs = _both(outcome, dark)
    for name, xy, time, colour, width in [
        ("reference path", outcome.before.wanted_m, outcome.before.time_s, ink.quiet, 5),
        *((name, run.tool_m, run.time_s, colour, 2) for name, run, colour in runs),
    ]:
        near = (time > begin - 0.06) & (time < end + 0.02)
        x, y = 1e3 * (xy[near] - point[corner]).T
        hover = f"%{{customdata:.0f}} ms<br>%{{x:.3f}}, %{{y:.3f}} mm<extra>{name}</extra>"
        more = {"customdata": 1e3 * time[near], "hovertemplate": hover}
        traces.append(line(x, y, name, colour, line={"width": width}, **more))
    inwards = np.array([-ahead[corner][1], ahead[corner][0]]) - ahead[corner]
    middle = 1e3 * 0.45 * half * inwards
    limits = [[float(m - 1e3 * half), float(m + 1e3 * half)] for m in middle]
    x, y = (
        linear_axis(f"{name} from the corner (mm)", range=limit, constrain="domain")
        for name, limit in zip("xy", limits, strict=True)
    )
    return figure(traces, x, y | {"scaleanchor": "x"}, height=420, dark=dark)


def path_error_histogram(distribution: PathErrorDistribution, *, dark: bool = False) -> go.Figure:
    """Path errors of the robots that the fit's uncertainty allows, with median and 95th percentile."""
    ink = colours(dark)
    error = 1e6 * distribution.max_contour_error_m
    unit, factor = ("mm", 1e-3) if error.max() >= 100 else ("µm", 1.0)
    counts, edges = np.histogram(factor * error, bins=20)
    share = 100 * counts / error.size
    hover = f"%{{x:.3g}} {unit}<br>%{{y:.0f}} % of the simulated robots<extra></extra>"
    look: Trace = {"width": np.diff(edges), "marker": {"opacity": 0.75}, "showlegend": False}
    middle = 0.5 * (edges[1:] + edges[:-1])
    traces = [bars(middle, share, "robots", ink.identified, hovertemplate=hover, **look)]
    top = 1.08 * float(share.max())
    for name, value, dash in (
        ("median", distribution.median_m, "dot"),
        ("95th percentile", distribution.p95_m, "solid"),
    ):
        x = np.full(2, 1e6 * factor * value)
        text = f"{name}: {x[0]:.3g} {unit}"
        style = {"line": {"dash": dash}, "hovertemplate": f"{text}<extra></extra>"}
        traces.append(line(x, np.array([0.0, top]), text, ink.measured, **style))
    across = linear_axis(f"Largest path error ({unit})", nticks=6)
    upwards = linear_axis("Share of simulated robots (%)", range=[0.0, top])
    return figure(traces, across, upwards, height=420, dark=dark, bargap=0)


def _over_time(
    outcome: Outcome,
    panels: Sequence[tuple[str, Callable[[TrackingRun], Floats]]],
    dark: bool,
    **axis: Any,
) -> go.Figure:
    """Two quantities of both controllers, one panel above the other: title with unit, and values."""
    traces: list[Trace] = []
    for name, run, colour in _both(outcome, dark):
        for k, (title, values) in enumerate(panels):
            what, _, unit = title.rstrip(")").partition(" (")
            hover = f"%{{x:.0f}} ms<br>%{{y:.3g}} {unit}<extra>{name}, {what.lower()}</extra>"
            style = {"yaxis": ("y", "y2")[k], "showlegend": k == 0, "legendgroup": name}
            x, y = 1e3 * run.time_s[::_STRIDE], values(run)[::_STRIDE]
            traces.append(line(x, y, name, colour, hovertemplate=hover, **style))
    axes = [linear_axis(title, **axis) for title, _ in panels]
    return figure(traces, linear_axis("Time (ms)"), *axes, height=420, dark=dark)


def _both(outcome: Outcome, dark: bool) -> list[tuple[str, TrackingRun, str]]:
    ink = colours(dark)
    return [
        ("nominal", outcome.before, ink.nominal),
        ("identified", outcome.after, ink.identified),
    ]


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
