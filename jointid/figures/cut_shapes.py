"""Outlines of cuts as SVG, drawn without a browser: Figure 7 of the paper, and one small picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

import numpy as np

from jointid.arrays import Floats

_STRIDE = 4
_CELL_W, _CELL_H, _TEXT_H, _GAP = 190, 270, 44, 16


@dataclass(frozen=True, eq=False)
class Shape:
    """One cut: what was wanted and what came out."""

    wanted_m: Floats
    """Shape (k, 2), m."""
    tool_m: Floats
    """Shape (k, 2), m."""
    colour: str
    caption: tuple[str, ...] = ()
    """Lines below the outline, for instance the error."""


def shape_svg(
    shapes: Sequence[Shape],
    *,
    window_m: tuple[float, float, float, float] | None = None,
    stroke: float = 2.0,
) -> str:
    """One picture of one or several cuts over the wanted path, without text or background.

    Parameters
    ----------
    shapes : sequence of Shape
        Drawn in this order over the wanted path of the first.
    window_m : tuple of float, optional
        x, y, width and height of what is shown, m.
    stroke : float
        Width of the lines in pixels; the picture is 190 wide.
    """
    x, y, w, h = window_m or window([shape.wanted_m for shape in shapes], 0.002)
    scale = _CELL_W / w
    width, height = _CELL_W, round(h * scale)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
        f'height="{height}">'
    ]
    parts += _outlines(shapes, (x, y + h), scale, stroke)
    return "".join([*parts, "</svg>"])


def shapes_svg(rows: Sequence[tuple[str, Sequence[Shape]]], *, title: str) -> str:
    """Rows of cuts with captions as one SVG file on white: Figure 7 of the paper.

    Parameters
    ----------
    rows : sequence of (str, sequence of Shape)
        Heading and cuts of each row.
    title : str
        Title of the file.
    """
    every = [shape for _, shapes in rows for shape in shapes]
    around = window([path for s in every for path in (s.wanted_m, s.tool_m)], 0.002)
    x, y, w, h = around
    scale = min(_CELL_W / w, _CELL_H / h)
    row_h = 30 + _CELL_H + _TEXT_H + _GAP
    width = max(len(shapes) for _, shapes in rows) * (_CELL_W + _GAP) + _GAP
    height = len(rows) * row_h + _GAP
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
        f'height="{height}" font-family="sans-serif" font-size="13" fill="#222222">',
        f"<title>{escape(title)}</title>",
        f'<rect width="{width}" height="{height}" fill="#FFFFFF"/>',
    ]
    for r, (heading, shapes) in enumerate(rows):
        top = _GAP + r * row_h
        parts.append(f'<text x="{_GAP}" y="{top + 14}" font-weight="bold">{escape(heading)}</text>')
        for c, shape in enumerate(shapes):
            left = _GAP + c * (_CELL_W + _GAP)
            shift = left + 0.5 * (_CELL_W - w * scale), top + 30 + 0.5 * (_CELL_H - h * scale)
            parts.append(f'<g transform="translate({shift[0]:.1f} {shift[1]:.1f})">')
            parts += _outlines([shape], (x, y + h), scale, 2.0)
            parts.append("</g>")
            for k, text in enumerate(shape.caption):
                middle, line = left + 0.5 * _CELL_W, top + 30 + _CELL_H + 18 * (k + 1)
                parts.append(f'<text x="{middle}" y="{line}" text-anchor="middle">{escape(text)}</text>')
    return "".join([*parts, "</svg>"])


def window(paths: Sequence[Floats], margin_m: float) -> tuple[float, float, float, float]:
    """Box around paths: x, y, width and height, m."""
    low = np.min([path.min(axis=0) for path in paths], axis=0) - margin_m
    high = np.max([path.max(axis=0) for path in paths], axis=0) + margin_m
    return float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1])


def _outlines(
    shapes: Sequence[Shape], corner: tuple[float, float], scale: float, stroke: float
) -> list[str]:
    """The wanted path, then each cut; ``corner`` is the upper left one of the window, m."""
    drawn = [(shapes[0].wanted_m, "#999999", 2.5 * stroke, 0.55)] if shapes else []
    drawn += [(shape.tool_m, shape.colour, stroke, 1.0) for shape in shapes]
    return [
        f'<path d="{_path(track, corner, scale)}" fill="none" stroke="{colour}" '
        f'stroke-width="{width:g}" stroke-opacity="{opacity:g}" stroke-linejoin="round" '
        'stroke-linecap="round"/>'
        for track, colour, width, opacity in drawn
    ]


def _path(track_m: Floats, corner: tuple[float, float], scale: float) -> str:
    xy = (track_m[::_STRIDE] - corner) * (scale, -scale)
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in xy)
