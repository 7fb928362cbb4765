"""Phasors as arrows: amplitude as length, phase as direction."""

import numpy as np
import plotly.graph_objects as go

from jointid.figures.style import GRID, Sketch, joint_symbol, plain_text
from jointid.phasors.extract import Phasors
from jointid.wording import minus, significant, with_error


def phasor_plane(
    phasors: Phasors,
    *,
    torque: bool = False,
    chosen: int | None = None,
    joint: int | None = None,
    dark: bool = False,
) -> go.Figure:
    """Polar plot of the positions' or the torques' phasors of all records; the chosen record as arrows.

    With a ``joint``, the others are in the background, without arrows.
    """
    sketch = Sketch(dark)
    ink, shown = sketch.ink, range(phasors.n) if joint is None else [joint]
    others = [j for j in range(phasors.n) if j not in shown]
    values = phasors.tau if torque else phasors.q
    quantity, unit = ("Torque", "N·m") if torque else ("Position", "rad")
    part = slice(phasors.n, None) if torque else slice(phasors.n)
    errors = phasors.standard_deviation[:, part]
    size = np.abs(values)
    positive = size[size > 0]
    low, high = (float(positive.min()), float(positive.max())) if positive.size else (0.1, 1.0)
    logarithmic = high > 30 * low
    low = max(low, 1e-4 * high)  # a joint at rest lies at the centre
    for j in sorted(range(phasors.n), key=lambda j: j in shown):
        symbol = joint_symbol(j) + ("-open" if j % 2 else "")
        f = phasors.omega / (2 * np.pi)
        angles = np.degrees(np.angle(values[:, j]))
        points = zip(f, size[:, j], errors[:, j] / np.sqrt(2), angles, strict=True)
        about = [
            [float(f), with_error(float(a), float(e)), minus(f"{turn:.1f}")] for f, a, e, turn in points
        ]
        sketch.traces.append(
            {
                "type": "scatterpolar",
                "mode": "markers",
                "r": np.maximum(size[:, j], low / 2) if logarithmic else size[:, j],
                "theta": angles,
                "name": f"joint {j + 1}" if j in shown else "other joints",
                "legendrank": j if j in shown else phasors.n,
                "legendgroup": j if j in shown else "others",
                "showlegend": j in shown or j == others[0],
                "marker": {"color": ink.measured, "size": 7, "symbol": symbol}
                if j in shown
                else {"color": ink.quiet, "size": 4, "opacity": 0.6},
                "customdata": about,
                "text": [plain_text(label) for label in phasors.labels],
                "hovertemplate": "%{text}<br>%{customdata[0]:.4g} Hz<br>"
                "%{customdata[1]} "
                f"{unit}, %{{customdata[2]}}°<extra>{quantity} of joint {j + 1}</extra>",
            }
        )
    if chosen is not None:
        origin, colour = low / 2 if logarithmic else 0.0, ink.identified
        for j in shown:
            angle = float(np.degrees(np.angle(values[chosen, j])))
            sketch.traces.append(
                {
                    "type": "scatterpolar",
                    "mode": "lines+markers",
                    "r": [origin, max(float(size[chosen, j]), origin)],
                    "theta": [angle, angle],
                    "name": "chosen record",
                    "legendgroup": "chosen",
                    "legendrank": phasors.n,
                    "showlegend": j == shown[0],
                    "line": {"color": colour, "width": 2.5, "dash": "solid" if j == shown[0] else "dot"},
                    "marker": {"size": [0, 10], "color": colour},
                    "hoverinfo": "skip",
                }
            )
    between = np.arange(22.5, 360.0, 45.0)  # the angles' own labels stand at multiples of 45°
    turned = np.degrees(np.angle(values[size > 0]))[:, None] - between
    free = np.abs((turned + 180) % 360 - 180).min(axis=0, initial=180).argmax()
    radial = {"gridcolor": GRID, "linecolor": GRID, "angle": between[free], "nticks": 4}
    radial["tickangle"] = radial["angle"]  # it is counted from the axis: the text is level
    if logarithmic:
        first, last = float(np.log10(low / 2)), float(np.log10(high * 1.3))
        decades = [10.0**k for k in range(int(np.ceil(first)), int(np.floor(last)) + 1)]
        radial |= {"type": "log", "range": [first, last], "tickvals": decades}
        radial["ticktext"] = [significant(decade, 1) for decade in decades]
    else:
        # The rim is the grid's last circle, not a second one beside it.
        step = 10.0 ** np.floor(np.log10(high))
        step *= next(factor for factor in (0.2, 0.5, 1.0, 2.0) if high <= 5 * factor * step)
        radial |= {"range": [0, step * np.ceil(1.02 * high / step)], "dtick": step}
    return sketch.figure(
        height=430,
        margin={"l": 40, "r": 40, "t": 30, "b": 30},
        polar={
            "bgcolor": "rgba(0,0,0,0)",
            "radialaxis": radial,
            "angularaxis": {"gridcolor": GRID, "dtick": 45, "ticksuffix": "°", "linecolor": GRID},
        },
        legend={
            "orientation": "h",
            "x": -0.1,
            "y": -0.08,
            "yanchor": "top",
        },  # the toolbar is at the right
    )
