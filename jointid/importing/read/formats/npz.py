"""NumPy files (.npz, .npy), without Python objects: those could run programs."""

import zipfile
from collections.abc import Iterator
from typing import IO, Any

import numpy as np

from jointid.importing.columns.log_table import MAX_COLUMNS, LogTable, require_few_values
from jointid.importing.read.array_tables import NamedArray, tables_of
from jointid.importing.read.reader import Reader
from jointid.wording import listed


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the arrays of a NumPy file; those of equal length are a table."""
    seen: list[str] = []
    arrays: list[NamedArray] = []
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            for info in archive.infolist()[:MAX_COLUMNS]:
                with archive.open(info) as part:
                    seen.append(info.filename.removesuffix(".npy"))
                    arrays += _arrays(file, seen[-1], part)
                require_few_values(file, sum(np.size(array.values) for array in arrays))
    else:
        with open(path, "rb") as part:
            arrays += _arrays(file, "array", part)
    otherwise = (
        f"{file} holds no table of numbers: expected arrays of equal length, at least two columns. "
        f"Arrays found: {listed(seen)}."
    )
    return tables_of(file, arrays, otherwise)


def _arrays(file: str, name: str, part: IO[bytes]) -> Iterator[NamedArray]:
    """One array, or one for each field of a table; none if it holds objects or texts."""
    version = np.lib.format.read_magic(part)
    header = (
        np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    )
    shape, by_column, dtype = header(part)
    count = int(np.prod(shape, dtype=object))
    require_few_values(file, count * max(1, len(dtype.names or ())))
    if dtype.hasobject or count == 0 or (dtype.names is None and dtype.kind not in "biuf"):
        return
    data = part.read(count * dtype.itemsize)
    flat: Any = np.frombuffer(data, dtype, count)
    values = flat.reshape(shape, order="F" if by_column else "C")
    for field in dtype.names or ():
        if values[field].dtype.kind in "biuf":
            yield NamedArray(field, values[field], group=name)
    if dtype.names is None:
        yield NamedArray(name.replace("/", "."), values)


def _recognises(head: bytes) -> bool:
    size = int.from_bytes(head[26:28], "little")
    in_zip = head.startswith(b"PK\x03\x04") and head[30 : 30 + size].endswith(b".npy")
    return in_zip or head.startswith(b"\x93NUMPY")


READERS = {"npz": Reader("a NumPy file", _recognises, read, ("npz", "npy"))}
