"""Files of a store's entries: atomic writing, checked reading."""

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
from jointid.wording import printable

MAX_NAME = 120
"""Longest name of an entry, characters."""
DAMAGED = (ValueError, KeyError, TypeError, RecursionError)
"""Exceptions for a damaged .json of an entry."""


_USUAL = {"win32": ("LOCALAPPDATA", "AppData/Local"), "darwin": ("", "Library/Application Support")}


def user_folder() -> Path:
    """Return the default folder of a store: JOINTID_DATA_DIR, else the user's data directory."""
    if chosen := os.environ.get("JOINTID_DATA_DIR"):
        return Path(chosen)
    variable, usual = _USUAL.get(sys.platform, ("XDG_DATA_HOME", ".local/share"))
    stated = Path(os.environ.get(variable, ""))  # a relative one is invalid
    return (stated if stated.is_absolute() else _home() / usual) / "jointid"


def _home() -> Path:
    """Home of this account, also where a service runs with an empty or relative HOME."""
    if os.name == "posix" and not os.path.isabs(os.environ.get("HOME", "")):
        with suppress(ImportError, KeyError):
            import pwd

            return Path(pwd.getpwuid(os.getuid()).pw_dir)
    return Path.home()


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


def read_entry(file: Path) -> Entry:
    """Read an entry's .json and compare it with its data's size.

    Raises OSError when one of them is missing or cannot be read; DAMAGED when the .json is damaged, or
    the data have another size.
    """
    meta: dict[str, Any] = json.loads(file.read_bytes())
    if "seal" in meta and meta.pop("seal") != _seal(meta):  # entries of version 0.1 have none
        raise ValueError(file.name)
    stat = file.with_suffix(".data").stat()
    if meta.pop("format", None) != 1 or meta["size_bytes"] != stat.st_size:
        raise ValueError(file.name)
    meta["name"], meta["created_s"] = latest_name(file) or str(meta["name"]), float(meta["created_s"])
    return Entry(id=file.stem, opened_s=stat.st_mtime, **meta)


def write_entry(file: Path, name: str, digest: str, data: bytes) -> Entry:
    """Write an entry's data, then its .json beside them, which commits the entry."""
    now = time.time()
    entry = Entry(file.stem, one_line(name), digest, len(data), checksum(data), now, now)
    write_whole(file.with_suffix(".data"), data)
    meta = {key: value for key, value in asdict(entry).items() if key not in ("id", "opened_s")}
    meta["format"] = 1
    write_whole(file, json.dumps(meta | {"seal": _seal(meta)}).encode())
    return entry


def write_whole(file: Path, data: bytes) -> None:
    """Write a file complete or not at all, readable by this user only."""
    with new_file(file, private=True) as stream:
        stream.write(data)


def latest_name(file: Path) -> str:
    """Return an entry's name after a renaming, else an empty text; also for a damaged one."""
    try:
        name, _, seal = file.with_suffix(".name").read_text("utf-8", "replace").partition("\n")
    except FileNotFoundError:
        return ""
    return one_line(name) if not seal or seal == checksum(name.encode()) else ""


def write_name(file: Path, name: str) -> None:
    """Write an entry's new name beside its .json, with a checksum."""
    data = name.encode("utf-8", "replace")
    write_whole(file.with_suffix(".name"), data + f"\n{checksum(data)}".encode())


def one_line(name: str) -> str:
    """Return a name as one line of at most ``MAX_NAME`` printable characters."""
    return " ".join(printable(name).split())[:MAX_NAME]


def _seal(meta: dict[str, Any]) -> str:
    """Checksum of an entry's description, its name included."""
    return checksum(json.dumps(meta, sort_keys=True).encode())


def checksum(data: bytes) -> str:
    """Return 32 hexadecimal digits (blake2b)."""
    return blake2b(data, digest_size=16).hexdigest()
