"""MATLAB .mat files of versions 5 to 7: arrays, structs, Simulink scopes and dSPACE recordings."""

import re
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from jointid.errors import import_optional
from jointid.importing.columns.log_table import MAX_VALUES, LogTable, require_few_values
from jointid.importing.read.array_tables import NamedArray, tables_of
from jointid.importing.read.clocks import Signal, tables_of_signals
from jointid.importing.read.reader import Reader
from jointid.wording import listed

_DEEPEST = 8
_MOST_ELEMENTS = 500
_COMPRESSED = 15  # type of an element of the file: a variable compressed by zlib
_CHUNK = 1 << 16


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the tables of a .mat file of version 5 to 7, the largest first.

    A struct with ``time`` and ``signals.values`` (a Simulink scope or a "Structure with time") is one
    table; other arrays of equal length are another. A recording of dSPACE has a clock for each of its
    rasters.
    """
    scipy_io = import_optional("scipy.io", "scipy", "MATLAB files")
    require_few_values(file, _unpacked_bytes(path) // 8)
    content = scipy_io.loadmat(
        path,
        appendmat=False,
        struct_as_record=False,
        squeeze_me=True,
        verify_compressed_data_integrity=True,
    )
    variables = {name: value for name, value in content.items() if not name.startswith("__")}
    recorded = [signal for value in variables.values() for signal in _dspace_signals(value)]
    hint = ""
    if any(type(v).__name__ == "MatlabOpaque" or n == "None" for n, v in content.items()):
        hint = (
            " It holds MATLAB objects (timeseries, Dataset or table), which only MATLAB can read: save "
            'arrays, or log as "Structure with time".'
        )
    otherwise = (
        f"{file} holds no table of numbers: expected arrays of equal length or a structure with "
        f"time and signals.{hint} Variables found: {listed(variables)}."
    )
    arrays = (a for name, value in variables.items() for a in _walk(name, value, "", _DEEPEST))
    return tables_of_signals(file, recorded) or tables_of(file, arrays, otherwise)


def _unpacked_bytes(path: str) -> int:
    """Bytes that the compressed variables of a file unpack to, as far as the limit."""
    unpacked = 0
    with open(path, "rb") as source, suppress(zlib.error, struct.error):
        order = ">" if source.read(128)[126:] == b"MI" else "<"
        while unpacked <= 8 * MAX_VALUES:
            kind, left = struct.unpack(f"{order}II", source.read(8))
            if kind != _COMPRESSED:
                source.seek(left, 1)
                continue
            unpacker = zlib.decompressobj()
            while unpacked <= 8 * MAX_VALUES and (chunk := source.read(min(left, _CHUNK))):
                left -= len(chunk)
                unpacked += len(unpacker.decompress(chunk))
    return unpacked


def _walk(name: str, value: Any, group: str, depth: int) -> Iterator[NamedArray]:
    fields = getattr(value, "_fieldnames", None)
    if fields is not None:
        if depth == 0:
            return
        if "time" in fields and "signals" in fields:
            yield from scope_arrays(name, np.asarray(value.time), _signals(value.signals))
            return
        for field in fields:
            # The arrays of one struct belong together; those of its parts, too.
            yield from _walk(f"{name}.{field}", getattr(value, field), group, depth - 1)
        return
    if isinstance(value, np.ndarray) and value.dtype == object:
        for index, element in enumerate(value.ravel()[:_MOST_ELEMENTS], start=1):
            if depth > 0:
                yield from _walk(f"{name}({index})", element, group, depth - 1)
        return
    if isinstance(value, np.ndarray):
        yield NamedArray(name, value, group=group)


def _dspace_signals(recording: Any) -> Iterator[Signal]:
    """Signals of a dSPACE recording: a struct with times X and values Y, named by XIndex."""
    if not {"X", "Y"} <= set(getattr(recording, "_fieldnames", None) or ()):
        return
    clocks, channels = (
        np.atleast_1d(np.asarray(part, dtype=object))[:_MOST_ELEMENTS]
        for part in (recording.X, recording.Y)
    )
    for channel in channels:
        index = getattr(channel, "XIndex", 1)
        at = int(index) - 1 if isinstance(index, int | np.integer) else 0
        clock = clocks[at] if 0 <= at < len(clocks) else clocks[0] if len(clocks) else None
        time, values = (np.asarray(getattr(part, "Data", ())) for part in (clock, channel))
        if time.dtype.kind in "biuf" and values.dtype.kind in "biuf" and time.size == values.size > 1:
            name = re.sub(r"/(?:In|Out)\d*$", "", str(getattr(channel, "Name", "")).replace('"', ""))
            unit = getattr(channel, "Unit", "")
            yield Signal(
                name or "signal", time.ravel().astype(float), values.ravel().astype(float),
                unit if isinstance(unit, str) else "",
            )  # fmt: skip


def _signals(signals: Any) -> list[tuple[str, Any]]:
    """Label and values of each signal of a scope."""
    each = signals.ravel()[:_MOST_ELEMENTS] if isinstance(signals, np.ndarray) else [signals]
    return [
        (label if isinstance(label := getattr(s, "label", ""), str) else "", s.values)
        for s in each
        if hasattr(s, "values")
    ]


def scope_arrays(name: str, time: np.ndarray, signals: list[tuple[str, Any]]) -> Iterator[NamedArray]:
    """Arrays of a Simulink scope: time, and the values of every axis of it."""
    if time.size:
        yield NamedArray("time", time.ravel(), unit="s", group=name)
    for number, (label, values) in enumerate(signals, start=1):
        signal = label.strip() or (f"signal {number}" if len(signals) > 1 else "signal")
        array = np.asarray(values)
        if array.ndim > 1 and array.shape[-1] == time.size != array.shape[0]:
            array = array.reshape(-1, time.size).T  # frames: (m, 1, N)
        if array.ndim == 1 and not label.strip() and len(signals) == 1:
            signal = "signal 1"
        yield NamedArray(signal, array, group=name)


def _recognises(head: bytes) -> bool:
    return head.startswith(b"MATLAB 5.0 MAT-file") or head[126:128] in (b"IM", b"MI")


READERS = {"matlab": Reader("a MATLAB file", _recognises, read, ("mat",))}
