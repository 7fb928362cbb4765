"""jointid report and jointid export."""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from jointid import exporting
from jointid.analysis import Analysis, Answer
from jointid.cli.files import answer_file, require_new_output
from jointid.cli.options import JSON, METHOD, OVERWRITE, STUDY, UNIT, numbers, require_ending
from jointid.cli.output import print_written, progress, warn_if_unusable
from jointid.files.atomic_write import write_file


def report(
    study: Annotated[Path, STUDY],
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output", "-o", help="File, .html or .pdf; repeatable; default: STUDY-report.html."
        ),
    ] = None,
    with_cut: Annotated[bool, typer.Option("--cut/--no-cut", help="Include the simulated cut.")] = True,
    method: Annotated[str, METHOD] = "auto",
    unit: Annotated[str, UNIT] = "",
    overwrite: Annotated[bool, OVERWRITE] = False,
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Write a report as a single HTML file or as PDF."""
    files = output or [Path(f"{study.resolve().stem or 'study'}-report.html")]
    for file in files:
        require_ending("--output", file, ".html", ".htm", ".pdf")
        require_new_output(file, overwrite, [study])
    analysis = answer_file(study, method)
    analysis = analysis.shown_in(unit) if unit else analysis
    from jointid.reporting.report import make_report, to_html, to_pdf

    with progress("Writing the report"):
        made = make_report(analysis, cut=with_cut)
        for file in files:
            pdf = file.suffix.lower() == ".pdf"
            write_file(file, to_pdf(made) if pdf else to_html(made).encode())
    warn_if_unusable(analysis)
    print_written(files, as_json)


def _writers(gear_ratio: list[float] | None) -> dict[str, Callable[[Any], str | bytes]]:
    """Writer of a file by the ending of its name; those at the joint only with gear ratios.

    Code and the formats in ``_OF_ANSWERS`` take any answer, the others that of the motors.
    """
    from jointid.files.study_files import pack_study

    snippets = exporting.mujoco_snippet, exporting.urdf_snippet, exporting.sdf_snippet
    return {
        ".phasors.csv": exporting.phasor_table,
        ".H.csv": exporting.transfer_matrix_table,
        ".torsion.csv": exporting.torsion_table,
        ".gears.csv": exporting.gear_table,
        ".gears.txt": exporting.modelica_table,
        ".K.csv": exporting.answer_table,
        ".json": exporting.to_json,
        ".toml": exporting.to_toml,
        ".mat": exporting.to_mat,
        ".zip": lambda analysis: pack_study(analysis.study),
        **{e: partial(exporting.code_listing, language=name) for e, name in exporting.ENDINGS.items()},
        **{
            ending: partial(snippet, gear_ratio=gear_ratio or [])
            for ending, snippet in zip(_AT_JOINT, snippets, strict=True)
        },
    }


_OF_ANSWERS = (".K.csv", ".json", ".toml", ".zip")
_AT_JOINT = (".xml", ".urdf", ".sdf")


def export(
    study: Annotated[Path, STUDY],
    output: Annotated[
        list[Path],
        typer.Option(
            "--output",
            "-o",
            help="File; repeatable. Its ending selects the format: .json, .toml, .mat (results), "
            ".K.csv (K and D by joint), .phasors.csv, .H.csv (transfer matrix), .torsion.csv (torsion "
            "curves), .gears.csv (gear laws), .gears.txt (gear laws for Modelica), .st, .c, .m, .py (K "
            "and D as code), .zip (the study), .xml, .urdf, .sdf (joints for MuJoCo, URDF, SDFormat).",
        ),
    ],
    gear_ratio: Annotated[
        str,
        typer.Option(
            metavar="NUMBERS",
            help="Motor turns per joint turn, negative if they turn in opposite directions: 100,-90. "
            "Required for .xml, .urdf, .sdf unless the study states gear_ratio.",
        ),
    ] = "",
    arm_side: Annotated[
        bool | None,
        typer.Option(
            "--arm-side/--motors",
            help="K from sensors behind the gears, at the joint, or K and D from the motors; default: "
            "the motors, unless only the sensors give a usable answer.",
            show_default=False,
        ),
    ] = None,
    overwrite: Annotated[bool, OVERWRITE] = False,
    method: Annotated[str, METHOD] = "auto",
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Export results for other tools."""
    ratio = numbers(gear_ratio) if gear_ratio else None
    endings = {file: _ending(file) for file in output}
    for file in output:
        require_new_output(file, overwrite, [study])
    analysis: Answer = answer_file(study, method, arm_side=arm_side)
    known = analysis.study.gear_ratios
    ratio = ratio or (None if known is None else known.tolist())
    for file, ending in endings.items():
        if ending in _AT_JOINT and ratio is None:
            raise typer.BadParameter(f"{file.name} needs gear ratios, as in --gear-ratio 100,-90.")
    writers = _writers(ratio)
    hold = (*_OF_ANSWERS, *exporting.ENDINGS)
    if isinstance(motors := analysis.each.get("Motors"), Analysis):
        empty = {} if motors.transfer_matrices else {".H.csv": motors.transfer_problem}
        if not analysis.study.sine_records:
            empty[".phasors.csv"] = "the study has no sine records."
    else:
        reason = f"sensors behind the gears give K only. Formats that hold it: {', '.join(hold)}."
        empty = {ending: reason for ending in writers if ending not in hold}
    for file in [file for file, ending in endings.items() if ending in empty]:
        print(f"{file.name} is not written: {empty[endings.pop(file)]}", file=sys.stderr)
    for file, ending in endings.items():
        content = writers[ending](analysis if ending in hold else motors)
        write_file(file, content if isinstance(content, bytes) else content.encode())
    warn_if_unusable(analysis)
    print_written(list(endings), as_json)
    if not endings:
        raise typer.Exit(1)


def _ending(file: Path) -> str:
    endings = _writers(None)
    for ending in endings:
        if file.name.lower().endswith(ending.lower()):
            return ending
    raise typer.BadParameter(f"{file.name}: expected a name that ends in one of {', '.join(endings)}.")
