"""Style of all figures: one colour per meaning (Okabe-Ito), axes with quantity and unit."""

import math
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import Any

import numpy as np
import plotly.graph_objects as go

from jointid.arrays import Floats
from jointid.wording import significant

Trace = dict[str, Any]
Axis = dict[str, Any]
Shape = dict[str, Any]

_MOST_DECADES = 3
"""Decades of the longest axis with ticks at 1, 2 and 5; longer ones have ticks at some powers of ten."""
_GAP = 0.16
"""Share of a panel below it that stays free."""
GRID = "rgba(150, 150, 150, 0.35)"
_LOOK: Axis = {
    "gridcolor": GRID,
    "zeroline": False,
    "automargin": True,
    "ticks": "outside",
    "ticklen": 4,
    "tickcolor": "rgba(0,0,0,0)",
    "ticklabeloverflow": "allow",  # else every label is measured once more
}
MARGIN = {"l": 68, "r": 16, "b": 60}
"""Enough for the usual labels: where the labels need more, plotly draws the figure a second time."""
_FULL_HEIGHT: Shape = {"yref": "paper", "y0": 0, "y1": 1}

JOINT_SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "star")
"""Markers of the joints, which distinguish them as their place does."""


@dataclass(frozen=True)
class Colours:
    """The meaning of each colour."""

    measured: str
    nominal: str
    identified: str
    other: str
    """A second study beside the chosen one."""
    quiet: str
    """Grids and background data such as noise."""


LIGHT = Colours(
    measured="#000000", nominal="#D55E00", identified="#0072B2", other="#A0458A", quiet="#767676"
)
DARK = Colours(
    measured="#FFFFFF", nominal="#E8731A", identified="#56B4E9", other="#CC79A7", quiet="#9A9A9A"
)


def colours(dark: bool) -> Colours:
    """Return the colours for a dark or a light background."""
    return DARK if dark else LIGHT


class SerialisedFigure(go.Figure):  # type: ignore[misc]
    """A finished figure: its arrays are written as text once, not whenever a page shows it."""

    @cached_property
    def _written(self) -> dict[str, Any]:
        # As plotly's to_dict, which copies every value and asks of each what kind of table it is.
        return {"data": _as_text(self._data), "layout": _as_text(self._layout)}

    def to_dict(self) -> dict[str, Any]:
        """Return the figure as plotly sends it."""
        return self._written


def _as_text(value: Any) -> Any:
    """A part of a figure with its arrays of real numbers in base64."""
    if isinstance(value, np.ndarray) and value.dtype == np.float64 and value.size:
        data = {"dtype": "f8", "bdata": b64encode(value.tobytes()).decode("ascii")}
        return data | ({"shape": str(value.shape)[1:-1]} if value.ndim > 1 else {})
    if isinstance(value, dict):
        return {key: each if key == "range" else _as_text(each) for key, each in value.items()}
    return [_as_text(each) for each in value] if isinstance(value, list | tuple) else value


_SMOOTH = 1000
"""Points up to which a line is drawn through all of them. Of more, plotly leaves some out: a model of
480 points would be a polygon of 55."""


class Sketch:
    """A figure in the making: traces and shapes from plain dictionaries.

    A ``colour`` is a meaning, as ``Colours`` names it, or a colour.
    """

    def __init__(self, dark: bool) -> None:
        self.ink = colours(dark)
        self.traces: list[Trace] = []
        self.shapes: list[Shape] = []
        self._dark = dark

    def line(
        self, x: Floats, y: Floats, name: str, colour: str, *, width: float = 2, **more: Any
    ) -> None:
        """Add a line, for instance a model; ``dash`` is its pattern."""
        style: Trace = {"color": self._colour(colour), "width": width}
        if len(x) <= _SMOOTH:
            style["simplify"] = False
        style |= {"dash": more.pop("dash")} if "dash" in more else {}
        self._add("lines", x, y, name, {"line": style} | more)

    def points(
        self, x: Floats, y: Floats, name: str, colour: str, *, error: Trace | None = None, **more: Any
    ) -> None:
        """Add markers, for instance measured values; ``error`` makes bars of ± that much."""
        own = self._colour(colour)
        style = {"color": own, "size": 7} | more.pop("marker", {})
        if error is not None:
            more["error_y"] = {"type": "data", "color": own, "thickness": 1.2, "width": 3} | error
        self._add("markers", x, y, name, {"marker": style} | more)

    def vertical_line(self, x: float, colour: str, *, width: float = 1.5, **more: Any) -> None:
        """Add a vertical line over the whole height."""
        stroke = {"color": self._colour(colour), "width": width, "dash": more.pop("dash", "solid")}
        self.shapes.append({"type": "line", "x0": x, "x1": x, "line": stroke} | _FULL_HEIGHT | more)

    def span(self, first: float, last: float, colour: str, opacity: float, **more: Any) -> None:
        """Add a filled span of the x axis over the whole height."""
        fill = {"fillcolor": self._colour(colour), "opacity": opacity, "line": {"width": 0}}
        self.shapes.append({"type": "rect", "x0": first, "x1": last} | fill | _FULL_HEIGHT | more)

    def figure(self, x: Axis | None = None, *y: Axis, height: int, **layout: Any) -> go.Figure:
        """Return the figure, with the margins and the legend that all figures have.

        ``x`` is the axis that all panels share; a polar figure has none. ``y`` are those of the panels
        from top to bottom, with their relative height ``share``, by default 1; traces of the second
        panel have ``yaxis="y2"``, and so on. The height is in pixels, ``layout`` the rest of plotly's.
        """
        bottom, total = 1.0, sum(axis.get("share", 1.0) for axis in y)
        for number, axis in enumerate(y, start=1):
            top, bottom = bottom, max(bottom - axis.get("share", 1.0) / total, 0.0)
            own = {key: value for key, value in axis.items() if key != "share"}
            if number < len(y):
                own["domain"] = [bottom + _GAP * (top - bottom), top]
            elif number > 1:
                own["domain"] = [0.0, top]
            layout[f"yaxis{number}" if number > 1 else "yaxis"] = _LOOK | own
        if x is not None:
            layout["xaxis"] = _LOOK | ({"anchor": f"y{len(y)}"} if len(y) > 1 else {}) | x
        ink = "#FAFAFA" if self._dark else "#31333F"
        base = {
            "height": height,
            "margin": MARGIN | {"t": 50 if len(self.traces) > 1 else 8},
            "font": {"color": ink, "size": 13, "family": '"Source Sans", sans-serif'},
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "hoverlabel": {"align": "left"},
            "modebar": {
                "bgcolor": "rgba(60, 60, 60, 0.95)" if self._dark else "rgba(240, 240, 240, 0.95)",
                "color": ink,
                "activecolor": self.ink.identified,
            },
            "legend": {
                "orientation": "h",
                "x": 0,
                "xanchor": "left",
                "y": 1.02,
                "yanchor": "bottom",
                "font": {"color": ink},
                **layout.pop("legend", {}),
            },
            "shapes": self.shapes,
        }
        # A test validates every figure: here it would take half of the time of a page.
        return SerialisedFigure({"data": self.traces, "layout": base | layout}, _validate=False)

    def _colour(self, colour: str) -> str:
        return str(getattr(self.ink, colour, colour))

    def _add(self, mode: str, x: Floats, y: Floats, name: str, more: Trace) -> None:
        self.traces.append({"type": "scatter", "mode": mode, "x": x, "y": y, "name": name} | more)


def plain_text(text: str, *, most: int = 80) -> str:
    """Return a text from a file as plotly shows it unchanged.

    Plotly reads tags (b, i, u, s, em, sub, sup, br, span with any style, a with href) and entities in
    titles, names, labels and hover texts.
    """
    short = text if len(text) <= most else f"{text[: most - 1]}…"
    return escape(short, quote=False)


def joint_symbol(joint: int) -> str:
    """Return the marker of a joint, counted from 0."""
    return JOINT_SYMBOLS[joint % len(JOINT_SYMBOLS)]


def frequency_axis(frequency_hz: Floats, **more: Any) -> Axis:
    """Return a logarithmic frequency axis with ticks at 1, 2, 3 and 5 of every decade."""
    known = frequency_hz[np.isfinite(frequency_hz) & (frequency_hz > 0)]
    low, high = (float(known.min()), float(known.max())) if known.size else (1.0, 10.0)
    margin = 1.12 if high > 1.5 * low else 1.5
    ends = [float(np.log10(low / margin)), float(np.log10(high * margin))]
    return _ticked("Frequency (Hz)", (1, 2, 3, 5), range(-3, 6)) | {"range": ends} | more


def log_axis(title: str, **more: Any) -> Axis:
    """Return a logarithmic axis with ticks at 1, 2, 5 of every decade, more if short, fewer if long."""
    low, high = more.get("range") or (0.0, 2.0)
    if high - low > _MOST_DECADES:
        decades = range(math.floor(low), math.ceil(high) + 1, math.ceil((high - low) / 6))
        return _ticked(title, (1,), decades) | more
    return _ticked(title, (1, 2, 5) if high - low > 1 else (1, 1.5, 2, 3, 4, 5, 7)) | more


def _ticked(title: str, steps: Sequence[float], decades: range = range(-12, 10)) -> Axis:
    """Logarithmic axis with ticks at some places of every decade."""
    ticks = [m * 10.0**d for d in decades for m in steps]
    return linear_axis(title, type="log", tickvals=ticks, ticktext=[_tick_text(t) for t in ticks])


def _tick_text(tick: float) -> str:
    """The same text of a number on every axis: plain from 0.0001 to 50000, else as 2×10⁵."""
    text = f"{tick:g}" if 9e-5 < tick < 9e4 else significant(tick, 1)
    return text.removeprefix("1×")


def linear_axis(title: str, **more: Any) -> Axis:
    """Return a linear axis with its quantity and unit."""
    return {"title": {"standoff": 10, "text": title}} | more
