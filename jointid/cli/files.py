"""Files that commands read and write."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from jointid.checked_toml import parse_toml
from jointid.cli.output import status
from jointid.errors import JointIdError
from jointid.joints import Inertia
from jointid.study import Analysis, Study

_INERTIA_KEYS = {
    "M": "M = [0.0025, 0.0010]  # rotor inertias, motor side, kg·m²",
    "M2": "M2 = [[0.0041, 0.0004], [0.0004, 0.0019]]  # arm inertia, motor side, kg·m²",
}


def loaded(path: Path) -> Study:
    """Read a study."""
    from jointid.study_files import load_study

    return load_study(path)


def analysed(path: Path, method: str, *, quiet: bool) -> Analysis:
    """Read a study and run the whole method on it."""
    from jointid.study import analyse

    study = loaded(path)
    with status("Analysing", quiet=quiet):
        return analyse(study, method=method)


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


def require_free(path: Path, overwrite: bool) -> None:
    """Refuse before the work is done rather than after it."""
    if path.exists() and not overwrite:
        raise JointIdError(f"{path} exists: choose another path, or replace it with --overwrite.")


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
