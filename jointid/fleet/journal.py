"""Finished rows of a running batch: an append-only file beside the table, one JSON line a row.

A line that a full disk or a power cut truncated is dropped when the batch resumes; damage elsewhere
costs one row. An SQLite database needs the same code for errors, removal and foreign files, can lose
every row to one damaged page, and fails on network drives without locks.
"""

import json
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from jointid.errors import JointIdError
from jointid.files.atomic_write import locked, write_error
from jointid.fleet.row import Row, from_plain, to_plain
from jointid.fleet.table import as_table, require_values

_HEAD = b'{"jointid fleet journal": 1}\n'


class Journal:
    """An append-only file of rows, held by one process at a time; it is created when missing.

    Raises JointIdError when another process holds it, it is no journal, or cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = self._held()
        try:
            self.rows = tuple(self._read())
        except BaseException:
            self._file.close()
            raise

    def add(self, row: Row) -> None:
        """Append a row; it is on the disk when this returns."""
        line = json.dumps(to_plain(row), ensure_ascii=False).encode("utf-8", "surrogatepass") + b"\n"
        try:
            self._file.write(line)
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise JointIdError(
                f"{self.path} cannot be written: {error.strerror or error}. Its rows are kept: free "
                "space, then run the same command again."
            ) from error

    def clear(self) -> None:
        """Drop the rows."""
        self._file.truncate(len(_HEAD))
        self.rows = ()

    def remove(self) -> None:
        """Remove the file, when its rows are in the table."""
        if os.name == "nt":  # cannot remove an open file; elsewhere the lock must outlast it
            self.close()
        with suppress(OSError):
            self.path.unlink()
        self.close()

    def close(self) -> None:
        """Close the file; remove it when it has no row."""
        with suppress(OSError, ValueError):  # ValueError: closed already
            here = os.fstat(self._file.fileno())
            if here.st_size <= len(_HEAD) and os.path.samestat(self.path.stat(), here):
                self.path.unlink()
        with suppress(OSError):
            self._file.close()

    def _held(self) -> BinaryIO:
        """Open and lock the file; the lock ends with the process."""
        try:
            while True:
                file = self.path.open("ab+")
                if locked(file) is False:
                    file.close()
                    raise JointIdError(
                        f"{self.path} is being written by another batch: wait for it, or choose another "
                        "file for the results."
                    )
                with suppress(FileNotFoundError):
                    if os.path.samestat(self.path.stat(), os.fstat(file.fileno())):
                        return file
                file.close()  # the batch that held it has just removed it
        except OSError as error:
            raise write_error(self.path, error) from error

    def _read(self) -> Iterator[Row]:
        """Rows of the complete lines; cut off the rest."""
        self._file.seek(0)
        data = self._file.read()
        whole = data.rfind(b"\n") + 1
        if not data.startswith(_HEAD):
            if not _HEAD.startswith(data):
                raise JointIdError(
                    f"{self.path} is not the journal of a batch: move it, or choose another file for "
                    "the results."
                )
            whole = 0
        self._file.truncate(whole)
        if whole == 0:
            self._file.write(_HEAD)
            self._file.flush()
            os.fsync(self._file.fileno())
        for line in data[len(_HEAD) : whole].splitlines():
            # The study of a damaged line is analysed again. Deep nesting raises a RecursionError.
            with suppress(AttributeError, TypeError, ValueError, OverflowError, RecursionError):
                row = from_plain(json.loads(line.decode("utf-8", "surrogatepass")))
                require_values(as_table([row]))  # which refuses values of another type
                yield row
