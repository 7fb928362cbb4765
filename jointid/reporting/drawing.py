"""Line drawings of a few shapes, for SVG and for a PDF page.

Coordinates are in points (1/72 inch), x to the right and y downwards from the upper left corner.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal
from xml.etree.ElementTree import Element, SubElement, tostring

from jointid.arrays import Floats

Anchor = Literal["start", "middle", "end"]
Symbol = Literal["circle", "ring", "square"]


@dataclass(frozen=True, eq=False)
class Line:
    """A polyline through points."""

    points: Floats
    """Shape (k, 2)."""
    colour: str
    width: float = 1.0
    dash: tuple[float, ...] = ()
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Marks:
    """The same small symbol at many points."""

    points: Floats
    """Shape (k, 2)."""
    colour: str
    symbol: Symbol = "circle"
    size: float = 3.0
    """Diameter."""


@dataclass(frozen=True)
class Text:
    """A line of text; ``turned`` reads upwards."""

    x: float
    y: float
    """Height of the baseline."""
    text: str
    size: float = 7.0
    anchor: Anchor = "start"
    bold: bool = False
    turned: bool = False
    colour: str = "#31333F"


@dataclass(frozen=True)
class Drawing:
    """A picture with its size."""

    width: float
    height: float
    shapes: tuple[Line | Marks | Text, ...]
    description: str
    """Alternative text."""
    to_scale: bool = False
    """Whether both directions have one scale."""
    least: float = 1.0
    """Smallest legible share of its height."""

    def lowered(self, share: float) -> Drawing:
        """Return the picture at a share of its height, texts and marks as large as before."""
        across = share if self.to_scale else 1.0
        return replace(
            self,
            width=across * self.width,
            height=share * self.height,
            shapes=tuple(_moved(shape, across, share) for shape in self.shapes),
        )


def _moved(shape: Line | Marks | Text, across: float, down: float) -> Line | Marks | Text:
    if isinstance(shape, Text):
        return replace(shape, x=across * shape.x, y=down * shape.y)
    return replace(shape, points=shape.points * (across, down))


def to_svg(drawing: Drawing, *, title: str = "") -> str:
    """Return a drawing as an inline SVG element as wide as its container, or with a title as a file on
    white.
    """
    width, height = _n(drawing.width), _n(drawing.height)
    size = {"width": width, "height": height}
    root = Element("svg", xmlns="http://www.w3.org/2000/svg", viewBox=f"0 0 {width} {height}")
    root.attrib |= {"role": "img", "aria-label": drawing.description}
    if title:
        root.attrib |= size | {"font-family": "sans-serif"}
        SubElement(root, "title").text = title
        SubElement(root, "rect", size, fill="#FFFFFF")
    for shape in drawing.shapes:
        if isinstance(shape, Text):
            place = {"x": _n(shape.x), "y": _n(shape.y), "font-size": _n(shape.size)}
            text = SubElement(root, "text", place, fill=shape.colour)
            text.text = shape.text
            text.attrib |= {"text-anchor": shape.anchor} if shape.anchor != "start" else {}
            text.attrib |= {"font-weight": "bold"} if shape.bold else {}
            if shape.turned:
                text.set("transform", f"rotate(-90 {_n(shape.x)} {_n(shape.y)})")
        elif isinstance(shape, Line):
            path = "L".join(f"{_n(x)} {_n(y)}" for x, y in shape.points.tolist())
            stroke = {"stroke": shape.colour, "stroke-width": _n(shape.width)}
            stroke |= {"stroke-dasharray": " ".join(map(_n, shape.dash))} if shape.dash else {}
            stroke |= {"stroke-opacity": _n(shape.opacity)} if shape.opacity < 1 else {}
            SubElement(root, "path", stroke | {"stroke-linejoin": "round"}, d=f"M{path}", fill="none")
        else:
            filled = shape.symbol == "circle"
            style = {"stroke": shape.colour, "stroke-width": ".8"} if not filled else {}
            path = "".join(f"M{_n(x)} {_n(y)}{_outline(shape)}" for x, y in shape.points.tolist())
            SubElement(root, "path", style, d=path, fill=shape.colour if filled else "none")
    return tostring(root, "unicode")


def _outline(marks: Marks) -> str:
    r = marks.size / 2
    if marks.symbol == "square":
        return f"m{_n(-r)} {_n(-r)}h{_n(2 * r)}v{_n(2 * r)}h{_n(-2 * r)}z"
    half = f"a{_n(r)} {_n(r)} 0 1 0 "
    return f"m{_n(-r)} 0{half}{_n(2 * r)} 0{half}{_n(-2 * r)} 0"


def _n(value: float) -> str:
    """A hundredth of a point is finer than any printer."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
