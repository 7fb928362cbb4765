"""What the command line computes, as documents for machines; it prints nothing."""

from __future__ import annotations

import math
import os
import secrets
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jointid.answer import answer_sentence
from jointid.checked_toml import parse_toml
from jointid.elasticity import identify_elasticity
from jointid.errors import JointIdError
from jointid.exporting.identification import identification
from jointid.exporting.identification_files import to_document
from jointid.joints import Elasticity, Inertia
from jointid.study import Analysis, Study

DEMONSTRATED_ERRORS = (0.005, 0.005, 0.025, 0.025)
"""Relative standard errors of K1, K2, D1, D2 of a cut without a study."""

_INERTIA_KEYS = {
    "M": "M = [0.0025, 0.0010]  # rotor inertias, motor side, kg·m²",
    "M2": "M2 = [[0.0041, 0.0004], [0.0004, 0.0019]]  # arm inertia, motor side, kg·m²",
}


def identify_document(analysis: Analysis) -> dict[str, Any]:
    """Identification as in its JSON file, with the answer in words and the findings."""
    return to_document(identification(analysis)) | {
        "answer": answer_sentence(analysis.fit, analysis.study.nominal),
        "findings": [
            {"level": f.level, "title": f.title, "detail": f.detail, "remedy": f.remedy}
            for f in analysis.findings
        ],
    }


def demonstration_robot(drive: str | None) -> Any:
    """The paper's K and D on the example arm, as if known within 1 % and 5 %."""
    from jointid.cut.arm import PlanarArm
    from jointid.cut.outcome import PAPER, CutRobot

    value = np.concatenate([PAPER.K, PAPER.D])
    covariance = np.diag((np.array(DEMONSTRATED_ERRORS) * value) ** 2)
    arm = PlanarArm.example("serial" if drive == "serial" else "parallelogram")
    return CutRobot("demonstration", arm, PAPER, covariance, None, None)


def cut_results(
    robot: Any, assumption: str, zones_mm: Sequence[float], progress: Callable[[float], None]
) -> tuple[dict[str, Any], list[Any]]:
    """Cut the paper's rectangle with several corner zones, before and after.

    Returns
    -------
    document : dict
        Path errors in mm, zone by zone.
    outcomes : list of Outcome
        One per zone.
    """
    from jointid.cut.outcome import CUTTING_POINT_M, assumed_elasticity, cut_outcome
    from jointid.cut.toolpath import rectangle

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


def plan_document(
    study: Study,
    *,
    method: str,
    count: int,
    duration_s: float,
    torque_limit: Sequence[float] | None,
    velocity_limit: Sequence[float] | None,
) -> dict[str, Any]:
    """Records to make next, and how well K and D would be known after each."""
    from jointid.phasors import extract_phasors
    from jointid.planning.plan import suggest_records

    phasors = extract_phasors(study.records)
    fit = identify_elasticity(phasors, study.inertias, method=method)
    suggestion = suggest_records(
        phasors,
        study.inertias,
        fit,
        count=count,
        duration_s=duration_s,
        torque_limit_Nm=torque_limit,
        velocity_limit_rad_s=velocity_limit,
    )
    records, errors = suggestion.records, suggestion.relative_error
    return {
        "parameters": list(suggestion.names),
        "relative_error_today": errors[0].tolist(),
        "records": [
            {
                "frequency_hz": float(records.frequency_hz[k]),
                "duration_s": float(records.duration_s[k]),
                "torque_Nm": np.abs(records.torque_Nm[k]).tolist(),
                "torque_phase_deg": np.degrees(np.angle(records.torque_Nm[k])).tolist(),
                "angle_rad": np.abs(records.angle_rad[k]).tolist(),
                "angle_phase_deg": np.degrees(np.angle(records.angle_rad[k])).tolist(),
                "relative_error_after": errors[k + 1].tolist(),
            }
            for k in range(records.frequency_hz.size)
        ],
    }


def study_document(study: Study, path: Path) -> dict[str, Any]:
    """What a new study holds."""
    from jointid.digest import study_digest

    return {
        "study": str(path),
        "digest": study_digest(study),
        "joints": study.inertia.n,
        "records": [
            {
                "label": r.label,
                "frequency_hz": r.frequency_hz,
                "periods": r.periods,
                "samples": int(r.time_s.size),
            }
            for r in study.records
        ],
    }


def inertia_from(path: Path) -> Inertia:
    """Inertia from a study, or from a TOML file that gives M and M2, at its top or under [inertia]."""
    if path.suffix.lower() != ".toml" or path.name == "study.toml":
        from jointid.study_files import load_study

        return load_study(path.parent if path.name == "study.toml" else path).inertia
    with path.open("rb") as file:
        top = parse_toml(path.name, file.read(1 << 21), {"inertia": "[inertia]", **_INERTIA_KEYS})
    table = top.table("inertia", _INERTIA_KEYS) if "inertia" in top else top
    M, M2 = table.numbers("M"), table.matrix("M2")
    try:
        return Inertia(M=M, M2=M2)
    except JointIdError as error:
        raise JointIdError(f"{table.where}: {error}") from error


def mapped_study(
    tables: Sequence[Any], mapping: Any, inertia: Inertia, nominal: Elasticity | None, name: str
) -> tuple[Study, tuple[str, ...]]:
    """Study of the sine segments of several logs with the same columns, and what was left out."""
    from jointid.importing import apply_mapping, find_segments, study_from_logs

    logs = [apply_mapping(table, mapping) for table in tables]
    segments = [find_segments(log) for log in logs]
    study = study_from_logs(logs, segments, inertia, nominal=nominal, name=name)
    return study, tuple(f"{log.name}: {note}" for log in logs for note in log.notes)


def write_file(path: Path, data: bytes) -> None:
    """Write a file completely or not at all."""
    if not path.parent.is_dir():
        raise JointIdError(f"{path.parent} is not a folder: make it first, or choose another path.")
    fresh = path.with_name(f".{path.name[:100]}.{secrets.token_hex(6)}.new")
    try:
        with fresh.open("xb") as file:
            file.write(data)
        os.replace(fresh, path)
    except OSError as error:
        raise JointIdError(f"{path} cannot be written: {error.strerror or error}.") from error
    finally:
        fresh.unlink(missing_ok=True)


def finite(value: Any) -> Any:
    """The same document with null in place of numbers that JSON cannot hold."""
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
