"""Read logs of any format, from a path, bytes or a zip archive of logs, to tables of numbers."""

import os
from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import TypeAlias

from jointid.errors import JointIdError
from jointid.files.containers import Container, open_container
from jointid.importing.columns.log_table import (
    MAX_LOG_BYTES,
    MAX_TABLES,
    LogTable,
    require_few_values,
    require_small,
)
from jointid.importing.read.clocks import with_own_clocks, with_whole_clock
from jointid.importing.read.reader_process import ReaderProcess
from jointid.importing.read.readers import is_zip
from jointid.wording import counted, listed

LogSource: TypeAlias = str | os.PathLike[str] | bytes | bytearray | memoryview
"""Path or content of a log."""


def read_log(source: LogSource, name: str = "") -> tuple[LogTable, ...]:
    """Read the tables of one log, at least one, from a path or bytes.

    Text table such as CSV, wide or long; exports of TwinCAT Scope, CODESYS, LabVIEW (.lvm, TDMS),
    dSPACE, halscope and WPILib; MDF, MATLAB .mat, HDF5, Parquet, Arrow, NumPy, JSON, Excel; ROS 2 bag
    (.db3, .mcap, or a bag's folder), ROS 1 bag; a format of a plug-in; or a zip of these. The content
    decides, not the name. ``name`` is that of the file, for messages and ambiguous content; required
    with bytes. The table with the most numbers comes first; of an archive file by file, see
    ``main_tables``. Raises JointIdError when it cannot be read; the message names cause, place and
    remedy.
    """
    (result,) = read_logs([(source, name)])
    if isinstance(result, JointIdError):
        raise result
    return result


def read_logs(sources: Iterable[tuple[LogSource, str]]) -> Iterator[tuple[LogTable, ...] | JointIdError]:
    """Read many logs in order, each given as arguments of ``read_log``; errors in place of tables."""
    with closing(ReaderProcess()) as reader:
        for source, name in sources:
            try:
                read = map(with_whole_clock, _read(source, name, reader))
                yield tuple(part for table in read for part in with_own_clocks(table))
            except JointIdError as error:
                yield error


def _read(source: LogSource, name: str, reader: ReaderProcess) -> tuple[LogTable, ...]:
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        try:
            return _read_path(path, name or path.name or str(path), reader)
        except JointIdError:
            raise
        except (OSError, ValueError) as error:
            raise JointIdError(
                f"{path!s:.200} cannot be opened ({error!s:.200}): check its permissions."
            ) from error
    if not isinstance(source, bytes | bytearray | memoryview):
        raise JointIdError(f"A log comes from a path or bytes, not from {type(source).__name__}.")
    return _read_bytes(bytes(source), name or "the log", reader)


def _read_bytes(data: bytes, name: str, reader: ReaderProcess) -> tuple[LogTable, ...]:
    require_small(name, len(data))
    if is_zip(data) and is_archive(name, data):
        return read_archive(name, data, reader)
    return reader.read_content(name, data)


def _read_path(path: Path, name: str, reader: ReaderProcess) -> tuple[LogTable, ...]:
    if path.is_dir():
        if not (path / _BAG).is_file():
            raise JointIdError(
                f"{name} is a folder without {_BAG}, so it is not a ROS 2 bag. Give the log file."
            )
        require_small(name, sum(part.stat().st_size for part in path.iterdir() if part.is_file()))
        return reader.read("db3", name, path)
    if not path.is_file():
        raise JointIdError(f"{path!s:.200}: no such file. Check the path.")
    require_small(name, path.stat().st_size)
    return _read_bytes(path.read_bytes(), name, reader)


_BAG = "metadata.yaml"
_STUDY = "study.toml"
_OFFICE = frozenset(
    {"[Content_Types].xml", "mimetype", "content.xml", "xl/workbook.xml", "xl/workbook.bin"}
)
_OTHER_ENDINGS = frozenset(
    {".md", ".pdf", ".png", ".jpg", ".jpeg", ".json", ".yaml", ".yml", ".toml", ".m", ".py"}
)
"""Endings of files that accompany logs."""


def is_archive(name: str, source: bytes) -> bool:
    """Whether a zip file is an archive of logs and not a workbook; its ending decides in doubt."""
    with suppress(JointIdError), open_container(source, marker=_BAG) as container:
        names = container.names()
        arrays = bool(names) and all(part.endswith(".npy") for part in names)  # a NumPy .npz
        return not (arrays or _OFFICE.intersection(names))
    return name.lower().endswith(".zip")


def read_archive(name: str, source: bytes, reader: ReaderProcess) -> tuple[LogTable, ...]:
    """Read every log of a zip archive, file by file in the order of their names, which ``source`` gives.

    A note of the first table names unreadable files. Raises JointIdError when it holds no log, or
    exceeds the limits.
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
