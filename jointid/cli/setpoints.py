"""jointid setpoints."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from jointid.cli.files import require_free
from jointid.cli.options import JSON, METHOD, OVERWRITE, STUDY, named, numbers
from jointid.cli.output import print_json, print_table, progress
from jointid.cli.plan import (
    COUNT,
    DURATION,
    FROM_HZ,
    MOTION,
    POSITION_LIMIT,
    TO_HZ,
    TORQUE_LIMIT,
    VELOCITY_LIMIT,
    planned,
)
from jointid.cli.program import reported
from jointid.files.atomic_write import write_file


@reported
def setpoints(
    study: Annotated[Path, STUDY],
    limits: Annotated[
        Path, typer.Option(parser=named, help="TOML with limits, gear ratios and start pose.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", parser=named, help="File of set points.")],
    file_format: Annotated[
        str, typer.Option("--format", help="csv, ros2 (JointTrajectory), ur, egm or rsi.")
    ] = "csv",
    kind: Annotated[
        str, typer.Option(help="Form of the planned sines: sines, multisine or sweep.")
    ] = "sines",
    interval_ms: Annotated[
        float | None, typer.Option(help="Time between set points; default: the format's.")
    ] = None,
    scale: Annotated[float, typer.Option(help="Factor on all amplitudes.")] = 1.0,
    repeats: Annotated[int, typer.Option(help="Number of passes through all records.")] = 1,
    ramp_s: Annotated[float, typer.Option(help="Length of the ramps, s.")] = 0.5,
    rest_s: Annotated[float, typer.Option(help="Rest between records, s.")] = 1.0,
    superposed: Annotated[
        str,
        typer.Option(
            help="Superposed velocities of the joints, °/s; each record then runs forward and back."
        ),
    ] = "0",
    count: Annotated[int, COUNT] = 3,
    duration_s: Annotated[float, DURATION] = 4.0,
    torque_limit: Annotated[str, TORQUE_LIMIT] = "",
    velocity_limit: Annotated[str, VELOCITY_LIMIT] = "",
    motion: Annotated[str, MOTION] = "",
    position_limit: Annotated[str, POSITION_LIMIT] = "",
    from_hz: Annotated[float, FROM_HZ] = 2.0,
    to_hz: Annotated[float, TO_HZ] = 40.0,
    method: Annotated[str, METHOD] = "auto",
    overwrite: Annotated[bool, OVERWRITE] = False,
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Write the suggested records as set points, after a check on the simulated robot."""
    from jointid.setpoints.files import set_points
    from jointid.setpoints.from_plan import planned_experiment
    from jointid.setpoints.limit_check import check_table
    from jointid.setpoints.played import play
    from jointid.setpoints.robot_limits import limits_from_toml

    require_free(output, overwrite, [study, limits])
    with limits.open("rb") as file:
        robot = limits_from_toml(file.read(1 << 21), limits.name)
    texts = position_limit, velocity_limit, torque_limit
    shape = (motion, from_hz, to_hz) if motion else None
    analysis, found = planned(study, method, count, duration_s, texts, shape, quiet=as_json)
    analysis.require_usable()
    fit = analysis.fit
    with progress("Running on the simulated robot", quiet=as_json):
        experiment = planned_experiment(
            found if motion else found.records,
            fit.inertias[0],
            fit.elasticity,
            kind=kind,
            repeats=repeats,
            ramp_s=ramp_s,
            rest_s=rest_s,
            velocity_rad_s=robot.motor_velocity(numbers(superposed)),
            scale=scale,
        )
        points = set_points(
            play(experiment, fit.inertias[0], fit.elasticity, friction=fit.friction),
            robot,
            file_format,
            interval_ms=interval_ms,
            study=analysis.study.name,
        )
    write_file(output, points.text().encode())
    if as_json:
        check = [{**asdict(row), "margin": row.margin} for row in points.rows]
        print_json({"written": [str(output)], "duration_s": experiment.duration_s, "check": check})
        return
    columns = check_table(points.rows)
    print_table(
        list(columns), [list(row) for row in zip(*columns.values(), strict=True)], right=(2, 3, 4)
    )
    print(f"{output}: {output.stat().st_size} bytes. Not run on hardware: read its header first.")
