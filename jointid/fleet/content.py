"""The files of a study on disk: their digest, and one zip of them to send."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from typing import BinaryIO

import pyarrow.parquet as pa_parquet  # type: ignore[import-untyped]

from jointid.errors import JointIdError
from jointid.files.container_limits import MAX_TOTAL_BYTES
from jointid.files.containers import open_container
from jointid.files.csv_tables import ARROW_FAULTS
from jointid.files.study_parts import is_long
from jointid.files.study_saving import STUDY_FILE

_RECORDS = (".csv", ".parquet")
_CHUNK = 1 << 20


def content_digest(source: Path | bytes) -> str:
    """Return a key that changes with any byte of a study's files.

    Parameters
    ----------
    source : Path or bytes
        A folder or a .zip by its path, or the zip itself. Of a folder, only study.toml and the tables
        count.

    Returns
    -------
    str
        32 hexadecimal digits (blake2b).

    Raises
    ------
    JointIdError
        When the path does not exist, or the folder cannot be listed.
    OSError
        When a zip cannot be read.
    """
    state = blake2b(digest_size=16)
    if isinstance(source, bytes):
        state.update(source)
    elif source.is_dir():
        for name, file in _files(source):
            size, fault, held = 0, "", None
            try:
                if isinstance(file, JointIdError):
                    raise file
                held = file.open("rb")
                size = os.fstat(held.fileno()).st_size
            except (JointIdError, OSError) as error:
                fault = str(error)
            state.update(f"{name}\0{size}\0{fault}\0".encode("utf-8", "surrogateescape"))
            if held is not None:
                with held:
                    for chunk in _chunks(held, size):
                        state.update(chunk)
    else:
        with source.open("rb") as archive:
            for chunk in _chunks(archive):
                state.update(chunk)
    return state.hexdigest()


def packed(path: Path) -> bytes:
    """Return a study as one zip: a .zip unchanged, a folder's study.toml and tables uncompressed.

    Raises
    ------
    JointIdError
        When the path does not exist, the folder cannot be listed, a file cannot be read, a record is so
        long that it is read in parts, or the files exceed the limit of an archive.
    OSError
        When a zip cannot be read.
    """
    if not path.is_dir():
        return path.read_bytes()
    buffer, left = io.BytesIO(), MAX_TOTAL_BYTES
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, file in _files(path):
            if isinstance(file, JointIdError):  # a link to nowhere: missing there too
                continue
            try:
                with file.open("rb") as held:
                    size = os.fstat(held.fileno()).st_size
                    left -= size
                    if left < 0 or _is_long(name, file):
                        raise _too_long(path, name)
                    with archive.open(zipfile.ZipInfo(name), "w") as member:
                        for chunk in _chunks(held, size):
                            member.write(chunk)
            except OSError as error:
                raise JointIdError(
                    f"{name} in {path} cannot be read: {error.strerror or error}."
                ) from error
    return buffer.getvalue()


def _is_long(name: str, file: Path) -> bool:
    """Whether a record of as many joints as its columns say is read in parts."""
    if name.lower().endswith(".parquet"):
        with suppress(*ARROW_FAULTS):  # the reader reports the fault
            columns = pa_parquet.read_schema(file).names
            return is_long(name, file, sum(column.startswith("theta_m") for column in columns))
    return False


def _too_long(folder: Path, name: str) -> JointIdError:
    return JointIdError(
        f"{folder} cannot be sent to a cluster, {name} is too long. Analyse it on this computer, "
        "without a scheduler: here it is read in parts when it is Parquet."
    )


def _files(folder: Path) -> Iterator[tuple[str, Path | JointIdError]]:
    """Name and path of every file of a study, or the error instead of the path."""
    with open_container(folder, marker=STUDY_FILE) as container:
        for name in container.names():
            if name != STUDY_FILE and not name.lower().endswith(_RECORDS):
                continue
            try:
                place = container.path(name)
            except JointIdError as error:
                yield name, error
                continue
            assert place is not None  # a folder's file lies somewhere
            yield name, place


def _chunks(file: BinaryIO, size: int | None = None) -> Iterator[bytes]:
    """The bytes of a file, or its first ``size``; at most _CHUNK at a time."""
    left = size
    while left is None or left > 0:
        chunk = file.read(_CHUNK if left is None else min(_CHUNK, left))
        if not chunk:
            return
        left = None if left is None else left - len(chunk)
        yield chunk
