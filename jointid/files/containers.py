"""A folder or a zip archive as a safe read-only set of named bytes: links out of it are refused."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import BinaryIO, TypeAlias

from jointid.errors import JointIdError
from jointid.files.container_limits import (
    Budget,
    Container,
    is_clutter,
    missing,
    require_few_files,
    safe_name,
)
from jointid.files.zip_files import Zip
from jointid.wording import capitalised

__all__ = ["Container", "Source", "open_container"]

Source: TypeAlias = str | os.PathLike[str] | bytes | bytearray | memoryview | BinaryIO
"""A folder or .zip by its path, or a zip as bytes or as an open binary file (an upload)."""

_ARCHIVE = "the archive"
"""Name of an archive from bytes, in messages."""


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
        fault = "nothing is there"
    except (OSError, ValueError) as error:
        fault = f"it cannot be opened ({error!s:.200})"
    raise JointIdError(
        f"{path!s:.200}: {fault}. Give a study's folder, or that folder as .zip.", file=str(path)
    )


class Folder:
    """A folder of files.

    Parameters
    ----------
    path : Path
        An existing folder.
    """

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
                    f"{name} in {self.name} is no ordinary file: put the file itself into the folder.",
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
