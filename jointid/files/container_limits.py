"""Checks common to folders and archives: safe file names and size limits."""

import re
import sys
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import IO

from jointid.errors import JointIdError

MAX_TOTAL_BYTES = 1 << 30
"""Largest sum of the files read from one container, and largest single file, unpacked, bytes."""
MAX_RATIO = 200
"""Largest compression ratio above 1 MiB; measurements stay below 20."""
MAX_MEMBERS = 10_000
"""Most files in one container."""
CHUNK = 1 << 20
"""Most bytes read from a file at a time."""


def safe_name(name: str) -> str:
    """Return ``name`` as a plain relative path, or refuse it.

    Raises JointIdError when it is empty or absolute, has a drive letter, "..", a backslash or a control
    character.
    """
    path = PurePosixPath(name)
    if "\\" in name:
        fault = 'has a backslash: write folders with "/"'
    elif path.is_absolute() or re.match(r"[A-Za-z]:", name):
        fault = "is an absolute path: name files relative to the study's folder"
    elif ".." in path.parts:
        fault = 'leaves its folder with "..": keep all files inside the study\'s folder'
    elif not path.parts:
        fault = "names no file"
    elif any(ord(character) < 32 or ord(character) == 127 for character in name):
        fault = "has a control character: rename the file"
    else:
        return str(path)
    raise JointIdError(f"The file name {name!r:.200} {fault}.", file=name)


def is_clutter(name: str) -> bool:
    """Whether a file manager left this file behind."""
    parts = PurePosixPath(name).parts
    return "__MACOSX" in parts or parts[-1] == ".DS_Store" or parts[-1].startswith("._")


def require_few_files(container: str, count: int) -> None:
    """Refuse a container of more than ``MAX_MEMBERS`` files."""
    if count > MAX_MEMBERS:
        raise JointIdError(
            f"{container} holds more files than the limit of {MAX_MEMBERS}: give one study's folder, or "
            "that folder as .zip.",
            file=container,
        )


class Budget:
    """Bytes that may still be read from one container."""

    def __init__(self, container: str) -> None:
        self._container = container
        self.left = MAX_TOTAL_BYTES
        """Bytes that may still be read."""

    def require(self, size: int) -> None:
        """Refuse a container when the stated sizes of its files exceed the limit."""
        if size > self.left:
            raise JointIdError(
                f"{self._container} would unpack to {mebibytes(size)}, more than the limit of "
                f"{mebibytes(MAX_TOTAL_BYTES)}.",
                file=self._container,
                hint="Split the study, or log less data.",
            )

    def spend(self, size: int, name: str) -> None:
        """Count the bytes read of a file; refuse those beyond the limit."""
        self.left -= size
        if self.left < 0:
            raise JointIdError(
                f"{name} in {self._container}: the files unpack to more than the limit of "
                f"{mebibytes(MAX_TOTAL_BYTES)}.",
                file=name,
                hint="Split the study, log less data, or give its folder with the records as Parquet: "
                "long ones are read in parts.",
            )


def chunks(file: IO[bytes], size: int | None = None) -> Iterator[bytes]:
    """Yield the bytes of a file, or its first ``size``, in chunks of at most ``CHUNK``."""
    left = sys.maxsize if size is None else size
    while left > 0 and (chunk := file.read(min(CHUNK, left))):
        left -= len(chunk)
        yield chunk


def mebibytes(size: int) -> str:
    """Return a size in bytes as text: "1024 MiB"."""
    return f"{size / 2**20:.4g} MiB"
