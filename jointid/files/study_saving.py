"""Writing a study: atomically, exact to the last bit, equal bytes for equal studies."""

import glob
import os
import secrets
import shutil
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, Literal

import numpy as np
import tomli_w

from jointid.errors import JointIdError
from jointid.files.atomic_write import locked, new_file, remove_left_over, require_folder, write_error
from jointid.files.container_limits import MAX_TOTAL_BYTES, mebibytes
from jointid.files.record_tables import write_record_table
from jointid.files.study_keys import (
    PARTS,
    RECORD_VALUES,
    STUDY_VALUES,
    TIMING_KEYS,
    robot_file,
    written_values,
)
from jointid.joints import Inertia
from jointid.parsing.checked_toml import MAX_TOML_BYTES
from jointid.phasors.long_records import LongRecord
from jointid.robot_models.model import RobotModel
from jointid.study import INERTIA_STD, Study

STUDY_FILE = "study.toml"


def save_study(
    study: Study,
    path: str | os.PathLike[str],
    *,
    record_format: Literal["csv", "parquet"] = "csv",
    overwrite: bool = False,
) -> None:
    """Write a study to a folder, or to a zip archive when ``path`` ends in .zip.

    ``load_study`` returns the same study, bit for bit. Writing is atomic.

    Parameters
    ----------
    study : Study
    path : path
        New folder or .zip; its parent folder must exist.
    record_format : {"csv", "parquet"}
        CSV opens everywhere; Parquet is smaller and faster.
    overwrite : bool, default False
        Replace an existing study; a folder only when it contains nothing else.

    Raises
    ------
    JointIdError
        When ``path`` exists and may not be replaced, or cannot be written.
    """
    target = _checked_target(path, overwrite)
    try:
        if _is_zip(target):
            with new_file(target) as file:
                _write_zip(study, file, record_format)
        else:
            _write_folder(study, target, record_format)
    except OSError as error:
        raise write_error(target, error) from error


def pack_study(study: Study, *, record_format: Literal["csv", "parquet"] = "csv") -> bytes:
    """Return a study as the bytes of a zip archive, as ``save_study`` writes it, for a download.

    Equal studies give equal bytes. Raises JointIdError when the study exceeds what ``load_study``
    accepts.
    """
    buffer = BytesIO()
    _write_zip(study, buffer, record_format)
    return buffer.getvalue()


def _files(study: Study, record_format: str) -> Iterator[tuple[str, bytes]]:
    """Name and content of every file of a study, study.toml first."""
    if record_format not in ("csv", "parquet"):
        raise JointIdError(f'record_format = {record_format!r:.60}: expected "csv" or "parquet".')
    digits = max(2, len(str(len(study.records))))
    names = [f"records/{k:0{digits}}.{record_format}" for k in range(1, len(study.records) + 1)]
    text = _toml(study, names)
    if len(text) > MAX_TOML_BYTES:
        raise JointIdError(
            f"{STUDY_FILE} would have {len(text)} bytes, more than the limit of {MAX_TOML_BYTES}: "
            "shorten the description and the labels."
        )
    yield STUDY_FILE, text
    if study.robot_model is not None:
        yield robot_file(study.robot_model), study.robot_model.source[1]
    for name, record in zip(names, study.records, strict=True):
        if isinstance(record, LongRecord):
            raise JointIdError(
                f"{record.label} is read in parts and cannot be saved again: copy the study's folder."
            )
        yield name, write_record_table(record, record_format)


def _toml(study: Study, files: Sequence[str]) -> bytes:
    timings = {(record.torque_hold, record.torque_delay_s.hex()) for record in study.records}
    head: dict[str, Any] = {"format": 1, "name": study.name} | written_values(study, STUDY_VALUES)
    if study.robot_model is not None:
        head["robot_model"] = _robot_table(study.robot_model)
    head["inertia"] = _pose(study, "", study.inertia)
    # Only what the reader would not assume: other studies stay readable by version 0.1, byte for byte.
    if study.inertia_std != INERTIA_STD:
        head["inertia"]["std"] = study.inertia_std
    if study.torque_std is not None:
        head["torque"] = {"std": study.torque_std}
    if study.nominal is not None:
        head["nominal"] = {"K": study.nominal.K.tolist(), "D": study.nominal.D.tolist()}
    if len(timings) == 1:
        head["timing"] = written_values(study.records[0], TIMING_KEYS)
    head["poses"] = {name: _pose(study, name, pose) for name, pose in study.poses.items()}
    text = tomli_w.dumps(head)
    for file, record in zip(files, study.records, strict=True):
        row = {"file": file} | written_values(record, RECORD_VALUES)
        row["label"] = record.label
        if record.label == PurePosixPath(file).name:  # which the reader takes
            del row["label"]
        if len(timings) > 1:
            row |= written_values(record, TIMING_KEYS)
        text += "\n[[records]]\n" + tomli_w.dumps(row)
    try:
        return text.encode()
    except UnicodeEncodeError as error:
        raise JointIdError(
            f"A text of the study contains {text[error.start]!r}, not a valid character: remove it."
        ) from error


def inertia_table(inertia: Inertia) -> dict[str, Any]:
    """Return M, M2 and, if there are any, the parts that are not zero, as lists."""
    parts = {name: getattr(inertia, name) for name in PARTS}
    known = {name: part.tolist() for name, part in parts.items() if part.any()}
    return {"M": inertia.M.tolist(), "M2": inertia.M2.tolist()} | known


def _robot_table(robot: RobotModel) -> dict[str, Any]:
    """Table of the robot model: its file, and values that replaced those of the file."""
    plain = RobotModel.parse(*robot.source)
    table: dict[str, Any] = {"file": robot_file(robot)}
    for key in ("gear_ratio", "rotor_inertia"):
        value = getattr(robot, key)
        if not np.array_equal(value, getattr(plain, key)) and np.isfinite(value).all():
            table[key] = value.tolist()
    payload = {key: np.asarray(value).tolist() for key, value in vars(robot.payload).items()}
    if payload != {key: np.asarray(value).tolist() for key, value in vars(plain.payload).items()}:
        table["payload"] = payload
    return table


def _pose(study: Study, name: str, pose: Inertia) -> dict[str, Any]:
    """Table of [inertia], without a name, or of a pose: its joint angles, else its own matrices."""
    if (angles := study.pose_angles_rad.get(name)) is not None:
        return {"angles_rad": angles.tolist()}
    table = inertia_table(pose)
    if name and np.array_equal(pose.M, study.inertia.M):
        del table["M"]
    return table


def _write_folder(study: Study, target: Path, record_format: str) -> None:
    remove_left_over(target.parent)
    token = secrets.token_hex(8)
    fresh, old = target.with_name(f".{token}.new"), target.with_name(f".{target.name}.{token}.old")
    try:
        (fresh / "records").mkdir(parents=True)
        with _held(fresh):
            for name, data in _files(study, record_format):
                (fresh / name).write_bytes(data)
            if target.exists():
                target.rename(old)  # a folder cannot replace a folder that holds files
            fresh.replace(target)
    except OSError:
        if old.exists():
            old.rename(target)
        raise
    finally:
        for rest in (fresh, old):
            shutil.rmtree(rest, ignore_errors=True)


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Lock a folder, where the system can."""
    handle = os.open(folder, os.O_RDONLY) if os.name == "posix" else None
    try:
        if handle is not None:
            locked(handle)
        yield
    finally:
        if handle is not None:
            os.close(handle)


def _write_zip(study: Study, file: BinaryIO, record_format: str) -> None:
    total = 0
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in _files(study, record_format):
            total += len(data)
            if total > MAX_TOTAL_BYTES:
                raise JointIdError(
                    f"The study needs more than the {mebibytes(MAX_TOTAL_BYTES)} that load_study "
                    'accepts: split it, or choose record_format="parquet".'
                )
            member = zipfile.ZipInfo(name)  # with a fixed date: equal studies give equal bytes
            member.create_system, member.external_attr = 3, 0o644 << 16
            member.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(member, data, compresslevel=1)  # 5 times as fast as 6, and 1.1 as large


def _is_zip(target: Path) -> bool:
    return target.suffix.lower() == ".zip"


def _checked_target(path: str | os.PathLike[str], overwrite: bool) -> Path:
    """Real path of the target, if a study may be written there."""
    try:
        target = Path(os.path.realpath(path))
        require_folder(target)
        # Restore the study that a killed write moved; remove it if the write had succeeded.
        for old in target.parent.glob(f".{glob.escape(target.name)}.*.old"):
            with suppress(OSError):
                shutil.rmtree(old) if target.exists() else old.rename(target)
        if target.exists():
            _require_replaceable(target, overwrite)
    except JointIdError:
        raise
    except (OSError, ValueError) as error:
        raise JointIdError(
            f"{path!s:.200} is not a path to write to: {error}. Choose another path."
        ) from error
    return target


def _require_replaceable(target: Path, overwrite: bool) -> None:
    if not overwrite:
        raise JointIdError(f"{target} exists: choose another path, or pass overwrite=True.")
    if target.is_dir() == _is_zip(target):
        raise JointIdError(
            f"{target} is {'a folder' if target.is_dir() else 'a file'}: choose another path."
        )
    if _is_zip(target):
        return
    for entry in [*target.iterdir(), *(target / "records").glob("*")]:
        name = entry.relative_to(target).as_posix()
        is_record = name.startswith("records/") and entry.suffix in (".csv", ".parquet")
        is_robot = name in [f"robot{ending}" for ending in RobotModel.ENDINGS]
        if not (is_record or is_robot or name in (STUDY_FILE, "records")):
            raise JointIdError(
                f"{target} also holds {name}, which is not part of a study: nothing was overwritten. "
                "Choose another path."
            )
