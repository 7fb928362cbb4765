"""A pool of worker processes for function calls, with both ends of the pipe to them.

Both ends are this software on this computer, connected by a private pipe: pickle is safe there.
"""

import copyreg
import io
import math
import os
import pickle
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from jointid.background.child_process import Child, Ended, Limits
from jointid.background.serving import Progress, serve_here
from jointid.errors import JointIdError

_MODULE = "jointid.background.pool"
_LIMITS = Limits(time_s=3600.0)
_START_WAIT_S = 20.0  # wait for a process that is starting; it loads the numerical libraries, s
_BACK_OFF_S = 30.0  # back-off after a failed start, s
_LOOK_S = 0.2  # interval at which a waiting call checks whether it was stopped, s


class NoWorkerError(Exception):
    """No process is ready; the caller may compute in its own process."""


class StoppedError(Exception):
    """The call was stopped."""


class Stop:
    """Stops a call from another thread."""

    def __init__(self) -> None:
        self.is_set = False
        self.child: Child | None = None
        """The process that makes the call."""

    def set(self) -> None:
        """Stop the call: kill its process, or do not begin."""
        self.is_set = True
        if (child := self.child) is not None:
            child.kill()

    def check(self) -> None:
        """Raise StoppedError once the call is stopped."""
        if self.is_set:
            raise StoppedError


class Pool:
    """Up to ``most`` worker processes for calls, started lazily; each imports ``preload`` first."""

    def __init__(self, most: int, preload: Sequence[str] = ()) -> None:
        self._most = most
        self._preload = preload
        self._started = self._ready = 0  # a process that is starting is not ready
        self._retry_after_s = -math.inf
        self._lock = threading.Condition()
        self._idle: deque[Child] = deque()
        self._waiting: deque[object] = deque()
        """Calls without a process, in the order in which they came."""

    @property
    def is_ready(self) -> bool:
        """Whether a process runs, busy or not."""
        return self._ready > 0

    def start(self) -> None:
        """Start one more process in the background, up to the limit and one at a time."""
        with self._lock:
            if not self._ready == self._started < self._most or time.monotonic() < self._retry_after_s:
                return
            self._started += 1
        try:
            threading.Thread(target=self._start_one, daemon=True).start()
        except RuntimeError:  # no more threads
            self._back_off()

    def call(
        self,
        function: Callable[..., Any],
        *arguments: Any,
        progress: Callable[..., object] | None = None,
        stop: Stop | None = None,
    ) -> Any:
        """Call ``function(*arguments)`` in a process; calls wait in order while all are busy.

        The function is one of a module, or a ``functools.partial`` of one. Arrays and dataclasses of
        the arguments that are part of the result come back as the same objects. ``progress`` is passed
        on if given; an exception it raises ends the call. Raises NoWorkerError when no process runs;
        StoppedError after ``stop``; JointIdError when the call crashes its process; and whatever the
        call raises.
        """
        if not self._ready:
            raise NoWorkerError
        stop = stop or Stop()
        try:
            return self._called(self._free(stop), function, arguments, progress, stop)
        except Ended as ended:
            why = str(ended)
        with suppress(Ended, NoWorkerError):  # the process may have been killed from outside
            stop.check()
            child = self._free(stop)
            return self._called(child, function, arguments, progress, stop)
        stop.check()
        raise JointIdError(
            f"The computation failed. {why} Free memory on the computer that runs it, or shorten the "
            "records; then try again."
        )

    def _called(
        self,
        child: Child,
        function: Callable[..., Any],
        arguments: Sequence[Any],
        progress: Callable[..., object] | None,
        stop: Stop,
    ) -> Any:
        stop.child = child
        try:
            stop.check()
            _, data = child.ask({}, packed((function, arguments, progress is not None)), progress)
        finally:
            stop.child = None
            self._put_back(child)
        raised, result = _Unpickler(data, arguments).load()
        if raised:
            raise result
        return result

    def _start_one(self) -> None:
        child = Child(_MODULE, _LIMITS, self._preload)
        try:
            child.start()
        except Exception:  # the callers compute in their own process meanwhile
            self._back_off()
            return
        with self._lock:
            self._ready += 1
        self._put_back(child)

    def _back_off(self) -> None:
        with self._lock:
            self._retry_after_s = time.monotonic() + _BACK_OFF_S
            self._started -= 1

    def _free(self, stop: Stop) -> Child:
        """Wait for an idle process; where none runs, a while for one that is starting."""
        me, end = object(), time.monotonic() + _START_WAIT_S
        with self._lock:
            self._waiting.append(me)
        try:
            while True:
                stop.check()
                if not self._idle:
                    self.start()
                child = None
                with self._lock:
                    if self._ready:
                        end = time.monotonic() + _START_WAIT_S
                    if self._idle and self._waiting[0] is me:
                        child = self._idle.popleft()
                    elif self._started and time.monotonic() < end:
                        self._lock.wait(_LOOK_S)
                    else:
                        raise NoWorkerError
                if child is not None and child.is_running:
                    return child
                if child is not None:
                    self._put_back(child)  # it had idled out, or was killed from outside
        finally:
            with self._lock:
                self._waiting.remove(me)
                self._lock.notify_all()

    def _put_back(self, child: Child) -> None:
        stays = child.is_running
        if not stays:
            child.stop()
        with self._lock:
            if stays:
                self._idle.append(child)
            else:
                self._started -= 1
                self._ready -= 1
            self._lock.notify_all()


_PROTOCOL = 5  # preserves read-only arrays


def _frozen(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)  # pickle cannot import the type by name


class _Pickler(pickle.Pickler):
    """Pickles frozen mappings, and arguments held by both sides as references."""

    dispatch_table: Any = copyreg.dispatch_table | {
        MappingProxyType: lambda mapping: (_frozen, (dict(mapping),))
    }

    def __init__(self, file: io.BytesIO, held: Sequence[Any] = ()) -> None:
        super().__init__(file, _PROTOCOL)
        self._held = {id(value): k for k, value in enumerate(_parts(held))}

    def persistent_id(self, value: Any) -> int | None:
        return self._held.get(id(value))


def _parts(held: Sequence[Any]) -> list[Any]:
    """Arrays and dataclasses in what is held, in the same order in both processes."""
    found: dict[int, Any] = {}
    waiting = [*held]
    for value in waiting:
        if id(value) in found:
            continue
        if is_dataclass(value) and not isinstance(value, type):
            found[id(value)] = value
            # Not its __dict__: a cached property may come in between.
            waiting += (getattr(value, field.name) for field in fields(value))
        elif isinstance(value, np.ndarray):
            found[id(value)] = value
        elif isinstance(value, tuple | list):
            waiting += value
        elif isinstance(value, Mapping):
            waiting += value.values()
    return [*found.values()]


class _Unpickler(pickle.Unpickler):
    def __init__(self, data: bytes, held: Sequence[Any]) -> None:
        super().__init__(io.BytesIO(data))
        self._held = _parts(held)

    def persistent_load(self, number: int) -> Any:
        return self._held[number]


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
        return {}, packed(result, arguments)
    except Exception as error:  # exceptions and results of other libraries may not be picklable
        reason = f"{function} returned {type(result[1]).__name__}, which cannot be sent: {error!s:.200}"
        return {}, packed((True, TypeError(reason)))


def packed(value: Any, held: Sequence[Any] = ()) -> bytes:
    """Return a value as bytes, with references to what is held by both sides."""
    file = io.BytesIO()
    _Pickler(file, held).dump(value)
    return file.getvalue()


def main(memory_bytes: int) -> None:
    """Serve calls at a lower priority than the process that answers clicks."""
    with suppress(AttributeError, OSError):
        os.nice(5)
    serve_here(answer, memory_bytes)
