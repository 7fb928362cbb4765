"""The files of a study on disk: their digest, and one zip of them to send."""

import io
import os
import zipfile
from hashlib import blake2b
from pathlib import Path

from jointid.errors import JointIdError
from jointid.files.container_limits import MAX_TOTAL_BYTES, chunks
from jointid.files.containers import Folder
from jointid.files.study_parts import STUDY_PARTS, is_long


def content_digest(source: Path | bytes) -> str:
    """Return a key, 32 hexadecimal digits (blake2b), that changes with any byte of a study's files.

    ``source`` is a folder or .zip by its path, or the zip itself. Of a folder, only study.toml, tables
    and robot models count. Raises JointIdError when the path does not exist, or the folder cannot be
    listed; OSError when a zip cannot be read.
    """
    state = blake2b(digest_size=16)
    if isinstance(source, bytes):
        state.update(source)
    elif source.is_dir():
        folder = Folder(source)
        for name in _names(folder):
            state.update(f"{name}\0".encode("utf-8", "surrogateescape"))
            try:
                with folder.path(name).open("rb") as file:
                    size = os.fstat(file.fileno()).st_size
                    state.update(f"{size}\0\0".encode())
                    for chunk in chunks(file, size):
                        state.update(chunk)
            except (JointIdError, OSError) as error:
                state.update(f"0\0{error}\0".encode("utf-8", "surrogateescape"))
    else:
        with source.open("rb") as archive:
            for chunk in chunks(archive):
                state.update(chunk)
    return state.hexdigest()


def packed(path: Path) -> bytes:
    """Return a study as one zip: a .zip unchanged, of a folder what ``content_digest`` counts.

    Raises JointIdError when the path does not exist, the folder cannot be listed, a file cannot be read,
    a record is so long that it is read in parts, or the files exceed the limit of an archive; OSError
    when a zip cannot be read.
    """
    if not path.is_dir():
        return path.read_bytes()
    buffer, left, folder = io.BytesIO(), MAX_TOTAL_BYTES, Folder(path)
    with zipfile.ZipFile(buffer, "w") as archive:
        for name in _names(folder):
            try:
                source = folder.path(name)
            except JointIdError:  # a link to nowhere: missing there too
                continue
            try:
                with source.open("rb") as file, archive.open(zipfile.ZipInfo(name), "w") as member:
                    size = os.fstat(file.fileno()).st_size
                    left -= size
                    if left < 0 or is_long(name, source):
                        raise JointIdError(
                            f"{path} cannot be sent to a cluster: {name} is too long. Analyse it on "
                            "this computer, without a scheduler: long Parquet files are then read in "
                            "parts."
                        )
                    for chunk in chunks(file, size):
                        member.write(chunk)
            except OSError as error:
                raise JointIdError(
                    f"{name} in {path} cannot be read: {error.strerror or error}."
                ) from error
    return buffer.getvalue()


def _names(folder: Folder) -> list[str]:
    """Files of a study among those of its folder."""
    return [name for name in folder.names() if name.lower().endswith(STUDY_PARTS)]
