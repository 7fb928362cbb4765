"""Required accuracy of the springs: path error over the assumed stiffnesses."""

import numpy as np
import plotly.graph_objects as go

from jointid.arrays import Floats
from jointid.cut.tolerance import ToleranceMap
from jointid.figures.style import Axis, Trace, colours, figure, line, linear_axis, points
from jointid.joints import Elasticity
from jointid.wording import minus

_CONFIDENT = 2.448
"""Radius, in standard errors, of the ellipse that holds 95 % of a plane normal distribution."""
_VISIBLE = 0.02
"""Size of the ellipse, as a share of the map, that its point does not hide."""
_MOST_LEVELS = 5
_LEAST_DECADES = 0.3
"""Errors that differ by less than this look alike: their differences hardly matter."""
_RAYS = ((-1, 1), (1, -1), (-1, 0), (0, 1), (1, 0), (0, -1), (-1, -1), (1, 1))
"""Directions of a contour's label, the preferred ones first."""
_LABEL_SHARE = (0.13, 0.06)
"""Room that a label needs, as shares of the map's width and height."""
_LEVELS_MM = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


def tolerance_heatmap(
    tolerance: ToleranceMap,
    elasticity: Elasticity,
    covariance: Floats,
    assumed: Elasticity | None = None,
    *,
    dark: bool = False,
) -> go.Figure:
    """Largest path error over the assumed stiffnesses, the identified point and its 95 % ellipse on it.

    Parameters
    ----------
    tolerance : ToleranceMap
        Computed with ``elasticity`` as the true one.
    elasticity : Elasticity
        Identified K and D.
    covariance : ndarray, shape (4, 4)
        Their covariance, order K1, K2, D1, D2.
    assumed : Elasticity, optional
        The nominal controller, drawn when it lies within the map.
    """
    ink = colours(dark)
    x, y = tolerance.ratios_1, tolerance.ratios_2
    error = 1e3 * np.maximum(tolerance.max_contour_error_m.T, 1e-7)
    levels = [v for v in _LEVELS_MM if error.min() < v < error.max()][-_MOST_LEVELS:]
    low, high = float(np.log10(error.min())), float(np.log10(error.max()))
    shades = ["#1B1B1B", "#6E6E6E"] if dark else ["#FFFFFF", "#B5B5B5"]
    hover = "K̂1/K1 = %{x:.4g}<br>K̂2/K2 = %{y:.4g}<br>%{customdata:.3g} mm<extra>path error</extra>"
    shared: Trace = {"x": x, "y": y, "z": np.log10(error), "showscale": False}
    traces: list[Trace] = [
        {
            "type": "heatmap",
            "customdata": error,
            "colorscale": [[0.0, shades[0]], [1.0, shades[1]]],
            "zmin": min(max(low, high - 2), high - _LEAST_DECADES),
            "zmax": high,
            "zsmooth": "best",
            "hovertemplate": hover,
        }
        | shared
    ]
    for level in levels:
        at = float(np.log10(level))
        traces.append(
            {
                "type": "contour",
                "contours": {"start": at, "end": at, "size": 1, "coloring": "none"},
                "line": {"color": ink.measured, "width": 1.2},
                "hoverinfo": "skip",
                "showlegend": False,
            }
            | shared
        )
    traces += _ellipse(elasticity, covariance, ink.identified, _VISIBLE * np.log(x[-1] / x[0]))
    if assumed is not None:
        ratio = assumed.K / elasticity.K
        if x[0] <= ratio[0] <= x[-1] and y[0] <= ratio[1] <= y[-1]:
            traces.append(
                points(
                    ratio[:1],
                    ratio[1:],
                    "nominal",
                    ink.nominal,
                    marker={"size": 12, "symbol": "x"},
                    hovertemplate="K̂1/K1 = %{x:.3g}<br>K̂2/K2 = %{y:.3g}<extra>nominal</extra>",
                )
            )
    free = [(0.5, 0.5)]
    if assumed is not None:
        free.append(_place(x, y, assumed.K / elasticity.K))
    notes = [_level_note(x, y, np.log10(error), level, free) for level in levels]
    look = {"font": {"size": 12, "color": ink.measured}, "bgcolor": shades[0]}
    notes = [note | look for note in notes if note is not None]
    axes = _ratio_axis("K̂1 / K1", x), _ratio_axis("K̂2 / K2", y)
    return figure(traces, *axes, height=520, dark=dark, annotations=notes)


def _ellipse(elasticity: Elasticity, covariance: Floats, colour: str, visible: float) -> list[Trace]:
    """The identified point, and the 95 % confidence ellipse of K̂/K if it is visible."""
    scale = 1 / elasticity.K
    relative = scale[:, None] * covariance[:2, :2] * scale
    value, vector = np.linalg.eigh(relative)
    turn = np.linspace(0, 2 * np.pi, 121)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    around = 1 + _CONFIDENT * (vector * np.sqrt(np.maximum(value, 0.0))) @ circle
    around = np.maximum(around, 1e-3)
    hover = "identified ± %{customdata:.2g} %<extra></extra>"
    spread = 100 * np.sqrt(np.diag(relative).max())
    found, style = [], {"customdata": [spread], "hovertemplate": hover}
    name = "identified; 95 % of its uncertainty within this point"
    if np.ptp(np.log(around), axis=1).max() > visible:
        name = "identified"
        found = [line(around[0], around[1], "95 % of its uncertainty", colour, hoverinfo="skip")]
    return [*found, points(np.ones(1), np.ones(1), name, colour, marker={"size": 9}, **style)]


def _place(x: Floats, y: Floats, ratios: Floats) -> tuple[float, float]:
    """Positions of ratios on the map, as shares of its width and height."""
    shares = [np.log(r / v[0]) / np.log(v[-1] / v[0]) for r, v in zip(ratios, (x, y), strict=True)]
    return float(shares[0]), float(shares[1])


def _level_note(
    x: Floats, y: Floats, z: Floats, level: float, taken: list[tuple[float, float]]
) -> dict[str, object] | None:
    """Label of a contour, where it crosses a ray from the middle and nothing else lies.

    ``taken`` are the places of the points and of the other labels, as shares of the map; the new one
    is added. A contour that is too small for a label has none: it would hide the identified point.
    """
    away = np.linspace(0.0, 0.48, 200)
    for ray in _RAYS:
        along = [0.5 + away * part for part in ray]
        column, row = (s * (v.size - 1) for s, v in zip(along, (x, y), strict=True))
        i, j = column.astype(int).clip(0, x.size - 2), row.astype(int).clip(0, y.size - 2)
        a, b = column - i, row - j
        value = (1 - a) * ((1 - b) * z[j, i] + b * z[j + 1, i]) + a * (
            (1 - b) * z[j, i + 1] + b * z[j + 1, i + 1]
        )
        above = np.flatnonzero(value >= np.log10(level))
        if above.size == 0 or above[0] == 0:
            continue
        place = tuple(float(share[above[0]]) for share in along)
        if any(
            abs(place[0] - u) < _LABEL_SHARE[0] and abs(place[1] - v) < _LABEL_SHARE[1] for u, v in taken
        ):
            continue
        taken.append((place[0], place[1]))
        at = [
            float(np.log10(v[0]) + share * np.log10(v[-1] / v[0]))
            for v, share in zip((x, y), place, strict=True)
        ]
        return {"x": at[0], "y": at[1], "text": f"{level:g} mm", "showarrow": False, "borderpad": 1}
    return None


def _ratio_axis(title: str, ratios: Floats) -> Axis:
    """Logarithmic axis of K̂/K; near 1 in per cent."""
    low, high = float(ratios[0]), float(ratios[-1])
    if high / low > 1.5:
        ticks = [0.1, 0.2, 1 / 3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0]
        text = [f"{t:.2g}" for t in ticks]
    else:
        step = _round_step((high - low) / 4)
        count = int((high - 1) / step)
        ticks = [1 + step * k for k in range(-count, count + 1)]
        text = [minus(f"{100 * (t - 1):+.3g} %") if t != 1 else "1" for t in ticks]
    return linear_axis(
        title,
        type="log",
        range=[float(np.log10(low)), float(np.log10(high))],
        tickvals=ticks,
        ticktext=text,
        showgrid=False,
    )


def _round_step(size: float) -> float:
    """1, 2 or 5 times a power of ten, near a size."""
    power = 10.0 ** np.floor(np.log10(size))
    return float(power * min((1, 2, 5, 10), key=lambda m: abs(m - size / power)))
