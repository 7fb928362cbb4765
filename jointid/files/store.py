"""Persistent workspace storage: named pieces of data in a folder, shared by any number of processes.

An unguessable id gives access to a workspace. Each entry is a few files:

    workspaces/<hash of the workspace's id>/<entry>.data      the data, never changed
    workspaces/<hash of the workspace's id>/<entry>.json      digest, size, checksum; commits the entry
    workspaces/<hash of the workspace's id>/<entry>.name      the latest name, after a renaming
    workspaces/<hash of the workspace's id>/<entry>.note      the reason why an entry is gone
    damaged/                                                  unreadable entries, in quarantine

Every file is written atomically, without locks: the data precede their .json and are removed after it.
The modification time of a data file is the time of its last use.

Files, not SQLite: an entry of 1 GiB exceeds SQLite's blob limit; a damaged file costs one entry, a
damaged database can cost all; network drives without locks work; removing an entry frees its space at
once, where a database on a full disk needs as much again for a VACUUM.
"""

import json
import os
import re
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path

from jointid.errors import JointIdError
from jointid.files.container_limits import mebibytes
from jointid.files.store_files import (
    DAMAGED,
    Entry,
    checksum,
    latest_name,
    one_line,
    part_of,
    read_entry,
    write_entry,
    write_name,
    write_whole,
)

LIMIT_BYTES = 1 << 30
"""Default capacity of a store, 1 GiB."""
PARTS = ("import", "mappings", "fleet", "corrections")
"""Parts of a workspace other than its studies, see ``part_of``."""

_WORKSPACE = re.compile(r"[A-Za-z0-9_-]{32}")
_ENTRY = re.compile(r"[0-9a-f]{32}")
_LEFT_OVER_S = 3600.0
"""Age at which an incomplete entry counts as left over by a crash: no write takes that long."""
_ENDINGS = (".json", ".data", ".name")  # files of an entry, in the order of their removal
_TOUCH_EVERY_S = 60.0  # resolution of the time of last use


def new_workspace() -> str:
    """Return a new id of 192 random bits, for use in an URL."""
    return secrets.token_urlsafe(24)


@dataclass(frozen=True)
class Store:
    """A folder of workspaces, created with the first entry.

    Every method raises ``JointIdError`` when the folder cannot be read or written, or an id is invalid.
    """

    folder: Path
    limit_bytes: int = LIMIT_BYTES
    """Capacity; beyond it the least recently used entries are dropped, with a note."""

    def known(self, workspace: str) -> bool:
        """Whether a text is the id of an existing workspace."""
        if not _WORKSPACE.fullmatch(workspace):
            return False
        places = (workspace, *(part_of(workspace, part) for part in PARTS))
        return any(self._place(place).is_dir() for place in places)

    def entries(self, workspace: str) -> tuple[Entry, ...]:
        """Return the entries of a workspace, newest first; set damaged ones aside with a note."""
        place, found = self._place(workspace), []
        with self._failing("read"):
            for file in place.glob("*.json"):
                if not _ENTRY.fullmatch(file.stem):
                    continue
                why = ""
                try:
                    found.append(read_entry(file))
                except FileNotFoundError:  # without a .json it was deleted meanwhile
                    why = "its data are missing" if file.exists() else ""
                except DAMAGED:
                    why = "its description or its size is wrong"
                if why:
                    with suppress(JointIdError):  # on a read-only disk the others are still readable
                        self.set_aside(workspace, file.stem, why)
        return tuple(sorted(found, key=lambda entry: (entry.created_s, entry.id), reverse=True))

    def put(self, workspace: str, name: str, digest: str, data: bytes) -> Entry:
        """Store data under the caller's key of their content; they are on the disk when this returns.

        An entry with the same digest moves to the front under the new name, which is cut to ``MAX_NAME``
        characters. Raises JointIdError when the data exceed the capacity of the store, or cannot be
        written.
        """
        place = self._place(workspace)
        if len(data) > self.limit_bytes:
            raise JointIdError(
                f"{name} needs {mebibytes(len(data))}; the store holds {mebibytes(self.limit_bytes)}: "
                "shorten the records."
            )
        same = [entry.id for entry in self.entries(workspace) if entry.digest == digest]
        with self._failing("written"):
            self._make_room(len(data))
            place.mkdir(mode=0o700, parents=True, exist_ok=True)
            kept = write_entry(place / f"{secrets.token_hex(16)}.json", name, digest, data)
            for id_ in same:
                self._remove(place / f"{id_}.json")
            self._make_room(0, spare=kept.id)
        return kept

    def read(self, workspace: str, entry: str) -> bytes:
        """Return an entry's data and update the time of its last use.

        Raises JointIdError when there is no such entry, or its data are damaged; these are set aside.
        """
        file = self._file(workspace, entry)
        with self._failing("read"):
            try:
                data, meta = file.with_suffix(".data").read_bytes(), read_entry(file)
            except (FileNotFoundError, *DAMAGED):
                self.entries(workspace)  # sets it aside, when it is damaged
                raise JointIdError("The entry is no longer in the store: open its file again.") from None
        if checksum(data) != meta.checksum:
            self.set_aside(workspace, entry, "its checksum is wrong")
            raise JointIdError(
                f'The stored copy of "{meta.name}" is damaged: its checksum is wrong. It was set '
                f"aside in {self.folder / 'damaged'}; open its file again."
            )
        self.touch(workspace, meta)
        return data

    def touch(self, workspace: str, entry: Entry) -> None:
        """Update the time of an entry's last use, to the minute."""
        if time.time() - entry.opened_s > _TOUCH_EVERY_S:
            with suppress(OSError):
                os.utime(self._file(workspace, entry.id).with_suffix(".data"))

    def rename(self, workspace: str, entry: str, name: str) -> None:
        """Rename an entry; of two simultaneous renamings the last one wins.

        Raises JointIdError when the name is empty, or there is no such entry.
        """
        if not (new_name := one_line(name)):
            raise JointIdError("The name is empty: give at least one character.")
        file = self._file(workspace, entry)
        with self._failing("written"):
            if file.exists():
                write_name(file, new_name)
            if not file.exists():  # deleted meanwhile
                file.with_suffix(".name").unlink(missing_ok=True)
                raise JointIdError("This study is no longer in the store: open its file again.")

    def delete(self, workspace: str, entry: str) -> None:
        """Remove an entry, if it exists."""
        with self._failing("written"):
            self._remove(self._file(workspace, entry))

    def set_aside(self, workspace: str, entry: str, why: str) -> None:
        """Move an unusable entry to the folder ``damaged`` and leave a note."""
        file, aside = self._file(workspace, entry), self.folder / "damaged"
        with self._failing("written"):
            aside.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._leave_note(file, f"was damaged ({why}) and set aside in {aside}. Open its file again.")
            for ending in _ENDINGS:
                part = file.with_suffix(ending)
                with suppress(FileNotFoundError):
                    part.replace(aside / part.name)

    def notes(self, workspace: str) -> dict[str, str]:
        """Return why entries were dropped or set aside, as sentences by their ids, oldest first."""
        found = []
        with self._failing("read"):
            for file in self._place(workspace).glob("*.note"):
                with suppress(FileNotFoundError):
                    text = file.read_text("utf-8", "replace")
                    found.append((file.stat().st_mtime, file.stem, text))
        return {entry: text for _, entry, text in sorted(found)}

    def dismiss(self, workspace: str, note: str) -> None:
        """Remove a note."""
        with self._failing("written"):
            self._file(workspace, note).with_suffix(".note").unlink(missing_ok=True)

    def size_bytes(self) -> int:
        """Size of all workspaces and damaged entries, bytes."""
        with self._failing("read"):
            return sum(size for size, _, _ in self._all())

    def _place(self, workspace: str) -> Path:
        """Folder of a workspace: a hash hides the id and keeps the path inside the store."""
        if not _WORKSPACE.fullmatch(workspace):
            raise JointIdError(f'"{workspace[:40]}" is not the id of a workspace.')
        return self.folder / "workspaces" / blake2b(workspace.encode(), digest_size=16).hexdigest()

    def _file(self, workspace: str, entry: str) -> Path:
        if not _ENTRY.fullmatch(entry):
            raise JointIdError(f'"{entry[:40]}" is not the id of a study in the store.')
        return self._place(workspace) / f"{entry}.json"

    def _all(self) -> Iterator[tuple[int, float, Path]]:
        """Size, time and path of every file."""
        for file in [*self.folder.glob("workspaces/*/*"), *self.folder.glob("damaged/*")]:
            with suppress(FileNotFoundError):
                stat = file.stat()
                yield stat.st_size, stat.st_mtime, file

    def _make_room(self, needed: int, *, spare: str = "") -> None:
        """Drop left-over files of crashes, then damaged entries, then the least recently used ones."""
        files, now = list(self._all()), time.time()
        for _, changed, file in files:
            left = file.suffix == ".new" or (
                file.suffix in (".data", ".name")
                and file.parent.name != "damaged"
                and not file.with_suffix(".json").exists()
            )
            if left and now - changed > _LEFT_OVER_S:
                file.unlink(missing_ok=True)
        total = sum(size for size, _, file in files if file.exists()) + needed
        droppable = [row for row in files if row[2].suffix == ".data" and row[2].stem != spare]
        droppable.sort(key=lambda row: (row[2].parent.name != "damaged", row[1]))
        for size, _, file in droppable:
            if total <= self.limit_bytes:
                break
            if not file.exists():
                continue
            if file.parent.name != "damaged":
                self._leave_note(
                    file,
                    f"was deleted: the store was full ({mebibytes(self.limit_bytes)}), and this study "
                    "was the least recently opened.",
                )
            self._remove(file.with_suffix(".json"))
            total -= size

    def _remove(self, file: Path) -> None:
        for ending in _ENDINGS:
            file.with_suffix(ending).unlink(missing_ok=True)

    def _leave_note(self, file: Path, what: str) -> None:
        try:
            name = latest_name(file) or str(json.loads(file.with_suffix(".json").read_bytes())["name"])
        except (OSError, *DAMAGED):
            name = ""
        name = one_line(name) or "A stored study"
        write_whole(file.with_suffix(".note"), f"{name} {what}".encode("utf-8", "replace"))

    @contextmanager
    def _failing(self, what: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise JointIdError(
                f"The store {self.folder} cannot be {what}: {error.strerror or error}. Free space, "
                "correct the permissions, or name another folder in JOINTID_DATA_DIR."
            ) from error
