"""Parquet files: the numeric columns, times of day as seconds."""

from __future__ import annotations

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pa_parquet  # type: ignore[import-untyped]

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogColumn, LogTable, numbers, require_few_values
from jointid.importing.columns.units import split_unit, unit_of
from jointid.wording import listed


def read_parquet(file: str, data: bytes) -> tuple[LogTable, ...]:
    """Read the numeric columns of a Parquet file.

    Parameters
    ----------
    file : str
        Its name, for messages.
    data : bytes

    Raises
    ------
    JointIdError
        When it has no rows, or fewer than two columns of numbers.
    """
    source = pa_parquet.ParquetFile(pa.BufferReader(data))
    schema = source.schema_arrow
    wanted = [k for k, kind in enumerate(schema.types) if _is_number(kind)]
    require_few_values(file, source.metadata.num_rows * max(1, len(wanted)))
    names = [schema.names[k] for k in wanted]
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
        stated = next(
            (metadata[key].decode(errors="replace") for key in (b"unit", b"units") if key in metadata),
            "",
        )
        if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
            per_second = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[column.type.unit]
            ticks = column.cast(pa.int64())
            first = next((tick.as_py() for tick in ticks if tick.is_valid), 0)
            values = (ticks.to_numpy(zero_copy_only=False) - first) / per_second
            columns.append(LogColumn(name, numbers(values), "s", name))
            continue
        values = column.cast(pa.float64(), safe=False).to_numpy()
        columns.append(LogColumn(bare, numbers(values), unit_of(stated) or unit, name))
    left_out = [name for k, name in enumerate(schema.names) if k not in wanted]
    notes = (f"Columns without numbers, left out: {listed(left_out)}.",) if left_out else ()
    return (LogTable(file, tuple(columns), notes),)


def _is_number(kind: pa.DataType) -> bool:
    types = pa.types
    return bool(
        types.is_floating(kind)
        or types.is_integer(kind)
        or types.is_decimal(kind)
        or types.is_timestamp(kind)
        or types.is_duration(kind)
    )
