"""Line drawings of a few shapes, for SVG and for a PDF page.

Coordinates are in points (1/72 inch), x to the right and y downwards from the upper left corner.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal
from xml.sax.saxutils import escape, quoteattr

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
    """Of the baseline."""
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
        if share == 1.0:
            return self
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
    """Return a drawing as an inline SVG element as wide as its container, or as a file on white.

    Parameters
    ----------
    drawing : Drawing
    title : str
        Title of the file; "" for an inline element.
    """
    width, height = _n(drawing.width), _n(drawing.height)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'role="img" aria-label={quoteattr(drawing.description)}'
    ]
    if title:
        size = f'width="{width}" height="{height}"'
        parts.append(f' {size} font-family="sans-serif"><title>{escape(title)}</title>')
        parts.append(f'<rect {size} fill="#FFFFFF"/>')
    else:
        parts.append(">")
    for shape in drawing.shapes:
        if isinstance(shape, Line):
            parts.append(_line(shape))
        elif isinstance(shape, Marks):
            parts.append(_marks(shape))
        else:
            parts.append(_text(shape))
    return "".join([*parts, "</svg>"])


def _line(line: Line) -> str:
    path = "L".join(f"{_n(x)} {_n(y)}" for x, y in line.points.tolist())
    dash = f' stroke-dasharray="{" ".join(_n(d) for d in line.dash)}"' if line.dash else ""
    faint = f' stroke-opacity="{_n(line.opacity)}"' if line.opacity < 1 else ""
    return (
        f'<path d="M{path}" fill="none" stroke="{line.colour}" stroke-width="{_n(line.width)}"'
        f'{dash}{faint} stroke-linejoin="round"/>'
    )


def _marks(marks: Marks) -> str:
    r = marks.size / 2
    filled = marks.symbol == "circle"
    style = (
        f'fill="{marks.colour}"' if filled else f'fill="none" stroke="{marks.colour}" stroke-width=".8"'
    )
    if marks.symbol == "square":
        one = f"m{_n(-r)} {_n(-r)}h{_n(2 * r)}v{_n(2 * r)}h{_n(-2 * r)}z"
    else:
        half = f"a{_n(r)} {_n(r)} 0 1 0 "
        one = f"m{_n(-r)} 0{half}{_n(2 * r)} 0{half}{_n(-2 * r)} 0"
    path = "".join(f"M{_n(x)} {_n(y)}{one}" for x, y in marks.points.tolist())
    return f'<path d="{path}" {style}/>'


def _text(text: Text) -> str:
    place = f'x="{_n(text.x)}" y="{_n(text.y)}"'
    if text.turned:
        place += f' transform="rotate(-90 {_n(text.x)} {_n(text.y)})"'
    anchor = f' text-anchor="{text.anchor}"' if text.anchor != "start" else ""
    weight = ' font-weight="bold"' if text.bold else ""
    return (
        f'<text {place} font-size="{_n(text.size)}" fill="{text.colour}"{anchor}{weight}>'
        f"{escape(text.text)}</text>"
    )


def _n(value: float) -> str:
    """A hundredth of a point is finer than any printer."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
