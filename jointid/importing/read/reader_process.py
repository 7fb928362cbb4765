"""Read logs: small text tables here, others in a child process with bounded memory and time.

Libraries that parse binary formats in C can crash on a damaged file, or allocate any amount of memory.
The response is JSON and plain numbers, not a pickle: the files are untrusted.
"""

import os
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from jointid.background.child_process import Child, Ended, Limits
from jointid.background.serving import Progress, serve_here
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogColumn, LogTable
from jointid.importing.read.readers import TEXT, kind_of, readers
from jointid.importing.read.text.tables import read_text_table

LIMITS = Limits(time_s=120.0, memory_bytes=3 << 30)
"""Per file; a log of the largest size, 256 MiB, takes half the memory."""
_SMALL_TEXT = 4 << 20
"""Bytes of a text table that takes a few seconds at most, read without a process."""


class ReaderProcess:
    """Child process that reads logs within limits; started lazily, restarted after a crash."""

    def __init__(self, limits: Limits = LIMITS) -> None:
        self._limits = limits
        self._child = Child(__name__, limits)
        self._folder = tempfile.TemporaryDirectory(prefix="jointid-")

    def read_content(self, name: str, data: bytes) -> tuple[LogTable, ...]:
        """Read the content of one file; all but small text goes through a temporary file."""
        kind = kind_of(name, data[:4096])
        if kind == TEXT and len(data) <= _SMALL_TEXT:
            return (replace(read_text_table(name, data), read_as=readers()[TEXT].name),)
        path = Path(self._folder.name, f"log.{kind}")
        path.write_bytes(data)
        try:
            return self.read(kind, name, path)
        finally:
            path.unlink(missing_ok=True)

    def read(self, kind: str, name: str, path: Path) -> tuple[LogTable, ...]:
        """Read one file or folder of a kind, a key of ``readers()``.

        Raises JointIdError when it is no log, crashes the process, or exceeds the limits.
        """
        place = {"path": str(path.absolute()), "scratch": self._folder.name}
        try:
            header, body = self._child.ask({"kind": kind, "name": name} | place)
        except Ended as ended:
            late = f"reading it took more than {self._limits.time_s:g} s"
            fault = late if ended.late else "its content crashes the reader"
            raise JointIdError(
                f"{name} cannot be read as {readers()[kind].name} ({fault}): it is damaged or too "
                "large. Export it again, or cut it into several logs."
            ) from ended
        if "error" in header:
            raise JointIdError(header["error"])
        return tuple(replace(t, read_as=readers()[kind].name) for t in _tables(header, body))

    def close(self) -> None:
        """End the process and remove temporary files."""
        self._child.stop()
        self._folder.cleanup()


def _tables(header: dict[str, Any], body: bytes) -> tuple[LogTable, ...]:
    """Tables from a response of the worker: their description, and all columns in sequence."""
    tables, offset = [], 0
    for table in header["tables"]:
        rows, columns = table.pop("rows"), []
        for name, unit in table.pop("columns"):
            values = np.frombuffer(body, np.float64, rows, offset)
            offset += values.nbytes
            columns.append(LogColumn(name, values, unit))
        tables.append(LogTable(columns=tuple(columns), **table))
    return tuple(tables)


def answer(request: dict[str, Any], _: bytes, progress: Progress) -> tuple[dict[str, Any], bytes]:
    """Read one file; return the description of its tables with all columns, or an error."""
    kind, name, path = request["kind"], request["name"], request["path"]
    tempfile.tempdir = request["scratch"]  # removed by the parent
    try:
        tables = readers()[kind].read(name, path)
        if not tables:
            raise JointIdError(f"{name} has no numbers: a log needs at least position and torque.")
        stated = ("name", "notes", "first_row", "row_word", "rows")
        described = [
            {key: getattr(table, key) for key in stated}
            | {"columns": [[column.name, column.unit] for column in table.columns]}
            for table in tables
        ]
        values = (column.values.data for table in tables for column in table.columns)
        return {"tables": described}, b"".join(values)
    except JointIdError as error:
        message = str(error)
    except MemoryError:
        message = f"{name} needs more memory than the limit for logs. Cut it into several logs."
    except BaseException as error:  # readers written in Rust raise outside Exception
        reason = " ".join(str(error).replace(path, "the file").split()) or type(error).__name__
        message = (
            f"{name} cannot be read as {readers()[kind].name} ({reason:.200}): export the log again."
        )
    return {"error": message}, b""


def main(memory_bytes: int) -> None:
    """Serve on standard input and output."""
    os.environ["HDF5_PLUGIN_PRELOAD"] = "::"  # HDF5 loads no plugin for a filter that a file asks for
    serve_here(answer, memory_bytes)
