"""A report as PDF, on A4, with its typeface embedded; equal reports give equal bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from io import BytesIO
from typing import Any

from jointid.errors import JointIdError
from jointid.reporting.blocks import Block, Figure, Paragraph, Report, Table, Verdict
from jointid.reporting.drawing import Drawing, Line, Marks
from jointid.reporting.html import LEVELS
from jointid.verdict.findings import Finding

_MARGIN = 56.7  # 20 mm
_REGULAR, _BOLD = "jointid", "jointid-bold"
_QUIET, _RULE = "#565B63", "#C9CDD2"
_LEVEL_COLOURS = {"problem": "#B3261E", "warning": "#B26A00", "good": "#1B7F4D", "note": "#767676"}


def to_pdf(report: Report, *, progress: Callable[[float], object] | None = None) -> bytes:
    """Return a report as PDF.

    Parameters
    ----------
    report : Report
        As ``make_report`` wrote it. Letters outside Latin, Greek and Cyrillic show as boxes.
    progress : callable, optional
        Called with the share of the pieces that stand on a page. What it raises ends the work.

    Raises
    ------
    JointIdError
        When reportlab is not installed.
    """
    try:
        from reportlab.lib.pagesizes import A4
        from reportlab.platypus import CondPageBreak, KeepTogether, SimpleDocTemplate
        from reportlab.platypus import Paragraph as Set
    except ImportError as error:
        raise JointIdError(
            "A PDF needs the package reportlab, which is not installed: pip install jointid[pdf]. "
            "The HTML report needs nothing."
        ) from error
    styles = _styles()
    story: list[Any] = [
        Set(_clean(report.title), styles["title"]),
        Set(_clean(report.facts), styles["facts"]),
    ]
    width = A4[0] - 2 * _MARGIN
    for section in report.sections:
        heading = [CondPageBreak(140), Set(_clean(section.title), styles["heading"])]
        for block in section.blocks:
            flowables, together = _block(block, styles, width)
            # A heading keeps with what follows, but not by itself with a group.
            story += [KeepTogether([*heading, *flowables])] if together else [*heading, *flowables]
            heading = []

    def foot(canvas: Any, document: Any) -> None:
        canvas.saveState()
        canvas.setFont(_REGULAR, 7.5)
        canvas.setFillColor(_QUIET)
        canvas.drawString(_MARGIN, 32, _printable(report.footer))
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
        title=_printable(report.title),
        author="",
        subject="Identification of joint elasticity",
        creator="jointid",
        lang="en",
        invariant=1,
        pageCompression=1,
    )
    if progress is not None:
        pieces = len(story)
        document.setProgressCallBack(
            lambda kind, value: progress(min(value / pieces, 1.0)) if kind == "PROGRESS" else None
        )
    document.build(story, onFirstPage=foot, onLaterPages=foot)
    return file.getvalue()


def _block(block: Block, styles: dict[str, Any], width: float) -> tuple[list[Any], bool]:
    """Pieces of the page, and whether no page break may come between them."""
    from reportlab.platypus import Paragraph as Set

    if isinstance(block, Paragraph):
        return [Set(_clean(block.text), styles[block.kind])], False
    if isinstance(block, Table):
        return _table(block, styles, width), len(block.rows) < 25
    if isinstance(block, Figure):
        caption = Set(_clean(block.caption), styles["caption"])
        return [_side_by_side(block.drawings, width), caption], True
    assert isinstance(block, Verdict)
    return [_finding(finding, styles, width) for finding in block.findings], False


def _table(table: Table, styles: dict[str, Any], width: float) -> list[Any]:
    from reportlab.platypus import Paragraph as Set
    from reportlab.platypus import Table as Grid

    answer = table.kind == "answer"
    size = "answer" if answer else "cell"
    sides = ["left" if side == "l" else "right" for side in table.sides]
    rows = []
    if table.header:
        rows.append(
            [
                _cell(h, styles, f"{size}-{side}-bold")
                for h, side in zip(table.header, sides, strict=True)
            ]
        )
    for row in table.rows:
        names = [
            f"{size}-{side}" + ("-bold" if answer and k == 1 else "") for k, side in enumerate(sides)
        ]
        rows.append([_cell(text, styles, name) for text, name in zip(row, names, strict=True)])
    grid = Grid(
        rows,
        colWidths=_columns(table, width, 9.5 if answer else 8),
        repeatRows=1 if table.header else 0,
        hAlign="LEFT",
    )
    style: list[tuple[Any, ...]] = [
        ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ("LEFTPADDING", (0, 0), (-1, -1), 0),
        ("LEFTPADDING", (1, 0), (-1, -1), 12),
        ("RIGHTPADDING", (0, 0), (-1, -1), 0),
        ("TOPPADDING", (0, 0), (-1, -1), 2 if answer else 1.2),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 3 if answer else 2),
        ("LINEBELOW", (0, 0), (-1, -1), 0.4, _RULE),
    ]
    if table.header:
        style.append(("LINEBELOW", (0, 0), (-1, 0), 0.8, "#8A9099"))
    grid.setStyle(style)
    return [grid, Set(_clean(table.caption), styles["caption"])]


def _columns(table: Table, width: float, size: float) -> list[float]:
    """Every column as wide as its longest text, the first one stretched to fill the page."""
    from reportlab.pdfbase.pdfmetrics import stringWidth

    if table.kind == "facts":
        return [110.0, width - 110.0]
    _fonts()
    rows = [*([table.header] if table.header else []), *table.rows]
    columns = range(len(rows[0]))
    widths = [max(stringWidth(_printable(row[k]), _BOLD, size) for row in rows) + 14 for k in columns]
    first = width - sum(widths[1:])
    if first < min(widths[0], 0.3 * width):  # too wide: all columns give way alike
        return [width * w / sum(widths) for w in widths]
    return [first, *widths[1:]]


def _cell(text: str, styles: dict[str, Any], style: str) -> Any:
    from reportlab.platypus import Paragraph as Set

    return Set(_clean(text), styles[style])


def _finding(finding: Finding, styles: dict[str, Any], width: float) -> Any:
    from reportlab.platypus import Paragraph as Set
    from reportlab.platypus import Table as Grid

    level = finding.level if finding.level in LEVELS else "note"
    text = f"<b>{LEVELS[level]}: {_clean(finding.title)}.</b> {_clean(finding.detail)}"
    parts = [Set(text, styles["plain"])]
    if finding.remedy:
        parts.append(Set(_clean(finding.remedy), styles["quiet"]))
    box = Grid([[parts]], colWidths=[width], hAlign="LEFT", spaceAfter=5)
    box.setStyle(
        [
            ("LINEBEFORE", (0, 0), (0, -1), 3, _LEVEL_COLOURS[level]),
            ("LEFTPADDING", (0, 0), (-1, -1), 9),
            ("RIGHTPADDING", (0, 0), (-1, -1), 0),
            ("TOPPADDING", (0, 0), (-1, -1), 0),
            ("BOTTOMPADDING", (0, 0), (-1, -1), 0),
        ]
    )
    return box


def _side_by_side(drawings: Sequence[Drawing], width: float) -> Any:
    from reportlab.platypus import Table as Grid

    used = sum(drawing.width for drawing in drawings)
    gap = (width - used) / max(1, len(drawings) - 1) if len(drawings) > 1 else 0.0
    cells, widths = [], []
    for k, drawing in enumerate(drawings):
        cells.append(_picture(drawing))
        widths.append(drawing.width + (gap if k < len(drawings) - 1 else 0.0))
    grid = Grid([cells], colWidths=widths, hAlign="LEFT", spaceBefore=4)
    grid.setStyle([("LEFTPADDING", (0, 0), (-1, -1), 0), ("RIGHTPADDING", (0, 0), (-1, -1), 0)])
    return grid


def _picture(drawing: Drawing) -> Any:
    from reportlab.platypus import Flowable

    class Picture(Flowable):  # type: ignore[misc]
        """A drawing as a piece of the page."""

        def __init__(self) -> None:
            super().__init__()
            self.width, self.height = drawing.width, drawing.height

        def wrap(self, *_: float) -> tuple[float, float]:
            return drawing.width, drawing.height

        def draw(self) -> None:
            _paint(drawing, self.canv)

    return Picture()


def _paint(drawing: Drawing, canvas: Any) -> None:
    """Drawings count y downwards, pages upwards."""
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
            canvas.setFont(_BOLD if shape.bold else _REGULAR, shape.size)
            canvas.translate(shape.x, top - shape.y)
            if shape.turned:
                canvas.rotate(90)
            place = {"start": canvas.drawString, "middle": canvas.drawCentredString}
            place.get(shape.anchor, canvas.drawRightString)(0, 0, _printable(shape.text))
        canvas.restoreState()


@cache
def _fonts() -> None:
    """Make the typeface known."""
    from reportlab.pdfbase.pdfmetrics import registerFont, registerFontFamily
    from reportlab.pdfbase.ttfonts import TTFont

    for name, file in ((_REGULAR, "Roboto-Regular.ttf"), (_BOLD, "Roboto-Bold.ttf")):
        data = files("font_roboto").joinpath("files", file).read_bytes()
        registerFont(TTFont(name, BytesIO(data)))
    registerFontFamily(_REGULAR, normal=_REGULAR, bold=_BOLD, italic=_REGULAR, boldItalic=_BOLD)


def _styles() -> dict[str, Any]:
    from reportlab.lib.styles import ParagraphStyle

    _fonts()

    def style(name: str, size: float, **more: Any) -> Any:
        values = {"fontName": _REGULAR, "fontSize": size, "leading": 1.38 * size, "textColor": "#1F2329"}
        return ParagraphStyle(name, **values | more)

    styles = {
        "title": style("title", 21, fontName=_BOLD, leading=25),
        "facts": style("facts", 9.5, textColor=_QUIET, spaceAfter=4),
        "heading": style("heading", 13, fontName=_BOLD, spaceBefore=12, spaceAfter=4, keepWithNext=1),
        "plain": style("plain", 9.5, spaceAfter=5),
        "lead": style("lead", 14, leading=18.5, spaceAfter=6),
        "quiet": style("quiet", 8.5, textColor=_QUIET, spaceAfter=5),
        "caption": style("caption", 8, textColor=_QUIET, spaceBefore=2, spaceAfter=10),
    }
    for size, points in (("cell", 8.0), ("answer", 9.5)):
        for side, alignment in (("left", 0), ("right", 2)):
            for weight, font in (("", _REGULAR), ("-bold", _BOLD)):
                name = f"{size}-{side}{weight}"
                styles[name] = style(name, points, alignment=alignment, fontName=font)
    return styles


def _clean(text: str) -> str:
    return escape(_printable(text), quote=False)


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)
