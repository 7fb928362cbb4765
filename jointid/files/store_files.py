"""Files of a store's entries: atomic writing, checked reading."""

from __future__ import annotations

import json
import os
import sys
import time
from base64 import urlsafe_b64encode
from contextlib import suppress
from dataclasses import asdict, dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any

from jointid.files.atomic_write import new_file

MAX_NAME = 120
"""Longest name of an entry, characters."""


def user_folder() -> Path:
    """Return the default folder of a store: JOINTID_DATA_DIR, else the user's data directory."""
    if chosen := os.environ.get("JOINTID_DATA_DIR"):
        return Path(chosen)
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or "~/AppData/Local"
    elif sys.platform == "darwin":
        base = "~/Library/Application Support"
    else:
        base = os.environ.get("XDG_DATA_HOME") or "~/.local/share"
    return Path(base).expanduser() / "jointid"


def part_of(workspace: str, part: str) -> str:
    """Return the id of a part of a workspace, derived from the workspace's secret id."""
    digest = blake2b(f"{workspace} {part}".encode(), digest_size=24).digest()
    return urlsafe_b64encode(digest).decode()


@dataclass(frozen=True)
class Entry:
    """A piece of data in a workspace."""

    id: str
    """32 hexadecimal digits."""
    name: str
    """Displayed name; need not be unique."""
    digest: str
    """The caller's key of the content."""
    size_bytes: int
    checksum: str
    """Checksum of the written data."""
    created_s: float
    """Seconds since 1970."""
    opened_s: float
    """Time of the last use, seconds since 1970."""


@dataclass(frozen=True)
class Note:
    """Reason why an entry is gone."""

    id: str
    text: str


def read_entry(file: Path) -> Entry:
    """Read an entry's .json and compare it with its data's size.

    Raises
    ------
    OSError
        When one of them is missing or cannot be read.
    ValueError, KeyError, TypeError, RecursionError
        When the .json is damaged, or the data have another size.
    """
    meta: dict[str, Any] = json.loads(file.read_bytes())
    stat = file.with_suffix(".data").stat()
    entry = Entry(
        id=file.stem,
        name=latest_name(file) or str(meta["name"]),
        digest=str(meta["digest"]),
        size_bytes=int(meta["size_bytes"]),
        checksum=str(meta["checksum"]),
        created_s=float(meta["created_s"]),
        opened_s=stat.st_mtime,
    )
    if meta.get("format") != 1 or entry.size_bytes != stat.st_size:
        raise ValueError(file.name)
    return entry


def holds(file: Path, data: bytes) -> bool:
    """Whether a file holds exactly these bytes."""
    try:
        return file.stat().st_size == len(data) and file.read_bytes() == data
    except FileNotFoundError:
        return False


def write_entry(file: Path, name: str, digest: str, data: bytes) -> Entry:
    """Write an entry's data, unless they exist, then its .json, which commits the entry.

    Parameters
    ----------
    file : Path
        Path of the .json; the data are beside it.
    name, digest : str
        As for ``Store.put``.
    data : bytes
    """
    now = time.time()
    entry = Entry(file.stem, one_line(name), digest, len(data), checksum(data), now, now)
    there = holds(file.with_suffix(".data"), data)
    if not there:
        write_whole(file.with_suffix(".data"), data)
    meta = {key: value for key, value in asdict(entry).items() if key not in ("id", "opened_s")}
    write_whole(file, json.dumps({"format": 1} | meta).encode())
    if there:
        file.with_suffix(".name").unlink(missing_ok=True)
        with suppress(FileNotFoundError):
            os.utime(file.with_suffix(".data"))
        if not file.with_suffix(".data").exists():  # another process removed it meanwhile
            write_whole(file.with_suffix(".data"), data)
    return entry


def write_whole(file: Path, data: bytes) -> None:
    """Write a file complete or not at all, readable by this user only."""
    with new_file(file, private=True) as stream:
        stream.write(data)


def latest_name(file: Path) -> str:
    """Return an entry's name after a renaming, else an empty text."""
    try:
        return one_line(file.with_suffix(".name").read_text("utf-8", "replace"))
    except FileNotFoundError:
        return ""


def one_line(name: str) -> str:
    """Return a name as one line of at most ``MAX_NAME`` printable characters."""
    return " ".join("".join(c if c.isprintable() else " " for c in name).split())[:MAX_NAME]


def checksum(data: bytes) -> str:
    """Return 32 hexadecimal digits (blake2b)."""
    return blake2b(data, digest_size=16).hexdigest()


def changed_s(file: Path) -> float:
    """Return a file's modification time, seconds since 1970; 0 when it is gone."""
    try:
        return file.stat().st_mtime
    except FileNotFoundError:
        return 0.0


def size_text(size: int) -> str:
    """Return bytes as "1.5 MiB"."""
    return f"{size / 2**20:.3g} MiB"
