"""Read logs of any format, from a path or bytes, to tables of numbers."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import TypeAlias

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import MAX_LOG_BYTES, LogTable, require_small
from jointid.importing.read.archives import is_archive, read_archive
from jointid.importing.read.reader_process import ReaderProcess
from jointid.importing.read.readers import TEXT, is_zip, kind_of

LogSource: TypeAlias = str | os.PathLike[str] | bytes | bytearray | memoryview
"""Path or content of a log."""


def read_log(source: LogSource, name: str = "") -> tuple[LogTable, ...]:
    """Read the tables of one log.

    Parameters
    ----------
    source : path or bytes
        Text table such as CSV, wide or long; exports of TwinCAT Scope, CODESYS, LabVIEW (.lvm, TDMS),
        dSPACE, halscope and WPILib; MDF, MATLAB .mat, HDF5, Parquet, Arrow, NumPy, JSON, Excel; ROS 2
        bag (.db3, .mcap, or a bag's folder), ROS 1 bag; a format of a plug-in; or a zip of these. The
        content decides, not the name.
    name : str, optional
        File name, for messages and ambiguous content; required with bytes.

    Returns
    -------
    tuple of LogTable
        At least one, the one with the most numbers first; for an archive file by file, see
        ``main_tables``.

    Raises
    ------
    JointIdError
        When it cannot be read; the message names cause, place and remedy.
    """
    (result,) = read_logs([(source, name)])
    if isinstance(result, JointIdError):
        raise result
    return result


def read_logs(
    sources: Iterable[tuple[LogSource, str]],
) -> Iterator[tuple[LogTable, ...] | JointIdError]:
    """Read many logs; errors are returned in place of tables.

    Parameters
    ----------
    sources : iterable of (path or bytes, name)
        As for ``read_log``.

    Yields
    ------
    tuple of LogTable, or JointIdError
        One for each source, in order.
    """
    with closing(ReaderProcess()) as reader:
        for source, name in sources:
            try:
                yield _read(source, name, reader)
            except JointIdError as error:
                yield error


def _read(source: LogSource, name: str, reader: ReaderProcess) -> tuple[LogTable, ...]:
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        name = name or path.name or str(path)
        return _read_path(path, name, reader)
    if not isinstance(source, bytes | bytearray | memoryview):
        raise JointIdError(f"A log comes from a path or bytes, not from {type(source).__name__}.")
    data = bytes(source)
    name = name or "the log"
    require_small(name, len(data))
    if is_zip(data) and is_archive(name, data):
        return read_archive(name, data, reader)
    return reader.read_content(name, data)


def _read_path(path: Path, name: str, reader: ReaderProcess) -> tuple[LogTable, ...]:
    try:
        if path.is_dir():
            if not (path / "metadata.yaml").is_file():
                raise JointIdError(
                    f"{name} is a folder without metadata.yaml, so no ROS 2 bag. Give the log file "
                    "itself."
                )
            size = sum(part.stat().st_size for part in path.iterdir() if part.is_file())
            require_small(name, size)
            return reader.read("db3", name, path)
        if not path.is_file():
            raise JointIdError(f"{path!s:.200}: there is no such file. Check the path.")
        require_small(name, path.stat().st_size)
        with path.open("rb") as file:
            head = file.read(4096)
            kind = kind_of(name, head)
            if is_zip(head) and is_archive(name, path):
                return read_archive(name, path, reader)
            if kind != TEXT:
                is_bag = kind in ("db3", "mcap", "bag")
                if not is_bag or path.suffix == f".{kind}":  # the reader of bags requires it
                    return reader.read(kind, name, path)
            file.seek(0)
            data = file.read(MAX_LOG_BYTES + 1)
        require_small(name, len(data))
        return reader.read_content(name, data)
    except (OSError, ValueError) as error:
        if isinstance(error, JointIdError):
            raise
        raise JointIdError(
            f"{path!s:.200} cannot be opened ({error!s:.200}): check its permissions."
        ) from error
