"""jointid report and jointid export."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jointid import exporting
from jointid.analysis import Analysis
from jointid.cli.files import analysed, require_free
from jointid.cli.options import JSON, METHOD, OVERWRITE, STUDY, UNIT, numbers, require_ending
from jointid.cli.output import progress, warn_if_unusable, written
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


if TYPE_CHECKING:
    from jointid.exporting import Identification

_CONTENTS: dict[str, Callable[[Analysis, Identification, list[float]], str | bytes]] = {
    ".phasors.csv": lambda analysis, *_: exporting.phasor_table(analysis),
    ".h.csv": lambda analysis, *_: exporting.transfer_matrix_table(analysis),
    ".torsion.csv": lambda analysis, *_: exporting.torsion_table(analysis),
    ".gears.csv": lambda _, found, __: exporting.gear_table(found),
    ".gears.txt": lambda _, found, __: exporting.modelica_table(found),
    ".json": lambda _, found, __: exporting.to_json(found),
    ".toml": lambda _, found, __: exporting.to_toml(found),
    ".mat": lambda analysis, *_: exporting.to_mat(analysis),
    ".zip": lambda analysis, *_: _packed(analysis),
    ".st": lambda _, found, __: exporting.code_listing(found, "Structured Text"),
    ".c": lambda _, found, __: exporting.code_listing(found, "C"),
    ".m": lambda _, found, __: exporting.code_listing(found, "MATLAB"),
    ".py": lambda _, found, __: exporting.code_listing(found, "Python"),
    ".xml": lambda _, found, ratio: exporting.mujoco_snippet(found, ratio),
    ".urdf": lambda _, found, ratio: exporting.urdf_snippet(found, ratio),
    ".sdf": lambda _, found, ratio: exporting.sdf_snippet(found, ratio),
}
"""Contents of a file, by the ending of its name."""


@reported
def export(
    study: Annotated[Path, STUDY],
    output: Annotated[
        list[Path],
        typer.Option(
            "--output",
            "-o",
            help="Files; the ending selects the format: .json, .toml (identification), .mat (MATLAB), "
            ".phasors.csv, .H.csv (transfer matrix), .torsion.csv (torsion curves), .gears.csv (gear "
            "laws), .gears.txt (the same for Modelica), .st, .c, .m, .py (K and D as code), .zip (the "
            "study), .xml (MuJoCo), .urdf, .sdf.",
        ),
    ],
    gear_ratio: Annotated[
        str,
        typer.Option(
            help="Motor turns per joint turn, for .xml, .urdf and .sdf; by default the study's."
        ),
    ] = "",
    overwrite: Annotated[bool, OVERWRITE] = False,
    method: Annotated[str, METHOD] = "auto",
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Export results for other tools."""
    ratio = numbers(gear_ratio) if gear_ratio else None
    for file in output:
        _ending(file)
        require_free(file, overwrite, [study])
    analysis = analysed(study, method, quiet=as_json)
    known = analysis.study.gear_ratios
    ratio = ratio or (None if known is None else known.tolist())
    for file in output:
        if _ending(file) in (".xml", ".urdf", ".sdf") and ratio is None:
            raise typer.BadParameter(f"{file.name} has joint-side values: give --gear-ratio 100,90")
    result = exporting.identification(analysis)
    for file in output:
        content = _CONTENTS[_ending(file)](analysis, result, ratio or [])
        write_file(file, content if isinstance(content, bytes) else content.encode())
    warn_if_unusable(analysis)
    written(output, as_json)


def _ending(file: Path) -> str:
    for ending in _CONTENTS:
        if file.name.lower().endswith(ending):
            return ending
    shown = ", ".join(".H.csv" if ending == ".h.csv" else ending for ending in _CONTENTS)
    raise typer.BadParameter(f"{file.name}: expected a name that ends in one of {shown}.")


def _packed(analysis: Analysis) -> bytes:
    from jointid.files.study_files import pack_study  # slow to import

    return pack_study(analysis.study)
