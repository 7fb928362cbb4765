"""Child process that reads binary logs, isolated from its caller.

Libraries that parse binary formats in C can crash on a damaged file, or allocate any amount of memory.
The response is JSON and plain numbers, not a pickle: the files come from strangers.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from jointid.background.serving import Progress, serve_here
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogTable
from jointid.importing.read.file_types import TYPE_NAMES


def read_binary(kind: str, name: str, path: str) -> tuple[LogTable, ...]:
    """Read a log of a known binary kind in this process.

    Raises
    ------
    Exception
        Whatever the library raises; ``answer`` turns it into a message.
    """
    if kind == "hdf5":
        from jointid.importing.read.hdf5 import read_hdf5

        return read_hdf5(name, path)
    if kind in ("db3", "mcap", "bag"):
        from jointid.importing.read.ros import read_ros_bag

        return read_ros_bag(name, path, version=1 if kind == "bag" else 2)
    data = Path(path).read_bytes()
    if kind == "matlab":
        from jointid.importing.read.matlab import read_matlab

        return read_matlab(name, data)
    if kind == "parquet":
        from jointid.importing.read.parquet import read_parquet

        return read_parquet(name, data)
    from jointid.importing.read.excel import read_excel

    return read_excel(name, data)


def answer(request: dict[str, Any], _: bytes, progress: Progress) -> tuple[dict[str, Any], bytes]:
    """Read one file; return the description of its tables with all columns, or an error."""
    kind, name, path = request["kind"], request["name"], request["path"]
    try:
        tables = read_binary(kind, name, path)
        return {"tables": [_described(table) for table in tables]}, b"".join(
            column.values.data for table in tables for column in table.columns
        )
    except JointIdError as error:
        message = str(error)
    except MemoryError:
        message = f"{name} asks for more memory than a log may take: it is damaged or too large."
    except BaseException as error:  # readers written in Rust raise outside Exception
        reason = " ".join(str(error).replace(path, "the file").split()) or type(error).__name__
        message = f"{name} cannot be read as {TYPE_NAMES[kind]} ({reason:.200}): export the log again."
    return {"error": message}, b""


def _described(table: LogTable) -> dict[str, Any]:
    return {
        "name": table.name,
        "rows": table.rows,
        "columns": [[column.name, column.unit, column.where] for column in table.columns],
        "notes": table.notes,
        "first_row": table.first_row,
        "row_word": table.row_word,
    }


def main(memory_bytes: int) -> None:
    """Serve on standard input and output."""
    os.environ["HDF5_PLUGIN_PRELOAD"] = "::"  # HDF5 loads no plugin for a filter that a file asks for
    serve_here(answer, memory_bytes)
