"""jointid convert."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import jointid.cli.options as options
from jointid.answer import UNSTATED_TORQUE_SCALE
from jointid.cli.files import require_new_output, robot_from
from jointid.cli.output import print_json, print_new_study, print_table, progress
from jointid.errors import JointIdError
from jointid.files.atomic_write import write_file
from jointid.wording import counted, significant


def convert(
    logs: Annotated[
        list[Path],
        typer.Argument(
            parser=options.named,
            help="Logs with the same columns: CSV, MDF, MATLAB, HDF5, ROS bags and others.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", parser=options.named, help="New study: a folder or a .zip."),
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(help="Mapping: the file of --guess, corrected.")
    ] = None,
    guess: Annotated[
        Path | None, typer.Option(help="Write the proposed mapping to this file and stop.")
    ] = None,
    list_runs: Annotated[
        Path | None,
        typer.Option(help="Write the runs found with --mapping to this file (.json) and stop."),
    ] = None,
    runs: Annotated[
        Path | None,
        typer.Option(
            help="Runs: the file of --list-runs, corrected; default: all runs found.", show_default=False
        ),
    ] = None,
    inertia: Annotated[
        Path | None,
        typer.Option(
            parser=options.named,
            help="TOML with M and M2 (motor side, kg·m²), or with [robot_model] and joint angles; or a "
            "study.",
        ),
    ] = None,
    robot_model: Annotated[
        Path | None,
        typer.Option(
            parser=options.named,
            help="Robot model, Denavit–Hartenberg .toml, .urdf or .xml (MJCF): gear ratios and, without "
            "--inertia, M and M2.",
        ),
    ] = None,
    angles_deg: Annotated[
        str,
        options.numbers_option(
            "With --robot-model: joint angles of the pose as logged, °; the model must have the same "
            "zero positions. Default: their mean in the logs."
        ),
    ] = "",
    pose: Annotated[
        list[str] | None,
        typer.Option(help="Name of a pose in the inertia file; give it once, or once per log."),
    ] = None,
    separate: Annotated[
        bool,
        typer.Option("--separate", help="Treat simultaneous logs as separate runs; do not join them."),
    ] = False,
    inertia_std: Annotated[float | None, options.INERTIA_STD] = None,
    torque_std: Annotated[float | None, options.TORQUE_STD] = None,
    nominal_K: Annotated[str, options.NOMINAL_K] = "",
    nominal_D: Annotated[str, options.NOMINAL_D] = "",
    name: Annotated[
        str, typer.Option(help="Name of the study; default: from the inertia file, else from the logs.")
    ] = "",
    which: Annotated[
        str, typer.Option("--robot", help="Name of the robot, for the table of jointid batch.")
    ] = "",
    date: Annotated[str, typer.Option(help="Date of the measurement, such as 2026-11-20.")] = "",
    note: Annotated[str, typer.Option(help="Remark shown with the answer.")] = "",
    overwrite: Annotated[bool, options.OVERWRITE] = False,
    as_json: Annotated[bool, options.JSON] = False,
) -> None:
    """Make a study from logs of sines or other motions.

    First write the proposed mapping (role, unit and scale of every column) with --guess and correct it;
    then convert with --mapping, --inertia and --output. Every run found becomes a record: to correct
    the runs, write them with --list-runs and convert with --runs.
    """
    if (guess is None) == (mapping is None):
        raise typer.BadParameter(
            "Give --guess FILE first, check the mapping in this file, then convert with --mapping FILE."
        )
    if guess is not None and (runs or list_runs):
        raise typer.BadParameter("--list-runs and --runs need a checked mapping: give --mapping.")
    if guess is not None:
        options.require_ending("--guess", guess, ".json")
        require_new_output(guess, overwrite, [*logs, inertia, robot_model])
    elif list_runs is not None:
        if runs is not None or output is not None:
            raise typer.BadParameter("--list-runs writes no study: leave out --runs and --output.")
        options.require_ending("--list-runs", list_runs, ".json")
        require_new_output(list_runs, overwrite, [*logs, mapping, inertia, robot_model])
    elif output is not None:
        require_new_output(output, overwrite, [*logs, mapping, runs, inertia, robot_model])
    from jointid import RobotModel, save_study
    from jointid.importing import mapping_from_json, read_log, study_from_logs
    from jointid.importing.map.simultaneous_logs import join_logs
    from jointid.importing.study import parse_date

    with progress("Reading"):
        chosen = mapping_from_json(mapping.read_bytes()) if mapping is not None else None
        tables, together = join_logs([read_log(log) for log in logs], chosen, separate=separate)
    read_as = [_as_read(table) for table in tables]
    for line in read_as:
        typer.echo(line, err=True)
    model = RobotModel.load(robot_model) if robot_model else None
    if guess is not None:
        _write_guess(tables[0], model, guess, as_json, read_as)
        return
    if chosen is not None and list_runs is not None:
        _write_runs(tables, chosen, list_runs, together)
        return
    if chosen is None or output is None or (inertia or robot_model) is None:
        raise typer.BadParameter(
            "A conversion needs --mapping, --output, and --inertia or --robot-model."
        )
    assumed, called = options.nominal(nominal_K, nominal_D), name or None
    changes = options.without_none(
        nominal=assumed, name=called, inertia_std=inertia_std, torque_std=torque_std
    )
    robot = None if inertia is None else robot_from(inertia)
    model = model or (robot.robot_model if robot else None)
    chosen = with_gears_of(model, chosen)
    poses: list[str | None] = list(pose) if pose else [None]
    if len(poses) not in (1, len(tables)):
        given = f"{len(poses)} times for {counted(len(tables), 'log')}"
        raise typer.BadParameter(f"--pose is given {given}: give it once, or once per log.")
    measured_on = parse_date(date)
    corrected = runs.read_bytes() if runs is not None else None
    with progress("Looking for sine runs") as report:
        mapped, segments, notes = found_runs(tables, chosen, corrected, report)
    poses = poses * len(mapped) if len(poses) == 1 else poses
    angles = options.numbers(angles_deg) if angles_deg else []
    robot = replace(robot_of(robot, model, angles, mapped), **changes)
    study = study_from_logs(mapped, segments, pose_of=poses, **vars(robot))
    notes = (*together, *notes)
    facts = robot_facts(chosen, tables[0])
    study = replace(study, robot=which.strip(), date=measured_on, note=note, **facts)
    save_study(study, output, overwrite=overwrite)
    print_new_study(study, output, as_json, notes=list(notes), read_as=read_as)
    if study.assumed:
        notes = (
            *notes,
            f'{study.remarks[-1]} Correct them in {mapping}, or confirm them ("assumed": []).',
        )
    for line in (*notes, *[UNSTATED_TORQUE_SCALE] * (study.torque_std is None)):
        typer.echo(line, err=True)


def _write_guess(table: Any, model: Any, guess: Path, as_json: bool, read_as: Sequence[str]) -> None:
    """Write the proposed mapping with the gear ratios of a model, and print the reason of each entry."""
    from jointid.importing import guess_mapping, mapping_to_json
    from jointid.importing.map.reasons import grouped, of_joints

    guessed = guess_mapping(table)
    mapping = with_gears_of(model, guessed.mapping)
    both = zip(guessed.mapping.joints, mapping.joints, strict=True)
    known = {f"gear ratio of joint {j}" for j, (a, b) in enumerate(both, start=1) if a != b}
    reasons = [
        replace(each, text="Taken from the robot model.", sure=True) if each.what in known else each
        for each in guessed.reasons
    ]
    text = mapping_to_json(mapping)
    write_file(guess, (text + "\n").encode())
    if as_json:
        entries = [asdict(reason) for reason in reasons]
        print_json({"mapping": json.loads(text), "reasons": entries, "read_as": list(read_as)})
        return
    rows = [
        [entry + of_joints(joints), "" if sure else "check", why]
        for (entry, why, sure), joints in grouped(reasons).items()
    ]
    print_table(["entry", "", "reason"], rows)
    for note in table.notes:
        typer.echo(f"{table.name}: {note}", err=True)
    print(
        f"\nWrote {guess}. Correct it, then run: jointid convert LOG --mapping {guess} --inertia "
        f"FILE --output STUDY (or --robot-model FILE)"
    )


def _write_runs(tables: Sequence[Any], mapping: Any, path: Path, together: Sequence[str]) -> None:
    """Write the runs that are found in logs, and print what is left out."""
    from jointid.importing import runs_to_json
    from jointid.importing.study import run_counts

    with progress("Looking for sine runs") as report:
        mapped, segments, notes = found_runs(tables, mapping, None, report)
    write_file(path, runs_to_json(mapped, segments).encode())
    count = run_counts([segment for part in segments for segment in part])
    print(f"{path}: {count}. Correct the file, then convert with --runs {path}.")
    for line in (*together, *notes):
        typer.echo(line, err=True)


def robot_of(robot: Any, model: Any, angles_deg: Sequence[float], logs: Sequence[Any]) -> Any:
    """Return the robot of an inertia file with its model, or that of the model at the logs' pose."""
    if robot is not None:
        return replace(robot, robot_model=model)
    from jointid.importing.robot_inertia import KnownRobot

    angles = np.deg2rad(angles_deg)
    if not angles.size:
        if logs[0].n != model.n:
            found = f"{counted(model.n, 'joint')}, but the logs have {logs[0].n}"
            raise JointIdError(f"{model.source[0]} has {found}: they must agree.")
        angles = np.mean(np.concatenate([log.theta_rad for log in logs]), axis=0) @ model.coupling.T
    return KnownRobot(model.inertia(angles), robot_model=model, pose_angles_rad={"": angles})


def with_gears_of(model: Any, mapping: Any) -> Any:
    """Return a mapping with the gear ratios of a robot model in place of those assumed to be 1."""
    if model is None or model.n != len(mapping.joints):
        return mapping
    joints = [
        replace(joint, gear_ratio=ratio)
        if f"gear ratio of joint {number}" in mapping.assumed and joint.gear_ratio == 1 and not coupled
        else joint
        for number, (joint, ratio, coupled) in enumerate(
            zip(mapping.joints, model.gear_ratio.tolist(), model.is_coupled, strict=True), start=1
        )
    ]
    return replace(mapping, joints=tuple(joints))


def robot_facts(mapping: Any, table: Any) -> dict[str, Any]:
    """Gear ratios that a mapping states, and its assumptions, without entries that were corrected."""
    from jointid.importing import guess_mapping
    from jointid.importing.map.reasons import assumptions, unchanged

    if mapping.assumed:
        mapping = replace(mapping, assumed=unchanged(mapping, guess_mapping(table).mapping))
    ratio = [joint.gear_ratio for joint in mapping.joints]
    known = any(r != 1 for r in ratio) and not any("gear ratio" in what for what in mapping.assumed)
    return {"assumed": assumptions(mapping), "gear_ratio": ratio if known else None}


def found_runs(
    tables: Sequence[Any], mapping: Any, given: bytes | None, report: Callable[[float], None]
) -> tuple[list[Any], list[Any], tuple[str, ...]]:
    """Return logs with the same columns, the runs of each, given or found, and notes."""
    from jointid.importing import apply_mapping, find_runs, runs_from_json

    logs = [apply_mapping(table, mapping) for table in tables]
    of_logs = tuple(f"{log.name}: {note}" for log in logs for note in log.notes)
    if given is not None:
        return logs, runs_from_json(given, logs), of_logs

    def found_in(k: int) -> Any:
        return find_runs(logs[k], progress=lambda share: report((k + share) / len(logs)))

    segments = [found_in(k) for k in range(len(logs))]
    unused = [
        f"{log.name}: {note}" for log, found in zip(logs, segments, strict=True) for note in found.notes
    ]
    without = [
        f"{log.name}: no steady sine run in {significant(log.time_s[-1] - log.time_s[0], 3)} s of log."
        for log, found in zip(logs, segments, strict=True)
        if not found
    ]
    if len(without) == len(logs):
        raise JointIdError(
            f"{' '.join([*without, *unused])} The method needs steady sines of a few periods, or "
            "several seconds of another motion. Check in the mapping which columns are position and "
            "torque, and the unit of time; a run can also be marked by its start and stop, with --runs "
            "or on the page Import a log of the app."
        )
    return logs, segments, (*without, *of_logs, *unused)


def _as_read(table: Any) -> str:
    size = f"{counted(table.rows, 'row')} of {counted(len(table.columns), 'column')}"
    return f"{table.name}: read as {table.read_as}, {size}."
