"""jointid export."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jointid.cli.files import analysed, require_spared
from jointid.cli.options import JSON, METHOD, OVERWRITE, STUDY, numbers
from jointid.cli.output import written
from jointid.cli.program import reported
from jointid.files.atomic_write import write_file
from jointid.study import NOT_USABLE, Analysis

if TYPE_CHECKING:
    from jointid.exporting import Identification

_ENDINGS = (".phasors.csv", ".h.csv", ".json", ".toml", ".mat", ".zip", ".xml", ".urdf", ".sdf")


@reported
def export(
    study: Annotated[Path, STUDY],
    output: Annotated[
        list[Path],
        typer.Option(
            "--output",
            "-o",
            help="Files; the ending selects the format: .json, .toml (identification), .mat, "
            ".phasors.csv, .H.csv, .zip (the study), .xml (MuJoCo), .urdf, .sdf.",
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
        require_spared(file, overwrite, [study])
    analysis = analysed(study, method, quiet=as_json)
    known = analysis.study.gear_ratios
    ratio = ratio or (None if known is None else known.tolist())
    for file in output:
        if _ending(file) in (".xml", ".urdf", ".sdf") and ratio is None:
            raise typer.BadParameter(f"{file.name} has joint-side values: give --gear-ratio 100,90")
    from jointid.exporting import identification

    result = identification(analysis)
    for file in output:
        write_file(file, _exported(_ending(file), analysis, result, ratio))
    if analysis.state == NOT_USABLE:
        typer.echo(f"{analysis.headline} See jointid identify.", err=True)
    written(output, as_json)


def _ending(file: Path) -> str:
    for ending in _ENDINGS:
        if file.name.lower().endswith(ending):
            return ending
    shown = ", ".join(".H.csv" if ending == ".h.csv" else ending for ending in _ENDINGS)
    raise typer.BadParameter(f"{file.name}: expected a name that ends in one of {shown}.")


def _exported(
    ending: str, analysis: Analysis, result: Identification, ratio: list[float] | None
) -> bytes:
    from jointid import exporting
    from jointid.files.study_files import pack_study

    contents: dict[str, Callable[[], str | bytes]] = {
        ".mat": lambda: exporting.to_mat(analysis),
        ".zip": lambda: pack_study(analysis.study),
        ".phasors.csv": lambda: exporting.phasor_table(analysis),
        ".h.csv": lambda: exporting.transfer_matrix_table(analysis),
        ".json": lambda: exporting.to_json(result),
        ".toml": lambda: exporting.to_toml(result),
        ".xml": lambda: exporting.mujoco_snippet(result, ratio or []),
        ".urdf": lambda: exporting.urdf_snippet(result, ratio or []),
        ".sdf": lambda: exporting.sdf_snippet(result, ratio or []),
    }
    content = contents[ending]()
    return content if isinstance(content, bytes) else content.encode()
