"""Calls of functions, as bytes to a process of its own and back.

Both ends are this software, on this computer, through a pipe of their own: pickle is safe there.
"""

from __future__ import annotations

import io
import os
import pickle
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from types import MappingProxyType
from typing import Any

from jointid.background.serving import Progress, serve_here

_SOON = (
    "jointid.study",
    "jointid.cut.outcome",
    "jointid.uncertainty.plan",
    "jointid.uncertainty.sensitivity",
)
_PROTOCOL = 5  # keeps arrays read-only that are


class _Pickler(pickle.Pickler):
    """Pickles frozen mappings too, and of what both sides hold only which one it is."""

    def __init__(self, file: io.BytesIO, held: Sequence[Any] = ()) -> None:
        super().__init__(file, _PROTOCOL)
        self._held = {id(value): k for k, value in enumerate(held)}

    def persistent_id(self, value: Any) -> int | None:
        return self._held.get(id(value))

    def reducer_override(self, value: Any) -> Any:
        if isinstance(value, MappingProxyType):
            return _frozen, (dict(value),)
        return NotImplemented


def _frozen(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)  # which pickle knows by no name


class _Unpickler(pickle.Unpickler):
    def __init__(self, data: bytes, held: Sequence[Any]) -> None:
        super().__init__(io.BytesIO(data))
        self._held = held

    def persistent_load(self, number: int) -> Any:
        return self._held[number]


def packed_call(function: Callable[..., Any], given: Sequence[Any], tells: bool) -> bytes:
    """Return a call as bytes.

    Parameters
    ----------
    function : callable
        Of a module, by its name.
    given : sequence
        What it is called with.
    tells : bool
        Whether it takes ``progress`` as well.
    """
    return _packed((function, tuple(given), tells))


def unpacked_result(data: bytes, given: Sequence[Any]) -> Any:
    """Return what the call returned; what it was given comes back as itself.

    Raises
    ------
    Exception
        Whatever the call raised.
    """
    raised, result = _Unpickler(data, given).load()
    if raised:
        raise result
    return result


def answer(_: dict[str, Any], body: bytes, tell: Progress) -> tuple[dict[str, Any], bytes]:
    """Do a call; returns what it returned or raised."""
    function, given = None, ()
    try:
        function, given, tells = pickle.loads(body)
        result = (False, function(*given, progress=tell) if tells else function(*given))
    except (Exception, MemoryError) as error:
        result = (True, error)
    try:
        return {}, _packed(result, given)
    except Exception as error:  # a foreign one need not be fit for sending
        told = f"{function} gave {type(result[1]).__name__}, which cannot be sent: {error!s:.200}"
        return {}, _packed((True, TypeError(told)))


def _packed(value: Any, held: Sequence[Any] = ()) -> bytes:
    file = io.BytesIO()
    _Pickler(file, held).dump(value)
    return file.getvalue()


def main(memory_bytes: int) -> None:
    """Serve calls, behind whoever waits for a click."""
    for module in _SOON:  # the first call need not wait for them
        import_module(module)
    with suppress(AttributeError, OSError):
        os.nice(5)
    serve_here(answer, memory_bytes)
