"""jointid report."""

from pathlib import Path
from typing import Annotated

import typer

from jointid.cli.files import analysed, require_free
from jointid.cli.options import JSON, METHOD, OVERWRITE, STUDY, UNIT, require_ending
from jointid.cli.output import progress, written
from jointid.cli.program import reported
from jointid.files.atomic_write import write_file


@reported
def report(
    study: Annotated[Path, STUDY],
    output: Annotated[
        list[Path] | None, typer.Option("--output", "-o", help="Files, .html or .pdf.")
    ] = None,
    with_cut: Annotated[bool, typer.Option("--cut/--no-cut", help="Include the simulated cut.")] = True,
    method: Annotated[str, METHOD] = "auto",
    unit: Annotated[str, UNIT] = "",
    overwrite: Annotated[bool, OVERWRITE] = False,
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Write a report as one HTML file or as PDF."""
    files = output or [Path(f"{study.resolve().stem or 'study'}-report.html")]
    for file in files:
        require_ending("--output", file, ".html", ".htm", ".pdf")
        require_free(file, overwrite, [study])
    analysis = analysed(study, method, quiet=as_json)
    analysis = analysis.shown_in(unit) if unit else analysis
    from jointid.reporting.report import make_report, to_html, to_pdf

    with progress("Writing the report", quiet=as_json):
        made = make_report(analysis, cut=with_cut)
        for file in files:
            pdf = file.suffix.lower() == ".pdf"
            write_file(file, to_pdf(made) if pdf else to_html(made).encode())
    written(files, as_json)
