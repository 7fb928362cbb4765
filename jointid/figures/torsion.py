"""Torsion curves of the gears: measured torque over wind-up, with the fitted law; K over amplitude."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
import plotly.graph_objects as go

from jointid.arrays import Floats
from jointid.estimation.elasticity import ElasticityFit
from jointid.figures.style import (
    JOINT_SYMBOLS,
    Trace,
    colours,
    figure,
    line,
    linear_axis,
    plain_text,
    points,
)
from jointid.gears.harmonic_balance import sine_stiffness

_MOST_RECORDS = 10
"""Records drawn; more would hide each other."""
_SCALE = ("#7D5BA6", "#5B7DB1", "#2A9D8F", "#6DAF3F", "#B89A00")
"""Colours of rising frequency or amplitude, visible on black and on white."""
ColourBy = Literal["frequency", "amplitude"]


def torsion_curve(
    fit: ElasticityFit, joint: int, *, colour_by: ColourBy = "frequency", dark: bool = False
) -> go.Figure:
    """Torque of one gear over its wind-up, a period of every record, and the fitted elastic law.

    Parameters
    ----------
    fit : ElasticityFit
    joint : int
        From 0.
    colour_by : {"frequency", "amplitude"}
        Quantity behind the colours of the records.
    """
    ink, curve, gear = colours(dark), fit.torsion_curves[joint], fit.gears[joint]
    traces: list[Trace] = []
    by_frequency = colour_by == "frequency"
    size, unit = (curve.frequency_hz, "Hz") if by_frequency else (curve.amplitude_Nm, "N·m")
    height = np.log(np.maximum(size, np.finfo(float).tiny))
    ends = sorted(drawn_records(curve.amplitude_Nm), key=lambda r: height[r])
    span = max(float(np.ptp(height[ends])), 1e-9) if ends else 1.0
    named = {*ends[:1], *ends[-1:]}
    for r in ends:
        share = (height[r] - height[ends[0]]) / span * (len(_SCALE) - 1)
        x, y = (np.append(v[r], v[r, 0]) for v in (curve.deflection_rad, curve.torque_Nm))
        name = f"{size[r]:.3g} {unit}"
        band = {"line": {"width": 0}, "hoverinfo": "skip", "showlegend": False, "opacity": 0.25}
        half = 2 * curve.torque_noise_Nm[r]
        edge = np.concatenate([y + half, (y - half)[::-1]])
        both = np.concatenate([x, x[::-1]])
        colour = _SCALE[round(float(share))]
        traces.append(line(1e3 * both, edge, name, colour, fill="toself", fillcolor=colour, **band))
        record = f"{curve.frequency_hz[r]:.3g} Hz, {curve.amplitude_Nm[r]:.3g} N·m"
        hover = f"%{{x:.4g}} mrad<br>%{{y:.4g}} ± {half:.2g} N·m<extra>{record}</extra>"
        style = {"line": {"width": 1.2}, "hovertemplate": hover, "showlegend": r in named}
        traces.append(line(1e3 * x, y, name, colour, **style))
    tried = np.linspace(-gear.tried_rad, gear.tried_rad, 401)
    hover = "%{x:.4g} mrad<br>%{y:.4g} N·m<extra>fitted law</extra>"
    law = {"line": {"width": 3}, "hovertemplate": hover}
    traces.append(line(1e3 * tried, gear.torque(tried), "fitted law", ink.identified, **law))
    if gear.kind != "linear":
        flat = {"line": {"dash": "dot", "width": 1.5}, "hoverinfo": "skip"}
        traces.append(line(1e3 * tried, gear.K * tried, "slope K", ink.quiet, **flat))
    return figure(
        traces,
        height=420,
        dark=dark,
        xaxis=linear_axis("Wind-up (mrad, motor side)"),
        yaxis=linear_axis("Torque (N·m, motor side)"),
    )


def drawn_records(amplitude: Floats) -> list[int]:
    """Some records, spread over their torque amplitudes, the largest included, ascending."""
    order = np.argsort(amplitude)
    chosen = np.linspace(0, order.size - 1, min(_MOST_RECORDS, order.size)).round().astype(int)
    return [int(order[k]) for k in chosen]


def stiffness_over_amplitude(
    fit: ElasticityFit, joint: int, poses: Sequence[str] = (), *, dark: bool = False
) -> go.Figure:
    """Torque over wind-up of every record's fundamental against its torque amplitude, by pose.

    Parameters
    ----------
    fit : ElasticityFit
    joint : int
        From 0.
    poses : sequence of str
        Pose of each record; by default all the same.
    """
    ink, curve, gear = colours(dark), fit.torsion_curves[joint], fit.gears[joint]
    K, error, amplitude = curve.stiffness
    names = np.array(poses if len(poses) == K.size else [""] * K.size)
    traces: list[Trace] = []
    for k, pose in enumerate(dict.fromkeys(names.tolist())):
        own = names == pose
        name = plain_text(pose) or ("each record" if np.all(own) else "no pose stated")
        hover = "%{x:.3g} N·m<br>%{y:.4g} ± %{customdata:.2g} N·m/rad<extra></extra>"
        shared = {"customdata": error[own], "error": {"array": error[own]}, "hovertemplate": hover}
        symbol = {"symbol": JOINT_SYMBOLS[k % len(JOINT_SYMBOLS)], "size": 6}
        colour = ink.measured if k == 0 else _SCALE[(2 * k) % len(_SCALE)]
        traces.append(points(amplitude[own], K[own], name, colour, marker=symbol, **shared))
    size = np.geomspace(0.01, 1, 80) * gear.tried_rad
    secant = np.zeros(size.size) if gear.tried_rad == 0 else sine_stiffness(gear, size)
    law = {"hovertemplate": "%{x:.3g} N·m<br>%{y:.4g} N·m/rad<extra>fitted law</extra>"}
    inside = size * secant >= amplitude.min(initial=np.inf)
    traces.insert(0, line((size * secant)[inside], secant[inside], "fitted law", ink.identified, **law))
    return figure(
        traces,
        height=260,
        dark=dark,
        xaxis=linear_axis("Torque amplitude (N·m)", rangemode="tozero"),
        yaxis=linear_axis(f"K{joint + 1} (N·m/rad)"),
    )
