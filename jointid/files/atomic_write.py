"""Files that appear complete or not at all."""

import os
import re
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from jointid.errors import JointIdError

_FRESH = re.compile(r"\.[0-9a-f]{16}\.new")
_UNLOCKED_S = 10.0
"""A file is locked long before this age."""
_LEFT_OVER_S = 3600.0
"""No write takes so long: for systems without locks."""


@contextmanager
def new_file(path: Path, *, private: bool = False) -> Iterator[BinaryIO]:
    """Open a binary file that replaces ``path`` at the end of the block, unless the block fails.

    The data reach the disk before the name does: after a crash or a power cut ``path`` holds the old
    content or the new one. A ``private`` file is readable by this user only. Raises OSError when it
    cannot be written; the previous file is unchanged.
    """
    remove_left_over(path.parent)
    fresh = path.with_name(f".{secrets.token_hex(8)}.new")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    handle = os.open(fresh, flags, 0o600 if private else 0o666)
    try:
        with os.fdopen(handle, "wb") as file:
            locked(file)
            yield file
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(path)
        _sync_folder(path.parent)
    except BaseException:
        with suppress(OSError):
            fresh.unlink()
        raise


def write_file(path: Path, data: bytes) -> None:
    """Write a file atomically. Raises JointIdError when it cannot be written."""
    require_folder(path)
    try:
        with new_file(path) as file:
            file.write(data)
    except OSError as error:
        raise write_error(path, error) from error


def require_folder(path: Path) -> None:
    """Raise JointIdError when the folder of a new file does not exist."""
    if not path.parent.is_dir():
        raise JointIdError(f"{path.parent} is not a folder: create it first, or choose another path.")


def write_error(path: Path, error: OSError) -> JointIdError:
    """Return the error for a file that cannot be written."""
    return JointIdError(
        f"{path} cannot be written: {error.strerror or error}.",
        file=str(path),
        hint="Free space, check the permissions, or choose another path.",
    )


def locked(file: int | BinaryIO) -> bool | None:
    """Lock an open file until its process ends or closes it; None where the system has no locks."""
    try:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except (ImportError, OSError):  # Windows, some network drives
        return None
    return True


def remove_left_over(folder: Path) -> None:
    """Remove files of killed writes: those with a free lock."""
    for left in folder.glob(".*.new"):
        with suppress(OSError):
            age = time.time() - left.stat().st_mtime
            if not _FRESH.fullmatch(left.name) or age < _UNLOCKED_S:
                continue
            handle = os.open(left, os.O_RDONLY)
            try:
                free = locked(handle)
            finally:
                os.close(handle)
            if free or (free is None and age > _LEFT_OVER_S):
                shutil.rmtree(left) if left.is_dir() else left.unlink()


def _sync_folder(folder: Path) -> None:
    """Make a renaming survive a power cut, where the system can."""
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        with suppress(OSError):  # some network drives cannot
            os.fsync(handle)
        os.close(handle)
