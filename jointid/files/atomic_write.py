"""Files that appear complete or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from jointid.errors import JointIdError


@contextmanager
def new_file(path: Path, *, private: bool = False) -> Iterator[BinaryIO]:
    """Open a binary file that replaces ``path`` at the end of the block, unless the block fails.

    The data reach the disk before the name does: after a crash or a power cut ``path`` holds the old
    content or the new one.

    Parameters
    ----------
    path : Path
        File to write or replace.
    private : bool, default False
        Whether only this user may read it.

    Raises
    ------
    OSError
        When it cannot be written; the file of before is unchanged.
    """
    fresh = path.with_name(f".{secrets.token_hex(8)}.new")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    handle = os.open(fresh, flags, 0o600 if private else 0o666)
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(path)
        _sync_folder(path.parent)
    except BaseException:
        with suppress(OSError):
            fresh.unlink()
        raise


def write_error(path: Path, error: OSError) -> JointIdError:
    """Return the error for a file that cannot be written."""
    return JointIdError(
        f"{path} cannot be written: {error.strerror or error}.",
        file=str(path),
        hint="Make room or check the permissions, or choose another path.",
    )


def _sync_folder(folder: Path) -> None:
    """Make a renaming survive a power cut, where the system can."""
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        with suppress(OSError):  # some network drives cannot
            os.fsync(handle)
        os.close(handle)
