"""Parquet files: the numeric columns, times of day as seconds."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pa_parquet  # type: ignore[import-untyped]

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogColumn, LogTable, numbers, require_few_values
from jointid.importing.columns.units import split_unit, unit_of
from jointid.wording import listed


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the numeric columns of a Parquet file.

    Parameters
    ----------
    file : str
        Its name, for messages.
    path : str
        Where it lies.

    Raises
    ------
    JointIdError
        When it has no rows, or fewer than two columns of numbers.
    """
    source = pa_parquet.ParquetFile(pa.BufferReader(Path(path).read_bytes()))
    schema = source.schema_arrow
    names = [field.name for field in schema if _is_number(field.type)]
    require_few_values(file, source.metadata.num_rows * max(1, len(names)))
    if len(set(names)) < len(names):
        raise JointIdError(
            f"{file} has several columns of one name: rename them. Names: {listed(names)}."
        )
    table = source.read(columns=names, use_pandas_metadata=False)
    columns = []
    for name in names:
        column = table.column(name)
        metadata = schema.field(name).metadata or {}
        bare, unit = split_unit(name)
        stated = metadata.get(b"unit", metadata.get(b"units", b"")).decode(errors="replace")
        if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
            per_second = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[column.type.unit]
            ticks = column.cast(pa.int64())
            first = next((tick.as_py() for tick in ticks if tick.is_valid), 0)
            values = (ticks.to_numpy(zero_copy_only=False) - first) / per_second
            columns.append(LogColumn(name, numbers(values), "s", name))
            continue
        values = column.cast(pa.float64(), safe=False).to_numpy()
        columns.append(LogColumn(bare, numbers(values), unit_of(stated) or unit, name))
    left_out = [field.name for field in schema if not _is_number(field.type)]
    notes = (f"Columns without numbers, left out: {listed(left_out)}.",) if left_out else ()
    return (LogTable(file, tuple(columns), notes),)


def _is_number(kind: pa.DataType) -> bool:
    types = pa.types
    tests = (
        types.is_floating,
        types.is_integer,
        types.is_decimal,
        types.is_timestamp,
        types.is_duration,
    )
    return any(test(kind) for test in tests)
