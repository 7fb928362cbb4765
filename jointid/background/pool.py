"""A pool of worker processes for function calls."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from jointid.background.calls import packed_call, unpacked_result
from jointid.background.child_process import Child, Ended, Limits
from jointid.errors import JointIdError

_MODULE = "jointid.background.calls"
_LIMITS = Limits(time_s=3600.0)
_START_WAIT_S = 20.0
"""Wait for a process that is starting; it loads the numerical libraries, s."""
_BACK_OFF_S = 30.0
"""Back-off after a failed start, s."""


class NoWorkerError(Exception):
    """No process is ready; the caller may compute in its own process."""


class Pool:
    """Worker processes for calls, started lazily.

    Parameters
    ----------
    most : int
        Largest number of processes.
    preload : sequence of str, optional
        Modules that a process imports at its start.
    """

    def __init__(self, most: int, preload: Sequence[str] = ()) -> None:
        self._most = most
        self._preload = preload
        self._started = self._ready = 0  # a process that is starting is not ready
        self._retry_after_s = -math.inf
        self._lock = threading.Lock()
        self._idle: queue.SimpleQueue[Child] = queue.SimpleQueue()

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
        patience_s: float = 0.0,
    ) -> Any:
        """Call ``function(*arguments)`` in a process.

        Parameters
        ----------
        function : callable
            A function of a module, or a ``functools.partial`` of one.
        *arguments
            An argument that is part of the result comes back as the same object.
        progress : callable, optional
            Passed on as ``progress`` if given. An exception it raises ends the call.
        patience_s : float
            Wait for a process that is busy, s.

        Raises
        ------
        NoWorkerError
            When no process runs, or none becomes free in time.
        JointIdError
            When the call crashes its process; and whatever the call raises.
        """
        if not self._ready:
            raise NoWorkerError
        try:
            return self._called(self._free(patience_s), function, arguments, progress)
        except Ended as ended:
            why = str(ended)
        with suppress(Ended, NoWorkerError):  # the process may have been killed from outside
            child = self._free(_START_WAIT_S, starting=True)
            return self._called(child, function, arguments, progress)
        raise JointIdError(
            f"The computation failed. {why} Free memory on the computer that runs it, or shorten the "
            "records; then try again."
        )

    def stop(self) -> None:
        """End the idle processes and start no others."""
        self._most = 0
        while True:
            try:
                self._idle.get_nowait().stop()
            except queue.Empty:
                return

    def _called(
        self,
        child: Child,
        function: Callable[..., Any],
        arguments: Sequence[Any],
        progress: Callable[..., object] | None,
    ) -> Any:
        try:
            call = packed_call(function, arguments, progress is not None)
            _, result = child.ask({}, call, progress)
        finally:
            self._put_back(child)
        return unpacked_result(result, arguments)

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

    def _free(self, patience_s: float, *, starting: bool = False) -> Child:
        """Return an idle process; with ``starting``, wait for one that is starting as well."""
        while True:
            try:
                child = self._idle.get_nowait()
            except queue.Empty:
                self.start()
                if not self._ready and not starting:
                    raise NoWorkerError from None
                child = self._awaited(patience_s)
            if child.is_running:
                return child
            self._put_back(child)  # it had idled out, or was killed from outside

    def _awaited(self, patience_s: float) -> Child:
        try:
            return self._idle.get(timeout=patience_s)
        except queue.Empty:
            raise NoWorkerError from None

    def _put_back(self, child: Child) -> None:
        if child.is_running and self._most:
            self._idle.put(child)
            return
        child.stop()
        with self._lock:
            self._started -= 1
            self._ready -= 1
