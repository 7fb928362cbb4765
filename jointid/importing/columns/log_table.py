"""A log as it was written: named columns of numbers, with units where the file states them."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import PurePosixPath

import numpy as np
from numpy.typing import ArrayLike

from jointid.arrays import Floats, set_fields
from jointid.errors import JointIdError
from jointid.importing.columns.units import split_unit, unit_of
from jointid.wording import counted, free_name, listed, nearest

MAX_LOG_BYTES = 256 << 20
"""Largest file; at 1 kHz and ten text columns about forty minutes."""
MAX_VALUES = 1 << 25
"""Most numbers in all tables of one file (256 MiB)."""
MAX_COLUMNS = 2000
"""Most columns of one table."""
MAX_TABLES = 50
"""Most tables of one file."""


@dataclass(frozen=True, eq=False)
class LogColumn:
    """One column of numbers."""

    name: str
    """As in the file, without its unit; different from the names of all other columns."""
    values: Floats
    """Shape (N,), read-only; a missing value is NaN."""
    unit: str = ""
    """As in ``jointid.importing.columns.units``; empty when not stated."""


@dataclass(frozen=True, eq=False)
class LogTable:
    """Columns of equal length from one file.

    Raises JointIdError when there are too few columns, too many, or their lengths differ.
    """

    name: str
    """File and its part, for messages."""
    columns: tuple[LogColumn, ...]
    """At least two; repeated names get a number."""
    notes: tuple[str, ...] = ()
    """Omissions and repairs of the reader, as sentences for the user."""
    first_row: int = 1
    """Number of the first row in the file."""
    row_word: str = "row"
    """Noun for a row: "line" of a text, "row" or "message"."""
    source: str = ""
    """The file itself, where a zip archive holds several."""
    read_as: str = ""
    """Name of the reader: "a TwinCAT Scope export"."""

    def __post_init__(self) -> None:
        plain = ["".join(c for c in each.name if c.isprintable()).strip()[:200] for each in self.columns]
        names = distinct_names(name or f"column {k}" for k, name in enumerate(plain, start=1))
        columns = tuple(replace(c, name=name) for c, name in zip(self.columns, names, strict=True))
        if len(columns) < 2:
            raise JointIdError(
                f"{self.name} has {counted(len(columns), 'column')} of numbers; a log needs at least "
                f"position and torque. Columns found: {listed(c.name for c in columns)}."
            )
        require_few_columns(self.name, len(columns))
        rows = columns[0].values.shape
        for column in columns:
            if column.values.shape != rows or column.values.ndim != 1:
                raise JointIdError(
                    f"{self.name}: column {column.name} has shape {column.values.shape}, column "
                    f"{columns[0].name} {rows}: all columns need the same number of rows."
                )
        if rows[0] == 0:
            raise JointIdError(f"{self.name} has columns but no rows: export the log again.")
        set_fields(self, columns=columns, notes=tuple(self.notes))

    @property
    def rows(self) -> int:
        """Number of rows N."""
        return int(self.columns[0].values.size)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)

    @property
    def signature(self) -> str:
        """Digest of the columns' names and units: logs that share it can share a mapping."""
        columns = [[column.name, column.unit] for column in self.columns]
        return hashlib.blake2b(json.dumps(columns).encode(), digest_size=16).hexdigest()

    def column(self, name: str) -> LogColumn:
        """Return a column by its name.

        Raises JointIdError when no column has this name; the message lists the existing ones.
        """
        for column in self.columns:
            if column.name == name:
                return column
        raise JointIdError(
            f'{self.name} has no column "{name:.60}".{nearest(name, self.names)} '
            f"Columns found: {listed(self.names)}."
        )

    def place(self, row: int) -> str:
        """Return the place of a row (0 is the first) for messages."""
        return f"{self.name}, {self.row_word} {self.first_row + row}"


def numbers(values: ArrayLike) -> Floats:
    """Return values as a read-only float64 array; non-finite values become NaN."""
    array = np.array(values, dtype=np.float64)
    array[~np.isfinite(array)] = np.nan
    array.setflags(write=False)
    return array


def named_column(name: str, values: ArrayLike, unit: str = "", *, number: int = 0) -> LogColumn:
    """Return a column with the stated unit, else that in its name; ``number`` of several of one name."""
    bare, own = split_unit(name)
    return LogColumn(f"{bare} {number}" if number else bare, numbers(values), unit_of(unit) or own)


def require_small(file: str, size: int) -> None:
    """Refuse an empty file, or one of more than ``MAX_LOG_BYTES``."""
    if size == 0:
        raise JointIdError(f"{file} is empty (0 bytes): export the log again.")
    if size > MAX_LOG_BYTES:
        raise JointIdError(
            f"{file} has {size / 2**20:.4g} MiB, more than the limit of "
            f"{MAX_LOG_BYTES / 2**20:.4g} MiB. Cut it into several logs, or log less data."
        )


def require_few_values(file: str, values: int) -> None:
    """Refuse a table of more than ``MAX_VALUES`` numbers."""
    if values > MAX_VALUES:
        raise JointIdError(
            f"{file} holds {values / 1e6:.4g} million numbers, more than the limit of "
            f"{MAX_VALUES / 1e6:.4g} million. Cut it into several logs, or log fewer columns."
        )


def require_few_columns(file: str, columns: int) -> None:
    """Refuse a table of more than ``MAX_COLUMNS`` columns."""
    if columns > MAX_COLUMNS:
        raise JointIdError(
            f"{file} has {columns} columns, more than the limit of {MAX_COLUMNS}: it may be transposed. "
            "Export one row per sample."
        )


def main_tables(tables: Iterable[LogTable]) -> tuple[LogTable, ...]:
    """Return the first table of each file; an archive holds several files."""
    first: dict[str, LogTable] = {}
    for table in tables:
        first.setdefault(table.source, table)
    return tuple(first.values())


def most_first(file: str, tables: Iterable[LogTable]) -> tuple[LogTable, ...]:
    """Order the tables of a file, the one with the most numbers first; at most ``MAX_TABLES``."""
    found = sorted(tables, key=lambda t: -t.rows * len(t.columns))
    require_few_values(file, sum(t.rows * len(t.columns) for t in found))
    return tuple(found[:MAX_TABLES])


def log_path(name: str) -> PurePosixPath:
    """Return the path of a log from its name: "book.xlsx: Sheet1" is a part of book.xlsx."""
    return PurePosixPath(name.partition(": ")[0].replace("\\", "/"))


def distinct_names(names: Iterable[str]) -> list[str]:
    """Return names with a number, "speed (2)", where they repeat."""
    taken: dict[str, None] = {}
    for plain in names:
        taken[free_name(plain, taken)] = None
    return list(taken)
