"""jointid cut."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from jointid.cli.files import analyse_file, require_new_output
from jointid.cli.options import JSON, METHOD, OVERWRITE, named, numbers, numbers_option, require_ending
from jointid.cli.output import print_json, print_table, progress
from jointid.files.atomic_write import write_file
from jointid.wording import enumerated


def cut(
    study: Annotated[
        Path | None,
        typer.Argument(
            parser=named, help="Study or sample; default: the paper's K and D on the example arm."
        ),
    ] = None,
    zones_mm: Annotated[
        str,
        numbers_option("Corner zones: distances from a corner within which the tool rounds it, mm."),
    ] = "1,5,10",
    assumed: Annotated[
        str,
        typer.Option(
            help="K that the servo assumes before the identification: study (its nominal K), rigid "
            "(no compensation), soft (0.4 K) or stiff (3 K). Default: study; rigid for a study without "
            "nominal K; soft without STUDY."
        ),
    ] = "",
    drive: Annotated[
        str, typer.Option(help="Drive of the arm: parallelogram or serial; default: as in the study.")
    ] = "",
    svg: Annotated[Path | None, typer.Option(help="Also draw the paths to this file, .svg.")] = None,
    method: Annotated[str, METHOD] = "auto",
    overwrite: Annotated[bool, OVERWRITE] = False,
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Simulate a cut with nominal and with identified K and D.

    The tool follows a rectangle; the table shows its largest path error before and after the
    identification. For a robot model of three or more axes, it shows the deflection of the
    tool along the path.
    """
    from jointid.cut.outcome import millimetres, remaining_error_text, robot_text
    from jointid.cut.path_deflection import has_own_path
    from jointid.cut.robot import DEMONSTRATION, NOMINAL_NAMES, cut_robot, demonstration

    zones = numbers(zones_mm)
    if not all(0 <= zone < math.inf for zone in zones):
        raise typer.BadParameter(f"--zones-mm {zones_mm}: expected lengths of 0 or more.")
    if drive not in ("", "parallelogram", "serial"):
        raise typer.BadParameter(f'--drive "{drive}": expected parallelogram or serial.')
    if assumed not in ("", "study", "rigid", "soft", "stiff"):
        raise typer.BadParameter(f'--assumed "{assumed}": expected study, rigid, soft or stiff.')
    if svg is not None:
        require_ending("--svg", svg, ".svg")
        require_new_output(svg, overwrite, [study])
    if study is None:
        robot = demonstration(drive or "parallelogram")  # type: ignore[arg-type]
    else:
        analysis = analyse_file(study, method)
        robot = cut_robot(analysis, drive or None)  # type: ignore[arg-type]
        if svg is None and has_own_path(analysis):
            _print_own_path(analysis, zones, as_json)
            return
    own = "study" if robot.nominal else "soft" if study is None else "rigid"
    choice: Any = assumed or own
    with progress("Simulating the cut") as tell:
        document, outcomes = cut_results(robot, choice, zones, tell)
    document["assumption"] = choice
    document["meaning"] = DEMONSTRATION if study is None else robot.meaning
    if svg is not None:
        from jointid.reporting.drawing import to_svg
        from jointid.reporting.figures import cut_figure

        pairs = zip(zones, outcomes, strict=True)
        figure = cut_figure(
            (f"Before: {NOMINAL_NAMES[choice]}", "After: identified"),
            {f"corner zone {zone:g} mm": (o.before, o.after) for zone, o in pairs},
        )
        write_file(svg, to_svg(figure, title=f"Cuts of {study or 'the paper'}").encode())
    if as_json:
        print_json(document)
        return
    before = "assumes rigid joints"
    if choice != "rigid":
        before = f"assumes {'the nominal K and D' if choice == 'study' else NOMINAL_NAMES[choice]}"
    print(f"Largest simulated path error of {robot_text(robot)}. Before: the servo {before}.")
    print(f"{document['meaning']}\n")
    columns = ["corner zone", "before", "after (95th percentile)"]
    cells = [
        [f"{zone:g} mm", millimetres(o.before_m), millimetres(o.after_m)]
        for zone, o in zip(zones, outcomes, strict=True)
    ]
    if robot.gears:
        columns.append("compensation uses the gear laws (identified K, D)")
        for row, cut in zip(cells, document["cuts"], strict=True):
            row.append(millimetres(1e-3 * cut["gears_known_mm"]))
    print_table(columns, cells, right=tuple(range(len(columns))))
    for problem in dict.fromkeys(o.problem for o in outcomes if o.problem):
        print(f"\nThe path error after the identification cannot be computed: {problem}")
    if worse := [f"{zone:g} mm" for zone, o in zip(zones, outcomes, strict=True) if o.not_better]:
        print(f"Corner zone {enumerated(worse)}: {next(o.not_better for o in outcomes if o.not_better)}")
    if not (largest := outcomes[-1]).depends_on_elasticity:
        print(remaining_error_text(largest, friction=robot.friction))


def _print_own_path(analysis: Any, zones_mm: Sequence[float], as_json: bool) -> None:
    """Print the deflection of the study's own robot along the path."""
    from jointid.cut.path_deflection import (
        COLUMNS,
        COLUMNS_MEANING,
        meaning,
        own_path_deflections,
        rows_of,
    )

    found = own_path_deflections(analysis, [1e-3 * zone for zone in zones_mm])
    if as_json:
        cuts = [
            {"zone_mm": zone}
            | {f"{name}m": (value := getattr(each, name)) and 1e3 * value for name in COLUMNS}
            for zone, each in zip(zones_mm, found, strict=True)
        ]
        print_json({"rule": "own robot", "meaning": meaning(analysis), "cuts": cuts})
        return
    print(f"Largest deflection of the tool along the path\n{meaning(analysis)} {COLUMNS_MEANING}\n")
    header, rows = rows_of(zones_mm, found)
    print_table(header, rows, right=tuple(range(len(header))))


def cut_results(
    robot: Any, assumption: str, zones_mm: Sequence[float], progress: Callable[[float], None]
) -> tuple[dict[str, Any], list[Any]]:
    """Simulate the paper's rectangle with several corner zones: path errors in mm, and the outcomes."""
    from jointid.cut.outcome import cut_outcome, cut_with_laws
    from jointid.cut.rectangle import rectangle
    from jointid.cut.robot import CUTTING_POINT_M, assumed_elasticity

    assumed = assumed_elasticity(robot, assumption)  # type: ignore[arg-type]  # checked there
    rows, outcomes = [], []
    for k, zone in enumerate(zones_mm):
        path = rectangle(zone_m=1e-3 * zone, centre_m=CUTTING_POINT_M)
        outcome = cut_outcome(robot, path, assumed, friction=robot.friction)
        outcomes.append(outcome)
        rows.append(
            {
                "zone_mm": zone,
                "before_mm": 1e3 * outcome.before_m,
                "after_mm": 1e3 * outcome.after_m,
                "before_tracking_mm": 1e3 * outcome.before.max_tracking_error_m,
                "after_tracking_mm": 1e3 * outcome.after.max_tracking_error_m,
                "problem": outcome.problem,
            }
        )
        if robot.gears:
            known = cut_with_laws(robot, path, friction=robot.friction)
            rows[-1]["gears_known_mm"] = 1e3 * known.max_contour_error_m
        progress((k + 1) / len(zones_mm))
    document = {
        "rule": robot.rule,
        "drive": robot.arm.drive,
        "K": robot.elasticity.K.tolist(),
        "D": robot.elasticity.D.tolist(),
        "assumed": None if assumed is None else {"K": assumed.K.tolist(), "D": assumed.D.tolist()},
        "cuts": rows,
    }
    return document, outcomes
