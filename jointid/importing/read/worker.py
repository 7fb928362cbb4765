"""The process that reads binary logs: whatever a damaged file does to it, the caller lives on.

Libraries that parse binary formats in C can end the process over a damaged file, or ask for any amount
of memory. Requests come as lines of JSON on standard input; each answer is a line of JSON, then the
columns.
"""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any, BinaryIO

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogTable


def read_binary(kind: str, name: str, path: str) -> tuple[LogTable, ...]:
    """Read a log of a known binary kind in this very process.

    Raises
    ------
    Exception
        Whatever the library raises; ``serve`` turns it into a message.
    """
    if kind in ("hdf5", "db3", "mcap", "bag"):
        if kind == "hdf5":
            from jointid.importing.read.hdf5 import read_hdf5

            return read_hdf5(name, path)
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


def answer(request: dict[str, str]) -> tuple[dict[str, Any], tuple[LogTable, ...]]:
    """Read one file; the header says what follows, or what is wrong."""
    kind, name = request["kind"], request["name"]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tables = read_binary(kind, name, request["path"])
    except JointIdError as error:
        return {"error": str(error)}, ()
    except MemoryError:
        return {
            "error": f"{name} asks for more memory than a log may take: it is damaged or too large."
        }, ()
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # readers written in Rust raise outside Exception
        reason = (
            " ".join(str(error).replace(request["path"], "the file").split()) or type(error).__name__
        )
        return {
            "error": f"{name} cannot be read as {WORDS[kind]} ({reason:.200}): export the log again."
        }, ()
    header = {
        "tables": [
            {
                "name": table.name,
                "rows": table.rows,
                "columns": [[c.name, c.unit, c.where] for c in table.columns],
                "notes": table.notes,
                "first_row": table.first_row,
                "row_word": table.row_word,
            }
            for table in tables
        ]
    }
    return header, tables


WORDS = {
    "matlab": "a MATLAB file",
    "parquet": "Parquet",
    "hdf5": "HDF5",
    "excel": "a workbook",
    "db3": "a ROS 2 bag",
    "mcap": "MCAP",
    "bag": "a ROS 1 bag",
}
"""What a user calls each kind."""


def limit_memory(size: int) -> None:
    """Bound this process's memory where the system can; where not, the limits of each reader remain."""
    try:
        import resource
    except ImportError:  # Windows
        return
    try:
        resource.setrlimit(resource.RLIMIT_AS, (size, size))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ValueError, OSError):
        return


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests until there are none."""
    for line in requests:
        header, tables = answer(json.loads(line))
        answers.write(json.dumps(header).encode() + b"\n")
        for table in tables:
            for column in table.columns:
                answers.write(column.values.tobytes())
        answers.flush()
