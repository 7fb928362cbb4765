"""A figure on a PDF page; it shrinks a little where it then fits on the page."""

from typing import Any

from reportlab.platypus import Flowable
from reportlab.platypus import Paragraph as Set

from jointid.reporting.blocks import Figure
from jointid.reporting.drawing import Drawing, Line, Marks
from jointid.reporting.pdf_type import BOLD, REGULAR, clean, printable

_GAP = 5.0
"""Between drawings and caption, points."""


class Piece(Flowable):  # type: ignore[misc]
    """Drawings side by side above their caption.

    They shrink to fit the rest of a page, down to their smallest legible height; below it they move to
    the next page.
    """

    def __init__(self, figure: Figure, style: Any) -> None:
        super().__init__()
        self.spaceBefore, self.spaceAfter = 6, 10
        self._caption = Set(clean(figure.caption), style)
        self._full = self._drawings = figure.drawings

    def wrap(self, width: float, height: float) -> tuple[float, float]:
        """Choose the height of the drawings for the room that is left; return the size."""
        _, below = self._caption.wrap(width, height)
        room = (height - below - _GAP) / max(drawing.height for drawing in self._full)
        least = max(drawing.least for drawing in self._full)
        given = min(1.0, room) if room >= least else 1.0
        self._drawings = tuple(drawing.lowered(given) for drawing in self._full)
        self.width = width
        self.height = max(drawing.height for drawing in self._drawings) + _GAP + below
        return self.width, self.height

    def draw(self) -> None:
        """Paint drawings and caption."""
        used = sum(drawing.width for drawing in self._drawings)
        gap = (self.width - used) / max(1, len(self._drawings) - 1)
        at = 0.0
        for drawing in self._drawings:
            self.canv.saveState()
            self.canv.translate(at, self.height - drawing.height)
            _paint(drawing, self.canv)
            self.canv.restoreState()
            at += drawing.width + gap
        self._caption.drawOn(self.canv, 0, 0)


def _paint(drawing: Drawing, canvas: Any) -> None:
    """Paint a drawing, whose y points downwards, on a page, where it points upwards."""
    top = drawing.height
    for shape in drawing.shapes:
        canvas.saveState()
        if isinstance(shape, Line):
            canvas.setStrokeColor(shape.colour, alpha=shape.opacity)
            canvas.setLineWidth(shape.width)
            canvas.setLineJoin(1)
            canvas.setDash(*([list(shape.dash)] if shape.dash else []))
            path = canvas.beginPath()
            for k, (x, y) in enumerate(shape.points.tolist()):
                (path.lineTo if k else path.moveTo)(round(x, 2), round(top - y, 2))
            canvas.drawPath(path)
        elif isinstance(shape, Marks):
            canvas.setStrokeColor(shape.colour)
            canvas.setFillColor(shape.colour)
            canvas.setLineWidth(0.8)
            r, filled = shape.size / 2, shape.symbol == "circle"
            for x, y in shape.points.tolist():
                if shape.symbol == "square":
                    canvas.rect(x - r, top - y - r, 2 * r, 2 * r)
                else:
                    canvas.circle(x, top - y, r, stroke=not filled, fill=filled)
        else:
            canvas.setFillColor(shape.colour)
            canvas.setFont(BOLD if shape.bold else REGULAR, shape.size)
            canvas.translate(shape.x, top - shape.y)
            if shape.turned:
                canvas.rotate(90)
            place = {"start": canvas.drawString, "middle": canvas.drawCentredString}
            place.get(shape.anchor, canvas.drawRightString)(0, 0, printable(shape.text))
        canvas.restoreState()
