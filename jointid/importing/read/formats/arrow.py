"""Parquet and Arrow (Feather) files: columns of numbers, of times, of lists of numbers, long tables."""

import io
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pa_compute  # type: ignore[import-untyped]
import pyarrow.csv as pa_csv  # type: ignore[import-untyped]
import pyarrow.parquet as pa_parquet  # type: ignore[import-untyped]

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.importing.columns.log_table import (
    MAX_COLUMNS,
    MAX_TABLES,
    LogColumn,
    LogTable,
    named_column,
    numbers,
    require_few_values,
    require_small,
)
from jointid.importing.read.array_tables import FEWEST_ROWS
from jointid.importing.read.formats.tidy import long_tables
from jointid.importing.read.reader import Reader, begins_with
from jointid.wording import listed

_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
_LONGEST_NUMBER = 24  # characters
_LONGEST_ROW = 1 << 16  # characters of a row of a long table
_MOST_TEXTS = 8


def read(open_as: str, file: str, path: str) -> tuple[LogTable, ...]:
    """Read the columns of numbers of a Parquet or Arrow file.

    A list of m numbers per row gives m columns. With few rows of long lists, each row is a run and gives
    a table. Rows that name their signal or joint are a long table.
    """
    with pa.memory_map(path) as source:
        table, left_out = _parquet(file, source) if open_as == "parquet" else _arrow(file, source)
    for _ in range(4):  # fields of structs become columns
        if any(pa.types.is_struct(field.type) for field in table.schema):
            table = table.flatten()
    if (long := _long(file, table)) is not None:
        return long
    kept = [field for field in table.schema if _is_number(field.type) or _is_list(field.type)]
    left_out = [*(field.name for field in table.schema if field not in kept), *left_out]
    notes = (f"Columns without numbers, left out: {listed(left_out)}.",) if left_out else ()
    rows, columns = table.num_rows, {field.name: table.column(field.name) for field in kept}
    lists = [field.name for field in kept if _is_list(field.type)]
    widths = {
        name: int(pa_compute.max(pa_compute.list_value_length(columns[name])).as_py() or 0)
        for name in lists
    }
    longest = max(widths.values(), default=0)
    del table  # a column at a time is copied below, and freed
    if longest >= FEWEST_ROWS and longest > rows:
        tables = [_run(file, columns, lists, row, notes) for row in range(min(rows, MAX_TABLES))]
        return tuple(run for run in tables if run is not None)
    require_few_values(file, rows * (len(kept) - len(lists) + sum(widths.values())))
    if sum(widths.values()) > MAX_COLUMNS:
        raise JointIdError(
            f"{file} has lists of {longest} numbers; the limit is {MAX_COLUMNS}: log fewer signals."
        )
    found: list[LogColumn] = []
    for field in kept:
        name, column = field.name, columns.pop(field.name).combine_chunks()
        about = field.metadata or {}
        stated = about.get(b"unit", about.get(b"units", b"")).decode(errors="replace")
        if name not in widths:
            found.append(_column(name, column, stated))
            continue
        lists_of = enumerate(_matrix(column, widths[name]).T, start=1)
        found += [named_column(name, values, stated, number=k) for k, values in lists_of]
    return (LogTable(file, tuple(found), notes),)


def _parquet(file: str, source: Any) -> tuple[Any, list[str]]:
    """Columns of a Parquet file that may hold numbers, and the names of the others."""
    schema = pa_parquet.read_schema(source)
    texts = [field.name for field in schema if _is_text(field.type)][:_MOST_TEXTS]
    parquet = pa_parquet.ParquetFile(source, read_dictionary=texts)  # a repeated text is held once
    metadata = parquet.metadata
    if len(set(schema.names)) < len(schema.names):
        raise JointIdError(
            f"{file} has several columns with the same name: rename them. Names: {listed(schema.names)}."
        )
    names = [
        f.name for f in schema if _is_number(f.type) or _is_list(f.type) or pa.types.is_struct(f.type)
    ]
    # The file states how many values it unpacks to, nested ones too.
    held = sum(
        metadata.row_group(g).column(c).num_values
        for g in range(metadata.num_row_groups)
        for c in range(metadata.num_columns)
        if metadata.row_group(g).column(c).path_in_schema.partition(".")[0] in names
    )
    require_few_values(file, max(held, metadata.num_rows))
    names += texts
    table = parquet.read(columns=names, use_pandas_metadata=False, use_threads=False)
    return table, [name for name in schema.names if name not in names]


def _long(file: str, table: Any) -> tuple[LogTable, ...] | None:
    """Tables of rows that name their signal or joint, read as those of a text; None for other rows."""
    texts = [field.name for field in table.schema if _is_text(field.type)]
    kept = [field.name for field in table.schema if _is_number(field.type) or _is_text(field.type)]
    words = [chunk.dictionary_encode().dictionary for name in texts for chunk in table[name].chunks]
    longest = [pa_compute.max(pa_compute.utf8_length(each)).as_py() or 0 for each in words]
    table = table.select(kept)
    width = len(texts) * max(longest, default=0) + _LONGEST_NUMBER * (len(kept) - len(texts))
    if not texts or width > _LONGEST_ROW or long_tables(file, _as_text(table.slice(0, 60))) is None:
        return None
    require_small(f"{file} as text", table.num_rows * width)
    return long_tables(file, _as_text(table))


def _as_text(table: Any) -> str:
    for place, field in enumerate(table.schema):
        column = table.column(place)
        if pa.types.is_timestamp(field.type) or pa.types.is_duration(field.type):
            column = _seconds(column)
            table = table.set_column(place, f"{field.name} [s]", pa.array(column))
        elif pa.types.is_dictionary(field.type):
            table = table.set_column(place, field.name, column.cast(pa.utf8()))
    buffer = io.BytesIO()
    pa_csv.write_csv(table, buffer, pa_csv.WriteOptions(delimiter="\t"))
    return buffer.getvalue().decode("utf-8", "replace")


def _arrow(file: str, source: Any) -> tuple[Any, list[str]]:
    try:
        reader = pa.ipc.open_file(source)
        batches: Iterator[Any] = (reader.get_batch(k) for k in range(reader.num_record_batches))
    except pa.ArrowInvalid:
        source.seek(0)
        reader = pa.ipc.open_stream(source)
        batches = iter(reader)
    kept, held = [], 0
    for batch in batches:
        batch.validate(full=True)  # offsets of a damaged file may lie outside of it
        held += batch.nbytes // 8
        require_few_values(file, held)
        kept.append(batch)
    return pa.Table.from_batches(kept, reader.schema), []


def _column(name: str, column: Any, stated: str) -> LogColumn:
    if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
        return LogColumn(name, numbers(_seconds(column)), "s")
    return named_column(name, _values(column), stated)


def _seconds(column: Any) -> Floats:
    """Times in seconds from the first."""
    ticks = column.cast(pa.int64())
    first = next((tick.as_py() for tick in ticks if tick.is_valid), 0)
    since = pa_compute.subtract(ticks, first)  # as integers: a float64 of 1.8e18 ns lacks digits
    return _values(since) / _PER_SECOND[column.type.unit]


def _values(column: Any) -> Floats:
    return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False))


def _matrix(column: Any, width: int) -> Floats:
    """Lists as rows, shape (N, width); short ones end in NaN."""
    lengths = np.asarray(pa_compute.fill_null(pa_compute.list_value_length(column), 0))
    values = _values(column.drop_null().flatten() if column.null_count else column.flatten())
    table = np.full((len(lengths), width), np.nan)
    table[np.arange(width) < lengths[:, None]] = values
    return table


def _run(
    file: str, columns: dict[str, Any], lists: list[str], row: int, notes: tuple[str, ...]
) -> LogTable | None:
    """Table of the lists in one row; None if they are too short or differ in length."""
    values = {name: columns[name][row].values for name in lists if columns[name][row].is_valid}
    sizes = {len(v) for v in values.values()}
    if len(sizes) != 1 or min(sizes) < FEWEST_ROWS or len(values) < 2:
        return None
    found = tuple(_column(name, part, "") for name, part in values.items())
    return LogTable(f"{file}: row {row + 1}", found, notes)


def _is_number(kind: pa.DataType) -> bool:
    tests = ("floating", "integer", "decimal", "timestamp", "duration")
    return any(getattr(pa.types, f"is_{test}")(kind) for test in tests)


def _is_text(kind: pa.DataType) -> bool:
    types = pa.types
    if types.is_dictionary(kind):
        kind = kind.value_type
    return bool(types.is_string(kind) or types.is_large_string(kind))


def _is_list(kind: pa.DataType) -> bool:
    types = pa.types
    lists = types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)
    return bool(lists and (types.is_floating(kind.value_type) or types.is_integer(kind.value_type)))


READERS = {
    "parquet": Reader("Parquet", begins_with(b"PAR1"), partial(read, "parquet"), ("parquet", "pq")),
    "arrow": Reader(
        "Arrow",
        begins_with(b"ARROW1\0\0", b"\xff\xff\xff\xff"),
        partial(read, "arrow"),
        ("feather", "arrow"),
    ),
}
