"""Typeface and styles of the PDF report."""

from functools import cache
from html import escape
from importlib.resources import files
from io import BytesIO
from typing import Any

from reportlab.lib.styles import ParagraphStyle
from reportlab.pdfbase.pdfmetrics import registerFont, registerFontFamily
from reportlab.pdfbase.ttfonts import TTFont

REGULAR, BOLD = "jointid", "jointid-bold"
QUIET, RULE = "#565B63", "#C9CDD2"


@cache
def register_fonts() -> None:
    """Register the typeface with reportlab."""
    for name, file in ((REGULAR, "Roboto-Regular.ttf"), (BOLD, "Roboto-Bold.ttf")):
        data = files("font_roboto").joinpath("files", file).read_bytes()
        registerFont(TTFont(name, BytesIO(data)))
    registerFontFamily(REGULAR, normal=REGULAR, bold=BOLD, italic=REGULAR, boldItalic=BOLD)


def page_styles() -> dict[str, Any]:
    """Return the styles of paragraphs and cells by name."""
    register_fonts()

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


def clean(text: str) -> str:
    """Return text for a reportlab paragraph, its markup escaped."""
    return escape(printable(text), quote=False)


def printable(text: str) -> str:
    """Return text with a blank for each unprintable character."""
    return "".join(c if c.isprintable() else " " for c in text)
