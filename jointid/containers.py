"""A folder, or a zip archive, as a safe read-only set of named bytes.

Archives come from strangers: nothing is unpacked to disk, names that leave the archive are refused, and
what it may grow to is bounded by its directory and again while reading, because a directory can lie.
"""

from __future__ import annotations

import io
import os
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import BinaryIO, Protocol, TypeAlias

from jointid.errors import JointIdError
from jointid.wording import listed, nearest

Source: TypeAlias = str | os.PathLike[str] | bytes | bytearray | memoryview | BinaryIO
"""A folder or .zip by its path, or a zip as bytes or as an open binary file (an upload)."""

MAX_TOTAL_BYTES = 1 << 30
"""What may be read from one container, unpacked; also the largest single file."""
MAX_MEMBERS = 10_000
"""Files in one container."""
MAX_RATIO = 200
"""Unpacked over packed size of an archive member above 1 MiB; measured numbers stay below 20."""
MAX_DIRECTORY_BYTES = 4 << 20
"""Size of an archive's directory: bounds the work of opening one that holds millions of names."""

_ARCHIVE = "the archive"
"""What messages call an archive without a name."""

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


class Container(Protocol):
    """Named bytes; names use "/" and are relative to the container's root."""

    name: str
    """What messages call it."""

    def names(self) -> tuple[str, ...]:
        """Return the names of all files, sorted."""

    def read(self, name: str, *, at_most: int | None = None) -> bytes:
        """Return a file's bytes, all of them or the first ``at_most``."""

    def path(self, name: str) -> Path | None:
        """Return where a file lies by itself, to be read in parts; None inside an archive."""


@contextmanager
def open_container(source: Source, *, marker: str) -> Iterator[Container]:
    """Open a folder or a zip archive for reading.

    Instead of a folder, the marker in it may be given.

    Parameters
    ----------
    source : path, bytes or binary file
        A folder or .zip by its path, or a zip archive's content.
    marker : str
        File that marks the root. An archive whose files all lie in one top folder that holds
        the marker is read from that folder.

    Raises
    ------
    JointIdError
        When there is nothing there, or it is not a folder or a safe, readable archive.
    """
    try:
        if isinstance(source, str | os.PathLike):
            path = Path(source)
            if _is_folder(path):
                yield _Folder(path)
                return
            if path.name == marker:
                yield _Folder(path.parent)
                return
            with path.open("rb") as file:
                yield _Zip(file, path.name, marker)
        elif isinstance(source, bytes | bytearray | memoryview):
            yield _Zip(io.BytesIO(source), _ARCHIVE, marker)
        elif _is_binary_file(source):
            yield _Zip(source, PurePosixPath(str(getattr(source, "name", ""))).name or _ARCHIVE, marker)
        else:
            raise JointIdError(
                "A study comes from a path, bytes or an open binary file, not from "
                f"{type(source).__name__}."
            )
    except JointIdError as error:
        if str(error).startswith(_ARCHIVE):  # a message is a sentence
            raise JointIdError(_capital(str(error))) from error
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
        fault = "nothing is there"
    except (OSError, ValueError) as error:
        fault = f"it cannot be opened ({error!s:.200})"
    raise JointIdError(f"{path!s:.200}: {fault}. Give a study's folder, or that folder as .zip.")


def safe_name(name: str) -> str:
    """Return ``name`` as a plain relative path, or refuse it.

    Raises
    ------
    JointIdError
        When it is empty or absolute, has a drive letter, "..", a backslash or a control character.
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
    raise JointIdError(f"The file name {name!r:.200} {fault}.")


def _is_clutter(name: str) -> bool:
    """Tell what file managers leave behind."""
    parts = PurePosixPath(name).parts
    return "__MACOSX" in parts or parts[-1] == ".DS_Store" or parts[-1].startswith("._")


class _Budget:
    """How much may still be read from one container."""

    def __init__(self, container: str) -> None:
        self._container = container
        self._left = MAX_TOTAL_BYTES

    def spend(self, size: int, name: str) -> None:
        self._left -= size
        if self._left < 0:
            raise JointIdError(
                f"{name} in {self._container}: the files unpack to more than the limit of "
                f"{_mebibytes(MAX_TOTAL_BYTES)}. Split the study, log less, or give its folder with "
                "the records as Parquet: long ones are read in parts."
            )


def missing(name: str, container: Container, taken: Iterable[str] = ()) -> JointIdError:
    """Return the error for a file that is not there; suggest the most similar one that is not taken."""
    names, used = container.names(), set(taken)
    similar = nearest(name, [other for other in names if other not in used])
    return JointIdError(f"{name} is missing in {container.name}.{similar} Files found: {listed(names)}.")


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


class _Folder:
    def __init__(self, path: Path) -> None:
        self.name = path.name or str(path)
        self._root = path.resolve()
        self._budget = _Budget(self.name)

    def names(self) -> tuple[str, ...]:
        found: list[str] = []
        for folder, folders, files in os.walk(self._root):
            folders.sort()
            found += [Path(folder, file).relative_to(self._root).as_posix() for file in files]
            if len(found) > MAX_MEMBERS:
                raise JointIdError(
                    f"{self.name} holds more than {MAX_MEMBERS} files: give the folder of one study."
                )
        return tuple(sorted(name for name in found if not _is_clutter(name)))

    def read(self, name: str, *, at_most: int | None = None) -> bytes:
        with self._readable(name) as target, target.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            wanted = size if at_most is None else min(size, at_most)
            self._budget.spend(wanted, name)
            return file.read(wanted)

    def path(self, name: str) -> Path:
        with self._readable(name) as target:
            return target

    @contextmanager
    def _readable(self, name: str) -> Iterator[Path]:
        name = safe_name(name)
        try:
            target = (self._root / name).resolve(strict=True)
            if not target.is_relative_to(self._root):
                raise JointIdError(
                    f"{name} is a link that leaves {self.name}: put the file itself into the folder."
                )
            if not target.is_file():  # a pipe or device could block forever
                raise JointIdError(f"{name} in {self.name} is not a file.")
            yield target
        except (FileNotFoundError, NotADirectoryError):
            raise missing(name, self) from None
        except (OSError, RuntimeError) as error:
            raise JointIdError(f"{name} in {self.name} cannot be read: {error!s:.200}.") from error


class _Zip:
    def __init__(self, file: BinaryIO, name: str, marker: str) -> None:
        self.name = name
        self._budget = _Budget(name)
        try:
            self._zip = zipfile.ZipFile(_DirectoryGuard(file))
            members = self._zip.infolist()
        except _ZIP_FAULTS as error:
            raise JointIdError(
                f"{name} is not a readable zip archive; it is damaged or incomplete ({error!s:.200}). "
                "Give the study's folder, or that folder as .zip."
            ) from error
        self._check_sizes(members)
        self._members: dict[str, zipfile.ZipInfo] = {}
        for member in members:
            path = self._checked_name(member)
            if member.is_dir():
                continue
            if path in self._members:
                raise JointIdError(f"{name} lists {path} twice: make the archive again.")
            self._members[path] = member
        self._members = {path: m for path, m in self._members.items() if not _is_clutter(path)}
        self._step_into_top_folder(marker)

    def names(self) -> tuple[str, ...]:
        return tuple(sorted(self._members))

    def read(self, name: str, *, at_most: int | None = None) -> bytes:
        name = safe_name(name)
        member = self._members.get(name)
        if member is None:
            raise missing(name, self)
        left = MAX_TOTAL_BYTES if at_most is None else at_most
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
                f"{name} in {self.name} is damaged ({error!s:.200}): make the archive again."
            ) from error
        return b"".join(chunks)

    def path(self, name: str) -> None:
        return None

    def _check_sizes(self, members: list[zipfile.ZipInfo]) -> None:
        if len(members) > MAX_MEMBERS:
            raise JointIdError(
                f"{self.name} holds {len(members)} files, more than the limit of {MAX_MEMBERS}."
            )
        total = sum(member.file_size for member in members)
        if total > MAX_TOTAL_BYTES:
            raise JointIdError(
                f"{self.name} would unpack to {_mebibytes(total)}, more than the limit of "
                f"{_mebibytes(MAX_TOTAL_BYTES)}. Split the study, or log less."
            )
        for member in members:
            if member.file_size > _CHUNK and member.file_size > MAX_RATIO * member.compress_size:
                raise JointIdError(
                    f"{member.filename!r:.200} in {self.name} would unpack to more than {MAX_RATIO} "
                    "times its packed size, which measurements never do. Give the folder instead."
                )

    def _checked_name(self, member: zipfile.ZipInfo) -> str:
        name = member.orig_filename  # as stored: .filename is cut at the first NUL
        try:
            path = safe_name(name)
        except JointIdError as error:
            raise JointIdError(f"{self.name}: {error}") from None
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
        """People zip the folder itself: then every name starts with it."""
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
            raise zipfile.BadZipFile(f"its directory of {_mebibytes(size)} is too large")
        return self._file.read(size)


def _mebibytes(size: int) -> str:
    return f"{size / 2**20:.4g} MiB"
