"""NumPy files (.npz, .npy), without Python objects, which could run programs."""

import zipfile
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from jointid.importing.columns.log_table import MAX_COLUMNS, LogTable, require_few_values
from jointid.importing.read.array_tables import NamedArray, tables_of
from jointid.importing.read.reader import Reader
from jointid.wording import listed

_BYTES = 8
"""Bytes of a number in memory; smaller types are converted to it."""


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the arrays of a NumPy file; those of equal length are a table."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:  # its unpacked size
            require_few_values(file, sum(part.file_size for part in archive.infolist()) // _BYTES)
    with open(path, "rb") as source:
        found: Any = np.load(source, allow_pickle=False)
        names = found.files[:MAX_COLUMNS] if hasattr(found, "files") else ["array"]
        arrays = {name: [*_arrays(name, found)] for name in names}
    otherwise = (
        f"{file} holds no table of numbers: expected arrays of equal length, at least two columns. "
        f"Arrays found: {listed(names)}."
    )
    tables = tables_of(file, (part for parts in arrays.values() for part in parts), otherwise)
    left_out = [name for name, parts in arrays.items() if not parts]
    notes = (f"Arrays of Python objects, left out: {listed(left_out)}.",) if left_out else ()
    return tuple(replace(table, notes=(*table.notes, *notes)) for table in tables)


def _arrays(name: str, found: Any) -> Iterator[NamedArray]:
    """One array, or one for each field of a table; none if it holds objects."""
    try:
        values = np.asarray(found[name] if hasattr(found, "files") else found)
    except ValueError as error:
        if "allow_pickle" not in str(error):
            raise
        return
    parts = [(name.replace("/", "."), values, "")]
    if values.dtype.names is not None:
        parts = [(field, values[field], name) for field in values.dtype.names]
    for part, numbers, group in parts:
        if numbers.dtype.kind in "mM":  # times or durations
            numbers = (numbers - numbers.ravel()[:1]) / np.timedelta64(1, "s")
            yield NamedArray(part, numbers, "s", group=group)
        else:
            yield NamedArray(part, numbers, group=group)


def _recognises(head: bytes) -> bool:
    size = int.from_bytes(head[26:28], "little")
    in_zip = head.startswith(b"PK\x03\x04") and head[30 : 30 + size].endswith(b".npy")
    return in_zip or head.startswith(b"\x93NUMPY")


READERS = {"npz": Reader("a NumPy file", _recognises, read, ("npz", "npy"))}
