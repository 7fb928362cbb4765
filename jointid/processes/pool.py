"""A few processes that stand ready for calls."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from jointid.errors import JointIdError
from jointid.processes.calls import packed_call, unpacked_result
from jointid.processes.child import Child, Ended, Limits

_MODULE = "jointid.processes.calls"
_LIMITS = Limits(time_s=3600.0)
_BEGINNING_S = 20.0
"""How long a process may take to begin; it loads the numerical libraries."""


class NoneReadyError(Exception):
    """No process is ready: the caller may compute by itself."""


class Pool:
    """Processes for calls, none before they are wished for.

    Parameters
    ----------
    most : int
        How many.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._there = self._ready = 0  # the one that is beginning is there, but not ready
        self._lock = threading.Lock()
        self._idle: queue.SimpleQueue[Child] = queue.SimpleQueue()

    def begin(self) -> None:
        """Have one more process begin, if there may be one; nobody waits for it."""
        with self._lock:
            if self._there > self._ready or self._there >= self._most:
                return
            self._there += 1
        threading.Thread(target=self._begin_one, daemon=True).start()

    def call(
        self,
        function: Callable[..., Any],
        *given: Any,
        progress: Callable[..., object] | None = None,
        patience_s: float = 0.0,
    ) -> Any:
        """Have a process call ``function(*given)``.

        Parameters
        ----------
        function : callable
            Of a module, or a ``functools.partial`` of one.
        *given
            What it is called with. What of it comes back is the same object.
        progress : callable, optional
            Left out, the function gets no ``progress``. What it raises ends the call.
        patience_s : float
            How long to wait for a process that is at another call.

        Raises
        ------
        NoneReadyError
            When none is there, or none has become free.
        JointIdError
            When the call ended its process; and whatever the call raises.
        """
        if not self._ready:
            raise NoneReadyError
        with suppress(Ended):
            return self._asked(self._free(patience_s), function, given, progress)
        self.begin()  # perhaps this call was not to blame: another process tries it once more
        try:
            return self._asked(self._free(_BEGINNING_S), function, given, progress)
        except (Ended, NoneReadyError) as error:
            raise JointIdError(
                f"The computation cannot be made. {error} Free memory on the computer that serves this "
                "page, or shorten the records; then load the page again."
            ) from None

    def stop(self) -> None:
        """End the processes that are at no call, and begin no others."""
        self._most = 0
        while True:
            try:
                self._idle.get_nowait().stop()
            except queue.Empty:
                return

    def _asked(
        self,
        child: Child,
        function: Callable[..., Any],
        given: Sequence[Any],
        progress: Callable[..., object] | None,
    ) -> Any:
        try:
            call = packed_call(function, given, progress is not None)
            _, result = child.ask({}, call, progress)
        finally:
            self._put_back(child)
        return unpacked_result(result, given)

    def _begin_one(self) -> None:
        child = Child(_MODULE, _LIMITS)
        try:
            child.begin()
        except (JointIdError, Ended):
            self._most = 0  # it would fail again: all is computed by the callers
        with self._lock:
            self._ready += 1
        self._put_back(child)

    def _free(self, patience_s: float) -> Child:
        try:
            child = self._idle.get_nowait()
        except queue.Empty:
            self.begin()
            child = self._awaited(patience_s)
        if not child.runs:  # was idle for long, or somebody ended it
            self._put_back(child)
            self.begin()
            raise NoneReadyError
        return child

    def _awaited(self, patience_s: float) -> Child:
        try:
            return self._idle.get(timeout=patience_s)
        except queue.Empty:
            raise NoneReadyError from None

    def _put_back(self, child: Child) -> None:
        if child.runs and self._most:
            self._idle.put(child)
            return
        child.stop()
        with self._lock:
            self._there -= 1
            self._ready -= 1
