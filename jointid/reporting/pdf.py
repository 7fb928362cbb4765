"""A report as PDF on A4 with embedded typeface; equal reports give equal bytes."""

from collections.abc import Callable
from functools import cache
from html import escape
from importlib.resources import files
from io import BytesIO
from typing import Any

from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.pdfbase.pdfmetrics import registerFont, registerFontFamily, stringWidth
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.platypus import CondPageBreak, Flowable, KeepTogether, SimpleDocTemplate
from reportlab.platypus import Paragraph as Set
from reportlab.platypus import Table as Grid

from jointid.reporting.blocks import Block, Figure, Paragraph, Report, Table, Verdict
from jointid.reporting.drawing import Drawing, Line, Marks
from jointid.verdict.findings import Finding
from jointid.wording import printable

REGULAR, BOLD = "jointid", "jointid-bold"
QUIET, RULE = "#565B63", "#C9CDD2"
_MARGIN = 56.7
"""20 mm in points."""
_HEADING_NEEDS = 140.0
"""Room for a heading and the beginning of its section, points; with less it moves to the next page."""
_TOGETHER = 4
"""Fewest rows of a table on either side of a page break."""
_LEVEL_COLOURS = {"problem": "#B3261E", "warning": "#B26A00", "good": "#1B7F4D", "note": "#767676"}
_GAP = 5.0
"""Between drawings and caption, points."""


def to_pdf(report: Report, *, progress: Callable[[float], object] | None = None) -> bytes:
    """Return a report as PDF; letters outside Latin, Greek and Cyrillic show as boxes.

    ``progress`` is called with the share done; its exceptions end the work.
    """

    def foot(canvas: Any, document: Any) -> None:
        canvas.saveState()
        canvas.setFont(REGULAR, 7.5)
        canvas.setFillColor(QUIET)
        canvas.drawString(_MARGIN, 32, printable(report.footer))
        canvas.drawRightString(A4[0] - _MARGIN, 32, f"page {document.page}")
        canvas.restoreState()

    file = BytesIO()
    document = SimpleDocTemplate(
        file,
        pagesize=A4,
        leftMargin=_MARGIN - 6,  # a frame has 6 points of padding
        rightMargin=_MARGIN - 6,
        topMargin=50,
        bottomMargin=50,
        title=printable(report.title),
        author="",
        subject="Identification of joint elasticity",
        creator="jointid",
        lang="en",
        invariant=1,
        pageCompression=1,
    )
    story = _story(report, A4[0] - 2 * _MARGIN)
    if progress is not None:
        count = len(story)
        document.setProgressCallBack(
            lambda kind, value: progress(min(value / count, 1.0)) if kind == "PROGRESS" else None
        )
    document.build(story, onFirstPage=foot, onLaterPages=foot)
    return file.getvalue()


def _story(report: Report, width: float) -> list[Any]:
    """The flowables of the report, in order."""
    styles = _page_styles()
    story = [_set(report.title, styles["title"]), _set(report.facts, styles["facts"])]
    for section in report.sections:
        heading = [CondPageBreak(_HEADING_NEEDS), _set(section.title, styles["heading"])]
        for block in section.blocks:
            pieces, together = _block(block, styles, width)
            story += [KeepTogether([*heading, *pieces])] if together else [*heading, *pieces]
            heading = []
    return story


def _block(block: Block, styles: dict[str, Any], width: float) -> tuple[list[Any], bool]:
    """Flowables of a block, and whether they stay on one page."""
    if isinstance(block, Figure):
        return [_Piece(block, styles["caption"])], False
    if isinstance(block, Paragraph):
        return [_set(block.text, styles[block.kind])], False
    if isinstance(block, Table):
        return [_table(block, styles, width)], len(block.rows) < 2 * _TOGETHER
    assert isinstance(block, Verdict)
    return [_finding(finding, styles, width) for finding in block.findings], False


def _table(table: Table, styles: dict[str, Any], width: float) -> Any:
    """A table with the caption as its last row, which keeps it with the others over a page break."""
    answer = table.kind == "answer"
    size = "answer" if answer else "cell"
    sides = ["left" if side == "l" else "right" for side in table.sides]
    rows = []
    for number, row in enumerate((table.header, *table.rows)):
        bold = [number == 0 or (answer and column == 1) for column in range(len(row))]
        cells = zip(row, sides[: len(row)], bold, strict=True)
        rows += [[_set(text, styles[f"{size}-{side}" + "-bold" * b]) for text, side, b in cells]]
    rows = rows if table.header else rows[1:]
    if table.caption:
        rows.append([_set(table.caption, styles["caption"]), *[""] * (len(sides) - 1)])
    grid = Grid(
        rows,
        colWidths=_columns(table, width, 9.5 if answer else 8),
        repeatRows=1 if table.header else 0,
        hAlign="LEFT",
        spaceBefore=4,
        spaceAfter=10,
    )
    last = len(rows) - (2 if table.caption else 1)
    style: list[tuple[Any, ...]] = [
        ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ("LEFTPADDING", (0, 0), (-1, -1), 0),
        ("LEFTPADDING", (1, 0), (-1, -1), 12),
        ("RIGHTPADDING", (0, 0), (-1, -1), 0),
        ("TOPPADDING", (0, 0), (-1, -1), 2 if answer else 1.2),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 3 if answer else 2),
        ("LINEBELOW", (0, 0), (-1, last), 0.4, RULE),
        ("NOSPLIT", (0, 0), (0, min(_TOGETHER, last))),
        ("NOSPLIT", (0, max(0, last - _TOGETHER + 1)), (0, -1)),
    ]
    if table.caption:
        style += [("SPAN", (0, -1), (-1, -1)), ("TOPPADDING", (0, -1), (-1, -1), 4)]
    if table.header:
        style.append(("LINEBELOW", (0, 0), (-1, 0), 0.8, "#8A9099"))
    grid.setStyle(style)
    return grid


def _columns(table: Table, width: float, size: float) -> list[float]:
    """Column widths: the longest text each; the first column fills the page."""
    if table.kind == "facts":
        return [110.0, width - 110.0]
    rows = [*([table.header] if table.header else []), *table.rows]
    columns = range(len(rows[0]))
    widths = [max(stringWidth(printable(row[k]), BOLD, size) for row in rows) + 14 for k in columns]
    first = width - sum(widths[1:])
    if first < min(widths[0], 0.3 * width):
        return _shared(width, widths)
    return [first, *widths[1:]]


def _shared(width: float, wanted: list[float]) -> list[float]:
    """Share a width: narrow columns keep their width, wide ones share the rest equally."""
    left, most = width, width
    for number, one in enumerate(sorted(wanted)):
        most = left / (len(wanted) - number)
        if one > most:
            break
        left -= one
    return [min(one, most) for one in wanted]


def _set(text: str, style: Any) -> Any:
    """A paragraph or cell of plain text."""
    return Set(_clean(text), style)


def _finding(finding: Finding, styles: dict[str, Any], width: float) -> Any:
    title = f"{finding.level.capitalize()}: {_clean(finding.title)}."
    text = f"<b>{title}</b> {_clean(finding.detail)}"
    parts = [Set(text, styles["plain"])]
    if finding.remedy:
        parts.append(_set(finding.remedy, styles["quiet"]))
    box = Grid([[parts]], colWidths=[width], hAlign="LEFT", spaceAfter=5)
    box.setStyle(
        [
            ("LINEBEFORE", (0, 0), (0, -1), 3, _LEVEL_COLOURS[finding.level]),
            ("LEFTPADDING", (0, 0), (-1, -1), 9),
            ("RIGHTPADDING", (0, 0), (-1, -1), 0),
            ("TOPPADDING", (0, 0), (-1, -1), 0),
            ("BOTTOMPADDING", (0, 0), (-1, -1), 0),
        ]
    )
    return box


class _Piece(Flowable):  # type: ignore[misc]
    """Drawings side by side above their caption.

    They shrink to fit the rest of a page, down to their smallest legible height; below it they move to
    the next page.
    """

    def __init__(self, figure: Figure, style: Any) -> None:
        super().__init__()
        self.spaceBefore, self.spaceAfter = 6, 10
        self._caption = _set(figure.caption, style)
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


@cache
def _register_fonts() -> None:
    for name, file in ((REGULAR, "Roboto-Regular.ttf"), (BOLD, "Roboto-Bold.ttf")):
        data = files("font_roboto").joinpath("files", file).read_bytes()
        registerFont(TTFont(name, BytesIO(data)))
    registerFontFamily(REGULAR, normal=REGULAR, bold=BOLD, italic=REGULAR, boldItalic=BOLD)


def _page_styles() -> dict[str, Any]:
    _register_fonts()

    def style(name: str, size: float, **more: Any) -> Any:
        values = {"fontName": REGULAR, "fontSize": size, "leading": 1.38 * size, "textColor": "#1F2329"}
        return ParagraphStyle(name, **values | more)

    made = {
        "title": style("title", 21, fontName=BOLD, leading=25),
        "facts": style("facts", 9.5, textColor=QUIET, spaceAfter=4),
        "heading": style("heading", 13, fontName=BOLD, spaceBefore=12, spaceAfter=4),
        "plain": style("plain", 9.5, spaceAfter=5),
        "lead": style("lead", 14, leading=18.5, spaceAfter=6),
        "quiet": style("quiet", 8.5, textColor=QUIET, spaceAfter=5),
        "caption": style("caption", 8, textColor=QUIET),
    }
    for size, points in (("cell", 8.0), ("answer", 9.5)):
        for side, alignment in (("left", 0), ("right", 2)):
            for weight, font in (("", REGULAR), ("-bold", BOLD)):
                name = f"{size}-{side}{weight}"
                made[name] = style(name, points, alignment=alignment, fontName=font)
    return made


def _clean(text: str) -> str:
    """Return text for a reportlab paragraph, its markup escaped."""
    return escape(printable(text), quote=False)
