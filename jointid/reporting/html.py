"""A report as one self-contained HTML file: no network, no script, figures as inline SVG."""

from __future__ import annotations

from html import escape

from jointid.reporting.blocks import Block, Figure, Paragraph, Report, Table, Verdict
from jointid.reporting.drawing import to_svg
from jointid.verdict.findings import Finding

_STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 Roboto, "Segoe UI", "Helvetica Neue", Arial, sans-serif;
  color: #1f2329; background: #fff; max-width: 48rem; margin: 0 auto; padding: 2rem 1.25rem 3rem; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .25rem; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .6rem; padding-bottom: .2rem;
  border-bottom: 1px solid #d5d8dc; }
p { margin: .6rem 0; }
.facts, .quiet, figcaption, footer { color: #565b63; }
.facts { margin: 0; }
.quiet, figcaption, footer { font-size: .875rem; }
.lead { font-size: 1.3rem; line-height: 1.35; margin: .4rem 0 .8rem; }
.scroll { overflow-x: auto; margin-bottom: .4rem; }
table { border-collapse: collapse; width: 100%; font-size: .875rem; font-variant-numeric: tabular-nums; }
th, td { padding: .28rem 0 .28rem .9rem; text-align: right; border-bottom: 1px solid #e6e8eb;
  vertical-align: top; }
th { font-weight: 600; border-bottom-color: #9aa0a8; }
th:first-child { padding-left: 0; min-width: 5.5rem; }
tbody th { font-weight: 400; border-bottom-color: #e6e8eb; }
.l { text-align: left; }
.answer { font-size: 1rem; }
.answer td:nth-child(2) { font-weight: 600; }
.names th { width: 10rem; color: #565b63; }
.names td { text-align: left; overflow-wrap: anywhere; }
figure { margin: 1.2rem 0; break-inside: avoid; }
.side { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fit, minmax(min(19rem, 100%), 1fr)); }
svg { display: block; width: 100%; height: auto; font-family: inherit; }
.finding { border-left: 4px solid; padding: .1rem 0 .1rem .8rem; margin: .8rem 0; break-inside: avoid; }
.finding p { margin: .15rem 0; }
.problem { border-color: #b3261e; } .warning { border-color: #b26a00; }
.good { border-color: #1b7f4d; } .note { border-color: #767676; }
footer { margin-top: 2.5rem; border-top: 1px solid #d5d8dc; padding-top: .6rem;
  overflow-wrap: anywhere; }
@media screen {
  td { white-space: nowrap; } .names td { white-space: normal; }
  /* A shadow at the edge behind which more of a table stands. */
  .scroll { background:
    linear-gradient(90deg, #fff 40%, #fff0) 0 / 2.5rem 100%,
    linear-gradient(-90deg, #fff 40%, #fff0) 100% / 2.5rem 100%,
    linear-gradient(90deg, #0003, #0000) 0 / .6rem 100%,
    linear-gradient(-90deg, #0003, #0000) 100% / .6rem 100%;
    background-attachment: local, local, scroll, scroll; background-repeat: no-repeat; }
}
@media screen and (max-width: 36rem) {
  body { padding: 1.25rem 1rem 2rem; }
  th:first-child { min-width: 6.5rem; }
  tbody th { position: sticky; left: 0; background: #fff; }
  .names th { width: 6.5rem; }
  .wide svg { min-width: 34rem; }
  .answer thead { position: absolute; clip-path: inset(50%); }
  .answer tr { display: grid; grid-template-columns: auto 1fr; column-gap: .5rem;
    padding: .4rem 0; border-bottom: 1px solid #e6e8eb; }
  .answer th, .answer td { border: 0; padding: .05rem 0; text-align: left; }
  .answer tbody th { grid-column: 1 / -1; color: #565b63; }
  .answer td:nth-child(n+4)::before { content: attr(data-label) " "; color: #565b63; }
}
@page { size: A4; margin: 18mm 20mm; }
@media print { body { font-size: 10.5pt; max-width: none; padding: 0; } h2 { break-after: avoid; }
  thead { display: table-header-group; } tr { break-inside: avoid; } }
"""
LEVELS = {"problem": "Problem", "warning": "Warning", "good": "Good", "note": "Note"}
"""A word for every level, beside its colour."""


def to_html(report: Report) -> str:
    """Return a report as a self-contained HTML document.

    Parameters
    ----------
    report : Report
        As ``make_report`` wrote it.
    """
    parts = [
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{_clean(report.title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n<main>\n"
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
        return f"<p{kind}>{_clean(block.text)}</p>\n"
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Figure):
        return _figure(block)
    assert isinstance(block, Verdict)
    return "".join(_finding(finding) for finding in block.findings)


def _table(table: Table) -> str:
    if table.kind == "facts":
        rows = "".join(
            f'<tr><th scope="row" class="l">{_clean(name)}</th><td>{_clean(value)}</td></tr>\n'
            for name, value in table.rows
        )
        return _captioned(f'<table class="names"><tbody>\n{rows}</tbody></table>', table)
    css = [' class="l"' if side == "l" else "" for side in table.sides]
    answer = table.kind == "answer"
    head = "".join(
        f'<th scope="col"{c}>{_clean(h)}</th>' for h, c in zip(table.header, css, strict=True)
    )
    body = []
    for row in table.rows:
        first = f'<th scope="row" class="l">{_clean(row[0])}</th>'
        labels = [f' data-label="{_clean(h)}"' if answer else "" for h in table.header[1:]]
        cells = zip(row[1:], css[1:], labels, strict=True)
        rest = (f"<td{c}{label}>{_clean(v)}</td>" for v, c, label in cells)
        body.append(f"<tr>{first}{''.join(rest)}</tr>\n")
    kind = ' class="answer"' if answer else ""
    return _captioned(
        f"<table{kind}><thead><tr>{head}</tr></thead>\n<tbody>\n{''.join(body)}</tbody></table>", table
    )


def _captioned(markup: str, table: Table) -> str:
    """A table that scrolls horizontally where it is too wide, with a fixed caption."""
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
    level = finding.level if finding.level in LEVELS else "note"
    remedy = f"<p><em>{_clean(finding.remedy)}</em></p>" if finding.remedy else ""
    return (
        f'<div class="finding {level}"><p><strong>{LEVELS[level]}: {_clean(finding.title)}.</strong> '
        f"{_clean(finding.detail)}</p>{remedy}</div>\n"
    )


def _clean(text: str) -> str:
    """Escaped text without control characters."""
    return escape("".join(c for c in text if c in "\n\t" or (c.isprintable() and c != "\ufeff")))
