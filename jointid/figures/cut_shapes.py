"""Outlines of cuts as small SVG pictures, drawn without a browser."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointid.arrays import Floats

_STRIDE = 4
_WIDTH = 190
"""Width of a picture, pixels."""


@dataclass(frozen=True, eq=False)
class Shape:
    """One cut: reference path and cut path."""

    wanted_m: Floats
    """Shape (k, 2), m."""
    tool_m: Floats
    """Shape (k, 2), m."""
    colour: str
    caption: tuple[str, ...] = ()
    """Lines below the outline, for instance the error."""


def shape_svg(
    shapes: Sequence[Shape], *, window_m: tuple[float, float, float, float] | None = None
) -> str:
    """One picture of one or several cuts over the wanted path, without text or background.

    Parameters
    ----------
    shapes : sequence of Shape
        Drawn in this order over the wanted path of the first.
    window_m : tuple of float, optional
        x, y, width and height of the view, m.
    """
    x, y, w, h = window_m or window([shape.wanted_m for shape in shapes], 0.002)
    scale = _WIDTH / w
    width, height = _WIDTH, round(h * scale)
    drawn = [(shape.wanted_m, "#999999", 5.0, 0.55) for shape in shapes[:1]]
    drawn += [(shape.tool_m, shape.colour, 2.0, 1.0) for shape in shapes]
    outlines = [
        f'<path d="{_path(track, (x, y + h), scale)}" fill="none" stroke="{colour}" '
        f'stroke-width="{line:g}" stroke-opacity="{opacity:g}" stroke-linejoin="round" '
        'stroke-linecap="round"/>'
        for track, colour, line, opacity in drawn
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
        f'height="{height}">{"".join(outlines)}</svg>'
    )


def window(paths: Sequence[Floats], margin_m: float) -> tuple[float, float, float, float]:
    """Box around paths: x, y, width and height, m."""
    low = np.min([path.min(axis=0) for path in paths], axis=0) - margin_m
    high = np.max([path.max(axis=0) for path in paths], axis=0) + margin_m
    return float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1])


def _path(track_m: Floats, corner: tuple[float, float], scale: float) -> str:
    """Path data; ``corner`` is the upper left one of the window, m."""
    xy = (track_m[::_STRIDE] - corner) * (scale, -scale)
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in xy)
