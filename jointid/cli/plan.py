"""jointid plan and jointid setpoints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from jointid.analysis import NOT_USABLE, Analysis, analyse
from jointid.arrays import per_joint
from jointid.cli.files import load_named, read_toml, require_new_output, warn_of_sensors
from jointid.cli.options import JSON, METHOD, OVERWRITE, STUDY, named, numbers, numbers_option
from jointid.cli.output import print_columns, print_json, print_table, progress, warn_if_unusable
from jointid.errors import JointIdError
from jointid.files.atomic_write import write_file
from jointid.simulation.motion import Motion
from jointid.wording import counted, percent

if TYPE_CHECKING:
    from jointid.uncertainty.motion_plan import PlannedMotion
    from jointid.uncertainty.plan import Suggestion

COUNT = typer.Option(min=1, max=50, help="Number of records.")
DURATION = typer.Option(help="Length of each record, s.")
TORQUE_LIMIT = numbers_option(
    "Largest motor torques, friction included, N·m; default: the largest in the study."
)
VELOCITY_LIMIT = numbers_option(
    "Largest velocities of motors and arm, motor side, rad/s; with --motion, of the motors only; "
    "default: the largest in the study."
)
MOTION = typer.Option(
    help="Motion in place of sines: sweep, multisine, random (band-limited) or moves (point to point)."
)
POSITION_LIMIT = numbers_option(
    "With --motion: largest motor positions, ± rad; default: the largest in the study."
)
FROM_HZ = typer.Option(help="With --motion: lowest frequency, Hz.")
TO_HZ = typer.Option(
    help="Highest frequency, Hz; default: 40 with --motion, else a quarter of the study's sample rate; "
    "less if the interval of set points requires it."
)
_MOTION_TO_HZ = 40.0


def plan(
    study: Annotated[Path, STUDY],
    count: Annotated[int, COUNT] = 3,
    duration_s: Annotated[float, DURATION] = 4.0,
    torque_limit: Annotated[str, TORQUE_LIMIT] = "",
    velocity_limit: Annotated[str, VELOCITY_LIMIT] = "",
    motion: Annotated[str, MOTION] = "",
    position_limit: Annotated[str, POSITION_LIMIT] = "",
    from_hz: Annotated[float, FROM_HZ] = 2.0,
    to_hz: Annotated[float | None, TO_HZ] = None,
    method: Annotated[str, METHOD] = "auto",
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Suggest the records that reduce the errors of K and D most.

    The table shows the relative standard errors now and after each record. NUMBERS: one value
    for all joints, or one per joint, separated by commas: 2.5,2.8.
    """
    limits = position_limit, velocity_limit, torque_limit
    band = from_hz, to_hz
    analysis, found = planned(study, method, count, duration_s, limits, motion, band)
    warn_if_unusable(analysis)
    if motion:
        _print_motion(analysis, found, as_json)
        return
    from jointid.uncertainty.validation import second_amplitude

    advice = {
        "limit": analysis.limit_of_records(found.worst),
        "second_amplitude": second_amplitude(analysis.fit),
    }
    document = _document(found) | advice
    if as_json:
        print_json(document)
        return
    from jointid.uncertainty.planned_records import phasor_text

    usable = analysis.state != NOT_USABLE
    names = document["parameters"] if usable else []
    rows = [["now", "", "", *map(percent, document["relative_error_today"])]] if usable else []
    for k, record in enumerate(document["records"], start=1):
        torques = ", ".join(map(phasor_text, found.records.relative[0][k - 1].tolist()))
        errors = map(percent, record["relative_error_after"] if usable else [])
        rows.append([f"record {k}", f"{record['frequency_hz']:.3g}", torques, *errors])
    if usable:
        print("Suggested records, and the relative standard errors after each\n")
    else:
        print(
            "Suggested records, predicted with K and D that are not usable: correct the study before "
            "you measure\n"
        )
    print_table(["", "Hz", "torques (N·m)", *names], rows, right=(1, *range(3, 3 + len(names))))
    for text in filter(None, advice.values()):
        print(f"\n{text}")


def planned(
    path: Path,
    method: str,
    count: int,
    duration_s: float,
    limits: Sequence[str],
    motion: str,
    band_hz: tuple[float, float | None],
    *,
    most_hz: float = np.inf,
    usable: bool = False,
) -> tuple[Analysis, Any]:
    """Read a study, fit it, and plan sines (Suggestion) or another motion (PlannedMotion).

    ``limits`` are the texts of position, velocity and torque; ``motion`` is the kind of motion, empty
    for sines. ``band_hz`` is its band, the upper end of sines, too: None is the default, at most
    ``most_hz``. With ``usable``, an answer that is not usable is refused.
    """
    from jointid.uncertainty.motion_plan import MotionLimits, largest_motion, plan_motion
    from jointid.uncertainty.plan import highest_logged_hz, suggest_records

    position, velocity, torque = (numbers(text) if text else None for text in limits)
    known = load_named(path)
    if not motion and known.motion_records:
        raise JointIdError(
            "Sines can be planned only for a study without motion records, and this one has some: "
            "add --motion sweep to plan a motion."
        )
    with progress("Planning"):
        analysis = analyse(known, method=method)
        warn_of_sensors(analysis)
        if usable:
            analysis.require_usable()
        from_hz, to_hz = band_hz
        if not motion:
            highest = most_hz if to_hz is None else min(to_hz, most_hz)
            return analysis, suggest_records(
                analysis.phasors,
                known.inertias,
                analysis.fit,
                count=count,
                duration_s=duration_s,
                torque_limit_Nm=torque,
                velocity_limit_rad_s=velocity,
                highest_hz=min(highest, highest_logged_hz(known.records, analysis.phasors)),
            )
        to_hz = min(_MOTION_TO_HZ, most_hz) if to_hz is None else to_hz
        shape = Motion(motion, from_hz, to_hz, duration_s, odd=motion == "multisine")
        options = {"--position-limit": position, "--velocity-limit": velocity, "--torque-limit": torque}
        pairs = zip(vars(largest_motion(known.records)).values(), options.items(), strict=True)
        n = known.inertia.n
        chosen = MotionLimits(
            *(own if given is None else per_joint(name, given, n) for own, (name, given) in pairs)
        )
        interval, inertia = known.records[0].interval_s, known.inertias[0]
        return analysis, plan_motion(
            analysis.fit, inertia, shape, chosen, interval_s=interval, records=count
        )


def _print_motion(analysis: Analysis, found: PlannedMotion, as_json: bool) -> None:
    from jointid.uncertainty.motion_plan import largest_motion

    fit, reached = analysis.fit, largest_motion(found.records)
    if as_json:
        print_json(
            {
                "motion": found.motion.kind,
                "duration_s": found.duration_s,
                "parameters": list(found.names),
                "relative_error_alone": found.alone.tolist(),
                "relative_error_together": found.together.tolist(),
                "peak_torque_Nm": reached.torque_Nm.tolist(),
                "peak_velocity_rad_s": reached.velocity_rad_s.tolist(),
            }
        )
        return
    count, seconds = len(found.records), found.duration_s
    total = f"{counted(count, 'record')}, {seconds:.4g} s in all"
    print(f"{found.motion.kind}, {total}: relative standard errors\n")
    today = fit.relative_error
    columns = ([percent(float(x)) for x in each] for each in (today, found.alone, found.together))
    rows = [list(row) for row in zip(found.names, *columns, strict=True)]
    print_table(["", "now", "motion alone", "together"], rows, right=(1, 2, 3))


def _document(suggestion: Suggestion) -> dict[str, Any]:
    """Suggested records, and the relative standard errors of K and D after each."""
    from jointid.uncertainty.planned_records import phase_deg

    records, errors = suggestion.records, suggestion.relative_error
    torque, angle = records.relative
    return {
        "parameters": list(suggestion.names),
        "relative_error_today": errors[0].tolist(),
        "records": [
            {
                "frequency_hz": float(records.frequency_hz[k]),
                "duration_s": float(records.duration_s[k]),
                "torque_Nm": np.abs(torque[k]).tolist(),
                "torque_phase_deg": phase_deg(torque[k]).tolist(),
                "angle_rad": np.abs(angle[k]).tolist(),
                "angle_phase_deg": phase_deg(angle[k]).tolist(),
                "relative_error_after": errors[k + 1].tolist(),
            }
            for k in range(records.frequency_hz.size)
        ],
    }


def setpoints(
    study: Annotated[Path, STUDY],
    limits: Annotated[
        Path, typer.Option(parser=named, help="TOML with joint limits, gear ratios and start pose.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", parser=named, help="File of set points.")],
    file_format: Annotated[
        str,
        typer.Option("--format", help="csv, ros2 (trajectory), ur (URScript), egm (ABB) or rsi (KUKA)."),
    ] = "csv",
    sines_as: Annotated[
        str,
        typer.Option(
            help="Without --motion: run the planned sines as sines (one after another), multisine (all "
            "at once) or sweep (over their frequencies)."
        ),
    ] = "sines",
    interval_ms: Annotated[
        float | None, typer.Option(help="Time between set points, ms; default: 1 to 4, by format.")
    ] = None,
    scale: Annotated[float, typer.Option(help="Motion scale: factor on all amplitudes.")] = 1.0,
    repeats: Annotated[int, typer.Option(help="Number of runs of each record.")] = 1,
    ramp_s: Annotated[float, typer.Option(help="Length of the ramps of each record, s.")] = 0.5,
    rest_s: Annotated[float, typer.Option(help="Rest between records, s.")] = 1.0,
    superposed: Annotated[
        str,
        numbers_option(
            "Superposed velocities, joint side, °/s; each record then runs forward and back."
        ),
    ] = "0",
    count: Annotated[int, COUNT] = 3,
    duration_s: Annotated[float, DURATION] = 4.0,
    torque_limit: Annotated[str, TORQUE_LIMIT] = "",
    velocity_limit: Annotated[str, VELOCITY_LIMIT] = "",
    motion: Annotated[str, MOTION] = "",
    position_limit: Annotated[str, POSITION_LIMIT] = "",
    from_hz: Annotated[float, FROM_HZ] = 2.0,
    to_hz: Annotated[float | None, TO_HZ] = None,
    method: Annotated[str, METHOD] = "auto",
    overwrite: Annotated[bool, OVERWRITE] = False,
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Write the suggested records as set points for a robot.

    The set points are simulated first, with exact following and with a controller; if a limit is
    exceeded, no file is written. NUMBERS: one value for all joints, or one per joint: 2.5,2.8.
    """
    from jointid.setpoints.files import highest_hz, set_points
    from jointid.setpoints.from_plan import planned_experiment
    from jointid.setpoints.limit_check import check_table
    from jointid.setpoints.robot_limits import limits_from_toml
    from jointid.setpoints.simulated_experiment import simulate_experiment
    from jointid.uncertainty.chosen_model import identified_friction

    if motion and sines_as != "sines":
        raise typer.BadParameter(
            "--sines-as applies to planned sines: leave out --sines-as or --motion."
        )
    require_new_output(output, overwrite, [study, limits])
    robot = limits_from_toml(read_toml(limits), limits.name)
    texts = position_limit, velocity_limit, torque_limit
    given = study, method, count, duration_s, texts, motion, (from_hz, to_hz)
    most_hz = highest_hz(file_format, interval_ms)
    analysis, found = planned(*given, most_hz=most_hz, usable=True)
    robot.require_gears_of(analysis.study)
    fit, pose = analysis.fit, analysis.study.records[0].pose or ""
    robot, inertia = robot.on_robot(analysis.study, pose, fit.inertias[0])
    with progress("Running on the simulated robot"):
        experiment = planned_experiment(
            found if motion else found.records,
            inertia,
            fit.elasticity,
            kind=sines_as,
            repeats=repeats,
            ramp_s=ramp_s,
            rest_s=rest_s,
            velocity_rad_s=robot.motor_velocity(numbers(superposed)),
            scale=scale,
        )
        points = set_points(
            simulate_experiment(experiment, inertia, fit.elasticity, friction=identified_friction(fit)),
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
    print_columns(check_table(points.rows), right=(2, 3, 4))
    print(f"{output}: {output.stat().st_size} bytes. Not run on hardware: read its header first.")
