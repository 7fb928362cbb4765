"""The files of a study as they lie on disk: their digest, and all of them in one piece to send."""

from __future__ import annotations

import io
import zipfile
from hashlib import blake2b
from pathlib import Path

from jointid.containers import open_container
from jointid.errors import JointIdError
from jointid.study_saving import STUDY_FILE

_RECORDS = (".csv", ".parquet")
_CHUNK = 1 << 20


def content_digest(source: Path | bytes) -> str:
    """Return a key that changes with any byte of a study's files.

    Parameters
    ----------
    source : Path or bytes
        A folder or a .zip by its path, or the zip itself. A folder's files are its study.toml and its
        tables; what else lies there does not matter.

    Returns
    -------
    str
        32 hexadecimal digits (blake2b).

    Raises
    ------
    JointIdError
        When nothing is there, or the folder cannot be listed.
    OSError
        When a zip cannot be read.
    """
    state = blake2b(digest_size=16)
    if isinstance(source, bytes):
        state.update(source)
    elif source.is_dir():
        for name, data, fault in _files(source):
            state.update(f"{name}\0{len(data)}\0{fault}\0".encode("utf-8", "surrogateescape") + data)
    else:
        with source.open("rb") as file:
            while chunk := file.read(_CHUNK):
                state.update(chunk)
    return state.hexdigest()


def packed(path: Path) -> bytes:
    """Return a study as one zip: a .zip as it is, a folder's study.toml and tables stored as they are.

    Raises
    ------
    JointIdError
        When nothing is there, or the folder cannot be listed.
    OSError
        When a zip cannot be read.
    """
    if not path.is_dir():
        return path.read_bytes()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data, fault in _files(path):
            if not fault:  # what cannot be read is missing there too
                archive.writestr(zipfile.ZipInfo(name), data)
    return buffer.getvalue()


def _files(folder: Path) -> list[tuple[str, bytes, str]]:
    """Name and bytes of every file that a study may consist of, or why it cannot be read."""
    found = []
    with open_container(folder, marker=STUDY_FILE) as container:
        for name in container.names():
            if name != STUDY_FILE and not name.lower().endswith(_RECORDS):
                continue
            try:
                found.append((name, container.read(name), ""))
            except JointIdError as error:
                found.append((name, b"", str(error)))
    return found
