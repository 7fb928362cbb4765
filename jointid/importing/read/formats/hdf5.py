"""HDF5 files, including MATLAB 7.3: groups of arrays, and tables of compound type.

HDF5 can take a dataset's values from any file of the computer: by external storage, a virtual dataset or
an external link. ``_own_object`` looks up every object and refuses these before their shape is read.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from jointid.errors import JointIdError, import_optional
from jointid.importing.columns.log_table import LogTable, require_few_values
from jointid.importing.read.array_tables import NamedArray, tables_of
from jointid.importing.read.formats.matlab import scope_arrays
from jointid.importing.read.reader import Reader
from jointid.wording import listed

_DEEPEST = 8
_MOST_OBJECTS = 2000
_UNIT_ATTRIBUTES = ("unit", "units", "Unit", "Units", "einheit", "Einheit")
_LABEL_ATTRIBUTES = ("columns", "column_names", "names", "labels", "Columns", "fields")


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the tables of an HDF5 file; one group's arrays of equal length are a table."""
    h5py = import_optional("h5py", "h5py", "HDF5 files and MATLAB files of version 7.3")
    with h5py.File(path, "r", locking=False) as root:
        reader = _Reader(h5py, file, root)
        arrays = list(reader.walk(root, "", _DEEPEST))
        otherwise = (
            f"{file} holds no table of numbers: expected arrays of equal length, at least two in one "
            f"group. Found: {listed(reader.seen)}."
        )
        return tables_of(file, arrays, otherwise)


class _Reader:
    def __init__(self, h5py: Any, file: str, root: Any) -> None:
        self._h5py = h5py
        self._file = file
        self._object = partial(_own_object, h5py, file)
        self._values = 0
        top = [self._object(root, key) for key in islice(root, 50)]
        self._is_matlab = any("MATLAB_class" in item.attrs for item in top if item is not None)
        self.seen: list[str] = []

    def walk(self, group: Any, name: str, depth: int) -> Iterator[NamedArray]:
        signals = self._object(group, "signals")
        if isinstance(signals, self._h5py.Group) and self._object(group, "time") is not None:
            yield from self._scope(group, name)
            return
        for key in group:
            if len(self.seen) >= _MOST_OBJECTS:
                return
            if key == "#refs#":
                continue  # read where it is referred to
            item = self._object(group, key)
            inner = f"{name}/{key}" if name else str(key)
            self.seen.append(inner)
            if isinstance(item, self._h5py.Group):
                if depth > 0:
                    yield from self.walk(item, inner, depth - 1)
            elif isinstance(item, self._h5py.Dataset):
                yield from self._dataset(item, inner)

    def _dataset(self, item: Any, name: str) -> Iterator[NamedArray]:
        kind = item.dtype.kind
        if item.shape is None or (kind not in "biuf" and item.dtype.names is None):
            return
        group, _, short = name.rpartition("/")
        self._spend(item)
        values = item[()]
        if item.dtype.names is not None:  # a table, as pandas and PyTables write
            for field in item.dtype.names:
                part = values[field]
                if part.dtype.kind in "biuf":
                    yield NamedArray(field, part, group=name)
            return
        if self._is_matlab:
            # MATLAB stores columns first; groups are structs, whose arrays belong together.
            yield NamedArray(name.replace("/", "."), np.asarray(values).T)
            return
        unit = _text(_attribute(item, _UNIT_ATTRIBUTES, ""))
        labels = np.ravel(_attribute(item, _LABEL_ATTRIBUTES, ()))[:_MOST_OBJECTS]
        yield NamedArray(short, values, unit, tuple(_text(label) for label in labels), group)

    def _scope(self, group: Any, name: str) -> Iterator[NamedArray]:
        time, signals = self._object(group, "time"), self._object(group, "signals")
        values = self._object(signals, "values")
        if values is None:
            return
        labels = self._follow(self._object(signals, "label"), text=True)
        arrays = self._follow(values, text=False)
        padded = [*labels, *[""] * len(arrays)]
        pairs = [(str(label), array) for array, label in zip(arrays, padded, strict=False)]
        self._spend(time)
        yield from scope_arrays(name or self._file, np.asarray(time[()]).T, pairs)

    def _follow(self, item: Any, *, text: bool) -> list[Any]:
        """Values of a field of a MATLAB struct: itself, or by reference for an array of structs."""
        if item is None or not isinstance(item, self._h5py.Dataset):
            return []
        if item.dtype == self._h5py.ref_dtype:
            self._spend(item)
            references = np.ravel(item[()])[:_MOST_OBJECTS]
            targets = [self._object(item.file, reference) for reference in references]
        else:
            targets = [item]
        values: list[Any] = []
        for target in targets:
            self._spend(target)
            array = np.asarray(target[()])
            if text:
                empty = "MATLAB_empty" in target.attrs or array.dtype.kind not in "iu"
                values.append("" if empty else "".join(chr(c) for c in array.ravel()[:200]))
            else:
                values.append(array.T)
        return values

    def _spend(self, item: Any) -> None:
        """Check the size before reading: a few bytes can represent any number of equal values."""
        self._values += int(np.prod(item.shape, dtype=float)) * max(1, len(item.dtype.names or ()))
        require_few_values(self._file, self._values)


def _own_object(h5py: Any, file: str, group: Any, key: Any) -> Any:
    """Object under a name in a group (bytes if not UTF-8), or the target of a reference.

    None if there is none, and for a soft link, which is a second name of an object in the file, or
    leads through an external link. Raises JointIdError when it is a link to another
    file, or a dataset whose values lie in one or need a plugin.
    """
    if not isinstance(key, h5py.Reference):
        try:
            link = group.get(key, getlink=True)
        except TypeError:  # user-defined link
            link = h5py.ExternalLink("", "/")
        if isinstance(link, h5py.ExternalLink):
            raise _elsewhere(file, f"{group.name.rstrip('/')}/{key}", "is a link to another file")
        if not isinstance(link, h5py.HardLink):
            return None
    item = group[key]
    if isinstance(item, h5py.Dataset):
        created = item.id.get_create_plist()
        if created.get_external_count() > 0:
            raise _elsewhere(file, item.name, "keeps its values in external files")
        # Its sources may be virtual or external again, those in this file too.
        if created.get_layout() == h5py.h5d.VIRTUAL:
            raise _elsewhere(file, item.name, "is a virtual dataset")
        for k in range(created.get_nfilters()):
            code, _, _, label = created.get_filter(k)
            if not h5py.h5z.filter_avail(code):
                raise JointIdError(
                    f'{file}: "{item.name!s:.200}" is packed with filter {code} '
                    f"({label.decode(errors='replace'):.40}), which is not installed. "
                    "Save it with gzip compression, or uncompressed."
                )
    return item


def _elsewhere(file: str, name: object, fault: str) -> JointIdError:
    return JointIdError(
        f'{file}: "{name!s:.200}" {fault}. A log must hold all its values itself: copy them into an '
        "ordinary dataset of the file, or export it as CSV."
    )


def _attribute(item: Any, keys: Sequence[str], default: Any) -> Any:
    return next((item.attrs[key] for key in keys if key in item.attrs), default)


def _text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _recognises(head: bytes) -> bool:
    # MATLAB 7.3 adds a header in front.
    return any(head[start:].startswith(b"\x89HDF\r\n\x1a\n") for start in (0, 512, 1024, 2048))


READERS = {"hdf5": Reader("HDF5", _recognises, read, ("h5", "hdf5", "hdf", "he5"))}
