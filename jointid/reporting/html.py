"""A report as one self-contained HTML file: no network, no script, figures as inline SVG."""

from html import escape
from pathlib import Path

from jointid.reporting.blocks import Block, Figure, Paragraph, Report, Table, Verdict
from jointid.reporting.drawing import to_svg
from jointid.verdict.findings import Finding
from jointid.wording import unbroken

_STYLE = Path(__file__).with_name("report.css").read_text("utf-8")


def to_html(report: Report) -> str:
    """Return a report, as ``make_report`` wrote it, as a self-contained HTML document."""
    parts = [
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{_clean(report.title)}</title>\n<style>\n{_STYLE}</style>\n</head>\n<body>\n<main>\n"
        f'<h1>{_clean(report.title)}</h1>\n<p class="facts">{_clean(report.facts)}</p>\n'
    ]
    for section in report.sections:
        parts.append(f"<section>\n<h2>{_clean(section.title)}</h2>\n")
        parts += [_block(block) for block in section.blocks]
        parts.append("</section>\n")
    parts.append(f"</main>\n<footer>{_clean(report.footer)}</footer>\n</body>\n</html>\n")
    return "".join(parts)


def _block(block: Block) -> str:
    if isinstance(block, Paragraph):
        kind = f' class="{block.kind}"' if block.kind != "plain" else ""
        text = _clean(block.text)
        return f"<p{kind}>{unbroken(text) if block.kind == 'lead' else text}</p>\n"
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Figure):
        return _figure(block)
    assert isinstance(block, Verdict)
    return "".join(_finding(finding) for finding in block.findings)


def _table(table: Table) -> str:
    """A table that scrolls horizontally where it is too wide, with a fixed caption."""
    css = [' class="l"' if side == "l" else "" for side in table.sides]
    columns = zip(table.header, css, strict=bool(table.header))
    head = "".join(f'<th scope="col"{c}>{_clean(h)}</th>' for h, c in columns)
    labels = [""] * len(css)
    if table.kind == "answer":
        unlabelled = "", "identified", "unit"  # a value with its unit explains itself
        labels = ["" if h in unlabelled else f' data-label="{_clean(h)}"' for h in table.header]
    body = ""
    for row in table.rows:
        cells = zip(row[1:], css[1:], labels[1:], strict=True)
        rest = "".join(f"<td{c}{label}>{_clean(v)}</td>" for v, c, label in cells)
        body += f'<tr><th scope="row" class="l"{labels[0]}>{_clean(row[0])}</th>{rest}</tr>\n'
    head = f"<thead><tr>{head}</tr></thead>\n" if head else ""
    kind = {"answer": ' class="answer"', "facts": ' class="names"'}.get(table.kind, "")
    markup = f"<table{kind}>{head}<tbody>\n{body}</tbody></table>"
    name = _clean((table.caption or " ".join(table.header) or "Facts").partition(". ")[0])
    caption = f"<figcaption>{_clean(table.caption)}</figcaption>" if table.caption else ""
    return (
        f'<figure><div class="scroll" tabindex="0" role="group" aria-label="{name}">{markup}</div>\n'
        f"{caption}</figure>\n"
    )


def _figure(figure: Figure) -> str:
    pictures = "".join(f"<div>{to_svg(drawing)}</div>" for drawing in figure.drawings)
    opening = '<div class="side">'
    if len(figure.drawings) == 1:  # of full width: on a phone it scrolls instead of shrinking
        name = _clean(figure.caption.partition(". ")[0])
        opening = f'<div class="side scroll wide" tabindex="0" role="group" aria-label="{name}">'
    return (
        f"<figure>{opening}{pictures}</div>\n"
        f"<figcaption>{_clean(figure.caption)}</figcaption></figure>\n"
    )


def _finding(finding: Finding) -> str:
    remedy = f"<p><em>{_clean(finding.remedy)}</em></p>" if finding.remedy else ""
    return (
        f'<div class="finding {finding.level}"><p><strong>{finding.level.capitalize()}: '
        f"{_clean(finding.title)}.</strong> {_clean(finding.detail)}</p>{remedy}</div>\n"
    )


def _clean(text: str) -> str:
    """Escaped text without control characters."""
    return escape("".join(c for c in text if c in "\n\t" or (c.isprintable() and c != "\ufeff")))
