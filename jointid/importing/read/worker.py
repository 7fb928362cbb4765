"""Child process that reads binary logs, isolated from its caller.

Libraries that parse binary formats in C can crash on a damaged file, or allocate any amount of memory.
The response is JSON and plain numbers, not a pickle: the files come from strangers.
"""

from __future__ import annotations

import os
from typing import Any

from jointid.background.serving import Progress, serve_here
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogTable
from jointid.importing.read.readers import readers


def answer(request: dict[str, Any], _: bytes, progress: Progress) -> tuple[dict[str, Any], bytes]:
    """Read one file; return the description of its tables with all columns, or an error."""
    kind, name, path = request["kind"], request["name"], request["path"]
    try:
        tables = readers()[kind].read(name, path)
        return {"tables": [_described(table) for table in tables]}, b"".join(
            column.values.data for table in tables for column in table.columns
        )
    except JointIdError as error:
        message = str(error)
    except MemoryError:
        message = f"{name} asks for more memory than a log may take: it is damaged or too large."
    except BaseException as error:  # readers written in Rust raise outside Exception
        reason = " ".join(str(error).replace(path, "the file").split()) or type(error).__name__
        message = (
            f"{name} cannot be read as {readers()[kind].name} ({reason:.200}): export the log again."
        )
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
