"""Zip archives of logs and of ROS 2 bag folders; each file is a separate log."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

from jointid.errors import JointIdError
from jointid.files.container_limits import Container
from jointid.files.containers import open_container
from jointid.importing.columns.log_table import (
    MAX_LOG_BYTES,
    MAX_TABLES,
    LogTable,
    require_few_values,
    require_small,
)
from jointid.importing.read.reader_process import ReaderProcess
from jointid.importing.read.readers import is_zip
from jointid.wording import counted, listed

_BAG = "metadata.yaml"
_STUDY = "study.toml"
_OFFICE = frozenset(
    {"[Content_Types].xml", "mimetype", "content.xml", "xl/workbook.xml", "xl/workbook.bin"}
)
_OTHER_ENDINGS = frozenset(
    {".md", ".pdf", ".png", ".jpg", ".jpeg", ".json", ".yaml", ".yml", ".toml", ".m", ".py"}
)
"""Endings of files that accompany logs."""


def is_archive(name: str, source: bytes | Path) -> bool:
    """Whether a zip file is an archive of logs rather than a workbook.

    Parameters
    ----------
    name : str
        Its ending decides if the content is ambiguous.
    source : bytes or Path
    """
    with suppress(JointIdError), open_container(source, marker=_BAG) as container:
        names = container.names()
        arrays = bool(names) and all(part.endswith(".npy") for part in names)  # a NumPy .npz
        return not (arrays or _OFFICE.intersection(names))
    return name.lower().endswith(".zip")


def read_archive(name: str, source: bytes | Path, reader: ReaderProcess) -> tuple[LogTable, ...]:
    """Read every log of a zip archive.

    Parameters
    ----------
    name : str
        Name of the archive, for messages.
    source : bytes or Path
    reader : ReaderProcess

    Returns
    -------
    tuple of LogTable
        File by file, in the order of their names, given by ``source``. A note of the first table names
        unreadable files.

    Raises
    ------
    JointIdError
        When it holds no log, or exceeds the limits.
    """
    found: list[LogTable] = []
    problems: list[str] = []
    with open_container(source, marker=_BAG) as container:
        files = container.names()
        if any(PurePosixPath(file).name == _STUDY for file in files):
            raise JointIdError(
                f'{name} holds a study ({_STUDY}), not logs: open it with "Open a study (.zip)", or '
                "give it to jointid identify."
            )
        folder = {file: str(PurePosixPath(file).parent) for file in files}
        bags = {folder[file] for file in files if PurePosixPath(file).name == _BAG}
        parts = [(bag, [file for file in files if folder[file] == bag]) for bag in bags]
        parts += [(file, []) for file in files if folder[file] not in bags and not _is_other(file)]
        if len(parts) > MAX_TABLES:
            raise JointIdError(
                f"{name} holds {len(parts)} files, more than the limit of {MAX_TABLES} logs: split it."
            )
        for part, of_bag in sorted(parts):
            label = name if part in (".", "") else f"{name}/{part}"
            try:
                if of_bag:
                    tables = _bag(container, label, of_bag, reader)
                else:
                    data = _content(container, part, label)
                    if is_zip(data) and is_archive(label, data):
                        raise JointIdError(f"{label} is a zip archive within an archive: unpack it.")
                    tables = reader.read_content(label, data)
            except JointIdError as error:
                problems.append(str(error))
                continue
            found += [replace(table, source=label) for table in tables]
            require_few_values(name, sum(table.rows * len(table.columns) for table in found))
    if not found:
        said = f" {problems[0]}" if problems else f" Files found: {listed(files)}."
        raise JointIdError(f"{name} holds no log that can be read.{said}")
    if problems:
        left_out = f"{counted(len(problems), 'file')} of {name} could not be read. {problems[0]:.300}"
        found[0] = replace(found[0], notes=(*found[0].notes, left_out))
    return tuple(found)


def _content(container: Container, file: str, label: str) -> bytes:
    data = container.read(file, at_most=MAX_LOG_BYTES + 1)
    require_small(label, len(data))
    return data


def _bag(
    container: Container, label: str, files: list[str], reader: ReaderProcess
) -> tuple[LogTable, ...]:
    """Extract a bag to a temporary folder for its reader."""
    with TemporaryDirectory(prefix="jointid-") as folder:
        place = Path(folder, "bag")
        place.mkdir()
        for file in files:
            data = _content(container, file, f"{label}: {file}")
            (place / PurePosixPath(file).name).write_bytes(data)
        return reader.read("db3", label, place)


def _is_other(file: str) -> bool:
    path = PurePosixPath(file)
    return path.suffix.lower() in _OTHER_ENDINGS or path.stem.lower() in ("readme", "license", "licence")
