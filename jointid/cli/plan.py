"""jointid plan."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from jointid.analysis import Analysis, analyse
from jointid.cli.files import loaded
from jointid.cli.options import JSON, METHOD, STUDY, numbers
from jointid.cli.output import print_json, print_table, progress, warn_if_unusable
from jointid.cli.program import reported
from jointid.errors import JointIdError
from jointid.study import Study

if TYPE_CHECKING:
    from jointid.uncertainty.plan import Suggestion

COUNT = typer.Option(min=1, max=50, help="Number of records.")
DURATION = typer.Option(help="Length of each record, s.")
TORQUE_LIMIT = typer.Option(help="Largest torque amplitudes, N·m; default: the study's.")
VELOCITY_LIMIT = typer.Option(help="Largest velocity amplitudes, rad/s; default: the study's.")


@reported
def plan(
    study: Annotated[Path, STUDY],
    count: Annotated[int, COUNT] = 3,
    duration_s: Annotated[float, DURATION] = 4.0,
    torque_limit: Annotated[str, TORQUE_LIMIT] = "",
    velocity_limit: Annotated[str, VELOCITY_LIMIT] = "",
    motion: Annotated[
        str, typer.Option(help="Plan a motion other than sines: sweep, multisine, random or moves.")
    ] = "",
    position_limit: Annotated[
        str, typer.Option(help="Largest angles of a motion, ± rad; default: the study's.")
    ] = "",
    from_hz: Annotated[float, typer.Option(help="Lowest frequency of a motion, Hz.")] = 2.0,
    to_hz: Annotated[float, typer.Option(help="Highest frequency of a motion, Hz.")] = 40.0,
    method: Annotated[str, METHOD] = "auto",
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Suggest the next records and predict the standard errors after each.

    Limits are one number for all joints, or numbers with commas: 2.5,2.8.
    """
    if motion:
        texts = position_limit, velocity_limit, torque_limit
        limits = [numbers(text) if text else None for text in texts]
        shape = motion, from_hz, to_hz, duration_s
        _plan_motion(loaded(study), method, shape, limits, count, as_json)
        return
    from jointid.uncertainty.validation import second_amplitude

    analysis, suggestion = suggested(
        study, method, count, duration_s, torque_limit, velocity_limit, quiet=as_json
    )
    warn_if_unusable(analysis)
    document = _document(suggestion) | {"second_amplitude": second_amplitude(analysis.fit)}
    if as_json:
        print_json(document)
        return
    from jointid.uncertainty.planned_records import phasor_text

    names = document["parameters"]
    rows = [["today", "", "", *map(_percent, document["relative_error_today"])]]
    for k, record in enumerate(document["records"], start=1):
        torques = ", ".join(map(phasor_text, suggestion.records.relative[0][k - 1].tolist()))
        errors = map(_percent, record["relative_error_after"])
        rows.append([f"record {k}", f"{record['frequency_hz']:.3g}", torques, *errors])
    print("Suggested records, and the relative standard errors after each\n")
    print_table(["", "Hz", "torques (N·m)", *names], rows, right=(1, *range(3, 3 + len(names))))
    if advice := document["second_amplitude"]:
        print(f"\n{advice}")


def suggested(
    path: Path,
    method: str,
    count: int,
    duration_s: float,
    torque_limit: str,
    velocity_limit: str,
    *,
    quiet: bool,
) -> tuple[Analysis, Suggestion]:
    """Read a study, fit it and suggest the next records."""
    from jointid.uncertainty.plan import suggest_records

    torque = numbers(torque_limit) if torque_limit else None
    velocity = numbers(velocity_limit) if velocity_limit else None
    known = loaded(path)
    if known.motion_records:
        raise JointIdError(
            "Sines are planned from the noise of sines, and this study has records of other motions. "
            "jointid plan --motion sweep plans a motion; set points need a study of sines."
        )
    with progress("Planning", quiet=quiet):
        analysis = analyse(known, method=method)
        suggestion = suggest_records(
            analysis.phasors,
            known.inertias,
            analysis.fit,
            count=count,
            duration_s=duration_s,
            torque_limit_Nm=torque,
            velocity_limit_rad_s=velocity,
            highest_hz=0.25 / max(record.interval_s for record in known.records),
        )
    return analysis, suggestion


def _plan_motion(
    known: Study,
    method: str,
    shape: tuple[str, float, float, float],
    limits: Sequence[Sequence[float] | None],
    count: int,
    as_json: bool,
) -> None:
    from jointid.arrays import per_joint
    from jointid.simulation.motion import Motion
    from jointid.uncertainty.motion_plan import MotionLimits, largest_motion, plan_motion

    motion, n = Motion(*shape, odd=shape[0] == "multisine"), known.inertia.n
    largest = largest_motion(known.records)
    own = largest.position_rad, largest.velocity_rad_s, largest.torque_Nm
    pairs = zip(own, limits, strict=True)
    chosen = [each if given is None else per_joint("limit", given, n) for each, given in pairs]
    with progress("Planning", quiet=as_json):
        analysis = analyse(known, method=method)
        fit = analysis.fit
        interval = known.records[0].interval_s
        inertia = known.inertias[0]
        found = plan_motion(
            fit, inertia, motion, MotionLimits(*chosen), interval_s=interval, records=count
        )
    warn_if_unusable(analysis)
    reached = largest_motion(found.records)
    if as_json:
        print_json(
            {
                "motion": motion.kind,
                "duration_s": found.duration_s,
                "parameters": list(found.names),
                "relative_error_alone": found.alone.tolist(),
                "relative_error_together": found.together.tolist(),
                "peak_torque_Nm": reached.torque_Nm.tolist(),
                "peak_velocity_rad_s": reached.velocity_rad_s.tolist(),
            }
        )
        return
    print(f"{motion.kind}, {count} records, {found.duration_s:.4g} s in all: relative standard errors\n")
    today = fit.standard_error / np.abs(fit.estimate)
    rows = [
        [name, *map(_percent, (float(a), float(b), float(c)))]
        for name, a, b, c in zip(found.names, today, found.alone, found.together, strict=True)
    ]
    print_table(["", "today", "motion alone", "together"], rows, right=(1, 2, 3))


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


def _percent(error: float) -> str:
    from jointid.wording import UNDETERMINED, significant

    return f"{significant(100 * error, 2)} %" if np.isfinite(error) else UNDETERMINED
