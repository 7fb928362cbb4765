"""A record in parts: Parquet files of any size; and the endings of all files of a study."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from hashlib import file_digest
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pa_parquet  # type: ignore[import-untyped]

from jointid.arrays import Floats
from jointid.errors import JointIdError
from jointid.files.csv_tables import ARROW_FAULTS, are_usable, parquet_faults
from jointid.files.record_tables import column_names, explain_fault, numeric_columns, parquet_rows
from jointid.phasors.long_records import LongRecord
from jointid.records import SineRecord

STUDY_PARTS = (".csv", ".parquet", ".toml", ".urdf", ".xml")
"""Endings of the files of a study: study.toml, tables and robot models."""
LONG_BYTES = 256 << 20
"""Largest record that is read at once, bytes of its numbers unpacked."""

_PART_SAMPLES = 1 << 20  # fewest samples of a part
_PART_PERIODS = 32
"""Fewest periods of a part: they determine its noise and separate 31 harmonics from its drift."""
_SHOWN_SAMPLES = 1 << 17  # samples kept in memory, for plots
_BUFFER_BYTES = 1 << 20
"""Buffer for a column's packed pages; without it Arrow reads a whole row group at once."""


def is_long(name: str, path: Path) -> bool:
    """Whether a record is read in parts: a large Parquet file."""
    if not name.lower().endswith(".parquet"):
        return False
    try:
        metadata = pa_parquet.read_metadata(path)
        joints = sum(column.startswith("theta_m") for column in metadata.schema.names)
    except ARROW_FAULTS:
        return False  # the reader reports the fault
    return bool(metadata.num_rows * (1 + 2 * joints) * 8 > LONG_BYTES)


def read_long_record(name: str, path: Path, joints: int, **known: Any) -> LongRecord:
    """Open a Parquet record of a study of some joints that is read in parts.

    ``known`` are arguments of ``SineRecord`` other than its arrays. Raises JointIdError when the columns
    or the first part cannot be used; later parts are checked as they are read.
    """
    start = known.pop("start_s")
    with _opened(name, path) as source:
        numeric_columns(name, source.schema_arrow, joints)
        rows = source.metadata.num_rows
        first, time = _beginning(name, source, start)
    if time.size < 2:
        raise JointIdError(f"start_s = {start:g} s lies after the last sample: correct start_s.")
    interval = float(np.median(np.diff(time)))
    least = max(_PART_SAMPLES, math.ceil(_PART_PERIODS / (known["frequency_hz"] * max(interval, 1e-12))))
    parts = max(1, (rows - first) // least)
    size = math.ceil((rows - first) / parts)
    if size * (1 + 2 * joints) * 8 > LONG_BYTES:
        raise JointIdError(
            f"{_PART_PERIODS} periods of {known['frequency_hz']:g} Hz are {size} samples, more than a "
            "part of a long record may have. Check frequency_hz and the unit of time_s (seconds), or"
            " log less data."
        )
    file = _LongFile(name, path, joints, first, size, known)
    beginning = next(file.parts())
    shown = max(_SHOWN_SAMPLES, math.ceil(4 / (beginning.frequency_hz * beginning.interval_s)))
    arrays = {key: getattr(beginning, key)[:shown] for key in ("time_s", "theta_rad", "tau_Nm")}
    return LongRecord(
        **arrays,
        **known,
        parts=file.parts,
        samples_in_all=rows - first,
        fingerprint=partial(_digest, path),
    )


@dataclass(frozen=True)
class _LongFile:
    """A Parquet file and its division into parts."""

    name: str
    path: Path
    joints: int
    first: int
    """Row of the first sample used, from 0."""
    size: int
    """Rows of a part."""
    known: dict[str, Any]

    def parts(self) -> Iterator[SineRecord]:
        """Read the file once, a part at a time."""
        n = self.joints
        begin, before = self.first, -math.inf
        for table in self._tables():
            columns = list(table.T)
            if not are_usable(columns) or columns[0][0] <= before:
                explain_fault(self.name, column_names(n), columns, begin, before)
            before = float(columns[0][-1])
            try:
                yield SineRecord(
                    time_s=table[:, 0],
                    theta_rad=table[:, 1 : 1 + n],
                    tau_Nm=table[:, 1 + n :],
                    **self.known,
                )
            except JointIdError as error:
                raise error.within(f"{self.name}, from row {begin + 1}", file=self.name) from error
            begin += len(table)

    def _tables(self) -> Iterator[Floats]:
        """Rows of each part, shape (size, 1 + 2n); the last may be shorter."""
        names = column_names(self.joints)
        table, filled = np.empty((self.size, len(names)), order="F"), 0
        with _opened(self.name, self.path) as source:
            for rows in parquet_rows(self.name, source, names, self.first):
                while len(rows):
                    part, rows = np.split(rows, [self.size - filled])
                    table[filled : filled + len(part)] = part
                    filled += len(part)
                    if filled == self.size:
                        yield table
                        filled = 0
        if filled:
            yield table[:filled]


def _opened(name: str, path: Path) -> pa_parquet.ParquetFile:
    with parquet_faults(name):
        return pa_parquet.ParquetFile(path, buffer_size=_BUFFER_BYTES, pre_buffer=False)


def _beginning(name: str, source: pa_parquet.ParquetFile, start_s: float | None) -> tuple[int, Floats]:
    """Row of the first sample at or after ``start_s``, and the first times from there."""
    row, first = 0, None
    for (time,) in (rows.T for rows in parquet_rows(name, source, ["time_s"])):
        late = time >= (-math.inf if start_s is None else start_s - 1e-9)
        if first is None and late.any():
            first = row + int(np.argmax(late))
        if first is not None and first < row + time.size - 1:
            return first, time[max(first - row, 0) :][:1024]
        row += time.size
    return row, np.empty(0)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return file_digest(file, "blake2b").hexdigest()
