"""A zip archive as a safe read-only set of named bytes.

Archives are untrusted: nothing is unpacked to disk, names that leave the archive are refused, and the
unpacked size is limited by the directory and again while reading, because a directory can be forged.
"""

from __future__ import annotations

import stat
import struct
import sys
import zipfile
import zlib
from pathlib import PurePosixPath
from typing import BinaryIO

from jointid.errors import JointIdError
from jointid.files.container_limits import (
    Budget,
    is_clutter,
    mebibytes,
    missing,
    require_few_files,
    safe_name,
)

MAX_RATIO = 200
"""Largest compression ratio of a member above 1 MiB; measurements stay below 20."""
MAX_DIRECTORY_BYTES = 4 << 20
"""Largest directory of an archive: bounds the work of opening one with millions of names."""

_CHUNK = 1 << 20
_ZIP_FAULTS = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    OSError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
    ValueError,
    struct.error,
)


class Zip:
    """A zip archive.

    Parameters
    ----------
    file : binary file
    name : str
        Its name in messages.
    marker : str
        File that marks the root; see ``open_container``.
    """

    def __init__(self, file: BinaryIO, name: str, marker: str) -> None:
        self.name = name
        self._budget = Budget(name)
        try:
            self._zip = zipfile.ZipFile(_DirectoryGuard(file))
            members = self._zip.infolist()
        except _ZIP_FAULTS as error:
            raise JointIdError(
                f"{name} is not a readable zip archive; it is damaged or incomplete ({error!s:.200}). "
                "Give the study's folder, or that folder as .zip.",
                file=name,
            ) from error
        self._check_sizes(members)
        self._members: dict[str, zipfile.ZipInfo] = {}
        for member in members:
            path = self._checked_name(member)
            if member.is_dir():
                continue
            if path in self._members:
                raise JointIdError(f"{name} lists {path} twice: make the archive again.", file=name)
            self._members[path] = member
        self._members = {path: m for path, m in self._members.items() if not is_clutter(path)}
        self._step_into_top_folder(marker)

    def names(self) -> tuple[str, ...]:
        """Return the names of all files, sorted."""
        return tuple(sorted(self._members))

    def read(self, name: str, *, at_most: int | None = None) -> bytes:
        """Return a file's bytes, all of them or the first ``at_most``."""
        name = safe_name(name)
        member = self._members.get(name)
        if member is None:
            raise missing(name, self)
        left = sys.maxsize if at_most is None else at_most
        chunks = []
        try:
            with self._zip.open(member) as file:
                while left > 0 and (chunk := file.read(min(_CHUNK, left))):
                    self._budget.spend(len(chunk), name)
                    left -= len(chunk)
                    chunks.append(chunk)
        except JointIdError:
            raise
        except _ZIP_FAULTS as error:
            raise JointIdError(
                f"{name} in {self.name} is damaged ({error!s:.200}): make the archive again.", file=name
            ) from error
        return b"".join(chunks)

    def path(self, name: str) -> None:
        """Return None: a member of an archive has no path."""

    def _check_sizes(self, members: list[zipfile.ZipInfo]) -> None:
        require_few_files(self.name, len(members))
        self._budget.require(sum(member.file_size for member in members))
        for member in members:
            if member.file_size > _CHUNK and member.file_size > MAX_RATIO * member.compress_size:
                raise JointIdError(
                    f"{member.filename!r:.200} in {self.name} would unpack to "
                    f"{mebibytes(member.file_size)}, more than {MAX_RATIO} times its packed size, which "
                    "measurements never do. Give the folder instead."
                )

    def _checked_name(self, member: zipfile.ZipInfo) -> str:
        name = member.orig_filename  # as stored: .filename is cut at the first NUL
        try:
            path = safe_name(name)
        except JointIdError as error:
            raise error.within(self.name) from None
        if stat.S_ISLNK(member.external_attr >> 16):
            raise JointIdError(f"{path} in {self.name} is a link: put the file itself into the archive.")
        if member.flag_bits & 0x1:
            raise JointIdError(
                f"{path} in {self.name} is encrypted: make the archive without a password."
            )
        # Other methods can ask for gigabytes of working memory before the first byte.
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise JointIdError(
                f"{path} in {self.name} is packed with method {member.compress_type}: "
                "make the archive with ordinary (deflate) compression."
            )
        return path

    def _step_into_top_folder(self, marker: str) -> None:
        """Remove the folder from the names, in an archive of one folder."""
        tops = {PurePosixPath(name).parts[0] for name in self._members}
        top = next(iter(tops)) if len(tops) == 1 else ""
        if marker not in self._members and f"{top}/{marker}" in self._members:
            self._members = {name[len(top) + 1 :]: m for name, m in self._members.items()}


class _DirectoryGuard:
    """A binary file that refuses the one huge read by which a forged archive directory is loaded."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.seek, self.tell = file.seek, file.tell

    def seekable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        if size > MAX_DIRECTORY_BYTES:
            raise zipfile.BadZipFile(f"its directory of {mebibytes(size)} is too large")
        return self._file.read(size)
