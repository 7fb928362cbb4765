"""MATLAB .mat files of versions 5 to 7: plain arrays, structs, and the structures of Simulink scopes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from jointid.errors import JointIdError
from jointid.importing.columns.log_table import LogTable
from jointid.importing.read.array_tables import NamedArray, tables_of
from jointid.importing.read.optional_imports import import_optional
from jointid.wording import listed

_DEEPEST = 8
_MOST_ELEMENTS = 500


def read(file: str, path: str) -> tuple[LogTable, ...]:
    """Read the tables of a .mat file of version 5 to 7.

    Parameters
    ----------
    file : str
        Its name, for messages.
    path : str
        Where it lies.

    Returns
    -------
    tuple of LogTable
        The largest first. A struct with ``time`` and ``signals.values`` (a Simulink scope or a
        "Structure with time") is one table; other arrays of equal length are another.

    Raises
    ------
    JointIdError
        When nothing in it is a log.
    """
    scipy_io = import_optional("scipy.io", "scipy", "MATLAB files")
    content = scipy_io.loadmat(
        path,
        appendmat=False,
        struct_as_record=False,
        squeeze_me=True,
        verify_compressed_data_integrity=True,
    )
    variables = {name: value for name, value in content.items() if not name.startswith("__")}
    arrays = [a for name, value in variables.items() for a in _walk(name, value, "", _DEEPEST)]
    tables = tables_of(file, arrays)
    if not tables:
        opaque = [n for n, v in content.items() if type(v).__name__ == "MatlabOpaque" or n == "None"]
        hint = (
            " It holds MATLAB objects (timeseries, Dataset or table), which only MATLAB can read: save "
            'arrays, or log as "Structure with time".'
            if opaque
            else ""
        )
        raise JointIdError(
            f"{file} holds no table of numbers: expected arrays of equal length or a structure with "
            f"time and signals.{hint} Variables found: {listed(variables)}."
        )
    return tables


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
