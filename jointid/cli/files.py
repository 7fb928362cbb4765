"""Input and output files of commands."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jointid.analysis import Analysis, Answer, analyse, analyse_arm_side, answer_of
from jointid.cli.output import progress
from jointid.errors import JointIdError
from jointid.files.application import sample_studies
from jointid.parsing.checked_toml import MAX_TOML_BYTES
from jointid.study import Study
from jointid.wording import listed, nearest

MINIMAL_ROBOT = """\
[inertia]                                          # seen from the motors, kg·m²
M  = [0.0025, 0.0010]                              # rotors, one per joint
M2 = [[0.0041, 0.0004], [0.0004, 0.0019]]          # arm
std = inf                                          # start values only: the fit determines M and M2
"""
"""File of inertias for two joints."""

if TYPE_CHECKING:
    from jointid.importing.robot_inertia import KnownRobot


def load_named(path: Path) -> Study:
    """Read a study, or the sample of that name where no file or folder has it."""
    from jointid.files.study_files import load_study

    if len(path.parts) != 1 or os.path.exists(path):
        return load_study(path)
    samples, name = sample_studies(), path.name
    if (sample := samples.get(name.replace(" ", "_"))) is None:  # spaces as the app shows it
        raise JointIdError(
            f"{name:.200}: no such file, folder or sample. Give a study's folder, that "
            f"folder as .zip, or a sample: {listed(samples)}.{nearest(name, samples)}"
        )
    return load_study(sample)


def analyse_file(path: Path, method: str, **changes: Any) -> Analysis:
    """Read a study, change its deviations as given, and run the whole method on it."""
    study = replace(load_named(path), **changes)
    with progress("Analysing"):
        analysis = analyse(study, method=method)
        warn_of_sensors(analysis)
    return analysis


def warn_of_sensors(analysis: Analysis) -> None:
    """State on standard error that sensors behind the gears contradict K of the motors."""
    if title := answer_of(analysis.study, lambda _: analysis).contradiction:
        print(f"{title}. This command uses K from the motors: see jointid identify.", file=sys.stderr)


def answer_file(path: Path, method: str, *, arm_side: bool | None = None, **changes: Any) -> Answer:
    """Read a study and return all that it gives, see ``answer_of``; or of arm-side sensors or motors."""
    study, motors = replace(load_named(path), **changes), partial(analyse, method=method)
    with progress("Analysing"):
        if arm_side is None:
            return answer_of(study, motors)
        return analyse_arm_side(study) if arm_side else motors(study)


def robot_from(path: Path) -> KnownRobot:
    """Read inertias, of poses too, and their deviations from a study or a TOML file with M and M2."""
    from jointid.importing.robot_inertia import KnownRobot, robot_from_toml

    if path.suffix.lower() == ".toml":
        if not path.exists():
            raise JointIdError(
                f"{path}: no such file. Create it with the inertias, for example for two "
                f"joints:\n\n{MINIMAL_ROBOT}"
            )
        beside = path.parent
        return robot_from_toml(read_toml(path), path.name, lambda name: (beside / name).read_bytes())
    study = load_named(path)
    return KnownRobot(**{each.name: getattr(study, each.name) for each in fields(KnownRobot)})


def read_toml(path: Path) -> bytes:
    """Read a TOML file, of a larger one as much as the parser refuses."""
    with path.open("rb") as file:
        return file.read(MAX_TOML_BYTES + 1)


def require_new_output(path: Path, overwrite: bool, reads: Iterable[Path | None] = ()) -> None:
    """Refuse, before any work, an existing output without ``overwrite``, and any input as output."""
    target = Path(os.path.realpath(path))
    for source in (Path(os.path.realpath(read)) for read in reads if read is not None):
        inside = source in target.parents and path.exists() and _in_study(path)
        same = source.exists() and target.exists() and source.samefile(target)
        if same or source == target or target in source.parents or inside:
            raise JointIdError(f"{path} is the input of this command: choose another path for results.")
    if path.exists() and not overwrite:
        raise JointIdError(f"{path} exists: choose another path, or replace it with --overwrite.")


def _in_study(path: Path) -> bool:
    """Whether a file may be part of a study's folder."""
    from jointid.files.study_parts import STUDY_PARTS
    from jointid.files.study_saving import STUDY_FILE

    in_folder = any((parent / STUDY_FILE).is_file() for parent in path.absolute().parents)
    return in_folder and path.suffix.lower() in STUDY_PARTS
