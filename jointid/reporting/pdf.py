"""A report as PDF on A4 with embedded typeface; equal reports give equal bytes."""

from collections.abc import Callable
from io import BytesIO
from typing import Any

from jointid.errors import JointIdError
from jointid.reporting.blocks import Figure, Paragraph, Report, Table, Verdict
from jointid.reporting.html import LEVELS
from jointid.reporting.pdf_figure import figure_piece
from jointid.reporting.pdf_type import (
    BOLD,
    QUIET,
    REGULAR,
    RULE,
    clean,
    page_styles,
    printable,
    register_fonts,
)
from jointid.verdict.findings import Finding

_MARGIN = 56.7
"""20 mm in points."""
_HEADING_NEEDS = 140.0
"""Room for a heading and the beginning of its section, points; with less it moves to the next page."""
_SHARES = (1.0, 0.95, 0.9, 0.85, 0.8)
"""Heights to try for the figures, to avoid large gaps before them."""
_TRIALS = 0.6
"""Share of the time for the trials."""
_ALLOWED_GAP = 1 / 3
"""Empty share of a page that needs no smaller figures."""
_TOGETHER = 4
"""Fewest rows of a table on either side of a page break."""
_LEVEL_COLOURS = {"problem": "#B3261E", "warning": "#B26A00", "good": "#1B7F4D", "note": "#767676"}


def to_pdf(report: Report, *, progress: Callable[[float], object] | None = None) -> bytes:
    """Return a report as PDF.

    Parameters
    ----------
    report : Report
        As ``make_report`` wrote it. Letters outside Latin, Greek and Cyrillic show as boxes.
    progress : callable, optional
        Called with the share done. Its exceptions end the work.

    Raises
    ------
    JointIdError
        When reportlab is not installed.
    """
    try:
        import reportlab  # noqa: F401
    except ImportError as error:
        raise JointIdError(
            "A PDF needs the package reportlab, which is not installed: pip install jointid[pdf]. "
            "The HTML report needs nothing."
        ) from error
    tell = progress or (lambda share: None)
    shares = _SHARES if any(isinstance(b, Figure) for s in report.sections for b in s.blocks) else ()
    tried = []
    for k, share in enumerate(shares):
        tell(_TRIALS * k / len(shares))
        rooms, _ = _build(report, share, painted=False)
        # First few pages, then small gaps, then large figures.
        worst = max([_ALLOWED_GAP, *(round(room, 3) for room in rooms[:-1])])
        tried.append((len(rooms), worst, -share))
    share = -min(tried)[2] if tried else 1.0
    _, data = _build(report, share, progress=lambda done: tell(_TRIALS + (1 - _TRIALS) * done))
    return data


def _build(
    report: Report,
    share: float,
    *,
    painted: bool = True,
    progress: Callable[[float], object] | None = None,
) -> tuple[list[float], bytes]:
    """Build the report with lowered figures; return the empty share of each page, and the file."""
    from reportlab.lib.pagesizes import A4
    from reportlab.platypus import SimpleDocTemplate

    empty: list[float] = []

    class Document(SimpleDocTemplate):  # type: ignore[misc]
        """A document that records the empty share of each page."""

        def afterPage(self) -> None:
            empty.append(float(self.frame._y - self.frame._y1p) / self.height)

    def foot(canvas: Any, document: Any) -> None:
        canvas.saveState()
        canvas.setFont(REGULAR, 7.5)
        canvas.setFillColor(QUIET)
        canvas.drawString(_MARGIN, 32, printable(report.footer))
        canvas.drawRightString(A4[0] - _MARGIN, 32, f"page {document.page}")
        canvas.restoreState()

    file = BytesIO()
    document = Document(
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
        pageCompression=int(painted),
    )
    story = _story(report, A4[0] - 2 * _MARGIN, share, painted)
    if progress is not None:
        count = len(story)
        document.setProgressCallBack(
            lambda kind, value: progress(min(value / count, 1.0)) if kind == "PROGRESS" else None
        )
    document.build(story, onFirstPage=foot, onLaterPages=foot)
    return empty, file.getvalue()


def _story(report: Report, width: float, share: float, painted: bool) -> list[Any]:
    """The flowables of the report, in order."""
    from reportlab.platypus import CondPageBreak, KeepTogether

    styles = page_styles()
    story = [_set(report.title, styles["title"]), _set(report.facts, styles["facts"])]
    for section in report.sections:
        heading = [CondPageBreak(_HEADING_NEEDS), _set(section.title, styles["heading"])]
        for block in section.blocks:
            if isinstance(block, Figure):
                pieces, together = [figure_piece(block, styles, share, painted=painted)], False
            else:
                pieces, together = _block(block, styles, width)
            story += [KeepTogether([*heading, *pieces])] if together else [*heading, *pieces]
            heading = []
    return story


def _block(
    block: Paragraph | Table | Verdict, styles: dict[str, Any], width: float
) -> tuple[list[Any], bool]:
    """Flowables of a block, and whether they stay on one page."""
    if isinstance(block, Paragraph):
        return [_set(block.text, styles[block.kind])], False
    if isinstance(block, Table):
        return [_table(block, styles, width)], len(block.rows) < 2 * _TOGETHER
    assert isinstance(block, Verdict)
    return [_finding(finding, styles, width) for finding in block.findings], False


def _table(table: Table, styles: dict[str, Any], width: float) -> Any:
    """A table with the caption as its last row, which keeps it with the others over a page break."""
    from reportlab.platypus import Table as Grid

    answer = table.kind == "answer"
    size = "answer" if answer else "cell"
    sides = ["left" if side == "l" else "right" for side in table.sides]
    rows = []
    if table.header:
        bold = [styles[f"{size}-{side}-bold"] for side in sides]
        rows.append([_set(text, style) for text, style in zip(table.header, bold, strict=True)])
    usual = [
        styles[f"{size}-{side}" + ("-bold" if answer and k == 1 else "")] for k, side in enumerate(sides)
    ]
    for row in table.rows:
        rows.append([_set(text, style) for text, style in zip(row, usual, strict=True)])
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
    from reportlab.pdfbase.pdfmetrics import stringWidth

    if table.kind == "facts":
        return [110.0, width - 110.0]
    register_fonts()
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
    from reportlab.platypus import Paragraph as Set

    return Set(clean(text), style)


def _finding(finding: Finding, styles: dict[str, Any], width: float) -> Any:
    from reportlab.platypus import Paragraph as Set
    from reportlab.platypus import Table as Grid

    text = f"<b>{LEVELS[finding.level]}: {clean(finding.title)}.</b> {clean(finding.detail)}"
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
