"""Function calls serialised for a worker process.

Both ends are this software on this computer, connected by a private pipe: pickle is safe there.
"""

from __future__ import annotations

import io
import os
import pickle
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import MappingProxyType
from typing import Any

from jointid.background.serving import Progress, serve_here

_PROTOCOL = 5  # preserves read-only arrays


class _Pickler(pickle.Pickler):
    """Pickles frozen mappings, and arguments held by both sides as references."""

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
    return MappingProxyType(mapping)  # pickle cannot import the type by name


class _Unpickler(pickle.Unpickler):
    def __init__(self, data: bytes, held: Sequence[Any]) -> None:
        super().__init__(io.BytesIO(data))
        self._held = held

    def persistent_load(self, number: int) -> Any:
        return self._held[number]


def packed_call(function: Callable[..., Any], arguments: Sequence[Any], with_progress: bool) -> bytes:
    """Serialise a call.

    Parameters
    ----------
    function : callable
        Importable by name.
    arguments : sequence
    with_progress : bool
        Whether the function also takes ``progress``.
    """
    return _packed((function, tuple(arguments), with_progress))


def unpacked_result(data: bytes, arguments: Sequence[Any]) -> Any:
    """Return the result of a call; an argument in the result is the caller's own object.

    Raises
    ------
    Exception
        Whatever the call raised.
    """
    raised, result = _Unpickler(data, arguments).load()
    if raised:
        raise result
    return result


def answer(_: dict[str, Any], body: bytes, progress: Progress) -> tuple[dict[str, Any], bytes]:
    """Make a call; return its result or exception."""
    function, arguments = None, ()
    try:
        function, arguments, with_progress = pickle.loads(body)
        options = {"progress": progress} if with_progress else {}
        result = (False, function(*arguments, **options))
    except (Exception, MemoryError) as error:
        result = (True, error)
    try:
        return {}, _packed(result, arguments)
    except Exception as error:  # exceptions and results of other libraries may not be picklable
        reason = f"{function} gave {type(result[1]).__name__}, which cannot be sent: {error!s:.200}"
        return {}, _packed((True, TypeError(reason)))


def _packed(value: Any, held: Sequence[Any] = ()) -> bytes:
    file = io.BytesIO()
    _Pickler(file, held).dump(value)
    return file.getvalue()


def main(memory_bytes: int) -> None:
    """Serve calls at a lower priority than the process that answers clicks."""
    with suppress(AttributeError, OSError):
        os.nice(5)
    serve_here(answer, memory_bytes)
