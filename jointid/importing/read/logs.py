"""Any log in: from a path or bytes to tables of numbers."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import MAX_LOG_BYTES, LogTable, require_small
from jointid.importing.read.archives import is_archive, read_archive
from jointid.importing.read.file_types import TEXT, is_zip, kind_of
from jointid.importing.read.reader_process import SeparateReader
from jointid.importing.read.text_tables import read_text_table

LogSource: TypeAlias = str | os.PathLike[str] | bytes | bytearray | memoryview
"""A log by its path, or its content."""


def read_log(source: LogSource, name: str = "") -> tuple[LogTable, ...]:
    """Read the tables of one log, whatever program wrote it.

    Parameters
    ----------
    source : path or bytes
        Text table (CSV and its kin), Parquet, MATLAB .mat, HDF5, Excel, ROS 2 bag (.db3, .mcap, or a
        bag's folder), ROS 1 bag, or a zip archive of such. The content decides, not the name.
    name : str, optional
        File name, for messages and where the content leaves it open; needed with bytes.

    Returns
    -------
    tuple of LogTable
        At least one; the one with the most numbers first. Of an archive file by file, see
        ``main_tables``.

    Raises
    ------
    JointIdError
        When it cannot be read; the message says why, where and what to do.
    """
    (result,) = read_logs([(source, name)])
    if isinstance(result, JointIdError):
        raise result
    return result


def read_logs(
    sources: Iterable[tuple[LogSource, str]],
) -> Iterator[tuple[LogTable, ...] | JointIdError]:
    """Read many logs; a bad one does not keep the others from being read.

    Parameters
    ----------
    sources : iterable of (path or bytes, name)
        As for ``read_log``.

    Yields
    ------
    tuple of LogTable, or JointIdError
        One for each source, in order.
    """
    binary = _BinaryReader()
    try:
        for source, name in sources:
            try:
                yield _read(source, name, binary)
            except JointIdError as error:
                yield error
    finally:
        binary.close()


def _read(source: LogSource, name: str, binary: _BinaryReader) -> tuple[LogTable, ...]:
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        name = name or path.name or str(path)
        return _read_path(path, name, binary)
    if not isinstance(source, bytes | bytearray | memoryview):
        raise JointIdError(f"A log comes from a path or bytes, not from {type(source).__name__}.")
    data = bytes(source)
    name = name or "the log"
    require_small(name, len(data))
    kind = kind_of(name, data[:4096])
    if is_zip(data) and is_archive(name, data):
        return _read_archive(name, data, binary)
    return _read_content(kind, name, data, binary)


def _read_content(kind: str, name: str, data: bytes, binary: _BinaryReader) -> tuple[LogTable, ...]:
    return (read_text_table(name, data),) if kind == TEXT else binary.read_bytes(kind, name, data)


def _read_archive(name: str, source: bytes | Path, binary: _BinaryReader) -> tuple[LogTable, ...]:
    def read_file(label: str, data: bytes) -> tuple[LogTable, ...]:
        return _read_content(kind_of(label, data[:4096]), label, data, binary)

    def read_bag(label: str, folder: Path) -> tuple[LogTable, ...]:
        return binary.read_path("db3", label, folder)

    return read_archive(name, source, read_file, read_bag)


def _read_path(path: Path, name: str, binary: _BinaryReader) -> tuple[LogTable, ...]:
    try:
        if path.is_dir():
            if not (path / "metadata.yaml").is_file():
                raise JointIdError(
                    f"{name} is a folder without metadata.yaml, so no ROS 2 bag. Give the log file "
                    "itself."
                )
            size = sum(part.stat().st_size for part in path.iterdir() if part.is_file())
            require_small(name, size)
            return binary.read_path("db3", name, path)
        if not path.is_file():
            raise JointIdError(f"{path!s:.200}: there is no such file. Check the path.")
        require_small(name, path.stat().st_size)
        with path.open("rb") as file:
            head = file.read(4096)
            kind = kind_of(name, head)
            if is_zip(head) and is_archive(name, path):
                return _read_archive(name, path, binary)
            if kind != TEXT:
                endings = {
                    "db3": ".db3",
                    "mcap": ".mcap",
                    "bag": ".bag",
                }  # what the reader of bags goes by
                if path.suffix == endings.get(kind, path.suffix):
                    return binary.read_path(kind, name, path)
            file.seek(0)
            data = file.read(MAX_LOG_BYTES + 1)
        require_small(name, len(data))
        return _read_content(kind, name, data, binary)
    except (OSError, ValueError) as error:
        if isinstance(error, JointIdError):
            raise
        raise JointIdError(
            f"{path!s:.200} cannot be opened ({error!s:.200}): check its permissions."
        ) from error


class _BinaryReader:
    """Hands binary logs to the process that reads them; content without a path gets a file for it."""

    def __init__(self) -> None:
        self._reader = SeparateReader()
        self._folder: TemporaryDirectory[str] | None = None

    def read_path(self, kind: str, name: str, path: Path) -> tuple[LogTable, ...]:
        return self._reader.read(kind, name, path.absolute())

    def read_bytes(self, kind: str, name: str, data: bytes) -> tuple[LogTable, ...]:
        if self._folder is None:
            self._folder = TemporaryDirectory(prefix="jointid-")
        path = Path(self._folder.name, f"log.{kind}")
        path.write_bytes(data)
        try:
            return self.read_path(kind, name, path)
        finally:
            path.unlink(missing_ok=True)

    def close(self) -> None:
        self._reader.stop()
        if self._folder is not None:
            self._folder.cleanup()
