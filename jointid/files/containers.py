"""A folder or a zip archive as a safe read-only set of named bytes: links out of it are refused.

Archives are untrusted: nothing is unpacked to disk, names that leave the archive are refused, and the
unpacked size is limited by the directory and again while reading, because a directory can be forged.
"""

import io
import os
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import BinaryIO, TypeAlias

from jointid.errors import JointIdError
from jointid.files.container_limits import (
    CHUNK,
    MAX_RATIO,
    Budget,
    chunks,
    is_clutter,
    mebibytes,
    require_few_files,
    safe_name,
)
from jointid.wording import capitalised, listed, nearest

Source: TypeAlias = str | os.PathLike[str] | bytes | bytearray | memoryview | BinaryIO
"""A folder or .zip by its path, or a zip as bytes or as an open binary file (an upload)."""

_ARCHIVE = "the archive"  # name of an archive from bytes, in messages


class MissingFileError(JointIdError):
    """A file that is not in its container."""


@contextmanager
def open_container(source: Source, *, marker: str) -> "Iterator[Container]":
    """Open a folder or a zip archive for reading; instead of a folder, the marker in it may be given.

    The marker is the file that marks the root. An archive whose files all lie in one top folder that
    holds the marker is read from that folder. Raises JointIdError when there is nothing there, or it is
    not a folder or a safe, readable archive.
    """
    try:
        if isinstance(source, str | os.PathLike):
            path = Path(source)
            if _is_folder(path):
                yield Folder(path)
                return
            if path.name == marker:
                yield Folder(path.parent)
                return
            with path.open("rb") as file:
                yield Zip(file, path.name, marker)
        elif isinstance(source, bytes | bytearray | memoryview):
            yield Zip(io.BytesIO(source), _ARCHIVE, marker)
        elif _is_binary_file(source):
            yield Zip(source, PurePosixPath(str(getattr(source, "name", ""))).name or _ARCHIVE, marker)
        else:
            raise JointIdError(
                "A study comes from a path, bytes or an open binary file, not from "
                f"{type(source).__name__}."
            )
    except JointIdError as error:
        if error.file == _ARCHIVE:  # its message begins with this name
            raise JointIdError(capitalised(str(error)), file=_ARCHIVE) from error
        raise


def _is_binary_file(source: object) -> bool:
    has_methods = all(hasattr(source, method) for method in ("read", "seek", "tell"))
    return has_methods and not isinstance(source, io.TextIOBase)


def _is_folder(path: Path) -> bool:
    try:
        if path.is_dir():
            return True
        if path.is_file():
            path.open("rb").close()
            return False
        fault = "no such file or folder"
    except (OSError, ValueError) as error:
        fault = f"it cannot be opened ({error!s:.200})"
    raise JointIdError(
        f"{path!s:.200}: {fault}. Give a study's folder, or that folder as .zip.", file=str(path)
    )


class Folder:
    """A folder of files that exists."""

    def __init__(self, path: Path) -> None:
        self.name = path.name or str(path)
        self._root = path.resolve()
        self._budget = Budget(self.name)

    def names(self) -> tuple[str, ...]:
        """Return the names of all files at any depth, sorted."""
        found: list[str] = []
        for folder, folders, files in os.walk(self._root):
            folders.sort()
            found += [Path(folder, file).relative_to(self._root).as_posix() for file in files]
            require_few_files(self.name, len(found))
        return tuple(sorted(name for name in found if not is_clutter(name)))

    def read(self, name: str, *, at_most: int | None = None) -> bytes:
        """Return a file's bytes, all of them or the first ``at_most``."""
        with self._readable(name) as target, target.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            wanted = size if at_most is None else min(size, at_most)
            self._budget.spend(wanted, name)
            return file.read(wanted)

    def path(self, name: str) -> Path:
        """Return a file's path, for reading in parts."""
        with self._readable(name) as target:
            return target

    @contextmanager
    def _readable(self, name: str) -> Iterator[Path]:
        name = safe_name(name)
        try:
            target = (self._root / name).resolve(strict=True)
            if not target.is_relative_to(self._root):
                raise JointIdError(
                    f"{name} is a link that leaves {self.name}: put the file itself into the folder.",
                    file=name,
                )
            if not target.is_file():  # a pipe or device could block forever
                raise JointIdError(
                    f"{name} in {self.name} is not a regular file: put the file itself into the folder.",
                    file=name,
                )
            yield target
        except (FileNotFoundError, NotADirectoryError):
            raise missing(name, self) from None
        except (OSError, RuntimeError) as error:
            raise JointIdError(
                f"{name} in {self.name} cannot be read: {error!s:.200}. Check its permissions.",
                file=name,
            ) from error


MAX_DIRECTORY_BYTES = 4 << 20
"""Largest directory of an archive: bounds the work of opening one with millions of names."""

_DAMAGE = (zipfile.BadZipFile, zlib.error, struct.error)
_ZIP_FAULTS = (*_DAMAGE, EOFError, OSError, OverflowError, RuntimeError, ValueError)


class Zip:
    """A zip archive; for the file that marks the root see ``open_container``."""

    def __init__(self, file: BinaryIO, name: str, marker: str) -> None:
        self.name = name
        self._budget = Budget(name)
        try:
            self._zip = zipfile.ZipFile(_DirectoryGuard(file))
            members = self._zip.infolist()
        except _ZIP_FAULTS as error:
            raise JointIdError(
                f"{name} is not a readable zip archive; it is damaged or incomplete ({error!s:.200}). "
                "Give the study's folder, or that folder as .zip, or convert logs with jointid convert.",
                file=name,
            ) from error
        self._check_sizes(members)
        self._members: dict[str, zipfile.ZipInfo] = {}
        for member in members:
            path = self._checked_name(member)
            if member.is_dir():
                continue
            if path in self._members:
                raise JointIdError(f"{name} lists {path} twice: create the archive again.", file=name)
            self._members[path] = member
        self._members = {path: m for path, m in self._members.items() if not is_clutter(path)}
        tops = {PurePosixPath(name).parts[0] for name in self._members}
        top = next(iter(tops)) if len(tops) == 1 else ""
        if marker not in self._members and f"{top}/{marker}" in self._members:
            self._members = {name[len(top) + 1 :]: m for name, m in self._members.items()}

    def names(self) -> tuple[str, ...]:
        """Return the names of all files, sorted."""
        return tuple(sorted(self._members))

    def read(self, name: str, *, at_most: int | None = None) -> bytes:
        """Return a file's bytes, all of them or the first ``at_most``."""
        name = safe_name(name)
        member = self._members.get(name)
        if member is None:
            raise missing(name, self)
        data = bytearray()
        try:
            with self._zip.open(member) as file:
                for chunk in chunks(file, at_most):
                    self._budget.spend(len(chunk), name)
                    data += chunk
        except JointIdError:
            raise
        except _ZIP_FAULTS as error:
            raise JointIdError(
                f"{name} in {self.name} is damaged ({error!s:.200}): create the archive again.",
                file=name,
            ) from error
        return bytes(data)

    def path(self, name: str) -> None:
        """Return None: a member of an archive has no path."""

    def _check_sizes(self, members: list[zipfile.ZipInfo]) -> None:
        require_few_files(self.name, len(members))
        self._budget.require(sum(member.file_size for member in members))
        for member in members:
            if member.file_size > CHUNK and member.file_size > MAX_RATIO * member.compress_size:
                raise JointIdError(
                    f"{member.filename!r:.200} in {self.name} would unpack to "
                    f"{mebibytes(member.file_size)}, more than {MAX_RATIO} times its packed size; "
                    "measurements never compress that well. Give the folder instead."
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
            raise JointIdError(f"{path} in {self.name} is encrypted: create it without a password.")
        # Other methods can ask for gigabytes of working memory before the first byte.
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise JointIdError(
                f"{path} in {self.name} is packed with method {member.compress_type}: "
                "create the archive with ordinary (deflate) compression."
            )
        return path


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


Container: TypeAlias = Folder | Zip
"""Named bytes; names use "/" and are relative to the container's root."""


def missing(name: str, container: Container, taken: Iterable[str] = ()) -> MissingFileError:
    """Return the error for a missing file; suggest the most similar name that is not taken."""
    names, used = container.names(), set(taken)
    similar = nearest(name, [other for other in names if other not in used])
    return MissingFileError(
        f"{name} is missing in {container.name}.{similar} Files found: {listed(names)}.", file=name
    )
