"""A study on disk: study.toml and its records, in a folder or the same folder zipped.

``study_keys`` has every key with an example; docs/reference/study-format.md describes the format.
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import PurePosixPath
from typing import Any

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.files.container_limits import Budget, safe_name
from jointid.files.containers import Container, MissingFileError, Source, missing, open_container
from jointid.files.record_tables import read_record_table
from jointid.files.study_keys import (
    INERTIA_KEYS,
    RECORD_KEYS,
    RECORD_VALUES,
    STUDY_KEYS,
    STUDY_VALUES,
    TIMING_KEYS,
    read_known,
    read_robot_model,
)
from jointid.files.study_parts import is_long, read_long_record
from jointid.files.study_saving import STUDY_FILE, pack_study, save_study
from jointid.parsing.checked_toml import MAX_TOML_BYTES, CheckedTable, in_place, parse_toml
from jointid.records import MotionRecord, SineRecord
from jointid.robot_models.model import MAX_FILE_BYTES
from jointid.study import Study
from jointid.wording import listed, nearest, shown

__all__ = ["lines_around", "load_study", "pack_study", "save_study", "study_name"]

_ABOVE, _BELOW = 6, 6
"""Lines shown around a refused one."""
_WIDEST = 200  # characters of such a line


def load_study(path_or_file: Source) -> Study:
    """Read a study from a folder, or from the same folder zipped.

    Parameters
    ----------
    path_or_file : path, bytes or binary file
        The folder, the study.toml in it or a .zip by its path, or the zip as bytes or as an open
        binary file. In a zip, study.toml is at the root or in the only top-level
        folder. Nothing is unpacked to disk. A Parquet record of more than 256 MiB in a folder
        is read in parts (``LongRecord``), whatever its size.

    Returns
    -------
    Study
        A record without a label carries its file's name.

    Raises
    ------
    JointIdError
        When any part cannot be used; the message names file, key or row, value and remedy.
    """
    with open_container(path_or_file, marker=STUDY_FILE) as container:
        top = parse_toml(STUDY_FILE, container.read(STUDY_FILE, at_most=MAX_TOML_BYTES + 1), STUDY_KEYS)
        if (version := top.integer("format")) != 1:
            raise top.error(
                f"format = {shown(version)}, but this version reads format 1. Update jointid, or write "
                "format = 1 if the file follows it."
            )
        known = top.values(STUDY_VALUES)
        table = top.table("inertia", INERTIA_KEYS)
        model = read_robot_model(top, lambda file: container.read(file, at_most=MAX_FILE_BYTES + 1))
        known |= read_known(top, table, model)
        timing = top.table("timing", TIMING_KEYS) if "timing" in top else None
        tables = top.tables("records", RECORD_KEYS)
        files = _record_files(tables, container)
        budget = Budget(container.name)  # the numbers of an archive, which unpack a second time
        records = [
            _record(table, file, timing, container, budget, known["inertia"].n, tuple(known["poses"]))
            for table, file in zip(tables, files, strict=True)
        ]
    with in_place(STUDY_FILE, STUDY_FILE):
        return Study(records=tuple(records), **known)


def study_name(path_or_file: Source) -> str:
    """Return the name that a study states, without reading its records; errors as ``load_study``."""
    with open_container(path_or_file, marker=STUDY_FILE) as container:
        top = parse_toml(STUDY_FILE, container.read(STUDY_FILE, at_most=MAX_TOML_BYTES + 1), STUDY_KEYS)
        return str(top.values(STUDY_VALUES).get("name", ""))


def lines_around(path_or_file: Source, refusal: JointIdError) -> str:
    """Return the numbered lines around the place in a text that an error of ``load_study`` names.

    The first lines where it names none; empty where it names no file, or this cannot be read.
    """
    if refusal.file is None or refusal.file.lower().endswith(".parquet"):
        return ""
    with suppress(JointIdError), open_container(path_or_file, marker=STUDY_FILE) as container:
        text, place = container.read(refusal.file).decode(errors="replace"), refusal.line or 0
        lines = list(enumerate(re.split(r"\r\n|\r|\n", text), start=1))
        return "\n".join(
            f"{'▶' if number == refusal.line else ' '} {number:>6}  {line[:_WIDEST]}"
            for number, line in lines[max(place - _ABOVE - 1, 0) : place + _BELOW]
        )
    return ""


def _record_files(tables: Sequence[CheckedTable], container: Container) -> list[str]:
    """Files of the records, all different and present; for a missing one suggest one without record."""
    seen: dict[str, str] = {}
    for table in tables:
        with in_place(table.where, table.file):
            file = safe_name(table.text("file"))
        if file in seen:
            raise table.error(f"{file} is also the file of {seen[file]}. Give each record its own file.")
        seen[file] = table.where
    there = set(container.names())
    for file in [file for file in seen if file not in there]:
        try:
            container.read(file, at_most=1)  # another spelling may name the same file
        except MissingFileError:
            raise missing(file, container, taken=[STUDY_FILE, *seen]) from None
    return list(seen)


def _record(
    table: CheckedTable,
    file: str,
    timing: CheckedTable | None,
    container: Container,
    budget: Budget,
    joints: int,
    poses: tuple[str, ...],
) -> SineRecord | MotionRecord:
    known: dict[str, Any] = {"label": PurePosixPath(file).name, "start_s": None}
    known |= table.values(RECORD_VALUES)
    for of in (timing, table):
        known |= {} if of is None else of.values(TIMING_KEYS)
    pose = known.get("pose")
    if pose is not None and pose not in poses:
        raise JointIdError(
            f'{table.where} ({file}): pose "{pose:.60}" is not defined.{nearest(pose, poses)} '
            f"Known poses: {listed(poses)}.",
            file=table.file,
        )
    kind: type[SineRecord | MotionRecord] = SineRecord
    if "frequency_hz" not in table:
        kind = MotionRecord
    elif "band_hz" in table:
        raise table.error("band_hz belongs to a record without frequency_hz: remove one of them.")
    path = container.path(file)
    if kind is SineRecord and path is not None and is_long(file, path):
        with in_place(file, file):
            return read_long_record(file, path, joints, **known)
    try:
        given = file, container.read(file), joints
        arrays = read_record_table(*given, arm=kind is MotionRecord, left=budget.left)
        if path is None:
            budget.spend(sum(array.nbytes for array in arrays.values()), file)
    except JointIdError as error:
        error.file = error.file or file  # its message begins with it
        raise
    try:
        return kind(**(known | arrays))
    except JointIdError as error:
        unit = _other_time_unit(known.get("frequency_hz", 0.0), arrays["time_s"])
        raise JointIdError(f"{file}: {error}{unit}", file=file) from error


def _other_time_unit(frequency_hz: float, time: Floats) -> str:
    """Suggest the unit in which the times fit, where seconds do not."""
    span = float(time[-1] - time[0])
    if time.size < 2 or frequency_hz * span < 0.5 * (time.size - 1):
        return ""
    for unit, per_second in (("milliseconds", 1e3), ("microseconds", 1e6)):
        rate, periods = (time.size - 1) / span * per_second, frequency_hz * span / per_second
        if frequency_hz < 0.5 * rate and periods >= 1:
            return (
                f" If time_s is in {unit}, the record has {rate:.4g} samples per second and "
                f"{periods:.4g} periods of {frequency_hz:g} Hz: divide time_s by {per_second:.0f}."
            )
    return ""
