"""A fleet's rows as one Parquet table, and back to the last bit."""

import io
import json
from collections.abc import Sequence
from dataclasses import fields
from itertools import chain
from pathlib import Path
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pa_parquet  # type: ignore[import-untyped]

from jointid.background.child_process import Child, Ended, Limits
from jointid.errors import JointIdError
from jointid.estimation.estimators.parameters import PARAMETERS
from jointid.fleet.jobs import WORKER
from jointid.fleet.row import MAX_JOINTS, Row, from_plain

MAX_ROWS = 1_000_000
"""Most rows of a table that is read; larger ones must be split."""

_KIND = {b"kind": b"jointid fleet", b"format": b"1"}
_HEAD = ("study", "name", "robot", "date", "origin", "joints", "records")
_OF_SPRINGS = ("K", "K_error", "D", "D_error", "K_nominal", "D_nominal")
_JOINTWISE = {name: f"{name[0]}{{}}{name[1:]}" for name in _OF_SPRINGS}
_JOINTWISE |= {"coulomb": "coulomb{}_Nm", "viscous": "viscous{}_Nms_rad"}
_TAIL = tuple(f.name for f in fields(Row) if f.name not in (*_HEAD, *_JOINTWISE))
_ARROW_TYPES: dict[object, Any] = {
    str: pa.string(),
    int: pa.int32(),
    float: pa.float64(),
    float | None: pa.float64(),
    tuple[str, ...]: pa.list_(pa.string()),
}
_OPTIONAL = ("delay_s", "delay_error_s", "misfit", "findings")
"""Columns that may have no value."""
_TYPES = {f.name: _ARROW_TYPES[f.type] for f in fields(Row) if f.name not in _JOINTWISE}


def to_parquet(rows: Sequence[Row]) -> bytes:
    """Return a table as the bytes of a Parquet file; its columns are K1, K1_error, D1 and so on."""
    buffer = io.BytesIO()
    pa_parquet.write_table(as_table(rows), buffer)
    return buffer.getvalue()


def as_table(rows: Sequence[Row]) -> Any:
    """Return rows as an Arrow table; joints beyond a study's number are null."""
    joints = max((row.joints for row in rows), default=0)
    columns, schema = [], []

    def add(name: str, values: list[Any], kind: Any, unit: bytes = b"") -> None:
        columns.append(pa.array(values, kind))
        schema.append(pa.field(name, kind, metadata={b"unit": unit} if unit else None))

    for name in _HEAD:
        add(name, [_text(getattr(row, name)) for row in rows], _TYPES[name])
    add("state", [row.state for row in rows], pa.string())  # from the verdict, for other programs
    for j in range(joints):
        for name, column in _JOINTWISE.items():
            values = [v[j] if j < len(v := getattr(row, name)) else None for row in rows]
            unit = PARAMETERS[name.partition("_")[0]].unit.replace("·", ".")
            add(column.format(j + 1), values, pa.float64(), unit.encode())
    for name in _TAIL:
        values = [_text(getattr(row, name)) for row in rows]
        add(name, values, _TYPES[name], b"s" if name.endswith("_s") else b"")
    return pa.Table.from_arrays(columns, schema=pa.schema(schema, metadata=_KIND))


def read_fleet(source: Path | bytes) -> tuple[Row, ...]:
    """Return the rows of a table of ``to_parquet``.

    ``read_untrusted`` reads tables from unknown sources in a child process.

    Raises JointIdError when it cannot be read, or is not a table of a fleet's results.
    """
    name = "The table" if isinstance(source, bytes) else str(source)
    try:
        file = pa_parquet.ParquetFile(io.BytesIO(source) if isinstance(source, bytes) else source)
        held = (file.schema_arrow.metadata or {}).items()
        if not _KIND.items() <= held:
            raise JointIdError(f"{name} is not a results table: give a file of jointid batch.")
        if file.metadata.num_rows > MAX_ROWS:
            raise JointIdError(
                f"{name} has {file.metadata.num_rows} rows, more than the limit of {MAX_ROWS}: split it."
            )
        own, there = (*_HEAD, *_TAIL), file.schema_arrow.names
        if missing := [column for column in own if column not in there]:
            raise JointIdError(f"{name} has no column {missing[0]}: run the batch again.")
        of_joints = {
            quantity: [c for j in range(MAX_JOINTS) if (c := column.format(j + 1)) in there]
            for quantity, column in _JOINTWISE.items()
        }
        present = [*own, *chain.from_iterable(of_joints.values())]
        kinds = pa.schema([(column, _TYPES.get(column, pa.float64())) for column in present])
        rows: list[Row] = []
        for batch in file.iter_batches(columns=present, use_threads=False):
            table = pa.Table.from_batches([batch]).select(present).cast(kinds)
            require_values(table)
            rows += [_row(values, of_joints, name) for values in table.to_pylist()]
    except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
        if isinstance(error, JointIdError):
            raise
        raise JointIdError(
            f"{name} cannot be read as Parquet ({error!s:.200}). Run the batch again."
        ) from error
    return tuple(rows)


def require_values(table: Any) -> None:
    """Raise ValueError when a column that every row fills has a gap."""
    for name in (*_HEAD, *_TAIL):
        if name not in _OPTIONAL and table.column(name).null_count:
            raise ValueError(f"{name} has no value")


def _row(values: dict[str, Any], of_joints: dict[str, list[str]], name: str) -> Row:
    """The row of a table's line; ``of_joints`` are the columns of the quantities of joints."""
    plain = {column: values[column] for column in (*_HEAD, *_TAIL)}
    plain["findings"] = tuple(values["findings"] or ())
    for quantity, columns in of_joints.items():
        plain[quantity] = tuple(values[c] for c in columns if values[c] is not None)
    try:
        return from_plain(plain)
    except (TypeError, ValueError) as error:
        raise JointIdError(
            f"{name} was changed: {values['study']!s:.60} has {error!s:.160}. Run the batch again."
        ) from error


def _text(value: Any) -> Any:
    """A value without surrogates, which a table cannot hold."""
    if isinstance(value, str):
        return value.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    if isinstance(value, tuple):
        return [_text(item) for item in value]
    return value


_LIMITS = Limits(time_s=60.0, memory_bytes=2 << 30)


def read_untrusted(data: bytes) -> tuple[Row, ...]:
    """Return the rows of a table of a fleet's results from any bytes.

    Raises JointIdError when it is another kind of file, damaged, or needs too much memory or time.
    """
    child = Child(WORKER, _LIMITS)
    try:
        answer, body = child.ask({"do": "read"}, data)
    except Ended as ended:
        raise JointIdError(f"The table is damaged: run the batch again. {ended}") from None
    finally:
        child.stop()
    if "error" in answer:
        raise JointIdError(answer["error"])
    return tuple(from_plain(row) for row in json.loads(body))
