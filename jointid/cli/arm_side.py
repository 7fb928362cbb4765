"""jointid arm-side."""

from pathlib import Path
from typing import Annotated

import typer

from jointid.cli.files import loaded
from jointid.cli.options import JSON, STUDY, named
from jointid.cli.output import print_json, print_table, progress
from jointid.cli.program import reported


@reported
def arm_side(
    study: Annotated[Path, STUDY],
    robot: Annotated[
        Path | None,
        typer.Option(
            parser=named,
            help="Robot as .urdf, .xml (MJCF) or .toml (Denavit-Hartenberg).",
            show_default="the study's [robot_model]",
        ),
    ] = None,
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Identify K of the joints with sensors behind their gears."""
    from jointid.analysis import analyse_arm_side
    from jointid.robot_models.model import RobotModel

    model = None if robot is None else RobotModel.load(robot)
    with progress("Evaluating the sensors", quiet=as_json):
        fit = analyse_arm_side(loaded(study), model)
    if as_json:
        names = ("K", "standard_error", "skew_s", "skew_error_s", "residual_rad")
        values = {name: getattr(fit, name).tolist() for name in names}
        print_json(values | {"reasons": [*fit.reasons]})
        return
    table = fit.table
    print_table([*table], [list(row) for row in zip(*table.values(), strict=True)], right=(1, 2))
